"""Load of a trajectory on the robot's own body: joints, torques, bodies, and what legs that weigh
something change.

Angles are found over chains of our own; pinocchio puts the feet and the masses where the robot's
URDF has them, and says what the joints have to give. Nothing of it is known of a robot that is but
boxes.
"""

from __future__ import annotations

import numpy as np

from ..errors import InvalidInput
from .moving_body import BodyPath, MovingBodyMeasurements
from .trajectory_limits import WHOLE_BODY, WalkLimits
from .trajectory_measurements import TrajectoryMeasurements
from .trajectory_series import Rows, Series


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
