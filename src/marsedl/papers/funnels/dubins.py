"""Funnels of a Dubins car around a path whose turn rate is a sine (robust entry funnels, Sec. 4, Fig. 2).

Nothing about the car is printed; its inputs are the same in all readings, and they do not look at those of the entry.
"""

from functools import partial

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop, reference_on_half_steps
from marsedl.methods.funnels.recursion import FunnelError, StageRule, forward
from marsedl.methods.linearization import linearize
from marsedl.methods.sos.design import well_chosen_design
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.sos.verification import verify
from marsedl.methods.tvlqr import at_half_steps, tvlqr
from marsedl.models.dynamics.dubins_car import dubins_car_rates
from marsedl.papers.funnels.basics import BASIS_DEGREE
from marsedl.papers.funnels.funnel import solver
from marsedl.papers.funnels.inputs import Car, Recursion
from marsedl.papers.funnels.records import Dubins
from marsedl.replication.errors import SolverError
from marsedl.replication.pipeline.catalogue import stage

WIND = 2  # components
# Funnels: what a stage bounds, and whether there is wind.
FUNNELS = {"flow": ("flow", False), "euler": ("euler", False), "wind": ("flow", True)}
CHECK_POINTS = 400  # of every stage: more than the 85 polynomials of degree 4 that are independent on S^2 x S^1


# ---- the car ---------------------------------------------------------------------------------------------------------


def car_rates(speed, strongest_wind=None):
    """Motion of the car as a function of state, turn rate and wind (robust entry funnels, Fig. 2).

        x' = v cos(theta) + c w_1,   y' = v sin(theta) + c w_2,   theta' = u

    Returns:
        Function `rates(half_index, state, control, disturbance)` for `ClosedLoop`; no disturbance, no wind.
    """

    def rates(_, state, control, disturbance):
        x, y, heading = dubins_car_rates(*state, control[0], speed)
        if len(disturbance):
            x, y = (rate + strongest_wind * w for rate, w in zip((x, y), disturbance, strict=True))
        return x, y, heading

    return rates


def closed_loop(dubins: Dubins, speed, strongest_wind=None):
    """The closed loop around the path.

    Args:
        dubins: artifact.
        speed: of the car, m/s.
        strongest_wind: m/s, of a disturbance of two components, |w| <= 1; None: there is none.

    Returns:
        `ClosedLoop` of three states and the turn rate.
    """
    return _closed_loop(dubins.time, dubins.state, dubins.turn_rate, dubins.half_gain, speed, strongest_wind)


def _closed_loop(time, state, turn_rate, half_gain, speed, strongest_wind):
    return ClosedLoop(
        rates=car_rates(speed, strongest_wind),
        time=time,
        states=state,
        controls=turn_rate[:, np.newaxis],
        gains=half_gain[:, np.newaxis],
        disturbances=0 if strongest_wind is None else WIND,
    )


def spheres(wind):
    """Where the samples are: the slice, and the boundary of the wind."""
    return Spheres((3, WIND) if wind else (3,))


# ---- funnels ---------------------------------------------------------------------------------------------------------


@stage()
def compute(recursion: Recursion, car: Car) -> Dubins:
    """Follow the path, design the regulator, and propagate the level of every funnel.

    Raises SolverError where a funnel does not exist.
    """
    time = np.linspace(0.0, car.dubins_duration, car.dubins_fine_steps + 1)
    rates = car_rates(car.dubins_speed)
    frequency = 2.0 * np.pi * car.dubins_periods / car.dubins_duration
    state, control = reference_on_half_steps(
        lambda state, control: rates(None, state, control, ()),
        time,
        lambda at: car.dubins_mean_turn_rate + car.dubins_turn_rate * np.sin(frequency * at)[:, np.newaxis],
        car.dubins_start,
    )
    model = linearize(lambda *arguments: rates(None, arguments[:3], arguments[3:], ()), state, control)
    regulator = tvlqr(
        model.state_matrix[1::2],
        model.control_matrix[1::2],
        np.diff(time),
        np.diag(car.dubins_state_weight),
        np.array([[car.dubins_control_weight]]),
        np.diag(car.dubins_terminal_weight),
    )
    half_gain = at_half_steps(regulator.gains)[:, 0]
    steps = np.arange(0, len(time), car.dubins_steps_per_slice)
    designs = [well_chosen_design(spheres(wind), recursion.design_seed, BASIS_DEGREE) for _, wind in FUNNELS.values()]
    funnels = [
        _propagated(
            recursion,
            name,
            _closed_loop(time, state, control[:, 0], half_gain, car.dubins_speed, car.dubins_wind if wind else None),
            car.dubins_level,
            regulator.values[steps],
            steps,
            design,
            condition,
        )
        for (name, (condition, wind)), design in zip(FUNNELS.items(), designs, strict=True)
    ]

    return Dubins(
        time=time,
        half_time=np.interp(np.arange(len(state)) / 2.0, np.arange(len(time)), time),
        state=state,
        turn_rate=control[:, 0],
        half_gain=half_gain,
        shape=regulator.values,
        slice_step=steps,
        slice_time=time[steps],
        funnel=np.array(list(FUNNELS)),
        level=np.array([funnel.rho for funnel in funnels]),
        bound=np.array([funnel.polynomial_bound for funnel in funnels]),
        status=np.array([funnel.status for funnel in funnels]),
        sound=np.array([[check.sound for check in funnel.verifications] for funnel in funnels]),
        samples=np.array([len(design.points) for design in designs]),
        rank=np.array([design.rank for design in designs]),
    )


def _propagated(recursion: Recursion, name, loop, first_level, shapes, steps, design, condition):
    """A funnel, its stages verified."""
    rule = StageRule(
        solver=solver(recursion),
        order=recursion.taylor_order,
        condition=condition,
        verify=partial(verify, seed=recursion.design_seed + 1, points=CHECK_POINTS),
    )
    try:
        return forward(loop, shapes, steps, first_level, design, rule)
    except FunnelError as error:
        raise does_not_exist(f"funnel '{name}'", error) from error


def does_not_exist(what, error):
    """The error of a funnel or proof that there is none of, and the remedy."""
    return SolverError(f"dubins, {what}: {error}; lower dubins_level or dubins_wind", {})
