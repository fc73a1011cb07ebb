"""Rays that refuted one part of the choices, tried on others: what a search for patches learns from its failures.

The bound that a ray proves (``verify.lagrangian``) is a constant plus, for each placement, the least of a number a
candidate. So a table of these says at once which other parts it refutes, and which placement's candidates are to blame.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..verify.lagrangian import Multipliers, body_pulls
from ..verify.tree import Forest
from ..verify.work import least_work
from .layout import Index
from .scaled import ScaledCourse

MARGIN = 1e-3
"""A bound above this, for multipliers of at most 1, is refused by no rounding and no tolerance of the verifier."""


class Rays:
    """The rays found so far on one course."""

    def __init__(self, scaled: ScaledCourse) -> None:
        self._scaled = scaled
        self._numbers = Forest.of_course(scaled.course).numbers
        self._shape = (scaled.layout.placements, scaled.layout.regions)
        self.rows: list[Array] = []
        self._constants: list[float] = []
        self._tables: list[Array] = []

    def add(self, row: Array) -> int:
        """Keep a ray, as a leaf of a certificate has it; its index."""
        leaf = Multipliers.of(self._numbers.schedule, row[None])
        rays = Multipliers(**{name: group[0] for name, group in vars(leaf).items()})
        self.rows.append(row)
        self._constants.append(self._constant(leaf, rays))
        self._tables.append(self._table(rays))
        return len(self.rows) - 1

    def refuting(self, opened: Array) -> int | None:
        """A ray that refutes these open slots, shape (P, R), or None."""
        if not self.rows:
            return None
        least = np.where(opened > 0.0, np.array(self._tables), np.inf).min(axis=2).sum(axis=1) + self._constants
        best = int(least.argmax())
        return best if least[best] > MARGIN else None

    def relief(self, ray: int, choice: Index, opened: Array) -> Array:
        """By how much other open candidates of every placement would weaken a ray against a choice, shape (P,)."""
        table = self._tables[ray]
        best = np.where(opened > 0.0, table, np.inf).min(axis=1)
        return np.asarray(table[np.arange(len(table)), choice] - best)

    def _constant(self, leaf: Multipliers, rays: Multipliers) -> float:
        """All of the bound but the toes."""
        scaled, norm = self._scaled, np.linalg.norm
        course, length = scaled.course, scaled.course.length_scale_m
        pull, twist = (slope[0] for slope in body_pulls(self._numbers, np.zeros(1, dtype=np.intp), leaf))
        shoulders = np.array([limb.shoulder_m for limb in course.robot.limbs]) / length
        reach = np.array([limb.reach_m for limb in course.robot.limbs]) / length
        steps = course.steps
        return float(
            np.sum(pull * scaled.com)
            - rays.nu_F[:, 2].sum()
            - norm(pull, axis=1) @ scaled.com_radius
            - course.tilt_limit_rad * np.abs(twist).sum()
            - np.sum(rays.reach * shoulders)
            - norm(rays.reach, axis=2).sum(axis=0) @ reach
            - steps.com_m / length * norm(rays.com_step, axis=1).sum()
            - steps.rotation_rad * norm(rays.rotation_step, axis=1).sum()
            - steps.toe_m / length * norm(rays.toe_step, axis=1).sum()
            + rays.progress @ scaled.progress
        )

    def _table(self, rays: Multipliers) -> Array:
        """The least that a toe and the forces on it contribute, by placement and candidate, shape (P, R)."""
        scaled, layout, course = self._scaled, self._scaled.layout, self._scaled.course
        pull = np.zeros((layout.placements, 3))
        np.add.at(pull, np.array(layout.holds).ravel(), rays.reach.reshape(-1, 3))
        np.add.at(pull, layout.moves[:, 1], rays.toe_step)
        np.add.at(pull, layout.moves[:, 0], -rays.toe_step)
        value = np.matmul(scaled.vertices, np.repeat(pull, layout.regions, axis=0)[..., None])[..., 0]  # (P·R, U)
        stance = np.repeat(layout.bearing[0], layout.regions)
        vertices, frames = scaled.vertices[layout.piece_slots], scaled.frames[layout.piece_slots]
        nu = rays.nu_F[stance][:, None] + np.cross(rays.nu_M[stance][:, None], vertices)  # ν·(v × F) = (ν × v)·F
        a = np.matmul(nu, frames).reshape(-1, 3)
        low, high = (np.broadcast_to(bound, a.shape) for bound in (course.force_min, course.force_max))
        friction = np.repeat(scaled.friction[layout.piece_slots], layout.vertices)
        np.add.at(value, layout.piece_slots, least_work(a, low, high, friction).reshape(vertices.shape[:2]))
        return np.asarray(value.min(axis=1).reshape(self._shape))
