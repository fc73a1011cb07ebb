"""Measure ANYmal's URDF against configs/robots/anymal.yaml: mass, inertia, and how much of its
boxes the legs reach.

    pip install "stancekit[catalogue]"; python benchmarks/anymal_reach.py [anymal.urdf]

The URDF allows every joint 1.5 turns, which no robot uses: the abduction joint goes .6 rad from the
stance, hip and knee 1 and 1.4 / .6 rad, so that knees keep their bend; feet stay below the trunk
and on their own side. The file's box was found by a search over voxels of 2 cm, which held the
frame of the foot, and rounded inward to 5 mm; ``reached`` is the share of random points of it for
which inverse kinematics finds joint angles. Beside it stands what ``walker_of`` finds for the same
legs, with the foot's radius kept in hand.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import tyro

from stancekit.planners.robot.inverse_kinematics import InverseKinematics
from stancekit.planners.robot.robot_file import RobotKeys, model_of_keys
from stancekit.planners.robot.urdf_reader import JointCorrection
from stancekit.planners.robot.walker import anymal, walker_of

POSTURE = {
    "L?_HAA": -0.1,
    "R?_HAA": 0.1,
    "?F_HFE": 0.7,
    "?H_HFE": -0.7,
    "?F_KFE": -1.0,
    "?H_KFE": 1.0,
}  # "standing" of the SRDF beside it
LIMITS = {
    "L?_HAA": (-0.7, 0.5),
    "R?_HAA": (-0.5, 0.7),
    "?F_HFE": (-0.3, 1.7),
    "?H_HFE": (-1.7, 0.3),
    "?F_KFE": (-2.4, -0.4),
    "?H_KFE": (0.4, 2.4),
}
FEET = {name: f"{name}_FOOT" for name in ("LF", "RF", "LH", "RH")}
URDF = "share/example-robot-data/robots/anymal_b_simple_description/robots/anymal.urdf"
POINTS = 4000


def default_path() -> Path:
    """Where example-robot-data keeps the file."""
    spec = importlib.util.find_spec("cmeel")
    if spec is None or spec.origin is None:
        raise SystemExit(
            "expected example-robot-data (pip install 'stancekit[catalogue]') or a path"
        )
    return Path(spec.origin).parents[1] / "cmeel.prefix" / URDF


def main(urdf: tyro.conf.Positional[Path | None] = None, /) -> None:
    """Print the numbers."""
    path = urdf or default_path()
    keys = RobotKeys(
        urdf=str(path.resolve()),
        feet=FEET,
        posture_rad=POSTURE,
        joints={name: JointCorrection(limits_rad=limits) for name, limits in LIMITS.items()},
    )
    model, printed, rng = model_of_keys(keys, path), anymal(), np.random.default_rng(0)
    walker = walker_of(model, ceiling_m=-0.2, inner_m=0.08)
    print(f"mass {model.mass_kg:.4f} kg, in the file {printed.mass_kg:g}")
    print(
        f"inertia, largest difference {np.abs(model.inertia_kgm2 - printed.inertia_kgm2).max():.2g} kg m²"
    )
    for name in printed.limb_names:
        (file, foot), leg = (
            (each.feet[each.limb_names.index(name)] for each in (printed, walker)),
            model.leg(name),
        )
        points = rng.uniform(file.reach_min_m, file.reach_max_m, (POINTS, 3)) + model.com_m
        _, error = InverseKinematics([leg], [leg.random_angles(8000, rng)]).solve(points[:, None])
        ours, theirs = (
            f"{each.reach_min_m.round(3)} {each.reach_max_m.round(3)}" for each in (foot, file)
        )
        print(
            f"{name}: box of the file {theirs}, {np.mean(error <= 1e-4):.2%} reached; of its walker {ours}"
        )


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
