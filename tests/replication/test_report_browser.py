"""The built page in a headless browser, the system's chromium or chrome."""

import re
import shutil

import pytest
from playwright.sync_api import sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDE, NARROW = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
PAPER = {"width": 1040, "height": 735}  # A4 across

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


def opened(browser, tree, viewport):
    """The page, and what its console and network say."""
    address = tree.path("report/index.html").as_uri()
    page = browser.new_page(viewport=viewport)
    said = []

    def outside(url):
        if not url.startswith((address, "data:")):
            said.append(url[:200])

    page.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: outside(request.url))
    page.goto(address)
    return page, said


@pytest.fixture
def page(browser, tree):
    page, said = opened(browser, tree, WIDE)
    yield page
    page.close()
    assert said == []


def visible(page, selector):
    return page.evaluate("s => [...document.querySelectorAll(s)].filter(e => e.checkVisibility()).length", selector)


def choose(page, **values):
    for name, value in values.items():
        field = page.locator(f"form.filter [name={name}]")
        field.fill(value) if name == "text" else field.select_option(value)


def test_all_images_load_without_errors_or_requests(page):
    images = page.evaluate(
        """async () => {
            const images = [...document.images];
            await Promise.all(images.map(image => image.decode()));
            return images.map(image => [image.naturalWidth, Number(image.getAttribute("width")), image.alt.length]);
        }"""
    )
    assert len(images) > 50
    assert all(natural == stated and words for natural, stated, words in images)


def test_the_filters_show_what_they_say(page):
    counted = page.locator("form.filter output")
    numbers = [int(number) for number in re.findall(r"\d+", counted.text_content())]
    assert numbers[0] == numbers[1] == visible(page, "tbody.row") > 100
    papers = page.locator("form.filter [name=paper] option").all_text_contents()[1:]
    for slug in papers:
        choose(page, paper=slug)
        assert visible(page, "section.paper") == 1
        assert visible(page, "tbody.row") == visible(page, f'section[data-paper="{slug}"] tbody.row') > 0
    choose(page, paper="", verdict="differs")
    assert visible(page, "tbody.row") == visible(page, 'tbody.row[data-first="differs"]') > 0
    assert visible(page, "[data-item]") == 0
    choose(page, verdict="", text="covariance")
    texts = page.evaluate("() => [...document.querySelectorAll('tbody.row:not([hidden])')].map(e => e.textContent)")
    assert texts
    assert all("covariance" in text.lower() for text in texts)
    assert 0 < visible(page, "figure[data-item]") < page.locator("figure[data-item]").count()
    choose(page, text="", reading="printed")
    assert visible(page, 'td[data-reading="corrected"]') == 0
    assert visible(page, 'td[data-reading="printed"]') > 0
    page.locator("form.filter button[type=reset]").click()
    page.wait_for_function("() => document.querySelectorAll('tbody.row[hidden]').length === 0")
    assert [int(number) for number in re.findall(r"\d+", counted.text_content())] == numbers


def test_the_matrix_leads_to_its_claims(page):
    link = page.locator("a[data-verdict=fails]").first
    number = int(link.text_content())
    link.click()
    page.wait_for_function("() => document.querySelectorAll('tbody.row[hidden]').length > 0")
    assert visible(page, "details:not(.stated) tbody.row, .scroll tbody.row") == number


def test_the_address_names_what_is_asked_for(page):
    choose(page, paper="funnels", reading="printed", text="bound")
    assert page.evaluate("() => location.hash") == "#paper=funnels&reading=printed&text=bound"
    before = visible(page, "tbody.row")
    page.locator("form.filter button[type=reset]").click()
    page.wait_for_function("() => location.hash === ''")
    assert visible(page, "tbody.row") > before
    page.evaluate("() => { location.hash = 'paper=funnels&reading=printed&text=bound'; }")
    page.wait_for_function("() => document.querySelector('form.filter [name=text]').value === 'bound'")
    assert visible(page, "tbody.row") == before
    page.reload()
    assert visible(page, "tbody.row") == before > 0


def test_a_link_to_what_is_filtered_out_shows_it(page):
    choose(page, verdict="reproduced")
    page.evaluate("() => { location.hash = '#funnels-fig02'; }")
    page.wait_for_function("() => document.getElementById('funnels-fig02').checkVisibility()")


def test_figures_open_by_click_and_keyboard_and_escape_closes(page):
    dialog = page.locator("dialog")
    page.locator("#powered_descent-fig03 a.zoom").click()
    assert dialog.is_visible()
    assert "fig03" in dialog.locator("p").text_content()
    assert page.evaluate("() => document.querySelector('dialog img').naturalWidth") > 500
    page.keyboard.press("ArrowRight")
    assert "fig04" in dialog.locator("p").text_content()
    page.keyboard.press("Escape")
    assert not dialog.is_visible()
    page.keyboard.press("Enter")  # the link of the figure shown last has the focus
    assert dialog.is_visible()
    assert "fig04" in dialog.locator("p").text_content()
    dialog.locator("button", has_text="close").click()
    assert not dialog.is_visible()


@pytest.mark.parametrize(
    ("closeup", "key", "words"),
    [
        ("powered_descent-closer-final_states", "n", "Trial 0: downrange"),
        ("funnels-closer-funnel", "n", "Slice "),
        ("random_field-closer-iterations", "ArrowRight", "iteration 0"),
    ],
)
def test_a_closer_look_is_drawn_and_answers_to_the_keyboard(page, closeup, key, words):
    figure = page.locator(f"#{closeup}")
    plot = figure.locator(".stage > svg")
    assert plot.locator("path").count() > 3
    before = plot.inner_html()
    assert "NaN" not in before
    plot.focus()
    page.keyboard.press(key)
    assert words in figure.locator(".stage > output").text_content()
    for control in figure.locator("select").all():
        for option in control.locator("option").all():
            control.select_option(option.get_attribute("value"))
            assert "NaN" not in plot.inner_html()
    assert plot.inner_html() != before


def test_the_funnel_turns_under_the_pointer(page):
    plot = page.locator("#funnels-closer-funnel .stage > svg")
    plot.scroll_into_view_if_needed()
    before, box = plot.inner_html(), plot.bounding_box()
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 380, box["y"] + 230)
    page.mouse.up()
    assert plot.inner_html() != before


@pytest.mark.parametrize(("name", "viewport"), [("wide", WIDE), ("narrow", NARROW)])
def test_nothing_runs_out_of_the_window(browser, tree, tmp_path, name, viewport):
    page, said = opened(browser, tree, viewport)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= viewport["width"]
    for part in ("overview", "powered_descent-claims", "powered_descent-figures", "funnels-closer", "funnels-inputs"):
        page.evaluate("id => document.getElementById(id).scrollIntoView()", part)
        page.screenshot(path=tmp_path / f"{name}-{part}.png")
        assert (tmp_path / f"{name}-{part}.png").stat().st_size > 10_000
    page.close()
    assert said == []


def test_in_print_all_is_unfolded_and_no_control_is_left(page, tmp_path):
    page.set_viewport_size(PAPER)
    page.emulate_media(media="print")
    page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details:not([open])").count() == 0
    assert visible(page, "form.filter, .controls, dialog, nav") == 0
    assert visible(page, "details.stated tbody.row") > 0
    assert page.evaluate("() => document.documentElement.scrollWidth") <= PAPER["width"]
    page.screenshot(path=tmp_path / "print.png")
    page.evaluate("() => dispatchEvent(new Event('afterprint'))")
    assert page.locator("details[open]").count() == 0
