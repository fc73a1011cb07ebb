"""Load of a trajectory on the robot's own body: joints, torques, bodies, and what legs that weigh
something change.

Angles are found over chains of our own; pinocchio puts the feet and the masses where the robot's
URDF has them, and says what the joints have to give. Nothing of it is known of a robot that is but
boxes.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..cached import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from .bodies import bodies_report, spaced
from .trajectory_limits import WHOLE_BODY, WalkLimits
from .trajectory_measurements import TrajectoryMeasurements
from .trajectory_series import Rows, Series

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..motion.walk_joints import WalkPostures
    from ..robot.overlaps import WholeBody


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


class WholeBodyMeasurements:
    """Measurements of one trajectory of a robot that has a model; K samples, N legs, J joints.

    Raises InvalidInput without pinocchio, and for a robot without a model.
    """

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        from ..motion.walk_joints import walk_postures
        from ..robot.urdf_reader import at_rest, base_joint, pinocchio  # slow to import

        self._measured, self.trajectory, self._pin = measured, measured.trajectory, pinocchio()
        self.times_s, self.step_s = measured.times_s, measured.step_s
        self.postures: WalkPostures = walk_postures(measured.trajectory)
        self.kinematics = self.postures.kinematics
        self._known = self.kinematics.known
        self._data = self._known.createData()
        base = self._known.joints[base_joint(self._known)]
        self._base = slice(base.idx_q, base.idx_q + 7)
        self._home = self._pin.XYZQUATToSE3(at_rest(self._known)[self._base])

    def off_toes(self) -> Series:
        """Distance of every foot, as the URDF has it within the joints' limits, from where it
        touches, (K, N) [m].
        """
        radii, normals = self.kinematics.radii_m, self._measured.ground[1]
        wanted = self.trajectory.feet_m + radii[:, None] * normals
        feet = np.array([self.kinematics.feet(angles) for angles in self.postures.angles])
        placed = self.postures.origin_m[:, None] + np.einsum(
            "kij,knj->kni", self.trajectory.rotation, feet
        )
        return Series(np.linalg.norm(placed - wanted, axis=-1), self._measured.feet, self.times_s)

    def speed(self) -> Series:
        """Joint speed between samples as a share of the joint's limit; 0 where its file has none,
        (K − 1, J).
        """
        most = self.kinematics.velocity_rad_s
        turns = np.abs(np.diff(self.postures.angles, axis=0))
        free = np.concatenate([leg.turns for leg in self.kinematics.model.legs])
        turns = np.where(free, np.minimum(turns, np.abs(2.0 * np.pi - turns)), turns) / self.step_s
        return Series(
            turns / np.where(most > 0.0, most, np.inf), self.kinematics.joints, self.times_s[1:]
        )

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
        for state, turn, origin in zip(states, self.trajectory.rotation, origins, strict=True):
            state[self._base] = pin.SE3ToXYZQUAT(pin.SE3(turn, origin) * self._home)
        velocity = [pin.difference(self._known, a, b) for a, b in pairwise(states)]
        return states, np.array(velocity) / self.step_s

    @cached_property
    def torques_nm(self) -> Array:
        """Torques of the joints at the inner samples, (K − 2, J) [Nm]: τ = M q̈ + C q̇ + g − Σ Jᵢᵀ
        fᵢ + I q̈, the rows of the joints, with the whole robot moving as the trajectory has it and
        the feet pressed by its forces; I of the rotors.
        """
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
        angles, rotation, forces = (
            of[1:-1]
            for of in (self.postures.angles, self.trajectory.rotation, self.trajectory.forces_n)
        )
        levers = np.array(
            [solver.loads(q, turn)[1] for q, turn in zip(angles, rotation, strict=True)]
        )
        turned = solver.rotor_kg_m2 * rising[:, solver.columns]
        return np.asarray(moved + turned - np.einsum("kji,kji->kj", levers, forces[:, solver.legs]))

    def torque(self) -> Series:
        """Torques as a share of the joints' limits, 0 where the limit is not known, (K − 2, J)."""
        shares = np.abs(self.torques_nm) / self.kinematics.torque_nm
        return Series(shares, self.kinematics.joints, self.times_s[1:-1])

    def legs_moment(self) -> Series:
        """dL/dt − Σ (p_i − p) × f_i at the inner samples with L of the whole robot, legs and all,
        (K − 2, 3) [Nm].

        What legs that swing do to the balance of moments: the walk is planned for one rigid body (W
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
        arms = self.trajectory.feet_m - self.trajectory.torso_m[:, None]
        moments = np.cross(arms, self.trajectory.forces_n).sum(axis=1)
        return Series(
            np.diff(momentum, axis=0) / self.step_s - moments[1:-1],
            ("x", "y", "z"),
            self.times_s[1:-1],
        )

    # ------------------------------------------------------------------------------------------------
    # bodies

    def overlap(self) -> tuple[Series, tuple[str, ...]]:
        """The deepest that a link is inside another or inside the ground, (1, 1) [m], and which
        links; and what has no shape. Raises InvalidInput without coal.
        """
        from ..robot.bodies import Bodies
        from ..terrain.obstacles import Obstacles

        bodies = Bodies(self.kinematics, Obstacles.under(self.trajectory.terrain))
        report = bodies_report(bodies, *self.spaced(), between=True)
        if report.worst is None:
            return Series(np.zeros((1, 1)), ("",), self.times_s[:1]), report.missing
        names = f"{report.worst.link} in {report.worst.other}"
        return Series(
            np.array([[report.worst.depth_m]]), (names,), np.array([report.frame])
        ), report.missing

    def spaced(self) -> tuple[Array, WholeBody]:
        """Postures that are as near to each other as ``spaced`` has them: their times, shape (T,)
        [s], and they.
        """
        points = np.concatenate([self.trajectory.feet_m, self.postures.origin_m[:, None]], axis=1)
        rows = spaced(points, self.postures.angles)
        return self.times_s[rows], self.posture(rows)

    def posture(self, samples: NDArray[np.intp] | int) -> WholeBody:
        """Posture of the whole robot at samples, or at one."""
        from ..robot.overlaps import WholeBody

        walk, postures, k = self.trajectory, self.postures, samples
        return WholeBody(
            rotation=walk.rotation[k],
            origin_m=postures.origin_m[k],
            angles=postures.angles[k],
            toes_m=walk.feet_m[k],
            normals=postures.normals[k],
            stands=walk.contact[k],
        )
