"""A user's law in one file: what is refused and how, and that it flies as residents do."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from marsedl import cli
from marsedl.fly.flights import Flights
from marsedl.replication.errors import InputError
from marsedl.scenarios import SCENARIOS, arena, contest, load
from marsedl.scenarios.own_law import own_law
from marsedl.scenarios.scenario import POOLS, Resident

ROOT = Path(__file__).parents[2]
HEAD = "from typing import NamedTuple\n\n\nclass Parameters(NamedTuple):\n    gain: float = 2.0\n\n\n"
GUIDE = "def guide(velocity, law: Parameters):\n    return 1e-4 * law.gain * velocity\n\n\n"
WITH_HELPER = "from turns import half\n\n\ndef guide(velocity):\n    return half(velocity)\n"


@pytest.fixture(scope="module")
def scenario():
    return load("entry", ROOT)


@pytest.fixture(autouse=True)
def process(monkeypatch):
    """Numerics stay as they are, as this process is up already."""
    monkeypatch.setattr("marsedl.replication.pipeline.numerics.pin_numerics", lambda root: None)


def written(folder, text, name="my_law.py"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def undispersed(scenario, law, condition="exact"):
    """The flight without any error: its final numbers, and its scores."""
    campaign = scenario.campaign(law, condition, 1).perturbed(np.zeros((3, 1)))
    flights = Flights(campaign, *campaign.fly_all(0, 1, 1, False, False), (1, False, False))
    return flights.numbers, scenario.scores(flights)


# ---- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("def guide(velocity)\n    return 1.0\n", "my_law.py, line 1: expected ':'; correct the syntax"),
        ("import helprs\n", "my_law.py, line 1, in <module>: ModuleNotFoundError: No module named 'helprs'"),
        ("x = 1\n\ny = x / 0\n", "my_law.py, line 3, in <module>: ZeroDivisionError: division by zero"),
        ("def law(velocity):\n    return 1.0\n", "no function 'guide', the law; .* or rename one of law$"),
        ("x = 1\n", "no function 'guide', the law; write one, such as 'def guide"),
        ("class Parameters:\n    gain = 1.0\n\n\ndef guide(law):\n    return 1.0\n", "Parameters is no NamedTuple"),
        (f"{HEAD}def guide(velocity):\n    return 1.0\n", "guide does not ask for 'law', so that it never sees"),
        (f"{HEAD.replace(' = 2.0', '')}{GUIDE}", "Parameters has no gain: give a default, or write 'def prepare"),
        ("def guide(law):\n    return 1.0\n\n\ndef prepare(onboard):\n    return 1\n", "define 'class Parameters"),
        (f"{HEAD}{GUIDE}TUNED = {{'gian': (1.0, 2.0)}}\n", "'gian', which is no parameter; did you mean 'gain'?"),
        (f"{HEAD}{GUIDE}TUNED = {{'gain': (0.0, 2.0)}}\n", r"TUNED of 'gain' is \(0.0, 2.0\); give the least and"),
        (f"{HEAD}{GUIDE}TUNED = ['gain']\n", "TUNED names at most four numbers, such as"),
    ],
)
def test_a_file_that_is_no_law_is_told_with_its_line(tmp_path, text, sentence):
    with pytest.raises(InputError, match=sentence):
        own_law(written(tmp_path, text))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("    return {'gain': 1.0}\n", r"prepare \(.*my_law.py, line 12\) returned dict; return Parameters\(...\)"),
        ("    return onboard.speed\n", "my_law.py, line 13, in prepare: AttributeError: 'object' object has no"),
    ],
)
def test_what_prepare_does_wrong_is_told_with_its_line(tmp_path, body, sentence):
    resident = own_law(written(tmp_path, f"{HEAD}{GUIDE}def prepare(onboard):\n{body}"))
    with pytest.raises(InputError, match=sentence):
        resident.design(object())


@pytest.mark.parametrize("name", ["none.py", "law.txt"])
def test_what_is_no_file_of_a_law_is_refused(tmp_path, name):
    written(tmp_path, "", "law.txt")
    with pytest.raises(InputError, match=rf"{name}: there is no such law, a .py or .csv file"):
        own_law(tmp_path / name)


def test_a_module_beside_the_law_that_hides_one_of_python_is_refused(tmp_path):
    """As compiled flights take functions of Python as they are, its edits would not be seen."""
    written(tmp_path, "def half(velocity):\n    return 1.0\n", "this.py")
    with pytest.raises(InputError, match=r"this.py has the name of a module of Python; rename it"):
        own_law(written(tmp_path, WITH_HELPER.replace("turns", "this")))


@pytest.mark.parametrize(
    ("guide", "sentence"),
    [
        ("def guide(state):\n    return 1e-4 * state.velocity\n", "asks for 'state', the truth of its trial, which no"),
        (
            "def guide(vehicle):\n    return 1.0\n",
            "asks for 'vehicle', the truth of its trial, which no guidance knows",
        ),
        ("def guide(speed):\n    return 1.0\n", "asks for 'speed', of which it is not told"),
        ("import random\n\n\ndef guide(time):\n    return random.random()\n", "whose answers belong to no trial"),
        ("def guide(time):\n    return 70.0\n", "bank is 70 rad, more than a turn; give it in radians"),
        ("def guide(time):\n    return 1.0 if time < 3.0 else slow\n", "my_law.py, line 2, in guide: NameError: name"),
    ],
)
def test_a_law_that_cannot_fly_is_told_before_anything_is_compiled(tmp_path, scenario, guide, sentence):
    one = contest.Contest(scenario, "exact", lambda *lines: None)
    with pytest.raises(InputError, match=sentence):
        one.enter(written(tmp_path, guide))


def test_a_table_with_a_column_of_nothing_is_refused(tmp_path, scenario):
    one = contest.Contest(scenario, "exact", lambda *lines: None)
    with pytest.raises(InputError, match=r"my.csv: column 'bnk' is unknown; did you mean 'bank'"):
        one.enter(written(tmp_path, "velocity,bank,bnk\n0,1,0\n6000,1,0\n", "my.csv"))
    with pytest.raises(InputError, match=r"my.csv, line 2"):
        own_law(written(tmp_path, "velocity,bank\n0\n", "my.csv"))


# ---- how it becomes a resident ---------------------------------------------------------------------------------------


def test_tuned_numbers_go_to_prepare_or_else_to_the_parameters(tmp_path):
    text = f"'''Words.\n\nMore.'''\n{HEAD}    power: float = 1.0\n\n\n{GUIDE}"
    text += "def prepare(onboard, weight=3.0):\n    return Parameters(power=weight * onboard)\n\n\n"
    resident = own_law(written(tmp_path, f"{text}TUNED = {{'gain': (1.0, 9.0), 'weight': (1.0, 9.0)}}\n"))
    assert resident.words == "Words" and resident.tuned == {"gain": (1.0, 9.0), "weight": (1.0, 9.0)}
    assert resident.design(2.0).keywords["law"] == (2.0, 6.0)
    assert resident.design(2.0, gain=5.0, weight=4.0).keywords["law"] == (5.0, 8.0)


def test_an_edited_module_beside_the_law_flies_as_it_is_now(tmp_path, scenario):
    def flown(number):
        written(tmp_path, f"def half(velocity):\n    return {number}\n", "turns.py")
        law = own_law(path).design(None)
        return contest.law_digest(scenario, law, "exact"), law(100.0)

    path = written(tmp_path, WITH_HELPER)
    first, edited, again = flown(0.5), flown(0.7), flown(0.5)
    assert first == again != edited and (first[1], edited[1]) == (0.5, 0.7)


def test_prepare_sees_nothing_of_the_truth(tmp_path, scenario):
    user = written(
        tmp_path, "based_on: entry\nsummary: Thick air.\ntruth:\n  density_factor: {value: 1.3, source: mine}\n"
    )
    other = load("entry", ROOT, user)
    first_law = own_law(ROOT / "src/marsedl/scenarios/entry/first_law.py")
    knows, told = (first_law.design(one.onboard).keywords["law"] for one in (scenario, other))
    for a, b in zip(knows, told, strict=True):
        np.testing.assert_array_equal(a, b)
    assert scenario.truth("dispersed").truth.density_factor != other.truth("dispersed").truth.density_factor
    assert not {"truth", "navigation", "box"} & {name for name in dir(scenario.onboard.given) if name[0] != "_"}


class Held(NamedTuple):
    banks: np.ndarray


def held(time, law: Held):
    return law.banks[int(time)]


def test_a_file_a_gain_table_and_a_resident_fly_alike(tmp_path, scenario):
    """The banks that the nominal law commands in the flight without errors, against time, give the same bits."""
    numbers, _ = undispersed(scenario, scenario.law("no_feedback"))
    campaign = scenario.campaign(scenario.law("no_feedback"), "exact", 1).perturbed(np.zeros((3, 1)))
    flight = Flights(campaign, *campaign.fly_all(0, 1, 1, False, False), (1, False, False)).replay(0, in_python=True)
    banks = flight.history["commanded_bank"].loc[np.arange(0.0, flight.final["end_time"])]
    table = banks.rename("bank").rename_axis("time").to_csv(float_format="%.17g")
    text = f"import numpy as np\n\nBANKS = np.array({[*map(float, banks)]})\n\n\n"
    text += "def guide(time):\n    return BANKS[int(time)]\n"
    laws = {
        "file": own_law(written(tmp_path, text)).design(scenario.onboard),
        "table": own_law(written(tmp_path, table, "banks.csv")).design(scenario.onboard),
        "resident": Resident("", lambda onboard: partial(held, law=Held(banks.to_numpy()))).design(scenario.onboard),
    }
    for name, law in laws.items():
        np.testing.assert_array_equal(undispersed(scenario, law)[0], numbers, err_msg=name)


# ---- new-law and fly -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*SCENARIOS])
def test_the_new_law_lands_in_the_box_without_errors(tmp_path, scenario, name):
    path, one = contest.new_law("my_law", name, tmp_path), scenario if name == "entry" else load(name, ROOT)
    _, scores = undispersed(one, own_law(path).design(one.onboard))
    assert scores["inside"] == 1.0


def test_what_is_no_name_of_a_law_a_scenario_or_a_condition_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    path = contest.new_law("my_law", "entry", tmp_path)
    for name, where, sentence in (
        ("my_law", "entry", "exists already; give another name"),
        ("my-law", "entry", "'my-law' is no name of a law"),
        ("other", "entri", "did you mean 'entry'"),
    ):
        with pytest.raises(InputError, match=sentence):
            contest.new_law(name, where, tmp_path)
    assert cli.main(["fly", str(path), "--condition", "exakt"]) == 2
    assert "no condition 'exakt'; did you mean 'exact'?" in capsys.readouterr().err


def test_looks_at_the_sealed_pool_are_counted(tmp_path):
    path = tmp_path / "arena" / "looks.csv"
    assert contest.looks(path, "entry dispersed", "mine", "a1") == (1, 1)
    assert contest.looks(path, "entry dispersed", "mine", "b2") == (1, 2)
    assert contest.looks(path, "entry exact", "mine", "a1") == (1, 1)
    assert contest.looks(path, "entry dispersed", "mine", "a1") == (2, 3)


def test_a_law_flies_the_same_alone_and_against_others_and_from_the_cache(tmp_path, scenario, capsys, monkeypatch):
    written(tmp_path, "def half(velocity):\n    return 1.0 + 5e-5 * velocity\n", "turns.py")
    path = written(tmp_path, WITH_HELPER)
    monkeypatch.chdir(ROOT)
    command = ["fly", str(path), "--against", "no_feedback", "--trials", "40", "--proof", "-o", str(tmp_path / "out")]
    looks = tmp_path / "looks"
    monkeypatch.setattr(cli, "ARENA", looks)
    for look in (1, 2):
        assert cli.main(command) == 0
        said = capsys.readouterr().out
        assert f"40 trials of the sealed pool: look {look} of this law, {look} of all laws flown here" in said
        assert said.count(" my_law  ") == said.count(" no_feedback  ") == 2
    alone = arena.flown(scenario, own_law(path).design(scenario.onboard), "dispersed", POOLS["proof"], 0, 40)
    rows = np.genfromtxt(tmp_path / "out" / "proof_trials.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    np.testing.assert_array_equal(rows[rows["law"] == "my_law"]["miss"], alone["miss"])
    assert {one.name for one in (tmp_path / "out").iterdir()} == {
        f"{pool}_{what}" for pool in ("proof", "fresh")
        for what in ("ranks.csv", "pairs.csv", "trials.csv", "ranks.png", "footprint.png")
    }  # fmt: skip
    script = f"""
from pathlib import Path
from marsedl.scenarios import arena, load
from marsedl.scenarios.own_law import own_law
scenario = load("entry", Path({str(ROOT)!r}))
law = own_law(Path({str(path)!r})).design(scenario.onboard)
print(arena.flown(scenario, law, "dispersed", {POOLS["proof"]}, 0, 40).digest())
"""
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert process.stdout.strip() == alone.digest(), process.stderr[-2000:]


def test_residents_that_cannot_fly_are_told_with_the_reason(tmp_path, scenario, monkeypatch):
    def fails(onboard):
        raise ValueError("the cone program has no solution")

    monkeypatch.setattr(type(scenario), "residents", {"hopeless": Resident("", fails)})
    lines = []
    one = contest.Contest(scenario, "exact", lambda *said: lines.extend(said))
    one.against()
    assert one.refused == {"hopeless": "the cone program has no solution"} and not one.laws
    with pytest.raises(InputError, match="there is no resident 'apolo'"):
        one.against(["apolo"])


def test_a_scenario_file_of_a_user_is_found_by_what_it_is_based_on(tmp_path):
    text = "based_on: entry\nsummary: A larger box.\nbox:\n  largest_miss_km: {value: 10.0, source: mine}\n"
    assert contest.scenario_of(ROOT, str(written(tmp_path, text, "mine.yaml"))).given.box.largest_miss == 1e4
    with pytest.raises(InputError, match=r"bad.yaml: based_on is 'entri', .* did you mean 'entry'\?"):
        contest.scenario_of(ROOT, str(written(tmp_path, text.replace("entry", "entri"), "bad.yaml")))
