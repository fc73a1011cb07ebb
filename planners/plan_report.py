"""What the verifier says of a plan of key frames: groups, verdict, and the digest that goes with it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from numpy.typing import NDArray

from .plan import Plan
from .scene.course import Course
from .scene.course_json import course_to_json
from .verify import GROUPS as POSTURE_GROUPS

GROUPS = {
    **POSTURE_GROUPS,
    "idle_force": "N",
    "start": "m",
    "schedule": "",
    "com_step": "m",
    "toe_step": "m",
    "rotation_step": "rad",
    "progress": "m",
}
"""The groups of constraints in the order of a report, and the unit of what is violated."""

ROUNDING = 1e-12
"""Non-dimensional violations below this are nobody's fault."""


@dataclass(frozen=True, slots=True)
class PlanViolation:
    """The worst violation in one group of constraints.

    worst: non-dimensional, 0 when satisfied, inf for a plan that is no plan. value: the same in ``unit`` (SI).
    frame: the key frame, −1 where nothing is violated; limb: empty for the whole body. share: how far from that frame
    to the next, 0 at the frame itself.
    """

    group: str
    worst: float
    value: float
    unit: str
    frame: int
    limb: str
    share: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanReport:
    """What the verifier says of one plan.

    worst: largest non-dimensional violation of all groups; accepted: it is at most ``tolerance``.
    between: largest violation at the points between frames, by recomputation. proved: steps from frame to frame on
    which limbs carry all the way; on the others every limb moves at once, and the course asks for the frames only.
    linearisation_m: farthest that I + [Θ]× puts a shoulder from where exp([Θ]×) does [m]; exact_reach_m: how far a toe
    is out of reach with the exact rotation [m]. Both are reported and decide nothing: reach is what eq. 11 says.
    goal_m: distance of the last COM from the goal [m].
    joints: what inverse kinematics says, see ``check_joints``; no part of ``accepted``.
    """

    accepted: bool
    worst: float
    groups: tuple[PlanViolation, ...]
    tolerance: float
    plan: Plan = field(repr=False)
    between: float = math.inf
    proved: int = 0
    linearisation_m: float = math.nan
    exact_reach_m: float = math.nan
    goal_m: float = math.nan
    joints: Mapping[str, Any] = field(default_factory=lambda: {"verdict": "not asked for"})
    defect: str = ""
    """Why the plan could not be checked at all; empty when it could."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of course, plan, tolerance and verdict as canonical JSON: what the runner asks for."""
        return plan_digest(self.plan, self.tolerance, self.accepted)

    @property
    def message(self) -> str:
        """One line: the verdict, the worst group, the frame, the limb and by how much."""
        verdict = "accepted" if self.accepted else "rejected"
        if self.defect:
            return f"{verdict}: {self.defect}"
        group = max(self.groups, key=lambda g: g.worst)
        if group.worst < ROUNDING:
            return f"{verdict}: no constraint is violated"
        place = f"frame {group.frame}" + (f", limb {group.limb}" if group.limb else "")
        if group.share:
            place += f", {group.share:.0%} of the way to frame {group.frame + 1}"
        size = f"off by {group.value:.3g} {group.unit}" if group.unit else "nobody there carries as the schedule says"
        return f"{verdict}: worst is {group.group} ({place}), {size}"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        numbers = ("worst", "tolerance", "between", "linearisation_m", "exact_reach_m", "goal_m")
        return {
            "accepted": self.accepted,
            "message": self.message,
            "digest": self.digest,
            **{name: or_null(getattr(self, name)) for name in numbers},
            "proved": self.proved,
            "joints": dict(self.joints),
            "groups": [
                {"group": g.group, "worst": or_null(g.worst), "value": or_null(g.value), "unit": g.unit,
                 "frame": g.frame, "limb": g.limb, "share": g.share}
                for g in self.groups
            ],
        }  # fmt: skip


def plan_digest(plan: Plan, tolerance: float, accepted: bool) -> str:
    """SHA-256 of a verdict on a plan and of all that it speaks of."""
    content = {
        "course": course_to_json(plan.course),
        "plan": {name: None if array is None else array.tolist() for name, array in plan_arrays(plan).items()},
        "tolerance": tolerance,
        "accepted": accepted,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def plan_shapes(course: Course) -> dict[str, tuple[int, ...]]:
    """The shape that each array of a plan over a course has, by name."""
    frames, limbs = course.frames, len(course.robot.limbs)
    placed, stances = len(course.placements), len(course.stances)
    return {
        "com_m": (frames, 3),
        "rotation_rad": (frames, 3),
        "toes_m": (placed, 3),
        "choice": (placed,),
        "forces_n": (stances, limbs, 3),
        "modes": (frames,),
    }


def plan_arrays(plan: Plan) -> dict[str, NDArray[Any] | None]:
    """The numbers of a plan by name; modes may be None."""
    return {name: getattr(plan, name) for name in plan_shapes(plan.course)}


def or_null(number: float) -> float | None:
    """The number, or None where it is not finite: JSON has no other."""
    return number if math.isfinite(number) else None
