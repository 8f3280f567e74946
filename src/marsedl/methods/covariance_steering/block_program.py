r"""Chance-constrained covariance steering under correlated disturbances as one cone program (random field, Eq. 56).

The paper optimizes over L = K (I - B K)^-1 and needs a root of S = A P_0 A' + G Cov(W) G'. The form used here optimizes
over the response of the controls to the innovations: with a block-causal root of blockdiag(P_0, Cov(W)) = M M',

    $(\tilde{x}_0, \tilde{W}) = M z, \quad z \sim N(0, I), \quad \tilde{U} = Y z, \quad \tilde{X} = (Z + B Y) z,
      \quad Z = [A \; G] M$

where row block k of Y may use the innovations of x_0, w_0, ..., w_{k-1} only. The optimum is the same, L S^1/2 and Y
being equal but for a rotation, yet there are fewer unknowns, none of them multiplies a zero, and no ill-conditioned
root enters.

The quadratic cost of a column of Y involves its causal rows only, which are trailing rows. So one triangular factor
F'F = B'QB + R, taken from the last control to the first, completes the squares of all columns: the cost is a constant
plus |T|^2 for T = F Y + H. T is as causal as Y and the unknown of the cone program; without constraints it is zero.
"""

from typing import NamedTuple

import numpy as np

from marsedl.methods import conic
from marsedl.methods.checks import require_one_of
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.history_feedback import feedback_gain, history_program
from marsedl.methods.covariance_steering.steering_program import (
    BlockSystem,
    HalfPlane,
    Margin,
    Percentile,
    Stacked,
    SteeringLaw,
    SteeringProgram,
    TrustRegion,
    closed_loop,
    diagonal_blocks,
    margins,
    stacked,
)
from marsedl.summaries import summary

__all__ = [
    "BlockSystem",
    "CausalRoot",
    "HalfPlane",
    "IllConditionedError",
    "InfeasibleProgram",
    "Margin",
    "Percentile",
    "Stacked",
    "SteeringLaw",
    "SteeringProgram",
    "TrustRegion",
    "causal_root",
    "closed_loop",
    "margins",
    "solve",
    "stacked",
]

# Condition number of Cov(W) beyond which the disturbances are so predictable that gains have no bound in practice.
_WORST_CONDITION = 1e12
# Gains, in units in which everything is of order one, beyond which a law answers rounding errors.
_LARGEST_GAIN = 1e8
# Ratio of the curvatures of the cost by two controls below which its squares are not completed.
_LEAST_CURVATURE = 1e-7
# Cones that are given to CVXPY as one matrix.
_CONES_TOGETHER = 8
# What Clarabel and SCS are asked for, of the scaled program, unless the caller says otherwise.
_ASKED = {"CLARABEL": conic.Accuracy(1e-9, 1e-8), "SCS": conic.Accuracy(1e-9, 1e-9)}
# What is enough of that where rounding allows no more.
_ENOUGH = conic.Accuracy(1e-8, 1e-7)
# Clarabel's own scaling costs iterations where ours is good. Near the optimum its large cones can lose accuracy as
# steps come too close to their boundary, so a second attempt keeps more distance.
_SETTINGS = {
    "CLARABEL": tuple(
        {"equilibrate_enable": own_scaling, "max_step_fraction": fraction}
        for own_scaling, fraction in ((False, 0.95), (False, 0.8), (True, 0.9))
    ),
    "SCS": ({"max_iters": 200_000},),
}
# Excess of a constraint, over its size, that is not rounding.
_VIOLATED = 1e-6


class IllConditionedError(ValueError):
    """The disturbances are almost exactly predictable from their past, so that the program buys unbounded gains."""


class InfeasibleProgram(ValueError):
    """No feedback meets all constraints; the message names those that fail and by how much.

    Where it could be found, `law` is the one that violates the constraints least in sum, and `margins` are all of its.
    """

    law: SteeringLaw | None = None
    margins: tuple[Margin, ...] = ()


class CausalRoot(NamedTuple):
    """Block-causal square root of the covariance of the stacked vector [x_0; w_0; ...; w_{N-1}]."""

    factor: np.ndarray  # M, ((N + 1) n, r)
    whitening: np.ndarray  # its left inverse, (r, (N + 1) n)
    block: np.ndarray  # block that an innovation belongs to: 0 for x_0, k + 1 for w_k, (r,)
    condition: float  # ratio of the largest to the smallest eigenvalue of the rows of W, those dropped left out

    __repr__ = summary


def causal_root(system, pivot_tolerance=1e-14):
    """Factor blockdiag(P_0, Cov(W)) = M M' so that block k uses the innovations of blocks 0, ..., k only.

    Block by block: covariance given the past, its eigenvectors, and one innovation for every direction that the past
    does not determine.

    Args:
        system: `BlockSystem`.
        pivot_tolerance: directions whose variance given the past is below this fraction of the variances of their
            components are taken as determined by the past, and get no innovation.

    Returns:
        `CausalRoot`.
    """
    intervals, n, _ = np.shape(system.control)
    size = (intervals + 1) * n
    covariance = np.zeros((size, size))
    covariance[:n, :n], covariance[n:, n:] = system.initial_covariance, system.disturbance_covariance
    factor, whitening, block = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size, dtype=int)
    rank = 0
    for k in range(intervals + 1):
        rows, past = slice(k * n, (k + 1) * n), slice(0, k * n)
        from_past = covariance[rows, past] @ whitening[:rank, past].T
        own_covariance = covariance[rows, rows]
        deviation = np.sqrt(np.maximum(np.diag(own_covariance), 0))
        # Fractions of the components' own variances do not depend on their units.
        unit = np.where(deviation > 0, deviation, 1.0)
        pivots, directions = np.linalg.eigh((own_covariance - from_past @ from_past.T) / np.outer(unit, unit))
        informative = pivots > pivot_tolerance
        new = slice(rank, rank + np.count_nonzero(informative))
        root = np.sqrt(pivots[informative])
        factor[rows, :rank] = from_past
        factor[rows, new] = directions[:, informative] * root * unit[:, None]
        inverse = directions[:, informative].T / root[:, None] / unit
        whitening[new, rows] = inverse
        whitening[new, past] = -inverse @ from_past @ whitening[:rank, past]
        block[new] = k
        rank = new.stop
    factor, whitening, block = factor[:, :rank], whitening[:rank], block[:rank]
    spread = np.linalg.svd(factor[n:, block > 0], compute_uv=False)
    condition = float((spread[0] / spread[-1]) ** 2) if spread.size else 1.0
    return CausalRoot(factor, whitening, block, condition)


def solve(
    program,
    *,
    form="innovations",
    solver="CLARABEL",
    tolerance=None,
    accept_inaccurate=False,
    accept_ill_conditioned=False,
):
    """Solve the covariance steering program (random field, Eq. 56).

    Args:
        program: `SteeringProgram`.
        form: "innovations", or "history": Eq. 56 as it is printed, with the unknown L (slow, an oracle).
        solver: "CLARABEL", or "SCS" for a second opinion.
        tolerance: of gap and residuals of the scaled program; None: for Clarabel a gap of 1e-9 and residuals of 1e-8,
            1e-9 for SCS; 1e-8 and 1e-7 are accepted where rounding allows no more.
        accept_inaccurate: take a solution of less accuracy.
        accept_ill_conditioned: solve even if Cov(W) is so ill-conditioned that gains have no bound in practice.

    Returns:
        `SteeringLaw`; its status is the solver's, and `accepted_by` says by which rule the solution counts.

    Raises:
        IllConditionedError: if the condition number of Cov(W) exceeds 1e12, or the gains exceed 1e8.
        InfeasibleProgram: if the constraints cannot be met, with those that fail and by how much.
        RuntimeError: if no attempt gives a solution that is accepted.
        ValueError: if form or solver are unknown.
    """
    require_one_of("solver", solver, conic.SOLVERS)
    require_one_of("form", form, ("innovations", "history"))
    model = _assemble(program, accept_ill_conditioned)
    cone_program = _build(model) if form == "innovations" else _build_history(model)
    asked = _ASKED[solver] if tolerance is None else conic.Accuracy(tolerance, tolerance)
    outcome = conic.solve(
        cone_program.problem,
        solver=solver,
        asked=asked,
        settings=_SETTINGS[solver],
        enough=_ENOUGH if tolerance is None else None,
        accept_inaccurate=accept_inaccurate,
    )
    if outcome.status in ("infeasible", "infeasible_inaccurate"):
        raise _infeasible(model, outcome)
    if not outcome.accepted_by:
        advice = {
            "optimal_inaccurate": "; a looser tolerance or accept_inaccurate=True takes its solution",
            "unbounded": "; limit the mean control by its weight or its trust region",
        }.get(outcome.status, "")
        raise RuntimeError(f"covariance steering program: {outcome.sentence}{advice}")
    law = cone_program.law(outcome)
    if law.largest_gain > _LARGEST_GAIN and not accept_ill_conditioned:
        raise IllConditionedError(
            f"the largest gain is {law.largest_gain:.2g}, more than {_LARGEST_GAIN:.0e}: the disturbances are almost "
            f"exactly predictable from the states, though the condition number of Cov(W) is {law.condition:.2g}; add "
            "independent noise to the disturbance covariance, or pass accept_ill_conditioned=True"
        )
    return law


class _Model(NamedTuple):
    """A program in the unknowns V and T, in units in which everything is of order one."""

    program: SteeringProgram
    whole: Stacked
    root: CausalRoot
    open_loop: np.ndarray  # Z, ((N + 1) n, r)
    mean: np.ndarray  # without control, ((N + 1) n,)
    control_unit: float
    cost_unit: float
    causal: np.ndarray  # which entries of Y and T are unknown, (N m, r)
    inverse_factor: np.ndarray  # Y = inverse_factor @ (T - shift), in units of the control, (N m, N m)
    shift: np.ndarray  # (N m, r)
    steps: list  # of the distinct deviations that are constrained or cost something
    deviation: list  # which of these every half plane has, then every percentile
    data: dict  # arrays of the cone program


class _ConeProgram(NamedTuple):
    """A problem of CVXPY, and a function that makes a law of its solution."""

    problem: object
    law: object  # of the solver's `Outcome`


class _Effects(NamedTuple):
    """What acts on the states, by node: x_k = mean_k + control_k V + (open_loop_k + control_k Y) z."""

    control: np.ndarray  # (N + 1, n, N m), of a control in its unit
    open_loop: np.ndarray  # (N + 1, n, r)
    mean: np.ndarray  # (N + 1, n)


def _assemble(program, accept_ill_conditioned):
    """Scale the program and reduce it to the arrays that the cone program consists of."""
    system = program.system
    intervals, n, m = system.control.shape
    blocks, root = stacked(system), causal_root(system)
    if root.condition > _WORST_CONDITION and not accept_ill_conditioned:
        raise IllConditionedError(
            f"Cov(W) has the condition number {root.condition:.2g}, more than {_WORST_CONDITION:.0e}: the disturbances "
            "are almost exactly predictable from the states, and the optimal gains are of no use; add independent "
            "noise to the disturbance covariance, or pass accept_ill_conditioned=True"
        )
    open_loop = np.hstack([blocks.transition, blocks.disturbance]) @ root.factor
    mean = blocks.transition @ system.initial_mean + blocks.affine
    causal = np.arange(intervals).repeat(m)[:, None] >= root.block
    unit = _control_unit(program, blocks.control[-n:], open_loop[-n:])
    effects = _Effects(
        (blocks.control * unit).reshape(intervals + 1, n, -1),
        open_loop.reshape(intervals + 1, n, -1),
        mean.reshape(intervals + 1, n),
    )

    factor, offset, mean_factor, mean_offset = _quadratic_cost(program, effects, unit)
    offset = np.where(causal, offset, 0.0)
    spread = max((_spread(item, effects) for item in _weighed(program)), default=0.0)
    cost_unit = np.sum(offset**2) + np.sum(factor**2) / intervals + np.sum(mean_offset**2)
    cost_unit = float(cost_unit + program.percentile_weight * spread) or 1.0
    factor, offset, mean_factor, mean_offset = (
        array / np.sqrt(cost_unit) for array in (factor, offset, mean_factor, mean_offset)
    )
    data = {}
    if mean_factor.any():
        data |= {"mean_factor": mean_factor, "mean_offset": mean_offset}
    size = np.abs(np.diag(factor))
    if size.min() > _LEAST_CURVATURE * size.max():
        inverse_factor, shift = np.tril(np.linalg.inv(factor)), offset
    else:
        # Some control is nearly free: T = Y.
        inverse_factor, shift = np.eye(intervals * m), np.zeros(causal.shape)
        data |= {"cost_factor": factor, "cost_offset": offset[causal]}

    rows, index, size, deviations = _deviations(program, effects, inverse_factor, shift)
    planes = len(program.state_constraints) + len(program.control_constraints)
    data |= deviations
    data |= _half_planes(program, effects, size[index[:planes]], unit)
    data |= _final_conditions(program, effects, inverse_factor, shift, root.block < intervals)
    data |= _trust_regions(program, effects, unit)
    data |= _percentiles(program, effects, size[index[planes:]], unit, cost_unit)
    return _Model(
        program=program,
        whole=blocks,
        root=root,
        open_loop=open_loop,
        mean=mean,
        control_unit=unit,
        cost_unit=cost_unit,
        causal=causal,
        inverse_factor=inverse_factor,
        shift=shift,
        steps=[step for _, step, _ in rows],
        deviation=index,
        data=data,
    )


def _control_unit(program, effect, deviation):
    """The control that takes back the open-loop deviation at the end."""
    size = np.linalg.norm(effect)
    unit = np.linalg.norm(deviation) / size if size > 0 else 0.0
    return float(unit or program.control_trust or 1.0)


def _quadratic_cost(program, effects, unit):
    """The quadratic costs as |factor Y + offset|^2, over causal entries, and |mean_factor V + mean_offset|^2.

    J_1 (random field, Eq. 49) is larger by a constant. With weights Q = C'C, R = D'D and [C B; D] = O F, where F
    is lower triangular and O'O = I, the residual of a column of Y, which has trailing entries only, is the part of
    F Y + O' [C Z; 0] in the same rows; the rest does not depend on Y.
    """
    intervals, n, count = effects.control[:-1].shape
    state_root = _roots(program.state_weight)
    weighted = (state_root @ effects.control[:-1]).reshape(intervals * n, count)
    disturbed = (state_root @ effects.open_loop[:-1]).reshape(intervals * n, effects.open_loop.shape[2])
    effort = _block_diagonal(_roots(program.control_weight)) * unit
    orthogonal, triangular = np.linalg.qr(np.vstack([weighted, effort])[:, ::-1])
    factor, offset = triangular[::-1, ::-1], orthogonal[: intervals * n, ::-1].T @ disturbed

    effort = _block_diagonal(_roots(program.mean_control_weight)) * unit
    if program.desired_state is None:
        return factor, offset, np.linalg.qr(effort)[1], np.zeros(count)
    error = np.einsum("kij,kj->ki", state_root, (effects.mean - program.desired_state)[:-1]).ravel()
    orthogonal, mean_factor = np.linalg.qr(np.vstack([weighted, effort]))
    return factor, offset, mean_factor, orthogonal[: intervals * n].T @ error


def _deviations(program, effects, inverse_factor, shift):
    """Rows whose standard deviations are constrained or cost something.

    Returns:
        The distinct rows as (kind, step, unit vector); for every half plane and percentile the index of its row; the
        scales of the rows (k,); and the data by which |weights T + offsets| is the deviation over the scale.
    """
    last, count = len(effects.control) - 1, effects.control.shape[2]
    directions = [("state", item.step, item.normal) for item in program.state_constraints]
    directions += [("control", item.step, item.normal) for item in program.control_constraints]
    directions += [("state", last, item.gradient) for item in _weighed(program)]
    rows, index = _distinct(directions)
    if not rows:
        return rows, index, np.zeros(0), {}
    weights, offsets = np.zeros((len(rows), count)), np.zeros((len(rows), shift.shape[1]))
    for i, (kind, step, direction) in enumerate(rows):
        if kind == "state":
            weights[i], offsets[i] = direction @ effects.control[step], direction @ effects.open_loop[step]
        else:
            weights[i, step * len(direction) : (step + 1) * len(direction)] = direction
    weights = weights @ inverse_factor
    offsets -= weights @ shift
    size = _nonzero(np.maximum(np.linalg.norm(weights, axis=1), np.linalg.norm(offsets, axis=1)))
    data = {"deviation_weights": weights / size[:, None], "deviation_offsets": offsets / size[:, None]}
    return rows, index, size, data


def _half_planes(program, effects, size, unit):
    """rows V + factor * deviation <= margin (random field, Eqs. 44 and 45)."""
    items = program.state_constraints + program.control_constraints
    if not items:
        return {}
    normals, margin = np.zeros((len(items), effects.control.shape[2])), np.zeros(len(items))
    for i, item in enumerate(items):
        if i < len(program.state_constraints):
            normals[i] = item.normal @ effects.control[item.step]
            margin[i] = item.bound - item.normal @ effects.mean[item.step]
        else:
            m = len(item.normal)
            normals[i, item.step * m : (item.step + 1) * m] = item.normal
            margin[i] = item.bound / unit
    length = np.array([np.linalg.norm(item.normal) for item in items])
    factor = upper_quantile([item.probability for item in items]) * length * size
    scale = np.maximum(np.maximum(factor, np.abs(margin)), np.linalg.norm(normals, axis=1))
    return {"plane_rows": normals / scale[:, None], "plane_factor": factor / scale, "plane_margin": margin / scale}


def _final_conditions(program, effects, inverse_factor, shift, before_last):
    """rows V = margin (random field, Eq. 46), and the matrix weights T + offsets of Eq. 48.

    The columns of innovations that come after the last control are a constant; `known` marks the others.
    """
    data, control = {}, effects.control[-1]
    if program.final_mean is not None:
        known = ~np.isnan(program.final_mean)
        scale = _nonzero(np.linalg.norm(control[known], axis=1))
        data["final_rows"] = control[known] / scale[:, None]
        data["final_margin"] = (program.final_mean - effects.mean[-1])[known] / scale
    if program.final_covariance is not None:
        values, vectors = np.linalg.eigh(program.final_covariance)
        inverse_root = (vectors / np.sqrt(values)) @ vectors.T
        weights = inverse_root @ control @ inverse_factor
        offsets = inverse_root @ effects.open_loop[-1] - weights @ shift
        data["final_weights"], data["final_offsets"] = weights, offsets[:, before_last]
        data["final_remainder"] = np.eye(len(values)) - offsets[:, ~before_last] @ offsets[:, ~before_last].T
    return data


def _trust_regions(program, effects, unit):
    """|V - centre| <= radius (random field, Eq. 54), and |rows V - centre| <= radius of the states (Eq. 55)."""
    data = {}
    if program.control_trust is not None:
        data["trust_centre"] = _reference(program) / unit
        data["trust_radius"] = np.array(program.control_trust / unit)
    if program.state_trust:
        rows = np.array([item.row @ effects.control[item.step] for item in program.state_trust])
        centre = np.array([item.reference - item.row @ effects.mean[item.step] for item in program.state_trust])
        radius = np.array([item.radius for item in program.state_trust])
        scale = _nonzero(np.linalg.norm(rows, axis=1))
        data["state_trust_rows"] = rows / scale[:, None]
        data["state_trust_centre"], data["state_trust_radius"] = centre / scale, radius / scale
    return data


def _percentiles(program, effects, size, unit, cost_unit):
    """rows V + level + factor * deviation <= the largest percentile, which costs its price (random field, Eq. 53)."""
    items = _weighed(program)
    if not items:
        return {}
    gradients = np.array([item.gradient for item in items])
    rows = gradients @ effects.control[-1]
    factor = upper_quantile([item.probability for item in items]) * np.linalg.norm(gradients, axis=1) * size
    level = gradients @ effects.mean[-1] + [item.offset for item in items]
    scale = float(np.maximum(factor, np.linalg.norm(rows, axis=1)).max()) or 1.0
    # A constant of all levels does not matter, and what is large cannot be resolved.
    level -= np.max(level + rows @ _reference(program) / unit)
    return {
        "percentile_rows": rows / scale,
        "percentile_factor": factor / scale,
        "percentile_level": level / scale,
        "percentile_price": np.array(program.percentile_weight * scale / cost_unit),
    }


def _weighed(program):
    """The percentiles that cost something."""
    return program.percentiles if program.percentile_weight > 0 else ()


def _spread(percentile, effects):
    """Distance of a percentile from its mean without control."""
    return float(upper_quantile(percentile.probability) * np.linalg.norm(percentile.gradient @ effects.open_loop[-1]))


def _reference(program):
    """Centre of the controls' trust region, (N m,)."""
    intervals, _, m = program.system.control.shape
    return np.zeros(intervals * m) if program.control_reference is None else program.control_reference.ravel()


def _build(model, relaxed=False):
    """The cone program in CVXPY.

    Cones of different length are given to CVXPY in matrices, the shorter ones filled up with zeros: large matrices are
    translated fast, small ones solved fast. A relaxed program minimizes the sum of the violations of its constraints.
    """
    import cvxpy

    causal, data = model.causal, model.data
    intervals, _, m = model.program.system.control.shape
    mean_control, unknown, response = cvxpy.Variable(intervals * m), None, None
    constraints, violations, cost = [], [], 0.0
    if "mean_factor" in data:
        cost += cvxpy.sum_squares(data["mean_factor"] @ mean_control + data["mean_offset"])
    if causal.any():
        unknown = cvxpy.Variable(np.count_nonzero(causal))
        scatter = _scatter(causal)
        response = cvxpy.reshape(scatter @ unknown, causal.shape, order="C")  # T
        if "cost_factor" in data:
            squares = scatter.T @ cvxpy.vec(data["cost_factor"] @ response, order="C") + data["cost_offset"]
            cost += cvxpy.sum_squares(squares)
        else:
            cost += cvxpy.sum_squares(unknown)

    def slack(*shape):
        """Violations of constraints, or none."""
        if not relaxed:
            return 0.0
        violations.append(cvxpy.Variable(shape, nonneg=True))
        return violations[-1]

    count = len(model.steps)
    if count:
        deviation = cvxpy.Variable(count)
        for first in range(0, count, _CONES_TOGETHER):
            group = slice(first, min(first + _CONES_TOGETHER, count))
            last = model.steps[group.stop - 1]
            visible, used = int(np.count_nonzero(model.root.block <= last)), min(last + 1, intervals) * m
            if visible == 0:
                constraints.append(deviation[group] >= 0)
                continue
            response_root = cvxpy.Constant(0.0) + data["deviation_offsets"][group, :visible]
            if response is not None:
                response_root = response_root + data["deviation_weights"][group, :used] @ response[:used, :visible]
            constraints.append(cvxpy.SOC(deviation[group], response_root, axis=1))
    planes = len(model.program.state_constraints) + len(model.program.control_constraints)
    if planes:
        spread = cvxpy.multiply(data["plane_factor"], deviation[model.deviation[:planes]])
        constraints.append(data["plane_rows"] @ mean_control + spread <= data["plane_margin"] + slack(planes))
    if "final_rows" in data:
        distance = data["final_rows"] @ mean_control - data["final_margin"]
        constraints.append(cvxpy.abs(distance) <= slack(distance.size) if relaxed else distance == 0)
    if "final_weights" in data:
        constraints += _final_covariance(model, response, slack())
    if "trust_centre" in data:
        distance = mean_control - data["trust_centre"]
        radius = data["trust_radius"] + slack()
        constraints += [distance <= radius, -distance <= radius]
    if "state_trust_rows" in data:
        distance = data["state_trust_rows"] @ mean_control - data["state_trust_centre"]
        radius = data["state_trust_radius"] + slack(len(model.program.state_trust))
        constraints += [distance <= radius, -distance <= radius]
    if "percentile_rows" in data:
        largest = cvxpy.Variable()
        spread = cvxpy.multiply(data["percentile_factor"], deviation[model.deviation[planes:]])
        constraints.append(data["percentile_rows"] @ mean_control + data["percentile_level"] + spread <= largest)
        cost += data["percentile_price"] * largest
    if relaxed:
        cost = sum(cvxpy.sum(violation) for violation in violations)
        # Else what no constraint is about could take any value.
        cost += _VIOLATED**2 * sum(
            cvxpy.sum_squares(variable) for variable in (mean_control, unknown) if variable is not None
        )

    def law(outcome):
        transformed = np.zeros(causal.shape)
        if unknown is not None:
            transformed[causal] = _solution(unknown)
        effect = model.inverse_factor @ (transformed - model.shift)
        response = np.where(causal, effect, 0.0) * model.control_unit
        return _law_of_response(model, _solution(mean_control) * model.control_unit, response, outcome)

    return _ConeProgram(cvxpy.Problem(cvxpy.Minimize(cost), constraints), law)


def _final_covariance(model, response, slack):
    """F F' <= I (random field, Eq. 48) for F = P_f^-1/2 E_N (Z + B Y), innovation block by innovation block.

    The matrix [I F; F' I] has the shape of an arrow, so it is positive semidefinite if and only if there are M_b with
    [M_b F_b; F_b' I] >= 0 and sum_b M_b <= I: one small cone for each block instead of a single large one.
    """
    import cvxpy

    (intervals, n, _), data = model.program.system.control.shape, model.data
    ends = np.cumsum(np.bincount(model.root.block, minlength=intervals + 1))[:intervals]
    remainder = data["final_remainder"] + slack * np.eye(n)
    final_root = (
        data["final_offsets"]
        if response is None
        else data["final_offsets"] + data["final_weights"] @ response[:, : ends[-1]]
    )
    constraints = []
    for start, end in zip([0, *ends[:-1]], ends, strict=True):
        if end > start:
            share, part = cvxpy.Variable((n, n), symmetric=True), final_root[:, start:end]
            constraints.append(cvxpy.bmat([[share, part], [part.T, np.eye(end - start)]]) >> 0)
            remainder = remainder - share
    return [*constraints, cvxpy.Constant(0) + remainder >> 0]


def _build_history(model):
    """The program in the unknown of the paper."""
    problem, mean_control, history, covariance = history_program(model.program, model.cost_unit)

    def law(outcome):
        deviation = np.eye(len(covariance)) + model.whole.control @ history.value
        states = deviation @ covariance @ deviation.T
        controls = history.value @ covariance @ history.value.T
        return _law(model, _solution(mean_control), history.value, states, controls, outcome)

    return _ConeProgram(problem, law)


def _infeasible(model, outcome):
    """The error that names the constraints that fail if all may be violated, by as little as possible in sum."""
    elastic = _build(model, relaxed=True)
    least = conic.solve(elastic.problem, asked=_ASKED["CLARABEL"], settings=_SETTINGS["CLARABEL"], enough=_ENOUGH)
    sentence = "the constraints cannot be met together"
    if not least.accepted_by:
        return InfeasibleProgram(f"{sentence} ({outcome.sentence})")
    law = elastic.law(least)
    every = margins(model.program, law)
    failed = [margin for margin in every if margin.excess > _VIOLATED]
    words = "the least reachable " if len(failed) == 1 else ""
    named = (f"{m.name}: {words}{m.quantity} is {m.value:.6g}, must be <= {m.limit:.6g}" for m in failed)
    said = ", and ".join(named) or f"they fail by less than {_VIOLATED:g} of a limit"
    error = InfeasibleProgram(f"{sentence}; {said} ({outcome.sentence})")
    error.law, error.margins = law, every
    return error


def _law_of_response(model, controls, response, outcome):
    """The law of V and Y."""
    system, intervals = model.program.system, len(model.program.system.control)
    n = len(system.initial_mean)
    # x_0 and x_{k+1} - A_k x_k of states without feedback are [x~_0; W~].
    difference = np.eye((intervals + 1) * n)
    for k, transition in enumerate(system.transition):
        difference[(k + 1) * n : (k + 2) * n, k * n : (k + 1) * n] = -transition
    deviation = model.open_loop + model.whole.control @ response
    history = response @ model.root.whitening @ difference
    return _law(model, controls, history, deviation @ deviation.T, response @ response.T, outcome)


def _law(model, controls, history, state_covariance, control_covariance, outcome):
    """The law of V and L with its statistics and costs, in the program's units."""
    program = model.program
    intervals, n, m = program.system.control.shape
    gain = feedback_gain(model.whole.control, history).reshape(intervals, m, intervals + 1, n).transpose(0, 2, 1, 3)
    covariance, control_covariance = diagonal_blocks(state_covariance, n), diagonal_blocks(control_covariance, m)
    control, mean = controls.reshape(intervals, m), (model.mean + model.whole.control @ controls).reshape(-1, n)
    quadratic = np.sum(program.state_weight * covariance[:-1]) + np.sum(program.control_weight * control_covariance)
    quadratic += np.einsum("ki,kij,kj->", control, program.mean_control_weight, control)
    if program.desired_state is not None:
        error = (mean - program.desired_state)[:-1]
        quadratic += np.einsum("ki,kij,kj->", error, program.state_weight, error)
    percentile = max(
        (
            item.offset
            + item.gradient @ mean[-1]
            + upper_quantile(item.probability) * np.sqrt(item.gradient @ covariance[-1] @ item.gradient)
            for item in program.percentiles
        ),
        default=np.nan,
    )
    return SteeringLaw(
        control=control,
        gain=gain,
        mean=mean,
        covariance=covariance,
        control_covariance=control_covariance,
        objective=float(quadratic + (program.percentile_weight * percentile if program.percentile_weight > 0 else 0.0)),
        quadratic_cost=float(quadratic),
        percentile=float(percentile),
        innovations=len(model.root.block),
        condition=model.root.condition,
        # Gains on a known initial state multiply zero and are arbitrary.
        largest_gain=float(np.abs(gain if program.system.initial_covariance.any() else gain[:, 1:]).max()),
        **outcome._asdict(),
    )


def _solution(variable):
    """Value of a variable, zero if nothing depends on it."""
    return np.zeros(variable.shape) if variable.value is None else variable.value


def _roots(weights):
    """F_k with F_k'F_k = Q_k, (N, n, n)."""
    values, vectors = np.linalg.eigh(weights)
    return np.sqrt(np.maximum(values, 0))[:, :, None] * vectors.swapaxes(1, 2)


def _block_diagonal(blocks):
    """Blocks (k, p, p) on the diagonal of a (k p, k p) matrix."""
    count, size, _ = blocks.shape
    matrix = np.zeros((count, size, count, size))
    matrix[np.arange(count), :, np.arange(count)] = blocks
    return matrix.reshape(count * size, -1)


def _scatter(mask):
    """Matrix that puts numbers in the true entries of a flattened array."""
    from scipy.sparse import csr_array

    places = np.flatnonzero(mask)
    return csr_array((np.ones(places.size), (places, np.arange(places.size))), shape=(mask.size, places.size))


def _nonzero(scale):
    """Scales, with one instead of zero."""
    return np.where(scale > 0, scale, 1.0)


def _distinct(rows):
    """Unit vectors of the given (kind, step, row) in the order of steps, one for parallel ones; and each row's own."""
    distinct, index = [], np.zeros(len(rows), dtype=int)
    for i in sorted(range(len(rows)), key=lambda i: rows[i][1]):
        kind, step, row = rows[i]
        direction = row / (np.linalg.norm(row) or 1.0)
        for j in range(len(distinct) - 1, -1, -1):
            if distinct[j][1] != step:
                j = -1
                break
            other = distinct[j][2]
            if distinct[j][0] == kind and min(np.abs(direction - other).max(), np.abs(direction + other).max()) < 1e-12:
                break
        else:
            j = -1
        if j < 0:
            distinct.append((kind, step, direction))
            j = len(distinct) - 1
        index[i] = j
    return distinct, index.tolist()
