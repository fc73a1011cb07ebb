"""The search of the two-stage planner over learned envelopes: P1 → P2 as Lin et al. have it, with modes where
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

import functools
import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..problem import Problem
from ..problem.contact import OPEN, half_space, parts, too_small
from ..projection.force_distribution import along, lengths_of
from ..projection.project import SURFACE, Projection, project
from ..relaxation.boxes import (
    Modes,
    StanceBoxes,
    allowed_boxes,
    boxes_of,
    composed,
    modes_of_frames,
)
from ..relaxation.envelope import Envelope, EnvelopeSet, RelaxationAnswer
from ..relaxation.mccormick import Axes, McCormick
from .answer import Acceptance, Clock, Method, kind_of, plan_of
from .cuts import alone

_TRIES = 3
"""Plans that go on as the last one goes, before a side is parted."""
SHARE = 0.5
"""Share of the time that is left which one question may take: a planner that seeks the best plan takes
all that it gets."""
_MOST_ASKED = 100
"""Questions to a planner that has no limit of time."""
_SHORT = 1e-6
"""A step that is shorter than δ by less than this is long enough [m or rad]."""
_Sides = tuple[Array | None, ...]
_Proof = tuple[list[list[float]], list[Array]]
"""Nodes of a tree, and the multipliers of its leaves."""


def over_sides(solve: Callable[[Any, Problem], Answer[Plan]]) -> Callable[..., Answer[Plan]]:
    """Decorate ``solve`` of a planner: courses with least steps are branched over directions."""

    @functools.wraps(solve)
    def branched(planner: Any, course: Problem, /, **more: Any) -> Answer[Plan]:
        if course.sides is not None or not len(course.least_steps):
            return solve(planner, course, **more)
        return _Search(planner, solve, course).answer()

    return branched


class _Search:
    """One course: depth first, each part by the part in which the parent's plan goes first."""

    def __init__(
        self, planner: Any, solve: Callable[[Any, Problem], Answer[Plan]], course: Problem
    ) -> None:
        self._planner, self._solve, self._course = planner, solve, course
        limited = isinstance(planner, Method)
        self._clock = Clock.start(planner.limit_s(kind_of(course)) if limited else math.inf)
        self._plan: Plan | None = None
        self._message, self._parts, self._asked = "", 0, 0
        self._bound = math.nan
        self._room = _most(course) / course.least_steps

    def answer(self) -> Answer[Plan]:
        """Search to the end, or to the time limit, and put what was found to the verifier."""
        acceptance: Acceptance = self._planner.acceptance
        proof = self._proof((None,) * len(self._course.least_steps), 0)
        certificate = None
        if proof is not None and proof[1]:
            tree, rows = np.array(proof[0], dtype=np.float64), np.concatenate(proof[1])
            certificate = Certificate(tree=tree, multipliers=rows)
        if self._plan is None and certificate is None and not self._message:
            self._message = "no plan was found in the directions of least steps that were tried"
        details = {"asked": float(self._asked), "parted": float(self._parts)}
        return acceptance.answer(
            self._course,
            plan=self._plan,
            certificate=certificate,
            message=self._message,
            details=details,
            method=self._planner.name,
            clock=self._clock,
            bound=self._bound,
        )

    def _proof(self, sides: _Sides, depth: int) -> _Proof | None:
        """A proof that no plan goes by these sides; None with a plan, or without either."""
        outcome = self._ask(replace(self._course, sides=self._rows(sides)))
        if outcome is None:
            return None
        if depth == 0:
            self._bound = outcome.bound
        if outcome.certificate is not None:
            return outcome.certificate.tree.tolist(), [outcome.certificate.multipliers]
        plan = outcome.solution
        if plan is None:
            self._message = self._message or outcome.message
            return None
        for _ in range(_TRIES):
            if self._kept(plan):
                return None
            further = self._ask(along(self._course, plan))
            if further is None:
                return None
            if further.solution is None:
                break
            plan = further.solution
        if self._kept(plan):
            return None
        return self._parted(sides, outcome.solution, depth)

    def _parted(self, sides: _Sides, plan: Plan | None, depth: int) -> _Proof | None:
        """The proof over the parts of one step's side, in their order: of the steps that are too
        short the one whose side is the smallest, then the one that has the least room.
        """
        assert plan is not None
        steps, lengths = lengths_of(plan, self._course)
        short = np.flatnonzero(lengths < self._course.least_steps - _SHORT)
        open_ = [e for e in short.tolist() if not too_small(sides[e])]
        if not open_:
            self._message = self._message or "the directions of least steps are parted no further"
            return None
        breadths = {
            e: np.inf if (side := sides[e]) is None else float(np.linalg.norm(side[0] - side[1]))
            for e in open_
        }
        e = min(open_, key=lambda e: (breadths[e], self._room[e], lengths[e]))
        self._parts += 1
        pieces = parts(sides[e])
        order = np.argsort([-float((piece @ steps[e]).min()) for piece in pieces], kind="stable")
        proofs: dict[int, _Proof] = {}
        for index in order.tolist():
            proof = self._proof((*sides[:e], pieces[index], *sides[e + 1 :]), depth + 1)
            if self._plan is not None or self._clock.ended():
                return None
            if proof is not None:
                proofs[index] = proof
        if len(proofs) < len(pieces):
            return None
        tree: list[list[float]] = [[4.0, float(e), 0.0, 0.0, 0.0]]
        rows: list[Array] = []
        for index in range(len(pieces)):
            tree += proofs[index][0]
            rows += proofs[index][1]
        return tree, rows

    def _ask(self, course: Problem) -> Answer[Plan] | None:
        """The planner's answer in the time that is left; None where none is."""
        left_s = self._clock.left()[0]
        if self._asked >= _MOST_ASKED and left_s == math.inf:
            self._message = f"the search over directions of least steps met its limit of {_MOST_ASKED} questions"
            return None
        if left_s <= 0.0:
            self._message = "the search over directions of least steps met its time limit"
            return None
        planner = self._planner
        if hasattr(planner, "with_limit"):
            planner = planner.with_limit(max(SHARE * left_s, 1e-3))
        outcome = self._solve(planner, course)
        self._asked += 1
        self._clock.count(outcome.effort.solves, outcome.effort.solver_s)
        self._clock.compile_s += outcome.effort.compile_s
        return outcome

    def _kept(self, plan: Plan) -> bool:
        """Keep the plan where no step of it is too short."""
        lengths = lengths_of(plan, self._course)[1]
        if not (lengths >= self._course.least_steps - _SHORT).all():
            return False
        self._plan = replace(plan, problem=self._course)
        return True

    def _rows(self, sides: _Sides) -> Array:
        least = self._course.least_steps
        rows = [
            np.array(OPEN) if side is None else half_space(side, float(least[e]))
            for e, side in enumerate(sides)
        ]
        return np.array(rows)


def _most(course: Problem) -> Array:
    """Greatest length of each least step by its patches, or by the tilt limit, alone, shape (E,)."""
    toes = [
        max(
            float(np.linalg.norm(one[:, None] - other, axis=2).max())
            for one in _places(course, before)
            for other in _places(course, after)
        )
        for before, after in course.moves.tolist()
    ]
    turn = min(2.0 * math.sqrt(3.0) * course.tilt_limit_rad, course.steps.rotation_rad)
    count = len(course.least_steps)
    lengths = toes if course.steps.least_toe_m > 0.0 else []
    return np.array([*lengths, *[turn] * (count - len(lengths))])


def _places(course: Problem, foothold: int) -> list[Array]:
    """Corners of what a toe may stand on, candidate by candidate, shapes (·, 3) [m]."""
    toe = course.footholds[foothold].toe_m
    return [region.vertices_m if toe is None else toe[None] for region in course.regions[foothold]]


_WHOLE = 1e-4
"""A share this close to 1 is a choice already made."""
NODES = 200
"""Of one search, where nobody says."""
_GAP = 1e-4
"""A rounded choice that costs at most this share more than the bound, or 1e-8 of the length scale
squared, is best."""


class EnvelopeSearch:
    """Best first over the choices of one course: which candidates are open, (P, options), and which
    boxes, (S, E).

    Arguments:
        envelopes: as for ``TwoStage``.
        relaxation: P1 over them, a class like ``McCormick``.
        max_nodes: 200 where None.
    """

    def __init__(
        self,
        programs: Programs,
        course: Problem,
        envelopes: EnvelopeSet | Sequence[EnvelopeSet] | StanceBoxes | Modes,
        clock: Clock,
        *,
        relaxation: type[McCormick] = McCormick,
        projection: Projection = "scp",
        max_nodes: int | None = None,
    ) -> None:
        self._programs, self._course, self._clock = programs, course, clock
        self._relaxation, self._projection = relaxation, projection
        self._modes = isinstance(envelopes, Modes)
        self._axes: Axes = "world" if self._modes else "contact"
        self._learned = envelopes.boxes if isinstance(envelopes, Modes) else envelopes
        self._max_nodes = NODES if max_nodes is None else max_nodes
        self._scaled = Scaled.of(course)
        self.boxes: Sequence[Envelope] = (
            self._learned.boxes
            if isinstance(self._learned, StanceBoxes)
            else boxes_of(course, self._learned, self._axes)
        )
        self._heap: list[tuple[float, int, Array, Array, RelaxationAnswer]] = []
        self.found: tuple[Index, Point, Index] | None = None
        self.nodes = self.tried = 0
        self.message = ""
        self.open_stances = 0
        self.gap, self.objective = float("nan"), float("nan")
        self._open_end = False

    def plan(self, planner: str) -> Plan | None:
        """The plan that was found.

        Arguments:
            planner: its name, for the provenance.
        """
        if self.found is None:
            return None
        choice, point, chosen = self.found
        modes = modes_of_frames(self._scaled.layout, chosen) if self._modes else None
        learned = self._learned
        some = (learned,) if isinstance(learned, EnvelopeSet | StanceBoxes) else learned
        names = ", ".join(one.problem_class for one in some)
        made = {"planner": planner, "projection": self._projection, "p1": names}
        return plan_of(self._course, self._scaled, choice, point, provenance=made, modes=modes)

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
        layout = self._scaled.layout
        allowed = self.allowed()
        if np.any(allowed.sum(axis=1) == 0.0):
            frame, limbs = layout.stances[int(np.flatnonzero(allowed.sum(axis=1) == 0.0)[0])]
            names = ", ".join(self._course.robot.limb_names[limb] for limb in limbs)
            self.message = f"frame {frame}, stance on {names}: no envelope has room for it"
            return
        self.open_stances = int(np.sum(allowed.sum(axis=1) > 1.0))
        whole = self._scaled.opened()
        if len(self.boxes) == 1 and whole.sum() > layout.footholds:
            rough = self._scaled.by_candidate((self._scaled.friction > 0.0).astype(np.float64), 0.0)
            self._settle(_one_of(rough * whole + 0.5 * whole), allowed, np.inf)
        self._add(whole, allowed)
        while self._heap and self.found is None:
            if self.nodes >= self._max_nodes or self._clock.ended():
                limit = (
                    f"{self._max_nodes} nodes"
                    if self.nodes >= self._max_nodes
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
                f"P1 admits the course, but {self._projection} found no plan from its points"
            )

    def margin(self) -> float:
        """The signed margin of P1 over the one box a contact, all open candidates allowed."""
        program = self._programs.get(self._relaxation, self._scaled.layout, self._axes)
        answer = program.solve(self._scaled, self.boxes[0])
        self._clock.count(1, answer.seconds)
        return answer.margin

    def relaxed(
        self, scaled: Scaled, boxes: Sequence[Envelope], allowed: Array
    ) -> RelaxationAnswer:
        """P1 with these boxes allowed in every stance, shape (S, E); one box a stance needs no
        hull.
        """
        if np.all(allowed.sum(axis=1) == 1.0):
            box = composed(scaled.layout, boxes, allowed.argmax(axis=1))
            answer = self._programs.get(self._relaxation, scaled.layout, self._axes, False).solve(
                scaled, box
            )
        else:
            hull = self._programs.get(
                self._relaxation, scaled.layout, self._axes, False, len(boxes)
            )
            answer = hull.solve_hull(scaled, boxes, allowed)
        self._clock.count(1, answer.seconds)
        return answer

    def allowed(self) -> Array:
        """1 where a stance, looked at alone, may use a box; shape (S, E)."""
        scaled, boxes = self._scaled, self.boxes
        result = allowed_boxes(scaled, boxes, self._axes)
        for stance in np.flatnonzero(result.sum(axis=1) > 1.0):
            part, _, rows = alone(scaled, int(stance))
            for e in np.flatnonzero(result[stance]).tolist():
                box = Envelope(low=boxes[e].low[rows], high=boxes[e].high[rows])
                answer = self.relaxed(part, [box], np.ones((1, 1)))
                result[stance, e] = float(not np.isposinf(answer.margin))
        return result

    def _add(self, opened: Array, allowed: Array) -> None:
        """Solve a node and keep it where it has an answer."""
        self.nodes += 1
        answer = self.relaxed(self._scaled.only(opened), self.boxes, allowed)
        if not answer.known:
            self.message, self._open_end = "the conic solver gave up", True
        elif answer.relaxed is not None:
            order = answer.objective if len(self.boxes) > 1 else -float(self.nodes)
            heapq.heappush(self._heap, (order, self.nodes, opened, allowed, answer))

    def _settle(self, opened: Array, allowed: Array, most: float) -> None:
        """Solve with every choice made, and project where that costs no more than ``most``."""
        answer = self.relaxed(self._scaled.only(opened), self.boxes, allowed)
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
        if max(loose.max(), torn.max()) <= _WHOLE:
            self._project(answer, modes)
            self._open_end |= self.found is None
            return
        bound = answer.objective + max(_GAP * abs(answer.objective), 1e-8)
        self._settle(
            _one_of(shares), _one_of(modes * allowed), bound if len(self.boxes) > 1 else np.inf
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
        point = project(self._programs, self._projection, self._scaled.chosen(choice), start)
        self._clock.count(point.solves, point.seconds)
        if point.residual <= SURFACE:
            self.found = (choice, point, np.asarray(modes.argmax(axis=1)))
            self.gap, self.objective = answer.gap, answer.objective


def _one_of(shares: Array) -> Array:
    """1 at the largest of every row, 0 elsewhere."""
    choice = np.zeros_like(shares)
    choice[np.arange(len(shares)), shares.argmax(axis=1)] = 1.0
    return choice
