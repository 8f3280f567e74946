"""What a paper has, and what its figures, tables, stages and claims depend on, as text for a terminal.

A `project` is that of `marsedl.cli`, a `paper` its catalogue with the numbers that its texts quote.
"""

import json
from collections.abc import Iterator
from importlib import import_module
from math import isfinite
from pathlib import Path

from marsedl.replication.claims.committed import with_committed
from marsedl.replication.claims.counts import counted
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import FLIGHTS, TEXTS, Paper, entry_of
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.terminal import columns

KINDS = ("readings", "figures", "tables", "stages", "cases", "claims")  # of what a paper has
MADE_BY = {  # what Snakemake is asked for to make an item of a kind
    "figures": "figures/{paper}/NAME.png, or figures/{paper}/READING/NAME.png",
    "tables": "figures/{paper}/NAME.csv, or .md; READING as for figures",
    "stages": "data/cache/{paper}/READING/NAME.h5",
    "cases": "data/cache/{paper}/READING/montecarlo.NAME.h5",
    "claims": "claims",
}


def heading(paper) -> str:
    """Return the name, title and authors of a paper."""
    return f"{paper.slug}\n  {paper.title}\n  {paper.authors}"


def there(root: Path, slug: str) -> str:
    """Return how many of each kind a paper has by its files, whose content is not checked, as that takes longest."""
    from marsedl.replication.inputs.yaml_file import read_yaml
    from marsedl.replication.pipeline.declarations import stage_entries

    package, stages = import_module(f"marsedl.papers.{slug}"), stage_entries(slug, fingerprints_of())
    config, printed = read_yaml(root / f"configs/{slug}.yaml"), read_yaml(root / f"data/published/{slug}.yaml")
    texts = read_yaml(Path(package.__file__).with_name(TEXTS))
    items = {
        "readings": config["readings"],
        "figures": texts["figures"] or (),
        "tables": [*(texts.get("tables") or ()), "claims"],
        "stages": stages,
        "cases": config["chunks"],
    }
    claims = with_committed(root, slug, [(claim["id"], claim["kind"], None) for claim in printed["claims"]])
    return f"{heading(package.PAPER)}\n  {counts(items, claims)}\n"


def counts(items, claims) -> str:
    """Return how many items of each kind there are, such as "7 figures, 1 table", and how many claims."""
    numbers = {kind: len(of_kind) for kind, of_kind in items.items() if kind != "claims"}
    others = ", ".join(f"{number} {kind if number != 1 else kind[:-1]}" for kind, number in numbers.items())
    return f"{others}\n  {counted(claims).in_words}"


def _items(project, paper) -> dict[str, list[tuple[str, ...]]]:
    """What a paper has of each kind: a row for each item, its name first."""
    from marsedl.replication.report.likeness import with_likeness
    from marsedl.replication.report.one_line import first_sentence

    readings, claims = project.studies[paper.slug].readings, project.published(paper.slug)
    rows = project.verdicts(paper.slug)
    verdicts = {name: claim.verdict for name, claim in rows.items()}
    paper = with_likeness(paper, rows, project.folder / "figures" / paper.slug)
    inputs = readings[CORRECTED].inputs

    return {
        "readings": [(n, r.summary + (f" (based on {r.based_on})" if r.based_on else "")) for n, r in readings.items()],
        "figures": [
            (stem, one.likeness if rows else "–", first_sentence(one.caption), one.why if rows else "")
            for stem, one in paper.figures.items()
        ],
        "tables": [(stem, first_sentence(table.caption)) for stem, table in paper.tables.items()]
        + [("claims", "Every printed claim with its verdict (all readings)")],
        "stages": [(name, stage.meaning) for name, stage in paper.stages.items()],
        "cases": [
            (case, f"{inputs.get(name):,} trials", f"input {name}: {inputs.meaning(name)}")
            for case, name in inputs.CASES.items()
        ],
        "claims": [(one.id, verdicts.get(one.id) or "–", one.plain or one.quantity) for one in claims],
    }


def listed(project, paper, kinds) -> Iterator[str]:
    """Yield what a paper has of some kinds, or of all, with the commands that make it."""
    rows = _items(project, paper)
    yield paper.slug if kinds else heading(paper)
    add = f"; add{project.options}" if project.options else ""
    for kind in kinds or KINDS:
        command = f" (snakemake {MADE_BY[kind].format(paper=paper.slug)}{add})" if kind in MADE_BY else ""
        yield f"\n  {kind}{command}"
        if rows[kind]:
            yield columns(rows[kind], 4, wrap=False)
    yield ""


def explained_paper(project, paper, reading) -> Iterator[str]:
    """Yield the readings of a paper, the inputs in which they differ from one, what there is, and the verdicts."""
    from marsedl.replication.claims.quotes import with_numbers
    from marsedl.replication.report.front_page import committed_claims

    items, verdicts = _items(project, paper), project.verdicts(paper.slug)
    claims = verdicts.values() or committed_claims(project.root, paper.slug)
    yield f"{paper.slug}: {paper.title}\n  {paper.authors}\n  snakemake {paper.slug}{project.options}"
    yield f"\nreadings\n{columns(items['readings'], 2)}"
    yield f"\ninputs in which readings differ from {reading.name}, of {len(reading.inputs.names())}"
    yield columns(_differing(project.studies[paper.slug].readings, reading), 2)
    if choices := project.studies[paper.slug].choices:
        yield f"\nchoices: what is doubted about the paper (marsedl what-if {paper.slug} CHOICE=VALUE)"
        yield columns([(one.name, one.because, _values(one), one.asks) for one in choices], 2)
    yield f"\nwhat there is (marsedl list {paper.slug})\n  {counts(items, claims)}"
    yield "\nverdicts"
    if not verdicts:
        yield f"  none yet: run 'snakemake report/claims/{paper.slug}.json{project.options}'"
        return
    for how, numbers in counted(verdicts.values()).verdicts.items():
        each = [f"{number} {verdict.replace('_', ' ')}" for verdict, number in numbers.items() if number]
        yield f"  {how}: {', '.join(each) or 'none'}"
    clauses = {name: text for name, text in paper.found.items() if name in verdicts}
    found = with_numbers(Paper(paper.slug, "", "", "", found=clauses), project.quotes(paper.slug, CORRECTED)).found
    yield "\nheadline claims: what we find"
    yield columns([(name, verdicts[name].verdict, text) for name, text in found.items()], 2)


def _differing(readings, reading) -> list[tuple[str, str, str, str]]:
    """Inputs whose value differs between readings: name, value in this one, unit, values in the others."""
    rows, values = [], {name: other.inputs.plain() for name, other in readings.items()}
    for name, value in values[reading.name].items():
        others = [other for other in readings.values() if values[other.name][name] != value]
        if others:
            source = reading.sources[name]
            texts = "; ".join(f"{other.name} {other.sources[name].written}" for other in others)
            rows.append((f"{name.partition('.')[0]}.{source.key}", str(source.written), source.unit, texts))
    return rows


def _values(choice) -> str:
    """The values of a choice, that of `corrected` in brackets."""
    if choice.range:
        factor = "factor " if choice.range.is_factor else ""
        return f"{factor}{choice.range.low:g} to {choice.range.high:g} [{choice.corrected:g}]"
    return ", ".join(f"[{name}]" if name == choice.corrected else name for name in choice.alternatives)


def _plain(one) -> dict:
    """A number that moves, as JSON takes it: null where there is no number."""
    claim, label = one.name
    values = {"claim": claim, "component": claim + label, "unit": one.after.unit or one.before.unit}
    for place, row in (("before", one.before), ("after", one.after)):
        values |= {place: row.value, f"verdict_{place}": row.verdict, f"limit_{place}": row.limit}
    values |= {
        "error": one.error,
        "standard_errors": one.sigmas,
        "size": one.size,
        "same_test": one.same_test,
        "sentence": one.after.said,
    }
    return {name: None if isinstance(value, float) and not isfinite(value) else value for name, value in values.items()}


def asked(what_if, paper) -> Iterator[str]:
    """Yield what is set and how many flights follow, before they are flown, see `marsedl...universes.what_if`."""
    yield f"{paper}: {what_if.names[0]} with other values"
    yield columns([(name, f"{old} -> {new}") for name, (old, new) in what_if.set.items()], 2)
    flights = ", ".join(f"{case} {number:,}" for case, number in what_if.trials.items())
    yield f"  flights: {flights or 'none'}\n"


def _moving(rows, published) -> Iterator[str]:
    """Verdicts that change and numbers that move, in words."""
    from marsedl.replication.checks.compare import apart, in_numbers
    from marsedl.replication.inputs.choices import in_words

    printed = {one.id: one for one in published}

    def lines(those):
        for one in those:
            claim, label = one.name
            verdicts = in_words(one.before.verdict) + (f" -> {in_words(one.after.verdict)}" if one.turned else "")
            first, second = in_numbers(one)
            numbers = (f"{first} -> {second}" if one.same_test else f"{first}; {second}") if first != second else ""
            words = printed[claim].plain or printed[claim].quantity
            yield verdicts, one.after.said or numbers, apart(one), f"{words} ({claim}{label})"

    turned, rest = [row for row in rows if row.turned], [row for row in rows if not row.turned]
    shown = [row for row in rest if row.counts]
    for title, those in {
        "verdicts that change": turned,
        "numbers that move beyond rounding and three standard errors, with the same verdict": shown,
    }.items():
        yield f"{title}: {len(those)}"
        if those:
            yield columns([*lines(those)], 2)
    yield f"numbers that move by less: {len(rest) - len(shown)}"


def moved(difference, published, *, as_json: bool = False) -> Iterator[str]:
    """Yield what moves if something is set otherwise; JSON is a list of what counts."""
    if as_json:
        yield json.dumps([_plain(row) for row in difference.moved if row.counts], indent=1)
    else:
        yield from _moving(difference.moved, published)


def compared(difference, published, *, as_json: bool = False) -> Iterator[str]:
    """Yield what moved between two sides, see `marsedl.replication.checks.compare`."""
    before, after, changed, rows, alone = difference
    if as_json:
        claims = [_plain(row) for row in rows]
        inputs = [{"name": name, "before": old, "after": new} for name, (old, new) in changed.items()]
        yield json.dumps({"inputs": inputs, "claims": claims, "judged_in_one": alone}, indent=1)
        return
    yield f"inputs that differ, {before.name} -> {after.name}:"
    yield columns([(name, " -> ".join(pair)) for name, pair in changed.items()] or [("none",)], 2)
    yield from _moving(rows, published)
    if alone:
        yield f"claims judged in only one of the two: {', '.join(alone)}"


def universe(paper: str, row, side, where: str, *, as_json: bool = False) -> Iterator[str]:
    """Yield the choices of a universe, its design, where it is from, and what its claims give."""
    one, outcomes = row.universe, row.outcomes.items()
    claims = [(k, side.entries[k, ""].verdict if of.cause == "result" else of.cause, of.sentence) for k, of in outcomes]
    if as_json:
        of_universe = {"number": one.number, "design": one.design, "wave": one.wave, "seed": one.seed, "from": where}
        yield json.dumps(of_universe | {"choices": dict(side.inputs), "claims": claims}, indent=1)
        return
    wave, again = f" {one.wave}" if one.wave else "", ", with other random numbers" if one.seed else ""
    yield f"universe {one.number} of {paper}, {one.design.replace('_', ' ')}{wave}{again}; from {where}"
    yield columns([(name, str(value)) for name, value in side.inputs.items()], 2)
    yield "\nclaims"
    yield columns(claims, 2)


def explained_claim(project, claim, *, evidence: bool = False) -> Iterator[str]:
    """Yield what is printed of a claim, the verdict on it and its cause, and what each reading gives."""
    from marsedl.replication.claims.counterexamples import in_words
    from marsedl.replication.claims.rows import format_result
    from marsedl.replication.report import one_line

    unit = "" if claim.unit == "1" else f" {claim.unit}"
    printed = "a statement" if isinstance(claim.printed, bool) else f"printed {claim.printed}{unit}"
    yield f"claim {claim.id}: {claim.quantity}\n  {claim.where}; {printed} ({claim.kind})"
    verdict = project.verdicts(claim.paper).get(claim.id)
    if verdict is None:
        yield f"  no verdict yet: run 'snakemake report/claims/{claim.paper}.json{project.options}'"
        return
    yield f"  verdict: {verdict.verdict} (reading {verdict.reading})"
    told = {"remark": one_line.remark(verdict)}
    if one := verdict.universes:
        on = ", ".join([*one.alone, *(f"{name} (in combination)" for name in one.together)])
        share = f"true in {one.true}, undetermined in {one.undetermined} of {one.of} that fill the space"
        told["universes"] = f"{one.label.replace('_', ' ')}{f' on {on}' if on else ''}; {share} and have a result"
        if verdict.is_refuted:
            told = {"why": one_line.cause(verdict)} | told
    if evidence and verdict.counterexample:
        told["turned"] = in_words(verdict.counterexample)
    yield columns([(name, text) for name, text in told.items() if text], 2)
    results = verdict.readings.items()
    yield columns([(name, one.verdict or "–", ", ".join(format_result(verdict, name))) for name, one in results], 4)
    if evidence:
        yield columns([(name, text) for name, one in results for text in one.evidence], 4)
    elif any(one.evidence for _, one in results):
        yield "  --evidence shows what was measured"


def explained_item(project, paper, reading, full, name, kinds) -> Iterator[str]:
    """Yield the artifacts, inputs and code behind the first figure, table or stage of a name.

    `full` are the inputs of the reading at full size; `kinds` all of "figures", "tables", "stages" that have the name.
    """
    of = f"{name} of {paper.slug}, reading {reading.name}"
    if kinds[0] == "stages":
        item, own = paper.stages[name], [name]
        entries = item.entries
        if name == FLIGHTS:  # of which every case is one artifact
            own = [f"{FLIGHTS}.{case}" for case in reading.trial_counts()]
        yield f"stage {of}: {item.meaning}"
    else:
        item, own = paper.product(name), []
        entries = (entry_of(paper.slug, kinds[0], name),)
        place = f"{paper.slug}/" if reading.name == CORRECTED else f"{paper.slug}/{reading.name}/"
        suffix = "png" if kinds[0] == "figures" else "csv"
        yield f"{kinds[0][:-1]} {of}\n  {item.caption}\n  snakemake figures/{place}{name}.{suffix}{project.options}"
    if kinds[1:]:
        yield f"  (also the name of a {' and a '.join(other[:-1] for other in kinds[1:])})"
    artifacts = [*_behind(paper, (*item.needs, *getattr(item, "optional", ()))), *own]
    stages = [paper.stages[artifact.partition(".")[0]] for artifact in artifacts]
    trials = {reading.inputs.CASES[case] for artifact in artifacts if (case := artifact.partition(".")[2])}
    names = trials.union(item.inputs, *(stage.inputs for stage in stages))
    yield "\nartifacts, in the order in which they are made"
    yield columns(_artifacts(project, paper, reading, artifacts), 2)
    yield "\ninputs that it depends on"
    values, unlimited, rows = reading.inputs.plain(), full.plain(), {}
    for key in (key for key in values if key in names):
        source = reading.sources[key]
        limited = "" if values[key] == unlimited[key] else f" (size {project.size}: {values[key]})"
        row = source.key, f"{source.written}{limited}", source.unit, source.source
        rows.setdefault(key.partition(".")[0], []).append(row)
    for section, of_section in rows.items():
        yield f"  {section}\n{columns(of_section, 4)}"
    yield "\ncode that draws or computes it"
    symbols = (symbol for entry in entries for symbol in fingerprints_of(project.root).symbols(entry))
    yield from (f"  {symbol}" for symbol in dict.fromkeys(symbols) if "(at import)" not in symbol)


def _behind(paper, needs) -> list[str]:
    """Artifacts with all that they are made from, in the order in which they are made."""
    found = {}
    for need in needs:
        found |= dict.fromkeys([*_behind(paper, paper.stages[need.partition(".")[0]].needs), need])
    return [*found]


def _artifacts(project, paper, reading, names) -> Iterator[tuple[str, str]]:
    """The name and meaning of artifacts, and the reading that owns the file if it is another one."""
    from marsedl.replication.pipeline.sharing import Shared

    shared = Shared(paper, project.studies[paper.slug])
    for name in names:
        note = ""
        if not shared.has(reading.name, name):
            note = " (has no trials in this reading)"
        elif (owner := shared.owner(reading.name, name)) != reading.name:
            note = f" (shared: that of the reading {owner})"
        yield name, paper.stages[name.partition(".")[0]].meaning + note
