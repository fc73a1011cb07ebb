"""Legs of four joints drawn up for limbs that are balls of reach, as a URDF and as a model that
stands.

Every limb becomes three joints at the shoulder and a knee, with primitive shapes and a spherical
foot. The centre of mass is taken at the body's origin: nearly all of the mass is in the body, the
limbs are light.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidInput
from ..files.arrays import Array
from .actuators import FOOT_RADIUS_M, JOINTS, USUAL_REACH_M, Servo
from .inverse_kinematics import InverseKinematics, seeds_of
from .limb import Limb
from .robot_model import RobotModel


class ToeKinematics:
    """All legs of a robot whose body's origin is the centre of mass of the standing robot."""

    def __init__(self, model: RobotModel) -> None:
        self.model, self._solver = model, InverseKinematics(seeds_of(model.legs))

    def solve(
        self,
        com_m: ArrayLike,
        rotation: ArrayLike,
        toes_m: ArrayLike,
        normals: ArrayLike,
        near: ArrayLike | None = None,
    ) -> tuple[list[Array], Array]:
        """Angles of K stances of N legs, each found from the standing posture, so that knees keep
        their bend, and errors of the feet, as ``InverseKinematics.solve`` has them.

        Arguments:
            com_m: p_WC, shape (K, 3) [m].
            rotation: R_WB, shape (K, 3, 3).
            toes_m: p_WF, and normals of the ground there, on which a foot is a sphere, shape (K, N,
                3).
            near: all joints in the model's order, shape (K, J) [rad], in place of those of the
                standing posture.
        """
        feet = self.centres(com_m, rotation, toes_m, normals)
        standing = np.concatenate([leg.stance_rad for leg in self.model.legs])
        start = (
            np.broadcast_to(standing, (len(feet), len(standing)))
            if near is None
            else np.asarray(near)
        )
        ends = np.cumsum([len(leg.joints) for leg in self.model.legs])[:-1]
        return self._solver.solve(feet, near=np.split(start, ends, axis=1))

    def centres(
        self, com_m: ArrayLike, rotation: ArrayLike, toes_m: ArrayLike, normals: ArrayLike
    ) -> Array:
        """Centres of the feet in the base's frame, shape (K, N, 3) [m]; arguments as of
        ``solve``.
        """
        radii = np.array([[leg.radius_m] for leg in self.model.legs])
        centres = np.asarray(toes_m) + radii * np.asarray(normals)
        arms = centres - np.asarray(com_m)[:, None]
        turned = np.einsum("kji,knj->kni", np.asarray(rotation), arms)
        return np.asarray(turned + self.model.body.com_m)


def base_of(model: RobotModel, com_m: Array, rotation: Array) -> Array:
    """p_WB of the base whose centre of mass is at p_WC, shape (3,) [m]."""
    return np.asarray(com_m - rotation @ model.body.com_m)


LINKS = (0.54, 0.53)
"""Lengths of thigh and shank in units of the limb's reach. Their sum leaves 7 % for the foot's
radius and keeps the leg from being straight at the edge of its workspace."""
_LIMB_SHARES = {"coxa": 0.004, "hip": 0.003, "thigh": 0.006, "shank": 0.004, "foot": 0.001}
"""Mass of a limb's links in units of the robot's mass: six limbs are 10.8 % of it."""
_LINK_RADIUS_M, _SHOULDER_M, _LEAST_BODY_M = 0.009, 0.02, 0.04
BODY_HEIGHT_M = 0.06
"""Height of a body whose limbs reach ``USUAL_REACH_M``, as all lengths here [m]."""


def link_lengths(limb: Limb) -> Array:
    """Thigh and shank, shape (2,) [m]; from the shoulder's centre to the foot's."""
    return np.array(LINKS) * limb.reach_m


def outward_rad(limb: Limb) -> float:
    """Azimuth of the limb's plane at yaw 0: away from the body's centre [rad]."""
    return float(np.arctan2(limb.shoulder_m[1], limb.shoulder_m[0]))


def drawn_urdf(
    name: str, mass_kg: float, limbs: Sequence[Limb], servo: Servo, *, rotors_in_links: bool = False
) -> str:
    """The URDF of a body with these limbs; links ``body``, ``LF_coxa``, …, ``LF_foot``, in SI
    units.

    Arguments:
        servo: drive of every joint.
        rotors_in_links: add the rotors' inertia to the links, about every axis so that a simulator
            takes it for a body's; for those that know no inertia of rotors.

    Raises:
        InvalidInput: for what such legs do not have: feet that are soles, and half-spaces of reach.
    """
    if any(limb.sole_m is not None for limb in limbs):
        raise InvalidInput(f"robot {name}: expected point feet for a URDF of its own, got soles")
    if any(limb.reach_rows is not None for limb in limbs):
        raise InvalidInput(
            f"robot {name}: expected balls of reach for a URDF of its own, got half-spaces without "
            "the "
            f"robot's own legs, as a course has them that names a robot's file"
        )
    rotor = servo.rotor_kg_m2 if rotors_in_links else 0.0
    shares = sum(_LIMB_SHARES.values()) * len(limbs)
    size = float(np.mean([limb.reach_m for limb in limbs])) / USUAL_REACH_M
    out = float(np.mean([np.hypot(*limb.shoulder_m[:2]) for limb in limbs]))
    radius, height = 0.75 * max(out, size * _LEAST_BODY_M), size * BODY_HEIGHT_M
    mass = mass_kg * (1.0 - shares)
    side, axial = mass * (3.0 * radius**2 + height**2) / 12.0, mass * radius**2 / 2.0
    body = _link(
        "body",
        mass,
        (side, side, axial),
        0.0,
        f'<cylinder radius="{radius:.9g}" length="{height:.9g}"/>',
    )
    parts = [part for limb in limbs for part in _limb(limb, mass_kg, servo, rotor)]
    return "\n".join(
        ['<?xml version="1.0"?>', f"<robot name={_quoted(name)}>", body, *parts, "</robot>", ""]
    )


def _limb(limb: Limb, mass_kg: float, servo: Servo, rotor: float) -> list[str]:
    """Links and joints of one limb."""
    name, lengths, size = limb.name, link_lengths(limb), limb.reach_m / USUAL_REACH_M
    slim, round_, foot = (size * each for each in (_LINK_RADIUS_M, _SHOULDER_M, FOOT_RADIUS_M))
    mass = {link: share * mass_kg for link, share in _LIMB_SHARES.items()}
    parts = [
        _link(
            f"{name}_{link}",
            mass[link],
            (0.4 * mass[link] * round_**2 + rotor,) * 3,
            0.0,
            f'<sphere radius="{round_:.9g}"/>',
        )
        for link in ("coxa", "hip")
    ]
    for link, length in zip(("thigh", "shank"), lengths, strict=True):
        along = mass[link] * slim**2 / 2.0
        across = mass[link] * (length**2 / 12.0 + slim**2 / 4.0)
        shape = f'<cylinder radius="{slim:.9g}" length="{length:.9g}"/>'
        inertia = (along + rotor, across + rotor, across + rotor)
        parts.append(_link(f"{name}_{link}", mass[link], inertia, 0.5 * length, shape))
    grain = 0.4 * mass["foot"] * foot**2
    parts.append(
        _link(f"{name}_foot", mass["foot"], (grain,) * 3, 0.0, f'<sphere radius="{foot:.9g}"/>')
    )
    chain = ("body", f"{name}_coxa", f"{name}_hip", f"{name}_thigh", f"{name}_shank")
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 1 0")
    for i, joint in enumerate(JOINTS):
        x, y, z = (
            limb.shoulder_m
            if joint == "yaw"
            else (lengths[0] if joint == "knee" else 0.0, 0.0, 0.0)
        )
        parts.append(
            f'<joint name={_quoted(f"{name}_{joint}")} type="revolute"><parent link={_quoted(chain[i])}/>'
            f"<child link={_quoted(chain[i + 1])}/>"
            f'<origin xyz="{x:.12g} {y:.12g} {z:.12g}" rpy="0 0 {outward_rad(limb) if i == 0 else 0.0:.15g}"/>'
            f'<axis xyz="{axes[i]}"/>'
            f'<limit lower="{servo.lower_rad[i]}" upper="{servo.upper_rad[i]}" effort="{servo.torque_nm}" '
            f'velocity="{servo.velocity_rad_s}"/></joint>'
        )
    parts.append(
        f'<joint name={_quoted(f"{name}_tip")} type="fixed"><parent link={_quoted(chain[-1])}/>'
        f"<child link={_quoted(f'{name}_foot')}/>"
        f'<origin xyz="{lengths[1]:.12g} 0 0"/></joint>'
    )
    return parts


def _link(name: str, mass: float, inertia: tuple[float, ...], middle: float, shape: str) -> str:
    """A link whose mass and shape are centred at x = middle; a cylinder lies along x, but the
    body's stands.
    """
    lies = (
        ' rpy="0 1.5707963267948966 0"' if name != "body" and shape.startswith("<cylinder") else ""
    )
    origin = f'<origin xyz="{middle:.12g} 0 0"{lies}/>'
    xx, yy, zz = inertia
    return (
        f'<link name={_quoted(name)}><inertial><origin xyz="{middle:.12g} 0 0"/><mass value="{mass:.12g}"/>'
        f'<inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/></inertial>'
        f"<visual>{origin}<geometry>{shape}</geometry></visual>"
        f"<collision>{origin}<geometry>{shape}</geometry></collision></link>"
    )


def _quoted(name: str) -> str:
    """A name as the value of an attribute, quotes included."""
    return f'"{escape(name)}"'
