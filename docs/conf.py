"""How Sphinx makes the documentation: Markdown pages, notebooks, docstrings, formulas, the papers' errata."""

import logging
import os
import re
import shutil
import tempfile
from pathlib import Path
from pkgutil import walk_packages

from docutils import nodes
from numba import config
from sphinx.util import logging as sphinx_logging

import marsedl
from marsedl.papers import catalogue
from marsedl.replication.claims.quotes import accepted, with_numbers
from marsedl.replication.errors import InputError
from marsedl.replication.report.formulas import mathml
from marsedl.replication.report.front_page import words

config.DISABLE_JIT = True  # compiled functions are shown as what they are written as; notebooks compile theirs

project = "marsedl"
author = copyright = "The marsedl developers"
version = release = marsedl.__version__

ROOT = Path(__file__).parents[1]

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"  # in the pages themselves: no script, no network
highlight_language = "none"  # of blocks that do not name theirs: commands and files
html_theme = "furo"
html_title = project
html_copy_source = False
html_show_copyright = False

# Notebooks are run as they are read; those that need a build only where there is one.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
logging.getLogger("traitlets").setLevel(logging.WARNING)  # not which notebook is run
# A profile of their own, so that nobody's start-up files run before them. Kernels listen on this machine alone.
_PROFILE = tempfile.TemporaryDirectory()
os.environ["IPYTHONDIR"] = _PROFILE.name
_SETTINGS = Path(_PROFILE.name, "profile_default", "ipython_kernel_config.py")
_SETTINGS.parent.mkdir()
_SETTINGS.write_text("get_config().Application.log_level = 40  # errors alone\n")
if not (ROOT / "report" / "claims.json").exists():
    nb_execution_excludepatterns = ["notebooks/verdicts_as_data.md", "notebooks/an_ensemble.md"]

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_preserve_defaults = True
# Words before a colon in "Returns" are taken for types, and several classes have a field of that name.
suppress_warnings = ["ref.python"]

_SECTION = re.compile(r"(?m)^(Args|Returns|Raises|Yields):$")
_GENERATED = re.compile(r"(?m)^<!-- (modules|errata|words): (\S+) -->$")


MODULES = ROOT / "docs" / "reference" / "modules"  # a page for each, written before the pages are read


def names_of_modules(package):
    """Return the names of all public modules of a package; of a module its own."""
    paths = [f"{path}/{package.rpartition('.')[2]}" for path in marsedl.__path__]
    return sorted(module.name for module in walk_packages(paths, f"{package}.") if not module.ispkg) or [package]


def modules(package):
    """Return the list of a package's modules, with links to their pages."""
    return "\n".join(["```{toctree}", ":maxdepth: 1", "", *(f"modules/{n}" for n in names_of_modules(package)), "```"])


def write_pages_of_modules(app):
    """Write a page for every module of the packages that the reference lists."""
    shutil.rmtree(MODULES, ignore_errors=True)
    MODULES.mkdir()
    for page in sorted(MODULES.parent.glob("*.md")):
        for found in _GENERATED.finditer(page.read_text(encoding="utf-8")):
            for name in names_of_modules(found[2]) if found[1] == "modules" else ():
                (MODULES / f"{name}.md").write_text(f"# {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```\n")


def only_described(app, what, name, thing, skip, options):
    """Leave out fields of named tuples, which the docstring of their class describes."""
    return True if type(thing).__name__ == "_tuplegetter" else None


def errata(slug):
    """Return the errata of a paper's catalogue as a list."""
    rows = []
    for erratum in with_numbers(catalogue(slug), accepted(ROOT, slug)).errata:
        texts = (erratum.printed, erratum.evidence, erratum.used)
        printed, evidence, used = (escaped(text, r"\*_<>[]|#") for text in texts)
        rows.append(f"- **{erratum.id}**, printed: {printed}\n\n  Evidence: {evidence}\n\n  Used here: {used}")
    return "\n\n".join(rows)


def defined(_):
    """Return the glossary of the words that the report and the README define."""
    entries = "\n\n".join(f"{word}\n  {escaped(meaning, r'*_<>[]|#')}" for word, meaning in words().items())
    return f"```{{glossary}}\n{entries}\n```"


def escaped(text, characters):
    """Return text in which these characters mean themselves, but for code in backticks and formulas in dollars."""
    pieces = re.split(r"(`[^`]*`|\$[^$]*\$)", text)
    pattern = f"([{re.escape(characters)}])"
    return "".join(piece if piece[:1] in ("`", "$") else re.sub(pattern, r"\\\1", piece) for piece in pieces)


def fill_page(app, page, source):
    """Put what is generated in its place: `<!-- modules: package -->`, `<!-- errata: slug -->` and so on."""
    writers = {"modules": modules, "errata": errata, "words": defined}
    source[0] = _GENERATED.sub(lambda found: writers[found[1]](found[2]), source[0])


def plain_docstring(app, what, name, thing, options, lines):
    """Let docstrings, which are plain text, pass through reStructuredText: formulas stay as they are set."""
    text = "\n".join(lines)
    start = _SECTION.search(text)
    body, sections = (text[: start.start()], text[start.start() :]) if start else (text, "")
    done = []
    for paragraph in re.split(r"\n\s*\n", body.strip("\n")):
        if re.fullmatch(r"(?:    \$[^$]+\$\n?)+", paragraph):  # displayed formulas
            formulas = (" ".join(latex.split()) for latex in re.findall(r"\$([^$]+)\$", paragraph))
            done.append("\n".join([".. math::", "", *(f"   {latex}" for latex in formulas)]))
        elif paragraph.startswith("    "):
            done.append(f"::\n\n{paragraph}")
        else:  # hanging indents mean something in lists alone
            done.append(marked_up(paragraph if paragraph.startswith("- ") else re.sub(r"\n +", "\n", paragraph)))
    sections = re.sub(r"(?m)^(    (?:\w+, )+\w+,)\n +", r"\1 ", sections)  # several names on two lines
    lines[:] = [*"\n\n".join(done).splitlines(), "", *marked_up(sections).splitlines(), ""]


def marked_up(text):
    """Return plain text with names in backticks and formulas in dollars as reStructuredText."""
    return re.sub(
        r"`([^`]*)`|\$([^$]*)\$",
        lambda found: f"``{found[1]}``" if found[1] is not None else f":math:`{found[2]}`",
        escaped(text, "\\*|"),
    )


def formula(writer, node):
    """Write a formula as MathML; of a displayed one, every line is a formula of its own."""
    try:
        if isinstance(node, nodes.math):
            writer.body.append(mathml(node.astext()))
        else:
            lines = (mathml(line.strip()) for line in node.astext().splitlines() if line.strip())
            blocks = "".join(line.replace("<math", '<math display="block"', 1) for line in lines)
            writer.body.append(f'<div class="formula" style="overflow: auto hidden; padding: 0.3em 0">{blocks}</div>')
    except InputError as error:
        sphinx_logging.getLogger(__name__).warning(str(error), location=node)
    raise nodes.SkipNode


def setup(app):
    """Connect the hooks and the writer of formulas; docstrings are taken before napoleon reads their sections."""
    app.add_html_math_renderer("mathml", (formula, None), (formula, None))
    app.connect("builder-inited", write_pages_of_modules)
    app.connect("autodoc-skip-member", only_described)
    app.connect("source-read", fill_page)
    app.connect("autodoc-process-docstring", plain_docstring, priority=400)
