"""Monte Carlo engine: random streams, integrators, ensembles, statistics; independent of any vehicle."""

LANES = 64
"""Trials in a group of compiled code: a multiple of every vector width, and enough to keep the cost per loop small."""
