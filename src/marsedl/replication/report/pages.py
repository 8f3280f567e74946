"""The report: a small site of pages that need no network and have the same bytes in every build."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.counts import capital, counted, plural
from marsedl.replication.claims.names import BY_CONSTRUCTION, COUNTED_VERDICTS, VERDICTS_OF
from marsedl.replication.claims.numbers import flatten, format_lines, format_number
from marsedl.replication.claims.rows import format_result, unexplained
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import Arena, Paper, Product
from marsedl.replication.pipeline.libraries import library_versions
from marsedl.replication.records.tables import read_markdown
from marsedl.replication.report import files, one_line
from marsedl.replication.report.assembly import PaperReport, written
from marsedl.replication.report.formulas import with_formulas, with_raised_powers, without_markup
from marsedl.replication.report.front_page import words
from marsedl.replication.report.likeness import LIKENESSES, SEEN, with_likeness
from marsedl.replication.report.pictures import picture
from marsedl.replication.universes.deciding import Number, is_turned

_TEMPLATES = Path(__file__).parent / "templates"
_BARS = 10  # values of choices that are drawn


def build_site(
    folder: Path,
    papers: Sequence[PaperReport],
    size: str,
    citation: Path,
    comparisons: Mapping[str, Any],
    figures: Path = Path("figures"),
    arenas: Mapping[str, Arena] = {},
) -> None:
    """Write the report on all papers as pages, pictures and a zip of them: the files of `site_files`.

    `size` is that of the build; `citation` is the file CITATION.cff; `comparisons` are by name, with the captions
    `figure` and `table`; `arenas` are the scenarios in which laws are compared; `figures` is the folder of figures and
    tables, with one for each paper, the comparisons and the arena.

    Raises ArtifactError if a figure cannot be read.
    """
    drawn, tabled = ({n: Product(getattr(c, kind)) for n, c in comparisons.items()} for kind in ("figure", "table"))
    compared = Paper(files.COMPARISON, "", "", "", figures=drawn, tables=tabled)
    together = _paper(PaperReport(compared, [], {}), figures) | {"name": "all papers"}
    fought = _paper(PaperReport(_of_arenas(arenas), [], {}), figures) | {"name": "arena", "arenas": arenas}
    entries, every = [_paper(report, figures) for report in papers], [row for one in papers for row in one.claims]
    shared = {
        "entries": entries,
        "together": together,
        "fought": fought,
        "counts": counted(every),
        "unexplained": [(report.catalogue.slug, name) for report in papers for name in unexplained(report.claims)],
        "size": size,
        "cited": read_yaml(citation),
    }
    templates = _templates()

    def render(name: str, **more: Any) -> bytes:
        page = templates.get_template(f"{name}.html.j2").render(shared, **more)
        return f"{with_raised_powers(page).strip()}\n".encode()

    written = {f"{page}.html": render(page) for page in files.OTHER_PAGES}
    for entry in entries:
        for name, end in (("paper", ""), ("evidence", "_evidence")):
            written[f"{entry['paper'].slug}{end}.html"] = render(name, entry=entry)
    written |= {f"assets/{name}": (_TEMPLATES / name).read_bytes() for name in files.ASSETS}
    written |= {
        files.EXPLORED.format(one.catalogue.slug): f"const UNIVERSES = {_json(one.decided.explorer)};\n".encode()
        for one in papers
    }
    written[files.PROVENANCE] = _provenance(papers)
    written[files.SEARCH_DATA] = f"const SEARCHED = {_json(_searched([*entries, together, fought]))};\n".encode()
    for entry in (*entries, together, fought):
        pictures = (*entry["figures"].values(), *entry["universes"], entry["picture"])
        written |= {f"pictures/{one.place}.png": one.content.content for one in pictures if one}
    written[files.ZIP] = _zipped(written)
    for name, content in written.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def _of_arenas(arenas: Mapping[str, Arena]) -> Paper:
    """All figures and tables of the arena, by the name of the scenario and their own."""
    drawn, tabled = (
        {f"{name}/{stem}": Product(said) for name, one in arenas.items() for stem, said in getattr(one, kind).items()}
        for kind in ("figures", "tables")
    )
    return Paper(files.ARENA, "", "", "", figures=drawn, tables=tabled)


def _templates() -> Any:
    """Return the templates, with what they can ask for."""
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
        "shown": one_line.shown,
        "cut": one_line.cut,
        "limit": one_line.limit,
        "cause": one_line.cause,
        "remark": one_line.remark,
        "odd_one_out": one_line.odd_one_out,
        "short_doubt": one_line.short_doubt,
        "first_sentence": one_line.first_sentence,
        "shown_unit": one_line.shown_unit,
        "near": one_line.near,
        "figure_label": figure_label,
        "written": written,
        "in_words": in_words,
        "capital": capital,
        "json": _json,
        "said": _said,
        "components": _components,
        "title": _title,
        "prefixed": lambda stem, name: f"{name}/{stem}",
        "count": plural,
        "rich": lambda text: Markup(with_formulas(str(text))),
        "plain": without_markup,
        "raised": with_raised_powers,
        "number": format_number,
        "printed": lambda row: "" if row.is_statement else ", ".join(format_lines(row.printed, None, row.resolution)),
        "unit": lambda row: "" if row.unit == "1" or row.is_statement else row.unit,
        "used": lambda row: ", ".join(format_result(row, row.reading)),
        "by_verdict": lambda row: _grouped((one.verdict, name) for name, one in row.readings.items() if one.verdict),
        "different": lambda one, other, names: [name for name in names if written(one, name) != written(other, name)],
        "about": lambda row, figures: [name for name, one in figures.items() if row.id in one.product.claims],
    }
    templates.globals |= {"kinds": VERDICTS_OF, "likenesses": LIKENESSES, "terms": words(), "default": CORRECTED}
    templates.globals |= {"versions_of": library_versions, "seen_share": SEEN}
    return templates


def _json(data: Any) -> str:
    """JSON that may stand inside of a <script>: no text in it can end the element."""
    return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _provenance(papers: Iterable[PaperReport]) -> bytes:
    """What every artifact of the default reading was made from, as a table."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("paper", "artifact", "meaning", "made from", "seed", "digests of script and code"))
    writer.writerows((report.catalogue.slug, *row) for report in papers for row in report.provenance)
    return stream.getvalue().encode()


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
    return capital(name.replace("_", " ").replace("/", ": "))


class Shown(NamedTuple):
    """A figure or table of a paper, or of the comparison; its content is a picture, or rows below a header."""

    place: str
    name: str
    product: Product
    content: Any
    anchor: str  # its place on a page: figures and tables may have the same names


def _shown(
    products: Mapping[str, Product], folder: Path, read: Callable = picture, end: str = ".png", prefix: str = ""
) -> dict[str, Shown]:
    return {
        name: Shown(f"{folder.name}/{name}", name, product, read(folder / f"{name}{end}"), prefix + name)
        for name, product in products.items()
    }


def _paper(report: PaperReport, root: Path) -> dict[str, Any]:
    """Return what the templates show of one paper; root: the folder of figures and tables."""
    rows, folder = report.claims, root / report.catalogue.slug
    paper = with_likeness(report.catalogue, {row.id: row for row in rows}, folder)
    claims = {row.id: row for row in rows if row.verdict in (*COUNTED_VERDICTS, BY_CONSTRUCTION)}
    headline = sorted((row for row in rows if row.headline), key=lambda row: row.headline)
    changed = _grouped(
        (name, row.id)
        for row in rows
        for name, result in row.readings.items()
        if is_turned(row.readings[CORRECTED].verdict, result.verdict)
    )
    decided = report.decided
    figures = _shown(paper.figures, folder)
    tables = _shown(paper.tables, folder, read_markdown, ".md", "table-")
    caption = "What is printed and what we find, of every headline claim. Statements are drawn over their limits."
    of_universes = files.universe_pictures(_said(row).rstrip(".") for row in headline) if decided else {}
    of_headline = {files.HEADLINE: Product(caption)} if paper.slug not in files.APART else {}
    first = {"short", *(one.anchor for one in (*figures.values(), *tables.values()) if not one.product.beyond)}
    return {
        "report": report,
        "paper": paper,
        "name": figure_label(paper.slug),
        "at": lambda anchor: f"{paper.slug}{'' if anchor in first else '_evidence'}.html#{anchor}",
        "claims": claims,
        "headline": headline,
        "counts": counted(rows),
        "rows": {row.id: row for row in rows},
        "errata": {one.id: one for one in paper.errata},
        "deciding": decided and decided.number and _deciding(decided.number),
        "run": decided and decided.run,
        "effects": decided.errata if decided else (),
        "open": decided.open if decided else (),
        "joint": decided and decided.joint,
        "universes": _shown({name: Product(said) for name, said in of_universes.items()}, folder).values(),
        "changed": dict(sorted(changed.items(), key=lambda verdicts: -len(verdicts[1]))),
        "picture": _shown(of_headline, folder).get(files.HEADLINE),
        "figures": figures,
        "tables": tables,
    }


def _title(one: Shown) -> str:
    """What a table is called: by its number, or else by the first sentence of its caption."""
    is_numbered = re.match(r"(fig|tab)\d", one.name)
    return figure_label(one.name) if is_numbered else one_line.first_sentence(one.product.caption)


def _grouped(pairs: Iterable[tuple[str, Any]]) -> dict[str, list]:
    """Things by what they are paired with."""
    groups: dict[str, list] = {}
    for key, one in pairs:
        groups.setdefault(key, []).append(one)
    return groups


def _said(row: Claim) -> str:
    """A claim in plain words, or else in full."""
    return capital(row.plain or row.quantity)


def _components(row: Claim) -> list[tuple[str, str, str]]:
    """The numbers of a vector, or the rows of a matrix, one by one: printed, ours, verdicts."""
    verdicts = [", ".join(part or "" for part in flatten(one).values()) for one in row.result.components or []]
    columns = format_lines(row.printed, resolution=row.resolution), format_result(row, row.reading), verdicts
    return list(zip(*columns, strict=True)) if len({len(column) for column in columns}) == 1 else []


def _deciding(number: Number) -> dict[str, Any] | None:
    """The deciding number, and what each choice makes of it by itself, the largest change first; a few are drawn.

    Choices that make the same number of it share a bar. `place` is that of a number on a line from 0 to 100 %, within a
    rim of 4 %. None if no choice moves it.
    """
    moved = [one for one in number.effects if one.counts]
    if not moved:
        return None
    sizes = sorted(abs(one.difference) for one in moved)
    usual = max(abs(number.value - number.mark), sizes[len(sizes) // 2])
    near = _grouped(
        (one_line.near(one.number, one.difference), one) for one in moved if abs(one.difference) <= 20 * usual
    )
    bars = dict(list(near.items())[:_BARS])
    drawn = [one for of in bars.values() for one in of]
    values = [number.value, number.mark, *(one.number for one in drawn)]
    least, most = min(values), max(values)
    return {
        "number": number,
        "place": lambda value: round(4 + 92 * (value - least) / (most - least), 1),
        "bars": bars,
        "more": len(moved) - len(drawn),
        "still": sorted({one.choice for one in number.effects} - {one.choice for one in moved}),
    }


def _searched(entries: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """What can be searched for, sorted: address, kind, title and text of all that has an address."""
    found = []
    for entry in entries:
        report, paper, name, parts = entry["report"], entry["paper"], entry["name"], []
        for row in report.claims:
            kind = in_words(row.verdict) if row.id in entry["claims"] else "stated"
            parts.append((row.id, kind, _said(row), row.quantity, row.id, row.where))
        for kind, described in (("figure", paper.described), ("table", {})):
            for one in entry[f"{kind}s"].values():
                parts.append((one.anchor, kind, _title(one), one.product.caption, described.get(one.name)))
        for one in paper.errata:
            parts.append((one.id, "erratum", f"{one.id}. {one.title or one.printed}", one.printed, one.used))
        parts += [(f"input-{key}", "input", key, meaning) for key, (_, meaning) in report.inputs.items()]
        parts += [(f"reading-{key}", "reading", key, one["summary"]) for key, one in report.readings.items()]
        if paper.title:
            parts.append(("short", "paper", name, paper.title, paper.authors, paper.question))
        for anchor, kind, title, *texts in parts:
            text = without_markup(" ".join(filter(None, texts)))
            found.append([entry["at"](anchor), f"{name}: {kind}", without_markup(title), text])
    return sorted(found)
