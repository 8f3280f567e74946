"""Claims, tables and inputs as pandas data frames."""

from pathlib import Path

import pandas as pd

from marsedl.replication.claims.rows import claims_table, read_claims
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import CORRECTED
from marsedl.results.builds import find
from marsedl.scenarios import SCENARIOS

# Columns of `verdicts` that are fields of a claim, of its margin and of its counterexample.
_CLAIM = ("kind", "where", "quantity", "reading", "verdict", "errata", "choices", "thin")
_MARGIN = ("measure", "value", "limit", "unit", "distance", "scale")
_COUNTEREXAMPLE = ("change", "of", "amount", "to")


def claims(build: str | Path | None = None) -> pd.DataFrame:
    """Return every claim of all papers in every reading, a row for each component of it.

    Columns: paper, claim, component (its place, counted from 1: "[2]", "[2,1]" in a matrix; NaN for a single number),
    reading, value, standard_error, printed, verdict of the component, claim_verdict of the whole claim in that reading,
    trials, unit. For statements, value and printed are 1 for true and 0 for false. Missing values are NaN, and NA in
    trials.

    Raises InputError if there is no such build, ArtifactError if its report/claims.json is missing or damaged.
    """
    return claims_table(read_claims(find(build).folder / "report" / "claims.json"))


def verdicts(build: str | Path | None = None) -> pd.DataFrame:
    """Return every claim of all papers in one row: its verdict, what decides it, and what turns it.

    Columns: paper, claim, kind, where and quantity (what is printed, and where), reading (which gives the verdict),
    verdict, errata and choices (lists of names that may explain a difference), thin; of the margin measure, value,
    limit, unit, distance and distance_in; of the counterexample change, of, amount, to. `docs/schemas/claims.json` says
    what they mean. Missing values are NaN: claims that are not counted have no margin and no counterexample.

    Raises InputError if there is no such build, ArtifactError if its report/claims.json is missing or damaged.
    """
    rows = []
    for row in read_claims(find(build).folder / "report" / "claims.json"):
        parts = ((row, _CLAIM), (row.result.margin, _MARGIN), (row.counterexample, _COUNTEREXAMPLE))
        cells = {name: getattr(part, name, None) for part, names in parts for name in names}
        lists = {"errata": list(row.errata), "choices": list(row.choices)}
        rows.append({"paper": row.paper, "claim": row.id} | cells | lists)
    return pd.DataFrame(rows).rename(columns={"scale": "distance_in"})


def table(paper: str, name: str, reading: str = CORRECTED, build: str | Path | None = None) -> pd.DataFrame:
    """Return a table that a build made; whole numbers stay whole where some are missing.

    paper: its slug, or "comparison", which has no readings; name: of the table's file without ending

    Raises InputError, which names what exists, if there is no such paper or table, or it is not built.
    """
    path = find(build).table(paper, name, reading)
    frame, texts = pd.read_csv(path), pd.read_csv(path, dtype=str)
    for column in frame:
        written = texts[column].dropna()
        if frame[column].dtype == float and 0 < len(written) < len(frame) and written.str.fullmatch(r"[+-]?\d+").all():
            frame[column] = frame[column].astype("Int64")
    return frame


def arena(build: str | Path | None = None) -> pd.DataFrame:
    """Return what came out of guidance laws beside each other, in one long table.

    Columns: scenario, condition, tier, law, number (mean, p99, inside, median_end_time and others), unit, value, lower,
    upper (of its 95 % interval; NaN where it has none), trials, best_place and worst_place of the law by the mean
    miss, and the same with _in_box.

    Raises InputError if no scenario is built.
    """
    found = find(build)
    files = {name: found.folder / "figures" / "arena" / name / "ranks.csv" for name in SCENARIOS}
    built = {name: pd.read_csv(path) for name, path in files.items() if path.exists()}
    if not built:
        raise InputError(f"{found.folder}/figures/arena holds no tables; run 'snakemake arena'")
    places = [f"{which}_place{what}" for what in ("", "_in_box") for which in ("best", "worst")]
    of_law = ["condition", "tier", "law", "trials", *places]
    rows = []
    for scenario, table in built.items():
        plain = {column: column.partition(" (")[0] for column in table}
        units = {name: column.partition(" (")[2].rstrip(")") for column, name in plain.items()}
        for row in table.rename(columns=plain).to_dict("records"):
            laws = {"scenario": scenario, **{name: row[name] for name in of_law}}
            for name in row.keys() - {*of_law, "lost"}:
                if not name.endswith(("_lower", "_upper")):
                    ends = {end: row.get(f"{name}_{end}", float("nan")) for end in ("lower", "upper")}
                    rows.append({**laws, "number": name, "unit": units[name], "value": row[name], **ends})
    order = ["scenario", "condition", "tier", "law", "number", "unit", "value", "lower", "upper", *of_law[3:]]
    return pd.DataFrame(rows)[order].sort_values(order[:5], ignore_index=True)


def universes(paper: str, build: str | Path | None = None, *, committed: bool = False) -> pd.DataFrame:
    """Return what every claim gives in every universe: a row for each universe and number of a claim.

    committed: the large run in data/reference/universes of the project, in place of the build's. `frame.attrs` has the
    `run` ("build" or "committed"), its `file`, and the number of its `universes`.

    Columns: universe (its number), design, each choice by its name (the value, or the number of a range), claim,
    component (the claim with the place of the number; of a statement, which test), value, standard_error, limit (what
    is printed, or the limit of a test), decides (of several tests of a statement, that which does there), verdict of
    the component, claim_verdict, trials, cause ("result", or why there is none).

    Raises InputError if there is no such paper or no committed run of it, ArtifactError if the table is not built.
    """
    from marsedl.replication.records import store
    from marsedl.replication.universes.designs import DESIGNS
    from marsedl.replication.universes.judging import COMMITTED, judge_in
    from marsedl.replication.universes.table import Universes

    found = find(build)
    study, run = found.study(paper), "committed" if committed else "build"
    path = (found.project / COMMITTED if committed else found.folder / "report" / "universes") / f"{paper}.h5"
    if committed and not path.exists():
        those = ", ".join(sorted(one.stem for one in path.parent.glob("*.h5"))) or "none"
        raise InputError(f"there is no committed run of {paper}; there is one of: {those}. Leave out committed=True")
    table = store.load(path, Universes, paper=paper)
    judge = judge_in(study, table)
    values = dict(zip(table.choice.tolist(), table.assignment.T, strict=True))
    columns = {
        one.name: values[one.name] if one.range else [[*one.alternatives][int(v)] for v in values[one.name]]
        for one in study.choices
    }
    rows = pd.DataFrame({"universe": table.number, "design": [DESIGNS[k] for k in table.design], **columns})
    frames = []
    places = [(one, place) for one in judge.of.values() for place in range(len(one.labels))]
    for one, place in places:
        claim, label, is_statement = one.claim.id, one.labels[place], one.is_statement
        value, error, limit = one.numbers[:, :, place]
        frames.append(
            rows.assign(
                claim=claim,
                component=f"{claim} {label}".strip() if is_statement else claim + label,
                value=value,
                standard_error=error,
                limit=limit,
                decides=one.tests == place if is_statement else True,
                verdict=one.verdicts if is_statement else one.of_numbers[:, place],
                claim_verdict=one.verdicts,
                trials=one.trials,
                cause=one.cause,
            )
        )
    frame = pd.concat(frames, ignore_index=True).sort_values(["universe", "component"], ignore_index=True)
    frame.attrs |= {"run": run, "file": str(path), "universes": len(table.number)}
    return frame


def inputs(paper: str, reading: str = CORRECTED, build: str | Path | None = None) -> pd.DataFrame:
    """Return the inputs of a reading.

    Columns: name ("section.name"), value (SI, a list for an array), unit, source and meaning.

    Raises InputError, which names what exists, if there is no such paper or reading.
    """
    configured = find(build).reading(paper, reading)
    rows = [
        (name, value, configured.inputs.unit(name), configured.sources[name].source, configured.inputs.meaning(name))
        for name, value in configured.inputs.plain().items()
    ]
    return pd.DataFrame(rows, columns=["name", "value", "unit", "source", "meaning"])
