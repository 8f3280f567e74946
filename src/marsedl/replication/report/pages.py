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

from marsedl.replication.claims.claim import (
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    LISTED_VERDICTS,
    NUMBERS,
    STANDING_VERDICTS,
    STATEMENTS,
    VERDICTS_OF,
    Claim,
)
from marsedl.replication.claims.counterexamples import in_words
from marsedl.replication.claims.numbers import format_lines, format_number, format_result, is_number
from marsedl.replication.claims.rows import summary, unexplained
from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.records.tables import read_markdown
from marsedl.replication.report import one_line, readings_compared
from marsedl.replication.report.assembly import PaperReport
from marsedl.replication.report.formulas import with_formulas, with_raised_powers, without_markup
from marsedl.replication.report.front_page import words
from marsedl.replication.report.pictures import picture
from marsedl.replication.report.readings_compared import Change, Choice, Compared, Deciding

_TEMPLATES = Path(__file__).parent / "templates"
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
    comparisons: Mapping[str, Any] | None = None,
    figures: Path = Path("figures"),
) -> None:
    """Write the report on all papers as pages, pictures and a zip of them.

    Args:
        folder: where the files of `site_files` go.
        papers: what to say of each paper, in this order.
        environment: what holds for all of them: `size` (text), `citation` (text), `rebuild` (list of commands),
            `versions` (text by package) and `digests` (text by file).
        comparisons: those of all papers together by name, with the captions `figure` and `table`.
        figures: the folder of figures and tables, with a folder for each paper and one for the comparisons.

    Raises:
        InputError: the picture of a paper is none of its figures.
        ArtifactError: a figure is missing or not a PNG image.

    """
    entries = [_paper(paper, figures) for paper in papers]
    shared = {
        "entries": entries,
        "total": summary([row for paper in papers for row in paper.claims]),
        "unexplained": [(paper.catalogue.slug, name) for paper in papers for name in unexplained(paper.claims)],
        **environment,
    }
    compared = (comparisons or {}).items()
    together = {
        "figures": [_figure(figures, "comparison", name, one.figure) for name, one in compared],
        "tables": [_table(figures, "comparison", name, one.table) for name, one in compared],
    }
    render = _renderer()
    files = {
        "index.html": render("index", shared),
        "comparison.html": render("comparison", {**shared, "together": together}),
        "about.html": render("about", shared),
        **{f"{entry['paper'].slug}.html": render("paper", {**shared, "entry": entry}) for entry in entries},
        **{f"assets/{name}": (_TEMPLATES / name).read_text(encoding="utf-8") for name in ASSETS},
        f"assets/{SEARCH_DATA}": f"const SEARCHED = {_script_json(_searched(entries, together))};\n",
    }
    contents = {name: text.encode() for name, text in files.items()}
    drawn = [figure for shown in (*entries, together) for figure in shown["figures"]]
    contents |= {figure["path"]: figure["picture"].content for figure in drawn}
    contents[ZIP] = _zipped(contents)
    folder = Path(folder)
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if name in files:
            write_text(folder / name, files[name])
        else:
            (folder / name).write_bytes(content)


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
    templates.globals |= {
        "signs": SIGNS,
        "meanings": MEANINGS,
        "kinds": VERDICTS_OF,
        "terms": words(),
        "counted": COUNTED_VERDICTS,
        "stand": STANDING_VERDICTS,
        "keys": _KEYS,
        "cards": _CARDS,
        "default": CORRECTED,
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


def _paper(report: PaperReport, root: Path) -> dict[str, Any]:
    """Prepare what the templates show of one paper; root: the folder of figures and tables."""
    paper = report.catalogue
    if paper.picture and paper.picture not in paper.figures:
        raise InputError(f"report: {paper.slug}: the picture {paper.picture!r} is none of its figures")
    titles = {erratum.id: erratum.title or erratum.printed for erratum in paper.errata}
    compared = Compared(report.claims, paper.errata, report.readings, report.meanings)
    can_compare = CORRECTED in report.readings and bool(report.claims)
    moves = compared.causes() if can_compare else {}
    shown = (*COUNTED_VERDICTS, BY_CONSTRUCTION)
    claims = [_claim(row, report, titles, moves.get(row.id, {})) for row in report.claims if row.verdict in shown]
    headline = sorted((c for c in claims if c["row"].headline), key=lambda claim: claim["row"].headline)
    figures = [
        {
            **_figure(root, paper.slug, name, figure.caption, figure.beyond),
            "described": paper.described.get(name, ""),
            "claims": [claim for claim in claims if name in claim["figures"]],
        }
        for name, figure in paper.figures.items()
    ]
    tables = [_table(root, paper.slug, name, table.caption, table.beyond) for name, table in paper.tables.items()]
    tables += [_table(root, paper.slug, name, caption, True) for name, caption in paper.summaries.items()]
    return {
        "paper": paper,
        "report": report,
        "name": figure_label(paper.slug),
        "claims": claims,
        "by_id": {claim["row"].id: claim for claim in claims},
        "stated": [_stated(row) for row in report.claims if row.verdict in set(LISTED_VERDICTS) - {BY_CONSTRUCTION}],
        "headline": headline,
        "stands": sum(claim["row"].verdict in STANDING_VERDICTS for claim in headline),
        "summary": summary(report.claims),
        "chips": _chips(claims),
        "deciding": _deciding(compared, titles) if can_compare else None,
        "errata": _errata(compared),
        "open_inputs": compared.open_inputs() if can_compare else [],
        "readings": _readings(compared),
        "figures": figures,
        "tables": tables,
        "picture": next((figure for figure in figures if figure["name"] == paper.picture), None),
        "inputs": [_input(name, report) for name in report.meanings],
    }


def _figure(root: Path, slug: str, name: str, caption: str, beyond: bool = False) -> dict[str, Any]:
    image = picture(root / slug / f"{name}.png")
    return {
        "name": name,
        "caption": caption,
        "beyond": beyond,
        "described": "",
        "claims": [],
        "target": f"figures/{slug}/{name}.png",
        "path": f"pictures/{slug}/{name}.png",
        "picture": image,
        "wide": image.width > _SIDE,
    }


def _table(root: Path, slug: str, name: str, caption: str, beyond: bool = False) -> dict[str, Any]:
    rows = read_markdown(root / slug / f"{name}.md")
    return {"name": name, "caption": caption, "rows": rows, "beyond": beyond, "target": f"figures/{slug}/{name}.csv"}


def is_about(where: str, stem: str) -> bool:
    """Whether the place of a claim, such as "Sec. V, discussion of Figs. 3 and 5b", names the figure of this stem.

    A figure named without its letter is all of its parts, and a part of a figure that is drawn whole is that figure.
    """
    label = re.fullmatch(r"fig0*(\d+)([a-z]?)", stem)
    if not label:
        return False
    lists = re.findall(r"Figs?\. ((?:\d+[a-z]?(?:, | and )?)+)", where)
    figures = [part for text in lists for part in re.findall(r"(\d+)([a-z]?)", text)]
    return any(number == label[1] and (letter == label[2] or not letter or not label[2]) for number, letter in figures)


def _group(row: Claim) -> str:
    """What a claim is filtered by: verdicts on printed numbers and on statements are counted apart."""
    if row.verdict == BY_CONSTRUCTION:
        return BY_CONSTRUCTION
    return f"{STATEMENTS if row.is_statement else NUMBERS}.{row.verdict}"


def _chips(claims: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[str, str, int]]]:
    """What the claims can be filtered by: for numbers and statements group, verdict and count."""
    groups = [claim["group"] for claim in claims]
    chips = {
        kind: [(f"{kind}.{v}", v, groups.count(f"{kind}.{v}")) for v in verdicts if f"{kind}.{v}" in groups]
        for kind, verdicts in VERDICTS_OF.items()
    }
    fixed = groups.count(BY_CONSTRUCTION)
    return chips | {"neither": [(BY_CONSTRUCTION, BY_CONSTRUCTION, fixed)] if fixed else []}


def _claim(row: Claim, report: PaperReport, titles: Mapping[str, str], moves: Mapping[str, float]) -> dict[str, Any]:
    """Write out a claim's numbers, and what stands behind its verdict."""
    # A verdict from fewer flights does not stand beside one from more.
    readings_by_verdict: dict[str, list[str]] = {}
    for name, result in row.readings.items():
        readings_by_verdict.setdefault(result.comparable.verdict or "not evaluated", []).append(name)
    own = row.result.comparable.verdict
    return {
        **_shared(row),
        "group": _group(row),
        "shown": one_line.shown(row),
        "why": one_line.why(row, titles, report.meanings, moves),
        "own": own,
        "same": readings_by_verdict.pop(own, []),
        "equal_trials": any(result.at_equal_trials for result in row.readings.values()),
        "others": readings_by_verdict,
        "components": _components(row),
        "dots": _dots(row),
        "errata": [name for name in row.errata if name in titles],
        "inputs": list(dict.fromkeys(one_line.named_inputs(" ".join(row.withheld), report.meanings))),
        "figures": [name for name in report.catalogue.figures if is_about(row.where, name)],
    }


def _shared(row: Claim) -> dict[str, Any]:
    """What every claim shows: itself in plain words, or else in full, and the printed value."""
    text = row.plain or row.quantity
    return {
        "row": row,
        "plain": text[:1].upper() + text[1:],
        "printed": "" if row.is_statement else ", ".join(format_lines(row.printed, resolution=row.resolution)),
        "unit": "" if row.unit == "1" or row.is_statement else row.unit,
    }


def _stated(row: Claim) -> dict[str, Any]:
    """An input that the paper states, or literature that it quotes."""
    return {**_shared(row), "used": ", ".join(format_result(row, row.reading))}


def _components(row: Claim) -> list[tuple[str, str, str]]:
    """The numbers of a vector, or the rows of a matrix, one by one: printed, ours, verdicts."""
    components = row.result.components
    if not isinstance(row.printed, list) or not isinstance(components, list):
        return []
    printed, ours = format_lines(row.printed, resolution=row.resolution), format_result(row, row.reading)
    if not len(printed) == len(ours) == len(components):
        return []
    rows = [verdicts if isinstance(verdicts, list) else [verdicts] for verdicts in components]  # of a matrix
    verdicts = [", ".join(verdict or "" for verdict in row) for row in rows]
    return list(zip(printed, ours, verdicts, strict=True))


def _dots(row: Claim) -> dict[str, Any] | None:
    """What every reading gives, on one line from 0 to 100: the number, or the measure that decides a statement.

    What lies further from the printed value, or the limit, than ten times the default reading or half of the others is
    named and not drawn.
    """
    margin = row.result.margin
    if row.is_statement:
        if margin is None or margin.value is None:
            return None
        margins = {name: result.margin for name, result in row.readings.items() if result.margin}
        values = {name: other.value for name, other in margins.items() if other.measure == margin.measure}
        mark, unit, of = margin.limit, margin.unit, "limit"
    else:
        values = {name: result.value for name, result in row.readings.items()}
        mark, unit, of = row.printed, "" if row.unit == "1" else row.unit, "printed"
    finite = {name: value for name, value in values.items() if is_number(value) and math.isfinite(value)}
    own = finite.get(row.reading)
    if len(finite) < 2 or own is None or not is_number(mark) or not math.isfinite(mark):
        return None
    away = sorted(abs(value - mark) for value in finite.values())
    reach = 10 * max(abs(own - mark), away[len(away) // 2])
    near_values = {name: value for name, value in finite.items() if abs(value - mark) <= reach}
    least, most = min([*near_values.values(), mark]), max([*near_values.values(), mark])
    if least == most:
        return None

    def place(value: float) -> float:
        return round(3 + 94 * (value - least) / (most - least), 1)

    return {
        "own": place(own),
        "mark": place(mark),
        "of": of,
        "others": sorted({place(value) for name, value in near_values.items() if name != row.reading}),
        "least": format_number(least),
        "most": format_number(most),
        "printed": format_number(mark),
        "value": format_number(own),
        "unit": "%" if unit == "percent" else unit,
        "count": len(near_values),
        "beyond": [name for name in finite if name not in near_values],
    }


def _signed(change: Change) -> str:
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


def _deciding(compared: Compared, titles: Mapping[str, str]) -> dict[str, Any] | None:
    """The deciding number, and bars from ours to what each choice makes of it, those that change it most first."""
    deciding = compared.deciding()
    if deciding is None:
        return None
    mark = deciding.limit if deciding.printed is None else deciding.printed
    moved = [choice for choice in deciding.choices if choice.change and choice.change.counts]
    bars = [choice for choice in moved if abs(choice.change.difference) <= 20 * _scale(deciding, mark, moved)][:_BARS]
    ends = [deciding.value, *(choice.change.after for choice in bars)]
    ends += [mark] if mark is not None else []
    least, most = min(ends), max(ends)

    def place(value: float) -> float:
        return round(4 + 92 * (value - least) / (most - least), 1) if most > least else 50.0

    def label(choice: Choice) -> str:
        named = [titles[name] for name in choice.errata]
        named = named or [one_line.first_clause(compared.meanings[name] or name) for name in choice.inputs]
        return "; ".join(named[:2]) + (f" and {len(named) - 2} more" if len(named) > 2 else "")

    drawn_readings = {choice.reading for choice in bars}
    return {
        "number": deciding,
        "unit": one_line.shown_unit(deciding.unit),
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


def _scale(deciding: Deciding, mark: float | None, moved: Sequence[Choice]) -> float:
    """The size of a usual change: the distance from what is printed, or that of half of the choices."""
    sizes = sorted(abs(choice.change.difference) for choice in moved)
    return max(abs(deciding.value - mark) if mark is not None else 0.0, sizes[len(sizes) // 2] if sizes else 0.0)


def _errata(compared: Compared) -> dict[str, list[readings_compared.ErratumEffect]]:
    """Errata in groups: by what they change, those without a comparison by the claims that name them, notation."""
    groups: dict[str, list] = {"ranked": [], "together": [], "notation": []}
    for effect in compared.effects():
        groups[effect.group].append(effect)
    groups["together"].sort(key=lambda effect: -len(effect.refuted))
    return groups


def _readings(compared: Compared) -> dict[str, list[dict[str, Any]]]:
    """Readings that change a verdict, those that change most first, and the others; with what differs from the base."""
    changed, groups = compared.changed_verdicts(), {"changed": [], "same": []}
    for name, reading in compared.readings.items():
        base = compared.readings.get(reading.based_on)
        names = readings_compared.different(base, reading, compared.meanings) if base else []
        differences = [(name, base.inputs[name].value, *reading.inputs[name]) for name in names]
        claims = [change.claim for change in changed.get(name, ())]
        entry = {"reading": reading, "claims": claims, "differences": differences}
        groups["changed" if claims else "same"].append(entry)
    groups["changed"].sort(key=lambda entry: -len(entry["claims"]))
    return groups


def _input(name: str, report: PaperReport) -> dict[str, Any]:
    """An input: what the default reading uses, and the other values with their readings."""
    own = report.readings[CORRECTED].inputs[name]
    others: dict[readings_compared.Input, list[str]] = {}
    for reading in report.readings.values():
        if reading.inputs[name].value != own.value:
            others.setdefault(reading.inputs[name], []).append(reading.name)
    return {"name": name, "unit": report.units[name], "meaning": report.meanings[name], "own": own, "others": others}


# -------------------------------------------------------------------------------------------------------------- search


def _searched(entries: Sequence[Mapping[str, Any]], together: Mapping[str, Any]) -> list[list[str]]:
    """What can be searched for, sorted: address, kind, title and text of all that has an address."""
    searchable = []

    def add(page: str, anchor: str, kind: str, title: str, *texts: str) -> None:
        text = without_markup(" ".join(filter(None, texts)))
        searchable.append([f"{page}.html#{anchor}", kind, without_markup(title), text])

    def add_products(page: str, about: str, shown: Mapping[str, Any]) -> None:
        for one in shown["figures"]:
            label = figure_label(one["name"])
            add(page, one["name"], f"{about}: figure", label, one["caption"], one["described"])
        for one in shown["tables"]:
            add(page, f"table-{one['name']}", f"{about}: table", figure_label(one["name"]), one["caption"])

    for entry in entries:
        paper, name = entry["paper"], entry["name"]
        add(paper.slug, "short", "paper", name, paper.title, paper.authors, paper.question)
        for claim in (*entry["claims"], *entry["stated"]):
            row = claim["row"]
            kind = "stated" if "used" in claim else row.verdict.replace("_", " ")
            add(paper.slug, row.id, f"{name}: {kind}", claim["plain"], row.quantity, row.id, row.where)
        add_products(paper.slug, name, entry)
        for erratum in paper.errata:
            title = f"{erratum.id}. {erratum.title or erratum.printed}"
            add(paper.slug, erratum.id, f"{name}: erratum", title, erratum.printed, erratum.used)
        for one in entry["inputs"]:
            add(paper.slug, f"input-{one['name']}", f"{name}: input", one["name"], one["meaning"])
        for reading in entry["report"].readings.values():
            add(paper.slug, f"reading-{reading.name}", f"{name}: reading", reading.name, reading.summary)
        for closeup in entry["report"].closeups:
            add(paper.slug, f"closer-{closeup.name}", f"{name}: closer look", closeup.title, closeup.text)
    add_products("comparison", "all papers", together)
    return sorted(searchable)
