"""A leap with given contacts: convex steps about the point so far, until the bilinear rows hold
(SCP).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..answer.plan import LeapPlan
from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Scaled
from ..equilibrium.terms import BodyVariables, Forces, FreeToes
from ..files.arrays import Array, cross
from .method import (
    FRICTION_SHARE as FRICTION_SHARE,
    OF_CANDIDATE as OF_CANDIDATE,
    OF_LEAP as OF_LEAP,
    STOP as STOP,
    LeapFeatures as LeapFeatures,
    Rule as Rule,
    Scorer as Scorer,
)
from .numbers import FREE_M, LeapGiven, LeapNumbers, LeapPoint
from .terms import PRICES, SLACKS, SPEED_RESERVE, Dynamics, Legs, Turning, still_moments, trust

LITTLE = 1e-5
"""Price of Σ f², which picks one of many equal answers."""
_EVEN = 1e-3
"""That price for robots whose legs are known, which then push alike on both sides."""


@dataclass(frozen=True, eq=False)
class _Step:
    """An answer of ``LeapProgram``: the conic solution, its point, and what its slack costs (NaN
    without a point).
    """

    solution: ConicSolution
    point: LeapPoint | None
    cost: float


_UPRIGHT, _QUIET = 2e-2, 10.0
"""Price of squares of Θ [1/rad²] and of L [s²/m⁴] at every frame, for robots whose legs are known:
with nothing to hold them a body rolls as far as it may, and legs that swing make more of it."""


class LeapProgram:
    """A leap with given contacts, bilinear rows linearised about a point with slack; one candidate
    per foothold.

    Arguments:
        still: whether the first and the last interval are in equilibrium.
        joints: how many per leg have rows; 0 where legs were not judged.
        quiet: share of the prices of turning and of pushing unevenly; 0 for none.
    """

    def __init__(
        self, layout: Layout, still: tuple[bool, bool], joints: int = 0, quiet: float = 0.0
    ) -> None:
        self.layout, self.rows = layout, Rows[LeapGiven](keep=False)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=True)
        forces = Forces.of_contacts(rows, layout)
        dynamics = Dynamics(rows, layout, body, still)
        dynamics.linear(forces)
        turning = Turning(rows, layout, body, dynamics)
        turning.ends()
        turning.limits()
        turning.go_on(forces, toes)
        legs = Legs(rows, layout, body, dynamics, toes)
        legs.height()
        legs.fold()
        legs.speed(turning.momentum)
        legs.power(forces, turning.momentum)
        if joints:
            legs.joints(forces, turning.momentum, joints)
        if quiet:
            rows.square(body.rotation, None, quiet * _UPRIGHT)
            rows.square(turning.momentum, None, quiet * _QUIET)
        if layout.reach_rows:
            legs.inside()
        forces.in_cones()
        forces.in_box(implied=True)
        body.reach(toes)
        body.limits()
        trust(rows, layout, toes)
        rows.square(forces.columns, None, max(quiet * _EVEN, LITTLE))

    def solve(self, given: LeapGiven) -> _Step:
        """One step from the point of ``given``."""
        solution = self.rows.solve(given)
        if not solution.solved:
            return _Step(solution, None, float("nan"))
        names = ("com", "rotation", "velocity", "momentum", "toes")
        point = LeapPoint(
            **{name: solution.value(name) for name in names},
            forces=given.scaled.in_world(solution.value("forces")),
        )
        return _Step(solution, point, _slack_cost(solution))


class LeapLift:
    """The relaxation over every open candidate: linear dynamics, forces per vertex, and moments
    where the body rests.

    What it says is true of every leap: c × F is left out, and with it L, Θ′ and what limits legs
    beside their reach.
    """

    def __init__(self, layout: Layout, still: tuple[bool, bool]) -> None:
        self.layout, self.rows = layout, Rows[LeapGiven](keep=False)
        rows = self.rows
        body = BodyVariables(rows, layout)
        toes = FreeToes(rows, layout, explicit=True)
        forces = Forces.of_vertices(rows, layout, toes)
        dynamics = Dynamics(rows, layout, body, still)
        dynamics.linear(forces)
        still_moments(rows, layout, body, forces, dynamics)
        Legs(rows, layout, body, dynamics, toes).height()
        forces.in_cones()
        forces.in_box(implied=True)
        body.reach(toes)
        body.limits()

    def solve(self, given: LeapGiven) -> ConicSolution:
        """Look for a point of the relaxation.

        Where there is none, ``dual`` of the answer is a ray that proves it.
        """
        return self.rows.solve(given)


def _slack_cost(solution: ConicSolution) -> float:
    """Cost of an answer's slack."""
    total = 0.0
    for name in SLACKS:
        for end in ("over", "under"):
            if f"{name}_{end}" in solution.columns:
                total += PRICES[name] * float(
                    np.maximum(solution.value(f"{name}_{end}"), 0.0).sum()
                )
    return total


_STEPS = 10
_STUCK = 0.1
"""A step that promises to win less than this share of the cost is the last one."""
HOLDS = 1e-6
"""Cost of what is left at which the rows hold."""
_RADIUS_M, _LEAST_RADIUS_M = 0.2, 1e-4
REACH_RESERVE_M, HEIGHT_RESERVE_M, TILT_RESERVE_RAD = 0.008, 0.004, 0.01
"""Kept of reach, height and tilt, for what rows at instants and a linearised rotation leave out."""
_EDGE_M = 0.02
"""Kept from the borders of patches by robots whose legs are known: feet land a little off."""
LEAST_FRICTION = 1e-4
"""Friction below this is raised to it in programs, so that a cone says that forces push."""
_GENTLE = 0.1
"""Share of the prices of turning while contacts are looked for: with all of them slack is cheaper."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapAttempt:
    """An attempt at one choice of contacts.

    Arguments:
        choice: a candidate per foothold, shape (P,).
        point: the best one, None where the first step has none.
        cost: of what is left of its rows.
        first: cost of the first step's slack, which nearly decides.
        solution: of that step, about ``data``.
        solves: convex problems.
        share: of the friction.
    """

    choice: Index
    point: LeapPoint | None
    cost: float
    first: float
    solution: ConicSolution
    data: LeapGiven
    solves: int
    share: float

    @property
    def solved(self) -> bool:
        """Tell whether all rows hold."""
        return self.point is not None and self.cost <= HOLDS

    @cached_property
    def refuted(self) -> bool:
        """Tell whether the first step's hard rows have no answer, so that its multipliers are a
        Farkas ray.
        """
        return self.solution.status is ConicStatus.INFEASIBLE


def attempt(
    programs: Programs,
    numbers: LeapNumbers,
    choice: Index,
    *,
    share: float = FRICTION_SHARE,
    stop: float = STOP,
    steps: int = _STEPS,
    shortened_m: Array | float = 0.0,
) -> LeapAttempt:
    """Try one choice of contacts from the nominal motion.

    Arguments:
        share: of the friction.
        shortened_m: what is kept of the reach of every limb besides, shape (N,) [m].
        stop: cost of the first step's slack above which there is no second one; inf never stops.
        steps: convex problems at most.
    """
    scaled = reserved(numbers, choice, share)
    scaled = replace(scaled, reach=scaled.reach - shortened_m)
    quiet = _GENTLE if numbers.leap.robot.own else 0.0
    program = programs.get(LeapProgram, scaled.layout, numbers.leap.still, 0, quiet)
    middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
    problem = LeapGiven(
        scaled,
        loaded_numbers=numbers,
        at=replace(numbers.nominal, toes=middles),
        reserve_m=HEIGHT_RESERVE_M,
    )
    first = answer = program.solve(problem)
    if answer.point is None:
        return LeapAttempt(
            choice=choice,
            point=None,
            cost=np.inf,
            first=np.inf,
            solution=first.solution,
            data=problem,
            solves=1,
            share=share,
        )
    best, cost, solves = answer.point, cost_of(problem, answer.point), 1
    if first.cost <= stop:
        best, cost, solves = descend(program, problem, best, steps=steps)
    return LeapAttempt(
        choice=choice,
        point=best,
        cost=cost,
        first=first.cost,
        solution=first.solution,
        data=problem,
        solves=solves,
        share=share,
    )


def reserved(numbers: LeapNumbers, choice: Index, share: float) -> Scaled:
    """Numbers of chosen contacts, with what plans keep of reach, tilt and friction, and of the
    borders of patches where feet are to stand on them.
    """
    scaled = numbers.scaled.chosen(choice)
    if numbers.leap.robot.own:
        pieces = [_inside(piece, _EDGE_M) for piece in scaled.pieces]
        scaled = replace(scaled, vertices=np.concatenate(pieces))
    return replace(
        scaled,
        reach=scaled.reach - REACH_RESERVE_M,
        tilt=scaled.tilt - TILT_RESERVE_RAD,
        friction=np.maximum(share * scaled.friction, LEAST_FRICTION),
    )


def _inside(border_m: Array, edge_m: float) -> Array:
    """A convex patch drawn in towards its middle until it is so far from its border, or a tenth as
    large, shape (U, 3); a point stays one.
    """
    middle = border_m.mean(axis=0)
    along = np.roll(border_m, -1, axis=0) - border_m
    long = np.linalg.norm(along, axis=1)
    if len(border_m) < 3 or long.min() < 1e-9:
        return border_m
    away = np.linalg.norm(np.cross(middle - border_m, along), axis=1) / long
    return np.asarray(middle + max(1.0 - edge_m / float(away.min()), 0.1) * (border_m - middle))


def descend(
    program: LeapProgram, given: LeapGiven, point: LeapPoint, *, steps: int = _STEPS
) -> tuple[LeapPoint, float, int]:
    """Step from a point until all rows hold or little can be won: the best point, its cost, and the
    convex problems, one more than were solved here.
    """
    best, cost, radius, solves = point, cost_of(given, point), _RADIUS_M, 1
    while cost > HOLDS and solves < steps and radius > _LEAST_RADIUS_M:
        near = nearby(given, best, radius)
        answer = program.solve(near)
        solves += 1
        if answer.point is not None and cost - answer.cost < _STUCK * cost:
            break  # even the step's own rows say that little can be won
        result = np.inf if answer.point is None else cost_of(near, answer.point)
        if answer.point is not None and result < cost:
            best, cost, radius = answer.point, result, min(2.0 * radius, _RADIUS_M)
        else:
            radius *= 0.3
    return best, cost, solves


def nearby(given: LeapGiven, point: LeapPoint, radius: float) -> LeapGiven:
    """The next step's problem: about a point, and not far from it."""
    scaled, goal = given.scaled, given.scaled.com_radius[-1]
    com, radii = point.com.copy(), np.full(len(point.com), 2.0 * radius)
    com[-1], radii[-1], radii[0] = scaled.goal, goal, FREE_M
    moved = replace(scaled, com=com, com_radius=radii)
    return replace(given, scaled=moved, at=point, toe_radius=radius)


def cost_of(given: LeapGiven, point: LeapPoint) -> float:
    """Violation of the bilinear rows at a point, at the price of slack."""
    at = replace(given, at=point)
    change, turn = given.numbers.turned(point)
    moment = np.diff(point.momentum, axis=0) - change
    turned = np.diff(point.rotation[::2], axis=0) - turn
    cost = PRICES["moment"] * float(np.abs(moment).sum()) + PRICES["turn"] * float(
        np.abs(turned).sum()
    )
    for name, over in _overs(at).items():
        cost += PRICES[name] * float(np.maximum(over, 0.0).sum())
    return cost


def _overs(given: LeapGiven) -> dict[str, Array]:
    """Violations of speed, power, length and half-spaces, by group."""
    numbers, point, layout = given.numbers, given.point, given.scaled.layout
    frame, limb, foothold = layout.standing
    hips = numbers.hips[limb]
    hips = hips + cross(point.rotation[frame], hips)
    leg = point.com[frame] + hips - point.toes[foothold]
    length = np.linalg.norm(leg, axis=1)
    ends = np.flatnonzero(frame % 2 == 0)
    spin = point.momentum[frame[ends] // 2] @ numbers.spin.T
    moves = point.velocity[frame[ends] // 2] + cross(spin, hips[ends])
    rate = np.abs(np.sum(moves * leg[ends], axis=1)) / length[ends]
    contact_limbs = np.concatenate([layout.contacts[1]] * 2)
    power = np.abs(np.sum(np.concatenate([point.forces] * 2) * given.hip_velocities, axis=1))
    overs = {
        "speed": rate - SPEED_RESERVE * numbers.speed[limb[ends]],
        "power": power - SPEED_RESERVE * numbers.power[contact_limbs],
        "fold": numbers.fold[limb] + given.reserve_m - length,
    }
    if given.joints is not None:
        overs["joints"] = np.maximum(*given.joints.over(given))
    if layout.reach_rows:
        which, half = layout.standing_rows
        spaces = given.scaled.half_spaces
        normals = spaces.normals[half]
        turned = normals + cross(point.rotation[frame[which]], normals)
        away = (point.toes[foothold] - point.com[frame])[which]
        overs["inside"] = np.sum(turned * away, axis=1) - spaces.bounds[half] + given.reserve_m
    return overs


def plan_of(numbers: LeapNumbers, found: LeapAttempt, method: str) -> LeapPlan:
    """The plan of an attempt, what its body does worked out from its forces."""
    point, leap = found.point, numbers.leap
    assert point is not None
    forces = np.zeros((numbers.intervals, len(leap.robot.limbs), 3))
    forces[numbers.contact_intervals, numbers.layout.contacts[1]] = point.forces * leap.weight_n
    return plan_from(numbers, found.choice, point.toes, forces, method)


def plan_from(
    numbers: LeapNumbers, choice: Index, toes_m: Array, forces_n: Array, method: str
) -> LeapPlan:
    """The plan of toes and forces on chosen patches, what the body does worked out from them.

    Arguments:
        choice: a candidate per foothold, shape (P,).
        toes_m: shape (P, 3).
        forces_n: of every limb in every interval, shape (M, N, 3).
    """
    leap = numbers.leap
    pushes = forces_n[numbers.contact_intervals, numbers.layout.contacts[1]] / leap.weight_n
    com, velocity = numbers.ballistic(numbers.total(pushes))
    still = np.zeros_like(velocity)
    moving = LeapPoint(
        com=com,
        rotation=np.zeros_like(com),
        velocity=velocity,
        momentum=still,
        toes=toes_m,
        forces=pushes,
    )
    change = numbers.turned(moving)[0]
    momentum = numbers.momentum[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(change, axis=0)])
    moving = replace(moving, momentum=momentum)
    turn = numbers.turned(moving)[1]
    rigid = LeapNumbers.of(leap, numbers.timing).turned(moving)[1]
    return LeapPlan(
        problem=leap,
        timing=numbers.timing,
        choice=choice,
        com_m=com[::2],
        velocity_m_s=velocity,
        momentum_m2_s=momentum,
        rotation_rad=numbers.start[1] + np.concatenate([np.zeros((1, 3)), np.cumsum(turn, axis=0)]),
        toes_m=toes_m,
        forces_n=forces_n,
        legs_turn_rad=None if np.array_equal(turn, rigid) else turn - rigid,
        provenance={"method": method},
    )
