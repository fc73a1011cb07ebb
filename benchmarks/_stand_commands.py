"""The package's own commands for benchmarks/stands: ``plan`` for an entry of the list, ``run`` for
a plan file.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _stand_list import Entry

PATIENCE = 6.0
"""A command is ended after so many of its limits of wall-clock time."""
STARVED = 0.8
"""What took longer than this share of its limit, and computed for less than this share of that,
lacked processors."""
MARGINS = ("push_n", "support_m", "friction_left")
"""Figures of a report that are kept where it has them."""
MOST_LETTERS = 300


@dataclass(frozen=True, kw_only=True)
class Done:
    """A command that ended, or was ended: its exit code, None for one that was; the object that it
    printed; its last line of errors; what it took [s].
    """

    code: int | None
    said: Mapping[str, Any]
    error: str
    cpu_s: float
    wall_s: float


def command(arguments: Sequence[str], patience_s: float) -> Done:
    """Run ``stancekit`` with ``--json`` in a process group of its own."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "stancekit.cli.main", *arguments, "--json"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    try:
        out, errors = process.communicate(timeout=patience_s)
        code: int | None = process.returncode
    except subprocess.TimeoutExpired:
        code = process.poll()  # it may have ended while this process was stopped
        if code is None:
            os.killpg(process.pid, signal.SIGKILL)
        out, errors = process.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = out.strip().splitlines()
    said = json.loads(lines[-1]) if code is not None and lines and lines[-1].startswith("{") else {}
    return Done(
        code=code,
        said=said,
        error=(errors.strip().splitlines() or [""])[-1][:MOST_LETTERS],
        cpu_s=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        wall_s=time.monotonic() - began,
    )


def planned(entry: Entry, folder: Path, limit_s: float) -> dict[str, Any]:
    """Plan an entry: whether the plan was accepted, what was said, CPU time, and margins; the
    plan's file stays.
    """
    mesh, plan = folder / "grounds" / f"{entry.name}.obj", folder / "plans" / f"{entry.name}.json"
    for path in (mesh, plan):
        path.parent.mkdir(parents=True, exist_ok=True)
    plan.unlink(missing_ok=True)
    ground = entry.ground()
    ground.write(mesh)
    (x, y), (ahead, aside) = ground.start_m.tolist(), ground.goal_m.tolist()
    done = command(
        [
            *("plan", str(mesh), f"--start={x:.3f},{y:.3f}", f"--goal={ahead:.3f},{aside:.3f}"),
            *("--friction", str(ground.friction), "--robot", entry.source),
            *("--time-limit-s", str(limit_s), "--out", str(plan), "--margins"),
        ],
        PATIENCE * limit_s,
    )
    verdict = done.said.get("verdict") or {}
    accepted = done.code == 0 and plan.exists() and bool(verdict.get("accepted"))
    said = verdict.get("message") or done.said.get("message") or done.error
    if done.code is None:
        said = f"no answer after {done.wall_s:.0f} s"
    long = done.wall_s > STARVED * limit_s
    starved = not accepted and long and done.cpu_s < STARVED * done.wall_s
    return {
        "robot": entry.robot,
        "ground": entry.kind,
        "draw": entry.draw,
        "accepted": accepted,
        "status": done.said.get("status", ""),
        "code": done.code,
        "message": str(said)[:MOST_LETTERS],
        "starved": starved,
        "cpu_s": round(done.cpu_s, 2),
        "wall_s": round(done.wall_s, 1),
        "margins": margins(verdict),
    }


def margins(verdict: Mapping[str, Any]) -> dict[str, float]:
    """The figures of a verdict that are called ``MARGINS``: of its groups, or beside them."""
    groups = {each.get("group"): each.get("value") for each in verdict.get("groups", ())}
    known = {**verdict, **(verdict.get("figures") or {}), **(verdict.get("margin") or {}), **groups}
    return {name: known[name] for name in MARGINS if isinstance(known.get(name), int | float)}


def ran(plan: Path, patience_s: float) -> dict[str, Any]:
    """Run a plan or a walk in the package's own MuJoCo: whether it was carried to its end, and what
    was said.
    """
    done = command(["run", str(plan), "--world", "mujoco"], patience_s)
    said = done.said.get("message") or done.said.get("reason") or done.error
    return {
        "stood": done.code == 0,
        "code": done.code,
        "message": "" if done.code == 0 else str(said)[:MOST_LETTERS],
        "cpu_s": round(done.cpu_s, 2),
    }
