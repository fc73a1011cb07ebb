"""Motion files ``stancekit/motion/1``, and proofs ``stancekit/certificate/1`` as their second kind:
one JSON file with the question, the arrays as an archive in it, and the verifier's word.

It carries a SHA-256 of what was written, so that a file that was edited by hand is refused and not
obeyed; whoever reads one judges it anew.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, create_model

from ..answer.certificate import Certificate, Way
from ..answer.motion import LATER, Evidence, Motion, seal
from ..answer.plan import WHOLE_BODY, Plan
from ..answer.report import Report, verdict_digest, whole_body
from ..answer.trajectory import Trajectory, WalkQuestion, robot_from_json
from ..errors import InvalidInput, located, not_installed, require
from ..files.arrays import read_only, unpacked
from ..files.codec import extracted
from ..files.documents import read_json, shown, validated
from ..files.writing import check_writable, first_difference, remove_leftovers, write_text
from ..problem import Problem
from ..problem.leap import FORMAT as LEAP, Leap
from ..problem.passage import Passage
from ..problem.posture import FORMAT as POSTURE
from ..robot.robot_file import named_robot, robot_numbers
from ..verify import check_plan
from ..verify.judge import judge

FORMAT = "stancekit/motion/1"
PROOF = "stancekit/certificate/1"
_CONTENT = {"question": dict, "columns": dict, "provenance": dict}
_KEYS = {"format": str, "verified": bool, "verdict": dict, **_CONTENT, "sha256": str}
"""Keys of a motion's file, and what each of them is."""
_OF_PROOF = {"format": str, "question": dict, "columns": dict, "sha256": str}
_MOST_PARTS = 64
_KIND_OF = {"choice": "i", "modes": "i", "timing": "i", "contact": "b"}
"""Kinds of the arrays that are no real numbers."""
_CALLED = {"i": "whole numbers", "b": "truth values", "f": "numbers"}
_OF_JOINTS = ("joints", "torque")
"""Groups that ask for nothing but the file and pinocchio; bodies ask for meshes, too."""
Shapes = Mapping[str, tuple[int | None, ...]]
_Reader = Callable[[Any, str, dict[str, NDArray[Any]]], dict[str, Any]]
"""What else than arrays a motion is made of, of the question's JSON-ready values, their place in the
file, and the arrays, of which it takes what is not the motion's own."""


_TWO = Field(min_length=2, max_length=2)
_IN_JSON: Mapping[str, Any] = MappingProxyType(
    {
        "Robot": dict[str, Any],
        "HeightField": str,
        "float": float,
        "float | None": float | None,
        "NDArray[np.bool_]": list[bool],
        "Array": Annotated[list[float], _TWO],
        "tuple[bool, bool]": Annotated[list[bool], _TWO],
    }
)
"""The values of a file that stand for a field of ``WalkQuestion``, by the field's annotation."""
_OF_WALK: dict[str, Any] = {
    "format": (Literal["stancekit/walk/1"], ...),
    **{each.name: (_IN_JSON[str(each.type)], ...) for each in fields(WalkQuestion)},
    "doubts": (list[str], []),
}


@cache
def _walk_keys() -> type[BaseModel]:
    """The question of a walk, but for the heights of its terrain."""
    keys = ConfigDict(extra="forbid", strict=True, defer_build=True)
    return cast(type[BaseModel], create_model("_WalkKeys", __config__=keys, **_OF_WALK))


def _walk(data: Any, where: str, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    from ..terrain.heightfield import HeightField  # loads splines

    asked = dict(validated(_walk_keys(), data, where))
    del asked["format"]
    ground = {name: arrays.pop(name) for name in _GROUND if name in arrays}
    with located(place := f"{where.removesuffix('question')}columns"):
        _check_arrays(place, ground, _GROUND, ())
        surface = {name.removeprefix("terrain_"): array for name, array in ground.items()}
        heights = HeightField.from_arrays(surface, asked["terrain"])
    asked["terrain"] = replace(heights, doubts=tuple(asked.pop("doubts")))
    asked["robot"] = robot_from_json(asked["robot"])
    return {"problem": WalkQuestion(**asked)}


_GROUND = {"terrain_x_m": (None,), "terrain_y_m": (None,), "terrain_heights_m": (None, None)}


def _leap(data: Any, where: str) -> Leap:
    from ..problem.leap_classes import leap_from_keys  # of leaps alone

    return leap_from_keys(data, where)


def _crossing(
    data: Mapping[str, Any], where: str, arrays: dict[str, NDArray[Any]]
) -> dict[str, Any]:
    keys = {"format": str, "name": str, "goal_m": list, "refusal": str, "parts": list}
    _check_keys(data, {**keys, "certificate": object}, where)
    require(
        0 < len(data["parts"]) <= _MOST_PARTS,
        f"{where}: parts: expected 1 to {_MOST_PARTS}, got {len(data['parts'])}",
    )
    parts = [_part(part, f"{where}: parts[{k}]") for k, part in enumerate(data["parts"])]
    proof = data["certificate"]
    proved = None if proof is None else certificate_from(proof, f"{where}: certificate")
    told = {name: data[name] for name in ("name", "refusal")}
    told["goal_m"] = read_only(data["goal_m"], (2,), f"{where}: goal_m")
    return {"problem": Way(**told, course=parts[0].problem, certificate=proved), "parts": parts}


def _part(data: Any, where: str) -> Motion[Any]:
    _check_keys(data, _CONTENT, where)
    return motion_from(data, where)


def _course(data: Any, where: str, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    return {"problem": Problem.from_json(data)}


_QUESTIONS: Mapping[str, _Reader] = {
    Problem.FORMAT: _course,
    POSTURE: _course,
    WalkQuestion.FORMAT: _walk,
    LEAP: lambda data, where, arrays: {"problem": _leap(data, where)},
    Way.FORMAT: _crossing,
}
"""By the format of the question."""


def write_motion(path: str | Path, motion: Motion[Any], report: Report[Any]) -> None:
    """Write NAME.json, whole or not at all.

    Arguments:
        report: what the verifier said of this very motion; one that it rejected is written with
            ``verified: false``.

    Raises:
        InvalidInput: for another motion's report, for another name, for a provenance that is no
            JSON, and where nothing can be written.
    """
    check_name(path)
    require(
        report.answer.digest == motion.digest,
        f"{path}: expected the verifier's report on this {motion.word}, got the one on another",
    )
    verdict = {"verified": report.accepted, "verdict": report.to_json()}
    _write(path, {"format": FORMAT, **verdict, **motion.content()})


def write_certificate(path: str | Path, certificate: Certificate) -> None:
    """Write a certificate and what it refutes, whole or not at all.

    Raises InvalidInput where nothing can be written, and for one that does not know its problem.
    """
    _write(path, {"format": PROOF, **certificate.content()})


def _write(path: str | Path, content: Mapping[str, Any]) -> None:
    try:
        text = json.dumps({**content, "sha256": seal(content)}, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: expected finite numbers and text: {error}") from None
    write_text(path, text + "\n")


def check_name(path: str | Path) -> Path:
    """The name of a motion that is to be written, asked for before the work whose result goes there.

    Raises InvalidInput for one that cannot be.
    """
    path = Path(path)
    came = path.suffix or "no suffix"
    require(
        path.suffix == ".json" and path.stem,
        f"{path}: expected a name that ends in .json, got {came}",
    )
    check_writable(path)
    return path


def read_evidence(path: str | Path) -> tuple[Evidence, dict[str, Any]]:
    """The motion or the certificate of a file, and the file's content.

    Raises InvalidInput in one line for another format, for a file that was changed since it was
    written, for arrays that are missing, of a wrong shape or not finite, and for a question that is
    none.
    """
    return evidence_from(read_json(path), str(path))


def read_motion(path: str | Path) -> tuple[Motion[Any], dict[str, Any]]:
    """The motion of a file, and the file's content, with the verdict that it claims.

    Raises InvalidInput as ``read_evidence``, and for a proof.
    """
    motion, content = read_evidence(path)
    if not isinstance(motion, Motion):
        raise InvalidInput(f"{path}: expected a motion, got a {motion.word}")
    return motion, content


def is_evidence(data: Any) -> bool:
    """Tell whether parsed contents say that they are a motion or a certificate."""
    return isinstance(data, Mapping) and data.get("format") in (FORMAT, PROOF)


def evidence_from(data: Any, where: str) -> tuple[Evidence, dict[str, Any]]:
    """The motion or the certificate of a file's content, see ``read_evidence``."""
    if not is_evidence(data):
        came = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise InvalidInput(f"{where}: expected format {FORMAT!r} or {PROOF!r}, got {shown(came)}")
    of_proof = data["format"] == PROOF
    _check_keys(data, _OF_PROOF if of_proof else _KEYS, where)
    require(
        seal({name: data[name] for name in data if name != "sha256"}) == data["sha256"],
        f"{where}: digest mismatch: the file was changed after it was written",
    )
    if of_proof:
        return certificate_from(data, where), data
    motion = motion_from(data, where)
    _check_verdict(data["verdict"], motion, where)
    return motion, data


def motion_from(data: Mapping[str, Any], where: str) -> Motion[Any]:
    """The motion of a file's content, whose keys are there."""
    read = _QUESTIONS.get(str(data["question"].get("format")))
    if read is None:
        came, known = shown(data["question"].get("format")), ", ".join(_QUESTIONS)
        raise InvalidInput(f"{where}: question: expected a format of {known}, got {came}")
    place = f"{where}: columns"
    arrays = _arrays(data["columns"], place)
    with located(f"{where}: question"):
        asked = read(data["question"], f"{where}: question", arrays)
    rows = arrays["times_s"].size if "times_s" in arrays else 0
    _check_arrays(place, arrays, asked["problem"].columns(rows), LATER)
    plain: dict[str, Any] = {name: a if a.ndim else a.item() for name, a in arrays.items()}
    with located(place):
        motion = Motion(**asked, **plain, provenance=data["provenance"])
    labels = motion.labels()
    for name in dict.fromkeys((*labels, *data["columns"])):
        require(
            name == "npz" or data["columns"].get(name) == labels.get(name),
            f"{place}.{name}: expected the name of the question, got another",
        )
    return motion


def _check_verdict(verdict: Mapping[str, Any], motion: Motion[Any], where: str) -> None:
    """Raise InvalidInput for a verdict that is none, or one on something else."""
    checked, body = verdict.get("checked"), whole_body(motion)
    known = {"contacts", *body}
    if not isinstance(checked, list) or (body and not set(map(str, checked)) <= known):
        wanted = f"{', '.join(sorted(known))} or fewer" if body else "names of groups"
        raise InvalidInput(f"{where}: verdict.checked: expected {wanted}, got {shown(checked)}")
    with suppress(KeyError, TypeError, ValueError):
        if verdict_digest(verdict, motion.digest) == verdict["digest"]:
            return
    raise InvalidInput(
        f"{where}: verdict: digest mismatch: question, arrays or verdict are not what the verifier "
        "saw"
    )


def certificate_from(data: Any, where: str) -> Certificate:
    """The certificate of a file's content, or of a crossing."""
    for name in ("question", "columns"):
        there = isinstance(data, Mapping) and isinstance(data.get(name), Mapping)
        require(there, f"{where}: expected a proof with question and columns")
    question = data["question"]
    with located(f"{where}: question"):
        match question.get("format"):
            case Passage.FORMAT:
                problem: Problem | Passage | Leap = Passage.from_json(question)
            case str(name) if name == LEAP:
                problem = _leap(question, where)
            case _:
                problem = Problem.from_json(question)
    place = f"{where}: columns"
    arrays = _arrays(data["columns"], place)
    _check_arrays(place, arrays, {"tree": (None, 5), "multipliers": (None, None)}, ())
    return Certificate.from_arrays(arrays["tree"], arrays["multipliers"]).of(problem)


def _arrays(columns: Mapping[str, Any], where: str) -> dict[str, NDArray[Any]]:
    require(
        isinstance(columns.get("npz"), str),
        f"{where}.npz: expected an archive as text, got {shown(columns)}",
    )
    return unpacked(extracted(columns["npz"], where), where)


def _check_keys(data: Any, keys: Mapping[str, type], where: str) -> None:
    """Raise InvalidInput unless these keys are there, each of its kind, and no others."""
    came = set(data) if isinstance(data, Mapping) else set[str]()
    if came != set(keys):
        names = ", ".join(sorted(map(str, came ^ set(keys))))
        raise InvalidInput(
            f"{where}: expected the keys {', '.join(keys)}; missing or unknown: {names:.120}"
        )
    for name, kind in keys.items():
        if not isinstance(data[name], kind):
            words = {dict: "an object", list: "a list", str: "text", bool: "true or false"}
            raise InvalidInput(f"{where}: {name}: expected {words[kind]}, got {shown(data[name])}")


def _check_arrays(
    where: str, arrays: Mapping[str, NDArray[Any]], shapes: Shapes, optional: tuple[str, ...]
) -> None:
    """Raise InvalidInput unless every array is there, of its shape and kind and finite; heights of
    a terrain are the terrain's to judge.
    """
    spare = [name for name in optional if name in shapes]
    if not set(shapes) - set(spare) <= set(arrays) <= set(shapes):
        may = f" ({' and '.join(spare)} may lack)" if spare else ""
        raise InvalidInput(
            f"{where}: expected the arrays {', '.join(shapes)}{may}, got {sorted(arrays)}"
        )
    for name, array in arrays.items():
        kind, shape = _KIND_OF.get(name, "f"), shapes[name]
        fits = len(shape) == array.ndim and all(
            length in (None, got) for length, got in zip(shape, array.shape, strict=True)
        )
        if not fits or array.dtype.kind != kind:
            wanted = str(shape).replace("None", "any")
            raise InvalidInput(
                f"{where}: {name}: expected {_CALLED[kind]} of shape {wanted}, got {array.dtype} of "
                f"shape {array.shape}"
            )
        require(
            kind != "f" or name.startswith("terrain_") or np.isfinite(array).all(),
            f"{where}: {name}: expected finite numbers, got other values",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class FileCheck:
    """Result of checking a file of a motion or a proof again.

    Arguments:
        path: path of the file.
        kind: kind of its content; that of a proof is "no-plan", "no-posture" or "no-leap".
        report: report of the verifier.
        message: result in one line.
        same: True if the file claims the verdict that this check finds.
        founded: True if all that the file lists as checked can be checked.
    Source:
        docs/formats.md.

    Example:
        >>> import stancekit
        >>> stancekit.save(stancekit.plan("stairs", frames=2).solution, "climb.json")
        >>> check = stancekit.verify("climb.json")
        >>> check.kind, check.accepted
        ('plan', True)
    """

    path: str
    kind: str
    report: Report[Any]
    message: str
    same: bool = True
    founded: bool = True

    @property
    def accepted(self) -> bool:
        """The answer is accepted, and the file says nothing else of it than can be checked."""
        return self.report.accepted and self.same and self.founded

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        verdict = "accepted" if self.accepted else "refused"
        told = {"message": self.message, "report": self.report.to_json()}
        return {"where": self.path, "kind": self.kind, "verdict": verdict, **told}


def check_file(
    path: str | Path,
    *,
    data: Any = None,
    tolerance: float | None = None,
    joints: bool = True,
    robot: str | None = None,
    course: Callable[[int], Problem] | None = None,
    why: bool = False,
    exact: bool = False,
    margins: bool = False,
) -> FileCheck:
    """Verify a motion or a proof in a file anew, whatever it says of itself.

    Arguments:
        data: what the file holds, where it was read before.
        tolerance: largest violation that a plan may have; the rest have limits of their own.
        joints: of a plan, judge the whole body, too.
        robot: name or file of the one that a plan or a walk has to be of; without it the file is
            believed what its robot is.
        course: of so many key frames, the one that a plan has to be of.
        why: ask for a reason, which only proofs have.
        exact: replay a proof in exact arithmetic, too (``verify.exact``).
        margins: of a plan, measure what its stances bear.

    Raises:
        InvalidInput: for a file that cannot be read, one of another robot or course, and options
            that have no use for what it holds.
    """
    evidence, content = evidence_from(read_json(path) if data is None else data, str(path))
    of_plan = isinstance(evidence, Motion) and evidence.keyed
    for name, given, used in (
        ("robot", robot is not None, of_plan or evidence.has("times_s")),
        ("course", course is not None, of_plan),
        ("tolerance", tolerance is not None, of_plan),
        ("margins", margins, of_plan),
        ("explain", why, isinstance(evidence, Certificate)),
        ("exact", exact, isinstance(evidence, Certificate)),
    ):
        require(
            not given or used,
            f"{name}: expected none with {path}, a {evidence.word}, which has its own",
        )
    if isinstance(evidence, Certificate):
        check = _check_proof(str(path), evidence, why)
        return _replayed(check, evidence) if exact else check
    assert isinstance(evidence, Motion)
    if of_plan:
        _check_course(str(path), evidence, robot, course)
    elif robot is not None:
        _check_walker(str(path), evidence, robot)
    report = judge(evidence, tolerance=tolerance, joints=joints, margins=margins)
    claimed = content["verdict"].get("checked", ())
    listed = {
        name: report.group(name).verdict for name in WHOLE_BODY if of_plan and name in claimed
    }
    sound = report.contacts and "violated" not in listed.values()
    accepted = sound if of_plan else report.accepted
    same = accepted == content["verified"] == content["verdict"].get("accepted")
    of_joints = _OF_JOINTS if find_spec("pinocchio") else ()
    unfounded = ", ".join(name for name in of_joints if listed.get(name) == "not checked")
    remarks = [
        report.message,
        report.body_message if of_plan else "",
        "" if same else "the file claims another verdict",
        unfounded and f"the file lists as checked what cannot be checked: {unfounded}",
    ]
    return FileCheck(
        path=str(path),
        kind=evidence.word,
        report=report,
        message="; ".join(filter(None, remarks)),
        same=same,
        founded=not unfounded,
    )


def _check_proof(path: str, certificate: Certificate, why: bool) -> FileCheck:
    """The verdict on a proof in a file, and its reason."""
    from ..verify import explain  # of proofs alone

    report, problem = judge(certificate), certificate.refuted
    if isinstance(problem, Leap):
        reason = f"; {explain(certificate).message}" if why and report.accepted else ""
        return FileCheck(path=path, kind="no-leap", report=report, message=report.message + reason)
    kind, name = "no-plan", problem.name
    if isinstance(problem, Problem) and problem.is_posture:
        kind, name = "no-posture", f"posture on {', '.join(problem.legs)}"
    reason = explain(certificate).message if report.accepted else report.message
    return FileCheck(path=path, kind=kind, report=report, message=f"{name}: {reason}")


def _replayed(check: FileCheck, certificate: Certificate) -> FileCheck:
    """The verdict on a proof with that of exact arithmetic, which has to agree."""
    if find_spec("flint") is None:
        raise not_installed("exact", "python-flint", "fractions and balls", "exact")
    from ..verify.exact import check_exact

    question, *arrays = certificate.question, certificate.tree, certificate.multipliers
    held, _, message = check_exact(question, *(array.tolist() for array in arrays))
    return replace(check, founded=held, message=f"{check.message}; {message}")


def _check_walker(path: str, motion: Trajectory, robot: str) -> None:
    """Raise InvalidInput for a walk of another robot."""
    from ..robot.walker import named_walker  # loads splines

    walker = named_walker(robot)
    ours, theirs = (robot_numbers(each.to_json()) for each in (motion.robot, walker))
    if other := first_difference(ours, theirs):
        raise InvalidInput(
            f"{path}: expected a walk of the robot {walker.name} as its file is, got one of "
            f"{motion.robot.name} with numbers of its own: {other}"
        )


def _check_course(
    path: str, motion: Plan, robot: str | None, course: Callable[[int], Problem] | None
) -> None:
    """Raise InvalidInput for a plan of another robot or course."""
    problem, legs = motion.problem, motion.problem.robot
    require(
        course is None or not problem.is_posture,
        f"{path}: expected a plan of that course, got a posture",
    )
    model = None if robot is None else named_robot(robot)
    if model is not None and (
        legs.digest != model.digest or legs.own_model().disabled_pairs != model.disabled_pairs
    ):
        got = "legs or numbers of its own" if legs.own else "no legs in its file"
        raise InvalidInput(
            f"{path}: expected a plan for the robot {model.name} as its file is, got one for "
            f"{problem.robot.name} with {got}"
        )
    if course is not None:
        from ..problem.course_file import course_difference  # slow to import

        if other := course_difference(problem, course(problem.frames)):
            raise InvalidInput(
                f"{path}: expected a plan of that course, got one of another: {other}"
            )


class PartialPlan:
    """The beginning of a course's plan, in a file that is written as its pieces are planned.

    Arguments:
        path: of the file, None keeps nothing. A run goes on from what stands there already as far
            as it begins the same course, and if the verifier accepts all of it anew, joints and
            bodies too; else it counts for nothing, and is written over.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = None if path is None else check_name(path)

    def begun(self, course: Problem) -> Plan | None:
        """The plan of the course's beginning that an earlier run left; None where there is none."""
        if self._path is None or not self._path.exists():
            return None
        from ..search.pieces import beginning  # of plans that are written as they are made

        with suppress(InvalidInput):
            plan, _ = read_motion(self._path)
            last = 0 if plan.joints_rad is None else _shared(course, plan.problem)
            if last > 0:
                plan = plan if last == plan.problem.frames - 1 else beginning(plan, last)
                return plan if check_plan(plan, joints=True).accepted else None
        return None

    def keep(self, plan: Plan) -> None:
        """Write the beginning that there is."""
        if self._path is not None:
            write_motion(self._path, plan, check_plan(plan))

    def remove(self) -> None:
        """The course is planned: nothing is left."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
            remove_leftovers(self._path.parent, self._path.name.__eq__)


def _shared(course: Problem, other: Problem) -> int:
    """The last key frame up to which two courses are one; 0 where they begin otherwise."""
    from ..search.pieces import course_window

    def same(last: int) -> bool:
        one, two = (json.dumps(course_window(each, 0, last).to_json()) for each in (course, other))
        return one == two

    first, last = 0, min(course.frames, other.frames) - 1
    while first < last:
        middle = (first + last + 1) // 2
        first, last = (middle, last) if same(middle) else (first, middle - 1)
    return first
