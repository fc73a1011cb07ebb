"""Witnesses for a batch of posture problems at a time, in numpy alone: a fixed iteration from a fixed start.

A posture problem in x = (λ, c, Θ, u, f), with toes q_i = Σ_u λ_iu v_iu (E1) and legs u_i = q_i − c − (I + [Θ]×) s_i, is
the intersection of two sets. K has a projection in closed form: simplices of λ, the ball of c, the box of Θ, the balls
‖u_i‖ ≤ ρ_i (E11), and friction cones cut off where the force boxes end (E10). A is affine but for the moments,

    Σ C_i f_i = w e_z  (E5),    Σ q_i × C_i f_i − w c × e_z = 0  (E6),

and these are linearised about the toes and forces that the iteration is at, anew every few steps. Douglas–Rachford is
z ← z + P_K(2 P_A z − z) − P_A z. It ends for a problem as soon as c and f, put on the balances with the toes held, lie
in K. What is found is a claim, for the verifier to decide; what is not found says nothing. No solver takes part and no
problem hears of another, so a claim follows from its problem alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.layout import Index
from ..equilibrium.scaled import skew
from ..files.arrays import Array

LOOKS = 8
"""Steps between two looks at who is there, after each of which the moments are linearised anew."""
SHRINK = 1e-3
"""K is made smaller by this share, so that the iteration ends inside of it."""
INSIDE = 1e-9
SPREAD, TURN = 0.25, 0.3
"""Units of λ and Θ in which x is measured: smaller ones let toes and body move sooner than forces."""


def witnesses(scaled: ScaledBatch, steps: int, *, moments: bool = True) -> tuple[Index, PointBatch]:
    """Claimed points for problems of a batch, by their indices, ascending; there is none where more steps are needed.

    moments: False for points of P̄, in which moments need not balance.
    """
    found = list(_douglas_rachford(scaled, steps, moments)) if len(scaled) else []
    if not found:
        return np.zeros(0, dtype=np.intp), PointBatch.none(scaled.friction.shape[1])
    index = np.concatenate([index for index, _ in found])
    order = np.argsort(index)
    return index[order], PointBatch.joined([points for _, points in found]).select(order)


def _douglas_rachford(scaled: ScaledBatch, steps: int, moments: bool) -> Iterator[tuple[Index, PointBatch]]:
    """Indices and points of the problems that the iteration ends for, as it ends."""
    index, sets = np.arange(len(scaled)), _Sets.of(scaled)
    z = sets.start()
    if moments:
        sets = sets.linearised(z)
    for step in range(1, steps + 1):
        on = sets.balance(z)
        if step % LOOKS == 0:
            points = sets.with_toes_held(on, moments)
            there = sets.hold(points)
            if there.any():
                yield index[there], points.select(there)
                left = np.flatnonzero(~there)
                index, sets, z, on = index[left], sets.select(left), z[left], on[left]
            if not len(index):
                return
            if moments:
                sets = sets.linearised(on)
                on = sets.balance(z)
        z += sets.project(2.0 * on - z) - on


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows G x = h of B problems, shape (B, R, D) and (B, R), and how to get there, (B, D, R)."""

    rows: Array
    right: Array
    back: Array

    def meet(self, x: Array) -> None:
        """Move x there, shape (B, D)."""
        x -= _times(self.back, _times(self.rows, x) - self.right)

    def along(self, others: Array) -> Array:
        """Other rows, shape (B, ·, D), less what these fix of them."""
        return np.asarray(others - np.matmul(np.matmul(others, self.back), self.rows))

    def select(self, chosen: Index) -> _Rows:
        """Some of them, by index."""
        return _Rows(self.rows[chosen], self.right[chosen], self.back[chosen])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sets:
    """A and K of the problems that are left; x is (λ, Θ, c − c_0, u, f), the first two in their units.

    low, high: where cones begin and end, shape (N,) and (B, N). legs, weight, moments: what makes up A, the rows of u,
    of Σ C_i f_i, and those that are linearised.
    """

    scaled: ScaledBatch
    low: Array
    high: Array
    legs: _Rows
    weight: _Rows
    moments: _Rows | None = None

    @classmethod
    def of(cls, scaled: ScaledBatch) -> _Sets:
        """Before the moments are linearised. Shear bounds cut the cones where they begin to leave them."""
        like, lifting = scaled.like, _side_by_side(scaled.frames)
        shear = np.minimum(like.force_max[:, 1:], -like.force_min[:, 1:]).min(axis=1)
        high = np.minimum(like.force_max[:, 0], shear / np.maximum(scaled.friction, 1e-12))
        right = np.tile([0.0, 0.0, like.weight], (len(scaled), 1))
        return cls(
            scaled=scaled, low=np.maximum(like.force_min[:, 0], 0.0), high=high, legs=_legs(scaled),
            weight=_Rows(lifting, right, lifting.swapaxes(1, 2) / scaled.friction.shape[1]),  # Σ C_i C_i' = N
        )  # fmt: skip

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Where λ, Θ, (c − c_0, u) and f are in x."""
        _, contacts, corners, _ = self.scaled.vertices.shape
        ends = np.cumsum([0, contacts * corners, 3, 3 + 3 * contacts, 3 * contacts]).tolist()
        return tuple(slice(begin, end) for begin, end in itertools.pairwise(ends))

    @cached_property
    def radii(self) -> Array:
        """Of the balls of c and u, made smaller, shape (N + 1,)."""
        return np.append(self.scaled.like.com_radius, self.scaled.like.reach) * (1.0 - SHRINK)

    def start(self) -> Array:
        """Toes in the middle of their patches, the nominal c, no tilt, equal shares of the weight along the normals."""
        count, contacts, corners, _ = self.scaled.vertices.shape
        weights, _, balls, forces = self.parts
        z = np.zeros((count, forces.stop))
        z[:, weights] = SPREAD / corners
        away = self.scaled.vertices.mean(axis=2) - self.scaled.like.com - self.scaled.like.shoulders
        z[:, balls.start + 3 : balls.stop] = away.reshape(count, -1)
        z[:, forces][:, ::3] = self.scaled.like.weight / contacts
        return z

    def balance(self, z: Array) -> Array:
        """P_A."""
        on, forces = z.copy(), self.parts[3]
        self.legs.meet(on[:, : forces.start])
        self.weight.meet(on[:, forces])
        if self.moments is not None:
            self.moments.meet(on)
        return on

    def linearised(self, x: Array) -> _Sets:
        """The same about x: Σ q × F̄ + Σ q̄ × F − w c × e_z = Σ q̄ × F̄ joins what is always affine."""
        scaled, (weights, _, balls, forces) = self.scaled, self.parts
        toes, force = self.toes(x), _times(scaled.frames, self._vectors(x, forces))
        rows, arms = np.zeros((len(x), 3, x.shape[1])), skew(toes)
        rows[:, :, forces] = _side_by_side(np.matmul(arms, scaled.frames))
        rows[:, :, weights] = _side_by_side(np.matmul(skew(force), scaled.vertices.swapaxes(2, 3) / -SPREAD))
        right = _times(arms, force).sum(axis=1) + _of_weight(scaled, rows, balls.start)
        free = np.concatenate(
            [self.legs.along(rows[:, :, : forces.start]), self.weight.along(rows[:, :, forces])], axis=2
        )  # fmt: skip
        return replace(self, moments=_Rows(rows, right, _back(free)))

    def project(self, x: Array) -> Array:
        """P_K, made smaller; x, shape (B, D), is overwritten."""
        weights, turn, balls, forces = self.parts
        shares = x[:, weights].reshape(self.scaled.vertices.shape[:3])
        _to_simplex(shares, SPREAD)
        x[:, weights] = shares.reshape(len(x), -1)
        tilt = TURN * self.scaled.like.tilt * (1.0 - SHRINK)
        x[:, turn] = np.minimum(np.maximum(x[:, turn], -tilt), tilt)
        away, f = self._vectors(x, balls), self._vectors(x, forces)
        away *= np.minimum(1.0, self.radii / np.maximum(_length(away), 1e-300))[..., None]
        friction, normal, shear = self.scaled.friction * (1.0 - SHRINK), f[..., 0], _length(f[..., 1:])
        cut = friction * normal
        onto = np.where(shear <= cut, normal, (normal + friction * shear) / (1.0 + friction * friction))
        normal[...] = np.minimum(np.maximum(onto, self.low * (1.0 + SHRINK)), self.high * (1.0 - SHRINK))
        f[..., 1:] *= np.minimum(1.0, friction * normal / np.maximum(shear, 1e-300))[..., None]
        return x

    def with_toes_held(self, x: Array, moments: bool) -> PointBatch:
        """x with toes on their patches, Θ in its box, and (c, f) on the balances exactly."""
        scaled, (_, turn, balls, forces) = self.scaled, self.parts
        toes, com = self.toes(x), slice(balls.start, balls.start + 3)
        y = np.concatenate([x[:, com], x[:, forces]], axis=1)
        rows = np.zeros((len(x), 6 if moments else 3, y.shape[1]))
        rows[:, :3, 3:] = _side_by_side(scaled.frames)
        right = np.zeros(rows.shape[:2])
        right[:, 2] = scaled.like.weight
        if moments:
            rows[:, 3:, 3:] = _side_by_side(np.matmul(skew(toes), scaled.frames))
            right[:, 3:] = _of_weight(scaled, rows[:, 3:], 0)
        y -= _times(_back(rows), _times(rows, y) - right)
        tilt = scaled.like.tilt * (1.0 - SHRINK)
        rotation = np.minimum(np.maximum(x[:, turn] / TURN, -tilt), tilt)
        return PointBatch(
            com=y[:, :3] + scaled.like.com, rotation=rotation, toes=toes, forces=self._vectors(y, slice(3, None))
        )

    def hold(self, points: PointBatch) -> NDArray[np.bool_]:
        """Whether points with their toes on their patches lie in K, shape (B,)."""
        like, normal = self.scaled.like, points.forces[..., 0]
        cones = _length(points.forces[..., 1:]) <= self.scaled.friction * normal - INSIDE
        cones &= (normal >= self.low + INSIDE) & (normal <= self.high - INSIDE)
        legs = _length(points.legs(like)) <= like.reach - INSIDE
        body = (_length(points.com - like.com) <= like.com_radius - INSIDE) & (like.tilt > 0.0)
        return np.asarray(cones.all(axis=1) & legs.all(axis=1) & body)

    def toes(self, x: Array) -> Array:
        """q of the nearest λ, so that they are on their patches, shape (B, N, 3)."""
        shares = x[:, self.parts[0]].reshape(self.scaled.vertices.shape[:3]) / SPREAD
        _to_simplex(shares, 1.0)
        return _times(self.scaled.vertices.swapaxes(2, 3), shares)

    def select(self, chosen: Index) -> _Sets:
        """Some of them, by index, before the moments are linearised."""
        return _Sets(
            scaled=self.scaled.select(chosen), low=self.low, high=self.high[chosen], legs=self.legs.select(chosen),
            weight=self.weight.select(chosen),
        )  # fmt: skip

    def _vectors(self, x: Array, part: slice) -> Array:
        """A part of x as vectors, shape (B, ·, 3): a view."""
        return x[:, part].reshape(len(x), -1, 3)


def _legs(scaled: ScaledBatch) -> _Rows:
    """u_i = q_i − c − (I + [Θ]×) s_i as rows of x without f, 3N of them."""
    count, contacts, corners, _ = scaled.vertices.shape
    body, size = contacts * corners, 3 * contacts
    rows, at = np.zeros((count, size, body + 6 + size)), np.arange(size)
    for i in range(contacts):
        own = slice(3 * i, 3 * i + 3)
        rows[:, own, corners * i : corners * (i + 1)] = scaled.vertices[:, i].transpose(0, 2, 1) / SPREAD
        rows[:, own, body : body + 3] = skew(scaled.like.shoulders[i]) / TURN  # −Θ × s = s × Θ
    rows[:, at, body + 3 + at % 3] = rows[:, at, body + 6 + at] = -1.0
    right = np.tile((scaled.like.com + scaled.like.shoulders).ravel(), (count, 1))
    return _Rows(rows, right, _back(rows))


def _of_weight(scaled: ScaledBatch, rows: Array, column: int) -> Array:
    """Add −w (c − c_0) × e_z to rows of moments, c − c_0 at this column; w c_0 × e_z, for the right side."""
    weight, com = scaled.like.weight, scaled.like.com[0]
    rows[:, 0, column + 1], rows[:, 1, column] = -weight, weight
    return np.array([weight * com[1], -weight * com[0], 0.0])


def _back(rows: Array) -> Array:
    """R' (R R')⁻¹, shape (B, D, R)."""
    across = rows.transpose(0, 2, 1)
    inverse = np.linalg.inv(np.matmul(rows, across) + 1e-12 * np.eye(rows.shape[1]))
    return np.asarray(np.matmul(across, inverse))


def _to_simplex(x: Array, total: float) -> None:
    """Move x to the nearest point with entries ≥ 0 and this sum along the last axis (Held, Wolfe and Crowder, 1974)."""
    largest = np.sort(x, axis=-1)[..., ::-1]
    levels = (np.cumsum(largest, axis=-1) - total) / np.arange(1, x.shape[-1] + 1)
    x -= levels.max(axis=-1, keepdims=True)
    np.maximum(x, 0.0, out=x)


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def _times(matrices: Array, vectors: Array) -> Array:
    """M v along the last axes."""
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])


def _side_by_side(blocks: Array) -> Array:
    """Blocks of shape (B, N, 3, K) as maps of shape (B, 3, N K)."""
    return blocks.transpose(0, 2, 1, 3).reshape(len(blocks), blocks.shape[2], -1)
