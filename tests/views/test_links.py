"""A URDF's own links in scenes: where pinocchio has them, in whatever way they look, in pictures,
pages and films.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.views.film import rendered
from stancekit.views.gaits import GaitView, draw_motion
from stancekit.views.page import page
from stancekit.views.robots import Links, draw_robot
from stancekit.views.scene import Capsule, DrawnBody, Mesh, mesh_of, thinned
from stancekit.views.sheet import to_rgb
from tests.planners.motion.test_plan_motion import leaning
from tests.planners.robot.small_urdfs import quadruped

TURN = np.array(pin.exp3(np.array([0.2, -0.3, 0.5])))
COM = np.array([0.4, -0.3, 0.7])
BLOCK = '<{0}><origin xyz=".01 .02 -.1" rpy=".3 0 0"/><geometry>{1}</geometry></{0}>'


def dressed(what: str = "") -> str:
    """The small quadruped, with more in its shanks."""
    text = quadruped()
    for leg in ("LF", "RF", "LH", "RH"):
        text = text.replace(f'<link name="{leg}_SHANK">', f'<link name="{leg}_SHANK">{what}')
    return text


def bent(model: RobotModel) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [leg.random_angles(1, rng)[0] for leg in model.legs]


def by_name(bodies: list[DrawnBody]) -> dict[str, DrawnBody]:
    assert len({body.name for body in bodies}) == len(bodies)
    return {body.name: body for body in bodies}


def points(body: DrawnBody) -> np.ndarray:
    return mesh_of(body.shape)[0] @ body.rotation.T + body.position_m


def test_links_and_feet_are_where_pinocchio_has_them() -> None:
    text = dressed(BLOCK.format("collision", '<box size=".04 .06 .2"/>'))
    model = model_of(text)
    angles = bent(model)
    bodies = by_name(Links(model).bodies(COM, TURN, angles))
    whole = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    data, q = whole.createData(), pin.neutral(whole)
    q[:3], q[3:7] = COM - TURN @ model.com_m, pin.Quaternion(TURN).coeffs()
    for leg, its in zip(model.legs, angles, strict=True):
        for name, angle in zip(leg.joint_names, its, strict=True):
            q[whole.joints[whole.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(whole, data, q)
    own = pin.SE3(np.array(pin.rpy.rpyToMatrix(0.3, 0.0, 0.0)), np.array([0.01, 0.02, -0.1]))
    corners = np.array(np.meshgrid([-0.02, 0.02], [-0.03, 0.03], [-0.1, 0.1])).reshape(3, -1)
    for leg in model.legs:
        frame = data.oMf[whole.getFrameId(f"{leg.name}_SHANK")] * own
        expected = (frame.rotation @ corners + frame.translation[:, None]).T
        drawn = points(bodies[f"{leg.name} link 2"])
        for corner in expected:
            assert np.linalg.norm(drawn - corner, axis=1).min() < 1e-9
        foot = data.oMf[whole.getFrameId(leg.foot)].translation
        np.testing.assert_allclose(bodies[f"{leg.name} foot"].position_m, foot, atol=1e-9)
    trunk = points(bodies["base"])
    np.testing.assert_allclose(trunk.mean(axis=0), COM - TURN @ model.com_m, atol=1e-9)
    assert len(bodies) == 1 + 4 * 2  # the ball at the foot goes with the shank


def test_what_a_link_looks_like_goes_before_what_it_collides_with() -> None:
    seen = BLOCK.format("visual", '<box size=".04 .06 .4"/>')
    both = dressed(seen + BLOCK.format("collision", '<box size=".5 .5 .5"/>'))
    gone = dressed(
        seen.replace('<box size=".04 .06 .4"/>', '<mesh filename="gone.stl"/>')
        + BLOCK.format("collision", '<box size=".5 .5 .5"/>')
    )
    for text, longest in ((both, 0.4), (gone, 0.5)):
        model = model_of(text)
        mesh = Links(model).meshes[0, 2]
        foot = model.legs[0].chain.tip_m
        far = mesh.vertices_m[
            np.linalg.norm(mesh.vertices_m - foot, axis=1) > 0.03
        ]  # without the ball
        assert np.ptp(far, axis=0).max() == pytest.approx(longest, rel=0.4)


def test_legs_without_shapes_are_bars_from_joint_to_joint() -> None:
    bare = quadruped().replace(
        '<collision><geometry><sphere radius="0.02"/></geometry></collision>', ""
    )
    model = model_of(bare)
    angles = bent(model)
    links = Links(model)
    bodies = by_name(links.bodies(COM, TURN, angles))
    for name, chain in zip(model.leg_names, links.chains(COM, TURN, angles), strict=True):
        bars = [body for key, body in bodies.items() if key.startswith(f"{name} bar")]
        assert sum(
            body.shape.length_m for body in bars if isinstance(body.shape, Capsule)
        ) == pytest.approx(float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()))


def test_meshes_of_files_are_drawn_with_few_triangles_and_legs_share_them(tmp_path: Path) -> None:
    line = np.linspace(-1.0, 1.0, 80)
    grid = [(0.05 * x, 0.05 * y, 0.02 * np.sin(3.0 * x * y) - 0.1) for x in line for y in line]
    faces = [
        (80 * i + j + 1, 80 * i + 80 + j + 1, 80 * i + j + 2) for i in range(79) for j in range(79)
    ]
    text = [f"v {x} {y} {z}" for x, y, z in grid] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "cloth.obj").write_text("\n".join(text))
    urdf = dressed(BLOCK.format("visual", '<mesh filename="cloth.obj"/>'))
    (tmp_path / "q.urdf").write_text(urdf)
    links = Links(named_robot(tmp_path / "q.urdf"))
    for leg in range(4):
        mesh = links.meshes[leg, 2]
        assert isinstance(mesh, Mesh)
        assert 300 < len(mesh.faces) < 3000 + 1000  # and the ball at the foot


def test_a_robot_whose_meshes_are_not_at_hand_is_drawn_by_the_hulls_that_its_file_carries() -> None:
    looks = BLOCK.format("visual", '<mesh filename="package://elsewhere/shank.stl"/>')
    body = BLOCK.format("collision", '<mesh filename="package://elsewhere/shank.stl"/>')
    cube = np.array(list(product((-0.02, 0.02), repeat=3)))
    for what, first in ((looks, False), (body, True), (looks + body, True)):
        model = model_of(dressed(what))
        shapes = tuple(
            replace(shape, corners_m=cube)
            if shape.kind == "mesh" and shape.collides == first
            else shape
            for shape in model.shapes
        )
        bodies = by_name(Links(replace(model, shapes=shapes)).bodies(COM, TURN, bent(model)))
        shanks = [bodies[f"{leg.name} link {len(leg.joints) - 1}"] for leg in model.legs]
        assert [len(points(shank)) >= 8 for shank in shanks] == [True] * 4
        assert not any("bar" in name for name in bodies)


def test_a_walk_is_drawn_with_the_joints_of_its_own_legs() -> None:
    walk = leaning()
    view, model = GaitView(walk), walk.robot.model
    bodies = by_name(list(view.at(20).bodies))
    for leg, toe in zip(model.legs, walk.feet_m[20], strict=True):
        normal = walk.problem.terrain.normal(toe[:2])
        np.testing.assert_allclose(
            bodies[f"{leg.name} foot"].position_m, toe + leg.radius_m * normal, atol=1e-5
        )
    assert {body.name for body in view.at(0).bodies} == set(bodies)
    own, boxes = (
        to_rgb(draw_motion(each, size_px=(480, 360))).astype(int)
        for each in (walk, walk.asked(robot=replace(walk.robot, model=None)))
    )
    assert own.shape == boxes.shape
    assert np.count_nonzero(np.abs(own - boxes).max(axis=2) > 20) > 500


def test_a_page_holds_each_mesh_once_however_long_the_walk_is() -> None:
    walk = leaning()
    try:
        short, long = (page(GaitView(walk).film(step_s=step)) for step in (0.1, 0.01))
    except InvalidInput as error:
        pytest.skip(str(error))
    assert abs(len(long) - len(short)) < 150_000
    assert len(long) < 3_000_000


def test_a_film_has_the_links() -> None:
    motion = GaitView(leaning()).film(step_s=0.1)
    bare = replace(
        motion, moments=[replace(each, bodies=each.bodies[-1:]) for each in motion.moments]
    )
    try:
        ours, none = (list(rendered(each, (320, 240))) for each in (motion, bare))
    except InvalidInput as error:
        pytest.skip(str(error))
    assert len(ours) == len(motion.moments)
    for one, other in zip(ours, none, strict=True):
        assert np.count_nonzero(np.abs(one.astype(int) - other.astype(int)).max(axis=2) > 20) > 2000


def test_every_leg_is_named_beside_its_foot() -> None:
    figure = draw_robot(model_of(quadruped()), size_px=(600, 450))
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(words) == ["LF", "LH", "RF", "RH"]
    assert [text.get_text() for text in figure.texts] == ["quadruped", "4 legs, 12 joints, 22.4 kg"]


def test_a_wider_trunk_covers_more_of_the_picture() -> None:
    wide = quadruped().replace('size="0.6 0.25 0.1"', 'size="0.6 0.25 0.3"')
    pixels = [
        to_rgb(draw_robot(model_of(text), size_px=(400, 300))).astype(int)
        for text in (quadruped(), wide)
    ]
    grey = [int(np.sum((np.ptp(each, axis=2) < 30) & (each.max(axis=2) < 200))) for each in pixels]
    assert grey[1] > 1.3 * grey[0] > 0


def test_a_mesh_is_drawn_and_a_broken_one_is_not(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    corners = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
    faces = [(1, 2, 4), (1, 4, 3), (5, 6, 8), (5, 8, 7), (1, 2, 6), (1, 6, 5), (3, 4, 8), (3, 8, 7)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    ink = []
    for mesh in ("broken.stl", "box.obj"):
        text = quadruped().replace('<box size="0.6 0.25 0.1"/>', f'<mesh filename="{mesh}"/>')
        (tmp_path / "robot.urdf").write_text(text)
        pixels = to_rgb(
            draw_robot(named_robot(tmp_path / "robot.urdf"), size_px=(400, 300))
        ).astype(int)
        ink.append(int(np.sum((np.ptp(pixels, axis=2) < 30) & (pixels.max(axis=2) < 200))))
    assert ink[1] > ink[0] + 1000


def test_a_line_keeps_the_corners_that_its_bends_need():
    """A parabola's pieces leave it by κ L²/8; what is straight is one piece."""
    flat = np.column_stack([np.linspace(0.0, 1.0, 401), np.zeros(401), np.zeros(401)])
    assert np.array_equal(thinned(flat, 1e-6), flat[[0, -1]])
    bent = np.column_stack([flat[:, 0], np.zeros(401), 0.5 * flat[:, 0] ** 2])
    kept = thinned(bent, 1e-3)
    assert 6 <= len(kept) <= 26
    assert np.abs(np.interp(bent[:, 0], kept[:, 0], kept[:, 2]) - bent[:, 2]).max() < 2e-3
