"""What does a question that cannot be met get? Walls, steps, gaps, slopes, slippery ground and bars,
as meshes, grids and clouds, in Python and by the command.

    python benchmarks/refusals.py --robots go1
    python benchmarks/refusals.py --out refusals.jsonl

Nothing may raise: an answer is infeasible, with a certificate that is accepted, or undecided, and
says why. The command with ``--json`` and ``--proof`` gives the same status. placed: the sentence has
the place of what is in the way, within 3 cm along x (a cell of a grid), and its height or width
within 1 cm; "" where there is none to say. changed: with a tenth of the size the answer is another
one: feasible, or with another sentence. Rows are kept as they come (``--out``).
"""

from __future__ import annotations

import io
import json
import re
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from _bench import Lines, Options, Row, launch, share
from ladder import AT_M, Robot, ground

import stancekit
from stancekit.cli.main import main as command

ROBOTS = ("go1", "drawn 4 0", "hexapod", "drawn 6 0")
MESHES = {"thin wall": 1.3, "wall": 1.0, "up": 1.2, "down": 1.5, "gap": 2.0, "bar": 0.8}
"""Kinds of meshes, and sizes in reaches; of a bar, how much lower than the robot's top, as a share."""
MAPS = {"wall": 1.0, "pit": 2.0, "slope": 45.0, "slippery": 25.0}
"""Kinds of grids and clouds, and sizes in reaches, or in degrees."""
SPACING_M, SLIPPERY, EASY_S = 0.05, 0.2, 5.0
SAID = re.compile(r"at \((-?[\d.]+), (-?[\d.]+)\), ([\d.]+) m (high|wide)")


@dataclass(frozen=True, kw_only=True)
class Given(Options):
    """Options of this benchmark."""

    robots: tuple[str, ...] = ROBOTS
    """Names of robots, or "drawn LEGS SEED"."""
    time_limit_s: float = 20.0
    """Time limit of every plan [s]."""
    out: Path = Path("refusals.jsonl")
    """Rows, kept as they come."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """A ground's file, with what its numbers mean, where to go, and what is in the way.

    Arguments:
        said_m: its height or width [m]; None where the sentence has none to say.
    """

    file: Path
    goal_m: tuple[float, float]
    meaning: dict[str, float] = field(default_factory=dict)
    said_m: float | None = None


def questions(robot: Robot, folder: Path, scale: float) -> Iterator[tuple[str, Question]]:
    """All of them, of sizes that are scaled."""
    for kind, size in MESHES.items():
        size_m = scale * size * (robot.top_m if kind == "bar" else robot.reach_m)
        path = folder / f"{kind.replace(' ', '-')}.obj"
        goal = ground(kind, size_m, robot, path)
        said_m = None if kind == "bar" else size_m
        yield f"mesh {kind}", Question(file=path, goal_m=goal, said_m=said_m)
    x, y = np.meshgrid(np.arange(-2.0, 2.01, SPACING_M), np.arange(-1.5, 1.51, SPACING_M))
    for kind, size in MAPS.items():
        size_m, said_m = scale * size * robot.reach_m, None
        z = x * np.tan(np.radians(scale * size))
        if kind == "wall":
            z, said_m = np.where((x > AT_M) & (x < AT_M + 0.3), size_m, 0.0), size_m
        elif kind == "pit":
            z = np.where((x > 0.2) & (x < 0.2 + size_m), -3.0, 0.0)
        meaning = {"friction": SLIPPERY} if kind == "slippery" else {}
        given: Any = {"goal_m": (1.2, 0.0), "said_m": said_m}
        np.save(folder / f"{kind}.npy", z.T)
        grid = {"spacing_m": SPACING_M, **meaning}
        yield f"grid {kind}", Question(file=folder / f"{kind}.npy", meaning=grid, **given)
        points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        np.savetxt(folder / f"{kind}.xyz", points, fmt="%.5f")
        yield f"cloud {kind}", Question(file=folder / f"{kind}.xyz", meaning=meaning, **given)


def asked(robot: Robot, question: Question, limit_s: float) -> stancekit.Answer[Any]:
    """The answer in Python: of a ground with nothing to stand on, that of its file."""
    over: Any = question.file
    if question.meaning:
        meaning: Any = question.meaning
        try:
            over = stancekit.terrain(question.file, robot=robot.file, **meaning)
        except stancekit.InvalidInput:
            over = question.file
    ends = {"start": (0.0, 0.0), "goal": question.goal_m}
    settings = stancekit.PlanSettings(leaps=False)
    return stancekit.plan(over, robot=robot.file, settings=settings, time_limit_s=limit_s, **ends)


def commanded(robot: Robot, question: Question, limit_s: float, proof: Path) -> Row:
    """The JSON of the command, with its exit code."""
    told, goal = io.StringIO(), ",".join(map(str, question.goal_m))
    words = ["plan", str(question.file), "--robot", robot.file, "--start=0,0", f"--goal={goal}"]
    words += [f"--{key.replace('_', '-')}={value}" for key, value in question.meaning.items()]
    words += ["--no-leaps", f"--time-limit-s={limit_s}", "--json", "--proof", str(proof)]
    code: Any = None
    with redirect_stdout(told), redirect_stderr(io.StringIO()):
        try:
            command(words)
        except SystemExit as end:
            code = end.code
    return {"code": code, **json.loads(told.getvalue() or "{}")}


def placed(message: str, size_m: float | None) -> str:
    """Whether the sentence has place and size of what is in the way."""
    if size_m is None:
        return ""
    found = SAID.search(message)
    near = found and abs(float(found[1]) - AT_M) <= 0.03 and abs(float(found[3]) - size_m) <= 0.0101
    return "yes" if near else "no"


def measured(robot: Robot, question: Question, easier: Question, limit_s: float) -> Row:
    """The row of a question."""
    proof, begin = question.file.with_suffix(".proof.json"), time.process_time()
    try:
        answer = asked(robot, question, limit_s)
        row: Row = {"status": answer.status.value, "why": answer.message}
        row["cpu_s"] = time.process_time() - begin
        met = row["status"] == "feasible"  # by a robot that gets lower than thought
        row["explained"] = met or bool(stancekit.explain(answer).message)
        certified = answer.certificate is not None
        row["proof"] = "none" if not certified else stancekit.verify(answer).accepted
        row["placed"] = placed(answer.message, question.said_m)
        told = commanded(robot, question, limit_s, proof)
        same = told.get("status") == row["status"] and proof.exists() == certified
        row["command"] = "same" if told["code"] == 1 and same else f"{told['code']}, {told}"[:300]
        other = asked(robot, easier, min(limit_s, EASY_S))
        row["changed"] = other.message != answer.message
    except Exception as error:  # a death is a row, too
        return {"status": "raised", "why": f"{type(error).__name__}: {error}"}
    return row


def main(given: Given) -> None:
    """Ask, print, and count."""
    lines = Lines(given.out)
    with TemporaryDirectory() as name:
        for words in given.robots:
            folder, easy = (Path(name) / f"{words.replace(' ', '-')}-{k}" for k in (0, 1))
            folder.mkdir()
            easy.mkdir()
            robot = Robot.of(words, folder)
            hard_ones, easy_ones = (questions(robot, *of) for of in ((folder, 1.0), (easy, 0.1)))
            for (kind, question), (_, easier) in zip(hard_ones, easy_ones, strict=True):
                if (key := f"{words} {kind}") not in lines.rows:
                    lines.add(key, measured(robot, question, easier, given.time_limit_s))
                given.say(lines.rows[key])
    found = list(lines.rows.values())
    counts = {
        "answers": sum(row["status"] in ("infeasible", "undecided") for row in found),
        "infeasible": sum(row["status"] == "infeasible" for row in found),
        "explained": sum(row.get("explained", False) for row in found),
        "the same by the command": sum(row.get("command") == "same" for row in found),
        "another answer for a tenth of it": sum(row.get("changed", False) for row in found),
    }
    for name, count in counts.items():
        print(f"{name}: {share(count, len(found))}")
    sized = [row["placed"] == "yes" for row in found if row.get("placed")]
    print(f"place and size in the sentence: {share(sum(sized), len(sized))}")


if __name__ == "__main__":
    launch(main, Given, __doc__)
