"""Shen, Seywald and Powell: desensitizing the pin-point landing trajectory on Mars."""

from marsedl.replication.pipeline.catalogue import Paper, Solve

PAPER = Paper(
    slug="desensitized",
    title="Desensitizing the Pin-Point Landing Trajectory on Mars",
    authors="H. Shen, H. Seywald, R. W. Powell",
    citation="Analytical Mechanics Associates, Hampton, Virginia; no year or venue on the copy used",
    # Trajectory and gains of Eq. 6 together, ended before they converge: the last iterate is decided by rounding.
    noise=(
        "printed/gains/*",
        "printed/responses/*",
        "printed/montecarlo.entry_errors/*",
        *(f"claims/{claim}/printed" for claim in ("fig05b_phase_times", "fig07b_phase_times", "fig09_reduction*")),
    ),
    solves=(
        Solve("nominal", "status", "iterations"),
        Solve("tradeoff", "path_status", what="path"),
        Solve("tradeoff", "status", "iterations"),
        Solve("gains", "converged", "iterations"),
        Solve("minimum_fuel", "status"),
    ),
)
