"""Sec. 4.2: downrange errors, Figs. 6 to 8."""

import numpy as np

from marsedl.methods.sensitivity import propagate_columns
from marsedl.papers.desensitized.claims.measures import (
    CROSSRANGE,
    DOWNRANGE,
    GAINS,
    LAW_OF,
    PLAIN,
    RADIUS,
    DownrangeFlight,
    remaining,
    size,
)
from marsedl.papers.desensitized.entry_problem import BANK, STATES, gain_vector
from marsedl.papers.desensitized.inputs import Design, Planet
from marsedl.papers.desensitized.linearization import position_columns, position_rows, transitions
from marsedl.papers.desensitized.records import CHANNELS, Gains, Linearization, Responses
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted
from marsedl.replication.claims.thresholds import MUCH, ROUNDING, VISIBLE
from marsedl.replication.claims.writing import claim, holds, listed, measure, measured

EXACT = 1e-9  # of an identity between sensitivities of order one
LONGITUDE = STATES.index("longitude")
LAW = LAW_OF[DOWNRANGE]


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
    return measured(column[-1, :7], evidence=f"over all nodes it departs from the unit vector by {departed:.1g}")


@claim(by_construction="no rate of Eqs. 1 and 2 has the longitude in it")
def dr_column_independent_of_scheme_and_shape(linearization: Linearization):
    departed = np.abs(linearization.final[:, :, DOWNRANGE] - np.eye(len(CHANNELS))[DOWNRANGE])
    return holds(measure("departure of the final column from the unit vector, rows of Table 3", departed) < EXACT)


@claim(choices=GAINS, counterexample=replaced("gains.scaled_gain", 0.0, at=(LAW, LONGITUDE)))
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
    return measured(size(responses.tabulated_error[PLAIN, DOWNRANGE, 0]) / abs(responses.compared_error[0]))


@claim(
    "The smallest gains leave {left:.1f} %, tuned ones {feedback_tuned.left:.1f} %.",
    errata="E13",
    choices=GAINS,
    counterexample=scaled("responses.tabulated_error", at=(LAW, DOWNRANGE)),
)
def fig06_1000m_more_than_halved(flight: DownrangeFlight, responses: Responses):
    left = 100 * remaining(responses, DOWNRANGE)
    subject = f"share that feedback leaves of {listed(responses.compared_error, '+g')} m of downrange error"
    return flight.holds(measure(subject, left, "%") < 50, left=left[0])


# ---- Figs. 7 and 8 ---------------------------------------------------------------------------------------------------


@claim(by_construction="a flight that begins further east is the same flight further east")
def fig08_nofeedback_final_errors(responses: Responses):
    return measured(responses.error[PLAIN, DOWNRANGE, -1])


@claim(choices=GAINS, counterexample=shifted("responses.state", at=(LAW, DOWNRANGE, ..., BANK)))
def fig07b_phase2_more_positive(flight: DownrangeFlight):
    crossrange = np.abs(flight.error[:, CROSSRANGE]).max()
    return flight.holds(
        flight.departs(1, flight.first, flight.end),
        measure("crossrange error at the end", abs(flight.at(flight.end)[CROSSRANGE]), "m") < MUCH * crossrange,
    )


@claim(choices=GAINS, counterexample=shifted("responses.state", at=(LAW, DOWNRANGE, ..., BANK)))
def fig07b_phase3_smaller_bank(flight: DownrangeFlight):
    late, last = flight.at(flight.second), flight.at(flight.end)
    lift = 100 * flight.more_lift(flight.second, flight.end)
    return flight.holds(
        flight.departs(1, flight.second, flight.end, side=-1),
        measure("excess of the mean vertical lift, of all lift", lift, "%") > 0.0,
        measure("radius error at the end", abs(last[RADIUS]), "m") < MUCH * abs(late[RADIUS]),
    )


@claim(choices=GAINS, counterexample=scaled("responses.error", at=(LAW, DOWNRANGE, ..., CROSSRANGE)))
def fig08_crossrange_excursion_smaller_radius(flight: DownrangeFlight):
    start, early = flight.at(0.0), flight.at(flight.first)
    return flight.holds(
        measure(f"crossrange at {flight.first:g} s, further out than the nominal", flight.outward(flight.first), "m")
        >= VISIBLE * flight.entry_error,
        measure("radius error", early[RADIUS], "m") < 0.0,
        measure("excess of the mean drag until then", 100 * flight.more_drag(0.0, flight.first), "%") > 0.0,
        measure("downrange error", early[DOWNRANGE], "m") < (1.0 - VISIBLE) * start[DOWNRANGE],
    )
