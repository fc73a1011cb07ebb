"""Solids behind patches: closed, turned outwards, and never farther than they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.patch import THICKNESS_M, Solid, solids_of

TRIANGLE = Patch(
    vertices_m=[[0.0, 0.0, 1.0], [0.4, 0.0, 1.0], [0.0, 0.3, 1.0]],
    normal=[0, 0, 1],
    shear_reference=[1, 0, 0],
    friction=0.5,
)


def test_its_triangles_are_closed_and_turned_outwards() -> None:
    solid = TRIANGLE.solid
    a, b, c = (solid.corners[solid.triangles[:, i]] for i in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)
    volume = (
        np.einsum("ij,ij->", a, areas) / 3.0
    )  # divergence theorem: positive only if turned outwards
    assert volume == pytest.approx(0.06 * THICKNESS_M)


def test_it_lies_behind_the_surface() -> None:
    solid = TRIANGLE.solid
    assert solid.corners[:, 2].max() == pytest.approx(1.0)
    inside, above, below = solid.distance(
        np.array([[0.1, 0.1, 0.99], [0.1, 0.1, 1.2], [0.1, 0.1, 0.9]])
    )
    assert inside < 0.0
    assert above == pytest.approx(0.2)
    assert below == pytest.approx(0.1 - THICKNESS_M)


@given(st.tuples(*[st.floats(-1.0, 2.0)] * 3))
def test_the_distance_is_never_more_than_the_true_one(point: tuple[float, float, float]) -> None:
    solid = TRIANGLE.solid
    shares = np.random.default_rng(0).dirichlet(np.ones(len(solid.corners)), 500)
    nearest = np.linalg.norm(shares @ solid.corners - np.array(point), axis=1).min()
    assert solid.distance(np.array([point]))[0] <= nearest + 1e-12


def test_a_corner_that_is_given_twice_does_no_harm() -> None:
    doubled = Patch(
        vertices_m=TRIANGLE.vertices_m[[0, 1, 1, 2]],
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    assert len(doubled.solid.corners) == 6


def test_it_is_the_hull_of_its_corners_whichever_way_its_border_turns() -> None:
    rng = np.random.default_rng(3)
    for count in (3, 4, 7):
        turn = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))[:: rng.choice([-1, 1])]
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        border = (
            rng.normal(size=3) + 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:2]
        )
        patch = Patch(vertices_m=border, normal=axes[2], shear_reference=axes[0], friction=0.5)
        solid, hull = patch.solid, Solid.of_corners(patch.solid.corners)
        points = border.mean(axis=0) + rng.normal(size=(200, 3))
        np.testing.assert_allclose(solid.distance(points), hull.distance(points), atol=1e-9)
        volumes = [np.linalg.det(of.corners[of.triangles]).sum() / 6.0 for of in (solid, hull)]
        assert volumes[0] == pytest.approx(volumes[1], abs=1e-9)
        assert volumes[0] > 0.0


def test_solids_made_at_once_are_those_made_one_by_one() -> None:
    rng, patches = np.random.default_rng(5), list[Patch]()
    for count in (3, 4, 4, 7, 3):
        turn = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        border = 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:2]
        border += rng.normal(size=3)
        border += 1e-4 * rng.normal(size=(count, 1)) * axes[2] * (len(patches) == 2)  # a bent one
        patches.append(
            Patch(vertices_m=border, normal=axes[2], shear_reference=axes[0], friction=0.5)
        )
    alone = [Solid.behind(patch.vertices_m, patch.normal) for patch in patches]
    together = solids_of(patches)
    assert [patch.solid for patch in patches] == list(together)
    for one, solid in zip(alone, together, strict=True):
        for name in ("corners", "normals", "offsets_m", "triangles"):
            np.testing.assert_array_equal(getattr(one, name), getattr(solid, name))
