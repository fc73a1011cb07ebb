"""What is found is accepted, what is cut has no leap, and what is proved is checked."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Certificate, Motion, Status, Way
from stancekit.planners.answer.plan import LEAP_BODY
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.crossing import cross, drawn_in, stretches, surface_of
from stancekit.planners.leap.finder import LeapFinder, LeapSearch, Picker, find_leap, tries_of
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.prove import (
    MARGIN,
    Cut,
    guide,
    plan_cut,
    proof_cut,
    ray,
    shapes,
    split,
)
from stancekit.planners.leap.scp import LeapAttempt, attempt
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.search.methods import make_planner
from stancekit.planners.terrain.families import family_terrain
from stancekit.planners.terrain.polygon import Surface
from stancekit.planners.verify import check_certificate, explain
from stancekit.planners.verify.leaps import check_leap
from tests.refusals import assert_names, refuses


@pytest.mark.parametrize("order", ["rule", "noise", "farkas", "finder"])
def test_every_order_finds_a_leap_that_the_verifier_accepts(leap: Leap, order) -> None:
    outcome = find_leap(leap, LeapFinder(order=order))
    assert outcome.status is Status.FEASIBLE
    assert outcome.report.accepted
    assert outcome.report.figures["momentum_error"] < 1e-3


def test_random_choices_are_untried_ones(leap: Leap) -> None:
    search = LeapSearch(leap, LeapFinder(order="random", solves=12), Programs())
    tried = [tuple(found.choice.tolist()) for found in search.attempts()]
    assert len(set(tried)) == len(tried) > 3


def test_a_box_robot_leaps() -> None:
    outcome = find_leap(leap_class("leap-anymal").draw(np.random.default_rng(0)))
    assert outcome.status is Status.FEASIBLE


def test_cuts_refute_the_choice_that_they_come_from_and_none_that_is_solved() -> None:
    leap = leap_class("leap-hard").draw(np.random.default_rng(6))
    numbers, programs, rng = LeapNumbers.of(leap), Programs(), np.random.default_rng(0)
    solved = [
        found.choice
        for found in LeapSearch(leap, LeapFinder(solves=12), programs).attempts()
        if found.solved
    ]
    assert solved
    own, proofs = 0, 0
    for _ in range(16):
        found = attempt(programs, numbers, rng.integers(0, 8, 8))
        if not found.refuted:
            continue
        row = ray(numbers, found.solution)
        plan, proof = plan_cut(numbers, row, 0.8), proof_cut(numbers, row)
        own += plan.value(found.choice) > MARGIN
        proofs += proof.value(found.choice) > MARGIN
        assert proof.value(found.choice) <= plan.value(found.choice) + 1e-9
        assert max(plan.value(choice) for choice in solved) <= MARGIN
    assert (own > 8, proofs > 4) == (True, True)


def test_the_guide_of_a_choice_is_its_cost_and_bounds_that_of_others(
    leap: Leap, failed: LeapAttempt
) -> None:
    numbers = LeapNumbers.of(leap)
    cut = guide(numbers, failed)
    assert cut.value(failed.choice) == pytest.approx(failed.first, abs=1e-9)
    other = np.array(failed.choice)
    other[6] = (other[6] + 1) % 8
    found = attempt(Programs(), numbers, other, share=1.0, steps=1)
    assert cut.value(other) <= found.first + 1e-3 or found.refuted


def test_the_picker_gives_the_best_sum_that_no_cut_refutes() -> None:
    rng = np.random.default_rng(5)
    scores = rng.normal(size=(5, 3))
    scores[2, 1:] = -np.inf
    picker = Picker(scores, 1.0)
    every = [
        (a, b, 0, d, e) for a in range(3) for b in range(3) for d in range(3) for e in range(3)
    ]
    value = {one: scores[np.arange(5), list(one)].sum() for one in every}
    assert tuple(picker.best()) == max(every, key=value.get)

    cut = Cut(constant=0.0, table=np.where(np.isfinite(scores), rng.normal(size=(5, 3)), np.inf))
    picker.refute(cut)
    left = [one for one in every if cut.value(np.array(one)) <= MARGIN]
    assert tuple(picker.best()) == max(left, key=value.get)


def test_a_certificate_is_accepted_and_a_tampered_one_is_not(refuted: Answer[Motion]) -> None:
    leap, proof = refuted.problem, refuted.certificate
    assert check_certificate(proof.of(leap)).accepted
    nothing = Certificate(tree=proof.tree, multipliers=0.0 * proof.multipliers)
    short = Certificate(tree=proof.tree, multipliers=proof.multipliers[:, :-1])
    torn = Certificate(
        tree=np.array([[1.0, 0.0, 0.0, 0.0, 0.0]]), multipliers=proof.multipliers[:1]
    )
    noise = np.random.default_rng(0).normal(size=proof.multipliers.shape)
    for bad in (nothing, short, torn, Certificate(tree=proof.tree, multipliers=noise)):
        assert not check_certificate(bad.of(leap)).accepted
    with_grip = replace(
        leap,
        footholds=tuple(
            replace(one, candidates=tuple(patch.with_friction(2.0) for patch in one.candidates))
            for one in leap.footholds
        ),
        robot=replace(
            leap.robot, limbs=tuple(replace(limb, reach_m=1.0) for limb in leap.robot.limbs)
        ),
    )
    assert not check_certificate(proof.of(with_grip)).accepted


def test_the_planners_bound_is_that_of_the_check(refuted: Answer[Motion]) -> None:
    leap, proof = refuted.problem, refuted.certificate
    if len(proof.multipliers) == 1:
        bound = check_certificate(proof.of(leap)).figures["lower_bound"]
        numbers = LeapNumbers.of(leap)
        cut = proof_cut(numbers, proof.multipliers[0])
        assert cut.least(numbers.scaled.opened()) == pytest.approx(bound, rel=1e-6)


def test_an_explanation_names_what_would_have_to_give(refuted: Answer[Motion]) -> None:
    assert refuted.certificate is not None
    said = explain(refuted.certificate)
    first = said.relaxations[0]
    assert_names(said.message, "infeasible", first.leg)
    assert first.needed > first.now


def test_timings_are_chosen_from_and_a_proof_covers_all_of_them(
    found: Answer[Motion], refuted: Answer[Motion]
) -> None:
    impossible = (0.32, 0.02, 0.32)
    two = replace(found.problem, timings_s=(impossible, found.problem.timings_s[0]))
    plan = find_leap(two).solution
    assert plan.timing == 1
    for odd in (0.5, 2, -1, True):
        with refuses("timing"):
            replace(plan, timing=odd)
    both = replace(
        refuted.problem, timings_s=(refuted.problem.timings_s[0], refuted.problem.timings_s[0])
    )
    proof = find_leap(both, LeapFinder(solves=4)).certificate
    assert check_certificate(proof.of(both)).accepted
    assert not check_certificate(proof.of(refuted.problem)).accepted


def test_a_forged_leap_is_refused(found: Answer[Motion]) -> None:
    plan = found.solution
    assert plan is not None
    assert check_leap(plan).accepted
    for name in ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad", "toes_m", "forces_n"):
        array = np.array(getattr(plan, name))
        array.flat[-1] += 20.0 if name == "forces_n" else 0.01
        assert not check_leap(replace(plan, **{name: array})).accepted, name
        bad = check_leap(replace(plan, **{name: array * np.nan}))
        assert not bad.accepted
        assert_names(bad.message, name)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"order": "best"},
            "order",
        ),
        ({"share": 0.0}, "share"),
        ({"solves": 0}, "solves"),
    ],
)
def test_a_finder_refuses_settings_that_are_none(settings, message) -> None:
    with refuses(message):
        LeapFinder(**settings)


@pytest.mark.parametrize("name", ["leap-hard", "leap-given", "leap-anymal"])
def test_any_multipliers_have_the_bound_that_the_check_works_out_on_its_own(name) -> None:
    leap, rng = leap_class(name).draw(np.random.default_rng(2)), np.random.default_rng(5)
    leap = replace(leap, robot=replace(leap.robot, model=None))  # one rigid body
    numbers = LeapNumbers.of(leap)
    size = sum(int(np.prod(shape)) for shape in shapes(numbers).values())
    for _ in range(3):
        row = np.abs(rng.normal(size=size)) * (
            rng.random(size) < 0.3
        )  # half-spaces and heights weigh nothing below 0
        leaf = Certificate(tree=np.zeros((1, 5)), multipliers=row[None])
        bound = check_certificate(leaf.of(leap)).figures["lower_bound"]
        assert proof_cut(numbers, row).least(numbers.scaled.opened()) == pytest.approx(
            bound, rel=1e-9
        )


def test_a_leap_that_is_found_makes_no_sum_of_any_multipliers_positive(
    found: Answer[Motion],
) -> None:
    plan, rng = found.solution, np.random.default_rng(6)
    numbers = LeapNumbers.of(plan.problem)
    size = sum(int(np.prod(shape)) for shape in shapes(numbers).values())
    rows = [np.where(rng.random(size) < 0.2, rng.normal(size=size), 0.0) for _ in range(30)]
    for row in rows:
        parts = split(numbers, row)
        for part in (parts["reach_rows"], parts["height"]):
            np.abs(part, out=part)
        flat = np.concatenate([np.ravel(part) for part in parts.values()])
        assert proof_cut(numbers, flat).value(plan.choice) <= MARGIN


def test_a_verdict_says_that_nobody_looked_at_the_whole_body_and_limits_of_it_are_refused(tmp_path):
    path = tmp_path / "leap.yaml"
    path.write_text("distribution: leap-given\nseed: 0\n")
    outcome = stancekit.plan(path)
    assert outcome.report.accepted
    assert outcome.report.unchecked == LEAP_BODY
    with refuses("body"):
        stancekit.plan(
            outcome.problem,
            settings=stancekit.PlanSettings(body=stancekit.WholeBodyLimits(torque_nm=3.0)),
        )


TOES = np.array(
    [[0.19, 0.13, -0.27], [0.19, -0.13, -0.27], [-0.19, 0.13, -0.27], [-0.19, -0.13, -0.27]]
)


GAP = family_terrain("gaps", 0.4, 0)


def test_a_gap_wider_than_the_stance_parts_the_way_in_two() -> None:
    gap, middle = GAP.figures["gap_m"], GAP.figures["middle_m"]
    ends = np.array([[middle - 0.6, 0.0], [middle + 0.6, 0.0]])
    way = stretches(GAP, drawn_in(TOES, ends[1] - ends[0], 0.05), ends)
    (_, leaves), (lands, _) = way.spans_m
    front, hind = way.at(leaves)[0] + 0.14, way.at(lands)[0] - 0.14  # toes drawn in by 5 cm
    assert front == pytest.approx(middle - 0.5 * gap, abs=0.011)
    assert hind == pytest.approx(middle + 0.5 * gap, abs=0.011)


def test_a_gap_narrower_than_the_stance_has_a_stretch_above_it() -> None:
    terrain = family_terrain("gaps", 0.15, 0)
    middle = terrain.figures["middle_m"]
    way = stretches(terrain, TOES, np.array([[middle - 0.6, 0.0], [middle + 0.6, 0.0]]))
    assert len(way.spans_m) == 3


@pytest.mark.parametrize("goal", [-0.3, -0.5, GAP.figures["middle_m"]])
def test_a_way_without_a_gap_or_to_a_goal_above_one_has_no_stretches(goal: float) -> None:
    assert stretches(GAP, TOES, np.array([[-0.55, 0.0], [goal, 0.0]])) is None


def test_a_gap_that_is_not_stepped_over_is_leapt_over() -> None:
    question = laid_between("gaps:0.5:0", (-0.3, 0.0), (0.8, 0.0), robot="laikago")
    found = cross(question, make_planner("two-stage"), robot="laikago", refusal="a gap")
    assert found.report.accepted, found.message
    assert [part.keyed for part in found.solution.parts] == [True, False, True]


def test_a_leap_leaves_from_whole_surfaces_and_not_from_the_pieces_that_climbs_end_on() -> None:
    for _, patch in GAP.standing:
        place = patch.centre_m + 0.3 * (patch.vertices_m[0] - patch.centre_m)
        piece = Surface(patch, 0.0).window(place, 0.04)
        assert surface_of(GAP, piece) is patch
        other = piece.with_friction(0.5 * patch.friction)
        assert surface_of(GAP, other) is other
        above = piece.with_vertices(piece.vertices_m + 0.01 * piece.normal)
        assert surface_of(GAP, above) is above


def test_of_two_surfaces_in_one_plane_a_leap_leaves_from_the_one_that_holds_the_piece() -> None:
    patch = GAP.standing[0][1]
    centre, side = patch.centre_m, np.array([0.1, 0.0, 0.0])
    short = patch.with_vertices(centre + 0.5 * (patch.vertices_m - centre))
    piece = Surface(short, 0.0).window(short.centre_m, 0.04)
    reach = float(np.ptp(short.vertices_m[:, 0])) / 2.0
    piece = piece.with_vertices(piece.vertices_m + side * (reach - 0.01) / 0.1)
    ground = SimpleNamespace(standing=(("short", short), ("whole", patch)))
    assert surface_of(ground, piece) is patch


def test_a_crossing_begins_with_key_frames() -> None:
    with refuses("crossing gap"):
        Motion(problem=Way(name="gap", course=None, goal_m=np.zeros(2)), parts=())


def test_a_straight_way_has_the_body_as_high_as_its_toes_are_below_it() -> None:
    """The way that is laid out straight ahead is over the same ground as the one that is looked for:
    with the body on the ground every proof and every climb from a landing is about another robot.
    """
    found = laid_between(stancekit.terrain("ramps:0.2:1"), (0.0, 0.0), (0.2, 0.0), frames=2)
    straight = replace(found, straight=True)
    np.testing.assert_allclose(
        straight("inner").com_nominal_m[:, 2], found("inner").com_nominal_m[:, 2], atol=0.03
    )


def test_a_proof_of_one_rigid_body_says_nothing_of_a_robot_whose_hips_move_with_its_legs() -> None:
    legged = leap_class("leap-anymal").draw(np.random.default_rng(0))
    legged = replace(legged, timings_s=((0.32, 0.02, 0.32),))
    body = replace(legged, robot=replace(legged.robot, model=None))
    proof, answer = (find_leap(of, LeapFinder(solves=2)) for of in (body, legged))
    assert (proof.status, answer.status) == (Status.INFEASIBLE, Status.UNDECIDED)
    assert_names(check_certificate(proof.certificate.of(legged)).message, "legs of its own")
    assert_names(explain(proof.certificate.of(legged)).message, "not explained")
    made = [{one.status for one in tries_of(of, {"random": 2}, seed=0)} for of in (body, legged)]
    assert made == [{Status.INFEASIBLE}, {Status.UNDECIDED}]
