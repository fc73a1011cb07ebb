"""Forces for a robot that stands on given toes: the smallest ones that keep a reserve of friction
or of torque.

The forces of a planner may lie on the border of their friction cones, where a simulated or a real
foot slips, or they may need more torque than a joint has. If the toes and the body are fixed, the
balances are linear in the forces; if the joints are fixed too, so are the torques at rest. This is
therefore one small second-order cone program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..arguments import cached_property
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled, skew
from ..files.arrays import Array
from ..problem import Problem
from ..robot.inverse_kinematics import descend_legs
from ..robot.kinematics import Kinematics
from ..robot.leg import rotation_of
from ..terrain.patch import Patch

RESERVES = (0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98)
"""Shares of μ that are tried, the safest first."""
_STANDING = (0.5, 0.6, *RESERVES)
"""The same while all limbs stand: who has not moved yet does not know what friction there is."""
_TIES = 1e-4
"""Weight of Σ‖f‖² beside the largest torque's share, forces in units of the weight."""
EASY = 0.8
"""Forces that ask for no more than this share of any joint's torque are left as they are."""
_WEIGHT = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
LEAST = 0.02
"""Every limb that carries presses on its patch with this share of the weight or more, so that it
stays there."""


Loads = tuple[Array, Array, Array]
"""Parts of the torques of a robot at rest, of J joints: of the limbs' own masses, shape (J,) [Nm];
levers, shape (J, 3) [m], of which τ = weight − levers · f, f on the joint's own foot in the world
frame; and limits, shape (J,) [Nm], inf for none."""
_NONE: Loads = np.zeros(0), np.zeros((0, 3)), np.zeros(0)


class ForceDistribution:
    """Second-order cone program for the forces of N contacts: it minimises Σ‖f‖² subject to balance
    and to cones whose friction is a share of μ. If joints are given, it minimises the largest
    torque as a share of its limit instead.
    """

    def __init__(self, contacts: int, foot_of: Sequence[int] = ()) -> None:
        """The program of a number of contacts.

        Arguments:
            foot_of: the contact that every joint leads to, shape (J,): the largest torque as a
                share of its limit is then minimised, and forces only break ties.
        """
        # of a stance: arms map forces to their sum and moment, (6, 3N); friction (N,); low and high
        # bound forces, (N, 3); borne is their sum and moment, (6,); torques as shares of their
        # limits are rest − levers · f, (J,), (J, 3)
        self._contacts, self._foot_of = contacts, np.array(foot_of, dtype=int)
        self._rows = rows = Rows[SimpleNamespace](keep=True)
        forces = rows.variable("forces", contacts, 3)
        balance = rows.equal("balance", 6)
        rows.put(balance[:, None], forces.reshape(1, -1), lambda d: d.arms)
        rows.right(balance, lambda d: d.borne)
        most, least = rows.at_most("most", contacts, 3), rows.at_most("least", contacts, 3)
        rows.put(most, forces, 1.0)
        rows.put(least, forces, -1.0)
        rows.right(most, lambda d: d.high)
        rows.right(least, lambda d: -d.low)
        cone = rows.cones("cone", contacts, 3)
        rows.put(cone[:, 0], forces[:, 0], lambda d: -d.friction)
        rows.put(cone[:, 1:], forces[:, 1:], -1.0)
        rows.square(forces, None, _TIES if len(foot_of) else 1.0)
        if len(foot_of):
            share, joints = rows.variable("share", 1), len(foot_of)
            above, below = rows.at_most("above", joints), rows.at_most("below", joints)
            rows.put(above[:, None], forces[self._foot_of], lambda d: -d.levers)
            rows.put(below[:, None], forces[self._foot_of], lambda d: d.levers)
            rows.put(np.stack([above, below]), share, -1.0)
            rows.right(above, lambda d: -d.rest)
            rows.right(below, lambda d: d.rest)
            rows.linear(share, 1.0)

    def solve(
        self, plan: Plan, stance: int, *, reserves: Sequence[float] = RESERVES, least: float = LEAST
    ) -> Array | None:
        """Forces of a plan's stance, world frame, shape (N, 3) [N]; None where even the whole cones
        leave no room.

        Arguments:
            reserves, least: as ``forces``.
        """
        course, of = plan.problem, plan.problem.stances[stance]
        patches = [course.patch(int(index), plan.choice) for index in course.holds[of.frame]]
        bears = np.isin(np.arange(self._contacts), of.limbs)
        arms_m, wrench = plan.toes_at(of.frame) - plan.com_m[of.frame], wrench_at(course, of.frame)
        return self.forces(
            course, arms_m, patches, bears, reserves=reserves, least=least, wrench=wrench
        )

    def forces(
        self,
        course: Problem,
        arms_m: Array,
        patches: Sequence[Patch],
        bears: NDArray[np.bool_],
        *,
        loads: Loads = _NONE,
        reserves: Sequence[float] = RESERVES,
        least: float = LEAST,
        wrench: Array | None = None,
    ) -> Array | None:
        """Forces for toes that are this far from the centre of mass, shape (N, 3) [m], on these
        patches.

        Arguments:
            bears: who carries, shape (N,).
            course: its weight and its bounds of the forces.
            loads: of the joints.
            reserves: shares of μ that are tried, one after the other, until one has forces.
            least: share of the weight with which every limb that carries presses at least.
            wrench: on the body beside its weight, force and moment about the centre of mass in
                units of the weight and the length scale, shape (6,) (``wrench_at``).
        """
        carries = bears[:, None]
        frames = np.array([patch.frame for patch in patches])
        low, high = course.common_bounds
        weight_nm, levers_m, limit_nm = loads
        arms = np.einsum("nij,njk->nik", skew(arms_m / course.unit_m), frames)
        stance = SimpleNamespace(
            arms=np.concatenate(
                [frames.transpose(1, 0, 2).reshape(3, -1), arms.transpose(1, 0, 2).reshape(3, -1)]
            ),
            low=np.where(carries, np.maximum(low, [least, -np.inf, -np.inf]), 0.0),
            high=np.where(carries, high, 0.0),
            borne=_WEIGHT if wrench is None else _WEIGHT - wrench,
            rest=weight_nm / limit_nm,
            levers=np.einsum("jk,jki->ji", levers_m, frames[self._foot_of])
            * (course.weight_n / limit_nm)[:, None],
        )
        friction = np.array([patch.friction for patch in patches])
        for reserve in reserves:
            stance.friction = reserve * friction
            solution = self._rows.solve(stance)
            if solution.solved:
                local = solution.value("forces") * course.weight_n
                return np.asarray(np.where(carries, np.einsum("nij,nj->ni", frames, local), 0.0))
        return None


def wrench_at(course: Problem, frame: int) -> Array | None:
    """The wrench on the body at a key frame in units of the weight and the length scale, shape
    (6,); None for none.
    """
    if course.wrench is None:
        return None
    unit = course.weight_n * np.array([1.0, 1.0, 1.0, *(course.unit_m,) * 3])
    return np.asarray(course.wrench[frame] / unit)


def distribute_forces(plan: Plan, kinematics: Kinematics | None = None) -> Array:
    """Forces of all stances with a reserve of friction, the plan's own where there is none, shape
    (S, N, 3) [N].

    Arguments:
        kinematics: of its robot; where the plan has joint angles its own forces are kept, too, in
            stances in which others would take more of a joint than the plan does anywhere, and more
            than ``EASY`` of what the joint has.
    """
    distribution = ForceDistribution(len(plan.problem.robot.limbs))
    result = [distribution.solve(plan, index) for index in range(len(plan.problem.stances))]
    forces = np.array(
        [plan.forces_n[i] if forces is None else forces for i, forces in enumerate(result)]
    )
    if kinematics is None or plan.joints_rad is None:
        return forces
    shares, other = (
        np.array(
            [
                _largest(plan, kinematics, of.frame, each)
                for of, each in zip(plan.problem.stances, those, strict=True)
            ]
        )
        for those in (plan.forces_n, forces)
    )
    return np.where((other > max(EASY, shares.max()))[:, None, None], plan.forces_n, forces)


def standing_forces(plan: Plan, kinematics: Kinematics) -> dict[int, Array]:
    """Forces with which all limbs carry where no limb lifts: at the first key frame, and at both
    ends of a step that the body makes alone; with more of a reserve of friction than while some are
    lifted. By key frame, shape (N, 3) [N].

    Left out are frames at which some limb is drawn up, at which there are none, or at which they
    would take more of a joint than the plan does there, and more than ``EASY`` of what the joint
    has.
    """
    course, count = plan.problem, len(plan.problem.robot.limbs)
    alone = [k for k in range(1, course.frames) if not course.lifts[k]]
    distribution, result = ForceDistribution(count), dict[int, Array]()
    for frame in sorted({0, *alone, *(k - 1 for k in alone)}):
        holds = [int(index) for index in course.holds[frame]]
        if min(holds) < 0:
            continue
        patches = [course.patch(index, plan.choice) for index in holds]
        arms_m = plan.toes_at(frame) - plan.com_m[frame]
        every, wrench = np.full(count, True), wrench_at(course, frame)
        forces = distribution.forces(
            course, arms_m, patches, every, reserves=_STANDING, wrench=wrench
        )
        plan_forces = next(
            plan.forces_n[i] for i, stance in enumerate(course.stances) if stance.frame == frame
        )
        if forces is not None and _spares(plan, kinematics, frame, forces, plan_forces):
            result[frame] = forces
    return result


def _spares(plan: Plan, kinematics: Kinematics, frame: int, forces_n: Array, own_n: Array) -> bool:
    """Tell whether forces ask of the joints no more than the plan's own do, or than is easy."""
    if plan.joints_rad is None:
        return True
    most = max(EASY, _largest(plan, kinematics, frame, own_n))
    return _largest(plan, kinematics, frame, forces_n) <= most


def _largest(plan: Plan, kinematics: Kinematics, frame: int, forces_n: Array) -> float:
    """Largest torque at a key frame under these forces, as a share of the joint's limit."""
    limit_nm = np.minimum(kinematics.torque_nm, float(plan.provenance.get("torque_nm", np.inf)))
    assert plan.joints_rad is not None
    torques = kinematics.torques(
        plan.joints_rad[frame], rotation_of(plan.rotation_rad[frame]), forces_n
    )
    return float((np.abs(torques) / limit_nm).max())


_EXACT_M = 1e-10
"""A foot this close to its toe is there."""
REACHED_M = 1e-9
"""And none may be farther."""
_BALANCED, _INSIDE = 1e-9, 1e-7
"""Largest residual of a balance, and violation of a cone or a bound, non-dimensional: a quadruped
that lifts one foot after the other stands on a line, where the forces of a foot are zero to a
solver's tolerance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Restored:
    """An exact plan.

    Arguments:
        angles: shape (M, J) [rad].
        shares: largest torque of every stance as a share of its joint's limit, (S,).
    """

    point: Point
    angles: Array
    shares: Array

    @property
    def share(self) -> float:
        """The largest."""
        return float(self.shares.max())


class Restoration:
    """Makes points of one plan's problem exact.

    Arguments:
        plan: for its course and choice.
        scaled: the same, one candidate a foothold, with the friction that may be used.
        friction_share: how much of the course's that is.
        limit_nm: of every joint's torque, (J,).
    """

    def __init__(
        self,
        plan: Plan,
        scaled: Scaled,
        solver: Kinematics,
        limit_nm: Array,
        *,
        friction_share: float = 1.0,
    ) -> None:
        self._plan, self._scaled, self._solver, self._limit_nm = plan, scaled, solver, limit_nm
        self.friction_share, self._holds = friction_share, np.array(scaled.layout.holds)
        self._first = np.flatnonzero(
            np.diff(scaled.layout.contacts[0], prepend=-1)
        )  # contacts come by stance
        self._distribution = ForceDistribution(scaled.layout.limbs, solver.legs.tolist())

    @cached_property
    def _patches(self) -> list[list[Patch]]:
        """Under all limbs, frame by frame."""
        return [
            [self._plan.problem.patch(int(p), self._plan.choice) for p in row]
            for row in self._holds
        ]

    def point(self) -> Point:
        """The plan's own numbers, non-dimensional."""
        stance, limb, _ = self._scaled.layout.contacts
        world = (
            self._plan.forces_n[stance % self._scaled.layout.unpushed, limb] / self._scaled.force_n
        )
        return Point(
            com=(self._plan.com_m - self._scaled.origin_m) / self._scaled.length_m,
            rotation=self._plan.rotation_rad,
            residual=0.0,
            toes=(self._plan.toes_m - self._scaled.origin_m) / self._scaled.length_m,
            forces=np.matmul(self._scaled.contact_frames.transpose(0, 2, 1), world[..., None])[
                ..., 0
            ],
        )

    def restore(self, point: Point, angles: Array, *, wanted: float = 1.0) -> Restored | None:
        """An exact plan with this body and these toes; None where the joints do not reach, or no
        forces balance.

        Arguments:
            angles: to begin at, shape (M, J).
            wanted: forces whose torques' share is below this are left as they are, as are those
                that would not lower the largest one.
        """
        turns = np.array([rotation_of(vector) for vector in point.rotation])
        result = self._angles(point, turns, angles)
        if result is None:
            return None
        loads = [self._solver.loads(*each) for each in zip(result, turns, strict=True)]
        forces, sound = self._balanced(point)
        shares = self._shares(loads, forces)
        first = np.lexsort((-shares, sound))  # what must be found anew, then the largest shares
        for s in first[: np.count_nonzero(~sound | (shares > wanted))]:
            if sound[s] and shares[s] < shares.max():
                break  # the largest cannot be less
            other = self._spared(int(s), point, loads)
            if other is None and not sound[s]:
                return None
            if other is not None:
                tried = forces.copy()
                tried[self._scaled.layout.contacts[0] == s] = other
                share = self._shares(loads, tried)[s]
                if share < shares[s] or not sound[s]:
                    forces, shares[s] = tried, share
        return Restored(
            point=replace(point, forces=forces, residual=0.0), angles=result, shares=shares
        )

    def _angles(self, point: Point, turns: Array, start: Array) -> Array | None:
        """Joint angles that put every foot at its toe, from near; None where some do not reach."""
        scaled, solver = self._scaled, self._solver
        normals = scaled.frames[:, :, 0][self._holds]
        feet = np.array(
            [
                solver.targets(com, turn, toes, out)
                for com, turn, toes, out in zip(
                    scaled.places_m(point.com),
                    turns,
                    scaled.places_m(point.toes)[self._holds],
                    normals,
                    strict=True,
                )
            ]
        )
        result, error = descend_legs(solver.model.legs, feet, start, exact_m=_EXACT_M)
        return result if error.max() <= REACHED_M else None

    def _balanced(self, point: Point) -> tuple[Array, np.ndarray]:
        """Forces corrected onto the balances by the least change, and in which stances they are
        within everything.
        """
        scaled, first = self._scaled, self._first
        stance, _, foothold = scaled.layout.contacts
        arms = point.toes[foothold] - point.com[scaled.layout.stance_frames[stance]]
        maps = np.concatenate([scaled.contact_frames, skew(arms) @ scaled.contact_frames], axis=1)
        net = np.add.reduceat(np.einsum("bij,bj->bi", maps, point.forces), first)
        missing = np.concatenate([scaled.borne, -scaled.twisted], axis=1) - net
        square = np.add.reduceat(maps @ maps.transpose(0, 2, 1), first)
        pull = np.einsum("sij,sj->si", np.linalg.pinv(square, hermitian=True), missing)
        forces = point.forces + np.einsum("bij,bi->bj", maps, pull[stance])
        left = np.abs(missing - np.einsum("sij,sj->si", square, pull)).max(axis=1)
        cone = np.hypot(forces[:, 1], forces[:, 2]) - scaled.friction[foothold] * forces[:, 0]
        over = np.maximum(forces - scaled.force_max, scaled.force_min - forces).max(axis=1)
        return forces, (left <= _BALANCED) & (
            np.maximum.reduceat(np.maximum(cone, over), first) <= _INSIDE
        )

    def _shares(self, loads: list[tuple[Array, Array]], forces: Array) -> Array:
        """The largest torque of every stance as a share of its limit, (S,); 0 under a push."""
        layout, legs = self._scaled.layout, self._solver.legs
        stance, limb, _ = layout.contacts
        world = np.zeros((len(layout.stances), layout.limbs, 3))
        world[stance, limb] = self._scaled.in_world(forces) * self._scaled.force_n
        weights, levers = (
            np.array(part)[layout.stance_frames] for part in zip(*loads, strict=True)
        )
        torque = weights - (levers * world[:, legs]).sum(axis=2)
        shares = (np.abs(torque) / self._limit_nm).max(axis=1)
        shares[layout.unpushed :] = 0.0
        return np.asarray(shares)

    def _spared(self, stance: int, point: Point, loads: list[tuple[Array, Array]]) -> Array | None:
        """The forces of a stance with the least largest torque, contact frames; None where none
        balance.
        """
        scaled, (frame, limbs) = self._scaled, self._scaled.layout.stances[stance]
        weight, levers = loads[frame]
        least = scaled.force_min[scaled.layout.contacts[0] == stance, 0].max(initial=0.0)
        arms = (point.toes[self._holds[frame]] - point.com[frame]) * scaled.length_m
        world = self._distribution.forces(
            self._plan.problem,
            arms,
            self._patches[frame],
            np.isin(np.arange(scaled.layout.limbs), limbs),
            loads=(weight, levers, self._limit_nm),
            reserves=(self.friction_share,),
            least=float(least),
            wrench=scaled.wrench[stance] / scaled.weight if scaled.layout.loaded else None,
        )
        if world is None:
            return None
        frames = scaled.frames[self._holds[frame, list(limbs)]]
        return np.asarray(np.einsum("bij,bi->bj", frames, world[list(limbs)]) / scaled.force_n)


_STILL = 0.1
"""A step shorter than this share of its least length has no direction of its own."""


def lengths_of(plan: Plan, course: Problem) -> tuple[Array, Array]:
    """The steps Δ of a plan that have a least length, toes' [m], then the rotation's [rad], shape
    (E, 3), and their lengths, (E,).
    """
    before, after = course.moves.T
    toes = plan.toes_m[after] - plan.toes_m[before]
    turns = np.diff(plan.rotation_rad, axis=0)
    parts = [
        part
        for part, least in (
            (toes, course.steps.least_toe_m),
            (turns, course.steps.least_rotation_rad),
        )
        if least > 0.0
    ]
    steps = np.concatenate([np.zeros((0, 3)), *parts])
    return steps, np.linalg.norm(steps, axis=1)


def along(course: Problem, plan: Plan) -> Problem:
    """The course whose least steps go the way that they go in a plan: n·Δ ≥ δ, n their direction,
    so that a plan of it has them.

    A step that hardly moves goes where the nominal path does, and turns that hardly turn go
    round the vertical, to and fro.
    """
    if not len(course.least_steps):
        return course
    steps, lengths = lengths_of(plan, course)
    still = lengths <= _STILL * course.least_steps
    normals = np.where(still[:, None], nominal(course), steps)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    return replace(course, sides=np.column_stack([normals, course.least_steps]))


def nominal(course: Problem) -> Array:
    """Directions of the least steps as the course would have them, shape (E, 3)."""
    frames = [course.footholds[after].frame for _, after in course.moves.tolist()]
    ahead = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
    toes = ahead[np.array(frames, dtype=int) - 1]
    toes = np.where(toes.any(axis=1)[:, None], toes, [1.0, 0.0, 0.0])
    turns = np.array([[0.0, 0.0, 1.0 if k % 2 == 0 else -1.0] for k in range(course.frames - 1)])
    count = len(toes) if course.steps.least_toe_m > 0.0 else 0
    return np.concatenate([toes[:count], turns.reshape(-1, 3)])[: len(course.least_steps)]
