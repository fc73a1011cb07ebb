"""Remainders of a trajectory's balances, and the feet that could supply them: windows of impulse,
cones with what is missing.

The forces of a file balance its motion up to a residual. A robot has to find that residual
somewhere: its feet have to press it out of the ground besides their own forces, within the same
cones, and no window of time may add it up.
"""

from __future__ import annotations

import numpy as np

from ..cached import cached_property
from ..files.arrays import Array
from .trajectory_measurements import TrajectoryMeasurements
from .trajectory_series import Series

MOST_EDGES = 4000
"""Windows begin and end at every sample of trajectories up to so many, and at every so-manieth of
longer ones."""
EVEN = 1e-9
"""Normal force of all feet below which there is none, in units of m·g."""


class MomentumMeasurements:
    """Measurements of the residuals of one trajectory, and of its two ends."""

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        self._measured, self.trajectory = measured, measured.trajectory
        self.times_s, self.step_s = measured.times_s, measured.step_s

    # ------------------------------------------------------------------------------------------------
    # windows

    def impulse(self, rate_n: float) -> Series:
        """‖∫ (m (a − g) − Σ f) dt‖ over every window, less ``rate_n`` a second of it, shape (1, 1)
        [N s].
        """
        return self._windows(self._measured.force_residual(), rate_n)

    def angular_impulse(self, rate_nm: float) -> Series:
        """‖∫ (dL/dt − Σ (p_i − p) × f_i) dt‖ over every window, less ``rate_nm`` a second of it [N
        m s].
        """
        return self._windows(self._measured.moment_residual(), rate_nm)

    def _windows(self, residual: Series, rate: float) -> Series:
        impulses = (
            np.concatenate([np.zeros((1, 3)), np.cumsum(residual.values, axis=0)]) * self.step_s
        )
        stride = 1 + (len(impulses) - 1) // MOST_EDGES
        edges = np.unique(np.append(np.arange(0, len(impulses), stride), len(impulses) - 1))
        sums, lasts = np.ascontiguousarray(impulses[edges].T), edges * self.step_s
        worst, begins = 0.0, 0
        most = float(np.linalg.norm(np.ptp(sums, axis=1)))  # of any window
        for apart in range(1, len(edges)):
            if most - rate * (apart - 1) * stride * self.step_s <= worst:
                break  # nor have longer ones more
            within = sums[:, apart:] - sums[:, :-apart]
            size = np.sqrt(np.einsum("ik,ik->k", within, within)) - rate * (
                lasts[apart:] - lasts[:-apart]
            )
            at = int(size.argmax())
            if size[at] > worst:
                worst, begins = float(size[at]), int(edges[at])
        return Series(np.array([[worst]]), ("torso",), self.times_s[[begins + 1]])

    # ---------------------------------------------------------------------------------------------
    # traction

    @cached_property
    def _lacking(self) -> Array:
        """Part of the force that the motion needs and that cones cannot give, of all feet, shape (K
        − 2,) [N].

        The force residual is added to the standing feet by their shares of the normal force. What
        ‖f_t‖ has beyond ν (f_n + s) counts, and any pull beyond the suction s; where no foot
        presses the residual counts whole.
        """
        trajectory, residual = self.trajectory, self._measured.force_residual().values
        normals, stands = self._measured.ground[1][1:-1], trajectory.contact[1:-1]
        forces = trajectory.forces_n[1:-1]
        presses = np.where(stands, np.maximum(np.sum(forces * normals, axis=-1), 0.0), 0.0)
        whole = presses.sum(axis=1)
        carried = whole > EVEN * self._measured.weight_n
        shares = presses / np.where(carried, whole, 1.0)[:, None]
        supplied = forces + shares[..., None] * residual[:, None]
        beyond = self._measured.beyond_cone(supplied, normals, self._measured.suction_n)
        lacking = np.where(stands, np.maximum(beyond, 0.0), 0.0).sum(axis=1)
        return np.asarray(np.where(carried, lacking, np.linalg.norm(residual, axis=1)))

    def traction(self) -> Series:
        """Force that the motion needs and that the standing feet's cones cannot give, shape (K − 2,
        1) [N].
        """
        return Series(self._lacking[:, None], ("torso",), self.times_s[1:-1])

    def traction_impulse(self) -> Series:
        """Impulse of that part over the whole walk, up to each sample [N s]."""
        return Series(
            np.cumsum(self._lacking)[:, None] * self.step_s, ("torso",), self.times_s[1:-1]
        )

    def traction_way(self) -> Series:
        """Distance that the centre of mass gets by it, up to each sample, as if all of it pushed
        one way [m].
        """
        speed = self.traction_impulse().values / self.trajectory.robot.mass_kg
        return Series(np.cumsum(speed, axis=0) * self.step_s, ("torso",), self.times_s[1:-1])

    def traction_turn(self) -> Series:
        """Angle that the torso turns about the vertical by moments that the standing feet cannot
        give [rad].

        A foot gives at most ‖r‖ (‖n‖ + ν) (f_n + s) about the vertical through the centre of mass,
        all horizontal.
        """
        trajectory, normals = self.trajectory, self._measured.ground[1][1:-1]
        arms = (trajectory.feet_m - trajectory.torso_m[:, None])[1:-1]
        forces, stands = trajectory.forces_n[1:-1], trajectory.contact[1:-1]
        needed = (
            self._measured.moment_residual().values[:, 2] + np.cross(arms, forces).sum(axis=1)[:, 2]
        )
        presses = np.maximum(np.sum(forces * normals, axis=-1), 0.0) + self._measured.suction_n
        level = np.linalg.norm(normals[..., :2], axis=-1) + trajectory.friction
        moments = np.where(
            stands, np.linalg.norm(arms[..., :2], axis=-1) * level * presses, 0.0
        ).sum(axis=1)
        lacking = (
            np.maximum(np.abs(needed) - moments, 0.0)
            / np.linalg.eigvalsh(np.asarray(trajectory.robot.inertia_kgm2))[-1]
        )
        turned = np.cumsum(np.cumsum(lacking)) * self.step_s**2
        return Series(turned[:, None], ("torso",), self.times_s[1:-1])

    def angular_residual(self) -> Series:
        """Angular acceleration that the moments of the feet do not explain, shape (K − 2, 1)
        [rad/s²].
        """
        rotation, missing = self.trajectory.rotation[1:-1], self._measured.moment_residual().values
        moment = np.einsum("kji,kj->ki", rotation, missing)
        rate = np.linalg.solve(np.asarray(self._measured.robot.inertia_kgm2), moment.T).T
        return Series(np.linalg.norm(rate, axis=1)[:, None], ("torso",), self.times_s[1:-1])

    # -------------------------------------------------------------------------------------------
    # both ends

    def heading(self) -> Series:
        """Angle of the torso's x axis, seen from above, off the headings asked for at both ends,
        (2, 1) [rad].
        """
        headings = (self.trajectory.heading_rad, self.trajectory.heading_end_rad)
        axes = self.trajectory.rotation[[0, -1], :, 0]
        off = [
            0.0 if rad is None else float(np.arctan2(x[1], x[0])) - rad
            for rad, x in zip(headings, axes, strict=True)
        ]
        away = np.abs((np.array(off) + np.pi) % (2.0 * np.pi) - np.pi)
        return Series(away[:, None], ("torso",), self.times_s[[0, -1]])

    def rest(self) -> Series:
        """Speed of torso and feet, turning at the stand height, at the ends asked to be at rest
        [m/s].
        """
        points = np.concatenate([self.trajectory.feet_m, self.trajectory.torso_m[:, None]], axis=1)
        speed = np.linalg.norm(points[self._ends(1)] - points[self._ends(0)], axis=-1) / self.step_s
        turning = (
            np.linalg.norm(self._measured.spin[self._ends(0, 1)], axis=1)
            * self._measured.robot.stand_height_m
        )
        speed[:, -1] = np.maximum(speed[:, -1], turning)
        return Series(speed, (*self._measured.feet, "torso"), self.times_s[self._ends(0)])

    def rest_acceleration(self) -> Series:
        """Acceleration of the torso at the ends asked to be at rest, on a line through the next two
        samples [m/s²].
        """
        felt = self._measured.acceleration
        felt = np.linalg.norm(2.0 * felt[self._ends(0, 2)] - felt[self._ends(1, 2)], axis=1)
        return Series(felt[:, None], ("torso",), self.times_s[self._ends(0)])

    def _ends(self, step: int, shorter: int = 0) -> list[int]:
        """The first samples, the last ones, or none: as the task asks; ``step`` inwards of a series
        so much shorter.
        """
        last = self.trajectory.samples - 1 - shorter
        starts, stops = self.trajectory.still
        return [step] * starts + [last - step] * stops
