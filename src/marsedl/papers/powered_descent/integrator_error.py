"""Error of the integrators against their step, on shared Brownian paths."""

import numpy as np

from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.inputs import Design, Ensemble, Entry, Mission, Noise, Planet, Studies, Vehicle
from marsedl.papers.powered_descent.records import Gains, IntegratorError
from marsedl.replication.catalogue import stage

REFINEMENT = (2, 5, 10, 20, 50)  # reference steps in one step of the tested runs
SCHEMES = ("rk4", "euler_maruyama")


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    entry: Entry,
    mission: Mission,
    noise: Noise,
    design: Design,
    ensemble: Ensemble,
    studies: Studies,
    gains: Gains,
) -> IntegratorError:
    """Fly the same trials with both schemes and several steps."""
    durations = mission.segment_durations
    coarsest = REFINEMENT[-1] * studies.finest_time_step
    # Every tested step must divide the segments; the reference step is then a little below the one asked for.
    counts = [REFINEMENT[-1] * int(np.ceil(d / coarsest - 1e-9)) for d in durations]
    times = segments.grids(durations, design.design_interval)
    plant = flight.plant_of(planet, vehicle, noise)
    start = flight.Start(segments.initial_mean(entry), entry.initial_covariance, vehicle.wet_mass)
    states = flight.initial_states(start, ensemble.seed, np.arange(studies.convergence_trials))

    def final_states(scheme, refinement):
        """Final states (trials, 5) of a run whose steps hold `refinement` increments of the reference run."""
        schedules = flight.schedules_of(times, gains, [count // refinement for count in counts])
        draws = flight.Draws(ensemble.seed, increments=refinement)
        every = [schedule.steps for schedule in schedules]
        trajectories = flight.fly(schedules, plant, states, draws, steps_per_output=every, integrator=scheme)
        return trajectories.final_state.T.copy()

    reference = final_states("rk4", 1)
    differences = np.array([[final_states(scheme, q) - reference for q in REFINEMENT] for scheme in SCHEMES])
    variance = reference.var(axis=0, ddof=1)
    step = max(d / n for d, n in zip(durations, counts, strict=True))
    return IntegratorError(
        scheme=np.array(SCHEMES),
        step=step * np.array(REFINEMENT),
        reference_step=float(step),
        trials=len(reference),
        strong_error=np.sqrt((differences**2).mean(axis=2)),
        bias=differences.mean(axis=2),
        bias_standard_error=differences.std(axis=2, ddof=1) / np.sqrt(len(reference)),
        variance_bias=(reference + differences).var(axis=2, ddof=1) / variance - 1,
    )
