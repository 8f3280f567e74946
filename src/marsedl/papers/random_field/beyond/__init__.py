"""Checks of the design by other formulations, and how its iteration ends: beyond what the paper prints."""
