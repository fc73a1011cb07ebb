"""Rotations of many vectors at once: SciPy's to the last bit, and the way between two."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from stancekit.planners.robot.leg import between_rotations, rotations_of


def test_rotations_are_those_of_scipy_to_the_last_bit() -> None:
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-5, 1e-3, 0.1, 1.0, 3.0):
        vectors = size * rng.normal(size=(500, 3))
        assert np.array_equal(rotations_of(vectors), Rotation.from_rotvec(vectors).as_matrix())


def test_between_two_rotations_a_robot_turns_evenly() -> None:
    rng = np.random.default_rng(6)
    for size in (0.0, 1e-9, 0.01, 1.0):
        first = Rotation.from_rotvec(rng.normal(size=3))
        both = Rotation.concatenate(
            [first, first * Rotation.from_rotvec(size * np.array([0.6, 0.0, -0.8]))]
        )
        share = np.array([0.0, 0.3, 1.0])
        ends = (np.repeat(end[None], 3, axis=0) for end in both.as_matrix())
        np.testing.assert_allclose(
            between_rotations(*ends, share), Slerp([0, 1], both)(share).as_matrix(), atol=1e-14
        )
