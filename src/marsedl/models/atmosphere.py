"""Mean density of the atmosphere of Mars: closed fits, and tables in the manner of Mars-GRAM.

A profile is any function

    altitude (m) -> (log_density, first_derivative, second_derivative)

of the natural logarithm of the density in kg/m^3 and its derivatives with respect to altitude (1/m, 1/m^2). It takes
numpy arrays. The scale height of the stochastic entry guidance, Eq. 6, is H = -1 / first_derivative. The closed fits
are compiled by numba and traced by CasADi as well.
"""

import numpy as np
from numba.extending import register_jitable

from marsedl.models.density_table import require_physical

__all__ = [
    "casadi_log_density",
    "log_quadratic",
    "named_profile",
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


# ---- by name ---------------------------------------------------------------------------------------------------------


def named_profile(name, *, coefficients=None, upper_altitude=None, table=None):
    """The profile that a configuration names.

    Args:
        name: "log_quadratic", "temperature_pressure_fit", "two_exponential" or "table".
        coefficients, upper_altitude: of log_quadratic, see there.
        table: of table, (n, 2), altitude (m) and density (kg/m^3).

    Returns:
        A profile, see the module.

    Raises:
        ValueError: as `tabulated`.
    """
    if name == "log_quadratic":
        return lambda altitude: log_quadratic(altitude, *coefficients, upper_altitude)
    if name == "table":
        return tabulated(table)
    return {"temperature_pressure_fit": temperature_pressure_fit, "two_exponential": two_exponential}[name]
