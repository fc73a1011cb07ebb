"""From a problem to its non-dimensional numbers (E3, E4), by the rows of its layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..files.arrays import Array
from ..problem import Problem
from .half_spaces import HalfSpaces, RelativeHalfSpaces
from .layout import Layout, shared

Scaled = TypeVar("Scaled")


def of_problem(scaled: Callable[..., Scaled], course: Problem) -> Scaled:
    """A problem as ``scaled`` holds it, with every candidate open."""
    scale, limbs, limits = course.length_scale_m, course.robot.limbs, course.steps
    patches = [patch for foothold in course.footholds for patch in foothold.candidates]
    borders = [
        patch.vertices_m if foothold.toe_m is None else foothold.toe_m[None]
        for foothold, regions in zip(course.footholds, course.regions, strict=True)
        for patch in regions
    ]
    points, offsets = _offsets(
        [each for row in course.offsets_m for each in row] if course.has_soles else [], scale
    )
    sizes = iter(len(border) for border in borders)
    toe_sides, turn_sides = course.side_rows
    linear = _linear(limits.linear_rows(scale), turn_sides, course.frames - 1)
    layout = shared(
        Layout(
            holds=tuple(tuple(row) for row in course.holds.tolist()),
            stances=tuple((stance.frame, stance.limbs) for stance in course.stances),
            corners=tuple(
                tuple(next(sizes) for _ in foothold.candidates) for foothold in course.footholds
            ),
            reach_rows=HalfSpaces.counts(limbs),
            points=tuple(1 if limb.sole_m is None else len(limb.sole_m) for limb in limbs)
            if points
            else (),
            relative=RelativeHalfSpaces.pairs(course.robot),
            least_toes=len(toe_sides) > 0,
            linear=linear.shape[1],
            stands=course.weights is not None and course.weights.stance > 0.0,
            level=course.tilt_limit_rad == 0.0,
        )
    )
    wrench = _wrench(course, layout)
    if len(wrench):
        copies = len(wrench) // len(layout.stances) - 1
        stances = layout.stances * (1 + copies)
        layout = replace(layout, stances=stances, pushes=copies, wrench=course.wrench is not None)
    direction = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
    low, high = course.force_bounds
    under = layout.contacts[2]
    return scaled(
        layout=layout,
        options=max(len(foothold.candidates) for foothold in course.footholds),
        which=tuple(tuple(range(len(foothold.candidates))) for foothold in course.footholds),
        vertices=np.concatenate(borders) / scale,
        frames=np.array([patch.frame for patch in patches]),
        friction=np.array([patch.friction for patch in patches]),
        shoulders=np.array([limb.shoulder_m for limb in limbs]) / scale,
        reach=np.array([limb.reach_m for limb in limbs]) / scale,
        force_min=_force_min(low, layout),
        force_max=high[under],
        weight=course.weight_n / course.force_n,
        com=course.com_nominal_m / scale,
        com_radius=course.com_radius_m / scale,
        tilt=course.tilt_limit_rad,
        steps=(limits.com_m / scale, limits.toe_m / scale, limits.rotation_rad),
        direction=direction,
        progress=np.where(direction.any(axis=1), limits.progress_m / scale, 0.0),
        goal=course.goal_m / scale,
        weights=course.weights,
        length_m=scale,
        force_n=course.force_n,
        half_spaces=HalfSpaces.of(limbs, scale, course.tilt_limit_rad),
        offsets=offsets,
        relative=RelativeHalfSpaces.of(course.robot, scale).with_sides(toe_sides, scale),
        linear=linear,
        wrench=wrench,
        standing=_standing(course, layout),
    )


def _linear(rows: Array, turn_sides: Array, steps: int) -> Array:
    """``Scaled.linear``: the further rows of every step of the body, and its least rotation.

    Arguments:
        rows: of each step, shape (R, 7).
        turn_sides: n·(Θ′ − Θ) ≥ b by step, shape (M − 1, 4) or (0, 4).
    """
    if not steps:
        return np.zeros((0, *rows.shape))
    each = np.broadcast_to(rows, (steps, *rows.shape))
    if not len(turn_sides):
        return each
    turns = np.concatenate([np.zeros((steps, 3)), -turn_sides], axis=1)
    return np.concatenate([each, turns[:, None]], axis=1)


def _force_min(low: Array, layout: Layout) -> Array:
    """``Scaled.force_min``: the lower force bounds of all contacts, taken from those of the
    footholds. Under a push a foot may press less than its bound at rest.
    """
    least = low[layout.contacts[2]]
    if not layout.pushes:
        return np.asarray(least)
    pushed = layout.contacts[0] >= layout.unpushed
    least[pushed, 0] = np.minimum(least[pushed, 0], 0.0)
    return least


def _standing(course: Problem, layout: Layout) -> Array:
    """``Scaled.standing`` of a course."""
    if not layout.stands:
        return np.zeros((0, 3))
    assert course.standing_m is not None
    frame, limb, _ = layout.standing
    return course.standing_m[frame, limb] / course.length_scale_m


def _wrench(course: Problem, layout: Layout) -> Array:
    """``Scaled.wrench`` of a course: its own, and then with the corners of a square about the disc
    of pushes that it asks for, each on all stances.
    """
    corner = np.sqrt(2.0) * course.push_n / course.force_n
    corners = [(0.0, 0.0), (corner, 0.0), (0.0, corner), (-corner, 0.0), (0.0, -corner)]
    if course.push_n == 0.0:
        if course.wrench is None:
            return np.zeros((0, 6))
        corners = corners[:1]
    common = np.zeros((len(layout.stances), 6))
    if course.wrench is not None:
        unit = course.force_n * np.array([1.0, 1.0, 1.0, *(course.length_scale_m,) * 3])
        common = (course.wrench / unit)[layout.stance_frames]
    wrenches = np.tile(common, (len(corners), 1))
    wrenches[:, :2] += np.repeat(corners, len(common), axis=0)
    return wrenches


def _offsets(each: Sequence[Array], length_m: float) -> tuple[tuple[int, ...], Array]:
    """Number of points per contact, () where all have one, and ``Scaled.offsets``."""
    counts = tuple(len(offsets) for offsets in each)
    if max(counts, default=1) == 1:
        return (), np.zeros((0, 1, 3))
    table = np.zeros((len(each), max(counts), 3))
    for row, offsets in zip(table, each, strict=True):
        row[: len(offsets)] = offsets / length_m
    return counts, table
