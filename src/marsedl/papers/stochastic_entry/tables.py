"""Tables 1 to 4, Eq. 77, and the design's certificates."""

import numpy as np

from marsedl.montecarlo.statistics import percentile_spread
from marsedl.papers.stochastic_entry import dispersions
from marsedl.papers.stochastic_entry.claims.measures import (
    FEASIBLE,
    ROWS,
    crossrange_of_azimuth,
    finite,
    finite_count,
    table_percentiles,
)
from marsedl.papers.stochastic_entry.inputs import (
    Air,
    Design,
    Mission,
    Planet,
    Simulation,
    Vehicle,
)
from marsedl.papers.stochastic_entry.records import (
    DOWNRANGE,
    LEVELS,
    LINEAR_STATE,
    OUTCOMES,
    TRIGGERS,
    VELOCITY,
    Certificates,
    FlightEnsemble,
    Gains,
    Linearization,
    by_case,
    errors,
)
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.claims.verdicts import Evaluation, judge
from marsedl.replication.records.tables import Column, table

PAPER = "in the paper"


def _law_and_trigger(case):
    """The law and the trigger of a Monte Carlo case, in two cells."""
    return tuple(case.split("_"))


def _with_error(name, unit="", digits=".2f", meaning=""):
    """The columns of a value and of its standard error."""
    error = f"{name}: standard error"
    return {name: Column(unit, digits, meaning, error=error), error: Column(unit)}


def tab01(vehicle: Vehicle):
    """Table 1 from the inputs."""
    body = dispersions.body_of(vehicle)
    rows = [
        (
            vehicle.mass,
            np.pi * vehicle.reference_diameter**2 / 4,
            np.degrees(vehicle.trim_angle_of_attack),
            vehicle.lift_to_drag,
            vehicle.ballistic_coefficient,
            body.drag_coefficient,
            body.lift_coefficient,
        )
    ]
    return table(
        rows,
        {
            "mass": Column("kg", "g"),
            "reference area": Column("m^2", ".3f", f"that of a disc of {vehicle.reference_diameter:g} m"),
            "trimmed angle of attack": Column("deg", "g"),
            "lift over drag": Column("1", "g"),
            "ballistic coefficient": Column("kg/m^2", "g"),
            "drag coefficient": Column("1", ".4f", "that follows"),
            "lift coefficient": Column("1", ".4f", "that follows"),
        },
    )


def tab02(planet: Planet, mission: Mission):
    """Table 2 from the inputs."""
    _, crossrange = crossrange_of_azimuth(planet, mission)
    rows = [
        ("altitude", "km", planet.atmosphere_altitude / 1e3, 0.0),
        ("velocity", "m/s", mission.entry_velocity, mission.entry_velocity_three_sigma),
        (
            "flight path angle",
            "deg",
            np.degrees(mission.entry_flight_path_angle),
            np.degrees(mission.entry_flight_path_angle_three_sigma),
        ),
        ("heading azimuth", "deg", np.degrees(mission.entry_azimuth), np.degrees(mission.entry_azimuth_three_sigma)),
        ("downrange", "km", 0.0, mission.entry_downrange_three_sigma / 1e3),
        ("crossrange", "km", crossrange / 1e3, mission.entry_crossrange_three_sigma / 1e3),
    ]
    columns = {
        "state": Column(meaning="at entry"),
        "unit": Column(meaning="of the two numbers that follow it"),
        "nominal": Column("", ".6g"),
        "three sigma": Column("", "g"),
    }
    return table(rows, columns)


def tab03(air: Air, vehicle: Vehicle):
    """Table 3 from the inputs, with the surrogate of the density samples."""
    low, high = np.degrees(vehicle.trim_interval)
    lift, drag = vehicle.lift_dispersion, vehicle.drag_dispersion
    rows = [
        ("state at entry", "Gaussian (Table 2)", "Gaussian (Table 2)"),
        (
            "density of the atmosphere",
            "Mars-GRAM samples",
            f"Ornstein-Uhlenbeck surrogate about the mean density `{air.density_profile}`, with exactly the "
            f"variance `{air.variance_profile}`",
        ),
        (
            "aerodynamics",
            "trim angle of attack uniform, about 0.15 in C_L and 0.02 in C_D",
            f"uniform between {low:g} and {high:g} deg, from {-lift:+g} to {lift:+g} in C_L and from {-drag:+g} to "
            f"{drag:+g} in C_D",
        ),
    ]
    return table(rows, {"source of uncertainty": Column(), PAPER: Column(), "here": Column()})


def tab04(
    mission: Mission,
    simulation: Simulation,
    published,
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
):
    """Percentiles of the final errors beside Table 4, from the paper's number of trials and from all."""
    flights = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    size, short = int(simulation.paper_trials), mission.positive_range_error == "short"
    rows = []
    for state, name, factor, unit in ROWS:
        for case, ensemble in flights.items():
            first, whole = (table_percentiles(ensemble, trials, short, [state])[state] for trials in (size, None))
            sample = errors(ensemble)[finite(ensemble), state] * (-factor if short and state == DOWNRANGE else factor)
            claim = published[f"tab4_{name}_{case}"]
            for side, level in enumerate(LEVELS):
                printed, resolution = claim.printed[side], claim.resolution[side]
                value, error = whole[0][side] * factor, whole[1][side] * factor
                try:
                    spread = percentile_spread(sample, level, size)[1]
                except ValueError:  # too few trials for two sets
                    spread = None
                cell = claim.model_copy(update={"printed": printed, "resolution": resolution})
                margin = judge(cell, Evaluation(value, error, finite_count(ensemble))).margin
                scale = margin and margin.standard_error  # 0 of what is not finite
                rows.append(
                    (
                        name.replace("gamma", "flight path angle"),
                        unit,
                        *_law_and_trigger(case),
                        100 * level,
                        printed,
                        *(part[side] * factor for part in first),
                        spread,
                        value,
                        error,
                        np.sign(margin.value) * max(abs(margin.value) - resolution / 2, 0.0) / scale if scale else None,
                        finite_count(ensemble),
                    )
                )
    first, whole = f"first {size:,} trials", "all trials"
    return table(
        rows,
        {
            "final error": Column(),
            "unit": Column(meaning="of the numbers of the row"),
            "law": Column(),
            "trigger": Column(),
            "percentile": Column("", "g"),
            PAPER: Column("", "g"),
            **_with_error(first, "", ".3f", "as many as the paper flies"),
            f"spread over sets of {size:,}": Column("", ".3f", "standard deviation of the percentile"),
            **_with_error(whole, "", ".3f"),
            "z": Column("", "+.1f", "here minus printed, beyond the printed rounding, in combined standard errors"),
            "trials": Column("", "", "that are finite"),
        },
    )


def endings(
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
):
    """How the trials ended, and their final range errors, by law and trigger."""
    flights = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    rows = [
        (
            *_law_and_trigger(case),
            ensemble.count + ensemble.excluded,
            *(np.count_nonzero(ensemble.outcome == code) for code in OUTCOMES),
            *_range_errors(errors(ensemble)[finite(ensemble), DOWNRANGE]),
        )
        for case, ensemble in flights.items()
    ]
    columns = dict.fromkeys(("law", "trigger", "trials", *OUTCOMES.values()), Column())
    return table(rows, columns | _RANGE_ERRORS)


_RANGE_ERRORS = {
    "mean range error": Column("km", ".2f", "positive if long"),
    "1st percentile": Column("km", ".2f", "of the range error"),
    "99th percentile": Column("km", ".2f", "of the range error"),
}


def _range_errors(error):
    """The cells of `_RANGE_ERRORS`; error: of finite trials (m)."""
    return (error.mean() / 1e3, *np.quantile(error, LEVELS) / 1e3) if len(error) else (None,) * 3


def zf(air: Air, published, linearization: Linearization):
    """Z_f element by element beside Eq. 77."""
    claim, fitted = published["zf_column_velocity"], air.density_profile == "log_quadratic"
    states = ("radius", "velocity", "flight path angle", "range", "density")
    units = list(LINEAR_STATE.units.values())
    rows = []
    for i, j in np.ndindex(linearization.trigger_projection.shape):
        value = linearization.trigger_projection[i, j]
        printed, resolution = (claim.printed[i], claim.resolution[i]) if j == VELOCITY else (float(i == j), ROUNDING)
        entry = claim.model_copy(update={"printed": printed, "resolution": resolution})
        verdict = judge(entry, Evaluation(value)).verdict
        unit = "1" if units[i] == units[j] else f"{units[i]} per {units[j]}"
        of_fit = fitted and j == VELOCITY
        rows.append((states[i], states[j], unit, printed, value, value - printed, verdict == "reproduced", of_fit))
    return table(
        rows,
        {
            "row": Column(),
            "column": Column(),
            "unit": Column(meaning="of the three numbers that follow it"),
            PAPER: Column("", "g"),
            "here": Column("", ".6g"),
            "difference": Column("", "+.2g", "here minus printed"),
            "within the printed rounding": Column(),
            "fitted": Column(meaning="whether the density is fitted to it: then agreement is no evidence"),
        },
    )


def certificates(design: Design, gains: Gains, certificates: Certificates):
    """The stochastic law against independent formulations, by trigger."""
    rows = [
        (
            trigger,
            np.sqrt(gains.cost[k]),
            np.sqrt(gains.noise_floor[k]),
            gains.gap[k],
            gains.gap_above_floor[k],
            gains.control_ratio[k].max(),
            *gains.final_ratio[k, :2],
            *gains.final_multiplier[k, :2],
            int(np.sum(gains.control_ratio[k] > 1.0 - FEASIBLE)),
            gains.complementarity[k],
            str(gains.status[k]),
            int(gains.iterations[k]),
            certificates.weights_gain_error[k],
            certificates.perturbed_cost[k],
            certificates.coarse_gap[k],
            certificates.cone_ratio[k] - 1.0,
            str(certificates.cone_status[k]),
            int(certificates.cone_iterations[k]),
        )
        for k, trigger in enumerate(TRIGGERS)
    ]
    over_limit = "deviation over its limit"
    return table(
        rows,
        {
            "trigger": Column(),
            "deviation of the objective": Column("m", ".4f", "of the final range"),
            "floor": Column("m", ".4f", "of this deviation, that noise after the last control makes"),
            "duality gap": Column("", ".1e", "over the objective"),
            "duality gap above the floor": Column("", ".1e", "over what is above the floor"),
            f"largest control {over_limit}": Column("", ".6f"),
            f"final altitude {over_limit}": Column("", ".6f"),
            f"final path angle {over_limit}": Column("", ".6f"),
            "multiplier of the altitude limit": Column("m^2 per m^2", ".3g"),
            "multiplier of the path angle limit": Column("m^2 per rad^2", ".3g"),
            "control limits reached": Column(),
            "complementarity": Column("", ".1e"),
            "solver of the dual": Column(meaning="its status"),
            "sweeps of the dual": Column(),
            "error of the gains from LQG weights": Column("", ".1e", "largest, with the multipliers as weights"),
            "least change of the Lagrangian": Column("", "+.1e", "with perturbed gains"),
            "duality gap on coarse intervals": Column("", ".1e", f"of {design.coarse_interval:g} s"),
            "cost of the cone program": Column("", "+.1e", "over that of the dual, less one"),
            "solver of the cone program": Column(meaning="its status"),
            "iterations of the cone program": Column(),
        },
    )
