"""The compiled entry flight against an oracle by plain numpy in an inertial frame, which shares no equation with it.

The oracle: Newton's law with gravity, drag and lift as vectors; the target turning with the planet; both angles of
Appendix D from vectors; the laws from the design's artifacts against time, not from the tables that are flown.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.interpolate import interp1d
from scipy.optimize import brentq

from marsedl.models.density_variation import sample_exact
from marsedl.montecarlo.lanes import LANES
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.streams import normals
from marsedl.papers.stochastic_entry import dispersions, environment, flight, records
from marsedl.papers.stochastic_entry.records import TRIGGERS


def cross(a, b):
    """Vector product of (3, n) arrays."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a, b):
    return (a * b).sum(axis=0)


def length(a):
    return np.sqrt(dot(a, a))


def density_factors(inputs, air, trials):
    """Density over its mean at the nodes of the air's table, (trials, nodes), and which would be negative."""
    normal_numbers = normals(inputs.seed, dispersions.DENSITY_STREAM, trials, len(air.altitude))
    ratio = 1.0 + sample_exact(normal_numbers[:, ::-1], air.retention, air.deviation)  # drawn from the top down
    return np.maximum(ratio, 0.0), ratio < 0.0


class Oracle:
    """Flights of some trials of a case. `margin`: least distance of a trial's crossrange from the deadband, m."""

    def __init__(self, inputs, linearization, gains, case, trials):
        self.inputs, self.model, self.gains = inputs, linearization, gains
        self.law, self.trigger = case.split("_")
        self.number = TRIGGERS.index(self.trigger)
        self.trials = np.arange(len(trials))
        self.air = inputs.call(environment.atmosphere)
        self.factor, _ = density_factors(inputs, self.air, trials)
        self.vehicles = flight.vehicles_of(inputs.call(dispersions.dispersions_of), inputs.seed, trials)
        self.rotation = np.array([[0.0], [0.0], [inputs.rotation_rate]])
        if self.law == "apollo":
            self.table = self.tabulate()

    # ---- the vehicle -------------------------------------------------------------------------------------------------

    def start(self):
        """Inertial position and velocity at entry, where both frames coincide."""
        radius, longitude, latitude, velocity, path_angle, azimuth = self.vehicles.entry_state.T
        up = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        east = np.stack([-np.sin(longitude), np.cos(longitude), 0.0 * longitude])
        heading = np.sin(azimuth) * east + np.cos(azimuth) * cross(up, east)
        relative = velocity * (np.sin(path_angle) * up + np.cos(path_angle) * heading)
        return radius * up, relative + cross(self.rotation, radius * up)

    def density(self, altitude):
        grid = self.air.altitude
        k = np.clip(np.searchsorted(grid, altitude, side="right") - 1, 0, len(grid) - 2)
        fraction = (altitude - grid[k]) / (grid[k + 1] - grid[k])
        factor = (1.0 - fraction) * self.factor[self.trials, k] + fraction * self.factor[self.trials, k + 1]
        return np.exp(np.interp(altitude, grid, self.air.log_density)) * factor

    def rates(self, position, velocity, bank):
        radius, relative = length(position), velocity - cross(self.rotation, position)
        speed, up = length(relative), position / length(position)
        ahead = relative / speed
        above = up - dot(up, ahead) * ahead
        above /= length(above)
        lift = np.cos(bank) * above + np.sin(bank) * cross(ahead, above)
        density = self.density(radius - self.inputs.planet_radius)
        gravity = -self.inputs.gravitational_parameter * position / radius**3
        drag = -self.vehicles.drag_factor * density * speed * relative
        return velocity, gravity + drag + self.vehicles.lift_factor * density * speed**2 * lift

    def step(self, position, velocity, bank, h):
        """One classical Runge-Kutta step."""
        k = [self.rates(position, velocity, bank)]
        for part in (0.5, 0.5, 1.0):
            k.append(self.rates(position + part * h * k[-1][0], velocity + part * h * k[-1][1], bank))
        return [x + h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]) for j, x in enumerate((position, velocity))]

    # ---- guidance ----------------------------------------------------------------------------------------------------

    def speed(self, position, velocity):
        return length(velocity - cross(self.rotation, position))

    def features(self, time, position, velocity):
        """Longitudinal state (5, n), both angles of the target (Appendix D)."""
        inputs, turn = self.inputs, self.inputs.rotation_rate * time
        longitude, latitude = inputs.target_longitude, inputs.target_latitude
        there = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
        matrix = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        target = np.broadcast_to((matrix @ there)[:, np.newaxis], position.shape)
        relative, radius = velocity - cross(self.rotation, position), length(position)
        momentum, aside = cross(position, velocity), cross(position, target)
        distance = np.arctan2(length(aside), dot(position, target)) * np.where(dot(aside, momentum) < 0, -1.0, 1.0)
        crossrange = np.arcsin(dot(target, momentum) / length(momentum))
        path_angle = np.arcsin(dot(relative, position) / (length(relative) * radius))
        density = self.density(radius - inputs.planet_radius)
        state = np.stack([radius, length(relative), path_angle, -inputs.planet_radius * distance, density])
        return state, distance, crossrange

    def fed_back(self, state):
        """What the Apollo law compares with its reference: five states, drag and altitude rate."""
        drag = self.vehicles.drag_factor * state[4] * state[1] ** 2
        return np.vstack([state, drag, state[1] * np.sin(state[2])])

    def adjoint_gain(self):
        """Gain of the Apollo law against time, (periods, 5), by the adjoint marched back from its end (Eqs. 47-50)."""
        model, final = self.model, self.gains.adjoint[self.number][-1]
        blind = self.inputs.apollo_form == "density_blind"
        steps = (model.slaved_transition, model.slaved_control) if blind else (model.transition, model.control)
        adjoint, effect, gain = final[: steps[1].shape[1]], 0.0, []
        for transition, control in zip(*(part[::-1] for part in steps), strict=True):
            effect += adjoint @ control
            adjoint = adjoint @ transition
            row = -5.0 * adjoint / effect if effect != 0.0 else 0.0 * adjoint
            gain.append(np.pad(row, (0, 5 - len(row))))
        return np.array(gain[::-1])

    def tabulate(self):
        """Gains and reference of the Apollo law by velocity, from those by time after the velocity's peak."""
        model, gain = self.model, self.adjoint_gain()
        last = np.flatnonzero(gain.any(axis=1))[-1]
        nodes = np.arange(last + 1, np.argmax(model.state[:, 1]) - 1, -1)
        velocity, path_angle = model.state[:, 1], model.state[:, 2]
        reference = np.column_stack([model.state, model.drag, velocity * np.sin(path_angle)])
        used = np.minimum(nodes, last)  # behind the last gain it is held
        gains = np.zeros((len(nodes), 7))
        if self.inputs.apollo_form == "drag":
            k, at = gain[used], model.state[used]
            gains[:, 3] = k[:, 3]
            gains[:, 5] = (k[:, 4] * at[:, 4] - k[:, 0] / model.inverse_scale_height[used]) / model.drag[used]
            gains[:, 6] = k[:, 2] / (at[:, 1] * np.cos(at[:, 2]))
        else:
            gains[:, :5] = gain[used]
        followed = reference[nodes]
        if self.inputs.apollo_table_end == "held":
            followed[0] = followed[1]
        if self.inputs.apollo_table_end == "extrapolated":
            line = interp1d(velocity[nodes[1:3]], followed[1:3].T, fill_value="extrapolate")
            followed[0] = line(velocity[nodes[0]])
        return interp1d(velocity[nodes], np.hstack([gains, followed]).T)

    def cosine(self, cycle, state):
        inputs, model, velocity = self.inputs, self.model, state[1]
        ends = np.cos([inputs.nominal_bank_slow, inputs.nominal_bank_fast])
        nominal = np.interp(velocity, inputs.ramp_velocities[::-1], ends)
        if self.law == "apollo":
            x = self.fed_back(state)
            low, high = self.table.x[[0, -1]]
            row = self.table(np.clip(velocity, low, high))
            slowing = x[5] * velocity > -inputs.gravitational_parameter / x[0] ** 2 * x[6]
            active = (x[5] >= inputs.apollo_least_drag) & (velocity <= high) & slowing
            return np.clip(nominal + active * dot(row[:7], x - row[7:]), -1.0, 1.0)
        gain = self.gains.stochastic_gain[self.number]
        if cycle >= len(gain):
            return np.full_like(velocity, np.cos(inputs.nominal_bank_slow))
        reference = model.state[cycle][:, np.newaxis]
        return np.clip(model.bank_cosine[cycle] + gain[cycle] @ (state - reference), -1.0, 1.0)

    def alignment(self, state, distance, crossrange):
        inputs = self.inputs
        limit = np.where(state[1] >= inputs.heading_alignment_limit_velocity, *inputs.heading_alignment_limits)
        return np.clip(-inputs.heading_alignment_gain * np.arctan(crossrange / distance), -limit, limit)

    # ---- flights -----------------------------------------------------------------------------------------------------

    def fly(self, end_time, substeps):
        """Final altitude, velocity, path angle, downrange, density, crossrange, time, reversals, (8, n)."""
        inputs, n = self.inputs, len(self.trials)
        most, full = np.zeros(n), inputs.bank_rate_limit * inputs.guidance_period
        within = self.law == "apollo" and inputs.apollo_end == "at_passage"
        position, velocity = self.start()
        direction = np.full(n, float(inputs.initial_bank_direction))
        aligning, flying = np.zeros(n, bool), np.ones(n, bool)
        reversals, self.margin, bank = np.zeros(n), np.full(n, np.inf), None
        final = np.full((8, n), np.nan)

        def finish(trials, time, *at):
            state, _, crossrange = self.features(time, *at)
            state[0] -= inputs.planet_radius
            final_states = np.vstack([state, inputs.planet_radius * crossrange, np.full(n, time), reversals])
            final[:, trials] = final_states[:, trials]

        time, cycle = 0.0, 0
        while flying.any() and time < end_time - 1e-9:
            state, distance, crossrange = self.features(time, position, velocity)
            aligning |= state[1] <= inputs.heading_alignment_velocity
            width = np.interp(time, inputs.deadband_times, inputs.deadband_widths)
            beyond = direction * crossrange * inputs.planet_radius - width
            steered = flying & ~aligning
            self.margin[steered] = np.minimum(self.margin, np.abs(beyond))[steered]
            turned = steered & (beyond > 0)
            direction[turned] *= -1
            reversals[turned] += 1
            command = np.where(
                aligning,
                self.alignment(state, distance, crossrange),
                direction * np.arccos(self.cosine(cycle, state)),
            )
            bank = command if bank is None else bank + np.clip(command - bank, -most, most)
            most = np.full(n, full)
            span = min(inputs.guidance_period, end_time - time)
            h = span / substeps
            for substep in range(substeps):
                before, after = (position, velocity), self.step(position, velocity, bank, h)
                if self.trigger == "velocity":
                    for trial in np.flatnonzero(flying & (self.speed(*after) <= inputs.end_velocity)):
                        part = brentq(self.excess, 0.0, h, args=(trial, before, bank), xtol=1e-12)
                        finish(trial, time + substep * h + part, *self.step(*before, bank, part))
                        flying[trial] = False
                position, velocity = after
                passing = flying & ~aligning & (self.speed(*after) <= inputs.heading_alignment_velocity)
                if within and passing.any() and substep + 1 < substeps:
                    part = (substep + 1) / substeps
                    command = self.alignment(*self.features(time + part * span, *after))
                    turned = bank + np.clip(command - bank, -part * full, part * full)
                    bank, aligning = np.where(passing, turned, bank), aligning | passing
                    most[passing] = (1.0 - part) * full
            time, cycle = time + span, cycle + 1
        if self.trigger == "time":
            finish(slice(None), time, position, velocity)
        return final

    def excess(self, part, trial, before, bank):
        """Velocity above the trigger's after a part of a step."""
        return self.speed(*self.step(*before, bank, part))[trial] - self.inputs.end_velocity


# --- the kernel against the oracle --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "case"),
    [
        ({}, "apollo_time"),
        ({}, "stochastic_velocity"),
        ({"apollo_form": "drag"}, "apollo_velocity"),
        ({"apollo_form": "density_blind", "apollo_end": "at_passage", "apollo_table_end": "held"}, "apollo_velocity"),
        ({"apollo_end": "at_passage", "apollo_table_end": "extrapolated"}, "apollo_time"),
    ],
)
def test_kernel_flies_the_vectors_of_the_oracle(entry, changes, case):
    trials, substeps = np.arange(LANES), 20
    inputs, laws = entry.inputs("corrected", **changes), entry.gains(**changes)
    oracle = Oracle(inputs, entry.linearization(), laws, case, trials)
    end_time = entry.nominal().end_time if case.endswith("time") else inputs.time_limit
    expected = oracle.fly(end_time, substeps)
    simulate = entry.simulator(case, changes={"gains": laws}, **{"flight_substeps": substeps} | changes)
    trajectories = simulate(0, len(trials))
    # Each formulation has the truncation error of its own coordinates: micrometres with 20 steps a second, tenths of a
    # millimetre where a density knot is met badly. A trial that close to the deadband could turn a second apart.
    assert (oracle.margin > 1e-2).all()
    final_states = trajectories.final_state
    tolerance = np.array([1e-3, 1e-5, 1e-7, 1e-3, 1e-10, 1e-4, 1e-5, 0.0])  # m, m/s, rad, m, kg/m^3, m, s, 1
    np.testing.assert_array_less(np.abs(final_states[:8] - expected).max(axis=1), tolerance + 1e-300)
    assert (trajectories.outcome == COMPLETED).all()


# --- density ----------------------------------------------------------------------------------------------------------


def density_over_mean(entry, trajectories):
    """Ratio of the met density to the table's mean at the stored states, (times, trials)."""
    air = entry.stage_inputs("corrected", "montecarlo").call(environment.atmosphere)
    mean = np.exp(np.interp(trajectories.history[:, records.ALTITUDE], air.altitude, air.log_density))
    return trajectories.history[:, records.DENSITY] / mean


def test_density_met_is_the_exact_sampler_of_the_same_stream(entry):
    inputs = entry.stage_inputs("corrected", "montecarlo")
    air, trials = inputs.call(environment.atmosphere), np.arange(100, 300)
    factor, _ = density_factors(inputs, air, trials)
    trajectories = entry.simulator("apollo_time")(100, 300)
    altitude = trajectories.history[:, records.ALTITUDE]
    expected = np.stack([np.interp(h, air.altitude, f) for h, f in zip(altitude.T, factor, strict=True)], axis=1)
    np.testing.assert_allclose(density_over_mean(entry, trajectories), expected, rtol=1e-11, atol=1e-13)


def test_negative_densities_are_set_to_zero_and_counted(entry):
    inputs = entry.stage_inputs("corrected", "montecarlo")
    air = inputs.call(environment.atmosphere)
    _, negative = density_factors(inputs, air, np.arange(1000))
    trajectories = entry.simulator("apollo_time")(0, 1000)
    np.testing.assert_array_equal(trajectories.final_state[records.NEGATIVE_DENSITIES], negative.sum(axis=1))
    # At entry the deviation is 38 %, so that 1 in 200 samples is below -1; the flight meets a vacuum there.
    at_entry = negative[:, air.altitude == 125e3][:, 0]
    np.testing.assert_array_equal(trajectories.history[0, records.DENSITY] == 0.0, at_entry)
    assert at_entry.mean() == pytest.approx(stats.norm.cdf(-1 / np.sqrt(0.148)), abs=4 * np.sqrt(0.005 / 1000))
    # Below 80 km never: more than seven standard deviations.
    assert not negative[:, air.altitude < 80e3].any()


def test_density_variations_met_in_flight_are_the_process_of_remark_ii_1(entry):
    """Normalized variations have unit variance, and forget as exp(-integral of 2/H), over 2,000 flights."""
    trials = 2000
    trajectories = entry.simulator("apollo_time")(0, trials)
    inputs = entry.stage_inputs("corrected", "montecarlo")
    altitude = trajectories.history[:, records.ALTITUDE]
    deviation = np.sqrt(0.148 * np.exp((np.minimum(altitude, 120e3) - 120e3) / 20e3))
    process = (density_over_mean(entry, trajectories) - 1.0) / deviation
    # Interpolation between nodes of correlation exp(-200 m/H) takes up to 1.3 % of the variance away in the middle.
    error = 4 * np.sqrt(2 / trials)
    variance = process[20:].var(axis=1, ddof=1)  # before 20 s negative densities are cut off
    assert variance.max() < 1 + error and variance.min() > 1 - error - 0.014
    log_density = inputs.call(environment.profile)
    for first, last in ((22, 23), (22, 24), (40, 42), (60, 64), (70, 90)):
        # lambda = 2/H, and ln density is the integral of 1/H.
        retained = np.exp(2 * (log_density(altitude[first].mean())[0] - log_density(altitude[last].mean())[0]))
        correlation = np.corrcoef(process[first], process[last])[0, 1]
        # Four standard errors of a correlation, and what the smoothing of interpolation may add.
        assert correlation == pytest.approx(retained, abs=4 * (1 - retained**2) / np.sqrt(trials) + 0.014)
