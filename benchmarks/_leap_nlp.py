"""A leap with given contacts as one nonlinear program for IPOPT: moments, rotations and powers as
they are.

It shares nothing with the convex steps (``scp``), the cuts and the proofs but the question and what
plans keep in reserve, and is what they are held against.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from stancekit.planners.equilibrium.layout import Index
from stancekit.planners.files.arrays import Array
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import (
    FRICTION_SHARE,
    HEIGHT_RESERVE_M,
    REACH_RESERVE_M,
    TILT_RESERVE_RAD,
)
from stancekit.planners.leap.terms import SPEED_RESERVE
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem.leap import Leap

Ask = Callable[[Any, float, float], None]
RESERVES = (REACH_RESERVE_M, HEIGHT_RESERVE_M, TILT_RESERVE_RAD, SPEED_RESERVE)
"""Kept of reach and height [m] and of tilt [rad]; the share of speed and power that is used."""
SOLVED = 1e-3
"""Largest violation at which a point counts as a leap: m, units of the weight, m²/s over its limit,
rad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NlpPoint:
    """Point at which IPOPT ended.

    Arguments:
        violation: the largest of any row, scaled.
        toes_m: (P, 3) [m].
        forces_n: (M, N, 3) [N].
    """

    violation: float
    toes_m: Array
    forces_n: Array

    @property
    def solved(self) -> bool:
        """Tell whether all rows hold."""
        return self.violation <= SOLVED


class LeapNlp:
    """The program of every leap of one robot, schedule and timing; patches, friction, start and
    goal are parameters.

    The variables are toes, forces in units of the weight, constant in intervals, and the body's
    state at the ends of intervals, which the polynomials of an interval tie together (multiple
    shooting).

    Arguments:
        leap: one of those leaps.
        timing: which of its timings.
        corners: most corners of a patch.
        reserve: keep of friction, reach, height, tilt and speed what plans keep, as instants
            between the program's own are judged, too.
    """

    def __init__(
        self, leap: Leap, timing: int = 0, *, corners: int = 3, reserve: bool = False
    ) -> None:
        self.leap, self.corners = leap, corners
        self._share = FRICTION_SHARE if reserve else 1.0
        self._reach_m, self._height_m, self._tilt_rad, self._speed = (
            RESERVES if reserve else (0.0, 0.0, 0.0, 1.0)
        )
        self.times = leap.times_s(timing)
        self.holds = leap.holds[leap.interval_phases]
        self.contacts = [
            (k, i, int(j)) for k, row in enumerate(self.holds) for i, j in enumerate(row) if j >= 0
        ]
        toes, forces = ca.SX.sym("p", len(leap.footholds), 3), ca.SX.sym("f", len(self.contacts), 3)
        self._patches = ca.SX.sym("patches", len(leap.footholds), 7 + 6 * corners)
        self._ends = ca.SX.sym("ends", 2, 3)
        rows: list[Any] = []
        low: list[float] = []
        high: list[float] = []

        def ask(value: Any, least: float, most: float) -> None:
            flat = ca.vec(value)
            rows.append(flat)
            low.extend([least] * flat.numel())
            high.extend([most] * flat.numel())

        self._toes(toes, ask)
        self._cones(forces, ask)
        states = ca.SX.sym("s", len(self.holds) + 1, 12)
        self._body(toes, forces, states, ask)
        x = ca.vertcat(ca.vec(toes.T), ca.vec(forces.T), ca.vec(states.T))
        p = ca.vertcat(ca.vec(self._patches.T), ca.vec(self._ends.T))
        options: dict[str, Any] = {
            "print_time": False,
            "ipopt": {"print_level": 0, "max_iter": 80, "tol": 1e-6, "sb": "yes"},
        }
        problem = {"x": x, "p": p, "f": 1e-4 * ca.sumsqr(forces), "g": ca.vertcat(*rows)}
        self._solver = ca.nlpsol("leap", "ipopt", problem, options)
        self._violation = ca.Function("violation", [x, p], [_worst(ca.vertcat(*rows), low, high)])
        self._low, self._high = low, high

    def solve(self, leap: Leap, choice: Index, start: tuple[Array, Array, Array]) -> NlpPoint:
        """Solve by IPOPT and return the point where it ends.

        Arguments:
            start: toes (P, 3), forces per contact (B, 3) and states (M + 1, 12) to begin at.
        """
        x0 = np.concatenate([part.ravel() for part in start])
        p = np.concatenate([self._numbers(leap, choice).ravel(), leap.start.com_m, leap.goal.com_m])
        result = self._solver(x0=x0, p=p, lbg=self._low, ubg=self._high)["x"]
        x = np.asarray(result).ravel()
        toes = x[: 3 * len(leap.footholds)].reshape(-1, 3)
        pushes = x[toes.size : toes.size + 3 * len(self.contacts)].reshape(-1, 3)
        forces = np.zeros((*self.holds.shape, 3))
        for (k, i, _), push in zip(self.contacts, pushes, strict=True):
            forces[k, i] = push * leap.weight_n
        return NlpPoint(violation=float(self._violation(result, p)), toes_m=toes, forces_n=forces)

    def nominal(
        self, leap: Leap, choice: Index, numbers: LeapNumbers
    ) -> tuple[Array, Array, Array]:
        """To begin at: toes in the middles of their patches, and the motion of least forces."""
        at = numbers.nominal
        zeros = np.zeros((len(at.velocity), 6))
        return (
            self._middles(leap, choice),
            at.forces,
            np.concatenate([at.com[::2], at.velocity, zeros], axis=1),
        )

    def from_starts(
        self, leap: Leap, choice: Index, starts: int, rng: np.random.Generator
    ) -> NlpPoint:
        """The point of least violation from a straight line and random forces, the first that is
        solved.
        """
        middles = self._middles(leap, choice)
        count = np.bincount([k for k, *_ in self.contacts], minlength=len(self.holds))
        normals = np.array([leap.patch(j, choice).normal for _, _, j in self.contacts])
        share = (1.6 / count[[k for k, *_ in self.contacts]])[:, None]
        best: NlpPoint | None = None
        for number in range(starts):
            noise = 0.0 if number == 0 else 1.0
            forces = share * (
                0.5 * normals + [0.0, 0.0, 0.5] + 0.3 * noise * rng.normal(size=normals.shape)
            )
            toes = middles + 0.01 * noise * rng.normal(size=middles.shape)
            point = self.solve(leap, choice, (toes, forces, self._straight(leap)))
            best = point if best is None or point.violation < best.violation else best
            if best.solved:
                break
        assert best is not None
        return best

    def _numbers(self, leap: Leap, choice: Index) -> Array:
        """The parameters of the chosen patches: normal, middle, friction, and normal and point of
        every edge.
        """
        rows = []
        for j in range(len(leap.footholds)):
            patch, toe = leap.patch(j, choice), leap.footholds[j].toe_m
            vertices = patch.vertices_m
            middle = vertices.mean(axis=0) if toe is None else toe
            edges = []
            for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
                outward = np.cross(b - a, patch.normal)
                outward *= np.sign(outward @ (a - vertices.mean(axis=0))) / np.linalg.norm(outward)
                edges.append(np.concatenate([outward, a if toe is None else toe]))
            edges += edges[-1:] * (self.corners - len(edges))
            rows.append(np.concatenate([patch.normal, middle, [patch.friction], *edges]))
        return np.array(rows)

    def _middles(self, leap: Leap, choice: Index) -> Array:
        return self._numbers(leap, choice)[:, 3:6]

    def _toes(self, toes: Any, ask: Ask) -> None:
        """Every toe in its patch."""
        for j, foothold in enumerate(self.leap.footholds):
            p, row = toes[j, :].T, self._patches[j, :].T
            if foothold.toe_m is not None:
                ask(p - row[3:6], 0.0, 0.0)
                continue
            ask(ca.dot(row[:3], p - row[3:6]), 0.0, 0.0)
            for edge in range(self.corners):
                entries = row[7 + 6 * edge : 13 + 6 * edge]
                ask(ca.dot(entries[:3], p - entries[3:]), -np.inf, 0.0)

    def _cones(self, forces: Any, ask: Ask) -> None:
        """Friction cones, and the largest forces."""
        limits = self.leap.limits
        stands = self.holds >= 0
        for n, (k, i, j) in enumerate(self.contacts):
            row, f = self._patches[j, :].T, forces[n, :].T
            normal, friction = ca.dot(row[:3], f), self._share * row[6]
            lands = k > 0 and not stands[k - 1, i]
            lifts = k + 1 < len(stands) and not stands[k + 1, i]
            ask(normal, 0.0, float(limits.most(lands, lifts)))
            ask(ca.dot(f, f) - (1.0 + friction**2) * normal**2, -np.inf, 0.0)

    def _straight(self, leap: Leap) -> Array:
        """States on the straight line from start to goal, shape (M + 1, 12)."""
        share = (self.times / self.times[-1])[:, None]
        states = np.zeros((len(self.times), 12))
        states[:, :3] = leap.start.com_m + share * (leap.goal.com_m - leap.start.com_m)
        states[:, 3:6] = (leap.goal.com_m - leap.start.com_m) / self.times[-1]
        return states

    def _body(self, toes: Any, forces: Any, states: Any, ask: Ask) -> None:
        """The body's motion, and what limits it, at the ends and the middles of intervals."""
        leap, limits = self.leap, self.leap.limits
        inertia = leap.robot.inertia
        assert inertia is not None
        spin = ca.DM(np.linalg.inv(inertia / leap.robot.mass_kg))
        names = ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad")
        unit = limits.momentum_m2_s
        scales = (1.0, 1.0, 1.0 / unit, 1.0)

        def state_at(k: int) -> list[Any]:
            """c, v, L and Θ at the end of an interval; L is a variable in units of its limit."""
            row = states[k, :].T
            return [row[3 * q : 3 * q + 3] / scales[q] for q in range(4)]

        others = [
            s * ca.DM(getattr(leap.start, name)) for s, name in zip(scales, names, strict=True)
        ][1:]
        first = ca.vertcat(self._ends[0, :].T, *others)
        ask(states[0, :].T - first, 0.0, 0.0)
        c, v, spun, turn = state_at(0)
        for k in range(len(self.holds)):
            dt = float(self.times[k + 1] - self.times[k])
            contacts = [(n, i, j) for n, (q, i, j) in enumerate(self.contacts) if q == k]
            total, twist = ca.SX.zeros(3), ca.SX.zeros(3)
            for n, _, j in contacts:
                f = forces[n, :].T
                total += GRAVITY_M_S2 * f
                twist += GRAVITY_M_S2 * ca.cross(toes[j, :].T, f)
            a = total - ca.DM([0.0, 0.0, GRAVITY_M_S2])
            at = partial(_after, c, v, spun, turn, total, twist, spin)
            still = (k == 0 and leap.still[0]) or (k == len(self.holds) - 1 and leap.still[1])
            if still:
                ask(a, 0.0, 0.0)
                for rest in (spun, at(dt)[2]):
                    ask(rest / unit, -1e-4, 1e-4)
            for t in (0.0, 0.5 * dt, dt):
                com, speed, momentum, angle = at(t)
                tilt = limits.tilt_rad - self._tilt_rad
                ask(angle, -tilt, tilt)
                for n, i, j in contacts:
                    if t == 0.0 and k > 0 and self.holds[k - 1, i] == j:
                        continue  # the end of the interval before asked
                    self._leg(
                        toes[j, :].T, com, speed, momentum, angle, forces[n, :].T, i, spin, ask
                    )
            after = ca.vertcat(*(s * part for s, part in zip(scales, at(dt), strict=True)))
            ask(states[k + 1, :].T - after, 0.0, 0.0)
            c, v, spun, turn = state_at(k + 1)
            ask(spun / unit, -1.0, 1.0)
        ask(ca.sumsqr(c - self._ends[1, :].T), -np.inf, leap.goal_radius_m**2)
        ask(v - ca.DM(leap.goal.velocity_m_s), 0.0, 0.0)
        ask((spun - ca.DM(leap.goal.momentum_m2_s)) / unit, 0.0, 0.0)
        ask(turn, -limits.goal_tilt_rad, limits.goal_tilt_rad)

    def _leg(
        self,
        p: Any,
        com: Any,
        speed: Any,
        momentum: Any,
        angle: Any,
        force: Any,
        i: int,
        spin: Any,
        ask: Ask,
    ) -> None:
        """Reach, height, length, speed and power of a leg at one instant, by the rotation I + [Θ]×
        + ½ [Θ]×².
        """
        leap, limb = self.leap, self.leap.robot.limbs[i]
        leg = leap.leg(limb)
        cross = ca.skew(angle)
        turn = ca.SX.eye(3) + cross + 0.5 * cross @ cross
        away = p - com - turn @ ca.DM(limb.shoulder_m)
        ask(ca.sumsqr(away), -np.inf, (limb.reach_m - self._reach_m) ** 2)
        if limb.reach_rows is not None:
            local = turn.T @ (p - com)
            ask(
                ca.DM(limb.reach_rows.normals) @ local - ca.DM(limb.reach_rows.bounds_m),
                -np.inf,
                -self._height_m,
            )
        ask(com[2] - p[2], leap.limits.height_m + self._height_m, np.inf)
        arm = turn @ ca.DM(leg.hip_m)
        hip = com + arm - p
        ask(ca.sumsqr(hip), (leg.fold_m + self._height_m) ** 2, np.inf)
        moves = speed + ca.cross(spin @ momentum, arm)
        if np.isfinite(leg.speed_m_s):
            rate = ca.dot(hip, moves) / ca.sqrt(ca.sumsqr(hip) + 1e-9)
            speed_m_s = self._speed * leg.speed_m_s
            ask(rate, -speed_m_s, speed_m_s)
        if np.isfinite(leg.power_w):
            most = self._speed * leg.power_w / leap.weight_n
            ask(ca.dot(force, moves), -most, most)


def _worst(rows: Any, low: list[float], high: list[float]) -> Any:
    """The largest violation of any row."""
    return ca.mmax(ca.fmax(rows - ca.DM(high), ca.DM(low) - rows))


def _after(
    c: Any, v: Any, spun: Any, turn: Any, total: Any, twist: Any, spin: Any, t: float
) -> tuple[Any, ...]:
    """c, v, L and Θ after t seconds of an interval of constant forces, as polynomials.

    ∫ c = c t + v t²/2 + a t³/6; L = L₀ + t Σ p × f − ∫ c × F; and once more for Θ.
    """
    a = total - ca.DM([0.0, 0.0, GRAVITY_M_S2])
    once = c * t + v * t**2 / 2 + a * t**3 / 6
    twice = c * t**2 / 2 + v * t**3 / 6 + a * t**4 / 24
    momentum = spun + t * twist - ca.cross(once, total)
    angle = turn + spin @ (spun * t + twist * t**2 / 2 - ca.cross(twice, total))
    return c + v * t + a * t**2 / 2, v + a * t, momentum, angle
