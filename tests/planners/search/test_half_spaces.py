"""Reach as half-spaces, from a file to an answer: closed forms, a second formulation, proofs, and
forged answers.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit import Certificate, Motion, Status
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.equilibrium.terms import Given
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.projection.held import FixToes
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.robot.model import Limb, ReachRows, Robot
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_certificate, check_certificates, check_plan, explain

HEIGHT_M, BALL_M = 0.3, 0.1
CUBE = np.vstack([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def planner(programs):
    return Exact(programs=programs, max_nodes=60, time_limit_s=600.0)


def on_one_foot(ahead_m: float, tilt: float = 0.0) -> Problem:
    """One foot on level ground, which has to be below a fixed COM, of a limb whose box begins
    ``ahead_m`` ahead.
    """
    square = 0.2 * np.array(
        [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    )
    patch = Patch(
        vertices_m=square, normal=[0.0, 0.0, 1.0], shear_reference=[1.0, 0.0, 0.0], friction=0.5
    )
    bounds = [ahead_m + 0.1, 0.06, 0.06 - HEIGHT_M, -ahead_m, 0.06, 0.06 + HEIGHT_M]
    contact = Contact(
        leg="RF",
        shoulder_m=[0.0, 0.0, -HEIGHT_M],
        reach_m=BALL_M,
        patch=patch,
        force_min=[0.0, -1.0, -1.0],
        force_max=np.ones(3),
        reach_rows=ReachRows(normals=CUBE, bounds_m=bounds),
    )
    return Problem.posture(
        contacts=(contact,),
        mass_kg=10.0,
        com_nominal_m=[0.0, 0.0, HEIGHT_M],
        com_radius_m=0.0,
        tilt_limit_rad=tilt,
    )


@pytest.mark.parametrize(
    ("ahead_m", "holds"), [(-0.05, True), (-1e-4, True), (2e-4, False), (0.04, False)]
)
def test_without_a_tilt_a_half_space_decides_to_the_millimetre(planner, ahead_m, holds):
    outcome = planner.solve(on_one_foot(ahead_m))
    assert outcome.status is (Status.FEASIBLE if holds else Status.INFEASIBLE)


def test_a_level_body_has_rows_where_one_that_leans_has_cones():
    """With t(a) = 0 a cone of the inner set is its first row, and the outer set is the inner one."""
    scaled = Scaled.of(on_one_foot(-0.02))
    assert scaled.layout.level
    assert not Scaled.of(on_one_foot(-0.02, 1e-6)).layout.level
    leans = replace(scaled, layout=replace(scaled.layout, level=False))
    point = Point(
        com=scaled.com,
        rotation=np.zeros((1, 3)),
        toes=scaled.vertices[:1],
        forces=np.ones((1, 3)),
        residual=1.0,
    )
    left = []
    for each in (scaled, leans):
        rows = FixToes(each.layout, False, True).rows
        _, _, matrix, b = rows.load(Given(each, point))
        x = np.random.default_rng(0).normal(size=rows.shape[1])
        x[rows.columns["rotation"]] = 0.0  # as |Θ| ≤ 0 asks
        product = np.bincount(matrix.indices, matrix.data * x[matrix.columns], minlength=len(b))
        left.append((product - b)[rows.groups["reach_rows"]])
    assert (left[0].shape, left[1].shape) == ((6,), (6, 3))
    np.testing.assert_allclose(left[1][:, 0], left[0], atol=1e-15)
    assert not left[1][:, 1:].any()


def test_a_body_that_leans_gains_height_times_tilt_and_no_proof_says_less(planner):
    """The row is −d_x − Θ_y d_z ≥ ahead with the toe at d = (0, 0, −h): it holds for Θ_y ≥ ahead /
    h.
    """
    tilt, found = 0.2, {}
    for share in (0.5, 0.9, 0.99, 1.01, 1.2, 2.0):
        outcome = planner.solve(on_one_foot(share * tilt * HEIGHT_M, tilt))
        found[share] = outcome.status
        if outcome.solution is not None:
            assert outcome.solution.rotation_rad[0, 1] >= share * tilt - 1e-4
    assert found[0.5] is found[0.9] is Status.FEASIBLE
    assert found[2.0] is Status.INFEASIBLE
    assert found[0.99] is not Status.INFEASIBLE
    assert Status.FEASIBLE not in (found[1.01], found[1.2])


def test_a_box_is_its_six_rows_and_what_it_does_not_cut_changes_nothing(planner, drawn):
    """Rows that touch the ball from outside change no verdict; a box inside the ball makes the ball
    idle.
    """
    verdicts = {Status.FEASIBLE: 0, Status.INFEASIBLE: 0}
    for seed in range(10):
        problem = replace(drawn("wall-3", seed), tilt_limit_rad=0.0)
        outside, inside, alone = [], [], []
        for c in problem.contacts:
            far = CUBE @ c.shoulder_m + c.reach_m + 1e-3
            outside.append(replace(c, reach_rows=ReachRows(normals=CUBE, bounds_m=far)))
            half = c.reach_m * np.tile([0.42, 0.8, 0.41], 2)  # its corners are in the ball
            near = ReachRows(normals=CUBE, bounds_m=CUBE @ c.shoulder_m + half)
            inside.append(replace(c, reach_rows=near))
            alone.append(replace(c, reach_rows=near, reach_m=3.0 * c.reach_m))
        plain, same, box, no_ball = (
            planner.solve(problem.posture_with(contacts=tuple(some)))
            for some in (problem.contacts, outside, inside, alone)
        )
        assert plain.status is same.status
        assert box.status is no_ball.status
        verdicts[box.status] += 1
    assert min(verdicts.values()) > 2


def test_a_courses_lift_is_that_of_a_second_formulation(ragged, bounded, written_course, programs):
    met = refused = 0
    for seed in range(8):
        course = bounded(replace(ragged(seed, frames=2), tilt_limit_rad=0.0), seed, 0.12)
        other, _ = written_course(course)
        other.solve(solver="CLARABEL")
        lift = solve_lift(programs, Scaled.of(course), least_moment=False)
        if np.isinf(lift.bound):
            assert other.status.startswith("infeasible")
            refused += 1
        else:
            assert lift.bound * course.length_scale_m**2 == pytest.approx(other.value, abs=1e-6)
            met += 1
    assert met > 1
    assert refused > 1


@pytest.mark.parametrize("tilt", [0.0, 0.15, 0.26])
def test_answers_are_verified_and_no_postures_are_where_proofs_are(
    planner, programs, drawn, bounded, tilt
):
    """IPOPT has the true rows, bilinear as they are: it finds nothing where there is a proof."""
    found = {Status.FEASIBLE: 0, Status.INFEASIBLE: 0, Status.UNDECIDED: 0}
    for seed in range(10):
        problem = bounded(replace(drawn("wall-3", seed), tilt_limit_rad=tilt), seed, 0.06)
        outcome, scaled = planner.solve(problem), Scaled.of(problem)
        found[outcome.status] += 1
        if outcome.solution is not None:
            assert worst_row(problem, outcome.solution) <= 1e-6 * problem.length_scale_m
        if outcome.certificate is not None:
            assert check_certificate(outcome.certificate.of(problem)).accepted
            start = solve_lift(programs, scaled, least_moment=True).rounded()[1]
            point = project(programs, "nlp", scaled, start)
            assert not check_plan(plan_of(problem, scaled, scaled.numbers, point)).accepted
            assert explain(outcome.certificate.of(problem)).relaxations
    assert min(found[Status.FEASIBLE], found[Status.INFEASIBLE]) > 3
    assert found[Status.UNDECIDED] <= (2 if tilt else 0)


def worst_row(problem: Problem, posture: Motion) -> float:
    """How far a toe is beyond a half-space that was turned with the body, one after the other
    [m].
    """
    turn = np.eye(3) + np.cross(posture.rotation_rad[0], np.eye(3)).T
    beyond = [
        (turn @ normal) @ (toe - posture.com_m[0]) - bound
        for contact, toe in zip(problem.contacts, posture.toes_m, strict=True)
        for normal, bound in zip(
            contact.reach_rows.normals, contact.reach_rows.bounds_m, strict=True
        )
    ]
    return max(beyond)


def test_no_proof_is_one_of_a_problem_with_a_posture(planner, drawn, bounded):
    """Proofs of problems with half-spaces, noise and all, against the same with these farther out,
    which have one.
    """
    rng, tried = np.random.default_rng(5), 0
    for seed in range(10):
        stiff = replace(drawn("wall-3", seed), tilt_limit_rad=0.0)
        problem, wide = bounded(stiff, seed, 0.02), bounded(stiff, seed, 0.4)
        proof = planner.solve(problem).certificate
        if proof is None or planner.solve(wide).status is not Status.FEASIBLE:
            continue
        for scale in (0.0, 0.1, 1.0):
            noise = rng.normal(scale=scale, size=proof.multipliers.shape)
            noise[:, -18:] = np.abs(noise[:, -18:])
            forged = Certificate(tree=proof.tree, multipliers=proof.multipliers + noise)
            assert not check_certificate(forged.of(wide)).accepted
            tried += 1
    assert tried > 5


def test_batches_of_problems_with_and_without_half_spaces_have_the_bounds_of_each(
    planner, drawn, bounded
):
    pairs = []
    for seed in range(12):
        for problem in (
            drawn("wall-3", seed),
            bounded(drawn("wall-3", seed), seed, 0.02, of=("LM", "RF")),
        ):
            proof = planner.solve(problem).certificate
            pairs += [] if proof is None else [proof]
    assert len({len(proof.multipliers[0]) for proof in pairs}) == 2
    bounds = check_certificates(pairs)
    np.testing.assert_allclose(
        bounds, [check_certificate(proof).figures["lower_bound"] for proof in pairs]
    )


def test_multipliers_of_half_spaces_below_zero_prove_nothing(planner):
    problem = on_one_foot(0.1)
    proof = planner.solve(problem).certificate
    assert proof is not None
    rows = proof.multipliers.copy()
    rows[:, -1] = -rows[:, -1]
    assert not check_certificate(
        Certificate(tree=proof.tree, multipliers=rows).of(problem)
    ).accepted


@pytest.fixture(scope="module")
def planned(ragged, bounded, programs):
    """A course with half-spaces and its plan."""
    for seed in range(20):
        course = bounded(ragged(seed, frames=3, ice=0.0), seed, 0.15)
        outcome = TwoStage(programs=programs).solve(course)
        if outcome.solution is not None:
            return outcome.solution
    raise AssertionError("no course has a plan")


def test_a_plan_is_refused_where_a_toe_leaves_a_half_space(planned):
    assert check_plan(planned).accepted
    course, limb = planned.problem, 2
    toe = planned.toes_m[course.holds[1, limb]] - planned.com_m[1]
    normal = np.array([0.6, 0.0, 0.8])
    turned = normal + np.cross(planned.rotation_rad[1], normal)
    for room, holds in ((1e-4, True), (-1e-4, False)):
        rows = ReachRows(normals=[normal], bounds_m=[turned @ toe + room])
        limbs = [
            replace(one, reach_rows=rows if i == limb else None)
            for i, one in enumerate(course.robot.limbs)
        ]
        robot = replace(course.robot, limbs=tuple(limbs))
        report = check_plan(replace(planned, problem=replace(course, robot=robot)))
        reach = next(group for group in report.groups if group.name == "reach")
        assert (
            (reach.frame == 1 and reach.value == pytest.approx(1e-4)) or holds or reach.value > 1e-4
        )


def test_the_way_between_two_frames_is_looked_at_where_it_bows_out(walk):
    """Both ends lean as the row allows, the way between them does not: found without a point on the
    way.
    """
    plan = walk(2, "shift")
    limb, toe = plan.problem.robot.limbs[0], plan.toes_m[0]
    turn = np.array([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
    com = plan.com_m.copy()
    normal = np.array([1.0, 0.0, 0.0])
    com[1] = com[0] + [-0.05 * (2.0 * com[0, 2] + 0.04), 0.0, 0.04]  # as far out at either end
    value = [
        (normal + np.cross(theta, normal)) @ (toe - c) for theta, c in zip(turn, com, strict=True)
    ]
    between = max(
        (normal + np.cross((1 - t) * turn[0] + t * turn[1], normal))
        @ (toe - (1 - t) * com[0] - t * com[1])
        for t in np.linspace(0.0, 1.0, 1001)
    )
    rows = ReachRows(normals=[normal], bounds_m=[max(value) + 1e-9])
    robot = replace(
        plan.problem.robot, limbs=(replace(limb, reach_rows=rows), *plan.problem.robot.limbs[1:])
    )
    bowed = replace(plan, problem=replace(plan.problem, robot=robot), com_m=com, rotation_rad=turn)
    report = check_plan(bowed, between=False)
    reach = next(group for group in report.groups if group.name == "reach")
    assert between > max(value) + 1e-5
    assert reach.value == pytest.approx(between - max(value), abs=1e-7)
    assert (reach.frame, reach.limb) == (0, limb.name)


def test_files_give_half_spaces_back_and_files_without_them_are_as_they_were(
    drawn, bounded, ragged
):
    problem = drawn("wall-3", 1)
    assert "reach_rows" not in json.dumps(problem.to_json())
    with_rows = bounded(problem, 1, of=("RF",))
    again = Problem.from_json(json.loads(json.dumps(with_rows.to_json())))
    assert again.to_json() == with_rows.to_json()
    assert [contact.reach_rows is None for contact in again.contacts].count(False) == 1
    course = ragged(1)
    assert "reach_rows" not in json.dumps(course.to_json())
    data = json.loads(json.dumps(bounded(course, 2).to_json()))
    assert Problem.from_json(data).to_json() == data


def test_a_posture_is_the_same_as_a_course(planner, drawn, bounded, programs):
    decided, courses = 0, TwoStage(programs=programs, max_nodes=30, time_limit_s=600.0)
    for seed in range(6):
        problem = bounded(replace(drawn("wall-3", seed), tilt_limit_rad=0.05), seed, 0.06)
        one, other = planner.solve(problem), courses.solve(problem.course())
        if Status.UNDECIDED not in (one.status, other.status):
            assert one.status is other.status
            decided += 1
    assert decided > 3


def test_robots_that_differ_in_half_spaces_are_told_apart():
    from stancekit.runner.acceptance import _differs

    rows = ReachRows(normals=CUBE, bounds_m=np.ones(6))
    plain = Robot(
        name="r", mass_kg=1.0, limbs=(Limb(name="a", shoulder_m=np.zeros(3), reach_m=1.0),)
    )
    other = replace(plain, limbs=(replace(plain.limbs[0], reach_rows=rows),))
    assert _differs(plain, plain) == _differs(other, other) == ""
    assert _differs(plain, other) == "limb a has other half-spaces of reach"
