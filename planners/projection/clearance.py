"""Distances of bodies from each other and from the terrain along a plan's path, with their first
derivatives.

Of two points x, y that are nearest, n the unit vector from y to x, the distance changes by n·(δx −
δy). With δc, δ the change of the body's place and a small turn, a point of a leg whose joints are q
moves by

    δx = δc + δ × (x − c) + J_x δq,    δq = N δq̃ + J⁺ (δf − δc − δ × (f − c)),

since its foot f is held at its toe, or on its swing: J⁺ is the pseudo-inverse of the foot's
Jacobian, N = I − J⁺J, and q̃ the joints of the key frames that the moment is between, as the body
is: every number is of key frames and toes.

A foot that stays at x, short of its place f on its path since no joint goes any further, has n from
x to f: what is missing, n·(f − x), changes by n·(δf − δc − δ × (x − c)), as all that a leg reaches
goes with the body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..answer.plan import Plan
from ..equilibrium.layout import Fill, Index
from ..equilibrium.rows import Rows
from ..equilibrium.terms import Given
from ..errors import check_time
from ..files.arrays import Array, cross
from ..motion.joints import STRAY_M, JointPath, PathPostures, path_bodies
from ..motion.path import PathMoments, PlanPath
from ..robot.bodies import Bodies
from ..robot.kinematics import Kinematics
from ..robot.leg_slopes import turning
from ..robot.overlaps import Near
from ..robot.rotation import rotations_of
from ..terrain.obstacles import Obstacles

if TYPE_CHECKING:
    from scipy.sparse import csr_array

APART_M = 0.03
"""Moments are looked at so far apart: a third of those that are judged."""
NEAR_M = 0.02
"""Beyond what they should keep, bodies farther apart than this are not looked at."""
CLEAR_PRICE = 20.0
"""Price of what is missing to a distance at one moment, in the length scale, in units of the
objective."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearness:
    """K pairs of bodies that are near at some moment of a path, and feet that stay from it.

    Arguments:
        distance_m: shape (K,), negative inside, and of a foot by how much it stays.
        slopes: of the distances, in metres a metre or radian, in the numbers of M key frames and P
            toes, laid end to end: c (M, 3) [m], Θ (M, 3), q (M, J), p (P, 3) [m].
        astray_m: how far feet stay from their path.
    """

    distance_m: Array
    slopes: csr_array
    astray_m: float

    def within(self, clearance_m: float, rooms_m: Array) -> Nearness:
        """Select those that may come nearer than this where no number changes by more than these
        amounts.
        """
        falls = abs(self.slopes) @ rooms_m
        near = np.flatnonzero(self.distance_m - falls < clearance_m)
        return replace(self, distance_m=self.distance_m[near], slopes=self.slopes[near])

    def missing(self, clearance_m: float) -> Array:
        """Shortfall of a distance, shape (K,) [m]."""
        return np.asarray(np.maximum(clearance_m - self.distance_m, 0.0))


class PathClearance:
    """Looks along the paths of plans over one course, each of which raises TimeEnded after the
    deadline (``time.perf_counter()``). Raises InvalidInput without coal, as ``Bodies`` does.
    """

    def __init__(self, plan: Plan, solver: Kinematics, deadline: float = math.inf) -> None:
        self._solver, self._deadline = solver, deadline
        self._bodies = Bodies(solver, Obstacles.of(plan.problem.terrain))

    def nearness(self, plan: Plan, clearance_m: float, apart_m: float = APART_M) -> Nearness:
        """Find the bodies that are nearer than that and a little more, at moments this far apart:
        of every pair of bodies where it is nearest, and wherever it is too near.
        """
        path = JointPath(PlanPath(plan), self._solver, apart_m)
        moments, postures = _with_keys(
            path.path, *path.judged(turn_rad=np.inf, deadline=self._deadline)
        )
        check_time(self._deadline)
        bodies = path_bodies(path.path, moments, postures)
        loose = replace(
            bodies, stands=np.ones_like(bodies.stands)
        )  # feet lift off what they stand on
        near = _nearest(self._bodies.near(loose, clearance_m + NEAR_M), clearance_m)
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
        feet = _astray(moments, postures)
        for row, (t, leg) in enumerate(feet, len(near)):
            slopes.add_foot(leg, np.array([row]), np.array([t]))
        missed = [-float(postures.error_m[t, leg]) for t, leg in feet]
        return Nearness(
            distance_m=np.array([*(each.distance_m for _, each in near), *missed]),
            slopes=slopes.matrix(len(near) + len(feet)),
            astray_m=float(postures.error_m.max()),
        )


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


def _astray(moments: PathMoments, postures: PathPostures) -> list[tuple[int, int]]:
    """Moment at which each limb that stays from its path in a step does so most, and the limb."""
    worst = dict[tuple[int, int], int]()
    for t, limb in np.argwhere(postures.error_m > STRAY_M).tolist():
        key = int(moments.step[t]), limb
        if key not in worst or postures.error_m[t, limb] > postures.error_m[worst[key], limb]:
            worst[key] = t
    return [(t, limb) for (_, limb), t in worst.items()]


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
    positive = rows.at_most("no_less", len(near.distance_m))
    rows.put(positive, slack, -1.0)
    rows.linear(slack, CLEAR_PRICE)


def _constant(values: Array) -> Fill[Any]:
    return lambda _: values


def _with_keys(
    path: PlanPath, moments: PathMoments, postures: PathPostures
) -> tuple[PathMoments, PathPostures]:
    """And the key frames as they are drawn, behind them."""
    plan = path.plan
    assert plan.joints_rad is not None
    keys = path.at([(path.standing(k), np.ones(1)) for k in range(plan.problem.frames)])
    turns = rotations_of(keys.rotation_rad)
    path_postures = PathPostures(
        rotations=turns,
        origins_m=keys.com_m - turns @ plan.problem.robot.origin_m,
        angles=plan.joints_rad,
        error_m=np.zeros(keys.foothold.shape),
    )
    return _joined(moments, keys), _joined(postures, path_postures)


J = TypeVar("J", PathMoments, PathPostures)


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
        self, path: JointPath, solver: Kinematics, moments: PathMoments, postures: PathPostures
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

    def add_foot(self, leg: int, rows: Index, times: Index) -> None:
        """A leg's foot that stays from its path: less where the body goes to its place, or its
        place to the body.
        """
        moments, postures = self._moments, self._postures
        joints, chain = self._solver.joints_of(leg), self._solver.model.legs[leg].chain
        feet = chain.feet(postures.angles[np.ix_(times, joints)])
        feet = postures.origins_m[times] + np.einsum("kij,kj->ki", postures.rotations[times], feet)
        push = moments.feet_m[times, leg] - feet
        push = push / np.linalg.norm(push, axis=1, keepdims=True)
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
        rotations, origins = self._postures.rotations[times], self._postures.origins_m[times]
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
