"""A robot on some of its legs, joint by joint: what a posture of these legs is judged and bent
with.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from functools import lru_cache
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from .leg_sources import no_legs
from .model import Limb, Robot
from .robot_model import RobotModel, model_of
from .urdf_reader import pinocchio

SHAPES = "collision", "visual"


def on_limbs(robot: Robot, limbs: Sequence[Limb], mass_kg: float) -> Robot:
    """The robot on these limbs, each with the leg of its name.

    Other legs of its file are held as the robot stands: they weigh, and nobody looks at their
    shapes, since a posture does not say where they are. Legs that are drawn up are drawn for these
    limbs alone. ``absent`` names them, and verdicts say that their bodies are not judged.

    Arguments:
        limbs: the limbs, in the robot's order.
        mass_kg: the whole mass [kg].

    Raises:
        InvalidInput: for a robot whose legs are not known, and a mass that is not that of its file.
    """
    names = tuple(limb.name for limb in limbs)
    idle = tuple(name for name in robot.limb_names if name not in names)
    if not robot.source.own and robot.drawn is None:
        raise no_legs(robot.name)
    model = _on_legs(robot.source.own_model(), names) if robot.source.own else None
    return Robot(
        name=robot.name,
        mass_kg=mass_kg,
        limbs=tuple(limbs),
        model=model,
        drawn=robot.drawn,
        absent=idle,
    )


@lru_cache(maxsize=8)
def _on_legs(model: RobotModel, names: tuple[str, ...]) -> RobotModel:
    """The model whose other legs are part of its base, without shapes; whoever reads its URDF reads
    it so.
    """
    if names == model.leg_names:
        return model
    root, legs = deepcopy(model.tree), [leg for leg in model.legs if leg.name in names]
    idle = [leg for leg in model.legs if leg.name not in names]
    held = {
        name: angle
        for leg in idle
        for name, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
    }
    for joint in root.findall("joint"):
        if (name := joint.get("name", "")) in held:
            _hold(joint, held[name])
    unseen = {
        link
        for link, mount in model.mounts.items()
        if mount.leg is not None and model.legs[mount.leg] in idle
    }
    for link in root.findall("link"):
        for kind in SHAPES if link.get("name") in unseen else ():
            for shape in link.findall(kind):
                link.remove(shape)
    again = model_of(
        ElementTree.tostring(root, encoding="unicode"),
        where=model.name,
        folder=None,
        hulls={},
        feet={leg.name: leg.foot for leg in legs},
        name=model.name,
        contacts={leg.name: leg.contact for leg in legs if leg.contact is not None},
        posture_rad={
            joint: angle
            for leg in legs
            for joint, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
        },
    )
    shapes = tuple(shape for shape in model.shapes if shape.link not in unseen)
    return again.changed(legs=tuple(legs), shapes=shapes, disabled_pairs=model.disabled_pairs)


def _hold(joint: Element, angle: float) -> None:
    """Make a joint one that does not move, at this angle [rad, or m where it slides]."""
    pin = pinocchio()
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    place, turn = (
        np.array(origin.get(key, "0 0 0").split(), dtype=np.float64) for key in ("xyz", "rpy")
    )
    axis_element = joint.find("axis")
    axis = np.array(
        (axis_element.get("xyz", "1 0 0") if axis_element is not None else "1 0 0").split(),
        dtype=np.float64,
    )
    axis, rotation = axis / np.linalg.norm(axis), np.array(pin.rpy.rpyToMatrix(*turn))
    if joint.get("type") == "prismatic":
        place = place + rotation @ (angle * axis)
    else:
        rotation = rotation @ np.array(pin.exp3(angle * axis))
    origin.set("xyz", " ".join(map(repr, place.tolist())))
    origin.set("rpy", " ".join(map(repr, np.array(pin.rpy.matrixToRpy(rotation)).tolist())))
    joint.set("type", "fixed")
