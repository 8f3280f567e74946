"""Downrange and crossrange angle of the target (stochastic entry guidance, Appendix D)."""

import numpy as np

from marsedl.compiling import jitable
from marsedl.elementary import arctangent, select, sine_cosine

__all__ = ["require_target_ahead", "targeting"]


@jitable
def targeting(
    longitude,
    latitude,
    radius,
    velocity,
    flight_path_angle,
    azimuth,
    rotation_rate,
    target_longitude,
    target_latitude,
):
    r"""Angles of the target along and across the orbit plane (stochastic entry guidance, Eqs. 93 to 99).

        $\delta_\text{go} = \text{angle}(r, r_t), \quad \epsilon = \arcsin\left( \frac{r_t \cdot h}{\left| h \right|}
          \right), \quad h = r \times (V + \Omega \times r)$

    The target is taken where it is now ($t_\text{f,est} = t$). Then the planet's rotation angle cancels and the frame
    of the vehicle (up, east, north) serves, in which $r = (1, 0, 0)$ and $h = (0, -v_\text{north}, v_\text{east})$:

        $r_t = \left( \cos\phi \, \cos\phi_t \, \cos d + \sin\phi \, \sin\phi_t, \; \cos\phi_t \, \sin d, \; \cos\phi \,
          \sin\phi_t - \sin\phi \, \cos\phi_t \, \cos d \right),$
        $d = \theta_t - \theta$

    Both angles come from arctangents of two components: the arccosine of Eq. 98 loses half the digits near zero.

    Args:
        longitude, latitude: of the vehicle, rad.
        radius: m.
        velocity: planet-relative, m/s.
        flight_path_angle, azimuth: planet-relative, the azimuth clockwise from north, rad.
        rotation_rate: $\Omega$, rad/s.
        target_longitude: rad.
        target_latitude: its sine and cosine, which a flight computes once.

    Returns:
        Tuple of the downrange angle (rad, negative once the target is passed) and the crossrange angle (rad, positive
        while the target is left of the orbit plane). Times a reference radius they are distances.
    """
    sin_latitude, cos_latitude = sine_cosine(latitude)
    sin_to_target, cos_to_target = sine_cosine(target_longitude - longitude)
    _, cos_flight_path_angle = sine_cosine(flight_path_angle)
    sin_azimuth, cos_azimuth = sine_cosine(azimuth)
    sin_target_latitude, cos_target_latitude = target_latitude
    along_meridian = cos_target_latitude * cos_to_target
    up = cos_latitude * along_meridian + sin_latitude * sin_target_latitude
    east = cos_target_latitude * sin_to_target
    north = cos_latitude * sin_target_latitude - sin_latitude * along_meridian

    horizontal = velocity * cos_flight_path_angle
    velocity_east = horizontal * sin_azimuth + rotation_rate * radius * cos_latitude
    velocity_north = horizontal * cos_azimuth
    inverse_speed = 1.0 / np.sqrt(velocity_east * velocity_east + velocity_north * velocity_north)
    ahead = (east * velocity_east + north * velocity_north) * inverse_speed
    leftward = (north * velocity_east - east * velocity_north) * inverse_speed

    distance = arctangent(np.sqrt(east * east + north * north), up)
    return select(ahead < 0.0, -distance, distance), arctangent(leftward, np.sqrt(up * up + ahead * ahead))


def require_target_ahead(downrange_angle):
    """Refuse an entry state from which the target is passed already.

    Args:
        downrange_angle: at entry, rad, from `targeting`.

    Raises:
        ValueError: if it is negative.
    """
    if downrange_angle < 0:
        raise ValueError(
            f"the target lies {-np.degrees(downrange_angle):.4g} degrees behind the entry point; move either of them, "
            "or turn the azimuth at entry towards the target"
        )
