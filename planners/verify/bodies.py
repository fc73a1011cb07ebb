"""Judging bodies: does a link go through another one, or through the terrain?

Key frames are judged with the angles that joints are judged with, and the path between them at moments a centimetre
apart (``planners.motion``), on which the runner drives the joints. Links are the shapes of the robot's file, the
terrain is ``Obstacles``; a foot may be in the surface it stands on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..answer.plan import Plan
from ..answer.report import LATE, Group
from ..errors import InvalidInput
from ..files.arrays import Array

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..robot.bodies import Bodies
    from ..robot.kinematics import Kinematics
    from ..robot.overlaps import Overlap, WholeBody

NO_ANGLES = "the plan has no joint angles that the motion could go through"


@dataclass(frozen=True, kw_only=True)
class BodyReport:
    """Where links go through something.

    postures: how many were judged; hit: how many of them a link is too deep in something in. worst: the deepest
    overlap; place: of it, for people, and frame, its key frame or progress between two. missing: what has no shape and
    was not judged. drawn_so: pairs of links that are inside each other in every posture, and are left out. astray: of
    a foot that cannot follow its path; empty where all do.
    """

    postures: int
    hit: int
    worst: Overlap | None
    frame: float
    missing: tuple[str, ...]
    drawn_so: tuple[tuple[str, str], ...]
    astray: str = ""

    @property
    def message(self) -> str:
        """What is wrong, in one line; empty where nothing is."""
        if self.worst is None:
            return self.astray
        more = f", the deepest of {self.hit} of {self.postures} postures" if self.hit > 1 else ""
        more += f"; {self.astray}" if self.astray else ""
        where = f"frame {self.frame:.3g}" if self.frame % 1.0 else f"frame {self.frame:.0f}"
        return f"{where}: {self.worst.link} is {1e3 * self.worst.depth_m:.3g} mm inside {self.worst.other}{more}"

    def group(self, name: str) -> Group:
        """The group of a report with that name."""
        depth_m = 0.0 if self.worst is None else self.worst.depth_m
        worst = None
        if self.worst is not None:
            worst = {"frame": self.frame, "link": self.worst.link, "other": self.worst.other}
        return Group(
            name=name,
            value=depth_m,
            limit=0.0,
            unit="m",
            where="" if self.worst is None else self.worst.link,
            when=None if self.worst is None else self.frame,
            message=self.message or "; ".join(self.missing),
            verdict="violated" if self.message else "not checked" if self.missing else "holds",
            figures={
                "postures": self.postures,
                "hit": self.hit,
                "depth_m": depth_m,
                "worst": worst,
                "drawn_so": [list(pair) for pair in self.drawn_so],
            },
        )


def spaced(points_m: Array, angles_rad: Array) -> NDArray[np.intp]:
    """As few samples of a motion as are not farther apart than ``APART_M`` and ``TURN_RAD``, with the first and the
    last.

    points_m: feet and body's origin at every sample, shape (K, P, 3) [m]. angles_rad: of the joints, shape (K, J).
    """
    from ..motion.joints import TURN_RAD  # slow to import
    from ..motion.path import APART_M

    chosen = [0]
    for k in range(1, len(points_m) - 1):
        moved = np.linalg.norm(points_m[k + 1] - points_m[chosen[-1]], axis=1).max()
        if moved > APART_M or np.abs(angles_rad[k + 1] - angles_rad[chosen[-1]]).max() > TURN_RAD:
            chosen.append(k)
    return np.unique([*chosen, len(points_m) - 1])


def bodies_report(
    bodies: Bodies, postures: Iterable[tuple[float, WholeBody]], astray: str = "", *, deadline: float = math.inf
) -> BodyReport:
    """Judge postures alone, each with its key frame; astray: as of ``BodyReport``; deadline: as of ``check_bodies``."""
    return _report(bodies, ((frame, bodies.overlaps(posture)) for frame, posture in postures), astray, deadline)


def motion_report(
    bodies: Bodies, postures: Iterable[tuple[float, WholeBody]], astray: str = "", *, deadline: float = math.inf
) -> BodyReport:
    """Judge postures that follow each other, each with its progress, and links on the way from one to the next.

    Whether postures are near enough to each other to stand for the motion between them is their maker's to see to.
    deadline: as of ``check_bodies``.
    """

    def found() -> Iterator[tuple[float, Sequence[Overlap]]]:
        before: tuple[float, WholeBody] | None = None
        for frame, posture in postures:
            if before is not None:
                for share, overlap in bodies.between(before[1], posture):
                    yield before[0] + share * (frame - before[0]), (overlap,)
            yield frame, bodies.overlaps(posture)
            before = frame, posture

    return _report(bodies, found(), astray, deadline)


def _report(
    bodies: Bodies, found: Iterable[tuple[float, Sequence[Overlap]]], astray: str, deadline: float
) -> BodyReport:
    """found: of every posture its progress, and what is too deep in something, the deepest first."""
    deepest: Overlap | None = None
    at, count, hit, missing = 0.0, 0, 0, bodies.missing
    for frame, overlaps in found:
        if time.perf_counter() > deadline:
            missing = (f"{LATE} after {count} postures", *missing)
            break
        count += 1
        hit += bool(overlaps)
        if overlaps and (deepest is None or overlaps[0].depth_m > deepest.depth_m):
            deepest, at = overlaps[0], frame
    return BodyReport(
        postures=count, hit=hit, worst=deepest, frame=at, missing=missing, drawn_so=bodies.drawn_so,
        astray=astray,
    )  # fmt: skip


def check_bodies(
    plan: Plan, angles: Array, solver: Kinematics, *, deadline: float = math.inf
) -> tuple[Group, ...]:
    """The groups ``bodies``, of every key frame of a plan with these angles, shape (M, J) [rad], and, where limbs carry
    between them, ``motion``, of the path through them where they are the plan's own.

    deadline: when to stop (``time.perf_counter()``); what was not looked at by then is not checked. Raises InvalidInput
    without coal.
    """
    from ..motion.joints import STRAY_M, JointPath, key_postures, path_bodies  # slow to import
    from ..motion.path import PlanPath
    from ..robot.bodies import Bodies
    from ..terrain.obstacles import Obstacles

    bodies = Bodies(solver, Obstacles.of(plan.course.terrain))
    keys = bodies_report(bodies, enumerate(key_postures(plan, angles)), deadline=deadline)
    found = keys.group("bodies")
    if plan.course.uncarried:
        return (found,)  # nobody asks for a motion
    unchecked = NO_ANGLES if plan.joints_rad is None else LATE if time.perf_counter() > deadline else ""
    if unchecked:
        return found, Group("motion", unit="m", message=unchecked, verdict="not checked")
    try:
        path = PlanPath(plan)
        moments, postures = JointPath(path, solver).judged()
    except InvalidInput as error:
        return found, Group("motion", unit="m", message=str(error), verdict="not checked")
    astray = _astray(plan, moments.frame, postures.error_m) if postures.error_m.max() > STRAY_M else ""
    motion = motion_report(bodies, path_bodies(path, moments, postures), astray, deadline=deadline)
    return found, motion.group("motion")


def _astray(plan: Plan, frames: Array, error_m: Array) -> str:
    """Of the foot that is farthest from its path."""
    row, limb = (int(i) for i in np.unravel_index(int(np.argmax(error_m)), error_m.shape))
    name = plan.course.robot.limb_names[limb]
    return f"frame {frames[row]:.3g}: the foot of {name} stays {1e3 * error_m[row, limb]:.3g} mm from its path"
