"""How Sphinx makes the documentation: Markdown pages, the library's docstrings, the papers' errata."""

import os
import re
from importlib.metadata import version as version_of
from pkgutil import walk_packages

os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled functions are shown as what they are written as

import marsedl
from marsedl.papers import catalogue

project = "marsedl"
author = copyright = "The marsedl developers"
version = release = version_of("marsedl")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3
highlight_language = "none"  # of blocks that do not name theirs: commands and files
html_theme = "furo"
html_title = project
html_copy_source = False
html_show_copyright = False

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_preserve_defaults = True
# Words before a colon in "Returns" are taken for types, and several classes have a field of that name.
suppress_warnings = ["ref.python"]

_SECTION = re.compile(r"(?m)^(Args|Returns|Raises|Yields):$")
_GENERATED = re.compile(r"(?m)^<!-- (modules|errata): (\S+) -->$")


def modules(package):
    """Return a section for every public module of a package, with its public names."""
    paths = [f"{path}/{package.rpartition('.')[2]}" for path in marsedl.__path__]
    found = [module.name for module in walk_packages(paths, f"{package}.") if not module.ispkg]
    return "\n\n".join(f"## {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```" for name in sorted(found))


def errata(slug):
    """Return the errata of a paper's catalogue as a list."""
    rows = []
    for erratum in catalogue(slug).errata:
        texts = (erratum.printed, erratum.evidence, erratum.used)
        printed, evidence, used = (escaped(text, r"\*_<>[]|#") for text in texts)
        rows.append(f"- **{erratum.id}**, printed: {printed}\n\n  Evidence: {evidence}\n\n  Used here: {used}")
    return "\n\n".join(rows)


def escaped(text, characters):
    """Return text in which these characters mean themselves, but for what stands in backticks."""
    pieces = re.split(r"(`[^`]*`)", text)
    pattern = f"([{re.escape(characters)}])"
    return "".join(piece if piece.startswith("`") else re.sub(pattern, r"\\\1", piece) for piece in pieces)


def fill_page(app, page, source):
    """Put what is generated in its place: `<!-- modules: package -->`, `<!-- errata: slug -->`."""
    source[0] = _GENERATED.sub(lambda found: {"modules": modules, "errata": errata}[found[1]](found[2]), source[0])


def plain_docstring(app, what, name, thing, options, lines):
    """Let docstrings, which are plain text, pass through reStructuredText: formulas stay as they are set."""
    text = "\n".join(lines)
    start = _SECTION.search(text)
    body, sections = (text[: start.start()], text[start.start() :]) if start else (text, "")
    done = []
    for paragraph in re.split(r"\n\s*\n", body.strip("\n")):
        if paragraph.startswith("    "):
            done.append(f"::\n\n{paragraph}")
        else:  # hanging indents mean something in lists alone
            done.append(marked_up(paragraph if paragraph.startswith("- ") else re.sub(r"\n +", "\n", paragraph)))
    sections = re.sub(r"(?m)^(    (?:\w+, )+\w+,)\n +", r"\1 ", sections)  # several names on two lines
    lines[:] = [*"\n\n".join(done).splitlines(), "", *marked_up(sections).splitlines(), ""]


def marked_up(text):
    """Return plain text with names in backticks as reStructuredText."""
    return re.sub(r"`([^`]*)`", r"``\1``", escaped(text, "\\*|"))


def setup(app):
    """Connect the hooks; docstrings are taken before napoleon reads their sections."""
    app.connect("source-read", fill_page)
    app.connect("autodoc-process-docstring", plain_docstring, priority=400)
