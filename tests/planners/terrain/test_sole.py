"""Soles: where their points are, and where on a patch their centre may be."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.polygon import checked_sole, sole_offsets, sole_region
from tests.refusals import refuses

SOLE = np.array([[0.11, 0.05], [0.11, -0.05], [-0.09, -0.05], [-0.09, 0.05]])


def ground(vertices) -> Patch:
    """A level patch whose forward axis is x."""
    vertices = np.column_stack([vertices, np.full(len(vertices), 0.3)])
    return Patch(
        vertices_m=vertices, normal=[0.0, 0.0, 1.0], shear_reference=[1.0, 0.0, 0.0], friction=0.5
    )


def test_a_sole_looks_forward_at_yaw_zero_and_turns_to_the_left():
    patch = ground([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    np.testing.assert_allclose(sole_offsets(SOLE, patch, 0.0)[:, :2], SOLE, atol=1e-15)
    np.testing.assert_allclose(
        sole_offsets(SOLE, patch, 0.5 * np.pi)[0], [-0.05, 0.11, 0.0], atol=1e-15
    )


@pytest.mark.parametrize("seed", range(6))
def test_the_centre_is_where_all_points_are_on_the_patch(seed):
    """Against every point's own place on polygons of all slopes, by the side of each edge that it
    is on.
    """
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    count = int(rng.integers(3, 8))
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    flat = 0.4 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    patch = Patch(
        vertices_m=flat @ rotation.T + rng.normal(size=3),
        normal=rotation[:, 2] * np.linalg.det(rotation),
        shear_reference=rng.normal(size=3),
        friction=0.5,
    )
    offsets = sole_offsets(SOLE, patch, rng.uniform(-3.0, 3.0))
    gaps = np.linalg.norm(offsets[:, None] - offsets, axis=-1)
    np.testing.assert_allclose(
        gaps, np.linalg.norm(SOLE[:, None] - SOLE, axis=-1), atol=1e-12
    )  # rigid
    np.testing.assert_allclose(offsets @ patch.normal, 0.0, atol=1e-12)
    region = sole_region(patch, offsets)

    def inside(border: np.ndarray, points: np.ndarray) -> np.ndarray:
        edges = np.roll(border, -1, axis=0) - border
        turns = np.cross(edges, points[:, None] - border) @ patch.normal
        return np.all(turns >= 0.0, axis=1) | np.all(turns <= 0.0, axis=1)

    tried = patch.vertices_m.mean(axis=0) + rng.uniform(-0.4, 0.4, (4000, 2)) @ patch.frame[:, 1:].T
    on = np.all([inside(patch.vertices_m, tried + offset) for offset in offsets], axis=0)
    assert 0 < on.sum() < len(on)
    assert np.array_equal(inside(region.vertices_m, tried), on)


def test_bad_soles_and_patches_without_room_are_refused_in_one_line():
    for points, message in (
        (SOLE[:2], "sole_m"),
        (
            [[0.0, 0.0], [0.1, 0.1], [0.2, 0.2]],
            "sole_m",
        ),
        ([[0.0, 0.0, 0.0]], "sole_m"),
    ):
        with refuses(message):
            checked_sole(points, "sole_m")
    beam = ground([[-0.4, -0.06], [0.4, -0.06], [0.4, 0.06], [-0.4, 0.06]])
    assert len(sole_region(beam, sole_offsets(SOLE, beam, 0.0)).vertices_m) == 4
    with refuses("sole"):
        sole_region(beam, sole_offsets(SOLE, beam, 0.5 * np.pi))
    bent = beam.vertices_m.copy()
    bent[1, 2] += 1e-4
    bent = Patch(
        vertices_m=bent, normal=[0.0, 0.0, 1.0], shear_reference=[1.0, 0.0, 0.0], friction=0.5
    )
    with refuses("sole"):
        sole_region(bent, sole_offsets(SOLE, bent, 0.0))
