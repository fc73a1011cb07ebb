"""Steps of a plan that have a least length, and the course on which they stay on their side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..problem import Problem

STILL = 0.1
"""A step shorter than this share of its least length has no direction of its own."""


def lengths_of(plan: Plan, course: Problem) -> tuple[Array, Array]:
    """The steps Δ of a plan that have a least length, toes' [m], then the rotation's [rad], shape
    (E, 3), and their lengths, (E,).
    """
    before, after = course.moves.T
    toes = plan.toes_m[after] - plan.toes_m[before]
    turns = np.diff(plan.rotation_rad, axis=0)
    parts = [
        part
        for part, least in (
            (toes, course.steps.least_toe_m),
            (turns, course.steps.least_rotation_rad),
        )
        if least > 0.0
    ]
    steps = np.concatenate([np.zeros((0, 3)), *parts])
    return steps, np.linalg.norm(steps, axis=1)


def along(course: Problem, plan: Plan) -> Problem:
    """The course whose least steps go the way that they go in a plan: n·Δ ≥ δ, n their direction,
    so that a plan of it has them.

    A step that hardly moves goes where the nominal path does, and turns that hardly turn go
    round the vertical, to and fro.
    """
    if not len(course.least_steps):
        return course
    steps, lengths = lengths_of(plan, course)
    still = lengths <= STILL * course.least_steps
    normals = np.where(still[:, None], nominal(course), steps)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    return replace(course, sides=np.column_stack([normals, course.least_steps]))


def nominal(course: Problem) -> Array:
    """Directions of the least steps as the course would have them, shape (E, 3)."""
    frames = [course.footholds[after].frame for _, after in course.moves.tolist()]
    ahead = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
    toes = ahead[np.array(frames, dtype=int) - 1]
    toes = np.where(toes.any(axis=1)[:, None], toes, [1.0, 0.0, 0.0])
    turns = np.array([[0.0, 0.0, 1.0 if k % 2 == 0 else -1.0] for k in range(course.frames - 1)])
    count = len(toes) if course.steps.least_toe_m > 0.0 else 0
    return np.concatenate([toes[:count], turns.reshape(-1, 3)])[: len(course.least_steps)]
