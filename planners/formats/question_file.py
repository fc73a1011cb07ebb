"""Files of questions and of envelopes: posture problems, one or many, with answers beside them,
leaps, envelopes and modes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..errors import InvalidInput, located, require
from ..files.arrays import plain_numbers
from ..files.documents import YAML, parse_json, read_json, read_yaml, shown
from ..files.writing import write_text
from ..problem import Problem
from ..problem.leap import Leap, is_drawn, is_leap
from ..relaxation.boxes import Modes
from ..relaxation.envelope import EnvelopeSet
from ..robot import Robot

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
    require(
        text.count("\n") <= _MOST_RECORDS,
        f"{where}: expected {_MOST_RECORDS} lines or fewer, got {text.count(chr(10))}",
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


def read_leap(path: str | Path, robot: str | Path | None = None) -> Leap:
    """Read a leap's file, JSON or YAML, or draw one by its name, CLASS:SEED as leap-hard:7.

    Raises InvalidInput, in one line, for anything else, and for a robot in addition to a file.

    Arguments:
        robot: a name or file whose legs are known, in place of the class's robot.
    """
    from ..problem.leap_classes import leap_class, leap_from_keys  # draws robots and terrain

    if not is_drawn(path):
        require(
            robot is None, f"robot: expected CLASS:SEED with another robot, got the file {path}"
        )
        data = read_yaml(path) if Path(path).suffix in YAML else read_json(path)
        require(
            is_leap(data),
            f"{path}: expected a leap, with phases or a distribution, got {shown(data)}",
        )
        return leap_from_keys(data, str(path))
    name, _, seed = str(path).partition(":")
    require(
        (seed or "0").isdecimal(),
        f"{path}: expected CLASS:SEED as {name}:7, with a seed of 0 or more",
    )
    number = int(seed or "0")
    if robot is None:
        return leap_from_keys({"distribution": name, "seed": number}, str(path))
    return leap_class(name).on(str(robot)).draw(np.random.default_rng(number), f"{name}-{number}")


def read_envelopes(path: str | Path) -> EnvelopeSet:
    """Read an envelope file.

    Raises InvalidInput.
    """
    with located(str(path)):
        return EnvelopeSet.from_json(read_json(path))


def read_modes(path: str | Path) -> Modes:
    """Read a file of modes.

    Raises InvalidInput.
    """
    with located(str(path)):
        return Modes.from_json(read_json(path))


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
    require(isinstance(data, dict), f"expected a JSON object, got {type(data).__name__}")
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
