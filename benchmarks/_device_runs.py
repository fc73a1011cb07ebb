"""Runs of the command on devices whose parts are real, of ``servo_bus`` and ``ros1``: the plan, a
forked process per run, what that says, and the log of the joints, which the device writes.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from _bench import ROOT

from stancekit.cli.main import main as command
from stancekit.planners.files.arrays import Array

LONGEST_S = 120.0


def planned(folder: Path) -> Path:
    """A short plan of the page's robot, made once."""
    plan = folder / "desk.json"
    if not plan.exists():
        page = (ROOT / "docs" / "running-on-a-robot.md").read_text(encoding="utf-8")
        found = re.search(r"<!-- file: desk.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
        assert found is not None, "the page has a course"
        course = found[1].replace("frames: 6", "frames: 3")
        course = course.replace("goal_m: [0.10,", "goal_m: [0.04,")
        (folder / "desk.yaml").write_text(course)
        words = ["plan", str(folder / "desk.yaml"), "--out", str(plan)]
        assert ended(forked(words, folder / "plan")) == 0
    return plan


def forked(words: Sequence[str], output: Path) -> int:
    """A process with a command, begun without importing anything anew; its process id."""
    pid = os.fork()
    if pid:
        return pid
    code = 70
    try:
        os.setsid()
        for stream, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{output}.{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        command(words)
    except SystemExit as end:
        code = int(str(end.code or 0))
    finally:
        sys.stdout.flush()
        os._exit(code)


def running(host: int) -> bool:
    """Whether a process that was forked here goes on; it is not reaped."""
    found = os.waitid(os.P_PID, host, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    return found is None


def ended(host: int) -> int:
    """The exit code of a process that was forked here, minus the signal that ended it; killed where
    it lasts.
    """
    end = time.monotonic() + LONGEST_S
    while running(host) and time.monotonic() < end:
        time.sleep(0.005)
    if running(host):
        os.kill(host, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(host, 0)[1])


def said(output: Path) -> tuple[str, str]:
    """All that a process printed, on one line, and the part of it that says what happened."""
    errors, text = (Path(f"{output}.{name}").read_text() for name in ("err", "out"))
    lines = [line for line in errors.splitlines() if line.startswith("stancekit:")]
    verdict = re.search(r"verdict +(.*?)\n +robot left +(.*?)\n +motion", text, re.DOTALL)
    told = " | left ".join(" ".join(part.split()) for part in verdict.groups()) if verdict else ""
    return " ".join(f"{errors} {text}".split()), "; ".join([*lines, told])[:400]


def rows(log: Path) -> Array:
    """The numbers of all whole lines of a device's log, shape (N, columns)."""
    text = log.read_text() if log.exists() else ""
    found = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
    whole = [row for row in found if len(row) == len(found[-1])]
    return np.array(whole, dtype=float).reshape(len(whole), -1 if whole else 0)


def wait(there: Callable[[], bool], within_s: float = LONGEST_S) -> None:
    """Wait until something is there."""
    end = time.monotonic() + within_s
    while not there():
        assert time.monotonic() < end, "the device does not start: see its log"
        time.sleep(0.05)
