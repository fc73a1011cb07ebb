"""Is a course the one that was asked for?"""

from __future__ import annotations

from ..files.writing import first_difference
from ..robot.model_json import robot_numbers
from .problem import Problem


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
