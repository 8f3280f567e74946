"""What several claims share: the four flights, their percentiles, the curves of Figs. 8 and 9, what "close" means."""

import numpy as np

from marsedl.montecarlo.outcomes import CRASHED, ESCAPED, NON_FINITE
from marsedl.montecarlo.statistics import percentile
from marsedl.papers.stochastic_entry.inputs import Design, Mission, Planet
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    CASES,
    CROSSRANGE,
    DOWNRANGE,
    FLIGHT_PATH_ANGLE,
    LEVELS,
    VELOCITY,
    FlightEnsemble,
    Gains,
    Linearization,
    errors,
)
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.claims.writing import Fails

LAWS = ("apollo", "stochastic")
LAW_NAMES = {"apollo": "Apollo", "stochastic": "stochastic"}
HISTORY = ("altitude", "velocity", "flight path angle", "range")  # in the order of history and linear model
# Rows of Table 4: index in the state, name, factor to the printed unit, that unit.
ROWS = (
    (DOWNRANGE, "downrange", 1e-3, "km"),
    (ALTITUDE, "altitude", 1e-3, "km"),
    (VELOCITY, "velocity", 1.0, "m/s"),
    (FLIGHT_PATH_ANGLE, "gamma", 180.0 / np.pi, "deg"),
)

FEASIBLE = 1e-3  # relative excess over a limit that a solver may leave

DEADBAND = "deadband_start deadband_end deadband_start_width deadband_end_width"  # choices of Fig. 5


class Flights(dict):
    """The four Monte Carlo ensembles by the name of their case."""

    def lost(self, case: str) -> list[str]:
        """Trials of a case that are not finite, as a sentence if there are any."""
        excluded = self[case].excluded
        return [f"{excluded:,} {LAW_NAMES[case.split('_')[0]]} trials are not finite"] if excluded else []


def flights(
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
) -> Flights:
    """Both laws with both triggers."""
    return Flights(zip(CASES, (apollo_time, apollo_velocity, stochastic_time, stochastic_velocity), strict=True))


class Tails(dict):
    """Percentiles of the rows of Table 4 by case, see `final_percentiles`, with its sign of the range error."""


def tails(mission: Mission, flights: Flights) -> Tails:
    """Percentiles of all trials."""
    short = mission.positive_range_error == "short"
    return Tails({case: _Percentiles(ensemble, None, short) for case, ensemble in flights.items()})


class _Percentiles(dict):
    """Those of one ensemble by state index, each computed when it is first asked for."""

    def __init__(self, ensemble, trials, short):
        super().__init__()
        self._given = ensemble, trials, short

    def __missing__(self, state):
        self[state] = table_percentiles(*self._given, [state])[state]
        return self[state]


def table_percentiles(ensemble: FlightEnsemble, trials: int | None = None, short: bool = False, index=None) -> dict:
    """Those of `final_percentiles`, with a positive range error before the nominal's end if `short` (E21)."""
    percentiles = final_percentiles(ensemble, trials, index)
    if short and DOWNRANGE in percentiles:
        percentiles[DOWNRANGE] = mirrored(percentiles[DOWNRANGE])
    return percentiles


def mirrored(tail: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """1st and 99th percentile of an error, with standard errors, if its sign is reversed."""
    values, deviations = tail
    return -values[::-1], deviations[::-1]


def finite(ensemble: FlightEnsemble) -> np.ndarray:
    """Which trials are finite, (trials,) bool."""
    return ensemble.outcome != NON_FINITE


def finite_count(ensemble: FlightEnsemble) -> int:
    """How many of all trials are finite."""
    return int(finite(ensemble).sum())


def final_percentiles(ensemble: FlightEnsemble, trials: int | None = None, index=None) -> dict:
    """1st and 99th percentile of the final errors with standard errors, SI: {state index: ((2,), (2,))}.

    trials: the first of all trials, or all. index: states, or the rows of Table 4. NaN where fewer than two trials are
    finite.
    """
    states, percentiles = [row[0] for row in ROWS] if index is None else index, {}
    error = errors(ensemble, trials)[finite(ensemble)[:trials]]
    for state in states:
        if len(error) < 2:
            percentiles[state] = np.full(2, np.nan), np.full(2, np.nan)
        else:
            values, deviations = zip(*(percentile(error[:, state], level) for level in LEVELS), strict=True)
            percentiles[state] = np.array(values), np.array(deviations)
    return percentiles


def width(tail: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Distance from the 1st to the 99th percentile and its standard error, both taken as independent."""
    values, deviations = tail
    return values[1] - values[0], float(np.hypot(*deviations))


def reduction(narrow: tuple, wide: tuple) -> tuple[float, float]:
    """How much narrower one interval of percentiles is than another, relative, with its standard error."""
    (small, small_error), (large, large_error) = width(narrow), width(wide)
    ratio = small / large
    return 1.0 - ratio, abs(ratio) * float(np.hypot(small_error / small, large_error / large))


def printed_range(published: dict, case: str) -> tuple[np.ndarray, np.ndarray]:
    """Percentiles of the range error that Table 4 prints, m, which have no standard errors."""
    return 1e3 * np.array(published[f"tab4_downrange_{case}"].printed), np.zeros(len(LEVELS))


def half_tolerance(published: dict) -> float:
    """How far from one half a ratio may be and still be called about one half: as far as those that the paper calls so.

    published: the printed claims by id.
    """
    printed = [printed_range(published, f"{law}_velocity") for law in LAWS]
    return max(abs(ratio_of(*reversed(printed), side)[0] - 0.5) for side in range(len(LEVELS)))


def ratio_of(stochastic: tuple, apollo: tuple, side: int) -> tuple[float, float]:
    """Ratio of one percentile (side 0 or 1) of two laws, and its standard error."""
    (values, deviations), (apollo_values, apollo_deviations) = stochastic, apollo
    ratio = values[side] / apollo_values[side]
    error = abs(ratio) * float(np.hypot(deviations[side] / values[side], apollo_deviations[side] / apollo_values[side]))
    return ratio, error


def outcomes(ensemble: FlightEnsemble) -> str:
    """How many trials ended otherwise than they should, in words; empty if none did."""
    names = {CRASHED: "below the ground", ESCAPED: "trigger not reached", NON_FINITE: "not finite"}
    counts = {text: np.count_nonzero(ensemble.outcome == code) for code, text in names.items()}
    return ", ".join(f"{count:,} {text}" for text, count in counts.items() if count)


def velocity_errors(mission: Mission, ensemble: FlightEnsemble) -> np.ndarray:
    """Distances from the velocity of the trigger of all finite trials; empty without any."""
    return np.abs(ensemble.final_state[finite(ensemble), VELOCITY] - mission.end_velocity)


def crossrange_interval(ensemble: FlightEnsemble) -> tuple[float, float]:
    """Distance between the 1st and 99th percentile of the final crossrange and its standard error, m."""
    ends = [percentile(ensemble.final_state[finite(ensemble), CROSSRANGE], level) for level in LEVELS]
    return float(ends[1][0] - ends[0][0]), float(np.hypot(ends[0][1], ends[1][1]))


class Predicted(dict):
    """Covariances of the linear model by law, (triggers, nodes, 5, 5), that of Apollo as the reading takes it."""


def predicted(design: Design, gains: Gains) -> Predicted:
    """Covariances of both laws."""
    timed = design.apollo_covariance == "timed_gains"
    apollo = gains.timed_covariance if timed else gains.apollo_covariance
    return Predicted(apollo=apollo, stochastic=gains.stochastic_covariance)


def correlation_of(covariance: np.ndarray, i: int, j: int) -> float:
    """Correlation of two components."""
    return float(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j]))


def dynamic_pressure(linearization: Linearization) -> np.ndarray:
    """Dynamic pressure along the nominal, Pa."""
    return 0.5 * linearization.state[:, 4] * linearization.state[:, 1] ** 2


def crossrange_of_azimuth(planet: Planet, mission: Mission) -> tuple[float, float]:
    """Arc from entry to target (rad), and the crossrange (m) of the azimuth's offset from it over that arc."""
    step = mission.target_longitude - mission.entry_longitude
    sines = np.sin(mission.entry_latitude), np.sin(mission.target_latitude)
    cosines = np.cos(mission.entry_latitude), np.cos(mission.target_latitude)
    east, north = np.sin(step) * cosines[1], cosines[0] * sines[1] - sines[0] * cosines[1] * np.cos(step)
    arc = np.arctan2(np.hypot(east, north), sines[0] * sines[1] + cosines[0] * cosines[1] * np.cos(step))
    return float(arc), float(planet.planet_radius * arc * (mission.entry_azimuth - np.arctan2(east, north)))


class Corrections:
    """Three sigma of the control correction during range control, of all laws and triggers."""

    def __init__(self, design: Design, linearization: Linearization, gains: Gains):
        """Take the guidance periods from entry to the last with range control."""
        guided = linearization.control.any(axis=1)
        guided[: np.flatnonzero(guided)[-1]] = True  # from entry on
        self.time, self.cosine = linearization.time[:-1][guided], linearization.bank_cosine[:-1][guided]
        # Apollo's by trigger (time, velocity): as it is flown, and by its gains against time, which nobody flies.
        self.effective = SIGMAS * np.sqrt(gains.apollo_control_variance)[:, guided]
        self.timed = SIGMAS * np.sqrt(gains.timed_control_variance)[:, guided]
        self.apollo = self.timed if design.apollo_covariance == "timed_gains" else self.effective
        variance = gains.stochastic_control_variance[:, guided]
        self._stochastic = SIGMAS * np.sqrt(np.where(variance >= 0.0, variance, np.nan))
        self.pressure = dynamic_pressure(linearization)[:-1][guided]
        self.drag = linearization.drag[:-1][guided]

    @property
    def stochastic(self) -> np.ndarray:
        """Those of the stochastic law by trigger (time, velocity)."""
        if not np.isfinite(self._stochastic).all():
            raise Fails("no finite stochastic gain")
        return self._stochastic

    def reach(self, bounds: np.ndarray) -> np.ndarray:
        """Largest nominal cosine plus bounds of shape (..., periods)."""
        return np.max(np.abs(self.cosine) + bounds, axis=-1)


def distance(bounds: np.ndarray) -> float:
    """Mean distance of the bounds for the two triggers, (2, periods), of their mean, %."""
    # A cosine has no room for more than one; without this, Apollo's last gains, which diverge, would decide.
    one, other = np.minimum(bounds, 1.0)
    return 100 * np.abs(one - other).sum() / ((one + other).sum() / 2)


def corrections(design: Design, linearization: Linearization, gains: Gains) -> Corrections:
    """Corrections of Fig. 8."""
    return Corrections(design, linearization, gains)


class Dispersion:
    """Standard deviations over time with the fixed final time: of the trials and of the linear model, (nodes, 4)."""

    def __init__(self, covariance: np.ndarray, ensemble: FlightEnsemble):
        """Take what the linear model predicts of a law at each node, (nodes, 5, 5), and the trials."""
        self.relative_error = 1.0 / np.sqrt(2.0 * max(ensemble.count - 1, 1))  # of a sampled standard deviation
        diagonal = np.diagonal(ensemble.covariance, axis1=1, axis2=2)
        self.sampled = np.sqrt(diagonal[:, :4])
        self.crossrange = np.sqrt(diagonal[:, CROSSRANGE])
        self.predicted = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, :4])
        # The measure of Fig. 9: root mean square of the difference of the curves, over the height of the panel.
        self.apart = np.sqrt(((self.sampled - self.predicted) ** 2).mean(axis=0)) / self.sampled.max(axis=0)
        self.end_ratio = self.sampled[-1] / self.predicted[-1]


class Dispersions(dict):
    """Those of both laws by name."""


def dispersions(predicted: Predicted, flights: Flights) -> Dispersions:
    """Deviations of Fig. 9."""
    return Dispersions({law: Dispersion(predicted[law][0], flights[f"{law}_time"]) for law in LAWS})
