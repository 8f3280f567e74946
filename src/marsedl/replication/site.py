"""The report: a small site of pages that need no network and have the same bytes in every build."""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from marsedl.replication import effects
from marsedl.replication.claims import (
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    DEFAULT_READING,
    LISTED_VERDICTS,
    REFUTED_VERDICTS,
    STANDING_VERDICTS,
    VERDICTS_OF,
    format_lines,
    format_number,
    format_result,
    kind_of_result,
    summary,
    unexplained,
    write_text,
)
from marsedl.replication.counterexamples import in_words
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.formulas import with_formulas, with_raised_powers, without_markup
from marsedl.replication.front_page import words
from marsedl.replication.pictures import Picture, picture
from marsedl.replication.report import Comparison, FigureEntry, InputEntry, PaperReport, ReadingEntry, is_assumed

_TEMPLATES = Path(__file__).parent / "templates"
_ENVIRONMENT_KEYS = ("size", "citation", "rebuild", "versions", "digests")
ASSETS = ("site.css", "site.js", "closeups.js", "minisearch.js")
OTHER_PAGES = ("index.html", "comparison.html", "about.html")
SEARCH_DATA = "search-data.js"
ZIP = "report.zip"
SIGNS = {  # the symbol of each verdict in templates/signs.svg, and its lightness in style
    "reproduced": "good",
    "holds": "good",
    "close": "close",
    "differs": "bad",
    "fails": "bad",
    "undetermined": "open",
    "by_construction": "fixed",
    "as_stated": "same",
    "not_as_stated": "other",
    "quoted": "quoted",
    "thin": "thin",
}
MEANINGS = {
    "reproduced": "within the printed rounding, or within three combined standard errors of it",
    "close": "within a tolerance that was set beforehand",
    "differs": "outside both; the row names the erratum or the input that is not printed",
    "holds": "a computed test decides as the paper says",
    "fails": "a computed test decides against the paper",
    "undetermined": "sampling error or a threshold decides, or the paper does not fix the value",
    "thin": "holds or is reproduced so far from its limit that it could hardly fail",
    "by_construction": "it cannot fail, so it is not counted",
}
_SIDE = 620  # pixels; a wider picture takes the whole width
_CARDS = 8  # columns; a wider table is shown as cards
_BARS = 8  # choices that are drawn
_SMALL_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_KEYS = {  # how each kind of close-up is used
    "scatter": "Choose quantities, flights and the size of the ellipses above the plot. Point at a flight, or step"
    " through them with N and P. Arrow keys move, + and − enlarge and shrink, 0 returns.",
    "tube": "Drag to turn it, or use the arrow keys. + and − enlarge and shrink, 0 returns, N and P go from slice to"
    " slice.",
    "histories": "Choose a quantity above the plot, and show or hide its curves. The left and right arrow keys step"
    " through the iterations, whose values stand below.",
}


def site_files(figures: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the files of a report.

    figures: the names of the figures of each paper by slug, and those of the comparison.
    """
    papers = [slug for slug in figures if slug != "comparison"]
    return [
        *OTHER_PAGES,
        *(f"{slug}.html" for slug in papers),
        *(f"assets/{name}" for name in (*ASSETS, SEARCH_DATA)),
        *(f"pictures/{slug}/{name}.png" for slug, names in figures.items() for name in names),
        ZIP,
    ]


def build_site(
    folder: str | Path,
    papers: Sequence[PaperReport],
    environment: Mapping[str, Any],
    comparison: Comparison | None = None,
) -> None:
    """Write the report on all papers as pages, pictures and a zip of them.

    Args:
        folder: where the files of `site_files` go.
        papers: what to say of each paper, in this order.
        comparison: what to say of all of them together.
        environment: what holds for all of them; every key may be left out:
            `size` (text), `citation` (text), `rebuild` (list of commands), `versions` (text by package) and
            `digests` (text by file).

    Raises:
        InputError: an unknown key, a paper or name given twice, or an input without a value in a listed reading.
        ArtifactError: a figure is missing or not a PNG image.

    """
    for key in environment:
        if key not in _ENVIRONMENT_KEYS:
            raise InputError(f"report: unknown key {key!r}; {nearest(key, _ENVIRONMENT_KEYS)}")
    _refuse_repeats("paper", [paper.slug for paper in papers])
    comparison = comparison or Comparison([], [])
    pictures = {
        (slug, figure.name): picture(figure.image)
        for slug, figures in [*((p.slug, p.figures) for p in papers), (comparison.slug, comparison.figures)]
        for figure in figures
    }
    entries = [_paper(paper, pictures) for paper in papers]
    shared = {
        "entries": entries,
        "total": summary([row for paper in papers for row in paper.claims]),
        "unexplained": [(paper.slug, name) for paper in papers for name in unexplained(paper.claims)],
        **{key: environment.get(key) for key in _ENVIRONMENT_KEYS},
    }
    side_by_side = {
        "figures": [_figure(comparison.slug, figure, pictures, {}) for figure in comparison.figures],
        "tables": comparison.tables,
    }
    render = _renderer()
    files = {
        "index.html": render("index", shared),
        "comparison.html": render("comparison", {**shared, "together": side_by_side}),
        "about.html": render("about", shared),
        **{f"{entry['paper'].slug}.html": render("paper", {**shared, "entry": entry}) for entry in entries},
        **{f"assets/{name}": (_TEMPLATES / name).read_text(encoding="utf-8") for name in ASSETS},
        f"assets/{SEARCH_DATA}": f"const SEARCHED = {_script_json(_searched(entries, side_by_side))};\n",
    }
    contents = {name: text.encode() for name, text in files.items()}
    contents |= {f"pictures/{slug}/{name}.png": one.content for (slug, name), one in pictures.items()}
    folder = Path(folder)
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if name in files:
            write_text(folder / name, files[name])
        else:
            (folder / name).write_bytes(content)
    (folder / ZIP).write_bytes(_zipped(contents))


def _renderer() -> Callable[[str, Mapping[str, Any]], str]:
    """Return the function of a page's name and what it shows that gives its HTML."""
    import jinja2  # slow to import, and only needed here
    from markupsafe import Markup

    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "words": lambda verdict: verdict.replace("_", " "),
        "rich": lambda text: Markup(with_formulas(str(text))),
        "plain": without_markup,
        "json": _script_json,
        "turned": in_words,
        "count": lambda number, word: f"{number} {word}{'' if number == 1 else 's'}",
        "signed": _signed,
        "label": figure_label,
        "small": lambda number: _SMALL_WORDS[number] if number < len(_SMALL_WORDS) else str(number),
    }
    templates.tests["assumed"] = is_assumed
    templates.globals |= {
        "signs": SIGNS,
        "meanings": MEANINGS,
        "kinds": VERDICTS_OF,
        "terms": words(),
        "counted": COUNTED_VERDICTS,
        "stand": STANDING_VERDICTS,
        "keys": _KEYS,
        "cards": _CARDS,
        "default": DEFAULT_READING,
    }

    def render(name: str, context: Mapping[str, Any]) -> str:
        return with_raised_powers(templates.get_template(f"{name}.html.j2").render(context)).strip() + "\n"

    return render


def _script_json(data: Any) -> str:
    """JSON that may stand inside of a <script>: no text in it can end the element."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _zipped(contents: Mapping[str, bytes]) -> bytes:
    """The files as a zip with the same bytes in every build: sorted, with the first date that a zip can hold."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(contents):
            entry = zipfile.ZipInfo(f"report/{name}")
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, contents[name], zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def figure_label(name: str) -> str:
    """Return what a figure or table is called: `Fig. 5a`, `Table 3`, or its name in words."""
    numbered = re.fullmatch(r"(fig|tab)0*(\d+[a-z]?)", name)
    if numbered:
        return f"{'Fig.' if numbered[1] == 'fig' else 'Table'} {numbered[2]}"
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]


# ------------------------------------------------------------------------------------------------------------- a paper


def _paper(paper: PaperReport, pictures: Mapping[tuple[str, str], Picture]) -> dict[str, Any]:
    """Prepare what the templates show of one paper."""
    _check(paper)
    readings = {reading.name: reading for reading in paper.readings}
    titles = {erratum.id: erratum.title or erratum.printed for erratum in paper.errata}
    changing = effects.changing(paper.claims)
    can_compare = DEFAULT_READING in readings and bool(paper.claims)
    moves = effects.causes(paper.claims, paper.errata, paper.inputs, paper.readings) if can_compare else {}
    claims = [
        _claim(row, paper, titles, moves.get(row["id"], {}))
        for row in paper.claims
        if row["verdict"] in (*COUNTED_VERDICTS, BY_CONSTRUCTION)
    ]
    by_id = {claim["row"]["id"]: claim for claim in claims}
    headline = sorted((c for c in claims if c["row"].get("headline")), key=lambda claim: claim["row"]["headline"])
    figures = [_figure(paper.slug, figure, pictures, by_id) for figure in paper.figures]
    return {
        "paper": paper,
        "name": figure_label(paper.slug),
        "claims": claims,
        "by_id": by_id,
        "stated": [_stated(row) for row in paper.claims if row["verdict"] in set(LISTED_VERDICTS) - {BY_CONSTRUCTION}],
        "headline": headline,
        "stands": sum(claim["row"]["verdict"] in STANDING_VERDICTS for claim in headline),
        "summary": summary(paper.claims),
        "chips": _chips(claims),
        "deciding": _deciding(paper, titles) if can_compare else None,
        "errata": _errata(paper),
        "open_inputs": effects.open_inputs(paper.claims, paper.inputs, paper.readings) if can_compare else [],
        "readings": _readings(paper, changing),
        "figures": figures,
        "picture": next((figure for figure in figures if figure["entry"].name == paper.picture), None),
        "inputs": [_input(entry, paper.readings) for entry in paper.inputs],
    }


def _check(paper: PaperReport) -> None:
    """Refuse names that are given twice or lead nowhere."""
    names = [reading.name for reading in paper.readings]
    _refuse_repeats(f"{paper.slug}: reading", names)
    _refuse_repeats(f"{paper.slug}: claim", [row["id"] for row in paper.claims])
    _refuse_repeats(f"{paper.slug}: figure or table", [entry.name for entry in (*paper.figures, *paper.tables)])
    _refuse_repeats(f"{paper.slug}: erratum", [erratum.id for erratum in paper.errata])
    _refuse_repeats(f"{paper.slug}: close-up", [closeup.name for closeup in paper.closeups])
    for reading in paper.readings:
        if reading.based_on is not None and reading.based_on not in names:
            raise InputError(f"report: {paper.slug}: reading {reading.name} is based on unknown {reading.based_on!r}")
        for entry in paper.inputs:
            if reading.name not in entry.values:
                raise InputError(f"report: {paper.slug}: input {entry.name} has no value in reading {reading.name}")
    claim_ids = {row["id"] for row in paper.claims}
    for entry in paper.figures:
        for claim in entry.claims:
            if claim not in claim_ids:
                raise InputError(f"report: {paper.slug}: figure {entry.name} is about unknown claim {claim!r}")
    if paper.picture and paper.picture not in {entry.name for entry in paper.figures}:
        raise InputError(f"report: {paper.slug}: the picture {paper.picture!r} is none of its figures")


def _refuse_repeats(what: str, names: Sequence[str]) -> None:
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        raise InputError(f"report: {what} given twice: {', '.join(repeated)}")


def _figure(slug: str, entry: FigureEntry, pictures: Mapping, claims: Mapping[str, Any]) -> dict[str, Any]:
    picture = pictures[slug, entry.name]
    return {
        "entry": entry,
        "path": f"pictures/{slug}/{entry.name}.png",
        "width": picture.width,
        "height": picture.height,
        "wide": picture.width > _SIDE,
        "claims": [claims[name] for name in entry.claims if name in claims],
    }


def _group(row: Mapping[str, Any]) -> str:
    """What a claim is filtered by: verdicts on printed numbers and on statements are counted apart."""
    if row["verdict"] == BY_CONSTRUCTION:
        return BY_CONSTRUCTION
    return f"{kind_of_result(row)}.{row['verdict']}"


def _chips(claims: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[str, str, int]]]:
    """What the claims can be filtered by: for numbers and statements group, verdict and count."""
    groups = [claim["group"] for claim in claims]
    chips = {
        kind: [(f"{kind}.{v}", v, groups.count(f"{kind}.{v}")) for v in verdicts if f"{kind}.{v}" in groups]
        for kind, verdicts in VERDICTS_OF.items()
    }
    fixed = groups.count(BY_CONSTRUCTION)
    return chips | {"neither": [(BY_CONSTRUCTION, BY_CONSTRUCTION, fixed)] if fixed else []}


def _claim(
    row: Mapping[str, Any], paper: PaperReport, titles: Mapping[str, str], moves: Mapping[str, float]
) -> dict[str, Any]:
    """Write out a claim's numbers, and what stands behind its verdict."""
    result = {"evidence": "", "doubt": "", "margin": None, "trials": None, "at_equal_trials": None, "z": None}
    result |= row["readings"].get(row["reading"]) or {}
    # A verdict from fewer flights does not stand beside one from more.
    compared = {name: other.get("at_equal_trials") or other for name, other in row["readings"].items()}
    readings_by_verdict: dict[str, list[str]] = {}
    for name, other in compared.items():
        readings_by_verdict.setdefault(other["verdict"] or "not evaluated", []).append(name)
    own = compared.get(row["reading"], row)["verdict"]
    statement = row["kind"] == "qualitative"
    meanings = {entry.name: entry.meaning for entry in paper.inputs}
    named = re.findall(r"\b\w+\.\w+\b", " ".join(row.get("withheld") or []))
    return {
        "row": row,
        "result": result,
        "plain": _in_short(row),
        "group": _group(row),
        "printed": "" if statement else ", ".join(format_lines(row["printed"], resolution=row["resolution"])),
        "unit": "" if row["unit"] == "1" or statement else row["unit"],
        "shown": effects.shown(row) if row["readings"] else "",
        "why": effects.why(row, titles, meanings, moves),
        "own": own,
        "same": readings_by_verdict.pop(own, []),
        "equal_trials": any(other.get("at_equal_trials") for other in row["readings"].values()),
        "others": readings_by_verdict,
        "components": _components(row),
        "dots": _dots(row),
        "errata": [name for name in row["errata"] or () if name in titles],
        "inputs": [name for name in dict.fromkeys(named) if name in meanings],
        "figures": [figure.name for figure in paper.figures if row["id"] in figure.claims],
    }


def _in_short(row: Mapping[str, Any]) -> str:
    """A claim in plain words, or else in full."""
    text = row.get("plain") or row["quantity"]
    return text[:1].upper() + text[1:]


def _stated(row: Mapping[str, Any]) -> dict[str, Any]:
    """An input that the paper states, or literature that it quotes."""
    return {
        "row": row,
        "plain": _in_short(row),
        "printed": ", ".join(format_lines(row["printed"], resolution=row["resolution"])),
        "unit": "" if row["unit"] == "1" else row["unit"],
        "used": ", ".join(format_result(row, row["reading"])),
    }


def _components(row: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """The numbers of a vector, or the rows of a matrix, one by one: printed, ours, verdicts."""
    result = row["readings"].get(row["reading"])
    if not isinstance(row["printed"], list) or not result or not isinstance(result.get("components"), list):
        return []
    printed = format_lines(row["printed"], resolution=row["resolution"])
    ours = format_result(row, row["reading"])
    if not len(printed) == len(ours) == len(result["components"]):
        return []
    rows = [verdicts if isinstance(verdicts, list) else [verdicts] for verdicts in result["components"]]  # of a matrix
    verdicts = [", ".join(verdict or "" for verdict in row) for row in rows]
    return list(zip(printed, ours, verdicts, strict=True))


def _dots(row: Mapping[str, Any]) -> dict[str, Any] | None:
    """What every reading gives, on one line from 0 to 100: the number, or the measure that decides a statement.

    What lies further from the printed value, or the limit, than ten times the default reading or half of the others is
    named and not drawn.
    """
    result_here = row["readings"].get(row["reading"])
    margin = result_here and result_here.get("margin")
    if row["kind"] == "qualitative":
        if not margin or margin["value"] is None:
            return None
        values = {
            name: (result.get("margin") or {}).get("value")
            for name, result in row["readings"].items()
            if (result.get("margin") or {}).get("measure") == margin["measure"]
        }
        mark, unit, of = margin["limit"], margin["unit"], "limit"
    else:
        values = {name: result["value"] for name, result in row["readings"].items()}
        mark, unit, of = row["printed"], "" if row["unit"] == "1" else row["unit"], "printed"
    finite = {name: value for name, value in values.items() if _is_finite(value)}
    if len(finite) < 2 or not _is_finite(mark) or row["reading"] not in finite:
        return None
    away = sorted(abs(value - mark) for value in finite.values())
    reach = 10 * max(abs(finite[row["reading"]] - mark), away[len(away) // 2])
    near_values = {name: value for name, value in finite.items() if abs(value - mark) <= reach}
    least, most = min([*near_values.values(), mark]), max([*near_values.values(), mark])
    if least == most:
        return None

    def place(value: float) -> float:
        return round(3 + 94 * (value - least) / (most - least), 1)

    return {
        "own": place(finite[row["reading"]]),
        "mark": place(mark),
        "of": of,
        "others": sorted({place(value) for name, value in near_values.items() if name != row["reading"]}),
        "least": format_number(least),
        "most": format_number(most),
        "printed": format_number(mark),
        "value": format_number(finite[row["reading"]]),
        "unit": "%" if unit == "percent" else unit,
        "count": len(near_values),
        "beyond": [name for name in finite if name not in near_values],
    }


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _signed(change: effects.Change) -> str:
    """The difference of a change with its sign, standard error and unit."""
    text = format_number(change.difference, change.error, None if change.error else _digit(change.difference))
    sign = "+" if change.difference > 0 else ""
    return f"{sign}{text} {'' if change.unit in ('1', '') else change.unit}".strip().replace("-", "−", 1)


def _digit(value: float, digits: int = 3) -> float | None:
    return 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1) if value else None


def _near(value: float, difference: float) -> str:
    """A number with as many digits as three of its difference from another one show."""
    return format_number(value, resolution=_digit(difference))


# ------------------------------------------------------------------------------ what decides, errata, readings, inputs


def _deciding(paper: PaperReport, titles: Mapping[str, str]) -> dict[str, Any] | None:
    """The deciding number, and bars from ours to what each choice makes of it, those that change it most first."""
    deciding = effects.deciding(paper.claims, paper.readings, paper.inputs, paper.errata)
    if deciding is None:
        return None
    meanings = {entry.name: entry.meaning or entry.name for entry in paper.inputs}
    mark = deciding.limit if deciding.printed is None else deciding.printed
    moved = [choice for choice in deciding.choices if choice.change and choice.change.counts]
    bars = [choice for choice in moved if abs(choice.change.difference) <= 20 * _scale(deciding, mark, moved)][:_BARS]
    ends = [deciding.value, *(choice.change.after for choice in bars)]
    ends += [mark] if mark is not None else []
    least, most = min(ends), max(ends)

    def place(value: float) -> float:
        return round(4 + 92 * (value - least) / (most - least), 1) if most > least else 50.0

    def label(choice: effects.Choice) -> str:
        named = [titles[name] for name in choice.errata] or [
            re.split("[:;]", meanings[name])[0] for name in choice.inputs
        ]
        return "; ".join(named[:2]) + (f" and {len(named) - 2} more" if len(named) > 2 else "")

    drawn_readings = {choice.reading for choice in bars}
    return {
        "number": deciding,
        "unit": effects.shown_unit(deciding.unit),
        "value": format_number(deciding.value, deciding.error)
        if deciding.error
        else _near(deciding.value, deciding.value),
        "mark": None if mark is None else format_number(mark),
        "places": (place(deciding.value), None if mark is None else place(mark)),
        "bars": [
            {
                "choice": choice,
                "label": label(choice),
                "place": place(choice.change.after),
                "value": _near(choice.change.after, choice.change.difference),
            }
            for choice in bars
        ],
        "more": [choice.reading for choice in moved if choice.reading not in drawn_readings],
        "still": [choice.reading for choice in deciding.choices if choice.change and not choice.change.counts],
        "none": [choice.reading for choice in deciding.choices if choice.change is None],
    }


def _scale(deciding: effects.Deciding, mark: float | None, moved: Sequence[effects.Choice]) -> float:
    """The size of a usual change: the distance from what is printed, or that of half of the choices."""
    sizes = sorted(abs(choice.change.difference) for choice in moved)
    return max(abs(deciding.value - mark) if mark is not None else 0.0, sizes[len(sizes) // 2] if sizes else 0.0)


def _errata(paper: PaperReport) -> list[tuple[str, list[dict[str, Any]]]]:
    """Errata with the claims that name them, in groups: by what they change, those without a comparison, notation."""
    ranked = effects.errata_effects(paper.claims, paper.errata, paper.readings)
    entries = {erratum.id: erratum for erratum in paper.errata}
    groups: dict[str, list[dict[str, Any]]] = {"ranked": [], "together": [], "notation": []}
    for effect in ranked:
        named = [row["id"] for row in paper.claims if effect.id in (row["errata"] or ())]
        refuted = [row["id"] for row in paper.claims if row["id"] in named and row["verdict"] in REFUTED_VERDICTS]
        alone = effect.rank == effects.NOT_ISOLATED
        group = "together" if alone and refuted else "notation" if alone or effect.rank == effects.NOTHING else "ranked"
        groups[group].append(
            {"entry": entries[effect.id], "effect": effect, "named": named, "refuted": refuted, "group": group}
        )
    groups["together"].sort(key=lambda entry: -len(entry["refuted"]))
    return list(groups.items())


def _readings(paper: PaperReport, changing: effects.Changing) -> dict[str, Any]:
    """Readings that change a verdict, those that change most first, and the others."""
    counts: dict[str, list[str]] = {}
    for claim, changes in changing.claims.items():
        for change in changes:
            counts.setdefault(change.reading, []).append(claim)
    entries = [
        {
            "reading": reading,
            "claims": counts.get(reading.name, []),
            "differences": _differences(reading, paper.inputs),
        }
        for reading in paper.readings
    ]
    with_changes = [entry for entry in entries if entry["claims"]]
    return {
        "changed": sorted(with_changes, key=lambda entry: -len(entry["claims"])),
        "same": [entry for entry in entries if not entry["claims"]],
    }


def _differences(reading: ReadingEntry, inputs: Sequence[InputEntry]) -> list[tuple[InputEntry, str, str, str]]:
    """The inputs whose value differs from that of the reading's base: the input, the base's value, its own, source."""
    if reading.based_on is None:
        return []
    pairs = [(entry, entry.values[reading.based_on], entry.values[reading.name]) for entry in inputs]
    return [(entry, base.value, value.value, value.source) for entry, base, value in pairs if base.value != value.value]


def _input(entry: InputEntry, readings: Sequence[ReadingEntry]) -> dict[str, Any]:
    """An input: what the default reading (or else the first) uses, and the other values with their readings."""
    first = DEFAULT_READING if DEFAULT_READING in entry.values else readings[0].name
    first_value, readings_by_value = entry.values[first], {}
    for reading in readings:
        value = entry.values[reading.name]
        if value.value != first_value.value:
            readings_by_value.setdefault((value.value, value.source), []).append(reading.name)
    return {"entry": entry, "own": first_value, "others": readings_by_value}


# -------------------------------------------------------------------------------------------------------------- search


def _searched(entries: Sequence[Mapping[str, Any]], side_by_side: Mapping[str, Any]) -> list[list[str]]:
    """What can be searched for, sorted: address, kind, title and text of all that has an address."""
    searchable = []

    def add(page: str, anchor: str, kind: str, title: str, *texts: str) -> None:
        searchable.append([f"{page}.html#{anchor}", kind, without_markup(title), without_markup(" ".join(texts))])

    for entry in entries:
        paper, name = entry["paper"], entry["name"]
        add(paper.slug, "short", "paper", name, paper.title, paper.authors, paper.question)
        for claim in entry["claims"]:
            row = claim["row"]
            kind = f"{name}: {row['verdict'].replace('_', ' ')}"
            add(paper.slug, row["id"], kind, claim["plain"], row["quantity"], row["id"], row["where"])
        for claim in entry["stated"]:
            row = claim["row"]
            add(paper.slug, row["id"], f"{name}: stated", claim["plain"], row["quantity"], row["id"], row["where"])
        for figure in paper.figures:
            add(paper.slug, figure.name, f"{name}: figure", figure_label(figure.name), figure.caption, figure.described)
        for table in paper.tables:
            add(paper.slug, f"table-{table.name}", f"{name}: table", figure_label(table.name), table.caption)
        for erratum in paper.errata:
            title = f"{erratum.id}. {erratum.title or erratum.printed}"
            add(paper.slug, erratum.id, f"{name}: erratum", title, erratum.printed, erratum.used)
        for one in paper.inputs:
            add(paper.slug, f"input-{one.name}", f"{name}: input", one.name, one.meaning)
        for reading in paper.readings:
            add(paper.slug, f"reading-{reading.name}", f"{name}: reading", reading.name, reading.description)
        for closeup in paper.closeups:
            add(paper.slug, f"closer-{closeup.name}", f"{name}: closer look", closeup.title, closeup.text)
    for figure in side_by_side["figures"]:
        one = figure["entry"]
        add("comparison", one.name, "all papers: figure", figure_label(one.name), one.caption)
    for table in side_by_side["tables"]:
        add("comparison", f"table-{table.name}", "all papers: table", figure_label(table.name), table.caption)
    return sorted(searchable)
