"""Tables of the mean density: files of ours, or of a user's own. Light to import, as the configuration reads them."""

import csv
import math
from pathlib import Path

import numpy as np

__all__ = ["physical_table", "read_density_table", "read_table", "require_physical"]

LARGEST_FILE = 2**24  # bytes
SCALE_HEIGHTS = (0.5e3, 500e3)  # m, more than an atmosphere has at either end


def require_physical(altitudes, densities, place):
    """Reject a table that is not a density profile; place(i) names row i in the message."""
    if len(altitudes) < 3:
        raise ValueError(f"{place(None)}: {len(altitudes)} rows are too few for a density table; give at least 3")
    for i, (altitude, density) in enumerate(zip(altitudes, densities, strict=True)):
        if not (math.isfinite(altitude) and math.isfinite(density)):
            raise ValueError(
                f"{place(i)}: altitude {altitude} m, density {density} kg/m^3: not finite; remove or fix the row"
            )
        if density <= 0.0:
            raise ValueError(f"{place(i)}: density {density:g} kg/m^3 is not positive; remove or fix the row")
        if i and altitude <= altitudes[i - 1]:
            raise ValueError(
                f"{place(i)}: non-monotone density table: altitude {altitude:g} m follows {altitudes[i - 1]:g} m; "
                f"sort the rows by strictly increasing altitude"
            )


def _cells(row, place):
    try:
        return [cell.strip() for cell in next(csv.reader([row]))]
    except csv.Error as error:
        raise ValueError(f"{place}: is not a row of a CSV file ({error}); fix it") from None


def read_table(name, kind, folder=""):
    """Read a table of a user's: CSV text (UTF-8, with or without a byte order mark), whose first line names columns.

    Blank lines and lines that start with '#' are comments.

    Args:
        name: the file. kind: what it is, for messages, such as "density table". folder: from which it is looked for.

    Returns:
        Tuple of the names of the columns, the numbers of the lines that follow, and their cells, a list for each line.

    Raises:
        ValueError: naming file, line and remedy: a file that is missing or no such text, a row of another length.
    """
    if len(name) > 1000:
        raise ValueError(f"{name[:60]}...: {len(name)} characters are too long for a path; give a UTF-8 CSV file")
    try:
        # A device or a pipe may never end, or never begin.
        if Path(folder, name).exists() and not Path(folder, name).is_file():
            raise ValueError("it is not a regular file")
        with Path(folder, name).open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise ValueError(f"it is larger than {LARGEST_FILE} bytes")
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{name}: there is no such {kind}; check the path") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"{name}: cannot be read as a {kind} ({reason}); give a UTF-8 CSV file") from None

    numbered = enumerate(text.splitlines(), start=1)
    data_lines = [(line, row) for line, row in numbered if row.strip() and not row.lstrip().startswith("#")]
    rows = [_cells(row, f"{name}, line {line}") for line, row in data_lines]
    header = rows[0] if rows else []
    if len(header) == 1 and any(sign in header[0] for sign in ";\t"):
        raise ValueError(f"{name}: write numbers under a line of names, separated by commas; found '{header[0]}'")
    for (line, _), row in zip(data_lines, rows, strict=True):
        if len(row) != len(header):
            raise ValueError(f"{name}, line {line}: {len(row)} values for {len(header)} columns; complete the row")
    return header, [line for line, _ in data_lines[1:]], rows[1:]


def number_of(text, key, place):
    """The number that a cell of a column holds. Raises ValueError naming the place."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{place}: {key} is not a number: '{text}'; write it like 1.23e-5") from None


def read_density_table(path, source=None, folder=""):
    """Read a table of mean densities: one of ours, or a user's own (from NASA's GRAM, say).

    The file is CSV text (UTF-8). Blank lines and lines that start with '#' are comments. The first other line names the
    columns, in any order; further columns are ignored:

        altitude_km or altitude_m    strictly increasing within a source
        density_kg_m3                positive
        source                       optional: a name, when the file holds several tables

    Args:
        path: the file; 'file.csv#name' selects the rows of source `name`.
        source: the same selection as an argument.
        folder: from which a relative path starts.

    Returns:
        Array (n, 2) of altitude (m) and density (kg/m^3).

    Raises:
        ValueError: naming file, line or key, and the remedy: file or column missing; several sources and none chosen,
            or an unknown one; a value that is not a number, not finite or not a positive density; altitudes that do not
            strictly increase; fewer than 3 rows; a density that rises from the first row to the last; altitudes that
            look like kilometres under metres, or the reverse.
    """
    name, _, fragment = str(path).partition("#")
    if fragment and source is not None and fragment != source:
        raise ValueError(f"{path}: two sources asked for, '{fragment}' and '{source}'; give one")
    source = source if source is not None else fragment or None
    header, lines, rows = read_table(name, "density table", folder)
    altitude_keys = [key for key in ("altitude_km", "altitude_m") if key in header]
    if len(altitude_keys) != 1 or "density_kg_m3" not in header:
        raise ValueError(
            f"{name}: the columns must be density_kg_m3 and one of altitude_km, altitude_m (and source, if several); "
            f"found {', '.join(header) or 'none'}"
        )
    selected = list(zip(lines, rows, strict=True))
    if "source" in header:
        column = header.index("source")
        sources = sorted({row[column] for _, row in selected})
        if source is None and len(sources) > 1:
            raise ValueError(f"{name}: several sources; choose one by '{name}#...': {', '.join(sources)}")
        if source is not None and source not in sources:
            raise ValueError(f"{name}: there is no source '{source}'; choose one of {', '.join(sources)}")
        selected = [(line, row) for line, row in selected if source in (None, row[column])]
    elif source is not None:
        raise ValueError(f"{name}: source '{source}' asked for, but there is no column 'source'; leave '#{source}' out")

    altitude_key, density_key = altitude_keys[0], "density_kg_m3"
    unit = 1e3 if altitude_key == "altitude_km" else 1.0
    table = np.array(
        [
            [
                unit * number_of(row[header.index(altitude_key)], altitude_key, f"{name}, line {line}"),
                number_of(row[header.index(density_key)], density_key, f"{name}, line {line}"),
            ]
            for line, row in selected
        ]
    ).reshape(-1, 2)
    require_physical(*table.T, lambda i: name if i is None else f"{name}, line {selected[i][0]}")
    other = "altitude_m" if altitude_key == "altitude_km" else "altitude_km"
    _require_profile(table, f"{name}: column {altitude_key}", f"name the column {other}")
    return table


def _require_profile(table, place, remedy):
    """Refuse altitudes over which the density rises, or falls a thousand times faster or slower than on any planet."""
    (lowest, below), (highest, above) = table[[0, -1]]
    if above > below:
        raise ValueError(
            f"{place}: the density rises with altitude, from {below:g} kg/m^3 at {lowest:g} m to {above:g} kg/m^3 at "
            f"{highest:g} m; sort the rows so that each density stands at its altitude"
        )
    falls = np.log(below / above)
    if falls > 0.0 and not SCALE_HEIGHTS[0] < (highest - lowest) / falls < SCALE_HEIGHTS[1]:
        raise ValueError(
            f"{place}: the density falls by a factor of e in {(highest - lowest) / falls:.3g} m, from {lowest:g} to "
            f"{highest:g} m; is the unit right? If not, {remedy}"
        )


def physical_table(table):
    """Refuse a table of altitude (m) and density (kg/m^3), given as numbers, that is not a density profile."""
    require_physical(
        [altitude for altitude, _ in table],
        [density for _, density in table],
        lambda i: "the table" if i is None else f"row {i + 1}",
    )
    _require_profile(np.asarray(table), "the table", "give altitudes in metres")
    return table
