"""Text with formulas and code as HTML: `$...$` is LaTeX and becomes MathML, what stands in backticks is code."""

import functools
import html
import re

from marsedl.replication.errors import InputError, shown

_PIECES = re.compile(r"`([^`]+)`|\$([^$]*)\$|(\$)|(?:(?!`[^`]+`)[^$])+")
# Powers behind a letter or a bracket; what stands before them in the pattern is passed over: code, formulas and tags.
_POWERS = re.compile(r"<(script|style|code|pre|math)\b.*?</\1>|<[^>]*>|(?<=[A-Za-z)])\^(-?\d+)(?!\w|\.\d)", re.DOTALL)
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# What the converter passes through or writes in names that no browser knows.
_REFUSED = {
    r"\!": "no browser has negative space; leave it out",
    r"\mathrm{": r"it takes words apart; write \text{...}",
    "&": "there are no tables here; write it in words",
}


@functools.cache
def mathml(latex: str) -> str:
    r"""Convert a formula such as `p_\text{f} = 0.1` to MathML; raises InputError if it is not understood."""
    from latex2mathml.converter import convert  # only needed where a page is written

    for piece, remedy in _REFUSED.items():
        if piece in latex:
            raise InputError(f"formula {shown(latex)}: {piece} cannot be used: {remedy}")
    try:
        element = convert(latex) if latex.strip() and latex.count("{") == latex.count("}") else "\\"
    except Exception as error:  # its errors have no base of their own
        raise InputError(f"formula {shown(latex)}: it is not complete ({type(error).__name__})") from error
    if "\\" in element:  # an unknown command is passed through as it stands
        raise InputError(f"formula {shown(latex)}: an unknown command, or braces that do not match")
    return element.replace(' xmlns="http://www.w3.org/1998/Math/MathML" display="inline"', "")


def with_formulas(text: str) -> str:
    """Return a text as HTML; raises InputError for a formula that is not understood or not closed."""

    def piece(match: re.Match) -> str:
        code, latex, alone = match.groups()
        if alone:
            raise InputError(f"text {shown(text)}: a dollar sign without its other one; formulas stand between two")
        if latex is not None:
            return mathml(latex)
        return html.escape(match[0]) if code is None else f"<code>{html.escape(code)}</code>"

    return _PIECES.sub(piece, text)


def with_raised_powers(page: str) -> str:
    """Return a page of HTML with powers of units and symbols raised: `m/s^2` as m/s²; code and formulas stay."""
    return _POWERS.sub(lambda match: match[0] if match[2] is None else match[2].translate(_RAISED), page)


def without_markup(text: str) -> str:
    """Return a text for places that hold no HTML, such as a search index: formulas as their signs, code as it is."""
    return html.unescape(re.sub(r"<[^>]*>", "", with_formulas(text)))
