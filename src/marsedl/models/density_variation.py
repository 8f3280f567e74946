r"""Relative density variations as an Ornstein-Uhlenbeck process of altitude (stochastic entry guidance, Eqs. 5-11).

    $\rho = \bar{\rho} (1 + y), \quad dy = -\lambda y \, ds + \sqrt{\varphi} \, dw, \quad s = r_\text{atm} - r$

The sink distance s grows downwards, so the process starts at the edge of the atmosphere and runs down. All grids of
altitude here ascend, as tables do; the process enters at the last node and marches to the first.
"""

import numpy as np

from marsedl.compiling import jitable

__all__ = [
    "decay_rate",
    "density_factor",
    "diffusion",
    "exponential_variance",
    "innovation_variance",
    "is_floored",
    "log_retention",
    "mars_gram_2010_deviation",
    "process_variance",
    "retention",
    "sample_exact",
    "sample_process",
    "stationary_variance",
]

# ---- desired variance profiles ---------------------------------------------------------------------------------------


@jitable
def exponential_variance(altitude, variance, upper_altitude, growth_length):
    r"""Variance of the relative density that grows exponentially up to an altitude and is constant above.

        $\zeta = \text{variance} \cdot \exp\left(
          \frac{\min(h, \text{upper_altitude}) - \text{upper_altitude}}{\text{growth_length}} \right)$

    Args:
        altitude: h, m.
        variance: value at and above upper_altitude, 1.
        upper_altitude: m.
        growth_length: altitude over which the variance grows by e, m.

    Returns:
        Tuple of $\zeta$ (1) and $d\zeta / dh$ (1/m), the latter zero from upper_altitude on.
    """
    zeta = variance * np.exp((np.minimum(altitude, upper_altitude) - upper_altitude) / growth_length)
    return zeta, zeta / growth_length * (altitude < upper_altitude)


@jitable
def mars_gram_2010_deviation(altitude):
    r"""One-sigma dispersion of the density, relative to the mean, of Mars-GRAM 2010 itself.

        $2 \, \% \text{ near the surface},$
        $30 \, \% \cdot \exp\left( \frac{h - 100 \, \text{km}}{35 \, \text{km}} \right) \text{ up to 100 km},$
        $\text{then } 0.5 \, \% \text{ per km up to } 45 \, \% \text{ at 130 km}$

    Args:
        altitude: h, m.

    Returns:
        Standard deviation as a fraction, 1.
    """
    # The maximum makes the change at 5.2 km continuous; the rounded altitude would leave a step of 0.002 points.
    below_100_km = np.maximum(0.02, 0.3 * np.exp((np.minimum(altitude, 100e3) - 100e3) / 35e3))
    return below_100_km + 0.005e-3 * np.minimum(np.maximum(altitude - 100e3, 0.0), 30e3)


# ---- coefficients of the process -------------------------------------------------------------------------------------


@jitable
def decay_rate(inverse_scale_height, factor):
    """Decay rate of the process, lambda = factor / H (stochastic entry guidance, Remark II.1: factor 2).

    Args:
        inverse_scale_height: 1 / H, 1/m.
        factor: 1.

    Returns:
        lambda, 1/m.
    """
    return factor * inverse_scale_height


@jitable
def diffusion(decay, variance):
    r"""Diffusion whose stationary variance is the desired one (stochastic entry guidance, Eq. 11).

        $\varphi = 2 \lambda \zeta = \frac{4 \zeta}{H} \quad \text{for} \quad \lambda = \frac{2}{H}$

    Meant for a slowly varying zeta. Where zeta falls towards the ground the process has more variance than desired:
    by the factor 1 / (1 - H / (4 L)) for zeta growing by e over the altitude L.

    Args:
        decay: lambda, 1/m.
        variance: desired variance zeta, 1.

    Returns:
        phi, 1/m.
    """
    return 2.0 * decay * variance


@jitable
def stationary_variance(diffusion, decay):
    r"""Variance that the process tends to for constant coefficients (stochastic entry guidance, Eq. 10).

        $\frac{\varphi}{2 \lambda} = \frac{\varphi H}{4} \quad \text{for} \quad \lambda = \frac{2}{H}$

    Args:
        diffusion: phi, 1/m.
        decay: lambda > 0, 1/m.

    Returns:
        Variance, 1.
    """
    return diffusion / (2.0 * decay)


# ---- the process on a grid of altitudes ------------------------------------------------------------------------------


def _checked_grid(altitudes, **node_values):
    altitudes = np.asarray(altitudes, dtype=float)
    if altitudes.ndim != 1 or altitudes.size < 2 or not (np.diff(altitudes) > 0.0).all():
        raise ValueError("altitudes must be a grid of at least 2 strictly increasing nodes; sort it upwards")
    checked = []
    for name, value in node_values.items():
        value = np.asarray(value, dtype=float)
        if value.shape not in ((), altitudes.shape):
            raise ValueError(f"{name} must have one value per node, shape {altitudes.shape}, got {value.shape}")
        if not (value >= 0.0).all():
            raise ValueError(f"{name} must not be negative nor NaN; check the profile that it comes from")
        checked.append(np.broadcast_to(value, altitudes.shape))
    return altitudes, *checked


def _means(node_values):
    return 0.5 * (node_values[:-1] + node_values[1:])


def log_retention(altitudes, decay):
    r"""Logarithm of the correlation of the process at each node with the node above.

        $\ln a_i = -\frac{\lambda_i + \lambda_{i+1}}{2} (h_{i+1} - h_i)$

    Stochastic entry guidance, Eq. 8 without noise.

    Args:
        altitudes: ascending nodes, m, (n,).
        decay: lambda at the nodes, 1/m, (n,) or a scalar.

    Returns:
        ln a, 1, (n - 1,); entry i joins node i to the node i + 1 above it.

    Raises:
        ValueError: if the altitudes do not ascend, or the decay is negative or has another shape.
    """
    altitudes, decay = _checked_grid(altitudes, decay=decay)
    return -_means(decay) * np.diff(altitudes)


def retention(altitudes, decay):
    """Correlation of the process at each node with the one above, (n - 1,); arguments and errors as `log_retention`."""
    return np.exp(log_retention(altitudes, decay))


def innovation_variance(altitudes, decay, diffusion):
    r"""Variance that the noise adds between a node and the one above it (stochastic entry guidance, Eq. 8).

        $\frac{\varphi (1 - a^2)}{2 \lambda}, \quad \varphi \text{ and } \lambda \text{ the means of both nodes}, \quad
          a = \text{retention}$

    Exact for constant coefficients, of second order in the spacing otherwise; $\varphi \, dh$ where $\lambda$ is zero.

    Args:
        altitudes: ascending nodes, m, (n,).
        decay: $\lambda$ at the nodes, 1/m, (n,) or a scalar.
        diffusion: $\varphi$ at the nodes, 1/m, (n,) or a scalar.

    Returns:
        Variance, 1, (n - 1,); its square root is the `innovation_deviation` of `sample_process`.

    Raises:
        ValueError: if the altitudes do not ascend, or a coefficient is negative or has another shape.
    """
    altitudes, decay, diffusion = _checked_grid(altitudes, decay=decay, diffusion=diffusion)
    spacing = np.diff(altitudes)
    exponent = 2.0 * _means(decay) * spacing
    # (1 - e^-x) / x, which tends to 1
    fraction = np.divide(-np.expm1(-exponent), exponent, out=np.ones_like(exponent), where=exponent > 0.0)
    return _means(diffusion) * spacing * fraction


def process_variance(altitude_grid, decay, diffusion, initial_variance):
    r"""Variance of the process of Eq. 8 of the stochastic entry guidance, marched down from the last node.

        $\frac{d \, \text{Var}}{ds} = -2 \lambda \, \text{Var} + \varphi \text{:} \quad \text{Var}_i = a_i^2 \,
          \text{Var}_{i+1} + \text{innovation variance}$

    This is the variance of `sample_process` on the same grid, to rounding.

    Args:
        altitude_grid: ascending nodes, m, (n,).
        decay: $\lambda$ at the nodes, 1/m, (n,) or a scalar.
        diffusion: $\varphi$ at the nodes, 1/m, (n,) or a scalar.
        initial_variance: $\zeta_0$ of Eq. 9, at the last (highest) node, 1.

    Returns:
        Variance at the nodes, 1, (n,).

    Raises:
        ValueError: if the altitudes do not ascend, or a coefficient or the initial variance is negative.
    """
    if not initial_variance >= 0.0:
        raise ValueError(f"initial_variance must not be negative, got {initial_variance}")
    squared = retention(altitude_grid, decay) ** 2
    added = innovation_variance(altitude_grid, decay, diffusion)
    variance = np.empty(added.size + 1)
    variance[-1] = initial_variance
    for i in reversed(range(added.size)):
        variance[i] = squared[i] * variance[i + 1] + added[i]
    return variance


def sample_process(normals, retention, innovation_deviation, initial_deviation):
    r"""Samples of a Gaussian Markov process on ascending nodes, marched down from the last one.

        $y_{n-1} = \text{initial_deviation} \cdot z_{n-1}, \quad y_i = a_i y_{i+1} + \text{innovation_deviation}_i \cdot
          z_i$

    With the square root of `innovation_variance` this is the process of Eq. 8 of the stochastic entry guidance.

    Args:
        normals: z, independent standard normals, (trials, n).
        retention: a, 1, (n - 1,), see `retention`.
        innovation_deviation: standard deviation of the noise added at nodes 0 .. n - 2, (n - 1,).
        initial_deviation: standard deviation at the last node.

    Returns:
        Relative density variations at the nodes, 1, (trials, n).

    Raises:
        ValueError: if the shapes do not fit.
    """
    normals = np.asarray(normals, dtype=float)
    if normals.ndim != 2 or not np.shape(retention) == np.shape(innovation_deviation) == (normals.shape[1] - 1,):
        raise ValueError(
            f"normals (trials, n), retention (n - 1,) and innovation_deviation (n - 1,) do not fit: shapes "
            f"{normals.shape}, {np.shape(retention)} and {np.shape(innovation_deviation)}"
        )
    variations = np.empty_like(normals)
    variations[:, -1] = initial_deviation * normals[:, -1]
    for i in reversed(range(normals.shape[1] - 1)):
        variations[:, i] = retention[i] * variations[:, i + 1] + innovation_deviation[i] * normals[:, i]
    return variations


def sample_exact(normals, retention, deviation):
    r"""Samples with exactly the given deviation: a unit-variance Ornstein-Uhlenbeck process, scaled node by node.

        $\text{variation} = \text{deviation} \cdot y, \quad y_i = a_i y_{i+1} + \sqrt{1 - a_i^2} \, z_i, \quad y_{n-1} =
          z_{n-1}$

    Unlike Eq. 8 with the diffusion of Eq. 11 (stochastic entry guidance) this has no bias where the variance varies.

    Args:
        normals: z, independent standard normals, (trials, n).
        retention: a, 1, (n - 1,), see `retention`.
        deviation: standard deviation at the nodes, 1, (n,).

    Returns:
        Relative density variations at the nodes, 1, (trials, n).

    Raises:
        ValueError: if the shapes do not fit.
    """
    retention, deviation = np.asarray(retention, dtype=float), np.asarray(deviation, dtype=float)
    if deviation.shape != (retention.size + 1,):
        raise ValueError(
            f"deviation must have one value per node, shape {(retention.size + 1,)}, got {deviation.shape}"
        )
    return deviation * sample_process(normals, retention, np.sqrt((1.0 - retention) * (1.0 + retention)), 1.0)


# ---- density from its variation --------------------------------------------------------------------------------------


@jitable
def is_floored(variation, floor=0.0):
    """Whether `density_factor` has to raise the density, 1 + variation < floor (an unbounded Gaussian can need it).

    Args:
        variation: relative density variation, 1.
        floor: 1.

    Returns:
        Boolean, for the caller to count.
    """
    return 1.0 + variation < floor


@jitable
def density_factor(variation, floor=0.0):
    r"""Ratio of the density to its mean (stochastic entry guidance, Eq. 5; random field, Eq. 72), kept above a floor.

        $\rho / \bar{\rho} = \max(1 + \text{variation}, \, \text{floor})$

    Args:
        variation: relative density variation, 1. NaN stays NaN.
        floor: 1; zero keeps the density from being negative.

    Returns:
        Ratio, 1.
    """
    return np.maximum(1.0 + variation, floor)
