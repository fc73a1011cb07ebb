"""Body-pose feedback: what feet push with besides the plan's forces, because the body is not where
it should be.

A wrench w = (m (k_p e_p + k_v ė_p), I (k_R e_R + k_ω ė_R)) pulls the body to its place. It and the
plan's own are shared among the feet that stand, about the centre of mass where it is; their forces
are

    argmin ‖Σ [1; r×] f − (w + w_planned)‖² + ε Σ ‖f − f_planned‖²,    every f inside a part of its
    friction cone,

so that a foot that has not landed is made up for, and one that is near its cone's border is spared.
That part is never less than what the plan itself uses, as on a slope of nearly atan μ: forces that
were cut there would not carry the body. The position loops of the joints stay beneath it.

Where no cone holds them, as nearly always, they are the solution of six equations; a conic program
is solved where one does.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.equilibrium.layout import Of
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.files.arrays import Array, check_numbers, lengths, read_only
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.urdf_reader import pinocchio

EVEN = 1e-3
"""Weight ε of the plan's forces against those that give the wrench."""
_TURNING = 1.5
"""Weight of a moment [1/m] against a force."""
_ROUNDS = 4
"""The least force holds others in hardly more rounds than two: then the program is asked."""
_EVEN, _FIRM = EVEN * np.eye(6), 1e-5 * np.eye(6)
"""The same as a matrix, and where forces are at the corners of soles, whose arms are short."""
_CORNER_ROUNDS = 8
WEIGHTS = read_only(np.repeat([1.0, _TURNING], 3), (6,), "weights")
_PLANNED = 0.95
"""Share of μ that forces may use where the plan uses as much."""
_LIGHT = 0.25
"""Share of what the plan has a foot press with that it may be relieved to: one that is to press with
little is what the robot turns about, and more than that turns it over."""


@dataclass(frozen=True, kw_only=True)
class BodyFeedback:
    """Gains of the pull of a body to its place; all in units of its own mass and inertia.

    Arguments:
        position_s2, velocity_s, rotation_s2, turn_s: k_p, k_v, k_R, k_ω; all 0 for no feedback.
        cone_share: of μ that forces may use, more where the plan does.
        least_share: of the weight that a foot which stands presses with, at least; less where the
            plan has it press with little.
        step_s: feet in the air step aside by what the body's velocity error makes in this time; for
            walks it is set by how high the robot stands.
    """

    position_s2: float = 80.0
    velocity_s: float = 18.0
    rotation_s2: float = 250.0
    turn_s: float = 30.0
    cone_share: float = 0.8
    least_share: float = 0.03
    step_s: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "body.", least=self.__annotations__)

    @property
    def acts(self) -> bool:
        """Is there any feedback?"""
        return any((self.position_s2, self.velocity_s, self.rotation_s2, self.turn_s))


BodyPose = tuple[Array, Array, Array]
"""Pose of the base: origin, shape (3,) [m], R_WB, shape (3, 3), velocity, linear and angular in the
world, shape (6,)."""


class BodyController:
    """Forces of the feet for one robot.

    Arguments:
        inertia_kgm2: of the whole robot in the base's frame, shape (3, 3).
    """

    def __init__(
        self, mass_kg: float, inertia_kgm2: Array, weight_n: float, feedback: BodyFeedback
    ) -> None:
        self._mass, self._inertia, self._weight, self._feedback = (
            mass_kg,
            inertia_kgm2,
            weight_n,
            feedback,
        )
        self._rows: dict[int, Rows[SimpleNamespace]] = {}
        self._log = pinocchio().log3
        self._shares: tuple[Samples | None, Array, Array] = None, np.zeros(0), np.zeros(0)
        self._asked: tuple[tuple[bytes, ...], Array] = (), np.zeros((0, 3))

    def wrench(self, wanted: BodyPose, found: BodyPose) -> Array:
        """Force [N] and moment [Nm] on the body in the world, shape (6,)."""
        (origin, rotation, velocity), (at, turn, goes), gains = wanted, found, self._feedback
        late = velocity - goes
        force = gains.position_s2 * (origin - at) + gains.velocity_s * late[:3]
        away = self._log(rotation @ turn.T)
        moment = (
            turn @ self._inertia @ turn.T @ (gains.rotation_s2 * away + gains.turn_s * late[3:])
        )
        return np.concatenate([self._mass * force, moment])

    def planned(self, sample: Samples, stands: NDArray[np.bool_]) -> Array:
        """``forces`` of a body that is where it should be, over feet that are; they stay while what
        is planned does.
        """
        parts = (
            sample.forces_n,
            sample.wrench,
            sample.arms_m[stands],
            sample.frames[stands],
            sample.friction,
        )
        key = (stands.tobytes(), *(part.tobytes() for part in parts))
        if key != self._asked[0]:
            self._asked = (
                key,
                self.forces(np.zeros(6), sample, sample.arms_m, sample.forces_n, stands),
            )
        return self._asked[1]

    def forces(
        self,
        wrench: Array,
        sample: Samples,
        arms_m: Array,
        planned_n: Array,
        stands: NDArray[np.bool_],
    ) -> Array:
        """Forces of all feet, those of the plan and the wrench together, shape (N, 3) [N].

        Arguments:
            arms_m: feet from the centre of mass, shape (N, 3), world frame.
            stands: who touches; others get what is planned.
        """
        whole = stands.all()
        if not (whole or stands.any()):
            return planned_n
        rows = slice(None) if whole else stands
        frames = sample.frames[rows]
        maps = np.concatenate([frames, _TURNING * skew(arms_m[rows]) @ frames], axis=1)
        planned = np.einsum("nik,ni->nk", frames, planned_n[rows])
        arms, planned = maps.transpose(1, 0, 2).reshape(6, -1), planned / self._weight
        wanted = WEIGHTS * (wrench + sample.wrench) / self._weight
        friction, least = (shares[rows] for shares in self._limits(sample))
        force = self._of_no_cone(arms, wanted, planned, friction, least)
        if force is None:
            asked = SimpleNamespace(
                arms=arms, wanted=wanted, planned=planned, friction=friction, least=least
            )
            solution = self._program(len(frames)).solve(asked)
            found = solution.value("forces") if solution.solved else planned
            force = _inside(found, friction, least)
        force_n = np.einsum("nik,nk->ni", frames, self._weight * force)
        if whole:
            return np.asarray(force_n)
        result = np.array(planned_n)
        result[rows] = force_n
        return result

    def at_corners(
        self,
        wrench: Array,
        sample: Samples,
        owner: NDArray[np.int_],
        arms_m: Array,
        planned_n: Array,
        stands: NDArray[np.bool_],
    ) -> Array:
        """Forces at K corners of soles that make a wrench on the body, as near to planned ones as
        goes, shape (K, 3) [N]. Corners that would pull bear nothing, and what is outside of a
        cone is cut off.

        Arguments:
            wrench: all of it, about the centre of mass, world frame, shape (6,).
            owner: the foot of every corner, shape (K,).
            arms_m: from the centre of mass, world frame, shape (K, 3).
            planned_n: shape (K, 3).
            stands: which corners touch, shape (K,).
        """
        frames, friction = sample.frames[owner], self._limits(sample)[0][owner]
        maps = np.concatenate([frames, _TURNING * skew(arms_m) @ frames], axis=1)
        planned = np.einsum("nik,ni->nk", frames, planned_n) / self._weight
        wanted, force, held = WEIGHTS * wrench / self._weight, planned, ~stands
        for _ in range(_CORNER_ROUNDS):
            start = np.where(held[:, None], 0.0, planned)
            arms = np.where(held[:, None, None], 0.0, maps).transpose(1, 0, 2).reshape(6, -1)
            lacks = wanted - arms @ start.ravel()
            force = start + (np.linalg.solve(arms @ arms.T + _FIRM, lacks) @ arms).reshape(-1, 3)
            pulls = held | (force[:, 0] < 0.0)
            if (pulls == held).all():
                break
            held = pulls
        force[:, 0] = np.maximum(force[:, 0], 0.0)
        across = np.maximum(lengths(force[:, 1:]), 1e-9)
        force[:, 1:] *= np.minimum(1.0, friction * force[:, 0] / across)[:, None]
        return np.asarray(np.einsum("nik,nk->ni", frames, self._weight * force))

    def _of_no_cone(
        self, arms: Array, wanted: Array, planned: Array, friction: Array, least: Array
    ) -> Array | None:
        """The program's forces where no cone holds them, p + Aᵀ y, and where they would be less, the
        least ones; in the feet's frames and units of the weight, shape (n, 3). None where a cone
        does.

        y solves (B Bᵀ + ε) y = w − A p, with B = A but zero, and p the least force, in the columns
        that are held there. Those are found anew until they stay. Arguments as of ``_program``.
        """
        free, start, held = arms, planned, np.zeros(len(planned), dtype=np.bool_)
        for _ in range(_ROUNDS):
            lacks = np.linalg.solve(free @ free.T + _EVEN, wanted - arms @ start.ravel())
            force = planned + (lacks @ arms).reshape(planned.shape)
            light = force[:, 0] < least
            if (light == held).all():
                force[held, 0] = least[held]
                inside = lengths(force[:, 1:]) <= friction * force[:, 0]
                return force if inside.all() else None  # nor where one is not finite
            free, start, held = arms.copy(), planned.copy(), light
            free[:, ::3][:, held], start[held, 0] = 0.0, least[held]
        return None

    def _limits(self, sample: Samples) -> tuple[Array, Array]:
        """The part of μ that the forces of every foot may use, and the least of the weight that it
        presses with, shape (N,) each.
        """
        if self._shares[0] is not sample:
            few = self._feedback.least_share
            used = sample.across_n / np.maximum(sample.along_n, max(few * self._weight, 1e-9))
            share, most = self._feedback.cone_share * sample.friction, _PLANNED * sample.friction
            least = np.clip(_LIGHT * sample.along_n / self._weight, 0.0, few)
            self._shares = sample, np.maximum(share, np.minimum(used, most)), least
        return self._shares[1:]

    def _program(self, count: int) -> Rows[SimpleNamespace]:
        """The program for n feet, in their own frames and units of the weight: of arms, the map from
        forces to their sum and moment, shape (6, 3n), these as wanted, shape (6,), forces as planned,
        shape (n, 3), and friction and least force of every foot, shape (n,) each.
        """
        if count not in self._rows:
            self._rows[count] = rows = Rows[SimpleNamespace](keep=True)
            forces, lacks = rows.variable("forces", count, 3), rows.variable("lacks", 6)
            balance, least = rows.equal("balance", 6), rows.at_most("least", count)
            cone = rows.cones("cone", count, 3)
            rows.put(balance[:, None], forces.reshape(1, -1), Of("arms"))
            rows.put(balance, lacks, 1.0)
            rows.right(balance, Of("wanted"))
            rows.put(least, forces[:, 0], -1.0)
            rows.right(least, -Of("least"))
            rows.put(cone[:, 0], forces[:, 0], -Of("friction"))
            rows.put(cone[:, 1:], forces[:, 1:], -1.0)
            rows.square(lacks, None, 1.0)
            rows.square(forces, None, EVEN)
            rows.linear(forces, -2.0 * EVEN * Of("planned"))
        return self._rows[count]


def _inside(force: Array, friction: Array, least: Array) -> Array:
    """Project forces into the cones, and onto the least force, which a solver leaves by its
    tolerance; forces: in their frames, and units of the weight.
    """
    along = np.maximum(force[:, 0], least)
    share = np.minimum(1.0, friction * along / np.maximum(lengths(force[:, 1:]), 1e-9))
    return np.column_stack([along, share[:, None] * force[:, 1:]])


def skew(v: Array) -> Array:
    """[v]×, shape (n, 3) to (n, 3, 3)."""
    matrices = np.zeros((len(v), 3, 3))
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return matrices - matrices.transpose(0, 2, 1)
