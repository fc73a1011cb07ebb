"""Forty questions, and the doors that take them: each is asked at every door, and all have to say
the same.

A door takes a question where a user can put it there as it is. These do not: ``Traverse-v0`` and
the closed loop (``run --policy``) ask for windows of a course from where their robot stands, and so
are compared with ``replan``, the function that both call; the playground takes courses as keys, and
no limit of torque; ``solve`` takes postures alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import stancekit
from stancekit import Answer, Motion, Status
from stancekit.cli.main import parse, run
from stancekit.cli.play import Play
from stancekit.cli.solve import Between
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import read_evidence
from stancekit.planners.problem import Problem
from stancekit.planners.problem.posture_batch import PostureBatch
from stancekit.planners.projection.held import PRESSES
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.search.answer import objective_of
from stancekit.planners.search.batch import decide_all
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.friction_margin import SHARES
from stancekit.planners.search.plan_course import replan
from stancekit.views.playground.answers import patient_answer
from tests.planners.robot.small_urdfs import quadruped

WALKS = stancekit.PlanSettings(leaps=False)
NARROW = {"com_radius_m": 0.005, "first_radius_m": 0.005, "tilt_limit_rad": 0.01}


@dataclass(frozen=True, kw_only=True)
class Question:
    """A course by its keys, or by a built-in name with a number of key frames, or a posture
    problem.

    expected: the status that it was made to have. torque_nm: no joint is to take more [Nm]; None:
    what it has. boxes: of a course between two places over a mesh, its boxes (x from, to, y from,
    to, top) [m]; foot_m: radius of the robot's feet, 0 for the default hexapod [m].
    """

    name: str
    expected: str
    keys: Mapping[str, Any] = field(default_factory=dict)
    posture: Problem | None = None
    torque_nm: float | None = None
    boxes: Sequence[Sequence[float]] = ()
    foot_m: float = 0.0

    def robot(self, folder: Path) -> str | None:
        """The robot of a course between two places, written as a user would."""
        if not self.foot_m:
            return None
        path = folder / f"{self.name}.urdf"
        path.write_text(quadruped().replace('radius="0.02"', f'radius="{self.foot_m}"'))
        return str(path)

    @property
    def settings(self) -> stancekit.PlanSettings:
        """Settings of the plan: its limit of the joints."""
        return stancekit.PlanSettings(body=stancekit.WholeBodyLimits(torque_nm=self.torque_nm))

    def file(self, folder: Path) -> Path:
        """Write it, and the robot that it names, as a user would."""
        if self.posture is not None:
            path = folder / f"{self.name}.json"
            write_text(path, json.dumps(self.posture.to_json()))
            return path
        if self.boxes:
            path = folder / f"{self.name}.obj"
            write_text(path, _mesh(self.boxes))
            return path
        (folder / "dog.urdf").write_text(quadruped())
        path = folder / f"{self.name}.yaml"
        write_text(path, json.dumps({"name": self.name, **self.keys}))  # JSON is YAML
        return path


@dataclass(frozen=True, kw_only=True)
class Reply:
    """What a door says: the status, the digest of the problem that a certificate proves, and the
    objective of a plan that is accepted; one that is not was bent as far as there was time.
    """

    status: str
    proved: str = ""
    objective: float = math.nan
    plan: str = ""
    """Digest of the plan's arrays."""

    def same(self, other: Reply) -> bool:
        """Whether both say the same, the objective to 1e-9."""
        near = math.isclose(self.objective, other.objective, rel_tol=1e-9, abs_tol=1e-12)
        both = math.isnan(self.objective) and math.isnan(other.objective)
        mine, theirs = ((r.status, r.proved, r.plan) for r in (self, other))
        return mine == theirs and (near or both)


def questions() -> Iterator[Question]:
    """All of them: hexapods on built-in terrain, a quadruped of a URDF, and postures."""
    for frames in (2, 3):
        for friction in (0.4, 0.7):
            yield Question(
                name=f"flat-{frames}-{friction:g}",
                expected="feasible",
                keys=_flat(frames, friction),
            )
    for gait in ("all", "wave"):
        yield Question(
            name=f"gait-{gait}", expected="feasible", keys=_flat(3, 0.6) | {"gait": gait}
        )
    for frames in (2, 3):
        for friction in (0.05, 0.1, 0.15):
            yield Question(
                name=f"slick-{frames}-{friction:g}",
                expected="infeasible",
                keys=_walls(frames, friction),
            )
    yield Question(name="walls", expected="feasible", keys=_walls(3, 1.0))
    for expected, heights_m in (
        ("feasible", (0.48, 0.5)),
        ("undecided", (0.52, 0.56, 0.57, 0.58)),
        ("infeasible", (0.69, 0.7, 0.71, 0.72)),
    ):
        for height_m in heights_m:
            yield Question(name=f"dog-{height_m:g}", expected=expected, keys=_dog(height_m))
    for torque_nm in (0.5, 1.0):
        yield Question(
            name=f"weak-{torque_nm:g}",
            expected="undecided",
            keys=_flat(2, 0.6),
            torque_nm=torque_nm,
        )
    for name, foot_m in (("hexapod", 0.0), ("small", 0.012), ("big", 0.045)):
        for ground, boxes in _grounds().items():
            yield Question(
                name=f"{ground}-{name}",
                expected="feasible",
                boxes=boxes,
                foot_m=foot_m,
            )
    for number, problem in enumerate(stancekit.sample("wall-3", 8, rng=7)):
        yield Question(name=f"wall-{number}", expected="", posture=problem)
    for number, problem in enumerate(stancekit.sample("ground-3", 9, rng=7)):
        yield Question(name=f"ground-{number}", expected="", posture=problem)


def _flat(frames: int, friction: float, height_m: float = 0.2) -> dict[str, Any]:
    return {
        "frames": frames,
        "gait": "tripod",
        "start_m": [0.0, 0.0, height_m],
        "goal_m": [0.06, 0.0, height_m],
        "terrain": {"kind": "flat", "friction": friction},
    }


def _walls(frames: int, friction: float) -> dict[str, Any]:
    return {
        "frames": frames,
        "gait": "tripod",
        "start_m": [0.0, 0.0, 0.2],
        "goal_m": [0.0, 0.0, 0.55],
        "stride_m": 0.05,
        "stance": {"outward_m": 0.08, "down_m": 0.0},
        "candidates": {"count": 1, "window_m": 0.26, "margin_m": 0.02},
        "terrain": {"kind": "walls", "friction": friction, "apart_m": 0.38},
    }


PLACES = {"start": (-0.1, 0.0), "goal": (0.7, 0.0)}


def _grounds() -> dict[str, Sequence[Sequence[float]]]:
    """Boxes of grounds: level, a step, and a beam of 7 cm between two gaps."""
    return {
        "level": [(-1.5, 2.2, -1.0, 1.0, 0.0)],
        "step": [(-1.5, 0.3, -1.0, 1.0, 0.0), (0.3, 2.2, -1.0, 1.0, 0.05)],
        "beam": [
            (-1.5, 0.3, -1.0, 1.0, 0.0),
            (0.42, 0.49, -1.0, 1.0, 0.0),
            (0.61, 2.2, -1.0, 1.0, 0.0),
        ],
    }


def _mesh(boxes: Sequence[Sequence[float]]) -> str:
    """Boxes 0.3 m deep as the text of an OBJ file."""
    lines = list[str]()
    for number, (x0, x1, y0, y1, top) in enumerate(boxes):
        corners = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (top - 0.3, top)]
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        for side in ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"):
            lines.append("f " + " ".join(str(8 * number + int(k)) for k in side.split()))
    return "\n".join(lines) + "\n"


def _dog(height_m: float) -> dict[str, Any]:
    return {
        "robot": "dog.urdf",
        "frames": 3,
        "gait": "wave",
        "start_m": [0.0, 0.0, height_m],
        "goal_m": [0.1, 0.0, height_m],
        "body": NARROW,
        "terrain": {"kind": "flat", "friction": 0.7},
    }


Door = Callable[[Question, Path], Reply]


def by_name(question: Question, folder: Path) -> Reply:
    """``stancekit.plan`` of a file."""
    return _reply(stancekit.plan(question.file(folder), settings=question.settings))


def by_value(question: Question, folder: Path) -> Reply:
    """``stancekit.plan`` of what ``stancekit.load`` gives."""
    return _reply(stancekit.plan(stancekit.load(question.file(folder)), settings=question.settings))


def by_command(question: Question, folder: Path) -> Reply:
    """``stancekit plan``."""
    proof, plan = (folder / f"{question.name}.{kind}.json" for kind in ("proof", "plan"))
    for path in (proof, plan):
        path.unlink(missing_ok=True)
    options = [] if question.torque_nm is None else ["--torque-nm", question.torque_nm]
    if question.boxes:
        options += ["--no-leaps", *(f"--{at}={x},{y}" for at, (x, y) in PLACES.items())]
        options += ["--robot", question.robot(folder) or "hexapod"]
    file = question.file(folder)
    record = _command("plan", file, "--json", "--proof", proof, "--out", plan, *options)
    if record["status"] == "feasible":
        arrays = _arrays(stancekit.load(plan, Motion))
        return Reply(status="feasible", objective=record["objective"], plan=arrays)
    proved = digest_of(read_evidence(proof)[0].problem) if proof.exists() else ""
    return Reply(status=record["status"], proved=proved)


def by_playground(question: Question, folder: Path) -> Reply:
    """The playground, once nothing is changed."""
    places = {at: f"{x},{y}" for at, (x, y) in PLACES.items()} if question.boxes else {}
    door = Play(course=str(question.file(folder)), between=Between(**places))
    answer = patient_answer(door._scenario(question.robot(folder) if places else None))
    plan = answer.plan if answer.accepted else None
    proved = answer.status is Status.INFEASIBLE and answer.course is not None
    return Reply(
        status="undecided" if answer.status is None else answer.status.value,
        proved=digest_of(answer.course) if proved and answer.course is not None else "",
        objective=math.nan if plan is None else objective_of(plan),
        plan="" if plan is None else _arrays(plan),
    )


def by_replan(question: Question, folder: Path) -> Reply:
    """``replan``, the function of the closed loop and of Traverse-v0, asked for the whole course
    with its limits.
    """
    course = stancekit.load(question.file(folder), Problem)
    limits = WholeBodyLimits(torque_nm=question.torque_nm)
    return _reply(replan(None, course, shares=SHARES, presses=PRESSES, limits=limits))


def by_solve(question: Question, folder: Path) -> Reply:
    """``stancekit.solve``, whose posture the other doors do not print."""
    assert question.posture is not None
    return replace(_reply(stancekit.solve(question.posture)), plan="")


def by_solve_command(question: Question, folder: Path) -> Reply:
    """``stancekit solve``: its answer is of the problem that it was given, a line each."""
    assert question.posture is not None
    record = _command("solve", question.file(folder), "--json")
    return Reply(status=record["status"], proved=_proved(record["status"], question.posture))


def by_label(question: Question, folder: Path) -> Reply:
    """The search that labels problems in batches."""
    assert question.posture is not None
    (outcome,) = decide_all(Exact(), PostureBatch.stacked([question.posture])).outcomes
    return Reply(
        status=outcome.status.value, proved=_proved(outcome.status.value, question.posture)
    )


def by_plan_of_posture(question: Question, folder: Path) -> Reply:
    """``stancekit.plan`` of a posture problem."""
    assert question.posture is not None
    return _reply(stancekit.plan(question.posture))


def between_by_path(question: Question, folder: Path) -> Reply:
    """``stancekit.plan`` of a terrain's file and two places."""
    return _between(question.file(folder), question.robot(folder))


def between_by_value(question: Question, folder: Path) -> Reply:
    """``stancekit.plan`` of what ``stancekit.terrain`` and ``stancekit.robot`` give."""
    robot = stancekit.robot(question.robot(folder) or "hexapod")
    return _between(stancekit.terrain(question.file(folder), robot=robot), robot)


def _between(terrain: Any, robot: Any) -> Reply:
    return _reply(stancekit.plan(terrain, robot=robot, settings=WALKS, **PLACES))


DOORS: dict[str, tuple[Door, ...]] = {
    "course": (by_name, by_value, by_command, by_playground, by_replan),
    "between": (between_by_path, between_by_value, by_command, by_playground),
    "posture": (by_solve, by_solve_command, by_label),
    "posture as a course": (by_plan_of_posture, by_command),
}
"""The doors of every kind of question; those of one kind have to say the same."""


def ask(question: Question, folder: Path) -> dict[str, dict[str, Reply]]:
    """What the doors that take a question say, by the kind of the question and the name of the
    door.
    """
    kinds = ("course",) if question.posture is None else ("posture", "posture as a course")
    kinds = ("between",) if question.boxes else kinds
    replies = dict[str, dict[str, Reply]]()
    for kind in kinds:
        doors = [
            door
            for door in DOORS[kind]
            if not (door is by_playground and question.torque_nm is not None)
        ]
        replies[kind] = {door.__name__: door(question, folder) for door in doors}
    return replies


def differences(replies: Mapping[str, Mapping[str, Reply]]) -> list[str]:
    """Where two doors of a kind say different things, and where a proof of one kind meets a plan of
    another.
    """
    found = list[str]()
    for kind, each in replies.items():
        first, *others = each.items()
        found += [f"{kind}: {first} and {other}" for other in others if not first[1].same(other[1])]
    statuses = {reply.status for each in replies.values() for reply in each.values()}
    if {"feasible", "infeasible"} <= statuses:
        found.append(f"contradiction: {replies}")
    return found


def digest_of(problem: Problem) -> str:
    """SHA-256 of a problem as its file has it, and of the name of nothing: a course of another name
    is the same.
    """
    data = problem.to_json() if problem.is_posture else {**problem.to_json(), "name": ""}
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _proved(status: str, problem: Problem) -> str:
    return digest_of(problem) if status == "infeasible" else ""


def _reply(outcome: Answer[Any]) -> Reply:
    """What an outcome of the library says, whose certificate has to prove what it carries."""
    proved = ""
    if outcome.certificate is not None:
        assert outcome.problem is not None
        assert stancekit.verify(outcome.certificate).accepted
        assert stancekit.explain(outcome).relaxations
        proved = digest_of(outcome.problem)
    planned = (
        outcome.solution is not None
        and outcome.solution.keyed
        and outcome.status is Status.FEASIBLE
    )
    objective = outcome.objective if planned else math.nan
    plan = _arrays(outcome.solution) if planned else ""
    return Reply(status=outcome.status.value, proved=proved, objective=objective, plan=plan)


def _arrays(plan: Motion) -> str:
    """SHA-256 of the arrays of a plan."""
    names = ("com_m", "rotation_rad", "toes_m", "choice", "forces_n")
    data = b"".join(np.ascontiguousarray(getattr(plan, name)).tobytes() for name in names)
    return hashlib.sha256(data).hexdigest()


def _command(*arguments: object) -> dict[str, Any]:
    """The one record that a command prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        run(parse([str(argument) for argument in arguments]))
    (line,) = out.getvalue().splitlines()
    record: dict[str, Any] = json.loads(line)
    return record
