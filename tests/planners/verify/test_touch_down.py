"""Toes find their footholds on grounds that are drawn from the certainty of the patches that they
stand on.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

import stancekit
from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of
from stancekit.planners.terrain.patch import Certainty, Patch
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.geometry import off_terrain, patch_distances
from stancekit.planners.verify.plans import ground_group


@pytest.fixture(scope="module")
def answer():
    heights = 0.01 * np.random.default_rng(0).standard_normal((101, 61))
    found = stancekit.terrain(stancekit.HeightField.from_array(heights, spacing_m=0.02))
    return stancekit.plan(found, start=[-0.2, 0.0], goal=[0.1, 0.0])


def with_certainty(plan, certainty):
    """The plan on patches with another certainty, on a terrain that says nothing of its own."""
    footholds = tuple(
        replace(put, candidates=tuple(patch.with_certainty(certainty) for patch in put.candidates))
        for put in plan.problem.footholds
    )
    terrain = tuple(patch.with_certainty(None) for patch in plan.problem.terrain)
    return replace(plan, problem=replace(plan.problem, footholds=footholds, terrain=terrain))


def of_another_hand(plan, toe_m, certainty=None, half_m=0.03):
    """The plan with its last toe at another place, on a square of its own there."""
    toes, last, put = plan.toes_m.copy(), len(plan.toes_m) - 1, plan.problem.footholds[-1]
    old = plan.problem.patch(last, plan.choice)
    toes[last] = toe_m
    corners = half_m * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ old.frame[:, 1:].T + toe_m
    square = Patch(
        vertices_m=corners,
        normal=old.normal,
        shear_reference=old.shear_reference,
        friction=old.friction,
        certainty=certainty,
    )
    footholds = (*plan.problem.footholds[:-1], replace(put, candidates=(square,)))
    choice = np.array(plan.choice)
    choice[last] = 0
    problem = replace(plan.problem, footholds=footholds)
    return replace(plan, problem=problem, toes_m=toes, choice=choice)


def beside_the_border(plan, out_m):
    """A place in the plane of the last toe's surface, so far outside of where its edge most likely is."""
    toe, terrain = plan.toes_m[-1], plan.problem.terrain
    i = min(
        range(len(terrain)),
        key=lambda i: float(patch_distances([terrain[i].vertices_m], toe[None])[0]),
    )
    patch = terrain[i]
    place = toe.copy()
    slope = -patch.normal[:2] / patch.normal[2]
    low, high = 0.0, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        place = toe + middle * np.array([0.0, 1.0, slope[1]])
        inside = float(patch_distances([patch.vertices_m], place[None])[0]) < 1e-9
        low, high = (middle, high) if inside else (low, middle)
    return place - (patch.certainty.wider_m - out_m) * np.array([0.0, 1.0, slope[1]])


def test_a_plan_over_a_noisy_map_has_the_group_and_its_file_keeps_it(answer, tmp_path):
    assert answer.report.accepted
    group = answer.report.group("ground")
    assert group.verdict == "holds"
    assert group.figures["found_share"] >= 0.95
    write_motion(tmp_path / "plan.json", answer.solution, answer.report)
    again = check_plan(read_motion(tmp_path / "plan.json")[0])
    assert again.group("ground").figures == group.figures


@pytest.mark.parametrize(("sd_m", "holds"), [(0.001, True), (0.005, True), (0.02, False)])
def test_a_ground_that_is_not_known_to_the_touch_down_is_refused(answer, sd_m, holds):
    sure = Certainty(about_m=[0.0, 0.0], covariance=np.diag([sd_m**2, 0.0, 0.0]), inset_m=0.02)
    group = ground_group(with_certainty(answer.solution, sure))
    assert (group.verdict == "holds") is holds
    assert group.figures["height_sd_m"] == pytest.approx(sd_m, rel=1e-3)


def test_exact_terrain_has_no_such_group(answer):
    assert ground_group(with_certainty(answer.solution, None)) is None


def test_the_border_that_bodies_keep_out_of_carries_no_toe_of_another_plan(answer):
    plan = answer.solution
    for out_m in (0.004, 0.012):
        report = check_plan(of_another_hand(plan, beside_the_border(plan, out_m)))
        assert report.group("terrain").value == pytest.approx(out_m, abs=1e-3)
        assert report.group("terrain").verdict == "violated"
    inside = check_plan(of_another_hand(plan, beside_the_border(plan, -0.05)))
    assert inside.group("terrain").verdict == "holds"


def test_a_plan_that_hides_how_unsure_its_ground_is_is_judged_by_the_terrain(answer):
    plan = answer.solution
    bare = tuple(
        replace(put, candidates=tuple(patch.with_certainty(None) for patch in put.candidates))
        for put in plan.problem.footholds
    )
    hidden = replace(plan, problem=replace(plan.problem, footholds=bare))
    assert check_plan(hidden).group("ground").verdict == "violated"
    last = plan.problem.patch(len(plan.toes_m) - 1, plan.choice)
    sure = replace(last.certainty, inset_m=9.0)  # far from its edges, it says
    group = ground_group(of_another_hand(plan, beside_the_border(plan, 0.0), sure))
    assert group.verdict == "violated"
    assert 0.3 < group.value < 0.7  # on the edge


@pytest.mark.parametrize("spacing_m", [0.02, 0.05])
def test_exact_maps_carry_toes_up_to_their_samples_and_bodies_keep_out_of_half_a_sample_more(
    spacing_m,
):
    heights = np.zeros((round(2.0 / spacing_m) + 1, round(1.2 / spacing_m) + 1))
    half_m = 0.5 * spacing_m * (heights.shape[1] - 1)
    found = stancekit.terrain(stancekit.HeightField.from_array(heights, spacing_m=spacing_m))
    plan = stancekit.plan(found, start=[-0.2, 0.0], goal=[0.1, 0.0]).solution
    for out_m, verdict in ((-0.002, "holds"), (0.003, "violated")):
        place = plan.toes_m[-1] * [1.0, 0.0, 1.0] + [0.0, half_m + out_m, 0.0]
        report = check_plan(of_another_hand(plan, place, half_m=0.001))
        assert report.group("terrain").verdict == verdict


@pytest.mark.parametrize("spacing_m", [0.1, 0.29, 0.31, 0.5, 1.0])
def test_a_flat_map_carries_toes_up_to_its_outermost_samples_at_any_spacing(spacing_m):
    x_m = spacing_m * np.arange(-4, 5)
    ground = ElevationMap(x_m=x_m, y_m=x_m, heights_m=np.zeros((9, 9)), name="flat")
    footholds = footholds_of(ground)
    patch, places_m = footholds.pieces[0].patch, x_m[-1] * np.array([0.0, 0.5, 0.99, 1.01, 1.2])
    toes = np.stack([places_m, np.zeros(5), np.zeros(5)], axis=1)
    off_m = off_terrain(footholds.surfaces, [patch] * 5, toes)
    assert (off_m == 0.0).tolist() == [True, True, True, False, False]


def test_a_block_in_a_maps_corner_ends_where_it_ends():
    x, heights = 0.02 * np.arange(50), np.zeros((50, 50))
    heights[:20, :20] = 0.1  # the ground's box of cells has the same corner
    found = footholds_of(
        ElevationMap(x_m=x, y_m=x, heights_m=heights, name="block"),
        FootholdLimits(margin_m=0.012, width_m=0.012),
    )
    tops = [piece.patch for piece in found.pieces if piece.patch.vertices_m[:, 2].min() > 0.09]
    toes = np.array([[x[19] + out, 0.25, 0.1] for out in (-0.001, 0.005, 0.02)])
    assert off_terrain(found.surfaces, tops[:1] * 3, toes) == pytest.approx(
        [0.0, 0.005, 0.02], abs=1e-6
    )


def ground_without(places, gone, bottom_m):
    """The footholds of a grid of places in a plane, some of which are so much higher."""
    heights = places[..., 2] + np.where(gone, bottom_m, 0.0)
    x_m, y_m = places[:, 0, 0], places[0, :, 1]
    return footholds_of(ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="with gaps"))


GAPS = {
    "through": lambda x, y: x == 0,
    "slit": lambda x, y: (x == 0) & (abs(y) < 9),
    "cell": lambda x, y: (x == 0) & (y == 0),
    "square": lambda x, y: (x >= 0) & (x < 2) & (y >= 0) & (y < 2),
    "corner": lambda x, y: np.where(x > y, y == 0, x == 0) & (x >= 0) & (y >= 0) & (x + y < 9),
    "turned": lambda x, y: (abs(x - 0.577 * y) < 0.6) & (abs(y) < 9),
}


@pytest.mark.parametrize(
    ("bottom_m", "slope"),
    [(-0.5, 0.2), (np.nan, 0.0), (0.08, 0.2)],
    ids=["deep", "unknown", "raised"],
)
@pytest.mark.parametrize("gap", GAPS.values(), ids=GAPS)
def test_nothing_carries_a_toe_where_a_sample_is_not_of_its_surface(gap, bottom_m, slope):
    x, y = np.mgrid[-16:17, -16:17]
    places, gone = 0.05 * np.stack([x, y, slope * x], axis=-1), gap(x, y)
    found = ground_without(places, gone, bottom_m)
    toe = max(found.pieces, key=lambda piece: piece.area_m2).patch
    beside = np.outer((-0.075, -0.051, -0.035, -0.025), (1.0, 0.0, slope))
    sound = places[binary_erosion(~gone, np.ones((3, 3)))]
    toes = np.concatenate([places[gone], beside, sound])
    off = off_terrain(found.surfaces, [toe] * len(toes), toes)
    hollow = np.count_nonzero(gone)
    held = [hollow, hollow + 1, *range(hollow + 4, len(toes))]
    assert np.flatnonzero(off <= 0.0).tolist() == held
    assert off[:hollow].min() > 0.008


def test_nothing_carries_a_toe_beyond_a_turned_sheet():
    x, y = np.mgrid[-10:10, -10:10]
    gone = (abs(0.866 * x + 0.5 * y) >= 9.0) | (abs(0.5 * x - 0.866 * y) >= 8.0)
    places = 0.05 * np.stack([x, y, 0 * x], axis=-1)
    found = ground_without(places, gone, np.nan)
    off = off_terrain(found.surfaces, [found.pieces[0].patch] * gone.sum(), places[gone])
    assert off.min() > 0.03
