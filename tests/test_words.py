"""What readers read: short sentences, no word before its definition, and no typed number of ours.

The pages are the README, the front page of the documentation, the help of the command, and of every paper the texts
that the report shows, and the templates of its pages.
"""

import argparse
import html
import re
from pathlib import Path
from statistics import mean

import pytest
import yaml

from marsedl import cli
from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claiming import claims_of
from marsedl.replication.claims import load_published
from marsedl.replication.words import words

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?(?!\w)")
LONGEST, MEAN = 25, 16  # words of a sentence at most, and on average below
PAGES = ["README.md", "CONTRIBUTING.md", "docs/index.md", "docs/gate.md"]
# Full stops that end no sentence.
ABBREVIATIONS = r"\b(?:Figs?|Eqs?|Secs?|Tab|No|Nos|Ref|Refs|vs|cf|al|Prop|Alg|App|[A-Z])\."
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


def sentences(text):
    """The sentences of a text; code, formulas and quoted numbers count as one word."""
    text = re.sub(r"`[^`]*`|\$[^$]*\$|\{[^}]*\}", "x", text)
    text = re.sub(ABBREVIATIONS, lambda match: match[0][:-1], text)
    parts = re.split(r"(?<=[.!?])[)”\"]?\s+(?=[A-Z0-9“(\"`])|\n\s*\n|:\s*\n", text)
    return [part for part in (" ".join(part.split()) for part in parts) if length(part)]


def length(sentence):
    """The number of words; a number with its unit counts as written."""
    return len(re.findall(r"[^\s]*\w[^\s]*", sentence))


def paragraphs(markdown):
    """The paragraphs of a page, items of lists and cells of tables, without code, pictures and addresses."""
    text = re.sub(r"(?ms)^```.*?^```$|<!--.*?-->", "\n\n", markdown)
    text = re.sub(r"\[!\[[^]]*\]\([^)]*\)\]\([^)]*\)|!\[[^]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(?m)^(#+ .*|\|[-| ]+\|)$", "\n", text)
    text = re.sub(r"(?m)^(?=- |\d+\. |\|)", "\n", text)
    blocks = [block for block in re.split(r"\n\s*\n", text.replace("|", "\n\n")) if block.strip()]
    return [" ".join(re.sub(r"^\s*(- |\d+\. )", "", block).replace("*", "").split()) for block in blocks]


def too_long(texts):
    """The sentences that are too long, and the mean length if that is."""
    length_of_sentence = {sentence: length(sentence) for text in texts for sentence in sentences(text)}
    assert length_of_sentence
    problems = [f"{count} words: {sentence}" for sentence, count in length_of_sentence.items() if count > LONGEST]
    if len(length_of_sentence) > 1 and mean(length_of_sentence.values()) >= MEAN:
        problems.append(f"{mean(length_of_sentence.values()):.1f} words on average")
    return problems


def texts_of(slug):
    """The texts of a paper that the report shows, as they are written, by where they stand."""
    document = yaml.safe_load((ROOT / "src/marsedl/papers" / slug / "texts.yaml").read_text(encoding="utf-8"))
    texts = {}

    def visit(value, place):
        if isinstance(value, dict):
            for key, entry in value.items():
                if key not in ("kept_by", "picture"):
                    visit(entry, (*place, str(key)))
        elif isinstance(value, list):
            for number, entry in enumerate(value):
                visit(entry, (*place, str(number)))
        elif isinstance(value, str):
            texts[".".join(place)] = value

    visit(document, ("texts",))
    return texts


def printed_texts_of(slug):
    """What a paper prints, in the words of its claims, and what stands beside them."""
    claims = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    return {
        f"{claim.id}.{key}": getattr(claim, key)
        for claim in claims
        for key in ("quantity", "note", "plain")
        if getattr(claim, key)
    }


def reasons_of(slug):
    """The reasons that claims of a paper declare, with the numbers that they quote by name."""
    declarations = claims_of(slug).declarations
    return {f"{name}.reason": of.reason for name, of in declarations.items() if of.reason}


def help_texts():
    """The sentences that the command prints for help."""
    texts = []

    def visit(parser):
        texts.extend(filter(None, (parser.description, parser.epilog)))
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for command in action.choices.values():
                    visit(command)
            elif action.help:
                texts.append(action.help)

    visit(cli.command_line())
    return texts


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


@pytest.mark.parametrize("page", PAGES)
def test_sentences_of_the_pages_are_short(page):
    assert too_long(paragraphs((ROOT / page).read_text(encoding="utf-8"))) == []


def test_sentences_of_the_help_are_short():
    assert too_long(help_texts()) == []


@pytest.mark.parametrize("slug", SLUGS)
@pytest.mark.parametrize("kind", [texts_of, printed_texts_of, reasons_of], ids=lambda kind: kind.__name__)
def test_sentences_of_the_report_are_short(slug, kind):
    assert too_long(kind(slug).values()) == []


@pytest.mark.parametrize("slug", SLUGS)
def test_claims_errata_and_questions_are_said_shortly(slug):
    """A claim in a line, an erratum in a title, the paper in a question: what the report shows closed."""
    paper = catalogue(slug)
    claims = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    missing = [claim.id for claim in claims if not claim.plain and claim.kind not in ("input", "context")]
    assert not missing
    assert not [erratum.id for erratum in paper.errata if not 1 <= length(erratum.title) <= 8]
    assert sentences(paper.question) == [paper.question]
    assert paper.question.endswith("?")
    assert 2 <= len(paper.in_short) <= 4


@pytest.mark.parametrize("page", ["README.md"])
def test_no_word_stands_before_its_definition(page):
    text = re.sub(r"(?ms)^```.*?^```$|<!--.*?-->|\]\([^)]*\)", "", (ROOT / page).read_text(encoding="utf-8"))
    assert undefined(text, words()) == []


@pytest.mark.parametrize("slug", SLUGS)
def test_texts_type_no_number_of_ours(slug):
    # What is printed may be told with its numbers; so may a plain form, which says what the paper claims.
    ours = {place: text for place, text in texts_of(slug).items() if not re.search(r"\.(printed|shows)$", place)}
    typed = {place: numbers for place, text in ours.items() if (numbers := typed_numbers(text, facts_of(slug)))}
    assert typed == {}


def test_words_are_defined_in_one_short_sentence_each():
    assert len(words()) == 6
    for word, meaning in words().items():
        assert len(sentences(meaning)) == 1, word
        assert length(meaning) <= LONGEST, word


# ------------------------------------------------------------------------------------------------------ the rules bite


def test_a_long_sentence_is_found_and_a_full_stop_of_an_abbreviation_ends_none():
    short = "The law of Fig. 3 and Eq. 4 in Sec. V.B holds. It is short."
    assert [length(sentence) for sentence in sentences(short)] == [12, 3]
    assert too_long([short]) == []
    assert too_long([" ".join(["word"] * (LONGEST + 1)) + "."])[0].startswith(f"{LONGEST + 1} words")


def test_a_word_before_its_definition_is_found():
    assert undefined("A reading is x. A **reading** is a set.", ["reading"]) == ["reading"]
    assert undefined("A **reading** is a set. Readings and errata.", ["reading", "erratum"]) == ["erratum"]
    assert undefined("Run `reading`. **Reading**: a set.", ["reading"]) == []


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


def test_elements_of_a_page_are_its_texts():
    page = "<p>One <code>a.b</code> two.</p><script>var x;</script><ul><li>Three &amp; four</li></ul>"
    assert elements(page) == ["One X two.", "Three & four"]


def test_sentences_of_the_pages_of_the_report_are_short():
    """What the templates say themselves; texts and reasons that they show are tested where they are written."""
    folder = ROOT / "src" / "marsedl" / "replication" / "templates"
    pages = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.html.j2"))]
    assert len(pages) > 5
    # What is filled in counts as a word, what is repeated or chosen as an end.
    texts = [re.sub(r"(?s)\{%.*?%\}|\{#.*?#\}", "<p>", re.sub(r"(?s)\{\{.*?\}\}", "x", page)) for page in pages]
    assert too_long([text for page in texts for text in elements(page)]) == []


@pytest.mark.workflow
@pytest.mark.parametrize("page", ["index", *SLUGS])
def test_no_word_of_the_report_stands_before_its_definition(page, copied):
    """Above the definitions of a page, its main part uses none of the words."""
    main = (copied.path("report") / f"{page}.html").read_text(encoding="utf-8").partition("<main")[2]
    before, found, after = main.partition('<dl class="terms">')
    assert found
    assert [text for text in elements(before) if undefined(text, words())] == []
    assert [word for word in words() if f"<dt>{word.capitalize()}</dt>" not in after] == []
