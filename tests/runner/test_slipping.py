"""The simulated faults of the ground do what they say: a slipping foot has no friction, the others
go on as before.
"""

import numpy as np
import pytest

from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain import Patch
from tests.emulators.slipping import FAULTS, SlippingWorld
from tests.refusals import refuses

ROBOT = hexapod()
STANDING = np.tile([0.0, 0.3, 0.0, 1.2], len(ROBOT.limbs))
SPREAD = STANDING + np.tile([0.0, -0.06, 0.0, 0.0], len(ROBOT.limbs))
"""Targets that press the feet outwards against the ground."""


def ground(friction: float) -> Patch:
    corners = 2.0 * np.array(
        [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    )
    axes = {"normal": np.array([0.0, 0.0, 1.0]), "shear_reference": np.array([1.0, 0.0, 0.0])}
    return Patch(vertices_m=corners, friction=friction, **axes)


def shares(world: SlippingWorld, periods: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Tangential over normal force of every foot, and how far each slid, mean and end of the last
    half.
    """
    feet = Kinematics(ROBOT).feet(STANDING)
    height = 0.012 - float(feet[:, 2].min())
    first = world.reset((ground(0.8),), STANDING, np.array([0.0, 0.0, height]), np.eye(3))
    states = [world.step(SPREAD) for _ in range(periods)]
    forces = np.mean([state.forces_n for state in states[periods // 2 :]], axis=0)
    slid = np.linalg.norm((states[-1].feet_m - first.feet_m)[:, :2], axis=1)
    return np.linalg.norm(forces[:, :2], axis=1) / np.maximum(forces[:, 2], 1e-9), slid


def test_a_foot_that_slips_has_no_more_friction_than_it_is_left_with_and_the_others_have_theirs() -> (
    None
):
    with SlippingWorld(ROBOT, limb=1) as world:
        before, _ = shares(world)
    with SlippingWorld(ROBOT, limb=1) as world:
        world.inject("foot slips", 0.1)
        after, slid = shares(world)
        assert world.happened_s == pytest.approx(0.1, abs=0.006)
    assert before.min() > 0.05
    assert after[1] < 0.03
    assert slid[1] == slid.max()
    assert np.delete(after, 1).min() > 0.05


def test_friction_that_differs_bounds_all_feet() -> None:
    with SlippingWorld(ROBOT, share=0.01) as world:
        world.inject("friction differs", 0.1)
        after, _ = shares(world)
    assert after.max() < 0.01


def test_an_unknown_fault_is_refused() -> None:
    with (
        SlippingWorld(ROBOT) as world,
        refuses(*FAULTS, kind=ValueError),
    ):
        world.inject("earthquake")
