"""Margins of stances between a lower and an upper bound that hold whatever converged, for arrays.

With points and body held, the contacts of a stance balance a set of shifts t in the plane, the
shadow of the forces f within their cones and bounds:

    P = {t : B f + S t = b},   |f_t| ≤ μ f_n,  low ≤ f_n ≤ high

b is what the forces have to sum to, with their moment about the centre of mass; forces are in units
of the weight. t is a place of the centre of mass [m], or a push in units of the weight under which
the body gives way. The margin is the distance of t = 0 from the border of P, negative outside. Four
of the six rows are E f = e, the other two give t = V (b − B f). Every w = (y, d) bounds P in the
direction d from outside, with the farthest force that each contact has along g = −(E, V B)' w:

    d t ≤ φ(w) = w (e, V b) + Σ max {g f : |f_t| ≤ μ f_n, low ≤ f_n ≤ high}

1. Ends of P in a direction d are found by primal-dual steps with the cones' own scaling (Nesterov
   and Todd). Forces stay inside of their cones and bounds, and balance to rounding: each is a point
   of P, and each y a bound.
2. Without a direction the steps come to the middle, from which all start, or to a y with φ < 0,
   which proves that P is empty.
3. A closed line through ends of P that winds about 0 at a distance holds a disc of that radius; one
   that does not bounds the distance to P. The next direction faces the line's nearest part.

The loops are written for one stance, in numbers; numba compiles them where many are asked.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, cross, lengths
from ..files.documents import shown
from ..files.writing import cache_folder
from ..plugins import foreign

MANY, MOST, STEPS, HALVINGS = 400, 32, 60, 5
"""Stances from which on the loops are compiled, where numba is installed: half a second with what was
compiled before, ten without, as long as 300 and 5000 take in Python; most directions that are
tried; most steps to an end or a proof; halvings of the interval in which the least share of the
friction is sought."""
AIM, DOWN, EDGE, BEGIN, STALLED = 0.3, 0.1, 0.98, 0.05, 1e-4
"""Part of the tolerance to which an end is sought; part of the complementarity that a whole step
leaves; part of the way to the border of the cones that a step goes; complementarity from which an end
is sought, where the middle's is 1; gap with which an end is taken where steps go no further."""
BALANCED, UNIT, SAME, ROOM, TINY = 1e-8, 1e-6, 1e-7, 1e-9, 1e-12
"""Forces that miss their balance by more are not used, in units of the weight, or of the largest
force if that is more, and metres; a normal's length may differ from 1 by ``UNIT``; lengths and shares
that are none; a force whose bounds are one has this much room, so that there is an inside."""
SLIPLESS, FAR = 10.0, 50.0
"""Largest friction, and farthest point [m], for which margins are computed."""


def _along(A: Any, b: int, w: Any, first: int, last: int) -> tuple[float, float, float]:
    """−A' w of a contact, by some of its rows."""
    g0, g1, g2 = 0.0, 0.0, 0.0
    for a in range(first, last):
        g0, g1, g2 = g0 - A[b][a][0] * w[a], g1 - A[b][a][1] * w[a], g2 - A[b][a][2] * w[a]
    return g0, g1, g2


def _bound(A: Any, bounds: Any, e: Any, w: Any) -> float:
    """φ(w), which bounds P from outside by any w."""
    up = 0.0
    for a in range(6):
        up += e[a] * w[a]
    for b in range(len(A)):
        g0, g1, g2 = _along(A, b, w, 0, 6)
        z = g0 + math.sqrt(g1 * g1 + g2 * g2)
        up += max(z * bounds[b][0], z * bounds[b][1])
    return up


def _inner(x: Any, y: Any) -> float:
    """x' J y = x0 y0 − x1 y1 − x2 y2."""
    return float(x[0] * y[0] - x[1] * y[1] - x[2] * y[2])


def _beyond(x: Any, d: Any) -> float:
    """1 over the part of the way d that leads from x to the border of the cone."""
    q, b, a = _inner(x, x), -_inner(x, d), _inner(d, d)
    return (b + math.sqrt(abs(b * b - a * q))) / q


def _times(scale: Any, h0: float, h1: float, h2: float) -> tuple[float, float, float]:
    """(H⁻¹ + D e e')⁻¹ h of a contact, H = k z z' − r J its scaling, D that of its bounds."""
    r, k, kappa, z0, z1, z2 = scale
    along = z0 * h0 + z1 * h1 + z2 * h2
    back = kappa * (k * z0 * along - r * h0)
    part = k * (along - back * z0)
    return z0 * part + r * (back - h0), z1 * part + r * h1, z2 * part + r * h2


def _step(A: Any, bounds: Any, w: Any, goal: float, balance: Any, room: Any) -> tuple[float, float]:
    """A step to the complementarity ``goal``: the parts of it that forces and multipliers may go.

    Of a contact, X has its force, the multipliers s of its cone, and those of its upper and lower
    bound; dX has their changes. What the balance lacks, ``off``, becomes its multipliers y.
    """
    (X, dX, y, M, K), rows = room, len(balance)
    for a in range(rows):
        y[a] = -y[a]
        for c in range(rows):
            M[a][c] = 0.0
    for b in range(len(A)):
        f, s = (X[b][0], X[b][1], X[b][2]), (X[b][3], X[b][4], X[b][5])
        up, down = 1.0 / (bounds[b][1] - f[0]), 1.0 / (f[0] - bounds[b][0])
        q, p = _inner(f, f), _inner(s, s)
        r, D, part = math.sqrt(q / p), X[b][6] * up + X[b][7] * down, goal / q
        k = 1.0 / (r * p + f[0] * s[0] + f[1] * s[1] + f[2] * s[2])
        z0, z1, z2 = f[0] + r * s[0], f[1] - r * s[1], f[2] - r * s[2]
        scale = (r, k, D / (1.0 + D * (k * z0 * z0 - r)), z0, z1, z2)
        h0, h1, h2 = _along(A, b, w, rows, 6)
        h0, h1, h2 = h0 + part * f[0] - goal * (up - down), h1 - part * f[1], h2 - part * f[2]
        K[b][0], K[b][1], K[b][2], K[b][3], K[b][4], K[b][5] = scale
        K[b][6], K[b][7], K[b][8] = h0, h1, h2
        u0, u1, u2 = _times(scale, h0, h1, h2)
        for a in range(rows):
            x0, x1, x2 = A[b][a][0], A[b][a][1], A[b][a][2]
            y[a] += x0 * u0 + x1 * u1 + x2 * u2
            v0, v1, v2 = _times(scale, x0, x1, x2)
            for c in range(a + 1):
                M[a][c] += v0 * A[b][c][0] + v1 * A[b][c][1] + v2 * A[b][c][2]
    slack = TINY * TINY
    for a in range(rows):
        slack += TINY * TINY * M[a][a]
    for a in range(rows):
        M[a][a] += slack
        for c in range(a + 1, rows):
            part = M[c][a] / M[a][a]
            y[c] -= part * y[a]
            for j in range(c, rows):
                M[j][c] -= part * M[j][a]
    for a in range(rows - 1, -1, -1):
        for c in range(a + 1, rows):
            y[a] -= M[c][a] * y[c]
        y[a] /= M[a][a]
    far, wide = EDGE, EDGE
    for b in range(len(A)):
        f, s = (X[b][0], X[b][1], X[b][2]), (X[b][3], X[b][4], X[b][5])
        v, u, part = X[b][6], X[b][7], goal / _inner(f, f)
        up, down = 1.0 / (bounds[b][1] - f[0]), 1.0 / (f[0] - bounds[b][0])
        h0, h1, h2 = _along(A, b, y, 0, rows)
        h0, h1, h2 = h0 + K[b][6], h1 + K[b][7], h2 + K[b][8]
        scale = (K[b][0], K[b][1], K[b][2], K[b][3], K[b][4], K[b][5])
        d = _times(scale, h0, h1, h2)
        t0 = part * f[0] - h0 + (v * up + u * down) * d[0] - s[0]
        t = (t0, -part * f[1] - h1 - s[1], -part * f[2] - h2 - s[2])
        dv, du = (goal + v * d[0]) * up - v, (goal - u * d[0]) * down - u
        dX[b][0], dX[b][1], dX[b][2], dX[b][3], dX[b][4], dX[b][5] = *d, *t
        dX[b][6], dX[b][7] = dv, du
        far = max(far, _beyond(f, d), d[0] * up, -d[0] * down)
        wide = max(wide, _beyond(s, t), -dv / v, -du / u)
    return EDGE / far, EDGE / wide


def _end(A: Any, bounds: Any, e: Any, w: Any, last: float, balance: Any, room: Any) -> int:
    """Seek the end in the direction that w has, or the middle, to a gap: 1 where it is found, −1
    where it is proved that no forces balance, 0 where neither was found.

    Arguments:
        last: the gap; 0 for the middle.
    """
    (X, dX, off, _, _), rows = room, len(balance)
    goal, short = (BEGIN if last > 0.0 else 1.0), 1.0
    for _ in range(STEPS):
        worst, gap, size, most = 0.0, 0.0, 0.0, BALANCED
        for a in range(6):
            off[a] = e[a]
        for b in range(len(A)):
            f, s = (X[b][0], X[b][1], X[b][2]), (X[b][3], X[b][4], X[b][5])
            up, down, most = bounds[b][1] - f[0], f[0] - bounds[b][0], max(most, BALANCED * f[0])
            if not min(_inner(f, f), _inner(s, s), up, down) > 0.0:
                return 0
            gap += f[0] * s[0] + f[1] * s[1] + f[2] * s[2] + X[b][6] * up + X[b][7] * down
            for a in range(6):
                off[a] -= A[b][a][0] * f[0] + A[b][a][1] * f[1] + A[b][a][2] * f[2]
        for a in range(rows):
            worst, size = max(worst, abs(off[a])), size + abs(w[a])
        wanted = last if short < 0.9 else max(last, STALLED)
        if worst < most and (last == 0.0 or gap <= 1.05 * wanted):
            return 1
        if last == 0.0 and _bound(A, bounds, e, w) < -SAME * size:
            return -1
        if last > 0.0 and short < 1.0:
            goal = max((DOWN + short) * gap, last) / (3.0 * len(A))
        far, wide = _step(A, bounds, w, goal, balance, room)
        for b in range(len(A)):
            for j in range(3):
                X[b][j] += far * dX[b][j]
            for j in range(3, 8):
                X[b][j] += wide * dX[b][j]
        for a in range(rows):
            w[a] += wide * (off[a] - w[a])
        short = 1.0 - min(far, wide)
    return 1 if worst < most else 0


def _nearest(P: Any, order: Any, count: int) -> tuple[float, float, int, int, float]:
    """The distance of 0 from the closed line through the points P, positive where it winds about 0;
    the direction to look in next [rad]; and the two ends between which it is nearest, and where.
    """
    best, turns, gx, gy, nx, ny, part, first, second = math.inf, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0
    for r in range(count):
        one, two = order[r], order[(r + 1) % count]
        x, y, u, v = P[one][0], P[one][1], P[two][0], P[two][1]
        ax, ay, across = u - x, v - y, x * v - y * u
        t = min(max(-(x * ax + y * ay) / (ax * ax + ay * ay + TINY * TINY), 0.0), 1.0)
        far = (x + t * ax) ** 2 + (y + t * ay) ** 2
        if far < best:
            best, part, first, second = far, t, one, two
            gx, gy, nx, ny = x + t * ax, y + t * ay, ay, -ax
        if (y <= 0.0) != (v <= 0.0) and (v > y) == (across > 0.0):
            turns += 1 if across > 0.0 else -1
    size, sign = math.sqrt(best), 1.0 if turns != 0 else -1.0
    if size > SAME:
        nx, ny = sign * gx, sign * gy
    return sign * size, math.atan2(ny, nx) % (2.0 * math.pi), first, second, part


def _stance(
    A: Any, bounds: Any, e: Any, asked: Any, balance: Any, room: Any, ends: Any, w: Any, out: Any
) -> tuple[float, float, int]:
    """The bounds of one stance, and how many ends there are.

    Arguments:
        A, e: E over V B, and e before V b, of forces along axes, the normal one times μ.
        bounds: of these normal forces.
        asked: tolerance, closeness as a share of the margin, a margin that need only be compared,
            and directions that are tried first.
        balance: rows of the balance, a tuple, so that compiled loops know how many: four, or six,
            V B among them, where it is told alone whether forces balance, by a lower bound of 0.
        room: space of ``_step``.
        ends: space for the middle, forces and points of ends, their order, and their directions
            [rad].
        w: space for multipliers.
        out: multipliers of the upper bound, and forces at the border's nearest point.
    """
    X, (middle, E, P, order, turn), (multiplier, forces) = room[0], ends, out
    lower, upper, count, one, two, part = -math.inf, math.inf, 0, 0, 0, 0.0
    for a in range(6):
        w[a] = multiplier[a] = 0.0
    for b in range(len(A)):
        x, half = X[b], 0.5 * (bounds[b][1] - bounds[b][0])
        x[0], x[1], x[2] = bounds[b][0] + min(bounds[b][1] / len(A), half), 0.0, 0.0
        x[3], x[4], x[5] = 1.0 / x[0], 0.0, 0.0
        x[6], x[7] = 1.0 / (bounds[b][1] - x[0]), 1.0 / (x[0] - bounds[b][0])
    stands = _end(A, bounds, e, w, 0.0, balance, room)
    if stands < 1 or len(balance) == 6:
        for a in range(6):
            multiplier[a] = w[a]
        return (0.0 if stands == 1 else lower), (lower if stands == -1 else upper), count
    for b in range(len(A)):
        for j in range(8):
            middle[b][j] = X[b][j] * (1.0 if j < 3 else BEGIN)
    while True:
        if count > 0:
            lower, angle, one, two, part = _nearest(P, order, count)
        near = upper - lower <= asked[0] + asked[1] * abs(upper)
        if lower >= asked[2] or (count >= asked[3] and (near or count == len(turn))):
            break
        if count < asked[3]:
            angle = 2.0 * math.pi * (count + 0.5) / asked[3]
        w[4], w[5] = math.cos(angle), math.sin(angle)
        for b in range(len(A)):
            for j in range(8):
                X[b][j] = middle[b][j]
        if upper < asked[2] or _end(A, bounds, e, w, AIM * asked[0], balance, room) < 1:
            break
        up = _bound(A, bounds, e, w)
        if up < upper:
            upper = up
            for a in range(6):
                multiplier[a] = w[a]
        for b in range(len(A)):
            for j in range(3):
                E[count][b][j] = X[b][j]
        P[count][0], P[count][1], turn[count], place = room[2][4], room[2][5], angle, count
        while place > 0 and turn[order[place - 1]] > angle:
            order[place] = order[place - 1]
            place -= 1
        order[place] = count
        count += 1
    for b in range(len(A)):
        for j in range(3):
            forces[b][j] = (1.0 - part) * E[one][b][j] + part * E[two][b][j]
    return lower, upper, count


def _arrange(contacts: Any, balanced: Any, space: Any) -> None:
    """Write A, the bounds and e of a stance, the rows E and V, and the directions of its forces
    (``_stance``).

    V inverts two rows of S, E are the four others less what V has of them. Directions across a
    normal: Duff et al., "Building an orthonormal basis, revisited".

    Arguments:
        contacts: arm, normal, friction and bounds of each.
        balanced: b and S.
        space: zeros where nothing was written.
    """
    (A, bounds, e, rows, axes), S = space, balanced
    i = 0 if S[0][1] != 0.0 else 3
    j, size = i + 1, S[i][1] * S[i + 1][2] - S[i][2] * S[i + 1][1]
    rows[4][i], rows[4][j] = S[j][2] / size, -S[i][2] / size
    rows[5][i], rows[5][j] = -S[j][1] / size, S[i][1] / size
    for row, a in enumerate((2, 3, 4, 5) if i == 0 else (0, 1, 2, 5)):
        for c in range(6):
            rows[row][c] = (1.0 if a == c else 0.0) - S[a][1] * rows[4][c] - S[a][2] * rows[5][c]
    for a in range(6):
        e[a] = (
            rows[a][0] * S[0][0]
            + rows[a][1] * S[1][0]
            + rows[a][2] * S[2][0]
            + rows[a][3] * S[3][0]
            + rows[a][4] * S[4][0]
            + rows[a][5] * S[5][0]
        )
    for b in range(len(contacts)):
        p, q, r, friction = contacts[b][0], contacts[b][1], contacts[b][2], contacts[b][6]
        x, y, z = contacts[b][3], contacts[b][4], contacts[b][5]
        s = 1.0 if z >= 0.0 else -1.0
        t = -1.0 / (s + z)
        directions = (
            (x / friction, y / friction, z / friction),
            (1.0 + s * x * x * t, s * x * y * t, -s * x),
            (x * y * t, s + y * y * t, -y),
        )
        bounds[b][0] = friction * contacts[b][7]
        bounds[b][1] = max(friction * contacts[b][8], bounds[b][0] + ROOM)
        for k, (x, y, z) in enumerate(directions):
            axes[b][k][0], axes[b][k][1], axes[b][k][2] = x, y, z
            u, v, w = q * z - r * y, r * x - p * z, p * y - q * x
            for a in range(6):
                A[b][a][k] = (
                    rows[a][0] * x
                    + rows[a][1] * y
                    + rows[a][2] * z
                    + rows[a][3] * u
                    + rows[a][4] * v
                    + rows[a][5] * w
                )


def _stances(
    contacts: Any, balanced: Any, which: Any, asked: Any, balance: Any, spaces: Any, found: Any
) -> None:
    """The bounds of stances, one after the other.

    Arguments:
        contacts, balanced: as of ``_arrange``, of all.
        which: number of contacts of each, the first behind them, and the stances that are asked.
        found: bounds, multipliers, forces, and ends in turn.
    """
    (space, room, ends, own), (A, bounds, e, rows, axes) = spaces, spaces[0]
    (counts, behind, asking), (lower, upper, multiplier, forces, points) = which, found
    for i in asking:
        n, last = counts[i], behind[i]
        part, out = contacts[last - n : last], forces[last - n : last]
        _arrange(part, balanced[i], space)
        lower[i], upper[i], count = _stance(
            A[:n], bounds[:n], e, asked, balance, room, ends, own[1], (own[0], out)
        )
        for k in range(count):
            points[i][k][0], points[i][k][1] = ends[2][ends[3][k]][0], ends[2][ends[3][k]][1]
        for c in range(6):
            for a in range(6):
                multiplier[i][c] += own[0][a] * rows[a][c]
        for b in range(n):
            x, y, z = out[b][0], out[b][1], out[b][2]
            for c in range(3):
                out[b][c] = axes[b][0][c] * x + axes[b][1][c] * y + axes[b][2][c] * z


@cache
def compiled() -> Any:
    """``_stances`` in machine code, kept in the user's folder for caches; None without numba."""
    try:
        import numba.extending
    except ImportError:
        return None
    for part in (_along, _bound, _inner, _beyond, _times, _step, _end, _nearest, _stance, _arrange):
        numba.extending.register_jitable(error_model="numpy")(part)
    folder, before, own = cache_folder() / "numba", numba.config.CACHE_DIR, False
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        own = folder.stat().st_uid == os.getuid() and os.access(folder, os.W_OK)
    try:
        numba.config.CACHE_DIR = str(folder)
        return numba.njit(cache=own, error_model="numpy")(_stances)
    finally:
        numba.config.CACHE_DIR = before


def places(borne: Array) -> Array:
    """Change of the wrench per shift of the centre of mass: a shift t takes t × b from the moments,
    where b is the sum of the forces; shape (N, 6, 2).

    Arguments:
        borne: b and its moment about the centre of mass in units of the weight, shape (N, 6).
    """
    shifts = np.zeros((len(borne), 6, 2))
    shifts[:, 3, 1], shifts[:, 4, 0] = -borne[:, 2], borne[:, 2]
    shifts[:, 5, 0], shifts[:, 5, 1] = -borne[:, 1], borne[:, 0]
    return shifts


def pushes(borne: Array, yields_m: float = 0.0) -> Array:
    """Pushes, in units of the weight, under which the body gives way by this under one as large as
    its weight [m]; shape (N, 6, 2).
    """
    return np.eye(6, 2) + yields_m * places(borne)


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins:
    """Bounds of the margins of N stances with C contacts in all, in metres or in units of the
    weight.

    Arguments:
        lower, upper: shape (N,); the margin lies between them, negative where the stance does not
            hold. Both are −inf where it is proved that no forces balance, −inf and inf where nothing
            is known.
        direction: in which the stance ends first, shape (N, 2).
        forces: at the point of the border that is nearest, in the world, in units of the weight,
            shape (C, 3) or (N, n, 3), as the contacts were given.
        multiplier: multipliers of the force and moment balance: the certificate of ``upper``, shape
            (N, 6).
        ends: points of the set of shifts, in turn, shape (N, K, 2), nan behind the last.
        stances: the stances, in their order.
    """

    lower: Array
    upper: Array
    direction: Array
    forces: Array
    multiplier: Array
    ends: Array
    stances: Stances

    def gradient(self) -> tuple[Array, Array, Array, Array]:
        """Slopes of the margins with respect to the contacts' points, normals and friction and the
        centre of mass, as these were given; 0 where the margin is not known.

        At the border's nearest point the forces are those of a program whose multipliers are
        known, and its optimum changes by what its rows change (the envelope theorem).
        """
        at, shape = self.stances, self.forces.shape
        of = np.repeat(np.arange(len(at.counts)), at.counts)
        known = np.isfinite(self.upper - self.lower)[of, None]
        forces = np.where(known, self.forces.reshape(-1, 3), 0.0)
        push, turn = self.multiplier[of, :3], self.multiplier[of, 3:]
        points, u = cross(turn, forces), push + cross(turn, at.arms_m)
        press, lift = (forces * at.normals).sum(axis=1), (u * at.normals).sum(axis=1)
        slide = np.linalg.norm(u - at.normals * lift[:, None], axis=1)
        normals = forces * lift[:, None] - u * press[:, None]
        com = -np.add.reduceat(points, np.cumsum(at.counts) - at.counts)
        return (
            points.reshape(shape),
            normals.reshape(shape),
            (press * slide).reshape(shape[:-1]),
            com,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Stances:
    """N stances with C contacts in all, one stance's after the other's; forces are in units of the
    weight.

    Arguments:
        arms_m: from the centre of mass to the contacts, shape (C, 3) [m].
        normals: of length 1, shape (C, 3).
        friction: above 0, shape (C,).
        low, high: bounds of the normal forces, shape (C,).
        counts: contacts of each stance, shape (N,).
        borne: as of ``places``.
    """

    arms_m: Array
    normals: Array
    friction: Array
    low: Array
    high: Array
    counts: Any
    borne: Array

    @classmethod
    def together(cls, every: Sequence[Stances]) -> Stances:
        """Those of several, one after the other's."""
        names = cls.__dataclass_fields__
        return cls(**{name: np.concatenate([vars(one)[name] for one in every]) for name in names})

    def margins(
        self,
        shifts: Array,
        *,
        tolerance: float = 1e-4,
        close: float = 0.02,
        decide: float = math.nan,
        which: NDArray[np.bool_] | None = None,
        first: int = 3,
    ) -> Margins:
        """Bounds of the margins.

        Arguments:
            shifts: of ``places`` or ``pushes``, what a unit of each adds to the balances, shape (N,
                6, 2).
            tolerance, close: a stance is done when its bounds are this close to each other, plus
                this share of the margin.
            decide: a margin with which it need only be compared.
            which: the stances that are asked, shape (N,); of the others nothing is known.
            first: directions that are tried in any case.
        """
        return self._solved(shifts, (0, 1, 2, 3), (tolerance, close, decide, first), which)

    def hold(self) -> Array:
        """Tell of which stances forces balance, shape (N,)."""
        found = self._solved(pushes(self.borne), (0, 1, 2, 3, 4, 5), (0.0, 0.0, 0.0, 0.0))
        return np.asarray(found.lower == 0.0)

    def friction_left(self) -> Array:
        """The largest share of the friction without which forces still balance, from below, shape
        (N,).
        """
        most, little = np.ones(len(self.counts)), np.zeros(len(self.counts))
        for _ in range(HALVINGS):
            middle = 0.5 * (most + little)
            held = replace(self, friction=np.repeat(middle, self.counts) * self.friction).hold()
            most, little = np.where(held, middle, most), np.where(held, little, middle)
        return 1.0 - most

    def _solved(
        self,
        shifts: Array,
        balance: tuple[int, ...],
        asked: Sequence[float],
        which: NDArray[np.bool_] | None = None,
    ) -> Margins:
        """The bounds, with so many rows of the balance (``_stance``)."""
        rest = [each[:, None] for each in (self.friction, self.low, self.high)]
        N, n, most = len(self.counts), int(self.counts.max()), max(int(asked[3]), MOST)
        asking = np.arange(N) if which is None else np.flatnonzero(which)
        spaces = (
            ((n, 6, 3), (n, 2), (6,), (6, 6), (n, 3, 3)),
            ((n, 8), (n, 8), (6,), (6, 6), (n, 9)),
            ((n, 8), (most, n, 3), (most, 2)),
            ((6,), (6,)),
        )
        space, room, ends, own = (tuple(map(np.zeros, shapes)) for shapes in spaces)
        given = (
            np.concatenate([self.arms_m, self.normals, *rest], axis=1),
            np.concatenate([self.borne[:, :, None], shifts], axis=2),
            (self.counts, self.counts.cumsum(), asking),
            np.array(asked),
            balance,
            (space, room, (*ends, np.zeros(most, dtype=np.int64), np.zeros(most)), own),
            (
                np.full(N, -math.inf),
                np.full(N, math.inf),
                np.zeros((N, 6)),
                np.zeros(self.arms_m.shape),
                np.full((N, most, 2), math.nan),
            ),
        )
        fast = compiled() if len(asking) > MANY or compiled.cache_info().currsize else None
        if fast is None:
            given = _lists(given)
        (fast or _stances)(*given)
        lower, upper, multiplier, forces, points = map(np.asarray, given[-1])
        return Margins(
            lower=lower,
            upper=upper,
            direction=(multiplier[:, None] @ shifts)[:, 0],
            forces=forces,
            multiplier=multiplier,
            ends=points,
            stances=self,
        )


def stances_from(
    contacts_m: Array,
    normals: Array,
    friction: Array | float,
    com_m: Array,
    low: Array | float,
    high: Array | float,
    wrench: Array | float,
) -> Stances:
    """N stances of n contacts each, as ``stancekit.margins`` takes them.

    Raises InvalidInput that names the first row of what cannot be.
    """
    plain = contacts_m if isinstance(contacts_m, np.ndarray) else np.array(contacts_m, dtype=object)
    if plain.ndim != 3 or 0 in plain.shape or plain.shape[2] != 3:
        raise InvalidInput(
            "subject: expected a plan, an answer with one, a Problem, or points that bear, shape "
            f"(N, n, 3), got {plain.shape or shown(contacts_m)}"
        )
    given = {
        "subject": (contacts_m, plain.shape),
        "normals": (normals, plain.shape),
        "friction": (friction, plain.shape[:2]),
        "low": (low, plain.shape[:2]),
        "high": (high, plain.shape[:2]),
        "com_m": (com_m, (plain.shape[0], 3)),
        "wrench": (wrench, (plain.shape[0], 6)),
    }
    known = dict[str, Array]()
    for name, (value, wanted) in given.items():
        with foreign(f"{name}: expected numbers of shape {wanted}, got"):
            known[name] = np.broadcast_to(np.asarray(value, dtype=float), wanted)
    within = (known["friction"] > 0.0) & (known["friction"] <= SLIPLESS)
    reach = lengths(known["subject"] - known["com_m"][:, None])
    wrong = [(name, "finite numbers", ~np.isfinite(value)) for name, value in known.items()]
    wrong += [
        ("normals", "length 1", np.abs(lengths(known["normals"]) - 1.0) > UNIT),
        ("friction", f"numbers above 0, up to {SLIPLESS:g}", ~within),
        ("subject", f"points within {FAR:g} m of the centre of mass, in metres", reach > FAR),
        ("low", "0 or more", known["low"] < 0.0),
        ("high", "more than low", known["high"] <= known["low"]),
        ("wrench", "less lift than the weight", known["wrench"][:, 2] >= 1.0),
    ]
    for name, must, bad in wrong:
        if bad.any():
            row = np.argmax(bad.reshape(len(plain), -1).any(axis=1))
            raise InvalidInput(f"{name}[{row}]: expected {must}, got {known[name][row].tolist()}")
    return Stances(
        arms_m=(known["subject"] - known["com_m"][:, None]).reshape(-1, 3),
        normals=known["normals"].reshape(-1, 3),
        **{name: known[name].ravel() for name in ("friction", "low", "high")},
        counts=np.full(len(plain), plain.shape[1]),
        borne=np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) - known["wrench"],
    )


def _lists(given: Any) -> Any:
    """The same in lists, which are quicker one number at a time."""
    if isinstance(given, tuple):
        return tuple(_lists(each) for each in given)
    return given.tolist() if isinstance(given, np.ndarray) else given
