"""The posture problem with its true bilinear moment, written for solvers that branch in space:
Gurobi and SCIP.

In the form "eliminated" toes, p and m are gone: left are c, Θ, and U − 1 weights, three forces and
the vector from shoulder to toe a limb. A product of a weight and a force is all that is bilinear,
since Σ f is fixed and the centre of mass enters linearly. The form "paper" keeps p and m as
variables with m = p f (E2, E8, E9), in their plain bounds.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np

from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.domain import domain_of

MODULES = {"gurobi": "gurobipy", "scip": "pyscipopt"}
Form = Literal["eliminated", "paper"]
Label = Literal["feasible", "infeasible", "unknown", "size limit"]


@dataclass(frozen=True, kw_only=True, eq=False)
class BilinearAnswer:
    """What a solver says, its point, and its own CPU time without the model's building [s]."""

    label: Label
    point: Point | None
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Unknowns:
    """The solver's variables, as object arrays: c, Θ (3,), weights (N, U − 1), forces and legs (N,
    3).

    position (N, 3) and moments (N, 3, 3) in the paper's form only.
    """

    com: Any
    rotation: Any
    weights: Any
    forces: Any
    legs: Any
    position: Any = None
    moments: Any = None

    def point(self, scaled: Scaled, value: Any) -> Point:
        """The point at which ``value`` gives every variable's value."""
        com, rotation, weights, forces = (
            np.array([[value(x) for x in row] for row in np.atleast_2d(part)])
            for part in (self.com, self.rotation, self.weights, self.forces)
        )
        weights = np.hstack([weights, 1.0 - weights.sum(axis=1, keepdims=True)])
        toes = np.einsum("nu,nud->nd", weights, scaled.patches)
        return Point(com=com, rotation=rotation, toes=toes, forces=forces, residual=float("nan"))


def solve(solver: str, scaled: Scaled, *, form: Form, time_limit_s: float) -> BilinearAnswer:
    """Solve on one thread."""
    return {"gurobi": _gurobi, "scip": _scip}[solver](scaled, form, time_limit_s)


def installed(solver: str) -> bool:
    """Whether the solver can be imported."""
    return find_spec(MODULES[solver]) is not None


def _gurobi(scaled: Scaled, form: Form, time_limit_s: float) -> BilinearAnswer:
    import gurobipy as gp

    with gp.Env(params={"OutputFlag": 0}) as env, gp.Model(env=env) as model:
        model.setParam("Threads", 1)
        model.setParam("NonConvex", 2)
        model.setParam("TimeLimit", time_limit_s)
        unknowns = _unknowns(scaled, form, lambda low, high: model.addVar(lb=low, ub=high))
        model.update()
        for row in _equal_zero(scaled, unknowns):
            model.addConstr(row == 0.0)
        for row in _at_most_zero(scaled, unknowns):
            model.addConstr(row <= 0.0)
        begin = time.process_time()
        try:
            model.optimize()
        except gp.GurobiError as error:
            if error.errno != gp.GRB.Error.SIZE_LIMIT_EXCEEDED:
                raise
            return BilinearAnswer(label="size limit", point=None, seconds=float("nan"))
        seconds = time.process_time() - begin
        if model.SolCount:
            point = unknowns.point(scaled, lambda variable: variable.X)
            return BilinearAnswer(label="feasible", point=point, seconds=seconds)
        proved = model.Status in (gp.GRB.INFEASIBLE, gp.GRB.INF_OR_UNBD)  # there is no objective
        return BilinearAnswer(
            label="infeasible" if proved else "unknown", point=None, seconds=seconds
        )


def _scip(scaled: Scaled, form: Form, time_limit_s: float) -> BilinearAnswer:
    import pyscipopt

    model = pyscipopt.Model()
    model.hideOutput()
    model.setParam("limits/time", time_limit_s)
    unknowns = _unknowns(scaled, form, lambda low, high: model.addVar(lb=low, ub=high))
    for row in _equal_zero(scaled, unknowns):
        model.addCons(row == 0.0)
    for row in _at_most_zero(scaled, unknowns):
        model.addCons(row <= 0.0)
    begin = time.process_time()
    model.optimize()
    seconds = time.process_time() - begin
    if model.getNSols():
        point = unknowns.point(scaled, model.getVal)
        return BilinearAnswer(label="feasible", point=point, seconds=seconds)
    proved = model.getStatus() in ("infeasible", "inforunbd")
    return BilinearAnswer(label="infeasible" if proved else "unknown", point=None, seconds=seconds)


def _unknowns(scaled: Scaled, form: Form, add: Any) -> _Unknowns:
    """Variables with the tightest plain bounds: those of the centre of mass' ball, the cones and
    the reach.

    In the paper's form the forces have their own box, and p and m lie in [−1, 1].
    """
    contacts, vertices = scaled.size
    f_low, f_high = (
        (scaled.force_min, scaled.force_max)
        if form == "paper"
        else domain_of(scaled, "contact").force
    )
    one = np.ones((contacts, 3))

    def block(low: Array, high: Array) -> Any:
        made = [add(float(a), float(b)) for a, b in zip(low.ravel(), high.ravel(), strict=True)]
        return np.array(made, dtype=object).reshape(low.shape)

    tilt, weights = np.full(3, scaled.tilt), np.zeros((contacts, vertices - 1))
    reach = np.repeat(scaled.reach[:, None], 3, axis=1)
    return _Unknowns(
        com=block(scaled.com[0] - scaled.com_radius, scaled.com[0] + scaled.com_radius),
        rotation=block(-tilt, tilt),
        weights=block(weights, weights + 1.0),
        forces=block(f_low, f_high),
        legs=block(-reach, reach),
        position=block(-one, one) if form == "paper" else None,
        moments=block(-np.ones((contacts, 3, 3)), np.ones((contacts, 3, 3)))
        if form == "paper"
        else None,
    )


def _toe(scaled: Scaled, unknowns: _Unknowns, i: int) -> list[Any]:
    """p_w of limb i, from its last vertex."""
    last = scaled.patches[i, -1]
    edges = scaled.patches[i, :-1] - last
    return [
        last[j] + sum(edges[u, j] * unknowns.weights[i, u] for u in range(len(edges)))
        for j in range(3)
    ]


def _equal_zero(scaled: Scaled, unknowns: _Unknowns) -> list[Any]:
    """Net force (E5), net moment (E6, about the world's origin) and the definition of the legs
    (E11).
    """
    com, weight = unknowns.com, scaled.weight
    force, moment, rows = [0.0, 0.0, -weight], [-weight * com[1], weight * com[0], 0.0], []
    for i in range(scaled.size[0]):
        toe = _toe(scaled, unknowns, i)
        f = [
            sum(scaled.frames[i, j, k] * unknowns.forces[i, k] for k in range(3)) for j in range(3)
        ]
        if unknowns.moments is None:
            moment = [m + c for m, c in zip(moment, _cross(toe, f), strict=True)]
        force = [a + b for a, b in zip(force, f, strict=True)]
        shoulder = scaled.shoulders[i]
        turned = _cross(unknowns.rotation, shoulder)
        rows += [toe[j] - com[j] - shoulder[j] - turned[j] - unknowns.legs[i, j] for j in range(3)]
        if unknowns.moments is not None:
            rows += [toe[j] - com[j] - unknowns.position[i, j] for j in range(3)]
    if unknowns.moments is not None:
        moment = _moment_of_products(scaled, unknowns)
        rows += [
            unknowns.moments[i, j, k] - unknowns.position[i, j] * unknowns.forces[i, k]
            for i in range(scaled.size[0])
            for j in range(3)
            for k in range(3)
        ]
    return [*force, *moment, *rows]


def _moment_of_products(scaled: Scaled, unknowns: _Unknowns) -> list[Any]:
    """Σ m_ijk P_j × F_ik (E9), about the centre of mass."""
    total: list[Any] = [0.0, 0.0, 0.0]
    for i in range(scaled.size[0]):
        for j in range(3):
            for k in range(3):
                axis = np.cross(np.eye(3)[j], scaled.frames[i, :, k])
                total = [
                    t + float(a) * unknowns.moments[i, j, k]
                    for t, a in zip(total, axis, strict=True)
                ]
    return total


def _at_most_zero(scaled: Scaled, unknowns: _Unknowns) -> list[Any]:
    """Patches (E1), cones (E10), reach (E11) and the ball of the centre of mass."""
    off = [unknowns.com[j] - float(scaled.com[0, j]) for j in range(3)]
    rows = [_square(off) - float(scaled.com_radius[0]) ** 2]
    for i in range(scaled.size[0]):
        f = unknowns.forces[i]
        rows.append(sum(unknowns.weights[i]) - 1.0)
        rows.append(_square(f[1:]) - float(scaled.friction[i]) ** 2 * f[0] * f[0])
        rows.append(_square(unknowns.legs[i]) - float(scaled.reach[i]) ** 2)
    return rows


def _square(vector: Any) -> Any:
    return sum(x * x for x in vector)


def _cross(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
