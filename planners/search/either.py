"""One planner per method: it answers postures and courses, by two parts that are made when they are
first asked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from ..answer.answer import Answer
from ..answer.plan import Plan
from ..problem import Problem
from .answer import Planner

Kind = Literal["postures", "courses"]
"""The two kinds of question that planners are asked."""


class EitherPlanner:
    """The planner of a method that nobody has said what it will be asked.

    Arguments:
        name: of the method.
        make: by kind of question, a function that makes the planner of it, or raises InvalidInput.
    """

    def __init__(self, name: str, make: Mapping[Kind, Callable[[], Planner]]) -> None:
        self.name, self._make, self._made = name, make, dict[Kind, Planner]()

    def solve(self, problem: Problem) -> Answer[Plan]:
        """Answer one problem.

        Raises InvalidInput where the method, or a setting of it, is not for its kind.
        """
        return self.part(kind_of(problem)).solve(problem)

    def part(self, kind: Kind) -> Planner:
        """The planner of this kind of question.

        Raises InvalidInput likewise.
        """
        if kind not in self._made:
            self._made[kind] = self._make[kind]()
        return self._made[kind]


def kind_of(problem: Problem) -> Kind:
    """Kind of question that a problem is."""
    return "postures" if problem.is_posture else "courses"


def part_of(planner: Planner, kind: Kind) -> Planner:
    """Part of a planner that answers this kind of question, or the whole planner."""
    return planner.part(kind) if isinstance(planner, EitherPlanner) else planner
