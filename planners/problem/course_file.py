"""Courses as YAML files: read, checked all at once, laid out as a ``Problem``. Some come with the
package.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pydantic import ValidationError

from ..errors import InvalidInput
from ..files.documents import no_numbers, parse_yaml, read_json, read_yaml, validation_errors
from ..files.writing import first_difference
from ..plugins import split_name
from ..robot.model import Robot
from ..robot.robot_file import robot_numbers
from ..terrain.families import TERRAIN_FAMILIES, drawn_name
from .course_keys import AS_ASKED, MADE_UP, PLAIN, Alternative, CourseSpec
from .course_layout import build_course
from .course_terrain import family_keys
from .posture import FORMAT as POSTURE
from .problem import Problem

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets


def course_difference(course: Problem, expected: Problem) -> str:
    """Difference between what a course and another one ask for, in one line; empty where it does
    not.

    Names, weights and modes may be others, and so may the candidates of footholds, which have to be
    pieces of the terrain in any case.
    """
    ours, theirs = (
        {
            name: value
            for name, value in each.to_json().items()
            if name not in ("name", "weights", "modes")
        }
        for each in (course, expected)
    )
    for each in (ours, theirs):
        each["placements"] = [
            {k: v for k, v in placement.items() if k != "candidates"}
            for placement in each["placements"]
        ]
        each["robot"] = robot_numbers(each["robot"])
    return first_difference(ours, theirs)


def read_course(
    course: str | Path,
    frames: int | None = None,
    robot: Robot | str | None = None,
    sets: Sets = "inner",
    reach: str | Path | None = None,
    alternative: Alternative = AS_ASKED,
) -> Problem:
    """The course of a built-in name, of a YAML file, or of a JSON file that holds it, or one
    posture, explicitly.

    Arguments:
        frames: number of key frames M, in place of that of the file; not for JSON files, whose
            footholds are fixed.
        robot: robot in place of the file's: a built-in name, a .urdf file or a .yaml file that
            names one, or a ``Robot``; for a posture's JSON file the robot whose limbs stand. Not
            for other JSON files.
        sets: sets of the legs of a robot from a file: "inner" sets, which the feet surely reach,
            for plans; "outer" ones, which hold all that they might reach, for proofs.
        reach: a folder of reach polytopes for the limbs, in place of their own
            (``robot.reach_file``); not for JSON files.
        alternative: another way to lay out a YAML file.

    Raises:
        InvalidInput: with every key that is wrong, or with the frame and the limb that have no
            place to stand.
    """
    if Path(course).suffix in (".json", ".jsonl"):
        if frames is not None:
            raise InvalidInput(
                f"{course}: expected no other number of frames for a course whose footholds are "
                "fixed"
            )
        if reach is not None:
            raise InvalidInput(
                f"{course}: expected no other reach for a course whose footholds are fixed"
            )
        data = read_json(course)
        posture = isinstance(data, Mapping) and data.get("format") == POSTURE
        if robot is not None and not posture:
            raise InvalidInput(
                f"{course}: expected no other robot for a course whose footholds are fixed"
            )
        try:
            if posture:
                return Problem.from_json(data).course(
                    Path(course).stem, None if robot is None else _robot(robot)
                )
            return Problem.from_json(data)
        except InvalidInput as error:
            raise InvalidInput(
                str(error) if str(error).startswith(str(course)) else f"{course}: {error}"
            ) from None
    data = described(course)
    spec = _spec(course, data, robot)
    try:
        spec = spec if frames is None else spec.with_frames(frames)
        return build_course(spec, Path(course).parent, sets, reach, alternative)
    except InvalidInput as error:
        raise type(error)(f"{course}: {error}") from None


def _robot(robot: Robot | str) -> Robot:
    """A robot by its name.

    Raises InvalidInput.
    """
    from ..robot.robot_file import robot_of  # loads pinocchio for a file

    return robot_of(robot)


def read_spec(course: str | Path, robot: Robot | str | None = None) -> CourseSpec:
    """The description of a built-in course or in a YAML file, with another robot where one is
    named.

    Raises InvalidInput with every key that is wrong.
    """
    return _spec(course, described(course), robot)


def described(course: str | Path) -> Mapping[str, Any]:
    """The keys of a built-in name, of FAMILY:LEVEL:SEED or of a YAML file.

    Raises InvalidInput.
    """
    name = str(course)
    if drawn_name(name) and not Path(name).exists():
        return family_keys(name)
    family, numbers = split_name(name)
    if (
        numbers
        and all(each.replace(".", "", 1).isdecimal() for each in numbers)
        and not Path(name).exists()
    ):
        raise TERRAIN_FAMILIES.unknown(family)
    if name in builtin_courses():
        file = resources.files("stancekit.configs.courses").joinpath(f"{name}.yaml")
        return cast("Mapping[str, Any]", parse_yaml(file.read_text(encoding="utf-8"), name))
    if not Path(name).suffix and not Path(name).exists():
        known = ", ".join(builtin_courses())
        message = f"course: expected one of {known}, FAMILY:LEVEL:SEED or a YAML file, got {name!r}"
        raise InvalidInput(
            message
            + ("; over a terrain a plan wants a start and a goal" if _is_terrain(name) else "")
        )
    return cast("Mapping[str, Any]", read_yaml(course))


def _is_terrain(name: str) -> bool:
    from ..terrain.reference import names_ground  # splines are slow to import

    return names_ground(name)


def _spec(course: str | Path, data: Mapping[str, Any], robot: Robot | str | None) -> CourseSpec:
    """The description in keys, with another robot where one is named."""
    if isinstance(robot, str):
        data = {**data, "robot": str(Path(robot).resolve()) if Path(robot).suffix else robot}
    try:
        spec = spec_from(data)
        return spec.of_robot(robot) if isinstance(robot, Robot) else spec
    except InvalidInput as error:
        raise InvalidInput(f"{course}: {error}") from None


def spec_from(data: Mapping[str, Any]) -> CourseSpec:
    """The description in a mapping of keys, as YAML has it.

    Raises InvalidInput with every key that is wrong.
    """
    if not isinstance(data, Mapping):
        raise InvalidInput(f"expected keys and values, got {type(data).__name__}")
    try:
        spec = CourseSpec.model_validate(data)
    except ValidationError as error:
        raise InvalidInput(
            "; ".join(_plain(text, data) for text in validation_errors(error, CourseSpec))
        ) from None
    if wrong := "; ".join(_plain(text, data) for text in no_numbers(CourseSpec, data)):
        raise InvalidInput(wrong)
    return spec


def _plain(text: str, data: Mapping[str, Any]) -> str:
    """A refusal whose key is that of the file, without the tags by which pydantic tells kinds of
    values apart.
    """
    terrain = data.get("terrain")
    kind = terrain.get("kind") if isinstance(terrain, Mapping) else None
    for tag in (PLAIN, MADE_UP):
        text = text.replace(f".{tag}", "")
    return (
        text.replace(f"terrain.{kind}", "terrain", 1)
        if text.startswith(f"terrain.{kind}.")
        else text
    )


def builtin_courses() -> tuple[str, ...]:
    """Names of the courses that come with the package."""
    files = resources.files("stancekit.configs.courses").iterdir()
    return tuple(
        sorted(path.name.removesuffix(".yaml") for path in files if path.name.endswith(".yaml"))
    )
