"""Inverse kinematics and joint torques of a robot's legs (extra ``robots``: pinocchio on the URDF
of ``Robot.legs``).

Arrays of joints are in the model's order. Feet are found by damped least squares, all legs at once,
inside the joint limits. Legs that are drawn up begin at closed-form postures and their free joint
is drawn towards a comfortable one; a robot's own legs begin at postures whose feet are near.
Torques are those of a robot that stands still.

A leg that is drawn up has one joint more than a foot's position needs: the knee can turn around the
line from shoulder to foot. This family of postures, in closed form, is where it begins and what it
is drawn to; it is never believed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import cached_property
from ..files.arrays import Array, lengths, read_only
from ..physics import GRAVITY_M_S2
from ..terrain.patch import Solid, Solids
from .inverse_kinematics import EXACT_M, REACHED_M, InverseKinematics, stepped
from .leg import JOINTS, USUAL_REACH_M, Mount, Servo, levelled, rotation_of
from .model import Limb, Robot
from .robot_model import resisting_nm
from .urdf_reader import at_rest, base_joint, pinocchio

__all__ = ["REACHED_M", "Kinematics", "pinocchio", "rotation_of"]

DAMPING, _STEPS, _LONGEST_STEP_RAD = 1e-4, 60, 0.3
_DRAWN_AT = 0.2
"""In pictures the roll joint of a leg that is drawn up is so far along its thigh."""


class Kinematics:
    """The robot's legs as pinocchio knows them, the base fixed; not for several threads at once.

    joints: names, J of them. radii_m: of the feet, shape (N,). lower_rad, upper_rad, torque_nm,
    velocity_rad_s: limits of the joints, shape (J,); torque is inf where the robot's own file has
    none that can be believed, velocity 0 where it has none. rotor_kg_m2: inertia of every joint's
    rotor, behind its gears, shape (J,). legs: the number of the leg of every joint, shape (J,).
    known: pinocchio's model; columns: where it has the joints' velocities, shape (J,); base,
    base_moves: where it has those of the base. soles: whether a foot is one. near_rad: posture of a
    robot that is already somewhere, at which motions begin, shape (J,); None elsewhere. Raises
    InvalidInput where pinocchio is not installed, and for a robot whose legs are not known.
    """

    def __init__(
        self,
        robot: Robot,
        servo: Servo | None = None,
        *,
        gravity_m_s2: float = GRAVITY_M_S2,
        near_rad: Array | None = None,
    ) -> None:
        self.near_rad = None if near_rad is None else np.array(near_rad, dtype=float)
        self.robot, self.servo, self.gravity_m_s2 = robot, servo or robot.servo, gravity_m_s2
        self.weight_n = robot.mass_kg * gravity_m_s2
        self.model = robot.legs_with(self.servo)
        self._pin = pin = pinocchio()
        legs, joints = self.model.legs, [joint for leg in self.model.legs for joint in leg.joints]
        self.joints, self.radii_m = self.model.joint_names, robot.foot_radii_m
        self.soles = any(leg.sole is not None for leg in legs)
        self.rotor_kg_m2 = self.model.rotors_kg_m2
        names = ("lower_rad", "upper_rad", "torque_nm", "velocity_rad_s")
        self.lower_rad, self.upper_rad, self.torque_nm, self.velocity_rad_s = (
            np.array([getattr(joint, name) for joint in joints]) for name in names
        )
        self.torque_nm[np.isin(self.joints, [name for name, _ in self.model.torque_doubts])] = (
            np.inf
        )
        self._free = np.concatenate([leg.turns for leg in legs])
        self.lowest_rad = np.where(self._free, -np.inf, self.lower_rad)
        self.highest_rad = np.where(self._free, np.inf, self.upper_rad)
        self.legs = np.repeat(np.arange(len(legs)), [len(leg.joints) for leg in legs])
        self._nth = np.concatenate([np.arange(len(leg.joints)) for leg in legs])
        self._most = int(self._nth.max()) + 1
        self.known = self.model.built.copy()
        self._number = [self.known.getJointId(name) for name in self.joints]
        self._feet = [
            self.known.addFrame(
                pin.Frame(
                    f"{leg.name}: foot",
                    self.known.getJointId(leg.joint_names[-1]),
                    pin.SE3(self.model.mounts[leg.foot].rotation, np.array(leg.chain.tip_m)),
                    pin.FrameType.OP_FRAME,
                )
            )
            for leg in legs
        ]
        self._data, self._masses = self.known.createData(), self.known.createData()
        self._at = self._set = b""
        self._down = np.array([0.0, 0.0, -gravity_m_s2])
        self._rest, rows, self.columns = self._places()
        base = self.known.joints[base_joint(self.known)]
        self.base, self.base_moves = (
            slice(k, k + n) for k, n in ((base.idx_q, 7), (base.idx_v, 6))
        )
        self._q, self._centres = self._rest, np.zeros((len(legs), 3))
        self._row, self._column = _slice_or(rows), _slice_or(self.columns)
        # pinocchio's own memory, which changes with each sweep: nothing is fetched anew
        self._spatial = self._data.J.T
        self._feet_of, self._turning = _factors(self.legs, 3), 3 + _factors(self.columns, 6)[::-1]
        self._middles = [self._data.oMf[foot].translation for foot in self._feet]
        self._turns = [self._data.oMf[foot].rotation for foot in self._feet]
        soles = [leg.sole for leg in legs]
        self._sole_radii = np.array([0.0 if sole is None else sole.radius_m for sole in soles])
        self._sole_axes = np.array(
            [
                np.eye(3)
                if sole is None
                else self.model.mounts[leg.foot].rotation.T @ sole.rotation
                for leg, sole in zip(legs, soles, strict=True)
            ]
        )
        self._even = bool(np.all(np.bincount(self.legs) == self._most))

    def _places(self) -> tuple[Array, NDArray[np.int_], NDArray[np.int_]]:
        """The base at the origin and all else at rest; where pinocchio has the angles and the
        velocities of joints.
        """
        owners = [self.known.joints[number] for number in self._number]
        circles = [(joint.idx_q, i) for i, joint in enumerate(owners) if joint.nq == 2]
        self._circles = np.array(circles, dtype=int).reshape(-1, 2)
        rows, columns = (
            np.array([getattr(joint, name) for joint in owners]) for name in ("idx_q", "idx_v")
        )
        return at_rest(self.known), rows, columns

    def configuration(self, angles: Array) -> Array:
        """Angles as pinocchio has them."""
        return self._configured(angles).copy()

    def carried(self, rotation: Array, origin_m: Array) -> Any:
        """The joint that carries the base, as pinocchio has it, where the base's frame is at a place."""
        return self._pin.SE3(rotation, origin_m) * self._pin.XYZQUATToSE3(self._rest[self.base])

    def turned_rad(self, angles: Array) -> Array:
        """Turns of the joints between rows of angles, the shorter way where a joint turns freely,
        shape (K − 1, J) [rad, or m where one slides].
        """
        turns = np.diff(angles, axis=0)
        short = np.mod(turns + np.pi, 2.0 * np.pi) - np.pi
        return np.asarray(np.where(self._free, short, turns))

    def _configured(self, angles: ArrayLike) -> Array:
        """Configuration of pinocchio for these angles, read-only; the posture that was asked for
        last is not looked up again.
        """
        angles = np.asarray(angles, dtype=np.float64)
        if (key := angles.tobytes()) == self._set:
            return self._q
        q = self._rest.copy()
        q[self._row] = angles
        if len(self._circles):
            rows, joints = self._circles.T
            q[rows], q[rows + 1] = np.cos(angles[joints]), np.sin(angles[joints])
        self._q, self._set = q, key
        return q

    @property
    def drawn(self) -> bool:
        """Tell whether its legs are drawn up: four joints each, whose postures have a closed
        form.
        """
        return self.model.servo is not None

    def resistance(self, rates_rad_s: Array) -> Array:
        """Torque of damping and dry friction of the joints, shape (…, J) [Nm]."""
        return resisting_nm(*self.model.resistance, rates_rad_s)

    def joints_of(self, leg: int) -> NDArray[np.int_]:
        """Numbers of a leg's joints, from the base outward."""
        return np.flatnonzero(self.legs == leg)

    def by_leg(self, values: ArrayLike) -> Array:
        """Numbers of all joints leg by leg, shape (J,) to (N, n), n of the leg with most; zeros
        behind the others'.
        """
        if self._even:
            return np.asarray(values, dtype=np.float64).reshape(-1, self._most)
        table = np.zeros((len(self._feet), self._most))
        table[self.legs, self._nth] = values
        return table

    def of_joints(self, values: Array | NDArray[np.bool_]) -> Array:
        """Numbers of every leg, shape (N,), as those of its joints, shape (J,)."""
        return np.asarray(values[self.legs])

    def solve(
        self,
        com_m: ArrayLike,
        rotation_rad: ArrayLike,
        toes_m: ArrayLike,
        *,
        normals: ArrayLike | None = None,
        seed: ArrayLike | None = None,
        obstacles: Sequence[Solid] = (),
        most_rad: ArrayLike = np.inf,
    ) -> tuple[Array, Array, Array]:
        """Angles within the joints' limits for a body pose and toes in the world, shape (J,) [rad],
        the distance of every foot from its target, shape (N,) [m], and how far beyond its limits
        the worst joint of a limb would have to go to get there, shape (N,) [rad].

        Arguments:
            com_m: the body's origin, shape (3,) [m].
            rotation_rad: rotation vector of the body, taken exactly, shape (3,) [rad].
            toes_m: contact points of the limbs, shape (N, 3) [m].
            normals: normals of the surfaces, shape (N, 3): the foot's centre is a radius away along
                them, and a sole flat on them; without them it is at the toe, and a sole level.
            seed: angles to stay close to, shape (J,).
            obstacles: solids that the links of drawn-up legs should keep away from.
            most_rad: a limb whose comfortable posture is farther from the seed leaves the seed as
                little as goes, shape (N,).
        """
        count, turn = len(self.robot.limbs), rotation_of(rotation_rad)
        out = np.zeros((count, 3)) if normals is None else read_only(normals, (count, 3), "normals")
        com = read_only(com_m, (3,), "com_m")
        feet = self.targets(com, turn, read_only(toes_m, (count, 3), "toes_m"), out)
        near = None if seed is None else read_only(seed, (len(self.joints),), "seed")
        up = np.array([0.0, 0.0, 1.0]) if normals is None else out @ turn
        if self.drawn:
            wished = limb_postures(
                self.robot.limbs,
                self.servo,
                feet,
                -out @ turn,
                near=None if near is None else near.reshape(count, -1),
                pose=(com, turn),
                obstacles=obstacles,
            )
        else:
            start = self.own.standing if near is None else near
            wished = self.own.solve(feet[None], near=start, up=up)[0][0]
        if near is not None:
            far = self.by_leg(np.abs(wished - near)).max(axis=1) > most_rad
            wished = np.where(self.of_joints(far), near, wished)
        angles, error = self.reach(feet, wished, wished, up)
        excess = np.zeros(count)
        if np.any(error > REACHED_M) and not self.soles:
            beyond, missed = self.reach(feet, wished, wished, limits=False)
            over = self.by_leg(np.maximum(beyond - self.highest_rad, self.lowest_rad - beyond)).max(
                axis=1
            )
            excess = np.where(missed <= REACHED_M, np.maximum(over, 0.0), 0.0)
        return angles, error, excess

    def targets(self, com_m: Array, rotation: Array, toes_m: Array, normals: Array) -> Array:
        """Centres of the feet in the base's frame for toes in the world, shape (N, 3) [m].

        Arguments:
            com_m: the body's origin (``Robot.origin_m`` in the base).
            rotation: R_WB.
            normals: shape (N, 3).
        """
        return np.asarray(
            (toes_m + self.radii_m[:, None] * normals - com_m) @ rotation + self.robot.origin_m
        )

    @cached_property
    def own(self) -> InverseKinematics:
        """Inverse kinematics from seeds all over the workspaces, which no pinocchio takes part
        in.
        """
        return InverseKinematics(self.model.legs)

    def reach(
        self,
        feet: Array,
        start: Array,
        wished: Array,
        up: ArrayLike = (0.0, 0.0, 1.0),
        *,
        limits: bool = True,
    ) -> tuple[Array, Array]:
        """Damped least squares from ``start``, drawn towards ``wished`` where that moves no foot;
        joints that would go beyond a limit at which they are wait there, and a limb that ends no
        closer than it started stays as it was.

        Arguments:
            feet: centres in the base's frame, shape (N, 3) [m].
            up: normals below soles in the base's frame, shape (N, 3) or (3,).

        Returns:
            Angles, shape (J,), and errors, shape (N,) [m].
        """
        lower, upper = self.lowest_rad, self.highest_rad
        if not limits:
            lower, upper = np.full((2, len(lower)), [[-np.inf], [np.inf]])
        start = np.minimum(np.maximum(start, lower), upper)
        level = None if not self.soles else levelled(np.broadcast_to(up, feet.shape))
        pull, angles, gap = 0.5, start, self._gap(feet, start, level)
        first, ends = gap, (self.by_leg(lower), self.by_leg(upper))
        for _ in range(_STEPS):
            if (farthest := abs(gap).max()) < EXACT_M:
                break
            drawn, damping = self.by_leg(pull * (wished - angles)), DAMPING * farthest
            now, jacobian = self.by_leg(angles), self._jacobian()
            q = stepped(now, jacobian, gap, damping, _LONGEST_STEP_RAD, ends, drawn)
            angles = q.reshape(-1) if self._even else q[self.legs, self._nth]
            pull *= 0.7
            gap = self._gap(feet, angles, level)
        error = lengths(gap)
        if error.max() <= EXACT_M:  # as good as any start
            return angles, error
        before = lengths(first)
        better = error <= np.maximum(before, EXACT_M)
        return np.where(self.of_joints(better), angles, start), np.where(better, error, before)

    def _gap(self, feet: Array, angles: Array, level: Array | None) -> Array:
        """Ways of the feet to where they should be, shape (N, 3) [m], and those of the farthest
        corners of soles as they turn, shape (N, 6).

        Arguments:
            level: axes that soles should have, shape (N, 3, 3); None without soles.
        """
        gap = feet - self._placed(angles)
        if level is None:
            return np.asarray(gap)
        between = level @ (np.array(self._turns) @ self._sole_axes).transpose(0, 2, 1)
        skew = 0.5 * (between - between.transpose(0, 2, 1))
        turn = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        return np.concatenate([gap, self._sole_radii[:, None] * turn], axis=1)

    def beyond(self, angles: Array) -> Array:
        """Distance of joints beyond their limits, 0 within, shapes (…, J) [rad, or m where a joint
        slides].
        """
        return np.asarray(
            np.maximum(np.maximum(angles - self.highest_rad, self.lowest_rad - angles), 0.0)
        )

    def feet(self, angles: Array) -> Array:
        """Centres of the feet in the base's frame, shape (N, 3) [m]."""
        return self._placed(angles).copy()

    def chains(self, angles: Array) -> Array:
        """Joints and foot of every limb in the base's frame, shape (N, n + 1, 3) [m]; shorter ones
        stay at the foot.

        Of a leg that is drawn up: shoulder, roll joint a fifth along the thigh, knee and foot.
        """
        feet = self.feet(angles)
        places = np.array([self._data.oMi[number].translation for number in self._number])
        if self.drawn:
            first, *_, knees = places.reshape(len(feet), -1, 3).transpose(1, 0, 2)
            return np.stack(
                [first, (1.0 - _DRAWN_AT) * first + _DRAWN_AT * knees, knees, feet], axis=1
            )
        result = np.repeat(feet[:, None], self._most + 1, axis=1)
        result[self.legs, self._nth] = places
        return result

    def carrier(self, mount: Mount) -> int:
        """The body that carries a link, as ``carriers`` numbers them."""
        return 0 if mount.leg is None else 1 + int(self.joints_of(mount.leg)[mount.joint])

    def carriers(self, angles: Array) -> tuple[Array, Array]:
        """Frames of the base and of all joints in the base's frame at T postures, by the legs' own
        chains.

        Arguments:
            angles: shape (T, J) [rad].

        Returns:
            R_BJ, shape (T, 1 + J, 3, 3), and p_BJ, shape (T, 1 + J, 3) [m].
        """
        count = len(angles)
        turns, places = [np.broadcast_to(np.eye(3), (count, 1, 3, 3))], [np.zeros((count, 1, 3))]
        for i, leg in enumerate(self.model.legs):
            turn, place = leg.chain.frames(angles[:, self.legs == i])
            turns.append(turn)
            places.append(place)
        return np.concatenate(turns, axis=1), np.concatenate(places, axis=1)

    def foot_frames(self, angles: Array) -> Array:
        """Orientations of the feet in the base's frame, shape (N, 3, 3)."""
        self._placed(angles)
        return np.array(self._turns)

    def corners(self, angles: Array, leg: int, points_m: Array) -> Array:
        """Points (forward, left) of a leg's sole in the base's frame, shape (K, 2) to (K, 3) [m]."""
        its = self.model.legs[leg]
        assert its.sole is not None
        turn = its.chain.frames(angles[None, self.legs == leg])[0][0, -1] @ its.sole.rotation
        return np.asarray(self.feet(angles)[leg] + points_m @ turn[:, :2].T)

    def sole_offsets(self, angles: Array) -> list[Array]:
        """Vectors from the centres of the feet to the corners of their soles in the base's frame, by
        leg, shape (K, 3) [m]; a foot without one is its centre.
        """
        return [
            np.zeros((1, 3))
            if leg.sole is None
            else self.corners(angles, i, leg.sole.points_m) - self.feet(angles)[i]
            for i, leg in enumerate(self.model.legs)
        ]

    def com_offset(self, angles: Array) -> Array:
        """The whole robot's centre of mass in the base's frame, shape (3,) [m]: Lin et al. take it
        for ``origin_m``.
        """
        return np.array(self._pin.centerOfMass(self.known, self._masses, self._configured(angles)))

    def torques(
        self, angles: Array, rotation: Array, forces_n: Array, moments_nm: Array | None = None
    ) -> Array:
        """τ = g(q) − Σ Jᵢᵀ fᵢ: what the joints give so that the robot stands still, shape (J,)
        [Nm].

        Arguments:
            rotation: R_WB, shape (3, 3).
            forces_n: on the feet, world frame, shape (N, 3) [N].
            moments_nm: of forces on soles about their middles, shape (N, 3) [Nm]; None for points.
        """
        torques = self.torques_of(self.loads(angles, rotation), forces_n)
        if moments_nm is None:
            return torques
        return torques - self.turning(angles, rotation, moments_nm)

    def turning(self, angles: Array, rotation: Array, moments_nm: Array) -> Array:
        """Torques that moments on the feet take off what joints give, shape (J,) [Nm].

        Arguments:
            rotation: R_WB, shape (3, 3).
            moments_nm: about the centres of the feet, world frame, shape (N, 3) [Nm].
        """
        torques = np.zeros(len(self.joints))
        for i, leg in enumerate(self.model.legs):
            turns = leg.chain.frames(angles[None, self.legs == i])[0][0]
            axes = np.einsum("nij,nj->ni", turns, leg.chain.axes) * ~leg.chain.slides[:, None]
            torques[self.legs == i] = axes @ rotation.T @ moments_nm[i]
        return torques

    def torques_of(self, loads: tuple[Array, Array], forces_n: Array) -> Array:
        """Torques as of ``torques``, from ``loads``, which many forces share."""
        weight, levers = loads
        return np.asarray(weight - (levers * forces_n[self.legs]).sum(axis=1))

    def loads(self, angles: Array, rotation: Array) -> tuple[Array, Array]:
        """Parts of the torques at rest: τ_j = g_j − levers_j · f of the joint's own foot, f in the
        world frame.

        Returns g, shape (J,) [Nm], and levers, shape (J, 3) [m].
        """
        self.known.gravity.linear = rotation.T @ self._down
        weight = self._pin.computeGeneralizedGravity(
            self.known, self._masses, self._configured(angles)
        )
        return np.array(weight[self._column]), self.levers(angles) @ rotation.T

    def gravity_slopes(self, angles: Array, rotation: Array) -> tuple[Array, Array]:
        """Derivatives of the g of ``loads``: in the angles, shape (J, J), and in a small rotation
        of the base about the world's axes, shape (J, 3) [Nm/rad].
        """
        pin, known, q = self._pin, self.known, self.configuration(angles)
        down, along = np.array([0.0, 0.0, -self.gravity_m_s2]), np.empty((known.nv, 3))
        for axis in range(3):  # g is linear in gravity
            known.gravity.linear = np.eye(3)[axis]
            along[:, axis] = pin.computeGeneralizedGravity(known, self._masses, q)
        known.gravity.linear = rotation.T @ down
        slopes = pin.computeGeneralizedGravityDerivatives(known, self._masses, q)
        turned = (
            along[self.columns] @ rotation.T @ np.cross(down, np.eye(3)).T
        )  # δ(Rᵀ g) = Rᵀ (g × δ)
        return np.array(slopes[np.ix_(self.columns, self.columns)]), turned

    def inertial_torques(self, angles: Array, velocity: Array, acceleration: Array) -> Array:
        """Torques that the legs' own masses take while the base is still and nothing weighs, shape
        (J,) [Nm].
        """
        known, pin = self.known, self._pin
        rates, pushed = np.zeros(known.nv), np.zeros(known.nv)
        rates[self._column], pushed[self._column] = velocity, acceleration
        known.gravity.linear = np.zeros(3)
        return np.array(
            pin.rnea(known, self._masses, self._configured(angles), rates, pushed)[self._column]
        )

    def _placed(self, angles: Array) -> Array:
        """Put the legs into a posture, and return the centres of the feet, shape (N, 3) [m].

        Afterwards ``_levers`` and ``_jacobian`` are those of this posture. Nothing is computed
        again if it is the same posture as in the last call.

        Arguments:
            angles: joint angles [rad].
        """
        key = np.asarray(angles, dtype=np.float64).tobytes()
        if key != self._at:
            self._at = b""
            self._pin.computeJointJacobians(self.known, self._data, self._configured(angles))
            self._pin.updateFramePlacements(self.known, self._data)
            self._at, self._centres = key, np.array(self._middles)
            self._centres.flags.writeable = False
        return self._centres

    def levers(self, angles: Array) -> Array:
        """Derivatives of every joint's own foot in that joint, in the base's frame, shape (J, 3) [m,
        or 1 where it slides].
        """
        self._placed(angles)
        return self._levers()

    def _levers(self) -> Array:
        """Derivatives of every joint's own foot in that joint, where ``_placed`` put them, shape
        (J, 3).
        """
        # velocity of what is at the origin, less p × ω
        parts = self._centres.take(self._feet_of) * self._spatial.take(self._turning)
        return np.asarray(self._spatial[self._column, :3] - (parts[0] - parts[1]))

    def _jacobian(self) -> Array:
        """Derivatives of the feet in their own limb's joints, where ``_placed`` put them, shape (N,
        3, n), of soles as ``_gap`` has them, shape (N, 6, n).
        """
        levers = self._levers()
        if self.soles:
            axes = self._sole_radii[self.legs, None] * self._spatial[self._column, 3:]
            levers = np.concatenate([levers, axes], axis=1)
        jacobian = np.zeros((len(self._feet), levers.shape[1], self._most))
        if self._even:
            jacobian[:] = levers.reshape(len(jacobian), self._most, -1).transpose(0, 2, 1)
        else:
            jacobian[self.legs, :, self._nth] = levers
        return jacobian


def _factors(rows: NDArray[np.int_], width: int) -> NDArray[np.int_]:
    """Places of the first factors in the cross products of these rows of a table so wide, those
    that are added and those that are taken off, shape (2, J, 3); of the second ones the other way
    round.
    """
    return np.array([[1, 2, 0], [2, 0, 1]])[:, None] + width * rows[:, None]


def _slice_or(numbers: NDArray[np.int_]) -> slice | NDArray[np.int_]:
    """Numbers that follow each other as a slice, which is quicker; others as they are."""
    follow = slice(int(numbers[0]), int(numbers[0]) + len(numbers))
    return follow if np.array_equal(numbers, np.arange(follow.start, follow.stop)) else numbers


LINKS = (0.54, 0.53)
"""Lengths of thigh and shank in units of the limb's reach. Their sum leaves 7 % for the foot's
radius and keeps the leg from being straight at the edge of its workspace."""


def link_lengths(limb: Limb) -> Array:
    """Thigh and shank, shape (2,) [m]; from the shoulder's centre to the foot's."""
    return np.array(LINKS) * limb.reach_m


def outward_rad(limb: Limb) -> float:
    """Azimuth of the limb's plane at yaw 0: away from the body's centre [rad]."""
    return float(np.arctan2(limb.shoulder_m[1], limb.shoulder_m[0]))


_Clearance = Callable[[Array], Array]
_SWIVELS_RAD = np.linspace(0.0, 2.0 * np.pi, 121)[:-1]
"""Where the knee may be around the line from shoulder to foot."""
_MARGIN_RAD = 0.15
SHANK = np.array([0.0, 0.25, 0.5, 0.75, 0.88])
_CLEARANCE_M = np.array([0.03, 0.03, 0.03, 0.026, 0.018])
"""Points of the shank, as shares of it from the knee, and how far those of a limb of the usual
reach should keep off the terrain: the last are near the foot's own surface."""
_WEIGHTS = {
    "approach": 1.0,  # shank not along the approach
    "up": 0.4,  # knee not above the shoulder
    "yaw": 0.15,
    "roll": 0.15,
    "near": 0.4,  # far from the posture before
    "limits": 400.0,  # closer than MARGIN_RAD to a limit
    "beyond": 1e6,  # a limit
    "clear": 30000.0,  # closer to the terrain than CLEARANCE_M
    "steep": 60.0,  # thigh nearly along the axis of yaw
}
"""Weights of a posture's discomfort."""
_STEEP = 0.9
NEAR = 1.3
"""Share of a limb's reach: what is farther from its shoulder than this share takes no part."""


def posture_cost(
    lengths: Array,
    target: Array,
    approach: Array,
    servo: Servo,
    *,
    near: Array | None = None,
    clearance: _Clearance | None = None,
) -> tuple[Array, Array]:
    """The family of postures within the limits, shape (…, K, 4) [rad], and how uncomfortable each
    is, shape (…, K).

    Arguments:
        lengths: thigh and shank, shape (2,) [m].
        target: foot's centre in the limb's frame (x outward, z the body's), shape (3,) [m], or any
            number of them at once, shape (…, 3).
        approach: unit vector in the same frame along which the foot should come, into the surface,
            likewise; zeros where it does not matter.
        near: a posture to stay close to, shape (4,) or (…, 4).
        clearance: how far points of the limb's frame, shape (K, 3), are from the terrain, shape
            (K,) [m].
    """
    family = swivels(lengths, target)
    cost = _discomfort(family, approach, servo, near)
    if clearance is not None:
        points = links(lengths, family)
        far = clearance(points.reshape(*points.shape[:-3], -1, 3)).reshape(points.shape[:-1])
        short = np.maximum(_CLEARANCE_M - far / (lengths[1] / (LINKS[1] * USUAL_REACH_M)), 0.0)
        cost = cost + _WEIGHTS["clear"] * np.sum(short**2, axis=-1)
    return np.clip(family, servo.lower_rad, servo.upper_rad), cost


def limb_postures(
    limbs: Sequence[Limb],
    servo: Servo,
    feet: Array,
    approach: Array,
    *,
    near: Array | None,
    pose: tuple[Array, Array],
    obstacles: Sequence[Solid],
) -> Array:
    """The most comfortable postures of all limbs, shape (J,) [rad].

    Arguments:
        feet, approach: as in ``posture_cost``, in the body frame, shape (N, 3).
        near: shape (N, 4).
        pose: of the body in the world, where the obstacles are: its origin, shape (3,) [m], and
            R_WB.
    """
    origin, turn = pose
    frames = np.array([rotation_of([0.0, 0.0, outward_rad(limb)]) for limb in limbs])
    shoulders = np.array([limb.shoulder_m for limb in limbs])
    targets, ways = ((part[:, None] @ frames)[:, 0] for part in (feet - shoulders, approach))
    postures = np.empty((len(limbs), len(JOINTS)))
    for reach_m in {limb.reach_m: None for limb in limbs}:  # limbs of a size at once
        alike = np.array([i for i, limb in enumerate(limbs) if limb.reach_m == reach_m])
        clearance = clearance_of(
            origin + shoulders[alike] @ turn.T, turn @ frames[alike], obstacles, NEAR * reach_m
        )
        family, cost = posture_cost(
            link_lengths(limbs[alike[0]]),
            targets[alike],
            ways[alike],
            servo,
            near=None if near is None else near[alike],
            clearance=clearance,
        )
        postures[alike] = family[np.arange(len(alike)), np.argmin(cost, axis=1)]
    return postures.ravel()


def swivels(lengths: Array, target: Array) -> Array:
    """The postures that reach ``target``, or come closest, one for each of SWIVELS_RAD; (…, 3) to
    (…, K, 4).
    """
    thigh, shank = lengths
    far = np.maximum(np.linalg.norm(target, axis=-1, keepdims=True), 1e-6)
    distance = np.clip(far, abs(thigh - shank) + 1e-6, thigh + shank - 1e-6)
    along = target / far
    aside = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=-1)])
    aside = aside / np.linalg.norm(aside, axis=-1, keepdims=True)
    ahead = (thigh**2 + distance**2 - shank**2) / (2.0 * distance)
    wide = np.sqrt(np.maximum(thigh**2 - ahead**2, 0.0))
    cos, sin = np.cos(_SWIVELS_RAD)[:, None], np.sin(_SWIVELS_RAD)[:, None]
    ring = cos * aside[..., None, :] + sin * np.cross(along, aside)[..., None, :]
    knees = (ahead * along)[..., None, :] + wide[..., None] * ring
    upper, lower = knees / thigh, ((distance * along)[..., None, :] - knees) / shank
    yaw, hip = (
        np.arctan2(upper[..., 1], upper[..., 0]),
        -np.arcsin(np.clip(upper[..., 2], -1.0, 1.0)),
    )
    across = lower[..., 1] * np.cos(yaw) - lower[..., 0] * np.sin(
        yaw
    )  # of the shank, in the thigh's frame
    above = (
        np.sin(hip) * (lower[..., 0] * np.cos(yaw) + lower[..., 1] * np.sin(yaw))
        + np.cos(hip) * lower[..., 2]
    )
    bend = np.arccos(
        np.clip((distance**2 - thigh**2 - shank**2) / (2.0 * thigh * shank), -1.0, 1.0)
    )
    return np.stack(
        [yaw, hip, np.arctan2(across, -above), np.broadcast_to(bend, yaw.shape)], axis=-1
    )


def links(lengths: Array, family: Array) -> Array:
    """Points along the shank, but for its end, which is near the surface, shape (…, K, 5, 3)
    [m].
    """
    upper, lower = directions(family)
    knees = lengths[0] * upper
    return np.asarray(knees[..., None, :] + SHANK[:, None] * lengths[1] * lower[..., None, :])


def directions(family: Array) -> tuple[Array, Array]:
    """Unit vectors along thigh and shank in the limb's frame, shape (…, 3) each, for angles of
    shape (…, 4).
    """
    (cy, ch, cr, ck), (sy, sh, sr, sk) = (
        np.moveaxis(np.cos(family), -1, 0),
        np.moveaxis(np.sin(family), -1, 0),
    )
    upper = np.stack([cy * ch, sy * ch, -sh], axis=-1)
    out, across, above = ck * ch - sk * cr * sh, sk * sr, -ck * sh - sk * cr * ch
    return upper, np.stack([cy * out - sy * across, sy * out + cy * across, above], axis=-1)


def _discomfort(family: Array, approach: Array, servo: Servo, near: Array | None) -> Array:
    upper, lower = directions(family)
    over = np.maximum(family - np.array(servo.upper_rad) + _MARGIN_RAD, 0.0)
    under = np.maximum(np.array(servo.lower_rad) + _MARGIN_RAD - family, 0.0)
    cost = (
        -_WEIGHTS["approach"] * (lower @ approach[..., None])[..., 0]
        - _WEIGHTS["up"] * upper[..., 2]
        + _WEIGHTS["yaw"] * family[..., 0] ** 2
        + _WEIGHTS["roll"] * family[..., 2] ** 2
        + _WEIGHTS["limits"] * np.sum(over**2 + under**2, axis=-1)
        + _WEIGHTS["beyond"] * np.any(np.maximum(over, under) > _MARGIN_RAD, axis=-1)
        + _WEIGHTS["steep"] * np.maximum(np.abs(upper[..., 2]) - _STEEP, 0.0) ** 2
    )
    if near is not None:
        cost = cost + _WEIGHTS["near"] * np.sum((family - near[..., None, :]) ** 2, axis=-1)
    return np.asarray(cost)


def clearance_of(
    origin: Array, frame: Array, solids: Sequence[Solid], within_m: float
) -> _Clearance:
    """Distance from the nearest solid of points in a frame, shape (…, K, 3) to (…, K) [m]; infinite
    where none is near.

    Arguments:
        origin, frame: origin and axes of the points' frame in the world, shape (…, 3) and (…, 3,
            3).
        within_m: a solid farther from the origin takes no part.
    """
    close = Solids(solids).distances(origin.reshape(-1, 3)) < within_m
    around = [Solids([solids[i] for i in np.flatnonzero(row).tolist()]) for row in close]

    def distance(points: Array) -> Array:
        world = origin[..., None, :] + points @ np.swapaxes(frame, -1, -2)
        parts = zip(around, world.reshape(-1, *world.shape[-2:]), strict=True)
        nearest = [of.distances(shape).min(axis=-1, initial=np.inf) for of, shape in parts]
        return np.asarray(nearest).reshape(world.shape[:-1])

    return distance
