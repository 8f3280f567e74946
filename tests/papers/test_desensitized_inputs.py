"""Bad input of the desensitized-landing paper: one clear message each, that names key or case, and the remedy."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.papers.desensitized import entry_problem, tradeoff
from marsedl.papers.desensitized.entry_problem import STATES, Trajectory
from marsedl.papers.desensitized.inputs import Design, Solver
from marsedl.papers.desensitized.nominal import refuse_other_branch
from marsedl.replication.errors import MarsedlError, SolverError
from readings import reading_of


def test_bank_conditions_are_free_or_values_in_degrees():
    """Every one may be freed or fixed; those of `corrected` are free but for the rate at entry."""
    mine = reading_of(
        "desensitized", initial_bank_rate_deg_s=None, final_bank_deg=-90.0, final_bank_rate_deg_s=20.0
    ).inputs
    ends = mine.mission
    assert ends.initial_bank is ends.initial_bank_rate is None
    assert (ends.final_bank, ends.final_bank_rate) == pytest.approx((-np.pi / 2, np.pi / 9))
    plain = reading_of("desensitized").inputs.mission
    assert plain.initial_bank_rate == 0.0 and plain.initial_bank is plain.final_bank is plain.final_bank_rate is None
    declared = entry_problem.problem(mine)
    assert "bank" not in declared.initial and "bank_rate" not in declared.initial
    assert declared.final["bank"] == ends.final_bank and declared.final["bank_rate"] == ends.final_bank_rate


# --- refusals of the stages -------------------------------------------------------------------------------------------


def refused(desensitized, reading="corrected", kind=MarsedlError, **changes):
    """The one line with which a nominal is refused."""
    with pytest.raises(kind) as error:
        desensitized.nominal(reading, **changes)
    assert type(error.value) is kind
    message = str(error.value)
    assert "\n" not in message
    return message, error.value


def test_a_target_out_of_reach_names_the_worst_constraint(desensitized):
    """By far more than the tolerance; the last iterate is there to look at."""
    out_of_reach = {"final_longitude": np.radians(40.0)}
    message, error = refused(desensitized, kind=SolverError, solver_iterations=60, **out_of_reach)
    assert re.search(r"^nominal: the solver ended with \w+ after \d+ iterations, .*worst constraint is ", message)
    assert float(re.search(r"off by ([\d.e+]+)$", message)[1]) > 1e-2
    assert list(error.iterate) == ["time", *STATES, "bank_acceleration"]
    assert {len(column) for column in error.iterate.values()} == {101}
    assert error.iterate["altitude"][0] == pytest.approx(126.1e3)


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"nominal_first_bank": "positive"}, "nominal_first_bank negative instead of positive"),
        ({"lift_to_drag": 0.19}, "nominal_reversals 1 instead of 2"),  # no such branch: it is narrow in the vehicle
        ({"guess_banks": np.radians([85.5, -38.1, 63.3])}, "nominal_first_bank positive instead of negative"),
    ],
)
def test_a_solution_on_another_branch_is_refused(desensitized, changes, difference):
    message, _ = refused(desensitized, **changes)
    assert f"the nominal lies on another branch: {difference}" in message
    energy = float(re.search(r"control energy ([\d.]+) deg\^2/s\^3", message)[1])
    assert 0.06 < energy < 0.09 if "reversals 1" in difference else energy == pytest.approx(0.1378, abs=5e-5)
    mirrored = difference.startswith("nominal_first_bank")
    assert (
        "It is the mirror image" if mirrored else "Change guess_width first"
    ) in message and "guess_banks" in message


def test_all_that_tells_branches_apart_is_refused_at_once():
    """A bank angle that rolls on has two reversals as well, at other times: it is no solution with two reversals."""
    time = np.linspace(0.0, 100.0, 101)
    bank = np.radians(np.interp(time, [0.0, 20.0, 40.0, 100.0], [60.0, -60.0, 80.0, 440.0]))
    states = np.zeros((101, len(STATES)))
    states[:, STATES.index("bank")] = bank
    solver = Solver.from_plain(
        {"nominal_reversals": 2, "nominal_full_rolls": 0, "nominal_first_bank": "negative", "guess_width": 15.0}
    )
    with pytest.raises(MarsedlError) as error:
        refuse_other_branch(solver, Trajectory(time, states, np.full(100, 1e-3)))
    message = str(error.value)
    assert "nominal_reversals 3 instead of 2, nominal_full_rolls 1 instead of 0, nominal_first_bank positive" in message
    assert "reversals at 10.0, 28.6, 86.7 s" in message
    assert "mirror image" not in message


# --- other densities and guesses --------------------------------------------------------------------------------------


def table():
    """A density table as a reading of a user names it."""
    mine = reading_of(
        "desensitized",
        density_profile="table",
        density_table="data/atmosphere/mars_density.csv#marsgram_2021a_sample_daily_mean",
    )
    return {
        "density_profile": "table",
        "density_table": mine.inputs.planet.density_table,
    }


def test_a_density_table_has_the_branch_as_well(desensitized):
    """Splines cannot be expanded; the control flown again in the same air reaches the target as near as usual."""
    usual, nominal = desensitized.nominal(), desensitized.nominal("corrected", **table())
    assert nominal.reversals == 2 and nominal.status == "Solve_Succeeded"
    assert np.linalg.norm(nominal.miss) < 2.0 * np.linalg.norm(usual.miss)
    assert nominal.effort != pytest.approx(usual.effort, rel=1e-3)


@pytest.mark.parametrize("width", [15.0])
def test_guesses_fly_their_bank_profile(desensitized, width):
    """Steps of any steepness, without an overflow; the bank angle is the integral of the flown rates."""
    inputs = desensitized.stage_inputs("corrected", "nominal", guess_width=width, intervals=400)
    declared = inputs.call(entry_problem.problem)
    guess = inputs.call(entry_problem.profile_guess, declared, np.radians([-80.0, 40.0, -60.0]), [61.2, 211.2], 265.0)
    assert guess.states.shape == (401, 8) and guess.controls.shape == (400, 1) and guess.final_time == 265.0
    bank, rate = guess.states[:, 6], guess.states[:, 7]
    time = np.linspace(0.0, 265.0, 401)
    np.testing.assert_allclose(np.diff(rate), guess.controls[:, 0] * 265.0 / 400, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diff(bank), (rate[1:] + rate[:-1]) / 2 * 265.0 / 400, rtol=0, atol=1e-9)
    if width > 1.0:
        smooth = np.tanh((time[:, np.newaxis] - [61.2, 211.2]) / width)
        expected = np.radians(-80.0 + 60.0 * (1 + smooth[:, 0]) - 50.0 * (1 + smooth[:, 1]))
        assert np.abs(bank - expected).max() < np.radians(0.1)  # of second order in the intervals


def test_a_guess_that_cannot_be_flown_says_what_to_change(desensitized, monkeypatch):
    def failed(*arguments, **options):
        raise RuntimeError("flying the controls from 168 s on failed: the steps become ever shorter")

    monkeypatch.setattr(entry_problem, "simulate", failed)
    message, _ = refused(desensitized, guess_final_time=1200.0)
    assert "the guess cannot be flown to its end" in message and "from 168 s on failed" in message
    assert "guess_banks" in message and "guess_final_time" in message


# --- branches ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bank", "reversals", "rolls", "name"),
    [
        ([-80, 40, -20, -140], 2, 0, "2 reversals"),
        ([-80, 40], 1, 0, "1 reversal"),
        ([10, 50, 20], 0, 0, "0 reversals"),
        ([-80, 0.4, -0.4, 0.4, 80], 1, 0, "1 reversal"),  # level within half a degree
        ([-0.4, 0.4], 0, 0, "0 reversals"),
        ([100, 170, 190, 260], 0, 0, "0 reversals"),  # lift to the other side through down: no reversal
        ([10, 100, 190, 280, 359, 371], 1, 1, "360 deg roll"),
        (np.arange(-40, 700, 20), 2, 2, "720 deg roll"),
    ],
)
def test_branches_are_told_apart_by_their_bank(bank, reversals, rolls, name):
    bank = np.radians(np.asarray(bank, dtype=float))
    for sign in (1.0, -1.0):
        assert entry_problem.reversals(sign * bank) == reversals
        assert entry_problem.full_rolls(sign * bank) == rolls
        assert entry_problem.branch_name(sign * bank) == name


def test_reversals_are_timed_by_the_rule_that_counts_them():
    time = np.array([0.0, 1.0, 3.0, 4.0, 5.0])
    for turns in (-1.0, 0.0, 2.0):
        bank = np.radians([-10.0, 30.0, -10.0, -20.0, -15.0]) + 2.0 * np.pi * turns
        np.testing.assert_allclose(entry_problem.reversal_times(time, bank), [0.25, 2.5])
    grazing = np.radians([-10.0, 0.2, -0.2, 0.1, -10.0])  # within what counts as level
    assert entry_problem.reversals(grazing) == len(entry_problem.reversal_times(time, grazing)) == 0
    resting = np.radians([-10.0, 0.0, 0.0, 0.0, 10.0])  # on zero at nodes
    assert entry_problem.reversals(resting) == len(entry_problem.reversal_times(time, resting)) == 1
    over_the_top = np.radians([170.0, -170.0, -150.0, -160.0, -170.0])  # through 180 degrees, not through zero
    assert entry_problem.reversals(over_the_top) == 0
    assert entry_problem.first_bank(np.radians([0.1, -0.4, -3.0, 5.0])) == "negative"
    assert entry_problem.first_bank(np.zeros(3)) == "level"


# --- the weight -------------------------------------------------------------------------------------------------------


def path_of(efforts, branches, weights=None):
    """Points of a path with these control energies, one interval of a second each."""
    weights = weights or range(len(efforts))
    return [
        tradeoff.Point(
            SimpleNamespace(
                given={"weight": float(weight)},
                time=np.array([0.0, 1.0]),
                controls=np.array([[np.radians(np.sqrt(effort))]]),
            ),
            branch,
        )
        for effort, branch, weight in zip(efforts, branches, weights, strict=True)
    ]


@pytest.mark.parametrize("energy", [0.05, 0.15, 9.0])
def test_control_energies_that_no_solution_has_are_refused(energy):
    """Below the first, in the gap between branches, above the last."""
    points = path_of([0.1, 0.12, 0.2, 5.0], [0, 0, 1, 1])
    with pytest.raises(MarsedlError) as error:
        tradeoff.at_effort(None, None, points, energy)
    message = str(error.value)
    assert f"the control energy {energy:g} deg^2/s^3 of matched_efforts" in message
    assert "from 0.1 to 5 in 2 branches" in message and "extend weight_path" in message


def test_rows_are_the_first_points_with_their_energy(monkeypatch):
    """By the bracket that comes first along the path, also where a later branch passes the energy again."""

    def solved(solver, case, transcribed, guess, weight, **options):
        assert case == "control energy 1.5" and guess is not None
        return path_of([1.0 + weight**2], [0], [weight])[0].solution

    monkeypatch.setattr(tradeoff.entry_problem, "solve", solved)
    points = path_of([1.0, 2.0, 0.5, 3.0], [0, 0, 1, 1], [0.0, 1.0, 1.1, 2.0])
    point = tradeoff.at_effort(None, None, points, 1.5)
    assert point.branch == 0
    assert point.solution.given["weight"] == pytest.approx(np.sqrt(0.5), rel=1e-8)


def test_a_row_below_the_least_energy_is_left_out(monkeypatch):
    """Before, the first one was matched on the next branch, whose energies begin far below."""

    def solved(solver, case, transcribed, guess, weight, **options):
        return path_of([weight], [1], [weight])[0].solution

    monkeypatch.setattr(tradeoff.entry_problem, "solve", solved)
    weights = {"printed_weights": np.array([0.001, 0.01]), "matched_efforts": np.array([0.14, 0.3078])}
    rule = {"weight_rule": "matched", "printed_least_effort": 0.1374}
    design = Design.from_plain(weights | rule | {"infeasible_rows": "no_value"})
    points = path_of([0.1416, 0.143, 0.0509, 5.0], [0, 0, 1, 1], [0.0, 0.036, 0.0509, 5.0])
    rows, missing = tradeoff.chosen(None, design, None, points)
    ((c1, row),) = rows.items()
    assert missing == {0.001: (0.14, "the control energy 0.14 deg^2/s^3 lies below the least, 0.1416")}
    assert c1 == 0.01 and row.branch == 1 and tradeoff.effort(row.solution) == pytest.approx(0.3078)
    ratios = Design.from_plain(weights | rule | {"infeasible_rows": "printed_ratios"})
    assert tradeoff.row_efforts(ratios, 0.1416) == pytest.approx([0.1416 * 0.14 / 0.1374, 0.3078])
    assert tradeoff.row_efforts(ratios, 0.1378) == pytest.approx([0.14, 0.3078]), "where there is a solution"


def test_a_row_without_a_solution_leaves_the_others(monkeypatch):
    """Before, an energy in the gap between two branches ended the trade-off, and no claim had a value."""

    def solved(solver, case, transcribed, guess, weight, **options):
        return path_of([weight], [1], [weight])[0].solution

    monkeypatch.setattr(tradeoff.entry_problem, "solve", solved)
    design = Design.from_plain(
        {
            "printed_weights": np.array([0.001, 0.01]),
            "matched_efforts": np.array([0.15, 0.3078]),
            "weight_rule": "matched",
            "infeasible_rows": "no_value",
        }
    )
    points = path_of([0.1, 0.12, 0.2, 5.0], [0, 0, 1, 1], [0.0, 0.1, 0.2, 5.0])
    rows, missing = tradeoff.chosen(None, design, None, points)
    assert list(rows) == [0.01]
    assert missing[0.001].reason.startswith("no solution on the path has the control energy 0.15 deg^2/s^3")

    def failing(solver, case, *_, **__):
        raise SolverError(f"{case}: the solver ended with Restoration_Failed", {})

    monkeypatch.setattr(tradeoff.entry_problem, "solve", failing)
    rows, missing = tradeoff.chosen(None, design, None, points)
    assert rows == {} and [*missing] == [0.001, 0.01]
    assert missing[0.01].reason == "control energy 0.3078: the solver ended with Restoration_Failed"


def test_the_barrier_that_leads_beyond_a_fold_is_kept(monkeypatch):
    end = SimpleNamespace(solution="before", target=0.04, reached=0.036)
    tried = []

    def solved(solver, case, transcribed, guess, barrier, **options):
        tried.append(barrier)
        if len(tried) < needed:
            raise SolverError("does not converge", {})
        return "beyond"

    monkeypatch.setattr(tradeoff.entry_problem, "solve", solved)
    needed = 2
    assert tradeoff.beyond_branch(None, None, end) == ("before", "beyond", 1.0)
    tried.clear()
    needed = 3
    fold = tradeoff.beyond_branch(None, None, end)
    assert fold.beyond == "beyond" and np.isnan(fold.barrier), "the solver's own choice"
    tried.clear()
    needed = 4
    with pytest.raises(SolverError, match=r"stops at 0\.036, and 0\.04 does not converge; give a weight_path"):
        tradeoff.beyond_branch(None, None, end)
    assert tried == [1e-2, 1.0, None]


def test_a_jump_between_the_solutions_is_not_taken_for_a_row(monkeypatch):
    """Where branches are not told apart, two neighbours may lie on different ones, and no solution between them."""
    monkeypatch.setattr(
        tradeoff.entry_problem,
        "solve",
        lambda solver, case, transcribed, guess, weight, **options: (
            path_of([0.14 if weight < 0.036 else 0.05], [0], [weight])[0].solution
        ),
    )
    points = path_of([0.14, 0.05], [0, 0], [0.028, 0.0573])
    with pytest.raises(
        MarsedlError, match=r"jump past the control energy 0\.1 .* at the weight 0\.036.*weight_path between 0\.028 and"
    ):
        tradeoff.at_effort(None, None, points, 0.1)


def test_a_path_that_ends_says_where(monkeypatch):
    """Neither careful nor bold steps find a solution beyond."""

    class Stuck:
        def follow(self, start, name, values, **options):
            raise tradeoff.BranchEndError(name, 0.5, 0.6, start, None)

    barriers = []

    def solved(solver, case, transcribed, guess, weight, barrier, **options):
        barriers.append(barrier)
        raise SolverError(f"{case}: the solver ended with nothing", {"time": np.zeros(2)})

    monkeypatch.setattr(tradeoff.entry_problem, "solve", solved)
    solver = Solver.from_plain({"solver_tolerance": 1e-8, "solver_iterations": 5})
    design = Design.from_plain({"branch_tolerance": 1.0})
    first = path_of([0.1], [0])[0].solution
    with pytest.raises(SolverError) as error:
        tradeoff.follow(solver, design, Stuck(), first, [1.0])
    message = str(error.value)
    assert "stops at 0.5, and 0.6 beyond a branch: the solver ended with nothing" in message
    assert "weight_path with smaller steps" in message and list(error.value.iterate) == ["time"]
    assert barriers == [*sorted(barriers[:-1]), None]
