"""A second process that judges scenes in peace, while this one goes on answering at once."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .answer import SceneAnswer, patient_answer
from .scenario import Scenario

Told = Callable[[int, SceneAnswer], None]


class Judge:
    """Judges one scene after another; of those that wait only the newest is kept.

    on_answer(number, answer) is called in a thread of its own. The process starts with the first
    scene.
    """

    def __init__(self, on_answer: Told) -> None:
        self._on_answer = on_answer
        self._lock = threading.Lock()
        self._pipe: Any = None
        self._process: Any = None
        self._waiting: tuple[int, Scenario] | None = None
        self._busy = self._closed = False

    def ask(self, number: int, scenario: Scenario) -> None:
        """Judge this next, and not what still waits."""
        with self._lock:
            if self._closed:
                return
            self._waiting = (number, scenario)
            if not self._busy:
                self._busy = True
                threading.Thread(target=self._work, name="judge", daemon=True).start()

    def drop(self) -> None:
        """Drop what waits: it is of no use any more."""
        with self._lock:
            self._waiting = None

    def close(self) -> None:
        """End the process, also in the middle of its work."""
        with self._lock:
            self._closed, self._waiting = True, None
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()

    def _work(self) -> None:
        while True:
            with self._lock:
                if self._waiting is None or self._closed:
                    self._busy = False
                    return
                (number, scenario), self._waiting = self._waiting, None
                if self._process is None:
                    self._start()
                pipe = self._pipe
            try:
                pipe.send(scenario)
                answer = pipe.recv()
            except (EOFError, OSError):  # it was ended, by us or by somebody else
                with self._lock:
                    self._process = None
                answer = SceneAnswer(
                    message="the process that judges plans has ended; any change starts it anew"
                )
                if self._closed:
                    continue
            self._on_answer(number, answer)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there,), daemon=True)
        self._process.start()
        there.close()


def _serve(pipe: Any) -> None:
    """The process's whole life: it ends with its parent, who alone minds Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(patient_answer(pipe.recv()))
