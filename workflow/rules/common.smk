# Configuration, validated before any job is planned, and the small vocabulary that the rules are written in.
import contextlib
import functools
import hashlib
import os
import re
import sys

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import command_line
from marsedl.replication.catalogue import CHUNK, FLIGHTS, GATHER
from marsedl.replication.claims import read_claims
from marsedl.replication.code_digest import remembered_digests
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs import SETTINGS, committed_inputs, counted_inputs, load_studies
from marsedl.replication.libraries import versions_used
from marsedl.replication.quotes import Quotes, by_id, with_numbers
from marsedl.replication.sharing import Shared
from marsedl.replication.site import site_files
from marsedl.replication.sizes import build_folder
from marsedl.replication.texts import FILE as TEXTS

ROOT = Path(workflow.current_basedir).parents[1]
# Another workflow may use these rules as a module: its words, files and further keys are its own.
IS_MAIN = workflow.modifier.is_main_snakefile()
WORDS = command_line.words_of(sys.argv) if IS_MAIN else []
OWN_CONFIG = dict(config) if IS_MAIN else {key: config[key] for key in (*SLUGS, *SETTINGS) if key in config}
OWN_FILES = workflow.configfiles if IS_MAIN else []
SIZE = str(OWN_CONFIG.get("size", "full"))
DIGESTS = remembered_digests(ROOT)
DEFAULT = "corrected"
BENCHMARKS = "data/reference/benchmarks.csv"


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
    COMMITTED = committed_inputs(ROOT)
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


def file_digest(path):
    """Digest of a file that a job reads beside its inputs; empty if there is none."""
    path = Path(source(path))
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""


@functools.cache
def code(script, *entries):
    """Digests of the code that a job can reach: its script and its functions."""
    return " ".join(d[:16] for d in [DIGESTS.script(script), *map(DIGESTS.code, entries)])


@functools.cache
def libraries(script, *entries):
    """Versions of the libraries that a job's numbers can depend on: those that its script and its functions use."""
    used = [DIGESTS.script_libraries(script), *map(DIGESTS.libraries, entries)]
    return versions_used(frozenset().union(*used))


def code_of_stage(entries):
    """What the recipe of an artifact holds of the code that makes it, and of its libraries."""
    return dict(code=code("stage.py", *entries), libraries=libraries("stage.py", *entries))


SHARED = {slug: Shared(PAPERS[slug], STUDIES[slug], code_of_stage) for slug in SLUGS}


def given(paper, reading, names):
    """Inputs of a reading by "section.name"."""
    return STUDIES[paper].readings[reading].slice(names)


def files(paper, reading, needs, optional=()):
    """Artifact files by the name of the parameter that takes them, whichever reading owns them."""
    return SHARED[paper].files(reading, needs, optional)


def claimed(paper, reading):
    """All artifacts of a reading that its claims use, by the name of the parameter that takes them."""
    artifacts = SHARED[paper].claimed(reading)
    return {name.split(".")[-1]: path for name, path in artifacts.items()}


def cache(paper):
    """All artifacts of a paper that its claims use."""
    return sorted({path for reading in STUDIES[paper].compared for path in claimed(paper, reading).values()})


def filled(pattern, wildcards):
    """A pattern with the values of the wildcards."""
    return pattern.format(**dict(wildcards.items()))


def recipe(path):
    """Paper, reading and recipe of an artifact: what it would be made from now."""
    paper, reading, name = path.rpartition("data/cache/")[2].removesuffix(".h5").split("/", 2)
    return paper, reading, SHARED[paper].recipe(reading, name)


# Functions that take `input` as well are no reason to run a job again: an artifact whose recipe has changed is made
# again itself. Nor are those that take `output`: an edited caption is not an edited figure.


def build(wildcards, input):
    """The size of the build, and paper, reading and recipe of each artifact that a job is given, by file."""
    artifacts = {path: recipe(path) for path in input if path.endswith(".h5")}
    return dict(size=SIZE, artifacts=artifacts)


def reached(script, entries):
    """The params that every job has: digests of its code, libraries, artifacts; entries: function of the wildcards."""
    return dict(
        code=lambda wildcards: code(script, *entries(wildcards)),
        libraries=lambda wildcards: libraries(script, *entries(wildcards)),
        build=build,
    )


def products(paper):
    """All figures and tables of a paper that `snakemake all` makes."""
    catalogue = PAPERS[paper]
    tables = [*catalogue.tables, *catalogue.summaries, "claims"]
    return [f"figures/{paper}/{stem}.{ext}" for stem in catalogue.figures for ext in ("png", "pdf")] + [
        f"figures/{paper}/{stem}.{ext}" for stem in tables for ext in ("csv", "md")
    ]


def compared():
    """All figures and tables of the comparison across papers."""
    return [f"figures/comparison/{stem}.{ext}" for stem in COMPARISONS for ext in ("png", "pdf", "csv", "md")]


def described(paper):
    """A paper's readings for the report: what they are for, and every input as it is written, with its source."""
    return {
        name: dict(
            summary=reading.summary,
            based_on=reading.based_on,
            frozen=bool(reading.frozen),
            inputs={field: [source.key, source.written, source.source] for field, source in reading.sources.items()},
        )
        for name, reading in STUDIES[paper].readings.items()
    }


def as_committed(paper):
    """Whether verdicts count: the full size, with the inputs that the committed verdicts were found with."""
    return SIZE == "full" and COMMITTED.get(paper) == counted_inputs(STUDIES[paper])


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
