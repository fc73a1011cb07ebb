"""Forty questions asked at every door that takes them: statuses, the problems that certificates
prove, objectives.

    python benchmarks/doors.py [--json]

Questions and doors are those of tests/doors.py. A row a question: what it was made to be, what the
doors say, and where two of them differ; exit code 1 where any do, or where a question is not what
it was made to be.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.doors import ask, differences, questions


def main(arguments: list[str]) -> int:
    """Ask all of them and print a row each."""
    counts, wrong = Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for question in questions():
            replies = ask(question, Path(folder))
            found = differences(replies)
            first = next(iter(next(iter(replies.values())).values()))
            other = question.expected not in ("", first.status)
            counts[first.status] += 1
            wrong += bool(found) or other
            doors = {
                kind: {name: asdict(reply) for name, reply in each.items()}
                for kind, each in replies.items()
            }
            row = {
                "question": question.name,
                "expected": question.expected,
                "doors": doors,
                "differences": found,
            }
            if "--json" in arguments:
                print(json.dumps(row), flush=True)
            else:
                many, reply = (
                    sum(map(len, replies.values())),
                    "; ".join([*found, *["not as expected"] * other]),
                )
                print(
                    f"{question.name:16} {first.status:11} {many} doors {reply}".rstrip(),
                    flush=True,
                )
    print(f"{sum(counts.values())} questions, {dict(counts)}: {wrong} wrong", file=sys.stderr)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
