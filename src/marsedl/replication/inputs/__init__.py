"""What a user writes: typed sections of inputs, and readings of them from YAML."""

CORRECTED = "corrected"  # the reading whose verdicts count, and which figures show
PRINTED = "printed"  # the reading that uses every input as the paper states it
