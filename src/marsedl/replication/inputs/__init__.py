"""What a user writes: typed sections of inputs, and readings of them from YAML."""

CORRECTED = "corrected"  # the reading whose verdicts count, and which figures show
PRINTED = "printed"  # the reading that uses every input as the paper states it
UNIVERSES = "universes"  # stands where a reading does, in paths and in artifacts, for all points that are not readings
CHUNKS = "chunks"  # the folder of a reading's artifacts of which a case is gathered
RESERVED = (UNIVERSES, CHUNKS)  # words of paths that no reading is named after
