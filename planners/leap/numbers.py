"""A leap for one timing as numbers: what its programs are loaded with, on the layout of postures
and courses.

Frames are instants: the ends of the M intervals and their middles, 2M + 1 in all. A stance is an
interval in which some limb stands, at the frame of its middle. Lengths are in metres, forces in
units of the weight, momenta per mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout
from ..equilibrium.scaled import HalfSpaces, Scaled
from ..equilibrium.terms import Given
from ..files.arrays import Array, cross
from ..physics import GRAVITY_M_S2
from ..problem.leap import Leap
from ..robot.model import LegLimits

FREE_M = 10.0
"""A radius that confines nothing [m]."""
_UNLIMITED = 1e3
"""In place of a speed or a power that is not limited."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapPoint:
    """A motion and its forces, as a program is linearised about it and as it answers.

    Arguments:
        com, rotation: at the frames, shape (2M + 1, 3).
        velocity, momentum: at the ends of intervals, shape (M + 1, 3).
        toes: shape (P, 3).
        forces: in the world in units of the weight, one per stance contact, shape (B, 3).
    """

    com: Array
    rotation: Array
    velocity: Array
    momentum: Array
    toes: Array
    forces: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapNumbers:
    """A leap of one timing in numbers.

    Arguments:
        scaled: patches, limbs and limits by the rows of the layout, every candidate open.
        lasts: of the intervals, shape (M,) [s].
        spin: J⁻¹ of the inertia per mass, shape (3, 3).
        hips: shape (N, 3).
        speed, power, fold: by limb, power in units of the weight times m/s.
        start, velocity, momentum: c, Θ (2, 3) and v, L at the start and at the end (2, 3).
        legs_turn: what legs that swing turn the body by, shape (M, 3) [rad].
        spins: J⁻¹ in every interval, whose legs are drawn up or not, shape (M, 3, 3).
    """

    leap: Leap
    timing: int
    scaled: Scaled
    lasts: Array
    spin: Array
    hips: Array
    speed: Array
    power: Array
    fold: Array
    start: Array
    velocity: Array
    momentum: Array
    legs_turn: Array
    spins: Array

    @classmethod
    def of(
        cls,
        leap: Leap,
        timing: int = 0,
        *,
        legs_turn: Array | None = None,
        spins: Array | None = None,
    ) -> LeapNumbers:
        """The numbers of a leap for one of its timings.

        Arguments:
            legs_turn: 0 where it is not said.
            spins: those of a rigid body.
        """
        times, robot = leap.times_s(timing), leap.robot
        legs: list[LegLimits] = [leap.leg(limb) for limb in robot.limbs]
        inertia = robot.inertia
        assert inertia is not None
        spin = np.asarray(np.linalg.inv(inertia / robot.mass_kg), dtype=np.float64)
        return cls(
            leap=leap,
            timing=timing,
            scaled=_scaled(leap),
            lasts=np.diff(times),
            spin=spin,
            hips=np.array([leg.hip_m for leg in legs]),
            speed=np.minimum([leg.speed_m_s for leg in legs], _UNLIMITED),
            power=np.minimum(np.array([leg.power_w for leg in legs]) / leap.weight_n, _UNLIMITED),
            fold=np.array([leg.fold_m for leg in legs]),
            start=np.array([leap.start.com_m, leap.start.rotation_rad]),
            velocity=np.array([leap.start.velocity_m_s, leap.goal.velocity_m_s]),
            momentum=np.array([leap.start.momentum_m2_s, leap.goal.momentum_m2_s]),
            legs_turn=np.zeros((leap.intervals, 3)) if legs_turn is None else legs_turn,
            spins=np.tile(spin, (leap.intervals, 1, 1)) if spins is None else spins,
        )

    @property
    def layout(self) -> Layout:
        """Layout of every candidate."""
        return self.scaled.layout

    @property
    def intervals(self) -> int:
        """M."""
        return len(self.lasts)

    @cached_property
    def times(self) -> Array:
        """Times of the frames, shape (2M + 1,) [s]."""
        ends = np.concatenate([[0.0], np.cumsum(self.lasts)])
        times = np.zeros(2 * self.intervals + 1)
        times[::2], times[1::2] = ends, 0.5 * (ends[1:] + ends[:-1])
        return times

    @cached_property
    def stance_intervals(self) -> Index:
        """The interval of every stance, shape (S,)."""
        return np.asarray(self.layout.stance_frames // 2)

    @cached_property
    def contact_intervals(self) -> Index:
        """The interval of every stance contact, shape (B,)."""
        return np.asarray(self.stance_intervals[self.layout.contacts[0]])

    def total(self, forces: Array) -> Array:
        """F, the sum of the forces in every interval, shape (M, 3).

        Arguments:
            forces: of the stance contacts, shape (B, 3).
        """
        total = np.zeros((self.intervals, 3))
        np.add.at(total, self.contact_intervals, forces)
        return total

    @cached_property
    def nominal(self) -> LeapPoint:
        """The motion of least forces beside the weight that gets there, whatever the toes; toes are
        at no place.
        """
        standing = np.unique(self.stance_intervals)
        weight = self._weights(np.array([self.times[-1]]))[0][standing]  # of F on c at the end
        rows = [GRAVITY_M_S2 * weight, GRAVITY_M_S2 * self.lasts[standing]]
        end, at = self.times[-1], len(standing)
        fall = np.array([0.0, 0.0, -GRAVITY_M_S2])
        carried = np.array([0.0, 0.0, 1.0])
        right = [
            self.leap.goal.com_m - self.start[0] - end * self.velocity[0] - 0.5 * end**2 * fall,
            self.velocity[1] - self.velocity[0] - end * fall,
        ]
        for still, k in zip(self.leap.still, (0, at - 1), strict=True):
            if still:
                rows.append(np.eye(at)[k])
                right.append(carried)
        matrix, target = np.array(rows), np.array(right)
        forces = (
            carried
            + np.linalg.lstsq(matrix, target - matrix.sum(axis=1)[:, None] * carried, rcond=None)[0]
        )
        total = np.zeros((self.intervals, 3))
        total[standing] = forces
        count = np.bincount(self.layout.contacts[0], minlength=len(self.layout.stances))
        per_contact = total[self.contact_intervals] / count[self.layout.contacts[0]][:, None]
        com, velocity = self.ballistic(total)
        zeros = np.zeros((self.intervals + 1, 3))
        return LeapPoint(
            com=com,
            rotation=np.zeros_like(com),
            velocity=velocity,
            momentum=zeros,
            toes=np.zeros((self.layout.footholds, 3)),
            forces=per_contact,
        )

    def _weights(self, times: Array) -> Array:
        """∫ (T − t) dt over the part of each interval before T, which c at T has of g F; shape (·,
        M) [s²].
        """
        left = np.maximum(times[:, None] - self.times[:-1:2], 0.0)
        after = np.maximum(times[:, None] - self.times[2::2], 0.0)
        return np.asarray(0.5 * (left**2 - after**2))

    @cached_property
    def fallen(self) -> Array:
        """Share that c at every frame has of g F of every interval, shape (2M + 1, M) [s²]."""
        return self._weights(self.times)

    def ballistic(self, total: Array) -> tuple[Array, Array]:
        """c at the frames, (2M + 1, 3), and v at the ends of intervals, (M + 1, 3), for forces F,
        shape (M, 3).
        """
        push = GRAVITY_M_S2 * (total - np.array([0.0, 0.0, 1.0]))
        com = self.start[0] + self.times[:, None] * self.velocity[0] + self.fallen @ push
        moved = np.concatenate([np.zeros((1, 3)), np.cumsum(self.lasts[:, None] * push, axis=0)])
        return com, self.velocity[0] + moved

    def means(self, com: Array, velocity: Array) -> Array:
        """c̄ = (c + c′)/2 − dt (v′ − v)/12, the mean of c over every interval, shape (M, 3)."""
        ends = com[::2]
        return np.asarray(
            0.5 * (ends[1:] + ends[:-1]) - self.lasts[:, None] / 12.0 * np.diff(velocity, axis=0)
        )

    def turned(self, point: LeapPoint) -> tuple[Array, Array]:
        """(L′ − L, Θ′ − Θ) of every interval as the forces of a point give them, with its L at the
        ends, (M, 3) each.

        Exact for forces that are constant in an interval: ∫ L dt = dt (L + L′)/2 + g dt³/24 (v +
        v′) × F.
        """
        means = self.means(point.com, point.velocity)
        arms = point.toes[self.layout.contacts[2]] - means[self.contact_intervals]
        change = GRAVITY_M_S2 * self.lasts[:, None] * self.total(cross(arms, point.forces))
        sums = point.velocity[1:] + point.velocity[:-1]
        bend = (
            self.lasts[:, None] ** 3 * GRAVITY_M_S2 / 24.0 * cross(sums, self.total(point.forces))
        )
        mean = 0.5 * self.lasts[:, None] * (point.momentum[1:] + point.momentum[:-1])
        turned = np.matmul(self.spins, (mean + bend)[..., None])[..., 0]
        return change, np.asarray(turned + self.legs_turn)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointRows:
    """Joints of the legs that stand, linear about a motion that was judged, for both halves of the
    interval of every stance contact, first halves first, each where the joint has least left in it;
    2B of them, n joints per leg.

    Of speeds and torques as shares of their limits.

    Arguments:
        faster, spinning: derivatives of a speed's in v and in L, stronger: of a torque's in the
            force, in its contact frame and units of the weight, shape (2B, n, 3) each.
        speed_placed, torque_placed: derivatives of both in p − c, as a leg bends, shape (2B, n, 3)
            each.
        speed_rest, torque_rest: what is left of both without these, shape (2B, n).
        share: allowed.
    """

    faster: Array
    spinning: Array
    stronger: Array
    speed_placed: Array
    torque_placed: Array
    speed_rest: Array
    torque_rest: Array
    share: float

    def over(self, given: LeapGiven) -> tuple[Array, Array]:
        """Excess of the worst row of every joint over the share at the point of ``given``, ahead
        and back, shape (2B, n) each.
        """
        point, at = given.point, given.numbers.contact_intervals
        node = np.concatenate([at, at + 1])
        frames = np.concatenate([given.scaled.contact_frames] * 2)
        forces = np.matmul(frames.transpose(0, 2, 1), np.concatenate([point.forces] * 2)[..., None])
        speed = np.matmul(self.faster, point.velocity[node][..., None])
        speed += np.matmul(self.spinning, point.momentum[node][..., None])
        foothold = np.concatenate([given.scaled.layout.contacts[2]] * 2)
        away = (point.toes[foothold] - point.com[2 * node])[..., None]
        speed += np.matmul(self.speed_placed, away)
        fast = speed[..., 0] + self.speed_rest
        strong = np.matmul(self.stronger, forces) + np.matmul(self.torque_placed, away)
        strong = strong[..., 0] + self.torque_rest
        ahead = np.maximum(strong, np.maximum(fast, fast + strong)) - self.share
        back = np.maximum(-strong, np.maximum(-fast, -fast - strong)) - self.share
        return ahead, back


@dataclass(frozen=True, eq=False)
class LeapGiven(Given):
    """Data that a leap's program is loaded with: the chosen problem in ``scaled``, its leap and
    where it is linearised.

    Arguments:
        reserve_m: kept of heights and lengths.
        toe_radius: how far toes may be from those of the point [m].
        joints: rows of the joints, where legs were judged.
    """

    loaded_numbers: LeapNumbers | None = None
    at: LeapPoint | None = None
    reserve_m: float = 0.0
    toe_radius: float = FREE_M
    joints: JointRows | None = None

    @property
    def joint_rows(self) -> JointRows:
        """``joints``, which is there."""
        assert self.joints is not None
        return self.joints

    @property
    def numbers(self) -> LeapNumbers:
        """``loaded_numbers``, which are there."""
        assert self.loaded_numbers is not None
        return self.loaded_numbers

    @property
    def point(self) -> LeapPoint:
        """``at``, which is there."""
        assert self.at is not None
        return self.at

    @cached_property
    def legs(self) -> tuple[Array, Array, Array]:
        """ê, J⁻ᵀ(h × ê) and h × ê of every limb that stands at a frame, of the point; h the turned
        hip; (T, 3) each.
        """
        frame, limb, foothold = self.scaled.layout.standing
        hips = self.numbers.hips[limb]
        hips = hips + cross(self.point.rotation[frame], hips)
        leg = self.point.com[frame] + hips - self.point.toes[foothold]
        along = leg / np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
        turn = cross(hips, along)
        return along, turn @ self.numbers.spin, turn

    @cached_property
    def hip_velocities(self) -> Array:
        """v + ω × h at both ends of the interval of every stance contact, first ends first, shape
        (2B, 3).
        """
        limb, at = self.scaled.layout.contacts[1], self.numbers.contact_intervals
        node = np.concatenate([at, at + 1])
        spin = self.point.momentum[node] @ self.numbers.spin.T
        hips = self.numbers.hips[np.concatenate([limb, limb])]
        return np.asarray(self.point.velocity[node] + cross(spin, hips))

    @cached_property
    def powers(self) -> tuple[Array, Array, Array, Array]:
        """f̂ in the world, J⁻ᵀ(h × f̂), Rᵀ v̂ in contact frames, and f̂·v̂, at both ends of every
        contact's interval.
        """
        limb = self.scaled.layout.contacts[1]
        forces = np.concatenate([self.point.forces] * 2)
        hips = self.numbers.hips[np.concatenate([limb, limb])]
        frames = np.concatenate([self.scaled.contact_frames] * 2)
        turned = np.matmul(frames.transpose(0, 2, 1), self.hip_velocities[..., None])[..., 0]
        power = np.sum(forces * self.hip_velocities, axis=1)
        return forces, cross(hips, forces) @ self.numbers.spin, turned, power

    @cached_property
    def planes(self) -> tuple[Array, Array, Array]:
        """a + Θ̂ × a, a × d̂, and Θ̂·(a × d̂), d̂ = p̂ − ĉ, of every half-space that holds
        somewhere.
        """
        (frame, _, foothold), (which, half) = (
            self.scaled.layout.standing,
            self.scaled.layout.standing_rows,
        )
        point, normals = self.point, self.scaled.half_spaces.normals[half]
        turn = point.rotation[frame][which]
        lever = cross(normals, (point.toes[foothold] - point.com[frame])[which])
        return normals + cross(turn, normals), lever, np.sum(turn * lever, axis=1)


def _scaled(leap: Leap) -> Scaled:
    """Every candidate of a leap by the rows of its layout; what only courses have is empty."""
    robot, limits, phases = leap.robot, leap.limits, leap.interval_phases
    nodes = len(phases) + 1
    by_interval = leap.holds[phases]
    holds = np.full((2 * nodes - 1, len(robot.limbs)), -1)
    holds[1::2] = by_interval
    holds[2::2] = by_interval
    holds[:-1:2] = np.where(by_interval >= 0, by_interval, holds[:-1:2])
    stances = tuple(
        (2 * k + 1, tuple(np.flatnonzero(row >= 0).tolist()))
        for k, row in enumerate(by_interval)
        if (row >= 0).any()
    )
    footholds = leap.footholds
    patches = [patch for foothold in footholds for patch in foothold.candidates]
    borders = [
        patch.vertices_m if foothold.toe_m is None else foothold.toe_m[None]
        for foothold in footholds
        for patch in foothold.candidates
    ]
    sizes = iter(len(border) for border in borders)
    layout = Layout(
        holds=tuple(tuple(row) for row in holds.tolist()),
        stances=stances,
        corners=tuple(tuple(next(sizes) for _ in foothold.candidates) for foothold in footholds),
        reach_rows=HalfSpaces.counts(robot.limbs),
    )
    most = np.full((len(layout.contacts[0]), 3), limits.force_share)
    most[:, 0] = _largest(leap, layout)
    return Scaled(
        layout=layout,
        options=max(len(foothold.candidates) for foothold in footholds),
        which=tuple(tuple(range(len(foothold.candidates))) for foothold in footholds),
        vertices=np.concatenate(borders),
        frames=np.array([patch.frame for patch in patches]),
        friction=np.array([patch.friction for patch in patches]),
        shoulders=np.array([limb.shoulder_m for limb in robot.limbs]),
        reach=np.array([limb.reach_m for limb in robot.limbs]),
        force_min=np.concatenate([np.zeros((len(most), 1)), -most[:, 1:]], axis=1),
        force_max=most,
        weight=1.0,
        com=np.tile(leap.goal.com_m, (layout.frames, 1)),
        com_radius=np.append(np.full(layout.frames - 1, FREE_M), leap.goal_radius_m),
        tilt=limits.tilt_rad,
        steps=(FREE_M, FREE_M, FREE_M),
        direction=np.zeros((layout.frames - 1, 3)),
        progress=np.zeros(layout.frames - 1),
        goal=leap.goal.com_m,
        weights=None,
        length_m=1.0,
        force_n=leap.weight_n,
        half_spaces=HalfSpaces.of(robot.limbs, 1.0, limits.tilt_rad),
    )


def _largest(leap: Leap, layout: Layout) -> Array:
    """The largest normal force of every stance contact, shape (B,): less just after a toe lands and
    before it lifts.
    """
    stance, limb, _ = layout.contacts
    interval = layout.stance_frames[stance] // 2
    by_interval = leap.holds[leap.interval_phases]
    before = np.concatenate([by_interval[:1], by_interval[:-1]])[interval, limb] < 0
    after = np.concatenate([by_interval[1:], by_interval[-1:]])[interval, limb] < 0
    return leap.limits.most(before, after)
