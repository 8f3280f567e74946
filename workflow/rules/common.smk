# The configuration, validated before any job is planned, and the functions that the rules are written with.
import atexit
import csv
import os
import sys
import time

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.pipeline.catalogue import CHUNK, FLIGHTS, GATHER
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.inputs.readings import SETTINGS, load_studies
from marsedl.replication.claims.quotes import Quotes, with_numbers
from marsedl.replication.pipeline.numerics import check_start
from marsedl.replication.report.files import HEADLINE, site_files, universe_pictures
from marsedl.replication.report.texts import check_found
from marsedl.replication.sizes import build_folder
from marsedl.replication.pipeline.staleness import ARTIFACTS, BENCHMARKS, Recipes
from marsedl.replication.pipeline.targets import check_targets

ROOT = Path(workflow.current_basedir).parents[1]
# Another workflow may use these rules as a module: its words, files and further keys are its own.
IS_MAIN = workflow.modifier.is_main_snakefile()
OWN_CONFIG = dict(config) if IS_MAIN else {key: config[key] for key in (*SLUGS, *SETTINGS) if key in config}
OWN_FILES = workflow.configfiles if IS_MAIN else []
SIZE = str(OWN_CONFIG.get("size", "full"))


def from_start(path):
    """A user's file, from the project's folder, or else from where Snakemake was started."""
    return Path(ROOT, path) if Path(ROOT, path).exists() else Path(workflow.workdir_init, path)


try:
    PAPERS = {slug: catalogue(slug) for slug in SLUGS}
    COMPARISONS = comparisons()
    MODELS = {slug: input_model(slug) for slug in SLUGS}
    STUDIES = load_studies(MODELS, ROOT, OWN_CONFIG, [from_start(path) for path in OWN_FILES])
    HEADLINES = {slug: read_yaml(ROOT / f"data/published/{slug}.yaml").get("headline", ()) for slug in SLUGS}
    for slug, study in STUDIES.items():  # texts that quote numbers of a reading that there is not
        with_numbers(PAPERS[slug], Quotes(None, study.readings))
        check_found(PAPERS[slug], HEADLINES[slug])
except InputError as error:
    sys.exit(f"\nmarsedl: {error}\n")
# Every size but the full one has a folder of its own, so that it never touches full results.
if SIZE != "full":

    workdir: build_folder(ROOT, SIZE)


try:
    check_start()  # where the jobs will run
    for _path in ("data/cache/", "figures/", "report/"):
        if workflow.modifier.path_modifier.modify(_path) != _path:
            raise InputError(
                f"{_path} would be elsewhere, by a module's prefix or a default storage: no job finds what it takes there; "
                "leave that out, and build into another folder with 'snakemake --directory FOLDER'"
            )
except MarsedlError as error:
    sys.exit(f"\nmarsedl: {error}\n")


wildcard_constraints:
    paper="|".join(SLUGS),
    reading="[a-z0-9_]+",
    # The folder of a reading's figures and tables; those of the default reading stand above it.
    place="([a-z0-9_]+/)?",
    name=r"[a-z0-9_]+(\.[a-z_]+)?",
    case="[a-z_]+",
    whole="(whole/)?",
    chunk=r"0|[1-9]\d*",
    chunks=r"[1-9]\d*",


RECIPES = Recipes(ROOT, PAPERS, STUDIES, COMPARISONS, SIZE)
with open(ROOT / "data/reference/costs.csv", encoding="utf-8", newline="") as _file:
    # Seconds of the longest job of each kind.
    LONGEST = {(row["where"], row["what"]): int(row["longest_s"] or 0) for row in csv.DictReader(_file)}
SHARED = RECIPES.shared
# Newer than every product, for the jobs whose products are stale: Snakemake's own records may be lost.
CHANGED = Path(".cache/changed")
STALE = {}  # artifacts that are not up to date for a reason of their own, by the reason


@atexit.register  # of a dry run, which does not start
def say_why():
    """Say once what is made again, and why."""
    for why, artifacts in STALE.items():
        print(f"not up to date ({why}): {', '.join(artifacts)}", file=sys.stderr)
    STALE.clear()


def source(path):
    """A file of the project, from the folder that is built in."""
    return os.path.relpath(Path(os.path.realpath(ROOT), path), os.path.realpath(Path.cwd()))


def filled(pattern, wildcards):
    """A pattern with the values of the wildcards."""
    return pattern.format(**dict(wildcards.items()))


def inputs(*products, files=True):
    """What the job of some products takes: other products, files of the project, and one that is newer if it must run.

    A job with temporary products takes no files: of products that are gone Snakemake knows no checksums of these, so that
    by their times it would run again in every copy of a build.
    """

    def taken(wildcards):
        paths = [filled(product, wildcards) for product in products]
        try:
            job = RECIPES.job(paths[0])
        except InputError as error:  # a file of the project that is gone
            sys.exit(f"\nmarsedl: {error}\n")
        stale = [path for path in paths if RECIPES.is_stale(path, Path())]
        for path in stale:
            if path.startswith(ARTIFACTS) and (why := RECIPES.own_changes(path, Path())):
                STALE.setdefault(why, []).append(path)
        if stale or not CHANGED.exists():
            CHANGED.parent.mkdir(parents=True, exist_ok=True)
            CHANGED.write_text(f"{time.time_ns()}\n")
        shows_printed = job.own.get("printed") or job.own.get("published")
        return {
            "needs": list(job.needs),
            "published": [source(f"data/published/{wildcards.paper}.yaml")] if files and shows_printed else [],
            "measured": [source(BENCHMARKS)] if files and job.own.get("measured") else [],
            "files": [source(name) for name in job.own.get("files", ())] if files else [],
            "changed": local(str(CHANGED) if stale else ancient(str(CHANGED))),
        }

    return taken


def priority(what, first=0):
    """How early a job starts: long ones before short ones, so that the cores end together."""
    return lambda wildcards: first + LONGEST.get((wildcards.paper, filled(what, wildcards).partition(".")[0]), 0)


def made(product, recorded=True):
    """What a job is given beside files, and where it records what its products are made from."""

    def given(wildcards):
        path = filled(product, wildcards)
        return RECIPES.job(path).own | ({"record": RECIPES.record(path)} if recorded else {})

    return given


# --- stages

SHOWN = 10_000  # priority of what a figure waits for, before what is computed in memory


def staged(stage, *artifacts):
    """What the job of a stage is given beside files: its functions, and what each artifact is made from."""

    def given(wildcards):
        declared = PAPERS[wildcards.paper].stages[filled(stage, wildcards).partition(".")[0]]
        recipes = [RECIPES.job(filled(artifact, wildcards)).own for artifact in artifacts]
        users = wildcards.reading in STUDIES[wildcards.paper].own_readings
        return {"entries": declared.entries, "recipes": recipes, "size": SIZE, "users": users}

    return given


def chunks(wildcards):
    """The files of all chunks of a Monte Carlo case."""
    names = SHARED[wildcards.paper].chunks(wildcards.reading, wildcards.case)
    return [f"data/cache/{wildcards.paper}/{wildcards.reading}/{name}.h5" for name in names]


def flights(paper, cases, readings="[^/]+"):
    """Paths of flights below data/cache, as a regular expression."""
    return rf"{paper}/({readings})/{FLIGHTS}\.({'|'.join(cases)})\.h5"


# Paper, cases and readings, as a regular expression, of the flights that one job of a reading makes.
TOGETHER = [
    (paper, cases, "|".join(readings)) for paper in PAPERS for cases, readings in SHARED[paper].flown_together().items()
]
SCATTERED = "|".join(flights(paper, shared.scattered) for paper, shared in SHARED.items() if shared.scattered) or "(?!)"


# --- universes

# Names of the pictures of the universes of each paper.
UNIVERSE_PICTURES = {slug: list(universe_pictures(headline)) for slug, headline in HEADLINES.items()}


def universe_chunks(wildcards):
    """The files of all chunks of a paper's universes; a sample of the committed run is one."""
    path = f"report/universes/{wildcards.whole}{wildcards.paper}"
    is_sample = "sample" in RECIPES.job(f"{path}.h5").own
    chunks = 1 if is_sample else STUDIES[wildcards.paper].universe_jobs
    return [f"{path}.{chunk}of{chunks}.h5" for chunk in range(chunks)]
