"""Fly your own law on your own vehicle: declare both, their errors and a trigger; get labelled flights.

    start = {"altitude_km": 125.0, "velocity": Normal(5500.0, 3.0), "flight_path_angle_deg": -14.2}
    flights = fly(Entry(115.0, 0.24), start, law=1.2, trigger=Below("velocity", 480.0), end_time=420.0)
    flights.percentiles("range_km")

Begin with `help(fly)`, which says what each argument may be, and `help(Flights)`: what may be asked of the result.

    what flies      `Entry`, `Lander`, or a `Model` of your own
    where           `Planet`, `MARS`; air: `Exponential`, `Table`, `Profiles`, `Markov` for its variation, `Wind`
    dispersions     `Normal`, `Uniform`, `MultivariateNormal`, in place of numbers of the start and the vehicle;
                    correlations between both, or `Samples` of your own, as `together=`
    law             a function, a number, or a `GainTable`
    actuator        limits of rate, lag and delay of `Entry` and `Lander`; `Actuator` of a `Model`
    navigation      `Senses` with an `Error` or `ThroughDrag` for what the law knows with errors
    end             `Below`, `Above`, or a function
    result          `Flights`; one flight of them is `OneFlight`
    studies         `compare` and `sweep` for several cases; `Flights.save`, `load`

`fly` is the front door of `montecarlo.flights`, the engine. Nothing is compiled before it is called.
"""

from collections.abc import Mapping

from marsedl.fly.actuators import Actuator
from marsedl.fly.campaign import Campaign
from marsedl.fly.declared import (
    MARS,
    Above,
    Below,
    Exponential,
    Markov,
    MultivariateNormal,
    Normal,
    Planet,
    Table,
    Uniform,
)
from marsedl.fly.flights import Flights, OneFlight
from marsedl.fly.laws import GainTable
from marsedl.fly.own_air import Profiles, Wind
from marsedl.fly.saved import load
from marsedl.fly.senses import Error, Senses, ThroughDrag
from marsedl.fly.sweeps import compare
from marsedl.fly.together import Samples
from marsedl.fly.vehicles import Entry, Lander, Model
from marsedl.words import require

__all__ = [
    "MARS",
    "Above",
    "Actuator",
    "Below",
    "Entry",
    "Error",
    "Exponential",
    "Flights",
    "GainTable",
    "Lander",
    "Markov",
    "Model",
    "MultivariateNormal",
    "Normal",
    "OneFlight",
    "Planet",
    "Profiles",
    "Samples",
    "Senses",
    "Table",
    "ThroughDrag",
    "Uniform",
    "Wind",
    "compare",
    "fly",
    "load",
    "sweep",
]


def fly(
    flies,
    start,
    *,
    together=None,
    law=None,
    senses=None,
    truth=False,
    trigger=None,
    end_time,
    period=1.0,
    substeps=4,
    history=None,
    trials=None,
    seed=0,
    processes=1,
    progress=None,
    compiled=True,
) -> Flights:
    """Fly trials of a vehicle, each with its own start, vehicle, air and noise.

    Trial i is the same to the last bit whether it is flown alone, with others, in threads or in processes, as its
    random numbers are a function of (seed, i). Those of a quantity stay the same whatever else is dispersed.

    The arguments say, in this order, what flies, how it is guided, where it ends, in which steps, and how often.

    Args:
        flies: `Entry`, `Lander`, `Model`, or a `montecarlo.flights.Flight`.
        start: mapping from the names of the state to numbers, `Normal` or `Uniform`; a tuple of names takes a
            `MultivariateNormal`. SI units and radians, or a suffix: `altitude_km`, `flight_path_angle_deg`. Or the
            ends of another phase, `Flights.as_start`.
        together: what start and vehicle draw together, by the names of `flights.drawn` or of the start: a mapping from
            tuples of names, each dispersed by `Normal` or `Uniform`, to correlations,
            {("velocity", "ballistic_coefficient"): 0.6}, of more names a matrix. The correlations are those of the
            standard normals that the numbers are made of, so that each keeps its own distribution; all else keeps its
            numbers. Or `Samples`, whose columns take the place of numbers of start and vehicle.
        law: function that is asked once a period and whose command is held. It asks by name for what it is told, such
            as `velocity` or `range`, for `time`, `nav` or `sensed` (all of it) and `law` (parameters: the argument's
            default, or those of `functools.partial`), and returns the command. One that remembers asks for `memory`,
            too, and is annotated `-> tuple[Command, Memory]`, both NamedTuples. Or a `GainTable`, or a constant.
        senses: `Senses`, errors of what laws are told, in every trial others, and new ones in every guidance period;
            without them laws know the truth under the names that they are told. Results hold what laws knew with errors
            as `nav_<name>`, and the truth under its own name. Noise and walks are those of the same set of quantities
            with errors; constant errors stay when others are added.
        truth: whether the law may ask for the `state` and the `vehicle` of its trial as they are (one with a memory for
            `found`, the air, too); the result says so.
        trigger: `Below` or `Above` for a quantity of the state, one that is sensed, such as the range or the drag, or
            the time; or a function of state, p, time, found, sensed, vehicle (as it asks) annotated to return a float,
            which is positive until the flight ends and whose zero is found, or a bool. Or a mapping from outcomes to
            several of these, {"parachute": Below("velocity", 480.0), "far": Above("range_km", 700.0)}: statistics are
            of the flights that end by the first one. All hold the truth. `Entry` and `Lander` end on the ground, too,
            but for a function that returns a bool. Trials that meet a trigger where they start have the outcome
            "trigger met at the start" and count in no statistics.
        end_time: s, at which flights end that no trigger has ended. Without a trigger all flights count.
        period: of the guidance, s.
        substeps: integration steps in a period.
        history: seconds from one stored state to the next; by default ends alone are stored. Where a flight ends
            between two of them, the row of the later one holds its end.
        trials: how many; by default 1000, or as many as the phase before has.
        seed: of all random numbers, a whole number that is not negative. One of 2**63 and more is hashed
            (`montecarlo.streams.key_of`).
        processes: started by spawn; each flies in its share of the threads. A script then needs
            `if __name__ == "__main__":`.
        progress: whether to show what is compiled and how much is flown; by default in a terminal.
        compiled: False flies a few trials at once as the functions are written, with the same bits, many times slower:
            nothing is compiled, numba is not even imported, `print` and debuggers work in the law.

    Returns:
        `Flights`.

    Raises:
        ValueError: with one sentence on what is wrong: a name, a suffix, a number, a law, a trigger, a trial that draws
            a number with which nothing can fly.
        TypeError: for a function that numba cannot compile.
        KeyboardInterrupt: when it is interrupted, with what may be done. No flight is kept, and no process goes on.
    """
    campaign = Campaign(flies, start, law, trigger, end_time, period, substeps, history, seed, senses, truth, together)
    if trials is None:
        trials = campaign.before.outcome.size if campaign.before else 1000
    return Flights.flown(campaign, trials, processes, progress, compiled)


def sweep(cases, flies, start, *, names, percentiles=(1, 50, 99), confidence=0.95, **options):
    """Fly several cases with common random numbers, and compare them with the first: one table.

    Args:
        cases: mapping from the name of each case, a word or a number, to the arguments of `fly` by which it differs:
            {"slow": {"law": partial(guide, law=Gains(0.1))}, "heavy": {"flies": Entry(140.0, 0.24)}}.
        flies, start, options: arguments of `fly` that all cases share.
        names, percentiles, confidence: what is compared, as of `compare`.

    Returns:
        Data frame of `compare`. To keep the flights, fly them, and give them to `compare`.

    Raises:
        ValueError: as `fly` and `compare`, naming the case; for a case with a seed or a number of trials of its own.
    """
    require(isinstance(cases, Mapping) and cases, "cases: give a mapping from names to arguments of fly, at least one")
    given, flown = {"flies": flies, "start": start} | options, {}
    for name, case in cases.items():
        require(isinstance(case, Mapping), f"case {name!r}: give a mapping from arguments of fly to what they are")
        own = sorted({"seed", "trials"} & {*case})
        require(not own, f"case {name!r} has {' and '.join(own)} of its own: give them once, as all cases are pairs")
        try:
            flown[name] = fly(**given | case)
        except ValueError as error:
            raise ValueError(f"case {name!r}: {error}") from error
    return compare(flown, names, percentiles, confidence)
