"""Forty questions asked at every door that takes them: statuses, the problems that certificates
prove, objectives.

    python benchmarks/doors.py [--json] [--against v0.1.0]

Questions and doors are those of tests/doors.py. A row a question: what it was made to be, what the
doors say, and where two of them differ; exit code 1 where any do, or where a question is not what
it was made to be. With ``--against`` another checkout asks its own questions at its own doors, and
answers to those that both have may differ by ``--within``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

from _bench import Options, Row, launch
from _checkouts import checkout, of_checkout
from _figures import Answers, report

from tests.doors import ask, differences, questions


@dataclass(frozen=True, kw_only=True)
class Doors(Options):
    """Options of the table."""

    against: str = ""
    """Another checkout, a folder with its links made or a commit, whose answers are compared."""
    within: float = 1e-9
    """Difference that an objective may have, over its magnitude, and over 1 where that is less."""


def line(row: Row) -> str:
    """A row for people."""
    statuses = {reply["status"] for each in row["doors"].values() for reply in each.values()}
    many, differ = sum(map(len, row["doors"].values())), "; ".join(row["differences"])
    return f"{row['question']:16} {', '.join(sorted(statuses)):11} {many} doors {differ}".rstrip()


def main(asked: Doors) -> int:
    """Ask all of them and print a row each."""
    if asked.against:
        with checkout(asked.against) as other:
            before = answers(other)
    counts, wrong, now = Counter[str](), 0, dict[str, Row]()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for question in questions():
            replies = ask(question, Path(folder))
            found = differences(replies)
            first = next(iter(next(iter(replies.values())).values()))
            if question.expected not in ("", first.status):
                found.append("not as expected")
            counts[first.status] += 1
            wrong += bool(found)
            doors = {
                kind: {name: asdict(reply) for name, reply in each.items()}
                for kind, each in replies.items()
            }
            row = {"question": question.name, "expected": question.expected, "doors": doors}
            now |= answered(row)
            asked.say({**row, "differences": found}, line)
    print(f"{sum(counts.values())} questions, {dict(counts)}: {wrong} wrong", file=sys.stderr)
    others = report(before, now, asked.within, "answers", sys.stderr) if asked.against else 0
    return int(wrong > 0 or others > 0)


def answers(root: Path) -> Answers:
    """The answers of another checkout to its own questions."""
    command = [sys.executable, str(root / "benchmarks" / "doors.py"), "--json"]
    done = subprocess.run(
        command, env=of_checkout(root), capture_output=True, text=True, check=False
    )
    rows = [json.loads(text) for text in done.stdout.splitlines() if text.startswith("{")]
    if not rows:
        raise SystemExit(f"{root}: {done.stderr[-2000:]}")
    return {name: reply for row in rows for name, reply in answered(row).items()}


def answered(row: Row) -> dict[str, Row]:
    """The replies of a row, by question, kind and door."""
    return {
        f"{row['question']}, {kind}, {door}": reply
        for kind, each in row["doors"].items()
        for door, reply in each.items()
    }


if __name__ == "__main__":
    launch(main, Doors, __doc__)
