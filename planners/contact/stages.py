"""The compiled models of both stages, shared by planners, environments and evaluation."""

from __future__ import annotations

from typing import Literal, get_args

from .lift import LiftAnswer, LiftModel
from .nlp import NlpModel
from .project import Point, Projector
from .relax import McCormick, PostureWithoutMoment
from .scaled import ScaledProblem

Projection = Literal["fix-p", "fix-f", "fix-toes", "scp", "nlp"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)


class Stages:
    """The compiled models of both stages, by problem size; shared by planners, environments and evaluation."""

    def __init__(self) -> None:
        self._lifts: dict[tuple[int, int, bool], LiftModel] = {}
        self._boxes: dict[tuple[int, int], McCormick] = {}
        self._without_moment: dict[tuple[int, int], PostureWithoutMoment] = {}
        self._projectors: dict[tuple[int, int], Projector] = {}
        self._nlps: dict[tuple[int, int], NlpModel] = {}

    def lift(self, scaled: ScaledProblem) -> LiftAnswer:
        """Solve the lift, in its small form where that says the same."""
        key = (*scaled.size, not scaled.box_implied)
        if key not in self._lifts:
            self._lifts[key] = LiftModel(*scaled.size, whole_box=key[2])
        return self._lifts[key].solve(scaled)

    def box(self, scaled: ScaledProblem) -> McCormick:
        """P1 over one box for problems of this size."""
        if scaled.size not in self._boxes:
            self._boxes[scaled.size] = McCormick(*scaled.size)
        return self._boxes[scaled.size]

    def without_moment(self, scaled: ScaledProblem) -> Point | None:
        """Solve P̄: a point of it, or None."""
        if scaled.size not in self._without_moment:
            self._without_moment[scaled.size] = PostureWithoutMoment(*scaled.size)
        return self._without_moment[scaled.size].solve(scaled)

    def project(self, projection: Projection, scaled: ScaledProblem, start: Point) -> Point:
        """Project ``start`` onto the bilinear surface."""
        if projection == "nlp":
            if scaled.size not in self._nlps:
                self._nlps[scaled.size] = NlpModel(*scaled.size)
            return self._nlps[scaled.size].solve(scaled, start)
        if scaled.size not in self._projectors:
            self._projectors[scaled.size] = Projector(*scaled.size)
        projector = self._projectors[scaled.size]
        ways = {
            "fix-p": projector.fix_p,
            "fix-f": projector.fix_f,
            "fix-toes": projector.fix_toes,
            "scp": projector.scp,
        }
        return ways[projection](scaled, start)
