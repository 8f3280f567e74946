"""What readers read: no word before its definition, and no typed number of ours."""

import html
import re
from pathlib import Path

import pytest
import yaml

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.printed import load_published
from marsedl.replication.report.front_page import words

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?(?!\w)")
# Digits that are no results of ours, each with the reason. Beside them, numbers that the paper prints and inputs stand.
NOT_OURS = {
    r"\{[^}]*\}": "a number that is quoted by name",
    r"`[^`]*`": "code",
    r"\$[^$]*\$": "a formula",
    r"\"[^\"]*\"|“[^”]*”": "words of the paper",
    r"\b(?:Fig|Eq|Sec|Section|Table|Tab|Ref|Remark|Prop\w*|Theorem|Corollary|Lemma|Algorithm|Appendix)s?\.? "
    r"(?:[IVX]+\.?[A-Z]?\.?)?\d[\w.]*(?:(?:, | and | to | or )\d\w*)*": "a place in a paper",
    r"\bE\d+\w*|\b[A-Za-z]\w*[_^-]?\d\w*": "the name of an erratum, a symbol or a unit with its power",
    r"\b(?:19|20)\d\d\w?\b": "a year, and a version named after it",
    r"(?<![\d.,])\d{1,2}(?![\d,]|\.\d|e[+-]?\d| ?%| per ?cent)": "what counts, or a convention",
    r"\b(?:95|99|100|1) ?(?:%|per ?cent)": "a percentile, a level or the whole",
}


def texts_of(value, place="texts"):
    """The texts among the words of a paper that the report shows, as they are written, with where they stand."""
    if isinstance(value, str):
        yield place, value
    elif isinstance(value, dict | list):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            if key != "picture":
                yield from texts_of(entry, f"{place}.{key}")


def undefined(text, defined):
    """The words that stand in a text before they are defined; a definition is a word in bold, as `**word**`."""
    prose = re.sub(r"`[^`]*`", "X", text)
    undefined_words = []
    for word in defined:
        plural = re.sub("um$", "(?:um|a)", word) + "s?"
        first = re.search(rf"(?i)(\*\*)?\b{plural}\b(\*\*)?", prose)
        if first and not (first[1] and first[2]):
            undefined_words.append(word)
    return undefined_words


def typed_numbers(text, known=()):
    """The numbers of a text that are no quotes, none of `NOT_OURS` and not known, with what stands around them."""
    for pattern in NOT_OURS:
        text = re.sub(pattern, lambda match: "_" * len(match[0]), text)
    matches = [match for match in NUMBER.finditer(text) if not match[0].startswith("_")]
    return [text[max(0, m.start() - 25) : m.end() + 15].strip() for m in matches if value(m[0]) not in known]


def value(number):
    """A number of a text, to the digits that it may be rounded to."""
    return f"{float(number.replace(',', '')):.6g}"


def facts_of(slug):
    """The numbers that a paper prints, and its inputs with their sources, also in thousands and per cent."""
    files = [ROOT / "data" / "published" / f"{slug}.yaml", ROOT / "configs" / f"{slug}.yaml"]
    text = " ".join(path.read_text(encoding="utf-8") for path in files)
    text += " ".join(erratum.printed for erratum in catalogue(slug).errata)
    values = {float(number.replace(",", "")) for number in NUMBER.findall(text)}
    return {f"{of * factor:.6g}" for of in values for factor in (1, 1e3, 1e-3, 100, 0.01)}


@pytest.mark.parametrize("slug", SLUGS)
def test_claims_errata_and_questions_are_said_shortly(slug):
    """A claim in a line, an erratum in a title, the paper in a question: what the report shows closed."""
    paper = catalogue(slug)
    claims = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    missing = [claim.id for claim in claims if not claim.plain and claim.kind not in ("input", "context")]
    assert not missing
    assert all(erratum.title for erratum in paper.errata)
    assert paper.question.endswith("?")
    assert 2 <= len(paper.in_short) <= 4


def test_no_word_stands_before_its_definition():
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"(?ms)^```.*?^```$|<!--.*?-->|\]\([^)]*\)", "", page)
    assert undefined(text, words()) == []


@pytest.mark.parametrize("slug", SLUGS)
def test_texts_type_no_number_of_ours(slug):
    # What is printed may be told with its numbers; so may a plain form, which says what the paper claims.
    document = yaml.safe_load((ROOT / "src/marsedl/papers" / slug / "texts.yaml").read_text(encoding="utf-8"))
    ours = {place: text for place, text in texts_of(document) if not re.search(r"\.(printed|shows)$", place)}
    typed = {place: numbers for place, text in ours.items() if (numbers := typed_numbers(text, facts_of(slug)))}
    assert typed == {}


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("Flights need {acap:.0f} m/s^2, as Eq. 5 and Figs. 3 to 4 say of J2 (E12).", 0),
        ("Flights need 580.3 m/s.", 1),
        ("It is 12 % wider, not 49 %.", 2),
        ("It lies 4.67 km away, or 5,918 m, or 3.2e-5 of it.", 3),
        ("The 99th percentile lies within three standard errors.", 0),
    ],
)
def test_a_typed_number_is_found(text, count):
    assert len(typed_numbers(text)) == count


# ------------------------------------------------------------------------------------------------ pages of the report


def elements(page):
    """The text of every paragraph, item, cell and caption of a page."""
    page = re.sub(r"(?s)<(script|style|pre|svg|template)\b.*?</\1>", " ", page)
    page = re.sub(r"(?s)<code\b[^>]*>.*?</code>|<math\b.*?</math>", "X", page)
    pieces = re.split(
        r"</?(?:p|div|section|d[ltd]|ul|ol|li|h\d|t[rdh]|figcaption|caption|summary|small|details)\b[^>]*>", page
    )
    texts = (" ".join(html.unescape(re.sub(r"<[^>]+>", " ", text)).split()) for text in pieces)
    return [text for text in texts if text]


@pytest.mark.workflow
def test_no_word_of_the_report_stands_before_its_definition(copied):
    """Above their definitions, the first page uses none of the words."""
    main = copied.path("report/index.html").read_text(encoding="utf-8").partition("<main")[2]
    before, found, after = main.partition('<dl class="terms">')
    assert found
    assert [text for text in elements(before) if undefined(text, words())] == []
    assert [word for word in words() if f"<dt>{word.capitalize()}</dt>" not in after] == []
