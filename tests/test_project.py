"""What is left hanging in the project: unused errata, random numbers without a seed, paths of one machine."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.inputs.readings import load_study

ROOT = Path(__file__).parents[1]
GENERATORS = {"default_rng", "Philox", "PCG64", "PCG64DXSM", "MT19937", "SFC64", "SeedSequence", "Random"}
# Folders of one machine. An interpreter named in the first line of a script does not count.
MACHINE_PATH = re.compile(
    r"(?<![\w.:/~<-])(?:file://)?/(?:home|root|work|tmp|usr|opt|var|etc|mnt|srv|media|Users|private|scratch)/\w"
    r"|\b[A-Z]:\\{1,2}Users\b"
)


@pytest.fixture(scope="module")
def texts():
    """The text files that are tracked, or would be, by path."""
    command = ["git", "grep", "--no-index", "--exclude-standard", "-lIz", "-e", ""]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")[:-1]
    return {name: (ROOT / name).read_text(encoding="utf-8", errors="replace") for name in sorted(names)}


@pytest.mark.parametrize("slug", SLUGS)
def test_every_erratum_is_named_by_a_claim_a_reading_a_choice_or_an_input_and_claims_name_choices_that_exist(slug):
    study = load_study(slug, input_model(slug), ROOT)
    readings, choices = study.readings, study.choices
    paper, declared = catalogue(slug), claims_of(slug).declarations.values()
    named = [" ".join([*d.errata, d.reason, d.close.reason if d.close else ""]) for d in declared]
    named += [one.because for one in choices]
    named += [text for r in readings.values() for text in (r.summary, *(s.source for s in r.sources.values()))]
    words = set(re.findall(r"\w+", " ".join(named)))
    assert not [erratum.id for erratum in paper.errata if erratum.id not in words]
    assert {one.erratum for one in choices if one.erratum} <= {erratum.id for erratum in paper.errata}
    assert {name for d in declared for name in d.choices} <= choices.by_name.keys()


def test_random_numbers_have_a_seed(texts):
    """Functions with a hidden global state are found by ruff (NPY002)."""
    seeded, bare = 0, []
    for name, text in texts.items():
        if not name.endswith(".py") or not re.search("random|rvs", text):
            continue
        for node in ast.walk(ast.parse(text, filename=name)):
            function = getattr(node, "func", None)
            called = getattr(function, "attr", getattr(function, "id", ""))
            if called in GENERATORS:
                seeds = [*node.args[:1], *(keyword.value for keyword in node.keywords)]
                missing = not seeds or any(isinstance(s, ast.Constant) and s.value is None for s in seeds)
            elif called == "rvs":
                missing = not any(keyword.arg == "random_state" for keyword in node.keywords)
            else:
                continue
            seeded += not missing
            bare += [f"{name}:{node.lineno}: {called}"] * missing
    assert not bare
    assert seeded > 20


def test_no_file_names_a_folder_of_one_machine(texts):
    lines = [(name, n, line) for name, text in texts.items() for n, line in enumerate(text.splitlines(), 1)]
    assert not [f"{name}:{n}" for name, n, line in lines if MACHINE_PATH.search(line) and not line.startswith("#!")]
