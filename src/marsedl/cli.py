"""The command `marsedl`: what there is, what it is made of, what differs, one trial again, the proof, a new paper."""

import argparse
import contextlib
import functools
import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.sizes import FULL, build_folder, size_of
from marsedl.replication.terminal import columns, printable_lines

TARGETS = ("all", "claims", "comparison", "report", "verify")  # of the workflow, beside one for every paper
KINDS = ("readings", "figures", "tables", "stages", "cases", "claims")  # of what a paper has


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns 0, 1 if things differ or fail, 2 for a request that cannot be met."""
    options = command_line().parse_args(arguments)
    try:
        return _COMMANDS[options.command](options)
    except MarsedlError as error:
        print(f"marsedl: {printable_lines(error)}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def command_line() -> argparse.ArgumentParser:
    """Return the parser of all commands with their arguments."""
    parser = argparse.ArgumentParser(
        prog="marsedl", description="Replications of papers on Mars entry, descent and landing under uncertainty."
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="command", help="'marsedl COMMAND --help' shows its arguments"
    )

    shown = commands.add_parser("list", help="papers, their readings, figures, tables, stages, cases and claims")
    shown.add_argument("paper", nargs="?", help="its name, such as powered_descent; all papers unless given")
    for kind in KINDS:
        shown.add_argument(
            f"--{kind}",
            dest="kinds",
            action="append_const",
            const=kind,
            help=f"the {kind}, and no other kind",
        )
    explain = commands.add_parser("explain", help="what a paper, or its figure, table, stage or claim, is made of")
    explain.add_argument("paper", help="its name, such as powered_descent")
    explain.add_argument("item", nargs="?", help="a figure, table, stage or claim; the whole paper unless given")
    explain.add_argument("--reading", default="corrected", help="the reading whose inputs are shown (%(default)s)")
    diff = commands.add_parser("diff", help="compare two artifacts, figures, tables or folders of them")
    diff.add_argument("a", type=Path, help="a file or folder")
    diff.add_argument("b", type=Path, help="another one of the same kind")
    trial = commands.add_parser("trial", help="fly one trial of a Monte Carlo case again")
    trial.add_argument("paper", help="its name, such as powered_descent")
    trial.add_argument("reading", help="the reading whose trial it is, such as corrected")
    trial.add_argument("case", nargs="?", default=argparse.SUPPRESS, help="the paper's first case unless given")
    trial.add_argument("number", type=int, help="the number of the trial, from 0")
    trial.add_argument("--case", help="the case, as an option")
    verify = commands.add_parser("verify", help="build the smoke size twice and compare; compare the full size")
    verify.add_argument("--no-rebuild", action="store_true", help="only compare the full size with the stored numbers")
    machines = commands.add_parser("machines", help="compare the smoke size under other instruction sets and libraries")
    machines.add_argument("names", nargs="*", metavar="machine", help="sse or avx512; both unless given")
    machines.add_argument(
        "--libraries", action="append", default=[], metavar="NAME=PYTHON", help="a Python with other versions"
    )
    machines.add_argument("--paper", action="append", default=[], help="only this paper; may be given several times")
    machines.add_argument("--cores", type=_positive, default=2, help="cores of each build (%(default)s)")
    commands.add_parser("accept", help="show what the full size changes in the stored numbers, and store it")
    commands.add_parser("audit", help="count claims, figures, inputs, errata, targets; find what is left hanging")
    crate = commands.add_parser(
        "crate", help="describe the build for others: workflow, inputs, products, digests (RO-Crate)"
    )
    crate.add_argument("--config", nargs="*", default=[], help="as for snakemake, if it is not the full size")
    new = commands.add_parser("new-paper", help="write a small complete paper to begin another replication with")
    new.add_argument("slug", help="its name in files and targets, such as powered_descent")
    new.add_argument("--title", default="Title to be given", help="the paper's title")
    new.add_argument("--authors", default="Authors to be named", help="the paper's authors, in one line")
    new.add_argument("--without-monte-carlo", action="store_true", help="one stage and no flights of trials")
    completion = commands.add_parser("completion", help="print a script that completes commands in your shell")
    completion.add_argument("shell", choices=("bash", "zsh"), help='the shell; use: eval "$(marsedl completion bash)"')
    for command in (shown, explain, trial):
        command.add_argument("--size", metavar="NAME", help=f"of the build that is looked at, such as smoke ({FULL})")
    for command in (explain, trial):
        command.add_argument("--configfile", type=Path, help="a configuration of your own, as for snakemake")
    return parser


class _Version(argparse.Action):
    """Print the version; it is looked up only then."""

    def __call__(self, parser, *_):
        from importlib.metadata import version

        print(f"marsedl {version('marsedl')}")
        parser.exit()


def _positive(text: str) -> int:
    """Read a whole number above zero; the parser refuses the argument otherwise."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above zero")
    return int(text)


def project_root() -> Path:
    """Return the project's folder: the working directory or the nearest one above it that holds the Snakefile.

    Raises InputError if there is none.
    """
    here = Path.cwd()
    for folder in (here, *here.parents):
        if (folder / "Snakefile").exists() and (folder / "configs").is_dir():
            return folder
    raise InputError(f"{here} is not inside a marsedl project; change to the folder that holds its Snakefile")


@dataclass(frozen=True)
class _Project:
    """The project as the options of a command show it: a size, and readings of the user's own."""

    root: Path
    size: str
    studies: dict
    options: str  # of snakemake, which build this size with these readings

    @property
    def folder(self) -> Path:
        """The folder of this size's products."""
        return build_folder(self.root, self.size)

    @functools.cached_property
    def _judged(self) -> list[dict] | None:
        """The joined verdicts of all papers; None if nothing was judged yet."""
        from marsedl.replication.claims import read_claims

        path = self.folder / "report" / "claims.json"
        return read_claims(path) if path.exists() else None

    def claims(self, slug: str) -> list[dict] | None:
        """A paper's rows of the joined verdicts; None if nothing was judged yet."""
        return None if self._judged is None else [row for row in self._judged if row["paper"] == slug]


def _project(size: str | None = None, config_file: Path | None = None) -> _Project:
    """Load the studies of all papers in a size, with a user's own readings; a size that is given wins."""
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
    """Whose file each artifact is, of all papers, in a size."""
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
    """Print a text, in which no control character of a file acts on the terminal."""
    print(printable_lines(text))


def _list(options) -> int:
    from marsedl.papers import SLUGS

    papers = [_paper(slug) for slug in ([options.paper] if options.paper else SLUGS)]
    if not (options.paper or options.kinds):
        return _list_papers(papers, options.size)
    project = _project(options.size)
    for paper in papers:
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


def _counted(items: dict) -> str:
    """The number of items of each kind, in words."""
    return ", ".join(f"{len(of_kind)} {kind if len(of_kind) != 1 else kind[:-1]}" for kind, of_kind in items.items())


def _list_papers(papers, size: str | None) -> int:
    """What there is of every paper, counted. Readings are validated only for a size: it takes longer than all else."""
    from marsedl.papers import SLUGS, input_model
    from marsedl.replication.inputs import configured_readings

    root = project_root()
    if size:
        _project(size)  # refuses one that there is not
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
        _say(f"{paper.slug}\n  {paper.title}\n  {paper.authors}\n  {_counted(items)}\n")
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
    """All that a paper has of a kind, a row for each with its name first."""
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
    from marsedl.replication.code_digest import reached
    from marsedl.replication.errors import nearest
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
        _say(f"claim {name}: {claim.quantity}\n  {claim.where}; printed {claim.printed} {claim.unit} ({claim.kind})")
        _say_verdict(project, paper.slug, name)
        return 0
    if name in paper.figures or name in paper.tables:
        item, kind = paper.product(name), "figures" if name in paper.figures else "tables"
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
        known = [*paper.figures, *paper.tables, *paper.stages, *claims]
        raise InputError(f"{paper.slug} has no figure, table, stage or claim '{name}'; {nearest(name, known)}")
    namesakes = [kind for kind in ("figures", "tables", "stages") if name in getattr(paper, kind)][1:]
    if namesakes:
        _say(f"  (also the name of a {' and a '.join(kind[:-1] for kind in namesakes)})")
    cases = reading.inputs.CASES
    made, names = _behind(paper, item, cases)
    own = [name] if name in paper.stages and item is paper.stages[name] else []
    if FLIGHTS in own:  # of which every case is one artifact
        own = [f"{FLIGHTS}.{case}" for case in reading.flown()]
        names.update(cases[case] for case in reading.flown())
    shared = Shared(paper, study)
    _say("\nartifacts, in the order in which they are made")
    _say(columns([_artifact(paper, shared, reading, name) for name in dict.fromkeys([*made, *own])], 2))
    _say("\ninputs that it depends on")
    _say_inputs(project, options, paper.slug, reading, names)
    _say("\ncode that draws or computes it")
    for symbol in dict.fromkeys(symbol for entry in entries for symbol in reached(entry, project.root / "src")):
        if "(at import)" not in symbol:
            _say(f"  {symbol}")
    return 0


def _artifact(paper, shared, reading, name) -> tuple[str, str]:
    """The name and the meaning of an artifact, and whose it is if another reading owns its file."""
    stage = name.partition(".")[0]
    meaning = paper.stages[stage].meaning
    if not shared.has(reading.name, name):
        return name, f"{meaning} (flies no trials in this reading)"
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
    """The inputs of a reading at full size, where no size limits them."""
    if project.size == FULL:
        return reading.inputs
    return _project(FULL, options.configfile).studies[slug].readings[reading.name].inputs


def _explain_paper(project, paper, study, reading) -> int:
    """Say what a whole paper is made of."""
    _say(f"{paper.slug}: {paper.title}\n  {paper.authors}")
    _say(f"  snakemake {paper.slug}{project.options}")
    _say("\nreadings")
    _say(columns(_rows(project, paper, "readings"), 2))
    _say(f"\ninputs in which readings differ from {reading.name}, of {len(reading.inputs.names())}")
    _say(columns(_differing(study, reading), 2))
    _say(f"\nwhat there is (marsedl list {paper.slug})")
    _say(f"  {_counted({kind: _rows(project, paper, kind) for kind in KINDS})}")
    rows = project.claims(paper.slug)
    _say("\nverdicts")
    if not rows:
        _say(f"  none yet: run 'snakemake claims{project.options}'")
        return 0
    from marsedl.replication.claims import summary

    for how, counts in summary(rows).items():
        given = [f"{count} {verdict.replace('_', ' ')}" for verdict, count in counts.items() if count]
        _say(f"  {how}: {', '.join(given) or 'none'}")
    return 0


def _differing(study, reading) -> list[tuple[str, str, str, str]]:
    """Inputs that have another value in some reading: name, value in the given one, unit, values in the others."""
    rows, values = [], {name: other.inputs.plain() for name, other in study.readings.items()}
    for name, mine in values[reading.name].items():
        others = [other for other in study.readings.values() if values[other.name][name] != mine]
        if others:
            source = reading.sources[name]
            written = "; ".join(f"{other.name} {other.sources[name].written}" for other in others)
            key = f"{name.partition('.')[0]}.{source.key}"
            rows.append((key, str(source.written), _unit(reading, name), written))
    return rows


def _unit(reading, name) -> str:
    """Return the unit in which an input "section.name" is written."""
    suffix = reading.sources[name].key.removeprefix(name.partition(".")[2]).removeprefix("_")
    return suffix.replace("_", "/") or reading.inputs.unit(name)


def _behind(paper, item, cases) -> tuple[list[str], set[str]]:
    """All artifacts behind an item, first things first, and all inputs that they and the item depend on.

    cases: the Monte Carlo cases of the paper, each with the input that holds its number of trials.
    """
    made, names = [], set(item.inputs)

    def visit(needed):
        for need in needed:
            if need not in made:
                name, _, case = need.partition(".")
                visit(paper.stages[name].needs)
                made.append(need)
                names.update(paper.stages[name].inputs, [cases[case]] if case else ())

    visit((*item.needs, *getattr(item, "optional", ())))
    return made, names


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


def _completion(options) -> int:
    from marsedl.papers import SLUGS
    from marsedl.replication.completion import script

    project = _project()
    items = {}
    for slug in SLUGS:
        paper = _paper(slug)
        items[slug] = {
            "explain": [*paper.figures, *paper.tables, *paper.stages, *(c.id for c in _published(project.root, slug))],
            "trial": [*project.studies[slug].readings],
        }
    print(script(command_line(), options.shell, items), end="")
    return 0


def _verify(options) -> int:
    from marsedl.papers import rounding_noise
    from marsedl.replication import verification

    root = project_root()
    agree = True if options.no_rebuild else verification.build_twice(root)
    return 0 if verification.compare_reference(root, _shared(), rounding_noise()) and agree else 1


def _machines(options) -> int:
    from marsedl.papers import SLUGS, rounding_noise
    from marsedl.replication import machines
    from marsedl.replication.errors import nearest

    if unknown := next((paper for paper in options.paper if paper not in SLUGS), None):
        raise InputError(f"there is no paper '{unknown}'; {nearest(unknown, SLUGS)}")
    asked = machines.chosen(options.names, options.libraries)
    slugs = options.paper or SLUGS
    return 0 if machines.measure(project_root(), asked, slugs, rounding_noise(), options.cores) else 1


def _accept(options) -> int:
    from marsedl.papers import rounding_noise
    from marsedl.replication import audit, verification

    root = project_root()
    for path in verification.accept_reference(root, _shared(), rounding_noise()):
        _say(f"wrote {path}")
    _say(f"wrote {verification.accept_inputs(root, _project().studies)}")
    results = _audited(root)
    _say(audit.format_results(results, audit.read_counts(root)))
    _say(f"wrote {audit.write_counts(root, results)}")
    return 1 if audit.findings(results) else 0


def _audit(options) -> int:
    from marsedl.replication import audit
    from marsedl.replication.verification import REMEDY

    root = project_root()
    results, committed = _audited(root), audit.read_counts(root)
    _say(audit.format_results(results, committed))
    changed = audit.count_changes(results, committed)
    if changed:
        _say(REMEDY)
    return 1 if changed or audit.findings(results) else 0


def _crate(options) -> int:
    from marsedl.papers import SLUGS, catalogue
    from marsedl.replication.crate import write_crate

    papers = {slug: catalogue(slug) for slug in SLUGS}
    _say(f"wrote {write_crate(project_root(), papers, _shared(size_of(options.config)), *options.config)}")
    return 0


def _new_paper(options) -> int:
    from marsedl.replication.scaffold import new_paper, next_steps

    root = project_root()
    written = new_paper(root, options.slug, options.title, options.authors, not options.without_monte_carlo)
    for path in written:
        _say(f"wrote {path.relative_to(root)}")
    _say(f"\n{next_steps(options.slug)}")
    return 0


def _audited(root) -> list:
    """The audit of the project, all of its papers and comparisons."""
    from importlib import import_module

    from marsedl.comparison import comparisons
    from marsedl.papers import catalogue
    from marsedl.replication import audit

    subjects = [
        audit.Subject(
            catalogue(slug),
            study,
            _published(root, slug),
            import_module(f"marsedl.papers.{slug}.claims").DECLARATIONS,
        )
        for slug, study in _project().studies.items()
    ]
    return audit.audit(root, subjects, comparisons(), TARGETS)


_COMMANDS = {
    "completion": _completion,
    "list": _list,
    "explain": _explain,
    "diff": _diff,
    "trial": _trial,
    "verify": _verify,
    "machines": _machines,
    "accept": _accept,
    "audit": _audit,
    "crate": _crate,
    "new-paper": _new_paper,
}

if __name__ == "__main__":
    sys.exit(main())
