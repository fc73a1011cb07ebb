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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..equilibrium.rows import Rows
from ..files.arrays import Array
from ..problem import Problem
from ..robot.rotation import rotation_of
from ..terrain.patch import Patch

if TYPE_CHECKING:
    from ..robot.kinematics import Kinematics

RESERVES = (0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98)
"""Shares of μ that are tried, the safest first."""
STANDING = (0.5, 0.6, *RESERVES)
"""The same while all limbs stand: who has not moved yet does not know what friction there is."""
TIES = 1e-4
"""Weight of Σ‖f‖² beside the largest torque's share, forces in units of the weight."""
EASY = 0.8
"""Forces that ask for no more than this share of any joint's torque are left as they are."""
WEIGHT = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
LEAST = 0.02
"""Every limb that carries presses on its patch with this share of the weight or more, so that it
stays there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stance:
    """Data of one moment for the program.

    Arguments:
        arms: maps the forces to their sum and moment, (6, 3N).
        friction: (N,).
        low, high: on the forces, (N, 3).
        borne: their sum and its moment about the centre of mass, (6,).
        rest, levers: torques as shares of their limits are rest − levers · f, (J,), (J, 3); none
            where nobody asks.
    """

    arms: Array
    friction: Array
    low: Array
    high: Array
    borne: Array
    rest: Array
    levers: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Loads:
    """Parts of the torques of a robot at rest; J joints.

    Arguments:
        weight_nm: of the limbs' own masses, shape (J,).
        levers_m: τ = weight_nm − levers_m · f, f on the joint's own foot in the world frame, shape
            (J, 3).
        limit_nm: of every joint, inf for none, shape (J,).
    """

    weight_nm: Array
    levers_m: Array
    limit_nm: Array


NONE = Loads(weight_nm=np.zeros(0), levers_m=np.zeros((0, 3)), limit_nm=np.zeros(0))


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
        self._contacts, self._foot_of = contacts, np.array(foot_of, dtype=int)
        self._rows = rows = Rows[_Stance](keep=True)
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
        rows.square(forces, None, TIES if len(foot_of) else 1.0)
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
        loads: Loads = NONE,
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
        arms = np.einsum("nij,njk->nik", _skew(arms_m / course.length_scale_m), frames)
        stance = _Stance(
            arms=np.concatenate(
                [frames.transpose(1, 0, 2).reshape(3, -1), arms.transpose(1, 0, 2).reshape(3, -1)]
            ),
            friction=np.array([patch.friction for patch in patches]),
            low=np.where(carries, np.maximum(low, [least, -np.inf, -np.inf]), 0.0),
            high=np.where(carries, high, 0.0),
            borne=WEIGHT if wrench is None else WEIGHT - wrench,
            rest=loads.weight_nm / loads.limit_nm,
            levers=np.einsum("jk,jki->ji", loads.levers_m, frames[self._foot_of])
            * (course.weight_n / loads.limit_nm)[:, None],
        )
        for reserve in reserves:
            solution = self._rows.solve(replace(stance, friction=reserve * stance.friction))
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
    unit = course.weight_n * np.array([1.0, 1.0, 1.0, *(course.length_scale_m,) * 3])
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
    """Forces with which all limbs carry where nobody lifts: at the first key frame, and at both
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
            course, arms_m, patches, every, reserves=STANDING, wrench=wrench
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


def _skew(v: Array) -> Array:
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.array(rows).transpose(2, 0, 1)
