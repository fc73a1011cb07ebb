"""Files of answers, checked anew: those that carry their question, and answers beside their
problems.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit import Certificate, InvalidInput, Motion, Problem, Robot
from stancekit.planners.answer.answer import UNBOUNDED
from stancekit.planners.answer.report import or_null
from stancekit.planners.errors import located
from stancekit.planners.files.arrays import checked_choice
from stancekit.planners.files.documents import read_json, shown
from stancekit.planners.terrain.import_options import ImportOptions, check_unasked, doubt, doubts
from stancekit.planners.terrain.obstacles import Ground
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.judge import TOLERANCE

if TYPE_CHECKING:
    from stancekit import Dataset, FileCheck, LeapTries, Patch, RecheckReport

_LIMIT_S = 60.0
"""A contact sequence is completed, or its fault found, by then [s]."""
_FRICTION = 0.75
"""Friction of heights under a motion from elsewhere, as of walks that are asked for without one."""
_HELD_M = 1e-3
"""Heights describe a mesh that is everywhere so near to them [m]: on its triangles, and as it is
seen from above."""
_ON_TRIANGLES = np.array([*np.eye(3), *(0.5 - 0.5 * np.eye(3)), np.full(3, 1.0 / 3.0)])
_ON_TRIANGLES.setflags(write=False)
"""Where that is looked at: corners, middles of edges, and the middle, as shares of the corners."""
_MANY = 5_000
"""Triangles whose surfaces take minutes to find, and to judge by: more are judged by their heights,
and what asks where the ground is holds by none that are off it."""
_WALKED = "{}: judged by heights whose edges are rounded, as walks over it have them"
"""Of a motion that holds on them alone."""
_TOLD_M = 1e-3
"""A toe that is farther out of reach with the exact rotation than with I + [Θ]× by this is told of
[m]."""
_EVIDENCE: dict[str, Any] = {
    "feasible": Motion,
    "infeasible": Certificate,
    "undecided": None,
    "invalid": None,
}
"""Evidence that an answer of each status has to hold."""
_CALLED: dict[Any, str] = {Motion: "a posture", Certificate: "a certificate", None: "nothing"}


def check_file(
    path: str | Path,
    *,
    tolerance: float = TOLERANCE,
    robot: str | Path | None = None,
    course: str | None = None,
    terrain: str | Path | None = None,
    options: ImportOptions = ImportOptions(),
    why: bool = False,
    exact: bool = False,
    margins: bool = False,
) -> FileCheck:
    """Check a file of a plan, a proof, a leap or a walk against the question in it, whatever it
    says of itself; or a motion from elsewhere, for a robot and a terrain.

    Arguments:
        tolerance: largest violation that a plan may have.
        robot: name or file of the robot that a plan or a walk must be for.
        course: course that a plan must be for, as ``plan`` takes it.
        terrain: terrain of a motion, see ``_check_motion``.
        options: what the numbers of the terrain's file mean.
        why: ask for a reason, which only proofs have.
        exact: replay a proof in exact arithmetic, too.
        margins: measure what the stances of a plan bear beyond its weight.

    Raises:
        InvalidInput: for a file that holds none of them, and for one of another robot or course.
    """
    from stancekit.planners.formats import motion_file
    from stancekit.planners.formats.table_file import is_table

    data = read_json(path) if Path(path).suffix == ".json" else None
    limited = tolerance != TOLERANCE
    if terrain is None or Path(terrain).suffix == ".json":
        check_unasked(options, str(terrain or path))
    if data is None:
        from stancekit.planners.problem.sequence import is_sequence  # and courses with it

        if is_sequence(path):
            check_unused(
                "a sequence", tolerance=limited, course=course, exact=exact, margins=margins
            )
            return _check_sequence(Path(path), robot, terrain, options, why)
    if is_table(path, data):
        check_unused("a motion", tolerance=limited, explain=why, exact=exact, margins=margins)
        return _check_motion(Path(path), robot, course, terrain, options)
    check_unused("what is no motion", terrain=terrain)
    if not motion_file.is_evidence(data):
        wanted = (
            "expected a data set folder, a motion or a proof; beside posture problems, the file of "
            "their answers (stancekit solve PROBLEMS --certificate --out ANSWERS)"
        )
        if isinstance(data, dict):
            wanted += f", got format {shown(data.get('format'))}"
        raise InvalidInput(f"{path}: {wanted}")
    who = None if robot is None else str(robot)
    return motion_file.check_file(
        path,
        data=data,
        tolerance=tolerance if limited else None,
        robot=who,
        course=None if course is None else _course(course, who),
        why=why,
        exact=exact,
        margins=margins,
    )


def check_unused(of: str, **given: object) -> None:
    """Raise InvalidInput for an option that was given, and that such a file has no use for."""
    for option, value in given.items():
        if value:
            raise InvalidInput(f"{option}: expected none with {of}, got it")


def _check_motion(
    path: Path,
    robot: str | Path | None,
    course: str | None,
    terrain: str | Path | None,
    options: ImportOptions,
) -> FileCheck:
    """Check a motion from elsewhere, see ``check_file``.

    Arguments:
        terrain: ground by name, its polygons where it has some, or else the heights that walks go
            over; heights by file; or the file of a plan or a walk, whose robot and ground are taken.
        course: course, as ``plan`` takes it, whose patches are the terrain, and whose robot is
            taken if no other is given.
        options: of a file of heights.
    """
    from stancekit.planners.formats import motion_file
    from stancekit.planners.formats.motion_file import FileCheck
    from stancekit.planners.formats.table_file import read_table
    from stancekit.planners.physics import GRAVITY_M_S2
    from stancekit.planners.terrain.reference import named_terrain, names_ground
    from stancekit.planners.verify.motions import check_motion
    from stancekit.runner.export.formats import read_keys, scene_of

    if (terrain is None) == (course is None):
        surplus = "neither" if terrain is None else "both"
        raise InvalidInput(
            f"terrain: expected the ground that {path} moves over, as the name or file of heights or "
            f"the file of a plan or a walk, or a course in its place, got {surplus}"
        )
    who = None if robot is None else _legged(robot)
    gravity_m_s2 = GRAVITY_M_S2
    ground: Sequence[Patch] | Ground
    with doubts() as heard:
        if course is not None:
            from stancekit.planners.problem.course_file import read_course

            problem = read_course(
                course,
                None,
                None if robot is None or Path(course).suffix in (".json", ".jsonl") else str(robot),
            )
            ground, gravity_m_s2, who = problem.terrain, problem.gravity_m_s2, who or problem.robot
            heard += problem.doubts
        elif Path(str(terrain)).suffix == ".json":
            moved = motion_file.read_motion(str(terrain))[0]
            its_robot, _, ground, gravity_m_s2 = scene_of(moved)
            who = who or its_robot
            heard += moved.doubts
        else:
            ground = _ground(str(terrain), options)
    if who is None:
        raise InvalidInput(f"robot: expected who moves in {path}, got none")
    if not isinstance(ground, Ground) and not ground:
        raise InvalidInput(f"course: expected one with a terrain of its own, got {course}")
    table = read_keys(path) if path.suffix == ".xml" else read_table(path)
    with located(str(path)):
        report = check_motion(table, who, ground, gravity_m_s2=gravity_m_s2)
        if not (report.accepted or isinstance(ground, Ground)) and names_ground(str(terrain)):
            with suppress(InvalidInput):  # of surfaces that are all upright
                over = Ground(heights=named_terrain(str(terrain)), friction=_FRICTION)
                if (walked := check_motion(table, who, over)).accepted:
                    report, heard = walked, [*heard, _WALKED.format(terrain)]
    report = replace(report, more_doubts=tuple(heard))
    return FileCheck(path=str(path), kind="motion", report=report, message=report.message)


def _ground(name: str, options: ImportOptions) -> Sequence[Patch] | Ground:
    """Heights by name or file; the surfaces of a mesh, or of a family of polygons, that heights do
    not describe, as one with steps, holes, or sides that run along no axis, unless it has more than
    ``_MANY`` triangles.
    """
    from stancekit.planners.terrain.footholds import footholds_of
    from stancekit.planners.terrain.reference import named_surface, named_terrain, names_ground
    from stancekit.planners.terrain.terrain_file import read_terrain
    from stancekit.planners.terrain.triangle_mesh import TriangleMesh

    mesh: object = None
    if names_ground(name):
        check_unasked(options, name)
        mesh = named_surface(name)
    elif Path(name).is_file():
        mesh = read_terrain(name, options)
    if not isinstance(mesh, TriangleMesh):
        return Ground(heights=named_terrain(name, options), friction=_FRICTION)
    with suppress(InvalidInput):  # of holes, and of what is too steep for a spline
        points, many = _ON_TRIANGLES @ mesh.spread_m, len(mesh.triangles) > _MANY
        heights = named_terrain(name, options)
        off_m = points[..., 2] - heights.height(points[..., :2])
        seen_m = (mesh.off_m(heights, share) for share in (0.25, 0.5, 0.75))
        worst_m = max((off_m if many else np.abs(off_m)).max(), *seen_m)  # some are hidden below
        if many or worst_m < _HELD_M:
            said = (
                ""
                if worst_m < _HELD_M
                else doubt(
                    f"{name}: more than {_MANY} triangles, judged by heights that are up to "
                    f"{1e3 * worst_m:.3g} mm off them"
                )
            )
            return Ground(heights=heights, friction=_FRICTION, doubt=said)
    return footholds_of(mesh, friction=_FRICTION, none=True).surfaces


def _check_sequence(
    path: Path,
    robot: str | Path | None,
    terrain: str | Path | None,
    options: ImportOptions,
    why: bool,
) -> FileCheck:
    """Complete a contact sequence from elsewhere, or say what is wrong with it, see ``check_file``.

    Arguments:
        terrain, options: under its feet; None for the ground that the rows speak of.
        why: look for the nearest sequence that holds, too.
    """
    from stancekit.planners.formats.motion_file import FileCheck
    from stancekit.planners.problem.course_terrain import FileTerrain, footholds_for
    from stancekit.planners.problem.sequence import read_sequence
    from stancekit.planners.robot.robot_file import robot_of
    from stancekit.planners.search.doctor import diagnosed

    rows, who = read_sequence(path), robot_of("hexapod" if robot is None else robot)
    found = None if terrain is None else footholds_for(who, terrain, options=options)
    ground = None if found is None else FileTerrain.of(found).along(np.zeros((1, 3)), Path())
    with located(str(path)):
        report = diagnosed(rows, who, ground, mend=why, deadline=time.perf_counter() + _LIMIT_S)
    message = "; ".join(filter(None, (report.message, report.remark)))
    return FileCheck(path=str(path), kind="sequence", report=report, message=message)


def _legged(robot: str | Path) -> Robot:
    """The robot of a name or a file with its legs; what they reach is not looked at.

    Raises InvalidInput.
    """
    from stancekit.planners.robot.model import robot_of, walking_robot
    from stancekit.planners.robot.robot_file import named_robot
    from stancekit.planners.robot.walker import BUILT_IN

    name = str(robot)
    return walking_robot(BUILT_IN[name]()) if name in BUILT_IN else robot_of(named_robot(robot))


def check_rows(
    source: Dataset | LeapTries | str | Path, *, tolerance: float = TOLERANCE, why: bool = False
) -> RecheckReport:
    """Check every witness and every certificate of a data set, of its folder, or of one that ships
    by its name. Postures or tries of leaps: each row's evidence is what its label asks for.

    Arguments:
        tolerance, why: as for files, which are refused here.

    Raises:
        InvalidInput: also for what is no data set.
    """
    from stancekit.envs.data.leap_tries import LeapTries, open_rows
    from stancekit.envs.data.ledger import check_there
    from stancekit.learners.data.labelling import recheck
    from stancekit.learners.data.leap_tries import recheck_leaps

    if isinstance(source, str | Path):
        check_there(source)
    check_unused("a data set", explain=why, tolerance=tolerance != TOLERANCE)
    rows = open_rows(source) if isinstance(source, str | Path) else source
    return recheck_leaps(rows) if isinstance(rows, LeapTries) else recheck(rows)


def check_answers(
    problems: tuple[str, str],
    answers: tuple[str, str],
    *,
    tolerance: float = TOLERANCE,
    why: bool = False,
) -> Iterator[dict[str, Any]]:
    """Check the n-th answer of a text against the n-th problem of another: one record each, with
    its verdict.

    Arguments:
        problems, answers: each a text, and where it is from.
        why: say of every proof what would have to give.

    Raises:
        InvalidInput: for another number of answers than of problems; a record that cannot be read
            is "invalid".
    """
    from stancekit.planners.formats.question_file import (  # slow to import
        json_records,
        read_problems,
    )

    problems_read, claims = list(read_problems(*problems)), list(json_records(*answers))
    if len(problems_read) != len(claims):
        raise InvalidInput(
            f"{answers[1]}: expected {len(problems_read)} answers, one a problem, got {len(claims)}"
        )
    for (where, problem), (place, claim) in zip(problems_read, claims, strict=True):
        if isinstance(problem, InvalidInput) or isinstance(claim, InvalidInput):
            wrong = problem if isinstance(problem, InvalidInput) else claim
            yield {"where": where, "verdict": "invalid", "message": str(wrong)}
            continue
        try:
            yield {"where": where, **_verdict(problem, claim, tolerance, why)}
        except InvalidInput as error:
            yield {"where": where, "verdict": "invalid", "message": f"{place}: {error}"}


def _verdict(problem: Problem, claim: Any, tolerance: float, why: bool) -> dict[str, Any]:
    """Verdict on an answer; where the answer lacks its evidence, the verdict says so."""
    from stancekit.planners.formats.question_file import answer_from_json  # slow to import

    answer, status = answer_from_json(claim, problem), _status(claim)
    kind, expected = None if answer is None else type(answer), _EVIDENCE[status]
    if kind is not expected:
        hint = " (solve with --certificate)" if status == "infeasible" else ""
        message = (
            f"it says {status} and comes with {_CALLED[kind]}, expected {_CALLED[expected]}{hint}"
        )
        return {"verdict": "refused", "message": message}
    if isinstance(answer, Motion):
        report = check_plan(answer, tolerance=tolerance)
        message, beyond_m = _bare(report.message), report.figures["exact_reach_m"]
        if beyond_m > _TOLD_M:
            message += f"; {1e3 * beyond_m:.0f} mm out of reach with the exact rotation"
        return {
            "verdict": "accepted" if report.accepted else "refused",
            "kind": "posture",
            "message": message,
            "digest": report.digest,
            "exact_reach_m": or_null(beyond_m),
            "residual_nm": or_null(report.figures["residual_nm"]),
        }
    if answer is None:
        return {"verdict": "unclaimed", "message": f"the answer is {status}: nothing to check"}
    from stancekit.planners.verify import check_certificate, explain  # of proofs alone

    proof = check_certificate(answer)
    reason = f"; {explain(answer).message}" if why and proof.accepted else ""
    return {
        "verdict": "accepted" if proof.accepted else "refused",
        "kind": "certificate",
        "message": _bare(proof.message) + reason,
        "lower_bound": min(proof.figures["lower_bound"], UNBOUNDED),
        "leaves": proof.figures["leaves"],
    }


def _course(name: str, robot: str | None) -> Callable[[int], Problem]:
    """The course of a name or a file, of so many key frames where it can be had with others than
    its own.
    """
    from stancekit.planners.problem.course_file import read_course

    who = None if Path(name).suffix in (".json", ".jsonl") else robot

    def laid(frames: int) -> Problem:
        course = read_course(name, None, who)
        try:
            return course if course.frames == frames else read_course(name, frames, who)
        except InvalidInput:
            return course

    return laid


def _status(claim: Any) -> str:
    """The status that an answer claims; where it has none, the one that its evidence speaks for."""
    status = claim.get(
        "status",
        "infeasible" if "certificate" in claim else "feasible" if "toes_m" in claim else None,
    )
    checked_choice(status, "status", tuple(_EVIDENCE))
    return str(status)


def _bare(message: str) -> str:
    """The verifier's message without the verdict that it begins with."""
    return message.removeprefix("accepted: ").removeprefix("rejected: ")
