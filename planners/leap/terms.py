"""The terms of a leap as rows, beside those of ``equilibrium.terms``: dynamics, what limits legs,
and slack.

Per mass and with forces in units of the weight, over an interval of dt with constant forces, F = Σ
f:

    v′ = v + g dt (F − e_z)          c′ = c + dt (v + v′)/2          L′ = L + g dt Σ (p − c̄) × f
    c̄ = (c + c′)/2 − dt (v′ − v)/12          Θ′ = Θ + J⁻¹ (dt (L + L′)/2 + g dt³/24 (v + v′) × F)

These are exact. L and Θ are bilinear; they are linearised about a point, with slack that costs.
Linear rows are hard, and are relaxations of what any leap obeys, so that a Farkas ray weighs
nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import skew
from ..equilibrium.terms import BodyVariables, Forces, FreeToes
from ..files.arrays import Array
from ..physics import GRAVITY_M_S2
from .numbers import LeapGiven

SPEED_RESERVE = 0.97
"""Share of speeds and powers that plans use: rows ask at the ends of intervals."""
PRICES = MappingProxyType(
    {
        "moment": 1.0,
        "turn": 0.1,
        "speed": 0.05,
        "power": 0.05,
        "fold": 0.3,
        "inside": 1.0,
        "joints": 0.2,
    }
)
"""Price of a unit of slack, by group: m²/s, rad, m/s, units of the weight times m/s, m, and the
largest share of a joint's speed or torque beyond what is asked for."""
SLACKS = tuple(PRICES)


class Dynamics:
    """v, L, and how they, c and Θ go on over M intervals."""

    def __init__(
        self, rows: Rows[LeapGiven], layout: Layout, body: BodyVariables, still: tuple[bool, bool]
    ) -> None:
        self._rows, self._layout, self._body = rows, layout, body
        self.intervals = layout.frames // 2
        self.velocity = rows.variable("velocity", self.intervals + 1, 3)
        self._still = still

    def linear(self, forces: Forces) -> None:
        """v′ = v + g dt (F − e_z), c′ = c + dt (v + v′)/2, c in the middle, both ends, and rest in
        still intervals.
        """
        rows, com, v, m = self._rows, self._body.com, self.velocity, self.intervals
        faster = rows.equal("faster", m, 3)
        rows.put(faster, v[1:], 1.0)
        rows.put(faster, v[:-1], -1.0)
        at = faster[self._layout.stance_frames[forces.stance] // 2]
        rows.put(at[:, :, None], forces.columns[:, None, :], _pushed(forces, self._layout))
        rows.right(faster[:, 2], lambda d: -GRAVITY_M_S2 * d.numbers.lasts)
        moved = rows.equal("moved", m, 3)
        rows.put(moved, com[2::2], 1.0)
        rows.put(moved, com[:-1:2], -1.0)
        for columns in (v[1:], v[:-1]):
            rows.put(moved, columns, lambda d: -0.5 * d.numbers.lasts[:, None])
        middle = rows.equal("middle", m, 3)  # c((t + t′)/2) = (c + c′)/2 − dt (v′ − v)/8
        rows.put(middle, com[1::2], 1.0)
        for columns, sign in ((com[:-1:2], -0.5), (com[2::2], -0.5)):
            rows.put(middle, columns, sign)
        rows.put(middle, v[1:], lambda d: d.numbers.lasts[:, None] / 8.0)
        rows.put(middle, v[:-1], lambda d: -d.numbers.lasts[:, None] / 8.0)
        begin = rows.equal("begin", 2, 3)
        rows.put(begin[0], com[0], 1.0)
        rows.put(begin[1], v[0], 1.0)
        rows.right(begin[0], Of("numbers.start", 0))
        rows.right(begin[1], Of("numbers.velocity", 0))
        end = rows.equal("end", 3)
        rows.put(end, v[-1], 1.0)
        rows.right(end, Of("numbers.velocity", 1))
        rest = rows.equal("rest", sum(self._still), 3)
        for row, k in zip(rest, self.still_intervals, strict=True):
            rows.put(row, v[k + 1], 1.0)
            rows.put(row, v[k], -1.0)

    @property
    def still_intervals(self) -> list[int]:
        """The first and the last interval, where the body rests in them."""
        ends = (0, self.intervals - 1)
        return [k for k, still in zip(ends, self._still, strict=True) if still]


class Turning:
    """L, Θ and how they go on, linearised about a point, one candidate per foothold."""

    def __init__(
        self, rows: Rows[LeapGiven], layout: Layout, body: BodyVariables, dynamics: Dynamics
    ) -> None:
        self._rows, self._layout, self._body, self._dynamics = rows, layout, body, dynamics
        self.momentum = rows.variable("momentum", dynamics.intervals + 1, 3)

    def ends(self) -> None:
        """L and Θ at the start, L at the end, and neither changes in still intervals."""
        rows, momentum, rotation = self._rows, self.momentum, self._body.rotation
        begin = rows.equal("begin_turn", 3, 3)
        for row, columns in zip(begin, (rotation[0], momentum[0], momentum[-1]), strict=True):
            rows.put(row, columns, 1.0)
        rows.right(begin[0], Of("numbers.start", 1))
        rows.right(begin[1:], Of("numbers.momentum"))
        rest = rows.equal("rest_turn", len(self._dynamics.still_intervals), 3)
        for row, k in zip(rest, self._dynamics.still_intervals, strict=True):
            rows.put(row, momentum[k + 1], 1.0)
            rows.put(row, momentum[k], -1.0)

    def limits(self) -> None:
        """|L| at the ends of intervals, and Θ at the end."""
        rows, last = self._rows, self._body.rotation[-1]
        for name, sign in (("spun", 1.0), ("spun_back", -1.0)):
            within = rows.at_most(name, self._dynamics.intervals - 1, 3)
            rows.put(within, self.momentum[1:-1], sign)
            rows.right(within, lambda d: d.numbers.leap.limits.momentum_m2_s)
        for name, sign in (("landed", 1.0), ("landed_back", -1.0)):
            within = rows.at_most(name, 3)
            rows.put(within, last, sign)
            rows.right(within, lambda d: d.numbers.leap.limits.goal_tilt_rad)

    def go_on(self, forces: Forces, toes: FreeToes) -> None:
        """L′ − L and Θ′ − Θ about a point; Θ in the middle as of a parabola."""
        rows, m, v, com = (
            self._rows,
            self._dynamics.intervals,
            self._dynamics.velocity,
            self._body.com,
        )
        stance, _, foothold = self._layout.contacts
        at = self._layout.stance_frames[stance] // 2
        standing = np.unique(at)
        moment = rows.equal("moment", m, 3)
        rows.put(moment, self.momentum[1:], 1.0)
        rows.put(moment, self.momentum[:-1], -1.0)
        _slack(rows, "moment", moment)
        rows.put(moment[at][:, :, None], forces.columns[:, None, :], _arms)
        assert toes.points is not None
        rows.put(moment[at][:, :, None], toes.points[foothold][:, None, :], _levers)
        for columns, share in ((com[:-1:2], 0.5), (com[2::2], 0.5)):
            rows.put(
                moment[standing][:, :, None],
                columns[standing][:, None, :],
                _against(standing, share, 0.0),
            )
        for columns, share in ((v[1:], -1.0 / 12.0), (v[:-1], 1.0 / 12.0)):
            rows.put(
                moment[standing][:, :, None],
                columns[standing][:, None, :],
                _against(standing, share, 1.0),
            )
        rows.right(moment, _offset)
        turn = rows.equal("turn", m, 3)
        rotation = self._body.rotation
        rows.put(turn, rotation[2::2], 1.0)
        rows.put(turn, rotation[:-1:2], -1.0)
        _slack(rows, "turn", turn)
        for columns in (self.momentum[1:], self.momentum[:-1]):
            rows.put(
                turn[:, :, None],
                columns[:, None, :],
                lambda d: -0.5 * d.numbers.lasts[:, None, None] * d.numbers.spins,
            )
        rows.put(turn[at][:, :, None], forces.columns[:, None, :], _bends)
        for columns in (v[1:], v[:-1]):
            rows.put(turn[standing][:, :, None], columns[standing][:, None, :], _bent(standing))
        rows.right(turn, _bend_offset)
        middle = rows.equal("turn_middle", m, 3)
        rows.put(middle, rotation[1::2], 1.0)
        for columns in (rotation[:-1:2], rotation[2::2]):
            rows.put(middle, columns, -0.5)
        for columns, sign in ((self.momentum[1:], 1.0), (self.momentum[:-1], -1.0)):
            rows.put(
                middle[:, :, None],
                columns[:, None, :],
                _signed(sign / 8.0, lambda d: d.numbers.lasts[:, None, None] * d.numbers.spins),
            )


class Legs:
    """Limits of legs: height of the body, and speed, power and length about a point, which cost
    where they fail.
    """

    def __init__(
        self,
        rows: Rows[LeapGiven],
        layout: Layout,
        body: BodyVariables,
        dynamics: Dynamics,
        toes: FreeToes,
    ) -> None:
        self._rows, self._layout, self._body, self._dynamics, self._toes = (
            rows,
            layout,
            body,
            dynamics,
            toes,
        )

    def height(self) -> None:
        """c_z ≥ p_z + height wherever a limb stands."""
        frame, _, foothold = self._layout.standing
        high = self._rows.at_most("height", len(frame))
        assert self._toes.points is not None
        self._rows.put(high, self._body.com[frame, 2], -1.0)
        self._rows.put(high, self._toes.points[foothold, 2], 1.0)
        self._rows.right(high, lambda d: -d.numbers.leap.limits.height_m - d.reserve_m)

    def speed(self, momentum: Index) -> None:
        """|ê·(v + ω × h)| ≤ speed at the ends of intervals, ê along the leg of the point, ω = J⁻¹
        L.
        """
        rows, (frame, limb, _) = self._rows, self._layout.standing
        ends = np.flatnonzero(frame % 2 == 0)
        node = frame[ends] // 2
        slack = _one_slack(rows, "speed", len(ends))
        for name, sign in (("extends", 1.0), ("folds", -1.0)):
            row = rows.at_most(name, len(ends))
            rows.put(
                row[:, None],
                self._dynamics.velocity[node],
                _signed(sign, lambda d: d.legs[0][ends]),
            )
            rows.put(row[:, None], momentum[node], _signed(sign, lambda d: d.legs[1][ends]))
            rows.put(row, slack, -1.0)
            rows.right(row, lambda d: SPEED_RESERVE * d.numbers.speed[limb[ends]])

    def fold(self) -> None:
        """ê·(c + h + Θ × h − p) ≥ fold wherever a limb stands."""
        rows, (frame, limb, foothold) = self._rows, self._layout.standing
        slack, row = _one_slack(rows, "fold", len(frame)), rows.at_most("short", len(frame))
        assert self._toes.points is not None
        rows.put(row[:, None], self._body.com[frame], lambda d: -d.legs[0])
        rows.put(row[:, None], self._body.rotation[frame], lambda d: -d.legs[2])
        rows.put(row[:, None], self._toes.points[foothold], lambda d: d.legs[0])
        rows.put(row, slack, -1.0)
        rows.right(
            row,
            lambda d: (
                np.sum(d.legs[0] * d.numbers.hips[limb], axis=1)
                - d.numbers.fold[limb]
                - d.reserve_m
            ),
        )

    def power(self, forces: Forces, momentum: Index) -> None:
        """|f·(v + ω × h)| ≤ power at both ends of every interval, about a point."""
        rows, (stance, limb, _) = self._rows, self._layout.contacts
        at = self._layout.stance_frames[stance] // 2
        slack = _one_slack(rows, "power", 2 * len(at))
        node = np.concatenate([at, at + 1])
        columns, limb = (
            np.concatenate([forces.columns, forces.columns]),
            np.concatenate([limb, limb]),
        )
        for name, sign in (("drives", 1.0), ("brakes", -1.0)):
            row = rows.at_most(name, len(node))
            rows.put(
                row[:, None], self._dynamics.velocity[node], _signed(sign, lambda d: d.powers[0])
            )
            rows.put(row[:, None], momentum[node], _signed(sign, lambda d: d.powers[1]))
            rows.put(row[:, None], columns, _signed(sign, lambda d: d.powers[2]))
            rows.put(row, slack, -1.0)
            rows.right(row, _powers_left(sign, limb))

    def inside(self) -> None:
        """a·R(Θ)ᵀ(p − c) ≤ b of every half-space of reach, about a point; the outer ones are hard
        rows beside it.
        """
        rows, layout = self._rows, self._layout
        (frame, _, foothold), (which, half) = layout.standing, layout.standing_rows
        slack, row = _one_slack(rows, "inside", len(half)), rows.at_most("within", len(half))
        assert self._toes.points is not None
        rows.put(row[:, None], self._toes.points[foothold[which]], lambda d: d.planes[0])
        rows.put(row[:, None], self._body.com[frame[which]], lambda d: -d.planes[0])
        rows.put(row[:, None], self._body.rotation[frame[which]], lambda d: d.planes[1])
        rows.put(row, slack, -1.0)
        rows.right(row, lambda d: d.scaled.half_spaces.bounds[half] - d.reserve_m + d.planes[2])

    def joints(self, forces: Forces, momentum: Index, count: int) -> None:
        """|q̇|/q̇_max, |τ|/τ_max and, where they drive, the sum of both within their share, in both
        halves of every interval, for ``count`` joints per leg; linear about what a judge measured,
        with one slack, so that what costs is the worst of all joints.
        """
        rows, (stance, _, foothold) = self._rows, self._layout.contacts
        at = self._layout.stance_frames[stance] // 2
        node = np.concatenate([at, at + 1])
        columns = np.concatenate([forces.columns, forces.columns])
        assert self._toes.points is not None
        toes = self._toes.points[np.concatenate([foothold, foothold])]
        com = self._body.com[2 * node]
        velocity, spin = self._dynamics.velocity[node], momentum[node]
        slack = np.broadcast_to(_one_slack(rows, "joints", 1), (len(node), count))
        for way, sign in (("ahead", 1.0), ("back", -1.0)):
            for kind, (fast, strong) in _KINDS.items():
                row = rows.at_most(f"{kind}_{way}", len(node), count)
                if fast:
                    rows.put(row[:, :, None], velocity[:, None], _joint(sign, "faster"))
                    rows.put(row[:, :, None], spin[:, None], _joint(sign, "spinning"))
                if strong:
                    rows.put(row[:, :, None], columns[:, None], _joint(sign, "stronger"))
                rows.put(row[:, :, None], toes[:, None], _joint_placed(sign, fast, strong))
                rows.put(row[:, :, None], com[:, None], _joint_placed(-sign, fast, strong))
                rows.put(row, slack, -1.0)
                rows.right(row, _joint_left(sign, fast, strong))


_KINDS = {"fast": (True, False), "strong": (False, True), "driven": (True, True)}
"""Rows of joints: with speeds, with torques, or with the sum of both (the speed–torque line)."""


def _joint(sign: float, name: str) -> Callable[[LeapGiven], Array]:
    return lambda d: sign * getattr(d.joint_rows, name)


def _joint_placed(sign: float, fast: bool, strong: bool) -> Callable[[LeapGiven], Array]:
    """Derivatives in p − c."""
    return lambda d: sign * (fast * d.joint_rows.speed_placed + strong * d.joint_rows.torque_placed)


def _joint_left(sign: float, fast: bool, strong: bool) -> Callable[[LeapGiven], Array]:
    """Rest of a share beside what does not depend on the variables."""
    return lambda d: (
        d.joint_rows.share
        - sign * (fast * d.joint_rows.speed_rest + strong * d.joint_rows.torque_rest)
    )


def trust(rows: Rows[LeapGiven], layout: Layout, toes: FreeToes) -> None:
    """‖p − p̂‖ ≤ radius of every toe."""
    near = rows.cones("near", layout.footholds, 4)
    assert toes.points is not None
    rows.put(near[:, 1:], toes.points, -1.0)
    rows.right(near[:, 0], lambda d: d.toe_radius)
    rows.right(near[:, 1:], lambda d: -d.point.toes)


def still_moments(
    rows: Rows[LeapGiven], layout: Layout, body: BodyVariables, forces: Forces, dynamics: Dynamics
) -> None:
    """Σ p × f = c × e_z in still intervals, over the forces of vertices: the quasi-static balance
    of moments.
    """
    interval = layout.stance_frames[forces.stance] // 2
    still = rows.equal("moment_still", len(dynamics.still_intervals), 3)
    for row, k in zip(still, dynamics.still_intervals, strict=True):
        at_interval = np.flatnonzero(interval == k)
        rows.put(
            row[None, :, None],
            forces.columns[at_interval][:, None, :],
            Of("scaled.arms", at_interval),
        )
        com = body.com[0 if k == 0 else layout.frames - 1]
        rows.put(row[0], com[1], -1.0)  # −c × e_z = (−c_y, c_x, 0)
        rows.put(row[1], com[0], 1.0)


def _signed(sign: float, fill: Callable[[LeapGiven], Array]) -> Callable[[LeapGiven], Array]:
    """A number times what a function gives."""
    return lambda d: sign * fill(d)


def _powers_left(sign: float, limb: Index) -> Callable[[LeapGiven], Array]:
    """Largest power and ± f̂·v̂, at both ends of every contact's interval."""
    return lambda d: SPEED_RESERVE * d.numbers.power[limb] + sign * d.powers[3]


def _pushed(forces: Forces, layout: Layout) -> Callable[[LeapGiven], Array]:
    interval = layout.stance_frames[forces.stance] // 2

    def values(given: LeapGiven) -> Array:
        lasts = given.numbers.lasts[interval]
        return np.asarray(
            -GRAVITY_M_S2 * lasts[:, None, None] * given.scaled.frames[forces.candidate]
        )

    return values


def _arms(given: LeapGiven) -> Array:
    """−g dt [p̂ − c̄]× R of every stance contact."""
    at, point = given.numbers.contact_intervals, given.point
    means = given.numbers.means(point.com, point.velocity)
    arms = skew(point.toes[given.scaled.layout.contacts[2]] - means[at])
    lasts = given.numbers.lasts[at][:, None, None]
    return np.asarray(-GRAVITY_M_S2 * lasts * np.matmul(arms, given.scaled.contact_frames))


def _levers(given: LeapGiven) -> Array:
    """g dt [f̂]× of every stance contact."""
    lasts = given.numbers.lasts[given.numbers.contact_intervals][:, None, None]
    return np.asarray(GRAVITY_M_S2 * lasts * skew(given.point.forces))


def _against(standing: Index, share: float, power: float) -> Callable[[LeapGiven], Array]:
    """−g dt · share · dt^power [F̂]×: what c × F̂ adds."""

    def values(given: LeapGiven) -> Array:
        lasts = given.numbers.lasts[standing][:, None, None]
        total = given.numbers.total(given.point.forces)[standing]
        return np.asarray(-GRAVITY_M_S2 * share * lasts ** (1.0 + power) * skew(total))

    return values


def _offset(given: LeapGiven) -> Array:
    """−g dt Σ (p̂ − c̄) × f̂."""
    return -given.numbers.turned(given.point)[0]


def _bends(given: LeapGiven) -> Array:
    """−J⁻¹ g dt³/24 [v̂ + v̂′]× R of every stance contact."""
    at, point = given.numbers.contact_intervals, given.point
    sums = (point.velocity[1:] + point.velocity[:-1])[at]
    spun = np.matmul(given.numbers.spins[at], np.matmul(skew(sums), given.scaled.contact_frames))
    return np.asarray(-GRAVITY_M_S2 / 24.0 * given.numbers.lasts[at][:, None, None] ** 3 * spun)


def _bent(standing: Index) -> Callable[[LeapGiven], Array]:
    """J⁻¹ g dt³/24 [F̂]×."""

    def values(given: LeapGiven) -> Array:
        total = skew(given.numbers.total(given.point.forces)[standing])
        lasts = given.numbers.lasts[standing][:, None, None]
        return np.asarray(
            GRAVITY_M_S2 / 24.0 * lasts**3 * np.matmul(given.numbers.spins[standing], total)
        )

    return values


def _bend_offset(given: LeapGiven) -> Array:
    """−J⁻¹ g dt³/24 (v̂ + v̂′) × F̂, and what legs that swing turn the body by."""
    point, numbers = given.point, given.numbers
    sums = point.velocity[1:] + point.velocity[:-1]
    bend = GRAVITY_M_S2 / 24.0 * numbers.lasts[:, None] ** 3
    bend = bend * np.cross(sums, numbers.total(point.forces))
    return np.asarray(numbers.legs_turn - np.matmul(numbers.spins, bend[..., None])[..., 0])


def _slack(rows: Rows[LeapGiven], name: str, equal: Index) -> None:
    """Let rows A x = b be off by s⁺ − s⁻, both of which cost."""
    for end, sign in (("over", -1.0), ("under", 1.0)):
        slack = rows.variable(f"{name}_{end}", *equal.shape)
        rows.put(equal, slack, sign)
        rows.put(rows.at_most(f"{name}_{end}", *equal.shape), slack, -1.0)
        rows.linear(slack, PRICES[name])


def _one_slack(rows: Rows[LeapGiven], name: str, count: int) -> Index:
    """Slack of rows A x − s ≤ b that costs."""
    slack = rows.variable(f"{name}_over", count)
    rows.put(rows.at_most(f"{name}_over", count), slack, -1.0)
    rows.linear(slack, PRICES[name])
    return slack
