"""Fingerprints of code: which definitions a function reaches, a digest of them, and which inputs they read.

Snakemake sees an edited script, but not an edited module that the script imports. A fingerprint in a rule's params
closes the gap: an edit of shared physics reruns its users, an edit of its neighbour in the same file or of a comment
reruns nothing. A function reaches

- every definition of its module (function, class, assignment, import) that it names: in its body, decorators, default
  arguments and annotations, but for names of its parameters; what these name in turn; and the same in other modules,
  through absolute imports, also inside functions and through re-exports. A module passed on as an object counts whole;
- what the modules of these, and their packages, do at import (`np.seterr(...)`, `TABLE["x"] = f`, `if`, loops).

Of all inputs of a paper, `given: Inputs`, a function reaches the sections alone that it names, as in `given.vehicle`.

Names in strings cannot be seen, nor functions that are reached only because their decorator entered them into a table,
nor what a module does at import if none of its names is used. The machinery around the science, `MACHINERY`, which
loads, saves and reports, does not count: `recipes.FORMAT` stands for it.

Only the standard library is imported here, because the Snakefile calls this on every run.
"""

import ast
import contextlib
import copy
import hashlib
import json
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import InputError, MarsedlError, nearest
from marsedl.replication.files import write_text

PACKAGE = "marsedl"
SOURCE_ROOT = Path(__file__).parents[3]
MACHINERY = frozenset(
    f"{PACKAGE}.replication.{name}"
    for name in (
        "errors",
        "files",
        "terminal",
        "records.fields",
        "records.store",
        "records.recipes",
        "records.differences",
        "pipeline.fingerprints",
        "pipeline.kernel_cache",
        "pipeline.numerics",
        "pipeline.libraries",
        "pipeline.products",
        "pipeline.sharing",
        "pipeline.staleness",
        "pipeline.runner",
        "pipeline.jobs",
    )
)
# What is said of a claim and measures nothing: by `claim(...)`, beside the reason; and what turns verdicts.
SAID = ("errata", "choices", "close", "by_construction", "counterexample")
SAID_IN = f"{PACKAGE}.replication.claims.counterexamples"
AT_IMPORT = "(at import)"  # the name of statements that act when their module is imported

Place = tuple[str, str]  # a module, and a dotted name in it; no name: the whole module, or a library


class Module(NamedTuple):
    """A source file, without docstrings."""

    functions: dict[str, dict]  # what they declare
    definitions: dict[str, list[ast.stmt]]
    imports: dict[str, list[str]]  # the absolute dotted names that a name is bound to


NOTHING = Module({}, {}, {})


class Fingerprints:
    """The fingerprints of a source folder; `save` keeps them in a file until a source file or a script changes.

    An entry is a function, "package.module:function", or a whole script of the workflow, "stage.py".
    Methods raise InputError for an entry that does not exist, and MarsedlError for a file that is not valid Python.
    """

    def __init__(self, memory: Path, source_root: Path, scripts: Path):
        """Take the file that remembers, the folder of the package and that of the scripts."""
        self._memory, self._root, self._scripts = memory, source_root, scripts
        self._module = cache(self._read_module)
        self._behind: dict[tuple[Place, bool], list[Place]] = {}
        self._key, self._known = self._key_now(), {}
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError):  # nothing remembered that can be used
            self._known = dict(json.loads(memory.read_text(encoding="utf-8"))[self._key])
        self._saved = len(self._known)

    def code(self, entry: str) -> str:
        """SHA-256 (hexadecimal) of all code of the source that an entry reaches."""
        return self._facts(entry)[0]

    def measuring(self, *entries: str) -> str:
        """SHA-256 of the code by which some claims are measured: without what `@claim(...)` says of them.

        Names and options of a decorator count; reasons, errata, choices, tolerances and counterexamples do not.
        """
        return self._of(f"measuring {' '.join(entries)}", lambda: _digest(*self._reached(*entries, words=False)[:2]))

    def libraries(self, entry: str) -> list[str]:
        """Sorted top-level modules of the libraries, without the standard one, whose names that code uses."""
        return self._facts(entry)[1]

    def reads(self, entry: str) -> dict[str, list[str]]:
        """Sorted attributes that this code reads of parameters, by the names of their types.

        Of `def gravity(planet: Planet): return planet.mu` it is {"Planet": ["mu"]}. Sections of all inputs are
        followed: of `given: Inputs`, `given.planet.mu` reads `mu` of the class that `Inputs` annotates `planet` with.
        """
        return self._facts(entry)[2]

    def symbols(self, entry: str) -> list[str]:
        """Sorted "module:name" of all definitions that an entry reaches; what runs at import is named AT_IMPORT."""
        return sorted(self._reached(entry)[0])

    def kernels(self) -> str:
        """SHA-256 of all code that numba's cached kernels reach, see `compiled`."""
        return self._of("kernels", lambda: _digest(*self._reached(*self.compiled())[:2]))

    def compiled(self) -> list[str]:
        """Return the functions that numba compiles and caches.

        They are decorated with `njit(..., cache=True)`, with `compiled_when_called`, or with a function of their module
        that calls one of these.
        """
        found, compilers = [], {"njit", "compiled_when_called"}
        for module_name, module in self._modules(f"{PACKAGE}/**/*.py"):
            calling = {name for name in module.functions if compilers & {*_uses(module.definitions[name][-1])[0]}}
            for name, signature in module.functions.items():
                decorators = signature["decorators"]
                is_cached = decorators.get("njit", {}).get("cache") or "compiled_when_called" in decorators
                if is_cached or calling & decorators.keys():
                    found.append(f"{module_name}:{name}")
        return found

    def functions(self, package: str) -> dict[str, dict]:
        """Return what the functions of a package's own modules declare, by "package.module:function".

        A function has `parameters` (those that may be given by position; True for one that may be left out), `summary`
        (the first line of its docstring), `decorators` (their literal arguments by their names) and `unread` (names of
        their other arguments).
        """

        def declared() -> dict[str, dict]:
            modules = self._modules(f"{package.replace('.', '/')}/*.py")
            return {f"{name}:{function}": of for name, module in modules for function, of in module.functions.items()}

        return self._of(f"functions {package}", declared)

    def save(self) -> None:
        """Write what was computed, if no file has changed meanwhile; where nothing can be written, forget it."""
        if len(self._known) > self._saved and self._key_now() == self._key:
            with contextlib.suppress(OSError):
                write_text(self._memory, json.dumps({self._key: self._known}))
                self._saved = len(self._known)

    def _of(self, name, compute):
        if name not in self._known:
            self._known[name] = compute()
        return self._known[name]

    def _facts(self, entry: str) -> tuple[str, list[str], dict[str, list[str]]]:
        def facts():
            definitions, imports, libraries = self._reached(entry)
            return _digest(definitions, imports), sorted(libraries), _read(definitions)

        return self._of(f"code {entry}", facts)

    def _key_now(self) -> str:
        hasher = hashlib.sha256(sys.version.encode())
        for path in sorted([*self._root.glob(f"{PACKAGE}/**/*.py"), *self._scripts.glob("*.py")]):
            content = path.read_bytes()
            hasher.update(f"{os.path.relpath(path, self._root)} {len(content)}\n".encode() + content)
        return hasher.hexdigest()

    def _modules(self, pattern: str) -> Iterator[tuple[str, Module]]:
        for path in sorted(self._root.glob(pattern)):
            name = ".".join(path.relative_to(self._root).with_suffix("").parts)
            yield name.removesuffix(".__init__"), _parsed(path, path.read_bytes())

    def _read_module(self, name: str) -> Module | None:
        """A module of the source that counts, or a script; None for any other."""
        place = self._root.joinpath(*name.split("."))
        paths = [self._scripts / name] if name.endswith(".py") else [place / "__init__.py", Path(f"{place}.py")]
        path = next((path for path in paths if name and name not in MACHINERY and path.is_file()), None)
        return path and _parsed(path, path.read_bytes())

    def _reached(self, *entries: str, words: bool = True) -> tuple[dict[str, list[ast.stmt]], set[str], set[str]]:
        """All that entries reach: definitions by "module:name", imports, and top-level modules of libraries.

        words: whether what is said of claims counts, see `measuring`.
        """
        definitions, imports, libraries = {}, set(), set()
        pending, seen = [self._entry(entry) for entry in entries], set()
        while pending:
            if (place := pending.pop()) in seen or (place[0] == SAID_IN and not words):
                continue
            seen.add(place)
            if (place, words) not in self._behind:
                self._behind[place, words] = list(self._references(*place, words))
            pending += self._behind[place, words]
            name, symbol = place
            module = self._module(name)
            if module is None:
                libraries.add(name)
                continue
            first = symbol.partition(".")[0]
            imports.update(f"{name}:{first} = {target}" for target in module.imports.get(first, ()))
            defined, statements = _definition(module, symbol)
            if statements:
                definitions[f"{name}:{defined}"] = [one if words else _unsaid(one) for one in statements]
        return definitions, imports, libraries

    def _entry(self, entry: str) -> Place:
        name, _, symbol = entry.partition(":")
        symbol = AT_IMPORT if name.endswith(".py") else symbol
        module = self._module(name) or NOTHING
        if symbol not in (known := module.definitions | module.imports):
            raise InputError(f"{entry}: there is no such function in {self._root}; {nearest(symbol, known)}")
        return name, symbol

    def _references(self, name: str, symbol: str, words: bool) -> Iterator[Place]:
        """What a dotted name of a module refers to; no name stands for all of the module."""
        module, (first, _, rest) = self._module(name) or NOTHING, symbol.partition(".")
        symbols = module.definitions | module.imports
        yield from ((name, other) for other in symbols if other == AT_IMPORT or not symbol)
        for target in module.imports.get(first, ()):
            yield from self._places(target, rest)
        for statement in _definition(module, symbol)[1]:
            names, imports = _uses(statement if words else _unsaid(statement))
            for used in names | {f"{kind}.{path}" for kind, path in _reads(statement)}:
                first, _, rest = used.partition(".")
                if first in symbols:
                    yield name, used
                for target in (target for bound, target in imports if bound == first):
                    yield from self._places(target, rest)

    def _places(self, target: str, rest: str) -> Iterator[Place]:
        """Where an absolute dotted name leads: every module that it begins with, and what follows in that."""
        parts = [*target.split("."), *filter(None, rest.split("."))]
        if parts[0] not in sys.stdlib_module_names and self._module(parts[0]) is None:
            yield parts[0], ""
        for number in range(1, len(parts) + 1):
            if self._module(name := ".".join(parts[:number])):
                yield name, ".".join(parts[number:])


def fingerprints_of(root: Path = SOURCE_ROOT.parent) -> Fingerprints:
    """The fingerprints of the project in a folder; of the installed package if the folder holds no sources."""
    return _fingerprints_of(Path(root).resolve())


@cache
def _fingerprints_of(root: Path) -> Fingerprints:
    scripts = root / "workflow" / "scripts"
    if (root / "src" / PACKAGE).is_dir():
        return Fingerprints(root / ".cache" / "fingerprints.json", root / "src", scripts)
    return Fingerprints(SOURCE_ROOT / PACKAGE / "__pycache__" / "fingerprints.json", SOURCE_ROOT, scripts)


# -------------------------------------------------------------------------------------------------- modules, statements


@cache
def _parsed(path: Path, source: bytes) -> Module:
    """Read a module; remembered by its content, so that an edit within one process is seen."""
    try:
        tree = ast.parse(source)
    except SyntaxError as error:
        raise MarsedlError(f"{path}, line {error.lineno}: {error.msg}: fix the syntax and run again") from error
    module = Module({s.name: _signature(s) for s in tree.body if isinstance(s, ast.FunctionDef)}, {}, {})
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            node.body = [s for s in node.body if not isinstance(s, ast.Expr) or not isinstance(s.value, ast.Constant)]
    for statement in tree.body:
        names = _defined(statement)
        if not names:
            for name, target in _uses(statement)[1]:
                module.imports.setdefault(name, []).append(target)
        if not isinstance(statement, ast.Import | ast.ImportFrom):
            for name in names or {AT_IMPORT}:
                module.definitions.setdefault(name, []).append(statement)
    return module


def _signature(function: ast.FunctionDef) -> dict:
    """What a function declares, see `Fingerprints.functions`."""
    decorators, unread = {}, {}
    for decorator in function.decorator_list:
        called = decorator.func if isinstance(decorator, ast.Call) else decorator
        name, keywords = ast.unparse(called), getattr(decorator, "keywords", ())
        literals = decorators[name] = {}
        for keyword in keywords:
            try:
                literals[keyword.arg] = ast.literal_eval(keyword.value)
            except ValueError:  # only literals declare something
                unread.setdefault(name, []).append(keyword.arg or "**")
    names = [parameter.arg for parameter in (*function.args.posonlyargs, *function.args.args)]
    required = len(names) - len(function.args.defaults)
    parameters = {name: number >= required for number, name in enumerate(names)}
    summary = (ast.get_docstring(function) or "").partition("\n")[0]
    return {"parameters": parameters, "summary": summary, "decorators": decorators, "unread": unread}


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a function, class or assignment defines; none if it changes an item or an attribute."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return {statement.name}
    if not isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        return set()
    nodes = [node for part in getattr(statement, "targets", ()) or [statement.target] for node in ast.walk(part)]
    return {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


_text = cache(ast.dump)  # a statement without comments, docstrings and positions


def _definition(module: Module, symbol: str) -> tuple[str, list[ast.stmt]]:
    """What a dotted name defines, by its own name; of all inputs of a paper, the section that follows it alone."""
    first, _, rest = symbol.partition(".")
    statements, section = module.definitions.get(first, []), rest.partition(".")[0]
    classes = [s for s in statements if isinstance(s, ast.ClassDef) and "Inputs" in map(_type_name, s.bases)]
    if not classes:
        return first, statements
    fields = (field for one in classes for field in one.body if isinstance(field, ast.AnnAssign))
    return f"{first}.{section}", [field for field in fields if field.target.id == section]


def _digest(definitions: dict[str, list[ast.stmt]], imports: set[str]) -> str:
    texts = [(name, *map(_text, statements)) for name, statements in sorted(definitions.items())]
    return hashlib.sha256(repr((texts, sorted(imports))).encode()).hexdigest()


@cache
def _unsaid(statement: ast.stmt) -> ast.stmt:
    """A statement without what its calls of `claim(...)` say, most often in decorators."""
    return _Unsaid().visit(copy.deepcopy(statement)) if "claim" in _uses(statement)[0] else statement


class _Unsaid(ast.NodeTransformer):
    def visit_Call(self, node: ast.Call) -> ast.Call:
        self.generic_visit(node)
        if _dotted(node.func) != "claim":
            return node
        return ast.Call(ast.Name("dict"), [], [one for one in node.keywords if one.arg not in SAID])


@cache
def _uses(statement: ast.stmt) -> tuple[set[str], list[tuple[str, str]]]:
    """All dotted names in a statement but for parameters, and its imports: names with what they are bound to."""
    names, imports, pending = set(), [], [(statement, set())]
    while pending:
        node, hidden = pending.pop()
        if isinstance(node, ast.ImportFrom):
            imports += [(alias.asname or alias.name, f"{node.module}.{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Import):
            tops = ((alias, alias.name.partition(".")[0]) for alias in node.names)
            imports += [(alias.asname, alias.name) if alias.asname else (top, top) for alias, top in tops]
        elif name := _dotted(node):
            names.update({name} if name.partition(".")[0] not in hidden else ())
        else:
            inside = hidden
            if isinstance(node, ast.FunctionDef):
                inside = hidden | {argument.arg for argument in ast.walk(node.args) if isinstance(argument, ast.arg)}
            for child in ast.iter_child_nodes(node):
                pending.append((child, inside if isinstance(child, ast.stmt) else hidden))
    return names, imports


def _dotted(node: ast.AST) -> str:
    """The text of `a.b.c`; empty if it is anything else."""
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return before and f"{before}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


# ---------------------------------------------------------------------------------------------- what is read of inputs


def _read(definitions: dict[str, list[ast.stmt]]) -> dict[str, list[str]]:
    """What is read of parameters in some definitions, by the names of their types; of all inputs, by section."""
    read, sections = {}, {}  # the sections of all inputs, such as "Inputs.planet", with the names of their classes
    for name, of in definitions.items():
        for field in (statement for statement in of if isinstance(statement, ast.AnnAssign)):
            sections.setdefault(name.partition(":")[2], set()).add(_type_name(field.annotation))
    for kind, path in {pair for of in definitions.values() for statement in of for pair in _reads(statement)}:
        first, *further = path.split(".")
        name = kind.rpartition(".")[2]
        read.setdefault(name, set()).add(first)
        for section in sections.get(f"{name}.{first}", ()) if further else ():
            read.setdefault(section, set()).add(further[0])
    return {kind: sorted(attributes) for kind, attributes in sorted(read.items())}


@cache
def _reads(statement: ast.stmt) -> set[tuple[str, str]]:
    """What functions in a statement read of their parameters: ("Planet", "mu"), ("Inputs", "planet.mu").

    A local variable stands for what it is assigned first: after `planet = given.planet`, which may be one of several in
    a line, `planet.mu` reads `given.planet.mu`.
    """
    read = set()
    for function in (node for node in ast.walk(statement) if isinstance(node, ast.FunctionDef)):
        arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        types = {one.arg: (kind, "") for one in arguments if (kind := _annotated(one.annotation))}

        def typed(node, types=types):
            first, _, rest = _dotted(node).partition(".")
            if not rest or first not in types:
                return None
            kind, before = types[first]
            return kind, f"{before}.{rest}" if before else rest

        nodes = list(ast.walk(function))
        for target, value in ((node.targets[0], node.value) for node in nodes if isinstance(node, ast.Assign)):
            several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            for name, source in zip(target.elts, value.elts, strict=False) if several else [(target, value)]:
                if isinstance(name, ast.Name) and (path := typed(source)):
                    types.setdefault(name.id, path)
        read.update(filter(None, map(typed, nodes)))
    return read


def _type_name(annotation: ast.expr | None) -> str:
    """The name of an annotated class, without the module that it stands in; empty for other annotations."""
    return _annotated(annotation).rpartition(".")[2]


def _annotated(annotation: ast.expr | None) -> str:
    """The text of an annotated class, `a.B` or "B"; empty for other annotations."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return annotation.value
    return _dotted(annotation)
