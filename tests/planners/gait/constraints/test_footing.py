"""Sure footing: where feet may stand, and which walks are asked to stand there."""

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.trajectory import OFF_M
from stancekit.planners.gait.constraints.feet import SHARE, slope_about, sure_xy
from stancekit.planners.gait.gait_program import GaitProgram, formulate, sure
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.heightfield import HeightField


def edge(height_m: float = 0.1, width_m: float = 0.06) -> HeightField:
    """A step up at x = .4, over so much way."""
    return HeightField.from_function(
        lambda x, y: height_m * np.clip((x - 0.4) / width_m + 0.5, 0.0, 1.0) + 0.0 * y,
        1.5,
        0.025,
        name="edge",
    )


def over(terrain: HeightField, adhesive: tuple[bool, ...] = ()) -> Walk:
    return Walk(
        robot=anymal(),
        terrain=terrain,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.3, 0.0]),
        duration_s=3.0,
        adhesive=adhesive,
    )


def stances(program: GaitProgram, x: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Where feet stand, seen from above, shape (K, 2) [m]."""
    entries = np.concatenate([foot.stances for foot in program.structure.layout.feet])
    return np.asarray(x[entries[:, :2]])


def test_slope_about_a_place_is_the_steepest_of_it_and_of_what_is_beside_it() -> None:
    terrain = edge()
    xy = np.array([0.4 - 0.03 - OFF_M, 0.0])
    alone = float(np.linalg.norm(terrain.gradient(xy)))
    about = [
        np.linalg.norm(terrain.gradient(xy + OFF_M * np.array(way)))
        for way in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    assert float(slope_about(terrain, xy)) == pytest.approx(max(alone, *map(float, about)))
    assert float(slope_about(terrain, xy)) > alone + 0.1


def test_a_place_moves_to_the_nearest_that_is_sure_and_stays_where_there_is_none() -> None:
    task, hill = (
        over(edge()),
        over(HeightField.from_function(lambda x, y: 0.7 * x + 0.0 * y, 1.5, 0.1)),
    )
    xy = np.array([[0.4, 0.1], [0.0, 0.0]])
    moved = sure_xy(task, SHARE, xy)
    assert np.all(slope_about(task.terrain, moved) <= SHARE * task.friction)
    assert moved[1].tolist() == [0.0, 0.0]
    assert 0.03 < np.linalg.norm(moved[0] - xy[0]) <= 0.12
    assert sure_xy(hill, SHARE, xy).tolist() == xy.tolist()


def test_walks_over_an_edge_are_asked_to_stand_sure_and_those_over_gentle_ground_and_up_a_steep_hill_are_not() -> (
    None
):
    settings = GaitSettings()
    gentle, hill = (
        HeightField.from_function(lambda x, y, a=a: a * x + 0.0 * y, 1.5, 0.1) for a in (0.2, 0.6)
    )
    assert sure(over(edge()), settings).footing == SHARE
    assert sure(over(edge()), replace(settings, footing=0.0)).footing == 0.0
    assert [sure(over(ground), settings).footing for ground in (gentle, hill)] == [0.0, 0.0]
    assert sure(over(edge(), (True,) * 4), settings).footing == 0.0
    for chart in ("decoupled", "ambient"):
        assert formulate(over(edge()), GaitSettings(chart=chart)).settings.footing == SHARE


@pytest.mark.parametrize("chart", ["decoupled", "ambient"])
def test_feet_of_a_walk_over_an_edge_stand_where_a_foot_that_is_off_holds_too(chart: str) -> None:
    task = over(edge())
    program = formulate(task, GaitSettings(chart=chart, footing=SHARE))
    found = program.solve()
    assert found.success
    assert (
        float(slope_about(task.terrain, stances(program, found.x)).max())
        <= SHARE * task.friction + 1e-3
    )
    plain = formulate(task, GaitSettings(chart=chart, footing=0.0))
    assert float(slope_about(task.terrain, stances(plain, plain.guess)).max()) > task.friction


def test_feet_that_stick_have_no_rows_and_nothing_is_asked_where_all_of_them_do() -> None:
    counts = []
    for sticks in (0, 2, 4):
        task = replace(
            over(edge()), adhesive=tuple(foot < sticks for foot in range(4)), suction_n=100.0
        )
        terms = {
            term.name: term.rows
            for term in formulate(task, GaitSettings(footing=SHARE)).nlp.constraints
        }
        counts.append(terms.get("footing", 0))
    assert counts[0] == 2 * counts[1] > counts[2] == 0
