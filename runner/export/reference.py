"""A motion as the reference that mjlab's tracking task reads (``MotionLoader`` of
mjlab/tasks/tracking/mdp/commands.py, mjlab 1.6.0; what writes such files there is
mjlab/scripts/csv_to_npz.py).

fps, shape (1,); joint_pos, joint_vel, shape (T, J), joints in MuJoCo's order; body_pos_w,
body_quat_w (w, x, y, z), body_lin_vel_w, body_ang_vel_w, shape (T, B, 3 or 4), of all bodies but
the world in MuJoCo's order, world frame, velocities of the bodies' own frames. joint_names,
body_names, tau, contact and force are read by nobody there.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.files.arrays import Array

from ..worlds.mujoco import MujocoWorld, mujoco_module
from .mjcf import states

if TYPE_CHECKING:
    from .moved import Moved


def _reference_of(moved: Moved) -> dict[str, Any]:
    """The arrays by name.

    Raises InvalidInput without MuJoCo.
    """
    assert moved.robot is not None
    mujoco, table = mujoco_module(), moved.table
    world = MujocoWorld(moved.robot, gravity_m_s2=moved.gravity_m_s2)
    model = world.scene(moved.terrain).compile()
    data = mujoco.MjData(model)
    qpos, qvel = states(model, table, world.body.base)
    bodies = range(1, model.nbody)
    place, turn = np.zeros((len(qpos), len(bodies), 3)), np.zeros((len(qpos), len(bodies), 4))
    moving, turning = np.zeros_like(place), np.zeros_like(place)
    velocity = np.zeros(6)
    for row, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        place[row], turn[row] = data.xpos[1:], data.xquat[1:]
        for k, body in enumerate(bodies):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
            turning[row, k], moving[row, k] = velocity[:3], velocity[3:]
    hinges = [i for i in range(model.njnt) if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
    names = [model.joint(i).name for i in hinges]
    order = [table.joints.index(name) for name in names]
    known = table.known()
    fps = (
        round(table.rate_hz) if abs(table.rate_hz - round(table.rate_hz)) < 1e-6 else table.rate_hz
    )
    arrays: dict[str, Array] = {
        "joint_pos": known["angles_rad"][:, order],
        "joint_vel": known["rates_rad_s"][:, order],
        "body_pos_w": place,
        "body_quat_w": turn,
        "body_lin_vel_w": moving,
        "body_ang_vel_w": turning,
        "tau": known["torques_nm"][:, order],
        "contact": known["contact"],
        "force": known["forces_n"],
    }
    words = {
        "joint_names": names,
        "body_names": [model.body(body).name for body in bodies],
        "limb_names": table.limbs,
    }
    return {
        "fps": np.array([fps]),
        **arrays,
        **{name: np.array(word) for name, word in words.items()},
    }


def reference_bytes(moved: Moved) -> bytes:
    """The file's content."""
    held = io.BytesIO()
    np.savez(held, **_reference_of(moved))
    return held.getvalue()
