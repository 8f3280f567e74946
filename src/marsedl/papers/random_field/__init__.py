"""Ridderhof and Tsiotras: chance-constrained covariance steering in a Gaussian random field."""

from marsedl.replication.catalogue import Erratum, Paper, Product

FIGURES = {
    "fig01": Product(
        "Samples of a Gaussian random field on a line. Left: without measurements. Right: the same random numbers, "
        "conditioned on noisy measurements. Kernel (squared exponential), measurements and noise are not printed; "
        "those of the configuration are drawn.",
    ),
    "fig02": Product(
        "A sample of a Gaussian random field on a plane. Left: without a condition. Right: the same random numbers, "
        "with the field held constant, without noise, along the two edges (red) that meet in the corner on the right,"
        " where either coordinate is largest. Kernel (squared exponential) and value at the edges are not printed.",
    ),
    "fig03": Product(
        "Samples of the density variation over altitude, and of the process in time that they become along the "
        "nominal path, here the flight without control. Drawn from the model: the second is the first, looked up at "
        "the altitude of each time.",
    ),
    "fig04": Product("Samples of the random force on the double integrator (Eq. 59) over three periods."),
    "fig05": Product(
        "Double integrator without feedback and with the law: ellipses of the stated probability at each step by "
        "linear covariance and of all trials, some of the trials, and the two lines that bound the state (Eq. 61). "
        "The chance constraints hold three standard deviations from each line; the ellipses have a radius of 3.44, "
        "and so protrude.",
    ),
    "fig06": Product(
        "The mission, radii to scale. Top: the flight without control, left at a lower velocity, so that its apoapsis"
        " falls a fifth of the climb short of the target and both burns are to be seen; without this it needs no "
        "second burn where its entry angle is solved. Bottom: its altitude over the distance travelled. Blue: below "
        "the altitude of entry.",
    ),
    "fig07": Product(
        "Coordinates of the atmospheric flight: radius, velocity, flight path angle (positive while climbing), lift "
        "and drag. A sketch, not drawn from data.",
    ),
    "fig08": Product(
        "Angle of attack of a blunt vehicle, and the lift rolled by the bank angle, whose cosine is the control. A "
        "sketch, not drawn from data.",
    ),
    "fig09": Product(
        "Mean density against altitude, and the table that it goes through. The paper prints no values of its "
        "MarsGRAM profile.",
    ),
    "fig10": Product(
        "Samples of the density variation against altitude, exact on all altitudes drawn. Left of the dashed line, if"
        " it is reached, the density would be negative; flights keep it at the least ratio of the configuration.",
    ),
    "fig11": Product(
        "Nominal flight in the mean density: the initial guess, which is zero control, dashed, and the last iteration, "
        "solid. As they hardly differ, the lower panels show the differences of all iterations from the guess.",
    ),
    "fig12": Product(
        "Delta-v of the flights, lost ones counted in the histogram's denominator, and the normal density of linear "
        "covariance, both with their 99th percentiles. Flights need least delta-v at the target apoapsis, where the "
        "modulus of the clean-up burn has its kink; linear covariance goes on below it. It is shown without the "
        "navigation errors that the design adds.",
    ),
    "fig13": Product(
        "Mean control, held over each interval, and three standard deviations by linear covariance. They include the "
        "navigation errors of the design, as in its chance constraint, which keeps them within the limits.",
    ),
    "fig14": Product(
        "Open loop: errors against the nominal flight of zero control in the mean density, of the first trials and of "
        "all. Bars: linear covariance at the nodes, about the mean it predicts less the same nominal. Where the "
        "prediction would dwarf the flights, it leaves the axis and is stated.",
    ),
    "fig15": Product(
        "As Fig. 14 under the law of the last iteration, if there is one: errors against the nominal flight that its "
        "mean control gives. The design's navigation errors are left out of the bars. Controls are those commanded, "
        "before they are cut off at the limits; stars are the mean and three standard deviations over the flights.",
    ),
    "fig16": Product(
        "Dynamic pressure of the first trials, open loop above and under the law of the last iteration below, with the "
        "nominal on top and three standard deviations of all trials.",
    ),
    "fig17": Product(
        "Relative density variation that the first trials meet under the law of the last iteration; three standard "
        "deviations of all trials at each time, and of the field along the nominal flight (Eq. 16).",
    ),
    "violations": Product(
        "Probability of a command beyond its limits in each interval, and of a state of the double integrator beyond "
        "each line at each node: what the chance constraint allots, what linear covariance predicts, and the share of "
        "the flights with its binomial interval. Where no flight violates, an arrow marks the largest probability "
        "compatible with that. Few trials cannot tell a violation of the allotted size from a larger one.",
        beyond=True,
    ),
    "convergence": Product(
        "Iteration far beyond the paper's, and how it ends. With one linearised branch of the clean-up burn each "
        "program expects to gain by crossing the kink, and the flights do not follow; with both branches in the "
        "program there is nothing to gain there. Short end steps divide the first and the last interval.",
        beyond=True,
    ),
    "regularization": Product(
        "Last law of the paper's iterations against the navigation errors that the design adds to each interval, drawn "
        "by the one in radius; those in velocity and path angle change in proportion. With small ones the gains grow "
        "without bound, linear covariance promises ever less spread, and the flights fail. Shares of no flight at all "
        "are not drawn.",
        beyond=True,
    ),
    "field_study": Product(
        "What would raise the 99th percentile without control: larger variances, and hypotheses on the field, each "
        "against the standard deviation that it gives to the density at 45 km, near the lowest altitude. Bars are "
        "three standard errors; triangles mark fields in which so many trials are lost that no percentile exists. "
        "Hypotheses say nothing of what the authors did.",
        beyond=True,
    ),
    "delta_v_map": Product(
        "Delta-v against the exit apoapsis, with flights as points and histograms of their apoapses (scaled to equal "
        "height). Green: linear models at the guess, which is at the kink if its entry angle is solved. Triangles: "
        "what the design of an iteration expects of its mean; circles: what the nominal of its control then needs.",
        beyond=True,
    ),
}

# What the paper shows in its figures, and finds in them.
DESCRIBED = {
    "fig01": (
        "Samples of a Gaussian random field over one dimension, with and without conditioning on noisy "
        "measurements. The paper offers it as background only: conditioning is a common use of such fields, but "
        "its method uses nothing more than the fact that values of the field are jointly Gaussian."
    ),
    "fig02": (
        "Samples of a Gaussian random field over two dimensions, with and without conditioning; the condition "
        "holds the field constant on its right-most edges. It illustrates conditioning, which the paper's method "
        "does not use."
    ),
    "fig03": (
        "Samples of the random field and of the random process that it becomes along the nominal trajectory. The "
        "paper uses it to show its main approximation: the nominal trajectory maps space to time, so that a field "
        "in space is replaced by a Gaussian process in time with the mean and covariance found along that "
        "trajectory."
    ),
    "fig04": (
        "Samples of the random force that acts on the double integrator as a function of position, with the two- "
        "sigma interval shaded. The force has zero mean and a locally periodic covariance with variance 2e-6, "
        "period 0.35 and length scales 0.8 (periodic) and 1 (exponential). The text says nothing more about the "
        "curves."
    ),
    "fig05": (
        "Trajectories of the double integrator without feedback (top) and with it (bottom), with 99.73 % ellipses "
        "by linear covariance (black, dashed) and from 5,000 Monte Carlo trials (gray, solid); two dashed lines "
        "through (0.7, 0.1) bound the state. The paper notes that not all closed-loop ellipses lie wholly inside "
        "the bounds, but finds the chance constraints satisfied in the 5,000 trials."
    ),
    "fig06": (
        "Sketch of the aerocapture mission. In the paper's account the atmospheric flight is followed by a burn "
        "that raises the periapsis out of the atmosphere and then by a second burn that corrects the apoapsis; "
        "the delta-v of both depends on the target orbit and on the state at the end of the atmospheric flight."
    ),
    "fig07": (
        "Sketch of the coordinates of the atmospheric flight, with lift and drag. The text defines the state by "
        "radius, planet-relative velocity and flight path angle, and makes no further statement about the figure."
    ),
    "fig08": (
        "Sketch of steering by bank angle, with bank angle and angle of attack. The paper explains that the "
        "vehicle flies at a trimmed angle of attack and turns its lift about the velocity; the cosine of the bank "
        "angle sets the vertical part of the lift and is the only control here, as lateral guidance is left out."
    ),
    "fig09": (
        "Nominal density profile of the atmosphere of Mars. The paper takes it from MarsGRAM as a smooth, known "
        "function of altitude and does not discuss the curve further."
    ),
    "fig10": (
        "Samples of the density variation, a field over altitude with zero mean, with the two-sigma interval "
        "shaded. The paper bases its covariance on MarsGRAM, with a scale height of 11.1 km, and says that the "
        "variance takes its largest value from an altitude of 120 km upwards. The single samples are not "
        "discussed."
    ),
    "fig11": (
        "Nominal aerocapture trajectories of the initial guess, which is zero control (dashed), and of the last "
        "iteration (solid). The last one results from three iterations of the algorithm; the text makes no "
        "comparison of the two."
    ),
    "fig12": (
        "Probability density of delta-v for the open-loop guess and each iteration, as a curve by linear "
        "covariance and a histogram of 5,000 trials; panels (b) to (d) span 200–400 m/s. The paper finds a "
        "reasonable fit, with a mismatch in (c) and the absolute value in the clean-up cost as one error source. "
        "Iterations consistently lower the upper percentile; the 99th falls from 717 m/s in open loop to 314 m/s."
    ),
    "fig13": (
        "Control inputs of each iteration with three-sigma intervals by linear covariance. The paper finds that "
        "iterating raises the vertical lift early in the flight and lowers it at the end. Near the largest "
        "dynamic pressure, nominally at 147 s, the nominal lift ends up almost at zero, which leaves room for "
        "feedback of larger variance within the limits of -1 and 1."
    ),
    "fig14": (
        "State errors and control of Monte Carlo samples for the initial open-loop guess. Dashed lines are three- "
        "sigma bounds of the trials for states and the limits for the control; stars mark the control's mean and "
        "bounds, error bars the bounds by linear covariance. The paper finds linear covariance more accurate here "
        "than for the optimized law of Fig. 15."
    ),
    "fig15": (
        "State errors and control of Monte Carlo samples under the optimized closed-loop law, marked as in Fig. "
        "14. The paper notes that controls were saturated, with three-sigma bounds slightly beyond the limits. It "
        "finds linear covariance less accurate than for the guess and attributes this to the feedback, which "
        "enlarges the deviations in dynamic pressure."
    ),
    "fig16": (
        "Dynamic pressure along sample trajectories of the Monte Carlo, for the initial open-loop guess (top) and "
        "for the optimized closed-loop law (below). The paper finds that corrective control increases the "
        "departures from the nominal dynamic pressure, and explains by this why linear covariance is less "
        "accurate for the optimized law."
    ),
    "fig17": (
        "Density variation met along Monte Carlo trajectories, with three-sigma bounds from the trials and from "
        "the covariance evaluated along the nominal trajectory. The paper finds that the two agree closely and "
        "takes this, for the aerocapture example at hand, as support for replacing the field in space by a "
        "process in time."
    ),
}

TABLES = {
    "iterations": Product(
        "The open loop and the law of every iteration. Delta-v as linear covariance predicts it, with the true "
        "disturbances and with the design's navigation errors, and as flown: 99th percentile with its standard error "
        "(Maritz-Jarrett, lost trials counted as worse than any other), median, mean and deviation of captured trials. "
        "Trials in which the Gaussian variation would have taken the density below its floor. How often the "
        "command leaves its limits, at the worst step and at any, with exact binomial intervals beside what Eq. 77 "
        "allots per step.",
    ),
    "state_deviations": Product(
        "Standard deviations of radius, velocity and flight path angle at the nodes, over the trials and by linear "
        "covariance (Figs. 14 and 15), with the ratio of predicted and flown.",
    ),
    "control_violations": Product(
        "Probability that the commanded control leaves its limits at every step: what Eq. 77 allots, what linear "
        "covariance predicts without and with the design's navigation errors, and the share of the trials with its "
        "exact binomial interval.",
        beyond=True,
    ),
    "double_integrator": Product(
        "Double integrator: standard deviations at the nodes, over the trials and by linear covariance; how far the "
        "99.73 % ellipse of linear covariance reaches beyond the constraint lines (a'x less its bound, above zero it "
        "protrudes); the law's control; what the state constraints cost.",
    ),
    "double_integrator_violations": Product(
        "Double integrator: probability of lying beyond either constraint line at every node, as allotted, as linear "
        "covariance predicts, and over the first and all trials with exact binomial intervals. As many trials as the "
        "paper's cannot tell what is allotted from half as much more.",
        beyond=True,
    ),
    "certificates": Product(
        "The first program against the printed form in the history of states, against another solver and against the "
        "identities of Eqs. 35 to 41, and the statistics of its disturbances against sampled fields.",
        beyond=True,
    ),
    "convergence_history": Product(
        "Histories of the iteration. As in the paper it ends in a cycle of two about the kink of the clean-up burn: "
        "what the program predicts and what flights give part by turns. With both branches in the program it "
        "converges, in apoapsis and percentile; the mean control goes on moving where the air is thin and it has no "
        "effect.",
        beyond=True,
    ),
    "navigation_errors": Product(
        "The last law against the size of the navigation errors of the design: without them gains grow, predictions "
        "become fantastic and flights are lost; with large ones the law is timid.",
        beyond=True,
    ),
    "other_fields": Product(
        "Open loop through other random fields, beside the printed 99th percentile: hypotheses on the covariance, and "
        "multiples of the variance.",
        beyond=True,
    ),
}

SUMMARIES = {
    "readings": "What each reading gives: 99th percentile of delta-v with its standard error, lost trials, how the "
    "iteration ends, the mean control in the interval of the peak of dynamic pressure and in the next, how often the "
    "last law leaves the control limits, and its largest gain.",
    "densities": "Readings that differ in the nominal density alone, beside the printed numbers. Entry angle and time "
    "of largest dynamic pressure depend on nothing else and single out the MarsGRAM profile among those tried. The "
    "percentiles do not: over all these densities that of the open loop varies by much less than it is off, and that "
    "of the last iteration comes closest where the angle is furthest off.",
}

ERRATA = (
    Erratum(
        "E1",
        "Eq. 74: b(h) = sigma^2 exp(-(h - h_trans)/c_scale)",
        "Contradicts the sentence that the variance is largest from h_trans on. With it the deviation is 251 % at 45 "
        "km instead of 5.9 %, and 87 % of the trials without control are lost. Mars-GRAM 2010 states 9.6 % at 60 km, "
        "17 % at 80, 30 % at 100 and 40 % at 120 km; with the sign reversed it is 8.6, 14, 23 and 38 %. The printed "
        "form is a covariance as well, so only its values tell.",
        "exp(+(h - h_trans)/c_scale); `sign_printed` keeps Eq. 74",
    ),
    Erratum(
        "E2",
        "Sec. V.B.2: sigma_rho,max^2 = 1480 (kg/m^3)^2",
        "The variation is a ratio (Eq. 72) and has no unit. sqrt(1480) is 38.5: in per cent it is what Mars-GRAM 2010 "
        "states near 120 km. As a plain number, a deviation of 3847 %, 90 % of the trials without control are lost.",
        "0.148; `variance_printed` keeps 1480",
    ),
    Erratum(
        "E3",
        "Sec. V.B.2: partition (0, 50, 75, ..., 425, 450, 400) s",
        "Does not increase. The final time of 400 s and longer steps at both ends fit (0, 50, 75, ..., 325, 350, 400). "
        "Nodes up to 450 s would fit a final time of 500 s, when the vehicle is at 200 km instead of 127 km.",
        "0, 50, 75, ..., 325, 350, 400 s; `end_step_25` and `tf_500` are the other two; `printed` reports the "
        "partition and makes no design",
    ),
    Erratum(
        "E4",
        "Sec. V.B.3: p_f = 0.1, approximately the 99th percentile",
        "By Eq. 13 it is the 90th: 1.28 standard deviations above the mean instead of 2.33.",
        "p_f = 0.01; `pf_printed` and `metres_pf_printed` keep 0.1",
    ),
    Erratum(
        "E5",
        "Sec. V.B.2: nominal density provided by MarsGRAM",
        "No values, version, date or place. Two printed numbers follow from it alone, entry angle and time of largest "
        "dynamic pressure. The sample and the daily mean of the MarsGRAM 2021a reference output bracket the angle "
        "(-10.0265 and -10.0050 deg, printed -10.0128 deg) and meet the time; other atmospheres miss the angle by 0.07 "
        "to 0.18 deg and the time by 0.7 to 2.8 s.",
        "the MarsGRAM 2021a sample, as the closest stand-in; the angle is solved; six readings for other densities",
    ),
    Erratum(
        "E6",
        "Sec. V.B.3: eta = 1, unit of J_2 not stated",
        "J_1 has no unit and J_2 that of a speed. In m/s the terms of J_1 have no weight, the mean control stands at "
        "its trust region nearly everywhere, and the limits of Eq. 77 are left ten times more often than allotted. In "
        "km/s the lift near the peak of dynamic pressure is almost zero, as the text says.",
        "km/s; `metres` and `metres_pf_printed` take m/s",
    ),
    Erratum(
        "E7",
        "Eq. 76: derivative of delta-v at the nominal; Sec. V.B.4: every iteration lowers the percentile",
        "The guess ends at the target apoapsis, where the absolute value of Eq. 69 has a kink: the predicted deviation "
        "of delta-v is 136, 41 or 54 m/s with the derivative below, of the mean of both, or above. Later iterations "
        "are linearised on one side and promise gains beyond the kink that flights do not keep: the iteration ends in "
        "a cycle of two, and an odd number of iterations, such as three, ends on its worse side.",
        "mean of both sides at the kink; `kink_undershoot`, `kink_overshoot`; `both_branches` has the larger of both "
        "in the program",
    ),
    Erratum(
        "E8",
        "Eq. 56: no disturbances but those of the field",
        "The field is almost exactly predictable from states known without error: in units of 1 km, 100 m/s and 0.01 "
        "rad Cov(W) has condition number 2.6e13 and the program finds gains of 1e18 and more. It predicts a deviation "
        "of delta-v around 1 m/s, and two thirds of the trials and more are lost. What kept the paper's gains finite "
        "is not said.",
        "independent navigation errors of 10 m, 1 m/s and 0.1 mrad per interval in the design; predictions without "
        "them; `literal_gains` has none",
    ),
    Erratum(
        "E9",
        "Eq. 44: S^(1/2) with zero initial covariance",
        "S is singular, so a Cholesky factor does not exist; the gains on the initial state multiply zero.",
        "innovations instead of S^(1/2); gains on the initial state are compared nowhere",
    ),
    Erratum(
        "E10",
        "Sec. V.A: lines of slopes ±0.05/0.1",
        "The vectors of Eq. 61 do belong to lines through (0.7, 0.1), but of slopes -0.025 and 0.025. Between lines of "
        "the printed slopes no constraint would be active and no ellipse near them.",
        "the vectors of Eq. 61",
    ),
    Erratum(
        "E11",
        "Sec. V.A: constraint at each step k",
        "The last node may or may not be meant. Without it 29 % of the trials violate the constraint there, while the "
        "text says that it was satisfied.",
        "k = 0, ..., 5; `cc_to_4` leaves the last out",
    ),
    Erratum(
        "E12",
        "Eq. 8: feedback of the deviation from the mean",
        "Not said whether the mean is that of the linear model or the nominal trajectory of the new control.",
        "the mean of the linear model",
    ),
    Erratum(
        "E13",
        "Sec. V.B.3: M_N^x = (dr_a/dx)'(dr_a/dx)",
        "Read as a bound of the linearised change of the apoapsis, the only sense that has its unit.",
        "|dr_a/dx (xbar_N - x^_N)| <= 0.1 r_p",
    ),
    Erratum(
        "E14",
        "Eq. 29: third block A_1 c_1 of the constant vector",
        "Repeating Eq. 23 gives A_1 c_0 + c_1.",
        "A_1 c_0 + c_1, in every reading",
    ),
    Erratum(
        "E15",
        "Eqs. 12, 33 and 39: bars and tildes",
        "In the text at hand Rbar weighs the deviation of the control, Eq. 33 gives the deviation and Eq. 39 has the "
        "means of initial state and disturbance. The lines after them need the mean control, the mean state and the "
        "deviations.",
        "bars for means and tildes for deviations, in every reading",
    ),
    Erratum(
        "E16",
        "Sec. IV.C: control constraints (9)",
        "They are Eq. 10.",
        "Eq. 10",
    ),
    Erratum(
        "E17",
        "Eq. 78 and Fig. 16: density in the dynamic pressure",
        "Not said whether it is the actual density or the mean one at the actual altitude.",
        "the mean density, an input",
    ),
    Erratum(
        "E18",
        "Sec. V.B.4: three-sigma limits of the control slightly outside the bounds",
        "By linear covariance they cannot be, as Eq. 77 bounds them.",
        "statistics of the commanded control over the trials, before it is cut off",
    ),
)

PAPER = Paper(
    slug="random_field",
    title="Chance-Constrained Covariance Steering in a Gaussian Random Field via Successive Convex Programming",
    authors="Jack Ridderhof and Panagiotis Tsiotras",
    citation="J. Ridderhof, P. Tsiotras, Chance-Constrained Covariance Steering in a Gaussian Random Field via "
    "Successive Convex Programming",
    figures=FIGURES,
    described=DESCRIBED,
    closeups=("iterations",),
    tables=TABLES,
    summaries=SUMMARIES,
    errata=ERRATA,
    # Gains of 1e18 and more and the flights under them, and how nearly two solutions of one program agree.
    noise=(
        "literal_gains/gains/*",
        "literal_gains/montecarlo.aerocapture/*",
        "claims/*/literal_gains",
        "corrected/certificates/*_gain_difference",
        *(
            f"corrected/regularization/{field}"
            for field in (
                *("largest_gain", "predicted_deviation", "design_deviation", "flown_deviation", "percentile"),
                *("percentile_error", "saturated", "worst_step", "lost"),
            )
        ),
    ),
)
