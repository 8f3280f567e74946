"""Universes: a paper under all admissible answers to what is doubted about it, and what decides its claims."""
