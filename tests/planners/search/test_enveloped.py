"""P1 over envelopes for key frames: mirrored boxes, the signed margin of a course, and what a
relaxation promises.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.boxes import boxes_of, mirrored
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick, domain_of
from stancekit.planners.robot import hexapod
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate
from tests.refusals import assert_names, refuses

MIRROR = np.diag([1.0, -1.0, 1.0])
ACROSS = {"RF": "LF", "RM": "LM", "RR": "LR", "LF": "RF", "LM": "RM", "LR": "RR"}


@pytest.fixture(scope="module")
def learned(programs, drawn):
    """Quantile boxes over witnesses, by problem class."""

    def learn(name, count=40, share=0.02):
        problems, points = [], []
        for seed in range(count):
            problem = drawn(name, seed)
            posture = ExactPlanner(programs=programs).solve(problem).solution
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
    outcome = TwoStagePlanner(programs=programs).solve(course)
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
    outcome = TwoStagePlanner(wide, programs=programs).solve(course)
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert np.isnan(outcome.bound)  # a learned box proves no bound


@pytest.mark.parametrize("projection", ["fix-p", "fix-toes"])
def test_the_papers_projections_are_there_too(projection, learned, programs):
    course = read_course("walls", frames=3)
    outcome = TwoStagePlanner(learned["wall-3"], projection=projection, programs=programs).solve(
        course
    )
    assert outcome.status is Status.FEASIBLE, outcome.message


def test_a_box_too_small_is_reported_with_its_margin_and_proves_nothing(learned, programs):
    narrow = replace(learned["wall-3"], envelopes=(_shrunk(learned["wall-3"].envelopes[0], 0.1),))
    outcome = TwoStagePlanner(narrow, programs=programs).solve(read_course("walls", frames=3))
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, "infeasible")
    assert outcome.details["margin"] > 1e-3
    assert outcome.certificate is None
    assert_names(outcome.message, "box")


def test_of_several_envelopes_the_one_that_fits_is_taken(learned, programs):
    box = learned["wall-3"].envelopes[0]
    up = np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])
    away = Envelope(low=box.low + up, high=box.high + up)
    several = replace(learned["wall-3"], envelopes=(away, box))
    outcome = TwoStagePlanner(several, programs=programs).solve(read_course("walls", frames=2))
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert outcome.solution.modes is None  # envelopes of one terrain are no modes


def test_a_course_that_is_infeasible_whatever_the_box_gets_the_lifts_proof(learned, programs):
    course = read_course("walls", frames=3)
    short = replace(
        course,
        com_radius_m=np.full(3, 1e-3),
        steps=replace(course.steps, com_m=0.01, progress_m=0.0),
    )
    outcome = TwoStagePlanner(learned["wall-3"], programs=programs).solve(short)
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
