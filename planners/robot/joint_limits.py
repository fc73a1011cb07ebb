"""Joint limits as robots' files have them, and as they are meant.

A limit is followed where it can be meant: soft limits inside hard ones are kept to. Where it cannot,
what is put in its place is written into the URDF, beside the reason, so that whoever reads the robot
again knows that its limits were guessed. Limits in degrees are not guessed: a person says them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InvalidInput
from ..files.documents import shown
from .chain import rotation_of
from .meshes import numbers_of, pose_of, write_pose

GUESSED_RAD_S = 3.0
"""Speed of a joint with a torque limit and no velocity limit, between key frames [rad/s]."""
_SPEED = "speed"
"""Attribute of a joint whose velocity limit is none of its file's."""
_GUESSED = "guessed"
"""Attribute of a joint whose limits are none of its file's: the reason."""
_MOST_RAD = 8.0 * math.pi
"""No joint that has limits turns farther: four times round."""
_MOST_DEGREES = 360.0


def mend_limits(root: Element, file: str) -> tuple[bool, dict[str, str]]:
    """Write the limits of a URDF's joints as they are meant.

    Arguments:
        file: name of the file, for messages.

    Returns:
        whether anything was written, and what a person has to say, by joint.

    Raises:
        InvalidInput: for a limit that is no number.
    """
    written, gaps = False, dict[str, str]()
    for joint in root.findall("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        where = f"{file}: joint {name}"
        if joint.get("type") in ("revolute", "continuous") and limit is not None:
            effort, velocity = (_number(limit, key, where) for key in ("effort", "velocity"))
            if effort > 0.0 and velocity <= 0.0:
                limit.set("velocity", repr(GUESSED_RAD_S))
                joint.set(_SPEED, _GUESSED)
                written = True
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        ends = [_number(limit, key, where) for key in ("lower", "upper")]
        soft = joint.find("safety_controller")
        inner = [_number(soft, f"soft_{key}_limit", where) for key in ("lower", "upper")]
        low, high = ends
        if low < inner[0] < inner[1] <= high or low <= inner[0] < inner[1] < high:
            low, high = inner
        turns = joint.get("type") == "revolute"
        if low > high:
            low, high = high, low
            joint.set(_GUESSED, f"limits exchanged, taken for {low:g} to {high:g}")
        elif turns and low == high:
            joint.set("type", "continuous")
            joint.set(_GUESSED, f"limits of {low:g} to {high:g}, taken to turn freely")
            written = True
        elif turns and _in_degrees(low, high):
            why = f"limits of {low:g} to {high:g} rad, in degrees?"
            if low <= -math.pi and high >= math.pi:
                joint.set(_GUESSED, f"{why} Taken to turn freely")
                written = True
            else:
                gaps[name] = (
                    f"joint {name}: expected limits in radians, got {low:g} to {high:g}, degrees? "
                    "Say joints: limits_rad in a YAML file"
                )
        if limit is not None and [low, high] != ends and joint.get("type") != "continuous":
            limit.set("lower", repr(low))
            limit.set("upper", repr(high))
            written = True
    return written, gaps


def hold(root: Element, angles: Mapping[str, float]) -> None:
    """Make joints fixed at an angle [rad, or m where they slide].

    Raises InvalidInput for an axis or a place that is none.
    """
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        if name not in angles:
            continue
        turn, place = pose_of(joint.find("origin"), f"joint {name}")
        element = joint.find("axis")
        text = "1 0 0" if element is None else element.get("xyz", "")
        axis = numbers_of(text, 3, f"joint {name}: axis")
        if joint.get("type") == "prismatic":
            place = place + turn @ (angles[name] * np.array(axis))
        else:
            turn = turn @ rotation_of(angles[name] * np.array(axis) / (np.linalg.norm(axis) or 1.0))
        joint.set("type", "fixed")
        for tag in ("origin", "axis", "limit", "mimic", "dynamics", "safety_controller"):
            for child in joint.findall(tag):
                joint.remove(child)
        write_pose(joint, turn, place)


def limit_doubts(root: Element) -> Iterator[tuple[str, str]]:
    """Joints of a URDF whose limits were guessed, by name, and why."""
    for joint in root.findall("joint"):
        if reason := joint.get(_GUESSED):
            yield joint.get("name", ""), reason


def speed_doubts(root: Element) -> list[str]:
    """Names of the joints whose velocity limit was guessed."""
    return [joint.get("name", "") for joint in root.findall("joint") if joint.get(_SPEED)]


def _in_degrees(low: float, high: float) -> bool:
    """Tell whether limits can only be meant in degrees: several turns wide, or far from 0, and no
    wider than a turn of 360.
    """
    far = high - low > _MOST_RAD or min(abs(low), abs(high)) > _MOST_RAD
    return far and max(abs(low), abs(high)) <= _MOST_DEGREES


def _number(element: Element | None, key: str, where: str) -> float:
    """A number of a limit, 0 where it is not said."""
    text = "0" if element is None else element.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        raise InvalidInput(f"{where}: {key}: expected a number, got {shown(text)}") from None
    if math.isnan(value):
        raise InvalidInput(f"{where}: {key}: expected a number, got {shown(text)}")
    return value
