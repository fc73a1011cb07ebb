"""``PostureProblem`` and ``Course``, the names of before for problems of one frame and of several:
for one release.
"""

from __future__ import annotations

import warnings
from typing import Any

from .problem import Problem


class OldName(type):
    """A name of before that makes values (``made``), and that some values are instances of
    (``known``).
    """

    def __instancecheck__(cls, instance: object) -> bool:
        return bool(cls.known(instance))  # type: ignore[attr-defined]

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        """Make a value."""
        return cls.made(*args, **kwargs)  # type: ignore[attr-defined]


class PostureProblem(metaclass=OldName):
    """The old name of ``Problem.posture``."""

    made = Problem.posture
    from_json = staticmethod(Problem.from_json)

    @staticmethod
    def known(instance: object) -> bool:
        """Tell whether it is a posture problem."""
        return isinstance(instance, Problem) and instance.is_posture


class Course(metaclass=OldName):
    """The old name of ``Problem``."""

    made = Problem

    @staticmethod
    def known(instance: object) -> bool:
        """Tell whether it is a course."""
        return isinstance(instance, Problem) and not instance.is_posture

    @staticmethod
    def of_posture(problem: Problem, name: str = "posture") -> Problem:
        """The old name of ``Problem.course``."""
        return problem.course(name)


NEW = {"PostureProblem": "Problem.posture(contacts, ...)", "Course": "Problem"}


def renamed(name: str, where: str) -> Any:
    """One of these names, after a ``DeprecationWarning``.

    Arguments:
        where: the module that was asked for it.
    """
    warnings.warn(f"{where}.{name} is old: {NEW[name]}", DeprecationWarning, stacklevel=3)
    return {"PostureProblem": PostureProblem, "Course": Course}[name]
