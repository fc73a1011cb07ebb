"""The motion of a leap: the body as its forces move it, and feet that go from foothold to
foothold.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import LeapPlan
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, cross
from ..physics import GRAVITY_M_S2
from ..robot.inverse_kinematics import WholeBody
from ..robot.leg import rotations_of
from ..terrain.patch import solids_of
from .joints import MovingBody
from .motion import Played, Samples

_STEP_S = 0.005
"""Spacing of the samples, at most."""
LEAST = 4
"""Samples of the shortest leap: torques are measured at those within."""
_TURNS = 6
"""Rounds in which legs and the body that they turn agree; each leaves a third or less of what is
off."""
_SINGULAR = 0.03
"""Directions in which a stretched leg moves its foot by less than this share of others are left
out."""
_QUICK = 15
"""Steps of inverse kinematics from the round before; a foot that was out of reach stays there."""


GATHER = (0.3, 0.8)
"""Times of a plan that does not say how legs are drawn up: see ``Motion``."""


class LeapBody:
    """A leap of a robot whose legs are known, at K samples; N limbs.

    times_s: shape (K,) [s]. com_m, velocity_m_s, momentum_m2_s: exact, shape (K, 3). rotation:
    R_WB, shape (K, 3, 3). centres_m, normals: of the feet, and of the surface below them, shape (K,
    N, 3). forces_n: shape (K, N, 3) [N]. holds: foothold under every limb, −1 in the air, shape (K,
    N). postures: of the whole robot. kinematics: of its legs. spins: ∂ω/∂L per mass, shape (K, 3, 3).

    Arguments:
        quick: half as many samples, and no other posture is looked for where a foot is out of reach
            from the one in which it stands.

    Raises:
        InvalidInput: for a robot without legs of its own, and without pinocchio.
    """

    def __init__(
        self,
        plan: LeapPlan,
        body: MovingBody | None = None,
        *,
        quick: bool = False,
    ) -> None:
        robot = plan.problem.robot
        if not robot.own:
            raise InvalidInput(f"robot {robot.name}: expected legs of its own, its file has none")
        self.plan, self._quick = plan, quick
        edge, fold = GATHER if plan.gather is None else plan.gather
        self._edge, self._fold = float(edge), float(fold)
        self._body = body or MovingBody(robot.own_model())
        self.kinematics = self._body.kinematics
        self._radii = self.kinematics.radii_m
        ends = plan.ends_s
        count = int(np.ceil((ends[-1] - ends[0]) / (2.0 * _STEP_S if quick else _STEP_S))) + 1
        self.times_s = np.linspace(ends[0], ends[-1], max(count, LEAST))
        self._k = np.clip(
            np.searchsorted(ends, self.times_s + 1e-9, side="right") - 1, 0, len(ends) - 2
        )
        self._holds = plan.problem.holds[plan.problem.interval_phases]
        self.holds: NDArray[np.int_] = self._holds[self._k]
        self.forces_n = plan.forces_n[self._k]
        self._follow()
        self._turn()

    def _follow(self) -> None:
        """c, v and L at the samples, by the plan's forces."""
        plan, k = self.plan, self._k
        t = (self.times_s - plan.ends_s[k])[:, None]
        mass = plan.problem.robot.mass_kg
        push = self.forces_n.sum(axis=1) / mass + np.array([0.0, 0.0, -GRAVITY_M_S2])
        self.velocity_m_s = plan.velocity_m_s[k] + t * push
        self.com_m = plan.com_m[k] + t * plan.velocity_m_s[k] + 0.5 * t**2 * push
        # ∫ Σ (p − c) × f dt = Σ p × f t − (c₀ t + v₀ t²/2 + a t³/6) × F
        toes = plan.toes_m[np.maximum(self.holds, 0)]
        total = self.forces_n.sum(axis=1) / mass
        fixed = cross(toes, self.forces_n).sum(axis=1) / mass
        moved = plan.com_m[k] * t + 0.5 * plan.velocity_m_s[k] * t**2 + push * t**3 / 6.0
        self.momentum_m2_s = plan.momentum_m2_s[k] + fixed * t - cross(moved, total)

    def _turn(self) -> None:
        """Feet, joints and the rotation that follows from both, in turns."""
        plan = self.plan
        share = (self.times_s - plan.ends_s[self._k]) / np.diff(plan.ends_s)[self._k]
        table = plan.rotation_rad
        self.rotation = rotations_of(
            table[self._k] + share[:, None] * (table[self._k + 1] - table[self._k])
        )
        self._planned = self.rotation
        self._feet()
        stands = np.concatenate([leg.stance_rad for leg in self._body.model.legs])
        near = np.tile(stands, (len(self.times_s), 1))
        for turn in range(_TURNS):
            self.postures = self._body.postures(
                self.com_m,
                self.rotation,
                self.toes_m,
                self.normals,
                self.contact,
                near=near,
                rounds=3 if turn == 0 else 1,
                steps=_QUICK if turn or self._quick else 0,
            )
            near = self.postures.angles
            if turn < _TURNS - 1:
                self.rotation = self._turned(self.postures)

    def _feet(self) -> None:
        """Centres of the feet, and the normals below them: in the air they go from one surface's to
        the other's.
        """
        plan = self.plan
        facing = np.array([patch.normal for patch in plan.patches])
        shape = (len(self.times_s), len(self._radii), 3)
        self.centres_m, self.normals, self._moves = (np.zeros(shape) for _ in range(3))
        for i in range(shape[1]):
            stands = self.holds[:, i] >= 0
            j = np.maximum(self.holds[:, i], 0)
            self.normals[:, i] = facing[j]
            self.centres_m[:, i] = plan.toes_m[j] + self._radii[i] * facing[j]
            for first, last in gaps(stands):
                self._fly(i, first, last)

    def _fly(self, limb: int, first: int, last: int) -> None:
        """One limb's way through the air, between the samples at which it stands last and first
        again; the ends of a leap have none beyond them.
        """
        from scipy.interpolate import CubicSpline  # slow to import

        rows = np.arange(max(first, 0), min(last, len(self.times_s) - 1) + 1)
        here = slice(rows[0], rows[-1] + 1)
        leaves, lands = self._flight(limb, rows)
        begin, end = (float(self.plan.ends_s[k]) for k in (leaves, lands))
        times = np.clip(self.times_s[here], begin, end)
        at = [
            rows[0] if first >= 0 else rows[-1],
            rows[-1] if last < len(self.times_s) else rows[0],
        ]
        normals = self.normals[at, limb]
        share = ((times - begin) / (end - begin))[:, None]
        facing = normals[0] + share * (normals[1] - normals[0])
        self.normals[here, limb] = facing / np.linalg.norm(facing, axis=1, keepdims=True)
        there = [leaves if first >= 0 else lands, lands if last < len(self.times_s) else leaves]
        ends = self.centres_m[at, limb] - self.plan.com_m[there]  # in axes that do not turn
        moves = -self.plan.velocity_m_s[there]
        leg = self.plan.problem.leg(self.plan.problem.robot.limbs[limb])
        edge = self._edge
        shares = np.array([[edge], [1.0 - edge]])
        mids = ends[0] + shares * (ends[1] - ends[0])
        hips = np.einsum("mij,j->mi", self._planned[at], leg.hip_m)
        away = mids - (hips[0] + shares * (hips[1] - hips[0]))
        lengths = np.linalg.norm(ends - hips, axis=1)
        folded = max(self._fold * float(lengths.min()), 1.1 * leg.fold_m)
        fold = np.minimum(folded / np.maximum(np.linalg.norm(away, axis=1), 1e-9), 1.0)
        mids += (fold[:, None] - 1.0) * away
        knots = begin + np.array([0.0, edge, 1.0 - edge, 1.0]) * (end - begin)
        path = CubicSpline(
            knots, np.vstack([ends[:1], mids, ends[1:]]), bc_type=((1, moves[0]), (1, moves[1]))
        )
        placed = path(times) + self.com_m[here]
        moving = path(times, 1) + self.velocity_m_s[here]
        flies = self.holds[here, limb] < 0
        self.centres_m[here, limb] = np.where(flies[:, None], placed, self.centres_m[here, limb])
        self._moves[here, limb] = np.where(flies[:, None], moving, 0.0)

    def _flight(self, limb: int, rows: NDArray[np.int_]) -> tuple[int, int]:
        """At which ends of intervals a limb leaves and lands."""
        air = self._holds[:, limb] < 0
        first = last = int(self._k[rows[min(1, len(rows) - 1)]])
        while first > 0 and air[first - 1]:
            first -= 1
        while last + 1 < len(air) and air[last + 1]:
            last += 1
        return first, last + 1

    def _turned(self, postures: WholeBody) -> Array:
        """R_WB that leaves the whole robot with the momentum of the plan, shape (K, 3, 3).

        Feet go where they should whatever the body does, ẋ = J_b v_b + J_q q̇, so that (A_b − A_q
        J_q⁻¹ J_b) v_b = h − A_q J_q⁻¹ ẋ.
        """
        from ..robot.urdf_reader import pinocchio  # slow to import

        pin, solver = pinocchio(), self.kinematics
        known, mass = solver.known, self.plan.problem.robot.mass_kg
        data, first, axes = known.createData(), solver.base_moves, np.empty_like(self.rotation)
        feet = [known.getFrameId(f"{leg.name}: foot") for leg in self._body.model.legs]
        maps, jacobians = list[Array](), list[list[Array]]()
        for k, angles in enumerate(postures.angles):
            state = solver.configuration(angles)
            placed = solver.carried(self.rotation[k], postures.origin_m[k])
            state[solver.base], axes[k] = pin.SE3ToXYZQUAT(placed), placed.rotation
            maps.append(pin.computeCentroidalMap(known, data, state).copy())
            pin.computeJointJacobians(known, data, state)
            pin.updateFramePlacements(known, data)
            jacobians.append(
                [pin.getFrameJacobian(known, data, i, pin.LOCAL_WORLD_ALIGNED)[:3] for i in feet]
            )
        full = np.array(maps)
        wanted = mass * np.hstack([self.velocity_m_s, self.momentum_m2_s])[..., None]
        body = full[..., first].copy()
        for i, moved in enumerate(np.swapaxes(jacobians, 0, 1)):
            mine = solver.columns[solver.legs == i]
            swung = full[..., mine] @ np.linalg.pinv(moved[..., mine], rcond=_SINGULAR)
            body -= swung @ moved[..., first]
            wanted -= swung @ self._moves[:, i, :, None]
        inverse = np.linalg.inv(body)
        self.spins = mass * axes @ inverse[:, 3:, 3:]
        spin = (axes @ (inverse @ wanted)[:, 3:])[..., 0]
        turns = rotations_of(0.5 * (self.times_s[1] - self.times_s[0]) * (spin[1:] + spin[:-1]))
        start = rotations_of(self.plan.problem.start.rotation_rad)
        return np.array(list(accumulate([start, *turns], lambda before, turn: turn @ before)))

    @cached_property
    def mean_forces_n(self) -> Array:
        """Forces as differences of velocities see them: means with weights that fall off from a
        sample to its neighbours, shape (K, N, 3) [N].

        Forces jump where a limb leaves or lands, and the acceleration there is that of both sides.
        """
        ends, forces = self.plan.ends_s, self.plan.forces_n
        lasts = np.diff(ends)[:, None, None]
        once = np.concatenate([np.zeros_like(forces[:1]), np.cumsum(forces * lasts, axis=0)])
        grown = once[:-1] * lasts + 0.5 * forces * lasts**2
        twice = np.concatenate([np.zeros_like(forces[:1]), np.cumsum(grown, axis=0)])

        def integral(times_s: Array) -> Array:
            k = np.clip(np.searchsorted(ends, times_s, side="right") - 1, 0, len(forces) - 1)
            t = (times_s - ends[k])[:, None, None]
            return np.asarray(twice[k] + once[k] * t + 0.5 * forces[k] * t**2)

        step = float(self.times_s[1] - self.times_s[0])
        after, now, before = (integral(self.times_s + s * step) for s in (1.0, 0.0, -1.0))
        return np.asarray((after - 2.0 * now + before) / step**2)

    @property
    def toes_m(self) -> Array:
        """Lowest points of the feet along the normals, shape (K, N, 3) [m]."""
        return np.asarray(self.centres_m - self._radii[:, None] * self.normals)

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Limbs that stand, shape (K, N)."""
        return np.asarray(self.holds >= 0)

    @cached_property
    def rotation_rad(self) -> Array:
        """Rotation vectors of the body, shape (K, 3) [rad]."""
        from scipy.spatial.transform import Rotation  # slow to import

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())


def body_of(plan: LeapPlan) -> LeapBody:
    """The leap with its legs, at samples; made once for whoever judges, runs or shows it.

    Raises InvalidInput for a robot without legs of its own, and without pinocchio.
    """
    body: LeapBody = vars(plan).get("_body") or vars(plan).setdefault("_body", LeapBody(plan))
    return body


def gaps(stands: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Rows before and behind every stretch in which a limb does not stand; −1 and K beyond the
    ends.
    """
    padded = np.concatenate([[True], stands, [True]])
    begins = np.flatnonzero(padded[:-1] & ~padded[1:]) - 1
    ends = np.flatnonzero(~padded[:-1] & padded[1:])
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def feet_of_leap(plan: LeapPlan) -> Played:
    """A leap over time; ``Samples.frame`` counts seconds, and joints are not known.

    c and v are exact, Θ is a cubic between the ends of an interval, and forces are constant within
    one. A foot in the air goes straight in the frame of the body, from where it left to where it
    lands.
    """
    leap, ends = plan.problem, plan.ends_s
    patches = plan.patches
    facing = np.array([patch.normal for patch in patches])
    friction = np.array([patch.friction for patch in patches])
    radii, holds = leap.robot.foot_radii_m, leap.holds[leap.interval_phases]
    surfaces, (left, lands), legs = _surfaces(holds), _flights(holds), np.arange(holds.shape[1])
    from_body = _from_body(plan, holds, surfaces)

    def toes(k: NDArray[np.int_], when: Array, com: Array, rotation: Array) -> Array:
        """Places of all toes, shape (…, N, 3) [m]."""
        begin, end = ends[left[k]], ends[lands[k]]
        share = (when[..., None] - begin) / np.maximum(end - begin, 1e-12)
        first, second = from_body[left[k], legs, 0], from_body[lands[k], legs, 1]
        aside = first + share[..., None] * (second - first)
        flying = com[..., None, :] + np.einsum("...ij,...nj->...ni", rotations_of(rotation), aside)
        return np.where((holds[k] >= 0)[..., None], plan.toes_m[np.maximum(holds[k], 0)], flying)

    def at(times_s: float | Array) -> Samples:
        when = np.clip(np.asarray(times_s, dtype=np.float64), ends[0], ends[-1])
        k = np.clip(np.searchsorted(ends, when, side="right") - 1, 0, len(ends) - 2)
        t, last = (when - ends[k])[..., None], (ends[k + 1] - ends[k])[..., None]
        push = plan.forces_n[k].sum(axis=-2) / leap.robot.mass_kg - [0.0, 0.0, GRAVITY_M_S2]
        com = plan.com_m[k] + t * plan.velocity_m_s[k] + 0.5 * t**2 * push
        rotation, rate = _turned(plan, k, t / last, last)
        surface = surfaces[k]
        return Samples(
            com_m=com,
            velocity_m_s=plan.velocity_m_s[k] + t * push,
            rotation_rad=rotation,
            rotation_rate_rad_s=rate,
            frame=when,
            feet_m=toes(k, when, com, rotation) + radii[:, None] * facing[surface],
            radii_m=radii,
            forces_n=plan.forces_n[k],
            foothold=holds[k],
            normals=facing[surface],
            friction=friction[surface],
        )

    return Played(at=at, knots_s=ends, solids=solids_of(patches))


def _turned(plan: LeapPlan, k: NDArray[np.int_], s: Array, last: Array) -> tuple[Array, Array]:
    """Θ and its rate a share s into interval k, which lasts so long, shape (…, 3) each."""
    robot = plan.problem.robot
    assert robot.inertia is not None
    rates = plan.momentum_m2_s @ np.linalg.inv(robot.inertia / robot.mass_kg).T
    first, second = plan.rotation_rad[k], plan.rotation_rad[k + 1]
    rotation = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * second
    rotation += last * ((s**3 - 2 * s**2 + s) * rates[k] + (s**3 - s**2) * rates[k + 1])
    rate = 6 * (s**2 - s) * (first - second) / last
    rate += (3 * s**2 - 4 * s + 1) * rates[k] + (3 * s**2 - 2 * s) * rates[k + 1]
    return np.asarray(rotation), np.asarray(rate)


def _surfaces(holds: NDArray[np.int_]) -> NDArray[np.int_]:
    """The foothold that every limb has, comes to, or else had last, in every interval, shape (M,
    N).

    Arguments:
        holds: the one that it has, −1 in the air, shape (M, N).
    """
    surface = holds.copy()
    for i in range(surface.shape[1]):
        stands = np.flatnonzero(surface[:, i] >= 0)
        after = np.searchsorted(stands, np.arange(len(surface)))
        surface[:, i] = surface[stands[np.minimum(after, len(stands) - 1)], i]
    return surface


def _flights(holds: NDArray[np.int_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Ends of intervals at which each limb left last and lands next, itself where it stands, shape
    (M, N) each.
    """
    rows = np.arange(len(holds))[:, None]
    left = np.maximum.accumulate(np.where(holds >= 0, rows + 1, 0))
    return left, np.minimum.accumulate(np.where(holds >= 0, rows, len(holds))[::-1])[::-1]


def _from_body(plan: LeapPlan, holds: NDArray[np.int_], surfaces: NDArray[np.int_]) -> Array:
    """Toes seen from the body at the ends of intervals, of the foothold before and after each of
    them, shape (M + 1, N, 2, 3) [m]; where a limb has none on one side the other one's.
    """
    none = np.full((1, holds.shape[1]), -1)
    around = np.stack([np.concatenate([none, holds]), np.concatenate([holds, none])], axis=2)
    last = np.concatenate([surfaces[:1], surfaces])[..., None]
    toes = plan.toes_m[np.where(around >= 0, around, last)] - plan.com_m[:, None, None]
    return np.asarray(np.einsum("mji,mnsj->mnsi", rotations_of(plan.rotation_rad), toes))


SETTLE_S, REST_S = 0.5, 2.0
"""At rest before, and after: a robot that stands so long has landed."""
_LIGHT = 0.1
"""Toes that press with less than this share of the weight in all are about to lift."""
_KNOT_S = 0.02
"""Postures are looked for so often."""


def leap_motion(plan: LeapPlan, settle_s: float = SETTLE_S, rest_s: float = REST_S) -> Played:
    """A leap of a robot whose legs are known, over time; ``Samples.frame`` counts seconds.

    Arguments:
        plan: the leap.
        settle_s, rest_s: how long it rests before and after [s].

    Raises:
        InvalidInput: for a robot without legs of its own.
    """
    from scipy.interpolate import CubicSpline, make_interp_spline  # slow to import

    body, feet = body_of(plan), feet_of_leap(plan)
    vectors = CubicSpline(body.times_s, body.rotation_rad, bc_type="clamped")
    centres = CubicSpline(body.times_s, body.centres_m, bc_type="clamped")
    normals, rates = make_interp_spline(body.times_s, body.normals, k=1), vectors.derivative()
    duration_s = float(plan.ends_s[-1]) + settle_s + rest_s

    def at(times_s: float | Array) -> Samples:
        times = np.asarray(times_s, dtype=np.float64)
        when = np.clip(times - settle_s, body.times_s[0], body.times_s[-1])
        moves = (when == times - settle_s)[..., None]
        base, facing = feet.at(when), normals(when)
        stands = base.stands[..., None]
        facing = facing / np.linalg.norm(facing, axis=-1, keepdims=True)
        return replace(
            base,
            velocity_m_s=np.where(moves, base.velocity_m_s, 0.0),
            rotation_rad=vectors(when),
            rotation_rate_rad_s=np.where(moves, rates(when), 0.0),
            frame=np.clip(times, 0.0, duration_s),
            feet_m=np.where(stands, base.feet_m, centres(when)),
            normals=np.where(stands, base.normals, facing),
        )

    rests = float(plan.ends_s[-1]) + settle_s + SETTLE_S if rest_s > SETTLE_S else duration_s
    return Played(
        at=at,
        knots_s=np.linspace(0.0, duration_s, int(np.ceil(duration_s / _KNOT_S)) + 1),
        stances=tuple(
            f"{foothold.limb}, put down in phase {foothold.frame},"
            for foothold in plan.problem.footholds
        ),
        committed_s=tuple((begin + settle_s, rests) for begin in _committed_s(plan)),
    )


def _committed_s(plan: LeapPlan) -> list[float]:
    """When the body goes into the air whatever its legs do [s]: in the middle of the last phase that
    pushes before the first flight; never where some limb always stands. Legs that are held while
    they push throw a robot off its feet from there to the end.
    """
    leap = plan.problem
    air = (leap.holds[leap.interval_phases] < 0).all(axis=1)
    if not air.any():
        return []
    pushes = np.linalg.norm(plan.forces_n.sum(axis=1), axis=1) > _LIGHT * leap.weight_n
    lifts = np.flatnonzero(pushes[: int(np.argmax(air))])
    if not len(lifts):
        return [float(plan.ends_s[0])]
    first = int(np.argmax(leap.interval_phases == leap.interval_phases[lifts[-1]]))
    return [float(plan.ends_s[[first, int(lifts[-1]) + 1]].mean())]
