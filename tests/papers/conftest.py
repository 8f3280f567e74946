"""The papers' stages as the tests use them: called directly, computed once, never through files."""

import inspect
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.methods.sos.design import well_chosen_design
from marsedl.papers import catalogue, input_model
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.claims.writing import claims_of, turned
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.inputs.sections import by_section
from marsedl.replication.pipeline.catalogue import Flown
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.runner import computed
from marsedl.replication.universes.table import EVALUATED

ROOT = Path(__file__).parents[2]
TRIALS = 2000
LARGE_TRIALS = 20_000  # sampling errors three times smaller
DRAWN_TRIALS = 12

# Sizes that only cost time, by paper.
REDUCED = {
    # Algorithm 1 converges in under 100 iterations wherever it is asked to.
    "powered_descent": {
        "fixed_point_iterations": 2000,
        "drawn_trials": DRAWN_TRIALS,
    },
    "stochastic_entry": {
        "drawn_trials": DRAWN_TRIALS,
        "trials": TRIALS,
        "paper_trials": 1000,
        "altitude_limit_study": np.array([500.0, 2000.0, 3000.0]),
    },
    "random_field": {
        "drawn_trials": DRAWN_TRIALS,
        "trials": TRIALS,
        "paper_trials": 1000,
        "double_integrator_trials": TRIALS,
    },
    "desensitized": {
        "drawn_trials": DRAWN_TRIALS,
        "trials": TRIALS,
        "sweep_points": 9,
        "tuning_starts": 1,
        "gain_iterations": 60,
        "unregularized_iterations": 30,
    },
    "funnels": {
        "drawn_trials": DRAWN_TRIALS,
        "start_banks": np.radians([63.0]),
        "start_final_times": np.array([200.0]),  # leads to the best of the optima
        "check_points": 450,  # more than the 406 independent polynomials
        "ascent_starts": 200,
        "ascent_polished": 2,
        "ascent_iterations": 6,
        "tightness_starts": 60,
        "tightness_polished": 2,
        "tightness_iterations": 6,
        "fig4_points": 33,
        "dubins_trials": TRIALS,
        "dubins_wind_trials": TRIALS,
    },
}


# The law for all columns does not converge in this reading, with any number of iterations.
REDUCED_IN = {("desensitized", "printed"): {"all_columns_iterations": 10}}


class Inputs:
    """Inputs of a reading: by section, by name, and as the arguments of a function."""

    def __init__(self, model, values):
        self.model, self.values = model, values
        self._names = {name.partition(".")[2]: name for name in values}

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.model.sections():
            return self.model.sections()[name].from_plain(by_section(self.values).get(name, {}))
        if name not in self._names:
            raise AttributeError(f"no input '{name}' was given")
        value = self.values[self._names[name]]
        return np.array(value, float) if isinstance(value, list | tuple) else value

    def of(self, function):
        """The sections that a function takes, or all of them as `given`, by their names."""
        return Arguments(self.values).available(function)

    def changed(self, **changes):
        """These inputs with others in place of some, by their names without that of the section."""
        return Inputs(self.model, self.values | {self._names[name]: value for name, value in changes.items()})

    def call(self, function, *arguments, **named):
        """Call a function with the sections that it takes and, in order, with its other arguments."""
        sections = self.of(function)
        parameters = [name for name in inspect.signature(function).parameters if name not in {**sections, **named}]
        return function(**sections, **named, **dict(zip(parameters, arguments, strict=False)))

    def replay(self, montecarlo, *arguments, trial, **named):
        """What a paper says of a trial that is flown again."""
        chunk = self.call(montecarlo.simulate, *arguments, **named, flown=trial.flown)
        given = Arguments(self.values, lambda name, kind: None, named)
        return given.call(montecarlo.replay, chunk=chunk, trial=trial)


class Pipeline:
    """The stages of every reading, and of readings with changed inputs: `pipeline.gains("corrected", gravity=0.0)`.

    Every stage of the catalogue is such a method. Inputs are changed by their names without that of the section.
    """

    def __init__(self, slug):
        self.paper, self.model = catalogue(slug), input_model(slug)
        self.montecarlo = import_module(f"marsedl.papers.{slug}.montecarlo")
        self.study = load_study(slug, self.model, ROOT)
        self.done = {}

    def inputs(self, reading, names=None, **changes):
        """The inputs "section.name", all unless given, and no others; what is not among them is not changed."""
        plain = self.study.readings[reading].inputs.plain()
        sizes_and_changes = REDUCED[self.paper.slug] | REDUCED_IN.get((self.paper.slug, reading), {}) | changes
        return Inputs(
            self.model,
            {name: sizes_and_changes.get(name.partition(".")[2], plain[name]) for name in sorted(names or plain)},
        )

    def stage_inputs(self, reading, stage, **changes):
        """What a stage reads."""
        return self.inputs(reading, self.paper.stages[stage].inputs, **changes)

    def used(self, name):
        """Names, without those of sections, of the inputs that a stage and those before it read."""
        stage = self.paper.stages[name]
        names = {name.partition(".")[2] for name in stage.inputs}
        return names.union(*(self.used(need) for need in stage.needs))

    def needed(self, name, reading, **changes):
        """The artifacts that a stage needs."""
        return {need: self.stage(need, reading, **changes) for need in self.paper.stages[name].needs}

    def stage(self, name, reading, **changes):
        """The artifact of a stage with those that it needs, remembered."""
        changes = {key: value for key, value in changes.items() if key in self.used(name)}
        key = (name, reading, repr(sorted(changes.items())))
        if key not in self.done:
            (entry,) = self.paper.stages[name].entries
            module, function = entry.split(":")
            needed = self.needed(name, reading, **changes)
            inputs = self.stage_inputs(reading, name, **changes)
            self.done[key] = inputs.call(getattr(import_module(module), function), **needed)
        return self.done[key]

    def __getattr__(self, name):
        if name.startswith("_") or name not in self.paper.stages:
            raise AttributeError(f"{type(self).__name__} has neither an attribute nor a stage '{name}'")
        return lambda reading="corrected", **changes: self.stage(name, reading, **changes)

    def ensemble(self, reading="corrected", case=None, trials=TRIALS, chunks=1, **changes):
        """A Monte Carlo case, the paper's first unless given, flown in chunks and gathered, remembered."""
        case = case or next(iter(self.model.CASES))
        key = ("montecarlo", reading, case, trials, chunks, repr(sorted(changes.items())))
        if key not in self.done:
            self.done[key] = self.fly(reading, self.gains(reading, **changes), case, trials, chunks, **changes)
        return self.done[key]

    def fly(self, reading, gains, case=None, trials=TRIALS, chunks=1, block_size=1000, **changes):
        """A Monte Carlo case under any gains."""
        needs = self.paper.stages["montecarlo"].needs
        needed = {need: self.stage(need, reading, **changes) for need in needs if need != "gains"} | {"gains": gains}
        inputs, case = self.stage_inputs(reading, "montecarlo", **changes), case or next(iter(self.model.CASES))
        given, flown = Arguments(inputs.values, lambda name, kind: needed.get(name)), Flown(case, trials, block_size)
        parts = [flown._replace(chunk=chunk, chunks=chunks) for chunk in range(chunks)]
        flights = [given.call(self.montecarlo.simulate, flown=part) for part in parts]
        return given.call(self.montecarlo.gather, chunks=flights, flown=flown)

    def whole(self, inputs, artifacts, case, trials, block_size):
        """A Monte Carlo case in one go, as a job flies it, under any artifacts."""
        given = Arguments(inputs.values, lambda name, kind: artifacts.get(name))
        options = {"case": case, "trials": trials, "block_size": block_size}
        return computed(self.paper.stages["montecarlo"].entries, given, options)

    def simulator(self, case, reading="corrected", changes=None, **inputs):
        """The function `simulate_block` of a Monte Carlo case; changes: further arguments of `block_simulator`."""
        needed = self.needed("montecarlo", reading) | (changes or {})
        inputs = self.stage_inputs(reading, "montecarlo", **inputs)
        return inputs.call(self.montecarlo.block_simulator, **needed, case=case)

    def artifacts(self, reading, large=False):
        """Everything that claims, figures and tables of a reading are made from, at reduced size."""
        records = {}
        for name, stage in self.paper.stages.items():
            if not name.startswith("montecarlo") and reading in (stage.claimed_in or [reading]):
                records[name] = self.stage(name, reading)
        for case, size in self.model.CASES.items():
            paper_size = size.endswith(".trials")
            if paper_size or large:
                records[case] = self.ensemble(reading, case, TRIALS if paper_size else LARGE_TRIALS)
        return records

    def all_inputs(self, reading, **changes):
        """All inputs of a reading, as the evaluation of claims gets them."""
        return self.model.from_plain(self.inputs(reading, **changes).values)

    def evaluate(self, reading, artifacts, changes=None, **others):
        """What the claims are measured to be in a reading, from artifacts by name; changes: of inputs."""
        return claims_of(self.paper.slug).evaluate(
            Arguments(self.inputs(reading, **(changes or {})).values, lambda name, kind: artifacts.get(name)),
            published_of(self.paper.slug),
            **others,
        )

    def turned(self, artifacts, evaluated, targets=None, **further):
        """What turns every counted claim of `corrected`, None if nothing does; evaluated: its claims from artifacts.

        targets: what counterexamples change; unless given, all are tried.
        """
        published, claims = published_of(self.paper.slug), claims_of(self.paper.slug)
        rows = []
        for name, claim in published.items():
            change = claims.declarations[name].counterexample if name in claims.declarations else None
            tried = targets is None or (change and change.target.partition(".")[0] in targets)
            if claim.kind in EVALUATED and evaluated[name] is not None and tried:
                verdict = judge(claim, evaluated[name], claims.declarations[name]).verdict
                rows.append(SimpleNamespace(id=name, kind=claim.kind, verdict=verdict, readings={}))
        given = Arguments(self.inputs("corrected").values, lambda name, kind: artifacts.get(name))
        return turned(claims, rows, given, published, **further)

    def figure(self, stem, reading="corrected", artifacts=None, inputs=None, **others):
        """A figure of a reading from the artifacts that the catalogue declares; artifacts, inputs: others in place."""
        needs = {need.rpartition(".")[2]: need for need in self.paper.figures[stem].needs}
        records = {
            name: self.ensemble(reading, name) if need.startswith("montecarlo") else self.stage(name, reading)
            for name, need in needs.items()
            if name not in (artifacts or {})
        }
        return self.product("figures", stem, reading, records | (artifacts or {}), inputs, **others)

    def product(self, kind, stem, reading, artifacts, changes=None, **others):
        """What the function of a figure or table returns, from artifacts by name; kind: figures or tables."""
        function = getattr(import_module(f"marsedl.papers.{self.paper.slug}.{kind}"), stem)
        inputs = self.inputs(reading, self.paper.product(stem).inputs, **(changes or {})).values
        return Arguments(inputs, lambda name, kind: artifacts.get(name)).call(function, **others)


@pytest.fixture(scope="session")
def pipeline():
    """The powered-descent paper's stages."""
    return Pipeline("powered_descent")


@pytest.fixture(scope="session")
def entry():
    """The entry-guidance paper's stages."""
    return Pipeline("stochastic_entry")


@pytest.fixture(scope="session")
def random_field():
    """The random-field paper's stages."""
    return Pipeline("random_field")


@pytest.fixture(scope="session")
def desensitized():
    """The desensitized-landing paper's stages."""
    return Pipeline("desensitized")


@pytest.fixture(scope="session")
def funnels():
    """The funnels paper's stages; samples, which take a third of a second to choose, are chosen once."""
    with pytest.MonkeyPatch.context() as patch:
        chosen = cache(well_chosen_design)
        for name in ("funnel", "dubins", "beyond.programs", "beyond.proven", "beyond.dubins_study"):
            patch.setattr(f"marsedl.papers.funnels.{name}.well_chosen_design", chosen)
        yield Pipeline("funnels")


# Eleven slices, by the Euler step, which is quick, and no more of the searches than it takes to run.
FEW_SLICES = {
    "steps_per_slice": 24,
    "fig4_slice": 3,
    "fig4_points": 9,
    "condition": "euler",
    "ascent_starts": 20,
    "ascent_polished": 1,
    "ascent_iterations": 1,
    "tightness_starts": 4,
    "tightness_polished": 1,
    "tightness_iterations": 0,
}


@pytest.fixture(scope="session")
def few_slices():
    """What makes a funnel quick."""
    return FEW_SLICES


@pytest.fixture(scope="session")
def coarse_funnel(funnels):
    """The funnel of a reading on few slices, around the nominal of one of them, remembered."""

    @cache
    def of(reading):
        gains = funnels.gains(shape="minimum_trace" if reading == "minkowski_shape" else "value_matrix")
        inputs = funnels.stage_inputs(reading, "funnel", **FEW_SLICES)
        compute = import_module("marsedl.papers.funnels.funnel").compute
        return inputs.call(compute, linearization=funnels.linearization(), gains=gains)

    return of


@cache
def published_of(slug):
    return {claim.id: claim for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml")}


@pytest.fixture(scope="session")
def published():
    """The printed claims of the powered-descent paper, by id."""
    return published_of("powered_descent")


@pytest.fixture(scope="session")
def entry_published():
    """The printed claims of the entry-guidance paper, by id."""
    return published_of("stochastic_entry")


@pytest.fixture(scope="session")
def random_field_published():
    """The printed claims of the random-field paper, by id."""
    return published_of("random_field")


@pytest.fixture(scope="session")
def desensitized_published():
    """The printed claims of the desensitized-landing paper, by id."""
    return published_of("desensitized")


@pytest.fixture(scope="session")
def funnels_published():
    """The printed claims of the funnels paper, by id."""
    return published_of("funnels")


def node_of(artifact, time, after_switch=False):
    """Index of the node at a time; at the switch, where two stand, the first unless told otherwise."""
    nodes = np.flatnonzero(np.abs(artifact.time - time) < 1e-9)
    assert len(nodes) == (2 if time == 26.0 else 1)
    return nodes[-1] if after_switch else nodes[0]


@pytest.fixture(scope="session")
def node():
    return node_of
