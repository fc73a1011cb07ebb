"""Leaps over heights: TOWR, whose footholds are free, beside the finder, which chooses among
candidates.

    python benchmarks/towr.py FOLDER --scenes 50 --out towr.jsonl

FOLDER has the sources of TOWR and ifopt, as ``git clone https://github.com/ethz-adrl/towr`` and
``.../ifopt`` leave them; they are compiled there once, against IPOPT and Eigen in casadi's wheel,
with ``benchmarks/towr/leap.cc``. Scenes are of classes over families of terrain; a run that is
stopped goes on.

Both have one body, one timing and one ground. TOWR begins on the candidates that are nearest to the
nominal toes, lands where it likes, and has a box for each foot that is as wide as the ball of reach
at the nominal place: wider than the ball at its corners. It has *converged* where all its
constraints hold to 1e-3, which are asked for at every .1 s; it knows no speed, power or momentum
limit and no borders of surfaces. The finder chooses both stances; its leaps are accepted by the
verifier.
"""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import casadi
import numpy as np
import tyro
from _bench import Lines, Options, launch, share
from pydantic import PrivateAttr

from stancekit.planners.answer.answer import Status
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import LeapClass, leap_class
from stancekit.planners.terrain.families import Terrain
from stancekit.planners.terrain.polygon import VOID_M

HERE = Path(__file__).parent / "towr"
SPACING_M = 0.02
"""Of the grid that TOWR gets."""
CLASSES = ("leap-rubble", "leap-stairs")


class OnTerrain(LeapClass):
    """A class of leaps over a family that remembers the scene of its last leap."""

    _scene: Terrain | None = PrivateAttr(None)

    def _place(self, scene: Terrain, *rest: Any) -> Any:
        self._scene = scene
        return super()._place(scene, *rest)


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Scenes for both.

    Arguments:
        folder: sources of TOWR and ifopt.
        scenes: over all classes.
        limit_s: CPU time of one solve.
        out: rows; what is there is not solved again.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    scenes: int = 50
    seed: int = 4450
    limit_s: float = 20.0
    out: Path = Path("towr.jsonl")


def main(asked: Asked) -> None:
    """Solve the scenes by both, and print a line for each method and class."""
    program, lines = compiled(asked.folder), Lines(asked.out, "seed")
    for index in range(asked.scenes):
        name, seed = CLASSES[index % len(CLASSES)], asked.seed + index
        if seed not in lines.rows:
            lines.add(seed, compared(name, seed, program, asked.limit_s))
    rows = list(lines.rows.values())
    for name in (*CLASSES, "all"):
        of = [row for row in rows if name in (row["class"], "all")]
        for method, ended in (("towr", "converged"), ("finder", "accepted")):
            count = sum(bool(row[method]) for row in of)
            used_s = float(np.median([row[f"{method}_s"] for row in of])) if of else 0.0
            shown = {"class": name, "method": method, ended: share(count, len(of))}
            shown["CPU-s, median of all"] = round(used_s, 2)
            if method == "finder":
                shown["refuted"] = sum(row["refuted"] for row in of)
            asked.say(shown)


def compiled(folder: Path, name: str = "leap") -> Path:
    """The program of ``NAME.cc``, compiled where it is not there yet."""
    own = Path(casadi.__file__).parent
    parts = ("ifopt/ifopt_core", "ifopt/ifopt_ipopt", "towr/towr")
    sources = [
        HERE / f"{name}.cc",
        *(one for part in parts for one in (folder / part / "src").glob("*.cc")),
    ]
    if len(sources) < 10:
        raise SystemExit(
            f"{folder}: expected folders towr and ifopt with their sources, found none"
        )
    headers = [own / "include", own / "include" / "eigen3", own / "include" / "coin-or"]
    headers += [folder / part / "include" for part in parts]
    begun, objects = time.perf_counter(), []
    (folder / "objects").mkdir(exist_ok=True)
    for source in sources:
        made = folder / "objects" / f"{source.stem}.o"
        objects.append(str(made))
        if not made.exists() or made.stat().st_mtime < source.stat().st_mtime:
            flags = ["-std=c++14", "-O2", "-DNDEBUG", "-w", *(f"-I{path}" for path in headers)]
            subprocess.run(["g++", *flags, "-c", str(source), "-o", str(made)], check=True)
    program = folder / name
    link = [f"-L{own}", f"-Wl,-rpath,{own}", "-l:libipopt.so.3"]
    subprocess.run(["g++", *objects, *link, "-o", str(program)], check=True)
    print(f"compiled in {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    return program


def compared(name: str, seed: int, program: Path, limit_s: float) -> dict[str, Any]:
    """One scene by both."""
    kind = OnTerrain(**leap_class(name).model_dump())
    leap = kind.draw(np.random.default_rng(seed), f"{name}-{seed}")
    scene = kind._scene
    assert scene is not None
    run = subprocess.run(
        [program],
        input=asked(leap, kind, scene, limit_s),
        text=True,
        capture_output=True,
        check=False,
    )
    said = [line.split() for line in run.stdout.splitlines() if line.startswith("LEAP")]
    found = [float(word) for word in said[-1][1:]] if said else [0.0, limit_s, float("inf")]
    begun = time.process_time()
    answer = find_leap(leap, LeapFinder(order="finder"), time_limit_s=limit_s)
    return {
        "class": name,
        "seed": seed,
        "towr": bool(found[0]),
        "towr_s": found[1],
        "towr_worst": found[2],
        "finder": answer.status is Status.FEASIBLE,
        "refuted": answer.status is Status.INFEASIBLE,
        "finder_s": time.process_time() - begun,
        "finder_solves": answer.effort.solves,
    }


def asked(leap: Leap, kind: LeapClass, scene: Terrain, limit_s: float) -> str:
    """What ``leap.cc`` reads."""
    robot, inertia = leap.robot, leap.robot.inertia
    assert inertia is not None
    nominal = np.array([kind._toe(limb, -kind.height_m) for limb in robot.limbs])
    away = nominal - np.array([limb.shoulder_m for limb in robot.limbs])
    reach = min(limb.reach_m for limb in robot.limbs)
    half = [np.sqrt(reach**2 - (away**2).sum(axis=1).max())] * 3  # the ball's at the nominal place
    half[2] = reach - float(np.abs(away[:, 2]).max())
    toes = []
    for place, put in zip(
        leap.start.com_m + nominal, leap.footholds, strict=False
    ):  # of the first stance
        centres = np.array([patch.centre_m for patch in put.candidates])
        toes.append(centres[np.linalg.norm(centres - place, axis=1).argmin()])
    friction = min(patch.friction for put in leap.footholds for patch in put.candidates)
    ends = np.array([leap.start.com_m[:2], leap.goal.com_m[:2]])
    low, high = ends.min(axis=0) - 0.6, ends.max(axis=0) + 0.6
    x, y = (np.arange(low[k], high[k], SPACING_M) for k in range(2))
    heights = scene.grid(x, y)
    heights = np.where(heights == VOID_M, heights[heights != VOID_M].min() - 0.5, heights)
    numbers = [limit_s, robot.mass_kg, leap.limits.force_share * leap.weight_n, *np.diag(inertia)]
    numbers += [len(robot.limbs), *nominal.ravel(), *half, *leap.start.com_m, *leap.goal.com_m]
    numbers += [
        *np.ravel(toes),
        *leap.timings_s[0],
        friction,
        low[0],
        low[1],
        SPACING_M,
        len(x),
        len(y),
    ]
    return " ".join(f"{number:.17g}" for number in [*numbers, *heights.ravel()])


if __name__ == "__main__":
    launch(main, Asked, __doc__)
