"""This installation and this computer: versions, extras, the library that draws, and how fast it
is.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable
from ctypes.util import find_library
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

TOOLS = ("dev",)
"""Extras for working on the package, which no command needs."""


def about(
    *, measure: bool, progress: Callable[[int, int, str], None] = lambda done, total, stage: None
) -> dict[str, Any]:
    """Describe the installation and the machine, as a report of a bug needs them.

    Arguments:
        measure: whether to measure the speed, which takes some seconds.
        progress: called with the steps done, their number, and the name of the next.

    Returns:
        Plain values by name; solves_s [s] is None where nothing was measured.
    """
    record: dict[str, Any] = {
        "stancekit": version("stancekit"),
        "folder": str(Path(__file__).parent.parent),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "core": versions(None),
        "extras": {extra: versions(extra) for extra in extras()},
        "gl": gl(),
        "cores": cores(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0,
        "solves_s": None,
    }
    if measure:
        from stancekit.planners.equilibrium.yardstick import yardstick

        progress(0, 1, "1,000 cold solves")
        record["solves_s"] = yardstick()
        progress(1, 1, "done")
    return record


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load() -> float:
    """Processes that wanted a processor in the last minute, for each that there is; NaN where
    nobody says.
    """
    return os.getloadavg()[0] / cores() if hasattr(os, "getloadavg") else float("nan")


def extras() -> list[str]:
    """The extras that commands need, by the package's own metadata."""
    from importlib.metadata import metadata

    return [
        name for name in metadata("stancekit").get_all("Provides-Extra") or [] if name not in TOOLS
    ]


def versions(extra: str | None) -> dict[str, str | None]:
    """The version of every package of an extra, or of the core for None; None for one that is not
    installed.

    Packages that an extra has no use for on this platform are left out, and so are those of extras
    that it includes.
    """
    result: dict[str, str | None] = {}
    for text in requires("stancekit") or []:
        need = Requirement(text)
        mine = (
            need.marker is None
            if extra is None
            else need.marker is not None and "extra" in str(need.marker)
        )
        if not mine or need.name == "stancekit":
            continue
        if need.marker is not None and not need.marker.evaluate({"extra": extra or ""}):
            continue
        try:
            result[need.name] = version(need.name)
        except PackageNotFoundError:
            result[need.name] = None
    return result


def gl() -> str:
    """The library that MuJoCo's renderer draws films with here, empty where there is none."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen or sys.platform != "linux":
        return chosen or "of the system"
    return find_library("EGL") or find_library("OSMesa") or ""
