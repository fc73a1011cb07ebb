"""Robots of our own making: what is read of them, what is refused, and that the sound ones stand
where plans say.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stancekit.planners.formats.motion_file import check_file, write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.hulls import hull_corners
from stancekit.planners.robot.leg import FootContact, rotation_of
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.robot.walker import walker_of
from stancekit.planners.search.methods import make_planner
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.runner.worlds.simulation import simulated_body
from tests.planners.robot.made_robots import (
    FILES,
    PLACES,
    Made,
    R,
    lowest_m,
    made_robots,
    obj,
    quadruped,
)

pytest.importorskip("pinocchio")
pytest.importorskip("coal")
from stancekit.planners.robot.bodies import Bodies
from stancekit.planners.robot.inverse_kinematics import WholeBody
from stancekit.planners.robot.kinematics import Kinematics
from tests.refusals import refuses

MADE = {made.name: made for made in made_robots()}
UP = np.array([0.0, 0.0, 1.0])


def read(name: str, folder: Path) -> RobotModel:
    return named_robot(MADE[name].write(folder))


def said(model: RobotModel, kind: str = "doubt") -> str:
    return "\n".join(model.guesses if kind == "guess" else model.doubts)


def planned(path: Path, model: RobotModel) -> tuple[Any, Any]:
    """A plan of one key frame on level ground, and what the verifier says."""
    (path.parent / "course.yaml").write_text(
        f"name: level\nrobot: {path.name}\nframes: 1\ngait: wave\nstart_m: [0, 0]\n"
        f"goal_m: [0, 0, {model.stand_height_m}]\nterrain: {{kind: flat, friction: 0.7}}\n"
    )
    course = read_course(path.parent / "course.yaml")
    outcome = plan_course(course, make_planner("two-stage", of="courses"))
    return outcome.solution, outcome.report


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("shape", "below_m"), [("sphere", 0.0), ("capsule", 0.0), ("ball-mesh", 0.0)]
)
def test_a_leg_that_ends_in_a_ball_touches_with_it_wherever_in_its_last_body_it_is(
    shape: str, below_m: float, place: str, tmp_path: Path
) -> None:
    model = read(f"{shape}-{place}", tmp_path)
    for leg in model.legs:
        assert leg.radius_m == pytest.approx(R, abs=2e-4)
        np.testing.assert_allclose(leg.chain.tip_m, [0.0, 0.0, -0.2 - below_m], atol=2e-4)
        assert leg.foot == f"{leg.name}_{'shank' if place == 'on-shank' else 'foot'}"
    assert "touches with" not in said(model)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("shape", "kind"), [("box", "box"), ("cylinder", "cylinder"), ("cone-mesh", "mesh")]
)
def test_of_any_other_shape_a_person_has_to_say_what_touches(
    shape: str, kind: str, place: str, tmp_path: Path
) -> None:
    model = read(f"{shape}-{place}", tmp_path)
    foot = "shank" if place == "on-shank" else "foot"
    assert f"links LF_{foot}, RF_{foot}, LH_{foot}, RH_{foot}: touches with a {kind}" in said(model)
    with refuses(*(f"{leg}_{foot}" for leg in ("LF", "RF", "LH", "RH")), kind) as refusal:
        walker_of(model, [])
    example = yaml.safe_load(
        re.findall(r"e\.g\. (\{.*\}\}), the (?:ball|point)", str(refusal.value))[0]
    )
    assert set(example) == {f"LF_{foot}"}
    contact = FootContact(**example[f"LF_{foot}"])
    model_of(model.urdf, folder=tmp_path, contacts={f"*_{foot}": contact}).check_known()


@pytest.mark.parametrize("name", ["capsule-on-shank", "box-in-a-ball", "y-up-told"])
def test_sound_robots_are_planned_and_stand_on_the_ground(name: str, tmp_path: Path) -> None:
    path = MADE[name].write(tmp_path)
    model = named_robot(path)
    plan, report = planned(path, model)
    assert report.accepted, report.message
    if MADE[name].keys.startswith("contacts"):
        (tmp_path / "robot.urdf").write_text(model.urdf)
    rpy = np.array([np.pi / 2.0 if name == "y-up-told" else 0.0, 0.0, 0.0])
    standing = dict(
        zip(model.joint_names, np.concatenate([leg.stance_rad for leg in model.legs]), strict=True)
    )
    posture = dict(zip(model.joint_names, plan.joints_rad[0], strict=True))
    turn = rotation_of(plan.rotation_rad[0])
    low = lowest_m(tmp_path / "robot.urdf", standing, posture, plan.com_m[0], turn, rpy)
    for leg in model.leg_names:
        assert abs(min(z for link, z in low.items() if link.startswith(leg))) < 1e-3


def test_points_that_a_person_says_are_of_shapes_that_stay_judged(tmp_path: Path) -> None:
    path = MADE["wheel-as-a-point"].write(tmp_path)
    plan, report = planned(path, named_robot(path))
    assert plan is None or report is None or not report.accepted


def test_a_plan_of_another_robots_meshes_is_refused_and_no_folder_is_in_it(tmp_path: Path) -> None:
    plain, fin = (
        MADE[name].write(tmp_path / name) for name in ("shanks-of-meshes", "shanks-with-a-fin")
    )
    assert plain.read_text() == fin.read_text()
    plan, report = planned(plain, named_robot(plain))
    assert report.accepted, report.message
    file = tmp_path / "plan.json"
    write_motion(file, plan, report)
    assert str(tmp_path) not in file.read_text()
    assert check_file(file, robot=str(plain)).accepted
    with refuses("made"):
        check_file(file, robot=str(fin))
    for each in plain.parent.glob("*.obj"):
        each.unlink()  # what is judged travels with the plan
    assert check_file(file).accepted


@pytest.mark.parametrize("place", ["own-link", "on-shank"])
def test_a_shank_in_a_ridge_is_found_whether_or_not_its_foot_is_a_shape_of_it(
    place: str, tmp_path: Path
) -> None:
    model = read(f"sphere-{place}", tmp_path)
    kinematics = Kinematics(robot_of(model))
    angles = np.concatenate([leg.stance_rad for leg in model.legs])
    feet = np.array([leg.nominal_m for leg in model.legs])
    height = R - float(feet[:, 2].min())
    turns, origins = model.legs[0].chain.frames(model.legs[0].stance_rad[None])
    middle = origins[0, -1] + turns[0, -1] @ [0.0, 0.0, -0.1] + height * UP

    def body(ridge_m: float) -> list[str]:
        def heights(x: Any, y: Any) -> Any:
            return ridge_m * np.exp(
                -(((x - middle[0]) / 0.02) ** 2) - ((y - middle[1]) / 0.02) ** 2
            )

        ground = HeightField.from_function(heights, 1.0, 0.01, name="ridge")
        made = Bodies(kinematics, Obstacles.under(ground))
        toes = feet + height * UP - R * UP
        posture = WholeBody(
            rotation=np.eye(3),
            origin_m=height * UP,
            angles=angles,
            toes_m=toes,
            normals=np.tile(UP, (4, 1)),
            stands=np.ones(4, dtype=bool),
        )
        return [link for _, link, _ in made.overlaps(posture)]

    assert body(0.0) == []
    assert "LF_shank" in body(float(middle[2]) + 0.02)


def test_hulls_are_of_all_corners() -> None:
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    points = 0.1 * directions / np.linalg.norm(directions, axis=1)[:, None]
    points[1234] = [0.0, 0.0, 0.3]
    corners = hull_corners(points)
    assert corners is not None
    np.testing.assert_allclose(corners.max(axis=0)[2], 0.3)
    assert len(corners) > 10_000
    assert hull_corners(np.zeros((10, 3))) is None


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("negative-moment", "link trunk: a moment of inertia of -0.02 kg m²"),
        ("broken-triangle", "link trunk: moments of inertia that no body has"),
        ("moments-in-kg-mm2", "link trunk: a moment of inertia of 1e+05 kg m², of 6 kg within"),
        ("trunk-without-mass", "link trunk: the trunk weighs nothing"),
        ("feet-without-mass", "links LF_foot, RF_foot, LH_foot, RH_foot: a foot without a mass"),
        ("joints-without-effort", "no torque limit"),
        ("knees-that-slide", "joints LF_KFE, RF_KFE, LH_KFE, RH_KFE: slides"),
        ("in-millimetres", "m: other units?"),
        ("a-heel-below-its-foot", "LF_shank: touches with a box"),
        ("feet-missing", "touches with a mesh that cannot be had"),
        ("feet-squashed", "touches with a mesh"),
        ("feet-of-no-size", "LF_foot, RF_foot, LH_foot, RH_foot: a shape of no size"),
    ],
)
def test_what_no_robot_has_is_a_doubt_that_names_the_link(
    name: str, line: str, tmp_path: Path
) -> None:
    assert line in said(read(name, tmp_path))


CONE = '<collision><geometry><cone radius="0.1" length="0.3"/></geometry></collision>'
HEAD = (
    '</link><link name="head"><inertial><mass value="3"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/>'
    '</inertial></link><joint name="neck" type="fixed"><parent link="trunk"/><child link="head"/>'
    '<origin xyz="0 0 2"/></joint>'
)
LIGHT_HEAD = HEAD.replace('"3"', '"0.3"').replace('"0.01"', '"4e-18"')


@pytest.mark.parametrize(
    ("there", "instead", "line", "unseen"),
    [
        ("</link>", f"{CONE}</link>", "link trunk: a shape of cone", "link trunk"),
        ("</link>", "<colision/></link>", "link trunk: <colision>", ""),
        ("</link>", HEAD, "link head: no shape about its centre of mass", "link head"),
        ("<inertia ", "<inertias ", "of 6 kg: denser than any body", ""),
        (
            "</link>",
            LIGHT_HEAD,
            "link head: a moment of inertia of 4e-18 kg m² of 0.3 kg: denser",
            "",
        ),
        ("<limit ", "<limits ", "<limits>, which is not known", ""),
    ],
)
def test_what_was_not_looked_at_is_a_doubt(
    there: str, instead: str, line: str, unseen: str
) -> None:
    model = model_of(quadruped().replace(there, instead, 1), where="made")
    assert line in said(model)
    assert any(unseen in each for each in model.link_shapes[1]) == bool(unseen)


@pytest.mark.parametrize("ends", [("LF_foot", "LF_hip"), ("LF_foot", "trunk"), ("a", "a")])
def test_what_is_no_tree_is_refused_before_it_ends_the_process(ends: tuple[str, str]) -> None:
    tail = '<link name="a"/><joint name="tail" type="fixed"><parent link="{}"/><child link="{}"/>'
    with refuses("link"):
        model_of(quadruped().replace("</robot>", f"{tail.format(*ends)}</joint></robot>"), where="")


def test_what_cannot_be_read_as_a_robot_is_refused_with_its_link(tmp_path: Path) -> None:
    with refuses("LF_shank", "-0.15 kg"):
        read("shanks-of-negative-mass", tmp_path / "a")
    with refuses("LF_HFE"):
        read("knees-that-mimic", tmp_path / "b")


@pytest.mark.parametrize("name", ["arm-on-the-back", "chain-in-front", "two-arms", "tail"])
def test_arms_and_tails_are_no_legs(name: str, tmp_path: Path) -> None:
    assert read(name, tmp_path).leg_names == ("LF", "RF", "LH", "RH")


def test_a_root_whose_z_is_not_up_is_settled_by_a_person(tmp_path: Path) -> None:
    model = read("y-up", tmp_path / "a")
    assert "z does not point up" in said(model)
    with refuses():
        model.check_known()
    read("y-up-told", tmp_path / "b").check_known()


@pytest.mark.parametrize("name", ["floating-root", "planar-root", "fixed-root"])
def test_a_root_joint_that_flies_is_the_base(name: str, tmp_path: Path) -> None:
    model, plain = read(name, tmp_path / "a"), read("sphere-own-link", tmp_path / "b")
    assert model.joint_names == plain.joint_names
    assert model.mass_kg == pytest.approx(plain.mass_kg)
    np.testing.assert_allclose(model.com_m, plain.com_m, atol=1e-9)


@pytest.mark.parametrize("kind", ["floating", "fixed", "planar", "prismatic", "revolute"])
def test_a_base_that_a_joint_leaves_some_ways_alone_is_doubted(kind: str, tmp_path: Path) -> None:
    tie = (
        f'<link name="world"/><joint name="root" type="{kind}"><parent link="world"/><child link="trunk"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint></robot>'
    )
    urdf = quadruped().replace("</robot>", tie)
    robot = robot_of(named_robot(Made(name="tied", urdf=urdf).write(tmp_path)))
    assert ("joint root: is " in str(robot.doubts)) == (kind not in ("floating", "fixed"))


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_joint_that_flies_between_two_links_is_named(kind: str, tmp_path: Path) -> None:
    loose = f'<link name="pack"/><joint name="strap" type="{kind}"><parent link="trunk"/><child link="pack"/></joint>'
    carried = Made(name="carried", urdf=quadruped().replace("</robot>", f"{loose}</robot>"))
    legless = Made(name="legless", urdf=quadruped().replace('type="revolute"', f'type="{kind}"', 1))
    for made, joint in ((carried, "strap"), (legless, "LF_HAA")):
        with refuses(joint):
            named_robot(made.write(tmp_path))


def test_what_run_cannot_do_is_known_before(tmp_path: Path) -> None:
    assert "slides" in read("knees-that-slide", tmp_path / "a").unrunnable[0]
    assert "no torque limit" in read("joints-without-effort", tmp_path / "b").unrunnable[0]
    assert read("sphere-own-link", tmp_path / "c").unrunnable == ()


@pytest.mark.parametrize(("name", "legs"), [("eight-legs", 8)])
def test_walks_of_other_numbers_of_legs_are_refused_in_words(
    name: str, legs: int, tmp_path: Path
) -> None:
    with refuses(str(legs)):
        walker_of(read(name, tmp_path))


@pytest.mark.parametrize(
    ("size", "lag_s"), [(0.25, 0.0231), (0.75, 0.04), (1.0, 0.04), (4.0, 0.04)]
)
def test_loops_of_a_small_robot_lag_by_less(size: float, lag_s: float) -> None:
    model = model_of(quadruped(s=size))
    assert model.size == pytest.approx(size)
    stiffness, damping, _ = model.drive
    assert damping / stiffness == pytest.approx(lag_s, rel=2e-3)


def test_contacts_of_no_leg_are_refused(tmp_path: Path) -> None:
    keys = "contacts: {XY_foot: {radius_m: 0.04}}\n"
    with refuses("contacts", "LF_foot"):
        named_robot(Made(name="x", urdf=quadruped(shape="box"), keys=keys).write(tmp_path))


def test_a_foot_of_a_mesh_stays_the_same_robot_whatever_lies_beside_it(tmp_path: Path) -> None:
    before = named_robot(
        Made(name="x", urdf=quadruped(shape="ball-mesh"), files=FILES["ball-mesh"]).write(tmp_path)
    )
    (tmp_path / "ball.obj").write_text(
        obj(np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]))
    )
    assert named_robot(tmp_path / "robot.urdf").digest != before.digest
    assert "mesh" not in before.urdf


def test_a_frame_with_a_placeholder_for_its_inertia_is_no_doubt(tmp_path: Path) -> None:
    """1e-6 in all entries, as frames of published robots have it, has moments of 3e-6, 0 and 0."""
    entries = " ".join(f'{name}="1e-6"' for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    frame = (
        f'<link name="frame"><inertial><mass value="1e-6"/><inertia {entries}/></inertial></link>'
        '<joint name="hold" type="fixed"><parent link="trunk"/><child link="frame"/></joint></robot>'
    )
    model = model_of(quadruped().replace("</robot>", frame), where="made")
    assert "frame" not in said(model)
    assert 'name="frame"' in simulated_body(model).urdf


@pytest.mark.parametrize(("times", "doubted"), [(1.0, False), (100.0, True)])
def test_a_sensor_whose_slight_inertia_no_body_has_is_no_doubt(times: float, doubted: bool) -> None:
    """ANYmal C's depth cameras have moments of 0.00137, 0.000669 and 0.00000867 kg m²."""
    moments = zip(("ixx", "iyy", "izz"), (1.37e-3, 6.69e-4, 8.67e-6), strict=True)
    entries = " ".join(f'{name}="{times * value:g}"' for name, value in moments)
    camera = (
        f'<link name="camera"><inertial><mass value="0.06"/><inertia {entries}/></inertial></link>'
        '<joint name="hold" type="fixed"><parent link="trunk"/><child link="camera"/></joint></robot>'
    )
    model = model_of(quadruped().replace("</robot>", camera), where="made")
    assert ("camera: moments of inertia that no body has" in said(model)) == doubted
    if doubted:
        with refuses("link camera"):
            simulated_body(model)
        return
    assert 'name="camera"' in simulated_body(model).urdf
    pytest.importorskip("mujoco")
    from stancekit.runner.worlds.world import make_world

    with make_world("mujoco", robot_of(model)):
        pass
