"""Independent checks of the design: other formulations, other solvers, sampled fields (Secs. II-IV).

Everything here is about the first program of the reading, along the trajectory of zero control.
"""

import numpy as np

from marsedl.methods.covariance_steering import block_program
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.models import random_field
from marsedl.models.density_variation import sample_process
from marsedl.montecarlo.statistics import central_moments
from marsedl.montecarlo.streams import normals
from marsedl.papers.random_field import environment
from marsedl.papers.random_field import gains as design
from marsedl.papers.random_field.inputs import Air, Guidance, Inputs, Simulation
from marsedl.papers.random_field.linearization import UNITS, along, motion_of
from marsedl.papers.random_field.nominal import states_of
from marsedl.papers.random_field.records import Certificates, Linearization, Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

# Streams of random numbers of the checks, apart from those of the flights.
DISTURBANCES, FIELDS, SEGMENTS = 3, 4, 5
TIMES = 9  # at which the process along the nominal is compared with the field's covariance


@stage(claimed_in=("corrected",))
def compute(given: Inputs, nominal: Nominal, linearization: Linearization) -> Certificates:
    """Solve the first program in every way, sample fields along its trajectory, and compare.

    Raises MarsedlError if the reading's design was refused, or a solver fails.
    """
    if linearization.refused:
        raise MarsedlError(f"there is no design to certify: {linearization.refused}")
    motion = motion_of(given)
    states = states_of(given.planet.planet_radius, nominal)
    control = np.zeros(len(linearization.partition) - 1)
    model = along(motion, linearization.partition, control, states)
    posed, system = design.program(given.guidance, given.vehicle, motion, model, control)
    try:
        innovations, history, other = (
            block_program.solve(posed, form=form, solver=solver, accept_ill_conditioned=True)
            for form, solver in (("innovations", "CLARABEL"), ("history", "CLARABEL"), ("innovations", "SCS"))
        )
    except (ValueError, RuntimeError) as error:
        raise MarsedlError(f"first program, certificate: {error}") from None
    return Certificates(
        objective=innovations.objective,
        history_objective=history.objective,
        # With a known initial state the gains on it multiply zero and are arbitrary.
        history_gain_difference=float(np.abs(innovations.gain - history.gain)[:, 1:].max()),
        other_objective=other.objective,
        other_solver=other.solver,
        samples=given.simulation.paper_trials,
        **_identities(posed.system, innovations),
        **_separation(given.simulation, system, innovations),
        convexity=_convexity(given.guidance, given.simulation, posed, innovations),
        **_sampled(given.air, given.simulation, model),
        **_dependence(posed.system),
    )


def _blocks(system, law):
    """B and K as in Eqs. 29 and 31."""
    intervals, nodes, m, n = law.gain.shape
    return block_program.stacked(system).control, law.gain.transpose(0, 2, 1, 3).reshape(intervals * m, nodes * n)


def _identities(system, law):
    effect, gain = _blocks(system, law)
    intervals, nodes, _, n = law.gain.shape
    identity = np.eye(nodes * n)
    history = gain @ np.linalg.inv(identity - effect @ gain)
    later = np.repeat(np.arange(nodes), n)[np.newaxis] > np.arange(intervals)[:, np.newaxis]
    whole = block_program.stacked(system)
    covariance = whole.disturbance @ system.disturbance_covariance @ whole.disturbance.T
    covariance += whole.transition @ system.initial_covariance @ whole.transition.T
    from_gains = np.diag(history @ covariance @ history.T)
    return {
        "identity_residual": float(np.abs((identity + effect @ history) @ (identity - effect @ gain) - identity).max()),
        "triangular_residual": float(max(np.abs(gain[later]).max(), np.abs(history[later]).max())),
        "control_covariance_residual": float(np.abs(from_gains - law.control_covariance[:, 0, 0]).max()),
    }


def _separation(simulation: Simulation, system, law):
    """Fly the linear system with sampled disturbances under two mean controls, and without any under two gains."""
    root = random_field.root(system.disturbance_covariance)
    disturbances = random_field.sample(normals(simulation.seed, DISTURBANCES, range(8), len(root)), root)
    disturbances = disturbances.reshape(8, *law.mean[1:].shape)
    shifted = law.control + 0.1 * np.cos(np.arange(len(law.control)))[:, np.newaxis]

    def fly(control, gain, disturbances):
        mean = _propagate(system, control, np.zeros_like(gain), np.zeros_like(disturbances[:1]), None)[0]
        return _propagate(system, control, gain, disturbances, mean), mean

    (states, mean), (other_states, other_mean) = (
        fly(control, law.gain, disturbances) for control in (law.control, shifted)
    )
    deviations, other_deviations = states - mean, other_states - other_mean
    still, _ = fly(law.control, law.gain, np.zeros_like(disturbances[:1]))
    return {
        "mean_shift": float(np.abs(deviations - other_deviations).max() / np.abs(deviations).max()),
        "gain_shift": float(np.abs(still[0] - mean).max() / np.abs(mean).max()),
    }


def _propagate(system, control, gain, disturbances, mean):
    """States (trials, N + 1, n) of Eq. 23 under Eq. 8, step by step."""
    intervals = len(control)
    states = np.zeros((len(disturbances), intervals + 1, system.initial_mean.size))
    states[:, 0] = system.initial_mean
    for k in range(intervals):
        command = np.tile(control[k], (len(states), 1))
        if mean is not None:
            command = command + np.einsum("lmi,tli->tm", gain[k, : k + 1], states[:, : k + 1] - mean[: k + 1])
        states[:, k + 1] = (
            states[:, k] @ system.transition[k].T
            + command @ system.control[k].T
            + system.affine[k]
            + disturbances[:, k]
        )
    return states


def _convexity(guidance: Guidance, simulation: Simulation, posed, law):
    """Least relative excess of chords over the cost and the control constraints of Eq. 56.

    As functions of L and V, at the middle of random segments about the optimum.
    """
    effect, gain = _blocks(posed.system, law)
    whole = block_program.stacked(posed.system)
    covariance = whole.disturbance @ posed.system.disturbance_covariance @ whole.disturbance.T
    n = posed.system.initial_mean.size
    identity = np.eye(len(covariance))
    best = gain @ np.linalg.inv(identity - effect @ gain)
    allowed = best != 0.0
    quantile = upper_quantile(posed.percentiles[0].probability)

    def values(history, control):
        closed = identity + effect @ history
        state = closed @ covariance @ closed.T
        mean = (whole.control @ control + whole.affine)[-n:]
        spread = history @ covariance @ history.T
        quadratic = sum(
            np.trace(weight @ state[k * n : (k + 1) * n, k * n : (k + 1) * n])
            for k, weight in enumerate(posed.state_weight)
        )
        quadratic += np.trace(spread) * guidance.control_variance_weight
        ends = [
            p.offset + p.gradient @ mean + quantile * np.sqrt(p.gradient @ state[-n:, -n:] @ p.gradient)
            for p in posed.percentiles
        ]
        return np.array([quadratic + posed.percentile_weight * max(ends), *(control + np.sqrt(np.diag(spread)))])

    least = np.inf
    directions = normals(simulation.seed, SEGMENTS, range(40), best.size + len(best))
    for first, second in zip(directions[::2], directions[1::2], strict=True):
        points = []
        for numbers in (first, second):
            direction = numbers[: best.size].reshape(best.shape) * np.abs(best).max() * allowed
            points.append((best + direction, law.control[:, 0] + 0.1 * numbers[best.size :]))
        ends = [values(*point) for point in points]
        middle = values(*(0.5 * (a + b) for a, b in zip(*points, strict=True)))
        scale = np.abs(ends[0]) + np.abs(ends[1])
        least = min(least, float(((0.5 * (ends[0] + ends[1]) - middle) / scale).min()))
    return least


def _sampled(air: Air, simulation: Simulation, model):
    """The process along the nominal and its integrals over the intervals, from samples of the spatial field."""
    grid = environment.field_grid(air)
    process = random_field.markov(environment.kernel(air), grid)
    count = simulation.paper_trials
    process_samples = sample_process(normals(simulation.seed, FIELDS, range(count), len(grid)), *process)
    process_samples += air.variation_mean
    along_path = random_field.interpolate(model.field_altitude, grid, process_samples)
    chosen = np.linspace(0, len(model.field_altitude) - 1, TIMES).round().astype(int)
    altitude = model.field_altitude[chosen]
    expected = environment.kernel(air)(altitude[:, np.newaxis], altitude)
    disturbances = along_path @ model.field_map.T
    used = np.diag(model.disturbance_covariance) > 1e-12 * np.tile(UNITS, len(model.control)) ** 2
    mean = model.field_map @ np.full(len(model.field_altitude), air.variation_mean)  # Eq. 25
    return {
        "process_mean_score": _mean_score(along_path[:, chosen], air.variation_mean, np.diag(expected)),
        "disturbance_mean_score": _mean_score(
            disturbances[:, used], mean[used], np.diag(model.disturbance_covariance)[used]
        ),
        "process_score": _covariance_score(along_path[:, chosen], expected),
        "disturbance_score": _covariance_score(disturbances[:, used], model.disturbance_covariance[np.ix_(used, used)]),
        "normality_score": _normality_score(disturbances[:, used]),
    }


def _mean_score(samples, expected, variance):
    """Largest difference of a sample mean from the expected one, in its standard errors."""
    return float(np.abs((samples.mean(axis=0) - expected) / np.sqrt(variance / len(samples))).max())


def _covariance_score(samples, expected):
    """Largest difference of a sample covariance from the expected one, in standard errors of normal samples.

    NaN of one sample, which has no covariance.
    """
    count, _, second = central_moments(samples)
    if count < 2:
        return np.nan
    variance = np.diag(expected)
    error = np.sqrt((np.outer(variance, variance) + expected**2) / count)
    return float((np.abs(second / (count - 1) - expected) / error).max())


def _normality_score(samples):
    """Largest skewness and excess kurtosis, in standard errors of normal samples; NaN of one sample."""
    count = len(samples)
    if count < 2:
        return np.nan
    standard = samples / samples.std(axis=0)
    standard = standard - standard.mean(axis=0)
    skewness, excess = (standard**3).mean(axis=0), (standard**4).mean(axis=0) - 3.0
    return float(np.abs(np.concatenate([skewness / np.sqrt(6.0 / count), excess / np.sqrt(24.0 / count)])).max())


def _dependence(system):
    """Correlation of the disturbances of different intervals, their sizes, and what the history of states tells."""
    n = system.initial_mean.size
    intervals = len(system.control)
    deviation = np.sqrt(np.diag(system.disturbance_covariance))
    correlation = system.disturbance_covariance / np.outer(deviation, deviation)
    interval = np.repeat(np.arange(intervals), n)
    other_intervals = interval[:, np.newaxis] != interval
    speed = deviation.reshape(intervals, n)[:, 1]
    whole = block_program.stacked(system)
    state = whole.disturbance @ system.disturbance_covariance @ whole.disturbance.T
    state += whole.transition @ system.initial_covariance @ whole.transition.T
    information = 0.0
    for k in range(3, intervals + 1):
        now, last, before = (slice((k - back) * n, (k - back + 1) * n) for back in (0, 1, 2))
        after_last = _conditional_variance(state, now, [last])
        information = max(
            information, float((1.0 - _conditional_variance(state, now, [before, last]) / after_last).max())
        )
    return {
        "largest_correlation": float(np.abs(correlation[other_intervals]).max()),
        "deviation_ratio": float(speed.max() / speed.min()),
        "history_information": information,
    }


def _conditional_variance(covariance, of, given):
    """Variances of some components given others."""
    conditions = np.concatenate([np.arange(part.start, part.stop) for part in given])
    cross = covariance[of, :][:, conditions]
    return np.diag(covariance[of, of] - cross @ np.linalg.solve(covariance[np.ix_(conditions, conditions)], cross.T))
