import base64
import io
import json
import struct
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from marsedl.plotting import style
from marsedl.replication.claims import (
    COUNTED_VERDICTS,
    Close,
    Declaration,
    Evaluation,
    PublishedClaim,
    collect,
    load_published,
)
from marsedl.replication.closeups import CloseUp
from marsedl.replication.errors import ArtifactError, InputError
from marsedl.replication.report import (
    Comparison,
    ErratumEntry,
    FigureEntry,
    InputEntry,
    InputValue,
    PaperReport,
    ReadingEntry,
    TableEntry,
    build_report,
)

PUBLISHED = Path(__file__).parents[2] / "data" / "published" / "powered_descent.yaml"
VOID = {"meta", "link", "img", "input", "br", "hr"}


def png(path, width=640, height=400, colour=(120, 150, 190)):
    """Write a PNG with a diagonal stripe, by hand."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    stripes = (bytes(colour) * 72 + b"\xff" * 24) * (width // 80 + 2)
    rows = b"".join(b"\0" + stripes[3 * (y % 80) :][: 3 * width] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


def evaluate(claim, shift):
    """Make up a result: `shift` in units of the rounding, or of the standard error."""
    if claim.kind in ("undetermined", "context"):
        return None
    if claim.kind == "qualitative":
        return Evaluation(shift < 3, evidence=f"largest contraction factor {0.011 + shift:.3f} over 12 passes.")
    if claim.kind == "input":
        return Evaluation(claim.printed)
    values = claim.printed if isinstance(claim.printed, list) else [claim.printed]
    if claim.kind == "deterministic":
        moved = [value + 0.3 * shift * claim.resolution for value in values]
        return Evaluation(moved if isinstance(claim.printed, list) else moved[0], numbers={"prior": 1349.4446})
    errors = [0.001 + abs(value) * 3e-5 for value in values]
    moved = [value + shift * error for value, error in zip(values, errors, strict=True)]
    single = not isinstance(claim.printed, list)
    return Evaluation(moved[0] if single else moved, errors[0] if single else errors, 2000)


def example(folder, hostile="plain"):
    """Return a realistic report of two papers from made-up numbers."""
    published = load_published(PUBLISHED)
    first = published[0]
    published += [
        replace(first, id="isp", kind="input", quantity="specific impulse", printed=210, resolution=1, unit="s"),
        replace(first, id="ellipse", kind="context", quantity="landing ellipse of Pathfinder", printed=[200, 100]),
    ]
    shifts = {"corrected": 0.5, "printed": 9.0, "target4": 0.2, "plus_sign": 4.0, "newton_noise": 2.5}
    given = {name: {c.id: evaluate(c, shift) for c in published} for name, shift in shifts.items()}
    given["corrected"]["prior_final_mass"] = Evaluation(1349.4446, numbers={"prior": 1349.4446})
    given["corrected"]["mc_final_mean"] = Evaluation(
        [100.05, 50.01, -0.0003, -0.006], [0.05, 0.011, 0.011, 0.011], 2000
    )
    given["corrected"]["alpha_from_isp"] = Evaluation(4.8541e-4 * 1.01)
    given["corrected"]["eq23_equality"] = Evaluation(False, evidence="the two sides differ by 12.3 % of the cost.")
    given["newton_noise"]["alg1_meets_boundary_conditions"] = None
    declared = {
        "alpha_from_isp": Declaration(close=Close("the paper does not state its gravity.", relative=0.02)),
        "prior_final_mass": Declaration(
            "The converged profile ends at {prior:.1f} kg, and the mean of the trials cannot lie above it: the mass is"
            " convex in the thrust.",
            errata=("E10",),
        ),
        "mc_final_mean": Declaration(
            "Altitude {value[1]:.3f} m, {z:.1f} standard errors away; target4 gives {target4[value][1]:.3f} m.",
            errata=("E11",),
            withheld=("the step of the simulation",),
        ),
        "eq23_equality": Declaration("Eq. 23 drops a term that does not depend on the control.", errata=("E12",)),
    }
    readings = [
        ReadingEntry("printed", f"Literally as printed. {hostile}", frozen=True),
        ReadingEntry("corrected", "Errata mended; the default of all figures.", "printed"),
        ReadingEntry("target4", "The downrange target that the authors probably used.", "corrected"),
        ReadingEntry("plus_sign", "The printed sign of the vertical velocity.", "corrected"),
        ReadingEntry("newton_noise", "Noise density in newtons.", "corrected"),
    ]

    def values(printed, corrected, source, **others):
        texts = {reading.name: corrected for reading in readings} | {"printed": printed} | others
        return {
            name: InputValue(text, source if text == printed else "assumed: " + hostile) for name, text in texts.items()
        }

    inputs = [
        InputEntry("initial_velocity", "m/s", values("[46.985, 17.101]", "[46.985, -17.101]", "Eq. 51"), "at 0 s"),
        InputEntry("final_downrange_variance", "m²", values("5", "5", "Eq. 53", target4="4"), "target"),
        InputEntry("noise_density", "N √s", values("0.02", "360", "Sec. V", newton_noise="0.02"), "of the thrust"),
        InputEntry("maximum_thrust", "N", values("18000", "18000", "Sec. V")),
    ]
    figures = [
        FigureEntry(
            f"fig{i:02d}",
            png(folder / f"fig{i:02d}.png", 640 + 160 * (i % 2), 400, (120, 60 + 30 * i, 190)),
            f"Trajectories of the trials with 3-sigma ellipses, drawn over the predicted ones. {hostile}",
            alt="Curves that contract towards the landing site",
            files=(f"figures/powered_descent/fig{i:02d}.png", f"figures/powered_descent/fig{i:02d}.pdf"),
            beyond=i == 4,
            described=f"The paper sees the trials contract. {hostile}" if i < 4 else "",
            claims=("mc_final_mean", "prior_final_mass") if i == 2 else (),
        )
        for i in range(1, 5)
    ]
    rows = [["quantity", "design", "trials"], ["downrange variance / m²", "5.000", "4.99 ± 0.16"], [hostile, "1", "2"]]
    errata = [
        ErratumEntry(
            f"E{i}",
            f"Something printed, number {i}. {hostile}",
            "It contradicts Eq. 43; the covariance at 41 s is then diag(4.50, 0.141, 0.192, 0.210).",
            "The other form, as in `corrected`",
        )
        for i in (10, 11, 12)
    ]
    paper = PaperReport(
        "powered_descent",
        "Uncertainty Quantification and Control During Mars Powered Descent and Landing using Covariance Steering",
        "J. Ridderhof and P. Tsiotras, AIAA Guidance, Navigation, and Control Conference, 2018.",
        collect(published, declared, given),
        readings,
        inputs,
        figures,
        [
            TableEntry(
                "readings", "Measured and predicted variances", rows, ("figures/powered_descent/readings.csv",), True
            )
        ],
        errata,
        "report/claims/powered_descent.json",
        [
            CloseUp(
                "states", "Final states", f"Where the flights end. {hostile}", "histories", {"said": hostile, "n": 1.5}
            )
        ],
        [["quantity", "value"], ["design, compiled", "0.39"]],
        [["stage", "how it ended"], ["certificates", f"8 optimal {hostile}"]],
        [["artifact", "made from"], ["gains", "linearization"]],
    )
    small = PublishedClaim("small", "only", "Table 1", "a matrix", [[1, 2], [3, 4]], "m", "deterministic", resolution=1)
    rows = collect([small], {}, {"corrected": {"only": Evaluation([[1.0, 2.1], [3.2, 4.3]])}})
    environment = {
        "size": "smoke",
        "citation": f"The marsedl developers, marsedl 0.1.0. {hostile}",
        "rebuild": ["make all", "snakemake report  # <html>"],
        "versions": {"numpy": "2.3.1", "casadi": "3.7.0"},
        "digests": {f"figures/powered_descent/fig{i:02d}.png": f"{i:064x}" for i in range(20)},
        "benchmarks": [["rule", "s", "MB"], ["montecarlo", "12.3", "310"]],
        "machines": [["machine", "worst margin"], ["sse", f"0.2 {hostile}"]],
        "margins": [["paper", "artifact", "sse"], ["powered_descent", "gains", "0.0417"]],
    }
    return [
        paper,
        PaperReport("small", "A small paper", "Nobody.", rows, [ReadingEntry("corrected", "All.")]),
    ], environment


def together(folder):
    """A comparison of both."""
    figure = FigureEntry("densities", png(folder / "densities.png"), "All densities.", files=("figures/densities.png",))
    return Comparison([figure], [TableEntry("densities", "All of them", [["paper"], ["small"]], ("densities.csv",))])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    papers, environment = example(folder, hostile="</script><script>alert('x & y')</script>")
    build_report(folder / "out" / "index.html", papers, environment, together(folder))
    return (folder / "out" / "index.html").read_text(encoding="utf-8"), papers, environment, folder


class Checker(HTMLParser):
    """Collects what the tests look at and insists on balanced tags."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.sources, self.images, self.text = [], [], [], [], [], []
        self.headings, self.tables, self.captions, self.scripts, self.data = [], 0, 0, 0, []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        assert len(given) == len(attributes), f"an attribute is repeated in <{tag}>"
        if tag not in VOID:
            self.open.append(tag)
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "a":
            self.links.append(given["href"])
        for name in ("src", "srcset", "data", "poster", "action") + (("href",) if tag == "link" else ()):
            if name in given:
                self.sources.append(given[name])
        if tag == "img":
            self.images.append(given)
        if tag in ("h1", "h2", "h3", "h4"):
            self.headings.append(int(tag[1]))
        if tag == "th":
            assert given.get("scope") in ("col", "row", "colgroup", "rowgroup")
        self.tables += tag == "table"
        self.captions += tag == "caption"
        self.scripts += tag == "script" and "type" not in given
        if tag == "script" and "type" in given:
            assert given["type"] == "application/json"
            self.data.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] not in ("script", "style"):
            self.text.append(data)
        elif self.open[-1] == "script" and not self.scripts:  # the one that draws comes last
            self.data[-1] += data


@pytest.fixture(scope="module")
def page(written):
    checker = Checker()
    checker.feed(written[0])
    checker.close()
    return checker


def test_two_builds_have_the_same_bytes_and_leave_nothing_else(written):
    html, papers, environment, folder = written
    build_report(folder / "again.html", papers, environment, together(folder))
    assert (folder / "again.html").read_bytes() == html.encode()
    assert [path.name for path in (folder / "out").iterdir()] == ["index.html"]
    assert str(folder) not in html


def test_tags_balance_and_ids_are_unique(page):
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))


def test_every_claim_reading_erratum_figure_and_input_is_shown(written, page):
    text = " ".join(page.text)
    for paper in written[1]:
        for row in paper.claims:
            assert f"{paper.slug}-{row['id']}" in page.ids
            assert row["quantity"] in text
            assert row["reason"] in text
            for result in row["readings"].values():
                assert result["evidence"] in text
        for reading in paper.readings:
            assert f"{paper.slug}-reading-{reading.name}" in page.ids
            assert reading.description in text
        assert "<code>corrected</code>" in written[0].partition('class="errata"')[2].partition("</table>")[0]
        for entry in (*paper.figures, *paper.tables, *paper.errata):
            assert f"{paper.slug}-{getattr(entry, 'name', None) or entry.id}" in page.ids
        for entry in paper.inputs:
            assert entry.name in text
            for value in entry.values.values():
                assert value.value in text
                assert value.source.removeprefix("assumed: ") in text
    for digest in written[2]["digests"].values():
        assert digest in text


def test_values_stand_beside_the_print_with_their_errors(page):
    text = " ".join(page.text)
    assert "100.111" in text
    assert "50.010 ± 0.011" in text
    assert "(component 2)" in text
    assert "3.20" in text


def test_text_from_outside_is_escaped(written, page):
    assert "<script>alert" not in written[0]
    assert written[0].count("&lt;/script&gt;&lt;script&gt;alert(&#39;x &amp; y&#39;)&lt;/script&gt;") > 5
    assert page.scripts == 1


def test_nothing_is_loaded_and_every_link_stays_inside(page):
    assert all(source.startswith("data:") for source in page.sources)
    assert page.links
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)


def test_no_style_loads_anything(written):
    assert "url(" not in written[0]
    assert "@import" not in written[0]


def embedded(given):
    return Image.open(io.BytesIO(base64.b64decode(given["src"].removeprefix("data:image/png;base64,")))).convert("RGB")


def test_images_are_inside_with_alternative_text_and_size(written, page):
    figures = [*written[1][0].figures, *together(written[3]).figures]
    assert len(page.images) == len(figures) == 5
    for given, figure in zip(page.images, figures, strict=True):
        original = Image.open(figure.image)
        assert embedded(given).tobytes() == original.convert("RGB").tobytes()  # few colours: all fit in a palette
        assert given["alt"] == (figure.alt or figure.caption)
        assert (int(given["width"]), int(given["height"])) == original.size


def images(folder, *paths):
    """Images as a page holds them, with their sizes in bytes."""
    figures = [FigureEntry(path.stem, path, "Curves.") for path in paths]
    build_report(folder / "index.html", [PaperReport("p", "P", "Nobody.", [], [], figures=figures)], {})
    checker = Checker()
    checker.feed((folder / "index.html").read_text(encoding="utf-8"))
    return [(embedded(given), 3 * len(given["src"]) / 4) for given in checker.images]


def test_a_drawn_figure_shrinks_and_looks_the_same(tmp_path):
    figure, axes = style.new_figure()
    x = np.linspace(0.0, 20.0, 400)
    for k, colour in enumerate((style.BLUE, style.ORANGE, style.GREEN, style.VERMILION, style.PURPLE)):
        axes.plot(x, np.sin(x + k), color=colour, label=f"curve {k}")
        axes.fill_between(x, np.sin(x + k) - 0.1, np.sin(x + k) + 0.1, color=colour, alpha=0.3, linewidth=0)
    axes.plot([3.0], [0.2], "x", color="#CC00CC", markersize=3)  # a colour of a few pixels
    axes.legend()
    style.save_figure(figure, tmp_path / "fig.png")
    before = (tmp_path / "fig.png").read_bytes()
    (image, size), (again, _) = images(tmp_path, tmp_path / "fig.png")[0], images(tmp_path, tmp_path / "fig.png")[0]
    assert size < 0.5 * len(before)
    assert (tmp_path / "fig.png").read_bytes() == before
    drawn = np.asarray(Image.open(tmp_path / "fig.png").convert("RGB")).astype(int)
    moved = np.abs(np.asarray(image).astype(int) - drawn)
    assert moved.max() <= 32
    assert moved.mean() < 1.0
    assert not moved[(drawn == 255).all(axis=-1)].any()
    assert image.tobytes() == again.tobytes()


def test_a_transparent_image_stays_so_and_a_small_one_does_not_grow(tmp_path):
    Image.new("RGBA", (50, 40), (200, 30, 30, 90)).save(tmp_path / "glass.png")
    Image.new("1", (9, 9)).save(tmp_path / "dot.png", optimize=True)
    figures = [FigureEntry(name, tmp_path / f"{name}.png", "Little.") for name in ("glass", "dot")]
    build_report(tmp_path / "index.html", [PaperReport("p", "P", "Nobody.", [], [], figures=figures)], {})
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    glass, dot = (base64.b64decode(part.partition('"')[0]) for part in text.split("data:image/png;base64,")[1:])
    assert Image.open(io.BytesIO(glass)).convert("RGBA").getpixel((7, 7)) == (200, 30, 30, 90)
    assert dot == (tmp_path / "dot.png").read_bytes()


def test_every_product_stands_beside_the_command_that_rebuilds_it(written, page):
    text = " ".join(page.text)
    for entry in (*written[1][0].figures, *written[1][0].tables, *together(written[3]).figures):
        assert f"snakemake {entry.files[0]}" in text
        assert all(name in text for name in entry.files)
    assert "snakemake report/claims/powered_descent.json" in text


def test_runs_solvers_and_provenance_are_shown(page):
    text = " ".join(page.text)
    for words in ("design, compiled", "8 optimal", "linearization", "Run times", "How the solvers ended", "Provenance"):
        assert words in text


def test_assumed_inputs_are_marked_and_counted(written, page):
    inputs = written[0].partition('id="powered_descent-inputs"')[2].partition("</table>")[0]
    assert "of\n4 inputs 0 in <code>printed</code>, 2 in <code>corrected</code>" in inputs
    assert inputs.count('<td data-reading="corrected" class="changed">') == 2
    assert inputs.partition("initial_velocity</code>")[2].count('<span class="tag">assumed</span> &lt;') == 3


def test_an_erratum_leads_to_the_claims_that_name_it(written, page):
    errata = written[0].partition('id="powered_descent-E10"')[2]
    first, _, rest = errata.partition('id="powered_descent-E11"')
    assert 'href="#powered_descent-prior_final_mass"' in first
    assert 'href="#powered_descent-mc_final_mean"' in rest.partition('id="powered_descent-E12"')[0]


def test_other_machines_are_shown_with_every_margin(page):
    text = " ".join("".join(page.text).split())
    assert "On other machines" in text
    assert "0.0417" in text


def test_a_figure_stands_between_what_the_paper_says_and_the_claims_about_it(written, page):
    first, second = (written[0].partition(f'id="powered_descent-fig0{n}"')[2].partition("</figure>")[0] for n in (1, 2))
    assert "<b>In the paper.</b> The paper sees the trials contract." in first
    assert "<b>Here.</b> Trajectories of the trials" in first
    assert "Claims about it" not in first
    about = second.partition("Claims about it.")[2]
    for claim in ("mc_final_mean", "prior_final_mass"):
        verdict = next(row["verdict"] for row in written[1][0].claims if row["id"] == claim)
        assert f'<a href="#powered_descent-{claim}" class="verdict {verdict}"' in about
        assert f'{claim}<span class="hidden-text">: {verdict}</span>' in about


def test_the_overview_names_the_errata_behind_what_differs_or_fails(written, page):
    causes = written[0].partition('class="causes"')[2].partition("</table>")[0]
    refuted = [row for row in written[1][0].claims if row["verdict"] in ("differs", "fails")]
    assert len(refuted) > 2
    assert f'<td class="count" rowspan="3">{len(refuted)}</td>' in causes
    for erratum in ("E10", "E11", "E12"):
        behind = sum(erratum in row["errata"] for row in refuted)
        assert behind == 1
        assert f'#powered_descent-{erratum}">{erratum}</a></td><td class="count">{behind}</td>' in causes
    assert "small" not in causes, "nothing of it differs for a reason that names an erratum"


def test_a_close_up_carries_its_data_which_cannot_end_the_script(written, page):
    assert [json.loads(text) for text in page.data] == [written[1][0].closeups[0].data]
    assert "powered_descent-closer-states" in page.ids
    assert written[1][0].closeups[0].text in " ".join(page.text)


def test_the_comparison_has_a_section_of_its_own(page):
    assert {"comparison", "comparison-densities", "comparison-table-densities"} <= set(page.ids)
    assert "#comparison" in page.links


def test_the_matrix_counts_every_verdict_and_leads_to_its_claims(written, page):
    overview = written[0].partition('id="overview"')[2].partition("</table>")[0]
    rows = overview.split("<tr>")[2:]
    for paper, row in zip(written[1], rows, strict=False):
        cells = [cell.partition("</td>")[0] for cell in row.split('<td class="count')[1:]]
        numbers = [int(cell.partition(">")[2].removesuffix("</a>").rpartition(">")[2]) for cell in cells]
        verdicts = [claim["verdict"] for claim in paper.claims]
        counts = [verdicts.count(verdict) for verdict in COUNTED_VERDICTS]
        listed = len(verdicts) - sum(counts)
        assert numbers == [*counts, sum(counts), listed, len(paper.figures), len(paper.tables), len(paper.errata)]
    assert len(rows) == len(written[1]) + 1


def test_headings_descend_by_one_and_every_table_has_a_caption(written, page):
    assert written[0].startswith('<!DOCTYPE html>\n<html lang="en">')
    assert page.headings.count(1) == 1
    assert all(after - before <= 1 for before, after in zip(page.headings, page.headings[1:], strict=False))
    assert page.tables == page.captions > 5


def test_the_least_that_can_be_given_makes_a_page(tmp_path):
    paper = PaperReport("bare", "Bare", "Nobody.", [], [])
    build_report(tmp_path / "index.html", [paper], {})
    assert "Bare" in (tmp_path / "index.html").read_text()


def refused(tmp_path, error, words, papers=None, environment=None):
    given, _ = example(tmp_path)
    output = tmp_path / "index.html"
    output.write_text("good")
    with pytest.raises(error) as caught:
        build_report(output, papers(given) if papers else given, environment or {})
    for word in words:
        assert word in str(caught.value)
    assert output.read_text() == "good"


def test_unknown_environment_keys_are_refused(tmp_path):
    refused(tmp_path, InputError, ["'version'", "'versions'"], environment={"version": {}})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda paper: [paper, paper], ["paper", "twice", "powered_descent"]),
        (lambda paper: [replace(paper, claims=[*paper.claims, paper.claims[0]])], ["claim", "twice", "alpha_from_isp"]),
        (lambda paper: [replace(paper, figures=[*paper.figures, paper.figures[0]])], ["figure", "twice", "fig01"]),
        (lambda paper: [replace(paper, readings=paper.readings[1:])], ["corrected", "unknown", "printed"]),
        (
            lambda paper: [replace(paper, figures=[replace(paper.figures[0], claims=("mass",))])],
            ["fig01", "unknown claim", "'mass'"],
        ),
        (
            lambda paper: [replace(paper, readings=[*paper.readings, ReadingEntry("mine", "My own.", "printed")])],
            ["initial_velocity", "mine"],
        ),
    ],
)
def test_inconsistent_papers_are_refused(tmp_path, change, words):
    refused(tmp_path, InputError, words, papers=lambda given: change(given[0]))


@pytest.mark.parametrize("content", [None, b"", b"GIF89a", b"\x89PNG\r\n\x1a\n"])
def test_a_figure_that_is_not_a_png_is_refused(tmp_path, content):
    image = tmp_path / "broken.png"
    if content is not None:
        image.write_bytes(content)
    figure = FigureEntry("fig09", image, "Nothing")
    refused(tmp_path, ArtifactError, ["broken.png"], papers=lambda given: [replace(given[0], figures=[figure])])


def test_a_figure_that_is_cut_off_is_refused(tmp_path):
    image = png(tmp_path / "cut.png")
    image.write_bytes(image.read_bytes()[:-60])
    figure = FigureEntry("fig09", image, "Nothing")
    refused(tmp_path, ArtifactError, ["cut.png"], papers=lambda given: [replace(given[0], figures=[figure])])
