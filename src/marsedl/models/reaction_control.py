"""Propellant of the thrusters that turn a capsule (desensitized landing, Tables 1 and 3)."""

import numpy as np

__all__ = ["bank_propellant"]


def bank_propellant(
    cumulative_bank_acceleration,
    angle_of_attack,
    roll_inertia,
    yaw_inertia,
    roll_arm,
    yaw_arm,
    specific_impulse,
    standard_gravity,
):
    r"""Propellant of a bank manoeuvre with pairs of thrusters about the roll and the yaw axis.

        $m =
          \frac{I_\text{roll} / l_\text{roll} + \left| \sin\alpha \right| I_\text{yaw} / l_\text{yaw}}{g_0 I_\text{sp}}
          \int \left| u \right| \, dt$

    The paper never states it. It is identified from Table 3 of desensitized landing, where fuel is a constant times the
    cumulative bank rate, $\int \left| u \right| \, dt$: 0.039433 to 0.039439 kg s/deg within rounding. The vehicle of
    Table 1 has 0.039429 here, which gives five of the six fuels to the last digit and the sixth a unit of it less.

    To bank is to turn about the velocity. The roll axis is the angle of attack away from it, so that the yaw axis takes
    part with the sine of that angle. A rigid body would roll with its cosine, but $\cos\alpha + \sin\alpha$ is 1.6 %
    below the table, and $1 + \tan\alpha$ 0.3 % above.

    Args:
        cumulative_bank_acceleration: integral of $\left| u \right|$ over time, rad/s, any shape.
        angle_of_attack: $\alpha$, rad.
        roll_inertia, yaw_inertia: $I_\text{roll}$, $I_\text{yaw}$, kg m^2.
        roll_arm, yaw_arm: $l_\text{roll}$, $l_\text{yaw}$, of the thrusters, m.
        specific_impulse: $I_\text{sp}$, s.
        standard_gravity: $g_0$, m/s^2.

    Returns:
        m, kg, shape of cumulative_bank_acceleration.

    Raises:
        ValueError: if an inertia, an arm, the specific impulse or the standard gravity is not positive, or a cumulative
            bank acceleration is negative.
    """
    positive = {
        "roll_inertia": roll_inertia,
        "yaw_inertia": yaw_inertia,
        "roll_arm": roll_arm,
        "yaw_arm": yaw_arm,
        "specific_impulse": specific_impulse,
        "standard_gravity": standard_gravity,
    }
    for name, value in positive.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be positive, got {value}")
    cumulative = np.asarray(cumulative_bank_acceleration, dtype=float)
    if (cumulative < 0.0).any():
        raise ValueError(f"cumulative_bank_acceleration must not be negative, got {cumulative.min()}")
    impulse_per_rate = roll_inertia / roll_arm + np.abs(np.sin(angle_of_attack)) * yaw_inertia / yaw_arm
    return (impulse_per_rate / (standard_gravity * specific_impulse) * cumulative)[()]
