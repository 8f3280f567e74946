r"""A reference that errors move less, by the method of the desensitized landing: sensitivities join the states.

    $\text{minimise} \quad J_0 + w \sum_i \left( \frac{\sigma_i}{1 \, \text{km}} \frac{\partial R}{\partial q_i}
      \right)^2 + w_k |k|^2, \quad J_0 = \int \left( \frac{u - u_\text{nominal}(V)}{0.1} \right)^2 \frac{dt}{100 \,
      \text{s}}$

R is the range at the velocity trigger, u the bank cosine until the heading alignment, and q are velocity, flight path
angle and downrange at the entry and a factor of the density. With feedback, u answers deviations of altitude, velocity,
flight path angle and downrange from the reference with constant gains k, which the solver chooses with it.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.methods.collocation import Condition, Guess, Problem, Program, Variable
from marsedl.methods.desensitization import Desensitized, Gain, Perturbation, column
from marsedl.methods.guidance.bank_profile import ramped_bank_cosine
from marsedl.models.dynamics.planar_entry import planar_entry_rates
from marsedl.papers import density
from marsedl.papers.stochastic_entry import dispersions, environment, flight
from marsedl.papers.stochastic_entry.records import DOWNRANGE

__all__ = ["Reshaped", "reshaped", "table"]

STATES = ("altitude", "velocity", "path_angle", "downrange")
SCALES = np.array([1e4, 1e3, 0.1, 1e5])  # of the states
UNITS = np.array([1e3, 100.0, 0.01, 1e3])  # deviations that a gain of one answers with a bank cosine of one
INTERVALS, SCHEME = 30, "hermite_simpson"
LARGEST_COSINE = 0.9  # of the reference, which leaves room for feedback


class Reshaped(NamedTuple):
    """A reference and its feedback."""

    time: np.ndarray  # nodes, (N + 1,), s
    cosine: np.ndarray  # of the bank, held between them, (N,)
    gain: np.ndarray  # on `STATES`, (4,), of the bank cosine
    sensitivities: np.ndarray  # of the range at the trigger to an error of one deviation each, m, (4,)


def reshaped(onboard, weight, gain_weight=None) -> Reshaped:
    """Solve for a weight of the sensitivities; gain_weight: w_k, or None for no feedback.

    Raises NotConvergedError or BranchEndError if no solution is found.
    """
    model, given = onboard.linearization, onboard.given
    aligned = int(np.searchsorted(model.time, onboard.nominal.alignment_time - 1e-6))
    towards = _towards_range(model, aligned)
    deviations, known = _deviations(onboard), {"weight": 0.0, "thickness": 1.0}

    def range_of(end, of=""):
        """Range at the trigger of a state at the end, or its sensitivity to an error, to first order."""
        names = [column(name, of) if of else name for name in STATES]
        return sum(slope * end.get(name, 0.0) for name, slope in zip(names, towards, strict=True))

    def transcribed(problem):
        return Program(problem, INTERVALS, SCHEME, expand=given.air.density_profile != "table")

    base = _problem(onboard, aligned)
    profile = transcribed(base).solve(_guess(onboard, aligned), known)  # the nominal one, as nothing is asked of it
    reached = range_of(dict(zip(STATES, profile.states[-1], strict=True)))
    base = replace(base, boundary=(Condition("range", lambda start, end: range_of(end), reached, reached, scale=1e4),))
    perturbations = [Perturbation(name, {name: 1.0}) for name in STATES[1:]]
    perturbations.append(Perturbation("thickness", parameters={"thickness": 1.0}))
    gains = () if gain_weight is None else tuple(map(Gain, ["cosine"] * len(STATES), STATES, 1.0 / UNITS))
    scales = dict(zip(STATES, SCALES / deviations.max(), strict=True))
    extended = Desensitized(base, tuple(perturbations), scales, gains)

    def sensitivities(end):
        return [deviation * range_of(end, one.name) for one, deviation in zip(perturbations, deviations, strict=True)]

    def end_cost(start, end, parameters):
        size = sum(parameters[gain.parameter] ** 2 for gain in gains)
        misses = sum((miss / 1e3) ** 2 for miss in sensitivities(end))
        return parameters["weight"] * misses + (gain_weight or 0.0) * size

    program = transcribed(replace(extended.problem, end_cost=end_cost))
    first = program.solve(extended.guess(profile.guess(), known, SCHEME), known)
    found = program.follow(first, "weight", [1e-2 * weight, weight])[-1]
    end = dict(zip((variable.name for variable in extended.problem.states), found.states[-1], strict=True))
    gain = np.array([found.free[gain.parameter] * gain.unit for gain in gains] or np.zeros(len(STATES)))
    return Reshaped(found.time, found.controls[:, 0], gain, np.array(sensitivities(end)))


def table(onboard, found: Reshaped) -> flight.Law:
    """The law against time, its reference being the flight of the reshaped profile by this vehicle.

    A constant is added to the profile so that this flight ends where the nominal does.
    """
    given, aim = onboard.given, onboard.nominal.downrange[-1]
    period = given.guidance.guidance_period
    time = period * np.arange(np.ceil(given.mission.time_limit / period))
    middles = 0.5 * (found.time[1:] + found.time[:-1])
    cosine = np.interp(time + 0.5 * period, middles, found.cosine)
    empty = np.zeros((len(time), flight.FEATURES))
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    mean = dispersions.entry_mean(given.planet, given.mission)
    vehicle = flight.Vehicles(mean[np.newaxis], np.array([drag_factor]), np.array([lift_factor]))

    def flown(added):
        law = flight.Law(flight.BY_TIME, np.zeros(2), empty, empty, cosine + added, 0.0)
        flights = flight.fly(
            onboard.settings,
            environment.undisturbed(environment.atmosphere(given.air)),
            law,
            vehicle,
            trigger="velocity",
            end_time=given.mission.time_limit,
            substeps=given.simulation.nominal_substeps,
            seed=0,
        )
        return law, flights

    from scipy.optimize import newton

    try:
        added = newton(lambda added: flown(added)[1].final_state[DOWNRANGE, 0] - aim, 0.0, x1=1e-2, tol=1e-8)
    except RuntimeError as error:
        raise ValueError(f"no constant added to the reshaped bank cosine reaches the target: {error}") from None
    law, flights = flown(added)
    history = flights.history[~flights.after_end[:, 0], :, 0]
    altitude, velocity, path_angle, downrange, air = history[:, :5].T
    drag, climb = drag_factor * air * velocity**2, velocity * np.sin(path_angle)
    reference = np.column_stack(
        [altitude + given.planet.planet_radius, velocity, path_angle, downrange, air, drag, climb]
    )
    gain = np.zeros(reference.shape)
    gain[:, : len(STATES)] = found.gain
    return law._replace(gain=gain, reference=reference, bank_cosine=law.bank_cosine[: len(reference)])


def _deviations(onboard):
    """Of velocity, path angle and downrange at the entry, and of the density where drag is largest, (4,)."""
    given, nominal = onboard.given, onboard.nominal
    of_entry = np.sqrt(np.diag(onboard.linearization.initial_covariance))[1 : len(STATES)]
    return np.append(of_entry, np.sqrt(environment.variance(given.air, nominal.altitude[np.argmax(nominal.drag)])))


def _towards_range(model, aligned):
    """Derivative of the range at the trigger by the state at the heading alignment, which is not steered from, (4,)."""
    towards = model.trigger_projection[DOWNRANGE, : len(STATES)]
    for transition in model.slaved_transition[aligned:][::-1]:
        towards = towards @ transition
    return towards


def _guess(onboard, aligned) -> Guess:
    """The nominal flight until the heading alignment."""
    model = onboard.linearization
    time = np.linspace(0.0, model.time[aligned], INTERVALS + 1)
    states = np.column_stack([np.interp(time, model.time, state) for state in model.state.T[: len(STATES)]])
    states[:, 0] -= onboard.given.planet.planet_radius
    cosine = np.interp(0.5 * (time[1:] + time[:-1]), model.time, model.bank_cosine)
    return Guess(states, cosine[:, np.newaxis], float(time[-1]))


def _problem(onboard, aligned) -> Problem:
    """Least change of the nominal profile from the entry to the heading alignment."""
    given, guess = onboard.given, _guess(onboard, aligned)
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    log_density, guidance, planet = density.log_density(given.air), given.guidance, given.planet
    slow, fast = np.cos(guidance.nominal_bank_slow), np.cos(guidance.nominal_bank_fast)
    _, _, latitude, _, _, azimuth = dispersions.entry_mean(planet, given.mission)
    lifting = 2.0 * planet.rotation_rate * np.cos(latitude) * np.sin(azimuth)  # by the planet's rotation, rad/s

    def rates(altitude, velocity, path_angle, downrange, cosine, weight, thickness):
        radius = planet.planet_radius + altitude
        air = thickness * np.exp(log_density(altitude))
        climb, deceleration, turn = planar_entry_rates(
            radius, velocity, path_angle, cosine, air, drag_factor, lift_factor, planet.gravitational_parameter
        )
        return climb, deceleration, turn + lifting, velocity * np.cos(path_angle)

    def running_cost(altitude, velocity, path_angle, downrange, cosine, weight, thickness):
        nominal = ramped_bank_cosine(velocity, *guidance.ramp_velocities, fast, slow)
        return ((cosine - nominal) / 0.1) ** 2 / 100.0

    return Problem(
        rates=rates,
        states=tuple(map(Variable, STATES, SCALES)),
        controls=(Variable("cosine", 0.1, -LARGEST_COSINE, LARGEST_COSINE),),
        final_time=Variable("final_time", 100.0, 0.5 * guess.final_time, 2.0 * guess.final_time),
        initial=dict(zip(STATES, guess.states[0], strict=True)),
        final={"velocity": float(guess.states[-1, 1])},
        running_cost=running_cost,
        given=("weight", "thickness"),
    )
