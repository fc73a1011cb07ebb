"""An emulated device in a process of its own, and the lines that are exchanged with it: it says
where it is, then every line that it hears is a fault, or empty, and is answered with its state.
"""

from __future__ import annotations

import json
import os
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, Self

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.runner.worlds.dynamixel.control_table import Calibration

ROOT = Path(__file__).parents[2]
FAULT = re.compile(r"(?P<fault>.*?)(?: in (?P<at_s>\d*\.?\d+)(?: s)?)?")
"""A fault's name, and when it happens: "power loss in 2 s"."""
LONGEST = 32
"""A list of more is of no use to people: the joints of a robot are fewer."""


class Emulated(Protocol):
    """A device that is not there."""

    def inject(self, fault: str, at_s: float = 0.0) -> None:
        """Let a fault happen in so many seconds. Raises ValueError for one that there is not."""

    def state(self) -> dict[str, Any]:
        """The device's state, JSON-ready."""


class DeviceProcess:
    """``python -m tests.emulators`` as a child process, which lives on when its host is killed.

    A context manager. where: what it said of itself, its port among it.
    """

    def __init__(self, kind: Literal["bus", "rosbridge"], *words: object) -> None:
        path = filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.emulators", kind, *map(str, words)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
        )
        self.where = self._answer()

    def inject(self, fault: str, at_s: float = 0.0) -> None:
        """Let a fault happen in so many seconds."""
        self.ask(f"{fault} in {at_s:.6f}")

    def state(self) -> dict[str, Any]:
        """The device's state."""
        return self.ask("")

    def ask(self, line: str) -> dict[str, Any]:
        """The answer to a line."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the process."""
        self.process.communicate(timeout=60.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self.process.stdout.readline())
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer


def bus_process(position_rad: Iterable[float], seed: int = 0) -> DeviceProcess:
    """Servos whose shafts stand at these angles, in a process of their own."""
    angles = ",".join(f"{angle:.9g}" for angle in position_rad)
    return DeviceProcess("bus", f"--position={angles}", f"--seed={seed}")


def bridge_process(plan: Path) -> DeviceProcess:
    """The robot of a plan behind a rosbridge of ROS 2, in a process of its own."""
    return DeviceProcess("rosbridge", plan, "--port=0")


def shafts(calibration: Calibration, joints: Sequence[str], angles_rad: Array) -> Array:
    """Angles of the servos' shafts from their tick 2048 [rad] for joint angles, shape (J,) both."""
    return np.asarray((calibration.turning(joints).told(angles_rad) - 2048) * np.pi / 2048)


def start_of(path: Path) -> tuple[tuple[str, ...], Array]:
    """Joint names, and angles [rad] of shape (J,) at the first key frame of a plan file."""
    from stancekit.planners.formats.motion_file import read_motion
    from stancekit.planners.motion.joints import plan_angles

    plan, _ = read_motion(path)
    return plan.problem.robot.joint_names, plan_angles(plan)[0][0]


def serve(where: dict[str, Any], device: Emulated, fault: str) -> int:
    """Say where a device is, let a fault happen unless it is empty, then answer line by line until
    somebody ends it; 0. On a terminal a state is short.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    if fault:
        happen(device, fault)
    _say(where)
    try:
        for line in _lines():
            answer: dict[str, Any] = {}
            try:
                happen(device, line.strip())
            except ValueError as error:
                answer = {"error": str(error)}
            _say(answer if answer and sys.stdout.isatty() else device.state() | answer)
    except KeyboardInterrupt:
        pass
    return 0


def happen(device: Emulated, line: str) -> None:
    """Let the fault of a line happen, if it is not empty."""
    words = FAULT.fullmatch(line)
    if words is not None and words["fault"]:
        device.inject(words["fault"], float(words["at_s"] or 0.0))


def _end(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _lines() -> Iterator[str]:
    """Lines of standard input while there are any; then, where that is no pipe, nothing until a
    signal. A background process of a terminal may not read from it.
    """
    if not (sys.stdin.isatty() and os.tcgetpgrp(0) != os.getpgrp()):
        yield from sys.stdin
        if stat.S_ISFIFO(os.fstat(sys.stdin.fileno()).st_mode) or sys.stdin.isatty():
            return
    while True:
        signal.pause()


def short(value: Any) -> Any:
    """A value as people read it: numbers to three digits after the point, and long lists as their
    length.
    """
    if isinstance(value, dict):
        return {key: short(each) for key, each in value.items()}
    if isinstance(value, list):
        return [short(each) for each in value] if len(value) <= LONGEST else f"{len(value)} of them"
    return round(value, 3) if isinstance(value, float) else value


def _say(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(short(message) if sys.stdout.isatty() else message) + "\n")
    sys.stdout.flush()
