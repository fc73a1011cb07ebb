"""Leap files ``stancekit/leap/1``: a question, and with it a plan or a certificate where there is
one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..answer.certificate import Certificate
from ..answer.plan import LATER, NUMBERS, LeapPlan
from ..answer.report import Report
from ..errors import InvalidInput
from ..files.arrays import plain_numbers
from ..files.documents import YAML, read_json, read_yaml, shown
from ..files.writing import write_text
from ..problem.leap import Leap, is_drawn, is_leap
from ..problem.leap_classes import leap_class, leap_from_keys, leap_to_json
from ..verify import check_certificate, explain
from ..verify.leaps import check_leap
from .motion_file import FileCheck

PLAN = ("timing", "choice", *NUMBERS, "provenance")


@dataclass(frozen=True, kw_only=True, eq=False)
class _LeapFile:
    """The contents of a leap's file: the question, and a plan or a certificate, or neither."""

    leap: Leap
    plan: LeapPlan | None = None
    certificate: Certificate | None = None


def read_leap(path: str | Path, robot: str | Path | None = None) -> _LeapFile:
    """Read a leap's file, JSON or YAML, or draw one by its name, CLASS:SEED as leap-hard:7.

    Raises InvalidInput, in one line, for anything else, and for another robot beside a file.

    Arguments:
        robot: a name or file whose legs are known, in place of the class's robot.
    """
    if robot is not None and not is_drawn(path):
        raise InvalidInput(f"robot: expected CLASS:SEED with another robot, got the file {path}")
    if is_drawn(path):
        name, _, seed = str(path).partition(":")
        if not (seed or "0").isdecimal():
            raise InvalidInput(f"{path}: expected CLASS:SEED as {name}:7, with a seed of 0 or more")
        if robot is not None:
            number = int(seed or "0")
            kind = leap_class(name).on(str(robot))
            return _LeapFile(leap=kind.draw(np.random.default_rng(number), f"{name}-{number}"))
        return _LeapFile(
            leap=leap_from_keys({"distribution": name, "seed": int(seed or "0")}, str(path))
        )
    data = read_yaml(path) if Path(path).suffix in YAML else read_json(path)
    if not is_leap(data):
        raise InvalidInput(
            f"{path}: expected a leap, with phases or a distribution, got {shown(data)}"
        )
    return leap_from(data, path)


def leap_from(data: Mapping[str, Any], path: str | Path) -> _LeapFile:
    """A leap of a file's content, with what answers it there.

    Raises InvalidInput, in one line.
    """
    raw_plan, raw_proof = data.get("plan"), data.get("certificate")
    leap = leap_from_keys(
        {k: v for k, v in data.items() if k not in ("plan", "certificate")}, str(path)
    )
    try:
        plan = None if raw_plan is None else _plan_from_json(leap, raw_plan)
        proof = None if raw_proof is None else Certificate.from_json(raw_proof).of(leap)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    return _LeapFile(leap=leap, plan=plan, certificate=proof)


def write_leap(
    path: str | Path,
    leap: Leap,
    plan: LeapPlan | None = None,
    certificate: Certificate | None = None,
) -> None:
    """Write a leap, with what answers it, whole or not at all.

    Raises InvalidInput for a name that does not end in .json, and where nothing can be written.
    """
    if Path(path).suffix != ".json":
        raise InvalidInput(
            f"{path}: expected a leap's name to end in .json, got "
            f"{Path(path).suffix or 'no suffix'}"
        )
    content = leap_content(leap, plan)
    if certificate is not None:
        content["certificate"] = certificate.to_json()
    write_text(path, json.dumps(content, allow_nan=False) + "\n")


def leap_content(leap: Leap, plan: LeapPlan | None = None) -> dict[str, Any]:
    """Content of a leap's file: the leap and its plan."""
    content = leap_to_json(leap)
    return content if plan is None else {**content, "plan": plan_to_json(plan)}


def check_file(path: str | Path, *, why: bool = False) -> FileCheck:
    """Check the plan or the certificate in a file of a leap.

    Arguments:
        path: of the file.
        why: say of a proof what would have to give.

    Raises:
        InvalidInput: for a file that holds neither.
    """
    leap_file = read_leap(path)
    if leap_file.plan is not None:
        report: Report[Any] = check_leap(leap_file.plan, body=True)
        return FileCheck(path=str(path), kind="leap", report=report, message=report.message)
    if leap_file.certificate is None:
        raise InvalidInput(
            f"{path}: expected a leap with a plan or a certificate, got the question alone"
        )
    report = check_certificate(leap_file.certificate)
    reason = f"; {explain(leap_file.certificate).message}" if why and report.accepted else ""
    return FileCheck(path=str(path), kind="no-leap", report=report, message=report.message + reason)


def plan_to_json(plan: LeapPlan) -> dict[str, Any]:
    """A plan as JSON-ready values, without its question."""
    numbers = {name: getattr(plan, name).tolist() for name in NUMBERS}
    return {
        "timing": plan.timing,
        "choice": plan.choice.tolist(),
        **numbers,
        **{name: value.tolist() for name, value in plan.later.items()},
        "provenance": dict(plan.provenance),
    }


def _plan_from_json(leap: Leap, data: Any) -> LeapPlan:
    """Read what ``plan_to_json`` wrote.

    Raises InvalidInput.
    """
    if not isinstance(data, Mapping) or set(data) - set(LATER) != set(PLAN):
        raise InvalidInput(
            f"plan: expected an object with the keys {', '.join(PLAN)}, got {shown(data)}"
        )
    timing, provenance = data["timing"], data["provenance"]
    if isinstance(timing, bool) or not isinstance(timing, int):
        raise InvalidInput(f"plan.timing: expected a whole number, got {shown(timing)}")
    if not isinstance(provenance, Mapping):
        raise InvalidInput(f"plan.provenance: expected an object, got {shown(provenance)}")
    numbers: dict[str, Any] = {}
    for name in ("choice", *NUMBERS, *(name for name in LATER if name in data)):
        try:
            numbers[name] = plain_numbers(data[name])
        except (TypeError, ValueError, OverflowError):
            raise InvalidInput(f"plan.{name}: expected numbers, got {shown(data[name])}") from None
    if not np.array_equal(numbers["choice"], np.trunc(numbers["choice"])):
        raise InvalidInput(f"plan.choice: expected whole numbers, got {shown(data['choice'])}")
    return LeapPlan(problem=leap, timing=timing, provenance=dict(provenance), **numbers)
