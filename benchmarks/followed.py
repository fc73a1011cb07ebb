"""Exported walks, followed in plain MuJoCo by fifteen lines that know nothing of the package,
beside the referee.

    python benchmarks/followed.py WALK.json ... [--stiffness 40 60 100 200] [--out LINES.jsonl]

Every file is exported as ``mujoco`` and as ``reference``; the lines of ``follow`` are PD with the
exported torques fed forward, in the steps of MuJoCo's own default. A line has the largest |q −
q_ref|, the tilt at the end, or the time at which the body is 0.6 rad off the reference's: what the
referee of stands.py calls a fall. The same walk is played by that referee, without feedback of the
body as here and with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro
from _bench import Options, Row, launch, markdown
from _stand_list import Lines
from referee import Wrong, play, read_settings

import stancekit

FALLS_RAD = read_settings().falls.rotation_rad
DAMPING_S = 0.02
"""kd / kp."""


@dataclass(frozen=True, kw_only=True)
class Followed(Options):
    """Exported walks, followed."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Walks."""
    stiffness: tuple[float, ...] = (40.0, 60.0, 100.0, 200.0)
    """kp of the joints [Nm/rad]."""
    out: Path = Path("followed.jsonl")
    """A line per file and stiffness; what is there is not made again."""

    def run(self) -> None:
        """Follow all of them, and let the referee play them."""
        lines = Lines(self.out)
        for file in self.files:
            with TemporaryDirectory() as folder:
                scene, reference = Path(folder) / "walk.xml", Path(folder) / "walk.npz"
                stancekit.export(file, scene)
                stancekit.export(file, reference, to="reference")
                for kp in self.stiffness:
                    row = followed(scene, reference, kp)
                    self.say(lines.add(f"{file}:{kp:g}", {"file": file.stem, "kp": kp, **row}))
            for way, wrong in (
                ("referee", Wrong()),
                ("referee with feedback", Wrong(feedback=True)),
            ):
                row = play(file, read_settings(), wrong).json()
                self.say(lines.add(f"{file}:{way}", {"file": file.stem, "way": way, **row}))


def follow(
    scene: Path, reference: Path, kp: float, kd: float
) -> tuple[np.ndarray, np.ndarray, Any]:
    """Joints and body of each row, shape (T, J), (T, 7); and the reference."""
    model, ref = mujoco.MjModel.from_xml_path(str(scene)), np.load(reference)
    data, joints, bodies = mujoco.MjData(model), [], []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0  # torques are applied here
    places = [model.joint(name) for name in ref["joint_names"]]
    at, rate = ([int(getattr(each, key)[0]) for each in places] for key in ("qposadr", "dofadr"))
    for q, v, tau in zip(ref["joint_pos"], ref["joint_vel"], ref["tau"], strict=True):
        while data.time < len(joints) / ref["fps"][0]:
            data.qfrc_applied[rate] = tau + kp * (q - data.qpos[at]) + kd * (v - data.qvel[rate])
            mujoco.mj_step(model, data)
        joints.append(data.qpos[at].copy())
        bodies.append(data.qpos[:7].copy())
    return np.array(joints), np.array(bodies), ref


def followed(scene: Path, reference: Path, kp: float) -> dict[str, Any]:
    """What came of it."""
    joints, bodies, ref = follow(scene, reference, kp, DAMPING_S * kp)
    turned = 2.0 * np.arccos(
        np.clip(np.abs(np.sum(bodies[:, 3:] * ref["body_quat_w"][:, 0], axis=1)), 0.0, 1.0)
    )
    fallen = np.flatnonzero(turned > FALLS_RAD)
    return {
        "fell_s": round(float(fallen[0] / ref["fps"][0]), 2) if len(fallen) else None,
        "of_s": round(float((len(joints) - 1) / ref["fps"][0]), 2),
        "joints_rad": round(float(np.abs(joints - ref["joint_pos"]).max()), 4),
        "tilt_rad": round(
            float(np.arccos(1.0 - 2.0 * (bodies[-1, 4] ** 2 + bodies[-1, 5] ** 2))), 4
        ),
        "turned_rad": round(float(turned.max()), 4),
        "end_mm": round(1e3 * float(np.linalg.norm(bodies[-1, :3] - ref["body_pos_w"][-1, 0])), 1),
    }


def page(rows: list[Row]) -> Iterator[str]:
    """A row a stiffness, and the referee's (docs/measured/exports.md); figures are of walks that stay upright."""
    ways: dict[str, list[Row]] = {}
    for row in rows:
        ways.setdefault(row.get("way") or f"kp = {row['kp']:g} Nm/rad", []).append(row)
    head = ("followed by", "upright at the end", "greatest abs(q − q_ref) [rad]")
    yield from markdown(
        (*head, "off their place at the end [mm]"),
        (
            (
                way,
                f"{len(upright)} of {len(found)}",
                max((row["joints_rad"] for row in upright), default="") if "kp" in found[0] else "",
                " to ".join(f"{end(each['end_mm'] for each in upright):.2g}" for end in (min, max))
                if upright
                else "",
            )
            for way, found in ways.items()
            for upright in ([row for row in found if row["fell_s"] is None],)
        ),
    )


if __name__ == "__main__":
    launch(Followed.run, Followed, __doc__, page=page)
