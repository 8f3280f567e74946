"""A model of a flight, bound once, and the flights of it."""

import inspect
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from marsedl.montecarlo.flights.binding import (
    OFFERED,
    PARTS,
    Nothing,
    asked,
    digest,
    named_kernel,
    renew_helpers,
    returned,
)
from marsedl.montecarlo.integrators import runge_kutta_4
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.summaries import summary
from marsedl.words import described, require

_COMPILED = {}  # kernels, and laws that are compiled alone, by their names
NOISE_STREAM, AIR_STREAM, NAVIGATION_STREAM = 1, 2, 4  # of random numbers; 0 is the initial state's, 3 the vehicle's


class Schedule(NamedTuple):
    """Guidance periods, each of some integration steps of equal length, and which states are stored."""

    start: np.ndarray  # (periods + 1,), s, the end included
    step: np.ndarray  # (periods,), s, of the integration
    steps: np.ndarray  # (periods,), integration steps
    every: int  # integration steps from one stored state to the next
    stores_end: bool = True  # whether the last row of the history is the end of the schedule

    __repr__ = summary

    @property
    def times(self) -> np.ndarray:
        """Times of the stored states, s."""
        first = np.concatenate([[0], np.cumsum(self.steps)])
        stored = np.arange(0, first[-1], self.every)
        period = np.searchsorted(first, stored, side="right") - 1
        times = self.start[period] + (stored - first[period]) * self.step[period]
        return np.append(times, self.start[-1]) if self.stores_end else times

    def first_period(self) -> "Schedule":
        """The first guidance period alone."""
        return self._replace(start=self.start[:2], step=self.step[:1], steps=self.steps[:1])


def periods(end_time, period, steps, *, every=None, stores_end=True, cut=True) -> Schedule:
    """Equal guidance periods up to an end time.

    Args:
        end_time: s. period: of the guidance, s. steps: integration steps in each.
        every: steps from one stored state to the next; by default a period's.
        stores_end: whether the end is stored, too.
        cut: whether the last period ends at the end time, or is as long as the others.

    """
    require(end_time > 0 and period > 0, f"end_time and period must be positive, got {end_time} and {period}")
    for name, value in (("steps", steps), ("every", every or 1)):
        require(value == int(value) and value >= 1, f"{name} must be a whole number from 1 on, got {value}")
    start = np.arange(int(np.ceil(end_time / period - 1e-9))) * float(period)
    lengths = np.minimum(period, end_time - start) if cut else np.full(len(start), float(period))
    return Schedule(
        np.append(start, end_time), lengths / steps, np.full(len(start), int(steps)), int(every or steps), stores_end
    )


class Flight:
    """The functions of a model, and the compiled flight of them; see the package for what they are asked and return."""

    def __init__(
        self,
        rates,
        *,
        actuate=None,
        look_up=None,
        sense=None,
        navigate=None,
        consult=None,
        phase=None,
        guide=None,
        interrupts=None,
        ended=None,
        vary=None,
        store=None,
        observe=None,
        watch=None,
        finish=None,
        integrator=runge_kutta_4,
        noise=Nothing,
        draws=Nothing,
        end_tolerance=1e-11,
        watch_steps=None,
    ):
        """Bind the functions of a model; nothing is compiled before the first flight.

        Args:
            rates, look_up, sense, navigate, consult, phase, interrupts, ended, vary, store, observe, watch, finish:
                functions.
            guide: a function, or one for each phase of the guidance, whose number `phase` returns.
            integrator: one of `integrators`.
            noise: NamedTuple that `rates` gets as `noise`, white, one number a component.
            draws: NamedTuple that `navigate` gets as `draws`, independent standard normals, new in every period.
            end_tolerance: by which the number that `ended` returns may miss zero at the end of a flight.
            watch_steps: whether `watch` is asked at every step and at the end; by default it is without guidance.

        Raises:
            ValueError: for a function that asks for what it is not offered, or is not annotated with what it returns.

        """
        given = locals()
        self.functions = {role: given[role] for role in OFFERED if role != "guide"}
        self.guides = tuple(guide) if isinstance(guide, tuple | list) else (guide,) if guide else ()
        kinds = {role: returned(function, role) for role, function in self.functions.items() if function}
        guided = [returned(function, "guide") for function in self.guides]
        for role, function in (*self.functions.items(), *(("guide", function) for function in self.guides)):
            if function:
                asked(function, role)
        self.classes = {role: kind[0] for role, kind in kinds.items()}
        state = self.classes["rates"]
        require(
            len(self.guides) < 2 or phase,
            "a flight with several functions guide needs phase, which returns the number of one",
        )
        require(len({*guided}) < 2, f"all functions guide must return the same two classes, got {guided}")
        require(
            guide or not interrupts,
            "interrupts is asked whether guidance is due within a period; this flight has no guide",
        )
        for name, numbers in (("noise", noise), ("draws", draws)):
            require(
                hasattr(numbers, "_fields"),
                f"{name} is {numbers!r}; give a NamedTuple class with a field for each of its components",
            )
        require(
            guide or not navigate or "command" in asked(rates, "rates"),
            "navigate tells guidance what it knows; this flight has no guide, and rates asks for no command",
        )
        require(
            self.classes.get("ended", bool) is bool or integrator is runge_kutta_4,
            f"{described(ended)} returns a float, whose zero is found by parts of Runge-Kutta steps; with another "
            f"integrator return a bool, which ends a flight at the end of a step",
        )

        def the_state(state):
            return state

        the_state.__annotations__["return"] = state
        for role in ("store", "finish"):
            self.functions[role] = self.functions[role] or the_state
            self.classes.setdefault(role, state)
        command, memory = guided[0] if guided else (Nothing, Nothing)
        self.parts = {name: self.classes.get(role, Nothing) for role, (name, *_) in PARTS.items()}
        self.parts |= {"command": command, "memory": memory, "drawn": kinds["vary"][1] if vary else Nothing}
        self.parts["before"] = state
        self.options = {
            "integrator": integrator,
            "noise": noise,
            "draws": draws,
            "end_tolerance": float(end_tolerance),
            "watch_steps": bool(watch) and (not guide if watch_steps is None else bool(watch_steps)),
        }

    def fly(
        self,
        p,
        schedule,
        start,
        *,
        trials=None,
        vehicle=(),
        law=(),
        memory=None,
        seed=0,
        first_trial=0,
        nodes=0,
        air=None,
        increments=1,
        first_increment=0,
        streams=(NOISE_STREAM, AIR_STREAM),
        navigation_stream=NAVIGATION_STREAM,
        stored=None,
        past=0,
        only=None,
        into=None,
    ):
        """Fly consecutive trials, compiled, on as many threads as numba has.

        Args:
            p: parameters, a NamedTuple of numbers and arrays. law: likewise, of the guidance law.
            schedule: `Schedule`, see `periods`.
            start: initial state: a NamedTuple of numbers or arrays (trials,), or an array (numbers, trials); or
                `Trajectories`, from whose final states, finite or not, and `observed_maximum` the flight goes on.
            trials: how many; by default as many as the arrays hold.
            vehicle: what is dispersed of the vehicle, a NamedTuple like `start`.
            memory: what guidance remembers at the start; by default the defaults of its class.
            seed, first_trial: key of the random numbers, and the number of the first trial.
            nodes: of the trials' own air, which `vary` draws. air: the air itself, (nodes, trials), in place of `vary`.
            increments, first_increment: Brownian increments in a step, and before the first one: runs of other steps
                follow the same path.
            streams: of the noise and of the air. navigation_stream: of what `navigate` draws; a flight that goes on
                from another takes its own.
            stored: how many of the numbers that `store` returns are stored; by default all.
            past: numbers that a trial's guidance may write to, `past[i]`, for what it remembers of all periods.
            only: stream, number and value of the only normal of each trial that is not zero, (3, trials), as
                perturbed flights have; by default all are drawn.
            into: arrays for the history and for what is observed, (times, numbers, trials), where `trials` fill whole
                groups, see `pad_to_groups`; by default new ones.

        Returns:
            `Trajectories`: history and observed are what `store` and `observe` returned, observed_maximum what `watch`
            did at last, final_state what `finish` did; length is the number of stored states up to the end. If the
            schedule stores its end, the last row is that of each trial's own end.

        Raises:
            ValueError: for a start that is not finite, or numbers of trials that differ.
            TypeError: for a model that numba cannot compile, with the function's file and line.

        """
        from numba import get_num_threads

        from marsedl.montecarlo.ensembles import Trajectories
        from marsedl.montecarlo.flights import addressed, diagnosis
        from marsedl.montecarlo.flights.columns import flat
        from marsedl.montecarlo.lanes import LANES

        options = {"vehicle": vehicle, "law": law, "memory": memory, "nodes": nodes, "air": air, "past": past}
        options |= {"trials": trials, "first_trial": first_trial, "seed": seed, "stored": stored}
        memory = self.parts["memory"]() if memory is None else memory
        earlier = start if isinstance(start, Trajectories) else None
        start = earlier.final_state if earlier else start
        given = {"start": start, "vehicle": vehicle, **({} if air is None else {"air": air[:1]})}
        given |= {} if only is None else {"only": only}
        width = width_of(given, trials)
        padded = -(-width // LANES) * LANES
        only = np.empty((3, 0)) if only is None else table_of(only, width, padded)
        start, vehicle = (table_of(parts, width, padded) for parts in (start, vehicle))
        if not earlier:
            check_start(start, self.parts["state"], first_trial)
        if air is None:
            air = np.empty((0, padded))
        elif np.shape(air)[1] == padded:
            air = np.require(air, float, ["C", "W"])  # which may be large, and is not copied
        else:
            air = table_of(air, width, padded)
        vehicle_class = type(given["vehicle"]) if hasattr(given["vehicle"], "_fields") else Nothing
        times = len(schedule.times)
        size = {name: len(kind._fields) for name, kind in self.parts.items()}
        watched = earlier.observed_maximum if earlier else self.parts["watched"]()
        rows = size["stored"] if stored is None else stored
        history, observed = into or (np.empty((times, rows, padded)), np.empty((times, size["observed"], padded)))
        flown = Trajectories(
            history=history,
            observed=observed,
            observed_maximum=table_of(watched, width, padded),
            final_state=np.empty((size["final"], padded)),
            outcome=np.full(padded, COMPLETED, np.int8),
            length=np.full(padded, times, np.int64),
            ended=np.empty(padded, np.int8),
        )
        pace = (np.asarray(schedule.start, float), np.asarray(schedule.step, float), np.asarray(schedule.steps, int))
        settings = (
            (*pace, int(schedule.every), bool(schedule.stores_end)),
            (*map(int, (seed, first_trial, increments, first_increment, *streams, navigation_stream)), only),
            (len(air) or int(nodes), int(past)),
        )
        tables = (start, vehicle, np.array(tuple(memory), float), air)
        results = (flown.history, flown.observed, flown.observed_maximum, flown.length, flown.final_state, flown.ended)
        groups, threads = padded // LANES, min(get_num_threads(), padded // LANES)
        bounds = [groups * number // threads for number in range(threads + 1)]

        doubted = []  # roles whose loops over trials may be no vector code

        def fly_groups(first, last):
            kernel(given_p, given_law, *settings, (first, last), *tables, results)

        with diagnosis.explaining(self, (p, schedule, given["start"]), options):
            given_p, given_law = flat(p) or (0.0,), flat(law) or (0.0,)
            by_address = addressed.is_addressed(self, p, law)
            if by_address:
                function = self._law(p, law, vehicle_class)
                if not function.overloads:
                    function.compile((addressed.SIGNATURE,))  # or loads
                    if function.stats.cache_misses and diagnosis.is_scalar(function):
                        doubted.append("guide")
                read = [flat(value) for value in addressed.parameters_of(self, p, law).values()]  # kept for the words
                given_law = (addressed.address_of(function), *map(addressed.words_of, read))
            kernel = self._kernel(p, given_law if by_address else law, vehicle_class, by_address)
            if not kernel.overloads:
                fly_groups(0, 0)  # compiles, or loads
                if kernel.stats.cache_misses:
                    doubted += ["rates", "sense", "navigate"] + ["guide"] * (not by_address)
        diagnosis.warn_of_scalar_loops(self, doubted, p, law, vehicle_class)
        if threads == 1:
            fly_groups(0, groups)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(fly_groups, bounds[:-1], bounds[1:]))
        return flown.first(width)

    def fly_in_python(self, p, schedule, start, *, trial=0, **options):
        """Fly one trial by the functions as they are written: errors name their lines, `print` and debuggers work.

        Arguments are those of `fly` but `into`; `start`, `vehicle` and `air` may hold all trials or this one alone.
        Returns `Trajectories` of one trial, the bits being those of `fly`; NaN beyond its end, up to the last row.
        """
        from marsedl.montecarlo.flights.in_python import fly

        given = inspect.signature(Flight.fly).bind(self, p, schedule, start, **options)
        given.apply_defaults()
        return fly(self, trial, SimpleNamespace(**given.arguments))

    def reached(self):
        """What the numbers of a flight depend on beside its arguments: the functions, as `digest` takes them."""
        return (*self.functions.values(), *self.guides, self.options)

    def renew(self):
        """Let numba compile again what reads other numbers than before.

        Raises ValueError for a function that reads what a compiled flight cannot follow, such as random numbers.
        """
        done = set()
        for function in filter(None, (*self.functions.values(), *self.guides)):
            renew_helpers(function, done)

    def _kernel(self, p, law, vehicle_class, by_address):
        """The flight, which is compiled when it is first called; law: parameters, or address and words."""
        from marsedl.montecarlo.flights import addressed, loop
        from marsedl.montecarlo.flights.columns import shape_of, types_of

        kinds = {**self.parts, "vehicle": vehicle_class, **{name: self.options[name] for name in ("noise", "draws")}}
        functions, guides = self.functions, self.guides
        if by_address:
            kinds |= addressed.kinds_of_kernel(self)
            functions, guides = {**functions, "consult": None}, ()
        shapes = shape_of(p), shape_of(law)
        read = (*functions.values(), *guides, self.options, kinds, by_address, shapes, str(types_of((p, law))))

        def bound(key):
            return loop.fly_groups, loop.group_flight(self, key, *shapes, kinds, by_address)

        return self._cached("fly", read, self.functions["rates"], bound)

    def _law(self, p, law, vehicle_class):
        """The law alone, not compiled yet or kept."""
        from marsedl.montecarlo.flights import addressed
        from marsedl.montecarlo.flights.columns import shape_of, types_of

        kinds, guide, consult = addressed.kinds_of_law(self, vehicle_class), self.guides[0], self.functions["consult"]
        given = addressed.parameters_of(self, p, law)
        shapes, leaves = ({name: of(value) for name, value in given.items()} for of in (shape_of, types_of))

        def bound(_):
            return addressed.guide_group, addressed.law_of_lanes(self, kinds, shapes, leaves)

        unwrapped = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return self._cached("law", (guide, consult, kinds, shapes, str(leaves)), guide, bound, **unwrapped)

    def _cached(self, prefix, read, function, bound, **options):
        """What is compiled, or will be, of all that is read; function: whose module names the folder of the cache.

        It is kept as long as the program runs, as the address of a law must be while it flies.
        """
        key = digest(*read, _digest_of_engine())  # each time: what functions read may change
        name = f"{prefix}_{key}"
        if name not in _COMPILED:
            self.renew()
            _COMPILED[name] = named_kernel(*bound(key), name, function.__module__ or "__main__", **options)
        return _COMPILED[name]


@cache
def _digest_of_engine():
    from marsedl.montecarlo.flights import addressed, loop

    parts = (loop.group_flight, loop.fly_groups, addressed.law_of_lanes, addressed.guide_group)
    return digest(*parts, str(addressed.SIGNATURE))


def width_of(given, trials):
    """Number of trials that tables, or tuples of numbers and arrays, hold. Raises ValueError if they differ."""
    widths = {} if trials is None else {"trials": int(trials)}
    for name, parts in given.items():
        names = getattr(parts, "_fields", range(len(parts)))
        widths |= {f"{name}.{key}": np.shape(part)[0] for key, part in zip(names, parts, strict=True) if np.ndim(part)}
    require(
        len({*widths.values()}) < 2,
        f"arrays must hold a number for each trial, got {', '.join(f'{k}: {v}' for k, v in widths.items())}",
    )
    width = next(iter(widths.values()), 1)
    require(width >= 1, f"trials must be at least 1, got {width}")
    return width


def table_of(parts, width, padded=None):
    """(numbers, trials) of a tuple of numbers or arrays, or of a table; the last trial is repeated up to `padded`."""
    table = np.empty((len(parts), padded or width))
    for row, part in zip(table, parts, strict=True):
        row[:width] = part
        row[width:] = row[width - 1]
    return table


def check_start(start, state, first_trial):
    """Raise ValueError for a start that has not the numbers of the state, or is not finite."""
    require(
        len(start) == len(state._fields),
        f"start has {len(start)} numbers; the state has {len(state._fields)}: {', '.join(state._fields)}",
    )
    wrong = np.argwhere(~np.isfinite(start))
    if len(wrong):
        row, trial = wrong[0]
        raise ValueError(
            f"start.{state._fields[row]} of trial {first_trial + trial} is {start[row, trial]}, not a finite number"
        )
