"""The pages of the report from made-up contents."""

import hashlib
import json
import re
import zipfile
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import marsedl.replication.report.pages
from marsedl.plotting import style
from marsedl.replication.claims.claim import UNEXPLAINED, Cause, Claim, Margin, Result, Standing, Tolerance
from marsedl.replication.claims.counts import counted
from marsedl.replication.claims.names import COUNTED_VERDICTS
from marsedl.replication.claims.printed import PublishedClaim, load_published
from marsedl.replication.claims.verdicts import Declaration, Evaluation, collect
from marsedl.replication.errors import ArtifactError
from marsedl.replication.pipeline.catalogue import Erratum, Paper, Product
from marsedl.replication.report.assembly import PaperReport
from marsedl.replication.report.files import site_files, universe_pictures
from marsedl.replication.report.one_line import odd_one_out
from marsedl.replication.report.pages import _templates, build_site
from marsedl.replication.report.pictures import picture
from marsedl.replication.universes.deciding import Decided, ErratumEffect, Run, _deciding_number
from marsedl.replication.universes.joint import Joint
from marsedl.replication.universes.judging import Effect, Share
from marsedl.replication.universes.waves import Wave

PUBLISHED = Path(__file__).parents[3] / "data" / "published" / "powered_descent.yaml"
SEARCH_LIBRARY = "8abd09a992d962c447c7e5051f6ab59c64c079d2c8a4da66c873bc5b822a722a"  # without the notice
TEMPLATES = Path(marsedl.replication.report.pages.__file__).parent / "templates"
CLOSE = {"close": {"reason": "", "relative": 0.02, "absolute": None}}
STILL = Standing(label="never", true=0, undetermined=0, deciding=64, of=64, low=0.0, high=0.06)
NEWTON = {
    "choice": "noise_unit",
    "why": "not printed",
    "value": "newton",
    "where": "universe 3",
    "verdict": "fails",
    "number": 4.0,
}
MOVED = STILL.model_copy(update={"cause": Cause(**NEWTON, corrected=5.0)})
VOID = {"meta", "link", "img", "input", "br", "hr"}


def evaluate(claim, shift):
    """Make up a result: `shift` in units of the rounding, or of the standard error."""
    if claim.kind in ("undetermined", "context"):
        return None
    if claim.kind == "qualitative":
        return Evaluation(shift < 3, evidence=f"largest contraction factor {0.011 + shift:.3f} over 12 passes.")
    if claim.kind == "input":
        return Evaluation(claim.printed)
    values = np.array(claim.printed)
    if claim.kind == "deterministic":
        return Evaluation((values + 0.3 * shift * np.array(claim.resolution)).tolist())
    errors = 0.001 + abs(values) * 3e-5
    return Evaluation((values + shift * errors).tolist(), errors.tolist(), 2000)


def drawn(folder, slug, figures=(), tables=()):
    """Write the files of figures and tables."""
    (folder / slug / "universes").mkdir(parents=True, exist_ok=True)
    for name in figures:
        Image.new("RGB", (640, 400), "steelblue").save(folder / slug / f"{name}.png")
    for name in tables:
        (folder / slug / f"{name}.md").write_text("| quantity | <b> |\n| --- | --- |\n| variance | 4.99 |\n")


def reading(summary, based_on, inputs):
    return {"summary": summary, "based_on": based_on, "frozen": based_on is None, "inputs": inputs}


def judged(rows, errata, hostile):
    """Say of made-up universes what pages show: nothing is varied, and errata are those that claims name."""
    effects = []
    for one in errata:
        named = tuple(row.id for row in rows if one.id in row.errata)
        refuted = tuple(row.id for row in rows if one.id in row.errata and row.is_refuted)
        rank = "named" if refuted else "not_varied"
        effects.append(ErratumEffect(one.id, rank, (), (), None, None, (), named, refuted))
    explorer = {"numbers": [0], "said": hostile}
    of_all = Joint([Wave(1.0, {}, (), 0.0)], None, [], [], [])
    run = Run(1, 0, False, 1, Share(0, 0, 0.0, 0.0))
    return Decided({}, tuple(effects), None, (), of_all, run, explorer)


def example(folder, hostile="plain"):
    """Return a report of two papers from made-up numbers; their figures are drawn into the folder."""
    published = load_published(PUBLISHED)
    isp = {"id": "isp", "kind": "input", "quantity": "specific impulse", "printed": 210, "resolution": 1, "unit": "s"}
    ellipse = {"id": "ellipse", "kind": "context", "quantity": "landing ellipse of Pathfinder", "printed": [200, 100]}
    published += [published[0].model_copy(update=of) for of in (isp, ellipse)]
    plain = {published[1].id: f"It is so {hostile}"}
    published = [one.model_copy(update={"plain": plain.get(one.id, "")}) for one in published]
    shifts = {"corrected": 0.5, "printed": 9.0, "target4": 0.2}
    evaluations = {name: {c.id: evaluate(c, shift) for c in published} for name, shift in shifts.items()}
    evaluations["corrected"] |= {
        "prior_final_mass": Evaluation(1349.4446, numbers={"prior": 1349.4446}),
        "mc_final_mean": Evaluation([100.05, 50.01, -0.0003, -0.006], [0.05, 0.011, 0.011, 0.011], 2000),
        "alpha_from_isp": Evaluation(4.8541e-4 * 1.01),
        "eq23_equality": Evaluation(False, evidence="the two sides differ by 12.3 % of the cost."),
    }
    evaluations["printed"]["alg1_meets_boundary_conditions"] = None
    declared = {
        "alpha_from_isp": Declaration(close=Tolerance(reason="the paper does not state its gravity.", relative=0.02)),
        "prior_final_mass": Declaration("The profile ends at {prior:.1f} kg.", errata=("E10",)),
        "mc_final_mean": Declaration(
            "Altitude {value[1]:.3f} m; target4 gives {target4.value[1]:.3f} m.", errata=("E11",), choices=("step",)
        ),
        "eq23_equality": Declaration("Eq. 23 drops a term.", errata=("E12",)),
    }
    inputs = {
        "velocity": ["velocity", [46.985, -17.101], "Eq. 51"],
        "thrust": ["thrust", 18000, f"assumed: {hostile}"],
    }
    mended = inputs | {"velocity": ["velocity", [46.985, 17.101], "E10"]}
    readings = {
        "printed": reading(f"Literally as printed. {hostile}", None, inputs),
        "corrected": reading("Errata mended; the default of all figures.", "printed", mended),
        "target4": reading("The target that the authors probably used.", "corrected", inputs),
    }
    names = [f"fig{i:02d}" for i in range(1, 5)]
    headlines = sum(bool(one.headline) for one in published)
    drawn(folder, "powered_descent", [*names, "headline", *universe_pictures([""] * headlines)], ["eq54"])
    drawn(folder, "small", ["headline", *universe_pictures([])])
    caption = f"Trajectories of the trials with 3-sigma ellipses. {hostile}"
    because, used = "It contradicts Eq. 43.", "The other form, as in `corrected`"
    errata = tuple(
        Erratum(f"E{i}", f"Printed so. {hostile}", because, used, f"Form {i} is wrong {hostile}" if i < 12 else "")
        for i in (10, 11, 12)
    )
    catalogue = Paper(
        *("powered_descent", "Covariance Steering", "J. Ridderhof and P. Tsiotras", "AIAA Conference, 2018."),
        figures={
            name: Product(caption, name == "fig04", claims=("mc_final_mean",) if name == "fig02" else ())
            for name in names
        },
        tables={"eq54": Product("Measured and predicted variances")},
        described=dict.fromkeys(names[:3], f"The paper sees the trials contract. {hostile}"),
        errata=errata,
        question=f"Does it land? {hostile}",
        in_short=("It lands.", f"It is $\\sigma_x$ wide. {hostile}"),
    )
    rows = collect(published, declared, evaluations)
    paper = PaperReport(
        catalogue,
        rows,
        readings,
        judged(rows, errata, hostile),
        dict.fromkeys(inputs, ("m/s", "at 0 s")),
        [["certificates", "solver", f"1 optimal; 1 {hostile} (corrected)", "2", "3 to 1,000", "–"]],
        [["gains", "Gains.", "linearization", "7", "abc"]],
    )
    place = {"paper": "small", "id": "only", "where": "Table 1", "quantity": "a matrix", "kind": "deterministic"}
    small = PublishedClaim(**place, printed=[[1, 2], [3, 4]], unit="m", resolution=1)
    rows = collect([small], {}, {"corrected": {"only": Evaluation([[1.0, 2.1], [3.2, 4.3]])}})
    cited = {"title": "All", "authors": [{"name": "We"}], "version": "1.0", "date-released": "2026-11-27"}
    (folder / "CITATION.cff").write_text(json.dumps(cited))
    alone = Paper("small", "A small paper", "", "Nobody.")
    readings = {"corrected": reading("All.", None, {})}
    return [paper, PaperReport(alone, rows, readings, judged(rows, (), hostile))]


def build(out, papers, folder, size="smoke", comparisons=None):
    """Build the site of figures and CITATION.cff in a folder."""
    build_site(out, papers, size, folder / "CITATION.cff", comparisons or {}, folder)


def together(folder):
    """A comparison of both."""
    drawn(folder, "comparison", ["densities"], ["densities"])
    return {"densities": SimpleNamespace(figure="All densities.", table="All of them")}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    papers = example(folder, hostile="</script><script>alert('x & y')</script>")
    build(folder / "out", papers, folder, comparisons=together(folder))
    return folder, papers


def figures_of(papers):
    own = {}
    for one in papers:
        headlines = ["" for row in one.claims if row.headline]
        own[one.catalogue.slug] = [*one.catalogue.figures, "headline", *universe_pictures(headlines)]
    return {**own, "comparison": ["densities"]}


class Checker(HTMLParser):
    """Collects what the tests look at and insists on balanced tags."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.sources, self.text = [], [], [], [], []
        self.headings, self.tables, self.captions, self.data = [], 0, 0, []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        assert len(values) == len(attributes), f"an attribute is repeated in <{tag}>"
        if tag not in VOID:
            self.open.append(tag)
        if "id" in values:
            self.ids.append(values["id"])
        if tag == "a":
            self.links.append(values["href"])
        if "src" in values:
            self.sources.append(values["src"])
        if tag in ("h1", "h2", "h3", "h4"):
            self.headings.append(int(tag[1]))
        if tag == "th":
            assert values.get("scope") in ("col", "row", "colgroup", "rowgroup")
        self.tables += tag == "table"
        self.captions += tag == "caption"
        if tag == "script" and "src" not in values:
            assert values["type"] == "application/json"
            self.data.append("")

    def handle_endtag(self, tag):
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.data[-1] += data
        else:
            self.text.append(data)


def read(path):
    checker = Checker()
    checker.feed(path.read_text(encoding="utf-8"))
    checker.close()
    return checker


@pytest.fixture(scope="module")
def pages(site):
    return {path.name: read(path) for path in sorted((site[0] / "out").glob("*.html"))}


def words(page):
    return " ".join("".join(page.text).split())


def test_two_builds_have_the_same_bytes_and_the_files_that_are_promised(site):
    folder, papers = site
    build(folder / "again", papers, folder, comparisons=together(folder))
    first, second = (
        {path.relative_to(folder / name).as_posix(): path.read_bytes() for path in (folder / name).rglob("*.*")}
        for name in ("out", "again")
    )
    assert first == second
    assert set(first) == set(site_files(figures_of(papers)))
    assert not any(str(folder).encode() in content for content in first.values())


def test_files_that_a_page_names_are_written(site):
    text = (site[0] / "out" / "about.html").read_text("utf-8")
    assert {*re.findall("<code>report/([^<]*)</code>", text)} <= {*site_files(figures_of(site[1]))}


def test_the_zip_holds_all_other_files(site):
    with zipfile.ZipFile(site[0] / "out" / "report.zip") as archive:
        names = {name.removeprefix("report/") for name in archive.namelist()}
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.read("report/index.html") == (site[0] / "out" / "index.html").read_bytes()
    assert names == set(site_files(figures_of(site[1]))) - {"report.zip"}


def test_tags_balance_ids_are_unique_and_tables_have_captions(pages):
    assert len(pages) == 8
    for page in pages.values():
        assert page.open == []
        assert len(page.ids) == len(set(page.ids))
        assert page.headings.count(1) == 1
        assert all(after - before <= 1 for before, after in zip(page.headings, page.headings[1:], strict=False))
        assert page.tables == page.captions


def test_all_that_is_searched_for_has_an_address(site, pages):
    text = (site[0] / "out" / "assets" / "search-data.js").read_text(encoding="utf-8")
    targets = json.loads(text.removeprefix("const SEARCHED = ").removesuffix(";\n"))
    assert targets == sorted(targets)
    addresses = [entry[0].split("#") for entry in targets]
    assert all(anchor in pages[page].ids for page, anchor in addresses)
    assert "</script" not in text
    paper = site[1][0]
    catalogue = paper.catalogue
    first, second = "powered_descent.html", "powered_descent_evidence.html"
    for anchor in [row.id for row in paper.claims] + [e.id for e in catalogue.errata]:
        assert [second, anchor] in addresses
    for anchor, figure in catalogue.figures.items():
        assert [second if figure.beyond else first, anchor] in addresses
    for page, prefix, names in (
        (second, "input", paper.inputs),
        (second, "reading", paper.readings),
        (first, "table", catalogue.tables),
    ):
        assert all([page, f"{prefix}-{name}"] in addresses for name in names)


def test_text_from_outside_is_escaped(site):
    text = "".join((site[0] / f"out/powered_descent{end}.html").read_text("utf-8") for end in ("", "_evidence"))
    assert "<script>alert" not in text
    assert text.count("&lt;/script&gt;&lt;script&gt;alert(&#x27;x &amp; y&#x27;)&lt;/script&gt;") > 5


def test_a_drawn_figure_shrinks_and_looks_the_same(tmp_path):
    figure, axes = style.new_figure()
    x = np.linspace(0.0, 20.0, 400)
    for k, colour in enumerate((style.BLUE, style.ORANGE, style.GREEN, style.VERMILION, style.PURPLE)):
        axes.plot(x, np.sin(x + k), color=colour, label=f"curve {k}")
        axes.fill_between(x, np.sin(x + k) - 0.1, np.sin(x + k) + 0.1, color=colour, alpha=0.3, linewidth=0)
    axes.plot([3.0], [0.2], "x", color="#CC00CC", markersize=3)  # a colour of a few pixels
    axes.legend()
    inches = figure.get_size_inches()
    style.save_figure(figure, tmp_path / "fig.png")
    before = (tmp_path / "fig.png").read_bytes()
    reduced, again = picture(tmp_path / "fig.png"), picture(tmp_path / "fig.png")
    assert reduced == again
    assert len(reduced.content) < 0.5 * len(before)
    assert (tmp_path / "fig.png").read_bytes() == before
    assert [reduced.width, reduced.height] == pytest.approx(list(80 * inches), abs=1)
    (tmp_path / "reduced.png").write_bytes(reduced.content)
    whole_image, image = (
        np.asarray(Image.open(tmp_path / f"{n}.png").convert("RGB")).astype(int) for n in ("fig", "reduced")
    )
    moved = np.abs(image - whole_image)
    assert moved.max() <= 32
    assert moved.mean() < 1.0
    assert not moved[(whole_image == 255).all(axis=-1)].any()


def test_the_first_page_counts_numbers_and_statements_apart(site, pages):
    rows = [row for paper in site[1] for row in paper.claims]
    text = words(pages["index.html"])
    numbers = [row.verdict for row in rows if row.kind != "qualitative" and row.verdict in COUNTED_VERDICTS]
    statements = [row.verdict for row in rows if row.kind == "qualitative" and row.verdict in COUNTED_VERDICTS]
    assert numbers and statements
    assert "This report comes from a run of size smoke." in text
    assert f"{numbers.count('reproduced')} of {len(numbers)} printed numbers reproduce" in text
    assert f"{statements.count('holds')} of {len(statements)} statements hold." in text


def test_a_claim_that_other_readings_judge_otherwise_names_them(site):
    html = (site[0] / "out" / "powered_descent_evidence.html").read_text(encoding="utf-8")
    claim = html.partition('id="mc_final_mean"')[2].partition("</details>")[0]
    row = next(row for row in site[1][0].claims if row.id == "mc_final_mean")
    verdicts = {name: result.verdict for name, result in row.readings.items()}
    differing = {name for name, verdict in verdicts.items() if verdict not in (verdicts[row.reading], None)}
    assert differing
    assert set(re.findall('href="#reading-([a-z0-9_]+)"', claim)) == differing
    assert 'href="#E11"' in claim
    assert 'href="powered_descent.html#fig02"' in claim


def test_the_explorer_has_its_rows_in_a_script_of_its_own(site, pages):
    script = (site[0] / "out" / "assets" / "universes-powered_descent.js").read_text("utf-8")
    rows = json.loads(script.removeprefix("const UNIVERSES = ").rstrip(";\n"))
    assert rows == site[1][0].decided.explorer
    assert "assets/explorer.js" in pages["powered_descent_evidence.html"].sources
    assert "assets/explorer.js" not in pages["comparison.html"].sources


@pytest.mark.parametrize(
    ("verdict", "more", "line"),
    [
        (
            "differs",
            {"universes": MOVED},
            "Noise unit = newton (not printed) comes nearest to its limit: 5.00 becomes 4.00",
        ),
        ("fails", {"universes": STILL}, "No choice that we varied by itself explains it"),
        ("differs", {}, "Outside rounding and sampling error"),
        ("fails", {}, "Limit 1.25 m"),
        ("holds", {"universes": MOVED}, "Limit 1.25 m, 3.2 standard errors away"),
        ("reproduced", {}, "3.2 standard errors inside the limit"),
        ("close", CLOSE, "Within 2 %, the tolerance stated beforehand"),
        ("by_construction", {"by_construction": "it is `x` < 1"}, "It is <code>x</code> &lt; 1"),
        ("as_stated", {}, ""),
    ],
)
def test_the_line_says_why_a_verdict_is_what_it_is(verdict, more, line):
    off = {"measure": "it", "value": 5.0, "limit": 1.25, "unit": "m", "distance": 3.21, "in": "standard errors"}
    result = Result(value=True, verdict=verdict, margin=off)
    base = {"paper": "p", "id": "c", "kind": "qualitative", "printed": True, "reading": "corrected"}
    row = Claim(**base, verdict=verdict, readings={"corrected": result}, **more)
    assert _templates().get_template("macros.html.j2").module.why(row) == line


def headline_row(name, verdict="holds", **more):
    """A headline claim as it is read from a build."""
    base = {"paper": "p", "id": name, "plain": f"{name} is so", "kind": "qualitative", "printed": True, "headline": 1}
    result = Result(value=True, verdict=verdict)
    return Claim(**base, verdict=verdict, reading="corrected", readings={"corrected": result}, **more)


@pytest.mark.parametrize(
    ("best", "computed", "line"),
    [
        ((3, 3, 1007), "abc", "All 3, in universe 1007; 2 of 3 in ours."),
        ((2, 3, 1007), "abc", "At most 2 of 3, in universe 1007; 2 of 3 in ours."),
        ((2, 2, 0), "ab", "All the 2 that universes compute, in <code>corrected</code>; 2 of 3 in ours. {c}"),
        ((1, 2, 7), "ac", "At most 1 of the 2 that universes compute, in universe 7; 2 of 3 in ours. {b}"),
        ((0, 3, 0), "abc", "No headline is true in any universe; 2 of 3 in ours."),
        (None, "", "Universes compute none of the 3 headlines. {a} {b} {c}"),
    ],
)
def test_one_line_says_how_many_headlines_are_true_at_once_in_the_counts_of_the_page(best, computed, line):
    rows = [headline_row("a"), headline_row("b"), headline_row("c", "fails")]
    best = best and SimpleNamespace(headlines=best[0], of=best[1], universe=best[2])
    absent = [row.id for row in rows if row.id not in computed]
    entry = {"joint": SimpleNamespace(best=best, not_computed=absent), "counts": counted(rows), "headline": rows}
    absent = {name: f"Universes do not compute “{name.upper()} is so”." for name in "abc"}
    said = _templates().get_template("macros.html.j2").module.at_once(entry)
    assert str(said).strip() == line.format(**absent)


def test_a_headline_that_no_universe_computes_is_not_one_that_none_decides():
    standing = STILL.model_copy(update={"label": "not_computed", "true": 0, "of": 0})
    rows = [headline_row("a", universes=standing), headline_row("b")]
    entry = {"headline": rows, "name": "P", "paper": SimpleNamespace(found={})}
    entry |= {"run": SimpleNamespace(), "at": "#{}".format}
    table = str(_templates().get_template("macros.html.j2").module.headline(entry))
    assert table.count("not computed in universes") == 2
    assert "no universe decides it" not in table


@pytest.mark.parametrize(
    ("verdict", "true", "line"),
    [
        ("fails", 357, "true in 357 of 509 universes"),
        ("differs", 73, ""),
        ("holds", 27, "true in 27 of 509 universes"),
        ("reproduced", 500, ""),
        ("undetermined", 500, ""),
        ("by_construction", 0, ""),
    ],
)
def test_a_claim_that_most_universes_judge_otherwise_says_in_how_many_it_is_true(tmp_path, verdict, true, line):
    standing = STILL.model_copy(update={"true": true, "of": 509})
    assert odd_one_out(headline_row("a", verdict, universes=standing)) == line
    assert odd_one_out(headline_row("a", verdict)) == ""
    few = standing.model_copy(update={"label": "too_few"})
    assert odd_one_out(headline_row("a", verdict, universes=few)) == ""


def test_a_row_of_the_second_page_says_so_and_what_its_number_is(tmp_path):
    papers = example(tmp_path)
    standing = STILL.model_copy(update={"true": 60})
    rows = [row.model_copy(update={"universes": standing}) for row in papers[0].claims]
    off = {"measure": "cost of feedback", "value": 5.0, "limit": 1.25, "unit": "m", "distance": 3.2, "in": "limits"}
    at = next(k for k, row in enumerate(rows) if row.is_statement)
    result = rows[at].result.model_copy(update={"margin": Margin.model_validate(off)})
    rows[at] = rows[at].model_copy(update={"readings": {"corrected": result}})
    build(tmp_path / "out", [replace(papers[0], claims=rows)], tmp_path)
    page = (tmp_path / "out" / "powered_descent_evidence.html").read_text("utf-8")
    for row in (row for row in rows if row.is_refuted):
        summary = page.partition(f'id="{row.id}"')[2].partition("</summary>")[0]
        assert "true in 60 of 64 universes" in summary
    summary = page.partition(f'id="{rows[at].id}"')[2].partition("</summary>")[0]
    assert 'data-name="Ours">5 m <small>cost of feedback</small>' in summary


def test_a_caption_stands_whole_where_a_figure_is_unfolded_and_a_table_has_a_title(site, pages):
    page = (site[0] / "out" / "powered_descent.html").read_text("utf-8")
    caption = site[1][0].catalogue.figures["fig01"].caption
    assert f"<p>{escape(caption)}" in page.partition('id="fig01"')[2]
    assert "<summary>Measured and predicted variances</summary>" in page
    assert "Eq54" not in words(pages["powered_descent.html"])
    search = (site[0] / "out" / "assets" / "search-data.js").read_text("utf-8")
    assert '"powered_descent.html#table-eq54","Powered descent: table","Measured and predicted variances"' in search


def effect(value, towards, size, cause="result"):
    number = 5.0 + size if towards else 5.0 - size
    off = abs(number - 9.0)
    return Effect(
        f"choice_{value}", value, "universe 3", "differs", cause, number, number - 5.0, off, size, towards, False
    )


def test_the_deciding_number_is_moved_by_the_choice_of_the_largest_effect():
    """Of three claims that fail, the second is the first that is moved by what moves the third most of all."""
    moved = {
        "first": [effect("some", True, 2.0)],
        "second": [effect("most", True, 3.0)],
        "third": [effect("most", True, 5.0)],
    }
    result, base = Result(value=5.0, verdict="differs"), {"paper": "p", "kind": "deterministic", "printed": 9.0}
    rows = [
        Claim(id=name, headline=place, verdict="differs", reading="corrected", readings={"corrected": result}, **base)
        for place, name in enumerate(moved)
    ]
    of_each = {"number": 5.0, "error": 0.0, "printed": 9.0}
    judged = {name: SimpleNamespace(**of_each, effects=of, cause=of[0]) for name, of in moved.items()}
    judge = SimpleNamespace(column=moved, judged=judged.get, unit=lambda name: "m")
    assert _deciding_number(rows, judge).claim == "second"


def test_verdicts_without_a_reason_are_named_on_every_page(tmp_path):
    papers = example(tmp_path)
    rows = {row.id: row for row in papers[0].claims}
    row = next(row for row in rows.values() if row.is_refuted)
    rows[row.id] = row.model_copy(update={"reason": UNEXPLAINED})
    papers = [replace(papers[0], claims=list(rows.values()))]
    build(tmp_path / "out", papers, tmp_path, "full")
    for name in ("index.html", "powered_descent.html", "about.html"):
        page = read(tmp_path / "out" / name)
        assert "1 result is unexplained." in words(page)
        assert f"powered_descent_evidence.html#{row.id}" in page.links
        assert "run of size" not in words(page)


def test_the_search_library_is_what_its_notice_says():
    content = (TEMPLATES / "minisearch.js").read_bytes()
    assert hashlib.sha256(content.partition(b"*/\n")[2]).hexdigest() == SEARCH_LIBRARY
    assert b"MIT License" in content
    assert b"Permission is hereby granted" in content


@pytest.mark.parametrize("content", [None, b"GIF89a"])
def test_a_figure_that_is_not_a_png_is_refused_and_the_last_report_stays(tmp_path, content):
    papers = example(tmp_path)
    image, output = tmp_path / "powered_descent" / "fig03.png", tmp_path / "out" / "index.html"
    image.unlink()
    if content is not None:
        image.write_bytes(content)
    output.parent.mkdir()
    output.write_text("good")
    with pytest.raises(ArtifactError, match=r"fig03\.png"):
        build(output.parent, papers, tmp_path)
    assert output.read_text() == "good"
    assert list(output.parent.iterdir()) == [output]
