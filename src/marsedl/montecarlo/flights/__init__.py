"""One engine for flights: a model is a few plain functions of numbers, for one trial, that ask for what they need.

`Flight` binds the functions of a model; only `rates` has to be there. Each asks for its arguments by name, as fixtures
do in pytest, and its annotation tells the parts of the flight, which are NamedTuples of numbers:

    rates(...) -> State                         how the state changes
    actuate(time, command, p) -> Flown          what is flown of the command, as `rates` gets it at each of its times
    look_up(state, air, p) -> Found             tables that are read at a state; scalar code, kept apart
    vary(node, normal, drawn, p) -> tuple[float, Drawn]   the trial's own air, node by node from the last one down
    sense(state, found, ...) -> Sensed          what guidance and storage are told
    navigate(sensed, nav, draws, ...) -> Nav   once a guidance period: what is known of the flight, with errors
    consult(sensed, law, ...) -> Advice         the law's own tables; scalar code, kept apart
    guide(time, sensed, memory, law, ...) -> tuple[Command, Memory]   once a guidance period; the command is held
    phase(sensed, memory, ...) -> int           which of several functions guide steers the trial
    interrupts(state, memory, ...) -> bool      whether guide is due at a step within a period, too
    ended(state, p) -> float, Ends or bool      a number: its zero is found; several: the first; a truth: after a step
    watch(watched, ...) -> Watched              a fold, such as a maximum or a count; starts with its class's defaults
    store, observe (...) -> tuple               what is stored of a flight over time
    finish(time, ...) -> Final                  what is stored of its end

What they may ask for: state, flown, found, sensed, nav, advice, command (which guide gets as it returned it at last, at
first zeros), memory, drawn, watched (the parts above); time (s), cycle (number of the guidance period), half_index (2 x
number of the step, and 1 more in its middle); p, law (parameters) and vehicle (of the trial); step (of the integration,
s) and before (the state where it began); noise (of Brownian motion, increment / step); draws (independent standard
normals of navigation, new in every period); air (column of the trial, (nodes,)), node, normal; share (of the period
that has passed: 0 but for interrupts), past (numbers that guide may write to); guided (1.0 if guide was asked since the
last stored state), ending (1.0 at the end of the schedule). `OFFERED` says which role may ask for which.

The state and the vehicle are the truth, and so is `sensed` unless a model's `sense` says otherwise. `nav` is what
navigation made of it: all zeros before the first period, then what `navigate` returned at last, also between the
periods and at a trial's end.

All but `look_up` and `consult` should choose by `a if condition else b`, without loops over tables: then the loops over
trials become vector code. They may call plain functions of yours, and those of `marsedl.elementary`, whose `select`
and `clip` CasADi traces, too. `Flight.fly` flies compiled, `Flight.fly_in_python` one trial by the functions as they
are written, bit for bit the same.
"""

from marsedl.montecarlo.flights.binding import OFFERED, Nothing
from marsedl.montecarlo.flights.model import Flight, Schedule, periods

__all__ = ["OFFERED", "Flight", "Nothing", "Schedule", "periods"]
