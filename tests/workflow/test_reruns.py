"""Which jobs an edit concerns: most by the recipes of all products, which one process computes; some by Snakemake."""

import os
import re
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline import products
from marsedl.replication.pipeline.fingerprints import Fingerprints, fingerprints_of
from marsedl.replication.pipeline.libraries import _version, versions_used
from marsedl.replication.pipeline.sharing import artifact_of
from marsedl.replication.records.recipes import recipe_digest

pytestmark = pytest.mark.workflow

FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}
CONFIG = "configs/powered_descent.yaml"
PACKAGE = "src/marsedl"
PHYSICS = f"{PACKAGE}/models/dynamics/powered_descent.py"
STATISTICS = f"{PACKAGE}/montecarlo/statistics.py"
SUMMARY = {"site"}
POINTS = "points"  # what named readings give, which are evaluated in memory
JUDGED = {"claims", "counterexamples", "universes"}  # for each paper
CLAIMS = {*JUDGED, "all_claims", *SUMMARY}


@dataclass(frozen=True)
class Job:
    """Digests of what one job is given: all but products, and all."""

    kind: str  # the stage, or the kind of product
    paper: str
    name: str  # reading and artifact, or figure or table
    own: str
    recipe: str


@dataclass(frozen=True)
class Edited:
    """The jobs that an edit concerns: `changed` themselves, and with all that is made from what they make."""

    changed: tuple[Job, ...]
    rerun: tuple[Job, ...]

    def kinds(self, slug: str = "") -> set[str]:
        return {job.kind for job in self.rerun if job.paper == slug or not slug}

    def stages(self, slug: str = "") -> set[str]:
        return self.kinds(slug) - {"figure", "table", "comparison", POINTS, *CLAIMS}

    def names(self, kind: str) -> set[str]:
        return {job.name for job in self.rerun if job.kind == kind}

    @property
    def papers(self) -> set[str]:
        return {job.paper for job in self.rerun} - {""}

    @property
    def readings(self) -> set[str]:
        return {job.name.split("/")[0] for job in self.rerun if job.kind in self.stages()}

    @property
    def shown(self) -> set[str]:
        return self.names("figure") | self.names("table")


def jobs_of(every: products.Products) -> dict[str, Job]:
    """All jobs of `snakemake all` by their records, artifacts by their paths."""
    jobs = {}
    for path in every.behind(every.all()):
        planned = every.job(path)
        if path.startswith("data/cache/"):
            paper, reading, name = artifact_of(path)
            kind, name, own = name.split(".")[0], f"{reading}/{name}", {**planned.params, "needs": None}
        else:
            first, *middle, name = planned.name.split("/")
            paper = middle[0] if first == "figures" else name.removesuffix("_what_decides") if middle else ""
            kind = {"index": "site", "claims": "all_claims"}.get(name, name) if not middle else middle[0]
            if first == "figures":
                kind = "comparison" if paper == "comparison" else "figure" if path.endswith("png") else "table"
                name, paper = "/".join([*middle[1:], name]), paper if paper in SLUGS else ""
            own = planned.params
        jobs.setdefault(planned.name or path, Job(kind, paper, name, recipe_digest(own), every.digest(path)))
    return jobs


def with_inputs(folder: Path, paper: str, reading: str, **values: object) -> str:
    """The configuration of a paper with other inputs of a reading; names without the section's."""
    of = {key: section for section, inputs in input_model(paper).sections().items() for key in inputs.model_fields}
    config = yaml.safe_load((folder / f"configs/{paper}.yaml").read_text(encoding="utf-8"))
    for name, value in values.items():
        section = config["readings"][reading].setdefault(of[name], {})
        section[name] = {"value": value, "source": "assumed: test"}
    return yaml.safe_dump(config, sort_keys=False)


class Project:
    """A copy of the project; every question is answered from its files as they then are."""

    def __init__(self, folder: Path):
        self.folder, self._texts = folder, {}
        self.before = self.jobs()

    def jobs(self, **config) -> dict[str, Job]:
        memory, scripts = self.folder / ".cache" / "fingerprints.json", self.folder / "workflow" / "scripts"
        sources = Fingerprints(memory, self.folder / "src", scripts)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(products, "fingerprints_of", lambda root: sources)
            models = {slug: input_model(slug) for slug in SLUGS}
            studies = load_studies(models, self.folder, {"size": "smoke", "chunks": 3, **config})
            papers = {slug: catalogue(slug) for slug in SLUGS}
            found = jobs_of(products.Products(self.folder, papers, studies, comparisons(), "smoke"))
        if not self._texts:
            sources.save()
        return found

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a text that occurs exactly once in a file."""
        text = (self.folder / name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name} holds {old!r} {text.count(old)} times"
        self.write(name, text.replace(old, new))

    def write(self, name: str, text: str) -> None:
        path = self.folder / name
        self._texts.setdefault(path, path.read_text(encoding="utf-8"))
        path.write_text(text, encoding="utf-8")

    def set_inputs(self, reading: str, *, paper: str = "powered_descent", **values: object) -> None:
        """Set inputs of a reading; names without the section's."""
        self.write(f"configs/{paper}.yaml", with_inputs(self.folder, paper, reading, **values))

    def edited(self, **config) -> Edited:
        """Which jobs of now are not those of before the edits."""
        now, none = self.jobs(**config), Job("", "", "", "", "")
        changed = [job for key, job in now.items() if job.own != self.before.get(key, none).own]
        return Edited(
            tuple(changed), tuple(job for key, job in now.items() if job.recipe != self.before.get(key, none).recipe)
        )

    def restore(self) -> None:
        for path, text in self._texts.items():
            path.write_text(text, encoding="utf-8")
        self._texts = {}


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    root, folder = Path(__file__).parents[2], tmp_path_factory.mktemp("reruns") / "project"
    for name in ("src", "configs", "workflow/scripts", "data/published", "data/atmosphere", "data/reference"):
        shutil.copytree(root / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "CITATION.cff", folder)
    return Project(folder)


@pytest.fixture
def project(sources):
    yield sources
    sources.restore()


def test_comments_docstrings_and_messages_of_the_machinery_rerun_nothing(project):
    project.edit(PHYSICS, '    """Norm of the thrust, ||u|| (Eq. 2)', '\n\n    """Size of the thrust, ||u|| (Eq. 2)')
    project.edit("workflow/scripts/stage.py", '"""Run one stage:', '"""Do one stage:')
    project.edit(f"{PACKAGE}/replication/records/store.py", "run snakemake to build it", "snakemake builds it")
    project.edit(
        f"{PACKAGE}/replication/pipeline/numerics.py", "start jobs through snakemake", "jobs start through snakemake"
    )
    for name in [*(f"configs/{slug}.yaml" for slug in SLUGS), PHYSICS, "workflow/scripts/tables.py"]:
        project.write(name, (project.folder / name).read_text(encoding="utf-8") + "\n\n# A comment at the end.\n")
    assert project.edited().rerun == ()


def test_the_format_of_the_machinery_reruns_everything(project, monkeypatch):
    monkeypatch.setattr(products, "FORMAT", products.FORMAT + 1)
    assert len(project.edited().changed) == len(project.before)


def test_an_edited_script_reruns_its_jobs(project):
    project.edit("workflow/scripts/tables.py", "as job:", "as job:\n    pass")
    plan = project.edited()
    assert {job.kind for job in plan.changed} == {"table"}
    assert plan.kinds() == {"table", *SUMMARY}


@pytest.mark.parametrize("slug", SLUGS)
def test_the_physics_of_a_paper_reruns_its_users_and_what_depends_on_them(project, slug):
    edit = FACTS[slug]["physics"]
    project.edit(f"{PACKAGE}/{edit['file']}", edit["old"], edit["new"])
    plan = project.edited()
    assert plan.papers == {slug, *edit.get("shared_with", ())}
    assert plan.stages(slug) == {*edit["rerun"]}
    assert plan.kinds(slug) >= {"figure", *JUDGED}
    assert plan.kinds() >= {"comparison", *CLAIMS}


@pytest.mark.parametrize("slug", SLUGS)
def test_the_code_of_a_stage_is_what_it_can_reach(slug):
    reached = {
        name: {symbol for entry in stage.entries for symbol in fingerprints_of().symbols(entry)}
        for name, stage in catalogue(slug).stages.items()
    }
    for function, users in FACTS[slug]["reach"].items():
        assert {name for name in reached if f"marsedl.{function}" in reached[name]} == set(users), function


def test_the_engine_reruns_the_flights_of_the_papers_that_use_it(project):
    project.edit(f"{PACKAGE}/elementary.py", "s = f / (2.0 + f)", "s = f / (f + 2.0)")  # the logarithm
    plan = project.edited()
    assert plan.papers == {slug for slug in SLUGS if "montecarlo" in catalogue(slug).stages}
    for slug in plan.papers:
        assert {job.kind for job in plan.changed if job.paper == slug} >= {"montecarlo"}
        assert plan.kinds(slug) >= {"figure", *JUDGED}


def test_a_function_of_one_stage_reruns_that_stage_and_what_shows_it(project):
    project.edit(
        f"{PACKAGE}/papers/powered_descent/beyond/algorithm_1.py",
        '"diverged: an iterate is not finite"',
        '"diverged: some iterate is not finite"',
    )
    plan = project.edited()
    assert {job.kind for job in plan.changed} == {"fixed_point", "universes", POINTS}
    assert plan.stages() == {"fixed_point"}
    assert plan.papers == {"powered_descent"}
    assert plan.kinds() <= {"fixed_point", "figure", "table", POINTS, *CLAIMS}


def test_a_figure_of_its_own_reruns_alone(project):
    project.edit(f"{PACKAGE}/papers/powered_descent/figures.py", '"position gain"', '"gain of position"')
    plan = project.edited()
    assert plan.kinds() == {"figure", *SUMMARY}
    assert plan.shown == {"fig06a"}


def test_a_statistic_of_claims_reruns_no_artifact(project):
    project.edit(STATISTICS, "return np.sqrt(variance_of_covariance)", "return np.sqrt(1.0 * variance_of_covariance)")
    plan = project.edited()
    assert plan.kinds() >= CLAIMS
    assert plan.stages() == set()


def test_an_upgraded_library_reruns_what_uses_it_and_says_so(project, tmp_path, monkeypatch):
    """As its installer leaves it, in the first folder that Python looks into: the solver of the cone programs."""
    metadata = tmp_path / "clarabel-99.0.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text("Metadata-Version: 2.1\nName: clarabel\nVersion: 99.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for function in (versions_used, _version):
        function.cache_clear()
    plan = project.edited()
    for function in (versions_used, _version):
        function.cache_clear()
    assert plan.stages("powered_descent") == {"certificates"}
    assert plan.kinds("powered_descent") <= {"certificates", "table", POINTS, *JUDGED}


def test_a_word_about_a_printed_value_reruns_the_claims_and_no_artifact_universe_or_point(project):
    name = "data/published/powered_descent.yaml"
    project.write(name, (project.folder / name).read_text(encoding="utf-8") + "\n# A comment.\n")
    plan = project.edited()
    assert plan.kinds() >= CLAIMS
    assert plan.kinds().isdisjoint({POINTS})
    assert {job.name for job in plan.rerun if job.kind == "universes"} == {"powered_descent_what_decides"}
    assert plan.stages() == set()
    assert plan.papers == {"powered_descent"}


@pytest.mark.parametrize(
    ("paper", "module", "old", "new"),
    [
        ("powered_descent", "sec5_example", "The printed downrange variance fits", "It fits"),
        ("desensitized", "sec4_1_table3", "absolute=(0.0044, ", "absolute=(0.0088, "),
    ],
    ids=["word", "tolerance"],
)
def test_what_is_said_of_a_claim_reruns_its_papers_verdicts_and_computes_nothing(project, paper, module, old, new):
    project.edit(f"{PACKAGE}/papers/{paper}/claims/{module}.py", old, new)
    plan = project.edited()
    assert plan.kinds() == CLAIMS
    assert {job.name for job in plan.rerun if job.kind == "universes"} == {f"{paper}_what_decides"}
    assert plan.papers == {paper}


def test_an_input_of_figures_reruns_no_artifact(project):
    project.set_inputs("corrected", ellipse_sigma=2.5)
    plan = project.edited()
    assert plan.shown == {"fig02", "fig03"}
    assert plan.kinds() == {"figure", POINTS, *CLAIMS}


def test_the_number_of_drawn_trials_reruns_the_flights(project):
    project.set_inputs("corrected", drawn_trials=15)
    plan = project.edited()
    assert plan.stages() == {"montecarlo"}
    assert not plan.readings & {"printed"}
    assert plan.shown.isdisjoint({"fig02", "fig06a"})


def test_one_readings_input_leaves_the_other_readings_alone(project):
    project.set_inputs("corrected", noise_coefficient=0.03)
    plan = project.edited()
    assert plan.papers == {"powered_descent"}
    assert plan.readings == {"corrected"}
    assert plan.stages() >= {"gains", "linearization", "nominal", "montecarlo"}


def test_a_limit_of_the_stochastic_law_reruns_no_nominal_and_no_linear_model(project):
    project.set_inputs("corrected", paper="stochastic_entry", altitude_limit=2500.0)
    plan = project.edited()
    assert plan.papers == {"stochastic_entry"}
    assert plan.stages() >= {"gains", "certificates", "tradeoff", "montecarlo"}
    assert plan.stages().isdisjoint({"nominal", "linearization"})
    assert "printed" not in plan.readings
    assert plan.shown.isdisjoint({"fig01", "fig02", "fig03", "fig04", "fig05", "fig06", "fig07", "tab02", "zf"})


def test_the_double_integrator_and_the_aerocapture_do_not_rerun_each_other(project):
    project.set_inputs("corrected", paper="random_field", double_integrator_period=0.4)
    plan = project.edited()
    assert plan.papers == {"random_field"}
    assert plan.stages() == {"double_integrator", "double_integrator_flights"}
    assert plan.shown >= {"fig04", "fig05"}
    assert plan.shown.isdisjoint({"fig09", "fig10", "fig12", "fig15"})


def test_a_density_table_is_an_input_by_its_numbers(project):
    """The file is read when the configuration is: an edited number reruns its readings, other text of it nothing."""
    name = "data/atmosphere/mars_density.csv"
    text = (project.folder / name).read_text(encoding="utf-8")
    project.write(name, "# A comment.\n" + text)
    assert project.edited().rerun == ()
    reading = next(line for line in text.splitlines() if line.startswith("marsgram_2021a_sample_daily_mean,"))
    mine = {"random_field": {"readings": {"mine": {"based_on": "marsgram_daily_mean"}}}}
    before = project.jobs(**mine)
    project.write(name, text.replace(reading, reading.replace("e-", "1e-", 1)))  # one more digit
    moved = [job for key, job in project.jobs(**mine).items() if job.recipe != before[key].recipe and "/" in job.name]
    assert {(job.paper, job.name.split("/")[0]) for job in moved} == {("random_field", "marsgram_daily_mean")}, (
        "whose files mine shares"
    )
    assert {job.kind for job in moved} >= {"nominal", "linearization", "gains", "montecarlo"}


def test_the_number_of_chunks_is_no_part_of_a_recipe(project):
    assert project.edited(chunks=1).rerun == ()


# ------------------------------------------------------------------------------------------------- as Snakemake plans


def test_a_copy_of_a_build_has_nothing_to_do(copied):
    """Whatever the times of its files: products first and sources last, so that by them everything is out of date."""
    files = sorted(path for path in copied.folder.rglob("*") if path.is_file() and ".snakemake" not in path.parts)
    for number, path in enumerate(sorted(files, key=lambda path: path.suffix in (".py", ".smk", ".yaml"))):
        os.utime(path, ns=(time.time_ns() - 10**12 + number,) * 2)
    assert copied.plan("all").rules == set()


def test_a_plan_writes_nothing_and_needs_no_records_of_snakemake(small):
    """Twice the same jobs of an edit, from the recipes of what was built; what Snakemake itself keeps is its own."""

    def files():
        paths = (path for path in small.folder.rglob("*") if path.is_file() and ".snakemake" not in path.parts)
        return {path: path.stat().st_mtime_ns for path in paths}

    small.edit("configs/hypersonic_glide.yaml", "initial_velocity: {value: -20.0", "initial_velocity: {value: -21.0")
    small.plan("hypersonic_glide")  # which keeps the fingerprints of the source
    before = files()
    with_records = small.plan("hypersonic_glide")
    assert with_records.artifacts >= {"corrected/gains", "corrected/montecarlo.closed_loop"}
    shutil.rmtree(small.build / ".snakemake")
    assert small.plan("hypersonic_glide").outputs == with_records.outputs
    assert files() == before


def test_a_build_without_the_records_of_snakemake_knows_what_it_was_made_from(copied):
    """Nothing to do; after an edit exactly the jobs of the edit, and no command that takes the old numbers for new."""
    kept = copied.build / ".snakemake"
    changed = with_inputs(copied.folder, "powered_descent", "corrected", ellipse_sigma=2.5)
    copied.path(CONFIG).write_text(changed, encoding="utf-8")
    with_records = copied.plan("all")
    drawn = {Path(name).stem for name in with_records.files if re.fullmatch(r"figures/\w+/\w+\.png", name)}
    assert drawn == {"fig02", "fig03", "headline"}
    shutil.rmtree(kept)
    assert copied.plan("all").outputs == with_records.outputs
    for command in ("verify", "accept"):
        process = copied.marsedl(command, "--reference", "mine", "--size", "smoke", "--paper", "powered_descent")
        assert process.returncode == 3
        assert "report/claims/powered_descent.json" in process.stderr
        assert process.stderr.endswith("run 'snakemake report/claims/powered_descent.json --config size=smoke'\n")
