"""Closed-form postures of one limb: yaw, hip and roll make a ball at the shoulder, the knee sets
the distance.

Four joints have one more than a foot's position needs: the knee can turn around the line from
shoulder to foot. This family of postures gives ``kinematics`` its seeds and what it is drawn to; it
never believes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..files.arrays import Array
from ..terrain.patch import Solid, Solids
from .actuators import JOINTS, USUAL_REACH_M, Servo
from .chain import rotation_of
from .drawn_legs import LINKS, link_lengths, outward_rad
from .limb import Limb

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
