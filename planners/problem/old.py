"""``PostureProblem`` and ``Course``, the names of before for problems of one frame and of several: for one release."""

from __future__ import annotations

import warnings
from typing import Any

from .problem import Problem


class _Named(type):
    """A name that makes problems, and that some problems are instances of."""

    def __instancecheck__(cls, instance: object) -> bool:
        return isinstance(instance, Problem) and instance.is_posture == cls.postures  # type: ignore[attr-defined]

    def __call__(cls, *args: Any, **kwargs: Any) -> Problem:
        return (Problem.posture if cls.postures else Problem)(*args, **kwargs)  # type: ignore[attr-defined]


class PostureProblem(metaclass=_Named):
    """As ``Problem.posture``."""

    postures = True
    from_json = staticmethod(Problem.from_json)


class Course(metaclass=_Named):
    """As ``Problem``."""

    postures = False

    @staticmethod
    def of_posture(problem: Problem, name: str = "posture") -> Problem:
        """As ``Problem.course``."""
        return problem.course(name)


NEW = {"PostureProblem": "Problem.posture(contacts, ...)", "Course": "Problem"}


def renamed(name: str, where: str) -> Any:
    """One of these names, after a ``DeprecationWarning``. where: the module that was asked for it."""
    warnings.warn(f"{where}.{name} is old: {NEW[name]}", DeprecationWarning, stacklevel=3)
    return {"PostureProblem": PostureProblem, "Course": Course}[name]
