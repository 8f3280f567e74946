"""Results of a build as labelled data, for notebooks and scripts.

    from marsedl import results

    results.claims()                                          # every printed number in every reading, long
    results.verdicts()                                        # one row a claim: verdict, margin, what turns it
    results.table("powered_descent", "eq54")                  # a table that the figures stand beside
    results.artifact("powered_descent", "gains")              # what a stage computed, dimensions and components named
    results.ensemble("powered_descent", "closed_loop")        # trials of a Monte Carlo case, read when used
    results.universes("powered_descent", committed=True)      # each number of each claim in every universe
    results.inputs("powered_descent", "printed")              # a reading's inputs with units and sources
    results.arena()                                           # guidance laws beside each other, long

Nothing is computed: asking for something that is not built raises an error that names the command. Everywhere, `build`
is the folder of another build; by default it is the current folder if that holds a build, else that of the project.
"""

from marsedl.words import missing

try:
    from marsedl.results.artifacts import artifact, ensemble
    from marsedl.results.tables import arena, claims, inputs, table, universes, verdicts
except ModuleNotFoundError as error:
    raise missing(error, "results") from None

__all__ = ["arena", "artifact", "claims", "ensemble", "inputs", "table", "universes", "verdicts"]
