"""Sec. 4: the software, the entry vehicle, its nominal trajectory and Fig. 4."""

from math import comb

import numpy as np

from marsedl.papers.funnels.basics import BASIS_DEGREE, SPHERES
from marsedl.papers.funnels.claims.measures import (
    Definiteness,
    complete,
    flown_levels,
    largest,
    of_variant,
    sampled_levels,
)
from marsedl.papers.funnels.inputs import Recursion, Studies
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    EquationsOfMotion,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Linearization,
    Nominal,
    StageStudy,
)
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.claims.writing import check, claim, holds, measure, measured, whichever
from marsedl.replication.pipeline.injection import Missing
from marsedl.replication.units import DEGREE, WATT_PER_CM2

# More than this costs half of the digits of double precision.
WELL_CONDITIONED = np.finfo(float).eps ** -0.5


@claim("With the printed d, the degrees of both sides of Eq. 24 differ.", errata="E5 E14")
def exponent_d(recursion: Recursion):
    return measured(recursion.exponent_d)


@claim(
    "Where the samples are, {independent} rows are independent.",
    errata="E8 E18",
    by_construction="two disturbances were chosen because they give the printed number",
)
def gram_size():
    return measured(
        len(SPHERES.monomials(BASIS_DEGREE)),
        independent=SPHERES.basis_dimension(BASIS_DEGREE),
    )


@claim(
    "With the printed d, an expansion of order {order} asks for {with_exponent} rows.",
    errata="E5",
    choices="taylor_order",
    counterexample=replaced("recursion.taylor_order", 1),
)
def gram_45_follows_from_d1(recursion: Recursion):
    rows, order = len(SPHERES.monomials(BASIS_DEGREE)), recursion.taylor_order
    with_exponent = gram_rows(order, 1)
    return holds(
        measure(f"difference from {rows} rows with d = 1 and an expansion of order {order}", abs(with_exponent - rows))
        <= 0,
        order=order,
        with_exponent=with_exponent,
    )


def gram_rows(order, exponent):
    """Rows of the Gram matrix of (x'x)^d D, if D has the degree of an expansion of some order times one deviation."""
    half = -(-(2 * exponent + order + 1) // 2)
    return comb(SPHERES.variables + half, half)


@claim("With disturbances added to all states there would be {with_additive} rows.", errata="E7")
def gram_45_with_additive_disturbances():
    rows, variables, states = len(SPHERES.monomials(BASIS_DEGREE)), SPHERES.variables, SPHERES.dimensions[0]
    with_additive = comb(variables + states + BASIS_DEGREE, BASIS_DEGREE)
    return holds(
        measure(f"difference from {rows} rows with six additive disturbances", abs(with_additive - rows)) <= 0,
        with_additive=with_additive,
        by_construction="a number of monomials, which no record can change",
    )


@claim(
    "Its condition number is {sphere:.0f}, with variance one {variance:.1f}; monomials have {monomials:.0f}.",
    errata="E24",
    counterexample=scaled("stage_study.basis_condition", at=(4,)),
)
def hermite_conditioning(stage_study: StageStudy):
    condition = dict(zip(stage_study.basis, stage_study.basis_condition, strict=True))
    names = {
        "sphere": "Hermite, whitened",
        "variance": "Hermite, whitened with variance one",
        "monomials": "monomials, whitened",
    }
    values = {key: condition[name] for key, name in names.items()}
    subject = "condition number of the Hermite basis at the samples on the unit sphere"
    return holds(
        whichever(
            measure(subject, values["sphere"]) < values["monomials"],
            measure(subject, values["sphere"]) < WELL_CONDITIONED,
        ),
        **values,
    )


@claim(
    "Linear dynamics are no bound: they end at {linear:.2f}, the funnel at {level:.2f}.",
    counterexample=replaced("funnel.outcome", "the funnel diverges"),
)
def four_funnel_solvers(
    funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble, coarse_funnels: CoarseFunnels
):
    multipliers, exact = of_variant(coarse_funnels, "multipliers"), linear_bounds.exact_level
    flights = flown_levels(funnel, constant)
    exist = [np.isfinite(levels).all() for levels in (multipliers, exact, flights)]
    return holds(
        complete(funnel),
        check("a level exists at all slices by multipliers, linear dynamics and flights", exist),
        f"final rho {multipliers[-1]:.4g} by multipliers, {flights[-1]:.4g} by flights",
        linear=exact[-1],
        level=funnel.level[-1],
    )


@claim(name="state_dimension", degrees_of_freedom=False)
@claim(name="model_degrees_of_freedom", degrees_of_freedom=True)
def dimensions(linearization: Linearization, *, degrees_of_freedom):
    states = linearization.state.shape[1]
    return measured(states // 2 if degrees_of_freedom else states)


@claim(errata="E15", counterexample=replaced("equations_of_motion.velocity_rate_deviation", 1e-3))
def entry_equations(equations_of_motion: EquationsOfMotion):
    apart = max(equations_of_motion.position_rate_deviation, equations_of_motion.velocity_rate_deviation)
    subject = "relative departure of the rates from inertial motion at random states, with rotation written out"
    return holds(measure(subject, apart) < ROUNDING)


@claim(
    choices="scale_lengths scale_bank slices",
    counterexample=replaced("funnel.rising_undisturbed", 1e-3),
)
def tvlqr_as_lyapunov(recursion: Recursion, funnel: Funnel, definiteness: Definiteness):
    if recursion.shape != "value_matrix":
        raise Missing("slices of the regulator's cost-to-go")
    rising = 100 * largest(funnel.rising_undisturbed, np.inf)
    return holds(
        complete(funnel),
        measure("least eigenvalue of the matrices", definiteness.least) > 0.0,
        measure("random points of the slices at which V grows without disturbance", rising, "%") <= 0.0,
    )


@claim(
    "The heat rate is {nodes:.2f} W/cm^2 at the nodes, but {between:.2f} W/cm^2 between them.",
    errata="E22 E23",
    by_construction="the limit is ours, and the solver imposes it at the nodes",
)
def thermal_constraint_nominal(nominal: Nominal):
    limit, peak = nominal.heat_rate_limit / WATT_PER_CM2, nominal.peak_heat_rate / WATT_PER_CM2
    at_nodes = nominal.heat_rate.max() / WATT_PER_CM2
    return holds(
        measure("heat rate at the nodes, where it is limited", at_nodes, "W/cm^2") <= limit * (1.0 + ROUNDING),
        nodes=at_nodes,
        between=peak,
        cost=nominal.cost / DEGREE**2,
        final_time=nominal.time[-1],
    )


@claim(
    "Under the worst disturbance V grows at {worst:.2g} % of the slice.",
    choices="fig4_plane",
    counterexample=shifted("funnel.fig4_circle_rate"),
)
def fig4_samples_cover_sublevel_set(recursion: Recursion, studies: Studies, funnel: Funnel):
    # Judged without disturbance, as the caption names none.
    k = studies.fig4_slice - 1
    departure = largest(np.abs(sampled_levels(recursion, funnel) - 1.0), np.inf)
    return holds(
        measure("departure of V/rho from 1 at the samples", departure) < ROUNDING,
        measure("largest rate of V on the slice, undisturbed", largest(funnel.fig4_circle_rate, np.inf)) < 0.0,
        measure("points of the slice at which it grows", 100 * funnel.rising_undisturbed[k], "%") <= 0.0,
        worst=100.0 * funnel.rising[k],
    )
