"""Tables: one reading's final state against Eq. 54, its studies, and what each reading reproduces."""

from dataclasses import dataclass

import numpy as np

from marsedl.montecarlo.statistics import (
    mean_standard_error,
    two_sample_covariance_deviance,
)
from marsedl.montecarlo.streaming import FinalMoments, observed_maxima
from marsedl.papers.powered_descent.claims.measures import MASS, MOTION_PART, mean_chi_square, printed_covariance
from marsedl.papers.powered_descent.inputs import PoweredDescentInputs
from marsedl.papers.powered_descent.records import (
    THRUST,
    Certificates,
    Choices,
    FixedPointStudy,
    FlightEnsemble,
    Gains,
    Nominal,
)
from marsedl.replication.pipeline.catalogue import Artifacts
from marsedl.replication.records.tables import Column, frame, table

NAMES, UNITS = ("r1", "r2", "v1", "v2"), ("m", "m", "m/s", "m/s")
VARIANCE_ERROR = "largest error of the final variances"


@dataclass(frozen=True)
class Records(Artifacts):
    """What the table over all readings is made from."""

    nominal: Nominal
    gains: Gains
    closed_loop: FlightEnsemble
    closed_loop_large: FlightEnsemble | None = None


def agreement(published, ensemble):
    """Likelihood-ratio tests of the printed covariance against an ensemble's: whole, and without downrange position."""
    printed, trials = printed_covariance(published), published["mc_final_cov_diag"].trials
    state = FinalMoments(ensemble, MOTION_PART)
    whole = two_sample_covariance_deviance(printed, trials, state.covariance, state.count)
    return whole, two_sample_covariance_deviance(printed[1:, 1:], trials, state.covariance[1:, 1:], state.count)


def eq54(published, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None):
    """Mean and covariance of the final state beside Eq. 54, with standard errors and distances in standard errors."""
    ensemble = closed_loop_large or closed_loop
    state = FinalMoments(ensemble, MOTION_PART)
    trials = published["mc_final_mean"].trials
    share = np.sqrt(state.count / trials)  # the paper's sampling error in units of ours
    rows = []

    def row(name, unit, printed, value, error):
        z = (printed - value) / (error * np.hypot(1.0, share))
        rows.append((name, unit, printed, value, error, error * share, z, state.count))

    means, errors = state.mean, mean_standard_error(state.variance, state.count)
    for i, name in enumerate(NAMES):
        row(f"mean {name}", UNITS[i], published["mc_final_mean"].printed[i], means[i], errors[i])
    printed, covariance, errors = printed_covariance(published), state.covariance, state.covariance_errors
    for i in range(4):
        for j in range(i, 4):
            name = f"var {NAMES[i]}" if i == j else f"cov {NAMES[i]}, {NAMES[j]}"
            unit = ("m^2", "m^2/s", "m^2/s^2")[(i > 1) + (j > 1)]
            row(name, unit, printed[i, j], covariance[i, j], errors[i, j])
    return table(
        rows,
        {
            "quantity": Column(
                meaning="of the final state: positions r1 (downrange), r2 (altitude), velocities v1, v2"
            ),
            "unit": Column(meaning="of the four numbers that follow it"),
            "in the paper": Column("", ".4f"),
            "here": Column("", ".4f", "over the trials", error="standard error"),
            "standard error": Column("", ".4f", "of the number here"),
            "paper's standard error": Column("", ".4f", f"of the printed number, from its {trials:,} trials"),
            "z": Column("", "+.1f", "printed minus here, over the combined standard error"),
            "trials": Column(),
        },
    )


def eq54_tests(published, closed_loop: FlightEnsemble, closed_loop_large: FlightEnsemble | None = None):
    """Likelihood-ratio tests of the covariance of Eq. 54 against that of the trials."""
    tests = agreement(published, closed_loop_large or closed_loop)
    trials = (closed_loop_large or closed_loop).count
    rows = [
        (name, test.statistic, test.degrees_of_freedom, test.p_value, trials)
        for name, test in zip(("whole covariance", "without r1"), tests, strict=True)
    ]
    return table(
        rows,
        {
            "part": Column(meaning="of the covariance that is tested"),
            "deviance": Column("", ".1f", "likelihood-ratio statistic"),
            "degrees of freedom": Column(),
            "p": Column("", ".2g", "probability of a larger deviance if both have the same covariance"),
            "trials": Column(),
        },
    )


def algorithm_1(fixed_point: FixedPointStudy):
    """Runs of Algorithm 1 in both thrust units: iterations, distance from the closed form, final variances."""
    runs = frame(
        fixed_point,
        "iterations",
        "converged",
        unit=Column(label="thrust unit", digits="g"),
        riccati_error=Column(digits=".1e", label="error against the closed form of the equivalent noise"),
        covariance_error=Column("%", ".3g", label=VARIANCE_ERROR),
    )
    # The variances are those of the runs in the printed order alone.
    return runs.assign(**{f"{VARIANCE_ERROR} (%)": runs[f"{VARIANCE_ERROR} (%)"].where(runs["order"] == "jacobi")})


def certificates(certificates: Certificates):
    """Distances of the design from its independent checks, by segment."""
    fields = ("covariance_error", "riccati_error", "h_identity_error", "costate_error_eq39", "costate_error_eq37")
    return frame(certificates, **dict.fromkeys((*fields, "mean_error"), ".1e"))


def certified_costs(certificates: Certificates):
    """Costs of convex programs with held controls over those of the closed form, by segment and held intervals."""
    return frame(
        certificates,
        "solver_status",
        "solver_iterations",
        intervals=Column(label="held intervals"),
        mean_cost_ratio=".7f",
        covariance_cost_ratio=".4f",
    )


def choices_of_mass(published, choices: Choices):
    """Final mass of Algorithm 3 with each choice of signs, exchanged speeds and mass-flow constant."""
    printed, masses = published["prior_final_mass"], choices.final_mass
    axes = (choices.downrange_sign, choices.vertical_sign, choices.exchanged, choices.mass_flow_constant)
    with_feedback, without = (int(np.flatnonzero(choices.feedback == value)[0]) for value in (True, False))
    rows = [
        (
            *(axis[i] for axis, i in zip(axes, index, strict=True)),
            masses[(*index, with_feedback, -1)],
            masses[(*index, with_feedback, 0)],
            masses[(*index, without, 0)],
            bool((np.abs(masses[index] - printed.printed) <= printed.resolution / 2).any()),
        )
        for index in np.ndindex(masses.shape[:4])
    ]
    return table(
        rows,
        {
            "downrange": Column(meaning="sign of the initial downrange velocity"),
            "vertical": Column(meaning="sign of the initial vertical velocity"),
            "exchanged": Column(meaning="whether sine and cosine of the angle are exchanged"),
            "mass-flow constant": Column("kg/(N s)", ".5g"),
            "final mass": Column("kg", ".2f", f"after {masses.shape[-1]} passes"),
            "after one pass": Column("kg", ".2f"),
            "after one pass without feedback": Column("kg", ".2f", "the flight of the pass has the mean control alone"),
            "rounds to the printed": Column(meaning=f"a pass of either iteration ends at {printed.printed} kg"),
        },
    )


def choices_of_simulation(published, choices: Choices):
    """Mean final state with each choice of mass profile, held command, scheme and step, and its fit to Eq. 54."""
    from scipy.special import chdtrc

    chi_square = mean_chi_square(published, choices)
    rows = [
        (
            str(choices.profile[index[0]]).replace("_", " "),
            choices.command_interval[index[1]],
            str(choices.scheme[index[2]]),
            choices.step[index[2]],
            *choices.mean[index],
            chi_square[index],
            chdtrc(len(NAMES), chi_square[index]),
        )
        for index in np.ndindex(chi_square.shape)
    ]
    return table(
        rows,
        {
            "mass profile": Column(meaning="that the design assumes"),
            "command held": Column("s", "g", "0: continuous"),
            "scheme": Column(),
            "step": Column("s", "g"),
            **{f"mean {name}": Column(unit, ".3f") for name, unit in zip(NAMES, UNITS, strict=True)},
            "chi-square": Column("", ".1f", "of the printed mean, 4 degrees of freedom"),
            "p": Column("", ".2g", "probability of a larger one by chance"),
        },
    )


def readings(readings: dict[str, tuple[PoweredDescentInputs, Records]], published):
    """What each reading reproduces: its noise and target, the masses, and the tests of the printed covariance.

    A reading has a row for the paper's number of trials, and one for its large ensemble if it has one.

    readings: inputs and `Records` by reading. published: claims by id.
    """
    rows = []
    # Rows of equal numbers of trials stand together: only these compare.
    sizes = ("closed_loop", "closed_loop_large")
    flights = [(name, *of, getattr(of[1], size)) for size in sizes for name, of in readings.items()]
    for name, inputs, records, ensemble in flights:
        if ensemble is None:
            continue
        gains, nominal = records.gains, records.nominal
        target = np.diag(inputs.mission.final_covariance)
        whole, without_mean = agreement(published, ensemble)
        mass = FinalMoments(ensemble, MASS)
        rows.append(
            (
                name,
                gains.noise_density_design,
                gains.noise_density_plant,
                target[0],
                nominal.mass[-1],
                mass.mean,
                mean_standard_error(mass.variance, mass.count),
                100 * np.abs(np.diag(gains.covariance[-1]) / target - 1).max(),
                whole.statistic,
                whole.p_value,
                without_mean.statistic,
                without_mean.p_value,
                observed_maxima(ensemble, THRUST).max() / inputs.vehicle.maximum_thrust,
                mass.count,
            )
        )
    error = "standard error of the mean final mass"
    return table(
        rows,
        {
            "reading": Column(),
            "design noise": Column("N sqrt(s)", ".4g", "noise density that the boundary condition designs for"),
            "plant noise": Column("N sqrt(s)", ".4g", "noise density of the plant"),
            "target var r1": Column("m^2", "g", "variance of the final downrange that is asked for"),
            "prior final mass": Column("kg", ".3f", "last entry of the mass profile that is assumed beforehand"),
            "mean final mass": Column("kg", ".3f", "over the trials", error=error),
            error: Column("kg"),
            "largest error of the predicted final variances": Column("%", ".3g", "against the target"),
            "deviance": Column("", ".1f", "of the printed covariance, 10 degrees of freedom"),
            "p": Column("", ".2g", "of this deviance"),
            "deviance without r1": Column("", ".1f", "6 degrees of freedom"),
            "p without r1": Column("", ".2g", "of this deviance"),
            "largest thrust over the maximum": Column("", ".3f", "over the trials"),
            "trials": Column(),
        },
    )
