"""Planners of contacts without forces, as published: surfaces by slacks of least sum, or by a
mixed-integer program.

Tonneau et al., "SL1M: Sparse L1-norm Minimization for contact planning on uneven terrain" (2020):
every surface S_j that a foot p may be put on has a slack α_j, S_j p ≤ s_j + M α_j. *l1*: α ≥ 0 of
least sum; a foot is decided where one of its α is zero; the rest is tried, MOST_TRIED combinations
in order of their slacks. *mip*: α binary, all of a foot's but one are 1. Then, on the chosen
surfaces, a quadratic program. Reach is of half-spaces: the centre of mass from the feet that carry,
feet from the one that moves. It moves up or down, and not sideways, while a foot lands. Nothing
here knows of friction, weight or balance.

The course says the rest: who moves when, the objective of the quadratic program, and the yaw of
soles, the first that there is room for. What comes out has no forces; ``solve`` looks for some,
first for the body where it was planned, then for the feet alone, and the verifier judges.
"""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

import cvxpy as cp
import numpy as np

from stancekit import Answer, Motion
from stancekit.planners.equilibrium.layout import Index
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_choice
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.projection.project import project
from stancekit.planners.search.answer import Acceptance, Clock, Kind, plan_of
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface, half_planes
from stancekit.planners.verify import check_plan

Choice = Literal["l1", "mip"]
SOLVERS = {"highs": cp.HIGHS, "scip": cp.SCIP}
BIG_M = 50.0
"""M, as published."""
DECIDED, MOST_TRIED = 1e-5, 100
"""A slack below this is none; combinations that are tried; as published."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """Places of feet and body from a planner without forces, lengths in m.

    Arguments:
        choice: (P,).
        toes_m: (P, 3).
        com_m: (M, 3), or None where it has no body.
        tried: combinations.
    """

    choice: Index
    toes_m: Array
    com_m: Array | None
    tried: int


class KinematicPlanner:
    """A planner that looks at footholds and reach, without forces.

    Raises InvalidInput for another name, and a solver that is not installed.

    Arguments:
        choice: how surfaces are chosen.
        body: whether there is a centre of mass.
        solver: of the mixed-integer program, ``highs`` or ``scip``.
        time_limit_s: of each of its solves.
    """

    answers: ClassVar[Kind] = "courses"

    def __init__(
        self,
        choice: Choice,
        *,
        body: bool = True,
        solver: str = "highs",
        time_limit_s: float = 60.0,
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        checked_choice(choice, "choice", get_args(Choice))
        if solver not in SOLVERS or SOLVERS[solver] not in cp.installed_solvers():
            raise InvalidInput(
                f"solver: expected one of {', '.join(SOLVERS)} that is installed, got {solver!r}"
            )
        self.name = choice if choice == "l1" else f"{choice}, {solver}"
        self.choice, self.body, self.solver = choice, body, solver
        self.time_limit_s, self.acceptance, self.programs = (
            time_limit_s,
            acceptance,
            programs or Programs(),
        )

    def place(self, course: Problem, clock: Clock) -> tuple[Placed | None, str]:
        """Feet and body, or why there are none."""
        model = _Model(_first_yaws(course), self.body)
        tried = 0
        for choice in self._choices(model, clock):
            tried += 1
            placed = model.on(choice, clock)
            if placed is not None:
                toes, com = placed
                return Placed(choice=model.numbers(choice), toes_m=toes, com_m=com, tried=tried), ""
            if clock.elapsed() > self.time_limit_s:
                return None, "met its time limit"
        if tried:
            return (
                None,
                f"no positions on any of the {tried} combinations of surfaces that were tried",
            )
        return None, model.status

    def solve(self, course: Problem) -> Answer[Motion]:
        """Plan one course; details: ``placed``, ``cpu_s`` of it, ``tried``; ``worst`` violation as
        planned, ``freed``.

        claim: "feasible" where it has a plan of its own; message: what the verifier says of that
        with the forces that do best.
        """
        clock, cpu = Clock.start(), time.process_time()
        placed, message = self.place(course, clock)
        details = {
            "placed": float(placed is not None),
            "place_s": clock.elapsed(),
            "cpu_s": time.process_time() - cpu,
        }
        if placed is None:
            word = "infeasible" if message == "infeasible" and self.choice == "mip" else "unknown"
            return self.acceptance.answer(
                course,
                word=word,
                message=f"kinematics: {message}",
                details=details,
                method=self.name,
                clock=clock,
            )
        details["tried"] = float(placed.tried)
        plan, as_planned, reason = None, False, "there is no body in the plan"
        if placed.com_m is not None:
            plan = self._with_forces(course, placed, hold_body=True)
            report = check_plan(plan)
            as_planned, details["worst"], reason = report.accepted, report.worst, report.message
        details["as_planned"] = float(as_planned)
        if not as_planned:
            plan = self._with_forces(course, placed, hold_body=False)
            details["freed"] = float(check_plan(plan).accepted)
        return self.acceptance.answer(
            course,
            plan=plan,
            word="feasible",
            message=reason,
            details=details,
            method=self.name,
            clock=clock,
        )

    def _choices(self, model: _Model, clock: Clock) -> Iterator[Index]:
        if self.choice == "l1":
            yield from model.by_slacks(clock)
        else:
            choices = model.by_integers(self.solver, self.time_limit_s, clock)
            yield from [] if choices is None else [choices]

    def _with_forces(self, course: Problem, placed: Placed, *, hold_body: bool) -> Motion:
        """The plan with the forces that leave least moment, the body held or free."""
        scaled = Scaled.of(course)
        chosen, scale = scaled.chosen(placed.choice), scaled.length_m
        com = course.com_nominal_m if placed.com_m is None else placed.com_m
        point = Point(
            com=com / scale,
            rotation=np.zeros_like(com),
            toes=placed.toes_m / scale,
            forces=np.zeros((len(chosen.layout.contacts[0]), 3)),
            residual=np.inf,
        )
        projected = project(self.programs, "fix-p" if hold_body else "fix-toes", chosen, point)
        if not np.isfinite(projected.residual):
            projected = replace(point, forces=np.zeros_like(point.forces))
        return plan_of(course, scaled, placed.choice, projected, provenance={"planner": self.name})


class _Model:
    """The terms that all programs share: toes, body and their reach, in cvxpy; candidates as
    half-spaces.
    """

    def __init__(self, course: tuple[Problem, list[list[int]]], body: bool) -> None:
        self._course, self._numbers = course
        course_here, footholds = self._course, self._course.footholds
        self.status = ""
        self._toes, self._com = (
            cp.Variable((len(footholds), 3)),
            cp.Variable((course_here.frames, 3)),
        )
        self._sides = [
            [_sides(region) for region in regions] if foothold.toe_m is None else []
            for foothold, regions in zip(footholds, course_here.regions, strict=True)
        ]
        self._slacks = {
            p: cp.Variable(len(sides)) for p, sides in enumerate(self._sides) if len(sides) > 1
        }
        stood = [
            self._toes[p] == foothold.toe_m
            for p, foothold in enumerate(footholds)
            if foothold.toe_m is not None
        ]
        self._body = body
        self._shared = [*stood, *self._feet(), *(self._reach() if body else [])]

    def numbers(self, choice: Index) -> Index:
        """The choice by the numbers of the course's own candidates."""
        return np.array(
            [of_foothold[c] for of_foothold, c in zip(self._numbers, choice, strict=True)],
            dtype=np.int_,
        )

    def _feet(self) -> list[cp.Constraint]:
        """Feet from the one that moves."""
        course, names, terms = self._course, self._course.robot.limb_names, []
        for frame, lifted in enumerate(course.lifts):
            for pair in course.robot.relative_reach:
                if pair.limb in lifted:
                    here, there = (
                        course.holds[frame, names.index(name)] for name in (pair.limb, pair.other)
                    )
                    terms.append(
                        pair.rows.normals @ (self._toes[there] - self._toes[here])
                        <= pair.rows.bounds_m
                    )
        return terms

    def _reach(self) -> list[cp.Constraint]:
        """The centre of mass from the feet that carry."""
        course, terms = self._course, []
        for stance in course.stances:
            com, feet = self._com[stance.frame], course.holds[stance.frame, list(stance.limbs)]
            for limb, foot in zip(stance.limbs, feet, strict=True):
                rows = course.robot.limbs[limb].reach_rows
                if rows is None:
                    raise InvalidInput(
                        f"limb {course.robot.limb_names[limb]}: expected reach as half-spaces, got "
                        "a ball"
                    )
                terms.append(rows.normals @ (self._toes[foot] - com) <= rows.bounds_m)
        lands = [
            k
            for k, lifted in enumerate(course.lifts)
            if lifted and k + 1 < course.frames and not course.lifts[k + 1]
        ]
        return [
            *terms,
            *([self._com[lands, :2] == self._com[[k + 1 for k in lands], :2]] if lands else []),
        ]

    def _on_surfaces(self, slacks: dict[int, cp.Variable]) -> list[cp.Constraint]:
        terms = []
        for p, sides in enumerate(self._sides):
            for j, (normals, offsets) in enumerate(sides):
                room = offsets + BIG_M * slacks[p][j] if p in slacks else offsets
                terms.append(normals @ self._toes[p] <= room)
        return terms

    def by_slacks(self, clock: Clock) -> Iterator[Index]:
        """Choices by the slacks of least sum: the one that they decide, or combinations of what
        they leave open.
        """
        total = sum((cp.sum(slack) for slack in self._slacks.values()), cp.Constant(0.0))
        terms = [
            *self._shared,
            *self._on_surfaces(self._slacks),
            *(slack >= 0 for slack in self._slacks.values()),
        ]
        if not self._solved(cp.Problem(cp.Minimize(total), terms), cp.HIGHS, clock):
            return
        choice = np.zeros(len(self._sides), dtype=np.int_)
        for p, slack in self._slacks.items():
            choice[p] = int(np.argmin(slack.value))
        open_ = [p for p, slack in self._slacks.items() if float(np.min(slack.value)) > DECIDED]
        orders = [np.argsort(self._slacks[p].value, kind="stable").tolist() for p in open_]
        for combination in itertools.islice(itertools.product(*orders), MOST_TRIED):
            choice[open_] = combination
            yield choice.copy()

    def by_integers(self, solver: str, time_limit_s: float, clock: Clock) -> Index | None:
        """The choice of the mixed-integer program; None without one, and ``status`` says why."""
        slacks = {
            p: cp.Variable(len(sides), boolean=True)
            for p, sides in enumerate(self._sides)
            if len(sides) > 1
        }
        terms = [
            *self._shared,
            *self._on_surfaces(slacks),
            *(cp.sum(s) == s.size - 1 for s in slacks.values()),
        ]
        options = (
            {"time_limit": time_limit_s}
            if solver == "highs"
            else {"scip_params": {"limits/time": time_limit_s}}
        )
        problem = cp.Problem(cp.Minimize(0.0), terms)
        if not self._solved(problem, SOLVERS[solver], clock, **options):
            return None
        choice = np.zeros(len(self._sides), dtype=np.int_)
        for p, slack in slacks.items():
            choice[p] = int(np.argmin(slack.value))
        return choice

    def on(self, choice: Index, clock: Clock) -> tuple[Array, Array | None] | None:
        """The best positions on chosen surfaces, by the course's objective; None without any."""
        course, weights = self._course, self._course.aim
        terms = [
            sides[c][0] @ self._toes[p] <= sides[c][1]
            for p, (sides, c) in enumerate(zip(self._sides, choice, strict=True))
            if sides
        ]
        moves = np.argwhere(course.holds[1:] != course.holds[:-1])
        before, after = (course.holds[moves[:, 0] + k, moves[:, 1]] for k in (0, 1))
        cost = (
            weights.toe_step * cp.sum_squares(self._toes[after] - self._toes[before])
            if len(moves)
            else 0.0
        )
        if self._body:
            cost += weights.goal * cp.sum_squares(self._com[-1] - course.goal_m)
            cost += weights.com_path * cp.sum_squares(self._com - course.com_nominal_m)
            cost += weights.com_step * cp.sum_squares(cp.diff(self._com, axis=0))
        else:
            last = [p for p in course.holds[-1] if course.footholds[p].toe_m is None]
            cost += weights.goal * cp.sum_squares(
                cp.sum(self._toes[last], axis=0)[:2] / len(last) - course.goal_m[:2]
            )
        if not self._solved(
            cp.Problem(cp.Minimize(cost), [*self._shared, *terms]), cp.CLARABEL, clock
        ):
            return None
        toes = _settled(course, choice, np.array(self._toes.value))
        return toes, np.array(self._com.value) if self._body else None

    def _solved(self, problem: cp.Problem, solver: str, clock: Clock, **options: object) -> bool:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of answers that are close to one
            try:
                problem.solve(solver=solver, **options)
            except cp.SolverError as error:
                self.status = f"the solver gave up: {' '.join(str(error).split()):.80}"
                return False
        clock.count(1, float(problem.solver_stats.solve_time or 0.0))
        self.status = (
            "infeasible"
            if problem.status in ("infeasible", "infeasible_inaccurate")
            else problem.status
        )
        return bool(problem.status in ("optimal", "optimal_inaccurate"))


def _sides(patch: Patch) -> tuple[Array, Array]:
    """A patch as half-spaces, its plane from both sides: normals, (F, 3), and offsets, (F,) [m]."""
    axes, origin = patch.frame[:, 1:], patch.centre_m
    flat, offsets = half_planes((patch.vertices_m - origin) @ axes)
    normals = np.vstack([flat @ axes.T, patch.normal, -patch.normal])
    return normals, np.concatenate([offsets, [0.0, 0.0]]) + normals @ origin


def _settled(course: Problem, choice: Index, toes_m: Array) -> Array:
    """The toes drawn onto their surfaces, which solvers leave by their tolerances."""
    toes = toes_m.copy()
    for p, (foothold, regions) in enumerate(zip(course.footholds, course.regions, strict=True)):
        toes[p] = (
            Surface(regions[int(choice[p])], 0.0).nearest(toes_m[p])
            if foothold.toe_m is None
            else foothold.toe_m
        )
    return toes


def _first_yaws(course: Problem) -> tuple[Problem, list[list[int]]]:
    """The course with each surface offered once, and the numbers that its candidates have there."""
    footholds, numbers = list[Foothold](), list[list[int]]()
    for foothold in course.footholds:
        numbers_of_yaw = [
            k
            for k, patch in enumerate(foothold.candidates)
            if all(patch is not other for other in foothold.candidates[:k])
        ]
        yaws = tuple(foothold.yaws_rad[k] for k in numbers_of_yaw) if foothold.yaws_rad else ()
        footholds.append(
            replace(
                foothold,
                candidates=tuple(foothold.candidates[k] for k in numbers_of_yaw),
                yaws_rad=yaws,
            )
        )
        numbers.append(numbers_of_yaw)
    return replace(course, footholds=tuple(footholds)), numbers
