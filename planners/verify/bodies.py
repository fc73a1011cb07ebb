"""Judging bodies: does a link go through another one, or through the terrain?

Key frames are judged with the angles that joints are judged with, and the path between them at
moments a centimetre apart (``planners.motion``), on which the runner drives the joints. Links are
the shapes of the robot's file, the terrain is ``Obstacles``; a foot may be in the surface it stands
on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..answer.report import LATE, Group
from ..arguments import cached_property
from ..errors import InvalidInput, TimeEnded
from ..files.arrays import Array
from ..files.documents import shown
from ..plugins import Registry, foreign, takes
from .trajectory_measurements import (
    GROUPS,
    WHOLE_BODY,
    TrajectoryMeasurements,
    as_far_as_known,
    rms,
    worst_group,
)

if TYPE_CHECKING:
    from ..robot.bodies import Bodies
    from ..robot.inverse_kinematics import Overlap, WholeBody
    from ..robot.kinematics import Kinematics
    from ..terrain.obstacles import Obstacles


FURTHER: Registry[Callable[[Plan], Group]] = Registry(
    "verifier group",
    "stancekit.verifier_groups",
    {},
    expected="a function of a Plan",
    accepts=lambda it: takes(it, 1),
)
"""The further groups by name; the package itself has none."""


@cache
def _of_packages() -> tuple[str, ...]:
    """The names of entry points; which packages are installed does not change while a process
    runs.
    """
    registered = FURTHER.registered()
    return tuple(name for name in FURTHER.names() if name not in registered)


def further_groups(plan: Plan) -> tuple[Group, ...]:
    """The further groups of a plan.

    Raises InvalidInput for a function that returns something else.
    """
    groups = []
    for name in dict.fromkeys((*_of_packages(), *FURTHER.registered())):
        with foreign(f"verifier group {name}"):
            group = FURTHER.get(name)(plan)
        if not isinstance(group, Group):
            raise InvalidInput(f"verifier group {name}: expected a Group, got {shown(group)}")
        groups.append(group)
    return tuple(groups)


_NO_ANGLES = "the plan has no joint angles that the motion could go through"


def spaced(points_m: Array, angles_rad: Array) -> NDArray[np.intp]:
    """The fewest samples of a motion that are no farther apart than ``APART_M`` and ``TURN_RAD``,
    with the first and the last.

    Arguments:
        points_m: feet and body's origin at every sample, shape (K, P, 3) [m].
        angles_rad: of the joints, shape (K, J).
    """
    from ..motion.joints import TURN_RAD  # slow to import
    from ..motion.path import APART_M

    chosen = [0]
    for k in range(1, len(points_m) - 1):
        moved = np.linalg.norm(points_m[k + 1] - points_m[chosen[-1]], axis=1).max()
        if moved > APART_M or np.abs(angles_rad[k + 1] - angles_rad[chosen[-1]]).max() > TURN_RAD:
            chosen.append(k)
    return np.unique([*chosen, len(points_m) - 1])


def bodies_group(
    name: str,
    bodies: Bodies,
    frames: Array,
    postures: WholeBody,
    astray: tuple[str, float] = ("", 0.0),
    *,
    between: bool = False,
    deadline: float = math.inf,
) -> Group:
    """The group of links that go through something, with how many postures were judged, in how many
    a link is too deep in something, and the deepest.

    Figures: drawn_so, pairs of links that are inside each other in every posture, and are left out;
    short_m, what is missing to bodies that are clear: of the distance between links what is less
    than ``ROOM_M``, of that of links from the terrain what is less than ``TOUCH_M``, of the depth of
    feet in it what is more, and how far a foot is off its path.

    Arguments:
        name: of the group.
        bodies: the robot's links, and the terrain.
        frames: progress of every posture, shape (T,).
        postures: the T postures.
        astray: of a foot that cannot follow its path, empty where all do; and how far it is off [m].
        between: whether the postures follow each other, and what is only on the way from one to the
            next is judged, too. Whether they are near enough to each other to stand for the motion
            between them is their maker's to see to.
        deadline: as of ``check_bodies``.
    """
    from ..robot.bodies import LINKS_M, ROOM_M, TOUCH_M  # slow to import

    deepest: tuple[Overlap, float] | None = None
    count, hit, on_the_way, missing, at = 0, 0, 0, bodies.missing, np.arange(len(frames))
    short_m = astray[1] if astray[0] else 0.0
    on_ground_m = {leg.foot: -TOUCH_M for leg in bodies.model.legs}  # links but feet want room
    for count, near in bodies.sweep(postures, terrain_m=-TOUCH_M, links_m=-ROOM_M, between=between):
        missing_m = (
            depth_m + (ROOM_M if other in bodies.links else on_ground_m.get(link, TOUCH_M))
            for _, (depth_m, link, other) in near
        )
        short_m = max(short_m, *missing_m, 0.0)
        overlaps = [
            (moment, (depth_m, link, other))
            for moment, (depth_m, link, other) in near
            if depth_m > (LINKS_M if other in bodies.links else TOUCH_M)
        ]
        ways = sum(moment % 1.0 > 0.0 for moment, _ in overlaps)
        hit += ways + len({moment for moment, _ in overlaps if not moment % 1.0})
        on_the_way += ways
        for moment, overlap in sorted(overlaps, key=lambda each: each[0]):
            if deepest is None or overlap[0] > deepest[0][0]:
                deepest = overlap, float(np.interp(moment, at, frames))
        if time.perf_counter() > deadline and count < len(frames):
            missing = (f"{LATE} after {count} postures", *missing)
            break
    fault, worst, place = astray[0], None, ""
    postures_judged, depth_m, frame = count + on_the_way, 0.0, None
    if deepest is not None:
        (depth_m, place, other), frame = deepest
        worst = {"frame": frame, "link": place, "other": other}
        when = f"frame {frame:.3g}" if frame % 1.0 else f"frame {frame:.0f}"
        more = f", the deepest of {hit} of {postures_judged} postures" if hit > 1 else ""
        more += f"; {fault}" if fault else ""
        fault = f"{when}: {place} is {1e3 * depth_m:.3g} mm inside {other}{more}"
    return Group(
        name=name,
        value=depth_m,
        unit="m",
        where=place,
        when=frame,
        message=fault or "; ".join(missing),
        verdict="violated" if fault else "not checked" if missing else "holds",
        figures={
            "postures": postures_judged,
            "hit": hit,
            "depth_m": depth_m,
            "short_m": short_m,
            "worst": worst,
            "drawn_so": [list(pair) for pair in bodies.drawn_so],
        },
    )


def check_bodies(
    plan: Plan, angles: Array, solver: Kinematics, *, deadline: float = math.inf
) -> tuple[Group, ...]:
    """The groups ``bodies``, of every key frame of a plan with these angles, shape (M, J) [rad],
    and, where limbs carry between them, ``motion``, of the path through them where they are the
    plan's own.

    Arguments:
        deadline: when to stop (``time.perf_counter()``); what was not looked at by then is not
            checked.

    Raises:
        InvalidInput: without coal.
    """
    from ..motion.joints import STRAY_M, joints_along, key_postures  # slow to import
    from ..robot.bodies import Bodies
    from ..terrain.obstacles import Obstacles

    bodies = Bodies(solver, Obstacles.of(plan.problem.terrain))
    keys = key_postures(plan, angles)
    group = bodies_group("bodies", bodies, np.arange(float(len(angles))), keys, deadline=deadline)
    if plan.problem.robot.absent and group.verdict == "holds":
        absent = ", ".join(plan.problem.robot.absent)
        group = replace(
            group, verdict="not checked", message=f"legs {absent}: where they are is unknown"
        )
    if plan.problem.uncarried:
        return (group,)  # nobody asks for a motion
    unchecked = (
        _NO_ANGLES if plan.joints_rad is None else LATE if time.perf_counter() > deadline else ""
    )
    if unchecked:
        return group, Group("motion", unit="m", message=unchecked, verdict="not checked")

    def motion() -> Group:
        moments, postures = joints_along(plan, solver, deadline=deadline)
        assert postures.error_m is not None
        stray_m = float(postures.error_m.max())
        astray = (
            (_astray(plan, moments.frame, postures.error_m), stray_m)
            if stray_m > STRAY_M
            else ("", 0.0)
        )
        return bodies_group(
            "motion", bodies, moments.frame, postures, astray, between=True, deadline=deadline
        )

    return group, looked_at("motion", motion)


def looked_at(name: str, look: Callable[[], Group]) -> Group:
    """The group of bodies that a look gives; not checked, and why, where nobody can look: of legs
    that are not known, without pinocchio or coal, or when the time ended.
    """
    try:
        return look()
    except (InvalidInput, TimeEnded) as error:
        return Group(name, unit="m", message=str(error), verdict="not checked")


def _astray(plan: Plan, frames: Array, error_m: Array) -> str:
    """Message about the foot that is farthest from its path."""
    row, limb = (int(i) for i in np.unravel_index(int(np.argmax(error_m)), error_m.shape))
    name = plan.problem.robot.limb_names[limb]
    return f"frame {frames[row]:.3g}: the foot of {name} stays {1e3 * error_m[row, limb]:.3g} mm from its path"


class MovingBodyMeasurements:
    """Measurements of one motion of a robot that has a model; K samples on a uniform grid, N legs,
    J joints.

    Raises InvalidInput without pinocchio.

    Arguments:
        postures: at every sample.
        kinematics: of the robot.
        times_s: shape (K,).
        com_m: of the whole robot, shape (K, 3).
        normals: of what is below the feet, as the verifier has it, shape (K, N, 3).
        forces_n: shape (K, N, 3) [N].
    """

    def __init__(
        self,
        postures: WholeBody,
        kinematics: Kinematics,
        *,
        times_s: Array,
        com_m: Array,
        normals: Array,
        forces_n: Array,
    ) -> None:
        from ..robot.urdf_reader import pinocchio  # slow to import

        self.kinematics, self.postures, self._pin = kinematics, postures, pinocchio()
        self.feet, self.times_s, self.com_m = kinematics.robot.limb_names, times_s, com_m
        self.normals, self.forces_n = normals, forces_n
        self.step_s = float(times_s[-1] - times_s[0]) / (len(times_s) - 1)
        self._known = self.kinematics.known
        self._data = self._known.createData()

    @cached_property
    def _legs(self) -> tuple[Array, Array]:
        """Centres of the feet and levers of the joints in the base's frame, shapes (K, N, 3) [m] and
        (K, J, 3), by one sweep.
        """
        solver = self.kinematics
        swept = [(solver.feet(angles), solver.levers(angles)) for angles in self.postures.angles]
        feet, levers = zip(*swept, strict=True)
        return np.array(feet), np.array(levers)

    def off_toes(self) -> Array:
        """Distance of every foot, as the URDF has it within the joints' limits, from where it
        touches, (K, N) [m].
        """
        body = self.postures
        wanted = body.toes_m + self.kinematics.radii_m[:, None] * self.normals
        placed = np.einsum("kij,knj->kni", body.rotation, self._legs[0])
        return np.asarray(np.linalg.norm(body.origin_m[:, None] + placed - wanted, axis=-1))

    def speed(self) -> Array:
        """Joint speed between samples as a share of the joint's limit; 0 where its file has none,
        (K − 1, J).
        """
        most = self.kinematics.velocity_rad_s
        return np.asarray(np.abs(self.rates_rad_s) / np.where(most > 0.0, most, np.inf))

    @cached_property
    def rates_rad_s(self) -> Array:
        """Speeds of the joints between samples, shape (K − 1, J) [rad/s, or m/s where one slides]."""
        return self.kinematics.turned_rad(self.postures.angles) / self.step_s

    # ----------------------------------------------------------------------------------------------
    # dynamics

    @cached_property
    def _states(self) -> tuple[Array, Array]:
        """The whole robot as pinocchio has it, shape (K, nq), and its velocity between samples, (K
        − 1, nv).
        """
        pin, solver, body = self._pin, self.kinematics, self.postures
        states = np.array([solver.configuration(angles) for angles in body.angles])
        for state, turn, origin in zip(states, body.rotation, body.origin_m, strict=True):
            state[solver.base] = pin.SE3ToXYZQUAT(solver.carried(turn, origin))
        velocity = [pin.difference(self._known, a, b) for a, b in pairwise(states)]
        return states, np.array(velocity) / self.step_s

    @cached_property
    def torques_nm(self) -> Array:
        """Torques of the joints at the inner samples, (K − 2, J) [Nm]: τ = M q̈ + C q̇ + g − Σ Jᵢᵀ
        fᵢ + I q̈ + r(q̇), the rows of the joints, with the whole robot moving as the trajectory has
        it and the feet pressed by its forces; I of the rotors, r of damping and friction.
        """
        return self._torques(self.forces_n)

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
        rotation, forces = self.postures.rotation[1:-1], forces_n[1:-1]
        levers = self._legs[1][1:-1] @ np.swapaxes(rotation, 1, 2)
        turned = solver.rotor_kg_m2 * rising[:, solver.columns]
        turned += solver.resistance(velocity[:, solver.columns])
        return np.asarray(moved + turned - np.einsum("kji,kji->kj", levers, forces[:, solver.legs]))

    def legs_moment(self) -> Array:
        """dL/dt − Σ (p_i − p) × f_i at the inner samples with L of the whole robot, legs and all,
        (K − 2, 3) [Nm].

        What legs that swing do to the balance of moments: motions are planned for one rigid body (W
        §III-A). Forces need no such row, for the centre of mass is the whole robot's.
        """
        arms = self.postures.toes_m - self.com_m[:, None]
        moments = np.cross(arms, self.forces_n).sum(axis=1)
        return np.asarray(self.momentum_rates[:, 3:] - moments[1:-1])

    @cached_property
    def momentum_rates(self) -> Array:
        """Rates of the whole robot's momentum and of that about its centre of mass at the inner
        samples, shape (K − 2, 6) [N, Nm].
        """
        pin, known = self._pin, self._known
        states, between = self._states
        momentum = list[Array]()
        for state, velocity in zip(states[:-1], between, strict=True):
            half = pin.integrate(known, state, 0.5 * self.step_s * velocity)
            found = pin.computeCentroidalMomentum(known, self._data, half, velocity)
            momentum.append(np.concatenate([found.linear, found.angular]))
        return np.asarray(np.diff(np.array(momentum), axis=0) / self.step_s)

    @cached_property
    def centres_of_mass_m(self) -> Array:
        """Centre of mass of the whole robot in its postures, shape (K, 3)."""
        states, _ = self._states
        centres = [self._pin.centerOfMass(self._known, self._data, q).copy() for q in states]
        return np.array(centres)

    # ------------------------------------------------------------------------------------------------
    # bodies

    def bodies(self, name: str, obstacles: Obstacles) -> Group:
        """The group of links against each other and against obstacles, all the way.

        Raises InvalidInput without coal.
        """
        from ..robot.bodies import Bodies

        return bodies_group(name, Bodies(self.kinematics, obstacles), *self.spaced(), between=True)

    def spaced(self) -> tuple[Array, WholeBody]:
        """Postures that are as near to each other as ``spaced`` has them: their times, shape (T,)
        [s], and they.
        """
        body = self.postures
        rows = spaced(np.concatenate([body.toes_m, body.origin_m[:, None]], axis=1), body.angles)
        return self.times_s[rows], body.at(rows)


def nothing(why: str, units: Mapping[str, str] | None = None) -> list[Group]:
    """None of some groups measured, and why.

    Arguments:
        units: of the groups by name; None for those of ``WHOLE_BODY``.
    """
    names = units or {name: GROUPS[name] for name in WHOLE_BODY}
    return [Group(name, unit=names[name], message=why, verdict="not checked") for name in names]


def whole_body(measured: TrajectoryMeasurements, limits: Mapping[str, float]) -> list[Group]:
    """The groups of ``WHOLE_BODY``; none is checked for a robot of boxes or without pinocchio.

    Arguments:
        limits: what is allowed of each.
    """
    try:
        body = WholeBodyMeasurements(measured)
    except InvalidInput as error:  # legs that nobody knows, or no pinocchio
        return nothing(str(error))
    model, joints, times_s = body.kinematics.model, body.kinematics.joints, body.times_s
    slow = np.any(body.kinematics.velocity_rad_s <= 0.0)
    shares, swung = np.abs(body.torques_nm) / body.kinematics.torque_nm, body.legs_moment()
    groups = [
        as_far_as_known(worst_group(name, values, limit, GROUPS[name], names, times), why)
        for name, values, limit, names, times, why in (
            (
                "joints",
                body.off_toes(),
                limits["joints_m"],
                body.feet,
                times_s,
                "; ".join(model.limit_doubts),
            ),
            (
                "joint_speed",
                body.speed(),
                limits["joint_speed"],
                joints,
                times_s[1:],
                "no limit of the joints' speed in the robot's file" if slow else "",
            ),
            (
                "torque",
                shares,
                limits["torque"],
                joints,
                times_s[1:-1],
                "; ".join(model.lines_of(model.torque_doubts)),
            ),
        )
    ]
    most = limits["legs_moment"] * measured.moment_scale_nm
    sizes = np.linalg.norm(swung, axis=1)
    groups.append(measured.group("legs_moment", sizes, most, judged=rms(swung)))
    return [*groups, looked_at("bodies", lambda: body.overlap(limits["bodies_m"]))]


class WholeBodyMeasurements(MovingBodyMeasurements):
    """Measurements of one trajectory of a robot that has a model; K samples, N legs, J joints.

    Raises InvalidInput without pinocchio, and for a robot without a model.
    """

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        from ..motion.joints import walk_postures  # slow to import

        walk = measured.trajectory
        super().__init__(
            *walk_postures(walk),
            times_s=walk.times_s,
            com_m=walk.torso_m,
            normals=measured.ground[1],
            forces_n=walk.forces_n,
        )
        self.trajectory = walk

    def overlap(self, limit_m: float) -> Group:
        """The deepest that a link is inside another or inside the ground, and which links; what has
        no shape is not checked.

        Raises InvalidInput without coal.
        """
        from ..terrain.obstacles import Obstacles

        found = self.bodies("bodies", Obstacles.under(self.trajectory.problem.terrain))
        place, when = "", float(self.times_s[0])
        if worst := found.figures["worst"]:
            place, when = f"{worst['link']} in {worst['other']}", worst["frame"]
        deepest = Group("bodies", found.value, limit_m, "m", where=place, when=when)
        return as_far_as_known(deepest, found.message)
