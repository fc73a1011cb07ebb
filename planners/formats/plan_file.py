"""Plan files ``stancekit/plan/3``: one JSON file with course, verdict and digest, and the numbers
as an archive in it.

It carries a SHA-256 of what was written, so that a file that was edited by hand is refused and not
obeyed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..answer.report import OPTIONAL, WHOLE_BODY, plan_arrays, plan_digest, plan_shapes
from ..errors import InvalidInput
from ..files.arrays import unpacked
from ..files.codec import embedded, extracted
from ..files.documents import read_json, shown
from ..files.writing import check_writable, write_text
from ..problem import Problem
from ..problem.course_comparison import course_difference
from ..robot.urdf import joint_names
from ..verify import Report, check_plan
from .file_check import FileCheck

if TYPE_CHECKING:
    from ..robot.robot_model import RobotModel

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
PARTS: dict[str, dict[str, type]] = {
    "verdict": {"accepted": bool, "tolerance": float, "digest": str},
    "provenance": {},
    "arrays": {"npz": str},
}
"""Least content of the objects in the header."""
OF_JOINTS = ("joints", "torque")
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
        [name for name in OF_JOINTS if listed.get(name) == "not checked"]
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
    for key, wanted in PARTS.items():
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
