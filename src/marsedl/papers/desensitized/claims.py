"""Evaluation of every printed claim from the artifacts of one reading, and what is known about those that differ."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.sensitivity import closed_loop, midpoint_transitions, propagate_columns
from marsedl.models import atmosphere
from marsedl.papers import density
from marsedl.papers.desensitized import entry_problem
from marsedl.papers.desensitized.entry_problem import BANK, DEGREE, STATES, gain_vector
from marsedl.papers.desensitized.inputs import DesensitizedInputs
from marsedl.papers.desensitized.linearization import position_columns, position_rows
from marsedl.papers.desensitized.nominal import zero_crossings
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    DENSITY,
    LAWS,
    NO_DOC,
    RESHAPED,
    Branches,
    Certificates,
    FlightEnsemble,
    FurtherPerturbations,
    Gains,
    GainStudy,
    Linearization,
    MinimumFuel,
    Nominal,
    Responses,
    Tradeoff,
)
from marsedl.replication.catalogue import Artifacts
from marsedl.replication.claims import Close, Declaration, Evaluation

PLAIN, SHAPED = LAWS.index(NO_DOC), LAWS.index(RESHAPED)
LAW_OF = [LAWS.index(channel) for channel in CHANNELS]
ALL_LAW = LAWS.index(ALL_COLUMNS)
RADIUS, CROSSRANGE, DOWNRANGE = range(len(CHANNELS))
LONGITUDE = STATES.index("longitude")
RADIUS_PHASES, DOWNRANGE_PHASES = (100.0, 200.0), (130.0, 200.0)  # s, as the text has them (Figs. 5b and 7b)
MSL_FUEL = 9.0  # kg, as the paper quotes it
ENERGY, FUEL, ENERGY_BESIDE = range(3)  # solutions of the study of least fuel

# What the tests of statements call so. Fixed from the words before the first evaluation here; final errors, reversals
# and the course of the bank angle were known in outline.
ROUNDING = 1e-6  # relative; closer than this is equal
EXACT = 1e-9  # of an identity between sensitivities of order one
NEARLY = 0.01  # relative: "approximately proportional"
NOT_FAR = 0.25  # more fuel than the least: a quarter is "not too far off"
VISIBLE = 5.0 * DEGREE  # change of a bank angle that a figure of several hundred degrees shows
TYPICAL = 0.5  # share of the desensitized rows that must do what is "typical"
SATISFACTORY = 1.0  # m/m: an error at entry that does not grow
SOME = 0.1  # relative reduction: "some level"
GREATLY = 0.2  # what "greatly reduced" leaves: a fifth
SIGNIFICANT = 0.5  # what "significantly reduced", "by far" and "much smaller" leave: half
MAINLY = 0.9  # share of one component in the norm
LINEAR = 0.1  # of the final error without feedback: by less a final error departs from its tangent while it is linear
MOST = 0.8  # of a span: its times are round, and those of other gains
NOTICEABLE = 0.1  # of the error at entry
CORRECTED = 0.5  # of an error: less is left when it has been corrected
COMPARABLE = 1.5  # factor between levels of acceleration
EXCESSIVE = 1.25  # factor of fuel
MUCH_LESS = 0.1  # factor of fuel
DEEP_ALTITUDE = 15e3  # m, told beside the altitude that decides


@dataclass(frozen=True)
class Records(Artifacts):
    """What the claims are measured from."""

    nominal: Nominal
    tradeoff: Tradeoff
    linearization: Linearization
    gains: Gains
    responses: Responses
    entry_errors: FlightEnsemble
    gain_study: GainStudy | None = None
    branches: Branches | None = None
    minimum_fuel: MinimumFuel | None = None
    certificates: Certificates | None = None
    further_perturbations: FurtherPerturbations | None = None


def evaluate(inputs: DesensitizedInputs, records: Records) -> dict[str, Evaluation | None]:
    """Evaluate every claim in one reading.

    Claims that rest on a study which is not done for the reading are None. Flights that are lost, and gains that did
    not converge, meet no statement about them.
    """
    rows, gains, responses = _Rows(inputs, records.tradeoff), records.gains, records.responses
    of_linearization = records.linearization, gains, responses
    return {
        **_stated_inputs(inputs, rows),
        **_objective_claims(rows, records.minimum_fuel),
        **_nominal_claims(inputs, records.nominal, rows),
        **_table_claims(rows, records.certificates, records.branches),
        **_radius_claims(inputs, gains, responses),
        **_downrange_claims(inputs, *of_linearization, records.certificates, records.gain_study),
        **_crossrange_claims(inputs, *of_linearization, records.gain_study),
        **_outlook_claims(records.nominal, rows, gains, responses, records.entry_errors, records.further_perturbations),
    }


# ---- shared measures -------------------------------------------------------------------------------------------------


def printed_rows(published):
    """Rows of Table 3 as printed, by c1: control energy, cumulative bank rate, fuel and final error."""
    last = (*published["tab03_cinf_effort"].printed, published["tab03_cinf_error"].printed)
    finite = ("tab03_c0", "tab03_c0p001", "tab03_c0p01", "tab03_c0p1", "tab03_c1")
    rows = (*(published[key].printed for key in finite), last)
    return dict(zip(map(float, published["c1_values"].printed), rows, strict=True))


def size(vectors):
    """Norms over the last dimension."""
    return np.linalg.norm(vectors, axis=-1)


def time_below(time, altitude, limit):
    """Time spent below an altitude, s, by lines between the nodes."""
    fine = np.linspace(time[0], time[-1], 100 * len(time))
    return float((np.interp(fine, time, altitude) < limit).mean() * (time[-1] - time[0]))


def linear_domain(gains, responses, law, channel):
    """Largest error at entry up to which the flown final errors keep to their tangent at zero, m.

    They do while they are apart from it by less than `LINEAR` of what the sensitivity without feedback gives.
    """
    errors = np.concatenate([responses.wide[channel], responses.narrow[channel]])
    flown = np.concatenate([responses.wide_error[law, channel], responses.narrow_error[law, channel]])
    apart = size(flown - errors[:, np.newaxis] * gains.final[law, :, channel])
    within = apart <= LINEAR * np.abs(errors) * size(gains.final[PLAIN, :, channel])
    lost = np.abs(errors[~within])  # NaN is not within
    inside = np.abs(errors) < lost.min(initial=np.inf)
    return float(np.abs(errors[inside]).max(initial=0.0))


def remaining(responses, law, channel):
    """Share of the final error without feedback that a law leaves, (2,) for the error of Table 3 either way."""
    return size(responses.tabulated_error[law, channel]) / size(responses.tabulated_error[PLAIN, channel])


def remaining_when_small(responses, law, channel):
    """The same for the smallest and the largest error of the zoomed sweep."""
    ends = [0, -1]
    kept = size(responses.narrow_error[law, channel][ends]) / size(responses.narrow_error[PLAIN, channel][ends])
    return kept[::-1]  # positive error first


def _listed(values, form=".3f"):
    return ", ".join(f"{value:{form}}" if np.isfinite(value) else "none" for value in np.atleast_1d(values))


class _Rows:
    """The rows of Table 3: c1 = 0, the printed weights, and the largest of those that stand for an infinite one."""

    def __init__(self, inputs: DesensitizedInputs, tradeoff):
        self.tradeoff, self.tabulated_error = tradeoff, inputs.simulation.tabulated_error
        self.infinite = np.flatnonzero(~np.isfinite(tradeoff.printed_weight))
        self.number = np.array([*np.flatnonzero(np.isfinite(tradeoff.printed_weight)), self.infinite[-1]])
        self.weight = tradeoff.weight[self.number]
        self.effort = tradeoff.effort[self.number]
        self.cumulative = tradeoff.cumulative[self.number] / DEGREE
        self.propellant = tradeoff.propellant[self.number]
        self.vector = tradeoff.error[self.number]
        self.error = size(self.vector)
        self.reversals = tradeoff.reversals[self.number]
        matched = inputs.design.weight_rule == "matched"
        self.chosen = "; rows of finite weight are chosen for their printed J0" if matched else ""
        self.efforts = f"J0 of the rows {_listed(self.effort, '.4f')} deg^2/s^3{self.chosen}"
        self.errors = f"final position errors of the rows {_listed(self.error, '.1f')} m"
        self.fuels = f"fuel of the rows {_listed(self.propellant, '.4f')} kg"

    def limits(self, name):
        """The values of a field for the smallest and the largest weight that stands for infinity."""
        return getattr(self.tradeoff, name)[self.infinite[[0, -1]]]


class _Flight:
    """The flight with the error that the figures draw in a channel, under its feedback, beside its nominal."""

    def __init__(self, inputs: DesensitizedInputs, gains, responses, channel):
        law = LAW_OF[channel]
        self.converged, self.ended = bool(gains.converged[law]), str(gains.ended[law])
        self.entry_error = float(responses.drawn_error[channel])
        self.time, self.end = responses.time[law], float(responses.time[law, -1])
        self.nominal, self.state = responses.nominal[law], responses.state[law, channel]
        self.bank = self.nominal[:, BANK]
        self.deviation = self.state[:, BANK] - self.bank
        self.error = responses.error[law, channel]
        self.without_time, self.without = responses.time[PLAIN], responses.error[PLAIN, channel]
        self.reversal_times = zero_crossings(self.time, self.bank)
        self.air = density.profile(inputs.planet)

    def share(self, sign, begins, ends, side=0):
        """Share of a span in which the bank angle departs to a side, with the nominal one on a given side or any."""
        inside = (self.time > begins) & (self.time <= ends)
        met = (sign * self.deviation > ROUNDING) & ((side == 0) | (side * self.bank > 0.0))
        return float(met[inside].mean()) if inside.any() else 0.0

    def at(self, time):
        """Radius, crossrange and downrange error at a time, (3,), m."""
        return np.array([np.interp(time, self.time, component) for component in self.error.T])

    def without_feedback(self, time):
        """The same of the flight without feedback."""
        return np.array([np.interp(time, self.without_time, component) for component in self.without.T])

    def outward(self, time):
        """Crossrange error at a time, positive to the side on which the nominal is, m."""
        return float(np.sign(np.interp(time, self.time, self.nominal[:, 1])) * self.at(time)[CROSSRANGE])

    def _pressures(self, begins, ends):
        """Density times squared velocity, which drag and lift go with, of flight and nominal, and the nodes taken."""
        inside = (self.time >= begins) & (self.time <= ends)
        states = self.state[inside], self.nominal[inside]
        return *(np.exp(self.air(y[:, 0])[0]) * (y[:, 3:6] ** 2).sum(axis=1) for y in states), inside

    def more_drag(self, begins, ends):
        """Relative excess of the mean drag over a span above that of the nominal."""
        own, other, inside = self._pressures(begins, ends)
        return float(own.mean() / other.mean() - 1.0) if inside.any() else np.nan

    def more_lift(self, begins, ends):
        """Excess of the mean vertical lift over a span above that of the nominal, as a share of all lift."""
        own, other, inside = self._pressures(begins, ends)
        vertical = own * np.cos(self.state[inside, BANK]) - other * np.cos(self.bank[inside])
        return float(vertical.mean() / other.mean()) if inside.any() else np.nan

    @property
    def first_change(self):
        """When the bank angle's deviation first changes its sign; NaN if it never does."""
        found = zero_crossings(self.time[1:], self.deviation[1:])
        return float(found[0]) if found.size else np.nan

    @property
    def last_reversal(self):
        """When the nominal bank angle last passes zero; NaN if it never does."""
        return float(self.reversal_times[-1]) if self.reversal_times.size else np.nan

    def statement(self, met, evidence, **numbers):
        """A statement about this flight."""
        troubles = [] if self.converged else [f"the gains did not converge ({self.ended})"]
        troubles += [] if np.isfinite(self.error).all() else ["the flight is lost"]
        return Evaluation(bool(met) and not troubles, evidence="; ".join([evidence, *troubles]), numbers=numbers)


# ---- stated inputs ---------------------------------------------------------------------------------------------------


def _stated_inputs(inputs: DesensitizedInputs, rows):
    fit, used = atmosphere.TEMPERATURE_PRESSURE_FIT, inputs.planet.density_profile == "temperature_pressure_fit"
    told = "" if used else f"this reading flies in the density profile {inputs.planet.density_profile}"
    air = {
        "atm_temperature_poly": fit.temperature[::-1],
        "atm_pressure_fit": (fit.surface_pressure, -fit.pressure_decay),
        "atm_gas_constant": fit.gas_constant,
    }
    radius, crossrange, downrange = inputs.simulation.drawn_errors
    values = {
        "tab01_diameter": inputs.vehicle.aeroshell_diameter,
        "tab01_ballistic_coefficient": inputs.vehicle.ballistic_coefficient,
        "tab01_lift_to_drag": inputs.vehicle.lift_to_drag,
        "tab01_roll_inertia": inputs.vehicle.roll_inertia,
        "tab01_yaw_inertia": inputs.vehicle.yaw_inertia,
        "tab01_roll_arm": inputs.vehicle.roll_arm,
        "tab01_yaw_arm": inputs.vehicle.yaw_arm,
        "tab01_specific_impulse": inputs.vehicle.specific_impulse,
        "sphere_cone_angle": inputs.vehicle.cone_angle / DEGREE,
        "trim_angle_of_attack": inputs.vehicle.angle_of_attack / DEGREE,
        "bank_acceleration_bound": inputs.vehicle.bank_acceleration_bound / DEGREE,
        "bank_rate_bound": inputs.vehicle.bank_rate_bound / DEGREE,
        "tab02_altitude": [inputs.mission.entry_altitude / 1e3, inputs.mission.final_altitude / 1e3],
        "tab02_velocity": [inputs.mission.entry_velocity, inputs.mission.final_velocity],
        "tab02_longitude": [inputs.mission.entry_longitude / DEGREE, inputs.mission.final_longitude / DEGREE],
        "tab02_latitude": [inputs.mission.entry_latitude / DEGREE, inputs.mission.final_latitude / DEGREE],
        "tab02_flight_path_angle": inputs.mission.entry_flight_path_angle / DEGREE,
        "node_count": inputs.solver.intervals + 1,
        "perturbation_sizes": [inputs.simulation.tabulated_error, radius, downrange, crossrange],
    }
    return {
        **{name: Evaluation(np.where(used, value, np.nan), evidence=told) for name, value in air.items()},
        **{name: Evaluation(value) for name, value in values.items()},
        "c1_values": Evaluation(
            rows.weight,
            evidence=f"the weights solved with, in deg^2/s^3; {rows.weight[-1]:g} stands for infinity{rows.chosen}",
            numbers={"largest": rows.weight[-1]},
        ),
    }


# ---- objectives (Secs. 2 and 3) --------------------------------------------------------------------------------------


def _objective_claims(rows, minimum_fuel):
    ratio = rows.propellant / rows.cumulative
    lowest = rows.tradeoff.path_effort.min()
    return {
        "fuel_proportional_to_cumulative_rate": Evaluation(
            bool(np.ptp(ratio) < NEARLY * ratio.mean()),
            evidence=f"fuel over cumulative bank rate {ratio.min():.6f} to {ratio.max():.6f} kg s/deg over the rows of "
            "Table 3",
            numbers={"ratio": ratio.mean()},
        ),
        "min_fuel_bang_coast_bang": minimum_fuel and _bang_claim(minimum_fuel),
        "min_energy_fuel_near_min_fuel": minimum_fuel and _least_fuel_claim(minimum_fuel),
        "desensitized_j0_larger": Evaluation(
            bool((rows.effort[1:] > rows.effort[0] * (1.0 + ROUNDING)).all()),
            evidence=f"{rows.efforts}; the least on the path of increasing weights is {lowest:.4f} deg^2/s^3",
            numbers={"lowest": lowest, "first": rows.effort[0]},
        ),
    }


def _bang_claim(found):
    """Judged where thrust lasts longer than an interval, under the smallest bound."""
    tight, wide = int(np.argmin(found.bound)), int(np.argmax(found.bound))
    coasting, full, bursts = (getattr(found, name)[tight, FUEL] for name in ("coasting", "at_bound", "bursts"))
    between = (1.0 - coasting - full) * found.bank_acceleration.shape[-1]
    violation = found.switching_violation.max()
    return Evaluation(
        bool(min(coasting, full) > 0.0 and bursts > 1 and between < 2.0 * bursts + 0.5 and violation < NEARLY),
        evidence=f"bound {found.bound[tight] / DEGREE:g} deg/s^2: {100 * coasting:.0f} % of the intervals without "
        f"thrust, {100 * full:.0f} % at the bound, {between:.0f} in between, where one of {bursts} bursts begins or "
        f"ends; bound {found.bound[wide] / DEGREE:g} deg/s^2: {found.bursts[wide, FUEL]} bursts, "
        f"{100 * found.at_bound[wide, FUEL]:.0f} % of the intervals at the bound; the switching function is "
        f"contradicted by at most {violation:.1g}",
    )


def _least_fuel_claim(found):
    """The nominal, which the paper finds by minimising J0, against the least fuel found under the widest bound."""
    wide = int(np.argmax(found.bound))
    total, fuel = found.cumulative[wide] / DEGREE, found.propellant[wide]
    excess = fuel[ENERGY] / fuel[FUEL] - 1.0
    numbers = {
        "nominal": fuel[ENERGY],
        "least": fuel[FUEL],
        "ratio": fuel[ENERGY] / fuel[FUEL],
        "beside": 100.0 * (fuel[ENERGY_BESIDE] / fuel[FUEL] - 1.0),
        "on_branch": 100.0 * (1.0 - found.branch_cumulative[wide] / found.cumulative[wide, ENERGY]),
        "reversals": int(found.reversals[wide, FUEL]),
    }
    return Evaluation(
        bool(excess < NOT_FAR),
        evidence=f"{fuel[ENERGY]:.4f} kg ({total[ENERGY]:.3f} deg/s) of the nominal, {fuel[FUEL]:.4f} kg "
        f"({total[FUEL]:.3f} deg/s) at least; the solution of least J0 beside that one needs {fuel[ENERGY_BESIDE]:.4f} "
        f"kg; not far is up to {100 * NOT_FAR:g} % more",
        numbers=numbers,
    )


# ---- nominal (Fig. 1) ------------------------------------------------------------------------------------------------


def _nominal_claims(inputs: DesensitizedInputs, nominal, rows):
    rate, acceleration = nominal.largest_bank_rate, nominal.largest_bank_acceleration
    rate_bound, acceleration_bound = inputs.vehicle.bank_rate_bound, inputs.vehicle.bank_acceleration_bound
    return {
        "nodoc_two_reversals": Evaluation(
            nominal.reversals,
            evidence=f"the bank angle passes zero at {_listed(nominal.reversal_times, '.1f')} s",
        ),
        "nodoc_rate_within_bounds": Evaluation(
            bool(rate <= rate_bound * (1.0 + ROUNDING)),
            evidence=f"bank rate up to {rate / DEGREE:.3f} deg/s, bound {rate_bound / DEGREE:g} deg/s",
        ),
        "nodoc_accel_within_bounds": Evaluation(
            bool(acceleration <= acceleration_bound * (1.0 + ROUNDING)),
            evidence=f"bank acceleration up to {acceleration / DEGREE:.4f} deg/s^2, bound "
            f"{acceleration_bound / DEGREE:g} deg/s^2",
        ),
        "nodoc_text_error_j0_fuel": Evaluation([rows.error[0], rows.effort[0], rows.propellant[0]]),
    }


# ---- Table 3 and Fig. 2 ----------------------------------------------------------------------------------------------


def _table_claims(rows, certificates, branches):
    fuel_limits = rows.limits("propellant")
    stands_for = "with the weights {:g} and {:g}".format(*rows.limits("weight"))
    reduction, growth = 1.0 - rows.error / rows.error[0], rows.error / rows.tabulated_error
    steps, folds = np.diff(rows.propellant), rows.tradeoff.fold_effort
    transcriptions = _transcriptions(certificates)
    fold = rows.tradeoff.fold_weight[0, 0] if len(folds) else np.nan
    values = {
        claim: Evaluation(
            [rows.effort[row], rows.cumulative[row], rows.propellant[row], rows.error[row]],
            evidence=f"weight {rows.weight[row]:.4g} deg^2/s^3; altitude, crossrange and downrange error "
            f"{_listed(rows.vector[row], '.0f')} m; bank reversals: {rows.reversals[row]}",
            numbers={"weight": rows.weight[row], "fold": fold, **transcriptions},
        )
        for row, claim in enumerate(("tab03_c0", "tab03_c0p001", "tab03_c0p01", "tab03_c0p1", "tab03_c1"))
    }
    return {
        **values,
        "tab03_cinf_effort": Evaluation(
            [rows.effort[-1], rows.cumulative[-1], rows.propellant[-1]],
            evidence=f"{stands_for} J0 is {_listed(rows.limits('effort'), '.1f')} deg^2/s^3, the cumulative bank rate "
            f"{_listed(rows.limits('cumulative') / DEGREE, '.1f')} deg/s and fuel {_listed(fuel_limits, '.2f')} kg",
            numbers={"low": [rows.limits("effort")[0], rows.limits("cumulative")[0] / DEGREE, fuel_limits[0]]},
        ),
        "tab03_cinf_error": Evaluation(
            rows.error[-1], evidence=f"{stands_for} {_listed(size(rows.limits('error')), '.2f')} m"
        ),
        "max_reduction_percent": Evaluation(
            100.0 * reduction[-1], evidence=f"from {rows.error[0]:.1f} m to {rows.error[-1]:.1f} m"
        ),
        "fuel_ratio_cinf_to_nodoc": Evaluation(
            rows.propellant[-1] / rows.propellant[0],
            evidence=f"{stands_for} {_listed(fuel_limits / rows.propellant[0], '.1f')}",
            numbers={"low": fuel_limits[0] / rows.propellant[0]},
        ),
        "nodoc_smallest_j0": Evaluation(
            bool((rows.effort[1:] > rows.effort[0]).all()),
            evidence=rows.efforts + _other_solutions(branches, rows),
            numbers={"effort": rows.effort[0], **_lower(branches)},
        ),
        "nodoc_largest_sensitivity": Evaluation(
            bool((rows.error[1:] < rows.error[0]).all()), evidence=rows.errors, numbers={"first": rows.error[0]}
        ),
        "error_decreases_with_c1": Evaluation(bool((np.diff(rows.error) < 0.0).all()), evidence=rows.errors),
        "j0_increases_with_c1": Evaluation(
            bool((np.diff(rows.effort) > 0.0).all()),
            evidence=rows.efforts
            + "".join(f"; where a branch ends J0 goes from {a:.4f} to {b:.4f} deg^2/s^3" for a, b in folds),
            numbers=dict(zip(("before", "beyond"), folds[0] if len(folds) else (np.nan, np.nan), strict=True)),
        ),
        "fuel_increases_except_first_step": Evaluation(
            bool(steps[0] < 0.0 and (steps[1:] > 0.0).all()), evidence=rows.fuels
        ),
        "more_fuel_when_desensitized": Evaluation(
            bool(np.mean(rows.propellant[1:] > rows.propellant[0]) > TYPICAL), evidence=rows.fuels
        ),
        "lower_altitude_when_desensitized": _low_altitude_claim(rows),
        "more_reversals_when_desensitized": Evaluation(
            bool(np.mean(rows.reversals[1:] > rows.reversals[0]) > TYPICAL),
            evidence=f"bank reversals of the rows {_listed(rows.reversals, '.0f')}",
            numbers={
                "more": int((rows.reversals[1:] > rows.reversals[0]).sum()),
                "count": len(rows.reversals) - 1,
            },
        ),
        "fig02_reshaping_evident": _reshaping_claim(rows),
        "reshaping_alone_insufficient": Evaluation(
            bool((growth > SATISFACTORY).all()),
            evidence=f"an error of the radius grows by {_listed(growth, '.2f')} in the rows; it should not grow",
        ),
        "radius_reducible_by_reshaping": Evaluation(
            bool(reduction.max() > SOME),
            evidence=f"final position errors of the rows are up to {100 * reduction.max():.1f} % smaller than that of "
            f"the first; some reduction is {100 * SOME:g} %",
        ),
    }


def _transcriptions(certificates):
    """Smallest and largest J0 of the nominal over transcriptions and meshes."""
    if certificates is None:
        return {"transcribed_low": np.nan, "transcribed_high": np.nan}
    found = certificates.mesh_effort[0]
    solved = found[np.isfinite(found)]
    return {"transcribed_low": solved.min(initial=np.inf), "transcribed_high": solved.max(initial=-np.inf)}


def _lower(branches):
    """The local minimum of least J0 without weight, and how many finite rows have the least J0 at their error."""
    if branches is None:
        return {"lower": np.nan, "lower_name": "", "own_least": np.nan}
    least = int(np.argmin(branches.effort))
    return {
        "lower": branches.effort[least],
        "lower_name": str(branches.name[least]),
        "own_least": int((branches.least_solution < 0).sum()),
    }


def _other_solutions(branches, rows):
    """Known local minima without weight in words, to be added to a sentence."""
    if branches is None:
        return ""
    known = ", ".join(f"{value:.4f} ({name})" for name, value in zip(branches.name, branches.effort, strict=True))
    return (
        f"; local minima without weight {known}; of the {len(branches.row_weight)} rows of finite weight "
        f"{(branches.least_solution < 0).sum()} have the least J0 known at their error"
    )


def _low_altitude_claim(rows):
    """Time below the altitude under which the first row spends half of its flight, which singles out no altitude."""
    tradeoff = rows.tradeoff
    courses = [(tradeoff.time[number], tradeoff.state[number, :, 0]) for number in rows.number]
    limit = float(np.median(courses[0][1]))
    spent, deep = (
        np.array([time_below(*course, altitude) for course in courses]) for altitude in (limit, DEEP_ALTITUDE)
    )
    longer = int((spent[1:] > spent[0]).sum())
    return Evaluation(
        bool(longer > TYPICAL * (len(spent) - 1)),
        evidence=f"below {limit / 1e3:.1f} km, where the first row is half of the time, the rows spend "
        f"{_listed(spent, '.1f')} s; below {DEEP_ALTITUDE / 1e3:g} km {_listed(deep, '.1f')} s",
        numbers={
            "limit": limit / 1e3,
            "longer": longer,
            "count": len(spent) - 1,
            "deep": DEEP_ALTITUDE / 1e3,
            "deep_longer": int((deep[1:] > deep[0]).sum()),
        },
    )


def _reshaping_claim(rows):
    banks = rows.tradeoff.state[rows.number, :, BANK]
    change = np.abs(banks - banks[0]).max(axis=1)[1:]
    return Evaluation(
        bool((change > VISIBLE).all()),
        evidence=f"at the same share of the flight the bank angles of the rows depart from the first by up to "
        f"{_listed(change / DEGREE, '.1f')} deg; a figure shows {VISIBLE / DEGREE:g} deg",
    )


# ---- radius (Figs. 3 to 5) -------------------------------------------------------------------------------------------


def _radius_claims(inputs: DesensitizedInputs, gains, responses):
    law, found = LAW_OF[RADIUS], _Flight(inputs, gains, responses, RADIUS)
    without, reshaped, under = size(responses.error[[PLAIN, SHAPED, law], RADIUS, -1])
    downrange = responses.error[PLAIN, RADIUS, -1, DOWNRANGE]
    linear = size(gains.final[law, :, RADIUS]) / size(gains.final[PLAIN, :, RADIUS])
    wide, narrow = (
        size(values[[PLAIN, SHAPED, law], RADIUS][:, np.abs(errors[RADIUS]) > 0.0])
        for values, errors in ((responses.wide_error, responses.wide), (responses.narrow_error, responses.narrow))
    )
    domains = [linear_domain(gains, responses, number, RADIUS) for number in (PLAIN, SHAPED, law)]
    best = narrow[2] / narrow[:2].min(axis=0)
    levels = np.abs(responses.acceleration[law, RADIUS]).max(), np.abs(responses.nominal_acceleration[law]).max()
    fuels = responses.cumulative[law, RADIUS], responses.nominal_cumulative[law]
    drawn = entry_problem.position_errors(
        responses.state[law, RADIUS], responses.nominal[law], inputs.planet.planet_radius
    )
    same = np.allclose(drawn, responses.error[law, RADIUS], rtol=0.0, atol=ROUNDING * found.entry_error, equal_nan=True)
    entry = f"{found.entry_error:g} m of radius error"
    return {
        "feedback_radius_greatly_reduced": found.statement(
            linear < GREATLY and under < GREATLY * without,
            f"feedback leaves {100 * linear:.2g} % of the linear sensitivity, and {under:.0f} of {without:.0f} m as "
            f"flown after {entry}; greatly reduced is to {100 * GREATLY:g} %",
            left=100.0 * under / without,
        ),
        "fig03_nofeedback_below_nodoc": Evaluation(
            bool((wide[1] < wide[0]).all()),
            evidence=f"in {(wide[1] < wide[0]).sum()} of {wide.shape[1]} flights, to {responses.wide[RADIUS, -1]:g} m "
            f"either way; {reshaped:.0f} against {without:.0f} m after {entry}",
        ),
        "fig03a_feedback_smaller_linear_domain": found.statement(
            domains[2] < SIGNIFICANT * min(domains[:2]),
            f"final errors keep within {100 * LINEAR:g} % of those without feedback of their tangent up to "
            f"{_listed(domains, '.0f')} m of radius error (no-DOC, DOC without feedback, with feedback; flown up to "
            f"{responses.wide[RADIUS, -1]:g} m)",
        ),
        "fig03b_feedback_best_small_errors": found.statement(
            (best < SIGNIFICANT).all(),
            f"up to {responses.narrow[RADIUS, -1]:g} m of radius error either way feedback leaves at most "
            f"{100 * best.max():.1f} % of the smaller final error without it; much closer is {100 * SIGNIFICANT:g} %",
        ),
        "fig04_nodoc_downrange_200m": Evaluation(downrange, evidence=f"flown without feedback after {entry}"),
        "fig04_nodoc_mainly_downrange": Evaluation(
            bool(abs(downrange) > MAINLY * without),
            evidence=f"downrange {downrange:.0f} m of {without:.0f} m; mainly is {MAINLY:g} of it",
        ),
        "fig04_ordering": found.statement(
            under < SIGNIFICANT * reshaped and SIGNIFICANT * without < reshaped < without,
            f"final errors after {entry}: {without:.0f} m (no-DOC), {reshaped:.0f} m (DOC without feedback), "
            f"{under:.0f} m (with feedback); by far is to less than {100 * SIGNIFICANT:g} %",
        ),
        "fig04_fig05_same_trajectory": Evaluation(
            bool(same),
            evidence=f"the errors of Fig. 4 are {'' if same else 'not '}those of the flight of Fig. 5, by construction",
        ),
        "fig05a_comparable_acceleration": found.statement(
            levels[1] / COMPARABLE < levels[0] < COMPARABLE * levels[1] and fuels[0] < EXCESSIVE * fuels[1],
            f"bank acceleration up to {levels[0] / DEGREE:.4f} deg/s^2 after {entry}, nominally "
            f"{levels[1] / DEGREE:.4f} deg/s^2; cumulative bank rate {fuels[0] / DEGREE:.3f} and "
            f"{fuels[1] / DEGREE:.3f} deg/s",
        ),
        "fig05b_phase_times": Evaluation(
            [found.first_change, found.last_reversal],
            evidence="first change of sign of the bank angle's deviation, and last reversal of the nominal",
        ),
        **_radius_phase_claims(found),
    }


def _radius_phase_claims(found):
    first, second = RADIUS_PHASES
    shares = (
        found.share(-1, 0.0, first),
        found.share(1, first, second),
        found.share(1, second, found.end, side=-1),
    )
    start, early, late, last = (found.at(time) for time in (0.0, first, second, found.end))
    alone = found.without_feedback(first)
    deeper = found.at(first)[RADIUS] < min(start[RADIUS], alone[RADIUS])
    dense, thin = found.more_drag(first - 0.1 * first, first), found.more_drag(second, found.end)
    lift = found.more_lift(second, found.end)
    left = np.abs(last)[[RADIUS, DOWNRANGE]] / np.abs(late)[[RADIUS, DOWNRANGE]]
    return {
        "fig05b_phase1_more_reversed": found.statement(
            shares[0] >= MOST,
            f"more negative than the nominal bank angle for {100 * shares[0]:.0f} % of the first {first:g} s",
        ),
        "fig05b_phase2_larger_positive": found.statement(
            shares[1] >= MOST,
            f"more positive than the nominal bank angle for {100 * shares[1]:.0f} % of the time from {first:g} to "
            f"{second:g} s, from {found.first_change:.1f} s on",
        ),
        "fig05b_phase3_smaller_reversed": found.statement(
            shares[2] >= MOST,
            f"less negative than the nominal bank angle for {100 * shares[2]:.0f} % of the time from {second:g} s on",
        ),
        "fig04_phase1_position_effects": found.statement(
            found.outward(first) > NOTICEABLE * found.entry_error
            and deeper
            and dense > 0.0
            and abs(early[DOWNRANGE]) < abs(alone[DOWNRANGE]),
            f"at {first:g} s crossrange {found.outward(first):+.0f} m further out than the nominal, radius error "
            f"{early[RADIUS]:.0f} m ({alone[RADIUS]:.0f} m without feedback), drag {100 * dense:+.2f} % just before, "
            f"downrange error {early[DOWNRANGE]:.0f} m ({alone[DOWNRANGE]:.0f} m without feedback)",
        ),
        "fig04_phase2_position_effects": found.statement(
            late[RADIUS] < early[RADIUS]
            and late[DOWNRANGE] < early[DOWNRANGE]
            and abs(late[CROSSRANGE]) < abs(early[CROSSRANGE]),
            f"from {first:g} to {second:g} s the radius error goes from {early[RADIUS]:.0f} to {late[RADIUS]:.0f} m, "
            f"downrange from {early[DOWNRANGE]:.0f} to {late[DOWNRANGE]:.0f} m, crossrange from "
            f"{early[CROSSRANGE]:.0f} to {late[CROSSRANGE]:.0f} m",
            early=early[CROSSRANGE],
            late=late[CROSSRANGE],
            last=last[CROSSRANGE],
            turned=float(found.time[np.nanargmax(np.abs(found.error[:, CROSSRANGE]))])
            if np.isfinite(found.error).any()
            else np.nan,
        ),
        "fig04_phase3_position_effects": found.statement(
            (left < CORRECTED).all() and lift > 0.0 and thin < 0.0,
            f"from {second:g} s on the radius error goes from {late[RADIUS]:.0f} to {last[RADIUS]:.0f} m and downrange "
            f"from {late[DOWNRANGE]:.0f} to {last[DOWNRANGE]:.0f} m; mean vertical lift {100 * lift:+.1f} % of all "
            f"lift, mean drag {100 * thin:+.2f} % against the nominal",
            lift=100.0 * lift,
            drag=100.0 * thin,
        ),
    }


# ---- downrange (Figs. 6 to 8) ----------------------------------------------------------------------------------------


def _reduction_claims(gains, responses, channel, found):
    """Whether a channel's feedback reduces its sensitivity significantly, and more so for small errors."""
    law = LAW_OF[channel]
    linear = size(gains.final[law, :, channel]) / size(gains.final[PLAIN, :, channel])
    small, large = remaining_when_small(responses, law, channel), remaining(responses, law, channel)
    sizes = responses.narrow[channel, -1]
    shares = f"{_listed(100 * small, '.2f')} % of {sizes:g} m either way"
    return (
        found.statement(
            linear < SIGNIFICANT and (small < SIGNIFICANT).all(),
            f"feedback leaves {100 * linear:.2g} % of the linear sensitivity, and as flown {shares}; significantly "
            f"reduced is to {100 * SIGNIFICANT:g} %",
        ),
        found.statement(
            (small < large).all(),
            f"feedback leaves {shares}, and {_listed(100 * large, '.1f')} % of the error of Table 3",
        ),
    )


def _candidates(gain_study, channel):
    """Of all gains found for a channel the smallest and largest flown final error, m, at the largest error at entry.

    Those under which a flight is lost are counted beside.
    """
    if gain_study is None:
        return {"least": np.nan, "most": np.nan, "count": 0, "lost": 0}
    own = gain_study.channel == channel
    largest = np.abs(gain_study.tuning_error) == np.abs(gain_study.tuning_error).max()
    worst = gain_study.flown_error[own][:, largest].max(axis=1)
    kept = worst[np.isfinite(worst)]
    return {
        "least": kept.min(initial=np.inf),
        "most": kept.max(initial=-np.inf),
        "count": int(own.sum()),
        "lost": int(own.sum()) - len(kept),
    }


def _downrange_claims(inputs: DesensitizedInputs, linearization, gains, responses, certificates, gain_study):
    law, found = LAW_OF[DOWNRANGE], _Flight(inputs, gains, responses, DOWNRANGE)
    matrix = np.abs(linearization.state_matrix[:, :, LONGITUDE]).max()
    column = linearization.sensitivity[:, :, DOWNRANGE] * inputs.planet.planet_radius
    departed = np.abs(column - np.eye(len(STATES))[LONGITUDE]).max()
    reduced, more_when_small = _reduction_claims(gains, responses, DOWNRANGE, found)
    left = remaining(responses, law, DOWNRANGE)
    unguided = size(responses.tabulated_error[PLAIN, DOWNRANGE, 0]) / inputs.simulation.tabulated_error
    first, second = DOWNRANGE_PHASES
    return {
        "dfdy_third_column_zero": Evaluation(
            bool(matrix == 0.0), evidence=f"largest entry of that column along the nominal {matrix:g}"
        ),
        "dr_column_e3": Evaluation(
            column[-1, :7],
            evidence=f"and {column[-1, 7]:g}, the bank rate's; over all nodes the column departs from the unit vector "
            f"by {departed:.1g}",
        ),
        "dr_column_independent_of_scheme_and_shape": certificates and _scheme_claim(certificates),
        "dr_sensitivity_nodoc": Evaluation(
            unguided, evidence=f"flown with {inputs.simulation.tabulated_error:g} m of downrange error"
        ),
        "dr_needs_feedback": _needs_feedback(linearization, gains, DOWNRANGE),
        "dr_gain_on_longitude_nonzero": _longitude_gain_claim(inputs, linearization, gains),
        "fig06_feedback_significantly_reduced": reduced,
        "fig06_1000m_more_than_halved": found.statement(
            (left < 0.5).all(),
            f"feedback leaves {_listed(100 * left, '.1f')} % after {inputs.simulation.tabulated_error:g} m of "
            "downrange error, positive and negative",
            left=100.0 * left[0],
            **_candidates(gain_study, DOWNRANGE),
        ),
        "fig06b_reduction_larger_for_small_errors": more_when_small,
        "fig08_nofeedback_final_errors": Evaluation(
            responses.error[PLAIN, DOWNRANGE, -1], evidence=f"after {found.entry_error:g} m of downrange error"
        ),
        "fig07b_phase_times": Evaluation(
            [found.first_change, found.last_reversal],
            evidence="first change of sign of the bank angle's deviation, and last reversal of the nominal",
        ),
        **_downrange_phase_claims(found, first, second),
    }


def _downrange_phase_claims(found, first, second):
    shares = (
        found.share(-1, 0.0, first),
        found.share(1, first, found.end),
        found.share(1, second, found.end, side=-1),
    )
    start, early, late, last = (found.at(time) for time in (0.0, first, second, found.end))
    drag, lift = found.more_drag(0.0, first), found.more_lift(second, found.end)
    crossrange = np.abs(found.error[:, CROSSRANGE]).max()
    return {
        "fig07b_phase1_more_reversed": found.statement(
            shares[0] >= MOST,
            f"more negative than the nominal bank angle for {100 * shares[0]:.0f} % of the first {first:g} s, until "
            f"{found.first_change:.1f} s",
        ),
        "fig07b_phase2_more_positive": found.statement(
            shares[1] >= MOST and abs(last[CROSSRANGE]) < CORRECTED * crossrange,
            f"more positive than the nominal bank angle for {100 * shares[1]:.0f} % of the time from {first:g} s on; "
            f"of up to {crossrange:.0f} m of crossrange error {last[CROSSRANGE]:.0f} m are left",
        ),
        "fig07b_phase3_smaller_bank": found.statement(
            shares[2] >= MOST and lift > 0.0 and abs(last[RADIUS]) < CORRECTED * abs(late[RADIUS]),
            f"less negative than the nominal bank angle for {100 * shares[2]:.0f} % of the time from {second:g} s on, "
            f"mean vertical lift {100 * lift:+.1f} % of all lift; of {late[RADIUS]:.0f} m of radius error "
            f"{last[RADIUS]:.0f} m are left",
        ),
        "fig08_crossrange_excursion_smaller_radius": found.statement(
            found.outward(first) > NOTICEABLE * found.entry_error
            and early[RADIUS] < 0.0
            and drag > 0.0
            and early[DOWNRANGE] < (1.0 - NOTICEABLE) * start[DOWNRANGE],
            f"at {first:g} s crossrange {found.outward(first):+.0f} m further out than the nominal, radius "
            f"{early[RADIUS]:+.0f} m, mean drag until then {100 * drag:+.2f} %, downrange error "
            f"{early[DOWNRANGE]:.0f} of {start[DOWNRANGE]:.0f} m",
        ),
    }


def _scheme_claim(certificates):
    by_scheme = np.nanmax(certificates.mesh_longitude_deviation, axis=(0, 2))
    over_rows = certificates.row_longitude_deviation.max()
    return Evaluation(
        bool(max(by_scheme.max(), over_rows) < EXACT),
        evidence=f"the column departs from the unit vector by {_listed(by_scheme, '.1g')} "
        f"({', '.join(certificates.scheme)}) and, over the {len(certificates.row_weight)} nominals of the rows of "
        f"Table 3, by {over_rows:.1g}",
    )


def _needs_feedback(linearization, gains, channel):
    """Whether a sensitivity is the same in all rows of Table 3, and smaller with feedback."""
    name, law = CHANNELS[channel], LAW_OF[channel]
    rows = size(linearization.final[:, :, channel])
    under = size(gains.final[law, :, channel])
    apart = np.abs(rows / rows[0] - 1.0).max()
    return Evaluation(
        bool(apart < ROUNDING and under < SIGNIFICANT * rows[0]),
        evidence=f"final position error over {name} error {rows.min():.6f} to {rows.max():.6f} in the rows of Table 3, "
        f"{under:.2g} with feedback",
    )


def _longitude_gain_claim(inputs: DesensitizedInputs, linearization, gains):
    """The downrange column under the gains of its law, and without the one on the longitude."""
    scaled = gains.scaled_gain[LAW_OF[DOWNRANGE]]
    columns, step = position_columns(inputs.planet)[:, [DOWNRANGE]], np.diff(linearization.time)
    with_all, without_one = (
        propagate_columns(
            midpoint_transitions(
                closed_loop(
                    linearization.state_matrix,
                    linearization.control_matrix[:, :, np.newaxis],
                    gain_vector(inputs.planet, inputs.design, kept)[np.newaxis],
                ),
                step,
            ),
            columns,
        )[:, :, 0]
        for kept in (scaled, np.where(np.arange(len(scaled)) == LONGITUDE, 0.0, scaled))
    )
    final = size(position_rows(inputs.planet) @ with_all[-1])
    departed = np.abs((without_one - columns[:, 0]) * inputs.planet.planet_radius).max()
    return Evaluation(
        bool(departed < EXACT and abs(final - 1.0) > ROUNDING),
        evidence=f"final position error over downrange error {final:.6g} with the gains of the downrange law; without "
        f"their gain on the longitude the column departs from the unit vector by {departed:.1g}",
    )


# ---- crossrange (Figs. 9 to 11) --------------------------------------------------------------------------------------


def _crossrange_claims(inputs: DesensitizedInputs, linearization, gains, responses, gain_study):
    law, found = LAW_OF[CROSSRANGE], _Flight(inputs, gains, responses, CROSSRANGE)
    reduced, more_when_small = _reduction_claims(gains, responses, CROSSRANGE, found)
    unguided = size(responses.tabulated_error[PLAIN, CROSSRANGE, 0])
    factors = size(responses.tabulated_error[PLAIN, CROSSRANGE]) / size(responses.tabulated_error[law, CROSSRANGE])
    last = responses.error[PLAIN, CROSSRANGE, -1]
    others = np.abs(last[[RADIUS, DOWNRANGE]]).max()
    candidates = _candidates(gain_study, CROSSRANGE)
    turn = np.cos(inputs.mission.final_longitude - inputs.mission.entry_longitude)
    return {
        "cr_needs_feedback": _needs_feedback(linearization, gains, CROSSRANGE),
        "cr_sensitivity_nodoc": Evaluation(
            unguided / inputs.simulation.tabulated_error,
            evidence=f"flown with {inputs.simulation.tabulated_error:g} m of crossrange error; the cosine of the "
            f"longitude flown is {turn:.6f}",
            numbers={"turn": turn},
        ),
        "fig09_feedback_significantly_reduced": reduced,
        "fig09_reduction_factor_1000m": Evaluation(
            factors[0],
            evidence=f"{factors[1]:.1f} for the negative error"
            + (
                f"; the {candidates['count']} sets of gains that were found leave {candidates['least']:.1f} to "
                f"{candidates['most']:.1f} m"
                if candidates["count"]
                else ""
            ),
        ),
        "fig09_reduction_larger_for_small_errors": more_when_small,
        "fig11_nofeedback_crossrange_1000m": Evaluation(
            last[CROSSRANGE],
            evidence=f"after {found.entry_error:g} m; turned with the flight they would be "
            f"{turn * found.entry_error:.2f} m",
            numbers={"turn": turn, "turned": turn * found.entry_error},
        ),
        "fig11_nofeedback_only_crossrange": Evaluation(
            bool(others < 1e-3 * found.entry_error),
            evidence=f"errors in radius and downrange {others:.2f} m, crossrange {last[CROSSRANGE]:.1f} m",
        ),
        **_crossrange_phase_claims(found),
    }


def _crossrange_phase_claims(found):
    """Phases: until the first reversal of the nominal, between the first and the last, and from the last on."""
    if len(found.reversal_times) < 2:
        told = f"bank reversals of the nominal: {len(found.reversal_times)}; the statement needs two"
        names = [f"fig10b_phase{number}" for number in (1, 2, 3)]
        effects = [f"fig11_phase{number}_position_effects" for number in (1, 2, 3)]
        ends = ("_smaller_reversed", "_larger_positive", "_smaller_reversed")
        return {
            name: Evaluation(False, evidence=told)
            for name in [*(a + b for a, b in zip(names, ends, strict=True)), *effects]
        }
    first, second = found.reversal_times[0], found.last_reversal
    shares = (
        found.share(1, 0.0, first, side=-1),
        found.share(1, first, second, side=1),
        found.share(1, second, found.end, side=-1),
    )
    start, early, late, last = (found.at(time) for time in (0.0, first, second, found.end))
    alone = found.without_feedback(first)
    more, less = found.more_lift(0.0, first), found.more_lift(first, second)
    middle = found.error[(found.time >= first) & (found.time <= second)]
    peak = middle.max(axis=0)[[RADIUS, DOWNRANGE]]
    fallen = peak - late[[RADIUS, DOWNRANGE]]
    left = np.abs(last)[[RADIUS, DOWNRANGE]] / np.abs(late)[[RADIUS, DOWNRANGE]]
    return {
        "fig10b_phase1_smaller_reversed": found.statement(
            shares[0] >= MOST,
            f"less negative than the nominal bank angle for {100 * shares[0]:.0f} % of the time to {first:.1f} s",
        ),
        "fig10b_phase2_larger_positive": found.statement(
            shares[1] >= MOST,
            f"more positive than the nominal bank angle for {100 * shares[1]:.0f} % of the time from {first:.1f} to "
            f"{second:.1f} s",
        ),
        "fig10b_phase3_smaller_reversed": found.statement(
            shares[2] >= MOST,
            f"less negative than the nominal bank angle for {100 * shares[2]:.0f} % of the time from {second:.1f} s on",
        ),
        "fig11_phase1_position_effects": found.statement(
            more > 0.0
            and min(early[[RADIUS, DOWNRANGE]]) > 0.0
            and abs(early[CROSSRANGE]) < min(abs(start[CROSSRANGE]), abs(alone[CROSSRANGE])),
            f"until {first:.1f} s mean vertical lift {100 * more:+.2f} % of all lift; then radius "
            f"{early[RADIUS]:+.0f} m, downrange {early[DOWNRANGE]:+.0f} m, crossrange error {early[CROSSRANGE]:.0f} m "
            f"({alone[CROSSRANGE]:.0f} m without feedback)",
        ),
        "fig11_phase2_position_effects": found.statement(
            less < 0.0 and abs(late[CROSSRANGE]) < abs(early[CROSSRANGE]) and (fallen > NOTICEABLE * peak).all(),
            f"from {first:.1f} to {second:.1f} s crossrange error from {early[CROSSRANGE]:.0f} to "
            f"{late[CROSSRANGE]:.0f} m, mean vertical lift {100 * less:+.2f} % of all lift; radius falls from up to "
            f"{peak[0]:.0f} to {late[RADIUS]:.0f} m, downrange from up to {peak[1]:.0f} to {late[DOWNRANGE]:.0f} m",
        ),
        "fig11_phase3_position_effects": found.statement(
            (left < CORRECTED).all(),
            f"from {second:.1f} s on the radius error goes from {late[RADIUS]:.0f} to {last[RADIUS]:.0f} m and "
            f"downrange from {late[DOWNRANGE]:.0f} to {last[DOWNRANGE]:.0f} m",
        ),
    }


# ---- discussion ------------------------------------------------------------------------------------------------------


def _outlook_claims(nominal, rows, gains, responses, entry_errors, further_perturbations):
    singles = responses.nominal_cumulative[LAW_OF] / DEGREE
    together = responses.nominal_cumulative[ALL_LAW] / DEGREE
    converged = bool(gains.converged[[*LAW_OF, ALL_LAW]].all())
    dearest = rows.propellant.max()
    return {
        "gains_perturbation_specific": _specific_claim(gains, responses, entry_errors),
        "nominal_fuel_below_msl": Evaluation(
            bool(nominal.propellant < MUCH_LESS * MSL_FUEL),
            evidence=f"{nominal.propellant:.4f} kg, and about {MSL_FUEL:g} kg of the Mars Science Laboratory; far less "
            f"is a factor of {MUCH_LESS:g}",
        ),
        "more_perturbations_more_fuel": Evaluation(
            bool(converged and together > (1.0 + NEARLY) * singles.max()),
            evidence=f"cumulative bank rate of the nominals {_listed(singles, '.3f')} deg/s with gains against one "
            f"perturbation each, {together:.3f} deg/s with one set of gains against all three; J0 "
            f"{_listed(gains.effort[[*LAW_OF, ALL_LAW]], '.4f')} deg^2/s^3"
            + ("" if converged else "; not all gains converged")
            + _of_density(rows, further_perturbations),
            numbers={
                "single": singles.max(),
                "together": together,
                "left": 100.0 * _flown_shares(responses)[RADIUS],
            },
        ),
        "fuel_not_above_msl": Evaluation(
            bool(dearest <= MSL_FUEL),
            evidence=f"the dearest row of Table 3 burns {dearest:.2f} kg, the Mars Science Laboratory about "
            f"{MSL_FUEL:g} kg",
        ),
    }


def _of_density(rows, further_perturbations):
    """What desensitizing against the radius does to density errors, in words, to be added to a sentence."""
    if further_perturbations is None:
        return ""
    found = size(further_perturbations.row_linear_error[:, DENSITY])[rows.number]
    return (
        f"; reshaping against the radius lowers the final error for "
        f"{100 * further_perturbations.size[DENSITY]:g} % of density from {found[0]:.0f} to {found[-2]:.0f} m in the "
        "row of the largest finite weight"
    )


def _flown_shares(responses):
    """Share of the final error without feedback that one set of gains leaves of the errors drawn, by channel, (3,)."""
    return size(responses.error[ALL_LAW, :, -1]) / size(responses.error[PLAIN, :, -1])


def _specific_claim(gains, responses, entry_errors):
    """Sensitivities that the gains of a channel leave in the others."""
    final = size(np.moveaxis(gains.final[LAW_OF], 1, 2)) / size(gains.final[PLAIN].T)  # law, channel
    own, others = np.diag(final), final[~np.eye(len(CHANNELS), dtype=bool)]
    everything = size(gains.final[ALL_LAW].T) / size(gains.final[PLAIN].T)
    flown = _flown_shares(responses)
    final_error = size(entry_errors.final_error)
    typical = np.median(np.where(np.isfinite(final_error), final_error, np.inf), axis=1)
    laws = dict(zip(entry_errors.law, typical, strict=True))
    return Evaluation(
        bool((own < SIGNIFICANT).all() and (others > SIGNIFICANT).all()),
        evidence=f"of the sensitivities without feedback the gains leave {_listed(own, '.2g')} in their own channel "
        f"and {_listed(others, '.3g')} in the others; with errors in all channels at random half of the flights end "
        f"within {laws[NO_DOC]:.0f} m without feedback and within "
        f"{_listed([laws[channel] for channel in CHANNELS], '.0f')} m under these gains",
        numbers={
            "least": others.min(),
            "most": others.max(),
            "all_linear": 100.0 * everything.max(),
            "all_flown": 100.0 * flown.max(),
            "all_median": laws[ALL_COLUMNS],
            "plain_median": laws[NO_DOC],
        },
    )


# ---- what is known about them ----------------------------------------------------------------------------------------

PLANET = "the radius of Mars"
ENDS = "the conditions on the bank angle at both ends"
UNITS = "the units of the norm"
GAINS = "the feedback gains"

# What the numbers of Table 3 are open by, measured on solutions with other inputs. How far they are from the printed
# ones was known; that has no part in it.
OPEN = (
    "The radius of Mars is not printed: between 3389.5 and 3397 km the least J0 changes by 3.2 %, the cumulative bank "
    "rate of a row by 1.3 %, the error of a row with a weight by 0.8 %. Other units of the norm change the cumulative "
    "bank rate by 1.6 % more."
)
SOFT = " At the least J0 the error is open by 2 %: along the branch it falls by that much while J0 rises by 2.6 %."

DECLARATIONS = {
    "c1_values": Declaration(
        "No solver takes an infinite weight: {largest:.0e} stands for it. `corrected` takes the weights with which the "
        "rows have the printed J0.",
        errata=("E8", "E11"),
    ),
    "fuel_proportional_to_cumulative_rate": Declaration(
        "By the formula that explains the fuel of all rows, {ratio:.6f} kg s/deg; the paper states none.",
        errata=("E1", "E2"),
    ),
    "min_fuel_bang_coast_bang": Declaration(
        "Shown where thrust lasts longer than an interval; under the printed bound it does not.", errata=("E16",)
    ),
    "min_energy_fuel_near_min_fuel": Declaration(
        "The nominal burns {nominal:.3f} kg, {ratio:.1f} times the least found, {least:.3f} kg, which is on another "
        "branch (bank reversals: {reversals}). The solution of least J0 there burns {beside:.0f} % more than that. On "
        "the nominal's own branch fuel falls by {on_branch:.0f} % before it ends.",
        errata=("E6",),
    ),
    "nodoc_two_reversals": Declaration(
        "Of the local minimum that the paper describes; the one with a single reversal has less J0.", errata=("E6",)
    ),
    "desensitized_j0_larger": Declaration(
        "Compared with this local minimum, in rows that are chosen for their printed J0. Beyond the end of its branch "
        "J0 is {lowest:.4f} instead of {first:.4f} deg^2/s^3; with one factor for all weights the second row lies "
        "there.",
        errata=("E6", "E8"),
    ),
    "nodoc_text_error_j0_fuel": Declaration(
        "As the first row of Table 3.",
        errata=("E7", "E16"),
        withheld=(PLANET, ENDS),
        close=Close(OPEN + SOFT, absolute=(161.0, 0.0044, 0.0051)),
    ),
    "tab03_c0": Declaration(
        "The conditions on the bank angle are chosen for this row; with all of them free it is {printed[value][0]:.4f} "
        "deg^2/s^3, {printed[value][1]:.4f} deg/s, {printed[value][2]:.3f} kg, {printed[value][3]:.0f} m. Other "
        "transcriptions and meshes give J0 from {transcribed_low:.4f} to {transcribed_high:.4f} deg^2/s^3.",
        errata=("E1", "E2", "E4", "E5", "E7", "E16"),
        withheld=(PLANET, ENDS),
        close=Close(OPEN + SOFT, absolute=(0.0044, 0.13, 0.0051, 161.0)),
    ),
    "tab03_c0p001": Declaration(
        "At the printed J0, with a weight of {weight:.4f} deg^2/s^3; the branch ends at {fold:.4f}. On that of the "
        "solution with one reversal the same J0 buys {one_reversal[value][3]:.0f} m.",
        errata=("E6", "E8"),
        withheld=(PLANET, ENDS),
        close=Close(OPEN + SOFT, absolute=(0.0045, 0.13, 0.0051, 159.0)),
    ),
    "tab03_c0p01": Declaration(
        "At the printed J0 the cumulative bank rate and the fuel agree, and the error is {value[3]:.0f} m, "
        "{mixed_units[value][3]:.0f} m in other units of the norm: the printed point does not lie on the curve.",
        errata=("E8", "E12"),
        withheld=(PLANET, UNITS),
        close=Close(OPEN, absolute=(0.0098, 0.15, 0.0061, 59.0)),
    ),
    "tab03_c0p1": Declaration(
        "At the printed J0 the cumulative bank rate is within half a per cent, and the error is {value[3]:.0f} m, "
        "{mixed_units[value][3]:.0f} m in other units of the norm: the printed point does not lie on the curve.",
        errata=("E8", "E12"),
        withheld=(PLANET, UNITS),
        close=Close(OPEN, absolute=(0.050, 0.32, 0.0127, 52.0)),
    ),
    "tab03_c1": Declaration(
        "At the printed J0, {value[1]:.3f} deg/s and {value[3]:.0f} m; {mixed_units[value][1]:.3f} deg/s and "
        "{mixed_units[value][3]:.0f} m in other units of the norm.",
        errata=("E8", "E15"),
        withheld=(PLANET, UNITS),
        close=Close(OPEN, absolute=(0.166, 0.51, 0.0203, 49.0)),
    ),
    "tab03_cinf_effort": Declaration(
        "J0 is not in the objective. It grows with the weight that stands for infinity, from {low[0]:.0f} to "
        "{value[0]:.0f} deg^2/s^3, while the error stays.",
        errata=("E11",),
    ),
    "tab03_cinf_error": Declaration(
        "{value:.1f} m. It is a property of the problem, not of a choice of weights, and depends on the planet's "
        "radius.",
        errata=("E7", "E11"),
        withheld=(PLANET,),
        close=Close(OPEN, absolute=48.0),
    ),
    "max_reduction_percent": Declaration(
        "{value:.1f} %, from the first and the last row.",
        errata=("E7",),
        withheld=(PLANET, ENDS),
        close=Close(OPEN + SOFT + " That is 2 % of the first error in all.", absolute=2.0),
    ),
    "fuel_ratio_cinf_to_nodoc": Declaration(
        "{low:.1f} to {value:.1f}, as the fuel of the last row is open.",
        errata=("E11",),
    ),
    "nodoc_smallest_j0": Declaration(
        "Among the rows, and these are chosen for their printed J0. But it is a local minimum: under the same "
        "conditions a solution ({lower_name}) has a J0 of {lower:.4f} instead of {effort:.4f} deg^2/s^3. Of the rows "
        "of finite weight {own_least} have the least J0 known at their error.",
        errata=("E6",),
    ),
    "nodoc_largest_sensitivity": Declaration(
        "Among the rows. The solution with one reversal is more sensitive: {one_reversal[first]:.0f} instead of "
        "{first:.0f} m.",
        errata=("E6",),
    ),
    "error_decreases_with_c1": Declaration("", errata=("E15",)),
    "j0_increases_with_c1": Declaration(
        "As the rows are chosen for their printed J0. Along the homotopy in the weight it is not so: where the branch "
        "ends, it falls from {before:.4f} to {beyond:.4f} deg^2/s^3.",
        errata=("E6", "E8"),
    ),
    "fuel_increases_except_first_step": Declaration("", errata=("E2",)),
    "lower_altitude_when_desensitized": Declaration(
        "Judged below {limit:.1f} km, where the first row spends half of its flight: of {count} rows with a weight "
        "{longer} stays longer. What is low decides: below {deep:g} km it is {deep_longer} of {count}.",
        errata=("E17",),
    ),
    "more_reversals_when_desensitized": Declaration(
        "Of {count} rows with a weight {more} has more than the first.", errata=("E17",)
    ),
    "feedback_radius_greatly_reduced": Declaration(
        "With least gains; those of the paper are not printed. Tuned ones leave {feedback_tuned[left]:.1f} instead of "
        "{left:.1f} % of the flown error.",
        errata=("E13",),
        withheld=(GAINS,),
    ),
    "fig05b_phase_times": Declaration("", errata=("E13",), withheld=(GAINS,)),
    "fig04_phase2_position_effects": Declaration(
        "Radius and downrange do. But crossrange grows until {turned:.0f} s, from {early:.0f} to {late:.0f} m within "
        "the phase, and is corrected in the last one only, to {last:.0f} m.",
        errata=("E13",),
        withheld=(GAINS,),
    ),
    "fig04_phase3_position_effects": Declaration(
        "The errors are corrected, with {lift:.0f} % more lift. But the mean drag is {drag:.2f} % larger than that of "
        "the nominal; with tuned gains it is {feedback_tuned[drag]:.2f} %.",
        errata=("E13",),
        withheld=(GAINS,),
    ),
    "dr_column_e3": Declaration("The eighth entry, which the paper leaves out, is zero as well.", errata=("E9",)),
    "fig06_1000m_more_than_halved": Declaration(
        "With least gains {left:.1f} % are left. Of {count} sets of gains found, all with little or no linear "
        "sensitivity, the best leaves {least:.1f} m, and with {lost} of them a flight is lost.",
        errata=("E13",),
        withheld=(GAINS,),
    ),
    "fig07b_phase_times": Declaration("", errata=("E13",), withheld=(GAINS,)),
    "cr_sensitivity_nodoc": Declaration(
        "Exactly the cosine of the longitude flown, {turn:.6f}: the whole flight is turned.", errata=("E10",)
    ),
    "fig09_reduction_factor_1000m": Declaration("", errata=("E13",), withheld=(GAINS,)),
    "fig11_nofeedback_crossrange_1000m": Declaration(
        "{value:.1f} m: rounded in the text, which has the ratio of Fig. 9 close to 1. The flight is turned about an "
        "axis in the equator, which leaves {turned:.2f} m for any nominal.",
        errata=("E10",),
    ),
    "fig10b_phase1_smaller_reversed": Declaration("This statement gives the sign of the bank angle.", errata=("E3",)),
    "gains_perturbation_specific": Declaration(
        "They multiply the sensitivities to the others by {least:.1f} to {most:.0f}. One set of gains against all "
        "three leaves {all_linear:.0f} % of a linear sensitivity at most, but up to {all_flown:.0f} % of the errors of "
        "the figures. With random errors in all channels half of the flights end within {all_median:.0f} m, without "
        "feedback {plain_median:.0f} m.",
        errata=("E14",),
    ),
    "more_perturbations_more_fuel": Declaration(
        "Gains cost nothing nominally, and one set of gains against all three position errors even less: "
        "{together:.3f} instead of {single:.3f} deg/s, while on the branch with one reversal it is "
        "{one_reversal[together]:.3f} instead of {one_reversal[single]:.3f} deg/s. As flown it leaves {left:.0f} % of "
        "the drawn radius error.",
        errata=("E18",),
    ),
}
