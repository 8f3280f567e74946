"""Derollez, Le Cleac'h and Manchester: robust entry vehicle guidance with sampling-based invariant funnels."""

from marsedl.replication.catalogue import Erratum, Paper, Product

_STAGE = "of the stage of the configuration (benchmark_slice, benchmark_level)"

FIGURES = {
    "fig01": Product(
        "Entry funnel around the nominal, in downrange and altitude: every slice is projected on both. The paper's "
        "drawing is a concept without axes. Slices high up may be smaller than the line is wide.",
    ),
    "fig02": Product(
        "Funnel of a Dubins car: some of its slices, which are ellipsoids in x, y and heading, the nominal path, "
        "and flights that begin on the boundary of the first slice. Nothing about the car is printed.",
    ),
    "fig03": Product(
        "Boundary of the entry funnel and largest V of the Monte Carlo flights over the time steps, with linear and "
        "logarithmic axis. The flights begin on the boundary of the first slice, each under a constant disturbance "
        "from the boundary of its set; the band is that of the largest V among each tenth of them. No limits of the "
        "printed axes are given, and no weights, on which the shape of the curve depends.",
    ),
    "fig04": Product(
        "Where V falls around a slice, in the plane of two whitened coordinates, in which the slice is the unit "
        "circle; the others are zero. Left without disturbance, right under the worst one at each point. Grey: the "
        "samples of the program, which are not in this plane. The axes of the printed figure are not named. Where "
        "rho grows, V has to rise on a part of the slice under the worst disturbance.",
    ),
    "bands": Product(
        "Largest deviation of every state in the funnel over time, with flights, their extremes at the end, the "
        "same level for linear dynamics, and an ellipsoid of least trace around what linear dynamics reach from the "
        "initial set itself. Most of the width is that of the shape P: flights fill little of it.",
        beyond=True,
    ),
    "heating": Product(
        "Heat rate of the nominal, the largest of the flights, and the largest in the slices of the funnel with any "
        "disturbance of the density. The limit is imposed on the nominal at nodes only.",
        beyond=True,
    ),
    "linear_bounds": Product(
        "Levels of the funnel, of the funnel of which every stage is proven, and of linear dynamics, beside the "
        "largest V of flights with constant disturbance, with one that is drawn again and again, and with one that "
        "raises V fastest at every step. On the right all of them relative to the flights with constant "
        "disturbance. Levels for linear dynamics bound nothing of the entry.",
        beyond=True,
    ),
    "undersampling": Product(
        f"Bound {_STAGE} from fewer samples than are needed: the program is solved as well, and its bound is too "
        "small. Fresh points tell so only if the bound is far too small.",
        beyond=True,
    ),
    "conditioning": Product(
        f"Condition numbers of bases at the samples {_STAGE}, without the two directions in which all of them are "
        "singular, and of interpolation at well chosen and at random samples.",
        beyond=True,
    ),
    "stage_forms": Product(
        f"Bound {_STAGE} by samples and by multipliers, with several solvers, relative to the largest value of its "
        "polynomial that was found, and iterations. A bound left of the line is too small; what remains of the "
        "equations is added in those that hold.",
        beyond=True,
    ),
    "euler": Product(
        "Bound by the Euler step of Eq. 22 against that of the integrated motion from the same level: stage by "
        "stage (red: the Euler step is too small), over all stages by the time between slices, and what both make "
        "of the funnel.",
        beyond=True,
    ),
    "fragility": Product(
        "Levels of funnels with other inputs, on half of the slices: the bank angle at the same cost, the "
        "disturbance of the density and the initial set multiplied by a factor. A cross is where a funnel ends "
        "because it diverges; a mark at the right is the largest V of flights with the same inputs.",
        beyond=True,
    ),
    "proven": Product(
        "Level of the funnel of which every stage is proven for the integrated motion, over that of the funnel, "
        "which is linear between its slices, and what the proof adds to the bound of every stage.",
        beyond=True,
    ),
    "dubins_rho": Product(
        "Levels of the Dubins car without and with wind: funnels, that by the Euler step, that computed backwards, "
        "linear dynamics, which bound nothing, flights, and proven levels.",
        beyond=True,
    ),
    "nominal": Product(
        "Nominal trajectory over time, and all optima that were found for it, on meshes of so many intervals. The heat "
        "rate is limited at the nodes; in each optimum it peaks half-way between two others of them.",
        beyond=True,
    ),
}

# What the paper shows in its figures, and finds in them.
DESCRIBED = {
    "fig01": (
        "Concept drawing of a funnel for Mars entry around the nominal trajectory. The paper explains that the "
        "funnel bounds conservatively how far the closed-loop system can depart from the nominal under "
        "disturbances and model uncertainty. No result is read from it."
    ),
    "fig02": (
        "Three-dimensional invariant funnel around the nominal reference trajectory of a Dubins car. The paper "
        "shows it as an example of a funnel of the form V <= rho(t), computed with the authors' Julia package; it "
        "gives no data of the car and draws no conclusion from the shape."
    ),
    "fig03": (
        "Funnel boundary rho over the time steps of the entry, by sampled sums of squares and by Monte Carlo with "
        "10^4 trajectories. The paper sees an early peak, attributed to atmospheric entry and deceleration, and a "
        "growth towards the end, attributed to high velocity changes near the ground. It finds all Monte Carlo "
        "samples within the conservative funnel."
    ),
    "fig04": (
        "Two-dimensional slice of the state space at step k = 7, with the sampled points on the boundary B_k of "
        "the funnel, which are roots of a multivariate polynomial, and the set where the time derivative of the "
        "Lyapunov function is at most zero. The caption describes the samples on B_k as covering this set; the "
        "discussion does not return to the figure."
    ),
}


TABLES = {
    "withheld": Product(
        "What the paper needs and does not print, with the values used here. Sources of all inputs stand in the "
        "configuration. The paper gives a vehicle and a trajectory near those of the Mars Science Laboratory.",
    ),
    "optima": Product(
        "Local optima of the nominal problem on several meshes. The heat rate is limited at the nodes; in each optimum "
        "its peak lies in the middle between another pair of nodes, where it exceeds the limit.",
        beyond=True,
    ),
    "levels": Product(
        "Level rho at equally spaced slices: of the funnel, of linear dynamics in the same shape, which is no bound of "
        "the motion, and the largest V of flights that start on the first slice. The standard deviation is that of the "
        "largest V of a tenth of the flights; that of all is smaller.",
    ),
    "half_widths": Product(
        "Largest deviations of the states: in the slices, in those of linear dynamics with the same shape, in the "
        "ellipsoid of least trace around what linear dynamics reach, and, at the end, in flights.",
    ),
    "verification": Product(
        "Every stage: its program and solver; the sum of squares at fresh points; eigenvalues of the Gram matrix; and "
        "the largest value of the integrated motion that was found on the slice, under any disturbance. A positive "
        "number in the column after that: the bound of the expansion is no bound of the motion.",
        beyond=True,
    ),
    "conditions": Product(
        "Cost-to-go of the regulator, and condition numbers of the shape of the slices.", beyond=True
    ),
    "forms": Product(
        "One stage in all forms of its program: by samples and by multipliers, on the boundary of the disturbances and "
        "in their whole disc, with several solvers; below, the largest values that were found by ascent.",
        beyond=True,
    ),
    "counts": Product(
        "Monomials, rows of the Gram matrix and samples on products of spheres: slice and density (S^5 x S^1), slice, "
        "Dubins car without and with wind, and slice, density and additive disturbances together. On spheres not all "
        "monomials are independent.",
    ),
    "samples_and_bases": Product(
        "The same stage with too few samples, with the factor of Eq. 24 on the slice (y) and in scaled coordinates "
        "that are not whitened (x), where the bound depends on the samples taken, with other bases and other samples, "
        "and after changes that must not change the bound.",
        beyond=True,
    ),
    "numbers_of_slices": Product(
        "Funnels with more and fewer slices, by the integrated motion and by the Euler step of Eq. 22; and the Euler "
        "step at the levels of the motion, stage by stage.",
        beyond=True,
    ),
    "variants": Product(
        "Funnels on coarse slices: by samples, with expansions of lower order, by multipliers, backwards from the "
        "last level, and forward again from where that ends.",
        beyond=True,
    ),
    "divergence": Product(
        "Whether a funnel exists with other feedback, wider density and larger initial sets, on coarse slices. Flights "
        "stay bounded where the funnel diverges.",
        beyond=True,
    ),
    "proof": Product(
        "Levels that are proven for the integrated motion, with all that the expansion leaves out and under every "
        "disturbance of the disc, beside those of the funnel. The bound of a stage is the sum of its four parts.",
        beyond=True,
    ),
    "dubins_levels": Product(
        "Level rho of the Dubins car at the quarters of its path, by all solvers. Linear dynamics lie below the "
        "funnel: they are no bound. Differences: to the levels by samples.",
    ),
}

SUMMARIES = {
    "readings": "What each reading gives. Flights outside: at any node of the fine grid, under constant, redrawn and "
    "adversarial disturbance. In `printed` the samples are not on the slices: its certificates are sound for points "
    "that have nothing to do with the funnel, and its levels say nothing.",
}

ERRATA = (
    Erratum(
        "E1",
        "Eqs. 26 and 27: x = x~ / sqrt(x~'x~/2) lies on B_k",
        "Neither P_k nor rho_k is in it. V/rho of such points is between 1e3 and 7e7, in km and rad as in m and rad. "
        "As the points do not depend on rho_k either, rho_{k+1} does not depend on it: a first level ten times as "
        "large leaves all others as they are.",
        "xb = sqrt(2 rho_k) L_k^-T y with P_k = L_k L_k' and y on the unit sphere; `printed` keeps Eq. 26",
    ),
    Erratum(
        "E2",
        "Eq. 34: w = w~ / sqrt(w~'W w~/2)",
        "W is a set, Eq. 28; its matrix is U.",
        "U; w is scaled so that W is the unit disc",
    ),
    Erratum(
        "E3",
        "Eqs. 19 and 25: rho_k^n / det(P_k), the volume of a slice",
        "The volume of {x'Px/2 <= rho} is c_n (2 rho)^(n/2) / sqrt(det P): what is printed is its square, up to a "
        "constant. Both grow with rho_k.",
        "the recursion, which it does not touch; logarithms of the volume itself are reported",
    ),
    Erratum(
        "E4",
        "Eq. 22 and App. A: rho_{k+1} from the rate of V at t_k",
        "A forward Euler step: of V after the step it leaves out dt^2/2 f'P_{k+1} f + dt f'(P_{k+1} - P_k) xb. At "
        "equal rho_k its bound is below that of the integrated motion in about a third of the 60 stages, by up to 0.6 "
        "%, and above it by up to 4 % in others.",
        "V of the integrated motion at the next slice; `euler` and `printed` keep Eq. 22",
    ),
    Erratum(
        "E5",
        "Eq. 24 and Sec. 4: (x'x)^d D = n'Q n with d = 1 and 45 rows",
        "45 rows have degree 4 on the right. An expansion of third order makes D of degree 4, so that d = 1 makes 6 on "
        "the left; d = 1 fits linear motion only. On the slice, in whitened coordinates, (y'y)^d is one. In scaled "
        "coordinates that are not whitened the samples no longer determine the equation: the bound of one stage, "
        "1.163, becomes 1.8 to 90 with d = 1, as the samples fall, and hundreds to thousands with d = 2.",
        "whitened coordinates, d = 0",
    ),
    Erratum(
        "E6",
        "Eqs. 31 to 35: disturbances sampled on the boundary of W or where dV'/dw = 0",
        "The second set is not cut with W. The density acts by its logarithm alone, in which the rates are monotonic: "
        "for the equations it is empty. Newton's method on their expansion ends outside of W, mostly at hundreds of "
        "its radii, where the polynomial asks for almost three times the level. No disturbance inside of W was worse "
        "than the worst on its boundary.",
        "the boundary of W; the multiplier form and the proven levels hold for all of W",
    ),
    Erratum(
        "E7",
        "Sec. 4: additive disturbances in all components, and 45 rows",
        "Six states, two parameters of the density and six additive disturbances are 14 variables, with C(16, 2) = 120 "
        "monomials up to degree 2; 45 = C(10, 2) leaves room for two disturbances.",
        "two parameters of the density in the programs; `additive` adds the others by the triangle inequality",
    ),
    Erratum(
        "E8",
        "Sec. 4: Q_k has 45 rows; Sec. 3: the least number of samples",
        "On the product of two spheres y'y = 1 and w'w = 1 leave 43 of 45 monomials independent: Q is not unique. The "
        "products of the 43 have rank 406, the number of samples needed; without disturbance 27 and 182. With fewer "
        "samples the program is solved as well, and its bound is too small: one stage of 1.163 has 1.11 from 350.",
        "43 rows and 406 samples",
    ),
    Erratum(
        "E9",
        "Eq. 20: M_1 - P_1/rho_1 positive semidefinite",
        "Right if S_1 = {xb'M_1 xb/2 <= 1}, which is not said; as it stands not linear in rho_1.",
        "rho_1 = largest eigenvalue of M_1^-1/2 P_1 M_1^-1/2, 0.17925",
    ),
    Erratum("E10", "Eq. 13: x(0) in M_1", "M_1 is a matrix.", "the set S_1"),
    Erratum("E11", "Eq. 30: V(t) = {...}", "Eq. 29 calls this set B(t).", "B(t)"),
    Erratum(
        "E12",
        "Eq. 2: positive semidefinite matrices of dimension k",
        "A polynomial of degree 2k in n variables has C(n + k, k) monomials of half its degree: 45 for n = 8, k = 2.",
        "C(n + k, k)",
    ),
    Erratum(
        "E13",
        "Apps. A and B: f(x, K x); P_k xb inside and outside of the derivative",
        "The feedback acts on the deviation: f(x, u* + K xb). In App. B the factor P_k xb stands twice in two lines, "
        "and a bracket is misplaced; the last line, Eq. 35, agrees with differences.",
        "f(x, u* + K xb), and Eq. 35",
    ),
    Erratum(
        "E14",
        "Sec. 4: d in Eq. 23; after Eq. 22: K_k by iLQR",
        "d stands in Eq. 24. Sec. 4 has the gain from a time-varying linear-quadratic regulator.",
        "Eq. 24; the regulator",
    ),
    Erratum(
        "E15",
        "Eq. 37: C_gamma and C_psi are Coriolis terms",
        "They are not written out, and the rotation of the planet also changes V. With all of its terms the rates "
        "agree with inertial motion under gravity, lift and drag, if psi is counter-clockwise from east and a positive "
        "bank angle turns to the right.",
        "Eq. 37 with all terms of rotation",
    ),
    Erratum(
        "E16",
        "Eq. 29 and Sec. 3: the condition holds on B_k, slices are joined by interpolation",
        "It says nothing of times between slices, nor of disturbances that change within a step.",
        "the motion on the fine steps between slices; flights are checked at every fine step, and levels proven there",
    ),
    Erratum(
        "E17",
        "Sec. 2: dynamics expanded to the desired degree",
        "With third order motion was found beyond the bound of the polynomial in nearly all of the stages, by up to "
        "0.257 %, mostly near the end.",
        "third order; `inflated` raises levels to what was found, and the proven levels add a bound of the remainder",
    ),
    Erratum(
        "E18",
        "Sec. 4: a bilinear exponential density model",
        "Not defined; parameters times the state in an exponent, with two of them, agree with 45 rows.",
        "ln rho = (a + 0.05 w_1) + (b + 0.001 w_2 / km) h, w in the unit disc",
    ),
    Erratum(
        "E19",
        "Eqs. 22, 23 and 29: strict inequalities",
        "Sums of squares give the others.",
        "at least; bounds are rounded up by what residuals and rounding may change",
    ),
    Erratum(
        "E20",
        "Sec. 5: Monte Carlo, usually of Gaussian distributions",
        "The law of its flights is not given.",
        "starts uniform on the first slice, disturbances uniform on the circle and constant; redrawn and greedy ones "
        "besides",
    ),
    Erratum(
        "E21",
        "Sec. 3: sampling prevents a global solution",
        "It does, but nothing is lost: with P_k given, a stage from a higher level reaches a higher one, so that one "
        "stage after the other has the least sum too. For the same reason the backward step is the search of a root.",
        "one stage after the other; backwards by a search",
    ),
    Erratum(
        "E22",
        "Sec. 4: an optimal reference trajectory",
        "The problem used here has at least four local optima, with integrals of the squared bank rate of 10.2, 14.2, "
        "35.9 and 112.6 deg^2/s and final times of 234.0 to 259.1 s. They come from the heat limit: it is active "
        "at two neighbouring nodes, another pair in each, and finer meshes have more of them.",
        "the one that a guess of constant bank leads to, 241.7 s; `best_nominal` takes the first",
    ),
    Erratum(
        "E23",
        "Sec. 4: the trajectory optimisation ensures thermal constraints",
        "At nodes: 61.00 W/cm^2 there, 61.17 W/cm^2 between them.",
        "both are reported",
    ),
)

PAPER = Paper(
    slug="funnels",
    title="Robust Entry Vehicle Guidance with Sampling-Based Invariant Funnels",
    authors="R. Derollez, S. Le Cleac'h, Z. Manchester",
    citation="Stanford University and Carnegie Mellon University; no year or venue on the copy used",
    figures=FIGURES,
    described=DESCRIBED,
    closeups=("funnel",),
    tables=TABLES,
    summaries=SUMMARIES,
    errata=ERRATA,
    noise=(
        *("*/funnel/gap", "*/funnel/tightness", "*/dubins/gap"),  # what is left where a solver ends
        # Programs that the samples do not determine, and stationary points of polynomials far outside of their range.
        *("corrected/stage_study/exponent_*", "corrected/stage_study/stationary_*"),
        # Differences of solvers of first order, and searches that end within a tolerance.
        *("corrected/coarse_funnels/multiplier_difference", "corrected/coarse_funnels/second_difference"),
        *("corrected/coarse_funnels/round_trip*", "corrected/coarse_funnels/backward_programs"),
        *("corrected/dubins_study/multiplier_difference", "corrected/dubins_study/backward_*"),
        "corrected/dubins_study/round_trip",
        "corrected/optima/start*",  # which optimum a start leads to
    ),
    measured=True,
)
