"""The relaxations of m = p f by name: the lift, and P1 over boxes in the variants that there
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Protocol

from ..equilibrium.layout import Layout
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array
from ..plugins import Registry
from .envelope import Envelope
from .relaxed import RelaxationAnswer


class RelaxedProgram(Protocol):
    """A convex program that relaxes m = p f, made for one layout as ``TYPE(layout)``.

    Class attributes:
        over_boxes: whether it bounds [p, f] by learned boxes; the lift does not.
        about_points: whether each box comes with a point [p, f], as in ``joint``.
    """

    over_boxes: ClassVar[bool]
    about_points: ClassVar[bool]

    def __init__(self, layout: Layout) -> None: ...

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The signed margin over a box: the least t by which the rows of its envelope have to give
        way.

        The relaxation has an answer where t ≤ 0. The margin is inf where not even the rest of the
        problem has an answer, and NaN where the solver failed.

        Arguments:
            programs: compiled models to share.
            gradient: also ∂t/∂low and ∂t/∂high.
        """
        ...

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The answer over the best box of each problem; all problems have one layout.

        Arguments:
            boxes: one or more per problem; those that need none ignore them.
            points: [p, f] of shape (B, 6) per problem where ``about_points``; else empty.
        """
        ...


RELAXATIONS: Registry[type[RelaxedProgram]] = Registry(
    "relaxation",
    "stancekit.relaxations",
    {
        "p1": "stancekit.planners.relaxation.mccormick:McCormick",
        "joint": "stancekit.planners.relaxation.lift:JointRelaxation",
        "coned": "stancekit.planners.relaxation.coned:Coned",
        "lift": "stancekit.planners.relaxation.lift:LiftProgram",
    },
    expected="a class with margin and answers, as McCormick has them",
    accepts=lambda it: all(callable(getattr(it, name, None)) for name in ("margin", "answers")),
)
"""The relaxations of postures; a class that derives from ``McCormick`` serves courses, too."""
