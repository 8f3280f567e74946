"""The flight of one trial by the functions of a model as they are written: the slow, obvious form of `loop`."""

import numpy as np

from marsedl.montecarlo import integrators
from marsedl.montecarlo.ensembles import Trajectories
from marsedl.montecarlo.flights.arithmetic import answer, numpy_numbers, warn
from marsedl.montecarlo.flights.binding import PARTS, Nothing, asked
from marsedl.montecarlo.flights.model import check_start, table_of, width_of
from marsedl.montecarlo.outcomes import COMPLETED, MET_AT_THE_START, NOTHING
from marsedl.montecarlo.streams import normals
from marsedl.stepping import runge_kutta_4
from marsedl.words import described, require


def fly(flight, trial, given):
    """Fly one trial, as `Flight.fly_in_python` says; given: arguments of `Flight.fly` by name."""
    p, schedule, start, vehicle, air = given.p, given.schedule, given.start, given.vehicle, given.air
    memory, nodes, first_trial, increments = given.memory, given.nodes, given.first_trial, given.increments
    earlier = start if isinstance(start, Trajectories) else None
    start = earlier.final_state if earlier else start
    tables = {"air": air, "only": given.only}
    tables = {name: table for name, table in tables.items() if table is not None}
    width = width_of({"start": start, "vehicle": vehicle, **tables}, given.trials)
    require(first_trial <= trial, f"trial {trial} comes before the first one, {first_trial}")
    own = trial - first_trial if width > 1 else 0
    require(own < width, f"trial {trial} is not among the {width} from {first_trial} on")
    parts, noise_class, watch_steps = flight.parts, flight.options["noise"], flight.options["watch_steps"]
    first_state = table_of(start, width)[:, own : own + 1]
    if not earlier:
        check_start(first_state, parts["state"], trial)

    model = _Model(flight, numpy_numbers(p), numpy_numbers(given.law), trial)
    now = model.now
    now["state"] = parts["state"](*first_state[:, 0])
    if hasattr(vehicle, "_fields"):
        now["vehicle"] = type(vehicle)(*table_of(vehicle, width)[:, own])
    now["memory"] = parts["memory"](*map(np.float64, parts["memory"]() if memory is None else memory))
    now["command"] = parts["command"](*[np.float64(0.0)] * len(parts["command"]._fields))
    now["nav"] = parts["nav"](*[np.float64(0.0)] * len(parts["nav"]._fields))
    now["past"] = np.empty(given.past)
    now["air"] = np.empty(nodes) if air is None else np.array(np.asarray(air)[:, own])
    if "vary" in flight.classes:
        now["drawn"] = parts["drawn"](*[np.float64(0.0)] * len(parts["drawn"]._fields))

    def drawn(stream, count):
        only = None if given.only is None else np.asarray(given.only)[:, own : own + 1]
        return normals(given.seed, stream, [trial], count, only)[0]

    if "vary" in flight.classes and air is None:
        for node, normal in zip(reversed(range(nodes)), drawn(given.streams[1], nodes), strict=True):
            now["air"][node], now["drawn"] = model("vary", node=np.int64(node), normal=normal)
    total, size = int(np.sum(schedule.steps)), len(noise_class._fields)
    draws = drawn(given.streams[0], (given.first_increment + total * increments) * size)
    draws = draws[given.first_increment * size :].reshape(total, increments, size)

    draws_class, periods = flight.options["draws"], len(schedule.steps)
    of_navigation = drawn(given.navigation_stream, periods * len(draws_class._fields)).reshape(periods, -1)

    ends, finds_root = "ended" in flight.classes, flight.classes.get("ended") is not bool
    watched = parts["watched"](*map(np.float64, earlier.observed_maximum[:, own] if earlier else parts["watched"]()))
    times = len(schedule.times)
    history = np.full((times, len(parts["stored"]._fields) if given.stored is None else given.stored, 1), np.nan)
    observed = np.full((times, len(parts["observed"]._fields), 1), np.nan)
    bounds, flown, end_time, length = np.append(0, np.cumsum(schedule.steps)), 0, None, times
    now["guided"] = np.float64(0.0)
    met = _met_by(_excess(model, now["state"], schedule.start[0], 0)) if ends else None
    ended_by = NOTHING if met is None else MET_AT_THE_START
    while True:
        over = end_time is not None or flown == total
        cycle = int(np.searchsorted(bounds, flown, side="right")) - 1
        step = schedule.step[min(cycle, len(schedule.step) - 1)]
        substep = flown - bounds[cycle]
        time = schedule.start[cycle] + substep * step if end_time is None else end_time
        now |= {"time": time, "cycle": np.int64(cycle), "half_index": np.int64(2 * flown)}
        now["ending"] = np.float64(1.0 if over else 0.0)
        stores = flown % schedule.every == 0 and not over
        guides = bool(flight.guides) and not over and (substep == 0 or bool(model("interrupts")))
        if stores or guides or over or watch_steps:
            now["found"] = model("look_up")
            now["sensed"] = model("sense")
        if guides and substep == 0:
            now["nav"] = model("navigate", draws=draws_class(*of_navigation[cycle]))
        if guides:
            now["advice"] = model("consult")
            now["share"] = substep / schedule.steps[cycle]
            number = int(model("phase")) if len(flight.guides) > 1 else 0
            now["command"], now["memory"] = model("guide", function=flight.guides[number])
            now["guided"] = np.float64(1.0)
        if "watch" in flight.classes and (guides or (watch_steps and end_time is None)):
            watched = model("watch", watched=watched)
        if stores or (over and schedule.stores_end):
            row = times - 1 if over else flown // schedule.every
            history[row, :, 0] = model("store")[: history.shape[1]]
            observed[row, :, 0] = model("observe")
            now["guided"] = np.float64(0.0)
        if over:
            break
        white = [np.float64(0.0)] * size
        for increment in draws[flown]:
            white = [sum_ + number for sum_, number in zip(white, increment, strict=True)]
        now["noise"] = noise_class(*(number * (np.sqrt(step / increments) / step) for number in white)) if size else ()
        now |= {"before": now["state"], "step": step}
        now["state"] = _advanced(model, flight.options["integrator"], step)
        met = _met_by(_excess(model, now["state"], time + step, 2 * flown + 2)) if ends else None
        if met is not None:
            part = step
            if finds_root:
                tolerance = flight.options["end_tolerance"]
                part, now["state"], met = _to_end(model, now["before"], now["state"], step, tolerance)
            end_time, length = time + part, flown // schedule.every + 1
            ended_by = met if ended_by == NOTHING else ended_by
        flown += 1
    return Trajectories(
        history=history,
        observed=observed,
        observed_maximum=np.reshape(np.array(watched, float), (-1, 1)),
        final_state=np.reshape(np.array(model("finish", watched=watched), float), (-1, 1)),
        outcome=np.full(1, COMPLETED, np.int8),
        length=np.full(1, length, np.int64),
        ended=np.full(1, ended_by, np.int8),
    )


class _Model:
    """Calls functions of a model with what they ask for of `now`."""

    def __init__(self, flight, p, law, trial):
        self.functions, self.parts, self.trial, self.told = flight.functions, flight.parts, trial, set()
        self.now = {"p": p, "law": law} | dict.fromkeys(("vehicle", "noise", "found", "sensed", "advice", "drawn"), ())

    def __call__(self, role, function=None, **changed):
        function = function or self.functions[role]
        if function is None:
            return ()
        offered = self.now | changed
        arguments = [offered[name] for name in asked(function, role)]
        result = answer(function, arguments, self.warn_once)
        if role not in PARTS:
            return result
        kinds = [self.parts[kind] for kind in PARTS[role]]
        check_returned(function, result, kinds)
        parts = result if len(kinds) > 1 else (result,)
        parts = tuple(
            kind(*map(np.float64, part if isinstance(part, tuple) else (part,)))
            for part, kind in zip(parts, kinds, strict=True)
        )
        return parts if len(kinds) > 1 else parts[0]

    def warn_once(self, sentence):
        """Warn of arithmetic that Python refuses, once a place in a flight."""
        if sentence not in self.told:
            self.told.add(sentence)
            warn(sentence, self.now["time"], self.trial)


def check_returned(function, result, kinds):
    """Raise ValueError unless a function returned the numbers of a named tuple, or of several."""
    if [*kinds[1:]] == [Nothing] and isinstance(result, tuple) and len(result) == 2:
        result, kinds = result[0], kinds[:1]  # no memory, of which who wrote a law need not know
    parts = result if len(kinds) > 1 and isinstance(result, tuple) else (result,)
    sizes = [len(part) if isinstance(part, tuple) else 1 for part in parts]
    numbers = [number for part in parts for number in (part if isinstance(part, tuple) else (part,))]
    wrong = sizes != [len(kind._fields) for kind in kinds]
    known = all(isinstance(number, int | float | np.number | np.bool_) for number in numbers)
    if wrong or not known or np.iscomplexobj(numbers):
        wanted = ", ".join(kinds[0]._fields) if len(kinds) == 1 else " and ".join(kind.__name__ for kind in kinds)
        raise ValueError(f"{described(function)} returned {result!r}; it must return {wanted}")


def _slope(model, state, time, half_index):
    at = {"state": state, "time": time, "half_index": half_index}
    return model("rates", **at, found=model("look_up", **at), flown=model("actuate", **at))


def _advanced(model, integrator, step):
    """The state after a step, in the order of sums of `integrators`."""
    state, time, base = (model.now[name] for name in ("state", "time", "half_index"))
    kind = type(state)

    def moved(length, slope):
        return kind(*(x + length * k for x, k in zip(state, slope, strict=True)))

    if integrator is integrators.runge_kutta_4:

        def slope(halves, at):
            return _slope(model, kind(*at), time + 0.5 * step * halves, base + halves)

        return kind(*runge_kutta_4(slope, state, step))
    first = _slope(model, state, time, base)
    if integrator is integrators.euler_maruyama:
        return moved(step, first)
    positions = integrator.positions
    faster = kind(
        *(x if row < positions else new for row, (x, new) in enumerate(zip(state, moved(step, first), strict=True)))
    )
    second = _slope(model, faster, time, base)
    return kind(
        *(new if row < positions else x for row, (x, new) in enumerate(zip(faster, moved(step, second), strict=True)))
    )


def _part_of_step(model, before, part):
    """The state after a part of a Runge-Kutta step, in the order of sums of `loop`'s single lane."""
    time, base, kind = model.now["time"], model.now["half_index"], type(before)
    end, slope = before, (0.0,) * len(before)
    for stage, ahead in enumerate((0.0, 0.5, 0.5, 1.0)):
        place = kind(*(x + ahead * part * k for x, k in zip(before, slope, strict=True)))
        slope = _slope(model, place, time + ahead * part, base + int(2.0 * ahead))
        weight = part / 6.0 if stage in (0, 3) else part / 3.0
        end = kind(*(x + weight * k for x, k in zip(end, slope, strict=True)))
    return end


def _excess(model, state, time, half_index):
    """What `ended` returns at a state."""
    at = {"state": state, "time": time, "half_index": half_index}
    names = asked(model.functions["ended"], "ended")
    if "found" in names or "sensed" in names:
        at["found"] = model("look_up", **at)
    if "sensed" in names:
        at["sensed"] = model("sense", **at)
    return model("ended", **at)


def _least(excess):
    """The least of the numbers that `ended` returned, and which of them it is."""
    numbers = excess if isinstance(excess, tuple) else (excess,)
    least, which = numbers[0], 0
    for row, number in enumerate(numbers):
        least, which = (number, row) if number < least else (least, which)
    return least, which


def _met_by(excess):
    """The number of the end that is reached; None of none."""
    if isinstance(excess, bool | np.bool_):
        return 0 if excess else None
    least, which = _least(excess)
    return which if least <= 0.0 else None


def met_at(flight, p, law, state, vehicle, nodes):
    """The number of the end behind which a state lies, in air without variations; None of none."""
    model = _Model(flight, numpy_numbers(p), numpy_numbers(law), trial=0)
    model.now |= {"vehicle": vehicle, "air": np.zeros(nodes), "time": np.float64(0.0)}
    model.now["command"] = flight.parts["command"](*[np.float64(0.0)] * len(flight.parts["command"]._fields))
    return _met_by(_excess(model, state, 0.0, 0))


def _to_end(model, before, after, step, tolerance):
    """The part of a step after which `ended` is zero, the state there, and the number of the end."""
    part, end = step, after
    time, base = (model.now[name] for name in ("time", "half_index"))
    above, _ = _least(_excess(model, before, time, base))
    below, which = _least(_excess(model, after, time + step, base + 2))
    bracket = (0.0, step, above, below, 0.0)
    if above <= 0.0:
        return 0.0, _part_of_step(model, before, 0.0), which
    for _ in range(integrators.END_ITERATIONS):
        lower, upper, above, below, _ = bracket
        part = (lower * below - upper * above) / (below - above)
        end = _part_of_step(model, before, part)
        excess, which = _least(_excess(model, end, time + part, base + 2))
        if abs(excess) <= tolerance:
            break
        bracket = integrators.narrowed(bracket, part, excess)
    return part, end, which
