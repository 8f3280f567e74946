# Configuration, validated before any job is planned, and the small vocabulary that the rules are written in.
import contextlib
import functools
import hashlib
import re
import sys
from types import SimpleNamespace

from marsedl.comparison import COMPARISONS
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import command_line
from marsedl.replication.code_digest import remembered_digests
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import (
    committed_inputs,
    counted_inputs,
    load_studies,
)
from marsedl.replication.jobs import pretended_machine
from marsedl.replication.libraries import versions_used
from marsedl.replication.recipes import recipe_digest
from marsedl.replication.sizes import build_folder

ROOT = Path(workflow.basedir)
SIZE = str(config.get("size", "full"))
DIGESTS = remembered_digests(ROOT)
PAPERS = {slug: catalogue(slug) for slug in SLUGS}
DEFAULT = "corrected"

try:
    MODELS = {slug: input_model(slug) for slug in SLUGS}
    # A job of a smaller size may begin in the folder of its build.
    with contextlib.chdir(ROOT):
        STUDIES = load_studies(MODELS, Path("configs"), config, workflow.configfiles)
    COMMITTED = committed_inputs(ROOT)
except InputError as error:
    sys.exit(f"\nmarsedl: {error}\n")

# Every size but the full one has a folder of its own, so that it never touches full results.
if SIZE != "full":

    workdir: build_folder(ROOT, SIZE)


wildcard_constraints:
    paper="|".join(SLUGS),
    reading="|".join(
        sorted({name for study in STUDIES.values() for name in study.readings})
    ),
    case="[a-z_]+",
    chunk=r"0|[1-9]\d*",
    chunks=r"[1-9]\d*",
    stem="[a-z0-9_]+",


def source(path):
    """A file of the project, from the folder that this size is built in."""
    return path if SIZE == "full" else f"../../{path}"


def cached(paper, name):
    """The file of an artifact, for any reading."""
    return f"data/cache/{paper}/{{reading}}/{name}.h5"


def needs(paper, name):
    """Input files of a stage, by the name of the function's parameter."""
    return {
        need.split(".")[-1]: cached(paper, need)
        for need in PAPERS[paper].stages[name].needs
    }


def code_of(entry, script):
    """Digest of the code that a job can reach: its script and its function."""
    return f"{script_of(script)} {DIGESTS.code(entry)[:16]}"


@functools.cache
def libraries_of(script, *entries):
    """Versions of the libraries that a job's numbers can depend on: those that its script and its functions use."""
    used = [DIGESTS.script_libraries(script), *map(DIGESTS.libraries, entries)]
    return versions_used(frozenset().union(*used))


def stage(paper, name):
    """The params of a stage's rule."""
    entry = PAPERS[paper].entry(name)
    inputs = PAPERS[paper].stages[name].inputs
    return dict(
        paper=paper,
        entry=entry,
        inputs=lambda wildcards: STUDIES[paper]
        .readings[wildcards.reading]
        .slice(inputs),
        code=code_of(entry, "stage.py"),
        libraries=libraries_of("stage.py", entry),
        build=build,
    )


def cases(paper, reading):
    """The Monte Carlo cases of a reading with their numbers of trials; a case without trials is left out."""
    return STUDIES[paper].readings[reading].flown()


def number_of_chunks(paper, reading, case):
    """The chunks that a Monte Carlo case is scattered into."""
    study = STUDIES[paper]
    return command_line.number_of_chunks(
        PAPERS[paper], study, study.readings[reading], case
    )


def chunk_files(paper):
    """The files of all chunks of a Monte Carlo case."""

    def files(wildcards):
        chunks = number_of_chunks(paper, wildcards.reading, wildcards.case)
        pattern = f"data/cache/{paper}/{{reading}}/chunks/{{case}}.{{k}}of{chunks}.h5"
        return expand(
            pattern, reading=wildcards.reading, case=wildcards.case, k=range(chunks)
        )

    return files


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


def trial_options(paper):
    """The options of a job that flies a whole Monte Carlo case."""
    return lambda wildcards: dict(
        case=wildcards.case,
        trials=cases(paper, wildcards.reading)[wildcards.case],
        block_size=PAPERS[paper].trials_per_block,
    )


def chunk_options(paper):
    """The options of a job that flies one chunk of a case."""
    return lambda wildcards: dict(
        **trial_options(paper)(wildcards),
        chunk=int(wildcards.chunk),
        chunks=int(wildcards.chunks),
    )


def gathered_from(paper, stage):
    """Inputs and code of a case's chunks, for the job that gathers them: chunks are temporary and leave no record."""
    names = PAPERS[paper].stages[stage].inputs
    return lambda wildcards: dict(
        inputs=STUDIES[paper].readings[wildcards.reading].slice(names),
        trials=cases(paper, wildcards.reading)[wildcards.case],
        code=code_of(PAPERS[paper].entry(stage), "stage.py"),
        libraries=libraries_of("stage.py", PAPERS[paper].entry(stage)),
    )


@functools.cache
def recipe(path):
    """Paper, reading and recipe of an artifact: what it would be made from now."""
    paper, reading, *_, file = path.rpartition("data/cache/")[2].split("/")
    name, _, part = file.removesuffix(".h5").partition(".")
    wildcards, options, files = SimpleNamespace(reading=reading), {}, []
    if "/chunks/" in path:
        wildcards.case, (wildcards.chunk, wildcards.chunks) = name, part.split("of")
        name, options = "montecarlo_chunk", chunk_options(paper)(wildcards)
    elif part:
        wildcards.case = part
        if re.fullmatch(cases_of(paper, scattered=True), part):
            name, files = "montecarlo_gather", chunk_files(paper)(wildcards)
        else:
            options = trial_options(paper)(wildcards)
    params = stage(paper, name)
    files = [*needs(paper, name).values(), *files]
    made_from = [file.format(reading=reading) for file in files]
    return (
        paper,
        reading,
        dict(
            inputs=params["inputs"](wildcards),
            options=options,
            code=params["code"],
            libraries=params["libraries"],
            needs={
                Path(file).name: recipe_digest(recipe(file)[2]) for file in made_from
            },
        ),
    )


# Functions that take `input` as well are no reason to run a job again: an artifact whose recipe has changed is made
# again itself.


def build(wildcards, input):
    """The size of the build, and paper, reading and recipe of each artifact that a job is given, by file."""
    artifacts = {path: recipe(path) for path in input if path.endswith(".h5")}
    return dict(size=SIZE, artifacts=artifacts)


def drawn_from(paper, stem, reading):
    """Input files of a figure or table."""
    needed = PAPERS[paper].product(stem).needs
    return {
        need.split(".")[-1]: cached(paper, need).format(reading=reading)
        for need in needed
    }


def product(kind, script, reading=None):
    """The params of a figure's or table's rule, for a fixed reading or that of the wildcards."""

    def inputs(wildcards):
        names = PAPERS[wildcards.paper].product(wildcards.stem).inputs
        return (
            STUDIES[wildcards.paper].readings[reading or wildcards.reading].slice(names)
        )

    def code(wildcards):
        return code_of(
            f"marsedl.papers.{wildcards.paper}.{kind}:{wildcards.stem}", script
        )

    def libraries(wildcards):
        return libraries_of(
            script, f"marsedl.papers.{wildcards.paper}.{kind}:{wildcards.stem}"
        )

    def printed(wildcards):
        shown = PAPERS[wildcards.paper].product(wildcards.stem).published
        return (
            file_digest(source(f"data/published/{wildcards.paper}.yaml"))
            if shown
            else ""
        )

    return dict(
        paper=lambda wildcards: wildcards.paper,
        reading=lambda wildcards: reading or wildcards.reading,
        inputs=inputs,
        code=code,
        libraries=libraries,
        build=build,
        published=lambda wildcards: source(f"data/published/{wildcards.paper}.yaml"),
        printed=printed,
    )


def artifacts(paper, reading):
    """All artifacts of a reading that its claims use, by name."""
    stages = [
        name
        for name, stage in PAPERS[paper].stages.items()
        if not name.startswith("montecarlo")
        and reading in (stage.claimed_in or [reading])
    ]
    names = stages + [f"montecarlo.{case}" for case in cases(paper, reading)]
    return {
        name.split(".")[-1]: cached(paper, name).format(reading=reading)
        for name in names
    }


def products(paper):
    """All figures and tables of a paper that `snakemake all` makes."""
    catalogue = PAPERS[paper]
    tables = [*catalogue.tables, *catalogue.summaries, "claims"]
    return [
        f"figures/{paper}/{stem}.{ext}"
        for stem in catalogue.figures
        for ext in ("png", "pdf")
    ] + [f"figures/{paper}/{stem}.{ext}" for stem in tables for ext in ("csv", "md")]


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


def script_of(script):
    """Digest of the code that a script without a paper's function can reach, and the machine it runs on if unpinned."""
    return f"{DIGESTS.script(script)[:16]} {pretended_machine()}".strip()


def as_committed(paper):
    """Whether verdicts count: the full size, with the inputs that the committed verdicts were found with."""
    return SIZE == "full" and COMMITTED.get(paper) == counted_inputs(STUDIES[paper])


def claims_entries(paper):
    """A paper's evaluators, its statements about claims, and its tables over all readings."""
    names = ["claims:evaluate", "claims:DECLARATIONS"]
    names += [f"tables:{stem}" for stem in PAPERS[paper].summaries]
    return [f"marsedl.papers.{paper}.{name}" for name in names]


def claims_code(paper):
    """Digest of the code that judges a paper's claims."""
    digests = [DIGESTS.code(entry)[:16] for entry in claims_entries(paper)]
    return " ".join([script_of("claims.py"), *digests])


def file_digest(path):
    """Digest of a file that a job reads beside its inputs; empty if there is none."""
    path = Path(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""


def cache(paper):
    """All artifacts of a paper that its claims use."""
    return [
        path
        for reading in STUDIES[paper].compared
        for path in artifacts(paper, reading).values()
    ]


def compared():
    """All figures and tables of the comparison across papers."""
    return [
        f"figures/comparison/{stem}.{ext}"
        for stem in COMPARISONS
        for ext in ("png", "pdf", "csv", "md")
    ]


def compared_artifacts(stem):
    """Artifacts of a comparison by paper, by parameter; a Monte Carlo case without trials is left out."""
    found = {}
    for paper, needed in COMPARISONS[stem].needs.items():
        flown = cases(paper, DEFAULT)
        found[paper] = {
            need.split(".")[-1]: cached(paper, need).format(reading=DEFAULT)
            for need in needed
            if not need.startswith("montecarlo.") or need.split(".")[1] in flown
        }
    return found


def comparison_params():
    """The params of a comparison's rule."""

    def inputs(wildcards):
        return {
            paper: STUDIES[paper].readings[DEFAULT].slice(names)
            for paper, names in COMPARISONS[wildcards.stem].inputs.items()
        }

    def entries(wildcards):
        names = ("figure", "table", *COMPARISONS[wildcards.stem].papers)
        return [f"marsedl.comparison.{wildcards.stem}:{name}" for name in names]

    def code(wildcards):
        digests = [DIGESTS.code(entry)[:16] for entry in entries(wildcards)]
        return " ".join([script_of("comparison.py"), *digests])

    def libraries(wildcards):
        return libraries_of("comparison.py", *entries(wildcards))

    def measured(wildcards):
        shown = COMPARISONS[wildcards.stem].measured
        return file_digest(source("data/reference/benchmarks.csv")) if shown else ""

    return dict(
        reading=DEFAULT,
        inputs=inputs,
        artifacts=lambda wildcards: compared_artifacts(wildcards.stem),
        code=code,
        libraries=libraries,
        build=build,
        benchmarks=source("data/reference/benchmarks.csv"),
        measured=measured,
    )


def as_rst(text):
    """A text in which nothing is markup, for the captions of `snakemake --report`."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


# Functions that take `output` as well are no reason to run a job again: an edited caption is not an edited figure.


def caption_of_product(wildcards, output):
    """Caption of a paper's figure or table."""
    return as_rst(PAPERS[wildcards.paper].product(wildcards.stem).caption)


def caption_of_comparison(kind):
    """Caption of the figure or the table of a comparison."""
    return lambda wildcards, output: as_rst(getattr(COMPARISONS[wildcards.stem], kind))


def shown_in_report(path, kind, reading=None):
    """Mark a paper's product for `snakemake --report`: under its paper, found by reading and item."""
    return report(
        path,
        caption=f"../report/{kind}.rst",
        category="{paper}",
        subcategory=reading or "{reading}",
        labels={"reading": reading or "{reading}", "item": "{stem}", "kind": kind},
    )
