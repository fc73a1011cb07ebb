"""Where a robot is measured to stand: on its patches, on the terrain around them, on a border, or
nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.motion.motion import Played
from stancekit.planners.motion.plan_motion import Timing, plan_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.search.witness import with_whole_body
from stancekit.planners.terrain import Patch
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.estimation import (
    BORDER_M,
    SILENT_S,
    SilentFeet,
    estimate_standing,
    leg_odometry,
    odometry_error_m,
)
from stancekit.runner.control.foot_placement import ContactFeedback, touch_n
from stancekit.runner.control.tracker import Target, Tracker
from stancekit.runner.log import Record
from stancekit.runner.motion.time_parametrization import BLIND, RATE_HZ, expected
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import State, make_world
from tests.runner.test_friction import PERIOD_S, felt

ROBOT = hexapod()
KINEMATICS = Kinematics(ROBOT)
LIMBS = len(ROBOT.limbs)


def square(
    half_m: float, *, friction: float = 0.7, height_m: float = 0.0, middle_m: float = 0.0
) -> Patch:
    corners = half_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [
        middle_m,
        0.0,
        height_m,
    ]
    return Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=friction)


def stands(x_m: float, height_m: float = 0.0) -> State:
    """All feet at the same place, pressed height_m into the plane."""
    toes = np.tile([x_m, 0.0, height_m], (LIMBS, 1))
    joints = len(KINEMATICS.joints)
    return State(
        time_s=0.0,
        position_m=np.array([0.0, 0.0, 0.2]),
        rotation=np.eye(3),
        velocity=np.zeros(6),
        angles_rad=np.zeros(joints),
        rates_rad_s=np.zeros(joints),
        torques_nm=np.zeros(joints),
        feet_m=toes + KINEMATICS.radii_m[:, None] * [0.0, 0.0, 1.0],
        forces_n=np.tile([0.0, 0.0, 15.0], (LIMBS, 1)),
        bump_n=0.0,
        sent_rad=np.zeros(joints),
    )


WINDOW = (square(0.05),) * LIMBS
"""What a plan had under every foot: a part of the ground."""


def test_a_foot_on_its_patch_is_put_into_its_plane() -> None:
    found = estimate_standing(WINDOW, stands(0.03, -0.002), KINEMATICS, (square(1.0),))
    assert found.patches == WINDOW
    np.testing.assert_allclose(found.toes_m, np.tile([0.03, 0.0, 0.0], (LIMBS, 1)), atol=1e-12)


def test_a_foot_that_slid_beyond_its_patch_stands_where_it_is_with_the_friction_that_is_there() -> (
    None
):
    ice = square(0.1, friction=0.2, middle_m=0.15)
    below = square(1.0, height_m=-0.05)
    found = estimate_standing(WINDOW, stands(0.062), KINEMATICS, (below, square(0.05), ice))
    assert found.patches == (ice,) * LIMBS
    np.testing.assert_allclose(found.toes_m, np.tile([0.062, 0.0, 0.0], (LIMBS, 1)), atol=1e-12)


def test_a_foot_a_little_beyond_all_terrain_is_on_the_border_and_one_farther_off_nowhere() -> None:
    found = estimate_standing(
        WINDOW,
        stands(0.05 + 0.5 * BORDER_M),
        KINEMATICS,
        (square(0.05), square(1.0, height_m=-0.3)),
    )
    np.testing.assert_allclose(found.toes_m[:, 0], 0.05)
    assert (
        estimate_standing(WINDOW, stands(0.05 + 1.5 * BORDER_M), KINEMATICS, (square(0.05),))
        is None
    )


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


def targets_of(motion: Played, kinematics: Kinematics) -> list[Target]:
    tracker = Tracker(motion, kinematics, RATE_HZ, BLIND)
    return [tracker.start(), *iter(lambda: tracker.next(expected(tracker.coming)), None)]


def test_joints_that_go_where_they_are_sent_say_where_the_body_is(
    step: Callable[[str], Motion],
) -> None:
    kinematics = Kinematics(step("walls").problem.robot)
    targets = targets_of(plan_motion(step("walls")), kinematics)
    record = Record(pairs=[(target, state_of(target.angles_rad)) for target in targets])
    origins, rotations = leg_odometry(record, kinematics)
    wanted = np.array([target.origin_m for target in targets])
    assert np.linalg.norm(wanted - wanted[0], axis=1).max() > 0.01, "the body moves"
    np.testing.assert_allclose(origins, wanted, atol=5e-4)
    turns = np.array([rotation_of(target.sample.rotation_rad) for target in targets])
    np.testing.assert_allclose(rotations, turns, atol=5e-3)
    assert odometry_error_m(record, kinematics) < 5e-4


def test_a_body_that_sank_is_seen_by_the_joints_of_the_feet_that_stand(
    step: Callable[[str], Motion],
) -> None:
    kinematics = Kinematics(step("walls").problem.robot)
    targets = targets_of(plan_motion(step("walls")), kinematics)[:20]
    sunk = np.array([0.0, 0.0, -0.01])
    pairs = [(targets[0], state_of(targets[0].angles_rad))]
    for target in targets[1:]:
        rotation = rotation_of(target.sample.rotation_rad)
        feet = kinematics.feet(target.angles_rad) - sunk @ rotation
        angles, error = kinematics.reach(feet, target.angles_rad, target.angles_rad)
        assert error.max() < 1e-4
        pairs.append((target, state_of(angles)))
    assert odometry_error_m(Record(pairs=pairs), kinematics) == pytest.approx(0.01, abs=5e-4)


def test_it_says_what_a_world_measures_where_a_blind_run_goes(
    step: Callable[[str], Motion],
) -> None:
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
    outcome = with_whole_body(plan_with_reserve(TwoStage(), read_course("walls", frames=3)))
    assert outcome.solution is not None

    def run(odometry: bool) -> RunReport:
        settings = RunSettings(
            check_limits=False, blind=True, odometry=odometry, timing=Timing().at_pace(2.0)
        )
        return stancekit.simulate(outcome.solution, settings=settings)

    return {odometry: run(odometry) for odometry in (False, True)}


def test_fed_back_it_keeps_the_body_nearer_to_its_plan_than_joints_alone(
    climbed: dict[bool, RunReport],
) -> None:
    alone, fed = climbed[False].execution, climbed[True].execution
    assert climbed[False].succeeded
    assert climbed[True].succeeded
    assert fed.body_rms_m < 0.7 * alone.body_rms_m
    assert fed.body_worst_m < 0.0018 < alone.body_worst_m


def test_a_report_says_who_told_where_the_body_is(climbed: dict[bool, RunReport]) -> None:
    assert climbed[False].body_from == "nothing"
    assert climbed[True].body_from == "leg odometry" == climbed[True].to_json()["body_from"]
    assert climbed[True].odometry_m < climbed[False].odometry_m


PERIODS = round(SILENT_S / PERIOD_S)


def said(
    feet: SilentFeet, periods: int, loads: tuple[float, float], foothold: tuple[int, int] = (0, 1)
) -> str:
    """The last that is said in so many periods. loads: shares of the planned 30 N that the feet
    feel.
    """
    line = ""
    for target, state in felt(np.zeros((periods, 2)), (0.0, 0.0), foothold).pairs:
        line = feet.found(
            target, replace(state, forces_n=np.array(loads)[:, None] * state.forces_n)
        )
    return line


def test_a_foot_that_should_press_and_feels_nothing_is_named_after_a_while_over_several_stances() -> (
    None
):
    feet = SilentFeet(1.0 / PERIOD_S, 60.0, ("LF", "RF"))
    assert said(feet, PERIODS // 2 + 1, (1.0, 0.0)) == ""
    assert (
        said(feet, PERIODS, (1.0, 0.0), foothold=(0, -1)) == ""
    )  # in the air nothing is to be felt
    line = said(feet, PERIODS // 2, (1.0, 0.0))
    assert line.startswith("foot of RF: expected 30 N where it stands, felt none for 0.3 s")


def test_a_foot_that_feels_something_begins_anew() -> None:
    feet = SilentFeet(1.0 / PERIOD_S, 60.0, ("LF", "RF"))
    for _ in range(3):
        assert said(feet, PERIODS - 2, (1.0, 0.0)) == ""
        assert said(feet, 1, (1.0, 0.5)) == ""


def test_of_a_light_robot_less_is_expected() -> None:
    heavy, light = (
        SilentFeet(1.0 / PERIOD_S, weight_n, ("LF", "RF")) for weight_n in (300.0, 20.0)
    )
    record = felt(np.zeros((PERIODS + 1, 2)), (0.0, 0.0), load_n=5.0)
    lines = [
        [
            feet.found(target, replace(state, forces_n=0.0 * state.forces_n))
            for target, state in record.pairs
        ][-1]
        for feet in (heavy, light)
    ]
    assert lines[0] == ""
    assert "expected 5 N" in lines[1]


def test_feet_of_a_robot_that_weighs_little_touch_with_less() -> None:
    feet = SilentFeet(1.0 / PERIOD_S, 1.4, ("LF", "RF"))  # a robot of 0.14 kg
    record = felt(np.zeros((PERIODS + 1, 2)), (0.0, 0.0), load_n=0.5)
    assert [feet.found(target, state) for target, state in record.pairs][-1] == ""
    assert touch_n(1.4) < 0.1
    assert touch_n(60.0) == ContactFeedback().touch_n
