"""The exact planner of small courses: branch and bound over regions, pieces of patches and force boxes.

First the search over patches to its end (``search.py``): where the lift is tight it closes the gap, or refutes the
course. What it leaves open is cut in space, best first: the lift is the lower bound of the objective; fix-toes, SCP and
descent from its toes are the upper bound. On a piece of no size the lift is exact, as for one posture
(``contact.exact``). A course that only cuts in space refute has no certificate: that is a claim, and stays undecided.
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass

import numpy as np

from ..arrays import checked
from ..conic import ConicStatus
from ..contact.exact import PATCH_UNIT_M
from ..outcome import InvalidInput
from ..plan import PlanOutcome
from ..scene.course import Course
from .clock import Clock
from .descent import cost
from .layout import Index
from .lift import LiftedPlan
from .narrowed import NarrowedCourse, NarrowedLift
from .planner import PlanAcceptance, plan_of
from .project import PlanPoint
from .scaled import ScaledCourse
from .search import LEAST, WHOLE, RegionSearch
from .twostage import CourseModels, TwoStageCoursePlanner


@dataclass(kw_only=True, eq=False)
class _Node:
    """A part of the course and what the lift says there."""

    course: NarrowedCourse
    lift: LiftedPlan
    bound: float
    depth: int = 0


class ExactCoursePlanner:
    """A plan within ``gap`` of the best, a certificate that there is none, or what is known at a limit.

    gap: relative. max_nodes, time_limit_s: where to stop; the bound is then what is proved so far.
    """

    name = "exact"

    def __init__(
        self,
        *,
        acceptance: PlanAcceptance = PlanAcceptance(),
        gap: float = 1e-3,
        max_nodes: int = 20000,
        time_limit_s: float = 60.0,
        models: CourseModels | None = None,
    ) -> None:
        self.acceptance = acceptance
        self.gap = checked(gap, "gap", above=0.0)
        if max_nodes < 1:
            raise InvalidInput(f"max_nodes: expected 1 or more, got {max_nodes}")
        self.max_nodes = max_nodes
        self.time_limit_s = checked(time_limit_s, "time_limit_s", least=0.0)
        self.models = models or CourseModels()
        self._regions = TwoStageCoursePlanner(
            gap=gap, max_nodes=max_nodes, time_limit_s=0.5 * time_limit_s, models=self.models
        )
        self._lifts: dict[tuple[object, ...], NarrowedLift] = {}

    def solve(self, course: Course) -> PlanOutcome:
        """Plan one course. claim: optimal where the gap is closed, infeasible where only cuts in space refute."""
        clock, scaled = Clock.start(), ScaledCourse.of(course)
        head = self._regions.search(scaled, clock)
        proof, details = head.certificate(), {"nodes": float(head.nodes), "cuts": 0.0}
        found, upper, lower, stopped = head.found, head.upper, head.bound, ""
        if proof is None and not head.closed:
            whole = NarrowedCourse.whole(scaled)
            tail = _Search(self, self._lift(whole, clock), head, (scaled, whole), clock)
            tail.run()
            found, upper, lower, stopped = tail.best, tail.upper, tail.lower, tail.stopped
            details |= {"nodes": float(head.nodes + tail.nodes), "cuts": float(tail.cuts)}
        plan, claim = None, "" if stopped or proof is not None else "infeasible"
        if found is not None:
            plan = plan_of(scaled, *found, provenance={"planner": self.name, "gap": self.gap})
            details["gap"] = max(0.0, upper - lower) / max(upper, LEAST)
            claim = "" if stopped else "optimal"
        bound = float("nan") if claim == "infeasible" else lower * course.length_scale_m**2
        return self.acceptance.outcome(
            course, method=self.name, clock=clock, plan=plan, certificate=proof, bound=bound, claim=claim,
            message=stopped, details=details,
        )  # fmt: skip

    def _lift(self, whole: NarrowedCourse, clock: Clock) -> NarrowedLift:
        if whole.key not in self._lifts:
            with clock.compiling():
                self._lifts[whole.key] = NarrowedLift(whole.layout, whole.typical())
        return self._lifts[whole.key]


class _Search:
    """Best-first branch and bound in space, from what the search over patches knows."""

    def __init__(
        self,
        planner: ExactCoursePlanner,
        model: NarrowedLift,
        head: RegionSearch,
        courses: tuple[ScaledCourse, NarrowedCourse],
        clock: Clock,
    ) -> None:
        self._planner, self._model, self._clock = planner, model, clock
        self._scaled, self._whole = courses
        self.best: tuple[Index, PlanPoint] | None = head.found
        self.upper = head.upper
        self._known = head.bound if np.isfinite(head.bound) else 0.0  # no objective is negative
        self.lower = self._known
        self.nodes = self.cuts = 0
        self.stopped = ""
        self._lost = float("inf")  # least bound of a node that the solver gave up on
        self._queue: list[tuple[float, int, int, _Node]] = []
        self._order = itertools.count()
        self._quantum = 0.1 * planner.gap * max(self._known, LEAST)

    def run(self) -> None:
        """Search until the gap is closed, nothing is left, or a limit."""
        self._push(self._node(self._whole))
        while self._queue:
            bound, _, _, node = heapq.heappop(self._queue)
            self.lower = max(self._known, min(bound, self._lost))
            if self._closed(self.lower):
                return
            if self.nodes >= self._planner.max_nodes or self._clock.working() > self._planner.time_limit_s:
                at_nodes = self.nodes >= self._planner.max_nodes
                limit = f"{self._planner.max_nodes} nodes" if at_nodes else "its time limit"
                self.stopped = f"the search met its limit ({limit})"
                return
            self._project(node)
            if self._closed(self.lower):
                return
            for child in self._branch(node):
                self._push(self._node(child, node))
        self.lower = min(self.upper, self._lost)
        if np.isfinite(self._lost):
            self.stopped = "the conic solver gave up on a part of the course"

    def _closed(self, bound: float) -> bool:
        return self.best is not None and bound >= self.upper - self._planner.gap * max(self.upper, LEAST)

    def _node(self, course: NarrowedCourse, above: _Node | None = None) -> _Node:
        self.nodes += 1
        lift = self._model.solve(course)
        self._clock.count(1, lift.solution.seconds)
        known, depth = (float("-inf"), 0) if above is None else (above.bound, above.depth + 1)
        bound = max(known, lift.objective) if lift.status is ConicStatus.SOLVED else known
        return _Node(course=course, lift=lift, bound=bound, depth=depth)

    def _push(self, node: _Node) -> None:
        """By bound, in steps of a tenth of the gap; of equal ones the deepest first."""
        if node.lift.status is ConicStatus.SOLVED:
            bound = float(np.floor(node.bound / self._quantum)) * self._quantum
            heapq.heappush(self._queue, (bound, -node.depth, next(self._order), node))
        elif node.lift.status is ConicStatus.FAILED:
            self._lost = min(self._lost, node.bound)

    def _project(self, node: _Node) -> None:
        """A plan from the node's toes. The whole course's patches and boxes hold, not only the node's."""
        lift, models = node.lift, self._planner.models
        choice, toes = lift.rounded()
        chosen = self._scaled.chosen(choice)
        frames = chosen.frames[chosen.layout.bearing[2]]
        forces = np.matmul(frames.transpose(0, 2, 1), lift.forces[..., None])[..., 0]
        start = PlanPoint(com=lift.com, rotation=lift.rotation, toes=toes, forces=forces, residual=float("inf"))
        projector = models.projector(chosen)
        way = projector.fix_toes if self.best is not None else projector.scp
        point = way(chosen, start, self._clock)
        if point.found and cost(chosen, point) < self.upper:
            self._keep(choice, point, cost(chosen, point))
            least = 0.1 * self._planner.gap * max(self.upper, LEAST)
            point = models.descent(chosen).improve(chosen, point, self._clock, least=least)
            self._keep(choice, point, cost(chosen, point))

    def _keep(self, choice: Index, point: PlanPoint, value: float) -> None:
        if value < self.upper:
            self.best, self.upper = (choice, point), value

    def _branch(self, node: _Node) -> list[NarrowedCourse]:
        """Two parts that cover the node: a region's, where shares are torn, or halves in space."""
        course, layout = node.course, node.course.layout
        opened = course.opened.reshape(layout.placements, layout.regions)
        shares = np.where(opened > 0.0, node.lift.shares, 0.0)
        torn = np.where(opened.sum(axis=1) > 1.0, 1.0 - shares.max(axis=1), -1.0)
        if float(torn.max()) > WHOLE:
            p = int(torn.argmax())
            r = int(shares[p].argmax())
            on, off = opened.copy(), opened.copy()
            on[p], off[p, r] = 0.0, 0.0
            on[p, r] = 1.0
            return [course.only(on), course.only(off)]
        self.cuts += 1
        return self._halves(node)

    def _halves(self, node: _Node) -> list[NarrowedCourse]:
        """Split where the lift gains the most moment: the force that its vertices spread, or the patch they are of."""
        course, layout = node.course, node.course.layout
        model, solution, regions = self._model.model, node.lift.solution, layout.regions
        pieces = layout.piece_slots.reshape(-1, regions)
        shares = np.maximum(model.value("weights", solution), 0.0)[pieces]  # (B, R, U)
        world = model.value("lifted", solution).reshape(*shares.shape, 3)
        vertices = course.vertices[pieces]
        toe = np.sum(shares[..., None] * vertices, axis=(1, 2))
        gained = np.cross(vertices, world).sum(axis=(1, 2)) - np.cross(toe, world.sum(axis=(1, 2)))
        b = int(np.linalg.norm(gained, axis=1).argmax())
        forces, share = np.matmul(world[b], course.frames[pieces[b]]), shares[b][..., None]  # in contact axes
        away = forces / np.maximum(share, 1e-9) - forces.sum(axis=(0, 1))
        spread = np.sqrt(np.sum(share * away**2, axis=(0, 1)))
        axis, slot = int(spread.argmax()), int(pieces[b, shares[b].sum(axis=1).argmax()])
        low, high = float(course.low[b, axis]), float(course.high[b, axis])
        small = high - low < 0.5 * course.size(slot) * course.course.length_scale_m / PATCH_UNIT_M
        if len(course.pieces[slot]) > 2 and (small or spread[axis] < 1e-9):
            return course.halved(slot)
        return course.split(b, axis, 0.5 * (low + high))
