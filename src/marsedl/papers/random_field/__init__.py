"""Ridderhof and Tsiotras: chance-constrained covariance steering in a Gaussian random field."""

from marsedl.replication.pipeline.catalogue import Paper, Solve

PAPER = Paper(
    slug="random_field",
    title="Chance-Constrained Covariance Steering in a Gaussian Random Field via Successive Convex Programming",
    authors="Jack Ridderhof and Panagiotis Tsiotras",
    citation="J. Ridderhof, P. Tsiotras, Chance-Constrained Covariance Steering in a Gaussian Random Field via "
    "Successive Convex Programming, Georgia Institute of Technology, 2021 (so cited in “Stochastic Entry Guidance”); "
    "no venue on the copy used",
    # What gains of 1e18 and more make of the claims, and how nearly two solutions of one program agree.
    noise=("claims/*/literal_gains", "corrected/certificates/*_gain_difference"),
    solves=(
        Solve("double_integrator", "status", "solver_iterations", "solver_residual"),
        Solve("gains", "status", "solver_iterations", "solver_residual"),
    ),
)
