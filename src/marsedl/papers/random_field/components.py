"""Order of the components in what flights store; whoever reads flights indexes by these names."""

# Aerocapture: over time, and behind the first three of these at the end.
ALTITUDE, VELOCITY, FLIGHT_PATH_ANGLE, DENSITY_VARIATION, DYNAMIC_PRESSURE, BANK_COSINE = range(6)
FLOORED = 3

# Double integrator: over time, the integrated state first.
POSITION, RATE, FIELD, CONTROL = range(4)
