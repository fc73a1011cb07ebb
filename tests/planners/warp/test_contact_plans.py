"""What is planned on level ground stands on curved ground where the map puts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.gait.formulation import formulate
from stancekit.planners.gait.method.guess import along_key_frames
from stancekit.planners.gait.task import GaitSettings
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.walk import Walk
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.robot.single_body import anymal, hexapod_walker
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.warp.conformal import flatten
from stancekit.planners.warp.contact_plans import WarpedPose, pushed_plan
from tests.refusals import refuses

CELLS = (8, 8, 4)
STRETCH = 4e-3
"""How far the map of level ground is from the identity .2 m above it, with so few cells [m]."""
LEVEL = HeightField.from_function(lambda x, y: np.zeros_like(x), 2.0, 0.1, name="level")
WAVES = HeightField.from_function(
    lambda x, y: 0.1 * np.sin(1.5 * x) * np.cos(1.2 * y), 2.0, 0.1, name="waves"
)


@pytest.fixture(scope="module")
def level():
    return flatten(LEVEL, CELLS)


@pytest.fixture(scope="module")
def waves():
    return flatten(WAVES, CELLS)


@pytest.fixture(scope="module")
def plan():
    """Five key frames of the hexapod along x."""
    spec = spec_from(
        {
            "name": "flat",
            "frames": 5,
            "gait": "tripod",
            "start_m": [0.0, 0.0, 0.2],
            "goal_m": [0.4, 0.0, 0.2],
            "stance": {"outward_m": 0.13, "down_m": 0.2},
            "terrain": {"kind": "flat", "friction": 0.6},
        }
    )
    found = TwoStagePlanner().solve(build_course(spec)).solution
    assert found is not None
    return found


def problems(count, seed=0):
    rng = np.random.default_rng(seed)
    return [distribution("ground-3").sample(rng) for _ in range(count)]


def normal_at(field, xy):
    slope = field.gradient(np.asarray(xy))
    up = np.array([-slope[0], -slope[1], 1.0])
    return up / np.linalg.norm(up)


def test_level_ground_pushes_a_problem_to_itself_as_far_as_its_map_is_the_identity(level):
    pose = WarpedPose(warp=level, com_bar_m=np.array([0.3, -0.2, 0.2]))
    for problem in problems(3):
        pushed = pose.problem(problem)
        assert pushed.com_nominal_m == pytest.approx(problem.com_nominal_m, abs=STRETCH)
        for mine, theirs in zip(pushed.contacts, problem.contacts, strict=True):
            assert mine.patch.vertices_m == pytest.approx(theirs.patch.vertices_m, abs=STRETCH)
            assert mine.patch.frame == pytest.approx(theirs.patch.frame, abs=STRETCH)
            assert mine.shoulder_m == pytest.approx(theirs.shoulder_m, abs=STRETCH)


def test_patches_keep_their_size_and_lean_from_the_tangent_plane_as_they_leant_from_level(waves):
    pose = WarpedPose(warp=waves, com_bar_m=np.array([0.4, 0.1, 0.2]), yaw_rad=0.7)
    for contact in problems(1)[0].contacts:
        flat, pushed = contact.patch, pose.patch(contact.patch)
        sides = [
            np.linalg.norm(np.diff(patch.vertices_m, axis=0), axis=1) for patch in (flat, pushed)
        ]
        assert sides[1] == pytest.approx(sides[0], abs=1e-9)
        ground = pose.place(flat.centre_m * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.2])
        lean = float(pushed.normal @ normal_at(WAVES, ground[:2]))
        assert lean == pytest.approx(flat.normal[2], abs=1e-4)
        assert pushed.friction == flat.friction


def test_a_level_patch_on_the_ground_becomes_tangent_there(waves):
    pose = WarpedPose(warp=waves, com_bar_m=np.array([-0.5, 0.3, 0.2]))
    contact = problems(1)[0].contacts[0]
    corners = np.array([[0.2, 0.1, -0.2], [0.24, 0.1, -0.2], [0.24, 0.14, -0.2], [0.2, 0.14, -0.2]])
    flat = replace(contact.patch, vertices_m=corners, normal=np.array([0.0, 0.0, 1.0]))
    pushed = pose.patch(flat)
    centre = pushed.centre_m
    assert centre[2] == pytest.approx(float(WAVES.height(centre[:2])), abs=2e-6)
    assert pushed.normal == pytest.approx(normal_at(WAVES, centre[:2]), abs=1e-4)


def test_bodies_are_turned_by_the_polar_factor(waves):
    pose = WarpedPose(warp=waves, com_bar_m=np.array([0.6, -0.4, 0.25]), yaw_rad=0.3)
    u, _, vt = np.linalg.svd(waves.jacobians(pose.com_bar_m))
    turn = np.array(
        [[np.cos(0.3), -np.sin(0.3), 0.0], [np.sin(0.3), np.cos(0.3), 0.0], [0.0, 0.0, 1.0]]
    )
    assert pose.rotation == pytest.approx(u @ vt @ turn, abs=1e-9)
    problem = problems(1)[0]
    arms = [one.shoulder_m for one in pose.problem(problem).contacts]
    assert arms == [
        pytest.approx(pose.rotation @ one.shoulder_m, abs=1e-12) for one in problem.contacts
    ]


def test_a_pushed_envelope_holds_the_pushed_toes(waves):
    rng = np.random.default_rng(1)
    low = np.hstack([rng.uniform(-0.6, 0.2, (3, 2)), np.full((3, 1), -0.45), np.zeros((3, 3))])
    envelope = Envelope(low=low, high=low + 0.25)
    pose = WarpedPose(warp=waves, com_bar_m=np.array([0.2, 0.5, 0.2]), yaw_rad=1.1)
    pushed = pose.envelope(envelope, 0.6)
    for _ in range(50):
        toes = rng.uniform(envelope.low[:, :3], envelope.high[:, :3])
        world = (pose.place(0.6 * toes) - pose.com_m) / 0.6
        point = np.hstack([world, rng.uniform(envelope.low[:, 3:], envelope.high[:, 3:])])
        assert pushed.contains(point, margin=2e-3)
    assert np.array_equal(pushed.force[0], envelope.force[0])
    steps = np.stack(np.meshgrid(*3 * [np.linspace(0.0, 1.0, 9)]), axis=-1).reshape(-1, 3)
    reached = (pose.place(0.6 * (low[:, None, :3] + 0.25 * steps)) - pose.com_m) / 0.6
    assert np.all(pushed.position[0] >= reached.min(axis=1) - 1e-12), "no larger than what it holds"
    assert np.all(pushed.position[1] <= reached.max(axis=1) + 1e-12)


def test_key_frames_stand_on_the_terrain_in_the_plans_order(waves, plan):
    frames = pushed_plan(waves, plan, np.array([-0.3, 0.2]), 0.4)
    assert frames.com_m.shape == (5, 3)
    assert frames.toes_m.shape == (5, 6, 3)
    assert frames.toes_m[..., 2] == pytest.approx(WAVES.height(frames.toes_m[..., :2]), abs=2e-6)
    assert len(frames.problems) == len(plan.problem.stances)
    lifted = np.linalg.norm(np.diff(frames.toes_m, axis=0), axis=2) > 1e-9
    names = plan.problem.robot.limb_names
    for step, limbs in enumerate(plan.problem.lifts[1:]):
        assert {names[k] for k in np.flatnonzero(lifted[step])} <= set(limbs)


def test_on_level_ground_the_pushed_plan_is_the_plan(level, plan):
    frames = pushed_plan(level, plan, plan.com_m[0, :2])
    assert frames.com_m == pytest.approx(plan.com_m, abs=STRETCH)
    assert frames.toes_m[2] == pytest.approx(plan.toes_at(2), abs=STRETCH)
    halves = frames.com_at(np.array([0.125]))
    assert halves[0] == pytest.approx(0.5 * (plan.com_m[0] + plan.com_m[1]), abs=STRETCH)


@pytest.mark.parametrize("chart", ["decoupled", "warped-exact"])
def test_a_guess_along_key_frames_steps_where_the_key_frames_do(waves, plan, chart):
    frames = pushed_plan(waves, plan, np.array([-0.2, 0.0]))
    task = Walk(
        robot=hexapod_walker(),
        terrain=WAVES,
        start_xy_m=frames.com_m[0, :2],
        goal_xy_m=frames.com_m[-1, :2],
        gait="tripod",
        duration_s=4.0,
    )
    program = formulate(task, GaitSettings(chart=chart), waves)
    motion = replace_x(program, along_key_frames(program.structure, frames)).samples(
        np.array([0.0, 4.0])
    )
    order = [frames.limbs.index(name) for name in task.robot.limb_names]
    for sample, frame in ((0, 0), (1, -1)):
        assert motion.feet_m[sample] == pytest.approx(frames.toes_m[frame][order], abs=2e-3)
        assert motion.torso_m[sample] == pytest.approx(frames.com_m[frame], abs=2e-2)


def replace_x(program, x):
    """A solution that is nothing but its point."""
    from stancekit.planners.gait.gait_program import GaitSolution

    return GaitSolution(
        program=program,
        success=False,
        iterations=0,
        history=(),
        x=x,
        violations={},
        status="",
        seconds=0.0,
        seconds_evaluating=0.0,
        seconds_linear=0.0,
    )


def test_key_frames_of_another_robot_are_refused(waves, plan):
    frames = pushed_plan(waves, plan, np.zeros(2))
    task = Walk(
        robot=anymal(),
        terrain=WAVES,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.2, 0.0]),
        duration_s=2,
    )
    with refuses("key frames"):
        along_key_frames(formulate(task).structure, frames)


def test_a_plan_that_is_not_on_level_ground_is_refused(waves, plan):
    lifted = replace(plan, toes_m=plan.toes_m + np.array([0.0, 0.0, 0.1]))
    with refuses("plan"):
        pushed_plan(waves, lifted, np.zeros(2))
