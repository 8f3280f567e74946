"""Invariant funnels of a closed loop around a reference trajectory."""
