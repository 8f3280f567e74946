"""Sec. 4: the nominal trajectory, Fig. 1."""

from marsedl.papers.desensitized.inputs import Solver, Vehicle
from marsedl.papers.desensitized.records import Nominal
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.claims.writing import claim, holds, listed, measure, measured
from marsedl.replication.units import DEGREE


@claim()
def node_count(solver: Solver):
    return measured(solver.intervals + 1)


@claim(
    "The paper describes this local minimum; the one with one reversal has less control energy.",
    errata="E6",
)
def nodoc_two_reversals(nominal: Nominal):
    evidence = f"the bank angle passes zero at {listed(nominal.reversal_times, '.1f')} s"
    why = "we refuse a nominal with other reversals than solver.nominal_reversals"
    return measured(nominal.reversals, evidence=evidence, by_construction=why)


@claim(by_construction="the solver keeps to the bound")
def nodoc_rate_within_bounds(vehicle: Vehicle, nominal: Nominal):
    rate, bound = nominal.largest_bank_rate / DEGREE, vehicle.bank_rate_bound / DEGREE
    return holds(measure("largest bank rate", rate, "deg/s") <= bound * (1.0 + ROUNDING))


@claim(by_construction="the solver keeps to the bound")
def nodoc_accel_within_bounds(vehicle: Vehicle, nominal: Nominal):
    acceleration, bound = nominal.largest_bank_acceleration / DEGREE, vehicle.bank_acceleration_bound / DEGREE
    return holds(measure("largest bank acceleration", acceleration, "deg/s^2") <= bound * (1.0 + ROUNDING))
