"""The robot in MuJoCo: the links of its URDF with primitive shapes, and one ball per foot."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from .ground import FEET, LAND
from .robots import Robot
from .settings import Contact, Joints, Settings

Array = NDArray[np.float64]
COMPILER = (
    '<mujoco><compiler fusestatic="false" discardvisual="true" balanceinertia="true" '
    'boundmass="1e-5" boundinertia="1e-8"/></mujoco>'
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """A robot on its ground.

    Attributes:
        model: MuJoCo's.
        robot: what it is of.
        places: indices of the joints' positions, leg by leg, shape (J,).
        rates: indices of their velocities, shape (J,).
        legs: which of the J joints each leg has.
        others: position and velocity indices of joints that are no leg's, shape (K, 2).
        base: number of the body that floats.
        feet: numbers of the feet's bodies.
        balls: numbers of their balls.
        radii_m: of the balls, shape (N,) [m].
        stiffness: Kp of the joints, shape (J,) [Nm/rad] or [N/m].
        damping: Kd, shape (J,).
        rotor: inertia of the rotors, shape (J,).
        most: largest torque or force of the joints, shape (J,).
        mass_kg: of all of it.
    """

    model: Any
    robot: Robot
    places: NDArray[np.int64]
    rates: NDArray[np.int64]
    legs: tuple[NDArray[np.int64], ...]
    others: NDArray[np.int64]
    base: int
    feet: tuple[int, ...]
    balls: tuple[int, ...]
    radii_m: Array
    stiffness: Array
    damping: Array
    rotor: Array
    most: Array
    mass_kg: float


def build(
    robot: Robot,
    lay: Callable[[Any], None],
    settings: Settings,
    contact: Contact,
    gravity_m_s2: float,
    mass: float = 1.0,
) -> Body:
    """Compile a robot on a ground.

    Arguments:
        robot: of the file.
        lay: adds the ground.
        settings: the referee's.
        contact: of feet and ground.
        gravity_m_s2: how strong gravity is.
        mass: factor of all masses; gains are those of the robot as the file has it.

    Raises:
        ValueError: for a URDF that MuJoCo does not take, in its words.
    """
    spec = mujoco.MjSpec.from_string(_primitive(robot.urdf))
    spec.compiler.fusestatic = False
    spec.option.timestep = settings.physics_s
    spec.option.gravity = [0.0, 0.0, -gravity_m_s2]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = contact.stiff_friction
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    root = next(
        body for body in spec.bodies if body.parent is not None and body.parent.name == "world"
    )
    root.add_freejoint(name="float")
    radii = np.array([leg.radius_m or settings.point_m for leg in robot.legs])
    for shape in spec.geoms:
        shape.contype, shape.conaffinity = FEET, LAND
        shape.density = 0.0  # links weigh what the URDF says, and nothing where it says nothing
    for leg, radius in zip(robot.legs, radii, strict=True):
        foot = spec.body(leg.foot)
        for shape in list(foot.geoms):
            spec.delete(shape)
        foot.add_geom(
            name=f"ball of {leg.foot}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0.0, 0.0],
            pos=leg.centre_m,
            mass=0.0,
            contype=FEET,
            conaffinity=LAND,
        )
    lay(spec)
    model = spec.compile()
    base = int(model.body(root.name).id)
    share = robot.mass_kg / float(model.body_subtreemass[base])
    joints = [model.joint(name) for leg in robot.legs for name in leg.joints]
    stiffness = _stiffness(robot, joints, model, settings.joints, robot.mass_kg * gravity_m_s2)
    rates = np.array([int(joint.dofadr[0]) for joint in joints])
    efforts = _efforts(robot.urdf)
    model.body_mass[:] *= share * mass
    model.body_inertia[:] *= share * mass
    model.dof_armature[rates] = settings.joints.rotor_s2 * stiffness
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    ends = np.cumsum([len(leg.joints) for leg in robot.legs])
    own = {int(joint.id) for joint in joints}
    free = mujoco.mjtJoint.mjJNT_FREE
    others = [
        (int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j]))
        for j in range(model.njnt)
        if j not in own and model.jnt_type[j] != free
    ]
    return Body(
        model=model,
        robot=robot,
        places=np.array([int(joint.qposadr[0]) for joint in joints]),
        rates=rates,
        legs=tuple(
            np.arange(end - len(leg.joints), end) for leg, end in zip(robot.legs, ends, strict=True)
        ),
        others=np.array(others, dtype=np.int64).reshape(-1, 2),
        base=base,
        feet=tuple(int(model.body(leg.foot).id) for leg in robot.legs),
        balls=tuple(int(model.geom(f"ball of {leg.foot}").id) for leg in robot.legs),
        radii_m=radii,
        stiffness=stiffness,
        damping=settings.joints.damping_s * stiffness,
        rotor=settings.joints.rotor_s2 * stiffness,
        most=np.array([efforts.get(joint.name) or np.inf for joint in joints]),
        mass_kg=robot.mass_kg,
    )


def _stiffness(
    robot: Robot, joints: list[Any], model: Any, gains: Joints, weight_n: float
) -> Array:
    """Kp of the joints, by the weight and each leg's length."""
    lengths = [leg.length_m for leg in robot.legs for _ in leg.joints]
    slides = [model.jnt_type[joint.id] == mujoco.mjtJoint.mjJNT_SLIDE for joint in joints]
    return np.array(
        [
            weight_n / gains.sag_m if slide else gains.stiffness * weight_n * length
            for slide, length in zip(slides, lengths, strict=True)
        ]
    )


def _primitive(urdf: str) -> str:
    """A URDF without meshes, without parts of joints that are there twice, and with what MuJoCo has
    to know.
    """
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            if shape.tag == "visual" or shape.find("geometry/mesh") is not None:
                link.remove(shape)
    for joint in root.findall(
        "joint"
    ):  # a second axis, say, is read by nobody, and refused by MuJoCo
        seen = set[str]()
        for part in list(joint):
            if part.tag in seen:
                joint.remove(part)
            seen.add(part.tag)
    for other in [each for each in root if each.tag not in ("link", "joint", "material")]:
        root.remove(other)
    text = ElementTree.tostring(root, encoding="unicode")
    return re.sub(r"(<robot\b[^>]*>)", lambda found: found[1] + COMPILER, text, count=1)


def _efforts(urdf: str) -> dict[str, float]:
    """Largest torque or force of the joints that a URDF says one of."""
    limits = {
        str(joint.get("name")): joint.find("limit")
        for joint in ElementTree.fromstring(urdf).findall("joint")
    }
    return {
        name: float(limit.get("effort", "0")) for name, limit in limits.items() if limit is not None
    }
