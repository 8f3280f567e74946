"""Sec. 2: sums of squares, and the Dubins car."""

import numpy as np

from marsedl.papers.funnels.basics import BASIS_DEGREE, SPHERES
from marsedl.papers.funnels.claims.measures import largest
from marsedl.papers.funnels.inputs import Recursion
from marsedl.papers.funnels.records import Dubins, FlightEnsemble, Funnel
from marsedl.replication.claims.counterexamples import replaced
from marsedl.replication.claims.thresholds import CLOSE
from marsedl.replication.claims.writing import Fails, check, claim, holds, measure


@claim(errata="E12")
def gram_dimension_eq2():
    rows = len(SPHERES.monomials(BASIS_DEGREE))
    return holds(
        measure(f"monomials of half the degree in {SPHERES.variables} variables", rows) <= BASIS_DEGREE,
        rows=rows,
        degree=BASIS_DEGREE,
        variables=SPHERES.variables,
        by_construction="a number of monomials, which no record can change",
    )


@claim(
    "Motion passes the bound of its expansion in {stages} stages, by up to {violation:.2f} %.",
    errata="E17",
    choices="taylor_order slices",
    counterexample=replaced("funnel.violation", 0.06),
)
def taylor_for_nonpolynomial(recursion: Recursion, funnel: Funnel):
    # The paper has D "approximated" by a polynomial.
    violation, order = largest(funnel.violation), recursion.taylor_order
    if np.isnan(violation):
        raise Fails("the expansion was not compared with the motion: its samples lie on no slice")
    subject = f"largest value of the integrated motion above the bound of the polynomial of order {order}"
    return holds(
        measure(f"{subject}, relative", violation) < CLOSE,
        violation=100.0 * violation,
        stages=int((funnel.violation > 0.0).sum()),
    )


@claim(
    "The paper prints no input of the car.",
    choices="taylor_order",
    counterexample=replaced("dubins_wind.outside_at_slices", 1),
)
def dubins_funnel(dubins: Dubins, dubins_calm: FlightEnsemble, dubins_wind: FlightEnsemble):
    parts = [
        measure(f"runs of {len(run.outcome):,} {name} that leave the funnel", run.outside_at_slices + run.excluded) < 1
        for name, run in (("without wind", dubins_calm), ("with wind", dubins_wind))
    ]
    return holds(
        check("the programs of all stages are sound", dubins.sound),
        *parts,
    )
