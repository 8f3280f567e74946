"""What the Monte Carlo stages of all papers do: fly a chunk of trials, join the chunks, describe a single trial.

A paper gives its `simulate_block(first, last)`, see `marsedl.montecarlo.ensembles`. Where all trials fly under each of
several laws it gives one for each, and the fields of its ensembles lie along the laws first.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.ensembles import Chunk
from marsedl.replication.pipeline.catalogue import Flown, Trial
from marsedl.replication.records.fields import Axis, quantities


def flown_chunk(simulate_block, flown: Flown, *, drawn: int, exits=None, **options) -> Chunk:
    """Fly the trials of a job. Returns them reduced, without infinities.

    simulate_block: the paper's, or one for each law. drawn: first trials that keep their histories. exits: the
    `TableExits` of an air whose density may come from a table, which then says how many flights leave it. options:
    further ones of `ensembles.run_blocks`.
    """
    simulators = [simulate_block] if callable(simulate_block) else simulate_block
    first, last = flown.trials - 1, flown.trials
    options |= {"block_size": flown.block_size, "kept": flown.trials if flown.alone else min(drawn, flown.trials)}
    if not flown.alone:
        first, last = ensembles.chunk_bounds(flown.trials, flown.chunks, flown.block_size)[flown.chunk]
    watched = [exits.watching(simulate) for simulate in simulators] if exits else simulators
    reduced = _by_law([ensembles.run_blocks(simulate, first, last, **options) for simulate in watched])
    if exits:
        exits.say(f"flights {first:,} to {last - 1:,}" + ("" if callable(simulate_block) else ", under all laws"))
    laws, *shape = reduced["maximum_over_trials"].shape
    return Chunk(**reduced, maximum_of_parts=np.empty((laws, 0, *shape)))


def joined(kind: type, chunks: Sequence[Chunk]) -> dict[str, object]:
    """Join a case's chunks in the order of their trials.

    Returns the fields of an ensemble of this kind that it inherits; they lie along the laws first if its outcomes do.
    """
    of_laws = []
    for law in range(len(chunks[0].first_trial)):
        reduced = [{name: getattr(chunk, name)[law] for name in quantities(Chunk)} for chunk in chunks]
        of_laws.append(ensembles.merge(reduced))
    outcome, *_ = quantities(kind)["outcome"].dims
    merged = _by_law(of_laws) if outcome != "trials" else _finite(of_laws[0])
    return {name: merged[name] for name in kind.inherited.keys() & quantities(kind).keys()}


def _by_law(reduced):
    """The fields of reductions, stacked by law."""
    parts = [_finite(part) for part in reduced]
    return {name: np.array([part[name] for part in parts]) for name in parts[0]}


def _finite(part):
    """The fields of a reduction with NaN in place of infinities, which only non-finite trials have."""
    return {name: ensembles.without_infinities(value) for name, value in part.items()}


def described(
    kind: type,
    chunk: Chunk,
    trial: Trial,
    outcomes: Mapping[int, str],
    *,
    laws: Sequence[str] = (),
    names: Sequence[str] = (),
    further=(),
) -> str:
    """Describe a trial that was flown again: how it ended, its state at both ends, its largest observed values.

    kind: of the ensembles. chunk: that trial alone. outcomes: words for the codes. laws: their names, if the trial
    flew under several. names:
    of the final state's components where its axis has none. further: names and values for each law. With a stored
    ensemble the last line says whether the final state is the same to the last bit.
    """
    state, final, observed = (
        quantities(kind)[name].dims[-1] for name in ("kept_history", "final_state", "observed_maximum")
    )
    lines = []
    for number, law in enumerate(laws or [f"of {trial.case}"]):
        end = chunk.final_state[number, 0]
        start = dict(zip(_components(state), chunk.kept_history[number, 0, 0], strict=False))
        of_trial = f"trial {trial.number}, {law}" if laws else f"trial {trial.number} {law}"
        lines.append(f"{of_trial}: {outcomes[int(chunk.outcome[number, 0])]}")
        for name, value in zip(_components(final) or names, end, strict=True):
            lines.append(
                f"  {name:36}" + (f"{start[name]:18.12g} -> " if name in start else " " * 22) + f"{value:18.12g}"
            )
        for name, value in zip(_components(observed), chunk.observed_maximum[number, 0], strict=False):
            lines.append(f"  {f'largest {name}':58}{value:18.12g}")
        rows = further[number] if further else {}
        lines += [f"  {name:58}{value:18.12g}" for name, value in rows.items()]
        if trial.stored is not None:
            at = (number, trial.number) if laws else trial.number
            same = np.array_equal(end, trial.stored.final_state[at], equal_nan=True)
            verdict = "the same to the last bit as in" if same else "DIFFERS from"
            lines.append(f"  {verdict} the stored ensemble")
    return "\n".join(lines)


def _components(axis: str | Axis) -> list[str]:
    """Names and units of an axis in words; none of a dimension without them."""
    units = axis.units.items() if isinstance(axis, Axis) else ()
    return [f"{axis.label(name)} ({unit})" if unit != "1" else axis.label(name) for name, unit in units]
