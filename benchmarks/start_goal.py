"""Twenty start and goal pairs over five terrains, each planned from one line of ``stancekit plan``.

Terrains are made here and written as the files that a user has: stairs as a mesh (.stl), rubble as
a mesh (.obj), a grid of stepping stones (.npy), waves as a noisy point cloud with a hole (.npy), a
ramp to a table as a mesh in millimetres whose y points up (.ply). The line is run as a user runs
it; a plan counts where the command accepts it.

    python benchmarks/start_goal.py
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from _bench import Options, Row, launch

PLANE = ("--spacing-m", "0.04")


@dataclass(frozen=True, kw_only=True)
class PairOptions(Options):
    """With whom."""

    robot: str = "hexapod"
    """A built-in name, or a robot's file."""
    folder: Path | None = None
    """Where terrains are written; a folder that is removed if missing."""


def main(options: PairOptions) -> None:
    """A row a pair, and how many are planned."""
    with tempfile.TemporaryDirectory() as made:
        folder = options.folder or Path(made)
        rows = []
        for name, arguments, pairs in terrains(folder, np.random.default_rng(options.seed)):
            for start, goal in pairs:
                rows.append(planned(folder / name, arguments, start, goal, options.robot))
                options.say(rows[-1])
    options.say({"pairs": len(rows), "planned": sum(row["status"] == "feasible" for row in rows)})


def planned(path: Path, arguments: tuple[str, ...], start: str, goal: str, robot: str) -> Row:
    """What the line says."""
    line = [
        "plan",
        str(path),
        f"--start={start}",
        f"--goal={goal}",
        "--robot",
        robot,
        *arguments,
        "--json",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "stancekit.cli.main", *line],
        capture_output=True,
        text=True,
        check=False,
    )
    row: Row = {"terrain": path.name, "start": start, "goal": goal, "code": done.returncode}
    if not done.stdout.strip():
        return row | {"status": "refused", "message": done.stderr.strip()[-200:]}
    record = json.loads(done.stdout)
    accepted = record.get("verdict", {}).get("accepted", False)
    return row | {
        "status": record["status"]
        if accepted or record["status"] != "feasible"
        else "not accepted",
        "frames": record["frames"],
        "seconds": round(record["seconds"], 2),
        "message": record["message"][:120],
    }


def terrains(
    folder: Path, rng: np.random.Generator
) -> list[tuple[str, tuple[str, ...], list[tuple[str, str]]]]:
    """Files, the options that they are read with, and pairs of places."""
    folder.mkdir(parents=True, exist_ok=True)
    steps = [_box((-2.0, 0.6), (-1.0, 1.0), 0.0)]
    steps += [_box((0.6 + 0.3 * k, 0.9 + 0.3 * k), (-1.0, 1.0), 0.08 * (k + 1)) for k in range(5)]
    steps.append(_box((2.1, 4.0), (-1.0, 1.0), 0.4))
    trimesh.util.concatenate(steps).export(folder / "stairs.stl")
    blocks = [_box((-3.0, 3.0), (-2.0, 2.0), 0.0)]
    for x in np.arange(-1.2, 1.3, 0.34):
        for y in np.arange(-1.4, 1.5, 0.34):
            block = _box((x, x + 0.3), (y, y + 0.3), float(rng.uniform(0.02, 0.1)))
            tilt = trimesh.transformations.rotation_matrix(
                rng.uniform(-0.2, 0.2), [*rng.standard_normal(2), 0.0], block.centroid
            )
            blocks.append(block.apply_transform(tilt))
    trimesh.util.concatenate(blocks).export(folder / "rubble.obj")
    x, y = np.meshgrid(*(0.02 * (np.arange(200) - 99.5),) * 2, indexing="ij")
    stones = np.where(
        (x % 0.32 < 0.24) & (y % 0.32 < 0.24), 0.06 * np.sin(1.3 * x) * np.cos(1.7 * y), -0.4
    )
    np.save(folder / "stones.npy", np.where(np.hypot(x + 1.2, y) < 0.5, 0.0, stones))
    xy = rng.uniform(-2.0, 2.0, (120_000, 2))
    z = 0.05 * np.sin(2.5 * xy[:, 0]) * np.cos(2.0 * xy[:, 1]) + 0.004 * rng.standard_normal(
        len(xy)
    )
    seen = np.hypot(xy[:, 0] - 0.2, xy[:, 1] - 0.3) > 0.12
    np.save(folder / "waves.npy", np.column_stack([xy, z])[seen])
    ramp = trimesh.Trimesh(
        [
            [0.4, -1, 0],
            [1.6, -1, 0.35],
            [1.6, 1, 0.35],
            [0.4, 1, 0],
            [3.6, -1, 0.35],
            [3.6, 1, 0.35],
            [-2, -1, 0],
            [-2, 1, 0],
        ],
        [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2], [6, 0, 3], [6, 3, 7]],
        process=False,
    )
    ramp.vertices = 1000.0 * ramp.vertices[:, [1, 2, 0]]
    ramp.export(folder / "ramp.ply")
    return [
        (
            "stairs.stl",
            (),
            [("-1,0", "1.2,0"), ("0,0.3", "3,0.2"), ("3,0", "0,0"), ("-1,-0.3", "3,0.3")],
        ),
        ("rubble.obj", (), [("-2,0", "2,0"), ("-2,1", "1,-1"), ("0,0", "2,1"), ("2,-1", "-1,1")]),
        (
            "stones.npy",
            ("--spacing-m", "0.02"),
            [("-1.2,0", "0.8,0"), ("-1.2,0", "0,0.9"), ("-1.2,0", "0,-1"), ("-1.2,0", "1,1")],
        ),
        (
            "waves.npy",
            ("--kind", "cloud", *PLANE, "--roughness-m", "0.015"),
            [("-1,-1", "1,1"), ("-1,0", "1,0.3"), ("1,-1", "-1,-1"), ("0,1.2", "0,-1.2")],
        ),
        (
            "ramp.ply",
            ("--unit-m", "0.001", "--up", "y"),
            [("-1,0", "2.5,0"), ("-1,0.4", "1,0.2"), ("2.5,0", "0,0"), ("-1,-0.4", "3,0.4")],
        ),
    ]


def _box(x: tuple[float, float], y: tuple[float, float], top: float) -> trimesh.Trimesh:
    """A block from half a metre below the ground."""
    bounds = np.array([[x[0], y[0], -0.5], [x[1], y[1], top]])
    return trimesh.creation.box(bounds=bounds)


if __name__ == "__main__":
    launch(main, PairOptions, __doc__)
