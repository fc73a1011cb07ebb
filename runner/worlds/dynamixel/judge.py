"""Judge of measurements of servos: no joint jumps, no value is old, no servo's clock stands still.

A CRC says that an answer arrived as it was sent, not that it is right. Two servos with one id, an
answer to an earlier question, and a servo whose values are stuck send sound packets, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bus import ServoBus
from .control_table import RAD, RAD_S

FASTER = 1.5
"""A joint may be pushed so many times as fast as its servo turns without load."""
SLACK_RAD = 0.06
"""Position that the time between a measurement and its arrival may hide."""
OLD_S = 0.06
"""A measurement may be older than the last one by so much before it is asked for again."""
FROZEN = 5
"""A servo that reports speed and the same position for so many periods repeats old values."""
FROZEN_TICKS = 2.0
WRAP_MS = 32768
"""Realtime Tick begins anew here."""


class Doubt(NamedTuple):
    """Reason why a measurement cannot be true, empty where it is believed.

    Arguments:
        late: it may be an answer that came late.
    """

    why: str
    late: bool = False


BELIEVED = Doubt("")


class MeasurementJudge:
    """Judge of consecutive measurements of all servos; S servos.

    Arguments:
        bus: whose servos they are, for messages.
        fastest_rad_s: speed without load, shape (S,).
    """

    def __init__(self, bus: ServoBus, fastest_rad_s: NDArray[np.float64]) -> None:
        self._bus, self._fastest = bus, FASTER * fastest_rad_s
        self.begin()

    def begin(self) -> None:
        """Forget what was measured: nothing is known of the joints."""
        count = len(self._bus.ids)
        self._last: tuple[float, NDArray[np.int64], NDArray[np.int64]] | None = None
        self._ticking, self._same = np.zeros(count, bool), np.zeros(count, int)

    def clocks(self, before: NDArray[np.int64], after: NDArray[np.int64]) -> str:
        """Find whose Realtime Tick runs, from two readings [ms], shape (S,) each; why a servo is
        doubted, or "".

        Servos none of which has a running clock are not judged by it.
        """
        self._ticking = after != before
        if self._ticking.any() and not self._ticking.all():
            names = [self._bus.label(int(i)) for i in np.flatnonzero(~self._ticking)]
            return f"{names[0]}: its clock (Realtime Tick) stands still, those of others run: are its values old?"
        return ""

    def doubt(
        self,
        now_s: float,
        position: NDArray[np.int64],
        velocity: NDArray[np.int64],
        tick_ms: NDArray[np.int64],
        *,
        calm: bool = False,
    ) -> Doubt:
        """Doubt whether a measurement can be true and is young enough; one that is believed is kept
        to judge the next by.

        Arguments:
            now_s: when it arrived, monotonic. position [ticks], velocity, tick_ms: as the servos
                report them, shape (S,).
            calm: the bus was quiet before it was asked for, so that no late answer can have been
                taken for this one.
        """
        fastest = np.abs(velocity) * RAD_S > 2.0 * self._fastest + 1.0
        for index in np.flatnonzero(fastest):
            speed = velocity[index] * RAD_S
            return Doubt(
                f"{self._name(index)}: measured to turn at {speed:.1f} rad/s, which it cannot"
            )
        if self._last is None:
            self._last = now_s, position, tick_ms
            return BELIEVED
        then_s, before, ticked = self._last
        passed_s = now_s - then_s
        moved = RAD * np.abs(position - before)
        for index in np.flatnonzero(moved > self._fastest * passed_s + SLACK_RAD):
            return Doubt(
                f"{self._name(index)}: measured to jump {moved[index]:.2f} rad in "
                f"{1e3 * passed_s:.0f} ms, which it "
                f"cannot turn: do two servos have id {self._bus.ids[index]}, or is it disturbed?"
            )
        went_ms = (tick_ms - ticked) % WRAP_MS
        for index in np.flatnonzero(self._ticking & ((went_ms == 0) | (went_ms > WRAP_MS // 2))):
            if passed_s < 1e-3 * (WRAP_MS // 4):
                what = (
                    "stands still"
                    if went_ms[index] == 0
                    else "went back: is it an old answer, or did it restart"
                )
                return Doubt(
                    f"{self._name(index)}: its values are old: its clock (Realtime Tick) {what}",
                    late=True,
                )
        late_s = passed_s - 1e-3 * went_ms
        for index in np.flatnonzero(self._ticking & (late_s > OLD_S)):
            if not calm and passed_s < 1e-3 * (WRAP_MS // 4):
                old = f"its values are {late_s[index]:.2f} s old: do answers come late?"
                return Doubt(f"{self._name(index)}: {old}", late=True)
        turning = np.abs(velocity) * RAD_S * passed_s > FROZEN_TICKS * RAD
        self._same = np.where(turning & (position == before), self._same + 1, 0)
        for index in np.flatnonzero(self._same > FROZEN):
            return Doubt(
                f"{self._name(index)}: measured to turn at {velocity[index] * RAD_S:.2f} rad/s and "
                "to stay at "
                f"{position[index]} ticks: are its values old?"
            )
        self._last = now_s, position, tick_ms
        return BELIEVED

    def _name(self, index: np.intp) -> str:
        return self._bus.label(int(index))
