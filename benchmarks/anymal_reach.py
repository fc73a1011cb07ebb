"""Measure ANYmal's mass, inertia and reach boxes from its URDF, as configs/robots/anymal.yaml holds them.

    pip install 'stancekit[kin,robots]'; python benchmarks/anymal_reach.py [anymal.urdf]

The URDF allows every joint 1.5 turns, which no robot uses: the abduction joint is sampled within .6 rad of the stance,
hip and knee within 1 and 1.4 / .6 rad, so that knees keep their bend; feet stay below the trunk and on their own side.
The box of the file is what all four legs reach, mirrored onto the first, rounded inward to 5 mm.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np

from stancekit.planners.robot.leg_boxes import Workspace
from stancekit.planners.robot.single_body import GaitRobot

POSTURE = [-0.1, 0.7, -1.0, -0.1, -0.7, 1.0, 0.1, 0.7, -1.0, 0.1, -0.7, 1.0]  # "standing" of the SRDF beside it
FEET = ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT")
URDF = "share/example-robot-data/robots/anymal_b_simple_description/robots/anymal.urdf"


def default_path() -> Path:
    """Where example-robot-data keeps the file."""
    spec = importlib.util.find_spec("cmeel")
    if spec is None or spec.origin is None:
        raise SystemExit("expected example-robot-data (pip install 'stancekit[robots]') or a path")
    return Path(spec.origin).parents[1] / "cmeel.prefix" / URDF


def main() -> None:
    """Print the numbers."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else default_path()
    robot = GaitRobot.from_urdf(
        path, FEET, POSTURE, trunk_half_m=[0.27, 0.14, 0.12],
        workspace=Workspace(
            ranges_rad=[(0.6, 0.6), (1.0, 1.0), (1.4, 0.6)], ceiling_m=-0.2, inner_m=0.08, voxel_m=0.02, steps=40
        ),
    )  # fmt: skip
    print(f"mass {robot.mass_kg:.4f} kg\ninertia\n{robot.inertia_kgm2.round(5)}\nstands {robot.stand_height_m:.3f} m")
    lows, highs = [], []
    for foot in robot.feet:
        mirror = np.sign(foot.nominal_m) * [1, 1, -1]
        corners = np.sort(np.stack([foot.reach_min_m, foot.reach_max_m]) * mirror, axis=0)
        print(
            foot.name, "nominal", foot.nominal_m.round(3), "box", foot.reach_min_m.round(3), foot.reach_max_m.round(3)
        )
        lows, highs = [*lows, corners[0]], [*highs, corners[1]]
    low, high = np.ceil(np.max(lows, axis=0) / 0.005) * 0.005, np.floor(np.min(highs, axis=0) / 0.005) * 0.005
    print("box of all legs, mirrored:", low.round(3).tolist(), high.round(3).tolist())


if __name__ == "__main__":
    main()
