"""What products a build has, which job makes each of them, and what that job is given.

A product's recipe holds what its job is given beside other products (inputs, digests of code and files, versions of
libraries) and the digests of the recipes of those products (`needs`). `staleness.py` compares it with what is kept of
the recipe that a product was made from.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import InputError
from marsedl.replication.inputs import CORRECTED, UNIVERSES
from marsedl.replication.inputs.readings import Study, committed_inputs, counted_inputs
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import TEXTS, Arena, Paper, entry_of
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.pipeline.libraries import versions_used
from marsedl.replication.pipeline.numerics import NUMERIC_ENVIRONMENT
from marsedl.replication.pipeline.sharing import ARTIFACTS, Shared, artifact_of
from marsedl.replication.records.recipes import FORMAT, file_digest, recipe_digest
from marsedl.replication.sizes import FULL

RECORDS = f"{ARTIFACTS}recipes/"  # beside the artifacts, as it is they that a copy of a build must have
BENCHMARKS = "data/reference/benchmarks.csv"
COMMITTED_RUNS = "data/reference/universes/"
MEASURED_FROM = ("kind", "printed", "unit", "resolution", "trials", "input")  # of a printed claim, by what measures it
SEALED = "data/reference/arena/"  # tables of laws on the sealed pool of trials
BLOCK, CHUNK = 250, 5_000  # trials of the arena: whose bits are compared at once, and that a job flies
_TEMPLATES = "src/marsedl/replication/report/templates"


def _by_chance(numbers: Iterable[int], drawn: str, count: int) -> list[int]:
    """So many of these numbers, sorted, as a text draws them."""
    return sorted(sorted(numbers, key=lambda one: hashlib.sha256(f"{drawn} {one}".encode()).digest())[:count])


class PlannedJob(NamedTuple):
    """One job: its name, what it is given beside products, and the products that it takes."""

    name: str  # of its record; artifacts have none
    params: dict[str, object]
    needs: list[str]


class Products:
    """All products, which are named by their paths from the folder of the build on, with their jobs and recipes.

    Only this class knows what a product depends on: the rules ask it for artifacts and params.
    """

    def __init__(
        self,
        root: Path,
        papers: dict[str, Paper],
        studies: dict[str, Study],
        comparisons: dict,
        size: str = FULL,
        arenas: Mapping[str, Arena] = {},
        trials: int | None = None,
        chunks: int | None = None,
    ):
        """Take the project's folder, the catalogues and readings of all papers, and the comparisons across them.

        arenas: scenarios in which laws are compared; trials: of each law there, None for a sample; chunks: so many
        jobs fly them
        """
        self.root, self.papers, self.studies, self.comparisons, self.size = root, papers, studies, comparisons, size
        self.arenas, self.trials, self.chunks = arenas, trials, chunks
        self.sources = fingerprints_of(root)
        self.job, self._reached = cache(self._job), cache(self._reached_by)
        self._world = cache(self._world_of)  # not to be changed
        self.shared = {slug: Shared(papers[slug], studies[slug], self._reached) for slug in papers}
        self._committed, self._digests = committed_inputs(root), {}

    # --- what there is

    def claimed(self, paper: str, reading: str) -> dict[str, str]:
        """Return all artifacts of a reading that its claims use, by the name of the parameter that takes them."""
        return {name.split(".")[-1]: path for name, path in self.shared[paper].claimed(reading).items()}

    def cache(self, paper: str) -> list[str]:
        """Return all artifacts of a paper that its claims use."""
        return sorted({path for name in self.studies[paper].built for path in self.claimed(paper, name).values()})

    def shown(self, paper: str) -> list[str]:
        """Return all figures and tables of a paper that `snakemake all` makes."""
        catalogue = self.papers[paper]
        kinds = (catalogue.figures, "png pdf"), ([*catalogue.tables, "claims"], "csv md")
        files = [f"figures/{paper}/{stem}.{suffix}" for of, ends in kinds for stem in of for suffix in ends.split()]
        return [*files, f"figures/{paper}/headline.png"]

    def compared(self) -> list[str]:
        """Return all figures and tables of the comparison across papers."""
        return [f"figures/comparison/{stem}.{ext}" for stem in self.comparisons for ext in ("png", "pdf", "csv", "md")]

    def fought(self) -> list[str]:
        """Return all figures and tables of the arena."""
        kinds = [(name, of, ends) for name, arena in self.arenas.items() for of, ends in arena.kinds()]
        return [f"figures/arena/{name}/{stem}.{suffix}" for name, of, ends in kinds for stem in of for suffix in ends]

    def all(self) -> list[str]:
        """Return what `snakemake all` makes, but for what these are made from."""
        shown = [path for slug in self.papers for path in self.shown(slug)]
        return ["report/index.html", "report/claims.json", *shown]

    # --- jobs

    def _reached_by(self, script: str, *entries: str, measuring: tuple[str, ...] = ()) -> dict[str, str]:
        """Digests of all code behind a job and of the settings of all jobs, and versions of the libraries in use.

        measuring: claims of which only what measures counts, and not what is said.
        """
        settings = recipe_digest({"format": FORMAT, "environment": NUMERIC_ENVIRONMENT})
        measured = [self.sources.measuring(*measuring)] if measuring else []
        digests = [*map(self.sources.code, (script, *entries)), *measured, settings]
        libraries = frozenset().union(*map(self.sources.libraries, (script, *entries, *measuring)))
        return {"code": " ".join(digest[:16] for digest in digests), "libraries": versions_used(libraries)}

    def _scripted(self, name: str, needs: Iterable[str], script: str, *entries: str, **params: object) -> PlannedJob:
        """The job of a script that calls some functions."""
        return PlannedJob(name, params | self._reached(script, *entries), [*needs])

    def _file_digest(self, name: str) -> str:
        """The digest of a file of the project."""
        try:
            return file_digest(self.root / name)
        except OSError as error:
            raise InputError(f"{self.root / name}: cannot be read ({error.strerror}); restore it") from None

    def _committed_run(self, paper: str) -> list[str]:
        """The file of a paper's committed universes, if it has one."""
        run = f"{COMMITTED_RUNS}{paper}.h5"
        return [run] if (self.root / run).exists() else []

    def _files(self, names: Iterable[str]) -> dict[str, str]:
        """The digests of files of the project, of which the rule names those that a recipe has under `files`."""
        return {name: self._file_digest(name) for name in names}

    def _job(self, path: str) -> PlannedJob:
        """The job that makes a product; `job` remembers it."""
        stem = path.rpartition("/")[2].rpartition(".")[0]
        match path.split("/"):
            case "data", *_:
                paper, reading, name = artifact_of(path)
                return PlannedJob("", self.shared[paper].recipe(reading, name), self.shared[paper].needs(reading, name))
            case "report", "claims", _:
                return self._claims(stem)
            case "report", "counterexamples", _:
                needs = [*sorted(self.claimed(stem, CORRECTED).values()), f"report/claims/{stem}.json"]
                job = f"report/counterexamples/{stem}", needs, "counterexamples.py", *self._claims_entries(stem)
                return self._scripted(*job, **self._judging(stem, [CORRECTED]))
            case "report", "universes", name if name.endswith(".json"):
                return self._what_decides(stem)
            case "report", "points", _:
                return self._points(stem)
            case "report", "universes", "whole" | "waves", _:
                return self._universes(stem.partition(".")[0], "whole/")
            case "report", "universes", _:
                return self._universes(stem.partition(".")[0])
            case "report", "arena", name:
                return self._arena(name)
            case _, "arena", name, _:
                return self._fought(name)
            case "report", "claims.json":
                kinds = "claims", "counterexamples", "universes"
                needs = [f"report/{kind}/{paper}.json" for kind in kinds for paper in self.papers]
                return self._scripted("report/claims", needs, "all_claims.py")
            case "report", *_:
                return self._site()
            case _, "comparison", _:
                return self._comparison(stem)
            case _, paper, folder, _ if folder == UNIVERSES:
                return self._what_decides(paper)
            case _, paper, "claims.csv" | "claims.md" | "headline.png":
                return self._claims(paper)
            case _, paper, *reading, _:
                return self._product(paper, reading[0] if reading else CORRECTED, stem)

    def _product(self, paper: str, reading: str, stem: str) -> PlannedJob:
        """A figure, or all tables that one job makes, the first of which takes all artifacts."""
        catalogue, kind, stems = self.papers[paper], "figures", [stem]
        if stem not in catalogue.figures:
            kind, stems = "tables", next(tables for tables in catalogue.tables_by_job() if stem in tables)
        products = [catalogue.product(name) for name in stems]
        inputs = {name for product in products for name in product.inputs}
        printed = any(product.published for product in products)
        return self._scripted(
            f"figures/{paper}/{'' if reading == CORRECTED else f'{reading}/'}{stems[0]}",
            self.shared[paper].files(reading, products[0].needs, products[0].optional).values(),
            *(f"{kind}.py", *(entry_of(paper, kind, name) for name in stems)),
            stems=stems,
            inputs=self.shared[paper].inputs(reading, inputs),
            printed=self._file_digest(f"data/published/{paper}.yaml") if printed else "",
        )

    def _comparison(self, stem: str) -> PlannedJob:
        takes = self.comparisons[stem].takes
        files = [self.shared[slug].files(CORRECTED, taken.needs, taken.optional) for slug, taken in takes.items()]
        needs = [path for of_paper in files for path in of_paper.values()]
        entries = [f"marsedl.comparison.{stem}:{name}" for name in ("figure", "table", *takes)]
        inputs = {slug: self.shared[slug].inputs(CORRECTED, taken.inputs) for slug, taken in takes.items()}
        return self._scripted(f"figures/comparison/{stem}", needs, "comparison.py", *entries, inputs=inputs)

    def _arena(self, name: str) -> PlannedJob:
        """The tuning of laws, or the flights of a chunk of trials of all of them; see `_chunks_of_arena`."""
        name, _, what = name.partition(".")
        arena = self.arenas[name]
        given = {
            "inputs": {CORRECTED: self.shared[arena.paper].values[CORRECTED]},
            "files": self._files([f"configs/scenarios/{name}.yaml"]),
            "size": self.size,
            **self._reached(*arena.entries),
        }
        if what == "tuned.json":
            params = given | {"script": self.sources.code("arena_tuned.py")}
            return PlannedJob(f"report/arena/{name}.tuned", params, [])
        world, script = recipe_digest(given), self.sources.code("arena_flights.py")
        chunks = self._chunks_of_arena(name, world, script)
        params = given | {"world": world, "script": script, "chunks": chunks}
        return PlannedJob(f"report/arena/{name}.flights", params, [f"report/arena/{name}.tuned.json"])

    def _sealed(self, name: str) -> list[str]:
        """The file of a scenario's sealed table, if there is one."""
        path = f"{SEALED}{name}.json"
        return [path] if (self.root / path).exists() else []

    def _chunks_of_arena(self, name: str, world: str, script: str) -> list[list[list[int]]]:
        """First trial and number of the trials that each job of a scenario flies.

        By default a job flies two blocks of the sealed table, drawn by its digest and that of the code that flies, or
        the first ones where there is no table of this code.
        """
        if self.trials:
            chunk = -(-self.trials // self.chunks) if self.chunks else CHUNK
            return [[[first, min(chunk, self.trials - first)]] for first in range(0, self.trials, chunk)]
        if self.size != FULL:
            return [[[0, 20]]]
        for path in self._sealed(name):
            sealed = json.loads((self.root / path).read_text(encoding="utf-8"))
            if sealed["world"] == world:
                blocks = _by_chance(range(sealed["trials"] // BLOCK), f"{self._file_digest(path)} {script}", 2)
                return [[[BLOCK * block, BLOCK] for block in blocks]]
        return [[[0, 2 * BLOCK]]]

    def _fought(self, name: str) -> PlannedJob:
        """All figures and tables of a scenario."""
        arena = self.arenas[name]
        chunks = self.job(f"report/arena/{name}.flights").params["chunks"]
        needs = [f"report/arena/{name}.{chunk}of{len(chunks)}.h5" for chunk in range(len(chunks))]
        needs.append(f"report/arena/{name}.tuned.json")
        files = [f"configs/scenarios/{name}.yaml", *self._sealed(name)]
        job = f"figures/arena/{name}", needs, "arena_shown.py", *arena.shows
        world = self.job(f"report/arena/{name}.flights").params["world"]
        inputs = {CORRECTED: self.shared[arena.paper].values[CORRECTED]}
        return self._scripted(*job, size=self.size, world=world, inputs=inputs, files=self._files(files))

    def _judging(self, paper: str, readings: Iterable[str]) -> dict[str, object]:
        """What claims are judged from in some readings."""
        return {
            "inputs": {name: self.shared[paper].values[name] for name in readings},
            "artifacts": {name: self.claimed(paper, name) for name in readings},
            "published": self._file_digest(f"data/published/{paper}.yaml"),
            "measured": self._file_digest(BENCHMARKS) if self.papers[paper].measured else "",
        }

    def _claims_entries(self, paper: str) -> list[str]:
        """A paper's claims with what they share."""
        return self.sources.functions(f"marsedl.papers.{paper}.claims")

    def _claims(self, paper: str) -> PlannedJob:
        study = self.studies[paper]
        judged = {
            "known_errata": [erratum.id for erratum in self.papers[paper].errata],
            # Verdicts count for the full size with the inputs that the committed verdicts were found with.
            "require_reasons": self.size == FULL and self._committed.get(paper) == counted_inputs(study),
            "left_out": sorted(study.readings.keys() - {*study.built, *study.points}),
            "size": self.size,
        }
        needs = [*self.cache(paper), f"report/points/{paper}.json"]
        job = f"report/claims/{paper}", needs, "claims.py", *self._claims_entries(paper)
        beside = self.papers[paper].beside
        return self._scripted(*job, judged=judged, beside=beside, **self._judging(paper, study.built))

    def _world_of(self, paper: str) -> dict[str, object]:
        """What is the same for all universes and named readings of a paper: all stages, and what measures its claims.

        Of what is printed and of choices, that is what functions are given, and no words.
        """
        stages = tuple(entry for stage in self.papers[paper].stages.values() for entry in stage.entries)
        constraint = self.sources.functions(f"marsedl.papers.{paper}.admissible")
        study, document = self.studies[paper], read_yaml(self.root / f"data/published/{paper}.yaml")
        # A job refuses what is malformed.
        published = [one for one in document.get("claims", ()) if isinstance(one, dict)]
        return {
            "inputs": {CORRECTED: self.shared[paper].values[CORRECTED]},
            "choices": {one.name: one.sets() for one in study.choices},
            "limits": [limits for limits, _ in study.limits],
            "redrawn": [*study.universes.redrawn, study.universes.tries],
            "size": self.size,
            "own": study.own_choices,
            "published": recipe_digest(
                {one.get("id", ""): {key: one.get(key) for key in MEASURED_FROM} for one in published}
            ),
            "measured": self._file_digest(BENCHMARKS) if self.papers[paper].measured else "",
            **self._reached(*stages, *constraint, measuring=tuple(self._claims_entries(paper))),
        }

    def _points(self, paper: str) -> PlannedJob:
        """What the named readings of a paper give, which are evaluated in memory."""
        inputs = {name: self.shared[paper].values[name] for name in (CORRECTED, *self.studies[paper].points)}
        params = {"inputs": inputs, "points": [*inputs][1:], "script": self.sources.code("points.py")}
        return PlannedJob(f"report/points/{paper}", self._world(paper) | params, [])

    def _universes(self, paper: str, whole: str = "") -> PlannedJob:
        """A paper's universes: what they are computed from, whichever they are (`world`), and which ones.

        They are a sample of the committed run, if that is of the same world, else a few; `whole` are all that a new run
        begins with.
        """
        given, study = self._world(paper), self.studies[paper]
        world, script = recipe_digest(given), self.sources.code("universes.py")
        designs, sample = list(study.designs), []
        if whole:
            designs = [study.whole, None, None]
        elif sample := self._sample(paper, world, script):
            designs = []
        files = self._files(self._committed_run(paper)) if sample else {}
        which = {"designs": designs, "sample": sample, "files": files}
        return PlannedJob(f"report/universes/{whole}{paper}", given | which | {"world": world, "script": script}, [])

    def _sample(self, paper: str, world: str, script: str) -> list[int]:
        """The numbers of universes of the committed run that a build computes again; none if it is of another world.

        They are drawn by digests of the run and of the code that computes universes: another version sees other ones,
        and what is said of claims costs none.
        """
        from marsedl.replication.records.store import PROVENANCE, opened

        for run in self._committed_run(paper):
            with opened(self.root / run) as file:
                if file[PROVENANCE].attrs.get("world") != world:
                    continue
                numbers = [int(number) for number in file["number"][()]]
            return _by_chance(numbers, f"{self._file_digest(run)} {script}", self.studies[paper].universes.sample)
        return []

    def _what_decides(self, paper: str) -> PlannedJob:
        """What is said of a paper's claims by its table of universes, or by the committed one, and by its readings."""
        study = self.studies[paper]
        return self._scripted(
            f"report/universes/{paper}_what_decides",
            [f"report/universes/{paper}.h5", f"report/claims/{paper}.json"],
            *("what_decides.py", *self._claims_entries(paper)),
            size=self.size,
            own=study.own_choices,
            choices={one.name: asdict(one) for one in study.choices},
            errata=[erratum.id for erratum in self.papers[paper].errata],
            published=self._file_digest(f"data/published/{paper}.yaml"),
            files=self._files(self._committed_run(paper)),
        )

    def _site(self) -> PlannedJob:
        of_papers = [need for paper in self.papers for need in self.shown(paper) + self.cache(paper)]
        # Claims are not judged again where named readings alone are lost, so these are asked for themselves.
        of_papers += [f"report/{kind}/{paper}.json" for kind in ("universes", "points") for paper in self.papers]
        together = [*self.compared(), *self.fought()]
        packages = [*(f"papers/{slug}" for slug in self.papers), "comparison", *["scenarios"] * bool(self.arenas)]
        templates = sorted(f"{_TEMPLATES}/{path.name}" for path in (self.root / _TEMPLATES).glob("*.*"))
        files = ["CITATION.cff", *(f"src/marsedl/{package}/{TEXTS}" for package in packages), *templates]
        return self._scripted(
            *("report/index", [*of_papers, *together, "report/claims.json"], "report.py"),
            size=self.size,
            readings={paper: self._described(paper) for paper in self.papers},
            files=self._files(files),
            catalogues={paper: self.sources.code(f"marsedl.papers.{paper}:PAPER") for paper in self.papers},
        )

    def _described(self, paper: str) -> dict[str, dict]:
        """A paper's readings for the report: what they are for, every input as it is written, its source."""
        return {
            name: {
                "summary": reading.summary,
                "based_on": reading.based_on,
                "frozen": bool(reading.frozen),
                "inputs": {key: [source.key, source.written, source.source] for key, source in reading.sources.items()},
            }
            for name, reading in self.studies[paper].readings.items()
        }

    # --- recipes

    def digest(self, path: str) -> str:
        """Return the digest of a product's recipe, see `replication/records/recipes.py`."""
        name, params, needs = self.job(path)
        key = name or path
        if key not in self._digests:
            recipe = params if not name else {**params, "needs": {need: self.digest(need) for need in needs}}
            self._digests[key] = recipe_digest(recipe)
        return self._digests[key]

    def record(self, path: str) -> tuple[str, list[str]]:
        """Return the file in which a product's job records what it was made from, and the digests for it.

        Behind that of the product's recipe stands the one that it has without a user's own readings: what it says of
        the others does not change with them.
        """
        digests, own = [self.digest(path)], {name for study in self.studies.values() for name in study.own_readings}
        if own and own.isdisjoint(path.split("/")):
            digests.append(self._of_the_project.digest(path))
        return f"{RECORDS}{self.job(path).name}.txt", digests

    @cached_property
    def _of_the_project(self) -> "Products":
        """The products without a user's own readings."""
        studies = {slug: study.without_own_readings() for slug, study in self.studies.items()}
        given = self.comparisons, self.size, self.arenas, self.trials, self.chunks
        return Products(self.root, self.papers, studies, *given)

    def behind(self, targets: Iterable[str], seen: set[str] | None = None) -> Iterator[str]:
        """Yield products with all that they are made from, nothing before what it needs."""
        seen = set() if seen is None else seen
        for path in targets:
            if path not in seen:
                seen.add(path)
                yield from self.behind(self.job(path).needs, seen)
                yield path
