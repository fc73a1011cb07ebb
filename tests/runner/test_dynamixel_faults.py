"""First contact with a bus that is not as it should be, and measurements that are not true: one
line each.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("pinocchio")

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.urdf import joint_names
from stancekit.runner.worlds.dynamixel import control_table as table
from stancekit.runner.worlds.dynamixel import port as servo_port
from stancekit.runner.worlds.dynamixel.calibration import Calibration, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.dynamixel.judge import MeasurementJudge
from tests.emulators.fast_time import FastTime
from tests.emulators.servo_bus import FAULTS, EmulatedBus

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
    "silent servo 7": r"no answer from servo 7 \(LM_roll\): is it connected and powered, and its id right\?$",
    "corrupted packets": r"answers come damaged, e.g. that of servo 1 \(LF_yaw\): are cables, supply and baud rate",
    "half packets": r"answers come damaged, e.g. that of servo 1 \(LF_yaw\): are cables, supply and baud rate right",
    "delay": r"servo 1 \(LF_yaw\) answers after \d+ ms, latency_ms 40 allows 80: set the adapter's latency timer to",
    "input voltage 3": r"^servo 3 \(LF_roll\): input voltage; its torque is still on: see to that, then reboot it$",
    "overheating 3": r"^servo 3 \(LF_roll\): overheating; its torque is off until it is rebooted$",
    "power loss": r"and 21 more, at any baud rate: has the bus power, and is it this port\?$",
    "cable pulled": r"^port .*: expected a serial port, found nothing there$",
    "stuck bus": r"bytes come without end, though nobody was asked: is another program, or a faulty servo, on the bus",
    "same id 9": r"^servo 9 \(LR_yaw\): its answers come damaged, but for pings: do two servos have id 9\?$",
    "stale values 9": r"^servo 9 \(LR_yaw\): its clock \(Realtime Tick\) stands still, those of others run: are its",
    "lying values 9": r"^servo 9 \(LR_yaw\): (measured to jump|expected an angle)",
    "wrong baud": r"expected servos at 1000000 baud, found 1 to 24 at 57600: set baud to 57600 in the calibration file",
    "wrong model 2": r"expected servos XM540-W270 \(model 1120\): servo 2 \(LF_hip\) is model 1020$",
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
    with pytest.raises(InvalidInput, match=REFUSED[fault]) as refused:
        world.reset(*STILL)
    assert "\n" not in str(refused.value)
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
    expected = r"of the calibration file, 1 to 24, found 31 to 54 at 1000000 baud$"
    with (
        EmulatedBus(range(31, 55), START.tolist()) as bus,
        DynamixelWorld(ROBOT, calibrated(bus.path)) as world,
        pytest.raises(InvalidInput, match=expected),
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
    "half packets": r"answers come damaged, e.g. that of servo 1 \(LF_yaw\)",
    "frozen adapter": r"no answers came for a while, and now they do: did the adapter, or its cable, hang\?$",
    "input voltage 3": r"^servo 3 \(LF_roll\): input voltage; its torque is still on",
    "overheating 3": r"^servo 3 \(LF_roll\): overheating; its torque is off until it is rebooted$",
    "reboot 4": r"^servo 4 \(LF_knee\): its torque went off: did it restart, was its power gone\?$",
    "same id 9": r"^servo 9 \(LR_yaw\): its answers come damaged, but for pings: do two servos have id 9\?$",
    "stale values 9": r"^servo 9 \(LR_yaw\): its values are old: its clock \(Realtime Tick\) stands still$",
    "jumping values 9": r"^servo 9 \(LR_yaw\): measured to jump 0\.\d\d rad in \d+ ms, which it cannot turn",
    "lying values 9": r"^servo 9 \(LR_yaw\): measured to jump",
    "status return 0": r"maybe more of them: answers pings, but no reads: set its Status Return Level to 2",
}


@pytest.mark.parametrize("fault", STOPPED)
def test_a_fault_on_the_way_stops_with_its_name_and_nothing_moves_after(
    bus: EmulatedBus, world: DynamixelWorld, fault: str
) -> None:
    world.reset(*STILL)
    world.torque(True)
    bus.inject(fault, 0.1)
    with pytest.raises(HardwareFault, match=STOPPED[fault]):
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
        with pytest.raises(ValueError, match="expected"):
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
