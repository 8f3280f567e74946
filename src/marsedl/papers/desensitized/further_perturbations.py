"""Density, entry velocity and flight path angle beside the position at entry: the next step that Sec. 4.3 announces.

Density is a factor on the whole profile. In the norm that is made small its error counts like the radius error of
Table 3, so that weights compare: the norm is the final position error for `density_error` over `tabulated_error`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.methods import sensitivity_gains
from marsedl.methods.desensitization import Perturbation, column
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.papers.desensitized import entry_problem, environment, flight
from marsedl.papers.desensitized.entry_problem import (
    BANK,
    MEASURED,
    POSITIONS,
    STATES,
    WARM,
    Setup,
    Trajectory,
    gain_vector,
)
from marsedl.papers.desensitized.gains import gain_problem, reference
from marsedl.papers.desensitized.inputs import Design, Mission, Planet, Simulation, Solver, Studies, Vehicle
from marsedl.papers.desensitized.linearization import model, position_columns, position_rows
from marsedl.papers.desensitized.nominal import as_guess
from marsedl.papers.desensitized.records import DENSITY, PERTURBATIONS, FurtherPerturbations, Nominal, Tradeoff
from marsedl.papers.desensitized.tradeoff import Point, effort, final_error, follow
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError

ALL = tuple(range(len(PERTURBATIONS)))
RADIUS = PERTURBATIONS.index("radius")
NO_FEEDBACK, NULL, BOTH_NULL, TUNED, BOTH_TUNED = LAWS = (
    *("no feedback", "density null", "density and radius null"),
    *("density tuned", "density and radius tuned"),
)
DENSITY_FRACTIONS = (0.02, 0.2, 1.0, 2.0)  # of the density error, flown either way under every law
RADIUS_FRACTIONS = TUNED_FRACTIONS = (0.2, 1.0)  # likewise of the radius error; of the density error when tuning
BOTH_WAYS = np.array([1.0, -1.0])


class Study(NamedTuple):
    """The entry with what is perturbed, and how it is flown."""

    setup: Setup
    simulation: Simulation
    studies: Studies


class Law(NamedTuple):
    """Gains and how the search for them ended."""

    scaled_gain: np.ndarray
    converged: bool
    ended: str


class FlownErrors(NamedTuple):
    """Errors that are flown under every law, one after the other."""

    density: np.ndarray  # relative
    radius: np.ndarray  # m


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    solver: Solver,
    design: Design,
    simulation: Simulation,
    studies: Studies,
    nominal: Nominal,
    tradeoff: Tradeoff,
) -> FurtherPerturbations:
    """Perturb the rows of Table 3 in other ways, desensitize the nominal against density, and feed back against it."""
    study = Study(Setup(planet, vehicle, mission, solver, design), simulation, studies)
    air = environment.surroundings(planet, vehicle)
    rows = entry_problem.of_rows(tradeoff)
    points, designs, path_end, extended = density_path(study, nominal)
    plain = entry_problem.of_nominal(nominal)
    laws = list(density_feedback(study, air, plain))
    errors = FlownErrors(
        studies.density_error * np.kron(DENSITY_FRACTIONS, BOTH_WAYS),
        simulation.tabulated_error * np.kron(RADIUS_FRACTIONS, BOTH_WAYS),
    )
    under_laws = [under_law(study, air, plain, law, errors) for law in laws]
    solutions = [point.solution for point in points]
    designed = [entry_problem.of_solution(point.solution) for point in designs]
    totals = [entry_problem.cumulative(t.time, t.bank_acceleration) for t in designed]
    firsts = [next(p for p in points if p.branch == number) for number in range(points[-1].branch + 1)]
    return FurtherPerturbations(
        perturbation=np.array(PERTURBATIONS),
        size=sizes(simulation, studies),
        row_weight=tradeoff.weight,
        row_linear_error=np.array([linear_errors(study, row) for row in rows]),
        row_flown_error=np.array([flown_errors(study, air, row) for row in rows]),
        path_weight=np.array([s.given["weight"] for s in solutions]),
        path_effort=np.array([effort(s) for s in solutions]),
        path_cumulative=np.array([entry_problem.cumulative(s.time, s.controls[:, 0]) for s in solutions]),
        path_error=np.array([final_error(planet, simulation, extended, s) for s in solutions]),
        path_reversals=np.array([entry_problem.reversals(s.state("bank")) for s in solutions]),
        path_branch=np.array([point.branch for point in points]),
        branch=np.array([entry_problem.branch_name(point.solution.state("bank")) for point in firsts]),
        path_end=path_end,
        design_weight=np.array([point.solution.given["weight"] for point in designs]),
        design_time=np.array([t.time for t in designed]),
        design_bank=np.array([t.state[:, BANK] for t in designed]),
        design_bank_acceleration=np.array([t.bank_acceleration for t in designed]),
        design_effort=np.array([effort(point.solution) for point in designs]),
        design_cumulative=np.array(totals),
        design_propellant=np.array([entry_problem.propellant(vehicle, total) for total in totals]),
        design_branch=np.array([point.branch for point in designs]),
        design_linear_error=np.array([linear_errors(study, t) for t in designed]),
        design_flown_error=np.array([flown_errors(study, air, t) for t in designed]),
        law=np.array(LAWS),
        scaled_gain=np.array([law.scaled_gain for law in laws]),
        gain=np.array([gain_vector(planet, design, law.scaled_gain) for law in laws]),
        converged=np.array([law.converged for law in laws]),
        ended=np.array([law.ended for law in laws]),
        density_error=errors.density,
        radius_error=errors.radius,
        **{name: np.array([of_law[name] for of_law in under_laws]) for name in under_laws[0]},
    )


# ---- perturbations ---------------------------------------------------------------------------------------------------


def sizes(simulation: Simulation, studies: Studies):
    """Sizes of the perturbations, (6,)."""
    position = [simulation.tabulated_error] * 3
    return np.array([studies.density_error, studies.velocity_error, studies.path_angle_error, *position])


def directions(planet: Planet, mission: Mission):
    """Change of the state at entry per unit of the perturbations, (8, 6); that of the density changes none."""
    speed, climb, heading = mission.entry_velocity, mission.entry_flight_path_angle, mission.entry_azimuth
    towards = np.array([np.cos(heading), np.sin(heading)])  # north, east
    changes = np.zeros((len(STATES), len(PERTURBATIONS)))
    velocity = slice(STATES.index("radial_velocity"), STATES.index("east_velocity") + 1)
    changes[velocity, 1] = [np.sin(climb), *np.cos(climb) * towards]
    changes[velocity, 2] = [speed * np.cos(climb), *-speed * np.sin(climb) * towards]
    changes[:, RADIUS:] = position_columns(planet)
    return changes


def closed_loop(study: Study, along: Trajectory, perturbations):
    """Final errors as a function of gains, for perturbations by their numbers.

    The unit of a perturbation is its size over the radius error of Table 3, so that all count alike.
    """
    setup, simulation = study.setup, study.simulation
    of = model(setup.planet, setup.vehicle, setup.solver.scheme, along)
    unit = sizes(simulation, study.studies) / simulation.tabulated_error
    forcing = np.zeros((*of.density_matrix.shape, len(PERTURBATIONS)))
    forcing[..., DENSITY] = of.density_matrix
    return gain_problem(
        setup.planet,
        setup.design,
        of,
        (directions(setup.planet, setup.mission) * unit)[:, perturbations],
        (forcing * unit)[..., perturbations],
    )


def linear_errors(study: Study, along: Trajectory, scaled_gain=0.0, perturbations=ALL):
    """Final errors for perturbations by their sensitivity, (perturbations, 3); NaN where it overflows."""
    errors = sensitivity_gains.final_errors(closed_loop(study, along, perturbations), scaled_gain)
    return np.where(np.isfinite(errors), errors, np.nan).T * study.simulation.tabulated_error


def flown_errors(study: Study, air, along: Trajectory):
    """Final errors for the perturbations as flown without feedback, either way, (6, 2, 3)."""
    setup, simulation, studies = study.setup, study.simulation, study.studies
    changes = BOTH_WAYS[:, np.newaxis] * sizes(simulation, studies)[:, np.newaxis, np.newaxis]
    deviations = (directions(setup.planet, setup.mission).T[:, np.newaxis] * changes).reshape(-1, len(STATES))
    factors = np.ones((len(PERTURBATIONS), len(BOTH_WAYS)))
    factors[DENSITY] += BOTH_WAYS * studies.density_error
    errors = flight_errors(setup.planet, simulation, air, along, np.zeros(len(STATES)), deviations, factors.ravel())
    return errors.reshape(len(PERTURBATIONS), len(BOTH_WAYS), 3)


def flight_errors(planet: Planet, simulation: Simulation, air, along: Trajectory, gain, deviations, density_factors):
    """Final errors of flights with deviations (trials, 8) of the state at entry and density factors (trials,).

    (trials, 3), m, against the flight without either; NaN for what came below the ground.
    """
    trials = flight.fly(
        *air,
        reference(along),
        gain,
        along.state[0] + np.vstack([np.zeros(len(STATES)), deviations]),
        density_factor=np.concatenate([[1.0], density_factors]),
        substeps=simulation.substeps,
        every=len(along.bank_acceleration),
    )
    final = np.where(trials.outcome == COMPLETED, trials.final_state[: len(STATES)], np.nan).T
    return entry_problem.position_errors(final[1:], final[:1], planet.planet_radius)


# ---- a nominal desensitized against density --------------------------------------------------------------------------


def density_path(study: Study, nominal: Nominal):
    """Solutions of least J0 + c |density column| over the wanted weights, from the nominal on.

    Returns all points of the path, those of the wanted weights, why it ends, and the extended problem.
    """
    setup, studies = study.setup, study.studies
    planet, solver, design = setup.planet, setup.solver, setup.design
    unit = studies.density_error / study.simulation.tabulated_error
    extended = entry_problem.desensitized(setup, [Perturbation("density", parameters={"density_factor": unit})])
    lengths = position_rows(planet).diagonal()

    def end_cost(start, end, parameters):
        parts = [(length * end[column(name, "density")]) ** 2 for length, name in zip(lengths, POSITIONS, strict=True)]
        return parameters["weight"] * np.sqrt(sum(parts) + design.norm_smoothing)

    transcribed = entry_problem.program(planet, solver, replace(extended.problem, end_cost=end_cost))
    guess = extended.guess(as_guess(nominal), entry_problem.given(), solver.scheme)
    points = [Point(entry_problem.solve(solver, "no weight on density", transcribed, guess, barrier=WARM), 0)]
    designs, path_end = [points[0]], "at the largest weight wanted"
    for weight in np.sort(studies.density_weights):
        last = points[-1]
        try:
            further = follow(solver, design, transcribed, last.solution, [weight])[0]
        except MarsedlError:
            path_end = f"no solution was found between the weights {last.solution.given['weight']:g} and {weight:g}"
            break
        points += [Point(point.solution, last.branch + point.branch) for point in further[1:]]
        designs.append(points[-1])
    return points, designs, path_end, extended


# ---- feedback against density ----------------------------------------------------------------------------------------


def density_feedback(study: Study, air, along: Trajectory):
    """Gains on the nominal, one `Law` after the other in the order of `LAWS`.

    Null: least gains that null the density column, or that of the density and that of the radius. Tuned: least squares
    of flown errors, divided by their sizes, from no feedback.
    """
    design, none = study.setup.design, np.zeros(len(MEASURED))
    yield Law(none, True, "no feedback")
    yield null(design, closed_loop(study, along, [DENSITY]), none)
    both = closed_loop(study, along, [DENSITY, RADIUS])
    least = sensitivity_gains.regularized(both, design.all_columns_regularization)[-1]
    gains = null(design, both, np.ravel(least.k))
    if not gains.converged:
        # Where no null is found the last gains mean nothing; those of the least squares do.
        weight = design.all_columns_regularization[-1]
        gains = Law(np.ravel(least.k), False, f"regularized by {weight:g} instead, for {gains.ended}")
    yield gains
    yield tuned(study, air, along, [])
    yield tuned(study, air, along, [study.simulation.tabulated_error])


def null(design: Design, problem, start) -> Law:
    """Least gains that null the columns of a problem."""
    gains = sensitivity_gains.minimum_norm(
        problem,
        start,
        step_limit=design.gain_step_limit,
        tolerance=design.gain_tolerance,
        iterations=design.gain_iterations,
    )
    return Law(np.ravel(gains.k), bool(gains.converged), gains.reason)


def tuned(study: Study, air, along: Trajectory, radii) -> Law:
    """Gains tuned to flights with density errors, and with radius errors of these sizes, from no feedback."""
    setup, simulation = study.setup, study.simulation
    planet, design = setup.planet, setup.design
    fractions = np.kron(TUNED_FRACTIONS, BOTH_WAYS)
    radii = np.kron(radii, BOTH_WAYS)
    weight = np.concatenate([np.abs(fractions) * abs(simulation.tabulated_error), np.abs(radii)])
    factors = np.concatenate([1.0 + fractions * study.studies.density_error, np.ones(len(radii))])
    deviations = (
        np.concatenate([np.zeros(len(fractions)), radii])[:, np.newaxis] * directions(planet, setup.mission)[:, RADIUS]
    )

    def errors(scaled_gain):
        result = flight_errors(
            planet, simulation, air, along, gain_vector(planet, design, np.ravel(scaled_gain)), deviations, factors
        )
        return (result / weight[:, np.newaxis]).ravel()

    start = np.zeros(len(MEASURED))
    if not np.isfinite(errors(start)).all():
        return Law(start, False, "flights without feedback come below the ground, so there is nothing to start from")
    result = sensitivity_gains.tune(errors, start, iterations=design.gain_iterations)
    return Law(result.k, bool(result.converged), result.reason)


def under_law(study: Study, air, along: Trajectory, law: Law, errors: FlownErrors):
    """Linear and flown errors under a law, by field."""
    setup = study.setup
    deviations = (
        np.concatenate([np.zeros(len(errors.density)), errors.radius])[:, np.newaxis]
        * directions(setup.planet, setup.mission)[:, RADIUS]
    )
    factors = np.concatenate([1.0 + errors.density, np.ones(len(errors.radius))])
    gain = gain_vector(setup.planet, setup.design, law.scaled_gain)
    final = flight_errors(setup.planet, study.simulation, air, along, gain, deviations, factors)
    return {
        "law_linear_error": linear_errors(study, along, law.scaled_gain, [DENSITY, RADIUS]),
        "density_flown_error": final[: len(errors.density)],
        "radius_flown_error": final[len(errors.density) :],
    }
