"""Published scenes as YAML files: read, checked all at once, laid out as a ``Problem``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InvalidInput
from ..files.validation import validated
from ..robot.model import Robot
from .problem import Problem
from .scene_keys import SceneSpec
from .scene_layout import build_scene
from .scene_robot import other_robot, published_robot

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets


def read_scene(
    scene: str | Path,
    data: Mapping[str, Any],
    frames: int | None = None,
    robot: Robot | str | None = None,
    sets: Sets = "inner",
    reach: str | Path | None = None,
) -> Problem:
    """The course of a scene, from the keys of its file; arguments as of
    ``course_file.read_course``.

    Raises InvalidInput with every key that is wrong, or with what in its data contradicts itself.
    """
    if frames is not None:
        raise InvalidInput(
            f"{scene}: expected no number of frames for a scene, whose phases say it, got {frames}"
        )
    if robot is not None and reach is not None:
        raise InvalidInput(f"{scene}: expected a robot or a folder of reach polytopes, got both")
    spec = validated(SceneSpec, data, str(scene))
    try:
        if robot is not None:
            return build_scene(*other_robot(spec, robot, Path(), sets))
        return build_scene(spec, published_robot(spec, Path(scene).parent, reach))
    except InvalidInput as error:
        raise InvalidInput(f"{scene}: {error}") from None
