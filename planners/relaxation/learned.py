"""Class and robot of learned things, which are used on such problems and on no others."""

from __future__ import annotations

from typing import Protocol

from ..errors import InvalidInput
from ..problem import Problem


class LearnedFor(Protocol):
    """Class of problems that something was learned for: legs of one robot, in one pair of units."""

    @property
    def robot(self) -> str:
        """Identity of the robot, see ``Robot``; empty for the default hexapod."""

    @property
    def legs(self) -> tuple[str, ...]:
        """Legs of the contacts, in order."""

    @property
    def force_scale_n(self) -> float:
        """Unit of forces [N]."""

    @property
    def length_scale_m(self) -> float:
        """Unit of lengths [m]."""


def check_robot(it: LearnedFor, robot: str, learned: str) -> None:
    """Raise InvalidInput unless it was learned for the robot of this identity.

    Arguments:
        learned: what it is, in words.
    """
    if robot != it.robot:
        mine, other = (name or "the default hexapod" for name in (it.robot, robot))
        raise InvalidInput(f"robot: expected {mine} for {learned}, got {other}")


def check_learned(it: LearnedFor, problem: Problem, learned: str) -> None:
    """Raise InvalidInput unless the problem is of the robot, legs and units that it was learned
    for.
    """
    check_robot(it, problem.robot.identity, learned)
    if problem.legs != it.legs:
        raise InvalidInput(
            f"contacts: expected legs {list(it.legs)} for {learned}, got {list(problem.legs)}"
        )
    for name in ("force_scale_n", "length_scale_m"):
        mine, theirs = getattr(it, name), float(getattr(problem, name))
        if abs(mine - theirs) > 1e-6 * mine:
            raise InvalidInput(f"{name}: expected {mine:g} for {learned}, got {theirs:g}")
