"""Covariance steering."""
