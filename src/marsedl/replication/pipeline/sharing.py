"""What the artifacts of a paper's readings are made from, and which reading owns each file.

An artifact that two readings would compute from the same inputs is computed once. The file is stored under one of them:
`corrected` if it has it, else the first in the configuration; a user's own readings come last. When its owner is
edited, the next of the others owns a file of its own, which is computed again with the same result.
"""

from collections.abc import Callable, Iterable
from functools import cache
from typing import TYPE_CHECKING

from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import FLIGHTS, Paper, whole_case
from marsedl.replication.records.recipes import recipe_digest

if TYPE_CHECKING:  # jobs, which import this module, read no readings
    from marsedl.replication.inputs.readings import Study

ARTIFACTS = "data/cache/"
TOGETHER = 10  # one job flies all cases of a reading that have at most this many blocks of trials


def artifact_path(paper: str, reading: str, name: str) -> str:
    """Return the path of an artifact, from the folder of the build on."""
    return f"{ARTIFACTS}{paper}/{reading}/{name}.h5"


def artifact_of(path: str) -> tuple[str, str, str]:
    """Return paper, reading and name of the artifact at a path."""
    paper, reading, name = path.rpartition(ARTIFACTS)[2].removesuffix(".h5").split("/", 2)
    return paper, reading, name


class Shared:
    """The artifacts of all readings of a paper.

    An artifact has the name of its stage, of a Monte Carlo case ("montecarlo.closed_loop"), or of a chunk of one
    ("chunks/closed_loop.0of4").
    """

    def __init__(self, paper: Paper, study: "Study", reached: Callable[..., dict] = lambda *entries: {}):
        """Take the catalogue, the readings, and what gives a recipe's part of a script's and functions' code."""
        self.paper, self.study, self._reached = paper, study, reached
        self.values = {name: reading.inputs.plain() for name, reading in study.readings.items()}
        self._flown = {name: reading.trial_counts() for name, reading in study.readings.items()}
        self.recipe, self.owner = cache(self._recipe), cache(self._owner)
        self._digest = cache(lambda reading, name: recipe_digest(self.recipe(reading, name)))

    def inputs(self, reading: str, names: Iterable[str]) -> dict[str, object]:
        """Return plain inputs of a reading by "section.name", in the order of their names."""
        return {name: self.values[reading][name] for name in sorted(names)}

    def has(self, reading: str, name: str) -> bool:
        """Whether a reading has an artifact of this name."""
        stage, _, case = name.partition(".")
        if stage == FLIGHTS:
            return case in self._flown.get(reading, ())
        return reading in self._flown and not case and stage in self.paper.stages

    def _owner(self, reading: str, name: str) -> str:
        """The reading whose file an artifact is."""
        order = sorted(self._flown, key=lambda other: other != CORRECTED)  # stable: otherwise as they stand
        digest = self._digest(reading, name)
        return next(other for other in order if self.has(other, name) and self._digest(other, name) == digest)

    def file(self, reading: str, name: str) -> str:
        """Return the path of an artifact, from the folder of the build on."""
        return artifact_path(self.paper.slug, self.owner(reading, name), name)

    def files(self, reading: str, needs: Iterable[str], optional: Iterable[str] = ()) -> dict[str, str]:
        """Return the paths of artifacts by the parameter that takes them; of the optional ones, those that exist."""
        needs = [*needs, *(need for need in optional if self.has(reading, need))]
        return {need.split(".")[-1]: self.file(reading, need) for need in needs}

    def claimed(self, reading: str) -> dict[str, str]:
        """Return the paths of all artifacts that the claims of a reading use, by name; a user's reading uses all."""
        own = reading in self.study.own_readings
        stages = {name: stage for name, stage in self.paper.stages.items() if name != FLIGHTS}
        names = [name for name, stage in stages.items() if own or reading in (stage.claimed_in or [reading])]
        names += [f"{FLIGHTS}.{case}" for case in self._flown[reading]]
        return {name: self.file(reading, name) for name in names}

    def chunks(self, reading: str, case: str) -> list[str]:
        """Return the names of a case's chunks: no more than it has blocks of trials, if any."""
        blocks = -(-self._flown[reading].get(case, 0) // self.paper.trials_per_block)
        number = min(self.study.chunks[case], blocks)
        return [f"chunks/{case}.{chunk}of{number}" for chunk in range(number)]

    def flown_together(self) -> dict[tuple[str, ...], list[str]]:
        """Return the readings by the cases that one job flies for each: those of few trials, if there are several."""
        groups: dict[tuple[str, ...], list[str]] = {}
        for reading, cases in self._flown.items():
            few = [case for case, trials in cases.items() if trials <= TOGETHER * self.paper.trials_per_block]
            whole = [case for case in few if len(self.chunks(reading, case)) == 1]
            owned = tuple(case for case in whole if self.owner(reading, f"{FLIGHTS}.{case}") == reading)
            if len(owned) > 1:
                groups.setdefault(owned, []).append(reading)
        return groups

    def needs(self, reading: str, name: str) -> list[str]:
        """Return the paths of the artifacts that an artifact is made from."""
        stage, _ = self._job(reading, name)
        return [self.file(reading, need) for need in self.paper.stages[stage].needs]

    def _recipe(self, reading: str, name: str) -> dict:
        """What an artifact is made from, see `replication/records/recipes.py`."""
        stage, options = self._job(reading, name)
        declared = self.paper.stages[stage]
        return {
            "inputs": self.inputs(reading, declared.inputs),
            "options": options,
            "needs": {f"{need}.h5": self._digest(reading, need) for need in declared.needs},
            **self._reached("stage.py", *declared.entries),
        }

    def _job(self, reading: str, name: str) -> tuple[str, dict]:
        """The stage that an artifact comes from, and its options: of a whole case the same in however many chunks."""
        stage, _, part = name.removeprefix("chunks/").partition(".")
        if name.startswith("chunks/"):  # the case, and which chunk of how many
            chunk, _, count = part.partition("of")
            options = whole_case(stage, self._flown[reading][stage], self.paper)
            return FLIGHTS, options | {"chunk": int(chunk), "chunks": int(count)}
        return stage, whole_case(part, self._flown[reading][part], self.paper) if part else {}
