"""What guidance knows before the flight: vehicle, start and targets, the reference of the paper, and gains about it.

States are downrange, crossrange, altitude (of the ground: 0) and their rates, (6,). The paper's law lies in the plane.
Its cost and its end conditions do not couple the axes, so that the law across is that of the downrange axis about zero.
"""

from functools import cached_property

import numpy as np

from marsedl.fly import GainTable
from marsedl.methods.tvlqr import tvlqr
from marsedl.papers.powered_descent import inputs, linearization, nominal, segments
from marsedl.scenarios.descent.dynamics import Forces, Parameters, State, Thrust, Vehicle, rates
from marsedl.scenarios.descent.inputs import Lander

__all__ = ["Onboard", "in_space"]

STATES, COMMANDS = State._fields[:6], Thrust._fields
PLANE, DOWNRANGE, ACROSS = [0, 2, 3, 5], [0, 3], [1, 4]  # places among the six


def in_space(planar):
    """Of states in the plane, (..., 4), those in space, (..., 6); of the covariance of one, (4, 4), likewise."""
    planar = np.asarray(planar, float)
    if planar.shape == (4, 4):
        whole = np.zeros((6, 6))
        whole[np.ix_(PLANE, PLANE)] = planar
        whole[np.ix_(ACROSS, ACROSS)] = planar[np.ix_([0, 2], [0, 2])]
        return whole
    whole = np.zeros((*planar.shape[:-1], 6))
    whole[..., PLANE] = planar
    return whole


class Onboard:
    """What laws are designed from. It knows neither dispersions of the vehicle nor gusts nor errors of navigation.

    given: inputs of the powered descent. lander: what is known beside them.
    """

    def __init__(self, given: inputs.Inputs, lander: Lander):
        """Take its inputs."""
        self.given, self.lander = given, lander

    @cached_property
    def p(self) -> Parameters:
        """Of the vehicle and the planet."""
        vehicle, lander = self.given.vehicle, self.lander
        return Parameters(
            gravity=self.given.planet.gravity,
            mass_flow=segments.mass_flow(vehicle),
            dry_mass=vehicle.wet_mass - lander.propellant,
            noise=segments.plant_noise_density(self.given.noise),
        )

    @cached_property
    def vehicle(self) -> Vehicle:
        """The vehicle without errors."""
        return Vehicle(self.lander.smallest_thrust, self.given.vehicle.maximum_thrust)

    @cached_property
    def time(self) -> np.ndarray:
        """Bounds of the guidance cycles until the paper's final time, (N + 1,), s."""
        duration = float(sum(self.given.mission.segment_durations))
        return np.linspace(0.0, duration, round(duration / self.lander.cycle) + 1)

    def _above_ground(self, state):
        """In space, with the altitude counted from the ground."""
        whole = in_space(state)
        whole[..., 2] -= self.lander.ground
        return whole

    @cached_property
    def start(self) -> np.ndarray:
        """Mean start, (6,)."""
        return self._above_ground(segments.initial_mean(self.given.entry))

    @cached_property
    def goal(self) -> np.ndarray:
        """Mean that the paper ends with, at rest above the target, (6,)."""
        return self._above_ground(self.given.mission.final_mean)

    @cached_property
    def start_covariance(self) -> np.ndarray:
        """(6, 6)."""
        return in_space(self.given.entry.initial_covariance)

    @cached_property
    def goal_covariance(self) -> np.ndarray:
        """(6, 6)."""
        return in_space(self.given.mission.final_covariance)

    @cached_property
    def nominal(self):
        """The paper's mean trajectory and mass profile (Algorithm 3)."""
        return nominal.compute(self.given)

    @cached_property
    def linearization(self):
        """The paper's linear model along the mass profile."""
        return linearization.compute(self.given, self.nominal)

    def mass(self, time) -> np.ndarray:
        """Mass on the paper's mean trajectory, kg."""
        return np.interp(time, self.nominal.time, self.nominal.mass)

    def over_cycles(self, time, command, lead=0.0) -> np.ndarray:
        """Commands to hold over each cycle: the mean of a profile over it, or over a time that is later by the lead.

        Args:
            time: of the profile, (k,), s; with jumps. command: (k, m), or (k - 1, m) held from each to the next.
            lead: s; that of the lag lets the thrust act when it should.

        Returns:
            (N, m).
        """
        means = command if len(command) < len(time) else 0.5 * (command[1:] + command[:-1])
        impulse = np.concatenate([np.zeros((1, means.shape[1])), np.cumsum(means * np.diff(time)[:, None], axis=0)])
        time, impulse = np.append(time, time[-1] + 1.0), np.vstack([impulse, impulse[-1] + means[-1]])  # goes on
        return np.diff([np.interp(self.time + lead, time, part) for part in impulse.T], axis=1).T / self.lander.cycle

    @cached_property
    def reference(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the paper's mean trajectory: commands over the cycles, (N, 3), and states at their bounds, (N + 1, 6)."""
        command = np.insert(self.nominal.feedforward, 1, 0.0, axis=1)
        states = [np.interp(self.time, self.nominal.time, part) for part in self.nominal.mean.T]
        commands = self.over_cycles(self.nominal.time, command, self.lander.lag)
        return commands, self._above_ground(np.stack(states, axis=1))

    @cached_property
    def vectors(self):
        """The equations as a function of numbers, for `methods.step_map`."""
        from marsedl.methods.step_map import in_vectors

        return in_vectors(rates, vehicle=self.vehicle, p=self.p, noise=Forces)

    def flown(self, commands) -> np.ndarray:
        """States at the bounds of the cycles under commands without feedback or lag, and the mass, (N + 1, 7)."""
        from marsedl.design.reference import fly_held

        start = [*self.start, self.given.vehicle.wet_mass]
        return fly_held(self.vectors, start, commands, self.time, substeps=1)

    def regulated(self, mass, position_weight, velocity_weight) -> np.ndarray:
        r"""Gains of the time-varying linear-quadratic regulator along a mass profile, (N, 3, 6).

        The cost is that of position and velocity over the deviations of the goal, weighed, and of the thrust over the
        weight, per second; at the end, of all of them over the deviations of the goal.

        Args:
            mass: at the bounds of the cycles, (N + 1,), kg. position_weight, velocity_weight: 1/s.
        """
        count = len(mass) - 1
        state, control = np.zeros((count, 6, 6)), np.zeros((count, 6, 3))
        state[:, :3, 3:] = np.eye(3)
        control[:, 3:] = np.eye(3) / (0.5 * (mass[1:] + mass[:-1]))[:, None, None]
        final = np.diag(1.0 / np.diag(self.goal_covariance))
        weights = np.repeat([position_weight, velocity_weight], 3)[:, None] * final
        effort = np.eye(3) / (self.given.vehicle.wet_mass * self.given.planet.gravity) ** 2
        return tvlqr(state, control, np.diff(self.time), weights, effort, final).gains

    def table(self, commands, states, gains) -> GainTable:
        """A law over time, and after the final time that which sinks to the ground.

        Args:
            commands: (N, 3), N. states: references, (N + 1, 6) or (N, 6). gains: (N, 3, 6).
        """
        mass, lander = self.mass(self.time[-1]), self.lander
        weight = mass * self.given.planet.gravity
        sinking = np.zeros((1, 3, 6))
        sinking[0, :, 3:] = -mass * lander.sink_gain * np.eye(3)
        commands = np.vstack([commands, [0.0, 0.0, weight]])
        states = np.vstack([states[: len(gains)], [*self.goal[:5], -lander.sink_speed]])
        gains = np.concatenate([gains, sinking])
        columns = {"time": self.time} | dict(zip(COMMANDS, commands.T, strict=True))
        columns |= dict(zip(STATES, states.T, strict=True))
        for row, command in enumerate(COMMANDS):
            columns |= {f"{command}_per_{name}": gains[:, row, place] for place, name in enumerate(STATES)}
        return GainTable(columns, against="time")
