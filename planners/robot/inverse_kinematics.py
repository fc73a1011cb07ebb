"""Joint angles for feet: damped least squares on many legs at once, from seeds that are near.

J δ = p* − p(q) is solved as δ = Jᵀ(J Jᵀ + λ I)⁻¹ e, with λ falling with the error; a joint at a
limit that would be pushed beyond it is left out of J (limits are kept at every step, not only at
the end). The seeds are the postures of the leg's workspace whose feet are nearest, by a k-d tree.
Any number of joints; where a leg has more than three, the posture is one of many: the one near the
seed, or near ``near`` where given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidInput
from ..files.arrays import Array
from .leg import Leg, levelled, vectors_of

if TYPE_CHECKING:
    from .robot_model import RobotModel


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeBody:
    """A robot in the world, J joints, N limbs, at one moment; or at T moments, which every array
    then begins with.

    Arguments:
        rotation, origin_m: R_WB and p_WB of the base's frame, shapes (3, 3), (3,) [m].
        angles: joint angles, shape (J,) [rad].
        toes_m, normals: contact points of the limbs [m] and normals of the surfaces there, shape
            (N, 3).
        stands: truth values, True for limbs that stand, shape (N,).
        error_m: how far feet stay from where they should be, shape (N,); None where nobody looked.
    """

    rotation: Array
    origin_m: Array
    angles: Array
    toes_m: Array
    normals: Array
    stands: NDArray[np.bool_]
    error_m: Array | None = None

    @property
    def moments(self) -> WholeBody:
        """Moments of the body, T of them, one where it is one."""
        return self if self.angles.ndim == 2 else self.at(None)

    def at(self, rows: slice | NDArray[np.intp] | int | None) -> WholeBody:
        """Some of the moments, by number."""
        known = {name: array for name, array in vars(self).items() if array is not None}
        return replace(self, **{name: array[rows] for name, array in known.items()})

    def __len__(self) -> int:
        return len(self.moments.angles)


Overlap = tuple[float, str, str]
"""How deep a link is inside something [m], the link, and what it is in: another link, or a part of
the terrain."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Near:
    """A shape of a link near to another one, or to a part of the terrain.

    Arguments:
        shape, other: numbers of the shapes, other −1 for the terrain.
        name: name of the other link or part of the terrain.
        distance_m: distance between them, negative inside [m].
        points_m: nearest points of both, in the world, shape (2, 3) [m].
        normal: unit vector from the other to the shape, along which the distance grows.
    """

    shape: int
    other: int
    name: str
    distance_m: float
    points_m: Array
    normal: Array


EXACT_M = 1e-7
"""A foot this close to its target is there."""
REACHED_M = 1e-5
"""A foot farther from its target than this is out of reach."""
_STEPS = 30
_SAMPLES = 8000
_TRIES = 4
"""Seeds that are tried for a foot which the seeds before did not bring to its target."""
_DAMPING = 1e-3
"""λ as a share of the error [m]."""
_LONGEST_STEP = 0.5
"""Longest move of a joint in one step [rad, or m]."""


def descend(
    leg: Leg,
    feet: ArrayLike,
    start: ArrayLike,
    up: ArrayLike = (0.0, 0.0, 1.0),
    *,
    steps: int = _STEPS,
    exact_m: float = EXACT_M,
) -> tuple[Array, Array]:
    """Bring feet to where they should be, from given postures, joint limits kept; soles flat on
    ground with these normals, looking ahead.

    Arguments:
        feet: p_BF, shape (K, 3) [m].
        start: shape (K, n).
        up: normals below soles in the base's frame, shape (K, 3) or (3,).
        exact_m: a foot this close to its target is there.

    Returns:
        The best postures that were met, shape (K, n), and how far their feet, or the corners of
        their soles, are from the targets, shape (K,) [m].
    """
    target = np.asarray(feet, dtype=np.float64)
    lower, upper = (
        np.where(leg.turns, -np.inf, leg.lower_rad),
        np.where(leg.turns, np.inf, leg.upper_rad),
    )
    best = np.clip(np.asarray(start, dtype=np.float64), lower, upper)
    error = np.full(len(best), np.inf)
    open_, q = np.arange(len(best)), best.copy()
    level = None if leg.sole is None else levelled(np.broadcast_to(up, target.shape))
    for _ in range(steps):
        now, jacobian = leg.chain.feet_and_jacobian(q)
        gap = target[open_] - now
        if level is not None:
            turned, axes = _tilts(leg, q, level[open_])
            gap = np.concatenate([gap, turned], axis=1)
            jacobian = np.concatenate([jacobian, axes], axis=1)
        far = np.sqrt(np.einsum("ki,ki->k", gap, gap))
        better = far < error[open_]
        best[open_[better]], error[open_[better]] = q[better], far[better]
        going = far > exact_m
        open_, q, jacobian, gap, far = (each[going] for each in (open_, q, jacobian, gap, far))
        if not len(open_):
            break
        q = stepped(q, jacobian, gap, _DAMPING * far[:, None, None], _LONGEST_STEP, (lower, upper))
    return leg.wrapped(best), error


def _tilts(leg: Leg, angles: Array, level: Array) -> tuple[Array, Array]:
    """Ways of a sole's farthest corner to where its axes are these, by rotation vectors, shape (K,
    3) [m], and derivatives of such ways in the joints, shape (K, 3, n).

    Arguments:
        level: axes as columns, in the base's frame, shape (K, 3, 3).
    """
    assert leg.sole is not None
    turns = leg.chain.frames(angles)[0]
    between = level @ np.swapaxes(turns[:, -1] @ leg.sole.rotation, 1, 2)
    axes = np.einsum("knij,nj->kin", turns, leg.chain.axes) * ~leg.chain.slides
    return leg.sole.radius_m * vectors_of(between), leg.sole.radius_m * axes


def stepped(
    angles: Array,
    jacobian: Array,
    gap: Array,
    damping: Array | float,
    longest: float,
    limits: tuple[Array, Array],
    drawn: Array | None = None,
) -> Array:
    """Postures after one step within the limits, shape (K, n): a joint that waits at a limit and
    would be pushed beyond it takes no part.

    Arguments:
        angles: shape (K, n).
        jacobian: derivatives of what is to move, shape (K, m, n).
        gap: how far it is to move, shape (K, m).
        damping: λ, shape (K, 1, 1).
        longest: the longest move of a joint.
        limits: lower and upper ones of the joints, shape (n,) or (K, n) each.
        drawn: step of the joints where it moves nothing else, shape (K, n).
    """
    lower, upper = limits
    step = _damped(jacobian, gap, damping, drawn)
    low, high = angles <= lower, angles >= upper
    if (low | high).any() and (held := low & (step < 0.0) | high & (step > 0.0)).any():
        hit = held.any(axis=1)
        free = jacobian[hit] * ~held[hit, None]
        kept = damping[hit] if isinstance(damping, np.ndarray) else damping
        pulled = None if drawn is None else np.where(held, 0.0, drawn)[hit]
        step[hit] = _damped(free, gap[hit], kept, pulled)
    step = np.minimum(np.maximum(step, -longest), longest)
    return np.asarray(np.minimum(np.maximum(angles + step, lower), upper))


def _damped(jacobian: Array, gap: Array, damping: Array | float, drawn: Array | None) -> Array:
    """Jᵀ(J Jᵀ + λ I)⁻¹ (e − J d) + d, shape (K, n)."""
    transposed = jacobian.transpose(0, 2, 1)
    square = jacobian @ transposed + damping * np.eye(jacobian.shape[1])
    if drawn is None:
        return np.asarray((transposed @ np.linalg.solve(square, gap[:, :, None]))[:, :, 0])
    along = drawn[:, :, None]
    step = transposed @ np.linalg.inv(square) @ (gap[:, :, None] - jacobian @ along) + along
    return np.asarray(step[:, :, 0])


def descend_legs(
    legs: Sequence[Leg],
    feet: Array,
    start: Array,
    up: ArrayLike = (0.0, 0.0, 1.0),
    *,
    steps: int = _STEPS,
    exact_m: float = EXACT_M,
) -> tuple[Array, Array]:
    """``descend`` of all legs: postures, shape (K, J), from those of shape (K, J), and how far every
    foot is off, shape (K, N) [m].

    Arguments:
        feet: p_BF, shape (K, N, 3) [m].
        up: normals below soles in the base's frame, shape (K, N, 3) or (3,).
    """
    ups, ends = np.broadcast_to(up, feet.shape), np.cumsum([len(leg.joints) for leg in legs])
    parts = [
        descend(leg, feet[:, i], part, ups[:, i], steps=steps, exact_m=exact_m)
        for i, (leg, part) in enumerate(zip(legs, np.split(start, ends[:-1], axis=1), strict=True))
    ]
    return np.concatenate([q for q, _ in parts], axis=1), np.stack([e for _, e in parts], axis=1)


_ABOUT_RAD, _FEWER = 0.3, 16
"""Deviation of a sole's seeds from where it stands, and how many fewer there are: others are level
nowhere near."""


def starts_of(leg: Leg, count: int, rng: np.random.Generator) -> Array:
    """Postures to start from, shape (K, n) [rad]: all over the limits, of a sole about the posture
    in which it stands.
    """
    if leg.sole is None:
        return leg.random_angles(count, rng)
    off = rng.normal(0.0, _ABOUT_RAD, (count // _FEWER, len(leg.joints)))
    return np.asarray(np.clip(leg.stance_rad + off, leg.lower_rad, leg.upper_rad))


class InverseKinematics:
    """All legs of a robot, and the posture in which they stand, which keeps the bend of their knees,
    shape (J,) [rad].

    Not for use by several threads at once.
    """

    def __init__(
        self, legs: Sequence[Leg], seeds: Sequence[Array] | None = None, *, tries: int = _TRIES
    ) -> None:
        """The solver of a robot.

        Arguments:
            seeds: postures to start from, of every leg, shape (S, n) [rad]; None for the same ones
                all over its workspace each time.
            tries: seeds that are tried for a foot, the nearest first.
        """
        rng = np.random.default_rng(0)
        self.legs, self._tries, self._trees = tuple(legs), tries, dict[int, Any]()
        self._seeds = seeds or [starts_of(leg, _SAMPLES, rng) for leg in legs]
        self.standing = np.concatenate([leg.stance_rad for leg in legs])

    def solve(
        self,
        feet: ArrayLike,
        *,
        near: ArrayLike | None = None,
        up: ArrayLike = (0.0, 0.0, 1.0),
    ) -> tuple[Array, Array]:
        """Angles for feet in the base's frame, shape (K, N, 3) [m]: of all joints, shape (K, J)
        [rad], and how far every foot is off, shape (K, N) [m].

        Raises InvalidInput for feet of another shape.

        Arguments:
            near: postures to stay near to, shape (K, J) or (J,) [rad]; tried first, and seeds only
                for the feet that do not get there.
            up: normals below soles in the base's frame, shape (K, N, 3) or (3,).
        """
        target = np.asarray(feet, dtype=np.float64)
        if target.ndim != 3 or target.shape[1:] != (len(self.legs), 3):
            raise InvalidInput(
                f"feet: expected shape (any, {len(self.legs)}, 3), got {target.shape}"
            )
        ups = np.broadcast_to(up, target.shape)
        best, error = np.zeros((len(target), len(self.standing))), np.full(target.shape[:2], np.inf)
        if near is not None:
            best, error = descend_legs(self.legs, target, np.broadcast_to(near, best.shape), ups)
        ends = np.cumsum([0, *(len(leg.joints) for leg in self.legs)]).tolist()
        for i, (leg, joints) in enumerate(zip(self.legs, pairwise(ends), strict=True)):
            missed = np.flatnonzero(error[:, i] > REACHED_M)
            for start in self._nearest(i, target[missed, i]) if len(missed) else ():
                left = error[missed, i] > REACHED_M
                if not left.any():
                    break
                at = missed[left]
                again, far = descend(leg, target[at, i], start[left], ups[at, i])
                closer = far < error[at, i]
                best[at[closer], slice(*joints)] = again[closer]
                error[at[closer], i] = far[closer]
        return best, error

    def _nearest(self, leg: int, feet: Array) -> Array:
        """Seeds of a leg whose feet are nearest to these, shape (K, 3), the nearest first, shape
        (tries, K, n).
        """
        from scipy.spatial import cKDTree  # slow to import

        seeds = self._seeds[leg]
        if leg not in self._trees:
            at = self.legs[leg].chain.feet(seeds)
            self._trees[leg] = cKDTree(at, balanced_tree=False, compact_nodes=False)
        numbers = np.arange(1, min(self._tries, len(seeds)) + 1)
        return np.asarray(seeds[self._trees[leg].query(feet, k=numbers)[1].T])


def centres_of(
    model: RobotModel, com_m: ArrayLike, rotation: ArrayLike, toes_m: ArrayLike, normals: ArrayLike
) -> Array:
    """Centres of the feet in the base's frame, shape (K, N, 3) [m], of K stances of N legs of a robot
    whose body's origin is the centre of mass of the standing robot.

    Arguments:
        com_m: p_WC, shape (K, 3) [m].
        rotation: R_WB, shape (K, 3, 3).
        toes_m: p_WF, and normals of the ground there, on which a foot is a sphere, shape (K, N, 3).
    """
    radii = np.array([[leg.radius_m] for leg in model.legs])
    arms = np.asarray(toes_m) + radii * np.asarray(normals) - np.asarray(com_m)[:, None]
    turned = np.einsum("kji,knj->kni", np.asarray(rotation), arms)
    return np.asarray(turned + model.com_m)


def base_of(model: RobotModel, com_m: Array, rotation: Array) -> Array:
    """p_WB of the base whose centre of mass is at p_WC, shape (3,) [m]."""
    return np.asarray(com_m - rotation @ model.com_m)
