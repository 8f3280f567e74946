"""Ridderhof, Tsiotras and Johnson: stochastic entry guidance."""

from marsedl.replication.pipeline.catalogue import Paper, Solve

PAPER = Paper(
    slug="stochastic_entry",
    title="Stochastic Entry Guidance",
    authors="Jack Ridderhof, Panagiotis Tsiotras and Breanna J. Johnson",
    citation="J. Ridderhof, P. Tsiotras, B. J. Johnson, Stochastic Entry Guidance, Georgia Institute of Technology "
    "and NASA Johnson Space Center, 2021; no venue on the copy used",
    solves=(
        Solve("gains", "status", "iterations"),
        Solve("certificates", "cone_status", "cone_iterations", what="cone"),
    ),
)
