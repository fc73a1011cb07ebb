"""The way back: a step that found no ground is undone, along its own path, to the stance that it
began from.

It is the motion of an accepted plan in reverse and slower; the guard looks at what is sent, no
verifier judges it anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples, smooth, smooth_rate
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain.prism import Solid

from ..prepared import Prepared, Tracked
from ..record import Record
from ..run import Runner
from ..worlds.world import State
from .tracker import Tracker

KNOTS = 31
SLOWER = 2.0
"""The way back takes so many times as long as the way there: then nothing is faster than it was."""


class Retreat:
    """A ``Motion``: a stretch of a plan's motion backwards, from rest to rest.

    Arguments:
        begin_s, end_s: of that stretch.
    """

    def __init__(self, motion: PlanMotion, begin_s: float, end_s: float) -> None:
        self._motion, self._begin_s, self._end_s = motion, begin_s, end_s
        self.solids: tuple[Solid, ...] = motion.solids

    @classmethod
    def of_step(cls, motion: PlanMotion, frame: int) -> Retreat:
        """Retreat along the step to this frame, all of it."""
        return cls(motion, *motion.step_s(frame))

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return SLOWER * (self._end_s - self._begin_s)

    @property
    def knots_s(self) -> Array:
        """Times of the knots, as in ``Motion`` [s]."""
        return np.linspace(0.0, self.duration_s, KNOTS)

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        share = np.clip(np.asarray(times_s) / self.duration_s, 0.0, 1.0)
        back_s = self._begin_s - self._end_s
        there = self._motion.at(self._end_s + smooth(share) * back_s)
        rate = (smooth_rate(share) * back_s / self.duration_s)[..., None]
        return replace(
            there,
            velocity_m_s=rate * there.velocity_m_s,
            rotation_rate_rad_s=rate * there.rotation_rate_rad_s,
        )


def step_back(runner: Runner, prepared: Prepared[PlanMotion], frame: int, state: State) -> Record:
    """Undo the step to a key frame of a plan, from where the robot was measured; what was measured
    on the way.

    Raises Stopped, HardwareFault.
    """
    world, kinematics = runner.world, prepared.kinematics
    near = Kinematics(
        kinematics.robot,
        world.servo,
        gravity_m_s2=kinematics.gravity_m_s2,
        near_rad=np.array(state.angles_rad),
    )
    retreat, record = Retreat.of_step(prepared.motion, frame), Record()
    tracker = Tracker(retreat, near, world.rate_hz, runner.settings.feedback, drives=world.drives)
    tracked = Tracked(motion=retreat, tracker=tracker, first=tracker.start(), sees=prepared.sees)
    runner.follow(tracked, record)
    return record
