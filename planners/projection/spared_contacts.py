"""Contacts that spare the joints: P1 and P2 of a plan's own patches, with rows for the torques of
all joints that carry.

About a plan with joint angles (bars) a joint of a leg that stands takes, as a share of its limit
and to first order in f, Θ and in the place p − c of its foot,

    s = s̄ + ∂s/∂f (f − f̄) + ∂s/∂q q',    q' = J⁺ (p − c − a − ∂a/∂Θ (Θ − Θ̄)),

a the place of its foot at the plan's own joints, J⁺ the least step of the leg's joints that moves
it. Put into P1, where f = Σ_u f_u and p = Σ_u λ_u v_u are linear, −S ≤ s ≤ S bounds the largest
share S, whose price is paid above what is wanted. P1 moves toes over their whole patches, where a
step of the whole body (``whole_body_step``) stays in a trust region; it sees no joint limits and no
bodies. P2 is the same with the toes held, and exact in its balances. Both keep a little to where
the plan is, since the rows are true there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.programs import ConicSolution, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point
from ..equilibrium.terms import (
    BodyVariables,
    Forces,
    FreeToes,
    Given,
    HeldToes,
    Moments,
    Toes,
    objective,
)
from ..files.arrays import Array
from .held import toes_of
from .whole_body_step import EVEN, TORQUE_PRICE, TorqueRows, WholeBodyGiven

_NEAR = 1e-2
"""Weight of the squared distance of body and toes from where the plan has them."""
_DAMPED = 1e-4
"""Damping of the inverse that gives the joints a place of the foot, in length scales squared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SparedGiven(WholeBodyGiven):
    """Data of P1 and P2 with torques: a problem, the plan about which torques are linearised, and
    its joints.
    """

    @cached_property
    def steps_of_joints(self) -> Array:
        """J⁺, the least step of a foot's own joints that moves it, of every joint, shape (M, J,
        3).
        """
        out, legs = np.zeros_like(self.by_joint), self.solver.legs
        for leg in range(self.scaled.layout.limbs):
            columns = self.by_joint[:, legs == leg]
            squared = columns.transpose(0, 2, 1) @ columns + _DAMPED * np.eye(3)
            out[:, legs == leg] = columns @ np.linalg.inv(squared)
        return out

    @cached_property
    def by_place(self) -> Array:
        """∂s/∂(p − c), shape (T, 3)."""
        of = TorqueRows.of(self.scaled.layout, tuple(self.solver.legs.tolist()))
        steps = self.steps_of_joints[of.frame[of.row], of.other]
        total = np.zeros((len(of.joint), 3))
        np.add.at(total, of.row, self.torque.by_joint[:, None] * steps)
        return total

    @cached_property
    def by_rotation(self) -> Array:
        """∂s/∂Θ with feet that stay where they are, shape (T, 3)."""
        frame, limb = self._feet
        turned = np.einsum("ti,tij->tj", self.by_place, self.by_turn[frame, limb])
        return np.asarray(self.torque.by_turn - turned)

    @cached_property
    def at_nothing(self) -> Array:
        """Constant term of the linearised torque limits, −s at zero forces with feet, body and
        rotation at zero, shape (T,).
        """
        placed = (self.by_place * self.feet_right[self._feet]).sum(axis=1)
        return np.asarray(self.torque.right - placed)

    @cached_property
    def at_held_toes(self) -> Array:
        """The constant term ``at_nothing`` with the toes held in place, shape (T,)."""
        frame, limb = self._feet
        foothold = np.array(self.scaled.layout.holds)[frame, limb]
        return np.asarray(self.at_nothing - (self.by_place * self.held.toes[foothold]).sum(axis=1))

    @property
    def _feet(self) -> tuple[Index, Index]:
        """(frame, limb) of every torque, (T,) each."""
        of = TorqueRows.of(self.scaled.layout, tuple(self.solver.legs.tolist()))
        return of.frame, self.scaled.layout.contacts[1][of.contact]

    def joints_at(self, point: Point) -> Array:
        """Joints that have the feet of a point to first order, shape (M, J) [rad]."""
        holds = np.array(self.scaled.layout.holds)
        places = point.toes[holds] - point.com[:, None]
        off = places + self.feet_right
        off -= np.einsum("mnij,mj->mni", self.by_turn, point.rotation)
        off[holds < 0] = 0.0
        steps = (self.steps_of_joints * off[:, self.solver.legs]).sum(axis=2)
        return np.asarray(
            np.clip(self.angles + steps, self.solver.lowest_rad, self.solver.highest_rad)
        )


class _SparedContacts:
    """The program; one candidate a foothold, point feet.

    Arguments:
        leg_of: the leg of every joint.
        implied: leave out rows of the force box that the cones imply (``Scaled.box_implied``).
        hold_toes: P2, else P1.
    """

    def __init__(
        self, layout: Layout, leg_of: tuple[int, ...], implied: bool, hold_toes: bool
    ) -> None:
        layout.check_point_feet("whole body")
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, free = BodyVariables(rows, layout), None
        if hold_toes:
            forces, moments = Forces.of_contacts(rows, layout), None
            toes: Toes = HeldToes(rows)
        else:
            toes = free = FreeToes(rows, layout, explicit=True, implied=implied)
            forces, moments = Forces.of_vertices(rows, layout, free), Moments(layout)
        forces.balance()
        if moments is None:
            Moments.of(layout, body, forces, "held_arms").vanish(rows)
        else:
            moments.add(forces.stance, forces.columns, Of("scaled.arms"))
            moments.of_weight(body)
            moments.vanish(rows)
        forces.in_cones()
        forces.in_box(implied=implied and not hold_toes)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(free)
        self._torques(TorqueRows.of(layout, leg_of), layout, body, free, forces)
        objective(rows, layout, body, free)
        self._stay(body.com, "com")
        if free is not None and free.points is not None:
            self._stay(free.points, "toes")
        rows.square(forces.columns, None, EVEN)

    def _torques(
        self,
        of: TorqueRows,
        layout: Layout,
        body: BodyVariables,
        free: FreeToes | None,
        forces: Forces,
    ) -> None:
        """No torque has more of its limit than the share, either way, which is what is wanted or
        more.
        """
        rows, share = self.rows, self.rows.variable("share", 1)
        row, force = np.nonzero(of.contact[:, None] == forces.contact)
        for name, sign in (("torque", 1.0), ("torque_back", -1.0)):
            torque = rows.at_most(name, len(of.joint))
            rows.put(torque[row][:, None], forces.columns[force], sign * Of("torque.by_force", row))
            rows.put(torque[:, None], body.rotation[of.frame], sign * Of("by_rotation"))
            rows.put(torque[:, None], body.com[of.frame], -sign * Of("by_place"))
            if free is not None and free.points is not None:
                foothold = layout.contacts[2][of.contact]
                rows.put(torque[:, None], free.points[foothold], sign * Of("by_place"))
            rows.put(torque, share, -1.0)
            rows.right(torque, sign * Of("at_nothing" if free is not None else "at_held_toes"))
        wanted = rows.at_most("wanted", 1)
        rows.put(wanted, share, -1.0)
        rows.right(wanted, -Of("wanted"))
        rows.linear(share, TORQUE_PRICE)

    def _stay(self, columns: Index, name: str) -> None:
        """NEAR · ‖x − x̄‖²."""
        self.rows.square(columns, None, _NEAR)
        self.rows.linear(columns, -2.0 * _NEAR * Of(f"held.{name}"))

    def solve(self, at: SparedGiven) -> ConicSolution:
        """Solve about a plan."""
        return self.rows.solve(at)


def spared_contacts(programs: Programs, at: SparedGiven) -> tuple[Point, Array] | None:
    """The plan's contacts found anew with torques as rows of P1 and P2, and joints near it that put
    the feet there; None where there are none.

    The balances are exact; torques, and that joints reach, hold to first order alone.
    """
    scaled, leg_of = at.scaled, tuple(at.solver.legs.tolist())
    free, held = (
        programs.get(_SparedContacts, scaled.layout, leg_of, scaled.box_implied, hold_toes)
        for hold_toes in (False, True)
    )
    lifted = free.solve(at)
    if not lifted.solved:
        return None
    toes = toes_of(lifted, scaled)
    solution = held.solve(replace(at, about=replace(at.held, toes=toes)))
    if not solution.solved:
        return None
    point = Point(
        com=solution.value("com"),
        rotation=solution.value("rotation"),
        toes=toes,
        forces=solution.value("forces"),
        residual=0.0,
        objective=solution.objective,
        solves=2,
        seconds=lifted.seconds + solution.seconds,
    )
    return point, at.joints_at(point)
