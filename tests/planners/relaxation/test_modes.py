"""Mode switching: z from boxes in world axes, against enumeration and against what the terrain
is.
"""

from __future__ import annotations

import itertools
from itertools import combinations_with_replacement
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

import stancekit
from stancekit.envs.distributions.courses import perturbed
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course, read_spec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.relaxation.boxes import Modes, composed, modes_of_frames, world_points
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick, domain_of
from stancekit.planners.relaxation.micp import (
    KNOTS,
    axes_of,
    cell_error,
    meet,
    of_several_frames,
    planes,
    unit_domain,
    without_squares,
)
from stancekit.planners.relaxation.papers import (
    Breaks,
    Cells,
    ContactForces,
    PlanVariables,
    neighbouring,
)
from stancekit.planners.search import enveloped
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.cuts import alone
from stancekit.planners.search.enveloped import EnvelopeSearch
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage
from tests.refusals import assert_names, refuses

SHORT = read_spec("ground-to-wall").model_copy(
    update={"start_m": (0.2, 0, 0.2), "goal_m": (0.25, 0, 0.4), "frames": 6}
)
"""The part about the switch."""


@pytest.fixture(scope="module")
def modes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modes")
    names = ("ground-3", "wall-3")
    return stancekit.fit(
        [stancekit.label(name, folder / name, rows=(120, 0)) for name in names], "modes"
    )


@pytest.fixture(scope="module")
def planner(modes):
    return TwoStage(envelopes=modes)


@pytest.fixture(scope="module")
def small():
    """A small climb, two boxes over it that cost something, and P1 with each of their eight
    choices.
    """
    course = read_course("walls", frames=2)
    scaled = Scaled.of(course)
    domain = domain_of(scaled, "world")
    boxes = []
    for axis, room in (
        (0, 0.08),
        (2, 0.08),
    ):  # the body kept back, or kept down: off the goal either way
        low = domain.low.copy()
        low[:, axis] = domain.high[:, axis] - room
        boxes.append(Envelope(low=low, high=domain.high))
    single = McCormick(scaled.layout, "world", False)
    assert len(scaled.layout.stances) == 3
    choices = {
        z: single.solve(scaled, composed(scaled.layout, boxes, np.array(z)))
        for z in itertools.product((0, 1), repeat=3)
    }
    return course, scaled, tuple(boxes), choices


@pytest.mark.parametrize("seed", [None, 1])
def test_z_switches_where_the_terrain_does(seed, planner):
    course = (
        build_course(SHORT, Path())
        if seed is None
        else perturbed(SHORT, np.random.default_rng(seed))
    )
    outcome = planner.solve(course)
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert tuple(outcome.solution.modes) == course.modes
    assert set(course.modes) == {0, 1}
    assert outcome.details["open_stances"] == 0.0  # no stance could have used the other envelope


@pytest.mark.parametrize(("name", "mode"), [("stairs", 0), ("walls", 1)])
def test_z_does_not_switch_where_the_terrain_does_not(name, mode, planner):
    outcome = planner.solve(read_course(name, frames=3))
    assert outcome.status is Status.FEASIBLE, outcome.message
    assert outcome.solution.modes.tolist() == [mode] * 3


def test_the_envelopes_of_ground_and_wall_exclude_each_other(modes):
    ground, wall = modes.boxes.envelopes
    assert modes.names == ("ground", "wall")
    assert np.any((ground.high < wall.low) | (wall.high < ground.low))


def test_the_hull_with_every_choice_made_is_p1_over_the_chosen_boxes(small):
    _, scaled, boxes, choices = small
    hull = McCormick(scaled.layout, "world", False, 2)
    for z, single in choices.items():
        answer = hull.solve_hull(scaled, boxes, np.eye(2)[list(z)])
        assert (answer.known, answer.feasible) == (True, single.feasible)
        if single.feasible:
            assert answer.objective == pytest.approx(single.objective, abs=1e-6)
            np.testing.assert_allclose(answer.modes, np.eye(2)[list(z)], atol=1e-6)


def test_the_hull_bounds_every_choice_and_the_search_finds_the_best(small, modes, monkeypatch):
    course, scaled, boxes, choices = small
    solved = {z: answer.objective for z, answer in choices.items() if answer.feasible}
    assert len(solved) > 1
    best = min(solved.values())
    assert max(solved.values()) > best + 1e-5  # it matters which
    hull = McCormick(scaled.layout, "world", False, 2)
    assert hull.solve_hull(scaled, boxes, np.ones((3, 2))).objective <= best + 1e-6

    class Given(EnvelopeSearch):
        def __init__(self, *args, **settings):
            super().__init__(*args, **settings)
            self.boxes = boxes

    monkeypatch.setattr(enveloped, "EnvelopeSearch", Given)
    outcome = TwoStage(envelopes=modes).solve(course)
    assert outcome.status is Status.FEASIBLE
    length = scaled.length_m
    assert outcome.details["p1_objective"] / length**2 == pytest.approx(best, rel=2e-4, abs=2e-8)


def test_a_stance_alone_relaxes_the_course(small):
    _, scaled, boxes, choices = small
    assert any(answer.feasible for answer in choices.values())
    for stance in range(3):
        part, _, rows = alone(scaled, stance)
        model = McCormick(part.layout, "world", False)
        for e in (0, 1):
            box = Envelope(low=boxes[e].low[rows], high=boxes[e].high[rows])
            if np.isposinf(model.solve(part, box).margin):
                assert not any(answer.feasible for z, answer in choices.items() if z[stance] == e)


def test_closing_boxes_leaves_what_a_stance_can_use(programs, modes):
    course = build_course(SHORT, Path())
    scaled = Scaled.of(course)
    allowed = EnvelopeSearch(programs, course, modes, Clock.start()).allowed()
    wanted = [course.modes[frame] for frame, _ in scaled.layout.stances]
    carried = [
        all(abs(_normal(course, stance, limb)[2]) > 0.7 for limb in stance.limbs)
        for stance in course.stances
    ]
    np.testing.assert_array_equal(allowed.argmax(axis=1), 1 - np.array(carried))
    assert modes_of_frames(scaled.layout, allowed.argmax(axis=1)).tolist() == list(course.modes)
    assert (
        wanted != (1 - np.array(carried)).tolist()
    )  # at the switch one stance still stands on the ground


def _normal(course, stance, limb):
    return course.footholds[course.holds[stance.frame, limb]].candidates[0].normal


def test_world_points_are_the_forces_of_the_postures(programs, drawn):
    problems = [drawn("wall-3", seed) for seed in range(12)]
    outcomes = [Exact(programs=programs).solve(problem) for problem in problems]
    found = [
        (p, o.solution) for p, o in zip(problems, outcomes, strict=True) if o.solution is not None
    ]
    assert found
    points = np.array([Scaled.of(problem).point(posture) for problem, posture in found])
    turned = world_points([problem for problem, _ in found], points)
    for row, (problem, posture) in zip(turned, found, strict=True):
        np.testing.assert_allclose(row[:, 3:] * problem.weight_n, posture.forces_n[0], atol=1e-9)
        np.testing.assert_allclose(row[:, 3:].sum(axis=0), [0.0, 0.0, 1.0], atol=1e-6)


def test_modes_come_back_from_json_and_say_what_is_wrong_with_others(modes):
    again = Modes.from_json(modes.to_json())
    assert again.names == modes.names
    for mine, theirs in zip(modes.boxes.envelopes, again.boxes.envelopes, strict=True):
        np.testing.assert_array_equal(mine.to_vector(), theirs.to_vector())
    with refuses("format"):
        Modes.from_json(modes.boxes.to_json())
    with refuses("names"):
        Modes.from_json(modes.to_json() | {"names": ["ground"]})
    with refuses("boxes.force_scale_n"):
        Modes.from_json(
            modes.to_json() | {"boxes": modes.boxes.to_json() | {"force_scale_n": -1.0}}
        )


def test_boxes_that_no_stance_can_use_are_reported_for_the_stance(modes):
    far = Envelope(low=modes.boxes.envelopes[0].low + 5.0, high=modes.boxes.envelopes[0].high + 5.0)
    boxes = type(modes.boxes)(**{**vars(modes.boxes), "envelopes": (far, far)})
    outcome = TwoStage(envelopes=Modes(names=modes.names, boxes=boxes)).solve(
        read_course("walls", frames=2)
    )
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "frame 0", "LF", "LR", "RM", "envelope")


@pytest.mark.parametrize("count", [4, 8])
def test_weight_goes_to_two_neighbours_only(count):
    weights, wanted = cp.Variable((1, count + 1), nonneg=True), cp.Parameter(count + 1)
    most = cp.Problem(
        cp.Maximize(cp.min(weights[0] - wanted)),
        [cp.sum(weights) == 1, *neighbouring(weights)],
    )
    for a, b in combinations_with_replacement(range(count + 1), 2):
        wanted.value = 0.5 * (np.eye(count + 1)[a] + np.eye(count + 1)[b])
        most.solve(solver=cp.HIGHS)
        assert (most.value > -1e-6) == (b - a <= 1)


def test_over_a_cell_the_products_reach_as_far_as_the_four_planes_of_mccormick():
    domain = Envelope(
        low=[[-1.0, 0.0, 0.2, -0.5, 0.1, -1.0]], high=[[1.0, 0.8, 0.6, 0.7, 0.9, 1.0]]
    )
    cells = Cells(Breaks.of(domain, 2))
    parts = cp.Variable((1, 3)), cp.Variable((1, 3)), cp.Variable((1, 9))
    rng, terms = np.random.default_rng(0), cells.terms(*parts).values()
    for _ in range(6):
        at = domain.low[0] + rng.random(6) * (domain.high - domain.low)[0]
        j, k = rng.integers(3, size=2)
        held = [parts[0][0, j] == at[j], parts[1][0, k] == at[3 + k]]
        ends = []
        for index in (j, 3 + k):  # of the cell that it is in
            cuts = np.linspace(domain.low[0, index], domain.high[0, index], 3)
            cell = int(np.clip(np.searchsorted(cuts, at[index]) - 1, 0, 1))
            ends.append((cuts[cell], cuts[cell + 1], at[index]))
        (p_low, p_high, p), (f_low, f_high, f) = ends
        least = max(
            p_low * f + f_low * p - p_low * f_low, p_high * f + f_high * p - p_high * f_high
        )
        most = min(p_low * f + f_high * p - p_low * f_high, p_high * f + f_low * p - p_high * f_low)
        for goal, expected in ((cp.Minimize, least), (cp.Maximize, most)):
            problem = cp.Problem(goal(parts[2][0, 3 * j + k]), [*terms, *held])
            assert problem.solve(solver=cp.HIGHS) == pytest.approx(expected, abs=1e-6)
    sides = (domain.high - domain.low)[0] / 2.0
    assert cell_error(domain, 2) == pytest.approx(sides[:3].max() * sides[3:].max() / 4.0)


def test_tangent_planes_lie_around_the_cones_and_close_to_them(drawn):
    rng = np.random.default_rng(0)
    ball, direction = cp.Variable(3), cp.Parameter(3)
    reach = cp.Problem(cp.Maximize(direction @ ball), planes(cp.SOC(cp.Constant(2.0), ball)))
    scaled = Scaled.of(drawn("wall-3", 0))
    forces = ContactForces.of_candidates(PlanVariables(scaled))
    rows = [*planes(forces.in_cones()["cone"]), forces.forces[:, 0] <= 1.0]
    push = cp.Parameter(2)
    friction = cp.Problem(cp.Maximize(forces.forces[0, 1:] @ push), rows)
    for _ in range(30):
        direction.value = rng.normal(size=3)
        assert (
            1.0 - 1e-7
            <= reach.solve(solver=cp.HIGHS) / (2.0 * np.linalg.norm(direction.value))
            <= 1.041
        )
        push.value = rng.normal(size=2)
        most = scaled.friction[0] * np.linalg.norm(push.value)
        assert 1.0 - 1e-7 <= friction.solve(solver=cp.HIGHS) / most <= 1.02


@pytest.mark.parametrize("axis", [0, 1])
def test_planes_stand_around_cones(axis):
    rng = np.random.default_rng(0)
    for size in (2, 3):
        radius, vectors = cp.Variable(40), cp.Variable((size, 40) if axis == 0 else (40, size))
        rows = planes(cp.SOC(radius, vectors, axis=axis))
        vectors_at = rng.normal(size=vectors.shape)
        norm = np.linalg.norm(vectors_at, axis=axis)
        for share, inside in ((1.0, True), (0.96, False)):
            held = [radius == share * norm, vectors == vectors_at]
            problem = cp.Problem(cp.Minimize(0), [*held, *rows])
            problem.solve(solver=cp.CLARABEL)
            assert (problem.status == cp.OPTIMAL) == inside, (size, share)


def test_other_constraints_stay_as_they_are():
    row = cp.Variable() <= 1.0
    assert list(planes(row)) == [row]


def test_tangents_are_below_squares_and_close():
    rng = np.random.default_rng(1)
    line = cp.Variable((4, 3))
    cost = 2.0 * cp.sum_squares(line) + 0.5 * cp.sum_squares(line[1:] - line[:-1])
    linear, rows = without_squares(cost)
    assert KNOTS[0] == 0.0
    for _ in range(5):
        at = rng.uniform(-0.17, 0.17, (4, 3))  # differences up to .34
        problem = cp.Problem(cp.Minimize(linear), [*rows, line == at])
        problem.solve(solver=cp.HIGHS)
        exact = 2.0 * np.sum(at**2) + 0.5 * np.sum(np.diff(at, axis=0) ** 2)
        assert exact - 0.0025 * (2.0 * 12 + 0.5 * 9) <= problem.value <= exact + 1e-9


def test_candidates_of_one_frame_are_measured_in_it_and_others_in_the_world(ragged):
    assert axes_of(Scaled.of(read_course("icy-walls", frames=2))) == "contact"
    assert axes_of(Scaled.of(ragged(0, candidates=1))) == "contact"
    scaled = Scaled.of(ragged(2, candidates=3))
    assert axes_of(scaled) == "world"
    footholds = scaled.layout.contacts[2][of_several_frames(scaled)]
    assert all(len(scaled.layout.corners[p]) > 1 for p in footholds)


def test_of_two_boxes_the_common_part_is_left_or_the_gap():
    first, second = (
        Envelope(low=np.full((1, 6), low), high=np.full((1, 6), low + 1.0)) for low in (0.0, 0.5)
    )
    np.testing.assert_array_equal(meet(first, second).low, np.full((1, 6), 0.5))
    np.testing.assert_array_equal(meet(first, second).high, np.ones((1, 6)))
    apart = Envelope(low=np.full((1, 6), 2.0), high=np.full((1, 6), 3.0))
    np.testing.assert_array_equal(meet(first, apart).high, np.full((1, 6), 2.0))


def test_the_domain_in_world_axes_holds_that_in_contact_frames(ragged, drawn):
    for scaled in (Scaled.of(drawn("wall-5", 3)), Scaled.of(ragged(1, candidates=1))):
        frames, rng = scaled.contact_frames, np.random.default_rng(0)
        contact, world = domain_of(scaled, "contact"), domain_of(scaled, "world")
        np.testing.assert_array_equal(contact.low[:, :3], world.low[:, :3])
        low, high = contact.force
        for _ in range(20):
            forces = np.einsum("bij,bj->bi", frames, low + rng.random(low.shape) * (high - low))
            assert np.all(forces >= world.force[0] - 1e-12)
            assert np.all(forces <= world.force[1] + 1e-12)
        assert unit_domain(scaled).low.shape == contact.low.shape
