"""Secs. V.B.2 and V.B.3: the aerocapture vehicle, its nominal flight, the density and the program."""

import numpy as np

from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.papers.random_field import environment
from marsedl.papers.random_field.claims.measures import OPEN, Laws
from marsedl.papers.random_field.curves import peak
from marsedl.papers.random_field.flight_statistics import LEVEL
from marsedl.papers.random_field.inputs import Air, Guidance, Inputs, Mission, Vehicle
from marsedl.papers.random_field.records import LOW_ALTITUDE, VARIANTS, Convergence, Gains, Nominal
from marsedl.replication.claims.counterexamples import replaced, shifted, spread
from marsedl.replication.claims.thresholds import CLOSE, NEGLIGIBLE, ROUNDING
from marsedl.replication.claims.writing import claim, holds, listed, measure, measured

STATED_TAIL = 0.1  # p_f of the sentence behind Eq. 76, whatever the reading takes
COMPARED_ALTITUDES = np.array([60e3, 80e3, 100e3, 120e3])  # m, at which E1 compares the deviation with Mars-GRAM 2010
HIT = 2.5e-3  # planet radii; the last digit of the printed entry angle moves the apoapsis by about as much


# ---- inputs ----------------------------------------------------------------------------------------------------------


@claim(errata="E9")
def acap_initial_covariance(vehicle: Vehicle):
    return measured(float((vehicle.initial_deviations**2).sum()))


@claim("`corrected` takes it as per cent squared.", errata="E2")
def acap_sigma2_max(air: Air):
    return measured(air.variance_at_top)


@claim(errata="E3")
def acap_final_time(mission: Mission):
    return measured(mission.final_time)


@claim("No design can be made on a partition that does not increase.", errata="E3")
def acap_partition(mission: Mission):
    partition = [float(node) for node in mission.partition]
    return measured([*partition[:3], *partition[-3:]], evidence=f"{len(partition)} nodes")


@claim()
def acap_cost_percentile():
    return measured(100.0 * LEVEL, evidence="reported; for that which the design makes small see acap_p_f")


@claim("`corrected` takes {value:g}.", errata="E4")
def acap_p_f(guidance: Guidance):
    return measured(guidance.percentile_tail)


@claim("`corrected` takes J_2 in km/s.", errata="E6", choices="percentile_unit")
def acap_weights(guidance: Guidance):
    weights = guidance.control_variance_weight, guidance.mean_control_weight, guidance.percentile_weight
    return measured(list(map(float, weights)))


@claim(errata="E13")
def acap_trust_apoapsis(guidance: Guidance):
    return measured(guidance.apoapsis_trust)


@claim()
def acap_trust_state_intermediate():
    return measured(0.0, evidence="the program limits the change of the final state alone")


# ---- nominal flight and density --------------------------------------------------------------------------------------


@claim(
    "The daily mean of the same MarsGRAM output gives {marsgram_daily_mean.value:.4f} deg.",
    errata="E5",
    choices="mean_density",
    counterexample=replaced("nominal.entry_flight_path_angle", float(np.radians(-10.0128))),
)
def acap_entry_fpa(vehicle: Vehicle, nominal: Nominal):
    lowest = nominal.lowest_altitude / 1e3
    return measured(
        float(np.degrees(nominal.entry_flight_path_angle)),
        evidence=f"exit apoapsis {nominal.apoapsis:.5f} r_p, lowest altitude {lowest:.2f} km",
        by_construction="the angle is an input of this reading" if vehicle.entry_angle == "given" else "",
        lowest=lowest,
        final=nominal.altitude[-1] / 1e3,
    )


@claim(
    "The printed angle in the stand-in density leads to {angle_printed.apoapsis:.2f} r_p.",
    errata="E5",
    choices="mean_density entry_angle",
)
def acap_guess_hits_target(vehicle: Vehicle, mission: Mission, nominal: Nominal):
    angle = np.degrees(nominal.entry_flight_path_angle)
    miss = abs(nominal.apoapsis - mission.target_apoapsis)
    return holds(
        measure("distance of the exit apoapsis from the target, without control", miss, "r_p") < HIT,
        f"it is {nominal.apoapsis:.5f} r_p, from an entry angle of {angle:.4f} deg",
        by_construction="the entry angle is solved for it" if vehicle.entry_angle == "solved" else "",
        apoapsis=nominal.apoapsis,
    )


@claim(
    "On the nominal of the last law it is {last:.1f} s.",
    errata="E5",
    choices="mean_density",
    counterexample=shifted("nominal.time_of_largest_dynamic_pressure"),
)
def acap_time_max_q(nominal: Nominal, gains: Gains):
    time, last = nominal.time_of_largest_dynamic_pressure, peak(gains.time, gains.dynamic_pressure[-1])[0]
    return measured(
        time,
        evidence=f"{nominal.largest_dynamic_pressure:.0f} Pa, without control",
        last=last,
    )


@claim(
    "With the sign of Eq. 74 corrected.",
    errata="E1",
)
def acap_max_variance_above_h_trans(air: Air):
    altitude = np.linspace(0.0, air.variance_top_altitude + 1e5, 2001)
    deviation = 100 * environment.deviation(air, altitude)
    low = 100 * float(environment.deviation(air, np.array(LOW_ALTITUDE)))
    above = deviation[altitude >= air.variance_top_altitude].min()
    return holds(
        measure(
            f"largest deviation, at {altitude[np.argmax(deviation)] / 1e3:.0f} km, against that at and above "
            f"{air.variance_top_altitude / 1e3:g} km,",
            deviation.max(),
            "%",
        )
        <= above * (1.0 + ROUNDING),
        f"at {LOW_ALTITUDE / 1e3:.0f} km {low:.4g} %",
        by_construction="the sign of Eq. 74 is an input of this reading, chosen for it"
        if air.variance_growth_sign > 0
        else "",
        low=low,
        largest=deviation.max(),
        profile=100 * environment.deviation(air, COMPARED_ALTITUDES),
    )


@claim(errata="E3")
def acap_end_steps_longer(mission: Mission):
    steps = np.diff(mission.partition)
    longest = steps[1:-1].max() if len(steps) > 2 else np.nan
    are_longer = bool((steps[[0, -1]] > longest).all())
    return holds(
        measure("first and last step", steps[[0, -1]], "s") > longest,
        "the limit is the longest between them",
        by_construction="The partition is an input, and that of `corrected` is chosen for it." if are_longer else "",
    )


@claim(errata="E3", counterexample=shifted("convergence.percentile", at=(VARIANTS.index("short_end_steps"),)))
def acap_short_end_steps_no_benefit(given: Inputs, convergence: Convergence):
    # After the paper's number of iterations.
    percentile, error = convergence.percentile, convergence.percentile_error
    chosen = min(int(given.guidance.iterations), percentile.shape[1] - 1)
    (long, short), noise = percentile[:, chosen], float(np.hypot(*error[:, chosen]))
    steps = np.diff(given.mission.partition)[[0, -1]] / 2
    name = f"{100 * LEVEL:g}th percentile of delta-v"
    return holds(
        measure(
            f"reduction of the {name} by end steps of about {listed(steps, 'g')} s", long - short, "m/s", error=noise
        )
        < NEGLIGIBLE * (percentile[0, OPEN] - long),
        f"after {chosen} iterations it is {long:.1f} and {short:.1f} m/s",
        trials=given.simulation.paper_trials,
    )


@claim(
    "It is the {level:g}th percentile, without control {open_short:.0f} % below the {paper_level:g}th.",
    errata="E4",
    counterexample=spread("aerocapture.delta_v", at=(OPEN,)),
)
def acap_j2_is_p99(laws: Laws):
    # Whether the percentile that Eq. 13 defines with the stated p_f is about the one that the paper names.
    level = 1.0 - STATED_TAIL
    beyond = [np.where(np.isfinite(values), values, np.inf) for values in laws.ensemble.delta_v]
    stated_sigmas, paper_sigmas = upper_quantile(STATED_TAIL), upper_quantile(1.0 - LEVEL)
    stated = np.array([np.quantile(values, level, method="higher") for values in beyond])
    short = 1.0 - stated / laws.percentile
    subject = f"difference of the {100 * level:g}th percentile, that of p_f = {STATED_TAIL:g} in Eq. 13, from the"
    return laws.holds(
        measure(f"{subject} {100 * LEVEL:g}th, as a share of it", np.abs(short), error=laws.error / laws.percentile)
        < CLOSE,
        f"it is {listed(stated, '.0f')} m/s (open loop first), {listed(100 * short, '.1f')} % less",
        level=100 * level,
        paper_level=100 * LEVEL,
        open_short=100 * short[OPEN],
        stated_sigmas=stated_sigmas,
        paper_sigmas=paper_sigmas,
    )
