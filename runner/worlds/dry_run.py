"""The world of a dry run: it measures once, and then says what would have been sent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stancekit.planners.files.arrays import Array

from .world import LatchedWorld, State, Terrain, World


class NullWorld(LatchedWorld):
    """In place of a world that was reset: no command goes through.

    Its joints are where they would have been sent.

    Arguments:
        first: what the world measured. The body is where it was, and its feet feel nothing. The
            latch is the world's.
    """

    def __init__(self, world: World, first: State) -> None:
        self.latch, self.name, self.robot, self.servo = (
            world.latch,
            world.name,
            world.robot,
            world.servo,
        )
        self.joints, self.rate_hz = world.joints, world.rate_hz
        self._state = replace(first, sent_rad=np.array(first.angles_rad))
        self.steps = 0

    def reset(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Return the measured state; nothing is asked again."""
        return self._state

    def step(self, targets_rad: Array) -> State:
        """Send nothing; the joints are at the targets, shape (J,) [rad]."""
        with self.latch.sending():
            self.steps += 1
        before, period_s = self._state, 1.0 / self.rate_hz
        self._state = replace(
            before,
            time_s=before.time_s + period_s,
            angles_rad=np.array(targets_rad, dtype=float),
            rates_rad_s=(np.asarray(targets_rad, dtype=float) - before.angles_rad) / period_s,
            sent_rad=np.array(targets_rad, dtype=float),
        )
        return self._state

    def close(self) -> None:
        """Nothing is held."""
