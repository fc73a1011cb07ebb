"""What the verifier says of a posture or of a plan of key frames: groups, verdict, and the digest that goes with it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from numpy.typing import NDArray

from ..cached import cached_property
from ..errors import InvalidInput
from ..problem import PostureProblem
from ..problem.course import Course
from ..problem.course_json import course_to_json
from ..robot.urdf import hexapod_urdf, joint_names
from .outcome import Posture
from .plan import Plan

GROUPS = {
    "patch": "m",
    "force_balance": "N",
    "moment_balance": "Nm",
    "friction": "N",
    "force_bounds": "N",
    "reach": "m",
    "tilt": "rad",
    "com": "m",
}
"""The groups of constraints of a posture in the order of a report, and the unit of what is violated."""
PLAN_GROUPS = {
    **GROUPS,
    "terrain": "m",
    "idle_force": "N",
    "start": "m",
    "schedule": "",
    "com_step": "m",
    "toe_step": "m",
    "relative_reach": "m",
    "rotation_step": "rad",
    "progress": "m",
}
"""Those of a plan: those of its stances, and what couples its key frames."""
WHOLE_BODY = ("joints", "torque", "bodies", "motion")
"""Groups of a plan that are of more of the robot than its contacts; motion is bodies between key frames."""
NOT_ASKED = "not asked for"
NOBODY_CARRIES = "nobody carries between frames"
LATE = "the time limit ended"
"""How the message of a group begins that was not checked since the time had ended."""
OPTIONAL = ("modes", "joints_rad")
"""Arrays that a plan may be without."""
ROUNDING = 1e-12
"""Non-dimensional violations of a plan below this are nobody's fault."""


@dataclass(frozen=True, slots=True)
class GroupViolation:
    """The worst violation in one group of constraints.

    worst: non-dimensional, 0 when satisfied, inf for what is no posture or plan. value: the same in ``unit`` (SI).
    frame: the key frame, 0 for a posture, −1 where nothing is violated. limb: empty for the whole body; part: the world
    axis or the component of the force. share: how far from that frame to the next, 0 at the frame itself.
    """

    group: str
    worst: float
    value: float
    unit: str
    frame: int = -1
    limb: str = ""
    part: str = ""
    share: float = 0.0

    @property
    def where(self) -> str:
        """The limb, "limb component" or world axis."""
        return f"{self.limb} {self.part}".strip()

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        numbers = {"worst": or_null(self.worst), "value": or_null(self.value)}
        place = {"where": self.where, "frame": self.frame, "limb": self.limb, "share": self.share}
        return {"group": self.group, **numbers, "unit": self.unit, **place}


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """The verifier's word on one posture, or on one plan.

    Arguments:
        accepted: the worst violation is at most the tolerance, and none of joints, torque, bodies and motion failed.
        worst: largest non-dimensional violation of all groups.
        groups: the violation of each group of constraints, and where it is worst.
        tolerance: largest violation that is accepted, non-dimensional.
        subject: the problem or course that was answered.
        answer: what was judged.
        residual_nm: norm of the net moment about the COM, at a plan's worst stance [Nm].
        between: of plans, the largest violation at the points between frames, by recomputation.
        proved: of plans, steps from frame to frame on which limbs carry all the way; on the others every limb moves
            at once, and the course asks for the frames only.
        linearisation_m: farthest that I + [Θ]× puts a shoulder from where exp([Θ]×) does, at most ‖Θ‖²/2 of its
            distance from the centre of mass; reported, and decides nothing [m].
        exact_reach_m: how far a toe is out of reach with the exact rotation; likewise [m].
        goal_m: of plans, distance of the last COM from the goal [m].
        joints, torque, bodies, motion: of plans, the whole body, with a verdict of "checked", "failed", "not checked"
            or "not asked for".
        defect: why there was nothing to check; empty when there was.
    Source:
        E1-E11.
    Example:
        >>> import stancekit
        >>> stancekit.plan("walls", frames=2).report.accepted
        True
    """

    accepted: bool
    worst: float
    groups: tuple[GroupViolation, ...]
    tolerance: float
    subject: PostureProblem | Course = field(repr=False)
    answer: Posture | Plan = field(repr=False)
    residual_nm: float = math.inf
    between: float = math.inf
    proved: int = 0
    linearisation_m: float = math.nan
    exact_reach_m: float = math.nan
    goal_m: float = math.nan
    joints: Mapping[str, Any] = field(default_factory=lambda: {"verdict": NOT_ASKED})
    torque: Mapping[str, Any] = field(default_factory=lambda: {"verdict": NOT_ASKED})
    bodies: Mapping[str, Any] = field(default_factory=lambda: {"verdict": NOT_ASKED})
    motion: Mapping[str, Any] = field(default_factory=lambda: {"verdict": NOT_ASKED})
    defect: str = ""
    """Why there was nothing to check; empty when there was."""

    @property
    def contacts(self) -> bool:
        """All of ``groups`` are within the tolerance, whatever the joints can do."""
        return self.worst <= self.tolerance

    @property
    def checked(self) -> tuple[str, ...]:
        """What was judged: contacts, and what of the whole body was."""
        found = [name for name in WHOLE_BODY if getattr(self, name)["verdict"] in ("checked", "failed")]
        return ("contacts", *found)

    @property
    def unchecked(self) -> tuple[str, ...]:
        """The groups of the whole body that somebody asked for, and that could not be checked."""
        return tuple(name for name in WHOLE_BODY if getattr(self, name)["verdict"] == "not checked")

    @property
    def late(self) -> bool:
        """Whether some of that was left since the time had ended."""
        return any(str(getattr(self, name).get("message", "")).startswith(LATE) for name in self.unchecked)

    @cached_property
    def hindrance(self) -> str:
        """Why no runner executes the plan, whatever the world; empty where one may."""
        if not isinstance(self.answer, Plan):
            return ""
        course = self.answer.course
        if course.uncarried:
            return NOBODY_CARRIES
        if course.has_soles:
            return "its feet are soles, and only point feet are executed"
        if course.robot.model is not None:
            return ""
        try:
            _ = hexapod_urdf(course.robot)
        except InvalidInput as error:
            return str(error)
        return ""

    @property
    def joints_message(self) -> str:
        """What is said of the groups of the whole body that somebody asked for; empty where nobody did."""
        said = list[tuple[str, str]]()
        for name in WHOLE_BODY:
            group = getattr(self, name)
            verdict = "NOT CHECKED" if group["verdict"] == "not checked" else group["verdict"]
            reason = f" ({group['message']})" if group.get("message") else ""
            if verdict == NOT_ASKED:
                continue
            if reason and said and said[-1][1] == verdict + reason:
                name = f"{said.pop()[0]}, {name}"
            said.append((name, verdict + reason))
        return "; ".join(f"{name}: {verdict}" for name, verdict in said)

    @property
    def failures(self) -> str:
        """What of the whole body failed, and why; empty where nothing did."""
        groups = {name: getattr(self, name) for name in WHOLE_BODY}
        return "; ".join(f"{name}: {of['message']}" for name, of in groups.items() if of["verdict"] == "failed")

    @property
    def _cannot(self) -> str:
        """Why a plan whose contacts hold is none."""
        collide = "failed" in (self.bodies["verdict"], self.motion["verdict"])
        cannot = any(getattr(self, name)["verdict"] == "failed" for name in ("joints", "torque"))
        return " and ".join(["the joints cannot do it"] * cannot + ["bodies collide"] * collide)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of subject, answer, tolerance, verdict and what was checked, as canonical JSON: what the runner asks
        for."""
        if isinstance(self.answer, Plan):
            return plan_digest(self.answer, self.tolerance, self.accepted, self.checked)
        of = {"problem": self.subject.to_json()} if isinstance(self.subject, PostureProblem) else {}
        return _digest({**of, "posture": self.answer.to_json()}, self.tolerance, self.accepted)

    @property
    def message(self) -> str:
        """One line: the verdict, what was not checked, the worst group, where and by how much, and what hinders its
        execution."""
        if not self.accepted:
            return self._worst("rejected")
        line = self._worst(acceptance_word(self.unchecked))
        return f"{line}; cannot be executed: {self.hindrance}" if self.hindrance else line

    def _worst(self, verdict: str) -> str:
        """The verdict and the worst group."""
        then = "; " if " as far as " in verdict else ": "
        if self.defect:
            return f"{verdict}: {self.defect}"
        of_plan = isinstance(self.answer, Plan)
        if self.contacts and not self.accepted:
            return f"{verdict}: contacts hold, {self._cannot}"
        group = max(self.groups, key=lambda g: g.worst)
        if group.worst == 0.0 or (of_plan and group.worst < ROUNDING):
            balanced = of_plan and cast("Plan", self.answer).course.uncarried
            return verdict + then + ("balanced in every frame" if balanced else "no constraint is violated")
        place = group.where
        if of_plan:
            place = f"frame {group.frame}" + (f", limb {group.limb}" if group.limb else "")
            if group.share:
                place += f", {group.share:.0%} of the way to frame {group.frame + 1}"
        size = f"off by {group.value:.3g} {group.unit}" if group.unit else "nobody there carries as the schedule says"
        return f"{verdict}{then}worst is {group.group}{f' ({place})' if place else ''}, {size}"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        of_plan = isinstance(self.answer, Plan)
        numbers = ["worst", "tolerance", "residual_nm"]
        numbers += ["between"] * of_plan + ["linearisation_m", "exact_reach_m"] + ["goal_m"] * of_plan
        return {
            "accepted": self.accepted,
            "message": self.message,
            "digest": self.digest,
            **{name: or_null(getattr(self, name)) for name in numbers},
            **(
                {
                    "proved": self.proved,
                    "checked": list(self.checked),
                    **{name: dict(getattr(self, name)) for name in WHOLE_BODY},
                }
                if of_plan
                else {}
            ),
            "groups": [group.to_json() for group in self.groups],
        }


def acceptance_word(unchecked: Sequence[str]) -> str:
    """The word for what is accepted, with the groups that nobody could check."""
    if not unchecked:
        return "accepted"
    *most, last = unchecked
    names = f"{', '.join(most)} and {last} are" if most else f"{last} is"
    return f"accepted as far as checked: {names} not"


def refused(
    subject: PostureProblem | Course,
    answer: Posture | Plan,
    tolerance: float,
    defect: str,
    *,
    frame: int = -1,
    limb: str = "",
) -> Report:
    """The report on what is no posture or plan of the subject at all: every group is violated without bound.

    defect: what is wrong, in words. frame, limb: where, −1 and empty where it is nowhere in particular.
    """
    groups = PLAN_GROUPS if isinstance(answer, Plan) else GROUPS
    return Report(
        accepted=False, worst=math.inf, tolerance=tolerance, subject=subject, answer=answer, defect=defect,
        groups=tuple(GroupViolation(name, math.inf, math.inf, unit, frame, limb) for name, unit in groups.items()),
    )  # fmt: skip


def plan_digest(plan: Plan, tolerance: float, accepted: bool, checked: Sequence[str] = ("contacts",)) -> str:
    """SHA-256 of a verdict on a plan and of all that it speaks of, in hexadecimal.

    tolerance, accepted: the verdict. checked: what was judged, contacts alone or joints and bodies, too. Course, arrays
    and verdict go in as sorted JSON: a change of any of them gives another digest.
    """
    numbers = {name: None if array is None else array.tolist() for name, array in plan_arrays(plan).items()}
    more = {} if tuple(checked) == ("contacts",) else {"checked": list(checked)}
    return _digest({"course": course_to_json(plan.course), "plan": numbers, **more}, tolerance, accepted)


def _digest(content: dict[str, Any], tolerance: float, accepted: bool) -> str:
    whole = {**content, "tolerance": tolerance, "accepted": accepted}
    return hashlib.sha256(json.dumps(whole, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def plan_shapes(course: Course) -> dict[str, tuple[int, ...]]:
    """The shape that each array of a plan over a course has, by name."""
    frames, limbs = course.frames, len(course.robot.limbs)
    placed, stances = len(course.footholds), len(course.stances)
    soles: dict[str, tuple[int, ...]] = {}
    if course.has_soles:
        points = max(1 if limb.sole_m is None else len(limb.sole_m) for limb in course.robot.limbs)
        soles = {"points_m": (placed, points, 3), "point_forces_n": (stances, limbs, points, 3)}
    joints = {} if course.has_soles else {"joints_rad": (frames, len(joint_names(course.robot)))}
    return {
        "com_m": (frames, 3),
        "rotation_rad": (frames, 3),
        "toes_m": (placed, 3),
        "choice": (placed,),
        "forces_n": (stances, limbs, 3),
        **soles,
        **joints,
        "modes": (frames,),
    }


def plan_arrays(plan: Plan) -> dict[str, NDArray[Any] | None]:
    """The numbers of a plan by name; modes may be None, and joints are there only where they were worked out."""
    found = {name: getattr(plan, name) for name in plan_shapes(plan.course)}
    return {name: array for name, array in found.items() if array is not None or name != "joints_rad"}


def or_null(number: float) -> float | None:
    """The number, or None where it is not finite: JSON has no other."""
    return number if math.isfinite(number) else None
