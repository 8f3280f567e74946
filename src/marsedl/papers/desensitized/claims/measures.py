"""What several claims share: the rows of Table 3, the flights that figures draw, and what statements call so."""

import numpy as np

from marsedl.papers.desensitized import entry_problem, mean_density
from marsedl.papers.desensitized.entry_problem import BANK
from marsedl.papers.desensitized.inputs import Design, Planet, Simulation
from marsedl.papers.desensitized.nominal import zero_crossings
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    LAWS,
    NO_DOC,
    RESHAPED,
    Gains,
    Responses,
    Tradeoff,
)
from marsedl.replication.claims.thresholds import MOST, ROUNDING
from marsedl.replication.claims.writing import Evaluation, Fails, Test, holds, measure, provided
from marsedl.replication.errors import InfeasibleError, MarsedlError
from marsedl.replication.units import DEGREE

PLAIN, SHAPED = LAWS.index(NO_DOC), LAWS.index(RESHAPED)
LAW_OF = [LAWS.index(channel) for channel in CHANNELS]
ALL_LAW = LAWS.index(ALL_COLUMNS)
RADIUS, CROSSRANGE, DOWNRANGE = range(len(CHANNELS))

# Choices that several claims name.
GAINS = "feedback_gains gain_start"
ENDS = "initial_bank initial_bank_rate final_bank final_bank_rate"


def size(vectors: np.ndarray) -> np.ndarray:
    """Norms over the last dimension."""
    return np.linalg.norm(vectors, axis=-1)


def printed_rows(published: dict) -> dict[float, list[float]]:
    """Rows of Table 3 as printed, by c1: control energy, cumulative bank rate, fuel and final error."""
    last = (*published["tab03_cinf_effort"].printed, published["tab03_cinf_error"].printed)
    finite = ("tab03_c0", "tab03_c0p001", "tab03_c0p01", "tab03_c0p1", "tab03_c1")
    rows = (*(published[key].printed for key in finite), last)
    return dict(zip(map(float, published["c1_values"].printed), rows, strict=True))


def row_c1(printed_weight):
    """The paper's c1 of a row; the artifact has NaN for an infinite one."""
    return float("inf") if np.isnan(printed_weight) else float(printed_weight)


def is_papers(design: Design, printed, printed_weight):
    """Whether a row of a reading is taken like one of the paper's: by its c1, or by its c1 with its printed J0."""
    c1 = row_c1(printed_weight)
    if c1 not in printed:
        return False
    if design.weight_rule != "matched" or c1 == 0.0 or np.isinf(c1):
        return True
    own = design.matched_efforts[np.flatnonzero(design.printed_weights == c1)]
    return bool(own.size) and own[0] == printed[c1][0]


def own_c1(design: Design, printed, printed_weight):
    """The c1 of a row; None of a reading's own row that is taken at a J0, where c1 says nothing."""
    if design.weight_rule == "matched" and not is_papers(design, printed, printed_weight):
        return None
    return row_c1(printed_weight)


# ---- Table 3 ---------------------------------------------------------------------------------------------------------


class Rows:
    """The rows of Table 3: c1 = 0, the printed weights, and the largest of those that stand for an infinite one."""

    def __init__(self, simulation: Simulation, design: Design, tradeoff: Tradeoff):
        """Take the trade-off and the error at entry that the table is made with."""
        self.tradeoff, self.tabulated_error = tradeoff, abs(simulation.tabulated_error)
        self.infinite = np.flatnonzero(~np.isfinite(tradeoff.printed_weight))
        self.number = np.array([*np.flatnonzero(np.isfinite(tradeoff.printed_weight)), self.infinite[-1]])
        self.weight = tradeoff.weight[self.number]
        self.effort = tradeoff.effort[self.number]
        self.cumulative = tradeoff.cumulative[self.number] / DEGREE
        self.propellant = tradeoff.propellant[self.number]
        self.vector = tradeoff.error[self.number]
        self.error = size(self.vector)
        self.reversals = tradeoff.reversals[self.number]
        self.c1, self.finite = tradeoff.printed_weight[self.number], design.printed_weights
        self.branch = tradeoff.branch[tradeoff.row_branch[self.number]]
        matched = design.weight_rule == "matched"
        self.circular = "the rows are chosen for their printed control energy" if matched else ""

    def limits(self, name: str) -> np.ndarray:
        """The values of a field for the smallest and the largest weight that stands for infinity."""
        return getattr(self.tradeoff, name)[self.infinite[[0, -1]]]

    def at(self, c1: float) -> int:
        """The number of the row with a printed weight."""
        matching = np.flatnonzero(self.c1 == c1)
        if matching.size:
            return int(matching[0])
        missing = self.tradeoff.missing_weight == c1
        wanted = self.tradeoff.missing_effort[missing]
        if not wanted.size:
            raise Fails(f"no row of Table 3 has c1 = {c1:g} here")
        if wanted[0] < self.effort[0]:
            sentence = f"the control energy of c1 = {c1:g} lies below the least, {self.effort[0]:.4f} deg^2/s^3"
            raise InfeasibleError(sentence, {})
        raise MarsedlError(f"c1 = {c1:g} has no row: {self.tradeoff.missing_reason[missing][0]}")

    def require(self, weights) -> None:
        """Refuse a table in which one of some printed weights has no row."""
        for c1 in weights:
            self.at(c1)

    @property
    def stands_for(self) -> str:
        """The weights that stand for infinity, in words."""
        return "with the weights {:g} and {:g}".format(*self.limits("weight"))


def rows(simulation: Simulation, design: Design, tradeoff: Tradeoff) -> Rows:
    """Rows of Table 3 of the reading."""
    return Rows(simulation, design, tradeoff)


# ---- flights ---------------------------------------------------------------------------------------------------------


class Flight:
    """The flight with the error that the figures draw in a channel, under its feedback, beside its nominal."""

    channel: int

    def __init__(self, planet: Planet, gains: Gains, responses: Responses):
        """Take the responses of the channel."""
        channel, law = self.channel, LAW_OF[self.channel]
        self.converged, self.ended = bool(gains.converged[law]), str(gains.ended[law])
        self.entry_error = float(np.abs(responses.drawn_error[channel]))
        self.time, self.end = responses.time[law], float(responses.time[law, -1])
        self.nominal, self.state = responses.nominal[law], responses.state[law, channel]
        self.bank = self.nominal[:, BANK]
        self.deviation = self.state[:, BANK] - self.bank
        self.error = responses.error[law, channel]
        self.without_time, self.without = responses.time[PLAIN], responses.error[PLAIN, channel]
        self.reversal_times = entry_problem.reversal_times(self.time, self.bank)
        self.air = mean_density.profile(planet)

    def share(self, sign: int, begins: float, ends: float, side: int = 0) -> float:
        """Share of a span in which the bank angle departs to a side, with the nominal one on a given side or any."""
        inside = (self.time > begins) & (self.time <= ends)
        met = (sign * self.deviation > ROUNDING) & ((side == 0) | (side * self.bank > 0.0))
        return float(met[inside].mean()) if inside.any() else 0.0

    def at(self, time: float) -> np.ndarray:
        """Radius, crossrange and downrange error at a time, (3,), m."""
        return np.array([np.interp(time, self.time, component) for component in self.error.T])

    def without_feedback(self, time: float) -> np.ndarray:
        """The same of the flight without feedback."""
        return np.array([np.interp(time, self.without_time, component) for component in self.without.T])

    def outward(self, time: float) -> float:
        """Crossrange error at a time, positive to the side on which the nominal is, m."""
        return float(np.sign(np.interp(time, self.time, self.nominal[:, 1])) * self.at(time)[CROSSRANGE])

    def _pressures(self, begins, ends):
        """Density times squared velocity, which drag and lift go with, of flight and nominal, and the nodes taken."""
        inside = (self.time >= begins) & (self.time <= ends)
        states = self.state[inside], self.nominal[inside]
        return *(np.exp(self.air(y[:, 0])[0]) * (y[:, 3:6] ** 2).sum(axis=1) for y in states), inside

    def more_drag(self, begins: float, ends: float) -> float:
        """Relative excess of the mean drag over a span above that of the nominal."""
        pressure, nominal_pressure, inside = self._pressures(begins, ends)
        return float(pressure.mean() / nominal_pressure.mean() - 1.0) if inside.any() else np.nan

    def more_lift(self, begins: float, ends: float) -> float:
        """Excess of the mean vertical lift over a span above that of the nominal, as a share of all lift."""
        pressure, nominal_pressure, inside = self._pressures(begins, ends)
        vertical = pressure * np.cos(self.state[inside, BANK]) - nominal_pressure * np.cos(self.bank[inside])
        return float(vertical.mean() / nominal_pressure.mean()) if inside.any() else np.nan

    @property
    def first_change(self) -> float:
        """When the bank angle's deviation first changes its sign; NaN if it never does."""
        times = zero_crossings(self.time[1:], self.deviation[1:])
        return float(times[0]) if times.size else np.nan

    def holds(self, *parts: Test | str, **numbers: object) -> Evaluation:
        """A statement about this flight: its gains have to converge, and it has to come to its end."""
        return holds(
            *parts,
            provided(f"the gains converge (they ended with: {self.ended})", self.converged),
            provided("the flight comes to its end", np.isfinite(self.error)),
            **numbers,
        )

    def departs(self, sign: int, begins: float, ends: float, side: int = 0) -> Test:
        """Test that the bank angle departs to a side for most of a span."""
        words = {(1, 0): "more positive", (-1, 0): "more negative", (1, -1): "less negative", (1, 1): "more positive"}
        subject = f"share of the time from {begins:.4g} to {ends:.4g} s without a bank angle {words[sign, side]}"
        remaining_share = 100 * (1.0 - self.share(sign, begins, ends, side))
        return measure(f"{subject} than the nominal one", remaining_share, "%") <= 100 * MOST


class RadiusFlight(Flight):
    """That of Figs. 4 and 5."""

    channel = RADIUS
    first, second = 100.0, 200.0  # s, as the text has the ends of the phases of Fig. 5b


class CrossrangeFlight(Flight):
    """That of Figs. 10 and 11."""

    channel = CROSSRANGE

    @property
    def first(self) -> float:
        """When the first phase ends, s: reversals of the nominal part the phases."""
        return float(self._two_reversals()[0])

    @property
    def second(self) -> float:
        """When the second phase ends, s."""
        return float(self._two_reversals()[-1])

    def _two_reversals(self):
        if len(self.reversal_times) < 2:
            raise Fails(f"bank reversals of the nominal: {len(self.reversal_times)}; the statement needs two")
        return self.reversal_times


class DownrangeFlight(Flight):
    """That of Figs. 7 and 8."""

    channel = DOWNRANGE
    first, second = 130.0, 200.0  # s, as the text has the ends of the phases of Fig. 7b


def radius_flight(planet: Planet, gains: Gains, responses: Responses) -> RadiusFlight:
    """Flight with a radius error."""
    return RadiusFlight(planet, gains, responses)


def downrange_flight(planet: Planet, gains: Gains, responses: Responses) -> DownrangeFlight:
    """Flight with a downrange error."""
    return DownrangeFlight(planet, gains, responses)


def crossrange_flight(planet: Planet, gains: Gains, responses: Responses) -> CrossrangeFlight:
    """Flight with a crossrange error."""
    return CrossrangeFlight(planet, gains, responses)


# ---- what feedback leaves --------------------------------------------------------------------------------------------


def remaining(responses: Responses, channel: int) -> np.ndarray:
    """Share of the final error without feedback that is left, (2,), of the compared errors."""
    law = LAW_OF[channel]
    return size(responses.tabulated_error[law, channel]) / size(responses.tabulated_error[PLAIN, channel])
