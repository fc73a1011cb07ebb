"""This installation and this computer: versions, extras, the library that draws, and how fast it is."""

from __future__ import annotations

import os
import platform
import sys
import threading
import time
from collections.abc import Callable
from ctypes.util import find_library
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

TOOLS = ("dev", "docs")
"""Extras for working on the package, which no command needs."""
BUS_PERIOD_S, BUS_CYCLES = 0.02, 150
BUS_SENT, BUS_ANSWERED = 24 * 5 + 14, 24 * 19
"""Bytes of a cycle with 24 servos: goals out, and positions, speeds, currents and errors back."""
LATE_SHARE = 0.01
"""The bus keeps up where no more than this share of the cycles takes longer than a period."""


def about(
    *, measure: bool, progress: Callable[[int, int, str], None] = lambda done, total, stage: None
) -> dict[str, Any]:
    """What a report of a bug needs to know.

    Arguments:
        measure: whether to measure the speed, which takes some seconds.
        progress: called with the steps done, their number, and the name of the next.
    Returns:
        Plain values by name; solves_s [s] and bus are None where nothing was measured.
    """
    found: dict[str, Any] = {
        "stancekit": version("stancekit"),
        "folder": str(Path(__file__).parent.parent),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "core": versions(None),
        "extras": {extra: versions(extra) for extra in extras()},
        "gl": gl(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0,
        "solves_s": None,
        "bus": None,
    }
    if measure:
        from stancekit.planners.equilibrium.yardstick import yardstick

        progress(0, 2, "1,000 cold solves")
        found["solves_s"] = yardstick()
        progress(1, 2, "an emulated servo bus")
        found["bus"] = bus_pace() if sys.platform != "win32" else None  # it has no pseudo-terminals
        progress(2, 2, "done")
    return found


def extras() -> list[str]:
    """The extras that commands need, by the package's own metadata."""
    from importlib.metadata import metadata

    return [name for name in metadata("stancekit").get_all("Provides-Extra") or [] if name not in TOOLS]


def versions(extra: str | None) -> dict[str, str | None]:
    """The version of every package of an extra, or of the core for None; None for one that is not installed.

    Packages that an extra has no use for on this platform are left out, and so are those of extras that it includes.
    """
    found: dict[str, str | None] = {}
    for text in requires("stancekit") or []:
        need = Requirement(text)
        mine = need.marker is None if extra is None else need.marker is not None and "extra" in str(need.marker)
        if not mine or need.name == "stancekit":
            continue
        if need.marker is not None and not need.marker.evaluate({"extra": extra or ""}):
            continue
        try:
            found[need.name] = version(need.name)
        except PackageNotFoundError:
            found[need.name] = None
    return found


def gl() -> str:
    """The library that MuJoCo's renderer draws films with here, empty where there is none."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen or sys.platform != "linux":
        return chosen or "of the system"
    return find_library("EGL") or find_library("OSMesa") or ""


def bus_pace(cycles: int = BUS_CYCLES, period_s: float = BUS_PERIOD_S) -> dict[str, float | bool]:
    """How long one cycle of an emulated servo bus takes: goals out and answers back through a pseudo-terminal.

    The answering end is a thread that does what an emulated bus does at least: read, and write as many bytes as 24
    servos answer. It is the pace of this computer and of its load, and no model of a servo.

    Returns:
        usual_s and worst_s, the median and the longest cycle [s]; period_s [s]; keeps_up.
    """
    import pty
    import tty

    near, far = pty.openpty()
    tty.setraw(near)
    tty.setraw(far)

    def answer() -> None:
        for _ in range(cycles):
            if not _read(far, BUS_SENT):
                return
            os.write(far, bytes(BUS_ANSWERED))

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    taken, due = [], time.monotonic()
    try:
        for _ in range(cycles):
            os.write(near, bytes(BUS_SENT))
            _read(near, BUS_ANSWERED)
            taken.append(time.monotonic() - due)
            due = max(due + period_s, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))
    finally:
        thread.join(timeout=1.0)
        os.close(near)
        os.close(far)
    taken.sort()
    late = sum(each > period_s for each in taken)
    return {
        "usual_s": taken[len(taken) // 2], "worst_s": taken[-1], "period_s": period_s,
        "keeps_up": late <= LATE_SHARE * cycles,
    }  # fmt: skip


def _read(descriptor: int, count: int) -> bytes:
    """So many bytes, fewer where the other end is closed."""
    found = b""
    while len(found) < count:
        part = os.read(descriptor, count - len(found))
        if not part:
            break
        found += part
    return found
