"""Walkers from robots' models: boxes that legs reach and that do not cross, old and new files, and
what is refused.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.answer.trajectory import robot_from_json
from stancekit.planners.robot.hulls import Polytope
from stancekit.planners.robot.inverse_kinematics import InverseKinematics
from stancekit.planners.robot.leg import FootContact
from stancekit.planners.robot.model import Robot, hexapod
from stancekit.planners.robot.robot_file import drawn_urdf, named_robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import anymal, named_walker, walker_of
from tests.refusals import refuses

from .small_urdfs import HIPS, fixed, joint, leg, link, quadruped, robot

pin = pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def walker() -> Robot:
    return walker_of(model_of(quadruped()))


def test_the_box_about_a_point_has_more_room_on_its_six_sides_than_any_other() -> None:
    rng = np.random.default_rng(0)
    normals = np.vstack([np.eye(3), -np.eye(3), rng.normal(size=(12, 3))])
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    inner, point = (
        Polytope(normals=normals, offsets_m=rng.uniform(0.8, 1.2, len(normals))),
        np.array([0.3, -0.2, 0.1]),
    )
    low, high = inner.box_about(point, 0.05)

    def corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return np.array([np.where(bits, high, low) for bits in np.ndindex(2, 2, 2)])

    assert np.all(corners(low, high) @ normals.T <= inner.offsets_m + 1e-9)
    best = np.prod(high - point) * np.prod(point - low)
    for _ in range(2000):
        down, up = rng.uniform(0.2, 1.0, (2, 3))
        out = corners(-down, up) @ normals.T
        share = float(
            np.min((inner.offsets_m - normals @ point) / np.maximum(out, 1e-12).max(axis=0))
        )
        assert share**6 * np.prod(down) * np.prod(up) <= best * (1.0 + 1e-6)


def test_the_box_about_a_point_of_a_box_is_that_box_and_outside_there_is_none() -> None:
    sides = Polytope(
        normals=np.vstack([np.eye(3), -np.eye(3)]), offsets_m=[1.0, 2.0, 3.0, 1.0, 1.0, 1.0]
    )
    box = sides.box_about(np.array([0.9, 0.0, 0.0]), 0.05)
    np.testing.assert_allclose(box, [[-1.0, -1.0, -1.0], [1.0, 2.0, 3.0]], atol=1e-6)
    with refuses("polytope"):
        sides.box_about(np.array([1.5, 0.0, 0.0]), 0.05)


def test_a_walker_weighs_what_its_urdf_weighs_as_it_stands(walker: Robot) -> None:
    model, whole = walker.model, pin.buildModelFromXML(quadruped(), pin.JointModelFreeFlyer())
    assert model is not None
    data, q = whole.createData(), pin.neutral(whole)
    for each in model.legs:
        for name, angle in zip(each.joint_names, each.stance_rad, strict=True):
            q[whole.joints[whole.getJointId(name)].idx_q] = angle
    pin.ccrba(whole, data, q, np.zeros(whole.nv))
    assert walker.mass_kg == pytest.approx(data.Ig.mass)
    np.testing.assert_allclose(walker.inertia_kgm2, data.Ig.inertia, atol=1e-9)
    pin.framesForwardKinematics(whole, data, q)
    for foot in walker.feet:
        centre = data.oMf[whole.getFrameId(f"{foot.name}_FOOT")].translation - data.com[0]
        np.testing.assert_allclose(foot.nominal_m, centre - [0.0, 0.0, 0.02], atol=1e-9)
    np.testing.assert_allclose(
        walker.trunk_half_m, np.array([0.3, 0.125, 0.05]) + np.abs(data.com[0]) * [1, 1, -1]
    )


def test_toes_in_the_boxes_are_reached_whichever_way_the_ground_faces(walker: Robot) -> None:
    rng, model = np.random.default_rng(1), walker.model
    assert model is not None
    for foot, each in zip(walker.feet, model.legs, strict=True):
        toes = rng.uniform(foot.reach_min_m, foot.reach_max_m, (1000, 3))
        normals = rng.normal(size=(1000, 3))
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        centres = toes + each.radius_m * normals + model.com_m
        _, error = InverseKinematics([each], [each.random_angles(8000, rng)]).solve(
            centres[:, None]
        )
        assert np.mean(error > 1e-4) <= 0.006
        assert np.prod(foot.reach_max_m - foot.reach_min_m) > 0.002


def test_no_two_boxes_cross_and_none_is_above_its_ceiling(walker: Robot) -> None:
    model = walker.model
    assert model is not None
    strict = walker_of(model, ceiling_m=-0.3, inner_m=0.03)
    for robot_, apart, ceiling in ((walker, 0.0, 0.0), (strict, 0.06, -0.3)):
        for i, one in enumerate(robot_.feet):
            assert one.reach_max_m[2] <= ceiling + 1e-9
            for other in robot_.feet[:i]:
                gap = np.maximum(
                    one.reach_min_m - other.reach_max_m, other.reach_min_m - one.reach_max_m
                )[:2]
                assert (
                    gap.max() >= 0.7 * apart - 1e-3
                )  # half-planes of feet that do not stand quite in a rectangle


def test_a_name_a_urdf_and_a_file_are_the_same_for_climbs_and_for_walks(
    tmp_path: Path, walker: Robot
) -> None:
    (tmp_path / "q.urdf").write_text(quadruped())
    (tmp_path / "q.yaml").write_text("urdf: q.urdf\ntrunk_half_m: [0.2, 0.1, 0.05]\nname: dog\n")
    plain, corrected = named_walker(tmp_path / "q.urdf"), named_walker(tmp_path / "q.yaml")
    assert (plain.name, corrected.name) == ("quadruped", "dog")
    assert (
        named_robot(tmp_path / "q.yaml").leg_names
        == corrected.limb_names
        == ("LF", "RF", "LH", "RH")
    )
    assert corrected.trunk_half_m.tolist() == [0.2, 0.1, 0.05]
    for ours, theirs in zip(plain.feet, walker.feet, strict=True):
        np.testing.assert_array_equal(ours.reach_min_m, theirs.reach_min_m)
    assert named_walker("anymal-boxes").model is None
    assert named_walker("hexapod").limb_names == named_robot("hexapod").leg_names


FILE = """
urdf: robot.urdf
feet: [RH_FOOT, LF_FOOT, RF_FOOT]
posture_rad: {"*_HAA": 0.1, "*_HFE": 0.6, "*_KFE": -1.0}
trunk_half_m: [0.2, 0.1, 0.05]
ceiling_m: -0.1
"""


def test_legs_of_four_joints_are_walked_on(tmp_path: Path) -> None:
    (tmp_path / "six.urdf").write_text(drawn_urdf(hexapod()))
    (tmp_path / "six.yaml").write_text(
        "urdf: six.urdf\nfeet: [LF_foot, RF_foot, LR_foot, RR_foot]\ntrunk_half_m: [0.1, 0.1, 0.04]\n"
    )
    found = named_walker(tmp_path / "six.yaml")
    assert found.model is not None
    assert {len(each.joints) for each in found.model.legs} == {4}
    for foot in found.feet:
        assert np.all(foot.reach_max_m - foot.reach_min_m > 0.02)
        assert np.all(np.linalg.norm(foot.nominal_m - foot.hip_m) < 0.35)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (("ceiling_m: -0.1", "wings: 2"), "wings"),
        (("ceiling_m: -0.1", "ceiling_m: low"), "ceiling_m"),
        (("ceiling_m: -0.1", "ranges_rad: [[0.3, 0.2]]"), "ranges_rad"),
        (("feet: [RH_FOOT, LF_FOOT, RF_FOOT]", "feet: 3"), "feet"),
        (
            ('posture_rad: {"*_HAA": 0.1, "*_HFE": 0.6, "*_KFE": -1.0}', "posture_rad: [0.1, 0.6]"),
            "posture_rad",
        ),
        (("robot.urdf", "none.urdf"), "none.urdf"),
        (("[0.2, 0.1, 0.05]", "[0.2, 0.1, 0.0]"), "trunk_half_m[2]"),
        (("RH_FOOT", "paw"), "paw"),
    ],
)
def test_a_file_that_names_a_urdf_says_what_is_wrong_with_it(
    tmp_path: Path, change: tuple[str, str], name: str
) -> None:
    (tmp_path / "robot.urdf").write_text(quadruped())
    (tmp_path / "robot.yaml").write_text(FILE.replace(*change))
    with refuses("robot.yaml", name):
        named_walker(tmp_path / "robot.yaml")


SOLE = FootContact(point_m=np.zeros(3), sole_m=np.array([[0.04, 0], [-0.04, 0.04], [-0.04, -0.04]]))


@pytest.mark.parametrize(
    ("text", "options", "name"),
    [
        (quadruped(mass=0.0), {}, "urdf"),
        (robot([leg("LF"), leg("RF")]), {}, "robot quadruped"),
        (
            robot(
                [
                    link(f"A{n}")
                    + joint(f"a{n}", "base", f"A{n}", f"{x} {y} 0")
                    + link(f"B{n}")
                    + joint(f"b{n}", f"A{n}", f"B{n}", "0 0 -.3")
                    + link(f"F{n}")
                    + fixed(f"f{n}", f"B{n}", f"F{n}", "0 0 -.3")
                    for n, (x, y) in enumerate(HIPS.values())
                ]
            ),
            {},
            "leg",
        ),
        (quadruped().replace("<box", "<none"), {}, "trunk_half_m"),
        (quadruped(), {"contacts": {"*_FOOT": SOLE}}, "a walk, got soles"),
    ],
)
def test_robots_that_cannot_walk_are_refused_in_one_line(
    text: str, options: dict, name: str
) -> None:
    with refuses(name):
        walker_of(model_of(text, **options))


def test_a_walkers_model_goes_into_files_and_comes_out_again(walker: Robot) -> None:
    written = json.loads(json.dumps(walker.to_json()))
    again = robot_from_json(written)
    assert again.model is not None
    assert walker.model is not None
    assert again.model.digest == walker.model.digest
    assert again.to_json() == written
    with refuses("robot quadruped", "feet"):
        robot_from_json(written | {"feet": written["feet"][::-1]})
    with refuses("model.wings"):
        robot_from_json(written | {"model": written["model"] | {"wings": 2}})
    with refuses("robot", "model", "digest"):
        robot_from_json(written | {"model": written["model"] | {"digest": "0"}})
    del written["model"]
    assert robot_from_json(written).model is None


def test_a_robot_that_stands_with_straight_legs_walks_with_bent_ones(walker: Robot) -> None:
    straight = walker_of(
        model_of(quadruped(), posture_rad={"*_HAA": 0.0, "*_HFE": 0.2, "*_KFE": -0.3})
    )
    model = straight.model
    assert model is not None
    assert straight.stand_height_m < model.stand_height_m - 0.02
    heights = [foot.nominal_m[2] for foot in straight.feet]
    assert np.mean(heights) == pytest.approx(-straight.stand_height_m)
    for foot, each in zip(straight.feet, model.legs, strict=True):
        np.testing.assert_allclose(foot.nominal_m[:2], (each.nominal_m - model.com_m)[:2])
        assert (
            min(*(foot.reach_max_m - foot.nominal_m), *(foot.nominal_m - foot.reach_min_m)) > 0.01
        )
    with refuses():
        walker_of(model, ceiling_m=-0.58)


def test_anymal_is_the_robot_of_the_paper_and_bad_files_say_all_that_is_wrong(
    tmp_path: Path,
) -> None:
    found = anymal()
    assert found.mass_kg == pytest.approx(30.475)
    assert found.limb_names == ("LF", "RF", "LH", "RH")
    for foot in found.feet:
        assert foot.nominal_m[2] == pytest.approx(-found.stand_height_m)
    assert found.feet[0].reach_min_m.tolist() == [0.155, 0.095, -0.465]
    bad = tmp_path / "robot.yaml"
    bad.write_text("name: x\nwings: 2\n")
    with refuses("robot.yaml", "mass_kg", "wings"):
        named_walker(bad)
    bad.write_text(
        "name: x\nmass_kg: 1\ninertia_kgm2: 1\nstand_height_m: 1\ntrunk_half_m: 1\nfeet: [{name: a}]\n"
    )
    with refuses("feet[0].nominal_m"):
        named_walker(bad)
