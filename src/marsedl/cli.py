"""The command `marsedl`: lists, explains, compares and checks what the workflow builds, and starts new papers."""

import argparse
import contextlib
import functools
import re
import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import marsedl
from marsedl.replication.errors import InputError, MarsedlError, StaleError
from marsedl.replication.sizes import FULL, build_folder
from marsedl.replication.terminal import columns, printable

TARGETS = ("all", "claims", "comparison", "report", "verify")  # of the workflow, beside one for every paper
KINDS = ("readings", "figures", "tables", "stages", "cases", "claims")  # of what a paper has


def main(arguments: list[str] | None = None) -> int:
    """Run the command.

    Returns 0, 1 if something differs or a check fails, 2 if the request is not valid, 3 if the build is not up to date.
    """
    options = command_line().parse_args(arguments)
    try:
        return _COMMANDS[options.command](options)
    except MarsedlError as error:
        print(f"marsedl: {printable(error)}", file=sys.stderr)
        return 3 if isinstance(error, StaleError) else 2
    except ModuleNotFoundError as error:
        print(f"marsedl: {error.name} is not installed; run: pip install 'marsedl[pipeline]'", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def command_line() -> argparse.ArgumentParser:
    """Return the parser of all commands with their arguments."""
    parser = argparse.ArgumentParser(
        prog="marsedl",
        description="Replications of papers on Mars entry, descent and landing under uncertainty. This command shows "
        "and checks what 'snakemake' builds.",
        epilog="A reading is a complete set of inputs: 'printed' as in the paper, 'corrected' with its errors mended. "
        "A size says how much is computed: 'full', or 'smoke' with few trials. 'marsedl list' shows the papers.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="command", help="'marsedl COMMAND --help' shows its arguments"
    )

    def add(name: str, summary: str, details: str = "") -> argparse.ArgumentParser:
        description = f"{summary[0].upper()}{summary[1:]}. {details}".strip()
        return commands.add_parser(name, help=summary, description=description)

    listing = add(
        "list",
        "list papers with their readings, figures, tables, stages, Monte Carlo cases and claims",
        "Without arguments it counts them; with a paper or a kind it names each one.",
    )
    listing.add_argument("paper", nargs="?", help="a paper, such as powered_descent (default: all papers)")
    for kind in KINDS:
        listing.add_argument(
            f"--{kind}", dest="kinds", action="append_const", const=kind, help=f"list only the {kind} (can be combined)"
        )
    explain = add(
        "explain",
        "show what a paper, figure, table, stage or claim depends on",
        "Shows the artifacts, the inputs with their sources and the code behind it, and the verdict on a claim.",
    )
    explain.add_argument("paper", help="a paper, such as powered_descent")
    explain.add_argument("item", nargs="?", help="a figure, table, stage or claim (default: the whole paper)")
    explain.add_argument(
        "--reading",
        metavar="NAME",
        default="corrected",
        help="the reading whose inputs are shown (default: %(default)s)",
    )
    diff = add(
        "diff",
        "compare two artifacts, figures, tables or folders of them",
        "Prints what differs and by how much. The exit status is 1 if anything differs.",
    )
    diff.add_argument("a", type=Path, help="a file or folder")
    diff.add_argument("b", type=Path, help="the file or folder to compare it with")
    trial = add(
        "trial",
        "simulate one Monte Carlo trial again",
        "Prints how the trial goes, and whether it agrees with the stored ensemble if there is one.",
    )
    trial.add_argument("paper", help="a paper, such as powered_descent")
    trial.add_argument("reading", help="a reading, such as corrected")
    trial.add_argument("case", nargs="?", default=argparse.SUPPRESS, help="a Monte Carlo case (default: the first one)")
    trial.add_argument("number", type=int, help="the number of the trial, counted from 0")
    trial.add_argument("--case", metavar="NAME", help="the Monte Carlo case, given as an option")
    verify = add(
        "verify",
        "check that results are reproducible",
        "Builds the smoke size twice and compares every file, then compares the full-size build with the stored "
        "numbers. With --reference it only compares a build with numbers of your own. The exit status is 1 if anything "
        "differs.",
    )
    verify.add_argument("--no-rebuild", action="store_true", help="only compare the full size with the stored numbers")
    accept = add(
        "accept",
        "store the numbers of the full-size build as the reference",
        "Prints what changes in data/reference. Run it after a full build whose changes you have looked at. With "
        "--reference it stores the numbers of a build in a folder of your own.",
    )
    for command in (verify, accept):
        command.add_argument(
            "--reference", metavar="FOLDER", type=Path, help="a folder with reference numbers of your own"
        )
        command.add_argument(
            "--paper",
            metavar="NAME",
            action="append",
            default=[],
            help="with --reference: only this paper; can be repeated",
        )
    add(
        "readme",
        "write what came out of each paper into README.md",
        "Writes the answers and the badge from the stored verdicts.",
    )
    new = add(
        "new-paper",
        "create a small complete paper as the start of another replication",
        "Writes its files and prints the next steps.",
    )
    new.add_argument("slug", help="its name in files and targets, such as powered_descent")
    new.add_argument("--title", default="Title to be given", help="the paper's title")
    new.add_argument("--authors", default="Authors to be named", help="the paper's authors, in one line")
    new.add_argument("--without-monte-carlo", action="store_true", help="one stage and no Monte Carlo trials")
    for command in (listing, explain, trial, verify, accept):
        where = "with --reference: " if command in (verify, accept) else ""
        command.add_argument(
            "--size", metavar="NAME", help=f"{where}use the build of this size, such as smoke (default: {FULL})"
        )
    for command in (explain, trial, verify, accept):
        command.add_argument(
            "--configfile", metavar="FILE", type=Path, help="a file with readings of your own, as for snakemake"
        )
    return parser


class _Version(argparse.Action):
    """Print the version; it is looked up only then."""

    def __call__(self, parser, *_):
        print(f"marsedl {marsedl.__version__}")
        parser.exit()


def project_root() -> Path:
    """Return the project's folder: the working directory or the nearest one above it that holds the Snakefile.

    Raises InputError if there is none.
    """
    current_folder = Path.cwd()
    for folder in (current_folder, *current_folder.parents):
        if (folder / "Snakefile").exists() and (folder / "configs").is_dir():
            return folder
    raise InputError(f"{current_folder} is not inside a marsedl project; change to the folder that holds its Snakefile")


@dataclass(frozen=True)
class _Project:
    """The project in the size that a command asks for, with readings of the user's own."""

    root: Path
    size: str
    studies: dict
    options: str  # of snakemake, to build this size with these readings

    @property
    def folder(self) -> Path:
        """The folder of this size's products."""
        return build_folder(self.root, self.size)

    @functools.cached_property
    def _verdict_rows(self) -> list[dict] | None:
        """The verdicts of all papers; None if none are built yet."""
        from marsedl.replication.claims import read_claims

        path = self.folder / "report" / "claims.json"
        return read_claims(path) if path.exists() else None

    def claims(self, slug: str) -> list[dict] | None:
        """A paper's rows of the verdicts; None if none are built yet."""
        return None if self._verdict_rows is None else [row for row in self._verdict_rows if row["paper"] == slug]

    def paper(self, slug: str, reading: str = "corrected"):
        """The catalogue of a paper with the numbers that its texts quote: of this size, else the committed ones."""
        from marsedl.replication.quotes import committed, with_numbers

        if self._verdict_rows is None and reading == "corrected":
            with contextlib.suppress(InputError):  # a quote that was not accepted yet
                return with_numbers(_paper(slug), committed(self.root, slug))
        return with_numbers(_paper(slug), self.quotes(slug, reading))

    def quotes(self, slug: str, reading: str = "corrected"):
        """The numbers of this size that texts of a paper can quote."""
        from marsedl.replication.quotes import Quotes, by_id

        return Quotes(by_id(self.claims(slug)), self.studies[slug].readings, reading)


def _project(size: str | None = None, config_file: Path | None = None) -> _Project:
    """Load the studies of all papers with a user's own readings; `size` overrides that of the file."""
    from marsedl.papers import SLUGS, input_model
    from marsedl.replication.inputs import SETTINGS, load_studies, read_own_file

    root = project_root()
    files = [] if config_file is None else [config_file.absolute()]
    config = {} if config_file is None else read_own_file(config_file, (*SLUGS, *SETTINGS))
    if size:
        config = {**config, "size": size}
    models = {slug: input_model(slug) for slug in SLUGS}
    with contextlib.chdir(root):  # from where files named by inputs are read
        studies = load_studies(models, Path("configs"), config, files)
    options = f" --config size={shlex.quote(size)}" if size and size != FULL else ""
    if config_file is not None:
        path = config_file.resolve()
        path = path.relative_to(root.resolve()) if path.is_relative_to(root.resolve()) else path
        options += f" --configfile {shlex.quote(str(path))}"
    return _Project(root, str(config.get("size", FULL)), studies, options)


def _shared(size: str | None = None) -> dict:
    """Which reading owns each artifact file, by paper."""
    from marsedl.replication.sharing import Shared

    return {slug: Shared(_paper(slug), study) for slug, study in _project(size).studies.items()}


def _paper(slug):
    """Return the catalogue of a paper."""
    from marsedl.papers import SLUGS, catalogue
    from marsedl.replication.errors import nearest

    if slug not in SLUGS:
        raise InputError(f"there is no paper '{slug}'; {nearest(slug, SLUGS)}")
    return catalogue(slug)


def _reading(study, name):
    from marsedl.replication.errors import nearest

    if name not in study.readings:
        raise InputError(f"{study.paper} has no reading '{name}'; {nearest(name, study.readings)}")
    return study.readings[name]


def _published(root, slug) -> list:
    """Return the printed claims of a paper."""
    from marsedl.replication.claims import load_published

    return load_published(root / "data" / "published" / f"{slug}.yaml")


def _say(text: object = "") -> None:
    """Print a text with its control characters escaped."""
    print(printable(text))


def _list(options) -> int:
    from marsedl.papers import SLUGS

    papers = [_paper(slug) for slug in ([options.paper] if options.paper else SLUGS)]
    if not (options.paper or options.kinds):
        return _list_papers(papers, options.size)
    project = _project(options.size)
    for paper in (project.paper(paper.slug) for paper in papers):
        _say(paper.slug)
        if not options.kinds:
            _say(f"  {paper.title}\n  {paper.authors}")
        rows = {kind: _rows(project, paper, kind) for kind in options.kinds or KINDS}
        for kind in options.kinds or KINDS:
            _say(f"\n  {kind}{_command(paper, kind, project.options)}")
            if rows[kind]:
                _say(columns(rows[kind], 4, wrap=False))
        _say()
    return 0


def _counts_in_words(items: dict) -> str:
    """The number of items of each kind, such as "7 figures, 1 table"."""
    return ", ".join(f"{len(of_kind)} {kind if len(of_kind) != 1 else kind[:-1]}" for kind, of_kind in items.items())


def _list_papers(papers, size: str | None) -> int:
    """Count what every paper has. Readings are validated only if a size is named: that takes longest."""
    from marsedl.papers import SLUGS, input_model
    from marsedl.replication.inputs import configured_readings

    root = project_root()
    if size:
        _project(size)  # raises InputError for an unknown size
    for paper in papers:
        model = input_model(paper.slug)
        items = {
            "readings": configured_readings(model, root / "configs" / f"{paper.slug}.yaml"),
            "figures": paper.figures,
            "tables": [*paper.tables, *paper.summaries, "claims"],
            "stages": paper.stages,
            "cases": model.CASES,
            "claims": _published(root, paper.slug),
        }
        _say(f"{paper.slug}\n  {paper.title}\n  {paper.authors}\n  {_counts_in_words(items)}\n")
    _say("'marsedl list PAPER' shows all of a paper, 'marsedl list --figures' all figures, and so on")
    _say("targets: " + ", ".join([*TARGETS, *SLUGS]))
    return 0


def _command(paper, kind, options) -> str:
    """The command that makes an item of a kind, in brackets."""
    places = {
        "figures": f"snakemake figures/{paper.slug}/NAME.png, or figures/{paper.slug}/READING/NAME.png",
        "tables": f"snakemake figures/{paper.slug}/NAME.csv, or .md; READING as for figures",
        "stages": f"snakemake data/cache/{paper.slug}/READING/NAME.h5",
        "cases": f"snakemake data/cache/{paper.slug}/READING/montecarlo.NAME.h5",
        "claims": "snakemake claims",
    }
    return f" ({places[kind]}{options and f'; add{options}'})" if kind in places else ""


def _rows(project, paper, kind) -> list[tuple[str, ...]]:
    """The items of one kind that a paper has: a row for each, its name first."""
    study = project.studies[paper.slug]
    if kind == "readings":
        return [
            (r.name, r.summary + (f" (based on {r.based_on})" if r.based_on else "")) for r in study.readings.values()
        ]
    if kind == "figures":
        return [(stem, _first_sentence(product.caption)) for stem, product in paper.figures.items()]
    if kind == "tables":
        summaries = {**paper.summaries, "claims": "Every printed claim with its verdict."}
        rows = [(stem, _first_sentence(product.caption)) for stem, product in paper.tables.items()]
        return [*rows, *((stem, f"{_first_sentence(caption)} (all readings)") for stem, caption in summaries.items())]
    if kind == "stages":
        return [(name, stage.meaning) for name, stage in paper.stages.items()]
    if kind == "cases":
        model = type(next(iter(study.readings.values())).inputs)
        return [
            (case, f"{_trials(study, name)} trials", f"input {name}: {model.meaning(name)}")
            for case, name in model.CASES.items()
        ]
    verdicts = {row["id"]: row["verdict"] for row in project.claims(paper.slug) or []}
    return [
        (claim.id, verdicts.get(claim.id) or "–", claim.where, claim.quantity)
        for claim in _published(project.root, paper.slug)
    ]


def _trials(study, name) -> str:
    """The number of trials of a case: that of `corrected` if there is such a reading, else of the first."""
    reading = study.readings.get("corrected") or next(iter(study.readings.values()))
    return f"{reading.inputs.get(name):,}"


def _first_sentence(caption) -> str:
    """Without its full stop; that of "Fig. 9" ends no sentence."""
    return re.split(r"\. (?=[A-Z])", caption)[0].removesuffix(".")


def _explain(options) -> int:
    from marsedl.replication.catalogue import FLIGHTS
    from marsedl.replication.errors import nearest
    from marsedl.replication.fingerprints import fingerprints_of
    from marsedl.replication.sharing import Shared

    paper = _paper(options.paper)
    project = _project(options.size, options.configfile)
    study = project.studies[paper.slug]
    reading = _reading(study, options.reading)
    if options.item is None:
        return _explain_paper(project, paper, study, reading)
    claims = {claim.id: claim for claim in _published(project.root, paper.slug)}
    name = options.item
    if name in claims:
        claim = claims[name]
        unit = "" if claim.unit == "1" else f" {claim.unit}"
        printed = "a statement" if isinstance(claim.printed, bool) else f"printed {claim.printed}{unit}"
        _say(f"claim {name}: {claim.quantity}\n  {claim.where}; {printed} ({claim.kind})")
        _say_verdict(project, paper.slug, name)
        return 0
    if name in paper.figures or name in paper.tables:
        item = project.paper(paper.slug, reading.name).product(name)
        kind = "figures" if name in paper.figures else "tables"
        entries = (f"marsedl.papers.{paper.slug}.{kind}:{name}",)
        folder = f"figures/{paper.slug}" + ("" if reading.name == "corrected" else f"/{reading.name}")
        target = f"{folder}/{name}.{'png' if kind == 'figures' else 'csv'}{project.options}"
        _say(f"{kind[:-1]} {name} of {paper.slug}, reading {reading.name}\n  {item.caption}")
        _say(f"  snakemake {target}")
    elif name in paper.stages:
        item = paper.stages[name]
        entries = item.entries
        _say(f"stage {name} of {paper.slug}, reading {reading.name}: {item.meaning}")
    else:
        item_names = [*paper.figures, *paper.tables, *paper.stages, *claims]
        raise InputError(f"{paper.slug} has no figure, table, stage or claim '{name}'; {nearest(name, item_names)}")
    namesakes = [kind for kind in ("figures", "tables", "stages") if name in getattr(paper, kind)][1:]
    if namesakes:
        _say(f"  (also the name of a {' and a '.join(kind[:-1] for kind in namesakes)})")
    cases = reading.inputs.CASES
    artifacts, input_names = _behind(paper, item, cases)
    of_stage = [name] if name in paper.stages and item is paper.stages[name] else []
    if FLIGHTS in of_stage:  # of which every case is one artifact
        of_stage = [f"{FLIGHTS}.{case}" for case in reading.trial_counts()]
        input_names.update(cases[case] for case in reading.trial_counts())
    shared = Shared(paper, study)
    _say("\nartifacts, in the order in which they are made")
    _say(columns([_artifact(paper, shared, reading, name) for name in dict.fromkeys([*artifacts, *of_stage])], 2))
    _say("\ninputs that it depends on")
    _say_inputs(project, options, paper.slug, reading, input_names)
    _say("\ncode that draws or computes it")
    for symbol in dict.fromkeys(symbol for entry in entries for symbol in fingerprints_of(project.root).symbols(entry)):
        if "(at import)" not in symbol:
            _say(f"  {symbol}")
    return 0


def _artifact(paper, shared, reading, name) -> tuple[str, str]:
    """The name and meaning of an artifact, and the reading that owns its file if it is another one."""
    stage = name.partition(".")[0]
    meaning = paper.stages[stage].meaning
    if not shared.has(reading.name, name):
        return name, f"{meaning} (has no trials in this reading)"
    owner = shared.owner(reading.name, name)
    return name, meaning if owner == reading.name else f"{meaning} (shared: that of the reading {owner})"


def _say_inputs(project, options, slug, reading, names) -> None:
    """Show inputs by section, with their values as they are written and their sources."""
    unlimited = _unlimited(project, options, slug, reading).plain()
    values = reading.inputs.plain()
    for section, of in reading.inputs.sections().items():
        rows = []
        for name in (f"{section}.{field}" for field in of.model_fields if f"{section}.{field}" in names):
            source = reading.sources[name]
            limited = "" if values[name] == unlimited[name] else f" (size {project.size}: {values[name]})"
            rows.append((source.key, f"{source.written}{limited}", _unit(reading, name), source.source))
        if rows:
            _say(f"  {section}\n{columns(rows, 4)}")


def _unlimited(project, options, slug, reading):
    """The inputs of a reading at full size, which limits none of them."""
    if project.size == FULL:
        return reading.inputs
    return _project(FULL, options.configfile).studies[slug].readings[reading.name].inputs


def _explain_paper(project, paper, study, reading) -> int:
    """Show the readings, inputs, products and verdicts of a paper."""
    _say(f"{paper.slug}: {paper.title}\n  {paper.authors}")
    _say(f"  snakemake {paper.slug}{project.options}")
    _say("\nreadings")
    _say(columns(_rows(project, paper, "readings"), 2))
    _say(f"\ninputs in which readings differ from {reading.name}, of {len(reading.inputs.names())}")
    _say(columns(_differing(study, reading), 2))
    _say(f"\nwhat there is (marsedl list {paper.slug})")
    _say(f"  {_counts_in_words({kind: _rows(project, paper, kind) for kind in KINDS})}")
    rows = project.claims(paper.slug)
    _say("\nverdicts")
    if not rows:
        _say(f"  none yet: run 'snakemake claims{project.options}'")
        return 0
    from marsedl.replication.claims import summary

    for how, counts in summary(rows).items():
        verdict_counts = [f"{count} {verdict.replace('_', ' ')}" for verdict, count in counts.items() if count]
        _say(f"  {how}: {', '.join(verdict_counts) or 'none'}")
    return 0


def _differing(study, reading) -> list[tuple[str, str, str, str]]:
    """Inputs whose value differs between readings: name, value in this one, unit, values in the others."""
    rows, values = [], {name: other.inputs.plain() for name, other in study.readings.items()}
    for name, value in values[reading.name].items():
        different = [other for other in study.readings.values() if values[other.name][name] != value]
        if different:
            source = reading.sources[name]
            texts = "; ".join(f"{other.name} {other.sources[name].written}" for other in different)
            key = f"{name.partition('.')[0]}.{source.key}"
            rows.append((key, str(source.written), _unit(reading, name), texts))
    return rows


def _unit(reading, name) -> str:
    """Return the unit in which an input "section.name" is written."""
    suffix = reading.sources[name].key.removeprefix(name.partition(".")[2]).removeprefix("_")
    return suffix.replace("_", "/") or reading.inputs.unit(name)


def _behind(paper, item, cases) -> tuple[list[str], set[str]]:
    """All artifacts behind an item, in the order in which they are made, and all inputs behind it.

    cases: the Monte Carlo cases of the paper, each with the input that holds its number of trials.
    """
    artifacts, input_names = [], set(item.inputs)

    def visit(needs):
        for need in needs:
            if need not in artifacts:
                name, _, case = need.partition(".")
                visit(paper.stages[name].needs)
                artifacts.append(need)
                input_names.update(paper.stages[name].inputs, [cases[case]] if case else ())

    visit((*item.needs, *getattr(item, "optional", ())))
    return artifacts, input_names


def _say_verdict(project, slug, claim) -> None:
    from marsedl.replication.claims import format_result

    row = next((row for row in project.claims(slug) or () if row["id"] == claim), None)
    if row is None:
        _say(f"  no verdict yet: run 'snakemake claims{project.options}'")
        return
    _say(f"  verdict: {row['verdict']} (reading {row['reading']})")
    if row["reason"]:
        _say(f"  {row['reason']}")
    rows = [
        (name, result["verdict"] or "–", ", ".join(format_result(row, name)), result["evidence"] or "")
        for name, result in row["readings"].items()
    ]
    _say(columns(rows, 4))


def _diff(options) -> int:
    from marsedl.replication.digests import difference, format_difference

    rows = difference(options.a, options.b)
    _say(format_difference(rows))
    return 1 if rows else 0


def _trial(options) -> int:
    from importlib import import_module

    from marsedl.replication import jobs

    jobs.pin_numerics(project_root())
    paper = _paper(options.paper)
    project = _project(options.size, options.configfile)
    study = project.studies[paper.slug]
    reading = _reading(study, options.reading)
    if not reading.inputs.CASES:
        raise InputError(f"{paper.slug} has no Monte Carlo flights; 'marsedl list --cases' shows which do")
    trial = options.case or next(iter(reading.inputs.CASES)), options.number
    module = import_module(f"marsedl.papers.{paper.slug}.montecarlo")
    _say(jobs.replay(project.folder, paper, study, reading.name, trial, module, project.options))
    return 0


def _verify(options) -> int:
    from marsedl.papers import rounding_noise
    from marsedl.replication import verification

    root = project_root()
    if _own_reference(options):
        project, shared = _own_build(options)
        folder = options.reference.absolute()
        agree = verification.compare_reference(root, shared, rounding_noise(), size=project.size, folder=folder)
        return 0 if agree else 1
    shared = _up_to_date(_project())
    agree = True if options.no_rebuild else verification.build_twice(root)
    return 0 if verification.compare_reference(root, shared, rounding_noise()) and agree else 1


def _up_to_date(project: _Project, papers: Iterable[str] = ()) -> dict:
    """Which reading owns each artifact file, by paper, in a build whose claims are up to date.

    papers: those that are asked about; without them all, with their counterexamples.

    Raises StaleError, with the command that mends it, if one of the claims or what they are made from is not.
    """
    from marsedl.comparison import comparisons
    from marsedl.papers import SLUGS
    from marsedl.replication.staleness import Recipes

    catalogues = {slug: _paper(slug) for slug in SLUGS}
    recipes = Recipes(project.root, catalogues, project.studies, comparisons(), project.size)
    targets = [f"report/claims/{slug}.json" for slug in papers]
    command = f"snakemake {' '.join(targets) or 'all'}{project.options}"
    recipes.check(targets or ["report/claims.json"], project.folder, command)
    return {slug: recipes.shared[slug] for slug in papers or SLUGS}


def _own_reference(options) -> bool:
    """Whether `verify` or `accept` is about a reference of the user's own; refuses options that only this takes."""
    given = [name for name in ("paper", "size", "configfile") if getattr(options, name)]
    if given and options.reference is None:
        raise InputError(f"--{given[0]} needs --reference FOLDER, a folder with reference numbers of your own")
    return options.reference is not None


def _own_build(options) -> tuple[_Project, dict]:
    """The build that is compared with a reference of the user's own, and its `Shared` of every paper asked for."""
    from marsedl.papers import SLUGS

    papers = [_paper(slug).slug for slug in options.paper or SLUGS]
    project = _project(options.size, options.configfile)
    return project, _up_to_date(project, papers)


def _accept(options) -> int:
    from marsedl.papers import SLUGS, rounding_noise
    from marsedl.replication import quotes, verification

    root = project_root()
    if _own_reference(options):
        project, shared = _own_build(options)
        folder = options.reference.absolute()
        for path in verification.accept_reference(root, shared, rounding_noise(), project.size, folder):
            _say(f"wrote {path}")
        return 0
    project = _project()
    for path in verification.accept_reference(root, _up_to_date(project), rounding_noise()):
        _say(f"wrote {path}")
    _say(f"wrote {verification.accept_inputs(root, project.studies)}")
    _say(f"wrote {quotes.accept(root, {slug: (_paper(slug), project.quotes(slug)) for slug in SLUGS})}")
    _write_readme(root)
    return 0


def _readme(options) -> int:
    _write_readme(project_root())
    return 0


def _write_readme(root: Path) -> None:
    """Write what came out of each paper into the README, with the accepted numbers of its texts."""
    from marsedl.papers import SLUGS
    from marsedl.replication import front_page
    from marsedl.replication.quotes import committed, with_numbers

    for path in front_page.write(root, [with_numbers(_paper(slug), committed(root, slug)) for slug in SLUGS]):
        _say(f"wrote {path}")


def _new_paper(options) -> int:
    from marsedl.replication.scaffold import new_paper, next_steps

    root = project_root()
    files = new_paper(root, options.slug, options.title, options.authors, not options.without_monte_carlo)
    for path in files:
        _say(f"wrote {path.relative_to(root)}")
    _say(f"\n{next_steps(options.slug)}")
    return 0


_COMMANDS = {
    "list": _list,
    "explain": _explain,
    "diff": _diff,
    "trial": _trial,
    "verify": _verify,
    "accept": _accept,
    "readme": _readme,
    "new-paper": _new_paper,
}

if __name__ == "__main__":
    sys.exit(main())
