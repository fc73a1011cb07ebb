"""Bodies along the runner's own motion: what is clear at key frames may not be on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.joints import JointPath
from stancekit.planners.motion.path import APART_M
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.bodies import TOUCH_M
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.tracker import Target
from stancekit.runner.motion.bodies import postures, spaced
from stancekit.runner.motion.time_parametrization import RATE_HZ, undisturbed
from stancekit.runner.run import Runner
from tests.emulators.memory_world import MemoryWorld
from tests.refusals import refuses


@pytest.fixture(scope="module")
def plan(step: Callable[[str], Plan]) -> Plan:
    return step("stairs")


@pytest.fixture(scope="module")
def targets(plan: Plan) -> list[Target]:
    return undisturbed(PlanMotion(plan), Kinematics(plan.problem.robot))


def test_postures_that_are_judged_are_a_centimetre_apart_from_start_to_end(
    targets: list[Target],
) -> None:
    chosen = list(spaced(targets))
    assert chosen[0] is targets[0]
    assert chosen[-1] is targets[-1]
    for one, other in pairwise(chosen):
        moved = np.linalg.norm(other.sample.feet_m - one.sample.feet_m, axis=1)
        assert moved.max() <= APART_M
        assert np.linalg.norm(other.origin_m - one.origin_m) <= APART_M
    assert len(chosen) < len(targets) / 3


def test_the_toes_of_a_posture_are_on_their_patches_where_the_plan_has_them(
    plan: Plan, targets: list[Target]
) -> None:
    """The motion moves the middles of round feet; a plan's toes are the points that touch."""
    first = postures(targets[:1], Kinematics(plan.problem.robot))
    np.testing.assert_allclose(first.toes_m[0], plan.toes_at(0), atol=1e-9)
    assert first.stands.all()


def test_the_motion_that_is_run_is_the_one_that_is_judged(plan: Plan) -> None:
    """The tracker's postures at 100 Hz against those of the path at the same times: bodies to .2
    mm, joints to 1°.
    """
    solver = Kinematics(plan.problem.robot)
    whole = with_joints(plan, solver)
    motion = PlanMotion(whole)
    targets = undisturbed(motion, solver)
    times = np.minimum(np.arange(len(targets)) / RATE_HZ, motion.duration_s)
    found = JointPath(motion.path, solver).postures(motion.moments(times))
    assert len(times) > 200
    assert np.abs(found.origins_m - [target.origin_m for target in targets]).max() < 2e-4
    assert np.abs(found.angles - [target.angles_rad for target in targets]).max() < np.radians(1.0)


def test_a_motion_through_something_is_refused_before_anything_moves(plan: Plan) -> None:
    """The trunk's front goes into a plate that is ahead of it at the first key frame."""
    whole = with_joints(plan)
    radius = 0.75 * np.mean([np.hypot(*limb.shoulder_m[:2]) for limb in plan.problem.robot.limbs])
    front = plan.com_m[-1] + [radius - 0.006, 0.0, 0.0]
    assert front[0] > plan.com_m[0, 0] + radius + TOUCH_M
    corners = front + 0.02 * np.array([(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)])
    sign = Patch(vertices_m=corners, normal=[-1, 0, 0], shear_reference=[0, 1, 0], friction=0.5)
    course = replace(plan.problem, terrain=(*plan.problem.terrain, sign))
    lit, bare = replace(whole, problem=course), replace(plan, problem=course)
    assert check_plan(lit).accepted
    report = check_plan(lit, joints=True)
    assert report.group("motion").verdict == "violated"
    assert report.group("motion").figures["worst"]["link"] == "body"
    # the runner keeps the whole robot's centre of mass on the path, not the base
    shift = report.group("joints").figures["shift_m"]
    assert report.group("motion").figures["depth_m"] == pytest.approx(0.006, abs=shift)
    assert shift < 0.015
    assert 0.0 < report.group("motion").figures["worst"]["frame"] <= plan.problem.frames - 1
    assert check_plan(whole, joints=True).group("motion").verdict == "holds"
    with refuses("sign", "bodies"):
        Accepted.verified(lit, "sign")
    runner = Runner(MemoryWorld())
    with refuses("sign", "body"):  # a plan without angles: the runner chooses them
        runner.prepare(Accepted.verified(bare, "sign"))
    accepted = Accepted.verified(whole, "stairs")
    assert accepted.digest == check_plan(whole, joints=True).digest  # of all groups
    assert runner.prepare(accepted).pace > 0.0
