"""Plan files ``stancekit/plan/3``: one JSON file with course, verdict and digest, and the numbers
as an archive in it.

It carries a SHA-256 of what was written, so that a file that was edited by hand is refused and not
obeyed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..answer.report import OPTIONAL, WHOLE_BODY, plan_arrays, plan_digest, plan_shapes
from ..errors import InvalidInput
from ..files.arrays import plain_numbers, unpacked
from ..files.codec import embedded, extracted
from ..files.documents import parse_json, read_json, shown
from ..files.writing import check_writable, remove_leftovers, write_text
from ..problem import Problem
from ..problem.course_file import course_difference
from ..relaxation.boxes import Modes
from ..relaxation.envelope import EnvelopeSet
from ..robot import Robot
from ..robot.robot_file import joint_names
from ..search.pieces import beginning, course_window
from ..verify import Report, check_plan
from .motion_file import FileCheck

if TYPE_CHECKING:
    from ..robot.robot_model import RobotModel


Read = TypeVar("Read")
_MOST_RECORDS = 500_000
"""Most records of a file of JSON lines."""


def json_records(text: str, where: str) -> Iterator[tuple[str, Any | InvalidInput]]:
    """Yield (where, value) for every record in a text that is one JSON object, an array of them, or
    JSON lines.

    A record that cannot be parsed is yielded as its InvalidInput, and the rest still come. A text
    that is no JSON as a whole is taken for JSON lines where a line that is not indented is an
    object, unless it begins as an array does. Raises InvalidInput for more than ``_MOST_RECORDS``
    lines.
    """
    if text.count("\n") > _MOST_RECORDS:
        raise InvalidInput(
            f"{where}: expected {_MOST_RECORDS} lines or fewer, got {text.count(chr(10))}"
        )
    try:
        whole = parse_json(text, where)
    except InvalidInput as error:
        lines = [
            (f"{where} line {n}", line)
            for n, line in enumerate(text.split("\n"), 1)
            if line.strip()
        ]
        objects = (
            line for _, line in lines if line[0] == "{" and isinstance(_parsed(line, where), dict)
        )
        if len(lines) < 2 or text.lstrip()[0] == "[" or not any(objects):
            yield where, error
            return
        for place, line in lines:
            yield place, _parsed(line, place)
        return
    if not isinstance(whole, list):
        yield where, whole
        return
    if not whole:
        yield where, InvalidInput(f"{where}: expected one or more problems, got an empty array")
    for index, item in enumerate(whole):
        yield f"{where}[{index}]", item


def read_problems(
    text: str, where: str, *, robot: Robot | None = None
) -> Iterator[tuple[str, Problem | InvalidInput]]:
    """Yield (where, problem or its InvalidInput) for every posture problem in a text, in order."""
    for place, item in json_records(text, where):
        if isinstance(item, InvalidInput):
            yield place, item
            continue
        try:
            yield place, Problem.from_json(item, robot=robot)
        except InvalidInput as error:
            yield place, InvalidInput(f"{place}: {error}")


def read_envelopes(path: str | Path) -> EnvelopeSet:
    """Read an envelope file.

    Raises InvalidInput.
    """
    return _located(path, lambda: EnvelopeSet.from_json(read_json(path)))


def read_modes(path: str | Path) -> Modes:
    """Read a file of modes.

    Raises InvalidInput.
    """
    return _located(path, lambda: Modes.from_json(read_json(path)))


def read_boxes(path: str | Path) -> EnvelopeSet | Modes:
    """Read an envelope file, or one of modes.

    Raises InvalidInput.
    """
    data = read_json(path)
    return (
        read_modes(path)
        if isinstance(data, dict) and data.get("format") == Modes.FORMAT
        else read_envelopes(path)
    )


def answer_from_json(data: Any, problem: Problem) -> Plan | Certificate | None:
    """Read what a line of answers claims of a posture problem: a plan, a certificate, or nothing to
    check.

    Raises InvalidInput.
    """
    if not isinstance(data, dict):
        raise InvalidInput(f"expected a JSON object, got {type(data).__name__}")
    if data.get("certificate") is not None:
        return Certificate.from_json(data["certificate"]).of(problem)
    names: tuple[str, ...] = ("com_m", "rotation_rad", "toes_m", "forces_n")
    if not any(name in data for name in names):
        return None
    missing = [name for name in names if name not in data]
    if missing:
        raise InvalidInput(f"{missing[0]}: expected this key, got nothing")
    names += tuple(name for name in ("points_m", "point_forces_n") if name in data)
    try:
        arrays = {name: plain_numbers(data[name]) for name in names}
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(
            f"{', '.join(names)}: expected lists of numbers, got something else"
        ) from None
    return Plan.of_posture(problem, **arrays)


def write_boxes(path: str | Path, envelopes: EnvelopeSet | Modes) -> None:
    """Write an envelope file, or one of modes."""
    write_text(path, json.dumps(envelopes.to_json(), indent=1) + "\n")


def _parsed(text: str, where: str) -> Any | InvalidInput:
    try:
        return parse_json(text, where)
    except InvalidInput as error:
        return error


def _located(path: str | Path, read: Callable[[], Read]) -> Read:
    try:
        return read()
    except InvalidInput as error:
        text = str(error)
        raise InvalidInput(text if text.startswith(str(path)) else f"{path}: {text}") from None


__all__ = [
    "FORMAT",
    "check_file",
    "check_name",
    "is_plan_file",
    "read_plan",
    "write_plan",
]

FORMAT = "stancekit/plan/3"
KEYS = ("format", "verified", "verdict", "provenance", "course", "arrays", "sha256")
_PARTS: dict[str, dict[str, type]] = {
    "verdict": {"accepted": bool, "tolerance": float, "digest": str},
    "provenance": {},
    "arrays": {"npz": str},
}
"""Least content of the objects in the header."""
_OF_JOINTS = ("joints", "torque")
"""Groups that ask for nothing but the file and pinocchio; bodies ask for meshes, too."""


def write_plan(path: str | Path, plan: Plan, report: Report[Plan]) -> None:
    """Write NAME.json, whole or not at all.

    Arguments:
        report: what the verifier said of this very plan; a plan that it rejected is written with
            ``verified: false``.

    Raises:
        InvalidInput: for another plan's report, and where nothing can be written.
    """
    check_name(path)
    if report.answer is not plan:
        raise InvalidInput(
            f"{path}: expected the verifier's report on this plan, got the one on another"
        )
    write_text(path, json.dumps(plan_content(plan, report, path), indent=1, allow_nan=False) + "\n")


def plan_content(plan: Plan, report: Report[Plan], where: str | Path) -> dict[str, Any]:
    """Content of a plan's file, with its seal.

    Raises InvalidInput for a provenance that is no JSON.
    """
    content = {
        "format": FORMAT,
        "verified": report.accepted,
        "verdict": report.to_json(),
        "provenance": dict(plan.provenance),
        "course": plan.problem.to_json(),
        "arrays": {
            "npz": embedded(
                {name: array for name, array in plan_arrays(plan).items() if array is not None}
            ),
            **_labels(plan.problem),
            **(
                {} if plan.joints_rad is None else {"joints": list(joint_names(plan.problem.robot))}
            ),
        },
    }
    try:
        return {**content, "sha256": _seal(content)}
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"{where}: provenance: expected finite numbers and text: {error}"
        ) from None


def check_name(path: str | Path) -> Path:
    """The name of a plan that is to be written.

    Raises InvalidInput for one that cannot be.
    """
    check_writable(_named(path))
    return Path(path)


def read_plan(path: str | Path) -> tuple[Plan, dict[str, Any]]:
    """Read a plan and the header of its file, with the verdict that the file claims.

    Raises InvalidInput in one line for another format, a file or numbers that were changed since,
    numbers that are missing, of a wrong shape or not finite, and a course that is none.
    """
    return plan_from(read_json(_named(path)), Path(path))


def _named(path: str | Path) -> Path:
    """The file of a plan.

    Raises InvalidInput for a name that ends otherwise than in .json.
    """
    path = Path(path)
    if path.suffix != ".json":
        raise InvalidInput(
            f"{path}: expected a plan's name to end in .json, got {path.suffix or 'no suffix'}"
        )
    return path


def plan_from(data: Any, header_path: Path) -> tuple[Plan, dict[str, Any]]:
    """The plan of a file's content, see ``read_plan``.

    Arguments:
        data: what the file holds.
        header_path: the file, for messages.
    """
    header, arrays = _header(data, header_path), f"{header_path}: arrays"
    numbers = unpacked(extracted(header["arrays"]["npz"], arrays), arrays)
    try:
        course = Problem.from_json(header["course"])
    except InvalidInput as error:
        raise InvalidInput(f"{header_path}: course: {error}") from None
    _check_numbers(arrays, numbers, course)
    if "joints_rad" in numbers and header["arrays"].get("joints") != list(
        joint_names(course.robot)
    ):
        raise InvalidInput(
            f"{header_path}: arrays.joints: expected the names of the robot's joints in its order, got others"
        )
    for name, labels in _labels(course).items():
        if header["arrays"].get(name) != labels:
            raise InvalidInput(
                f"{header_path}: arrays.{name}: expected those of the course, got others"
            )
    plan = Plan(problem=course, provenance=header["provenance"], **numbers)
    verdict = header["verdict"]
    checked = verdict.get("checked", ["contacts"])
    if not isinstance(checked, list) or set(map(str, checked)) - {"contacts", *WHOLE_BODY}:
        raise InvalidInput(
            f"{header_path}: verdict.checked: expected contacts, {', '.join(WHOLE_BODY)} or fewer, got others"
        )
    if plan_digest(plan, verdict["tolerance"], verdict["accepted"], checked) != verdict["digest"]:
        raise InvalidInput(
            f"{header_path}: digest mismatch: course, numbers or verdict are not what the verifier "
            "saw"
        )
    return plan, header


def check_file(
    path: str | Path,
    *,
    tolerance: float = 1e-6,
    joints: bool = True,
    robot: RobotModel | None = None,
    course: Callable[[int], Problem] | None = None,
) -> FileCheck:
    """Verify a plan file anew, whatever it says of itself.

    Arguments:
        robot: whose legs the file's robot has to have; without it the file is believed what its
            robot is.
        course: of so many key frames, the one that the plan has to be of; without it the file is
            believed what was asked.

    Raises:
        InvalidInput: for a file that cannot be read, and for one of another robot or course.
    """
    plan, header = read_plan(path)
    legs = plan.problem.robot.source
    if robot is not None and (
        legs.digest != robot.digest or legs.own_model().disabled_pairs != robot.disabled_pairs
    ):
        got = "legs or numbers of its own" if legs.own else "no legs in its file"
        raise InvalidInput(
            f"{path}: expected a plan for the robot {robot.name} as its file is, got one for "
            f"{plan.problem.robot.name} "
            f"with {got}"
        )
    if course is not None and (
        other := course_difference(plan.problem, course(plan.problem.frames))
    ):
        raise InvalidInput(f"{path}: expected a plan of that course, got one of another: {other}")
    verdict = header["verdict"]
    report = check_plan(plan, tolerance=tolerance, joints=joints, margins=joints)
    listed = {
        name: report.group(name).verdict
        for name in WHOLE_BODY
        if name in verdict.get("checked", ())
    }
    accepted = report.contacts and "violated" not in listed.values()
    same = accepted == verdict["accepted"] == header["verified"]
    unfounded = (
        [name for name in _OF_JOINTS if listed.get(name) == "not checked"]
        if find_spec("pinocchio")
        else []
    )
    parts = [
        report.message,
        report.body_message,
        "" if same else "the file claims another verdict",
        f"the file lists as checked what nobody can check: {', '.join(unfounded)}"
        if unfounded
        else "",
    ]
    message = "; ".join(filter(None, parts))
    return FileCheck(
        path=str(path),
        kind="plan",
        report=report,
        message=message,
        same=same,
        founded=not unfounded,
    )


def is_plan_file(path: str | Path) -> bool:
    """Does the file say that it is a plan?

    False for what cannot be read, is no JSON or has another name.
    """
    try:
        data = read_json(_named(path))
    except InvalidInput:
        return False
    return isinstance(data, dict) and str(data.get("format", "")).startswith("stancekit/plan/")


def _labels(course: Problem) -> dict[str, list[Any]]:
    """Labels of the rows and columns of a plan's arrays, for whoever reads the file with NumPy
    alone.

    limbs: columns of forces. toes: limb and key frame of every foothold. stances: key frame and
    limbs of every row of forces.
    """
    names = course.robot.limb_names
    return {
        "limbs": list(names),
        "toes": [{"limb": foothold.limb, "frame": foothold.frame} for foothold in course.footholds],
        "stances": [
            {"frame": stance.frame, "limbs": [names[i] for i in stance.limbs]}
            for stance in course.stances
        ],
    }


def _seal(content: Mapping[str, Any]) -> str:
    """SHA-256 of everything else in the header, as canonical JSON."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _header(data: Any, path: Path) -> dict[str, Any]:
    """Read the keys of a plan's file, with their values as they are in the file.

    Raises InvalidInput for a file of another format, and for missing or unknown keys.
    """
    version = data.get("format") if isinstance(data, dict) else type(data).__name__
    if version != FORMAT:
        hint = (
            ", a walk: stancekit run and verify take those"
            if str(version).startswith("stancekit/gait/")
            else ""
        )
        raise InvalidInput(f"{path}: expected format {FORMAT!r}, got {shown(version)}{hint}")
    if set(data) != set(KEYS):
        names = ", ".join(sorted(set(data) ^ set(KEYS)))
        raise InvalidInput(
            f"{path}: expected the keys {', '.join(KEYS)}; missing or unknown: {names:.120}"
        )
    if _seal({name: data[name] for name in KEYS[:-1]}) != data["sha256"]:
        raise InvalidInput(f"{path}: digest mismatch: the file was changed after it was written")
    for key, wanted in _PARTS.items():
        part = data[key]
        if not isinstance(part, dict) or not all(
            isinstance(part.get(n), kind) for n, kind in wanted.items()
        ):
            raise InvalidInput(
                f"{path}: {key}: expected an object with {', '.join(wanted) or 'any keys'}, got something else"
            )
    return dict(data)


def _check_numbers(path: str, numbers: Mapping[str, NDArray[Any]], course: Problem) -> None:
    """Raise InvalidInput unless every array is there, of the course's shape, of numbers and
    finite.
    """
    shapes = plan_shapes(course)
    if set(numbers) - {*OPTIONAL} != set(shapes) - {*OPTIONAL} or set(numbers) - set(shapes):
        raise InvalidInput(
            f"{path}: expected the arrays {', '.join(shapes)} ({' and '.join(OPTIONAL)} may lack), "
            f"got {sorted(numbers)}"
        )
    for name, array in numbers.items():
        kind = "i" if name in ("choice", "modes") else "f"
        if array.shape != shapes[name] or array.dtype.kind != kind:
            message = "whole numbers" if kind == "i" else "numbers"
            raise InvalidInput(
                f"{path}: {name}: expected {message} of shape {shapes[name]}, got {array.dtype} of "
                f"shape {array.shape}"
            )
        if not np.isfinite(array).all():
            raise InvalidInput(f"{path}: {name}: expected finite numbers, got others")


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
        with suppress(InvalidInput):
            plan, _ = read_plan(self._path)
            last = 0 if plan.joints_rad is None else _shared(course, plan.problem)
            if last > 0:
                plan = plan if last == plan.problem.frames - 1 else beginning(plan, last)
                return plan if check_plan(plan, joints=True).accepted else None
        return None

    def keep(self, plan: Plan) -> None:
        """Write the beginning that there is."""
        if self._path is not None:
            write_plan(self._path, plan, check_plan(plan))

    def remove(self) -> None:
        """The course is planned: nothing is left."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
            remove_leftovers(self._path.parent, self._path.name.__eq__)


def _shared(course: Problem, other: Problem) -> int:
    """The last key frame up to which two courses are one; 0 where they begin otherwise."""

    def same(last: int) -> bool:
        one, two = (json.dumps(course_window(each, 0, last).to_json()) for each in (course, other))
        return one == two

    first, last = 0, min(course.frames, other.frames) - 1
    while first < last:
        middle = (first + last + 1) // 2
        first, last = (middle, last) if same(middle) else (first, middle - 1)
    return first
