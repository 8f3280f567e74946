"""A user's own law in one file: read, checked, and made into what residents are.

A Python file defines `guide`, a law of `marsedl.fly`, and if it needs them

    Parameters      NamedTuple of what the law asks for as `law`; fields without a default come from `prepare`
    prepare         function of the onboard model, in plain Python, that returns `Parameters`; once before the flights
    TUNED           mapping from at most four names to the least and the largest value that is tried, both positive

A tuned number is an argument of `prepare`, if that has one of its name, or else a field of `Parameters`. A CSV file is
a `GainTable` against its first column.
"""

import importlib.util
import inspect
import sys
import traceback
from collections.abc import Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from marsedl.fly.declared import is_number
from marsedl.fly.laws import GainTable
from marsedl.models.density_table import read_table
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.scenarios.scenario import Resident
from marsedl.words import described, remedy, require

__all__ = ["own_law", "told_in_a_sentence"]


def own_law(path: Path) -> Resident:
    """The law of a file, as a resident.

    Args:
        path: Python file, or CSV file of a gain table. Modules beside it are read as they are now.

    Raises:
        InputError: one sentence with file, line and remedy: for a file that cannot be read or run, that has no `guide`,
            or whose parts do not fit together.
    """
    path = Path(path).absolute()
    with told_in_a_sentence(path):
        require(path.is_file() and path.suffix in (".py", ".csv"), f"{path}: there is no such law, a .py or .csv file")
        return _of_table(path) if path.suffix == ".csv" else _of_module(path, _module(path))


def _of_table(path):
    """The gain table of a CSV file, against its first column."""
    header, _, _ = read_table(str(path), "gain table")
    table = GainTable(path, header[0] if header else "velocity")
    return Resident(f"gain table against {table.against}", lambda onboard: table)


def _of_module(path, module):
    """The law of a module, whose parts are checked."""
    guide, prepare, kind = (getattr(module, name, None) for name in ("guide", "prepare", "Parameters"))
    others = ", ".join(name for name, value in vars(module).items() if inspect.isfunction(value))
    require(
        inspect.isfunction(guide),
        f"{path}: there is no function 'guide', the law; write one, such as 'def guide(velocity, range):'"
        + (f", or rename one of {others}" if others else ""),
    )
    require(
        kind is None or hasattr(kind, "_fields"),
        f"{path}: Parameters is no NamedTuple; write 'class Parameters(NamedTuple):'",
    )
    require(
        prepare is None or kind is not None,
        f"{path}: prepare returns what the law asks for as 'law': define 'class Parameters(NamedTuple):' for it",
    )
    require(
        kind is None or "law" in inspect.signature(guide).parameters,
        f"{path}: guide does not ask for 'law', so that it never sees its Parameters: add the argument",
    )
    fields = getattr(kind, "_fields", ())
    missing = [name for name in fields if name not in kind._field_defaults]
    require(
        prepare or not missing,
        f"{path}: Parameters has no {', '.join(missing)}: give a default, or write 'def prepare(onboard):'",
    )
    asked = [*inspect.signature(prepare).parameters][1:] if prepare else []
    tuned = getattr(module, "TUNED", {})
    _check_tuned(path, tuned, [*asked, *fields])
    words = (module.__doc__ or f"the law of {path.name}").strip().splitlines()[0].removesuffix(".")
    return Resident(words, partial(_designed, path, module, asked) if kind else lambda onboard: guide, tuned)


def _check_tuned(path, tuned, known):
    example = 'such as TUNED = {"gain": (0.1, 10.0)}'
    require(isinstance(tuned, Mapping) and len(tuned) <= 4, f"{path}: TUNED names at most four numbers, {example}")
    for name, bounds in tuned.items():
        require(name in known, f"{path}: TUNED names {name!r}, which is no parameter; {remedy(name, known)}")
        good = isinstance(bounds, tuple) and len(bounds) == 2 and all(map(is_number, bounds))
        require(
            good and 0.0 < bounds[0] < bounds[1],
            f"{path}: TUNED of {name!r} is {bounds!r}; give the least and the largest value, both positive, {example}",
        )


def _designed(path, module, asked, onboard, **tuned):
    """The law of a module with its parameters; asked: what `prepare` asks for beside the onboard model."""
    prepare, kind = getattr(module, "prepare", None), module.Parameters
    with told_in_a_sentence(path), _beside(path.parent):
        own = {name: value for name, value in tuned.items() if name in asked}
        parameters = prepare(onboard, **own) if prepare else kind()
        require(
            isinstance(parameters, kind),
            f"{described(prepare)} returned {type(parameters).__name__}; return Parameters(...)",
        )
        return partial(module.guide, law=parameters._replace(**{n: v for n, v in tuned.items() if n not in asked}))


@contextmanager
def told_in_a_sentence(path: Path):
    """Raise what goes wrong in a law's file, or in modules beside it, as InputError with file and line."""
    try:
        yield
    except MarsedlError:
        raise
    except SyntaxError as error:
        raise InputError(f"{error.filename}, line {error.lineno}: {error.msg}; correct the syntax") from error
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if Path(frame.filename).parent == path.parent]
        said = f"{type(error).__name__}: {error}"
        if own:
            raise InputError(f"{own[-1].filename}, line {own[-1].lineno}, in {own[-1].name}: {said}") from error
        raise InputError(str(error) if isinstance(error, ValueError | TypeError) else f"{path}: {said}") from error


def _module(path):
    """The module of a law's file; what lies beside it is imported as it is now on disk."""
    for name in [name for name in sys.modules if name.partition(".")[0] in _IMPORTED]:
        top = path.parent / name.partition(".")[0]
        if top.is_dir() or top.with_suffix(".py").exists():
            del sys.modules[name]
    spec = importlib.util.spec_from_file_location(f"own_law_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    with _beside(path.parent):
        spec.loader.exec_module(module)
    return module


_IMPORTED = set()  # names of modules that lie beside a law; numba finds what it has cached by them


@contextmanager
def _beside(folder):
    """Within it, modules of a folder may be imported.

    Raises InputError for one that has the name of a module of Python, whose edits compiled flights do not see.
    """
    before, writes = {*sys.modules}, sys.dont_write_bytecode
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True  # an edit within the second, of the same size, would read what was kept
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.dont_write_bytecode = writes
        new = [name for name in sys.modules if name not in before and "." not in name]
        own = {name for name in new if _lies_in(folder, sys.modules[name])}
        _IMPORTED.update(own)
    for name in own & sys.stdlib_module_names:
        raise InputError(f"{folder / name}.py has the name of a module of Python; rename it")


def _lies_in(folder, module):
    """Whether a module, or a package, lies in a folder."""
    places = (getattr(module, "__file__", None), *getattr(module, "__path__", ()))
    return any(place and Path(place).parent == folder for place in places)
