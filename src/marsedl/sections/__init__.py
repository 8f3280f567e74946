"""Input sections that several papers have: the world, what flies in it, and how many trials fly."""
