"""A step's rows to first order: feet and torques against differences of pinocchio's own; restored
plans are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.equilibrium.terms import BodyVariables, Forces, Given, Moments
from stancekit.planners.files.arrays import Array
from stancekit.planners.projection.force_distribution import REACHED_M, Restoration

pytest.importorskip("pinocchio")
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.projection.whole_body_step import (
    UPRIGHT_RAD,
    TorqueRows,
    WholeBodyGiven,
    WholeBodyStep,
    joint_ranges,
    keeps_to,
)
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

SMALL = 1e-6


@pytest.fixture(scope="module")
def walls(course_plan: Callable[[str, int], Motion]) -> Motion:
    return course_plan("walls", 3)


@pytest.fixture(params=["drawn up", "of a file"])
def plan(request: pytest.FixtureRequest, walls: Motion, dog_plan: Motion) -> Motion:
    return with_joints(walls if request.param == "drawn up" else dog_plan)


def scaled_of(plan: Motion) -> Scaled:
    return Scaled.of(plan.problem).chosen(plan.choice)


def restoration_of(plan: Motion) -> tuple[Restoration, Kinematics]:
    solver = Kinematics(plan.problem.robot)
    return Restoration(plan, scaled_of(plan), solver, solver.torque_nm), solver


@pytest.fixture
def about(plan: Motion) -> WholeBodyGiven:
    """Somewhere near the plan, tilted, where no foot is at its toe: rows are first order
    anywhere.
    """
    restoration, solver = restoration_of(plan)
    rng, point = np.random.default_rng(0), restoration.point()
    tilted = replace(point, rotation=rng.uniform(-0.3, 0.3, point.rotation.shape))
    angles = np.asarray(plan.joints_rad)
    return WholeBodyGiven(
        scaled_of(plan),
        tilted,
        solver=solver,
        angles=angles + rng.uniform(-0.2, 0.2, angles.shape),
        limit_nm=solver.torque_nm,
    )


def torques(at: WholeBodyGiven, point: Point, angles: Array) -> Array:
    """Of every row, by pinocchio."""
    layout, rows = at.scaled.layout, TorqueRows.of(at.scaled.layout, tuple(at.solver.legs.tolist()))
    stance, limb, _ = layout.contacts
    world = np.zeros((len(layout.stances), layout.limbs, 3))
    world[stance, limb] = at.scaled.in_world(point.forces) * at.scaled.force_n
    each = [
        at.solver.torques(angles[k], rotation_of(point.rotation[k]), world[s])
        for s, k in enumerate(layout.stance_frames)
    ]
    return np.array(each)[stance[rows.contact], rows.joint]


def test_torque_rows_have_the_value_and_the_slopes_of_pinocchios_torques(
    about: WholeBodyGiven,
) -> None:
    rows = TorqueRows.of(about.scaled.layout, tuple(about.solver.legs.tolist()))
    point, angles, rng = about.held, about.angles, np.random.default_rng(1)
    now = torques(about, point, angles)
    sign = np.where(now < 0.0, -1.0, 1.0) / about.limit_nm[rows.joint]
    np.testing.assert_allclose(about.torque.value, sign * now, atol=1e-12)
    for _ in range(3):
        by_q, by_turn, by_force = (
            rng.normal(size=a.shape) for a in (angles, point.rotation, point.forces)
        )

        def moved(h: float, steps: tuple[Array, Array, Array] = (by_q, by_turn, by_force)) -> Array:
            q, turn, force = steps
            there = replace(
                point, rotation=point.rotation + h * turn, forces=point.forces + h * force
            )
            return torques(about, there, angles + h * q)

        slope = sign * (moved(SMALL) - moved(-SMALL)) / (2.0 * SMALL)
        mine = (about.torque.by_force * by_force[rows.contact]).sum(axis=1)
        mine += (about.torque.by_turn * by_turn[rows.frame]).sum(axis=1)
        np.add.at(mine, rows.row, about.torque.by_joint * by_q[rows.frame[rows.row], rows.other])
        np.testing.assert_allclose(mine, slope, atol=1e-6)
    at_rest = about.torque.right - (about.torque.by_turn * point.rotation[rows.frame]).sum(axis=1)
    linear = (about.torque.by_force * point.forces[rows.contact]).sum(axis=1)
    np.testing.assert_allclose(linear - at_rest, about.torque.value, atol=1e-12)


def test_feet_move_with_joints_and_with_the_body_as_pinocchio_has_them(
    about: WholeBodyGiven,
) -> None:
    length_m, rng = about.scaled.length_m, np.random.default_rng(2)
    by_q, by_turn = rng.normal(size=about.angles.shape), rng.normal(size=about.held.rotation.shape)

    def arms(h: float) -> Array:
        turns = [rotation_of(vector) for vector in about.held.rotation + h * by_turn]
        feet = [about.solver.feet(q) - about.solver.robot.origin_m for q in about.angles + h * by_q]
        return np.array([foot @ turn.T for foot, turn in zip(feet, turns, strict=True)]) / length_m

    slope = (arms(SMALL) - arms(-SMALL)) / (2.0 * SMALL)
    mine = np.einsum("mnij,mj->mni", about.by_turn, by_turn)
    np.add.at(mine, (slice(None), about.solver.legs), about.by_joint * by_q[..., None])
    np.testing.assert_allclose(about.arms, arms(0.0), atol=1e-12)
    np.testing.assert_allclose(mine, slope, atol=1e-7)


def test_a_step_keeps_its_trust_region_and_puts_feet_at_toes_to_first_order(plan: Motion) -> None:
    restoration, solver = restoration_of(plan)
    start = restoration.restore(restoration.point(), np.asarray(plan.joints_rad))
    assert start is not None
    at = WholeBodyGiven(
        scaled_of(plan),
        start.point,
        solver=solver,
        angles=start.angles,
        limit_nm=solver.torque_nm,
        wanted=0.5 * start.share,
        radius=0.1,
    )
    step = WholeBodyStep(at.scaled.layout, tuple(solver.legs.tolist()), False)

    def stepped(radius: float) -> tuple[Point, Array, float]:
        """The step, and how far feet are from their toes after it."""
        found = step.solve(replace(at, radius=radius))
        assert found is not None
        point, angles = found
        there = WholeBodyGiven(
            at.scaled, point, solver=solver, angles=angles, limit_nm=solver.torque_nm
        )
        gap = point.com[:, None] + there.arms - point.toes[np.array(at.scaled.layout.holds)]
        normals = at.scaled.frames[:, :, 0][np.array(at.scaled.layout.holds)]
        gap -= (solver.radii_m / at.scaled.length_m)[:, None] * normals
        return point, angles, float(np.abs(gap).max())

    point, angles, gap = stepped(at.radius)
    moved = {
        "com": point.com - start.point.com,
        "rotation": point.rotation - start.point.rotation,
        "toes": point.toes - start.point.toes,
        "joints": angles - start.angles,
    }
    assert all(np.abs(each).max() <= at.room(name) + 1e-7 for name, each in moved.items())
    assert (
        max(np.abs(each).max() / at.room(name) for name, each in moved.items()) > 0.99
    )  # it is used
    assert gap < 5e-4
    assert stepped(0.5 * at.radius)[2] < 0.3 * gap  # of second order in the step
    held = WholeBodyStep(at.scaled.layout, tuple(solver.legs.tolist()), True).solve(at)
    assert held is not None
    np.testing.assert_array_equal(held[0].toes, start.point.toes)


def test_joints_of_legs_that_stand_turn_no_farther_from_frame_to_frame_than_they_may(
    walls: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stancekit.planners.projection.whole_body_step.TURN_RAD", 0.0)
    plan = with_joints(walls)
    restoration, solver = restoration_of(plan)
    start = restoration.restore(restoration.point(), np.asarray(plan.joints_rad))
    assert start is not None
    legs = tuple(solver.legs.tolist())
    at = WholeBodyGiven(
        scaled_of(plan),
        start.point,
        solver=solver,
        angles=start.angles,
        limit_nm=solver.torque_nm,
        wanted=0.5 * start.share,
        radius=1.0,
    )
    found = WholeBodyStep(at.scaled.layout, legs, False).solve(at)
    assert found is not None
    holds = np.array(plan.problem.holds)
    stays = np.repeat(holds[1:] == holds[:-1], 4, axis=1)
    assert stays.any()
    assert not stays.all()
    before, after = (np.abs(np.diff(angles, axis=0)) for angles in (start.angles, found[1]))
    assert (after - before)[stays].max() <= 1e-6
    assert (after - before)[~stays].max() > 1e-3


def test_what_is_restored_is_exact(plan: Motion) -> None:
    restoration, solver = restoration_of(plan)
    scaled, rng = scaled_of(plan), np.random.default_rng(3)
    start = restoration.point()
    off = replace(start, forces=start.forces + 1e-4 * rng.normal(size=start.forces.shape))
    angles = np.asarray(plan.joints_rad)
    restored = restoration.restore(off, angles + 0.01 * rng.normal(size=angles.shape))
    assert restored is not None
    np.testing.assert_array_equal(restored.point.toes, start.toes)
    forces, _ = scaled.forces_si(restored.point)
    course = plan.problem
    for s, of in enumerate(course.stances):
        toes, com, k = plan.toes_at(of.frame), plan.com_m[of.frame], of.frame
        assert (
            np.abs(forces[s].sum(axis=0) - [0.0, 0.0, course.weight_n]).max()
            < 1e-9 * course.weight_n
        )
        assert np.abs(np.cross(toes - com, forces[s]).sum(axis=0)).max() < 2e-9 * course.weight_n
        normals = np.array([course.patch(int(p), plan.choice).normal for p in course.holds[k]])
        feet = solver.targets(com, rotation_of(plan.rotation_rad[k]), toes, normals)
        assert np.linalg.norm(solver.feet(restored.angles[k]) - feet, axis=1).max() <= REACHED_M
        torque = np.abs(
            solver.torques(restored.angles[k], rotation_of(plan.rotation_rad[k]), forces[s])
        )
        assert restored.shares[s] == pytest.approx((torque / solver.torque_nm).max(), rel=1e-9)


def test_feet_out_of_reach_are_not_restored(plan: Motion, walls: Motion) -> None:
    restoration, _ = restoration_of(plan)
    point = restoration.point()
    far = replace(point, com=point.com + np.array([0.0, 0.0, 2.0]))
    assert restoration.restore(far, np.asarray(plan.joints_rad)) is None


def test_hips_that_are_drawn_up_stay_off_the_axis_of_yaw_and_those_beyond_go_no_farther(
    walls: Motion,
) -> None:
    solver = Kinematics(walls.problem.robot)
    angles = np.zeros((2, 24))
    angles[0, 1], angles[1, 5] = 1.6, -1.7
    lower, upper = joint_ranges(solver, angles)
    assert (upper[0, 1], lower[0, 1]) == (1.6, -UPRIGHT_RAD)
    assert (upper[1, 5], lower[1, 5]) == (UPRIGHT_RAD, -1.7)
    layout = scaled_of(walls).layout
    turned = np.zeros((layout.frames, 24))
    assert keeps_to(solver, layout, turned, turned)
    turned[1:, 0] = 0.9  # of a limb that stands on at frame 1
    assert walls.problem.holds[0][0] == walls.problem.holds[1][0]
    assert not keeps_to(solver, layout, np.zeros_like(turned), turned)
    assert keeps_to(solver, layout, turned, turned)
    turned[:, 0], turned[1, 1] = 0.0, 0.45
    assert keeps_to(solver, layout, np.zeros_like(turned), turned)
    others = np.arange(24) % 4 != 1
    np.testing.assert_array_equal(lower[:, others], np.tile(solver.lowest_rad[others], (2, 1)))
    np.testing.assert_array_equal(upper[:, others], np.tile(solver.highest_rad[others], (2, 1)))


@pytest.mark.parametrize("each", [False, True])
def test_what_one_stance_cannot_balance_is_no_others_to_leave(dog_plan: Motion, each: bool) -> None:
    """The body of a quadruped on level ground is held beside its feet, at the last key frame
    alone.
    """
    restoration, _ = restoration_of(with_joints(dog_plan))
    point, scaled = restoration.point(), scaled_of(dog_plan)
    beside = point.com + np.outer(np.arange(len(point.com)) == len(point.com) - 1, [1.0, 1.0, 0.0])
    rows = Rows[Given](keep=False)
    body, forces = BodyVariables(rows, scaled.layout), Forces.of_contacts(rows, scaled.layout)
    forces.balance()
    rows.linear(Moments.of(scaled.layout, body, forces, "held_arms").within(rows, each=each), 1.0)
    forces.in_cones()
    forces.in_box(implied=False)
    body.held()
    found = rows.solve(Given(scaled, replace(point, com=beside)))
    assert found.solved
    left, last = found.value("residual"), scaled.layout.stance_frames == len(point.com) - 1
    if each:
        assert left[last].min() > 0.1
        np.testing.assert_allclose(left[~last], 0.0, atol=1e-6)
    else:
        assert left.shape == (1,)
        assert left[0] > 0.1
