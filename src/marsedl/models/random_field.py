"""Gaussian random fields: covariance functions, conditioning, samples (random field, Eqs. 1-3, 16-18, 59, 73-74).

A kernel is a plain function of two broadcastable arrays of coordinates that returns their covariance; bind its
parameters with `functools.partial`. Coordinates are scalars (a field on a line) or, where a kernel says so, points of
d components along the last axis. Fields have mean zero unless a mean is asked for.

The process that a trajectory meets is the field at its positions, so the covariance function of Eq. 16c at the times
t_i is `covariance_matrix(kernel, positions)` of the positions at these times (Eqs. 17-18).
"""

from typing import NamedTuple

import numpy as np

from marsedl.models.density_variation import exponential_variance
from marsedl.summaries import summary

__all__ = [
    "Markov",
    "altitude_exponential",
    "condition",
    "condition_samples",
    "covariance_matrix",
    "interpolate",
    "locally_periodic",
    "markov",
    "root",
    "sample",
    "squared_exponential",
]

# What counts as rounding in a covariance matrix, and the least noise of a measurement: of the largest variance.
_ROUNDING = 1e-10
# Deviation from the Markov property that counts as rounding, relative to the deviations of both ends.
_MARKOV_ROUNDING = 1e-12
# Columns of the covariance that are held against the recursion from end to end.
_MARKOV_COLUMNS = 13

# ---- kernels ---------------------------------------------------------------------------------------------------------


def squared_exponential(first, second, variance, length):
    r"""Smooth stationary field on a line or, as a product over the components, in d dimensions.

        $\Sigma = \text{variance} \cdot \exp\left( -\sum_j \frac{(z_j - z_j^\prime)^2}{2 \, \text{length}_j^2} \right)$

    Args:
        first, second: coordinates, broadcastable; with d components along the last axis if length has d entries.
        variance: in the unit of the field squared.
        length: correlation length in the unit of the coordinates; a scalar on a line, (d,) in d dimensions.

    Returns:
        Covariance, broadcast shape of first and second (without their last axis if length has d entries).

    Raises:
        ValueError: if variance is negative, a length is not positive, or the last axes do not have d components.
    """
    length = np.asarray(length, dtype=float)
    _require_parameters(variance, length=length)
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if not length.ndim:
        return variance * np.exp(-0.5 * ((first - second) / length) ** 2)
    if length.ndim > 1 or any(points.shape[-1:] != length.shape for points in (first, second)):
        raise ValueError(
            f"length must be a scalar, or have one entry per component of the points: shape {length.shape} does not "
            f"fit points of shapes {first.shape} and {second.shape}"
        )
    return variance * np.exp(-0.5 * (((first - second) / length) ** 2).sum(axis=-1))


def locally_periodic(first, second, variance, period, periodic_length, length):
    r"""Field on a line that repeats itself with slowly changing shape (random field, Eq. 59).

        $\Sigma = \text{variance} \cdot \exp\left(
          -\frac{2 \sin^2(\pi \left| r - r^\prime \right| / \text{period})}{\text{periodic_length}^2} \right) \exp\left(
          -\frac{(r - r^\prime)^2}{2 \, \text{length}^2} \right)$

    Args:
        first, second: coordinates $r$ and $r^\prime$, broadcastable.
        variance: in the unit of the field squared.
        period: in the unit of the coordinates.
        periodic_length: 1; small values make sharp features within a period.
        length: distance over which the shape is forgotten, unit of the coordinates.

    Returns:
        Covariance, broadcast shape of first and second.

    Raises:
        ValueError: if variance is negative, or a length or the period not positive.
    """
    _require_parameters(variance, period=period, periodic_length=periodic_length, length=length)
    distance = np.subtract(first, second)
    within_period = 2.0 * (np.sin(np.pi * distance / period) / periodic_length) ** 2
    return variance * np.exp(-within_period - 0.5 * (distance / length) ** 2)


def altitude_exponential(
    first,
    second,
    variance,
    upper_altitude,
    growth_length,
    correlation_length,
    growth_sign=1,
    correlation_altitude="lower",
):
    r"""Relative density variation whose variance grows exponentially with altitude (random field, Eqs. 73-74).

        $\Sigma = \exp\left( -\frac{\left| h - h^\prime \right|}{\text{correlation_length}} \right) b(\min(h,
          h^\prime)),$
        $b(h) = \text{variance} \cdot \exp\left( \text{growth_sign} \cdot
          \frac{\min(h, \text{upper_altitude}) - \text{upper_altitude}}{\text{growth_length}} \right)$

    Eq. 74 prints growth_sign = -1, with which the variance falls with altitude, to its least at upper_altitude. That is
    a covariance as well, so only its values tell. With 1, $b$ is `density_variation.exponential_variance`.

    Args:
        first, second: altitudes $h$ and $h^\prime$, m, broadcastable.
        variance: value at and above upper_altitude, 1.
        upper_altitude: m.
        growth_length: altitude over which the variance changes by e, m.
        correlation_length: m; may be infinite.
        growth_sign: 1, or -1 as printed.
        correlation_altitude: which altitude's variance scales the covariance: "lower" as printed, "upper" for
            $b(\max(h, h^\prime))$, "both" for $\sqrt{b(h) b(h^\prime)}$. The last with an infinite correlation_length
            is the fully correlated field $\sqrt{b(h)} \, \xi$ of one normal number $\xi$; with the others a changing
            $b$ alone decorrelates. A field exists for "upper" and growth_sign 1 only if
            $\text{correlation_length} \le 2 \, \text{growth_length}$, and likewise for "lower" and -1.

    Returns:
        Covariance, 1, broadcast shape of first and second.

    Raises:
        ValueError: if variance is negative, a length not positive, or growth_sign or correlation_altitude another.
    """
    _require_parameters(variance, growth_length=growth_length, correlation_length=correlation_length)
    if growth_sign not in (1, -1):
        raise ValueError(f"growth_sign must be 1 (variance grows with altitude) or -1 (as printed), not {growth_sign}")
    shape = (variance, upper_altitude, growth_sign * growth_length)
    if correlation_altitude == "lower":
        local, _ = exponential_variance(np.minimum(first, second), *shape)
    elif correlation_altitude == "upper":
        local, _ = exponential_variance(np.maximum(first, second), *shape)
    elif correlation_altitude == "both":
        local = np.sqrt(exponential_variance(first, *shape)[0] * exponential_variance(second, *shape)[0])
    else:
        raise ValueError(f"correlation_altitude must be 'lower', 'upper' or 'both', not {correlation_altitude!r}")
    return np.exp(-np.abs(np.subtract(first, second)) / correlation_length) * local


# ---- covariance matrices ---------------------------------------------------------------------------------------------


def covariance_matrix(kernel, points, second_points=None):
    r"""Covariance of the field between all pairs of points (random field, Eq. 3; along a trajectory Eq. 16c).

        $C_{ij} = \Sigma(z_i, z_j^\prime)$

    Args:
        kernel: function of two arrays of coordinates.
        points: z, (k,) on a line or (k, d).
        second_points: $z^\prime$, (m,) or (m, d); the same points if None.

    Returns:
        C, unit of the field squared, (k, m).

    Raises:
        ValueError: if points are of another shape, or the kernel returns other shapes or numbers that are not finite.
    """
    points = _checked_points("points", points)
    second_points = points if second_points is None else _checked_points("second_points", second_points)
    if points.shape[1:] != second_points.shape[1:]:
        raise ValueError(
            f"points and second_points must have the same dimension: shapes {points.shape} and {second_points.shape}"
        )
    return _evaluate(kernel, points[:, np.newaxis], second_points[np.newaxis], (len(points), len(second_points)))


def root(covariance):
    """Symmetric square root M = M', M M' = covariance, for samples of any Gaussian vector, singular ones included.

    The symmetric root is unique, where factors by eigenvectors have arbitrary signs: samples made with it do not
    depend on the library that finds the eigenvectors. Negative eigenvalues of the size of rounding count as zero.

    Args:
        covariance: positive semidefinite, (k, k).

    Returns:
        M, (k, k), symmetric to the last bit.

    Raises:
        ValueError: if it is not square, finite and symmetric, or has a negative eigenvalue; the message says which.
    """
    eigenvalues, vectors = _decomposed(covariance)
    quarter = vectors * np.maximum(eigenvalues, 0.0) ** 0.25
    return _symmetric(quarter @ quarter.T)


def sample(normals, root):
    """Samples of a Gaussian vector of mean zero, x = M z.

    Args:
        normals: z, independent standard normals, (trials, n).
        root: M with covariance M M', see `root`; (k, n).

    Returns:
        Samples, (trials, k); a trial does not depend on the others, to the last bit.

    Raises:
        ValueError: if the shapes do not fit.
    """
    normals, root = np.asarray(normals, dtype=float), np.asarray(root, dtype=float)
    if normals.ndim != 2 or root.ndim != 2 or normals.shape[1] != root.shape[1]:
        raise ValueError(f"normals (trials, n) and root (k, n) do not fit: shapes {normals.shape} and {root.shape}")
    return _combine(normals, root.T)


# ---- conditioning on measurements ------------------------------------------------------------------------------------


def condition(kernel, points, measured_points, values, noise_variance, mean=0.0):
    r"""Mean and covariance of the field given measurements $y = \Psi(z) + \text{noise}$ (random field, Figs. 1-2).

        $\text{mean} + K_{*z} (K_{zz} + R)^{-1} (y - \text{mean}), \quad K_{**} - K_{*z} (K_{zz} + R)^{-1} K_{z*}$

    Measurements without noise are allowed: noise below 1e-10 of the largest prior variance is raised to that, without
    which $K_{zz}$ would be singular for neighbouring points. Where the field is predictable from the other measurements
    the values are then met to about 1e-5 prior deviations at worst, elsewhere to 1e-10.

    Args:
        kernel: covariance function of the prior.
        points: where the field is wanted, (k,) or (k, d).
        measured_points: z, (m,) or (m, d).
        values: y, unit of the field, (m,).
        noise_variance: diagonal of R, unit of the field squared, scalar or (m,).
        mean: of the prior, constant; take one that varies from the values, and add it to the result.

    Returns:
        Tuple of mean (k,) and covariance (k, k), symmetric to the last bit. For samples use `condition_samples`.

    Raises:
        ValueError: if shapes do not fit, noise is negative, a value is not finite, or the kernel is not a covariance.
    """
    from scipy.linalg import solve_triangular

    if np.ndim(mean):
        raise ValueError("mean must be one number; take a mean that varies from the values, and add it to the result")
    factor, whitened, values, _ = _measurement_factor(kernel, points, measured_points, values, noise_variance)
    covariance = _symmetric(covariance_matrix(kernel, points) - whitened.T @ whitened)
    return mean + whitened.T @ solve_triangular(factor, values - mean, lower=True), covariance


def condition_samples(kernel, points, measured_points, values, noise_variance, samples, noise_normals=None):
    r"""Samples of the field given measurements, each the correction of a sample without them (Matheron's rule).

        $x_* + K_{*z} (K_{zz} + R)^{-1} (y - x_z - e),$
        $(x_*, x_z) \text{ a joint sample of the prior}, \quad e \text{ a sample of the noise}$

    They have the mean and covariance of `condition`, and far from all measurements they equal the samples given.

    Args:
        kernel, points, measured_points, values, noise_variance: as of `condition`.
        samples: of the prior with its mean, at points and then at measured_points, (trials, k + m).
        noise_normals: independent standard normals, (trials, m); may be left out if there is no noise.

    Returns:
        Samples at points, unit of the field, (trials, k).

    Raises:
        ValueError: as `condition`, or if the samples have other shapes, or there is noise and no noise_normals.
    """
    from scipy.linalg import solve_triangular

    factor, whitened, values, deviation = _measurement_factor(kernel, points, measured_points, values, noise_variance)
    (m, k), samples = whitened.shape, np.asarray(samples, dtype=float)
    if samples.ndim != 2 or samples.shape[1] != k + m:
        raise ValueError(
            f"samples must have one column per point and then per measured point, shape (trials, {k + m}), "
            f"not {samples.shape}"
        )
    errors = 0.0
    if noise_normals is not None:
        errors = deviation * np.asarray(noise_normals, dtype=float)
        if errors.shape != (len(samples), m):
            raise ValueError(f"noise_normals must have shape {(len(samples), m)}, not {errors.shape}")
    elif deviation.any():
        raise ValueError("noise_normals must be given where noise_variance is not zero")
    weights = solve_triangular(factor, whitened, lower=True, trans="T")
    return samples[:, :k] + _combine(values - samples[:, k:] - errors, weights)


# ---- Markov fields of altitude ---------------------------------------------------------------------------------------


class Markov(NamedTuple):
    """Field on n ascending altitudes as a recursion from the top, y_i = a_i y_(i+1) + s_i z_i, z standard normal.

    `density_variation.sample_process(normals, *markov)` draws samples of it.
    """

    retention: np.ndarray  # a_i, joins node i to the node above it, 1, (n - 1,)
    innovation_deviation: np.ndarray  # s_i, unit of the field, (n - 1,)
    top_deviation: float  # of y_(n-1), unit of the field

    __repr__ = summary


def markov(kernel, altitudes):
    r"""Coefficients of the recursion whose samples have exactly the covariance of a Markov kernel, in O(n).

        $a_i = \frac{\Sigma(h_i, h_{i+1})}{\Sigma(h_{i+1}, h_{i+1})}, \quad s_i^2 = \Sigma(h_i, h_i) - a_i \Sigma(h_i,
          h_{i+1})$

    A kernel is Markov on the nodes if $\Sigma(h_i, h_j) \Sigma(h_m, h_m) = \Sigma(h_i, h_m) \Sigma(h_m, h_j)$ whenever
    $i < m < j$; then the inverse of the covariance matrix is tridiagonal. Random field, Eqs. 73-74 are: a function of
    the lower altitude times one of the upper. Checked for $m = i + 1$ and all $i$, with $j = i + 2$ and $j$ on a coarse
    subset.

    Args:
        kernel: covariance function of two altitudes.
        altitudes: ascending nodes, m, (n,).

    Returns:
        `Markov`; $a_i = 0$ where the node above has no variance.

    Raises:
        ValueError: if the altitudes do not ascend, or the kernel is not a covariance or is not Markov on them.
    """
    altitudes = _ascending("altitudes", altitudes)
    below, above = altitudes[:-1], altitudes[1:]
    variance = _evaluate(kernel, altitudes, altitudes, altitudes.shape)
    adjacent = _evaluate(kernel, below, above, below.shape)
    wrong = adjacent**2 > (1.0 + _ROUNDING) * variance[:-1] * variance[1:]
    if (variance < 0.0).any() or wrong.any():
        at = np.argmax(wrong) if wrong.any() else np.argmax(variance < 0.0)
        raise ValueError(
            f"kernel is not a covariance: at {altitudes[at]:g} m it has a negative variance, or one too small for its "
            "covariance with the next altitude; check its parameters"
        )
    retention = np.divide(adjacent, variance[1:], out=np.zeros_like(adjacent), where=variance[1:] > 0.0)
    innovation = variance[:-1] - retention * adjacent
    # A fully correlated field has no innovations at all, and rounding would leave some.
    innovation[innovation <= 8.0 * np.finfo(float).eps * variance[:-1]] = 0.0

    deviation, n = np.sqrt(variance), altitudes.size
    nodes = np.arange(n - 2)
    columns = np.unique(np.linspace(0, n - 1, min(n, _MARKOV_COLUMNS)).round().astype(int))
    to_columns = [(nodes[: j - 1], np.full(j - 1, j)) for j in columns if j > 1]
    for i, j in [(nodes, nodes + 2), *to_columns]:
        direct = _evaluate(kernel, altitudes[i], altitudes[j], i.shape)
        change = retention[i] * _evaluate(kernel, altitudes[i + 1], altitudes[j], i.shape) - direct
        wrong = np.abs(change) > _MARKOV_ROUNDING * deviation[i] * deviation[j]
        if wrong.any():
            at = np.argmax(wrong)
            raise ValueError(
                "kernel is not Markov on these altitudes: the recursion would change its value "
                f"{direct[at]:.2e} between {altitudes[i[at]]:g} and {altitudes[j[at]]:g} m by {change[at]:.1e}; "
                "sample it by the `root` of its covariance matrix instead"
            )
    return Markov(retention, np.sqrt(innovation), float(deviation[-1]))


# ---- use of a sample -------------------------------------------------------------------------------------------------


def interpolate(positions, grid, values):
    """Values of sampled fields between the nodes: linear, and held constant outside of the grid.

    Args:
        positions: (q,), or (..., q) with leading dimensions that broadcast with those of values: (trials, 1) looks
            up one position of its own for every trial. NaN gives NaN.
        grid: ascending nodes, (n,), in the unit of the positions.
        values: samples at the nodes, (..., n).

    Returns:
        Values at the positions, (..., q); without the last axis if positions is a scalar.

    Raises:
        ValueError: if the grid does not ascend, or the values do not have one entry per node.
    """
    grid, values = _ascending("grid", grid), np.asarray(values, dtype=float)
    if values.shape[-1:] != grid.shape:
        raise ValueError(f"values must have one entry per node, shape (..., {grid.size}), not {values.shape}")
    positions = np.asarray(positions, dtype=float)
    points = np.atleast_1d(positions)
    lower = np.clip(np.searchsorted(grid, points, side="right") - 1, 0, grid.size - 2)
    fraction = np.clip((points - grid[lower]) / (grid[lower + 1] - grid[lower]), 0.0, 1.0)
    leading = np.broadcast_shapes(points.shape[:-1], values.shape[:-1])
    lower = np.broadcast_to(lower, leading + lower.shape[-1:])
    values = np.broadcast_to(values, leading + grid.shape)
    at_lower, at_upper = (np.take_along_axis(values, lower + step, axis=-1) for step in (0, 1))
    interpolated = (1.0 - fraction) * at_lower + fraction * at_upper
    return interpolated if positions.ndim else interpolated[..., 0]


# ---- checks ----------------------------------------------------------------------------------------------------------


def _require_parameters(variance, **lengths):
    if not variance >= 0.0:
        raise ValueError(f"variance must not be negative, got {variance}")
    for name, length in lengths.items():
        if not np.all(np.asarray(length) > 0.0):
            raise ValueError(f"{name} must be positive, got {length}")


def _checked_points(name, points):
    points = np.asarray(points, dtype=float)
    if points.ndim not in (1, 2) or not points.size:
        raise ValueError(f"{name} must have shape (k,) on a line or (k, d) in d dimensions, k > 0, not {points.shape}")
    return points


def _ascending(name, nodes):
    nodes = np.asarray(nodes, dtype=float)
    if nodes.ndim != 1 or nodes.size < 2 or not np.isfinite(nodes).all() or not (np.diff(nodes) > 0.0).all():
        raise ValueError(f"{name} must be at least 2 finite, strictly increasing nodes; sort them upwards")
    return nodes


def _evaluate(kernel, first, second, shape):
    covariance = np.asarray(kernel(first, second), dtype=float)
    if covariance.shape != shape:
        raise ValueError(
            f"kernel must return one covariance per pair, shape {shape}, not {covariance.shape}; points of d "
            "components need a kernel of d dimensions"
        )
    if not np.isfinite(covariance).all():
        raise ValueError("kernel is not finite for some pair of points; check its parameters and the points")
    return covariance


def _decomposed(covariance):
    """Eigenvalues and eigenvectors; errors of the size of rounding are accepted (1e-10 of the largest entry)."""
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1] or not covariance.size:
        raise ValueError(f"covariance must be a square matrix, not of shape {covariance.shape}")
    if not np.isfinite(covariance).all():
        raise ValueError("covariance is not finite; check the kernel or data that it comes from")
    largest = np.abs(covariance).max()
    asymmetry = np.abs(covariance - covariance.T).max()
    if asymmetry > _ROUNDING * largest:
        raise ValueError(
            "covariance is not symmetric: entries differ from their mirror images by up to "
            f"{asymmetry / largest:.1e} of the largest"
        )
    covariance = _symmetric(covariance)
    eigenvalues, vectors = np.linalg.eigh(covariance)
    scale = np.abs(eigenvalues).max()
    if eigenvalues[0] < -_ROUNDING * scale:
        raise ValueError(
            f"covariance is not positive semidefinite: its smallest eigenvalue is {eigenvalues[0] / scale:.1e} of the "
            "largest; check the parameters of its kernel"
        )
    return eigenvalues, vectors


def _symmetric(matrix):
    return (matrix + matrix.T) / 2


def _measurement_factor(kernel, points, measured_points, values, noise_variance):
    """Factor L of Kzz + R = L L', L^-1 Kz*, the values and the deviation of their noise as stated."""
    from scipy.linalg import cholesky, solve_triangular

    prior = covariance_matrix(kernel, measured_points)
    cross = covariance_matrix(kernel, measured_points, points)
    values, noise_variance = np.asarray(values, dtype=float), np.asarray(noise_variance, dtype=float)
    if values.shape != prior.shape[:1] or not np.isfinite(values).all():
        raise ValueError(f"values must be one finite number per measured point, shape {prior.shape[:1]}")
    if noise_variance.shape not in ((), values.shape) or not (noise_variance >= 0.0).all():
        raise ValueError(f"noise_variance must be a scalar or of shape {values.shape}, and not negative")
    used = np.maximum(noise_variance, _ROUNDING * prior.diagonal().max())
    try:
        factor = cholesky(prior + used * np.eye(len(values)), lower=True)
    except np.linalg.LinAlgError:
        raise ValueError(
            "kernel: the covariance of the measurements is not positive definite; check the parameters of the kernel, "
            "and give noise_variance if the field itself has no variance"
        ) from None
    return factor, solve_triangular(factor, cross, lower=True), values, np.sqrt(noise_variance)


def _combine(rows, matrix):
    """Product rows @ matrix summed in fixed order, which a library's would change with the number of rows."""
    combined = np.zeros((len(rows), matrix.shape[1]))
    for row, line in zip(rows.T, matrix, strict=True):
        combined += row[:, np.newaxis] * line
    return combined
