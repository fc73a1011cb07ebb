"""From a motion to joint targets, one control period after the other, with what feet feel on the
way.

Only positions are sent: with q + Kp⁻¹ (τ + Kd q̇) as the target and τ = g(q) − Σ Jᵀ f, the position
loop presses with the planned contact forces f and does not lag behind. Feet are spheres and roll as
their limb turns; what they roll is added to where they are expected, or the body would be carried
along. Three things close the loop, all of them by feet that feel forces: a foot that should stand
is lowered until it touches, the motion waits for that, and forces that are not as planned are
summed up into what is commanded, as far as they are internal: they balance each other and leave the
body where it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files.arrays import Array, lengths
from stancekit.planners.motion.joints import STRAY_M
from stancekit.planners.motion.motion import Played, Samples, smooth
from stancekit.planners.robot.kinematics import Kinematics, pinocchio

from ..motion.redundancy import RedundancyResolution, resolved
from ..worlds.world import Drives, State
from .body_feedback import BodyController, BodyFeedback, skew
from .foot_placement import FADES, ContactFeedback, FootPlacement, touch_n

SPEED_SHARE = 0.9
"""Share of their greatest velocity that joints in the air are led with."""
RAMP_S, PAUSE_S = 0.035, 0.2
"""Times in which such a joint comes to that velocity, and in which a motion that waits for it comes
to rest."""
_LATE_RAD = 1e-6
"""A leg with a joint that is farther from where it should be is late."""


class SwingSpeed:
    """Speed limit of the swinging legs of one motion.

    Arguments:
        velocity_rad_s: greatest of the joints, shape (J,). pace: how fast the motion's time goes,
            from 0 to 1. late: which legs are not yet where they should be, shape (N,).
    """

    def __init__(self, kinematics: Kinematics, velocity_rad_s: Array, period_s: float) -> None:
        self._kinematics, self._most, self._period_s = (
            kinematics,
            SPEED_SHARE * velocity_rad_s,
            period_s,
        )
        self._most_change = period_s / RAMP_S * self._most
        self._wanted: Array | None = None
        self.pace, self.late = 1.0, np.zeros(len(kinematics.robot.limbs), dtype=bool)

    def led(self, before: Array, rates: Array, angles: Array, air: NDArray[np.bool_]) -> Array:
        """The next angles on the way to these, shape (J,).

        A leg that is where it should be goes with what it follows; one that is elsewhere comes
        there, braking in time, and neither turns faster, nor changes how fast it turns by more in a
        period, than ``RAMP_S`` lets it; at a limit of a joint, which it may be late to brake for,
        it stops.

        Arguments:
            before, rates: the last, with their velocities.
            air: which legs are there, shape (N,).
        """
        period, slower = self._period_s, self._period_s / PAUSE_S
        each = self._kinematics.of_joints
        if not air.any() or self._keeps_up(before, rates, angles):  # nobody is led, or late
            self._wanted, self.late = angles, np.zeros_like(air)
            self.pace = min(max(self.pace + slower, 0.0), 1.0)
            return angles
        follows = (
            np.zeros_like(angles) if self._wanted is None else (angles - self._wanted) / period
        )
        follows = follows * each(self._used(follows) <= 1.0)  # a jump is nothing to go along with
        away = angles - before - period * follows
        left = self._used(away)  # what is left of the way, in seconds at full speed
        steps = np.ceil(
            0.5 * np.sqrt(1.0 + 8.0 * left * RAMP_S / period**2) - 0.5
        )  # periods in which it stops there
        steps = np.maximum(1.0, steps)
        closing = 1.0 / (steps * period) + 0.5 * (steps - 1.0) * period / RAMP_S / np.maximum(
            left, 1e-12
        )
        velocity = follows + each(closing) * away
        velocity = velocity / each(np.maximum(1.0, self._used(velocity)))
        change = velocity - rates
        change = change / each(np.maximum(1.0, self._used(change) * RAMP_S / period))
        on = before + period * (rates + change)
        on = np.minimum(np.maximum(on, self._kinematics.lowest_rad), self._kinematics.highest_rad)
        led = np.where(each(air), on, angles)
        self._wanted = angles
        self.late = self._kinematics.by_leg(np.abs(angles - led)).max(axis=1) > _LATE_RAD
        self.pace = min(max(self.pace + (-slower if self.late.any() else slower), 0.0), 1.0)
        if not self.late.any():
            return angles
        return np.asarray(np.where(each(self.late), led, angles))

    def _keeps_up(self, before: Array, rates: Array, angles: Array) -> bool:
        """Tell whether joints that were where they should be come to the next angles within what
        they can, so that ``led`` leads them there, too.
        """
        if before is not self._wanted:
            return False
        velocity = (angles - before) / self._period_s
        change = np.abs(velocity - rates)
        return bool(((np.abs(velocity) <= self._most) & (change <= self._most_change)).all())

    def _used(self, velocity: Array) -> Array:
        """The share of what a leg can that it uses, shape (N,)."""
        return np.asarray(self._kinematics.by_leg(np.abs(velocity) / self._most).max(axis=1))


_PRIOR_S = 0.2
"""The stiffness that is counted on has the weight of so much time in the first pose."""
FARTHEST = 2.0
"""The share is between the inverse of this and this."""


class LoopStiffness:
    """Stiffness of all loops of a robot together.

    Attributes:
        share: of the stiffness that loops have, s; 1 until something is known.
    """

    def __init__(self, drives: Drives, period_s: float, memory_s: float) -> None:
        self._drives, self._period_s = drives, period_s
        self._kept = np.exp(-period_s / memory_s) if memory_s > 0.0 else 0.0
        self._asks = memory_s > 0.0 and drives.yields
        self._prior = self._square = self._along = 0.0
        self.share = 1.0

    def see(self, state: State, torques_nm: Array, stand: NDArray[np.bool_]) -> None:
        """One more period.

        Arguments:
            torques_nm: what joints give by the forces that feet felt.
            stand: which joints are of legs that stand, shape (J,) both.
        """
        if not self._asks:
            return
        yielded = np.where(
            stand, self._drives.stiffness_nm_rad * (state.sent_rad - state.angles_rad), 0.0
        )
        slowed = self._drives.damping_nms_rad * state.rates_rad_s
        slowed += self._drives.resistance(state.rates_rad_s)
        torques = np.where(stand, torques_nm + slowed, 0.0)
        self._prior = self._prior or _PRIOR_S * float(max(torques @ torques, yielded @ yielded))
        self._square = self._kept * self._square + self._period_s * float(yielded @ yielded)
        self._along = self._kept * self._along + self._period_s * float(yielded @ torques)
        share = (self._along + self._prior) / max(self._square + self._prior, 1e-12)
        self.share = min(max(share, 1.0 / FARTHEST), FARTHEST)


def command(
    drives: Drives,
    angles_rad: Array,
    torques_nm: Array,
    rates_rad_s: Array,
    rising_rad_s2: Array,
    share: float = 1.0,
) -> Array:
    """q + Kp⁻¹ (τ + Kd q̇ + J q̈ + r(q̇)), shape (J,) [rad]: a loop τ = Kp (q* − q) − Kd q̇ that is
    sent this gives τ at q, and what the joint itself turns against.

    A servo takes no torque: it gets it as an offset of its position.

    Arguments:
        torques_nm: of loads and links; the rotors' are added here.
        share: of Kp that the loops really have. A loop that yields to nothing is sent q.
    """
    if not drives.yields:
        return np.array(angles_rad)
    torques = torques_nm + drives.damping_nms_rad * rates_rad_s + drives.rotor_kg_m2 * rising_rad_s2
    torques = torques + drives.resistance(rates_rad_s)
    return np.asarray(angles_rad + torques / (share * drives.stiffness_nm_rad))


_AHEAD = 64
"""The most periods that are looked up together."""

_Expected = tuple[Samples, Array]
"""A sample, and the posture that joints are drawn to then, shape (J,) [rad]."""


class _Coming:
    """Samples of one motion at the times that its tracker asks for.

    The next periods are looked up with the one that is asked for, twice as many each time as long
    as they are asked for to the last. A motion that slows down, or waits, asks for others, and
    begins with a single one again.
    """

    def __init__(self, motion: Played, wished: RedundancyResolution, period_s: float) -> None:
        self._motion, self._wished, self._period_s = motion, wished, period_s
        self._known, self._count = dict[float, _Expected](), 1
        self._asked = self._last = -1.0

    def at(self, time_s: float, pace: float = 1.0) -> _Expected:
        """Sample that is expected at a time [s].

        Arguments:
            pace: how fast the motion's time goes on.
        """
        if time_s not in self._known:
            self._look_up(time_s, pace)
        self._asked = time_s
        return self._known[time_s]

    def _look_up(self, time_s: float, pace: float) -> None:
        """Compute the expected samples from this time on.

        The last request's sample is kept.
        """
        self._count = min(2 * self._count, _AHEAD) if self._asked == self._last else 1
        known = {self._asked: self._known[self._asked]} if self._asked in self._known else {}
        times = list(accumulate([pace * self._period_s] * (self._count - 1), initial=time_s))
        when = np.array(times)
        samples = zip(self._motion.at(when).rows(), self._wished.at(when), strict=True)
        self._known = known | dict(zip(times, samples, strict=True))
        self._last = times[-1]


_ROUNDS, _SETTLED_RAD = 50, 1e-7
"""Rounds in which the first pose and the place of its centre of mass are found, and how near."""
_DRAWN_S = 0.1
"""Time constant with which joints come back to the posture chosen for them, where feet that feel
led them off it."""
_ASIDE_RAD = 0.2
"""A joint in the air that stays so far from its posture on its foot's path goes straight there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Target:
    """Command for one control period, and its reasons; J joints, N limbs.

    Arguments:
        targets_rad: shape (J,).
        sample: what should be at its end.
        origin_m: of the body's frame, shape (3,); the centre of mass, which should be at
            sample.com_m, is shift_m away in the body.
        angles_rad, torques_nm: planned, shape (J,).
        rolled_m: how far the feet should have rolled since they were put down, shape (N, 3).
        error_m: of the inverse kinematics, shape (N,).
        loop_share: of their stiffness, that joint loops were found to have.
    """

    targets_rad: Array
    sample: Samples
    origin_m: Array
    shift_m: Array
    angles_rad: Array
    torques_nm: Array
    rolled_m: Array
    error_m: Array
    loop_share: float = 1.0

    def entry(self) -> dict[str, Any]:
        """Record that a log keeps of it beside the command: the planned body and forces, and what
        every foot stands on.
        """
        sample = self.sample
        return {
            "origin_m": self.origin_m,
            "forces_n": sample.forces_n,
            "foothold": sample.foothold.tolist(),
            "rolled_m": self.rolled_m,
            "loop_share": self.loop_share,
        }


class Tracker:
    """Follows one motion once.

    ``start`` first, then ``next`` until it says that the motion is over.

    Arguments:
        wished: ``resolved`` of the same motion and kinematics, where it is known.
        drives: the loops that are sent to, in place of those that the kinematics' servo stands for.
        touch_downs_m: as of ``FootPlacement``.
    """

    def __init__(
        self,
        motion: Played,
        kinematics: Kinematics,
        rate_hz: float,
        feedback: ContactFeedback = ContactFeedback(),
        body: BodyFeedback = BodyFeedback(),
        wished: RedundancyResolution | None = None,
        drives: Drives | None = None,
        touch_downs_m: Array | None = None,
    ) -> None:
        self._motion, self.kinematics, self._feedback, self._period_s = (
            motion,
            kinematics,
            feedback,
            1.0 / rate_hz,
        )
        model = kinematics.model
        self._drives = drives or Drives.of(model)
        self._rolls = 0.5 * kinematics.radii_m[:, None]
        self._weight = kinematics.weight_n
        self._body = BodyController(
            kinematics.robot.mass_kg, model.inertia_kgm2, self._weight, body
        )
        self._feels_body = body.acts
        self._loops = LoopStiffness(self._drives, self._period_s, feedback.memory_s)
        self._found: tuple[State, tuple[Array, Array]] | None = None  # measured, with its loads
        self._placed: tuple[Array, Array] | None = None
        self._rates = np.zeros(len(kinematics.joints))
        limbs = len(kinematics.robot.limbs)
        self._velocity = np.zeros(6)
        self._feet = FootPlacement(
            motion.at(0.0),
            kinematics,
            feedback,
            weight_n=self._weight,
            step_s=body.step_s,
            period_s=self._period_s,
            touch_downs_m=touch_downs_m,
        )
        wished = wished or resolved(motion, kinematics)
        self._coming = _Coming(motion, wished, self._period_s)
        self._time_s, self._swing = (
            0.0,
            SwingSpeed(kinematics, self._drives.velocity_rad_s, self._period_s),
        )
        self._log = pinocchio().log3
        self._whole: tuple[bytes, Array] = b"", np.zeros((0, 0))
        self._pressed, self._rolled = np.zeros((limbs, 3)), np.zeros((limbs, 3))
        self._taken_over, self._within_s = np.zeros(len(kinematics.joints)), 0.0
        first, self._wish = self._coming.at(0.0)
        self._angles = self._wish
        self._drawn = min(1.0, self._period_s / _DRAWN_S)
        self._shift = kinematics.com_offset(self._angles)
        for _ in range(_ROUNDS):  # pose and shift depend on each other, most of all in heavy legs
            before, self._angles = self._angles, self._solved(first, self._wish)[0]
            self._shift = kinematics.com_offset(self._angles)
            if np.abs(self._angles - before).max() < _SETTLED_RAD:
                break
        self._turned = first.rotation @ kinematics.foot_frames(self._angles)

    def start(self) -> Target:
        """Pose in which the robot should be before the first period."""
        return Target(**self.begin())

    def begin(self) -> dict[str, Any]:
        """``start`` by the names of a target."""
        return self._target(*self._coming.at(0.0))

    def take_over(self, off_rad: Array, within_s: float) -> None:
        """Begin with targets that are so far off, shape (J,) [rad], as what was sent last by
        whatever else is off the first of them (bumpless transfer): less and less, and not at all
        after so long. The feet that stand meanwhile are looked after as ever.
        """
        self._taken_over, self._within_s = np.array(off_rad), within_s

    @property
    def seeks(self) -> NDArray[np.bool_]:
        """Feet that stand and are being lowered to uncertain ground that they have not met yet,
        shape (N,).
        """
        return self._feet.seeks

    @property
    def coming(self) -> Samples:
        """Sample that should be reached at the end of the next period."""
        return self._next[0]

    @property
    def _next(self) -> _Expected:
        return self._coming.at(self._time_s + self._swing.pace * self._period_s, self._swing.pace)

    def next(self, forces_n: Array, state: State | None = None) -> Target | None:
        """The target of the next period; None at the end. Arguments as of ``step``."""
        row = self.step(forces_n, state)
        return None if row is None else Target(**row)

    def step(self, forces_n: Array, state: State | None = None) -> dict[str, Any] | None:
        """The target of the next period by its names; None at the end.

        Arguments:
            forces_n: felt by the feet just now, shape (N, 3) [N].
            state: where a world measures the body's pose.
        """
        self._found = None
        if state is not None and self._feels_body:
            loads = self.kinematics.loads(state.angles_rad, state.rotation)
            self._found = state, loads
            torques = self.kinematics.torques_of(loads, forces_n)
            self._loops.see(state, torques, self._feet.touched[self.kinematics.legs])
        if self._time_s >= self._motion.duration_s:
            return None
        (now, wished), (then, wish) = self._coming.at(self._time_s), self._next
        felt = np.vecdot(forces_n, then.normals)
        lands = self._feet.seek(now, then, felt, self._swing.late) & self._feedback.waits
        seen = None
        if self._found is not None and self._placed is not None:
            seen = self._found[0], (*self._placed, self._velocity)
        self._feet.follow(now, then, felt, self._rolled, seen)
        self._press(then, forces_n, then.stands)
        if lands.any():
            return self._target(now, wished)
        self._time_s += self._swing.pace * self._period_s
        return self._target(then, wish)

    def _press(self, sample: Samples, forces_n: Array, stands: NDArray[np.bool_]) -> None:
        """Sum up what is missing of the forces with which feet press against each other; what of
        the sum would move or turn the body as a whole, as when a foot that pressed against others
        has lifted, fades out.
        """
        hangs, wanted = stands & (stands & sample.steep).any(), sample.forces_n
        sums = self._feedback.press_hz > 0.0 and hangs.any()
        if not (sums or self._pressed.any()):
            return
        feels = stands & (
            np.vecdot(forces_n, sample.normals) >= touch_n(self._weight, self._feedback.touch_n)
        )
        moving = self._moving(
            sample.arms_m, feels
        )  # a dead sensor asks for no more, and balances nothing
        if (
            self._found is not None and hangs.any()
        ):  # what is outside the cones would be summed up for ever
            wanted = self._body.planned(sample, stands)
        gap = np.where((hangs & feels)[:, None], wanted - forces_n, 0.0).ravel()
        pressed = np.where(hangs[:, None], self._pressed, FADES * self._pressed).ravel()
        pressed = pressed + self._feedback.press_hz * self._period_s * (gap - moving @ gap)
        internal = (pressed - (1.0 - FADES) * (moving @ pressed)).reshape(-1, 3)
        most = self._feedback.press_n + self._feedback.press_share * lengths(wanted)
        self._pressed = internal / max(
            1.0, float((lengths(internal) / np.maximum(most, 1e-9)).max())
        )

    def _moving(self, arms: Array, stands: NDArray[np.bool_]) -> Array:
        """The projection of forces of all feet onto those that move or turn the body as a whole,
        shape (3N, 3N); it stays while body and standing feet do.
        """
        if (key := arms[stands].tobytes() + stands.tobytes()) != self._whole[0]:
            turning = skew(arms).transpose(1, 0, 2).reshape(3, -1)
            whole = np.concatenate([np.tile(np.eye(3), len(arms)), turning]) * np.repeat(stands, 3)
            self._whole = key, np.linalg.pinv(whole) @ whole
        return self._whole[1]

    def _target(self, sample: Samples, wish: Array) -> dict[str, Any]:
        angles, error, origin = self._solved(sample, wish)
        if self._feedback.waits:
            angles = self._swing.led(self._angles, self._rates, angles, ~sample.stands)
        rotation = sample.rotation
        loads = self.kinematics.loads(angles, rotation)
        planned = self.kinematics.torques_of(loads, sample.forces_n)
        if sample.moments_nm is not None:
            planned = planned - self.kinematics.turning(angles, rotation, sample.moments_nm)
        torques = self._given(sample, loads, origin, rotation)
        rates = (angles - self._angles) / self._period_s
        rising = (rates - self._rates) / self._period_s
        torques = torques + self.kinematics.inertial_torques(angles, rates, rising)
        self._rates = rates
        shift, self._angles = self._shift, angles
        self._roll(sample, rotation @ self.kinematics.foot_frames(angles))
        self._shift = self.kinematics.com_offset(angles)
        targets = command(self._drives, angles, torques, rates, rising, self._loops.share)
        if self._time_s < self._within_s:
            targets = targets + (1.0 - smooth(self._time_s / self._within_s)) * self._taken_over
        return {
            "targets_rad": targets,
            "sample": sample,
            "origin_m": origin,
            "shift_m": shift,
            "angles_rad": angles,
            "torques_nm": planned,
            "rolled_m": self._rolled,
            "error_m": error,
            "loop_share": self._loops.share,
        }

    def _given(
        self, sample: Samples, loads: tuple[Array, Array], origin: Array, rotation: Array
    ) -> Array:
        """Torques for the planned forces, those that are missing, and those that bring the body to
        its place.
        """
        pressed = sample.forces_n + self._pressed
        placed, self._placed = self._placed, (origin, rotation)
        if self._found is None:
            torques = self.kinematics.torques_of(loads, pressed)
            if sample.moments_nm is None:
                return torques
            return torques - self.kinematics.turning(self._angles, rotation, sample.moments_nm)
        if placed is not None:
            turn = self._log(rotation @ placed[1].T)
            self._velocity = np.concatenate([origin - placed[0], turn]) / self._period_s
        pressed = np.where(self._feet.touched[:, None], pressed, 0.0)
        wanted = origin + self._feet.shift_m, rotation, self._velocity
        state, there = self._found
        seen = state.position_m, state.rotation, state.velocity
        arms = state.feet_m - state.position_m - state.rotation @ self._shift
        wrench, touched = self._body.wrench(wanted, seen), self._feet.touched
        if self.kinematics.soles:
            return self._on_soles(sample, wrench, arms, pressed, touched, state.rotation, there)
        forces = self._body.forces(wrench, sample, arms, pressed, touched)
        return self.kinematics.torques_of(there, forces)

    def _on_soles(
        self,
        sample: Samples,
        wrench: Array,
        arms: Array,
        pressed: Array,
        touched: NDArray[np.bool_],
        rotation: Array,
        loads: tuple[Array, Array],
    ) -> Array:
        """Torques for forces at the corners of the soles that touch: about the middle of a sole they
        have moments, which its ankle gives.

        Arguments:
            wrench: on the body beside its weight, world frame, shape (6,).
            arms: from the centre of mass to the middles of the soles, shape (N, 3) [m].
            pressed: planned forces, shape (N, 3) [N].
            loads: of the joints where they are.
        """
        assert self._found is not None
        kinematics, angles = self.kinematics, self._found[0].angles_rad
        offsets = kinematics.sole_offsets(angles)
        counts = [len(its) for its in offsets]
        owner = np.repeat(np.arange(len(counts)), counts)
        off = np.concatenate(offsets) @ rotation.T
        forces = self._body.at_corners(
            wrench + sample.wrench,
            sample,
            owner,
            arms[owner] + off,
            pressed[owner] / np.repeat(counts, counts)[:, None],
            touched[owner],
        )
        on_feet, moments = np.zeros_like(arms), np.zeros_like(arms)
        np.add.at(on_feet, owner, forces)
        np.add.at(moments, owner, np.cross(off, forces))
        torques = kinematics.torques_of(loads, on_feet)
        return np.asarray(torques - kinematics.turning(angles, rotation, moments))

    def _roll(self, sample: Samples, turned: Array) -> None:
        """A sphere that rolls by a small turn ω moves by ω × r n.

        Arguments:
            turned: orientations of the feet, (N, 3, 3).
        """
        between = turned @ self._turned.transpose(0, 2, 1)
        turn = between - between.transpose(0, 2, 1)  # 2 [ω]×
        moved = self._rolls * (turn @ sample.normals[:, :, None])[:, :, 0]
        stands = sample.stands[:, None]
        self._rolled = np.where(stands, self._rolled + moved, FADES * self._rolled)
        self._turned = turned

    def _solved(self, sample: Samples, wish: Array) -> tuple[Array, Array, Array]:
        """Angles, errors of the feet and the body's origin.

        Arguments:
            wish: the posture that joints are drawn to, shape (J,).
        """
        rotation = sample.rotation
        origin = sample.com_m - rotation @ self._shift
        feet = (sample.feet_m + self._rolled + self._feet.moved_m - origin) @ rotation
        near = self._angles + (wish - self._wish) + self._drawn * (wish - self._angles)
        self._wish = wish
        up = sample.normals @ rotation
        angles, error = self.kinematics.reach(feet, near, near, up)
        if (stands := sample.stands).all():
            return angles, error, origin
        air, aside = ~stands, self.kinematics.by_leg(np.abs(angles - wish)).max(axis=1)
        stuck = air & ((error > STRAY_M) | (self._feedback.waits & (aside > _ASIDE_RAD)))
        if (
            stuck.any()
        ):  # at a limit on its path, or in another posture: begin again where it should end
            other, missed = self.kinematics.reach(feet, wish, wish, up)
            straight = (error <= STRAY_M) & (missed <= STRAY_M)
            other = np.where(
                self.kinematics.of_joints(straight),
                self._angles + self._drawn * (other - self._angles),
                other,
            )
            stuck &= straight | (missed < error)
            angles, error = (
                np.where(self.kinematics.of_joints(stuck), other, angles),
                np.where(stuck, missed, error),
            )
        return angles, error, origin
