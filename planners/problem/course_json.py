"""The JSON form ``stancekit/course/1`` of a course: explicit and complete, the same to the last bit when read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import InvalidInput
from ..files.codec import fields_to_json, from_json, to_json
from .problem import Problem, Weights

FORMAT = Problem.FORMAT
ANY_WILL_DO = Weights(goal=0.0, com_step=0.0, toe_step=0.0, tilt=0.0)
"""The weights of a problem without an objective: any plan is as good as another."""


def course_to_json(course: Problem) -> dict[str, Any]:
    """The course as JSON-ready values: robot, every patch of the terrain, every foothold with its candidates."""
    leave = ("force_scale_n",) if course.force_n == course.weight_n else ()
    found = fields_to_json(course, leave)
    return found if course.weights is not None else found | {"weights": to_json(ANY_WILL_DO)}


def course_from_json(data: Mapping[str, Any]) -> Problem:
    """Read what ``course_to_json`` wrote. Raises InvalidInput whose message lists every key that is wrong."""
    course = from_json(Problem, data)
    if course.weights is None:
        raise InvalidInput("weights: expected those of an objective, got none")
    return course
