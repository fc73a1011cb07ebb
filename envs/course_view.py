"""What an agent sees of a course from where the robot stands: the coming candidate patches, the way ahead, the goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.course import Course
from stancekit.planners.search.plan_window import Standing
from stancekit.planners.terrain import Patch

View = dict[str, NDArray[np.float32]]
ROOM = 8.0
"""Bound on what is seen, in length scales: farther things are seen at the bound."""


@dataclass(frozen=True, kw_only=True)
class CourseView:
    """The size of a view: N limbs, H coming key frames, R candidates a toe, patches of up to U corners.

    A view is a dict of flat float32 arrays. Lengths are in the course's length scale, places as seen from the COM:
    ``corners`` (H·N·R·U·3), ``normals`` (H·N·R·3), ``friction`` (H·N·R) of the candidate patches of the limb's next
    toe, by coming frame, limb and candidate; ``offered`` (H·N·R) is 1 where there is one and 0 where the rest is zero.
    ``toes`` (N·3), ``footing`` (N·3) and ``grip`` (N): where the toes stand, the normal and the friction there.
    ``shoulders`` (N·3), ``reach`` (N). ``path`` (H·3): the nominal COM at the coming frames, the last one repeated.
    ``goal`` (3); ``left`` (1): share of the frames that are left.
    """

    limbs: int
    horizon: int
    regions: int
    corners: int

    def space(self) -> spaces.Dict:
        """The space of the views."""
        bounds = {
            "offered": (0.0, 1.0), "left": (0.0, 1.0), "normals": (-1.0, 1.0), "footing": (-1.0, 1.0),
            "friction": (0.0, ROOM), "grip": (0.0, ROOM), "reach": (0.0, ROOM),
        }  # fmt: skip
        return spaces.Dict(
            {
                name: spaces.Box(*bounds.get(name, (-ROOM, ROOM)), (values.size,), np.float32)
                for name, values in self._blank().items()
            }
        )

    def see(self, course: Course, frame: int, standing: Standing) -> View:
        """The view at a key frame. Raises InvalidInput where the course does not fit the size."""
        if len(course.robot.limbs) != self.limbs:
            raise InvalidInput(f"course: expected {self.limbs} limbs, got {len(course.robot.limbs)}")
        seen, scale, com_m = self._blank(), course.length_scale_m, standing.com_m
        for placement in course.placements:
            ahead = placement.frame - frame - 1
            if 0 <= ahead < self.horizon:
                limb = course.robot.limb_names.index(placement.limb)
                where = f"frame {placement.frame}, limb {placement.limb}"
                if len(placement.candidates) > self.regions:
                    raise InvalidInput(
                        f"{where}: expected at most {self.regions} candidates, got {len(placement.candidates)}"
                    )
                for region, patch in enumerate(placement.candidates):
                    at = ahead, limb, region
                    seen["corners"][at] = (self._cornered(patch, where) - com_m) / scale
                    seen["normals"][at], seen["friction"][at] = patch.normal, patch.friction
                    seen["offered"][at] = 1.0
        coming = np.minimum(frame + 1 + np.arange(self.horizon), course.frames - 1)
        seen["path"][:] = (course.com_nominal_m[coming] - com_m) / scale
        seen["toes"][:] = (standing.toes_m - com_m) / scale
        seen["footing"][:] = [patch.normal for patch in standing.patches]
        seen["grip"][:] = [patch.friction for patch in standing.patches]
        seen["shoulders"][:] = np.array([limb.shoulder_m for limb in course.robot.limbs]) / scale
        seen["reach"][:] = np.array([limb.reach_m for limb in course.robot.limbs]) / scale
        seen["goal"][:] = (course.goal_m - com_m) / scale
        seen["left"][:] = (course.frames - 1 - frame) / max(course.frames - 1, 1)
        return {name: np.clip(values, -ROOM, ROOM).astype(np.float32).ravel() for name, values in seen.items()}

    def _blank(self) -> dict[str, Array]:
        slots = self.horizon, self.limbs, self.regions
        shapes: dict[str, tuple[int, ...]] = {
            "corners": (*slots, self.corners, 3), "normals": (*slots, 3), "friction": slots, "offered": slots,
            "toes": (self.limbs, 3), "footing": (self.limbs, 3), "grip": (self.limbs,), "shoulders": (self.limbs, 3),
            "reach": (self.limbs,), "path": (self.horizon, 3), "goal": (3,), "left": (1,),
        }  # fmt: skip
        return {name: np.zeros(shape) for name, shape in shapes.items()}

    def _cornered(self, patch: Patch, where: str) -> Array:
        """The corners of a patch, the last one repeated, shape (U, 3)."""
        count = len(patch.vertices_m)
        if count > self.corners:
            raise InvalidInput(f"{where}: expected patches of at most {self.corners} corners, got {count}")
        return np.asarray(patch.vertices_m[np.minimum(np.arange(self.corners), count - 1)])
