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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.scaled import Scaled, skew
from ..files.arrays import Array

DECREMENT = 1e-12
"""Squared Newton decrement before the last step, which squares it again."""
STEPS, HALVINGS = 60, 30
"""Most Newton steps, and most halvings of one."""
LESS = 0.1
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
    for _ in range(STEPS):
        if not len(index):
            break
        by_body, by_forces, decrement = at.newton(body, forces)
        last = decrement < DECREMENT
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
        for _ in range(HALVINGS):
            there = self.value(
                body + share[:, None] * by_body, forces + share[:, None, None] * by_forces
            )
            short = np.flatnonzero(
                ~(there <= value - LESS * share * decrement + 1e-13 * np.abs(value))
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
