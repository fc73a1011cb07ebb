"""The compiled models of both stages, shared by planners, environments and evaluation."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from ..arrays import Array
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
        return self._lift(*scaled.size, not scaled.box_implied).solve(scaled)

    def lifts(self, scaled: ScaledProblem) -> list[LiftAnswer]:
        """``lift`` of every problem of a batch."""
        answers: dict[int, LiftAnswer] = {}
        for implied in (True, False):
            chosen = np.flatnonzero(scaled.boxes_implied == implied)
            if len(chosen):
                some = scaled.select(chosen)
                answers |= zip(chosen.tolist(), self._lift(*scaled.size, not implied).solve_all(some), strict=True)
        return [answers[k] for k in range(len(answers))]

    def _lift(self, contacts: int, vertices: int, whole_box: bool) -> LiftModel:
        key = (contacts, vertices, whole_box)
        if key not in self._lifts:
            self._lifts[key] = LiftModel(contacts, vertices, whole_box=whole_box)
        return self._lifts[key]

    def box(self, scaled: ScaledProblem) -> McCormick:
        """P1 over one box for problems of this size."""
        if scaled.size not in self._boxes:
            self._boxes[scaled.size] = McCormick(*scaled.size)
        return self._boxes[scaled.size]

    def without_moment(self, scaled: ScaledProblem) -> Point | None:
        """Solve P̄: a point of it, or None."""
        return self._p_bar(scaled).solve(scaled)

    def without_moments(self, scaled: ScaledProblem) -> list[Point | None]:
        """``without_moment`` of every problem of a batch."""
        return self._p_bar(scaled).solve_all(scaled)

    def _p_bar(self, scaled: ScaledProblem) -> PostureWithoutMoment:
        if scaled.size not in self._without_moment:
            self._without_moment[scaled.size] = PostureWithoutMoment(*scaled.size)
        return self._without_moment[scaled.size]

    def project(self, projection: Projection, scaled: ScaledProblem, start: Point, *, worth: float = np.inf) -> Point:
        """Project ``start`` onto the bilinear surface. worth: of ``Projector.scp``."""
        if projection == "nlp":
            if scaled.size not in self._nlps:
                self._nlps[scaled.size] = NlpModel(*scaled.size)
            return self._nlps[scaled.size].solve(scaled, start)
        projector = self._projector(scaled)
        if projection == "scp":
            return projector.scp(scaled, start, worth=worth)
        ways = {
            "fix-p": projector.fix_p,
            "fix-f": projector.fix_f,
            "fix-toes": projector.fix_toes,
        }
        return ways[projection](scaled, start)

    def fix_toes(self, scaled: ScaledProblem, toes: Array) -> list[Point]:
        """Project toes of every problem of a batch by fix-toes; toes: shape (B, N, 3)."""
        return self._projector(scaled).fix_all_toes(scaled, toes)

    def _projector(self, scaled: ScaledProblem) -> Projector:
        if scaled.size not in self._projectors:
            self._projectors[scaled.size] = Projector(*scaled.size)
        return self._projectors[scaled.size]
