"""First contact with a bus that is not as it should be, and measurements that are not true: one
line each.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import joint_names
from stancekit.runner.worlds.dynamixel import control_table as table
from stancekit.runner.worlds.dynamixel import port as servo_port
from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal
from stancekit.runner.worlds.dynamixel.diagnosis import MeasurementJudge
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators.fast_time import FastTime
from tests.emulators.servo_bus import FAULTS, EmulatedBus
from tests.refusals import refuses

ROBOT = hexapod()
JOINTS = joint_names(ROBOT)
START = np.tile([0.2, 0.5, -0.3, 1.0], 6)
STILL = (), np.zeros(24), np.zeros(3), np.eye(3)
LATENCY_MS = 40.0


def calibrated(port: str) -> Calibration:
    return nominal(JOINTS, port=port, watchdog_s=0.6, latency_ms=LATENCY_MS)


@pytest.fixture
def bus() -> Iterator[EmulatedBus]:
    with EmulatedBus(range(1, 25), START.tolist()) as made:
        yield made


@pytest.fixture
def world(bus: EmulatedBus) -> Iterator[DynamixelWorld]:
    with DynamixelWorld(ROBOT, calibrated(bus.path)) as made:
        yield made


def happened(bus: EmulatedBus, fault: str) -> None:
    bus.inject(fault)
    while not bus.state()["happened"]:
        time.sleep(0.001)


REFUSED = {
    "silent servo 7": "servo 7 (LM_roll)",
    "corrupted packets": "servo 1 (LF_yaw)",
    "half packets": "servo 1 (LF_yaw)",
    "delay": "latency_ms",
    "input voltage 3": "servo 3 (LF_roll)",
    "overheating 3": "servo 3 (LF_roll)",
    "power loss": "power",
    "cable pulled": "port",
    "stuck bus": "bus",
    "same id 9": "servo 9 (LR_yaw)",
    "stale values 9": "servo 9 (LR_yaw)",
    "lying values 9": "servo 9 (LR_yaw)",
    "wrong baud": "57600",
    "wrong model 2": "servo 2 (LF_hip)",
}


MUTE = ("power loss", "wrong baud", "half packets", "corrupted packets")
"""Faults with which a host waits in vain, again and again."""


@pytest.mark.parametrize("fault", REFUSED)
def test_first_contact_names_what_is_wrong_and_nothing_moves(
    bus: EmulatedBus, world: DynamixelWorld, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    happened(bus, fault)
    if fault in MUTE:
        monkeypatch.setattr(servo_port, "time", FastTime())
    with refuses(REFUSED[fault]):
        world.reset(*STILL)
    seen = bus.state()
    assert (seen["goal_writes"], any(seen["torque"])) == (0, False)


TAKEN = (
    "corrupted packet",
    "echo",
    "garbage",
    "no fast sync read",
    "status return 0",
    "status return 1",
    "reboot 4",
)


@pytest.mark.parametrize("fault", TAKEN)
def test_what_is_odd_but_sound_is_taken_as_it_is(
    bus: EmulatedBus, world: DynamixelWorld, fault: str
) -> None:
    happened(bus, fault)
    state = world.reset(*STILL)
    np.testing.assert_allclose(state.angles_rad, START, atol=table.RAD)
    world.torque(True)
    for _ in range(5):
        state = world.step(START)
    world.hold()
    np.testing.assert_allclose(state.angles_rad, START, atol=2 * table.RAD)
    assert world.bus.fast == (fault != "no fast sync read")
    assert bus.state()["goal_writes"] == 6 * 24


def test_servos_whose_firmware_lacks_fast_sync_read_are_read_one_after_the_other() -> None:
    with (
        EmulatedBus(range(1, 25), START.tolist(), firmware=44) as bus,
        DynamixelWorld(ROBOT, calibrated(bus.path)) as world,
    ):
        world.reset(*STILL)
        assert not world.bus.fast
        assert world.bus.retried == 0


def test_servos_with_other_ids_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servo_port, "time", FastTime())
    with (
        EmulatedBus(range(31, 55), START.tolist()) as bus,
        DynamixelWorld(ROBOT, calibrated(bus.path)) as world,
        refuses("1 to 24", "31 to 54"),
    ):
        world.reset(*STILL)


def move(world: DynamixelWorld) -> None:
    for k in range(200):
        world.step(START + 0.2 * np.sin(2 * np.pi * 0.5 * k / 50.0))


def held(world: DynamixelWorld) -> str:
    """Why the servos cannot be seen to stand; empty where they can."""
    try:
        world.hold()
    except HardwareFault as fault:
        return str(fault)
    return ""


STOPPED = {
    "half packets": "servo 1 (LF_yaw)",
    "frozen adapter": "adapter",
    "input voltage 3": "servo 3 (LF_roll)",
    "overheating 3": "servo 3 (LF_roll)",
    "reboot 4": "servo 4 (LF_knee)",
    "same id 9": "servo 9 (LR_yaw)",
    "stale values 9": "servo 9 (LR_yaw)",
    "jumping values 9": "servo 9 (LR_yaw)",
    "lying values 9": "servo 9 (LR_yaw)",
    "status return 0": "Status Return Level",
}


@pytest.mark.parametrize("fault", STOPPED)
def test_a_fault_on_the_way_stops_with_its_name_and_nothing_moves_after(
    bus: EmulatedBus, world: DynamixelWorld, fault: str
) -> None:
    world.reset(*STILL)
    world.torque(True)
    bus.inject(fault, 0.1)
    with refuses(STOPPED[fault], kind=HardwareFault):
        move(world)
    sent = bus.state()["goal_writes"]
    unseen = held(world)
    assert unseen == "" or unseen.endswith(
        "bus watchdogs stop the servos 0.6 s after the last packet"
    )
    time.sleep(0.7 if unseen else 0.0)
    reported_rad = np.array(bus.state()["position_rad"])
    time.sleep(0.3)
    seen = bus.state()
    assert seen["goal_writes"] == sent
    np.testing.assert_allclose(seen["position_rad"], reported_rad, atol=2e-3)


def test_faults_are_named_with_a_servo_and_a_time_or_refused(bus: EmulatedBus) -> None:
    for wrong in ("silent", "silent servo 99", "silent servo in a while", ""):
        with refuses(kind=ValueError):
            bus.inject(wrong)
    bus.inject("silent servo 4", 0.01)
    bus.inject("status return 1", 0.01)
    while len(bus.state()["happened"]) < 2:
        time.sleep(0.001)
    assert [kind for kind, _ in bus.state()["happened"]] == ["silent servo", "status return 1"]
    assert len(FAULTS) == len(set(FAULTS.values()))


def judge() -> MeasurementJudge:
    made = MeasurementJudge(DynamixelWorld(ROBOT, calibrated("none")).bus, np.full(24, 3.14))
    assert made.clocks(np.zeros(24, int), np.full(24, 20)) == ""
    assert made.doubt(1.0, *measured()).why == ""
    return made


def measured(
    tick_ms: int = 1000, position: int = 2048, velocity: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.full(24, position), np.full(24, velocity), np.full(24, tick_ms)


def test_a_measurement_is_believed_up_to_what_a_joint_can_turn_and_no_further() -> None:
    can = int((1.5 * 3.14 * 0.02 + 0.06) / table.RAD)
    assert judge().doubt(1.02, *measured(1020, 2048 + can)).why == ""
    assert "LF_yaw): measured to jump" in judge().doubt(1.02, *measured(1020, 2048 + can + 2)).why
    assert "turn at 12.0 rad/s" in judge().doubt(1.02, *measured(1020, velocity=500)).why


def test_clocks_that_stand_or_go_back_or_lag_are_doubted_and_one_that_wraps_is_not() -> None:
    assert "stands still" in judge().doubt(1.02, *measured(1000)).why
    assert "went back" in judge().doubt(1.02, *measured(980)).why
    late = judge().doubt(1.2, *measured(1020))
    assert (late.late, late.why[-40:]) == (
        True,
        "values are 0.18 s old: do answers come late?"[-40:],
    )
    assert judge().doubt(1.2, *measured(1020), calm=True).why == ""
    made = judge()
    assert made.doubt(9.0, *measured(9000)).why == ""
    assert made.doubt(33.0, *measured(33000 % 32768)).why == ""
    assert made.doubt(100.0, *measured(232)).why == ""  # too long ago to tell


def test_a_position_that_stays_while_its_velocity_does_not_is_old() -> None:
    made = judge()
    whys = [
        made.doubt(1.0 + 0.02 * k, *measured(1000 + 20 * k, velocity=20)).why for k in range(1, 9)
    ]
    assert whys[:5] == [""] * 5
    assert "measured to turn at 0.48 rad/s and to stay at 2048 ticks" in whys[5]


def test_servos_without_a_running_clock_are_judged_without_one() -> None:
    made = MeasurementJudge(DynamixelWorld(ROBOT, calibrated("none")).bus, np.full(24, 3.14))
    assert made.clocks(np.zeros(24, int), np.zeros(24, int)) == ""
    for k in range(3):
        assert made.doubt(1.0 + k, *measured(0)).why == ""
