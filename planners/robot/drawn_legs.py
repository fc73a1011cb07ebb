"""Legs of four joints drawn up for limbs that are balls of reach, as a URDF and as a model that
stands.

Every limb becomes three joints at the shoulder and a knee, with primitive shapes and a spherical
foot. The centre of mass is taken at the body's origin: nearly all of the mass is in the body, the
limbs are light.

Four joints have one more than a foot's position needs: the knee can turn around the line from
shoulder to foot. This family of postures, in closed form, gives ``kinematics`` its seeds and what it
is drawn to; it never believes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from html import escape

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..terrain.patch import Solid, Solids
from .actuators import FOOT_RADIUS_M, JOINTS, USUAL_REACH_M, Servo
from .leg import rotation_of
from .model import Limb
from .robot_model import RobotModel, model_of

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


_Clearance = Callable[[Array], Array]
_SWIVELS_RAD = np.linspace(0.0, 2.0 * np.pi, 121)[:-1]
"""Where the knee may be around the line from shoulder to foot."""
_MARGIN_RAD = 0.15
SHANK = np.array([0.0, 0.25, 0.5, 0.75, 0.88])
_CLEARANCE_M = np.array([0.03, 0.03, 0.03, 0.026, 0.018])
"""Points of the shank, as shares of it from the knee, and how far those of a limb of the usual
reach should keep off the terrain: the last are near the foot's own surface."""
_WEIGHTS = {
    "approach": 1.0,  # shank not along the approach
    "up": 0.4,  # knee not above the shoulder
    "yaw": 0.15,
    "roll": 0.15,
    "near": 0.4,  # far from the posture before
    "limits": 400.0,  # closer than MARGIN_RAD to a limit
    "beyond": 1e6,  # a limit
    "clear": 30000.0,  # closer to the terrain than CLEARANCE_M
    "steep": 60.0,  # thigh nearly along the axis of yaw
}
"""Weights of a posture's discomfort."""
_STEEP = 0.9
NEAR = 1.3
"""Share of a limb's reach: what is farther from its shoulder than this share takes no part."""


def limb_posture(
    lengths: Array,
    target: Array,
    approach: Array,
    servo: Servo,
    *,
    near: Array | None = None,
    clearance: _Clearance | None = None,
) -> Array:
    """The most comfortable posture that puts the foot at ``target``, or the closest to it, shape
    (4,) [rad].

    Arguments:
        lengths: thigh and shank, shape (2,) [m].
        target: foot's centre in the limb's frame (x outward, z the body's), shape (3,) [m].
        approach: unit vector in the same frame along which the foot should come, into the surface;
            zeros where it does not matter.
        near: a posture to stay close to, shape (4,).
        clearance: how far points of the limb's frame, shape (K, 3), are from the terrain, shape
            (K,) [m].
    """
    family, cost = posture_cost(lengths, target, approach, servo, near=near, clearance=clearance)
    return np.asarray(family[np.argmin(cost)])


def posture_cost(
    lengths: Array,
    target: Array,
    approach: Array,
    servo: Servo,
    *,
    near: Array | None = None,
    clearance: _Clearance | None = None,
) -> tuple[Array, Array]:
    """The family of postures within the limits, shape (…, K, 4) [rad], and how uncomfortable each
    is, shape (…, K).

    Arguments as of ``limb_posture``, or any number of targets at once: target, approach, shape (…,
    3); near, (…, 4).
    """
    family = swivels(lengths, target)
    cost = _discomfort(family, approach, servo, near)
    if clearance is not None:
        points = links(lengths, family)
        far = clearance(points.reshape(*points.shape[:-3], -1, 3)).reshape(points.shape[:-1])
        short = np.maximum(_CLEARANCE_M - far / (lengths[1] / (LINKS[1] * USUAL_REACH_M)), 0.0)
        cost = cost + _WEIGHTS["clear"] * np.sum(short**2, axis=-1)
    return np.clip(family, servo.lower_rad, servo.upper_rad), cost


def limb_postures(
    limbs: Sequence[Limb],
    servo: Servo,
    feet: Array,
    approach: Array,
    *,
    near: Array | None,
    pose: tuple[Array, Array],
    obstacles: Sequence[Solid],
) -> Array:
    """The most comfortable postures of all limbs, shape (J,) [rad].

    Arguments:
        feet, approach: as in ``limb_posture``, in the body frame, shape (N, 3).
        near: shape (N, 4).
        pose: of the body in the world, where the obstacles are: its origin, shape (3,) [m], and
            R_WB.
    """
    origin, turn = pose
    frames = np.array([rotation_of([0.0, 0.0, outward_rad(limb)]) for limb in limbs])
    shoulders = np.array([limb.shoulder_m for limb in limbs])
    targets, ways = ((part[:, None] @ frames)[:, 0] for part in (feet - shoulders, approach))
    postures = np.empty((len(limbs), len(JOINTS)))
    for reach_m in {limb.reach_m: None for limb in limbs}:  # limbs of a size at once
        alike = np.array([i for i, limb in enumerate(limbs) if limb.reach_m == reach_m])
        clearance = clearance_of(
            origin + shoulders[alike] @ turn.T, turn @ frames[alike], obstacles, NEAR * reach_m
        )
        family, cost = posture_cost(
            link_lengths(limbs[alike[0]]),
            targets[alike],
            ways[alike],
            servo,
            near=None if near is None else near[alike],
            clearance=clearance,
        )
        postures[alike] = family[np.arange(len(alike)), np.argmin(cost, axis=1)]
    return postures.ravel()


def swivels(lengths: Array, target: Array) -> Array:
    """The postures that reach ``target``, or come closest, one for each of SWIVELS_RAD; (…, 3) to
    (…, K, 4).
    """
    thigh, shank = lengths
    far = np.maximum(np.linalg.norm(target, axis=-1, keepdims=True), 1e-6)
    distance = np.clip(far, abs(thigh - shank) + 1e-6, thigh + shank - 1e-6)
    along = target / far
    aside = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=-1)])
    aside = aside / np.linalg.norm(aside, axis=-1, keepdims=True)
    ahead = (thigh**2 + distance**2 - shank**2) / (2.0 * distance)
    wide = np.sqrt(np.maximum(thigh**2 - ahead**2, 0.0))
    cos, sin = np.cos(_SWIVELS_RAD)[:, None], np.sin(_SWIVELS_RAD)[:, None]
    ring = cos * aside[..., None, :] + sin * np.cross(along, aside)[..., None, :]
    knees = (ahead * along)[..., None, :] + wide[..., None] * ring
    upper, lower = knees / thigh, ((distance * along)[..., None, :] - knees) / shank
    yaw, hip = (
        np.arctan2(upper[..., 1], upper[..., 0]),
        -np.arcsin(np.clip(upper[..., 2], -1.0, 1.0)),
    )
    across = lower[..., 1] * np.cos(yaw) - lower[..., 0] * np.sin(
        yaw
    )  # of the shank, in the thigh's frame
    above = (
        np.sin(hip) * (lower[..., 0] * np.cos(yaw) + lower[..., 1] * np.sin(yaw))
        + np.cos(hip) * lower[..., 2]
    )
    bend = np.arccos(
        np.clip((distance**2 - thigh**2 - shank**2) / (2.0 * thigh * shank), -1.0, 1.0)
    )
    return np.stack(
        [yaw, hip, np.arctan2(across, -above), np.broadcast_to(bend, yaw.shape)], axis=-1
    )


def links(lengths: Array, family: Array) -> Array:
    """Points along the shank, but for its end, which is near the surface, shape (…, K, 5, 3)
    [m].
    """
    upper, lower = directions(family)
    knees = lengths[0] * upper
    return np.asarray(knees[..., None, :] + SHANK[:, None] * lengths[1] * lower[..., None, :])


def directions(family: Array) -> tuple[Array, Array]:
    """Unit vectors along thigh and shank in the limb's frame, shape (…, 3) each, for angles of
    shape (…, 4).
    """
    (cy, ch, cr, ck), (sy, sh, sr, sk) = (
        np.moveaxis(np.cos(family), -1, 0),
        np.moveaxis(np.sin(family), -1, 0),
    )
    upper = np.stack([cy * ch, sy * ch, -sh], axis=-1)
    out, across, above = ck * ch - sk * cr * sh, sk * sr, -ck * sh - sk * cr * ch
    return upper, np.stack([cy * out - sy * across, sy * out + cy * across, above], axis=-1)


def _discomfort(family: Array, approach: Array, servo: Servo, near: Array | None) -> Array:
    upper, lower = directions(family)
    over = np.maximum(family - np.array(servo.upper_rad) + _MARGIN_RAD, 0.0)
    under = np.maximum(np.array(servo.lower_rad) + _MARGIN_RAD - family, 0.0)
    cost = (
        -_WEIGHTS["approach"] * (lower @ approach[..., None])[..., 0]
        - _WEIGHTS["up"] * upper[..., 2]
        + _WEIGHTS["yaw"] * family[..., 0] ** 2
        + _WEIGHTS["roll"] * family[..., 2] ** 2
        + _WEIGHTS["limits"] * np.sum(over**2 + under**2, axis=-1)
        + _WEIGHTS["beyond"] * np.any(np.maximum(over, under) > _MARGIN_RAD, axis=-1)
        + _WEIGHTS["steep"] * np.maximum(np.abs(upper[..., 2]) - _STEEP, 0.0) ** 2
    )
    if near is not None:
        cost = cost + _WEIGHTS["near"] * np.sum((family - near[..., None, :]) ** 2, axis=-1)
    return np.asarray(cost)


def clearance_of(
    origin: Array, frame: Array, solids: Sequence[Solid], within_m: float
) -> _Clearance:
    """Distance from the nearest solid of points in a frame, shape (…, K, 3) to (…, K) [m]; infinite
    where none is near.

    Arguments:
        origin, frame: origin and axes of the points' frame in the world, shape (…, 3) and (…, 3,
            3).
        within_m: a solid farther from the origin takes no part.
    """
    close = Solids(solids).distances(origin.reshape(-1, 3)) < within_m
    around = [Solids([solids[i] for i in np.flatnonzero(row).tolist()]) for row in close]

    def distance(points: Array) -> Array:
        world = origin[..., None, :] + points @ np.swapaxes(frame, -1, -2)
        parts = zip(around, world.reshape(-1, *world.shape[-2:]), strict=True)
        nearest = [of.distances(shape).min(axis=-1, initial=np.inf) for of, shape in parts]
        return np.asarray(nearest).reshape(world.shape[:-1])

    return distance


_OUTWARD, _DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def drawn_model(name: str, mass_kg: float, limbs: Sequence[Limb], servo: Servo) -> RobotModel:
    """The model of ``drawn_urdf``, every joint driven by this servo.

    Raises InvalidInput for limbs that are no balls with a point foot.
    """
    reaches = tuple((limb.name, limb.reach_m) for limb in limbs)
    return _drawn_up(drawn_urdf(name, mass_kg, limbs, servo), name, reaches, servo)


@lru_cache(maxsize=16)  # a run asks for the model of its robot half a dozen times
def _drawn_up(
    urdf: str, name: str, reaches: tuple[tuple[str, float], ...], servo: Servo
) -> RobotModel:
    """Read from its text, standing as in Lin et al.'s ground problems: feet outward of their
    shoulders and below them.

    Arguments:
        reaches: names of the limbs and how far they reach [m].
    """
    down, posture = np.array([0.0, 0.0, -1.0]), dict[str, float]()
    for limb, reach_m in reaches:
        angles = limb_posture(
            np.array(LINKS) * reach_m, reach_m * np.array([_OUTWARD, 0.0, -_DOWN]), down, Servo()
        )
        posture |= {
            f"{limb}_{joint}": float(angle) for joint, angle in zip(JOINTS, angles, strict=True)
        }
    feet = {limb: f"{limb}_foot" for limb, _ in reaches}
    return model_of(urdf, where=name, feet=feet, posture_rad=posture, name=name).changed(
        servo=servo
    )
