"""Flights as they are declared, and the flying of any of their trials."""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from marsedl.fly import laws
from marsedl.fly.declared import Declared
from marsedl.fly.vehicles import Model

START, NOISE, AIR, VEHICLE = range(4)  # streams of random numbers
CHUNK = 16_384  # trials between two looks at the clock; a multiple of the group of trials
OUT_OF_TIME, NOT_FINITE = "out of time", "not finite"


@dataclass(frozen=True)
class Campaign:
    """What is flown; see `fly` for the fields."""

    flies: Any
    start: dict
    law: Any
    trigger: Any
    end_time: float
    period: float
    substeps: int
    history: float | None
    seed: int

    def ready(self) -> "Ready":
        """All of it, checked and bound. Raises ValueError with one sentence on what is wrong."""
        if not hasattr(self.flies, "model"):
            kind = type(self.flies).__name__
            if kind != "Flight":
                raise ValueError(f"{self.flies!r} does not fly: give Entry(...), Lander(...), Model(...) or a Flight")
            model = Model(self.flies)
        else:
            model = self.flies.model()
        start, vehicle = model.declared_start(self.start), model.declared_vehicle()
        nominal = dict(zip(start.names, start.means, strict=True))
        law = laws.bind(self.law, model.flight)
        trigger, end, called = laws.trigger_of(self.trigger, model.flight, nominal, model.units(start.names))
        laws.try_once(law, model.flight, nominal)
        p = model.complete(model.p, nominal) if model.complete else model.p
        if end:
            p = laws.extended(type(p))(*p, end)
        for name in ("end_time", "period"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)!r} s; it must be positive")
        if self.substeps < 1 or self.substeps != int(self.substeps):
            raise ValueError(
                f"substeps is {self.substeps!r}; give the integration steps in a guidance period, at least 1"
            )
        return Ready(self, model, start, vehicle, law, trigger, called, p)


@dataclass(frozen=True)
class Ready:
    """A campaign that is checked and bound to its model."""

    campaign: Campaign
    model: Model
    start: Declared
    vehicle: Declared
    law: laws.Bound
    trigger: Any
    end: str
    p: tuple

    def flight(self, compiles=True):
        """The flight with law and trigger."""
        return laws.completed(self.model.flight, self.law.kind, self.trigger, compiles)

    def schedule(self, every=None):
        """Guidance periods; stored are the states at the start and the end, or every so many seconds."""
        from marsedl.montecarlo.flights import periods

        campaign = self.campaign
        schedule = periods(campaign.end_time, campaign.period, campaign.substeps)
        if every is None:
            return schedule._replace(every=int(schedule.steps.sum()))
        steps = every * campaign.substeps / campaign.period
        if not (steps >= 1.0 and abs(steps - round(steps)) < 1e-9 * steps):
            raise ValueError(
                f"history every {every:g} s is no multiple of the integration step, "
                f"{campaign.period / campaign.substeps:g} s"
            )
        return schedule._replace(every=round(steps))

    def arguments(self, trials, every):
        """Arguments of `Flight.fly` for these consecutive trials."""
        start = self.start.sample(self.campaign.seed, START, trials)
        kind = type(self.model.vehicle)
        return (self.p, self.schedule(every), self.model.flight.parts["state"](*start)), {
            "vehicle": kind(*self.vehicle.sample(self.campaign.seed, VEHICLE, trials)) if self.vehicle.names else (),
            "law": self.law.parameters,
            "nodes": self.model.nodes,
            "seed": self.campaign.seed,
            "first_trial": trials[0],
            "streams": (NOISE, AIR),
        }

    def fly(self, trials, every):
        """`Trajectories` of consecutive trials; what numba cannot compile is told by a flight in Python."""
        positional, named = self.arguments(trials, every)
        try:
            return self.flight().fly(*positional, **named)
        except Exception as error:
            if not (isinstance(error, TypeError) or type(error).__module__.startswith("numba")):
                raise
            try:
                self.fly_in_python(trials[0], None)
            except Exception as plain:  # which names the line that is wrong
                plain.add_note(f"Laws are told: {', '.join(laws.told_by(self.model.flight)._fields)}")
                raise plain from None
            raise

    def fly_in_python(self, trial, every):
        """`Trajectories` of one trial, by the functions as they are written."""
        positional, named = self.arguments(range(trial, trial + 1), every)
        return self.flight(compiles=False).fly_in_python(*positional, trial=trial, **named)

    def outcomes(self, flown):
        """Outcome of every flight, by name."""
        finite = np.isfinite(flown.final_state).all(axis=0)
        ended = flown.length < len(flown.history) if "ended" in self.flight().classes else np.ones(finite.shape, bool)
        return np.where(finite, np.where(ended, self.end, OUT_OF_TIME), NOT_FINITE)

    def histories(self, flown):
        """Stored states up to the end of each flight, NaN after it, (times, quantities, trials)."""
        after = np.arange(len(flown.history))[:, np.newaxis] >= flown.length
        return np.where(after[:, np.newaxis], np.nan, flown.history)

    def fly_all(self, first, last, processes, progress):
        """Final numbers, outcomes and histories (or None) of the trials first .. last - 1, flown in chunks."""
        size = CHUNK if processes == 1 else min(CHUNK, -(-(last - first) // processes))
        chunks = [range(low, min(low + size, last)) for low in range(first, last, size)]
        bar = _Progress(last - first, progress)
        if processes == 1:
            flown = [bar.told(self.reduced(chunk)) for chunk in chunks]
        else:
            jobs = [(self.campaign, chunk, processes) for chunk in chunks]
            with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                flown = [bar.told(part) for part in pool.map(_fly_chunk, jobs)]
        bar.close()
        final, outcome, history = zip(*flown, strict=True)
        whole = None if history[0] is None else np.concatenate(history, axis=-1)
        return np.concatenate(final, axis=-1), np.concatenate(outcome), whole

    def reduced(self, trials):
        """What is kept of these trials."""
        flown = self.fly(trials, self.campaign.history)
        history = None if self.campaign.history is None else self.histories(flown)
        return flown.final_state, self.outcomes(flown), history


def _fly_chunk(job):
    """One chunk in a process of a pool, with its share of the threads."""
    import os

    import numba

    campaign, trials, processes = job
    numba.set_num_threads(max(1, min(numba.get_num_threads(), (os.cpu_count() or 1) // processes)))
    return campaign.ready().reduced(trials)


class _Progress:
    """A line on the error stream of how much is flown, if that takes more than two seconds."""

    def __init__(self, total, shown):
        self.total, self.flown, self.began, self.written = total, 0, time.monotonic(), False
        self.shown = sys.stderr.isatty() if shown is None else shown

    def told(self, part):
        """Count a part that is flown; returns it."""
        self.flown += part[1].size
        passed = time.monotonic() - self.began
        if self.shown and passed > 2.0:
            left = passed / self.flown * (self.total - self.flown)
            line = f"\r{self.flown:,} of {self.total:,} flights, {left:.0f} s left "
            print(line, end="", file=sys.stderr, flush=True)
            self.written = True
        return part

    def close(self):
        """End the line."""
        if self.written:
            print(file=sys.stderr)
