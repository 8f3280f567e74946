"""The powered descent of Ridderhof and Tsiotras as the common example of the steering tests."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from marsedl.methods.covariance_steering.closed_form import SteeringProblem, steer


class Descent:
    """Both segments of the descent on a mass profile; segment 0 lasts 26 s, segment 1 15 s."""

    durations = (26.0, 15.0)
    gravity, wet_mass, maximum_thrust = 3.71, 1500.0, 18000.0
    mass_flow_constant = 1 / (210 * 9.81)
    noise_density = 0.02 * maximum_thrust
    sine, cosine = np.sin(np.radians(70)), np.cos(np.radians(70))
    means = np.array([[250, 500, 50 * sine, -50 * cosine], [50, 150, 0, -5], [100, 50, 0, 0]])
    variances = np.array([[40, 40, 5, 5], [10, 10, 1, 1], [5, 0.25, 0.25, 0.25]])
    state_matrix = np.eye(4, k=2)
    affine = np.array([0, 0, 0, -gravity])

    def __init__(self, cell=0.01):
        self.grids = [np.linspace(0, duration, round(duration / cell) + 1) for duration in self.durations]
        self.masses = [np.full(len(grid), self.wet_mass) for grid in self.grids]

    def problem(self, segment, **changes):
        """One segment; `changes` replace arguments of the problem."""
        time = self.grids[segment]
        arguments = {
            "initial_mean": self.means[segment],
            "final_mean": self.means[segment + 1],
            "initial_covariance": np.diag(self.variances[segment]),
            "final_covariance": np.diag(self.variances[segment + 1]),
            "noise_density": self.noise_density,
            "transition": np.eye(4) + self.state_matrix * time[:, None, None],
        }
        control_matrix = np.eye(4, 2, k=-2) / self.masses[segment][:, None, None]
        return SteeringProblem.from_linear_model(
            time, (self.state_matrix, control_matrix, self.affine), **(arguments | changes)
        )

    def axis(self, segment, axis, **changes):
        """The downrange (0) or altitude (1) axis of a segment alone: the axes do not couple."""
        problem, pick = self.problem(segment, **changes), np.array([axis, axis + 2])
        matrices = np.ix_(np.arange(len(problem.time)), pick, pick)
        return SteeringProblem(
            time=problem.time,
            transition=problem.transition[matrices],
            gramian=problem.gramian[matrices],
            affine_response=problem.affine_response[:, pick],
            control_matrix=problem.control_matrix[:, pick, axis : axis + 1],
            initial_mean=problem.initial_mean[pick],
            final_mean=problem.final_mean[pick],
            initial_covariance=problem.initial_covariance[np.ix_(pick, pick)],
            final_covariance=problem.final_covariance[np.ix_(pick, pick)],
            noise_density=problem.noise_density,
        )

    def model(self, segment):
        """A(t), B(t), c(t) as functions of time."""
        mass, input_matrix = CubicSpline(self.grids[segment], self.masses[segment]), np.eye(4, 2, k=-2)
        return lambda t: self.state_matrix, lambda t: input_matrix / mass(t), lambda t: self.affine

    def iterate_mass(self, passes, initial_mean=None):
        """Algorithm 3 along the mean control, m' = -alpha |feedforward|; returns the final mass of each pass."""
        final_masses = []
        for _ in range(passes):
            start, masses = self.wet_mass, []
            for segment, grid in enumerate(self.grids):
                changes = {"initial_mean": initial_mean} if segment == 0 and initial_mean is not None else {}
                thrust = np.linalg.norm(steer(self.problem(segment, **changes)).feedforward, axis=1)
                masses.append(start - self.mass_flow_constant * CubicSpline(grid, thrust).antiderivative()(grid))
                start = masses[-1][-1]
            self.masses = masses
            final_masses.append(start)
        return np.array(final_masses)


@pytest.fixture(scope="session")
def new_descent():
    """A descent that may be changed: `new_descent(cell)` starts from constant mass."""
    return Descent


@pytest.fixture(scope="session")
def descent():
    """The descent at the fixed point of the mass iteration, not to be changed."""
    base_case = Descent()
    base_case.iterate_mass(8)
    return base_case


@pytest.fixture(scope="session")
def steerings(descent):
    """The optimal steering of both segments."""
    return [steer(descent.problem(segment)) for segment in range(2)]
