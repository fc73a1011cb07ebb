"""Forces for a robot that stands on given toes: the smallest ones that keep a reserve of friction.

A planner's forces may lie on the border of their cones, where a simulated or a real foot slips. With toes and body held
the balances are linear, so this is one small second-order cone program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.course import Course
from stancekit.planners.terrain.patch import Patch

RESERVES = (0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98)
"""Shares of μ that are tried, the safest first."""
LEAST = 0.02
"""Every limb that carries presses on its patch with this share of the weight or more, so that it stays there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stance:
    """arms: maps the forces to their sum and moment, (6, 3N); friction: (N,); low, high: on the forces, (N, 3)."""

    arms: Array
    friction: Array
    low: Array
    high: Array


class ForceDistribution:
    """Least Σ‖f‖² in balance, inside cones of a part of μ, for N contacts."""

    def __init__(self, contacts: int) -> None:
        self._contacts = contacts
        self._rows = rows = Rows[_Stance](keep=True)
        forces = rows.variable("forces", contacts, 3)
        balance = rows.equal("balance", 6)
        rows.put(balance[:, None], forces.reshape(1, -1), lambda d: d.arms)
        rows.right(balance[2:3], 1.0)
        most, least = rows.at_most("most", contacts, 3), rows.at_most("least", contacts, 3)
        rows.put(most, forces, 1.0)
        rows.put(least, forces, -1.0)
        rows.right(most, lambda d: d.high)
        rows.right(least, lambda d: -d.low)
        cone = rows.cones("cone", contacts, 3)
        rows.put(cone[:, 0], forces[:, 0], lambda d: -d.friction)
        rows.put(cone[:, 1:], forces[:, 1:], -1.0)
        rows.square(forces, None, lambda _: 1.0)

    def solve(self, plan: Plan, stance: int) -> Array | None:
        """Forces of a plan's stance, world frame, shape (N, 3) [N]; None where even the whole cones leave no room."""
        course, of = plan.course, plan.course.stances[stance]
        patches = [course.patch(int(index), plan.choice) for index in course.holds[of.frame]]
        bears = np.isin(np.arange(self._contacts), of.limbs)
        return self.forces(course, plan.toes_at(of.frame) - plan.com_m[of.frame], patches, bears)

    def forces(self, course: Course, arms_m: Array, patches: Sequence[Patch], bears: NDArray[np.bool_]) -> Array | None:
        """The same for toes that are so far from the centre of mass, shape (N, 3) [m], on these patches.

        bears: who carries, shape (N,); course: its weight and its bounds of the forces.
        """
        carries = bears[:, None]
        frames = np.array([patch.frame for patch in patches])
        arms = np.einsum("nij,njk->nik", _skew(arms_m / course.length_scale_m), frames)
        stance = _Stance(
            arms=np.concatenate([frames.transpose(1, 0, 2).reshape(3, -1), arms.transpose(1, 0, 2).reshape(3, -1)]),
            friction=np.array([patch.friction for patch in patches]),
            low=np.where(carries, np.maximum(course.force_min, [LEAST, -np.inf, -np.inf]), 0.0),
            high=np.where(carries, course.force_max, 0.0),
        )
        for reserve in RESERVES:
            solution = self._rows.solve(replace(stance, friction=reserve * stance.friction))
            if solution.solved:
                local = solution.value("forces") * course.weight_n
                return np.asarray(np.where(carries, np.einsum("nij,nj->ni", frames, local), 0.0))
        return None


def distribute_forces(plan: Plan) -> Array:
    """Forces of all stances with a reserve of friction, the plan's own where there is none, shape (S, N, 3) [N]."""
    distribution = ForceDistribution(len(plan.course.robot.limbs))
    found = [distribution.solve(plan, index) for index in range(len(plan.course.stances))]
    return np.array([plan.forces_n[i] if forces is None else forces for i, forces in enumerate(found)])


def _skew(v: Array) -> Array:
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.array(rows).transpose(2, 0, 1)
