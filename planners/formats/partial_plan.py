"""Interrupted plan of a long course: the plan of its beginning, in NAME.partial.json."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.writing import remove_leftovers
from ..problem import Problem
from ..search.plan_window import course_window
from ..verify import check_plan
from .plan_file import check_name, read_plan, write_plan


class PartialPlan:
    """The beginning of a course's plan, in a file that is written after every piece.

    path: of the file, None keeps nothing. What stands there already is gone on from where it begins the same course,
    and contacts in it hold; else it counts for nothing, and is written over.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = None if path is None else check_name(path)

    def begun(self, course: Problem) -> Plan | None:
        """The plan of the course's beginning that an earlier run left; None where there is none."""
        if self._path is None or not self._path.exists():
            return None
        with suppress(InvalidInput):
            plan, _ = read_plan(self._path)
            last = plan.problem.frames - 1
            if last < course.frames and plan.joints_rad is not None:
                own = course_window(course, 0, last)
                same = json.dumps(own.to_json()) == json.dumps(plan.problem.to_json())
                return plan if same and check_plan(plan).accepted else None
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
