"""The command `marsedl`: lists, explains, compares and checks what the workflow builds, and starts new papers.

A command is one function, whose docstring is its help; it returns the exit status unless that is 0. What takes long to
import is imported where it is used.
"""

import argparse
import contextlib
import re
import shlex
import sys
from collections.abc import Iterable
from functools import cache, cached_property
from pathlib import Path

import marsedl
from marsedl import overview
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError, MarsedlError, StaleError, nearest
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline import numerics
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.sizes import FULL, build_folder
from marsedl.replication.terminal import printable

ARENA = Path("build/arena")  # what `marsedl fly` writes
TARGETS = (
    "all",
    "papers",
    "claims",
    "comparison",
    "arena",
    "report",
    "verify",
)  # of the workflow, beside one for every paper


def main(arguments: list[str] | None = None) -> int:
    """Run the command.

    Returns 0, 1 if something differs or a check fails, 2 if the request is not valid, 3 if the build is not up to date.
    """
    try:
        numerics.check_start()
        options = command_line().parse_args(arguments)
        return COMMANDS[options.command](options) or 0
    except MarsedlError as error:
        print(f"marsedl: {printable(error)}", file=sys.stderr)
        return 3 if isinstance(error, StaleError) else 2
    except ModuleNotFoundError as error:
        print(f"marsedl: {error.name} is not installed; run: pip install 'marsedl[pipeline]'", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    finally:
        fingerprints_of().save()  # what it took to read the code, for the next command


def command_line() -> argparse.ArgumentParser:
    """Return the parser of all commands with their arguments."""
    parser = argparse.ArgumentParser(
        prog="marsedl",
        description="Replications of papers on Mars entry, descent and landing under uncertainty. This command shows "
        "and checks what 'snakemake' builds.",
        epilog="A reading is a complete set of inputs: 'printed' as in the paper, 'corrected' with its errors mended. "
        "A size says how much is computed: 'full', or 'smoke' with few trials. 'marsedl list' shows the papers.",
    )
    version = f"marsedl {marsedl.__version__}"
    parser.add_argument("--version", action="version", version=version, help="show the version and exit")
    shows = "'marsedl COMMAND --help' shows its arguments"
    commands = parser.add_subparsers(dest="command", required=True, metavar="command", help=shows)
    for name, function in COMMANDS.items():
        summary = function.__doc__.splitlines()[0].removesuffix(".")
        commands.add_parser(name, help=summary[0].lower() + summary[1:], description=function.__doc__)

    def add(names: str, *flags: str, **options) -> None:
        for name in names.split():
            commands.choices[name].add_argument(*flags, **options)

    add("list", "paper", nargs="?", help="a paper, such as powered_descent (default: all papers)")
    for kind in overview.KINDS:
        add("list", f"--{kind}", dest="kinds", action="append_const", const=kind, help=f"only {kind} (can be combined)")
    add("explain trial what-if universe compare", "paper", help="a paper, such as powered_descent")
    add("explain", "item", nargs="?", help="a figure, table, stage or claim (default: the whole paper)")
    add("explain", "--reading", metavar="NAME", default=CORRECTED, help="whose inputs to show (default: %(default)s)")
    add("explain", "--evidence", action="store_true", help="of a claim: also what was measured in each reading")
    add("diff", "a", type=Path, help="a file or folder")
    add("diff", "b", type=Path, help="the file or folder to compare it with")
    add("trial", "reading", help="a reading, such as corrected")
    add("trial", "case", nargs="?", default=argparse.SUPPRESS, help="a Monte Carlo case (default: the first one)")
    add("trial", "number", type=int, help="the number of the trial, counted from 0")
    add("trial", "--case", metavar="NAME", help="the Monte Carlo case, given as an option")
    what = "CHOICE=VALUE of 'marsedl explain PAPER', or an input as SECTION.KEY=VALUE"
    add("what-if", "changes", nargs="+", metavar="NAME=VALUE", help=what)
    what = "the reading that is changed (default: %(default)s)"
    add("what-if", "--reading", metavar="NAME", default=CORRECTED, help=what)
    add("what-if", "--trials", type=int, metavar="N", help="no number of trials exceeds N (default: as configured)")
    add("what-if", "--figure", metavar="NAME", help="draw this figure with both, side by side")
    add("what-if universe compare", "--json", action="store_true", help="write JSON")
    what = "a reading or universe:NUMBER; of another build FOLDER:reading or FOLDER:universe:NUMBER"
    add("compare", "mine", help=what)
    add("compare", "other", nargs="?", default=CORRECTED, help=f"what it is compared with (default: {CORRECTED})")
    add("compare", "-o", "--output", metavar="FILE", type=Path, help="the page (default: below build/compare)")
    add("universe", "number", type=int, help="its number in the table of universes")
    add("verify", "--no-rebuild", action="store_true", help="only compare the full size with the stored numbers")
    add("verify", "--all", action="store_true", help="show every number that moved, not only those of claims")
    what = "reference numbers of your own: a folder, or a file with --numbers"
    add("verify accept", "--reference", metavar="PATH", type=Path, help=what)
    what = "with --reference: a table of any results with the columns name, value, unit and standard_error"
    add("verify accept", "--numbers", metavar="CSV", type=Path, help=what)
    add("verify", "--tolerance", metavar="SE", default="3se", help="with --numbers: standard errors (default: 3se)")
    what = "with --reference: only this paper; can be repeated"
    add("verify accept", "--paper", metavar="NAME", action="append", default=[], help=what)
    add("new-paper", "slug", help="its name in files and targets, such as powered_descent")
    add("new-paper", "--title", default="Title to be given", help="the paper's title")
    add("new-paper", "--authors", default="Authors to be named", help="the paper's authors, in one line")
    add("new-paper", "--without-monte-carlo", action="store_true", help="one stage and no Monte Carlo trials")
    add("fly", "law", nargs="?", type=Path, help="a Python file or a gain table (default: residents alone)")
    what = "a scenario, or a file of yours that is based_on one (default: %(default)s)"
    add("fly new-law", "--scenario", metavar="NAME", default="entry", help=what)
    what = "in what it flies, such as exact or thick_air (default: %(default)s)"
    add("fly", "--condition", metavar="NAME", default="dispersed", help=what)
    add("fly", "--trials", type=int, metavar="N", default=2000, help="of each law (default: %(default)s)")
    what = "residents, separated by commas; empty for none (default: all)"
    add("fly", "--against", metavar="NAMES", help=what)
    what = "tune what the law names as TUNED, by so many flights of a pool of their own"
    add("fly", "--tune", type=int, metavar="N", default=0, help=what)
    what = "fly the sealed pool, a look that is counted, and a fresh one, in place of the pool for practice"
    add("fly", "--proof", action="store_true", help=what)
    add("fly", "-o", "--output", metavar="FOLDER", type=Path, help="default: build/arena/LAW")
    add("new-law", "name", help="its name, such as my_law")
    size = f"use the build of this size, such as smoke (default: {FULL})"
    add("list explain trial compare", "--size", metavar="NAME", help=size)
    add("verify accept", "--size", metavar="NAME", help=f"with --reference: {size}")
    file = "a file with readings of your own, or several, as for snakemake: after all other words"
    several = {"nargs": "+", "action": "extend", "default": []}
    names = "explain trial verify accept compare what-if universe"
    add(names, "--configfile", metavar="FILE", type=Path, help=file, **several)
    return parser


def project_root() -> Path:
    """Return the project's folder: the working directory or the nearest one above it that holds the Snakefile."""
    for folder in (Path.cwd(), *Path.cwd().parents):
        if (folder / "Snakefile").exists() and (folder / "configs").is_dir():
            return folder
    raise InputError(f"{Path.cwd()} is not inside a marsedl project; change to the folder that holds its Snakefile")


class Project:
    """The project in the size that a command asks for, else that of a user's file, with the readings in their files."""

    def __init__(self, size: str | None = None, config_files: Iterable[Path] = ()):
        """Load all studies; raises InputError as `load_studies`."""
        from marsedl.replication.claims.rows import read_claims
        from marsedl.replication.inputs.readings import load_studies

        self.root, models = project_root(), {slug: input_model(slug) for slug in SLUGS}
        self.studies = load_studies(models, self.root, {"size": size} if size else {}, config_files)
        self.size = self.studies[SLUGS[0]].size
        self.folder = build_folder(self.root, self.size)  # of the products of this size
        self._read_claims = cache(read_claims)
        # Of snakemake, to build this size with these readings.
        self.options = f" --config size={shlex.quote(size)}" if size and size != FULL else ""
        if config_files:
            paths, root = [path.resolve() for path in config_files], self.root.resolve()
            paths = [path.relative_to(root) if path.is_relative_to(root) else path for path in paths]
            self.options += f" --configfile {shlex.join(map(str, paths))}"

    @cached_property
    def products(self):
        """All products with what they are made from."""
        from marsedl.comparison import comparisons
        from marsedl.replication.pipeline.products import Products
        from marsedl.scenarios import arenas

        papers = {s: catalogue(s) for s in SLUGS}
        return Products(self.root, papers, self.studies, comparisons(), self.size, arenas())

    def check(self, products: list[str], command: str = "") -> None:
        """Raise StaleError, which names the command to run, if products of this size are not up to date."""
        from marsedl.replication.pipeline.staleness import check

        check(self.products, products, self.folder, f"snakemake {command or ' '.join(products)}{self.options}")

    def verdicts(self, slug: str) -> dict:
        """A paper's verdicts by the ids of its claims, of its last build alone or with all; empty if there is none."""
        files = [self.folder / "report" / name for name in ("claims.json", f"claims/{slug}.json")]
        # Of equally old ones the first, which knows universes.
        newest = max(filter(Path.exists, files), key=lambda path: path.stat().st_mtime_ns, default=None)
        return {row.id: row for row in self._read_claims(newest) if row.paper == slug} if newest else {}

    def published(self, slug: str) -> list:
        """The printed claims of a paper."""
        from marsedl.replication.claims.printed import load_published

        return load_published(self.root / "data" / "published" / f"{slug}.yaml")

    def quotes(self, slug: str, reading: str = CORRECTED):
        """The numbers of this size that texts of a paper can quote."""
        from marsedl.replication.claims.quotes import Quotes

        return Quotes(self.verdicts(slug).values() or None, self.studies[slug].readings, reading)

    def paper(self, slug: str, reading: str = CORRECTED):
        """The catalogue of a paper with the numbers that its texts quote: of this size, else the committed ones."""
        from marsedl.replication.claims.quotes import accepted, with_numbers

        if not self.verdicts(slug) and reading == CORRECTED:
            with contextlib.suppress(InputError):  # a quote that was not accepted yet
                return with_numbers(catalogue(slug), accepted(self.root, slug))
        return with_numbers(catalogue(slug), self.quotes(slug, reading))


def _say(*texts: object) -> None:
    """Print texts, a line for each, with their control characters escaped."""
    for text in texts:
        print(printable(text))


def _list(options) -> None:
    """List papers with their readings, figures, tables, stages, Monte Carlo cases and claims.

    Without arguments it counts them; with a paper or a kind it names each one.
    """
    project = Project(options.size) if options.paper or options.kinds or options.size else None
    if options.paper or options.kinds:
        papers = [project.paper(slug) for slug in ([options.paper] if options.paper else SLUGS)]
        _say(*(line for paper in papers for line in overview.listed(project, paper, options.kinds)))
        return
    _say(*(overview.there(project_root(), slug) for slug in SLUGS))
    _say("'marsedl list PAPER' shows all of a paper, 'marsedl list --figures' all figures, and so on")
    _say("targets: " + ", ".join([*TARGETS, *SLUGS]))


def _explain(options) -> None:
    """Show what a paper, figure, table, stage or claim depends on.

    Shows the artifacts, the inputs with their sources and the code behind it, and the verdict on a claim.
    """
    paper, name = catalogue(options.paper), options.item
    slug, project = paper.slug, Project(options.size, options.configfile)
    reading = project.studies[slug].reading(options.reading)
    claims = {claim.id: claim for claim in project.published(slug)}
    kinds = [kind for kind in ("figures", "tables", "stages") if name in getattr(paper, kind)]
    if name is None:
        _say(*overview.explained_paper(project, paper, reading))
    elif name in claims:
        _say(*overview.explained_claim(project, claims[name], evidence=options.evidence))
    elif kinds:
        full = project if project.size == FULL else Project(FULL, options.configfile)
        quoted, unlimited = project.paper(slug, reading.name), full.studies[slug].reading(reading.name).inputs
        _say(*overview.explained_item(project, quoted, reading, unlimited, name, kinds))
    else:
        names = [*paper.figures, *paper.tables, *paper.stages, *claims]
        raise InputError(f"{slug} has no figure, table, stage or claim '{name}'; {nearest(name, names)}")


def _diff(options) -> int:
    """Compare two artifacts, figures, tables or folders of them.

    Prints what differs and by how much. The exit status is 1 if anything differs.
    """
    from marsedl.replication.records.differences import difference

    lines = difference(options.a, options.b)
    _say("\n".join(lines) or "no difference")
    return 1 if lines else 0


def _trial(options) -> None:
    """Simulate one Monte Carlo trial again.

    Prints how the trial goes, and whether it agrees with the stored ensemble if there is one.
    """
    numerics.pin_numerics(project_root())
    from marsedl.replication.pipeline import runner

    paper, project = catalogue(options.paper), Project(options.size, options.configfile)
    study = project.studies[paper.slug]
    cases = study.reading(options.reading).inputs.CASES
    if not cases:
        raise InputError(f"{paper.slug} has no Monte Carlo flights; 'marsedl list --cases' shows which do")
    trial = options.case or next(iter(cases)), options.number
    _say(runner.replay(project.folder, paper, study, options.reading, trial, project.options))


def _evaluator(options):
    """What computes universes of a paper, with the readings and choices of a user's file."""
    from marsedl.replication.universes.table import Evaluator

    project = Project(config_files=options.configfile)
    evaluator = Evaluator(catalogue(options.paper), input_model(options.paper), project.root)
    evaluator.study = project.studies[options.paper]
    return evaluator


def _what_if(options) -> None:
    """Compute a paper with other values of choices or inputs, and show which claims move.

    Computes in memory, and shows the verdicts that change and the numbers that move by more than their error.
    """
    numerics.pin_numerics(project_root())
    from marsedl.plotting.style import save_side_by_side
    from marsedl.replication.checks import compare
    from marsedl.replication.universes.what_if import WhatIf, changes_of, figure_entry

    paper, evaluator = catalogue(options.paper), _evaluator(options)
    if options.figure:
        figure_entry(paper, options.figure)  # refused before anything is computed
    if options.trials:
        evaluator.limit_trials(options.trials)
    what_if = WhatIf(evaluator, *changes_of(options.changes, evaluator.study.choices), options.reading)
    if not options.json:
        _say(*overview.asked(what_if, paper.slug))
        sys.stdout.flush()
    published = [*evaluator.published.values()]
    _say(*overview.moved(compare.difference(*what_if.sides()), published, as_json=options.json))
    if options.figure:
        path = Path("build/what-if") / options.paper / f"{options.figure}.png"
        save_side_by_side(what_if.drawn(options.figure), path)
        print(f"wrote {path}", file=sys.stderr)


def _compare(options) -> None:
    """Show what moved between a reading of yours and another one: inputs, verdicts, numbers and figures.

    Also compares two builds or two universes. Writes a page with the figures side by side.
    """
    from marsedl.replication.checks import compare
    from marsedl.replication.pipeline import staleness

    paper, project = catalogue(options.paper), Project(options.size, options.configfile)
    study, sides = project.studies[paper.slug], []
    for folder, of in [compare.named(name, study) for name in (options.other, options.mine)]:
        is_universe = isinstance(of, int)
        if not folder:
            project.check([f"report/universes/{paper.slug}.h5" if is_universe else f"report/claims/{paper.slug}.json"])
        take = compare.of_other_build if folder and not is_universe else compare.side_of
        sides.append(take(of, study, folder or project.folder))
    published = project.published(paper.slug)
    difference = compare.difference(*sides)
    _say(*overview.compared(difference, published, as_json=options.json))
    names = "-".join(re.sub(r"\W+", "_", side.name) for side in reversed(sides))
    path = options.output or Path("build/compare") / f"{paper.slug}-{names}.html"
    figures = project.folder / "figures"  # which this build makes

    def is_stale(picture: Path) -> bool:
        product = picture.relative_to(project.folder).as_posix() if picture.is_relative_to(figures) else ""
        return bool(product) and staleness.is_stale(project.products, product, project.folder)

    absent = compare.write_page(path, paper, difference, published, is_stale)
    print(f"wrote {path}", file=sys.stderr)
    if absent:
        own = [one.relative_to(project.folder).as_posix() for one in absent if one.is_relative_to(figures)]
        remedy = f"; run 'snakemake {' '.join(own)}{project.options}'" if own else ""
        print(f"without figures that are missing or not up to date{remedy}", file=sys.stderr)


def _universe(options) -> None:
    """Compute one universe of a paper again, and show its choices and what its claims give.

    Takes its choices and random numbers from the build's table of universes, else from the committed one, else from the
    design that has the number.
    """
    numerics.pin_numerics(project_root())
    from marsedl.replication.universes import what_if

    evaluator = _evaluator(options)
    slug, root = evaluator.paper.slug, project_root()
    tables = [root / f"{folder}/universes/{slug}.h5" for folder in ("report", "data/reference")]
    universe, path = what_if.found(evaluator.study, options.number, tables)
    where = path.relative_to(root).as_posix() if path else "its design, as no table has it"
    _say(*overview.universe(slug, *what_if.judged(evaluator, universe), where, as_json=options.json))


def _verify(options) -> int:
    """Check that results are reproducible.

    Builds the smoke size twice and compares every file, then judges all claims of the full-size build again from its
    artifacts and compares it with the stored numbers. With --reference it only compares a build with numbers of your
    own. The exit status is 1 if anything differs.
    """
    if options.numbers:
        from marsedl.replication.checks import numbers

        return 0 if numbers.compare_numbers(*_tables(options), numbers.tolerance_of(options.tolerance)) else 1
    from marsedl.replication.checks import judged_again, reference, twice, universes

    project, shared, made, folder = _up_to_date(options)
    equal = options.no_rebuild or folder is not None or twice.build_twice(project.root)
    given = {slug: project.products.job(f"report/claims/{slug}.json").params for slug in shared}
    agree = judged_again.check_judged(project.root, project.folder, given)
    compare = reference.compare_reference
    agree = compare(project.root, project.folder, shared, made, folder, all_of_them=options.all) and agree
    agree = (folder is not None or universes.compare_universes(project.root, project.folder, shared)) and agree
    return 0 if agree and equal else 1


def _accept(options) -> None:
    """Store the numbers of the full-size build as the reference.

    Prints what changes in data/reference. Run it after a full build whose changes you have looked at. With --reference
    it stores the numbers of a build in a folder of your own.
    """
    if options.numbers:
        from marsedl.replication.checks import numbers

        _say(numbers.accept_numbers(*_tables(options)))
        return
    from marsedl.replication.checks import reference, universes
    from marsedl.replication.claims import quotes

    project, shared, made, folder = _up_to_date(options)
    _say(*(f"wrote {path}" for path in reference.accept_reference(project.root, project.folder, shared, made, folder)))
    if folder is None:
        _say(*(f"wrote {path}" for path in universes.accept_universes(project.root, project.folder, shared)))
        _say(f"wrote {reference.accept_inputs(project.root, project.studies)}")
        quoted = {slug: (catalogue(slug), project.quotes(slug)) for slug in SLUGS}
        _say(f"wrote {quotes.accept(project.root, quoted)}")
        _readme(options)


def _tables(options) -> tuple[Path, Path]:
    """A table of any results, and the file of its reference."""
    if options.reference is None:
        raise InputError("--numbers needs --reference FILE, which 'marsedl accept' writes")
    return options.numbers, options.reference


def _up_to_date(options) -> tuple[Project, dict, dict, Path | None]:
    """The project; by paper, which reading owns each artifact and what it is made from; the user's own reference.

    Raises StaleError, with the command that helps, if claims or what they are made from are not up to date.
    """
    from marsedl.replication.checks import reference

    of_own_reference = ("paper", "size", "configfile") if options.command == "accept" else ("paper", "size")
    for name in of_own_reference:
        if getattr(options, name) and options.reference is None:
            raise InputError(f"--{name} needs --reference FOLDER, a folder with reference numbers of your own")
    papers = [catalogue(slug).slug for slug in options.paper or SLUGS]
    project = Project(options.size, options.configfile)
    if options.command == "verify":
        reference.check_size(project.root, papers, options.reference, project.size)
    targets = ["report/claims.json"] if options.reference is None else [f"report/claims/{slug}.json" for slug in papers]
    project.check(targets, "all" if options.reference is None else "")
    shared = {slug: project.products.shared[slug] for slug in papers}
    made = {slug: reference.made_from(project.root, one.paper, one.study, project.size) for slug, one in shared.items()}
    return project, shared, made, options.reference and options.reference.absolute()


def _readme(options) -> None:
    """Write what came out of each paper, by the stored verdicts, into README.md and its badge."""
    from marsedl.replication.claims.quotes import accepted, with_numbers
    from marsedl.replication.report import front_page

    root = project_root()
    papers = [with_numbers(catalogue(slug), accepted(root, slug)) for slug in SLUGS]
    _say(*(f"wrote {path}" for path in front_page.write(root, papers, {slug: input_model(slug) for slug in SLUGS})))


def _new_paper(options) -> None:
    """Create a small complete paper as the start of another replication.

    Writes its files and prints the next steps.
    """
    from marsedl.replication.checks.scaffold import new_paper, next_steps

    root = project_root()
    for path in new_paper(root, options.slug, options.title, options.authors, not options.without_monte_carlo):
        _say(f"wrote {path.relative_to(root)}")
    _say(f"\n{next_steps(options.slug)}")


def _fly(options) -> None:
    """Fly a law of yours against those that live here, in the same trials, and rank them.

    Without a law the residents fly alone. The law is a Python file, as 'marsedl new-law' writes one, or a gain table
    (CSV). Tables, trials and a figure go to a folder.
    """
    root = project_root()
    numerics.pin_numerics(root)
    from marsedl.scenarios.contest import Contest, scenario_of
    from marsedl.scenarios.scenario import POOLS

    if options.trials < 2 or options.tune < 0:
        raise InputError(f"--trials {options.trials}, --tune {options.tune}: give at least 2 trials, and flights")
    here = f"{Path.cwd()}/"  # files are shown as seen from there

    def say(*lines: str) -> None:
        _say(*(line.replace(here, "") for line in lines))

    contest = Contest(scenario_of(root, options.scenario), options.condition, say)
    if options.law:
        contest.enter(options.law, options.tune)
    contest.against(None if options.against is None else [*filter(None, options.against.split(","))])
    if not contest.laws:
        raise InputError(f"no law can fly here: {contest.refused}")
    folder, trials = options.output or ARENA / contest.name, options.trials
    tables = {"practice": ("the pool for practice", POOLS["practice"])}
    if options.proof:
        words, fresh = contest.proof(ARENA / "looks.csv")
        tables = {"proof": (words, POOLS["proof"])}
        tables |= {"fresh": ("a pool of this law's own", fresh)} if options.law else {}
    for stem, (words, seed) in tables.items():
        title = f"{contest.place}, {options.condition}: {trials:,} trials of {words}"
        contest.told(title, contest.fly(seed, trials), folder, stem)
    _say("", f"inside: {contest.scenario.box}", f"wrote {folder}")


def _new_law(options) -> None:
    """Write a small guidance law that lands, as the start of one's own."""
    from marsedl.scenarios.contest import new_law

    path = new_law(options.name, options.scenario, Path())
    _say(f"wrote {path}", f"fly it: marsedl fly {path} --scenario {options.scenario}")


COMMANDS = {
    "list": _list,
    "explain": _explain,
    "diff": _diff,
    "trial": _trial,
    "what-if": _what_if,
    "compare": _compare,
    "universe": _universe,
    "verify": _verify,
    "accept": _accept,
    "readme": _readme,
    "new-paper": _new_paper,
    "fly": _fly,
    "new-law": _new_law,
}

if __name__ == "__main__":
    sys.exit(main())
