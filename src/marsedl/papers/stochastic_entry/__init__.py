"""Ridderhof, Tsiotras and Johnson: stochastic entry guidance."""

from marsedl.replication.catalogue import Erratum, Paper, Product

FIGURES = {
    "fig01": Product(
        "Rear view of the vehicle: the lift vector rolled by the bank angle from the local vertical, with its two "
        "components. A sketch, not drawn from data.",
    ),
    "fig02": Product(
        "Samples of the relative density variation. Left: the process of Eq. 8 with the diffusion of Eq. 11, whose "
        "deviation is some per cent above the one aimed at. Right: a surrogate of Mars-GRAM samples, a process of the "
        "same correlation with exactly the variance aimed at; Mars-GRAM itself was not at hand, so the likeness that "
        "the paper finds is not tested here.",
    ),
    "fig03": Product(
        "Geometry of targeting (Appendix D), not to scale: inertial, planet-fixed and up-east-north frame, orbit plane "
        "through position and inertial velocity with its normal, angle to go and crossrange angle of the target.",
    ),
    "fig04": Product(
        "Density variations of the first Monte Carlo trials, the very ones that they fly through in every case: a "
        "surrogate of Mars-GRAM samples, not Mars-GRAM.",
    ),
    "fig05": Product(
        "Crossrange of the nominal flight, the deadband as long as it rules, and the commands to reverse the bank. The "
        "dotted line is the start of the heading alignment.",
    ),
    "fig06": Product(
        "Flown bank angle of the nominal flight with its reversals, which roll through lift up, and dynamic pressure."
    ),
    "fig07": Product("Nominal flight to 500 m/s. The dotted line is the start of the heading alignment."),
    "fig08": Product(
        "Cosine of the bank angle during range control: nominal, and three standard deviations about it by linear "
        "covariance. Apollo's gains are flown against velocity, which at its peak is no clock, so that linear theory "
        "fails there; dotted, the same gains against time.",
    ),
    "fig09": Product(
        "Errors against the nominal state at the same time, fixed final time: the first trials, mean and three "
        "standard deviations of all trials, and three standard deviations by linear covariance, which has no "
        "crossrange.",
    ),
    "fig10": Product("Flown bank angles of the first trials with the fixed final time, and of the nominal flight."),
    "fig11": Product(
        "As Fig. 9 for the velocity trigger. At each time, mean and standard deviations are those of the trials still "
        "flying, so the bounds bend where the first trials end, and stop with the nominal flight or too few trials.",
    ),
    "fig12": Product(
        "Last seconds of the first trials with the velocity trigger, measured from the end of the nominal flight, so "
        "that the end points are the errors of Table 4. Horizontal lines: three standard deviations at the trigger, of "
        "all trials about their mean and by linear covariance.",
    ),
    "fig13": Product(
        "Velocity and range error at the nominal final time by linear covariance, ellipses of 99.73 % probability. On "
        "the grey line the velocity trigger removes the range error (Eq. 77). Dotted: Apollo's gains against time.",
    ),
    "partition": Product(
        "Linear covariance of the stochastic law on partitions of different size. Left: standard deviation of the "
        "range error that the law minimises, and what noise after the last control leaves of it whatever the law "
        "does. Right: how much bank the law uses in its first interval, at entry.",
        beyond=True,
    ),
    "altitude_tradeoff": Product(
        "What a limit of the final altitude error costs in range, by linear covariance of the stochastic law, on the "
        "reading's partition and on one of 10 s. Missing points have no feasible law.",
        beyond=True,
    ),
    "error_budget": Product(
        "Flights with one source of uncertainty at a time: its share of the range variance that all of them cause "
        "together, for both laws and without corrections. The sum of the shares is 100 % if sources add up linearly. "
        "No law can remove the part of the density below the black mark.",
        beyond=True,
    ),
    "floor": Product(
        "Standard deviation of the final range error: the part that comes after the last control and that no law "
        "removes, that of the linear model, and that of all trials with three standard errors. What flights add to "
        "the linear model is saturation, bank reversals and aerodynamic errors.",
        beyond=True,
    ),
    "reversals": Product(
        "Final range error of all trials, split by the number of bank reversals; the areas are the shares of the "
        "trials. Beyond the axes lie 0.2 % of the trials.",
        beyond=True,
    ),
}

# What the paper shows in its figures, and finds in them.
DESCRIBED = {
    "fig01": (
        "Sketch of bank angle control. Banking tilts the lift vector away from the local vertical, so that the "
        "size of the bank angle scales its vertical component. In the paper this controls the range, while the "
        "direction of bank controls the lateral motion."
    ),
    "fig02": (
        "Samples of the density variation from the Ornstein-Uhlenbeck process (left) and from MarsGRAM (right), "
        "each with dashed limits at 2 sigma. The drift coefficient is twice the inverse scale height and the "
        "diffusion is set for a desired variance profile; the paper calls the resulting variations statistically "
        "similar to those of the GRAM models."
    ),
    "fig03": (
        "Geometry of the targeting: the downrange angle lies between the position vectors of vehicle and target, "
        "and the crossrange angle is that of the target out of the plane of position and inertial velocity. The "
        "paper multiplies both by a reference radius, such as the planet's, to get distances."
    ),
    "fig04": (
        "Samples of the density variation from MarsGRAM, as used in the Monte Carlo simulation. The text does not "
        "discuss their shape; it says that their variance enters the density model for the design of the gains, "
        "while the simulated flights use the MarsGRAM samples only."
    ),
    "fig05": (
        "Crossrange of the nominal trajectory with its bank reversals and the deadband, which depends on time. "
        "The text does not discuss the curve; it says that the deadband logic sets the sign of every new bank "
        "command."
    ),
    "fig06": (
        "Nominal bank angle with its reversals, together with dynamic pressure, to show when the reversals take "
        "place. The text does not discuss it further; it gives a bank angle magnitude of 75 deg above 5.5 km/s, "
        "45 deg below 2.5 km/s and a linear ramp of the cosine in between."
    ),
    "fig07": (
        "The nominal entry trajectory, integrated with the nominal density and the nominal bank profile from 125 "
        "km altitude to a velocity of 500 m/s. The text does not discuss the plot; by design the flight ends 10 "
        "km uprange of the target."
    ),
    "fig08": (
        "Spread (3 sigma) of the cosine of the bank angle during range control by linear covariance: stochastic "
        "law for both end conditions, Apollo for fixed time only. The paper finds that the stochastic bounds stay "
        "within -1 and 1 while Apollo's at times do not, and that the stochastic law is idle just after entry, "
        "then stronger than Apollo once dynamic pressure rises."
    ),
    "fig09": (
        "Closed-loop trajectories of 20 trials with fixed final time, with 3 sigma bounds from all 1,000 trials "
        "and from linear covariance. With the stochastic law, the paper sees large deviations of altitude and "
        "flight path angle after peak dynamic pressure and a range error that shrinks from about 100 s on. It "
        "finds the bounds close for most states, least so for flight path angle."
    ),
    "fig10": (
        "Bank angle histories of Monte Carlo trials with a fixed final time. The text does not discuss the "
        "curves; it only adds that the stronger corrections of the stochastic law increase lateral dispersion, "
        "which bank reversals and heading alignment remove by the end."
    ),
    "fig11": (
        "Sample Monte Carlo trajectories that end when the velocity reaches 500 m/s. The paper calls the better "
        "range targeting of the stochastic law apparent and finds the 1st and 99th percentiles of the final range "
        "error about halved: -1.96 and 1.19 km, against -3.58 and 3.04 km with Apollo."
    ),
    "fig12": (
        "Sample Monte Carlo trajectories with their end points at the velocity trigger of 500 m/s. As for Fig. "
        "11, the paper calls the better range targeting of the stochastic law apparent, and it reports that the "
        "trigger lowers the range errors of both laws compared with a fixed final time."
    ),
    "fig13": (
        "Ellipses of 99.73 % probability for range and velocity at the final time, by linear covariance. The "
        "paper finds a negative correlation for Apollo, stronger with the velocity trigger. For the stochastic "
        "law, fixed time reduces range variance at the cost of correlation, while the trigger is expected to "
        "favour a strong one, which cuts the range error at fixed velocity."
    ),
}

TABLES = {
    "tab01": Product(
        "Table 1, from the inputs. The trim angle of attack is shown only: the aerodynamic coefficients follow from "
        "the lift-to-drag ratio and the ballistic coefficient.",
    ),
    "tab02": Product(
        "Table 2, from the inputs. The crossrange is that of the azimuth over the arc to the target (E7)."
    ),
    "tab03": Product("Table 3, from the inputs, with what replaces the Mars-GRAM samples, which are not available."),
    "tab04": Product(
        "Table 4: 1st and 99th percentiles of the final errors, from as many trials as the paper flies and from all, "
        "with standard errors (Maritz-Jarrett), the spread over independent sets of the paper's size, and the distance "
        "of the printed value in combined standard errors. Last, how the trials ended.",
    ),
    "zf": Product("Eq. 77, element by element. Where the density is fitted to it, agreement is no evidence."),
    "certificates": Product(
        "The stochastic law against independent formulations: its duality gap, a cone program, the search over LQG "
        "weights that the paper proposes, and the multipliers, which show what each final limit costs.",
        beyond=True,
    ),
    "sources": Product(
        "Standard deviation of the final range error from each source of uncertainty alone, over flights with the same "
        "random numbers, with its share of the variance from all sources; last, the floor that no law can remove.",
        beyond=True,
    ),
    "reversal_split": Product("Final range error by the number of bank reversals.", beyond=True),
}

SUMMARIES = {
    "readings": "What each reading reproduces: percentiles of the final range error beside the paper's, the nominal "
    "end, the column of Z_f and the number of bank reversals. Hypotheses say nothing of what the authors did.",
    "headline": "The headline in each reading: how much narrower the stochastic law makes the interval from the 1st to "
    "the 99th percentile of the final range error, and whether either percentile is halved.",
}

ERRATA = (
    Erratum(
        "E1",
        "Eq. 1f: signs of the three terms without lift",
        "Eqs. 1b and 1c measure the azimuth clockwise from north, for which these signs are reversed. In vacuum the "
        "inertial energy and angular momentum must stay constant: from 17 deg of latitude, azimuth 60 deg, the "
        "printed form changes them by 1.0 % and 8.4 % in 80 s, the reversed one by rounding only.",
        "the three signs reversed",
    ),
    Erratum(
        "E2",
        "Eq. 33: derivative with respect to the vehicle's state alone",
        "A 5 x 4 matrix cannot multiply the five states of Eq. 30.",
        "derivative with respect to vehicle's state and density, 5 x 5, in every reading",
    ),
    Erratum(
        "E3",
        "Eq. 55a: K = -(B'SB + R) B'SA",
        "The parenthesis has the unit of a cost, so the printed gain has that of a squared cost per state. Eq. 55b "
        "holds for the minimizing gain, which has the inverse. In SI units the printed recursion overflows.",
        "K = -(B'SB + R)^-1 B'SA, and Eq. 55b in the Joseph form, equal but stable",
    ),
    Erratum(
        "E4",
        "Eqs. 63 and 64: the last factor is the nominal state",
        "It must be the deviation from it: else the mean stopping time is -beta/(nu'f) = 149 s after t_f with the "
        "velocity rate in Eq. 77, while the text says t_f.",
        "the deviation; Z_f of Eq. 65 is right as printed",
    ),
    Erratum(
        "E5",
        "Eq. 58: sigma = K_ha arctan(delta_go/epsilon)",
        "Eq. 57 answers a positive crossrange with a negative bank angle; Eq. 58 does the opposite. With the ratio "
        "upside down, any crossrange below the range to go gives over 45 deg, times 50: the command is always at its "
        "limit. The printed law leaves about 6 km of crossrange; with the sign alone mended it is nulled, but by "
        "switching between the limits.",
        "sigma = -K_ha arctan(epsilon/delta_go), limited; `printed_heading` keeps Eq. 58, `printed_heading_sign` "
        "mends the sign only",
    ),
    Erratum(
        "E6",
        "Eq. 71: condition of the second case, and the previous command as base",
        "The second condition is the first one again, so a falling bank angle is never limited. Counted from the "
        "previous command, a rise of 60 deg is flown as 15 deg in the first second and 45 deg in the next.",
        "both directions limited, counted from the bank angle flown before",
    ),
    Erratum(
        "E7",
        "Table 2: crossrange 0.57 km; Eq. 70: latitude 0",
        "The crossrange is no latitude: 0.05 deg of azimuth over the arc of 11.027 deg, 653.8 km at a radius of 3,397"
        " km, make 0.57 km. This takes the velocity relative to the planet; Appendix D takes the inertial one, which "
        "gives 0.54 km.",
        "mean latitude 0; the dispersion of 0.5 km on the latitude",
    ),
    Erratum(
        "E8",
        "Sec. V and Table 3: errors of 0.15 in C_L and 0.02 in C_D",
        "Table 1 gives C_L = 0.358, of which 0.15 is 42 %; a lift proportional to the angle of attack changes by "
        "0.023 in 1 deg. With 0.15 the 1st percentiles of range are tens of kilometres instead of the 2 to 8 km of "
        "Table 4. The signs are not printed; a capsule that trims at a larger angle gains lift and loses drag.",
        "0.015 in C_L with the opposite 0.02 in C_D; `printed_aero` keeps 0.15",
    ),
    Erratum(
        "E9",
        "variance of density not printed; in the authors' aerocapture paper (Eqs. 73-74) at most 1480 (kg/m^3)^2, and"
        " decreasing upwards",
        "The variation is relative (Eq. 5), so its variance has no unit, and 1480 would be 38 times the mean density;"
        " in squared per cent it is 0.148, or 38 %. With the printed sign of the exponent the value at 120 km is the "
        "least, not the largest as that paper says.",
        "0.148 exp((h - 120 km)/20 km), constant above 120 km",
    ),
    Erratum(
        "E10",
        "Eq. 11: noise intensity 4 zeta_d/H",
        "Meets the profile only if that is constant. For a variance that falls downwards as exp(-s/20 km) the process"
        " settles at 1/(1 - H/80 km) of it: 5 to 7 % too much standard deviation for scale heights of 8 to 10 km.",
        "Eq. 11 for the design, as the paper; the density samples have the exact variance",
    ),
    Erratum(
        "E11",
        "Eq. 72: a_f and R_k without units",
        "In metres the whole cost of bank corrections at their limit of 0.45 equals that of 0.2 micrometres of range "
        "deviation, in units of the planet radius that of 0.8 m. Over many decades the result does not depend on it.",
        "range in units of the planet radius; metres in `printed`",
    ),
    Erratum(
        "E12",
        "partition and number of control intervals not printed",
        "They decide the range that the fixed final time can reach: three standard deviations of 0.26 km with "
        "intervals of 1 s, but 1.0 km with 10 s and 1.5 km with 12 s, in the linear covariance model.",
        "1 s, the period of the bank commands; `partition_24` and `partition_20` are hypotheses",
    ),
    Erratum(
        "E13",
        "Apollo gains as functions of velocity",
        "The nominal velocity is no clock at first: at entry gravity along the path (+0.92 m/s^2) exceeds the drag, "
        "so the velocity rises before it falls.",
        "the branch after the largest velocity; no correction while drag is below 0.5 m/s^2",
    ),
    Erratum(
        "E14",
        "Sec. III.B: state feedback in Eq. 50, but range, drag and climb rate in practice",
        "Not said which form was flown, nor whether the gains know the density: the original derivation has no such "
        "state, the matrices referred to have it.",
        "all five states; `drag_form` and `density_blind` are hypotheses",
    ),
    Erratum(
        "E15",
        "linear covariance of the Apollo law",
        "Gains looked up at the current velocity answer the deviation at equal velocity, not at equal time, which is "
        "what Eq. 42 takes. For gains at equal time the model correlates final range and velocity positively; the "
        "paper finds, and the law as flown has, a negative correlation.",
        "equivalent gains in time; those of Eq. 50 beside them as a second curve",
    ),
    Erratum(
        "E16",
        "Eq. 50: division by theta_u",
        "Eq. 49 makes theta_u zero as long as control has no effect, hence in all of heading alignment, and the gain "
        "grows without bound towards its start.",
        "the bank cosine limited to [-1, 1]",
    ),
    Erratum(
        "E17",
        "fixed final time and commands each second",
        "The nominal reaches 500 m/s between two commands.",
        "a shorter last control interval and integration step",
    ),
    Erratum(
        "E18",
        "stochastic law after the nominal start of heading alignment",
        "Its gains are indexed by time and zero from then on, but a trial that is still faster than 1.1 km/s is still"
        " in range control: its command is not defined.",
        "the nominal bank cosine, cos 45 deg",
    ),
    Erratum(
        "E19",
        "Eq. 20: no climbing",
        "The nominal itself climbs for a while after the peak of dynamic pressure, and the square root of a negative "
        "sink rate in Eq. 24 does not exist.",
        "no noise while climbing; the drift keeps the sink rate with its sign",
    ),
    Erratum(
        "E20",
        "Eq. 27d: range rate V cos(gamma); Appendix D: angle times radius of the planet",
        "The two differ by the factor r/r_p, 3.7 % at entry.",
        "reference and errors from Appendix D, linear model from Eq. 27d",
    ),
    Erratum(
        "E21",
        "Table 4: sign of the downrange error not defined",
        "The percentiles are not symmetric, so the sign matters.",
        "positive is too far",
    ),
    Erratum(
        "E22",
        "Sec. V: nominal states with bank reversals, nominal control without",
        "A reversal at 45 to 75 deg of bank rolls through full lift for 6 to 10 s, so the bank cosine of the linear "
        "model is not the one that flew its reference.",
        "as the text says; in heading alignment, where no cosine is prescribed, the one flown",
    ),
)


PAPER = Paper(
    slug="stochastic_entry",
    title="Stochastic Entry Guidance",
    authors="Jack Ridderhof, Panagiotis Tsiotras and Breanna J. Johnson",
    citation="J. Ridderhof, P. Tsiotras, B. J. Johnson, Stochastic Entry Guidance, 2021",
    figures=FIGURES,
    described=DESCRIBED,
    tables=TABLES,
    summaries=SUMMARIES,
    errata=ERRATA,
)
