"""Forty questions asked at every door that takes them: statuses, the problems that certificates
prove, objectives.

    python benchmarks/doors.py [--json]

Questions and doors are those of tests/doors.py. A row a question: what it was made to be, what the
doors say, and where two of them differ; exit code 1 where any do, or where a question is not what
it was made to be.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from _bench import Options, Row, launch

from tests.doors import ask, differences, questions


def line(row: Row) -> str:
    """A row for people."""
    statuses = {reply["status"] for each in row["doors"].values() for reply in each.values()}
    many, differ = sum(map(len, row["doors"].values())), "; ".join(row["differences"])
    return f"{row['question']:16} {', '.join(sorted(statuses)):11} {many} doors {differ}".rstrip()


def main(asked: Options) -> int:
    """Ask all of them and print a row each."""
    counts, wrong = Counter[str](), 0
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
            row = {"question": question.name, "expected": question.expected}
            asked.say({**row, "doors": doors, "differences": found}, line)
    print(f"{sum(counts.values())} questions, {dict(counts)}: {wrong} wrong", file=sys.stderr)
    return int(wrong > 0)


if __name__ == "__main__":
    launch(main, Options, __doc__)
