"""The exact planner: against statics on paper, against IPOPT, and never without a witness or a proof."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from stancekit.planners.contact.exact import ExactPlanner, cut, halving_chord
from stancekit.planners.contact.nlp import NlpPlanner
from stancekit.planners.contact.planner import Acceptance
from stancekit.planners.contact.stages import Stages
from stancekit.planners.outcome import Certificate, Status
from stancekit.planners.scene import Contact, Patch, PostureProblem
from stancekit.planners.verify import check_certificate, check_posture
from stancekit.planners.verify.geometry import cut as cut_again

SEEDS = st.integers(0, 2**32 - 1)
MANY_NODES = ("wall-3", 225)
"""A scene that takes five nodes: its root is split, and so is one of the two."""
NATURAL = [("wall-3", seed) for seed in range(15)] + [("ground-3", 86), ("ground-3", 215)]
NATURAL += [("ground-3", seed) for seed in range(5)] + [("wall-5", seed) for seed in range(5)]


@pytest.fixture(scope="module")
def planner(stages):
    return ExactPlanner(stages=stages)


def rectangle(leg, centre, sides, normal, shear_reference, *, friction, most=1.0, reach=1.0, shoulder=(0, 0, 0)):
    """A contact on a rectangle with two given half sides."""
    first, second = np.array(sides, dtype=float)
    vertices = np.add(centre, [first + second, first - second, -first - second, second - first])
    patch = Patch(vertices_m=vertices, normal=normal, shear_reference=shear_reference, friction=friction)
    return Contact(
        leg=leg, shoulder_m=shoulder, reach_m=reach, patch=patch, force_min=[0, -1, -1], force_max=[most, 1, 1]
    )


def problem_of(*contacts, com=(0.0, 0.0, 0.0), radius=0.0, **rest):
    return PostureProblem(contacts=contacts, mass_kg=10.0, com_nominal_m=com, com_radius_m=radius, **rest)


def scene_of(drawn, mixed, scene):
    return drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)


def confirm(problem, outcome):
    """An answer carries what its status promises, and the verifier accepts it, also from a file."""
    if outcome.status is Status.FEASIBLE:
        report = check_posture(problem, outcome.posture)
        assert report.accepted
        assert outcome.residual == report.worst <= 1e-6
        assert outcome.residual_nm == report.residual_nm
        assert outcome.certificate is None
        assert outcome.lower_bound == 0.0
    elif outcome.status is Status.INFEASIBLE:
        proof = Certificate.from_json(json.loads(json.dumps(outcome.certificate.to_json())))
        report = check_certificate(problem, proof)
        assert report.accepted
        assert outcome.lower_bound == report.lower_bound > 1e-4
        assert outcome.posture is None
        assert np.isnan([outcome.residual, outcome.residual_nm]).all()
        assert len(proof.multipliers) == (len(proof.tree) + 1) / 2
    else:
        assert outcome.posture is outcome.certificate is None
        assert outcome.message


# ------------------------------------------------------------------------------------------------------ closed forms


@pytest.mark.parametrize("offset", [0.0, 0.119, 0.121, 0.2, 0.3])
def test_one_foot_holds_the_body_exactly_where_it_can_stand_below_the_com(planner, offset):
    """Patch half width .04, COM radius .08: nearer than .12 m the toe is under the COM; .6 m is the unit of levers."""
    foot = rectangle("RF", (offset, 0, -0.2), [(0.04, 0, 0), (0, 0.04, 0)], (0, 0, 1), (1, 0, 0), friction=0.6)
    outcome = planner.solve(problem_of(foot, radius=0.08))
    confirm(problem_of(foot, radius=0.08), outcome)
    short = offset - 0.12
    assert outcome.status is (Status.FEASIBLE if short < 0.0 else Status.INFEASIBLE)
    if short > 0.0:
        assert outcome.lower_bound == pytest.approx(short / 0.6, rel=1e-4)


@pytest.mark.parametrize(("degrees", "holds"), [(29.0, True), (32.0, False), (-29.0, True), (-32.0, False)])
def test_a_foot_on_a_slope_slips_beyond_the_angle_of_friction(planner, degrees, holds):
    """tan 30.96° = 0.6."""
    s, c = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    sides = [(0.05 * c, 0, -0.05 * s), (0, 0.05, 0)]
    problem = problem_of(rectangle("RF", (0, 0, -0.2), sides, (s, 0, c), (1, 0, 0), friction=0.6), radius=0.02)
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert (outcome.status is Status.FEASIBLE) == holds
    assert outcome.details["trivial"] == (not holds)


def brace(distance, ahead, height, friction, most):
    """Two facing walls at ±distance, patches of this height; the COM is fixed ``ahead`` of the middle."""
    contacts = []
    for leg, side in (("LM", 1), ("RM", -1)):
        sides = [(0.03, 0, 0), (0, 0, 0.5 * height)]
        centre = (0, side * distance, 0)
        contacts.append(rectangle(leg, centre, sides, (0, -side, 0), (0, 0, 1), friction=friction, most=most))
    return problem_of(*contacts, com=(0, ahead, 0))


@given(
    st.floats(0.2, 0.6), st.floats(0.0, 0.9), st.floats(0.01, 0.3), st.floats(0.5, 1.0), st.floats(0.5, 1.9),
)  # fmt: skip
@example(0.4, 0.25, 0.1, 0.8, 1.01)
@example(0.4, 0.25, 0.1, 0.8, 0.99)
@example(0.4, 0.0, 0.1, 1.0, 1.01)
@example(0.4, 0.0, 0.1, 1.0, 0.99)
def test_two_walls_brace_the_body_exactly_where_friction_and_the_couple_allow(planner, d, share, h, most, ratio):
    """Normal forces n, −n and vertical shears t₁ + t₂ = w; the moment about the COM at y = e is
    t₁ (d − e) − t₂ (d + e) = n (z₁ − z₂), |z₁ − z₂| ≤ h. So t₁ = (w (d + e) − n h) / 2d at least, and with t₁ ≤ μ n,
    n ≤ f_max the body is held where f_max (2 d μ + h) ≥ w (d + e), as it must be with t₂ = w − t₁ ≤ μ f_max.
    """  # fmt: skip
    assume(abs(ratio - 1.0) > 5e-3)
    e = share * d
    friction = ratio * max(((d + e) / most - h) / (2.0 * d), 0.5 / most)
    assume(friction * most < 1.0)  # the shear box is out of play
    problem = brace(d, e, h, friction, most)
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert outcome.status is (Status.FEASIBLE if ratio > 1.0 else Status.INFEASIBLE)
    without_couple = 2.0 * friction * most < 1.0 - 1e-6
    assert outcome.details.get("trivial") == (ratio < 1.0 and without_couple)


def test_walls_without_friction_hold_nothing(planner):
    problem = brace(0.3, 0.0, 0.1, 0.0, 1.0)
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert outcome.status is Status.INFEASIBLE
    assert outcome.lower_bound == np.inf
    assert outcome.details["trivial"] == 1.0


@pytest.mark.parametrize("friction", [0.3, 1e-3, 0.0])
def test_feet_that_are_all_on_one_side_of_the_com_do_not_pull(stages, friction):
    """Both level patches begin .15 m ahead of the COM: the moment is .15 m of the .6 m unit at the least."""
    feet = [
        rectangle(leg, (x, 0, -0.2), [(0.05, 0, 0), (0, 0.05, 0)], (0, 0, 1), (1, 0, 0), friction=friction, most=2.0)
        for leg, x in (("RF", 0.2), ("LF", 0.4))
    ]
    outcome = ExactPlanner(stages=stages, max_nodes=100).solve(problem_of(*feet))
    confirm(problem_of(*feet), outcome)
    assert outcome.status is Status.INFEASIBLE
    assert outcome.lower_bound == pytest.approx(0.25, rel=1e-4)


@pytest.mark.parametrize("scene", [("wall-3", 0), ("wall-3", 39), ("ground-3", 42), ("ground-3", 88)], ids=str)
def test_scenes_with_one_foot_on_ice_are_decided(stages, drawn, scene):
    first, *others = drawn(*scene).contacts
    icy = replace(first, patch=replace(first.patch, friction=0.0))
    outcome = ExactPlanner(stages=stages, max_nodes=100).solve(replace(drawn(*scene), contacts=(icy, *others)))
    assert outcome.status is not Status.UNDECIDED


# ------------------------------------------------------------------------------------------------------ many scenes


@pytest.mark.parametrize("scene", NATURAL, ids=str)
def test_it_finds_what_ipopt_finds_and_proves_the_rest(planner, drawn, scene):
    problem = drawn(*scene)
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert outcome.status is not Status.UNDECIDED
    if NlpPlanner().solve(problem).status is Status.FEASIBLE:
        assert outcome.status is Status.FEASIBLE


@pytest.mark.parametrize("corners", [(4, 4, 4), (3, 4, 5), (4, 4), (6, 3, 4, 3), (5,), (3, 3, 3, 3, 3, 3)], ids=str)
def test_quads_mixed_polygons_and_any_number_of_limbs_are_decided(planner, mixed, corners):
    nlp = NlpPlanner(starts=2)
    statuses = set()
    for seed in range(6):
        problem = mixed(seed, corners)
        outcome = planner.solve(problem)
        confirm(problem, outcome)
        statuses.add(outcome.status)
        assert outcome.status is Status.FEASIBLE or nlp.solve(problem).status is not Status.FEASIBLE
    assert Status.UNDECIDED not in statuses


def test_both_answers_come_up_and_some_take_branching(planner, drawn):
    outcomes = [planner.solve(drawn(*scene)) for scene in NATURAL]
    statuses = [outcome.status for outcome in outcomes]
    assert statuses.count(Status.FEASIBLE) >= 10
    assert statuses.count(Status.INFEASIBLE) >= 5
    assert sum(outcome.details["nodes"] > 1 for outcome in outcomes) >= 2
    assert sum(0.0 < outcome.lower_bound < np.inf for outcome in outcomes) >= 3


# ------------------------------------------------------------------------------------------------------------ limits


def test_at_the_node_limit_it_is_undecided(stages, planner, drawn):
    problem = drawn(*MANY_NODES)
    decided = planner.solve(problem)
    assert decided.status is Status.INFEASIBLE
    assert decided.details["nodes"] > 3
    assert len(decided.certificate.multipliers) > 2
    for limit in (0, 1):
        outcome = ExactPlanner(stages=stages, max_nodes=limit).solve(problem)
        confirm(problem, outcome)
        assert outcome.status is Status.UNDECIDED
        assert outcome.message == "stopped at the time, node or solver limit"
        assert outcome.lower_bound == 0.0


def test_at_the_time_limit_it_is_undecided(stages, drawn):
    planner = ExactPlanner(stages=stages, time_limit_s=0.0)
    outcome = planner.solve(drawn("wall-3", 0))
    assert outcome.status is Status.UNDECIDED
    assert outcome.message == "stopped at the time, node or solver limit"
    refuted = planner.solve(drawn("wall-3", 5))  # at the root, before the clock is looked at
    assert refuted.status is Status.INFEASIBLE


def test_between_tolerance_and_gap_it_is_undecided(stages, planner, drawn):
    bound = planner.solve(drawn("wall-3", 5)).lower_bound
    assert 1e-3 < bound < np.inf
    strict = ExactPlanner(stages=stages, acceptance=Acceptance(gap=1.9 * bound), max_nodes=40)
    outcome = strict.solve(drawn("wall-3", 5))
    assert outcome.status is Status.UNDECIDED
    assert outcome.message == "stopped at the time, node or solver limit"
    loose = ExactPlanner(stages=stages, acceptance=Acceptance(gap=0.99 * bound))
    assert loose.solve(drawn("wall-3", 5)).status is Status.INFEASIBLE


def test_where_the_projection_does_not_arrive_the_search_goes_on(drawn, monkeypatch):
    stages = Stages()
    project, calls = stages.project, []

    def arrives_later(projection, scaled, start, **options):
        calls.append(projection)
        point = project(projection, scaled, start, **options)
        return replace(point, residual=1e-5) if len(calls) < 3 else point

    monkeypatch.setattr(stages, "project", arrives_later)
    problem = drawn("wall-3", 0)
    outcome = ExactPlanner(stages=stages).solve(problem)
    confirm(problem, outcome)
    assert outcome.status is Status.FEASIBLE
    assert (calls, outcome.details["nodes"]) == (["scp"] * 3, 5.0)


def test_a_corner_given_twice_changes_nothing(planner, drawn):
    for scene in [MANY_NODES, ("ground-3", 86), ("wall-3", 0)]:
        problem = drawn(*scene)
        patches = [
            replace(c.patch, vertices_m=np.repeat(c.patch.vertices_m, [2, 1, 3], axis=0)) for c in problem.contacts
        ]
        contacts = tuple(replace(c, patch=patch) for c, patch in zip(problem.contacts, patches, strict=True))
        outcome = planner.solve(replace(problem, contacts=contacts))
        confirm(replace(problem, contacts=contacts), outcome)
        assert outcome.status is planner.solve(problem).status


# ------------------------------------------------------------------------------------------------------- repeatable


def words(outcome):
    """Everything about an outcome but its time."""
    proof = outcome.certificate and outcome.certificate.to_json()
    posture = outcome.posture and outcome.posture.to_json()
    return outcome.status, proof, posture, outcome.solves, outcome.lower_bound, dict(outcome.details)


def test_it_answers_the_same_in_another_planner_and_after_other_problems(drawn, mixed):
    scenes = [MANY_NODES, ("wall-3", 0), ("wall-3", 5), (1, (3, 4, 5)), ("ground-3", 86)]
    alone = [words(ExactPlanner().solve(scene_of(drawn, mixed, scene))) for scene in scenes]
    one = ExactPlanner()
    for scene, expected in [*zip(scenes, alone, strict=True)][::-1] * 2:
        assert words(one.solve(scene_of(drawn, mixed, scene))) == expected


@pytest.mark.parametrize("force_n", [50.0, 200.0])
@pytest.mark.parametrize("length_m", [0.3, 1.0])
def test_the_answer_does_not_depend_on_the_units(planner, drawn, force_n, length_m):
    for scene in NATURAL:
        problem = drawn(*scene)
        ratio = problem.force_scale_n / force_n
        contacts = tuple(
            replace(c, force_min=c.force_min * ratio, force_max=c.force_max * ratio) for c in problem.contacts
        )
        scaled = replace(problem, force_scale_n=force_n, length_scale_m=length_m, contacts=contacts)
        mine, theirs = planner.solve(problem), planner.solve(scaled)
        assert mine.status is theirs.status
        if mine.details["nodes"] == theirs.details["nodes"] == 1:
            nm = mine.lower_bound * problem.moment_scale_nm
            assert theirs.lower_bound * scaled.moment_scale_nm == pytest.approx(nm, rel=5e-5)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_scene_has_the_same_answer(planner, drawn, mixed, quarters):
    """Quarter turns about z, since the residual is the largest component and the tilt limit a box."""
    turn = np.linalg.matrix_power(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), quarters)

    def turned(contact):
        patch = contact.patch
        moved = {name: getattr(patch, name) @ turn.T for name in ("vertices_m", "normal", "shear_reference")}
        return replace(contact, patch=replace(patch, **moved), shoulder_m=turn @ contact.shoulder_m)

    for scene in [*NATURAL, *((seed, (3, 4, 5)) for seed in range(4))]:
        problem = scene_of(drawn, mixed, scene)
        again = replace(
            problem, contacts=tuple(turned(c) for c in problem.contacts), com_nominal_m=turn @ problem.com_nominal_m
        )
        mine, theirs = planner.solve(problem), planner.solve(again)
        assert mine.status is theirs.status
        if mine.details["nodes"] == theirs.details["nodes"] == 1:
            assert theirs.lower_bound == pytest.approx(mine.lower_bound, rel=5e-5)


# ----------------------------------------------------------------------------------------------------------- pieces


@given(SEEDS)
def test_planner_and_verifier_cut_patches_alike(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    piece = np.column_stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(angle)])
    for _ in range(4):
        chord = halving_chord(piece)
        for mine, theirs in zip(cut(piece, *chord), cut_again(piece, *chord), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        first, second = np.sort(rng.uniform(0.0, len(piece), 2))
        for mine, theirs in zip(cut(piece, first, second), cut_again(piece, first, second), strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-12)
        piece = cut(piece, *chord)[int(rng.integers(2))]


def test_a_triangle_is_halved_by_the_median_to_its_longest_edge():
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    assert halving_chord(triangle) == (0.0, 1.5)
    one, other = cut(triangle, 0.0, 1.5)
    np.testing.assert_allclose(one, [[0, 0, 0], [1, 0, 0], [0.5, 2, 0]])
    np.testing.assert_allclose(other, [[0.5, 2, 0], [0, 4, 0], [0, 0, 0]])
    assert halving_chord(np.vstack([triangle, [-1.0, 1.0, 0.0]])) == (0.0, 2.0)


def test_huge_scales_in_a_file_buy_no_tolerance(stages, drawn):
    infeasible = 0
    for seed in range(12):
        plain = drawn("wall-3", seed)
        contacts = tuple(replace(c, force_min=c.force_min / 1000, force_max=c.force_max / 1000) for c in plain.contacts)
        huge = replace(plain, contacts=contacts, force_scale_n=98100.0, length_scale_m=600.0)
        truth = ExactPlanner(stages=stages).solve(plain).status
        infeasible += truth is Status.INFEASIBLE
        said = ExactPlanner(stages=stages, max_nodes=20).solve(huge).status
        assert said in (truth, Status.UNDECIDED)
    assert infeasible >= 3
