"""Do accepted plans stand? A fixed list of robots and grounds, planned, and played by a referee of
its own.

    python benchmarks/stands.py plan --out FOLDER [--first N] [--robots go1 hyq] [--draws 0]
    python benchmarks/stands.py play FOLDER [--no-world]
    python benchmarks/stands.py play FILE.json ... --out LINES.jsonl [--mass 1.1 --friction 0.85]
    python benchmarks/stands.py push FOLDER|FILE.json ... --out LINES.jsonl [--stances 40]
    python benchmarks/stands.py table FOLDER
    python benchmarks/stands.py layouts FOLDER [--planned FOLDER ...] [--entries 12] [--write]

The list, its limits, and how grounds are scaled are in stands/list.yaml; the referee,
benchmarks/referee, imports nothing of the package, and its settings are in stands/referee.yaml.
Robots of example-robot-data and pybullet_data need these packages; where one is not installed, its
line says so.

plan: every entry of the list by the package's own command ``plan``; the plan's file, and a line of
plans.jsonl with what was said and how long it took. What is there is not made again, whatever ended
the command before. Limits are of wall-clock time, as the command's own: on a busy computer a line
says starved, and --starved plans it again. play: every accepted plan of a folder in the referee,
with and without feedback of the body, and by the package's own command ``run`` in MuJoCo; or files,
plans, walks and leaps, with what is wrong with robot and ground. stood: not .12 m or .6 rad off on the
way, nor .05 m or .2 rad at the end. --perturbed: every file once more, with all errors drawn from
--seed: mass up to +10 %, friction down to 85 %, offsets up to .5 deg, delays up to 15 ms, soft
contacts. push: stances of plans drawn by seed, each pushed at the base in eight directions until it
falls; what was held in the worst of them against what the verifier says that the stance bears.
table: shares with 95 % intervals (Wilson), by robot and by ground: of the list those accepted; of
those that stood in the referee with feedback and without, and in the package's own run (world; what
it refuses does not stand there). layouts: entries that have no plan
over the layout that is asked for, over each of the others alone, and the table of successes that
says in which order the package tries them; --write puts it there. Limits are of processor time
here, so that a busy computer gives the same table. With --planned, folders of ``plan``, their
entries alone are tried, and those whose plan there is over the layout that is asked for are not;
--entries draws so many of the others by seed. order: whether that order helps: for every robot the
table is made of the other robots' entries, and its entries are gone through in that order, and in
the order in which the package has them, until a plan is found or --budget-s of processor time ends.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import _stand_layouts as layouts
import _stand_pushes as pushes
import numpy as np
import tyro
from _bench import Options
from _stand_commands import MARGINS, planned, ran
from _stand_list import LIST, Entry, Lines, entries, read_list
from referee import BrokenFile, Wrong, play, read_settings
from threadpoolctl import threadpool_limits

from stancekit.learners.evaluation.evaluate import Share

PATIENCE_S = 900.0
"""A run in the package's MuJoCo is ended after so long."""
WAYS = {"referee": Wrong(), "referee_feedback": Wrong(feedback=True)}
"""How every accepted plan of a folder is played."""


@dataclass(frozen=True, kw_only=True)
class Listed(Options):
    """Entries of the list."""

    first: int | None = None
    """So many entries, in the list's order."""
    robots: tuple[str, ...] = ()
    grounds: tuple[str, ...] = ()
    draws: tuple[int, ...] = ()
    listed: Path = LIST

    def chosen(self) -> Iterator[Entry]:
        """The entries that are asked for."""
        for count, entry in enumerate(entries(self.listed)):
            wanted = (
                (entry.robot, self.robots),
                (entry.kind, self.grounds),
                (entry.draw, self.draws),
            )
            if (self.first is None or count < self.first) and all(
                not some or value in some for value, some in wanted
            ):
                yield entry


@dataclass(frozen=True, kw_only=True)
class Plan(Listed):
    """Plan the list, or what is left of it."""

    out: Path
    """Folder of plan files and lines; what is there stays."""
    starved: bool = False
    """Plan again what was not planned because other processes had the processors."""

    def run(self) -> None:
        """Plan what is not there yet."""
        lines, limit = Lines(self.out / "plans.jsonl"), read_list(self.listed)["time_limit_s"]
        for entry in self.chosen():
            known = lines.rows.get(entry.name)
            if known is None or (self.starved and known.get("starved")):
                self.say(lines.add(entry.name, planned(entry, self.out, limit)))


@dataclass(frozen=True, kw_only=True)
class Play(Options):
    """Play the accepted plans of a folder, or files."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """One folder of ``plan``, or files."""
    out: Path | None = None
    """Lines of results; in the folder unless said."""
    world: bool = True
    """Also run plans in the package's own MuJoCo."""
    perturbed: int = 0
    """Play so many files of them, drawn by seed, with errors drawn by seed, instead."""
    feedback: bool = True
    offset_deg: float = 0.0
    delay_ms: float = 0.0
    mass: float = 1.0
    friction: float = 1.0
    soft: bool = False
    contact_s: float | None = None
    contact_damping: float | None = None
    stiffness: float = 1.0

    def run(self) -> None:
        """Play what is not there yet."""
        files = found_files(self.paths)
        folder = self.paths[0] if self.paths[0].is_dir() else Path()
        lines = Lines(self.out or folder / "played.jsonl")
        asked = Wrong(**{each.name: getattr(self, each.name) for each in fields(Wrong)})
        if self.perturbed:
            rng = np.random.default_rng(self.seed)
            chosen = rng.permutation(len(files))[: self.perturbed]
            for index, own in zip(sorted(chosen.tolist()), rng.spawn(len(chosen)), strict=True):
                self.one(lines, files[index], "perturbed", perturbed(own, self.feedback))
            return
        for file in files:
            ways = WAYS if asked == Wrong(feedback=True, seed=self.seed) else {"asked": asked}
            for way, wrong in ways.items():
                self.one(lines, file, way, wrong)
            if self.world:
                self.in_the_world(lines, file)

    def one(self, lines: Lines, file: Path, way: str, wrong: Wrong) -> None:
        """Play a file in one way unless its line is there."""
        settings = read_settings()
        said = wrong.said()
        key = key_of(file, way, settings.sha256[:8], said)
        if key in lines.rows:
            return
        row = {"file": file.stem, "way": way, "wrong": said, "settings": settings.sha256[:8]}
        try:
            self.say(lines.add(key, row | play(file, settings, wrong).json()))
        except BrokenFile as error:
            self.say(lines.add(key, row | {"stood": False, "broken": str(error)}))

    def in_the_world(self, lines: Lines, file: Path) -> None:
        """Run a file by the package's own command unless its line is there."""
        key = key_of(file, "world", "", {})
        if key not in lines.rows:
            row = {"file": file.stem, "way": "world", "wrong": {}}
            self.say(lines.add(key, row | ran(file, PATIENCE_S)))


@dataclass(frozen=True, kw_only=True)
class Pushes(Options):
    """Push stances until they fall."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of ``plan``, or files."""
    out: Path
    stances: int = 40
    feedback: bool = True
    most_share: float = 1.0
    """Largest push, in units of the weight."""
    whole: bool = False
    """Push in every direction until it falls, and not only as far as the worst direction so far."""

    def run(self) -> None:
        """Push the stances that are drawn by seed, and sum up all lines there are."""
        lines, settings, wrong = Lines(self.out), read_settings(), Wrong(feedback=self.feedback)
        chosen = pushes.drawn(pushes.stances(found_files(self.paths)), self.stances, self.seed)
        for file, which in chosen.items():
            for key, row in pushes.rows(
                file, which, lines, settings, wrong, self.most_share, self.whole
            ):
                self.say(lines.add(key, row))
        self.say(pushes.summary(list(lines.rows.values())), pushes.line)


@dataclass(frozen=True, kw_only=True)
class Table(Options):
    """Print shares of a folder's lines."""

    folder: Annotated[Path, tyro.conf.Positional]

    def run(self) -> None:
        """By robot, by ground, and of all."""
        plans = list(Lines(self.folder / "plans.jsonl").rows.values())
        played = list(Lines(self.folder / "played.jsonl").rows.values())
        if not plans:
            raise SystemExit(f"{self.folder}: expected plans.jsonl with lines, found none")
        for name, some in grouped(plans):
            self.say(shares(name, some, played), line)


@dataclass(frozen=True, kw_only=True)
class Layouts(Listed):
    """Try layouts one by one, and make the table of successes."""

    folder: Annotated[Path, tyro.conf.Positional]
    planned: tuple[Path, ...] = ()
    """Folders of ``plan``: only their entries, but for those planned as they were asked for."""
    entries: int | None = None
    """So many entries, drawn by seed; all of them unless said."""
    limit_s: float = 12.0
    """Processor time of one layout; what is not decided by then has no plan."""
    write: bool = False
    """Write the table into the package."""

    def run(self) -> None:
        """Try what is not there yet, and print the table."""
        lines = Lines(self.folder / "layouts.jsonl")
        some = list(self.chosen())
        if self.planned:
            left = {name for folder in self.planned for name in not_as_asked(folder)}
            some = [entry for entry in some if entry.name in left]
        if self.entries is not None:
            drawn = np.random.default_rng(self.seed).permutation(len(some))
            some = [some[index] for index in drawn[: self.entries]]
        for entry in some:
            for row in layouts.rows(entry, self.folder, lines, self.limit_s):
                self.say(row)
        tables = layouts.table(list(lines.rows.values()))
        for missing, rows in tables.items():
            for row in rows:
                self.say({"missing": missing, **row})
        if self.write:
            layouts.write(tables)


@dataclass(frozen=True, kw_only=True)
class Order(Options):
    """Say whether the order that the table gives helps robots that it was not made from."""

    folder: Annotated[Path, tyro.conf.Positional]
    budget_s: float = 40.0
    """Processor time of an entry, over all of its layouts."""

    def run(self) -> None:
        """Print shares and processor time by order."""
        rows = list(Lines(self.folder / "layouts.jsonl").rows.values())
        for name, found in layouts.orders(rows, self.budget_s).items():
            solved = [accepted for accepted, _ in found.values()]
            cpu_s = [cpu_s for _, cpu_s in found.values()]
            shown = {"order": name, "planned": _share(solved), "cpu_s": round(sum(cpu_s), 1)}
            self.say(shown | {"by_robot": layouts.by_robot(found)})


def not_as_asked(folder: Path) -> list[str]:
    """Names of the entries of a folder of ``plan`` that have no plan over the layout that was asked
    for.
    """
    names = []
    for row in Lines(folder / "plans.jsonl").rows.values():
        file = folder / "plans" / f"{row['key']}.json"
        as_asked = row["accepted"] and not json.loads(file.read_text(encoding="utf-8"))[
            "provenance"
        ].get("layout")
        names += [] if as_asked else [row["key"]]
    return names


def found_files(paths: Sequence[Path]) -> list[Path]:
    """The accepted plans of folders of ``plan``, and files as they are."""
    found = list[Path]()
    for path in paths:
        rows = Lines(path / "plans.jsonl").rows.values() if path.is_dir() else ()
        found += [path / "plans" / f"{row['key']}.json" for row in rows if row["accepted"]]
        found += [] if path.is_dir() else [path]
    return found


def key_of(file: Path, way: str, settings: str, said: Mapping[str, Any]) -> str:
    """What a line is known by: the file's bytes, how it was played, and the settings."""
    content = hashlib.sha256(file.read_bytes()).hexdigest()[:12] if file.exists() else "none"
    wrong = ",".join(f"{name}={value}" for name, value in sorted(said.items()))
    return f"{file.stem}:{content}:{way}:{settings}:{wrong}"


def perturbed(rng: np.random.Generator, feedback: bool) -> Wrong:
    """All errors at once, each drawn evenly between nothing and what it says."""
    return Wrong(
        feedback=feedback,
        mass=1.0 + rng.uniform(0.0, 0.1),
        friction=1.0 - rng.uniform(0.0, 0.15),
        offset_deg=rng.uniform(0.0, 0.5),
        delay_ms=rng.uniform(0.0, 15.0),
        soft=True,
        seed=int(rng.integers(2**31)),
    )


def grouped(plans: Sequence[dict[str, Any]]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """The plans of every robot, of every ground, and all of them."""
    for by in ("robot", "ground"):
        for name in dict.fromkeys(row[by] for row in plans):
            yield name, [row for row in plans if row[by] == name]
    yield "all", list(plans)


def shares(
    name: str, plans: Sequence[dict[str, Any]], played: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """A row of the table."""
    accepted = [row for row in plans if row["accepted"]]
    names = {row["key"] for row in accepted}
    found: dict[str, Any] = {
        "name": name,
        "accepted": _share([row["accepted"] for row in plans]),
        "cpu_s": round(float(np.median([row["cpu_s"] for row in plans])), 1),
    }
    for way in ("referee_feedback", "referee", "world"):
        rows = [row["stood"] for row in played if row["way"] == way and row["file"] in names]
        found[way] = _share(rows)
    found["refused"] = sum(
        row["way"] == "world" and row["file"] in names and row["code"] == 2 for row in played
    )
    for margin in MARGINS:
        values = [row["margins"][margin] for row in accepted if margin in row["margins"]]
        if values:
            found[margin] = [round(float(np.min(values)), 4), round(float(np.median(values)), 4)]
    return found


def _share(answers: Sequence[bool]) -> list[float]:
    """How many of how many, and the interval."""
    if not answers:
        return [0, 0, 0.0, 1.0]
    low, high = Share(hits=sum(answers), of=len(answers)).interval
    return [sum(answers), len(answers), round(low, 3), round(high, 3)]


def line(row: Mapping[str, Any]) -> str:
    """A row for people."""
    parts = [f"{row['name']:14}"]
    for name in ("accepted", "referee_feedback", "referee", "world"):
        count, of, low, high = row[name]
        parts.append(f"{name} {count:3}/{of:<3} [{100 * low:3.0f}, {100 * high:3.0f}] %")
    parts += [
        f"{margin} least {row[margin][0]} median {row[margin][1]}"
        for margin in MARGINS
        if margin in row
    ]
    refused = f"world refused {row['refused']}"
    return "  ".join([*parts, refused, f"CPU {row['cpu_s']} s"])


def main() -> None:
    """Do what is asked for."""
    with threadpool_limits(1):
        asked = tyro.extras.subcommand_cli_from_dict(
            {
                "plan": Plan,
                "play": Play,
                "push": Pushes,
                "table": Table,
                "layouts": Layouts,
                "order": Order,
            },
            description=__doc__,
        )
        asked.run()


if __name__ == "__main__":
    main()
