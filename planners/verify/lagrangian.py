"""Proof in the leaf of a certificate: weak duality for posture problems and courses, matrix-vector
work, no solver.

All numbers here are non-dimensional: lengths over the length scale, forces over the force scale. At
key frame k the body has its COM at c and rotation Θ; limb i with shoulder s and reach ρ stands on a
toe q, which a foothold put on one of its candidate patches (a *candidate*; v_u the vertices of the
piece of it that is left in this leaf, C its frame, E3, μ its friction); in a stance some limbs
carry the weight w with forces f in the box B. A posture is one frame with one stance. With
multipliers ν_F, ν_M of the balances of every stance (E5, E6), r of every limb's reach at every
frame, a, t, g of every step of the body and b of every step of a toe (E11), every plan that meets
all constraints but the balances of moments, whose largest component is off by ε, has

    Σ_stances ν_F·(Σ C f − w e_z) + ν_M·(Σ q × C f − c × w e_z)
      + Σ_limbs [r·(q − c − s − Θ × s) − ρ‖r‖]
      + Σ_steps [a·(c' − c) − Δ_c‖a‖ + t·(Θ' − Θ) − Δ_Θ‖t‖ + g (progress − d·(c' − c))]
      + Σ_toes [b·(q' − q) − Δ_p‖b‖]
      ≤  Σ_stances ‖ν_M‖₁ ε.

Half-spaces of reach add terms of the form of r (``geometry``), those of feet Σ σ (a·(q' − q) −
b), σ ≥ 0, further rows of the body's steps Σ σ (a·(c' − c, Θ' − Θ) − b), σ ≥ 0. Sides of least steps
(``problem.sides``) are such rows, b − n·(q' − q) and b − n·(Θ' − Θ), which each leaf has of its own.

(The moment about c is Σ q × C f − c × w e_z because Σ C f = w e_z; q and c are in the world frame;
g ≥ 0.) A force F and a moment M on the body beside its weight add ν_F·F + ν_M·(c × F + M) in their
stances. Where the least value ℓ of the left side is positive, ε ≥ ℓ / Σ ‖ν_M‖₁. It separates: a
ball for each c, a box for each Θ, and for each toe the least over its open candidates and their
vertices v of (Σ r + Σ b)·v + Σ_stances min {a·f : f in B and in the friction cone}, a = Cᵀ(ν_F +
ν_M × v). A candidate of a force box that misses the cone is closed, and a leaf in which a foothold
has no candidate left is empty: its bound is infinite, whatever the multipliers.

*Slack.* An answer may break every constraint by ``_SLACK``. Then a term moves by no more than: ‖r‖
SLACK and so on for reach, steps and progress, each limit being widened; (‖r‖ + ‖b‖ of a toe and
‖ν_M‖ ‖f‖) times its distance from the pieces; ‖ν_F‖ SLACK + ‖ν_M‖ (1 + ‖c‖) SLACK for the balances,
where the force that is left over acts at c. All of that is taken off, and nothing is proved unless
ℓ stays positive.

*Rounding.* ℓ is a sum of products of multipliers with numbers of the problem. Each frame adds to it
some hundred rounded operations at most; each loses 1.1e-16 of the size of what it works on, so all
of them lose less than 1e-13 M of the sum of these sizes over M frames. Ten times that, ``_GUARD`` M
of the sum, is taken off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..files.arrays import Array, cross, lengths
from .geometry import most_turned
from .stances import Index, Schedule


def multiplier_shapes(who: Schedule) -> dict[str, tuple[int, ...]]:
    """Shape of every group of a leaf's multipliers, in the order in which a row has them.

    Half-spaces of reach are ``reach_rows``, those of feet ``relative_reach``, and further rows of
    the body's steps ``linear_step`` (``StepLimits.linear_rows``).
    """
    (frames, limbs), stances = who.holds.shape, len(who.frame)
    return {
        "nu_F": (stances, 3),
        "nu_M": (stances, 3),
        "reach": (frames, limbs, 3),
        "com_step": (frames - 1, 3),
        "rotation_step": (frames - 1, 3),
        "progress": (frames - 1,),
        "toe_step": (len(who.moves), 3),
        "reach_rows": (frames, len(who.row_limb)),
        "relative_reach": (len(who.apart),),
        "linear_step": (frames - 1, who.linear),
    }


def multipliers_of(who: Schedule, rows: Array) -> dict[str, Array]:
    """Multipliers of L leaves by group, shape (L, …) each, from rows of a certificate, (L, count)."""
    parts, begin = dict[str, Array](), 0
    for name, shape in multiplier_shapes(who).items():
        end = begin + math.prod(shape)
        parts[name] = rows[:, begin:end].reshape(len(rows), *shape)
        begin = end
    return parts


def multiplier_count(who: Schedule) -> int:
    """Number of multipliers per leaf."""
    return sum(math.prod(shape) for shape in multiplier_shapes(who).values())


_SLACK = 1e-6
"""A certificate must also refute postures that break constraints by this much: ``check_plan``
accepts those."""


def least_works(
    a: Array, lower: Array, upper: Array, friction: Array, slack: float = _SLACK
) -> tuple[Array, Array]:
    """Proved lower bounds on min {a·f : lower ≤ f ≤ upper, ‖(f_y, f_z)‖ ≤ μ f_n} for each of V
    rows, shape (V,), and the same with every inequality widened by ``slack``.

    Arguments:
        a, lower, upper: shape (V, 3), in the contact frame.
        friction: shape (V,). By duality every κ in the plane gives the bound min {(a_n − μ‖κ‖) f_n
            + (a_t − κ)·f_t : f in the box}, a concave function of κ. Its maximum lies at 0, on a
            line κ_y = a_y or κ_z = a_z, or on the circle μ‖κ‖ = a_n: where two of these meet or
            where it is stationary on one. All such points are tried and none is trusted: rounding
            and degenerate boxes can only lower the result.
    """
    an, ay, az = np.ascontiguousarray(
        a.T
    )  # a row a candidate, a column a force: the long axis last
    (low, *least), (high, *most) = np.ascontiguousarray(lower.T), np.ascontiguousarray(upper.T)
    mu = friction
    below = np.where(mu > 0.0, np.maximum(low, 0.0), low)  # the cone has f_n ≥ 0
    high = np.maximum(high, 0.0)
    y, z = np.array(
        [[least[0], most[0]], [least[1], most[1]]]
    )  # the two bounds of each shear, (2, V) each
    cone = mu * np.array([below, high])  # largest shear at either end of f_n
    circle = np.maximum(an, 0.0) / np.maximum(mu, 1e-12)

    k = np.zeros((2, 18, len(a)))  # κ_y and κ_z of all points that are tried; the first is 0
    k[0, 1:8], k[1, 1], k[1, 8:14] = ay, az, az
    for other, fixed, bounds in (
        (k[0, 8:14], az, y),
        (k[1, 2:8], ay, z),
    ):  # on a line, where one of κ is fixed
        steep = (cone * cone)[:, None] - bounds * bounds
        stationary = -np.abs(fixed) * bounds / np.sqrt(np.maximum(steep, 1e-14))
        other[:4] = stationary.reshape(4, -1)
        other[4] = np.sqrt(np.maximum(circle * circle - fixed * fixed, 0.0))  # and on the circle
        other[5] = -other[4]
    corners = np.array([y[[0, 0, 1, 1]], z[[0, 1, 0, 1]]])
    k[:, 14:] = corners * (-circle / np.maximum(np.sqrt(corners[0] ** 2 + corners[1] ** 2), 1e-12))
    ky, kz = k
    size = np.sqrt(ky * ky + kz * kz)
    dn, dy, dz = an - mu * size, ay - ky, az - kz
    value = np.minimum(dn * below, dn * high)
    value += np.minimum(dy * y[0], dy * y[1])
    value += np.minimum(dz * z[0], dz * z[1])
    value -= size * (
        1e-14 * (cone[1] + np.abs(y).max(axis=0) + np.abs(z).max(axis=0))
    )  # far more than rounding loses
    pulling = np.minimum(slack / np.maximum(mu, 1e-300), below - low)  # f_n ≥ −slack / μ
    widened = slack * (size + np.abs(dy) + np.abs(dz)) + (slack + pulling) * np.abs(dn)
    return np.asarray(value.max(axis=0)), np.asarray((value - widened).max(axis=0))


def _misses_cone(lower: Array, upper: Array, friction: Array) -> NDArray[np.bool_]:
    """Tell where no force is within ``_SLACK`` of both force box, shape (V, 3) each, and friction
    cone; shape (V,).
    """
    shear = np.maximum(np.maximum(lower[:, 1:], -upper[:, 1:]), 0.0)
    nearest = np.sqrt((shear * shear).sum(axis=1))
    most = friction * (upper[:, 0] + _SLACK) + _SLACK  # largest shear
    return np.asarray((most < 0.0) | (nearest > most + 1.5 * _SLACK))


_GUARD = 1e-12
"""Every leaf's bound is lowered by this share of its terms, times the number of frames."""
_MOST_ROWS = 2048
"""So many forces (a vertex, a limb that carries) are looked at together: what fits in a processor's
cache."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """Numbers of Q problems with one schedule, as the bounds need them: M frames, N limbs, T
    candidates, B limbs that carry in a stance.

    Arguments:
        candidate: the foothold of each candidate, ascending.
        steps: Δ_c, Δ_Θ, Δ_p.
        progress: least progress of each step along ``ahead``, the direction of the nominal path
            (zero where that does not move). Problems of one frame have no steps.
    """

    schedule: Schedule
    candidate: Index  # (T,)
    frames: Array  # (Q, T, 3, 3)
    friction: Array  # (Q, T)
    shoulders: Array  # (Q, N, 3)
    reach: Array  # (Q, N)
    com: Array  # (Q, M, 3)
    com_radius: Array  # (Q, M)
    tilt: Array  # (Q,)
    weight: Array  # (Q,)
    force_min: Array  # (Q, B, 3)
    force_max: Array  # (Q, B, 3)
    steps: Array  # (3,)
    progress: Array  # (M − 1,)
    ahead: Array  # (M − 1, 3)
    row_normals: Array  # (Q, H, 3), of the half-spaces of reach
    row_bounds: Array  # (Q, H)
    offsets: Array | None = None  # (Q, T, points, 3), from the toe to where a sole's forces act
    apart_normals: Array = field(
        default_factory=lambda: np.zeros((0, 3))
    )  # of ``geometry.relative_rows``, without the sides of least steps
    apart_bounds: Array = field(default_factory=lambda: np.zeros(0))
    linear: Array = field(
        default_factory=lambda: np.zeros((0, 7))
    )  # of ``StepLimits.linear_rows``, likewise
    wrench: Array | None = (
        None  # (Q, S, 6), force and moment on the body in every stance beside the weight
    )

    @cached_property
    def first_candidate(self) -> Index:
        """First candidate of every foothold, shape (P,)."""
        return np.asarray(np.searchsorted(self.candidate, np.arange(self.candidate[-1] + 1)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaves:
    """L leaves of trees over these problems.

    Arguments:
        problem: whose leaf it is, ascending.
        lower, upper: force boxes.
        pieces: which piece of its patch each candidate still has, −1 for none. Piece j has the
            vertices ``first[j]`` up to ``first[j + 1]`` and a toe of its patch may be off all
            pieces by ``sag[j]``.
        multipliers: the largest entry of each row ±1, or 0.
        sides: the rows (n, b) of n·Δ ≥ b of the least steps, of toes and then of the rotation.
    """

    problem: Index  # (L,)
    lower: Array  # (L, B, 3)
    upper: Array  # (L, B, 3)
    pieces: Index  # (L, T)
    multipliers: Array  # (L, count)
    vertices: Array  # (V, 3)
    first: Index  # (J + 1,)
    sag: Array  # (J,)
    sides: Array  # (L, E, 4)

    def part(self, begin: int, end: int) -> Leaves:
        """Some of the leaves."""
        rows = {
            name: getattr(self, name)[begin:end]
            for name in ("problem", "lower", "upper", "pieces", "multipliers", "sides")
        }
        return replace(self, **rows)


def leaf_bounds(numbers: Numbers, leaves: Leaves) -> Array:
    """Proved lower bound on the moment residual at every leaf, shape (L,); 0 where nothing is
    proved, inf where empty.

    Nothing is proved against answers within ``_SLACK`` of the constraints, so that no problem has
    both an accepted answer and an accepted certificate.
    """
    values, empty = least_lagrangians(numbers, leaves)
    moments = multipliers_of(numbers.schedule, leaves.multipliers)["nu_M"]
    with np.errstate(
        all="ignore"
    ):  # absurd magnitudes end as NaN, which proves nothing; without moments: inf
        bounds = np.where(
            (values > 0.0).all(axis=0), values[0] / np.abs(moments).sum(axis=(1, 2)), 0.0
        )
    return np.asarray(np.where(empty, np.inf, bounds))


def least_lagrangians(numbers: Numbers, leaves: Leaves) -> tuple[Array, NDArray[np.bool_]]:
    """Least value ℓ of the left side (see the module) over every leaf, and which leaves are empty.

    Returns shapes (2, L), rounded down, as the problem is and with every constraint widened by
    ``_SLACK``, and (L,).
    """
    sizes = np.append(np.diff(leaves.first), 0)[
        leaves.pieces
    ]  # vertices of each candidate; piece −1 has none
    rows = (sizes * np.maximum(numbers.schedule.borne, 1)[numbers.candidate]).sum(axis=1)
    chunk = np.cumsum(rows) // _MOST_ROWS
    ends = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(rows)]
    with np.errstate(all="ignore"):
        bounds = [
            _least(numbers, leaves.part(begin, end), sizes[begin:end])
            for begin, end in itertools.pairwise(ends)
        ]
    if len(bounds) == 1:
        return bounds[0]
    return np.concatenate([values for values, _ in bounds], axis=1), np.concatenate(
        [empty for _, empty in bounds]
    )


def _least(numbers: Numbers, leaves: Leaves, sizes: Index) -> tuple[Array, NDArray[np.bool_]]:
    """``least_lagrangians`` of leaves that are few enough.

    Arguments:
        sizes: vertices of each candidate, shape (L, T).
    """
    who, q = numbers.schedule, leaves.problem
    m = multipliers_of(who, leaves.multipliers)
    gripped = half_space_pulls(who, numbers.row_normals[q], m)
    pulls = m["reach"] if gripped is None else m["reach"] + gripped
    toes = _toe_pulls(who, pulls, m)
    apart_normals, apart_bounds, linear = with_sides(numbers, leaves)
    if len(who.apart):
        toes += relative_pulls(who.apart, apart_normals, m["relative_reach"], toes.shape[1])
    pull, twist = body_pulls(numbers, q, pulls, m, linear)
    com, weight, shoulders, tilt = (
        numbers.com[q],
        numbers.weight[q],
        numbers.shoulders[q],
        numbers.tilt[q],
    )
    far_com = lengths(com) + numbers.com_radius[q] + _SLACK  # ‖c‖, (L, M)
    most = (
        lengths(np.maximum(np.abs(leaves.lower), np.abs(leaves.upper))) + 2.0 * _SLACK
    )  # ‖f‖, (L, B)
    pushed, torque, pulled, stretch = (
        lengths(m["nu_F"]),
        lengths(m["nu_M"]),
        lengths(pull),
        lengths(m["reach"]),
    )
    reached, twisted = stretch.sum(axis=1), np.abs(twist).sum(axis=(1, 2))

    candidates, far, empty = _candidates(numbers, leaves, m, toes, sizes)
    leverage = (
        torque[:, who.stance] * most
    ) @ who.on_foothold  # Σ ‖ν_M‖ ‖f‖ at each foothold, (L, P)
    slack = np.array([0.0, _SLACK])[:, None]  # as the problem is, and widened
    off_patch = leaves.sag[leaves.pieces] * (leaves.pieces >= 0) + slack[..., None]
    candidates -= (
        off_patch * (lengths(toes) + leverage)[:, numbers.candidate]
    )  # ‖q − Σ λ v‖ ≤ off_patch
    value = (
        np.vecdot(pull, com).sum(axis=1)
        - np.vecdot(numbers.com_radius[q], pulled)  # ‖c − c_nominal‖ ≤ com_radius
        - tilt * twisted  # |Θ_k| ≤ tilt
        - np.vecdot(m["reach"], shoulders[:, None]).sum(axis=(1, 2))
        - np.vecdot(reached, numbers.reach[q])  # ‖q − c − s − Θ × s‖ ≤ ρ
        - weight * m["nu_F"][:, :, 2].sum(axis=1)
    )
    loose = (
        pulled.sum(axis=1)
        + twisted
        + reached.sum(axis=1)
        + (pushed + torque * (1.0 + far_com[:, who.frame])).sum(
            axis=1
        )  # both balances are off by slack
    )
    arm = lengths(shoulders) * (1.0 + 2.0 * (tilt + _SLACK))[:, None] + numbers.reach[q] + _SLACK
    carried = (torque[:, who.stance] * far[:, who.foothold] + pushed[:, who.stance]) * most
    terms = (
        weight * (pushed + torque * far_com[:, who.frame]).sum(axis=1)
        + carried.sum(axis=1)
        + (stretch * (far[:, who.holds] + far_com[:, :, None] + arm[:, None])).sum(axis=(1, 2))
    )
    if numbers.wrench is not None:
        force, moment = numbers.wrench[q, :, :3], numbers.wrench[q, :, 3:]
        value += (np.vecdot(m["nu_F"], force) + np.vecdot(m["nu_M"], moment)).sum(axis=1)
        size = (pushed + torque * far_com[:, who.frame]) * lengths(force) + torque * lengths(moment)
        terms += size.sum(axis=1)
    value = _with_steps(value, loose, terms, numbers, m, linear, far_com, far, tilt + _SLACK)
    if len(who.apart):
        value -= np.vecdot(m["relative_reach"], apart_bounds)  # a·(q' − q) ≤ b
        used = m["relative_reach"].sum(axis=1)
        loose += used
        terms += np.vecdot(m["relative_reach"], np.abs(apart_bounds)) + 2.0 * used * far.max(axis=1)
        value = np.where((m["relative_reach"] < 0.0).any(axis=1), -np.inf, value)
    if gripped is not None:
        used, bounds, bent = (
            m["reach_rows"].sum(axis=1),
            numbers.row_bounds[q],
            lengths(gripped).sum(axis=1),
        )
        value = value - np.vecdot(used, bounds)  # (a + Θ × a)·(q − c) ≤ b
        value = value - bending(
            gripped, shoulders, tilt + slack, numbers.reach[q] + slack[..., None]
        )
        value = np.where((m["reach_rows"] < 0.0).any(axis=(1, 2)), -np.inf, value)
        loose += used.sum(axis=1)
        farthest = far.max(axis=1) + far_com.max(axis=1)
        terms += np.vecdot(used, np.abs(bounds)) + 3.0 * used.sum(axis=1) * farthest
        terms += 3.0 * np.vecdot(bent, arm)
    value = value - _GUARD * len(who.holds) * (1.0 + terms)
    return np.minimum.reduceat(candidates, numbers.first_candidate, axis=2).sum(
        axis=2
    ) + value - slack * loose, empty


def _with_steps(
    value: Array,
    loose: Array,
    terms: Array,
    numbers: Numbers,
    m: Mapping[str, Array],
    linear: Array,
    far_com: Array,
    far: Array,
    tilt: Array,
) -> Array:
    """``value`` with the terms of the body's and the toes' steps, whose sizes are added to
    ``loose`` and ``terms``, all of shape (L,).

    Arguments:
        linear: further rows of the body's steps, shape (L, M − 1, R, 7).
        far_com, far: most that a centre of mass and a toe are away, shapes (L, M) and (L, P).
        tilt: most that the body is tilted.
    """
    who = numbers.schedule
    if len(who.holds) > 1:
        used = np.stack(
            [
                lengths(group).sum(axis=1)
                for group in (m["com_step"], m["rotation_step"], m["toe_step"])
            ],
            axis=1,
        )
        gained, most_com = m["progress"].sum(axis=1), 2.0 * far_com.max(axis=1)
        value += (
            m["progress"] @ numbers.progress - used @ numbers.steps
        )  # d·(c' − c) ≥ progress, ≤ Δ
        loose += used.sum(axis=1) + gained
        terms += used @ numbers.steps + (used[:, 0] + gained) * most_com
        terms += used[:, 1] * 2.0 * tilt + used[:, 2] * 2.0 * far.max(axis=1)
        value = np.where((m["progress"] < 0.0).any(axis=1), -np.inf, value)
    if who.linear:
        used, size = m["linear_step"], np.abs(linear)  # (L, M − 1, R), (L, M − 1, R, 7)
        value -= (used * linear[..., 6]).sum(axis=(1, 2))  # a·(c' − c, Θ' − Θ) ≤ b
        loose += used.sum(axis=(1, 2))
        weighed = size[..., 6] + 2.0 * lengths(size[..., 3:6]) * (1.0 + _SLACK)
        terms += (used * weighed).sum(axis=(1, 2))
        terms += (used * lengths(size[..., :3])).sum(axis=(1, 2)) * 2.0 * far_com.max(axis=1)
        value = np.where((m["linear_step"] < 0.0).any(axis=(1, 2)), -np.inf, value)
    return value


def _candidates(
    numbers: Numbers, leaves: Leaves, m: Mapping[str, Array], toes: Array, sizes: Index
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The least over each slot's vertices of what its toe and the forces on it contribute, inf
    where it is closed.

    Returns that, as the problem is and widened, shape (2, L, T); how far each foothold's toes are
    from the origin at most, (L, P); which leaves have a foothold without candidates, (L,).
    """
    who, shape, flat = numbers.schedule, sizes.shape, sizes.ravel()
    pair = np.repeat(np.arange(len(flat)), flat)  # leaf and candidate of every vertex
    there = np.flatnonzero(flat)
    begins = np.cumsum(flat)[there] - flat[there]
    within = np.arange(len(pair)) - np.repeat(begins, flat[there])
    v = leaves.vertices[leaves.first[leaves.pieces.ravel()[pair]] + within]
    leaf, candidate = np.divmod(pair, shape[1])
    place = numbers.candidate[candidate]

    borne = who.borne[place]  # a row for each force at each vertex
    row = np.repeat(np.arange(len(pair)), borne)
    nth = np.arange(len(row)) - np.repeat(np.cumsum(borne) - borne, borne)
    stance_contact = who.by_foothold[who.first_borne[place][row] + nth]
    leaf_row, stance = leaf[row], who.stance[stance_contact]
    problem, candidate_row = leaves.problem[leaf_row], candidate[row]
    acts = (
        v[row]
        if numbers.offsets is None
        else v[row] + numbers.offsets[problem, candidate_row, who.point[stance_contact]]
    )
    nu = m["nu_F"][leaf_row, stance] + cross(
        m["nu_M"][leaf_row, stance], acts
    )  # ν·(v × F) = (ν × v)·F
    a = (nu[:, None, :] @ numbers.frames[problem, candidate_row])[:, 0]
    lower, upper = leaves.lower[leaf_row, stance_contact], leaves.upper[leaf_row, stance_contact]
    friction = numbers.friction[problem, candidate_row]
    works = least_works(a, lower, upper, friction)
    missed = (
        np.bincount(row, weights=_misses_cone(lower, upper, friction), minlength=len(pair)) > 0.0
    )

    work = np.stack([np.bincount(row, weights=each, minlength=len(pair)) for each in works])
    candidates, gone, far = (
        np.full((2, len(flat)), np.inf),
        np.ones(len(flat), dtype=bool),
        np.zeros(len(flat)),
    )
    if len(there):
        candidates[:, there] = np.minimum.reduceat(
            work + np.vecdot(toes[leaf, place], v), begins, axis=1
        )
        gone[there] = missed[begins]
        far[there] = np.maximum.reduceat(lengths(v), begins)
        far[there] += 0.0 if numbers.offsets is None else float(lengths(numbers.offsets).max())
    candidates[:, gone] = np.inf
    empty = np.asarray(
        np.logical_and.reduceat(gone.reshape(shape), numbers.first_candidate, axis=1).any(axis=1)
    )
    farthest = np.maximum.reduceat(far.reshape(shape), numbers.first_candidate, axis=1)
    return candidates.reshape(2, *shape), farthest, empty


def with_sides(numbers: Numbers, leaves: Leaves) -> tuple[Array, Array, Array]:
    """Rows of the feet relative to each other, (L, R, 3) and (L, R), and further rows of the body's
    steps, (L, M − 1, R, 7), with the sides of least steps that each leaf has.
    """
    count, steps = len(leaves.problem), len(numbers.schedule.holds) - 1
    if not steps:  # a posture has no rows of either kind
        return (
            np.zeros((count, 0, 3)),
            np.zeros((count, 0)),
            np.zeros((count, 0, *numbers.linear.shape)),
        )
    toes, turns = np.split(leaves.sides, [numbers.schedule.least_toes], axis=1)
    normals = np.broadcast_to(numbers.apart_normals, (count, *numbers.apart_normals.shape))
    bounds = np.broadcast_to(numbers.apart_bounds, (count, len(numbers.apart_bounds)))
    linear = np.broadcast_to(numbers.linear, (count, steps, *numbers.linear.shape))
    if toes.shape[1]:
        normals = np.concatenate([normals, -toes[..., :3]], axis=1)
        bounds = np.concatenate([bounds, -toes[..., 3]], axis=1)
    if turns.shape[1]:
        rows = np.concatenate([np.zeros((*turns.shape[:2], 3)), -turns], axis=2)
        linear = np.concatenate([linear, rows[:, :, None]], axis=2)
    return normals, bounds, linear


def body_pulls(
    numbers: Numbers, problem: Index, pulls: Array, m: Mapping[str, Array], linear: Array
) -> tuple[Array, Array]:
    """Slopes of the left side in every c and Θ of L leaves, shape (L, M, 3) each.

    Arguments:
        problem: of each leaf.
        pulls: r + α of every limb at every frame, (L, M, N, 3).
        linear: further rows of the steps, (L, M − 1, R, 7).
    """
    who = numbers.schedule
    pull = -pulls.sum(axis=2)
    twist = -cross(numbers.shoulders[problem][:, None], pulls).sum(axis=2)
    weight, first = (
        numbers.weight[problem][:, None],
        np.searchsorted(who.frame, np.arange(len(who.holds))),
    )
    moments = np.add.reduceat(m["nu_M"], first, axis=1)
    pull[..., 0] += weight * moments[..., 1]  # −ν·(c × e_z) = (−e_z × ν)·c
    pull[..., 1] -= weight * moments[..., 0]
    if numbers.wrench is not None:  # ν·(c × F) = (F × ν)·c
        pull += np.add.reduceat(cross(numbers.wrench[problem, :, :3], m["nu_M"]), first, axis=1)
    if len(who.holds) > 1:
        step = m["com_step"] - m["progress"][..., None] * numbers.ahead
        pull[:, 1:] += step
        pull[:, :-1] -= step
        twist[:, 1:] += m["rotation_step"]
        twist[:, :-1] -= m["rotation_step"]
    if who.linear:
        weighed = np.matmul(m["linear_step"][:, :, None], linear[..., :6])[:, :, 0]
        for slopes, change in ((pull, weighed[..., :3]), (twist, weighed[..., 3:])):
            slopes[:, 1:] += change
            slopes[:, :-1] -= change
    return pull, twist


def _toe_pulls(who: Schedule, pulls: Array, m: Mapping[str, Array]) -> Array:
    """Slopes of the left side in every toe of L leaves, moments left out, shape (L, P, 3).

    Arguments:
        pulls: as ``body_pulls``.
    """
    leaves = len(pulls)
    toes = np.add.reduceat(
        pulls.reshape(leaves, -1, 3)[:, who.standing], who.first_standing, axis=1
    )
    if len(who.moves):
        before, after = who.moves.T
        toes[:, after] += m["toe_step"]  # a foothold is moved to once at most, and from once
        toes[:, before] -= m["toe_step"]
    return np.asarray(toes)


def relative_pulls(feet: NDArray[np.intp], normals: Array, sigma: Array, footholds: int) -> Array:
    """Slope in every toe that multipliers σ of such half-spaces add, shape (L, P, 3).

    Arguments:
        normals: of each leaf's, (L, rows, 3).
        sigma: (L, rows).
    """
    signs = np.zeros((len(feet), footholds))
    signs[np.arange(len(feet)), feet[:, 1]] = 1.0
    signs[np.arange(len(feet)), feet[:, 0]] = -1.0
    return np.asarray(np.einsum("ij,ijk,jp->ipk", sigma, normals, signs, optimize=True))


def half_space_pulls(who: Schedule, normals: Array, m: Mapping[str, Array]) -> Array | None:
    """α = Σ σ a of every limb at every frame of L leaves, shape (L, M, N, 3); None where there are
    no half-spaces.

    Arguments:
        normals: (L, H, 3).
    """
    if not len(who.row_limb):
        return None
    owner = (np.arange(who.holds.shape[1])[:, None] == who.row_limb).astype(np.float64)
    return np.asarray(owner @ (m["reach_rows"][..., None] * normals[:, None]))


def bending(pulls: Array, shoulders: Array, tilt: Array, reach: Array) -> Array:
    """Σ t(α) (ρ + t(s)) of L leaves, shape (W, L), at W tilts, (W, L), and reaches, (W, L, N).

    Arguments:
        pulls: α, (L, M, N, 3).
        shoulders: (L, N, 3).
    """
    far = reach + tilt[..., None] * most_turned(shoulders)
    return np.asarray(tilt * np.vecdot(most_turned(pulls).sum(axis=1), far))
