"""The reference on the fine grid and the linear model about it (robust entry funnels, Sec. 4)."""

import numpy as np

from marsedl.methods.funnels.closed_loop import reference_on_half_steps
from marsedl.methods.linearization import linearize
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Linearization, Nominal
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs, nominal: Nominal) -> Linearization:
    """Fly the nominal's bank angle on the fine grid, and linearise at every half step."""
    air = environment.disturbed_air(given.planet, given.uncertainty)
    rates = environment.entry_rates(given.planet, given.vehicle, air)
    still = np.zeros(environment.DISTURBANCES)
    time = np.linspace(0.0, nominal.time[-1], given.guidance.fine_steps + 1)
    state, control = reference_on_half_steps(
        lambda state, control: rates(None, state, control, still),
        time,
        lambda at: np.interp(at, nominal.time, nominal.bank)[:, np.newaxis],
        nominal.state[0],
    )
    model = linearize(
        lambda *arguments: rates(None, arguments[:6], arguments[6:7], arguments[7:]),
        state,
        np.hstack([control, np.broadcast_to(still, (len(state), len(still)))]),
    )
    reference_rates = np.array(np.broadcast_arrays(*rates(None, state.T, control.T, still)))
    return Linearization(
        time=time,
        half_time=np.interp(np.arange(len(state)) / 2.0, np.arange(len(time)), time),
        state=state,
        bank=control[:, 0],
        state_matrix=model.state_matrix,
        control_matrix=model.control_matrix[:, :, 0],
        disturbance_matrix=model.control_matrix[:, :, 1:],
        heat_rate=environment.heat_rate(given.vehicle, air, state[:, 0], state[:, 3]),
        deceleration=-reference_rates[3],
    )
