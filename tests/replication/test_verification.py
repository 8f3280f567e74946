"""The proof itself: that two builds are compared in full, and that tampered numbers are found."""

import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl import cli
from marsedl.replication import artifacts, verification
from marsedl.replication.claims import UNEXPLAINED, load_published
from marsedl.replication.errors import MarsedlError
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import (
    BUILDS,
    COUNT_TOLERANCE,
    RELATIVE_TOLERANCE,
    SMALLEST_SCALE,
    Change,
    compare,
    format_changes,
    margin,
)

ROOT = Path(__file__).parents[2]
SLUG = "powered_descent"
ARTIFACT = f"data/cache/{SLUG}/corrected/nominal.h5"


class Owned:
    """Stands for `Shared`: every reading owns its file, but for `copy`, whose nominal is that of `corrected`."""

    readings = ("corrected",)

    def has(self, reading, name):
        return name == "nominal"

    def file(self, reading, name):
        return f"data/cache/{SLUG}/{'corrected' if reading == 'copy' else reading}/{name}.h5"

    def claimed(self, reading):
        return {"nominal": self.file(reading, "nominal")}


PAPERS = {SLUG: Owned()}


@dataclass(frozen=True)
class Thing:
    """A test artifact."""

    mass: np.ndarray = artifacts.quantity("kg", ("time",), "mass")
    iterations: int = artifacts.quantity("1", (), "iterations")
    name: str = artifacts.quantity("1", (), "a name, which is not a number")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project of one paper with one artifact, one claim, and the reference made from them."""
    (tmp_path / "configs").mkdir()
    (tmp_path / "Snakefile").touch()
    store(tmp_path)
    claim(tmp_path, 1349.4)
    summarised(monkeypatch)
    verification.accept_reference(tmp_path, PAPERS)
    monkeypatch.setattr("marsedl.papers.SLUGS", (SLUG,))
    monkeypatch.setattr(cli, "_project", lambda: SimpleNamespace(studies={}, quotes=lambda slug: None))
    monkeypatch.setattr("marsedl.replication.quotes.accept", lambda root, papers: "what texts quote")
    monkeypatch.setattr(cli, "_shared", lambda: PAPERS)
    monkeypatch.setattr(cli, "_write_readme", lambda root: None)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def store(root, scale=1.0, iterations=100):
    thing = Thing(scale * np.linspace(1500.0, 1349.4, 50), iterations, "x")
    artifacts.save(root / ARTIFACT, thing, paper=SLUG, reading="corrected", provenance={})


def claim(root, value, reason="E10: not reproducible", verdict="differs", printed=None, names=("final_mass",)):
    path = root / "report" / "claims" / f"{SLUG}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    results = {"corrected": (value, verdict), "printed": (None, printed)}
    readings = {
        reading: {"value": value, "standard_error": None, "verdict": verdict, "evidence": ""}
        for reading, (value, verdict) in results.items()
    }
    row = {"where": "x", "quantity": "x", "printed": 1346, "unit": "kg", "kind": "deterministic", "resolution": 1}
    row |= {
        "trials": None,
        "paper": SLUG,
        "verdict": verdict or "fails",
        "reading": "corrected",
        "reason": reason,
        "readings": readings,
    }
    rows = [{**row, "id": name} for name in names]
    path.write_text(json.dumps(rows), encoding="utf-8")


def summarised(monkeypatch, plan="no update", status="ok", code=0):
    """Replace Snakemake by something that knows one artifact, its chunks and one file of claims."""
    rows = [("output_file", "date", "rule", "log-file(s)", "status", "plan")]
    rows += [(ARTIFACT, "now", "nominal", "-", status, plan)]
    rows += [(f"data/cache/{SLUG}/corrected/chunks/x.0of2.h5", "-", "chunk", "-", "removed temp file", "no update")]
    rows += [(f"report/claims/{SLUG}.json", "now", "claims", "-", "ok", "no update")]
    output = "Building DAG of jobs...\n" + "".join("\t".join(row) + "\n" for row in rows)
    calls = []

    def fake(folder, *arguments, **environment):
        calls.append(arguments)
        return subprocess.CompletedProcess(arguments, code, output, "")

    monkeypatch.setattr(verification, "snakemake", fake)
    return calls


def reference(root) -> dict:
    return json.loads((root / "data" / "reference" / f"{SLUG}.json").read_text(encoding="utf-8"))


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


def test_fingerprints_hold_every_number_every_verdict_and_no_text(project):
    entries = verification.fingerprints(project, SLUG, {"corrected/nominal": project / ARTIFACT})
    assert set(entries) == {
        "verdicts/final_mass",
        "published/final_mass",
        "claims/final_mass/corrected",
        "corrected/nominal/mass",
        "corrected/nominal/iterations",
    }
    assert entries["published/final_mass"] == "1346 kg, deterministic, last digit 1"
    assert entries["verdicts/final_mass"] == {"corrected": "differs"}, "the other reading does not evaluate it"
    assert entries["corrected/nominal/mass"]["shape"] == [50]
    assert entries["corrected/nominal/iterations"]["counts"]
    assert not entries["corrected/nominal/mass"]["counts"]
    assert entries["corrected/nominal/mass"]["numbers"][3:] == [1349.4, 1500.0]  # smallest and largest


def test_an_unchanged_build_agrees_with_its_reference(project, capsys):
    assert cli.main(["verify", "--no-rebuild"]) == 0
    assert "3 numbers compared with powered_descent.json, 0 verdicts changed" in (output := capsys.readouterr().out)
    assert "worst margin 0 tolerances" in output
    assert "marsedl accept" not in output


def test_rounding_is_tolerated_and_more_is_not(project, capsys):
    store(project, scale=1 + 1e-9)
    assert cli.main(["verify", "--no-rebuild"]) == 0
    store(project, scale=1 + 1e-5)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = capsys.readouterr().out
    assert "1 numbers beyond tolerance" in output
    (row,) = [
        line.split("  ") for line in output.splitlines() if "corrected/nominal/mass" in line and "largest" in line
    ]
    cells = [cell.strip() for cell in row if cell.strip()]
    assert cells[:3] == ["corrected/nominal/mass", "shape [50], largest 1500", "shape [50], largest 1500.015"]
    assert float(cells[3]) == pytest.approx(10.5, abs=0.1)
    assert "accept them with 'marsedl accept'" in output


def test_a_changed_verdict_fails_and_stands_first(project, capsys):
    """Though its number is within tolerance: that of a statement is true or false."""
    store(project, scale=1.1)
    claim(project, 1349.4, verdict="close", printed="fails")
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = capsys.readouterr().out
    assert "2 verdicts changed, 1 numbers beyond tolerance" in output
    header, first, second, third = output.splitlines()[1:5]
    assert header.split() == ["claim", "or", "field", "old", "new", "margin", "in", "tolerances"]
    assert first.split() == ["verdict", "of", "final_mass,", "corrected", "differs", "close", "0"]
    assert second.split() == ["verdict", "of", "final_mass,", "printed", "–", "fails", "inf"]
    assert third.split()[0] == "corrected/nominal/mass"


def test_claims_that_are_new_or_gone_fail(project, capsys):
    claim(project, 1349.4, names=("final_mass", "fuel"))
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = capsys.readouterr().out.splitlines()
    assert ["verdict", "of", "fuel", "–", "differs", "inf"] in [line.split() for line in output]
    claim(project, 1349.4, names=("fuel",))
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["verdict", "of", "final_mass", "differs", "–", "inf"] in output
    assert ["claims/final_mass/corrected", "1349.4", "–", "inf"] in output


def test_a_tampered_reference_fails(project, capsys):
    path = project / "data" / "reference" / f"{SLUG}.json"
    tampered = reference(project)
    tampered["claims/final_mass/corrected"]["numbers"] = [1350.4] * 5
    path.write_text(json.dumps(tampered), encoding="utf-8")
    assert cli.main(["verify", "--no-rebuild"]) == 1
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["claims/final_mass/corrected", "1350.4", "1349.4", "741"] in rows


@pytest.mark.parametrize(
    ("change", "now"),
    [
        ({"printed": 1347}, "1347 kg, deterministic, last digit 1"),
        ({"unit": "t"}, "1346 t, deterministic, last digit 1"),
        ({"resolution": 10}, "1346 kg, deterministic, last digit 10"),
        ({"kind": "monte_carlo", "trials": 50}, "1346 kg, monte_carlo, last digit 1, 50 trials"),
    ],
)
def test_what_the_paper_prints_cannot_change_unseen(project, capsys, change, now):
    """Though no verdict and no number moves."""
    path = project / "report" / "claims" / f"{SLUG}.json"
    (row,) = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps([{**row, **change}]), encoding="utf-8")
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = capsys.readouterr().out
    assert "0 verdicts changed, 0 numbers beyond tolerance, 0 missing" in output
    assert "1 printed claims differ from those accepted" in output
    row = [cell for cell in output.splitlines()[2].split("  ") if cell]
    assert row == ["the paper's final_mass", "1346 kg, deterministic, last digit 1", now, "inf"]
    assert cli.main(["accept"]) == 0
    assert cli.main(["verify", "--no-rebuild"]) == 0


@pytest.mark.parametrize("path", sorted((ROOT / "data" / "reference").glob("*.json")), ids=lambda path: path.stem)
def test_the_printed_claims_are_those_that_were_accepted(path):
    """Without a build: a slip in `data/published` fails here; 'marsedl accept' takes a correction."""
    published = ROOT / "data" / "published" / f"{path.stem}.yaml"
    if published.exists():
        accepted = verification.read_reference(ROOT, path.stem)
        printed = {f"published/{claim.id}": verification._printed(vars(claim)) for claim in load_published(published)}
        assert {name: entry for name, entry in accepted.items() if name.startswith("published/")} == printed


def test_a_lost_artifact_fails(project, capsys):
    (project / ARTIFACT).unlink()
    assert cli.main(["verify", "--no-rebuild"]) == 1
    output = capsys.readouterr().out
    assert "2 missing" in output
    assert "corrected/nominal/iterations  100" in output


def test_a_build_without_any_of_the_numbers_fails(project, capsys):
    (project / ARTIFACT).unlink()
    claim(project, None, verdict=None)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "0 numbers compared" in capsys.readouterr().out


def test_an_unexplained_verdict_fails(project, capsys):
    claim(project, 1349.4, reason=UNEXPLAINED)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    assert "claim final_mass differs or fails without a reason" in capsys.readouterr().out


def test_missing_builds_and_references_are_refused(project, capsys):
    (project / "data" / "reference" / f"{SLUG}.json").unlink()
    assert cli.main(["verify", "--no-rebuild"]) == 2
    assert "is missing; restore it, or write it with 'marsedl accept' after a full build" in capsys.readouterr().err
    (project / "report" / "claims" / f"{SLUG}.json").unlink()
    assert cli.main(["accept"]) == 2
    assert "run 'snakemake all'" in capsys.readouterr().err


def test_readings_that_are_not_built_are_left_out(project):
    both = {"corrected": "differs", "printed": "fails"}
    whole = {**reference(project), "verdicts/final_mass": both, "printed/nominal/mass": reduced(1.0)}
    (project / "data" / "reference" / f"{SLUG}.json").write_text(json.dumps(whole), encoding="utf-8")
    assert not verification.compare_reference(project, PAPERS)
    assert verification.compare_reference(project, PAPERS, readings={SLUG: ["corrected"]})


def test_a_table_shows_all_verdicts_and_as_many_numbers_as_one_looks_at():
    changes = [Change(f"claim_{k}, corrected", "holds", "fails", np.inf, verdict=True) for k in range(60)]
    changes += [Change(f"corrected/nominal/field_{k}", "1", "2", 3.0) for k in range(60)]
    lines = format_changes(changes).splitlines()
    assert sum("verdict of claim_" in line for line in lines) == 60
    assert sum("corrected/nominal/" in line for line in lines) == 40
    assert lines[-1].strip() == "and 20 numbers more"


def test_other_shapes_and_lost_numbers_are_described():
    old = {"corrected/nominal/mass": reduced(1.0, 2.0)}
    (change,) = compare(old, {"corrected/nominal/mass": reduced(1.0, 2.0, 3.0)}).changes
    assert (change.old[:9], change.new[:9], change.margin) == ("shape [2]", "shape [3]", np.inf)
    (change,) = compare(old, {"corrected/nominal/mass": reduced(np.nan, np.nan)}).changes
    assert change.new == "shape [2], no finite number"


# -------------------------------------------------------------------------------------------------------------- accept


def test_accept_shows_the_table_and_then_verify_agrees(project, capsys):
    store(project, scale=1.1)
    claim(project, 1500.0, verdict="close")
    before = reference(project)
    assert cli.main(["verify", "--no-rebuild"]) == 1
    table = [line for line in capsys.readouterr().out.splitlines() if "tolerances" in line or "final_mass" in line]
    assert cli.main(["accept"]) == 0
    output = capsys.readouterr().out
    assert len(table) > 2
    assert all(line in output.splitlines() for line in table)
    assert f"wrote {project / 'data' / 'reference' / f'{SLUG}.json'}" in output
    assert reference(project) != before
    assert cli.main(["verify", "--no-rebuild"]) == 0


def test_numbers_within_tolerance_keep_their_digits(project):
    path = project / "data" / "reference" / f"{SLUG}.json"
    before = path.read_text(encoding="utf-8")
    store(project, scale=1 + 1e-9)
    verification.accept_reference(project, PAPERS)
    assert path.read_text(encoding="utf-8") == before
    store(project, scale=1 + 1e-9, iterations=200)
    verification.accept_reference(project, PAPERS)
    now = path.read_text(encoding="utf-8")
    changes = set(now.splitlines()) ^ set(before.splitlines())
    assert {line.split('"')[1] for line in changes} == {"corrected/nominal/iterations"}


def test_an_artifact_that_readings_share_is_compared_with_the_numbers_of_each(project):
    shared = Owned()
    shared.readings = ("corrected", "copy")
    verification.accept_reference(project, {SLUG: shared})
    assert reference(project)["copy/nominal/mass"] == reference(project)["corrected/nominal/mass"]
    assert verification.compare_reference(project, PAPERS)
    whole = {**reference(project), "copy/nominal/mass": reduced(1.0)}
    (project / "data" / "reference" / f"{SLUG}.json").write_text(json.dumps(whole), encoding="utf-8")
    assert not verification.compare_reference(project, PAPERS)
    assert verification.compare_reference(project, PAPERS, readings={SLUG: ["corrected"]})


def test_artifacts_that_are_not_of_this_build_are_left_out(project):
    thing = Thing(np.ones(3), 1, "x")
    artifacts.save(project / f"data/cache/{SLUG}/mine/nominal.h5", thing, paper=SLUG, reading="mine", provenance={})
    verification.accept_reference(project, PAPERS)
    assert not [name for name in reference(project) if name.startswith("mine")]


def test_only_a_build_that_is_up_to_date_is_accepted(project, monkeypatch, capsys):
    before = reference(project)
    store(project, scale=1.1)
    calls = summarised(monkeypatch, plan="update pending", status="params changed")
    assert cli.main(["accept"]) == 2
    output = capsys.readouterr().err
    assert f"the build in {project} is not up to date with configuration and code: 1 of 2 files" in output
    assert f"{project / ARTIFACT} (params changed); run 'snakemake all'" in output
    assert calls == [("claims", "--summary")], "the plain configuration decides, not that of the last build"
    summarised(monkeypatch, code=1)
    assert cli.main(["accept"]) == 2
    assert "the workflow cannot be planned" in capsys.readouterr().err
    assert reference(project) == before


def test_an_unexplained_verdict_is_not_accepted(project, capsys):
    before = reference(project)
    claim(project, 1500.0, reason=UNEXPLAINED)
    assert cli.main(["accept"]) == 2
    output = capsys.readouterr().err
    assert "claim final_mass differs or fails without a reason" in output
    assert "src/marsedl/papers/powered_descent/claims" in output
    assert reference(project) == before


def test_verdicts_can_be_read_alone(project):
    assert verification.committed_verdicts(project, SLUG) == {"final_mass": {"corrected": "differs"}}
    claim(project, 1349.4, verdict="close", printed="fails")
    assert verification.built_verdicts(project, SLUG) == {"final_mass": {"corrected": "close", "printed": "fails"}}
    assert verification.built_verdicts(project, "funnels") == verification.committed_verdicts(project, "funnels") == {}


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "is not JSON"),
        ("[]", "holds no numbers by name"),
        ('{"corrected/nominal/mass": 1.0}', "'corrected/nominal/mass' is not a set of keys with values"),
        ('{"mass": {"shape": []}}', "'mass' is not a name of three parts"),
        ('{"verdicts/mass": {"corrected": 1}}', "'verdicts/mass' holds a verdict that is not text"),
        ('{"a/b/c": {"shape": 3, "counts": false, "numbers": []}}', "has no list of whole numbers under 'shape'"),
        ('{"a/b/c": {"shape": [], "counts": 0, "numbers": []}}', "has neither true nor false under 'counts'"),
        ('{"a/b/c": {"shape": [], "counts": false, "numbers": ["x"]}}', "has no list of numbers under 'numbers'"),
        ('{"a/b/c": {"shape": [], "counts": false, "numbers": [1.0]}}', "has 1 of 5 numbers"),
    ],
)
@pytest.mark.parametrize("command", [("verify", "--no-rebuild"), ("accept",)], ids=" ".join)
def test_damaged_references_are_refused_with_a_remedy(project, capsys, command, content, problem):
    path = project / "data" / "reference" / f"{SLUG}.json"
    path.write_text(content, encoding="utf-8")
    assert cli.main(list(command)) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert captured.err.startswith(f"marsedl: {path}: ")
    assert problem in captured.err
    assert captured.err.endswith(f"; restore it with 'git checkout data/reference/{SLUG}.json'\n")


# ---------------------------------------------------------------------------------------------------------- two builds


def builder(monkeypatch, contents, code=0):
    """Replace Snakemake by something that writes one table; `contents` by build."""
    calls = []

    def fake(folder, *arguments, **environment):
        calls.append((folder, arguments, environment))  # in any order: the builds run at the same time
        table = build_folder(folder, "smoke") / "figures" / SLUG / "eq54.csv"
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
    for varied in ("PYTHONHASHSEED", "TZ", "LC_ALL"):
        assert here[varied] != there[varied], varied
    assert set(here) == set(there) == {"nice", "offline", "PYTHONHASHSEED", "TZ", "LC_ALL"}


def test_it_is_never_the_same_day_in_both_time_zones():
    offsets = [int(re.fullmatch(r"[A-Z]{3,}(-?\d+)", build["TZ"]).group(1)) for build in BUILDS]
    assert abs(offsets[0] - offsets[1]) > 24  # hours


@pytest.mark.parametrize("allowed", [True, False])
def test_one_build_has_no_network_where_that_is_possible(project, monkeypatch, capsys, allowed):
    calls = builder(monkeypatch, ["1\n", "1\n"])
    monkeypatch.setattr(verification, "offline_works", lambda: allowed)
    assert verification.build_twice(project)
    assert sorted(environment["offline"] for _, _, environment in calls) == [False, allowed]
    output = capsys.readouterr().out
    assert ("smoke build in 1 " in output) and output.count("without network)") == allowed
    assert ("cannot run a process without it" in output) != allowed


def test_a_process_without_network_has_no_route(tmp_path, monkeypatch):
    """Where the machine allows it, and no machine allows what it has not."""
    rule = "rule all:\n    shell: 'sed s/^/route:/ /proc/net/route; echo it ran'\n"
    (tmp_path / "Snakefile").write_text(rule, encoding="utf-8")
    if verification.offline_works():
        process = verification.snakemake(tmp_path, "--cores", "1", offline=True)
        assert process.returncode == 0, process.stdout
        assert "\nit ran\n" in process.stdout
        assert not [line for line in process.stdout.splitlines() if line.startswith("route:") and "Iface" not in line]
    monkeypatch.setattr(verification, "_OFFLINE", ("there-is-no-such-command",))
    assert not verification.offline_works()


def test_another_locale_is_one_that_the_machine_has(monkeypatch):
    def chosen_locale(locales):
        monkeypatch.setattr(verification, "_output_of", lambda *command: locales)
        return verification.other_locale()

    assert chosen_locale("C\nC.utf8\nPOSIX\n") == "C.utf8"
    assert chosen_locale("C\nen_US.utf8\nC.utf8\nde_DE.utf8\nPOSIX\n") == "de_DE.utf8"
    assert chosen_locale(None) == "C.UTF-8"


def test_different_builds_are_named(project, monkeypatch, capsys):
    builder(monkeypatch, ["1\n", "2\n"])
    assert not verification.build_twice(project)
    output = capsys.readouterr().out
    table = f"figures/{SLUG}/eq54.csv"
    assert f"differs: {table}" in output
    assert f"marsedl diff build/verify/0/build/smoke/{table} build/verify/1/build/smoke/{table}" in output
    assert "1 differ" in output


def test_a_failed_build_shows_what_snakemake_said(project, monkeypatch):
    builder(monkeypatch, ["1\n", "1\n"], code=1)
    with pytest.raises(MarsedlError, match="what Snakemake said"):
        verification.build_twice(project)


def test_a_copy_of_the_tree_holds_no_products(project, tmp_path):
    copied = verification.copy_tree(project, tmp_path / "copy")
    names = {path.relative_to(copied).as_posix() for path in copied.rglob("*") if path.is_file()}
    assert names == {"Snakefile", f"data/reference/{SLUG}.json"}


def test_numbers_whose_squares_overflow_are_reduced_too():
    assert reduced(3e200, -4e200)["numbers"][0] == pytest.approx(np.sqrt(12.5) * 1e200, rel=1e-15)
    assert reduced(0.0, 0.0)["numbers"] == [0.0] * 5


def test_what_rounding_decides_is_compared_by_shape(project, capsys):
    store(project, scale=1.1)
    assert not verification.compare_reference(project, PAPERS)
    assert verification.compare_reference(project, PAPERS, {SLUG: ("corrected/nominal/ma*",)})
    assert "1 that rounding decides compared by shape" in capsys.readouterr().out
    assert not verification.compare_reference(project, PAPERS, {SLUG: ("corrected/nominal/iterations",)})
    path = project / "data" / "cache" / SLUG / "corrected" / "nominal.h5"
    shorter = Thing(np.linspace(1500.0, 1349.4, 49), 100, "x")
    artifacts.save(path, shorter, paper=SLUG, reading="corrected", provenance={})
    assert not verification.compare_reference(project, PAPERS, {SLUG: ("corrected/nominal/mass",)})
