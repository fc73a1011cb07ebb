"""The motion of a leap that is executed: at rest before and after, and the whole body's way in between.

A leap is dynamic: it runs at its own pace or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..answer.plan import LeapPlan
from ..arguments import cached_property
from ..files.arrays import Array
from ..terrain.prism import Solid
from .leap_body import LeapBody
from .leap_motion import LeapMotion
from .motion import Samples

SETTLE_S, REST_S = 0.5, 2.0
"""At rest before, and after: a robot that stands so long has landed."""
PUSHES = 2
"""Intervals before a flight in which legs push so that a body goes into the air, held or not."""
LIGHT = 0.1
"""Toes that press with less than this share of the weight in all are about to lift."""
KNOT_S = 0.02
"""Postures are looked for so often."""


class LeapRun:
    """A leap of a robot whose legs are known, over time; ``Samples.frame`` counts seconds.

    Arguments:
        plan: the leap.
        settle_s, rest_s: how long it rests before and after [s].

    Raises:
        InvalidInput: for a robot without legs of its own.
    """

    counted = "seconds"

    def __init__(self, plan: LeapPlan, settle_s: float = SETTLE_S, rest_s: float = REST_S) -> None:
        self.plan, self.body = plan, LeapBody(plan)
        self.settle_s, self.rest_s = settle_s, rest_s
        self._feet_alone = LeapMotion(plan)
        self.solids: tuple[Solid, ...] = ()
        leap = plan.problem
        self.stances: Sequence[str] = tuple(
            f"{foothold.limb}, put down in phase {foothold.frame}," for foothold in leap.footholds
        )

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return float(self.plan.times_s[-1]) + self.settle_s + self.rest_s

    @property
    def last_frame(self) -> float:
        """The end [s]."""
        return self.duration_s

    @property
    def goal_m(self) -> Array:
        """Place at which the centre of mass ends, shape (3,) [m]."""
        return np.asarray(self.plan.com_m[-1])

    def entry(self) -> dict[str, Any]:
        """Start and goal, for a log."""
        return {"start_m": self.plan.com_m[0], "goal_m": self.plan.com_m[-1]}

    @property
    def knots_s(self) -> Array:
        """Times at which postures are chosen, shape (K,) [s]."""
        return np.linspace(0.0, self.duration_s, int(np.ceil(self.duration_s / KNOT_S)) + 1)

    @cached_property
    def committed_s(self) -> tuple[tuple[float, float], ...]:
        """From when the body goes into the air whatever its legs do, and when it rests again [s]:
        from the beginning of the last but one interval that pushes before the first flight to the
        end; none where some limb always stands. Legs that are held while they push throw a robot
        off its feet from there on.
        """
        leap, ends = self.plan.problem, self.plan.times_s
        air = (leap.holds[leap.interval_phases] < 0).all(axis=1)
        if not air.any():
            return ()
        pushes = np.linalg.norm(self.plan.forces_n.sum(axis=1), axis=1) > LIGHT * leap.weight_n
        lifts = np.flatnonzero(pushes[: int(np.argmax(air))])
        first = max(int(lifts[-1]) + 1 - PUSHES, 0) if len(lifts) else 0
        begin, rests = float(ends[first]) + self.settle_s, float(ends[-1]) + self.settle_s
        return ((begin, rests + SETTLE_S if self.rest_s > SETTLE_S else self.duration_s),)

    def at(self, times_s: float | Array) -> Samples:
        """The samples at times; the ends are held."""
        body = self.body
        times = np.asarray(times_s, dtype=np.float64)
        when = np.clip(times - self.settle_s, body.times_s[0], body.times_s[-1])
        moves = (when == times - self.settle_s)[..., None]
        base = self._feet_alone.at(when)
        vectors, rates, centres, normals = self._tables
        stands = base.stands[..., None]
        facing = normals(when)
        facing = facing / np.linalg.norm(facing, axis=-1, keepdims=True)
        return Samples(
            com_m=base.com_m,
            velocity_m_s=np.where(moves, base.velocity_m_s, 0.0),
            rotation_rad=vectors(when),
            rotation_rate_rad_s=np.where(moves, rates(when), 0.0),
            frame=np.clip(times, 0.0, self.duration_s),
            feet_m=np.where(stands, base.feet_m, centres(when)),
            radii_m=base.radii_m,
            forces_n=base.forces_n,
            foothold=base.foothold,
            normals=np.where(stands, base.normals, facing),
            friction=base.friction,
        )

    @cached_property
    def _tables(self) -> tuple[Any, Any, Any, Any]:
        """Rotation vectors and their rates, centres of the feet and normals, over time."""
        from scipy.interpolate import CubicSpline, make_interp_spline  # slow to import

        body = self.body
        vectors = CubicSpline(body.times_s, body.rotation_rad, bc_type="clamped")
        centres = CubicSpline(body.times_s, body.centres_m, bc_type="clamped")
        normals = make_interp_spline(body.times_s, body.normals, k=1)
        return vectors, vectors.derivative(), centres, normals
