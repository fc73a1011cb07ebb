"""Judging bodies: does a link go through another one, or through the terrain?

Key frames are judged with the angles that joints are judged with, and any other postures of a motion in the same way.
Links are the shapes of the robot's file, the terrain is ``Obstacles``; a foot may be in the surface it stands on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.arrays import Array

if TYPE_CHECKING:
    from ..robot.bodies import Bodies, Overlap, WholeBody
    from ..robot.kinematics import Kinematics

    Way = Callable[[Plan, Kinematics], Iterable[tuple[float, WholeBody]]]


@dataclass(frozen=True, kw_only=True)
class BodyReport:
    """Where links go through something.

    postures: how many were judged; hit: how many of them a link is too deep in something in. worst: the deepest
    overlap; place: of it, for people, and frame, its key frame or progress between two. missing: what has no shape and
    was not judged. drawn_so: pairs of links that are inside each other in every posture, and are left out.
    """

    postures: int
    hit: int
    worst: Overlap | None
    frame: float
    missing: tuple[str, ...]
    drawn_so: tuple[tuple[str, str], ...]

    @property
    def message(self) -> str:
        """What is wrong, in one line; empty where nothing is."""
        if self.worst is None:
            return ""
        more = f", the deepest of {self.hit} of {self.postures} postures" if self.hit > 1 else ""
        where = f"frame {self.frame:.3g}" if self.frame % 1.0 else f"frame {self.frame:.0f}"
        return f"{where}: {self.worst.link} is {1e3 * self.worst.depth_m:.3g} mm inside {self.worst.other}{more}"

    def to_json(self) -> dict[str, Any]:
        """A group of a report, JSON-ready."""
        worst = None
        if self.worst is not None:
            worst = {"frame": self.frame, "link": self.worst.link, "other": self.worst.other}
        verdict = "failed" if self.worst is not None else "not checked" if self.missing else "checked"
        return {
            "verdict": verdict,
            "message": self.message or "; ".join(self.missing),
            "postures": self.postures,
            "hit": self.hit,
            "depth_m": 0.0 if self.worst is None else self.worst.depth_m,
            "worst": worst,
            "drawn_so": [list(pair) for pair in self.drawn_so],
        }


def bodies_report(bodies: Bodies, postures: Iterable[tuple[float, WholeBody]]) -> BodyReport:
    """Judge postures, each with its key frame or its progress between two.

    Whether postures are near enough to each other to stand for the motion between them is their maker's to see to.
    """
    deepest: Overlap | None = None
    at, count, hit = 0.0, 0, 0
    for frame, posture in postures:
        count += 1
        found = bodies.overlaps(posture)
        hit += bool(found)
        if found and (deepest is None or found[0].depth_m > deepest.depth_m):
            deepest, at = found[0], frame
    return BodyReport(
        postures=count, hit=hit, worst=deepest, frame=at, missing=bodies.missing, drawn_so=bodies.drawn_so
    )


def check_bodies(
    plan: Plan, angles: Array, solver: Kinematics, way: Way | None = None
) -> dict[str, Mapping[str, Any]]:
    """The group ``bodies``: every key frame of a plan, with these angles, shape (M, J) [rad].

    way: who moves the robot from one to the next; with it the group ``motion``, of postures so near to each other that
    they stand for the motion, each with its progress in key frames. Raises InvalidInput without coal.
    """
    from ..robot.bodies import Bodies  # slow to import
    from ..terrain.obstacles import Obstacles

    bodies = Bodies(solver, Obstacles.of(plan.course.terrain))
    found: dict[str, Mapping[str, Any]] = {
        "bodies": bodies_report(bodies, enumerate(_key_frames(plan, angles))).to_json()
    }
    if way is not None:
        try:
            found["motion"] = bodies_report(bodies, way(plan, solver)).to_json()
        except InvalidInput as error:
            found["motion"] = {"verdict": "not checked", "message": str(error)}
    return found


def _key_frames(plan: Plan, angles: Array) -> Iterable[WholeBody]:
    """The postures of the key frames, rotations taken exactly."""
    from ..robot.bodies import WholeBody
    from ..robot.plan_joints import normals_at
    from ..robot.rotation import rotation_of

    robot = plan.course.robot
    for frame, its in enumerate(angles):
        turn = rotation_of(plan.rotation_rad[frame])
        yield WholeBody(
            rotation=turn, origin_m=plan.com_m[frame] - turn @ robot.origin_m, angles=its, toes_m=plan.toes_at(frame),
            normals=normals_at(plan, frame), stands=np.ones(len(robot.limbs), dtype=bool),
        )  # fmt: skip
