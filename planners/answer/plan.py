"""A plan of key frames, or of one: what planners answer, in the world frame and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..files.arrays import Array
from ..problem import Problem

PER_FRAME = ("com_m", "rotation_rad", "forces_n", "point_forces_n")
"""Arrays with a row a frame, or a stance; of a posture there is one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """M key frames over a problem of P footholds and S stances, for a robot with N limbs.

    Nothing is checked here: ``verify`` does it.

    The plan of a posture problem has M = S = 1.

    Arguments:
        problem: what it is a plan of.
        com_m: shape (M, 3) [m].
        rotation_rad: small body rotation Θ, shape (M, 3) [rad].
        toes_m: one a foothold, shape (P, 3) [m].
        choice: the candidate patch of every foothold, shape (P,).
        forces_n: forces on the robot in every stance, world frame, zero for limbs that do not carry
            in it, shape (S, N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points
            of every foot put down are, shape (P, K, 3) [m], and the forces at them, which add up to
            forces_n, (S, N, K, 3) [N]. K is that of the foot of most points; one with fewer has its
            centre, and no force, in the places left.
        joints_rad: angles at every key frame, of all joints of the robot's legs in its model's
            order, shape (M, J) [rad, or m where a joint slides]; None where nobody worked them out.
        modes: z, the envelope that mode switching chose for each frame, shape (M,); None without
            mode switching.
        provenance: how the plan was made, for people.
    Source:
        Lin et al. §II and §IV-B, E11.

    Example:
        >>> import numpy as np, stancekit
        >>> plan = stancekit.plan("walls", frames=3).solution
        >>> plan.toes_at(0).shape, plan.posture(0).forces_n.shape
        ((6, 3), (1, 3, 3))
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> nothing = np.zeros((3, 3))
        >>> floating = stancekit.Plan.of_posture(problem, com_m=nothing[0], rotation_rad=nothing[0], toes_m=nothing,
        ...                                      forces_n=nothing)
        >>> stancekit.verify(floating).accepted
        False
    """

    problem: Problem
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
            ("com_m", np.float64),
            ("rotation_rad", np.float64),
            ("toes_m", np.float64),
            ("forces_n", np.float64),
            ("choice", np.int_),
            ("modes", np.int_),
            ("points_m", np.float64),
            ("point_forces_n", np.float64),
            ("joints_rad", np.float64),
        ):
            if getattr(self, name) is not None:
                array = np.array(getattr(self, name), dtype=kind)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        name, frames, limbs = (
            self.problem.name,
            len(self.com_m),
            ", ".join(self.problem.robot.limb_names),
        )
        return f"Plan({name}: {frames} key frame{'s' if frames > 1 else ''} of {limbs})"

    def moved(self, by_m: Array) -> Plan:
        """The plan in a world that is moved with it, by a vector of shape (3,) [m]."""
        return replace(
            self,
            problem=self.problem.moved(by_m),
            com_m=self.com_m + by_m,
            toes_m=self.toes_m + by_m,
            points_m=None if self.points_m is None else self.points_m + by_m,
        )

    @classmethod
    def of_posture(
        cls,
        problem: Problem,
        *,
        com_m: ArrayLike,
        rotation_rad: ArrayLike,
        toes_m: ArrayLike,
        forces_n: ArrayLike,
        points_m: ArrayLike | None = None,
        point_forces_n: ArrayLike | None = None,
    ) -> Plan:
        """The plan of a posture problem with N contacts, from arrays without axes of frames and
        stances.

        Arguments:
            problem: the posture problem.
            com_m, rotation_rad: shape (3,) each [m], [rad].
            toes_m, forces_n: shape (N, 3) each [m], [N].
            points_m, point_forces_n: of soles, shape (N, K, 3) each [m], [N].
        """
        return cls(
            problem=problem,
            com_m=np.asarray(com_m)[None],
            rotation_rad=np.asarray(rotation_rad)[None],
            toes_m=np.asarray(toes_m),
            choice=np.zeros(np.shape(toes_m)[:1], dtype=np.int_),
            forces_n=np.asarray(forces_n)[None],
            points_m=None if points_m is None else np.asarray(points_m),
            point_forces_n=None if point_forces_n is None else np.asarray(point_forces_n)[None],
        )

    def toes_at(self, frame: int) -> Array:
        """Places where the toes of all limbs stand at a key frame, shape (N, 3) [m]."""
        return np.asarray(self.toes_m[self.problem.holds[frame]])

    def forces_at(self, frame: int) -> Array:
        """Forces of all limbs at a key frame, shape (N, 3) [N]: the mean of the forces in its
        stances.

        The mean satisfies the constraints, too: body pose and toes are the same in these stances,
        and then balance, friction cones and force bounds are convex in the forces. A limb in the
        air counts with zero force, which the bounds admit.
        """
        rows = [index for index, stance in enumerate(self.problem.stances) if stance.frame == frame]
        return np.asarray(self.forces_n[rows].mean(axis=0))

    def posture(self, stance: int) -> Plan:
        """The plan of the posture problem of one stance: of one frame, with its limbs only."""
        of = self.problem.stances[stance]
        limbs = list(of.limbs)
        soles = dict[str, Array]()
        if self.points_m is not None and self.point_forces_n is not None:
            feet = [self.problem.robot.limbs[i].sole_m for i in limbs]
            most = max(1 if sole is None else len(sole) for sole in feet)
            if most > 1:  # else nobody who carries has a sole
                soles["points_m"] = self.points_m[self.problem.holds[of.frame, limbs], :most]
                soles["point_forces_n"] = self.point_forces_n[stance][limbs, :most]
        return Plan.of_posture(
            self.problem.posture_problem(of, self.choice),
            com_m=self.com_m[of.frame],
            rotation_rad=self.rotation_rad[of.frame],
            toes_m=self.toes_at(of.frame)[limbs],
            forces_n=self.forces_n[stance][limbs],
            **soles,
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready lists of a posture, as a line of answers has them: without the axes of frames
        and stances.
        """
        names = ("com_m", "rotation_rad", "toes_m", "forces_n", "points_m", "point_forces_n")
        arrays = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        alone = {name for name in PER_FRAME if name in arrays and arrays[name].shape[:1] == (1,)}
        return {
            name: (array[0] if name in alone else array).tolist() for name, array in arrays.items()
        }
