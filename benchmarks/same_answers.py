"""Whether another checkout answers the same: problems, labels, certificates, plans, walks and
streams.

    python benchmarks/same_answers.py --against ../before
    python benchmarks/same_answers.py --against v0.1.0 --within 1e-9

The other is a folder, or a commit, which is written out for as long as it is asked. Both run all
cases of this script, in a process of their own. Words have to be the same; a figure, and a number
in a text, may differ by ``--within`` times the largest magnitude of its array, or times 1 where
that is less. What differs is printed with its largest difference and the place of it, and the exit
code is 1. A case that only one of the two knows, as those of a method that went, is told and is no
difference.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from _checkouts import ROOT, checkout, of_checkout
from _figures import Answers, digest, report

POSTURES = ("wall-3", "ground-3", "wall-5")
METHODS = ("exact", "lift", "two-stage")
COURSES = ("stairs", "walls", "icy-walls", "tube", "ground-to-wall", "rubble:0.4:3", "gaps:0.3:5")


class Unknown(Exception):
    """A checkout has no such method, terrain or module."""


def cases() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Name and work of every case."""
    for name in POSTURES:
        for index in range(16):
            yield f"problem {name} {index}", lambda n=name, i=index: posture(n, i).to_json()
            for method in METHODS:
                work = lambda n=name, i=index, m=method: outcome_of(posture(n, i), m)  # noqa: E731
                yield f"{method} {name} {index}", work
    for course in COURSES:
        for frames in (3, 6):
            yield f"plan {course} {frames}", lambda c=course, m=frames: plan_of(c, m)
    for terrain in ("ripple", "rough:0.4:3", "cone"):
        yield f"walk {terrain}", lambda t=terrain: walk_of(t)
    for name in ("wall-3", "ground-3"):
        yield f"labels {name}", lambda n=name: labels_of(n)
    yield "stream walls", stream_of


def asked(function: str, *given: Any, **options: Any) -> Any:
    """The answer of a function of the library.

    Raises Unknown where the checkout does not have the function, or refuses a name that it is
    given.
    """
    import stancekit

    if not hasattr(stancekit, function):
        raise Unknown(function)
    words = [each for each in (*given, *options.values()) if isinstance(each, str)]
    words += [word.split(":")[0] for word in words]
    try:
        return getattr(stancekit, function)(*given, **options)
    except stancekit.InvalidInput as error:
        if any(str(error).endswith(f"got {word!r}") for word in words):
            raise Unknown(str(error)) from error
        raise


def inner(module: str, name: str) -> Any:
    """What a module of the checkout has under this name; Unknown where there is no such thing."""
    from importlib import import_module

    try:
        return getattr(import_module(module), name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise Unknown(f"{module}.{name}") from error


@cache
def posture(distribution: str, index: int) -> Any:
    """A posture problem of a seeded draw."""
    return asked("sample", distribution, 16, rng=2026)[index]


def outcome_of(problem: Any, method: str) -> Any:
    """Status, posture, certificate and bound."""
    found = asked("solve", problem, method)
    proof = found.certificate
    return {
        "status": found.status,
        "posture": None if found.solution is None else found.solution.to_json(),
        "certificate": None if proof is None else [proof.tree, proof.multipliers],
        "bound": found.bound,
        "message": found.message,
        "solves": found.effort.solves,
    }


def plan_of(course: str, frames: int) -> Any:
    """Status, the plan's arrays, bound and verdict; the words of a refusal."""
    import stancekit

    try:
        found = asked("plan", course, frames=frames, time_limit_s=600.0)
    except stancekit.StancekitError as error:
        return {"refused": type(error).__name__, "message": str(error)}
    names = ("com_m", "rotation_rad", "toes_m", "choice", "forces_n")
    plan = found.solution
    return {
        "status": found.status,
        "bound": found.bound,
        "message": found.message,
        "verdict": None if found.report is None else found.report.message,
        "plan": None if plan is None else {name: getattr(plan, name) for name in names},
    }


def walk_of(terrain: str) -> Any:
    """The samples of a short walk, and its verdict."""
    found = asked("walk", terrain, (0.3, 0.0), duration_s=2.0, chart="decoupled")
    names = ("torso_m", "rotation", "feet_m", "forces_n", "contact")
    walk = found.solution
    return {
        "status": found.status,
        "message": found.message,
        "walk": None if walk is None else {name: getattr(walk, name) for name in names},
    }


def labels_of(name: str) -> Any:
    """The rows of a small data set, column by column."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    plan = inner("stancekit.envs.data.ledger", "LabelPlan")
    label = inner("stancekit.learners.data.labelling", "label")
    with TemporaryDirectory() as folder:
        label(plan(distribution=name, feasible=30, infeasible=30, seed=9), Path(folder) / "rows")
        files = sorted((Path(folder) / "rows").rglob("*.parquet"))
        rows = pa.concat_tables([pq.read_table(path) for path in files])
        return {column: rows[column].to_pylist() for column in rows.column_names}


def stream_of() -> Any:
    """Every command that a run in memory sends, of a host that is not tried for its haste; why
    there is nothing to run.
    """
    found = asked("plan", "walls", frames=2)
    if found.solution is None:
        return {"message": found.message}
    world = inner("tests.emulators.memory_world", "MemoryWorld")()
    patient = inner("tests.emulators.memory_world", "PATIENT")
    settings = inner("stancekit.runner.settings", "RunSettings")(limits=patient)
    accepted = inner("stancekit.runner.acceptance", "Accepted")
    runner = inner("stancekit.runner.run", "Runner")(world, settings=settings, dry=False)
    runner.run(accepted.verified(found.solution, "walls"))
    return {"targets_rad": [targets for _, targets in world.commands]}


def plain(thing: Any) -> Any:
    """The same as JSON holds it, every number to the last bit."""
    if isinstance(thing, np.ndarray | np.generic):
        return thing.tolist()
    if isinstance(thing, dict):
        return {str(name): plain(value) for name, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [plain(value) for value in thing]
    return str(thing.value) if isinstance(thing, Enum) else thing


@dataclass
class SameAnswers:
    """Compare the answers of two checkouts.

    Arguments:
        against: the other, a folder with its links made or a commit; without it this one's digests
            are printed.
        within: difference that a figure may have, over the magnitude of its array.
        figures: print this checkout's answers whole, a case a line of JSON.
    """

    against: str = ""
    within: float = 1e-9
    figures: bool = False

    def run(self) -> int:
        """Print what differs; the exit code."""
        if self.against:
            with checkout(self.against) as other:
                return report(answers(other), answers(ROOT), self.within, "cases")
        for name, work in cases():
            try:
                answer = plain(work())
            except Unknown:
                continue
            print(json.dumps([name, answer if self.figures else digest(answer)]), flush=True)
        return 0


def answers(root: Path) -> Answers:
    """The answers of a checkout to the cases of this script."""
    command = [sys.executable, str(Path(__file__).resolve()), "--figures"]
    done = subprocess.run(
        command, env=of_checkout(root), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{root}: {done.stderr[-2000:]}")
    return dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith("["))


if __name__ == "__main__":
    import tyro

    sys.exit(tyro.cli(SameAnswers, description=__doc__).run())
