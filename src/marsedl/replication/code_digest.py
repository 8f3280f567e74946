"""Digests of the code that a stage can reach, so that edits of imported modules rerun what uses them.

Snakemake sees an edited script, but not an edited module that the script imports. A code digest in a rule's params
closes the gap. It covers, at the granularity of module-level symbols, everything inside the source folder that a
function can reach through names and imports, and leaves out comments, docstrings and formatting: an edit of shared
physics reruns its users, an edit of its neighbour in the same file or of a comment reruns nothing.

What counts:

- the function itself and, transitively, every module-level definition (function, class, assignment) whose name occurs
  in something that counts: in its body, decorators, default arguments, base classes, annotations;
  a parameter hides the module's definition of its name;
- names from other modules, through every form of import, also inside functions and through re-exports;
- `alias.symbol` for a module alias; a module used in any other way (passed on, `import *`) counts whole, and a package
  then with all its submodules;
- of every module that gets imported: the statements that do something at import (`np.seterr(...)`, `TABLE["x"] = f`,
  `if`, `try`, loops), with what they reference;
- a class counts whole, and so does the module of a function that calls `globals`, `eval` or `exec`.

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
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from marsedl.replication.errors import InputError, MarsedlError

SOURCE_ROOT = Path(__file__).parents[2]
MACHINERY = frozenset(
    f"marsedl.replication.{name}"
    for name in (
        *("artifacts", "code_digest", "digests", "errors", "jobs", "kernels", "libraries", "recipes", "sharing"),
        *("staleness", "terminal"),
    )
)

_AT_IMPORT = "(at import)"
_SCRIPT = "(script)"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_SCOPES = (*_FUNCTIONS, ast.Lambda)  # where parameters are known
_DEFINITIONS = (*_FUNCTIONS, ast.ClassDef)
_IMPORTS = (ast.Import, ast.ImportFrom)
_SEES_ITS_MODULE = ("globals", "eval", "exec")
_HARMLESS_MODULE_ATTRIBUTES = ("__name__", "__file__", "__doc__", "__package__")


def code_digest(entry: str, source_root: Path = SOURCE_ROOT) -> str:
    """SHA-256 (hexadecimal) of all code inside `source_root` that a function can reach.

    entry: "package.module:function"; source_root: the folder that holds the top-level package

    Raises InputError if there is no such module or function, MarsedlError for a module that is not valid Python.
    """
    return _facts(_closure_of(entry, source_root))[0]


def reachable_symbols(entry: str, source_root: Path = SOURCE_ROOT) -> list[str]:
    """Sorted "module:symbol" of all that `code_digest` covers; statements run at import as "module:(at import)".

    Arguments and errors as for `code_digest`.
    """
    return _closure_of(entry, source_root).listing()


def libraries(entry: str, source_root: Path = SOURCE_ROOT) -> list[str]:
    """Sorted top-level modules of the libraries whose names are used in the code that `code_digest` covers.

    An imported name that nothing reached uses does not count, nor does the standard library. Arguments and errors as
    for `code_digest`.
    """
    return _facts(_closure_of(entry, source_root))[1]


def reads(entry: str, source_root: Path = SOURCE_ROOT) -> dict[str, list[str]]:
    """Sorted attributes that the code which `code_digest` covers reads of parameters, by the names of their types.

    Of `def gravity(planet: Planet): return planet.mu` it is {"Planet": ["mu"]}. Fields of named tuples are followed: of
    `setup: Setup`, `setup.planet.mu` reads `mu` of the class that `Setup` annotates `planet` with. Arguments and errors
    as for `code_digest`.
    """
    return _facts(_closure_of(entry, source_root))[2]


def functions(package: str, source_root: Path = SOURCE_ROOT) -> dict[str, dict]:
    """Return what the functions of a package's own modules declare, by "package.module:function".

    A function has `parameters` (those that may be given by position; True for one that may be left out), `summary` (the
    first line of its docstring) and `decorators` (their literal arguments by their names).
    Raises MarsedlError for a module that is not valid Python.
    """
    declared = {}
    for path in sorted(source_root.joinpath(*package.split(".")).glob("*.py")):
        module = package if path.stem == "__init__" else f"{package}.{path.stem}"
        analysis = _parsed(module, path.stem == "__init__", str(path), path.read_bytes())
        declared |= {f"{module}:{name}": signature for name, signature in analysis.signatures.items()}
    return declared


def script_digest(path: str | Path, source_root: Path = SOURCE_ROOT) -> str:
    """SHA-256 of a script outside the package: all of its own code, and all that it can reach inside `source_root`.

    Raises InputError if there is no such file, MarsedlError for code that is not valid Python.
    """
    return _facts(_closure_of_script(path, source_root))[0]


def script_libraries(path: str | Path, source_root: Path = SOURCE_ROOT) -> list[str]:
    """Of a script what `libraries` is of a function; errors as for `script_digest`."""
    return _facts(_closure_of_script(path, source_root))[1]


def kernels_digest(source_root: Path = SOURCE_ROOT) -> str:
    """SHA-256 of all code that numba's cached kernels can reach, see `kernels`."""
    closure = _Closure(source_root)
    for entry in kernels(source_root):
        closure.add_entry(*entry.split(":"))
    return closure.digest()


def kernels(source_root: Path = SOURCE_ROOT) -> list[str]:
    """Return the functions that numba compiles and caches, "package.module:function".

    These are decorated with `njit(..., cache=True)`, or with a function of their module that calls `njit`.
    Raises MarsedlError for a module that is not valid Python.
    """
    digests = []
    for path in sorted(source_root.rglob("*.py")):
        name = ".".join(path.relative_to(source_root).with_suffix("").parts).removesuffix(".__init__")
        module = _parsed(name, path.stem == "__init__", str(path), path.read_bytes())
        uses = zip(module.functions, module.uses, strict=True)
        compilers = {function for function, used in uses if function and ("njit",) in used.chains}
        for function, signature in module.signatures.items():
            decorators = signature["decorators"]
            if decorators.get("njit", {}).get("cache") or compilers & decorators.keys():
                digests.append(f"{name}:{function}")
    return digests


class RememberedDigests:
    """The digests of this module, remembered in a file for as long as no source file and no script changes.

    Computing them means to parse all of the source, which every run of Snakemake would have to do anew. The memory is
    keyed by the bytes of all files and the version of Python: it can be lost, but not be wrong.
    """

    def __init__(self, memory: Path, source_root: Path, scripts: Path):
        """Take the file that remembers, the folder of the package and that of the scripts."""
        self._memory, self._source_root, self._scripts = memory, source_root, scripts
        self._key, self._digests = self._key_now(), {}
        try:
            remembered = json.loads(memory.read_text(encoding="utf-8"))
            if remembered["key"] == self._key:
                self._digests = dict(remembered["digests"])
        except (OSError, ValueError, LookupError, TypeError):
            pass  # nothing remembered, or nothing that can be used
        self._known = len(self._digests)
        atexit.register(self.save)

    def kernels(self) -> str:
        """See `kernels_digest`."""
        return self._of("kernels", lambda: kernels_digest(self._source_root))

    def code(self, entry: str) -> str:
        """See `code_digest`."""
        return self._code(entry)[0]

    def libraries(self, entry: str) -> list[str]:
        """See `libraries`."""
        return self._code(entry)[1]

    def reads(self, entry: str) -> dict[str, list[str]]:
        """See `reads`."""
        return self._code(entry)[2]

    def functions(self, package: str) -> dict[str, dict]:
        """See `functions`."""
        return self._of(f"functions {package}", lambda: functions(package, self._source_root))

    def script(self, name: str) -> str:
        """See `script_digest`."""
        return self._script(name)[0]

    def script_libraries(self, name: str) -> list[str]:
        """See `script_libraries`."""
        return self._script(name)[1]

    def _code(self, entry: str) -> tuple[str, list[str], dict[str, list[str]]]:
        return self._of(f"code {entry}", lambda: _facts(_closure_of(entry, self._source_root)))

    def _script(self, name: str) -> tuple[str, list[str], dict[str, list[str]]]:
        path = self._scripts / name
        return self._of(f"script {name}", lambda: _facts(_closure_of_script(path, self._source_root)))

    def save(self) -> None:
        """Write what was computed, if no file has changed meanwhile; where nothing can be written, forget it."""
        if len(self._digests) == self._known or self._key_now() != self._key:
            return
        with contextlib.suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            partial = self._memory.with_name(f"{self._memory.name}.{os.getpid()}")
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


def _closure_of(entry: str, source_root: Path) -> "_Closure":
    module_name, _, symbol = entry.partition(":")
    closure = _Closure(source_root)
    module = closure.module(module_name)
    if module is None:
        raise InputError(f"{entry}: there is no module '{module_name}' in {source_root}: correct its name")
    symbol = symbol.partition(".")[0]
    names = {*module.definitions, *module.imports, *module.bound_by_effects}
    if symbol not in names:
        import difflib

        near = difflib.get_close_matches(symbol, sorted(names), n=1)
        hint = f", the nearest name is '{near[0]}'" if near else ""
        raise InputError(f"{entry}: {module.path} defines no '{symbol}'{hint}: name it as 'package.module:function'")
    closure.add_entry(module_name, symbol)
    return closure


def _closure_of_script(path: str | Path, source_root: Path) -> "_Closure":
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such script: correct its name")
    closure = _Closure(source_root)
    closure.add_script(_parsed(_SCRIPT, False, str(path), path.read_bytes()))
    return closure


def _facts(closure: "_Closure") -> tuple[str, list[str], dict[str, list[str]]]:
    """Digest and libraries of some code, and what it reads of its parameters."""
    script = closure.module(_SCRIPT)
    digest = closure.digest()
    combined = _sha256([script.text, digest]) if script else digest
    return combined, sorted(closure.libraries), closure.reads()


def _sha256(parts: Iterable[str]) -> str:
    hasher = hashlib.sha256()
    for part in parts:
        hasher.update(f"{len(part)}:{part}\n".encode("utf-8", "surrogatepass"))
    return hasher.hexdigest()


# ------------------------------------------------------------------------------------------------------- one statement


@dataclass(frozen=True)
class _Import:
    """One name bound by an import statement."""

    bound: str  # the local name, or "*"
    module: str  # absolute name of the module
    symbol: str | None  # the name taken from it; None binds the module itself
    loads: str  # the module that gets imported: of `import a.b`, which binds `a`, it is `a.b`


@dataclass
class _Uses:
    """What a statement refers to."""

    chains: set[tuple[str, ...]] = field(default_factory=set)  # ("steering", "steer") of `steering.steer`
    imports: list[_Import] = field(default_factory=list)  # import statements inside of it
    binds: set[str] = field(default_factory=set)  # names that it assigns, in whatever scope


def _text(node: ast.AST) -> str:
    """Canonical text of a syntax tree, from which docstrings are deleted: without positions and formatting."""
    for part in ast.walk(node):
        if isinstance(part, _DEFINITIONS) and _is_docstring(part.body[0]):
            del part.body[0]
    return ast.dump(node)


def _is_docstring(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def _collect(node: ast.AST, package: str, uses: _Uses) -> None:
    """Add to `uses` all names, attribute chains and imports in a syntax tree; a parameter hides a module's name."""
    pending: list[tuple[ast.AST, frozenset[str]]] = [(node, frozenset())]
    while pending:
        node, hidden = pending.pop()
        kind = type(node)
        if kind is ast.Name:
            if node.id not in hidden:
                uses.chains.add((node.id,))
            if type(node.ctx) is not ast.Load:
                uses.binds.add(node.id)
        elif kind is ast.Attribute:
            attributes = []
            base: ast.AST = node
            while type(base) is ast.Attribute:
                attributes.append(base.attr)
                base = base.value
            if type(base) is not ast.Name:
                pending.append((base, hidden))
            elif base.id not in hidden:
                uses.chains.add((base.id, *reversed(attributes)))
        elif kind in _IMPORTS:
            uses.imports += _imports(node, package)
        elif kind is not ast.Constant:
            if kind in _DEFINITIONS:
                uses.binds.add(node.name)
            inside = hidden | _parameters(node) if kind in _SCOPES else hidden
            for name in kind._fields:
                value = getattr(node, name, None)
                within = inside if name == "body" else hidden
                if isinstance(value, ast.AST):
                    pending.append((value, within))
                elif type(value) is list:
                    pending += [(item, within) for item in value if isinstance(item, ast.AST)]
                if name in ("annotation", "returns") and value is not None:
                    pending += [(quoted, hidden) for quoted in _quoted_annotations(value)]


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> set[str]:
    """The names of a function's parameters but for those that an import inside of it binds anew."""
    arguments = function.args
    several = [parameter for parameter in (arguments.vararg, arguments.kwarg) if parameter]
    names = {parameter.arg for parameter in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, *several)}
    imported = [node for node in ast.walk(function) if isinstance(node, _IMPORTS)]
    return names - {alias.asname or alias.name.partition(".")[0] for node in imported for alias in node.names}


def _quoted_annotations(annotation: ast.AST) -> Iterator[ast.AST]:
    """The expressions in the strings of an annotation such as `list["Planet"]`."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            try:
                yield ast.parse(node.value, mode="eval").body
            except (SyntaxError, ValueError):
                continue  # a string of another kind, as in Literal["..."]


def _imports(statement: ast.Import | ast.ImportFrom, package: str) -> Iterator[_Import]:
    """The names that an import statement binds; `package` is where relative imports start."""
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            if alias.asname:
                yield _Import(alias.asname, alias.name, None, alias.name)
            else:
                top = alias.name.partition(".")[0]
                yield _Import(top, top, None, alias.name)
        return
    source = statement.module or ""
    if statement.level:
        parts = package.split(".") if package else []
        parts = parts[: len(parts) - (statement.level - 1)]
        source = ".".join([*parts, source] if source else parts)
    for alias in statement.names:
        yield _Import(alias.asname or alias.name, source, alias.name, source)


# --------------------------------------------------------------------------------------------------------- one module


class _Module:
    """What the syntax tree of a module says, by its statements, which are sorted by what they are for."""

    def __init__(self, name: str, is_package: bool, path: str, tree: ast.Module) -> None:
        self.name, self.is_package, self.path = name, is_package, path
        self._package = name if is_package else name.rpartition(".")[0]
        self.definitions: dict[str, list[int]] = {}  # name -> statements that define it
        self.effects: list[int] = []  # statements that act at import
        self.module_imports: list[_Import] = []  # executed when the module is imported
        self.bound_by_effects: set[str] = set()
        self.uses = [_Uses() for _ in tree.body]
        for index, statement in enumerate(tree.body):
            _collect(statement, self._package, self.uses[index])
            self._sort_in(index, statement)
        self.imports: dict[str, list[_Import]] = {}  # bound name -> what it is bound to
        for imported in self.module_imports:
            self.imports.setdefault(imported.bound, []).append(imported)
        self.stars = self.imports.pop("*", [])
        self.functions = [s.name if isinstance(s, _FUNCTIONS) else None for s in tree.body]  # names, by statement
        self.reads = [_reads(statement) for statement in tree.body]  # of parameters
        self.fields = [_fields(statement) for statement in tree.body]  # of named tuples
        self.signatures = {s.name: _signature(s) for s in tree.body if isinstance(s, _FUNCTIONS)}
        documented = bool(tree.body) and _is_docstring(tree.body[0])
        self.texts = [_text(statement) for statement in tree.body]  # canonical
        self.text = "\n".join(self.texts[documented:])

    def _sort_in(self, index: int, statement: ast.stmt) -> None:
        if isinstance(statement, _IMPORTS):
            self.module_imports += _imports(statement, self._package)
            return
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            return  # a docstring, or a string used as a comment
        if isinstance(statement, ast.Pass):
            return
        if isinstance(statement, _DEFINITIONS):
            self.definitions.setdefault(statement.name, []).append(index)
            return
        targets = _plain_targets(statement)
        if targets is not None:
            walrus = {node.target.id for node in ast.walk(statement) if isinstance(node, ast.NamedExpr)}
            for name in targets | walrus:
                self.definitions.setdefault(name, []).append(index)
            return
        self.effects.append(index)
        self.module_imports += self.uses[index].imports
        self.bound_by_effects |= self.uses[index].binds


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


def _reads(statement: ast.stmt) -> dict[str, list[str]]:
    """The attributes that functions in a statement read of their parameters, by the names of the parameters' types.

    Attributes of attributes are "planet.mu". A local variable stands for what it is assigned first: after
    `planet = setup.planet`, which may be one of several in a line, `planet.mu` reads `setup.planet.mu`.
    """
    read: dict[str, set[str]] = {}
    for function in ast.walk(statement):
        if not isinstance(function, _FUNCTIONS):
            continue
        arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        types = {parameter.arg: (kind,) for parameter in arguments if (kind := _type_name(parameter.annotation))}
        nodes = list(ast.walk(function))
        for target, value in (pair for node in nodes if isinstance(node, ast.Assign) for pair in _assigned(node)):
            if isinstance(target, ast.Name) and (chain := _chain(value, types)):
                types.setdefault(target.id, chain)
        for node in nodes:
            if chain := _chain(node, types):
                read.setdefault(chain[0], set()).add(".".join(chain[1:]))
    return {kind: sorted(attributes) for kind, attributes in read.items()}


def _assigned(statement: ast.Assign) -> list[tuple[ast.expr, ast.expr]]:
    """The targets of an assignment with their values, one by one where both are written as tuples."""
    target, value = statement.targets[0], statement.value
    several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
    return list(zip(target.elts, value.elts, strict=False)) if several else [(target, value)]


def _chain(node: ast.AST, types: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """The type and the attributes of `name.attribute...` where the name is known, else nothing."""
    attributes: list[str] = []
    while isinstance(node, ast.Attribute):
        attributes.insert(0, node.attr)
        node = node.value
    has_type = attributes and isinstance(node, ast.Name) and node.id in types
    return (*types[node.id], *attributes) if has_type else ()


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


def _plain_targets(statement: ast.stmt) -> set[str] | None:
    """The names that a statement assigns if it assigns nothing but names, else None."""
    if isinstance(statement, ast.Assign):
        pending = list(statement.targets)
    elif isinstance(statement, ast.AnnAssign | ast.AugAssign):
        pending = [statement.target]
    else:
        return None
    names = set()
    while pending:
        target = pending.pop()
        if isinstance(target, ast.Name):
            names.add(target.id)
        elif isinstance(target, ast.Tuple | ast.List):
            pending += target.elts
        elif isinstance(target, ast.Starred):
            pending.append(target.value)
        else:
            return None  # an item or an attribute of something else is changed
    return names


@cache
def _parsed(name: str, is_package: bool, path: str, source: bytes) -> _Module:
    """Analyse a module; remembered by its content, so that an edit within one process is seen."""
    try:
        tree = ast.parse(source, filename=path)
    except SyntaxError as error:
        raise MarsedlError(f"{path}, line {error.lineno}: {error.msg}: fix the syntax and run again") from error
    except (ValueError, RecursionError) as error:
        raise MarsedlError(f"{path}: {error}: fix the file and run again") from error
    return _Module(name, is_package, path, tree)


# -------------------------------------------------------------------------------------------------------- the closure


class _Closure:
    """All that can be reached from some code, collected by following its references."""

    def __init__(self, source_root: Path) -> None:
        self.source_root = Path(source_root)
        self.libraries: set[str] = set()  # top-level modules from outside of the source whose names are used
        self._modules: dict[str, _Module | None] = {}
        self._symbols: set[tuple[str, str]] = set()
        self._imported: set[str] = set()
        self._whole: set[str] = set()
        self._bindings: set[tuple[str, _Import]] = set()  # imported names in use, with the module that uses them
        self._followed: set[tuple[str, tuple[str, ...]]] = set()
        self._pending: list[tuple[_Module, _Uses]] = []

    def module(self, name: str) -> _Module | None:
        """The module of this name if it lies inside the source folder and counts."""
        if name in MACHINERY:
            return None
        if name not in self._modules:
            self._modules[name] = self._find(name)
        return self._modules[name]

    def _find(self, name: str) -> _Module | None:
        parts = name.split(".")
        if not all(part.isidentifier() for part in parts):
            return None
        if len(parts) > 1 and self.module(".".join(parts[:-1])) is None:
            return None
        place = self.source_root.joinpath(*parts)
        for path, is_package in ((place / "__init__.py", True), (place.with_name(f"{parts[-1]}.py"), False)):
            try:
                return _parsed(name, is_package, str(path), path.read_bytes())
            except (FileNotFoundError, NotADirectoryError):
                continue
        return _parsed(name, True, str(place), b"") if place.is_dir() else None  # a namespace package

    def add_entry(self, module_name: str, symbol: str) -> None:
        self._follow_member(module_name, (symbol,))
        self._run()

    def add_script(self, script: _Module) -> None:
        self._modules[script.name] = script
        self._load_imports(script.module_imports)
        self._pending += [(script, uses) for uses in script.uses]
        self._run()

    def _run(self) -> None:
        while self._pending:
            module, uses = self._pending.pop()
            self._load_imports(uses.imports)
            local: dict[str, list[_Import]] = {}
            for imported in uses.imports:
                local.setdefault(imported.bound, []).append(imported)
            for chain in uses.chains:
                self._follow_name(module, local, chain)

    def _follow_name(self, module: _Module, local: dict[str, list[_Import]], chain: tuple[str, ...]) -> None:
        """Follow a name, perhaps with attributes, that occurs in `module`."""
        name = chain[0]
        if name in module.definitions:
            self._add_symbol(module, name)
        for imported in module.imports.get(name, ()):
            self._bindings.add((module.name, imported))
            self._follow_import(imported, chain[1:])
        for imported in local.get(name, ()):
            self._follow_import(imported, chain[1:])
        if name in _SEES_ITS_MODULE or chain[:2] == ("sys", "modules"):
            self._add_whole(module.name)

    def _follow_import(self, imported: _Import, attributes: tuple[str, ...]) -> None:
        if imported.symbol is not None:
            attributes = (imported.symbol, *attributes)
        self._follow_member(imported.module, attributes)

    def _follow_member(self, module_name: str, attributes: tuple[str, ...]) -> None:
        """Follow `module.attribute...`; without attributes the module is used as an object and counts whole."""
        if (module_name, attributes) in self._followed:
            return
        self._followed.add((module_name, attributes))
        module = self.module(module_name)
        if module is None:
            self._add_library(module_name)
            return
        self._import_module(module_name)
        if not attributes:
            self._add_whole(module_name)
            return
        name, further_attributes = attributes[0], attributes[1:]
        is_bound = name in module.bound_by_effects or name in _HARMLESS_MODULE_ATTRIBUTES
        if name in module.definitions:
            is_bound = True
            self._add_symbol(module, name)
        for imported in module.imports.get(name, ()):
            is_bound = True
            self._bindings.add((module_name, imported))
            self._follow_import(imported, further_attributes)
        if module.is_package and self.module(f"{module_name}.{name}") is not None:
            is_bound = True
            self._follow_member(f"{module_name}.{name}", further_attributes)
        if "__getattr__" in module.definitions and not is_bound:
            self._add_symbol(module, "__getattr__")
        elif not is_bound and not module.stars:  # what a star brings counts whole already
            self._add_whole(module_name)

    def _add_library(self, module_name: str) -> None:
        top = module_name.partition(".")[0]
        if top not in sys.stdlib_module_names and self.module(top) is None:
            self.libraries.add(top)

    def _add_symbol(self, module: _Module, name: str) -> None:
        if (module.name, name) not in self._symbols:
            self._symbols.add((module.name, name))
            self._pending += [(module, module.uses[index]) for index in module.definitions[name]]

    def _add_whole(self, module_name: str) -> None:
        """Everything in a module counts, and of a package everything below it too."""
        module = self.module(module_name)
        if module is None:
            self._add_library(module_name)
        if module is None or module_name in self._whole:
            return
        self._whole.add(module_name)
        self._import_module(module_name)
        for name in module.definitions:
            self._add_symbol(module, name)
        for imported in (imported for names in module.imports.values() for imported in names):
            self._bindings.add((module_name, imported))
            self._follow_import(imported, ())
        if module.is_package:
            for path in sorted(self.source_root.joinpath(*module_name.split(".")).iterdir()):
                if path.suffix == ".py" or (path.is_dir() and path.name != "__pycache__"):
                    self._add_whole(f"{module_name}.{path.stem}")

    def _load_imports(self, imports: Iterable[_Import]) -> None:
        """Execute import statements: modules are imported even where none of their names is used."""
        for imported in imports:
            self._import_module(imported.loads)
            if imported.symbol == "*":
                self._add_whole(imported.module)
            elif imported.symbol is not None:
                parent = self.module(imported.module)
                if parent is not None and parent.is_package:
                    self._import_module(f"{imported.module}.{imported.symbol}")

    def _import_module(self, name: str) -> None:
        """Importing a module runs the statements of it and of its packages that act at import."""
        module = self.module(name)
        if module is None or name in self._imported:
            return
        self._imported.add(name)
        self._import_module(name.rpartition(".")[0])
        self._pending += [(module, module.uses[index]) for index in module.effects]
        self._pending.append((module, _Uses(imports=module.module_imports)))

    def reads(self) -> dict[str, list[str]]:
        """What is read of parameters in all that is reached, by the names of their types; through named tuples too."""
        pending: list[tuple[str, ...]] = []
        types: dict[tuple[str, str], set[str]] = {}  # of the fields of named tuples
        for name, symbol in self._symbols:
            module = self.module(name)
            for index in module.definitions[symbol]:
                pending += [(kind, *read.split(".")) for kind, reads in module.reads[index].items() for read in reads]
                for field_name, kind in module.fields[index].items():
                    types.setdefault((symbol, field_name), set()).add(kind)
        read: dict[str, set[str]] = {}
        while pending:
            kind, attribute, *further_attributes = pending.pop()
            read.setdefault(kind, set()).add(attribute)
            if further_attributes:
                pending += [(of, *further_attributes) for of in types.get((kind, attribute), ())]
        return {kind: sorted(attributes) for kind, attributes in sorted(read.items())}

    def listing(self) -> list[str]:
        effects = {(name, _AT_IMPORT) for name in self._imported if self.module(name).effects}
        return sorted(f"{module}:{symbol}" for module, symbol in self._symbols | effects)

    def digest(self) -> str:
        """SHA-256 of all reached statements and of the imports that bind the names in use."""
        statements: dict[str, set[int]] = {}
        for name in self._imported:
            statements.setdefault(name, set()).update(self.module(name).effects)
        for name, symbol in self._symbols:
            statements.setdefault(name, set()).update(self.module(name).definitions[symbol])
        parts = [
            f"{user} imports {imported.bound} {imported.module} {imported.symbol} {imported.loads}"
            for user, imported in sorted(self._bindings, key=repr)
        ]
        for name in sorted(statements):
            module = self.module(name)
            # Functions may stand in any order, but the order of what is executed at import matters.
            functions = [index for index in statements[name] if module.functions[index]]
            executed = sorted(statements[name] - set(functions))
            functions.sort(key=lambda index: (module.functions[index], index))
            parts += [f"{name} {module.texts[index]}" for index in (*executed, *functions)]
        return _sha256(parts)
