"""Needs of a motion of its joints: for a moment, on average, and of what their actuators can do and
bear.

Heat is that of the current through a winding, which grows with the torque's square: load' = ((τ /
τ_c)² − load) / T with the continuous torque τ_c and the time constant T. A joint that gives τ_c for
ever comes to a load of 1, and bears that; it begins cold, at 0. Where T is not known the load is
the mean of (τ / τ_c)²: what it comes to where the motion is repeated for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.actuators import ActuatorModel


@dataclass(frozen=True, kw_only=True, eq=False)
class JointNeeds:
    """Torque requirements of J joints, shape (J,) each.

    Arguments:
        peak_nm, rms_nm: largest torque over the motion, and its root mean square [Nm].
        stall_nm, continuous_nm: stall and continuous torque of the actuators [Nm]. continuous_nm,
            and heat, the largest thermal load during the motion, are NaN if the continuous torque
            is not known.
    """

    joints: tuple[str, ...]
    peak_nm: Array
    rms_nm: Array
    stall_nm: Array
    continuous_nm: Array
    heat: Array

    @classmethod
    def of(
        cls,
        joints: Sequence[str],
        actuators: Sequence[ActuatorModel],
        torques_nm: Array,
        period_s: float,
    ) -> Self:
        """Torque requirements of joints over a motion.

        Arguments:
            torques_nm: torques of the joints, shape (T, J) [Nm].
            period_s: time between two rows of ``torques_nm`` [s].
        """
        stall = np.array([each.stall_nm for each in actuators])
        continuous = np.array(
            [np.nan if each.continuous_nm is None else each.continuous_nm for each in actuators]
        )
        constants = np.array(
            [np.nan if each.thermal_s is None else each.thermal_s for each in actuators]
        )
        return cls(
            joints=tuple(joints),
            peak_nm=np.abs(torques_nm).max(axis=0),
            rms_nm=np.sqrt(np.mean(torques_nm**2, axis=0)),
            stall_nm=stall,
            continuous_nm=continuous,
            heat=thermal_load((torques_nm / continuous) ** 2, constants, period_s),
        )

    @property
    def share_of_stall(self) -> Array:
        """Peak torque as a share of the stall torque."""
        return self.peak_nm / self.stall_nm

    @property
    def share_of_continuous(self) -> Array:
        """Mean torque, by its square, as a share of the continuous one; NaN where it is not
        known.
        """
        return self.rms_nm / self.continuous_nm

    def said(self, joint: int) -> str:
        """Needs of one joint, in words."""
        heat = (
            f", {self.heat[joint]:.2g} times the heat that it bears"
            if self.heat[joint] > 1.0
            else ""
        )
        return f"{self.peak_nm[joint]:.3g} Nm at most and {self.rms_nm[joint]:.3g} Nm (RMS){heat}"

    @property
    def line(self) -> str:
        """The joint that needs the largest share, for people."""
        peak = int(np.argmax(self.share_of_stall))
        result = f"{self.peak_nm[peak]:.3g} Nm at most, {self.share_of_stall[peak]:.0%} of {self.joints[peak]}'s stall"
        if np.isnan(self.heat).all():
            return (
                f"{result}; {self.rms_nm.max():.3g} Nm (RMS), what it bears for long is not known"
            )
        worst = int(np.nanargmax(self.heat))
        rms, share = f"{self.rms_nm[worst]:.3g} Nm (RMS)", f"{self.share_of_continuous[worst]:.0%}"
        return (
            f"{result}; {rms}, {share} of {self.joints[worst]}'s continuous torque, "
            f"{self.heat[worst]:.2f} of the heat "
            "that it bears"
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready, by joint."""
        columns = {
            "peak_nm": self.peak_nm,
            "rms_nm": self.rms_nm,
            "of_stall": self.share_of_stall,
            "of_continuous": self.share_of_continuous,
            "heat": self.heat,
        }
        return {
            joint: {
                name: None if np.isnan(column[i]) else float(column[i])
                for name, column in columns.items()
            }
            for i, joint in enumerate(self.joints)
        }


def thermal_load(squares: Array, constants_s: Array, period_s: float) -> Array:
    """The largest load on the way from cold, shape (J,): of (τ / τ_c)², shape (T, J), so long
    apart.
    """
    decay = np.exp(-period_s / constants_s)
    load = worst = np.zeros(squares.shape[1])
    for row in squares:
        load = decay * load + (1.0 - decay) * row
        worst = np.maximum(worst, load)
    return np.where(np.isnan(constants_s), squares.mean(axis=0), worst)
