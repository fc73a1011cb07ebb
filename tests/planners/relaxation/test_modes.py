"""Mode switching: z from boxes in world axes, against enumeration and against what the terrain
is.
"""

from __future__ import annotations

import itertools
from pathlib import Path

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
from stancekit.planners.search import enveloped
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.cuts import alone
from stancekit.planners.search.enveloped import EnvelopeSearch
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.two_stage import TwoStagePlanner
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
    return TwoStagePlanner(modes)


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
    outcome = TwoStagePlanner(modes).solve(course)
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
    outcomes = [ExactPlanner(programs=programs).solve(problem) for problem in problems]
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
    outcome = TwoStagePlanner(Modes(names=modes.names, boxes=boxes)).solve(
        read_course("walls", frames=2)
    )
    assert outcome.status is Status.UNDECIDED
    assert_names(outcome.message, "frame 0", "LF", "LR", "RM", "envelope")
