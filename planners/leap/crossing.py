"""Courses with leaps: where no foothold bridges a gap, key frames lead up to it, a leap over it,
and key frames on from where it lands.

The gap is looked for on the straight way: places of the body below which some toe has nothing to
stand on. Every climb is a course of its own, laid out and judged as any other; every leap begins
with the toes and the body where the climb before it ends; every climb after it begins with those
where it lands, as its legs have turned the body.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.certificate import Certificate, Way
from ..answer.motion import Motion
from ..answer.plan import LeapPlan, Plan
from ..equilibrium.programs import programs_of_this_thread
from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array
from ..motion.leap_motion import body_of
from ..problem.contact import CandidatePatches, Foothold
from ..problem.course_between import LaidBetween
from ..problem.leap import BodyState, Leap, LeapLimits, Phase
from ..problem.leap_classes import SPINS
from ..problem.problem import Problem
from ..projection.whole_body import WholeBodyLimits
from ..robot.model import Robot
from ..robot.walker import leaping_robot, no_motors
from ..search.answer import Planner
from ..search.pieces import Standing, course_window
from ..search.plan_course import plan_course
from ..terrain.families import Terrain
from ..terrain.obstacles import Obstacles
from ..terrain.patch import Patch
from ..terrain.polygon import Surface, half_planes
from ..verify.crossings import check_crossing
from .bend import judged_answer
from .finder import LeapFinder, find_leap

_SPACING_M = 0.01
"""Places along the way that are looked at are so far apart [m]."""
_NARROWS_M = (0.1, 0.065)
"""Toes stand so much nearer to the body along the way where it leaps, at most: the first that leaves
room to stand on both sides [m]."""
_LEAST_M = 0.04
"""A climb between two leaps that is shorter is none [m]."""
_FLAT = 0.3
"""Surfaces whose normals are steeper than this are nothing to land on."""
_INTERVALS = (8, 1, 8)
_STANCES_S = (0.5, 0.65)
"""Durations of the stances before and after a flight that are tried [s]."""
_FLIGHTS_M_S = (1.25, 1.17, 1.1)
"""Speeds of flights over a gap that are tried, which say how long they last [m/s]."""
_FLIGHT_S = (0.2, 0.5)
"""Least and greatest duration of a flight [s]."""
_CANDIDATES, _WINDOW_M = 4, 0.16
"""Candidates per toe where a leap lands, and how wide each is [m]."""
_LANDS_M = 0.1
"""Width of the pieces on which it lands, about where toes like to be: a climb goes on from there [m]."""
_GOAL_M = 0.06
"""A leap ends so near to where the body likes to be over its toes: a climb goes on from there
[m]."""
_LOW = 0.5
"""Least height of the body over its toes, in units of that at which it stands."""
_SAME = 1e-6
"""Largest distance of the corners of a piece from the plane of its surface [m]."""
_SQUARE_M = 0.04
"""Width of the pieces on which a climb ends that a leap follows [m]."""
_SHARES = (0.25, 0.8)
"""Shares of the time that is left, for one climb and for one leap, while more is to come."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """Places along a straight way where a robot can stand.

    Arguments:
        start_m, direction: start and direction of the way in the plane, shape (2,) each.
        spans_m: where each stretch begins and ends along it, shape (S, 2) [m].
        length_m: length of the way [m].
    """

    start_m: Array
    direction: Array
    spans_m: Array
    length_m: float

    def at(self, along_m: float) -> Array:
        """Place so far along the way, shape (2,) [m]."""
        return np.asarray(self.start_m + along_m * self.direction)


def stretches(terrain: Terrain, toes_m: Array, ends_m: Array) -> Stretches | None:
    """Stretches of the straight way on which every toe has something to stand on; None unless the
    way begins and ends on one, or where it is short of a gap.

    Arguments:
        toes_m: vectors from the body to its toes, shape (N, 3) [m].
        ends_m: start and goal, shape (2, 2) [m].
    """
    way = ends_m[1] - ends_m[0]
    length = float(np.linalg.norm(way))
    if length < _SPACING_M:
        return None
    direction = way / length
    along = np.linspace(0.0, length, int(np.ceil(length / _SPACING_M)) + 1)
    places = ends_m[0] + along[:, None, None] * direction + toes_m[:, :2]
    stands = np.isfinite(_heights(terrain, places)).all(axis=1)
    padded = np.concatenate([[False], stands, [False]])
    begins = np.flatnonzero(~padded[:-1] & padded[1:])
    ends = np.flatnonzero(padded[:-1] & ~padded[1:]) - 1
    if len(begins) < 2 or begins[0] > 0 or ends[-1] < len(along) - 1:
        return None
    spans = np.column_stack([along[begins], along[ends]])
    return Stretches(start_m=ends_m[0], direction=direction, spans_m=spans, length_m=length)


def drawn_in(toes_m: Array, way_m: Array, narrow_m: float) -> Array:
    """Toes nearer to the body along a way, by half of how far they are from it at most.

    Arguments:
        toes_m: vectors from the body to its toes, shape (N, 3) [m].
        way_m: from start to goal, shape (2,) [m].
        narrow_m: by how much [m].
    """
    direction = np.append(way_m, 0.0) / max(float(np.linalg.norm(way_m)), _SPACING_M)
    ahead = toes_m @ direction
    shift_m = np.sign(ahead) * np.minimum(narrow_m, 0.5 * np.abs(ahead))
    return np.asarray(toes_m - shift_m[:, None] * direction)


def _stands(question: LaidBetween, way: Stretches) -> bool:
    """Tell whether there is room for the robot where each stretch before a gap ends."""
    try:
        for end in way.spans_m[:-1, 1]:
            replace(question, goal_m=tuple(way.at(end).tolist()), frames=None)("inner")
    except (InvalidInput, PlanningFailed):
        return False
    return True


def cross(
    question: LaidBetween,
    planner: Planner,
    *,
    robot: Robot | str,
    refusal: str,
    proof: Certificate | None = None,
    limits: WholeBodyLimits = WholeBodyLimits(),
    deadline: float = np.inf,
) -> Answer[Plan] | Answer[Motion[Way]] | None:
    """Cross a course with leaps where key frames alone do not; None where no gap is in the way, or
    the robot has nothing to leap with.

    Arguments:
        question: the course between two places.
        planner: of contacts of key frames.
        robot: whose legs are known.
        refusal: what key frames alone came to.
        proof: that no balanced motion crosses it, where there is one.
        limits: of joints and bodies of climbs.
        deadline: when the answer is wanted (``time.perf_counter()``).

    Returns:
        Feasible with a motion of ``parts`` that ``check_crossing`` accepted; undecided with the part that
        has no plan in its message; or the answer of key frames straight ahead, where they have a
        plan after all.
    """
    leaper = leaping_robot(robot)
    if not leaper.own or any(limb.sole_m is not None for limb in leaper.limbs):
        return None
    model = leaper.own_model()
    terrain = question.terrain.along(np.array([question.goal_m]), Path())
    feet = np.array([leg.chain.feet(leg.stance_rad[None])[0] for leg in model.legs])
    radii = np.array([leg.radius_m for leg in model.legs])
    toes = feet - model.com_m - np.array([0.0, 0.0, 1.0]) * radii[:, None]
    ends = np.array([question.start_m, question.goal_m])
    tries = [drawn_in(toes, ends[1] - ends[0], narrow_m) for narrow_m in _NARROWS_M]
    ways = [stretches(terrain, narrow, ends) for narrow in tries]
    number = next((k for k, each in enumerate(ways) if each and _stands(question, each)), -1)
    if (way := ways[number]) is None:
        return None
    if unlimited := no_motors(model):
        return Answer(
            status=Status.UNDECIDED,
            method=planner.name,
            message=f"{refusal}; a leap over it: robot {leaper.name}: {unlimited}",
        )
    return _Crossing(
        question=question,
        planner=planner,
        limits=limits,
        finder=LeapFinder(solves=50, proof=0),
        deadline=deadline,
        leaper=leaper,
        toes_m=tries[number],
        terrain=terrain,
        way=way,
        refusal=refusal,
        proof=proof,
    ).answer()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Crossing:
    """One course with gaps."""

    question: LaidBetween
    planner: Planner
    limits: WholeBodyLimits
    finder: LeapFinder
    deadline: float
    leaper: Robot
    toes_m: Array
    terrain: Terrain
    way: Stretches
    refusal: str
    proof: Certificate | None

    def answer(self) -> Answer[Plan] | Answer[Motion[Way]]:
        """The crossing, or why there is none."""
        begin = time.perf_counter()
        straight = self._straight()
        if straight is not None and straight.status is Status.FEASIBLE:
            return straight
        parts, why = list[Motion[Any]](), ""
        solves = tries = 0
        for part in self._parts():
            if isinstance(part, str):
                why = part
                break
            answer, effort = part
            solves, tries = solves + effort.solves, tries + effort.tries
            parts.append(answer)
        effort = Effort(solves=solves, tries=tries, seconds=time.perf_counter() - begin)
        problem = None if straight is None else straight.problem
        if why:
            return Answer(
                status=Status.UNDECIDED,
                method=self.planner.name,
                problem=problem,
                effort=effort,
                message=f"key frames alone: {self.refusal}; with leaps: {why}",
            )
        course = parts[0].problem
        way = Way(
            name=course.name,
            course=course,
            goal_m=np.array(self.question.goal_m),
            refusal=self.refusal,
            certificate=self.proof,
        )
        crossing = Motion(problem=way, parts=tuple(parts))
        report = check_crossing(crossing)
        return Answer(
            status=Status.FEASIBLE if report.accepted else Status.UNDECIDED,
            method=self.planner.name,
            problem=problem,
            solution=crossing,
            report=report,
            residual=report.worst,
            effort=effort,
            message="" if report.accepted else report.message,
        )

    def _straight(self) -> Answer[Plan] | None:
        """Answer of key frames straight ahead; None where they are not laid out."""
        question = replace(self.question, straight=True)
        try:
            return plan_course(
                question, self.planner, limits=self.limits, deadline=self._until(_SHARES[0])
            )
        except (InvalidInput, PlanningFailed):
            return None

    def _until(self, share: float) -> float:
        """When a part is wanted."""
        now = time.perf_counter()
        return now + share * max(self.deadline - now, 0.0)

    def _parts(self) -> Iterator[tuple[Plan | LeapPlan, Effort] | str]:
        """The plans of all parts in order, or why one has none."""
        spans = self.way.spans_m
        standing: Standing | None = None
        for k, (begin, end) in enumerate(spans):
            last = k == len(spans) - 1
            if standing is not None:
                begin = float((standing.com_m[:2] - self.way.start_m) @ self.way.direction)
            if standing is None or abs(end - begin) > _LEAST_M:
                where = f"the climb from {begin:.2f} to {end:.2f} m along the way"
                climbed: tuple[Plan, Effort] | str = ""
                for square in (True, False)[last:]:
                    climbed = self._climb(standing, end, 1.0 if last else _SHARES[0], square=square)
                    if not isinstance(climbed, str):
                        break
                if isinstance(climbed, str):
                    yield f"{where}: {climbed}"
                    return
                plan, effort = climbed
                standing = Standing.at_end(plan)
                yield plan, effort
            if last:
                return
            leapt = self._leap(standing, float(end), float(spans[k + 1, 0]))
            if isinstance(leapt, str):
                yield (
                    f"the leap over the gap at {end:.2f} m, of {spans[k + 1, 0] - end:.2f} m from "
                    f"place to place of the body: {leapt}"
                )
                return
            leap, effort = leapt
            standing = landed(leap)
            yield leap, effort

    def _climb(
        self, standing: Standing | None, end_m: float, share: float, *, square: bool
    ) -> tuple[Plan, Effort] | str:
        """The plan of key frames from where the robot stands, or from the start.

        Arguments:
            square: it is to end with its toes where they like to be for a leap.
        """
        goal = tuple(self.way.at(end_m).tolist())
        question = replace(self.question, goal_m=goal, frames=None)
        posed: Problem | LaidBetween = question
        try:
            if standing is not None:
                start = tuple(standing.com_m[:2].tolist())
                course = replace(question, start_m=start, straight=True)("inner")
                posed = course_window(course, 0, course.frames - 1, standing)
            if square:
                straight = question("inner") if standing is None else posed
                assert isinstance(straight, Problem)
                posed = self._squared(straight, end_m)
            answer = plan_course(
                posed,
                self.planner,
                limits=self.limits,
                start_rad=None if standing is None else standing.angles_rad,
                stated=False,
                deadline=self._until(share),
            )
        except (InvalidInput, PlanningFailed) as error:
            return str(error)
        if answer.status is not Status.FEASIBLE or answer.solution is None:
            return answer.message or answer.claim or answer.status.value
        return answer.solution, answer.effort

    def _leap(
        self, standing: Standing, from_m: float, to_m: float
    ) -> tuple[LeapPlan, Effort] | str:
        """The leap from where the robot stands to a place along the way, judged with its legs."""
        why = "no timing"
        obstacles = Obstacles.of(self.terrain.patches)
        timings = self._timings(to_m - from_m)
        until = self._until(_SHARES[1])
        for k, timing in enumerate(timings):
            leap = self.leap_from(standing, to_m, timing)
            if isinstance(leap, str):
                return leap
            now = time.perf_counter()
            share = now + 0.5 * (until - now) if k + 1 < len(timings) else until
            answer = find_leap(leap, self.finder, time_limit_s=max(share - now, 0.0))
            if answer.solution is not None:
                answer = judged_answer(
                    answer, programs_of_this_thread(), deadline=share, obstacles=obstacles
                )
            if answer.status is Status.FEASIBLE and answer.solution is not None:
                return answer.solution, answer.effort
            why = f"undecided: {answer.message}"
            if time.perf_counter() > until:
                break
        return why

    def _timings(self, far_m: float) -> list[tuple[float, float, float]]:
        """Durations of the phases of a leap so far, the likeliest first [s]."""
        gap = max(far_m, 0.1)
        flights = [float(np.clip(gap / (2.0 * v), *_FLIGHT_S)) for v in _FLIGHTS_M_S]
        return [(s, round(t, 3), s) for s in _STANCES_S for t in flights]

    def leap_from(
        self, standing: Standing, to_m: float, timing: tuple[float, float, float]
    ) -> Leap | str:
        """The leap from where a robot stands to a place along the way, or why there is none."""
        robot = self.leaper
        height = float((standing.com_m[2] - standing.toes_m[:, 2]).mean())
        place = self.way.at(to_m)
        surfaces = CandidatePatches(self.terrain, 0.0)
        wanted, ground = self._wanted(to_m)
        if not np.isfinite(ground).all():
            return "no foothold for some toe where it lands"
        goal = np.array([*place, float(ground.mean()) + height])
        footholds = [
            Foothold(
                limb=limb.name, frame=0, candidates=(surface_of(self.terrain, patch),), toe_m=toe
            )
            for limb, toe, patch in zip(robot.limbs, standing.toes_m, standing.patches, strict=True)
        ]
        for limb, xy, z in zip(robot.limbs, wanted, ground, strict=True):
            toe = np.array([*xy, z])
            candidates = self._near(toe, _LANDS_M)
            if not candidates:
                pieces = surfaces.candidates(
                    limb, goal + limb.shoulder_m, toe, _CANDIDATES, _WINDOW_M
                )
                candidates = tuple(piece for _, piece in pieces)
            if not candidates:
                return f"no foothold for {limb.name} where it lands"
            footholds.append(Foothold(limb=limb.name, frame=2, candidates=candidates))
        names = robot.limb_names
        stances = [Phase(limbs=names, intervals=n) for n in (_INTERVALS[0], _INTERVALS[2])]
        return Leap(
            name=f"leap over {Path(self.question.terrain.file).name}",
            robot=robot,
            phases=(stances[0], Phase(limbs=(), intervals=_INTERVALS[1]), stances[1]),
            timings_s=(timing,),
            footholds=tuple(footholds),
            start=BodyState(com_m=standing.com_m, rotation_rad=standing.rotation_rad),
            goal=BodyState(com_m=goal),
            goal_radius_m=_GOAL_M,
            limits=LeapLimits(momentum_m2_s=SPINS * height**2, height_m=_LOW * height),
        )

    def _wanted(self, along_m: float) -> tuple[Array, Array]:
        """Places of the toes from which a robot leaps, or on which it lands, shape (N, 2) [m], and
        the heights there, shape (N,) [m].
        """
        wanted = self.way.at(along_m) + self.toes_m[:, :2]
        return wanted, _heights(self.terrain, wanted)

    def _squared(self, course: Problem, end_m: float) -> Problem:
        """The course whose last foothold of every limb is a small piece about where its toe likes
        to be for a leap: bodies roll that push off with feet anywhere.
        """
        wanted, heights = self._wanted(end_m)
        names, last = course.robot.limb_names, dict[str, int]()
        for j, foothold in enumerate(course.footholds):
            last[foothold.limb] = j
        footholds = list(course.footholds)
        for limb, xy, z in zip(names, wanted, heights, strict=True):
            j, place = last[limb], np.array([*xy, z])
            if footholds[j].frame == 0 and footholds[j].toe_m is not None:
                continue
            near = self._near(place, _SQUARE_M)
            if near:
                footholds[j] = replace(footholds[j], candidates=near[:_CANDIDATES])
        return replace(course, footholds=tuple(footholds))

    def _near(self, place_m: Array, width_m: float) -> tuple[Patch, ...]:
        """Pieces of surfaces about a place, so wide."""
        surfaces = (Surface(patch, 0.0) for _, patch in self.terrain.standing)
        pieces = (surface.window(place_m, width_m) for surface in surfaces)
        return tuple(
            piece
            for piece in pieces
            if piece is not None
            and np.linalg.norm(piece.vertices_m.mean(axis=0) - place_m) < width_m
        )[:_CANDIDATES]


def _heights(terrain: Terrain, places_m: Array) -> Array:
    """Height of the highest surface to stand on at places, shape (…, 2); −inf where there is
    none.
    """
    heights = np.full(places_m.shape[:-1], -np.inf)
    for _, patch in terrain.standing:
        if patch.normal[2] < _FLAT:
            continue
        normals, offsets = half_planes(patch.vertices_m[:, :2])
        within = np.all(places_m @ normals.T <= offsets + 1e-9, axis=-1)
        heights = np.where(within, np.maximum(heights, patch.heights_at(places_m)), heights)
    return heights


def surface_of(terrain: Terrain, piece: Patch) -> Patch:
    """The whole surface that a patch was cut from, or the patch itself where no surface holds it.
    Feet roll as they push, some of them beyond the borders that planners draw about a toe.
    """
    within = piece.centre_m + (1.0 - _SAME) * (piece.vertices_m - piece.centre_m)
    for _, patch in terrain.standing:
        surface = Surface(patch, 0.0)
        level = all(abs(surface.height(corner)) < _SAME for corner in within)
        if level and patch.friction == piece.friction and all(map(surface.covers, within)):
            return patch
    return piece


def landed(plan: LeapPlan) -> Standing:
    """Pose of a robot where it has landed, its body turned as its legs turn it."""
    body, leap = body_of(plan), plan.problem
    last = leap.holds[-1]
    return Standing(
        com_m=plan.com_m[-1],
        rotation_rad=body.rotation_rad[-1],
        toes_m=plan.toes_m[last],
        patches=tuple(leap.patch(int(j), plan.choice) for j in last),
        angles_rad=body.postures.angles[-1],
    )
