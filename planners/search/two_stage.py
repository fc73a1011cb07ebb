"""The two-stage planner P1 → P2 (Lin et al. §II, §IV-B), for postures and for courses.

A posture is relaxed once and put on the bilinear surface; a course over learned
envelopes chooses patches and boxes on the way (``enveloped``). A course over the lift is tried in
this order: the nearest patches that have friction; a dive and a branch and
bound over the choices (``choice``), every node rounded and projected, with cuts in space against
stances that cannot be held alone (``cuts``); cuts in space over all frames (``cuts``), where P1
still has points and P2 finds no plan. Feasible with a plan, infeasible with a certificate, or
undecided at a limit.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..files.arrays import check_numbers
from ..problem import Problem
from ..projection.project import PROJECTIONS, STEPS, SURFACE, Projection, improved, project
from ..relaxation.boxes import Modes, StanceBoxes
from ..relaxation.envelope import RELAXATIONS, EnvelopeSet, RelaxedProgram
from ..relaxation.lift import LiftAnswer, as_relaxation, solve_lift
from ..relaxation.mccormick import McCormick
from .answer import Clock, Kind, Method, kind_of, plan_of
from .choice import ChoiceSearch
from .cuts import LEAF, PROVABLE, CutSearch
from .enveloped import over_sides

_QUICK = 2
"""Linearised steps of SCP before anybody asks whether the stances can be held at all."""
NODES = 2000
"""Of each search over the lift, where nobody says."""
_CHOICE_SHARE = 0.75
"""Share of the time limit that the search over choices may use where cuts in space, which get the
rest, are of use."""


@dataclass(frozen=True, kw_only=True)
class TwoStage(Method):
    """The two stages of Lin et al.: P1, a convex relaxation, then P2, a projection onto the
    bilinear surface m = p·f.

    Arguments:
        relaxation: P1, a name of ``RELAXATIONS``; None for "p1" with envelopes, and for the lift
            without any.
        envelopes: learned boxes that P1 is over, in contact frames, for a stance of the problem or
            its mirror image; of courses, with several, one is chosen a stance, and also several
            sets, for stances on different limbs, ``StanceBoxes`` for the stances of one course, and
            ``Modes``, boxes in world axes.
        projection: P2, a name of ``PROJECTIONS``; None gives P1's own point to the verifier, for
            postures.
        reserve: for courses: plan with 80 % of the friction where that has a plan, else with 90 %,
            else with all.
        max_solves: for courses: convex solves of one search at most, beside the limit of time; None
            for no such limit. With a ``time_limit_s`` that is never met, 1e6, the plan is the same
            on a busy computer.

        gap: for courses: None takes the first plan that the search finds; else the search goes on,
            and improves plans, until one is proved to be within this relative gap of the best.
        max_nodes: nodes of each search of a course; 2000 over the lift and 200 over envelopes where
            None; over the lift 0 tries the first guess of patches alone.
        cuts, proves: for courses: whether to cut in space where P1 says yes and P2 no, and whether
            to look for proofs.
        steps: most steps of SCP, of which the first few come near a plan.
        time_limit_s, acceptance, programs, most_s: see ``Method``.

    Raises:
        InvalidInput: for an unknown name, envelopes that are missing, and envelopes that the lift
            has no use for.
    Source:
        Lin et al. §II, §III.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.TwoStage(projection="fix-p")).status.value
        'feasible'
    """

    name: ClassVar[str] = "two-stage"
    OF_COURSES: ClassVar[tuple[str, ...]] = (
        "reserve",
        "max_solves",
        "time_limit_s",
        "gap",
        "max_nodes",
        "cuts",
        "proves",
        "steps",
    )
    relaxation: str | None = None
    envelopes: EnvelopeSet | Sequence[EnvelopeSet] | StanceBoxes | Modes | None = None
    projection: Projection | None = "scp"
    reserve: bool = True
    max_solves: float | None = None
    gap: float | None = None
    max_nodes: int | None = None
    cuts: bool = True
    proves: bool = True
    steps: int = STEPS

    def __post_init__(self) -> None:
        super().__post_init__()
        check_numbers(self, least=("max_solves", "max_nodes"), above=("gap",))
        if self.projection is not None:
            PROJECTIONS.get(self.projection)
        if self.relaxation is None:
            return
        over_boxes = RELAXATIONS.get(self.relaxation).over_boxes
        if over_boxes and self.envelopes is None:
            raise InvalidInput(
                f"envelopes: expected an envelope for the relaxation {self.relaxation}, got none"
            )
        if not over_boxes and self.envelopes is not None:
            raise InvalidInput(
                f"envelopes: expected none for the {self.relaxation}, which uses none"
            )

    def check(self, kind: Kind) -> None:
        """Raise InvalidInput for a setting that this kind of question has no use for, or needs."""
        super().check(kind)
        if kind == "postures":
            self._of_one_class()
            return
        if self.projection is None:
            raise InvalidInput("projection: expected one for courses, got none")
        if self.envelopes is not None:
            self.boxed()

    def relaxed(self) -> type[RelaxedProgram]:
        """P1 over envelopes."""
        return RELAXATIONS.get(self.relaxation or "p1")

    def boxed(self) -> type[McCormick]:
        """P1 over the envelopes of a course.

        Raises InvalidInput for one that is not derived from p1.
        """
        relaxation = self.relaxed()
        if not (isinstance(relaxation, type) and issubclass(relaxation, McCormick)):
            raise InvalidInput(
                "relaxation: expected one for courses, p1 or one derived from it, got "
                f"{self.relaxation or 'p1'}"
            )
        return relaxation

    def solve(self, problem: Problem) -> Answer[Plan]:
        """Answer one problem; of a course over the lift, bound is the root's lower bound on the
        objective, with ``gap`` that of the whole search.

        Raises InvalidInput where the envelopes were not learned for it, and for settings that its
        kind has no use for.
        """
        self.check(kind_of(problem))
        if problem.is_posture:
            return self._of_posture(problem)
        return self._over_lift(problem) if self.envelopes is None else self._within(problem)

    @property
    def posture_name(self) -> str:
        """Name of what answers a posture."""
        if self.envelopes is not None:
            return self.name if self.projection else "p1"
        return f"lift+{self.projection}" if self.projection else "lift"

    @over_sides
    def _over_lift(self, course: Problem) -> Answer[Plan]:
        """Plan one course over the lift."""
        clock, scaled = Clock.start(self.limit_s("courses"), self.max_solves), Scaled.of(course)
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
            result, proof, nodes = decide(
                self.kept, scaled, clock, NODES if self.max_nodes is None else self.max_nodes
            )
            message, details["cuts"] = "" if result or proof else message, float(nodes)
        plan = None
        if result is not None:
            made = {"planner": self.name, "projection": self.projection, "p1": "lift"}
            plan = plan_of(course, scaled, *result, provenance=made)
        return self.acceptance.answer(
            course,
            plan=plan,
            certificate=proof,
            message=message,
            details=details,
            method=self.name,
            clock=clock,
            bound=search.bound * course.unit_m**2,
        )

    def _of_posture(self, problem: Problem) -> Answer[Plan]:
        """Relax, project, verify.

        A relaxation that is infeasible proves something only where it relaxes the whole problem:
        the lift's answer comes with a certificate, an envelope's is reported as its margin and the
        problem stays undecided. Without a projection the relaxation's own point is put to the
        verifier.

        Raises InvalidInput where the envelopes were learned for another class.
        """
        clock, lift, envelopes = Clock.start(), None, self._of_one_class()
        if envelopes is not None:
            envelopes.check_fits(problem)
        scaled = Scaled.of(problem)
        if envelopes is None:
            lift = solve_lift(self.kept, scaled, least_moment=True)
            answer = as_relaxation(lift)
        else:
            answer = self.relaxed().answers(self.kept, [scaled], [envelopes.envelopes], [])[0]
        clock.count(answer.solves, 0.0)
        if not answer.known:
            return self.acceptance.answer(
                problem,
                message="the relaxation was not solved",
                method=self.posture_name,
                clock=clock,
            )
        details = {"margin": answer.margin, "gap": answer.gap, "chosen": float(answer.chosen)}
        if (
            not (answer.feasible if lift is None else answer.margin <= self.acceptance.gap)
            or answer.point is None
        ):
            return self._refused(problem, scaled, clock, lift, details)
        point = answer.point
        if self.projection:
            point = project(self.kept, self.projection, scaled, answer.point)
            clock.count(point.solves, 0.0)
        plan: Plan | None = None
        if not (self.projection and np.isinf(point.residual)) and np.all(np.isfinite(point.forces)):
            plan = plan_of(problem, scaled, scaled.numbers, point)
        message = "" if plan is not None else f"{self.projection} found no answer from P1's point"
        return self.acceptance.answer(
            problem,
            plan=plan,
            word="feasible",
            message=message,
            details=details,
            method=self.posture_name,
            clock=clock,
        )

    def _refused(
        self,
        problem: Problem,
        scaled: Scaled,
        clock: Clock,
        lift: LiftAnswer | None,
        details: dict[str, float],
    ) -> Answer[Plan]:
        """The relaxation is infeasible.

        Where that holds whatever the box, the lift's certificate says so.
        """
        if lift is None and np.isinf(details["margin"]):
            lift = solve_lift(self.kept, scaled, least_moment=True)
            clock.count(1, 0.0)
        proof = lift is not None and lift.solved and lift.bound > self.acceptance.gap
        certificate = (
            Certificate(tree=np.array([LEAF]), multipliers=lift.multipliers[None])
            if lift and proof
            else None
        )
        message = (
            ""
            if certificate
            else "the relaxation is infeasible; over a learned box that is no proof"
        )
        return self.acceptance.answer(
            problem,
            certificate=certificate,
            word="infeasible",
            message=message,
            details=details,
            method=self.posture_name,
            clock=clock,
        )

    def _of_one_class(self) -> EnvelopeSet | None:
        """The envelopes of postures.

        Raises InvalidInput for what only courses can be planned over.
        """
        if self.envelopes is None:
            return None
        if isinstance(self.envelopes, EnvelopeSet):
            return self.envelopes
        came = "modes" if isinstance(self.envelopes, Modes) else type(self.envelopes).__name__
        raise InvalidInput(
            f"envelopes: expected one EnvelopeSet for postures, got {came}; others are for courses"
        )

    @over_sides
    def _within(self, course: Problem) -> Answer[Plan]:
        """Plan one course over envelopes.

        Raises InvalidInput that names the stance that the envelopes were not learned for.
        """
        from .enveloped import EnvelopeSearch

        assert self.envelopes is not None
        assert self.projection is not None
        clock = Clock.start(self.limit_s("courses"), self.max_solves)
        search = EnvelopeSearch(
            self.kept,
            course,
            self.envelopes,
            clock,
            relaxation=self.boxed(),
            projection=self.projection,
            max_nodes=self.max_nodes,
        )
        search.run()
        details, plan, message = search.details(), search.plan(self.name), search.message
        if plan is None and search.solved_none and len(search.boxes) == 1:
            details["margin"] = search.margin()
            if np.isinf(details["margin"]):  # infeasible whatever the box: the lift may prove it
                left_s, solves = clock.left()
                lift = TwoStage(
                    programs=self.programs,
                    acceptance=self.acceptance,
                    time_limit_s=left_s,
                    max_solves=None if np.isinf(solves) else solves,
                )
                proof = lift.solve(course)
                if proof.status is Status.INFEASIBLE:
                    return proof
            message = f"P1 misses the envelope by {details['margin']:.3g}; over a learned box that is no proof"
        elif plan is None and search.solved_none:
            message = (
                message
                or "P1 has no answer for any choice of boxes; over learned ones that is no proof"
            )
        return self.acceptance.answer(
            course,
            plan=plan,
            word="infeasible" if plan is None and search.solved_none else "",
            message=message,
            details=details,
            method=self.name,
            clock=clock,
        )

    def search(self, scaled: Scaled, clock: Clock) -> ChoiceSearch:
        """Run the search over the patches of one course."""
        assert self.projection is not None
        share = _CHOICE_SHARE if self.cuts else 1.0
        max_nodes, projection = NODES if self.max_nodes is None else self.max_nodes, self.projection
        learns = scaled.options > 1 or (self.proves and not scaled.layout.pushes)

        def projected(chosen: Scaled, start: Point, patient: bool) -> Point:
            steps = self.steps if patient else min(self.steps, _QUICK)
            deadline = clock.begin + clock.time_limit_s
            point = project(self.kept, projection, chosen, start, steps=steps, deadline=deadline)
            clock.count(point.solves, point.seconds)
            if self.gap is None or not point.residual <= SURFACE:
                return point
            return improved(self.kept, chosen, point, clock.count)

        search = ChoiceSearch(
            self.kept,
            scaled,
            projected,
            clock,
            max_nodes=max_nodes,
            gap=self.gap,
            share=share,
            learns=learns,
        )
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
