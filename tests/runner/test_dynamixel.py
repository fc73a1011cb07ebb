"""The driver on an emulated bus: what it checks, what it sends, what it says when something goes
wrong.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import joint_names
from stancekit.runner.worlds.dynamixel import control_table as table
from stancekit.runner.worlds.dynamixel import port as servo_port
from stancekit.runner.worlds.dynamixel.control_table import Calibration, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators.devices import bus_process
from tests.emulators.fast_time import FastTime
from tests.emulators.servo_bus import EmulatedBus
from tests.emulators.wrong_calibration import spoiled
from tests.refusals import refuses

LATENCY_MS = 40.0
"""Emulated servos answer late where tests share a machine with others."""
ROBOT = hexapod()
JOINTS = joint_names(ROBOT)
START = np.tile([0.2, 0.5, -0.3, 1.0], 6)
POSE = np.zeros(3), np.eye(3)
STILL = (), np.zeros(24), *POSE


def mirrored(port: str) -> Calibration:
    """Every third servo turned round, every fifth with its zero elsewhere; the rest at START."""
    joints = {}
    for i, (name, each) in enumerate(nominal(JOINTS, port=port).joints.items()):
        turned = replace(
            each,
            direction=-1 if i % 3 == 0 else 1,
            zero_tick=2048 + 100 * (i % 5 == 0),
            current_a=1.5,
        )
        lower, upper = sorted(
            turned.direction * (tick - turned.zero_tick) * table.RAD for tick in (1, 4094)
        )
        limits = {"lower_rad": max(each.lower_rad, lower), "upper_rad": min(each.upper_rad, upper)}
        joints[name] = replace(turned, **limits, rest_rad=float(START[i]))
    return Calibration(port=port, watchdog_s=0.6, latency_ms=LATENCY_MS, joints=joints)


@pytest.fixture
def bus() -> Iterator[EmulatedBus]:
    with EmulatedBus(range(1, 25), mirrored("none").shafts(JOINTS, START).tolist()) as made:
        yield made


@pytest.fixture
def world(bus: EmulatedBus) -> Iterator[DynamixelWorld]:
    with DynamixelWorld(ROBOT, mirrored(bus.path)) as made:
        yield made


def wave(k: int) -> np.ndarray:
    return START + 0.2 * np.sin(2 * np.pi * 0.5 * k / 50.0)


def test_reset_measures_every_joint_and_moves_none(bus: EmulatedBus, world: DynamixelWorld) -> None:
    state = world.reset(*STILL)
    np.testing.assert_allclose(state.angles_rad, START, atol=table.RAD)
    np.testing.assert_allclose(state.feet_m, world._kinematics.feet(state.angles_rad))
    seen = bus.state()
    assert (seen["goal_writes"], any(seen["torque"])) == (0, False)
    assert not world.armed
    with refuses("world"):
        world.step(START)
    assert bus.state()["goal_writes"] == 0


def test_arming_holds_the_measured_pose_with_currents_and_watchdogs_set(
    bus: EmulatedBus, world: DynamixelWorld
) -> None:
    world.reset(*STILL)
    world.torque(True)
    seen = bus.state()
    assert all(seen["torque"])
    assert set(seen["watchdog"]) == {30}
    np.testing.assert_allclose(seen["goal_rad"], seen["position_rad"], atol=table.RAD)
    for index in range(24):
        fields = [bus.servos.get(index, address) for address in (11, 38, 102, 10, 9)]
        assert fields == [5, round(1.5 / 2.69e-3), round(1.5 / 2.69e-3), 0, 0]
        assert bus.servos.get(index, 63) & 0x34 == 0x34


def test_steps_keep_their_rate_say_what_was_sent_and_are_followed(
    bus: EmulatedBus, world: DynamixelWorld
) -> None:
    world.reset(*STILL)
    world.torque(True)
    begin, away = time.monotonic(), 0.0
    for k in range(50):
        state = world.step(wave(k))
        away = max(away, float(abs(state.angles_rad - state.sent_rad).max()))
    assert time.monotonic() - begin > 49 * 0.02
    np.testing.assert_allclose(state.sent_rad, wave(49), atol=0.51 * table.RAD)
    np.testing.assert_allclose(
        bus.state()["goal_rad"], world.calibration.shafts(JOINTS, state.sent_rad), atol=1e-9
    )
    assert 0.0 < away < 0.1  # the lag of the servo's loop, at up to .63 rad/s
    assert bus.state()["goal_writes"] == 24 * 51


def test_a_target_is_clipped_to_what_a_joint_can_turn_and_to_its_limits(
    world: DynamixelWorld,
) -> None:
    world.reset(*STILL)
    world.torque(True)
    before = world.step(START).sent_rad
    sent = world.step(START + 3.0).sent_rad
    np.testing.assert_allclose(sent - before, 3.14 / 50, atol=table.RAD)
    for _ in range(50):
        sent = world.step(START + 3.0).sent_rad
    np.testing.assert_allclose(sent, world.capabilities.upper_rad, atol=table.RAD)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_that_is_no_number_is_refused_and_not_sent(
    bus: EmulatedBus, world: DynamixelWorld, bad: float
) -> None:
    world.reset(*STILL)
    world.torque(True)
    before = bus.state()["goal_writes"]
    with refuses("targets_rad"):
        world.step(np.where(np.arange(24) == 5, bad, START))
    assert bus.state()["goal_writes"] == before


def move(world: DynamixelWorld, periods: int) -> None:
    for k in range(periods):
        world.step(wave(k))


NAMED = {
    "silent servo": "servo",
    "corrupted packets": "servo",
    "delay": "latency_ms",
    "overload": "overload",
    "power loss": "servo 1 (LF_yaw)",
    "cable pulled": "port",
}


UNSEEN = {"silent servo", "corrupted packets", "delay", "power loss", "cable pulled"}
"""Faults after which the servos cannot be seen to stand."""


@pytest.mark.parametrize("kind", NAMED)
def test_a_fault_stops_the_robot_and_nothing_is_sent_after_it(
    bus: EmulatedBus, world: DynamixelWorld, kind: str
) -> None:
    world.reset(*STILL)
    world.torque(True)
    bus.inject(kind, 0.1)
    with refuses(NAMED[kind], kind=HardwareFault):
        move(world, 200)
    sent, at_s = bus.state()["goal_writes"], time.monotonic()
    with refuses("torque(True)"):
        world.step(START)
    if kind in UNSEEN:
        with refuses("0.6 s", kind=HardwareFault):
            world.hold()
    else:
        world.hold()
    time.sleep(1.0)
    seen = bus.state()
    assert seen["goal_writes"] == sent
    assert max(abs(rate) for rate in seen["rate_rad_s"]) < 0.02
    assert seen["still_s"] < at_s + 0.9
    off = {"overload": 1, "power loss": 24}.get(kind, 0)
    assert seen["torque"].count(False) == off
    assert seen["watchdog"].count(255) == (24 - off)


def test_one_damaged_answer_is_asked_for_again_and_harms_nothing(
    bus: EmulatedBus, world: DynamixelWorld
) -> None:
    world.reset(*STILL)
    world.torque(True)
    before = world.bus.retried
    bus.inject("corrupted packet", 0.1)
    for k in range(20):
        world.step(wave(k))
    assert world.bus.retried > before
    assert world.armed


def test_a_host_that_paused_finds_its_servos_stopped(
    bus: EmulatedBus, world: DynamixelWorld
) -> None:
    world.reset(*STILL)
    world.torque(True)
    for k in range(10):
        world.step(wave(k))
    time.sleep(0.9)
    with refuses("servo 1 (LF_yaw)", kind=HardwareFault):
        world.step(wave(10))
    assert bus.state()["refused_goals"] == 24
    world.torque(True)
    world.step(START)


HOST = """
import sys, numpy as np
from stancekit.runner.worlds.dynamixel.control_table import Calibration
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.planners.robot import hexapod
world = DynamixelWorld(hexapod(), Calibration.from_yaml(sys.argv[1]))
start = world.reset((), np.zeros(24), np.zeros(3), np.eye(3)).angles_rad
world.torque(True)
print("moving", flush=True)
for k in range(1000):
    world.step(start + 0.2 * np.sin(2 * np.pi * k / 50.0))
"""


def test_a_host_killed_without_a_word_leaves_servos_that_stop_by_themselves(tmp_path: Path) -> None:
    with bus_process(START) as bus:
        calibration = nominal(JOINTS, port=bus.where["path"], watchdog_s=0.6, latency_ms=LATENCY_MS)
        calibration.write(tmp_path / "servos.yaml")
        command = [sys.executable, "-c", HOST, str(tmp_path / "servos.yaml")]
        host = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert host.stdout is not None
        assert host.stdout.readline() == "moving\n"
        time.sleep(0.5)
        os.kill(host.pid, signal.SIGKILL)
        killed_s = time.monotonic()
        host.communicate()
        time.sleep(1.0)
        seen = bus.state()
    assert seen["goal_writes"] > 24 * 5
    assert set(seen["watchdog"]) == {255}
    assert all(seen["torque"])
    assert seen["still_s"] < killed_s + 0.9


def test_relaxing_switches_every_torque_off_and_names_whom_it_cannot_reach(
    world: DynamixelWorld, bus: EmulatedBus
) -> None:
    world.reset(*STILL)
    world.torque(True)
    world.relax()
    assert not any(bus.state()["torque"])
    world.torque(True)
    bus.inject("silent servo")
    time.sleep(0.05)
    with refuses("servo", kind=HardwareFault):
        world.relax()
    assert bus.state()["torque"].count(True) == 1


def test_settings_that_differ_are_not_written_while_the_torque_is_on(bus: EmulatedBus) -> None:
    with DynamixelWorld(ROBOT, mirrored(bus.path)) as world:
        world.reset(*STILL)
        world.torque(True)
    other = replace(
        mirrored(bus.path),
        joints={n: replace(s, current_a=1.0) for n, s in mirrored("").joints.items()},
    )
    with (
        DynamixelWorld(ROBOT, other) as world,
        refuses("servo 1 (LF_yaw)", "Current Limit"),
    ):
        world.reset(*STILL)
    assert all(bus.state()["torque"])


def test_a_port_has_one_owner_and_must_be_one(
    bus: EmulatedBus, world: DynamixelWorld, tmp_path: Path
) -> None:
    world.reset(*STILL)
    for port, why in {
        bus.path: "expected a free port, somebody else has it open",
        str(tmp_path / "absent"): "expected a serial port, found nothing there",
        str(tmp_path): "Is a directory",
    }.items():
        with (
            pytest.raises(InvalidInput) as refused,
            DynamixelWorld(ROBOT, mirrored(port)) as second,
        ):
            second.reset(*STILL)
        assert str(refused.value) == f"port {port}: {why}"
    (tmp_path / "file").write_text("")
    with refuses("port"):
        DynamixelWorld(ROBOT, mirrored(str(tmp_path / "file"))).reset(*STILL)


def test_wrong_servos_are_refused_before_any_motion(
    bus: EmulatedBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = mirrored(bus.path)
    lower = replace(right.joints["LF_hip"], lower_rad=0.9, rest_rad=None)
    deaf = replace(right, baud=115200, latency_ms=2.0)  # nobody answers, however long it waits
    for wrong, kind, name in (
        (replace(right, model="XM430-W350"), InvalidInput, "servo 1 (LF_yaw)"),
        (deaf, InvalidInput, "1000000"),
        (replace(right, joints=right.joints | {"LF_hip": lower}), InvalidInput, "servo 2 (LF_hip)"),
    ):
        with monkeypatch.context() as patched, DynamixelWorld(ROBOT, wrong) as world:
            if wrong is deaf:
                patched.setattr(servo_port, "time", FastTime())
            with refuses(name, kind=kind):
                world.reset(*STILL)
    assert bus.state()["goal_writes"] == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_calibrated_wrong_is_named_before_any_motion(bus: EmulatedBus, seed: int) -> None:
    calibration, joint = spoiled(mirrored(bus.path), np.random.default_rng(seed))
    with (
        DynamixelWorld(ROBOT, calibration) as world,
        refuses(joint),
    ):
        world.reset(*STILL)
    assert bus.state()["goal_writes"] == 0
