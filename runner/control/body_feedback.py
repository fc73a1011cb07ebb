"""Body-pose feedback: what feet push with besides the plan's forces, because the body is not where it should be.

A wrench that pulls the body to its place, w = (m (k_p e_p + k_v ė_p), I (k_R e_R + k_ω ė_R)), is shared among the feet
that stand by least squares, Σ [1; r×] δf = w, and every foot's force is kept inside a part of its friction cone; what a
foot could not give the others are asked for again. The position loops of the joints stay beneath it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array, check_numbers

from ..motion.motion import MotionSample

ROUNDS = 4
"""How often what feet inside their cones cannot give is asked for again."""
EVEN = 1e-3
"""Weight of small forces against those that give the wrench."""
TURNING = 2.0
"""Weight of a moment [1/m] against a force."""


@dataclass(frozen=True, kw_only=True)
class BodyFeedback:
    """How a body is pulled to its place; all in units of its own mass and inertia.

    position_s2, velocity_s, rotation_s2, turn_s: k_p, k_v, k_R, k_ω; all 0 for no feedback. cone_share: of μ that
    forces may use. least_share: of the weight that a foot which stands presses with, at least. step_s: feet in the air
    step aside by what the body's velocity error makes in this time; for walks it is set by how high the robot stands.
    """

    position_s2: float = 80.0
    velocity_s: float = 18.0
    rotation_s2: float = 250.0
    turn_s: float = 30.0
    cone_share: float = 0.8
    least_share: float = 0.03
    step_s: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "body.", least=self.__annotations__)

    @property
    def acts(self) -> bool:
        """Is there any feedback?"""
        return any((self.position_s2, self.velocity_s, self.rotation_s2, self.turn_s))


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPose:
    """Of the base: origin, shape (3,) [m], R_WB, shape (3, 3), velocity, linear and angular in the world, (6,)."""

    origin_m: Array
    rotation: Array
    velocity: Array


class BodyController:
    """Forces of the feet for one robot. inertia_kgm2: of the whole robot in the base's frame, shape (3, 3)."""

    def __init__(self, mass_kg: float, inertia_kgm2: Array, weight_n: float, feedback: BodyFeedback) -> None:
        self._mass, self._inertia, self._weight, self._feedback = mass_kg, inertia_kgm2, weight_n, feedback

    def wrench(self, wanted: BodyPose, found: BodyPose) -> Array:
        """Force [N] and moment [Nm] on the body in the world, shape (6,)."""
        gains, turn = self._feedback, found.rotation
        late = wanted.velocity - found.velocity
        force = gains.position_s2 * (wanted.origin_m - found.origin_m) + gains.velocity_s * late[:3]
        away = Rotation.from_matrix(wanted.rotation @ turn.T).as_rotvec()
        moment = turn @ self._inertia @ turn.T @ (gains.rotation_s2 * away + gains.turn_s * late[3:])
        return np.concatenate([self._mass * force, moment])

    def forces(
        self, wrench: Array, sample: MotionSample, arms_m: Array, planned_n: Array, stands: NDArray[np.bool_]
    ) -> Array:
        """Forces of all feet, those of the plan and the wrench together, shape (N, 3) [N].

        arms_m: feet from the centre of mass, shape (N, 3), world frame. stands: who touches; others get what is
        planned.
        """
        if not stands.any():
            return planned_n
        arms = np.concatenate([np.concatenate([np.eye(3), TURNING * _skew(arm)]) for arm in arms_m[stands]], axis=1)
        wanted = wrench * np.array([1.0, 1.0, 1.0, TURNING, TURNING, TURNING])
        square = arms.T @ arms + EVEN * np.eye(arms.shape[1])
        planned, force = planned_n[stands], planned_n[stands]
        for _ in range(ROUNDS):
            lacks = wanted - arms @ (force - planned).ravel()
            step = np.linalg.solve(square, arms.T @ lacks).reshape(-1, 3)
            force = self._inside(force + step, sample, stands)
        found = np.array(planned_n)
        found[stands] = force
        return found

    def _inside(self, force: Array, sample: MotionSample, stands: NDArray[np.bool_]) -> Array:
        """The forces pressed onto the ground, and their tangential parts shortened into a part of the cones."""
        normals, friction = sample.normals[stands], sample.friction[stands]
        along = np.einsum("ni,ni->n", force, normals)
        across = force - along[:, None] * normals
        along = np.maximum(along, self._feedback.least_share * self._weight)
        size = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
        share = np.minimum(1.0, self._feedback.cone_share * friction * along / size)
        return np.asarray(along[:, None] * normals + share[:, None] * across)


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
