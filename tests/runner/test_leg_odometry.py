"""Leg odometry against the poses that joints were found for, and against a world that measures the
body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.plan_motion import PlanMotion, Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.search.witness import with_whole_body
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.estimation import leg_odometry, odometry_error_m
from stancekit.runner.log import Record
from stancekit.runner.motion.time_parametrization import joint_profile
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner, simulate
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from stancekit.runner.worlds.world import State


def state_of(angles: np.ndarray) -> State:
    """Joints alone."""
    nothing = np.zeros((6, 3))
    return State(
        time_s=0.0,
        position_m=np.zeros(3),
        rotation=np.eye(3),
        velocity=np.zeros(6),
        angles_rad=angles,
        rates_rad_s=np.zeros(24),
        torques_nm=np.zeros(24),
        feet_m=nothing,
        forces_n=nothing,
        bump_n=0.0,
        sent_rad=angles,
    )


def test_joints_that_go_where_they_are_sent_say_where_the_body_is(
    step: Callable[[str], Plan],
) -> None:
    kinematics = Kinematics(step("walls").problem.robot)
    targets = joint_profile(PlanMotion(step("walls")), kinematics).targets
    record = Record(pairs=[(target, state_of(target.angles_rad)) for target in targets])
    origins, rotations = leg_odometry(record, kinematics)
    wanted = np.array([target.origin_m for target in targets])
    assert np.linalg.norm(wanted - wanted[0], axis=1).max() > 0.01, "the body moves"
    np.testing.assert_allclose(origins, wanted, atol=5e-4)
    turns = np.array([rotation_of(target.sample.rotation_rad) for target in targets])
    np.testing.assert_allclose(rotations, turns, atol=5e-3)
    assert odometry_error_m(record, kinematics) < 5e-4


def test_a_body_that_sank_is_seen_by_the_joints_of_the_feet_that_stand(
    step: Callable[[str], Plan],
) -> None:
    kinematics = Kinematics(step("walls").problem.robot)
    targets = joint_profile(PlanMotion(step("walls")), kinematics).targets[:20]
    sunk = np.array([0.0, 0.0, -0.01])
    pairs = [(targets[0], state_of(targets[0].angles_rad))]
    for target in targets[1:]:
        rotation = rotation_of(target.sample.rotation_rad)
        feet = kinematics.feet(target.angles_rad) - sunk @ rotation
        angles, error = kinematics.reach(feet, target.angles_rad, target.angles_rad)
        assert error.max() < 1e-4
        pairs.append((target, state_of(angles)))
    assert odometry_error_m(Record(pairs=pairs), kinematics) == pytest.approx(0.01, abs=5e-4)


def test_it_says_what_a_world_measures_where_a_blind_run_goes(step: Callable[[str], Plan]) -> None:
    plan = step("stairs")
    world, kept = make_world("mujoco", plan.problem.robot), Record()
    runner = Runner(world, settings=RunSettings(check_limits=False, blind=True))
    prepared = runner.prepare(Accepted.verified(plan, "a step"))

    def motion() -> str:
        runner.follow(prepared, kept)
        return ""

    _, message = runner.perform(prepared, motion)
    assert not message
    origins, _ = leg_odometry(kept, prepared.kinematics)
    measured = np.array([state.position_m for _, state in kept.pairs])
    wanted = np.array([target.origin_m for target, _ in kept.pairs])
    assert np.linalg.norm(origins - measured, axis=1).max() < 0.005
    assert np.linalg.norm(measured - wanted, axis=1).max() > 1e-4
    shorter = Record(
        pairs=[
            (target, replace(state, angles_rad=target.angles_rad))
            for target, state in kept.pairs[:5]
        ]
    )
    assert odometry_error_m(shorter, prepared.kinematics) < 5e-4


@pytest.fixture(scope="module")
def climbed() -> dict[bool, RunReport]:
    """Two steps up the walls, the body's measurement withheld: by joints alone, and with what they
    and the feet say fed back.
    """
    outcome = with_whole_body(plan_with_reserve(TwoStagePlanner(), read_course("walls", frames=3)))
    assert outcome.solution is not None

    def run(odometry: bool) -> RunReport:
        settings = RunSettings(
            check_limits=False, blind=True, odometry=odometry, timing=Timing().at_pace(2.0)
        )
        return simulate(outcome.solution, settings=settings)

    return {odometry: run(odometry) for odometry in (False, True)}


def test_fed_back_it_keeps_the_body_nearer_to_its_plan_than_joints_alone(
    climbed: dict[bool, RunReport],
) -> None:
    alone, fed = climbed[False].execution, climbed[True].execution
    assert climbed[False].succeeded
    assert climbed[True].succeeded
    assert alone is not None
    assert fed is not None
    assert fed.body_rms_m < 0.7 * alone.body_rms_m
    assert fed.body_worst_m < 0.0018 < alone.body_worst_m


def test_a_report_says_who_told_where_the_body_is(climbed: dict[bool, RunReport]) -> None:
    assert climbed[False].body_from == "nothing"
    assert climbed[True].body_from == "leg odometry" == climbed[True].to_json()["body_from"]
    assert climbed[True].odometry_m < climbed[False].odometry_m
