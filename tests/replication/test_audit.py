"""The audit: that it finds what is left hanging, counts what there is, and finds nothing in this project."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from marsedl import cli
from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import audit, verification
from marsedl.replication.audit import PROJECT, Plan, Result, Subject
from marsedl.replication.catalogue import Erratum, Product, Stage
from marsedl.replication.claims import Close, Declaration, PublishedClaim, load_published
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs import load_study

ROOT = Path(__file__).parents[2]
SLUG = "powered_descent"


def subject_of(slug):
    study = load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml")
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    return Subject(catalogue(slug), study, published, {})


@pytest.fixture(scope="module")
def subject():
    return subject_of(SLUG)


@pytest.fixture(scope="module")
def results():
    """The audit of this project."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return cli._run_audit(ROOT)


@pytest.fixture
def paper():
    """A paper of one figure, one table over all readings, and one stage."""
    erratum = Erratum("E1", "a slip", "the evidence", "what is used")
    stages, figures = (
        {"nominal": Stage(("marsedl.papers.p.nominal:compute",), (), (), "the path")},
        {"fig01": Product("A figure.")},
    )
    whole = catalogue(SLUG)
    products = {"figures": figures, "tables": {}, "summaries": {"readings": "All."}, "picture": "fig01"}
    return replace(whole, stages=stages, errata=(erratum,), **products)


def planned(*files, rules=(), used=()):
    return Plan(frozenset(rules), frozenset(used), frozenset(files))


def always(_):
    return True


def never(_):
    return False


# --------------------------------------------------------------------------------------------------- the project itself


def test_nothing_is_left_hanging_in_this_project(results):
    assert not audit.findings(results), "\n".join(audit.findings(results))


def test_the_counts_of_this_project_are_the_committed_ones(results):
    assert not audit.count_changes(results, audit.read_counts(ROOT))


def test_every_rule_counts_something_in_every_paper(results):
    counted = {}
    for result in results:
        counted.setdefault(result.rule, set()).add(result.part)
        assert result.count > 0, result
    assert len(counted) == 12
    assert all(parts in ({PROJECT}, set(SLUGS)) for parts in counted.values())


def test_the_counts_are_those_of_the_catalogue(results):
    counts = {(result.rule, result.part): result.count for result in results}
    for slug in SLUGS:
        assert counts["figures, each with targets and a drawing function", slug] == len(catalogue(slug).figures)
        assert counts["stages, each with a rule and a function", slug] == len(catalogue(slug).stages)
        assert counts["errata, each named by a claim, a reading or an input", slug] == len(catalogue(slug).errata)
    assert counts["comparisons, each with targets and functions", PROJECT] == len(comparisons())


# ----------------------------------------------------------------------------------------------------- rules of a paper


def test_claims_without_result_and_results_without_claim_are_found(subject):
    claim = PublishedClaim(SLUG, "mass", "Eq. 1", "mass", 1.0, "kg", "deterministic", 0.1)
    two = replace(subject, published=[claim, replace(claim, id="time")])
    good = {"mass": {"corrected": "reproduced"}, "time": {"printed": "differs"}}
    assert audit.evaluated_claims(two, good) == Result("printed claims, each with a result of an evaluator", SLUG, 2)
    (lost,) = audit.evaluated_claims(two, {**good, "time": {}}).findings
    assert "claim time has no result; write its function in src/marsedl/papers/powered_descent/claims" in lost
    (stale,) = audit.evaluated_claims(replace(two, published=[claim]), good).findings
    assert "claim time has a result but is not in this file" in stale


def test_results_are_those_of_the_build_or_else_the_committed_ones(tmp_path):
    assert audit.verdicts_of(tmp_path, SLUG) == {}
    (tmp_path / "data" / "reference").mkdir(parents=True)
    number = {"shape": [], "counts": False, "numbers": []}
    committed = {"verdicts/mass": {"corrected": "holds"}, "claims/mass/corrected": number}
    (tmp_path / "data" / "reference" / f"{SLUG}.json").write_text(json.dumps(committed), encoding="utf-8")
    assert audit.verdicts_of(tmp_path, SLUG) == {"mass": {"corrected": "holds"}}
    (tmp_path / "report" / "claims").mkdir(parents=True)
    result = {"value": None, "standard_error": None, "evidence": ""}
    readings = {"corrected": {**result, "verdict": "fails"}, "printed": {**result, "verdict": None}}
    texts = ("paper", "id", "where", "quantity", "unit", "kind", "verdict", "reading", "reason")
    rows = [{**dict.fromkeys(texts, "mass"), "printed": True, "resolution": None, "readings": readings}]
    (tmp_path / "report" / "claims" / f"{SLUG}.json").write_text(json.dumps(rows), encoding="utf-8")
    assert audit.verdicts_of(tmp_path, SLUG) == {"mass": {"corrected": "fails"}}


def test_figures_without_target_or_function_are_found(paper):
    files = [f"figures/{SLUG}/fig01.{kind}" for kind in ("png", "pdf")]
    files += [f"figures/{SLUG}/printed/fig01.{kind}" for kind in ("png", "pdf")]
    result = audit.figures(paper, planned(*files), always)
    assert (result.count, result.findings) == (1, ())
    (finding,) = audit.figures(paper, planned(*files[:3]), always).findings
    assert finding.startswith(f"figures/{SLUG}/printed/fig01.pdf: no target")
    (finding,) = audit.figures(paper, planned(*files), never).findings
    assert "figures.py: no function fig01" in finding


def test_tables_over_all_readings_need_no_target_of_another_reading(paper):
    files = planned(*(f"figures/{SLUG}/readings.{kind}" for kind in ("csv", "md")))
    assert audit.tables(paper, files, always) == Result("tables, each with targets and a function", SLUG, 1)
    table = replace(paper, tables={"tab01": Product("A table.", ())})
    assert len(audit.tables(table, files, always).findings) == 4
    (finding,) = audit.tables(paper, files, never).findings
    assert "tables.py: no function readings" in finding


def test_stages_without_rule_or_function_are_found(paper):
    there = planned(rules=[f"{SLUG}_nominal"])
    assert audit.stages(paper, there, always) == Result("stages, each with a rule and a function", SLUG, 1)
    (finding,) = audit.stages(paper, planned(), always).findings
    assert f"workflow/rules/stages.smk: no rule {SLUG}_nominal" in finding
    (finding,) = audit.stages(paper, there, never).findings
    assert "nominal: no function compute" in finding


def test_functions_are_looked_for_in_the_source(tmp_path):
    folder = tmp_path / "src" / "marsedl"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "figures.py").write_text("def fig01():\n    pass\n", encoding="utf-8")
    (tmp_path / "workflow" / "scripts").mkdir(parents=True)
    has_function = audit._functions(tmp_path)
    assert has_function("marsedl.figures:fig01")
    assert not has_function("marsedl.figures:fig02")
    assert not has_function("marsedl.tables:fig01")


def test_inputs_without_source_are_found(subject):
    result = audit.inputs(subject)
    readings = subject.study.readings
    assert result.count == sum(len(reading.differences()) for reading in readings.values())
    assert not result.findings
    printed = readings["printed"]
    silent = {**printed.sources, "planet.gravity": replace(printed.sources["planet.gravity"], source=" ")}
    study = replace(subject.study, readings={**readings, "printed": replace(printed, sources=silent)})
    (finding,) = audit.inputs(replace(subject, study=study)).findings
    assert "configs/powered_descent.yaml: readings.printed.planet.gravity: no source" in finding


def test_errata_that_nothing_names_are_found(subject, paper):
    def findings_on(erratum, declaration=None):
        one = replace(paper, errata=(replace(paper.errata[0], id=erratum),))
        declarations = {"mass": declaration} if declaration else {}
        return audit.errata(replace(subject, paper=one, declarations=declarations)).findings

    (finding,) = findings_on("E99")
    assert "erratum E99 (a slip) is used nowhere" in finding
    assert not findings_on("E99", Declaration(errata=("E99",)))
    assert not findings_on("E99", Declaration(reason="It hangs on E99."))
    assert not findings_on("E99", Declaration(close=Close("as E99 has it", relative=0.1)))
    assert findings_on("E9", Declaration(reason="It hangs on E99.")), "another one"
    reading = subject.study.readings["corrected"]
    study = replace(subject.study, readings={"corrected": replace(reading, summary="E99 mended.")})
    assert not audit.errata(
        replace(subject, study=study, paper=replace(paper, errata=(replace(paper.errata[0], id="E99"),)))
    ).findings


def test_readings_that_keep_an_erratum_exist(subject, paper):
    def findings_on(*kept_by):
        one = replace(paper, errata=(replace(paper.errata[0], kept_by=kept_by),))
        return audit.errata(replace(subject, paper=one, declarations={"mass": Declaration(errata=("E1",))})).findings

    assert not findings_on()
    assert not findings_on("printed", "euler")
    (finding,) = findings_on("eulr", "printed")
    assert "texts.yaml: errata.E1.kept_by: there is no reading 'eulr'; did you mean 'euler'?" in finding
    (finding,) = findings_on("corrected")
    assert "errata.E1.kept_by: other readings are compared with 'corrected'" in finding


def test_the_picture_of_a_paper_is_one_of_its_figures(paper):
    def findings_on(picture):
        return audit.figures(replace(paper, picture=picture), planned(*files), always).findings

    files = [f"figures/{SLUG}/{place}fig01.{kind}" for place in ("", "printed/") for kind in ("png", "pdf")]

    assert not findings_on("fig01")
    assert not findings_on("")
    (finding,) = findings_on("fig1")
    assert "texts.yaml: picture: there is no figure 'fig1'; did you mean 'fig01'?" in finding


# ------------------------------------------------------------------------------------------------- rules of the project


def test_comparisons_without_target_or_function_are_found():
    files = [f"figures/comparison/costs.{kind}" for kind in ("png", "pdf", "csv", "md")]
    result = audit.comparison_products(["costs"], planned(*files), always)
    assert (result.count, result.findings) == (1, ())
    (finding,) = audit.comparison_products(["costs"], planned(*files[1:]), always).findings
    assert finding.startswith("figures/comparison/costs.png: no target")
    (finding,) = audit.comparison_products(["costs"], planned(*files), lambda entry: "figure" in entry).findings
    assert finding == "src/marsedl/comparison/costs.py: no function table; write it"


def test_rules_that_nothing_asks_for_are_found():
    plan = planned(rules=["all", "nominal", "old"], used=["nominal"])
    result = audit.workflow_rules(plan, ["all", "claims"])
    assert result.count == 3
    dead, missing = result.findings
    assert "nothing asks for rule old" in dead
    assert "there is no target claims" in missing
    assert not audit.workflow_rules(planned(rules=["all", "nominal"], used=["nominal"]), ["all"]).findings


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("path = '/{}/someone/marsedl'".format("home"), True),
        ("see file:///{}/x".format("tmp"), True),
        ("C:\\{}\\someone".format("Users"), True),
        ("#!/{}/bin/env bash".format("usr"), False),
        ("path = '~/{}/x'".format("work"), False),
        ("https://example.org/{}/x".format("home"), False),
        ("data/{}/x and /dev/null".format("tmp"), False),
    ],
)
def test_absolute_paths_are_found(line, wrong):
    result = audit.machine_paths({"docs/x.md": f"first\n{line}\n", "good.md": "nothing\n"})
    assert result.count == 2
    assert [finding.startswith("docs/x.md:2: an absolute path") for finding in result.findings] == [True] * wrong


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("--{}=https://example.org/x".format("index-url"), True),
        ("PIP_{}: http://example.org".format("INDEX_URL"), True),
        ("https://{}.org/project/numpy".format("pypi"), True),
        ("https://example.org/{}/numpy/".format("simple"), True),
        ("--{} example.org".format("trusted-host"), True),
        ("uv pip compile --no-emit-index-url --no-header pyproject.toml", False),
        ("see https://docs.python.org/3/library/ast.html", False),
        ("the simple case of a package index", False),
    ],
)
def test_addresses_of_package_indices_are_found(line, wrong):
    result = audit.index_addresses({"requirements.lock": f"{line}\n"})
    assert (result.count, len(result.findings)) == (1, wrong)
    assert all("requirements.lock:1: the address of a package index" in finding for finding in result.findings)


SEEDED = """
import numpy as np
from numpy.random import Philox, default_rng as rng
from random import Random
import numpy.random as draw

def f(seed, generator: np.random.Generator):
    random = np.random.default_rng(seed)
    random.normal(), np.random.Generator(Philox(key=3)), rng(1), Random(4), draw.PCG64(seed=2)
"""


def random_numbers(text):
    result = audit.randomness({"x.py": text, "x.md": "np.random.rand()"})
    return result.count, [finding.split(" ", 1)[1] for finding in result.findings]


def test_seeded_generators_are_counted():
    assert random_numbers(SEEDED) == (5, [])
    assert random_numbers("from marsedl.models import random\nrandom.sample()\nrandom = 1\nrandom.x\n") == (0, [])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("import numpy as np\nnp.random.normal()", "numpy.random.normal draws from a hidden global state"),
        ("import numpy as np\nnp.random.seed(1)", "numpy.random.seed draws from a hidden"),
        ("from numpy.random import rand\nrand(3)", "numpy.random.rand draws from a hidden"),
        ("from numpy import random\nrandom.rand(3)", "numpy.random.rand draws from a hidden"),
        ("import numpy as np\nnp.random.RandomState(3)", "numpy.random.RandomState draws from a hidden"),
        ("import numpy\nnumpy.random.default_rng()", "numpy.random.default_rng has no seed"),
        ("import numpy as np\nnp.random.default_rng(None)", "numpy.random.default_rng has no seed"),
        ("import numpy as np\nnp.random.Philox(counter=3)", "numpy.random.Philox has no seed"),
        ("import numpy as np\nmake = np.random.default_rng", "is passed on without a seed"),
        ("import random\nrandom.shuffle(x)", "random.shuffle draws from a hidden global state"),
        ("from random import choice\nchoice(x)", "random.choice draws from a hidden"),
        ("import random\nrandom.Random()", "random.Random has no seed"),
        ("import time, numpy as np\nnp.random.default_rng(time.time_ns())", "is seeded by time.time_ns"),
        ("import time, numpy as np\nnp.random.default_rng(int(time.time()))", "is seeded by time.time"),
        ("import os, numpy as np\nnp.random.Philox(key=os.getpid())", "is seeded by os.getpid"),
        ("import numpy as np\nnp.random.default_rng(hash('x'))", "is seeded by hash"),
        ("from scipy.stats import norm\nnorm.rvs(3)", "rvs has no random_state"),
    ],
)
def test_randomness_without_a_seed_is_found(text, problem):
    number, findings = random_numbers(text)
    assert number == 0
    assert any(problem in finding for finding in findings), findings


def test_text_files_are_listed_with_and_without_a_checkout(tmp_path, monkeypatch):
    (tmp_path / ".gitignore").write_text("/build/\n*.tmp\n", encoding="utf-8")
    (tmp_path / "build").mkdir()
    for name in ("a.py", "b.tmp", "build/c.py"):
        (tmp_path / name).write_text("1\n", encoding="utf-8")
    (tmp_path / "d.png").write_bytes(b"\x89PNG\0\1\2")
    assert audit.text_files(tmp_path) == {".gitignore": "/build/\n*.tmp\n", "a.py": "1\n"}
    assert "src/marsedl/replication/audit.py" in audit.text_files(ROOT)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MarsedlError, match="git cannot list"):
        audit.text_files(tmp_path)


def test_a_workflow_that_cannot_be_planned_is_no_finding(tmp_path):
    (tmp_path / "Snakefile").write_text("rule all:\n    input: 'nothing'\n", encoding="utf-8")
    with pytest.raises(MarsedlError, match=r"(?s)the workflow cannot be planned.*MissingInputException"):
        audit.plan(tmp_path, [])


def test_a_plan_holds_rules_and_the_files_that_are_asked_for(tmp_path):
    rules = "rule all:\n    input: 'a'\nrule claims:\n    input: 'a'\n"
    rules += "".join(f"rule make_{name}:\n    output: '{name}'\n    shell: 'touch {{output}}'\n" for name in "abc")
    (tmp_path / "Snakefile").write_text(rules, encoding="utf-8")
    assert audit.plan(tmp_path, ["b"]) == planned(
        "a", "b", rules=["all", "claims", "make_a", "make_b", "make_c"], used=["make_a", "make_b"]
    )


# --------------------------------------------------------------------------------------------------------------- counts

COUNTED = [Result("figures", "one", 3), Result("figures", "two", 4), Result("files", PROJECT, 9, at_least=True)]
COMMITTED = {"figures": {"one": 3, "two": 4}, "files": {PROJECT: 9}}


def test_counts_are_written_and_read(tmp_path):
    assert audit.read_counts(tmp_path) == {}
    audit.write_counts(tmp_path, COUNTED)
    assert audit.read_counts(tmp_path) == COMMITTED
    assert not audit.count_changes(COUNTED, COMMITTED)
    (tmp_path / audit.COUNTS).write_text("[]", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read as counts"):
        audit.read_counts(tmp_path)


@pytest.mark.parametrize(
    ("committed", "message"),
    [
        ({**COMMITTED, "figures": {"one": 3, "two": 5}}, "figures: two: 4, committed is 5"),
        ({**COMMITTED, "figures": {"one": 2, "two": 4}}, "figures: one: 3, committed is 2"),
        ({**COMMITTED, "figures": {"one": 3}}, "figures: two: 4, and no count is committed"),
        ({**COMMITTED, "figures": {"one": 3, "two": 4, "three": 1}}, "figures: three: no longer counted"),
        ({**COMMITTED, "errata": {"one": 1}}, "errata: one: no longer counted, committed is 1"),
        ({**COMMITTED, "files": {PROJECT: 10}}, "files: project: 9, committed is at least 10"),
    ],
)
def test_what_vanishes_or_appears_is_said(committed, message):
    (change,) = audit.count_changes(COUNTED, committed)
    assert change.startswith(message)
    text = audit.format_results(COUNTED, committed)
    assert f"  {message}" in text
    assert text.endswith("0 findings, 1 counts changed")


def test_files_may_come_without_being_committed():
    assert not audit.count_changes(COUNTED, {**COMMITTED, "files": {PROJECT: 8}})


def test_an_audit_is_written_with_a_line_for_each_rule_and_finding():
    results = [*COUNTED, Result("errata", "one", 2, ("errata.py: E1 is used nowhere",))]
    assert audit.format_results(results, {**COMMITTED, "errata": {"one": 2}}).splitlines() == [
        "     7 figures (one 3, two 4)",
        "     9 files",
        "     2 errata",
        "  errata.py: E1 is used nowhere",
        "1 findings, 0 counts changed",
    ]


@pytest.mark.parametrize(("problems", "committed", "code"), [((), 3, 0), (("x: y",), 3, 1), ((), 4, 1)])
def test_the_command_fails_with_findings_and_changed_counts(monkeypatch, capsys, problems, committed, code):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(cli, "_run_audit", lambda root: [Result("figures", "one", 3, problems)])
    monkeypatch.setattr(audit, "read_counts", lambda root: {"figures": {"one": committed}})
    assert cli.main(["audit"]) == code
    message = capsys.readouterr().out
    assert "     3 figures" in message
    assert ("'marsedl accept'" in message) == (committed != 3)


def test_accept_commits_the_counts_too(tmp_path, monkeypatch, capsys):
    (tmp_path / "Snakefile").touch()
    (tmp_path / "configs").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verification, "accept_reference", lambda *_: [])
    monkeypatch.setattr(cli, "_run_audit", lambda root: COUNTED)
    monkeypatch.setattr(cli, "_write_readme", lambda root: None)
    monkeypatch.setattr(cli, "_project", lambda *_: SimpleNamespace(studies={}, quotes=lambda slug: None))
    monkeypatch.setattr("marsedl.replication.quotes.accept", lambda root, papers: "what texts quote")
    assert cli.main(["accept"]) == 0
    assert "data/reference/audit.json: no counts are committed" in capsys.readouterr().out
    assert audit.read_counts(tmp_path) == COMMITTED


# ------------------------------------------------------------------------------------------------- in the built project


@pytest.mark.workflow
@pytest.mark.parametrize("slug", SLUGS)
def test_every_claim_of_the_built_tree_has_a_result(copied, monkeypatch, slug):
    monkeypatch.chdir(ROOT)  # from where files named by inputs are read
    verdicts = verification.built_verdicts(copied.build, slug)
    assert verdicts
    assert not audit.evaluated_claims(subject_of(slug), verdicts).findings
