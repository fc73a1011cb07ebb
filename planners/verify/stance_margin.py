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

1. The maxima are smoothed by barriers of weight m within the cones and bounds, so that they are
   closed forms. Newton's method finds the y at which φ is least, while m falls to the gap that is
   wanted. There its slope e − E f is 0: the forces balance to rounding, inside of their cones, and
   are those of an end of P in the direction d.
2. Without a direction y is the middle from which all start, and φ < 0 proves that P is empty.
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
from ..files.arrays import Array, cross
from ..files.documents import shown
from ..files.writing import cache_folder
from ..plugins import foreign

MANY, MOST, STEPS, HALVINGS = 40, 32, 300, 5
"""Stances from which on the loops are compiled, where numba is installed; most directions that are
tried; most steps of Newton's method to an end or a proof; halvings of the interval in which the least
share of the friction is sought."""
AIM, FAR, NEAR, DOWN = 0.2, 1.5, 1.0, 0.1
"""Part of the tolerance to which an end is sought. A step changes the smoothed slopes of no contact
by more than 1 / ``FAR`` of what would turn them; after one that need not be cut by more than ``NEAR``
the barrier falls to the part ``DOWN``."""
BALANCED, UNIT, SAME, TINY = 1e-9, 1e-6, 1e-7, 1e-12
"""Forces that miss their balance by more are not used, in units of the weight and metres; a normal's
length may differ from 1 by ``UNIT``; lengths and shares that are none."""


def _along(A: Any, w: Any, rows: int) -> tuple[float, float, float]:
    """g = −A' w of a contact, by its first rows."""
    g0, g1, g2 = 0.0, 0.0, 0.0
    for a in range(rows):
        g0, g1, g2 = g0 - A[a][0] * w[a], g1 - A[a][1] * w[a], g2 - A[a][2] * w[a]
    return g0, g1, g2


def _bound(A: Any, bounds: Any, e: Any, w: Any) -> float:
    """φ(w), which bounds P from outside by any w."""
    up = 0.0
    for a in range(6):
        up += e[a] * w[a]
    for b in range(len(A)):
        g0, g1, g2 = _along(A[b], w, 6)
        z = g0 + math.sqrt(g1 * g1 + g2 * g2)
        up += max(z * bounds[b][0], z * bounds[b][1])
    return up


def _step(A: Any, bounds: Any, e: Any, w: Any, m: float, room: Any) -> float:
    """Newton's step of y, and by how much more than a contact's slope turns it would change that.

    Of a contact, u = f_t / f_0 and f_0 are where u g_t + m log(1 − u²) is largest, χ, and then
    z f_0 + m log(high − f_0) + m log(f_0 − low), z = g_0 + χ. The forces, the rows that they lack
    and the step are left in ``room``.
    """
    f, off, ahead, M, K = room
    rows, slack = len(ahead), TINY * TINY
    for a in range(6):
        off[a] = e[a]
    for a in range(rows):
        for c in range(rows):
            M[a][c] = 0.0
    for b in range(len(A)):
        g0, g1, g2 = _along(A[b], w, 6)
        root = math.sqrt(m * m + g1 * g1 + g2 * g2)
        u1, u2 = g1 / (m + root), g2 / (m + root)
        z = g0 + root - m - m * math.log(0.5 * (root + m) / m)
        half = 0.5 * (bounds[b][1] - bounds[b][0])
        wide = math.sqrt(m * m + z * z * half * half)
        f0 = bounds[b][0] + half + z * half * half / (m + wide)
        f[b][0], f[b][1], f[b][2] = f0, f0 * u1, f0 * u2
        K[b][0], K[b][1], K[b][2], K[b][3] = u1, u2, 1.0 / (m + root), half / (m + wide)
        k, s, q = half * half * m / (wide * (m + wide)), f0 / (m + root), f0 / root
        h1, h2, h12 = k * u1, k * u2, (k - q) * u1 * u2
        h11, h22 = (k - q) * u1 * u1 + s, (k - q) * u2 * u2 + s
        for a in range(6):
            x0, x1, x2 = A[b][a][0], A[b][a][1], A[b][a][2]
            off[a] -= x0 * f0 + x1 * f[b][1] + x2 * f[b][2]
            v0, v1, v2 = (
                k * x0 + h1 * x1 + h2 * x2,
                h1 * x0 + h11 * x1 + h12 * x2,
                h2 * x0 + h12 * x1 + h22 * x2,
            )
            for c in range(a + 1 if a < rows else 0):
                M[a][c] += v0 * A[b][c][0] + v1 * A[b][c][1] + v2 * A[b][c][2]
    for a in range(rows):
        slack += TINY * M[a][a]
    for a in range(rows):
        ahead[a] = -off[a]
        M[a][a] += slack
    for a in range(rows):
        for c in range(a + 1, rows):
            part = M[c][a] / M[a][a]
            ahead[c] -= part * ahead[a]
            for j in range(c, rows):
                M[j][c] -= part * M[j][a]
    for a in range(rows - 1, -1, -1):
        for c in range(a + 1, rows):
            ahead[a] -= M[c][a] * ahead[c]
        ahead[a] /= M[a][a]
    far = 0.0
    for b in range(len(A)):
        p0, p1, p2 = _along(A[b], ahead, rows)
        along, across = p0 + K[b][0] * p1 + K[b][1] * p2, math.sqrt(p1 * p1 + p2 * p2)
        far = max(far, K[b][3] * abs(along), K[b][2] * across)
    return FAR * far


def _end(A: Any, bounds: Any, e: Any, w: Any, m: float, last: float, room: Any) -> int:
    """Seek the least φ while m falls to its last value: 1 where forces balance there, −1 where it is
    proved that none do, 0 where neither was found.
    """
    _, off, ahead, _, _ = room
    middle = m == last
    for _ in range(STEPS):
        far = _step(A, bounds, e, w, m, room)
        worst, size = 0.0, 0.0
        for a in range(len(ahead)):
            worst, size = max(worst, abs(off[a])), size + abs(w[a])
        if m == last and worst < BALANCED:
            return 1
        if middle and _bound(A, bounds, e, w) < -SAME * size:
            return -1
        for a in range(len(ahead)):
            w[a] += ahead[a] / max(1.0, far)
        if far < NEAR:
            m = max(DOWN * m, last)
    return 0


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
    A: Any, bounds: Any, e: Any, asked: Any, room: Any, ends: Any, out: Any
) -> tuple[float, float, int]:
    """The bounds of one stance, and how many ends there are.

    Arguments:
        A, e: E over V B, and e before V b, of forces along axes, the normal one times μ.
        bounds: of these normal forces.
        asked: tolerance, closeness as a share of the margin, a margin that need only be compared,
            and directions that are tried first.
        room: space of ``_step``, of as many rows as y has: of six, V B among them, it is told
            alone whether forces balance, by a lower bound of 0.
        ends: space for forces and points of ends, their order, and their directions [rad].
        out: multipliers of the upper bound, w and the middle's, and forces at the border's nearest
            point.
    """
    E, P, order, turn = ends
    multiplier, w, middle, forces = out
    lower, upper, count, one, two, part = -math.inf, math.inf, 0, 0, 0, 0.0
    for a in range(6):
        middle[a] = multiplier[a] = 0.0
    stands = _end(A, bounds, e, middle, 1.0, 1.0, room)
    if stands < 1 or len(room[2]) == 6:
        for a in range(6):
            multiplier[a] = middle[a]
        return (0.0 if stands == 1 else lower), (lower if stands == -1 else upper), count
    goal = AIM * asked[0] / (2.0 * len(A) + 1.0)
    while True:
        if count > 0:
            lower, angle, one, two, part = _nearest(P, order, count)
        near = upper - lower <= asked[0] + asked[1] * abs(upper)
        if lower >= asked[2] or (count >= asked[3] and (near or count == len(turn))):
            break
        if count < asked[3]:
            angle = 2.0 * math.pi * (count + 0.5) / asked[3]
        for a in range(4):
            w[a] = DOWN * middle[a]
        w[4], w[5] = math.cos(angle), math.sin(angle)
        if upper < asked[2] or _end(A, bounds, e, w, DOWN, goal, room) < 1:
            break
        up = _bound(A, bounds, e, w)
        if up < upper:
            upper = up
            for a in range(6):
                multiplier[a] = w[a]
        for b in range(len(A)):
            for j in range(3):
                E[count][b][j] = room[0][b][j]
        P[count][0], P[count][1], turn[count], place = room[1][4], room[1][5], angle, count
        while place > 0 and turn[order[place - 1]] > angle:
            order[place] = order[place - 1]
            place -= 1
        order[place] = count
        count += 1
    for b in range(len(A)):
        for j in range(3):
            forces[b][j] = (1.0 - part) * E[one][b][j] + part * E[two][b][j]
    return lower, upper, count


@cache
def compiled() -> Any:
    """``_stance`` in machine code, kept in the user's folder for caches; None without numba."""
    try:
        import numba.extending
    except ImportError:
        return None
    for part in (_along, _bound, _step, _end, _nearest):
        numba.extending.register_jitable(error_model="numpy")(part)
    folder, before, own = cache_folder() / "numba", numba.config.CACHE_DIR, False
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        own = folder.stat().st_uid == os.getuid() and os.access(folder, os.W_OK)
    try:
        numba.config.CACHE_DIR = str(folder)
        return numba.njit(cache=own, error_model="numpy")(_stance)
    finally:
        numba.config.CACHE_DIR = before


def places(borne: Array) -> Array:
    """Shifts of the centre of mass: one that is t elsewhere takes t × b of the moments, b the sum of
    the forces; shape (N, 6, 2).

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
        multiplier: of the balance of forces and moments: the certificate of ``upper``, shape (N, 6).
        ends: points of the set of shifts, in turn, shape (N, K, 2), nan behind the last.
        stances: that were asked.
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

    def margins(
        self,
        shifts: Array,
        *,
        tolerance: float = 1e-4,
        close: float = 0.02,
        decide: float = math.nan,
        which: NDArray[np.bool_] | None = None,
        first: int = 4,
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
        # S = Q R: the columns of Q that are across S make E, R⁻¹ and the others V
        turned, small = np.linalg.qr(shifts, mode="complete")
        back = np.linalg.solve(small[:, :2], turned[:, :, :2].swapaxes(1, 2))
        rows = np.concatenate([turned[:, :, 2:].swapaxes(1, 2), back], axis=1)
        return self._solved(rows, 4, (tolerance, close, decide, first), which)

    def hold(self) -> Array:
        """Tell of which stances forces balance, shape (N,)."""
        found = self._solved(np.eye(6) + np.zeros((len(self.counts), 1, 1)), 6, (0.0,) * 4)
        return np.asarray(found.lower == 0.0)

    def friction_left(self) -> Array:
        """The largest share of the friction without which forces still balance, from below, shape
        (N,).
        """
        most, little = np.ones(len(self.counts)), np.zeros(len(self.counts))
        for _ in range(HALVINGS):
            middle = 0.5 * (most + little)
            friction = np.repeat(middle, self.counts) * self.friction
            held = replace(self, friction=friction).hold()
            most, little = np.where(held, middle, most), np.where(held, little, middle)
        return 1.0 - most

    def _solved(
        self,
        rows: Array,
        balanced: int,
        asked: Sequence[float],
        which: NDArray[np.bool_] | None = None,
    ) -> Margins:
        """The bounds, with so many rows of the balance (``_stance``).

        Arguments:
            rows: E and V, shape (N, 6, 6).
        """
        axes = np.stack([self.normals / self.friction[:, None], *_across(self.normals)], axis=2)
        moments = cross(self.arms_m[:, None], axes.swapaxes(1, 2)).swapaxes(1, 2)
        A = np.repeat(rows, self.counts, axis=0) @ np.concatenate([axes, moments], axis=1)
        bounds = self.friction[:, None] * np.stack([self.low, self.high], axis=1)
        e, ends = (rows @ self.borne[:, :, None])[:, :, 0], np.cumsum(self.counts).tolist()
        N, most, wanted = len(e), max(int(asked[3]), MOST), np.array(asked)
        lower, upper, multiplier = np.full(N, -math.inf), np.full(N, math.inf), np.zeros((N, 6))
        points, forces = np.full((N, most, 2), math.nan), np.zeros(self.arms_m.shape)
        those = range(N) if which is None else np.flatnonzero(which).tolist()
        fast = compiled() if len(those) > MANY or compiled.cache_info().currsize else None
        rooms: dict[int, Any] = {}
        for i in those:
            n, part = int(self.counts[i]), slice(ends[i] - self.counts[i], ends[i])
            given = A[part], bounds[part], e[i], wanted
            room = rooms.get(n) or rooms.setdefault(n, _room(n, balanced, most, fast is None))
            if fast is None:
                given = tuple(each.tolist() for each in given)
            lower[i], upper[i], count = (fast or _stance)(*given, *room)
            (_, P, order, _), (multiplier[i], *_, forces[part]) = room[1:]
            points[i, :count] = np.asarray(P)[np.asarray(order)[:count]]
        return Margins(
            lower=lower,
            upper=upper,
            direction=multiplier[:, 4:].copy(),
            forces=(axes @ forces[:, :, None])[:, :, 0],
            multiplier=(multiplier[:, None] @ rows)[:, 0],
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
    wrong = [(name, "finite numbers", ~np.isfinite(value)) for name, value in known.items()]
    wrong += [
        ("normals", "length 1", np.abs(np.linalg.norm(known["normals"], axis=2) - 1.0) > UNIT),
        ("friction", "numbers above 0", known["friction"] <= 0.0),
        ("low", "0 or more", known["low"] < 0.0),
        ("high", "more than low", known["high"] <= known["low"]),
        ("wrench", "less lift than the weight", known["wrench"][:, 2] >= 1.0),
    ]
    for name, must, bad in wrong:
        for row in np.flatnonzero(bad.reshape(len(plain), -1).any(axis=1))[:1]:
            raise InvalidInput(f"{name}[{row}]: expected {must}, got {known[name][row].tolist()}")
    return Stances(
        arms_m=(known["subject"] - known["com_m"][:, None]).reshape(-1, 3),
        normals=known["normals"].reshape(-1, 3),
        **{name: known[name].ravel() for name in ("friction", "low", "high")},
        counts=np.full(len(plain), plain.shape[1]),
        borne=np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) - known["wrench"],
    )


def _room(n: int, rows: int, most: int, lists: bool) -> Any:
    """Space for a stance of n contacts."""
    shapes = (
        ((n, 3), (6,), (rows,), (rows, rows), (n, 4)),
        ((most, n, 3), (most, 2), (most,), (most,)),
        ((6,), (6,), (6,), (n, 3)),
    )
    room = [[np.zeros(shape) for shape in part] for part in shapes]
    room[1][2] = np.zeros(most, dtype=np.int64)
    return tuple(tuple(each.tolist() if lists else each for each in part) for part in room)


def _across(normals: Array) -> tuple[Array, Array]:
    """Two directions across each normal (Duff et al., "Building an orthonormal basis, revisited")."""
    x, y, z = normals.T
    s = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (s + z)
    b = x * y * a
    return np.stack([1.0 + s * x * x * a, s * b, -s * x], 1), np.stack([b, s + y * y * a, -y], 1)
