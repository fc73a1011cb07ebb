"""Footholds are where one may stand: free above, outside of solids, flat; of broken meshes and
noisy maps as well.
"""

from itertools import pairwise

import numpy as np
import pytest

import stancekit
from stancekit import Status
from stancekit.planners.errors import NoPlace
from stancekit.planners.problem.course_between import course_between
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.problem.course_terrain import FileTerrain
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, footholds_of, read_footholds
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.terrain.polygon import surface_patch
from stancekit.planners.terrain.triangle_mesh import TriangleMesh
from tests.refusals import refuses

trimesh = pytest.importorskip("trimesh")
PLAIN = FootholdLimits(margin_m=0.0, width_m=1e-3)


def block(x, y, bottom, top):
    return trimesh.creation.box(bounds=[[x[0], y[0], bottom], [x[1], y[1], top]])


def saved(path, *meshes):
    trimesh.util.concatenate(meshes).export(path)
    return path


def test_places_inside_and_under_other_solids_are_none(tmp_path):
    floor = block((-2.0, 2.0), (-1.0, 1.0), -0.2, 0.0)
    standing = block((-1.5, -0.5), (-0.5, 0.5), -0.1, 0.6)  # half in the floor
    low = block((0.5, 1.5), (-0.5, 0.5), 0.05, 0.6)  # a gap lower than the clearance under it
    found = read_footholds(saved(tmp_path / "m.stl", floor, standing, low), limits=PLAIN)
    assert found.area_m2 == pytest.approx(8.0, rel=1e-4)  # the floor without both, and their tops
    assert found.refused_m2["inside"] == pytest.approx(1.0, rel=1e-4)
    assert found.refused_m2["covered"] == pytest.approx(1.0, rel=1e-4)
    high = block((0.5, 1.5), (-0.5, 0.5), 0.15, 0.6)
    assert read_footholds(
        saved(tmp_path / "h.stl", floor, standing, high), limits=PLAIN
    ).area_m2 == pytest.approx(9.0)


def test_a_sheet_that_is_there_from_both_sides_has_one_surface_and_stacked_boxes_keep_all_of_theirs(
    tmp_path,
):
    corners = np.array([[0.0, 0.0, 0.1], [2.0, 0.0, 0.1], [2.0, 1.0, 0.3], [0.0, 1.0, 0.3]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0]])
    sheet = trimesh.Trimesh(corners, faces, process=False)
    found = read_footholds(saved(tmp_path / "s.ply", sheet), limits=PLAIN)
    assert found.area_m2 == pytest.approx(2.0 * np.hypot(1.0, 0.2))
    assert all(patch.normal[2] > 0.0 for patch in found.surfaces)
    boxes = block((0.0, 1.0), (0.0, 1.0), 0.0, 0.5), block((0.2, 0.8), (0.2, 0.8), 0.5, 1.0)
    stacked = read_footholds(saved(tmp_path / "b.stl", *boxes), limits=PLAIN)
    assert sum("body" in name for name, _ in Obstacles.of(stacked.surfaces).convex) == 2


def test_a_box_without_a_bottom_hides_the_ground_under_it(tmp_path):
    floor = block((-1.0, 1.0), (-1.0, 1.0), -0.2, 0.0)
    lid = block((-0.5, 0.5), (-0.5, 0.5), 0.001, 0.5)
    lid.update_faces(lid.face_normals[:, 2] > -0.5)
    found = read_footholds(saved(tmp_path / "m.ply", floor, lid), limits=PLAIN)
    assert found.area_m2 == pytest.approx(4.0, rel=1e-3)
    assert found.refused_m2["inside"] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("slope_rad", "area"), [(0.3, 1.0), (0.5, 1.0 + 1.0 / np.cos(0.4)), (3.2, None)]
)
def test_the_slope_is_an_option(slope_rad, area, tmp_path):
    ramp = np.tan(0.4)
    corners = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [2, 0, ramp],
        [2, 1, ramp],
        [2, 0, 1 + ramp],
        [2, 1, 1 + ramp],
    ]
    faces = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2], [4, 6, 7], [4, 7, 5]]
    path = saved(tmp_path / "m.obj", trimesh.Trimesh(corners, faces, process=False))
    if slope_rad > np.pi:
        with refuses("slope_rad"):
            FootholdLimits(slope_rad=slope_rad)
        slope_rad, area = np.pi, 2.0 + 1.0 / np.cos(0.4)
    limits = FootholdLimits(slope_rad=slope_rad, margin_m=0.0, width_m=1e-3, clearance_m=0.0)
    assert read_footholds(path, limits=limits).area_m2 == pytest.approx(area, rel=1e-6)


def test_the_margin_is_kept_from_the_border_and_not_from_cuts_between_pieces(tmp_path):
    l_shape = (block((0.0, 2.0), (0.0, 1.0), 0.0, 0.1), block((0.0, 1.0), (1.0, 2.0), 0.0, 0.1))
    found = read_footholds(
        saved(tmp_path / "l.stl", *l_shape), limits=FootholdLimits(margin_m=0.1, width_m=0.01)
    )
    assert found.area_m2 == pytest.approx(1.8 * 0.8 + 0.8 * 1.0, rel=1e-4)
    assert len({piece.surface for piece in found.pieces}) == 1


GRID = 0.02 * (np.arange(200) - 99.5)
X, Y = np.meshgrid(GRID, GRID, indexing="ij")
TRUTH = {
    "stairs": 0.12 * np.floor((X + 2.0) / 0.4),
    "turned": 0.12 * np.floor((X * np.cos(0.4) + Y * np.sin(0.4) + 3.0) / 0.4),
    "ramp": np.where(X > 0.0, 0.35 * X, 0.0),
}


def good_share(found, truth, limits, rng):
    """Share of points on footholds about which the true terrain keeps to the foothold's plane under
    a foot.
    """
    counts = np.zeros(2)
    for piece in found.pieces:
        corners, normal = piece.patch.vertices_m, piece.patch.normal
        points = rng.dirichlet(np.ones(len(corners)), 20) @ corners
        foot = points[:, None, :2] + 0.02 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        i, j = (
            np.clip(np.round((foot[..., k] - GRID[0]) / 0.02).astype(int), 0, 199) for k in range(2)
        )
        plane = corners[0, 2] - (foot - corners[0, :2]) @ normal[:2] / normal[2]
        off = np.abs(truth[i, j] - plane).max(axis=1)
        counts += piece.area_m2 * np.array([np.mean(off < 0.02), 1.0])
    return counts[0] / counts[1]


@pytest.mark.parametrize("name", TRUTH)
def test_footholds_of_a_noisy_map_are_good_on_the_true_terrain(name):
    rng = np.random.default_rng(3)
    limits = FootholdLimits(noise_m=0.01)
    heights = TRUTH[name] + 0.01 * rng.standard_normal(X.shape)
    heights[rng.random(X.shape) < 0.02] = np.nan
    found = footholds_of(
        ElevationMap(x_m=GRID, y_m=GRID, heights_m=heights, name=name).filled(), limits
    )
    assert good_share(found, TRUTH[name], limits, rng) > 0.95
    assert found.area_m2 > 5.0
    assert all(0.005 < piece.rms_m < 0.02 and piece.samples > 10 for piece in found.pieces)


def test_a_course_is_laid_out_between_two_places_and_refused_in_the_air(tmp_path):
    path = saved(
        tmp_path / "step.stl",
        block((-1.0, 2.0), (-1.0, 1.0), -0.2, 0.0),
        block((0.6, 2.0), (-1.0, 1.0), 0.0, 0.08),
    )
    terrain = FileTerrain(file=str(path))  # and a place between the nodes of any grid
    course = build_course(course_between(terrain, (-0.413, 0.017), (1.3, 0.0)))
    assert course.com_nominal_m[0, :2] == pytest.approx([-0.413, 0.017], abs=1e-12)
    assert course.com_nominal_m[-1, :2] == pytest.approx([1.3, 0.0])
    pieces = np.array(
        [np.ptp(piece.vertices_m, axis=0).max() for p in course.footholds for piece in p.candidates]
    )
    reach = np.mean([limb.reach_m for limb in course.robot.limbs])
    assert pieces.max() == pytest.approx(0.8 * reach, abs=1e-9)
    assert course.com_nominal_m[-1, 2] - course.com_nominal_m[0, 2] == pytest.approx(0.08, abs=1e-3)
    assert all(len(foothold.candidates) >= 1 for foothold in course.footholds)
    with refuses("start"):
        course_between(terrain, (-5.0, 0.0), (1.3, 0.0))
    with refuses("goal"):
        course_between(terrain, (0.0, 0.0), (9.0, 0.0))


def test_no_plane_lies_over_a_step_of_a_noisy_map():
    """Of 4 cm, whose plane is off by a quarter of that."""
    x_m, y_m = np.arange(-1.0, 1.001, 0.02), np.arange(-0.6, 0.601, 0.02)
    heights = np.random.default_rng(3).normal(0.04 * (x_m[:, None] > 0.0), 0.002, (101, 61))
    ground = ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="steps")
    for roughness_m in (0.006, 0.01):
        pieces = footholds_of(ground, FootholdLimits(noise_m=0.002, roughness_m=roughness_m)).pieces
        assert len(pieces) >= 2
        assert max(np.arccos(piece.patch.normal[2]) for piece in pieces) < 0.02


def exact_ground(height):
    """The footholds of a map whose heights, a function of x and y, are exact."""
    x_m, y_m = np.arange(-0.4, 0.401, 0.02), np.arange(-0.3, 0.301, 0.02)
    return footholds_of(
        ElevationMap(
            x_m=x_m, y_m=y_m, heights_m=height(*np.meshgrid(x_m, y_m, indexing="ij")), name="exact"
        )
    )


@pytest.mark.parametrize(
    "height",
    [
        lambda x, y: 0.027 * (y + 0.3) * (x > 0.0),
        lambda x, y: 0.014 * ((x > 0.0) & (y > 0.12)),
        lambda x, y: 0.012 * ((np.abs(x) < 0.1) & (np.abs(y) < 0.1)),
        lambda x, y: 0.011 * ((x > 0.0) & (x < 0.1)),
        lambda x, y: 0.14 * np.maximum(x, 0.0),
        lambda x, y: 0.14 * np.maximum(0.866 * x + 0.5 * y, 0.0),
        lambda x, y: np.where(abs(x + y) < 0.015, -0.3, 0.1 * np.maximum(x + y, 0.0)),
        lambda x, y: np.where(y > 0.1, 0.14 * np.maximum(x, 0.0), 0.02 * (x > 0.0)),
        lambda x, y: np.where(np.hypot(x, y) < 0.03, -0.3, 0.14 * np.maximum(x, 0.0)),
    ],
    ids=["crack", "corner", "slab", "curb", "row", "bend", "slit", "half a row", "pit in a row"],
)
def test_no_foothold_of_exact_heights_is_over_a_low_step(height):
    """Some are within the roughness of one plane, which is 8 to 11 mm off them; some bend."""
    found = exact_ground(height)
    assert found.area_m2 > 0.3
    for piece in found.pieces:
        corners, normal = piece.patch.vertices_m, piece.patch.normal
        middle = corners.mean(axis=0)
        places = 0.999 * corners[:, None] + 0.001 * middle
        places = middle + np.linspace(0.0, 1.0, 12)[:, None] * (places - middle)
        assert np.abs(places[..., 2] - height(places[..., 0], places[..., 1])).max() < 1e-3
        assert normal[2] > 0.99


def test_what_exact_heights_are_off_their_plane_is_known_to_be_there():
    """Waves of 4 mm, 12 cm long; a foot comes down three deviations or more."""
    found = exact_ground(lambda x, y: 0.004 * np.sin(2.0 * np.pi * x / 0.12))
    assert found.area_m2 > 0.1
    assert 0.004 / 3.0 < max(p.patch.certainty.rough_m for p in found.pieces) < 0.005
    assert all(p.patch.certainty.rough_m > 0.001 for p in found.pieces)
    assert all(p.patch.certainty is None for p in exact_ground(lambda x, y: 0.1 * x).pieces)


@pytest.mark.parametrize(("degrees", "within"), [(0.0, 0.003), (90.0, 0.003), (30.0, 0.1)])
@pytest.mark.parametrize(
    "up",
    [[0.0, 0.0, 0.1, 0.05], [0.0, 0.1, 0.1, 0.0], [0.1, 0.0, 0.0, 0.1], [0.0, 0.1, 0.0, 0.1]],
    ids=["bend", "roof", "valley", "folds"],
)
def test_a_grid_gives_the_surfaces_that_the_mesh_of_the_same_ground_gives(up, degrees, within):
    """Three planes that meet between samples turned by 30 degrees, and else on rows of samples,
    which are of both.
    """
    along, turn = [-0.81, -0.31, 0.19, 0.81], np.radians(degrees)
    edges = [np.array([(a, s, b) for s in (-0.51, 0.51)]) for a, b in zip(along, up, strict=True)]
    sheets = [
        surface_patch(np.concatenate([b, a[::-1]]) @ rotation_of([0.0, 0.0, turn]), 0.8)
        for a, b in pairwise(edges)
    ]
    u, v = X * np.cos(turn) - Y * np.sin(turn), X * np.sin(turn) + Y * np.cos(turn)
    heights = np.where((abs(u) < 0.811) & (abs(v) < 0.511), np.interp(u, along, up), np.nan)
    grid = ElevationMap(x_m=GRID, y_m=GRID, heights_m=heights, name="grid")
    areas = []
    for ground in (TriangleMesh.of_patches(sheets, "mesh"), grid):
        pieces = footholds_of(ground).pieces
        area_m2 = np.bincount([p.surface for p in pieces], [p.area_m2 for p in pieces])
        areas.append(sorted(area_m2[area_m2 > 0.0]))
    assert areas[1] == pytest.approx(areas[0], rel=within)


@pytest.mark.parametrize("spacing_m", [0.02, 0.05])
def test_feet_beside_a_bend_of_a_grid_are_outside_of_what_bodies_keep_out_of(spacing_m):
    x, y = np.arange(-1.5, 2.5, spacing_m), np.arange(-1.0, 1.0, spacing_m)
    ramp = np.tile(np.interp(x, [0.2, 0.9], [0.0, 0.2])[:, None], (1, len(y)))
    found = footholds_of(ElevationMap(x_m=x, y_m=y, heights_m=ramp, name="ramp"))
    assert stancekit.plan(found, start=(0.0, 0.0), goal=(1.0, 0.0)).status is Status.FEASIBLE


def islands(step):
    """Twenty square sheets in a row, each so much higher than the one before it [m]."""
    squares = np.array([(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.2, 0.0), (0.0, 0.2, 0.0)])
    sheets = [surface_patch(squares + np.array([0.3 * k, 0.0, step * k]), 0.8) for k in range(20)]
    return sheets, footholds_of(TriangleMesh.of_patches(sheets, "islands"), PLAIN)


def test_islands_are_of_one_plane_only_as_far_as_each_fits_it():
    """Sheets that rise by 0.15 mm each are pairwise of one plane, and 2.85 mm from end to end are
    not.
    """
    sheets, found = islands(1.5e-4)
    assert found.refused_m2["inside"] == 0.0  # the higher one of a plane is not above the lower one
    assert found.area_m2 == pytest.approx(20 * 0.04, rel=1e-6)
    for piece in found.pieces:
        middle = piece.patch.centre_m
        assert abs(middle[2] - sheets[int(middle[0] / 0.3)].centre_m[2]) < 2.1e-4
    assert len({piece.surface for piece in islands(0.0)[1].pieces}) == 1


@pytest.mark.parametrize(
    "heights_m",
    [
        np.tile(0.05 * np.arange(60.0)[:, None], (1, 60)),
        np.where(np.arange(400).reshape(20, 20) < 3, 0.0, np.nan),
    ],
    ids=["treads of one sample", "three samples"],
)
def test_an_exact_map_without_any_surface_has_no_footholds(heights_m, tmp_path):
    path = tmp_path / "map.npy"
    np.save(path, heights_m)
    with refuses(kind=NoPlace):
        read_footholds(path, ImportOptions(spacing_m=0.02))
