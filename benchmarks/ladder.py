"""How high, wide and low can robots go? Steps, walls, gaps, bars, slopes with a step and stones, the
largest that is planned, by bisection, and what stops the next one.

    python benchmarks/ladder.py --quick
    python benchmarks/ladder.py --out ladder.jsonl --executed
    python benchmarks/ladder.py --out after.jsonl --against before.jsonl

Sizes are in reaches, how far a foot gets below the centre of mass in any tilt: heights of steps and
walls, widths of gaps, by how much the underside of a bar, over which no leg gets, is lower than the
standing robot's top, and between the lowest and the highest of stones. Walls are 0.1 or 0.3 m thick, the slope is one of 12
degrees. Rows are kept as they come (``--out``), and a run that was stopped goes on from them.

stops: at the smallest size that is not planned: way (the guide path has none), contacts, or the group
of the verifier that refuses the nearest plan (joints, torque, bodies, motion), or time. proved: the
smallest size of which a flood proves that no balanced motion leads over it. --executed: the largest
that is planned runs in MuJoCo. --against: how many times as large as in the rows of another run, in
the median over robots.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _bench import Lines, Options, Row, launch, markdown
from impossible import urdf

import stancekit
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.guide_path import Footprint
from stancekit.planners.robot.outer_sets import Extent
from stancekit.planners.robot.reach_sets import standing_toes
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.search.flood import flood

ROBOTS = (
    "hexapod",
    "drawn 4 0",
    "go1",
    "drawn 6 0",
    "solo12",
    "drawn 4 1",
    "anymal_c",
    "drawn 5 0",
    "a1",
    "drawn 8 0",
)
"""By name; or drawn, of so many legs and with this seed."""
KINDS = ("up", "down", "thin wall", "wall", "gap", "bar", "slope", "stones")
PROVED = ("up", "thin wall", "wall", "gap")
"""Kinds of which the flood is asked, too."""
AT_M, THICK_M, BAR_M, RISE = 0.5, {"thin wall": 0.1, "wall": 0.3}, 0.1, math.tan(math.radians(12.0))
STONE = 0.3
"""Sides of stones, in reaches."""
LEAST, MOST = 0.04, 1.1
"""Sizes between which the largest is looked for, in reaches."""
Quad = list[tuple[float, float, float]]


@dataclass(frozen=True, kw_only=True)
class Given(Options):
    """Options of this benchmark."""

    robots: tuple[str, ...] = ROBOTS
    """Names of robots, or "drawn LEGS SEED"."""
    kinds: tuple[str, ...] = KINDS
    """Kinds of ground."""
    halvings: int = 5
    """Number of bisections, of the logarithm."""
    time_limit_s: float = 20.0
    """Time limit of every plan [s]."""
    out: Path = Path("ladder.jsonl")
    """Rows, kept as they come."""
    against: Path | None = None
    """Rows of another run, with which these are compared."""
    executed: bool = False
    """Run the largest that is planned in MuJoCo."""
    quick: bool = False
    """Three robots and four bisections, at most 10 s a plan, and no proofs."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A robot, and its measures [m]: reach downwards, and height of its top over the ground."""

    file: str
    reach_m: float
    top_m: float

    @classmethod
    def of(cls, words: str, folder: Path) -> Robot:
        """The robot of these words."""
        file = words
        if words.startswith("drawn "):
            legs, seed = map(int, words.split()[1:])
            path = folder / f"{words.replace(' ', '-')}.urdf"
            path.write_text(urdf(legs, np.random.default_rng([seed, legs])))
            file = str(path)
        robot = robot_of(file)
        model = robot.own_model() if robot.own else None
        toes = (
            standing_toes(model) if isinstance(model, RobotModel) else np.array(_usual_toes(robot))
        )
        shape = Footprint.of(robot, toes)
        return cls(file=file, reach_m=Extent.of(robot).reach_m, top_m=shape.down_m + shape.high_m)


def _usual_toes(robot: stancekit.Robot) -> list[np.ndarray]:
    """Toes of a robot without legs of its own, as courses have them."""
    from stancekit.planners.problem.course_keys import StanceSpec, toe_offset

    return [limb.shoulder_m + toe_offset(limb, StanceSpec()) for limb in robot.limbs]


def ground(kind: str, size_m: float, robot: Robot, path: Path) -> tuple[float, float]:
    """Write the mesh of a ground of this kind and size, and return the goal (x, y) [m]."""
    room, quads = robot.reach_m, list[Quad]()
    back, wide, far = -1.0 - room, 1.5 + room, 2.0 + 2.0 * room
    rise = RISE if kind == "slope" else 0.0
    thick, goal = THICK_M.get(kind, 0.0), AT_M + 0.4 + 0.5 * room

    def level(x0: float, x1: float, z: float, y0: float = -wide, y1: float = wide) -> None:
        z0, z1 = z + rise * x0, z + rise * x1
        quads.append([(x0, y0, z0), (x1, y0, z1), (x1, y1, z1), (x0, y1, z0)])

    def riser(x: float, low: float, high: float) -> None:
        """A face from one height to another, seen from the lower side, which is before it."""
        low, high = low + rise * x, high + rise * x
        quads.append([(x, -wide, low), (x, -wide, high), (x, wide, high), (x, wide, low)])

    if kind in ("up", "down", "slope"):
        up = -size_m if kind == "down" else size_m
        level(back, AT_M, 0.0)
        riser(AT_M, 0.0, up)
        level(AT_M, far, up)
    elif kind in THICK_M:
        level(back, AT_M, 0.0)
        riser(AT_M, 0.0, size_m)
        level(AT_M, AT_M + thick, size_m)
        riser(AT_M + thick, size_m, 0.0)
        level(AT_M + thick, far, 0.0)
    elif kind == "gap":
        level(back, AT_M, 0.0)
        level(AT_M + size_m, far + size_m, 0.0)
    elif kind == "bar":
        low, high = robot.top_m - size_m, robot.top_m + room
        level(back, far, 0.0)
        level(AT_M, AT_M + BAR_M, high)
        quads.append(
            [
                (AT_M, -wide, low),
                (AT_M, wide, low),
                (AT_M + BAR_M, wide, low),
                (AT_M + BAR_M, -wide, low),
            ]
        )
        riser(AT_M, low, high)
        riser(AT_M + BAR_M, high, low)
    else:
        rng, side = np.random.default_rng(0), STONE * room
        level(back, AT_M, 0.0)
        rows, columns = math.ceil(1.0 / side), math.ceil(wide / side)
        heights = size_m * rng.uniform(-0.5, 0.5, size=(rows, 2 * columns))
        for (i, j), z in np.ndenumerate(heights):
            x, y = AT_M + i * side, (j - columns) * side
            level(x, x + 0.95 * side, float(z), y, y + 0.95 * side)
        level(AT_M + rows * side, far + 1.0, 0.0)
    goal += thick + (size_m if kind == "gap" else 1.0 if kind == "stones" else 0.0)
    corners = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for quad in quads for x, y, z in quad)
    faces = "".join(
        "f {} {} {} {}\n".format(*range(4 * k + 1, 4 * k + 5)) for k in range(len(quads))
    )
    path.write_text(corners + faces)
    return goal, 0.0


def stops(answer: stancekit.Answer[stancekit.Motion]) -> str:
    """What there is no plan for: the first group that refuses, or what the search says."""
    report, said = answer.report, answer.message
    if report is not None:
        words = [group.name for group in report.groups if group.verdict == "violated"]
        if words:
            return words[0]
        if report.late:
            return "time"
    if "no way" in said or "expected" in said:
        return "way"
    return "time" if "time" in said else "contacts"


def asked(kind: str, size: float, robot: Robot, folder: Path, limit_s: float, run: bool) -> Row:
    """The row of one question: its status, what stops, processor time, and what comes of it in
    MuJoCo.
    """
    path, begin = folder / "ground.obj", time.process_time()
    goal = ground(kind, size * robot.reach_m, robot, path)
    row: Row = {"status": "error", "run": ""}
    try:
        answer = stancekit.plan(
            path,
            start=(0.0, 0.0),
            goal=goal,
            robot=robot.file,
            time_limit_s=limit_s,
            settings=stancekit.PlanSettings(leaps=False),
        )
        row |= {"status": answer.status.value, "cpu_s": time.process_time() - begin}
        if answer.status.value == "feasible" and run:
            report = stancekit.simulate(answer.solution)
            row["run"] = "as planned" if report.succeeded else report.message
        elif answer.status.value != "feasible":
            row |= {"stops": stops(answer), "why": answer.message[:400]}
    except Exception as error:  # a death is a row, too
        row |= {"stops": "error", "why": f"{type(error).__name__}: {error}"[:400]}
    return {"cpu_s": time.process_time() - begin} | row


def proved(kind: str, size: float, robot: Robot, folder: Path) -> bool:
    """Tell whether the flood proves that no balanced motion leads over it."""
    path = folder / "ground.obj"
    goal = ground(kind, size * robot.reach_m, robot, path)
    passage = laid_between(path, (0.0, 0.0), goal, robot=robot.file).passage()
    return flood(passage) is not None


def largest(works: Callable[[float], bool], halvings: int) -> tuple[float, float]:
    """The largest size that works, 0 for none, and the smallest that does not, by bisection."""
    low, high = math.log(LEAST), math.log(MOST)
    most, least = 0.0, math.inf
    for _ in range(halvings):
        size = math.exp(0.5 * (low + high))
        if works(size):
            most, low = size, math.log(size)
        else:
            least, high = size, math.log(size)
    return most, least


def measured(kind: str, words: str, folder: Path, given: Given, lines: Lines) -> Row:
    """The row of a robot and a kind of ground; every question that was asked is kept, too."""
    robot, halvings = Robot.of(words, folder), 4 if given.quick else given.halvings
    limit_s = min(given.time_limit_s, 10.0) if given.quick else given.time_limit_s

    def row_of(size: float) -> Row:
        key = f"{words}, {kind} {size:.4f}"
        if key not in lines.rows:
            lines.add(key, asked(kind, size, robot, folder, limit_s, given.executed))
        return lines.rows[key]

    most, least = largest(lambda size: row_of(size)["status"] == "feasible", halvings)
    best, next_one = row_of(most) if most else {}, row_of(least) if least < math.inf else {}
    row: Row = {"robot": words, "kind": kind, "reach_m": robot.reach_m, "largest": most}
    row |= {"cpu_s": best.get("cpu_s", 0.0), "run": best.get("run", "")}
    row |= {"next": least if next_one else None, "next_cpu_s": next_one.get("cpu_s", 0.0)}
    row |= {"stops": next_one.get("stops", ""), "why": next_one.get("why", ""), "proved": None}
    if kind in PROVED and not given.quick:
        end = largest(lambda size: not proved(kind, size, robot, folder), given.halvings)[1]
        row["proved"] = end if end < math.inf else None
    return row


def rows(given: Given) -> Iterator[Row]:
    """Rows of all robots and kinds, kept ones as they are."""
    lines = Lines(given.out)
    names = given.robots[:3] if given.quick else given.robots
    with TemporaryDirectory() as folder:
        for kind in given.kinds:
            for words in names:
                if (key := f"{words} {kind}") not in lines.rows:
                    lines.add(key, measured(kind, words, Path(folder), given, lines))
                yield lines.rows[key]


def table(found: list[Row]) -> Iterable[str]:
    """A row a robot and kind, in metres."""
    head = ["kind", "robot", "largest planned [m]", "CPU-s", "in MuJoCo", "next [m]", "stops"]
    lines = []
    for row in found:
        metres = [
            row[name] and row[name] * row["reach_m"] for name in ("largest", "next", "proved")
        ]
        most, least, proof = ("" if each is None else f"{each:.3f}" for each in metres)
        last = [least, row["stops"], f"{row['next_cpu_s']:.1f}", proof]
        lines.append([row["kind"], row["robot"], most, f"{row['cpu_s']:.1f}", row["run"], *last])
    return markdown([*head, "CPU-s", "proved from [m]"], lines)


def ratios(found: list[Row], before: Lines) -> Iterable[str]:
    """How many times as large as before, in the median over robots that had some size."""
    lines = []
    for kind in dict.fromkeys(row["kind"] for row in found):
        pairs = [
            (row["largest"], before.rows[row["key"]]["largest"])
            for row in found
            if row["kind"] == kind and row["key"] in before.rows
        ]
        times = [after / most for after, most in pairs if most]
        medians = [float(np.median([pair[k] for pair in pairs] or [0.0])) for k in (1, 0)]
        lines.append(
            [kind, len(pairs), *medians, float(np.median(times)) if times else "none before"]
        )
    return markdown(["kind", "robots", "before [reaches]", "after", "times, median"], lines)


def main(given: Given) -> None:
    """Ask all robots, and print."""
    found = []
    for row in rows(given):
        given.say(row)
        found.append(row)
    print("\n".join(table(found)))
    if given.against is not None:
        print("\n".join(ratios(found, Lines(given.against))))


if __name__ == "__main__":
    launch(main, Given, __doc__, rows=table)
