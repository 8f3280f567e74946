"""What a paper consists of: its stages, figures and tables, with what each of them depends on."""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple

TEXTS = "texts.yaml"  # in the folder of a paper, and in that of the comparisons: captions and other words
FLIGHTS = "montecarlo"  # the stage of which each Monte Carlo case has an artifact


def stage(*, claimed_in: tuple[str, ...] = ()) -> Callable:
    """Mark a function of a paper as a stage; its signature says what it needs, see `declarations.py`.

    Claims use it in the readings of `claimed_in`, or in all; it can be built for any. They are written as literals, as
    nothing is imported to read them.
    """
    return lambda function: function


@dataclass(frozen=True)
class Stage:
    """One cached computation, as its function declares it."""

    entries: tuple[str, ...]  # "package.module:function"; of chunks the first flies one, and the second joins all
    inputs: tuple[str, ...]  # that they read
    needs: tuple[str, ...]  # artifacts that they take
    meaning: str
    claimed_in: tuple[str, ...] = ()


@dataclass(frozen=True)
class Product:
    """One figure or table: its caption, whether it goes beyond the paper, and what its function declares."""

    caption: str
    beyond: bool = False
    needs: tuple[str, ...] = ()  # artifacts that it takes
    optional: tuple[str, ...] = ()  # taken where the reading has them
    inputs: tuple[str, ...] = ()  # that it reads
    published: bool = False  # whether it shows printed values
    claims: tuple[str, ...] = ()  # ids of those that are about a figure of the paper
    shape: tuple[str, ...] = ()  # those of them that say where its curves rise, fall, jump or turn, or their order
    not_comparable: str = ""  # why nothing that the paper says of its figure can be tested
    likeness: str = ""  # to the paper's own figure, see `report/likeness.py`
    why: str = ""


class Flown(NamedTuple):
    """Which trials a job flies."""

    case: str
    trials: int  # of the whole case
    block_size: int  # trials in a block
    chunk: int = 0  # number of this chunk
    chunks: int = 1  # number of all
    alone: bool = False  # the last of these trials, and no other; its history is kept


class Trial(NamedTuple):
    """One trial that is flown again, see `Trial.flown`."""

    case: str
    number: int
    stored: object = None  # the ensemble that it is compared with

    @property
    def flown(self) -> Flown:
        """What a job flies to fly this trial alone."""
        return Flown(self.case, self.number + 1, 1, alone=True)


class Solve(NamedTuple):
    """The fields in which an artifact says how an iterative solver ended.

    `ended` holds a word for each solve, or whether it converged. `what` says what is solved, if not the artifact.
    """

    artifact: str
    ended: str
    iterations: str = ""
    residual: str = ""
    what: str = ""


@dataclass(frozen=True)
class Erratum:
    """An error or gap in the printed paper: what is printed, the evidence against it, what is used instead."""

    id: str
    printed: str
    evidence: str
    used: str
    title: str = ""  # in a few words


@dataclass(frozen=True)
class Paper:
    """The bill of materials of one replicated paper.

    `stages` are filled in from the paper's functions, and what has captions from its `texts.yaml`. `figures` and
    `tables` exist for every reading. `described` says in our words what each figure of the paper shows and what the
    paper finds in it; captions say what is drawn here.
    `question` is what the paper asks, in a sentence; `in_short` a few sentences on what came out; `found` says of each
    headline claim, by its id, what came out. `beside` are further printed numbers in the picture of the headline
    claims: panels by title, and claims by label in each ("claim", or "claim[0]"). `unmarked` says of printed
    numbers, by the ids of their claims, why no figure marks them.
    `solves` says where solvers tell how they ended.
    Jobs simulate whole blocks of trials. `noise`: patterns of "reading/artifact/field" that are too ill-conditioned to
    compare across machines. The claims of a `measured` paper speak of run times: its evaluators are given its rows of
    data/reference/benchmarks.csv.
    """

    slug: str
    title: str
    authors: str
    citation: str
    figures: dict[str, Product] = field(default_factory=dict)
    tables: dict[str, Product] = field(default_factory=dict)
    described: dict[str, str] = field(default_factory=dict)
    solves: tuple[Solve, ...] = ()
    errata: tuple[Erratum, ...] = ()
    question: str = ""
    in_short: tuple[str, ...] = ()
    found: dict[str, str] = field(default_factory=dict)
    unmarked: dict[str, str] = field(default_factory=dict)
    beside: dict[str, dict[str, str]] = field(default_factory=dict)
    trials_per_block: int = 1000
    noise: tuple[str, ...] = ()
    measured: bool = False
    stages: dict[str, Stage] = field(default_factory=dict)

    def product(self, stem: str) -> Product:
        """Return a figure or table that exists for every reading."""
        return self.figures.get(stem) or self.tables[stem]

    def tables_by_job(self) -> list[list[str]]:
        """Return the names of the tables that one job makes, the first of which takes all artifacts of the others.

        They are made from the same artifacts, or from some of them; where these hold flights, which a reading may lack,
        from the same alone.
        """
        groups: dict[tuple, list[str]] = {}
        for stem, table in sorted(self.tables.items(), key=lambda named: -len(named[1].needs)):
            taken = table.needs, table.optional
            wider = [of for of in groups if {*taken[0]} <= {*of[0]} and not any(FLIGHTS in need for need in of[0])]
            job = wider[0] if taken[0] and wider else taken
            groups.setdefault(job, []).append(stem)
        return list(groups.values())


@dataclass(frozen=True)
class Arena:
    """A scenario in which guidance laws are compared: which code and inputs it takes, and what it shows."""

    name: str
    paper: str  # whose `corrected` inputs it takes
    entries: tuple[str, ...]  # "package.module:function" of what flies
    shows: tuple[str, ...]  # of what draws and tabulates
    title: str
    summary: str
    figures: dict[str, str]  # captions
    tables: dict[str, str]

    def kinds(self) -> list[tuple[dict[str, str], tuple[str, str]]]:
        """Return figures and tables with the endings of their files."""
        return [(self.figures, ("png", "pdf")), (self.tables, ("csv", "md"))]


def entry_of(paper: str, kind: str, name: str) -> str:
    """Return the entry "package.module:function" of a paper's function; kind: its module, such as figures."""
    return f"marsedl.papers.{paper}.{kind}:{name}"


def function_of(entry: str) -> Callable:
    """Return the function of an entry."""
    module, _, name = entry.partition(":")
    return getattr(import_module(module), name)


def constraint_of(paper: str) -> Callable | None:
    """Return the function of `papers/<slug>/admissible.py`, if there is one.

    It raises InadmissibleError for a universe that contradicts what the paper prints; it takes sections and artifacts.
    """
    entry = entry_of(paper, "admissible", "admissible")
    return function_of(entry) if find_spec(entry.partition(":")[0]) else None


def whole_case(case: str, trials: int, paper) -> dict[str, object]:
    """Return the options of a stage that flies a whole Monte Carlo case."""
    return {"case": case, "trials": trials, "block_size": paper.trials_per_block}
