"""A file for every reader, small and sound."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import trimesh
import yaml
from PIL import Image

from stancekit import Motion, WalkQuestion
from stancekit.configs import config_path
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.distributions.postures import distribution
from stancekit.learners.data.labelling import label
from stancekit.learners.selectors.network import Architecture, BoxNetwork
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.planners.formats.motion_file import write_certificate, write_motion
from stancekit.planners.formats.question_file import write_boxes
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.relaxation.envelope import expert_envelopes
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import drawn_urdf
from stancekit.planners.robot.walker import hexapod_walker, named_walker
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.runner.log import McapLog, read_log
from stancekit.runner.worlds.dynamixel.control_table import nominal
from stancekit.runner.worlds.ros.joint_states import same_names
from tests.planners.robot.small_urdfs import quadruped

from .cases import MOTIONS, command

FEET = (".stl", "-text.stl", ".obj", ".ply", "-text.ply", ".off", ".glb", ".dae")
"""Kinds of meshes that robots and terrains name, by the ends of their files' names."""
SMALL = Architecture(width=8, layers=1, heads=2, corner_width=4)


def make_files(folder: Path) -> None:
    """Fill the folder, which has to be the current one. Paths in the files are relative to it."""
    _postures(folder)
    _plans(folder)
    _gaits(folder)
    _robots(folder)
    _selectors(folder)
    _terrains(folder)


def _postures(folder: Path) -> None:
    rng = np.random.default_rng(1)
    problems = [distribution("wall-3").sample(rng).to_json() for _ in range(3)]
    (folder / "problems.jsonl").write_text(
        "".join(json.dumps(problem) + "\n" for problem in problems)
    )
    (folder / "one.json").write_text(json.dumps(problems[0]))
    command(("solve", "problems.jsonl", "--certificate", "--out", "answers.jsonl"))
    write_boxes(folder / "envelope.json", expert_envelopes("wall"))
    label(
        LabelPlan(distribution="wall-3", feasible=2, infeasible=2, shard_size=4, seed=2),
        folder / "data",
    )
    quota = {"feasible": 2, "infeasible": 2}
    bench = {
        "problems": ["wall-3"],
        "train": {**quota, "seed": 0},
        "test": {**quota, "seed": 1},
        "methods": ["heuristic"],
        "projections": ["fix-p"],
        "fit": {"share": 0.3},
    }
    (folder / "bench.yaml").write_text(yaml.safe_dump(bench))
    (folder / "fit.yaml").write_text("genetic: {population: 20, generations: 5}\n")
    (folder / "full").write_text("a file where a folder is wanted\n")


def _plans(folder: Path) -> None:
    spec = yaml.safe_load((config_path("courses/walls.yaml")).read_text()) | {"frames": 1}
    (folder / "course.yaml").write_text(yaml.safe_dump(spec))
    course = read_course(folder / "course.yaml")
    (folder / "course.json").write_text(json.dumps(course.to_json()))
    plan = TwoStage().solve(read_course(folder / "course.yaml", 2)).solution
    assert plan is not None
    write_motion(folder / "plan.json", plan, check_plan(plan))
    icy = build_course(spec_from({**spec, "terrain": {**spec["terrain"], "friction": 0.0}}), folder)
    refuted = TwoStage().solve(icy).certificate
    write_certificate(folder / "proof.json", refuted.of(icy))
    command(
        (
            "run",
            "plan.json",
            "--world",
            "mujoco",
            "--rate-hz",
            "10",
            "--pace",
            "4",
            "--log",
            "long.mcap",
        )
    )
    _shortened(folder / "long.mcap", folder / "run.mcap")
    for suffix in MOTIONS:
        command(("export", "plan.json", "--rate-hz", "2", "--out", f"motion.{suffix}"))
    joints = plan.problem.robot.joint_names
    nominal(plan.problem.robot, port="/dev/none").write(folder / "servos.yaml")
    same_names(joints, host="127.0.0.1", port=1, timeout_s=0.1).write(folder / "ros.yaml")


def _shortened(log: Path, short: Path) -> None:
    """A log with the first measurements and commands alone, and the rest."""
    counts = Counter[str]()
    with McapLog(short) as written:
        for message in read_log(log).messages:
            counts[message.topic] += 1
            if counts[message.topic] <= 5 or message.topic == "verdict":
                written.write(message.topic, message.content)


def _gaits(folder: Path) -> None:
    robot = hexapod_walker()
    terrain = HeightField.from_function(lambda x, y: 0.0 * x, 1.0, 0.5, name="level")
    at, count = np.array([0.0, 0.0, robot.stand_height_m]), 21
    still = Motion(
        times_s=0.005 * np.arange(count),
        torso_m=np.tile(at, (count, 1)),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=np.tile([foot.nominal_m + at for foot in robot.feet], (count, 1, 1)),
        forces_n=np.tile([0.0, 0.0, robot.weight_n / 6.0], (count, 6, 1)),
        contact=np.ones((count, 6), dtype=bool),
        problem=WalkQuestion(
            robot=robot,
            terrain=terrain,
            friction=0.7,
            adhesive=np.zeros(6, dtype=bool),
            start=at[:2],
            goal=at[:2],
        ),
        provenance={},
    )
    write_motion(folder / "gait.json", still, check_trajectory(still))


def _robots(folder: Path) -> None:
    (folder / "robot.yaml").write_text(config_path("robots/anymal.yaml").read_text())
    robot = hexapod()
    (folder / "robot.urdf").write_text(drawn_urdf(robot))
    (folder / "dog.urdf").write_text(quadruped())
    angles = "".join(
        f'<joint name="{leg}_{joint}" value="{angle}"/>'
        for leg in ("LF", "RF", "LH", "RH")
        for joint, angle in (("HAA", 0.1), ("HFE", 0.7), ("KFE", -1.3))
    )
    pair = '<disable_collisions link1="LF_FOOT" link2="RF_FOOT" reason="never"/>'
    state = f'<group_state name="home">{angles}</group_state>'
    (folder / "dog.srdf").write_text(f'<robot name="quadruped">{state}{pair}</robot>')
    measured = {
        "urdf": "robot.urdf",
        "feet": [f"{name}_foot" for name in ("LF", "RF", "LR", "RR")],
        "posture_rad": {"*_hip": 0.5, "*_knee": 1.2},
        "trunk_half_m": [0.1, 0.1, 0.05],
        "name": "measured",
    }
    (folder / "measured.yaml").write_text(yaml.safe_dump(measured))
    named_walker(folder / "measured.yaml")


def _selectors(folder: Path) -> None:
    envelopes = expert_envelopes("wall")
    NeuralSelector(
        BoxNetwork(SMALL),
        problem_class="wall-3",
        legs=envelopes.legs,
        force_scale_n=envelopes.force_scale_n,
        length_scale_m=envelopes.length_scale_m,
    ).save(folder / "neural.safetensors")


def _with_foot(urdf: str, mesh: str) -> str:
    """A robot with a mesh as the shape of a foot."""
    shape = f'<collision><geometry><mesh filename="{mesh}"/></geometry></collision></link>'
    return re.sub(
        r'(<link name="LF_FOOT">)(.*?)</link>',
        lambda found: (
            found[1] + re.sub(r"<collision>.*?</collision>", "", found[2], flags=re.DOTALL) + shape
        ),
        urdf,
        flags=re.DOTALL,
    )


def _terrains(folder: Path) -> None:
    x = np.linspace(-1.0, 1.0, 9)
    heights = 0.05 * np.sin(2.0 * x)[:, None] * np.cos(x)
    np.save(folder / "terrain.npy", heights)
    np.savez_compressed(folder / "terrain.npz", x_m=x, y_m=x, heights_m=heights)
    np.savetxt(folder / "terrain.csv", heights, delimiter=",", fmt="%.5f")
    Image.fromarray(np.uint8(127.0 + 1000.0 * heights)).save(folder / "terrain.png")
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), heights], axis=-1).reshape(-1, 3)
    cell = np.arange(72).reshape(8, 9)[:, :8].ravel()
    faces = np.concatenate(
        [np.stack([cell, cell + 9, cell + 10], 1), np.stack([cell, cell + 10, cell + 1], 1)]
    )
    surface = trimesh.Trimesh(grid, faces, process=False)
    cloud = "\n".join(" ".join(f"{value:.5f}" for value in row) for row in grid.tolist())
    (folder / "cloud.xyz").write_text(cloud)
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 81\nHEIGHT 1\nPOINTS 81\nDATA "
    (folder / "cloud.pcd").write_bytes(f"{head}binary\n".encode() + grid.astype("<f4").tobytes())
    (folder / "text.pcd").write_text(f"{head}ascii\n{cloud}\n")
    trimesh.PointCloud(grid).export(folder / "cloud.ply")
    ball = trimesh.creation.icosphere(1, 0.02)
    for name, mesh in (("terrain", surface), ("foot", ball)):
        for suffix in ("stl", "obj", "ply", "off", "glb", "dae"):
            mesh.export(folder / f"{name}.{suffix}")
        (folder / f"{name}-text.stl").write_text(trimesh.exchange.stl.export_stl_ascii(mesh))
        (folder / f"{name}-text.ply").write_bytes(
            trimesh.exchange.ply.export_ply(mesh, encoding="ascii")
        )
    for file in FEET:
        text = _with_foot(quadruped(), f"foot{file}")
        (folder / f"foot{file.replace('.', '-')}.urdf").write_text(text)
    spec = yaml.safe_load((folder / "course.yaml").read_text())
    walls = trimesh.util.concatenate(
        [
            trimesh.creation.box(
                (2.4, 0.1, 2.0), trimesh.transformations.translation_matrix((0.0, side * 0.43, 0.4))
            )
            for side in (-1.0, 1.0)
        ]
    )
    for suffix in ("stl", "obj", "ply"):
        walls.export(folder / f"mesh.{suffix}")
        terrain = {"kind": "mesh", "file": f"mesh.{suffix}", "friction": 1.0}
        (folder / f"mesh-{suffix}.yaml").write_text(yaml.safe_dump({**spec, "terrain": terrain}))
