"""Order of the components in what flights store; kernels and whoever reads flights index by these names."""

# The state, and what is stored of it over time and at the end.
ALTITUDE, LATITUDE, LONGITUDE, RADIAL_VELOCITY, NORTH_VELOCITY, EAST_VELOCITY, BANK, BANK_RATE = range(8)
STATES = 8
CUMULATIVE = 8  # integral of the magnitude of the flown bank acceleration
STORED = 9

BANK_ACCELERATION, COMMAND_MAGNITUDE = range(2)  # as flown; as commanded
