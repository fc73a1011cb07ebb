"""A course in non-dimensional numbers: lengths in the length scale, forces in the weight, moments in their product."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..contact.scaled import padded
from ..scene.course import Course
from .layout import Index, Layout


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledCourse:
    """The numbers of one course, by the rows of its layout.

    vertices: shape (P·R, U, 3); frames: R_WC, shape (P·R, 3, 3); friction: shape (P·R,);
    opened: 1 where a slot may be chosen, 0 where it may not, shape (P·R,); com: (M, 3); com_radius: (M,);
    direction: of the nominal steps, (M − 1, 3); progress: (M − 1,), 0 where the nominal path does not move.
    """

    course: Course
    layout: Layout
    vertices: Array
    frames: Array
    friction: Array
    opened: Array
    com: Array
    com_radius: Array
    direction: Array
    progress: Array

    @classmethod
    def of(cls, course: Course) -> ScaledCourse:
        """Scale a course."""
        layout, scale = Layout.of(course), course.length_scale_m
        slots = [
            (placement.candidates[min(r, len(placement.candidates) - 1)], placement.toe_m)
            for placement in course.placements
            for r in range(layout.regions)
        ]
        opened = [r < len(placement.candidates) for placement in course.placements for r in range(layout.regions)]
        direction = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
        moving = np.linalg.norm(direction, axis=1) > 0.0
        return cls(
            course=course,
            layout=layout,
            vertices=np.stack(
                [
                    np.tile(toe, (layout.vertices, 1)) if toe is not None else padded(patch.vertices_m, layout.vertices)
                    for patch, toe in slots
                ]
            )
            / scale,
            frames=np.stack([patch.frame for patch, _ in slots]),
            friction=np.array([patch.friction for patch, _ in slots]),
            opened=np.array(opened, dtype=np.float64),
            com=course.com_nominal_m / scale,
            com_radius=course.com_radius_m / scale,
            direction=direction,
            progress=np.where(moving, course.steps.progress_m / scale, 0.0),
        )

    @property
    def key(self) -> tuple[object, ...]:
        """What a compiled model hangs on: layout, objective, units and robot."""
        course = self.course
        limbs = tuple((limb.name, *limb.shoulder_m.tolist(), limb.reach_m) for limb in course.robot.limbs)
        return self.layout, course.weights, course.length_scale_m, limbs

    def typical(self) -> ScaledCourse:
        """A plain course of this layout for the same robot: the data on which solvers are scaled.

        That scaling stays with a compiled model. Were it the first course's own, the answers for the next would depend
        on what was solved before, where the optimum is not unique.
        """
        layout, scale = self.layout, self.course.length_scale_m
        corner = 2.0 * np.pi * np.arange(layout.vertices) / layout.vertices
        polygon = 0.15 * np.column_stack([np.cos(corner), np.sin(corner), np.sin(corner + 1.0)])
        shoulders = np.stack([limb.shoulder_m for limb in self.course.robot.limbs]) / scale
        limb = np.zeros(layout.placements, dtype=np.int_)
        for row in layout.holds:
            limb[list(row)] = np.arange(layout.limbs)
        toes = 1.7 * shoulders[np.repeat(limb, layout.regions)] - np.array([0.0, 0.0, 0.2])
        n, y = np.full(3, 1.0 / np.sqrt(3.0)), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
        oblique = np.stack([n, y, np.cross(n, y)], axis=1)
        return replace(
            self,
            vertices=toes[:, None] + polygon,
            frames=np.tile(oblique, (layout.slots, 1, 1)),
            friction=np.full(layout.slots, 0.7),
            opened=np.ones(layout.slots),
            com=np.zeros_like(self.com),
            com_radius=np.full_like(self.com_radius, 0.2),
            direction=np.tile(n, (len(self.direction), 1)),
            progress=np.zeros_like(self.progress),
        )

    def values(self) -> dict[str, Array | float]:
        """Data of the terms that every model of key frames shares, by parameter name."""
        course, layout, scale = self.course, self.layout, self.course.length_scale_m
        limbs = course.robot.limbs
        return {
            "shoulders": np.tile(np.stack([limb.shoulder_m for limb in limbs]) / scale, (layout.frames, 1)),
            "reach": np.tile(np.array([limb.reach_m for limb in limbs]) / scale, layout.frames),
            "com_nominal": self.com,
            "com_radius": self.com_radius,
            "tilt": course.tilt_limit_rad,
            "vertices_x": self.vertices[..., 0],
            "vertices_y": self.vertices[..., 1],
            "vertices_z": self.vertices[..., 2],
            "opened": self.opened,
            "weight": 1.0,
            "com_step": course.steps.com_m / scale,
            "toe_step": course.steps.toe_m / scale,
            "rotation_step": course.steps.rotation_rad,
            "direction": self.direction,
            "progress": self.progress,
            "goal": course.goal_m / scale,
        }

    def chosen(self, choice: Index) -> ScaledCourse:
        """The course with one candidate a placement, (P,); its layout has one region."""
        slots = np.arange(self.layout.placements) * self.layout.regions + choice
        return replace(
            self,
            layout=replace(self.layout, regions=1),
            vertices=self.vertices[slots],
            frames=self.frames[slots],
            friction=self.friction[slots],
            opened=np.ones(len(slots)),
        )

    def only(self, opened: Array) -> ScaledCourse:
        """The course with these slots open, shape (P, R), of those that there are."""
        return replace(self, opened=self.opened * np.ravel(opened))

    def force_bounds(self, rows: int) -> dict[str, Array | float]:
        """f_min and f_max of every contact, for ``rows`` rows."""
        return {
            "force_min": np.tile(self.course.force_min, (rows, 1)),
            "force_max": np.tile(self.course.force_max, (rows, 1)),
        }
