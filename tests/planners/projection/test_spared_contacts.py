"""Torques as rows of P1 and P2: to first order those of pinocchio, with balances that are exact, and
less torque on plans of walls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage

pytest.importorskip("pinocchio")
from stancekit.planners.projection import whole_body
from stancekit.planners.projection.force_distribution import Restoration
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.projection.whole_body_step import SparedGiven, TorqueRows, spared_contacts
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

SMALL = 1e-5


@pytest.fixture(scope="module")
def walls(course_plan: Callable[[str, int], Motion]) -> Motion:
    return course_plan("walls", 3)


@pytest.fixture(params=["drawn up", "of a file"])
def given(request: pytest.FixtureRequest, walls: Motion, dog_plan: Motion) -> SparedGiven:
    return of_plan(walls if request.param == "drawn up" else dog_plan, wanted=0.5)


def of_plan(plan: Motion, wanted: float) -> SparedGiven:
    plan = whole_body.with_joints(plan)
    solver, scaled = Kinematics(plan.problem.robot), Scaled.of(plan.problem).chosen(plan.choice)
    point = Restoration(plan, scaled, solver, solver.torque_nm).point()
    angles, limit_nm = np.asarray(plan.joints_rad), np.minimum(solver.torque_nm, 20.0)
    return SparedGiven(
        scaled, point, solver=solver, angles=angles, limit_nm=limit_nm, wanted=wanted
    )


def by_rows(at: SparedGiven, point: Point) -> np.ndarray:
    of = TorqueRows.of(at.scaled.layout, tuple(at.solver.legs.tolist()))
    place = point.toes[at.scaled.layout.contacts[2][of.contact]] - point.com[of.frame]
    share = (at.torque.by_force * point.forces[of.contact]).sum(axis=1) - at.at_nothing
    share += (at.by_place * place).sum(axis=1)
    return np.asarray(share + (at.by_rotation * point.rotation[of.frame]).sum(axis=1))


def by_pinocchio(at: SparedGiven, point: Point, angles: np.ndarray) -> np.ndarray:
    layout = at.scaled.layout
    of = TorqueRows.of(layout, tuple(at.solver.legs.tolist()))
    stance, limb, _ = layout.contacts
    world = np.zeros((len(layout.stances), layout.limbs, 3))
    world[stance, limb] = at.scaled.in_world(point.forces) * at.scaled.force_n
    each = [
        at.solver.torques(angles[k], rotation_of(point.rotation[k]), world[s])
        for s, k in enumerate(layout.stance_frames)
    ]
    return np.asarray(np.array(each)[stance[of.contact], of.joint] / at.limit_nm[of.joint])


def test_rows_are_the_torques_of_joints_that_follow_the_feet_to_first_order(
    given: SparedGiven,
) -> None:
    rng, here = np.random.default_rng(1), given.held
    sign = np.where(by_pinocchio(given, here, given.angles) < 0.0, -1.0, 1.0)
    np.testing.assert_allclose(
        by_rows(given, here), sign * by_pinocchio(given, here, given.angles), atol=1e-6
    )
    off = {
        name: rng.uniform(-1.0, 1.0, np.shape(getattr(here, name)))
        for name in ("com", "rotation", "toes", "forces")
    }
    for size in (SMALL, 10.0 * SMALL):
        there = replace(here, **{n: getattr(here, n) + size * each for n, each in off.items()})
        true = sign * by_pinocchio(given, there, given.joints_at(there))
        error = np.abs(by_rows(given, there) - true).max()
        moved = np.abs(true - sign * by_pinocchio(given, here, given.angles)).max()
        assert moved > size  # it looked at something
        assert error < 0.02 * moved


def test_points_balance_keep_to_their_patches_and_ask_for_less_torque(walls: Motion) -> None:
    at = of_plan(walls, wanted=0.3)
    found = spared_contacts(Programs(), at)
    assert found is not None
    point, angles = found
    layout, scaled = at.scaled.layout, at.scaled
    world = scaled.in_world(point.forces)
    stance, _, foothold = layout.contacts
    net, moment = np.zeros((len(layout.stances), 3)), np.zeros((len(layout.stances), 3))
    arms = point.toes[foothold] - point.com[layout.stance_frames][stance]
    np.add.at(net, stance, world)
    np.add.at(moment, stance, np.cross(arms, world))
    np.testing.assert_allclose(net, np.tile([0.0, 0.0, scaled.weight], (len(net), 1)), atol=1e-6)
    np.testing.assert_allclose(moment, 0.0, atol=1e-6)
    assert (point.forces[:, 0] >= -1e-6).all()
    friction = scaled.friction[foothold] * point.forces[:, 0]
    assert (np.linalg.norm(point.forces[:, 1:], axis=1) <= friction + 1e-6).all()
    assert np.abs(by_rows(at, point)).max() < 0.7 * np.abs(by_rows(at, at.held)).max()
    assert angles.shape == at.angles.shape


def test_a_climb_between_walls_is_within_its_torque_without_a_step_of_bending(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    climb = TwoStage().solve(read_course("walls", frames=8)).solution
    assert climb is not None
    limits = WholeBodyLimits(torque_nm=9.0)
    bent = whole_body.whole_body(climb, limits)
    assert bent.before.share > 1.5
    assert bent.share <= 1.0
    assert 1 <= bent.steps <= whole_body.SPARED
    monkeypatch.setattr(whole_body, "SPARED", 0)
    assert whole_body.whole_body(climb, limits).steps > bent.steps
    forces = whole_body.whole_body(climb, WholeBodyLimits(torque_nm=9.0, steps=0))
    assert forces.steps == 0
    np.testing.assert_array_equal(forces.plan.toes_m, climb.toes_m)
