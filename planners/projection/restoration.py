"""From a plan that is right to first order to one that is exact: joints that reach, forces that
balance and spare them.

The body and the toes are taken as they come. Joint angles are found from those that are near;
forces are corrected onto the balances by the least change, and where that leaves a cone, a bound or
a torque limit, found anew by the program of ``force_distribution``: the best that these joints
allow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..answer.plan import Plan
from ..arguments import cached_property
from ..equilibrium.scaled import Point, Scaled, skew
from ..files.arrays import Array
from ..robot.inverse_kinematics import descend
from ..robot.kinematics import Kinematics
from ..robot.rotation import rotation_of
from ..terrain.patch import Patch
from .force_distribution import ForceDistribution, Loads

EXACT_M = 1e-10
"""A foot this close to its toe is there."""
REACHED_M = 1e-9
"""And none may be farther."""
BALANCED, INSIDE = 1e-9, 1e-7
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
        self._legs_of = [solver.joints_of(i) for i in range(scaled.layout.limbs)]
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
            com=self._plan.com_m / self._scaled.length_m,
            rotation=self._plan.rotation_rad,
            residual=0.0,
            toes=self._plan.toes_m / self._scaled.length_m,
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
                solver.targets(com * scaled.length_m, turn, toes * scaled.length_m, out)
                for com, turn, toes, out in zip(
                    point.com, turns, point.toes[self._holds], normals, strict=True
                )
            ]
        )
        result = np.empty_like(start)
        for i, (leg, joints) in enumerate(zip(solver.model.legs, self._legs_of, strict=True)):
            result[:, joints], error = descend(leg, feet[:, i], start[:, joints], exact_m=EXACT_M)
            if not error.max() <= REACHED_M:
                return None
        return result

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
        return forces, (left <= BALANCED) & (
            np.maximum.reduceat(np.maximum(cone, over), first) <= INSIDE
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
            loads=Loads(weight_nm=weight, levers_m=levers, limit_nm=self._limit_nm),
            reserves=(self.friction_share,),
            least=float(least),
            wrench=scaled.wrench[stance] / scaled.weight if scaled.layout.loaded else None,
        )
        if world is None:
            return None
        frames = scaled.frames[self._holds[frame, list(limbs)]]
        return np.asarray(np.einsum("bij,bi->bj", frames, world[list(limbs)]) / scaled.force_n)
