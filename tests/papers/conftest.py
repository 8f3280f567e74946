"""The powered-descent paper's stages as the tests use them: called directly, computed once, never through files."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers.powered_descent import PAPER, montecarlo
from marsedl.papers.powered_descent.inputs import MODEL
from marsedl.replication.claims import load_published
from marsedl.replication.inputs import load_study
from marsedl.replication.jobs import Slice

ROOT = Path(__file__).parents[2]
PAPER_TRIALS = 2000
LARGE_TRIALS = 20_000  # sampling errors three times smaller than the paper's
DRAWN_TRIALS = 12

# Sizes that only cost time: Algorithm 1 converges in under 100 iterations wherever it is asked to.
REDUCED = {"fixed_point_iterations": 2000, "drawn_trials": DRAWN_TRIALS}


class Pipeline:
    """The stages of every reading, and of readings with changed inputs: `pipeline.gains("corrected", gravity=0.0)`."""

    def __init__(self):
        self.study = load_study(PAPER.slug, MODEL, ROOT / "configs" / f"{PAPER.slug}.yaml")
        self.done = {}

    def inputs(self, reading, names, **changes):
        """The inputs of these names, and no others; names that the stage does not use are not changed in it."""
        values = self.study.readings[reading].slice(names)
        return Slice(values | {name: value for name, value in (REDUCED | changes).items() if name in values})

    def stage_inputs(self, reading, stage, **changes):
        """What the catalogue lets a stage use."""
        return self.inputs(reading, PAPER.stages[stage].inputs, **changes)

    def stage(self, name, reading, **changes):
        """The artifact of a stage with those that it needs, remembered."""
        key = (name, reading, repr(sorted(changes.items())))
        if key not in self.done:
            module, function = PAPER.entry(name).split(":")
            needed = {need: self.stage(need, reading, **changes) for need in PAPER.stages[name].needs}
            compute = getattr(import_module(module), function)
            self.done[key] = compute(self.stage_inputs(reading, name, **changes), **needed)
        return self.done[key]

    def nominal(self, reading="corrected", **changes):
        return self.stage("nominal", reading, **changes)

    def linearization(self, reading="corrected", **changes):
        return self.stage("linearization", reading, **changes)

    def gains(self, reading="corrected", **changes):
        return self.stage("gains", reading, **changes)

    def certificates(self, reading="corrected", **changes):
        return self.stage("certificates", reading, **changes)

    def fixed_point(self, reading="corrected", **changes):
        return self.stage("fixed_point", reading, **changes)

    def integrator_error(self, reading="corrected", **changes):
        return self.stage("integrator_error", reading, **changes)

    def ensemble(self, reading="corrected", case="closed_loop", trials=PAPER_TRIALS, chunks=1, **changes):
        """A Monte Carlo case, flown in chunks and gathered, remembered."""
        key = ("montecarlo", reading, case, trials, chunks, repr(sorted(changes.items())))
        if key not in self.done:
            self.done[key] = self.fly(reading, self.gains(reading, **changes), case, trials, chunks, **changes)
        return self.done[key]

    def fly(self, reading, gains, case="closed_loop", trials=PAPER_TRIALS, chunks=1, block_size=1000, **changes):
        """A Monte Carlo case under any gains."""
        flown = [
            montecarlo.simulate(
                self.stage_inputs(reading, "montecarlo_chunk", **changes),
                gains,
                case=case,
                trials=trials,
                chunk=chunk,
                chunks=chunks,
                block_size=block_size,
            )
            for chunk in range(chunks)
        ]
        return montecarlo.gather(self.stage_inputs(reading, "montecarlo_gather", **changes), flown)

    def artifacts(self, reading, large=False):
        """Everything that claims, figures and tables of a reading are made from, at reduced size."""
        names = [name for name in PAPER.stages if not name.startswith("montecarlo")]
        made = {name: self.stage(name, reading) for name in names}
        for case in ("closed_loop", "open_loop"):
            made[case] = self.ensemble(reading, case)
            if large:
                made[f"{case}_large"] = self.ensemble(reading, f"{case}_large", LARGE_TRIALS)
        return made

    def all_inputs(self, reading):
        """All inputs of a reading, as the evaluation of claims gets them."""
        return self.inputs(reading, MODEL.model_fields)


@pytest.fixture(scope="session")
def pipeline():
    return Pipeline()


@pytest.fixture(scope="session")
def published():
    """The printed claims of the paper, by id."""
    return {claim.id: claim for claim in load_published(ROOT / "data" / "published" / f"{PAPER.slug}.yaml")}


def node_of(artifact, time, after_switch=False):
    """Index of the node at a time; at the switch, where two stand, the first unless told otherwise."""
    nodes = np.flatnonzero(np.abs(artifact.time - time) < 1e-9)
    assert len(nodes) == (2 if time == 26.0 else 1)
    return nodes[-1] if after_switch else nodes[0]


@pytest.fixture(scope="session")
def node():
    return node_of
