"""Sec. 3 and the appendices: slices, samples, disturbances and the condition of a stage."""

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import SPHERES
from marsedl.papers.funnels.claims.measures import Definiteness, TooFewSamples, complete, largest, of_variant, on_slices
from marsedl.papers.funnels.inputs import Planet, Recursion, Uncertainty
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Dubins,
    EulerStep,
    FlightEnsemble,
    Funnel,
    Gains,
    StageStudy,
    Stationary,
)
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted
from marsedl.replication.claims.thresholds import MOST, ROUNDING
from marsedl.replication.claims.writing import Fails, check, claim, holds, measure

SAME_OPTIMUM = 1e-5  # relative difference between bounds of one program by different solvers and forms
ROUND_TRIP = 1e-3  # relative; backwards and forwards again


@claim(errata="E3")
def volume_objective(funnel: Funnel):
    states = funnel.shape.shape[1]
    term = states * np.log(funnel.level) - np.linalg.slogdet(funnel.shape)[1]
    as_volume = np.ptp(term - funnel.log_volume)
    return holds(
        measure("departure of the logarithm of rho^n/det P from that of the volume, over the slices", as_volume)
        < ROUNDING,
        by_construction="an identity of determinants, whatever the shapes and levels are",
    )


@claim(errata="E9 E10", by_construction="rho_1 is computed from this condition")
def initial_containment(planet: Planet, uncertainty: Uncertainty, gains: Gains, funnel: Funnel):
    semi_axes = environment.initial_semi_axes(planet, uncertainty)
    starts = semi_axes * funnel.samples[:, : funnel.shape.shape[1]]
    inside = 0.5 * np.einsum("mi,ij,mj->m", starts, gains.shape[0], starts) / funnel.level[0]
    initial_set = environment.initial_set(semi_axes)
    axes = np.sqrt(np.diag(initial_set))
    singular = np.linalg.eigvalsh((initial_set - gains.shape[0] / funnel.level[0]) / np.outer(axes, axes))[0]
    return holds(
        measure("least eigenvalue of M_1 - P_1/rho_1, in units of M_1, by magnitude", abs(singular)) < ROUNDING,
        measure(f"V/rho_1 at {len(inside)} points of the boundary of S_1", inside) <= 1.0 + ROUNDING,
        first=funnel.level[0],
    )


@claim(by_construction="the boundary of an ellipsoid is the zero set of a quadratic polynomial")
def bk_is_algebraic_variety(funnel: Funnel, definiteness: Definiteness):
    return holds(
        measure("least eigenvalue of its matrix, in the scales of the regulator", definiteness.least) > 0.0,
        measure("levels", funnel.level[np.isfinite(funnel.level)]) > 0.0,  # of the slices that it has
    )


@claim(
    "Neither P_k nor rho_k enters Eq. 26, so V/rho is between {low:.0e} and {high:.0e}.",
    errata="E1",
    counterexample=replaced("funnel.literal_level", 1.0),
)
def rescaled_points_on_bk(funnel: Funnel):
    literal, si = funnel.literal_level, funnel.literal_level_si
    low, high = np.nanmin(literal), np.nanmax(literal)
    departure = np.array([abs(low - 1.0), abs(high - 1.0)])
    return holds(
        measure("departure of V/rho from 1 at points by Eq. 26", departure) < ROUNDING,
        f"V/rho is {low:.2g} to {high:.2g} in km and rad, {np.nanmin(si):.2g} to {np.nanmax(si):.2g} in m and rad",
        low=low,
        high=high,
    )


@claim(errata="E2")
def rescaled_w_on_boundary(funnel: Funnel):
    disturbances = funnel.samples[:, funnel.shape.shape[1] :]
    rescaled = disturbances / np.sqrt(0.5 * np.sum(disturbances**2, axis=1, keepdims=True))
    without_matrix = np.sum(rescaled**2, axis=1)  # 1/2 w'Uw with U = 2, the unit disc
    return holds(
        measure("departure of 1/2 w'Uw from 1 on the unit disc, if no matrix is used", np.abs(without_matrix - 1.0))
        < ROUNDING,
        by_construction="a set is written where a matrix is needed: read as no matrix, the factor is off by a constant",
    )


@claim(
    "It holds with as many samples as the rank asks for, and degrees that agree.",
    errata="E5 E8",
    counterexample=scaled("stage_study.form_bound", at=(1,)),
)
def sampling_equivalence(stage_study: StageStudy, coarse_funnels: CoarseFunnels):
    bounds = stage_study.form_bound
    apart = largest(np.abs(bounds / bounds[0] - 1.0), np.inf)
    whole = coarse_funnels.multiplier_difference
    return holds(
        check(f"all {len(bounds)} programs of one stage are solved", np.isfinite(bounds)),
        measure("relative difference of their bounds", apart) < SAME_OPTIMUM,
        measure("relative difference of the levels of a whole funnel", whole) < SAME_OPTIMUM,
    )


@claim(
    "The number is {used}, the rank of the products of the basis.",
    errata="E8",
    counterexample=scaled("stage_study.product_rank"),
)
def minimum_samples_computable(funnel: Funnel, stage_study: StageStudy, samples: TooFewSamples, dubins: Dubins):
    used = len(funnel.samples)
    rank = int(stage_study.product_rank[list(stage_study.variables).index(SPHERES.variables)])
    subject = f"difference of the {used} samples used for the entry from that rank, {rank}"
    calm = list(stage_study.variables).index(SPHERES.dimensions[0])  # without disturbance
    return holds(
        measure(subject, abs(used - rank)) < 1,
        measure("that of the Dubins car from its own", np.abs(dubins.samples - dubins.rank)) < 1,
        used=used,
        basis_calm=stage_study.basis_size[calm],
        rank_calm=stage_study.product_rank[calm],
        **samples._asdict(),
    )


@claim(
    "Nothing is lost: a larger slice contains the smaller one.",
    errata="E21",
    choices="sampling",
    counterexample=replaced("funnel.memory", 0.0),
)
def greedy_needed(funnel: Funnel):
    subject = "change of the second level by a first level ten times as large"
    return holds(measure(subject, 100 * abs(funnel.memory), "%") > 100 * ROUNDING)


@claim(
    "It is too small in {share:.0f} % of the stages, by up to {worst:.2f} %.",
    errata="E4 E13 E19",
    counterexample=shifted("euler_step.excess"),
)
def stage_condition_bounds_step(euler_step: EulerStep):
    excess = euler_step.excess[np.isfinite(euler_step.excess)]
    if not excess.size:
        raise Fails("no stage has a bound")
    share, least, most = 100.0 * np.array([np.mean(excess < 0.0), excess.min(), excess.max()])
    return holds(
        measure("least excess of the bound of Eq. 22 over that of the motion, from the same level", least, "%")
        >= -100.0 * ROUNDING,
        share=share,
        worst=-least,
        most=most,
    )


@claim(
    "We find it for flights; the condition itself speaks of slices only.",
    errata="E16",
    counterexample=replaced("adversarial.outside_between", 1),
)
def interpolation_between_slices(
    recursion: Recursion, funnel: Funnel, constant: FlightEnsemble, redrawn: FlightEnsemble, adversarial: FlightEnsemble
):
    laws = constant, redrawn, adversarial
    highest = largest([law.largest_ratio for law in laws], np.inf)
    subject = "flights outside between the slices under all three kinds of disturbance, with rho on lines"
    return holds(
        complete(funnel),
        on_slices(recursion, funnel),
        measure(subject, sum(law.outside_between for law in laws)) < 1,
        measure("flights that are lost", sum(law.excluded for law in laws)) < 1,
        f"largest V/rho after the start {highest:.4g}",
    )


@claim(
    "B_k depends on the unknown level: a search takes {programs:.1f} programs a stage.",
    errata="E21",
    counterexample=replaced("coarse_funnels.round_trip_shortfall", 1e-4),
)
def backward_funnel(coarse_funnels: CoarseFunnels):
    back = of_variant(coarse_funnels, "backward")
    return holds(
        check(f"from rho = {back[-1]:g} at the end a level exists at all {len(back)} slices", np.isfinite(back)),
        measure("relative departure after going forward again", coarse_funnels.round_trip) < ROUND_TRIP,
        measure("shortfall", coarse_funnels.round_trip_shortfall) < ROUNDING,
        programs=coarse_funnels.backward_programs.mean(),
    )


@claim(
    "The set O is empty; that of the expansion lies outside W.",
    errata="E6 E11",
    counterexample=replaced("stationary.interior_better", 1),
)
def worst_disturbance_location(stationary: Stationary):
    return holds(
        measure("deviations whose worst disturbance is inside of W", stationary.interior_better) <= 0,
        measure("points of O in W", stationary.stationary_inside) <= 0,
    )


@claim(
    "The expansion has them for {share:.0f} % of the deviations, the equations have none.",
    errata="E6",
    counterexample=scaled("stationary.stationary_converged"),
)
def stationary_w_by_newton(stationary: Stationary):
    share = 100.0 * stationary.stationary_converged
    subject = "deviations for which Newton's method ends in no point of O, as a share"
    return holds(measure(subject, 1.0 - stationary.stationary_converged) < MOST, share=share)


@claim(
    "Of the disturbances found, {inside} lie in W: their median norm is {median:.0f}.",
    errata="E6",
    counterexample=replaced("stationary.stationary_inside", 1),
)
def stationary_w_as_samples(stationary: Stationary):
    least, median, most = stationary.stationary_norm
    return holds(
        measure("points of O that lie in W", stationary.stationary_inside) > 0,
        f"their norms are {least:.3g} to {most:.3g} (median {median:.3g}) where W ends at 1; there the polynomial is "
        f"up to {stationary.stationary_value:.3g}, on the boundary of W {stationary.boundary_value:.4g}",
        median=median,
        inside=stationary.stationary_inside,
        asked=stationary.stationary_value / stationary.boundary_value,
    )


@claim(errata="E13", by_construction="the rate of V is linear in the rates of the states")
def w_gradient_formula(stationary: Stationary):
    departure = measure("departure of Eq. 35 from differences of the rate of V", stationary.gradient_deviation)
    return holds(departure < ROUNDING)
