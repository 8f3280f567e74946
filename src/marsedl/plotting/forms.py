"""Forms that figures of several papers have.

A covariance in a plane, a predicted variance against a sampled one, the distribution of a sample with a normal density,
and the history of an iteration with standard errors.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from marsedl.montecarlo.statistics import variance_sampling_band
from marsedl.plotting.curves import bounds, mark, plot
from marsedl.plotting.ellipses import ellipse
from marsedl.plotting.fields import Field, field
from marsedl.plotting.style import BLACK, SKY
from marsedl.replication.units import converted

SAMPLING_LEVEL = 0.95  # probability that the variance of a sample lies in the band that is drawn


def covariance_ellipse(
    axes: Axes,
    record: Any,
    components: tuple[str, str],
    sigma: float,
    *,
    at: Mapping[str, int],
    units: tuple[str, str] = ("", ""),
    **style: Any,
) -> np.ndarray:
    """Draw the ellipse of two components about their mean; returns the curve (points, 2), in the units that are shown.

    record: an artifact with the fields `mean` and `covariance`; components: to the right and upwards; sigma: size of
    the ellipse, in standard deviations; at: index in all further dimensions, by their names; units: to show the
    components in, if not their own; style: of the line. Raises ValueError as `fields.field` does.
    """
    means = [
        field(record, f"mean.{component}", unit=unit, at=at) for component, unit in zip(components, units, strict=True)
    ]
    covariance = np.array(
        [[field(record, f"covariance.{first}.{second}", at=at).values for second in components] for first in components]
    )
    stored_units = [field(record, f"mean.{component}", at=at).unit for component in components]
    scale = np.array([converted(1.0, unit, mean.unit) for unit, mean in zip(stored_units, means, strict=True)])
    curve = ellipse([mean.values for mean in means], covariance * np.outer(scale, scale), sigma)
    right, up = (mean.of(values) for mean, values in zip(means, curve.T, strict=True))
    plot(axes, Field(up.values, up.name, up.unit, right), **style)
    return curve


def predicted_against_sampled(
    variance: Axes, ratio: Axes, predicted: Field, sampled: Field, count: int, *, label: str = "predicted", **style: Any
) -> None:
    """Draw a predicted variance with the band in which that of a sample lies, and the sample's; below, their ratio.

    variance: axes of the variances; ratio: axes of the ratio, in percent of the prediction; predicted: variance over
    time; sampled: variance of the sample, at any of these times; count: size of the sample, which is taken as normal;
    label: of the prediction; style: of its line, whose colour is the band's.

    Raises ValueError if the variances are in different units.
    """
    expected = predicted.at(sampled)
    share = sampled.of(100.0 * (sampled.values / expected.values - 1.0), "deviation of sampled\nfrom predicted", "%")
    dots = {"linestyle": "none", "marker": ".", "markersize": 3, "color": BLACK}
    lower, upper = (predicted.of(bound) for bound in variance_sampling_band(predicted.values, count, SAMPLING_LEVEL))
    bounds(
        variance, lower, upper, filled=True, color=style.get("color"), label=f"{100 * SAMPLING_LEVEL:g} % sampling band"
    )
    plot(variance, predicted, label=label, **style)
    plot(variance, sampled, label=f"{count:,} flights", **dots)
    low, high = (
        share.of(100.0 * (bound - 1.0))
        for bound in variance_sampling_band(1.0 + 0.0 * expected.values, count, SAMPLING_LEVEL)
    )
    bounds(ratio, low, high, filled=True, color=style.get("color"))
    plot(ratio, share, **dots)
    mark(ratio, y=0.0, **{"linestyle": "-", "linewidth": 1.2} | style)
    variance.set_ylim(bottom=0)


def distribution(
    axes: Axes, samples: Field, window: tuple[float, float], normal: tuple[float, float] | None = None, **style: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the density of a sample as a histogram, and a normal density in front of it.

    Samples that are not finite, or outside of the window, count in the size of the sample, but are not shown.

    samples: (count,); its name and unit are those of the horizontal axis; window: least and largest value that is
    shown; normal: mean and standard deviation of the normal density, which is left out if they are not finite; style:
    of the histogram. Returns heights (bins,) and edges (bins + 1,) of the histogram.
    """
    inside = samples.values[(samples.values >= window[0]) & (samples.values <= window[1])]
    # As fine as the samples' spread asks for: a wide window may hold a small spread.
    width = 3.5 * inside.std() / len(inside) ** (1 / 3) if len(inside) > 1 else 0.0
    bins = int(np.clip((window[1] - window[0]) / width, 20, 150)) if width > 0 else 20
    counts, edges = np.histogram(inside, bins, range=window)
    heights = counts / (len(samples.values) * np.diff(edges))
    axes.stairs(heights, edges, **{"color": SKY, "fill": True} | style)
    mean, deviation = normal or (np.nan, np.nan)
    if np.isfinite(mean) and np.isfinite(deviation) and deviation > 0:
        grid = np.linspace(*window, 1001)
        value = np.unique(np.append(grid, np.clip(mean + deviation * np.linspace(-5, 5, 201), *window)))
        density = np.exp(-(((value - mean) / deviation) ** 2) / 2) / (deviation * np.sqrt(2 * np.pi))
        axes.plot(value, density, color=BLACK)
    axes.set(xlabel=samples.label, xlim=window)
    return heights, edges
