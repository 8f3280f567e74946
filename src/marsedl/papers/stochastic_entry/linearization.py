"""Linear model of the longitudinal motion and the density along the nominal flight (Sec. III.A, Eqs. 30-44, 65)."""

import numpy as np

from marsedl.methods.guidance.apollo import density_slaved_matrix
from marsedl.methods.guidance.bank_profile import ramped_bank_cosine, ramped_bank_cosine_slope
from marsedl.methods.guidance.longitudinal import linear_model
from marsedl.methods.lincov import discretize
from marsedl.methods.linear_system import LinearSystem
from marsedl.methods.state_trigger import trigger_projection
from marsedl.models.dynamics.longitudinal_entry import density_noise_intensity, longitudinal_entry_rates
from marsedl.papers.stochastic_entry import dispersions, environment
from marsedl.papers.stochastic_entry.inputs import Inputs
from marsedl.papers.stochastic_entry.objective import TRIGGER_NORMAL
from marsedl.papers.stochastic_entry.records import STATES, Linearization, Nominal
from marsedl.replication.pipeline.catalogue import stage


def system(linearization) -> LinearSystem:
    """The discrete system of an artifact."""
    control = linearization.control[:, :, np.newaxis]
    no_rest = np.zeros_like(linearization.control)
    return LinearSystem(linearization.transition, control, linearization.noise, no_rest, linearization.time)


@stage()
def compute(given: Inputs, nominal: Nominal) -> Linearization:
    """Linearise at the midpoints of pairs of integration steps, and discretise over the guidance periods."""
    planet, air = given.planet, given.air
    steps = given.simulation.nominal_substeps
    bounds = np.append(np.arange(0, len(nominal.time) - 1, steps), len(nominal.time) - 1)
    middles = bounds[:-1, np.newaxis] + np.arange(1, steps, 2)
    states = np.column_stack(
        [
            nominal.altitude + planet.planet_radius,
            nominal.velocity,
            nominal.flight_path_angle,
            nominal.downrange,
            nominal.density,
        ]
    )
    _, slope, curvature = environment.profile(air)(nominal.altitude)
    profile = (
        *given.guidance.ramp_velocities,
        np.cos(given.guidance.nominal_bank_fast),
        np.cos(given.guidance.nominal_bank_slow),
    )
    ramp = ramped_bank_cosine(nominal.velocity, *profile)
    aligned = nominal.time >= nominal.alignment_time
    cosine = np.where(aligned, np.cos(nominal.bank), ramp)
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    constants = (drag_factor, lift_factor, planet.gravitational_parameter)

    at = middles.ravel()
    state_matrix, control_matrix = linear_model(
        states[at], cosine[at], nominal.density[at], -slope[at], -curvature[at], air.decay_factor, *constants
    )
    control_matrix[aligned[at]] = 0.0
    radius_rate = nominal.velocity[at] * np.sin(nominal.flight_path_angle[at])
    diffusion = environment.diffusion(air, nominal.altitude[at])
    intensity = np.zeros((len(at), STATES, STATES))
    intensity[:, -1, -1] = density_noise_intensity(nominal.density[at], diffusion, radius_rate)
    span = np.diff(nominal.time[bounds])
    shape = middles.shape
    discrete = discretize(
        state_matrix.reshape(*shape, STATES, STATES),
        control_matrix.reshape(*shape, STATES, 1),
        intensity.reshape(*shape, STATES, STATES),
        span,
    )
    slaved = density_slaved_matrix(state_matrix, -slope[at], nominal.density[at])
    blind = discretize(
        slaved.reshape(*shape, 4, 4), control_matrix[:, :4].reshape(*shape, 4, 1), np.zeros((*shape, 4, 4)), span
    )

    mean = nominal.density[-1], -slope[-1], -air.decay_factor * slope[-1]
    final_rates = np.array(longitudinal_entry_rates(states[-1:].T, cosine[-1:], *mean, *constants))[:, 0]
    deviations = dispersions.entry_deviations(planet, given.mission)
    initial = np.array(
        [
            0.0,
            deviations[dispersions.SPEED],
            deviations[dispersions.PATH_ANGLE],
            deviations[dispersions.LONGITUDE] * planet.planet_radius,
            nominal.density[0] * np.sqrt(environment.variance(air, nominal.altitude[0])),
        ]
    )
    return Linearization(
        time=nominal.time[bounds],
        state=states[bounds],
        slope=np.gradient(states[bounds], nominal.time[bounds], axis=0),
        bank_cosine=ramp[bounds],
        bank_cosine_slope=ramped_bank_cosine_slope(nominal.velocity[bounds], *profile),
        drag=nominal.drag[bounds],
        inverse_scale_height=-slope[bounds],
        transition=discrete.transition,
        control=discrete.control[:, :, 0],
        noise=discrete.noise,
        slaved_transition=blind.transition,
        slaved_control=blind.control[:, :, 0],
        initial_covariance=np.diag(initial**2),
        final_rates=final_rates,
        trigger_projection=trigger_projection(final_rates, TRIGGER_NORMAL),
    )
