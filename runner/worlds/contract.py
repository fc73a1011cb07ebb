"""Contract of every world: a driver of one's own is asked before anything moves, and after every
step.
"""

from __future__ import annotations

from functools import lru_cache
from math import isfinite
from typing import Any, get_args

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array, checked, checked_name
from stancekit.planners.files.documents import shown
from stancekit.planners.robot import Robot
from stancekit.planners.robot.robot_file import Servo

from ..safety.latch import StopLatch
from .capabilities import WorldCapabilities
from .world import State, WorldKind

_NUMBER = np.dtype(np.float64)
METHODS = ("reset", "step", "close")


def check_world(world: Any) -> None:
    """Raise InvalidInput, in one line, for an object that is no ``World``: what it lacks, or has of
    another kind.
    """
    name = checked_name(getattr(world, "name", None), "world: name")
    types = {"latch": StopLatch, "robot": Robot, "servo": Servo}
    for attribute, type_ in types.items():
        if not isinstance(value := getattr(world, attribute, None), type_):
            raise InvalidInput(
                f"world {name}: {attribute}: expected a {type_.__name__}, got {shown(value)}"
            )
    if (kind := getattr(world, "kind", None)) not in get_args(WorldKind):
        raise InvalidInput(
            f"world {name}: kind: expected one of {', '.join(get_args(WorldKind))}, got "
            f"{shown(kind)}"
        )
    checked(getattr(world, "rate_hz", None), f"world {name}: rate_hz", above=0.0)
    joints = getattr(world, "joints", None)
    if (
        not isinstance(joints, tuple)
        or not joints
        or not all(isinstance(each, str) for each in joints)
    ):
        raise InvalidInput(f"world {name}: joints: expected a tuple of names, got {shown(joints)}")
    can = getattr(world, "capabilities", None)
    if can is not None and not isinstance(can, WorldCapabilities):
        raise InvalidInput(
            f"world {name}: capabilities: expected a WorldCapabilities, got {shown(can)}"
        )
    if can is not None and can.joints != joints:
        raise InvalidInput(f"world {name}: capabilities: expected those of its joints, got others")
    for method in METHODS:
        if not callable(getattr(world, method, None)):
            raise InvalidInput(f"world {name}: expected the method {method}, got none")


def check_state(state: Any, joints: int, limbs: int, name: str) -> None:
    """Raise HardwareFault for measurements that are no ``State`` of so many joints and limbs, or no
    finite numbers.
    """
    if not isinstance(state, State):
        raise HardwareFault(f"world {name}: expected a State, got {shown(state)}")
    shapes = _shapes(joints, limbs)
    if _plain_and_finite(state, shapes):
        return
    for attribute, shape in shapes.items():
        try:
            value = np.asarray(getattr(state, attribute))
            finite = value.shape == shape and bool(np.isfinite(value).all())
        except (TypeError, ValueError):
            raise HardwareFault(
                f"world {name}: expected numbers in {attribute}, got others"
            ) from None
        if value.shape != shape:
            raise HardwareFault(
                f"world {name}: expected shape {shape} of {attribute}, got {value.shape}"
            )
        if not finite:
            raise HardwareFault(
                f"world {name}: expected finite measurements, got others in {attribute}"
            )


@lru_cache(maxsize=8)
def _shapes(joints: int, limbs: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays in a state."""
    return {
        "time_s": (),
        "bump_n": (),
        "position_m": (3,),
        "rotation": (3, 3),
        "velocity": (6,),
        **dict.fromkeys(("angles_rad", "rates_rad_s", "torques_nm", "sent_rad"), (joints,)),
        **dict.fromkeys(("feet_m", "forces_n"), (limbs, 3)),
    }


def _plain_and_finite(state: State, shapes: dict[str, tuple[int, ...]]) -> bool:
    """Tell whether all of it is arrays of finite numbers in these shapes, as it nearly always
    is.
    """
    arrays = list[Array]()
    for name, shape in shapes.items():
        value = getattr(state, name)
        if shape:
            if type(value) is not np.ndarray or value.shape != shape or value.dtype is not _NUMBER:
                return False
            arrays.append(value)
        elif type(value) is not float or not isfinite(value):
            return False
    return bool(np.isfinite(np.concatenate(arrays, axis=None)).all())
