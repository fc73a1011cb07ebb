"""Interrupted plan of a long course: the plan of its beginning, in NAME.partial.json."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.writing import remove_leftovers
from ..problem import Problem
from ..search.plan_window import beginning, course_window
from ..verify import check_plan
from .plan_file import check_name, read_plan, write_plan


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
