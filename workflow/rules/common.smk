# Configuration, validated before any job is planned, and the small vocabulary that the rules are written in.
import contextlib
import functools
import os
import re
import sys
import time

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.pipeline import targets
from marsedl.replication.pipeline.catalogue import CHUNK, FLIGHTS, GATHER
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.readings import SETTINGS, load_studies
from marsedl.replication.claims.quotes import Quotes, by_id, with_numbers
from marsedl.replication.report.pages import site_files
from marsedl.replication.sizes import build_folder
from marsedl.replication.pipeline.staleness import BENCHMARKS, Recipes

ROOT = Path(workflow.current_basedir).parents[1]
# Another workflow may use these rules as a module: its words, files and further keys are its own.
IS_MAIN = workflow.modifier.is_main_snakefile()
WORDS = targets.words_of(sys.argv) if IS_MAIN else []
OWN_CONFIG = dict(config) if IS_MAIN else {key: config[key] for key in (*SLUGS, *SETTINGS) if key in config}
OWN_FILES = workflow.configfiles if IS_MAIN else []
SIZE = str(OWN_CONFIG.get("size", "full"))


def from_start(path):
    """A user's file, from the project's folder, or else from where Snakemake was started."""
    return Path(path) if Path(ROOT, path).exists() else Path(workflow.workdir_init, path)


try:
    PAPERS = {slug: catalogue(slug) for slug in SLUGS}
    COMPARISONS = comparisons()
    MODELS = {slug: input_model(slug) for slug in SLUGS}
    # A job of a smaller size may begin in the folder of its build.
    with contextlib.chdir(ROOT):
        STUDIES = load_studies(MODELS, Path("configs"), OWN_CONFIG, [from_start(path) for path in OWN_FILES])
    for slug, study in STUDIES.items():  # texts that quote numbers of a reading that there is not
        with_numbers(PAPERS[slug], Quotes(None, study.readings))
except InputError as error:
    sys.exit(f"\nmarsedl: {error}\n")
# Every size but the full one has a folder of its own, so that it never touches full results.
if SIZE != "full":

    workdir: build_folder(ROOT, SIZE)


READINGS = sorted({name for study in STUDIES.values() for name in study.readings})


wildcard_constraints:
    paper="|".join(SLUGS),
    reading="|".join(READINGS),
    # The folder of a reading's figures and tables; those of the default reading stand above it.
    place="|".join(["", *(f"{name}/" for name in READINGS)]),
    case="[a-z_]+",
    chunk=r"0|[1-9]\d*",
    chunks=r"[1-9]\d*",
    stem="[a-z0-9_]+",


def source(path):
    """A file of the project, from the folder that is built in."""
    return os.path.relpath(Path(os.path.realpath(ROOT), path), os.path.realpath(Path.cwd()))


RECIPES = Recipes(ROOT, PAPERS, STUDIES, COMPARISONS, SIZE)
SHARED = RECIPES.shared
products, cache, compared, claimed = RECIPES.products, RECIPES.cache, RECIPES.compared, RECIPES.claimed
# Newer than every product, for the jobs whose products are stale: Snakemake's own records may be lost.
CHANGED = Path(".cache/changed")


def unproven(*patterns):
    """An input of all jobs, which makes Snakemake run those whose products were made from something else."""

    def changed(wildcards):
        stale = any(RECIPES.is_stale(filled(pattern, wildcards), Path()) for pattern in patterns)
        if stale or not CHANGED.exists():
            CHANGED.parent.mkdir(parents=True, exist_ok=True)
            CHANGED.write_text(f"{time.time_ns()}\n")
        return local(str(CHANGED) if stale else ancient(str(CHANGED)))

    return changed


def made(pattern):
    """What a job is given beside products: an edit of it makes Snakemake run the job again."""
    return lambda wildcards: RECIPES.job(filled(pattern, wildcards)).own


def filled(pattern, wildcards):
    """A pattern with the values of the wildcards."""
    return pattern.format(**dict(wildcards.items()))


# Snakemake ignores params that depend on `input` or `output` when it decides what to rerun. So the recipes of a job's
# inputs, and captions, never trigger a rerun.


def build(wildcards, input, output):
    """Of a job: the size of the build, its artifacts with paper, reading and recipe, and what its products record."""

    def recipes(paths):
        named = {path: RECIPES.artifact(path) for path in paths if path.endswith(".h5")}
        return {
            path: (paper, reading, SHARED[paper].recipe(reading, name))
            for path, (paper, reading, name) in named.items()
        }

    record = () if output[0].endswith(".h5") else RECIPES.record(output[0])
    return dict(size=SIZE, artifacts=recipes(input), made=recipes(output), record=record)


@functools.cache
def quoting(paper, reading):
    """A paper's catalogue with the numbers that its texts quote, if there are verdicts that they agree with."""
    readings, path = STUDIES[paper].readings, Path(f"report/claims/{paper}.json")
    with contextlib.suppress(MarsedlError):
        if path.exists():
            return with_numbers(PAPERS[paper], Quotes(by_id(read_claims(path)), readings, reading))
    return with_numbers(PAPERS[paper], Quotes(None, readings, reading))


def as_rst(text):
    """A text in which nothing is markup, for the captions of `snakemake --report`."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)
