"""Place that a limb likes for its toe."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from ..robot.model import Limb
from .course_keys import StanceSpec


def toe_offset(limb: Limb, stance: StanceSpec) -> Array:
    """From the shoulder to where the limb likes its toe, body frame, shape (3,) [m]."""
    if limb.name in stance.limbs:
        return np.array(stance.limbs[limb.name])
    out = limb.shoulder_m * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(out))
    return stance.outward_m * out / max(length, 1e-12) - [0.0, 0.0, stance.down_m]
