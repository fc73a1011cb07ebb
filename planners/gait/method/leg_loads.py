"""Joint torques of a walk, and their derivatives: the numbers of ``constraints.torque`` about one
trajectory.

Kinematics are chains of our own, as far as the rows go; how much of a joint's torque is not the
foot's force is taken from the verifier, which has it by pinocchio of the whole robot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...files.arrays import Array
from ...robot.inverse_kinematics import descend
from ...robot.leg import Leg
from ...verify.trajectory_measurements import TrajectoryMeasurements
from ...verify.trajectory_whole_body import WholeBodyMeasurements
from ..constraints.torque import LegLoads
from ..variables.structure import Structure

STEP_M = 1e-4
"""Between feet whose levers are compared."""
NEAR = 0.7
"""A joint gets a row where it gives this share of what it may."""
ROOM = 0.01
"""Share of the limit, between what the verifier allows and what rows ask for, besides what a joint
gives more between a node and the next than at it."""


def leg_loads(structure: Structure, report: Report[Trajectory], room: float = ROOM) -> LegLoads:
    """Rows for the joints of standing legs that give much, at the program's nodes, about a report's
    trajectory.
    """
    trajectory = report.answer
    body = WholeBodyMeasurements(TrajectoryMeasurements(trajectory))
    legs, solver = body.kinematics.model.legs, body.kinematics
    sample = np.clip(
        np.rint(structure.times_s / trajectory.step_s).astype(int), 1, trajectory.samples - 2
    )
    from scipy.ndimage import maximum_filter1d  # slow to import

    about = 2 * (round(0.5 * structure.settings.step_s / trajectory.step_s)) + 1
    highest = maximum_filter1d(np.abs(body.torques_nm), about, axis=0, mode="nearest")[sample - 1]
    torques, angles = body.torques_nm[sample - 1], body.postures.angles[sample]
    rotation, forces = trajectory.rotation[sample], trajectory.forces_n[sample]
    most = (report.limits["torque"] - room) * solver.torque_nm - (highest - np.abs(torques))
    felt = np.einsum("kji,knj->kni", rotation, forces)
    arms = trajectory.feet_m[sample] - trajectory.torso_m[sample][:, None]
    at = np.einsum("kji,knj->kni", rotation, arms)
    triplets = list[tuple[Any, ...]]()
    for i, leg in enumerate(legs):
        joints = solver.joints_of(i)
        levers, slopes = _levers(leg, angles[:, joints])
        rest = torques[:, joints] + np.einsum("kij,ki->kj", levers, felt[:, i])
        wanted = trajectory.contact[sample, i][:, None] & (
            np.abs(torques[:, joints]) > NEAR * most[:, joints]
        )
        node, joint = np.nonzero(wanted & np.isfinite(most[:, joints]))
        triplets.append(
            (
                np.full(len(node), i),
                node,
                at[node, i],
                levers[node, :, joint],
                slopes[node, :, joint],
                rest[node, joint],
                most[node, joints[joint]],
            )
        )
    return LegLoads(
        **dict(
            zip(
                ("foot", "node", "at_m", "levers_m", "slopes", "rest_nm", "most_nm"),
                (np.concatenate(part) for part in zip(*triplets, strict=True)),
                strict=True,
            )
        )
    )


def _levers(leg: Leg, angles: Array) -> tuple[Array, Array]:
    """∂p_BF/∂q, shape (K, 3, n), and how that changes with the foot's place, shape (K, 3, n, 3)."""
    feet, jacobian = leg.chain.feet_and_jacobian(angles)
    slopes = np.empty((*jacobian.shape, 3))
    for axis in range(3):
        sides = [
            descend(leg, feet + step * np.eye(3)[axis], angles)[0] for step in (STEP_M, -STEP_M)
        ]
        ahead, behind = (leg.chain.feet_and_jacobian(q)[1] for q in sides)
        slopes[..., axis] = (ahead - behind) / (2.0 * STEP_M)
    return jacobian, slopes
