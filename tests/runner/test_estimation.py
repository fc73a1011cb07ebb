"""Where a robot is measured to stand: on its patches, on the terrain around them, on a border, or
nowhere.
"""

from __future__ import annotations

import numpy as np

from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain import Patch
from stancekit.runner.control.estimation import BORDER_M, estimate_standing
from stancekit.runner.worlds.world import State

ROBOT = hexapod()
KINEMATICS = Kinematics(ROBOT)
LIMBS = len(ROBOT.limbs)


def square(
    half_m: float, *, friction: float = 0.7, height_m: float = 0.0, middle_m: float = 0.0
) -> Patch:
    corners = half_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [
        middle_m,
        0.0,
        height_m,
    ]
    return Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=friction)


def stands(x_m: float, height_m: float = 0.0) -> State:
    """All feet at the same place, pressed height_m into the plane."""
    toes = np.tile([x_m, 0.0, height_m], (LIMBS, 1))
    joints = len(KINEMATICS.joints)
    return State(
        time_s=0.0,
        position_m=np.array([0.0, 0.0, 0.2]),
        rotation=np.eye(3),
        velocity=np.zeros(6),
        angles_rad=np.zeros(joints),
        rates_rad_s=np.zeros(joints),
        torques_nm=np.zeros(joints),
        feet_m=toes + KINEMATICS.radii_m[:, None] * [0.0, 0.0, 1.0],
        forces_n=np.tile([0.0, 0.0, 15.0], (LIMBS, 1)),
        bump_n=0.0,
        sent_rad=np.zeros(joints),
    )


WINDOW = (square(0.05),) * LIMBS
"""What a plan had under every foot: a part of the ground."""


def test_a_foot_on_its_patch_is_put_into_its_plane() -> None:
    found = estimate_standing(WINDOW, stands(0.03, -0.002), KINEMATICS, (square(1.0),))
    assert found is not None
    assert found.patches == WINDOW
    np.testing.assert_allclose(found.toes_m, np.tile([0.03, 0.0, 0.0], (LIMBS, 1)), atol=1e-12)


def test_a_foot_that_slid_beyond_its_patch_stands_where_it_is_with_the_friction_that_is_there() -> (
    None
):
    ice = square(0.1, friction=0.2, middle_m=0.15)
    below = square(1.0, height_m=-0.05)
    found = estimate_standing(WINDOW, stands(0.062), KINEMATICS, (below, square(0.05), ice))
    assert found is not None
    assert found.patches == (ice,) * LIMBS
    np.testing.assert_allclose(found.toes_m, np.tile([0.062, 0.0, 0.0], (LIMBS, 1)), atol=1e-12)


def test_a_foot_a_little_beyond_all_terrain_is_on_the_border_and_one_farther_off_nowhere() -> None:
    found = estimate_standing(
        WINDOW,
        stands(0.05 + 0.5 * BORDER_M),
        KINEMATICS,
        (square(0.05), square(1.0, height_m=-0.3)),
    )
    assert found is not None
    np.testing.assert_allclose(found.toes_m[:, 0], 0.05)
    assert (
        estimate_standing(WINDOW, stands(0.05 + 1.5 * BORDER_M), KINEMATICS, (square(0.05),))
        is None
    )
