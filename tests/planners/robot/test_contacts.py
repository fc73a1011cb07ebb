"""Feet that are meshes: balls are found, whatever has corners is not, and the robot in a plan's
file keeps them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.robot.contacts import fitted_ball
from stancekit.planners.robot.leg import FootContact
from stancekit.planners.robot.robot_model import RobotModel, model_of
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

pytest.importorskip("pinocchio")
pytest.importorskip("coal")

MIDDLE = np.array([0.01, -0.004, 0.002])


def corners(count: int = 400, radius_m: float = 0.03) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return MIDDLE + radius_m * directions / np.linalg.norm(directions, axis=1)[:, None]


def with_feet(folder: Path, points: np.ndarray) -> RobotModel:
    """A quadruped whose feet are a mesh, the hull of these points."""
    from scipy.spatial import ConvexHull

    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in ConvexHull(points).simplices]
    (folder / "foot.obj").write_text("\n".join(lines) + "\n")
    text = quadruped().replace('<sphere radius="0.02"/>', '<mesh filename="foot.obj"/>')
    return model_of(text, folder=folder)


def test_a_mesh_of_a_ball_is_a_foot_of_its_radius(tmp_path: Path) -> None:
    model = with_feet(tmp_path, corners())
    for leg in model.legs:
        assert leg.radius_m == pytest.approx(0.03, rel=1e-3)
        ankle = model.mounts[leg.foot]
        np.testing.assert_allclose(
            leg.chain.tip_m, ankle.origin_m + ankle.rotation @ MIDDLE, atol=1e-6
        )
    assert any(text.startswith("balls for LF_FOOT, RF_FOOT") for text in model.guesses)
    again = model_of(
        model.urdf, feet={leg.name: leg.foot for leg in model.legs}
    )  # as a plan's file has it
    assert [leg.radius_m for leg in again.legs] == [leg.radius_m for leg in model.legs]


def test_a_ball_that_is_two_millimetres_off_touches_as_one(tmp_path: Path) -> None:
    worn = np.random.default_rng(1).uniform(0.94, 1.0, (400, 1))
    for leg in with_feet(tmp_path, MIDDLE + worn * (corners() - MIDDLE)).legs:
        assert not leg.doubt
        assert leg.radius_m == pytest.approx(0.03, abs=2e-3)


def test_a_mesh_with_corners_is_a_point(tmp_path: Path) -> None:
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [
        0.03,
        0.01,
        0.02,
    ]
    assert all(leg.radius_m == 0.0 for leg in with_feet(tmp_path, box).legs)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ('<box size=".06 .04 .02"/>', "LF_FOOT: {point_m: [0, 0, -0.01], radius_m: 0}"),
        ('<cylinder radius=".01" length=".1"/>', "point_m: [0, 0, -0.05], radius_m: 0}"),
        ('<box size=".2 .1 .004"/>', "point_m: [0, 0, -0.002], radius_m: 0}"),
        ('<box size=".04 .04 .04"/>', "LF_FOOT: {point_m: [0, 0, 0], radius_m: 0.02733"),
    ],
)  # of a cube of half side a the ball between inner and outer one is of (1 + √3) a / 2, 0.0273 m
def test_the_line_to_paste_is_a_ball_that_is_as_near_to_the_foot_as_it_says(
    shape: str, said: str
) -> None:
    model = model_of(quadruped().replace('<sphere radius="0.02"/>', shape))
    with refuses(said):
        model.check_known()


def test_what_a_ball_may_lack() -> None:
    points = corners()
    np.testing.assert_allclose(fitted_ball(points)[0], MIDDLE, atol=1e-9)
    flattened = MIDDLE + (points - MIDDLE) * [1.0, 1.0, 0.5]
    assert fitted_ball(flattened) is None
    aside = np.clip(
        (points - MIDDLE)[:, 1], -0.0155, 0.0155
    )  # sides off, as of wheels with a round tread
    onto = (points - MIDDLE)[:, [0, 2]]
    onto *= (np.sqrt(0.03**2 - aside**2) / np.linalg.norm(onto, axis=1))[:, None]
    cut = MIDDLE + np.column_stack([onto[:, 0], aside, onto[:, 1]])
    assert fitted_ball(cut) is not None
    away = points - MIDDLE
    top = MIDDLE + np.array([0.0, 0.0, 0.0245])
    topped = np.vstack([points[away[:, 2] < 0.024], top])
    # one corner on top, farther from the ball than others may be
    assert fitted_ball(topped)[1] == pytest.approx(0.03, rel=0.03)
    turns = np.linspace(0.0, 2.0 * np.pi, 40)
    can = np.array([[np.cos(t), np.sin(t), z] for t in turns for z in (-1.0, 1.0)])
    assert fitted_ball(can) is None
    assert fitted_ball(points[:3]) is None


def test_bodies_keep_their_hulls_beside_feet_that_become_balls(tmp_path: Path) -> None:
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.01
    (tmp_path / "bone.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in box) + "f 1 2 4 3\nf 5 6 8 7\n"
    )
    text = quadruped(bone='<mesh filename="bone.obj"/>').replace(
        '<sphere radius="0.02"/>', '<box size=".02 .02 .02"/>'
    )
    bone = '<geometry><mesh filename="bone.obj"/></geometry>'  # as body, and as what is seen
    text = text.replace(
        f"<collision>{bone}</collision>", f"<collision>{bone}</collision><visual>{bone}</visual>"
    )
    model = model_of(
        text, folder=tmp_path, contacts={"*_FOOT": FootContact(point_m=np.zeros(3), radius_m=0.01)}
    )
    meshes = [shape for shape in model.shapes if shape.kind == "mesh"]
    assert any(text.startswith("balls for") for text in model.guesses)
    assert len(meshes) == 24
    assert [shape.corners_m is not None for shape in meshes] == [shape.collides for shape in meshes]


def test_a_ball_is_round_where_it_may_touch(tmp_path: Path) -> None:
    points = corners()
    below, turns = (
        points[(points - MIDDLE)[:, 2] < 0.01],
        np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False),
    )
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(60)]) * np.sqrt(
        0.03**2 - 0.01**2
    )
    cut = np.vstack([below, MIDDLE + ring + [0.0, 0.0, 0.01]])  # flat where a shank may be
    assert {leg.radius_m for leg in with_feet(tmp_path, cut).legs} != {0.0}
    flipped = MIDDLE + (cut - MIDDLE) * [1.0, 1.0, -1.0]  # the same, on its flat side
    model = with_feet(tmp_path, flipped)
    assert {leg.radius_m for leg in model.legs} == {0.0}
    with refuses("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"):
        model.check_known()
