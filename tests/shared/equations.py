"""Equations of motion of two papers, written down once more: what the paper's own code is held against."""

import numpy as np


def aerocapture(state, control, density):
    """Eq. 71 of the random-field paper; state (3, ...): radius, velocity, path angle; density where it is."""
    radius, velocity, angle = state
    drag_factor, gravity = 1.0 / (2.0 * 150.0), 4.2828e13 / radius**2
    turn = 0.2 * drag_factor * density * velocity * control
    return np.array(
        [
            velocity * np.sin(angle),
            -drag_factor * density * velocity**2 - gravity * np.sin(angle),
            turn - (gravity - velocity**2 / radius) * np.cos(angle) / velocity,
        ]
    )


def landing(state, bank_acceleration, density):
    """Eqs. 1 and 2 of the desensitized-landing paper by vectors; state (8, ...), density where it is."""
    h, phi, _, *v, xi, w = state
    v = np.array(v)  # radial, north, east
    r, speed = 3397e3 + h, np.sqrt((v**2).sum(axis=0))
    ahead = v / speed
    up = np.array([np.ones_like(h), 0.0 * h, 0.0 * h]) - ahead[0] * ahead
    up = up / np.sqrt((up**2).sum(axis=0))
    right = -np.cross(ahead, up, axis=0)  # (radial, north, east) is left-handed
    drag = density * speed**2 / (2 * 115.0)
    v_r, v_n, v_e = v
    a_r, a_n, a_e = -drag * ahead + 0.18 * drag * (np.cos(xi) * up + np.sin(xi) * right)
    return np.array(
        [
            v_r,
            v_n / r,
            v_e / (r * np.cos(phi)),
            -4.282837e13 / r**2 + (v_n**2 + v_e**2) / r + a_r,
            -(v_r * v_n + v_e**2 * np.tan(phi)) / r + a_n,
            -(v_r * v_e - v_n * v_e * np.tan(phi)) / r + a_e,
            w,
            bank_acceleration + 0.0 * h,
        ]
    )
