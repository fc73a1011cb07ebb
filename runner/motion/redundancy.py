"""Which of a limb's postures to take along a motion: four joints have one more than a foot's position needs.

Chosen for every limb at once over the whole motion, by dynamic programming over the closed-form family of postures
(``planners.robot.leg_ik``): comfortable ones, and near each other, so that no joint jumps from one branch to another
and no limb walks into a joint limit that a posture on the way would have avoided.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg_ik import clearance_of, posture_cost
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.urdf import link_lengths, outward_rad
from stancekit.planners.terrain.prism import Solid

from .motion import Motion, MotionSample

ROUGH = 10
"""The shift of the centre of mass, which depends on the postures, is looked at at every tenth knot."""
TURNED = 100.0
"""Cost of a turn of 1 rad between two knots, squared, in the units of a posture's discomfort at one knot."""
LEFT = 60.0
"""The same for the first posture, as far as it is from where the robot is."""
SMOOTHED = 2.0
"""Standard deviation of the smoothing over the family's steps, in knots; what it moves of a foot the tracker undoes."""


class RedundancyResolution:
    """Comfortable joint angles over a motion: what inverse kinematics is drawn to. ``at`` a time: shape (J,) [rad]."""

    def __init__(self, motion: Motion, kinematics: Kinematics, near_rad: Array | None = None) -> None:
        times = motion.knots_s
        samples = [motion.at(float(time_s)) for time_s in times]
        shifts = np.zeros((len(times), 3))
        _, rough = _families(samples, shifts, motion.solids, kinematics, slice(None, None, ROUGH))
        shifts = np.repeat([kinematics.com_offset(q) for q in rough], ROUGH, axis=0)[: len(times)]
        tables, _ = _families(samples, shifts, motion.solids, kinematics, slice(None))
        near = None if near_rad is None else np.asarray(near_rad).reshape(len(tables), -1)
        chosen = [_cheapest(table, None if near is None else near[limb]) for limb, table in enumerate(tables)]
        path = np.concatenate([gaussian_filter1d(q, SMOOTHED, axis=0, mode="nearest") for q in chosen], axis=1)
        self._angles = make_interp_spline(times, path, k=3)
        self._end = float(times[-1])

    def at(self, time_s: float) -> Array:
        """The ends are held."""
        return np.asarray(self._angles(min(max(time_s, 0.0), self._end)))


Table = list[tuple[Array, Array]]
"""Postures of one limb, shape (K, 4), and what they cost, shape (K,), at every knot."""


def _families(
    samples: Sequence[MotionSample], shifts: Array, solids: Sequence[Solid], kinematics: Kinematics, chosen: slice
) -> tuple[list[Table], Array]:
    """Tables of all limbs, and the cheapest postures at every knot alone, shape (T, J)."""
    tables = list[Table]()
    for i, limb in enumerate(kinematics.robot.limbs):
        frame, table = rotation_of([0.0, 0.0, outward_rad(limb)]), Table()
        for sample, shift in zip(samples[chosen], shifts[chosen], strict=True):
            turn = rotation_of(sample.rotation_rad)
            origin = sample.com_m - turn @ shift
            shoulder, toward = origin + turn @ limb.shoulder_m, turn @ frame
            close = [solid for solid in solids if solid.distance(shoulder[None])[0] < 1.3 * limb.reach_m]
            table.append(
                posture_cost(
                    link_lengths(limb), toward.T @ (sample.feet_m[i] - shoulder), -toward.T @ sample.normals[i],
                    kinematics.servo, clearance=clearance_of(shoulder, toward, close) if close else None,
                )
            )  # fmt: skip
        tables.append(table)
    alone = [[family[np.argmin(cost)] for family, cost in table] for table in tables]
    return tables, np.concatenate([np.array(rows) for rows in alone], axis=1)


def _cheapest(table: Table, near: Array | None) -> Array:
    """The cheapest path through a table, shape (T, 4)."""
    family, cost = table[0]
    total = cost if near is None else cost + LEFT * np.sum((family - near) ** 2, axis=1)
    back = list[Array]()
    for (before, _), (after, cost) in pairwise(table):
        far = np.sum(before**2, axis=1)[:, None] + np.sum(after**2, axis=1) - 2.0 * before @ after.T
        through = total[:, None] + TURNED * far
        back.append(np.argmin(through, axis=0))
        total = through.min(axis=0) + cost
    index = [int(np.argmin(total))]
    for row in reversed(back):
        index.append(int(row[index[-1]]))
    found = np.array([family[k] for (family, _), k in zip(table, reversed(index), strict=True)])
    if near is not None:
        found[0] = near
    return found
