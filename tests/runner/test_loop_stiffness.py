"""How stiff loops are found to be, by loops whose stiffness is known."""

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import Servo
from stancekit.runner.control.tracker import FARTHEST, LoopStiffness
from stancekit.runner.worlds.drives import Drives
from stancekit.runner.worlds.world import State

PERIOD_S = 0.005


def drives() -> Drives:
    return Drives.of(hexapod(), Servo(), hexapod().source.legs(Servo()))


def state(sent: Array, angles: Array, rates: Array) -> State:
    no, still = np.zeros(3), np.zeros(6)
    return State(
        time_s=0.0,
        position_m=no,
        rotation=np.eye(3),
        velocity=still,
        angles_rad=angles,
        rates_rad_s=rates,
        torques_nm=angles,
        feet_m=np.zeros((6, 3)),
        forces_n=np.zeros((6, 3)),
        bump_n=0.0,
        sent_rad=sent,
    )


def found(
    loops: LoopStiffness,
    of: Drives,
    share: float,
    *,
    seconds: float,
    felt: bool = True,
    air: int = 0,
) -> float:
    """What is found of loops of this share; joints in the air, the first so many, say the
    contrary.
    """
    rng, stand = np.random.default_rng(2), np.arange(len(of.joints)) >= air
    for _ in range(round(seconds / PERIOD_S)):
        torque, rates = rng.normal(size=(2, len(stand))) * [[3.0], [0.5]]
        angles = rng.normal(size=len(stand))
        yields = torque + of.damping_nms_rad * rates
        sent = angles + yields / (np.where(stand, share, 1.0 / share) * of.stiffness_nm_rad)
        loops.see(state(sent, angles, rates), torque * felt, stand)
    return loops.share


@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_the_share_is_found_by_the_legs_that_stand(share: float) -> None:
    of = drives()
    loops = LoopStiffness(of, PERIOD_S, 5.0)
    assert loops.share == 1.0
    assert found(loops, of, share, seconds=6.0, air=8) == pytest.approx(share, abs=0.03)
    assert found(loops, of, 1.0, seconds=30.0) == pytest.approx(1.0, abs=0.01)  # the past fades


def test_forces_that_are_felt_late_say_little_at_first() -> None:
    of = drives()
    loops = LoopStiffness(of, PERIOD_S, 5.0)
    assert found(loops, of, 1.0, seconds=0.02, felt=False) > 0.85
    assert found(loops, of, 1.0, seconds=10.0, felt=False) == pytest.approx(
        1.0 / FARTHEST, abs=0.02
    )


def test_nothing_is_found_of_loops_that_are_not_asked_or_not_known() -> None:
    of = drives()
    assert found(LoopStiffness(of, PERIOD_S, 0.0), of, 0.7, seconds=1.0) == 1.0
    assert (
        found(LoopStiffness(replace(of, yields=False), PERIOD_S, 5.0), of, 0.7, seconds=1.0) == 1.0
    )
