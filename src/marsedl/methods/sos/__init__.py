"""Sums of squares on products of spheres: well chosen samples, semidefinite programs and their checks."""
