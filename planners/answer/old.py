"""``Posture``, the name of before for a plan of one frame: for one release."""

from __future__ import annotations

import warnings
from typing import Any

from .plan import Plan


class _Named(type):
    """A name that makes plans of one frame, and that those of posture problems are instances of."""

    def __instancecheck__(cls, instance: object) -> bool:
        return isinstance(instance, Plan) and ("problem" not in vars(instance) or instance.problem.is_posture)

    def __call__(cls, **arrays: Any) -> Plan:
        nobody: Any = None
        plan = Plan.of_posture(nobody, **arrays)
        object.__delattr__(plan, "problem")
        return plan


class Posture(metaclass=_Named):
    """As ``Plan.of_posture``, without the problem, which ``verify`` and ``draw`` are given beside it."""


def renamed(where: str) -> Any:
    """``Posture``, after a ``DeprecationWarning``. where: the module that was asked for it."""
    warnings.warn(f"{where}.Posture is old: Plan.of_posture(problem, ...)", DeprecationWarning, stacklevel=3)
    return Posture
