"""The judge of a crossing: every part by its own verifier, what lies between them, and leaps against
all of the terrain, which they alone know nothing of.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from typing import Any

import numpy as np

from ..answer.certificate import Way
from ..answer.motion import Motion
from ..answer.plan import LeapPlan
from ..answer.report import Group, Report
from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import to_json
from ..motion.leap_motion import body_of
from ..physics import GRAVITY_M_S2
from ..problem.passage import Passage
from ..robot.model import Robot
from ..terrain.obstacles import Obstacles
from .bodies import looked_at
from .certificate import check_certificate
from .geometry import off_terrain
from .judge import judge
from .leaps import LeapBodyMeasurements

_TOES_M = 1e-6
"""Toes are where they were when the next part begins, within this [m]."""
_BODY_M, TURN_RAD = 2e-3, 0.1
"""So is the body, which goes from one pose to the other while all limbs stand [m, rad]."""
_JOINTS_RAD = 0.25
"""And every joint: what a centre of mass of the whole robot, by which leaps go, and one of its body,
by which key frames go, make of one pose [rad]."""
_BROKEN = np.inf
"""Value of a part's group whose numbers are none of a plan: nobody asks for its ends."""


_End = tuple[Array, Array, Array, Array | None]
"""State at an end of a part: centre of mass, rotation vector, toes, and angles of the joints where
they are known."""


def check_crossing(crossing: Motion[Way]) -> Report[Motion[Way]]:
    """Judge a crossing; never raises for a bad one.

    The groups are one per part, named "1: climb", "2: leap" and so on, with what its own verifier
    says; per seam between two parts toes, body, turn and joints; and "goal", where all of it ends.
    Of every leap, "flight": its whole body against all surfaces of the terrain, and "ground": its
    toes on the terrain.
    """
    groups, defect = list[Group](), _defect(crossing)
    if not defect:
        words = zip(crossing.parts, crossing.part_words, strict=True)
        for k, (part, word) in enumerate(words, 1):
            report = judge(part)
            groups.append(_verdict(f"{k}: {word}", report))
            if not (part.keyed or report.defect):
                groups += _over(crossing, k, part)
        if not any(group.value == _BROKEN for group in groups):
            groups += _seams(crossing)
            groups.append(_goal(crossing))
        groups += _proof(crossing)
    return Report(groups=tuple(groups), answer=crossing, tolerance=0.0, defect=defect)


def _defect(crossing: Motion[Way]) -> str:
    """Reason why the parts are not parts of one way; empty where there is none."""
    first = crossing.problem.course
    if to_json(crossing.parts[0].problem) != to_json(first):
        return "part 1: expected the course that the way is over, got another"
    terrain, robot, gravity = to_json(first.terrain), to_json(first.robot), first.gravity_m_s2
    for k, part in enumerate(crossing.parts, 1):
        other = differs(first.robot, part.problem.robot)
        rules: list[tuple[object, str]] = [(other, f"the robot of part 1, got another: {other}")]
        if part.keyed:
            asked, limbs = part.problem, "the robot of part 1, got another: their limbs differ"
            rules += [
                (to_json(asked.terrain) != terrain, "the terrain of part 1, got another"),
                (asked.gravity_m_s2 != gravity, "the gravity of part 1, got another"),
                (asked.wrench is not None, "no wrench on a body that leaps"),
                (to_json(asked.robot) != robot, limbs),
            ]
        else:
            usual = f"the gravity that leaps have, {GRAVITY_M_S2:g} m/s², got {gravity:g}"
            rules += [
                (not first.robot.own, f"a robot with legs of its own, got {first.robot.name}"),
                (gravity != GRAVITY_M_S2, usual),
                (not all(part.problem.still), "a leap that begins and ends at rest"),
            ]
        for wrong, wanted in rules:
            if wrong:
                return f"part {k}: expected {wanted}"
    return ""


def differs(mine: Robot, other: Robot) -> str:
    """Difference of two robots' masses, limbs or legs, in words; empty where there is none."""
    if not np.isclose(mine.mass_kg, other.mass_kg, rtol=1e-6):
        return f"{mine.mass_kg:g} kg and {other.mass_kg:g} kg"
    if mine.limb_names != other.limb_names:
        return f"limbs {', '.join(mine.limb_names)} and {', '.join(other.limb_names)}"
    if mine.digest == other.digest:
        return ""
    both = mine.digest and other.digest
    return "their legs are of different files" if both else "only one of them has legs of its own"


def _verdict(name: str, report: Report[Any]) -> Group:
    """Verdict of a part's own verifier."""
    worst = _BROKEN if report.defect else max(report.worst, 0.0)
    if not report.accepted:
        return Group(name, value=worst, unit="1", message=report.message, verdict="violated")
    if report.unchecked:
        left = ", ".join(report.unchecked)
        return Group(name, unit="1", message=f"{left} not checked", verdict="not checked")
    return Group(name, value=worst, limit=report.tolerance, unit="1", verdict="holds")


def _over(crossing: Motion[Way], k: int, plan: LeapPlan) -> Iterator[Group]:
    """A leap over the terrain: its toes on it, its whole body off it."""
    off = off_terrain(crossing.problem.terrain, plan.patches, np.asarray(plan.toes_m))
    j = int(np.argmax(off))
    yield Group(f"{k}: ground", value=float(off[j]), unit="m", where=plan.problem.footholds[j].limb)
    name, around = f"{k}: flight", Obstacles.of(crossing.problem.terrain)
    yield looked_at(name, lambda: LeapBodyMeasurements(body_of(plan)).bodies(name, around))


def _seams(crossing: Motion[Way]) -> Iterator[Group]:
    """Gaps between each part and the next."""
    for k, (before, after) in enumerate(pairwise(crossing.parts), 1):
        name, names = f"{k} to {k + 1}", crossing.robot.limb_names
        com, rotation, toes, angles = _end(before, last=True)
        com_then, rotation_then, toes_then, angles_then = _end(after, last=False)
        yield _seam(f"{name}: toes", np.linalg.norm(toes - toes_then, axis=1), _TOES_M, "m", names)
        yield _seam(f"{name}: body", np.linalg.norm([com - com_then], axis=1), _BODY_M, "m")
        yield _seam(
            f"{name}: turn", np.abs(rotation - rotation_then), TURN_RAD, "rad", ("x", "y", "z")
        )
        if angles is None or angles_then is None:
            message = "joints are not known on both sides"
            yield Group(f"{name}: joints", unit="rad", message=message, verdict="not checked")
            continue
        short = np.mod(angles - angles_then + np.pi, 2.0 * np.pi) - np.pi
        yield _seam(f"{name}: joints", np.abs(short), _JOINTS_RAD, "rad")


def _seam(name: str, values: Array, limit: float, unit: str, names: tuple[str, ...] = ()) -> Group:
    """The worst of what differs between two parts."""
    k = int(np.argmax(values))
    value = float(values[k]) if np.isfinite(values).all() else np.inf
    return Group(name, value=value, limit=limit, unit=unit, where=names[k] if names else "")


def _end(part: Motion[Any], *, last: bool) -> _End:
    """State in which a part begins, or ends."""
    k = -1 if last else 0
    com, rotation, angles = part.com_m[k], part.rotation_rad[k], part.joints_rad
    toes = part.toes_m[part.problem.holds[k]]
    if part.keyed:
        return com, rotation, toes, None if angles is None else angles[k]
    with suppress(InvalidInput):  # no legs, or no pinocchio
        body = body_of(part)
        return com, body.rotation_rad[k], toes, body.postures.angles[k]
    return com, rotation, toes, None


def _goal(crossing: Motion[Way]) -> Group:
    """Distance of where the last part ends from where the way is to end: parts that all hold may
    lead elsewhere.
    """
    asked = crossing.problem
    away_m = float(np.linalg.norm(crossing.parts[-1].com_m[-1, :2] - asked.goal_m))
    limit_m = float(asked.course.com_radius_m[-1]) + _BODY_M
    return Group("goal", value=away_m, limit=limit_m, unit="m")


def _proof(crossing: Motion[Way]) -> Iterator[Group]:
    """The proof that no balanced motion leads from start to goal, where there is one."""
    proof = crossing.problem.certificate
    if proof is None:
        return
    other = _another(crossing, proof.problem)
    report = None if other else check_certificate(proof)
    yield Group(
        "key frames alone",
        message=f"the proof is {other}" if report is None else report.message,
        verdict="holds" if report is not None and report.accepted else "violated",
    )


def _another(crossing: Motion[Way], problem: Any) -> str:
    """What a proof speaks of in place of the way of a crossing; empty for that way."""
    way = crossing.problem
    if problem is None or differs(crossing.robot, problem.robot):
        return "of another robot"
    if to_json(getattr(problem, "terrain", ())) != to_json(way.terrain):
        return "over another terrain"
    if not isinstance(problem, Passage):
        return "of one layout of key frames, which proves nothing of others"
    if np.linalg.norm(problem.start_m - way.course.com_nominal_m[0, :2]) > _BODY_M:
        return "of another start"
    return "of another goal" if np.linalg.norm(problem.goal_m - way.goal_m) > _BODY_M else ""
