"""The guard around every world: what gets through, what stops it, and that nothing is sent after a
stop.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from stancekit.planners.errors import HardwareFault
from stancekit.planners.robot.leg import ActuatorModel
from stancekit.runner import acceptance
from stancekit.runner.acceptance import JointNeeds, thermal_load
from stancekit.runner.safety.estop import Stopped
from stancekit.runner.safety.guard import Limits, SafeWorld, end
from stancekit.runner.worlds.world import JointBus, is_bus
from tests.emulators.memory_world import PATIENT, MemoryWorld, silent
from tests.refusals import assert_names, refuses

START = np.tile([0.0, 0.3, 0.0, 1.2], 6)
POSE = np.array([0.0, 0.0, 0.2]), np.eye(3)


def guarded(
    world: MemoryWorld, *, dry: bool = False, limits: Limits = PATIENT, **options: object
) -> SafeWorld:
    safe = SafeWorld(world, dry=dry, limits=limits, **options)  # type: ignore[arg-type]
    safe.connect((), START, *POSE)
    if not dry:
        world.arm()
    return safe


@pytest.fixture
def safe(world: MemoryWorld) -> SafeWorld:
    return guarded(world)


@given(st.lists(st.lists(st.floats(-1e3, 1e3), min_size=24, max_size=24), min_size=1, max_size=6))
def test_whatever_is_asked_for_stays_within_positions_velocities_and_steps(
    asked: list[list[float]],
) -> None:
    world = MemoryWorld()
    limits = replace(PATIENT, margin_rad=0.1, velocity_share=0.5, step_rad=0.015, path_rad=10.0)
    safe = guarded(world, limits=limits)
    last = START
    for row in asked:
        state = safe.step(np.array(row))
        np.testing.assert_array_equal(state.sent_rad, world.commands[-1][1])
        assert np.abs(state.sent_rad - last).max() <= min(0.5 * 4.0 / 100.0, 0.015) + 1e-12
        assert np.all(state.sent_rad >= safe.capabilities.lower_rad + 0.1 - 1e-12)
        assert np.all(state.sent_rad <= safe.capabilities.upper_rad - 0.1 + 1e-12)
        last = state.sent_rad
    assert safe.sent == len(asked) == len(world.commands)


def test_what_is_within_all_limits_is_sent_as_it_is(safe: SafeWorld) -> None:
    asked = START + 0.03
    assert np.array_equal(safe.step(asked).sent_rad, asked)
    assert (safe.sent, safe.clipped) == (1, 0)
    safe.step(asked + 1.0)
    assert (safe.sent, safe.clipped) == (2, 1)


def test_a_joint_found_beyond_its_limit_comes_back_no_faster_than_any_other_moves() -> None:
    world = MemoryWorld(found_rad=np.where(np.arange(24) == 3, 3.0, START))
    safe = guarded(world)
    sent = safe.step(world.found_rad).sent_rad  # type: ignore[arg-type]
    assert sent[3] == pytest.approx(3.0 - 4.0 / 100.0)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_no_number_is_refused_and_stops(
    wrong: float, world: MemoryWorld, safe: SafeWorld
) -> None:
    asked = START.copy()
    asked[5] = wrong
    with refuses(str(wrong), "LM_hip", kind=Stopped):
        safe.step(asked)
    for _ in range(3):
        with pytest.raises(Stopped):
            safe.step(START)
    assert world.commands == []
    assert (safe.sent, safe.refused) == (0, 3)


def test_a_command_of_another_length_is_refused_too() -> None:
    with refuses("(23,)", kind=Stopped):
        guarded(MemoryWorld()).step(START[:23])


def test_a_joint_that_does_not_follow_stops_the_run_and_is_named(world: MemoryWorld) -> None:
    safe = guarded(world, limits=replace(PATIENT, path_rad=0.11, path_s=0.05))
    world.stuck = [7]
    for k in range(1, 11):
        safe.step(START + 0.02 * k * (np.arange(24) == 7))
    with refuses("LM_knee", "0.220 rad", "0.11 rad", kind=Stopped):
        safe.step(START + 0.22 * (np.arange(24) == 7))
    # .12 rad in step 6 is the first beyond; five periods of 10 ms are not longer than .05 s, six
    # are
    assert len(world.commands) == 11


def test_a_robot_that_does_not_move_at_all_is_told_as_that(world: MemoryWorld) -> None:
    safe = guarded(world, limits=Limits(path_rad=0.11, path_s=0.05))
    world.stuck = list(range(24))
    turned = np.where(np.arange(24) < 3, 0.02, 0.0)

    def moved() -> None:
        for k in range(1, 20):
            safe.step(START + k * turned)

    with refuses("0.05 s", kind=Stopped):
        moved()


@pytest.mark.parametrize("share", [2, 3])
def test_a_joint_that_does_not_follow_is_found_also_when_some_measurements_say_that_it_does(
    share: int, world: MemoryWorld
) -> None:
    safe = guarded(world, limits=replace(PATIENT, path_rad=0.11, path_s=0.05))
    world.stuck, count = [7], iter(range(1000))
    world.spoil = lambda state: (
        replace(state, angles_rad=state.sent_rad) if next(count) % share == 0 else state
    )

    def moved() -> None:
        for k in range(1, 80):
            safe.step(START + min(0.02 * k, 0.3) * (np.arange(24) == 7))

    with refuses("LM_knee", kind=Stopped):
        moved()


def test_a_joint_that_seems_to_be_away_now_and_then_is_no_reason_to_stop(
    world: MemoryWorld,
) -> None:
    safe = guarded(world, limits=replace(PATIENT, path_rad=0.11, path_s=0.05))
    count = iter(range(1000))
    world.spoil = lambda state: (
        replace(state, angles_rad=state.sent_rad + 0.2) if next(count) % 4 == 0 else state
    )
    for _ in range(100):
        safe.step(START)
    assert safe.sent == 100


def test_a_device_that_may_still_move_after_a_hold_is_left_to_itself_and_the_report_says_why(
    world: MemoryWorld, safe: SafeWorld
) -> None:
    safe.step(START)
    world.pending = "commands may still come"
    found = end(safe, "hold", None, 0.4)
    assert (found.left, found.message) == ("left to the device", "commands may still come")


def test_what_a_device_does_wrong_stops_the_run_and_nothing_is_sent_again(
    world: MemoryWorld, safe: SafeWorld
) -> None:
    safe.step(START)
    world.fault = silent
    with refuses("LF_knee", kind=HardwareFault):
        safe.step(START)
    world.fault = lambda world: None
    with refuses("LF_knee", kind=Stopped):
        safe.step(START)
    assert len(world.commands) == 1


def test_measurements_that_are_no_numbers_are_a_fault_of_the_device(
    world: MemoryWorld, safe: SafeWorld
) -> None:
    world.spoil = lambda state: replace(state, angles_rad=np.full(24, np.nan))
    with refuses("angles_rad", kind=HardwareFault):
        safe.step(START)
    assert safe.latch.tripped


@pytest.mark.parametrize(
    ("spoil", "name"),
    [
        (lambda state: None, "None"),
        (vars, "State"),
        (lambda state: replace(state, angles_rad=state.angles_rad[:-1]), "angles_rad"),
        (lambda state: replace(state, forces_n=np.zeros(18)), "forces_n"),
        (lambda state: replace(state, rotation=None), "rotation"),
        (lambda state: replace(state, sent_rad=["x"] * 24), "sent_rad"),
        (lambda state: replace(state, torques_nm=[[0.0], [0.0, 1.0]]), "torques_nm"),
        (lambda state: replace(state, time_s=np.inf), "time_s"),
    ],
)
def test_what_is_no_state_of_this_robot_stops_it(
    spoil: Any, name: str, world: MemoryWorld, safe: SafeWorld
) -> None:
    world.spoil = spoil
    with refuses("world memory", name, kind=HardwareFault):
        safe.step(START)
    assert safe.latch.tripped


@pytest.mark.parametrize(
    ("attribute", "value", "name"),
    [
        ("name", 3, "name"),
        ("latch", None, "latch"),
        ("robot", "hexapod", "robot"),
        ("servo", {}, "servo"),
        ("rate_hz", 0.0, "rate_hz"),
        ("rate_hz", "fast", "rate_hz"),
        ("joints", ("a", "b"), "joints"),
        ("drives", None, "drives"),
        ("capabilities", 7, "capabilities"),
    ],
)
def test_an_object_that_is_no_world_is_refused_in_one_line(
    attribute: str, value: Any, name: str, world: MemoryWorld
) -> None:
    setattr(world, attribute, value)
    with refuses(name):
        SafeWorld(world)


def test_a_dry_run_sends_nothing_and_says_what_it_would_have_sent(world: MemoryWorld) -> None:
    safe = guarded(world, dry=True)
    state = safe.step(START + 1.0)
    np.testing.assert_allclose(state.sent_rad, START + 0.04)
    np.testing.assert_array_equal(state.angles_rad, state.sent_rad)
    assert world.commands == []
    assert not world.armed
    assert end(safe, "torque-off", None, 1.0).left == "as it was"
    assert not world.torque_on


def test_a_loop_that_is_late_is_stopped_by_its_next_command(world: MemoryWorld) -> None:
    now = [0.0]
    safe = guarded(world, limits=Limits(silent_s=0.2), clock=lambda: now[0])
    safe.step(START)
    now[0] = 0.19
    safe.step(START)
    now[0] = 0.5
    with refuses("0.310 s", "0.2 s", kind=Stopped):
        safe.step(START)
    assert len(world.commands) == 2


def test_a_loop_that_is_late_in_a_dry_run_is_not_stopped_for_nothing_can_move(
    world: MemoryWorld,
) -> None:
    now = [0.0]
    with guarded(world, dry=True, limits=Limits(silent_s=0.2), clock=lambda: now[0]) as safe:
        for now[0] in (0.0, 60.0, 120.0):
            safe.step(START)
    assert (safe.sent, world.commands, safe.latch.tripped) == (3, [], False)


def test_a_stop_source_is_asked_before_every_command() -> None:
    world, pressed = MemoryWorld(), [""]
    safe = guarded(world, sources=[lambda: pressed[0] or None])
    safe.step(START)
    pressed[0] = "mushroom button"
    with refuses("mushroom button", kind=Stopped):
        safe.step(START)
    assert len(world.commands) == 1


@pytest.mark.parametrize(
    ("ending", "armed", "torque"), [("hold", False, True), ("torque-off", False, False)]
)
def test_a_robot_is_left_as_was_asked_for(
    ending: str, armed: bool, torque: bool, world: MemoryWorld, safe: SafeWorld
) -> None:
    safe.step(START)
    safe.latch.trip("button")
    ended = end(safe, ending, None, 1.0)  # type: ignore[arg-type]
    assert ended.left == {"hold": "held", "torque-off": "torque off"}[ending]
    assert (world.armed, world.torque_on) == (armed, torque)
    assert 0.0 <= ended.seconds < 0.5


def test_home_is_gone_to_slowly_but_never_after_a_stop(world: MemoryWorld, safe: SafeWorld) -> None:
    home = START - 0.2
    assert end(safe, "home", [home], 0.5).left == "home"
    np.testing.assert_allclose(world.commands[-1][1], home)
    speeds = 100.0 * np.abs(np.diff([targets for _, targets in world.commands], axis=0)).max()
    assert speeds <= 0.5 + 1e-9
    count = len(world.commands)
    safe.latch.trip("button")
    after = end(safe, "home", [START], 0.5)
    assert after.left == "held"
    assert_names(after.message, "home")
    assert len(world.commands) == count


def test_a_device_that_cannot_be_relaxed_is_left_to_its_own_watchdog(
    world: MemoryWorld, safe: SafeWorld
) -> None:
    world.relax = lambda: silent(world)  # type: ignore[method-assign]
    ended = end(safe, "torque-off", None, 1.0)
    assert (ended.left, ended.message) == (
        "left to the device",
        "memory: LF_knee (id 4): no answer",
    )


@pytest.mark.parametrize(
    "own",
    [
        {"kind": "toy"},
        {"kind": "simulation"},
        {"arm": JointBus.arm},
        {"stop": JointBus.stop},
        {"read": JointBus.read},
    ],
)
def test_what_says_how_it_is_armed_and_stopped_is_hardware_and_nothing_else_is(own: Any) -> None:
    assert is_bus(MemoryWorld)
    assert not is_bus(type("Own", (MemoryWorld,), own))
    assert not is_bus(int)


def test_limits_out_of_range_are_refused_all_at_once() -> None:
    with refuses("limits.velocity_share", "limits.step_rad"):
        Limits(velocity_share=2.0, step_rad=0.0)


def test_every_extra_that_commands_need_is_there_with_its_packages() -> None:
    names = acceptance.extras()
    assert {"robots", "viz", "data"} <= set(names)
    assert not set(acceptance.TOOLS) & set(names)
    assert "pin" in acceptance.versions("robots")
    assert "numpy" in acceptance.versions(None)
    assert "pin" not in acceptance.versions(None)


def test_a_package_that_is_not_installed_has_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(acceptance, "version", version)
    assert acceptance.versions("ray") == {"ray": None}


def test_without_a_library_that_draws_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(acceptance, "find_library", lambda name: None)
    monkeypatch.setattr(sys, "platform", "linux")
    assert acceptance.gl() == ""
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert acceptance.gl() == "osmesa"


SERVO = ActuatorModel(stall_nm=10.0, continuous_nm=2.0, no_load_rad_s=3.0, thermal_s=50.0)


@pytest.mark.parametrize("seconds", [5.0, 50.0, 500.0])
def test_a_constant_torque_heats_as_a_first_order_system_does(seconds: float) -> None:
    period = 0.01
    squares = np.full((round(seconds / period), 1), 2.25)
    load = thermal_load(squares, np.array([50.0]), period)
    assert load[0] == pytest.approx(2.25 * (1.0 - np.exp(-seconds / 50.0)), rel=1e-9)


def test_the_worst_load_is_that_on_the_way_and_not_at_the_end() -> None:
    squares = np.concatenate([np.full((1000, 1), 9.0), np.zeros((9000, 1))])
    load = thermal_load(squares, np.array([20.0]), 0.01)
    assert load[0] == pytest.approx(9.0 * (1.0 - np.exp(-10.0 / 20.0)), rel=1e-9)


def test_peaks_means_and_shares_are_those_of_the_torques() -> None:
    times = np.arange(0.0, 10.0, 0.01)
    torques = np.stack([4.0 * np.sin(2 * np.pi * times), np.full_like(times, -1.0)], axis=1)
    needs = JointNeeds.of(
        ("a", "b"), (SERVO, ActuatorModel(stall_nm=5.0, no_load_rad_s=1.0)), torques, 0.01
    )
    assert needs.peak_nm == pytest.approx([4.0, 1.0], rel=1e-3)
    assert needs.rms_nm == pytest.approx([4.0 / np.sqrt(2.0), 1.0], rel=1e-6)
    assert needs.share_of_stall == pytest.approx([0.4, 0.2], rel=1e-3)
    assert needs.share_of_continuous[0] == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert np.isnan([needs.share_of_continuous[1], needs.heat[1]]).all()
    assert needs.to_json()["b"]["heat"] is None


def test_a_short_effort_is_borne_and_a_long_one_is_said_with_its_heat() -> None:
    short, long = (
        JointNeeds.of(("knee",), (SERVO,), np.full((count, 1), 6.0), 0.1) for count in (50, 100)
    )  # nine times the heat at last: borne for 50 s · ln(9/8) = 5.9 s
    assert short.said(0) == "6 Nm at most and 6 Nm (RMS)"
    assert long.said(0) == "6 Nm at most and 6 Nm (RMS), 1.6 times the heat that it bears"


def test_what_nobody_knows_of_its_heat_is_taken_to_be_repeated_for_ever() -> None:
    unknown = ActuatorModel(stall_nm=10.0, continuous_nm=2.0, no_load_rad_s=3.0)
    torques = np.array([[4.0], [0.0], [0.0], [0.0]])
    assert JointNeeds.of(("knee",), (unknown,), torques, 0.1).heat == pytest.approx([1.0])
