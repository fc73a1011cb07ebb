"""What a control step costs, and what of it: the tracker, the guard, and the physics of MuJoCo.

    python benchmarks/control_step.py [--courses walls stairs] [--frames 8] [--runs 3] [--json]

A plan of each course is made and executed in simulation, without a log. A figure is the CPU time of
a part per control period [ms], that of the parts inside it included, and its median over the runs;
a yardstick, 1,000 cold solves of one cone program in which nothing is ours, is timed before each
run. ``step`` is all but the physics: what a computer on a robot has to do in a period of 5 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch
from _yardstick import yardstick

import stancekit
from stancekit.runner.control.body_feedback import BodyController
from stancekit.runner.control.tracker import Tracker
from stancekit.runner.run import Runner
from stancekit.runner.safety.guard import SafeWorld
from stancekit.runner.worlds.mujoco import MujocoWorld

PARTS: dict[str, tuple[type, str]] = {
    "all": (Runner, "follow"),
    "tracker": (Tracker, "next"),
    "forces": (BodyController, "forces"),
    "guard and world": (SafeWorld, "step"),
    "world": (MujocoWorld, "step"),
    "physics": (MujocoWorld, "_advanced"),
}
"""The parts by their names in the table, and what is timed for each."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, and how often."""

    courses: tuple[str, ...] = ("walls", "stairs")
    frames: int = 8
    runs: int = 3


class Timed:
    """CPU time of calls of one method of a class, while it is entered."""

    def __init__(self, owner: type, name: str) -> None:
        self.owner, self.name, self.seconds, self.calls = owner, name, 0.0, 0
        self._plain: Callable[..., Any] = getattr(owner, name)

    def __enter__(self) -> Timed:
        def timed(*given: Any, **named: Any) -> Any:
            begin = time.process_time()
            try:
                return self._plain(*given, **named)
            finally:
                self.seconds += time.process_time() - begin
                self.calls += 1

        setattr(self.owner, self.name, timed)
        return self

    def __exit__(self, *_: object) -> None:
        setattr(self.owner, self.name, self._plain)


def main(arguments: Arguments) -> None:
    """Plan, run, and print a line for each course."""
    for course in arguments.courses:
        plan = stancekit.plan(course, frames=arguments.frames).solution
        assert plan is not None, f"{course}: no plan"
        rows = [measured(plan) for _ in range(arguments.runs)]
        median = {name: float(np.median([row[name] for row in rows])) for name in rows[0]}
        arguments.say({"course": course, **median}, line)


def measured(plan: stancekit.Plan) -> dict[str, float]:
    """CPU time of every part per control period [ms], and the yardstick [s]."""
    ruler = yardstick()
    timers = {name: Timed(*of) for name, of in PARTS.items()}
    for timer in timers.values():
        timer.__enter__()
    try:
        stancekit.simulate(plan)
    finally:
        for timer in reversed(timers.values()):
            timer.__exit__()
    steps = timers["tracker"].calls
    found = {name: 1e3 * timer.seconds / steps for name, timer in timers.items()}
    return {**found, "step": found["all"] - found["physics"], "yardstick": ruler}


def line(row: dict[str, Any]) -> str:
    """A line of the table."""
    parts = "  ".join(f"{name} {row[name]:.2f}" for name in (*PARTS, "step"))
    return f"{row['course']:<10} ms a period: {parts}   yardstick {row['yardstick']:.2f} s"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
