"""The one reader: clouds, units, axes, crops and holes mean the same from every format, and bad
files are one line.
"""

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import FootholdLimits, read_footholds
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.terrain_file import read_heights, read_terrain
from stancekit.planners.terrain.triangle_mesh import TriangleMesh
from tests.refusals import at_once, refuses

trimesh = pytest.importorskip("trimesh")

RNG = np.random.default_rng(0)
POINTS = np.column_stack([RNG.uniform(-1.0, 1.0, (20_000, 2)), np.zeros(20_000)])
POINTS[:, 2] = 0.1 * POINTS[:, 0] - 0.05 * POINTS[:, 1] + 0.3


def save_cloud(path, points):
    if path.suffix == ".pcd":
        pcd = pytest.importorskip("pypcd4.pypcd4")
        pcd.PointCloud.from_xyz_points(points.astype(np.float64)).save(path)
    elif path.suffix == ".npy":
        np.save(path, points)
    elif path.suffix == ".ply":
        trimesh.PointCloud(points).export(path)
    else:
        np.savetxt(path, points)
    return path


@pytest.mark.parametrize("suffix", [".pcd", ".npy", ".ply", ".xyz"])
def test_a_cloud_of_a_plane_is_a_map_of_it(suffix, tmp_path):
    found = read_terrain(
        save_cloud(tmp_path / f"c{suffix}", POINTS), ImportOptions(kind="cloud", spacing_m=0.05)
    )
    assert isinstance(found, ElevationMap)
    x, y = np.meshgrid(found.x_m, found.y_m, indexing="ij")
    assert found.samples.sum() == len(POINTS)
    np.testing.assert_allclose(found.heights_m, 0.1 * x - 0.05 * y + 0.3, atol=0.004)


@pytest.mark.parametrize("off_m", [0.0, 1e-9])
def test_points_that_a_cloud_has_several_times_count_once(off_m, tmp_path):
    """As in scans that were put together: a plane of 2 x 2 m is ground up to a foot's margin."""
    away = np.random.default_rng(1).uniform(-off_m, off_m, (4, *POINTS.shape))
    asked = (  # rounded as by a file of seven decimals
        save_cloud(tmp_path / "c.npy", np.concatenate(5e-7 * np.round(POINTS / 5e-7) + away)),
        ImportOptions(kind="cloud"),
    )
    found, count = read_footholds(*asked), read_terrain(*asked).samples.sum()
    assert (len(found.pieces), 3.7 < found.area_m2 < 4.03, count) == (1, True, len(POINTS))


@pytest.mark.parametrize(("up", "turned"), [("z", [0, 1, 2]), ("y", [1, 2, 0]), ("x", [2, 0, 1])])
def test_unit_axis_and_offset_bring_a_cloud_back(up, turned, tmp_path):
    offset = np.array([1.0, -2.0, 0.5])
    path = tmp_path / "c.npy"
    np.save(path, 1000.0 * (POINTS - offset)[:, turned])
    options = ImportOptions(
        kind="cloud", unit_m=0.001, up=up, offset_m=tuple(offset), spacing_m=0.1
    )
    np.save(tmp_path / "plain.npy", POINTS)
    plain = read_terrain(tmp_path / "plain.npy", ImportOptions(kind="cloud", spacing_m=0.1))
    np.testing.assert_allclose(read_terrain(path, options).heights_m, plain.heights_m, atol=1e-9)


def test_a_first_line_of_names_says_which_column_is_which(tmp_path):
    np.save(tmp_path / "c.npy", POINTS)
    rows = "\n".join(f"7,{z},{x},{y}" for x, y, z in POINTS.tolist())
    (tmp_path / "c.csv").write_text(f'"//r","Z [m]",X,y\n{rows}\n')
    options = ImportOptions(kind="cloud", spacing_m=0.1)
    named, plain = (read_terrain(tmp_path / name, options) for name in ("c.csv", "c.npy"))
    np.testing.assert_array_equal(named.heights_m, plain.heights_m)


def test_points_in_three_columns_are_never_taken_for_heights(tmp_path):
    np.save(tmp_path / "c.npy", POINTS)
    with refuses("kind", "cloud", "grid"):
        read_terrain(tmp_path / "c.npy")


def test_a_crop_cuts_meshes_maps_and_clouds_alike(tmp_path):
    crop = (-0.5, 0.5, -0.25, 0.25)
    trimesh.creation.box((2.0, 2.0, 0.2)).export(tmp_path / "box.stl")
    np.save(tmp_path / "grid.npy", np.zeros((81, 81)))
    limits = FootholdLimits(margin_m=0.0)
    mesh = read_footholds(tmp_path / "box.stl", ImportOptions(crop_m=crop), limits)
    assert (mesh.area_m2, mesh.doubts) == (pytest.approx(0.5, rel=1e-6), ())
    for low, high in ((0.1, 0.2), (0.0, 0.1)):  # what lies on the border belongs to it
        flat = ImportOptions(crop_m=(*crop, low, high))
        assert read_footholds(tmp_path / "box.stl", flat, limits).area_m2 == pytest.approx(0.5)
    grid = read_terrain(tmp_path / "grid.npy", ImportOptions(crop_m=crop, spacing_m=0.025))
    assert (grid.x_m.min(), grid.x_m.max(), grid.y_m.min(), grid.y_m.max()) == pytest.approx(crop)
    np.save(tmp_path / "cloud.npy", POINTS)
    cloud = read_terrain(
        tmp_path / "cloud.npy", ImportOptions(kind="cloud", crop_m=crop, spacing_m=0.025)
    )
    assert cloud.samples.sum() == np.all(np.abs(POINTS[:, :2]) <= [0.5, 0.25], axis=1).sum()


def test_a_membrane_over_holes_keeps_a_plane_and_stays_within_its_border():
    x, y = np.meshgrid(*(0.05 * np.arange(40),) * 2, indexing="ij")
    plane = 0.2 * x - 0.1 * y
    holed = np.where(np.hypot(x - 1.0, y - 1.0) < 0.4, np.nan, plane)
    found = ElevationMap.of_heights(holed, 0.05, "m").filled()
    np.testing.assert_allclose(found.heights_m, plane, atol=1e-9)
    assert found.samples.sum() == np.isfinite(holed).sum()
    rough = np.where(np.isnan(holed), np.nan, RNG.uniform(0.0, 0.1, x.shape))
    filled = ElevationMap.of_heights(rough, 0.05, "m").filled().heights_m[np.isnan(rough)]
    assert np.nanmin(rough) <= filled.min() <= filled.max() <= np.nanmax(rough)


def test_holes_are_no_ground_unless_they_are_to_be_filled(tmp_path):
    heights = np.zeros((101, 101))
    heights[40:60, 40:60] = np.nan
    np.save(tmp_path / "h.npy", heights)
    options = {"spacing_m": 0.02}
    without = read_footholds(tmp_path / "h.npy", ImportOptions(**options))
    filled = read_footholds(tmp_path / "h.npy", ImportOptions(**options, holes="fill"))
    assert without.refused_m2["hole"] == pytest.approx(0.16)
    assert filled.area_m2 - without.area_m2 > 0.16
    assert (
        read_heights(tmp_path / "h.npy", ImportOptions(**options, holes="fill")).heights_m.max()
        == 0.0
    )


def inside_out(path):
    box = trimesh.creation.box((1.0, 1.0, 0.5))
    box.invert()
    box.export(path)


def many(path):
    trimesh.creation.box((1.0, 1.0, 0.2)).subdivide().subdivide().export(path)


@pytest.mark.parametrize(
    ("name", "write", "options", "message"),
    [
        ("e.stl", lambda p: p.write_bytes(b""), {}, "expected a mesh"),
        (
            "e.npy",
            lambda p: np.save(p, np.zeros((0, 0))),
            {},
            "expected 4 or more grid lines, got 0",
        ),
        ("e.pcd", lambda p: p.write_bytes(b""), {}, "expected points, the file is empty"),
        ("e.pcd", lambda p: p.write_bytes(b"# no"), {}, "which pypcd4 cannot read"),
        (
            "nan.npy",
            lambda p: np.save(p, np.full((9, 9), np.nan)),
            {},
            "expected heights, got 81 holes and nothing",
        ),
        (
            "inf.npy",
            lambda p: np.save(p, np.where(np.eye(9) > 0.0, np.inf, 0.0)),
            {},
            "expected heights, NaN where there is none, got 9 that are infinite, the first inf at",
        ),
        (
            "nan.npy",
            lambda p: np.save(p, np.full((9, 3), np.nan)),
            {"kind": "cloud"},
            "got none of 9 that is finite",
        ),
        (
            "row.npy",
            lambda p: np.save(p, np.zeros((1, 50))),
            {},
            "x_m: expected 4 or more grid lines, got 1",
        ),
        (
            "mm.stl",
            lambda p: trimesh.creation.box((900, 900, 90)).export(p),
            {},
            "see unit_m",
        ),
        (
            "mm.npy",
            lambda p: np.save(p, 1000.0 * np.eye(9)),
            {},
            "NaN where there is none, got 0 to 1000 m; see unit_m",
        ),
        (
            "out.stl",
            inside_out,
            {},
            "got a solid about (-0.167, -0.167, -0.249) m that is inside out",
        ),
        (
            "line.obj",
            lambda p: p.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"),
            {},
            "triangles, got an empty",
        ),
        (
            "many.stl",
            many,
            {"most_triangles": 100},
            "expected 100 triangles or fewer (most_triangles), got 192",
        ),
        (
            "many.ply",
            many,
            {"most_triangles": 100},
            "expected 100 triangles or fewer (most_triangles), got 192",
        ),
        (
            "many.obj",
            many,
            {"most_triangles": 100},
            "expected 100 triangles or fewer (most_triangles), got 192",
        ),
        (
            "g.npy",
            lambda p: np.save(p, np.zeros((9, 9))),
            {"up": "y"},
            "up: expected z with a grid",
        ),
        (
            "g.npy",
            lambda p: np.save(p, np.zeros((9, 9))),
            {"crop_m": (5, 6, 5, 6)},
            "crop_m: expected 4 or more grid",
        ),
        (
            "b.stl",
            lambda p: trimesh.creation.box().export(p),
            {"crop_m": (5, 6, 5, 6)},
            "inside, got none of it",
        ),
        (
            "g.npy",
            lambda p: np.save(p, np.zeros((9, 9))),
            {"kind": "mesh"},
            "expected a mesh that ends in .stl",
        ),
    ],
)
def test_terrains_that_are_none_are_one_line_within_seconds(
    name, write, options, message, tmp_path
):
    write(tmp_path / name)
    with at_once(1_000_000), pytest.raises(InvalidInput) as caught:
        read_footholds(tmp_path / name, ImportOptions(**options))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_header_alone_refuses_a_mesh_with_too_many_triangles(tmp_path):
    head = bytes(80) + (10_000_000).to_bytes(4, "little")
    (tmp_path / "huge.ply").write_bytes(
        b"ply\nformat ascii 1.0\nelement vertex 9\nelement face 10000000\nend_header\n" + head
    )
    with refuses("most_triangles"):
        read_terrain(tmp_path / "huge.ply", ImportOptions(kind="mesh"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "photo"}, "kind"),
        ({"up": "w"}, "up"),
        ({"holes": "guess"}, "holes"),
        ({"unit_m": 0.0}, "unit_m"),
        ({"offset_m": (1.0, 2.0)}, "offset_m"),
        ({"crop_m": (1.0, 0.0, 0.0, 1.0)}, "crop_m"),
        ({"most_triangles": 0}, "most_triangles"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with refuses(message):
        ImportOptions(**options)


def test_a_dae_file_is_a_mesh(tmp_path):
    pytest.importorskip("collada")
    trimesh.creation.box((1.0, 2.0, 0.5)).export(tmp_path / "box.dae")
    found = read_terrain(tmp_path / "box.dae")
    assert isinstance(found, TriangleMesh)
    np.testing.assert_allclose(np.ptp(found.corners_m, axis=0), [1.0, 2.0, 0.5])
