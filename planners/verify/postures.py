"""The verifier of postures, plans of one frame: it knows the problem and the posture, not how the
posture was made.

It recomputes contact frames, rotation, balances, cones and reach from the problem's own numbers
(``stances``).
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..answer.motion import LATER
from ..answer.plan import WHOLE_BODY, Plan
from ..answer.report import (
    GROUPS,
    LATE,
    PLAN_GROUPS,
    Group,
    Report,
)
from ..errors import InvalidInput, TimeEnded
from ..files.arrays import LARGEST, Array, lengths
from ..problem import Problem
from ..problem.problem import NOBODY_CARRIES
from ..robot.robot_file import Servo
from .bodies import check_bodies
from .geometry import counts_of, exact_and_linear, forces_defect, row_counts
from .stances import BALANCES, OF_CONTACTS, Index, Schedule, Stances, units_of, violations, worst_of
from .trajectory_measurements import arrays_defect

if TYPE_CHECKING:
    from ..robot.kinematics import Kinematics


REACHED_M = 1e-5
"""A foot farther than this from its toe is not there."""
LIMIT_RAD = 1e-6
"""Angles that a plan brings may be so far beyond a limit."""


def check_whole_body(plan: Plan, *, deadline: float = math.inf) -> tuple[Group, ...]:
    """Check whether the robot can do it: the groups ``joints``, ``torque``, ``bodies`` and
    ``motion``.

    Nothing is checked without pinocchio, or if the robot's legs are not known; bodies are not
    checked without coal. A motion is not required of a course in which all limbs lift at once, so
    that nothing carries the robot between two frames.

    Arguments:
        plan: the plan to judge.
        deadline: time at which to stop, on the clock of ``time.perf_counter()`` [s]; groups that
            are not reached by then are not checked.
    """
    from ..robot.kinematics import Kinematics  # slow to import

    groups = dict[str, Group]()
    if plan.problem.uncarried:
        groups["motion"] = Group(
            "motion", unit="m", message=NOBODY_CARRIES, verdict="not asked for"
        )
    try:
        if time.perf_counter() > deadline:
            raise InvalidInput(LATE)
        solver = Kinematics(plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2)
        angles, groups["joints"], groups["torque"] = joint_groups(plan, solver=solver)
        judged = check_bodies(plan, angles, solver, deadline=deadline)
        groups |= {group.name: group for group in judged}
        if solver.soles and plan.joints_rad is not None and not plan.problem.uncarried:
            groups["torque"] = _on_the_way(plan, solver, groups["torque"], deadline)
    except InvalidInput as error:
        return tuple(
            groups.get(name, Group(name, message=str(error), verdict="not checked"))
            for name in WHOLE_BODY
        )
    return tuple(groups[name] for name in WHOLE_BODY)


def _on_the_way(plan: Plan, solver: Kinematics, torque: Group, deadline: float) -> Group:
    """The group ``torque`` with the joints' torques between key frames of a plan on soles, whose
    steps are not bent where these are too large.
    """
    if torque.verdict != "holds":
        return torque
    try:
        frames, torques, shares = shares_on_the_way(plan, solver, deadline=deadline)
    except TimeEnded:
        return replace(torque, message=LATE, verdict="not checked")
    row, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
    share, frame = float(shares[row, joint]), float(frames[row])
    if share <= 1.0:
        return torque
    limb = plan.problem.robot.limb_names[int(solver.legs[joint])]
    said = (
        f"frame {frame:.3g}, limb {limb}: on the way {abs(torques[row, joint]):.3g} Nm in a joint, "
        f"where {solver.joints[joint]} has {solver.torque_nm[joint]:g}"
    )
    return replace(
        torque,
        value=share,
        where=limb,
        limb=limb,
        when=frame,
        message=said,
        verdict="violated",
        figures={**torque.figures, "share": share, "worst": {"frame": frame, "limb": limb}},
    )


def shares_on_the_way(
    plan: Plan, solver: Kinematics, *, deadline: float = math.inf
) -> tuple[Array, Array, Array]:
    """Moments of a plan that has joint angles, and torques of all joints there, as of
    ``path_torques``, and these as shares of the joints' limits, shape (T, J).
    """
    from ..motion.joints import path_torques  # slow to import

    frames, torques = path_torques(plan, solver, deadline=deadline)
    return frames, torques, np.abs(torques) / np.minimum(solver.torque_nm, _torque_cap(plan))


def joint_groups(
    plan: Plan, servo: Servo | None = None, *, solver: Kinematics | None = None
) -> tuple[Array, Group, Group]:
    """Angles of every key frame, shape (M, J) [rad], and whether the joints can do it: the groups
    ``joints`` and ``torque``.

    Raises InvalidInput without pinocchio.

    A plan that says within which torque it was made is held to that, where joints have more.
    Figures beside the verdicts: limit_rad, how far a joint is beyond its limits, of angles found
    here how far it would have to be; shift_m, how far the whole robot's centre of mass is from the
    body's origin, which Lin et al. take for it, by which nothing is judged.

    Arguments:
        servo: drives the joints of drawn-up legs, in place of the robot's own.
        solver: of the plan's robot, in place of one with this servo.
    """
    from ..robot.kinematics import Kinematics, rotation_of  # slow to import

    course = plan.problem
    solver = solver or Kinematics(course.robot, servo, gravity_m_s2=course.gravity_m_s2)
    angles, error, limit, wrong = _postures(plan, solver)
    moments = plan.moments_nm if solver.soles else None
    torque = np.abs(
        [
            solver.torques(
                angles[of.frame],
                rotation_of(plan.rotation_rad[of.frame]),
                forces,
                None if moments is None else moments[s],
            )
            for s, (of, forces) in enumerate(zip(course.stances, plan.forces_n, strict=True))
        ]
    )
    if course.frames > 1:  # joints turn from frame to frame
        torque += solver.model.resistance[1]
    most = np.minimum(solver.torque_nm, _torque_cap(plan))
    shares = torque / most
    row, joint = (int(i) for i in np.unravel_index(int(np.argmax(shares)), shares.shape))
    frame, limb = course.stances[row].frame, course.robot.limb_names[int(solver.legs[joint])]
    tired = ""
    if (torque > most).any():
        tired = (
            f"frame {frame}, limb {limb}: {torque[row, joint]:.3g} Nm in a joint, "
            f"where {solver.joints[joint]} has {most[joint]:g}"
        )
    away, doubts = _where(error, course), solver.model.limit_doubts
    shifts = [np.linalg.norm(solver.com_offset(q) - course.robot.origin_m) for q in angles]
    joints = Group(
        name="joints",
        value=float(error.max()),
        limit=REACHED_M,
        unit="m",
        where=away["limb"],
        limb=away["limb"],
        when=away["frame"],
        message=wrong or "; ".join(doubts),
        verdict="violated" if wrong else "not checked" if doubts else "holds",
        figures={
            "error_m": float(error.max()),
            "limit_rad": float(limit.max()),
            "shift_m": float(max(shifts)),
            "worst": {"error": away, "limit": _where(limit, course)},
        },
    )
    unlimited = solver.model.lines_of(solver.model.torque_doubts)
    share = float(shares.max())
    return (
        angles,
        joints,
        Group(
            name="torque",
            value=share,
            limit=1.0,
            unit="1",
            where=limb,
            limb=limb,
            when=frame,
            message=tired or "; ".join(unlimited),
            verdict="violated" if tired else "not checked" if unlimited else "holds",
            figures={
                "torque_nm": float(torque.max()),
                "share": share,
                "worst": {"frame": frame, "limb": limb},
            },
        ),
    )


def _torque_cap(plan: Plan) -> float:
    """Largest torque that the plan allows any joint, whatever it has [Nm]; inf where it says
    nothing.
    """
    limit = plan.provenance.get("torque_nm")
    return float(limit) if isinstance(limit, int | float) and limit > 0.0 else np.inf


def _postures(plan: Plan, solver: Kinematics) -> tuple[Array, Array, Array, str]:
    """Angles, errors of the feet, what is beyond limits, and what is wrong with them."""
    from ..motion.joints import normals_at, plan_angles
    from ..robot.leg import rotation_of

    course, frames = plan.problem, list(range(plan.problem.frames))
    if plan.joints_rad is None:
        angles, error, limit = plan_angles(plan, solver)
    else:
        angles = plan.joints_rad
        feet = [
            solver.targets(
                plan.com_m[k],
                rotation_of(plan.rotation_rad[k]),
                plan.toes_at(k),
                normals_at(plan, k),
            )
            for k in frames
        ]
        error = np.array([np.linalg.norm(solver.feet(angles[k]) - feet[k], axis=1) for k in frames])
        error = np.maximum(error, _off_soles(plan, solver, angles))
        beyond, legs = solver.beyond(angles), range(len(course.robot.limbs))
        limit = np.stack([beyond[:, solver.joints_of(i)].max(axis=1) for i in legs], axis=1)
    wrong, place = list[str](), "frame {frame}, limb {limb}"
    if not error.max() <= REACHED_M:
        away = f"{1e3 * error.max():.3g} mm away from its toe"
        message = (
            f"its foot stays {away} within the joints' limits"
            if plan.joints_rad is None
            else f"its foot is {away}"
        )
        wrong.append(f"{place.format(**_where(error, course))}: {message}")
    if plan.joints_rad is not None and not limit.max() <= LIMIT_RAD:
        bent = place.format(**_where(limit, course))
        wrong.append(f"{bent}: a joint is {limit.max():.3g} rad beyond its limit")
    return angles, error, limit, "; ".join(wrong)


def _off_soles(plan: Plan, solver: Kinematics, angles: Array) -> Array:
    """Distance of the farthest point of each sole that bears forces from where the plan has it, shape
    (M, N) [m].
    """
    from ..robot.leg import rotation_of

    off = np.zeros((plan.problem.frames, len(plan.problem.robot.limbs)))
    for k, i in np.ndindex(off.shape):
        sole = plan.problem.robot.limbs[i].sole_m
        if sole is None or plan.points_m is None:
            continue
        turn = rotation_of(plan.rotation_rad[k])
        placed = solver.corners(angles[k], i, sole) - solver.robot.origin_m
        wanted = plan.points_m[plan.problem.holds[k, i], : len(sole)]
        off[k, i] = np.linalg.norm(plan.com_m[k] + placed @ turn.T - wanted, axis=1).max()
    return off


def _where(table: Array, course: Problem) -> dict[str, Any]:
    """Frame and limb of the largest number, of shape (K, N)."""
    row, limb = np.unravel_index(int(np.argmax(table)), table.shape)
    return {"frame": int(row), "limb": course.robot.limb_names[int(limb)]}


def plan_defect(plan: Plan) -> tuple[str, int, str]:
    """Defect that keeps the plan from being one at all, with its frame and limb; empty when nothing
    does.

    Looks at what there is, shapes and finiteness, of soles also whether forces at points add up.
    Nothing is raised.
    """
    course = plan.problem
    most = float(np.finfo(np.float64).max) if course.is_posture else LARGEST
    defect = arrays_defect(plan, course.columns(), LATER, most)
    if defect or not plan.choice.any():
        return defect or _points_defect(plan), -1, ""
    for foothold, chosen in zip(course.footholds, plan.choice, strict=True):
        if not 0 <= chosen < len(foothold.candidates):
            return (
                f"choice: frame {foothold.frame}, limb {foothold.limb}: expected a candidate from "
                f"0 to {len(foothold.candidates) - 1}, got {chosen}",
                foothold.frame,
                foothold.limb,
            )
    return _points_defect(plan), -1, ""


def _points_defect(plan: Plan) -> str:
    """Forces at the points of soles that do not add up; points of feet that have none."""
    limbs = plan.problem.robot.limbs
    if plan.problem.has_soles and plan.point_forces_n is not None:
        return forces_defect(plan.forces_n, plan.point_forces_n, counts_of(limbs))
    for name in ("points_m", "point_forces_n"):
        if (array := getattr(plan, name)) is not None:  # nothing would judge them
            return f"{name}: expected none on point feet, got shape {array.shape}"
    return ""


_PARTS = {
    "force_balance": ("x", "y", "z"),
    "moment_balance": ("x", "y", "z"),
    "tilt": ("x", "y", "z"),
    "force_bounds": ("n", "y", "z"),
}
"""Names of the columns of a group."""


def posture_report(posture: Plan, tolerance: float) -> Report[Plan]:
    """The report on the plan of a posture problem that has no defect.

    The two balances are judged by the Euclidean norm of what is left over.

    Arguments:
        tolerance: as of ``check_plan``, with lengths in the length scale, forces in the force
            scale, moments in their product and angles in rad.
    """
    problem = posture.problem
    with np.errstate(all="ignore"):
        at = Stances.of_postures((posture,))
        limb = Schedule.of_posture(row_counts(problem.contacts), counts_of(problem.contacts)).limb
        zeros = np.zeros(len(limb), dtype=np.intp)
        groups = worst_groups(at, violations(at), zeros, zeros, limb, problem.legs, tolerance)
    if not all(math.isfinite(group.value) for group in groups.values()):
        return refused(posture, tolerance, "the numbers overflow")
    exact, linear = exact_and_linear(at.rotation_rad[at.owner], at.shoulders_m)
    out = lengths(at.toes_m - at.com_m[at.owner] - exact) - at.reach_m
    figures = {
        "residual_nm": groups["moment_balance"].value,
        "linearisation_m": float(lengths(exact - linear).max()),
        "exact_reach_m": max(0.0, float(out.max())),
    }
    return Report(
        groups=tuple(groups.values()), answer=posture, tolerance=tolerance, figures=figures
    )


def check_postures(postures: Sequence[Plan], *, without: Collection[str] = ()) -> Array:
    """The ``worst`` of ``check_plan`` for many plans of posture problems at once, shape (B,); inf
    for what is none.

    Problems may have any number of contacts.

    Who has the numbers as arrays can ask ``worst_of`` a ``Stances``.

    Arguments:
        without: groups that are left out, e.g. the moment balance for points of P̄.
    """
    worst = np.full(len(postures), np.inf)
    rows = [k for k, posture in enumerate(postures) if not plan_defect(posture)[0]]
    if rows:
        with np.errstate(all="ignore"):
            at = Stances.of_postures([postures[k] for k in rows])
            result = violations(at)
            worst[rows] = worst_of(
                at, {group: values for group, values in result.items() if group not in without}
            )
    return worst


def worst_groups(
    at: Stances,
    found: dict[str, Array],
    frame: Index,
    share: Array | Index,
    limb: Index,
    names: Sequence[str],
    tolerance: float,
) -> dict[str, Group]:
    """The worst violation of every group and where it is.

    Arguments:
        at: the stances.
        found: their ``violations``.
        frame, share: key frame of each stance, and how far it is on the way to the next.
        limb: of each contact, an index of ``names``.
        names: of the limbs.
        tolerance: largest violation that is accepted, without unit.
    """
    worst, units = {}, units_of(at)
    for group, unit in GROUPS.items():
        values = found[group]
        if group in BALANCES:
            sizes = lengths(values)
            row = int(sizes.argmax())
            value, column = float(sizes[row]), int(np.abs(values[row]).argmax())
        else:
            row, column = divmod(int(values.argmax()), values.shape[1] if values.ndim == 2 else 1)
            value = float(values[row] if values.ndim == 1 else values[row, column])
        stance = int(at.owner[row]) if group in OF_CONTACTS else row
        scale = float(units[unit][stance])
        if value <= 0.0:
            worst[group] = violation(group, 0.0, scale, tolerance, unit=unit)
            continue
        worst[group] = violation(
            group,
            value,
            scale,
            tolerance,
            unit=unit,
            limb=names[limb[row]] if group in OF_CONTACTS else "",
            part=_PARTS[group][column] if group in _PARTS else "",
            when=float(frame[stance] + share[stance]),
        )
    return worst


def violation(
    name: str,
    value: float,
    scale: float,
    tolerance: float,
    *,
    unit: str,
    limb: str = "",
    part: str = "",
    when: float | None = None,
) -> Group:
    """A group whose value is a violation, judged without its unit; no number is a violation without
    bound.

    Arguments:
        name: of the group.
        value: the violation, 0 or less where there is none, in ``unit``.
        scale: the violation that counts as 1, in ``unit``.
        tolerance: largest violation that is accepted, without unit.
        unit, limb, when: as of ``Group``.
        part: component of the force or axis of the world; empty where there is none.
    """
    value = value if value == value else math.inf
    holds = value / scale <= tolerance
    return Group(
        name=name,
        value=value,
        limit=tolerance * scale,
        unit=unit,
        where=f"{limb} {part}".strip(),
        limb=limb,
        when=when,
        scale=scale,
        verdict="holds" if holds else "violated",
    )


class Worst:
    """The worst violation of every group, which measurements note one after the other.

    Arguments:
        units: of each group, and the violation in it that counts as 1.
        limbs: their names.
        tolerance: as of ``violation``.
    """

    def __init__(
        self, units: Mapping[str, tuple[str, float]], limbs: Sequence[str], tolerance: float
    ) -> None:
        self._limbs, self._tolerance = limbs, tolerance
        self.groups = dict[str, Group]()
        for name, (unit, scale) in units.items():
            self.add(name, unit, scale)

    def add(self, name: str, unit: str, scale: float) -> None:
        """Add a group in which nothing is violated yet."""
        self.groups[name] = violation(name, 0.0, scale, self._tolerance, unit=unit)

    def note(
        self,
        group: str,
        by: Array | float,
        when: NDArray[np.int_] | int,
        limbs: NDArray[np.int_] | None = None,
        scale: float = 0.0,
    ) -> None:
        """Note the worst of R violations in SI; 0 and less violate nothing.

        Arguments:
            by: shape (R, …); what is no number is a violation without bound.
            when, limbs: frame or interval, and limb, of each, shape (R,).
            scale: another violation that counts as 1, where it is not 0.
        """
        when, known = np.atleast_1d(when), self.groups[group]
        if not len(when):
            return
        values = np.reshape(by, (len(when), -1)).max(axis=1)
        row = int(values.argmax())
        worst = violation(
            group,
            float(values[row]),
            scale or known.scale or 1.0,
            self._tolerance,
            unit=known.unit,
            limb="" if limbs is None else self._limbs[int(limbs[row])],
            when=int(when[row]),
        )
        if worst.worst > known.worst:
            self.groups[group] = worst


def refused(
    plan: Plan, tolerance: float, defect: str, *, frame: int = -1, limb: str = ""
) -> Report[Plan]:
    """The report on what is no plan of its problem at all: every group is violated without bound.

    Arguments:
        plan: what was to be judged.
        tolerance: as of ``Report``.
        defect: what is wrong, in words.
        frame, limb: where it is, −1 and empty where it is nowhere in particular.
    """
    when = None if frame < 0 else float(frame)
    figures = {"residual_nm": math.inf, "linearisation_m": math.nan, "exact_reach_m": math.nan}
    of_plan = not plan.problem.is_posture
    if of_plan:
        figures |= {"between": math.inf, "goal_m": math.nan, "proved": 0}
    body = [Group(name, verdict="not asked for") for name in WHOLE_BODY if of_plan]
    violated = [
        violation(name, math.inf, 1.0, tolerance, unit=unit, limb=limb, when=when)
        for name, unit in (PLAN_GROUPS if of_plan else GROUPS).items()
    ]
    return Report(
        groups=(*violated, *body), answer=plan, tolerance=tolerance, figures=figures, defect=defect
    )
