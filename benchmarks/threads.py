"""Threads that call one function at a time each get, to the last bit, what one alone gets; a forked
child, too.

    python benchmarks/threads.py [--calls 50] [--folder out/threads] [--only NAME …]

A row a function: calls of four threads together, and how many of their answers differ from those of
one thread alone; then a child is forked off while the threads run, which answers the first calls
again. Functions and what is compared of an answer, which is all but times, are those of
tests/threads.py. With --folder a row that is there is not measured again. Exit code 1 where
anything differs, or where a child does not answer.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from _bench import Options, Row, kept, launch

from tests.threads import PERIOD, Call, calls, digest

THREADS, TURN_S = 4, 1e-4
"""Threads take turns after a tenth of a millisecond, not after five."""
FORKS, ASKED, PATIENCE_S = 3, 3, 120.0
"""Children of each function, calls of each, and how long they may take [s]."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How many calls, and where rows are kept."""

    calls: int = 50
    """Of each thread."""
    only: tuple[str, ...] = ()
    """Names of functions; all where none is given."""
    folder: Path | None = None


def main(arguments: Arguments) -> None:
    """Ask all functions and print a row each."""
    sys.setswitchinterval(TURN_S)
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        for name, call in calls(Path(scratch)).items():
            if arguments.only and name not in arguments.only:
                continue
            rows = arguments.folder or Path(scratch) / "rows of the table"
            row = kept(
                rows / f"{name.replace(' ', '-')}.json",
                partial(measured, name, call, arguments.calls),
            )
            arguments.say(row)
            wrong += row["differ"] + row["raised"] + row["children wrong"]
    sys.exit(int(wrong > 0))


def measured(name: str, call: Call, count: int) -> Row:
    """Answers of one alone, of threads, and of children that are forked off while threads call."""
    begin = time.perf_counter()
    asked = THREADS * count
    alone = [said(call, 9_000 + k) for k in range(min(PERIOD, asked))]
    with ThreadPoolExecutor(THREADS) as pool:
        answers = [pool.submit(said, call, k) for k in range(asked)]
        children = [forked(call, alone[:ASKED], 18_000 + PERIOD * n) for n in range(FORKS)]
        together = [answer.result() for answer in answers]
    differ = sum(answer != alone[k % PERIOD] for k, answer in enumerate(together))
    return {
        "function": name,
        "calls": asked,
        "differ": differ,
        "raised": sum(a.startswith("!") for a in together),
        "kinds": len(set(alone)),
        "children": FORKS,
        "children wrong": sum(not right for right in children),
        "seconds": round(time.perf_counter() - begin, 1),
        "example": next((a for a in together if a[0] == "!"), ""),
    }


def said(call: Call, number: int) -> str:
    """The digest of an answer, or what was raised."""
    try:
        return digest(call(number))
    except Exception as error:
        return f"!{type(error).__name__}: {error}"


def forked(call: Call, expected: list[str], first: int) -> bool:
    """Whether a child of a process whose threads are busy answers, and as one alone does."""
    mine, its = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(
        target=lambda: its.send([said(call, first + k) for k in range(len(expected))])
    )
    child.start()
    answered = mine.poll(PATIENCE_S) and mine.recv() == expected
    child.kill()
    child.join()
    return bool(answered)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
