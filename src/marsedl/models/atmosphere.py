"""Mean density of the atmosphere of Mars: closed fits, and tables in the manner of Mars-GRAM.

A profile is any function

    altitude (m) -> (log_density, first_derivative, second_derivative)

of the natural logarithm of the density in kg/m^3 and its derivatives with respect to altitude (1/m, 1/m^2). It takes
numpy arrays. The scale height of the stochastic entry guidance, Eq. 6, is H = -1 / first_derivative. The closed fits
are compiled by numba and traced by CasADi as well.
"""

import csv
import math
from pathlib import Path

import numpy as np
from numba.extending import register_jitable

__all__ = [
    "casadi_log_density",
    "log_quadratic",
    "read_density_table",
    "tabulated",
    "temperature_pressure_fit",
    "two_exponential",
]

# ---- closed fits -----------------------------------------------------------------------------------------------------

_TEN_KILOMETRES = 1e4

# Desensitized landing (Shen, Seywald, Powell), Eq. 4, fitted to Mars-GRAM data; h in m.
_TEMPERATURE = (205.3645, -1.245e-3, -8.85e-9, 1.4e-13)  # K, ascending powers of h
_SURFACE_PRESSURE = 559.351005946503  # N/m^2
_PRESSURE_DECAY = 0.000105  # 1/m
_GAS_CONSTANT = 188.95110711075  # J/(kg K)

# Gallais, Atmospheric Re-Entry Vehicle Mechanics (2007), p. 29.
_CHANGE_ALTITUDE = 25e3  # m
_LOWER_DENSITY, _LOWER_SCALE_HEIGHT = 1.59e-2, 11.049e3  # kg/m^3 extrapolated to the surface, m
_UPPER_DENSITY, _UPPER_SCALE_HEIGHT = 5.25e-2, 7.295e3


@register_jitable
def log_quadratic(altitude, quadratic, linear, constant, upper_altitude):
    """Logarithm of the density as a parabola of altitude, continued upwards along its last tangent.

        ln rho = quadratic x^2 + linear x + constant,   x = altitude / 10 km,   altitude <= upper_altitude

    Above, the slope stays that of upper_altitude. The curve is C1; its second derivative drops to zero there.

    Args:
        altitude: m.
        quadratic, linear, constant: coefficients, 1, for the density in kg/m^3.
        upper_altitude: last altitude of the parabola, m.

    Returns:
        Tuple of ln rho, d ln rho / dh (1/m), d2 ln rho / dh2 (1/m^2).
    """
    x = altitude / _TEN_KILOMETRES
    inside = np.minimum(altitude, upper_altitude) / _TEN_KILOMETRES
    slope = 2.0 * quadratic * inside + linear
    log_density = (quadratic * inside + linear) * inside + constant + slope * (x - inside)
    curvature = 2.0 * quadratic / _TEN_KILOMETRES**2 * (altitude <= upper_altitude)
    return log_density, slope / _TEN_KILOMETRES, curvature


@register_jitable
def temperature_pressure_fit(altitude):
    """Density from a cubic temperature and an exponential pressure (desensitized landing, Eq. 4, a Mars-GRAM fit).

        T = T0 + T1 h + T2 h^2 + T3 h^3,   p = p0 exp(-k h),   rho = p / (R T)

    Against Mars-GRAM 2010 at Jezero: within 16.4 % below 40 km, but far too dense higher up: 1.6 times at 50 km,
    10 times at 100 km.

    Args:
        altitude: h, m.

    Returns:
        Tuple of ln rho (kg/m^3), d ln rho / dh (1/m), d2 ln rho / dh2 (1/m^2).
    """
    t0, t1, t2, t3 = _TEMPERATURE
    temperature = t0 + altitude * (t1 + altitude * (t2 + altitude * t3))
    relative_slope = (t1 + altitude * (2.0 * t2 + altitude * 3.0 * t3)) / temperature
    relative_curvature = (2.0 * t2 + altitude * 6.0 * t3) / temperature
    log_density = np.log(_SURFACE_PRESSURE / _GAS_CONSTANT) - _PRESSURE_DECAY * altitude - np.log(temperature)
    return log_density, -_PRESSURE_DECAY - relative_slope, relative_slope * relative_slope - relative_curvature


@register_jitable
def two_exponential(altitude):
    """Two isothermal layers (Gallais, Atmospheric Re-Entry Vehicle Mechanics, p. 29).

        rho = 1.59e-2 exp(-h / 11.049 km) below 25 km,   5.25e-2 exp(-h / 7.295 km) from 25 km on

    Not even continuous: with the printed constants the density jumps up by 3.1 % at 25 km, and the scale height changes
    there by a third. The derivatives are those of the layers; do not linearize across the change.

    Args:
        altitude: h, m.

    Returns:
        Tuple of ln rho (kg/m^3), d ln rho / dh (1/m), d2 ln rho / dh2 (1/m^2), the last one zero.
    """
    lower = 1.0 * (altitude < _CHANGE_ALTITUDE)
    upper = 1.0 - lower
    slope = -lower / _LOWER_SCALE_HEIGHT - upper / _UPPER_SCALE_HEIGHT
    log_density = lower * np.log(_LOWER_DENSITY) + upper * np.log(_UPPER_DENSITY) + slope * altitude
    return log_density, slope, 0.0 * altitude


# ---- tables ----------------------------------------------------------------------------------------------------------


def _require_physical(altitudes, densities, place):
    """Refuse a table that is no density profile; place(i) names row i in the message."""
    if len(altitudes) < 3:
        raise ValueError(f"{place(None)}: {len(altitudes)} rows are too few for a density table; give at least 3")
    for i, (altitude, density) in enumerate(zip(altitudes, densities, strict=True)):
        if not (math.isfinite(altitude) and math.isfinite(density)):
            raise ValueError(
                f"{place(i)}: altitude {altitude} m, density {density} kg/m^3: not finite; remove or mend the row"
            )
        if density <= 0.0:
            raise ValueError(f"{place(i)}: density {density:g} kg/m^3 is not positive; remove or mend the row")
        if i and altitude <= altitudes[i - 1]:
            raise ValueError(
                f"{place(i)}: non-monotone density table: altitude {altitude:g} m follows {altitudes[i - 1]:g} m; "
                f"sort the rows by strictly increasing altitude"
            )


def _number(text, key, place):
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{place}: {key} is not a number: '{text}'; write it like 1.23e-5") from None


def read_density_table(path, source=None):
    """Read a table of mean densities: one of ours, or a user's own (from NASA's GRAM, say).

    The file is CSV text (UTF-8). Blank lines and lines that start with '#' are comments. The first other line names the
    columns, in any order; further columns are ignored:

        altitude_km or altitude_m    strictly increasing within a source
        density_kg_m3                positive
        source                       optional: a name, when the file holds several tables

    Args:
        path: the file; 'file.csv#name' selects the rows of source `name`.
        source: the same selection as an argument.

    Returns:
        Array (n, 2) of altitude (m) and density (kg/m^3).

    Raises:
        ValueError: naming file, line or key, and the remedy: file or column missing; several sources and none chosen,
            or an unknown one; a value that is no number, not finite or no positive density; altitudes that do not
            strictly increase; fewer than 3 rows.
    """
    name, _, fragment = str(path).partition("#")
    if fragment and source is not None and fragment != source:
        raise ValueError(f"{path}: two sources asked for, '{fragment}' and '{source}'; give one")
    source = source if source is not None else fragment or None
    try:
        text = Path(name).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{name}: there is no such density table; check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{name}: cannot be read as a density table ({error}); give a UTF-8 CSV file") from None

    numbered = enumerate(text.splitlines(), start=1)
    kept = [(line, row) for line, row in numbered if row.strip() and not row.lstrip().startswith("#")]
    rows = [[cell.strip() for cell in next(csv.reader([row]))] for _, row in kept]
    lines = [line for line, _ in kept]
    header = rows[0] if rows else []
    altitude_keys = [key for key in ("altitude_km", "altitude_m") if key in header]
    if len(altitude_keys) != 1 or "density_kg_m3" not in header:
        raise ValueError(
            f"{name}: the columns must be density_kg_m3 and one of altitude_km, altitude_m (and source, if several); "
            f"found {', '.join(header) or 'none'}"
        )
    for line, row in zip(lines, rows, strict=True):
        if len(row) != len(header):
            raise ValueError(f"{name}, line {line}: {len(row)} values for {len(header)} columns; complete the row")

    chosen = list(zip(lines[1:], rows[1:], strict=True))
    if "source" in header:
        column = header.index("source")
        known = sorted({row[column] for _, row in chosen})
        if source is None and len(known) > 1:
            raise ValueError(f"{name}: several sources; choose one by '{name}#...': {', '.join(known)}")
        if source is not None and source not in known:
            raise ValueError(f"{name}: there is no source '{source}'; choose one of {', '.join(known)}")
        chosen = [(line, row) for line, row in chosen if source in (None, row[column])]
    elif source is not None:
        raise ValueError(f"{name}: source '{source}' asked for, but there is no column 'source'; leave '#{source}' out")

    altitude_key, density_key = altitude_keys[0], "density_kg_m3"
    unit = 1e3 if altitude_key == "altitude_km" else 1.0
    table = np.array(
        [
            [
                unit * _number(row[header.index(altitude_key)], altitude_key, f"{name}, line {line}"),
                _number(row[header.index(density_key)], density_key, f"{name}, line {line}"),
            ]
            for line, row in chosen
        ]
    ).reshape(-1, 2)
    _require_physical(*table.T, lambda i: name if i is None else f"{name}, line {chosen[i][0]}")
    return table


def _log_density_cubic(table):
    """Monotone cubic through the logarithms of the density, a `scipy.interpolate.PchipInterpolator`."""
    from scipy.interpolate import PchipInterpolator

    table = np.asarray(table, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2:
        raise ValueError(f"table must hold altitude and density, shape (n, 2), got {table.shape}")
    _require_physical(*table.T, lambda i: "table" if i is None else f"table, row {i}")
    return PchipInterpolator(table[:, 0], np.log(table[:, 1]))


def tabulated(table):
    """Profile through a density table: monotone cubic (PCHIP) of ln rho over altitude, with its exact derivatives.

    The curve is C1; its second derivative jumps at the nodes. Below and above the table it continues along the end
    slopes (constant scale height).

    Args:
        table: (n, 2), altitude (m) and density (kg/m^3), see `read_density_table`.

    Returns:
        A profile: altitude (m) -> (ln rho, d ln rho / dh in 1/m, d2 ln rho / dh2 in 1/m^2).

    Raises:
        ValueError: if the table is not (n, 2) with n >= 3, finite, positive and strictly increasing in altitude.
    """
    cubic = _log_density_cubic(table)
    lowest, highest = cubic.x[[0, -1]]

    def profile(altitude):
        altitude = np.asarray(altitude, dtype=float)
        inside = np.clip(altitude, lowest, highest)
        slope = cubic(inside, 1)
        curvature = np.where(altitude == inside, cubic(inside, 2), 0.0)
        return cubic(inside) + slope * (altitude - inside), slope, curvature

    return profile


def casadi_log_density(table):
    """The curve of `tabulated` as a CasADi function, for trajectory optimisation.

    A C1 cubic is a B-spline with double knots, so the two curves are the same, not approximations of each other.

    Args:
        table: (n, 2), altitude (m) and density (kg/m^3).

    Returns:
        `casadi.Function` of the altitude (m), returning ln rho (kg/m^3); differentiable by CasADi.

    Raises:
        ValueError: as `tabulated`.
    """
    import casadi

    cubic = _log_density_cubic(table)
    nodes, values, slopes = cubic.x, cubic(cubic.x), cubic(cubic.x, 1)
    thirds = np.diff(nodes) / 3.0
    # The inner coefficients are the two inner Bezier points of every interval.
    inner = np.column_stack([values[:-1] + slopes[:-1] * thirds, values[1:] - slopes[1:] * thirds]).ravel()
    coefficients = np.concatenate([values[:1], inner, values[-1:]])
    knots = np.concatenate([nodes[[0, 0]], np.repeat(nodes, 2), nodes[[-1, -1]]])

    altitude = casadi.MX.sym("altitude")
    below, above = casadi.fmin(altitude - nodes[0], 0.0), casadi.fmax(altitude - nodes[-1], 0.0)
    inside = casadi.fmin(casadi.fmax(altitude, nodes[0]), nodes[-1])
    spline = casadi.bspline(inside, casadi.DM(coefficients), [knots.tolist()], [3], 1, {})
    log_density = spline + slopes[0] * below + slopes[-1] * above
    return casadi.Function("log_density", [altitude], [log_density], ["altitude"], ["log_density"])
