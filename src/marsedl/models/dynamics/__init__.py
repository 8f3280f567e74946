"""Equations of motion, one equation set a file."""
