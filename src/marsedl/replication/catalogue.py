"""What a paper consists of: its stages, figures and tables, with what each of them depends on."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Stage:
    """One cached computation.

    `inputs` are the names of the inputs it may use; `needs` the artifacts it loads. The function is `compute` in the
    module of the stage's name unless `function` names another one, "module:function" inside the paper's package. Claims
    use it in the readings of `claimed_in`, or in all; it can be built for any. Jobs of a higher `priority` start first.
    """

    inputs: tuple[str, ...]
    needs: tuple[str, ...] = ()
    function: str = ""
    meaning: str = ""
    claimed_in: tuple[str, ...] = ()
    priority: int = 0


@dataclass(frozen=True)
class Product:
    """One figure or table: its caption, and the artifacts and inputs that it is drawn from.

    `published` ones show printed values as well, and are made again when these change.
    """

    caption: str
    needs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    beyond: bool = False
    published: bool = False


@dataclass(frozen=True)
class Erratum:
    """A slip or gap in the printed paper: what is printed, the evidence against it, what is used instead."""

    id: str
    printed: str
    evidence: str
    used: str


@dataclass(frozen=True)
class Paper:
    """The bill of materials of one replicated paper.

    `figures` and `tables` exist for every reading; `summaries` are tables over all readings, with their captions.
    `described` says in our words what each figure of the paper shows and what the paper finds in it; captions say what
    is drawn here. `closeups` are plots of the report that a reader can look into, with the artifacts that they need.
    A block of trials is the least that is simulated by one job. `noise` are patterns of "reading/artifact/field" whose
    numbers an ill-conditioned problem leaves to rounding: other machines are not expected to find the same. The claims
    of a `measured` paper speak of run times: its evaluators are given its rows of data/reference/benchmarks.csv.
    """

    slug: str
    title: str
    authors: str
    citation: str
    stages: dict[str, Stage]
    figures: dict[str, Product]
    tables: dict[str, Product] = field(default_factory=dict)
    summaries: dict[str, str] = field(default_factory=dict)
    described: dict[str, str] = field(default_factory=dict)
    closeups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    errata: tuple[Erratum, ...] = ()
    trials_per_block: int = 1000
    noise: tuple[str, ...] = ()
    measured: bool = False

    def entry(self, stage: str) -> str:
        """Return the stage's function as "package.module:function"."""
        module, _, function = (self.stages[stage].function or f"{stage}:compute").partition(":")
        return f"marsedl.papers.{self.slug}.{module}:{function}"

    def product(self, stem: str) -> Product:
        """Return a figure or table that exists for every reading."""
        return self.figures.get(stem) or self.tables[stem]
