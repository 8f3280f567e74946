"""Laws are ranked as surely as is said: intervals of repeated arenas of made-up laws hold as often as they say."""

import numpy as np
import pytest

from marsedl.scenarios import ranking

CONFIDENCE = 0.9


def arena(rng, trials=2000):
    """Misses of four laws in the same trials, of which two are the same in the mean, and whether they are in a box."""
    common = rng.standard_normal(trials)
    means = {"a": 1.0, "b": 1.0, "c": 1.05, "d": 1.3}
    misses = {
        name: np.exp(0.3 * common + 0.2 * rng.standard_normal(trials)) * mean / np.exp(0.5 * 0.13)
        for name, mean in means.items()
    }
    return means, misses, {name: values < 1.5 for name, values in misses.items()}


@pytest.fixture(scope="module")
def repeated():
    rng = np.random.default_rng(1)
    arenas = [arena(rng) for _ in range(300)]
    return arenas, [ranking.paired(misses, inside, CONFIDENCE) for _, misses, inside in arenas]


def test_intervals_of_all_pairs_hold_at_once_as_often_as_is_said(repeated):
    arenas, pairs = repeated
    means = arenas[0][0]
    inside = {name: np.mean([one[2][name].mean() for one in arenas]) for name in means}
    held = 0
    for one in pairs:
        truths = [(pair.mean, means[pair.first] - means[pair.second]) for pair in one]
        truths += [(pair.inside, inside[pair.first] - inside[pair.second]) for pair in one]
        held += all(estimate.lower <= truth <= estimate.upper for estimate, truth in truths)
    assert held / len(pairs) >= CONFIDENCE - 2.0 * np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / len(pairs))


def test_equal_laws_are_a_tie_and_the_worst_is_last(repeated):
    _, pairs = repeated
    ranked = [ranking.places(one) for one in pairs]
    assert np.mean([one["d"] == (4, 4) for one in ranked]) > 0.99
    assert np.mean([one["a"][0] == 1 and one["b"][0] == 1 for one in ranked]) >= CONFIDENCE
    ranked = [ranking.places(one, "inside") for one in pairs]
    assert np.mean([one["d"] == (4, 4) for one in ranked]) > 0.99


def coverage(draw, truth, level=0.99, repeats=400, count=5000):
    rng = np.random.default_rng(2)
    found = [ranking.tail_mean(draw(rng, count), level, CONFIDENCE) for _ in range(repeats)]
    return np.mean([one.lower <= truth <= one.upper for one in found])


def test_the_tail_mean_holds_for_light_tails_and_holds_less_often_for_heavy_ones():
    """Of Rayleigh misses, and of Pareto ones, whose variance is rarely seen in so few."""
    from scipy.integrate import quad
    from scipy.stats import pareto, rayleigh

    def beyond(law):
        edge = law.ppf(0.99)
        return edge + quad(law.sf, edge, np.inf)[0] / 0.01

    light, heavy = rayleigh(), pareto(2.2)
    covered = coverage(lambda rng, count: light.rvs(count, random_state=rng), beyond(light))
    assert covered >= CONFIDENCE - 3.0 * np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / 400)
    assert coverage(lambda rng, count: heavy.rvs(count, random_state=rng), beyond(heavy)) < covered


def test_a_summary_says_what_its_trials_say_and_no_more():
    misses = np.linspace(0.0, 1000.0, 1001)
    found = ranking.summary_of(misses, misses < 250.0)
    assert found["mean"].value == pytest.approx(500.0) and found["p95"].value == pytest.approx(950.0)
    assert found["p95"].lower < 950.0 < found["p95"].upper
    assert np.isnan(found["p99.9"].lower) and np.isnan(found["tail"].lower)  # a thousand trials do not tell them
    assert found["inside"].value == pytest.approx(250 / 1001)


def test_more_trials_narrow_an_interval_as_is_said():
    rng = np.random.default_rng(3)
    small = ranking.summary_of(rng.rayleigh(size=2000), np.ones(2000, bool))["mean"]
    half_width = 0.5 * (small.upper - small.lower)
    needed = int(ranking.trials_needed(small.value, half_width, 2000, 0.01))
    large = ranking.summary_of(rng.rayleigh(size=needed), np.ones(needed, bool))["mean"]
    assert 0.5 * (large.upper - large.lower) / large.value == pytest.approx(0.01, rel=0.1)


def test_laws_of_other_trials_are_not_compared():
    with pytest.raises(ValueError, match="trial by trial"):
        ranking.paired({"a": np.ones(3), "b": np.ones(4)}, {"a": np.ones(3, bool), "b": np.ones(4, bool)})
