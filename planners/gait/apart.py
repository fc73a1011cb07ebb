"""Solves in a child process with an alarm: a linear solver can hang far beyond any limit that IPOPT is told.

The child is a copy of this process (fork), so a program that was compiled here is ready there; what comes back is the
solution's arrays. Where there is no fork the solve runs here, without an alarm.
"""

from __future__ import annotations

import io
import json
import os
import select
import signal
import time
from typing import Any

import numpy as np

from ..arrays import Array, frozen
from ..outcome import PlanningFailed
from .formulation import GaitProgram
from .solution import GaitSolution

FIELDS = ("success", "iterations", "violations", "status", "seconds", "seconds_evaluating", "seconds_linear",
          "height_factor")  # fmt: skip


def solve_apart(
    program: GaitProgram, guess: Array | None = None, *, time_limit_s: float = 60.0, **options: Any
) -> GaitSolution:
    """``program.solve(guess, **options)`` in a child; a callback in ``options`` runs there.

    Raises PlanningFailed when the child has not answered after time_limit_s of wall-clock time, or died.
    """
    if not hasattr(os, "fork"):
        return program.solve(guess, **options)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        _answer(program, guess, options, reader, writer)
    os.close(writer)
    try:
        content = _received(reader, time.monotonic() + time_limit_s)
    finally:
        os.close(reader)
        _ended(child)
    if content is None:
        raise PlanningFailed(f"the solver did not answer within {time_limit_s:g} s")
    if not content:
        raise PlanningFailed("the solver's process died")
    return _solution(program, content)


def _answer(program: GaitProgram, guess: Array | None, options: dict[str, Any], reader: int, writer: int) -> None:
    """The child's whole life: it leaves without any of the parent's clean-up."""
    status = 1
    try:
        os.close(reader)
        solution = program.solve(guess, **options)
        header = {name: getattr(solution, name) for name in FIELDS}
        content = io.BytesIO()
        np.savez(content, x=solution.x, history=np.array(solution.history), header=np.array(json.dumps(header)))
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(content.getvalue())
        status = 0
    finally:
        os._exit(status)


def _received(reader: int, deadline: float) -> bytes | None:
    """All that comes before the pipe closes; None when the deadline passes first."""
    found = b""
    while True:
        ready, _, _ = select.select([reader], [], [], max(deadline - time.monotonic(), 0.0))
        if not ready:
            return None
        part = os.read(reader, 1 << 20)
        if not part:
            return found
        found += part


def _ended(child: int) -> None:
    """Make sure that the child is gone."""
    done, _ = os.waitpid(child, os.WNOHANG)
    if not done:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _solution(program: GaitProgram, content: bytes) -> GaitSolution:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        header = json.loads(str(arrays["header"]))
        history = tuple((float(violation), float(cost)) for violation, cost in arrays["history"].reshape(-1, 2))
        return GaitSolution(program=program, x=frozen(arrays["x"], (program.size,), "x"), history=history, **header)
