"""From a motion to joint targets, one control period after the other, with what feet feel on the way.

Only positions are sent: with q + Kp⁻¹ (τ + Kd q̇) as the target and τ = g(q) − Σ Jᵀ f, the position loop presses with
the planned contact forces f and does not lag behind. Feet are spheres and roll as their limb turns; what they roll is
added to where they are expected, or the body would be carried along. Three things close the loop, all of them by feet
that feel forces: a foot that should stand is lowered until it touches, the motion waits for that, and forces that are
not as planned are summed up into what is commanded, as far as they are internal: they balance each other and leave the
body where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array, check_numbers
from stancekit.planners.motion.joints import STRAY_M
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

from ..motion.motion import Motion, MotionSample
from ..motion.redundancy import RedundancyResolution, resolved
from ..worlds.drives import Drives
from ..worlds.world import State
from .body_feedback import BodyController, BodyFeedback, BodyPose
from .command import command
from .swing_speed import SwingSpeed

DRAWN_S = 0.1
"""Time constant with which joints come back to the posture chosen for them, where feet that feel led them off it."""
SMOOTH_HZ = 60.0
"""How fast [1/s] a foot's target goes to where the foot was found to have landed."""
EARLY = 0.05
"""A foot that comes down and feels this share of the weight has landed."""
BORNE, BORNE_S = 0.1, 0.1
"""A foot holds its place in the world, not under the body, until it has felt this share of the weight, about for this
time [s]: what bears nothing pulls no body to its place, it only slides."""
STEP = 0.2
"""Feet step aside by no more than this share of the height at which the robot stands."""
ASIDE_RAD = 0.2
"""A joint in the air that stays so far from its posture on its foot's path goes straight there."""
FADES = 0.9
"""What is left after a control period of what a foot that has lifted was lowered, rolled and pressed."""


@dataclass(frozen=True, kw_only=True)
class ContactFeedback:
    """What feet that feel do.

    touch_n: a foot that presses this hard on its patch touches it. seek_m_s, seek_m: how fast a foot that should touch
    and does not is lowered, and how far. press_hz: rate at which missing internal forces are summed, on steep surfaces
    only, 0 for never; press_n: most of them a foot. waits: the motion waits for a foot that should touch.
    """

    touch_n: float = 1.5
    seek_m_s: float = 0.02
    seek_m: float = 0.02
    press_hz: float = 4.0
    press_n: float = 40.0
    waits: bool = True

    def __post_init__(self) -> None:
        check_numbers(self, "feedback.", least=[name for name in self.__annotations__ if name != "waits"])


@dataclass(frozen=True, kw_only=True, eq=False)
class Target:
    """What is sent for one control period, and why; J joints, N limbs.

    targets_rad: shape (J,). sample: what should be at its end. origin_m: of the body's frame, shape (3,); the centre
    of mass, which should be at sample.com_m, is shift_m away in the body. angles_rad, torques_nm: planned, shape (J,).
    rolled_m: how far the feet should have rolled since they were put down, shape (N, 3). error_m: of the inverse
    kinematics, shape (N,).
    """

    targets_rad: Array
    sample: MotionSample
    origin_m: Array
    shift_m: Array
    angles_rad: Array
    torques_nm: Array
    rolled_m: Array
    error_m: Array


class Tracker:
    """Follows one motion once. ``start`` first, then ``next`` until it says that the motion is over.

    wished: ``resolved`` of the same motion and kinematics, where it is known. drives: the loops that are sent to, in
    place of those that the kinematics' servo stands for.
    """

    def __init__(
        self,
        motion: Motion,
        kinematics: Kinematics,
        rate_hz: float,
        feedback: ContactFeedback = ContactFeedback(),
        body: BodyFeedback = BodyFeedback(),
        wished: RedundancyResolution | None = None,
        drives: Drives | None = None,
    ) -> None:
        self._motion, self._kinematics, self._feedback, self._period_s = motion, kinematics, feedback, 1.0 / rate_hz
        model = kinematics.model
        self._drives = drives or Drives.of(kinematics.robot, kinematics.servo, model)
        self._weight = kinematics.robot.mass_kg * kinematics.gravity_m_s2
        self._body = BodyController(kinematics.robot.mass_kg, model.body.inertia_kgm2, self._weight, body)
        self._feels_body = body.acts
        self._found: State | None = None
        self._placed: tuple[Array, Array] | None = None
        self._rates = np.zeros(len(kinematics.joints))
        limbs = len(kinematics.robot.limbs)
        self._step_s, self._most_step = body.step_s, STEP * model.stand_height_m
        self._velocity = np.zeros(6)
        self._touched, self._landed = np.array(motion.at(0.0).foothold) >= 0, motion.at(0.0).feet_m
        self._stepped, self._moved, self._drift = (np.zeros((limbs, 3)) for _ in range(3))
        self._wished = wished or resolved(motion, kinematics)
        self._time_s, self._swing = 0.0, SwingSpeed(kinematics, self._drives.velocity_rad_s, self._period_s)
        self._borne = np.ones(limbs)
        self._depth, self._pressed, self._rolled = np.zeros(limbs), np.zeros((limbs, 3)), np.zeros((limbs, 3))
        self._angles = self._wish = self._wished.at(0.0)
        self._drawn = min(1.0, self._period_s / DRAWN_S)
        self._shift = kinematics.com_offset(self._angles)
        for _ in range(3):  # the pose and the shift of the centre of mass depend on each other
            self._angles = self._solved(motion.at(0.0))[0]
            self._shift = kinematics.com_offset(self._angles)
        self._turned = rotation_of(motion.at(0.0).rotation_rad) @ kinematics.foot_frames(self._angles)

    def start(self) -> Target:
        """Where the robot should be before the first period."""
        return self._target(self._motion.at(0.0))

    @property
    def coming(self) -> MotionSample:
        """What should be at the end of the next period."""
        return self._motion.at(self._time_s + self._swing.pace * self._period_s)

    def next(self, forces_n: Array, state: State | None = None) -> Target | None:
        """The target of the next period; None at the end.

        forces_n: felt by the feet just now, shape (N, 3) [N]. state: where a world measures the body's pose.
        """
        self._found = state if self._feels_body else None
        if self._time_s >= self._motion.seconds:
            return None
        now, then = self._motion.at(self._time_s), self.coming
        felt, wanted = (np.einsum("ij,ij->i", forces, then.normals) for forces in (forces_n, then.forces_n))
        stands, lands = np.array(then.foothold) >= 0, np.array(now.foothold) < 0
        late = lands & stands & self._swing.late & self._feedback.waits
        missing = stands & ~late & (lands | (wanted > 4.0 * self._feedback.touch_n))
        missing &= (felt < self._feedback.touch_n) & (self._depth < self._feedback.seek_m)
        landing = missing & lands & self._feedback.waits
        self._depth = np.where(missing, self._depth + self._feedback.seek_m_s * self._period_s, self._depth)
        self._depth = np.where(stands, self._depth, FADES * self._depth)
        self._anchor(now, then, felt)
        self._press(then, forces_n, stands)
        if landing.any() or late.any():
            return self._target(now)
        self._time_s += self._swing.pace * self._period_s
        return self._target(then)

    def _anchor(self, now: MotionSample, then: MotionSample, felt: Array) -> None:
        """Where the body is measured, feet that have landed, early or late, stay where they are, and not where they
        should have landed; those that are late are lowered, and those in the air go to their places in the world, or
        step to where the body falls. What is commanded moves there smoothly."""
        found, before, stands = self._found, self._touched, np.array(then.foothold) >= 0
        self._touched, goal = stands, np.zeros_like(self._moved)
        if found is not None:
            comes = np.einsum("ij,ij->i", then.feet_m - now.feet_m, then.normals) < 0.0
            early = comes & (felt >= EARLY * self._weight)
            self._touched = (stands & (before | (felt >= self._feedback.touch_n))) | (
                ~stands & comes & (before | early)
            )
            feet = found.position_m + self._kinematics.feet(found.angles_rad) @ found.rotation.T
            landed = self._touched & ~before
            self._landed = np.where(landed[:, None], feet - self._rolled, self._landed)
            self._depth = np.where(landed, 0.0, self._depth)
            self._stepped = np.where((stands | self._touched)[:, None], self._stepped, self._step(found, then))
            placed = np.where(self._touched[:, None], self._landed, then.feet_m + self._stepped)
            self._bear(felt)
            free = 0.0 if self._step_s > 0.0 else 1.0 - self._borne[:, None]
            goal = placed + free * self._carried(found, placed) - then.feet_m
        away = goal - self._depth[:, None] * then.normals - self._moved
        turns = SMOOTH_HZ * self._period_s  # ẍ = ω² (goal − x) − 2 ω ẋ over a period, exactly: whatever ω T is
        coming, left = self._drift - SMOOTH_HZ * away, np.exp(-turns)
        self._moved = self._moved + away - left * (away - self._period_s * coming)
        self._drift = left * (self._drift - turns * coming)

    def _bear(self, felt: Array) -> None:
        """How far every foot that touches has come to bear, from 0 to 1."""
        gone = np.clip(felt / (BORNE * self._weight), 0.0, 1.0) - self._borne
        self._borne = np.where(self._touched, self._borne + gone * self._period_s / BORNE_S, 0.0)

    def _carried(self, found: State, feet_m: Array) -> Array:
        """From places of feet to those that they have for a body that is taken to be where it should be, (N, 3) [m]."""
        if self._placed is None:
            return np.zeros_like(feet_m)
        origin, rotation = self._placed
        return np.asarray(origin + (feet_m - found.position_m) @ found.rotation @ rotation.T - feet_m)

    def _step(self, found: State, sample: MotionSample) -> Array:
        """How far feet step aside, along their surfaces, for a body that moves otherwise than planned, (N, 3) [m]."""
        late = self._step_s * (found.velocity[:3] - self._velocity[:3])
        late = late * min(1.0, self._most_step / max(float(np.linalg.norm(late)), 1e-9))
        return np.asarray(late - (sample.normals @ late)[:, None] * sample.normals)

    def _press(self, sample: MotionSample, forces_n: Array, stands: NDArray[np.bool_]) -> None:
        """Sum up what is missing of the forces with which feet press against each other; what of the sum would move or
        turn the body as a whole, as when a foot that pressed against others has lifted, fades out."""
        arms = sample.feet_m - sample.com_m
        maps = [np.concatenate([np.eye(3), _skew(arm)]) for arm in arms]
        whole = np.concatenate(maps, axis=1) * np.repeat(stands, 3)
        moving = np.linalg.pinv(whole) @ whole
        wanted = sample.forces_n
        if self._found is not None:  # what the plan has outside the cones is not given: it would be summed up for ever
            wanted = self._body.forces(np.zeros(6), sample, arms, wanted, stands)
        hangs = stands & (stands & sample.steep).any()
        gap = np.where(hangs[:, None], wanted - forces_n, 0.0).ravel()
        pressed = np.where(hangs[:, None], self._pressed, FADES * self._pressed).ravel()
        pressed = pressed + self._feedback.press_hz * self._period_s * (gap - moving @ gap)
        pressed = (pressed - (1.0 - FADES) * (moving @ pressed)).reshape(-1, 3)
        most = float(np.linalg.norm(pressed, axis=1).max())
        self._pressed = pressed * min(1.0, self._feedback.press_n / max(most, 1e-9))

    def _target(self, sample: MotionSample) -> Target:
        angles, error, origin = self._solved(sample)
        if self._feedback.waits:
            angles = self._swing.led(self._angles, self._rates, angles, np.array(sample.foothold) < 0)
        rotation = rotation_of(sample.rotation_rad)
        loads = self._kinematics.loads(angles, rotation)
        planned = self._kinematics.torques_of(loads, sample.forces_n)
        given = self._given(sample, loads, origin, rotation)
        rates = (angles - self._angles) / self._period_s
        rising = (rates - self._rates) / self._period_s
        given = given + self._kinematics.inertial_torques(angles, rates, rising)
        self._rates = rates
        shift, self._angles = self._shift, angles
        self._roll(sample, rotation @ self._kinematics.foot_frames(angles))
        self._shift = self._kinematics.com_offset(angles)
        return Target(
            targets_rad=command(self._drives, angles, given, rates, rising), sample=sample, origin_m=origin,
            shift_m=shift, angles_rad=angles, torques_nm=planned, rolled_m=self._rolled, error_m=error,
        )  # fmt: skip

    def _given(self, sample: MotionSample, loads: tuple[Array, Array], origin: Array, rotation: Array) -> Array:
        """Torques for the planned forces, those that are missing, and those that bring the body to its place."""
        found = self._found
        pressed = sample.forces_n + self._pressed
        placed, self._placed = self._placed, (origin, rotation)
        if found is None:
            return self._kinematics.torques_of(loads, pressed)
        if placed is not None:
            turn = Rotation.from_matrix(rotation @ placed[1].T).as_rotvec()
            self._velocity = np.concatenate([origin - placed[0], turn]) / self._period_s
        pressed = np.where(self._touched[:, None], pressed, 0.0)
        wanted = BodyPose(origin_m=origin, rotation=rotation, velocity=self._velocity)
        seen = BodyPose(origin_m=found.position_m, rotation=found.rotation, velocity=found.velocity)
        arms = found.feet_m - found.position_m - found.rotation @ self._shift
        forces = self._body.forces(self._body.wrench(wanted, seen), sample, arms, pressed, self._touched)
        return self._kinematics.torques(found.angles_rad, found.rotation, forces)

    def _roll(self, sample: MotionSample, turned: Array) -> None:
        """A sphere that rolls by a small turn ω moves by ω × r n. turned: orientations of the feet, (N, 3, 3)."""
        between = turned @ self._turned.transpose(0, 2, 1)
        turn = 0.5 * (between - between.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
        moved = self._kinematics.radii_m[:, None] * np.cross(turn, sample.normals)
        stands = np.array(sample.foothold)[:, None] >= 0
        self._rolled = np.where(stands, self._rolled + moved, FADES * self._rolled)
        self._turned = turned

    def _of(self, legs: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The same of their joints."""
        return np.asarray(self._kinematics.of_joints(legs.astype(np.float64)) > 0.0)

    def _solved(self, sample: MotionSample) -> tuple[Array, Array, Array]:
        """Angles, errors of the feet and the body's origin."""
        rotation = rotation_of(sample.rotation_rad)
        origin = sample.com_m - rotation @ self._shift
        wish = self._wished.at(self._time_s)
        feet = (sample.feet_m + self._rolled + self._moved - origin) @ rotation
        near = self._angles + (wish - self._wish) + self._drawn * (wish - self._angles)
        self._wish = wish
        angles, error = self._kinematics.reach(feet, near, near)
        air, aside = np.array(sample.foothold) < 0, self._kinematics.by_leg(np.abs(angles - wish)).max(axis=1)
        stuck = air & ((error > STRAY_M) | (self._feedback.waits & (aside > ASIDE_RAD)))
        if stuck.any():  # at a limit on its path, or in another posture: begin again where it should end
            other, missed = self._kinematics.reach(feet, wish, wish)
            straight = (error <= STRAY_M) & (missed <= STRAY_M)
            other = np.where(self._of(straight), self._angles + self._drawn * (other - self._angles), other)
            stuck &= straight | (missed < error)
            angles, error = np.where(self._of(stuck), other, angles), np.where(stuck, missed, error)
        return angles, error, origin


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
