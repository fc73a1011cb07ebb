"""The lift: a bound that is never too high, tight where it must be, and proved by its own
multipliers; for a posture, and over key frames against the same model written a second time.
"""

from __future__ import annotations

import json
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit import Certificate, Motion, Status
from stancekit.planners.equilibrium.programs import ConicStatus, Programs
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.boxes import boxes_of, mirrored
from stancekit.planners.relaxation.envelope import RELAXATIONS, Envelope, EnvelopeSet
from stancekit.planners.relaxation.lift import (
    JointRelaxation,
    LeastGap,
    LiftProgram,
    near_nominal,
    solve_lift,
)
from stancekit.planners.relaxation.mccormick import McCormick, WithoutMoment
from stancekit.planners.robot.model import ReachRows
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.cuts import alone
from stancekit.planners.search.exact import Exact
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_certificate, check_plan, check_postures
from tests.refusals import refuses

STEP = 1e-4


@pytest.fixture(scope="module")
def problems(programs, drawn):
    """Problems of wall-3 with the point [p, f] of a witness, None where there is none."""
    found = []
    for seed in range(40):
        outcome, scaled = (
            Exact(programs=programs).solve(drawn("wall-3", seed)),
            Scaled.of(drawn("wall-3", seed)),
        )
        found.append(
            (scaled, scaled.point(outcome.solution) if outcome.status is Status.FEASIBLE else None)
        )
    return found


@pytest.fixture(scope="module")
def box(problems):
    """Quantiles over witnesses."""
    points = np.array([point for _, point in problems if point is not None])
    return Envelope(low=np.quantile(points, 0.1, axis=0), high=np.quantile(points, 0.9, axis=0))


def test_a_box_that_holds_a_witness_admits_the_problem_by_either_objective(programs, problems):
    looked_at = 0
    for scaled, point in problems:
        if point is None:
            continue
        around = Envelope(low=point - 0.02, high=point + 0.03)
        assert JointRelaxation.margin(programs, scaled, around).margin < 0.0
        answer = programs.get(JointRelaxation, scaled.layout).solve(scaled, around, point)
        assert answer.feasible
        assert answer.margin >= -1e-9
        looked_at += 1
    assert looked_at >= 15


def test_no_margin_is_below_that_of_the_box_alone_and_what_the_lift_refutes_is_refuted(
    programs, problems, box
):
    tighter = refuted = 0
    for scaled, _ in problems:
        joint, alone = (
            RELAXATIONS.get(name).margin(programs, scaled, box).margin for name in ("joint", "p1")
        )
        assert joint >= alone - 1e-6
        tighter += joint > alone + 1e-3
        if not solve_lift(programs, scaled, least_moment=True).bound <= 1e-6:
            assert joint == np.inf
            refuted += McCormick.margin(programs, scaled, box.widened(0.3)).margin <= 0.0
    assert tighter >= 10
    assert refuted >= 1


def test_the_answer_is_priced_out_of_a_margin_wherever_there_is_none(programs, problems, box):
    signs = set()
    for scaled, _ in problems:
        answer = programs.get(JointRelaxation, scaled.layout).solve(scaled, box)
        signed = JointRelaxation.margin(programs, scaled, box)
        assert answer.feasible == signed.feasible
        assert answer.margin >= max(signed.margin, 0.0) - 1e-6
        signs.add(answer.feasible)
    assert signs == {True, False}


def test_the_gradient_is_that_of_central_differences_in_every_bound(programs, problems, box):
    scaled, bounds = (
        next(problem for problem, point in problems if point is not None),
        box.to_vector(),
    )
    answer = JointRelaxation.margin(programs, scaled, box, gradient=True)
    gradient = np.concatenate([part.ravel() for part in answer.gradient])

    def margin(at):
        return JointRelaxation.margin(programs, scaled, Envelope.from_vector(at)).margin

    slopes = [
        (margin(bounds + e) - margin(bounds - e)) / (2 * STEP) for e in STEP * np.eye(len(bounds))
    ]
    np.testing.assert_allclose(gradient, slopes, atol=1e-5)
    assert np.max(np.abs(gradient)) > 0.02


def test_about_a_witness_there_is_no_gap_and_fix_p_ends_on_the_surface(programs, problems):
    looked_at = 0
    for scaled, point in problems:
        if point is None:
            continue
        near = near_nominal(scaled, point)
        found = programs.get(LeastGap, scaled.layout).solve(scaled, near)
        assert found.residual == 0.0
        assert project(programs, "lift-fix-p", scaled, near).residual <= 1e-6
        looked_at += 1
    assert looked_at >= 15


def test_the_lift_twice_projects_what_fix_p_loses(programs, problems):
    lost = saved = 0
    for scaled, point in problems:
        if point is None:
            continue
        start = solve_lift(programs, scaled, least_moment=True).rounded()[1]
        once, twice = (
            project(programs, name, scaled, start).residual <= 1e-6
            for name in ("fix-p", "lift-fix-p")
        )
        lost += not once
        saved += twice and not once
    assert lost >= 2
    assert saved == lost


def test_where_the_lift_has_no_point_the_projection_goes_on_from_where_it_was(programs, problems):
    scaled = next(
        s for s, _ in problems if 1e-3 < solve_lift(programs, s, least_moment=True).bound < np.inf
    )
    start = near_nominal(scaled, np.tile([0.1, 0.0, -0.1, 0.3, 0.0, 0.1], (3, 1)))
    assert programs.get(LeastGap, scaled.layout).solve(scaled, start).residual == np.inf
    assert project(programs, "lift-fix-p", scaled, start).residual == pytest.approx(
        project(programs, "fix-p", scaled, start).residual, abs=1e-7
    )


SEEDS = st.integers(0, 2**32 - 1)
LEAF = [[0.0, 0.0, 0.0, 0.0, 0.0]]
SEEDS_OF = {
    "wall-3": (0, 1, 2, 3, 5, 8, 12, 17, 20, 22, 225),
    "ground-3": (0, 1, 37, 86, 115),
    "wall-5": (0, 1, 7, 19, 45),
}
NATURAL = [(name, seed) for name, seeds in SEEDS_OF.items() for seed in seeds]
MIXED = [
    (seed, corners) for seed in range(4) for corners in ((3, 4, 5), (4,), (5, 3), (6, 3, 4, 3))
]


def least(programs, scaled):
    """The lift with the least moment residual."""
    return solve_lift(programs, scaled, least_moment=True)


def narrowed(scaled, contact, corners, low, high):
    """A posture with one contact on these corners and within this force box."""
    lows, highs = scaled.force_min.copy(), scaled.force_max.copy()
    lows[contact], highs[contact] = low, high
    return scaled.with_piece(contact, corners).with_force_box(lows, highs)


def forms(scaled):
    """The program without the rows that the cones may imply, and with all of them."""
    return (LiftProgram(scaled.layout, implied, True) for implied in (True, False))


def lift_again(model):
    """The lift in its own words: per vertex a share λ and a force λ f in the cone and in λ times
    the box.
    """
    problem = model.problem
    slack = cp.Variable()
    moment, rows = 0.0, [model.balance, *model.body, *model.on_patches, *model.in_reach]
    for i, contact in enumerate(problem.contacts):
        shared = cp.Variable((len(model.vertices[i]), 3))
        rows.append(cp.sum(shared, axis=0) == model.forces[i])
        for share, force, vertex in zip(model.shares[i], shared, model.vertices[i], strict=True):
            rows.append(cp.norm(force[1:]) <= contact.patch.friction * force[0])
            rows += [force >= share * contact.force_min, force <= share * contact.force_max]
            moment = moment + np.cross(vertex, np.eye(3)).T @ model.frames[i] @ force
    moment = moment - model.weight * cp.hstack([model.com[1], -model.com[0], 0.0])
    program = cp.Problem(cp.Minimize(slack), [*rows, cp.abs(moment) <= slack])
    return float(program.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize("scene", [*NATURAL, *MIXED], ids=str)
def test_the_bound_is_that_of_the_lift_written_again(programs, drawn, mixed, written, scene):
    problem = drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)
    bound = least(programs, Scaled.of(problem)).bound
    assert bound == pytest.approx(lift_again(written(problem)), abs=3e-7)


def test_the_scenes_above_are_of_all_sorts(programs, drawn, mixed):
    bounds = [least(programs, Scaled.of(drawn(*scene))).bound for scene in NATURAL]
    bounds += [least(programs, Scaled.of(mixed(*scene))).bound for scene in MIXED]
    assert sum(np.isinf(bounds)) >= 3
    assert sum(1e-3 < bound < 1.0 for bound in bounds) >= 10
    assert sum(bound < 1e-6 for bound in bounds) >= 10


def around_a_posture(seed):
    """A random posture in balance of forces, and a problem whose every other constraint it
    meets.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    com, rotation = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.2, 0.2, 3)
    forces = rng.uniform([-40.0, -40.0, -20.0], [40.0, 40.0, 80.0], (count, 3))
    forces -= (forces.sum(axis=0) - [0.0, 0.0, 98.1]) / count
    toes = rng.uniform([-0.4, -0.4, -0.4], [0.4, 0.4, 0.1], (count, 3))
    contacts = []
    for leg, force, toe in zip(("RF", "RR", "LM"), forces, toes, strict=False):
        normal = force / np.linalg.norm(force) + rng.uniform(-0.4, 0.4, 3)
        normal = normal / np.linalg.norm(normal)
        reference = np.cross(normal, rng.normal(size=3))
        first = reference / np.linalg.norm(reference)
        corners = int(rng.integers(3, 6))
        angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
        border = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(normal, first))
        border = rng.uniform(0.01, 0.15) * border
        border = border - rng.dirichlet(np.ones(corners)) @ border  # the toe is inside
        frame = np.column_stack([normal, np.cross(first, normal), first])
        f = frame.T @ force / 98.1
        shoulder = rng.uniform(-0.2, 0.2, 3)
        leg_vector = toe - com - shoulder - np.cross(rotation, shoulder)
        patch = Patch(
            vertices_m=toe + border,
            normal=normal,
            shear_reference=reference,
            friction=np.linalg.norm(f[1:]) / f[0] + rng.choice([1e-6, 0.2]),
        )
        room = rng.choice([1e-6, 0.3], size=(2, 3))
        contacts.append(
            Contact(
                leg=leg,
                shoulder_m=shoulder,
                reach_m=np.linalg.norm(leg_vector) + rng.choice([1e-6, 0.1]),
                patch=patch,
                force_min=f - room[0],
                force_max=f + room[1],
            )
        )
    problem = Problem.posture(
        contacts=tuple(contacts),
        mass_kg=10.0,
        com_nominal_m=com + rng.uniform(-0.01, 0.01, 3),
        com_radius_m=0.02,
    )
    return Motion.of_posture(
        problem, com_m=com, rotation_rad=rotation, toes_m=toes, forces_n=forces
    )


@given(SEEDS)
@settings(max_examples=120)
def test_the_bound_is_never_above_the_moment_of_a_posture_that_is_otherwise_right(programs, seed):
    posture = around_a_posture(seed)
    groups = {g.name: g.worst for g in check_plan(posture).groups}
    assert max(worst for group, worst in groups.items() if group != "moment_balance") < 1e-12
    moment = np.cross(posture.toes_m - posture.com_m, posture.forces_n[0]).sum(axis=0) / (
        98.1 * 0.6
    )
    answer = least(programs, Scaled.of(posture.problem))
    assert answer.solved
    assert answer.bound <= np.max(np.abs(moment)) + 1e-7


@given(SEEDS)
@settings(max_examples=40)
def test_on_patches_without_size_the_bound_is_the_least_residual_of_those_toes(
    programs, drawn, mixed, seed
):
    rng = np.random.default_rng(seed)
    problem = (
        mixed(int(rng.integers(20)), (3, 4, 5))
        if rng.random() < 0.5
        else drawn("wall-3", int(rng.integers(60)))
    )
    scaled = Scaled.of(problem)
    toes = np.array([rng.dirichlet(np.ones(len(piece))) @ piece for piece in scaled.pieces])
    for i, toe in enumerate(toes):
        scaled = scaled.with_piece(i, np.repeat(toe[None], int(rng.choice([1, 3])), axis=0))
    answer, nothing = least(programs, scaled), np.zeros((1, 3))
    held = Point(com=nothing, rotation=nothing, toes=toes, forces=0.0 * toes, residual=np.inf)
    assert answer.bound == pytest.approx(
        project(programs, "fix-toes", scaled, held).residual, abs=2e-7
    )
    if np.isfinite(answer.bound):
        np.testing.assert_allclose(answer.toes, toes, atol=1e-8)


@pytest.mark.parametrize("name", ["wall-3", "ground-3"])
def test_the_small_form_says_what_the_whole_one_says_where_the_box_is_implied(drawn, name):
    small, whole = forms(Scaled.of(drawn("wall-3", 0)))
    implied = 0
    for seed in range(40):
        scaled = Scaled.of(drawn(name, seed))
        if not scaled.box_implied:
            continue
        implied += 1
        assert small.solve(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=3e-7)
    assert implied >= 10


@pytest.mark.parametrize("friction", [0.5, 1e-3, 1e-4, 1e-6, 0.0])
def test_the_form_that_is_chosen_says_what_the_whole_one_says_on_ice(programs, drawn, friction):
    small, whole = forms(Scaled.of(drawn("wall-3", 0)))
    for seed in range(30):
        scaled = Scaled.of(drawn("wall-3", seed))
        scaled = replace(scaled, friction=np.array([friction, 0.5, 0.5]))
        assert scaled.box_implied <= (friction > 1e-3)
        assert least(programs, scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=1e-6)
        if scaled.box_implied:
            assert small.solve(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=1e-6)


def test_the_box_is_implied_exactly_where_cone_and_normal_limit_reach_no_other_side(drawn):
    three = Scaled.of(drawn("wall-3", 0))
    plain = replace(
        three,
        friction=np.full(3, 0.5),
        force_min=np.tile([0.0, -1.0, -1.0], (3, 1)),
        force_max=np.ones((3, 3)),
    )
    assert plain.box_implied

    def box(low, high):
        others = ([[0.0, -1.0, -1.0]] * 2, np.ones((2, 3)))
        return plain.with_force_box(np.vstack([[low], others[0]]), np.vstack([[high], others[1]]))

    assert box([0, -0.5, -0.5], [1, 0.5, 0.5]).box_implied
    assert box([-1, -0.5, -0.5], [1, 0.5, 0.5]).box_implied
    for k, sign in ((1, 1), (2, 1), (1, -1), (2, -1)):
        low, high = np.array([0, -0.5, -0.5]), np.array([1, 0.5, 0.5])
        (high if sign > 0 else low)[k] = 0.499 * sign
        assert not box(low, high).box_implied
    assert not box([0.01, -1, -1], [1, 1, 1]).box_implied
    assert not box([-1, -1, -1], [0, 1, 1]).box_implied


@pytest.mark.parametrize("scene", [*NATURAL, *MIXED], ids=str)
def test_the_multipliers_prove_the_bound(programs, drawn, mixed, scene):
    problem = drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)
    answer = least(programs, Scaled.of(problem))
    report = check_certificate(
        Certificate(tree=LEAF, multipliers=answer.multipliers[None]).of(problem)
    )
    if np.isinf(answer.bound):
        assert report.figures["lower_bound"] == np.inf
    else:
        assert report.figures["lower_bound"] == pytest.approx(
            answer.bound, rel=3e-5, abs=2e-7
        )  # single precision
    assert report.accepted == (report.figures["lower_bound"] > 1e-4)


@given(SEEDS)
@settings(max_examples=60)
def test_a_smaller_patch_or_force_box_never_lowers_the_bound(programs, drawn, mixed, seed):
    rng = np.random.default_rng(seed)
    problem = (
        mixed(int(rng.integers(20)), (3, 4, 5))
        if rng.random() < 0.5
        else drawn("wall-3", int(rng.integers(60)))
    )
    scaled = Scaled.of(problem)
    before = least(programs, scaled).bound
    for _ in range(3):
        i = int(rng.integers(scaled.size[0]))
        corners = scaled.pieces[i]
        if rng.random() < 0.5:
            corners = rng.dirichlet(np.ones(len(corners)), len(corners)) @ corners
        low, high = scaled.force_min[i], scaled.force_max[i]
        ends = low + (high - low) * np.sort(rng.uniform(0.0, 1.0, (2, 3)), axis=0)
        keep = rng.random(3) < 0.7
        scaled = narrowed(
            scaled, i, corners, np.where(keep, low, ends[0]), np.where(keep, high, ends[1])
        )
        after = least(programs, scaled).bound
        assert after >= before - 2e-7
        before = after


@pytest.mark.parametrize("implied", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_repeated_corners_change_nothing(drawn, implied, seed):
    scaled = padded = Scaled.of(drawn("wall-3", seed))
    for i, corners in enumerate(scaled.pieces):
        padded = padded.with_piece(i, corners[[0, 1, 2, 2, 2]])
    assert len(padded.vertices) == 15
    three = LiftProgram(scaled.layout, implied, True).solve(scaled)
    five = LiftProgram(padded.layout, implied, True).solve(padded)
    assert five.bound == pytest.approx(three.bound, abs=2e-7)


def test_a_limb_that_may_not_push_must_stand_on_its_patch_all_the_same(programs, drawn):
    """A force box without size leaves the shares free unless λ ≥ 0 is asked for: the patch would be
    its whole plane.
    """
    scaled = Scaled.of(drawn("wall-3", 0))
    nothing = np.zeros(3)
    corners = scaled.pieces[0]
    assert np.isfinite(least(programs, narrowed(scaled, 0, corners, nothing, nothing)).bound)
    beyond = narrowed(scaled, 0, corners + 20.0 * (corners[1] - corners[0]), nothing, nothing)
    assert least(programs, beyond).bound == np.inf


def test_where_the_solver_gives_up_nothing_is_proved(drawn, climb, monkeypatch):
    solve = Rows.solve
    monkeypatch.setattr(
        Rows, "solve", lambda rows, data: replace(solve(rows, data), status=ConicStatus.FAILED)
    )
    answer = least(Programs(), Scaled.of(drawn("wall-3", 5)))
    assert (answer.solved, answer.bound) == (False, 0.0)
    answer = solve_lift(Programs(), Scaled.of(climb(0)), least_moment=False)
    assert (answer.solved, answer.bound) == (False, -np.inf)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_the_answer_meets_what_the_lift_demands_of_it(programs, mixed, seed):
    scaled = Scaled.of(mixed(seed, (3, 4, 5)))
    answer = least(programs, scaled)
    assert answer.solved
    if not np.isfinite(answer.bound):
        assert answer.status is ConicStatus.INFEASIBLE
        return
    own = np.repeat([0, 1, 2], [3, 4, 5])
    assert answer.weights.min() >= 0.0
    np.testing.assert_allclose(answer.shares, 1.0, atol=1e-12)
    toes = [answer.weights[own == i] @ piece for i, piece in enumerate(scaled.pieces)]
    np.testing.assert_allclose(answer.toes, toes, atol=1e-12)
    world = np.einsum("uij,uj->ui", scaled.frames[own], answer.by_vertex)
    np.testing.assert_allclose(world.sum(axis=0), [0.0, 0.0, 1.0], atol=1e-7)
    moment = np.cross(scaled.vertices, world).sum(axis=0) - np.cross(answer.com[0], [0.0, 0.0, 1.0])
    assert np.max(np.abs(moment)) == pytest.approx(answer.bound, abs=1e-6)
    shear = np.linalg.norm(answer.by_vertex[:, 1:], axis=-1)
    assert np.all(shear <= scaled.friction[own] * answer.by_vertex[:, 0] + 1e-7)
    choice, point = answer.rounded()
    np.testing.assert_array_equal(choice, 0)
    np.testing.assert_array_equal(point.com, answer.com)
    for i in range(3):
        np.testing.assert_allclose(
            point.forces[i], answer.by_vertex[own == i].sum(axis=0), atol=1e-12
        )


# -------------------------------------------------------------------------------------------------
# over key frames


def lifted(programs, course):
    """The lift of a course with its objective."""
    return solve_lift(programs, Scaled.of(course), least_moment=False)


@pytest.mark.parametrize(
    ("seeds", "shape"),
    [((1, 3, 4), {}), ((0, 5), {"regions": 2, "ice": 0.4}), ((4, 5), {"frames": 3})],
    ids=["two frames", "two regions", "three frames"],
)
def test_its_least_objective_is_that_of_the_model_written_a_second_time(
    programs, climb, written_course, seeds, shape
):
    answers = {agreed(programs, climb(seed, **shape), written_course) for seed in seeds}
    assert answers == {ConicStatus.SOLVED, ConicStatus.INFEASIBLE}


def agreed(programs, course, written_course):
    """The status, that of the model written a second time, too; its objective and a bound on it."""
    ours, (problem, _) = lifted(programs, course), written_course(course)
    problem.solve(cp.CLARABEL)
    assert (ours.status is ConicStatus.INFEASIBLE) == (problem.status == cp.INFEASIBLE)
    if ours.status is ConicStatus.SOLVED:
        assert ours.bound * course.length_scale_m**2 == pytest.approx(
            problem.value, rel=1e-5, abs=1e-8
        )
    return ours.status


def test_so_it_is_on_other_polygons_some_of_ice_with_one_toe_that_stands(
    programs, rough, written_course
):
    courses = [rough(seed, regions=2, ice=0.2) for seed in (0, 1, 2, 4)]
    assert all(course.footholds[0].toe_m is not None for course in courses)
    answers = {agreed(programs, course, written_course) for course in courses}
    assert answers == {ConicStatus.SOLVED, ConicStatus.INFEASIBLE}


def test_with_one_frame_and_one_stance_it_leaves_the_moments_that_one_postures_lift_leaves(
    programs, climb
):
    seen = []
    for seed in range(8):
        course = climb(seed, frames=1)
        assert len(course.stances) == 1
        posture = course.posture_problem(course.stances[0], np.zeros(4, dtype=int))
        alone, ours = least(programs, Scaled.of(posture)), least(programs, Scaled.of(course))
        if np.isfinite(alone.bound) and ours.status is ConicStatus.SOLVED:
            # The fourth limb must be in reach, too: that can only leave more.
            assert ours.bound >= alone.bound - 1e-6
            seen.append(ours.bound - alone.bound)
    assert len(seen) > 4
    assert np.sum(np.abs(seen) < 1e-6) > 4


def test_shares_of_a_toe_sum_to_one_and_toes_are_on_their_patches(programs, climb):
    course = climb(0, regions=2, ice=0.4)
    answer = lifted(programs, course)
    np.testing.assert_allclose(
        answer.scaled.by_candidate(answer.shares, 0.0).sum(axis=1), 1.0, atol=1e-6
    )
    choice, point = answer.rounded()
    for p, put in enumerate(course.footholds):
        patch = put.candidates[choice[p]]
        off = point.toes[p] * course.length_scale_m - patch.centre_m
        assert abs(off @ patch.normal) < 1e-6
        assert np.linalg.norm(off) < 0.08


def test_rounding_takes_the_largest_share_and_the_net_force_on_the_robot_stays(programs, climb):
    torn = 0
    for seed in (0, 3, 4):
        answer = lifted(programs, climb(seed, regions=3))
        if answer.status is not ConicStatus.SOLVED:
            continue
        scaled, layout = answer.scaled, answer.scaled.layout
        choice, point = answer.rounded()
        shares = scaled.by_candidate(answer.shares, -1.0)
        np.testing.assert_array_equal(choice, shares.argmax(axis=1))
        torn += int((shares.max(axis=1) < 0.99).sum())
        chosen = scaled.chosen(choice)
        net = np.zeros((len(layout.stances), 3))
        np.add.at(net, layout.contacts[0], chosen.in_world(point.forces))
        np.testing.assert_allclose(net, np.tile([0.0, 0.0, 1.0], (len(net), 1)), atol=1e-6)
    assert torn > 2


def test_closing_candidates_never_lowers_the_objective_and_what_is_closed_is_gone(programs, climb):
    scaled = Scaled.of(climb(4, regions=2, ice=0.4))
    whole, rng, looked_at = (
        solve_lift(programs, scaled, least_moment=False),
        np.random.default_rng(0),
        0,
    )
    for _ in range(6):
        opened = scaled.opened()
        p, r = int(rng.integers(len(opened))), int(rng.integers(2))
        opened[p, r] = 0.0
        part = solve_lift(programs, scaled.only(opened), least_moment=False)
        if part.status is ConicStatus.SOLVED:
            assert part.bound >= whole.bound - 1e-7
            assert part.scaled.by_candidate(part.shares, -1.0)[p, r] == -1.0
            looked_at += 1
    assert looked_at > 2


def test_the_multipliers_of_a_course_prove_its_bound_and_those_of_its_ray_that_it_has_no_plan(
    programs, climb, rough
):
    proved = positive = 0
    courses = [
        climb(seed, **shape)
        for seed in range(4)
        for shape in ({}, {"regions": 2, "ice": 0.5}, {"frames": 3})
    ]
    for course in [*courses, *(rough(seed, regions=2, ice=0.5) for seed in range(6))]:
        for answer in (lifted(programs, course), least(programs, Scaled.of(course))):
            report = check_certificate(
                Certificate(tree=LEAF, multipliers=answer.multipliers[None]).of(course)
            )
            if answer.status is ConicStatus.INFEASIBLE:
                unbounded = report.figures["lower_bound"] == np.inf
                assert unbounded or lifted(programs, course).status is ConicStatus.INFEASIBLE
                assert report.accepted
                proved += 1
        if np.isfinite(answer.bound) and answer.bound > 1e-5:
            assert report.figures["lower_bound"] == pytest.approx(answer.bound, rel=1e-3, abs=1e-6)
            positive += 1
    assert proved >= 6
    assert positive >= 3


def test_a_stance_alone_leaves_no_more_than_the_course_does_and_has_the_numbers_of_its_own(
    programs, climb, rough
):
    several, courses = 0, [climb(seed, frames=3) for seed in range(4)]
    for course in [*courses, *(rough(seed, regions=3, ice=0.3) for seed in range(6))]:
        scaled = Scaled.of(course)
        whole = least(programs, scaled).bound
        for index, stance in enumerate(course.stances):
            part, footholds, contacts = alone(scaled, index)
            np.testing.assert_array_equal(footholds, course.holds[stance.frame])
            assert [scaled.layout.contacts[2][b] for b in contacts] == [
                footholds[i] for i in stance.limbs
            ]
            np.testing.assert_array_equal(part.com[0], scaled.com[stance.frame])
            for own, p in enumerate(footholds):
                mine, theirs = (
                    part.layout.candidate_footholds == own,
                    scaled.layout.candidate_footholds == p,
                )
                assert part.which[own] == scaled.which[p]
                np.testing.assert_array_equal(part.friction[mine], scaled.friction[theirs])
                for piece, other in zip(np.flatnonzero(mine), np.flatnonzero(theirs), strict=True):
                    np.testing.assert_array_equal(part.pieces[piece], scaled.pieces[other])
            bound = least(programs, part).bound
            assert bound <= whole + 1e-6
            several += bound > 1e-4
    assert several >= 5


def walled(problem: Problem, shift_m: float = 0.0) -> Problem:
    """The problem with legs that reach little but their patches' middles, or places beside them,
    and a name.
    """
    contacts = []
    for i, contact in enumerate(problem.contacts):
        normals = np.vstack([np.eye(3), -np.eye(3)])
        middle = contact.patch.vertices_m.mean(axis=0) + np.array([shift_m, 0.0, 0.0])
        bounds = normals @ middle + 0.04 + 0.01 * i
        contacts.append(replace(contact, reach_rows=ReachRows(normals=normals, bounds_m=bounds)))
    return problem.posture_with(contacts=tuple(contacts), tilt_limit_rad=0.0, robot="dog-1")


def feasible(drawn, count: int) -> list[tuple[Problem, np.ndarray]]:
    """Problems with half-spaces, and [p, f] of a posture of each."""
    found, planner = [], Exact()
    for seed in range(60):
        problem = walled(drawn("ground-3", seed))
        posture = planner.solve(problem).solution
        if posture is not None:
            found.append((problem, Scaled.of(problem).point(posture)))
        if len(found) == count:
            break
    assert len(found) == count
    return found


def test_p1_over_half_spaces_admits_every_posture_in_its_box(drawn, programs: Programs) -> None:
    for problem, point in feasible(drawn, 6):
        scaled = Scaled.of(problem)
        box = Envelope(low=point - 0.05, high=point + 0.05)
        assert programs.get(McCormick, scaled.layout).solve(scaled, box).margin <= 1e-7


def test_p1_over_half_spaces_refuses_what_they_keep_out_and_balls_let_in(
    drawn, programs: Programs
) -> None:
    kept_out = 0
    for seed in range(20):
        plain, problem = drawn("ground-3", seed), walled(drawn("ground-3", seed), 0.3)
        wide = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
        loose, tight = (
            programs.get(McCormick, scaled.layout).solve(scaled, wide)
            for scaled in map(Scaled.of, (plain, problem))
        )
        assert loose.margin <= tight.margin + 1e-6
        kept_out += bool(np.isfinite(loose.margin) and np.isinf(tight.margin))
    assert kept_out > 5


def test_points_without_moments_are_in_the_inner_sets(drawn, programs: Programs) -> None:
    looked = 0
    for seed in range(12):
        problem = replace(walled(drawn("ground-3", seed)), tilt_limit_rad=0.2)
        scaled = Scaled.of(problem)
        point = programs.get(WithoutMoment, scaled.layout, True).solve(scaled)
        if point is not None:
            looked += 1
            worst = check_postures(
                [plan_of(problem, scaled, scaled.numbers, point)], without=("moment_balance",)
            )
            assert worst[0] <= 1e-6
    assert looked > 3


# ----------------------------------------------------------------------------------------------------
# whose they are


@pytest.fixture
def learned(drawn) -> EnvelopeSet:
    box = Envelope(low=np.full((3, 6), -0.9), high=np.full((3, 6), 0.9))
    return EnvelopeSet.for_problems(
        "ground-3-of-dog-1", [walled(drawn("ground-3", seed)) for seed in range(9)], [box]
    )


def test_envelopes_keep_the_name_of_their_robot_in_their_file(learned: EnvelopeSet) -> None:
    assert learned.robot == "dog-1"
    data = json.loads(json.dumps(learned.to_json()))
    assert EnvelopeSet.from_json(data).robot == "dog-1"
    del data["robot"]
    old = EnvelopeSet.from_json(data)
    assert (old.robot, "robot" in old.to_json()) == ("", False)


def test_envelopes_of_another_robot_are_refused(learned: EnvelopeSet, drawn) -> None:
    problem = walled(drawn("ground-3", 0))
    learned.check_fits(problem)
    for other, message in (("cat-2", "cat-2"), ("", "the default hexapod")):
        with pytest.raises(InvalidInput) as error:
            learned.check_fits(problem.posture_with(robot=other))
        wants = "robot: expected dog-1 for an envelope learned for ground-3-of-dog-1"
        assert str(error.value) == f"{wants}, got {message}"
    course = problem.posture_with(robot="cat-2").course()
    with refuses("robot"):
        boxes_of(course, learned)


def test_boxes_of_a_named_robot_are_told_in_the_units_of_the_course(
    learned: EnvelopeSet, drawn
) -> None:
    course = walled(drawn("ground-3", 0)).course()
    (box,) = boxes_of(replace(course, length_scale_m=0.3), learned)
    np.testing.assert_allclose(box.high, [[1.8] * 3 + [0.9] * 3] * 3)
    np.testing.assert_allclose(box.low, -box.high)


def test_a_stance_takes_the_set_of_its_own_legs(learned: EnvelopeSet, drawn) -> None:
    course = walled(drawn("ground-3", 0)).course()
    other = replace(learned, legs=tuple(reversed(learned.legs)), problem_class="reversed")
    with refuses("envelopes"):
        boxes_of(
            course,
            [learned, replace(learned, envelopes=learned.envelopes * 2, problem_class="doubled")],
        )
    (box,) = boxes_of(course, learned)
    for order in ([learned, other], [other, learned]):
        (one,) = boxes_of(course, order)
        np.testing.assert_array_equal(one.low, box.low)


def test_legs_that_were_measured_are_mirrored_to_the_nearest(drawn) -> None:
    course = walled(drawn("ground-3", 0)).course()
    limbs = course.robot.limbs
    away = [
        replace(limb, shoulder_m=limb.shoulder_m + np.array([0.01 * i, 0.0, 0.0]))
        for i, limb in enumerate(limbs)
    ]
    both = [
        replace(limb, name=f"{limb.name}'", shoulder_m=limb.shoulder_m * [1.0, -1.0, 1.0])
        for limb in limbs
    ]
    robot = replace(course.robot, limbs=(*away, *both))
    box = Envelope(low=np.full((3, 6), -0.9), high=np.full((3, 6), 0.9))
    problems = [walled(drawn("ground-3", seed)) for seed in range(3)]
    assert mirrored(EnvelopeSet.for_problems("x", problems, [box]), robot).legs == (
        "RF'",
        "RR'",
        "LM'",
    )
    with refuses("RR"):
        mirrored(EnvelopeSet.for_problems("x", problems, [box]), replace(robot, identity=""))
