"""Answers of relaxations: shares of vertices, forces, a point rounded from them; the margin of P1
and its proofs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..plugins import Registry
from .envelope import Envelope

FEASIBLE_MARGIN = 1e-7
"""A margin up to this counts as feasible: the solver's own tolerance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Relaxed:
    """A point of a relaxation, in which a toe may stand on several candidates at once.

    Arguments:
        com, rotation: (M, 3).
        weights: λ ≥ 0, shape (V,), which add up to 1 at every foothold.
        forces: in contact frames, one at each of ``rows`` = (stance contact, candidate), shape (n,
            3).
        seconds: in the solver [s].
    """

    scaled: Scaled
    com: Array
    rotation: Array
    weights: Array
    forces: Array
    rows: tuple[Index, Index]
    seconds: float = 0.0

    @classmethod
    def of(cls, scaled: Scaled, solution: ConicSolution, rows: tuple[Index, Index]) -> Relaxed:
        """Values of the variables in a program's solution.

        Arguments:
            rows: of its forces.
        """
        return cls(
            scaled=scaled,
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            weights=unit_shares(scaled, solution.value("weights")),
            forces=solution.value("forces"),
            rows=rows,
            seconds=solution.seconds,
        )

    @cached_property
    def shares(self) -> Array:
        """z of every candidate, shape (K,)."""
        return np.asarray(np.add.reduceat(self.weights, self.scaled.layout.candidate_starts))

    @cached_property
    def toes(self) -> Array:
        """Position of each candidate's share of the toe, shape (K, 3)."""
        starts = self.scaled.layout.candidate_starts
        sums = np.add.reduceat(self.weights[:, None] * self.scaled.vertices, starts)
        return sums / np.maximum(self.shares, 1e-12)[:, None]

    def rounded(self) -> tuple[Index, Point]:
        """The candidate of the largest share of every foothold, by number, (P,), and a point whose
        toes are on them.
        """
        number = self.scaled.numbers
        if len(number) == self.scaled.layout.footholds:  # nothing to round
            one = len(self.forces) == len(self.scaled.force_min)
            return number, self._point(
                self.toes, self.forces if one else self._added(np.arange(len(number)))
            )
        ends = np.cumsum([len(counts) for counts in self.scaled.layout.corners])
        parts = np.split(self.shares, ends[:-1])
        chosen = np.array(
            [end - len(part) + int(part.argmax()) for end, part in zip(ends, parts, strict=True)]
        )
        return number[chosen], self._point(self.toes[chosen], self._added(chosen))

    def _added(self, chosen: Index) -> Array:
        """All forces of a contact as one, in the frame of the chosen candidate, shape (B, 3)."""
        scaled, layout, (contact, candidate) = self.scaled, self.scaled.layout, self.rows
        world = np.matmul(scaled.frames[candidate], self.forces[..., None])[..., 0]
        total = np.zeros((len(layout.contacts[0]), 3))
        np.add.at(total, contact, world)
        frames = scaled.frames[chosen][layout.contacts[2]]
        return np.asarray(np.matmul(frames.transpose(0, 2, 1), total[..., None])[..., 0])

    def _point(self, toes: Array, forces: Array) -> Point:
        return Point(
            com=self.com,
            rotation=self.rotation,
            toes=toes,
            forces=forces,
            residual=float("inf"),
            seconds=self.seconds,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RelaxationAnswer:
    """One solve of P1.

    Arguments:
        margin: t; of the hard form 0 where it has an answer; inf where there is none, NaN where the
            solver gave up.
        relaxed: the answer, off the bilinear surface by ``excess`` = m − p f, shape (B, 3, 3),
            indices contact, j, k.
        at: [p, f], f in the axes of the box, (B, 6).
        chosen: which envelope of a set.
        objective: of the hard form.
        modes: z of every stance and box, (S, E).
        gradient: (∂t/∂low, ∂t/∂high), (B, 6) each, where asked for.
    """

    margin: float
    relaxed: Relaxed | None = None
    at: Array | None = None
    excess: Array | None = None
    chosen: int = 0
    objective: float = float("nan")
    modes: Array | None = None
    solves: int = 1
    seconds: float = 0.0
    gradient: tuple[Array, Array] | None = None

    @property
    def feasible(self) -> bool:
        """Tell whether P1 admits the problem.

        False also where nothing is known: see ``known``.
        """
        return self.margin <= FEASIBLE_MARGIN

    @property
    def known(self) -> bool:
        """Tell whether the solver came to an end."""
        return not np.isnan(self.margin)

    @cached_property
    def point(self) -> Point | None:
        """A point to project from, rounded to a choice of candidates where there is one; None
        without an answer.
        """
        return None if self.relaxed is None else self.relaxed.rounded()[1]

    @property
    def gap(self) -> float:
        """Largest |m − p f|; NaN without an answer."""
        return float("nan") if self.excess is None else float(np.abs(self.excess).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class DualBound:
    """Knowledge about every other box over the same posture problem from one solve of P1.

    Arguments:
        margin: as in ``RelaxationAnswer``; the rest is None where there is none.
        point: [p, f], shape (N, 6), and excess = m − p f, shape (N, 3, 3), indices contact, j, k: a
            primal solution.
        rows: u ≥ 0, multipliers of the four envelope rows low-low, high-high, low-high, high-low,
            shape (4, N, 3, 3).
        slope, constant: what the Lagrangian  slope · [p, f] + constant  of all other constraints
            but [p, f] ∈ B and t is, shape (N, 6), minimised over what else there is, a lower bound
            that holds for every answer of the problem.
    """

    margin: float
    point: Array | None = None
    excess: Array | None = None
    rows: Array | None = None
    slope: Array | None = None
    constant: float = 0.0


def unit_shares(scaled: Scaled, weights: Array) -> Array:
    """λ as a solver gives them, made ≥ 0 with sum 1 at every foothold."""
    weights = np.maximum(weights, 0.0)
    foothold = scaled.layout.vertex_footholds
    totals = np.bincount(foothold, weights, minlength=scaled.layout.footholds)
    return np.asarray(weights / np.maximum(totals, 1e-300)[foothold])


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
