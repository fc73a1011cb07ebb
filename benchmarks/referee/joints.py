"""Joints along a reference by inverse kinematics of its own, and the torque that the file's forces
ask for.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .body import Body
from .reference import Reference, cross, rotation_between

Array = NDArray[np.float64]
FORGET_S = 0.05
"""In the air balls forget by how much they had rolled, with this time constant."""
NEAR_M, MOST_ROUNDS, FIRST_ROUNDS = 2e-5, 8, 200
"""Feet are found to within this, in so many rounds; in more where a motion begins."""
DAMPED, WARY, STEP_RAD, DRAWN = 1e-6, 1e-4, 0.3, 0.3
"""Damping of the least squares, the same in feedback; the largest turn of a joint per round; how
much of the way to its reference a leg with more than three joints goes where that does not move its
foot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Commands:
    """Positions, velocities and feed-forward torques at T moments; balls roll on the ground while
    they stand.

    Attributes:
        positions: of all of MuJoCo's coordinates, shape (T, nq).
        velocities: shape (T, nv).
        torques: of the legs' joints, shape (T, J) [Nm] or [N].
        missed_m: farthest that a foot is from where it should be [m].
    """

    positions: Array
    velocities: Array
    torques: Array
    missed_m: float


def commands(body: Body, reference: Reference) -> Commands:
    """Joints and torques for a reference, on the body as the file has it."""
    solver, model = Solver(body), body.model
    moments = len(reference.com_m)
    positions, rolls = np.empty((moments, model.nq)), Rolls(body)
    balls = np.empty_like(reference.centres_m)
    names = [name for leg in body.robot.legs for name in leg.joints]
    near = [
        np.array([reference.near[name][t] for name in names]) if reference.near else None
        for t in range(moments)
    ]
    last, missed = _standing(body, reference), 0.0
    if near[0] is not None:
        last[body.places] = near[0]
    for t in range(moments):
        rounds = MOST_ROUNDS if t else FIRST_ROUNDS
        balls[t] = reference.centres_m[t] + rolls.shifts_m
        last, off = solver.solve(
            last, reference.com_m[t], reference.turn[t], balls[t], near[t], rounds
        )
        positions[t], missed = last, max(missed, off)
        rolls.add(solver.data, reference.normals[t], reference.stands[t], reference.step_s)
    velocities = _rates(model, positions, reference.step_s)
    accelerations = np.zeros_like(velocities)
    if reference.dynamic:
        accelerations = _smoothed(np.gradient(velocities, reference.step_s, axis=0))
    torques = np.array(
        [
            solver.torques(
                positions[t],
                velocities[t],
                accelerations[t],
                reference.forces_n[t],
                balls[t] - body.radii_m[:, None] * reference.normals[t],
            )
            for t in range(moments)
        ]
    )
    return Commands(positions=positions, velocities=velocities, torques=torques, missed_m=missed)


class Rolls:
    """By how much balls have rolled since they touched, shape (N, 3) [m].

    A leg that turns by θ about its foot moves the ball's centre by θ × r n. In the air that is
    forgotten, and a foot comes down where the file has it.
    """

    def __init__(self, body: Body) -> None:
        self._body, self._before = body, list[Array]()
        self.shifts_m = np.zeros((len(body.feet), 3))

    def add(
        self, data: mujoco.MjData, normals: Array, stands: NDArray[np.bool_], step_s: float
    ) -> None:
        """Go on to the posture of ``data``."""
        now = [data.xquat[foot].copy() for foot in self._body.feet]
        for foot, (before, after) in enumerate(zip(self._before, now, strict=False)):
            if stands[foot]:
                turn = rotation_between(after, before)
                self.shifts_m[foot] += cross(turn, self._body.radii_m[foot] * normals[foot])
            else:
                self.shifts_m[foot] *= 1.0 - step_s / FORGET_S
        self._before = now


class Solver:
    """Inverse kinematics and dynamics of a body in memory of its own."""

    def __init__(self, body: Body) -> None:
        self.body, self.data = body, mujoco.MjData(body.model)
        self._jacobian = np.zeros((3, body.model.nv))
        joints = [body.model.joint(name) for leg in body.robot.legs for name in leg.joints]
        ranges = np.array([body.model.jnt_range[joint.id] for joint in joints])
        limited = np.array([bool(body.model.jnt_limited[joint.id]) for joint in joints])
        self._low = np.where(limited, ranges[:, 0], -np.inf)
        self._high = np.where(limited, ranges[:, 1], np.inf)

    def solve(
        self,
        begin: Array,
        com_m: Array,
        turn: Array,
        centres_m: Array,
        near: Array | None,
        rounds: int,
    ) -> tuple[Array, float]:
        """Positions with the centre of mass, the body's rotation and the balls there; and how far
        feet miss [m].
        """
        body, data, model = self.body, self.data, self.body.model
        data.qpos[:] = begin
        data.qpos[3:7] = turn
        for _ in range(rounds):
            self._place(com_m)
            if self._missed(centres_m) < NEAR_M:
                break
            for leg, places in enumerate(body.legs):
                self._move(leg, centres_m[leg], near, places)
        data.qpos[body.places] = np.clip(data.qpos[body.places], self._low, self._high)
        self._place(com_m)
        mujoco.mj_normalizeQuat(model, data.qpos)
        return data.qpos.copy(), self._missed(centres_m)

    def _place(self, com_m: Array) -> None:
        """Move the base so that the centre of mass is there."""
        body, data = self.body, self.data
        mujoco.mj_kinematics(body.model, data)
        mujoco.mj_comPos(body.model, data)
        data.qpos[:3] += com_m - data.subtree_com[body.base]
        mujoco.mj_kinematics(body.model, data)
        mujoco.mj_comPos(body.model, data)

    def _missed(self, centres_m: Array) -> float:
        off = centres_m - self.data.geom_xpos[list(self.body.balls)]
        return float(np.linalg.norm(off, axis=1).max())

    def _move(self, leg: int, centre_m: Array, near: Array | None, its: NDArray[np.int64]) -> None:
        body, data = self.body, self.data
        ball = data.geom_xpos[body.balls[leg]]
        slope = self.slope(data, leg, ball)[:, body.rates[its]]
        inverse = _inverse(slope, DAMPED)
        change = inverse @ (centre_m - ball)
        if near is not None and len(its) > 3:
            drawn = DRAWN * (near[its] - data.qpos[body.places[its]])
            change += drawn - inverse @ (slope @ drawn)
        data.qpos[body.places[its]] += np.clip(change, -STEP_RAD, STEP_RAD)

    def towards(self, data: mujoco.MjData, leg: int, point_m: Array, way_m: Array) -> Array:
        """The turn of a leg's joints that moves a point of its foot by a small way, shape (n,)."""
        slope = self.slope(data, leg, point_m)[:, self.body.rates[self.body.legs[leg]]]
        return np.clip(_inverse(slope, WARY) @ way_m, -STEP_RAD, STEP_RAD)

    def slope(self, data: mujoco.MjData, leg: int, point_m: Array) -> Array:
        """Jacobian of a point of a foot, shape (3, nv); overwritten by the next."""
        mujoco.mj_jac(self.body.model, data, self._jacobian, None, point_m, self.body.feet[leg])
        return self._jacobian

    def torques(
        self, positions: Array, rates: Array, accelerations: Array, forces_n: Array, points_m: Array
    ) -> Array:
        """τ = M a + bias − Jᵀ f of the legs' joints, shape (J,)."""
        body, data, model = self.body, self.data, self.body.model
        data.qpos[:], data.qvel[:], data.qacc[:] = positions, rates, accelerations
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 1, found)
        found += model.dof_armature * accelerations
        for leg in range(len(body.legs)):
            found -= self.slope(data, leg, points_m[leg]).T @ forces_n[leg]
        return np.asarray(found[body.rates])


def _inverse(slope: Array, damped: float) -> Array:
    """The damped pseudo-inverse of a leg's Jacobian, shape (n, 3)."""
    return np.asarray(np.linalg.solve(slope @ slope.T + damped * np.eye(3), slope).T)


def _standing(body: Body, reference: Reference) -> Array:
    positions = body.model.qpos0.copy()
    positions[body.places] = np.concatenate([leg.stance for leg in body.robot.legs])
    positions[:3], positions[3:7] = reference.com_m[0], reference.turn[0]
    return np.asarray(positions)


def _rates(model: mujoco.MjModel, positions: Array, step_s: float) -> Array:
    found = np.zeros((len(positions), model.nv))
    for t in range(len(positions)):
        one, two = max(t - 1, 0), min(t + 1, len(positions) - 1)
        span = step_s * max(two - one, 1)
        mujoco.mj_differentiatePos(model, found[t], span, positions[one], positions[two])
    return found


def _smoothed(columns: Array, half: int = 3) -> Array:
    """The mean over a few moments."""
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    padded = np.pad(columns, ((half, half), (0, 0)), mode="edge")
    return np.apply_along_axis(lambda column: np.convolve(column, kernel, "valid"), 0, padded)
