"""What the front door says to legal but odd calls: numbers of NumPy, two forms at once, settings
without a use.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit.planners.search.methods import make_planner
from tests.refusals import refuses

BLOCK = """v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
f 1 2 3
f 1 3 4
"""


def problem() -> stancekit.Problem:
    """One that has a posture."""
    return stancekit.sample("ground-3", rng=3)[0]


def level() -> stancekit.HeightField:
    """A square of 4 m."""
    return stancekit.HeightField.from_array(np.zeros((81, 81)), spacing_m=0.05)


def test_integers_of_numpy_are_integers(tmp_path):
    two: Any = np.int64(2)
    assert (
        stancekit.solve(problem(), stancekit.Micp(intervals=two)).status
        is stancekit.Status.FEASIBLE
    )
    assert stancekit.plan("stairs", frames=two).solution.com_m.shape == (2, 3)
    rows = stancekit.label("wall-3", tmp_path / "rows", rows=(two, two), seed=two)
    assert len(rows) == 4
    assert len(stancekit.label("wall-3", tmp_path / "natural", rows=two)) == 2


def test_a_grid_is_not_cut_finer_than_memory_allows():
    with refuses("intervals"):
        stancekit.Micp(intervals=2**20)


def test_settings_of_courses_are_refused_with_postures():
    for name, method in (
        ("gap", stancekit.Exact(gap=0.5)),
        ("gap", stancekit.Micp(gap=0.5)),
        ("envelope_use", stancekit.Micp(envelope_use="shrink")),
        ("projection", stancekit.Micp(projection="fix-p")),
        ("reserve", stancekit.TwoStage(reserve=False)),
    ):
        with refuses(name):
            stancekit.solve(problem(), method)


def test_a_planner_of_another_kind_of_question_is_refused():
    with refuses("method"):
        stancekit.solve(problem(), make_planner("decoupled", of="courses"))
    for name in ("nlp", "two-stage", "micp", "decoupled"):
        assert (
            stancekit.plan("stairs", make_planner(name, of="courses"), frames=2).status
            is stancekit.Status.FEASIBLE
        )


def test_a_course_is_solved_for_its_contacts_alone():
    course = stancekit.load("stairs")
    answer = stancekit.solve(stancekit.plan("stairs", frames=2).problem, "two-stage")
    assert answer.status is stancekit.Status.FEASIBLE
    assert (answer.report, answer.solution.joints_rad, len(answer.solution.com_m)) == (
        None,
        None,
        2,
    )
    with refuses("method"):
        stancekit.solve(course, "p1")


def test_one_planner_answers_postures_and_courses():
    made = make_planner("two-stage")
    assert stancekit.solve(problem(), made).status is not stancekit.Status.UNDECIDED
    found = stancekit.plan("stairs", made, frames=2)
    assert found.status is stancekit.Status.FEASIBLE
    assert made.solve(found.problem).status is stancekit.Status.FEASIBLE
    with refuses("method"):
        make_planner("decoupled").solve(problem())
    with refuses("gap"):
        make_planner("exact", gap=0.5).solve(problem())


def test_settings_of_a_plan_are_refused_where_they_are_none():
    for name, value in (
        ("body", 3),
        ("push_n", -1.0),
        ("push_n", "much"),
        ("wrench", (1.0, 2.0)),
        ("standing", 3),
        ("checkpoint", 3),
    ):
        with refuses(name):
            stancekit.PlanSettings(**{name: value})
    leap = "leap-hard:0"
    for settings in ({"push_n": 1.0}, {"standing": "map.npz"}, {"checkpoint": "c.json"}):
        with refuses(next(iter(settings))):
            stancekit.plan(leap, settings=stancekit.PlanSettings(**settings))


def test_places_are_arrays_or_numbers_that_are_sound():
    over = stancekit.terrain(level())
    found = stancekit.plan(
        over, start_xy_m=np.array([-0.3, 0.0]), goal_xy_m=np.array([0.3, 0.0]), frames=3
    )
    assert found.status is stancekit.Status.FEASIBLE
    for odd in ((1e300, 0.0), (0.0, 0.0, 0.0), (float("nan"), 0.0), np.array(["a", "b"])):
        with refuses("start_xy_m"):
            stancekit.plan(over, start_xy_m=odd, goal_xy_m=(0.3, 0.0))
        with refuses("goal_xy_m"):
            stancekit.walk(level(), odd)
    for count in (0, -1, 1001):
        with refuses("frames", str(count)):
            stancekit.plan(over, start_xy_m=(-0.3, 0), goal_xy_m=(0.3, 0), frames=count)


def test_a_terrain_says_what_it_lacks(tmp_path):
    mesh = Path(tmp_path / "block.obj")
    mesh.write_text(BLOCK, encoding="utf-8")
    with refuses("start_xy_m", "goal_xy_m"):
        stancekit.plan(mesh)
    over = stancekit.terrain(level(), friction=0.8)
    slick = replace(over.pieces[0], patch=over.pieces[0].patch.with_friction(0.1))
    between: dict[str, Any] = {"start_xy_m": (-0.3, 0.0), "goal_xy_m": (0.3, 0.0), "frames": 2}
    with refuses("friction", "0.1", "0.8"):
        stancekit.plan(replace(over, pieces=(*over.pieces, slick)), **between)
    with refuses("footholds"):
        stancekit.plan(replace(over, pieces=()), **between)
    rough = stancekit.terrain(level(), friction=20.0)
    with refuses("friction"):
        stancekit.plan(rough, **between)
    with refuses("unit_m"):
        stancekit.terrain(level(), unit_m=2.0)
    with refuses("unit_m"):
        stancekit.terrain("ripple", unit_m=2.0)
    assert (
        stancekit.terrain(level(), unit_m=1.0, kind=None).area_m2 == over.area_m2
    )  # as the command gives them


def test_a_robot_of_limbs_alone_is_no_robot_to_draw_problems_of():
    limbs = stancekit.hexapod().limbs
    four = stancekit.Robot(
        name="four", mass_kg=10.0, limbs=(limbs[0], limbs[2], limbs[3], limbs[5])
    )
    for law in ("ground-3", "wall-3"):
        with refuses("robot"):
            stancekit.sample(law, robot=four)


def test_a_log_is_named_as_one_before_anything_is_written(tmp_path):
    found = stancekit.plan("stairs", frames=2).solution
    assert found is not None
    stancekit.save(found, tmp_path / "plan.json")
    before = (tmp_path / "plan.json").read_bytes()
    with refuses("log"):
        stancekit.run(tmp_path / "plan.json", log=tmp_path / "plan.json")
    assert (tmp_path / "plan.json").read_bytes() == before


@pytest.mark.parametrize("name", ["stairs:0.1:7"])
def test_a_plan_goes_over_a_ground_by_its_name_as_over_its_footholds(name: str) -> None:
    between: dict[str, Any] = {"start_xy_m": (1.2, 0.0), "goal_xy_m": (1.5, 0.0)}
    found, same = (
        stancekit.plan(name, **between),
        stancekit.plan(stancekit.terrain(name), **between),
    )
    assert found.solution is not None
    assert same.solution is not None
    np.testing.assert_array_equal(found.solution.toes_m, same.solution.toes_m)
    assert isinstance(found.problem, stancekit.Problem)
    assert found.problem.name == name
