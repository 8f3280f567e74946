"""Records of flown trials, and the description of a trial, along the axes of any model."""

import numpy as np
import pytest

from marsedl.montecarlo.ensembles import Trajectories
from marsedl.papers.ensembles import Chunk, Ensemble, along
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.replication.errors import ArtifactError
from marsedl.replication.pipeline.catalogue import Flown, Trial
from marsedl.replication.records import store
from marsedl.replication.records.fields import Axis, quantities, record

STATE, OBSERVED = Axis("state", altitude="m", velocity="m/s"), Axis("observed", drag="m/s^2")


def block(first, last):
    """A fall from rest, from heights that are the trials' numbers; only even trials are finite at the end."""
    height, time = np.arange(first, last), np.arange(3.0)[:, np.newaxis]
    history = np.stack([height - 2.0 * time**2, -4.0 * time + 0.0 * height], axis=1)
    final = np.where(height % 2, np.inf, history[-1])
    ones = np.ones(last - first)
    return Trajectories(
        history, history[:, 1:] * 0.5, ones[np.newaxis], final, 0 * height.astype(np.int8), 3 + 0 * height
    )


@record
class Landings(Ensemble):
    """Two laws."""

    inherited = along(state=STATE, observed=OBSERVED, per=("laws",), outcome="0 landed, 3 not finite")


def test_records_lie_along_the_axes_of_the_paper(tmp_path):
    chunks = [flown_chunk([block, block], Flown("fall", 6, 2, number, 3), drawn=3) for number in range(3)]
    store.save(tmp_path / "a.h5", chunks[1], paper="p", reading="r", provenance={})
    chunks[1] = store.load(tmp_path / "a.h5", Chunk)
    assert chunks[1].first_trial.tolist() == [2, 2] and chunks[1].kept_history.shape == (2, 1, 3, 2)
    landings = Landings(**joined(Landings, chunks))
    store.save(tmp_path / "b.h5", landings, paper="p", reading="r", provenance={})
    assert store.load(tmp_path / "b.h5", Landings).final_state.shape == (2, 6, 2)
    assert quantities(Landings)["mean"].dims == ("laws", "time", STATE)
    assert quantities(Landings)["histogram_edges"].unit == "m/s^2"
    assert quantities(Landings)["outcome"].meaning == "0 landed, 3 not finite"


def test_a_meaning_of_no_field_is_refused():
    with pytest.raises(ArtifactError, match=r"no field .outcomes. to give a meaning: .*outcome"):
        along(state=STATE, observed=OBSERVED, outcomes="0 landed")


@pytest.mark.parametrize(("number", "ended"), [(4, "landed"), (5, "not finite")])
def test_a_trial_alone_is_described_with_both_ends_and_compared(number, ended):
    whole = joined(Landings, [flown_chunk([block, block], Flown("fall", 6, 2, n, 3), drawn=3) for n in (1, 0, 2)])
    trial = Trial("fall", number, type("Stored", (), whole))
    alone = flown_chunk([block, block], trial.flown, drawn=3)
    text = described(Landings, alone, trial, {0: "landed", 3: "not finite"}, laws=["first", "second"])
    assert text.count(f"trial {number}, first: {ended}") == 1 and text.count("the same to the last bit") == 2
    start, end = text.splitlines()[1].replace("altitude (m)", "").split("->")
    assert float(start) == number and (float(end) == number - 8.0 or number == 5)
    other = type("Stored", (), whole | {"final_state": whole["final_state"] + 1.0})
    assert ("DIFFERS" in described(Landings, alone, trial._replace(stored=other), {0: "", 3: ""}, laws=["1", "2"])) == (
        number == 4
    )
