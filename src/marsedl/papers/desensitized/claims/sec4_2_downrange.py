"""Sec. 4.2: downrange errors, Figs. 6 to 8."""

import numpy as np

from marsedl.methods.sensitivity import propagate_columns
from marsedl.papers.desensitized.claims.measures import (
    CROSSRANGE,
    DOWNRANGE,
    EXACT,
    GAINS,
    LAW_OF,
    PLAIN,
    RADIUS,
    DownrangeFlight,
    more_for_small_errors,
    needs_feedback,
    phase_times,
    remaining,
    significantly_reduced,
    size,
    ways,
)
from marsedl.papers.desensitized.entry_problem import BANK, STATES, gain_vector
from marsedl.papers.desensitized.inputs import Design, Planet
from marsedl.papers.desensitized.linearization import position_columns, position_rows, transitions
from marsedl.papers.desensitized.records import Certificates, Gains, Linearization, Responses
from marsedl.replication.claiming import claim, holds, listed, measure, measured
from marsedl.replication.counterexamples import replaced, scaled, shifted
from marsedl.replication.thresholds import MUCH, ROUNDING, VISIBLE

LONGITUDE = STATES.index("longitude")
LAW = LAW_OF[DOWNRANGE]
FIRST, SECOND = 130.0, 200.0  # s, as the text has the phases of Fig. 7b


# ---- the longitude's column ------------------------------------------------------------------------------------------


@claim(by_construction="no rate of Eqs. 1 and 2 has the longitude in it")
def dfdy_third_column_zero(linearization: Linearization):
    column = np.abs(linearization.state_matrix[..., LONGITUDE])
    return holds(measure("largest entry of that column along the nominal", column.max()) <= 0.0)


@claim(
    "The paper leaves out the eighth entry, which is zero as well.",
    errata="E9",
    by_construction="no rate of Eqs. 1 and 2 has the longitude in it",
)
def dr_column_e3(planet: Planet, linearization: Linearization):
    column = linearization.sensitivity[:, :, DOWNRANGE] * planet.planet_radius
    departed = np.abs(column - np.eye(len(STATES))[LONGITUDE]).max()
    return measured(
        column[-1, :7],
        evidence=f"and {column[-1, 7]:g}, the bank rate's; over all nodes the column departs from the unit vector "
        f"by {departed:.1g}",
    )


@claim(by_construction="no rate of Eqs. 1 and 2 has the longitude in it")
def dr_column_independent_of_scheme_and_shape(certificates: Certificates):
    by_scheme = np.nanmax(certificates.mesh_longitude_deviation, axis=(0, 2))
    return holds(
        measure(f"departure of the column from the unit vector, by {', '.join(certificates.scheme)}", by_scheme)
        < EXACT,
        measure(
            f"over the {len(certificates.row_longitude_deviation)} nominals of the rows of Table 3",
            certificates.row_longitude_deviation,
        )
        < EXACT,
    )


@claim(withheld=GAINS, counterexample=replaced("gains.scaled_gain", 0.0, at=(LAW, LONGITUDE)))
def dr_gain_on_longitude_nonzero(planet: Planet, design: Design, linearization: Linearization, gains: Gains):
    # The downrange column under the gains of its law, and without the one on the longitude.
    scaled = gains.scaled_gain[LAW_OF[DOWNRANGE]]
    columns = position_columns(planet)[:, [DOWNRANGE]]
    with_all, without_one = (
        propagate_columns(transitions(linearization, gain_vector(planet, design, scaled_gain)), columns)[:, :, 0]
        for scaled_gain in (scaled, np.where(np.arange(len(scaled)) == LONGITUDE, 0.0, scaled))
    )
    final = size(position_rows(planet) @ with_all[-1])
    departed = np.abs((without_one - columns[:, 0]) * planet.planet_radius).max()
    return holds(
        measure("departure of the column from the unit vector without the gain on the longitude", departed) < EXACT,
        measure("change of the final position error over downrange error by the gains, from 1", abs(final - 1.0))
        > ROUNDING,
    )


# ---- Fig. 6 ----------------------------------------------------------------------------------------------------------


@claim(by_construction="a flight that begins further east is the same flight further east")
def dr_sensitivity_nodoc(responses: Responses):
    error = abs(responses.compared_error[0])
    sensitivity = size(responses.tabulated_error[PLAIN, DOWNRANGE, 0]) / error
    return measured(sensitivity, evidence=f"flown with {error:g} m of downrange error")


@claim(counterexample=replaced("gains.final", 1.0, at=(LAW, DOWNRANGE, DOWNRANGE)))
def dr_needs_feedback(linearization: Linearization, gains: Gains):
    return needs_feedback(linearization, gains, DOWNRANGE)


@claim(withheld=GAINS, counterexample=scaled("responses.narrow_error", at=(LAW, DOWNRANGE)))
def fig06_feedback_significantly_reduced(flight: DownrangeFlight, gains: Gains, responses: Responses):
    return significantly_reduced(flight, gains, responses, DOWNRANGE)


@claim(
    "The smallest gains leave {left:.1f} %, tuned ones {feedback_tuned[left]:.1f} %.",
    errata="E13",
    withheld=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(LAW, DOWNRANGE)),
)
def fig06_1000m_more_than_halved(flight: DownrangeFlight, responses: Responses):
    remaining_share = 100 * remaining(responses, DOWNRANGE)
    subject = f"share that feedback leaves of {ways(responses)} m of downrange error"
    return flight.holds(
        measure(subject, remaining_share, "%") < 50,
        f"{listed(remaining_share, '.1f')} %",
        left=remaining_share[0],
    )


@claim(withheld=GAINS, counterexample=scaled("responses.tabulated_error", at=(LAW, DOWNRANGE)))
def fig06b_reduction_larger_for_small_errors(flight: DownrangeFlight, responses: Responses):
    return more_for_small_errors(flight, responses, DOWNRANGE)


# ---- Figs. 7 and 8 ---------------------------------------------------------------------------------------------------


@claim(by_construction="a flight that begins further east is the same flight further east")
def fig08_nofeedback_final_errors(flight: DownrangeFlight, responses: Responses):
    evidence = f"after {flight.entry_error:g} m of downrange error"
    return measured(responses.error[PLAIN, DOWNRANGE, -1], evidence=evidence)


@claim(errata="E13", withheld=GAINS)
def fig07b_phase_times(flight: DownrangeFlight):
    return phase_times(flight)


@claim(withheld=GAINS, counterexample=shifted("responses.state", at=(LAW, DOWNRANGE, ..., BANK)))
def fig07b_phase1_more_reversed(flight: DownrangeFlight):
    return flight.holds(flight.departs(-1, 0.0, FIRST), f"it is until {flight.first_change:.1f} s")


@claim(withheld=GAINS, counterexample=shifted("responses.state", at=(LAW, DOWNRANGE, ..., BANK)))
def fig07b_phase2_more_positive(flight: DownrangeFlight):
    crossrange = np.abs(flight.error[:, CROSSRANGE]).max()
    return flight.holds(
        flight.departs(1, FIRST, flight.end),
        measure("crossrange error at the end", abs(flight.at(flight.end)[CROSSRANGE]), "m") < MUCH * crossrange,
        f"it is up to {crossrange:.0f} m",
    )


@claim(withheld=GAINS, counterexample=shifted("responses.state", at=(LAW, DOWNRANGE, ..., BANK)))
def fig07b_phase3_smaller_bank(flight: DownrangeFlight):
    late, last = flight.at(SECOND), flight.at(flight.end)
    lift = 100 * flight.more_lift(SECOND, flight.end)
    return flight.holds(
        flight.departs(1, SECOND, flight.end, side=-1),
        measure("excess of the mean vertical lift, of all lift", lift, "%") > 0.0,
        measure("radius error at the end", abs(last[RADIUS]), "m") < MUCH * abs(late[RADIUS]),
        f"it is {late[RADIUS]:.0f} m at {SECOND:g} s",
    )


@claim(withheld=GAINS, counterexample=scaled("responses.error", at=(LAW, DOWNRANGE, ..., CROSSRANGE)))
def fig08_crossrange_excursion_smaller_radius(flight: DownrangeFlight):
    start, early = flight.at(0.0), flight.at(FIRST)
    return flight.holds(
        measure(f"crossrange at {FIRST:g} s, further out than the nominal", flight.outward(FIRST), "m")
        >= VISIBLE * flight.entry_error,
        measure("radius error", early[RADIUS], "m") < 0.0,
        measure("excess of the mean drag until then", 100 * flight.more_drag(0.0, FIRST), "%") > 0.0,
        measure("downrange error", early[DOWNRANGE], "m") < (1.0 - VISIBLE) * start[DOWNRANGE],
    )
