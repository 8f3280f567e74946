"""Digests of the code that a stage can reach, so that edits of imported modules rerun what uses them.

Snakemake sees an edited script, but not an edited module that the script imports. A code digest in a rule's params
closes the gap. It covers every module-level definition inside the source folder that a function can reach through names
and imports, without comments, docstrings and formatting: an edit of shared physics reruns its users, an edit of its
neighbour in the same file or of a comment reruns nothing.

What counts:

- the function itself and, transitively, every module-level definition (function, class, assignment) whose name occurs
  in something that counts: in its body, decorators, default arguments, base classes, annotations;
  a parameter hides the module's definition of its name;
- names from other modules, through every absolute import, also inside functions and through re-exports;
- `alias.symbol` for a module alias; a module used in any other way (passed on) counts whole, and a package then with
  all its submodules;
- of every module that gets imported: the statements that do something at import (`np.seterr(...)`, `TABLE["x"] = f`,
  `if`, `try`, loops), with what they reference.

What does not count: the machinery around the science, `MACHINERY`, which loads, saves and reports. `recipes.FORMAT`
stands for it.

What cannot be seen: modules named by strings (`importlib.import_module(name)`), and functions that are reached only
because their decorator entered them into a table. Of libraries outside the source folder, `libraries` lists those that
the code uses by name.

Only the standard library is imported here, because the Snakefile calls this on every run.
"""

import ast
import atexit
import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import InputError, MarsedlError, nearest

SOURCE_ROOT = Path(__file__).parents[2]
MACHINERY = frozenset(
    f"marsedl.replication.{name}"
    for name in (
        *("artifacts", "code_digest", "digests", "errors", "jobs", "kernels", "libraries", "recipes", "sharing"),
        *("staleness", "terminal"),
    )
)

_AT_IMPORT = "(at import)"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_IMPORTS = (ast.Import, ast.ImportFrom)


def reachable_symbols(entry: str, source_root: Path = SOURCE_ROOT) -> list[str]:
    """Sorted "module:symbol" of all that the digest of an entry covers; what runs at import as "module:(at import)".

    entry: "package.module:function"; source_root: the folder that holds the top-level package

    Raises InputError if there is no such module or function, MarsedlError for a module that is not valid Python.
    """
    return _closure_of(entry, _Source(source_root)).listing()


def functions(package: str, source_root: Path = SOURCE_ROOT) -> dict[str, dict]:
    """Return what the functions of a package's own modules declare, by "package.module:function".

    A function has `parameters` (those that may be given by position; True for one that may be left out), `summary` (the
    first line of its docstring) and `decorators` (their literal arguments by their names).
    Raises MarsedlError for a module that is not valid Python.
    """
    return {
        f"{module.name}:{name}": signature
        for path in sorted(Path(source_root).joinpath(*package.split(".")).glob("*.py"))
        for module in [_parsed(package if path.stem == "__init__" else f"{package}.{path.stem}", path)]
        for name, signature in module.signatures.items()
    }


def kernels_digest(source_root: Path = SOURCE_ROOT) -> str:
    """SHA-256 of all code that numba's cached kernels can reach, see `kernels`."""
    closure = _Closure(_Source(source_root))
    for entry in kernels(source_root):
        module, _, symbol = entry.partition(":")
        closure.follow(module, (symbol,))
    return closure.digest()


def kernels(source_root: Path = SOURCE_ROOT) -> list[str]:
    """Return the functions that numba compiles and caches, "package.module:function".

    These are decorated with `njit(..., cache=True)`, or with a function of their module that calls `njit`.
    Raises MarsedlError for a module that is not valid Python.
    """
    found = []
    for path in sorted(Path(source_root).rglob("*.py")):
        name = ".".join(path.relative_to(source_root).with_suffix("").parts).removesuffix(".__init__")
        module = _parsed(name, path)
        calling = {s.name for s in module.statements if isinstance(s, _FUNCTIONS) and ("njit",) in _uses(s).chains}
        for function, signature in module.signatures.items():
            decorators = signature["decorators"]
            if decorators.get("njit", {}).get("cache") or calling & decorators.keys():
                found.append(f"{name}:{function}")
    return found


class RememberedDigests:
    """The digests of this module, remembered in a file for as long as no source file and no script changes.

    Computing them parses all of the source, at every start of Snakemake. They are stored under a hash of all files and
    of the version of Python, so a stale memory is never used.
    """

    def __init__(self, memory: Path, source_root: Path, scripts: Path):
        """Take the file that remembers, the folder of the package and that of the scripts."""
        self._memory, self._source_root, self._scripts = memory, source_root, scripts
        self._key, self._digests, self._source = self._key_now(), {}, _Source(source_root)
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError):  # nothing remembered that can be used
            remembered = json.loads(memory.read_text(encoding="utf-8"))
            if remembered["key"] == self._key:
                self._digests = dict(remembered["digests"])
        self._known = len(self._digests)
        atexit.register(self.save)

    def kernels(self) -> str:
        """See `kernels_digest`."""
        return self._of("kernels", lambda: kernels_digest(self._source_root))

    def code(self, entry: str) -> str:
        """SHA-256 (hexadecimal) of all code of the source that an entry "package.module:function" can reach.

        Raises InputError if there is no such module or function, MarsedlError for a module that is not valid Python.
        """
        return self._code(entry)[0]

    def libraries(self, entry: str) -> list[str]:
        """Sorted top-level modules of the libraries, without the standard one, whose names that code uses."""
        return self._code(entry)[1]

    def reads(self, entry: str) -> dict[str, list[str]]:
        """Sorted attributes that this code reads of parameters, by the names of their types.

        Of `def gravity(planet: Planet): return planet.mu` it is {"Planet": ["mu"]}. Fields of named tuples are
        followed: of `setup: Setup`, `setup.planet.mu` reads `mu` of the class that `Setup` annotates `planet` with.
        """
        return self._code(entry)[2]

    def functions(self, package: str) -> dict[str, dict]:
        """See `functions`."""
        return self._of(f"functions {package}", lambda: functions(package, self._source_root))

    def script(self, name: str) -> str:
        """SHA-256 of a script of the workflow: all of its own code, and all that it can reach in the source."""
        return self._script(name)[0]

    def script_libraries(self, name: str) -> list[str]:
        """Of a script what `libraries` is of an entry."""
        return self._script(name)[1]

    def _code(self, entry: str) -> tuple[str, list[str], dict[str, list[str]]]:
        return self._of(f"code {entry}", lambda: _facts(_closure_of(entry, self._source)))

    def _script(self, name: str) -> tuple[str, list[str], dict[str, list[str]]]:
        return self._of(f"script {name}", lambda: _facts(_closure_of_script(self._scripts / name, self._source)))

    def save(self) -> None:
        """Write what was computed, if no file has changed meanwhile; where nothing can be written, forget it."""
        if len(self._digests) == self._known or self._key_now() != self._key:
            return
        with contextlib.suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            partial = self._memory.with_name(f"{self._memory.name}.{os.getpid()}")  # as others may read it
            partial.write_text(json.dumps({"key": self._key, "digests": self._digests}), encoding="utf-8")
            partial.replace(self._memory)
            self._known = len(self._digests)

    def _of(self, name, compute):
        if name not in self._digests:
            self._digests[name] = compute()
        return self._digests[name]

    def _key_now(self) -> str:
        hasher = hashlib.sha256(sys.version.encode())
        package = self._source_root / "marsedl"  # an installed one has others beside it
        for folder in (package if package.is_dir() else self._source_root, self._scripts):
            for path in sorted(folder.rglob("*.py")):
                content = path.read_bytes()
                hasher.update(f"{path.relative_to(folder).as_posix()} {len(content)}\n".encode() + content)
        return hasher.hexdigest()


@cache
def remembered_digests(root: Path) -> RememberedDigests:
    """The remembered digests of the project in a folder; of the installed package if the folder holds no sources."""
    scripts = root / "workflow" / "scripts"
    if not (root / "src" / "marsedl").is_dir():
        return RememberedDigests(SOURCE_ROOT / "marsedl" / "__pycache__" / "code_digests.json", SOURCE_ROOT, scripts)
    return RememberedDigests(root / ".cache" / "code_digests.json", root / "src", scripts)


def _closure_of(entry: str, source: "_Source") -> "_Closure":
    name, _, symbol = entry.partition(":")
    module = source.module(name)
    if module is None:
        raise InputError(f"{entry}: there is no module '{name}' in {source.root}: correct its name")
    symbol = symbol.partition(".")[0]
    names = {*module.definitions, *module.imports}
    if symbol not in names:
        raise InputError(
            f"{entry}: {module.path} defines no '{symbol}'; {nearest(symbol, names)}; name it as "
            "'package.module:function'"
        )
    closure = _Closure(source)
    closure.follow(name, (symbol,))
    return closure


def _closure_of_script(path: Path, source: "_Source") -> "_Closure":
    if not path.is_file():
        raise InputError(f"{path}: there is no such script: correct its name")
    closure = _Closure(source)
    closure.add_script(_parsed(path.name, path))
    return closure


def _facts(closure: "_Closure") -> tuple[str, list[str], dict[str, list[str]]]:
    """Digest and libraries of some code, and what it reads of its parameters."""
    return closure.digest(), sorted(closure.libraries), closure.reads()


# -------------------------------------------------------------------------------------------------- modules, statements


class _Uses(NamedTuple):
    """What a statement refers to."""

    chains: set[tuple[str, ...]]  # ("steering", "steer") of `steering.steer`
    imports: dict[str, list[tuple[str, str | None]]]  # by the local name: a module, and the name taken from it, if any
    loads: set[str]  # modules that its imports load, if there are such


@cache
def _uses(statement: ast.stmt) -> _Uses:
    """All names, attribute chains and imports in a statement; a parameter hides the module's definition of its name."""
    uses, pending = _Uses(set(), {}, set()), [(statement, frozenset())]
    while pending:
        node, hidden = pending.pop()
        if isinstance(node, _IMPORTS):
            for bound, module, symbol, loads in _imported(node):
                uses.imports.setdefault(bound, []).append((module, symbol))
                uses.loads.update((loads, f"{module}.{symbol}"))
        elif isinstance(node, ast.Attribute | ast.Name) and (chain := _chain(node)):
            uses.chains.update({chain} if chain[0] not in hidden else ())
        else:
            inside = hidden | _parameters(node) if isinstance(node, (*_FUNCTIONS, ast.Lambda)) else hidden
            for name, value in ast.iter_fields(node):
                nodes = [item for item in (value if isinstance(value, list) else [value]) if isinstance(item, ast.AST)]
                nodes += _quoted(value) if name in ("annotation", "returns") and value else ()
                pending += [(child, inside if name == "body" else hidden) for child in nodes]
    return uses


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> set[str]:
    """The names of a function's parameters but for those that an import inside of it binds anew."""
    names = {node.arg for node in ast.walk(function.args) if isinstance(node, ast.arg)}
    imports = (node for node in ast.walk(function) if isinstance(node, _IMPORTS))
    return names - {bound for statement in imports for bound, *_ in _imported(statement)}


def _imported(statement: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, str, str | None, str]]:
    """The names that an absolute import binds: local name, module, name taken from it, module that is loaded."""
    for alias in statement.names:
        if isinstance(statement, ast.ImportFrom):
            yield alias.asname or alias.name, statement.module, alias.name, statement.module
        elif alias.asname:
            yield alias.asname, alias.name, None, alias.name
        else:
            top = alias.name.partition(".")[0]
            yield top, top, None, alias.name


def _chain(node: ast.expr) -> tuple[str, ...]:
    """("a", "b", "c") of `a.b.c`; nothing if it does not begin with a name."""
    attributes: list[str] = []
    while isinstance(node, ast.Attribute):
        attributes.insert(0, node.attr)
        node = node.value
    return (node.id, *attributes) if isinstance(node, ast.Name) else ()


def _quoted(annotation: ast.expr) -> Iterator[ast.expr]:
    """The expressions in the strings of an annotation such as `list["Planet"]`."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            with contextlib.suppress(SyntaxError, ValueError):  # a string of another kind, as in Literal["..."]
                yield ast.parse(node.value, mode="eval").body


@cache
def _text(statement: ast.stmt) -> str:
    """A statement without comments and positions; docstrings are gone from it already."""
    return ast.dump(statement)


class _Module:
    """A source file: its statements by what they are for."""

    def __init__(self, name: str, path: Path, tree: ast.Module):
        """Sort the statements; docstrings are taken out of them."""
        self.name, self.path = name, path
        self.is_package = path.name == "__init__.py"
        self.signatures = {s.name: _signature(s) for s in tree.body if isinstance(s, _FUNCTIONS)}
        _strip_docstrings(tree)
        self.statements = tree.body
        self.definitions: dict[str, list[ast.stmt]] = {}
        self.effects: list[ast.stmt] = []  # they act at import
        self.imports: dict[str, list[tuple[str, str | None]]] = {}
        self.loads: set[str] = set()
        for statement in self.statements:
            names = _defined(statement)
            for defined in names:
                self.definitions.setdefault(defined, []).append(statement)
            if not names:
                uses = _uses(statement)
                for bound, sources in uses.imports.items():
                    self.imports.setdefault(bound, []).extend(sources)
                self.loads |= uses.loads
                if not isinstance(statement, (*_IMPORTS, ast.Pass)):
                    self.effects.append(statement)

    @cached_property
    def bound_by_effects(self) -> set[str]:
        """Names that its effects assign, in whatever scope."""
        nodes = (node for effect in self.effects for node in ast.walk(effect))
        return {getattr(node, "id", getattr(node, "name", None)) for node in nodes}


@cache
def _parse(name: str, path: Path, source: bytes) -> _Module:
    try:
        return _Module(name, path, ast.parse(source, filename=path))
    except SyntaxError as error:
        raise MarsedlError(f"{path}, line {error.lineno}: {error.msg}: fix the syntax and run again") from error
    except (ValueError, RecursionError) as error:
        raise MarsedlError(f"{path}: {error}: fix the file and run again") from error


def _parsed(name: str, path: Path) -> _Module:
    """Read a module; remembered by its content, so that an edit within one process is seen."""
    return _parse(name, path, path.read_bytes())


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a statement defines if it does nothing else."""
    if isinstance(statement, (*_FUNCTIONS, ast.ClassDef)):
        return {statement.name}
    targets = getattr(statement, "targets", None) or [getattr(statement, "target", None)]
    if not isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        return set()
    nodes = [node for target in targets for node in ast.walk(target)]
    if not all(isinstance(node, ast.Name | ast.Tuple | ast.List | ast.Starred | ast.expr_context) for node in nodes):
        return set()  # an item or an attribute of something else is changed
    return {node.id for node in nodes if isinstance(node, ast.Name)}


def _strip_docstrings(tree: ast.Module) -> None:
    for node in ast.walk(tree):
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef, ast.Module)):
            node.body = [s for s in node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]


def _signature(function: ast.FunctionDef) -> dict:
    """What a function declares, see `functions`."""
    arguments = [*function.args.posonlyargs, *function.args.args]
    decorators = {}
    for decorator in function.decorator_list:
        called = decorator.func if isinstance(decorator, ast.Call) else decorator
        with contextlib.suppress(ValueError):  # only literals declare something
            literals = {k.arg: ast.literal_eval(k.value) for k in getattr(decorator, "keywords", ()) if k.arg}
            decorators[ast.unparse(called)] = literals
    summary = (ast.get_docstring(function) or "").partition("\n")[0]
    optional = {parameter.arg for parameter in arguments[len(arguments) - len(function.args.defaults) :]}
    parameters = {parameter.arg: parameter.arg in optional for parameter in arguments}
    return {"parameters": parameters, "summary": summary, "decorators": decorators}


# ---------------------------------------------------------------------------------------------- what is read of inputs


@cache
def _reads(statement: ast.stmt) -> frozenset[tuple[str, ...]]:
    """What functions in a statement read of their parameters: ("Planet", "mu"), ("Setup", "planet", "mu").

    A local variable stands for what it is assigned first: after `planet = setup.planet`, which may be one of several in
    a line, `planet.mu` reads `setup.planet.mu`.
    """
    read = set()
    for function in (node for node in ast.walk(statement) if isinstance(node, _FUNCTIONS)):
        arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        types = {parameter.arg: (kind,) for parameter in arguments if (kind := _type_name(parameter.annotation))}

        def typed(node, types=types):
            chain = _chain(node) if isinstance(node, ast.Attribute) else ()
            return (*types[chain[0]], *chain[1:]) if chain and chain[0] in types else ()

        nodes = list(ast.walk(function))
        for target, value in (pair for node in nodes if isinstance(node, ast.Assign) for pair in _assigned(node)):
            if isinstance(target, ast.Name) and (chain := typed(value)):
                types.setdefault(target.id, chain)
        read.update(chain for node in nodes if (chain := typed(node)))
    return frozenset(read)


def _assigned(statement: ast.Assign) -> list[tuple[ast.expr, ast.expr]]:
    """The targets of an assignment with their values, one by one where both are written as tuples."""
    target, value = statement.targets[0], statement.value
    several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
    return list(zip(target.elts, value.elts, strict=False)) if several else [(target, value)]


def _fields(statement: ast.stmt) -> dict[str, str]:
    """The fields of a class with the names of their types if it is a named tuple."""
    if not isinstance(statement, ast.ClassDef) or "NamedTuple" not in map(_type_name, statement.bases):
        return {}
    declared = [node for node in statement.body if isinstance(node, ast.AnnAssign)]
    return {node.target.id: _type_name(node.annotation) for node in declared}


def _type_name(annotation: ast.expr | None) -> str:
    """The name of an annotated class, without the module that it stands in; empty for other annotations."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return annotation.value.rpartition(".")[2]
    return getattr(annotation, "attr", getattr(annotation, "id", ""))


# -------------------------------------------------------------------------------------------------------- the closure


class _Source:
    """The modules of a source folder, as they are now."""

    def __init__(self, root: Path):
        """Take the folder that holds the top-level package."""
        self.root, self._modules = Path(root), {}

    def module(self, name: str) -> _Module | None:
        """The module of this name if it lies in the folder and counts."""
        if name not in self._modules:
            place = self.root.joinpath(*name.split("."))
            paths = [place / "__init__.py", place.with_name(f"{place.name}.py")] if name else []
            path = next((path for path in paths if path.is_file()), None)
            self._modules[name] = None if path is None or name in MACHINERY else _parsed(name, path)
        return self._modules[name]


class _Closure:
    """All that can be reached from some code, collected by following its references."""

    def __init__(self, source: _Source):
        """Start with nothing."""
        self.source = source
        self.libraries: set[str] = set()  # top-level modules from outside of the source whose names are used
        self._script: list[str] = []
        self._symbols: set[tuple[str, str]] = set()
        self._loaded: set[str] = set()
        self._bindings: set[tuple] = set()  # imported names in use, with the module that uses them
        self._followed: set[tuple[str, tuple[str, ...]]] = set()
        self._pending: list[tuple[_Module, ast.stmt]] = []

    def add_script(self, script: _Module) -> None:
        """Follow everything in a file outside of the source."""
        self._script = [_text(statement) for statement in script.statements]
        for name in script.loads:
            self._load(name)
        self._pending += [(script, statement) for statement in script.statements]
        self._run()

    def follow(self, name: str, attributes: tuple[str, ...]) -> None:
        """Follow `module.attribute...` and all that it refers to."""
        self._follow(name, attributes)
        self._run()

    def _run(self) -> None:
        while self._pending:
            module, statement = self._pending.pop()
            uses = _uses(statement)
            for name in uses.loads:
                self._load(name)
            for first, *attributes in uses.chains:
                if first in module.definitions:
                    self._add(module, first)
                self._follow_imports(module, first, tuple(attributes))
                for source, symbol in uses.imports.get(first, ()):
                    self._follow(source, (*filter(None, [symbol]), *attributes))
                if first == "globals" or (first, *attributes[:1]) == ("sys", "modules"):
                    self._add_whole(module)

    def _follow_imports(self, module: _Module, bound: str, attributes: tuple[str, ...]) -> None:
        for source, symbol in module.imports.get(bound, ()):
            self._bindings.add((module.name, bound, source, symbol or ""))
            self._follow(source, (*filter(None, [symbol]), *attributes))

    def _follow(self, name: str, attributes: tuple[str, ...]) -> None:
        """Follow `module.attribute...`; a module without attributes is used as an object and counts whole."""
        if (name, attributes) in self._followed:
            return
        self._followed.add((name, attributes))
        module = self.source.module(name)
        if module is None:
            top = name.partition(".")[0]
            if top not in sys.stdlib_module_names and self.source.module(top) is None:
                self.libraries.add(top)
            return
        self._load(name)
        first, rest = (attributes[0], attributes[1:]) if attributes else ("", ())
        if first in module.definitions:
            self._add(module, first)
        self._follow_imports(module, first, rest)
        if first in module.definitions or first in module.imports:
            return
        if module.is_package and first and self.source.module(f"{name}.{first}"):
            self._follow(f"{name}.{first}", rest)
        elif "__getattr__" in module.definitions and first:
            self._add(module, "__getattr__")
        elif first not in module.bound_by_effects and first not in ("__name__", "__file__", "__doc__"):
            self._add_whole(module)

    def _add(self, module: _Module, symbol: str) -> None:
        if (module.name, symbol) not in self._symbols:
            self._symbols.add((module.name, symbol))
            self._pending += [(module, statement) for statement in module.definitions[symbol]]

    def _add_whole(self, module: _Module) -> None:
        """Everything in a module counts, and of a package everything below it too."""
        for symbol in module.definitions:
            self._add(module, symbol)
        for bound in module.imports:
            self._follow_imports(module, bound, ())
        if module.is_package:
            for path in sorted(module.path.parent.iterdir()):
                if path.suffix == ".py" or (path / "__init__.py").is_file():
                    self._follow(f"{module.name}.{path.stem}", ())

    def _load(self, name: str) -> None:
        """Importing a module runs the statements of it and of its packages that act at import."""
        module = self.source.module(name)
        if module is None or name in self._loaded:
            return
        self._loaded.add(name)
        self._load(name.rpartition(".")[0])
        for loaded in module.loads:
            self._load(loaded)
        self._pending += [(module, statement) for statement in module.effects]

    def reads(self) -> dict[str, list[str]]:
        """What is read of parameters in all that is reached, by the names of their types; through named tuples too."""
        pending: list[tuple[str, ...]] = []
        types: dict[tuple[str, str], set[str]] = {}  # of the fields of named tuples
        for name, symbol in self._symbols:
            for statement in self.source.module(name).definitions[symbol]:
                pending += _reads(statement)
                for field, kind in _fields(statement).items():
                    types.setdefault((symbol, field), set()).add(kind)
        read: dict[str, set[str]] = {}
        while pending:
            kind, attribute, *further = pending.pop()
            read.setdefault(kind, set()).add(attribute)
            if further:
                pending += [(of, *further) for of in types.get((kind, attribute), ())]
        return {kind: sorted(attributes) for kind, attributes in sorted(read.items())}

    def listing(self) -> list[str]:
        """See `reachable_symbols`."""
        effects = {(name, _AT_IMPORT) for name in self._loaded if self.source.module(name).effects}
        return sorted(f"{module}:{symbol}" for module, symbol in self._symbols | effects)

    def digest(self) -> str:
        """SHA-256 of all reached statements and of the imports that bind the names in use."""
        parts = [*self._script, *map(repr, sorted(self._bindings))]
        for name in sorted(self._loaded):
            module = self.source.module(name)
            reached = {id(s) for symbol, statements in module.definitions.items() for s in statements
                       if (name, symbol) in self._symbols}  # fmt: skip
            reached |= set(map(id, module.effects))
            statements = [statement for statement in module.statements if id(statement) in reached]
            # Functions may stand in any order, but the order of what is executed at import matters.
            executed = [statement for statement in statements if not isinstance(statement, _FUNCTIONS)]
            functions = sorted((s for s in statements if isinstance(s, _FUNCTIONS)), key=lambda s: s.name)
            parts += [f"{name} {_text(statement)}" for statement in (*executed, *functions)]
        return _sha256(parts)


def _sha256(parts: Iterable[str]) -> str:
    hasher = hashlib.sha256()
    for part in parts:
        hasher.update(f"{len(part)}:{part}\n".encode("utf-8", "surrogatepass"))
    return hasher.hexdigest()
