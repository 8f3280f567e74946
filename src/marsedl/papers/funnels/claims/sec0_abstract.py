"""Abstract: what the funnel is worth."""

import numpy as np

from marsedl.papers.funnels.basics import HEAT_RATE
from marsedl.papers.funnels.claims.measures import complete, flown_levels, largest, largest_error, over_flown
from marsedl.papers.funnels.inputs import Mission, Planet
from marsedl.papers.funnels.records import FlightEnsemble, Funnel, Nominal, OpenLoop, Proven
from marsedl.replication.claims.counterexamples import scaled
from marsedl.replication.claims.thresholds import SIMILAR
from marsedl.replication.claims.writing import check, claim, doubtful, holds, measure
from marsedl.replication.pipeline.injection import Missing
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
    counterexample=scaled("proven.level"),
)
def guaranteed_bounds(funnel: Funnel, proven: Proven | None = None):
    # A level that is proven cannot be below what motion was seen to reach: one test is enough.
    exceeded = int(np.count_nonzero(funnel.true_maximum > funnel.growth))
    stages = int(np.count_nonzero(np.isfinite(funnel.true_maximum)))
    excess = np.nan
    if proven is None:
        # Without a proof, motion that passes a bound refutes it; without such motion nothing is decided.
        seen = 100.0 * largest(funnel.true_maximum / funnel.growth - 1.0)
        if seen <= 0.0:
            raise Missing("levels that are proven")
        covered = check("its levels are proven in this reading", False)
        if seen > 0.0:
            covered = measure("excess of motion that was found over the next level", seen, "%") <= 0
    elif not proven.proven:
        covered = check(f"levels are proven to the end (the outcome is: {proven.outcome})", False)
    else:
        above = 100.0 * (proven.level / funnel.level - 1.0)
        excess = np.max(above)
        covered = measure("excess of levels that are proven for the integrated motion", above, "%") <= 0
    worst = 100.0 * largest(funnel.violation)
    return holds(
        covered,
        exceeded=exceeded,
        stages=stages,
        worst=worst,
        excess=excess,
    )


@claim(choices="goal_region", counterexample=scaled("mission.goal_lengths"))
def reaches_goal_region(planet: Planet, mission: Mission, funnel: Funnel, proven: Proven | None = None):
    goal, reach = mission.goal_lengths / KM, _widths(planet, funnel.half_width[-1])
    tests = [measure("half widths of the last slice, downrange and crossrange", reach, "km") <= goal]
    if proven is not None:
        tests.append(measure("proven ones", _widths(planet, proven.half_width[-1]), "km") <= goal)
    return holds(*tests)


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
    "To respect {limit:g} W/cm^2, the limit of the nominal would have to be lower.",
    choices="heat_rate_limit",
    counterexample=scaled("nominal.heat_rate_limit"),
)
def thermal_constraint_funnel(nominal: Nominal, funnel: Funnel, constant: FlightEnsemble):
    limit = nominal.heat_rate_limit / WATT_PER_CM2
    on_funnel = largest(funnel.heat_rate, np.inf) / WATT_PER_CM2
    flown_rate = largest(constant.maximum_over_trials[:, HEAT_RATE]) / WATT_PER_CM2
    return holds(
        measure("heat rate in the slices", on_funnel, "W/cm^2") <= limit,
        f"{flown_rate:.4g} W/cm^2 in flights; the limit of the nominal is {limit:g} W/cm^2",
        limit=limit,
    )


@claim(
    errata="E20",
    by_construction="a declaration: no distribution enters the programs; the flights are evidence beside it",
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
