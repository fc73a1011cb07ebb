"""The two-stage planner of courses (paper E §IV-B): P1 over all key frames at once, then P2 for the same.

Where toes have several candidate patches the choice is binary: a depth-first branch and bound over the choices, whose
node problem is the lift with some slots closed, and which rounds and projects at every node. Tried first: the nearest
candidates that have friction (``search.py``). A tree that is searched to its end without a plan, every leaf refuted by
the lift, is a certificate that there is none.
"""

from __future__ import annotations

from ..arrays import checked
from ..outcome import InvalidInput
from ..plan import PlanOutcome
from ..scene.course import Course
from .clock import Clock
from .descent import Descent
from .lift import LiftedCourse
from .planner import PlanAcceptance, plan_of
from .project import PROJECTIONS, PlanPoint, PlanProjector, Projection
from .scaled import ScaledCourse
from .search import Limits, Project, RegionSearch


class CourseModels:
    """The compiled models of key frames, by layout and objective; shared by planners and environments."""

    def __init__(self) -> None:
        self._lifts: dict[tuple[object, ...], LiftedCourse] = {}
        self._projectors: dict[tuple[object, ...], PlanProjector] = {}
        self._descents: dict[tuple[object, ...], Descent] = {}

    def lift(self, scaled: ScaledCourse, clock: Clock) -> LiftedCourse:
        """The lift for courses of this layout."""
        key = scaled.key
        if key not in self._lifts:
            with clock.compiling():
                self._lifts[key] = LiftedCourse(
                    scaled.layout, scaled.course.weights, scaled.course.length_scale_m, scaled.typical(), soft=False
                )
        return self._lifts[key]

    def projector(self, chosen: ScaledCourse) -> PlanProjector:
        """The projections for courses of this layout, one region. They compile when first used."""
        key = chosen.key
        if key not in self._projectors:
            self._projectors[key] = PlanProjector(chosen.layout, chosen.course.weights, chosen.typical())
        return self._projectors[key]

    def descent(self, chosen: ScaledCourse) -> Descent:
        """The descent for courses of this layout, one region."""
        key = chosen.key
        if key not in self._descents:
            weights, projector = chosen.course.weights, self.projector(chosen)
            self._descents[key] = Descent(chosen.layout, weights, chosen.typical(), projector)
        return self._descents[key]


class TwoStageCoursePlanner:
    """P1 by the lift, P2 by projection, and branch and bound over the candidate patches.

    projection: see ``project``. gap: None takes the first plan that the search finds; else the search goes on, and
    improves plans, until one is proved to be within this relative gap of the best. max_nodes: of the search for
    regions. time_limit_s: of one course, compiling excluded.
    """

    name = "two-stage"

    def __init__(
        self,
        *,
        projection: Projection = "scp",
        acceptance: PlanAcceptance = PlanAcceptance(),
        gap: float | None = None,
        max_nodes: int = 2000,
        time_limit_s: float = 60.0,
        models: CourseModels | None = None,
    ) -> None:
        if projection not in PROJECTIONS:
            raise InvalidInput(f"projection: expected one of {', '.join(PROJECTIONS)}, got {projection!r}")
        self.projection: Projection = projection
        self.acceptance = acceptance
        self.gap = None if gap is None else checked(gap, "gap", above=0.0)
        self.max_nodes = max_nodes
        self.time_limit_s = time_limit_s
        self._models = models or CourseModels()

    def solve(self, course: Course) -> PlanOutcome:
        """Plan one course; bound is the root's lower bound on the objective, with ``gap`` that of the whole search."""
        clock, scaled = Clock.start(), ScaledCourse.of(course)
        search, plan = self.search(scaled, clock), None
        if search.found is not None:
            choice, point = search.found
            plan = plan_of(
                scaled, choice, point, provenance={"planner": self.name, "projection": self.projection, "p1": "lift"}
            )
        return self.acceptance.outcome(
            course,
            method=self.name,
            clock=clock,
            plan=plan,
            certificate=search.certificate(),
            bound=search.bound * course.length_scale_m**2,
            message=search.message,
            details={"nodes": float(search.nodes), "guessed": float(search.guessed), "projected": float(search.tried)},
        )

    def search(self, scaled: ScaledCourse, clock: Clock) -> RegionSearch:
        """The search over the patches of one course, run."""
        limits = Limits(max_nodes=self.max_nodes, time_limit_s=self.time_limit_s, gap=self.gap)
        search = RegionSearch(self._models.lift(scaled, clock), scaled, self._projected(clock), limits, clock)
        search.run()
        return search

    def _projected(self, clock: Clock) -> Project:
        """P2, and with ``gap`` the descent after it."""

        def project(chosen: ScaledCourse, start: PlanPoint) -> PlanPoint:
            point = self._models.projector(chosen).project(self.projection, chosen, start, clock)
            if self.gap is None or not point.found:
                return point
            return self._models.descent(chosen).improve(chosen, point, clock)

        return project
