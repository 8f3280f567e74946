"""Flights as they are declared, checked and bound, and the flying of any of their trials."""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from marsedl.fly import laws
from marsedl.fly.vehicles import Model

START, NOISE, AIR, VEHICLE = range(4)  # streams of random numbers
CHUNK = 16_384  # trials between two looks at the clock; a multiple of the group of trials
OUT_OF_TIME, NOT_FINITE = "out of time", "not finite"


class Campaign:
    """What is flown. Arguments and errors are those of `fly`."""

    def __init__(self, flies, start, law, trigger, end_time, period, substeps, history, seed):
        """Check all of it, and bind it to the model; nothing is compiled."""
        self.declared = (flies, start, law, trigger, end_time, period, substeps, history, seed)
        if not hasattr(flies, "model") and type(flies).__name__ != "Flight":
            raise ValueError(f"{flies!r} does not fly: give Entry(...), Lander(...), Model(...) or a Flight")
        self.model = model = flies.model() if hasattr(flies, "model") else Model(flies)
        for name, seconds in (("end_time", end_time), ("period", period)):
            if not 0.0 < seconds < np.inf:
                raise ValueError(f"{name} is {seconds!r} s; it must be positive")
        if substeps < 1 or substeps != int(substeps):
            raise ValueError(f"substeps is {substeps!r}; give the integration steps in a guidance period, at least 1")
        self.end_time, self.period, self.substeps, self.history, self.seed = end_time, period, substeps, history, seed
        self.start, self.vehicle = model.declared_start(start), model.declared_vehicle()
        nominal = dict(zip(self.start.names, self.start.means, strict=True))
        self.law = laws.bind(law, model.flight, nominal, model.units)
        self.trigger, end, self.end = laws.trigger_of(trigger, model.flight, nominal, model.units(nominal))
        self.p = model.complete(model.p, nominal) if model.complete else model.p
        if end:
            self.p = laws.extended(type(self.p))(*self.p, end)
        self.schedule(history)

    def __reduce__(self):
        """Pickle what was declared, which another process binds again."""
        return Campaign, self.declared

    def flight(self):
        """The `Flight` with law and trigger."""
        return laws.completed(self.model.flight, self.law.kind, self.trigger)

    def schedule(self, every=None):
        """Guidance periods; stored are the states at the start and the end, or every so many seconds."""
        from marsedl.montecarlo.flights import periods

        schedule = periods(self.end_time, self.period, self.substeps)
        if every is None:
            return schedule._replace(every=int(schedule.steps.sum()))
        steps = every * self.substeps / self.period
        if not (steps >= 1.0 and abs(steps - round(steps)) < 1e-9 * steps):
            step = self.period / self.substeps
            raise ValueError(f"history every {every:g} s is no multiple of the integration step, {step:g} s")
        return schedule._replace(every=round(steps))

    def fly(self, trials, every, in_python=False):
        """`Trajectories` of consecutive trials, of one alone if in Python."""
        state, vehicle = self.model.flight.parts["state"], ()
        if self.vehicle.names:
            vehicle = type(self.model.vehicle)(*self.vehicle.sample(self.seed, VEHICLE, trials))
        arguments = (self.p, self.schedule(every), state(*self.start.sample(self.seed, START, trials)))
        options = {"vehicle": vehicle, "law": self.law.parameters, "nodes": self.model.nodes, "seed": self.seed}
        options |= {"first_trial": trials[0], "streams": (NOISE, AIR)}
        if in_python:
            return self.flight().fly_in_python(*arguments, trial=trials[0], **options)
        return self.flight().fly(*arguments, **options)

    def outcomes(self, flown):
        """Outcome of every flight, by name."""
        finite = np.isfinite(flown.final_state).all(axis=0)
        ended = flown.length < len(flown.history) if "ended" in self.flight().classes else True
        return np.where(finite, np.where(ended, self.end, OUT_OF_TIME), NOT_FINITE)

    def reduced(self, trials):
        """Final numbers, outcomes and histories (NaN after the end; or None) of consecutive trials."""
        flown, history = self.fly(trials, self.history), None
        if self.history is not None:
            history = flown.cleared().history
        return flown.final_state, self.outcomes(flown), history

    def fly_all(self, first, last, processes, progress):
        """As `reduced`, of the trials first .. last - 1, in chunks; says how many are flown if that takes long."""
        size = CHUNK if processes == 1 else min(CHUNK, -(-(last - first) // processes))
        chunks = [range(low, min(low + size, last)) for low in range(first, last, size)]
        if processes == 1:
            parts = _told(map(self.reduced, chunks), last - first, progress)
        else:
            with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                jobs = [(self, chunk, processes) for chunk in chunks]
                parts = _told(pool.map(_fly_chunk, jobs), last - first, progress)
        final, outcome, history = zip(*parts, strict=True)
        whole = None if history[0] is None else np.concatenate(history, axis=-1)
        return np.concatenate(final, axis=-1), np.concatenate(outcome), whole


def _fly_chunk(job):
    """One chunk in a process of a pool, with its share of the threads."""
    import numba

    campaign, trials, processes = job
    numba.set_num_threads(max(1, numba.get_num_threads() // processes))
    return campaign.reduced(trials)


def _told(parts, total, shown):
    """List of the parts; after two seconds, a line on the error stream counts their flights."""
    began, done, flown, written = time.monotonic(), [], 0, False
    for part in parts:
        done.append(part)
        flown, passed = flown + part[1].size, time.monotonic() - began
        if passed > 2.0 and (sys.stderr.isatty() if shown is None else shown):
            left = passed / flown * (total - flown)
            print(f"\r{flown:,} of {total:,} flights, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
            written = True
    if written:
        print(file=sys.stderr)
    return done
