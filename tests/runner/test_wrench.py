"""What is on a simulated body beside its weight: where it acts, when, and what a plan that carries
it is worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.contact import at_point
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.terrain import Patch
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from stancekit.runner.worlds.mujoco import MujocoWorld
from tests.refusals import refuses

FAST = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
WORLDS = ("mujoco", "bullet")
STANDING = np.tile([0.0, 0.3, 0.0, 1.2], 6)
SQUARE = Patch(
    vertices_m=0.5
    * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]),
    normal=np.array([0.0, 0.0, 1.0]),
    shear_reference=np.array([1.0, 0.0, 0.0]),
    friction=0.7,
)


def falling(name: str, wrench: list[float], leans: bool = False) -> np.ndarray:
    """Velocity of a robot after a tenth of a second of falling with this on it, shape (6,). leans:
    its centre of mass is beside that of its body.
    """
    if name == "bullet":
        pytest.importorskip("pybullet")
    pose = STANDING.copy()
    if leans:
        pose[:12:4] = 0.6
        pose[1:12:4] = -0.5
    with make_world(name, hexapod()) as world:
        world.reset((SQUARE,), pose, np.array([0.0, 0.0, 3.0]), np.eye(3))
        world.carry(np.array(wrench))  # type: ignore[attr-defined]
        return np.array([world.step(pose).velocity for _ in range(20)][-1])


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("leans", [False, True])
def test_a_force_moves_a_falling_robot_and_does_not_turn_it(name: str, leans: bool) -> None:
    still, pulled = (
        falling(name, [force, -0.5 * force, 0.0, 0.0, 0.0, 0.0], leans) for force in (0.0, 30.0)
    )
    gained = pulled - still
    np.testing.assert_allclose(gained[:2], [0.3, -0.15], rtol=0.05)  # F t / m
    assert np.abs(gained[3:]).max() < 0.02


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("axis", range(3))
def test_a_moment_turns_a_falling_robot_and_does_not_move_it(name: str, axis: int) -> None:
    wrench = np.zeros(6)
    wrench[3 + axis] = 2.0
    gained = falling(name, wrench.tolist()) - falling(name, [0.0] * 6)
    assert gained[3 + axis] > 0.2
    assert np.abs(np.delete(gained[3:], axis)).max() < 0.1 * gained[3 + axis]
    assert np.abs(gained[:3]).max() < 0.02


@pytest.mark.parametrize("name", WORLDS)
def test_feet_of_a_robot_that_stands_carry_what_is_on_it(name: str) -> None:
    if name == "bullet":
        pytest.importorskip("pybullet")
    wrench = at_point((3.0, -2.0, -15.0), (0, 0, 0), (0.1, 0.05, 0.05))
    answer = stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=wrench))
    plan = answer.solution
    assert plan is not None
    report = stancekit.simulate(plan, name, settings=FAST)
    assert report.succeeded, report.message
    assert report.execution is not None
    assert report.execution.com_worst_m < 0.01
    assert report.execution.force_rms_n < 8.0


@pytest.fixture
def carried(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """What worlds in MuJoCo are told that the body bears."""
    told, carry = list[np.ndarray](), MujocoWorld.carry

    def noted(self: MujocoWorld, wrench: np.ndarray) -> None:
        told.append(np.array(wrench))
        carry(self, wrench)

    monkeypatch.setattr(MujocoWorld, "carry", noted)
    return told


def test_a_world_is_told_what_the_plan_was_told(
    carried: list[np.ndarray], step: Callable[[str], Plan]
) -> None:
    course = replace(
        read_course("stairs", 2),
        wrench=np.array([[0, 0, -5.0, 0, 0, 0], [0, 4.0, -10.0, 0, 0, 0.2]]),
    )
    plan = stancekit.plan(course).solution
    assert plan is not None
    assert stancekit.simulate(plan, settings=FAST).succeeded
    assert course.wrench is not None
    np.testing.assert_array_equal(carried[0], course.wrench[0])
    np.testing.assert_allclose(carried[-1], course.wrench[1])
    steps = np.diff(np.array(carried), axis=0)
    assert (steps[:, 2] <= 1e-12).all()  # from the one to the other
    assert len({round(float(each[2]), 6) for each in carried}) > 10

    carried.clear()
    assert stancekit.simulate(plan, settings=replace(FAST, wrench=(0.0, 1.0, 0.0))).succeeded
    assert {tuple(each) for each in carried} == {(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)}

    carried.clear()
    assert stancekit.simulate(step("stairs"), settings=FAST).succeeded
    assert not carried


def test_a_plan_that_was_told_of_a_load_presses_as_it_says_and_another_does_not(
    step: Callable[[str], Plan],
) -> None:
    load = at_point((0.0, 0.0, -20.0), (0, 0, 0), (0.12, 0.1, 0.05))
    told = stancekit.plan("stairs", frames=2, settings=stancekit.PlanSettings(wrench=load)).solution
    assert told is not None
    said = stancekit.simulate(told, settings=FAST).execution
    other = stancekit.simulate(
        step("stairs"), settings=replace(FAST, wrench=tuple(load.tolist()))
    ).execution
    assert said is not None
    assert other is not None
    assert said.force_rms_n < 0.6 * other.force_rms_n
    assert said.planned_torque_nm > 1.1 * other.planned_torque_nm


def test_what_is_no_wrench_or_no_simulation_is_refused(step: Callable[[str], Plan]) -> None:
    wrong: Any
    for wrong in ((1.0, 2.0), ("a", "b", "c"), (np.nan, 0.0, 0.0), 3.0):
        with refuses("wrench"):
            RunSettings(wrench=wrong)
    with refuses("wrench"):
        stancekit.run(step("stairs"), "dynamixel", settings=RunSettings(wrench=(1.0, 0.0, 0.0)))
