"""A robot that weighs something else than its file says, as with a payload: the difference is on
what no leg moves.
"""

from __future__ import annotations

from copy import deepcopy
from xml.etree import ElementTree

from ..errors import InvalidInput
from ..files.arrays import checked
from .robot_model import RobotModel, model_of


def with_mass(model: RobotModel, mass_kg: float) -> RobotModel:
    """The model with another mass: the heaviest link that no leg moves has the difference, at its
    own centre of mass.

    It is another robot, with another digest; whoever reads its URDF reads it so. Raises
    InvalidInput for a mass that the legs alone have, or that is not a positive number.
    """
    wanted = checked(mass_kg, "mass_kg", above=0.0)
    root = deepcopy(model.tree)
    loads = {
        link.get("name", ""): mass
        for link in root.findall("link")
        if (mass := link.find("inertial/mass")) is not None and _rides(model, link.get("name", ""))
    }
    if not loads:
        raise InvalidInput(
            f"mass_kg: expected a robot with a body that has a mass, got {model.name} without one"
        )
    heaviest = max(loads.values(), key=lambda mass: float(mass.get("value", "0")))
    link_mass = float(heaviest.get("value", "0"))
    others = model.body.mass_kg - link_mass
    if wanted <= others:
        raise InvalidInput(
            f"mass_kg: expected more than the {others:.3g} kg of all but the body, got {wanted:g}"
        )
    heaviest.set("value", repr(wanted - others))
    again = model_of(
        ElementTree.tostring(root, encoding="unicode"),
        where=model.name,
        folder=None,
        hulls={},
        feet={leg.name: leg.foot for leg in model.legs},
        name=model.name,
        contacts={leg.name: leg.contact for leg in model.legs if leg.contact is not None},
        posture_rad={
            joint: angle
            for leg in model.legs
            for joint, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
        },
    )
    return again.changed(legs=model.legs, shapes=model.shapes, disabled_pairs=model.disabled_pairs)


def _rides(model: RobotModel, link: str) -> bool:
    """Tell whether a link goes with the base."""
    mount = model.mounts.get(link)
    return mount is not None and mount.leg is None
