"""Studies that go on: kept in files, interrupted, and several cases beside each other."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from marsedl.fly import Below, Normal, compare, fly, load, sweep
from marsedl.fly.flights import mean_interval
from marsedl.montecarlo.statistics import paired_percentile_interval, paired_share_interval

sys.path.insert(0, __file__.rpartition("/")[0])
from flown_models import PROBE, Gains, Memory, Push, guide

HERE = Path(__file__).parent
DROP = {
    "start": {"altitude": Normal(500.0, 20.0)},
    "trigger": Below("altitude", 0.0),
    "end_time": 100.0,
    "period": 2.0,
    "seed": 5,
}
FAST = partial(guide, law=Gains(0.3))


def dropped(law=guide, trials=300, **options):
    return fly(PROBE, law=law, trials=trials, **DROP | options)


def equal(first, second):
    return (
        np.array_equal(first.numbers, second.numbers)
        and np.array_equal(first.outcome, second.outcome)
        and np.array_equal(first.histories, second.histories, equal_nan=True)
    )


@pytest.fixture(scope="module")
def whole():
    return dropped(trials=300, history=2.0)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """File of flights whose law can be imported."""
    file = tmp_path_factory.mktemp("kept") / "study.h5"
    first = dropped(trials=100, history=2.0).with_quantity("miss", "abs(speed + 15)", "m/s")
    first.save(file)
    return file


# ---- files -----------------------------------------------------------------------------------------------------------


def test_a_study_from_a_file_goes_on_with_the_same_bits(kept, whole):
    loaded = load(kept)
    assert loaded.trials == 100 and equal(loaded.extended(300), whole)
    assert loaded.replay(7).final == whole.replay(7).final
    assert loaded.values("miss").tolist() == np.abs(whole.final["speed"][:100] + 15.0).tolist()
    until = loaded.until("p50 of speed within 1 %")
    assert (until.search.reached, until.search.looks) == (True, 2)
    until.save(kept.with_name("until.h5"))
    assert load(kept.with_name("until.h5")).search == until.search


def test_a_study_goes_on_in_another_session(kept, whole):
    script = "import sys\nfrom marsedl.fly import load\nlast = load(sys.argv[1], compiled=False).extended(103)\n"
    script += "print(last.numbers.tobytes().hex())"
    path = os.pathsep.join(filter(None, (str(HERE), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-c", script, kept], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert done.stdout.strip() == np.ascontiguousarray(whole.numbers[:, :103]).tobytes().hex(), done.stderr


def test_a_law_that_exec_defines_is_kept(tmp_path):
    names = {}  # without the name of a module
    exec("def law(speed):\n    return -0.1 * speed", names)
    first = dropped(names["law"], 3, compiled=False, history=2.0)
    first.save(tmp_path / "study.h5")
    assert equal(load(tmp_path / "study.h5", law=names["law"], compiled=False), first)


def test_other_readers_understand_the_file(kept, whole):
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(kept, group="final") as final:
        assert final["speed"].attrs == {"units": "m/s", "long_name": "climb rate"}
        assert final["speed"].values.tolist() == whole.final["speed"][:100].tolist()
        assert final["outcome"].values[0].decode() == whole.outcome[0]
    with xarray.open_dataset(kept, group="history") as history:
        assert history["altitude"].dims == ("time", "trial")
    with h5py.File(kept) as file:
        source = file["declaration/law_source"].asstr()[()]
        assert source.startswith("def guide(sensed, memory")
        assert "Normal(mean=500" in file["declaration/start"].attrs["text"]


def test_a_law_that_is_not_found_leaves_the_numbers_and_may_be_given_again(tmp_path, whole):
    def local(sensed, memory, law: Gains = Gains()) -> tuple[Push, Memory]:  # noqa: B008
        return Push(law.gain * helper(sensed.speed)), memory

    options = {"compiled": False, "history": 2.0}
    first, file = dropped(local, 40, **options), tmp_path / "study.h5"
    first.save(file)
    with pytest.warns(UserWarning, match=r"import does not find law \(<function .*local>\): give it again, as in load"):
        loaded = load(file, compiled=False)
    assert equal(loaded, first) and {name: list(one) for name, one in loaded.drawn.items()} == {
        name: list(one) for name, one in first.drawn.items()
    }
    for ask in (
        lambda flights: flights.percentiles(["speed", "start_altitude"], 50),
        lambda flights: flights.against(first),
        lambda flights: flights.to_pandas(),
        lambda flights: flights.to_xarray().to_dataframe(),
    ):
        assert ask(loaded).equals(ask(first))
    starts = {"altitude": "altitude", "speed": 0.0}
    for fly_on in (
        lambda: loaded.extended(50),
        lambda: loaded.replay(3),
        lambda: loaded.budget("speed"),
        lambda: loaded.as_start(starts),
    ):
        with pytest.raises(ValueError, match="import does not find law"):
            fly_on()
    with pytest.raises(ValueError, match="were read without their law: copy the file"):
        loaded.save(file)
    assert "def helper" in h5py.File(file)["declaration/law_source"].asstr()[()]
    again = load(file, law=local, compiled=False).extended(42)
    assert equal(again, dropped(local, 42, **options))
    for other, told in (
        ({"law": guide}, "the law is not the one that flew, its code or its numbers are others"),
        ({"law": partial(local, law=Gains(0.2))}, "the law is not the one that flew"),
        ({"law": local, "period": 1.0}, "flight 39 has other numbers now"),
        ({"law": local, "start": {"altitude": Normal(500.0, 21.0)}}, "draw other numbers than those that flew"),
        ({"law": local, "flies": WEAK}, "the equations or numbers of the vehicle are not those that flew"),
        ({"law": local, "sed": 3}, "load has no argument 'sed'; did you mean 'seed'"),
    ):
        with pytest.raises(ValueError, match=told) as error:
            load(file, compiled=False, **other).extended(41)
        assert "\n" not in str(error.value)


def helper(speed):
    return -15.0 - speed


WEAK = type(PROBE)(PROBE.flight, PROBE.p._replace(gravity=3.7), PROBE.vehicle, PROBE.quantities)


def test_what_cannot_be_kept_or_read_is_told(kept, tmp_path):
    with pytest.warns(UserWarning, match=r"twice: a function, which no file keeps; define it as an expression, or"):
        load(kept).with_quantity("twice", lambda known: 2.0 * known["speed"]).save(tmp_path / "study.h5")
    assert [*load(tmp_path / "study.h5").derived] == ["miss"]
    image = bytearray(kept.read_bytes())
    with h5py.File(kept) as file:
        place = file["final/speed"].id.get_chunk_info(0).byte_offset
    image[place + 40] ^= 1
    for content, told in (
        (bytes(image), "is damaged, or no file of `Flights.save`"),
        (kept.read_bytes()[:3000], "is damaged, or no file"),
        (b"velocity,bank\n", "is damaged, or no file"),
    ):
        (tmp_path / "bad.h5").write_bytes(content)
        with pytest.raises(ValueError, match=told):
            load(tmp_path / "bad.h5")
    with h5py.File(tmp_path / "other.h5", "w"):
        pass
    for name, told in (("other.h5", "is no file of `Flights.save`, format"), ("none.h5", "there is no such file")):
        with pytest.raises(ValueError, match=told):
            load(tmp_path / name)
    with pytest.raises(OSError, match=r"none.study.h5: .*No such file"):
        load(kept).save(tmp_path / "none" / "study.h5")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.h5", "other.h5", "study.h5"]


# ---- interruptions ---------------------------------------------------------------------------------------------------


INTERRUPTED = """
import os, signal, sys, threading, time
from multiprocessing import active_children
from marsedl.fly import fly
from flown_models import PROBE, guide
from test_studies import DROP, dropped


def interrupt(workers):
    while len(active_children()) < workers:
        time.sleep(0.05)
    time.sleep(1.0)
    print("workers", *(child.pid for child in active_children()), flush=True)
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
    first = dropped(trials=3, compiled=False)
    processes = int(sys.argv[1])
    for call in (
        lambda: dropped(trials=4000 * 1000 ** (processes > 1), processes=processes, compiled=processes > 1),
        *[lambda: first.extended(4000), lambda: first.until("p50 of speed within 1e-9 m/s", 10**8)] * (processes == 1),
    ):
        threading.Thread(target=interrupt, args=(processes if processes > 1 else 0,)).start()
        try:
            call()
        except KeyboardInterrupt as error:
            print(error, getattr(error, "flights", None), active_children(), sep="|", flush=True)
"""


@pytest.mark.parametrize("processes", [1, 2])
def test_an_interruption_leaves_no_workers_and_what_was_flown_before(tmp_path, processes):
    (tmp_path / "study.py").write_text(INTERRUPTED)
    path = os.pathsep.join(filter(None, (str(HERE), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, tmp_path / "study.py", str(processes)],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=500,
    )
    lines = [line for line in done.stdout.splitlines() if "|" in line]
    assert lines[0].startswith("interrupted: no flight is kept; fly fewer trials"), done.stderr
    assert all(line.endswith("|[]") for line in lines) and "Traceback" not in done.stderr
    told = (line.split() for line in done.stdout.splitlines() if line.startswith("workers"))
    workers = [int(pid) for _, *pids in told for pid in pids]
    assert len(workers) == (2 if processes == 2 else 0)
    for pid in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    if processes == 1:
        assert lines[1].startswith("interrupted: the 3 flights before are kept; extend them again|Flights(3: ")
        assert len(lines) == 3 and "flights before are kept" in lines[2]


# ---- cases beside each other -----------------------------------------------------------------------------------------


def test_differences_of_percentiles_and_shares_are_those_of_the_pairs(whole):
    other, condition = dropped(FAST), "speed < -15.5 and altitude < 1"
    first, second = whole.final["speed"], other.final["speed"]
    row = whole.against(other, "speed", percentile=50).iloc[0]
    assert row["difference"] == np.median(first) - np.median(second)
    assert (row["lower"], row["upper"]) == paired_percentile_interval(first, second, 0.5)
    assert row["deviation"] == whole.against(other, "speed").iloc[0]["deviation"]
    assert np.isnan(whole.against(other, "speed", percentile=99).iloc[0]["lower"]), "an interval takes 1,000"
    row = whole.against(other, [condition], confidence=0.9).iloc[0]
    assert row["difference"] == np.mean(first < -15.5) - np.mean(second < -15.5)
    assert (row["lower"], row["upper"]) == paired_share_interval(first < -15.5, second < -15.5, 0.9)
    for ask, told in (
        ({"names": condition, "percentile": 50}, "is a condition, which has a share and no percentile"),
        ({"names": "speed", "percentile": 100}, "is no percentage"),
        ({"names": "speed + 1"}, "is a number; give a condition"),
    ):
        with pytest.raises(ValueError, match=told):
            whole.against(other, **ask)


@pytest.mark.parametrize(
    ("draw", "mean", "count", "held"),
    [
        (lambda random, size: random.lognormal(0.0, 1.0, size), np.exp(0.5), 5, 0.82),
        (lambda random, size: random.lognormal(0.0, 1.0, size), np.exp(0.5), 30, 0.88),
        (lambda random, size: random.lognormal(0.0, 1.0, size), np.exp(0.5), 200, 0.93),
        (lambda random, size: random.standard_t(3.0, size), 0.0, 30, 0.96),
        (lambda random, size: random.standard_t(2.0, size), 0.0, 200, 0.96),
    ],
)
def test_intervals_of_means_of_heavy_tails_hold_them_as_often_as_is_said(draw, mean, count, held):
    ends = [mean_interval(row, 0.95)[1] for row in draw(np.random.Generator(np.random.Philox(3)), (3000, count))]
    assert abs(np.mean([low <= mean <= high for low, high in ends]) - held) < 0.02


def test_a_sweep_is_one_table_of_pairs(whole):
    condition = "speed < -15.5"
    cases = {0.1: {}, 0.3: {"law": FAST}, "weak": {"flies": WEAK}}
    table = sweep(cases, PROBE, names=["speed", condition], percentiles=[50], law=guide, trials=300, **DROP)
    assert table["case"].tolist() == [0.1] * 3 + [0.3] * 3 + ["weak"] * 3
    assert table["statistic"].tolist() == ["mean", "p50", "share"] * 3
    assert table["unit"].tolist() == ["m/s", "m/s", ""] * 3 and (table["flights"] == 300).all()
    rows = table.set_index(["case", "statistic"])
    assert np.isnan(rows.loc[0.1, ["difference", "difference_lower", "difference_upper"]].astype(float)).all(axis=None)
    fast = dropped(FAST)
    ends = stats.ttest_1samp(fast.final["speed"], 0.0).confidence_interval(0.95)
    np.testing.assert_allclose(rows.loc[(0.3, "mean"), ["lower", "upper"]].astype(float), ends, rtol=1e-9)
    for statistic, ask in {"mean": {"names": "speed"}, "p50": {"names": "speed", "percentile": 50}}.items():
        paired = fast.against(whole, **ask).iloc[0][["difference", "lower", "upper"]].tolist()
        columns = ["difference", "difference_lower", "difference_upper"]
        assert rows.loc[(0.3, statistic), columns].tolist() == paired
    weak = fly(WEAK, law=guide, trials=300, **DROP).probability(condition)
    assert rows.loc[("weak", "share"), "value"] == weak["value"]
    same = compare({0.1: whole, 0.3: fast}, ["speed", condition], 50)
    pd.testing.assert_frame_equal(same, table.iloc[:6], check_dtype=False)


@pytest.mark.parametrize(
    ("cases", "told"),
    [
        ({}, "cases: give a mapping"),
        ({"a": guide}, "case 'a': give a mapping from arguments of fly"),
        ({"a": {"seed": 3}}, "case 'a' has seed of its own: give them once"),
        ({"a": {"law": 1.0, "period": -1.0}}, "case 'a': period is -1.0 s; it must be positive"),
    ],
)
def test_a_case_that_cannot_be_flown_is_named(cases, told):
    with pytest.raises(ValueError, match=told):
        sweep(cases, PROBE, names="speed", **DROP)


def test_what_is_no_pair_is_not_compared(whole):
    with pytest.raises(ValueError, match="compare takes a mapping from names to Flights"):
        compare([whole], "speed")
    with pytest.raises(ValueError, match="these are 200 flights of seed 5, the others 300"):
        compare({"a": whole, "b": dropped(trials=200)}, "speed")
