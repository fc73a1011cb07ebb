"""A plan of key frames: what the planners of a course answer, in the world frame and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..problem import Problem
from .posture import Posture


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """M key frames over a course of P footholds and S stances, for a robot with N limbs.

    Arguments:
        course: what it is a plan of.
        com_m: shape (M, 3) [m].
        rotation_rad: small body rotation Θ, shape (M, 3) [rad].
        toes_m: one a foothold, shape (P, 3) [m].
        choice: the candidate patch of every foothold, shape (P,).
        forces_n: forces on the robot in every stance, world frame, zero for limbs that do not carry in it, shape
            (S, N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points of every foot
            put down are, shape (P, K, 3) [m], and the forces at them, which add up to forces_n, (S, N, K, 3) [N]; see
            ``Posture``.
        joints_rad: angles at every key frame, of all joints of the robot's legs in its model's order, shape (M, J)
            [rad, or m where a joint slides]; None where nobody worked them out.
        modes: z, the envelope that mode switching chose for each frame, shape (M,); None without mode switching.
        provenance: how the plan was made, for people.
    Source:
        Paper E §IV-B, E11.
    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=3).solution
        >>> plan.toes_at(0).shape, plan.posture(0).forces_n.shape[1]
        ((6, 3), 3)
    """

    course: Problem
    com_m: Array
    rotation_rad: Array
    toes_m: Array
    choice: NDArray[np.int_]
    forces_n: Array
    points_m: Array | None = None
    point_forces_n: Array | None = None
    joints_rad: Array | None = None
    modes: NDArray[np.int_] | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind in (
            ("com_m", np.float64), ("rotation_rad", np.float64), ("toes_m", np.float64), ("forces_n", np.float64),
            ("choice", np.int_), ("modes", np.int_), ("points_m", np.float64), ("point_forces_n", np.float64),
            ("joints_rad", np.float64),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                array = np.array(getattr(self, name), dtype=kind)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    @classmethod
    def of_posture(cls, problem: Problem, posture: Posture) -> Plan:
        """The plan of one key frame that a posture is, over the same problem or over its course of one frame."""
        return cls(
            course=problem, com_m=posture.com_m[None], rotation_rad=posture.rotation_rad[None], toes_m=posture.toes_m,
            choice=np.zeros(len(problem.footholds), dtype=np.int_), forces_n=posture.forces_n[None],
            points_m=posture.points_m,
            point_forces_n=None if posture.point_forces_n is None else posture.point_forces_n[None],
        )  # fmt: skip

    def toes_at(self, frame: int) -> Array:
        """Where the toes of all limbs stand at a key frame, shape (N, 3) [m]."""
        return np.asarray(self.toes_m[self.course.holds[frame]])

    def forces_at(self, frame: int) -> Array:
        """Forces of all limbs at a key frame, shape (N, 3) [N]: the mean of its stances' forces.

        That is an answer itself: at one body pose and with the same toes both balances, the cones and the bounds, which
        admit no force, are convex in the forces.
        """
        rows = [index for index, stance in enumerate(self.course.stances) if stance.frame == frame]
        return np.asarray(self.forces_n[rows].mean(axis=0))

    def posture(self, stance: int) -> Posture:
        """The posture of one stance, its limbs only."""
        of = self.course.stances[stance]
        limbs = list(of.limbs)
        soles: dict[str, Array] = {}
        if self.points_m is not None and self.point_forces_n is not None:
            feet = [self.course.robot.limbs[i].sole_m for i in limbs]
            most = max(1 if sole is None else len(sole) for sole in feet)
            if most > 1:  # else nobody who carries has a sole
                soles["points_m"] = self.points_m[self.course.holds[of.frame, limbs], :most]
                soles["point_forces_n"] = self.point_forces_n[stance][limbs, :most]
        return Posture(
            com_m=self.com_m[of.frame],
            rotation_rad=self.rotation_rad[of.frame],
            toes_m=self.toes_at(of.frame)[limbs],
            forces_n=self.forces_n[stance][limbs],
            **soles,
        )
