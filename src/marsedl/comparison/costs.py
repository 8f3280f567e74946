"""Size and cost of every paper's method."""

import textwrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from marsedl.comparison.records import COLORS, NAMES
from marsedl.papers.desensitized.records import Nominal as DesensitizedNominal
from marsedl.papers.desensitized.records import Tradeoff as DesensitizedTradeoff
from marsedl.papers.funnels.funnel import Funnel as FunnelsFunnel
from marsedl.papers.funnels.proven import Proven as FunnelsProven
from marsedl.papers.funnels.stage_study import StageStudy as FunnelsStageStudy
from marsedl.papers.powered_descent.gains import Gains as PoweredDescentGains
from marsedl.papers.powered_descent.nominal import Nominal as PoweredDescentNominal
from marsedl.papers.random_field.records import Gains as RandomFieldGains
from marsedl.papers.stochastic_entry.records import Gains as StochasticEntryGains
from marsedl.plotting.style import new_figure
from marsedl.replication.errors import InputError
from marsedl.replication.tables import Column
from marsedl.replication.tables import table as table_of

if TYPE_CHECKING:
    from pandas import DataFrame

MICRO = 1e-6
FLIGHTS = 2  # the panel
FUNNEL_FLIGHTS = 10_000  # behind one of the run times


class Cost(NamedTuple):
    """One method; times in seconds, as the benchmarks measured them."""

    method: str
    unknowns: int
    unknowns_are: str
    conditions: int
    conditions_are: str
    problems: int
    iterations: int | None
    design: float
    design_is: str
    flight: "Flight"
    everything: float


class Flight(NamedTuple):
    """Times of one flight with its outputs and random numbers, s; None where it was not measured."""

    compiled: float | None  # by the kernel
    in_c: float | None  # the same arithmetic, bit for bit, in strict C
    in_arrays: float | None  # the same scheme in array code


def powered_descent(
    nominal: PoweredDescentNominal, gains: PoweredDescentGains, measured: dict | None = None
) -> list[Cost]:
    """Closed form: it has as many unknowns as conditions."""
    segments, states = gains.mean_costate.shape
    numbers = segments * (states + _triangle(states))
    return [
        Cost(
            "closed-form covariance steering",
            numbers,
            "costates of the mean, Riccati solutions",
            numbers,
            "final means and covariances",
            segments,
            len(nominal.largest_change),
            *_design(measured, "design with mass iteration, compiled"),
            _flight(measured, "2,000 trials with outputs"),
            _everything(measured, "powered_descent"),
        )
    ]


def random_field(gains: RandomFieldGains, measured: dict | None = None) -> list[Cost]:
    """Cone programs of the iterations; zeros of the gains belong to the future, or to a start without errors."""
    return [
        Cost(
            "successive convexification, cone programs",
            gains.control[-1].size + int(np.count_nonzero(gains.gain[-1])),
            "mean controls, gains on all earlier states",
            2 * gains.control[-1].size,
            "chance constraints on the control",
            len(gains.objective),
            int(gains.solver_iterations.sum()),
            *_design(measured, "nominal, linear model and laws of three iterations, compiled"),
            _flight(measured, "5,000 flights of the last law with outputs"),
            _everything(measured, "random_field"),
        )
    ]


def desensitized(
    nominal: DesensitizedNominal, tradeoff: DesensitizedTradeoff, measured: dict | None = None
) -> list[Cost]:
    """Collocation with sensitivities among the states; constant ones are not counted."""
    plain = nominal.state.size + nominal.bank_acceleration.size + 1
    nodes = nominal.state.shape[0]
    moving = int(np.any(tradeoff.column != tradeoff.column[:, :1], axis=(0, 1)).sum())
    equations = nominal.costate.shape
    flight = _flight(measured, "5,000 flights with feedback and outputs")
    everything = _everything(measured, "desensitized")
    return [
        Cost(
            "collocation, path of desensitized solutions",
            plain + moving * nodes,
            "states, sensitivities to the radius at entry, controls, final time",
            equations[0] * (equations[1] + moving),
            "equations of motion and of sensitivities",
            tradeoff.solves,
            None,
            *_design(measured, "path and rows of Table 3"),
            flight,
            everything,
        )
    ]


def funnels(
    funnel: FunnelsFunnel, proven: FunnelsProven, stage_study: FunnelsStageStudy, measured: dict | None = None
) -> list[Cost]:
    """Sums of squares: the funnel of the paper, and the one that is proven."""
    size = int(stage_study.basis_size[list(stage_study.samples).index(len(funnel.samples))])
    conditions = "values of the polynomial at samples"
    in_arrays = _run_time(measured, f"Monte Carlo, {FUNNEL_FLIGHTS:,} flights") / FUNNEL_FLIGHTS
    flights = Flight(None, None, in_arrays)
    everything = _everything(measured, "funnels")
    return [
        Cost(
            "sums of squares by samples, stage by stage",
            _triangle(size) + 1,
            "Gram matrix of one stage, its bound",
            len(funnel.samples),
            conditions,
            len(funnel.bound),
            int(funnel.iterations.sum()),
            *_design(measured, "whole funnel by samples, rank-one"),
            flights,
            everything,
        ),
        Cost(
            "the same, levels proven",
            _triangle(proven.basis_size) + 1,
            "Gram matrix of one stage, its bound",
            proven.samples,
            conditions,
            len(proven.bound),
            None,
            *_design(measured, "proven funnel"),
            flights,
            everything,
        ),
    ]


def stochastic_entry(gains: StochasticEntryGains, measured: dict | None = None) -> list[Cost]:
    """The dual of covariance steering, for both triggers."""
    multipliers = gains.control_multiplier.shape[1] + gains.final_multiplier.shape[1]
    return [
        Cost(
            "dual of chance-constrained covariance steering",
            multipliers,
            "Lagrange multipliers",
            multipliers,
            "limits of control and final state",
            len(gains.iterations),
            int(gains.iterations.sum()),
            *_design(measured, "nominal, linear model and gains, compiled"),
            _flight(measured, "1,000 flights of stochastic_velocity with outputs"),
            _everything(measured, "stochastic_entry"),
        )
    ]


def figure(records: dict[str, list[Cost]]) -> Figure:
    """Size, design time, time of one flight and of everything, by method."""
    rows = [(slug, cost) for slug, costs in records.items() for cost in costs]
    chart, panels = new_figure(9.0, 1.2 + 0.5 * len(rows), ncols=4, sharey=True)
    quantities = (
        ("unknowns\n(hollow: conditions)", lambda cost: (cost.unknowns, cost.conditions)),
        ("design (s)", lambda cost: (cost.design,)),
        ("one flight (ms)\n(cross: in C, hollow: in array code)", lambda cost: cost.flight),
        ("whole paper (CPU s)", lambda cost: (cost.everything,)),
    )
    for panel, (axes, (title, numbers)) in enumerate(zip(panels, quantities, strict=True)):
        everything = []
        for height, (slug, cost) in enumerate(rows):
            if panel >= 2 and cost is not records[slug][0]:
                continue  # of the paper, not of the method
            if panel == FLIGHTS:
                number, in_c, *further_numbers = (1e3 * time if time else np.nan for time in numbers(cost))
                axes.plot(in_c, height, "x", color="black", markersize=5, zorder=3)
                everything.append(in_c)
            else:
                number, *further_numbers = numbers(cost)
            everything += [number, *further_numbers]
            axes.plot(number, height, "o", color=COLORS[slug])
            axes.plot(
                further_numbers,
                [height] * len(further_numbers),
                "o",
                color=COLORS[slug],
                markerfacecolor="none",
                markersize=9,
            )
            number = number if np.isfinite(number) else further_numbers[0]
            text = f"{number:,}" if isinstance(number, int) else f"{number:.3g}"
            axes.annotate(text, (number, height), (0, 6), textcoords="offset points", ha="center", fontsize=7)
        positive = [value for value in everything if value > 0]
        decades = np.floor(np.log10(min(positive))), np.ceil(np.log10(max(positive)))
        axes.set(xscale="log", xlabel=title, xlim=(0.7 * 10 ** decades[0], 1.4 * 10 ** decades[1]))
    names = [textwrap.fill(f"{NAMES[slug]}: {cost.method}", 34) for slug, cost in rows]
    panels[0].set_yticks(range(len(rows)), names)
    panels[0].set_ylim(len(rows) - 0.5, -0.6)
    return chart


def table(records: dict[str, list[Cost]]) -> "DataFrame":
    """The same as numbers, with what is counted."""
    rows = [
        (
            *(NAMES[slug], cost.method, cost.unknowns, cost.unknowns_are, cost.conditions, cost.conditions_are),
            *(cost.problems, cost.iterations, cost.design, cost.design_is),
            *(time and 1e3 * time for time in cost.flight),
            cost.everything,
        )
        for slug, costs in records.items()
        for cost in costs
    ]
    return table_of(
        rows,
        {
            "paper": Column(),
            "method": Column(),
            "unknowns": Column(meaning="of one problem"),
            "unknowns are": Column(),
            "conditions": Column(meaning="of one problem"),
            "conditions are": Column(),
            "problems": Column(),
            "iterations": Column(meaning="of all problems"),
            "design": Column("s", ".3g", "time of all that is designed"),
            "design is": Column(),
            "one flight": Column("ms", ".3g", "by the kernel, with its outputs and random numbers"),
            "in C": Column("ms", ".3g", "one flight, bit for bit the same, in strict C"),
            "in array code": Column("ms", ".3g", "one flight by the same scheme"),
            "whole paper": Column("CPU s", ".3g", "all that is made for the paper"),
        },
    )


def _triangle(size):
    """Entries of a symmetric matrix."""
    return size * (size + 1) // 2


def _run_time(run_times, quantity):
    """Return a run time by its name in the table of benchmarks."""
    if run_times is None or quantity not in run_times:
        raise InputError(f"data/reference/benchmarks.csv has no row '{quantity}'; restore it, or run 'make bench'")
    return run_times[quantity]


def _flight(run_times, label):
    """Times of a flight by the kernel, and in C and array code if these have been measured."""
    slower = [run_times.get(f"{how}, {label}") for how in ("strict C", "array code")] if run_times else [None, None]
    return Flight(MICRO * _run_time(run_times, f"kernel, {label}"), *(time and MICRO * time for time in slower))


def _design(run_times, quantity):
    return _run_time(run_times, quantity), quantity


def _everything(run_times, paper):
    return _run_time(run_times, f"snakemake {paper}, full size, from nothing")
