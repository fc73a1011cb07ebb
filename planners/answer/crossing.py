"""A crossing: climbs and leaps one after the other, each begun from where the one before ends."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InvalidInput
from ..problem import Problem
from ..robot.model import Robot
from ..terrain.patch import Patch
from .certificate import Certificate
from .leap_plan import LeapPlan
from .plan import Plan


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """A way over a course of which key frames alone cross only stretches: climbs, and leaps over
    what is between them.

    Nothing is checked here: ``verify`` does it.

    Arguments:
        name: of the course.
        parts: plans of key frames and of leaps in order, the first of key frames.
        refusal: what key frames alone came to, in words.
        certificate: proof that no balanced motion leads from start to goal, with that passage as its
            problem; None where nothing is proved.
    Source:
        None: Lin et al. for the climbs, Newton and Euler for the leaps.

    Example:
        >>> import stancekit
        >>> way = stancekit.load("crossing.json")  # doctest: +SKIP
        >>> [type(part).__name__ for part in way.parts]  # doctest: +SKIP
        ['Plan', 'LeapPlan', 'Plan']
    """

    name: str
    parts: tuple[Plan | LeapPlan, ...]
    refusal: str = ""
    certificate: Certificate | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or not isinstance(self.parts[0], Plan):
            raise InvalidInput(
                f"crossing {self.name}: expected parts of which the first is a plan of key frames"
            )
        for k, part in enumerate(self.parts):
            if not isinstance(part, Plan | LeapPlan) or (
                isinstance(part, Plan) and part.problem.is_posture
            ):
                raise InvalidInput(
                    f"crossing {self.name}: parts[{k}]: expected a plan of key frames or of a leap, got something else"
                )

    def __repr__(self) -> str:
        words = ", ".join("climb" if isinstance(part, Plan) else "leap" for part in self.parts)
        return f"Crossing({self.name}: {words})"

    @property
    def first(self) -> Problem:
        """The course of the first climb, which has all of the terrain."""
        problem = self.parts[0].problem
        assert isinstance(problem, Problem)
        return problem

    @property
    def robot(self) -> Robot:
        """The robot of the first climb."""
        return self.first.robot

    @property
    def terrain(self) -> tuple[Patch, ...]:
        """Every surface that there is."""
        return self.first.terrain
