"""The independent verifier of plans: it knows the course and the plan, not how the plan was made.

Every stance of every key frame is judged by the verifier of postures. What couples the frames is judged here: who
stands where, who carries, steps and progress (eq. 11), reach of limbs that do not carry, and the way between frames.

*Why two stances prove the way between them.* The limbs that do not move between two frames keep their toes p. The
earlier frame has a stance (c, Θ, f) of some of these limbs, the later one (c', Θ', f'). On the straight line between
both, the forces sum up to the weight everywhere, so Σ (p − c) × f = Σ p × f + c × m g is linear in (c, f), and zero at
both ends. Cones, bounds (which admit a zero force), reach with the linearised rotation, tilt box and the interpolated
ball about the nominal COM are convex. So every point between is a posture, too. Five of them are recomputed anyway.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import LARGEST, Array, cross
from .outcome import InvalidInput, Posture
from .plan import Plan
from .plan_report import GROUPS, PlanReport, PlanViolation, plan_digest, plan_shapes
from .scene import Contact, PostureProblem
from .scene.course import Course
from .verify import LARGEST_UNIT_M, check_posture

__all__ = ["BETWEEN", "GROUPS", "PlanReport", "PlanViolation", "check_joints", "check_plan", "plan_digest"]

BETWEEN = tuple(k / 6.0 for k in range(1, 6))
"""Shares of the way from one frame to the next at which it is recomputed."""
LIMB_GROUPS = ("patch", "friction", "force_bounds", "reach")
"""Groups of a posture whose index is a limb's."""


def check_plan(plan: Plan, *, tolerance: float = 1e-6, joints: bool = False, between: bool = True) -> PlanReport:
    """Check every constraint of the course at the plan; never raises for a bad plan.

    tolerance: largest violation allowed in any group, with lengths in the course's length scale, forces in the robot's
    weight, moments in their product and angles in rad. joints: ask inverse kinematics, too. between: recompute points
    between the frames; without them, what convexity proves of the way is taken as proved, in a third of the time.
    """
    defect, frame, limb = _defect(plan)
    if defect:
        return _refused(plan, tolerance, defect, frame, limb)
    angles = check_joints(plan) if joints else {"verdict": "not asked for"}
    return _measured(plan, tolerance, angles, BETWEEN if between else ())


def check_joints(plan: Plan) -> dict[str, Any]:
    """Can the joints do it? verdict: checked, failed or not checked, a message, and what was measured."""
    from .kinematics import joint_report

    try:
        report = joint_report(plan)
    except InvalidInput as error:
        return {"verdict": "not checked", "message": str(error)}
    worst = {"error": report.worst_error, "limit": report.worst_limit, "torque": report.worst_torque}
    return {
        "verdict": "checked" if report.accepted else "failed",
        "message": report.message,
        "error_m": float(report.error_m.max()),
        "limit_rad": float(report.limit_rad.max()),
        "torque_nm": float(report.torque_nm.max()),
        "shift_m": float(report.shift_m.max()),
        "worst": {name: {"frame": frame, "limb": limb} for name, (frame, limb) in worst.items()},
    }


class _Findings:
    """The worst violation of every group so far."""

    def __init__(self, course: Course) -> None:
        length = min(course.length_scale_m, LARGEST_UNIT_M)
        self.scales = {"m": length, "N": course.weight_n, "rad": 1.0, "": 1.0}
        self.worst = {group: PlanViolation(group, 0.0, 0.0, unit, -1, "") for group, unit in GROUPS.items()}
        self.between = 0.0

    def note(self, group: str, value: float, frame: int, limb: str = "") -> None:
        """Note a violation in SI; what is 0 or less is none."""
        unit = GROUPS[group]
        if not value <= 0.0:  # NaN is noted
            self._keep(PlanViolation(group, value / self.scales[unit], value, unit, frame, limb))

    def note_posture(self, problem: PostureProblem, posture: Posture, frame: int, share: float = 0.0) -> None:
        """Note what the verifier of postures finds in a stance, or ``share`` of the way to the next frame."""
        report = check_posture(problem, posture)
        if share:
            self.between = max(self.between, report.worst)
        for found in report.groups:
            limb = problem.legs[found.index] if found.group in LIMB_GROUPS and found.index >= 0 else ""
            self._keep(PlanViolation(found.group, found.worst, found.value, found.unit, frame, limb, share))

    def _keep(self, new: PlanViolation) -> None:
        worst = new.worst if new.worst == new.worst else math.inf
        if worst > self.worst[new.group].worst:
            self.worst[new.group] = PlanViolation(new.group, worst, new.value, new.unit, new.frame, new.limb, new.share)


def _measured(plan: Plan, tolerance: float, joints: dict[str, Any], shares: tuple[float, ...]) -> PlanReport:
    course = plan.course
    stands = _stands(course)
    found = _Findings(course)
    for row, stance in enumerate(course.stances):
        k, limbs = stance.frame, list(stance.limbs)
        problem = _problem(plan, stands[k], limbs, course.com_nominal_m[k], float(course.com_radius_m[k]))
        found.note_posture(problem, _posture(plan, stands[k], limbs, k, plan.forces_n[row]), k)
        for i in set(range(len(course.robot.limbs))) - set(limbs):
            found.note("idle_force", float(np.linalg.norm(plan.forces_n[row, i])), k, course.robot.limb_names[i])
    _check_toes(plan, stands, found)
    _check_steps(plan, stands, found)
    proved = _check_way(plan, stands, found, shares)
    bent, exact_m = _linearisation(plan, stands)
    groups = tuple(found.worst.values())
    worst = max(group.worst for group in groups)
    return PlanReport(
        accepted=worst <= tolerance, worst=worst, groups=groups, tolerance=tolerance, plan=plan,
        between=found.between if shares else math.nan, proved=proved, linearisation_m=bent, exact_reach_m=exact_m,
        goal_m=float(np.linalg.norm(plan.com_m[-1] - course.goal_m)), joints=joints,
    )  # fmt: skip


def _stands(course: Course) -> NDArray[np.int_]:
    """The placement that each limb stands on at each frame, shape (M, N), from the placements alone."""
    names = course.robot.limb_names
    stands = np.full((course.frames, len(names)), -1)
    for p in sorted(range(len(course.placements)), key=lambda p: course.placements[p].frame):
        stands[course.placements[p].frame :, names.index(course.placements[p].limb)] = p
    return stands


def _problem(plan: Plan, stands: NDArray[np.int_], limbs: list[int], nominal: Array, radius: float) -> PostureProblem:
    """The posture problem of these limbs on the patches that the plan chose."""
    course = plan.course
    contacts = []
    for i in limbs:
        limb, p = course.robot.limbs[i], int(stands[i])
        contacts.append(
            Contact(
                leg=limb.name, shoulder_m=limb.shoulder_m, reach_m=limb.reach_m,
                patch=course.placements[p].candidates[int(plan.choice[p])],
                force_min=course.force_min, force_max=course.force_max,
            )
        )  # fmt: skip
    return PostureProblem(
        contacts=tuple(contacts), mass_kg=course.robot.mass_kg, com_nominal_m=nominal, com_radius_m=radius,
        gravity_m_s2=course.gravity_m_s2, length_scale_m=course.length_scale_m, tilt_limit_rad=course.tilt_limit_rad,
    )  # fmt: skip


def _posture(plan: Plan, stands: NDArray[np.int_], limbs: list[int], frame: int, forces: Array) -> Posture:
    return Posture(
        com_m=plan.com_m[frame], rotation_rad=plan.rotation_rad[frame], toes_m=plan.toes_m[stands[limbs]],
        forces_n=forces[limbs],
    )  # fmt: skip


def _check_toes(plan: Plan, stands: NDArray[np.int_], found: _Findings) -> None:
    """Toes that stand stay there; those of limbs that carry nowhere at a frame are in place and in reach, too."""
    course, robot = plan.course, plan.course.robot
    for p, put in enumerate(course.placements):
        if put.toe_m is not None:
            found.note("start", float(np.linalg.norm(plan.toes_m[p] - put.toe_m)), put.frame, put.limb)
    for k in range(course.frames):
        carrying = {i for stance in course.stances if stance.frame == k for i in stance.limbs}
        for i in set(range(len(robot.limbs))) - carrying:
            limb = robot.limbs[i]
            problem = _problem(plan, stands[k], [i], course.com_nominal_m[k], float(course.com_radius_m[k]))
            alone = check_posture(problem, _posture(plan, stands[k], [i], k, np.zeros((len(robot.limbs), 3))))
            for group in alone.groups:
                if group.group in ("patch", "reach"):
                    found.note(group.group, group.value, k, limb.name)


def _check_steps(plan: Plan, stands: NDArray[np.int_], found: _Findings) -> None:
    """Steps and progress between neighbouring frames (eq. 11)."""
    course, limits = plan.course, plan.course.steps
    for k in range(1, course.frames):
        step = plan.com_m[k] - plan.com_m[k - 1]
        turn = plan.rotation_rad[k] - plan.rotation_rad[k - 1]
        found.note("com_step", float(np.linalg.norm(step)) - limits.com_m, k)
        found.note("rotation_step", float(np.linalg.norm(turn)) - limits.rotation_rad, k)
        toe_steps = np.linalg.norm(plan.toes_m[stands[k]] - plan.toes_m[stands[k - 1]], axis=1)
        for name, size in zip(course.robot.limb_names, toe_steps, strict=True):
            found.note("toe_step", float(size) - limits.toe_m, k, name)
        ahead = course.com_nominal_m[k] - course.com_nominal_m[k - 1]
        length = float(np.linalg.norm(ahead))
        if length > 1e-9:
            found.note("progress", limits.progress_m - float(step @ ahead) / length, k)


def _check_way(plan: Plan, stands: NDArray[np.int_], found: _Findings, shares: tuple[float, ...]) -> int:
    """Somebody carries at every frame and on every way between two; returns how many ways are covered."""
    course = plan.course
    names = course.robot.limb_names
    kept = [[i for i, name in enumerate(names) if name not in lifted] for lifted in (*course.lifts, course.next_lift)]
    rows: list[list[int]] = [[] for _ in range(course.frames)]
    for row, stance in enumerate(course.stances):
        rows[stance.frame].append(row)

    def carrying(frame: int, limbs: list[int]) -> int:
        """A stance of these limbs, or of some of them, at the frame; −1 where there is none."""
        return next((row for row in rows[frame] if set(course.stances[row].limbs) <= set(limbs)), -1)

    for k in range(course.frames):
        for limbs in (kept[k], kept[k + 1]):
            if carrying(k, limbs or list(range(len(names)))) < 0:
                found.note("schedule", math.inf, k)
    covered = 0
    for k, limbs in enumerate(kept[1:-1]):
        before, after = carrying(k, limbs), carrying(k + 1, limbs)
        if not limbs or min(before, after) < 0:
            continue
        covered += 1
        for i in limbs:
            if stands[k, i] != stands[k + 1, i]:
                found.note("schedule", math.inf, k + 1, names[i])
        for share in shares:
            found.note_posture(*_between(plan, stands[k], limbs, (k, before, after), share), k, share)
    return covered


def _between(
    plan: Plan, stands: NDArray[np.int_], limbs: list[int], way: tuple[int, int, int], t: float
) -> tuple[PostureProblem, Posture]:
    """A point of the way from frame k to the next, from the stance in one row of forces to that in another."""
    course, (k, before, after) = plan.course, way
    nominal = (1.0 - t) * course.com_nominal_m[k] + t * course.com_nominal_m[k + 1]
    radius = (1.0 - t) * float(course.com_radius_m[k]) + t * float(course.com_radius_m[k + 1])
    posture = Posture(
        com_m=(1.0 - t) * plan.com_m[k] + t * plan.com_m[k + 1],
        rotation_rad=(1.0 - t) * plan.rotation_rad[k] + t * plan.rotation_rad[k + 1],
        toes_m=plan.toes_m[stands[limbs]],
        forces_n=((1.0 - t) * plan.forces_n[before] + t * plan.forces_n[after])[limbs],
    )
    return _problem(plan, stands, limbs, nominal, radius), posture


def _linearisation(plan: Plan, stands: NDArray[np.int_]) -> tuple[float, float]:
    """How far I + [Θ]× misplaces a shoulder, and how far a toe is out of reach with exp([Θ]×) [m]."""
    limbs = plan.course.robot.limbs
    bent = beyond = 0.0
    for k, theta in enumerate(plan.rotation_rad):
        for i, limb in enumerate(limbs):
            exact = _rotated(theta, limb.shoulder_m)
            bent = max(bent, float(np.linalg.norm(exact - limb.shoulder_m - cross(theta, limb.shoulder_m))))
            to_toe = plan.toes_m[stands[k, i]] - plan.com_m[k] - exact
            beyond = max(beyond, float(np.linalg.norm(to_toe)) - limb.reach_m)
    return bent, beyond


def _rotated(theta: Array, vector: Array) -> Array:
    """exp([Θ]×) v by Rodrigues' formula, shape (3,)."""
    angle = float(np.linalg.norm(theta))
    sine = 1.0 if angle < 1e-12 else math.sin(angle) / angle
    versine = 0.5 if angle < 1e-6 else (1.0 - math.cos(angle)) / angle**2
    once = cross(theta, vector)
    return np.asarray(vector + sine * once + versine * cross(theta, once))


def _defect(plan: Plan) -> tuple[str, int, str]:
    """What keeps the plan from being one at all, with its frame and limb; empty when nothing does."""
    course = plan.course
    for name, shape in plan_shapes(course).items():
        array = getattr(plan, name)
        if array is None and name == "modes":
            continue
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}", -1, ""
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers", -1, ""
        if np.abs(array).max(initial=0) > LARGEST:
            return f"{name}: expected magnitudes up to {LARGEST:g}, got {np.abs(array).max():g}", -1, ""
    for put, chosen in zip(course.placements, plan.choice, strict=True):
        if not 0 <= chosen < len(put.candidates):
            most = len(put.candidates) - 1
            return (
                f"choice: frame {put.frame}, limb {put.limb}: expected a candidate from 0 to {most}, got {chosen}",
                put.frame, put.limb,
            )  # fmt: skip
    return "", -1, ""


def _refused(plan: Plan, tolerance: float, defect: str, frame: int, limb: str) -> PlanReport:
    return PlanReport(
        accepted=False,
        worst=math.inf,
        groups=tuple(PlanViolation(group, math.inf, math.inf, unit, frame, limb) for group, unit in GROUPS.items()),
        tolerance=tolerance,
        plan=plan,
        defect=defect,
    )
