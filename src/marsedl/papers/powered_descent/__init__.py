"""Ridderhof and Tsiotras: covariance steering for Mars powered descent."""

from marsedl.replication.catalogue import Erratum, Paper, Product

FIGURES = {
    "fig01": Product(
        "Change of the mass profile in each pass of its iteration, point by point (the paper does not say whether "
        "it plots "
        "this or an integral).",
    ),
    "fig02": Product(
        "Geometry of the divert, drawn from the mean trajectory and the ballistic arc; ellipses as in Fig. 3."
    ),
    "fig03": Product(
        "Closed-loop and open-loop trajectories in the plane with covariance ellipses at equal increments of each "
        "segment "
        "(the text says 3 sigma, the caption 95 %; drawn at the reading's level).",
    ),
    "fig04": Product("Downrange position, altitude and their velocities of closed-loop trials."),
    "fig05": Product("Vehicle mass of the same trials: left with the prior profile, right as the difference from it."),
    "fig06a": Product("Feedback gains of position and velocity; both axes coincide in the first segment."),
    "fig06b": Product(
        "Control magnitude as a fraction of the maximum thrust: mean, upper percentile and maximum over all trials."
    ),
    "fig07": Product(
        "Variances of downrange and altitude, predicted by the linear design and measured over the trials; below, "
        "their "
        "ratio. The band holds 95 % of sample variances if the prediction is true.",
    ),
    "fixed_point": Product(
        "Left: iterations of Algorithm 1 (corrected boundary condition, thrust in newtons) against the noise density. "
        "Right: its error at the end against the closed form, which needs no iteration.",
        beyond=True,
    ),
    "integrator_error": Product(
        "Error of the final state against the step on shared Brownian paths, against Runge-Kutta with the finest step.",
        beyond=True,
    ),
}

# What the paper shows in its figures, and finds in them.
DESCRIBED = {
    "fig01": (
        "Difference between the mass profiles of successive passes of the mass iteration for the simulated "
        "scenario, with the change in mass on a logarithmic scale. The paper presents it as evidence that the "
        "iteration, which starts from a constant wet mass, converges."
    ),
    "fig02": (
        "Sketch of the divert geometry: from the initial mean and covariance the vehicle would coast along an "
        "uncontrolled path to its touchdown point. The guidance has to bring mean and covariance to the target "
        "values instead, and the divert radius is the distance between the uncontrolled and the target touchdown "
        "point."
    ),
    "fig03": (
        "A sample of 50 trials in the plane, with closed-loop and open-loop control, and covariance ellipses "
        "about the mean path (3 sigma in the text, 95 % in the caption). The paper sees the closed-loop trials "
        "spread at first in the first divert, then contract to the intermediate covariance, while the open-loop "
        "mean stays close to the closed-loop mean."
    ),
    "fig04": (
        "Horizontal and vertical position and velocity of some closed-loop trials against time. The text "
        "introduces the plot without discussing it; the prescribed means are 50 m, 150 m, 0 m/s and -5 m/s at 26 "
        "s, and 100 m, 50 m and no velocity at the end, 15 s later."
    ),
    "fig05": (
        "Vehicle mass against time. As noise enters only through the acceleration, the paper ascribes the "
        "variation in mass to the feedback that corrects deviations from the nominal path. It reports a mean "
        "final mass of 1,349 kg over all trials, against 1,346 kg in the prior mass profile."
    ),
    "fig06a": (
        "Feedback gains of the controller against time. The paper points out that the gains jump at 26 s, where "
        "the control law changes to that of the second segment with its new target."
    ),
    "fig06b": (
        "Control magnitude over all trials, relative to the full thrust of 18,000 N: mean, upper 95 percent and "
        "largest value. The paper notes a discontinuity at 26 s and that the limit was never exceeded, although "
        "the design does not enforce it: boundary conditions and flight time were tuned until the solution was "
        "admissible."
    ),
    "fig07": (
        "Variances of downrange position and altitude: predicted by the covariance equation, and measured over "
        "the 2,000 trials. The paper finds almost exact agreement at the start and the end and small deviations "
        "near the middle of each segment, which it puts down to the finite number of trials or to the mass "
        "profile fixed in advance."
    ),
}

TABLES = {
    "eq54": Product(
        "Final state of the trials beside Eq. 54: mean, covariance, and likelihood-ratio tests of the whole "
        "covariance.",
    ),
    "algorithm_1": Product(
        "Runs of Algorithm 1 in the reading's thrust unit and in units of the maximum thrust, with the corrected "
        "boundary condition and with both printed ones; last, the printed form with a loose absolute tolerance.",
        beyond=True,
    ),
    "certificates": Product(
        "Independent checks of the design: the paper's equations integrated forward, and the cost of convex programs "
        "with held controls, which lies above the closed form's and falls to it.",
        beyond=True,
    ),
}

SUMMARIES = {
    "readings": "What each reading reproduces. The deviance tests whether the printed covariance (2,000 trials) and "
    "the "
    "reading's come from the same covariance; a p-value below 0.05 speaks against it.",
}

ERRATA = (
    Erratum(
        "E1",
        "Eq. 46: Sigma^-1 = gamma^2 (P^-1 + Q^-1)",
        "Contradicts Eq. 43, which puts gamma^2 on the side of Sigma^-1; it designs for a noise density of 1/gamma.",
        "gamma^2 Sigma^-1 = P^-1 + Q^-1",
    ),
    Erratum(
        "E2",
        "Algorithm 1, lines 7 and 9: (gamma Sigma)^-1",
        "The same slip in another form; it designs for a squared noise density of 1/gamma in the unit of thrust, so "
        "the "
        "result depends on that unit.",
        "gamma^2 Sigma^-1",
    ),
    Erratum(
        "E3",
        "Algorithm 1, line 9 uses the old Q(0)",
        "Same fixed point, but about twice the iterations of the form that uses the new one.",
        "the new Q(0); the design itself uses the closed form",
    ),
    Erratum(
        "E4",
        "Algorithm 1 stops on an absolute change and starts at P = Q = I",
        "Both depend on the unit of thrust: with small noise and a loose tolerance it stops far from the fixed point.",
        "a relative tolerance, and a check of the final covariance",
    ),
    Erratum(
        "E5",
        "Eq. 51: initial vertical velocity +50 cos 70 deg (climbing)",
        "The converged final mass is then 5.5 kg above the printed 1,349 kg, whose standard error is 0.05 kg; with the "
        "opposite sign it agrees.",
        "descending",
    ),
    Erratum(
        "E6",
        "gamma = 0.02 without a unit",
        "Likelihood-ratio test of the printed covariance without its downrange entry (table of readings): newtons, "
        "kilonewtons and accelerations are rejected decisively, weights on Mars at the 2 % level; 0.02 of the maximum "
        "thrust or of the weight on Earth are not rejected and cannot be told apart.",
        "0.02 of the maximum thrust, as Fig. 6 states thrust",
    ),
    Erratum(
        "E7",
        "Eq. 53: downrange target variance 5 m^2, while Eq. 54 gives 3.889 m^2",
        "The difference is about seven sampling errors; with a target of 4 m^2 it is less than one.",
        "5 m^2 in `corrected`, 4 m^2 in `target4`; both are reported",
    ),
    Erratum(
        "E8",
        "Eq. 54: entry (2,1) is -0.552, entry (1,2) is -0.055",
        "A covariance is symmetric, and only the smaller one is compatible with the simulation.",
        "-0.055",
    ),
    Erratum(
        "E9",
        "Eq. 54: entries (2,4)/(4,2) and (3,4)/(4,3) differ in the last digit; a mean without unit; an altitude "
        "variance in "
        "(m/s)^2",
        "A covariance is symmetric; r2 is an altitude.",
        "the means of the entries; m; m^2",
    ),
    Erratum(
        "E10",
        "prior final mass 1,346 kg against a Monte Carlo mean of 1,349 kg",
        "The iteration ends at 1349.44 kg for every starting guess, and convexity of |u| puts the mean over trials "
        "below "
        "the prior, not above.",
        "not reproducible; nothing is tuned for it",
    ),
    Erratum(
        "E11",
        "Eq. 54: mean altitude 49.807 m, mean downrange velocity 0.092 m/s",
        "17 and 8 standard errors from the target, which a correct simulation meets. Euler-Maruyama errs in the same "
        "direction, but no step fits all components.",
        "not reproducible without the authors' scheme and step",
    ),
    Erratum(
        "E12",
        "Eq. 23 as equal to Eq. 20",
        "Completing the square leaves a term that Eq. 23 drops; it does not depend on the control.",
        "harmless",
    ),
    Erratum(
        "E13",
        "Eq. 20: x(t) Lambda B in the last integral; Algorithm 2, line 6 overwrites M",
        "Dimensions require x'(t) Lambda B; line 6 means the closed-loop Gramian of Eq. 38.",
        "notation",
    ),
    Erratum(
        "E14",
        "Fig. 3: 3-sigma ellipses in the text, 95 % confidence in the caption",
        "In the plane 3 sigma hold 98.9 %, and 95 % are 2.45 sigma.",
        "3 sigma",
    ),
    Erratum(
        "E15",
        "Eq. 50: a two-dimensional state; Algorithm 3: one segment",
        "The state has four components, and the flight has two segments.",
        "the mass iteration runs over both segments, the mass is continuous",
    ),
    Erratum(
        "E16",
        "Q(t) is invertible for all t",
        "Presupposes that Q(0) exists. At critical noise densities the Riccati solution at the start is singular.",
        "the closed form, which works with the Riccati solution itself",
    ),
    Erratum(
        "E17",
        "mass-flow constant 4.85e-4",
        "Rounded: 1/(210 x 9.81) = 4.8541e-4. The rounded value moves the final mass by 0.12 kg, to the rounding edge.",
        "not rounded in `corrected`, rounded in `printed`",
    ),
)

PAPER = Paper(
    slug="powered_descent",
    title="Uncertainty Quantification and Control During Mars Powered Descent and Landing using Covariance Steering",
    authors="Jack Ridderhof and Panagiotis Tsiotras",
    citation="J. Ridderhof, P. Tsiotras, Uncertainty Quantification and Control During Mars Powered Descent and "
    "Landing "
    "using Covariance Steering, AIAA Guidance, Navigation, and Control Conference, 2018",
    figures=FIGURES,
    described=DESCRIBED,
    closeups=("final_states",),
    tables=TABLES,
    summaries=SUMMARIES,
    errata=ERRATA,
)
