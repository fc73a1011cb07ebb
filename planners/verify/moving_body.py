"""Load of a motion on the robot's own body: one sweep for whatever moves a body and its feet, a walk
or a leap.

Angles are found over chains of our own; pinocchio puts the feet and the masses where the robot's
URDF has them, and says what the joints have to give.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from .bodies import BodyReport, bodies_report, spaced
from .trajectory_measurements import WHOLE_BODY, Rows, Series, TrajectoryMeasurements, WalkLimits

if TYPE_CHECKING:
    from ..motion.joints import WalkPostures
    from ..robot.inverse_kinematics import WholeBody
    from ..terrain.obstacles import Obstacles


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPath:
    """A body and its feet over time: K samples on a uniform grid, N feet.

    Arguments:
        times_s: shape (K,) [s].
        com_m: centre of mass, shape (K, 3) [m].
        rotation: R_WB, shape (K, 3, 3).
        toes_m, normals: where feet touch, or would, and of the surface there, shape (K, N, 3).
        forces_n: on the robot, shape (K, N, 3) [N].
        contact: which feet stand, shape (K, N).
        feet: their names.
    """

    times_s: Array
    com_m: Array
    rotation: Array
    toes_m: Array
    normals: Array
    forces_n: Array
    contact: NDArray[np.bool_]
    feet: tuple[str, ...]


class MovingBodyMeasurements:
    """Measurements of one motion of a robot that has a model; K samples, N legs, J joints.

    Raises InvalidInput without pinocchio.
    """

    def __init__(self, path: BodyPath, postures: WalkPostures) -> None:
        from ..robot.urdf_reader import at_rest, base_joint, pinocchio  # slow to import

        self.path, self.postures, self._pin = path, postures, pinocchio()
        self.times_s = path.times_s
        self.step_s = float(path.times_s[-1] - path.times_s[0]) / (len(path.times_s) - 1)
        self.kinematics = postures.kinematics
        self._known = self.kinematics.known
        self._data = self._known.createData()
        base = self._known.joints[base_joint(self._known)]
        self._base = slice(base.idx_q, base.idx_q + 7)
        self._home = self._pin.XYZQUATToSE3(at_rest(self._known)[self._base])

    @cached_property
    def _legs(self) -> tuple[Array, Array]:
        """Centres of the feet and levers of the joints in the base's frame, shapes (K, N, 3) [m] and
        (K, J, 3), by one sweep.
        """
        solver = self.kinematics
        swept = [(solver.feet(angles), solver.levers(angles)) for angles in self.postures.angles]
        feet, levers = zip(*swept, strict=True)
        return np.array(feet), np.array(levers)

    def off_toes(self) -> Series:
        """Distance of every foot, as the URDF has it within the joints' limits, from where it
        touches, (K, N) [m].
        """
        radii, path = self.kinematics.radii_m, self.path
        wanted = path.toes_m + radii[:, None] * path.normals
        feet, _ = self._legs
        placed = self.postures.origin_m[:, None] + np.einsum(
            "kij,knj->kni", self.path.rotation, feet
        )
        return Series(np.linalg.norm(placed - wanted, axis=-1), self.path.feet, self.times_s)

    def speed(self) -> Series:
        """Joint speed between samples as a share of the joint's limit; 0 where its file has none,
        (K − 1, J).
        """
        most = self.kinematics.velocity_rad_s
        return Series(
            np.abs(self.rates_rad_s) / np.where(most > 0.0, most, np.inf),
            self.kinematics.joints,
            self.times_s[1:],
        )

    @cached_property
    def rates_rad_s(self) -> Array:
        """Speeds of the joints between samples, shape (K − 1, J) [rad/s, or m/s where one slides]."""
        turns = np.diff(self.postures.angles, axis=0)
        free = np.concatenate([leg.turns for leg in self.kinematics.model.legs])
        short = np.mod(turns + np.pi, 2.0 * np.pi) - np.pi
        return np.asarray(np.where(free, short, turns) / self.step_s)

    # ----------------------------------------------------------------------------------------------
    # dynamics

    @cached_property
    def _states(self) -> tuple[Array, Array]:
        """The whole robot as pinocchio has it, shape (K, nq), and its velocity between samples, (K
        − 1, nv).
        """
        pin, origins = self._pin, self.postures.origin_m
        states = np.array(
            [self.kinematics.configuration(angles) for angles in self.postures.angles]
        )
        for state, turn, origin in zip(states, self.path.rotation, origins, strict=True):
            state[self._base] = pin.SE3ToXYZQUAT(pin.SE3(turn, origin) * self._home)
        velocity = [pin.difference(self._known, a, b) for a, b in pairwise(states)]
        return states, np.array(velocity) / self.step_s

    @cached_property
    def torques_nm(self) -> Array:
        """Torques of the joints at the inner samples, (K − 2, J) [Nm]: τ = M q̈ + C q̇ + g − Σ Jᵢᵀ
        fᵢ + I q̈, the rows of the joints, with the whole robot moving as the trajectory has it and
        the feet pressed by its forces; I of the rotors.
        """
        return self._torques(self.path.forces_n)

    def _torques(self, forces_n: Array) -> Array:
        """Torques of the joints at the inner samples under these forces, shape (K, N, 3) [N]."""
        pin, known, solver = self._pin, self._known, self.kinematics
        states, between = self._states
        velocity, rising = (
            0.5 * (between[1:] + between[:-1]),
            np.diff(between, axis=0) / self.step_s,
        )
        known.gravity.linear = np.array([0.0, 0.0, -solver.gravity_m_s2])
        moved = np.array(
            [
                pin.rnea(known, self._data, *each)[solver.columns]
                for each in zip(states[1:-1], velocity, rising, strict=True)
            ]
        )
        rotation, forces = self.path.rotation[1:-1], forces_n[1:-1]
        levers = self._legs[1][1:-1] @ np.swapaxes(rotation, 1, 2)
        turned = solver.rotor_kg_m2 * rising[:, solver.columns]
        return np.asarray(moved + turned - np.einsum("kji,kji->kj", levers, forces[:, solver.legs]))

    def torque(self) -> Series:
        """Torques as a share of the joints' limits, 0 where the limit is not known, (K − 2, J)."""
        shares = np.abs(self.torques_nm) / self.kinematics.torque_nm
        return Series(shares, self.kinematics.joints, self.times_s[1:-1])

    def legs_moment(self) -> Series:
        """dL/dt − Σ (p_i − p) × f_i at the inner samples with L of the whole robot, legs and all,
        (K − 2, 3) [Nm].

        What legs that swing do to the balance of moments: motions are planned for one rigid body (W
        §III-A). Forces need no such row, for the centre of mass is the whole robot's.
        """
        pin, known = self._pin, self._known
        states, between = self._states
        momentum = np.array(
            [
                pin.computeCentroidalMomentum(
                    known,
                    self._data,
                    pin.integrate(known, state, 0.5 * self.step_s * velocity),
                    velocity,
                ).angular.copy()
                for state, velocity in zip(states[:-1], between, strict=True)
            ]
        )
        arms = self.path.toes_m - self.path.com_m[:, None]
        moments = np.cross(arms, self.path.forces_n).sum(axis=1)
        return Series(
            np.diff(momentum, axis=0) / self.step_s - moments[1:-1],
            ("x", "y", "z"),
            self.times_s[1:-1],
        )

    # ------------------------------------------------------------------------------------------------
    # bodies

    def bodies(self, obstacles: Obstacles) -> BodyReport:
        """Judge links against each other and against obstacles, all the way.

        Raises InvalidInput without coal.
        """
        from ..robot.bodies import Bodies

        return bodies_report(Bodies(self.kinematics, obstacles), *self.spaced(), between=True)

    def spaced(self) -> tuple[Array, WholeBody]:
        """Postures that are as near to each other as ``spaced`` has them: their times, shape (T,)
        [s], and they.
        """
        points = np.concatenate([self.path.toes_m, self.postures.origin_m[:, None]], axis=1)
        rows = spaced(points, self.postures.angles)
        return self.times_s[rows], self.posture(rows)

    def posture(self, samples: NDArray[np.intp] | int) -> WholeBody:
        """Posture of the whole robot at samples, or at one."""
        from ..robot.inverse_kinematics import WholeBody

        path, postures, k = self.path, self.postures, samples
        return WholeBody(
            rotation=path.rotation[k],
            origin_m=postures.origin_m[k],
            angles=postures.angles[k],
            toes_m=path.toes_m[k],
            normals=postures.normals[k],
            stands=path.contact[k],
        )


def nothing(why: str) -> tuple[Rows, dict[str, str]]:
    """None of the groups of ``WHOLE_BODY`` measured, and why."""
    rows: Rows = {name: (Series(np.zeros((0, 0)), (), np.zeros(0)), 0.0) for name in WHOLE_BODY}
    return rows, dict.fromkeys(WHOLE_BODY, why)


def whole_body(measured: TrajectoryMeasurements, limits: WalkLimits) -> tuple[Rows, dict[str, str]]:
    """Measure the groups of ``WHOLE_BODY``, and say why some of them are not checked, by their
    names.

    Arguments:
        limits: what is allowed of each.

    Returns:
        Series with their limits, all empty for a robot of boxes or without pinocchio, and reasons
        in words: a file without speed or torque limits, meshes that are not there, no coal.
    """
    try:
        body = WholeBodyMeasurements(measured)
    except InvalidInput as error:  # legs that nobody knows, or no pinocchio
        return nothing(str(error))
    model = body.kinematics.model
    rows, missing = nothing("")[0], dict[str, str]()
    rows["joints"] = body.off_toes(), limits.joints_m
    rows["joint_speed"] = body.speed(), limits.joint_speed
    rows["torque"] = body.torque(), limits.torque
    swung = body.legs_moment()
    rows["legs_moment"] = swung.size(), limits.legs_moment * measured.moment_scale_nm, swung.rms()
    if model.limit_doubts:
        missing["joints"] = "; ".join(model.limit_doubts)
    if unlimited := model.lines_of(model.torque_doubts):
        missing["torque"] = "; ".join(unlimited)
    if np.any(body.kinematics.velocity_rad_s <= 0.0):
        missing["joint_speed"] = "no limit of the joints' speed in the robot's file"
    try:
        depth, bare = body.overlap()
        rows["bodies"] = depth, limits.bodies_m
        if bare:
            missing["bodies"] = "; ".join(bare)
    except InvalidInput as error:  # no coal
        missing["bodies"] = str(error)
    return rows, missing


class WholeBodyMeasurements(MovingBodyMeasurements):
    """Measurements of one trajectory of a robot that has a model; K samples, N legs, J joints.

    Raises InvalidInput without pinocchio, and for a robot without a model.
    """

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        from ..motion.joints import walk_postures  # slow to import

        walk = measured.trajectory
        path = BodyPath(
            times_s=measured.times_s,
            com_m=walk.torso_m,
            rotation=walk.rotation,
            toes_m=walk.feet_m,
            normals=measured.ground[1],
            forces_n=walk.forces_n,
            contact=walk.contact,
            feet=measured.feet,
        )
        super().__init__(path, walk_postures(walk))
        self.trajectory = walk

    def overlap(self) -> tuple[Series, tuple[str, ...]]:
        """The deepest that a link is inside another or inside the ground, (1, 1) [m], and which
        links; and what has no shape. Raises InvalidInput without coal.
        """
        from ..terrain.obstacles import Obstacles

        report = self.bodies(Obstacles.under(self.trajectory.terrain))
        if report.worst is None:
            return Series(np.zeros((1, 1)), ("",), self.times_s[:1]), report.missing
        names = f"{report.worst.link} in {report.worst.other}"
        return Series(
            np.array([[report.worst.depth_m]]), (names,), np.array([report.frame])
        ), report.missing
