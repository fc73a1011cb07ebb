"""The expert of paper E §IV-A: envelopes by rule of thumb, and the rule that says where each of them belongs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.problem.posture import GRAVITY_M_S2
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.robot import Robot, hexapod

from .distributions.postures import MAX_TILT_RAD, THREE_LEGS

CLIMBING = ((0.0, 0.9), (-0.3, 0.3), (0.0, 0.4))
"""Bounds on f_n, f_y and the vertical shear f_z on a wall, in units of the robot's weight (paper E §IV-A)."""
WALKING = ((0.0, 0.5), (-0.15, 0.15), (-0.15, 0.15))
"""The same on the ground."""
LENGTH_SCALE_M = 0.6
_LEAST = float(np.cos(MAX_TILT_RAD))


def expert_envelopes(
    terrain: Literal["ground", "wall"], robot: Robot | None = None, legs: tuple[str, ...] = THREE_LEGS
) -> EnvelopeSet:
    """One envelope for these legs on the ground, or on two facing walls, up to 30° off: p within the limbs' workspace,
    f within WALKING or CLIMBING."""
    robot = robot or hexapod()
    limbs = robot.select(legs)
    force = np.array([CLIMBING if terrain == "wall" else WALKING] * len(limbs))
    shoulders = np.array([limb.shoulder_m for limb in limbs])
    reach = np.array([[limb.reach_m] for limb in limbs])
    inward = np.where(shoulders[:, 1] < 0.0, 1.0, -1.0)
    walls = np.column_stack([0.0 * inward, inward, 0.0 * inward])
    return EnvelopeSet(
        problem_class=f"{terrain}-{len(limbs)}",
        legs=tuple(legs),
        force_scale_n=robot.mass_kg * GRAVITY_M_S2,
        length_scale_m=LENGTH_SCALE_M,
        normals=walls if terrain == "wall" else np.tile([0.0, 0.0, 1.0], (len(limbs), 1)),
        tilt_rad=np.full(len(limbs), MAX_TILT_RAD),
        envelopes=(
            Envelope(
                low=np.concatenate([(shoulders - reach) / LENGTH_SCALE_M, force[..., 0]], axis=1),
                high=np.concatenate([(shoulders + reach) / LENGTH_SCALE_M, force[..., 1]], axis=1),
            ),
        ),
        provenance={"method": "heuristic", "source": "paper E §IV-A"},
    )


class TerrainRule:
    """Chooses among Traverse-v0's planners by the slope of what carries the robot and of what it may stand on next."""

    def predict(
        self,
        observation: Mapping[str, NDArray[Any]],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.int64], Any]:
        """Return (planner, state): 1, walking, where all is ground, 2, climbing, where all are walls to the left and
        the right, up to 30° off either way, else 0, the lift.

        Arrays may have axes before their own, one index an environment.
        """
        limbs, horizon = observation["reach"].shape[-1], observation["path"].shape[-1] // 3
        offered = observation["offered"] > 0.0
        first = offered.reshape(*offered.shape[:-1], horizon, limbs, -1)[..., 0, :, :]
        stays = ~first.any(axis=-1)  # the other toes leave before the body moves

        def all_along(axis: int) -> NDArray[np.bool_]:
            coming, under = (np.abs(observation[name][..., axis::3]) >= _LEAST for name in ("normals", "footing"))
            return np.asarray((coming | ~offered).all(axis=-1) & (under | ~stays).all(axis=-1))

        return np.asarray(np.where(all_along(2), 1, np.where(all_along(1), 2, 0)), dtype=np.int64), state
