"""The guard around every world: what gets through, what stops it, and that nothing is sent after a
stop.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stancekit.planners.errors import HardwareFault
from stancekit.runner.safety.ending import end
from stancekit.runner.safety.guard import Limits, SafeWorld, capabilities_of
from stancekit.runner.safety.latch import Stopped
from stancekit.runner.worlds.world import Actuator, Stoppable, World
from tests.emulators.memory_world import PATIENT, MemoryWorld, silent
from tests.refusals import assert_names, refuses

START = np.tile([0.0, 0.3, 0.0, 1.2], 6)
POSE = np.array([0.0, 0.0, 0.2]), np.eye(3)


def guarded(
    world: MemoryWorld, *, dry: bool = False, limits: Limits = PATIENT, **options: object
) -> SafeWorld:
    safe = SafeWorld(world, dry=dry, limits=limits, **options)  # type: ignore[arg-type]
    safe.reset((), START, *POSE)
    if not dry:
        world.torque(True)
    return safe


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


def test_what_is_within_all_limits_is_sent_as_it_is() -> None:
    world = MemoryWorld()
    safe = guarded(world)
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
def test_a_command_that_is_no_number_is_refused_and_stops(wrong: float) -> None:
    world = MemoryWorld()
    safe = guarded(world)
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


def test_a_joint_that_does_not_follow_stops_the_run_and_is_named() -> None:
    world = MemoryWorld()
    safe = guarded(world, limits=replace(PATIENT, path_rad=0.11, path_s=0.05))
    world.stuck = [7]
    for k in range(1, 11):
        safe.step(START + 0.02 * k * (np.arange(24) == 7))
    with refuses("LM_knee", "0.220 rad", "0.11 rad", kind=Stopped):
        safe.step(START + 0.22 * (np.arange(24) == 7))
    # .12 rad in step 6 is the first beyond; five periods of 10 ms are not longer than .05 s, six
    # are
    assert len(world.commands) == 11


def test_a_robot_that_does_not_move_at_all_is_told_as_that() -> None:
    world = MemoryWorld()
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
    share: int,
) -> None:
    world = MemoryWorld()
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


def test_a_joint_that_seems_to_be_away_now_and_then_is_no_reason_to_stop() -> None:
    world = MemoryWorld()
    safe = guarded(world, limits=replace(PATIENT, path_rad=0.11, path_s=0.05))
    count = iter(range(1000))
    world.spoil = lambda state: (
        replace(state, angles_rad=state.sent_rad + 0.2) if next(count) % 4 == 0 else state
    )
    for _ in range(100):
        safe.step(START)
    assert safe.sent == 100


def test_a_device_that_may_still_move_after_a_hold_is_left_to_itself_and_the_report_says_why() -> (
    None
):
    world = MemoryWorld()
    safe = guarded(world)
    safe.step(START)
    world.pending = "commands may still come"  # type: ignore[attr-defined]
    found = end(safe, "hold", None, 0.4)
    assert (found.left, found.message) == ("left to the device", "commands may still come")


def test_what_a_device_does_wrong_stops_the_run_and_nothing_is_sent_again() -> None:
    world = MemoryWorld()
    safe = guarded(world)
    safe.step(START)
    world.fault = silent
    with refuses("LF_knee", kind=HardwareFault):
        safe.step(START)
    world.fault = lambda world: None
    with refuses("LF_knee", kind=Stopped):
        safe.step(START)
    assert len(world.commands) == 1


def test_measurements_that_are_no_numbers_are_a_fault_of_the_device() -> None:
    world = MemoryWorld()
    safe = guarded(world)
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
def test_what_is_no_state_of_this_robot_stops_it(spoil: Any, name: str) -> None:
    world = MemoryWorld()
    safe = guarded(world)
    world.spoil = spoil
    with refuses("world memory", name, kind=HardwareFault):
        safe.step(START)
    assert safe.latch.tripped


@pytest.mark.parametrize(
    ("attribute", "value", "name"),
    [
        ("name", 3, "name"),
        ("kind", "toy", "kind"),
        ("latch", None, "latch"),
        ("robot", "hexapod", "robot"),
        ("servo", {}, "servo"),
        ("rate_hz", 0.0, "rate_hz"),
        ("rate_hz", "fast", "rate_hz"),
        ("joints", [1, 2], "joints"),
        ("joints", ("a", "b"), "capabilities"),
        ("capabilities", 7, "capabilities"),
        ("step", None, "step"),
    ],
)
def test_an_object_that_is_no_world_is_refused_in_one_line(
    attribute: str, value: Any, name: str
) -> None:
    world = MemoryWorld()
    setattr(world, attribute, value)
    with refuses(name):
        SafeWorld(world)


def test_a_dry_run_sends_nothing_and_says_what_it_would_have_sent() -> None:
    world = MemoryWorld()
    safe = guarded(world, dry=True)
    state = safe.step(START + 1.0)
    np.testing.assert_allclose(state.sent_rad, START + 0.04)
    np.testing.assert_array_equal(state.angles_rad, state.sent_rad)
    assert world.commands == []
    assert not world.armed
    assert end(safe, "torque-off", None, 1.0).left == "as it was"
    assert not world.torque_on


def test_a_loop_that_is_late_is_stopped_by_its_next_command() -> None:
    now = [0.0]
    world = MemoryWorld()
    safe = guarded(world, limits=Limits(silent_s=0.2), clock=lambda: now[0])
    safe.step(START)
    now[0] = 0.19
    safe.step(START)
    now[0] = 0.5
    with refuses("0.310 s", "0.2 s", kind=Stopped):
        safe.step(START)
    assert len(world.commands) == 2


def test_a_loop_that_is_late_in_a_dry_run_is_not_stopped_for_nothing_can_move() -> None:
    now = [0.0]
    world = MemoryWorld()
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
def test_a_robot_is_left_as_was_asked_for(ending: str, armed: bool, torque: bool) -> None:
    world = MemoryWorld()
    safe = guarded(world)
    safe.step(START)
    safe.latch.trip("button")
    ended = end(safe, ending, None, 1.0)  # type: ignore[arg-type]
    assert ended.left == {"hold": "held", "torque-off": "torque off"}[ending]
    assert (world.armed, world.torque_on) == (armed, torque)
    assert 0.0 <= ended.seconds < 0.5


def test_home_is_gone_to_slowly_but_never_after_a_stop() -> None:
    world = MemoryWorld()
    safe = guarded(world)
    home = START - 0.2
    ended = end(safe, "home", [home], 0.5)
    assert ended.left == "home"
    np.testing.assert_allclose(world.commands[-1][1], home)
    speeds = 100.0 * np.abs(np.diff([targets for _, targets in world.commands], axis=0)).max()
    assert speeds <= 0.5 + 1e-9
    count = len(world.commands)
    safe.latch.trip("button")
    after = end(safe, "home", [START], 0.5)
    assert after.left == "held"
    assert_names(after.message, "home")
    assert len(world.commands) == count


def test_a_device_that_cannot_be_relaxed_is_left_to_its_own_watchdog() -> None:
    world = MemoryWorld()
    safe = guarded(world)
    world.relax = lambda: silent(world)  # type: ignore[method-assign]
    ended = end(safe, "torque-off", None, 1.0)
    assert (ended.left, ended.message) == (
        "left to the device",
        "memory: LF_knee (id 4): no answer",
    )


def test_a_world_is_an_actuator_by_what_it_can_do() -> None:
    world: World = MemoryWorld()
    assert isinstance(world, Actuator)
    assert isinstance(world, Stoppable)
    from stancekit.runner.worlds import make_world

    with make_world("mujoco", world.robot) as simulated:
        assert not isinstance(simulated, Stoppable)
        can = capabilities_of(simulated)
        assert can.joints == simulated.joints
        assert can.has_body_pose
        safe = SafeWorld(simulated, dry=True)
        assert (safe.real, safe.dry) == (False, False)


def test_limits_out_of_range_are_refused_all_at_once() -> None:
    with refuses("limits.velocity_share", "limits.step_rad"):
        Limits(velocity_share=2.0, step_rad=0.0)
