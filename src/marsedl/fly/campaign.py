"""Flights as they are declared, checked and bound, and the flying of any of their trials."""

import pickle
import signal
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import active_children, get_context
from pathlib import Path
from traceback import walk_stack

import numpy as np

from marsedl.fly import actuators, laws
from marsedl.fly.declared import is_number, require_numbers
from marsedl.fly.phases import STREAMS, PhaseBefore
from marsedl.fly.senses import Bound, Senses
from marsedl.fly.together import Together, bound
from marsedl.fly.vehicles import Model
from marsedl.montecarlo.flights import periods
from marsedl.montecarlo.flights.binding import check_parameters, digest
from marsedl.montecarlo.outcomes import MET_AT_THE_START
from marsedl.montecarlo.streams import key_of
from marsedl.words import require

# Streams of random numbers of the first phase; `own_air` has more.
START, NOISE, AIR, VEHICLE, NAVIGATION, SENSES = range(6)
CHUNK = 16_384  # trials between two looks at the clock; a multiple of the group of trials
CHUNK_OF_OWN_AIR = 4_096  # as columns of air are made for a whole chunk
OUT_OF_TIME, NOT_FINITE, AT_ONCE = "out of time", "not finite", "trigger met at the start"


class Campaign:
    """What is flown. Arguments and errors are those of `fly`."""

    recorded = None  # what was drawn, of flights that are read without their law; see `saved`

    def __init__(
        self,
        flies,
        start,
        law,
        trigger,
        end_time,
        period,
        substeps,
        history,
        seed,
        senses=None,
        truth=False,
        together=None,
    ):
        """Check all of it, and bind it to the model; nothing is compiled."""
        self.declared = (flies, start, law, trigger, end_time, period, substeps, history, seed, senses, truth, together)
        require(
            hasattr(flies, "model") or type(flies).__name__ == "Flight",
            f"{flies!r} does not fly: give Entry(...), Lander(...), Model(...) or a Flight",
        )
        self.model = model = flies.model() if hasattr(flies, "model") else Model(flies)
        whole = is_number(substeps) and substeps >= 1 and substeps == int(substeps)
        checks = {
            f"end_time is {end_time!r} s; it must be positive": is_number(end_time) and end_time > 0.0,
            f"period is {period!r} s; it must be positive": is_number(period) and period > 0.0,
            f"history is {history!r}; give the seconds from one stored state to the next, or None": (
                history is None or is_number(history)
            ),
            f"seed is {seed!r}; give a whole number that is not negative": isinstance(seed, int | np.integer)
            and seed >= 0,
            f"substeps is {substeps!r}; give the integration steps in a guidance period, at least 1": whole,
            f"truth is {truth!r}; give True or False": isinstance(truth, bool),
        }
        for sentence, good in checks.items():
            require(good, sentence)
        self.end_time, self.period, self.substeps, self.history = end_time, period, substeps, history
        self.seed = key_of(seed)
        self.only = None  # normal of each trial that is not zero: all are drawn
        self.before = start if isinstance(start, PhaseBefore) else None
        self.phase = self.before.phase if self.before else 0
        if self.before:
            require(together is None, "together: give it in the first phase, as what it draws goes on into this one")
            self.together = Together(self.before.declared(model), model.declared_vehicle(), ())
        else:
            self.together = bound(together, model, start)
        self.start, self.vehicle = self.together.start, self.together.vehicle
        nominal = dict(zip(self.start.names, self.start.means, strict=True))
        self.law = laws.bind(law, model.flight, nominal, model.units, truth)
        self.truth = self._truth_told()
        self.senses = self._bound(senses)
        self.actuators = self._bound_actuators()
        self.ends = laws.ends_of(trigger, model, nominal)
        self.p = model.complete(model.p, nominal) if model.complete else model.p
        for what, parts in (("p", self.p), ("law", self.law.parameters)):
            require_numbers(parts, what)
            check_parameters(parts, what)
        added = {"ends": self.ends.data, "senses": self.senses.numbers, "actuators": self.actuators.numbers}
        for name, numbers in added.items():
            if numbers:
                self.p = laws.extended(type(self.p), name)(*self.p, numbers)
        self.schedule(history)
        self.reached = self._reached()
        met = None
        with suppress(ArithmeticError, LookupError, ValueError):  # of numbers that no trial may have
            met = self._met_by_the_mean_start()
        require(
            met is None,
            f"{self.ends.names[met or 0].removeprefix('ended: ')}: this trigger is met at the start; one that returns "
            f"a number is positive until the flight ends, one that returns a bool False",
        )

    def _met_by_the_mean_start(self):
        """The number of the end that is met where the mean flight starts, or None."""
        from marsedl.montecarlo.flights.in_python import met_at

        flight = self.flight()
        if flight.functions["ended"] is None:
            return None
        state = self.model.flight.parts["state"](*self.start.means)
        vehicle = self.vehicle_of((*self.vehicle.means, *[0.0] * len(self.senses.constants)))
        return met_at(flight, self.p, self.law.parameters, state, vehicle, self.model.nodes)

    def _bound(self, senses):
        """Senses, checked, as a flight takes them."""
        flight = self.model.flight
        if senses is None:
            return Bound((), None, (), ())
        require(isinstance(senses, Senses), f"senses is {senses!r}; give Senses(altitude=Error(noise=20.0))")
        require(
            not flight.guides and "navigate" not in flight.classes,
            "senses: the model has guidance or navigation of its own; disperse what these read",
        )
        told = laws.told_by(flight)._fields
        return senses.bound(told, self.model.units(told), self.period)

    def _bound_actuators(self):
        """Actuators of the vehicle, checked, as a flight takes them."""
        model = self.model
        if not model.actuators:
            return actuators.Bound()
        require(
            not model.flight.guides,
            "actuators: the model has guidance of its own; let its rates follow the command, or bind it without guide",
        )
        vehicle, pace = self.vehicle.names, (self.period, int(self.substeps), self.end_time)
        command = laws.command_of(model.flight)
        return actuators.bound(model.actuators, model.coordinates, command, vehicle, model.units, pace)

    @property
    def commands(self):
        """Names under which histories hold what the law commands, by what it commands."""
        if self.actuators.kinds:
            return {name: f"commanded_{name}" for name in laws.command_of(self.model.flight)._fields}
        return {name: name for name in self.flight().parts["command"]._fields}

    def _truth_told(self):
        """What the law is told of the truth, by name."""
        return tuple(name for name in laws.TRUTH if len(self.law.kind) == 3 and name in self.law.kind[2])

    def vehicle_of(self, numbers):
        """The vehicle that functions of the model ask for: a NamedTuple of these rows, or nothing."""
        kind = type(self.model.vehicle)
        kind = laws.extended(kind, *self.senses.constants) if self.senses.constants else kind
        return kind(*numbers) if len(numbers) else ()

    def __reduce__(self):
        """Pickle what was declared, which another process binds again, and the digest of all that it reaches."""
        return Campaign, self.declared, {"reached": self.reached}

    def _reached(self):
        own = self.model.air.sample(self.seed, range(1), self.stream(0)) if self.model.air else ()
        return digest(*self.flight().reached(), self.p, self.law.parameters, own)

    def flight(self):
        """The `Flight` with law, trigger, senses and actuators."""
        kinds = (self.law.kind, self.ends.kind, self.senses.kinds, self.actuators.kind)
        return laws.completed(self.model.flight, *kinds)

    def schedule(self, every=None):
        """Guidance periods; stored are the states at the start and the end, or every so many seconds."""
        schedule = periods(self.end_time, self.period, self.substeps)
        if every is None:
            return schedule._replace(every=int(schedule.steps.sum()))
        steps = every * self.substeps / self.period
        require(
            steps >= 1.0 and abs(steps - round(steps)) < 1e-9 * steps,
            f"history every {every:g} s is no multiple of the integration step, {self.period / self.substeps:g} s",
        )
        return schedule._replace(every=round(steps))

    def perturbed(self, only):
        """These flights with one normal that is not zero in each trial: its stream, number and value, (3, trials)."""
        return self._with(only=only, history=None)

    def _with(self, **changed):
        """The same flights but for these attributes; nothing is bound again."""
        other = object.__new__(Campaign)
        vars(other).update(vars(self), **changed)
        return other

    def _only(self, trials):
        """The normals of these trials that are not zero, or None if all are drawn."""
        return None if self.only is None else self.only[:, trials]

    def drawn(self, trials):
        """Start, and vehicle with constant errors of its senses, of these trials, each (numbers, trials).

        Raises ValueError for numbers beyond their bounds.
        """
        if self.before:
            self.before.require_flown(trials)
        only, streams = self._only(trials), (self.stream(START), self.stream(VEHICLE))
        start, vehicle = self.together.sample(self.seed, streams, trials, self.model.bounds, only)
        if self.senses.constants:
            vehicle = np.concatenate([vehicle, self.senses.sample(self.seed, self.stream(SENSES), trials, only)])
        return start, vehicle

    def stream(self, number):
        """Stream of random numbers: phases have others, so that what they draw is independent."""
        return number + STREAMS * self.phase

    def fly(self, trials, every, in_python=False, whole=True):
        """`Trajectories` of consecutive trials, of one alone if in Python; whole, or of the first period.

        Raises ValueError if the law or the model reads other numbers than when it was declared.
        """
        require(
            self._reached() == self.reached,
            "the law or the model reads other numbers than when these flights were declared: call fly again; "
            "processes do not see what a script sets below `if __name__`: set that above, or give it as law=",
        )
        state, (start, vehicle) = self.model.flight.parts["state"], self.drawn(trials)
        schedule = self.schedule(every) if whole else self.schedule(every).first_period()
        arguments = (self.p, schedule, state(*start))
        only, air = self._only(trials), self.model.air
        options = {
            "vehicle": self.vehicle_of(vehicle),
            "law": self.law.parameters,
            "nodes": self.model.nodes,
            "air": air.sample(self.seed, trials, self.stream(0), only) if air else None,
            "seed": self.seed,
            "first_trial": trials[0],
            "streams": (self.stream(NOISE), self.stream(AIR)),
            "navigation_stream": self.stream(NAVIGATION),
            "only": only,
        }
        if in_python:
            return self.flight().fly_in_python(*arguments, trial=trials[0], **options)
        return self.flight().fly(*arguments, **options)

    def look_at_first_trial(self, trial, compiles, progress):
        """Fly a trial's first period in Python, then compiled, to the flight's end if it begins with an angle of zero:
        refuse a law that returns no command, or is another law compiled, or whose first angle that is not zero is in
        degrees. Warns of commands that are not finite. Says if the flight has to be compiled.
        """
        self.flight().renew()
        names, shown = [*self.commands], self.flight().parts["stored"]._fields
        if not names or not {*self.commands.values()} <= {*shown}:
            return

        def commanded(campaign, in_python, whole):
            """One row of commands a period."""
            with np.errstate(all="ignore"):
                flown = campaign.fly(range(trial, trial + 1), campaign.period, in_python, whole)
            stored = campaign.flight().parts["stored"]._fields
            rows = [stored.index(name) for name in campaign.commands.values()]
            return flown.history[: flown.length[0], rows, 0]

        def said_of(numbers, period=0):
            """Of a period's commands; refuses degrees."""
            when = f"after {period * self.period:g} s" if period else "at the start"
            sentence = f"the law commands {', '.join(map('{:g}'.format, numbers))} {when} of trial {trial}"
            laws.check_angles(sentence, names, numbers, self.model.units)
            return sentence

        python = commanded(self._without_actuators(), in_python=True, whole=False)[0]
        said = said_of(python)
        if not np.isfinite(python).all():
            warnings.warn(f"{said}: {', '.join(names)} must be finite", stacklevel=5)
        if not compiles:
            return
        with _told_of_compiling(progress):
            units = self.model.units(names).values()
            waits = any(unit == "rad" and angle == 0.0 for unit, angle in zip(units, python, strict=True))
            compiled = commanded(self, in_python=False, whole=waits)
        require(
            np.allclose(compiled[0], python, rtol=1e-3, atol=1e-9, equal_nan=True),
            f"{said} in Python, compiled {', '.join(map('{:g}'.format, compiled[0]))}: compiled integers have 64 "
            f"bits, and what lies beyond is another number; write floats, such as 2.0",
        )
        for number in range(len(names)):
            periods = np.flatnonzero(compiled[:, number])
            if periods.size:
                said_of(compiled[periods[0]], periods[0])

    def _without_actuators(self):
        """The same flights without actuators, if they store the command: there what a law returns is looked at."""
        if not self.actuators.kinds:
            return self
        plain = self._with(actuators=actuators.Bound())
        if not {*plain.commands} <= {*plain.flight().parts["stored"]._fields}:
            return self
        plain.reached = plain._reached()
        return plain

    def outcomes(self, flown):
        """Outcome of every trial that was flown, by name."""
        finite = np.isfinite(flown.final_state).all(axis=0)
        unended = OUT_OF_TIME if self.ends.aims else "completed"
        outcome = np.array([*self.ends.names, AT_ONCE, unended], object)[flown.ended]  # -2 and -1 count from the end
        for name, failed in self.failures(flown.final_state).items():
            outcome[failed] = name
        outcome[flown.ended == MET_AT_THE_START] = AT_ONCE
        outcome[~finite] = NOT_FINITE
        return outcome.astype(str)

    def counts(self, outcome):
        """Which of these outcomes count in statistics: the first end; of flights that aim at none any end."""
        return np.isin(outcome, self.ends.names[:1] if self.ends.aims else [*self.ends.names, "completed"])

    def failures(self, numbers):
        """Which flights of these final numbers failed in a way that the model names, by its name."""
        return self.model.failed(self.p, self.final(numbers)) if self.model.failed else {}

    def final(self, numbers):
        """Final numbers by name."""
        return dict(zip(self.flight().parts["final"]._fields, numbers, strict=True))

    def reduced(self, trials, in_python=False):
        """Final numbers, outcomes and histories (up to the end, then NaN; or None) of consecutive trials, or of one."""
        flown = self.fly(trials, self.history, in_python)
        history = None if self.history is None else flown.with_ends().history
        final, outcome = flown.final_state, self.outcomes(flown)
        if self.before:
            outcome = self.before.outcomes(trials, outcome)
            never = ~self.before.goes_on[trials]
            for numbers in (final, history) if history is not None else (final,):
                numbers[..., never] = np.nan
        return final, outcome, history

    def fly_all(self, first, last, processes, progress, compiled=True):
        """As `reduced`, of the trials first .. last - 1, in chunks; says how many are flown if that takes long."""
        require(compiled or processes == 1, "flights in Python (compiled=False) take no processes: leave one out")
        pickled = _for_processes(self) if processes > 1 else None
        largest = CHUNK_OF_OWN_AIR if self.model.air else CHUNK
        size = min(largest, -(-(last - first) // processes)) if compiled else 1
        chunks = [range(low, min(low + size, last)) for low in range(first, last, size)]
        for chunk in chunks:
            self.drawn(chunk)  # refuses what cannot fly before anything flies
        self.look_at_first_trial(first, compiled, progress)
        if processes == 1:
            flown = (self.reduced(chunk, not compiled) for chunk in chunks)
            parts = _told(flown, last - first, progress)
        else:
            jobs = [(pickled, chunk, processes) for chunk in chunks]
            with _pool(processes) as pool:
                parts = _told(pool.map(_fly_chunk, jobs), last - first, progress)
        final, outcome, history = zip(*parts, strict=True)
        whole = None if history[0] is None else np.concatenate(history, axis=-1)
        return np.concatenate(final, axis=-1), np.concatenate(outcome), whole


@contextmanager
def _pool(processes):
    """A pool of processes, none of which outlives an error or an interruption of what is done with it."""
    others = {*active_children()}
    pool = ProcessPoolExecutor(processes, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN))
    try:
        yield pool
    except BaseException:
        for worker in {*active_children()} - others:
            worker.terminate()
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def _told_of_compiling(shown):
    """On the error stream a line says what is waited for, if a vehicle's flight is compiled."""
    from numba.core import event

    class Announcement(event.Listener):
        def on_start(self, event):
            if event.data["dispatcher"].py_func.__name__.startswith("fly_") and _is_shown(shown):
                print(
                    "compiling the flight of this vehicle, about a quarter of a minute; other laws share it, and later "
                    "runs load it",
                    file=sys.stderr,
                    flush=True,
                )

        def on_end(self, event):
            pass

    with event.install_listener("numba:compile", Announcement()):
        yield


def _is_shown(shown):
    """Whether lines about progress are written: as is said, or in a terminal."""
    return sys.stderr.isatty() if shown is None else shown


def _fly_chunk(job):
    """One chunk in a process of a pool, with its share of the threads."""
    import numba

    pickled, trials, processes = job
    try:
        campaign = pickle.loads(pickled)
    except AttributeError as error:
        raise ValueError(f"{error}: processes import the script; define the law above `if __name__`") from None
    numba.set_num_threads(max(1, numba.get_num_threads() // processes))
    return campaign.reduced(trials)


def _for_processes(campaign):
    """The pickled campaign. Raises ValueError where processes, which import the program again, cannot fly it."""
    main, remedy = sys.modules["__main__"], "or leave processes out"
    name, path = getattr(main.__spec__, "name", None), getattr(main, "__file__", None)
    imported = not f".{name}".endswith(".__main__") if name else path is not None
    try:
        pickled = pickle.dumps(campaign)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(f"processes: {error}; define it at the top of a file, {remedy}") from None
    require(
        imported or b"__main__" not in pickled,
        f"processes cannot import what a notebook defines: put the law into a file, {remedy}",
    )
    require(
        not imported or Path(path).is_file(), f"processes cannot import {path}: write the program to a file, {remedy}"
    )
    require(
        not imported or _is_guarded(main),
        f"processes import {path} again: call fly below `if __name__ == '__main__':`, {remedy}",
    )
    return pickled


def _is_guarded(main):
    """Whether the line of the script that runs now stands below one that begins `if __name__`."""
    lines = Path(main.__file__).read_bytes().splitlines()
    frames = [frame for frame, _ in walk_stack(None) if frame.f_globals is vars(main)]
    running = [frame.f_lineno for frame in frames if frame.f_code.co_name == "<module>"]
    return all(any(line.startswith(b"if __name__") for line in lines[:number]) for number in running)


def _told(parts, total, shown):
    """List of the parts; after two seconds, a line on the error stream counts their flights."""
    began, done, flown, written = time.monotonic(), [], 0, False
    for part in parts:
        done.append(part)
        flown, passed = flown + part[1].size, time.monotonic() - began
        if passed > 2.0 and _is_shown(shown):
            left = passed / flown * (total - flown)
            print(f"\r{flown:,} of {total:,} flights, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
            written = True
    if written:
        print(file=sys.stderr)
    return done
