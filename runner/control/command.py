"""Commands to joint loops: one function for simulations and for what is real, so that both get the
same stream.
"""

from __future__ import annotations

import numpy as np

from stancekit.planners.files.arrays import Array

from ..worlds.drives import Drives


def command(
    drives: Drives,
    angles_rad: Array,
    torques_nm: Array,
    rates_rad_s: Array,
    rising_rad_s2: Array,
    share: float = 1.0,
) -> Array:
    """q + Kp⁻¹ (τ + Kd q̇ + J q̈), shape (J,) [rad]: a loop τ = Kp (q* − q) − Kd q̇ that is sent
    this gives τ at q.

    A servo takes no torque: it gets it as an offset of its position.

    Arguments:
        torques_nm: of loads and links; the rotors' are added here.
        share: of Kp that the loops really have. A loop that yields to nothing is sent q.
    """
    if not drives.yields:
        return np.array(angles_rad)
    torques = torques_nm + drives.damping_nms_rad * rates_rad_s + drives.rotor_kg_m2 * rising_rad_s2
    return np.asarray(angles_rad + torques / (share * drives.stiffness_nm_rad))
