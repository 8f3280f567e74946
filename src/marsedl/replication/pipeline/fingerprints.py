"""Fingerprints of code: which definitions a function reaches, a digest of them, and which inputs they read.

Snakemake sees an edited script, but not an edited module that the script imports. A fingerprint in a rule's params
closes the gap. It covers every module-level definition inside the source folder that a function reaches through names
and imports, without comments, docstrings and formatting: an edit of shared physics reruns its users, an edit of its
neighbour in the same file or of a comment reruns nothing.

What counts:

- the function itself and, transitively, every module-level definition (function, class, assignment) whose name occurs
  in something that counts: in its body, decorators, default arguments, base classes, annotations;
  a parameter hides the module's definition of its name;
- names from other modules, through every absolute import, also inside functions and through re-exports; a module that
  is passed on as an object counts whole;
- of every imported module the statements that do something at import (`np.seterr(...)`, `TABLE["x"] = f`, `if`, `try`,
  loops), with what they reference.

What does not count is the machinery around the science, `MACHINERY`, which loads, saves and reports; `recipes.FORMAT`
stands for it. Modules named by strings (`importlib.import_module(name)`) cannot be seen, nor functions that are reached
only because their decorator entered them into a table.

Only the standard library is imported here, because the Snakefile calls this on every run.
"""

import ast
import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import InputError, MarsedlError, nearest

SOURCE_ROOT = Path(__file__).parents[3]
MACHINERY = frozenset(
    f"marsedl.replication.{name}"
    for name in (
        *("errors", "files", "terminal", "records.fields", "records.store", "records.recipes", "records.differences"),
        *("pipeline.fingerprints", "pipeline.kernel_cache", "pipeline.numerics", "pipeline.libraries"),
        *("pipeline.sharing", "pipeline.staleness", "pipeline.runner", "pipeline.jobs"),
    )
)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_IMPORTS = (ast.Import, ast.ImportFrom)


class Fingerprints:
    """The fingerprints of a source folder; `save` keeps them in a file until a source file or a script changes.

    They are stored under a hash of all files and of the version of Python, so a stale memory is never used.
    An entry is a function, "package.module:function", or a whole script of the workflow, "stage.py".
    Methods raise InputError for an entry that does not exist, and MarsedlError for a file that is not valid Python.
    """

    def __init__(self, memory: Path, source_root: Path, scripts: Path):
        """Take the file that remembers, the folder of the package and that of the scripts."""
        self._memory, self.source_root, self._scripts = memory, Path(source_root), scripts
        self._key, self._known, self._modules = self._key_now(), {}, {}
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError):  # nothing remembered that can be used
            remembered = json.loads(memory.read_text(encoding="utf-8"))
            if remembered["key"] == self._key:
                self._known = dict(remembered["known"])
        self._saved = len(self._known)

    def code(self, entry: str) -> str:
        """SHA-256 (hexadecimal) of all code of the source that an entry reaches."""
        return self._facts(entry)[0]

    def libraries(self, entry: str) -> list[str]:
        """Sorted top-level modules of the libraries, without the standard one, whose names that code uses."""
        return self._facts(entry)[1]

    def reads(self, entry: str) -> dict[str, list[str]]:
        """Sorted attributes that this code reads of parameters, by the names of their types.

        Of `def gravity(planet: Planet): return planet.mu` it is {"Planet": ["mu"]}. Fields of named tuples are
        followed: of `setup: Setup`, `setup.planet.mu` reads `mu` of the class that `Setup` annotates `planet` with.
        """
        return self._facts(entry)[2]

    def symbols(self, entry: str) -> list[str]:
        """Sorted "module:symbol" of all that an entry reaches; what runs at import is "module:(at import)"."""
        return self._reached(entry).listing()

    def kernels(self) -> str:
        """SHA-256 of all code that numba's cached kernels reach, see `compiled`."""
        return self._of("kernels", lambda: self._reached(*self.compiled()).digest())

    def compiled(self) -> list[str]:
        """Return the entries that numba compiles and caches.

        They are decorated with `njit(..., cache=True)`, or with a function of their module that calls `njit`.
        """
        found = []
        for path in sorted(self.source_root.rglob("*.py")):
            name = ".".join(path.relative_to(self.source_root).with_suffix("").parts).removesuffix(".__init__")
            module = _parsed(name, path)
            calling = {s.name for s in module.statements if isinstance(s, _FUNCTIONS) and ("njit",) in _uses(s).chains}
            for function, signature in module.signatures.items():
                decorators = signature["decorators"]
                if decorators.get("njit", {}).get("cache") or calling & decorators.keys():
                    found.append(f"{name}:{function}")
        return found

    def functions(self, package: str) -> dict[str, dict]:
        """Return what the functions of a package's own modules declare, by "package.module:function".

        A function has `parameters` (those that may be given by position; True for one that may be left out), `summary`
        (the first line of its docstring) and `decorators` (their literal arguments by their names).
        """

        def declared():
            paths = sorted(self.source_root.joinpath(*package.split(".")).glob("*.py"))
            names = [package if path.stem == "__init__" else f"{package}.{path.stem}" for path in paths]
            modules = map(_parsed, names, paths)
            return {f"{module.name}:{name}": of for module in modules for name, of in module.signatures.items()}

        return self._of(f"functions {package}", declared)

    def module(self, name: str) -> "_Module | None":
        """The module of this name if it lies in the source folder and counts."""
        if name not in self._modules:
            place = self.source_root.joinpath(*name.split("."))
            paths = [place / "__init__.py", place.with_name(f"{place.name}.py")] if name else []
            path = next((path for path in paths if path.is_file()), None)
            self._modules[name] = None if path is None or name in MACHINERY else _parsed(name, path)
        return self._modules[name]

    def save(self) -> None:
        """Write what was computed, if no file has changed meanwhile; where nothing can be written, forget it."""
        if len(self._known) == self._saved or self._key_now() != self._key:
            return
        with contextlib.suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            partial = self._memory.with_name(f"{self._memory.name}.{os.getpid()}")  # as others may read it
            partial.write_text(json.dumps({"key": self._key, "known": self._known}), encoding="utf-8")
            partial.replace(self._memory)
            self._saved = len(self._known)

    def _of(self, name, compute):
        if name not in self._known:
            self._known[name] = compute()
        return self._known[name]

    def _facts(self, entry: str) -> tuple[str, list[str], dict[str, list[str]]]:
        def facts():
            reached = self._reached(entry)
            return reached.digest(), sorted(reached.libraries), reached.reads()

        return self._of(f"code {entry}", facts)

    def _reached(self, *entries: str) -> "_Reached":
        reached = _Reached(self)
        for entry in entries:
            if entry.endswith(".py"):
                reached.add_script(_parsed(entry, self._scripts / entry))
                continue
            name, _, symbol = entry.partition(":")
            module = self.module(name)
            if module is None:
                raise InputError(f"{entry}: there is no module '{name}' in {self.source_root}: correct its name")
            names = {*module.definitions, *module.imports}
            if symbol not in names:
                raise InputError(
                    f"{entry}: {module.path} defines no '{symbol}'; {nearest(symbol, names)}; name it as "
                    "'package.module:function'"
                )
            reached.follow(name, (symbol,))
        return reached

    def _key_now(self) -> str:
        hasher = hashlib.sha256(sys.version.encode())
        package = self.source_root / "marsedl"  # an installed one has others beside it
        for folder in (package if package.is_dir() else self.source_root, self._scripts):
            for path in sorted(folder.rglob("*.py")):
                content = path.read_bytes()
                hasher.update(f"{path.relative_to(folder).as_posix()} {len(content)}\n".encode() + content)
        return hasher.hexdigest()


def fingerprints_of(root: Path = SOURCE_ROOT.parent) -> Fingerprints:
    """The fingerprints of the project in a folder; of the installed package if the folder holds no sources.

    Nothing is written unless their `save` is called, as it is where Snakemake plans and by the command `marsedl`.
    """
    return _fingerprints_of(Path(root).resolve())


@cache
def _fingerprints_of(root: Path) -> Fingerprints:
    scripts = root / "workflow" / "scripts"
    if not (root / "src" / "marsedl").is_dir():
        return Fingerprints(SOURCE_ROOT / "marsedl" / "__pycache__" / "fingerprints.json", SOURCE_ROOT, scripts)
    return Fingerprints(root / ".cache" / "fingerprints.json", root / "src", scripts)


# -------------------------------------------------------------------------------------------------- modules, statements


class _Import(NamedTuple):
    """A name that an absolute import binds."""

    bound: str
    module: str
    symbol: tuple[str, ...]  # the name taken from the module, if one is
    loads: str  # the module that is loaded: `a.b` of `import a.b`, which binds `a`


class _Uses(NamedTuple):
    """What a statement refers to."""

    chains: set[tuple[str, ...]]  # ("steering", "steer") of `steering.steer`
    imports: list[_Import]


class _Module:
    """A source file: its statements by what they are for."""

    def __init__(self, name: str, path: Path, tree: ast.Module):
        """Sort the statements; docstrings are taken out of them."""
        self.name, self.path, self.statements = name, path, tree.body
        self.signatures = {s.name: _signature(s) for s in tree.body if isinstance(s, _FUNCTIONS)}
        for node in ast.walk(tree):
            if isinstance(node, (*_FUNCTIONS, ast.ClassDef, ast.Module)):
                node.body[:] = [s for s in node.body if not isinstance(getattr(s, "value", None), ast.Constant)
                                or not isinstance(s, ast.Expr)]  # fmt: skip
        self.definitions: dict[str, list[ast.stmt]] = {}
        self.effects: list[ast.stmt] = []  # they act at import
        self.imports: dict[str, list[_Import]] = {}
        self.loads: set[str] = set()
        for statement in self.statements:
            names = _defined(statement)
            for defined in names:
                self.definitions.setdefault(defined, []).append(statement)
            if not names:
                for taken in _uses(statement).imports:
                    self.imports.setdefault(taken.bound, []).append(taken)
                    self.loads |= {taken.loads, ".".join((taken.module, *taken.symbol))}
                if not isinstance(statement, (*_IMPORTS, ast.Pass)):
                    self.effects.append(statement)


@cache
def _parse(name: str, path: Path, source: bytes) -> _Module:
    try:
        return _Module(name, path, ast.parse(source, filename=path))
    except SyntaxError as error:
        raise MarsedlError(f"{path}, line {error.lineno}: {error.msg}: fix the syntax and run again") from error
    except ValueError as error:
        raise MarsedlError(f"{path}: {error}: fix the file and run again") from error


def _parsed(name: str, path: Path) -> _Module:
    """Read a module; remembered by its content, so that an edit within one process is seen."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such file: correct its name")
    return _parse(name, path, path.read_bytes())


def _signature(function: ast.FunctionDef) -> dict:
    """What a function declares, see `Fingerprints.functions`."""
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


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a statement defines if it does nothing else."""
    if isinstance(statement, (*_FUNCTIONS, ast.ClassDef)):
        return {statement.name}
    if not isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        return set()
    nodes = [node for target in getattr(statement, "targets", None) or [statement.target] for node in ast.walk(target)]
    if any(isinstance(node, ast.Attribute | ast.Subscript) for node in nodes):
        return set()  # an item or an attribute of something else is changed
    return {node.id for node in nodes if isinstance(node, ast.Name)}


_text = cache(ast.dump)  # a statement without comments, docstrings and positions


@cache
def _uses(statement: ast.stmt) -> _Uses:
    """All names, attribute chains and imports in a statement; a parameter hides the module's definition of its name."""
    uses, pending = _Uses(set(), []), [(statement, frozenset())]
    while pending:
        node, hidden = pending.pop()
        if isinstance(node, _IMPORTS):
            uses.imports.extend(_imported(node))
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
    imports = (node for node in ast.walk(function) if isinstance(node, _IMPORTS))
    names = {node.arg for node in ast.walk(function.args) if isinstance(node, ast.arg)}
    return names - {taken.bound for statement in imports for taken in _imported(statement)}


def _imported(statement: ast.Import | ast.ImportFrom) -> Iterator[_Import]:
    """The names that an absolute import binds."""
    for alias in statement.names:
        if isinstance(statement, ast.ImportFrom):
            yield _Import(alias.asname or alias.name, statement.module, (alias.name,), statement.module)
        else:
            bound = alias.asname or alias.name.partition(".")[0]
            yield _Import(bound, alias.name if alias.asname else bound, (), alias.name)


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
        for statement in (node for node in nodes if isinstance(node, ast.Assign)):
            target, value = statement.targets[0], statement.value
            several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            for name, source in zip(target.elts, value.elts, strict=False) if several else [(target, value)]:
                if isinstance(name, ast.Name) and (chain := typed(source)):
                    types.setdefault(name.id, chain)
        read.update(chain for node in nodes if (chain := typed(node)))
    return frozenset(read)


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


class _Reached:
    """All that can be reached from some code, collected by following its references."""

    def __init__(self, source: Fingerprints):
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
        self._script = list(map(_text, script.statements))
        self._pending += [(script, statement) for statement in script.statements]
        self._run()

    def follow(self, name: str, attributes: tuple[str, ...]) -> None:
        """Follow `module.attribute...` and all that it refers to."""
        self._follow(name, attributes)
        self._run()

    def _run(self) -> None:
        while self._pending:
            module, statement = self._pending.pop()
            chains, imports = _uses(statement)
            for taken in imports:
                self._load(taken.loads)
                self._load(".".join((taken.module, *taken.symbol)))
            for first, *attributes in chains:
                if first in module.definitions:
                    self._add(module, first)
                self._follow_imports(module, first, attributes)
                for taken in imports:
                    if taken.bound == first:
                        self._follow(taken.module, (*taken.symbol, *attributes))

    def _follow_imports(self, module: _Module, bound: str, attributes) -> None:
        for taken in module.imports.get(bound, ()):
            self._bindings.add((module.name, *taken))
            self._follow(taken.module, (*taken.symbol, *attributes))

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
        if not first:
            for symbol in module.definitions:
                self._add(module, symbol)
            for bound in module.imports:
                self._follow_imports(module, bound, ())
        elif first in module.definitions or first in module.imports:
            if first in module.definitions:
                self._add(module, first)
            self._follow_imports(module, first, rest)
        elif self.source.module(f"{name}.{first}"):
            self._follow(f"{name}.{first}", rest)
        elif "__getattr__" in module.definitions:
            self._add(module, "__getattr__")

    def _add(self, module: _Module, symbol: str) -> None:
        if (module.name, symbol) not in self._symbols:
            self._symbols.add((module.name, symbol))
            self._pending += [(module, statement) for statement in module.definitions[symbol]]

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
        """See `Fingerprints.symbols`."""
        effects = {(name, "(at import)") for name in self._loaded if self.source.module(name).effects}
        return sorted(f"{module}:{symbol}" for module, symbol in self._symbols | effects)

    def digest(self) -> str:
        """SHA-256 of all reached statements and of the imports that bind the names in use."""
        parts = [*self._script, *map(repr, sorted(self._bindings))]
        for name in sorted(self._loaded):
            module = self.source.module(name)
            definitions = [s for symbol in module.definitions if (name, symbol) in self._symbols
                           for s in module.definitions[symbol]]  # fmt: skip
            reached = set(map(id, [*definitions, *module.effects]))
            statements = [statement for statement in module.statements if id(statement) in reached]
            # Functions may stand in any order, but the order of what is executed at import matters.
            executed = [_text(statement) for statement in statements if not isinstance(statement, _FUNCTIONS)]
            functions = sorted(_text(statement) for statement in statements if isinstance(statement, _FUNCTIONS))
            parts += [name, *executed, *functions]
        return hashlib.sha256("\n".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
