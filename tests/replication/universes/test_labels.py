"""No label or cause of any claim contradicts the verdicts of the committed universes and readings: by plain loops."""

import math
from collections import defaultdict
from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.universes.judging import COMMITTED, committed_judge, only_moved
from marsedl.replication.universes.table import decoded

ROOT = Path(__file__).parents[3]
STOOD, REFUTED = {"reproduced", "close", "holds", "by_construction"}, {"differs", "fails"}


@pytest.fixture(scope="module", params=sorted(path.stem for path in (ROOT / COMMITTED).glob("*.h5")))
def judge(request):
    """What judges the committed universes of a paper, with the committed verdicts of its readings."""
    return committed_judge(request.param, input_model(request.param), ROOT)


@pytest.fixture(scope="module")
def verdicts(judge):
    """The verdicts of each claim: all of them, and those of the space-filling design."""
    every, filling = defaultdict(list), defaultdict(list)
    for at in range(len(judge.table.number)):
        for name, one in judge.of.items():
            if one.cause[at] == "result":
                every[name].append(str(one.verdicts[at]))
                if judge.table.design[at] == 1 and judge.table.seed[at] == 0:
                    filling[name].append(every[name][-1])
    for name, row in judge.rows.items():
        if every[name]:  # what no universe computes has no label
            every[name] += [one.verdict for one in row.readings.values()]
    return every, filling


def test_a_label_says_what_all_universes_and_readings_say(judge, verdicts):
    every, filling = verdicts
    for name in judge.of:
        of, standing = every[name], judge.standing(name)
        true, false, open_ = ({*of} & kinds for kinds in (STOOD, REFUTED, {"undetermined"}))
        deciding = sum(one in STOOD | REFUTED for one in filling[name])
        expected = (
            "not_computed" if not of
            else "too_few" if deciding < 20
            else "depends" if true and false
            else "undecided" if open_
            else "robust" if true else "never"
        )  # fmt: skip
        assert standing.label == expected, name
        counts = sum(one in STOOD for one in filling[name]), filling[name].count("undetermined"), len(filling[name])
        assert (standing.true, standing.undetermined, standing.of) == counts, name


def test_no_choice_decides_by_itself_and_only_in_combination(judge):
    for name in judge.of:
        one = judge.standing(name)
        assert not {*one.alone} & {*one.together}, name


def test_a_cause_is_admissible_and_no_other_choice_does_better(judge):
    corrected = decoded(judge.choices, judge.table.assignment[judge.base])
    compared = 0
    for name in judge.of:
        row, cause = judge.rows[name], judge.judged(name).cause
        if row.verdict not in REFUTED:
            assert cause is None, name
            continue
        admitted = set()
        for at in range(len(judge.table.number)):
            values = decoded(judge.choices, judge.table.assignment[at])
            if judge.table.design[at] == 0 and not judge.table.seed[at] and judge.of[name].verdicts[at] in STOOD:
                admitted.add((choice := only_moved(judge.choices, values, corrected), values.get(choice)))
        for reading, varied in judge.points.items():
            admitted.discard(varied)
            if row.readings.get(reading) and row.readings[reading].verdict in STOOD:
                admitted.add(varied)
        admitted = {
            (choice, value)
            for choice, value in admitted
            if choice and judge.choices.by_name[choice].kind != "misprint"
            and value not in judge.choices.by_name[choice].apart
        }  # fmt: skip
        assert bool(admitted) == (cause is not None and cause.is_true), name
        if cause is None:
            continue
        compared += 1
        choice = judge.choices.by_name[cause.choice]
        assert choice.kind != "misprint" and cause.value not in choice.apart, name
        assert cause.verdict in STOOD | REFUTED and cause.cause == "result" and not cause.beyond, name
        if not cause.is_true and math.isfinite(cause.missing):
            assert cause.missing < judge._missing(name, *_before(judge, name)), name
    assert compared or judge.table.number.size < 20


def _before(judge, name):
    before = judge.of[name].number(judge.base)
    return before, judge.verdict(name) == "fails", before


def test_numbers_agree_with_those_of_other_random_numbers_as_often_as_their_errors_say(judge):
    """99.7 % are due; of a share of so many numbers the lower end of the interval at 95 % has to reach 98.5 %."""
    share = judge.second_seed()
    if share.of:
        assert share.high >= 0.985, f"{share.count} of {share.of}"
