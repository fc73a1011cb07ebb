"""The two-stage planner P1 → P2 over the lift (Lin et al. §II, §IV-B), for postures and for
courses.

A course is tried in this order: the nearest patches that have friction; a dive and a branch and
bound over the choices (``choice``), every node rounded and projected, with cuts in space against
stances that cannot be held alone (``nogoods``); cuts in space over all frames (``cuts``), where P1
still has points and P2 finds no plan. Feasible with a plan, infeasible with a certificate, or
undecided at a limit.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ..answer.answer import Answer
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import checked
from ..problem import Problem
from ..projection.descent import improved
from ..projection.project import PROJECTIONS, STEPS, SURFACE, Projection, project
from .answer import Acceptance, Claim, TimeLimited, plan_of
from .choice import ChoiceSearch, SearchLimits
from .clock import Clock
from .cuts import PROVABLE, CutSearch
from .either import Kind
from .least_steps import over_sides

QUICK = 2
"""Linearised steps of SCP before anybody asks whether the stances can be held at all."""
CHOICE_SHARE = 0.75
"""Share of the time limit that the search over choices may use where cuts in space, which get the
rest, are of use."""


class TwoStageCoursePlanner(TimeLimited):
    """P1 by the lift, P2 by projection, branch and bound over candidates, and cuts where P1 says
    yes and P2 no.

    Arguments:
        projection: see ``projection.project``.
        gap: None takes the first plan that the search finds; else the search goes on, and improves
            plans, until one is proved to be within this relative gap of the best.
        max_nodes: of each search.
        time_limit_s, max_solves: of one course, None for no limit of solves.
        cuts: whether to cut in space.
        steps: of SCP at most, where the first few bring a point near to a plan.
    """

    name = "two-stage"
    answers: ClassVar[Kind] = "courses"

    def __init__(
        self,
        *,
        projection: Projection = "scp",
        reserve: bool = True,
        acceptance: Acceptance = Acceptance(),
        gap: float | None = None,
        max_nodes: int = 2000,
        max_solves: float | None = None,
        time_limit_s: float = 60.0,
        cuts: bool = True,
        steps: int = STEPS,
        programs: Programs | None = None,
    ) -> None:
        PROJECTIONS.get(projection)
        self.projection: Projection = projection
        self.acceptance, self.reserve = acceptance, reserve
        self.gap = None if gap is None else checked(gap, "gap", above=0.0)
        self.max_nodes, self.max_solves = max_nodes, max_solves
        self.time_limit_s = time_limit_s
        self.cuts = cuts
        self.steps = steps
        self.programs = programs or Programs()

    @over_sides
    def solve(self, course: Problem) -> Answer[Plan]:
        """Plan one course; bound is the root's lower bound on the objective, with ``gap`` that of
        the whole search.
        """
        clock, scaled = Clock.start(self.time_limit_s, self.max_solves), Scaled.of(course)
        search = self.search(scaled, clock)
        result, message, proof = search.found, search.message, None
        if (
            not scaled.layout.pushes
        ):  # a proof that no plan bears them is none that there is no plan
            proof = search.certificate()
        elif result is None:
            message = (
                message or f"no plan was found whose stances bear a push of {course.push_n:g} N"
            )
        details = {
            "nodes": float(search.nodes),
            "guessed": float(search.guessed),
            "projected": float(search.tried),
            "dived": float(search.dived),
            "cuts": 0.0,
        }
        if (
            result is None
            and proof is None
            and self.cuts
            and not scaled.layout.pushes
            and not clock.ended()
        ):
            result, proof, nodes = decide(self.programs, scaled, clock, self.max_nodes)
            message, details["cuts"] = "" if result or proof else message, float(nodes)
        plan = None
        if result is not None:
            made = {"planner": self.name, "projection": self.projection, "p1": "lift"}
            plan = plan_of(course, scaled, *result, provenance=made)
        claim, bound = (
            Claim(found=plan, certificate=proof, message=message, details=details),
            search.bound,
        )
        return self.acceptance.answer(
            course, claim, method=self.name, clock=clock, bound=bound * course.length_scale_m**2
        )

    def search(self, scaled: Scaled, clock: Clock) -> ChoiceSearch:
        """The search over the patches of one course, run."""
        share = CHOICE_SHARE if self.cuts else 1.0
        limits = SearchLimits(max_nodes=self.max_nodes, gap=self.gap, share=share)

        def projected(chosen: Scaled, start: Point, patient: bool) -> Point:
            steps = self.steps if patient else min(self.steps, QUICK)
            deadline = clock.begin + clock.time_limit_s
            point = project(
                self.programs, self.projection, chosen, start, steps=steps, deadline=deadline
            )
            clock.count(point.solves, point.seconds)
            if self.gap is None or not point.residual <= SURFACE:
                return point
            return improved(self.programs, chosen, point, clock)

        search = ChoiceSearch(self.programs, scaled, projected, limits, clock)
        search.run()
        return search


def decide(
    programs: Programs, scaled: Scaled, clock: Clock, max_nodes: int
) -> tuple[tuple[Index, Point] | None, Certificate | None, int]:
    """Decide a course by cuts in space: choice and point, or certificate, or neither at a limit;
    and how many nodes.
    """
    left_s, solves = clock.left()
    search = CutSearch(
        programs,
        scaled,
        gap=PROVABLE,
        tolerance=1e-6,
        max_nodes=max_nodes,
        deadline=time.perf_counter() + left_s,
        max_solves=solves,
    )
    search.run()
    clock.count(search.solves, search.seconds)
    if search.found is None:
        return None, search.certificate(), search.nodes
    choice, point = search.found
    best = project(
        programs, "fix-toes", scaled.chosen(choice), point
    )  # with the course's objective
    return (
        (choice, best if np.isfinite(best.residual) else replace(point, objective=float("nan"))),
        None,
        search.nodes,
    )
