"""What the paper withholds, the levels and their checks, the studies beside them, and what each reading gives."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import COMPLETE, LEVEL, STATES_IN_KILOMETRES
from marsedl.papers.funnels.claims.measures import flown_levels, largest, over_flown, peaks
from marsedl.papers.funnels.inputs import Car, FunnelsInputs, Guidance, Mission, Planet, Recursion, Uncertainty, Vehicle
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    Divergence,
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    Gains,
    LinearBounds,
    Optima,
    Proven,
    Regulators,
    StageStudy,
)
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.tables import Column, table
from marsedl.replication.units import DEGREE, KM, WATT_PER_CM2

TIMES = 13  # at which levels are tabulated
TOWARDS_END = 0.9  # of the flight
# Inputs in which readings may differ that say how much is computed, not what.
_SIZES = (
    *("trials", "redrawn_trials", "adversarial_trials", "dubins_trials", "dubins_wind_trials", "drawn_trials"),
    *("check_points", "ascent_starts", "ascent_polished", "tightness_starts", "tightness_polished", "fig4_points"),
)
NOT_PRINTED = "not printed"
OTHER_PAPER = "not printed; from another paper on the same entry"
PLACES = ("altitude", "downrange", "crossrange")
ANGLES = ("flight path angle", "heading")
# Half widths of the six states, as they are shown.
WIDTHS = {
    **{place: Column("km", ".4g") for place in PLACES},
    "velocity": Column("m/s", ".4g"),
    **{angle: Column("deg", ".4g") for angle in ANGLES},
}


def _ground(radius, widths):
    """Half widths of the six states in km, km, km, m/s, deg and deg."""
    units = np.array([1.0 / KM, radius / KM, radius / KM, 1.0, 1.0 / DEGREE, 1.0 / DEGREE])
    return widths * units


def _seconds(times):
    """Times with commas between them; None without any."""
    return ", ".join(f"{time:.0f} s" for time in times) or None


# ---- inputs ----------------------------------------------------------------------------------------------------------


def withheld(
    planet: Planet,
    vehicle: Vehicle,
    mission: Mission,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    car: Car,
):
    """What the paper needs and does not print, in numbers: what is used here, and where it is from."""
    air = environment.undisturbed_air(planet)
    line = "line through one" if planet.density_profile == "exponential" else f"line through {planet.density_profile}"
    rows = [
        ("ballistic coefficient", vehicle.ballistic_coefficient, "kg/m^2", OTHER_PAPER),
        ("lift over drag", vehicle.lift_to_drag, "1", OTHER_PAPER),
        ("density at altitude zero", np.exp(air.log_density_at_surface), "kg/m^3", line),
        ("its scale height", -1.0 / air.log_density_slope / KM, "km", line),
        ("nose radius", vehicle.nose_radius, "m", NOT_PRINTED),
        ("altitude at entry", mission.entry_altitude / KM, "km", OTHER_PAPER),
        ("velocity at entry", mission.entry_velocity, "m/s", OTHER_PAPER),
        ("flight path angle at entry", mission.entry_flight_path_angle / DEGREE, "deg", OTHER_PAPER),
        ("heading at entry", mission.entry_heading / DEGREE, "deg", OTHER_PAPER),
        ("downrange", mission.final_downrange / KM, "km", NOT_PRINTED),
        *_between("final velocity", mission.final_velocity_bounds, "m/s"),
        *_between("bank angle", np.asarray(mission.bank_bounds) / DEGREE, "deg"),
        ("limit of the heat rate", mission.heat_rate_limit / WATT_PER_CM2, "W/cm^2", NOT_PRINTED),
        *_states("equal deviation in the regulator", guidance.scale_lengths, guidance.scale_velocity,
                 guidance.scale_angles),
        ("bank angle that costs as much", guidance.scale_bank / DEGREE, "deg", NOT_PRINTED),
        ("time of the running cost of the state", guidance.state_cost_time, "s", NOT_PRINTED),
        ("time of the running cost of the bank angle", guidance.control_cost_time, "s", NOT_PRINTED),
        ("weight at the end", guidance.terminal_weight, "1", NOT_PRINTED),
        ("number of slices", guidance.fine_steps // recursion.steps_per_slice + 1, "1", NOT_PRINTED),
        *_states("semi-axis of the initial set", uncertainty.initial_lengths, uncertainty.initial_velocity,
                 uncertainty.initial_angles),
        ("disturbance of ln density at altitude zero", uncertainty.density_amplitude, "1", "not printed; MarsGRAM"),
        ("disturbance of its slope", uncertainty.density_slope_amplitude * KM, "1/km", "not printed; MarsGRAM"),
        *((f"largest rate added: {name}", value, "m/s", NOT_PRINTED)
          for name, value in zip(PLACES, uncertainty.additive_velocities, strict=True)),
        ("largest rate added: velocity", uncertainty.additive_acceleration, "m/s^2", NOT_PRINTED),
        *((f"largest rate added: {name}", value, "rad/s", NOT_PRINTED)
          for name, value in zip(ANGLES, uncertainty.additive_turn_rates, strict=True)),
        ("order of the expansion", recursion.taylor_order, "1", "what 45 rows represent"),
        *((f"goal: half width {name}", length / KM, "km", "not defined")
          for name, length in zip(PLACES[1:], mission.goal_lengths, strict=True)),
        *((f"Dubins car: first {name}", value, unit, NOT_PRINTED)
          for name, unit, value in zip(("x", "y", "heading"), ("m", "m", "rad"), car.dubins_start, strict=True)),
        ("Dubins car: speed", car.dubins_speed, "m/s", NOT_PRINTED),
        ("Dubins car: largest turn rate", car.dubins_turn_rate, "rad/s", NOT_PRINTED),
        ("Dubins car: first level", car.dubins_level, "1", NOT_PRINTED),
        ("Dubins car: wind", car.dubins_wind, "m/s", NOT_PRINTED),
    ]  # fmt: skip
    columns = {"input": Column(), "here": Column("", ".6g"), "unit": Column(), "source": Column()}
    return table([(name, float(value), unit, source) for name, value, unit, source in rows], columns)


def _between(name, bounds, unit):
    """Rows of two bounds."""
    return [
        (f"{name}, {which}", value, unit, NOT_PRINTED)
        for which, value in zip(("least", "largest"), bounds, strict=True)
    ]


def _states(name, lengths, velocity, angles):
    """Rows of a number for each of the six states."""
    return [
        *((f"{name}: {place}", length / KM, "km", NOT_PRINTED) for place, length in zip(PLACES, lengths, strict=True)),
        (f"{name}: velocity", velocity, "m/s", NOT_PRINTED),
        *((f"{name}: {of}", angle / DEGREE, "deg", NOT_PRINTED) for of, angle in zip(ANGLES, angles, strict=True)),
    ]


def withheld_forms(uncertainty: Uncertainty):
    """What the paper needs and does not print, in words."""
    rows = [
        ("cost of the nominal", "integral of the squared bank rate", NOT_PRINTED),
        ("how both disturbances enter the density", uncertainty.density_disturbance, "parameters of its exponent"),
        ("laws of start and disturbance of the flights", "uniform on their boundaries", NOT_PRINTED),
    ]
    return table(rows, {"choice": Column(), "here": Column(), "source": Column()})


def optima(optima: Optima):
    """Local optima of the nominal problem, by mesh and cost."""
    rows = zip(
        optima.intervals,
        optima.cost / DEGREE**2,
        optima.final_time,
        optima.final_velocity,
        optima.peak_heat_rate / WATT_PER_CM2,
        optima.peak_position,
        optima.starts,
        strict=True,
    )
    return table(
        rows,
        {
            "intervals": Column(),
            "cost": Column("deg^2/s", ".4f", "integral of the squared bank rate"),
            "final time": Column("s", ".3f"),
            "final velocity": Column("m/s", ".2f"),
            "largest heat rate": Column("W/cm^2", ".4f", "between the nodes"),
            "its time": Column("", ".3f", "intervals from the start"),
            "starts": Column(meaning=f"that lead there, of {len(optima.start_bank)}"),
        },
    )


# ---- the funnel ------------------------------------------------------------------------------------------------------


def levels(
    funnel: Funnel,
    linear_bounds: LinearBounds,
    constant: FlightEnsemble,
    redrawn: FlightEnsemble,
    adversarial: FlightEnsemble,
):
    """Level of the funnel at equally spaced slices, beside that of linear dynamics and of flights."""
    ratio = np.concatenate([[1.0], over_flown(funnel, constant)])
    # The maximum of all varies as that of a tenth does, at most.
    spread = constant.repeat_maximum[:, funnel.step, LEVEL].std(axis=0, ddof=1)
    numbers = np.unique(np.linspace(0, len(funnel.time) - 1, TIMES).round().astype(int))
    columns = (
        np.arange(len(funnel.time)) + 1,
        *(funnel.time, funnel.level, funnel.log_volume, linear_bounds.exact_level, linear_bounds.triangle_level),
        *(flown_levels(funnel, constant), spread, flown_levels(funnel, redrawn), flown_levels(funnel, adversarial)),
        ratio,
    )
    largest_v = "largest V of the flights"
    return table(
        zip(*(values[numbers] for values in columns), strict=True),
        {
            "k": Column(meaning="number of the slice"),
            "time": Column("s", ".2f"),
            "rho": Column("", ".5g"),
            "logarithm of the volume": Column("", ".5g", "of the slice, in m^2 rad^4/s"),
            "linear dynamics, exact": Column("", ".5g"),
            "linear dynamics, triangle inequality": Column("", ".5g"),
            "constant disturbance": Column("", ".5g", f"{largest_v}, {len(constant.outcome):,}"),
            "its standard deviation": Column("", ".2g", "from ten parts of the flights"),
            "redrawn disturbance": Column("", ".5g", f"{largest_v}, {len(redrawn.outcome):,}"),
            "adversarial disturbance": Column("", ".5g", f"{largest_v}, {len(adversarial.outcome):,}"),
            "rho over flights": Column("", ".4g", "over the largest V under constant disturbance"),
        },
    )


def half_widths(planet: Planet, funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble):
    """Largest deviations of the states at the first slice, at that of the largest level, and at the last."""
    rows = []
    top = int(np.argmax(np.where(np.isfinite(funnel.level), funnel.level, -np.inf)))
    ends = np.abs(constant.final_state[:, : funnel.half_width.shape[1]])
    for name, k in (("first", 0), ("of the largest rho", top), ("last", len(funnel.level) - 1)):
        sets = [
            ("funnel", funnel.half_width[k], funnel.feedback[k] / DEGREE),
            ("linear dynamics, same shape", linear_bounds.exact_half_width[k], None),
            ("ellipsoid of least trace, linear", linear_bounds.reachable_half_width[funnel.step[k]], None),
        ]
        if k == len(funnel.level) - 1:
            sets.append((f"{len(ends):,} flights", [largest(column) for column in ends.T], None))
        rows += [
            (name, funnel.time[k], what, *_ground(planet.planet_radius, np.asarray(widths)), bank)
            for what, widths, bank in sets
        ]
    return table(
        rows,
        {
            "slice": Column(),
            "time": Column("s", ".1f"),
            "of": Column(),
            **WIDTHS,
            "bank angle of the feedback": Column("deg", ".4g", "largest on the slice"),
        },
    )


def verification(funnel: Funnel):
    """Every stage: its program, the checks of its certificate, and what the motion itself does."""
    tight = dict(zip(funnel.tightness_stage, funnel.tightness, strict=True))
    rows = [
        (
            k + 1,
            *(values[k] for values in (funnel.level, funnel.bound, funnel.growth, funnel.additive_growth)),
            *(funnel.gap[k], funnel.residual[k], int(funnel.iterations[k]), str(funnel.status[k])),
            *(values[k] for values in (funnel.identity_error, funnel.least_value, funnel.least_eigenvalue)),
            *(funnel.rounding_margin[k], bool(funnel.stage_sound[k]), funnel.true_maximum[k]),
            *(100.0 * funnel.violation[k], tight.get(k + 1)),
        )
        for k in range(len(funnel.bound))
    ]
    return table(
        rows,
        {
            "k": Column(meaning="number of the stage"),
            "rho": Column("", ".6g"),
            "bound over rho": Column("", ".7f"),
            "factor taken": Column("", ".7f"),
            "by additive disturbances": Column("", ".3g", "in units of rho"),
            "duality gap": Column("", ".1e"),
            "violation of the equations": Column("", ".1e"),
            "iterations": Column(),
            "solver": Column(meaning="its status"),
            "error of the sum of squares": Column("", ".1e", "at fresh points"),
            "least distance to the bound": Column("", ".2e"),
            "least eigenvalue": Column("", ".1e", "of the Gram matrix"),
            "rounding of it": Column("", ".1e"),
            "sound": Column(),
            "largest of the motion over rho": Column("", ".7f"),
            "beyond the bound": Column("%", "+.4f", "of the motion"),
            "polynomial below its bound": Column("", ".1e", "by how much; sought at some stages"),
        },
    )


def conditions(gains: Gains):
    """Regulator and shape at the start, the middle and the end."""
    last = len(gains.time) - 1
    units = dict(zip((*PLACES, "velocity", *ANGLES), ("km", "rad", "rad", "km/s", "rad", "rad"), strict=True))
    rows = [
        (
            gains.time[k],
            *(np.diag(gains.value_matrix[k]) * STATES_IN_KILOMETRES**2),
            *(gains.condition[k], gains.scaled_condition[k]),
        )
        for k in (0, last // 2, last)
    ]
    diagonal = {
        f"cost-to-go of {name}": Column(f"({unit})^-2", ".5g", "on the diagonal of its matrix")
        for name, unit in units.items()
    }
    return table(
        rows,
        {
            "time": Column("s", ".2f"),
            **diagonal,
            "condition number of the shape": Column("", ".3g", "in km, s and rad"),
            "scaled condition number": Column("", ".4g", "in scales of the regulator"),
        },
    )


# ---- studies ---------------------------------------------------------------------------------------------------------


def forms(stage_study: StageStudy):
    """The benchmark stage in all forms of its program."""
    study, reference = stage_study, stage_study.form_bound[0]
    rows = zip(
        study.form.astype(str),
        study.form_bound,
        study.form_bound / reference - 1.0,
        *(study.form_safe_bound, study.form_gap, study.form_residual, study.form_iterations),
        study.form_status.astype(str),
        strict=True,
    )
    return table(
        rows,
        {
            "form and solver": Column(),
            "bound over rho": Column("", ".8f"),
            "difference": Column("", "+.1e", "from the first, relative"),
            "safe bound": Column("", ".8f"),
            "duality gap": Column("", ".1e"),
            "violation of the equations": Column("", ".1e"),
            "iterations": Column(),
            "ended": Column(),
        },
    )


def ascents(stage_study: StageStudy):
    """The largest values that were found by ascent at the benchmark stage."""
    values = {
        "of the polynomial, boundaries": stage_study.polynomial_maximum,
        "of the polynomial, disturbances inside as well": stage_study.disc_maximum,
        "of the motion itself": stage_study.true_maximum,
    }
    rows = [(name, float(value), float(value) / stage_study.form_bound[0] - 1.0) for name, value in values.items()]
    return table(
        rows,
        {
            "largest value": Column(),
            "over rho": Column("", ".8f"),
            "difference": Column("", "+.1e", "from the bound of the first form, relative"),
        },
    )


def counts(stage_study: StageStudy):
    """Monomials, rows of the Gram matrix and samples, by formula and by rank."""
    study = stage_study
    rows = [
        (
            str(name),
            *(int(values[k]) for values in (study.variables, study.monomials, study.basis_size)),
            int(study.basis_rank[k]) or None,
            *(int(values[k]) for values in (study.coefficients, study.gram_unknowns, study.samples)),
            int(study.product_rank[k]) or None,
        )
        for k, name in enumerate(study.variety)
    ]
    by_rank = "computed from samples, for some"
    return table(
        rows,
        {
            "spheres": Column(),
            "variables": Column(),
            "monomials up to degree 2": Column(),
            "independent": Column(meaning="of them"),
            "rank at samples": Column(meaning=by_rank),
            "monomials up to degree 4": Column(),
            "entries of the Gram matrix": Column(),
            "least number of samples": Column(),
            "rank of products": Column(meaning=by_rank),
        },
    )


def few_samples(stage_study: StageStudy):
    """Bounds of the benchmark stage by too few random samples."""
    study = stage_study
    return table(
        zip(study.few_samples, study.few_bound, study.few_rank, study.few_least_value, strict=True),
        {
            "samples": Column(),
            "bound over rho": Column("", ".6f"),
            "rank": Column(),
            "least distance to fresh points": Column("", "+.1e"),
        },
    )


def exponents(stage_study: StageStudy):
    """Bounds of the benchmark stage by the exponent of the factor in Eq. 24."""
    study = stage_study
    raw = np.atleast_2d(study.exponent_bound)
    names = [f"in x, set {number + 1}" for number in range(raw.shape[1])]
    return table(
        [
            (int(d), whitened, *values)
            for d, whitened, values in zip(study.exponent, study.exponent_whitened_bound, raw, strict=True)
        ],
        {
            "d": Column(meaning="exponent"),
            "in y": Column("", ".6f", "bound over rho with the factor (y'y)^d"),
            **{name: Column("", ".4g", "bound over rho with (x'x)^d, by the samples taken") for name in names},
        },
    )


def bases_and_designs(stage_study: StageStudy):
    """Bounds and condition numbers of the benchmark stage by other bases, samples and changes of coordinates."""
    study = stage_study
    rows = [("basis", str(name), None, number) for name, number in zip(study.basis, study.basis_condition, strict=True)]
    rows += [
        ("samples", str(name), bound, number)
        for name, number, bound in zip(study.design, study.design_condition, study.design_bound, strict=True)
    ]
    rows += [
        ("change", str(name), bound, None) for name, bound in zip(study.invariance, study.invariance_bound, strict=True)
    ]
    return table(
        rows,
        {
            "what": Column(),
            "which": Column(),
            "bound over rho": Column("", ".8f"),
            "condition number": Column("", ".4g"),
        },
    )


def numbers_of_slices(discretization: Discretization):
    """Funnels with fewer and more slices by both conditions."""
    study = discretization
    rows = [
        (int(spacing), str(condition), study.peak_level[c, k], study.final_level[c, k], str(study.outcome[c, k]))
        for k, spacing in enumerate(study.spacing)
        for c, condition in enumerate(study.condition)
    ]
    return table(
        rows,
        {
            "fine steps between slices": Column(),
            "condition": Column(),
            "largest rho": Column("", ".5g"),
            "last rho": Column("", ".5g"),
            "outcome": Column(),
        },
    )


def euler_step(discretization: Discretization):
    """What the Euler step of Eq. 22 leaves out, at the levels of the motion, stage by stage."""
    study = discretization
    rows = zip(
        study.spacing,
        *(100.0 * study.unsafe_share, -100.0 * study.least_excess, 100.0 * study.largest_excess),
        *(100.0 * study.mean_excess, 100.0 * study.mean_difference),
        strict=True,
    )
    return table(
        rows,
        {
            "fine steps between slices": Column(),
            "stages where it is too small": Column("%", ".1f"),
            "too small by at most": Column("%", ".3f"),
            "too large by at most": Column("%", ".3f"),
            "mean": Column("%", "+.3f", "difference"),
            "mean magnitude": Column("%", ".3f", "of the difference"),
        },
    )


def variants(coarse_funnels: CoarseFunnels):
    """Funnels with coarse slices by other programs, orders and directions."""
    study = coarse_funnels
    numbers = np.unique(np.linspace(0, study.variant_level.shape[1] - 1, 7).round().astype(int))
    rows = [
        (str(name), *values[numbers], str(outcome))
        for name, values, outcome in zip(study.variant, study.variant_level, study.variant_outcome, strict=True)
    ]
    levels_at = {f"rho at fine step {study.coarse_step[k]}": Column("", ".6g") for k in numbers}
    return table(rows, {"funnel": Column(), **levels_at, "outcome": Column()})


def divergence(divergence: Divergence):
    """Whether funnels still exist with other weights, disturbances and initial sets, and where flights stay."""
    study = divergence
    rows = [
        (
            str(name),
            study.change_factor[k],
            *(study.change_initial_level[k], largest(study.change_level[k]), study.change_level[k, -1]),
            str(study.change_outcome[k]),
            *(study.change_flown[k], int(study.change_lost[k])),
        )
        for k, name in enumerate(study.change)
    ]
    return table(
        rows,
        {
            "what is scaled": Column(),
            "factor": Column("", "g"),
            "first rho": Column("", ".4g"),
            "largest rho": Column("", ".4g"),
            "last rho": Column("", ".4g"),
            "outcome": Column(),
            "largest V of flights": Column("", ".4g"),
            "flights lost": Column(),
        },
    )


def regulators(regulators: Regulators):
    """The course of rho with other weights of the regulator and another shape of the slices."""
    time = regulators.slice_time
    rows = []
    for k, name in enumerate(regulators.variant):
        level = regulators.level[k]
        maxima, top = peaks(level), int(np.argmax(np.where(np.isfinite(level), level, -np.inf)))
        rows.append(
            (
                str(name),
                regulators.factor[k],
                *(level[0], level[top], time[top]),
                _seconds(time[maxima]),
                *(np.interp(TOWARDS_END * time[-1], time, level), level[-1]),
                str(regulators.outcome[k]),
            )
        )
    return table(
        rows,
        {
            "weight": Column(meaning="that is scaled"),
            "factor": Column("", "g"),
            "first rho": Column("", ".4g"),
            "largest rho": Column("", ".4g"),
            "its time": Column("s", ".0f"),
            "times of local maxima": Column(meaning="of rho"),
            f"rho at {TOWARDS_END * 100:g} % of the flight": Column("", ".4g"),
            "last rho": Column("", ".4g"),
            "outcome": Column(),
        },
    )


def proof(funnel: Funnel, proven: Proven):
    """Proven levels beside those by samples, and what their bounds consist of."""
    numbers = np.unique(np.linspace(0, len(proven.step) - 1, TIMES).round().astype(int))
    parts = (proven.bound, proven.polynomial_bound, proven.truncation, proven.remainder, proven.rise)
    rows = [
        (
            int(k) + 1,
            *(proven.time[k], proven.level[k], proven.level[k] / funnel.level[k]),
            *(values[k] if k < len(values) else None for values in parts),
        )
        for k in numbers
    ]
    return table(
        rows,
        {
            "k": Column(meaning="number of the slice"),
            "time": Column("s", ".2f"),
            "proven rho": Column("", ".6g"),
            "over that by samples": Column("", ".5f"),
            "proven bound over rho": Column("", ".7f", "of the stage that begins there"),
            "of its polynomial": Column("", ".7f", "part of the bound"),
            "known terms of higher degree": Column("", ".2e", "part of the bound"),
            "remainder": Column("", ".2e", "part of the bound"),
            "inside of the slice": Column("", ".2e", "part of the bound"),
        },
    )


def dubins_levels(
    dubins: Dubins,
    dubins_study: DubinsStudy,
    dubins_calm: FlightEnsemble,
    dubins_wind: FlightEnsemble,
):
    """Levels of the Dubins car at the quarters of its path by all solvers."""
    last = dubins.level.shape[1] - 1
    numbers = np.unique(np.linspace(0, last, 5).round().astype(int))
    rows = []

    def row(funnel, by, values, difference=None):
        rows.append((funnel, by, *values[numbers], difference))

    study = dubins_study
    runs = {"flow": dubins_calm, "wind": dubins_wind}
    proven = dict(zip(study.proven_funnel, study.proven_level, strict=True))
    for number, name in enumerate(dubins.funnel):
        row(str(name), "samples", dubins.level[number])
        row(str(name), "multipliers", study.multiplier_level[number], study.multiplier_difference[number])
        row(str(name), "linear dynamics, exact", study.linear_level[number])
        if name in runs:
            row(
                str(name),
                f"{len(runs[name].outcome):,} runs",
                runs[name].maximum_over_trials[dubins.slice_step, LEVEL],
            )
        if name in proven:
            row(str(name), "proven", proven[name])
    row(str(dubins.funnel[0]), "samples, backwards", study.backward_level, float(study.round_trip))
    return table(
        rows,
        {
            "funnel": Column(),
            "by": Column(),
            **{f"rho at {dubins.slice_time[k]:g} s": Column("", ".5f") for k in numbers},
            "largest difference": Column("", ".1e", "from the levels by samples, relative"),
        },
    )


# ---- over all readings -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Records(Artifacts):
    """What the table over all readings is made from."""

    funnel: Funnel
    constant: FlightEnsemble
    redrawn: FlightEnsemble
    adversarial: FlightEnsemble


def readings(readings: dict[str, tuple[FunnelsInputs, Records]], published):
    """What each reading gives; readings: inputs and `Records` by reading."""
    rows = []
    default = readings["corrected"][0]
    for name, (inputs, records) in readings.items():
        funnel, constant = records.funnel, records.constant
        laws = (constant, records.redrawn, records.adversarial)
        ratio = over_flown(funnel, constant)
        top = int(np.argmax(np.where(np.isfinite(funnel.level), funnel.level, -np.inf)))
        has_maximum = np.isfinite(funnel.true_maximum).any()
        rows.append(
            (
                name,
                _differences(inputs, default),
                *(funnel.level[0], funnel.level[top], funnel.time[top], funnel.level[-1]),
                _seconds(funnel.time[peaks(funnel.level)]),
                *_ground(inputs.planet.planet_radius, funnel.half_width[-1])[1:3],
                *(np.median(ratio), np.max(ratio)),
                int(sum(law.outside_at_slices + law.outside_between for law in laws)),
                sum(len(law.outcome) for law in laws),
                int(np.count_nonzero(funnel.true_maximum > funnel.growth)) if has_maximum else None,
                len(funnel.bound),
                100.0 * largest(funnel.violation),
                largest(funnel.heat_rate) / WATT_PER_CM2,
                largest(funnel.feedback) / DEGREE,
                bool(funnel.stage_sound.all()),
                inputs.recursion.sampling == "whitened",
                "complete" if funnel.outcome == COMPLETE else funnel.outcome,
            )
        )
    return table(
        rows,
        {
            "reading": Column(),
            "inputs that differ": Column(meaning="from those of corrected, SI"),
            "first rho": Column("", ".5g"),
            "largest rho": Column("", ".5g"),
            "its time": Column("s", ".0f"),
            "last rho": Column("", ".5g"),
            "times of local maxima": Column(meaning="of rho"),
            "last downrange half width": Column("km", ".4g"),
            "last crossrange half width": Column("km", ".4g"),
            "median of rho over flights": Column("", ".3g", "over the largest V of the flights, constant disturbance"),
            "most of rho over flights": Column("", ".3g", "the same"),
            "flights outside": Column(meaning="of all kinds"),
            "flights": Column(meaning="of all kinds"),
            "stages exceeded": Column(meaning="by motion beyond their bound, additive disturbances apart"),
            "stages": Column(),
            "exceeded by at most": Column("%", ".3f"),
            "largest heat rate": Column("W/cm^2", ".4g", "in the funnel"),
            "largest feedback": Column("deg", ".4g", "in the funnel"),
            "certificates sound": Column(),
            "samples on the slices": Column(),
            "outcome": Column(),
        },
    )


def _differences(inputs: FunnelsInputs, default: FunnelsInputs):
    """Inputs that differ from the default reading's, with their values where these are short."""
    texts = []
    for name, key in sorted((key.partition(".")[2], key) for key in inputs.names()):
        value = inputs.get(key)
        if name in _SIZES or np.array_equal(value, default.get(key)):
            continue
        short = not isinstance(value, np.ndarray)
        text = "any" if value is None else value if isinstance(value, str) else f"{value:.6g}" if short else ""
        texts.append(f"{name} {text}".strip())
    return ", ".join(texts) or None
