"""The two-stage planner over learned envelopes: P1 → P2 as Lin et al. have it, with modes where
there are several boxes.

What is binary, the candidate patch of a toe and the box of a stance, is decided by branch and
bound: a node closes some choices and relaxes the others, and P2 projects what it is rounded to.
With one box a stance any plan will do: depth first, after the nearest candidates that have
friction. With several the boxes chosen are part of the answer: best first, and a rounded choice
counts only if it costs no more than the bound. A box that a stance cannot use even alone is closed
before. A learned box is no relaxation of the course: that P1 has no answer is reported with its
margin, and proves nothing.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..problem import Problem
from ..projection.project import PROJECTIONS, SURFACE, Projection, project
from ..relaxation.boxes import StanceBoxes, boxes_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..relaxation.mccormick import Axes, McCormick
from ..relaxation.modes import Modes, allowed_boxes, composed, modes_of_frames
from ..relaxation.relaxed import RelaxationAnswer
from .answer import Acceptance, Claim, TimeLimited, plan_of
from .clock import Clock
from .cuts import alone
from .either import Kind
from .least_steps import over_sides
from .two_stage import TwoStageCoursePlanner

WHOLE = 1e-4
"""A share this close to 1 is a choice already made."""
GAP = 1e-4
"""A rounded choice that costs at most this share more than the bound, or 1e-8 of the length scale
squared, is best."""


class EnvelopeCoursePlanner(TimeLimited):
    """P1 over one envelope, or over modes, then P2.

    Arguments:
        envelopes: boxes in contact frames, learned for a stance of the course or its mirror image;
            with several, one is chosen a stance. Several sets are for stances on different limbs;
            ``StanceBoxes`` for the stances of one course. ``Modes`` are boxes in world axes.
        relaxation: P1 over them, a class like ``McCormick``.
        max_nodes, max_solves, time_limit_s: of the search.
    """

    name = "two-stage"
    answers: ClassVar[Kind] = "courses"

    def __init__(
        self,
        envelopes: EnvelopeSet | Sequence[EnvelopeSet] | StanceBoxes | Modes,
        *,
        relaxation: type[McCormick] = McCormick,
        projection: Projection = "scp",
        reserve: bool = True,
        acceptance: Acceptance = Acceptance(),
        max_nodes: int = 200,
        max_solves: int | None = None,
        time_limit_s: float = 60.0,
        programs: Programs | None = None,
    ) -> None:
        PROJECTIONS.get(projection)
        self.envelopes = envelopes
        self.relaxation = relaxation
        self.axes: Axes = "world" if isinstance(envelopes, Modes) else "contact"
        self.projection: Projection = projection
        self.acceptance, self.reserve = acceptance, reserve
        self.max_nodes, self.max_solves, self.time_limit_s = max_nodes, max_solves, time_limit_s
        self.programs = programs or Programs()

    @over_sides
    def solve(self, course: Problem) -> Answer[Plan]:
        """Plan one course.

        Raises InvalidInput that names the stance that the envelopes were not learned for.
        """
        clock, scaled = Clock.start(self.time_limit_s, self.max_solves), Scaled.of(course)
        learned = self.envelopes.boxes if isinstance(self.envelopes, Modes) else self.envelopes
        boxes = (
            learned.boxes
            if isinstance(learned, StanceBoxes)
            else boxes_of(course, learned, self.axes)
        )
        search = _Search(self, course, scaled, boxes, clock)
        search.run()
        details = search.details()
        plan, message = None, search.message
        if search.found is not None:
            choice, point, chosen = search.found
            modes = (
                modes_of_frames(scaled.layout, chosen)
                if isinstance(self.envelopes, Modes)
                else None
            )
            some = (learned,) if isinstance(learned, EnvelopeSet | StanceBoxes) else learned
            names = [one.problem_class for one in some]
            made = {"planner": self.name, "projection": self.projection, "p1": ", ".join(names)}
            plan = plan_of(course, scaled, choice, point, provenance=made, modes=modes)
        elif search.solved_none and len(boxes) == 1:
            details["margin"] = self.margin(scaled, boxes[0], clock).margin
            if np.isinf(details["margin"]):  # infeasible whatever the box: the lift may prove it
                left_s, solves = clock.left()
                lift = TwoStageCoursePlanner(
                    programs=self.programs,
                    acceptance=self.acceptance,
                    time_limit_s=left_s,
                    max_solves=solves,
                )
                proof = lift.solve(course)
                if proof.status is Status.INFEASIBLE:
                    return proof
            message = f"P1 misses the envelope by {details['margin']:.3g}; over a learned box that is no proof"
        elif search.solved_none:
            message = (
                message
                or "P1 has no answer for any choice of boxes; over learned ones that is no proof"
            )
        word = "infeasible" if plan is None and search.solved_none else ""
        claim = Claim(found=plan, word=word, message=message, details=details)
        return self.acceptance.answer(course, claim, method=self.name, clock=clock)

    def margin(self, scaled: Scaled, box: Envelope, clock: Clock | None = None) -> RelaxationAnswer:
        """The signed margin of P1 over one box a contact, all open candidates allowed."""
        answer = self.programs.get(self.relaxation, scaled.layout, self.axes).solve(scaled, box)
        (clock or Clock.start()).count(1, answer.seconds)
        return answer

    def size(self, scaled: Scaled) -> tuple[int, int]:
        """Rows and columns of P1 with one box a stance."""
        return self.programs.get(self.relaxation, scaled.layout, self.axes, False).rows.shape

    def relaxed(
        self, scaled: Scaled, boxes: Sequence[Envelope], allowed: Array, clock: Clock
    ) -> RelaxationAnswer:
        """P1 with these boxes allowed in every stance, shape (S, E); one box a stance needs no
        hull.
        """
        if np.all(allowed.sum(axis=1) == 1.0):
            box = composed(scaled.layout, boxes, allowed.argmax(axis=1))
            answer = self.programs.get(self.relaxation, scaled.layout, self.axes, False).solve(
                scaled, box
            )
        else:
            hull = self.programs.get(self.relaxation, scaled.layout, self.axes, False, len(boxes))
            answer = hull.solve_hull(scaled, boxes, allowed)
        clock.count(1, answer.seconds)
        return answer

    def allowed(self, scaled: Scaled, boxes: Sequence[Envelope], clock: Clock) -> Array:
        """1 where a stance, looked at alone, may use a box; shape (S, E)."""
        result = allowed_boxes(scaled, boxes, self.axes)
        for stance in np.flatnonzero(result.sum(axis=1) > 1.0):
            part, _, rows = alone(scaled, int(stance))
            for e in np.flatnonzero(result[stance]).tolist():
                box = Envelope(low=boxes[e].low[rows], high=boxes[e].high[rows])
                answer = self.relaxed(part, [box], np.ones((1, 1)), clock)
                result[stance, e] = float(not np.isposinf(answer.margin))
        return result


class _Search:
    """Best first over the choices of one course: which candidates are open, (P, options), and which
    boxes, (S, E).
    """

    def __init__(
        self,
        planner: EnvelopeCoursePlanner,
        course: Problem,
        scaled: Scaled,
        boxes: Sequence[Envelope],
        clock: Clock,
    ) -> None:
        self._planner, self._course, self._scaled, self._boxes, self._clock = (
            planner,
            course,
            scaled,
            boxes,
            clock,
        )
        self._heap: list[tuple[float, int, Array, Array, RelaxationAnswer]] = []
        self.found: tuple[Index, Point, Index] | None = None
        self.nodes = self.tried = 0
        self.message = ""
        self.open_stances = 0
        self.gap, self.objective = float("nan"), float("nan")
        self._open_end = False

    @property
    def solved_none(self) -> bool:
        """Tell whether P1 has no answer for any choice."""
        return self.found is None and not self._open_end

    def details(self) -> dict[str, float]:
        """Figures of the search."""
        return {
            "nodes": float(self.nodes),
            "projected": float(self.tried),
            "open_stances": float(self.open_stances),
            "gap": self.gap,
            "p1_objective": self.objective * self._scaled.length_m**2,
        }

    def run(self) -> None:
        """Search until there is a plan, nothing left, or a limit."""
        layout, planner = self._scaled.layout, self._planner
        allowed = planner.allowed(self._scaled, self._boxes, self._clock)
        if np.any(allowed.sum(axis=1) == 0.0):
            frame, limbs = layout.stances[int(np.flatnonzero(allowed.sum(axis=1) == 0.0)[0])]
            names = ", ".join(self._course.robot.limb_names[limb] for limb in limbs)
            self.message = f"frame {frame}, stance on {names}: no envelope has room for it"
            return
        self.open_stances = int(np.sum(allowed.sum(axis=1) > 1.0))
        whole = self._scaled.opened()
        if len(self._boxes) == 1 and whole.sum() > layout.footholds:
            rough = self._scaled.by_candidate((self._scaled.friction > 0.0).astype(np.float64), 0.0)
            self._settle(_one_of(rough * whole + 0.5 * whole), allowed, np.inf)
        self._add(whole, allowed)
        while self._heap and self.found is None:
            if self.nodes >= planner.max_nodes or self._clock.ended():
                limit = (
                    f"{planner.max_nodes} nodes"
                    if self.nodes >= planner.max_nodes
                    else self._clock.limit
                )
                self.message, self._open_end = (
                    f"the search for choices met its limit ({limit})",
                    True,
                )
                return
            self._expand(*heapq.heappop(self._heap))
        if self.found is None and self._open_end and not self.message:
            self.message = (
                f"P1 admits the course, but {planner.projection} found no plan from its points"
            )

    def _add(self, opened: Array, allowed: Array) -> None:
        """Solve a node and keep it where it has an answer."""
        self.nodes += 1
        answer = self._planner.relaxed(self._scaled.only(opened), self._boxes, allowed, self._clock)
        if not answer.known:
            self.message, self._open_end = "the conic solver gave up", True
        elif answer.relaxed is not None:
            order = answer.objective if len(self._boxes) > 1 else -float(self.nodes)
            heapq.heappush(self._heap, (order, self.nodes, opened, allowed, answer))

    def _settle(self, opened: Array, allowed: Array, most: float) -> None:
        """Solve with every choice made, and project where that costs no more than ``most``."""
        answer = self._planner.relaxed(self._scaled.only(opened), self._boxes, allowed, self._clock)
        if answer.relaxed is not None and answer.objective <= most:
            self._project(answer, allowed)

    def _expand(
        self, _: float, __: int, opened: Array, allowed: Array, answer: RelaxationAnswer
    ) -> None:
        assert answer.relaxed is not None
        shares = answer.relaxed.scaled.by_candidate(answer.relaxed.shares, 0.0)
        modes = allowed if answer.modes is None else answer.modes
        loose = np.where(opened.sum(axis=1) > 1.0, 1.0 - shares.max(axis=1), 0.0)
        torn = np.where(allowed.sum(axis=1) > 1.0, 1.0 - modes.max(axis=1), 0.0)
        if max(loose.max(), torn.max()) <= WHOLE:
            self._project(answer, modes)
            self._open_end |= self.found is None
            return
        bound = answer.objective + max(GAP * abs(answer.objective), 1e-8)
        self._settle(
            _one_of(shares), _one_of(modes * allowed), bound if len(self._boxes) > 1 else np.inf
        )
        if self.found is not None:
            return
        which, table = (0, shares) if loose.max() >= torn.max() else (1, modes)
        row = int((loose, torn)[which].argmax())
        column = int(table[row].argmax())
        for keep in (False, True):
            parts = [opened.copy(), allowed.copy()]
            share = parts[which][row, column]
            if keep:
                parts[which][row] = 0.0
            parts[which][row, column] = share if keep else 0.0
            self._add(*parts)

    def _project(self, answer: RelaxationAnswer, modes: Array) -> None:
        """Round the shares to a choice and project; ``found`` where that gives a plan."""
        assert answer.relaxed is not None
        self.tried += 1
        choice, start = answer.relaxed.rounded()
        point = project(
            self._planner.programs, self._planner.projection, self._scaled.chosen(choice), start
        )
        self._clock.count(point.solves, point.seconds)
        if point.residual <= SURFACE:
            self.found = (choice, point, np.asarray(modes.argmax(axis=1)))
            self.gap, self.objective = answer.gap, answer.objective


def _one_of(shares: Array) -> Array:
    """1 at the largest of every row, 0 elsewhere."""
    choice = np.zeros_like(shares)
    choice[np.arange(len(shares)), shares.argmax(axis=1)] = 1.0
    return choice
