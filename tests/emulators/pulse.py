"""How long this computer kept a thread waiting: what a test of real time is tried again for."""

from __future__ import annotations

import threading
import time
from typing import Self

BEAT_S = 0.005


class Pulse:
    """A thread that wants to run every ``BEAT_S``. worst_s: the longest that it had to wait beyond
    that [s].
    """

    def __init__(self) -> None:
        self.worst_s = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="pulse", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        last = time.monotonic()
        while not self._over.wait(BEAT_S):
            now = time.monotonic()
            self.worst_s, last = max(self.worst_s, now - last - BEAT_S), now
