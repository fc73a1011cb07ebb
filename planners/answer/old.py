"""``Posture``, the name of before for a plan of one frame: for one release."""

from __future__ import annotations

import warnings
from typing import Any

from ..problem.old import OldName
from .plan import Plan


class Posture(metaclass=OldName):
    """The old name of ``Plan.of_posture``, without the problem, which ``verify`` and ``draw`` are
    given beside it.
    """

    @staticmethod
    def known(instance: object) -> bool:
        """Tell whether the instance is the plan of a posture problem."""
        return isinstance(instance, Plan) and (
            "problem" not in vars(instance) or instance.problem.is_posture
        )

    @staticmethod
    def made(**arrays: Any) -> Plan:
        """A plan that does not know its problem."""
        nobody: Any = None
        plan = Plan.of_posture(nobody, **arrays)
        object.__delattr__(plan, "problem")
        return plan


def renamed(where: str) -> Any:
    """``Posture``, after a ``DeprecationWarning``.

    Arguments:
        where: the module that was asked for it.
    """
    warnings.warn(
        f"{where}.Posture is old: Plan.of_posture(problem, ...)", DeprecationWarning, stacklevel=3
    )
    return Posture
