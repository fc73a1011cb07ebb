"""From a posture problem or a course to its non-dimensional numbers (E3, E4), by the rows of its layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..files.arrays import Array
from ..problem import PostureProblem
from ..problem.course import Course
from .half_spaces import HalfSpaces, RelativeHalfSpaces
from .layout import Layout

Scaled = TypeVar("Scaled")


def of_posture(scaled: Callable[..., Scaled], problem: PostureProblem) -> Scaled:
    """A posture as ``scaled`` holds it: one frame, one stance, a foothold of one candidate a contact."""
    length_m, force_n = problem.length_scale_m, float(problem.force_scale_n or 1.0)
    contacts, nothing = problem.contacts, np.zeros((0, 3))
    feet = tuple(range(len(contacts)))
    regions = [contact.region for contact in contacts]
    corners = tuple((len(region.vertices_m),) for region in regions)
    points, offsets = _offsets([contact.offsets_m for contact in contacts], length_m)
    stance_contact = np.repeat(np.arange(len(contacts)), points or 1)
    return scaled(
        layout=Layout(
            holds=(feet,), stances=((0, feet),), corners=corners, reach_rows=HalfSpaces.counts(contacts), points=points
        ),
        options=1,
        which=((0,),) * len(contacts),
        vertices=np.concatenate([region.vertices_m for region in regions]) / length_m,
        frames=np.array([contact.patch.frame for contact in contacts]),
        friction=np.array([contact.patch.friction for contact in contacts]),
        shoulders=np.array([contact.shoulder_m for contact in contacts]) / length_m,
        reach=np.array([contact.reach_m for contact in contacts]) / length_m,
        force_min=np.array([contact.force_min for contact in contacts])[stance_contact],
        force_max=np.array([contact.force_max for contact in contacts])[stance_contact],
        weight=problem.weight_n / force_n,
        com=problem.com_nominal_m[None] / length_m,
        com_radius=np.array([problem.com_radius_m / length_m]),
        tilt=problem.tilt_limit_rad,
        steps=(0.0, 0.0, 0.0), direction=nothing, progress=np.zeros(0),
        goal=problem.com_nominal_m / length_m, weights=None,
        length_m=length_m,
        force_n=force_n,
        half_spaces=HalfSpaces.of(contacts, length_m, problem.tilt_limit_rad),
        offsets=offsets,
    )  # fmt: skip


def of_course(scaled: Callable[..., Scaled], course: Course) -> Scaled:
    """A course as ``scaled`` holds it, with every candidate open."""
    scale, limbs, limits = course.length_scale_m, course.robot.limbs, course.steps
    patches = [patch for foothold in course.footholds for patch in foothold.candidates]
    borders = [
        patch.vertices_m if foothold.toe_m is None else foothold.toe_m[None]
        for foothold, regions in zip(course.footholds, course.regions, strict=True)
        for patch in regions
    ]
    points, offsets = _offsets([each for row in course.offsets_m for each in row] if course.has_soles else [], scale)
    sizes = iter(len(border) for border in borders)
    layout = Layout(
        holds=tuple(tuple(row) for row in course.holds.tolist()),
        stances=tuple((stance.frame, stance.limbs) for stance in course.stances),
        corners=tuple(tuple(next(sizes) for _ in foothold.candidates) for foothold in course.footholds),
        reach_rows=HalfSpaces.counts(limbs),
        points=tuple(1 if limb.sole_m is None else len(limb.sole_m) for limb in limbs) if points else (),
        relative=RelativeHalfSpaces.pairs(course.robot),
        linear=len(limits.linear_rows(scale)),
        stands=course.weights.stance > 0.0,
    )
    pushes = _pushes(course, len(layout.stances))
    if len(pushes):
        copies = len(pushes) // len(layout.stances) - 1
        layout = replace(layout, stances=layout.stances * (1 + copies), pushes=copies)
    direction = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
    carrying = len(layout.contact_points)
    return scaled(
        layout=layout,
        options=max(len(foothold.candidates) for foothold in course.footholds),
        which=tuple(tuple(range(len(foothold.candidates))) for foothold in course.footholds),
        vertices=np.concatenate(borders) / scale,
        frames=np.array([patch.frame for patch in patches]),
        friction=np.array([patch.friction for patch in patches]),
        shoulders=np.array([limb.shoulder_m for limb in limbs]) / scale,
        reach=np.array([limb.reach_m for limb in limbs]) / scale,
        force_min=_force_min(course, layout),
        force_max=np.tile(course.force_max, (carrying, 1)),
        weight=1.0,
        com=course.com_nominal_m / scale,
        com_radius=course.com_radius_m / scale,
        tilt=course.tilt_limit_rad,
        steps=(limits.com_m / scale, limits.toe_m / scale, limits.rotation_rad),
        direction=direction,
        progress=np.where(np.linalg.norm(direction, axis=1) > 0.0, limits.progress_m / scale, 0.0),
        goal=course.goal_m / scale,
        weights=course.weights,
        length_m=scale,
        force_n=course.weight_n,
        half_spaces=HalfSpaces.of(limbs, scale, course.tilt_limit_rad),
        offsets=offsets,
        relative=RelativeHalfSpaces.of(course.robot, scale),
        linear=limits.linear_rows(scale),
        pushes=pushes,
        standing=_standing(course, layout),
    )


def _force_min(course: Course, layout: Layout) -> Array:
    """``Scaled.force_min`` of a course; under a push a foot may press less than it has to at rest."""
    least = np.tile(course.force_min, (len(layout.contact_points), 1))
    pushed = layout.contacts[0] >= layout.unpushed
    least[pushed, 0] = np.minimum(least[pushed, 0], 0.0)
    return least


def _standing(course: Course, layout: Layout) -> Array:
    """``Scaled.standing`` of a course."""
    if not layout.stands:
        return np.zeros((0, 3))
    assert course.standing_m is not None
    frame, limb, _ = layout.standing
    return course.standing_m[frame, limb] / course.length_scale_m


def _pushes(course: Course, stances: int) -> Array:
    """``Scaled.pushes`` of a course: first none, then the corners of a square about the disc of pushes it asks for."""
    if course.push_n == 0.0:
        return np.zeros((0, 3))
    corner = np.sqrt(2.0) * course.push_n / course.weight_n
    corners = corner * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=np.float64)
    return np.repeat(corners, stances, axis=0)


def _offsets(each: Sequence[Array], length_m: float) -> tuple[tuple[int, ...], Array]:
    """How many points each has, () where all have one, and ``Scaled.offsets``."""
    counts = tuple(len(offsets) for offsets in each)
    if max(counts, default=1) == 1:
        return (), np.zeros((0, 1, 3))
    table = np.zeros((len(each), max(counts), 3))
    for row, offsets in zip(table, each, strict=True):
        row[: len(offsets)] = offsets / length_m
    return counts, table
