"""Robots of 3 to 8 legs with 2 to 6 joints each on servos and behind ROS, dry and armed: their own
limits count, joint by joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.runner.safety.guard import Limits, SafeWorld
from stancekit.runner.worlds.dynamixel.control_table import RAD, nominal
from stancekit.runner.worlds.dynamixel.driver import DynamixelWorld
from stancekit.runner.worlds.hardware import HardwareWorld
from stancekit.runner.worlds.ros.driver import RosWorld
from stancekit.runner.worlds.ros.joint_states import same_names
from tests.emulators.devices import shafts
from tests.emulators.fast_time import fast_bus
from tests.emulators.ros_robots import QUICK, emulated
from tests.planners.robot.small_urdfs import fixed, joint, link, robot
from tests.runner.test_simulated_robots import robot as of_model


def legged(legs: int, joints: int) -> Robot:
    """Legs about a ring; no two joints of a leg have the same limits."""
    parts = list[str]()
    for leg in range(legs):
        turn = 2.0 * np.pi * (leg + 0.5) / legs
        parent, at = "base", f"{0.3 * np.cos(turn)} {0.3 * np.sin(turn)} 0"
        for k in range(joints):
            name, axis = f"leg{leg}_{k}", ("1 0 0", "0 1 0")[k % 2]
            ends = f'lower="{-0.3 - 0.1 * k}" upper="{0.3 + 0.2 * k}"'
            limits = f'<limit {ends} effort="{3 + 0.5 * k}" velocity="{1 + 0.3 * k}"/>'
            parts += [link(name, 0.2), joint(f"{name}_joint", parent, name, at, axis, limits)]
            parent, at = name, "0 0 -.12"
        foot = f"foot{leg}"
        parts += [link(foot, 0.05, '<sphere radius="0.02"/>'), fixed(f"{foot}_", parent, foot, at)]
    return of_model(model_of(robot(parts)))


@contextmanager
def on_bus(own: Robot) -> Iterator[HardwareWorld]:
    names = own.joint_names
    start = shafts(nominal(own, port="none"), names, np.zeros(len(names)))
    with fast_bus(range(1, 1 + len(names)), start.tolist()) as bus:
        calibration = replace(nominal(own, port=bus.path, watchdog_s=1.0), latency_ms=40.0)
        with DynamixelWorld(own, calibration) as world:
            yield world


@contextmanager
def behind_ros(own: Robot) -> Iterator[HardwareWorld]:
    names = own.joint_names
    with (
        emulated(names, np.zeros(len(names))) as bridge,
        RosWorld(own, same_names(names, port=bridge.port, **QUICK)) as world,
    ):
        yield world


@pytest.mark.parametrize("device", [on_bus, behind_ros])
@pytest.mark.parametrize(("legs", "joints"), [(3, 2), (4, 3), (8, 4), (5, 5), (3, 6)])
def test_own_joints_are_sent_within_their_own_limits(device, legs, joints) -> None:
    own, each = legged(legs, joints), np.tile(np.arange(joints), legs)
    for dry in (True, False):
        with device(own) as world, SafeWorld(world, dry=dry, limits=Limits(path_rad=2.0)) as safe:
            can = safe.capabilities
            np.testing.assert_allclose(can.lower_rad, -0.3 - 0.1 * each)
            np.testing.assert_allclose(can.upper_rad, 0.3 + 0.2 * each)
            np.testing.assert_allclose(can.velocity_rad_s, 1.0 + 0.3 * each)
            np.testing.assert_allclose(can.torque_nm, 3.0 + 0.5 * each)
            state = safe.connect((), np.zeros(len(each)), np.zeros(3), np.eye(3))
            safe.arm()
            for _ in range(4):
                before, state = state, safe.step(np.full(len(each), 9.0))
            speed = 50.0 * (state.sent_rad - before.sent_rad)
            np.testing.assert_allclose(speed, 1.0 + 0.3 * each, atol=50.0 * RAD)
            while np.any(state.sent_rad < can.upper_rad - RAD):
                state = safe.step(np.full(len(each), 9.0))
            assert np.all(state.sent_rad <= can.upper_rad + RAD)
            assert world.armed != dry
