"""Doors from a vehicle's own equations to a law with a proof: the same `rates` that fly are designed with."""
