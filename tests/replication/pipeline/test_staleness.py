"""What says that a product of a build is not what would be made now, in a folder with nothing but records."""

import shutil
from pathlib import Path

import pytest

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError, StaleError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline import products
from marsedl.replication.pipeline.fingerprints import Fingerprints
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.sharing import artifact_of
from marsedl.replication.pipeline.staleness import check, is_stale, reason
from marsedl.replication.records.recipes import write_record

ROOT = Path(__file__).parents[3]
MINE = """\
powered_descent:
  readings:
    mine: {based_on: corrected, noise: {noise_coefficient: {value: 0.03, source: "assumed: x"}}}
"""
CLAIMS = ["report/claims/powered_descent.json", "figures/powered_descent/claims.csv"]
PICTURES = ["figures/powered_descent/fig07.png", "figures/powered_descent/fig07.pdf"]


def products_of(*files):
    """All products, with the readings of some files."""
    papers, models = {slug: catalogue(slug) for slug in SLUGS}, {slug: input_model(slug) for slug in SLUGS}
    return Products(ROOT, papers, load_studies(models, ROOT, config_files=files), comparisons())


@pytest.fixture(scope="module")
def plain():
    """Without files of a user."""
    return products_of()


@pytest.fixture(scope="module")
def with_mine(tmp_path_factory):
    """With a reading of a user."""
    path = tmp_path_factory.mktemp("user") / "mine.yaml"
    path.write_text(MINE, encoding="utf-8")
    return products_of(path)


@pytest.fixture
def built(tmp_path, monkeypatch):
    """A function that writes some products and records them, as their job does; returns the folder."""
    monkeypatch.chdir(tmp_path)

    def build(plan, files):
        for path in map(Path, files):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{path} as it was made", encoding="utf-8")
        write_record(*plan.record(files[0]), files)
        return tmp_path

    return build


@pytest.mark.parametrize("files", [CLAIMS, PICTURES], ids=["claims", "figure"])
def test_a_product_that_was_edited_after_its_job_is_said_to_be(plain, built, files):
    folder = built(plain, files)
    assert [reason(plain, path, folder) for path in files] == ["", ""]
    (folder / files[1]).write_text("another", encoding="utf-8")
    assert reason(plain, files[1], folder) == "was edited after its job wrote it"
    assert reason(plain, files[0], folder) == f"goes with {files[1]}, which was edited after its job wrote it"
    assert is_stale(plain, files[0], folder)
    (folder / files[1]).unlink()
    assert not is_stale(plain, files[0], folder), "what is gone Snakemake makes again"


def test_what_was_built_beside_a_users_reading_is_good_for_the_check_and_planned_again(plain, with_mine, built):
    path = CLAIMS[0]
    folder = built(with_mine, CLAIMS)
    assert (reason(plain, path, folder, beside=True), reason(with_mine, path, folder)) == ("", "")
    assert is_stale(plain, path, folder), "it has a column for the reading, which goes again with its file"
    built(plain, CLAIMS)
    assert reason(with_mine, path, folder, beside=True) == "was made from other inputs or code"


def test_a_product_of_a_users_reading_has_one_recipe(with_mine):
    _, digests = with_mine.record("figures/powered_descent/mine/fig07.png")
    assert len(digests) == 1


def test_the_check_takes_what_was_built_beside_a_users_reading(plain, with_mine, built, monkeypatch):
    folder = built(with_mine, CLAIMS)
    monkeypatch.setattr(plain, "behind", lambda targets: targets)
    check(plain, CLAIMS, folder, "snakemake all")
    (folder / CLAIMS[1]).write_text("another", encoding="utf-8")
    with pytest.raises(StaleError, match=r"was edited after its job wrote it; the build is not up to date, run"):
        check(plain, CLAIMS[1:], folder, "snakemake all")


def test_what_verify_looks_at_includes_the_universes_of_all_papers(plain):
    looked_at = set(plain.behind(["report/claims.json"]))
    for slug in SLUGS:
        assert {f"report/universes/{slug}.h5", f"report/claims/{slug}.json"} <= looked_at


@pytest.mark.parametrize("lost", ["data/published/powered_descent.yaml", "CITATION.cff"])
def test_a_file_of_the_project_that_is_gone_has_no_digest(tmp_path, lost):
    for name in ("data", "configs", "src", "workflow", "CITATION.cff"):
        if not lost.startswith(name):
            (tmp_path / name).symlink_to(ROOT / name)
    for path in (ROOT / "data" / "published").iterdir() if lost.startswith("data") else ():
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path != ROOT / lost:
            copy.symlink_to(path)
    plan = products_of()
    plan.root = tmp_path
    with pytest.raises(InputError, match=rf"{lost}: cannot be read \(No such file or directory\); restore it"):
        plan.job(CLAIMS[0] if lost.startswith("data") else "report/index.html")


def test_words_of_the_machinery_that_are_no_folders_of_readings_may_name_one(tmp_path):
    path, names = tmp_path / "mine.yaml", ("comparison", "recipes", "claims", "random_field", "report", "universe")
    path.write_text(
        "".join([MINE[: MINE.index("    mine")], *(f"    {name}: {{based_on: corrected}}\n" for name in names)])
    )
    plan = products_of(path)
    for name in names:
        job = plan.job(f"figures/powered_descent/{name}/fig07.png")
        assert (job.name, job.params["stems"]) == (f"figures/powered_descent/{name}/fig07", ["fig07"])
        assert artifact_of(f"data/cache/powered_descent/{name}/nominal.h5")[1] == name


CLAIM = "src/marsedl/papers/powered_descent/claims/sec5_example.py"
PRINTED, CHOICES = "data/published/powered_descent.yaml", "configs/powered_descent.yaml"
TYPE = "src/marsedl/replication/claims/claim.py"  # of all that is said of a claim
SHARED = "src/marsedl/papers/desensitized/claims/sec4_channels.py"  # a function makes decorators of several claims


def test_what_is_said_of_claims_costs_no_universes(tmp_path, plain, monkeypatch):
    """The world of universes stays, and with it the committed run; what measures makes another one."""
    for folder in ("src", "configs", "data", "workflow/scripts"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "cache"))

    def edited(*changes):
        for name, old, new in changes:
            text = (tmp_path / name).read_text(encoding="utf-8")
            assert old in text
            (tmp_path / name).write_text(text.replace(old, new, 1), encoding="utf-8")
        memory, scripts = tmp_path / ".cache" / "fingerprints.json", tmp_path / "workflow" / "scripts"
        sources = Fingerprints(memory, tmp_path / "src", scripts)
        monkeypatch.setattr(products, "fingerprints_of", lambda root: sources)
        models = {slug: input_model(slug) for slug in slugs}
        plan = Products(tmp_path, {slug: catalogue(slug) for slug in slugs}, load_studies(models, tmp_path), {})
        return worlds(plan)

    def worlds(plan):
        params = [plan.job(f"report/universes/{slug}.h5").params for slug in slugs]
        return [(one["world"], one.get("sample")) for one in params]

    slugs = ("powered_descent", "desensitized")
    before = worlds(plain)
    assert len(before[0][1]) == 8, "universes of the committed run"
    said = [
        (CLAIM, "The printed downrange variance fits", "It fits"),
        (CLAIM, "counterexample=", "close=Tolerance('why', relative=0.5), counterexample="),
        (PRINTED, "plain: ", "plain: So "),
        (CHOICES, "asks: ", "asks: Really? "),
        (SHARED, "return claim(choices=GAINS", "return claim(choices=None"),
    ]
    assert edited(*said) == before
    (same, other), _ = edited((TYPE, "class Standing(_Part):", "class Standing(_Part):\n    another: int = 0\n"))
    assert same == before[0][0] and other != before[0][1], "another version sees other universes of the same run"
    ours, others = edited((CLAIM, "vehicle.specific_impulse, ", "2.0 * vehicle.specific_impulse, "))
    assert ours[0] != before[0][0] and others[0] == before[1][0]
    assert edited((SHARED, "name=name", "name=name, why=name"))[1][0] != before[1][0]
