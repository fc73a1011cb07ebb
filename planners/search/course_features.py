"""Features of a course for a policy, from where the robot stands: the coming candidate patches, the
path, the goal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..terrain import Patch
from .plan_window import Standing

Features = dict[str, NDArray[np.float32]]
BOUND = 8.0
"""Bound on what is seen, in length scales: farther things are seen at the bound."""
BOUNDS = {
    "offered": (0.0, 1.0),
    "left": (0.0, 1.0),
    "normals": (-1.0, 1.0),
    "footing": (-1.0, 1.0),
    "friction": (0.0, BOUND),
    "grip": (0.0, BOUND),
    "reach": (0.0, BOUND),
}


@dataclass(frozen=True, kw_only=True)
class CourseFeatures:
    """Features of one size for a policy: N limbs, H coming key frames, R candidates a toe, patches
    of up to U corners.

    They are a dict of flat float32 arrays. Lengths are in the course's length scale, places as seen
    from the COM: ``corners`` (H·N·R·U·3), ``normals`` (H·N·R·3), ``friction`` (H·N·R) of the
    candidate patches of the limb's next toe, by coming frame, limb and candidate; ``offered``
    (H·N·R) is 1 where there is one and 0 where the rest is zero. ``toes`` (N·3), ``footing`` (N·3)
    and ``grip`` (N): where the toes stand, the normal and the friction there. ``shoulders`` (N·3),
    ``reach`` (N). ``path`` (H·3): the nominal COM at the coming frames, the last one repeated.
    ``goal`` (3); ``left`` (1): share of the frames that are left.
    """

    limbs: int
    horizon: int
    regions: int
    corners: int

    def bounds(self) -> dict[str, tuple[float, float, int]]:
        """The least and the greatest value of every feature, and how many values it has."""
        return {
            name: (*BOUNDS.get(name, (-BOUND, BOUND)), values.size)
            for name, values in self._blank().items()
        }

    def observe(self, course: Problem, frame: int, standing: Standing) -> Features:
        """The features at a key frame.

        Raises InvalidInput where the course does not fit the size.
        """
        if len(course.robot.limbs) != self.limbs:
            raise InvalidInput(
                f"course: expected {self.limbs} limbs, got {len(course.robot.limbs)}"
            )
        seen, scale, com_m = self._blank(), course.length_scale_m, standing.com_m
        for foothold in course.footholds:
            ahead = foothold.frame - frame - 1
            if 0 <= ahead < self.horizon:
                limb = course.robot.limb_names.index(foothold.limb)
                where = f"frame {foothold.frame}, limb {foothold.limb}"
                if len(foothold.candidates) > self.regions:
                    raise InvalidInput(
                        f"{where}: expected at most {self.regions} candidates, got "
                        f"{len(foothold.candidates)}"
                    )
                for region, patch in enumerate(foothold.candidates):
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
        return {
            name: np.clip(values, -BOUND, BOUND).astype(np.float32).ravel()
            for name, values in seen.items()
        }

    def _blank(self) -> dict[str, Array]:
        shape = self.horizon, self.limbs, self.regions
        shapes: dict[str, tuple[int, ...]] = {
            "corners": (*shape, self.corners, 3),
            "normals": (*shape, 3),
            "friction": shape,
            "offered": shape,
            "toes": (self.limbs, 3),
            "footing": (self.limbs, 3),
            "grip": (self.limbs,),
            "shoulders": (self.limbs, 3),
            "reach": (self.limbs,),
            "path": (self.horizon, 3),
            "goal": (3,),
            "left": (1,),
        }
        return {name: np.zeros(shape) for name, shape in shapes.items()}

    def _cornered(self, patch: Patch, where: str) -> Array:
        """The corners of a patch, the last one repeated, shape (U, 3)."""
        count = len(patch.vertices_m)
        if count > self.corners:
            raise InvalidInput(
                f"{where}: expected patches of at most {self.corners} corners, got {count}"
            )
        return np.asarray(patch.vertices_m[np.minimum(np.arange(self.corners), count - 1)])
