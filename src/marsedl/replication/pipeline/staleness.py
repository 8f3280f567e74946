"""What every product of a build is made from now, and which products were made from something else.

A product's recipe holds what its job is given beside other products (inputs, digests of code and files, versions of
libraries) and the digests of the recipes of those products (`needs`). An artifact keeps its recipe in its provenance.
For all else, the job writes the digest of the recipe to a file below `RECORDS` when it ends. So a build knows what it
was made from wherever it is copied, and Snakemake's own records may be lost.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from marsedl.replication.errors import ArtifactError, StaleError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.readings import Study, committed_inputs, counted_inputs
from marsedl.replication.pipeline.catalogue import TEXTS, Paper, entry_of
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.pipeline.libraries import versions_used
from marsedl.replication.pipeline.numerics import NUMERIC_ENVIRONMENT
from marsedl.replication.pipeline.sharing import Shared
from marsedl.replication.records.recipes import FORMAT, recipe_changes, recipe_digest
from marsedl.replication.sizes import FULL

ARTIFACTS = "data/cache/"
RECORDS = f"{ARTIFACTS}recipes/"  # beside the artifacts, as it is they that a copy of a build must have
BENCHMARKS = "data/reference/benchmarks.csv"
_TEMPLATES = "src/marsedl/replication/report/templates"


@dataclass(frozen=True)
class Made:
    """One job: its name, what it is given beside products, and the products that it takes."""

    name: str  # of its record
    own: Mapping[str, object]
    needs: tuple[str, ...]


class Recipes:
    """The recipes of all products, which are named by their paths from the folder of the build on.

    Only this class knows what a product depends on: the rules take their params from it.
    """

    def __init__(
        self,
        root: Path,
        papers: Mapping[str, Paper],
        studies: Mapping[str, Study],
        comparisons: Mapping[str, object],
        size: str = FULL,
    ):
        """Take the project's folder, the catalogues and readings of all papers, and the comparisons across them."""
        self.root, self.papers, self.studies, self.comparisons, self.size = root, papers, studies, comparisons, size
        self.sources = fingerprints_of(root)
        self.code, self.libraries = cache(self._code), cache(self._libraries)
        self.shared = {slug: Shared(papers[slug], studies[slug], self._of_stage) for slug in papers}
        self._committed = committed_inputs(root)
        self._jobs: dict[str, Made] = {}
        self._digests: dict[str, str] = {}

    # --- what jobs are given

    def _code(self, script: str, *entries: str) -> str:
        """Digests of what a job's script and functions reach, and of the settings that all jobs have."""
        settings = recipe_digest({"format": FORMAT, "environment": NUMERIC_ENVIRONMENT})
        digests = [self.sources.code(script), *map(self.sources.code, entries), settings]
        return " ".join(digest[:16] for digest in digests)

    def _libraries(self, script: str, *entries: str) -> str:
        """Versions of the libraries that a job's numbers can depend on: those that its script and functions use."""
        used = [self.sources.libraries(script), *map(self.sources.libraries, entries)]
        return versions_used(frozenset().union(*used))

    def _of_stage(self, entries: Iterable[str]) -> dict[str, str]:
        return self._reached("stage.py", *entries)

    def _reached(self, script: str, *entries: str) -> dict[str, str]:
        return {"code": self.code(script, *entries), "libraries": self.libraries(script, *entries)}

    def file_digest(self, name: str) -> str:
        """Return the digest of a file of the project; empty if there is none."""
        path = self.root / name
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""

    def given(self, paper: str, reading: str, names: Iterable[str]) -> dict[str, object]:
        """Return inputs of a reading by "section.name"."""
        return self.studies[paper].readings[reading].slice(names)

    def claimed(self, paper: str, reading: str) -> dict[str, str]:
        """Return all artifacts of a reading that its claims use, by the name of the parameter that takes them."""
        return {name.split(".")[-1]: path for name, path in self.shared[paper].claimed(reading).items()}

    def cache(self, paper: str) -> list[str]:
        """Return all artifacts of a paper that its claims use."""
        readings = self.studies[paper].compared
        return sorted({path for reading in readings for path in self.claimed(paper, reading).values()})

    def products(self, paper: str) -> list[str]:
        """Return all figures and tables of a paper that `snakemake all` makes."""
        catalogue = self.papers[paper]
        tables = [*catalogue.tables, *catalogue.summaries, "claims"]
        return [f"figures/{paper}/{stem}.{ext}" for stem in catalogue.figures for ext in ("png", "pdf")] + [
            f"figures/{paper}/{stem}.{ext}" for stem in tables for ext in ("csv", "md")
        ]

    def compared(self) -> list[str]:
        """Return all figures and tables of the comparison across papers."""
        return [f"figures/comparison/{stem}.{ext}" for stem in self.comparisons for ext in ("png", "pdf", "csv", "md")]

    def all(self) -> list[str]:
        """Return what `snakemake all` makes, but for what these are made from."""
        return ["report/index.html", "report/claims.json", *(p for slug in self.papers for p in self.products(slug))]

    def compared_artifacts(self, stem: str) -> dict[str, dict[str, str]]:
        """Return the artifacts of a comparison by paper, by parameter."""
        takes = self.comparisons[stem].takes
        return {slug: self.shared[slug].files(CORRECTED, taken.needs, taken.optional) for slug, taken in takes.items()}

    def claims_entries(self, paper: str) -> list[str]:
        """Return a paper's claims with what they share, and its tables over all readings."""
        summaries = [entry_of(paper, "tables", stem) for stem in self.papers[paper].summaries]
        return [*self.sources.functions(f"marsedl.papers.{paper}.claims"), *summaries]

    def as_committed(self, paper: str) -> bool:
        """Whether verdicts count: the full size, with the inputs that the committed verdicts were found with."""
        return self.size == FULL and self._committed.get(paper) == counted_inputs(self.studies[paper])

    # --- jobs

    def job(self, path: str) -> Made:
        """Return the job that makes a product."""
        if path not in self._jobs:
            self._jobs[path] = self._find(path)
        return self._jobs[path]

    def _find(self, path: str) -> Made:
        first, second, *others = path.split("/")
        if path.startswith(ARTIFACTS):
            paper, reading, name = self.artifact(path)
            return Made("", self.shared[paper].recipe(reading, name), tuple(self.shared[paper].needs(reading, name)))
        stem = (others[-1] if others else second).rpartition(".")[0]
        if first == "report":
            of_paper = {"claims": self._claims, "counterexamples": self._counterexamples}
            of_all = {"claims.json": self._all_claims, "badge.json": self._all_claims, "digests.json": self._digests_of}
            return of_paper[second](stem) if second in of_paper else of_all.get(second, self._site)()
        if second == "comparison":
            return self._comparison(stem)
        if stem in {*self.papers[second].summaries, "claims"} and len(others) == 1:
            return self._claims(second)
        return self._product(second, others[0] if len(others) > 1 else CORRECTED, stem)

    def artifact(self, path: str) -> tuple[str, str, str]:
        """Return paper, reading and name of an artifact."""
        paper, reading, name = path.rpartition(ARTIFACTS)[2].removesuffix(".h5").split("/", 2)
        return paper, reading, name

    def stems(self, paper: str, stem: str) -> list[str]:
        """Return the products that one job makes together: a figure alone, tables with those of equal needs."""
        if stem in self.papers[paper].figures:
            return [stem]
        return next(tables for tables in self.papers[paper].tables_of_equal_needs() if stem in tables)

    def _product(self, paper: str, reading: str, stem: str) -> Made:
        stems, catalogue = self.stems(paper, stem), self.papers[paper]
        kind = "figures" if stem in catalogue.figures else "tables"
        products = [catalogue.product(name) for name in stems]
        shows_printed = any(product.published for product in products)
        own = {
            "stems": stems,
            "inputs": self.given(paper, reading, {name for product in products for name in product.inputs}),
            "printed": self.file_digest(f"data/published/{paper}.yaml") if shows_printed else "",
            **self._reached(f"{kind}.py", *(entry_of(paper, kind, name) for name in stems)),
        }
        files = self.shared[paper].files(reading, products[0].needs, products[0].optional)
        place = f"{paper}/" if reading == CORRECTED else f"{paper}/{reading}/"
        return Made(f"figures/{place}{stems[0]}", own, tuple(files.values()))

    def _comparison(self, stem: str) -> Made:
        compared = self.comparisons[stem]
        entries = [f"marsedl.comparison.{stem}:{name}" for name in ("figure", "table", *compared.papers)]
        own = {
            "inputs": {slug: self.given(slug, CORRECTED, taken.inputs) for slug, taken in compared.takes.items()},
            **self._reached("comparison.py", *entries),
        }
        files = self.compared_artifacts(stem)
        return Made(f"figures/comparison/{stem}", own, tuple(path for of in files.values() for path in of.values()))

    def _judging(self, paper: str, readings: Iterable[str]) -> dict[str, object]:
        """What claims are judged from in some readings."""
        return {
            "inputs": {name: self.studies[paper].readings[name].inputs.plain() for name in readings},
            "artifacts": {name: self.claimed(paper, name) for name in readings},
            "published": self.file_digest(f"data/published/{paper}.yaml"),
            "measured": self.file_digest(BENCHMARKS) if self.papers[paper].measured else "",
        }

    def _claims(self, paper: str) -> Made:
        study, catalogue = self.studies[paper], self.papers[paper]
        judged = {
            "known_errata": [erratum.id for erratum in catalogue.errata],
            "require_reasons": self.as_committed(paper),
            "left_out": sorted(study.readings.keys() - set(study.compared)),
            "size": self.size,
        }
        reached = self._reached("claims.py", *self.claims_entries(paper))
        own = {**self._judging(paper, study.compared), "judged": judged, **reached}
        return Made(f"report/claims/{paper}", own, tuple(self.cache(paper)))

    def _counterexamples(self, paper: str) -> Made:
        own = {
            **self._judging(paper, [CORRECTED]),
            **self._reached("counterexamples.py", *self.claims_entries(paper)),
        }
        needs = (*sorted(self.claimed(paper, CORRECTED).values()), f"report/claims/{paper}.json")
        return Made(f"report/counterexamples/{paper}", own, needs)

    def _all_claims(self) -> Made:
        needs = [f"report/{kind}/{paper}.json" for kind in ("claims", "counterexamples") for paper in self.papers]
        return Made("report/claims", {"code": self.code("all_claims.py")}, tuple(needs))

    def _every_product(self) -> list[str]:
        of_papers = [path for paper in self.papers for path in self.products(paper) + self.cache(paper)]
        return [*of_papers, *self.compared(), "report/claims.json"]

    def _digests_of(self) -> Made:
        return Made("report/digests", {"code": self.code("digests.py")}, tuple(self._every_product()))

    def _site(self) -> Made:
        shown = [(paper, name) for paper, catalogue in self.papers.items() for name in catalogue.closeups]
        closeups = [entry_of(paper, "closeups", name) for paper, name in shown]
        places = [*(f"papers/{paper}" for paper in self.papers), "comparison"]
        templates = sorted(path.name for path in (self.root / _TEMPLATES).glob("*.*"))
        files = [BENCHMARKS, *(f"src/marsedl/{place}/{TEXTS}" for place in places)]
        own = {
            "size": self.size,
            "readings": {paper: self.described(paper) for paper in self.papers},
            "files": {name: self.file_digest(name) for name in (*files, *(f"{_TEMPLATES}/{t}" for t in templates))},
            "catalogues": {paper: self.sources.code(f"marsedl.papers.{paper}:PAPER") for paper in self.papers},
            "code": self.code("report.py", *closeups),
            "libraries": self.libraries("report.py", *closeups),
        }
        return Made("report/index", own, (*self._every_product(), "report/digests.json"))

    def described(self, paper: str) -> dict[str, dict]:
        """Return a paper's readings for the report: what they are for, every input as it is written, its source."""
        return {
            name: {
                "summary": reading.summary,
                "based_on": reading.based_on,
                "frozen": bool(reading.frozen),
                "inputs": {key: [source.key, source.written, source.source] for key, source in reading.sources.items()},
            }
            for name, reading in self.studies[paper].readings.items()
        }

    # --- recipes and records

    def digest(self, path: str) -> str:
        """Return the digest of a product's recipe, see `replication/records/recipes.py`."""
        job = self.job(path)
        key = job.name or path
        if key not in self._digests:
            recipe = job.own if not job.name else {**job.own, "needs": {need: self.digest(need) for need in job.needs}}
            self._digests[key] = recipe_digest(recipe)
        return self._digests[key]

    def record(self, path: str) -> tuple[str, str]:
        """Return the file in which a job records what its products were made from, and the digest for it.

        path: of a product; whatever stands before `figures` or `report` is where Snakemake keeps it.
        """
        path = re.search(r"(figures|report)/.*", path)[0]
        return f"{RECORDS}{self.job(path).name}.txt", self.digest(path)

    def reason(self, path: str, folder: Path) -> str:
        """Say why a product of the build in a folder is not what would be made now; empty if it is.

        Raises ArtifactError if it is a damaged artifact.
        """
        if not (folder / path).exists():
            return "is missing"
        if path.startswith(ARTIFACTS):
            from marsedl.replication.records.store import provenance

            stored = provenance(folder / path)
            if stored.get("recipe") == self.digest(path):
                return ""
            return f"was made from something else: {'; '.join(recipe_changes(stored, self.job(path).own))}"
        name, digest = self.record(path)
        record = folder / name
        recorded = record.read_text(encoding="utf-8").strip() if record.exists() else ""
        if recorded == digest:
            return ""
        return "was made from other inputs or code" if recorded else "has no record of what it was made from"

    def is_stale(self, path: str, folder: Path) -> bool:
        """Whether a product is there but is not what would be made now; a damaged one speaks for itself when read."""
        try:
            return (folder / path).exists() and bool(self.reason(path, folder))
        except ArtifactError:
            return False

    def behind(self, targets: Iterable[str]) -> Iterator[str]:
        """Yield products with all that they are made from, nothing before what it needs."""
        seen: set[str] = set()

        def visit(path: str) -> Iterator[str]:
            if path not in seen:
                seen.add(path)
                for need in self.job(path).needs:
                    yield from visit(need)
                yield path

        for target in targets:
            yield from visit(target)

    def check(self, targets: Iterable[str], folder: Path, command: str) -> list[str]:
        """Return products of a build with all that they are made from.

        Raises StaleError, which names the command that mends it, for the first that is missing or stale.
        """
        files = list(self.behind(targets))
        for path in files:
            if reason := self.reason(path, folder):
                raise StaleError(f"{folder / path} {reason}; the build is not up to date, run '{command}'")
        return files
