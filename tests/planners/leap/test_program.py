"""The rows of a leap say what cvxpy says, and its dynamics are exact."""

import time
from dataclasses import replace
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from stancekit import Answer, Motion, Status
from stancekit.planners.equilibrium.layout import LIFTED, Layout
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.leap.bend import (
    LeapBender,
    joint_rows,
    judged_answer,
    legged_numbers,
    point_of,
    unloaded,
)
from stancekit.planners.leap.finder import LeapFinder
from stancekit.planners.leap.numbers import LeapGiven, LeapNumbers, LeapPoint
from stancekit.planners.leap.scp import FRICTION_SHARE, LITTLE, LeapProgram, attempt, reserved
from stancekit.planners.leap.terms import PRICES, SPEED_RESERVE
from stancekit.planners.motion.leap_motion import LeapBody
from stancekit.planners.problem.leap import Leap, LeapLimits
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import LeapBodyMeasurements
from tests.refusals import assert_names

G = 9.81


def turned(vector):
    """[v]×."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def reference(given: LeapGiven) -> cp.Problem:
    """One step of SCP, row by row, in cvxpy: what ``LeapProgram`` writes as blocks."""
    its, scaled, at = given.numbers, given.scaled, given.point
    layout, leap, m = scaled.layout, its.leap, its.intervals
    stances, limbs, footholds = layout.contacts
    when = layout.stance_frames[stances] // 2
    c, r = cp.Variable((2 * m + 1, 3)), cp.Variable((2 * m + 1, 3))
    v, spun = cp.Variable((m + 1, 3)), cp.Variable((m + 1, 3))
    weights, f = (
        cp.Variable(len(layout.vertex_footholds), nonneg=True),
        cp.Variable((len(limbs), 3)),
    )
    own = [np.flatnonzero(layout.vertex_footholds == j) for j in range(layout.footholds)]
    p = [scaled.vertices[rows].T @ weights[rows] for rows in own]
    world = [scaled.contact_frames[b] @ f[b] for b in range(len(limbs))]
    rows = [cp.sum(weights[one]) == 1 for one in own]
    cost, spin = LITTLE * cp.sum_squares(f), its.spin
    means = its.means(at.com, at.velocity)
    total = its.total(at.forces)
    for k in range(m):
        dt = its.lasts[k]
        mine = [b for b in range(len(limbs)) if when[b] == k]
        push = sum((world[b] for b in mine), np.zeros(3))
        rows += [v[k + 1] - v[k] == G * dt * (push - np.array([0, 0, 1]))]
        rows += [c[2 * k + 2] - c[2 * k] == dt / 2 * (v[k] + v[k + 1])]
        rows += [c[2 * k + 1] == (c[2 * k] + c[2 * k + 2]) / 2 - dt / 8 * (v[k + 1] - v[k])]
        rows += [
            r[2 * k + 1]
            == (r[2 * k] + r[2 * k + 2]) / 2 - dt / 8 * (spin @ (spun[k + 1] - spun[k]))
        ]
        mean = (c[2 * k] + c[2 * k + 2]) / 2 - dt / 12 * (v[k + 1] - v[k])
        moment = -turned(means[k]) @ push + turned(total[k]) @ (mean - means[k])
        for b in mine:
            moment += turned(at.toes[footholds[b]]) @ world[b]
            moment -= turned(at.forces[b]) @ (p[footholds[b]] - at.toes[footholds[b]])
        cost += PRICES["moment"] * cp.norm1(spun[k + 1] - spun[k] - G * dt * moment)
        sums = at.velocity[k] + at.velocity[k + 1]
        bend = turned(sums) @ push - turned(total[k]) @ (v[k] + v[k + 1] - sums)
        turn = spin @ (dt / 2 * (spun[k] + spun[k + 1]) + G * dt**3 / 24 * bend)
        cost += PRICES["turn"] * cp.norm1(r[2 * k + 2] - r[2 * k] - turn)
        for b in mine:
            for node in (k, k + 1):
                hip = its.hips[limbs[b]]
                speed = at.velocity[node] + np.cross(spin @ at.momentum[node], hip)
                now = v[node] - turned(hip) @ (spin @ spun[node])
                power = at.forces[b] @ now + speed @ world[b] - at.forces[b] @ speed
                cost += PRICES["power"] * cp.pos(
                    cp.abs(power) - SPEED_RESERVE * its.power[limbs[b]]
                )
    rows += [
        c[0] == its.start[0],
        r[0] == its.start[1],
        v[0] == its.velocity[0],
        v[m] == its.velocity[1],
    ]
    rows += [spun[0] == its.momentum[0], spun[m] == its.momentum[1]]
    rows += [v[1] == v[0], v[m] == v[m - 1], spun[1] == spun[0], spun[m] == spun[m - 1]]
    limits = leap.limits
    rows += [cp.abs(spun[1:m]) <= limits.momentum_m2_s, cp.abs(r[2 * m]) <= limits.goal_tilt_rad]
    rows += [cp.abs(r) <= scaled.tilt, cp.norm(c[2 * m] - leap.goal.com_m) <= leap.goal_radius_m]
    rows += [cp.norm(p[j] - at.toes[j]) <= given.toe_radius for j in range(layout.footholds)]
    for frame, limb, j in zip(*layout.standing, strict=True):
        shoulder, hip = scaled.shoulders[limb], its.hips[limb]
        rows += [
            cp.norm(p[j] - c[frame] - shoulder + turned(shoulder) @ r[frame]) <= scaled.reach[limb]
        ]
        rows += [c[frame][2] - p[j][2] >= limits.height_m + given.reserve_m]
        leg = at.com[frame] + hip + np.cross(at.rotation[frame], hip) - at.toes[j]
        along = leg / np.linalg.norm(leg)
        length = (
            along @ (c[frame] + hip - p[j])
            + np.cross(hip + np.cross(at.rotation[frame], hip), along) @ r[frame]
        )
        cost += PRICES["fold"] * cp.pos(its.fold[limb] + given.reserve_m - length)
        if frame % 2 == 0:
            arm = hip + np.cross(at.rotation[frame], hip)
            rate = along @ (v[frame // 2] - turned(arm) @ (spin @ spun[frame // 2]))
            cost += PRICES["speed"] * cp.pos(cp.abs(rate) - SPEED_RESERVE * its.speed[limb])
    for b in range(len(limbs)):
        rows += [
            cp.norm(f[b, 1:]) <= scaled.friction[footholds[b]] * f[b, 0],
            f[b, 0] <= scaled.force_max[b, 0],
        ]
    return cp.Problem(cp.Minimize(cost), rows)


def given_of(leap: Leap, choice) -> LeapGiven:
    """A step's problem about the nominal motion."""
    numbers = LeapNumbers.of(leap)
    scaled = numbers.scaled.chosen(choice)
    middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
    return LeapGiven(
        scaled, loaded_numbers=numbers, at=replace(numbers.nominal, toes=middles), reserve_m=0.004
    )


def test_the_rows_of_a_step_have_the_optimum_of_their_cvxpy_reference(leap: Leap, failed) -> None:
    step = LeapProgram(failed.data.scaled.layout, leap.still).solve(failed.data)
    problem = reference(failed.data)
    problem.solve(solver=cp.CLARABEL)
    assert step.solution.solved
    assert step.cost > 1e-3  # slack takes part
    assert step.solution.objective == pytest.approx(problem.value, abs=1e-7, rel=1e-4)


def test_steps_of_a_robot_in_boxes_ask_for_its_half_spaces() -> None:
    leap = leap_class("leap-anymal").draw(np.random.default_rng(0))
    given = given_of(leap, np.zeros(8, dtype=int))
    program = LeapProgram(given.scaled.layout, leap.still)
    standing = len(given.scaled.layout.standing[0])
    assert (
        len(program.rows.groups["within"]) == len(program.rows.groups["reach_rows"]) == 6 * standing
    )


def test_momentum_and_rotation_are_those_of_a_fine_integration(leap: Leap) -> None:
    numbers, rng = LeapNumbers.of(leap), np.random.default_rng(3)
    forces = rng.normal(size=(len(numbers.contact_intervals), 3))
    com, velocity = numbers.ballistic(numbers.total(forces))
    toes, layout = rng.normal(size=(8, 3)), numbers.layout
    start = rng.normal(size=(numbers.intervals + 1, 3))
    point = LeapPoint(
        com=com, rotation=0 * com, velocity=velocity, momentum=0 * start, toes=toes, forces=forces
    )
    change = numbers.turned(point)[0]
    momentum = np.concatenate([np.zeros((1, 3)), np.cumsum(change, axis=0)])
    turn = numbers.turned(replace(point, momentum=momentum))[1]
    k, count = 2, 4000
    own = numbers.contact_intervals == k
    t = (np.arange(count) + 0.5) * numbers.lasts[k] / count
    push = G * (forces[own].sum(axis=0) - np.array([0.0, 0.0, 1.0]))
    path = com[2 * k] + t[:, None] * velocity[k] + 0.5 * t[:, None] ** 2 * push
    arms = toes[layout.contacts[2][own]] - path[:, None]
    rate = G * np.cross(arms, forces[own]).sum(axis=1)
    step = numbers.lasts[k] / count
    np.testing.assert_allclose(step * rate.sum(axis=0), change[k], rtol=1e-6)
    along = momentum[k] + step * (np.cumsum(rate, axis=0) - 0.5 * rate)
    np.testing.assert_allclose(step * along.sum(axis=0) @ numbers.spin.T, turn[k], rtol=1e-5)


def test_a_limb_that_is_lifted_stands_on_nothing_and_takes_no_step() -> None:
    layout = Layout(
        holds=((0, 1), (0, LIFTED), (2, 3)),
        stances=((0, (0, 1)), (1, (0,))),
        corners=((3,), (3,), (3,), (3,)),
    )
    assert [part.tolist() for part in layout.standing] == [
        [0, 0, 1, 2, 2],
        [0, 1, 0, 0, 1],
        [0, 1, 0, 2, 3],
    ]
    assert layout.moves.tolist() == [[0, 2]]


def test_programs_are_written_once_per_layout(leap: Leap) -> None:
    programs = Programs()
    numbers = LeapNumbers.of(leap)
    for number in range(3):
        attempt(programs, numbers, np.array([0, 0, 0, 0, number, 1, 2, 3]), steps=1)
    assert len(programs._kept) == 1
    assert LeapFinder().order == "finder"


FILE = Path(__file__).parents[2] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def plan() -> Motion:
    found = read_motion(FILE)[0]
    assert found is not None
    return found


def said(plan: Motion) -> Answer[Motion]:
    """What is said of a plan when the time for bending has ended."""
    answer = Answer(status=Status.FEASIBLE, solution=plan, problem=plan.problem, method="finder")
    return judged_answer(answer, Programs(), deadline=time.perf_counter() - 1.0)


def test_contacts_that_do_not_hold_are_not_laid_to_legs(plan: Motion):
    weak = replace(plan, problem=replace(plan.problem, limits=LeapLimits(force_share=0.3)))
    judged = LeapBender(Programs()).judge(weak)
    assert not any(group.verdict == "violated" for group in judged.groups)
    assert not judged.accepted
    assert judged.score > 0.0
    answer = said(weak)
    assert answer.status is Status.UNDECIDED
    assert_names(answer.message, "force_bounds")


def test_a_leap_that_nobody_had_time_to_bend_says_so(plan: Motion, tmp_path):
    from stancekit.configs import config_path
    from stancekit.planners.robot.walker import leaping_robot

    text = config_path("robots/anymal.urdf").read_text()
    (tmp_path / "slow.urdf").write_text(text.replace('velocity="12"', 'velocity="5"'))
    model = leaping_robot(tmp_path / "slow.urdf").own_model()
    robot = replace(plan.problem.robot, model=model)
    answer = said(replace(plan, problem=replace(plan.problem, robot=robot)))
    assert answer.status is Status.UNDECIDED
    assert_names(answer.message, "time", "joint_speed")


def test_rows_of_joints_have_the_derivatives_of_legs_that_bend(plan: Motion):
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


def test_toes_are_unloaded_before_they_lift_and_the_flight_says_what_legs_turn(plan: Motion):
    first, eased = LeapBender(Programs()).bent(plan)
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


def test_a_leap_whose_flight_is_short_or_that_has_none_stays_as_it_is(plan: Motion):
    leap = plan.problem
    assert unloaded(leap, plan.timing) is not None
    assert unloaded(replace(leap, timings_s=((0.6, 0.09, 0.6),)), 0) is None
    stands = replace(
        leap, phases=leap.phases[:1], timings_s=((0.6,),), footholds=leap.footholds[:4]
    )
    assert unloaded(stands, 0) is None
    assert unloaded(replace(leap, limits=replace(leap.limits, lift=0.004)), plan.timing) is None
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
    plan: Motion, ramp: float, share: float, lift: float
):
    limits = replace(plan.problem.limits, ramp=ramp, force_share=share)
    eased = unloaded(replace(plan.problem, limits=limits), plan.timing)
    assert eased.limits.lift == pytest.approx(lift)
