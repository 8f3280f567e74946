"""The documentation: it builds without a warning, its links lead somewhere, and what it counts and names is so."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from pkgutil import walk_packages

import pytest
import yaml

import marsedl
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.badge import badge
from marsedl.replication.claims import COUNTED_VERDICTS
from marsedl.replication.inputs import load_studies
from marsedl.replication.verification import committed_verdicts

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)]
LIBRARIES = ("methods", "models", "montecarlo", "replication")
COLUMNS = (("reproduced", "holds"), ("close",), ("differs", "fails"), ("undetermined",))  # of the README's table


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The pages as `make docs` makes them."""
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(ROOT / "docs"), str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
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


@pytest.mark.parametrize("library", LIBRARIES)
def test_every_public_function_is_in_the_reference(pages, library):
    text = (pages / "reference" / f"{library}.html").read_text(encoding="utf-8")
    modules = [
        m.name for m in walk_packages([f"{marsedl.__path__[0]}/{library}"], f"marsedl.{library}.") if not m.ispkg
    ]
    assert modules
    for name in modules:
        assert f'id="module-{name}"' in text
        source = Path(ROOT / "src" / f"{name.replace('.', '/')}.py").read_text(encoding="utf-8")
        public = set(re.findall(r"(?m)^(?<!@intrinsic\n)(?:def|class) ([A-Za-z]\w*)", source))
        exported = re.search(r"(?ms)^__all__ = \[(.*?)\]", source)
        if exported:
            public &= set(re.findall(r'"(\w+)"', exported[1]))
        for symbol in public:
            assert f'id="{name}.{symbol}"' in text, f"{name}.{symbol}"


@pytest.mark.parametrize("slug", SLUGS)
def test_every_paper_has_its_note_with_all_errata(pages, slug):
    text = (pages / "papers" / f"{slug}.html").read_text(encoding="utf-8")
    found = re.findall(r"<strong>(E\w+)</strong>, printed", text)
    assert found == [erratum.id for erratum in catalogue(slug).errata]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_that_exist(page):
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if target.startswith("../../actions/"):  # of the hosting site, which makes it from this file
            target = str(ROOT / ".github" / target.removeprefix("../../actions/").removesuffix("/badge.svg"))
        assert (page.parent / target).exists(), target


def test_every_picture_is_shown():
    shown = {
        Path(name).name for page in PAGES for name in re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text("utf-8"))
    }
    assert {path.name for path in (ROOT / "docs" / "images").iterdir()} <= shown


def test_the_readme_counts_the_committed_verdicts():
    rows = re.findall(r"(?m)^\| \[`(\w+)`\].*?\| (\d+) \| (\d+) \| (\d+) \| (\d+) \|", PAGES[0].read_text("utf-8"))
    assert {slug for slug, *_ in rows} == set(SLUGS)
    assert sorted(verdict for column in COLUMNS for verdict in column) == sorted(COUNTED_VERDICTS)
    for slug, *counts in rows:
        verdicts = [
            verdict["corrected"] for verdict in committed_verdicts(ROOT, slug).values() if "corrected" in verdict
        ]
        assert [int(count) for count in counts] == [sum(map(verdicts.count, column)) for column in COLUMNS], slug


def test_the_badge_says_what_the_committed_verdicts_are():
    committed = [verdict for slug in SLUGS for verdict in committed_verdicts(ROOT, slug).values()]
    message = badge([{"verdict": verdict.get("corrected")} for verdict in committed])["message"]
    drawn = (ROOT / "docs" / "images" / "badge.svg").read_text("utf-8")
    assert set(re.findall(r"\d+ of \d+[^<\"]*", drawn)) == {message}
    assert f"![replication: {message}](docs/images/badge.svg)" in PAGES[0].read_text("utf-8")


def test_the_readings_that_are_shown_are_accepted(tmp_path, monkeypatch):
    """In a folder with the project's configurations, and a density table of the user's own."""
    for name in ("configs", "data"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "gram_run.csv").write_text("altitude_km,density_kg_m3\n0,0.02\n50,1e-4\n125,1e-9\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    shown = [text for page in PAGES for text in code_blocks(page, "yaml") if not text.startswith(" ")]
    assert len(shown) >= 3
    for text in shown:
        Path("mine.yaml").write_text(text, encoding="utf-8")
        config = yaml.safe_load(text)
        studies = load_studies(
            {slug: input_model(slug) for slug in SLUGS}, Path("configs"), config, [Path("mine.yaml")]
        )
        for slug, section in config.items():
            assert section["readings"].keys() <= studies[slug].readings.keys()


@pytest.mark.parametrize(
    ("lock", "extras"), [("requirements.lock", ("dev", "docs")), ("requirements-slurm.lock", ("slurm",))]
)
def test_the_lock_has_everything_that_is_installed_and_no_address(lock, extras):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(name for extra in extras for name in project["optional-dependencies"][extra]),
    ]
    lock = (ROOT / lock).read_text("utf-8")
    assert set(map(str.lower, re.findall(r"(?m)^([A-Za-z0-9_.-]+)==", lock))) >= {
        re.split("[>=<]", name)[0] for name in wanted
    }
    assert "://" not in lock
    assert "--index" not in lock
