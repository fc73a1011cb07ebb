"""Limits of a leg that moves fast: how fast it extends, what power it has and how short it
folds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import YAML, read_yaml, validated
from .joint_limits import speed_doubts
from .leg import Leg
from .legged import robot_of
from .model import LegLimits, Robot
from .robot_file import LegKeys, named_robot, read_keys, robot_path
from .robot_model import RobotModel
from .single_body import legged_anymal, read_walker
from .urdf_reader import matching

_ANGLES = 9
"""Postures per joint that are looked at for the shortest and the longest leg."""


class _File(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True)
    legs: dict[str, LegKeys] = {}


def leaping_robot(robot: Robot | str | Path) -> Robot:
    """A robot as leaps have it: inertia, and for every limb a hip with limits of speed, power and
    length.

    Arguments:
        robot: a ``Robot`` with both, which is returned as it is; a robot's name or file. A model's
            legs reach as far from their hips as their joints let them, in any direction; a walker's
            file gives boxes, and that of ``anymal`` has the legs of ``configs/robots/anymal.urdf``
            besides. Its key ``legs`` (by name or pattern) says limits; those of a model follow from
            the efforts and velocities of its joints.

    Raises:
        InvalidInput: for a robot without inertia.
    """
    if not isinstance(robot, Robot):
        path = robot_path(robot)
        if str(robot) == "anymal":
            from stancekit.configs import config_path

            path = config_path("robots/anymal.yaml")
        data = read_yaml(path) if path.suffix in YAML else {}
        keys = validated(_File, data, str(path)).legs
        if data and "urdf" not in data:
            walker = legged_anymal() if str(robot) == "anymal" else read_walker(path)
            robot = _corrected(replace(walker, feet=()), keys)
        else:
            keys = read_keys(path).legs if data else {}
            robot = _with_limits(robot_of(named_robot(robot)), keys)
    if robot.inertia is None:
        raise InvalidInput(
            f"robot {robot.name}: inertia_kgm2: expected the inertia of a body that leaps, got none"
        )
    return robot


def no_motors(model: RobotModel) -> str:
    """Gaps in a robot's file about its joints' efforts and velocities, in words; empty where there
    are all.
    """
    guessed = speed_doubts(model.tree)
    slow = [
        f"joint {joint.name}"
        for leg in model.legs
        for joint in leg.joints
        if joint.velocity_rad_s <= 0.0 or joint.name in guessed
    ]
    lacks = [*model.lines_of(model.torque_doubts)]
    if slow:
        lacks.append(f"no velocity limit of {', '.join(slow[:4])}{' …' * (len(slow) > 4)}")
    if not lacks:
        return ""
    return f"expected limits of its joints' torque and speed, which leaps need: {'; '.join(lacks)}"


def _limits_of(leg: Leg, com_m: Array) -> LegLimits:
    """The limits that a leg's joints give: their velocities along the standing leg, all their
    power, its shortest fold.

    Joints without a limit leave the leg without one.

    Arguments:
        com_m: the centre of mass in the base's frame, shape (3,) [m].
    """
    foot, jacobian = (part[0] for part in leg.chain.feet_and_jacobian(leg.stance_rad[None]))
    along = (foot - leg.hip_m) / max(float(np.linalg.norm(foot - leg.hip_m)), 1e-9)
    velocity = np.array([joint.velocity_rad_s for joint in leg.joints])
    power = float(leg.torque_nm @ velocity)
    speed = float(np.abs(along @ jacobian) @ velocity)
    shortest, _ = _lengths(leg)
    return LegLimits(
        hip_m=leg.hip_m - com_m,
        speed_m_s=speed if np.all(velocity > 0.0) else math.inf,
        power_w=power if np.all(velocity > 0.0) and np.all(leg.torque_nm > 0.0) else math.inf,
        fold_m=max(shortest - leg.radius_m, 0.0),
    )


def _lengths(leg: Leg) -> tuple[float, float]:
    """Shortest and longest distance of hip and foot's centre within the joints' limits [m]."""
    lines = [
        np.linspace(low, high, _ANGLES)
        for low, high in zip(leg.lower_rad, leg.upper_rad, strict=True)
    ]
    angles = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(leg.joints))
    lengths = np.linalg.norm(leg.chain.feet(angles) - leg.hip_m, axis=1)
    return float(lengths.min()), float(lengths.max())


def _with_limits(robot: Robot, keys: Mapping[str, LegKeys]) -> Robot:
    model = robot.source.own_model()
    limits = [_limits_of(leg, model.body.com_m) for leg in model.legs]
    limbs = tuple(
        replace(limb, leg=each, reach_m=_lengths(leg)[1] + leg.radius_m)
        for limb, each, leg in zip(robot.limbs, limits, model.legs, strict=True)
    )
    return _corrected(replace(robot, limbs=limbs), keys)


def _corrected(robot: Robot, keys: Mapping[str, LegKeys]) -> Robot:
    """The robot with the limits that its file says.

    Raises InvalidInput for a leg that it does not have.
    """
    limbs = {limb.name: limb for limb in robot.limbs}
    for pattern, keys_of_leg in keys.items():
        for name in matching(pattern, limbs, f"robot {robot.name}: legs"):
            leg = limbs[name].leg
            assert leg is not None
            values = {
                key: value for key, value in keys_of_leg.model_dump().items() if value is not None
            }
            limbs[name] = replace(limbs[name], leg=replace(leg, **values))
    return replace(robot, limbs=tuple(limbs.values()))
