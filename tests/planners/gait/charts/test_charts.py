"""Charts: the warped one over the identity map is the ambient one; guesses and bad input."""

from collections.abc import Callable

import numpy as np
import pytest

from stancekit.planners.gait.charts.warped import Pushforward
from stancekit.planners.gait.gait_program import GaitProgram, formulate
from stancekit.planners.gait.method.guess import GuessedWalk
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Foot, Robot
from stancekit.planners.robot.walker import anymal, hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.spline_map import SplineMap, terrain_digest
from tests.refusals import refuses

Build = Callable[..., GaitProgram]


def identity(terrain: HeightField) -> SplineMap:
    """φ(x̄) = x̄ by its control points."""
    cells, spans = (8, 8, 4), (*terrain.domain_m, (0.0, 2.0))
    lines = [
        low + (high - low) / n * np.arange(-1.0, n + 2.0)
        for (low, high), n in zip(spans, cells, strict=True)
    ]
    control = np.stack(np.meshgrid(*lines, indexing="ij"))
    return SplineMap(
        domain_m=terrain.domain_m,
        height_m=2.0,
        control_m=control,
        terrain_digest=terrain_digest(terrain),
    )


@pytest.mark.parametrize("name", ["warped", "warped-exact"])
def test_the_warped_chart_over_the_identity_is_the_ambient_chart(name: str) -> None:
    level = HeightField.from_function(lambda x, y: 0.0 * x, 2.0, 0.25)
    task = Walk(
        robot=anymal(),
        terrain=level,
        start=np.zeros(2),
        goal=np.array([0.2, 0.1]),
        duration_s=2.0,
    )
    warped = formulate(task, GaitSettings(chart=name), warp=identity(level))  # type: ignore[arg-type]
    ambient = formulate(task, GaitSettings(chart="ambient"))
    x = warped.perturbed(np.random.default_rng(0))
    same = np.zeros(ambient.size)
    same[ambient.structure.layout.torso] = x[warped.structure.layout.torso]
    for here, there in zip(
        ambient.structure.layout.feet, warped.structure.layout.feet, strict=True
    ):
        same[here.stances[:, :2]] = x[there.stances[:, :2]]
        same[here.swings] = x[there.swings]
        for a, b in zip(here.forces, there.forces, strict=True):
            same[a[a >= 0]] = x[b[b >= 0]]
    found, wanted = warped.violations(x), ambient.violations(same)
    for term in ("dynamics", "reach", "cone", "goal", "still start"):
        assert found[term] == pytest.approx(wanted[term], abs=1e-9)
    assert wanted["dynamics"] > 0.01


def test_a_terrain_with_a_map_is_not_scaled(small: Build) -> None:
    level = HeightField.from_function(lambda x, y: 0.0 * x, 2.0, 0.25)
    task = Walk(robot=anymal(), terrain=level, start=[0, 0], goal=[0.2, 0.1], duration_s=2.0)
    program = formulate(task, GaitSettings(chart="warped-exact"), warp=identity(level))
    with refuses("height_factor"):
        program.solve(height_factor=0.5)
    with refuses("height_factor"):
        small().solve(height_factor=-1.0)


@pytest.mark.parametrize("chart", ["shear", "decoupled"])
def test_what_a_chart_pulls_back_it_pushes_forward(small: Build, chart: str) -> None:
    structure = small(chart=chart).structure
    rng = np.random.default_rng(0)
    feet, forces = rng.uniform(-1.0, 1.0, (5, 3)), rng.standard_normal((5, 3))
    bar = structure.chart.foot_bar(feet)
    push = Pushforward(structure.chart)
    p_i, f_i = push.foot(bar, structure.chart.force_bar(forces, bar))
    assert p_i == pytest.approx(feet, abs=1e-12)
    assert f_i == pytest.approx(forces, abs=1e-12)
    p, rotation = push.torso(np.column_stack([structure.chart.torso_bar(feet), np.zeros((5, 3))]))
    assert p == pytest.approx(feet, abs=1e-12)
    assert np.einsum("kji,kjl->kil", rotation, rotation) == pytest.approx(
        np.tile(np.eye(3), (5, 1, 1)), abs=1e-12
    )


def test_the_guess_on_a_slope_is_at_stand_height_from_it_with_feet_ahead_and_behind(
    small: Build,
) -> None:
    slope = HeightField.from_function(lambda x, y: 0.3 * x - 0.2 * y, 2.0, 0.25)
    structure = small(terrain=slope).structure
    walk = GuessedWalk(structure)
    normal = np.array([-0.3, 0.2, 1.0]) / np.sqrt(1.13)
    at, _ = walk.torso(structure.times_s)
    assert at @ normal == pytest.approx(np.full(len(at), structure.task.robot.stand_height_m))
    for number, foot in enumerate(structure.task.robot.feet):
        p, rotation = walk.torso(np.array([0.0, structure.task.duration_s]))
        arms = np.einsum("kji,kj->ki", rotation, walk.footholds(number)[[0, -1]] - p)
        assert np.all(((foot.reach_min_m < arms) & (arms < foot.reach_max_m))[:, :2])


def test_the_guess_stands_on_the_terrain_and_begins_and_ends_where_it_should(small: Build) -> None:
    for chart in ("ambient", "decoupled"):
        wrong = small(chart=chart).violations(small(chart=chart).guess)
        for term in ("contact", "swing", "goal", "start", "heading", "still start", "still end"):
            assert wrong.get(term, 0.0) < 1e-9, (chart, term)


def test_a_hexapod_walks_on_its_tripods(field: HeightField) -> None:
    task = Walk(
        robot=hexapod_walker(),
        terrain=field.scaled(0.3),
        start=np.zeros(2),
        goal=np.array([0.1, 0.0]),
        duration_s=2.0,
        gait="tripod",
    )
    assert formulate(task).solve().success


def test_a_hexapod_may_stand_wherever_its_boxes_hold_ground() -> None:
    ripple = reference_terrain("ripple")
    for goal in ([1.2, 0.0], [0.4, 0.4], [-2.0, 1.2]):
        assert (
            walk(robot=hexapod_walker(), terrain=ripple, gait="tripod", goal=goal).goal.tolist()
            == goal
        )


def walk(**changes: object) -> Walk:
    """A task on the steep pit, changed."""
    asked = {
        "robot": anymal(),
        "terrain": PIT,
        "start": [0.0, 0.0],
        "goal": [2.2, 0.0],
        **changes,
    }
    return Walk(**asked)  # type: ignore[arg-type]


PIT = reference_terrain("pit")
CLIFF = HeightField.from_function(lambda x, y: np.tanh(20.0 * (x - 1.3)), 4.0, 0.1, tolerance_m=1.0)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"goal": [3.9, 0.0]}, "goal"),
        ({"goal": [1.3, 0.0]}, "goal"),
        ({"terrain": CLIFF, "start": [1.15, 0.0]}, "start"),
        ({"goal": [np.nan, 0.0]}, "goal"),
        ({"gait": "moonwalk"}, "gait"),
        ({"adhesive": (True,)}, "adhesive"),
    ],
)
def test_bad_tasks_are_refused_in_one_line(changes: dict[str, object], name: str) -> None:
    with refuses(name):
        walk(**changes)


def test_robots_are_refused_for_what_no_body_has() -> None:
    foot = anymal().feet[0]
    with refuses("robot r", "inertia_kgm2"):
        Robot(
            name="r",
            mass_kg=1.0,
            inertia_kgm2=np.diag([1.0, 1.0, 3.0]),
            feet=anymal().feet,
            stand_height_m=0.4,
            trunk_half_m=[0.1, 0.1, 0.1],
        )
    with refuses("robot r", "trunk_half_m"):
        Robot(
            name="r",
            mass_kg=1.0,
            inertia_kgm2=np.eye(3),
            feet=anymal().feet,
            stand_height_m=0.4,
            trunk_half_m=[0.1, 0.0, 0.1],
        )
    with refuses("foot a", "reach_min_m", "reach_max_m"):
        Foot(
            name="a",
            nominal_m=foot.reach_max_m,
            reach_min_m=foot.reach_min_m,
            reach_max_m=foot.reach_max_m,
            hip_m=foot.hip_m,
        )
