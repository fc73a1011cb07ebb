"""P1 over envelopes for key frames: mirrored boxes, the signed margin of a course, and what a
relaxation promises.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import StepLimits, half_space, parts, too_small
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.force_distribution import along, lengths_of
from stancekit.planners.relaxation.boxes import boxes_of, mirrored
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.relaxation.mccormick import McCormick, domain_of
from stancekit.planners.robot import hexapod
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Nlp
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan, explain
from tests.planners.oracle import OraclePrograms
from tests.refusals import assert_names, refuses

from .test_exact import scip

TILT_RAD = 0.03
FARTHEST_RAD = 2.0 * np.sqrt(3.0) * TILT_RAD
"""From one corner of the box |Θ| ≤ tilt to the other: no turn is larger."""


def least(course: Problem, **lengths: float) -> Problem:
    return replace(course, steps=replace(course.steps, **lengths))


def turned(course: Problem, share: float) -> Problem:
    steps = replace(course.steps, rotation_rad=0.5, least_rotation_rad=share * FARTHEST_RAD)
    return replace(course, tilt_limit_rad=TILT_RAD, steps=steps)


def stepped(course: Problem, share: float) -> Problem:
    """A course on which each toe has to go this share of what the corners of its patches are apart."""
    farthest = min(
        np.linalg.norm(one[:, None] - other, axis=2).max()
        for one, other in (
            [course.footholds[p].candidates[0].vertices_m for p in move] for move in course.moves
        )
    )
    return least(course, toe_m=2.0 * farthest, least_toe_m=share * farthest)


def test_sides_cover_all_directions_and_each_half_space_holds_its_own_long_enough_steps():
    steps = np.random.default_rng(0).normal(size=(300, 3))
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    sides, seen, tightest = parts(None), 0, []
    assert len(sides) == 8
    for depth in range(4):
        within = np.array(
            [(np.linalg.solve(side.T, steps.T) >= -1e-9).all(axis=0) for side in sides]
        )
        assert within.any(axis=0).all()
        for side, inside in zip(sides, within, strict=True):
            normal, bound = np.split(half_space(side, 0.3), [3])
            assert np.linalg.norm(normal) == pytest.approx(1.0)
            assert (0.3 * steps[inside] @ normal >= bound).all()
            seen += int(inside.sum())
        tightest.append(min(half_space(side, 1.0)[3] for side in sides))
        if depth < 3:
            sides = [part for side in sides for part in parts(side)]
    assert seen >= 4 * len(steps)
    assert tightest[0] == pytest.approx(1.0 / np.sqrt(3.0))
    assert (np.diff(1.0 - np.array(tightest)) < 0.0).all()
    assert 1.0 - tightest[3] < 0.02
    assert not too_small(sides[0])


@pytest.mark.parametrize("make", [TwoStage, partial(Exact, max_nodes=20), Nlp])
def test_plans_step_as_far_and_would_not_without(climb, programs, make):
    course = climb(4, frames=3)
    asked = least(course, least_toe_m=0.06, least_rotation_rad=0.04)
    planner = make(programs=programs)
    free, kept = planner.solve(course), planner.solve(asked)
    assert free.status is Status.FEASIBLE
    judged = check_plan(replace(free.solution, problem=asked))
    short = asked.least_steps - lengths_of(free.solution, asked)[1]
    toes = len(asked.moves)
    for name, worst in (
        ("least_toe_step", short[:toes].max()),
        ("least_rotation_step", short[toes:].max()),
    ):
        assert worst > 1e-3
        assert judged.group(name).value == pytest.approx(worst)
        assert judged.group(name).verdict == "violated"
    assert kept.status is Status.FEASIBLE
    assert kept.solution.problem.sides is None
    assert (lengths_of(kept.solution, asked)[1] >= asked.least_steps - 1e-6).all()
    assert check_plan(kept.solution).accepted
    assert kept.details["asked"] >= 2.0


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_a_turn_from_corner_to_corner_is_found_and_no_farther_one(climb, programs, share):
    course = climb(4, frames=2)
    assert TwoStage(programs=programs).solve(turned(course, share)).status is Status.FEASIBLE
    refuted = TwoStage(programs=programs).solve(turned(course, 2.0 - share))
    assert refuted.status is Status.INFEASIBLE
    assert_names(explain(refuted.certificate).message, "steps.least_rotation_rad")


def test_a_toe_steps_from_corner_to_corner_and_no_farther(climb, programs):
    course = climb(4, frames=2)
    assert len(course.moves) >= 1
    assert TwoStage(programs=programs).solve(stepped(course, 0.6)).status is Status.FEASIBLE
    refuted = TwoStage(programs=programs).solve(stepped(course, 1.05))
    assert refuted.status is Status.INFEASIBLE
    proof = refuted.certificate
    assert (proof.tree[:, 0] == 4.0).any()
    assert_names(explain(proof).message, "steps.least_toe_m")


def test_forged_proofs_are_refused(climb, programs):
    course = turned(climb(4, frames=2), 1.3)
    proof = TwoStage(programs=programs).solve(course).certificate
    assert check_certificate(proof).accepted
    assert not check_certificate(proof.of(turned(climb(4, frames=2), 0.5))).accepted
    assert not check_certificate(proof.of(climb(4, frames=2))).accepted  # it has no such rows
    tree = np.array(proof.tree)
    for forged, name in (
        (np.vstack([[4.0, 1.0, 0.0, 0.0, 0.0], tree[1:]]), "least step"),
        (np.vstack([[4.0, 0.0, 1.0, 0.0, 0.0], tree[1:]]), "least step"),
        (tree[:-1], "tree"),
        (np.tile([4.0, 0.0, 0.0, 0.0, 0.0], (20, 1)), "tree"),
    ):
        report = check_certificate(replace(proof, tree=forged))
        assert not report.accepted
        assert_names(report.message, name)
    one = replace(proof, tree=np.zeros((1, 5)), multipliers=proof.multipliers[:1])
    assert not check_certificate(one).accepted  # an open side proves nothing


def test_a_row_that_is_used_backwards_proves_nothing(climb, programs):
    course = turned(climb(4, frames=2), 1.3)
    proof = TwoStage(programs=programs).solve(course).certificate
    rows = np.array(proof.multipliers)
    rows[:, -1] *= -1.0
    assert not check_certificate(replace(proof, multipliers=rows)).accepted


def test_the_reference_solves_the_same_programs(climb, programs):
    course = least(climb(6, frames=3), least_toe_m=0.05, least_rotation_rad=0.03)
    free = TwoStage(programs=programs).solve(climb(6, frames=3))
    scaled = Scaled.of(along(course, free.solution))
    ours = solve_lift(programs, scaled, least_moment=False)
    theirs = solve_lift(OraclePrograms(), scaled, least_moment=False)
    assert ours.solved
    assert theirs.solved
    assert ours.bound == pytest.approx(theirs.bound, rel=1e-4)


@pytest.mark.parametrize("seed", [2])
def test_scip_agrees_on_the_problem_with_its_nonconvex_rows(climb, programs, seed):
    course = climb(seed, frames=2)
    for lengths in ({"least_toe_m": 0.08}, {"least_rotation_rad": 0.05}):
        asked = least(course, **lengths)
        outcome = Exact(programs=programs).solve(asked)
        best, bound = scip(asked, nodes=10)
        assert outcome.status is Status.FEASIBLE
        assert bound <= outcome.objective * 1.002
        assert outcome.bound <= best * 1.002


def test_within_the_time_limit_nothing_is_claimed(climb, programs):
    course = turned(climb(4, frames=2), 1.02)
    outcome = TwoStage(programs=programs, time_limit_s=1e-3).solve(course)
    assert outcome.status is Status.UNDECIDED
    assert outcome.certificate is None
    assert outcome.message


def test_a_course_without_them_has_neither_rows_nor_sides(climb):
    course = climb(4, frames=2)
    assert course.least_steps.shape == (0,)
    assert along(course, None) is course
    asked = least(course, least_toe_m=0.1)
    assert asked.least_steps.shape == (len(course.moves),)
    assert Problem.from_json(asked.to_json()).steps.least_toe_m == 0.1
    assert "sides" not in asked.to_json()
    assert "least_toe_m" not in course.to_json()["steps"]


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"least_toe_m": 0.4}, "least_toe_m"),
        ({"least_rotation_rad": 0.2}, "least_rotation_rad"),
        ({"least_toe_m": -0.1}, "least_toe_m"),
        ({"least_rotation_rad": float("nan")}, "least_rotation_rad"),
    ],
)
def test_bad_lengths_are_refused(changes, name):
    with refuses(name):
        StepLimits(**changes)


def test_sides_of_another_shape_are_refused(climb):
    with refuses("sides"):
        replace(climb(4, frames=2), sides=np.zeros((3, 4)))


MIRROR = np.diag([1.0, -1.0, 1.0])
ACROSS = {"RF": "LF", "RM": "LM", "RR": "LR", "LF": "RF", "LM": "RM", "LR": "RR"}


@pytest.fixture(scope="module")
def learned(programs, drawn):
    """Quantile boxes over witnesses, by problem class."""

    def learn(name, count=40, share=0.02):
        problems, points = [], []
        for seed in range(count):
            problem = drawn(name, seed)
            posture = Exact(programs=programs).solve(problem).solution
            if posture is not None:
                problems.append(problem)
                points.append(Scaled.of(problem).point(posture))
        assert len(points) > 15
        low, high = np.quantile(points, [share, 1.0 - share], axis=0)
        return EnvelopeSet.for_problems(name, problems, [Envelope(low=low, high=high)])

    return {name: learn(name) for name in ("wall-3", "ground-3")}


def reflected(problem):
    """The posture problem as a mirror shows it."""
    limbs = {limb.name: limb for limb in hexapod().limbs}
    contacts = []
    for contact in problem.contacts:
        patch = contact.patch
        image = replace(
            patch,
            vertices_m=patch.vertices_m @ MIRROR,
            normal=MIRROR @ patch.normal,
            shear_reference=MIRROR @ patch.shear_reference,
        )
        leg = ACROSS[contact.leg]
        contacts.append(replace(contact, leg=leg, shoulder_m=limbs[leg].shoulder_m, patch=image))
    return problem.posture_with(contacts=tuple(contacts))


def points_of(plan):
    """[p, f] of every bearing at a plan, f in contact frames, from the plan's own SI numbers, shape
    (B, 6).
    """
    course, rows = plan.problem, []
    for index, stance in enumerate(course.stances):
        for limb in stance.limbs:
            foothold = course.holds[stance.frame, limb]
            p = (plan.toes_m[foothold] - plan.com_m[stance.frame]) / course.length_scale_m
            f = (
                course.patch(foothold, plan.choice).frame.T
                @ plan.forces_n[index, limb]
                / course.weight_n
            )
            rows.append([*p, *f])
    return np.array(rows)


@pytest.mark.parametrize("name", ["wall-3", "ground-3"])
def test_a_mirrored_envelope_says_of_a_mirrored_posture_what_the_envelope_says_of_the_posture(
    name, learned, drawn
):
    envelopes, margins = learned[name], []
    image = mirrored(envelopes, hexapod())
    assert image.legs == ("LF", "LR", "RM")
    for seed in range(100, 112):
        problem = drawn(name, seed)
        image.check_fits(reflected(problem))
        scaled, seen_scaled = Scaled.of(problem), Scaled.of(reflected(problem))
        model = McCormick(scaled.layout)
        plain = model.solve(scaled, envelopes.envelopes[0])
        seen = model.solve(seen_scaled, image.envelopes[0])
        assert seen.margin == pytest.approx(plain.margin, abs=1e-6)
        margins.append(plain.margin)
    assert min(margins) < -1e-3 < 1e-3 < max(margins) or name == "ground-3"


def test_mirroring_twice_gives_the_envelope_back(learned):
    again = mirrored(mirrored(learned["wall-3"], hexapod()), hexapod())
    assert again.legs == learned["wall-3"].legs
    np.testing.assert_allclose(
        again.envelopes[0].to_vector(), learned["wall-3"].envelopes[0].to_vector()
    )
    np.testing.assert_allclose(again.normals, learned["wall-3"].normals)


@pytest.mark.parametrize("seed", range(4))
def test_the_margin_of_one_stance_is_that_of_its_posture_problem(seed, learned):
    course = perturbed("walls", np.random.default_rng(seed), frames=1)
    (stance,) = course.stances
    names = [course.robot.limb_names[limb] for limb in stance.limbs]
    image = mirrored(learned["wall-3"], course.robot)
    assert set(names) == set(image.legs)
    ordered = replace(stance, limbs=tuple(course.robot.limb_names.index(leg) for leg in image.legs))
    problem = course.posture_problem(ordered, np.zeros(6, dtype=int))
    scaled = Scaled.of(course)
    for grown in (0.0, -0.12):
        box = image.envelopes[0] if not grown else _shrunk(image.envelopes[0], 0.55)
        posture = Scaled.of(problem)
        apart = McCormick(posture.layout).solve(posture, box)
        (whole,) = boxes_of(
            course, replace(learned["wall-3"], envelopes=(_mirrored_back(image, box),))
        )
        together = McCormick(scaled.layout).solve(scaled, whole)
        assert together.margin == pytest.approx(apart.margin, abs=2e-6)


def _shrunk(box, share):
    middle, half = 0.5 * (box.low + box.high), 0.5 * share * (box.high - box.low)
    return Envelope(low=middle - half, high=middle + half)


def _mirrored_back(image, box):
    return mirrored(replace(image, envelopes=(box,)), hexapod()).envelopes[0]


def test_the_hard_form_has_an_answer_exactly_where_the_margin_is_not_positive(learned):
    course = read_course("walls", frames=3)
    scaled = Scaled.of(course)
    (box,) = boxes_of(course, learned["wall-3"])
    hard = McCormick(scaled.layout, soft=False)
    soft = McCormick(scaled.layout)
    said = set()
    for share in (1.0, 0.7, 0.4, 0.2, 0.1):
        narrow = _shrunk(box, share)
        answer, margin = hard.solve(scaled, narrow), soft.solve(scaled, narrow).margin
        assert abs(margin) > 1e-6  # none of these is a borderline case
        assert answer.feasible == (margin <= 0.0) == (answer.relaxed is not None)
        said.add(answer.feasible)
    assert said == {True, False}


@pytest.mark.parametrize("axes", ["contact", "world"])
def test_an_envelope_around_a_plan_admits_it_so_that_p1_costs_no_more(axes, programs):
    course = perturbed("walls", np.random.default_rng(3), frames=3)
    outcome = TwoStage(programs=programs).solve(course)
    assert outcome.solution is not None
    scaled, points = Scaled.of(course), points_of(outcome.solution)
    if axes == "world":
        frames = scaled.chosen(outcome.solution.choice).contact_frames
        points[:, 3:] = np.einsum("bij,bj->bi", frames, points[:, 3:])
    domain = domain_of(scaled, axes)
    assert np.all(points >= domain.low - 1e-7)
    assert np.all(points <= domain.high + 1e-7)
    box = Envelope(low=points - 0.02, high=points + 0.02)
    answer = McCormick(scaled.layout, axes, False).solve(scaled, box)
    assert answer.feasible
    assert answer.objective * course.length_scale_m**2 <= outcome.objective + 1e-7
    assert (
        answer.gap <= 0.02 * 0.02 + 1e-6
    )  # the furthest that the envelope of a square of this size is from p f


@pytest.mark.parametrize(
    ("name", "of"), [("walls", "wall-3"), ("stairs", "ground-3"), ("icy-walls", "wall-3")]
)
def test_p1_over_an_envelope_then_p2_gives_plans_that_the_verifier_accepts(
    name, of, learned, programs
):
    course = read_course(name, frames=3)
    wide = replace(learned[of], envelopes=(learned[of].envelopes[0].widened(0.05),))
    outcome = TwoStage(envelopes=wide, programs=programs).solve(course)
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert np.isnan(outcome.bound)  # a learned box proves no bound


@pytest.mark.parametrize("projection", ["fix-p", "fix-toes"])
def test_the_papers_projections_are_there_too(projection, learned, programs):
    course = read_course("walls", frames=3)
    outcome = TwoStage(envelopes=learned["wall-3"], projection=projection, programs=programs).solve(
        course
    )
    assert outcome.status is Status.FEASIBLE, outcome.message


def test_a_box_too_small_is_reported_with_its_margin_and_proves_nothing(learned, programs):
    narrow = replace(learned["wall-3"], envelopes=(_shrunk(learned["wall-3"].envelopes[0], 0.1),))
    outcome = TwoStage(envelopes=narrow, programs=programs).solve(read_course("walls", frames=3))
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "infeasible")
    assert outcome.details["margin"] > 1e-3
    assert outcome.certificate is None
    assert_names(outcome.message, "box")


def test_of_several_envelopes_the_one_that_fits_is_taken(learned, programs):
    box = learned["wall-3"].envelopes[0]
    up = np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])
    away = Envelope(low=box.low + up, high=box.high + up)
    several = replace(learned["wall-3"], envelopes=(away, box))
    outcome = TwoStage(envelopes=several, programs=programs).solve(read_course("walls", frames=2))
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert outcome.solution.modes is None  # envelopes of one terrain are no modes


def test_a_course_that_is_infeasible_whatever_the_box_gets_the_lifts_proof(learned, programs):
    course = read_course("walls", frames=3)
    short = replace(
        course,
        com_radius_m=np.full(3, 1e-3),
        steps=replace(course.steps, com_m=0.01, progress_m=0.0),
    )
    outcome = TwoStage(envelopes=learned["wall-3"], programs=programs).solve(short)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(short)).accepted


def test_stances_that_the_set_was_not_learned_for_are_named(learned):
    course = read_course("walls", frames=3)
    six = replace(course, lifts=((),) * 3, next_lift=(), footholds=course.footholds[:6])
    with refuses("frame 0"):
        boxes_of(six, learned["wall-3"])
    with refuses("frame 0", "normal"):
        boxes_of(read_course("tube", frames=3), learned["wall-3"])
    turned = tuple(
        replace(
            one,
            candidates=tuple(
                replace(p, shear_reference=np.array([1.0, 0, 0])) for p in one.candidates
            ),
        )
        for one in course.footholds
    )
    with refuses("frame 0"):
        boxes_of(replace(course, footholds=turned), learned["wall-3"])


def test_candidates_of_different_slopes_need_boxes_in_world_axes(learned):
    course = read_course("walls", frames=2)
    leaning = course.footholds[0].candidates[0]
    normal = np.array([0.0, np.cos(0.1), np.sin(0.1)]) * np.sign(leaning.normal[1])
    height = (leaning.vertices_m - leaning.centre_m) @ normal
    other = replace(
        leaning, normal=normal, vertices_m=leaning.vertices_m - height[:, None] * normal
    )
    changed = replace(course.footholds[0], candidates=(leaning, other))
    several = replace(course, footholds=(changed, *course.footholds[1:]))
    with refuses("frame 0", "limb LF"):
        boxes_of(several, learned["wall-3"])
    (box,) = boxes_of(several, learned["wall-3"], "world")
    scaled = Scaled.of(several)
    assert McCormick(scaled.layout, "world").solve(scaled, box).known


def test_a_robot_that_is_not_symmetric_has_no_mirrored_envelope(learned):
    robot = hexapod()
    lopsided = replace(robot, limbs=tuple(limb for limb in robot.limbs if limb.name != "LF"))
    with refuses("robot hexapod", "RF"):
        mirrored(learned["wall-3"], lopsided)
