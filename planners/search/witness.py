"""Witnesses for a batch of posture problems at a time, in numpy alone: a fixed iteration from a
fixed start.

A posture problem in x = (λ, c, Θ, u, f), with toes q_i = Σ_u λ_iu v_iu (E1) and legs u_i = q_i − c
− (I + [Θ]×) s_i, is the intersection of two sets. K has a projection in closed form: simplices of
λ, the ball of c, the box of Θ, the balls ‖u_i‖ ≤ ρ_i (E11), and friction cones cut off where the
force boxes end (E10). A is affine but for the moments,

    Σ C_i f_i = b  (E5),    Σ q_i × C_i f_i − c × b + M = 0  (E6),    b = w e_z − F,

with F and M the force and the moment on the body beside its weight, and these are linearised about
the toes and forces that the iteration is at, anew every few steps. Douglas–Rachford is z ← z +
P_K(2 P_A z − z) − P_A z. It ends for a problem as soon as c and f, put on the balances with the
toes held, lie in K. What is found is a claim, for the verifier to decide; what is not found says
nothing. No solver takes part and no problem hears of another, so a claim follows from its problem
alone.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..answer.answer import Answer, Status
from ..answer.plan import Plan
from ..answer.report import LATE
from ..arguments import cached_property
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.layout import Index
from ..equilibrium.scaled import skew
from ..errors import InvalidInput, TimeEnded, check_time
from ..files.arrays import Array, lengths
from ..projection.whole_body import WholeBodyLimits, whole_body
from ..robot.kinematics import Kinematics
from ..verify import Report, check_plan
from ..verify.geometry import LEAST_PUSH, tipping
from .answer import objective_of

LOG = logging.getLogger(__name__)


def with_whole_body(
    outcome: Answer[Plan],
    limits: WholeBodyLimits = WholeBodyLimits(),
    start_rad: Array | None = None,
    *,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """The outcome with joint angles in its plan, with torques within the limits where such a plan
    is found, and with the verifier's report on all of it.

    Where the joints cannot do it, or bodies collide, the course is undecided, with the reason and
    the plan: nothing is proved of others. So it is where the time ended before all was judged. The
    outcome as it is where there is no plan; no joints, where no torque is asked for, for a robot
    without a file whose legs are not known, or without pinocchio.

    Arguments:
        start_rad: those of a robot that stands already where the plan begins, as for
            ``plan_angles``, shape (J,).
        deadline: when it is wanted (``time.perf_counter()``).

    Raises:
        InvalidInput: where these are needed.
    """
    if outcome.solution is None:
        return outcome
    plan, details, course, bent = (
        outcome.solution,
        dict(outcome.details),
        outcome.solution.problem,
        True,
    )
    report: Report[Plan] | None = None
    try:
        check_time(deadline)
        solver = Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
        result = whole_body(plan, limits, solver, start_rad, deadline=deadline)
        plan, report, details, bent = (
            result.plan,
            result.report,
            details | result.details,
            not result.late,
        )
    except TimeEnded:
        bent = False
    except InvalidInput:
        if limits.concern(course.robot):
            raise
    LOG.info("plan: bent in %g steps", details.get("torque_steps", 0.0))
    return judged(
        replace(outcome, solution=plan, details=details),
        report,
        bent=bent,
        deadline=deadline,
    )


def judged(
    outcome: Answer[Plan],
    report: Report[Plan] | None = None,
    *,
    bent: bool = True,
    deadline: float = math.inf,
) -> Answer[Plan]:
    """The outcome with the verifier's report on all of its plan, which decides its status.

    Arguments:
        report: what the verifier said of the plan already, if it was asked.
        bent: whether there was time to bend the plan.
    """
    plan = outcome.solution
    assert plan is not None
    report = report or check_plan(
        plan, joints=True, deadline=deadline
    )  # which nothing was asked of yet
    LOG.info("plan: %s", report.message)
    undecided = not report.accepted or report.late
    on_a_line = len(plan.problem.robot.limbs) < 3 and not plan.problem.has_soles
    # no stance on a line bears a push: its plan is one of balance alone, which ``run`` refuses
    tips = "" if undecided or on_a_line else tipping(plan, LEAST_PUSH)
    return replace(
        outcome,
        status=Status.UNDECIDED if undecided or tips else outcome.status,
        message=tips or (_reason(report, bent=bent) if undecided else outcome.message),
        objective=objective_of(plan),
        residual=report.worst,
        report=report,
    )


def _reason(report: Report[Plan], *, bent: bool) -> str:
    """Why a plan is not accepted, or not yet.

    Arguments:
        bent: whether there was time for that.
    """
    if not report.contacts:
        return report.message
    late = ""
    if report.late:
        late = f"{LATE} before {', '.join(report.unchecked)} could be judged, contacts hold"
    elif not bent:
        late = f"{LATE} before the plan could be bent any further"
    return "; ".join(filter(None, (report.failures, late)))


_LOOKS = 8
"""Steps between two looks at who is there, after each of which the moments are linearised anew."""
_SHRINK = 1e-3
"""K is made smaller by this share, so that the iteration ends inside of it."""
_INSIDE = 1e-9
_SPREAD, _TURN = 0.25, 0.3
"""Units of λ and Θ in which x is measured: smaller ones let toes and body move sooner than
forces."""


def witnesses(scaled: ScaledBatch, steps: int, *, moments: bool = True) -> tuple[Index, PointBatch]:
    """Claimed points for problems of a batch, by their indices, ascending; there is none where more
    steps are needed.

    Arguments:
        moments: False for points of P̄, in which moments need not balance.
    """
    return Iteration(scaled, moments=moments).claims(steps)


class Iteration:
    """Douglas–Rachford for a batch, as far as it has come: it can be gone on with, for all that is
    left or for some.

    Arguments:
        moments: False for points of P̄, in which moments need not balance. index: of the problems
            that are left, ascending.
        scaled: all of them.
    """

    def __init__(self, scaled: ScaledBatch, *, moments: bool = True) -> None:
        self.scaled, self._step = scaled, 0
        self.index, self._sets = np.arange(len(scaled)), _Sets.of(scaled)
        self._z = self._sets.start()
        self._moments = (
            self._sets.linearised(self._z, self._sets.toes(self._z)) if moments else None
        )

    def keep(self, index: Index) -> None:
        """Go on with these problems alone, of those that are left."""
        places = np.flatnonzero(np.isin(self.index, index))
        self.index, self._sets, self._z = (
            self.index[places],
            self._sets.select(places),
            self._z[places],
        )
        self._moments = self._moments and self._moments.select(places)

    def claims(self, until: int) -> tuple[Index, PointBatch]:
        """Indices, ascending, and points of the problems that the iteration ends for until it has
        taken so many steps.

        A problem that it has ended for is not left any more.
        """
        points_found = [(self.index[:0], PointBatch.none(self.scaled.friction.shape[1]))]
        while self._step < until and len(self.index):
            points_found += self._step_on()
        index = np.concatenate([index for index, _ in points_found])
        order = np.argsort(index)
        return index[order], PointBatch.joined([points for _, points in points_found]).select(order)

    def _step_on(self) -> Iterator[tuple[Index, PointBatch]]:
        """Take a step; indices and points of the problems that the iteration ends for with it."""
        self._step += 1
        on = self._sets.balance(self._z, self._moments)
        if self._step % _LOOKS == 0:
            points = self._sets.with_toes_held(on, self._moments is not None)
            there, toes = self._sets.hold(points), points.toes
            if there.any():
                yield self.index[there], points.select(there)
                left = np.flatnonzero(~there)
                self.index, self._sets, self._z = (
                    self.index[left],
                    self._sets.select(left),
                    self._z[left],
                )
                if not len(left):
                    return
                on, toes = on[left], toes[left]
            if self._moments is not None:
                self._moments = self._sets.linearised(on, toes)
                on = self._sets.balance(self._z, self._moments)
        self._z += self._sets.project(2.0 * on - self._z) - on


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
        """Other rows, shape (B, ·, D), with their part in the span of these rows removed."""
        return np.asarray(others - np.matmul(np.matmul(others, self.back), self.rows))

    def select(self, chosen: Index) -> _Rows:
        """Some of them, by index."""
        return _Rows(self.rows[chosen], self.right[chosen], self.back[chosen])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sets:
    """A and K of the problems that are left; x is (λ, Θ, c − c_0, u, f), the first two in their
    units.

    Arguments:
        low, high: where cones begin and end, shape (N,) and (B, N).
        legs, weight: what makes up A but for the moments, the rows of u and of Σ C_i f_i.
    """

    scaled: ScaledBatch
    low: Array
    high: Array
    legs: _Rows
    weight: _Rows

    @classmethod
    def of(cls, scaled: ScaledBatch) -> _Sets:
        """Sets of all problems of a batch.

        Shear bounds cut the cones where they begin to leave them.
        """
        like, lifting = scaled.like, _side_by_side(scaled.frames)
        shear = np.minimum(like.force_max[:, 1:], -like.force_min[:, 1:]).min(axis=1)
        high = np.minimum(like.force_max[:, 0], shear / np.maximum(scaled.friction, 1e-12))
        right = np.tile(like.borne, (len(scaled), 1))
        return cls(
            scaled=scaled,
            low=np.maximum(like.force_min[:, 0], 0.0),
            high=high,
            legs=_legs(scaled),
            weight=_Rows(
                lifting, right, lifting.swapaxes(1, 2) / scaled.friction.shape[1]
            ),  # Σ C_i C_i' = N
        )

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Slices of λ, Θ, (c − c_0, u) and f in x."""
        _, contacts, corners, _ = self.scaled.vertices.shape
        ends = np.cumsum([0, contacts * corners, 3, 3 + 3 * contacts, 3 * contacts]).tolist()
        return tuple(slice(begin, end) for begin, end in itertools.pairwise(ends))

    @cached_property
    def radii(self) -> Array:
        """Radii of the balls of c and u, made smaller, shape (N + 1,)."""
        return np.append(self.scaled.like.com_radius, self.scaled.like.reach) * (1.0 - _SHRINK)

    @cached_property
    def cones(self) -> tuple[Array, Array, Array, Array]:
        """μ, 1 + μ², and where cones begin and end, all of them made smaller, (B, N), but (N,)
        where they begin.
        """
        friction = self.scaled.friction * (1.0 - _SHRINK)
        return (
            friction,
            1.0 + friction * friction,
            self.low * (1.0 + _SHRINK),
            self.high * (1.0 - _SHRINK),
        )

    def start(self) -> Array:
        """Toes in the middle of their patches, the nominal c, no tilt, equal shares of the weight
        along the normals.
        """
        count, contacts, corners, _ = self.scaled.vertices.shape
        weights, _, balls, forces = self.parts
        z = np.zeros((count, forces.stop))
        z[:, weights] = _SPREAD / corners
        away = self.scaled.vertices.mean(axis=2) - self.scaled.like.com - self.scaled.like.shoulders
        z[:, balls.start + 3 : balls.stop] = away.reshape(count, 3 * contacts)
        z[:, forces][:, ::3] = self.scaled.like.weight / contacts
        return z

    def balance(self, z: Array, moments: _Rows | None) -> Array:
        """P_A.

        Arguments:
            moments: as they are linearised, where they have to balance.
        """
        on, forces = z.copy(), self.parts[3]
        self.legs.meet(on[:, : forces.start])
        self.weight.meet(on[:, forces])
        if moments is not None:
            moments.meet(on)
        return on

    def linearised(self, x: Array, toes: Array) -> _Rows:
        """The moments about x, with its toes q̄: Σ q × F̄ + Σ q̄ × F − c × b + M = Σ q̄ × F̄."""
        scaled, (weights, _, balls, forces) = self.scaled, self.parts
        force = _times(scaled.frames, self._vectors(x, forces))
        rows, arms = np.zeros((len(x), 3, x.shape[1])), skew(toes)
        rows[:, :, forces] = _side_by_side(np.matmul(arms, scaled.frames))
        rows[:, :, weights] = _side_by_side(
            np.matmul(skew(force), scaled.vertices.swapaxes(2, 3) / -_SPREAD)
        )
        right = _times(arms, force).sum(axis=1) + _of_weight(scaled, rows, balls.start)
        free = np.concatenate(
            [self.legs.along(rows[:, :, : forces.start]), self.weight.along(rows[:, :, forces])],
            axis=2,
        )
        return _Rows(rows, right, _back(free))

    def project(self, x: Array) -> Array:
        """P_K, made smaller; x, shape (B, D), is overwritten."""
        weights, turn, balls, forces = self.parts
        _to_simplex(x[:, weights].reshape(self.scaled.vertices.shape[:3]), _SPREAD)
        tilt, (friction, steep, low, high) = (
            _TURN * self.scaled.like.tilt * (1.0 - _SHRINK),
            self.cones,
        )
        turned = x[:, turn]
        np.minimum(np.maximum(turned, -tilt, out=turned), tilt, out=turned)
        away, f = self._vectors(x, balls), self._vectors(x, forces)
        away *= np.minimum(1.0, self.radii / np.maximum(lengths(away), 1e-300))[..., None]
        normal, shear = f[..., 0], lengths(f[..., 1:])
        onto = np.where(shear <= friction * normal, normal, (normal + friction * shear) / steep)
        np.minimum(np.maximum(onto, low, out=onto), high, out=normal)
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
        right[:, :3] = scaled.like.borne
        if moments:
            rows[:, 3:, 3:] = _side_by_side(np.matmul(skew(toes), scaled.frames))
            right[:, 3:] = _of_weight(scaled, rows[:, 3:], 0)
        y -= _times(_back(rows), _times(rows, y) - right)
        tilt = scaled.like.tilt * (1.0 - _SHRINK)
        rotation = np.minimum(np.maximum(x[:, turn] / _TURN, -tilt), tilt)
        return PointBatch(
            com=y[:, :3] + scaled.like.com,
            rotation=rotation,
            toes=toes,
            forces=self._vectors(y, slice(3, None)),
        )

    def hold(self, points: PointBatch) -> NDArray[np.bool_]:
        """Tell whether points with their toes on their patches lie in K, shape (B,)."""
        like, normal = self.scaled.like, points.forces[..., 0]
        cones = lengths(points.forces[..., 1:]) <= self.scaled.friction * normal - _INSIDE
        cones &= (normal >= self.low + _INSIDE) & (normal <= self.high - _INSIDE)
        legs = lengths(points.legs(like)) <= like.reach - _INSIDE
        body = (lengths(points.com - like.com) <= like.com_radius - _INSIDE) & (like.tilt > 0.0)
        return np.asarray(cones.all(axis=1) & legs.all(axis=1) & body)

    def toes(self, x: Array) -> Array:
        """q of the nearest λ, so that they are on their patches, shape (B, N, 3)."""
        shares = x[:, self.parts[0]].reshape(self.scaled.vertices.shape[:3]) / _SPREAD
        _to_simplex(shares, 1.0)
        return _times(self.scaled.vertices.swapaxes(2, 3), shares)

    def select(self, chosen: Index) -> _Sets:
        """Some of them, by index."""
        return _Sets(
            scaled=self.scaled.select(chosen),
            low=self.low,
            high=self.high[chosen],
            legs=self.legs.select(chosen),
            weight=self.weight.select(chosen),
        )

    def _vectors(self, x: Array, part: slice) -> Array:
        """A part of x as vectors, shape (B, ·, 3): a view."""
        flat = x[:, part]
        return flat.reshape(len(x), flat.shape[1] // 3, 3)


def _legs(scaled: ScaledBatch) -> _Rows:
    """u_i = q_i − c − (I + [Θ]×) s_i as rows of x without f, 3N of them."""
    count, contacts, corners, _ = scaled.vertices.shape
    body, size = contacts * corners, 3 * contacts
    rows, at = np.zeros((count, size, body + 6 + size)), np.arange(size)
    for i in range(contacts):
        columns = slice(3 * i, 3 * i + 3)
        rows[:, columns, corners * i : corners * (i + 1)] = (
            scaled.vertices[:, i].transpose(0, 2, 1) / _SPREAD
        )
        rows[:, columns, body : body + 3] = skew(scaled.like.shoulders[i]) / _TURN  # −Θ × s = s × Θ
    rows[:, at, body + 3 + at % 3] = rows[:, at, body + 6 + at] = -1.0
    right = np.tile((scaled.like.com + scaled.like.shoulders).ravel(), (count, 1))
    return _Rows(rows, right, _back(rows))


def _of_weight(scaled: ScaledBatch, rows: Array, column: int) -> Array:
    """Add −(c − c_0) × b to rows of moments, c − c_0 at this column; c_0 × b − M, for the right
    side.
    """
    borne, com = scaled.like.borne[0], scaled.like.com[0]
    rows[:, :, column : column + 3] = skew(borne)
    return np.asarray(skew(com) @ borne - scaled.like.twisted[0])


def _back(rows: Array) -> Array:
    """R' (R R')⁻¹, shape (B, D, R)."""
    across = rows.transpose(0, 2, 1)
    inverse = np.linalg.inv(np.matmul(rows, across) + 1e-12 * np.eye(rows.shape[1]))
    return np.asarray(np.matmul(across, inverse))


def _to_simplex(x: Array, total: float) -> None:
    """Move x to the nearest point with entries ≥ 0 and this sum along the last axis (Held, Wolfe
    and Crowder, 1974).

    That axis is short, and is sorted and summed up column by column.
    """
    largest = [x[..., k] for k in range(x.shape[-1])]
    for end in range(len(largest) - 1, 0, -1):
        for k in range(end):
            pair = largest[k], largest[k + 1]
            largest[k], largest[k + 1] = np.maximum(*pair), np.minimum(*pair)
    above = largest[0]
    level = above - total
    for count, entry in enumerate(largest[1:], 2):
        above = above + entry
        level = np.maximum(level, (above - total) / count)
    x -= level[..., None]
    np.maximum(x, 0.0, out=x)


def _times(matrices: Array, vectors: Array) -> Array:
    """M v along the last axes."""
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])


def _side_by_side(blocks: Array) -> Array:
    """Blocks of shape (B, N, 3, K) as maps of shape (B, 3, N K)."""
    count, contacts, rows, columns = blocks.shape
    return blocks.transpose(0, 2, 1, 3).reshape(count, rows, contacts * columns)
