"""Patches as they are drawn: equilateral triangles about a centre, and the problem that they are
put into.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stancekit.planners.files.arrays import Array, cross
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.robot import Robot
from stancekit.planners.terrain import Patch

from .stance import NominalStance

_AXES = np.eye(3)
FORWARD, UPWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
"""Shear references on the ground and on walls."""


def plain_problem(
    robot: Robot, legs: Sequence[str], stance: NominalStance, *, shear: Sequence[float]
) -> Problem:
    """A problem whose patches are all in their nominal places, have the smallest size that is ever
    drawn, and have no friction.
    """
    triangles = stance.centre_m[:, None] + triangle(
        stance.normal, np.full(len(legs), stance.circumradius_m[0]), np.zeros(len(legs))
    )
    contacts = tuple(
        Contact(
            leg=limb.name,
            shoulder_m=limb.shoulder_m,
            reach_m=limb.reach_m,
            patch=Patch(
                vertices_m=corners, normal=normal, shear_reference=np.array(shear), friction=0.0
            ),
            force_min=np.array([0.0, -1.0, -1.0]),
            force_max=np.ones(3),
            reach_rows=limb.reach_rows,
        )
        for limb, corners, normal in zip(robot.select(legs), triangles, stance.normal, strict=True)
    )
    return Problem.posture(
        contacts=contacts,
        mass_kg=robot.mass_kg,
        com_nominal_m=np.zeros(3),
        com_radius_m=stance.com_radius_m,
        length_scale_m=stance.length_scale_m,
        tilt_limit_rad=stance.tilt_limit_rad,
        robot=robot.identity,
    )


def leaning(
    axis: Array, angle_rad: Array, azimuth_rad: Array, plane: tuple[Array, Array] | None = None
) -> Array:
    """Unit vectors at these angles from axes of shape (..., 3), leaning towards these azimuths.

    Arguments:
        plane: ``plane_of`` the axes, where it is known.
    """
    first, second = plane or plane_of(axis)
    angle, azimuth = angle_rad[..., None], azimuth_rad[..., None]
    sideways = np.cos(azimuth) * first + np.sin(azimuth) * second
    return _unit(np.cos(angle) * axis + np.sin(angle) * sideways)


def triangle(normals: Array, radius_m: Array, turn_rad: Array) -> Array:
    """Equilateral triangles about the origin in the planes of these normals, shape (..., 3, 3)
    [m].
    """
    angles = (turn_rad[..., None] + 2.0 * np.pi / 3.0 * np.arange(3))[..., None]
    first, second = (axis[..., None, :] for axis in plane_of(normals))
    return np.asarray(
        radius_m[..., None, None] * (np.cos(angles) * first + np.sin(angles) * second)
    )


def plane_of(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with each normal, shape (..., 3)."""
    helper = _AXES[np.abs(normals).argmin(axis=-1)]
    first = _unit(cross(normals, helper))
    return first, cross(normals, first)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.vecdot(vectors, vectors))[..., None])
