"""Walks are planned in a process of their own, which is ended when something else is asked for."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from stancekit.planners.answer.report import Report
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import StancekitError
from stancekit.planners.gait.method.attempt import Attempt
from stancekit.planners.gait.method.portfolio import Caps
from stancekit.planners.gait.method.way import plan_walk
from stancekit.planners.gait.task import GaitSettings
from stancekit.planners.problem.walk import Walk

ITERATIONS, TOTAL_S = 80, 120.0
"""Most iterations of a solve, and CPU time of all solves of a walk [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkAnswer:
    """Answer about a walk: how far its planning is, or what came of it.

    Arguments:
        seconds: since it was begun.
    """

    done: bool
    message: str
    seconds: float
    trajectory: Trajectory | None = None
    report: Report[Trajectory] | None = None

    @property
    def accepted(self) -> bool:
        """Tell whether the verifier accepts it."""
        return self.report is not None and self.report.accepted


Told = Callable[[int, WalkAnswer], None]


class WalkPlanning:
    """Plans one walk at a time. on_answer(number, answer): in a thread of its own, for every step
    and at the end.
    """

    def __init__(self, on_answer: Told) -> None:
        self._on_answer = on_answer
        self._process: Any = None
        self._lock = threading.Lock()

    def begin(self, number: int, task: Walk) -> None:
        """Plan this walk, and no other any more."""
        self.end()
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, task), daemon=True)
        with self._lock:
            process.start()
            self._process = process
        there.close()
        threading.Thread(
            target=self._listen, args=(number, process, here, time.monotonic()), daemon=True
        ).start()

    def end(self) -> None:
        """Stop planning."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()

    def _listen(self, number: int, process: Any, pipe: Any, begun_s: float) -> None:
        done = False
        with suppress(EOFError, OSError):
            while not done:
                done, message, *result = pipe.recv()
                trajectory, report = result or (None, None)
                took_s = time.monotonic() - begun_s
                self._on_answer(
                    number,
                    WalkAnswer(
                        done=done,
                        message=message,
                        seconds=took_s,
                        trajectory=trajectory,
                        report=report,
                    ),
                )
        if (
            not done and self._process is process
        ):  # nobody ended it: it was killed, or there was no memory left
            message = "the process that planned it ended without an answer"
            self._on_answer(
                number, WalkAnswer(done=True, message=message, seconds=time.monotonic() - begun_s)
            )


def _serve(pipe: Any, task: Walk) -> None:
    """The process's whole life; its own children end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    last = [0.0]

    def progress(
        attempt: Attempt, iteration: int, violation: float, cost: float, phase: str
    ) -> bool:
        if time.monotonic() - last[0] > 0.15:
            last[0] = time.monotonic()
            words = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}"
            with suppress(OSError):
                pipe.send((False, words))
        return os.getppid() == 1

    try:
        settings, caps = (
            GaitSettings(max_iterations=ITERATIONS),
            Caps(iterations=ITERATIONS, total_s=TOTAL_S),
        )
        plan = plan_walk(task, settings, progress, caps=caps)
        best = plan.best if plan.best is not None and plan.best.solution.success else None
        answer = (True, plan.message, best and best.trajectory, best and best.report)
    except StancekitError as error:
        answer = (True, str(error), None, None)
    with suppress(OSError):  # nobody asks any more
        pipe.send(answer)
