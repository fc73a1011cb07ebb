"""Drawn courses: equal for equal seeds, within what was asked for, and climbable where that is
promised.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from stancekit.envs.distributions.courses import grips, icy_walls, perturbed
from stancekit.planners.answer.answer import Status
from stancekit.planners.problem.course_file import (
    builtin_courses,
    read_course,
    read_spec,
    spec_from,
)
from stancekit.planners.search.methods import PlannerOptions, make_planner
from tests.refusals import refuses


def text(course):
    return json.dumps(course.to_json())


@pytest.mark.parametrize("name", builtin_courses())
def test_perturbed_courses_repeat_with_the_seed_and_differ_without(name):
    first, again, other = (
        perturbed(name, np.random.default_rng(seed), frames=4) for seed in (0, 0, 1)
    )
    assert text(first) == text(again)
    assert text(first) != text(other)
    assert text(first) != text(read_course(name, frames=4))


@pytest.mark.parametrize("name", builtin_courses())
def test_perturbed_courses_keep_path_gait_and_robot(name):
    usual, drawn = read_course(name), perturbed(name, np.random.default_rng(3))
    np.testing.assert_array_equal(drawn.com_nominal_m, usual.com_nominal_m)
    assert (drawn.lifts, drawn.next_lift, drawn.steps) == (
        usual.lifts,
        usual.next_lift,
        usual.steps,
    )
    assert len(drawn.footholds) == len(usual.footholds)


@pytest.mark.parametrize("name", builtin_courses())
def test_every_stance_of_perturbed_courses_holds(name):
    planner, rng = (
        make_planner("exact", PlannerOptions(time_limit_s=10.0)),
        np.random.default_rng(7),
    )
    for course in [perturbed(name, rng) for _ in range(2)]:
        choice = [
            next(i for i, patch in enumerate(p.candidates) if patch.friction > 0.0)
            for p in course.footholds
        ]
        for stance in course.stances:
            assert planner.solve(course.posture_problem(stance, choice)).status is Status.FEASIBLE


def test_no_amount_changes_nothing():
    for name in ("stairs", "walls", "tube", "ground-to-wall"):
        drawn, usual = perturbed(name, np.random.default_rng(0), amount=0.0), read_course(name)
        assert len(drawn.terrain) == len(usual.terrain)
        for one, other in zip(drawn.terrain, usual.terrain, strict=True):
            np.testing.assert_allclose(one.vertices_m, other.vertices_m, atol=1e-12)
            assert one.friction == other.friction


def test_a_users_course_can_be_perturbed_too(tmp_path):
    floor = {"vertices_m": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "friction": 0.5}
    described = {
        "name": "floor",
        "frames": 3,
        "start_m": [0, 0, 0.2],
        "goal_m": [0.1, 0, 0.2],
        "terrain": {"kind": "polygons", "polygons": [floor]},
    }
    path = tmp_path / "floor.yaml"
    path.write_text(yaml.safe_dump(described))
    for course in (described, path):
        given = spec_from(course) if isinstance(course, dict) else course
        drawn = perturbed(given, np.random.default_rng(0))
        assert 0.4 <= drawn.terrain[0].friction < 0.5
        assert 0.0 < np.abs(drawn.terrain[0].vertices_m - floor["vertices_m"]).max() <= 0.01


@pytest.mark.parametrize("frames", [4, 8])
@pytest.mark.parametrize("regions", [2, 4])
def test_icy_walls_have_ice_at_random_and_the_nearest_panels_as_candidates(frames, regions):
    rng = np.random.default_rng(0)
    courses = [icy_walls(rng, frames, regions) for _ in range(5)]
    panels = np.array([patch.friction for course in courses for patch in course.terrain])
    assert set(panels.tolist()) == {0.0, 1.0}
    error = np.sqrt(0.25 / len(panels))
    assert abs(np.mean(panels == 0.0) - 0.5) < 4.0 * error
    assert {course.frames for course in courses} == {frames}
    assert {len(p.candidates) for course in courses for p in course.footholds} <= set(
        range(1, regions + 1)
    )
    assert max(len(p.candidates) for course in courses for p in course.footholds) == regions
    assert any(p.candidates[0].friction == 0.0 for course in courses for p in course.footholds)


def test_more_regions_give_more_courses_a_grip_everywhere():
    share = [
        np.mean([grips(icy_walls(np.random.default_rng(seed), 4, regions)) for seed in range(12)])
        for regions in (1, 2, 4)
    ]
    assert share == sorted(share)
    assert share[0] < 0.2 < share[2] < 1.0


def test_perturbed_icy_walls_offer_every_toe_a_grip():
    rng = np.random.default_rng(0)
    assert all(grips(perturbed("icy-walls", rng, frames=4)) for _ in range(5))


def test_walls_of_nothing_but_ice_are_given_up(monkeypatch):
    monkeypatch.setattr("stancekit.envs.distributions.courses.ICE", 1.0)
    monkeypatch.setattr("stancekit.envs.distributions.courses.REDRAWS", 3)
    with refuses("icy-walls"):
        perturbed("icy-walls", np.random.default_rng(0))


def test_a_chance_beyond_one_is_refused():
    with refuses("ice"):
        icy_walls(np.random.default_rng(0), ice=1.5)


def test_perturbing_does_not_touch_the_description():
    spec = read_spec("tube")
    before = spec.model_dump()
    perturbed(spec, np.random.default_rng(0))
    assert spec.model_dump() == before
