"""The proof itself: that two builds are compared in full, and that tampered numbers are found."""

import json
import subprocess
from dataclasses import dataclass

import numpy as np
import pytest

from marsedl import cli
from marsedl.replication import artifacts, verification
from marsedl.replication.claims import UNEXPLAINED
from marsedl.replication.errors import MarsedlError
from marsedl.replication.verification import COUNT_TOLERANCE, RELATIVE_TOLERANCE, SMALLEST_SCALE, margin

SLUG = "powered_descent"


@dataclass(frozen=True)
class Thing:
    """A test artifact."""

    mass: np.ndarray = artifacts.quantity("kg", ("time",), "mass")
    iterations: int = artifacts.quantity("1", (), "iterations")
    name: str = artifacts.quantity("1", (), "a name, which is no number")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project of one paper with one artifact, one claim, and the reference made from them."""
    (tmp_path / "configs").mkdir()
    (tmp_path / "Snakefile").touch()
    store(tmp_path)
    claim(tmp_path, 1349.4)
    verification.write_reference(tmp_path, [SLUG])
    monkeypatch.setattr("marsedl.papers.SLUGS", (SLUG,))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def store(root, scale=1.0, iterations=100):
    thing = Thing(scale * np.linspace(1500.0, 1349.4, 50), iterations, "x")
    path = root / "data" / "cache" / SLUG / "corrected" / "nominal.h5"
    artifacts.save(path, thing, paper=SLUG, reading="corrected", provenance={})
    digests = root / "report" / "digests.json"
    digests.parent.mkdir(exist_ok=True)
    digests.write_text(json.dumps({path.relative_to(root).as_posix(): "0"}), encoding="utf-8")


def claim(root, value, reason="E10: not reproducible"):
    path = root / "report" / "claims" / f"{SLUG}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    readings = {"corrected": {"value": value, "verdict": "differs"}, "printed": {"value": None, "verdict": None}}
    row = {"paper": SLUG, "id": "final_mass", "reason": reason, "readings": readings}
    path.write_text(json.dumps([row]), encoding="utf-8")


def reduced(*values, kind=float):
    return verification._reduced(np.array(values, dtype=kind))


# ------------------------------------------------------------------------------------------------------------- margins


def test_equal_numbers_have_no_margin():
    assert margin("a", reduced(1.0, 2.0), reduced(1.0, 2.0)) == 0.0


def test_a_margin_is_in_units_of_the_tolerance_of_the_fields_size():
    size = np.sqrt((1000.0**2 + 2000.0**2) / 2)
    off = reduced(1000.0, 2000.0 + 3 * RELATIVE_TOLERANCE * size)
    assert margin("a", reduced(1000.0, 2000.0), off) == pytest.approx(3.0, rel=1e-3)


def test_small_fields_are_compared_as_if_larger():
    assert margin("a", reduced(0.0, 0.0), reduced(0.0, 0.5 * SMALLEST_SCALE * RELATIVE_TOLERANCE)) == pytest.approx(0.5)
    assert margin("a", reduced(0.0, 0.0), reduced(0.0, 1.0)) > 1


def test_counts_may_jump_a_little():
    assert margin("a", reduced(100, kind=int), reduced(101, kind=int)) < 1
    assert margin("a", reduced(100, kind=int), reduced(round(100 * (1 + COUNT_TOLERANCE)) + 3, kind=int)) > 1


def test_permutations_shapes_and_lost_numbers_are_seen():
    assert margin("a", reduced(1.0, 2.0, 3.0), reduced(3.0, 2.0, 1.0)) > 1
    assert margin("a", reduced(1.0, 2.0), reduced(1.0, 2.0, 3.0)) == np.inf
    assert margin("a", reduced(1.0, 2.0), reduced(np.nan, np.nan)) == np.inf
    assert margin("a", reduced(np.nan, np.nan), reduced(np.nan, np.nan)) == 0.0


# ----------------------------------------------------------------------------------------------------------- reference


def test_artifacts_that_are_not_of_this_build_are_left_out(project):
    stale = project / "data" / "cache" / SLUG / "mine" / "nominal.h5"
    thing = Thing(np.ones(3), 1, "x")
    artifacts.save(stale, thing, paper=SLUG, reading="mine", provenance={})
    (written,) = verification.write_reference(project, [SLUG])
    assert not [name for name in json.loads(written.read_text(encoding="utf-8")) if name.startswith("mine")]


def test_fingerprints_hold_every_number_and_no_text(project):
    found = verification.fingerprints(project, SLUG, project.glob("data/cache/*/*/*.h5"))
    assert set(found) == {
        "claims/final_mass/corrected",
        "corrected/nominal/mass",
        "corrected/nominal/iterations",
    }
    assert found["corrected/nominal/mass"]["shape"] == [50]
    assert found["corrected/nominal/iterations"]["counts"]
    assert not found["corrected/nominal/mass"]["counts"]
    assert found["corrected/nominal/mass"]["numbers"][3:] == [1349.4, 1500.0]  # smallest and largest


def test_an_unchanged_build_agrees_with_its_reference(project, capsys):
    assert cli.main(["verify", "--no-rebuild"]) == 0
    assert "3 numbers compared" in (said := capsys.readouterr().out)
    assert "worst margin 0 tolerances" in said


def test_rounding_is_tolerated_and_more_is_not(project, capsys):
    store(project, scale=1 + 1e-9)
    assert cli.main(["verify", "--no-rebuild"]) == 0
    store(project, scale=1 + 1e-5)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    said = capsys.readouterr().out
    assert "corrected/nominal/mass is off by" in said
    assert "1 beyond tolerance" in said


def test_a_tampered_reference_fails(project, capsys):
    path = project / "data" / "reference" / f"{SLUG}.json"
    reference = json.loads(path.read_text(encoding="utf-8"))
    reference["claims/final_mass/corrected"]["numbers"] = [1350.4] * 5
    path.write_text(json.dumps(reference), encoding="utf-8")
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "claims/final_mass/corrected is off by" in capsys.readouterr().out


def test_a_lost_artifact_fails(project, capsys):
    (project / "data" / "cache" / SLUG / "corrected" / "nominal.h5").unlink()
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "not built: corrected/nominal/mass" in capsys.readouterr().out


def test_a_build_without_any_of_the_numbers_fails(project, capsys):
    (project / "data" / "cache" / SLUG / "corrected" / "nominal.h5").unlink()
    claim(project, None)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "0 numbers compared" in capsys.readouterr().out


def test_an_unexplained_verdict_fails(project, capsys):
    claim(project, 1349.4, reason=UNEXPLAINED)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "claim final_mass differs or fails without a reason" in capsys.readouterr().out


def test_missing_builds_and_references_are_refused(project, capsys):
    (project / "data" / "reference" / f"{SLUG}.json").unlink()
    assert cli.main(["verify", "--no-rebuild"]) == 2
    assert "is missing; restore it, or make it with 'marsedl verify --write-reference'" in capsys.readouterr().err
    (project / "report" / "claims" / f"{SLUG}.json").unlink()
    assert cli.main(["verify", "--write-reference"]) == 2
    assert "run 'snakemake all'" in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------------------- two builds


def builder(monkeypatch, contents, code=0):
    """Replace Snakemake by something that writes one table; `contents` by build."""
    calls = []

    def fake(folder, *arguments, **environment):
        calls.append((folder, arguments, environment))  # in any order: the builds run at the same time
        table = folder / "figures" / SLUG / "eq54.csv"
        table.parent.mkdir(parents=True)
        table.write_text(contents[int(folder.name)], encoding="utf-8")
        return subprocess.CompletedProcess(arguments, code, "what Snakemake said", "")

    monkeypatch.setattr(verification, "snakemake", fake)
    return calls


def test_equal_builds_agree(project, monkeypatch, capsys):
    calls = builder(monkeypatch, ["1\n", "1\n"])
    assert verification.build_twice(project)
    assert "1 products in each of two builds, 0 differ" in capsys.readouterr().out
    (one, first, here), (two, second, there) = calls
    assert one != two
    assert first[first.index("--cores") + 1] != second[second.index("--cores") + 1]
    assert first[-1] != second[-1]
    assert here["PYTHONHASHSEED"] != there["PYTHONHASHSEED"]


def test_different_builds_are_named(project, monkeypatch, capsys):
    builder(monkeypatch, ["1\n", "2\n"])
    assert not verification.build_twice(project)
    said = capsys.readouterr().out
    assert f"differs: figures/{SLUG}/eq54.csv" in said
    assert "1 differ" in said


def test_a_failed_build_shows_what_snakemake_said(project, monkeypatch):
    builder(monkeypatch, ["1\n", "1\n"], code=1)
    with pytest.raises(MarsedlError, match="what Snakemake said"):
        verification.build_twice(project)


def test_a_copy_of_the_tree_holds_no_products(project, tmp_path):
    (project / "data" / "published").mkdir()
    (project / "data" / "published" / "x.yaml").touch()
    copied = verification.copy_tree(project, tmp_path / "copy")
    names = {path.relative_to(copied).as_posix() for path in copied.rglob("*") if path.is_file()}
    assert names == {"Snakefile", "data/published/x.yaml", f"data/reference/{SLUG}.json"}


def test_numbers_whose_squares_overflow_are_reduced_too():
    assert reduced(3e200, -4e200)["numbers"][0] == pytest.approx(np.sqrt(12.5) * 1e200, rel=1e-15)
    assert reduced(0.0, 0.0)["numbers"] == [0.0] * 5


def test_what_rounding_decides_is_compared_by_shape(project, capsys):
    store(project, scale=1.1)
    assert not verification.compare_reference(project, [SLUG])
    assert verification.compare_reference(project, [SLUG], {SLUG: ("corrected/nominal/ma*",)})
    assert "1 that rounding decides compared by shape" in capsys.readouterr().out
    assert not verification.compare_reference(project, [SLUG], {SLUG: ("corrected/nominal/iterations",)})
    path = project / "data" / "cache" / SLUG / "corrected" / "nominal.h5"
    shorter = Thing(np.linspace(1500.0, 1349.4, 49), 100, "x")
    artifacts.save(path, shorter, paper=SLUG, reading="corrected", provenance={})
    assert not verification.compare_reference(project, [SLUG], {SLUG: ("corrected/nominal/mass",)})
