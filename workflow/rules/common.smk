# Configuration, validated before any job is planned, and the small vocabulary that the rules are written in.
import contextlib
import functools
import hashlib
import re
import sys
from types import SimpleNamespace

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import command_line
from marsedl.replication.catalogue import CHUNK, FLIGHTS, GATHER
from marsedl.replication.code_digest import remembered_digests
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import (
    committed_inputs,
    counted_inputs,
    load_studies,
)
from marsedl.replication.jobs import pretended_machine, whole_case
from marsedl.replication.libraries import versions_used
from marsedl.replication.recipes import recipe_digest
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import build_folder

ROOT = Path(workflow.basedir)
SIZE = str(config.get("size", "full"))
DIGESTS = remembered_digests(ROOT)
DEFAULT = "corrected"

try:
    PAPERS = {slug: catalogue(slug) for slug in SLUGS}
    COMPARISONS = comparisons()
    MODELS = {slug: input_model(slug) for slug in SLUGS}
    # A job of a smaller size may begin in the folder of its build.
    with contextlib.chdir(ROOT):
        STUDIES = load_studies(MODELS, Path("configs"), config, workflow.configfiles)
    COMMITTED = committed_inputs(ROOT)
except InputError as error:
    sys.exit(f"\nmarsedl: {error}\n")
SHARED = {slug: Shared(PAPERS[slug], STUDIES[slug]) for slug in SLUGS}

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
    """A file of the project, from the folder that this size is built in."""
    return path if SIZE == "full" else f"../../{path}"


def file_digest(path):
    """Digest of a file that a job reads beside its inputs; empty if there is none."""
    path = Path(source(path))
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""


@functools.cache
def code(script, *entries):
    """Digests of the code that a job can reach: its script and its functions; and the machine if it is unpinned."""
    digests = [DIGESTS.script(script), *map(DIGESTS.code, entries)]
    return " ".join([*(d[:16] for d in digests), pretended_machine()]).strip()


@functools.cache
def libraries(script, *entries):
    """Versions of the libraries that a job's numbers can depend on: those that its script and its functions use."""
    used = [DIGESTS.script_libraries(script), *map(DIGESTS.libraries, entries)]
    return versions_used(frozenset().union(*used))


def given(paper, reading, names):
    """Inputs of a reading by "section.name"."""
    return STUDIES[paper].readings[reading].slice(names)


def cases(paper, reading):
    """The Monte Carlo cases of a reading with their numbers of trials; a case without trials is left out."""
    return STUDIES[paper].readings[reading].flown()


def files(paper, reading, needs, optional=()):
    """Artifact files by the name of the parameter that takes them, whichever reading owns them."""
    flown = cases(paper, reading)
    needs = [*needs, *(need for need in optional if need.partition(".")[2] in flown)]
    return {need.split(".")[-1]: SHARED[paper].file(reading, need) for need in needs}


def claimed(paper, reading):
    """All artifacts of a reading that its claims use, by the name of the parameter that takes them."""
    artifacts = SHARED[paper].claimed(reading)
    return {name.split(".")[-1]: path for name, path in artifacts.items()}


def cache(paper):
    """All artifacts of a paper that its claims use."""
    shared = SHARED[paper]
    return sorted(
        {p for reading in shared.readings for p in shared.claimed(reading).values()}
    )


def number_of_chunks(paper, reading, case):
    """The chunks that a Monte Carlo case is scattered into."""
    study = STUDIES[paper]
    return command_line.number_of_chunks(
        PAPERS[paper], study, study.readings[reading], case
    )


def chunk_files(paper, reading, case):
    """The files of all chunks of a Monte Carlo case."""
    chunks = number_of_chunks(paper, reading, case)
    folder = f"data/cache/{paper}/{reading}/chunks"
    return [f"{folder}/{case}.{k}of{chunks}.h5" for k in range(chunks)]


@functools.cache
def cases_of(paper, scattered):
    """Pattern of the Monte Carlo cases that have several chunks in some reading, or of those that have one in all."""
    readings = STUDIES[paper].readings
    return (
        "|".join(
            case
            for case in MODELS[paper].CASES
            if any(number_of_chunks(paper, name, case) > 1 for name in readings)
            == scattered
        )
        or "(?!)"
    )


def flown(paper, stage, wildcards):
    """The options of a job that flies a whole Monte Carlo case or one chunk of it; none of any other."""
    if stage not in (FLIGHTS, CHUNK):
        return {}
    trials = cases(paper, wildcards.reading)[wildcards.case]
    options = whole_case(wildcards.case, trials, PAPERS[paper])
    if stage == CHUNK:
        options |= dict(chunk=int(wildcards.chunk), chunks=int(wildcards.chunks))
    return options


@functools.cache
def recipe(path):
    """Paper, reading and recipe of an artifact: what it would be made from now."""
    paper, reading, *_, file = path.rpartition("data/cache/")[2].split("/")
    name, _, part = file.removesuffix(".h5").partition(".")
    stage, wildcards, made_from = name, SimpleNamespace(reading=reading), []
    if "/chunks/" in path:
        stage, wildcards.case = CHUNK, name
        wildcards.chunk, wildcards.chunks = part.split("of")
    elif part:
        wildcards.case = part
        if re.fullmatch(cases_of(paper, scattered=True), part):
            stage, made_from = GATHER, chunk_files(paper, reading, part)
    declared = PAPERS[paper].stages[stage]
    made_from = [*files(paper, reading, declared.needs).values(), *made_from]
    return (
        paper,
        reading,
        dict(
            inputs=given(paper, reading, declared.inputs),
            options=flown(paper, stage, wildcards),
            code=code("stage.py", *declared.entries),
            libraries=libraries("stage.py", *declared.entries),
            needs={
                Path(file).name: recipe_digest(recipe(file)[2]) for file in made_from
            },
        ),
    )


# Functions that take `input` as well are no reason to run a job again: an artifact whose recipe has changed is made
# again itself. Nor are those that take `output`: an edited caption is not an edited figure.


def build(wildcards, input):
    """The size of the build, and paper, reading and recipe of each artifact that a job is given, by file."""
    artifacts = {path: recipe(path) for path in input if path.endswith(".h5")}
    return dict(size=SIZE, artifacts=artifacts)


def products(paper):
    """All figures and tables of a paper that `snakemake all` makes."""
    catalogue = PAPERS[paper]
    tables = [*catalogue.tables, *catalogue.summaries, "claims"]
    return [
        f"figures/{paper}/{stem}.{ext}"
        for stem in catalogue.figures
        for ext in ("png", "pdf")
    ] + [f"figures/{paper}/{stem}.{ext}" for stem in tables for ext in ("csv", "md")]


def compared():
    """All figures and tables of the comparison across papers."""
    return [
        f"figures/comparison/{stem}.{ext}"
        for stem in COMPARISONS
        for ext in ("png", "pdf", "csv", "md")
    ]


def described(paper):
    """A paper's readings for the report: what they are for, and every input as it is written, with its source."""
    return {
        name: dict(
            summary=reading.summary,
            based_on=reading.based_on,
            frozen=bool(reading.frozen),
            inputs={
                field: [source.key, source.written, source.source]
                for field, source in reading.sources.items()
            },
        )
        for name, reading in STUDIES[paper].readings.items()
    }


def as_committed(paper):
    """Whether verdicts count: the full size, with the inputs that the committed verdicts were found with."""
    return SIZE == "full" and COMMITTED.get(paper) == counted_inputs(STUDIES[paper])


def as_rst(text):
    """A text in which nothing is markup, for the captions of `snakemake --report`."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)
