"""What a build holds, as data frames and datasets: from a small build that is made up here."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from marsedl import results
from marsedl.papers import input_model
from marsedl.papers.powered_descent.records import FlightEnsemble, Gains
from marsedl.replication.claims.claim import Claim, Result
from marsedl.replication.claims.rows import write_claims
from marsedl.replication.errors import ArtifactError, InputError
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.records import fields, store
from marsedl.replication.universes.designs import Universe
from marsedl.replication.universes.table import Outcome, Row, table_of

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "results.md"
SIZES = {"trials": 500, "time": 3, "kept": 2, "bins": 4, "edges": 3, "segments": 2}
COVARIANCE = np.diag([4.0, 1.0, 0.09, 0.04, 2.0]) + 0.01


def made_up(kind, **given):
    """A record of ones, but for the fields that are given."""
    values = {}
    for name, declared in fields.quantities(kind).items():
        shape = tuple(SIZES[extent] if isinstance(extent, str) else extent for extent in declared.dims)
        values[name] = given.get(name, np.ones(shape, "int64" if declared.dtype.startswith("int") else declared.dtype))
    return kind(**values)


def flights():
    random = np.random.default_rng(3)
    final = random.multivariate_normal([100.0, 50.0, 0.0, 0.0, 1349.0], COVARIANCE, SIZES["trials"])
    mean, covariance = final.mean(axis=0), np.cov(final.T)
    return made_up(
        FlightEnsemble,
        time=np.array([0.0, 20.5, 41.0]),
        final_state=final,
        mean=np.tile(mean, (3, 1)),
        covariance=np.tile(covariance, (3, 1, 1)),
        outcome=np.zeros(SIZES["trials"], "int8"),
    )


def claim(name, printed, readings, kind="monte_carlo"):
    results = {
        reading: Result(value=value, standard_error=error, trials=trials, verdict="close")
        for reading, (value, error, trials) in readings.items()
    }
    judged = {"verdict": "close", "reading": "corrected", "size": "full", "unit": "-"}
    return Claim(paper="powered_descent", id=name, kind=kind, printed=printed, readings=results, **judged)


CLAIMS = [
    claim(
        "mc_final_mean",
        [100.1, 49.8],
        {"corrected": ([100.0, 50.0], [0.01, 0.02], 2000), "printed": ([100.2, None], [0.05, None], 500)},
    ),
    claim("hover", True, {"corrected": (True, None, None), "printed": (None, None, None)}, "qualitative"),
    claim("matrix", [[1, 2], [3, 4]], {"corrected": (None, None, None)}, "input"),
]


@pytest.fixture
def build(tmp_path):
    """A folder with two readings, one of which shares its gains with a third."""
    cache = tmp_path / "data" / "cache" / "powered_descent"
    for reading, level in (("corrected", 1.0), ("target4", 2.0), ("mine", 3.0)):
        mean = np.full((3, 4), level)
        record = made_up(Gains, time=np.array([0.0, 20.5, 41.0]), mean=mean)
        path = cache / reading / "gains.h5"
        store.save(path, record, paper="powered_descent", reading=reading, provenance={})
    path = cache / "corrected" / "montecarlo.closed_loop.h5"
    store.save(path, flights(), paper="powered_descent", reading="corrected", provenance={})
    for folder, first in (("figures", 1e-9), ("other/figures", 2e-9)):
        for place in ("powered_descent", "powered_descent/printed"):
            tables = tmp_path / folder / place
            tables.mkdir(parents=True, exist_ok=True)
            (tables / "certificates.csv").write_text(f"segment,error,iterations,status\n1,{first},12,ok\n2,,,ok\n")
    (tmp_path / "figures" / "powered_descent" / "eq54.csv").write_text("value\n1.0\n2\n")
    (tmp_path / "figures" / "comparison").mkdir()
    (tmp_path / "figures" / "comparison" / "densities.csv").write_text("paper,cost\na,1\n")
    write_claims(CLAIMS, tmp_path / "report" / "claims.json")
    return tmp_path


def test_whole_numbers_of_a_table_stay_whole_where_some_are_missing(build):
    frame = results.table("powered_descent", "certificates", reading="printed", build=build)
    types = {"segment": "int64", "error": "float64", "iterations": "Int64"}
    assert frame.dtypes.astype(str).drop("status").to_dict() == types
    assert frame["iterations"][1] is pd.NA
    assert results.table("powered_descent", "eq54", build=build)["value"].dtype == float
    assert results.table("comparison", "densities", build=build)["cost"].to_list() == [1]


def test_an_artifact_has_named_dimensions_units_and_meaning(build):
    gains = results.artifact("powered_descent", "gains", build=build)
    assert gains["covariance"].dims == ("time", "motion", "motion_2")
    assert gains["mean"].sel(motion="altitude", time=41.0) == 1.0
    assert gains["mean"].attrs["meaning"] == "mean state"
    assert gains["motion_unit"].sel(motion="vertical_velocity") == "m/s"


def test_a_shared_artifact_is_read_from_its_owner(build):
    (build / "configs").mkdir()
    written = (ROOT / "configs" / "powered_descent.yaml").read_text("utf-8")
    scheme = "{integrator: {value: euler_maruyama, source: 'assumed: test'}}"
    euler = f"readings:\n  euler: {{summary: By Euler., based_on: target4, simulation: {scheme}}}\n"
    (build / "configs" / "powered_descent.yaml").write_text(written.replace("readings:\n", euler, 1), "utf-8")
    gains = results.artifact("powered_descent", "gains", reading="euler", build=build)
    assert gains.attrs["reading"] == "target4"
    assert (gains["mean"] == 2.0).all()


def test_an_ensemble_is_read_when_it_is_used(build):
    with results.ensemble("powered_descent", "closed_loop", build=build) as trials:
        assert not trials["final_state"].variable._in_memory
        assert trials["final_state"].sel(state="mass").mean() == pytest.approx(1349.0, abs=0.5)
    same = results.artifact("powered_descent", "montecarlo", case="closed_loop", build=build)
    assert same["final_state"].variable._in_memory


def test_verdicts_have_a_row_for_every_claim_with_its_margin_and_counterexample(build):
    path = build / "report" / "claims.json"
    rows = json.loads(path.read_text("utf-8"))
    rows[0]["reading"], rows[0]["errata"] = "corrected", ["E1", "E2"]
    rows[0]["readings"]["corrected"]["margin"] = dict(
        measure="difference", value=1.0, limit=2.0, unit="m", distance=0.5, **{"in": "standard errors"}
    )
    rows[0]["counterexample"] = {"change": "scaled", "of": "gains.mean", "amount": 1.1, "to": "differs"}
    path.write_text(json.dumps(rows), encoding="utf-8")
    frame = results.verdicts(build).set_index("claim")
    assert frame.index.to_list() == ["mc_final_mean", "hover", "matrix"]
    first = frame.loc["mc_final_mean"]
    assert first[["distance", "distance_in", "of", "amount"]].to_list() == [0.5, "standard errors", "gains.mean", 1.1]
    assert first[["verdict", "reading", "errata"]].to_list() == [rows[0]["verdict"], "corrected", ["E1", "E2"]]
    assert frame.loc["hover", ["measure", "distance", "change", "to"]].isna().all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda b: results.table("powered", "eq54", build=b), "no paper 'powered'; did you mean 'powered_descent'"),
        (lambda b: results.table("powered_descent", "eq5", build=b), "did you mean 'eq54'.*certificates, eq54"),
        (lambda b: results.table("powered_descent", "eq54", "plus_sign", b), "plus_sign holds no tables; run 'snakem"),
        (lambda b: results.artifact("powered_descent", "gain", build=b), "no artifact 'gain'; did you mean 'gains'"),
        (lambda b: results.artifact("powered_descent", "montecarlo", build=b), "There are: .*montecarlo.closed_loop"),
        (lambda b: results.ensemble("powered_descent", "closed", build=b), "did you mean 'montecarlo.closed_loop'"),
        (lambda b: results.artifact("powered_descent", "nominal", build=b), "not built; run .*Built beside it: gains"),
        (lambda b: results.artifact("powered_descent", "gains", "print", build=b), "did you mean 'printed'"),
        (lambda b: results.inputs("powered_descent", "print", b), "no reading 'print'; did you mean 'printed'"),
        (lambda b: results.claims(b / "nowhere"), "nowhere: there is no such folder"),
    ],
)
def test_errors_name_what_exists(build, call, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        call(build)


def test_a_damaged_or_older_artifact_is_refused(build, monkeypatch):
    path = build / "data" / "cache" / "powered_descent" / "corrected" / "gains.h5"
    monkeypatch.setattr("marsedl.results.artifacts.FORMAT", 3)
    with pytest.raises(ArtifactError, match="written by another version"):
        results.artifact("powered_descent", "gains", build=build)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ArtifactError, match=r"gains\.h5"):
        results.artifact("powered_descent", "gains", build=build)


def test_a_build_of_another_size_takes_the_projects_configuration(build, tmp_path_factory):
    project = tmp_path_factory.mktemp("project")
    (project / "configs").symlink_to(ROOT / "configs")
    (project / "data").symlink_to(ROOT / "data")
    (project / "build").mkdir()
    (project / "build" / "smoke").symlink_to(build)
    small, full = (
        results.inputs("powered_descent", build=folder).set_index("name").loc["ensemble.trials", "value"]
        for folder in (project / "build" / "smoke", project)
    )
    assert small < full
    gains = results.artifact("powered_descent", "gains", build=project / "build" / "smoke")
    assert (gains["mean"] == 1.0).all()


def test_the_examples_of_the_page_run(build, monkeypatch):
    """A claim over readings, a scatter with its ellipse, a table with that of another build."""
    import matplotlib.pyplot as plt

    monkeypatch.chdir(build)
    monkeypatch.setenv("MPLBACKEND", "agg")
    blocks = re.findall(r"(?ms)^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"))
    names = {}
    for block in blocks:
        exec(block, names)
    plt.close("all")
    distance = names["mean"].set_index(["reading", "component"])["distance"]
    assert distance["corrected", "[2]"] == pytest.approx(10.0)
    assert (build / "final_velocity.png").stat().st_size > 10_000
    inside = names["final"] - names["centre"]
    inside = np.einsum("ti,ij,tj->t", inside, np.linalg.inv(names["covariance"]), inside)
    assert np.mean(inside < 9.0) == pytest.approx(1.0 - np.exp(-4.5), abs=0.02)
    around = np.einsum("it,ij,jt->t", names["ellipse"], np.linalg.inv(names["covariance"]), names["ellipse"])
    np.testing.assert_allclose(around, 9.0)
    assert names["both"][["error here", "error there"]].iloc[0].to_list() == [1e-9, 2e-9]


def with_universes(folder, count):
    """Write a table with a number, a row of two and a statement in some universes; the row fails in the second."""
    choices = load_study("powered_descent", input_model("powered_descent"), ROOT).choices
    rows = []
    for number in range(count):
        one = {"prior_final_mass": Outcome("result", {"": (1346.0 + number, 0.0, 1346.0)})}
        one["q_invertible_all_t"] = Outcome("result", {"test 1": (0.003, 0.0, 0.0)}, "holds", "test 1")
        if number == 1:
            one["prior_final_mass"] = Outcome("refused", sentence="no mass is left")
        rows.append(Row(Universe(number, "one_at_a_time", {}), one))
    folder.mkdir(parents=True)
    table = table_of(SimpleNamespace(study=SimpleNamespace(choices=choices)), rows)
    store.save(folder / "powered_descent.h5", table, paper="powered_descent", reading="all", provenance={})


@pytest.fixture
def universes(build, monkeypatch):
    """A build with two universes, and a committed run of three."""
    with_universes(build / "report" / "universes", 2)
    with_universes(build / "committed", 3)
    monkeypatch.setattr("marsedl.replication.universes.judging.COMMITTED", build / "committed")
    return build


def test_universes_are_those_of_the_build_or_of_the_committed_run_and_say_so(universes):
    own = results.universes("powered_descent", build=universes)
    large = results.universes("powered_descent", build=universes, committed=True)
    assert (own.attrs["run"], own.attrs["universes"], own["universe"].nunique()) == ("build", 2, 2)
    assert (large.attrs["run"], large.attrs["universes"], large["universe"].nunique()) == ("committed", 3, 3)
    assert Path(own.attrs["file"]).parts[-3:] == ("report", "universes", "powered_descent.h5")
    assert {"noise_unit", "decides", "claim_verdict"} <= {*own.columns}
    mass = large.query("claim == 'prior_final_mass'").set_index("universe")
    assert mass["verdict"].to_list() == ["reproduced", "none", "differs"]
    assert mass["cause"].to_list() == ["result", "refused", "result"]
    assert large.query("claim == 'q_invertible_all_t'")["component"].unique().tolist() == ["q_invertible_all_t test 1"]
    with pytest.raises(InputError, match="no committed run of funnels; there is one of: powered_descent"):
        results.universes("funnels", build=universes, committed=True)
    with pytest.raises(ArtifactError, match=r"funnels\.h5"):
        results.universes("funnels", build=universes)


@pytest.mark.parametrize("page", ["formats", "using", "universes"])
def test_the_examples_of_other_pages_run_in_a_build(universes, page, monkeypatch):
    build = universes
    monkeypatch.chdir(build)
    (example,) = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / "docs" / f"{page}.md").read_text("utf-8"), re.DOTALL | re.MULTILINE
    )
    names = {}
    exec(compile(example, page, "exec"), names)
    if page == "using":
        assert names["altitude"].values.tolist() == [1.0, 1.0, 1.0]
    if page == "universes":
        assert names["large"].attrs["run"] == "committed"
