"""What is said of leaps that are judged on legs and bent: of contacts, of legs, and of the time."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import LeapPlan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.formats.leap_file import read_leap
from stancekit.planners.leap.bend import (
    LeapBender,
    joint_rows,
    judged_answer,
    legged_numbers,
    point_of,
    unloaded,
)
from stancekit.planners.leap.numbers import LeapGiven
from stancekit.planners.leap.scp import FRICTION_SHARE, reserved
from stancekit.planners.motion.leap_motion import LeapBody
from stancekit.planners.problem.leap import LeapLimits
from stancekit.planners.verify.leaps import LeapBodyMeasurements
from tests.refusals import assert_names

FILE = Path(__file__).parents[2] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def plan() -> LeapPlan:
    found = read_leap(FILE).plan
    assert found is not None
    return found


def said(plan: LeapPlan) -> Answer[LeapPlan]:
    """What is said of a plan when the time for bending has ended."""
    answer = Answer(status=Status.FEASIBLE, solution=plan, problem=plan.problem, method="finder")
    return judged_answer(answer, Programs(), deadline=time.perf_counter() - 1.0)


def test_contacts_that_do_not_hold_are_not_laid_to_legs(plan: LeapPlan):
    weak = replace(plan, problem=replace(plan.problem, limits=LeapLimits(force_share=0.3)))
    judged = LeapBender(Programs()).judge(weak)
    assert not any(group.verdict == "violated" for group in judged.groups)
    assert not judged.accepted
    assert judged.score > 0.0
    answer = said(weak)
    assert answer.status is Status.UNDECIDED
    assert_names(answer.message, "force_bounds")


def test_a_leap_that_nobody_had_time_to_bend_says_so(plan: LeapPlan, tmp_path):
    from stancekit.configs import config_path
    from stancekit.planners.robot.leg_limits import leaping_robot

    text = config_path("robots/anymal.urdf").read_text()
    (tmp_path / "slow.urdf").write_text(text.replace('velocity="12"', 'velocity="5"'))
    model = leaping_robot(tmp_path / "slow.urdf").source.own_model()
    robot = replace(plan.problem.robot, model=model)
    answer = said(replace(plan, problem=replace(plan.problem, robot=robot)))
    assert answer.status is Status.UNDECIDED
    assert_names(answer.message, "time", "joint_speed")


def test_rows_of_joints_have_the_derivatives_of_legs_that_bend(plan: LeapPlan):
    measured = LeapBodyMeasurements(LeapBody(plan))
    body, solver, numbers = measured.leap_body, measured.kinematics, legged_numbers(measured)
    scaled = reserved(numbers, plan.choice, FRICTION_SHARE)
    given = LeapGiven(scaled, loaded_numbers=numbers, at=point_of(numbers, plan))
    rows, limbs = joint_rows(measured, given), scaled.layout.contacts[1]
    intervals, checked = numbers.contact_intervals, 0

    def bent(k: int, limb: int, step_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Levers of the leg, and −(∂p/∂q)⁻¹, where its foot is so far from its place."""
        angles, rotation = body.postures.angles[k], body.rotation[k]
        feet = solver.feet(angles)
        feet[limb] += rotation.T @ step_m
        moved, missed = solver.reach(feet, angles, angles)
        assert missed.max() < 1e-9
        levers = solver.loads(moved, rotation)[1][solver.legs == limb]
        return levers, -np.linalg.inv(levers.T)

    for b in range(0, len(rows.faster), 5):
        c = b % len(limbs)
        limb, joints = int(limbs[c]), np.flatnonzero(solver.legs == int(limbs[c]))
        turns = {k: bent(k, limb, np.zeros(3))[1] for k in range(len(body.times_s))}
        for n, joint in enumerate(joints):
            speed, torque = solver.velocity_rad_s[joint], solver.torque_nm[joint]
            k = min(turns, key=lambda k: np.abs(turns[k][n] / speed - rows.faster[b, n]).max())
            assert_allclose(turns[k][n] / speed, rows.faster[b, n], rtol=1e-6, atol=1e-9)
            arm = body.toes_m[k, limb] - body.com_m[k]
            moves = body.velocity_m_s[k] + np.cross(numbers.spin @ body.momentum_m2_s[k], arm)
            push = plan.forces_n[intervals[c], limb] * float(body.contact[k, limb])
            for d, step in enumerate(1e-5 * np.eye(3)):
                ahead, back = bent(k, limb, step), bent(k, limb, -step)
                rate = (ahead[1] - back[1])[n] @ moves / speed / 2e-5
                rise = -(ahead[0] - back[0])[n] @ push / torque / 2e-5
                assert rows.speed_placed[b, n, d] == pytest.approx(rate, rel=0.02, abs=0.02)
                assert rows.torque_placed[b, n, d] == pytest.approx(rise, rel=0.02, abs=0.02)
                checked += 1
    assert checked > 50
    assert np.abs(rows.speed_placed).max() > 1.0


def test_toes_are_unloaded_before_they_lift_and_the_flight_says_what_legs_turn(plan: LeapPlan):
    bender = LeapBender(Programs())
    first, eased = bender.bent(plan)
    assert first.accepted
    assert eased.accepted
    leap, before = eased.plan.problem, plan.problem
    assert [len(phase.limbs) for phase in leap.phases] == [4, 4, 0, 4]
    assert sum(leap.timings_s[0]) == pytest.approx(sum(before.timings_s[plan.timing]))
    last = int(np.argmax(leap.holds[leap.interval_phases][:, 0] < 0)) - 1
    assert leap.times_s(0)[last + 1] - leap.times_s(0)[last] == pytest.approx(0.025)
    assert np.linalg.norm(eased.plan.forces_n[last].sum(axis=0)) < 0.06 * leap.weight_n
    assert np.linalg.norm(eased.plan.forces_n[last - 1].sum(axis=0)) > leap.weight_n
    assert np.abs(first.body.turned).max() > 0.01
    assert np.abs(eased.body.turned).max() < 1e-3
    assert_allclose(eased.plan.toes_m, plan.toes_m, atol=0.06)


def test_a_leap_whose_flight_is_short_or_that_has_none_stays_as_it_is(plan: LeapPlan):
    leap = plan.problem
    assert unloaded(leap, plan.timing) is not None
    assert unloaded(replace(leap, timings_s=((0.6, 0.09, 0.6),)), 0) is None
    stands = replace(
        leap, phases=leap.phases[:1], timings_s=((0.6,),), footholds=leap.footholds[:4]
    )
    assert unloaded(stands, 0) is None
    said = replace(leap, limits=replace(leap.limits, lift=0.004))
    assert unloaded(said, plan.timing) is None
    hind = replace(leap.phases[0], limbs=leap.phases[0].limbs[2:])
    parted = replace(
        leap,
        phases=(leap.phases[0], hind, *leap.phases[1:]),
        timings_s=((0.4, 0.2, 0.2, 0.6),),
        footholds=tuple(replace(one, frame=one.frame and one.frame + 1) for one in leap.footholds),
    )
    assert unloaded(parted, 0) is None
    fine = replace(leap.phases[0], intervals=57)
    assert unloaded(replace(leap, phases=(fine, *leap.phases[1:])), plan.timing) is None


@pytest.mark.parametrize(
    ("ramp", "share", "lift"), [(0.5, 1.2, 0.01 / 1.2), (0.002, 1.2, 0.002), (0.5, 0.8, 0.01)]
)
def test_no_toe_may_press_harder_as_it_lifts_than_it_might_before(
    plan: LeapPlan, ramp: float, share: float, lift: float
):
    limits = replace(plan.problem.limits, ramp=ramp, force_share=share)
    eased = unloaded(replace(plan.problem, limits=limits), plan.timing)
    assert eased is not None
    assert eased.limits.lift == pytest.approx(lift)
