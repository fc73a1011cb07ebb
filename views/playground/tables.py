"""Tables of a playground beside its picture: the verdict with its reason, and what every limb
gives, against limits.
"""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import WHOLE_BODY, acceptance_word
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.problem import Problem
from stancekit.planners.robot.chain import rotation_of
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.verify import Report

from ..plans import between
from ..sheet import leg_colour
from .answer import SceneAnswer
from .page_parts import BAD, GOOD, QUIET, RULE, TROUGH, UNSURE, said

TIGHT = 0.95
"""A limit that is used this far is marked."""
CARRIES_N = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LimbLoad:
    """Load of one limb.

    Arguments:
        cone: of its friction cone, torque: of a joint's limit, both as shares; NaN where unknown.
        torque_nm: of the joint that has the least in hand [Nm].
    """

    name: str
    force_n: float
    cone: float
    torque_nm: float = float("nan")
    torque: float = float("nan")
    in_air: bool = False


def loads(plan: Plan, now: Samples, solver: Kinematics | None) -> list[LimbLoad]:
    """Loads of every limb at a time.

    Arguments:
        solver: of the plan's robot; without it no torque is known.
    """
    loads_of_limbs = list[LimbLoad]()
    torques, shares = _torques(plan, now, solver)
    for i, name in enumerate(plan.problem.robot.limb_names):
        force = now.forces_n[i]
        loads_of_limbs.append(
            LimbLoad(
                name=name,
                force_n=float(np.linalg.norm(force)),
                cone=cone_share(force, now.normals[i], float(now.friction[i])),
                torque_nm=torques[i],
                torque=shares[i],
                in_air=not now.stands[i],
            )
        )
    return loads_of_limbs


def cone_share(force_n: Array, normal: Array, friction: float) -> float:
    """|tangential force| / (μ · normal force), 1 at the border of the cone; NaN for a force that is
    none.
    """
    pressed = float(force_n @ normal)
    aside = float(np.linalg.norm(force_n - pressed * normal))
    if pressed < CARRIES_N:
        return float("nan")
    return aside / max(friction * pressed, 1e-9) if aside > 1e-6 * pressed else 0.0


def margins(plan: Plan) -> tuple[float, int, str]:
    """The largest share of a friction cone that any stance uses, its key frame, and its limb."""
    course, worst = plan.problem, (0.0, 0, "")
    for stance, forces in zip(course.stances, plan.forces_n, strict=True):
        for i in stance.limbs:
            patch = course.patch(int(course.holds[stance.frame, i]), plan.choice)
            share = cone_share(forces[i], patch.normal, patch.friction)
            if share > worst[0]:
                worst = (share, stance.frame, course.robot.limb_names[i])
    return worst


def _torques(
    plan: Plan, now: Samples, solver: Kinematics | None
) -> tuple[list[float], list[float]]:
    """For each limb the torque of the joint that is nearest to its limit [Nm], and its share of the
    joint's limit.
    """
    count = len(plan.problem.robot.limbs)
    if solver is None:
        return [float("nan")] * count, [float("nan")] * count
    angles = now.angles_rad
    if angles is None:
        near = None if plan.joints_rad is None else between(plan.joints_rad, now.frame)
        angles = solver.solve(
            now.com_m, now.rotation_rad, now.toes_m, normals=now.normals, seed=near
        ).angles
    torque = np.abs(solver.torques(angles, rotation_of(now.rotation_rad), now.forces_n))
    share = torque / solver.torque_nm
    worst = [solver.joints_of(i)[int(share[solver.joints_of(i)].argmax())] for i in range(count)]
    return [float(torque[j]) for j in worst], [float(share[j]) for j in worst]


def solver_of(course: Problem) -> Kinematics | None:
    """The legs of a course's robot; None where they are not known, or pinocchio is not
    installed.
    """
    try:
        return Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    except InvalidInput:
        return None


def verdict(answer: SceneAnswer, number: int, drawn_ms: float) -> str:
    """The verdict as HTML.

    Arguments:
        number: of the change that it answers.
        drawn_ms: since that change.
    """
    colour, title, text = _words(answer)
    took = (
        f"judged in {sum(answer.seconds):.1f} CPU-s"
        if answer.patient
        else f"drawn after {drawn_ms:.0f} ms"
    )
    return said(
        colour, title, text, f"change {number} · {took}", change=number, patient=answer.patient
    )


def _words(answer: SceneAnswer) -> tuple[str, str, str]:
    """Colour, title and sentence."""
    if answer.course is None:
        return BAD, "No course", answer.message
    if answer.status is Status.INFEASIBLE:
        return BAD, "No plan, and that is proved" if answer.patient else "No plan", answer.message
    if answer.accepted:
        assert answer.report is not None
        title, *_ = acceptance_word(answer.report.unchecked).capitalize().partition(":")
        return GOOD, title, " ".join(filter(None, (_accepted(answer.report), answer.message)))
    if answer.plan is not None and not answer.patient:
        return (
            UNSURE,
            "Contacts hold",
            "Joints, torques and bodies are judged once nothing is changed.",
        )
    if answer.plan is not None:
        return BAD, "Not accepted", answer.message
    more = "" if answer.patient else "; the search goes on when nothing is changed"
    return UNSURE, "Undecided", f"{answer.message}{more}"


def _accepted(report: Report[Plan]) -> str:
    """Line on what was judged, and what could not be."""
    done = ["contacts", *(name for name in WHOLE_BODY if report.group(name).verdict == "holds")]
    finding = report.message.removeprefix(acceptance_word(report.unchecked)).lstrip(":; ")
    words = f"{finding}. Judged: {', '.join(done)}."
    if len(done) <= len(WHOLE_BODY):
        words += f" {report.body_message}."
    return words[0].upper() + words[1:]


def limb_table(rows: list[LimbLoad], title: str) -> str:
    """Forces, shares of cones, and torques of limbs as HTML, with bars against the limits."""
    cell = 'style="text-align:right;white-space:nowrap;padding:1px 4px"'
    head = "".join(
        f'<th style="text-align:{side};font-weight:600;padding:1px 4px;color:{QUIET}">{words}</th>'
        for side, words in (
            ("left", "limb"),
            ("right", "force [N]"),
            ("left", "of its cone"),
            ("right", "torque [Nm]"),
            ("left", "of its limit"),
        )
    )
    lines = []
    for k, row in enumerate(rows):
        dot = f'<span style="display:inline-block;width:9px;height:9px;border-radius:5px;background:{leg_colour(k)}">'
        force = "in the air" if row.in_air else f"{row.force_n:.1f}"
        torque = "–" if np.isnan(row.torque_nm) else f"{row.torque_nm:.1f}"
        lines.append(
            f"<tr><td style='white-space:nowrap;padding:1px 4px'>{dot}</span> "
            f"{html.escape(row.name)}</td>"
            f"<td {cell}>{force}</td><td>{_bar(row.cone)}</td><td "
            f"{cell}>{torque}</td><td>{_bar(row.torque)}</td></tr>"
        )
    return (
        f'<div id="limbs" style="font:12px/1.5 system-ui,sans-serif;margin:4px 2px;'
        f'font-variant-numeric:tabular-nums"><b>{html.escape(title)}</b>'
        f'<table style="border-collapse:collapse;width:100%"><tr style="border-bottom:1px solid {RULE}">{head}</tr>'
        f"{''.join(lines)}</table>"
        f'<div style="color:{QUIET};font-size:11.5px">{html.escape(explained([row.name for row in rows]))}</div></div>'
    )


SIDES, PLACES = {"L": "left", "R": "right"}, {"F": "front", "M": "middle", "R": "rear", "H": "hind"}


def explained(limbs: list[str]) -> str:
    """The names of limbs in words, seen by the robot, and what the shares of the table are of."""
    names = [
        f"{name} {SIDES[name[0]]} {PLACES[name[1]]}"
        for name in limbs
        if len(name) == 2 and name[0] in SIDES and name[1] in PLACES
    ]
    seen = f"{', '.join(names)}, as the robot looks. " if names else ""
    return f"{seen}Cone: share of the friction that its force may use. Limit: of the joint with the least torque left."


def summary(answer: SceneAnswer) -> str:
    """The plan in a few numbers, as HTML; empty without one."""
    plan = answer.plan
    if plan is None:
        return ""
    course = plan.problem
    share, frame, limb = margins(plan)
    to_goal = 1e3 * float(np.linalg.norm(plan.com_m[-1] - course.goal_m))
    rows = [
        ("robot", f"{course.robot.name}, {course.robot.mass_kg:.3g} kg ({course.weight_n:.1f} N)"),
        (
            "friction in hand",
            f"{100 * (1 - share):.0f} % at least" + (f" (frame {frame}, {limb})" if limb else ""),
        ),
        ("planned with", f"{100 * answer.share:.0f} % of the friction"),
        ("ends", f"{to_goal:.0f} mm from the goal, after {course.frames} key frames"),
    ]
    if (
        answer.report is not None
        and (most := answer.report.group("torque").figures.get("share")) is not None
    ):
        rows.insert(2, ("torque in hand", f"{100 * (1 - float(most)):.0f} % at least"))
    return key_values(rows)


def key_values(rows: list[tuple[str, str]]) -> str:
    """A few numbers with their names, as HTML."""
    return (
        '<table id="summary" style="font:12px/1.55 system-ui,sans-serif;margin:2px">'
        + "".join(
            f'<tr><td style="color:{QUIET};padding-right:10px;white-space:nowrap">{html.escape(name)}</td>'
            f"<td>{html.escape(words)}</td></tr>"
            for name, words in rows
        )
        + "</table>"
    )


def _bar(share: float) -> str:
    """A share of a limit as a bar with its number; NaN is a dash."""
    if np.isnan(share):
        return f'<span style="color:{QUIET}">–</span>'
    colour = BAD if share > 1.0 + 1e-6 else UNSURE if share > TIGHT else GOOD
    return (
        f'<div style="display:flex;align-items:center;gap:5px"><div style="flex:1;min-width:34px;height:8px;'
        f'background:{TROUGH};border-radius:4px;overflow:hidden"><div style="width:{100 * min(share, 1.0):.0f}%;'
        f'height:100%;background:{colour}"></div></div><span style="width:34px;text-align:right">{100 * share:.0f} %'
        "</span></div>"
    )
