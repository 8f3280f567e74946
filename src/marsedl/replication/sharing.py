"""Artifacts that readings share: what two readings would compute from the same is computed once, and one owns it.

The owner is the first reading in a fixed order: `corrected`, then as they stand in the files, a user's own last. When
an owner is edited, the next of the others owns a file of its own, which is computed again with the same result.
"""

import hashlib
import json

from marsedl.replication.catalogue import FLIGHTS, Paper
from marsedl.replication.inputs import Study

FIRST = "corrected"


class Shared:
    """Whose file each artifact of a paper's readings is."""

    def __init__(self, paper: Paper, study: Study):
        """Take the catalogue and the readings."""
        self.paper, self._study = paper, study
        self._order = sorted(study.readings, key=lambda name: name != FIRST)  # stable: otherwise as they stand
        self._values = {name: reading.inputs.plain() for name, reading in study.readings.items()}
        self._flown = {name: reading.flown() for name, reading in study.readings.items()}
        self._digests: dict[tuple[str, str], str] = {}
        self._owners: dict[tuple[str, str], str] = {}  # by name of the artifact and digest

    def owner(self, reading: str, name: str) -> str:
        """Return the reading whose file an artifact is; name: such as "gains" or "montecarlo.closed_loop"."""
        digest = self._digest(reading, name)
        if (name, digest) not in self._owners:
            same = (other for other in self._order if self._digest(other, name) == digest)
            self._owners[name, digest] = next(same)
        return self._owners[name, digest]

    def claimed(self, reading: str) -> dict[str, str]:
        """Return the paths of all artifacts that the claims of a reading use, by name."""
        stages = self.paper.stages.items()
        names = [
            *(n for n, stage in stages if not n.startswith(FLIGHTS) and reading in (stage.claimed_in or [reading])),
            *(f"{FLIGHTS}.{case}" for case in self._flown[reading]),
        ]
        return {name: self.file(reading, name) for name in names}

    def has(self, reading: str, name: str) -> bool:
        """Whether a reading has an artifact of this name."""
        stage, _, case = name.partition(".")
        if stage == FLIGHTS:
            return case in self._flown.get(reading, ())
        return reading in self._flown and not case and stage in self.paper.stages

    @property
    def readings(self) -> tuple[str, ...]:
        """The readings in which claims are evaluated."""
        return self._study.compared

    def file(self, reading: str, name: str) -> str:
        """Return the path of an artifact, from the folder of the build on."""
        return f"data/cache/{self.paper.slug}/{self.owner(reading, name)}/{name}.h5"

    def _digest(self, reading: str, name: str) -> str:
        """Digest of all that an artifact is computed from; the code is the same for all readings."""
        if (reading, name) not in self._digests:
            stage, _, case = name.partition(".")
            declared = self.paper.stages[stage]
            values = self._values[reading]
            made_from = {
                "inputs": {key: values[key] for key in declared.inputs},
                "trials": self._flown[reading].get(case, 0) if stage == FLIGHTS else None,
                "needs": {need: self._digest(reading, need) for need in declared.needs},
            }
            digest = hashlib.sha256(json.dumps(made_from, sort_keys=True).encode()).hexdigest()
            self._digests[reading, name] = digest
        return self._digests[reading, name]
