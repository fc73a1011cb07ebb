"""Places where feet are put down: what is added to their planned places, because of what they feel
and where the body is.

Feet that should touch and do not are lowered. A foot that stands and should press with little is
not: it lost its load since the robot tips away from it, and what it is lowered by tips it further.
Where the body is measured, feet that have landed, early or late, stay where they are, and not where
they should have landed, until the path on which they are lifted is above them: one that begins
below them would press them into the ground; those in the air go to their places in the world, or
step to where the body falls. Until a foot bears it goes with the body as it is, not as it should
be: joints that pull a body to its place with a foot that has no friction for it only make that foot
slide.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.arguments import check_types
from stancekit.planners.files.arrays import Array, check_numbers
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.kinematics import Kinematics

from ..worlds.world import State
from .body_feedback import BodyPose

_SMOOTH_HZ = 60.0
"""Rate [1/s] at which a foot's target goes to where the foot was found to have landed."""
_EARLY = 0.05
"""A foot that comes down and feels this share of the weight has landed."""
_QUIET, _LISTEN_S = 4.0, 0.5
"""What a foot feels is a contact above so many standard deviations of what feet in the air felt,
about for this time [s]. A surface does not pull: what they feel below zero is noise, and half of
it."""
_BORNE, _BORNE_S = 0.1, 0.1
"""A foot that is to press with less than this share of the weight is not lowered once it stands. And
one holds its place in the world, not under the body, until it has felt this share of the
weight, about for this time [s]: what bears nothing pulls no body to its place, it only slides."""
LEVEL = 0.5
"""Feet that step aside come down between the heights that they should have under the body and in
the world."""
_BEYOND = 1.15
"""They step so much farther than where the body would come to rest over them: it comes back."""
WITH_FEET = 0.5
"""A body over feet that stepped aside is pulled to its place, but for this share of what they
did."""
_STEP = 0.2
"""Feet step aside by no more than this share of the height at which the robot stands."""
GIVES_M = 0.006
"""Way that legs and body give, beside what is not known of the ground [m]."""
FADES = 0.9
"""Share that is left after a control period of what a foot that has lifted was lowered, rolled and
pressed."""
TOUCH_N, _OF_WEIGHT = 1.5, 0.05
"""A foot that feels more than this touches, or than this share of a light robot's weight."""


@dataclass(frozen=True, kw_only=True)
class ContactFeedback:
    """Settings of what feet that feel do.

    Arguments:
        touch_n: a foot that presses this hard on its patch touches it, less hard of a light robot,
            harder where sensors are noisy.
        seek_m_s, seek_m: how fast a foot that should touch and does not is lowered, and how far.
        press_hz: rate at which missing internal forces are summed, on steep surfaces only, 0 for
            never.
        press_n, press_share: the most that is added for each foot, and as a share of what it should
            press with: as much again is missing on ground that yields as legs do, twice as much
            where it is half as stiff.
        waits: the motion waits for a foot that should touch.
        memory_s: of how stiff joint loops were found to be (``LoopStiffness``), 0 to count on what
            they should be.
        settle_hz: rate at which feet that slid as they landed are taken to stand where they are,
            while the robot rests on all of them, and the body goes with those that bear it; 0 for
            where they landed first.
    """

    touch_n: float = TOUCH_N
    seek_m_s: float = 0.02
    seek_m: float = 0.02
    press_hz: float = 20.0
    press_n: float = 40.0
    press_share: float = 4.0
    waits: bool = True
    memory_s: float = 5.0
    settle_hz: float = 0.0

    def __post_init__(self) -> None:
        check_types(self, "feedback.")
        check_numbers(
            self, "feedback.", least=[name for name in self.__annotations__ if name != "waits"]
        )


def touch_n(weight_n: float, most_n: float = TOUCH_N) -> float:
    """Force above which a foot touches, of a robot of some weight [N]."""
    return min(most_n, _OF_WEIGHT * weight_n)


class FootPlacement:
    """Placement of the feet of one motion.

    Arguments:
        step_s: feet in the air step aside by what the body's velocity error makes in this time; 0
            for never.
        touch_downs_m: how far beyond its place the ground of each foothold may be, 0 of what is
            exact, shape (P,). touched: which feet have landed, shape (N,). seeks: which of those
            that stand have not met their uncertain ground yet and are being lowered, shape (N,).
            moved_m: what is added to the planned places of all feet, shape (N, 3); shift_m: to that
            of the body, shape (3,).
    """

    def __init__(
        self,
        first: Samples,
        kinematics: Kinematics,
        feedback: ContactFeedback,
        *,
        weight_n: float,
        step_s: float,
        period_s: float,
        touch_downs_m: Array | None = None,
    ) -> None:
        self._kinematics, self._feedback, self._weight = kinematics, feedback, weight_n
        self._step_s, self._period_s = step_s, period_s
        self._left = np.exp(-_SMOOTH_HZ * period_s)
        self._most_step = _STEP * kinematics.model.stand_height_m
        self._landed, self._planned = first.feet_m, first.feet_m
        self._stepped, self.moved_m, self._drift = (np.zeros_like(first.feet_m) for _ in range(3))
        self._aside, self.shift_m = np.zeros_like(first.feet_m), np.zeros(3)
        self._depth, self._borne = np.zeros(len(first.feet_m)), np.ones(len(first.feet_m))
        self._listened, self._variance = 0.0, 0.0
        self._leaves = np.zeros(len(first.feet_m), dtype=np.bool_)
        known = np.zeros(0) if touch_downs_m is None else touch_downs_m
        deepest = np.minimum(known + GIVES_M, feedback.seek_m)
        self._deepest = np.append(np.where(known > 0.0, deepest, feedback.seek_m), feedback.seek_m)
        self._uncertain = np.append(known > 0.0, False)
        self._met, self._heard = first.stands & ~self._on(self._uncertain, first), False
        self.touched, self.seeks = self._met, np.zeros(len(first.feet_m), dtype=np.bool_)

    def seek(
        self, now: Samples, then: Samples, felt_n: Array, late: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Lower feet that should touch and do not; tell for which of them to wait, shape (N,).

        Those are the ones that were in the air just now, and on uncertain ground also the ones that
        the motion begins with: such feet are lowered until they feel, however little they should
        press.

        Arguments:
            felt_n: along the normals, shape (N,).
            late: legs whose joints are not where they should be: they come first.
        """
        stands, lands, wanted = then.stands, ~now.stands, then.along_n
        if not stands.all():
            self._listen(np.minimum(felt_n[~stands], 0.0))
        late = late & stands & lands & self._feedback.waits
        touches = self._touches(felt_n)
        self._met = stands & (touches | (self._met & ~lands))
        unmet = stands & ~self._met & self._on(self._uncertain, then)
        loaded = wanted > max(4.0 * self._touch_n, _BORNE * self._weight)
        missing = stands & ~late & (lands | unmet | loaded)
        missing &= ~touches & (self._depth < self._on(self._deepest, then))
        self.seeks = missing & unmet
        deeper = self._depth + self._feedback.seek_m_s * self._period_s
        self._depth = np.where(stands, np.where(missing, deeper, self._depth), FADES * self._depth)
        return np.asarray((missing & (lands | unmet)) | late)

    def _touches(self, felt_n: Array) -> NDArray[np.bool_]:
        """Tell which feet touch, shape (N,). Before the first period nothing was felt yet: feet are
        taken to stand where the ground is exact, and nowhere else.
        """
        return np.asarray((felt_n >= self._touch_n) & (self._met | self._heard))

    @staticmethod
    def _on(of_footholds: NDArray[Any], sample: Samples) -> NDArray[Any]:
        """Values of the footholds that limbs stand on, the last one in the air, shape (N,).

        Arguments:
            of_footholds: shape (P + 1,).
        """
        return np.asarray(of_footholds[np.minimum(sample.foothold, len(of_footholds) - 1)])

    @property
    def _touch_n(self) -> float:
        """A foot that presses so hard touches."""
        return max(touch_n(self._weight, self._feedback.touch_n), _QUIET * sqrt(self._variance))

    def _listen(self, below_n: Array) -> None:
        """Estimate the noise of the feet by what those in the air feel below zero, shape (K,)."""
        if below_n.size:
            self._listened = min(self._listened + self._period_s, _LISTEN_S)
            share = min(1.0, self._period_s / self._listened)
            self._variance += (2.0 * float(np.mean(below_n**2)) - self._variance) * share

    def follow(
        self,
        now: Samples,
        then: Samples,
        felt_n: Array,
        rolled_m: Array,
        seen: tuple[State, BodyPose] | None,
    ) -> None:
        """Find ``touched`` and ``moved_m``, which goes smoothly to where it should be.

        Arguments:
            rolled_m: how far feet have rolled, shape (N, 3).
            seen: the robot, and where its body should be; None where that is not measured.
        """
        stands = then.stands
        if seen is None:
            self.touched, goal = stands, np.zeros(3)
        else:
            (state, body), before = seen, self.touched | self._leaves
            landed = self._land(now, then, felt_n, state, rolled_m)
            self._settle(then, state, rolled_m)
            self._lean(then, landed)
            self._leaves = before & ~(stands | self.touched)
            if self._leaves.any():
                over = np.vecdot(self._landed - then.feet_m, then.normals)
                self._leaves &= over > 0.0
            held = self.touched | self._leaves
            if self._step_s > 0.0:
                step = self._step(state, body, then)
                self._stepped = np.where((stands | held)[:, None], self._stepped, step)
            placed = np.where(held[:, None], self._landed, then.feet_m + self._stepped)
            origin, turned, _ = body
            origin = origin + self.shift_m
            carried = origin + (placed - state.position_m) @ state.rotation @ turned.T - placed
            goes = self._step_s == 0.0 or held.all()
            shift = self.shift_m if goes else np.where(held[:, None], self.shift_m, 0.0)
            goal = placed + self._free(carried, felt_n, then, held) - then.feet_m - shift
            self._stay(then, early=held & ~stands, landed=landed)
        self._planned, self._heard = then.feet_m, True
        away = goal - self._depth[:, None] * then.normals - self.moved_m
        # ẍ = ω² (goal − x) − 2 ω ẋ over a period, exactly: whatever ω T is
        turns, left = _SMOOTH_HZ * self._period_s, self._left
        coming = self._drift - _SMOOTH_HZ * away
        self.moved_m = self.moved_m + away - left * (away - self._period_s * coming)
        self._drift = left * (self._drift - turns * coming)

    def _land(
        self, now: Samples, then: Samples, felt: Array, found: State, rolled: Array
    ) -> NDArray[np.bool_]:
        """Find the feet that land just now, early or late, shape (N,); where they do is kept."""
        before, stands = self.touched, then.stands
        self.touched = stands & (before | self._touches(felt))
        if not stands.all():
            comes = np.vecdot(then.feet_m - now.feet_m, then.normals) < 0.0
            early = felt >= max(_EARLY * self._weight, self._touch_n)
            self.touched |= ~stands & comes & (before | early)
        landed = self.touched & ~before
        if landed.any():
            feet = found.position_m + self._kinematics.feet(found.angles_rad) @ found.rotation.T
            self._landed = np.where(landed[:, None], feet - rolled, self._landed)
            self._depth = np.where(landed, 0.0, self._depth)
        return np.asarray(landed)

    def _settle(self, then: Samples, found: State, rolled: Array) -> None:
        """Feet that slid stand where they are, once the robot rests on all of them: joints that
        pull them back only press them against each other. The body goes with where they slid and
        rolled to.
        """
        rate = self._feedback.settle_hz * self._period_s
        if not rate or then.velocity_m_s.any() or then.rotation_rate_rad_s.any():
            return
        if not (self.touched & then.stands).all():
            return
        feet = found.position_m + self._kinematics.feet(found.angles_rad) @ found.rotation.T
        self._landed = self._landed + rate * (feet - rolled - self._landed)
        self._aside = feet - then.feet_m

    def _stay(self, then: Samples, early: NDArray[np.bool_], landed: NDArray[np.bool_]) -> None:
        """Feet that have landed early stop at once, although their path goes on, and those that
        leave stay: late, they would push the ground.
        """
        if early.any():
            path = then.feet_m - self._planned
            self.moved_m = np.where(early[:, None], self.moved_m - path, self.moved_m)
            self._drift = np.where((early & landed)[:, None], 0.0, self._drift)

    def _free(self, carried: Array, felt: Array, then: Samples, held: NDArray[np.bool_]) -> Array:
        """Part that feet take of the way from their places to those for a body that is where it
        should be, (N, 3) [m].

        All of it until they bear; of those that step aside with the body, in the air, half of what
        is along their normals.

        Arguments:
            carried: that way, shape (N, 3).
            held: which feet stay where they landed, shape (N,).
        """
        gone = np.minimum(np.maximum(felt / (_BORNE * self._weight), 0.0), 1.0) - self._borne
        self._borne = np.where(held, self._borne + gone * self._period_s / _BORNE_S, 0.0)
        bears = (1.0 - self._borne)[:, None] * carried
        if self._step_s == 0.0:
            return np.asarray(bears)
        up = np.vecdot(carried, then.normals)[:, None] * then.normals
        return np.asarray(np.where(held[:, None], bears, LEVEL * up))

    def _lean(self, then: Samples, landed: NDArray[np.bool_]) -> None:
        """Find ``shift_m``: a body that is pulled to its place over feet that stepped aside tips
        over them, the other way; one that goes with its feet never comes back.
        """
        if landed.any():
            self._aside = np.where(landed[:, None], self._landed - then.feet_m, self._aside)
        if not (self._feedback.settle_hz or self._step_s):
            return
        bear = np.where(self.touched & then.stands, then.forces_n[:, 2].clip(0.0), 0.0)
        if self._feedback.settle_hz > 0.0 and bear.any():
            borne = (bear @ self._aside) / bear.sum() * [1.0, 1.0, 0.0]
            self.shift_m += self._feedback.settle_hz * self._period_s * (borne - self.shift_m)
        elif self._step_s > 0.0 and bear.any():
            self.shift_m = WITH_FEET * (bear @ self._aside) / bear.sum() * [1.0, 1.0, 0.0]

    def _step(self, found: State, body: BodyPose, sample: Samples) -> Array:
        """Distance that feet which go with the body step aside, along their surfaces, (N, 3) [m]:
        to where it comes to rest over them, x + v √(h/g) of what it is off, and a little farther.
        """
        origin, _, velocity = body
        late, away = found.velocity[:3] - velocity[:3], found.position_m - origin
        aside = _BEYOND * self._step_s * late + (_BEYOND - 1.0) * away
        aside = aside * min(1.0, self._most_step / max(float(np.linalg.norm(aside)), 1e-9))
        return np.asarray(aside - (sample.normals @ aside)[:, None] * sample.normals)
