"""The documentation: it builds without a warning, its links lead somewhere, and what it counts and names is so."""

import re
import subprocess
import sys
from pathlib import Path
from pkgutil import walk_packages

import pandas as pd
import pytest
import yaml

import marsedl
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claims.counts import counted
from marsedl.replication.claims.quotes import accepted, with_numbers
from marsedl.replication.claims.thresholds import WORDS
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.report import front_page
from marsedl.replication.report.front_page import badge, words

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)]
LIBRARIES = ("design", "fly", "methods", "models", "montecarlo", "replication")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The pages as `make docs` makes them, but for the outputs of the notebooks, which tests/test_notebooks.py runs."""
    folder = tmp_path_factory.mktemp("docs") / "html"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-D", "nb_execution_mode=off"]
    command += [str(ROOT / "docs"), str(folder)]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]
    return folder


def code_blocks(page, language):
    """The blocks of a page in a language."""
    blocks = re.findall(r"(?ms)^```(\S*)\n(.*?)^```$", page.read_text(encoding="utf-8"))
    return [text for named, text in blocks if named == language]


def test_the_pages_need_no_network_and_name_no_folder_of_this_machine(pages):
    for path in pages.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"""<(script|link|img|iframe)[^>]*(src|href)=["'](https?:)?//""", text), path.name
        assert str(ROOT) not in text, path.name


def test_every_public_function_is_in_the_reference(pages):
    for library in LIBRARIES:
        modules = [
            m.name for m in walk_packages([f"{marsedl.__path__[0]}/{library}"], f"marsedl.{library}.") if not m.ispkg
        ]
        assert modules
        for name in modules:
            text = (pages / "reference" / "modules" / f"{name}.html").read_text(encoding="utf-8")
            assert f'id="module-{name}"' in text and "Alias for field number" not in text
            source = Path(ROOT / "src" / f"{name.replace('.', '/')}.py").read_text(encoding="utf-8")
            public = set(re.findall(r"(?m)^(?<!@intrinsic\n)(?:def|class) ([A-Za-z]\w*)", source))
            exported = re.search(r"(?ms)^__all__ = \[(.*?)\]", source)
            if exported:
                public &= set(re.findall(r'"(\w+)"', exported[1]))
            assert [f"{name}.{symbol}" for symbol in public if f'id="{name}.{symbol}"' not in text] == []


def test_every_paper_has_its_note_with_all_errata_and_formulas_as_mathml(pages):
    for slug in SLUGS:
        source = (ROOT / "docs" / "papers" / f"{slug}.md").read_text(encoding="utf-8")
        page = (pages / "papers" / f"{slug}.html").read_text(encoding="utf-8")
        errata = re.findall(r"<strong>(E\w+)</strong>, printed", page)
        assert errata == [erratum.id for erratum in catalogue(slug).errata]
        assert page.count("<math") >= source.count("$") // 2 - 2 * source.count("$$") // 2
        assert not re.search(r"\\[a-z]+\{|MathJax", page)


def test_links_lead_to_files_that_exist():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if target.startswith("../../actions/"):  # of the hosting site, which makes it from this file
                target = str(ROOT / ".github" / target.removeprefix("../../actions/").removesuffix("/badge.svg"))
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_what_a_build_takes_is_as_it_was_measured():
    """In `data/reference/costs.csv`, which `bench/costs.py` writes after a full build on an idle machine."""
    costs = pd.read_csv(ROOT / "data" / "reference" / "costs.csv").set_index(["where", "what"])
    whole, universes = costs.loc[("all", "sum")], costs.query("what in ('universes', 'what_decides', 'waves')")
    readme, scaling = (" ".join((ROOT / name).read_text("utf-8").split()) for name in ("README.md", "docs/scaling.md"))
    share, largest, longest = (
        float(re.search(words, text)[1])
        for words, text in (
            (r"Some (\d+) % of the computing is universes", readme),
            (r"largest job of a whole build takes (\d+) MB", scaling),
            (r"and the longest (\d+) seconds on two busy cores", scaling),
        )
    )
    assert share / 100 == pytest.approx(universes["cpu_s"].sum() / whole["cpu_s"], abs=0.05)
    assert largest == pytest.approx(whole["memory_mb"], rel=0.05)
    assert longest == pytest.approx(whole["longest_s"], rel=0.05)
    assert "in ten to thirty minutes on two cores" in readme
    assert 240 < whole["cpu_s"] / 2 < 1500, "of the time on two cores, four minutes or so start 200 jobs"
    asked = re.search(r"Every job asks for ([\d,]+) MB and (\d+) minutes", scaling)
    assert largest < float(asked[1].replace(",", "")) and longest < 60 * float(asked[2])


def test_every_picture_is_shown():
    shown = [name for page in PAGES for name in re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text("utf-8"))]
    assert {path.name for path in (ROOT / "docs" / "images").iterdir()} <= {Path(name).name for name in shown}


def with_committed_numbers(slug):
    return with_numbers(catalogue(slug), accepted(ROOT, slug))


@pytest.mark.parametrize("path", [front_page.README, front_page.BADGE], ids=str)
def test_the_readme_says_what_the_committed_verdicts_are(path):
    text = (ROOT / path).read_text("utf-8")
    assert front_page.filled(text, ROOT, map(with_committed_numbers, SLUGS)) == text, "run 'marsedl readme'"
    message = badge([row for slug in SLUGS for row in front_page.committed_claims(ROOT, slug)])
    assert set(re.findall(r"\d+ of \d+ printed numbers; [^<\"\]]*", text)) == {message}


def test_the_readme_has_a_line_for_every_paper_and_every_word():
    text = PAGES[0].read_text("utf-8")
    for slug in SLUGS:
        (line,) = re.findall(rf"(?m)^- \*\*\[{slug}\]\(docs/papers/{slug}\.md\)\*\* .*$", text)
        rows = front_page.committed_claims(ROOT, slug)
        headline = [row.verdict for row in rows if row.headline]
        standing = len(headline) - sum(verdict in ("differs", "fails", "undetermined") for verdict in headline)
        assert f"**{standing} of {len(headline)}** headline claims stand" in line
        assert f"; {counted(rows).verdicts['numbers']['reproduced']} of " in line
    for word, meaning in words().items():
        assert f"- **{word.capitalize()}**: {meaning}\n" in text


def test_the_page_on_verdicts_shows_the_thresholds_of_the_words():
    rows = re.findall(r"(?m)^\| (.+?) \| ([\d.]+)( %)? \|", (ROOT / "docs" / "verdicts.md").read_text("utf-8"))
    thresholds = {words: float(number) / (100 if percent else 1) for words, number, percent in rows}
    assert thresholds == {limit.words: pytest.approx(limit.at(1.0), abs=0.005) for limit in WORDS.values()}


def test_the_readings_that_are_shown_are_accepted(tmp_path):
    """In a folder with the project's configurations, and a density table of the user's own."""
    for name in ("configs", "data"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "gram_run.csv").write_text("altitude_km,density_kg_m3\n0,0.02\n50,1e-4\n125,1e-9\n", encoding="utf-8")
    blocks = [text for page in PAGES for text in code_blocks(page, "yaml") if not text.startswith(" ")]
    texts = [text for text in blocks if "\njobs:\n" not in text]  # those of a hosted workflow are no configurations
    assert len(texts) >= 3
    for text in texts:
        (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
        models = {slug: input_model(slug) for slug in SLUGS}
        studies = load_studies(models, tmp_path, config_files=[tmp_path / "mine.yaml"])
        for slug, section in yaml.safe_load(text).items():
            assert section["readings"].keys() <= studies[slug].readings.keys()
