"""Checks of the design by other methods, and how Algorithm 1 fares: beyond what the paper prints."""
