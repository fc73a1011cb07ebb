"""Solves in a child process with an alarm: a linear solver can hang far beyond IPOPT's own limit.

The child is a copy of this process (fork), so a program that was compiled here is ready there; what
comes back is the solution's arrays. Where there is no fork the solve runs here, without an alarm.
"""

from __future__ import annotations

import io
import json
import os
import signal
import time
from contextlib import suppress
from multiprocessing import Pipe
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import PlanningFailed
from ...files.arrays import Array, archive_of, read_only
from ..gait_program import GaitProgram, GaitSolution
from ..transcription.program import Callback

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    Pair = Connection[Any, Any]

_FIELDS = (
    "success",
    "iterations",
    "violations",
    "status",
    "seconds",
    "seconds_evaluating",
    "seconds_linear",
    "height_factor",
)


def solve_in_subprocess(
    program: GaitProgram,
    guess: Array | None = None,
    *,
    time_limit_s: float = 60.0,
    callback: Callback | None = None,
    on_iterate: Callback | None = None,
    **options: Any,
) -> GaitSolution:
    """``program.solve(guess, callback, **options)`` in a child; the callback runs there.

    on_iterate(iteration, violation, cost): called here while the child works, which ends soon after
    it returns True. Raises PlanningFailed when the child has not answered after time_limit_s of
    wall-clock time, or died.
    """
    if not hasattr(os, "fork"):
        return program.solve(
            guess,
            lambda *at: bool(on_iterate and on_iterate(*at)) | bool(callback and callback(*at)),
            **options,
        )
    program.build(**options)
    here, there = Pipe()
    child = os.fork()
    if child == 0:
        here.close()
        _answer(program, guess, callback, options, there)
    there.close()
    try:
        return _solution(program, _received(here, time_limit_s, on_iterate))
    finally:
        here.close()
        _ended(child)


def _answer(
    program: GaitProgram,
    guess: Array | None,
    callback: Callback | None,
    options: dict[str, Any],
    pipe: Pair,
) -> None:
    """The child's whole life: it leaves without any of the parent's clean-up, and where the parent
    is gone.
    """
    status = 1

    def on_iterate(*at: Any) -> bool:
        try:
            pipe.send(at)
            stop = pipe.poll()
        except OSError:
            os._exit(1)
        return stop or bool(callback and callback(*at))

    try:
        for number in (
            signal.SIGINT,
            signal.SIGTERM,
        ):  # come to the whole group; the parent decides
            signal.signal(number, signal.SIG_IGN)
        solution = program.solve(guess, on_iterate, **options)
        header = {name: getattr(solution, name) for name in _FIELDS}
        arrays = {"x": solution.x, "history": solution.history, "header": json.dumps(header)}
        pipe.send(archive_of(arrays))
        status = 0
    finally:
        os._exit(status)


def _received(pipe: Pair, time_limit_s: float, on_iterate: Callback | None) -> bytes:
    """The child's answer, after all that it has to show.

    Raises PlanningFailed.
    """
    deadline = time.monotonic() + time_limit_s
    while pipe.poll(max(deadline - time.monotonic(), 0.0)):
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            raise PlanningFailed("the solver's process died") from None
        if isinstance(message, bytes):
            return message
        if on_iterate is not None and on_iterate(*message):
            with suppress(OSError):  # it may have come to its end
                pipe.send("stop")
    raise PlanningFailed(f"the solver did not answer within {time_limit_s:g} s")


def _ended(child: int) -> None:
    """Make sure that the child is gone."""
    done, _ = os.waitpid(child, os.WNOHANG)
    if not done:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _solution(program: GaitProgram, content: bytes) -> GaitSolution:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        header = json.loads(str(arrays["header"]))
        history = tuple(
            (float(violation), float(cost)) for violation, cost in arrays["history"].reshape(-1, 2)
        )
        return GaitSolution(
            program=program,
            x=read_only(arrays["x"], (program.size,), "x"),
            history=history,
            **header,
        )
