"""Monte Carlo engine: random streams, integrators, ensembles, statistics; knows no vehicle."""
