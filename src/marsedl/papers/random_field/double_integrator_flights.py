"""Monte Carlo of the double integrator in samples of the force over position, open and closed loop (Fig. 5)."""

from dataclasses import replace

import numpy as np

from marsedl.models import random_field
from marsedl.montecarlo import ensembles
from marsedl.montecarlo.streams import normals
from marsedl.papers.random_field import flight
from marsedl.papers.random_field.double_integrator import covariance_root, kernel, normals_and_bounds
from marsedl.papers.random_field.inputs import PointMass, Simulation
from marsedl.papers.random_field.records import DoubleIntegrator, DoubleIntegratorFlights
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(
    simulation: Simulation, point_mass: PointMass, double_integrator: DoubleIntegrator
) -> DoubleIntegratorFlights:
    """Fly both laws."""
    trials = point_mass.double_integrator_trials
    first = min(simulation.paper_trials, trials)
    bounds = [(0, first)] + ([(first, trials)] if trials > first else [])
    block = first if first < ensembles.BLOCK_SIZE else int(np.gcd(first, ensembles.BLOCK_SIZE))
    edges = np.tile([-1.0, 0.0], (3, 1))  # what is counted beyond the upper edge violates a constraint
    laws = []
    for number in range(len(double_integrator.control)):
        simulate_block = block_simulator(simulation, point_mass, double_integrator, number)
        chunks = [
            ensembles.run_blocks(
                simulate_block, *bound, block_size=block, histogram_edges=edges, kept=simulation.drawn_trials
            )
            for bound in bounds
        ]
        laws.append((ensembles.merge(chunks), chunks[0]))
    time = outputs(point_mass)
    node = np.rint(
        np.array(point_mass.double_integrator_partition) / point_mass.double_integrator_output_interval
    ).astype(int)

    def beyond(reduced):
        return reduced["histogram"][node, :, -1]

    every, paper = np.array([beyond(both) for both, _ in laws]), np.array([beyond(one) for _, one in laws])
    return DoubleIntegratorFlights(
        time=time,
        node=node,
        violations=every[..., :2],
        paper_violations=paper[..., :2],
        any_violations=every[..., 2],
        paper_any_violations=paper[..., 2],
        paper_trials=first,
        **{
            name: np.array([both[name] for both, _ in laws])
            for name in ("count", "excluded", "mean", "covariance", "kept_history")
        },
    )


def outputs(point_mass: PointMass):
    """Times of the stored states."""
    steps = round(point_mass.double_integrator_partition[-1] / point_mass.double_integrator_output_interval)
    return np.arange(steps + 1) * point_mass.double_integrator_output_interval


def field_grid(point_mass: PointMass):
    """Positions at which the force is sampled."""
    lowest, highest = point_mass.double_integrator_field_positions
    return np.linspace(lowest, highest, round((highest - lowest) / point_mass.double_integrator_field_interval) + 1)


def law(design, number):
    """The law that flights fly: OPEN or CLOSED."""
    return flight.Law(design.partition, design.control[number], design.gain[number], design.mean[number])


def block_simulator(
    simulation: Simulation, point_mass: PointMass, double_integrator: DoubleIntegrator, number, varied=True
):
    """Return the function `simulate_block(first, last)` under one law.

    Observed are how far the state lies beyond each of the two lines, and the larger of both. number: OPEN or
    CLOSED. varied: whether there is a force.
    """
    grid = field_grid(point_mass)
    root = random_field.root(random_field.covariance_matrix(kernel(point_mass), grid))
    flown_law = law(double_integrator, number)
    initial_root = covariance_root(
        point_mass.double_integrator_initial_three_sigma, point_mass.double_integrator_initial_correlation
    )
    lines, bounds = normals_and_bounds(point_mass)
    every = round(point_mass.double_integrator_output_interval / point_mass.double_integrator_time_step)

    def simulate_block(first, last):
        normal_numbers = normals(simulation.seed, flight.INITIAL_STREAM, np.arange(first, last), 2)
        trajectories = flight.fly_double_integrator(
            flown_law,
            grid,
            root,
            np.array(point_mass.double_integrator_initial_mean) + random_field.sample(normal_numbers, initial_root),
            time_step=point_mass.double_integrator_time_step,
            seed=simulation.seed,
            first_trial=first,
            every=every,
            varied=varied,
            mean=point_mass.double_integrator_force_mean,
        )
        excess = np.einsum("ci,tin->tcn", lines, trajectories.history[:, :2]) - bounds[:, np.newaxis]
        observed = np.concatenate([excess, excess.max(axis=1, keepdims=True)], axis=1)
        return replace(trajectories, observed=observed, observed_maximum=observed.max(axis=0))

    return simulate_block
