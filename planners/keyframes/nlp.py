"""The whole plan as one nonlinear program on IPOPT through CasADi, on one choice of patches.

Nothing is relaxed: the moments are the true bilinear ones (eq. 6); cones, reach and steps are written smoothly, as for
one posture (``contact.nlp``), and the Hessian is exact. What IPOPT ends on is polished, toes held, and then verified.
A local method from one start on one choice: that it finds nothing proves nothing.
"""

from __future__ import annotations

import time
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
from scipy.optimize import nnls

from ..arrays import Array, checked
from ..conic import ConicStatus
from ..contact.nlp import CONVERGED, ipopt_options
from ..outcome import InvalidInput
from ..plan import PlanOutcome
from ..scene.course import Course, Weights
from .clock import Clock
from .layout import Layout
from .planner import PlanAcceptance, plan_of
from .project import PlanPoint
from .scaled import ScaledCourse
from .search import nearest
from .twostage import CourseModels

Start = Literal["nominal", "p1"]
STARTS: tuple[Start, ...] = get_args(Start)
PULL = 1e-6
"""Weight of ½‖x − x_start‖² beside the objective: λ and f are not in it, and CasADi wants every slope to be there."""


class NlpCourse:
    """The program for one layout of one region, compiled once; all data are parameters.

    max_iterations, time_limit_s: where IPOPT gives up.
    """

    def __init__(
        self, layout: Layout, weights: Weights, length_m: float, *, max_iterations: int, time_limit_s: float
    ) -> None:
        program, equal = plan_program(layout, weights, length_m)
        rows = program["g"].numel()
        self._layout = layout
        self._low, self._high = np.r_[np.zeros(equal), np.full(rows - equal, -np.inf)], np.zeros(rows)
        self._solver = cs.nlpsol("plan", "ipopt", program, ipopt_options(max_iterations, time_limit_s))

    def solve(self, scaled: ScaledCourse, start: PlanPoint) -> tuple[PlanPoint, str, float]:
        """The point that IPOPT ends on, its return status and its time [s]; residual inf where it did not converge."""
        first, (low, high) = _vector(scaled, start), _bounds(scaled)
        begin = time.perf_counter()
        found = self._solver(
            x0=np.clip(first, low, high), p=_parameters(scaled, first), lbx=low, ubx=high, lbg=self._low,
            ubg=self._high,
        )  # fmt: skip
        seconds, status = time.perf_counter() - begin, str(self._solver.stats()["return_status"])
        x = np.asarray(found["x"], dtype=np.float64).ravel()
        return _point(scaled, x, converged=status in CONVERGED), status, seconds


class NlpCoursePlanner:
    """Feasible by IPOPT, or undecided.

    start: nominal (body on its path, toes in the middle of their patches) or p1 (the lift's point, where it has one).
    The choice of patches is the nearest with friction. time_limit_s: of one course, compiling left out.
    """

    name = "nlp"

    def __init__(
        self,
        *,
        acceptance: PlanAcceptance = PlanAcceptance(),
        start: Start = "nominal",
        max_iterations: int = 500,
        time_limit_s: float = 60.0,
        models: CourseModels | None = None,
    ) -> None:
        if start not in STARTS:
            raise InvalidInput(f"start: expected one of {', '.join(STARTS)}, got {start!r}")
        self.acceptance = acceptance
        self.start: Start = start
        self.max_iterations = max_iterations
        self.time_limit_s = checked(time_limit_s, "time_limit_s", above=0.0)
        self._models = models or CourseModels()
        self._programs: dict[tuple[object, ...], NlpCourse] = {}

    def solve(self, course: Course) -> PlanOutcome:
        """Plan one course."""
        clock, scaled = Clock.start(), ScaledCourse.of(course)
        choice = nearest(scaled).argmax(axis=1)
        chosen = scaled.chosen(choice)
        start = self._lifted(chosen, clock) if self.start == "p1" else nominal_point(chosen)
        point, claim, seconds = self._program(chosen, clock).solve(chosen, start)
        clock.count(1, seconds)
        plan, message = None, f"no plan from the {self.start} start; IPOPT said {claim}"
        if np.isfinite(point.residual):
            polished = self._models.projector(chosen).fix_toes(chosen, point, clock)
            kept = polished if polished.found else point
            plan, message = plan_of(scaled, choice, kept, provenance={"planner": self.name, "start": self.start}), ""
        return self.acceptance.outcome(
            course, method=self.name, clock=clock, plan=plan, claim=claim, message=message,
            details={"ipopt_s": seconds, "ipopt_residual": point.residual},
        )  # fmt: skip

    def _lifted(self, chosen: ScaledCourse, clock: Clock) -> PlanPoint:
        lifted = self._models.lift(chosen, clock).solve(chosen)
        clock.count(1, lifted.solution.seconds)
        start = nominal_point(chosen)
        if lifted.status is not ConicStatus.SOLVED:
            return start
        return PlanPoint(
            com=lifted.com, rotation=lifted.rotation, toes=lifted.toes[:, 0], forces=start.forces, residual=float("inf")
        )

    def _program(self, chosen: ScaledCourse, clock: Clock) -> NlpCourse:
        weights, length_m = chosen.course.weights, chosen.course.length_scale_m
        key = (chosen.layout, weights, length_m)
        if key not in self._programs:
            with clock.compiling():
                self._programs[key] = NlpCourse(
                    chosen.layout, weights, length_m, max_iterations=self.max_iterations, time_limit_s=self.time_limit_s
                )
        return self._programs[key]


def nominal_point(chosen: ScaledCourse) -> PlanPoint:
    """Body on its path, toes amid their patches, forces that share the weight and press with half of f_n."""
    stance, _, placement = chosen.layout.bearing
    carrying = np.bincount(stance)[stance]
    forces = chosen.frames[placement][:, 2, :] / carrying[:, None]  # an upward force in contact axes is R_WCᵀ e_z
    forces[:, 0] = np.maximum(forces[:, 0], 0.5 * chosen.course.force_max[0])
    return PlanPoint(
        com=chosen.com,
        rotation=np.zeros_like(chosen.com),
        toes=chosen.vertices.mean(axis=1),
        forces=np.clip(forces, chosen.course.force_min, chosen.course.force_max),
        residual=float("inf"),
    )


def plan_program(layout: Layout, weights: Weights, length_m: float) -> tuple[dict[str, Any], int]:
    """The program in CasADi's form and how many of its rows are equations; the others are ≤ 0.

    x = (c, Θ, λ, f), frame by frame, placement by placement, bearing by bearing; parameters as ``_parameters`` packs
    them. Rows: Σ λ_u − 1 (P), net force and net moment (6 a stance), = 0; cones (B), reach (M·N), COM's ball (M),
    steps of c and Θ and progress (3 a step), steps of toes.
    """
    frames, limbs, placements = layout.frames, layout.limbs, layout.placements
    stance, _, placement = layout.bearing
    bearings, steps, vertices = len(stance), frames - 1, layout.vertices
    sizes = {
        "vertices": (3, placements * vertices), "axes": (3, 3 * placements), "friction": (1, placements),
        "shoulders": (3, limbs), "reach": (1, limbs), "com": (3, frames), "com_radius": (1, frames),
        "limits": (3, 1), "direction": (3, steps), "progress": (1, steps), "goal": (3, 1),
    }  # fmt: skip
    data = {name: cs.SX.sym(name, *size) for name, size in sizes.items()}
    com, rotation = cs.SX.sym("com", 3, frames), cs.SX.sym("rotation", 3, frames)
    shares, forces = cs.SX.sym("weights", vertices, placements), cs.SX.sym("forces", 3, bearings)
    toes = [data["vertices"][:, vertices * p : vertices * (p + 1)] @ shares[:, p] for p in range(placements)]  # (1)
    force = [cs.SX([0, 0, -1]) for _ in layout.stances]
    moment = [cs.SX.zeros(3) for _ in layout.stances]
    cones = []
    for b, (s, p) in enumerate(zip(stance, placement, strict=True)):
        f, k = forces[:, b], layout.stances[s][0]
        f_w = data["axes"][:, 3 * p : 3 * (p + 1)] @ f
        force[s] += f_w  # Σ f + F = 0  (5)
        moment[s] += cs.cross(toes[p] - com[:, k], f_w)  # Σ p × f = 0  (6)
        cones.append(f[1] ** 2 + f[2] ** 2 - (data["friction"][p] * f[0]) ** 2)  # ≤ 0  (10)
    reach = []
    for k in range(frames):
        for i in range(limbs):
            v = data["shoulders"][:, i]
            leg = toes[layout.holds[k][i]] - com[:, k] - v - cs.cross(rotation[:, k], v)
            reach.append(cs.sumsqr(leg) - data["reach"][i] ** 2)  # ≤ 0  (11)
    balls = [cs.sumsqr(com[:, k] - data["com"][:, k]) - data["com_radius"][k] ** 2 for k in range(frames)]
    moved, turned = com[:, 1:] - com[:, :-1], rotation[:, 1:] - rotation[:, :-1]
    walked = [toes[after] - toes[before] for before, after in layout.moves]
    limits = [cs.sumsqr(moved[:, k]) - data["limits"][0] ** 2 for k in range(steps)]
    limits += [cs.sumsqr(turned[:, k]) - data["limits"][1] ** 2 for k in range(steps)]
    limits += [data["progress"][k] - cs.dot(data["direction"][:, k], moved[:, k]) for k in range(steps)]
    limits += [cs.sumsqr(step) - data["limits"][2] ** 2 for step in walked]
    x = cs.vertcat(*(cs.vec(part) for part in (com, rotation, shares, forces)))
    start = cs.SX.sym("start", x.numel())
    cost = weights.goal * cs.sumsqr(com[:, -1] - data["goal"]) + weights.tilt / length_m**2 * cs.sumsqr(rotation)
    cost += weights.com_step * cs.sumsqr(moved) + weights.toe_step * sum((cs.sumsqr(s) for s in walked), cs.SX(0))
    equations = cs.vertcat(cs.sum1(shares).T - 1, *force, *moment)
    program = {
        "x": x,
        "p": cs.vertcat(*(cs.vec(part) for part in data.values()), start),
        "f": cost + 0.5 * PULL * cs.sumsqr(x - start),
        "g": cs.vertcat(equations, *cones, *reach, *balls, *limits),
    }
    return program, int(equations.numel())


def _parameters(scaled: ScaledCourse, start: Array) -> Array:
    """The program's parameters; CasADi stacks columns, so that every vertex, axis and step is one."""
    course, length = scaled.course, scaled.course.length_scale_m
    limbs, steps = course.robot.limbs, course.steps
    return np.concatenate([
        scaled.vertices.ravel(), scaled.frames.transpose(0, 2, 1).ravel(), scaled.friction,
        np.ravel([limb.shoulder_m for limb in limbs]) / length, np.array([limb.reach_m for limb in limbs]) / length,
        scaled.com.ravel(), scaled.com_radius, [steps.com_m / length, steps.rotation_rad, steps.toe_m / length],
        scaled.direction.ravel(), scaled.progress, course.goal_m / length, start,
    ])  # fmt: skip


def _bounds(scaled: ScaledCourse) -> tuple[Array, Array]:
    """Bounds of x; those of shear and c are implied by the cones, which alone are degenerate at μ = 0 or radius 0."""
    course, radius = scaled.course, scaled.com_radius[:, None]
    friction = scaled.friction[scaled.layout.bearing[2]][:, None]
    low, high = (np.tile(bound, (len(friction), 1)) for bound in (course.force_min, course.force_max))
    low[:, 0] = np.maximum(low[:, 0], 0.0)
    shear = friction * max(float(course.force_max[0]), 0.0)
    low[:, 1:], high[:, 1:] = np.maximum(low[:, 1:], -shear), np.minimum(high[:, 1:], shear)
    tilt, shares = np.full(scaled.com.size, course.tilt_limit_rad), np.zeros(scaled.vertices[..., 0].size)
    return (
        np.concatenate([(scaled.com - radius).ravel(), -tilt, shares, low.ravel()]),
        np.concatenate([(scaled.com + radius).ravel(), tilt, shares + 1.0, high.ravel()]),
    )


def _vector(scaled: ScaledCourse, point: PlanPoint) -> Array:
    """x of a point; the weights λ by non-negative least squares, since a point has toes only."""
    shares = [
        nnls(np.vstack([corners.T, np.ones(len(corners))]), np.append(toe, 1.0))[0]
        for corners, toe in zip(scaled.vertices, point.toes, strict=True)
    ]
    return np.concatenate([point.com.ravel(), point.rotation.ravel(), np.ravel(shares), point.forces.ravel()])


def _point(scaled: ScaledCourse, x: Array, *, converged: bool) -> PlanPoint:
    """The point of x and the largest component of its true net moments."""
    stance, _, placement = scaled.layout.bearing
    ends = np.cumsum([scaled.com.size, scaled.com.size, scaled.vertices[..., 0].size])
    com, rotation, shares, forces = (
        part.reshape(-1, 3) if i != 2 else part for i, part in enumerate(np.split(x, ends))
    )
    shares = np.maximum(shares.reshape(scaled.vertices.shape[:2]), 0.0)
    toes = np.einsum("pu,pud->pd", shares / shares.sum(axis=1, keepdims=True), scaled.vertices)
    frames = np.array([frame for frame, _ in scaled.layout.stances])
    world = np.matmul(scaled.frames[placement], forces[..., None])[..., 0]
    moments = np.zeros((len(frames), 3))
    np.add.at(moments, stance, np.cross(toes[placement] - com[frames[stance]], world))
    residual = float(np.abs(moments).max()) if converged and np.all(np.isfinite(x)) else float("inf")
    return PlanPoint(com=com, rotation=rotation, toes=toes, forces=forces, residual=residual)
