"""Guide paths against ways that are known in closed form, and what they say where there is none."""

import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.errors import NoPlace, PlanningFailed
from stancekit.planners.problem.guide_path import LATTICE_M, Footprint, guide_over, guide_path
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.families import Terrain
from stancekit.planners.terrain.heightfield import HeightField
from tests.refusals import refuses

HALF_M, HEIGHT_M, REACH_M = 0.3, 0.2, 0.5
TOES_M = np.array([[x, y, -HEIGHT_M] for x in (-HALF_M, HALF_M) for y in (-HALF_M, HALF_M)])
SQUARE_M = HALF_M * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def footprint() -> Footprint:
    """A square robot, 0.6 m wide."""
    return Footprint(
        toes_m=TOES_M,
        hull_m=SQUARE_M,
        low_m=-0.4 * HEIGHT_M,
        high_m=0.1,
        names=("LR", "RR", "LF", "RF"),
        reach_m=REACH_M,
    )


def patch(corners, normal, shear) -> Patch:
    """A surface of corners."""
    return Patch(
        vertices_m=np.array(corners, dtype=float),
        normal=normal,
        shear_reference=shear,
        friction=0.7,
    )


def floor(x0, x1, y0, y1, z=0.0) -> Patch:
    """A level surface that faces up."""
    return patch([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], (0, 0, 1), (1, 0, 0))


def box(x0, x1, y0, y1, z0, z1) -> list[Patch]:
    """The five surfaces of a box that are not its underside, and that where it is above the
    ground.
    """
    made = [
        floor(x0, x1, y0, y1, z1),
        patch([(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)], (-1, 0, 0), (0, 0, 1)),
        patch([(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)], (1, 0, 0), (0, 0, 1)),
        patch([(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)], (0, -1, 0), (0, 0, 1)),
        patch([(x0, y1, z0), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)], (0, 1, 0), (0, 0, 1)),
    ]
    if z0 > 0.0:
        made.append(
            patch([(x0, y0, z0), (x0, y1, z0), (x1, y1, z0), (x1, y0, z0)], (0, 0, -1), (1, 0, 0))
        )
    return made


def over(floors, *boxes) -> Terrain:
    """Floors, on which toes may stand, and boxes, on which none may."""
    solids = [each for one in boxes for each in box(*one)]
    return Terrain(
        patches=(*floors, *solids), footing=(*(True for _ in floors), *(False for _ in solids))
    )


def path(terrain, start, goal, avoid=()):
    """The guide path of the square robot."""
    return guide_path(terrain, footprint(), np.array([start, goal], dtype=float), avoid)


LEVEL = floor(-1, 5, -2.5, 2.5)


def test_nothing_in_the_way_is_a_straight_line():
    found = path(over([LEVEL]), (0, 0.3), (4, -0.2))
    assert len(found.points_m) == 2
    assert found.length_m == pytest.approx(math.hypot(4.0, 0.5))
    np.testing.assert_allclose(found.points_m[:, 2], HEIGHT_M)


def test_the_way_round_a_block_is_no_shorter_than_the_taut_one_and_not_much_longer():
    block = (1.8, 2.2, -0.8, 0.8, 0.0, 1.0)
    found = path(over([LEVEL], block), (0, 0), (4, 0))

    def taut(room):  # round the block grown by the square robot and so much room
        x, y = 1.8 - HALF_M - room, 0.8 + HALF_M + room
        return 2.0 * math.hypot(x, y) + (2.2 + HALF_M + room - x)

    assert taut(-LATTICE_M) <= found.length_m <= 1.05 * taut(0.18)  # its widest margin is 0.18 m
    for a, b in pairwise(found.points_m[:, :2]):
        for share in np.linspace(0.0, 1.0, 50):
            x, y = a + share * (b - a)
            assert not (1.8 - HALF_M < x < 2.2 + HALF_M and abs(y) < 0.8 + HALF_M)


@pytest.mark.parametrize("gap", [0.27, 0.3, 0.5, 0.53])
def test_a_gap_that_is_narrower_than_the_robot_is_named_with_its_place_and_width(gap):
    left, right = (1.9, 2.1, -2.5, -0.5 * gap, 0.0, 1.2), (1.9, 2.1, 0.5 * gap, 2.5, 0.0, 1.2)
    with refuses("(0, 0)", "(4, 0)", "wall", kind=PlanningFailed) as refused:
        path(over([LEVEL], left, right), (0, 0), (4, 0))
    message = str(refused.value)
    assert "1.2 m high: no way round within" in message
    width, widest = (
        float(part.split(" m")[0]) for part in message.split("the robot is ")[1].split("about ")
    )
    assert width == pytest.approx(0.6, abs=0.01)
    assert widest == pytest.approx(gap, abs=0.01)


def test_of_a_solid_the_near_side_is_named():
    wall = (1.9, 2.1, -2.5, 2.5, 0.0, 1.2)
    for start, near in (((0, 0), "(1.9,"), ((4, 0), "(2.1,")):
        with refuses(f"wall at {near}", kind=PlanningFailed):
            path(over([LEVEL], wall), start, (4 - start[0], 0))


def test_a_gap_that_is_wider_than_the_robot_is_gone_through():
    left, right = (1.9, 2.1, -2.5, 0.55, 0.0, 1.2), (1.9, 2.1, 1.45, 2.5, 0.0, 1.2)
    found = path(over([LEVEL], left, right), (0, 0), (4, 0))
    at = np.interp(2.0, found.points_m[:, 0], found.points_m[:, 1])
    assert 0.55 + HALF_M - LATTICE_M <= at <= 1.45 - HALF_M + LATTICE_M


def test_bars_are_gone_under_where_they_are_high_and_walls_where_they_are_low():
    high = path(over([LEVEL], (1.9, 2.0, -2.5, 2.5, 0.6, 0.7)), (0, 0), (4, 0))
    assert high.length_m == pytest.approx(4.0)
    with refuses("bar", "0.2 to 0.3 m", kind=PlanningFailed):
        path(over([LEVEL], (1.9, 2.0, -2.5, 2.5, 0.2, 0.3)), (0, 0), (4, 0))


def test_legs_that_stride_leave_the_way_of_the_trunk_alone_which_rises_as_far_as_they_are_long():
    trunk = replace(footprint(), trunk_m=0.5 * SQUARE_M, belly_m=-0.01)
    low, high = (over([LEVEL], (1.9, 2.0, -2.5, 2.5, 0.0, top)) for top in (0.409, 0.514))
    ends = np.array([[0.0, 0.0], [4.0, 0.0]])
    for ground in (low, over([floor(-1, 1.7, -2.5, 2.5), floor(2.25, 5, -2.5, 2.5)])):
        with pytest.raises(PlanningFailed):
            guide_path(ground, footprint(), ends)
        flat = guide_path(ground, trunk, ends, striding=True).points_m[:, :2]
        assert np.linalg.norm(np.diff(flat, axis=0), axis=1).sum() == pytest.approx(4, rel=0.01)
    with refuses("wall", "m high", kind=PlanningFailed):  # which the trunk does not get over
        guide_path(high, trunk, ends, striding=True)


@pytest.mark.parametrize(
    ("start", "goal", "name"), [((2, 0), (4, 0), "start"), ((0, 0), (2, 0), "goal")]
)
def test_a_start_or_goal_in_a_solid_is_refused_with_how_far_it_is_to_the_nearest_place(
    start, goal, name
):
    with refuses(name, "(2, 0)", kind=NoPlace) as refused:
        path(over([LEVEL], (1.8, 2.2, -0.8, 0.8, 0.0, 1.0)), start, goal)
    away = float(str(refused.value).split("nearest place to stand is ")[1].split(" m")[0])
    assert away == pytest.approx(0.2 + HALF_M, abs=2 * LATTICE_M)


def test_a_place_over_rails_on_which_feet_may_stand_is_a_question_however_high_they_are():
    rails = [floor(-1, 1, y, y + 0.2, 1.2) for y in (-0.3, 0.1)]
    sides = [(-1, 1, y, y + 0.2, 0.0, 1.2) for y in (-0.3, 0.1)]
    ground = over([LEVEL, *rails], *sides)
    for place in ((-0.3, 0.2), (0.3, -0.2)):
        with refuses("1.2 m", kind=NoPlace):  # of this planner: six feet hold on both rails
            path(ground, place, (0, 0))


def test_a_goal_off_the_terrain_says_how_far_it_is():
    with refuses("goal"):
        path(over([LEVEL]), (0, 0), (7, 0))


def test_a_goal_at_the_start_is_a_way_of_no_length():
    assert path(over([LEVEL]), (1, 1), (1, 1)).length_m == 0.0


@pytest.mark.parametrize("bottom", [[], [floor(1.5, 3.0, -2.5, 2.5, -3.0)]])
def test_a_trench_that_no_toe_crosses_is_named_with_its_edge_and_its_width_or_depth(bottom):
    banks = [floor(-1, 1.5, -2.5, 2.5), floor(3.0, 5, -2.5, 2.5), *bottom]
    said = ("3 m high",) if bottom else ("1.5 m wide",)
    with refuses("(1.5, ", *said, kind=PlanningFailed):
        path(over(banks), (0, 0), (4, 0))


def test_a_bridge_over_the_trench_is_taken():
    banks = [floor(-1, 1.5, -2.5, 2.5), floor(3.0, 5, -2.5, 2.5), floor(1.5, 3.0, 0.8, 2.5)]
    found = path(over(banks), (0, 0), (4, 0))
    middle = np.interp(2.25, found.points_m[:, 0], found.points_m[:, 1])
    assert middle > 0.8 + HALF_M - 0.35 * REACH_M - LATTICE_M


def test_another_way_is_taken_round_a_place_to_avoid():
    block = (1.8, 2.2, -0.8, 0.9, 0.0, 1.0)
    first = path(over([LEVEL], block), (0, 0), (4, 0))
    side = np.interp(2.0, first.points_m[:, 0], first.points_m[:, 1])
    other = path(over([LEVEL], block), (0, 0), (4, 0), [np.array([2.0, side])])
    assert np.sign(np.interp(2.0, other.points_m[:, 0], other.points_m[:, 1])) == -np.sign(side)


def test_the_same_question_has_the_same_answer():
    block = (1.8, 2.2, -0.8, 0.8, 0.0, 1.0)
    one, other = (path(over([LEVEL], block), (0, 0), (4, 0)) for _ in range(2))
    np.testing.assert_array_equal(one.points_m, other.points_m)


def profile(*points) -> Terrain:
    """Planes between points (x, z), on which toes may stand; upright ones are only in the way."""
    surfaces = []
    for (a, h), (b, g) in pairwise(points):
        corners = [(a, -2.5, h), (b, -2.5, g), (b, 2.5, g), (a, 2.5, h)]
        normal = np.array([h - g, 0.0, b - a]) / math.hypot(b - a, g - h)
        surfaces.append(patch(corners, normal, (0, 1, 0)))
    return Terrain(
        patches=tuple(surfaces), footing=tuple(each.normal[2] > 0.5 for each in surfaces)
    )


@pytest.mark.parametrize("degrees", [5, 12, 20, 25, 30, 33])
@pytest.mark.parametrize(
    "goal", [(1.5, 0.0), (-1.5, 0.0), (0.0, 1.2)], ids=["up", "down", "across"]
)
def test_a_plane_is_ground_however_steep_it_is(degrees, goal):
    k = math.tan(math.radians(degrees))
    found = path(profile((-3.0, -3.0 * k), (3.0, 3.0 * k)), (0, 0), goal)
    assert len(found.points_m) == 2
    np.testing.assert_allclose(
        found.points_m[:, 2] - k * found.points_m[:, 0], HEIGHT_M, atol=k * LATTICE_M
    )


@pytest.mark.parametrize("degrees", [12, 25, 30])
def test_a_ramp_between_two_flats_is_no_wall(degrees):
    top = 0.7 * math.tan(math.radians(degrees))
    terrain = profile((-1.5, 0.0), (0.4, 0.0), (1.1, top), (3.0, top))
    found = path(terrain, (0, 0), (2, 0))
    assert found.length_m < 1.2 * math.hypot(2.0, top)
    np.testing.assert_allclose(found.points_m[[0, -1], 2], [HEIGHT_M, top + HEIGHT_M], atol=1e-9)


def numbers(message: str, what: str) -> list[float]:
    """The numbers of the first part of a message that begins so."""
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?", message.split(what)[1])]


@pytest.mark.parametrize("degrees", [0, 15, 25])
def test_a_wall_on_a_slope_is_named_with_its_height_over_the_ground_there(degrees):
    k = math.tan(math.radians(degrees))
    slope = profile((-3.0, -3.0 * k), (5.0, 5.0 * k))
    wall = box(1.9, 2.1, -2.5, 2.5, -3.0 * k, 2.0 * k + 0.8)
    terrain = Terrain(
        patches=(*slope.patches, *wall), footing=(*slope.footing, *(False for _ in wall))
    )
    with pytest.raises(PlanningFailed) as refused:
        path(terrain, (0, 0), (4, 0))
    x, _, high, *_ = numbers(str(refused.value), "wall at ")
    assert x == pytest.approx(1.9, abs=0.01)
    assert high == pytest.approx(2.0 * k + 0.8 - 1.9 * k, abs=0.01)
    assert "widest gap" not in str(refused.value)


def test_two_toes_on_a_wall_make_no_slope():
    top = floor(1.0, 4.0, -2.5, 2.5, 1.0)
    side = patch([(1, -2.5, 0), (1, -2.5, 1), (1, 2.5, 1), (1, 2.5, 0)], (-1, 0, 0), (0, 0, 1))
    terrain = Terrain(patches=(LEVEL, side, top), footing=(True, False, True))
    with pytest.raises(PlanningFailed) as refused:
        path(terrain, (-0.4, 0), (3, 0))
    assert numbers(str(refused.value), "wall at ")[2] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("width", [0.1, 0.2])
def test_a_trench_that_toes_step_over_is_no_step_down_whether_it_has_a_bottom_or_not(width):
    end = 1.5 + width
    deep = profile((-1, 0), (1.5, 0), (1.5, -0.4), (end, -0.4), (end, 0), (5, 0))
    found = path(deep, (0, 0), (4, 0))
    open_below = path(over([floor(-1, 1.5, -2.5, 2.5), floor(end, 5, -2.5, 2.5)]), (0, 0), (4, 0))
    assert found.length_m == pytest.approx(open_below.length_m, rel=0.02)


def test_risers_that_the_legs_can_step_are_steps():
    levels = [(0.3 * k, 0.1 * k) for k in range(-4, 12)]
    stairs = [point for x, z in levels for point in ((x, z), (x + 0.3, z))]
    assert path(profile(*stairs), (0, 0), (2, 0)).length_m < 1.3 * math.hypot(2.0, 0.66)


@pytest.mark.parametrize("degrees", [0, 20, 30])
def test_walks_go_straight_up_a_slope_of_heights_and_are_barred_by_a_wall_on_it(degrees):
    k = math.tan(math.radians(degrees))
    x, y = np.linspace(-1.0, 5.0, 121), np.linspace(-1.0, 1.0, 41)
    ends = np.array([[0.0, 0.0], [4.0, 0.0]])

    def slope(wall):
        high = k * x + np.where(np.abs(x - 2.0) < 0.2, wall, 0.0)
        return HeightField(x_m=x, y_m=y, heights_m=high[:, None] + 0.0 * y)

    found, straight = guide_over(slope(0.0), footprint(), ends, 0.9)
    assert straight
    assert found.length_m == pytest.approx(4.0 * math.hypot(1.0, k), rel=0.01)
    with pytest.raises(PlanningFailed, match="wall at"):
        guide_over(slope(1.0), footprint(), ends, 0.9)


def heights(block: float) -> HeightField:
    """A floor with a block across most of it, so high."""
    x, y = np.linspace(-1.0, 5.0, 121), np.linspace(-2.5, 2.5, 101)
    inside = (np.abs(x - 2.0) < 0.2)[:, None] & (np.abs(y) < 0.8)[None]
    return HeightField(x_m=x, y_m=y, heights_m=np.where(inside, block, 0.0))


def test_walks_go_round_what_is_high_in_heights_and_straight_where_nothing_is():
    ends = np.array([[0.0, 0.0], [4.0, 0.0]])
    found, straight = guide_over(heights(1.0), footprint(), ends, 0.7)
    x, y = 1.8 - HALF_M, 0.8 + HALF_M
    taut = 2.0 * math.hypot(x, y) + 0.4 + 2.0 * HALF_M
    assert not straight
    assert 0.95 * taut <= found.length_m <= 1.2 * taut
    found, straight = guide_over(heights(0.0), footprint(), ends, 0.7)
    assert straight
    assert found.length_m == pytest.approx(4.0)


def test_walks_are_refused_at_a_wall_across_heights():
    x, y = np.linspace(-1.0, 5.0, 121), np.linspace(-1.0, 1.0, 41)
    wall = HeightField(
        x_m=x, y_m=y, heights_m=np.where(np.abs(x - 2.0) < 0.2, 1.0, 0.0)[:, None] + 0.0 * y
    )
    with refuses("(0, 0)", "(4, 0)", "wall", kind=PlanningFailed):
        guide_over(wall, footprint(), np.array([[0.0, 0.0], [4.0, 0.0]]), 0.7)


def test_heights_say_how_wide_the_widest_gap_is_where_the_robot_is_wider():
    x, y = np.linspace(-1.0, 5.0, 241), np.linspace(-1.5, 1.5, 121)
    wall = (np.abs(x - 2.0) < 0.2)[:, None] & (np.abs(y) > 0.2)[None]
    field = HeightField(x_m=x, y_m=y, heights_m=np.where(wall, 1.0, 0.0))
    with refuses("wall", kind=PlanningFailed) as refused:
        guide_over(field, footprint(), np.array([[0.0, 0.0], [4.0, 0.0]]), 0.7)
    gap = float(str(refused.value).rpartition("about ")[2].removesuffix(" m"))
    assert 0.4 - 3.0 * LATTICE_M <= gap <= 0.4 + LATTICE_M
