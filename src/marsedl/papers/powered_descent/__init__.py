"""Ridderhof and Tsiotras: covariance steering for Mars powered descent."""

from marsedl.replication.pipeline.catalogue import Paper, Solve

PAPER = Paper(
    slug="powered_descent",
    title="Uncertainty Quantification and Control During Mars Powered Descent and Landing using Covariance Steering",
    authors="Jack Ridderhof and Panagiotis Tsiotras",
    citation="J. Ridderhof, P. Tsiotras, Uncertainty Quantification and Control During Mars Powered Descent and "
    "Landing using Covariance Steering, AIAA Guidance, Navigation, and Control Conference, 2018",
    solves=(
        Solve("fixed_point", "converged", "iterations"),
        Solve("fixed_point", "sweep_converged", "sweep_iterations", what="sweep"),
        Solve("certificates", "solver_status", "solver_iterations", what="solver"),
    ),
)
