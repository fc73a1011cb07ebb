"""The posture problem as a nonlinear program on IPOPT through CasADi: the projection "nlp" and a multi-start planner.

Nothing is relaxed: the moment is the true bilinear one (eq. 6); the cones are written smoothly, f_y² + f_z² ≤ (μ f_n)²
and f_n ≥ 0 (eq. 10), and so is the reach (eq. 11). IPOPT looks for a local answer; that it finds none proves nothing.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import nnls

from ..arrays import Array, checked
from ..outcome import InvalidInput, Outcome, Posture
from ..scene import PostureProblem
from ..search.answer import Acceptance
from .project import SURFACE, FixToes, Point
from .scaled import ScaledProblem

PULL = 1e-2
"""Weight of ½‖x − x_start‖², the only objective: it makes the answer unique and keeps it near the start."""
CONVERGED = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level", "Feasible_Point_Found"})


class NlpModel:
    """The program for N contacts and U vertices a patch, compiled once; all data are parameters, the Hessian is exact.

    max_iterations, time_limit_s: where IPOPT gives up one solve.
    """

    def __init__(self, contacts: int, vertices: int, *, max_iterations: int = 200, time_limit_s: float = 5.0) -> None:
        equal, below = contacts + 6, 2 * contacts + 1
        self._row_bounds = (np.r_[np.zeros(equal), np.full(below, -np.inf)], np.zeros(equal + below))
        self._solver = cs.nlpsol(
            "posture", "ipopt", posture_program(contacts, vertices), ipopt_options(max_iterations, time_limit_s)
        )
        self._fix_toes = FixToes(contacts)

    def solve(self, scaled: ScaledProblem, start: Point) -> Point:
        """Project ``start`` on the bilinear surface; the residual is inf where IPOPT did not converge."""
        return self.attempt(scaled, start)[0]

    def attempt(self, scaled: ScaledProblem, start: Point) -> tuple[Point, str]:
        """As ``solve``, with IPOPT's return status.

        A point that converged is polished: its toes are held and the rest is solved for again, as a conic program.
        """
        first = _vector(scaled, start)
        low, high = _bounds(scaled)
        found = self._solver(
            x0=np.clip(first, low, high), p=_parameters(scaled, first), lbx=low, ubx=high,
            lbg=self._row_bounds[0], ubg=self._row_bounds[1],
        )  # fmt: skip
        status = str(self._solver.stats()["return_status"])
        point = _point(scaled, np.asarray(found["x"], dtype=np.float64).ravel(), converged=status in CONVERGED)
        if not np.isfinite(point.residual):
            return point, status
        polished = self._fix_toes.solve(scaled, point.toes)
        return polished if np.isfinite(polished.residual) else point, status


class NlpPlanner:
    """Feasible by IPOPT from one of several starts, or undecided; never infeasible, since a local method proves none.

    starts: how many points to start from. seed: of the random ones. time_limit_s: for all starts of a problem together.
    """

    name = "nlp"

    def __init__(
        self,
        *,
        acceptance: Acceptance | None = None,
        starts: int = 5,
        seed: int = 0,
        max_iterations: int = 200,
        time_limit_s: float = 10.0,
    ) -> None:
        if starts < 1:
            raise InvalidInput(f"starts: expected 1 or more, got {starts}")
        self.acceptance = acceptance or Acceptance()
        self.starts = starts
        self.seed = seed
        self.max_iterations = max_iterations
        self.time_limit_s = checked(time_limit_s, "time_limit_s", above=0.0)
        self._models: dict[tuple[int, int], NlpModel] = {}

    def solve(self, problem: PostureProblem) -> Outcome:
        """Try the starts in order until one ends on the bilinear surface."""
        begin = time.perf_counter()
        scaled = ScaledProblem.of(problem)
        model = self._model(scaled)
        best, claim, tried = float("inf"), "", 0
        posture: Posture | None = None
        for start in starting_points(scaled, self.starts, seed=self.seed):
            if tried and time.perf_counter() - begin > self.time_limit_s:
                break
            point, claim = model.attempt(scaled, start)
            tried += 1
            if point.residual < best:
                best = point.residual
                posture = scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
            if best <= max(SURFACE, 0.5 * self.acceptance.tolerance):
                break
        return self.acceptance.outcome(
            problem,
            method=self.name,
            begin=begin,
            posture=posture,
            solves=tried,
            claim=claim,
            message="" if posture is not None else f"no witness from {tried} starts; IPOPT said {claim}",
            details={"starts": float(tried)},
        )

    def _model(self, scaled: ScaledProblem) -> NlpModel:
        if scaled.size not in self._models:
            share = self.time_limit_s / self.starts
            self._models[scaled.size] = NlpModel(*scaled.size, max_iterations=self.max_iterations, time_limit_s=share)
        return self._models[scaled.size]


def starting_points(scaled: ScaledProblem, count: int, *, seed: int) -> list[Point]:
    """The patches' centroids, then random convex combinations of their vertices, the same ones for the same seed.

    The body is at its nominal pose; every limb carries its share of the weight and presses with half its normal force.
    """
    contacts, vertices = scaled.size
    rng = np.random.default_rng(seed)
    random = rng.dirichlet(np.ones(vertices), size=(max(count - 1, 0), contacts))
    weights = np.concatenate([np.full((1, contacts, vertices), 1.0 / vertices), random])
    forces = scaled.frames[:, 2, :] * scaled.weight / contacts  # an upward force in contact axes is R_WCᵀ e_z
    forces[:, 0] = np.maximum(forces[:, 0], 0.5 * scaled.force_max[:, 0])
    forces = np.clip(forces, scaled.force_min, scaled.force_max)
    return [
        Point(com=scaled.com, rotation=np.zeros(3), toes=toes, forces=forces, residual=float("inf"))
        for toes in np.einsum("snu,nud->snd", weights, scaled.vertices)
    ]


def posture_program(contacts: int, vertices: int) -> dict[str, Any]:
    """The program in CasADi's form: x = (c, Θ, λ, f), parameters as ``_parameters`` packs them, objective and rows.

    Rows: Σ λ_u − 1 (N), net force (3), net moment (3), all = 0; cones (N), reach (N), centre of mass (1), all ≤ 0.
    """
    data = {
        "vertices": cs.SX.sym("vertices", 3, contacts * vertices),
        "frames": cs.SX.sym("frames", 3, 3 * contacts),
        "shoulders": cs.SX.sym("shoulders", 3, contacts),
        "reach": cs.SX.sym("reach", contacts),
        "friction": cs.SX.sym("friction", contacts),
        "weight": cs.SX.sym("weight"),
        "com": cs.SX.sym("com_nominal", 3),
        "com_radius": cs.SX.sym("com_radius"),
    }
    com, rotation = cs.SX.sym("com", 3), cs.SX.sym("rotation", 3)
    weights, forces = cs.SX.sym("weights", vertices, contacts), cs.SX.sym("forces", 3, contacts)
    force, moment = cs.vertcat(0, 0, -data["weight"]), cs.SX.zeros(3)
    cones, reach = [], []
    for i in range(contacts):
        toe = data["vertices"][:, vertices * i : vertices * (i + 1)] @ weights[:, i]  # p_w         (1)
        f, shoulder = forces[:, i], data["shoulders"][:, i]
        f_w = data["frames"][:, 3 * i : 3 * (i + 1)] @ f  # Σ f_k F_k   (3)
        force += f_w  # Σ f + F     (5)
        moment += cs.cross(toe - com, f_w)  # Σ p × f     (6)
        cones.append(f[1] ** 2 + f[2] ** 2 - (data["friction"][i] * f[0]) ** 2)  # ≤ 0        (10)
        leg = toe - com - shoulder - cs.cross(rotation, shoulder)
        reach.append(cs.sumsqr(leg) - data["reach"][i] ** 2)  # ≤ 0        (11)
    off = cs.sumsqr(com - data["com"]) - data["com_radius"] ** 2
    x = cs.vertcat(com, rotation, cs.vec(weights), cs.vec(forces))
    start = cs.SX.sym("start", x.numel())
    return {
        "x": x,
        "p": cs.vertcat(*(cs.vec(part) for part in data.values()), start),
        "f": 0.5 * PULL * cs.sumsqr(x - start),
        "g": cs.vertcat(cs.sum1(weights).T - 1, force, moment, *cones, *reach, off),
    }


def ipopt_options(max_iterations: int, time_limit_s: float) -> dict[str, Any]:
    """IPOPT without a word on the terminal, ended by iterations or the clock, the same in every run."""
    ipopt = {
        "print_level": 0, "sb": "yes", "max_iter": max_iterations, "max_wall_time": time_limit_s,
        "tol": 1e-9, "constr_viol_tol": 1e-9, "acceptable_iter": 0, "bound_relax_factor": 0.0,
    }  # fmt: skip
    return {"ipopt": ipopt, "print_time": False, "show_eval_warnings": False, "calc_lam_p": False}


def _parameters(scaled: ScaledProblem, start: Array) -> Array:
    """The program's parameters; CasADi stacks columns, so that every vertex, frame axis and shoulder is one."""
    return np.concatenate([
        scaled.vertices.ravel(), scaled.frames.transpose(0, 2, 1).ravel(), scaled.shoulders.ravel(), scaled.reach,
        scaled.friction, [scaled.weight], scaled.com, [scaled.com_radius], start,
    ])  # fmt: skip


def _bounds(scaled: ScaledProblem) -> tuple[Array, Array]:
    """Bounds of x. Those of shear and c are implied by the cones, which alone are degenerate at μ = 0 or radius 0."""
    low, high = scaled.force_min.copy(), scaled.force_max.copy()
    shear = (scaled.friction * np.maximum(high[:, 0], 0.0))[:, None]
    low[:, 1:], high[:, 1:] = np.maximum(low[:, 1:], -shear), np.minimum(high[:, 1:], shear)
    low[:, 0] = np.maximum(low[:, 0], 0.0)
    empty = low > high  # the cones miss the box: leave it whole, and IPOPT finds nothing
    low, high = np.where(empty, scaled.force_min, low), np.where(empty, scaled.force_max, high)
    tilt, weights = np.full(3, scaled.tilt), np.zeros(scaled.size[0] * scaled.size[1])
    return (
        np.concatenate([scaled.com - scaled.com_radius, -tilt, weights, low.ravel()]),
        np.concatenate([scaled.com + scaled.com_radius, tilt, weights + 1.0, high.ravel()]),
    )


def _vector(scaled: ScaledProblem, point: Point) -> Array:
    """x of a point; the weights λ by non-negative least squares, since a point has toes only."""
    weights = np.empty(scaled.size)
    for i, (corners, toe) in enumerate(zip(scaled.vertices, point.toes, strict=True)):
        weights[i] = nnls(np.vstack([corners.T, np.ones(len(corners))]), np.append(toe, 1.0))[0]
    return np.concatenate([point.com, point.rotation, weights.ravel(), point.forces.ravel()])


def _point(scaled: ScaledProblem, x: Array, *, converged: bool) -> Point:
    """The point of x and the largest component of its true net moment."""
    contacts, vertices = scaled.size
    com, rotation = x[:3], x[3:6]
    weights = np.maximum(x[6 : 6 + contacts * vertices].reshape(contacts, vertices), 0.0)
    weights = weights / weights.sum(axis=1, keepdims=True)
    forces = x[6 + contacts * vertices :].reshape(contacts, 3)
    toes = np.einsum("nu,nud->nd", weights, scaled.vertices)
    moment = np.cross(toes - com, np.einsum("nij,nj->ni", scaled.frames, forces)).sum(axis=0)
    residual = float(np.max(np.abs(moment))) if converged and np.all(np.isfinite(x)) else float("inf")
    return Point(com=com, rotation=rotation, toes=toes, forces=forces, residual=residual, solves=1)
