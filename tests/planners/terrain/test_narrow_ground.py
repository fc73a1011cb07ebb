"""Beams, bars of gratings and rungs are footholds for feet that fit; each area that is none has a
true reason.
"""

import numpy as np
import pytest

from stancekit.planners.errors import NoPlace
from stancekit.planners.problem.course_terrain import Bars, FileTerrain
from stancekit.planners.terrain.elevation import ElevationMap
from stancekit.planners.terrain.footholds import (
    FootholdLimits,
    Rung,
    footholds_of,
    held_on_both_sides,
    read_footholds,
)
from tests.refusals import refuses

trimesh = pytest.importorskip("trimesh")
FOOT_M = 0.012
FEET = FootholdLimits().for_foot(FOOT_M)
RADIUS_M = 0.015


def bar(x, half, top=0.0, along=0.4):
    return trimesh.creation.box(bounds=[[x - half, -along, top - 0.03], [x + half, along, top]])


def rung(x, sides=24, turned=0.0, yaw=0.0, tilt=0.0, radius_m=RADIUS_M):
    """A round bar of 0.8 m along y whose axis is a radius below 0."""
    made = trimesh.creation.cylinder(radius=radius_m, height=0.8, sections=sides)
    turn = trimesh.transformations.rotation_matrix
    for angle, axis in (
        (turned, (0, 0, 1)),
        (np.pi / 2, (1, 0, 0)),
        (tilt, (1, 0, 0)),
        (yaw, (0, 0, 1)),
    ):
        made.apply_transform(turn(angle, axis))
    made.apply_translation((x, 0.0, -radius_m))
    return made


def found_of(path, *meshes, limits=FEET):
    trimesh.util.concatenate(meshes).export(path)
    return read_footholds(path, limits=limits)


def sizes(pieces):
    return np.array([np.ptp(piece.patch.vertices_m[:, :2], axis=0) for piece in pieces])


@pytest.mark.parametrize("gap_m", [0.005, 0.03, 0.06])
def test_every_bar_of_a_grating_is_found_to_its_size(tmp_path, gap_m):
    places = np.arange(12) * (0.03 + gap_m)
    found = found_of(tmp_path / "grating.stl", *(bar(x, 0.015) for x in places))
    assert len(found.pieces) == 12
    assert sizes(found.pieces) + 2.0 * FOOT_M == pytest.approx(
        np.tile([0.03, 0.8], (12, 1)), abs=1e-6
    )
    tops = found.area_m2 + found.refused_m2["edge"] + found.refused_m2["small"]
    assert tops == pytest.approx(12 * 0.03 * 0.8, rel=1e-6)
    assert found.refused_m2["rough"] + found.refused_m2["small"] == pytest.approx(0.0, abs=1e-9)


def test_a_bar_that_is_narrower_than_a_foot_says_so(tmp_path):
    with refuses("margin_m", kind=NoPlace):
        found_of(
            tmp_path / "grating.stl", bar(0.0, 0.015), bar(0.06, 0.015), limits=FootholdLimits()
        )


@pytest.mark.parametrize("sides", [6, 7, 8, 16, 64])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_rung_is_a_line_with_the_friction_of_both_sides(tmp_path, sides, share):
    places = 0.15 * np.arange(5)
    turned = share * np.pi / sides
    found = found_of(tmp_path / "rungs.stl", *(rung(x, sides, turned) for x in places))
    assert len(found.pieces) == 5
    for piece, x in zip(
        sorted(found.pieces, key=lambda piece: piece.patch.centre_m[0]), places, strict=True
    ):
        corners = piece.patch.vertices_m
        assert piece.patch.centre_m[:2] == pytest.approx([x, 0.0], abs=5e-4)
        assert RADIUS_M * (np.cos(np.pi / sides) - 1.0) - 1e-6 <= corners[0, 2] <= 1e-6
        assert np.ptp(corners[:, 1]) + 2.0 * FOOT_M == pytest.approx(0.8, abs=1e-6)
        turn = np.arcsin(0.5 * np.ptp(corners[:, 0]) / RADIUS_M)
        assert (
            piece.turn_rad == pytest.approx(turn, rel=1e-2)
            if sides >= 16
            else piece.turn_rad >= turn - 1e-3
        )
        assert piece.on(0.8).friction == pytest.approx(np.tan(np.arctan(0.8) - piece.turn_rad))


def test_forces_of_a_rungs_cone_are_held_wherever_on_its_line_the_foot_is():
    rng, made = (
        np.random.default_rng(3),
        Rung.between(np.array([[0.0, -1.0, 0.2], [0.3, 1.0, 0.4]]), 0.02),
    )
    friction = held_on_both_sides(0.7, made.turn_rad)
    across = np.cross(made.axis, made.upright)
    for _ in range(500):
        turned, azimuth = made.turn_rad * rng.uniform(-1.0, 1.0), rng.uniform(0.0, 2.0 * np.pi)
        force = made.upright + friction * (np.cos(azimuth) * across + np.sin(azimuth) * made.axis)
        normal = np.cos(turned) * made.upright + np.sin(turned) * across
        pressed = force @ normal
        assert np.linalg.norm(force - pressed * normal) <= 0.7 * pressed + 1e-12
    worst = made.upright + 1.05 * friction * across
    normal = np.cos(made.turn_rad) * made.upright - np.sin(made.turn_rad) * across
    assert np.linalg.norm(worst - worst @ normal * normal) > 0.7 * worst @ normal


def test_rungs_askew_on_a_slope_between_rails_and_under_a_plate(tmp_path):
    askew = found_of(tmp_path / "askew.stl", *(rung(0.1 * k, yaw=0.5) for k in range(4)))
    assert len(askew.pieces) == 4
    assert len(found_of(tmp_path / "tilted.stl", rung(0.0, tilt=0.5)).pieces) == 1
    with refuses("steep", kind=NoPlace):
        found_of(tmp_path / "steep.stl", rung(0.0, tilt=0.7))
    rails = [
        trimesh.creation.box(bounds=[[-0.3, y, -0.05], [0.3, y + 0.04, 0.0]]) for y in (-0.42, 0.38)
    ]
    ladder = found_of(tmp_path / "ladder.stl", *(rung(x) for x in (-0.1, 0.1)), *rails)
    on = [piece for piece in ladder.pieces if piece.turn_rad]
    assert [round(float(np.ptp(piece.patch.vertices_m[:, 1])), 3) for piece in on] == [0.776] * 2
    plate = trimesh.creation.box(bounds=[[-0.1, -0.1, 0.05], [0.1, 0.1, 0.06]])
    under = [
        piece
        for piece in found_of(tmp_path / "plate.stl", rung(0.0), plate).pieces
        if piece.turn_rad
    ]
    assert sorted(np.abs(piece.patch.vertices_m[:, 1]).min().round(3) for piece in under) == [
        0.112,
        0.112,
    ]


def test_what_is_no_rung_has_none(tmp_path):
    for shape in (trimesh.creation.cone(0.1, 0.2), trimesh.creation.icosphere(3, 0.05)):
        with refuses(kind=NoPlace):
            found_of(tmp_path / "shape.stl", shape)
    pillar = found_of(
        tmp_path / "pillar.stl", rung(0.0, sides=8, radius_m=0.2)
    )  # wide enough to stand on its sides
    assert pillar.pieces
    assert not any(piece.turn_rad for piece in pillar.pieces)


@pytest.mark.parametrize(("spacing_m", "yaw"), [(0.01, 0.0), (0.01, 0.3), (0.02, 0.0), (0.02, 0.3)])
def test_beams_of_ten_and_fifteen_centimetres_with_gaps_are_found_in_maps(spacing_m, yaw):
    x_m = y_m = np.arange(-0.8, 0.8001, spacing_m)
    x, y = np.meshgrid(x_m, y_m, indexing="ij")
    across, along = np.cos(yaw) * y - np.sin(yaw) * x, np.cos(yaw) * x + np.sin(yaw) * y
    on = np.zeros_like(x, dtype=bool)
    beams = [(-0.35, 0.10), (-0.15, 0.15), (0.05, 0.10), (0.25, 0.15)]
    for low, width in beams:
        on |= (across > low) & (across < low + width) & (np.abs(along) < 0.6)
    found = footholds_of(
        ElevationMap(x_m=x_m, y_m=y_m, heights_m=np.where(on, 0.0, -0.3), name="beams"), FEET
    )
    tops = [piece for piece in found.pieces if piece.patch.centre_m[2] > -0.1]
    assert len({piece.surface for piece in tops}) == 4
    for low, width in beams:
        its = np.concatenate(
            [
                piece.patch.vertices_m
                for piece in tops
                if low
                < np.cos(yaw) * piece.patch.centre_m[1] - np.sin(yaw) * piece.patch.centre_m[0]
                < low + width
            ]
        )
        sideways = np.cos(yaw) * its[:, 1] - np.sin(yaw) * its[:, 0]
        assert sideways.min() >= low + FOOT_M - 1e-6
        assert sideways.max() <= low + width - FOOT_M + 1e-6
        assert np.ptp(sideways) + 2.0 * FOOT_M + spacing_m == pytest.approx(
            width, abs=0.0101
        )  # edges between samples


@pytest.mark.parametrize("yaw", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("spacing_m", [0.005, 0.01])
def test_bars_of_three_centimetres_and_as_far_apart_are_found_in_maps(spacing_m, yaw):
    x_m = y_m = np.arange(-0.5, 0.5001, spacing_m)
    x, y = np.meshgrid(x_m, y_m, indexing="ij")
    across = np.cos(yaw) * y - np.sin(yaw) * x + 0.003
    on = (
        (np.mod(across, 0.06) < 0.03)
        & (np.abs(np.cos(yaw) * x + np.sin(yaw) * y) < 0.4)
        & (np.abs(across) < 0.24)
    )
    heights = np.where(on, 0.0, -0.3)
    found = footholds_of(
        ElevationMap(x_m=x_m, y_m=y_m, heights_m=heights, name="bars"),
        FootholdLimits().for_foot(0.009),
    )
    bars = [piece.patch for piece in found.pieces if piece.patch.centre_m[2] > -0.1]
    assert len(bars) == 8
    for patch in bars:
        corners = (
            np.cos(yaw) * patch.vertices_m[:, 1] - np.sin(yaw) * patch.vertices_m[:, 0] + 0.003
        )
        assert np.mod(corners, 0.06).min() >= 0.009 - 1e-6
        assert np.mod(corners, 0.06).max() <= 0.021 + 1e-6
        assert np.ptp(corners) + 0.018 + spacing_m == pytest.approx(0.03, abs=0.003)


def test_bars_of_a_course_are_those_of_a_mesh(tmp_path):
    path = np.array([[0.0, 0.0, 0.2], [0.36, 0.0, 0.2]])
    for is_round in (False, True):
        course = Bars(kind="bars", apart_m=0.12, round=is_round, width_m=0.4, friction=0.8).along(
            path, tmp_path
        )
        places = sorted({round(float(patch.centre_m[0]), 6) for patch in course.footholds})
        meshes = [rung(x, 64) if is_round else bar(x, 0.015) for x in places]
        trimesh.util.concatenate(meshes).export(tmp_path / "bars.stl")
        file = FileTerrain(kind="mesh", file="bars.stl", friction=0.8, footholds=FEET).along(
            path, tmp_path
        )
        assert len(file.footholds) == len(course.footholds) == len(places) > 10
        for ours, theirs in zip(
            course.footholds, sorted(file.footholds, key=lambda p: p.centre_m[0]), strict=True
        ):
            assert ours.friction == pytest.approx(theirs.friction)
            assert np.sort(ours.vertices_m, axis=0) == pytest.approx(
                np.sort(theirs.vertices_m, axis=0), abs=2e-5
            )
    with refuses("terrain.bar_m"):
        Bars(kind="bars", bar_m=0.02).along(path, tmp_path)
