"""Gather what the report says from the catalogues, the readings and the product files."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication import artifacts
from marsedl.replication.catalogue import Paper, Stage
from marsedl.replication.claims import read_claims
from marsedl.replication.inputs import Inputs
from marsedl.replication.report import (
    CloseUp,
    Comparison,
    ErratumEntry,
    FigureEntry,
    InputEntry,
    InputValue,
    PaperReport,
    ReadingEntry,
    TableEntry,
)
from marsedl.replication.tables import read_table

LIBRARIES = (
    *("snakemake", "numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py", "pydantic", "matplotlib"),
    "pillow",
)
DEFAULT = "corrected"  # the reading that figures and close-ups show
MOST_POINTS = 2000  # of a scatter plot
MOST_FLIGHTS = 30  # in a funnel, each drawn at every so many of its steps:
FLIGHT_STEP = 4
REBUILD = (
    "make all",
    "snakemake figures/powered_descent/fig07.png",
    "snakemake --config size=smoke all",
    "make verify",
)
CITATION = "The marsedl developers: marsedl, replications of papers on Mars entry, descent and landing, version 0.1.0."


Paths = Mapping[str, Mapping[str, str]]  # files of the artifacts, by reading and name


def paper_report(
    catalogue: Paper,
    model: type[Inputs],
    readings: dict,
    claims: list[dict],
    paths: Paths,
    benchmarks: Sequence[Sequence[str]] = (),
) -> PaperReport:
    """Say all there is to say about one paper.

    Args:
        catalogue: its bill of materials.
        model: its typed inputs.
        readings: by name, summary, based_on, frozen, and inputs as [key, value as written, source].
        claims: its rows of verdicts.
        paths: its artifacts.
        benchmarks: measured run times of all papers, the first row the header.

    Raises:
        ArtifactError: an artifact is missing or damaged.

    """
    folder = Path("figures") / catalogue.slug
    captions = {stem: (product.caption, product.beyond) for stem, product in catalogue.tables.items()}
    captions |= {stem: (caption, True) for stem, caption in catalogue.summaries.items()}
    inputs = [
        InputEntry(
            name,
            model.unit(name),
            {reading: _value(name, *body["inputs"][name]) for reading, body in readings.items()},
            model.model_fields[name].description,
        )
        for name in model.model_fields
    ]
    shown = paths.get(DEFAULT, {})
    _, seed, _ = readings.get(DEFAULT, {"inputs": {}})["inputs"].get("seed", ("seed", "–", ""))
    return PaperReport(
        slug=catalogue.slug,
        title=catalogue.title,
        citation=catalogue.citation,
        claims=claims,
        readings=[
            ReadingEntry(name, body["summary"], body["based_on"], body["frozen"]) for name, body in readings.items()
        ],
        inputs=inputs,
        figures=[_figure(folder, stem, item.caption, item.beyond) for stem, item in catalogue.figures.items()],
        tables=[_table(folder, stem, *said) for stem, said in captions.items()],
        errata=[ErratumEntry(e.id, e.printed, e.evidence, e.used) for e in catalogue.errata],
        verdicts=f"report/claims/{catalogue.slug}.json",
        closeups=closeups(catalogue.slug, shown),
        run_times=run_times(benchmarks, [catalogue.slug]),
        solvers=solver_rows(paths),
        provenance=provenance_rows(shown, catalogue.stages, str(seed)),
    )


def comparison(products: Mapping[str, Any]) -> Comparison:
    """Say what is found by comparing the papers. products: by stem, with the captions `figure` and `table`."""
    folder = Path("figures") / "comparison"
    return Comparison(
        [_figure(folder, stem, product.figure) for stem, product in products.items()],
        [_table(folder, stem, product.table) for stem, product in products.items()],
    )


def _figure(folder: Path, stem: str, caption: str, beyond: bool = False) -> FigureEntry:
    image = folder / f"{stem}.png"
    return FigureEntry(stem, image, caption, caption, (f"{image}", f"{folder / stem}.pdf"), beyond)


def _table(folder: Path, stem: str, caption: str, beyond: bool = False) -> TableEntry:
    path = folder / f"{stem}.csv"
    return TableEntry(stem, caption, read_table(path), (f"{path}", f"{folder / stem}.md"), beyond)


def environment(size: str, digests: Path, benchmarks: Sequence[Sequence[str]], slugs: Iterable[str]) -> dict:
    """Say what holds for all papers: size, software, digests of the products, and measurements of no single paper."""
    return {
        "size": size,
        "citation": CITATION,
        "rebuild": list(REBUILD),
        "versions": artifacts.library_versions(*LIBRARIES),
        "digests": json.loads(digests.read_text(encoding="utf-8")),
        "benchmarks": run_times(benchmarks, {row[0] for row in benchmarks[1:]}.difference(slugs)),
    }


def measurements(path: Path) -> list[list[str]]:
    """The committed benchmark table, the first row its header; empty if nothing was measured."""
    return read_table(path) if path.exists() else []


def run_times(benchmarks: Sequence[Sequence[str]], papers: Iterable[str]) -> list[list[str]]:
    """The measurements of these papers, under a header without the column of the paper; empty if there are none."""
    papers = set(papers)
    rows = [list(row[1:]) for row in benchmarks[1:] if row[0] in papers]
    return [list(benchmarks[0][1:]), *rows] if rows else []


def solver_rows(paths: Paths) -> list[list[str]]:
    """How the iterative solvers of all readings ended: one row for each field that says so, the first row the header.

    A field `status` or `<what>_status` says in words how each solve ended; `converged` or `<what>_converged` whether.
    Fields `iterations` and `residual` of the same name say after how many steps, and with what error.
    """
    ended: dict[tuple[str, str], Counter] = {}
    where: dict[tuple[str, str], dict[str, set]] = {}
    steps: dict[tuple[str, str], list] = {}
    errors: dict[tuple[str, str], list] = {}
    for reading, files in paths.items():
        for name, path in files.items():
            for what, states, iterations, residual in _solves(Path(path)):
                key = (name, what)
                ended.setdefault(key, Counter()).update(states)
                for state in states:
                    where.setdefault(key, {}).setdefault(state, set()).add(reading)
                steps.setdefault(key, []).extend(iterations)
                errors.setdefault(key, []).extend(residual)
    if not ended:
        return []
    rows = [["stage", "solved", "how it ended, over all readings", "solves", "iterations", "largest residual"]]
    for key, states in ended.items():
        usual = states.most_common(1)[0][0]
        said = [f"{states[usual]} {usual}"]
        said += [
            f"{count} {state} ({', '.join(name for name in paths if name in where[key][state])})"
            for state, count in states.items()
            if state != usual
        ]
        least, most = (min(steps[key]), max(steps[key])) if steps[key] else (None, None)
        taken = "–" if least is None else f"{least:,}" if least == most else f"{least:,} to {most:,}"
        residual = f"{max(errors[key]):.1e}" if errors[key] else "–"
        rows.append([*key, "; ".join(said), f"{states.total():,}", taken, residual])
    return rows


def _solves(path: Path) -> list[tuple[str, list[str], list[int], list[float]]]:
    """What an artifact says of its solves: their name, how each ended, their numbers of iterations, their residuals."""
    found = []
    with artifacts.opened(path) as file:

        def values(*names):
            fields = [artifacts.read_array(path, file[name]).ravel() for name in names if name in file]
            return fields[0].tolist() if fields else []

        for name in sorted(file):
            prefix, _, last = name.rpartition("_")
            if last not in ("status", "converged") or (last == "converged" and file[name].dtype != bool):
                continue
            if last == "status":
                states = [value.decode() or "not solved" for value in values(name)]
            else:
                states = ["converged" if value else "not converged" for value in values(name)]
            beside = f"{prefix}_" if prefix else ""
            more = () if prefix else ("solver_iterations", "worst_residual")
            iterations = values(f"{beside}iterations", *more[:1])
            residuals = [value for value in values(f"{beside}residual", *more[1:]) if math.isfinite(value)]
            found.append((prefix.replace("_", " ") or path.stem, states, iterations, residuals))
    return found


def provenance_rows(files: Mapping[str, str], stages: Mapping[str, Stage], seed: str) -> list[list[str]]:
    """What each artifact was made from, the first row the header: other artifacts, a seed, and code by its digest.

    Trials of a Monte Carlo case are scattered into any number of jobs, and its own provenance speaks of these: what
    stands here are the needs of its stage and the `seed` of the reading.
    """
    if not files:
        return []
    rows = [["artifact", "meaning", "made from", "seed", "digests of script and code"]]
    for name, path in files.items():
        with artifacts.opened(path) as file:
            meaning = file.attrs["meaning"]
        if name in stages:
            kept = artifacts.provenance(path)
            sources, drawn, code = kept["made_from"], str(kept["inputs"].get("seed", "–")), kept["code"]
        else:
            sources, drawn, code = [f"{need}.h5" for need in stages["montecarlo"].needs], seed, "–"
        made_from = ", ".join(Path(source).stem for source in sorted(sources)) or "inputs alone"
        rows.append([name, meaning, made_from, drawn, code])
    return rows


def claims_by_paper(path: Path) -> dict[str, list[dict]]:
    """Read the joined claims, by paper."""
    by_paper: dict[str, list[dict]] = {}
    for row in read_claims(path):
        by_paper.setdefault(row["paper"], []).append(row)
    return by_paper


def closeups(slug: str, files: Mapping[str, str]) -> list[CloseUp]:
    """The plots of a paper that a reader can look into, from its artifacts; without one whose artifacts are not built.

    Args:
        slug: the paper.
        files: the artifacts of the reading that is shown, by name.

    Raises:
        ArtifactError: an artifact is damaged or lacks a field of `CLOSEUP_FIELDS`.

    """
    drawn = []
    for draw, needs in CLOSEUP_FIELDS.get(slug, {}).items():
        if all(name in files for name in needs):
            drawn.append(draw({name: _fields(Path(files[name]), fields) for name, fields in needs.items()}))
    return drawn


Fields = Mapping[str, Mapping[str, np.ndarray]]  # values by artifact and name of the field


def _fields(path: Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Read some fields of an artifact without its type, which only the paper knows."""
    with artifacts.opened(path) as file:
        arrays = {name: artifacts.read_array(path, artifacts.member(path, file, name, h5py.Dataset)) for name in names}
    return {
        name: np.char.decode(array, "utf-8") if array.dtype.kind == "S" else array for name, array in arrays.items()
    }


def _final_states(found: Fields) -> CloseUp:
    """Final states of the powered descent against the covariance of the design."""
    design = found["gains"]
    cases = []
    for case, name, predicted in (("closed_loop", "with feedback", True), ("open_loop", "without feedback", False)):
        flown = found[case]
        ellipses = [_ellipse("of the trials", flown["mean"][-1, :4], flown["covariance"][-1, :4, :4])]
        if predicted:
            ellipses.insert(0, _ellipse("predicted by the design", design["mean"][-1], design["covariance"][-1]))
        cases.append(
            {
                "name": name,
                "points": _rounded(flown["final_state"][:MOST_POINTS, :4], axis=0),
                "ellipses": ellipses,
                "replay": f"marsedl trial powered_descent {DEFAULT} {case}",
            }
        )
    return CloseUp(
        "final_states",
        "Final states of the trials",
        "Each point is the state in which one Monte Carlo flight of the nonlinear plant ends. The dashed ellipse is the"
        " covariance that the linear design predicts, the solid one that of the trials: where they coincide, the design"
        " keeps its promise. It promises nothing for flights without feedback.",
        "scatter",
        {
            "axes": [
                {"name": "downrange", "unit": "m"},
                {"name": "altitude", "unit": "m"},
                {"name": "downrange velocity", "unit": "m/s"},
                {"name": "vertical velocity", "unit": "m/s"},
            ],
            "cases": cases,
        },
    )


def _ellipse(name: str, mean: np.ndarray, covariance: np.ndarray) -> dict:
    return {"name": name, "mean": _rounded(mean), "covariance": _rounded(covariance, digits=6)}


def _funnel_of_the_car(found: Fields) -> CloseUp:
    """Slices of both funnels of the Dubins car, with flights inside."""
    car = found["dubins"]
    unit = np.array([1.0, 1.0, math.pi / 180.0])
    path, funnels = car["state"][::2], list(car["funnel"])
    cases = []
    for funnel, flights, name in (("flow", "dubins_calm", "without wind"), ("wind", "dubins_wind", "in wind")):
        level = car["level"][funnels.index(funnel)]
        # {1/2 x'P x <= level} is the image of the unit ball under this matrix
        half_axes = [
            math.sqrt(2.0 * rho) * np.linalg.inv(np.linalg.cholesky(car["shape"][step])).T / unit[:, np.newaxis]
            for rho, step in zip(level, car["slice_step"], strict=True)
        ]
        flown = (path + found[flights]["kept_history"][:MOST_FLIGHTS])[:, ::FLIGHT_STEP] / unit
        cases.append({"name": name, "half_axes": _rounded(np.array(half_axes)), "flights": _rounded(flown)})
    return CloseUp(
        "funnel",
        "Funnel of the Dubins car",
        "The funnel in x, y and heading, which a flat picture cannot show. Each outline is one of its slices, an"
        " ellipsoid around the nominal path, which is the thick line; thin lines are flights of the car under its"
        " feedback. The slice under the slider is drawn strong, with its largest deviations beside it.",
        "tube",
        {
            "axes": [{"name": "x", "unit": "m"}, {"name": "y", "unit": "m"}, {"name": "heading", "unit": "°"}],
            "time": _rounded(car["slice_time"]),
            "centre": _rounded(path[car["slice_step"]] / unit),
            "cases": cases,
        },
    )


def _iterations(found: Fields) -> CloseUp:
    """Iteration histories of the successive convexification."""
    history = found["convergence"]
    series = [
        f"{variant.replace('_', ' ')}: {outcome}" + (f" with period {period}" if period > 1 else "")
        for variant, outcome, period in zip(history["variant"], history["outcome"], history["period"], strict=True)
    ]
    quantities = [
        {"name": name, "unit": unit, "values": _rounded(history[field])}
        | ({"errors": _rounded(history[error], digits=3)} if error else {})
        for field, error, name, unit in (
            ("percentile", "percentile_error", "99th percentile of Δv, flown", "m/s"),
            ("predicted", "", "99th percentile of Δv, predicted", "m/s"),
            ("apoapsis", "", "apoapsis of the nominal", "planet radii"),
            ("nominal_delta_v", "", "Δv of the nominal", "m/s"),
            ("control_change", "", "largest change of the mean control", ""),
        )
    ]
    return CloseUp(
        "iterations",
        "Histories of the iteration",
        "What each pass of the successive convexification arrives at, over more passes than the paper has. Compare the"
        " percentile of the velocity change Δv that the flights need with the one that the program predicts. Bars are"
        " three standard errors; iteration 0 is the initial guess without feedback.",
        "histories",
        {"steps": "iteration", "series": series, "quantities": quantities},
    )


# The plots by paper, with the fields that they draw of each artifact.
CLOSEUP_FIELDS: dict[str, dict[Callable[[Fields], CloseUp], dict[str, tuple[str, ...]]]] = {
    "powered_descent": {
        _final_states: {
            "gains": ("mean", "covariance"),
            "closed_loop": ("final_state", "mean", "covariance"),
            "open_loop": ("final_state", "mean", "covariance"),
        }
    },
    "random_field": {
        _iterations: {
            "convergence": (
                *("variant", "outcome", "period", "percentile", "percentile_error", "predicted", "apoapsis"),
                *("nominal_delta_v", "control_change"),
            )
        }
    },
    "funnels": {
        _funnel_of_the_car: {
            "dubins": ("state", "funnel", "level", "shape", "slice_step", "slice_time"),
            "dubins_calm": ("kept_history",),
            "dubins_wind": ("kept_history",),
        }
    },
}


def _rounded(values: np.ndarray, axis: int | None = None, digits: int = 4) -> list:
    """Round to so many digits of the range, which is as much as a screen shows; nan becomes None.

    axis: along which the range is taken, of all values together by default.
    """
    values = np.asarray(values, float)
    with np.errstate(invalid="ignore"):
        least, most = np.nanmin(values, axis=axis, initial=np.inf), np.nanmax(values, axis=axis, initial=-np.inf)
    span = np.where(most > least, most - least, np.where(np.isfinite(most) & (most != 0.0), np.abs(most), 1.0))
    decimals = np.broadcast_to(digits - np.floor(np.log10(span)).astype(int), values.shape)
    return _nested(
        [
            round(v, int(d)) + 0.0 if math.isfinite(v) else None
            for v, d in zip(values.ravel().tolist(), decimals.flat, strict=True)
        ],
        values.shape,
    )


def _nested(flat: list, shape: tuple[int, ...]) -> list:
    """Fold a flat list into lists of this shape."""
    for extent in reversed(shape[1:]):
        flat = [flat[i : i + extent] for i in range(0, len(flat), extent)]
    return flat


def _value(name, key, written, source) -> InputValue:
    """An input as it is written; with its suffix if it has one."""
    suffix = key.removeprefix(name).removeprefix("_")
    shown = "–" if written is None else json.dumps(written) if isinstance(written, list) else str(written)
    return InputValue(f"{shown} {suffix}".strip(), source)
