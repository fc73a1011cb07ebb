"""Motions leave as other programs read them: each format is read back by somebody who knows nothing
of the package.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

import stancekit
from stancekit import Motion
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import yaml_of
from stancekit.planners.formats.table_file import csv_of, joint_trajectory_bytes, read_table
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S
from stancekit.planners.motion.motion import MotionTable
from stancekit.planners.robot.model import walking_robot
from stancekit.planners.robot.robot_file import provider_folder, robot_of
from stancekit.planners.verify.motions import check_motion
from stancekit.runner.export.formats import FORMATS, Moved, moved_of, played, read_keys
from stancekit.runner.motion.time_parametrization import streamed
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses


@pytest.fixture(scope="module")
def plan() -> Motion:
    found = stancekit.plan("walls", frames=3).solution
    assert found is not None
    return found


@pytest.fixture(scope="module")
def walk() -> Motion:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    found = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    assert found is not None
    return found


@pytest.fixture(scope="module")
def moved(walk: Motion) -> Moved:
    return moved_of(walk, "mujoco", source="walk.json")


def test_the_table_is_the_motion_that_runs(plan: Motion) -> None:
    table, motion = moved_of(plan, "csv").table, streamed(plan)
    at = motion.at(table.time_s)
    assert "angles_rad" in table.columns
    np.testing.assert_array_equal(table.columns["angles_rad"], at.angles_rad)
    np.testing.assert_array_equal(table.columns["torques_nm"], at.torques_nm)
    np.testing.assert_array_equal(table.columns["forces_n"], at.forces_n)
    assert table.time_s[-1] == pytest.approx(motion.duration_s)


def test_the_rate_is_the_one_asked_for_and_samples_of_a_walk_are_its_own(walk: Motion) -> None:
    table = moved_of(walk, "csv", 200.0).table
    rows = np.rint((walk.times_s - walk.times_s[0] + WALK_SETTLE_S) * 200.0).astype(int)
    assert table.rate_hz == pytest.approx(200.0)
    np.testing.assert_allclose(table.columns["com_m"][rows], walk.torso_m, atol=1e-9)
    np.testing.assert_allclose(table.columns["forces_n"][rows], walk.forces_n, atol=1e-7)


@pytest.mark.parametrize("to", ["csv", "npz"])
def test_tables_come_back_to_the_last_bit(to: str, moved: Moved, tmp_path: Path) -> None:
    path = tmp_path / f"walk{FORMATS[to].suffixes[0]}"
    FORMATS[to].write(moved, path)
    back, table = read_table(path), moved.table
    assert (back.joints, back.limbs) == (table.joints, table.limbs)
    assert set(back.arrays()) == set(table.arrays())
    for name, array in table.arrays().items():
        np.testing.assert_array_equal(back.arrays()[name], array)


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_a_joint_trajectory_is_one_of_ros(suffix: str, moved: Moved, tmp_path: Path) -> None:
    import rosbags.typesys as typesys

    path = tmp_path / f"walk{suffix}"
    FORMATS["jointtrajectory"].write(moved, path)
    message = (json.loads if suffix == ".json" else yaml.safe_load)(path.read_text())
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    stamp = kinds["Time"](**message["header"]["stamp"])
    points = [
        kinds["JointTrajectoryPoint"](
            positions=np.array(point["positions"]),
            velocities=np.array(point["velocities"]),
            accelerations=np.zeros(0),
            effort=np.array(point["effort"]),
            time_from_start=kinds["Duration"](**point["time_from_start"]),
        )
        for point in message["points"]
    ]
    whole = kinds["JointTrajectory"](
        header=kinds["Header"](stamp=stamp, frame_id=""),
        joint_names=message["joint_names"],
        points=points,
    )
    name = "trajectory_msgs/msg/JointTrajectory"
    back = store.deserialize_cdr(store.serialize_cdr(whole, name), name)
    assert tuple(back.joint_names) == moved.table.joints
    assert "angles_rad" in moved.table.columns
    np.testing.assert_array_equal(
        [point.positions for point in back.points], moved.table.columns["angles_rad"]
    )
    named = replace(moved.table, joints=("1e3", "0x1f", *moved.table.joints[2:]))
    path.write_bytes(joint_trajectory_bytes(named, suffix))
    back, whole = read_table(path), message["points"][0]["positions"]
    np.testing.assert_array_equal(back.columns["angles_rad"], moved.table.columns["angles_rad"])
    assert back.joints == named.joints
    for wrong in ("1.0", None, float("nan"), True):
        message["points"][0]["positions"] = [wrong, *whole[1:]]
        path.write_text(yaml_of(message) if suffix == ".yaml" else json.dumps(message))
        with refuses("positions" if wrong == wrong else path.name):
            read_table(path)


def test_mujoco_puts_the_feet_where_the_table_has_them(moved: Moved, tmp_path: Path) -> None:

    FORMATS["mujoco"].write(moved, tmp_path / "walk.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "walk.xml"))
    data, table = mujoco.MjData(model), moved.table
    assert model.nkey == len(table.time_s)
    assert "angles_rad" in table.columns
    assert "feet_m" in table.columns
    assert moved.robot is not None
    feet = [leg.foot for leg in moved.robot.legs.legs]
    for row in (0, model.nkey // 2, model.nkey - 1):
        mujoco.mj_resetDataKeyframe(model, data, row)
        mujoco.mj_kinematics(model, data)
        assert data.time == table.time_s[row]
        for k, joint in enumerate(table.joints):
            assert data.joint(joint).qpos[0] == table.columns["angles_rad"][row, k]
        gaps = [
            min(
                np.linalg.norm(data.geom_xpos[g] - table.columns["feet_m"][row, i])
                for g in range(model.ngeom)
                if model.geom_bodyid[g] == model.body(name).id
            )
            for i, name in enumerate(feet)
        ]
        assert max(gaps) < 1e-6


def test_a_plans_key_frames_have_their_names(plan: Motion, tmp_path: Path) -> None:

    FORMATS["mujoco"].write(moved_of(plan, "mujoco", 50.0), tmp_path / "climb.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "climb.xml"))
    named = [model.key(k).name for k in range(model.nkey) if "frame" in model.key(k).name]
    assert [name.partition(", ")[2] for name in named] == ["frame 0", "frame 1", "frame 2"]


def test_a_file_for_mujoco_is_right_to_a_hundredth_of_a_millimetre_anywhere(
    plan: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved, at = moved_of(plan, "mujoco", 50.0), np.array([5e4 + 0.1234567, -9e5, 7.0])
    there = [replace(patch, vertices_m=patch.vertices_m + at) for patch in moved.terrain]
    table = moved.table.with_columns(origin_m=moved.table.columns["origin_m"] + at)
    places = []
    for name, each in (("near", moved), ("far", replace(moved, table=table, terrain=there))):
        FORMATS["mujoco"].write(each, tmp_path / f"{name}.xml")
        read = read_keys(tmp_path / f"{name}.xml")
        np.testing.assert_allclose(
            read.columns["origin_m"], each.table.columns["origin_m"], rtol=0.0, atol=1e-9
        )
        model = mujoco.MjModel.from_xml_path(str(tmp_path / f"{name}.xml"))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 9)
        mujoco.mj_kinematics(model, data)
        places.append(data.geom_xpos - data.qpos[:3])
    np.testing.assert_allclose(places[1], places[0], rtol=0.0, atol=1e-5)
    monkeypatch.setattr("stancekit.runner.export.formats._OFF_M", 1e-12)
    with refuses("mujoco"):
        FORMATS["mujoco"].write(moved, tmp_path / "none.xml")
    assert not (tmp_path / "none.xml").exists()


def test_a_reference_has_the_arrays_that_mjlabs_motion_loader_reads(
    moved: Moved, tmp_path: Path
) -> None:
    FORMATS["reference"].write(moved, tmp_path / "walk.npz")
    held = np.load(tmp_path / "walk.npz")
    rows, joints, bodies = len(moved.table.time_s), len(moved.table.joints), len(held["body_names"])
    assert held["fps"].tolist() == [100]
    assert held["joint_pos"].shape == held["joint_vel"].shape == (rows, joints)
    assert held["body_quat_w"].shape == (rows, bodies, 4)
    for name in ("body_pos_w", "body_lin_vel_w", "body_ang_vel_w"):
        assert held[name].shape == (rows, bodies, 3)
    moved_by = np.gradient(held["body_pos_w"], 0.01, axis=0)[2:-2]
    assert np.abs(moved_by - held["body_lin_vel_w"][2:-2]).max() < 0.05 * np.abs(moved_by).max()
    np.testing.assert_allclose(np.linalg.norm(held["body_quat_w"], axis=-1), 1.0, atol=1e-9)


def test_rosbags_opens_the_log_and_reads_every_message(moved: Moved, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    FORMATS["foxglove"].write(moved, tmp_path / "walk.mcap")
    table, store, seen = moved.table, get_typestore(Stores.ROS2_HUMBLE), dict[str, list[Any]]()
    with AnyReader([tmp_path / "walk.mcap"], default_typestore=store) as bag:
        for connection, stamp_ns, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            seen.setdefault(connection.topic, []).append((stamp_ns, message))
            own = store.get_msgdef(connection.msgtype)
            assert bag.typestore.get_msgdef(connection.msgtype).fields == own.fields
    assert [ns for ns, _ in seen["/tf"]] == [round(1e9 * each) for each in table.time_s.tolist()]
    joints, contacts = ([each for _, each in seen[t]] for t in ("/joint_states", "/contacts"))
    assert (tuple(joints[0].name), tuple(contacts[0].name)) == (table.joints, table.limbs)
    np.testing.assert_array_equal([each.position for each in joints], table.columns["angles_rad"])
    np.testing.assert_array_equal([each.effort for each in joints], table.columns["torques_nm"])
    np.testing.assert_array_equal([each.position for each in contacts], table.columns["contact"])
    body = [each.transforms[0].transform for _, each in seen["/tf"]]
    np.testing.assert_array_equal(
        [points([each.translation])[0] for each in body], table.columns["origin_m"]
    )
    assert [each.rotation.w for each in body] == table.columns["quaternion"][:, 0].tolist()
    balls, lines = zip(*[each.markers for _, each in seen["/forces"]], strict=True)
    np.testing.assert_array_equal([points(each.points) for each in balls], table.columns["feet_m"])
    ends = np.array([points(each.points) for each in lines])
    np.testing.assert_allclose(
        1e3 * (ends[:, 1::2] - ends[:, ::2]), table.columns["forces_n"], atol=1e-9
    )


def points(messages: Iterable[Any]) -> list[tuple[float, float, float]]:
    return [(each.x, each.y, each.z) for each in messages]


def test_what_has_no_joints_leaves_as_far_as_it_is_known(walk: Motion) -> None:
    boxes = walk.asked(robot=replace(walk.robot, name="boxes", model=None))
    with pytest.raises(InvalidInput):
        walking_robot(boxes.robot)
    moved = moved_of(boxes, "csv")
    assert moved.without
    header = next(csv.reader(io.StringIO(csv_of(moved.table).decode())))
    assert "com.x" in header
    assert not [name for name in header if name.startswith("q.")]
    with refuses("reference"):
        moved_of(boxes, "reference")


def test_what_is_doubted_of_a_motion_is_said_as_it_leaves(plan: Motion, tmp_path: Path) -> None:
    doubted = replace(plan, problem=replace(plan.problem, doubts=("2 holes in the map",)))
    assert "2 holes in the map" in stancekit.export(doubted, tmp_path / "plan.csv").doubts


def test_a_file_that_only_says_that_it_was_accepted_is_not_exported(
    plan: Motion, tmp_path: Path
) -> None:
    from stancekit.planners.formats.motion_file import write_motion
    from stancekit.planners.verify import check_plan

    forged = replace(plan, forces_n=0.5 * plan.forces_n)
    write_motion(
        tmp_path / "forged.json",
        forged,
        replace(check_plan(forged), groups=check_plan(plan).groups),
    )
    with refuses("forged.json"):
        stancekit.export(tmp_path / "forged.json", tmp_path / "forged.csv")
    with refuses("plan"):
        stancekit.export(forged, tmp_path / "forged.csv")
    assert not (tmp_path / "forged.csv").exists()


def test_a_leap_leaves_in_every_format_that_needs_no_joints(tmp_path: Path) -> None:
    leap = stancekit.plan("leap-given:0").solution
    assert leap.has("timing")
    for to in ("csv", "npz", "foxglove"):
        done = stancekit.export(leap, tmp_path / f"leap{FORMATS[to].suffixes[0]}", to=to)
        assert done.without == "a leap has body, feet and forces: its robot has limbs alone"
    for to in ("jointtrajectory", "mujoco", "reference"):
        with refuses(to):
            stancekit.export(leap, tmp_path / f"none{FORMATS[to].suffixes[0]}", to=to)
    table = read_table(tmp_path / "leap.csv")
    assert (table.joints, table.limbs) == ((), leap.problem.robot.limb_names)
    air = ~np.asarray(table.columns["contact"]).any(axis=1)
    assert air.any()
    assert np.abs(table.columns["forces_n"][air]).max() == 0.0
    falling = np.diff(np.asarray(table.columns["velocity_m_s"])[air, 2]) * table.rate_hz
    assert np.median(falling) == pytest.approx(-9.81, abs=0.05)
    pushed = replace(leap, forces_n=1.2 * leap.forces_n)
    with refuses("leap"):
        stancekit.export(pushed, tmp_path / "leap.csv")


def test_a_leap_of_a_robot_with_legs_leaves_with_its_joints(tmp_path: Path) -> None:
    leap = stancekit.load("tests/data/leap-hop-anymal.json", Motion)
    assert stancekit.export(leap, tmp_path / "leap.csv", rate_hz=100.0).without == ""
    table = read_table(tmp_path / "leap.csv")
    assert len(table.joints) == 12
    assert np.isfinite(table.columns["angles_rad"]).all()
    assert np.ptp(table.columns["angles_rad"], axis=0).max() > 0.3


def test_torques_that_leave_turn_joints_against_their_damping_and_friction(tmp_path: Path) -> None:
    tables, stiff = list[MotionTable](), 'velocity="10"/><dynamics damping="1" friction="2"/>'
    for name, text in (
        ("free", quadruped()),
        ("stiff", quadruped().replace('velocity="10"/>', stiff)),
    ):
        (tmp_path / f"{name}.urdf").write_text(text)
        robot = robot_of(tmp_path / f"{name}.urdf")
        walk = stancekit.walk("rough:0:0", (0.2, 0.0), robot=robot, duration_s=2.0).solution
        moved = moved_of(walk, "npz", 100.0)
        tables.append(moved.table)
    free, stiffer = tables
    against = free.columns["rates_rad_s"] + 2.0 * np.tanh(free.columns["rates_rad_s"] / 0.1)
    np.testing.assert_allclose(
        stiffer.columns["torques_nm"] - free.columns["torques_nm"], against, atol=1e-9
    )
    assert np.abs(against).max() > 3.0
    assert check_motion(stiffer, robot, moved.terrain).group("effort").worst < 0.1


KP_NM_RAD, KD_NMS_RAD = 200.0, 4.0


@pytest.mark.parametrize("robot", ["anymal", "go1"])
def test_a_walk_is_followed_in_plain_mujoco(robot: str, tmp_path: Path) -> None:
    if robot == "go1" and provider_folder("example-robot-data") is None:
        pytest.skip("go1's URDF is of example-robot-data")
    walk = stancekit.walk("rough:0:0", (0.2, 0.0), robot=robot, duration_s=2.0).solution
    assert walk is not None
    said = stancekit.export(walk, tmp_path / "walk.xml").open_loop
    assert said.startswith("stood at pace 1 with Kp ")
    assert said in (tmp_path / "walk.xml").read_text()
    stancekit.export(walk, tmp_path / "walk.npz", to="reference")

    model, ref = (
        mujoco.MjModel.from_xml_path(str(tmp_path / "walk.xml")),
        np.load(tmp_path / "walk.npz"),
    )
    data, followed = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
    joints = [model.joint(name) for name in ref["joint_names"]]
    at, rate = ([int(getattr(joint, key)[0]) for joint in joints] for key in ("qposadr", "dofadr"))
    for q, v, tau in zip(ref["joint_pos"], ref["joint_vel"], ref["tau"], strict=True):
        while data.time < len(followed) / ref["fps"][0]:
            data.qfrc_applied[rate] = (
                tau + KP_NM_RAD * (q - data.qpos[at]) + KD_NMS_RAD * (v - data.qvel[rate])
            )
            mujoco.mj_step(model, data)
        followed.append(data.qpos[at].copy())

    assert data.time >= 2.0
    assert np.abs(followed - ref["joint_pos"]).max() <= 0.1
    _, x, y, _ = data.qpos[3:7]
    assert 1.0 - 2.0 * (x * x + y * y) > np.cos(0.1)  # upright
    assert np.linalg.norm(data.qpos[:3] - ref["body_pos_w"][-1, 0]) < 0.05


def test_a_motion_that_falls_open_loop_says_when_at_both_paces(moved: Moved) -> None:
    folded = np.array(moved.table.columns["angles_rad"])
    folded[len(folded) // 2 :, : folded.shape[1] // 2] += 0.8
    fell = played(replace(moved, table=moved.table.with_columns(angles_rad=folded)))
    assert [part[:10] for part in fell.split("; ")] == ["fell after"] * 2
    assert "pace 0.5, with Kp " in fell


def test_numbers_for_crocoddyl_are_the_motion_s_and_a_script_that_is_there_is_left_alone(
    moved: Moved, tmp_path: Path
) -> None:
    path = tmp_path / "walk.npz"
    FORMATS["crocoddyl"].write(moved, path)
    held, script = np.load(path), tmp_path / "walk.py"
    np.testing.assert_array_equal(held["angles_rad"], moved.table.columns["angles_rad"])
    np.testing.assert_array_equal(held["contact"], moved.table.columns["contact"])
    pressed = np.einsum("tni,tni->tn", held["forces_n"], held["normals"])
    assert (pressed[held["contact"]] >= 0.0).all()
    assert held["friction"][held["contact"]].min() > 0.3
    script.write_text("mine")
    FORMATS["crocoddyl"].write(moved, path)
    assert script.read_text() == "mine"
