"""Forces for a robot that stands on given toes: the smallest ones that keep a reserve of friction.

A planner's forces may lie on the border of their cones, where a simulated or a real foot slips. With toes and body held
the balances are linear, so this is one small second-order cone program.
"""

from __future__ import annotations

from collections.abc import Sequence

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .conic import ConicModel, ConicStatus
from .contact.terms import friction_cones
from .plan import Plan
from .scene.course import Course
from .scene.patch import Patch

RESERVES = (0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98)
"""Shares of μ that are tried, the safest first."""
LEAST = 0.02
"""Every limb that carries presses on its patch with this share of the weight or more, so that it stays there."""


class ForceShare:
    """Least Σ‖f‖² in balance, inside cones of a part of μ, for N contacts; compiled once."""

    def __init__(self, contacts: int) -> None:
        forces = cp.Variable((contacts, 3), name="forces")
        arms = cp.Parameter((6, 3 * contacts), name="arms")
        wrench = cp.Parameter(6, name="wrench")
        friction = cp.Parameter(contacts, name="friction")
        low, high = cp.Parameter((contacts, 3), name="low"), cp.Parameter((contacts, 3), name="high")
        rows = [
            arms @ cp.vec(forces, order="C") == wrench,
            friction_cones(forces, friction),
            forces >= low,
            forces <= high,
        ]
        rng = np.random.default_rng(0)
        self._contacts = contacts
        self._model = ConicModel(
            cp.Problem(cp.Minimize(cp.sum_squares(forces)), rows),
            equilibrate={
                "arms": rng.uniform(-1.0, 1.0, (6, 3 * contacts)), "wrench": np.eye(6)[2],
                "friction": np.full(contacts, 0.7), "low": np.tile([0.0, -1.0, -1.0], (contacts, 1)),
                "high": np.ones((contacts, 3)),
            },
        )  # fmt: skip

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
        values: dict[str, Array | float] = {
            "arms": np.concatenate([frames.transpose(1, 0, 2).reshape(3, -1), arms.transpose(1, 0, 2).reshape(3, -1)]),
            "wrench": np.eye(6)[2],
            "low": np.where(carries, np.maximum(course.force_min, [LEAST, -np.inf, -np.inf]), 0.0),
            "high": np.where(carries, course.force_max, 0.0),
        }
        friction = np.array([patch.friction for patch in patches])
        for reserve in RESERVES:
            solution = self._model.solve(values | {"friction": reserve * friction})
            if solution.status is ConicStatus.SOLVED:
                local = self._model.value("forces", solution) * course.weight_n
                return np.asarray(np.where(carries, np.einsum("nij,nj->ni", frames, local), 0.0))
        return None


def shared_forces(plan: Plan) -> Array:
    """Forces of all stances with a reserve of friction, the plan's own where there is none, shape (S, N, 3) [N]."""
    share = ForceShare(len(plan.course.robot.limbs))
    found = [share.solve(plan, index) for index in range(len(plan.course.stances))]
    return np.array([plan.forces_n[i] if forces is None else forces for i, forces in enumerate(found)])


def _skew(v: Array) -> Array:
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.array(rows).transpose(2, 0, 1)
