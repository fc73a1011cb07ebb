"""Programs of P2 that hold one part of a point and solve for the rest: fix-p, fix-f, fix-toes, and
a step of SCP.

With the toes held the moment balance is linear in (c, f), since Σ f is fixed (``terms.Moments``):
exact and convex.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..answer.plan import Plan
from ..equilibrium.layout import Fill, Layout, Of
from ..equilibrium.programs import ConicSolution
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes, Given, HeldToes, Moments, objective
from ..files.arrays import Array, cross
from ..problem import Problem
from ..verify.margins import borne_share, stances_of

PUSHES = (0.05, 0.025)
"""Shares of the weight: horizontal pushes at the body that every stance bears, the most cautious
first."""
PRESSES = (0.2, 0.1, 0.05)
"""Shares of the weight that every foot that carries bears at least, the most cautious first."""


def pressing(course: Problem, share: float) -> Problem:
    """The course in which every foot that carries presses with this share of the weight or more.

    Arguments:
        share: of m g, along the contact's normal; f_n,min of E10 is raised to it.
    """
    share *= course.weight_n / course.force_n
    footholds = tuple(
        foothold
        if foothold.force_min is None
        else replace(foothold, force_min=_raised(foothold.force_min, share))
        for foothold in course.footholds
    )
    return replace(course, force_min=_raised(course.force_min, share), footholds=footholds)


def _raised(low: Array, share: float) -> Array:
    """Least forces of which the normal one is at least so much."""
    return np.array([max(float(low[0]), share), *low[1:]])


def pushed(course: Problem, share: float) -> Problem:
    """The course in which every stance bears a push of this share of the weight, or the one it asks
    for already.
    """
    return replace(course, push_n=max(course.push_n, share * course.weight_n))


def push_share(plan: Plan) -> float:
    """The largest of ``PUSHES`` that every stance of a plan bears, as it is; 0 for none."""
    return borne_share(plan, PUSHES)


def steady(plan: Plan, share: float) -> bool:
    """Tell whether there are forces in every stance of a plan with which every foot that carries
    presses this hard.

    True of a plan for soles, whose points are not feet of their own.
    """
    if plan.problem.has_soles:
        return True
    return bool(stances_of(plan, share).hold().all())


MOMENT_PRICE = 30.0
"""Price of the moments that a linearised step leaves, in units of the objective: large against its
own slopes."""


class FixToes:
    """The toes held; with hold_body c and Θ, too, and so p_b (fix-p).

    One candidate a foothold.

    Arguments:
        least_moment: minimise the residual of the moments; else they are zero, and a course's
            objective is minimised.
    """

    def __init__(self, layout: Layout, hold_body: bool, least_moment: bool) -> None:
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, forces = BodyVariables(rows, layout), Forces.of_contacts(rows, layout)
        forces.balance()
        moments = Moments.of(layout, body, forces, "held_arms")
        if least_moment:
            rows.linear(moments.within(rows), 1.0)
        else:
            moments.vanish(rows)
            objective(rows, layout, body, None)
        forces.in_cones()
        forces.in_box(implied=False)
        if hold_body:
            body.held()
        else:
            body.reach(HeldToes(rows), inner=True)
            body.limits()
            body.steps(None)
        self._hold_body = hold_body

    def solve(self, scaled: Scaled, start: Point) -> Point:
        """Hold the toes of ``start``, with hold_body its c and Θ, too, and solve for the rest.

        Returns a point whose residual is the largest component of the moments, 0.0 where they are
        hard, and inf where there is no answer.
        """
        solution = self.rows.solve(Given(scaled, start))
        body = start if self._hold_body else None
        return _point(solution, toes=start.toes, forces=solution.value("forces"), body=body)


class FixForces:
    """The contact-frame forces held (fix-f): least moment residual over toes, c and Θ, which is
    convex.
    """

    def __init__(self, layout: Layout) -> None:
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, toes, moments = (
            BodyVariables(rows, layout),
            FreeToes(rows, layout, explicit=True),
            Moments(layout),
        )
        _levers(moments, layout, toes)
        if layout.points:
            moments.shift(_sole_moments)
        moments.of_weight(body)
        rows.linear(moments.within(rows), 1.0)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(toes)

    def solve(self, scaled: Scaled, start: Point) -> Point:
        """Hold the forces of ``start`` and solve for toes, c and Θ.

        Returns a point on its patches; its residual is the largest component of the moments, inf
        where there is no answer.
        """
        solution = self.rows.solve(Given(scaled, start))
        return _point(solution, toes=toes_of(solution, scaled), forces=start.forces)


class Linearised:
    """One convex step of SCP: p × F replaced by p̄ × F + (p − p̄) × F̄ about a point (p̄, F̄), in
    every stance.

    Arguments:
        least_moment: minimise what it leaves of the moments; else the objective with
            ``MOMENT_PRICE`` on them.
    """

    def __init__(self, layout: Layout, least_moment: bool) -> None:
        self.rows = rows = Rows[Given](keep=layout.frames == 1)
        body, toes = BodyVariables(rows, layout), FreeToes(rows, layout, explicit=True)
        forces = Forces.of_contacts(rows, layout)
        forces.balance()
        residual = linearised_moments(layout, body, toes, forces).within(rows)
        if least_moment:
            rows.linear(residual, 1.0)
        else:
            objective(rows, layout, body, toes)
            rows.linear(residual, MOMENT_PRICE)
        forces.in_cones()
        forces.in_box(implied=False)
        body.reach(toes, inner=True)
        body.limits()
        body.steps(toes)

    def solve(self, scaled: Scaled, about: Point) -> Point:
        """Step from ``about``, which gives p̄ and F̄; one candidate a foothold.

        Returns a point whose residual is that of the linearised moments, not of the true ones; inf
        without an answer.
        """
        solution = self.rows.solve(Given(scaled, about))
        return _point(solution, toes=toes_of(solution, scaled), forces=solution.value("forces"))


def linearised_moments(
    layout: Layout, body: BodyVariables, toes: FreeToes, forces: Forces
) -> Moments:
    """p̄ × F + (p − p̄) × F̄ less that of the weight, of every stance.

    Arguments:
        toes: explicit.
    """
    moments, (stance, _, foothold) = Moments.of(layout, body, forces, "held_arms"), layout.contacts
    _levers(moments, layout, toes)

    def offset(given: Given) -> Array:
        """−Σ p̄ × F̄ of every stance."""
        total = np.zeros((len(layout.stances), 3))
        world = given.scaled.in_world(given.held.forces)
        np.subtract.at(total, stance, cross(given.held.toes[foothold], world))
        return total

    moments.shift(offset)
    return moments


def _levers(moments: Moments, layout: Layout, toes: FreeToes) -> None:
    """p × F̄ of every stance contact, linear in its toe: −[F̄]× p; of a sole F̄ is the sum over its
    points.
    """
    stance, _, foothold = layout.contacts
    first = np.flatnonzero(layout.contact_points == 0)  # a row a foot
    assert toes.points is not None
    levers: Of | Fill[Given] = -Of("held_levers")
    if layout.points:
        levers = lambda given: -np.add.reduceat(given.held_levers, first)  # noqa: E731
    moments.add(stance[first], toes.points[foothold[first]], levers)


def _sole_moments(given: Given) -> Array:
    """Σ o × F̄ of every stance, o from the toe to the point that bears."""
    scaled = given.scaled
    total = np.zeros((len(scaled.layout.stances), 3))
    arms = scaled.bearing_points(np.zeros_like(given.held.toes))
    np.add.at(total, scaled.layout.contacts[0], cross(arms, scaled.in_world(given.held.forces)))
    return total


def toes_of(solution: ConicSolution, scaled: Scaled) -> Array:
    """Toes on their patches to the last digit: convex combinations of the vertices."""
    layout = scaled.layout
    weights = np.maximum(solution.value("weights"), 0.0)
    toes, total = np.zeros((layout.footholds, 3)), np.zeros(layout.footholds)
    np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
    np.add.at(total, layout.vertex_footholds, weights)
    return toes / np.maximum(total, 1e-12)[:, None]


def _point(
    solution: ConicSolution, *, toes: Array, forces: Array, body: Point | None = None
) -> Point:
    left = float(solution.value("residual")[0]) if "residual" in solution.columns else 0.0
    return Point(
        com=solution.value("com") if body is None else body.com,
        rotation=solution.value("rotation") if body is None else body.rotation,
        toes=toes,
        forces=forces,
        residual=max(0.0, left) if solution.solved else float("inf"),
        objective=solution.objective,
        seconds=solution.seconds,
    )
