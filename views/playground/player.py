"""A button and a slider with which what was planned is played: they know what time is shown."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

FPS = 15.0


class Player:
    """In the tab that is open on ``gui``, one second, or key frame, of it a second.

    Arguments:
        unit: what the slider counts.
        on_time: called, with ``lock`` held, when another time is to be shown; it returns whether
            there is anything to show, and where there is nothing the time stays. at: the time that
            is shown; last: where it ends.
    """

    def __init__(
        self, gui: Any, unit: str, on_time: Callable[[], bool], lock: AbstractContextManager[Any]
    ) -> None:
        self._on_time, self._lock = on_time, lock
        self._stop: threading.Event | None = None
        self.at, self.last = 0.0, 0.0
        self._button = gui.add_button("play")
        self._button.on_click(self._clicked)
        self._slider = gui.add_slider(unit, min=0.0, max=1.0, step=0.02, initial_value=0.0)
        self._slider.on_update(self._slid)

    def show(self, at: float, last: float) -> None:
        """From now on it ends there, and this is shown; ``on_time`` is not called."""
        self.last, self.at = last, min(max(at, 0.0), last)
        if abs(self._slider.max - max(last, 1.0)) > 1e-9:
            self._slider.max = max(last, 1.0)
        if abs(self._slider.value - self.at) > 0.01:
            self._slider.value = round(self.at, 2)

    def offer(self, there: bool) -> None:
        """Show the button and the slider if there is something to play; without, neither button nor
        slider is seen.
        """
        if not there:
            self.stop()
            self._button.label = "play"
        for part in (self._button, self._slider):
            if part.visible != there:
                part.visible = there

    def stop(self) -> None:
        """Stay where it is."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def _clicked(self, _event: Any) -> None:
        if self._stop is not None:
            self.stop()
        else:
            self._stop = threading.Event()
            threading.Thread(
                target=self._play, args=(self._stop,), name="player", daemon=True
            ).start()
        self._button.label = "play" if self._stop is None else "stop"

    def _slid(self, event: Any) -> None:
        if event.client is not None:
            with self._lock:
                self._go(min(max(float(event.target.value), 0.0), self.last))

    def _play(self, stop: threading.Event) -> None:
        while not stop.wait(1.0 / FPS):
            with self._lock:
                if self._go(0.0 if self.at >= self.last else min(self.at + 1.0 / FPS, self.last)):
                    self.show(self.at, self.last)

    def _go(self, at: float) -> bool:
        """To another time; whether there was anything to show there."""
        before, self.at = self.at, at
        shown = self._on_time()
        self.at = at if shown else before
        return shown
