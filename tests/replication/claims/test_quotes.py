"""Numbers in texts: by claim, reading, entry, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.claim import Claim, Margin, Result
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.quotes import Quotes, accept, by_id, committed, numbers_of, with_numbers
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import configured_readings
from marsedl.replication.pipeline.catalogue import Erratum, Paper, Product

ROOT = Path(__file__).parents[3]


PARTS = {"measure": "it", "limit": 1.0, "unit": "", "distance": 0.75, "scale": "limits", "standard_error": 0.0}
MARGIN = Margin(value=0.25, **PARTS)


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
QUOTES = Quotes(by_id(ROWS), READINGS)


@pytest.mark.parametrize(
    ("text", "filled"),
    [
        ("No numbers.", "No numbers."),
        ("{mass:.1f} kg", "1349.4 kg"),
        ("{euler.mass:.1f}, not {mass.printed:,} kg", "1355.0, not 1,346 kg"),
        ("{mean[1]:.2f} +- {mean.standard_error[1]:.3f}", "50.25 +- 0.125"),
        ("{euler.mass - mass:.1f} and {-(mass - mass.printed) * 1e3 / 2:.0f}", "5.6 and -1722"),
        ("{mass.spread:.2f}, {euler.mass.spread:.1f} and {holds.margin:.2f}", "2.07, 2.1 and 0.25"),
        ("rho_{{k+1}} of {mass:g}", "rho_{k+1} of 1349.44"),
        ("{printed.mass:.1f} and {euler.mean[0]:.1f}", "– and –"),  # not built, and not evaluated
    ],
)
def test_a_text_has_its_numbers(text, filled):
    assert QUOTES.fill(text, "here") == filled


def test_a_text_about_a_reading_quotes_that_reading():
    assert Quotes(by_id(ROWS), READINGS, "euler").fill("{mass:.1f}, {corrected.mass:.1f}", "here") == "1355.0, 1349.4"


def test_before_anything_is_judged_numbers_are_absent_and_readings_are_known():
    quotes = Quotes(by_id(None), READINGS)
    assert quotes.fill("{anything:.1f} kg", "here") == "– kg"
    with pytest.raises(InputError, match="there is no reading 'eulr'; did you mean 'euler'"):
        quotes.fill("{eulr.mass.standard_error}", "here")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{mas:.1f}", "here: {mas}: there is no claim 'mas'; did you mean 'mass'?"),
        ("{eular.mass:.1f}", "there is no reading 'eular'; did you mean 'euler'?"),
        ("{euler.corrected.mass}", "there is no claim 'corrected'"),
        ("{mass.printed.value}", "there is no reading 'mass'"),
        ("{mass.spred}", "claim 'mass' has no number 'spred'; did you mean 'spread'?"),
        ("{mean[2]:.1f}", "{mean[2]}: there is no entry 2"),
        ("{mass[0]:.1f}", "{mass[0]}: there is no entry 0"),
        ("{mean}", "is not a number"),
        ("{holds}", "True is not a number"),
        ("{mass:.1q}", "{mass}: "),
        ("{mass / (mass - mass)}", "division"),
        ("{mass!r}", "a quote names no claim; write {claim:.2f}"),
        ("{}", "a quote names no claim; write {claim:.2f}"),
        ("rho_{k+} is", "{k+} is not a number of a claim; write {claim:.2f}"),
        ("{abs(mass)}", "{abs(mass)} is not a number of a claim"),
        ("{mass", "expected '}'"),
        ("mass}", "Single '}'"),
    ],
)
def test_what_is_no_number_is_refused(text, message):
    with pytest.raises(InputError) as error:
        QUOTES.fill(text, "here")
    assert message in str(error.value)


def test_all_texts_of_a_paper_are_filled_and_a_wrong_one_is_named():
    paper = Paper(
        *("toy", "", "", ""),
        figures={"fig01": Product("{mass:.0f} kg")},
        tables={"tab01": Product("{euler.mass:.0f} kg")},
        summaries={"readings": "{mean[0]:.0f} m"},
        described={"fig01": "{mass.printed} kg"},
        errata=(Erratum("E1", "{mass.printed} kg", "{mass:.1f} kg", "{mass:.2f} kg"),),
    )
    filled = with_numbers(paper, QUOTES)
    assert (filled.figures["fig01"].caption, filled.tables["tab01"].caption) == ("1349 kg", "1355 kg")
    assert (filled.summaries, filled.described) == ({"readings": "100 m"}, {"fig01": "1346 kg"})
    assert filled.errata == (Erratum("E1", "1346 kg", "1349.4 kg", "1349.44 kg"),)
    wrong = replace(paper, errata=(Erratum("E1", "", "{mas}", ""),))
    with pytest.raises(InputError, match=r"^toy: evidence of E1: .*did you mean 'mass'"):
        with_numbers(wrong, QUOTES)


def test_the_numbers_of_an_accepted_build_are_kept_for_texts_that_have_no_build(tmp_path):
    paper = Paper(*("toy", "", "", ""), figures={"fig01": Product("{mass:.0f} kg, {mean[1] - mean[0]} m")})
    path = accept(tmp_path, {"toy": (paper, QUOTES)})
    assert path.read_text(encoding="utf-8").count(":.0f") == 1
    assert with_numbers(paper, committed(tmp_path, "toy")).figures["fig01"].caption == "1349 kg, -49.75 m"
    later = replace(paper, figures={"fig01": Product("{mass:.1f} kg")})
    with pytest.raises(InputError, match=r"^toy: caption of fig01: .*has no \{mass:\.1f\}; run 'marsedl accept'"):
        with_numbers(later, committed(tmp_path, "toy"))
    assert committed(tmp_path, "another").fill("No numbers.", "here") == "No numbers."
    path.write_text("[]")
    with pytest.raises(InputError, match=r"quotes\.json: cannot be read"):
        committed(tmp_path, "toy")


@pytest.mark.parametrize("slug", SLUGS)
def test_texts_quote_claims_and_readings_that_exist_and_their_numbers_are_committed(slug):
    published = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
    readings = configured_readings(ROOT / "configs" / f"{slug}.yaml")
    rows = by_id(claim(printed.id, printed.printed) for printed in published)
    quoted = numbers_of(catalogue(slug), Quotes(rows, readings))
    assert list(committed(ROOT, slug).numbers) == list(quoted)
