"""Terrain files: every kind goes round, and what is wrong with one is said in one line."""

import struct
import zlib

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.terrain.footholds import read_footholds
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.reference import named_terrain
from stancekit.planners.terrain.terrain_file import read_heights, read_terrain
from tests.refusals import assert_names, refuses

Image = pytest.importorskip("PIL.Image")
trimesh = pytest.importorskip("trimesh")

HEIGHTS = np.random.default_rng(0).uniform(0.0, 0.03, (12, 17))


def wave(x, y):
    return 0.1 * np.sin(2.0 * x) * np.cos(1.5 * y)


def mesh(skip=(), scale=1.0):
    """A wave on [−1, 1]² in triangles with 5 cm legs."""
    x = np.linspace(-1.0, 1.0, 41)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij")], axis=-1).reshape(-1, 2)
    a = (41 * np.arange(40)[:, None] + np.arange(40)).ravel()
    faces = np.concatenate([np.stack([a, a + 41, a + 1], 1), np.stack([a + 1, a + 41, a + 42], 1)])
    vertices = np.column_stack([grid, wave(*grid.T)])
    return trimesh.Trimesh(scale * vertices, np.delete(faces, skip, axis=0), process=False)


def test_npy_csv_and_npz_give_their_heights_back(tmp_path):
    np.save(tmp_path / "a.npy", HEIGHTS)
    np.savetxt(tmp_path / "a.csv", HEIGHTS, delimiter=",", header="a comment")
    np.savetxt(tmp_path / "b.csv", HEIGHTS, delimiter=" ")
    np.savez(tmp_path / "a.npz", **HeightField.from_array(HEIGHTS).to_arrays())
    for name in ("a.npy", "a.csv", "b.csv", "a.npz"):
        field = named_terrain(str(tmp_path / name))
        np.testing.assert_allclose(field.heights_m, HEIGHTS, atol=1e-15)
        assert field.domain_m == (pytest.approx((-0.275, 0.275)), pytest.approx((-0.4, 0.4)))


def test_a_picture_lies_as_it_is_seen_with_black_low_and_white_high(tmp_path):
    grey = np.zeros((6, 8), dtype=np.uint16)
    grey[0, 7] = 6553  # the upper right corner
    Image.fromarray(grey).save(tmp_path / "deep.png")
    Image.fromarray((grey // 257).astype(np.uint8)).save(tmp_path / "flat.png")
    for name in ("deep.png", "flat.png"):
        field = read_heights(tmp_path / name, ImportOptions(height_m=(-0.5, 1.5), spacing_m=0.1))
        assert field.heights_m.shape == (8, 6)
        assert field.height(np.array([0.35, 0.25])) == pytest.approx(-0.3, abs=0.01)
        assert field.height(np.array([-0.35, 0.25])) == pytest.approx(-0.5, abs=1e-9)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_a_mesh_is_sampled_at_its_upper_side(tmp_path, suffix):
    mesh().export(tmp_path / f"m.{suffix}")
    field = read_heights(tmp_path / f"m.{suffix}", ImportOptions(spacing_m=0.05))
    assert field.heights_m.shape == (41, 41)
    np.testing.assert_allclose(field.heights_m, wave(field.x_m[:, None], field.y_m), atol=2e-6)


def test_of_a_mesh_with_an_overhang_the_top_counts(tmp_path):
    low = mesh()
    roof = low.copy()
    roof.apply_translation([0.0, 0.0, 0.5])
    trimesh.util.concatenate([roof, low]).export(tmp_path / "two.stl")
    field = read_heights(tmp_path / "two.stl")
    np.testing.assert_allclose(
        field.heights_m, 0.5 + wave(field.x_m[:, None], field.y_m), atol=2e-6
    )


def test_millimetres_are_noticed_and_read_with_their_unit(tmp_path):
    mesh(scale=1000.0).export(tmp_path / "mm.stl")
    with refuses("mm.stl", "2000 m", "unit_m"):
        read_heights(tmp_path / "mm.stl")
    field = read_heights(tmp_path / "mm.stl", ImportOptions(unit_m=0.001))
    np.testing.assert_allclose(field.heights_m, wave(field.x_m[:, None], field.y_m), atol=2e-6)


def test_a_grid_higher_than_it_is_wide_is_doubted(tmp_path):
    heights = np.outer([0, 0, 0, 180, 180, 180], np.ones(5, dtype=int))
    np.save(tmp_path / "heights.npy", heights)
    with pytest.warns(UserWarning, match="180 m"):
        assert read_footholds(tmp_path / "heights.npy", ImportOptions(spacing_m=0.2)).doubts
    mm = ImportOptions(spacing_m=0.2, unit_m=1e-3)
    assert read_footholds(tmp_path / "heights.npy", mm).doubts == ()


def test_a_hole_in_a_mesh_says_where_it_is(tmp_path):
    mesh(skip=[820, 2420]).export(
        tmp_path / "holed.stl"
    )  # both triangles of the cell at (.025, .025)
    with pytest.raises(InvalidInput) as caught:
        read_heights(tmp_path / "holed.stl", ImportOptions(spacing_m=0.025))
    assert str(caught.value).endswith(
        "got holes at 1 of 6561 grid points, the first at (0.025, 0.025) m; holes: fill lays a membrane over them"
    )


def test_a_wall_that_its_spline_cannot_hold_is_refused_by_millimetres_and_may_be_smoothed(tmp_path):
    x = 0.05 * np.arange(41)
    np.save(tmp_path / "step.npy", np.where(x < 1.0, 0.0, 0.6)[:, None] + 0.0 * x)
    with pytest.raises(InvalidInput) as caught:
        read_heights(tmp_path / "step.npy")
    field = HeightField.from_array(np.load(tmp_path / "step.npy"))
    line = field.height(np.column_stack([np.linspace(-1.0, 1.0, 81), np.zeros(81)]))[1::2]
    beyond = max(line.max() - 0.6, -line.min())  # natural cubic splines swing beyond a step
    assert beyond > 0.03
    assert_names(str(caught.value), "step.npy", f"{1e3 * beyond:.0f}", "smooth_m")
    assert np.ptp(read_heights(tmp_path / "step.npy", smooth_m=0.05).heights_m) == pytest.approx(
        0.6, abs=0.01
    )
    assert read_heights(tmp_path / "step.npy", tolerance_m=0.1).heights_m.max() == 0.6


def written(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("name", "content", "options", "message"),
    [
        (
            "h.csv",
            b"1,2,3,4\n1,,3,4\n" * 2,
            {},
            "got holes at 2 of 16 grid points, the first at (-0.025, -0.025) m",
        ),
        ("h.csv", b"1,2,3,4\n1,2,3\n", {}, "line 2: expected 4 numbers, got 3"),
        (
            "h.csv",
            b"x,y\n1,2\n",
            {},
            "line 1: expected numbers of a grid, got 'x,y'",
        ),
        ("h.csv", b"1,2,3,4\n", {}, "h.csv: x_m: expected 4 or more grid lines, got 1"),
        ("h.csv", b"# nothing\n", {}, "expected rows of numbers, got none"),
        ("h.csv", b"\xff\xfe1", {}, "expected UTF-8 text, byte 0 is not"),
        ("h.npy", b"no", {}, "h.npy: expected arrays without pickle: "),
        ("h.npy", b"", {}, "expected a terrain, the file is empty"),
        ("h.png", b"no", {"height_m": (0.0, 1.0)}, "expected a .png picture, cannot read it"),
        (
            "h.png",
            b"no",
            {},
            "expected height_m with a .png, the heights of black and white [m], got none",
        ),
        ("h.stl", b"no", {}, "h.stl: expected a mesh: it is cut off, and it has 2 bytes"),
        (
            "h.tif",
            b"no",
            {},
            ".png, .stl, .obj, .ply, .dae, .off, .glb, .xml, .pcd, .xyz, got .tif",
        ),
        ("h.csv", b"1", {"height_m": (0.0, 1.0)}, "height_m: expected a .png with it"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, name, content, options, message):
    with pytest.raises(InvalidInput) as caught:
        read_heights(written(tmp_path / name, content), ImportOptions(**options))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def png(bits, kind, row, clear=None, palette=None):
    """A picture of four equal rows, the last pixel of which is a hole by its alpha or ``clear``."""
    heads = {"IHDR": struct.pack(">IIBBBBB", 4, 4, bits, kind, 0, 0, 0)}
    heads |= {} if palette is None else {"PLTE": bytes(palette)}
    heads |= {} if clear is None else {"tRNS": clear}
    chunks = heads | {"IDAT": zlib.compress(4 * (b"\0" + bytes(row))), "IEND": b""}
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        len(data).to_bytes(4) + name.encode() + data + zlib.crc32(name.encode() + data).to_bytes(4)
        for name, data in chunks.items()
    )


@pytest.mark.parametrize(
    ("picture", "most"),
    [
        (png(8, 4, [0, 255, 51, 255, 255, 255, 9, 0]), 1.0),
        (png(8, 0, [0, 51, 255, 9], b"\0\x09"), 1.0),
        (png(16, 0, [0, 0, 0x33, 0x33, 255, 255, 0, 9], b"\0\x09"), 1.0),
        (
            png(8, 3, [0, 1, 2, 3], b"\xff\xff\xff\0", [0, 0, 0, *3 * [51], *3 * [255], 9, 9, 9]),
            1.0,
        ),
        (png(8, 2, [0, 0, 0, *3 * [51], *3 * [255], 9, 9, 9], b"\0\x09\0\x09\0\x09"), 1.0),
        (png(1, 0, [0b0010 << 4]), None),
        (png(2, 0, [0b00011110]), None),
        (png(4, 0, [0x03, 0xF1]), None),
        (png(2, 0, [0b00011110], b"\0\2"), "2 bits"),
        (png(16, 4, range(16)), "16 bits"),
        (png(16, 2, range(24)), "16 bits"),
    ],
)
def test_a_picture_of_any_depth_keeps_its_heights_and_holes(picture, most, tmp_path):
    path, options = written(tmp_path / "map.png", picture), ImportOptions(height_m=(0.0, 1.0))
    if isinstance(most, str):
        with refuses(most):
            read_terrain(path, options)
        return
    heights = read_terrain(path, options).heights_m[:, 0]
    assert np.isnan(heights).tolist() == [False, False, False, most is not None]
    assert (heights[0], heights[2]) == (0.0, 1.0)
    assert most is None or heights[1] == pytest.approx(0.2)


def test_a_pickle_is_not_opened(tmp_path):
    np.save(tmp_path / "object.npy", np.array([[None] * 5] * 5), allow_pickle=True)
    with refuses("object.npy"):
        read_heights(tmp_path / "object.npy")
