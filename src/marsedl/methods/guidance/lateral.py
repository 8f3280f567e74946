"""Lateral guidance: bank reversals, heading alignment, limit of the bank rate (Secs. III.D-E, V).

Sections and equations are those of the stochastic entry guidance.
"""

import numpy as np

from marsedl.compiling import jitable

__all__ = [
    "CORRECTED",
    "PRINTED",
    "bank_direction",
    "deadband",
    "heading_alignment_limit",
    "heading_alignment_ratio",
    "limited_heading_alignment",
    "rate_limited_bank",
    "rate_limited_bank_as_printed",
]

# Forms of the heading alignment.
CORRECTED, PRINTED = 0, 1


@jitable
def deadband(time, start_time, start_width, end_time, end_width):
    """Half width of the crossrange deadband: constant, then linear in time, then constant (Fig. 5).

    Args:
        time: s.
        start_time, end_time: bounds of the linear part, s, start_time < end_time.
        start_width, end_width: half widths before and after it, m (or rad: the unit of the result).

    Returns:
        eps_max, in the unit of the widths.
    """
    remaining_share = np.minimum(np.maximum((end_time - time) / (end_time - start_time), 0.0), 1.0)
    return remaining_share * start_width + (1.0 - remaining_share) * end_width


@jitable
def bank_direction(direction, crossrange, width):
    r"""New bank direction: reversed when the crossrange has grown beyond the deadband (Eq. 57).

        $b \leftarrow -b \quad \text{if} \quad b \epsilon > \epsilon_\text{max}$

    Banking in direction +1 turns right and lets $\epsilon$ grow, so $\epsilon$ is tested on the side to which it grows
    only.

    Args:
        direction: b, +1 or -1.
        crossrange: $\epsilon$, positive while the target is to the left, m or rad.
        width: $\epsilon_\text{max}$, in the unit of the crossrange.

    Returns:
        Direction of the next bank command, +1 or -1.
    """
    return direction * (1 - 2 * (direction * crossrange > width))


@jitable
def heading_alignment_ratio(downrange_angle, crossrange_angle, form):
    r"""The ratio of a bank command that points the heading at the target (Eq. 58).

        $\text{CORRECTED:} \quad \sigma = -K \, \arctan(\epsilon / \delta_\text{go})$
        $\text{PRINTED:} \quad \sigma = +K \, \arctan(\delta_\text{go} / \epsilon)$

    A positive bank turns right and lets $\epsilon$ grow, so $K$ needs the minus. With the printed ratio the arctangent
    is near +-90 degrees all the time, and the command is at one of its limits.

    Args:
        downrange_angle, crossrange_angle: $\delta_\text{go}$, $\epsilon$ of `targeting.targeting`, rad.
        form: CORRECTED or PRINTED.

    Returns:
        Numerator and denominator of the ratio, the latter not negative.
    """
    swapped = form != CORRECTED
    numerator = downrange_angle if swapped else crossrange_angle
    denominator = crossrange_angle if swapped else downrange_angle
    sign = 1.0 - 2.0 * (denominator < 0.0)
    return sign * numerator, sign * denominator


@jitable
def limited_heading_alignment(angle, gain, limit, form):
    """Bank command of Eq. 58 within +-limit.

    Args:
        angle: arctangent of the ratio of `heading_alignment_ratio`, rad.
        gain: K, 1.
        limit: largest bank, rad.
        form: CORRECTED or PRINTED.

    Returns:
        Bank, rad.
    """
    command = gain * angle if form == PRINTED else -gain * angle
    return np.minimum(np.maximum(command, -limit), limit)


@jitable
def heading_alignment_limit(velocity, change_velocity, high, low):
    """Largest bank of the heading alignment: high down to a velocity, then low (Sec. V).

    Args:
        velocity: m/s.
        change_velocity: last velocity of the high limit, m/s.
        high, low: limits, rad.

    Returns:
        Limit, rad.
    """
    return high * (velocity >= change_velocity) + low * (velocity < change_velocity)


@jitable
def rate_limited_bank(command, previous, largest_change):
    r"""Bank to be flown: the command, as far as it can be reached from the bank flown before (Eq. 71, corrected).

        $\sigma = \text{clip}(\sigma_\text{cmd}, \; \sigma_\text{flown} - L \, dt, \; \sigma_\text{flown} + L \, dt)$

    Args:
        command: $\sigma_\text{cmd}$, rad.
        previous: $\sigma_\text{flown}$, rad.
        largest_change: $L \, dt$, rad.

    Returns:
        $\sigma$, rad.
    """
    return np.minimum(np.maximum(command, previous - largest_change), previous + largest_change)


@jitable
def rate_limited_bank_as_printed(command, previous_command, largest_change):
    r"""Bank to be flown, literally by Eq. 71.

        $\sigma = \sigma_\text{prev} + L \, dt \quad \text{if} \quad \sigma_\text{cmd} - \sigma_\text{prev} \ge L \, dt$
        $\sigma = \sigma_\text{prev} - L \, dt \quad \text{if} \quad \sigma_\text{prev} - \sigma_\text{cmd} \le -L \,
          dt$
        $\sigma = \sigma_\text{cmd} \quad \text{otherwise}$

    The second condition is the first one again: a bank to the left is not limited, and as $\sigma_\text{prev}$ is the
    command, not the bank flown, one to the right is limited for a single step only.

    Args:
        command: $\sigma_\text{cmd}$, rad.
        previous_command: $\sigma_\text{prev}$, the command before, rad.
        largest_change: $L \, dt$, rad.

    Returns:
        $\sigma$, rad.
    """
    return np.minimum(command, previous_command + largest_change)
