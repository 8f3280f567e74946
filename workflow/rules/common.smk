# The configuration, validated before any job is planned, and the functions that the rules are written with.
import atexit
import csv
import os
import sys
import tempfile

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.scenarios import arenas
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.inputs.readings import SETTINGS, load_studies
from marsedl.replication.claims.quotes import Quotes, with_numbers
from marsedl.replication.pipeline.numerics import check_start
from marsedl.replication.report.files import HEADLINE, site_files, universe_pictures
from marsedl.replication.report.texts import check_found
from marsedl.replication.sizes import build_folder
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.sharing import ARTIFACTS
from marsedl.replication.pipeline.staleness import changed_apart_from_needs, is_stale
from marsedl.replication.pipeline.targets import check_targets

ROOT = Path(workflow.current_basedir).parents[1]
# Another workflow may use these rules as a module: its words, files and further keys are its own.
IS_MAIN = workflow.modifier.is_main_snakefile()
OWN_CONFIG = dict(config) if IS_MAIN else {key: config[key] for key in (*SLUGS, *SETTINGS) if key in config}
OWN_FILES = workflow.configfiles if IS_MAIN else []
SIZE = str(OWN_CONFIG.get("size", "full"))
TRIALS = OWN_CONFIG.get("trials")  # of each law in the arena


def from_start(path):
    """A user's file, from the project's folder, or else from where Snakemake was started."""
    return Path(ROOT, path) if Path(ROOT, path).exists() else Path(workflow.workdir_init, path)


try:
    PAPERS = {slug: catalogue(slug) for slug in SLUGS}
    COMPARISONS, ARENAS = comparisons(), arenas()
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
    scenario="|".join(ARENAS),
    reading="[a-z0-9_]+",
    # The folder of a reading's figures and tables; those of the default reading stand above it.
    place="([a-z0-9_]+/)?",
    stage="[a-z0-9_]+",
    case="[a-z_]+",
    whole="(whole/)?",
    chunk=r"0|[1-9]\d*",
    chunks=r"[1-9]\d*",


PRODUCTS = Products(ROOT, PAPERS, STUDIES, COMPARISONS, SIZE, ARENAS, TRIALS, OWN_CONFIG.get("chunks"))
SHARED = PRODUCTS.shared
with open(ROOT / "data/reference/costs.csv", encoding="utf-8", newline="") as _file:
    # Seconds of the longest job of each kind.
    LONGEST = {(row["where"], row["what"]): int(row["longest_s"] or 0) for row in csv.DictReader(_file)}
STALE = {}  # artifacts that are not up to date for a reason of their own, by the reason


@atexit.register  # of a dry run, which does not start
def say_why():
    """Say once what is made again, and why."""
    for why, artifacts in STALE.items():
        print(f"not up to date ({why}): {', '.join(artifacts)}", file=sys.stderr)
    STALE.clear()


# --- what rules take. A product is a pattern with the wildcards of its rule.

# A folder that is newer than every product, outside of the project, and gone when Snakemake ends. As a folder it has no
# checksum, by which Snakemake might call it unchanged.
NOW = tempfile.TemporaryDirectory(prefix="marsedl-")


def filled(pattern, wildcards):
    """A pattern with the values of the wildcards."""
    return pattern.format(**dict(wildcards.items()))


def job_of(product, wildcards):
    """The job that makes a product; ends with a message if a file of the project is gone."""
    try:
        return PRODUCTS.job(filled(product, wildcards))
    except InputError as error:
        sys.exit(f"\nmarsedl: {error}\n")


def in_project(path):
    """A path in the project, from the folder that is built in."""
    return os.path.relpath(Path(os.path.realpath(ROOT), path), os.path.realpath(Path.cwd()))


def source(path):
    """A file of the project. Recipes know what it holds, so its time says nothing."""
    return ancient(in_project(path))


def artifacts_of(product):
    """The artifacts that a product is made from, as the signatures of its functions ask for them."""
    return lambda wildcards: [need for need in job_of(product, wildcards).needs if need.startswith(ARTIFACTS)]


def files_of(product):
    """Further files of the project that a product is made from."""
    return lambda wildcards: [source(name) for name in job_of(product, wildcards).params.get("files", ())]


def if_stale(*products):
    """What is newer than some products of a job if they were made from something else than they would be made from now.

    Snakemake runs a job for its params as well, but only if it has its own records of the products, which a copy of a
    build may lack, and not if a product was edited.
    """

    def newer(wildcards):
        job_of(products[0], wildcards)
        stale = [path for path in (filled(one, wildcards) for one in products) if is_stale(PRODUCTS, path, Path())]
        for path in stale:
            if path.startswith(ARTIFACTS) and (why := changed_apart_from_needs(PRODUCTS, path, Path())):
                STALE.setdefault(why, []).append(path)
        return [local(NOW.name)] if stale else []

    return newer


def priority(what, first=0):
    """How early a job starts: long ones before short ones, so that the cores end together."""
    return lambda wildcards: first + LONGEST.get((wildcards.paper, filled(what, wildcards)), 0)


def params_of(product, recorded=True):
    """What a job is given beside files, and where it records what its products are made from."""

    def given(wildcards):
        path = filled(product, wildcards)
        return PRODUCTS.job(path).params | ({"record": PRODUCTS.record(path)} if recorded else {})

    return given


# --- stages

SHOWN = 10_000  # priority of what a figure waits for, before what is computed in memory


def staged(stage, *artifacts):
    """What the job of a stage is given beside files: its functions, and what each artifact is made from."""

    def given(wildcards):
        declared = PAPERS[wildcards.paper].stages[filled(stage, wildcards)]
        recipes = [PRODUCTS.job(filled(artifact, wildcards)).params for artifact in artifacts]
        users = wildcards.reading in STUDIES[wildcards.paper].own_readings
        return {"entries": declared.entries, "recipes": recipes, "size": SIZE, "users": users}

    return given


def chunks_of_flights(wildcards):
    """The files of the chunks of a Monte Carlo case; none if it is one job."""
    names = SHARED[wildcards.paper].chunks(wildcards.reading, wildcards.case)
    return [f"data/cache/{wildcards.paper}/{wildcards.reading}/{name}.h5" for name in names if len(names) > 1]


# Paper, cases and readings, as a regular expression, of the flights that one job of a reading makes.
TOGETHER = [
    (paper, cases, "|".join(readings)) for paper in PAPERS for cases, readings in SHARED[paper].flown_together().items()
]
FLOWN_TOGETHER = "|".join(
    rf"{paper}/({readings})/{FLIGHTS}\.({'|'.join(cases)})\.h5" for paper, cases, readings in TOGETHER
)


# --- universes

# Names of the pictures of the universes of each paper.
UNIVERSE_PICTURES = {slug: list(universe_pictures(headline)) for slug, headline in HEADLINES.items()}


def chunks_of_universes(wildcards):
    """The files of the chunks of a paper's universes; none if they are one job, as is a sample of the committed run."""
    path = f"report/universes/{wildcards.whole}{wildcards.paper}"
    is_sample = bool(PRODUCTS.job(f"{path}.h5").params["sample"])
    chunks = 1 if is_sample else STUDIES[wildcards.paper].universe_jobs
    return [f"{path}.{chunk}of{chunks}.h5" for chunk in range(chunks) if chunks > 1]
