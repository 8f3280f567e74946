"""Final standard deviations by linear covariance against those over Monte Carlo flights, in every paper."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from marsedl.comparison.records import COLORS, NAMES
from marsedl.methods.sensitivity import midpoint_responses, midpoint_transitions, propagate_columns
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import covariance_standard_errors
from marsedl.papers.desensitized import inputs as desensitized_inputs
from marsedl.papers.desensitized.records import FlightEnsemble as DesensitizedFlights
from marsedl.papers.desensitized.records import Gains as DesensitizedGains
from marsedl.papers.desensitized.tables import LAW_NAMES
from marsedl.papers.funnels import inputs as funnels_inputs
from marsedl.papers.funnels.funnel import Funnel as FunnelsFunnel
from marsedl.papers.funnels.gains import Gains as FunnelsGains
from marsedl.papers.funnels.linearization import Linearization as FunnelsLinearization
from marsedl.papers.funnels.montecarlo import FlightEnsemble as FunnelsFlights
from marsedl.papers.powered_descent.gains import Gains as PoweredDescentGains
from marsedl.papers.powered_descent.montecarlo import FlightEnsemble as PoweredDescentFlights
from marsedl.papers.random_field.records import FlightEnsemble as RandomFieldFlights
from marsedl.papers.random_field.records import Gains as RandomFieldGains
from marsedl.papers.stochastic_entry import records as stochastic_entry_records
from marsedl.papers.stochastic_entry.records import TRIGGERS, errors
from marsedl.papers.stochastic_entry.records import FlightEnsemble as StochasticEntryFlights
from marsedl.papers.stochastic_entry.records import Gains as StochasticEntryGains
from marsedl.papers.stochastic_entry.records import Linearization as StochasticEntryLinearization
from marsedl.plotting.style import BLACK, GREY, new_figure
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.records.tables import Column
from marsedl.replication.records.tables import table as table_of

if TYPE_CHECKING:
    from pandas import DataFrame

NEAR = 0.3  # from one, shown on the right
# Quantities of the same kind have the same mark.
MARKS = {
    "altitude": "^",
    "downrange": "o",
    "crossrange": "s",
    "velocity": "D",
    "downrange velocity": "P",
    "vertical velocity": "v",
    "flight path angle": "<",
    "heading": ">",
    "delta-v": "*",
}


class Deviation(NamedTuple):
    """Standard deviation of one quantity at the end of the flights of one case."""

    case: str
    quantity: str
    unit: str
    predicted: float
    sampled: float
    sampled_error: float  # standard error of `sampled`
    trials: int  # in the sample
    lost: int  # flights left out of it

    @property
    def ratio(self):
        """Predicted over sampled."""
        return self.predicted / self.sampled

    @property
    def ratio_error(self):
        """Its standard error, from that of the sample."""
        return self.ratio * self.sampled_error / self.sampled


def deviations(case, quantities, predicted, samples) -> list[Deviation]:
    """Compare standard deviations of several quantities.

    Args:
        case: name of the flights.
        quantities: name and unit of each, (n,).
        predicted: standard deviations by linear covariance, (n,).
        samples: final values, (trials, n); rows that are not finite were lost. Of one or none that is not,
            standard deviations are NaN.

    Returns:
        One `Deviation` for each quantity.
    """
    finite = samples[np.isfinite(samples).all(axis=1)]
    sampled = variance_error = np.full(samples.shape[1], np.nan)
    if len(finite) > 1:
        sampled, variance_error = finite.std(axis=0, ddof=1), np.diag(covariance_standard_errors(finite))
    return [
        Deviation(case, name, unit, *map(float, numbers), len(finite), len(samples) - len(finite))
        for (name, unit), *numbers in zip(quantities, predicted, sampled, variance_error / (2.0 * sampled), strict=True)
    ]


def powered_descent(
    gains: PoweredDescentGains,
    closed_loop: PoweredDescentFlights,
    closed_loop_large: PoweredDescentFlights | None = None,
) -> list[Deviation]:
    """Closed loop, of the large ensemble where there is one."""
    quantities = (("downrange", "m"), ("altitude", "m"), ("downrange velocity", "m/s"), ("vertical velocity", "m/s"))
    final_states = (closed_loop_large or closed_loop).final_state[:, : len(quantities)]
    return deviations("closed loop", quantities, _deviation(gains.covariance[-1]), final_states)


def random_field(gains: RandomFieldGains, aerocapture: RandomFieldFlights) -> list[Deviation]:
    """Open loop and, if there is one, the law of the last iteration: state at the exit, and delta-v."""
    quantities = (("altitude", "m"), ("velocity", "m/s"), ("flight path angle", "rad"), ("delta-v", "m/s"))
    rows = []
    for law in sorted({0, len(gains.control) - 1}):
        exit_state, delta_v = aerocapture.final_state[law, :, :3], aerocapture.delta_v[law, :, np.newaxis]
        captured = (aerocapture.outcome[law] == COMPLETED)[:, np.newaxis]
        samples = np.where(captured, np.hstack([exit_state, delta_v]), np.nan)
        predicted = *_deviation(gains.covariance[law, -1]), gains.delta_v_deviation[law]
        rows += deviations(f"iteration {law}" if law else "open loop", quantities, predicted, samples)
    return rows


def desensitized(
    ensemble: desensitized_inputs.Ensemble, gains: DesensitizedGains, entry_errors: DesensitizedFlights
) -> list[Deviation]:
    """Every law: final position errors of position errors at entry, by the sensitivity."""
    quantities = (("altitude", "m"), ("crossrange", "m"), ("downrange", "m"))
    rows = []
    for name, sensitivity, final_errors in zip(gains.law, gains.final, entry_errors.final_error, strict=True):
        predicted = _deviation(sensitivity @ np.diag(ensemble.initial_deviations**2) @ sensitivity.T)
        rows += deviations(LAW_NAMES[str(name)], quantities, predicted, final_errors)
    return rows


def funnels(
    planet: funnels_inputs.Planet,
    linearization: FunnelsLinearization,
    gains: FunnelsGains,
    funnel: FunnelsFunnel,
    constant: FunnelsFlights,
) -> list[Deviation]:
    """Flights with a constant disturbance: starts on the first slice's boundary, disturbances on that of their disc."""
    quantities = (
        ("altitude", "m"),
        ("downrange", "m"),
        ("crossrange", "m"),
        ("velocity", "m/s"),
        ("flight path angle", "rad"),
        ("heading", "rad"),
    )
    halfway = slice(1, None, 2)  # in the middle of the steps
    states, disturbances = linearization.disturbance_matrix.shape[1:]
    feedback = linearization.control_matrix[halfway, :, np.newaxis] * gains.half_gain[halfway, np.newaxis]
    matrix, step = linearization.state_matrix[halfway] + feedback, np.diff(linearization.time)
    pushed = midpoint_responses(matrix, linearization.disturbance_matrix[halfway], step)
    # Points uniform on the unit sphere of n coordinates have the covariance 1/n; x'P x = 2 rho on the first slice.
    start = np.sqrt(2.0 * funnel.level[0] / states) * np.linalg.inv(np.linalg.cholesky(gains.shape[0])).T
    columns = propagate_columns(
        midpoint_transitions(matrix, step),
        np.hstack([start, np.zeros((states, disturbances))]),
        np.concatenate([np.zeros((len(step), states, states)), pushed / np.sqrt(disturbances)], axis=2),
    )[-1]
    predicted = _deviation(columns @ columns.T)
    metres = np.array([1.0, planet.planet_radius, planet.planet_radius, 1.0, 1.0, 1.0])
    final = np.where((constant.outcome == COMPLETED)[:, np.newaxis], constant.final_state[:, :states], np.nan)
    return deviations("constant disturbance", quantities, predicted * metres, final * metres)


def stochastic_entry(
    linearization: StochasticEntryLinearization,
    gains: StochasticEntryGains,
    apollo_time: StochasticEntryFlights,
    apollo_velocity: StochasticEntryFlights,
    stochastic_time: StochasticEntryFlights,
    stochastic_velocity: StochasticEntryFlights,
) -> list[Deviation]:
    """Both laws to both triggers; at the velocity trigger the velocity has no deviation."""
    quantities = {
        stochastic_entry_records.ALTITUDE: ("altitude", "m"),
        stochastic_entry_records.VELOCITY: ("velocity", "m/s"),
        stochastic_entry_records.FLIGHT_PATH_ANGLE: ("flight path angle", "rad"),
        stochastic_entry_records.DOWNRANGE: ("downrange", "m"),
    }
    rows = []
    for law, covariances, flights in (
        ("Apollo", gains.apollo_covariance, (apollo_time, apollo_velocity)),
        ("stochastic", gains.stochastic_covariance, (stochastic_time, stochastic_velocity)),
    ):
        projections = np.eye(covariances.shape[-1]), linearization.trigger_projection
        for trigger, covariance, projection, ensemble in zip(TRIGGERS, covariances, projections, flights, strict=True):
            fixed = stochastic_entry_records.VELOCITY if trigger == "velocity" else None
            states = [state for state in quantities if state != fixed]
            predicted = _deviation(projection @ covariance[-1] @ projection.T)[states]
            final_errors = np.where((ensemble.outcome == COMPLETED)[:, np.newaxis], errors(ensemble)[:, states], np.nan)
            rows += deviations(
                f"{law} law to the {trigger} trigger", [quantities[state] for state in states], predicted, final_errors
            )
    return rows


def figure(records: dict[str, list[Deviation]]) -> Figure:
    """Ratio of every standard deviation, by case; on the right those near one."""
    cases = [(slug, case) for slug, rows in records.items() for case in dict.fromkeys(row.case for row in rows)]
    chart, (full_range, near) = new_figure(8.6, 1.4 + 0.3 * len(cases), ncols=2, sharey=True, width_ratios=(1.0, 1.4))
    used = set()
    for height, (slug, case) in enumerate(cases):
        rows = [row for row in records[slug] if row.case == case]
        for row, offset in zip(rows, _spread(len(rows)), strict=True):
            used.add(row.quantity)
            look = {"color": COLORS[slug], "marker": MARKS[row.quantity], "markersize": 4, "linestyle": "none"}
            full_range.plot(row.ratio, height + offset, **look)
            if abs(row.ratio - 1.0) < NEAR:
                near.errorbar(row.ratio, height + offset, xerr=SIGMAS * row.ratio_error, linewidth=0.8, **look)
    for axes in (full_range, near):
        axes.axvline(1.0, color=BLACK, linewidth=0.8)
        for edge in range(1, len(cases)):
            between = cases[edge][0] != cases[edge - 1][0]
            axes.axhline(edge - 0.5, color=GREY, linewidth=0.8 if between else 0.3)
        axes.grid(axis="y", visible=False)
    full_range.set_yticks(range(len(cases)), [f"{NAMES[slug]}: {case}" for slug, case in cases])
    full_range.set(xscale="log", xlabel="linear covariance\nover Monte Carlo", ylim=(len(cases) - 0.5, -0.5))
    near.set(
        xlim=(1.0 - NEAR, 1.0 + NEAR),
        xlabel=f"the same within {100 * NEAR:.0f} % of one,\nwith {SIGMAS:g} standard errors",
    )
    for name in (name for name in MARKS if name in used):
        near.plot([], [], color=BLACK, marker=MARKS[name], markersize=4, linestyle="none", label=name)
    chart.legend(loc="outside lower center", ncols=4)
    return chart


def table(records: dict[str, list[Deviation]]) -> "DataFrame":
    """All of them as numbers."""
    rows = [
        (
            NAMES[slug],
            row.case,
            row.quantity,
            row.unit,
            row.predicted,
            row.sampled,
            row.sampled_error,
            row.ratio,
            row.ratio_error,
            row.trials,
            row.lost,
        )
        for slug, deviations_of_paper in records.items()
        for row in deviations_of_paper
    ]
    return table_of(
        rows,
        {
            "paper": Column(),
            "flights": Column(),
            "quantity": Column(),
            "unit": Column(meaning="of the three numbers that follow it"),
            "linear covariance": Column("", ".4g", "standard deviation of the quantity at the end"),
            "Monte Carlo": Column("", ".4g", "the same over the flights", error="Monte Carlo: standard error"),
            "Monte Carlo: standard error": Column("", ".2g", "from the number of flights and the fourth moments"),
            "ratio": Column("", ".4g", "linear covariance over Monte Carlo", error="ratio: standard error"),
            "ratio: standard error": Column("", ".2g"),
            "number of flights": Column(meaning="in the sample"),
            "lost": Column(meaning="flights left out of it"),
        },
    )


def _deviation(covariance):
    return np.sqrt(np.diagonal(covariance))


def _spread(count):
    """Heights of the marks of one case, about zero."""
    return (np.arange(count) - (count - 1) / 2) * 0.8 / max(count, 1)
