"""A scene that is changed again and again, and the newest answer to it; no page takes part.

A change takes the place of those that wait: nothing is queued, and the answer to a scene that was
changed since is dropped. What is asked while the last answer is still worked out waits for no
longer than that.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .answer import SceneAnswer, patient_answer, quick_answer
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


REST_S = 0.35
"""A scene that was not changed for so long is judged."""
log = logging.getLogger(__name__)


class Session:
    """on_answer(number, scenario, answer, since): called in the session's own thread for every
    answer that is drawn; since: time of the change [s], as time.perf_counter has it.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_answer: Callable[[int, Scenario, SceneAnswer, float], None],
        *,
        judges: bool = True,
        rest_s: float = REST_S,
    ) -> None:
        self._on_answer, self._rest_s = on_answer, rest_s
        self._news = threading.Condition()
        self._scenario, self._number, self._since = scenario, 0, time.perf_counter()
        self._answered, self._judged = -1, -1
        self._verdict: tuple[int, SceneAnswer] | None = None
        self._judge = Judge(self._told) if judges else None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="playground", daemon=True)

    def start(self) -> None:
        """Answer the first scene, and all that follow."""
        self._thread.start()

    @property
    def scenario(self) -> Scenario:
        """The newest."""
        with self._news:
            return self._scenario

    @property
    def number(self) -> int:
        """Number of the newest change; 0 before the first."""
        with self._news:
            return self._number

    def change(self, edit: Callable[[Scenario], Scenario]) -> int:
        """Another scene, made of the newest by ``edit``; its number.

        Raises what ``edit`` raises.

        An edit that takes a while, as loading a robot, keeps nobody else from changing the scene:
        it is done again on what is the newest then, and what others change meanwhile stays.
        """
        while True:
            with self._news:
                base, number, since = self._scenario, self._number, time.perf_counter()
            edited = edit(base)
            with self._news:
                if number != self._number:
                    continue
                self._scenario, self._since = edited, since
                self._number += 1
                if self._judge is not None:
                    self._judge.drop()
                self._news.notify()
                return self._number

    def close(self) -> None:
        """End thread and process."""
        with self._news:
            self._closed = True
            self._news.notify()
        if self._judge is not None:
            self._judge.close()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _told(self, number: int, answer: SceneAnswer) -> None:
        with self._news:
            self._verdict = (number, answer)
            self._news.notify()

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(self._is_due, timeout=self._patience_s())
                if self._closed:
                    return
                number, scenario, since = self._number, self._scenario, self._since
                verdict, self._verdict = self._verdict, None
            if number != self._answered:
                self._say(number, scenario, quick_answer(scenario), since)
                self._answered = number
            elif verdict is not None and verdict[0] == number:
                self._say(number, scenario, verdict[1], since)
            elif (
                self._judge is not None
                and self._judged != number
                and time.perf_counter() - since >= self._rest_s
            ):
                self._judged = number
                self._judge.ask(number, scenario)

    def _is_due(self) -> bool:
        return self._closed or self._number != self._answered or self._verdict is not None

    def _patience_s(self) -> float | None:
        """Until the scene counts as one that nobody changes any more; None where there is nothing
        to wait for.
        """
        if self._judge is None or self._judged == self._number or self._number != self._answered:
            return None
        return max(self._rest_s - (time.perf_counter() - self._since), 0.001)

    def _say(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        try:
            self._on_answer(number, scenario, answer, since)
        except Exception:  # a page that cannot draw one answer draws the next
            log.exception("an answer could not be drawn")
