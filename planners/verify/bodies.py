"""Judging bodies: does a link go through another one, or through the terrain?

Key frames are judged with the angles that joints are judged with, and the path between them at
moments a centimetre apart (``planners.motion``), on which the runner drives the joints. Links are
the shapes of the robot's file, the terrain is ``Obstacles``; a foot may be in the surface it stands
on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..answer.plan import Plan
from ..answer.report import LATE, Group
from ..errors import InvalidInput, TimeEnded
from ..files.arrays import Array
from ..files.documents import shown
from ..plugins import Registry, foreign, takes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..robot.bodies import Bodies
    from ..robot.inverse_kinematics import Overlap, WholeBody
    from ..robot.kinematics import Kinematics


FURTHER: Registry[Callable[[Plan], Group]] = Registry(
    "verifier group",
    "stancekit.verifier_groups",
    {},
    expected="a function of a Plan",
    accepts=lambda it: takes(it, 1),
)
"""The further groups by name; the package itself has none."""


@cache
def _of_packages() -> tuple[str, ...]:
    """The names of entry points; which packages are installed does not change while a process
    runs.
    """
    registered = FURTHER.registered()
    return tuple(name for name in FURTHER.names() if name not in registered)


def further_groups(plan: Plan) -> tuple[Group, ...]:
    """The further groups of a plan.

    Raises InvalidInput for a function that returns something else.
    """
    groups = []
    for name in dict.fromkeys((*_of_packages(), *FURTHER.registered())):
        with foreign(f"verifier group {name}"):
            group = FURTHER.get(name)(plan)
        if not isinstance(group, Group):
            raise InvalidInput(f"verifier group {name}: expected a Group, got {shown(group)}")
        groups.append(group)
    return tuple(groups)


_NO_ANGLES = "the plan has no joint angles that the motion could go through"


@dataclass(frozen=True, kw_only=True)
class BodyReport:
    """Report on links that go through something.

    Arguments:
        postures: how many were judged.
        hit: how many of them a link is too deep in something in.
        worst: the deepest overlap; place: of it, for people, and frame, its key frame or progress
            between two.
        missing: what has no shape and was not judged.
        drawn_so: pairs of links that are inside each other in every posture, and are left out.
        astray: of a foot that cannot follow its path; empty where all do.
        short_m: what is missing to bodies that are clear: of the depth in the terrain what is more
            than touch, of the distance between links what is less than ``ROOM_M``, and how far a
            foot is off its path.
    """

    postures: int
    hit: int
    worst: Overlap | None
    frame: float
    missing: tuple[str, ...]
    drawn_so: tuple[tuple[str, str], ...]
    astray: str = ""
    short_m: float = 0.0

    @property
    def message(self) -> str:
        """Fault in one line; empty where nothing is."""
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
                "short_m": self.short_m,
                "worst": worst,
                "drawn_so": [list(pair) for pair in self.drawn_so],
            },
        )


def spaced(points_m: Array, angles_rad: Array) -> NDArray[np.intp]:
    """The fewest samples of a motion that are no farther apart than ``APART_M`` and ``TURN_RAD``,
    with the first and the last.

    Arguments:
        points_m: feet and body's origin at every sample, shape (K, P, 3) [m].
        angles_rad: of the joints, shape (K, J).
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
    bodies: Bodies,
    frames: Array,
    postures: WholeBody,
    astray: tuple[str, float] = ("", 0.0),
    *,
    between: bool = False,
    deadline: float = math.inf,
) -> BodyReport:
    """Judge postures.

    Arguments:
        bodies: the robot's links, and the terrain.
        frames: progress of every posture, shape (T,).
        postures: the T postures.
        astray: as of ``BodyReport``, and how far that foot is off its path [m].
        between: whether the postures follow each other, and what is only on the way from one to the
            next is judged, too. Whether they are near enough to each other to stand for the motion
            between them is their maker's to see to.
        deadline: as of ``check_bodies``.
    """
    from ..robot.bodies import LINKS_M, ROOM_M, TOUCH_M  # slow to import

    deepest: tuple[Overlap, float] | None = None
    count, hit, on_the_way, missing, at = 0, 0, 0, bodies.missing, np.arange(len(frames))
    short_m = astray[1] if astray[0] else 0.0
    for count, near in bodies.sweep(postures, links_m=-ROOM_M, between=between):
        for _, overlap in near:
            short_m = max(
                short_m, overlap.depth_m + (ROOM_M if overlap.other in bodies.links else -TOUCH_M)
            )
        overlaps = [(moment, overlap) for moment, overlap in near if overlap.depth_m > LINKS_M]
        ways = sum(moment % 1.0 > 0.0 for moment, _ in overlaps)
        hit += ways + len({moment for moment, _ in overlaps if not moment % 1.0})
        on_the_way += ways
        for moment, overlap in sorted(overlaps, key=lambda each: each[0]):
            if deepest is None or overlap.depth_m > deepest[0].depth_m:
                deepest = overlap, float(np.interp(moment, at, frames))
        if time.perf_counter() > deadline and count < len(frames):
            missing = (f"{LATE} after {count} postures", *missing)
            break
    worst, frame = deepest or (None, 0.0)
    return BodyReport(
        postures=count + on_the_way,
        hit=hit,
        worst=worst,
        frame=frame,
        missing=missing,
        drawn_so=bodies.drawn_so,
        astray=astray[0],
        short_m=short_m,
    )


def check_bodies(
    plan: Plan, angles: Array, solver: Kinematics, *, deadline: float = math.inf
) -> tuple[Group, ...]:
    """The groups ``bodies``, of every key frame of a plan with these angles, shape (M, J) [rad],
    and, where limbs carry between them, ``motion``, of the path through them where they are the
    plan's own.

    Arguments:
        deadline: when to stop (``time.perf_counter()``); what was not looked at by then is not
            checked.

    Raises:
        InvalidInput: without coal.
    """
    from ..motion.joints import STRAY_M, JointPath, key_postures, path_bodies  # slow to import
    from ..motion.path import PlanPath
    from ..robot.bodies import Bodies
    from ..terrain.obstacles import Obstacles

    bodies = Bodies(solver, Obstacles.of(plan.problem.terrain))
    keys = bodies_report(
        bodies, np.arange(float(len(angles))), key_postures(plan, angles), deadline=deadline
    )
    group = keys.group("bodies")
    if plan.problem.robot.absent and group.verdict == "holds":
        absent = ", ".join(plan.problem.robot.absent)
        group = replace(
            group, verdict="not checked", message=f"legs {absent}: nobody says where they are"
        )
    if plan.problem.uncarried:
        return (group,)  # nobody asks for a motion
    unchecked = (
        _NO_ANGLES if plan.joints_rad is None else LATE if time.perf_counter() > deadline else ""
    )
    if unchecked:
        return group, Group("motion", unit="m", message=unchecked, verdict="not checked")
    try:
        path = PlanPath(plan)
        moments, postures = JointPath(path, solver).judged(deadline=deadline)
    except TimeEnded:
        return group, Group("motion", unit="m", message=LATE, verdict="not checked")
    except InvalidInput as error:
        return group, Group("motion", unit="m", message=str(error), verdict="not checked")
    stray_m = float(postures.error_m.max())
    astray = (
        (_astray(plan, moments.frame, postures.error_m), stray_m)
        if stray_m > STRAY_M
        else ("", 0.0)
    )
    on_path = path_bodies(path, moments, postures)
    motion = bodies_report(bodies, moments.frame, on_path, astray, between=True, deadline=deadline)
    return group, motion.group("motion")


def _astray(plan: Plan, frames: Array, error_m: Array) -> str:
    """Message about the foot that is farthest from its path."""
    row, limb = (int(i) for i in np.unravel_index(int(np.argmax(error_m)), error_m.shape))
    name = plan.problem.robot.limb_names[limb]
    return f"frame {frames[row]:.3g}: the foot of {name} stays {1e3 * error_m[row, limb]:.3g} mm from its path"
