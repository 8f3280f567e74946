"""What several claims share: what the flights of all laws give, and what statements call so."""

import numpy as np

from marsedl.montecarlo.statistics import binomial_interval, mean_standard_error, variance_standard_error
from marsedl.papers.random_field.components import BANK_COSINE, FLIGHT_PATH_ANGLE
from marsedl.papers.random_field.flight_statistics import LEVEL, delta_v_percentile, lost, step_violations
from marsedl.papers.random_field.records import CAPTURED, OUTCOMES, FlightEnsemble, Gains
from marsedl.replication.claims.thresholds import CONFIDENCE, SIGMAS
from marsedl.replication.claims.writing import Evaluation, Fails, Test, doubtful, holds, provided

OPEN = 0  # the law without control; the last one is that of the last iteration


def normal_violation(mean: np.ndarray, deviation: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """Probability that a normal variable lies beyond either of two limits."""
    from scipy.special import ndtr

    with np.errstate(divide="ignore", invalid="ignore"):  # without any deviation it lies where its mean is
        scaled = (np.asarray(mean) - limits[0]) / deviation, (limits[1] - np.asarray(mean)) / deviation
    certain = np.where((np.asarray(mean) < limits[0]) | (np.asarray(mean) > limits[1]), 1.0, 0.0)
    return np.where(np.asarray(deviation) > 0.0, sum(ndtr(-distance) for distance in scaled), certain)


def distribution_distance(sample: np.ndarray, mean: float, deviation: float) -> float:
    """Largest difference of the distribution function of a sample from a normal one (Kolmogorov)."""
    from scipy.special import ndtr

    ordered = np.sort(sample)
    if not len(ordered) or not np.isfinite(mean) or not deviation > 0.0:
        return np.nan
    expected = ndtr((ordered - mean) / deviation)
    rank = np.arange(len(ordered) + 1) / len(ordered)
    return float(max((rank[1:] - expected).max(), (expected - rank[:-1]).max()))


def node_rows(ensemble: FlightEnsemble, partition: np.ndarray) -> np.ndarray:
    """Rows of the stored times that are the nodes of a partition."""
    return np.abs(ensemble.time - np.asarray(partition)[:, np.newaxis]).argmin(axis=1)


def node_deviations(gains: Gains, ensemble: FlightEnsemble, law: int) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of radius, velocity and path angle at the nodes, flown and predicted: two arrays (nodes, 3)."""
    rows = node_rows(ensemble, gains.partition)
    states = slice(0, FLIGHT_PATH_ANGLE + 1)
    variance = np.diagonal(ensemble.covariance[law, rows, states, states], axis1=1, axis2=2)
    return np.sqrt(variance), np.sqrt(np.diagonal(gains.covariance[law], axis1=1, axis2=2))


def commanded(gains: Gains, ensemble: FlightEnsemble, law: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the commanded control in every interval, over the trials, two arrays."""
    rows = node_rows(ensemble, gains.partition[:-1])
    variance = ensemble.covariance[law, rows, BANK_COSINE, BANK_COSINE]
    return ensemble.mean[law, rows, BANK_COSINE], np.sqrt(np.maximum(variance, 0.0))


def share_error(count: np.ndarray, trials: int) -> np.ndarray:
    """Standard error of the share `count / trials`, of any shape: that of many trials, and at most that of few.

    A third of the way to the further bound of its interval (Clopper, Pearson) at three standard errors. So a share of
    none or of all has an error too.
    """
    share, (low, high) = np.asarray(count) / trials, binomial_interval(count, trials, CONFIDENCE)
    return np.maximum(share - low, high - share) / SIGMAS


def reach_error(ensemble: FlightEnsemble, law: int, row: int) -> float:
    """Standard error of the mean plus three sigma of the command at a stored time, at most, whatever its distribution.

    That of a standard deviation takes the fourth moment: of commands within the limits from their histogram, of those
    beyond from as many trials as went furthest beyond at any time.
    """
    counts, edges = ensemble.histogram[law, row, 0], ensemble.histogram_edges[law, 0]
    mean, variance = ensemble.mean[law, row, BANK_COSINE], ensemble.covariance[law, row, BANK_COSINE, BANK_COSINE]
    flights, beyond = counts.sum(), counts[0] + counts[-1]
    excess = np.sort(np.nan_to_num(ensemble.observed_maximum[law, :, 1], nan=-np.inf))
    tail = excess[len(excess) - beyond :] + np.abs(edges[[0, -1]] - mean).max()
    fourth = (counts[1:-1] @ ((edges[1:] + edges[:-1]) / 2 - mean) ** 4 + (tail**4).sum()) / max(flights, 1)
    of_variance, deviation = variance_standard_error(variance, max(fourth, variance**2), flights), np.sqrt(variance)
    # As if mean and deviation erred together, which a long tail on one side makes them do.
    return float(mean_standard_error(variance, flights) + SIGMAS * (of_variance / (2 * deviation) if deviation else 0))


class Laws:
    """What the flights of all laws give; arrays have an entry for every law."""

    def __init__(self, gains: Gains, ensemble: FlightEnsemble):
        """Take the laws and the trials that they fly."""
        self.gains, self.ensemble = gains, ensemble
        self.trials = ensemble.outcome.shape[1]
        self.number = range(len(gains.control))
        self.last = self.number[-1]
        self.lost = lost(ensemble)
        # 99th percentiles of delta-v with their standard errors, then means and deviations of captured trials, m/s.
        self.percentile, self.error = np.array([delta_v_percentile(ensemble, law, LEVEL) for law in self.number]).T
        captured = [values[np.isfinite(values)] for values in ensemble.delta_v]
        self.mean = np.array([values.mean() if len(values) else np.nan for values in captured])
        self.deviation = np.array([values.std(ddof=1) if len(values) > 1 else np.nan for values in captured])
        self.offset = self.mean - gains.delta_v_mean  # flown less predicted mean, m/s
        # Trials beyond the limits of the control, in every interval, (laws, intervals), and in any.
        self.violations, self.any_violations = step_violations(ensemble, gains.partition)
        # Largest differences of the distribution functions of delta-v, flown and predicted.
        predicted = zip(captured, gains.delta_v_mean, gains.delta_v_deviation, strict=True)
        self.distance = np.array([distribution_distance(*of_law) for of_law in predicted])
        self.distance_error = 0.5 / np.sqrt(self.trials)  # of a distribution function where it is one half

    @property
    def lost_trials(self) -> list[str]:
        """Lost trials of all laws, as a sentence if there are any."""
        if not self.lost.any():
            return []
        return [f"of {self.trials:,} trials are lost " + ", ".join(f"{count:,}" for count in self.lost)]

    @property
    def complete(self) -> Test:
        """Test that few enough trials are lost for a statement about the distribution of all of them."""
        few = np.all(self.lost <= (1.0 - LEVEL) * self.trials)
        return provided("", True) if few else doubtful(f"more than {100 * (1.0 - LEVEL):g} % of the trials are lost")

    def percentiles(self) -> str:
        """The percentile of every law in words."""
        return ", ".join(
            f"{value:.1f} ± {error:.1f}" if np.isfinite(value) else f"none ({count:,} lost)"
            for value, error, count in zip(self.percentile, self.error, self.lost, strict=True)
        )

    def outcomes(self, law: int) -> str:
        """How many trials of a law were lost and how, in words; empty if none was."""
        codes = self.ensemble.outcome[law]
        return ", ".join(
            f"{(codes == code).sum():,} {text}" for code, text in OUTCOMES.items() if code != CAPTURED and code in codes
        )

    def holds(self, *parts: Test | str, **numbers: object) -> Evaluation:
        """A statement about these flights."""
        return holds(*parts, *self.lost_trials, trials=self.trials, **numbers)


def laws(gains: Gains, aerocapture: FlightEnsemble) -> Laws:
    """Flights of all laws."""
    return Laws(gains, aerocapture)


class ClosedLoop(Laws):
    """The same, of a reading that has a law besides the open loop."""


def closed_loop(laws: Laws) -> ClosedLoop:
    """Require a law besides the open loop."""
    if laws.last == OPEN:
        raise Fails(f"no law but the open loop: {laws.gains.refused}", laws.trials)
    return ClosedLoop(laws.gains, laws.ensemble)
