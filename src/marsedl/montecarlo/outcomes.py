"""The ways in which a trial can end."""

# Any other small integer is the paper's to define.
COMPLETED, CRASHED, ESCAPED, NON_FINITE = 0, 1, 2, 3
