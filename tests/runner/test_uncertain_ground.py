"""Runs on ground that is off its place by what a plan's map leaves open: feet are lowered until
they feel before the motion begins, and what they do not find is named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.path import touch_downs_m
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.patch import Certainty
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.estimation import SILENT_S, SilentFeet
from stancekit.runner.control.foot_placement import GIVES_M, ContactFeedback, FootPlacement
from stancekit.runner.motion.time_parametrization import rise_m
from stancekit.runner.report import _not_found
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import make_world
from tests.refusals import assert_names
from tests.runner.test_body_feedback import PERIOD_S, kinematics, standing
from tests.runner.test_friction import PERIOD_S as FELT_S, felt

__all__ = ["kinematics"]
FAST = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
NEVER = np.zeros(4, dtype=np.bool_)


def unsure(plan: Motion, sd_m: float) -> Motion:
    """A plan whose ground is known to this standard deviation."""
    sure = Certainty(about_m=np.zeros(2), covariance=np.diag([sd_m**2, 0.0, 0.0]), inset_m=0.02)
    footholds = tuple(
        replace(put, candidates=tuple(patch.with_certainty(sure) for patch in put.candidates))
        for put in plan.problem.footholds
    )
    return replace(plan, problem=replace(plan.problem, footholds=footholds))


def level_but(off_m: float, place: Array) -> list[Patch]:
    """Level ground with a square of 12 cm about a place that is so much higher."""
    x, y = place
    lines = [[x - 2.0, x - 0.06, x + 0.06, x + 2.0], [y - 2.0, y - 0.06, y + 0.06, y + 2.0]]
    return [
        Patch(
            vertices_m=np.array(
                [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]],
            ),
            normal=[0.0, 0.0, 1.0],
            shear_reference=[1.0, 0.0, 0.0],
            friction=0.8,
        )
        for i, (x0, x1) in enumerate(pairwise(lines[0]))
        for j, (y0, y1) in enumerate(pairwise(lines[1]))
        for z in [off_m if i == j == 1 else 0.0]
    ]


@pytest.mark.parametrize("off_m", [-0.006, 0.006])
def test_a_plan_is_executed_on_ground_that_is_off_by_less_than_its_touch_down(
    off_m: float, step: Callable[[str], Motion]
) -> None:
    plan = unsure(step("stairs"), 0.002)
    assert (touch_downs_m(plan) > abs(off_m)).all()
    report = Runner(make_world("mujoco", plan.robot), settings=FAST).run(
        Accepted.verified(plan, "plan"), level_but(off_m, plan.toes_m[3, :2])
    )
    assert report.succeeded, report.message
    trace, depths = report.execution.trace, touch_downs_m(plan)
    assert trace.found(len(depths)).all()
    names = [f"foothold {p}" for p in range(len(depths))]
    assert _not_found(names, trace, depths) == []
    deaf = trace.forces_n * (np.arange(6) != 3)[:, None]
    assert _not_found(names, replace(trace, forces_n=deaf), depths) == [
        "foothold 3 found no ground within 7 mm of its place, nor did 1 others"
    ]
    assert _not_found(names, replace(trace, forces_n=deaf), np.zeros(len(depths))) == []


def test_a_foothold_whose_ground_is_far_below_its_place_is_named(
    step: Callable[[str], Motion],
) -> None:
    plan = unsure(step("stairs"), 0.002)
    report = Runner(make_world("mujoco", plan.robot), settings=FAST).run(
        Accepted.verified(plan, "plan"), level_but(-0.05, plan.toes_m[3, :2])
    )
    assert not report.succeeded
    assert_names(report.message, "RF")


@pytest.mark.parametrize("touch_down_m", [0.0, 0.008])
def test_a_foot_that_should_hardly_press_is_lowered_on_uncertain_ground_before_the_motion_begins(
    kinematics: Kinematics, touch_down_m: float
) -> None:
    _, now = standing(kinematics)
    light = replace(now, forces_n=now.forces_n * np.array([[0.05], [1.0], [1.0], [1.0]]))
    assert 0.0 < light.forces_n[0, 2] < 4.0 * ContactFeedback().touch_n
    feet = FootPlacement(
        light,
        kinematics,
        ContactFeedback(),
        weight_n=kinematics.robot.mass_kg * kinematics.gravity_m_s2,
        step_s=0.0,
        period_s=PERIOD_S,
        touch_downs_m=np.full(4, touch_down_m),
    )
    # what comes before the first period is what is planned, and no proof of ground
    waits = feet.seek(light, light, light.along_n, NEVER)
    feet.follow(light, light, light.along_n, np.zeros((4, 3)), None)
    assert waits.all() == (touch_down_m > 0.0)
    hovers = np.array([0.0, 50.0, 50.0, 50.0])
    waited = 0
    for _ in range(400):
        waited += int(feet.seek(light, light, hovers, NEVER).any())
        feet.follow(light, light, hovers, np.zeros((4, 3)), None)
    if touch_down_m == 0.0:
        assert waited == 0
        assert abs(feet.moved_m[0, 2]) < 1e-9
        return
    deepest = touch_down_m + GIVES_M
    assert waited == pytest.approx(deepest / (ContactFeedback().seek_m_s * PERIOD_S), abs=2)
    assert feet.moved_m[0, 2] == pytest.approx(-deepest, abs=3e-4)
    np.testing.assert_allclose(feet.moved_m[1:, 2], 0.0, atol=3e-4)


def test_the_time_in_which_a_foot_is_lowered_to_uncertain_ground_is_not_silence() -> None:
    periods = round(SILENT_S / FELT_S)
    feet, lines = SilentFeet(1.0 / FELT_S, 60.0, ("LF", "RF")), list[str]()
    record = felt(np.zeros((3 * periods, 2)), (0.0, 0.0), (0, 1))
    for k, (target, state) in enumerate(record.pairs):
        silent = replace(state, forces_n=np.array([[1.0], [0.0]]) * state.forces_n)
        seeks = np.array([False, k < periods])
        lines.append(feet.found(target, silent, seeks))
    assert not any(lines[: 2 * periods - 1])
    assert lines[-1].startswith("foot of RF")


def test_a_robot_is_put_on_the_ground_that_its_feet_would_be_in() -> None:
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    level, lean = (
        Patch(
            vertices_m=square + square[:, :1] * [0.0, 0.0, slope],
            normal=np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0),
            shear_reference=[1.0, 0.0, 0.0],
            friction=0.8,
        )
        for slope in (0.0, 0.2)
    )
    radii = np.full(2, 0.012)
    above, inside = np.array([[0.0, 0.0, 0.012], [0.3, 0.0, 0.03]]), np.array([[0.0, 0.0, 0.003]])
    assert rise_m([level], above, radii) == 0.0
    assert rise_m([level], inside, radii[:1]) == pytest.approx(0.009, abs=1e-3)
    rise = rise_m([level, lean], above, radii)
    foot = above[1] + [0.0, 0.0, rise]
    assert foot[2] == pytest.approx(0.2 * 0.3 + 0.012 * np.hypot(0.2, 1.0), abs=1.1e-3)
