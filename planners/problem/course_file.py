"""Courses as YAML files: read, checked all at once, laid out as a ``Course``. Some come with the package."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from ..errors import InvalidInput
from ..files.documents import parse_yaml, read_json, read_yaml
from ..files.validation import validation_errors
from .course import Course
from .course_json import course_from_json
from .course_keys import MADE_UP, PLAIN, CourseSpec
from .course_layout import build_course
from .posture import FORMAT as POSTURE
from .posture import PostureProblem

if TYPE_CHECKING:
    from ..robot.contact_robot import Sets


def read_course(
    course: str | Path, frames: int | None = None, robot: str | None = None, sets: Sets = "inner"
) -> Course:
    """The course of a built-in name, of a YAML file, or of a JSON file that holds it, or one posture, explicitly.

    frames: M, where another one is wanted than the file says; not for JSON files, whose footholds are fixed. robot: in
    place of the file's, a built-in name, a .urdf file or a .yaml file that names one; not for JSON files either.
    sets: of the legs of a robot's file, what they surely reach, for plans, or what they might, for proofs.
    Raises InvalidInput with every key that is wrong, or with the frame and the limb that have no place to stand.
    """
    if Path(course).suffix == ".json":
        if frames is not None:
            raise InvalidInput(f"{course}: expected no other number of frames for a course whose footholds are fixed")
        if robot is not None:
            raise InvalidInput(f"{course}: expected no other robot for a course whose footholds are fixed")
        data = read_json(course)
        try:
            if isinstance(data, Mapping) and data.get("format") == POSTURE:
                return Course.of_posture(PostureProblem.from_json(data), Path(course).stem)
            return course_from_json(data)
        except InvalidInput as error:
            raise InvalidInput(str(error) if str(error).startswith(str(course)) else f"{course}: {error}") from None
    spec = read_spec(course, robot)
    try:
        return build_course(spec if frames is None else spec.with_frames(frames), Path(course).parent, sets)
    except InvalidInput as error:
        raise InvalidInput(f"{course}: {error}") from None


def read_spec(course: str | Path, robot: str | None = None) -> CourseSpec:
    """The description of a built-in course or in a YAML file, with another robot where one is named.

    Raises InvalidInput with every key that is wrong.
    """
    name = str(course)
    if name in builtin_courses():
        text = resources.files("stancekit.configs.courses").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
        data = parse_yaml(text, name)
    elif not Path(name).suffix and not Path(name).exists():
        raise InvalidInput(f"course: expected one of {', '.join(builtin_courses())} or a YAML file, got {name!r}")
    else:
        data = read_yaml(course)
    if robot is not None:
        data = {**data, "robot": str(Path(robot).resolve()) if Path(robot).suffix else robot}
    try:
        return spec_from(data)
    except InvalidInput as error:
        raise InvalidInput(f"{name}: {error}") from None


def spec_from(data: Mapping[str, Any]) -> CourseSpec:
    """The description in a mapping of keys, as YAML has it. Raises InvalidInput with every key that is wrong."""
    if not isinstance(data, Mapping):
        raise InvalidInput(f"expected keys and values, got {type(data).__name__}")
    try:
        return CourseSpec.model_validate(data)
    except ValidationError as error:
        raise InvalidInput("; ".join(_plain(text, data) for text in validation_errors(error))) from None


def _plain(text: str, data: Mapping[str, Any]) -> str:
    """A refusal whose key is that of the file, without the tags by which pydantic tells kinds of values apart."""
    terrain = data.get("terrain")
    kind = terrain.get("kind") if isinstance(terrain, Mapping) else None
    for tag in (PLAIN, MADE_UP):
        text = text.replace(f".{tag}", "")
    return text.replace(f"terrain.{kind}", "terrain", 1) if text.startswith(f"terrain.{kind}.") else text


def builtin_courses() -> tuple[str, ...]:
    """Names of the courses that come with the package."""
    files = resources.files("stancekit.configs.courses").iterdir()
    return tuple(sorted(path.name.removesuffix(".yaml") for path in files if path.name.endswith(".yaml")))
