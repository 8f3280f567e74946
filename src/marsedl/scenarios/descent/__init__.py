"""The descent: the lander of powered_descent from its powered start to the ground, in three dimensions or in the plane.

It is the paper's vehicle with limits of its thrust, held commands, a lag, gusts, navigation errors, and ground a few
metres below the state at which the paper ends.
"""
