"""Laws of the entry: each against another formulation of the same design, or a slow integration."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.fly import Below, GainTable, fly
from marsedl.methods.covariance_steering import lqg_dual
from marsedl.methods.covariance_steering.steering_program import closed_loop
from marsedl.methods.lincov import compose, propagate
from marsedl.papers.stochastic_entry import flight, gains
from marsedl.papers.stochastic_entry.linearization import system
from marsedl.scenarios import load
from marsedl.scenarios.entry import cone_program, predictor, reshaped, residents
from marsedl.scenarios.entry.guidance import Guided, guide
from marsedl.scenarios.entry.onboard import start_of
from marsedl.scenarios.entry.residents import RESIDENTS

PLACE = 3397e3  # radius of Mars as the paper has it, m


@pytest.fixture(scope="module")
def onboard():
    return load("entry", Path(__file__).parents[2]).onboard


@pytest.fixture(scope="module")
def laws(onboard):
    return {name: resident.design(onboard) for name, resident in RESIDENTS.items()}


def flown(onboard, law, **options):
    """One undispersed flight, in Python."""
    mission = onboard.given.mission
    given = {"trigger": Below("velocity", mission.end_velocity), "end_time": mission.time_limit} | options
    return fly(onboard.entry, start_of(onboard.given), law=law, trials=1, compiled=False, **given)


@pytest.mark.parametrize("name", RESIDENTS)
def test_a_law_ends_where_the_nominal_flight_does_if_nothing_errs(onboard, laws, name):
    """Those that feed deviations back have none; the predictor corrects, but cannot behind the last command."""
    ended = flown(onboard, laws[name])
    assert ended.truth == ()
    miss = PLACE * (ended.final["longitude"][0] - onboard.nominal.longitude[-1])
    assert abs(miss) < (1e3 if name == "predictor_corrector" else 1.0)
    assert abs(PLACE * ended.final["latitude"][0]) < 100.0


def test_numbers_to_tune_are_arguments_of_the_design():
    import inspect

    for name, resident in RESIDENTS.items():
        arguments = inspect.signature(resident.design).parameters
        assert {"onboard", *resident.tuned} == {*arguments}, name
        for number, (least, largest) in resident.tuned.items():
            default = arguments[number].default
            assert 0.0 < least < largest and (default is None or least <= default <= largest), (name, number)


# ---- covariance steering by the cone program -------------------------------------------------------------------------


def steered_and_dual(onboard, control_weight):
    posed, _ = cone_program.problem(onboard, control_weight)
    system_with_density = cone_program.with_density(posed)
    gain, law = cone_program.steered(posed, system_with_density, onboard.given.design.chance_level)
    return posed, gain, law, lqg_dual.solve(posed)


def test_the_cone_program_with_density_has_the_gains_of_the_dual(onboard):
    """The control costs enough for one optimum; gains count by the control that they make of likely states."""
    posed, gain, law, dual = steered_and_dual(onboard, 1e6)
    assert law.status == dual.status == "optimal"
    apart = gain[:-1] - dual.gain[:-1]
    control = np.sqrt(np.einsum("ki,kij,kj->k", apart, dual.covariance[: len(apart)], apart))
    assert (control / posed.control_limits[:-1]).max() < 1e-3
    np.testing.assert_allclose(np.abs(gain).max(axis=0), np.abs(dual.gain).max(axis=0), rtol=1e-3)


def test_with_the_paper_s_weight_both_have_the_same_least_range_error(onboard):
    """The control is nearly free there, so that many gains are as good; the largest ones are those of the limits."""
    posed, gain, _, dual = steered_and_dual(onboard, 1.0)
    covariance, control = lqg_dual.variances(posed, gain)
    assert lqg_dual.cost_of(posed, covariance[-1], control) == pytest.approx(dual.cost, rel=1e-6)
    final, limits = lqg_dual.limit_ratios(posed, covariance[-1], control)
    assert max(final.max(), limits.max()) < 1.0 + 1e-5
    np.testing.assert_allclose(np.abs(gain).max(axis=0), np.abs(dual.gain).max(axis=0), rtol=1e-4)


def test_density_that_is_no_state_disturbs_as_much_as_one_that_is(onboard):
    """Covariances of the others, open loop and under some gains, and transitions with density slaved to altitude."""
    posed, slopes = cone_program.problem(onboard)
    blind = cone_program.without_density(posed, slopes, 0.0)
    intervals, unit = len(posed.control_limits), posed.state_scale[:4]
    model = onboard.linearization
    starts = gains.partition_starts(
        onboard.given.guidance, onboard.given.design, len(model.control), cone_program.INTERVAL
    )[:intervals]
    slaved = replace_matrices(system(model), model.slaved_transition, model.slaved_control)
    expected = compose(slaved, starts)
    np.testing.assert_allclose(
        blind.transition[:-1], expected.transition[:-1] * unit / unit[:, np.newaxis], rtol=0.0, atol=2e-2
    )
    feedback = np.random.default_rng(4).normal(size=(intervals, 4)) * 0.02
    for gain in (np.zeros((intervals, 4)), feedback):
        history = np.zeros((intervals, intervals + 1, 1, 4))
        history[np.arange(intervals), np.arange(intervals), 0] = gain
        found = closed_loop(blind, history).covariance
        padded = np.pad(gain / unit, ((0, 0), (0, 1)))[:, np.newaxis]
        expected = propagate(posed.system, padded, posed.initial_covariance).covariance[:, :4, :4]
        expected = expected / np.outer(unit, unit)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-3 * np.abs(expected).max())


def replace_matrices(linear, transition, control):
    return linear._replace(
        transition=transition,
        control=control[:, :, np.newaxis],
        noise=np.zeros(transition.shape),
        affine=np.zeros(control.shape),
    )


# ---- the regulator of the funnels ------------------------------------------------------------------------------------


def test_the_funnel_regulator_without_cost_on_the_way_is_that_of_least_final_cost(onboard, monkeypatch):
    """Two implementations of the Riccati recursion; a very long time makes the cost on the way small."""
    model, weight = onboard.linearization, 3e7
    monkeypatch.setattr(residents, "FUNNEL_TIME", 1e9)
    table = residents.funnel_regulator(onboard, control_weight=1e9 * weight).keywords["law"].table
    scaled = np.diag(residents.FUNNEL_SCALES**-2.0)
    final = model.trigger_projection[:4, :4].T @ scaled @ model.trigger_projection[:4, :4]
    steps = np.diff(model.time)
    price = steps * weight / (residents.FUNNEL_BANK**2 * (1.0 - model.bank_cosine[:-1] ** 2))
    linear = replace_matrices(system(model), model.slaved_transition, model.slaved_control)
    expected, _ = lqg_dual.lqg_gains(linear, final, price)
    np.testing.assert_allclose(table.gain[:-1, :4], expected, rtol=1e-5, atol=1e-9 * np.abs(expected).max())
    assert not table.gain[:, 4:].any() and np.abs(expected).max() > 0.0


# ---- tables of gains -------------------------------------------------------------------------------------------------


def test_a_table_of_gains_flies_as_a_gain_table(onboard):
    """Without reversals, heading alignment and rate limit, which a `GainTable` has not, and without range."""
    law = residents.regulator(onboard).keywords["law"]
    free = {"deadband_start_width": 1e9, "deadband_end_width": 1e9, "initial_direction": 1.0, "alignment_velocity": 0.0}
    settings = law.settings._replace(**free, largest_bank_change=10.0)
    gain = law.table.gain.copy()
    gain[:, [3, 5, 6]] = 0.0
    table = law.table._replace(gain=gain)
    reference, names = table.reference, ("altitude", "velocity", "flight_path_angle", "density")
    columns = {"time": np.arange(float(len(gain))), "bank_cosine": table.bank_cosine}
    for name, column in zip(names, (0, 1, 2, 4), strict=True):
        columns[name] = reference[:, column] - (settings.planet_radius if name == "altitude" else 0.0)
        columns[f"bank_cosine_per_{name}"] = gain[:, column]
    start = start_of(onboard.given) | {"velocity": 5805.0, "flight_path_angle_deg": -15.6}
    del start["flight_path_angle"]
    ends = [
        fly(onboard.entry, start, law=one, trials=1, compiled=False, end_time=140.0).final
        for one in (partial(guide, law=Guided(settings, table)), GainTable(columns, "time"))
    ]
    for name in ("altitude", "velocity", "flight_path_angle", "longitude", "latitude"):
        assert ends[0][name][0] == pytest.approx(ends[1][name][0], rel=1e-9, abs=1e-12), name


# ---- the reshaped reference ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain_weight", [None, 100.0])
def test_sensitivities_of_the_reshaped_reference_are_those_of_flights(onboard, gain_weight):
    """Range of flights by scipy with errors of a tenth of a deviation to both sides, beside the reference."""
    found = reshaped.reshaped(onboard, 0.1, gain_weight)
    aligned = int(np.searchsorted(onboard.linearization.time, onboard.nominal.alignment_time - 1e-6))
    problem, towards = reshaped._problem(onboard, aligned), reshaped._towards_range(onboard.linearization, aligned)
    errors = np.concatenate(
        [np.zeros((1, 4)), *(sign * np.diag(reshaped._deviations(onboard)) / 10 for sign in (1, -1))]
    )
    states = np.tile([problem.initial[name] for name in reshaped.STATES], (9, 1))
    states[:, 1:] += errors[:, :3]  # of velocity, path angle and downrange; the last one is of the density

    def rates(time, flat, cosine):
        each = flat.reshape(9, 4)
        steered = cosine + (each - each[0]) @ found.gain
        return np.ravel(
            [problem.rates(*s, u, 0.0, 1.0 + e) for s, u, e in zip(each, steered, errors[:, 3], strict=True)]
        )

    for cosine, *ends in zip(found.cosine, found.time, found.time[1:], strict=False):
        states = solve_ivp(rates, ends, states.ravel(), args=(cosine,), rtol=1e-9, atol=1e-9).y[:, -1].reshape(9, 4)
    ranges = states @ towards
    flown = 5.0 * (ranges[1:5] - ranges[5:])
    np.testing.assert_allclose(found.sensitivities, flown, rtol=0.0, atol=2e-3 * np.abs(flown).max())


def test_a_larger_weight_leaves_less_sensitivity(onboard):
    left = [np.sum(reshaped.reshaped(onboard, weight).sensitivities ** 2) for weight in (1e-3, 1e-1, 0.3)]
    assert left[0] > left[1] > left[2]


# ---- the predictor ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("time", [60.0, 100.0, 140.0])
def test_predicted_downrange_is_that_of_a_slow_integration(onboard, time):
    """The same equations by scipy, which finds the trigger by its root."""
    law = predictor.predicting(onboard).keywords["law"]
    model = onboard.linearization
    radius, *rest = model.state[np.searchsorted(model.time, time)]
    known = flight.Sensed(radius, *rest[:3], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    air, level, begins = (1.1, 1.4e-4), 0.5, rest[0] ** 2

    def rates(now, state):
        return predictor.change(*state[:3], predictor.steered(state[1], begins, level, law), air, law)

    def slow(now, state):
        return state[1] - law.settings.end_velocity

    slow.terminal = True
    start = (radius - law.settings.planet_radius, *rest[:3])
    end = solve_ivp(rates, (0.0, 400.0), start, rtol=1e-8, atol=1e-6, max_step=0.2, events=slow).y[3, -1]
    errors = [
        abs(predictor.predicted_downrange(known, level, air, law._replace(step=step)) - end)
        for step in (law.step, law.step / 2.0)
    ]
    assert errors[0] < 200.0 and errors[1] < errors[0] / 3.0  # of the second order
