"""Monte Carlo engine: random streams, integrators, ensembles, statistics; independent of any vehicle."""
