"""The ways in which a trial can end."""

# Any other small integer is the paper's to define.
COMPLETED, CRASHED, ESCAPED, NON_FINITE = 0, 1, 2, 3

# What ended a flight, beside the numbers of its ends from 0 on.
NOTHING, MET_AT_THE_START = -1, -2
