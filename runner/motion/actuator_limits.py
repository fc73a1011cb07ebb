"""Refusing motions that the named actuators cannot do: what they lack, at which joint, and which
others would do.
"""

from __future__ import annotations

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Motion
from stancekit.planners.robot.actuators import ActuatorModel
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

from ..acceptance import JointNeeds
from ..worlds.drives import Drives
from .redundancy import RedundancyResolution

_SAMPLED_S = 0.02
"""Torques at rest are taken so often, between the knots along straight lines."""
_CLEARLY = 1.05
"""Postures at knots are not quite those that are tracked: only what is over a limit by so much is
refused by them."""


def check_at_rest(
    source: str,
    motion: Motion,
    kinematics: Kinematics,
    wished: RedundancyResolution,
    drives: Drives,
    share: float,
) -> None:
    """Raise InvalidInput where torques at rest, at a motion's knots, tell that named actuators
    cannot do it: that is known in a tenth of the time that the whole motion takes.
    """
    if drives.assigned is None:
        return
    samples = [motion.at(float(time_s)) for time_s in motion.knots_s]
    torques = np.array(
        [
            kinematics.torques(
                angles, rotation_of(sample.rotation_rad), sample.forces_n, sample.moments_nm
            )
            for angles, sample in zip(wished.path_rad, samples, strict=True)
        ]
    )
    times = np.arange(0.0, motion.duration_s, _SAMPLED_S)
    even = np.stack([np.interp(times, motion.knots_s, joint) for joint in torques.T], axis=1)
    check_actuators(source, drives, even, _SAMPLED_S, share, _CLEARLY)


def check_actuators(
    source: str,
    drives: Drives,
    torques_nm: Array,
    period_s: float,
    share: float,
    clearly: float = 1.0,
) -> None:
    """Raise InvalidInput where named actuators lack torque, or get hotter than they bear.

    Arguments:
        torques_nm: shape (T, J), so long apart.
        share: of the stall torque that may be used.
        clearly: how many times a limit is to be exceeded.
    """
    if drives.assigned is None:
        return
    needs = JointNeeds.of(drives.joints, drives.actuators, torques_nm, period_s)
    used = np.fmax(needs.share_of_stall / share, np.sqrt(needs.heat))
    worst = int(np.argmax(used))
    if used[worst] <= clearly:
        return
    names = drives.assigned.names(drives.joints)
    alike = [joint for joint, name in enumerate(names) if name == names[worst]]
    fits = [
        name
        for name, model in drives.assigned.known.items()
        if _bears(model, torques_nm[:, alike], period_s, share)
    ]
    would = f"at rest {' or '.join(fits)} would do" if fits else "no known actuator would do"
    raise InvalidInput(
        f"{source}: expected actuators that bear it: joint {needs.joints[worst]} needs "
        f"{needs.said(worst)}, {names[worst]} has {_said(drives.actuators[worst], share)}; {would}"
    )


def _bears(model: ActuatorModel, torques_nm: Array, period_s: float, share: float) -> bool:
    """Tell whether an actuator can give these torques, shape (T, J), at J joints."""
    count = torques_nm.shape[1]
    needs = JointNeeds.of([""] * count, [model] * count, torques_nm, period_s)
    return bool(np.all(needs.share_of_stall <= share) and not np.any(needs.heat > 1.0))


def _said(model: ActuatorModel, share: float) -> str:
    """Words for what an actuator can give, for a moment and for ever."""
    long = "" if model.continuous_nm is None else f" and {model.continuous_nm:.3g} Nm for ever"
    return f"{share:g} of {model.stall_nm:.3g} Nm for a moment{long}"
