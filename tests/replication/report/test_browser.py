"""The built pages in a headless browser, the system's chromium or chrome."""

import re
import shutil
from pathlib import Path

import axe_playwright_python
import pytest
from playwright.sync_api import sync_playwright

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.rows import read_as
from marsedl.replication.universes.deciding import Decided

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
AXE = Path(axe_playwright_python.__file__).parent / "axe.min.js"
SCREEN = 900  # pixels
# Screens that the first page may take, the first one of a paper, and the second with all claims folded.
HEIGHTS = {1440: (6, 8, 12), 390: (14, 12, 26)}
SHEETS = {"index": 7, "paper": 5}  # of A4
EVIDENCE = [f"{slug}_evidence" for slug in SLUGS]
PAGES = ("index", *SLUGS, *EVIDENCE, "comparison", "arena", "about")
LOADED = """async () => {
    const images = [...document.images];
    for (const image of images) image.loading = "eager";
    await Promise.all(images.map(image => image.decode()));
    return images.map(image => [image.naturalWidth, image.alt.length]);
}"""

pytestmark = pytest.mark.workflow


@pytest.fixture(scope="module")
def browser():
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"NOT TESTED: the report in a browser, as none of {', '.join(BROWSERS)} is installed")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield started
        started.close()


def opened(browser, copied, name, width=1440, **options):
    """A page, and what its console and network say."""
    page = browser.new_page(viewport={"width": width, "height": SCREEN}, **options)
    page.set_default_timeout(120_000)  # of a busy machine
    messages = []
    page.on("console", lambda message: messages.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    folder = copied.path("report").as_uri()
    outside = lambda url: not url.startswith((folder, "data:"))  # noqa: E731
    page.on("request", lambda request: messages.append(request.url) if outside(request.url) else None)
    page.goto(f"{folder}/{name}")
    return page, messages


@pytest.fixture
def visit(browser, copied):
    """Open a page at 1440 pixels; in the end no page may have said or asked for anything."""
    visited = []

    def go(name):
        visited.append(opened(browser, copied, name))
        return visited[-1][0]

    yield go
    for page, messages in visited:
        page.close()
        assert messages == []


def visible(page, selector):
    return page.evaluate("s => [...document.querySelectorAll(s)].filter(e => e.checkVisibility()).length", selector)


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_pages_fit_the_window_load_their_pictures_and_axe_finds_nothing(browser, copied, width, scheme):
    index, paper, evidence = HEIGHTS[width]
    for name in PAGES:
        page, messages = opened(browser, copied, f"{name}.html", width, color_scheme=scheme, bypass_csp=True)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= width, name
        screens = page.evaluate("() => document.documentElement.scrollHeight") / SCREEN
        limits = {"index": index} | dict.fromkeys(SLUGS, paper) | dict.fromkeys(EVIDENCE, evidence)
        assert screens <= limits.get(name, evidence), name
        images = page.evaluate(LOADED)
        assert all(natural and words for natural, words in images)
        assert messages == []
        page.evaluate(AXE.read_text(encoding="utf-8"))
        violations = page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")["violations"]
        assert [(name, one["id"], one["nodes"][0]["html"]) for one in violations] == []
        page.close()


def test_every_count_of_the_first_page_leads_to_as_many_claims(visit):
    page = visit("index.html")
    links = page.locator(".matrix a[href*='show=']")
    addresses = links.evaluate_all("links => links.map(link => [link.getAttribute('href'), Number(link.textContent)])")
    assert len(addresses) > 20
    for address, count in addresses[:: len(addresses) // 4]:
        report_page = visit(address)
        assert visible(report_page, "details.claim") == count, address


def test_a_link_to_a_claim_unfolds_it_whatever_the_filter_says(visit):
    page = visit("funnels_evidence.html#show=statements.fails")
    claim = page.locator("details.claim[data-group='statements.holds']").first
    assert not claim.is_visible()
    page.evaluate("id => { location.hash = id; }", claim.get_attribute("id"))
    page.wait_for_function("id => document.getElementById(id).open", arg=claim.get_attribute("id"))
    assert claim.is_visible()
    assert page.evaluate("() => scrollY") > 0


def test_links_to_what_is_folded_unfold_it(visit, copied):
    ids = re.findall(
        r'id="((?:input|table|reading)-[^"]+|E\d+)"', copied.path("report/funnels_evidence.html").read_text()
    )
    for anchor in (ids[0], ids[-1], next(i for i in ids if i.startswith("table-"))):
        page = visit(f"funnels.html#{anchor}")  # the first page, as addresses were before there was a second one
        page.wait_for_url("**/funnels_evidence.html#*")
        assert page.evaluate("id => document.getElementById(id).checkVisibility()", anchor)


def test_the_filter_shows_what_it_says_and_its_address_can_be_passed_on(visit):
    page = visit("random_field_evidence.html")
    every = visible(page, "details.claim")
    chip = page.locator("form.filter label", has_text="holds")
    chip.click()
    assert visible(page, "details.claim") == int(chip.text_content().split()[-1]) < every
    page.locator("form.filter input[type=search]").fill("the")
    texts = page.locator("details.claim:not([hidden])").all_text_contents()
    assert texts
    assert all("the" in text.lower() for text in texts)
    address = page.evaluate("() => location.hash")
    again = visit(f"random_field_evidence.html{address}")
    assert visible(again, "details.claim") == len(texts)
    page.locator("form.filter button").click()
    assert page.locator("details.claim[open]").count() == page.locator("details.claim").count() >= every


def test_the_search_finds_beginnings_and_misspellings_on_all_pages_by_the_keyboard(visit):
    page = visit("about.html")
    page.keyboard.press("/")
    page.keyboard.type("densty")
    page.wait_for_selector("#hits a")
    assert "density" in page.locator("#hits").text_content().lower()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    page.wait_for_url("**/*.html#*")
    anchor = page.evaluate("() => decodeURIComponent(location.hash.slice(1))")
    assert page.evaluate("id => document.getElementById(id).checkVisibility()", anchor)


@pytest.mark.parametrize("slug", SLUGS)
def test_a_reader_turns_the_knobs_of_universes_and_sees_the_rows_of_the_table(visit, copied, slug):
    """Every claim with all knobs as ours, free, and one answer at a time: numbers of the run, and no other universe."""
    page = visit(f"{slug}_evidence.html#explorer")
    told, claim = page.locator("#explorer output"), page.locator("#explorer label.wide select")
    claim.wait_for()
    rows = read_as(Decided, copied.path(f"report/universes/{slug}.json")).explorer
    numbers, knobs, answers = rows["numbers"], rows["knobs"], rows["answers"]
    for at, answer in enumerate(answers):
        claim.select_option(str(at))
        assert told.text_content().startswith(f"1 universe of {len(numbers)} left.")
        if (value := answer["values"][numbers.index(0)]) is not None:
            text = told.text_content().partition("Universe 0 gives ")[2].split()[0].rstrip(":")
            assert float(text) == pytest.approx(value, rel=1e-3)
    claim.select_option("0")
    free, ours = page.locator("#explorer form button").all()
    free.click()
    assert told.text_content().startswith(f"{len(numbers)} universes of {len(numbers)} left.")
    assert page.locator("#explorer circle").count() == sum(value is not None for value in answers[0]["values"])
    assert "NaN" not in page.locator("#explorer svg").inner_html()
    for place, knob in enumerate(knobs):
        ours.click()
        others = [other for other in knobs if other is not knob]
        alone = [k for k in range(len(numbers)) if all(other["places"][k] == other["ours"] for other in others)]
        for value, (asked, _) in enumerate(knob["values"]):
            page.locator("#explorer form label:not(.wide) select").nth(place).select_option(str(value))
            left = sum(knob["places"][k] == value for k in alone)
            assert told.text_content().startswith(f"{left} universe")
            commands = page.locator("#explorer output code").all_text_contents()
            assert commands == [f"marsedl what-if {slug} {knob['choice']}={asked}"] * (value != knob["ours"])


def test_the_explorer_fits_a_phone_and_axe_finds_nothing_in_it(browser, copied):
    page, messages = opened(browser, copied, f"{SLUGS[0]}_evidence.html#explorer", 390, bypass_csp=True)
    page.locator("#explorer select").first.wait_for()
    page.locator("#explorer form button").first.click()
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390
    assert messages == []  # looked at before axe, which asks for style sheets as no page does
    page.evaluate(AXE.read_text(encoding="utf-8"))
    violations = page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in violations] == []
    page.close()


def test_in_print_pages_are_few_pictures_are_there_and_no_control_is_left(visit):
    for name in ("index", "powered_descent"):
        page = visit(f"{name}.html")
        page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
        assert page.locator("img[loading=lazy]").count() == 0
        page.evaluate("() => Promise.all([...document.images].filter(i => i.checkVisibility()).map(i => i.decode()))")
        content = page.pdf(format="A4", prefer_css_page_size=True)
        assert len(re.findall(rb"/Type\s*/Page\b", content)) <= SHEETS.get(name, SHEETS["paper"]), name
        page.emulate_media(media="print")
        assert visible(page, "form.filter, .controls, .search, nav.contents") == 0
        picture_count = visible(page, "img")
        figures = catalogue(name).figures.values() if name in SLUGS else []
        expected = 1 + sum(not figure.beyond for figure in figures) if name in SLUGS else len(SLUGS)
        assert picture_count == expected, name
        assert len(re.findall(rb"/Subtype\s*/Image\b", content)) >= picture_count - 1, name  # one may stand twice
