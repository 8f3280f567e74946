"""Derollez, Le Cleac'h and Manchester: robust entry vehicle guidance with sampling-based invariant funnels."""

from marsedl.replication.pipeline.catalogue import Paper, Solve

PAPER = Paper(
    slug="funnels",
    title="Robust Entry Vehicle Guidance with Sampling-Based Invariant Funnels",
    authors="R. Derollez, S. Le Cleac'h, Z. Manchester",
    citation="Stanford University and Carnegie Mellon University; no year or venue on the copy used",
    noise=(
        *("*/funnel/gap", "*/funnel/tightness"),  # what is left where a solver ends
        "*/stationary/stationary_*",  # stationary points of polynomials far outside of their range
        # Differences of solvers of first order, and searches that end within a tolerance.
        *("corrected/coarse_funnels/multiplier_difference", "corrected/coarse_funnels/round_trip*"),
        *("corrected/coarse_funnels/backward_programs", "corrected/dubins_study/backward_level"),
    ),
    measured=True,
    solves=(
        Solve("dubins", "status"),
        Solve("nominal", "status", "iterations"),
        Solve("funnel", "status", "iterations", "residual"),
        Solve("stage_study", "form_status", "form_iterations", "form_residual", "form"),
        Solve("coarse_funnels", "multiplier_status", what="multiplier"),
    ),
)
