"""Tables: data frames with one meaning, one type and one unit per column, as CSV for analysts, as Markdown for readers.

The head of a column is its name and, in brackets, its unit, `final mass (kg)`: so plain `pandas.read_csv` tells an
analyst the units. Columns are numbers, whole numbers, True and False, or words.

- CSV holds a value and its standard error in columns apart, all digits of every number (`pandas.read_csv` gives the
  same bits), `inf`, and nothing where there is no value. Only whole numbers with gaps come back as another type, float.
- Markdown is for reading: printed digits, `value ± error` or `value (lower to upper)` in one cell, a dash for no value.
  Below the table stand unit, type and meaning of every column of the CSV.

`frame` unrolls fields of a record, whose declarations hold the words and units; `table` takes any rows. pandas is
imported where a table is made: it costs a quarter of a second.
"""

import html
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from marsedl.replication.errors import nearest
from marsedl.replication.files import write_text
from marsedl.replication.records.fields import Axis, Quantity, layout, quantities
from marsedl.replication.units import PURE, converted

if TYPE_CHECKING:
    import pandas as pd

NO_VALUE = "–"
TYPES = {  # names of a column's types for readers
    "float64": "number",
    "int64": "whole number",
    "Int64": "whole number or empty",
    "bool": "True or False",
    "str": "text",
}
_Part = tuple["Column", np.ndarray, tuple[str, ...]]  # a column of a table: its values, and the dimensions of these
_COLUMNS = "columns"  # key of DataFrame.attrs, under which every column's `Column` stands by its head


@dataclass(frozen=True)
class Column:
    """What a column holds, and how readers see it."""

    unit: str = ""  # of all its values; "" for words, counts and ratios
    digits: str = ""  # format of a number for readers: ".3f"; by default four digits, and whole numbers with commas
    meaning: str = ""  # a line in words, where the name does not say it
    error: str = ""  # name of the column with the standard errors of this one, which readers see in one cell with it
    interval: tuple[str, ...] = ()  # names of the columns with the lower and upper bounds, in one cell too
    label: str = ""  # the name, where it is not the one under which the column is declared

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of the columns that readers see in one cell with this one."""
        return (*filter(None, [self.error]), *self.interval)

    def head(self, name: str) -> str:
        """Return the head of the column that is declared under this name: with its unit if it has one."""
        name, unit = self.label or name, "" if self.unit in PURE else f" ({self.unit})"
        return name if name.endswith(unit) else name + unit


def table(data: Any, columns: Mapping[str, Column]) -> "pd.DataFrame":
    """Make a table of rows, with a cell for each column in their order, or of cells by column's name.

        table(rows, {"mass": Column("kg", ".3f", error="its error"), "its error": Column("kg")})
        table({**other, "new": cells}, {**described(other), "new": Column()})        another table with a further column

    Cells None, "" and NaN are no value. Columns are float64, int64 (Int64 where there are gaps), bool or str. Whole
    numbers are float64 if the column has a unit or digits of a float, and so is a column without any value.

    Raises ValueError for a row of another length, a name twice, an error without its column, a column of mixed types.
    """
    import pandas as pd

    if not isinstance(data, Mapping):
        rows = [tuple(row) for row in data]
        if wrong := [row for row in rows if len(row) != len(columns)]:
            raise ValueError(f"a row of {len(wrong[0])} cells in a table of {len(columns)} columns: {wrong[0]}")
        data = {name: [row[number] for row in rows] for number, name in enumerate(columns)}
    if data.keys() != columns.keys():
        raise ValueError(f"cells are given for {', '.join(data)}, but the columns are {', '.join(columns)}")
    heads = {name: column.head(name) for name, column in columns.items()}
    if len(set(heads.values())) != len(heads):
        raise ValueError(f"two columns have the same head: {', '.join(heads.values())}")
    if missing := [(name, other) for name, column in columns.items() for other in column.beside if other not in heads]:
        name, other = missing[0]
        raise ValueError(f"column '{name}' has '{other}' beside it; {nearest(other, heads)}")
    result = pd.DataFrame({heads[name]: _series(heads[name], data[name], columns[name]) for name in columns})
    by_head = result.attrs[_COLUMNS] = {}
    for name, column in columns.items():
        interval = tuple(heads[other] for other in column.interval)
        by_head[heads[name]] = replace(column, error=heads.get(column.error, ""), interval=interval)
    return result


def frame(
    record: Any,
    *fields: str,
    coordinates: Mapping[str, tuple[str, Sequence]] | None = None,
    **columns: Column | str,
) -> "pd.DataFrame":
    """Unroll fields of a record over their dimensions: a row for each place, a column for each field.

        frame(certificates, "solver_status", mean_cost_ratio=".7f", solver_iterations="d")

    First stand the columns of the dimensions, in the order of the field that has most of them: the field that holds a
    dimension's coordinates (it has its name), the names of the components of an `Axis`, else numbers from 1 under the
    name without its plural's s. A field with fewer dimensions repeats its values. A field whose components have units
    of their own gets a column for each component.

    record: an artifact; label, unit and meaning of a column are those of its fields
    fields: names of fields, shown with four digits
    coordinates: other names and values of dimensions: `{"laws": ("law", ["open loop", "feedback"])}`
    columns: further fields with their digits, or a `Column` whose entries, where it has any, stand instead of the
        field's; values are converted to its unit (rad to deg, m to km, 1 to %). Fields of coordinates are given here
        only to say their digits.

    Raises ValueError: there is no such field, it is in mixed units ("SI"), or there is no such conversion.
    """
    kind, coordinates = type(record), coordinates or {}
    declared, dimensions = quantities(kind), layout(kind)
    selected = {name: Column(digits=column) if isinstance(column, str) else column for name, column in columns.items()}
    selected = dict.fromkeys(fields, Column()) | selected
    if unknown := [name for name in selected if name not in declared]:
        raise ValueError(f"{kind.__name__} has no field '{unknown[0]}'; {nearest(unknown[0], declared)}")

    def parts(name: str) -> dict[str, _Part]:
        array, column = np.asarray(getattr(record, name)), selected.get(name, Column())
        return _parts(name, array, declared[name], dimensions.dims[name], column)

    along = [name for name in selected if dimensions.dims[name] == (name,)]
    found = {key: part for name in selected if name not in along for key, part in parts(name).items()}
    widest_first = sorted(found.values(), key=lambda part: -len(part[2]))
    extents = {dim: n for _, array, dims in widest_first for dim, n in zip(dims, array.shape, strict=True)}
    extents |= {name: len(getattr(record, name)) for name in along}
    places: dict[str, _Part] = {}
    for dim, extent in extents.items():
        axis = dimensions.axes[dim]
        if dim in coordinates:
            name, values = coordinates[dim]
            places[dim] = Column(label=name), np.array(values), (dim,)
        elif dim in dimensions.fields:
            places |= parts(dim)
        elif axis:
            places[dim] = Column(), np.array([axis.label(name) for name in axis.names]), (dim,)
        else:
            places[dim] = Column(label=dim.removesuffix("s"), digits="d"), np.arange(1, extent + 1), (dim,)
    every = places | found
    cells = {name: _unrolled(array, dims, extents) for name, (_, array, dims) in every.items()}
    return table(cells, {name: column for name, (column, _, _) in every.items()})


def _parts(name: str, array: np.ndarray, declared: Quantity, dims: tuple[str, ...], column: Column) -> dict[str, _Part]:
    """Columns of a field with their values and dimensions: one for each component if these differ in their unit."""
    units = declared.unit.split(", ")
    column = replace(column, label=column.label or declared.label, meaning=column.meaning or declared.meaning)
    if units == ["SI"]:
        raise ValueError(f"field '{name}' is in mixed units: write columns of single components with `table`")
    if len(units) == 1:
        unit = column.unit or declared.unit
        return {name: (replace(column, unit=unit), converted(array, declared.unit, unit, name), dims)}
    place = max(number for number, extent in enumerate(array.shape) if extent == len(units))
    axis, dims = declared.dims[place], dims[:place] + dims[place + 1 :]
    names = [axis.label(name) for name in axis.names] if isinstance(axis, Axis) else range(1, len(units) + 1)
    labels = [f"{column.label}: {component}" for component in names]
    return {
        f"{name}: {label}": (replace(column, label=label, unit=unit), array.take(number, place), dims)
        for number, (label, unit) in enumerate(zip(labels, units, strict=True))
    }


def _unrolled(array: np.ndarray, dims: tuple[str, ...], extents: Mapping[str, int]) -> np.ndarray:
    """Values along some dimensions as a column over all of them, where they repeat."""
    array = np.transpose(array, [dims.index(dim) for dim in extents if dim in dims])
    shape = [extent if dim in dims else 1 for dim, extent in extents.items()]
    return np.broadcast_to(array.reshape(shape), tuple(extents.values())).ravel()


def _series(head: str, cells: Iterable, column: Column) -> "pd.Series":
    """Cells as a column of one type; ValueError if they are of several."""
    import pandas as pd

    cells = [cell.item() if isinstance(cell, np.generic) else cell for cell in cells]
    cells = [None if cell is pd.NA or (isinstance(cell, str) and not cell) else cell for cell in cells]
    kinds, gaps = {type(cell) for cell in cells if cell is not None}, None in cells
    measures = column.unit not in PURE or column.digits[-1:] in tuple("efg%")  # float64 even where all are whole
    if kinds == {bool} and not gaps:
        return pd.Series(cells, dtype="bool")
    if kinds == {int} and not measures:
        return pd.Series(cells, dtype="Int64" if gaps else "int64")
    if kinds <= {int, float}:
        return pd.Series(cells, dtype="float64")
    if kinds == {str}:
        return pd.Series(cells, dtype="str")
    what = ", ".join(sorted(kind.__name__ for kind in kinds)) + (" and gaps" if gaps else "")
    raise ValueError(f"column '{head}' holds {what}: a column has one type; split it, or the table")


def described(data: "pd.DataFrame") -> dict[str, Column]:
    """Return what the columns of a table hold, by their heads."""
    columns = data.attrs.get(_COLUMNS, {})
    return {head: columns.get(head, Column()) for head in data}


def csv_text(data: "pd.DataFrame") -> str:
    """Return a table as CSV.

    Raises ValueError if `pandas.read_csv` would not give the same values and types back: words that look like numbers
    or like no value ("None", "nan"), columns of mixed types.
    """
    import pandas as pd

    data = data.reset_index(drop=True)  # of a part of a table
    text = data.to_csv(index=False, lineterminator="\n")
    back = pd.read_csv(io.StringIO(text))
    for head in data if len(data) else ():
        expected = data[head]
        if expected.dtype == "Int64":
            expected = expected.astype("float64" if expected.isna().any() else "int64")
        if not back[head].equals(expected):
            raise ValueError(f"column '{head}' is {data[head].dtype}, but read back from CSV it is {back[head].dtype}")
    return text


def printed_cells(data: "pd.DataFrame") -> list[list[str]]:
    """Return a table as readers see it: rows of text, the first one the heads; a table of one row stands upright."""
    columns = described(data)
    beside = {name for column in columns.values() for name in column.beside}
    cells = {}
    for head, column in columns.items():
        if head in beside:
            continue
        lines = [_printed(value, column.digits) for value in data[head].tolist()]
        for form, names, digits in (
            ("{} ± {}", [column.error] if column.error else [], column.digits.lstrip("+")),
            ("{} ({} to {})", column.interval, column.digits),
        ):
            others = ([_printed(v, columns[name].digits or digits) for v in data[name].tolist()] for name in names)
            rows = zip(lines, *others, strict=True)
            lines = [row[0] if len(row) == 1 or NO_VALUE in row else form.format(*row) for row in rows]
        cells[head] = lines
    if len(data) == 1:
        return [["quantity", "value"], *([head, *lines] for head, lines in cells.items())]
    return [list(cells), *map(list, zip(*cells.values(), strict=True))]


def _printed(value: Any, digits: str) -> str:
    """A cell for readers."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if not isinstance(value, int | float) or math.isnan(value):  # NaN, None or NA
        return NO_VALUE
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return f"{value:{digits or (',' if isinstance(value, int) else '.4g')}}"


def write_table(data: "pd.DataFrame", csv_path: str | Path, markdown_path: str | Path) -> None:
    """Write a table as CSV and as Markdown, see the head of this module."""
    write_text(csv_path, csv_text(data))
    cells = printed_cells(data)
    numbers = [head in data and data[head].dtype.kind in "iuf" for head in cells[0]]
    meanings = [["column of the CSV", "unit", "type", "meaning"]]
    for head, column in described(data).items():
        unit = "" if column.unit in PURE else column.unit
        meanings.append([head, unit, TYPES[str(data[head].dtype)], column.meaning])
    write_text(markdown_path, f"{markdown(cells, numbers)}\n{markdown(meanings)}")


def markdown(rows: Sequence[Sequence[str]], numbers: Sequence[bool] = ()) -> str:
    """Return rows of text, the first one the heads, as a Markdown table.

    numbers: which columns are aligned to the right
    """
    head, *lines = [f"| {' | '.join(map(_escaped, row))} |\n" for row in rows]
    rules = [" ---: " if number else " --- " for number in numbers or [False] * len(rows[0])]
    return "".join([head, f"|{'|'.join(rules)}|\n", *lines])


def _escaped(cell: str) -> str:
    """A cell in which nothing acts as Markdown or HTML, in one line."""
    return " ".join(html.escape(cell.replace("\\", "\\\\").replace("|", "\\|"), quote=False).split())


def read_markdown(markdown_path: str | Path) -> list[list[str]]:
    """Read back the cells of a table as readers see them: rows of text, the first one the heads."""
    lines = Path(markdown_path).read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    rows = [re.split(r"(?<!\\) \| ", line.removeprefix("| ").removesuffix(" |")) for line in lines]
    return [[re.sub(r"\\([\\|])", r"\1", html.unescape(cell)) for cell in row] for row in rows[:1] + rows[2:]]
