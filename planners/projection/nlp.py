"""A problem as a nonlinear program on IPOPT through CasADi, one candidate a foothold: the
projection "nlp".

Nothing is relaxed: the moments are the true bilinear ones (E6); the cones are written smoothly,
f_y² + f_z² ≤ (μ f_n)² and f_n ≥ 0 (E10), and so are reach and steps (E11). Derivatives are exact.
IPOPT looks for a local answer; that it finds none proves nothing.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import nnls

from ..equilibrium.layout import Layout
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled, cones_met
from ..files.arrays import Array
from .held import FixToes

_PULL, _PULL_BESIDE = 1e-2, 1e-6
"""Weight of ½‖x − x_start‖²: the only objective of a posture, whose answer it makes unique and
keeps near the start; beside a course's objective, in which λ and f are not, it is there since
CasADi wants every slope to be there."""
CONVERGED = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level", "Feasible_Point_Found"})


class NlpProgram:
    """The program of one layout, compiled once; all data are parameters.

    Arguments:
        least_moment: a posture's, without an objective.
        max_iterations, time_limit_s: where IPOPT gives up one solve.
    """

    def __init__(
        self,
        layout: Layout,
        least_moment: bool,
        max_iterations: int = 200,
        time_limit_s: float = 5.0,
    ) -> None:
        program, equal = written(layout, least_moment)
        rows = program["g"].numel()
        self._low, self._high = (
            np.r_[np.zeros(equal), np.full(rows - equal, -np.inf)],
            np.zeros(rows),
        )
        ipopt = {
            "print_level": 0,
            "sb": "yes",
            "max_iter": max_iterations,
            "max_wall_time": time_limit_s,
            "tol": 1e-9,
            "constr_viol_tol": 1e-9,
            "acceptable_iter": 0,
            "bound_relax_factor": 0.0,
        }
        options: dict[str, Any] = {
            "ipopt": ipopt,
            "print_time": False,
            "show_eval_warnings": False,
            "calc_lam_p": False,
        }
        self._solver = cs.nlpsol("equilibrium", "ipopt", program, options)

    def solve(self, programs: Programs, scaled: Scaled, start: Point) -> Point:
        """Project ``start`` on the bilinear surface by IPOPT, then hold its toes and solve for the
        rest as a conic program.

        The residual is inf where IPOPT did not converge.

        Arguments:
            programs: where that one comes from.
            start: of the layout's candidates.
        """
        return self.attempt(programs, scaled, start)[0]

    def attempt(self, programs: Programs, scaled: Scaled, start: Point) -> tuple[Point, str]:
        """Solve as ``solve`` does, and return IPOPT's status, too.

        A point that converged is polished: its toes are held and the rest is solved for again, as a
        conic program.
        """
        first, (low, high) = vector(scaled, start), _bounds(scaled)
        begin = time.perf_counter()
        answer = self._solver(
            x0=np.clip(first, low, high),
            p=parameters(scaled, first),
            lbx=low,
            ubx=high,
            lbg=self._low,
            ubg=self._high,
        )
        seconds, status = time.perf_counter() - begin, str(self._solver.stats()["return_status"])
        x = np.asarray(answer["x"], dtype=np.float64).ravel()
        point = replace(point_of(scaled, x, converged=status in CONVERGED), seconds=seconds)
        if not np.isfinite(point.residual):
            return point, status
        polished = programs.get(FixToes, scaled.layout, False, scaled.weights is None).solve(
            scaled, point
        )
        best = polished if np.isfinite(polished.residual) else point
        return replace(best, solves=2, seconds=seconds + polished.seconds), status


def written(layout: Layout, least_moment: bool) -> tuple[dict[str, Any], int]:
    """The program in CasADi's form and how many of its rows are equations; the others are ≤ 0.

    x = (c, Θ, λ, f), frame by frame, vertex by vertex, contact by contact; parameters as
    ``parameters`` packs them. Rows: Σ λ_u − 1 (P), net force and net moment (6 a stance), = 0;
    cones (B), reach (M·N, and its half-spaces as they are, bilinear in Θ and p_w − c), ball of c
    (M), steps of c and Θ and progress (3 a step), steps of toes, and reach from the other feet.
    """
    frames, limbs, footholds, (stance, _, foothold) = (
        layout.frames,
        layout.limbs,
        layout.footholds,
        layout.contacts,
    )
    steps, vertices, contacts = frames - 1, len(layout.vertex_footholds), len(stance)
    data = {name: cs.SX.sym(name, *size) for name, size in _sizes(layout).items()}
    com, rotation = cs.SX.sym("com", 3, frames), cs.SX.sym("rotation", 3, frames)
    shares, forces = cs.SX.sym("weights", vertices), cs.SX.sym("forces", 3, contacts)
    under = [np.flatnonzero(layout.vertex_footholds == p).tolist() for p in range(footholds)]
    toes = [data["vertices"][:, limb] @ shares[limb] for limb in under]  # p_w  (1)
    force = [cs.vertcat(0, 0, -data["weight"]) for _ in layout.stances]
    moment, cones = [cs.SX.zeros(3) for _ in layout.stances], []
    if layout.loaded:
        force = [each + data["wrench"][:3, s] for s, each in enumerate(force)]
        moment = [data["wrench"][3:, s] for s in range(len(layout.stances))]
    for b, (s, p) in enumerate(zip(stance.tolist(), foothold.tolist(), strict=True)):
        f = forces[:, b]
        f_w = data["axes"][:, 3 * p : 3 * (p + 1)] @ f  # Σ f_k F_k  (3)
        force[s] += f_w  # Σ f + F = 0  (5)
        point = toes[p] + data["offsets"][:, b] if layout.points else toes[p]
        moment[s] += cs.cross(point - com[:, layout.stances[s][0]], f_w)  # Σ p × f = 0  (6)
        cones.append(f[1] ** 2 + f[2] ** 2 - (data["friction"][p] * f[0]) ** 2)  # ≤ 0  (10)
    reach = []
    for k in range(frames):
        for i in range(limbs):
            v = data["shoulders"][:, i]
            leg = toes[layout.holds[k][i]] - com[:, k] - v - cs.cross(rotation[:, k], v)
            reach.append(cs.sumsqr(leg) - data["reach"][i] ** 2)  # ≤ 0  (11)
        for h, i in enumerate(layout.row_limbs.tolist()):
            normal, leg = data["row_normals"][:, h], toes[layout.holds[k][i]] - com[:, k]
            reach.append(
                cs.dot(normal + cs.cross(rotation[:, k], normal), leg) - data["row_bounds"][h]
            )
    balls = [
        cs.sumsqr(com[:, k] - data["com"][:, k]) - data["com_radius"][k] ** 2 for k in range(frames)
    ]
    moved, turned = com[:, 1:] - com[:, :-1], rotation[:, 1:] - rotation[:, :-1]
    walked = [toes[after] - toes[before] for before, after in layout.moves.tolist()]
    limits = [cs.sumsqr(moved[:, k]) - data["limits"][0] ** 2 for k in range(steps)]
    limits += [cs.sumsqr(turned[:, k]) - data["limits"][2] ** 2 for k in range(steps)]
    limits += [
        data["progress"][k] - cs.dot(data["direction"][:, k], moved[:, k]) for k in range(steps)
    ]
    for k in range(steps):
        step = cs.vertcat(moved[:, k], turned[:, k])
        limits += [
            cs.dot(data["linear"][:6, r], step) - data["linear"][6, r]
            for r in range(k * layout.linear, (k + 1) * layout.linear)
        ]
    limits += [cs.sumsqr(step) - data["limits"][1] ** 2 for step in walked]
    for row, which in enumerate(layout.relative_rows[1].tolist()):
        moved_one, other, _ = layout.relative_pairs[which].tolist()
        apart = toes[other] - toes[moved_one]
        limits.append(cs.dot(data["apart_normals"][:, row], apart) - data["apart_bounds"][row])
    x = cs.vertcat(*(cs.vec(part) for part in (com, rotation, shares, forces)))
    start = cs.SX.sym("start", x.numel())
    cost = 0.5 * (_PULL if least_moment else _PULL_BESIDE) * cs.sumsqr(x - start)
    if not least_moment:
        stands = (
            zip(*(part.tolist() for part in layout.standing), strict=True) if layout.stands else ()
        )
        away = [
            toes[foothold] - com[:, k] - data["standing"][:, t]
            for t, (k, _, foothold) in enumerate(stands)
        ]
        terms = (
            com[:, -1] - data["goal"],
            com - data["com"],
            rotation,
            moved,
            cs.vertcat(*walked),
            cs.vertcat(*away),
        )
        cost += sum((data["aim"][k] * cs.sumsqr(term) for k, term in enumerate(terms)), cs.SX(0))
    equations = cs.vertcat(*(cs.sum1(shares[limb]) - 1 for limb in under), *force, *moment)
    program = {
        "x": x,
        "p": cs.vertcat(*(cs.vec(part) for part in data.values()), start),
        "f": cost,
        "g": cs.vertcat(equations, *cones, *reach, *balls, *limits),
    }
    return program, int(equations.numel())


def _sizes(layout: Layout) -> dict[str, tuple[int, int]]:
    """Shapes of the parameters by name, in the order in which ``parameters`` packs them."""
    frames, limbs, footholds, steps = (
        layout.frames,
        layout.limbs,
        layout.footholds,
        layout.frames - 1,
    )
    return {
        "vertices": (3, len(layout.vertex_footholds)),
        "axes": (3, 3 * footholds),
        "friction": (1, footholds),
        "weight": (1, 1),
        "shoulders": (3, limbs),
        "reach": (1, limbs),
        "com": (3, frames),
        "com_radius": (1, frames),
        "limits": (3, 1),
        "direction": (3, steps),
        "progress": (1, steps),
        "goal": (3, 1),
        "aim": (6, 1),
        "offsets": (3, len(layout.contacts[0]) if layout.points else 0),
        "row_normals": (3, len(layout.row_limbs)),
        "row_bounds": (1, len(layout.row_limbs)),
        "apart_normals": (3, len(layout.relative_rows[0])),
        "apart_bounds": (1, len(layout.relative_rows[0])),
        "linear": (7, steps * layout.linear),
        "standing": (3, len(layout.standing[0]) if layout.stands else 0),
        "wrench": (6, len(layout.stances) if layout.loaded else 0),
    }


def parameters(scaled: Scaled, start: Array) -> Array:
    """The program's parameters; CasADi stacks columns, so that every vertex, axis and step is
    one.
    """
    aim = np.zeros(6)
    if scaled.weights is not None:
        weights = scaled.weights
        aim = np.array(
            [
                weights.goal,
                weights.com_path,
                weights.tilt / scaled.length_m**2,
                weights.com_step,
                weights.toe_step,
                weights.stance,
            ]
        )
    return np.concatenate(
        [
            scaled.vertices.ravel(),
            scaled.frames.transpose(0, 2, 1).ravel(),
            scaled.friction,
            [scaled.weight],
            scaled.shoulders.ravel(),
            scaled.reach,
            scaled.com.ravel(),
            scaled.com_radius,
            scaled.steps,
            scaled.direction.ravel(),
            scaled.progress,
            scaled.goal,
            aim,
            scaled.bearing_points(np.zeros((scaled.layout.footholds, 3))).ravel()
            if scaled.layout.points
            else [],
            scaled.half_spaces.normals.ravel(),
            scaled.half_spaces.bounds,
            scaled.relative[scaled.layout.relative_rows[0], :3].ravel(),
            scaled.relative[scaled.layout.relative_rows[0], 3],
            scaled.linear.ravel(),
            scaled.standing.ravel(),
            scaled.wrench.ravel(),
            start,
        ]
    )


def vector(scaled: Scaled, point: Point) -> Array:
    """x of a point; the weights λ by non-negative least squares, since a point has toes only."""
    weights = [
        nnls(np.vstack([corners.T, np.ones(len(corners))]), np.append(toe, 1.0))[0]
        for corners, toe in zip(scaled.pieces, point.toes, strict=True)
    ]
    return np.concatenate(
        [point.com.ravel(), point.rotation.ravel(), *weights, point.forces.ravel()]
    )


def point_of(scaled: Scaled, x: Array, *, converged: bool) -> Point:
    """The point of x, with its true net moments.

    Arguments:
        x: c, Θ, λ and f, one after the other (``vector``).
        converged: whether IPOPT said so.

    Returns:
        A point whose residual is the largest component of Σ p × f + M over all stances, inf where x
        is no answer.
    """
    layout = scaled.layout
    stance = layout.contacts[0]
    com, rotation, weights, forces = np.split(
        x, np.cumsum([scaled.com.size, scaled.com.size, len(scaled.vertices)])
    )
    com, rotation, forces = (part.reshape(-1, 3) for part in (com, rotation, forces))
    weights = np.maximum(weights, 0.0)
    weights = weights / np.bincount(layout.vertex_footholds, weights)[layout.vertex_footholds]
    toes, moments = np.zeros((layout.footholds, 3)), np.array(scaled.twisted)
    np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
    arms = scaled.bearing_points(toes) - com[layout.stance_frames[stance]]
    np.add.at(moments, stance, np.cross(arms, scaled.in_world(forces)))
    residual = (
        float(np.abs(moments).max()) if converged and np.all(np.isfinite(x)) else float("inf")
    )
    return Point(com=com, rotation=rotation, toes=toes, forces=forces, residual=residual)


def _bounds(scaled: Scaled) -> tuple[Array, Array]:
    """Bounds of x.

    Those of shear and c are implied by the cones, which alone are degenerate at μ = 0 or radius 0.
    """
    low, high = cones_met(
        scaled.force_min, scaled.force_max, scaled.friction[scaled.layout.contacts[2]]
    )
    empty = low > high  # the cones miss the box: leave it whole, and IPOPT finds nothing
    low, high = np.where(empty, scaled.force_min, low), np.where(empty, scaled.force_max, high)
    tilt, weights = np.full(scaled.com.size, scaled.tilt), np.zeros(len(scaled.vertices))
    radius = scaled.com_radius[:, None]
    return (
        np.concatenate([(scaled.com - radius).ravel(), -tilt, weights, low.ravel()]),
        np.concatenate([(scaled.com + radius).ravel(), tilt, weights + 1.0, high.ravel()]),
    )
