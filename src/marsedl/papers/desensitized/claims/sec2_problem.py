"""Secs. 2 and 3: the objectives."""

import numpy as np

from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.claims.measures import Rows, printed_rows
from marsedl.papers.desensitized.inputs import Vehicle
from marsedl.papers.desensitized.records import MinimumFuel
from marsedl.replication.claims.counterexamples import scaled, shifted
from marsedl.replication.claims.thresholds import ABOUT, NEARLY_EXACT, ROUNDING, SIMILAR
from marsedl.replication.claims.writing import claim, holds, listed, measure
from marsedl.replication.units import DEGREE

ENERGY, FUEL, ENERGY_BESIDE = range(3)  # solutions of the study of least fuel


@claim(
    "No formula is printed; ours gives the printed fuels within {largest:.2f} %.",
    errata="E1 E2",
    counterexample=scaled("vehicle.roll_inertia"),
)
def fuel_proportional_to_cumulative_rate(vehicle: Vehicle, published: dict):
    # Ours is proportional by its formula: the printed columns are judged.
    rates, fuels = np.transpose([row[1:3] for row in printed_rows(published).values()])
    apart = 100 * np.abs(fuels / entry_problem.propellant(vehicle, rates * DEGREE) - 1.0)
    # The constants that give the printed fuels within rounding, of fuels and rates.
    half_rate, half_fuel = 0.5 * np.array(published["tab03_c0"].resolution[1:3])
    low, high = (fuels - half_fuel) / (rates + half_rate), (fuels + half_fuel) / (rates - half_rate)
    return holds(
        measure("difference of the printed fuels from one constant times the printed cumulative bank rates", apart, "%")
        <= 100 * ABOUT,
        largest=apart.max(),
        low=low.max(),
        high=high.min(),
        constant=entry_problem.propellant(vehicle, DEGREE),
    )


@claim(
    "Under the printed bound, thrust is shorter than an interval; we judge a smaller bound.",
    errata="E16",
    counterexample=shifted("minimum_fuel.coasting", at=(1, FUEL)),
)
def min_fuel_bang_coast_bang(minimum_fuel: MinimumFuel):
    # Judged where thrust lasts longer than an interval, under the smallest bound.
    bounds = minimum_fuel.bound / DEGREE
    tight = int(np.argmin(bounds))
    coasting, full, bursts = (getattr(minimum_fuel, name)[tight, FUEL] for name in ("coasting", "at_bound", "bursts"))
    between = (1.0 - coasting - full) * minimum_fuel.bank_acceleration.shape[-1]
    return holds(
        measure(f"intervals without thrust, bound {bounds[tight]:g} deg/s^2", 100 * coasting, "%") > 0.0,
        measure("intervals at the bound", 100 * full, "%") > 0.0,
        measure("bursts", bursts) > 1,
        measure("intervals in between, where a burst begins or ends", between) < 2.0 * bursts + 0.5,
        measure("contradiction of the switching function", minimum_fuel.switching_violation.max()) < NEARLY_EXACT,
    )


@claim(
    "Compared on one branch: {beside:.0f} % more fuel; the nominal burns {ratio:.1f} times the least.",
    errata="E6",
    choices="branch",
    counterexample=scaled("minimum_fuel.propellant", at=(0, ENERGY_BESIDE)),
)
def min_energy_fuel_near_min_fuel(minimum_fuel: MinimumFuel):
    # Like with like: least J0 and least fuel on one branch, under every bound.
    wide = int(np.argmax(minimum_fuel.bound))
    fuel = minimum_fuel.propellant
    excess = 100 * (fuel[:, ENERGY_BESIDE] / fuel[:, FUEL] - 1.0)
    bounds = listed(minimum_fuel.bound / DEGREE, "g")
    return holds(
        measure(f"excess of fuel of the least control energy over the least fuel, bounds {bounds} deg/s^2", excess, "%")
        <= 100 * SIMILAR,
        ratio=fuel[wide, ENERGY] / fuel[wide, FUEL],
        beside=excess[wide],
    )


@claim(
    "Rows are chosen for their control energy; beyond the branch's end it is {lowest:.4f} deg^2/s^3.",
    errata="E6 E8",
    choices="branch",
)
def desensitized_j0_larger(rows: Rows):
    return holds(
        measure("control energy of the rows with a weight", rows.effort[1:], "deg^2/s^3")
        > rows.effort[0] * (1.0 + ROUNDING),
        by_construction=rows.circular,
        lowest=rows.tradeoff.path_effort.min(),
    )
