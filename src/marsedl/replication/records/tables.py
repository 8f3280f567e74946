"""Tables: data frames with one meaning, one type and one unit per column, as CSV for analysts, as Markdown for readers.

A table is a `pandas.DataFrame`. The head of a column is its name and, in brackets, its unit: `final mass (kg)`. So
plain `pandas.read_csv` tells an analyst the units, without a second file to keep beside the first, and what is in
memory has the same names as what is read back. Columns are numbers, whole numbers, True and False, or words.

- CSV holds a value and its standard error in columns apart, all digits of every number (`pandas.read_csv` gives the
  same bits), `inf`, and nothing where there is no value. Only whole numbers with gaps come back as another type, float.
- Markdown is for reading: printed digits, `value ± error` or `value (lower to upper)` in one cell, a dash for no value.
  Below the table stand unit, type and meaning of every column of the CSV.

`frame` unrolls fields of a record, whose declarations hold the words and units; `table` takes any rows:

    def certified_costs(certificates: Certificates):
        return frame(certificates, "solver_status", mean_cost_ratio=".7f", solver_iterations="d")

    def readings(readings, published):
        rows = [(name, records.nominal.mass[-1], *mean_mass(records)) for name, (_, records) in readings.items()]
        return table(rows, {
            "reading": Column(),
            "prior final mass": Column("kg", ".3f"),
            "mean final mass": Column("kg", ".3f", "over the trials", error="its standard error"),
            "its standard error": Column("kg"),
        })

pandas is imported where a table is made: it costs a quarter of a second.
"""

import csv
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
from marsedl.replication.records.fields import Axis, layout, quantities
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
_COLUMNS = "columns"  # key of DataFrame.attrs, under which every column's `Column` stands by its head


@dataclass(frozen=True)
class Column:
    """What a column holds, and how readers see it.

    `unit`: of all its values; "" for words, counts and ratios. `digits`: format of a number for readers, such as ".3f"
    or "+.1f"; by default four digits, and whole numbers with commas. `meaning`: a line in words, where the name does
    not say it. `error`: name of the column with the standard errors of this one, `interval`: names of those with the
    lower and upper bounds; readers see them in one cell. `label`: the name, where it is not the one under which the
    column is declared.
    """

    unit: str = ""
    digits: str = ""
    meaning: str = ""
    error: str = ""
    interval: tuple[str, ...] = ()
    label: str = ""

    @property
    def measures(self) -> bool:
        """Whether its numbers are float64 even where all are whole: if it has a unit, or digits of a float."""
        return self.unit not in PURE or self.digits[-1:] in tuple("efg%")

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of the columns that readers see in one cell with this one."""
        return (*filter(None, [self.error]), *self.interval)

    def renamed(self, names: Mapping[str, str]) -> "Column":
        """Return the column with other names of those beside it, where `names` has any."""
        interval = tuple(names.get(name, name) for name in self.interval)
        return replace(self, error=names.get(self.error, self.error), interval=interval)

    def head(self, name: str) -> str:
        """Return the head of the column that is declared under this name: with its unit if it has one."""
        name = self.label or name
        return name if self.unit in PURE else f"{name} ({self.unit})"


def table(data: Any, columns: Mapping[str, Column]) -> "pd.DataFrame":
    """Make a table of rows or columns.

    Args:
        data: rows with a cell for each column, in their order; or cells by column's name; or a table, whose columns
            stand first (its own are kept as they are, more are added by `DataFrame.assign` and described here). None,
            "" and NaN are no value.
        columns: what the columns hold, by name.

    Returns:
        The table. Its columns are float64, int64 (Int64 where there are gaps), bool or str. Whole numbers are float64
        if the column has a unit or digits of a float, and so is a column without any value.

    Raises:
        ValueError: a row of another length, a name twice, an error without its column, or a column of mixed types.

    """
    import pandas as pd

    described_before: dict[str, Column] = {}
    if isinstance(data, pd.DataFrame):
        described_before = {head: column for head, column in data.attrs.get(_COLUMNS, {}).items() if head in data}
        cells: Mapping[str, Iterable] = {str(head): data[head] for head in data}
    elif isinstance(data, Mapping):
        cells = data
    else:
        rows = [tuple(row) for row in data]
        for row in rows:
            if len(row) != len(columns):
                raise ValueError(f"a row of {len(row)} cells in a table of {len(columns)} columns: {row}")
        cells = {name: [row[number] for row in rows] for number, name in enumerate(columns)}
    heads = {name: name if name in described_before else column.head(name) for name, column in columns.items()}
    order = list(dict.fromkeys([*described_before, *columns]))
    if len({heads.get(name, name) for name in order}) != len(order):
        raise ValueError(f"two columns have the same head: {', '.join(heads.get(name, name) for name in order)}")
    if set(cells) != set(order):
        raise ValueError(f"cells are given for {', '.join(cells)}, but the columns are {', '.join(order)}")
    of = {**described_before, **columns}
    result = pd.DataFrame(
        {heads.get(name, name): _series(heads.get(name, name), cells[name], of[name]) for name in order}
    )
    columns = {**described_before, **{heads[name]: column.renamed(heads) for name, column in columns.items()}}
    for head, column in columns.items():
        for other in column.beside:
            if other not in result:
                raise ValueError(f"column '{head}' has '{other}' beside it; {nearest(other, result)}")
    result.attrs[_COLUMNS] = columns
    return result


def frame(
    record: Any,
    *fields: str,
    coordinates: Mapping[str, tuple[str, Sequence]] | None = None,
    **columns: "Column | str",
) -> "pd.DataFrame":
    """Unroll fields of a record over their dimensions: a row for each place, a column for each field.

    First stand the columns of the dimensions, in the order of the field that has most of them: the field that holds a
    dimension's coordinates (it has its name), the names of the components of an `Axis`, else numbers from 1 under the
    name without its plural's s. A field with fewer dimensions repeats its values. A field whose components have units
    of their own gets a column for each component.

    Args:
        record: an artifact; label, unit and meaning of a column are those of its fields.
        fields: names of fields, shown with four digits.
        coordinates: other names and values of dimensions: `{"laws": ("law", ["open loop", "feedback"])}`.
        columns: further fields with their digits (`mean_cost_ratio=".7f"`), or a `Column` whose entries, where it has
            any, stand instead of the field's; values are converted to its unit (rad to deg, m to km, 1 to %). Fields
            of coordinates are given here only to say their digits.

    Returns:
        The table.

    Raises:
        ValueError: there is no such field, it is in mixed units ("SI"), or there is no such conversion.

    """
    declared, dimensions = quantities(type(record)), layout(type(record))
    selected = {**dict.fromkeys(fields, Column()), **columns}
    selected = {name: Column(digits=column) if isinstance(column, str) else column for name, column in selected.items()}
    for name, column in selected.items():
        for field in (name, *column.beside):
            if field not in declared:
                raise ValueError(f"{type(record).__name__} has no field '{field}'; {nearest(field, declared)}")
    label = {name: selected.get(name, Column()).label or field.label for name, field in declared.items()}
    selected = {name: column.renamed(label) for name, column in selected.items()}
    parts = [
        part
        for name, column in selected.items()
        if dimensions.dims[name] != (name,)
        for part in _parts(record, name, declared[name], dimensions.dims[name], column)
    ]
    widest_first = sorted(parts, key=lambda part: -len(part[3]))
    extents = {dim: extent for _, _, array, dims in widest_first for dim, extent in zip(dims, array.shape, strict=True)}
    extents |= {name: len(getattr(record, name)) for name in selected if dimensions.dims[name] == (name,)}
    cells: dict[str, Any] = {}
    heads: dict[str, Column] = {}
    places = dict(zip(extents, np.indices(tuple(extents.values())), strict=True))
    for dim, extent in extents.items():
        coordinate = (coordinates or {}).get(dim)
        if coordinate is not None:
            name, values, column = coordinate[0], list(coordinate[1]), Column()
        elif dim in dimensions.fields:
            ((name, column, values, _),) = _parts(record, dim, declared[dim], (dim,), selected.get(dim, Column()))
        elif (axis := dimensions.axes[dim]) is not None:
            name, values, column = dim, [axis.label(component) for component in axis.names], Column()
        else:
            name, values, column = dim.removesuffix("s"), range(1, extent + 1), Column(digits="d")
        cells[name], heads[name] = np.array(values)[places[dim].ravel()], column
    for name, column, array, dims in parts:
        order = [dim for dim in extents if dim in dims]
        array = np.transpose(array, [dims.index(dim) for dim in order])
        shape = [extents[dim] if dim in dims else 1 for dim in extents]
        values = np.broadcast_to(array.reshape(shape), tuple(extents.values())).ravel()
        if name in cells:
            raise ValueError(f"{type(record).__name__}: two columns have the label '{name}'; give one another label")
        cells[name], heads[name] = values, column
    return table(cells, heads)


def _parts(record: Any, name: str, declared: Any, dims: tuple[str, ...], column: Column) -> list[tuple]:
    """Columns of a field: label, `Column`, values, dimensions; one for each component if these differ in their unit."""
    array, label = np.asarray(getattr(record, name)), column.label or declared.label
    units = declared.unit.split(", ")
    if len(units) == 1:
        return [(label, *_converted(name, array, units[0], declared, column), dims)]
    place = max(number for number, extent in enumerate(array.shape) if extent == len(units))
    axis = declared.dims[place]
    names = [axis.label(c) for c in axis.names] if isinstance(axis, Axis) else [str(n + 1) for n in range(len(units))]
    remaining_dims = dims[:place] + dims[place + 1 :]
    return [
        (
            f"{label}: {component}",
            *_converted(name, array.take(n, place), unit, declared, replace(column, unit="")),
            remaining_dims,
        )
        for n, (component, unit) in enumerate(zip(names, units, strict=True))
    ]


def _converted(name: str, array: np.ndarray, unit: str, declared: Any, column: Column) -> tuple[Column, np.ndarray]:
    """The `Column` of a field, completed from its declaration, and the values in its unit."""
    if unit == "SI":
        raise ValueError(f"field '{name}' is in mixed units: write columns of single components with `table`")
    target_unit = column.unit or unit
    array = converted(array, unit, target_unit, name)
    return replace(column, label="", unit=target_unit, meaning=column.meaning or declared.meaning), array


def _series(head: str, cells: Iterable, column: Column) -> "pd.Series":
    """Cells as a column of one type; ValueError if they are of several."""
    import pandas as pd

    cells = cells.tolist() if hasattr(cells, "tolist") else list(cells)
    cells = [cell.item() if isinstance(cell, np.generic) else cell for cell in cells]
    cells = [None if cell is None or cell is pd.NA or (isinstance(cell, str) and not cell) else cell for cell in cells]
    kinds = {type(cell) for cell in cells} - {type(None)}
    gaps = None in cells
    if kinds == {bool} and not gaps:
        return pd.Series(cells, dtype="bool")
    if kinds == {int} and not column.measures:
        return pd.Series(cells, dtype="Int64" if gaps else "int64")
    if kinds <= {int, float} and (kinds or not cells):
        return pd.Series([math.nan if cell is None else float(cell) for cell in cells], dtype="float64")
    if kinds == {str}:
        return pd.Series(cells, dtype="str")
    if not kinds:
        return pd.Series([math.nan] * len(cells), dtype="float64")
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
        if back[head].dtype == expected.dtype == "float64" and not back[head].equals(expected):
            raise ValueError(
                f"column '{head}' has other numbers when pandas {pd.__version__} reads it from CSV: install pandas>=3.1"
            )
        if back[head].dtype != expected.dtype or not back[head].equals(expected):
            raise ValueError(f"column '{head}' is {data[head].dtype}, but read back from CSV it is {back[head].dtype}")
    return text


def printed_cells(data: "pd.DataFrame") -> list[list[str]]:
    """Return a table as readers see it: rows of text, the first one the heads; a table of one row stands upright."""
    columns = described(data)
    beside = {name for column in columns.values() for name in column.beside}
    first_columns = {head: column for head, column in columns.items() if head not in beside}

    def texts(head: str, digits: str) -> list[str]:
        return [_printed(value, columns[head].digits or digits) for value in data[head].tolist()]

    cells = []
    for head, column in first_columns.items():
        lines = texts(head, "")
        if column.error:
            errors = texts(column.error, column.digits.lstrip("+"))
            lines = [v if NO_VALUE in (v, e) else f"{v} ± {e}" for v, e in zip(lines, errors, strict=True)]
        if column.interval:
            bounds = (texts(name, column.digits) for name in column.interval)
            lines = [
                v if NO_VALUE in (v, a, b) else f"{v} ({a} to {b})" for v, a, b in zip(lines, *bounds, strict=True)
            ]
        cells.append(lines)
    if len(data) == 1:
        return [["quantity", "value"], *([head, *lines] for head, lines in zip(first_columns, cells, strict=True))]
    return [list(first_columns), *map(list, zip(*cells, strict=True))]


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
    columns = described(data)
    cells = printed_cells(data)
    numbers = [head in data and data[head].dtype.kind in "iuf" for head in cells[0]]
    kinds = {head: TYPES[str(data[head].dtype)] for head in data}
    meanings = [["column of the CSV", "unit", "type", "meaning"]]
    for head, column in columns.items():
        unit = "" if column.unit in PURE else column.unit
        meanings.append([head, unit, kinds[head], column.meaning])
    write_text(markdown_path, "".join([*_markdown(cells, numbers), "\n", *_markdown(meanings)]))


def _markdown(rows: Sequence[Sequence[str]], numbers: Sequence[bool] = ()) -> list[str]:
    """Lines of a Markdown table; columns of numbers are aligned to the right."""
    lines = ["| " + " | ".join(str(cell).replace("|", r"\|") for cell in row) + " |\n" for row in rows]
    lines.insert(
        1, "|" + "|".join(" ---: " if number else " --- " for number in numbers or [False] * len(rows[0])) + "|\n"
    )
    return lines


def read_markdown(markdown_path: str | Path) -> list[list[str]]:
    """Read back the cells of a table as readers see them: rows of text, the first one the heads."""
    lines = Path(markdown_path).read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    rows = [re.split(r"(?<!\\) \| ", line.removeprefix("| ").removesuffix(" |")) for line in lines]
    return [[cell.replace(r"\|", "|") for cell in row] for row in rows[:1] + rows[2:]]


def read_table(csv_path: str | Path) -> list[list[str]]:
    """Read rows of text, the first one the header, from a CSV file such as those of `data/reference`."""
    with Path(csv_path).open(newline="", encoding="utf-8") as stream:
        return list(csv.reader(stream))
