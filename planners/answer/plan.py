"""A plan of key frames, or of one: what planners answer, in the world frame and SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..files.arrays import Array
from ..problem import Problem
from ..problem.leap import Leap
from ..robot.model import Robot
from ..robot.robot_file import joint_names
from ..terrain.patch import Frame, Patch
from .motion import Motion, dulled

NOBODY_CARRIES = "no limb carries between frames"
WHOLE_BODY = ("joints", "torque", "bodies", "motion")
"""Groups of a plan that are of more of the robot than its contacts; motion is bodies between key
frames."""
MARGIN = "margin"
"""The group of a plan that measures what its stances bear beyond the weight."""
LEAP_BODY = ("joints", "joint_speed", "torque", "legs_turn", "take_off", "landing", "bodies")
"""Groups of a leap that ask for a model of the robot's legs."""
LEAST_GATHER, MOST_GATHER = np.array([0.05, 0.1]), np.array([0.49, 1.0])
"""Least and largest share of a flight after which legs are drawn up, and of a fold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapPlan(Motion):
    """One answer to a leap, in the world frame and SI units.

    Nothing is checked here: ``check_leap`` does it.

    Arguments:
        problem: the leap that was answered.
        timing: index of the chosen timing.
        choice: a candidate per foothold, shape (P,).
        toes_m: shape (P, 3) [m].
        forces_n: constant force of every limb in every interval, shape (M, N, 3) [N].
        com_m, velocity_m_s, momentum_m2_s, rotation_rad: c, v, L per mass and Θ at the ends of the
            intervals, which follow from the forces; shape (M + 1, 3) each.
        legs_turn_rad: turn of the body by swinging legs in every interval, in addition to that by
            L, as far as known, shape (M, 3) [rad]; None for legs without mass, as of a robot with
            limbs alone.
        gather: how legs are drawn up in flight, shape (2,): after which share of it, 0.05 to 0.49,
            and how long they are then as a share of the shorter of their lengths at both ends, 0.1
            to 1; None for (0.3, 0.8).
        provenance: origin, names to texts or numbers.

    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.

    Example:
        >>> import numpy as np, stancekit
        >>> from stancekit.planners.problem.leap_classes import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> from stancekit.planners.motion.gait_motion import feet_motion
        >>> feet_motion(stancekit.plan(leap).solution).at(np.array([0.0, 0.5])).com_m.shape
        (2, 3)
    """

    WORD: ClassVar[str] = "leap"
    MOMENT: ClassVar[str] = "interval"
    BODY: ClassVar[tuple[str, ...]] = LEAP_BODY
    LATER: ClassVar[tuple[str, ...]] = ("legs_turn_rad", "gather")
    problem: Leap
    timing: int
    choice: NDArray[np.int_]
    com_m: Array
    velocity_m_s: Array
    momentum_m2_s: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    legs_turn_rad: Array | None = None
    gather: Array | None = None
    provenance: Mapping[str, str | float] = field(default_factory=dict)

    def __repr__(self) -> str:
        count, legs = len(self.forces_n), ", ".join(self.problem.robot.limb_names)
        return f"LeapPlan({self.problem.name}: {count} intervals of {legs})"

    @property
    def name(self) -> str:
        """Name of the leap."""
        return self.problem.name

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...]:
        """The chosen surfaces, with this share of their friction."""
        return dulled(patches_of(self), friction_share)

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes it: it has to begin and end at rest, and to be judged
        with its legs.
        """
        if not all(self.problem.still):
            return "it begins or ends in motion"
        return "its legs are not known: plan it with --robot FILE" if unchecked else ""

    @classmethod
    def shapes(cls, problem: Leap, rows: int = 0) -> Mapping[str, tuple[int, ...]]:
        """As of ``Motion``; the timing is one number."""
        count, placed = problem.intervals, len(problem.footholds)
        return {
            "timing": (),
            "choice": (placed,),
            "com_m": (count + 1, 3),
            "velocity_m_s": (count + 1, 3),
            "momentum_m2_s": (count + 1, 3),
            "rotation_rad": (count + 1, 3),
            "toes_m": (placed, 3),
            "forces_n": (count, len(problem.robot.limbs), 3),
            "legs_turn_rad": (count, 3),
            "gather": (2,),
        }

    @property
    def turned_rad(self) -> Array:
        """``legs_turn_rad``, 0 where it is not known, shape (M, 3) [rad]."""
        return (
            np.zeros((len(self.forces_n), 3)) if self.legs_turn_rad is None else self.legs_turn_rad
        )

    @property
    def times_s(self) -> Array:
        """Times at which the M intervals begin and end, shape (M + 1,) [s]."""
        return self.problem.times_s(self.timing)


PER_FRAME = ("com_m", "rotation_rad", "forces_n", "point_forces_n")
"""Arrays with a row a frame, or a stance; of a posture there is one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(Motion):
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
            order, shape (M, J) [rad, or m where a joint slides]; None where not worked out.
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

    WORD: ClassVar[str] = "plan"
    MOMENT: ClassVar[str] = "frame"
    BODY: ClassVar[tuple[str, ...]] = (*WHOLE_BODY, MARGIN)
    LATER: ClassVar[tuple[str, ...]] = ("modes", "joints_rad")
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

    def __repr__(self) -> str:
        name, frames, limbs = (
            self.problem.name,
            len(self.com_m),
            ", ".join(self.problem.robot.limb_names),
        )
        return f"Plan({name}: {frames} key frame{'s' if frames > 1 else ''} of {limbs})"

    @classmethod
    def shapes(cls, problem: Problem, rows: int = 0) -> Mapping[str, tuple[int, ...]]:
        """As of ``Motion``; joints of a posture are not computed."""
        frames, limbs = problem.frames, len(problem.robot.limbs)
        placed, stances = len(problem.footholds), len(problem.stances)
        shapes: dict[str, tuple[int, ...]] = {
            "com_m": (frames, 3),
            "rotation_rad": (frames, 3),
            "toes_m": (placed, 3),
            "choice": (placed,),
            "forces_n": (stances, limbs, 3),
        }
        if problem.has_soles:
            soles = (limb.sole_m for limb in problem.robot.limbs)
            points = max(1 if sole is None else len(sole) for sole in soles)
            shapes["points_m"] = (placed, points, 3)
            shapes["point_forces_n"] = (stances, limbs, points, 3)
        if (problem.robot.own and not problem.is_posture) or not problem.has_soles:
            joints = 0 if problem.is_posture else len(joint_names(problem.robot))
            shapes["joints_rad"] = (frames, joints)
        return {**shapes, "modes": (frames,)}

    @property
    def name(self) -> str:
        """Name of the problem."""
        return self.problem.name

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...]:
        """The terrain, or the patches that are taken where the problem has none, with this share of
        their friction.
        """
        return dulled(self.problem.terrain or patches_of(self), friction_share)

    def moment(self, when: float) -> str:
        """A key frame in words; a posture has one alone."""
        return "" if self.problem.is_posture else super().moment(when)

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes it, whatever the world; empty where one may."""
        course = self.problem
        if course.is_posture:
            return ""
        if course.uncarried:
            return NOBODY_CARRIES
        if course.has_soles and not course.robot.own:
            return "its feet are soles of unknown legs"
        return course.robot.hindrance

    def labels(self) -> dict[str, list[Any]]:
        """Names of rows and columns: limbs are columns of forces; toes have limb and key frame of
        every foothold, stances key frame and limbs of every row of forces.
        """
        course, names = self.problem, self.problem.robot.limb_names
        toes = [{"limb": each.limb, "frame": each.frame} for each in course.footholds]
        stances = [
            {"frame": each.frame, "limbs": [names[i] for i in each.limbs]}
            for each in course.stances
        ]
        known = {} if self.joints_rad is None else {"joints": list(joint_names(course.robot))}
        return {"limbs": list(names), "toes": toes, "stances": stances, **known}

    def moved(self, frame: Frame, robot: Robot) -> Plan:
        """The plan of a robot with point feet in a world that is moved with it, see
        ``Problem.moved``.
        """
        return replace(
            self,
            problem=self.problem.moved(frame, robot),
            com_m=frame.places(self.com_m),
            rotation_rad=frame.vectors(self.rotation_rad),
            toes_m=frame.places(self.toes_m),
            forces_n=frame.vectors(self.forces_n),
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
            points_m, point_forces_n: points of soles and their forces, shape (N, K, 3) each [m],
                [N].
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

    @property
    def moments_nm(self) -> Array | None:
        """Moments of the forces on soles about their middles, shape (S, N, 3) [Nm]; None of point
        feet.
        """
        if self.points_m is None or self.point_forces_n is None:
            return None
        arms = self.points_m - self.toes_m[:, None]
        holds = np.array([self.problem.holds[of.frame] for of in self.problem.stances])
        return np.asarray(np.cross(arms[holds], self.point_forces_n).sum(axis=2))

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


def patches_of(plan: Plan | LeapPlan) -> list[Patch]:
    """The patch that was chosen for every foothold."""
    return [plan.problem.patch(p, plan.choice) for p in range(len(plan.problem.footholds))]
