"""Mean density of the atmosphere of Mars: closed fits, and tables in the manner of Mars-GRAM.

A profile is any function

    altitude (m) -> (log_density, first_derivative, second_derivative)

of the natural logarithm of the density in kg/m^3 and its derivatives with respect to altitude (1/m, 1/m^2). It takes
numpy arrays. The scale height of the stochastic entry guidance, Eq. 6, is H = -1 / first_derivative. The closed fits
are compiled by numba and traced by CasADi as well.
"""

from typing import NamedTuple

import numpy as np

from marsedl.compiling import jitable
from marsedl.models.density_table import require_physical
from marsedl.summaries import summary

__all__ = [
    "TEMPERATURE_PRESSURE_FIT",
    "TemperaturePressureFit",
    "UniformNodes",
    "casadi_log_density",
    "log_density_in_cells",
    "log_quadratic",
    "named_log_density",
    "named_profile",
    "node_below",
    "tabulated",
    "temperature_pressure",
    "two_exponential",
    "uniform_cells",
    "uniform_nodes",
]

# ---- closed fits -----------------------------------------------------------------------------------------------------

_TEN_KILOMETRES = 1e4


class TemperaturePressureFit(NamedTuple):
    """Constants of a cubic temperature and an exponential pressure over altitude, see `temperature_pressure`."""

    temperature: tuple[float, float, float, float]  # T0 to T3, K, K/m, K/m^2, K/m^3
    surface_pressure: float  # p0, N/m^2
    pressure_decay: float  # k, 1/m
    gas_constant: float  # R, J/(kg K)


# Desensitized landing (Shen, Seywald, Powell), Eq. 4, fitted to Mars-GRAM data. Against Mars-GRAM 2010 at Jezero it is
# within 16.4 % below 40 km, but far too dense higher up: 1.6 times at 50 km, 10 times at 100 km.
TEMPERATURE_PRESSURE_FIT = TemperaturePressureFit(
    temperature=(205.3645, -1.245e-3, -8.85e-9, 1.4e-13),
    surface_pressure=559.351005946503,
    pressure_decay=0.000105,
    gas_constant=188.95110711075,
)

# Gallais, Atmospheric Re-Entry Vehicle Mechanics (2007), p. 29.
_CHANGE_ALTITUDE = 25e3  # m
_LOWER_DENSITY, _LOWER_SCALE_HEIGHT = 1.59e-2, 11.049e3  # kg/m^3 extrapolated to the surface, m
_UPPER_DENSITY, _UPPER_SCALE_HEIGHT = 5.25e-2, 7.295e3


@jitable
def log_quadratic(altitude, quadratic, linear, constant, upper_altitude):
    r"""Logarithm of the density as a parabola of altitude, continued upwards along its last tangent.

        $\ln\rho = \text{quadratic} \cdot x^2 + \text{linear} \cdot x + \text{constant},$
        $x = \text{altitude} / 10 \, \text{km}, \quad \text{altitude} \le \text{upper_altitude}$

    Above, the slope stays that of upper_altitude. The curve is C1; its second derivative drops to zero there.

    Args:
        altitude: m.
        quadratic, linear, constant: coefficients, 1, for the density in kg/m^3.
        upper_altitude: last altitude of the parabola, m.

    Returns:
        Tuple of $\ln\rho$, $d \ln\rho / dh$ (1/m), $d^2 \ln\rho / dh^2$ (1/m^2).
    """
    x = altitude / _TEN_KILOMETRES
    inside = np.minimum(altitude, upper_altitude) / _TEN_KILOMETRES
    slope = 2.0 * quadratic * inside + linear
    log_density = (quadratic * inside + linear) * inside + constant + slope * (x - inside)
    curvature = 2.0 * quadratic / _TEN_KILOMETRES**2 * (altitude <= upper_altitude)
    return log_density, slope / _TEN_KILOMETRES, curvature


@jitable
def temperature_pressure(altitude, temperature, surface_pressure, pressure_decay, gas_constant):
    r"""Density from a cubic temperature and an exponential pressure (desensitized landing, Eq. 4).

        $T = T_0 + T_1 h + T_2 h^2 + T_3 h^3, \quad p = p_0 \, \exp(-k h), \quad \rho = \frac{p}{R T}$

    Args:
        altitude: h, m.
        temperature: $T_0$ to $T_3$, K, K/m, K/m^2, K/m^3.
        surface_pressure: $p_0$, Pa.
        pressure_decay: k, 1/m.
        gas_constant: R, J/(kg K).

    Returns:
        Tuple of $\ln\rho$ (kg/m^3), $d \ln\rho / dh$ (1/m), $d^2 \ln\rho / dh^2$ (1/m^2).
    """
    t0, t1, t2, t3 = temperature
    decay = pressure_decay
    surface = np.log(surface_pressure / gas_constant)
    temperature = t0 + altitude * (t1 + altitude * (t2 + altitude * t3))
    relative_slope = (t1 + altitude * (2.0 * t2 + altitude * 3.0 * t3)) / temperature
    relative_curvature = (2.0 * t2 + altitude * 6.0 * t3) / temperature
    log_density = surface - decay * altitude - np.log(temperature)
    return log_density, -decay - relative_slope, relative_slope * relative_slope - relative_curvature


@jitable
def two_exponential(altitude):
    r"""Two isothermal layers (Gallais, Atmospheric Re-Entry Vehicle Mechanics, p. 29).

        $\rho = 1.59 \cdot 10^{-2} \, \exp\left( -\frac{h}{11.049 \, \text{km}} \right) \text{ below 25 km},$
        $\rho = 5.25 \cdot 10^{-2} \, \exp\left( -\frac{h}{7.295 \, \text{km}} \right) \text{ from 25 km on}$

    Not even continuous: with the printed constants the density jumps up by 3.1 % at 25 km, and the scale height changes
    there by a third. The derivatives are those of the layers; do not linearize across the change.

    Args:
        altitude: h, m.

    Returns:
        Tuple of $\ln\rho$ (kg/m^3), $d \ln\rho / dh$ (1/m), $d^2 \ln\rho / dh^2$ (1/m^2), the last one zero.
    """
    lower = 1.0 * (altitude < _CHANGE_ALTITUDE)
    upper = 1.0 - lower
    slope = -lower / _LOWER_SCALE_HEIGHT - upper / _UPPER_SCALE_HEIGHT
    log_density = lower * np.log(_LOWER_DENSITY) + upper * np.log(_UPPER_DENSITY) + slope * altitude
    return log_density, slope, 0.0 * altitude


# ---- tables ----------------------------------------------------------------------------------------------------------


def _log_density_cubic(table):
    """Monotone cubic through the logarithms of the density, a `scipy.interpolate.PchipInterpolator`."""
    from scipy.interpolate import PchipInterpolator

    table = np.asarray(table, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2:
        raise ValueError(f"table must hold altitude and density, shape (n, 2), got {table.shape}")
    require_physical(*table.T, lambda i: "table" if i is None else f"table, row {i}")
    return PchipInterpolator(table[:, 0], np.log(table[:, 1]))


def tabulated(table):
    """Profile through a density table: monotone cubic (PCHIP) of ln rho over altitude, with its exact derivatives.

    The curve is C1; its second derivative jumps at the nodes. Below and above the table it continues along the end
    slopes (constant scale height).

    Args:
        table: (n, 2), altitude (m) and density (kg/m^3), see `density_table.read_density_table`.

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


# ---- uniform nodes ---------------------------------------------------------------------------------------------------


class UniformNodes(NamedTuple):
    """A profile at equidistant altitudes."""

    bottom: float  # m, altitude of the first node
    spacing: float  # m, from one to the next
    log_density: np.ndarray  # (n,), of kg/m^3
    slope: np.ndarray  # (n,), 1/m

    __repr__ = summary


def uniform_nodes(profile, lowest=-10e3, highest=300e3, spacing=1e3):
    """Sample a profile at equidistant altitudes, for look-ups that compute the cell from the altitude.

    The cubics of `uniform_cells` are the curve of a table again, if its altitudes are among the nodes, and as good as
    exact for the closed fits at 1 km, but that the jump of `two_exponential` is spread over the cell below it.

    Args:
        profile: altitude (m) -> (ln rho, d ln rho / dh in 1/m, ...), see the module.
        lowest, highest: altitudes of the first node and, if a whole number of cells lies between them, of the last, m.
        spacing: m.

    Returns:
        `UniformNodes`.

    Raises:
        ValueError: if spacing is not positive, or does not fit between lowest and highest.
    """
    if not 0.0 < spacing <= highest - lowest:
        raise ValueError(
            f"spacing must be positive and fit between lowest and highest, got {spacing}, {lowest}, {highest}"
        )
    altitude = np.arange(lowest, highest + spacing / 2, spacing)
    log_density, slope, *_ = profile(altitude)
    return UniformNodes(
        bottom=lowest,
        spacing=spacing,
        log_density=np.ascontiguousarray(log_density),
        slope=np.ascontiguousarray(np.broadcast_to(slope, altitude.shape)),
    )


def uniform_cells(log_density, slope, spacing):
    r"""Cubics of $\ln\rho$ between equidistant nodes, continued by a line at each end.

        $\ln\rho = c_0 + c_1 x + c_2 x^2 + c_3 x^3, \quad x \text{ in cells from the lower end of the cell}$

    The curve is C1. Row i is the cell that begins at node i - 1. Row 0 begins one spacing below the first node and is
    for everything below that node ($x$ may be negative), the last row for everything above the last ($x$ may exceed 1).

    Args:
        log_density: of kg/m^3 at the nodes, (n,).
        slope: its derivative there, (n,), 1/m.
        spacing: between nodes, m.

    Returns:
        Coefficients $c_0$ to $c_3$, (n + 1, 4).

    Raises:
        ValueError: if there are fewer than 2 nodes, shapes differ, a number is not finite or spacing is not positive.
    """
    value, slope = np.asarray(log_density, dtype=float), np.asarray(slope, dtype=float)
    fits = value.ndim == 1 and len(value) >= 2 and value.shape == slope.shape and spacing > 0.0
    if not fits or not np.isfinite(value).all() or not np.isfinite(slope).all():
        raise ValueError(
            f"log_density and log_density_slope must have one finite value per node and a positive spacing, got shapes "
            f"{value.shape} and {slope.shape}, spacing {spacing}; for vacuum take -2000, say"
        )
    slope = slope * spacing
    rise = np.diff(value)
    cells = np.zeros((len(value) + 1, 4))
    cells[1:, 0], cells[1:, 1] = value, slope
    cells[0, :2] = value[0] - slope[0], slope[0]
    cells[1:-1, 2] = 3.0 * rise - 2.0 * slope[:-1] - slope[1:]
    cells[1:-1, 3] = slope[:-1] + slope[1:] - 2.0 * rise
    return cells


@jitable
def log_density_in_cells(altitude, bottom, cells_per_metre, cells):
    r"""$\ln\rho$ of the cells of `uniform_cells` at an altitude, within -600 and 600; NaN stays NaN.

    Args:
        altitude, bottom: here, and of the first node, m. cells_per_metre: 1/m. cells: (n + 1, 4).

    Returns:
        Logarithm of kg/m^3, of which `elementary.exponential` takes the density without subnormal products.
    """
    position = (altitude - bottom) * cells_per_metre + 1.0  # before the first node there is a cell more
    last = np.float64(cells.shape[0] - 1)
    inside = position if position > 0.0 else 0.0  # of NaN, too: there must be a cell to read
    inside = inside if inside < last else last
    cell = np.int32(inside)
    fraction = position - cell
    logarithm = cells[cell, 0] + fraction * (cells[cell, 1] + fraction * (cells[cell, 2] + fraction * cells[cell, 3]))
    logarithm = -600.0 if logarithm < -600.0 else logarithm
    return 600.0 if logarithm > 600.0 else logarithm


@jitable
def node_below(position, nodes):
    """Node of a uniform table below a position (in cells from its first node), and the fraction of the way to the next.

    Positions beyond the table, and NaN, count as its ends.
    """
    last = np.float64(nodes - 1)
    position = position if position > 0.0 else 0.0
    position = position if position < last else last
    node = np.int32(position)
    node = node if node < nodes - 1 else np.int32(nodes - 2)
    return node, position - node


# ---- by name ---------------------------------------------------------------------------------------------------------


def named_profile(name, *, coefficients=None, upper_altitude=None, table=None, fit=TEMPERATURE_PRESSURE_FIT):
    """The profile that a configuration names.

    Args:
        name: "log_quadratic", "temperature_pressure_fit", "two_exponential" or "table".
        coefficients, upper_altitude: of log_quadratic, see there.
        table: of table, (n, 2), altitude (m) and density (kg/m^3).
        fit: `TemperaturePressureFit` of temperature_pressure_fit; the printed one unless given.

    Returns:
        A profile, see the module.

    Raises:
        ValueError: as `tabulated`.
    """
    if name == "log_quadratic":
        return lambda altitude: log_quadratic(altitude, *coefficients, upper_altitude)
    if name == "table":
        return tabulated(table)
    if name == "temperature_pressure_fit":
        return lambda altitude: temperature_pressure(altitude, *fit)
    return {"two_exponential": two_exponential}[name]


def named_log_density(name, *, coefficients=None, upper_altitude=None, table=None, fit=TEMPERATURE_PRESSURE_FIT):
    """The curve of `named_profile` as a function that CasADi can trace, for trajectory optimisation.

    Args:
        name, coefficients, upper_altitude, table, fit: as of `named_profile`.

    Returns:
        Function of the altitude (m) that returns ln rho (kg/m^3) alone: for SX and MX symbols, for MX only if it goes
        through a table. CasADi differentiates it; across the jump of two_exponential it sees the layers' slopes.

    Raises:
        ValueError: as `tabulated`.
    """
    if name == "table":
        return casadi_log_density(table)
    profile = named_profile(name, coefficients=coefficients, upper_altitude=upper_altitude, fit=fit)
    return lambda altitude: profile(altitude)[0]
