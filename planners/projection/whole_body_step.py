"""One convex step of a plan of the whole body: body, toes, joints and forces of all key frames at
once; and contacts that spare the joints.

About a plan that is exact in its kinematics and balances (bars), to first order, in δq and in c, Θ,
p, f:

    c − p + [D(Θ − Θ̄)]× ā + R̄ J̄ δq = r n − ā         feet of the joints at their toes,
                                                      ā from c to the foot, r its radius
    Σ f = b,  Σ p̄ × f + (p − p̄) × f̄ = c × b − M       balances (E5, E6), with a residual that costs
    ±(ḡ + ∂g − l̄ · f − ∂l · f̄) ≤ limit · share        torque of every joint of a leg that carries,
                                                      l its lever

with b = w e_z − F and M what is on the body, cones (E10), reach and steps (E11), bounds of joints,
distances of bodies (``centre``), and a box about the bars in which this is to be believed. The
objective is the course's own, and a price on the largest share of a torque limit where it is above
what is wanted, and on what is missing to distances: hinges. What a solution leaves of second order
is the restoration's to mend (``force_distribution``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..arguments import cached_property
from ..equilibrium.layout import Fill, Index, Layout, Of
from ..equilibrium.programs import ConicSolution, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, skew
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
from ..files.arrays import Array, cross, locked
from ..robot.kinematics import Kinematics, rotation_of
from ..robot.leg import LegSlopes, turning
from ..robot.robot_file import JOINTS
from .centre import Nearness, keep_clear
from .held import linearised_moments, toes_of

TURN_RAD = 0.5
"""A joint of a leg that stands turns by no more from one key frame to the next: on the way from a
posture to its mirror image torques are not those of either."""
UPRIGHT_RAD = 1.3
"""A hip of a leg that is drawn up stays below this: near π/2 its yaw and its roll turn one way, and
at any speed."""
_SLACK_RAD = 0.2
"""What is restored may be so far beyond what a step kept to."""


@lru_cache(maxsize=16)
def standing(layout: Layout, leg_of: tuple[int, ...]) -> tuple[Index, Index]:
    """(frame, joint) of every joint of a leg that stands where it stood at the frame before, (K,)
    each.

    Arguments:
        leg_of: the leg of every joint.
    """
    holds = np.array(layout.holds)
    frame, joint = np.nonzero((holds[1:] == holds[:-1])[:, np.array(leg_of)])
    return locked((frame + 1, joint))


def _keep_turns(rows: Rows[Any], of: tuple[Index, Index], joints: Index) -> None:
    """Rows that keep steps of these joints, columns of shape (M, J), within ``turn_room``, which
    the problem tells.
    """
    frame, joint = of
    for name, sign in (("on", 1.0), ("back", -1.0)):
        turn = rows.at_most(f"turn_{name}", len(frame))
        rows.put(turn, joints[frame, joint], sign)
        rows.put(turn, joints[frame - 1, joint], -sign)
        rows.right(turn, lambda given, sign=sign: given.turn_room(sign))  # type: ignore[misc]


def turn_room(angles: Array, of: tuple[Index, Index], sign: float) -> Array:
    """Angle by which these joints may still turn one way since the frame before, (K,) [rad]: what
    is beyond ``TURN_RAD`` already gets no farther.

    Arguments:
        angles: shape (M, J).
        of: as of ``standing``.
    """
    frame, joint = of
    turned = angles[frame, joint] - angles[frame - 1, joint]
    return np.asarray(np.maximum(TURN_RAD, np.abs(turned)) - sign * turned)


def joint_ranges(solver: Kinematics, angles: Array) -> tuple[Array, Array]:
    """Ranges of the joints, shape (M, J) each: within their limits, and legs that are drawn up no
    nearer to the posture in which thigh and axis of yaw are one than ``UPRIGHT_RAD``, or than they
    are.

    Arguments:
        angles: shape (M, J) [rad].
    """
    lower, upper = (
        np.tile(limit, (len(angles), 1)) for limit in (solver.lowest_rad, solver.highest_rad)
    )
    if solver.drawn:
        hips = slice(JOINTS.index("hip"), None, len(JOINTS))
        lower[:, hips] = np.maximum(lower[:, hips], np.minimum(-UPRIGHT_RAD, angles[:, hips]))
        upper[:, hips] = np.minimum(upper[:, hips], np.maximum(UPRIGHT_RAD, angles[:, hips]))
    return lower, upper


def keeps_to(solver: Kinematics, layout: Layout, before: Array, after: Array) -> bool:
    """Tell whether the joint angles ``after`` a step are as close to those ``before`` it as a step
    allows. Angles that inverse kinematics found again may have jumped.

    Arguments:
        before, after: joint angles, shape (M, J) [rad].
    """
    frame, joint = standing(layout, tuple(solver.legs.tolist()))
    first, then = (
        np.abs(angles[frame, joint] - angles[frame - 1, joint]) for angles in (before, after)
    )
    lower, upper = joint_ranges(solver, before)
    inside = np.all((after >= lower - _SLACK_RAD) & (after <= upper + _SLACK_RAD))
    return bool(inside and np.all(then <= np.maximum(TURN_RAD, first) + _SLACK_RAD))


TORQUE_PRICE = 3.0
"""Price of the largest torque's share above what is wanted, in units of the objective."""
_MOMENT_PRICE = 500.0
"""Price of the moments that a step leaves, likewise: at 3e3 plans of the hexapod between walls keep
too much torque, at 100 steps buy distances with moments, and a Solo12 had no plan on stairs."""
_STILL, EVEN = 2e-3, 1e-5
"""Weights of Σ δq² and Σ f²: joints that need not move stay, forces that are free are small."""
_TRUST = {"com": 0.03, "rotation": 0.08, "toes": 0.04, "joints": 0.25}
"""Bounds of a step, at radius 1: com and toes [m], rotation and joints [rad], each axis for
itself."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueRows:
    """Torques that a step looks at: those of every joint of every leg that carries, stance by
    stance, T of them.

    Arguments:
        contact, frame, joint: of each torque, (T,).
        row, other: (torque, joint of the same leg), (K,).
        pairs: of all legs' joints, shape (2, pairs), and pair: which of them each of the K is.
    """

    contact: Index
    frame: Index
    joint: Index
    row: Index
    other: Index
    pair: Index
    pairs: Index

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, layout: Layout, leg_of: tuple[int, ...]) -> TorqueRows:
        """The rows of a layout.

        Arguments:
            leg_of: the leg of every joint.
        """
        legs, (stance, limb, _) = np.array(leg_of), layout.contacts
        contact, joint = np.nonzero((limb[:, None] == legs) & (stance < layout.unpushed)[:, None])
        pairs = np.nonzero(legs[:, None] == legs)
        number = np.full((len(legs), len(legs)), -1)
        number[pairs] = np.arange(len(pairs[0]))
        row, other = np.nonzero(legs[joint][:, None] == legs)
        parts = (
            contact,
            layout.stance_frames[stance[contact]],
            joint,
            row,
            other,
            number[joint[row], other],
        )
        contact, frame, joint, row, other, pair = locked(parts)
        return cls(
            contact=contact,
            frame=frame,
            joint=joint,
            row=row,
            other=other,
            pair=pair,
            pairs=locked(np.array(pairs)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeBodyGiven(Given):
    """Data that a step is loaded with: the problem, the point about which it is linearised, and the
    joints there.

    Arguments:
        angles: shape (M, J) [rad].
        limit_nm: of every joint's torque, (J,).
        wanted: share of it that is well.
        radius: of the trust region.
    """

    solver: Kinematics
    angles: Array
    limit_nm: Array
    wanted: float = 1.0
    radius: float = 1.0
    near: Nearness | None = None
    clearance_m: float = 0.0

    @cached_property
    def rotations(self) -> Array:
        """R_WB, shape (M, 3, 3)."""
        return np.array([rotation_of(vector) for vector in self.held.rotation])

    @cached_property
    def legs(self) -> LegSlopes:
        """Legs to first order."""
        return LegSlopes.of(self.solver.model.legs, self.angles, self.rotations)

    @cached_property
    def turns(self) -> Array:
        """D, shape (M, 3, 3)."""
        return turning(self.held.rotation)

    @cached_property
    def arms(self) -> Array:
        """ā, from the centre of mass to every foot's centre as the joints have it, shape (M, N,
        3).
        """
        arms = self.legs.feet - (self.rotations @ self.solver.robot.origin_m)[:, None]
        return np.asarray(arms / self.scaled.length_m)

    @cached_property
    def by_turn(self) -> Array:
        """∂ā/∂Θ = −[ā]× D, shape (M, N, 3, 3)."""
        return np.asarray(-skew(self.arms) @ self.turns[:, None])

    @cached_property
    def by_joint(self) -> Array:
        """∂ā/∂q of every joint's own foot, shape (M, J, 3)."""
        return np.asarray(self.legs.levers / self.scaled.length_m)

    @cached_property
    def feet_right(self) -> Array:
        """r n − ā + ∂ā/∂Θ Θ̄, shape (M, N, 3)."""
        normals = self.scaled.frames[:, :, 0][np.array(self.scaled.layout.holds)]
        out = (self.solver.radii_m / self.scaled.length_m)[:, None] * normals
        return np.asarray(
            out - self.arms + np.einsum("mnij,mj->mni", self.by_turn, self.held.rotation)
        )

    @cached_property
    def torque(self) -> _Torques:
        """The rows of torques."""
        return _Torques.of(self)

    def room(self, name: str) -> float:
        """Half the side of the trust region's box, non-dimensional."""
        return (
            self.radius
            * _TRUST[name]
            / (1.0 if name in ("rotation", "joints") else self.scaled.length_m)
        )

    def close(self, near: Nearness) -> Nearness:
        """Select the bodies that this step may bring nearer to each other than they are to keep."""
        sizes = {"com": self.held.com.size, "rotation": self.held.rotation.size}
        sizes |= {"joints": self.angles.size, "toes": self.held.toes.size}
        units = {"com": self.scaled.length_m, "toes": self.scaled.length_m}
        rooms = [self.room(name) * units.get(name, 1.0) for name in sizes]
        return near.within(self.clearance_m, np.repeat(rooms, list(sizes.values())))

    def turn_room(self, sign: float) -> Array:
        """Angle by which joints of legs that stand may still turn this way since the frame before,
        (K,).
        """
        return turn_room(
            self.angles, standing(self.scaled.layout, tuple(self.solver.legs.tolist())), sign
        )

    @cached_property
    def range_rad(self) -> tuple[Array, Array]:
        """Ranges of the joints, shape (M, J) each."""
        return joint_ranges(self.solver, self.angles)

    @cached_property
    def above(self) -> dict[str, Array]:
        """Upper bounds by the trust region and, of steps of joints, by their limits."""
        held = {"com": self.held.com, "rotation": self.held.rotation, "toes": self.held.toes}
        bounds = {name: np.asarray(value + self.room(name)) for name, value in held.items()}
        return bounds | {"joints": np.minimum(self.room("joints"), self.range_rad[1] - self.angles)}

    @cached_property
    def below(self) -> dict[str, Array]:
        """Lower bounds likewise."""
        held = {"com": self.held.com, "rotation": self.held.rotation, "toes": self.held.toes}
        bounds = {name: value - self.room(name) for name, value in held.items()}
        return bounds | {
            "joints": np.maximum(-self.room("joints"), self.range_rad[0] - self.angles)
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Torques:
    """Torques as shares of their limits, times the sign that they have at the point, to first
    order.

    Arguments:
        value: (T,).
        by_force: in the contact frame, (T, 3).
        by_turn: in Θ, (T, 3).
        by_joint: of the K pairs, (K,).
        right: what the rows have on the right, (T,).
    """

    value: Array
    by_force: Array
    by_turn: Array
    by_joint: Array
    right: Array

    @classmethod
    def of(cls, at: WholeBodyGiven) -> _Torques:
        """About a point."""
        scaled, solver, rows = (
            at.scaled,
            at.solver,
            TorqueRows.of(at.scaled.layout, tuple(at.solver.legs.tolist())),
        )
        contact, frame, joint = rows.contact, rows.frame, rows.joint
        forces = scaled.in_world(at.held.forces)[contact] * scaled.force_n
        levers = at.legs.levers[frame, joint]
        weights = np.array(
            [solver.loads(*each)[0] for each in zip(at.angles, at.rotations, strict=True)]
        )
        bent, turned = zip(*map(solver.gravity_slopes, at.angles, at.rotations), strict=True)
        value = weights[frame, joint] - (levers * forces).sum(axis=1)
        scale = np.where(value < 0.0, -1.0, 1.0) / at.limit_nm[joint]
        by_turn = (np.array(turned)[frame, joint] - cross(levers, forces))[:, None] @ at.turns[
            frame
        ]
        by_turn = scale[:, None] * by_turn[:, 0]
        pulled = at.legs.lever_slopes(*rows.pairs)[frame[rows.row], rows.pair] * forces[rows.row]
        by_joint = np.array(bent)[frame[rows.row], joint[rows.row], rows.other] - pulled.sum(axis=1)
        by_force = np.einsum("ti,tij->tj", levers, scaled.contact_frames[contact])
        return cls(
            value=scale * value,
            by_turn=by_turn,
            by_joint=scale[rows.row] * by_joint,
            by_force=-scaled.force_n * scale[:, None] * by_force,
            right=(by_turn * at.held.rotation[frame]).sum(axis=1) - scale * weights[frame, joint],
        )


class WholeBodyStep:
    """P1 and P2 of a plan's own patches, with rows for the torques of all joints that carry; one
    candidate a foothold, point feet.

    About a plan with joint angles (bars) a joint of a leg that stands takes, as a share of its
    limit and to first order in f, Θ and in the place p − c of its foot,

        s = s̄ + ∂s/∂f (f − f̄) + ∂s/∂q q',    q' = J⁺ (p − c − a − ∂a/∂Θ (Θ − Θ̄)),

    a the place of its foot at the plan's own joints, J⁺ the least step of the leg's joints that
    moves it. Put into P1, where f = Σ_u f_u and p = Σ_u λ_u v_u are linear, −S ≤ s ≤ S bounds the
    largest share S, whose price is paid above what is wanted. P1 moves toes over their whole
    patches, where a step of the whole body stays in a trust region; it sees no joint limits and no
    bodies. P2 is the same with the toes held, and exact in its balances. Both keep a little to
    where the plan is, since the rows are true there.

    Arguments:
        leg_of: the leg of every joint.
        hold_toes: they stay where the point has them; then balances are linear (E6) and hold
            exactly.
        at: a problem whose bodies that are near it is to keep apart: a program for this one alone.
    """

    def __init__(
        self,
        layout: Layout,
        leg_of: tuple[int, ...],
        hold_toes: bool,
        at: WholeBodyGiven | None = None,
    ) -> None:
        layout.check_point_feet("whole body")
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, forces = BodyVariables(rows, layout), Forces.of_contacts(rows, layout)
        free = None if hold_toes else FreeToes(rows, layout, explicit=True)
        toes: Toes = HeldToes(rows) if free is None else free
        joints, share = (
            rows.variable("joints", layout.frames, len(leg_of)),
            rows.variable("share", 1),
        )
        forces.balance()
        if free is None:
            Moments.of(layout, body, forces, "held_arms").vanish(rows)
        else:
            moments = linearised_moments(layout, body, free, forces)
            rows.linear(
                moments.within(rows, each=True), _MOMENT_PRICE
            )  # what one cannot help is no other's to leave
        forces.in_cones()
        forces.in_box(implied=False)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(free)
        self._feet(body, toes, joints, np.array(leg_of), layout)
        self._torques(TorqueRows.of(layout, leg_of), body, forces, joints, share)
        _keep_turns(rows, standing(layout, leg_of), joints)
        columns = {"com": body.com, "rotation": body.rotation, "joints": joints}
        if free is not None and free.points is not None:
            columns["toes"] = free.points
        for name, numbers in columns.items():
            for side, sign in (("above", 1.0), ("below", -1.0)):
                near = rows.at_most(f"{name}_{side}", *numbers.shape)
                rows.put(near, numbers, sign)
                rows.right(near, _bound(side, name, sign))
        if at is not None and at.near is not None:
            points = None if free is None else free.points
            keep_clear(
                rows,
                (body.com, body.rotation, joints, points),
                at,
                at.close(at.near),
                at.clearance_m,
            )
        objective(rows, layout, body, free)
        rows.square(joints, None, _STILL)
        rows.square(forces.columns, None, EVEN)
        rows.linear(share, TORQUE_PRICE)

    def _feet(
        self, body: BodyVariables, toes: Toes, joints: Index, leg_of: Index, layout: Layout
    ) -> None:
        """Every foot is at its toe."""
        rows = self.rows
        feet = rows.equal("feet", layout.frames, layout.limbs, 3)
        rows.put(feet, body.com[:, None], 1.0)
        toes.put(feet.reshape(-1, 3), np.array(layout.holds, dtype=np.int_).ravel(), -1.0)
        rows.put(feet[..., None], body.rotation[:, None, None], Of("by_turn"))
        rows.put(feet[:, leg_of], joints[..., None], Of("by_joint"))
        rows.right(feet, Of("feet_right"))

    def _torques(
        self, of: TorqueRows, body: BodyVariables, forces: Forces, joints: Index, share: Index
    ) -> None:
        """No torque has more of its limit than the share, which is what is wanted or more."""
        rows = self.rows
        torque = rows.at_most("torque", len(of.joint))
        rows.put(torque[:, None], forces.columns[of.contact], Of("torque.by_force"))
        rows.put(torque[:, None], body.rotation[of.frame], Of("torque.by_turn"))
        rows.put(torque[of.row], joints[of.frame[of.row], of.other], Of("torque.by_joint"))
        rows.put(torque, share, -1.0)
        rows.right(torque, Of("torque.right"))
        wanted = rows.at_most("wanted", 1)
        rows.put(wanted, share, -1.0)
        rows.right(wanted, -Of("wanted"))

    def solve(self, at: WholeBodyGiven) -> tuple[Point, Array] | None:
        """A point that is right to first order, and its joint angles; None where there is none."""
        solution = self.rows.solve(at)
        if not solution.solved:
            return None
        free = "weights" in solution.columns
        point = Point(
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            forces=solution.value("forces"),
            toes=toes_of(solution, at.scaled) if free else at.held.toes,
            residual=float(solution.value("residual").max()) if free else 0.0,
            objective=solution.objective,
            seconds=solution.seconds,
        )
        return point, at.angles + solution.value("joints")


def _bound(side: str, name: str, sign: float) -> Fill[Given]:
    """A bound of the trust region as rows have it."""
    return lambda given: sign * getattr(given, side)[name]


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
