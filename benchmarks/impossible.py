"""Is *infeasible* true of the question that was asked? Robots of 2 to 8 legs are drawn, and each is
asked what it obviously can do, and what nobody can: steps, walls and gaps beyond its reach.

    python benchmarks/impossible.py --quick
    python benchmarks/impossible.py --robots 25 --out impossible.jsonl

Rows are kept as they come (``--out``), and a run that was stopped goes on from them. Possible
questions: half a metre ahead, back and aside, 5 cm, standing still, 5 cm up and down, a ramp of 5
degrees. Impossible ones: steps and walls at least 1.2 times as high as a foot gets below the centre
of mass in any tilt, gaps at least 1.2 times as wide as it gets aside; both are the outer reach, since
tilt is free. The band is between the largest that a plan crosses and the smallest that is proved, of
the first robots that are drawn (``--bands``) and of others by name (``--named``); what a plan crosses
is executed in MuJoCo, and the flood is asked of the largest: it may not refute it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _bench import Lines, Options, Row, launch, markdown, share

import stancekit
from stancekit.planners.robot.outer_sets import Extent
from stancekit.planners.robot.robot_file import robot_of

AHEAD_M, WIDE_M, THICK_M = 0.5, 1.5, 0.1
POSSIBLE = {
    "ahead": ("flat", (0.5, 0.0)),
    "back": ("flat", (-0.5, 0.0)),
    "left": ("flat", (0.0, 0.5)),
    "right": ("flat", (0.0, -0.5)),
    "askew": ("flat", (0.35, 0.35)),
    "5 cm": ("flat", (0.05, 0.0)),
    "still": ("flat", (0.0, 0.0)),
    "up 5 cm": ("step:0.05", (1.0, 0.0)),
    "down 5 cm": ("step:-0.05", (1.0, 0.0)),
    "ramp": ("ramp:0.0873", (0.8, 0.0)),
}
BEYOND = (1.2, 1.5, 2.0)
"""Sizes of what is impossible, in reaches."""
HALVINGS = 5


@dataclass(frozen=True, kw_only=True)
class Given(Options):
    """Options of this benchmark."""

    robots: int = 25
    """Number of robots."""
    time_limit_s: float = 60.0
    """Time limit of every plan [s]."""
    out: Path = Path("impossible.jsonl")
    """Rows, kept as they come."""
    postures: int = 20
    """Witnessed postures of every robot with legs of 20 to 85 % of its mass."""
    heavy: int = 10
    """Number of such robots."""
    sizes: int = 3
    """Number of sizes of what is impossible, the smallest first."""
    bands: int = 0
    """Number of drawn robots whose band is looked for in every kind."""
    named: tuple[str, ...] = ()
    """Names or files of others whose band is looked for, too."""
    quick: bool = False
    """Six robots, and one size of what is impossible."""


def urdf(legs: int, rng: np.random.Generator, share: float | None = None) -> str:
    """A robot of so many legs of roll, pitch and knee with round feet, drawn.

    Arguments:
        share: of the mass that is in its legs; drawn where it is not given.
    """
    size, side = rng.uniform(0.6, 1.6), 2 if legs % 2 == 0 else 1
    thigh, shank = size * rng.uniform(0.16, 0.24, 2)
    rows = max(legs // side, 1)
    long = size * (0.14 if legs == 2 else rng.uniform(0.3, 0.5))
    wide, tall = (
        size * rng.uniform(0.18, 0.26),
        size * (0.3 if legs == 2 else rng.uniform(0.12, 0.2)),
    )
    mass = 12.0 * size**3
    share = rng.uniform(0.2, 0.5) if share is None else share
    trunk, of_leg = (1.0 - share) * mass, share * mass / legs
    parts = [_link("trunk", trunk, (long, wide, tall), 0.0)]
    places = []
    for k in range(legs):
        if legs % 2:
            turn = 2.0 * np.pi * k / legs
            places.append((0.5 * long * np.cos(turn), 0.5 * long * np.sin(turn)))
        else:
            along = 0.0 if rows == 1 else 0.5 * long * (1.0 - 2.0 * (k // 2) / (rows - 1))
            places.append((along, 0.5 * wide * (1 if k % 2 == 0 else -1)))
    effort, thin = 60.0 * size**4, 0.03 * size
    for k, (x, y) in enumerate(places):
        name, low = f"leg{k}", -0.5 * tall
        bend = 1.0 if x >= 0.0 or legs == 2 else -1.0
        parts += [
            _link(f"{name}_hip", 0.3 * of_leg, None, 0.0),
            _joint(
                f"{name}_roll", "trunk", f"{name}_hip", (x, y, low), (1, 0, 0), -0.7, 0.7, effort
            ),
            _link(f"{name}_thigh", 0.45 * of_leg, (thin, thin, 0.7 * thigh), -0.5 * thigh),
            _joint(
                f"{name}_pitch",
                f"{name}_hip",
                f"{name}_thigh",
                (0, 0, -0.04 * size),
                (0, 1, 0),
                -1.3,
                1.3,
                effort,
            ),
            _link(f"{name}_shank", 0.25 * of_leg, (thin, thin, 0.7 * shank), -0.5 * shank),
            _joint(
                f"{name}_knee",
                f"{name}_thigh",
                f"{name}_shank",
                (0, 0, -thigh),
                (0, 1, 0),
                *((-2.3, -0.1) if bend < 0.0 else (0.1, 2.3)),
                effort,
            ),
            f'<link name="{name}_foot"><inertial><mass value="{0.02 * of_leg + 0.01:g}"/><inertia ixx="1e-5" ixy="0" '
            'ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial><collision><geometry>'
            f'<sphere radius="{0.018 * size:g}"/></geometry></collision></link>',
            f'<joint name="{name}_fix" type="fixed"><parent link="{name}_shank"/><child link="{name}_foot"/>'
            f'<origin xyz="0 0 {-shank:g}"/></joint>',
        ]
    return f'<robot name="drawn{legs}">{"".join(parts)}</robot>'


def _link(name: str, mass: float, box: tuple[float, ...] | None, low: float) -> str:
    side = 0.1 if box is None else float(np.mean(box))
    moment = mass * side**2 / 6.0
    shape = ""
    if box is not None:
        size = " ".join(f"{each:g}" for each in box)
        place = f'<origin xyz="0 0 {low:g}"/><geometry><box size="{size}"/></geometry>'
        shape = f"<collision>{place}</collision>"
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {low:g}"/><mass value="{mass:g}"/><inertia ixx="{moment:g}" '
        f'ixy="0" ixz="0" iyy="{moment:g}" iyz="0" izz="{moment:g}"/></inertial>{shape}</link>'
    )


def _joint(
    name: str,
    parent: str,
    child: str,
    at: tuple[float, ...],
    axis: tuple[int, ...],
    low: float,
    high: float,
    effort: float,
) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="'
        f'{at[0]:g} {at[1]:g} {at[2]:g}"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/><limit lower="{low:g}" '
        f'upper="{high:g}" effort="{effort:g}" velocity="12"/></joint>'
    )


def ground(words: str, folder: Path, room_m: float) -> Path:
    """An OBJ file: flat, or a step, wall, gap or ramp of this size [m or rad] half a metre ahead.

    Arguments:
        room_m: of level ground on all sides.
    """
    kind, _, text = words.partition(":")
    size, w = float(text or 0.0), WIDE_M + room_m
    back, far = -1.0 - room_m, 2.0 + room_m
    quads: list[list[tuple[float, float, float]]] = []

    def level(x0: float, x1: float, z: float) -> None:
        quads.append([(x0, -w, z), (x1, -w, z), (x1, w, z), (x0, w, z)])

    def riser(x: float, low: float, high: float) -> None:
        corners = [(x, -w, low), (x, -w, high), (x, w, high), (x, w, low)]
        quads.append(corners if high > low else corners[::-1])

    level(back, AHEAD_M if kind != "flat" else far, 0.0)
    if kind == "step":
        riser(AHEAD_M, 0.0, size)
        level(AHEAD_M, far, size)
    elif kind == "wall":
        riser(AHEAD_M, 0.0, size)
        level(AHEAD_M, AHEAD_M + THICK_M, size)
        riser(AHEAD_M + THICK_M, size, 0.0)
        level(AHEAD_M + THICK_M, far, 0.0)
    elif kind == "gap":
        level(AHEAD_M + size, far + size, 0.0)
    elif kind == "ramp":
        rise = float(np.tan(size)) * (far - AHEAD_M)
        quads.append([(AHEAD_M, -w, 0.0), (far, -w, rise), (far, w, rise), (AHEAD_M, w, 0.0)])
    path = folder / f"{kind}-{size:.4f}-{room_m:.2f}.obj"
    corners = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for quad in quads for x, y, z in quad)
    faces = "".join(
        f"f {4 * k + 1} {4 * k + 2} {4 * k + 3} {4 * k + 4}\n" for k in range(len(quads))
    )
    path.write_text(corners + faces)
    return path


def asked(
    words: str,
    goal: tuple[float, float],
    robot: Path | str,
    room_m: float,
    given: Given,
    *,
    executed: bool = False,
) -> Row:
    """The row of one question: its status, and the processor time.

    Arguments:
        executed: run what is planned in MuJoCo, and say what comes of it.
    """
    about: Row = {}
    begin = time.process_time()
    with TemporaryDirectory() as folder:
        try:
            answer = stancekit.plan(
                ground(words, Path(folder), room_m),
                start=(0.0, 0.0),
                goal=goal,
                robot=robot,
                time_limit_s=given.time_limit_s,
                settings=stancekit.PlanSettings(leaps=False),
            )
            status, why = answer.status.value, answer.message
            if executed and status == "feasible" and answer.solution is not None:
                report = stancekit.simulate(answer.solution)
                about["run"] = "as planned" if report.succeeded else report.message
        except Exception as error:  # an error is what is counted here
            status, why = "error", f"{type(error).__name__}: {error}"
    return {"status": status, "cpu_s": time.process_time() - begin, "why": why[:300], **about}


def proved(words: str, goal: tuple[float, float], robot: Path | str, room_m: float) -> Row:
    """The row of one question to the flood alone."""
    from stancekit.planners.problem.course_between import laid_between
    from stancekit.planners.search.flood import flood

    begin = time.process_time()
    with TemporaryDirectory() as folder:
        passage = laid_between(
            ground(words, Path(folder), room_m), (0.0, 0.0), goal, robot=str(robot)
        ).passage()
    return {"proved": flood(passage) is not None, "cpu_s": time.process_time() - begin}


def witnessed(path: Path, count: int, rng: np.random.Generator) -> list[str]:
    """Statuses of postures in which a robot stands still: joints drawn, its toes on small patches
    where they are, its centre of mass over what they span, with vertical forces.
    """
    from scipy.optimize import nnls

    from stancekit import Contact, Patch, Problem
    from stancekit.planners.robot.kinematics import Kinematics

    robot, found = robot_of(path), list[str]()
    known = Kinematics(robot)
    corner = 0.012 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    while len(found) < count:
        angles = np.concatenate([leg.random_angles(1, rng)[0] for leg in known.model.legs])
        feet = known.feet(angles) - known.com_offset(angles)
        toes = feet - known.radii_m[:, None] * np.array([0.0, 0.0, 1.0])
        weights = np.vstack([np.ones(len(toes)), toes[:, :2].T])
        if nnls(weights, np.array([1.0, 0.0, 0.0]))[1] > 1e-9:
            continue
        contacts = [
            Contact(
                leg=limb.name,
                shoulder_m=limb.shoulder_m,
                reach_m=limb.reach_m,
                reach_rows=limb.reach_rows,
                patch=Patch(
                    vertices_m=toe + corner,
                    normal=[0, 0, 1],
                    shear_reference=[1, 0, 0],
                    friction=0.8,
                ),
                force_min=np.array([0.0, -1.0, -1.0]),
                force_max=np.ones(3),
            )
            for limb, toe in zip(robot.limbs, toes, strict=True)
        ]
        problem = Problem.posture(
            contacts,
            mass_kg=robot.mass_kg,
            com_nominal_m=np.zeros(3),
            com_radius_m=0.005,
            tilt_limit_rad=0.02,
            robot=robot.identity,
        )
        found.append(stancekit.plan(problem, robot=robot, time_limit_s=20.0).status.value)
    return found


def heavy_rows(given: Given) -> Iterator[Row]:
    """Rows of robots with heavy legs, kept ones as they are."""
    lines = Lines(given.out)
    with TemporaryDirectory() as folder:
        for number in range(2 if given.quick else given.heavy):
            key, heavy = f"heavy {number}", float(np.linspace(0.85, 0.2, 10)[number % 10])
            if key not in lines.rows:
                rng = np.random.default_rng([given.seed, 1000 + number])
                path = Path(folder) / f"heavy{number}.urdf"
                path.write_text(urdf(4 + 2 * (number % 2), rng, heavy))
                words = witnessed(path, given.postures, rng)
                about = {"part": "witnessed", "share": heavy, "postures": len(words)}
                counts = {each: words.count(each) for each in sorted(set(words))}
                lines.add(key, about | counts)
            yield lines.rows[key]


def rows(given: Given) -> Iterator[Row]:
    """Rows of all robots and questions, kept ones as they are."""
    lines, count = Lines(given.out), 6 if given.quick else given.robots
    with TemporaryDirectory() as folder:
        for number in range(count):
            legs = 2 + number % 7
            path = Path(folder) / f"drawn{number}.urdf"
            path.write_text(urdf(legs, np.random.default_rng([given.seed, number])))
            extent = Extent.of(robot_of(path))
            room = extent.reach_m
            about = {
                "robot": number,
                "legs": legs,
                "reach_m": room,
                "outward_m": extent.outward_m,
            }
            for name, (words, goal) in POSSIBLE.items():
                key = f"{number} {name}"
                if key not in lines.rows:
                    lines.add(
                        key,
                        {
                            **about,
                            "part": "possible",
                            "kind": name,
                            **asked(words, goal, path, room, given),
                        },
                    )
                yield lines.rows[key]
            for kind in ("step", "wall", "gap"):
                for factor in BEYOND[: 1 if given.quick else given.sizes]:
                    key, size = f"{number} {kind} {factor}", factor * room
                    goal = (AHEAD_M + 0.4 + 0.5 * room + (size if kind == "gap" else 0.0), 0.0)
                    if key not in lines.rows:
                        row = proved(f"{kind}:{size:.6f}", goal, path, room)
                        lines.add(
                            key,
                            {**about, "part": "impossible", "kind": kind, "factor": factor, **row},
                        )
                    yield lines.rows[key]


def band_rows(given: Given) -> Iterator[Row]:
    """Rows of bands, kept ones as they are."""
    lines = Lines(given.out)
    with TemporaryDirectory() as folder:
        who: dict[str, Path | str] = {}
        for number in range(given.bands):
            path = Path(folder) / f"drawn{number}.urdf"
            path.write_text(urdf(2 + number % 7, np.random.default_rng([given.seed, number])))
            who[f"drawn {number}"] = path
        for name, file in (who | {name: name for name in given.named}).items():
            robot = robot_of(file)
            room = Extent.of(robot).reach_m
            about = {
                "part": "band",
                "robot": name,
                "legs": len(robot.limbs),
                "feet": "balls" if all(limb.sole_m is None for limb in robot.limbs) else "soles",
                "reach_m": room,
            }
            for kind in ("step", "wall", "gap"):
                key = f"{name} {kind} band"
                if key not in lines.rows:
                    lines.add(key, {**about, "kind": kind, **_band(kind, file, room, given)})
                yield lines.rows[key]


def _band(kind: str, robot: Path | str, room: float, given: Given) -> Row:
    """Largest size of a kind that is planned, and the smallest that is proved, in reaches; what comes
    of the largest in MuJoCo, whether the flood refutes it, and why the smallest that is not planned
    is not.
    """

    def question(size: float) -> tuple[str, tuple[float, float]]:
        aside = size * room if kind == "gap" else 0.0
        return f"{kind}:{size * room:.6f}", (AHEAD_M + 0.4 + 0.5 * room + aside, 0.0)

    def is_proved(size: float) -> bool:
        return bool(proved(*question(size), robot, room)["proved"])

    low, least = 0.0, 2.5
    for _ in range(HALVINGS):
        middle = 0.5 * (low + least)
        low, least = (low, middle) if is_proved(middle) else (middle, least)
    most, high, row, why = 0.0, least, {"run": ""}, ""
    for _ in range(HALVINGS):
        middle = 0.5 * (most + high)
        answer = asked(*question(middle), robot, room, given, executed=True)
        if answer["status"] == "feasible":
            most, row = middle, answer
        else:
            high, why = middle, answer["why"]
    refuted = most > 0.0 and is_proved(most)
    return {"planned": most, "proved": least, "run": row["run"], "refuted": refuted, "why": why}


def table(found: list[Row]) -> Iterable[str]:
    """What was asked, by legs and by kind."""
    possible = [row for row in found if row["part"] == "possible"]
    head = ["legs", "possible", "planned", "infeasible", "errors", "CPU-s, median"]
    lines = []
    for legs in sorted({row["legs"] for row in possible}):
        mine = [row for row in possible if row["legs"] == legs]
        words = [row["status"] for row in mine]
        seconds = float(np.median([row["cpu_s"] for row in mine]))
        lines.append(
            [
                legs,
                len(mine),
                share(words.count("feasible"), len(mine)),
                words.count("infeasible"),
                words.count("error"),
                f"{seconds:.1f}",
            ]
        )
    yield from markdown(head, lines)
    yield ""
    lines = []
    beyond = [row for row in found if row["part"] == "impossible"]
    for kind in ("step", "wall", "gap"):
        mine = [row for row in beyond if row["kind"] == kind]
        count = sum(row["proved"] for row in mine)
        most = max((row["cpu_s"] for row in mine), default=0.0)
        lines.append([kind, len(mine), share(count, len(mine)), f"{most:.1f}"])
    yield from markdown(["impossible", "asked", "proved", "CPU-s, most"], lines)
    heavy = [row for row in found if row["part"] == "witnessed"]
    count, false = (sum(row.get(name, 0) for row in heavy) for name in ("postures", "infeasible"))
    yield f"\nWitnessed postures of {len(heavy)} robots with heavy legs: {count}, infeasible: {false}"
    bands = [row for row in found if row["part"] == "band"]
    if bands:
        yield ""
        lines = [
            [
                row["robot"],
                row["legs"],
                row["feet"],
                row["kind"],
                f"{row['planned'] * row['reach_m']:.2f}",
                f"{row['proved'] * row['reach_m']:.2f}",
                f"{row['proved'] / row['planned']:.1f}" if row["planned"] else "",
                row["run"] or "not planned",
                row["why"],
            ]
            for row in bands
        ]
        head = ["robot", "legs", "feet", "kind", "largest planned [m]", "smallest proved [m]"]
        yield from markdown([*head, "times", "in MuJoCo", "the next larger one"], lines)


def main(given: Given) -> int:
    """Ask all robots; 1 where an answer is false."""
    found = []
    for row in chain(heavy_rows(given), rows(given), band_rows(given)):
        given.say(row)
        found.append(row)
    wrong = [
        row
        for row in found
        if row.get("status") in ("infeasible", "error")
        or row.get("infeasible", 0)
        or row.get("refuted")
    ]
    print("\n".join(table(found)))
    return int(bool(wrong))


if __name__ == "__main__":
    launch(main, Given, __doc__, rows=table)
