"""Soles from a file to an answer: the support polygon in closed form, yaws that are chosen, proofs,
forged answers.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit import Certificate, Motion, Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import check_file, read_motion, write_motion
from stancekit.planners.formats.question_file import answer_from_json
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.projection.project import PROJECTIONS, SURFACE, project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.robot_file import drawn_urdf
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Decoupled
from stancekit.planners.search.pieces import Standing
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import (
    check_certificate,
    check_certificates,
    check_plan,
    check_postures,
)
from tests.refusals import assert_names, refuses

HEIGHT_M, HALF_M, BALL_M = 0.3, (0.1, 0.05), 1e-4
SOLE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]]) * HALF_M
STAIRS = """
name: stairs-of-a-biped
robot:
  name: biped
  mass_kg: 56.0
  limbs:
    LF:
      shoulder_m: [0.0, 0.095, -0.1]
      reach_m: 0.85
      sole_m: &sole [[0.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]]
      reach_rows:
        normals: &sides
          [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 1], [-1, 0, 1]]
        bounds_m: [0.45, 0.45, 0.3, 0.0, -0.55, 0.88, -0.2, -0.2]
    RF:
      shoulder_m: [0.0, -0.095, -0.1]
      reach_m: 0.85
      sole_m: *sole
      reach_rows: {normals: *sides, bounds_m: [0.45, 0.45, 0.0, 0.3, -0.55, 0.88, -0.2, -0.2]}
frames: 9
gait: [[LF], [], [RF], []]
start_m: [0.1, 0.24, 0.8]
goal_m: [0.8, 0.24, 0.98]
stance: {limbs: {LF: [0.0, 0.0, -0.68], RF: [0.0, 0.0, -0.68]}}
body: {com_radius_m: 0.16, first_radius_m: 0.16, last_radius_m: 0.16, tilt_limit_rad: 0.05}
steps: {com_m: 0.3, toe_m: 0.7}
candidates: {count: 3, window_m: 0.5, margin_m: 0.01, yaws_rad: [1.5707963, 0.0, 0.4]}
terrain:
  kind: polygons
  friction: 0.5
  polygons:
    - {vertices_m: [[0.25, 1.0, 0.0], [-1.8, 1.0, 0.0], [-1.8, -1.0, 0.0], [0.25, -1.0, 0.0]]}
    - {vertices_m: [[0.3, 0.6, 0.1], [0.3, -0.16, 0.1], [0.6, -0.16, 0.1], [0.6, 0.6, 0.1]]}
    - {vertices_m: [[0.6, 0.6, 0.2], [0.6, -0.16, 0.2], [0.9, -0.16, 0.2], [0.9, 0.6, 0.2]]}
    - {vertices_m: [[0.9, 0.6, 0.3], [0.9, -0.16, 0.3], [1.2, -0.16, 0.3], [1.2, 0.6, 0.3]]}
"""


@pytest.fixture(scope="module")
def planner(programs):
    return Exact(programs=programs, max_nodes=300, time_limit_s=600.0)


def ground(size_m: float = 1.0) -> Patch:
    square = size_m * np.array(
        [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    )
    return Patch(
        vertices_m=square, normal=[0.0, 0.0, 1.0], shear_reference=[1.0, 0.0, 0.0], friction=0.5
    )


def on_one_sole(away_m: float, direction: float, yaw: float = 0.0, sole=SOLE) -> Problem:
    """A sole whose centre is held at the origin, and a fixed COM above a point so far away in that
    direction.
    """
    com = np.array([away_m * np.cos(direction), away_m * np.sin(direction), HEIGHT_M])
    contact = Contact(
        leg="RF",
        shoulder_m=-com,
        reach_m=BALL_M,
        patch=ground(),
        force_min=[0.0, -1.0, -1.0],
        force_max=np.ones(3),
        sole_m=sole,
        yaw_rad=yaw,
    )
    return Problem.posture(
        contacts=(contact,), mass_kg=50.0, com_nominal_m=com, com_radius_m=0.0, tilt_limit_rad=0.0
    )


@pytest.mark.parametrize(
    ("direction", "yaw"), [(0.0, 0.0), (0.5 * np.pi, 0.0), (0.0, 0.5 * np.pi), (2.0, 0.7)]
)
def test_the_com_is_over_the_sole_and_nowhere_else(planner, direction, yaw):
    """The edge of a rectangle at this yaw, in this direction: a quarter turn swaps length and
    width.
    """
    turned = direction - yaw
    edge = min(
        half / max(abs(part), 1e-12)
        for half, part in zip(HALF_M, (np.cos(turned), np.sin(turned)), strict=True)
    )
    inside, outside = (
        on_one_sole(edge - 3e-4, direction, yaw),
        on_one_sole(edge + 5e-4, direction, yaw),
    )
    found, refuted = planner.solve(inside), planner.solve(outside)
    assert found.status is Status.FEASIBLE
    assert refuted.status is Status.INFEASIBLE
    assert check_plan(found.solution).accepted
    assert check_certificate(refuted.certificate.of(outside)).accepted
    assert not check_certificate(refuted.certificate.of(inside)).accepted
    assert (
        planner.solve(on_one_sole(0.01, direction, sole=None)).status is Status.INFEASIBLE
    )  # a point foot tips


def test_forces_at_the_points_are_in_their_cones_and_add_up(planner):
    problem = on_one_sole(0.06, 0.4, 0.2)
    posture = planner.solve(problem).solution
    patch = problem.contacts[0].patch
    each = posture.point_forces_n[0, 0] @ patch.frame
    assert np.all(np.hypot(each[:, 1], each[:, 2]) <= patch.friction * each[:, 0] + 1e-5)
    np.testing.assert_allclose(posture.point_forces_n.sum(axis=2), posture.forces_n, atol=1e-9)
    pressure = each[:, 0] @ posture.points_m[0] / each[:, 0].sum()
    np.testing.assert_allclose(pressure[:2], problem.com_nominal_m[0, :2], atol=1e-5)


@pytest.fixture(scope="module")
def stood(planner):
    problem = on_one_sole(0.03, 0.4, 0.2)
    return problem, planner.solve(problem).solution


def test_soles_that_are_bent_stretched_turned_or_moved_are_refused(stood):
    problem, posture = stood
    points, toe = posture.points_m, posture.toes_m[0]
    assert check_plan(posture).accepted
    turned = 0.1 * np.cross([0.0, 0.0, 1.0], points - toe)
    bent = points.copy()
    bent[0, 0, 2] += 1e-3
    for wrong in (
        bent,
        toe + 1.02 * (points - toe),
        points + turned,
        np.add(points, [1e-3, 0.0, 0.0]),
    ):
        report = check_plan(replace(posture, points_m=wrong))
        assert not report.accepted
        assert max(report.groups, key=lambda group: group.worst).name == "patch"
        assert check_postures([replace(posture, points_m=wrong)])[0] > 1e-4
    yawed = problem.posture_with(contacts=(replace(problem.contacts[0], yaw_rad=0.25),))
    assert not check_plan(replace(posture, problem=yawed)).accepted
    small = replace(ground(), vertices_m=ground().vertices_m * [0.09, 1.0, 1.0])
    with refuses("contacts[0].sole_m"):
        problem.posture_with(contacts=(replace(problem.contacts[0], patch=small),))


def test_forces_that_do_not_add_up_and_arrays_that_lack_are_refused(stood):
    _, posture = stood
    more = posture.point_forces_n.copy()
    more[0, 0, 0] += 1.0
    for name, value in (
        ("point_forces_n", more),
        ("point_forces_n", None),
        ("points_m", posture.points_m[:, :3]),
    ):
        report = check_plan(replace(posture, **{name: value}))
        assert not report.accepted
        assert_names(report.message, name)
    shifted = more.copy()
    shifted[0, 0, 1] -= 1.0
    report = check_plan(replace(posture, point_forces_n=shifted))
    assert not report.accepted


def test_points_of_feet_that_have_none_are_refused_alone_and_in_a_batch(stood, walk):
    """Nothing would judge them, or worse: a batch would judge the forces at them in place of those
    on the feet.
    """
    _, posture = stood
    point = on_one_sole(0.0, 0.0, sole=None)
    held = Motion.of_posture(
        point,
        com_m=point.com_nominal_m[0],
        rotation_rad=np.zeros(3),
        toes_m=np.zeros((1, 3)),
        forces_n=[[0.0, 0.0, point.weight_n]],
    )
    floating = replace(held, forces_n=np.zeros((1, 1, 3)))
    assert check_plan(held).accepted
    for wrong in (
        replace(floating, points_m=held.toes_m[:, None], point_forces_n=held.forces_n[:, :, None]),
        replace(held, points_m=np.full((3, 4, 3), np.nan)),
        replace(held, point_forces_n=np.zeros((1, 1, 4, 3))),
    ):
        name = "points_m" if wrong.points_m is not None else "point_forces_n"
        report = check_plan(wrong)
        assert not report.accepted
        assert_names(report.message, name, str(getattr(wrong, name).shape))
        assert np.isinf(check_postures([wrong, posture])[0])
    plan = walk(2)
    assert check_plan(plan).accepted
    report = check_plan(replace(plan, points_m=plan.toes_m[:, None]))
    assert not report.accepted
    assert_names(report.message, "points_m")


@pytest.mark.filterwarnings("error")
def test_forces_beyond_all_numbers_are_refused_without_a_warning(stood):
    _, posture = stood
    for size in (1e300, 1.7e308):
        huge = np.full_like(posture.point_forces_n, size)
        report = check_plan(replace(posture, point_forces_n=huge))
        assert not report.accepted
        assert_names(report.message, "point_forces_n", "forces_n")


def test_every_stance_of_a_plan_on_some_soles_is_a_posture(walk):
    """Also those in which only point feet carry, or only soles with fewer points than others
    have.
    """
    plan, soles = walk(3), {"RF": SOLE, "RR": SOLE[:3], "LM": SOLE}
    robot = plan.problem.robot
    limbs = tuple(
        replace(limb, sole_m=0.1 * soles[limb.name] if limb.name in soles else None)
        for limb in robot.limbs
    )
    course = replace(plan.problem, robot=replace(robot, limbs=limbs))
    shares = np.zeros((len(limbs), 4))  # (q_1 + q_3) / 2 is the centre
    shares[:, 0] = [0.5 if limb.sole_m is not None else 1.0 for limb in limbs]
    shares[:, 2] = 1.0 - shares[:, 0]
    points = np.repeat(plan.toes_m[:, None], 4, axis=1)
    for p, put in enumerate(course.footholds):
        its = course.offsets_m[p][0]
        points[p, : len(its)] += its
        assert len(its) == len(soles.get(put.limb, [0]))
    on_soles = replace(
        plan,
        problem=course,
        points_m=points,
        point_forces_n=plan.forces_n[:, :, None] * shares[None, :, :, None],
    )
    assert check_plan(on_soles).accepted
    kinds = set()
    for row in range(len(course.stances)):
        posture = on_soles.posture(row)
        assert check_plan(posture).accepted
        kinds.add(None if posture.points_m is None else posture.points_m.shape[1])
    assert kinds == {None, 4}


def test_answers_and_problems_come_back_from_their_files(stood):
    problem, posture = stood
    again = Problem.from_json(json.loads(json.dumps(problem.to_json())))
    assert again.to_json() == problem.to_json()
    assert check_plan(answer_from_json(json.loads(json.dumps(posture.to_json())), again)).accepted
    assert "sole_m" not in json.dumps(on_one_sole(0.01, 0.0, sole=None).to_json())


@pytest.mark.parametrize("name", PROJECTIONS.names())
def test_every_projection_comes_to_the_surface_of_soles(programs, soled, drawn, name):
    """From the lift's point, or near it; what the program calls balanced the verifier calls a
    posture.
    """
    arrived = 0
    for seed in range(10):
        problem = soled(drawn("wall-5", seed), seed) if seed != 3 else on_one_sole(0.03, 0.1)
        scaled = Scaled.of(problem)
        lift = solve_lift(programs, scaled, least_moment=True)
        if lift.bound > 1e-9:
            continue
        start = (
            project(programs, "fix-toes", scaled, lift.rounded()[1])
            if name == "fix-f"
            else lift.rounded()[1]
        )
        point = project(programs, name, scaled, start)
        if point.residual <= SURFACE:
            assert check_plan(plan_of(problem, scaled, scaled.numbers, point)).accepted
            arrived += 1
    assert arrived > 2


def test_a_sole_holds_whatever_a_point_foot_at_its_centre_holds(planner, soled, drawn):
    """The centre is a convex combination of the points, and forces of no bound that matters are
    shared out by it.
    """
    wide = {"force_min": np.array([0.0, -9.0, -9.0]), "force_max": np.full(3, 9.0)}
    feasible = refuted = 0
    for seed in range(24):
        problem = soled(drawn("wall-3", seed), seed)
        soles = tuple(replace(contact, **wide) for contact in problem.contacts)
        points = tuple(replace(c, sole_m=None, patch=c.region, **wide) for c in problem.contacts)
        one, other = (
            planner.solve(problem.posture_with(contacts=some)).status for some in (soles, points)
        )
        assert one is Status.FEASIBLE or other is not Status.FEASIBLE
        assert one is not Status.INFEASIBLE or other is Status.INFEASIBLE
        feasible, refuted = (
            feasible + (other is Status.FEASIBLE),
            refuted + (one is Status.INFEASIBLE),
        )
    assert min(feasible, refuted) > 2


def test_proofs_with_soles_are_no_proofs_of_what_can_be_held(planner, soled, drawn):
    rng, tried, proofs = np.random.default_rng(4), 0, []
    for seed in range(24):
        problem = soled(drawn("wall-3", seed), seed)
        outcome = planner.solve(problem)
        assert outcome.status is not Status.UNDECIDED
        proofs += [] if outcome.certificate is None else [outcome.certificate]
        if outcome.status is Status.FEASIBLE and proofs:
            foreign = proofs[int(rng.integers(len(proofs)))]
            for scale in (0.0, 0.1, 1.0):
                noise = rng.normal(scale=scale, size=foreign.multipliers.shape)
                fake = Certificate(tree=foreign.tree, multipliers=foreign.multipliers + noise)
                assert not check_certificate(fake.of(problem)).accepted
                tried += 1
    assert tried > 10
    bounds = check_certificates(proofs)
    np.testing.assert_allclose(
        bounds, [check_certificate(proof).figures["lower_bound"] for proof in proofs]
    )


def test_courses_with_soles_and_half_spaces_get_plans_or_proofs_that_no_other_course_takes(
    programs, ragged, bounded, soled
):
    """Over several candidates, whose trees and nogoods carry all multipliers."""
    courses = TwoStage(programs=programs, max_nodes=60, time_limit_s=600.0)
    plans, proofs = [], []
    for seed in range(10):
        rough = replace(ragged(seed, frames=2, ice=0.1), tilt_limit_rad=0.05)
        course = soled(bounded(rough, seed, 0.15), seed)
        outcome = courses.solve(course)
        plans += [] if outcome.solution is None else [course]
        proofs += [] if outcome.certificate is None else [outcome.certificate]
        if outcome.certificate is not None:
            assert check_certificate(outcome.certificate.of(course)).accepted
    assert min(len(plans), len(proofs)) > 1
    for course in plans:
        assert not any(check_certificate(proof.of(course)).accepted for proof in proofs)


def beam_course(com_y: float, yaws=(0.0, 0.5 * np.pi)) -> Problem:
    """One foot of a robot that has to lean to its side, at one of two yaws, as a course of one
    frame.
    """
    problem = on_one_sole(com_y, 0.5 * np.pi)
    limb = Limb(name="RF", shoulder_m=problem.contacts[0].shoulder_m, reach_m=BALL_M, sole_m=SOLE)
    return Problem(
        name="lean",
        robot=Robot(name="monopod", mass_kg=50.0, limbs=(limb,)),
        terrain=(ground(),),
        footholds=(
            Foothold(limb="RF", frame=0, candidates=(ground(),) * len(yaws), yaws_rad=yaws),
        ),
        lifts=((),),
        com_nominal_m=problem.com_nominal_m,
        com_radius_m=np.zeros(1),
        goal_m=problem.com_nominal_m[0],
        tilt_limit_rad=0.0,
    )


@pytest.mark.parametrize("make", [TwoStage, Exact])
def test_the_yaw_that_carries_is_chosen_and_where_none_does_there_is_a_proof(make):
    for com_y, chosen in ((0.03, None), (0.08, 1)):
        outcome = make().solve(beam_course(com_y))
        assert outcome.status is Status.FEASIBLE
        assert chosen is None or outcome.solution.choice.tolist() == [chosen]
    course = beam_course(0.12)
    outcome = make().solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(course)).accepted
    assert not check_certificate(outcome.certificate.of(beam_course(0.08))).accepted


def test_decoupled_plans_with_soles_or_says_that_it_cannot():
    assert Decoupled().solve(beam_course(0.03, (0.0,))).status is Status.FEASIBLE


@pytest.fixture(scope="module")
def climbed(tmp_path_factory):
    """A biped with soles and polytopic reach up two steps: course and plan."""
    path = tmp_path_factory.mktemp("soles") / "stairs.yaml"
    path.write_text(STAIRS)
    course = read_course(path)
    return course, TwoStage().solve(course)


def test_a_biped_with_soles_and_polytopes_climbs_and_its_plan_is_verified(climbed, tmp_path):
    course, outcome = climbed
    assert outcome.status is Status.FEASIBLE
    plan, report = outcome.solution, check_plan(outcome.solution)
    assert report.accepted
    assert report.figures["between"] <= 1e-6
    assert plan.toes_m[:, 2].max() > 0.15  # two steps up
    yaws = [put.yaws_rad[chosen] for put, chosen in zip(course.footholds, plan.choice, strict=True)]
    for k, put in enumerate(course.footholds):  # all corners on one step, by hand
        c, s = np.cos(yaws[k]), np.sin(yaws[k])
        corners = plan.toes_m[k, :2] + np.array(
            [[0.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]]
        ) @ [[c, s], [-s, c]]
        np.testing.assert_allclose(plan.points_m[k, :, :2], corners, atol=1e-9)
        low, high = put.candidates[plan.choice[k]].vertices_m[:, :2].min(axis=0), None
        high = put.candidates[plan.choice[k]].vertices_m[:, :2].max(axis=0)
        assert np.all((corners >= low - 1e-6) & (corners <= high + 1e-6))
    for index, stance in enumerate(course.stances):  # the COM over the soles that carry
        f = plan.point_forces_n[index, list(stance.limbs)].reshape(-1, 3)
        p = plan.points_m[course.holds[stance.frame, list(stance.limbs)]].reshape(-1, 3)
        moment = np.cross(p - plan.com_m[stance.frame], f).sum(axis=0)
        assert np.linalg.norm(moment) < 1e-5 * course.weight_n
    path = tmp_path / "plan.json"
    write_motion(path, plan, report)
    again, _ = read_motion(path)
    assert np.array_equal(again.point_forces_n, plan.point_forces_n)
    assert check_file(path, joints=False).accepted
    data = json.loads(json.dumps(course.to_json()))
    assert Problem.from_json(data).to_json() == data


def test_forged_plans_with_soles_are_refused(climbed):
    _, outcome = climbed
    plan = outcome.solution
    bent, moved = plan.points_m.copy(), plan.points_m.copy()
    bent[3, 1, 2] += 1e-3
    moved[3] += [1e-3, 0.0, 0.0]
    other = plan.choice.copy()
    put = plan.problem.footholds[3]
    same = [
        r
        for r, patch in enumerate(put.candidates)
        if patch is put.candidates[other[3]] and r != other[3]
    ]
    other[3] = same[0]
    forces = plan.point_forces_n.copy()
    forces[0, :, 0] += [0.0, 0.0, 5.0]
    forces[0, :, 1] -= [0.0, 0.0, 5.0]
    for changes in (
        {"points_m": bent},
        {"points_m": moved},
        {"choice": other},
        {"point_forces_n": forces},
    ):
        assert not check_plan(replace(plan, **changes)).accepted
    report = check_plan(replace(plan, points_m=bent))
    worst = max(report.groups, key=lambda group: group.worst)
    assert (worst.name, worst.where) == ("patch", put.limb)
    bare = check_plan(replace(plan, points_m=None))
    assert not bare.accepted
    assert_names(bare.message, "points_m", str(plan.points_m.shape))


def test_a_window_is_planned_anew_from_where_the_soles_stand(climbed):
    course, outcome = climbed
    plan = outcome.solution
    begin = replan(None, course, horizon=4)
    assert begin.status is Status.FEASIBLE
    standing = Standing.at_end(begin.solution)
    assert len(standing.yaws_rad) == 2
    rest = replan(standing, course, frame=4)
    assert rest.status is Status.FEASIBLE
    np.testing.assert_allclose(
        rest.solution.points_m[:2],
        begin.solution.points_m[begin.solution.problem.holds[-1]],
        atol=1e-9,
    )
    with refuses():
        replan(replace(standing, yaws_rad=()), course, frame=4)
    assert len(plan.problem.footholds) == 6


def test_plans_with_soles_are_not_executed(climbed):
    from stancekit.runner.acceptance import Accepted

    plan = climbed[1].solution
    with refuses("plan.json"):
        Accepted.verified(plan, "plan.json")
    with refuses("robot biped"):
        drawn_urdf(plan.problem.robot)
    assert check_plan(plan, joints=True).group("joints").verdict == "not checked"


def test_envelopes_are_for_point_feet(planner, soled, drawn):
    scaled = Scaled.of(soled(drawn("wall-3", 1), 1))
    with refuses("envelopes"):
        Programs().get(McCormick, scaled.layout)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("&sole [[0.11, 0.05], [0.11, -0.05]", "&sole [[0.11, 0.05], [0.11, 0.05]"), ""),
        (
            (
                "&sole [[0.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]]",
                "&sole [[0.11, 0.05], [0.0, 0.0]]",
            ),
            "robot.limbs.LF.sole_m: expected 3 to 16 points of a sole, got 2",
        ),
        (
            ("[[1, 0, 0], [-1, 0, 0]", "[[0, 0, 0], [-1, 0, 0]"),
            "robot.limbs.LF.reach_rows.normals[0]: expected a non-zero vector, got none",
        ),
        (
            ("-0.55, 0.88", "-0.55, 0.38"),
            "robot.limbs.LF.reach_rows.bounds_m: expected half-spaces that leave room for a toe, got an empty set",
        ),
        (("[1.5707963, 0.0, 0.4]", "[]"), "candidates.yaws_rad: List should have at least 1 item"),
        (
            (
                "0.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]]",
                "9.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]]",
            ),
            "frame 0, limb LF: expected room for its sole at one of 3 yaws on the surfaces within reach, got none on 3",
        ),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "bad.yaml"
    assert change[0] in STAIRS
    path.write_text(STAIRS.replace(*change, 1))
    if not message:
        assert read_course(path).has_soles  # a corner given twice changes nothing
        return
    with pytest.raises(InvalidInput) as refused:
        read_course(path)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
