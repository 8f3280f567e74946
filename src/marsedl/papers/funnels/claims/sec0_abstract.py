"""Abstract: what the funnel is worth."""

import numpy as np

from marsedl.papers.funnels.basics import HEAT_RATE
from marsedl.papers.funnels.claims.measures import (
    by_our_limit,
    complete,
    flown_levels,
    largest,
    largest_error,
    over_flown,
)
from marsedl.papers.funnels.inputs import Mission, Planet
from marsedl.papers.funnels.records import FlightEnsemble, Funnel, Nominal, OpenLoop, Proven
from marsedl.replication.claims.counterexamples import replaced, scaled
from marsedl.replication.claims.thresholds import SIMILAR, Limit
from marsedl.replication.claims.writing import Fails, claim, doubtful, holds, measure
from marsedl.replication.units import KM, WATT_PER_CM2

REPEATS = 10  # parts of the flights, for the sampling error of their largest


@claim(
    "The programs are tight within {program:.1g} %; the shape of the slices is not.",
    choices="shape scale_lengths scale_bank",
    counterexample=scaled("constant.maximum_over_trials"),
)
def funnel_is_tight(funnel: Funnel, constant: FlightEnsemble):
    ratio = over_flown(funnel, constant)
    # That of a tenth of the flights; that of all is smaller.
    error = ratio * largest_error(funnel, constant)[1:] / flown_levels(funnel, constant)[1:]
    return holds(
        measure("rho over the largest V of the flights", ratio, error=error) < 1.0 + SIMILAR,
        median=np.median(ratio),
        most=np.max(ratio),
        program=100.0 * largest(funnel.tightness),
    )


@claim(
    "Motion passes the next level in {exceeded} of {stages} stages, by up to {worst:.2f} %.",
    errata="E4 E16 E17",
    choices="scale_bank",
    counterexample=scaled("funnel.true_maximum"),
)
def guaranteed_bounds(funnel: Funnel, proven: Proven | None = None):
    excess = 100.0 * (funnel.true_maximum / funnel.growth - 1.0)
    excess = excess[np.isfinite(excess)]
    if not excess.size:
        raise Fails("no bound was compared with motion: its samples lie on no slice")
    above = np.nan if proven is None else 100.0 * np.max(proven.level / funnel.level - 1.0)
    # A search that finds no motion beyond a bound proves nothing; levels that are proven do.
    is_proven = proven is not None and proven.proven and above <= 0.0
    return holds(
        measure("excess of motion that was found over the bound of its stage", excess, "%") <= 0.0,
        *([] if is_proven else [doubtful("no motion was found beyond the bounds, but they are not proven")]),
        exceeded=int(np.count_nonzero(excess > 0.0)),
        stages=len(excess),
        worst=excess.max(),
        proven=above,
    )


@claim(
    "The paper defines no goal region; ours has {downrange:g} by {crossrange:g} km as half lengths.",
    choices="goal_region",
    counterexample=scaled("mission.goal_lengths"),
)
def reaches_goal_region(planet: Planet, mission: Mission, funnel: Funnel, proven: Proven | None = None):
    goal, reach = mission.goal_lengths / KM, _widths(planet, funnel.half_width[-1])
    if proven is not None:
        reach = np.maximum(reach, _widths(planet, proven.half_width[-1]))
    subject = "half widths of the last slice over those of our goal, downrange and crossrange"
    judged = by_our_limit(measure(subject, reach / goal) <= Limit(1.0), "the paper defines no goal region")
    return holds(judged, downrange=goal[0], crossrange=goal[1])


@claim(
    "We compare with flights without feedback, from the same first slice.",
    counterexample=scaled("open_loop.flown_half_width"),
)
def increased_landing_accuracy(planet: Planet, constant: FlightEnsemble, open_loop: OpenLoop):
    ends = np.abs(constant.final_state[:, 1:3]) * planet.planet_radius / KM
    ends[~np.isfinite(ends).all(axis=1)] = np.nan
    under, without = np.fmax.reduce(ends, axis=0), open_loop.flown_half_width / KM
    parts = [ends[part::REPEATS].ravel() for part in range(REPEATS)]
    repeats = np.array([largest(part) for part in parts]), open_loop.repeat_half_width.max(axis=1) / KM
    error = np.sqrt(sum(_variance(repeat) for repeat in repeats))  # of tenths; that of all is smaller
    linear_without, linear_with = open_loop.linear_half_width / KM
    return holds(
        measure(f"largest final deviation of {len(ends):,} flights with feedback", under.max(), "km", error=error)
        < without.max(),
        measure("that of linear motion with feedback", linear_with.max(), "km") < linear_without.max(),
        doubtful("the paper does not say compared with what"),
    )


@claim(
    "The paper prints no limit; the nominal lies on ours, {limit:g} W/cm^2.",
    choices="heat_rate_limit",
    counterexample=scaled("nominal.heat_rate_limit"),
)
def thermal_constraint_funnel(nominal: Nominal, funnel: Funnel, constant: FlightEnsemble):
    limit = nominal.heat_rate_limit / WATT_PER_CM2
    on_funnel = largest(funnel.heat_rate, np.inf) / WATT_PER_CM2
    flown_rate = largest(constant.maximum_over_trials[:, HEAT_RATE]) / WATT_PER_CM2
    judged = measure("heat rate in the slices, for which the limit is ours", on_funnel, "W/cm^2") <= Limit(limit)
    return holds(
        by_our_limit(judged, "the paper prints no limit of the heat rate"),
        f"{flown_rate:.4g} W/cm^2 in flights",
        limit=limit,
    )


@claim(
    errata="E20",
    counterexample=replaced("redrawn.outside_at_slices", 1),
)
def no_distribution_assumed(
    funnel: Funnel, constant: FlightEnsemble, redrawn: FlightEnsemble, adversarial: FlightEnsemble
):
    laws = {"constant": constant, "redrawn": redrawn, "adversarial": adversarial}
    return holds(
        complete(funnel),
        *(
            measure(f"flights of {len(law.outcome):,} outside at a slice, {name} disturbance", law.outside_at_slices)
            < 1
            for name, law in laws.items()
        ),
        measure("flights that are lost", sum(law.excluded for law in laws.values())) < 1,
    )


def _variance(values):
    """Sample variance of the numbers among some values, if there are two of them."""
    values = values[np.isfinite(values)]
    return np.var(values, ddof=1) if len(values) > 1 else np.nan


def _widths(planet, half_width):
    """Half widths downrange and crossrange, km."""
    return half_width[1:3] * planet.planet_radius / KM
