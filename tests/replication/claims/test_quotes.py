"""Numbers in texts: by claim, reading, entry, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.claim import Claim, Margin, Result
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.quotes import (
    Quotes,
    accept,
    accepted,
    numbers_of,
    quotes_in,
    with_numbers,
    with_numbers_of_a_claim,
)
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import Erratum, Paper, Product

ROOT = Path(__file__).parents[3]


MARGIN = Margin(value=0.25, measure="it", limit=1.0, unit="", distance=0.75, scale="limits", standard_error=0.0)


def result(value, standard_error=None):
    return Result(value=value, standard_error=standard_error, verdict="holds", margin=MARGIN, numbers={"spread": 2.07})


def claim(name, printed, **readings):
    of_default = {"verdict": "holds", "reading": "corrected"}
    return Claim(paper="toy", id=name, kind="monte_carlo", printed=printed, readings=readings, **of_default)


ROWS = [
    claim("mass", 1346, corrected=result(1349.444), euler=result(1355.02)),
    claim("mean", [100.1, 49.8], corrected=result([100.0, 50.25], [0.5, 0.125]), euler=result(None)),
    claim("holds", True, corrected=result(True)),
]
READINGS = ("corrected", "euler", "printed")
QUOTES = Quotes(ROWS, READINGS)


def fill(text, quotes=QUOTES):
    return with_numbers(Paper(*("toy", "", "", ""), in_short=(text,)), quotes).in_short[0]


@pytest.mark.parametrize(
    ("text", "filled"),
    [
        ("No numbers.", "No numbers."),
        ("{mass:.1f} kg", "1349.4 kg"),
        ("{euler.mass:.1f}, not {mass.printed:,} kg", "1355.0, not 1,346 kg"),
        ("{mean[1]:.2f} +- {mean.standard_error[1]:.3f}", "50.25 +- 0.125"),
        ("{mass.spread:.2f}, {euler.mass.spread:.1f} and {holds.margin:.2f}", "2.07, 2.1 and 0.25"),
        ("{holds.margin:.1%} or {holds.margin:+.0%}", "25.0 % or +25 %"),
        ("rho_{{k+1}} of {mass:g}", "rho_{k+1} of 1349.44"),
        ("{printed.mass:.1f} and {euler.mean[0]:.1f}", "– and –"),  # not built, and not evaluated
    ],
)
def test_a_text_has_its_numbers(text, filled):
    assert fill(text) == filled


def test_a_text_about_a_reading_quotes_that_reading():
    assert fill("{mass:.1f}, {corrected.mass:.1f}", Quotes(ROWS, READINGS, "euler")) == "1355.0, 1349.4"


def test_before_anything_is_judged_numbers_are_absent_and_readings_are_known():
    quotes = Quotes(None, READINGS)
    assert fill("{anything:.1f} kg, {euler.mass.standard_error[0]:.1f}", quotes) == "– kg, –"
    with pytest.raises(InputError, match="in_short: there is no 'standard_error' to quote"):
        fill("{eulr.mass.standard_error}", quotes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{mas:.1f}", "toy: in_short: there is no 'mas' to quote; did you mean 'mass'?"),
        ("{eular.mass:.1f}", "there is no 'eular' to quote; did you mean 'euler'?"),
        ("{euler.corrected.mass}", "there is no 'corrected' to quote; valid names: holds, mass, mean"),
        ("{mass.printed.value}", "there is no 'value' to quote"),
        ("{mass.spred}", "there is no 'spred' to quote; did you mean 'spread'?"),
        ("{mean[2]:.1f}", "there is no entry 2"),
        ("{mass[0]:.1f}", "there is no entry 0"),
        ("{mean}", "is not a number"),
        ("{holds}", "True is not a number"),
        ("{mass:.1q}", "Unknown format code 'q'"),
        ("{mass", "expected '}'"),
        ("mass}", "Single '}'"),
    ],
)
def test_what_is_no_number_is_refused(text, message):
    with pytest.raises(InputError) as error:
        fill(text)
    assert message in str(error.value)


@pytest.mark.parametrize("text", ["{mass!r}", "{}", "rho_{k+} is", "{mass - mean}", "{mass[first]}"])
def test_what_names_no_claim_is_refused_as_it_is_read(text):
    with pytest.raises(ValueError, match=r"names no claim; write \{claim:.2f\}"):
        quotes_in(text)


def test_a_number_that_only_another_reading_has_is_a_dash():
    rows = [claim("mass", 1, corrected=result(1.0), euler=Result(value=2.0, verdict="holds"))]
    assert fill("{mass.spread}, {euler.mass.spread:.2f}", Quotes(rows, READINGS)) == "2.07, –"


def test_the_reason_of_a_claim_leaves_it_out():
    numbers = {"corrected": {"value": [1.0, 2.5], "spread": 0.25}, "euler": {"value": 3.0}, "coarse": None}
    text = with_numbers_of_a_claim(
        "{value[1]:.2f}, {spread:.0%}, {euler.value:g}, {coarse.spread:.1f}", numbers, "corrected"
    )
    assert text == "2.50, 25 %, 3, –"
    assert with_numbers_of_a_claim("{depth:.1f}, {euler.value:g}", numbers, "coarse") == "–, 3"
    for text, message in (("{spred}", "did you mean 'spread'"), ("{euler.spread}", "no 'spread'")):
        with pytest.raises(ValueError, match=message):
            with_numbers_of_a_claim(text, numbers, "corrected")
    with pytest.raises(ValueError, match="'euler' is the name of a reading and of a number"):
        with_numbers_of_a_claim("", {**numbers, "corrected": {"euler": 1.0}}, "corrected")


def test_all_texts_of_a_paper_are_filled_and_a_wrong_one_is_named():
    paper = Paper(
        *("toy", "", "", ""),
        figures={"fig01": Product("{mass:.0f} kg")},
        tables={"tab01": Product("{euler.mass:.0f} kg")},
        described={"fig01": "{mass.printed} kg"},
        errata=(Erratum("E1", "{mass.printed} kg", "{mass:.1f} kg", "{mass:.2f} kg"),),
    )
    filled = with_numbers(paper, QUOTES)
    assert (filled.figures["fig01"].caption, filled.tables["tab01"].caption) == ("1349 kg", "1355 kg")
    assert filled.described == {"fig01": "1346 kg"}
    assert filled.errata == (Erratum("E1", "1346 kg", "1349.4 kg", "1349.44 kg"),)
    wrong = replace(paper, errata=(Erratum("E1", "", "{mas}", ""),))
    with pytest.raises(InputError, match=r"^toy: errata\.E1\.evidence: .*did you mean 'mass'"):
        with_numbers(wrong, QUOTES)


def test_the_numbers_of_an_accepted_build_are_kept_for_texts_that_have_no_build(tmp_path):
    paper = Paper(*("toy", "", "", ""), figures={"fig01": Product("{mass:.0f} kg, {mean[1]} m")})
    path = accept(tmp_path, {"toy": (paper, QUOTES)})
    assert path.read_text(encoding="utf-8").count(":.0f") == 1
    assert with_numbers(paper, accepted(tmp_path, "toy")).figures["fig01"].caption == "1349 kg, 50.25 m"
    later = replace(paper, figures={"fig01": Product("{mass:.1f} kg")})
    missing = r"^toy: figures\.fig01\.caption: .*has no \{mass:\.1f\}; run 'marsedl accept'"
    with pytest.raises(InputError, match=missing):
        with_numbers(later, accepted(tmp_path, "toy"))
    assert fill("No numbers.", accepted(tmp_path, "another")) == "No numbers."


@pytest.mark.parametrize("slug", SLUGS)
def test_texts_quote_claims_and_readings_that_exist_and_their_numbers_are_committed(slug):
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    readings = list(read_yaml(ROOT / "configs" / f"{slug}.yaml")["readings"])
    rows = [claim(printed.id, printed.printed) for printed in published]
    quoted = numbers_of(catalogue(slug), Quotes(rows, readings))
    assert list(accepted(ROOT, slug)) == list(quoted)
