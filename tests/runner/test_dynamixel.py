"""The driver on an emulated bus: what it checks, what it sends, what it says when something goes
wrong.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.robot import hexapod
from stancekit.runner.worlds import hardware
from stancekit.runner.worlds.dynamixel import control_table as table
from stancekit.runner.worlds.dynamixel.bus import MeasurementJudge
from stancekit.runner.worlds.dynamixel.control_table import (
    Calibration,
    JointServo,
    nominal,
)
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from tests.emulators.devices import Emulated, bus_process, shafts
from tests.emulators.fast_time import fast_bus
from tests.emulators.servo_bus import FAULTS, EmulatedBus
from tests.emulators.wrong_calibration import spoiled
from tests.refusals import refuses

LATENCY_MS = 40.0
"""Emulated servos answer late where tests share a machine with others."""
ROBOT = hexapod()
JOINTS = ROBOT.joint_names
START = np.tile([0.2, 0.5, -0.3, 1.0], 6)
POSE = np.zeros(3), np.eye(3)
STILL = (), np.zeros(24), *POSE


def mirrored(port: str) -> Calibration:
    """Every third servo turned round, every fifth with its zero elsewhere; the rest at START."""
    joints = {}
    for i, (name, each) in enumerate(nominal(ROBOT, port=port).joints.items()):
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


SHAFTS = shafts(mirrored("none"), JOINTS, START).tolist()


@pytest.fixture
def bus() -> Iterator[EmulatedBus]:
    with fast_bus(range(1, 25), SHAFTS) as made:
        yield made


@pytest.fixture
def world(bus: EmulatedBus) -> Iterator[DynamixelWorld]:
    with DynamixelWorld(ROBOT, mirrored(bus.path)) as made:
        yield made


@pytest.fixture
def armed(world: DynamixelWorld) -> None:
    world.connect(*STILL)
    world.arm()


def wave(k: int) -> np.ndarray:
    return START + 0.2 * np.sin(2 * np.pi * 0.5 * k / 50.0)


def test_reset_measures_every_joint_and_moves_none(bus: EmulatedBus, world: DynamixelWorld) -> None:
    state = world.connect(*STILL)
    np.testing.assert_allclose(state.angles_rad, START, atol=table.RAD)
    np.testing.assert_allclose(state.feet_m, world._kinematics.feet(state.angles_rad))
    seen = bus.state()
    assert (seen["goal_writes"], any(seen["torque"])) == (0, False)
    assert not world.armed
    with refuses("world"):
        world.step(START)
    assert bus.state()["goal_writes"] == 0


def test_arming_holds_the_measured_pose_with_currents_and_watchdogs_set(
    bus: EmulatedBus, world: DynamixelWorld, armed: None
) -> None:
    seen = bus.state()
    assert all(seen["torque"])
    assert set(seen["watchdog"]) == {30}
    np.testing.assert_allclose(seen["goal_rad"], seen["position_rad"], atol=table.RAD)
    for index in range(24):
        fields = [bus.servos.get(index, address) for address in (11, 38, 102, 10, 9)]
        assert fields == [5, round(1.5 / 2.69e-3), round(1.5 / 2.69e-3), 0, 0]
        assert bus.servos.get(index, 63) & 0x34 == 0x34


def test_steps_keep_their_rate_say_what_was_sent_and_are_followed(
    bus: EmulatedBus, world: DynamixelWorld, armed: None
) -> None:
    begin, away = bus.clock.now, 0.0
    for k in range(50):
        state = world.step(wave(k))
        away = max(away, float(abs(state.angles_rad - state.sent_rad).max()))
    assert bus.clock.now - begin > 49 * 0.02
    np.testing.assert_allclose(state.sent_rad, wave(49), atol=0.51 * table.RAD)
    np.testing.assert_allclose(
        bus.state()["goal_rad"], shafts(world.calibration, JOINTS, state.sent_rad), atol=1e-9
    )
    assert 0.0 < away < 0.1  # the lag of the servo's loop, at up to .63 rad/s
    assert bus.state()["goal_writes"] == 24 * 51


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_that_is_no_number_is_refused_and_not_sent(
    bus: EmulatedBus, world: DynamixelWorld, bad: float, armed: None
) -> None:
    before = bus.state()["goal_writes"]
    with refuses("targets_rad"):
        world.step(np.where(np.arange(24) == 5, bad, START))
    assert bus.state()["goal_writes"] == before


def later(bus: Emulated, then: dict[str, Any], seconds: float) -> dict[str, Any]:
    """The state of a bus, once so much of the servos' own time has passed since another state."""
    while (seen := bus.state())["own_s"] < then["own_s"] + seconds:
        hardware.time.sleep(0.01)
    return seen


def test_one_damaged_answer_is_asked_for_again_and_harms_nothing(
    bus: EmulatedBus, world: DynamixelWorld, armed: None
) -> None:
    before = world.bus.retried
    bus.inject("corrupted packet", 0.1)
    for k in range(20):
        world.step(wave(k))
    assert world.bus.retried > before
    assert world.armed


def test_a_host_that_paused_finds_its_servos_stopped(
    bus: EmulatedBus, world: DynamixelWorld, armed: None
) -> None:
    for k in range(10):
        world.step(wave(k))
    later(bus, bus.state(), 0.9)
    with refuses("servo 1 (LF_yaw)", kind=HardwareFault):
        world.step(wave(10))
    assert bus.state()["refused_goals"] == 24
    world.arm()
    world.step(START)


HOST = """
import sys, numpy as np
from stancekit.runner.worlds.dynamixel.control_table import Calibration
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.planners.robot import hexapod
world = DynamixelWorld(hexapod(), Calibration.from_yaml(sys.argv[1]))
start = world.connect((), np.zeros(24), np.zeros(3), np.eye(3)).angles_rad
world.arm()
print("moving", flush=True)
for k in range(1000):
    world.step(start + 0.2 * np.sin(2 * np.pi * k / 50.0))
"""


def test_a_host_killed_without_a_word_leaves_servos_that_stop_by_themselves(tmp_path: Path) -> None:
    with bus_process(START) as bus:
        calibration = nominal(ROBOT, port=bus.where["path"], watchdog_s=0.6, latency_ms=LATENCY_MS)
        calibration.write(tmp_path / "servos.yaml")
        command = [sys.executable, "-c", HOST, str(tmp_path / "servos.yaml")]
        host = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert host.stdout.readline() == "moving\n"
        while bus.state()["goal_writes"] <= 24 * 5:
            time.sleep(0.05)
        os.kill(host.pid, signal.SIGKILL)
        host.communicate()
        then = bus.state()
        seen = later(bus, then, 1.0)
    assert set(seen["watchdog"]) == {255}
    assert all(seen["torque"])
    assert seen["moved_s"] < then["own_s"] + 0.9


def test_relaxing_switches_every_torque_off_and_names_whom_it_cannot_reach(
    world: DynamixelWorld, bus: EmulatedBus, armed: None
) -> None:
    world.stop(torque_off=True)
    assert not any(bus.state()["torque"])
    world.arm()
    happened(bus, "silent servo")
    with refuses("servo", kind=HardwareFault):
        world.stop(torque_off=True)
    assert bus.state()["torque"].count(True) == 1


def test_settings_that_differ_are_not_written_while_the_torque_is_on(bus: EmulatedBus) -> None:
    with DynamixelWorld(ROBOT, mirrored(bus.path)) as world:
        world.connect(*STILL)
        world.arm()
    other = replace(
        mirrored(bus.path),
        joints={n: replace(s, current_a=1.0) for n, s in mirrored("").joints.items()},
    )
    with (
        DynamixelWorld(ROBOT, other) as world,
        refuses("servo 1 (LF_yaw)", "Current Limit"),
    ):
        world.connect(*STILL)
    assert all(bus.state()["torque"])


def test_a_port_has_one_owner_and_must_be_one(
    bus: EmulatedBus, world: DynamixelWorld, tmp_path: Path
) -> None:
    world.connect(*STILL)
    for port, why in {
        bus.path: "expected a free port, another program has it open",
        str(tmp_path / "absent"): "expected a serial port, found nothing there",
        str(tmp_path): "Is a directory",
    }.items():
        with (
            pytest.raises(InvalidInput) as refused,
            DynamixelWorld(ROBOT, mirrored(port)) as second,
        ):
            second.connect(*STILL)
        assert str(refused.value) == f"port {port}: {why}"
    (tmp_path / "file").write_text("")
    with refuses("port"):
        DynamixelWorld(ROBOT, mirrored(str(tmp_path / "file"))).connect(*STILL)


def test_wrong_servos_are_refused_before_any_motion(bus: EmulatedBus) -> None:
    right = mirrored(bus.path)
    lower = replace(right.joints["LF_hip"], lower_rad=0.9, rest_rad=None)
    deaf = replace(right, baud=115200, latency_ms=2.0)  # nobody answers, however long it waits
    for wrong, kind, name in (
        (replace(right, model="XM430-W350"), InvalidInput, "servo 1 (LF_yaw)"),
        (deaf, InvalidInput, "1000000"),
        (replace(right, joints=right.joints | {"LF_hip": lower}), InvalidInput, "servo 2 (LF_hip)"),
    ):
        with DynamixelWorld(ROBOT, wrong) as world, refuses(name, kind=kind):
            world.connect(*STILL)
    assert bus.state()["goal_writes"] == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_calibrated_wrong_is_named_before_any_motion(bus: EmulatedBus, seed: int) -> None:
    calibration, joint = spoiled(mirrored(bus.path), np.random.default_rng(seed))
    with (
        DynamixelWorld(ROBOT, calibration) as world,
        refuses(joint),
    ):
        world.connect(*STILL)
    assert bus.state()["goal_writes"] == 0


def happened(bus: EmulatedBus, *faults: str) -> list[str]:
    for fault in faults:
        bus.inject(fault, 0.01)
    while len(seen := bus.state()["happened"]) < len(faults):
        hardware.time.sleep(0.001)
    return [kind for kind, _ in seen]


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


@pytest.mark.parametrize("fault", REFUSED)
def test_first_contact_names_what_is_wrong_and_nothing_moves(
    bus: EmulatedBus, world: DynamixelWorld, fault: str
) -> None:
    happened(bus, fault)
    with refuses(REFUSED[fault]):
        world.connect(*STILL)
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
    state = world.connect(*STILL)
    np.testing.assert_allclose(state.angles_rad, START, atol=table.RAD)
    world.arm()
    for _ in range(5):
        state = world.step(START)
    world.stop()
    np.testing.assert_allclose(state.angles_rad, START, atol=2 * table.RAD)
    assert world.bus.fast == (fault != "no fast sync read")
    assert bus.state()["goal_writes"] == 6 * 24


def test_servos_whose_firmware_lacks_fast_sync_read_are_read_one_after_the_other() -> None:
    with (
        fast_bus(range(1, 25), SHAFTS, firmware=44) as bus,
        DynamixelWorld(ROBOT, mirrored(bus.path)) as world,
    ):
        world.connect(*STILL)
        assert not world.bus.fast
        assert world.bus.retried == 0


def test_servos_with_other_ids_are_named() -> None:
    with (
        fast_bus(range(31, 55), SHAFTS) as bus,
        DynamixelWorld(ROBOT, mirrored(bus.path)) as world,
        refuses("1 to 24", "31 to 54"),
    ):
        world.connect(*STILL)


def held(world: DynamixelWorld) -> str:
    """Why the servos cannot be seen to stand; empty where they can."""
    try:
        world.stop()
    except HardwareFault as fault:
        return str(fault)
    return ""


STOPPED = {
    "silent servo": "servo",
    "corrupted packets": "servo",
    "half packets": "servo 1 (LF_yaw)",
    "delay": "latency_ms",
    "frozen adapter": "adapter",
    "overload": "overload",
    "power loss": "servo 1 (LF_yaw)",
    "cable pulled": "port",
    "input voltage 3": "servo 3 (LF_roll)",
    "overheating 3": "servo 3 (LF_roll)",
    "reboot 4": "servo 4 (LF_knee)",
    "same id 9": "servo 9 (LR_yaw)",
    "stale values 9": "servo 9 (LR_yaw)",
    "jumping values 9": "servo 9 (LR_yaw)",
    "lying values 9": "servo 9 (LR_yaw)",
    "status return 0": "Status Return Level",
}


UNSEEN = {
    "silent servo",
    "corrupted packets",
    "half packets",
    "delay",
    "power loss",
    "cable pulled",
    "same id 9",
    "stale values 9",
    "status return 0",
}
"""Faults after which the servos cannot be seen to stand."""
OFF = {"overload": 1, "overheating 3": 1, "reboot 4": 1, "power loss": 24}
"""Servos without torque after a fault."""


@pytest.mark.parametrize("fault", STOPPED)
def test_a_fault_on_the_way_stops_with_its_name_and_nothing_is_sent_or_moves_after_it(
    bus: EmulatedBus, world: DynamixelWorld, fault: str, armed: None
) -> None:
    bus.inject(fault, 0.1)
    with refuses(STOPPED[fault], kind=HardwareFault):
        for k in range(200):
            world.step(wave(k))
    then = bus.state()
    with refuses("arm"):
        world.step(START)
    unseen, stood_rad = held(world), bus.state()["position_rad"]
    watched = "bus watchdogs stop the servos 0.6 s after the last packet"
    assert unseen[-len(watched) :] == (watched if fault in UNSEEN else "")
    seen = later(bus, then, 1.0)
    assert seen["goal_writes"] == then["goal_writes"]
    assert max(abs(rate) for rate in seen["rate_rad_s"]) < 0.02
    assert seen["moved_s"] < then["own_s"] + 0.9
    off = OFF.get(fault, 0)
    assert seen["torque"].count(False) == off
    assert seen["watchdog"].count(255) == (24 - off)
    if not unseen:
        np.testing.assert_allclose(seen["position_rad"], stood_rad, atol=2e-3)


def test_faults_are_named_with_a_servo_and_a_time_or_refused(bus: EmulatedBus) -> None:
    for wrong in ("silent", "silent servo 99", "silent servo in a while", ""):
        with refuses(kind=ValueError):
            bus.inject(wrong)
    assert happened(bus, "silent servo 4", "status return 1") == ["silent servo", "status return 1"]
    assert len(FAULTS) == len(set(FAULTS.values()))


def judge() -> MeasurementJudge:
    made = MeasurementJudge(DynamixelWorld(ROBOT, mirrored("none")).bus, np.full(24, 3.14))
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
    made = MeasurementJudge(DynamixelWorld(ROBOT, mirrored("none")).bus, np.full(24, 3.14))
    assert made.clocks(np.zeros(24, int), np.zeros(24, int)) == ""
    for k in range(3):
        assert made.doubt(1.0 + k, *measured(0)).why == ""


def spoil(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    data = json.loads(json.dumps({"format": "stancekit/servos/1", "port": "port", "joints": {}}))
    for i, name in enumerate(JOINTS):
        data["joints"][name] = {"id": i + 1, "lower_rad": -1.0, "upper_rad": 1.0, "current_a": 2.0}
    change(data)
    return data


REFUSED_FILES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "an id twice": (
        lambda d: d["joints"]["LF_knee"].update(id=2),
        "joints.LF_knee.id: expected its own id, got 2, which LF_hip has",
    ),
    "a joint missing": (
        lambda d: d["joints"].pop("RR_hip"),
        "joints: expected joint RR_hip, got nothing",
    ),
    "a joint too many": (
        lambda d: d["joints"].update(tail=dict(d["joints"]["LF_yaw"], id=99)),
        "joints: unknown joint tail",
    ),
    "an id out of range": (
        lambda d: d["joints"]["LF_hip"].update(id=253),
        "joints.LF_hip.id: expected less than or equal to 252, got 253",
    ),
    "a direction of 2": (
        lambda d: d["joints"]["LF_hip"].update(direction=2),
        "joints.LF_hip.direction: expected -1 or 1, got 2",
    ),
    "limits the wrong way": (
        lambda d: d["joints"]["LF_hip"].update(lower_rad=2.0),
        "joints.LF_hip.upper_rad: expected a number above 2, got 1",
    ),
    "limits beyond a turn": (
        lambda d: d["joints"]["LF_hip"].update(zero_tick=3900),
        "joints.LF_hip.upper_rad: expected an angle within the servo's one turn, 0 to 4095, got 1 at tick 4552",
    ),
    "too much current": (
        lambda d: d["joints"]["LF_hip"].update(current_a=5.8),
        "joints.LF_hip.current_a: expected up to 5.51, the most of an XM540-W270, got 5.8",
    ),
    "an unknown key": (
        lambda d: d["joints"]["LF_hip"].update(offset=1),
        "joints.LF_hip.offset: unknown key",
    ),
    "another format": (
        lambda d: d.update(format="stancekit/servos/2"),
        "format: expected stancekit/servos/1, got 'stancekit/servos/2'",
    ),
}


@pytest.mark.parametrize("name", REFUSED_FILES)
def test_a_calibration_file_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    change, message = REFUSED_FILES[name]
    path = tmp_path / "servos.json"
    path.write_text(json.dumps(spoil(change)))
    with pytest.raises(InvalidInput) as refused:
        Calibration.from_yaml(path, JOINTS)
    assert str(refused.value) == f"{path}: {message}"


def test_a_calibration_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    written = replace(nominal(ROBOT, port="port"), watchdog_s=0.3, desk=True)
    written.write(tmp_path / "servos.yaml")
    assert Calibration.from_yaml(tmp_path / "servos.yaml", JOINTS) == written


@given(st.integers(1, 4094), st.sampled_from([-1, 1]), st.floats(-1.0, 1.0))
def test_an_angle_comes_back_from_its_tick_within_half_a_tick(
    zero: int, direction: int, angle: float
) -> None:
    servo = JointServo(
        id=1, zero_tick=zero, direction=direction, lower_rad=-0.001, upper_rad=0.001, current_a=1.0
    )
    turning = Calibration(port="none", joints={"a": servo}).turning(["a"])
    ticks = np.rint(turning.told(np.array([angle])))
    assert np.sign(ticks[0] - zero) in (0, direction * np.sign(angle))
    assert abs(turning.angles(ticks)[0] - angle) <= np.pi / 4096 + 1e-12
