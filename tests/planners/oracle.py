"""The programs that are written as rows, said again in cvxpy: what tests hold the rows against.

Those of the paper are ``relaxation.papers``; what this package adds to them (the gap of the lift,
the lift joined with P1, cones times boxes, a step of SCP, positions without forces) stands here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cvxpy as cp
import numpy as np

from stancekit import Problem
from stancekit.planners.equilibrium.programs import ConicSolution, ConicStatus, Programs
from stancekit.planners.equilibrium.rows import EXACT, STATUS
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.projection.held import MOMENT_PRICE, FixForces, FixToes, Linearised
from stancekit.planners.relaxation import papers
from stancekit.planners.relaxation.lift import MARGIN_PRICE, JointRelaxation, LeastGap, LiftProgram
from stancekit.planners.relaxation.mccormick import Boxed, Coned, McCormick, WithoutMoment
from stancekit.planners.relaxation.papers import ContactForces, Model, PlanVariables, Products
from stancekit.planners.search.micp import Positions


def _p1(given: Boxed, axes: str = "contact", soft: bool = True, boxes: int = 1) -> Model:
    if boxes > 1:
        return papers.p1_of_modes(given.scaled, given.boxes, given.allowed, axes=axes)
    return papers.p1(given.scaled, given.boxes[0], soft=soft, axes=axes)


def _coned(given: Boxed, axes: str = "contact", soft: bool = True, boxes: int = 1) -> Model:
    """P1 and the friction cones times the box's bounds of positions, where there is one candidate."""
    model, layout = _p1(given, axes, soft, boxes), given.scaled.layout
    counts = np.bincount(layout.candidate_footholds, minlength=layout.footholds)
    coned = np.flatnonzero(counts[layout.contacts[2]] == 1)
    if axes == "world" or boxes > 1 or not len(coned):
        return model
    candidate = np.searchsorted(layout.candidate_footholds, layout.contacts[2])[coned]
    products = cp.reshape(model.products.moments[coned], (3 * len(coned), 3), order="C")
    each = np.kron(np.eye(len(coned)), np.ones((3, 1))) @ model.products.forces[coned]
    low, high = (end[coned].reshape(-1, 1) for end in given.boxes[0].position)
    moved = cp.vstack([products - cp.multiply(low, each), cp.multiply(high, each) - products])
    friction = np.tile(np.repeat(given.scaled.friction[candidate], 3), 2)
    most = cp.multiply(friction, moved[:, 0]) + (model.cost if soft else 0.0)
    return replace(model, terms=model.terms | {"box_cones": cp.SOC(most, moved[:, 1:], axis=1)})


def _least_gap(given: Any) -> Model:
    """The lift with the least gap Σ_u (v_u − p̂)(f_u − λ_u f̂)ᵀ of its products from p fᵀ, linearised
    at (p̂, f̂).
    """
    plan, forces, moment = _lifted(given.scaled)
    cost, terms = _gap(plan, forces, given.held)
    terms |= {**papers.on_toes(plan, inner=True), **papers.on_forces(forces)}
    return Model(cost=cost, terms={**terms, "moment": moment == 0}, plan=plan)


def _joint(given: Boxed, signed: bool = False) -> Model:
    """The lift and P1 over a box, linked in all nine components of Σ p fᵀ (``relaxation.joint``)."""
    scaled: Scaled = given.scaled
    plan, forces, moment = _lifted(scaled)
    layout = plan.layout
    stance, count = layout.contacts[0], len(layout.stances)
    contact, vertex = layout.contact_vertices
    products = Products(plan, forces, "contact")
    margin = cp.Variable(1, name="margin")
    com = plan.com[layout.stance_frames]
    linked = []
    for j in range(3):  # of p; the rows are the axes of R f
        of_vertices = cp.multiply(scaled.vertices[vertex][:, j : j + 1], forces.world)
        of_box = papers.rotated(scaled.contact_frames, products.parts[2][:, 3 * j : 3 * j + 3])
        linked.append(
            papers.added(of_vertices, stance[contact], count)
            - papers.added(of_box, stance, count)
            - cp.multiply(com[:, j : j + 1], scaled.borne)
        )
    terms = {
        **papers.on_toes(plan),
        **papers.on_forces(forces),
        **products.sums(),
        "moment": moment == 0,
        "linked": cp.hstack(linked) == 0,
        **papers.mccormick(products.parts, given.boxes[0], margin=margin),
    }
    if signed:
        return Model(cost=margin[0], terms=terms, plan=plan)
    gap, is_gap = _gap(plan, forces, given.held)
    terms |= {**is_gap, "margin_positive": -margin <= 0}
    return Model(cost=MARGIN_PRICE * margin[0] + gap, terms=terms, plan=plan)


def _lifted(scaled: Scaled) -> tuple[PlanVariables, ContactForces, cp.Expression]:
    """The variables of the lift, and its net moments."""
    plan = PlanVariables(scaled)
    forces = ContactForces.of_vertices(plan)
    return (
        plan,
        forces,
        plan.net(papers.cross(scaled.bearing_vertices, forces.world), forces.stance),
    )


def _gap(plan: PlanVariables, forces: ContactForces, about: Point) -> tuple[Any, papers.Terms]:
    """Σ g² and what g is, g_jk of a stance contact in the column 3j + k."""
    layout = plan.layout
    contact, vertex = layout.contact_vertices
    arms = plan.scaled.vertices[vertex] - about.toes[layout.contacts[2][contact]]
    off = forces.forces - cp.multiply(plan.weights[vertex][:, None], about.forces[contact])
    products = cp.hstack([cp.multiply(arms[:, j : j + 1], off) for j in range(3)])
    gap = cp.Variable((len(layout.contacts[0]), 9), name="gap")
    total = papers.added(products, contact, len(layout.contacts[0]))
    return cp.sum_squares(gap), {"gap": total - gap == 0}


def _linearised(given: Any, least_moment: bool) -> Model:
    """A step of SCP: p × F replaced by p̄ × F + (p − p̄) × F̄ about a point, in every stance."""
    scaled, about = given.scaled, given.held
    plan, foothold = PlanVariables(scaled), scaled.layout.contacts[2]
    forces, before = ContactForces.of_contacts(scaled), scaled.in_world(about.forces)
    moved = papers.cross(scaled.bearing_points(about.toes), forces.world)
    moved += papers.cross(plan.toes[foothold] - about.toes[foothold], before)
    residual, terms = papers.within(plan.net(moved, forces.stance))
    cost = residual if least_moment else plan.objective() + MOMENT_PRICE * residual
    terms |= {**papers.on_toes(plan, inner=True), **papers.on_forces(forces)}
    return Model(cost=cost, terms=terms, plan=plan)


def _positions(given: Any) -> Model:
    """Body and toes without forces."""
    plan = PlanVariables(given.scaled)
    return Model(cost=plan.objective(), terms=papers.on_toes(plan, inner=True), plan=plan)


MODELS: dict[Callable[..., Any], Callable[..., Model]] = {
    WithoutMoment: lambda given, inner=False: papers.p_bar(given.scaled, inner=inner),
    McCormick: _p1,
    Coned: _coned,
    LiftProgram: lambda given, _, least: papers.lift(given.scaled, least_moment=least),
    LeastGap: _least_gap,
    JointRelaxation: _joint,
    FixToes: lambda given, hold_body, least: papers.fix_toes(
        given.scaled, given.held, hold_body=hold_body, least_moment=least
    ),
    FixForces: lambda given: papers.fix_forces(given.scaled, given.held),
    Linearised: _linearised,
    Positions: _positions,
}
"""Models of the programs in rows, each given what a program is loaded with and what it was made of
beside its layout.
"""


class OraclePrograms(Programs):
    """Programs that solve their models in cvxpy in the place of their rows."""

    def get(self, make: Any, *key: Hashable) -> Any:
        made = super().get(make, *key)
        if make in MODELS:
            rows = made.rows

            def solve(given: Any) -> ConicSolution:
                return solve_as(MODELS[make](given, *key[1:]), rows.columns, rows.groups)

            rows.solve = solve
        return made


def solve(model: Any) -> ConicSolution:
    """Solve a model by Clarabel as cvxpy calls it, on one thread.

    Arguments:
        model: with a ``cost``, ``terms`` and the ``problem`` that they make.
    """
    problem = model.problem
    data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts={})
    begin = time.perf_counter()
    answer = chain.solve_via_data(problem, data, solver_opts={"max_threads": 1})
    seconds = time.perf_counter() - begin
    # cvxpy keeps rays to itself: whatever came is sent back through its reductions as if it were a
    # solution
    names = ("obj_val", "solve_time", "iterations", "x", "z")
    fields = {name: getattr(answer, name) for name in names}
    problem.unpack_results(SimpleNamespace(status="Solved", **fields), chain, inverse)
    constant = float(problem.value) - answer.obj_val
    x, columns = _packed((variable.name(), variable.value) for variable in problem.variables())
    z, groups = _packed((name, _dual(term)) for name, term in model.terms.items())
    return ConicSolution(
        status=STATUS.get(answer.status, ConicStatus.FAILED),
        answer=SimpleNamespace(x=x, z=z),
        columns=columns,
        groups=groups,
        objective=answer.obj_val + constant,
        bound=min(answer.obj_val, answer.obj_val_dual) + constant,
        exact=answer.status in EXACT,
        iterations=answer.iterations,
        seconds=seconds,
    )


def solve_as(model: Any, columns: Mapping[str, Any], groups: Mapping[str, Any]) -> ConicSolution:
    """``solve``, x and z in the order of a program in rows.

    A name whose size the model does not have is left out, with NaN in its place: toes that are
    columns of their own, and groups that are smaller where some rows follow from the others.
    """
    solution = solve(model)
    x, matched = _placed(columns, solution.columns, solution.x)
    z, rows = _placed(groups, solution.groups, solution.z)
    return replace(solution, answer=SimpleNamespace(x=x, z=z), columns=matched, groups=rows)


def _placed(
    wanted: Mapping[str, Any], has: Mapping[str, Any], values: np.ndarray
) -> tuple[np.ndarray, dict[str, Any]]:
    """Values in the places that are wanted, by name, and those names."""
    matched = {name: at for name, at in wanted.items() if name in has and has[name].size == at.size}
    placed = np.full(sum(at.size for at in wanted.values()), np.nan)
    for name, at in matched.items():
        placed[at] = values[has[name]].reshape(at.shape)
    return placed, matched


def _dual(term: cp.Constraint) -> np.ndarray:
    """Multipliers of a constraint; of cones one row each, (t, x)."""
    if isinstance(term, cp.SOC):
        return np.column_stack(term.dual_value)
    return np.asarray(term.dual_value)


def _packed(named: Iterable[tuple[str, np.ndarray]]) -> tuple[np.ndarray, dict[str, Any]]:
    """All values in one row, and where each is in it, in its own shape."""
    parts, where, size = [np.zeros(0)], dict[str, Any](), 0
    for name, value in named:
        where[name] = size + np.arange(value.size).reshape(value.shape)
        parts.append(np.ravel(value))
        size += value.size
    return np.concatenate(parts), where


def with_choice(course: Problem, choice: Iterable[int]) -> Problem:
    """The course with one candidate a foothold."""
    return replace(
        course,
        footholds=tuple(
            replace(
                foothold,
                candidates=(foothold.candidates[int(chosen)],),
                yaws_rad=foothold.yaws_rad[int(chosen) : int(chosen) + 1],
            )
            for foothold, chosen in zip(course.footholds, choice, strict=True)
        ),
    )
