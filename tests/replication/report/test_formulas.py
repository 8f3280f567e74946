"""Formulas and code in texts."""

import pytest

from marsedl.replication.errors import InputError
from marsedl.replication.report.formulas import mathml, with_formulas, with_raised_powers, without_markup


def test_a_formula_becomes_mathml_and_code_stays_code():
    text = with_formulas(r"As $p_\text{f} < 1$ says, `a $HOME <b>` & more")
    assert text.startswith("As <math><mrow><msub><mi>p</mi><mtext>f</mtext></msub><mo>&#x0003C;</mo><mn>1</mn>")
    assert text.endswith("says, <code>a $HOME &lt;b&gt;</code> &amp; more")
    assert "\\" not in text


def test_an_index_stands_beside_its_bar_and_words_stay_whole():
    assert mathml(r"\bar{x}_{k+1}").startswith("<math><mrow><msub><mover>")
    assert "<mtext>trans</mtext>" in mathml(r"h_{\text{trans}}")


def test_a_text_without_markup_has_the_signs_of_its_formulas():
    assert without_markup(r"cost $\Delta v$ of `fly` & <land>") == "cost Δv of fly & <land>"


@pytest.mark.parametrize(
    ("latex", "message"),
    [
        (r"\unknown{x}", "an unknown command"),
        (r"a \! b", "no browser has negative space"),
        (r"\mathrm{trans}", r"write \text"),
        ("a & b", "no tables"),
        (r"\frac{a", "braces that do not match"),
        ("x{", "braces that do not match"),
        ("x_", "it is not complete"),
        ("", "unknown command"),
    ],
)
def test_latex_that_is_not_understood_is_refused(latex, message):
    with pytest.raises(InputError, match=message.replace("\\", "\\\\")):
        with_formulas(f"see ${latex}$")


def test_powers_are_raised_where_readers_see_them():
    page = '<td title="m^2">3 m^2, kg/m^-3, (a)^10 and 2^k</td><code>a^2</code><math><mi>x^2</mi></math><p>x^2.5</p>'
    raised = '<td title="m^2">3 m², kg/m⁻³, (a)¹⁰ and 2^k</td><code>a^2</code><math><mi>x^2</mi></math><p>x^2.5</p>'
    assert with_raised_powers(page) == raised
