"""The exact planners: against statics on paper, IPOPT and SCIP, and never without a witness or a
proof.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, strategies as st

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.scaled import Scaled, cones_met
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search import cuts
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.cuts import cut, halving_chord
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Nlp
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names

MANY_NODES = ("wall-3", 225)
"""A scene that takes five nodes: its root is split, and so is one of the two."""
GAPPED = (2, 4)
"""Seeds of courses whose lift is far below the best plan."""
NODES = 10
"""Of SCIP's tree: its cuts at the root are most of what it finds in many times as long."""
NATURAL = [("wall-3", seed) for seed in range(15)] + [("ground-3", 86), ("ground-3", 215)]
NATURAL += [("ground-3", seed) for seed in range(5)] + [("wall-5", seed) for seed in range(5)]


@pytest.fixture(scope="module")
def planner(programs):
    return Exact(programs=programs)


def rectangle(
    leg,
    centre,
    sides,
    normal,
    shear_reference,
    *,
    friction,
    most=1.0,
    reach=1.0,
    shoulder=(0, 0, 0),
):
    """A contact on a rectangle with two given half sides."""
    first, second = np.array(sides, dtype=float)
    vertices = np.add(centre, [first + second, first - second, -first - second, second - first])
    patch = Patch(
        vertices_m=vertices, normal=normal, shear_reference=shear_reference, friction=friction
    )
    return Contact(
        leg=leg,
        shoulder_m=shoulder,
        reach_m=reach,
        patch=patch,
        force_min=[0, -1, -1],
        force_max=[most, 1, 1],
    )


def problem_of(*contacts, com=(0.0, 0.0, 0.0), radius=0.0, **rest):
    return Problem.posture(
        contacts=contacts, mass_kg=10.0, com_nominal_m=com, com_radius_m=radius, **rest
    )


def scene_of(drawn, mixed, scene):
    return drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)


def confirm(problem, outcome):
    """An answer carries what its status promises, and the verifier accepts it, also from a file."""
    if outcome.status is Status.FEASIBLE:
        report = check_plan(outcome.solution)
        assert report.accepted
        assert outcome.residual == report.worst <= 1e-6
        assert outcome.residual_nm == report.figures["residual_nm"]
        assert outcome.certificate is None
        assert outcome.bound == 0.0
    elif outcome.status is Status.INFEASIBLE:
        proof = Certificate.from_json(json.loads(json.dumps(outcome.certificate.to_json())))
        report = check_certificate(proof.of(problem))
        assert report.accepted
        assert outcome.bound == report.figures["lower_bound"] > 1e-4
        assert outcome.solution is None
        assert np.isnan([outcome.residual, outcome.residual_nm]).all()
        assert len(proof.multipliers) == (len(proof.tree) + 1) / 2
    else:
        assert outcome.solution is outcome.certificate is None
        assert outcome.message


# ------------------------------------------------------------------------------------------------------
# closed forms


@pytest.mark.parametrize("offset", [0.0, 0.119, 0.121, 0.2, 0.3])
def test_one_foot_holds_the_body_exactly_where_it_can_stand_below_the_com(planner, offset):
    """Patch half width .04, COM radius .08: nearer than .12 m the toe is under the COM; .6 m is the
    unit of levers.
    """
    foot = rectangle(
        "RF", (offset, 0, -0.2), [(0.04, 0, 0), (0, 0.04, 0)], (0, 0, 1), (1, 0, 0), friction=0.6
    )
    outcome = planner.solve(problem_of(foot, radius=0.08))
    confirm(problem_of(foot, radius=0.08), outcome)
    short = offset - 0.12
    assert outcome.status is (Status.FEASIBLE if short < 0.0 else Status.INFEASIBLE)
    if short > 0.0:
        assert outcome.bound == pytest.approx(short / 0.6, rel=1e-4)


@pytest.mark.parametrize(
    ("degrees", "holds"), [(29.0, True), (32.0, False), (-29.0, True), (-32.0, False)]
)
def test_a_foot_on_a_slope_slips_beyond_the_angle_of_friction(planner, degrees, holds):
    """tan 30.96° = 0.6."""
    s, c = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    sides = [(0.05 * c, 0, -0.05 * s), (0, 0.05, 0)]
    problem = problem_of(
        rectangle("RF", (0, 0, -0.2), sides, (s, 0, c), (1, 0, 0), friction=0.6), radius=0.02
    )
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert (outcome.status is Status.FEASIBLE) == holds
    assert outcome.details["trivial"] == (not holds)


def brace(distance, ahead, height, friction, most):
    """Two facing walls at ±distance, patches of this height; the COM is fixed ``ahead`` of the
    middle.
    """
    contacts = []
    for leg, side in (("LM", 1), ("RM", -1)):
        sides = [(0.03, 0, 0), (0, 0, 0.5 * height)]
        centre = (0, side * distance, 0)
        contacts.append(
            rectangle(leg, centre, sides, (0, -side, 0), (0, 0, 1), friction=friction, most=most)
        )
    return problem_of(*contacts, com=(0, ahead, 0))


@given(
    st.floats(0.2, 0.6),
    st.floats(0.0, 0.9),
    st.floats(0.01, 0.3),
    st.floats(0.5, 1.0),
    st.floats(0.5, 1.9),
)
@example(0.4, 0.25, 0.1, 0.8, 1.01)
@example(0.4, 0.25, 0.1, 0.8, 0.99)
@example(0.4, 0.0, 0.1, 1.0, 1.01)
@example(0.4, 0.0, 0.1, 1.0, 0.99)
def test_two_walls_brace_the_body_exactly_where_friction_and_the_couple_allow(
    planner, d, share, h, most, ratio
):
    """Normal forces n, −n and vertical shears t₁ + t₂ = w; the moment about the COM at y = e is t₁
    (d − e) − t₂ (d + e) = n (z₁ − z₂), |z₁ − z₂| ≤ h. So t₁ = (w (d + e) − n h) / 2d at least, and
    with t₁ ≤ μ n, n ≤ f_max the body is held where f_max (2 d μ + h) ≥ w (d + e), as it must be
    with t₂ = w − t₁ ≤ μ f_max.
    """
    assume(abs(ratio - 1.0) > 5e-3)
    e = share * d
    friction = ratio * max(((d + e) / most - h) / (2.0 * d), 0.5 / most)
    assume(friction * most < 1.0)  # the shear box is out of play
    assume(d + e < 0.999)  # within the reach of 1 m
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
    assert outcome.bound == np.inf
    assert outcome.details["trivial"] == 1.0


@pytest.mark.parametrize("friction", [0.3, 1e-3, 0.0])
def test_feet_that_are_all_on_one_side_of_the_com_do_not_pull(programs, friction):
    """Both level patches begin .15 m ahead of the COM: the moment is .15 m of the .6 m unit at the
    least.
    """
    feet = [
        rectangle(
            leg,
            (x, 0, -0.2),
            [(0.05, 0, 0), (0, 0.05, 0)],
            (0, 0, 1),
            (1, 0, 0),
            friction=friction,
            most=2.0,
        )
        for leg, x in (("RF", 0.2), ("LF", 0.4))
    ]
    outcome = Exact(programs=programs, max_nodes=100).solve(problem_of(*feet))
    confirm(problem_of(*feet), outcome)
    assert outcome.status is Status.INFEASIBLE
    assert outcome.bound == pytest.approx(0.25, rel=1e-4)


@pytest.mark.parametrize(
    "scene", [("wall-3", 0), ("wall-3", 39), ("ground-3", 42), ("ground-3", 88)], ids=str
)
def test_scenes_with_one_foot_on_ice_are_decided(programs, drawn, scene):
    first, *others = drawn(*scene).contacts
    icy = replace(first, patch=replace(first.patch, friction=0.0))
    outcome = Exact(programs=programs, max_nodes=100).solve(
        drawn(*scene).posture_with(contacts=(icy, *others))
    )
    assert outcome.status is not Status.UNDECIDED


# ------------------------------------------------------------------------------------------------------
# many scenes


@pytest.mark.parametrize("scene", NATURAL, ids=str)
def test_it_finds_what_ipopt_finds_and_proves_the_rest(planner, drawn, scene):
    problem = drawn(*scene)
    outcome = planner.solve(problem)
    confirm(problem, outcome)
    assert outcome.status is not Status.UNDECIDED
    if Nlp().solve(problem).status is Status.FEASIBLE:
        assert outcome.status is Status.FEASIBLE


@pytest.mark.parametrize(
    "corners", [(4, 4, 4), (3, 4, 5), (4, 4), (6, 3, 4, 3), (5,), (3, 3, 3, 3, 3, 3)], ids=str
)
def test_quads_mixed_polygons_and_any_number_of_limbs_are_decided(planner, mixed, corners):
    nlp = Nlp(starts=2)
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
    assert sum(0.0 < outcome.bound < np.inf for outcome in outcomes) >= 3


# ------------------------------------------------------------------------------------------------------------
# limits


def test_at_the_node_limit_it_is_undecided(programs, planner, drawn):
    problem = drawn(*MANY_NODES)
    decided = planner.solve(problem)
    assert decided.status is Status.INFEASIBLE
    assert decided.details["nodes"] > 3
    assert len(decided.certificate.multipliers) > 2
    for limit in (0, 1):
        outcome = Exact(programs=programs, max_nodes=limit).solve(problem)
        confirm(problem, outcome)
        assert outcome.status is Status.UNDECIDED
        assert_names(outcome.message, "limit")
        assert outcome.bound == 0.0


def test_at_the_time_limit_it_is_undecided(programs, drawn):
    planner = Exact(programs=programs, time_limit_s=0.0)
    outcome = planner.solve(drawn("wall-3", 0))
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "limit")
    assert planner.solve(drawn("wall-3", 5)).status is Status.INFEASIBLE


def test_between_tolerance_and_gap_it_is_undecided(programs, planner, drawn):
    bound = planner.solve(drawn("wall-3", 5)).bound
    assert 1e-3 < bound < np.inf
    strict = Exact(programs=programs, acceptance=Acceptance(gap=1.9 * bound), max_nodes=40)
    outcome = strict.solve(drawn("wall-3", 5))
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "limit")
    loose = Exact(programs=programs, acceptance=Acceptance(gap=0.99 * bound))
    assert loose.solve(drawn("wall-3", 5)).status is Status.INFEASIBLE


def test_where_the_projection_does_not_arrive_the_search_goes_on(drawn, monkeypatch):
    scp, calls = cuts.scp, []

    def arrives_later(*given, **options):
        calls.append(options["worth"])
        point = scp(*given, **options)
        return replace(point, residual=1e-5) if len(calls) < 3 else point

    monkeypatch.setattr(cuts, "scp", arrives_later)
    problem = drawn("wall-3", 0)
    outcome = Exact().solve(problem)
    confirm(problem, outcome)
    assert outcome.status is Status.FEASIBLE
    assert (len(calls), outcome.details["nodes"]) == (3, 5.0)
    assert calls[0] == np.inf  # at the root SCP may take all its steps


def test_a_corner_given_twice_changes_nothing(planner, drawn):
    for scene in [MANY_NODES, ("ground-3", 86), ("wall-3", 0)]:
        problem = drawn(*scene)
        patches = [
            replace(c.patch, vertices_m=np.repeat(c.patch.vertices_m, [2, 1, 3], axis=0))
            for c in problem.contacts
        ]
        contacts = tuple(
            replace(c, patch=patch) for c, patch in zip(problem.contacts, patches, strict=True)
        )
        outcome = planner.solve(problem.posture_with(contacts=contacts))
        confirm(problem.posture_with(contacts=contacts), outcome)
        assert outcome.status is planner.solve(problem).status


# -------------------------------------------------------------------------------------------------------
# repeatable


def words(outcome):
    """Everything about an outcome but its time."""
    proof = outcome.certificate and outcome.certificate.to_json()
    posture = outcome.solution and outcome.solution.to_json()
    return (
        outcome.status,
        proof,
        posture,
        outcome.effort.solves,
        outcome.bound,
        dict(outcome.details),
    )


def test_it_answers_the_same_in_another_planner_and_after_other_problems(drawn, mixed):
    scenes = [MANY_NODES, ("wall-3", 0), ("wall-3", 5), (1, (3, 4, 5)), ("ground-3", 86)]
    alone = [words(Exact().solve(scene_of(drawn, mixed, scene))) for scene in scenes]
    one = Exact()
    for scene, expected in [*zip(scenes, alone, strict=True)][::-1] * 2:
        assert words(one.solve(scene_of(drawn, mixed, scene))) == expected


@pytest.mark.parametrize("force_n", [50.0, 200.0])
@pytest.mark.parametrize(("length_m", "away_m"), [(0.3, 0.0), (1e5, 0.0), (1e-5, 0.0), (1.0, 1e5)])
def test_the_answer_does_not_depend_on_units_and_place(planner, drawn, force_n, length_m, away_m):
    for scene in NATURAL:
        problem = drawn(*scene)
        ratio = problem.force_scale_n / force_n
        contacts = tuple(
            replace(
                c,
                force_min=c.force_min * ratio,
                force_max=c.force_max * ratio,
                patch=c.patch.with_vertices(c.patch.vertices_m + away_m),
            )
            for c in problem.contacts
        )
        scaled = problem.posture_with(
            force_scale_n=force_n,
            length_scale_m=length_m,
            contacts=contacts,
            com_nominal_m=problem.com_nominal_m[0] + away_m,
        )
        mine, theirs = planner.solve(problem), planner.solve(scaled)
        assert mine.status is theirs.status
        if mine.details["nodes"] == theirs.details["nodes"] == 1:
            nm = mine.bound * problem.moment_scale_nm
            assert theirs.bound * scaled.moment_scale_nm == pytest.approx(nm, rel=5e-5)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_scene_has_the_same_answer(planner, drawn, mixed, quarters):
    """Quarter turns about z, since the residual is the largest component and the tilt limit a
    box.
    """
    turn = np.linalg.matrix_power(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), quarters)

    def turned(contact):
        patch = contact.patch
        moved = {
            name: getattr(patch, name) @ turn.T
            for name in ("vertices_m", "normal", "shear_reference")
        }
        return replace(contact, patch=replace(patch, **moved), shoulder_m=turn @ contact.shoulder_m)

    for scene in [*NATURAL, *((seed, (3, 4, 5)) for seed in range(4))]:
        problem = scene_of(drawn, mixed, scene)
        contacts = tuple(turned(c) for c in problem.contacts)
        again = problem.posture_with(
            contacts=contacts, com_nominal_m=turn @ problem.com_nominal_m[0]
        )
        mine, theirs = planner.solve(problem), planner.solve(again)
        assert mine.status is theirs.status
        if mine.details["nodes"] == theirs.details["nodes"] == 1:
            assert theirs.bound == pytest.approx(mine.bound, rel=5e-5)


def test_huge_scales_in_a_file_buy_no_tolerance(programs, drawn):
    infeasible = 0
    for seed in range(12):
        plain = drawn("wall-3", seed)
        contacts = tuple(
            replace(c, force_min=c.force_min / 1000, force_max=c.force_max / 1000)
            for c in plain.contacts
        )
        huge = plain.posture_with(contacts=contacts, force_scale_n=98100.0, length_scale_m=600.0)
        truth = Exact(programs=programs).solve(plain).status
        infeasible += truth is Status.INFEASIBLE
        said = Exact(programs=programs, max_nodes=20).solve(huge).status
        assert said in (truth, Status.UNDECIDED)
    assert infeasible >= 3


# ----------------------------------------------------------------------------------------------------------
# courses


@pytest.fixture(scope="module")
def courses(programs):
    return Exact(programs=programs, time_limit_s=600.0)


def test_every_answer_carries_what_it_promises_and_the_lift_alone_would_not_have_closed_some(
    climb, courses, programs
):
    seen, cuts = set(), 0.0
    for seed in (0, 1, 2, 5):
        course = climb(seed)
        outcome = courses.solve(course)
        seen.add(outcome.status)
        if outcome.status is Status.FEASIBLE:
            assert check_plan(outcome.solution).accepted
            assert outcome.bound <= outcome.objective * (1.0 + 1e-6)
            assert outcome.claim == "optimal"
            assert outcome.objective - outcome.bound <= 1.1e-3 * outcome.objective
            assert TwoStage(programs=programs).solve(course).objective >= outcome.bound * (
                1.0 - 1e-6
            )
        else:
            assert check_certificate(outcome.certificate.of(course)).accepted
        cuts += outcome.details["cuts"]
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}
    assert cuts > 0


def test_with_one_frame_it_finds_what_the_posture_planner_finds(climb, courses, planner):
    seen = set()
    for seed in range(7):
        course = climb(seed, frames=1)
        ours = courses.solve(course)
        alone = planner.solve(course.posture_problem(course.stances[0], np.zeros(4, dtype=int)))
        if ours.status is Status.FEASIBLE:
            assert alone.status is Status.FEASIBLE
        if alone.status is Status.INFEASIBLE:
            assert ours.status is Status.INFEASIBLE
        seen.add((ours.status, alone.status))
    assert {(Status.FEASIBLE, Status.FEASIBLE), (Status.INFEASIBLE, Status.INFEASIBLE)} <= seen


def objective(programs, scaled):
    """The lift's bound on the objective."""
    return solve_lift(programs, scaled, least_moment=False).bound


def split(scaled, contact, axis, value):
    """Force boxes up to this value of a component, and from it on."""
    below, above = scaled.force_max.copy(), scaled.force_min.copy()
    below[contact, axis] = above[contact, axis] = value
    return scaled.with_force_box(scaled.force_min, below), scaled.with_force_box(
        above, scaled.force_max
    )


def test_parts_cover_the_course_and_never_lower_the_bound(climb, programs):
    whole = Scaled.of(climb(GAPPED[0]))
    root = objective(programs, whole)
    halves = [
        whole.with_piece(1, half) for half in cut(whole.pieces[1], *halving_chord(whole.pieces[1]))
    ]
    for parts in (split(whole, 0, 0, 0.3), split(whole, 4, 2, 0.1), halves):
        bounds = [objective(programs, part) for part in parts]
        assert min(bounds) >= root - 1e-7
        assert max(bounds) > min(bounds)
    areas = [
        _area(border) for border in (whole.pieces[1], halves[0].pieces[1], halves[1].pieces[1])
    ]
    assert areas[0] == pytest.approx(areas[1] + areas[2])


def _area(border: np.ndarray) -> float:
    fan = np.cross(border[1:-1] - border[0], border[2:] - border[0])
    return float(0.5 * np.linalg.norm(fan, axis=1).sum())


def test_a_box_of_no_size_about_a_plans_forces_makes_the_lift_exact(climb, programs):
    course = climb(GAPPED[1])
    outcome = TwoStage(programs=programs, gap=1e-4).solve(course)
    whole = part = Scaled.of(course)
    stance, limb, foothold = whole.layout.contacts
    forces = np.einsum(
        "bji,bj->bi",
        whole.frames[foothold],
        outcome.solution.forces_n[stance, limb] / course.weight_n,
    )
    for b, f in enumerate(forces):
        for axis in range(3):
            part = split(split(part, b, axis, f[axis] + 1e-4)[0], b, axis, f[axis] - 1e-4)[1]
    held, root = objective(programs, part), objective(programs, whole)
    unit = course.length_scale_m**2
    assert held * unit <= outcome.objective * (1.0 + 1e-4)
    assert held * unit >= outcome.objective * 0.99
    assert root * unit < outcome.objective * 0.9


def test_boxes_met_with_their_cones_change_no_bound(climb, programs):
    scaled = Scaled.of(climb(5, regions=2))
    grip = scaled.by_candidate(scaled.friction, 0.0).max(axis=1)[scaled.layout.contacts[2]]
    low, high = cones_met(scaled.force_min, scaled.force_max, grip)
    assert (high - low < scaled.force_max - scaled.force_min).any()
    met = scaled.with_force_box(low, high)
    assert objective(programs, met) == pytest.approx(objective(programs, scaled), rel=1e-5)


def test_at_its_limit_the_plan_stays_and_the_bound_says_how_far_it_may_be_off(climb, programs):
    outcome = Exact(programs=programs, max_nodes=3).solve(climb(GAPPED[1]))
    assert outcome.status is Status.FEASIBLE
    assert outcome.claim == ""
    assert_names(outcome.message, "3 nodes")
    assert outcome.bound < outcome.objective
    assert outcome.details["gap"] == pytest.approx(
        1.0 - outcome.bound / outcome.objective, rel=1e-6
    )


@pytest.mark.parametrize("seed", GAPPED)
def test_scip_finds_the_same_best_plan_and_its_bound_does_not_exclude_it(seed, climb, courses):
    course, outcome = climb(seed), courses.solve(climb(seed))
    best, bound = scip(course, nodes=NODES)
    assert bound <= outcome.objective * 1.002  # what SCIP proved does not exclude the plan
    assert best >= outcome.objective * (
        1.0 - 2e-3
    )  # nor does it find a better one; its tolerances are looser
    if np.isfinite(best):
        assert best >= outcome.bound * (1.0 - 1e-3)


def scip(course, *, nodes):
    """Best objective and bound [m²] that SCIP has for the true bilinear problem, written from the
    course's numbers.
    """
    model = pytest.importorskip("pyscipopt").Model()
    model.hideOutput()
    model.setParam("limits/nodes", nodes)
    model.setParam("limits/gap", 1e-3)

    def free(low, high):
        return [model.addVar(lb=float(a), ub=float(b)) for a, b in zip(low, high, strict=True)]

    def within(vector, radius):
        model.addCons(sum(x * x for x in vector) <= radius**2)

    def beyond(vector, least):
        if least > 0.0:
            model.addCons(sum(x * x for x in vector) >= least**2)

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    tilt, frames = course.tilt_limit_rad, range(course.frames)
    com = [
        free(
            course.com_nominal_m[k] - course.com_radius_m[k],
            course.com_nominal_m[k] + course.com_radius_m[k],
        )
        for k in frames
    ]
    turn = [free([-tilt] * 3, [tilt] * 3) for _ in frames]
    toes = []
    for put in course.footholds:
        corners = put.candidates[0].vertices_m
        share, toe = (
            free([0] * len(corners), [1] * len(corners)),
            free(corners.min(axis=0), corners.max(axis=0)),
        )
        model.addCons(sum(share) == 1)
        for j in range(3):
            model.addCons(
                sum(s * float(v) for s, v in zip(share, corners[:, j], strict=True)) == toe[j]
            )
        toes.append(toe)
    for k in frames:
        within(
            [com[k][j] - float(course.com_nominal_m[k][j]) for j in range(3)],
            float(course.com_radius_m[k]),
        )
        for i, limb in enumerate(course.robot.limbs):
            turned = cross(turn[k], [float(x) for x in limb.shoulder_m])
            toe = toes[course.holds[k, i]]
            within(
                [toe[j] - com[k][j] - float(limb.shoulder_m[j]) - turned[j] for j in range(3)],
                limb.reach_m,
            )
    for stance in course.stances:
        net, moment = [0.0, 0.0, -1.0], [-com[stance.frame][1], 1.0 * com[stance.frame][0], 0.0]
        for i in stance.limbs:
            p = course.holds[stance.frame, i]
            patch = course.footholds[p].candidates[0]
            f = free([0.0, -patch.friction, -patch.friction], [1.0, patch.friction, patch.friction])
            model.addCons(f[1] * f[1] + f[2] * f[2] <= patch.friction**2 * f[0] * f[0])
            world = [sum(float(patch.frame[j, a]) * f[a] for a in range(3)) for j in range(3)]
            net = [a + b for a, b in zip(net, world, strict=True)]
            moment = [a + b for a, b in zip(moment, cross(toes[p], world), strict=True)]
        for row in (*net, *moment):
            model.addCons(row == 0)
    weights, cost = course.weights, 0.0
    cost += weights.goal * sum((com[-1][j] - float(course.goal_m[j])) ** 2 for j in range(3))
    cost += weights.tilt * sum(x * x for row in turn for x in row)
    cost += weights.com_path * sum(
        (x - float(at)) ** 2
        for row, nominal in zip(com, course.com_nominal_m, strict=True)
        for x, at in zip(row, nominal, strict=True)
    )
    for k in range(1, course.frames):
        step = [com[k][j] - com[k - 1][j] for j in range(3)]
        within(step, course.steps.com_m)
        within([turn[k][j] - turn[k - 1][j] for j in range(3)], course.steps.rotation_rad)
        beyond([turn[k][j] - turn[k - 1][j] for j in range(3)], course.steps.least_rotation_rad)
        model.addCons(step[2] >= course.steps.progress_m)  # these courses lead straight up
        cost += weights.com_step * sum(x * x for x in step)
        for i in range(len(course.robot.limbs)):
            before, after = course.holds[k - 1, i], course.holds[k, i]
            if before != after:
                step = [toes[after][j] - toes[before][j] for j in range(3)]
                within(step, course.steps.toe_m)
                beyond(step, course.steps.least_toe_m)
                cost += weights.toe_step * sum(x * x for x in step)
    value = model.addVar(lb=0.0)
    model.addCons(cost <= value)
    model.setObjective(value)
    model.optimize()
    return model.getPrimalbound() if model.getNSols() else np.inf, model.getDualbound()
