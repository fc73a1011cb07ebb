"""Further groups of the verifier: what else a plan has to keep, by a function each.

A group is one function of a ``Plan`` that returns the largest violation and where it is, as a
``Group``, and one registration: ``FURTHER.register("name", function)`` in a running program, or an
entry point of the group ``stancekit.verifier_groups``. It can only refuse: what it finds counts
beside the package's own groups, in the same limit. The file of a plan that was refused says so like
that of any other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from ..answer.plan import Plan
from ..answer.report import Group
from ..errors import InvalidInput
from ..files.documents import shown
from ..plugins import Registry, foreign, takes

FURTHER: Registry[Callable[[Plan], Group]] = Registry(
    "verifier group",
    "stancekit.verifier_groups",
    {},
    expected="a function of a Plan",
    accepts=lambda it: takes(it, 1),
)
"""The further groups by name; the package itself has none."""


@cache
def _of_packages() -> tuple[str, ...]:
    """The names of entry points; which packages are installed does not change while a process
    runs.
    """
    registered = FURTHER.registered()
    return tuple(name for name in FURTHER.names() if name not in registered)


def further_groups(plan: Plan) -> tuple[Group, ...]:
    """The further groups of a plan.

    Raises InvalidInput for a function that returns something else.
    """
    groups = []
    for name in dict.fromkeys((*_of_packages(), *FURTHER.registered())):
        with foreign(f"verifier group {name}"):
            group = FURTHER.get(name)(plan)
        if not isinstance(group, Group):
            raise InvalidInput(f"verifier group {name}: expected a Group, got {shown(group)}")
        groups.append(group)
    return tuple(groups)
