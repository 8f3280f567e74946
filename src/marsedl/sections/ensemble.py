"""How many trials fly, from which random numbers."""

from marsedl.replication.inputs.sections import Count, Drawn, Section, Seed, given


class Trials(Section):
    """Trials of a Monte Carlo simulation."""

    seed: Seed = given("1", "key of the random numbers")
    trials: Count = given("1", "Monte Carlo trials of each case")
    drawn_trials: Drawn = given("1", "trials drawn in the figures")
