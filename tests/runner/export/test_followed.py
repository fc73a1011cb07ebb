"""An exported walk is followed by a few lines that know nothing of the package: MuJoCo, NumPy and
the two files.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import stancekit
from stancekit.planners.robot.catalogue import provider_folder

KP_NM_RAD, KD_NMS_RAD = 200.0, 4.0


@pytest.mark.parametrize("robot", ["anymal", "go1"])
def test_a_walk_is_followed_in_plain_mujoco(robot: str, tmp_path: Path) -> None:
    if robot == "go1" and provider_folder("example-robot-data") is None:
        pytest.skip("go1's URDF is of example-robot-data")
    walk = stancekit.walk("rough:0:0", (0.3, 0.0), robot=robot, duration_s=3.0).solution
    assert walk is not None
    stancekit.export(walk, tmp_path / "walk.xml")
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

    assert data.time >= 3.0
    assert np.abs(followed - ref["joint_pos"]).max() <= 0.1
    _, x, y, _ = data.qpos[3:7]
    assert 1.0 - 2.0 * (x * x + y * y) > np.cos(0.1)  # upright
    assert np.linalg.norm(data.qpos[:3] - ref["body_pos_w"][-1, 0]) < 0.05
