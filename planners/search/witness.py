"""Witnesses for the easy ones: Douglas–Rachford at guessed toes, a batch of posture problems at a time, in numpy alone.

With the toes q held and no tilt the posture problem is convex in x = (c, f), and is the intersection of two sets whose
projections are closed forms: A, the balances

    Σ C_i f_i = w e_z  (E5),    Σ q_i × C_i f_i − w c × e_z = 0  (E6),

an affine set, and K, friction cones cut off where the force boxes end (E10) and balls around c: its own and, for every
limb, ‖q_i − c − s_i‖ ≤ ρ_i (E11). The iteration z ← z + P_K(2 P_A z − z) − P_A z ends for a problem as soon as P_A z,
which balances, lies in K, too. What is found is a claim, for the verifier to decide; what is not found says nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..answer.outcome import Posture
from ..equilibrium.batch import ScaledBatch
from ..equilibrium.scaled import Point, skew
from ..files.arrays import Array

STEPS = 32
LOOKS = 8
"""Steps between two looks at who is there."""
SHRINK = 3e-3
"""K is made smaller by this share, so that the iteration ends inside of it."""
INSIDE = 1e-9
NEAR = 0.08
"""Of the second guess: a vertex this much farther from the shoulder, in length scales, weighs e times less."""


def witnesses(scaled: ScaledBatch) -> dict[int, Posture]:
    """Claimed postures for problems of a batch, by their index; there is none for those that are not easy."""
    found: dict[int, Posture] = {}
    left = np.arange(len(scaled))
    for guess in (_centres, _nearest):
        some = scaled.select(left)
        toes = guess(some)
        for k, com, forces in _douglas_rachford(some, toes):
            index = int(left[k])
            point = Point(com=com[None], rotation=np.zeros((1, 3)), toes=toes[k], forces=forces, residual=0.0)
            found[index] = scaled.problems[index].posture(point)
        left = np.array([index for index in left if int(index) not in found], dtype=np.intp)
    return found


def _centres(scaled: ScaledBatch) -> Array:
    """Toes in the middle of their patches, shape (B, N, 3)."""
    return np.asarray(scaled.vertices.mean(axis=2))


def _nearest(scaled: ScaledBatch) -> Array:
    """Toes towards those corners of their patches that are near the shoulders, shape (B, N, 3)."""
    away = np.linalg.norm(scaled.vertices - scaled.like.shoulders[:, None], axis=-1)
    weights = np.exp((away.min(axis=-1, keepdims=True) - away) / NEAR)
    weights /= weights.sum(axis=-1, keepdims=True)
    return np.asarray((weights[..., None] * scaled.vertices).sum(axis=2))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cuts:
    """K: balls for c, shape (B, N + 1, 3) and (N + 1,), and cones of slope ``friction`` up to f_n = ``top``, (B, N)."""

    centres: Array
    radii: Array
    friction: Array
    top: Array

    def project(self, x: Array) -> Array:
        """P_K, but for c only onto the ball that it is farthest out of. x, shape (B, 3 + 3N), is overwritten."""
        c, f = x[:, :3], x[:, 3:].reshape(len(x), -1, 3)
        off = c[:, None] - self.centres
        far = np.sqrt((off * off).sum(axis=-1)) / self.radii
        worst = far.argmax(axis=1)[:, None]
        most = np.maximum(np.take_along_axis(far, worst, axis=1), 1.0)
        c += (1.0 / most - 1.0) * np.take_along_axis(off, worst[..., None], axis=1)[:, 0]
        shear = np.sqrt((f[..., 1:] ** 2).sum(axis=-1))
        onto = (f[..., 0] + self.friction * shear) / (1.0 + self.friction**2)
        normal = np.where(shear <= self.friction * f[..., 0], f[..., 0], onto)
        f[..., 0] = np.minimum(np.maximum(normal, 0.0), self.top)
        f[..., 1:] *= np.minimum(1.0, self.friction * f[..., 0] / np.maximum(shear, 1e-300))[..., None]
        return x

    def hold(self, x: Array) -> NDArray[np.bool_]:
        """Whether x lies inside, shape (B,)."""
        c, f = x[:, :3], x[:, 3:].reshape(len(x), -1, 3)
        shear = np.sqrt((f[..., 1:] ** 2).sum(axis=-1))
        cones = (shear <= self.friction * f[..., 0] - INSIDE) & (f[..., 0] <= self.top)
        balls = np.linalg.norm(c[:, None] - self.centres, axis=-1) <= self.radii - INSIDE
        return np.asarray(cones.all(axis=1) & balls.all(axis=1))

    def select(self, chosen: NDArray[np.bool_]) -> _Cuts:
        centres, friction, top = (part[chosen] for part in (self.centres, self.friction, self.top))
        return _Cuts(centres=centres, radii=self.radii, friction=friction, top=top)


def _cuts(scaled: ScaledBatch, toes: Array, shrink: float) -> _Cuts:
    """K of every problem, made smaller. Shear bounds cut the cones where they begin to leave them."""
    friction = scaled.friction * (1.0 - shrink)
    shear = np.minimum(scaled.like.force_max[:, 1:], -scaled.like.force_min[:, 1:]).min(axis=1)
    top = np.minimum(scaled.like.force_max[:, 0], shear / np.maximum(friction, 1e-12))
    own = np.broadcast_to(scaled.like.com, (len(toes), 1, 3))
    centres = np.concatenate([toes - scaled.like.shoulders, own], axis=1)
    radii = np.append(scaled.like.reach, scaled.like.com_radius) * (1.0 - shrink)
    return _Cuts(centres=centres, radii=radii, friction=friction, top=top * (1.0 - shrink))


def _balances(scaled: ScaledBatch, toes: Array) -> tuple[Array, Array]:
    """A = {x: G x = w e_3} of every problem, as P_A z = M z + x_0; shape (B, 3 + 3N, 3 + 3N) and (B, 3 + 3N)."""
    count, contacts = scaled.friction.shape
    rows = np.zeros((count, 6, 3 + 3 * contacts))
    rows[:, :3, 3:] = _side_by_side(scaled.frames)
    rows[:, 3:, 3:] = _side_by_side(np.matmul(skew(toes), scaled.frames))
    rows[:, 3, 1], rows[:, 4, 0] = -scaled.like.weight, scaled.like.weight  # −w c × e_z
    across = rows.transpose(0, 2, 1)
    inverse = np.linalg.inv(np.matmul(rows, across) + 1e-12 * np.eye(6))
    right = np.matmul(across, inverse)
    return np.eye(rows.shape[2]) - np.matmul(right, rows), scaled.like.weight * right[:, :, 2]


def _douglas_rachford(scaled: ScaledBatch, toes: Array) -> Iterator[tuple[int, Array, Array]]:
    """Index, c and f of every problem that the iteration ends for."""
    if not len(toes):
        return
    linear, offset = _balances(scaled, toes)
    small, whole = _cuts(scaled, toes, SHRINK), _cuts(scaled, toes, 0.0)
    live = np.arange(len(toes))
    z = np.zeros((len(toes), linear.shape[1]))
    z[:, :3] = scaled.like.com
    z[:, 3::3] = scaled.like.weight / toes.shape[1]
    for step in range(1, STEPS + 1):
        on = np.matmul(linear, z[..., None])[..., 0] + offset
        if step % LOOKS == 0:
            there = whole.hold(on)
            for k in np.flatnonzero(there):
                yield int(live[k]), on[k, :3], on[k, 3:].reshape(-1, 3)
            if there.any():
                left = ~there
                live, z, on, linear, offset = live[left], z[left], on[left], linear[left], offset[left]
                small, whole = small.select(left), whole.select(left)
            if not len(live):
                return
        z += small.project(2.0 * on - z) - on


def _side_by_side(blocks: Array) -> Array:
    """Blocks of shape (B, N, 3, 3) as maps of shape (B, 3, 3N)."""
    return blocks.transpose(0, 2, 1, 3).reshape(len(blocks), 3, -1)
