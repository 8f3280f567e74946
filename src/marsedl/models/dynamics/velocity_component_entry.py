"""Entry over a non-rotating sphere in velocity components, steered by bank acceleration (desensitized, Eqs. 1-2)."""

import numpy as np

from marsedl.compiling import jitable
from marsedl.elementary import sine_cosine

__all__ = ["velocity_component_entry_rates"]


@jitable
def velocity_component_entry_rates(state, bank_acceleration, density, vehicle, planet):
    r"""Time derivatives of position, velocity and bank of a capsule that is steered by its bank angle (Eqs. 1 and 2).

        $\dot{h} = v_r, \quad \dot{\phi} = \frac{v_n}{r}, \quad \dot{\theta} = \frac{v_e}{r \, \cos\phi}, \quad r =
          r_m + h$
        $\dot{v}_r = -\frac{\mu}{r^2} + \frac{v_n^2 + v_e^2}{r} + a_r$
        $\dot{v}_n = -\frac{v_r v_n + v_e^2 \, \tan\phi}{r} + a_n$
        $\dot{v}_e = -\frac{v_r v_e - v_n v_e \, \tan\phi}{r} + a_e$
        $\ddot{\xi} = u$

    The paper gives the aerodynamic acceleration (a_r, a_n, a_e) by its symbols only. Drag, a_D = rho V^2 / (2 BC), acts
    against the velocity; lift, a_L = (L/D) a_D, at right angles to it, turned by the bank angle from up to the right:

        $a = -a_D e_v + a_L (\cos\xi \; \text{up} + \sin\xi \; \text{right}), \quad V_h^2 = v_n^2 + v_e^2$
        $\text{up} = \left( \frac{V_h}{V}, -\frac{v_r v_n}{V V_h}, -\frac{v_r v_e}{V V_h} \right)$
        $\text{right} = \left( 0, -\frac{v_e}{V_h}, \frac{v_n}{V_h} \right)$

    so a positive bank turns an eastward flight to the south. The longitude enters no rate.

    Written as a slowing s and a turn rate q, that of the heading clockwise, the horizontal components are
    v_n' = -s v_n - q v_e and v_e' = -s v_e + q v_n. Quotients share reciprocals, so that a loop over trials becomes
    vector code.

    Args:
        state: altitude h (m), latitude phi, longitude theta (rad; the rates do not depend on it), radial, north and
            east velocity v_r, v_n, v_e (m/s; not straight up or down), bank xi (rad) and bank rate xi' (rad/s).
        bank_acceleration: u, rad/s^2.
        density: rho, kg/m^3.
        vehicle: ballistic coefficient BC, kg/m^2, and lift-to-drag ratio L/D, 1.
        planet: gravitational parameter mu, m^3/s^2, and radius r_m, m.

    Returns:
        Tuple of the rates of altitude (m/s), latitude, longitude (rad/s), radial, north and east velocity (m/s^2), bank
        (rad/s) and bank rate (rad/s^2).
    """
    altitude, latitude, _, radial_velocity, north_velocity, east_velocity, bank, bank_rate = state
    sin_latitude, cos_latitude = sine_cosine(latitude)
    sin_bank, cos_bank = sine_cosine(bank)
    ballistic_coefficient, lift_to_drag = vehicle
    gravitational_parameter, planet_radius = planet
    inverse_radius = 1.0 / (planet_radius + altitude)
    inverse_cos_latitude = 1.0 / cos_latitude
    horizontal_square = north_velocity * north_velocity + east_velocity * east_velocity
    horizontal = np.sqrt(horizontal_square)
    inverse_horizontal = 1.0 / horizontal
    speed = np.sqrt(horizontal_square + radial_velocity * radial_velocity)

    drag_over_speed = 0.5 * density * speed / ballistic_coefficient
    lift_over_speed = lift_to_drag * drag_over_speed
    vertical_lift_over_speed = lift_over_speed * cos_bank

    gravity = gravitational_parameter * inverse_radius * inverse_radius
    eastward = east_velocity * inverse_radius
    slowing = (
        drag_over_speed
        + vertical_lift_over_speed * radial_velocity * inverse_horizontal
        + radial_velocity * inverse_radius
    )
    turn_rate = lift_over_speed * speed * sin_bank * inverse_horizontal + eastward * sin_latitude * inverse_cos_latitude
    return (
        radial_velocity,
        north_velocity * inverse_radius,
        eastward * inverse_cos_latitude,
        horizontal_square * inverse_radius
        - gravity
        - drag_over_speed * radial_velocity
        + vertical_lift_over_speed * horizontal,
        -slowing * north_velocity - turn_rate * east_velocity,
        -slowing * east_velocity + turn_rate * north_velocity,
        bank_rate,
        bank_acceleration,
    )
