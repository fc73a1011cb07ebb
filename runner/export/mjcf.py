"""A motion in MuJoCo's own format: robot, terrain, and one key frame per row of the motion.

The robot and the ground are those of the world in which ``run`` executes plans
(``runner.worlds.mujoco``); shapes are in the file itself, so that it needs no other. ``key`` has
time, qpos, qvel, and as ctrl the targets with which the position loops give the motion's torques.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.answer.plan import MotionTable
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array

from ..worlds.mujoco import MujocoWorld, mujoco_module
from ..worlds.simulated_body import SimulatedBody

if TYPE_CHECKING:
    from .moved import Moved


def mjcf_of(moved: Moved) -> str:
    """The file's text.

    Raises InvalidInput without MuJoCo, and for a robot that it cannot hold.
    """
    assert moved.robot is not None
    world = MujocoWorld(moved.robot, gravity_m_s2=moved.gravity_m_s2)
    spec = world.scene(moved.terrain)
    _embed(spec, world.body)
    model = spec.compile()
    spec.modelname = moved.robot.name
    qpos, qvel = states(model, moved.table, world.body.base)
    stiffness, damping = world.drives.stiffness_nm_rad, world.drives.damping_nms_rad
    table = moved.table
    assert table.angles_rad is not None
    assert table.rates_rad_s is not None
    assert table.torques_nm is not None
    targets = table.angles_rad + (table.torques_nm + damping * table.rates_rad_s) / stiffness
    names = _key_names(table.time_s, moved.keys_s)
    keys = zip(
        names, table.time_s.tolist(), qpos.tolist(), qvel.tolist(), targets.tolist(), strict=True
    )
    lines = [
        f'    <key name="{name}" time="{time_s!r}" qpos="{_text(q)}" qvel="{_text(v)}" ctrl="{_text(target)}"/>'
        for name, time_s, q, v, target in keys
    ]
    head, end, _ = str(spec.to_xml()).rpartition("</mujoco>")
    return "\n".join([f"{head}  <keyframe>", *lines, "  </keyframe>", f"{end}\n"])


def _text(numbers: list[float]) -> str:
    """Numbers to the last bit; MuJoCo's own writer keeps six digits."""
    return " ".join(map(repr, numbers))


def _key_names(times_s: Array, keys_s: tuple[float, ...]) -> list[str]:
    """Name of each row: by its number, and those at which a plan's key frame is reached by that,
    too.
    """
    names = [f"row {k}" for k in range(len(times_s))]
    for frame, time_s in enumerate(keys_s):
        names[int(np.abs(times_s - time_s).argmin())] += f", frame {frame}"
    return names


def states(model: Any, table: MotionTable, base: str) -> tuple[Array, Array]:
    """qpos and qvel of every row, shape (T, nq), (T, nv): turning velocities of the base are in its
    own frame.
    """
    known = table.known()
    if not {"angles_rad", "rates_rad_s", "origin_m"} <= set(known):
        raise InvalidInput("motion: expected joints and the body's place, got none")
    rows = len(table.time_s)
    qpos, qvel = np.tile(model.qpos0, (rows, 1)), np.zeros((rows, model.nv))
    root = int(model.body(base).jntadr[0])
    at, speed = int(model.jnt_qposadr[root]), int(model.jnt_dofadr[root])
    qpos[:, at : at + 7] = np.concatenate([known["origin_m"], known["quaternion"]], axis=1)
    qvel[:, speed : speed + 3] = np.gradient(known["origin_m"], table.time_s, axis=0)
    qvel[:, speed + 3 : speed + 6] = np.einsum("tji,tj->ti", table.rotation, known["turning_rad_s"])
    for k, name in enumerate(table.joints):
        joint = model.joint(name)
        qpos[:, int(joint.qposadr[0])] = known["angles_rad"][:, k]
        qvel[:, int(joint.dofadr[0])] = known["rates_rad_s"][:, k]
    return qpos, qvel


def _embed(spec: Any, body: SimulatedBody) -> None:
    """Put the shapes of the robot's hulls into the file in place of the names of theirs."""
    for mesh in spec.meshes:
        content = body.hulls.get(mesh.file)
        if content is not None:
            lines = [line.split() for line in content.decode().splitlines()]
            mesh.uservert = [float(x) for line in lines if line[0] == "v" for x in line[1:]]
            mesh.file = ""


def read_keys(path: Path) -> MotionTable:
    """The key frames of an MJCF file as a motion, by their times: joints and body, and nothing of
    contacts and forces.

    The body is what the first free joint moves. Raises InvalidInput for a file that MuJoCo does not
    read, without key frames, or without a free joint.
    """
    mujoco = mujoco_module()
    if not path.is_file():
        raise InvalidInput(f"{path}: expected a file, found nothing there")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InvalidInput(
            f"{path}: expected MuJoCo's MJCF: {' '.join(str(error).split())[:200]}"
        ) from None
    if model.nkey < 2:
        raise InvalidInput(f"{path}: expected two key frames or more, got {model.nkey}")
    free = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        raise InvalidInput(f"{path}: expected a body with a free joint, got none")
    order = np.argsort(model.key_time, kind="stable")
    qpos, qvel, times = model.key_qpos[order], model.key_qvel[order], model.key_time[order]
    turning = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = [i for i in range(model.njnt) if int(model.jnt_type[i]) in turning]
    at = int(model.jnt_qposadr[free[0]])
    try:
        return MotionTable(
            joints=tuple(model.joint(i).name for i in joints),
            limbs=(),
            time_s=times,
            angles_rad=qpos[:, model.jnt_qposadr[joints]],
            rates_rad_s=qvel[:, model.jnt_dofadr[joints]] if qvel.any() else None,
            origin_m=qpos[:, at : at + 3],
            quaternion=qpos[:, at + 3 : at + 7],
            source=str(path),
        )
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
