"""Artifacts of the powered-descent paper."""

import numpy as np

from marsedl.papers.ensembles import Ensemble, along
from marsedl.replication.records.fields import Axis, quantity, record

MOTION = Axis("motion", downrange="m", altitude="m", downrange_velocity="m/s", vertical_velocity="m/s")
STATE = Axis("state", **MOTION.units, mass="kg")
CONTROL = Axis("control", downrange="N", vertical="N")  # components of the thrust
OBSERVED = Axis("observed", thrust="N", depth="m")  # depth below the ground
THRUST, DEPTH = 0, 1  # components of what is observed
COUNTED = Axis("counted", thrust="N")  # the first of the observed


@record
class Nominal:
    """Mass profile of Algorithm 3 and the mean trajectory that belongs to it."""

    time: np.ndarray = quantity(
        "s", ("time",), "time from the start of the flight; the switch stands twice", label="time"
    )
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    mass: np.ndarray = quantity("kg", ("time",), "prior mass profile: of the last pass, or the first", label="mass")
    mass_of_pass: np.ndarray = quantity(
        "kg", ("passes", "time"), "mass profile after each pass; the first is the guess"
    )
    integrated_change: np.ndarray = quantity("kg s", ("changes",), "integral of the change of the mass in each pass")
    mean: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "mean state: downrange, altitude and their rates")
    feedforward: np.ndarray = quantity("N", ("time", CONTROL), "mean thrust")
    flown: np.ndarray = quantity(MOTION.unit, (MOTION,), "final state of the noise-free flight of the nonlinear plant")


@record
class Linearization:
    """Linear model x' = A x + B u + c of both segments; integrals start anew with each segment."""

    time: np.ndarray = quantity(
        "s", ("time",), "time from the start of the flight; the switch stands twice", label="time"
    )
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    state_matrix: np.ndarray = quantity("1/s", ("time", MOTION, MOTION), "A, exact Jacobian of the motion in the state")
    control_matrix: np.ndarray = quantity(
        "1/kg", ("time", MOTION, CONTROL), "B, exact Jacobian of the motion in the thrust"
    )
    affine: np.ndarray = quantity("m/s, m/s, m/s^2, m/s^2", ("time", MOTION), "c, rates at zero state and thrust")
    transition: np.ndarray = quantity(
        "SI", ("time", MOTION, MOTION), "open-loop transition matrix from the segment's start"
    )
    gramian: np.ndarray = quantity(
        "SI", ("time", MOTION, MOTION), "controllability Gramian referred to the segment's start"
    )
    affine_response: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "state reached by c alone")


@record
class Gains:
    """Scheduled control u = feedforward - gain (x - mean), and the covariance that the linear model predicts."""

    time: np.ndarray = quantity(
        "s", ("time",), "time from the start of the flight; the switch stands twice", label="time"
    )
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    gain: np.ndarray = quantity("N/m, N/m, N s/m, N s/m", ("time", CONTROL, MOTION), "feedback gain")
    feedforward: np.ndarray = quantity("N", ("time", CONTROL), "mean control")
    mean: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "mean state")
    covariance: np.ndarray = quantity("SI", ("time", MOTION, MOTION), "predicted covariance under the plant's noise")
    riccati: np.ndarray = quantity("SI", ("time", MOTION, MOTION), "solution of the Riccati equation")
    escape_margin: np.ndarray = quantity("1", ("time",), "smallest eigenvalue of R(t); positive: the solution exists")
    riccati_initial: np.ndarray = quantity(
        "SI", ("segments", MOTION, MOTION), "Riccati solution at each segment's start"
    )
    mean_costate: np.ndarray = quantity("SI", ("segments", MOTION), "costate of the mean at each segment's start")
    mean_cost: np.ndarray = quantity("N^2 s", ("segments",), "integral of the squared mean control")
    covariance_cost: np.ndarray = quantity("N^2 s", ("segments",), "expected integral of the squared feedback control")
    noise_density_design: float = quantity("N sqrt(s)", (), "noise density that the boundary condition designs for")
    noise_density_plant: float = quantity("N sqrt(s)", (), "noise density of the plant")


@record
class FixedPointStudy:
    """Runs of Algorithm 1 with every boundary condition, and its iterations against the noise density."""

    unit: np.ndarray = quantity(
        "N", ("unit",), "thrust unit of the run: the reading's, and the maximum thrust if that is another"
    )
    boundary: np.ndarray = quantity("1", ("boundary",), "boundary condition", "str")
    order: np.ndarray = quantity("1", ("order",), "gauss_seidel, or jacobi as printed", "str")
    iterations: np.ndarray = quantity("1", ("unit", "boundary", "order", "segments"), "iterations", "int64")
    converged: np.ndarray = quantity("1", ("unit", "boundary", "order", "segments"), "tolerance reached", "bool")
    riccati_error: np.ndarray = quantity(
        "1",
        ("unit", "boundary", "order", "segments"),
        "largest difference from the closed form of the equivalent noise density, relative to its largest entry",
        allow_nan=True,
    )
    covariance_error: np.ndarray = quantity(
        "1",
        ("unit", "boundary", "segments"),
        "largest relative error of the final variances in the linear model with the plant's noise, Jacobi order",
        allow_nan=True,
    )
    loose_iterations: np.ndarray = quantity(
        "1", ("unit", "segments"), "iterations of the printed algorithm with an absolute tolerance of 1e-3", "int64"
    )
    loose_variance: np.ndarray = quantity(
        "SI", ("unit", "segments", MOTION), "final variances that this early stop gives", allow_nan=True
    )
    density: np.ndarray = quantity("N sqrt(s)", ("density",), "noise densities of the sweep", label="noise density")
    sweep_iterations: np.ndarray = quantity(
        "1", ("density", "order", "segments"), "iterations, corrected boundary, thrust in newtons", "int64"
    )
    sweep_converged: np.ndarray = quantity("1", ("density", "order", "segments"), "tolerance reached", "bool")
    sweep_error: np.ndarray = quantity(
        "1", ("density", "order", "segments"), "difference from the closed form as above", allow_nan=True
    )
    smallest_eigenvalue: np.ndarray = quantity(
        "1",
        ("density", "segments"),
        "smallest eigenvalue of the Riccati solution at the start, scaled by its diagonal",
    )
    critical_density: np.ndarray = quantity(
        "N sqrt(s)", ("segments",), "largest density at which the Riccati solution is singular; 0: none in the range"
    )


@record
class Certificates:
    """How far the design is from its independent checks, by segment."""

    covariance_error: np.ndarray = quantity(
        "1", ("segments",), "final covariance of Eq. 40 against the target, relative"
    )
    riccati_error: np.ndarray = quantity("1", ("segments",), "Riccati solution of Eq. 21 at the end, relative")
    h_identity_error: np.ndarray = quantity(
        "1", ("segments",), "largest relative error of G^2 Sigma^-1 = H + Lambda over time, H from Eq. 42"
    )
    mean_error: np.ndarray = quantity(MOTION.unit, ("segments", MOTION), "mean of Eq. 31 at the end minus the target")
    costate_error_eq39: np.ndarray = quantity("1", ("segments",), "costate of Eq. 39 against p + Lambda x, relative")
    costate_error_eq37: np.ndarray = quantity("1", ("segments",), "costate of Eq. 37 against that of Eq. 39, relative")
    eq46_residual: np.ndarray = quantity(
        "1", ("segments",), "largest relative residual of Eq. 46 with the P and Q that satisfy Eq. 43"
    )
    index_eq20: np.ndarray = quantity(
        "N^2 s", ("segments", "controls"), "modified index by Eq. 20, for several controls"
    )
    index_eq23: np.ndarray = quantity("N^2 s", ("segments", "controls"), "modified index by Eq. 23 as printed")
    dropped_term: np.ndarray = quantity("N^2 s", ("segments", "controls"), "term that Eq. 23 leaves out")
    intervals: np.ndarray = quantity("1", ("intervals",), "held intervals of the bounds below", "int64")
    mean_cost_ratio: np.ndarray = quantity(
        "1", ("segments", "intervals"), "cost with held mean control over closed form"
    )
    covariance_cost_ratio: np.ndarray = quantity(
        "1", ("segments", "intervals"), "cost with held feedback (semidefinite program) over closed form"
    )
    lossless_gap: np.ndarray = quantity(
        "1", ("segments", "intervals"), "gap of the relaxation in the semidefinite program"
    )
    solver_status: np.ndarray = quantity("1", ("segments", "intervals"), "status of the semidefinite solver", "str")
    solver_iterations: np.ndarray = quantity("1", ("segments", "intervals"), "iterations of the solver", "int64")


_ALONG = along(
    state=STATE,
    observed=OBSERVED,
    counted=COUNTED,
    outcome="0 completed, 1 below the ground, 3 not finite",
    histogram="trials by thrust over time",
    histogram_edges="edges of the histogram's inner bins",
    final_state="final state",
    observed_maximum="largest thrust and depth",
    kept_history="state over time of the kept trials",
    kept_observed="thrust and depth of them",
    observed_mean="mean thrust and depth",
    flying="trials in the moments over time: here all of them",
    excluded="trials left out of the moments because they are not finite",
)


@record
class FlightEnsemble(Ensemble):
    """All trials of one Monte Carlo case."""

    inherited = _ALONG

    time: np.ndarray = quantity(
        "s", ("time",), "time from the start of the flight; the switch stands twice", label="time"
    )
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
