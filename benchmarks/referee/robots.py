"""A file's robot: its URDF, its legs from the base outward, and the ball that each of them touches
with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CONFIGS = Path(__file__).resolve().parents[2] / "configs" / "robots"
NAMED = {"hexapod": ("hexapod.urdf", "{}_foot"), "anymal": ("anymal.urdf", "{}_FOOT")}
"""Robots that files name without a URDF in them: the file that ships, and what the feet of its legs
are called."""
BENT_RAD = {4: (0.0, -0.6, 0.0, 1.6), 3: (0.0, 0.7, -1.4)}
"""Postures of a leg that a file says none of, by its number of joints."""
SAME_M = 2e-3
"""A named robot's shoulders are where the file has them to within this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A leg.

    Attributes:
        name: as the file has it.
        joints: names of its joints, from the base outward.
        stance: angles [rad], or lengths [m], in which it stands, shape (n,).
        foot: link that touches.
        centre_m: of the ball, in the link's frame, shape (3,) [m].
        radius_m: of the ball, 0 for a point [m].
        length_m: of the stretched leg, from its first joint to its foot [m].
    """

    name: str
    joints: tuple[str, ...]
    stance: Array
    foot: str
    centre_m: Array
    radius_m: float
    length_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A robot: a URDF, its legs in the file's order, and its mass [kg]."""

    name: str
    urdf: str
    legs: tuple[Leg, ...]
    mass_kg: float


def robot_of(raw: Mapping[str, Any], joints: Sequence[str]) -> Robot:
    """The robot of a file. Raises ValueError for one that nobody has the links of.

    Arguments:
        raw: the robot as a course or a walk has it.
        joints: names of the joints that a plan has angles of, which have to be the robot's.
    """
    name, model = raw["name"], raw.get("model")
    limbs = [each["name"] for each in raw.get("limbs") or raw["feet"]]
    if model is not None:
        urdf = model["urdf"]
        said = {leg["name"]: leg for leg in model["legs"]}
    elif name in NAMED:
        file, pattern = NAMED[name]
        urdf = (CONFIGS / file).read_text(encoding="utf-8")
        said = {
            limb: {"name": limb, "foot": pattern.format(limb), "stance_rad": {}} for limb in limbs
        }
    else:
        raise ValueError(
            f"robot: expected a model with a URDF, or {' or '.join(NAMED)}, got {name}"
        )
    root = ElementTree.fromstring(urdf)
    if set(said) != set(limbs):
        raise ValueError(f"robot: expected legs for {', '.join(limbs)}, got {', '.join(said)}")
    legs = tuple(_leg(root, said[limb]) for limb in limbs)
    known = {joint for leg in legs for joint in leg.joints}
    if joints and set(joints) != known:
        raise ValueError(
            f"robot: expected the joints {', '.join(sorted(known))}, got {', '.join(joints)}"
        )
    if model is None:
        _check_named(root, raw, legs)
    return Robot(name=name, urdf=urdf, legs=legs, mass_kg=float(raw["mass_kg"]))


def _leg(root: Element, raw: Mapping[str, Any]) -> Leg:
    joint_to = {_link(joint, "child"): joint for joint in root.findall("joint")}
    links = {link.get("name"): link for link in root.findall("link")}
    if raw["foot"] not in links:
        raise ValueError(f"robot: leg {raw['name']}: expected a link {raw['foot']}, found none")
    chain, link = list[Element](), raw["foot"]
    while link in joint_to:
        chain.insert(0, joint_to[link])
        link = _link(chain[0], "parent")
    stance = raw["stance_rad"]
    moving = [joint for joint in chain if joint.get("type") != "fixed"]
    if stance:
        moving = [joint for joint in moving if joint.get("name") in stance]
    if not moving or (stance and len(moving) != len(stance)):
        raise ValueError(
            f"robot: leg {raw['name']}: expected joints from the base to {raw['foot']}"
        )
    after = chain[chain.index(moving[0]) + 1 :]
    centre, radius = _ball(links[raw["foot"]], raw.get("contact"))
    names = tuple(str(joint.get("name")) for joint in moving)
    bent = BENT_RAD.get(len(names), (0.0,) * len(names))
    return Leg(
        name=raw["name"],
        joints=names,
        stance=np.array([float(stance[name]) for name in names] if stance else bent),
        foot=raw["foot"],
        centre_m=centre,
        radius_m=radius,
        length_m=float(
            sum(np.linalg.norm(_origin(each)) for each in after) + np.linalg.norm(centre)
        ),
    )


def _ball(link: Element, said: Mapping[str, Any] | None) -> tuple[Array, float]:
    """What a foot touches with: what the file says, or the sphere of its link that is farthest
    out.
    """
    if said is not None:
        return np.array(said["point_m"], dtype=float), float(said["radius_m"])
    balls = [
        (_origin(shape), float(sphere.get("radius", "0")))
        for shape in link.findall("collision")
        if (sphere := shape.find("geometry/sphere")) is not None
    ]
    return max(
        balls, key=lambda ball: float(np.linalg.norm(ball[0])) + ball[1], default=(np.zeros(3), 0.0)
    )


def _origin(element: Element) -> Array:
    origin = element.find("origin")
    text = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    return np.array([float(number) for number in text.split()])


def _link(joint: Element, which: str) -> str:
    found = joint.find(which)
    return "" if found is None else str(found.get("link"))


def _check_named(root: Element, raw: Mapping[str, Any], legs: Sequence[Leg]) -> None:
    """A file that names a robot has to have its shoulders."""
    origins = {joint.get("name"): _origin(joint) for joint in root.findall("joint")}
    for leg, limb in zip(legs, raw.get("limbs", ()), strict=False):
        off = np.linalg.norm(origins[leg.joints[0]] - np.array(limb["shoulder_m"]))
        if off > SAME_M:
            raise ValueError(
                f"robot: limb {leg.name}: expected the shoulder of {raw['name']}, "
                f"got one {1e3 * off:.0f} mm from it and no URDF"
            )
