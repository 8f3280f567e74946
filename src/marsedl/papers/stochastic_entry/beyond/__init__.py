"""Checks of the stochastic law by other formulations, and its tradeoff: beyond what the paper prints."""
