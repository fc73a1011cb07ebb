"""Damaged files: every reader of the command under thousands of mutated files, in process and as
processes; and every option under values that are none.

``python benchmarks/damaged_files.py --in-process 1500 --meshes 250 --others 12000 --out
out/damage``. A file is right to be taken as ``tests/damage/cases.py`` says: 0 where it still means
the same or is valid, 1 where its content parses and the verifier refuses it, 2 for everything else;
one line, no traceback, no more than 10 s of a processor and 1 GB. What was wrong is kept. A row of
a reader that is in the folder already is not measured again, so that a run that was ended goes on
where it was.
"""

from __future__ import annotations

import gc
import json
import os
import re
import resource
import signal
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch

from stancekit.cli.main import main, parse, run
from tests.damage.cases import ALL, OUTSIDE, PLAN, Case, cases, command, fault, said
from tests.damage.files import make_files

LONGEST_S, MOST_BYTES = 10, 1_000_000_000
VALUES = Case(name="values", arguments=("solve", "one.json"), file="one.json", kind="value")
ASKED = {
    "solve": ("one.json",),
    "plan": ("course.json",),
    "gait": ("ripple", *OUTSIDE),
    "verify": ("plan.json",),
    "simulate": ("plan.json", "--pace", "4"),
    "export": ("plan.json", "--out", "written.csv"),
    "robot": ("dog.urdf",),
    "terrain": ("terrain.csv",),
    "sample": ("wall-3",),
    "label": ("wall-3", "data", *PLAN),
}
"""Commands, each with what it needs, to which an option with an odd value is added."""
ODD = (
    *("", " ", "nan", "-inf", "1e308", "-1", "0", "1e-400", "true", "٣", "1_0", "0x1", "9" * 400),
    *(
        "1,2,nan",
        ",",
        "{}",
        "[",
        "none",
        "\ud800",
        "a:b:c",
        "stairs:nan:1",
        "../..",
        "\x1b[2J",
    ),
)


class Overdue(BaseException):
    """A run that took longer than it may."""


def overdue(*_: Any) -> None:
    """Answers the alarm."""
    raise Overdue


def in_process(case: Case, count: int, seed: int, out: Path) -> None:
    """Run a verb over mutated files in this process, which does nothing else, and write the row of
    its reader.
    """
    whole, rng = (
        Path(case.file).read_bytes(),
        np.random.default_rng([seed, zlib.crc32(case.name.encode())]),
    )
    command(case.arguments)
    verb = parse(list(case.arguments))
    options = {
        name: re.findall(r"^\W*(--[a-z][a-z-]*)", command((name, "--help"))[1], re.MULTILINE)
        for name in (ASKED if case is VALUES else ())
    }
    signal.signal(signal.SIGPROF, overdue)
    codes, wrong, slowest = Counter[int](), list[str](), 0.0
    began_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for index in range(count):
        if case is VALUES:
            name = str(rng.choice([*ASKED]))
            added = (str(rng.choice(options[name])), ODD[rng.integers(len(ODD))])
            content, right = repr((name, *added)).encode(), ALL
            call: Callable[[], Any] = partial(main, [name, *ASKED[name], *added])
        else:
            content, right = case.damaged(whole, rng)
            Path(case.file).write_bytes(content)
            call = partial(run, verb)
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        try:
            code, _, err = said(call)
            message = fault(case, code, err, right)
        except Overdue:
            code, message = -1, f"more than {LONGEST_S} s"
        except BaseException as error:
            code, message = -1, f"{type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_PROF, 0)
        slowest = max(slowest, time.process_time() - began)
        codes[code] += 1
        if message:
            wrong.append(message)
            (out / f"{case.name.replace(' ', '-')}-{index}").write_bytes(content)
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - began_kb
    row = {
        "reader": case.name,
        "files": count,
        "codes": codes,
        "wrong": len(wrong),
        "first": wrong[:5],
        "slowest_s": round(slowest, 2),
        "grown_mb": round(grown_kb / 1e3),
    }
    (out / f"{case.name.replace(' ', '-')}.json").write_text(json.dumps(row))


def process(case: Case, where: Path) -> tuple[int, str, float, float]:
    """The command as a process with limits of its own: exit code, standard error, CPU seconds,
    megabytes at most.
    """
    held = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    child = os.fork()
    if child == 0:
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(where / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        resource.setrlimit(resource.RLIMIT_AS, (held + MOST_BYTES, held + MOST_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        spent_s = int(time.process_time())
        resource.setrlimit(resource.RLIMIT_CPU, (spent_s + LONGEST_S, spent_s + LONGEST_S + 1))
        signal.alarm(12 * LONGEST_S)
        code: Any = 1
        try:
            main(list(case.arguments))
            code = 0
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            import traceback

            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(code))
    _, status, used = os.wait4(child, 0)
    err = (where / "err").read_text(errors="replace")
    return (
        os.waitstatus_to_exitcode(status),
        err,
        used.ru_utime + used.ru_stime,
        used.ru_maxrss / 1e3,
    )


def as_processes(case: Case, count: int, seed: int, out: Path) -> dict[str, Any]:
    """The same with a process per file, forked from this one, which has imported what the command
    needs.
    """
    row = out / f"process-{case.name.replace(' ', '-')}.json"
    if row.exists():
        kept: dict[str, Any] = json.loads(row.read_text())
        return kept
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])
    wrong, codes, seconds, slowest, most = list[str](), Counter[int](), 0.0, 0.0, 0.0
    whole = Path(case.file).read_bytes()
    command(case.arguments)
    gc.freeze()
    for index in range(count):
        content, right = case.damaged(whole, rng)
        Path(case.file).write_bytes(content)
        code, err, spent, megabytes = process(case, out)
        message = fault(case, code, err, right)
        if spent > LONGEST_S or megabytes > MOST_BYTES / 1e6:
            message += f" {spent:.1f} s of a processor, {megabytes:.0f} MB"
        codes[code] += 1
        seconds, slowest, most = seconds + spent, max(slowest, spent), max(most, megabytes)
        if message:
            wrong.append(message)
            (out / f"process-{case.name.replace(' ', '-')}-{index}").write_bytes(content)
    Path(case.file).write_bytes(whole)
    found = {
        "reader": case.name,
        "processes": count,
        "codes": codes,
        "wrong": len(wrong),
        "first": wrong[:5],
        "cpu_s": round(seconds, 1),
        "slowest_s": round(slowest, 2),
        "most_mb": round(most),
    }
    row.write_text(json.dumps(found))
    return found


def shares(every: list[Case], meshes: int, others: int) -> list[tuple[Case, int]]:
    """How many files each reader gets: every format of meshes as many, and every other reader as
    many.
    """
    kinds = Counter(case.mesh for case in every)
    most = {kind: divmod(meshes if kind else others, number) for kind, number in kinds.items()}
    found, seen = [], Counter[str]()
    for case in every:
        each, left = most[case.mesh]
        found.append((case, each + (seen[case.mesh] < left)))
        seen[case.mesh] += 1
    return found


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How many files, of which readers."""

    in_process: int = 1500
    meshes: int = 250
    """Processes for each of the eight formats of meshes, shared by the readers of the format."""
    others: int = 3600
    """Processes for all the other readers together."""
    only: tuple[str, ...] = ()
    out: Path = Path("out/damage")


def table(given: Arguments) -> None:
    """Make the files, damage them, and print a row a reader."""
    out = given.out.resolve()
    folder = out / "files"
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    if not (folder / "foot-dae.urdf").exists():
        make_files(folder)
    every = [case for case in cases() if not given.only or case.name in given.only]
    for case in [*every, VALUES] if given.in_process else ():
        whole = Path(case.file).read_bytes()
        row = out / f"{case.name.replace(' ', '-')}.json"
        if not row.exists():
            child = os.fork()
            if child == 0:
                in_process(case, given.in_process, given.seed, out)
                os._exit(0)
            _, status = os.waitpid(child, 0)
            Path(case.file).write_bytes(whole)
            if status:
                given.say(
                    {
                        "reader": case.name,
                        "wrong": 1,
                        "first": [f"ended by {os.waitstatus_to_exitcode(status)}"],
                    }
                )
                continue
        given.say(json.loads(row.read_text()))
    total = Counter[str]()
    for case, count in sorted(
        shares(every, given.meshes, given.others), key=lambda share: not share[0].mesh
    ):
        if count:
            found = as_processes(case, count, given.seed + 1, out)
            given.say(found)
            total.update({"meshes" if case.mesh else "others": count, "wrong": found["wrong"]})
    given.say({"processes": dict(total)})


if __name__ == "__main__":
    launch(table, Arguments, __doc__)
