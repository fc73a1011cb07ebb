"""Plays the key frames of whatever plan there is, until it is told to stop."""

from __future__ import annotations

import threading
from collections.abc import Callable

FPS = 15.0
STEP_S = 1.0
"""From one key frame to the next."""


class Player:
    """on_tick(step): called ``FPS`` times a second while it plays, in a thread of its own; step: in key frames."""

    def __init__(self, on_tick: Callable[[float], None]) -> None:
        self._on_tick = on_tick
        self._stop: threading.Event | None = None

    @property
    def plays(self) -> bool:
        """Whether it does."""
        return self._stop is not None

    def start(self) -> None:
        """Play."""
        if self._stop is None:
            self._stop = threading.Event()
            threading.Thread(target=self._run, args=(self._stop,), name="player", daemon=True).start()

    def stop(self) -> None:
        """Stay where it is."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def _run(self, stop: threading.Event) -> None:
        while not stop.wait(1.0 / FPS):
            self._on_tick(1.0 / (FPS * STEP_S))
