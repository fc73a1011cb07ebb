"""Independent check of proofs that a course has no plan: matrix-vector work, no solver.

All numbers are non-dimensional: lengths over the length scale, forces over the weight w. As for one posture
(``refute``), any multipliers of the constraints give a bound by weak duality. With ν_F, ν_M a stance, r a frame and
limb, a, t, g a step of the body, b a step of a toe, every plan that meets all constraints has

    Σ_s ν_F·(Σ C f − w e_z) + ν_M·(Σ q × C f − c × w e_z) + Σ r·(q − c − s − Θ × s) − ρ‖r‖
      + Σ a·(c[k] − c[k−1]) − Δ_c‖a‖ + t·(Θ[k] − Θ[k−1]) − Δ_Θ‖t‖ + g (progress − d·(c[k] − c[k−1]))
      + Σ b·(q' − q) − Δ_p‖b‖  ≤  0.

Where the least value of the left side is positive, there is no plan. It separates: a ball for each c, a box for each Θ,
and for each toe the least over the vertices of its open candidate patches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .outcome import InvalidInput
from .refute import SLACK, cross, least_work
from .scene.course import Course

ROUNDING = 1e-11
"""A bound is lowered by this share of the sizes that it is the difference of."""
LEAF = (-1, -1)
MOST_GRIP, MOST_LENGTH, BISECTIONS = 3.0, 2.0, 12
"""The reason for an infeasible course looks for no larger changes (of friction, to one part in 4,096; in m or rad)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanCertificate:
    """A proof that a course has no plan: a tree of choices that covers them all, and multipliers a leaf.

    tree: shape (K, 2), the nodes in preorder: (−1, −1) is a leaf; (p, r) splits on placement p: in the first child it
    stands on candidate r, in the second it does not. A leaf that leaves a placement without candidates needs no proof.
    multipliers: shape (leaves, ``multiplier_count``), in the order ν_F (S, 3), ν_M (S, 3), r (M, N, 3),
    a (M − 1, 3), t (M − 1, 3), g (M − 1), b (moves, 3).
    """

    tree: NDArray[np.int_]
    multipliers: Array

    def __post_init__(self) -> None:
        for name, kind in (("tree", np.int_), ("multipliers", np.float64)):
            array = np.array(getattr(self, name), dtype=kind)
            array.setflags(write=False)
            object.__setattr__(self, name, array)


@dataclass(frozen=True, kw_only=True)
class PlanRefutation:
    """Whether a certificate refutes a course; the message says which limit is in the way, where, and by how much."""

    accepted: bool
    leaves: int
    message: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Multipliers:
    """One leaf's multipliers by group (see the module)."""

    nu_F: Array
    nu_M: Array
    reach: Array
    com_step: Array
    rotation_step: Array
    progress: Array
    toe_step: Array


def moves_of(course: Course) -> NDArray[np.int_]:
    """(placement before, placement after) of every toe that moves, in order of frame, then limb; shape (K, 2)."""
    holds = course.holds
    changed = np.argwhere(holds[1:] != holds[:-1])
    return np.array([(holds[k, i], holds[k + 1, i]) for k, i in changed], dtype=np.int_).reshape(-1, 2)


def multiplier_shapes(course: Course) -> dict[str, tuple[int, ...]]:
    """Shape of every group of a leaf's multipliers."""
    frames, stances, steps = course.frames, len(course.stances), course.frames - 1
    return {
        "nu_F": (stances, 3), "nu_M": (stances, 3), "reach": (frames, len(course.robot.limbs), 3),
        "com_step": (steps, 3), "rotation_step": (steps, 3), "progress": (steps,),
        "toe_step": (len(moves_of(course)), 3),
    }  # fmt: skip


def check_plan_certificate(course: Course, certificate: PlanCertificate) -> PlanRefutation:
    """Replay the tree and bound the Lagrangian at every leaf; never raises for a bad certificate."""
    shapes = multiplier_shapes(course)
    count = sum(int(np.prod(shape)) for shape in shapes.values())
    try:
        leaves = _leaves(course, certificate, count)
    except InvalidInput as error:
        return PlanRefutation(accepted=False, leaves=0, message=f"rejected: {error}")
    weakest, message = np.inf, "no leaf has a choice left"
    for row, opened in leaves:
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
        parts = np.split(row, ends[:-1])
        multipliers = Multipliers(
            **{name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}
        )
        with np.errstate(all="ignore"):
            value = _least(course, multipliers, opened)
        if not value > 0.0:
            return PlanRefutation(
                accepted=False, leaves=len(leaves), message=f"rejected: a leaf proves nothing ({value:.3g})"
            )
        if value < weakest:
            weakest, message = value, _reason(course, multipliers, opened, value)
    many = f" (refuted for each of {len(leaves)} groups of choices)" if len(leaves) > 1 else ""
    return PlanRefutation(accepted=True, leaves=len(leaves), message=f"infeasible: {message}{many}")


def _leaves(course: Course, certificate: PlanCertificate, count: int) -> list[tuple[Array, list[set[int]]]]:
    """(multipliers, open candidates by placement) of every leaf that still has choices. Raises InvalidInput."""
    tree, rows = certificate.tree, certificate.multipliers
    if tree.ndim != 2 or tree.shape[1:] != (2,) or rows.ndim != 2 or rows.shape[1:] != (count,):
        raise InvalidInput(
            f"expected a tree of shape (K, 2) and multipliers of shape (leaves, {count}), "
            f"got {tree.shape}, {rows.shape}"
        )
    if not np.isfinite(rows).all():
        raise InvalidInput("multipliers: expected finite numbers")
    stack = [[set(range(len(placement.candidates))) for placement in course.placements]]
    leaves, used = [], 0
    for index, (p, r) in enumerate(tree.tolist()):
        if not stack:
            raise InvalidInput(f"tree[{index}]: expected the end of the tree, got another node")
        opened = stack.pop()
        if (p, r) == LEAF:
            if used == len(rows):
                raise InvalidInput(f"multipliers: expected a row for each leaf, got {len(rows)}")
            if all(opened):
                leaves.append((rows[used], opened))
            used += 1
            continue
        if not (0 <= p < len(opened) and 0 <= r < len(course.placements[p].candidates)):
            raise InvalidInput(f"tree[{index}]: expected a placement and one of its candidates, got ({p}, {r})")
        with_r, without = list(opened), list(opened)
        with_r[p], without[p] = opened[p] & {r}, opened[p] - {r}
        stack += [without, with_r]  # the first child is popped first
    if stack:
        raise InvalidInput(f"tree: expected {len(stack)} more nodes or more after {len(tree)}")
    if used != len(rows):
        raise InvalidInput(f"multipliers: expected a row for each of {used} leaves, got {len(rows)}")
    return leaves


def _least(course: Course, m: Multipliers, opened: list[set[int]]) -> float:
    """Least value of the Lagrangian over a leaf, every constraint widened by ``SLACK``, rounded down."""
    length = course.length_scale_m
    limbs, steps = course.robot.limbs, course.steps
    shoulders = np.array([limb.shoulder_m for limb in limbs]) / length
    radii = np.array([limb.reach_m for limb in limbs]) / length
    pull, twist = body_pulls(course, m)
    norm = np.linalg.norm
    limits = np.array([steps.com_m / length, steps.rotation_rad, steps.toe_m / length])
    used = np.array([norm(group, axis=1).sum() for group in (m.com_step, m.rotation_step, m.toe_step)])
    progress = _progress(course)
    lost = [
        -float(m.nu_F[:, 2].sum()),
        float(np.sum(pull * course.com_nominal_m) / length),
        -float(norm(pull, axis=1) @ (course.com_radius_m / length + SLACK)),
        -(course.tilt_limit_rad + SLACK) * float(np.abs(twist).sum()),
        -float(np.sum(m.reach * shoulders)),
        -float(norm(m.reach, axis=2).sum(axis=0) @ (radii + SLACK)),
        -float(used @ (limits + SLACK)),
        float(m.progress @ (progress - SLACK)),
    ]
    toes = _toe_pulls(course, m)
    lost += [_least_toe(course, m, p, toes[p], choices, 0.0) for p, choices in enumerate(opened)]
    far = 1.0 + float(np.abs(course.com_nominal_m).max()) / length + 2.0 * float(radii.max())
    sizes = float(norm(m.nu_F, axis=1).sum()) + far * float(norm(m.nu_M, axis=1).sum())
    value = sum(lost) - SLACK * (sizes + float(norm(toes, axis=1).sum()))
    if np.any(m.progress < 0.0):
        return -np.inf
    return value - ROUNDING * (sum(abs(part) for part in lost) + far * (sizes + float(used.sum())))


def body_pulls(course: Course, m: Multipliers) -> tuple[Array, Array]:
    """Slopes of the Lagrangian in every c and Θ, shapes (M, 3) and (M, 3)."""
    pull, twist = -m.reach.sum(axis=1), np.zeros((course.frames, 3))
    shoulders = np.array([limb.shoulder_m for limb in course.robot.limbs]) / course.length_scale_m
    twist -= cross(shoulders, m.reach).sum(axis=1)
    for s, stance in enumerate(course.stances):
        pull[stance.frame] += np.array([m.nu_M[s, 1], -m.nu_M[s, 0], 0.0])  # −ν·(c × e_z) = (−e_z × ν)·c
    for k in range(1, course.frames):
        step = m.com_step[k - 1] - m.progress[k - 1] * course.direction(k)
        pull[k] += step
        pull[k - 1] -= step
        twist[k] += m.rotation_step[k - 1]
        twist[k - 1] -= m.rotation_step[k - 1]
    return pull, twist


def _toe_pulls(course: Course, m: Multipliers) -> Array:
    """Slope of the Lagrangian in every toe, moments left out, shape (P, 3)."""
    toes = np.zeros((len(course.placements), 3))
    np.add.at(toes, course.holds.ravel(), m.reach.reshape(-1, 3))
    moves = moves_of(course)
    np.add.at(toes, moves[:, 1], m.toe_step)
    np.add.at(toes, moves[:, 0], -m.toe_step)
    return toes


def _progress(course: Course) -> Array:
    """Least progress of every step, 0 where the nominal path does not move, shape (M − 1,)."""
    moving = [np.any(course.direction(k)) for k in range(1, course.frames)]
    return np.where(moving, course.steps.progress_m / course.length_scale_m, 0.0) if moving else np.zeros(0)


def _least_toe(course: Course, m: Multipliers, index: int, pull: Array, choices: set[int], grip: float) -> float:
    """Least over the vertices of the open candidates of pull·v and the least work of every force on that toe.

    grip: friction that the candidates are given on top of their own.
    """
    placement = course.placements[index]
    limb = course.robot.limb_names.index(placement.limb)
    rows = [
        s
        for s, stance in enumerate(course.stances)
        if limb in stance.limbs and course.holds[stance.frame, limb] == index
    ]
    least = np.inf
    for r in sorted(choices):
        patch = placement.candidates[r]
        points = patch.vertices_m if placement.toe_m is None else placement.toe_m[None]
        v = points / course.length_scale_m
        value = v @ pull
        if rows:
            nu = m.nu_F[rows][:, None] + cross(m.nu_M[rows][:, None], v[None])  # ν·(v × F) = (ν × v)·F
            a = (nu @ patch.frame).reshape(-1, 3)
            low, high = (np.broadcast_to(bound, a.shape) for bound in (course.force_min, course.force_max))
            work = least_work(a, low, high, np.full(len(a), patch.friction + grip), slack=SLACK)
            value = value + work.reshape(len(rows), -1).sum(axis=0)
        least = min(least, float(value.min()))
    return least


def _reason(course: Course, m: Multipliers, opened: list[set[int]], value: float) -> str:
    """The limit that must change least, relative to what it is, to lift this leaf's proof, all else as it is."""
    names, norm = course.robot.limb_names, np.linalg.norm
    hardest = int((norm(m.nu_F, axis=1) + norm(m.nu_M, axis=1)).argmax())
    stance = course.stances[hardest]
    where = f"frame {stance.frame} on {', '.join(names[i] for i in stance.limbs)}"
    found = _lengths(course, m, value)
    if norm(m.nu_F[hardest]) + norm(m.nu_M[hardest]) > 1e-6:
        under = course.holds[stance.frame, list(stance.limbs)]
        now = min(course.placements[p].candidates[r].friction for p in under for r in opened[p])
        found.append((_grip(course, m, opened, value, under), f"friction at {where}", now, ""))
        if not np.isfinite(found[-1][0]):
            found.append((_grip(course, m, opened, value, np.arange(len(opened))), "friction everywhere", now, ""))
    by, name, now, unit = min(found, key=lambda item: item[0] / max(item[2], 0.05), default=(np.inf, "", 0.0, ""))
    if not np.isfinite(by):
        return f"the balances at {where} cannot be held; no single limit, however large, lifts this proof"
    if by < 1e-3:
        return f"with all else as it is, {name} would have to change from {now:.3g} {unit}".rstrip()
    return f"with all else as it is, {name} would have to change from {now:.3g} by at least {by:.3g} {unit}".rstrip()


def _lengths(course: Course, m: Multipliers, value: float) -> list[tuple[float, str, float, str]]:
    """(least change, limit, what it is now, unit) of every limit that the Lagrangian is linear in."""
    length, steps, norm = course.length_scale_m, course.steps, np.linalg.norm
    pull, reach = norm(body_pulls(course, m)[0], axis=1), norm(m.reach, axis=2)
    frame, limb = (int(i) for i in np.unravel_index(int(reach.argmax()), reach.shape))
    worst, owner = int(pull.argmax()), course.robot.limbs[limb]
    rows = (
        (float(reach[frame, limb]), f"reach of {owner.name} at frame {frame}", owner.reach_m, length, "m"),
        (float(reach.sum()), "reach of all limbs", min(limb.reach_m for limb in course.robot.limbs), length, "m"),
        (float(norm(m.com_step, axis=1).sum()), "steps.com_m", steps.com_m, length, "m"),
        (float(norm(m.toe_step, axis=1).sum()), "steps.toe_m", steps.toe_m, length, "m"),
        (float(norm(m.rotation_step, axis=1).sum()), "steps.rotation_rad", steps.rotation_rad, 1.0, "rad"),
        (float(pull[worst]), f"com_radius_m at frame {worst}", float(course.com_radius_m[worst]), length, "m"),
        (float(m.progress.sum()), "steps.progress_m", steps.progress_m, length, "m"),
    )
    found = [(value / size * scale, name, now, unit) for size, name, now, scale, unit in rows if size > 1e-9]
    return [row for row in found if row[0] <= (row[2] if row[1] == "steps.progress_m" else MOST_LENGTH)]


def _grip(course: Course, m: Multipliers, opened: list[set[int]], value: float, under: NDArray[np.int_]) -> float:
    """Least friction on top, for all candidates of these placements, that lifts the proof; inf where none does."""
    pulls = _toe_pulls(course, m)

    def toes(grip: float) -> float:
        return sum(_least_toe(course, m, int(p), pulls[p], opened[p], grip) for p in under)

    rest = value - toes(0.0)
    low, high = 0.0, MOST_GRIP
    if rest + toes(high) > 0.0:
        return np.inf
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rest + toes(middle) > 0.0 else (low, middle)
    return low
