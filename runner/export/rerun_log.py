"""A motion as a recording of Rerun (extra ``rerun``): body, feet, forces, a series per joint, over
the time t.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.answer.motion_table import OF_JOINTS
from stancekit.planners.errors import not_installed

if TYPE_CHECKING:
    from .moved import Moved

FORCE_M_PER_N = 1e-3
"""Length of the arrows of forces."""


def write_rerun(moved: Moved, path: Path) -> None:
    """Write the recording.

    Raises InvalidInput without Rerun's package.
    """
    rr, table = _rerun(), moved.table
    known = table.known()
    recording = rr.RecordingStream("stancekit", recording_id=None)
    recording.save(path)
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    time = rr.TimeColumn("t", duration=table.time_s)
    body = known.get("origin_m", known["com_m"])
    turned = np.roll(known["quaternion"], -1, axis=1)  # x, y, z, w
    recording.send_columns(
        "world/body", [time], [*rr.Transform3D.columns(translation=body, quaternion=turned)]
    )
    recording.send_columns("world/com", [time], [*rr.Points3D.columns(positions=known["com_m"])])
    for i, limb in enumerate(table.limbs):
        feet, forces = known["feet_m"][:, i], known["forces_n"][:, i]
        place = f"world/limbs/{limb}"
        recording.send_columns(f"{place}/foot", [time], [*rr.Points3D.columns(positions=feet)])
        arrows = rr.Arrows3D.columns(origins=feet, vectors=FORCE_M_PER_N * forces)
        recording.send_columns(f"{place}/force", [time], [*arrows])
        stands = known["contact"][:, i].astype(float)
        recording.send_columns(f"contact/{limb}", [time], [*rr.Scalars.columns(scalars=stands)])
    for key, word in OF_JOINTS.items():
        for k, joint in enumerate(table.joints if key in known else ()):
            recording.send_columns(
                f"{word}/{joint}", [time], [*rr.Scalars.columns(scalars=known[key][:, k])]
            )
    recording.flush()
    recording.disconnect()


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise not_installed("rerun", "rerun-sdk", "recordings of Rerun", "rerun") from None
    return rerun
