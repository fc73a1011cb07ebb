"""Solids that show their insides: told apart where they touch, whatever their file keeps of what
hangs together.
"""

from contextlib import nullcontext
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.terrain.footholds import read_footholds
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.triangle_mesh import TriangleMesh, inside_out
from tests.refusals import refuses

UNIT = np.array(list(product((0.0, 1.0), repeat=3)))
FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 7, 5],
        [4, 6, 7],
        [0, 5, 1],
        [0, 4, 5],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 7, 3],
        [1, 5, 7],
    ]
)


def box(low, high, flipped=False):
    """Triangles of a box, shape (12, 3, 3)."""
    corners = np.array(low) + UNIT * (np.array(high) - low)
    return corners[FACES[:, ::-1] if flipped else FACES]


def judged(*solids):
    """The verdict on triangles that are welded, as any file of them is."""
    spread = np.concatenate(solids)
    mesh = spread.reshape(-1, 3), np.arange(3 * len(spread)).reshape(-1, 3)
    corners, number = np.unique(mesh[0].round(9), axis=0, return_inverse=True)
    return inside_out(corners, number.reshape(-1)[mesh[1]])


NEIGHBOURS = {
    "on the same side of one plane": ((1.0, 0.0, 0.0), (2.0, 1.0, 1.0)),
    "a higher one": ((1.0, 0.0, 0.0), (2.0, 1.0, 1.3)),
    "by part of a face": ((1.0, 0.2, 0.3), (2.0, 0.7, 0.9)),
    "by an edge": ((1.0, 0.0, 1.0), (2.0, 1.0, 2.0)),
    "by a corner": ((1.0, 1.0, 1.0), (2.0, 2.0, 2.0)),
    "overlapping": ((0.5, 0.25, 0.25), (2.0, 0.75, 0.75)),
    "apart": ((3.0, 0.0, 0.0), (4.0, 1.0, 1.0)),
}


@pytest.mark.parametrize("neighbour", NEIGHBOURS)
@pytest.mark.parametrize("flipped", [(True, False), (False, True), (True, True)])
def test_a_box_that_is_inside_out_is_found_whatever_it_touches(neighbour, flipped):
    first, second = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), NEIGHBOURS[neighbour]
    assert judged(box(*first), box(*second)) is None
    middle = judged(box(*first, flipped[0]), box(*second, flipped[1]))
    assert middle is not None
    wrong = [corners for corners, turned in zip((first, second), flipped, strict=True) if turned]
    assert any(np.all((middle >= low) & (middle <= high)) for low, high in wrong)


def test_any_one_of_many_touching_boxes_is_found():
    heights = np.random.default_rng(7).choice([0.5, 1.0, 1.5], size=(4, 4))
    places = [((i, j, 0.0), (i + 1.0, j + 1.0, heights[i, j])) for i in range(4) for j in range(4)]
    assert judged(*(box(*place) for place in places)) is None
    for wrong in range(16):
        middle = judged(*(box(*place, k == wrong) for k, place in enumerate(places)))
        assert middle is not None
        low, high = places[wrong]
        assert np.all((middle >= low) & (middle <= high))


def test_a_cavity_is_not_inside_out_and_a_room_is():
    outer, inner = box((0, 0, 0), (3, 3, 3)), box((1, 1, 1), (2, 2, 2), flipped=True)
    assert judged(outer, inner) is None
    assert judged(inner) is not None
    assert judged(outer, inner, box((1.2, 1.2, 1.2), (1.4, 1.4, 1.4))) is None
    assert judged(outer, inner, box((1.2, 1.2, 1.2), (1.4, 1.4, 1.4), flipped=True)) is not None


def test_open_surfaces_are_not_judged_and_hide_no_solid_beside_them():
    sheet = np.array(
        [[[0, 0, 0], [1, 0, 0], [1, -1, 0]], [[0, 0, 0], [1, -1, 0], [0, -1, 0]]], dtype=float
    )
    assert judged(sheet) is None
    assert judged(sheet[:, ::-1]) is None
    assert judged(sheet, box((0, 0, 0), (1, 1, 1))) is None
    assert judged(sheet, box((0, 0, 0), (1, 1, 1), flipped=True)) is not None
    assert judged(box((0, 0, 0), (1, 1, 1), flipped=True)[1:]) is None


def written(path, solids, *, shared):
    """An OBJ file of solids: the corners of each, or of each triangle, of its own."""
    lines, count = list[str](), 0
    for spread in solids:
        points = spread.reshape(-1, 3)
        number = np.arange(len(points))
        if shared:
            points, number = np.unique(points, axis=0, return_inverse=True)
        lines += [f"v {x} {y} {z}" for x, y, z in points]
        lines += [
            "f " + " ".join(str(k) for k in row)
            for row in (number.reshape(-1, 3) + count + 1).tolist()
        ]
        count += len(points)
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("wrong", [(), (0,), (1,), (0, 1)])
def test_touching_plates_of_a_file_have_tops_whichever_way_they_turn(tmp_path: Path, shared, wrong):
    places = [((-1.0, -1.0, -0.2), (1.0, 1.0, 0.0)), ((1.0, -1.0, -0.2), (3.0, 1.0, 0.1))]
    path = written(
        tmp_path / "boxes.obj",
        [box(*place, k in wrong) for k, place in enumerate(places)],
        shared=shared,
    )
    said = f"boxes.obj: {len(wrong)} closed parts narrower than 0.4 m are inside out"
    with pytest.warns(UserWarning, match=said) if wrong else nullcontext():
        found = read_footholds(path)
    assert {round(float(piece.patch.vertices_m[0, 2]), 6) for piece in found.pieces} == {0.0, 0.1}


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("wrong", [[2], [2, 3], [2, 3, 10, 11], [4, 7, 11]])
def test_triangles_against_their_neighbours_are_turned_and_said(tmp_path: Path, closed, wrong):
    ground, block = (
        box((-1.0, -1.0, -0.2), (1.0, 1.0, 0.0)),
        box((1.0, -1.0, -0.2), (2.0, 1.0, 0.1)),
    )
    kept = np.arange(12) if closed else np.setdiff1d(np.arange(12), [0, 1])
    sound = read_footholds(written(tmp_path / "sound.obj", [ground, block[kept]], shared=True))
    block[wrong] = block[wrong, ::-1]
    path = written(tmp_path / "block.obj", [ground, block[kept]], shared=True)
    with pytest.warns(UserWarning, match=f"{len(wrong)} triangles are wound against"):
        found = read_footholds(path)
    assert found.area_m2 == pytest.approx(sound.area_m2, rel=1e-9)


@pytest.mark.parametrize("wall", [False, True])
def test_a_floor_goes_on_below_a_wall_and_is_turned_there(tmp_path: Path, wall):
    upright = box((0.0, -1.0, 0.0), (0.0, 1.0, 0.5))[2 : 4 if wall else 2]
    halves = box((-2.0, -1.0, 0.0), (0.0, 1.0, 0.0))[10:], box((0, -1, 0), (1, 1, 0))[10:]
    sound = written(tmp_path / "s.obj", [np.concatenate([*halves, upright])], shared=True)
    turned = np.concatenate([halves[0], halves[1][:, ::-1], upright])
    path = written(tmp_path / "half.obj", [turned], shared=True)
    with pytest.warns(UserWarning, match="2 triangles are wound against"):
        found = read_footholds(path)
    assert found.area_m2 == pytest.approx(read_footholds(sound).area_m2, rel=1e-9)


@pytest.mark.parametrize("way", [1, -1])
def test_a_roof_hides_no_floor_whichever_way_it_is_wound_and_a_block_does(tmp_path: Path, way):
    floor, block = box((-1, -1, 0), (1, 1, 0))[10:], box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))
    open_below = block[block[:, :, 2].max(axis=1) > 0.0]
    hidden = written(tmp_path / "block.obj", [floor, open_below], shared=True)
    assert read_footholds(hidden).refused_m2["inside"] == pytest.approx(1.0, rel=1e-3)
    path = written(tmp_path / "s.obj", [floor, block[10:, ::way]], shared=True)
    with pytest.warns(UserWarning, match="1 m² of open sheets") if way < 0 else nullcontext():
        found = read_footholds(path)
    assert len(found.doubts) == (way < 0)
    assert sum(
        piece.area_m2 for piece in found.pieces if abs(piece.patch.centre_m[2]) < 1e-6
    ) == pytest.approx(1.96**2, rel=1e-6)
    assert found.refused_m2["inside"] == 0.0


def test_a_block_with_a_hole_in_its_top_is_no_roof(tmp_path: Path):
    floor, block = box((-1, -1, 0), (1, 1, 0))[10:], box((-0.5, -0.5, -0.2), (0.5, 0.5, 1.0))
    torn = [np.concatenate([floor, np.delete(block, 10, axis=0)])]
    found = read_footholds(written(tmp_path / "torn.obj", torn, shared=True))
    assert found.refused_m2["inside"] == pytest.approx(0.5, rel=1e-2)


def test_one_of_thousands_of_touching_solids_is_found():
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0), indexing="ij")
    low = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)
    spread = np.concatenate([(corner + UNIT)[FACES] for corner in low])
    corners, number = np.unique(spread.reshape(-1, 3), axis=0, return_inverse=True)
    assert len(spread) == 19_200
    assert inside_out(corners, number.reshape(-1, 3)) is None
    faces = number.reshape(-1, 12, 3).copy()
    faces[777] = faces[777, :, ::-1]
    np.testing.assert_allclose(inside_out(corners, faces.reshape(-1, 3)), low[777] + 0.5, atol=0.51)
    assert len(
        TriangleMesh.of(corners, number.reshape(-1, 3), ImportOptions(), "blocks").triangles
    ) == len(spread)


def test_a_plate_that_is_inside_out_is_turned_and_said_and_a_room_is_refused(tmp_path):
    ground, plate = box((0.0, 0.0, -0.1), (2.0, 2.0, 0.0)), ((0.5, 0.5, 0.0), (1.5, 1.5, 0.1))
    path = tmp_path / "plate.stl"

    def write(*solids):
        spread = np.concatenate(solids)
        text = "".join(
            "facet normal 0 0 0 outer loop "
            + " ".join("vertex " + " ".join(map(repr, corner)) for corner in triangle.tolist())
            + " endloop endfacet\n"
            for triangle in spread
        )
        path.write_text(f"solid plate\n{text}endsolid plate\n")
        return path

    sound = read_footholds(write(ground, box(*plate)))
    with pytest.warns(UserWarning, match=r"1 closed parts narrower than 0\.4 m are inside out"):
        found = read_footholds(write(ground, box(*plate, flipped=True)))
    assert found.area_m2 == pytest.approx(sound.area_m2, rel=1e-12)
    assert len(found.pieces) == len(sound.pieces)
    room = box((3.0, 0.0, 0.0), (5.0, 2.0, 0.5), flipped=True)
    with refuses():
        read_footholds(write(room))
    with refuses():
        read_footholds(write(ground, box(*plate, flipped=True), room))
