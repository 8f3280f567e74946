"""The levels and their checks, and the studies beside them."""

import numpy as np

from marsedl.papers.funnels.claims.measures import flown_levels, largest, largest_error, over_flown
from marsedl.papers.funnels.inputs import Planet
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Proven,
    StageStudy,
)
from marsedl.replication.records.tables import Column, table
from marsedl.replication.units import DEGREE, KM

TIMES = 13  # at which levels are tabulated
PLACES = ("altitude", "downrange", "crossrange")
ANGLES = ("flight path angle", "heading")
# Half widths of the six states, as they are shown.
WIDTHS = {
    **{place: Column("km", ".4g") for place in PLACES},
    "velocity": Column("m/s", ".4g"),
    **{angle: Column("deg", ".4g") for angle in ANGLES},
}


def _ground(radius, widths):
    """Half widths of the six states in km, km, km, m/s, deg and deg."""
    units = np.array([1.0 / KM, radius / KM, radius / KM, 1.0, 1.0 / DEGREE, 1.0 / DEGREE])
    return widths * units


# ---- the funnel ------------------------------------------------------------------------------------------------------


def levels(
    funnel: Funnel,
    linear_bounds: LinearBounds,
    constant: FlightEnsemble,
    redrawn: FlightEnsemble,
    adversarial: FlightEnsemble,
):
    """Level of the funnel at equally spaced slices, beside that of linear dynamics and of flights."""
    ratio = np.concatenate([[1.0], over_flown(funnel, constant)])
    spread = largest_error(funnel, constant)  # the maximum of all varies as that of a tenth does, at most
    numbers = np.unique(np.linspace(0, len(funnel.time) - 1, TIMES).round().astype(int))
    columns = (
        np.arange(len(funnel.time)) + 1,
        *(funnel.time, funnel.level, funnel.log_volume, linear_bounds.exact_level, linear_bounds.triangle_level),
        *(flown_levels(funnel, constant), spread, flown_levels(funnel, redrawn), flown_levels(funnel, adversarial)),
        ratio,
    )
    largest_v = "largest V of the flights"
    return table(
        zip(*(values[numbers] for values in columns), strict=True),
        {
            "k": Column(meaning="number of the slice"),
            "time": Column("s", ".2f"),
            "rho": Column("", ".5g"),
            "logarithm of the volume": Column("", ".5g", "of the slice, in m^2 rad^4/s"),
            "linear dynamics, exact": Column("", ".5g"),
            "linear dynamics, triangle inequality": Column("", ".5g"),
            "constant disturbance": Column("", ".5g", f"{largest_v}, {len(constant.outcome):,}"),
            "its standard deviation": Column("", ".2g", "from ten parts of the flights"),
            "redrawn disturbance": Column("", ".5g", f"{largest_v}, {len(redrawn.outcome):,}"),
            "adversarial disturbance": Column("", ".5g", f"{largest_v}, {len(adversarial.outcome):,}"),
            "rho over flights": Column("", ".4g", "over the largest V under constant disturbance"),
        },
    )


def half_widths(planet: Planet, funnel: Funnel, linear_bounds: LinearBounds, constant: FlightEnsemble):
    """Largest deviations of the states at the first slice, at that of the largest level, and at the last."""
    rows = []
    top = int(np.argmax(np.where(np.isfinite(funnel.level), funnel.level, -np.inf)))
    ends = np.abs(constant.final_state[:, : funnel.half_width.shape[1]])
    for name, k in (("first", 0), ("of the largest rho", top), ("last", len(funnel.level) - 1)):
        sets = [
            ("funnel", funnel.half_width[k], funnel.feedback[k] / DEGREE),
            ("linear dynamics, same shape", linear_bounds.exact_half_width[k], None),
        ]
        if k == len(funnel.level) - 1:
            sets.append((f"{len(ends):,} flights", [largest(column) for column in ends.T], None))
        rows += [
            (name, funnel.time[k], what, *_ground(planet.planet_radius, np.asarray(widths)), bank)
            for what, widths, bank in sets
        ]
    return table(
        rows,
        {
            "slice": Column(),
            "time": Column("s", ".1f"),
            "of": Column(),
            **WIDTHS,
            "bank angle of the feedback": Column("deg", ".4g", "largest on the slice"),
        },
    )


def verification(funnel: Funnel):
    """Every stage: its program, the checks of its certificate, and what the motion itself does."""
    tight = dict(zip(funnel.tightness_stage, funnel.tightness, strict=True))
    rows = [
        (
            k + 1,
            *(values[k] for values in (funnel.level, funnel.bound, funnel.growth, funnel.additive_growth)),
            *(funnel.gap[k], funnel.residual[k], int(funnel.iterations[k]), str(funnel.status[k])),
            *(values[k] for values in (funnel.identity_error, funnel.least_value, funnel.least_eigenvalue)),
            *(funnel.rounding_margin[k], bool(funnel.stage_sound[k]), funnel.true_maximum[k]),
            *(100.0 * funnel.violation[k], tight.get(k + 1)),
        )
        for k in range(len(funnel.bound))
    ]
    return table(
        rows,
        {
            "k": Column(meaning="number of the stage"),
            "rho": Column("", ".6g"),
            "bound over rho": Column("", ".7f"),
            "factor taken": Column("", ".7f"),
            "by additive disturbances": Column("", ".3g", "in units of rho"),
            "duality gap": Column("", ".1e"),
            "violation of the equations": Column("", ".1e"),
            "iterations": Column(),
            "solver": Column(meaning="its status"),
            "error of the sum of squares": Column("", ".1e", "at fresh points"),
            "least distance to the bound": Column("", ".2e"),
            "least eigenvalue": Column("", ".1e", "of the Gram matrix"),
            "rounding of it": Column("", ".1e"),
            "sound": Column(),
            "largest of the motion over rho": Column("", ".7f"),
            "beyond the bound": Column("%", "+.4f", "of the motion"),
            "polynomial below its bound": Column("", ".1e", "by how much; sought at some stages"),
        },
    )


# ---- studies ---------------------------------------------------------------------------------------------------------


def forms(stage_study: StageStudy):
    """The benchmark stage in all forms of its program."""
    study, reference = stage_study, stage_study.form_bound[0]
    rows = zip(
        study.form.astype(str),
        study.form_bound,
        study.form_bound / reference - 1.0,
        *(study.form_safe_bound, study.form_gap, study.form_residual, study.form_iterations),
        study.form_status.astype(str),
        strict=True,
    )
    return table(
        rows,
        {
            "form and solver": Column(),
            "bound over rho": Column("", ".8f"),
            "difference": Column("", "+.1e", "from the first, relative"),
            "safe bound": Column("", ".8f"),
            "duality gap": Column("", ".1e"),
            "violation of the equations": Column("", ".1e"),
            "iterations": Column(),
            "ended": Column(),
        },
    )


def counts(stage_study: StageStudy):
    """Monomials, rows of the Gram matrix and samples, by formula and by rank."""
    study = stage_study
    rows = [
        (
            str(name),
            *(int(values[k]) for values in (study.variables, study.monomials, study.basis_size)),
            int(study.basis_rank[k]) or None,
            *(int(values[k]) for values in (study.coefficients, study.gram_unknowns, study.samples)),
            int(study.product_rank[k]) or None,
        )
        for k, name in enumerate(study.variety)
    ]
    by_rank = "computed from samples, for some"
    return table(
        rows,
        {
            "spheres": Column(),
            "variables": Column(),
            "monomials up to degree 2": Column(),
            "independent": Column(meaning="of them"),
            "rank at samples": Column(meaning=by_rank),
            "monomials up to degree 4": Column(),
            "entries of the Gram matrix": Column(),
            "least number of samples": Column(),
            "rank of products": Column(meaning=by_rank),
        },
    )


def few_samples(stage_study: StageStudy):
    """Bounds of the benchmark stage by too few random samples."""
    study = stage_study
    return table(
        zip(study.few_samples, study.few_bound, study.few_rank, study.few_least_value, strict=True),
        {
            "samples": Column(),
            "bound over rho": Column("", ".6f"),
            "rank": Column(),
            "least distance to fresh points": Column("", "+.1e"),
        },
    )


def variants(coarse_funnels: CoarseFunnels):
    """Funnels with coarse slices by other programs, orders and directions."""
    study = coarse_funnels
    numbers = np.unique(np.linspace(0, study.variant_level.shape[1] - 1, 7).round().astype(int))
    rows = [
        (str(name), *values[numbers], str(outcome))
        for name, values, outcome in zip(study.variant, study.variant_level, study.variant_outcome, strict=True)
    ]
    levels_at = {f"rho at fine step {study.coarse_step[k]}": Column("", ".6g") for k in numbers}
    return table(rows, {"funnel": Column(), **levels_at, "outcome": Column()})


def proof(funnel: Funnel, proven: Proven):
    """Proven levels beside those by samples, and what their bounds consist of."""
    numbers = np.unique(np.linspace(0, len(proven.step) - 1, TIMES).round().astype(int))
    parts = (proven.bound, proven.polynomial_bound, proven.truncation, proven.remainder, proven.rise)
    rows = [
        (
            int(k) + 1,
            *(proven.time[k], proven.level[k], proven.level[k] / funnel.level[k]),
            *(values[k] if k < len(values) else None for values in parts),
        )
        for k in numbers
    ]
    return table(
        rows,
        {
            "k": Column(meaning="number of the slice"),
            "time": Column("s", ".2f"),
            "proven rho": Column("", ".6g"),
            "over that by samples": Column("", ".5f"),
            "proven bound over rho": Column("", ".7f", "of the stage that begins there"),
            "of its polynomial": Column("", ".7f", "part of the bound"),
            "known terms of higher degree": Column("", ".2e", "part of the bound"),
            "remainder": Column("", ".2e", "part of the bound"),
            "inside of the slice": Column("", ".2e", "part of the bound"),
        },
    )
