"""Claims, tables and inputs as pandas data frames."""

from pathlib import Path

import pandas as pd

from marsedl.replication.claims import read_claims
from marsedl.replication.tables import claims_table
from marsedl.results.builds import CORRECTED, find, table_file

# Columns of `verdicts` and the keys of a claim, its margin and its counterexample that they hold.
_CLAIM = {"claim": "id"} | {
    name: name for name in ("kind", "where", "quantity", "reading", "verdict", "errata", "withheld", "thin")
}
_MARGIN = {name: name for name in ("measure", "value", "limit", "unit", "distance")} | {"distance_in": "in"}
_COUNTEREXAMPLE = {name: name for name in ("change", "of", "amount", "to")}
COMPARISON = "comparison"  # of the papers: it stands beside them, and has no readings


def claims(build: str | Path | None = None) -> pd.DataFrame:
    """Return every claim of all papers in every reading, a row for each component of it.

    Columns: paper, claim, component (its place, counted from 1: "[2]", "[2,1]" in a matrix; NaN for a single number),
    reading, value, standard_error, printed, verdict of the whole claim in that reading, trials, unit. For statements,
    value and printed are 1 for true and 0 for false. Missing values are NaN, and NA in trials.

    Args:
        build: folder of the build.

    Raises:
        InputError: there is no such build.
        ArtifactError: its report/claims.json is missing or damaged.

    """
    return claims_table(read_claims(find(build).folder / "report" / "claims.json"))


def verdicts(build: str | Path | None = None) -> pd.DataFrame:
    """Return every claim of all papers in one row: its verdict, what decides it, and what turns it.

    Columns: paper, claim, kind, where and quantity (what is printed, and where), reading (which gives the verdict),
    verdict, errata and withheld (lists of names that explain a difference), thin; of the margin measure, value, limit,
    unit, distance and distance_in; of the counterexample change, of, amount, to. `docs/schemas/claims.json` says what
    they mean. Missing values are NaN: claims that are not counted have no margin and no counterexample.

    Args:
        build: folder of the build.

    Raises:
        InputError: there is no such build.
        ArtifactError: its report/claims.json is missing or damaged.

    """
    rows = []
    for row in read_claims(find(build).folder / "report" / "claims.json"):
        margin = row["readings"].get(row["reading"], {}).get("margin")
        parts = ((row, _CLAIM), (margin or {}, _MARGIN), (row.get("counterexample") or {}, _COUNTEREXAMPLE))
        rows.append({"paper": row["paper"]} | {head: of.get(key) for of, keys in parts for head, key in keys.items()})
    return pd.DataFrame(rows)


def table(paper: str, name: str, reading: str = CORRECTED, build: str | Path | None = None) -> pd.DataFrame:
    """Return a table that a build made; whole numbers stay whole where some are missing.

    Args:
        paper: its slug, or "comparison".
        name: name of the table, as of its file without ending.
        reading: name of the reading; a comparison has none.
        build: folder of the build.

    Raises:
        InputError: there is no such paper or table, or it is not built; the message names what exists.

    """
    place = find(build)
    path = table_file(place, paper, name) if paper == COMPARISON else place.of_paper(paper).table_file(name, reading)
    frame = pd.read_csv(path)
    gaps = [column for column in frame if frame[column].dtype == float and frame[column].isna().any()]
    if gaps:
        texts = pd.read_csv(path, dtype=str)
        for column in gaps:
            if texts[column].dropna().str.fullmatch(r"[+-]?\d+").all() and texts[column].notna().any():
                frame[column] = frame[column].astype("Int64")
    return frame


def inputs(paper: str, reading: str = CORRECTED, build: str | Path | None = None) -> pd.DataFrame:
    """Return the inputs of a reading.

    Columns: name ("section.name"), value (SI, a list for an array), unit, source and meaning.

    Args:
        paper: its slug.
        reading: name of the reading.
        build: folder of the build.

    Raises:
        InputError: there is no such paper or reading; the message names what exists.

    """
    configured = find(build).of_paper(paper).reading(reading)
    rows = [
        (name, value, configured.inputs.unit(name), configured.sources[name].source, configured.inputs.meaning(name))
        for name, value in configured.inputs.plain().items()
    ]
    return pd.DataFrame(rows, columns=["name", "value", "unit", "source", "meaning"])
