"""URDF and SRDF as they come: XML in bounds, the corrections that a person makes to it, and
pinocchio as the parser.

A limit of a joint is followed where it can be meant: soft limits inside hard ones are kept to. Where
it cannot, what is put in its place is written into the URDF, beside the reason, so that whoever reads
the robot again knows that its limits were guessed. Limits in degrees are not guessed: a person says
them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from itertools import count
from tempfile import TemporaryFile
from typing import Annotated, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput, installed
from ..files.arrays import LARGEST, Array
from ..files.documents import parse_xml, shown
from .leg import rotation_of
from .meshes import numbers_of, pose_of, write_pose

_DEEPEST_XML = 30
_MOST_JOINTS, _MOST_MOVING = 500, 150
"""Most joints of a URDF, and of those that are not fixed: what pinocchio asks for grows with their
cube."""
_UPRIGHT = "upright"
"""The root that is put above one that lies on its side."""
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0.0, le=LARGEST)]


class JointCorrection(BaseModel):
    """Correction of a joint by a person, in place of the URDF: limits [rad, or m where it slides],
    torque, velocity.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    limits_rad: tuple[Number, Number] | None = None
    torque_nm: Positive | None = None
    velocity_rad_s: Positive | None = None


def parsed(text: str, where: str) -> Element:
    """The root of a robot's XML, URDF or SRDF.

    Raises InvalidInput unless the text is XML of a robot, without entities of its own and of a
    depth that is usual.
    """
    try:
        root = parse_xml(text, "robot", deepest=_DEEPEST_XML)
    except InvalidInput as error:
        raise InvalidInput(f"{where}: expected a URDF: {error}") from None
    kinds = [joint.get("type") for joint in root.findall("joint")]
    moving = sum(kind != "fixed" for kind in kinds)
    if len(kinds) > _MOST_JOINTS or moving > _MOST_MOVING:
        raise InvalidInput(
            f"{where}: expected {_MOST_JOINTS} joints or fewer, {_MOST_MOVING} of which move, "
            f"got {len(kinds)} and {moving}"
        )
    _check_tree(root, where)
    return root


def _check_tree(root: Element, where: str) -> None:
    """Raise InvalidInput unless every link hangs from one joint at most, and none from itself: what
    is no tree ends the process that pinocchio reads it in.
    """
    above = dict[str, str]()
    for joint in root.findall("joint"):
        ends = [joint.find(name) for name in ("parent", "child")]
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        if child in above:
            raise InvalidInput(
                f"{where}: link {shown(child)}: expected one joint above it, got two"
            )
        above |= {child: parent} if child else {}
    for link in above:
        place, seen = link, set[str]()
        while place in above and place not in seen:
            seen.add(place)
            place = above[place]
        if place in above:
            raise InvalidInput(
                f"{where}: link {shown(place)}: expected a tree, got a ring of joints"
            )


def corrected(text: str, corrections: Mapping[str, JointCorrection], where: str) -> str:
    """The URDF with what a person says of its joints written into it, so that whoever reads it
    reads the same robot.

    Arguments:
        corrections: corrections by the name of a joint, or by a pattern of names (``*_KFE``); later
            ones win.

    Raises:
        InvalidInput: for a name or pattern that fits no joint that moves.
    """
    if not corrections:
        return text
    root = parsed(text, where)
    joints = {
        joint.get("name", ""): joint
        for joint in root.findall("joint")
        if joint.get("type") != "fixed"
    }
    for pattern, correction in corrections.items():
        meant = matching(pattern, joints, f"{where}: joints")
        for joint in (joints[name] for name in meant):
            if correction.limits_rad is not None and joint.get("type") == "continuous":
                joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit")
            low, high = correction.limits_rad or (None, None)
            values = {
                "lower": low,
                "upper": high,
                "effort": correction.torque_nm,
                "velocity": correction.velocity_rad_s,
            }
            for key, value in values.items():
                if value is not None:
                    limit.set(key, repr(value))
    return ElementTree.tostring(root, encoding="unicode")


def turned(text: str, root_rpy_rad: Sequence[float], where: str) -> str:
    """The URDF of a robot whose z does not point up, below a new root whose z does.

    Arguments:
        root_rpy_rad: roll, pitch and yaw of the old root in the new one.
    """
    root = parsed(text, where)
    children = {child.get("link") for child in root.findall("joint/child")}
    names = [link.get("name", "") for link in root.findall("link")]
    old = next((name for name in names if name not in children), None)
    if old is None:
        raise InvalidInput(f"{where}: expected one root to turn, got none")
    new = next(name for k in count() if (name := f"{_UPRIGHT}{k or ''}") not in names)
    ElementTree.SubElement(root, "link", name=new)
    joint = ElementTree.SubElement(root, "joint", name=f"{new}_joint", type="fixed")
    ElementTree.SubElement(joint, "parent", link=new)
    ElementTree.SubElement(joint, "child", link=old)
    ElementTree.SubElement(joint, "origin", xyz="0 0 0", rpy=" ".join(map(repr, root_rpy_rad)))
    return ElementTree.tostring(root, encoding="unicode")


_FLYING = ("floating", "planar")
"""Types of a root joint that is the base's own freedom."""
_FLIES = ("JointModelFreeFlyer", "JointModelPlanar")
"""The same, as pinocchio calls them."""


def remove_root_joint(root: Element) -> bool:
    """Make the robot's own base the root of a URDF, where a joint that flies ties that to a bare
    world.

    Such a joint is the base itself; a bare world has neither weight nor shape. Returns whether
    there was one.
    """
    for world, joint in _tied(root):
        bare = not {"collision", "visual"} & {part.tag for part in world}
        if bare and joint.get("type") in _FLYING:
            root.remove(joint)
            root.remove(world)
            return True
    return False


def root_doubts(root: Element) -> list[tuple[str, str]]:
    """A doubt about the joint that ties the robot to its world, where the base could move along some
    directions alone: it is taken for one that moves freely.
    """
    return [
        (
            f"joint {joint.get('name')}",
            f"is {kind} and ties the base to a world; it is taken to move freely",
        )
        for _, joint in _tied(root)
        if (kind := joint.get("type", "")) not in ("fixed", "floating")
    ]


def _tied(root: Element) -> Iterator[tuple[Element, Element]]:
    """Roots without a weight that carry one joint, and that joint."""
    children = {child.get("link") for child in root.findall("joint/child")}
    for world in [link for link in root.findall("link") if link.get("name") not in children]:
        joints = [
            joint
            for joint in root.findall("joint")
            for parent in joint.findall("parent")
            if parent.get("link") == world.get("name")
        ]
        if world.find("inertial") is None and len(joints) == 1:
            yield world, joints[0]


def matching(pattern: str, names: Mapping[str, object], where: str) -> list[str]:
    """The names that a name or pattern means.

    Raises InvalidInput for one that means none.
    """
    names_found = (
        [pattern] if pattern in names else [name for name in names if fnmatchcase(name, pattern)]
    )
    if not names_found:
        listed = list(names)
        more = f" and {len(listed) - 12} more" if len(listed) > 12 else ""
        known = ", ".join(listed[:12]) + more
        raise InvalidInput(f"{where}: expected one of {known}, got {shown(pattern)}")
    return names_found


def pinocchio() -> Any:
    """The pinocchio module.

    Raises InvalidInput where it is not installed.
    """
    return installed("pinocchio", "joints", "pinocchio", "URDFs and joint angles", "robots")


def coal() -> Any:
    """The coal module.

    Raises InvalidInput where it is not installed.
    """
    return installed("coal", "bodies", "coal", "collisions", "robots")


def built(text: str, where: str) -> Any:
    """pinocchio's model of a URDF on a free-flying base.

    Raises InvalidInput for what pinocchio refuses.
    """
    pin = pinocchio()
    with TemporaryFile() as sink:
        try:
            with _standard_error(sink.fileno()):
                model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        except Exception as error:  # what pinocchio meets
            sink.seek(0)
            lines = sink.read(10_000).decode(errors="replace").splitlines()
            reason = next(
                (line.partition("Error:")[2] for line in lines if line.startswith("Error:")),
                str(error),
            )
            raise InvalidInput(
                f"{where}: expected a URDF: {' '.join(reason.split())[:120]}"
            ) from None
    base = base_joint(model)
    for j in range(base + 1, model.njoints):
        if model.joints[j].shortname() in _FLIES:
            raise InvalidInput(
                f"{where}: joint '{model.names[j]}': expected joints that are floating or planar "
                "above the base alone, "
                "got one between two of its links: make it fixed, or leave out what it carries"
            )
    return model


def base_joint(model: Any) -> int:
    """pinocchio's number of the joint that carries the base: the last of those that fly, one below
    the other, from the root on, with nothing beside them.
    """
    base = 1
    while len(below := model.children[base]) == 1 and model.joints[below[0]].nq == 7:
        base = int(below[0])
    return base


def axes_of(model: Any) -> dict[int, tuple[Array, bool]]:
    """Unit vector along the axis of every joint below the base of pinocchio's model, in the joint's
    own frame, shape (3,), and whether it slides; of a joint of several angles of the first.
    """
    pin, data = pinocchio(), model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = dict[int, tuple[Array, bool]]()
    for j in range(base_joint(model) + 1, model.njoints):
        twist = pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)
        along, about = np.split(twist[:, model.joints[j].idx_v], 2)
        slides = bool(np.linalg.norm(about) < 0.5)
        axes[j] = (along if slides else about, slides)
    return axes


def at_rest(model: Any) -> Any:
    """pinocchio's neutral posture with the base's frame at the origin, where a file may have it
    elsewhere.
    """
    pin = pinocchio()
    rest, data = pin.neutral(model), model.createData()
    pin.forwardKinematics(model, data, rest)
    base = data.oMi[base_joint(model)]
    if not base.isIdentity(0.0):
        rest[:7] = pin.SE3ToXYZQUAT(base.inverse())
    return rest


@contextmanager
def _standard_error(descriptor: int) -> Iterator[None]:
    """Standard error goes elsewhere: urdfdom writes several lines to it by itself before it
    refuses.
    """
    stderr = os.dup(2)
    os.dup2(descriptor, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


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
            effort, velocity = (number_in(limit, key, where) for key in ("effort", "velocity"))
            if effort > 0.0 and velocity <= 0.0:
                limit.set("velocity", repr(GUESSED_RAD_S))
                joint.set(_SPEED, _GUESSED)
                written = True
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        ends = [number_in(limit, key, where) for key in ("lower", "upper")]
        soft = joint.find("safety_controller")
        inner = [number_in(soft, f"soft_{key}_limit", where) for key in ("lower", "upper")]
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
    far = max(high - low, min(abs(low), abs(high))) > _MOST_RAD
    return far and max(abs(low), abs(high)) <= _MOST_DEGREES


def number_in(element: Element | None, key: str, where: str) -> float:
    """A number of a limit, 0 where it is not said."""
    text = "0" if element is None else element.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise InvalidInput(f"{where}: {key}: expected a number, got {shown(text)}")
    return value
