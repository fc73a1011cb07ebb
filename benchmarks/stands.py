"""Do accepted plans stand? A fixed list of robots and grounds, planned, and played in a simulator of a stranger's.

    python benchmarks/stands.py plan --out FOLDER [--first N] [--robots go1 hyq] [--grounds gap] [--draws 0]
    python benchmarks/stands.py table FOLDER

The list, its limits, and how grounds are scaled are in stands/list.yaml. Robots of example-robot-data and pybullet_data are left
out where these packages are not installed, and said.

plan: every entry of the list by the package's own command ``plan``; the plan's file, and a line of plans.jsonl with what was
said and how long it took. What is there is not made again, whatever ended the command before.
table: shares with 95 % intervals (Wilson), by robot and by ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from _bench import Options
from _stand_commands import planned
from _stand_list import LIST, Entry, Lines, entries, read_list
from threadpoolctl import threadpool_limits


@dataclass(frozen=True, kw_only=True)
class Plan(Options):
    """Plan the list."""

    out: Path
    """Folder of plan files and lines; what is there stays."""
    first: int | None = None
    """So many entries, in the list's order."""
    robots: tuple[str, ...] = ()
    grounds: tuple[str, ...] = ()
    draws: tuple[int, ...] = ()
    list_: Path = LIST

    def chosen(self) -> Iterator[Entry]:
        """The entries that are asked for."""
        for count, entry in enumerate(entries(self.list_)):
            wanted = (
                (entry.robot, self.robots),
                (entry.kind, self.grounds),
                (entry.draw, self.draws),
            )
            if (self.first is None or count < self.first) and all(
                not some or value in some for value, some in wanted
            ):
                yield entry

    def run(self) -> None:
        """Plan what is not there yet."""
        lines, limit = Lines(self.out / "plans.jsonl"), read_list(self.list_)["time_limit_s"]
        for entry in self.chosen():
            if entry.name not in lines.rows:
                self.say(lines.add(entry.name, planned(entry, self.out, limit)))


def main() -> None:
    """Do what is asked for."""
    with threadpool_limits(1):
        asked = tyro.cli(Plan, description=__doc__)
        asked.run()


if __name__ == "__main__":
    main()
