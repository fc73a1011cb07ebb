"""The exact planner: a posture decided by cuts in space; a course planned to within a gap of its
best plan.

A posture is feasible with a witness or infeasible with a certificate (``cuts``). A course is first
searched over its patches to the end (``choice``): where the lift is tight that closes the gap, or
refutes the course. What it leaves open is cut in space, best first: the lift is the lower bound of
the objective; fix-toes, SCP and descent from its toes are the upper bound. A course that only cuts
in space refute gets its certificate from ``two_stage.decide``.
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.programs import ConicStatus, Programs
from ..equilibrium.scaled import Point, Scaled, cones_met, skew
from ..files.arrays import Array, check_numbers
from ..problem import Problem
from ..projection.project import SURFACE, Projection, cost, improved, project
from ..relaxation.envelope import Envelope
from ..relaxation.lift import LiftAnswer, solve_lift
from ..relaxation.mccormick import McCormick, domain_of, toe_ranges
from .answer import Acceptance, Clock, Kind, Method, plan_of
from .choice import LEAST, ChoiceSearch
from .cuts import CutSearch, bent_patches, branch
from .enveloped import over_sides
from .two_stage import TwoStage, decide

_REFUTED_MARGIN = 1e-6
"""A box is refuted where P1's margin exceeds this: a hundred times the solver's tolerance."""
_ROUNDING = 1e-9
_SWEEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class _OpenBox:
    """A box that is neither refuted nor projected, and P1's answer over it.

    Arguments:
        margin: t, at most REFUTED_MARGIN.
        point: P1's [p, f], shape (N, 6).
        gaps: |m_jk − p_j f_k|, shape (N, 3, 3).
        depth: cuts from the first box.
    """

    box: Envelope
    margin: float
    point: Array
    gaps: Array
    depth: int


class BoxSearch:
    """One problem's search, best first: ``current`` is the open box of least margin, ``cut`` halves
    it.

    verdict: UNDECIDED while boxes are open. solves: convex problems so far. posture: the witness,
    where feasible.
    """

    def __init__(
        self,
        problem: Problem,
        scaled: Scaled,
        programs: Programs,
        *,
        projection: Projection = "fix-toes",
        acceptance: Acceptance = Acceptance(),
    ) -> None:
        self._problem, self._scaled, self._programs = problem, scaled, programs
        self._projection, self._acceptance = projection, acceptance
        self._queue: list[tuple[float, int, _OpenBox]] = []
        self._pushed = 0
        self.solves = 0
        self.refuted = 0
        self.posture: Plan | None = None
        self._visit(domain_of(scaled, reach=False), depth=0)

    @property
    def verdict(self) -> Status:
        """Verdict that is proved so far."""
        if self.posture is not None:
            return Status.FEASIBLE
        return Status.UNDECIDED if self._queue else Status.INFEASIBLE

    @property
    def open(self) -> int:
        """Number of boxes that are neither refuted nor cut."""
        return len(self._queue)

    @property
    def current(self) -> _OpenBox:
        """The open box of least margin.

        Raises IndexError where none is open.
        """
        return self._queue[0][2]

    def cut(self, dimension: int) -> None:
        """Halve the current box in the middle of this dimension, 0 … 6N − 1 (contact by contact),
        and visit both.
        """
        node = heapq.heappop(self._queue)[2]
        contact, column = divmod(dimension, 6)
        middle = 0.5 * (node.box.low[contact, column] + node.box.high[contact, column])
        for end in ("low", "high"):
            bounds = {"low": node.box.low.copy(), "high": node.box.high.copy()}
            bounds[end][contact, column] = middle
            if self.posture is None:
                self._visit(Envelope(**bounds), depth=node.depth + 1)

    def _visit(self, box: Envelope, *, depth: int) -> None:
        """Refute the box, or find a posture in it, or keep it open."""
        tight = propagate(self._scaled, box)
        if tight is None:
            self.refuted += 1
            return
        answer = self._relax(tight, depth)
        if answer is None:
            self.refuted += 1
            return
        node, point = answer
        if point is not None:
            self.posture = self._project(point)
        self._pushed += 1
        heapq.heappush(self._queue, (node.margin, self._pushed, node))

    def _relax(self, box: Envelope, depth: int) -> tuple[_OpenBox, Point | None] | None:
        """P1 over the box; None where it is refuted.

        A solver that gives up leaves the box open, with no point.
        """
        answer = self._programs.get(McCormick, self._scaled.layout).solve(self._scaled, box)
        self.solves += 1
        if not answer.known:
            middle = 0.5 * (box.low + box.high)
            return _OpenBox(
                box=box, margin=0.0, point=middle, gaps=np.zeros((len(middle), 3, 3)), depth=depth
            ), None
        if answer.margin > _REFUTED_MARGIN or answer.at is None or answer.excess is None:
            return None
        gaps = np.abs(answer.excess)
        return _OpenBox(
            box=box, margin=answer.margin, point=answer.at, gaps=gaps, depth=depth
        ), answer.point

    def _project(self, start: Point) -> Plan | None:
        """A verified posture from P1's point, or None."""
        point = project(self._programs, self._projection, self._scaled, start)
        self.solves += point.solves
        if not point.residual <= self._acceptance.tolerance:
            return None
        posture = plan_of(self._problem, self._scaled, self._scaled.numbers, point)
        outcome = self._acceptance.answer(
            self._problem, plan=posture, method=self._projection, clock=Clock.start()
        )
        return outcome.solution


def propagate(scaled: Scaled, box: Envelope) -> Envelope | None:
    """The box less what interval arithmetic rules out; None where nothing is left.

    p = toe − c with one c for all contacts; the friction cone; and Σ f = w e_z − F, by components.
    """
    low, high = box.low.copy(), box.high.copy()
    for _ in range(_SWEEPS):
        if not (
            _share_com(scaled, low, high)
            and _in_cones(scaled, low, high)
            and _balance(scaled, low, high)
        ):
            return None
        if np.any(low > high + _ROUNDING):
            return None
        high = np.maximum(low, high)
    return Envelope(low=low, high=high)


def _share_com(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow p through the interval of the centre of mass, in place.

    False where that is empty.
    """
    toe_low, toe_high = toe_ranges(scaled)
    com_low = (
        np.maximum((toe_low - high[:, :3]).max(axis=0), scaled.com - scaled.com_radius) - _ROUNDING
    )
    com_high = (
        np.minimum((toe_high - low[:, :3]).min(axis=0), scaled.com + scaled.com_radius) + _ROUNDING
    )
    low[:, :3] = np.maximum(low[:, :3], toe_low - com_high)
    high[:, :3] = np.minimum(high[:, :3], toe_high - com_low)
    return bool(np.all(com_low <= com_high))


def _in_cones(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow |f_y|, |f_z| ≤ μ f_n, in place.

    False where a frictionless contact would have to shear.
    """
    shear = scaled.friction * high[:, 3] + _ROUNDING
    low[:, 4:] = np.maximum(low[:, 4:], -shear[:, None])
    high[:, 4:] = np.minimum(high[:, 4:], shear[:, None])
    least = np.maximum(np.maximum(low[:, 4:], -high[:, 4:]), 0.0).max(axis=1)
    rough = scaled.friction > _ROUNDING
    low[rough, 3] = np.maximum(low[rough, 3], (least[rough] - _ROUNDING) / scaled.friction[rough])
    return bool(np.all(least[~rough] <= 2.0 * _ROUNDING))


def _balance(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow every force component through Σ f = w e_z − F, in place.

    False where no forces balance.
    """
    frames = scaled.frames  # [i, r, k]: world component r of a unit force k at contact i
    ends = frames * low[:, None, 3:], frames * high[:, None, 3:]
    least, most = np.minimum(*ends), np.maximum(*ends)
    weight = scaled.borne[0]
    total_least, total_most = least.sum(axis=(0, 2)), most.sum(axis=(0, 2))
    if np.any(total_least > weight + _ROUNDING) or np.any(total_most < weight - _ROUNDING):
        return False
    room_most = (weight + _ROUNDING - total_least)[
        :, None
    ] + least  # what the others leave to this term
    room_least = (weight - _ROUNDING - total_most)[:, None] + most
    counts = np.abs(frames) > 1e-6
    safe = np.where(counts, frames, 1.0)
    first, second = room_least / safe, room_most / safe
    low[:, 3:] = np.maximum(
        low[:, 3:], np.where(counts, np.minimum(first, second), -np.inf).max(axis=1)
    )
    high[:, 3:] = np.minimum(
        high[:, 3:], np.where(counts, np.maximum(first, second), np.inf).min(axis=1)
    )
    return True


NODES: Mapping[Kind, int] = MappingProxyType({"postures": 2000, "courses": 20000})
"""Nodes of one search, where nobody says."""


@dataclass(frozen=True, kw_only=True)
class Exact(Method):
    """Branch and bound to a verdict with its evidence; of courses to the best plan, for short ones.

    Arguments:
        gap: for courses, relative: a plan this close to the best counts as best.
        max_solves: convex solves of one answer at most, beside the limit of time; None for no such
            limit. With a ``time_limit_s`` that is never met, 1e6, the answer is the same on a busy
            computer.
        max_nodes: where to stop; ``NODES`` where None.
        time_limit_s, acceptance, programs, most_s: see ``Method``.

    Posture problems whose least moment residual lies between the two figures of ``acceptance`` stay
    undecided.

    Raises:
        InvalidInput: for numbers that are negative.
    Source:
        Spatial branch and bound over E1-E11.

    Example:
        >>> import stancekit
        >>> stancekit.solve(stancekit.sample("wall-3", rng=8)[0], stancekit.Exact()).status.value
        'infeasible'
    """

    name: ClassVar[str] = "exact"
    OF_COURSES: ClassVar[tuple[str, ...]] = ("gap",)
    gap: float = 1e-3
    max_solves: int | None = None
    max_nodes: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_numbers(self, above=("gap",), least=("max_solves", "max_nodes"))

    def solve(self, problem: Problem, *, root: LiftAnswer | None = None) -> Answer[Plan]:
        """Answer one problem (of postures Lin et al.'s P, exactly).

        Of a posture: FEASIBLE with a posture, INFEASIBLE with a certificate whose leaves all prove
        a moment residual above ``acceptance.gap``, both checked by the verifier; or UNDECIDED with
        the reason. details: nodes of the tree, and trivial, 1.0 where not even P̄ has an answer.
        The verdict depends on the problem alone.

        What stands nowhere without the push that it has to bear stands nowhere with it, either:
        that is the proof. Where it does without, but not with it, it stays undecided.

        Of a course: claim is optimal where the gap is closed, infeasible where cuts refute it
        without a proof.

        Arguments:
            root: the lift of a posture problem with the least moment, where it is solved already.
        """
        if not problem.is_posture:
            return self._best(problem)
        self.check("postures")
        clock, scaled = Clock.start(), Scaled.of(replace(problem, push_n=0.0))
        search = self.search(scaled, root=root)
        clock.count(search.solves, 0.0)
        found, proof = search.found, search.certificate()
        if problem.push_n and found is not None:
            bears = Scaled.of(problem)
            pushed = self.search(bears)
            clock.count(pushed.solves, 0.0)
            if pushed.found is not None:  # else the verifier may find that the other bears it, too
                scaled, found = bears, pushed.found
        return self.acceptance.answer(
            problem,
            plan=None if found is None else plan_of(problem, scaled, *found),
            certificate=proof,
            message=search.stopped,
            details={"nodes": float(search.nodes), "trivial": float(search.trivial)},
            method=self.name,
            clock=clock,
        )

    def search(
        self, scaled: Scaled, *, root: LiftAnswer | None = None, wanted: Status | None = None
    ) -> CutSearch:
        """The finished search whose claim on a posture ``solve`` lets the verifier check.

        Arguments:
            root: as for ``solve``.
            wanted: where only this answer counts, which is then the same to the last bit; the
                search ends where it cannot come any more.
        """
        search = CutSearch(
            self.kept,
            scaled,
            gap=self.acceptance.gap,
            tolerance=self.acceptance.tolerance,
            max_nodes=NODES["postures"] if self.max_nodes is None else self.max_nodes,
            deadline=time.perf_counter() + self.limit_s("postures"),
            max_solves=math.inf if self.max_solves is None else self.max_solves,
            root=root,
            wanted=wanted,
        )
        search.run()
        return search

    @over_sides
    def _best(self, course: Problem) -> Answer[Plan]:
        """The best plan of a course."""
        limit_s = self.limit_s("courses")
        max_nodes = NODES["courses"] if self.max_nodes is None else self.max_nodes
        clock, scaled = Clock.start(limit_s, self.max_solves), Scaled.of(course)
        choices = TwoStage(
            gap=self.gap, max_nodes=max_nodes, time_limit_s=limit_s, programs=self.programs
        )
        head = choices.search(scaled, clock)
        proof, details = head.certificate(), {"nodes": float(head.nodes), "cuts": 0.0}
        best, upper, lower, stopped = head.found, head.upper, head.bound, ""
        if proof is None and not head.closed:
            tail = _BestPlan(self.kept, self.gap, max_nodes, head, scaled, clock)
            tail.run()
            best, upper, lower, stopped = tail.best, tail.upper, tail.lower, tail.stopped
            details = {"nodes": float(head.nodes + tail.nodes), "cuts": float(tail.cuts)}
        if best is None and proof is None and not stopped:
            best, proof, nodes = decide(self.kept, scaled, clock, max_nodes)
            details["nodes"] += nodes
            if best is not None:  # the solver refuted, by its tolerance, a part that has a plan
                upper, lower = cost(scaled.chosen(best[0]), best[1]), head.bound
                stopped = "the search for the best plan lost this one"
        plan, word = None, "" if stopped or proof is not None else "infeasible"
        if best is not None:
            plan = plan_of(
                course, scaled, *best, provenance={"planner": self.name, "gap": self.gap}
            )
            details["gap"] = max(0.0, upper - lower) / max(upper, LEAST)
            word = "" if stopped else "optimal"
        bound = float("nan") if word == "infeasible" else lower * course.unit_m**2
        return self.acceptance.answer(
            course,
            plan=plan,
            certificate=proof,
            word=word,
            message=stopped,
            details=details,
            method=self.name,
            clock=clock,
            bound=bound,
        )


@dataclass(kw_only=True, eq=False)
class _Node:
    """A part of the course and what the lift says there."""

    lift: LiftAnswer
    bound: float
    depth: int = 0


class _BestPlan:
    """Best-first branch and bound in space for the best plan, from what the search over patches
    knows.
    """

    def __init__(
        self,
        programs: Programs,
        gap: float,
        max_nodes: int,
        head: ChoiceSearch,
        scaled: Scaled,
        clock: Clock,
    ) -> None:
        self._programs, self._gap, self._max_nodes = programs, gap, max_nodes
        self._scaled, self._clock = scaled, clock
        self.best: tuple[Index, Point] | None = head.found
        self.upper = head.upper
        self._known = head.bound if np.isfinite(head.bound) else 0.0  # no objective is negative
        self.lower = self._known
        self.nodes = self.cuts = 0
        self.stopped = ""
        self._lost = float("inf")  # least bound of a node that the solver gave up on
        self._queue: list[tuple[float, int, int, _Node]] = []
        self._order = itertools.count()
        self._bent = bent_patches(scaled, 1e-9)
        self._quantum = 0.1 * gap * max(self._known, LEAST)

    def run(self) -> None:
        """Search until the gap is closed, nothing is left, or a limit."""
        layout = self._scaled.layout
        grip = self._scaled.by_candidate(self._scaled.friction, 0.0).max(axis=1)[layout.contacts[2]]
        box = cones_met(self._scaled.force_min, self._scaled.force_max, grip)
        self._push(self._node(self._scaled.with_force_box(*box)))
        while self._queue:
            bound, _, _, node = heapq.heappop(self._queue)
            self.lower = max(self._known, min(bound, self._lost))
            if self._closed(self.lower):
                return
            if self.nodes >= self._max_nodes or self._clock.ended():
                at_nodes = self.nodes >= self._max_nodes
                limit = f"{self._max_nodes} nodes" if at_nodes else self._clock.limit
                self.stopped = f"the search met its limit ({limit})"
                return
            self._project(node)
            if self._closed(self.lower):
                return
            for child in self._branch(node):
                self._push(self._node(child, node))
        self.lower = max(self._known, min(self.upper, self._lost))
        if np.isfinite(self._lost):
            self.stopped = "the conic solver gave up on a part of the course"

    def _closed(self, bound: float) -> bool:
        return self.best is not None and bound >= self.upper - self._gap * max(self.upper, LEAST)

    def _node(self, part: Scaled, above: _Node | None = None) -> _Node:
        self.nodes += 1
        lift = solve_lift(self._programs, part, least_moment=False)
        self._clock.count(1, lift.seconds)
        known, depth = (float("-inf"), 0) if above is None else (above.bound, above.depth + 1)
        bound = max(known, lift.bound) if lift.status is ConicStatus.SOLVED else known
        return _Node(lift=lift, bound=bound, depth=depth)

    def _push(self, node: _Node) -> None:
        """Queue a node: lowest bound first, in steps of a tenth of the gap, and among equal ones
        the deepest.
        """
        if node.lift.status is ConicStatus.SOLVED:
            bound = float(np.floor(node.bound / self._quantum)) * self._quantum
            heapq.heappush(self._queue, (bound, -node.depth, next(self._order), node))
        elif node.lift.status is ConicStatus.FAILED:
            self._lost = min(self._lost, node.bound)

    def _project(self, node: _Node) -> None:
        """A plan from the node's toes.

        The whole course's patches and boxes hold, not only the node's.
        """
        choice, start = node.lift.rounded()
        chosen = self._scaled.chosen(choice)
        point = project(
            self._programs, "fix-toes" if self.best is not None else "scp", chosen, start
        )
        self._clock.count(point.solves, point.seconds)
        if point.residual <= SURFACE and cost(chosen, point) < self.upper:
            self._keep(choice, point, cost(chosen, point))
            least = 0.1 * self._gap * max(self.upper, LEAST)
            point = improved(self._programs, chosen, point, self._clock.count, least=least)
            self._keep(choice, point, cost(chosen, point))

    def _keep(self, choice: Index, point: Point, value: float) -> None:
        if value < self.upper:
            self.best, self.upper = (choice, point), value

    def _branch(self, node: _Node) -> list[Scaled]:
        """Two parts that cover the node: a candidate's, where shares are torn, or halves in
        space.
        """
        row, parts = branch(node.lift.scaled, node.lift, _most_gained(node.lift), self._bent)
        self.cuts += row[0] != 1.0
        return parts


def _most_gained(lift: LiftAnswer) -> int:
    """The stance contact at which the lift gains the most moment: by forces that its vertices
    spread.
    """
    part, layout = lift.scaled, lift.scaled.layout
    contact, vertex = layout.contact_vertices
    share, points = lift.weights[vertex], part.bearing_vertices
    world = np.matmul(part.frames[layout.vertex_candidates[vertex]], lift.by_vertex[..., None])[
        ..., 0
    ]
    starts = np.searchsorted(contact, np.arange(len(part.force_min)))
    toe, total = np.add.reduceat(share[:, None] * points, starts), np.add.reduceat(world, starts)
    gained = np.add.reduceat(_cross(points, world), starts) - _cross(toe, total)
    return int(np.linalg.norm(gained, axis=1).argmax())


def _cross(first: Array, second: Array) -> Array:
    return np.asarray(np.matmul(skew(first), second[..., None])[..., 0])
