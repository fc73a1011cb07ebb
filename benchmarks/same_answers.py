"""Whether another checkout answers the same: problems, labels, certificates, plans, walks and
streams, bit for bit.

    python benchmarks/same_answers.py --against ../before

Each case is one line of a digest of what came; both checkouts run all of them in a process of their
own. What differs is printed, and the exit code is 1.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
POSTURES = ("wall-3", "ground-3", "wall-5")
COURSES = ("stairs", "walls", "icy-walls", "tube", "ground-to-wall", "rubble:0.4:3", "gaps:0.3:5")


def digest(thing: Any) -> str:
    """Of numbers, arrays and text."""
    content = hashlib.sha256()

    def add(part: Any) -> None:
        if isinstance(part, np.ndarray):
            content.update(
                str(part.dtype).encode()
                + str(part.shape).encode()
                + np.ascontiguousarray(part).tobytes()
            )
        elif isinstance(part, list | tuple):
            for each in part:
                add(each)
        else:
            content.update(repr(part).encode())

    add(thing)
    return content.hexdigest()[:16]


def cases() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Name and work of every case."""
    import stancekit

    for name in POSTURES:
        for index, problem in enumerate(stancekit.sample(name, 16, rng=2026)):
            yield f"problem {name} {index}", lambda p=problem: p.to_json()
            for method in ("exact", "lift", "two-stage"):
                yield f"{method} {name} {index}", lambda p=problem, m=method: outcome_of(p, m)
    for course in COURSES:
        for frames in (3, 6):
            yield f"plan {course} {frames}", lambda c=course, m=frames: plan_of(c, m)
    for terrain in ("ripple", "rough:0.4:3", "cone"):
        yield f"walk {terrain}", lambda t=terrain: walk_of(t)
    for name in ("wall-3", "ground-3"):
        yield f"labels {name}", lambda n=name: labels_of(n)
    yield "stream walls", stream_of


def solution_of(answer: Any) -> Any:
    """What was found, in a checkout of before, too, where postures, plans and walks had names of
    their own.
    """
    names = ("solution", "posture", "plan", "trajectory")
    return next(
        getattr(answer, name)
        for name in names
        if name in vars(answer) or hasattr(type(answer), name)
    )


def outcome_of(problem: Any, method: str) -> Any:
    """Status, posture, certificate and bound."""
    import stancekit

    found = stancekit.solve(problem, method)
    solution = solution_of(found)
    posture = None if solution is None else list(solution.to_json().items())
    proof = (
        None
        if found.certificate is None
        else [found.certificate.tree, found.certificate.multipliers]
    )
    known = vars(found)
    bound = known["bound"] if "bound" in known else known["lower_bound"]
    solves = known["effort"].solves if "effort" in known else known["solves"]
    return [found.status.value, posture, proof, bound, found.message, solves]


def plan_of(course: str, frames: int) -> Any:
    """Status, the plan's arrays, bound and verdict."""
    import stancekit

    try:
        found = stancekit.plan(course, frames=frames, time_limit_s=600.0)
    except stancekit.StancekitError as error:
        return str(error)
    plan, arrays = solution_of(found), None
    if plan is not None:
        arrays = [plan.com_m, plan.rotation_rad, plan.toes_m, plan.choice, plan.forces_n]
    report = None if found.report is None else found.report.message
    return [found.status.value, arrays, found.bound, found.message, report]


def walk_of(terrain: str) -> Any:
    """The samples of a short walk, and its verdict."""
    import stancekit

    found = stancekit.walk(terrain, (0.3, 0.0), duration_s=2.0, chart="decoupled")
    walk = solution_of(found)
    if walk is None:
        return found.message
    return [walk.torso_m, walk.rotation, walk.feet_m, walk.forces_n, walk.contact, found.message]


def labels_of(name: str) -> Any:
    """The digest of a small data set's rows."""
    from tempfile import TemporaryDirectory

    from stancekit.envs.data.ledger import LabelPlan
    from stancekit.learners.data.labelling import label

    with TemporaryDirectory() as folder:
        label(
            LabelPlan(distribution=name, feasible=30, infeasible=30, seed=9), Path(folder) / "rows"
        )
        files = sorted(
            path for path in (Path(folder) / "rows").rglob("*") if path.suffix == ".parquet"
        )
        return [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]


def stream_of() -> Any:
    """Every command that a run in memory sends."""
    import stancekit
    from stancekit.runner.acceptance import Accepted
    from stancekit.runner.run import Runner
    from tests.emulators.memory_world import MemoryWorld

    world = MemoryWorld()
    plan = solution_of(stancekit.plan("walls", frames=2))
    Runner(world, dry=False).run(Accepted.verified(plan, "walls"))
    return [targets for _, targets in world.commands]


@dataclass
class SameAnswers:
    """Compare the answers of two checkouts."""

    against: Path | None = None
    """The other checkout; without it this one's digests are printed."""

    def run(self) -> int:
        """Print what differs; the exit code."""
        if self.against is None:
            for name, work in cases():
                print(json.dumps([name, digest(work())]), flush=True)
            return 0
        if not (self.against / ".editable").is_dir():
            raise SystemExit(
                f"--against: expected a checkout with its links made, got {self.against}"
            )
        mine, other = (self._asked(root) for root in (ROOT, self.against.resolve()))
        differ = [name for name in mine if mine[name] != other.get(name)]
        for name in differ:
            print(f"differs: {name}")
        print(f"{len(mine)} cases, {len(differ)} differ")
        return int(bool(differ) or set(mine) != set(other))

    def _asked(self, root: Path) -> dict[str, str]:
        """The digests of a checkout."""
        path = os.pathsep.join([str(root / ".editable"), str(root)])
        done = subprocess.run(
            [sys.executable, str(Path(__file__).resolve())],
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(f"{root}: {done.stderr[-2000:]}")
        return dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith("["))


if __name__ == "__main__":
    import tyro

    sys.exit(tyro.cli(SameAnswers).run())
