"""The middle of what a posture may do with its toes held: one strictly convex program, for a batch
at once.

With the toes held c, Θ and f form a convex set (``terms.Moments``). Its analytic centre

    minimise  −Σ log(ρ_i² − ‖u_i‖²) − log(r² − ‖c − c_0‖²) − Σ log(tilt² − Θ_k²)
              −Σ log(μ_i² f_n² − f_y² − f_z²) − Σ log(f − f_min) − Σ log(f_max − f)
    subject to (E5), (E6)

is unique and depends on the toes and the problem alone, not on the point that it is sought from.
Newton's method finds it to rounding, in numpy, problem by problem the same whatever the batch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.layout import Fill, Index
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled, skew
from ..equilibrium.terms import Given
from ..errors import check_time
from ..files.arrays import Array, cross
from ..motion.joints import STRAY_M, JointPath, joints_along, key_postures
from ..motion.path import LIFT_M, PathMoments, PlanPath, path_of
from ..problem import Problem
from ..robot.bodies import Bodies
from ..robot.inverse_kinematics import Near, WholeBody, descend
from ..robot.kinematics import Kinematics
from ..robot.leg import rotations_of, turning
from ..terrain.obstacles import Obstacles
from ..terrain.patch import Patch
from ..terrain.polygon import clipped, half_planes

if TYPE_CHECKING:
    from scipy.sparse import csr_array


APART_M = 0.03
"""Moments are looked at so far apart: a third of those that are judged."""
_FARTHER_M = 0.01
"""A leg that could not follow its foot's path so much farther from its hip, or nearer to it, is near the
end of its reach [m]."""
NEAR_M = 0.02
"""Beyond what they should keep, bodies farther apart than this are not looked at."""
CLEAR_PRICE = 20.0
"""Price of what is missing to a distance at one moment, in the length scale, in units of the
objective."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearness:
    """K pairs of bodies that are near at some moment of a path, and feet that stay from it.

    Arguments:
        distance_m: shape (K,), negative inside; of a foot how far it stays, negative, or how much
            farther it would follow, beyond what bodies should keep.
        feet: which are those of feet, for which half as much is enough, shape (K,).
        slopes: of the distances, in metres a metre or radian, in the numbers of M key frames and P
            toes, laid end to end: c (M, 3) [m], Θ (M, 3), q (M, J), p (P, 3) [m].
        astray_m: how far feet stay from their path.
    """

    distance_m: Array
    feet: NDArray[np.bool_]
    slopes: csr_array
    astray_m: float

    def within(self, clearance_m: float, rooms_m: Array) -> Nearness:
        """Select those that may come nearer than this where no number changes by more than these
        amounts.
        """
        near = np.flatnonzero(self.distance_m - abs(self.slopes) @ rooms_m < clearance_m)
        chosen = {name: getattr(self, name)[near] for name in ("distance_m", "feet", "slopes")}
        return replace(self, **chosen)

    def moved(self, at: Given, point: Point, turned_rad: Array) -> Nearness:
        """The same about another point, with joints that are turned so far, shape (M, J), to first
        order.
        """
        length_m, held = at.scaled.length_m, at.held
        changes = (
            length_m * (point.com - held.com),
            point.rotation - held.rotation,
            turned_rad,
            length_m * (point.toes - held.toes),
        )
        change = np.concatenate([each.ravel() for each in changes])
        return replace(self, distance_m=self.distance_m + self.slopes @ change)

    def missing(self, clearance_m: float) -> Array:
        """Shortfall of a distance, shape (K,) [m]."""
        enough_m = np.where(self.feet, 0.5, 1.0) * clearance_m
        return np.asarray(np.maximum(enough_m - self.distance_m, 0.0))


class PathClearance:
    """Looks along the paths of plans over one course, each of which raises TimeEnded after the
    deadline (``time.perf_counter()``). Raises InvalidInput without coal, as ``Bodies`` does.
    """

    def __init__(self, plan: Plan, solver: Kinematics, deadline: float = math.inf) -> None:
        self._solver, self._deadline = solver, deadline
        self._bodies = Bodies(solver, Obstacles.of(plan.problem.terrain))
        feet = {leg.foot: i for i, leg in enumerate(solver.model.legs)}
        self._no_balls = {
            k: feet[shape.link]
            for k, (shape, _) in enumerate(solver.model.link_shapes[0])
            if shape.link in feet and shape.kind != "sphere"
        }
        """Legs by the number of a shape of their feet that is no ball."""

    def nearness(
        self, plan: Plan, clearance_m: float, apart_m: float = APART_M, *, reaching: bool = False
    ) -> Nearness:
        """Find the bodies that are nearer than that and a little more, at moments this far apart:
        of every pair of bodies where it is nearest, and wherever it is too near; and the feet that
        stay from their paths, or, where that is asked for, of legs that are near the ends of their reach.
        """
        path = JointPath(path_of(plan), self._solver, apart_m)
        moments, postures = _with_keys(
            path.path, *path.judged(turn_rad=np.inf, deadline=self._deadline)
        )
        check_time(self._deadline)
        loose = replace(
            postures, stands=np.ones_like(postures.stands)
        )  # feet lift off what they stand on
        near = [
            (t, each)
            for t, each in self._bodies.near(loose, clearance_m + NEAR_M)
            if not self._touches(each, postures.toes_m[t])
        ]
        near = _nearest(near, clearance_m)
        mounts = [self._solver.model.mounts[link] for link in self._bodies.links]
        carriers = np.array(
            [(-1 if of.leg is None else of.leg, of.joint) for of in mounts] + [(-2, 0)]
        )
        slopes, times = (
            _Slopes(path, self._solver, moments, postures),
            np.array([t for t, _ in near], dtype=int),
        )
        for side, sign in ((0, 1.0), (1, -1.0)):
            shapes = np.array([(each.shape, each.other)[side] for _, each in near], dtype=int)
            movers, rows = (
                carriers[shapes],
                np.arange(len(near)),
            )  # −1, the terrain, is the last one
            points = np.array([each.points_m[side] for _, each in near]).reshape(-1, 3)
            push = sign * np.array([each.normal for _, each in near]).reshape(-1, 3)
            for leg in range(-1, len(self._solver.model.legs)):
                of = np.flatnonzero(movers[:, 0] == leg)
                slopes.add(leg, rows[of], times[of], movers[of, 1], points[of], push[of])
        ends = _ends_of_reach(self._solver, moments, postures, reaching * _FARTHER_M)
        for row, (t, leg, _, out) in enumerate(ends, len(near)):
            slopes.add_foot(leg, np.array([row]), np.array([t]), out)
        assert postures.error_m is not None
        rooms = [0.5 * reaching * clearance_m + room for _, _, room, _ in ends]
        return Nearness(
            distance_m=np.array([*(each.distance_m for _, each in near), *rooms]),
            feet=np.repeat([False, reaching], [len(near), len(ends)]),
            slopes=slopes.matrix(len(near) + len(ends)),
            astray_m=float(postures.error_m.max()),
        )

    def _touches(self, near: Near, toes_m: Array) -> bool:
        """Tell whether that is where a foot that is no ball meets what it stands on."""
        leg = self._no_balls.get(near.shape)
        if leg is None or near.other >= 0:
            return False
        away_m = np.linalg.norm(near.points_m[1] - toes_m[leg])
        return bool(away_m < self._solver.radii_m[leg])  # what the foot stands on


def _nearest(near: list[tuple[int, Near]], clearance_m: float) -> list[tuple[int, Near]]:
    """Select those that are too near, and of every two bodies those moments at which they are no
    farther than before and after.
    """
    nearest, runs = list[tuple[int, Near]](), dict[tuple[int, int, str], list[tuple[int, Near]]]()
    for t, each in near:
        runs.setdefault((each.shape, each.other, each.name), []).append((t, each))
    for run in runs.values():
        distance = np.array([np.inf, *(each.distance_m for _, each in run), np.inf])
        least = (distance[1:-1] <= distance[:-2]) & (distance[1:-1] <= distance[2:])
        nearest += [run[k] for k in np.flatnonzero(least | (distance[1:-1] < clearance_m))]
    return sorted(nearest, key=lambda each: each[0])


def _ends_of_reach(
    solver: Kinematics, moments: PathMoments, postures: WholeBody, most_m: float
) -> list[tuple[int, int, float, Array]]:
    """Moment of every step at which each limb is nearest to the end of its reach, if it is near; the
    limb, how much farther its foot would follow, negative where it stays from its path [m], and the
    direction from the foot to where it does not get, in the world.
    """
    ends = dict[tuple[int, int], tuple[int, int, float, Array]]()
    assert postures.error_m is not None
    for limb, leg in enumerate(solver.model.legs):
        angles, turns = postures.angles[:, solver.joints_of(limb)], postures.rotation
        feet, hips = leg.chain.feet(angles), leg.chain.frames(angles)[1][:, 0]
        goals = np.einsum("tij,ti->tj", turns, moments.feet_m[:, limb] - postures.origin_m)
        away = (feet - hips) / np.linalg.norm(feet - hips, axis=1, keepdims=True)
        up = np.einsum("tij,ti->tj", turns, moments.ups[:, limb])
        error_m = postures.error_m[:, limb]
        for farther_m in (0.0, most_m, -most_m):
            goal, there, room = goals, feet, -error_m
            if farther_m:
                goal = feet + farther_m * away
                there = leg.chain.feet(descend(leg, goal, angles, up)[0])
            missed = np.linalg.norm(goal - there, axis=1)
            out = (goal - there) / np.maximum(missed, STRAY_M)[:, None]
            if farther_m:
                room = np.maximum(np.vecdot(out, there - feet), 0.0)
            of = (missed > STRAY_M) & ((error_m > STRAY_M) == (not farther_m))
            for t in np.flatnonzero(of).tolist():
                key = int(moments.step[t]), limb
                if key not in ends or room[t] < ends[key][2]:
                    ends[key] = t, limb, float(room[t]), turns[t] @ out[t]
    return list(ends.values())


def keep_clear(
    rows: Rows[Any], columns: Sequence[Index | None], at: Given, near: Nearness, clearance_m: float
) -> None:
    """Rows d + S (x − x̄) ≥ clearance − slack, in the length scale; what is missing costs.

    Arguments:
        columns: of c, Θ, of the steps of the joints and of p (None where they are held), as
            ``Nearness.slopes`` has them.
    """
    length_m, held = at.scaled.length_m, at.held
    slack, clear = (
        rows.variable("slack", len(near.distance_m)),
        rows.at_most("clear", len(near.distance_m)),
    )
    bars = (
        held.com,
        held.rotation,
        np.zeros(0 if columns[2] is None else columns[2].shape),
        held.toes,
    )
    right, begin = (near.distance_m - clearance_m) / length_m, 0
    for numbers, bar, unit in zip(columns, bars, (1.0, length_m, length_m, 1.0), strict=True):
        part = near.slopes[:, begin : begin + bar.size].tocoo()
        begin += bar.size
        if numbers is not None:
            rows.put(clear[part.row], numbers.ravel()[part.col], _constant(-part.data / unit))
            right = right - (part @ bar.ravel()) / unit
    rows.put(clear, slack, -1.0)
    rows.right(clear, _constant(right))
    rows.put(rows.at_most("no_less", len(near.distance_m)), slack, -1.0)
    rows.linear(slack, CLEAR_PRICE)


def _constant(values: Array) -> Fill[Any]:
    return lambda _: values


def _with_keys(
    path: PlanPath, moments: PathMoments, postures: WholeBody
) -> tuple[PathMoments, WholeBody]:
    """And the key frames as they are drawn, behind them."""
    plan = path.plan
    assert plan.joints_rad is not None
    keys = path.at([(path.standing(k), np.ones(1)) for k in range(plan.problem.frames)])
    return _joined(moments, keys), _joined(postures, key_postures(plan, plan.joints_rad))


J = TypeVar("J", PathMoments, WholeBody)


def _joined(one: J, other: J) -> J:
    names = [item.name for item in fields(one)]
    return replace(
        one, **{name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in names}
    )


class _Slopes:
    """Collects what distances change by.

    Arguments:
        moments and postures: all that are looked at.
    """

    def __init__(
        self, path: JointPath, solver: Kinematics, moments: PathMoments, postures: WholeBody
    ) -> None:
        self._path, self._solver, self._moments, self._postures = path, solver, moments, postures
        plan = path.path.plan
        self._shares = np.stack([1.0 - moments.share, moments.share], axis=1)
        self._frames = np.stack([moments.before, moments.after], axis=1)
        self._turns = turning(moments.rotation_rad)
        self._sizes = [
            plan.com_m.size,
            plan.rotation_rad.size,
            plan.problem.frames * len(solver.joints),
        ]
        self._width = sum(self._sizes) + plan.toes_m.size
        self._rows, self._columns, self._values = list[Index](), list[Index](), list[Array]()

    def matrix(self, count: int) -> csr_array:
        """The slopes of so many distances."""
        from scipy.sparse import coo_array, csr_array  # slow to import

        if not self._rows:
            return csr_array((count, self._width))
        rows, columns, values = (
            np.concatenate(part) for part in (self._rows, self._columns, self._values)
        )
        return coo_array((values, (rows, columns)), shape=(count, self._width)).tocsr()

    def add(
        self, leg: int, rows: Index, times: Index, joints: Index, points: Array, push: Array
    ) -> None:
        """Points of a leg, moved along by its first joints up to these, or of the body (leg −1),
        pushed this way.
        """
        if not len(rows):
            return
        held, feet = np.zeros_like(push), points
        if leg >= 0:
            held, feet = self._leg(leg, rows, times, joints, points, push)
        by_turn = cross(points - self._moments.com_m[times], push) - cross(
            feet - self._moments.com_m[times], held
        )
        self._body(0, rows, times, push - held)
        self._body(
            self._sizes[0], rows, times, np.einsum("ki,kij->kj", by_turn, self._turns[times])
        )

    def add_foot(self, leg: int, rows: Index, times: Index, push: Array) -> None:
        """A leg's foot that stays from its path, or nearly does, this way: less where the body goes
        to its place, or its place to the body.
        """
        moments, postures = self._moments, self._postures
        joints, chain = self._solver.joints_of(leg), self._solver.model.legs[leg].chain
        feet = chain.feet(postures.angles[np.ix_(times, joints)])
        feet = postures.origin_m[times] + np.einsum("kij,kj->ki", postures.rotation[times], feet)
        push = push[None]
        by_turn = cross(feet - moments.com_m[times], push)
        self._body(0, rows, times, push)
        self._body(
            self._sizes[0], rows, times, np.einsum("ki,kij->kj", by_turn, self._turns[times])
        )
        self._toes(leg, rows, times, -push)

    def _leg(
        self, leg: int, rows: Index, times: Index, joints: Index, points: Array, push: Array
    ) -> tuple[Array, Array]:
        """The part of the joints and the toes; what holds the foot, and where the foot is, shapes
        (K, 3).
        """
        columns_of_leg, chain = self._solver.joints_of(leg), self._solver.model.legs[leg].chain
        rotations, origins = self._postures.rotation[times], self._postures.origin_m[times]
        turns, places = chain.frames(self._postures.angles[np.ix_(times, columns_of_leg)])
        axes = np.einsum("kij,knj->kni", rotations, np.einsum("knij,nj->kni", turns, chain.axes))
        places = origins[:, None] + np.einsum("kij,knj->kni", rotations, places)
        feet = self._moments.feet_m[times, leg]
        slides = chain.slides[:, None]
        of_foot = np.where(slides, axes, cross(axes, feet[:, None] - places))
        of_point = np.where(slides, axes, cross(axes, points[:, None] - places))
        of_point = of_point * (np.arange(len(columns_of_leg)) <= joints[:, None])[..., None]
        pulled = np.einsum("knj,kj->kn", of_point, push)
        inverse = np.linalg.pinv(of_foot)  # (K, 3, n): of J transposed
        held = np.einsum("kjn,kn->kj", inverse, pulled)
        free = pulled - np.einsum("knj,kj->kn", of_foot, held)
        corners, steps = self._path.corners, self._moments.step[times]
        bent = [(int(step), leg) in corners for step in steps] & (self._moments.part[times] >= 0)
        free = np.where(np.asarray(bent)[:, None], 0.0, free)
        count = len(self._solver.joints)
        for end in range(2):
            columns = (
                sum(self._sizes[:2]) + count * self._frames[times, end][:, None] + columns_of_leg
            )
            self._put(rows, columns, self._shares[times, end][:, None] * free)
        self._toes(leg, rows, times, held)
        return held, feet

    def _toes(self, leg: int, rows: Index, times: Index, held: Array) -> None:
        """A foot goes with the toe that it stands on, leaves or comes to."""
        moments, holds = self._moments, np.asarray(self._path.path.plan.problem.holds)
        step, part, passed = moments.step[times], moments.part[times], moments.passed[times]
        old = holds[np.maximum(step - 1, 0), leg]
        new = np.where(
            moments.foothold[times, leg] >= 0, moments.foothold[times, leg], holds[step, leg]
        )
        old = np.where(moments.foothold[times, leg] >= 0, new, old)
        share = np.where(part == 0, 0.0, np.where(part == 1, passed, 1.0))
        for foothold, weight in ((old, 1.0 - share), (new, share)):
            self._put(
                rows,
                sum(self._sizes) + 3 * foothold[:, None] + np.arange(3),
                weight[:, None] * held,
            )

    def _body(self, begin: int, rows: Index, times: Index, values: Array) -> None:
        for end in range(2):
            columns = begin + 3 * self._frames[times, end][:, None] + np.arange(3)
            self._put(rows, columns, self._shares[times, end][:, None] * values)

    def _put(self, rows: Index, columns: Index, values: Array) -> None:
        rows = np.broadcast_to(rows[:, None], values.shape)
        self._rows.append(rows.ravel())
        self._columns.append(np.broadcast_to(columns, values.shape).ravel())
        self._values.append(values.ravel())


_STEEP = 0.5
"""Surfaces whose normals rise less are walls (60°)."""
_SHARES = np.linspace(0.0, 1.0, 12)[:, None]
"""Points of a link, as shares of its length."""
_THICK = 1.5
"""Half the thickness of a link, in radii of its foot."""
_LEFT_M = 0.01
"""So much of a toe's only patch is left [m]."""


def walls_of(course: Problem) -> list[Patch]:
    """The surfaces of a course's terrain not stood on as on ground."""
    return [patch for patch in course.terrain if abs(patch.normal[2]) < _STEEP]


def with_room_for_legs(course: Problem, plan: Plan, clearance_m: float) -> Problem:
    """The course whose toes keep so far from walls that the legs of a plan over it would be clear;
    the course itself where no foothold is left to change.

    A leg stands before a wall with unit normal n, lifts off there or comes down, and a point x of it
    is behind the wall, where its links would have to be farther out by d = room − n · (x − c), with c
    on the wall and room half the thickness of a link. The knee goes with the toe p, so that
    n · p ≥ n · p̄ + d is asked of the next search for contacts: a half-plane of the patch that the toe
    stands on. It is no proof: the body is where that plan had it.

    Arguments:
        plan: over the course.
        clearance_m: distance that links are to keep [m].
    """
    if plan.joints_rad is None:
        return course
    points, owner = _legs(plan)
    rooms_m = _THICK * course.robot.foot_radii_m + clearance_m
    cuts, footholds = dict[int, list[Array]](), list(course.footholds)
    for wall in walls_of(course):
        axes, low_m = wall.frame[:, 1:], wall.vertices_m[:, 2].min() - rooms_m.max()
        normals, offsets = half_planes((wall.vertices_m - wall.centre_m) @ axes)
        about = points - wall.centre_m
        away = about @ wall.normal
        near = np.flatnonzero((away.min(axis=2) < rooms_m).any(axis=1))
        behind = np.all(about[near] @ axes @ normals.T <= offsets, axis=3)
        short_m = np.where(behind, rooms_m[:, None] - away[near], 0.0).max(axis=2)
        short_m *= away[near][:, :, -1] > 0.0  # of feet that are before it
        for p in np.unique(owner[near][short_m > 0.0]).tolist():
            toe, up = plan.toes_m[p], plan.problem.patch(p, plan.choice).normal
            before = toe[2] > low_m and wall.normal @ (toe - wall.centre_m) > 0.0
            if before and abs(wall.normal @ up) < _STEEP:
                cuts.setdefault(p, []).append(short_m[owner[near] == p].max() * wall.normal)
    for p, moves in cuts.items():
        patch, candidates = plan.problem.patch(p, plan.choice), footholds[p].candidates
        candidates = _without(candidates, patch, plan.toes_m[p], np.array(moves))
        footholds[p] = replace(footholds[p], candidates=candidates)
    if [each.candidates for each in footholds] == [each.candidates for each in course.footholds]:
        return course
    return replace(course, footholds=tuple(footholds))


def _without(
    candidates: tuple[Patch, ...], patch: Patch, toe: Array, moves: Array
) -> tuple[Patch, ...]:
    """The candidates of a toe, of which one is cut so that it moves out of walls: that one is left
    out where nothing is left of it and there are others, and cut as far as it goes where there are
    none.

    Arguments:
        moves: by which it has to move along their normals, shape (K, 3) [m].
    """
    flat, far = patch.frame[:, 1:], np.vecdot(moves, moves)
    along, corners = moves @ flat, (patch.vertices_m - toe) @ flat
    if len(candidates) == 1:
        spare = _LEFT_M * np.linalg.norm(along, axis=1)
        far = np.minimum(far, (corners @ along.T).max(axis=0) - spare)
    left = clipped(corners, -along, -far)
    cut = (patch.with_vertices(toe + left @ flat.T),) if len(left) else ()
    return (*(each for each in candidates if each is not patch), *cut) or candidates


def _legs(plan: Plan) -> tuple[Array, NDArray[np.int_]]:
    """Points of every leg along the path of a plan, shape (T, N, K, 3) [m], and the foothold that
    it stands on, lifts off or comes down to, shape (T, N).
    """
    solver = Kinematics(plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2)
    moments, at = joints_along(plan, solver)
    chains = np.array([solver.chains(angles) for angles in at.angles])
    ends = at.origin_m[:, None, None] + np.einsum("tij,tnkj->tnki", at.rotation, chains)
    first, last = ends[:, :, :-1, None], ends[:, :, 1:, None]
    points = (first + _SHARES * (last - first)).reshape(*ends.shape[:2], -1, 3)
    comes = (moments.part == 2) | ((moments.part == 1) & (moments.passed > 0.5))
    moved = np.asarray(plan.problem.holds)[np.where(comes, moments.after, moments.before)]
    return points, np.where(moments.foothold >= 0, moments.foothold, moved)


_TRIED_M, _MOST = 0.03, 9
"""Places of a toe that are tried are so far apart, or farther, for at most so many on a patch [m]."""
_STEPS_OF_A_LEG, _EXACT_M = 10, 2e-3
"""Steps that inverse kinematics takes at most, and how near its foot is then enough [m]."""
_FOOT = 2.5
"""Corners of a link that are nearer to its foot's centre, in radii, are its foot."""
_REACHED_M = 0.01
"""A leg that misses its place by more does not get there [m]."""
_ABOUT = 1.5
"""Walls that are so many reaches from where a toe likes to be, or farther, are none of its leg's."""
_EDGE_M = 1e-3
"""So much more than the places on it is left of a patch [m]."""


def at_clear_places(
    course: Problem, com_m: Array, rotation_rad: Array, clearance_m: float
) -> Problem:
    """The course whose toes have near walls those places alone at which legs are clear of them while
    the body goes so.

    Across the nearest wall places of every toe are tried on each of its candidates, with the leg's
    joints found for each at all frames in which it stands, and at the first and the last of them with its
    foot lifted: of a candidate the run of clear places that is nearest to where the toe likes to be is left,
    and one without any goes where there are others. It is no proof: the body may go another way.

    Arguments:
        com_m, rotation_rad: of the body at every frame, shape (M, 3).
        clearance_m: distance that links are to keep [m].
    """
    legs = LegsAtWalls.of(course, com_m, rotation_rad, clearance_m)
    footholds, names = list(course.footholds), course.robot.limb_names
    for p, foothold in enumerate(course.footholds):
        limb = names.index(foothold.limb)
        frames = np.flatnonzero(np.asarray(course.holds)[:, limb] == p)
        left = legs.candidates(foothold.candidates, limb, frames)
        footholds[p] = replace(foothold, candidates=left)
    return replace(course, footholds=tuple(footholds))


@dataclass(frozen=True, kw_only=True, eq=False)
class LegsAtWalls:
    """Legs of a robot whose body goes some way past walls.

    Arguments:
        com_m, origins_m, rotations: of the body and the base's frame at every frame, shape (M, 3),
            (M, 3) and (M, 3, 3).
        toes_m: where toes like to be, from the centre of mass, shape (N, 3).
        angles: of the joints as the robot stands, shape (J,).
        corners: as of ``_corners``.
        rooms_m: distance that every leg's line keeps from walls, shape (N,).
        clearance_m: distance that the corners keep.
    """

    solver: Kinematics
    walls: Sequence[Patch]
    com_m: Array
    origins_m: Array
    rotations: Array
    toes_m: Array
    angles: Array
    corners: list[tuple[Index, Array]]
    rooms_m: Array
    clearance_m: float

    @classmethod
    def of(
        cls, course: Problem, com_m: Array, rotation_rad: Array, clearance_m: float
    ) -> LegsAtWalls:
        """Those of a course."""
        robot, turns = course.robot, rotations_of(rotation_rad)
        solver = Kinematics(robot, gravity_m_s2=course.gravity_m_s2)
        if course.standing_m is not None:
            toes = course.standing_m[0]
        else:
            first = [course.footholds[p].candidates[0].centre_m for p in course.holds[0]]
            toes = np.array(first) - course.com_nominal_m[0]
        return cls(
            solver=solver,
            walls=walls_of(course),
            com_m=com_m,
            origins_m=com_m - turns @ robot.origin_m,
            rotations=turns,
            toes_m=toes,
            angles=solver.solve(np.zeros(3), np.zeros(3), toes)[0],
            corners=_corners(solver),
            rooms_m=_THICK * robot.foot_radii_m + clearance_m,
            clearance_m=clearance_m,
        )

    def candidates(self, patches: tuple[Patch, ...], limb: int, frames: Index) -> tuple[Patch, ...]:
        """What is left of the candidates of a limb that stands through these frames."""
        toe = self.com_m[frames].mean(axis=0) + self.toes_m[limb]
        reach_m = float(self.solver.robot.limbs[limb].reach_m)
        near = [wall for wall in self.walls if _gap_m(wall, toe[:2]) < _ABOUT * reach_m]
        if not near:
            return patches
        wall = min(near, key=lambda each: _gap_m(each, toe))
        along, left = wall.normal[:2] / np.linalg.norm(wall.normal[:2]), list[Patch]()
        for patch in patches:
            places = _across(patch, toe, along)
            if places is None:
                left.append(patch)
                continue
            clear = self._clear(limb, places, patch.normal, frames)
            if clear.any():
                off = np.linalg.norm((places - toe)[:, :2], axis=1)
                nearest = int(np.where(clear, off, np.inf).argmin())
                left.append(_run(patch, places, clear, nearest, np.array([*along, 0.0])))
        return tuple(left) or patches

    def _clear(self, limb: int, places: Array, normal: Array, frames: Index) -> NDArray[np.bool_]:
        """Tell at which places, shape (S, 3), the leg is clear of walls at all these frames, and gets
        its foot up.
        """
        radius = float(self.solver.radii_m[limb])
        feet = np.repeat((places + radius * normal)[:, None], len(frames) + 2, axis=1)
        feet[:, -2:] += LIFT_M * self.solver.robot.size * normal
        meets, away = self._looks(limb, feet, np.append(frames, frames[[0, -1]]))
        stuck = (meets | away)[:, -2:] & ~away[:, [0, -3]]
        return np.asarray(~((meets & ~away)[:, :-2].any(axis=1) | stuck.any(axis=1)))

    def _looks(
        self, limb: int, feet: Array, at: Index
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Tell whether the leg meets a wall at these frames with its feet there, shape (S, T, 3), and
        whether it does not get there; shape (S, T) each.
        """
        origins, turns = self.origins_m[at], self.rotations[at]
        leg, joints = self.solver.model.legs[limb], self.solver.joints_of(limb)
        targets = np.einsum("tij,sti->stj", turns, feet - origins).reshape(-1, 3)
        start = np.tile(self.angles[joints], (len(targets), 1))
        angles, missed = descend(leg, targets, start, steps=_STEPS_OF_A_LEG, exact_m=_EXACT_M)
        axes, places = leg.chain.frames(angles)
        ends = np.concatenate([places, leg.chain.feet(angles)[:, None]], axis=1)
        first, last = ends[:, :-1, None], ends[:, 1:, None]
        lines = (first + _SHARES * (last - first)).reshape(len(ends), -1, 3)[:, :-2]
        joint, corners = self.corners[limb]
        corners = places[:, joint] + np.einsum("tkij,kj->tki", axes[:, joint], corners)
        room = np.repeat([self.rooms_m[limb], self.clearance_m], [lines.shape[1], len(joint)])
        points = np.concatenate([lines, corners], axis=1).reshape(*feet.shape[:2], -1, 3)
        points = origins[:, None] + np.einsum("tij,stnj->stni", turns, points)
        meets = np.zeros(feet.shape[:2], dtype=bool)
        for wall in self.walls:
            flat, about = wall.frame[:, 1:], points - wall.centre_m
            normals, offsets = half_planes((wall.vertices_m - wall.centre_m) @ flat)
            inside = np.all(about @ flat @ normals.T <= offsets + room[:, None], axis=-1)
            meets |= (inside & (np.abs(about @ wall.normal) < room)).any(axis=-1)
        return meets, missed.reshape(meets.shape) > _REACHED_M


def _corners(solver: Kinematics) -> list[tuple[Index, Array]]:
    """Outermost corners of the links of every leg but its foot: the joint that carries each, and where
    it is in that joint's frame, shapes (K,) and (K, 3).
    """
    model, result = solver.model, list[tuple[Index, Array]]()
    for i, leg in enumerate(model.legs):
        joints, corners = [np.zeros(0, dtype=int)], [np.zeros((0, 3))]
        for shape, points in model.link_shapes[0]:
            mount = model.mounts[shape.link]
            if mount.leg != i:
                continue
            at = (points @ shape.rotation.T + shape.origin_m) @ mount.rotation.T + mount.origin_m
            outer = at[np.concatenate([at.argmin(axis=0), at.argmax(axis=0)])]
            if mount.joint == leg.chain.joints - 1:
                away = np.linalg.norm(outer - leg.chain.tip_m, axis=1)
                outer = outer[away > _FOOT * solver.radii_m[i]]
            joints.append(np.full(len(outer), mount.joint))
            corners.append(outer)
        result.append((np.concatenate(joints), np.concatenate(corners)))
    return result


def _run(patch: Patch, places: Array, clear: NDArray[np.bool_], chosen: int, along: Array) -> Patch:
    """The part of a patch about a place, as far as places beside it, which follow each other this way,
    are clear.
    """
    ways, flat = (places - patch.centre_m) @ along, patch.frame[:, 1:]
    about = (patch.vertices_m - patch.centre_m) @ flat
    after = np.flatnonzero(~clear[chosen:])[:1] + chosen - 1
    before = np.flatnonzero(~clear[:chosen])[-1:] + 1
    for sign, last in ((1.0, after), (-1.0, before)):
        if len(last):
            end = np.array([sign * ways[last[0]] + _EDGE_M])
            about = clipped(about, sign * (along @ flat)[None], end)
    return patch.with_vertices(patch.centre_m + about @ flat.T) if len(about) > 2 else patch


def _gap_m(wall: Patch, place: Array) -> float:
    """Distance of a place from the box about a wall, seen from above where it has no height [m]."""
    corners = wall.vertices_m[:, : len(place)]
    beyond = np.maximum(corners.min(axis=0) - place, 0.0)
    return float(np.linalg.norm(beyond + np.maximum(place - corners.max(axis=0), 0.0)))


def _across(patch: Patch, place: Array, along: Array) -> Array | None:
    """Places on a patch on the line through a place this way, as seen from above, shape (S, 3); None
    where it misses the patch.
    """
    normals, offsets = half_planes(patch.vertices_m[:, :2])
    slope, room = normals @ along, offsets - normals @ place[:2]
    even = np.abs(slope) < 1e-9
    ends = room / np.where(even, 1.0, slope)
    low = float(ends[slope < -1e-9].max(initial=-np.inf))
    high = float(ends[slope > 1e-9].min(initial=np.inf))
    if np.any(room[even] < 0.0) or not low < high:
        return None
    count = min(max(int((high - low) / _TRIED_M) + 1, 2), _MOST)
    xy = place[:2] + np.linspace(low, high, count)[:, None] * along
    return np.column_stack([xy, patch.heights_at(xy)])


_DECREMENT = 1e-12
"""Squared Newton decrement before the last step, which squares it again."""
_STEPS, _HALVINGS = 60, 30
"""Most Newton steps, and most halvings of one."""
_LESS = 0.1
"""Share of the decrease that the slope promises, so much must come."""


def centred(scaled: ScaledBatch, points: PointBatch, *, moments: bool = True) -> PointBatch:
    """The analytic centres of these problems with the toes held.

    Where Newton's method has not come to an end, which only rounding can keep it from, it is its
    last point.

    Arguments:
        points: one a problem, on the balances and strictly inside of everything else.
        moments: False where moments need not balance.
    """
    if not len(points):
        return points
    at, index = _Held.of(scaled, points, moments), np.arange(len(points))
    body = np.concatenate([points.com, points.rotation], axis=1)
    forces, done_body, done_forces = points.forces, body.copy(), points.forces.copy()
    value = at.value(body, forces)
    for _ in range(_STEPS):
        if not len(index):
            break
        by_body, by_forces, decrement = at.newton(body, forces)
        last = decrement < _DECREMENT
        share, value = at.shortened(body, forces, by_body, by_forces, decrement, value)
        share[last] = 1.0
        body, forces = body + share[:, None] * by_body, forces + share[:, None, None] * by_forces
        done_body[index], done_forces[index] = body, forces
        if last.any():
            left = ~last
            at, index, body, forces, value = (
                at.select(left),
                index[left],
                body[left],
                forces[left],
                value[left],
            )
    return PointBatch(
        com=done_body[:, :3], rotation=done_body[:, 3:], toes=points.toes, forces=done_forces
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Held:
    """B problems with their toes held.

    Arguments:
        to_legs: u = legs + to_legs (c, Θ), shape (N, 3, 6).
        of_forces, of_body: the balances, rows (B, N, R, 3) and (R, 6).
    """

    like: Scaled
    friction: Array  # (B, N)
    legs: Array  # (B, N, 3)
    of_forces: Array
    to_legs: Array
    of_body: Array

    @classmethod
    def of(cls, scaled: ScaledBatch, points: PointBatch, moments: bool) -> _Held:
        """The set that each point lies in."""
        like, rows = scaled.like, scaled.frames
        back = np.broadcast_to(-np.eye(3), (len(like.shoulders), 3, 3))
        to_legs = np.concatenate([back, skew(like.shoulders)], axis=2)
        of_body = np.zeros((6 if moments else 3, 6))
        if moments:
            rows = np.concatenate([rows, np.matmul(skew(points.toes), rows)], axis=2)
            of_body[3:, :3] = skew(like.borne[0])  # −c × (w e_z − F)
        return cls(
            like=like,
            friction=scaled.friction,
            legs=points.toes - like.shoulders,
            of_forces=rows,
            to_legs=to_legs,
            of_body=of_body,
        )

    def select(self, chosen: NDArray[np.bool_]) -> _Held:
        """Some of them."""
        if chosen.all():
            return self
        parts = {name: getattr(self, name)[chosen] for name in ("friction", "legs", "of_forces")}
        return _Held(like=self.like, to_legs=self.to_legs, of_body=self.of_body, **parts)

    def newton(self, body: Array, forces: Array) -> tuple[Array, Array, Array]:
        """Newton's steps of (c, Θ) and of f, and the squared decrement, shape (B,)."""
        (by_body, bent), (by_forces, curved) = self._body(body), self._forces(forces)
        inner, outer = np.asarray(np.linalg.inv(bent)), np.asarray(np.linalg.inv(curved))
        spread = np.matmul(self.of_forces, outer)
        schur = np.matmul(spread, self.of_forces.transpose(0, 1, 3, 2)).sum(axis=1)
        schur += np.matmul(np.matmul(self.of_body, inner), self.of_body.T)
        right = np.matmul(spread, by_forces[..., None])[..., 0].sum(axis=1)
        right += np.matmul(np.matmul(self.of_body, inner), by_body[..., None])[..., 0]
        multipliers = -np.linalg.solve(schur, right[..., None])
        pulled = np.matmul(self.of_body.T, multipliers)[..., 0]
        pressed = np.matmul(self.of_forces.transpose(0, 1, 3, 2), multipliers[:, None])[..., 0]
        step = -np.matmul(inner, (by_body + pulled)[..., None])[..., 0]
        force = -np.matmul(outer, (by_forces + pressed)[..., None])[..., 0]
        return step, force, -(by_body * step).sum(axis=1) - (by_forces * force).sum(axis=(1, 2))

    def shortened(
        self,
        body: Array,
        forces: Array,
        by_body: Array,
        by_forces: Array,
        decrement: Array,
        value: Array,
    ) -> tuple[Array, Array]:
        """The share of each step, halved until it stays inside and gains enough, and the objective
        there; shape (B,).

        Arguments:
            value: of the objective, before the step.
        """
        share = np.ones(len(body))
        for _ in range(_HALVINGS):
            there = self.value(
                body + share[:, None] * by_body, forces + share[:, None, None] * by_forces
            )
            short = np.flatnonzero(
                ~(there <= value - _LESS * share * decrement + 1e-13 * np.abs(value))
            )
            if not len(short):
                return share, there
            share[short] *= 0.5
        share[short] = 0.0
        return share, np.where(share > 0.0, there, value)

    def value(self, body: Array, forces: Array) -> Array:
        """The objective, inf outside."""
        room = [part.reshape(len(body), -1) for part in (*self._room(body), *self._grip(forces))]
        slack = np.concatenate([*room, forces[..., 0]], axis=1)
        inside = np.all(slack > 0.0, axis=1, keepdims=True)
        logs = np.log(np.where(inside, slack, 1.0))[:, : -forces.shape[1]]
        return np.where(inside[:, 0], -logs.sum(axis=1), np.inf)

    def _room(self, body: Array) -> tuple[Array, Array, Array]:
        """Slack of reach, (B, N), of the ball, (B,), and of the tilt, (B, 3); each squared less
        squared.
        """
        legs, away = self._leg(body), body[:, :3] - self.like.com
        reach = self.like.reach**2 - (legs * legs).sum(axis=-1)
        return (
            reach,
            self.like.com_radius**2 - (away * away).sum(axis=-1),
            self.like.tilt**2 - body[:, 3:] ** 2,
        )

    def _grip(self, forces: Array) -> tuple[Array, Array, Array]:
        """Slack of cones, (B, N), squared less squared, and of either side of the force boxes, (B,
        N, 3).
        """
        cone = (self.friction * forces[..., 0]) ** 2 - (forces[..., 1:] ** 2).sum(axis=-1)
        return cone, self.like.force_max - forces, forces - self.like.force_min

    def _leg(self, body: Array) -> Array:
        return np.asarray(self.legs + np.matmul(self.to_legs, body[:, None, :, None])[..., 0])

    def _body(self, body: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the objective in (c, Θ), shape (B, 6) and (B, 6, 6)."""
        reach, ball, tilt = self._room(body)
        legs = 2.0 * self._leg(body) / reach[..., None]
        away = 2.0 * (body[:, :3] - self.like.com) / ball[:, None]
        turn = 2.0 * body[:, 3:] / tilt
        gradient = np.matmul(self.to_legs.transpose(0, 2, 1), legs[..., None])[..., 0].sum(axis=1)
        gradient += np.concatenate([away, turn], axis=1)
        of_legs = _outer(legs) + 2.0 * np.eye(3) / reach[..., None, None]
        hessian = np.matmul(np.matmul(self.to_legs.transpose(0, 2, 1), of_legs), self.to_legs).sum(
            axis=1
        )
        hessian[:, :3, :3] += _outer(away) + 2.0 * np.eye(3) / ball[:, None, None]
        _diagonal(hessian[:, 3:, 3:])[...] += 2.0 / tilt + turn**2
        return gradient, hessian

    def _forces(self, forces: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the objective in every force, shape (B, N, 3) and (B, N, 3,
        3).
        """
        cone, above, below = self._grip(forces)
        bend = (
            np.stack([-2.0 * self.friction**2, *(np.full_like(cone, 2.0),) * 2], axis=-1)
            / cone[..., None]
        )
        gradient = bend * forces
        hessian = _outer(gradient)
        gradient += 1.0 / above - 1.0 / below
        _diagonal(hessian)[...] += bend + above**-2.0 + below**-2.0
        return gradient, hessian


def _outer(vectors: Array) -> Array:
    return vectors[..., :, None] * vectors[..., None, :]


def _diagonal(matrices: Array) -> Array:
    """The diagonals, as a view that can be written."""
    return np.asarray(np.einsum("...ii->...i", matrices))
