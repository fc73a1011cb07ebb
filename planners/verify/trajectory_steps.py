"""Steps of a trajectory: how long its feet stand and swing, how they leave the ground, clear it and
come back.

A foot that is said to swing is in the air, or its friction would be missing from the balances; one
that is said to stand stays where it is for long enough to push.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..files.arrays import Array
from .trajectory_measurements import Flags, TrajectoryMeasurements
from .trajectory_series import Series

APART_M = 0.01
"""Between samples a swinging foot is looked at this often along its way [m]."""
MOST_PIECES = 10
"""Points between two samples at most: a foot that is faster than ``Limits.foot_speed_m_s`` is
refused anyway."""


@dataclass(frozen=True, slots=True)
class FootPhase:
    """Samples first … last of one foot's stance or swing.

    Arguments:
        whole: it begins and ends within the trajectory.
    """

    foot: int
    first: int
    last: int
    whole: bool = True


class StepMeasurements:
    """Measurements of the steps of one trajectory; all series are shape (K, E) unless they say
    otherwise.
    """

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        self.trajectory, self.feet = measured.trajectory, measured.feet
        self.times_s, self.step_s = measured.times_s, measured.step_s
        self._above, self._height_m = measured.above, measured.ground[0]
        self._swings = tuple(_phases(~self.trajectory.contact))

    # ------------------------------------------------------------------------------------- speed
    # and duration

    def foot_velocity(self) -> Series:
        """Speed of a foot between two samples at both of which it stands, shape (K − 1, E)
        [m/s].
        """
        return self._speed(self.trajectory.contact[:-1] & self.trajectory.contact[1:])

    def touch_speed(self) -> Series:
        """Speed of a foot between two samples at one of which it stands, shape (K − 1, E) [m/s]."""
        return self._speed(self.trajectory.contact[:-1] ^ self.trajectory.contact[1:])

    def stance_time(self, least_s: float) -> Series:
        """Time by which a stance is too short, from its first sample to the first one after it [s]."""
        return self._marked(
            (stance, least_s - (stance.last - stance.first + 1) * self.step_s)
            for stance in _phases(self.trajectory.contact)
            if stance.whole
        )

    def swing_time(self, least_s: float) -> Series:
        """Time by which a swing is too short, between the samples at which the foot stands before
        and after it [s]; a swing that the trajectory's ends cut off has none.
        """
        whole = (swing for swing in self._swings if swing.whole)
        return self._marked(
            (swing, least_s - (swing.last - swing.first + 2) * self.step_s) for swing in whole
        )

    def _speed(self, asked: Flags) -> Series:
        speed = np.linalg.norm(np.diff(self.trajectory.feet_m, axis=0), axis=-1) / self.step_s
        return Series(np.where(asked, speed, 0.0), self.feet, self.times_s[1:])

    # ------------------------------------------------------------------------------------------- in
    # the air

    def lift(self, least_m: float) -> Series:
        """Distance by which the highest point of a swing, along the normal, is too low [m]."""
        return self._marked(
            (swing, least_m - float(self._heights(swing).max())) for swing in self._swings
        )

    def clearance(self, least_m: float) -> Series:
        """Distance by which a foot comes too near the ground, along the normal, in the middle half
        of its swing [m].
        """
        return self._marked(
            (swing, least_m - float(self._middle(swing).min())) for swing in self._swings
        )

    def drag(self, near_m: float) -> Series:
        """Way of a foot in a swing while it is nearer to the ground than ``near_m``, along the
        normal [m].
        """
        return self._marked((swing, self._dragged(swing, near_m)) for swing in self._swings)

    def penetration_between(self) -> Series:
        """Depth of swinging feet between samples, every centimetre along cubics through the samples
        [m].
        """
        pieces = self._pieces()
        worst = np.zeros(len(self.feet)), np.zeros(len(self.feet))
        for number in range(len(self.feet)):
            points, times_s = self._between(number, pieces)
            if len(points):
                depth = -self._above(points)[0]
                worst[0][number], worst[1][number] = depth.max(), times_s[depth.argmax()]
        deepest = int(worst[0].argmax())
        return Series(worst[0][None], self.feet, worst[1][[deepest]])

    def _pieces(self) -> int:
        """Into how many pieces steps from sample to sample are cut."""
        longest = float(np.linalg.norm(np.diff(self.trajectory.feet_m, axis=0), axis=-1).max())
        return int(np.clip(np.ceil(longest / APART_M), 2, MOST_PIECES))

    def _between(self, number: int, pieces: int) -> tuple[Array, Array]:
        """Points of one foot between samples of which neither stands, shape (P, 3) [m], and their
        times (P,) [s].
        """
        flies = ~self.trajectory.contact[:, number]
        at = np.flatnonzero(flies[1:-2] & flies[2:-1] & flies[:-3] & flies[3:]) + 1
        shares = np.arange(1, pieces) / pieces
        weights = 0.5 * np.stack(
            [
                -shares + 2 * shares**2 - shares**3,
                2 - 5 * shares**2 + 3 * shares**3,
                shares + 4 * shares**2 - 3 * shares**3,
                -(shares**2) + shares**3,
            ]
        )
        near = self.trajectory.feet_m[at[:, None] + np.arange(-1, 3), number]
        points = np.einsum("kwi,ws->ksi", near, weights).reshape(-1, 3)
        return points, (self.times_s[at][:, None] + shares * self.step_s).ravel()

    def _heights(self, swing: FootPhase) -> Array:
        return self._height_m[swing.first : swing.last + 1, swing.foot]

    def _middle(self, swing: FootPhase) -> Array:
        """Heights in the middle half; of a swing that is cut off all but a quarter beside the end
        at which it lands.
        """
        heights = self._heights(swing)
        quarter = len(heights) // 4
        begins, ends = swing.first > 0, swing.last < len(self._height_m) - 1
        return heights[quarter * begins : len(heights) - quarter * ends]

    def _dragged(self, swing: FootPhase, near_m: float) -> float:
        first, last = max(swing.first - 1, 0), min(swing.last + 1, len(self._height_m) - 1)
        way = self.trajectory.feet_m[first : last + 1, swing.foot]
        stands = self.trajectory.contact[first : last + 1, swing.foot]
        low = stands | (self._height_m[first : last + 1, swing.foot] < near_m)
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1)[low[1:] & low[:-1]].sum())

    def _marked(self, found: Iterator[tuple[FootPhase, float]]) -> Series:
        """A value a phase, at the sample where the phase begins."""
        values = np.zeros(self.trajectory.contact.shape)
        for phase, value in found:
            values[phase.first, phase.foot] = max(value, 0.0)
        return Series(values, self.feet, self.times_s)


def _phases(holds: Flags) -> Iterator[FootPhase]:
    """Runs of samples at which it holds, foot by foot; those that an end of the trajectory cuts off
    are not whole.
    """
    for foot in range(holds.shape[1]):
        changes = [0, *(np.flatnonzero(np.diff(holds[:, foot])) + 1).tolist(), len(holds)]
        for first, end in pairwise(changes):
            if holds[first, foot]:
                yield FootPhase(foot, first, end - 1, whole=first > 0 and end < len(holds))
