"""One posture, planned as a course of one frame with the robot whose limbs stand: its joints are
found and bent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import stancekit
from tests.refusals import refuses

ANT = Path(__file__).parents[2] / "configs/demo/ant.yaml"
TORQUE = stancekit.WholeBodyLimits(torque_nm=10.0)
STRAIGHT = stancekit.WholeBodyLimits(torque_nm=10.0, steps=0)


def test_postures_between_walls_are_bent_until_the_torque_is_enough() -> None:
    held = bent = 0
    for problem in stancekit.sample("wall-3", count=12, rng=2):
        straight, answer = (
            stancekit.plan(problem, robot="hexapod", settings=stancekit.PlanSettings(body=body))
            for body in (STRAIGHT, TORQUE)
        )
        assert (answer.certificate is None) == (straight.certificate is None)
        held += straight.status.value == "feasible"
        if answer.status.value != "feasible":
            continue
        bent += 1
        plan = answer.solution
        assert plan.problem.robot.limb_names == tuple(sorted(problem.legs))
        assert plan.joints_rad.shape == (1, 12)
        assert answer.report.group("torque").verdict == "holds"
        bodies = answer.report.group("bodies")
        assert bodies.verdict == "not checked"
        assert (answer.report.accepted, "bodies" in answer.report.unchecked) == (True, True)
        assert answer.details["torque_nm"] <= 10.0
        order = [plan.problem.robot.limb_names.index(name) for name in problem.legs]
        posture = stancekit.Plan.of_posture(
            problem,
            com_m=plan.com_m[0],
            rotation_rad=plan.rotation_rad[0],
            toes_m=plan.toes_m[order],
            forces_n=plan.forces_n[0, order],
        )
        assert stancekit.verify(posture).accepted
    assert bent >= held + 3


def test_a_posture_of_some_legs_of_a_file_is_bent_saved_and_read(tmp_path: Path) -> None:
    """Of six problems the first that has a posture."""
    looked = 0
    for problem in stancekit.sample("wall-3", robot=str(ANT), count=6, rng=0):
        answer = stancekit.plan(problem, robot=ANT)
        assert answer.problem.legs == tuple(
            name for name in stancekit.robot(ANT).limb_names if name in problem.legs
        )
        if answer.status.value != "feasible":
            continue
        stancekit.save(answer.solution, tmp_path / "plan.json")
        plan = stancekit.load(tmp_path / "plan.json")
        assert plan.problem.robot.absent == answer.solution.problem.robot.absent
        assert stancekit.verify(plan).unchecked
        np.testing.assert_array_equal(plan.joints_rad, answer.solution.joints_rad)
        assert stancekit.verify(plan).accepted
        looked += 1
        break
    assert looked


def test_a_file_of_a_posture_takes_the_robot_too(tmp_path: Path) -> None:
    problem = stancekit.sample("wall-3", rng=0)[0]
    stancekit.save(problem, tmp_path / "posture.json")
    answer = stancekit.plan(
        tmp_path / "posture.json", robot="hexapod", settings=stancekit.PlanSettings(body=TORQUE)
    )
    assert answer.status.value == "feasible"
    assert answer.solution.joints_rad is not None


def test_another_robot_and_one_without_these_limbs_are_refused() -> None:
    problem = stancekit.sample("wall-3", rng=0)[0]
    ant = stancekit.robot(ANT)
    with refuses("robot", ant.identity):
        stancekit.plan(problem, robot=ant)
    other = stancekit.sample("wall-3", robot=str(ANT), rng=0)[0]
    with refuses("robot", ant.identity):
        stancekit.plan(other, robot="hexapod")
    two = stancekit.Robot(name="two", mass_kg=10.0, limbs=stancekit.hexapod().limbs[:2])
    with refuses("leg", "RF"):
        stancekit.plan(problem, robot=two)
