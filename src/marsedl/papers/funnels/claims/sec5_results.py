"""Sec. 5: Fig. 3, and what a funnel costs."""

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import SPHERES
from marsedl.papers.funnels.claims.measures import complete, on_slices, over_flown, peaks
from marsedl.papers.funnels.inputs import Planet, Recursion, Vehicle
from marsedl.papers.funnels.records import FlightEnsemble, Funnel, Linearization
from marsedl.replication.claims.counterexamples import in_reading, replaced, scaled
from marsedl.replication.claims.thresholds import MUCH, ROUNDING
from marsedl.replication.claims.writing import check, claim, holds, measure, whichever
from marsedl.replication.claims.writing import measured as result
from marsedl.replication.units import DEGREE

STANDARD_GRAVITY = 9.80665  # m/s^2
CONFIDENCE = 0.95  # of the bound of a probability
MINUTE = 60.0
BEGINNING = 0.5  # share of the flight: "at the beginning" is before its middle
END = 0.1  # share of the flight: "near the end"


@claim(
    "The probability to leave is then below {bound:.2g} %, with {confidence:g} % confidence.",
    errata="E20",
    counterexample=replaced("constant.outside_at_slices", 1),
)
def mc_inside_funnel(recursion: Recursion, funnel: Funnel, constant: FlightEnsemble):
    trials = len(constant.outcome)
    return holds(
        complete(funnel),
        on_slices(recursion, funnel),
        measure(f"flights of {trials:,} outside at a slice under constant disturbance", constant.outside_at_slices) < 1,
        measure("flights that are lost", constant.excluded) < 1,
        f"largest V/rho {constant.largest_ratio:.4g}",
        ratio=constant.largest_ratio,
        trials=trials,
        bound=-100.0 * np.log(1.0 - CONFIDENCE) / trials,  # of the probability to leave, if none of them does
        confidence=100.0 * CONFIDENCE,
    )


@claim("Both levels start from rho_1.", errata="E20", counterexample=scaled("constant.maximum_over_trials"))
def sos_above_mc(recursion: Recursion, funnel: Funnel, constant: FlightEnsemble):
    # Of the curves of these flights, as in the figure: what other flights would reach is not asked.
    ratio = over_flown(funnel, constant)
    return holds(
        on_slices(recursion, funnel),
        measure(f"rho over the largest V of {len(constant.outcome)} flights after the first slice", ratio) >= 1.0,
    )


@claim(
    "Slices of least trace (`minkowski_shape`) have their first peak at {minkowski_shape.time:.0f} s.",
    choices="shape initial_set density_amplitude",
    counterexample=in_reading("minkowski_shape"),
)
def first_peak(recursion: Recursion, linearization: Linearization, funnel: Funnel):
    time, duration = funnel.time, funnel.time[-1]
    maxima = time[peaks(funnel.level)]
    first = maxima[0] if maxima.size else np.nan
    pulse = linearization.half_time[linearization.deceleration.argmax()]
    return holds(
        on_slices(recursion, funnel),
        measure("first local maximum of rho", first, "s") <= BEGINNING * duration
        if maxima.size
        else check("rho has a local maximum before the end", False),
        f"deceleration is largest at {pulse:.0f} s",
        time=first,
    )


@claim(
    """With more weight at the end (`terminal_weight`), rho grows from {terminal_weight.before:.1f} to
    {terminal_weight.last:.1f}.""",
    choices="terminal_weight scale_lengths scale_bank shape",
    counterexample=in_reading("terminal_weight"),
)
def end_expansion(funnel: Funnel):
    late = (1.0 - END) * funnel.time[-1]
    before = np.interp(late, funnel.time, funnel.level)
    return holds(
        measure(f"rho at the end, {100 * END:g} % of the time after it was {before:.4g}", funnel.level[-1])
        > before * (1.0 + ROUNDING),
        before=before,
        last=funnel.level[-1],
    )


@claim(
    "The velocity changes in direction: near the end, the flight path turns at {turn_end:.2f} deg/s.",
    choices="entry_angle final_downrange",
    counterexample=scaled("vehicle.lift_to_drag"),
)
def end_high_velocity_changes(planet: Planet, vehicle: Vehicle, linearization: Linearization):
    # Sec. 4 has the velocity vector by magnitude, flight path angle and heading: either may change fast.
    motion = environment.entry_rates(planet, vehicle, environment.undisturbed_air(planet))
    rates = np.array(np.broadcast_arrays(*motion(None, linearization.state.T, (linearization.bank,), (0.0, 0.0))))
    late = linearization.half_time >= (1.0 - END) * linearization.half_time[-1]
    (end, most), (turn_end, turn_most) = (
        (np.abs(rate[late]).max() / unit, np.abs(rate[~late]).max() / unit)
        for rate, unit in ((rates[3], STANDARD_GRAVITY), (rates[4], DEGREE))
    )
    within = f"in the last {100 * END:g} % of the time"
    return holds(
        whichever(
            measure(f"largest rate of the velocity {within}", end, "g") > most,
            measure(f"largest rate of the flight path angle {within}", turn_end, "deg/s") > turn_most,
        ),
        turn_end=turn_end,
    )


MEASUREMENTS = "by the committed measurements of one machine, which no build makes again"

BY_SAMPLES = "whole funnel by samples, rank-one"
BY_COEFFICIENTS = tuple(f"whole funnel by coefficients, {solver}" for solver in ("Clarabel", "SCS"))
SAME_SOLVER = "speed of coefficients over samples, Clarabel, a stage"
OVER_FLIGHTS = "cost of the funnel over 10,000 flights"
MINUTE_OVER_FLIGHTS = "cost of the paper's minute over 10,000 flights"


def _rows(measured_costs, *names):
    """What was measured, by its names, and a sentence on what was not."""
    missing = [name for name in names if name not in measured_costs]
    values = [measured_costs.get(name, np.nan) for name in names]
    return values, [f"not measured: {'; '.join(missing)}"] if missing else []


@claim("On one core it takes {seconds:.0f} s.", errata="E25")
def funnel_run_time(measured: dict[str, float] | None = None):
    (seconds,), missing = _rows(measured or {}, BY_SAMPLES)
    evidence = [f"{seconds:.3g} s on one core, integrated motion, {MEASUREMENTS}", *missing]
    return result(seconds / MINUTE, evidence=evidence, seconds=seconds)


@claim("Our entry has {variables} variables; a whole funnel by multipliers takes {cheapest:.0f} s.", errata="E25")
def multiplier_dimension_limit(measured: dict[str, float] | None = None):
    multipliers, missing = _rows(measured or {}, *BY_COEFFICIENTS)
    variables, cheapest, evidence = SPHERES.variables, np.min(multipliers), [MEASUREMENTS, *missing]
    return result(variables, evidence=evidence, variables=variables, cheapest=cheapest)


@claim(
    "The whole funnel by multipliers takes {cheapest:.0f} s; the paper takes a minute by samples.",
    errata="E25",
    counterexample=scaled(f"measured.{BY_COEFFICIENTS[1]}"),
)
def multiplier_prohibitive(measured: dict[str, float] | None = None):
    multipliers, missing = _rows(measured or {}, *BY_COEFFICIENTS)
    cheapest = np.min(multipliers)
    # What is prohibitive takes longer than what is not: the minute of the paper.
    return holds(
        measure("whole funnel by multipliers with the faster solver", cheapest, "s") > MINUTE,
        MEASUREMENTS,
        *missing,
        cheapest=cheapest,
    )


@claim(
    "A solver made for samples is {factor:.1f} times as fast as multipliers.",
    errata="E25",
    counterexample=scaled(f"measured.{BY_SAMPLES}"),
)
def sampling_reduces_cost(measured: dict[str, float] | None = None):
    (samples, same_solver, *multipliers), missing = _rows(measured or {}, BY_SAMPLES, SAME_SOLVER, *BY_COEFFICIENTS)
    cheapest = np.min(multipliers)
    return holds(
        measure("whole funnel by samples, with a solver that uses their structure", samples, "s") < cheapest * MUCH,
        f"with one solver for both a stage by samples takes {same_solver:.3g} times as long; {MEASUREMENTS}",
        *missing,
        factor=cheapest / samples,
    )


@claim(
    "It costs {cost:.1f} times as much as the paper's number of flights in array code.",
    errata="E25",
    counterexample=scaled(f"measured.{OVER_FLIGHTS}"),
)
def cheaper_than_monte_carlo(measured: dict[str, float] | None = None):
    (cost, minute), missing = _rows(measured or {}, OVER_FLIGHTS, MINUTE_OVER_FLIGHTS)
    return holds(
        measure("cost of the funnel over 10,000 flights", cost) < MUCH,
        f"a minute would be {minute:.3g} times their cost; {MEASUREMENTS}",
        *missing,
        cost=cost,
    )
