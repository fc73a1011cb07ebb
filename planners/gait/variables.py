"""The decision vector c of W1: which entry is what, and the rows that read splines off it.

All forces are in units of m·g, lengths in metres, angles in radians. A standing foot of a chart
that flattens the terrain has no height: z̄ = 0 is not a constraint there, it is not a variable
(W8).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, vstack

from ..answer.trajectory import Trajectory, WalkQuestion
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem.walk import FootPhases, Walk
from ..terrain.heightfield import CubicBasis, cubics, rows_of
from .charts.warped import Chart, Pushforward
from .settings import GaitSettings
from .transcription.taylor import Features, Rows, Selection, TaylorMap, VariableGroup, identity

_DEGREE = 3


def _uniform_size(duration_s: float, knot_s: float) -> int:
    """Number of coefficients of a uniform cubic B-spline on [0, duration].

    Raises InvalidInput for uneven knots.
    """
    pieces = round(duration_s / knot_s)
    if pieces < 1 or abs(pieces * knot_s - duration_s) > 1e-9:
        raise InvalidInput(
            f"torso_knot_s: expected a share of the duration of {duration_s:g} s, got {knot_s:g} s"
        )
    return pieces + _DEGREE


def uniform_basis(times_s: Array, duration_s: float, knot_s: float, order: int = 0) -> csr_array:
    """Values (or a derivative) of the uniform cubic B-splines on [0, duration], shape (len(times),
    size).
    """
    size = _uniform_size(duration_s, knot_s)
    return _basis(np.asarray(times_s), knot_s * np.arange(-_DEGREE, size + 1.0), order)


def clamped_basis(shares: Array, pieces: int, order: int = 0) -> csr_array:
    """Values (or a derivative) of the clamped cubic B-splines on [0, 1], shape (len(shares), pieces
    + 3).
    """
    return _basis(np.asarray(shares), clamped_knots(pieces), order)


def clamped_knots(pieces: int) -> Array:
    """Knots of the clamped cubic B-splines on [0, 1], their ends fourfold, shape (pieces + 7,)."""
    return np.concatenate([np.zeros(_DEGREE), np.linspace(0.0, 1.0, pieces + 1), np.ones(_DEGREE)])


def _basis(x: Array, knots: Array, order: int) -> csr_array:
    first, values = cubics(np.clip(x, knots[_DEGREE], knots[-_DEGREE - 1]), knots, order)
    basis = rows_of(first, values, len(knots) - _DEGREE - 1)
    if order > 0:
        basis.eliminate_zeros()  # entries that are none make the program's matrices fuller
    return basis


def hermite(s: Any, order: int = 0) -> tuple[Any, Any, Any, Any]:
    """Weights of (p₀, T v₀, p₁, T v₁) in a cubic Hermite piece at the share s of its time T, for
    numbers or symbols.

    The derivative of this order is by s; divide by T^order for one by time.
    """
    if order == 0:
        return 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2
    if order == 1:
        return 6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, -6 * s**2 + 6 * s, 3 * s**2 - 2 * s
    return 12 * s - 6, 6 * s - 4, -12 * s + 6, 6 * s - 2


def clamped_symbolic(share: cs.SX, pieces: int) -> cs.SX:
    """``clamped_basis`` at one symbolic share in [0, 1], shape (pieces + 3, 1), by the recursion of
    Cox and de Boor.

    Beyond both ends the outer polynomial pieces go on.
    """
    knots = clamped_knots(pieces)
    inner = knots[_DEGREE:-_DEGREE]
    basis: list[Any] = [cs.SX(0)] * (len(knots) - 1)
    for k in range(pieces):
        above = share >= inner[k] if k > 0 else cs.SX(1)
        below = share < inner[k + 1] if k < pieces - 1 else cs.SX(1)
        basis[_DEGREE + k] = above * below
    for degree in range(1, _DEGREE + 1):
        basis = [
            _ramp(share - knots[i], knots[i + degree] - knots[i]) * basis[i]
            + _ramp(knots[i + degree + 1] - share, knots[i + degree + 1] - knots[i + 1])
            * basis[i + 1]
            for i in range(len(basis) - 1)
        ]
    return cs.SX(cs.vertcat(*basis))


def _ramp(rise: cs.SX, width: float) -> cs.SX:
    return cs.SX(rise / width) if width > 0.0 else cs.SX(0)


Index = NDArray[np.intp]
NOTHING = -1
"""Stands for an entry that is always 0."""


@dataclass(frozen=True, eq=False)
class _FootEntries:
    """Entries of one foot's variables in the decision vector.

    NOTHING marks what is always 0.

    Arguments:
        stances: shape (S + 1, 3), their places.
        swings: shape (S, 6), place and velocity in the middle of each swing.
        forces: for each stance, shape (coefficients, 3), those of its clamped B-spline.
        switches: shape (2 S,), lift-offs and touchdowns, empty where timings are fixed.
    """

    phases: FootPhases
    stances: Index
    swings: Index
    forces: tuple[Index, ...]
    switches: Index


class GaitLayout:
    """Places in the decision vector c (W1, W7), of ``size`` entries, and sparse rows of the splines
    in it.
    """

    def __init__(
        self,
        phases: Sequence[FootPhases],
        duration_s: float,
        *,
        torso_knot_s: float,
        force_knot_s: float,
        flat: bool,
        optimised: bool,
    ) -> None:
        self.duration_s, self.torso_knot_s, self.flat = duration_s, torso_knot_s, flat
        self.size = 0
        self.torso = self._take((_uniform_size(duration_s, torso_knot_s), 6))
        self.feet = tuple(self._foot(one, force_knot_s, optimised) for one in phases)

    def timed(self, x: Array) -> GaitLayout:
        """Layout of the same places with the switching times that a decision vector holds, where
        they are variables.
        """
        if not any(len(foot.switches) for foot in self.feet):
            return self
        moved = copy(self)
        moved.feet = tuple(
            replace(foot, phases=FootPhases(x[foot.switches], foot.phases.duration_s))
            for foot in self.feet
        )
        return moved

    @property
    def torso_times_s(self) -> Array:
        """When each coefficient of the torso's spline acts most, shape (coefficients,) [s]; the
        first and the last outside of [0, duration].
        """
        return np.asarray(self.torso_knot_s * (np.arange(len(self.torso)) - 1.0))

    def _take(self, shape: tuple[int, ...]) -> Index:
        count = int(np.prod(shape))
        self.size += count
        return np.arange(self.size - count, self.size).reshape(shape)

    def _foot(self, phases: FootPhases, force_knot_s: float, optimised: bool) -> _FootEntries:
        count = phases.swings + 1
        stances = np.full((count, 3), NOTHING)
        stances[:, : 2 if self.flat else 3] = self._take((count, 2 if self.flat else 3))
        forces = []
        for index in range(count):
            begin, end = phases.stance(index)
            entries = np.full((max(2, round((end - begin) / force_knot_s)) + 3, 3), NOTHING)
            free = slice(
                0 if index == 0 else 1, None if index == count - 1 else -1
            )  # 0 at lift-off and touchdown
            entries[free] = self._take(entries[free].shape)
            forces.append(entries)
        return _FootEntries(
            phases=phases,
            stances=stances,
            swings=self._take((phases.swings, 6)),
            forces=tuple(forces),
            switches=self._take((2 * phases.swings if optimised else 0,)),
        )

    # --------------------------------------------------------------------------------------- rows
    # of the splines

    def torso_rows(self, times_s: Array, order: int = 0) -> csr_array:
        """Rows of (p̄, θ̄) at times, or of a derivative, shape (6 len(times), size)."""
        basis = uniform_basis(times_s, self.duration_s, self.torso_knot_s, order).tocoo()
        times, knots = basis.coords
        rows = 6 * times[:, None] + np.arange(6)
        return self._rows(rows, self.torso[knots], basis.data[:, None], 6 * len(times_s))

    def foot_rows(self, foot: int, times_s: Array, order: int = 0) -> csr_array:
        """Matrix that maps the decision vector to p̄_i, or to its derivative of this order, at
        these times, shape (3 len(times), size). Switching times are those of the schedule.
        """
        entries, triplets, times = (
            self.feet[foot],
            _Triplets(),
            np.asarray(times_s, dtype=np.float64),
        )
        phase = entries.phases.phase_at(times)
        if order == 0:
            stands = np.flatnonzero(phase % 2 == 0)
            triplets.add(stands, entries.stances[phase[stands] // 2], np.ones(len(stands)))
        swings = np.flatnonzero(phase % 2 == 1)
        edges, index = entries.phases.edges_s, phase[swings] // 2
        begin, end = edges[2 * index + 1], edges[2 * index + 2]
        piece, share = np.divmod(2.0 * (times[swings] - begin) / (end - begin), 1.0)
        half = 0.5 * (end - begin)
        weights = np.array([hermite(one, order) for one in share.tolist()]).reshape(
            -1, 4
        )  # arrays' powers are others
        start, start_speed, stop, stop_speed = weights.T / half**order
        middle, speed = entries.swings[index, :3], entries.swings[index, 3:]
        lift, touch = entries.stances[index], entries.stances[index + 1]
        rising = (lift, start), (middle, stop), (speed, half * stop_speed)
        falling = (middle, start), (speed, half * start_speed), (touch, stop)
        for chosen, parts in ((piece == 0, rising), (piece != 0, falling)):
            for at, by in parts:
                triplets.add(swings[chosen], at[chosen], by[chosen])
        return triplets.matrix(len(times), self.size)

    def force_rows(self, foot: int, times_s: Array, order: int = 0) -> csr_array:
        """Rows of f̄_i at times, zero in swing, shape (3 len(times), size)."""
        entries, triplets = self.feet[foot], _Triplets()
        phase = entries.phases.phase_at(times_s)
        for index, coefficients in enumerate(entries.forces):
            at = np.flatnonzero(phase == 2 * index)
            if not len(at):
                continue
            begin, end = entries.phases.stance(index)
            shares = (np.asarray(times_s)[at] - begin) / (end - begin)
            basis = clamped_basis(shares, len(coefficients) - 3, order).tocoo()
            rows, columns = basis.coords
            triplets.add(at[rows], coefficients[columns], basis.data / (end - begin) ** order)
        return triplets.matrix(len(times_s), self.size)

    def force_times_s(self, foot: int, stance: int) -> Array:
        """When each coefficient of a stance's force acts most, shape (coefficients,) [s]."""
        begin, end = self.feet[foot].phases.stance(stance)
        pieces = len(self.feet[foot].forces[stance]) - 3
        return begin + (end - begin) * CubicBasis(clamped_knots(pieces)).greville

    def entry_rows(self, entries: Index) -> csr_array:
        """Rows that read entries, shape (entries.size, size); NOTHING reads 0."""
        flat = entries.ravel()
        return self._rows(np.arange(len(flat)), flat, np.ones(len(flat)), len(flat))

    def _rows(self, rows: Index, columns: Index, weights: Array, count: int) -> csr_array:
        rows, columns, weights = (
            array.ravel() for array in np.broadcast_arrays(rows, columns, weights)
        )
        there = columns != NOTHING
        return csr_array((weights[there], (rows[there], columns[there])), shape=(count, self.size))


class _Triplets:
    """Rows of three that are gathered one after the other."""

    def __init__(self) -> None:
        self._at, self._entries, self._weights = list[Index](), list[Index](), list[Array]()

    def add(self, at: Index, entries: Index, weights: Array) -> None:
        """Add n times three rows: at, weights of shape (n,); entries, of shape (n, 3)."""
        self._at.append(at)
        self._entries.append(entries)
        self._weights.append(weights)

    def matrix(self, count: int, size: int) -> csr_array:
        if not self._at:
            return csr_array((3 * count, size))
        at, entries, weights = (
            np.concatenate(parts) for parts in (self._at, self._entries, self._weights)
        )
        there = entries != NOTHING
        rows, shared = (
            3 * at[:, None] + np.arange(3),
            np.broadcast_to(weights[:, None], entries.shape),
        )
        return csr_array(
            coo_array((shared[there], (rows[there], entries[there])), shape=(3 * count, size))
        )


_Key = tuple[tuple[str, int], ...]
"""Kinds of the phases that a node may be in, each with its number of force coefficients."""


@dataclass(frozen=True, eq=False)
class _FootGroup:
    """Feet of one kind at nodes.

    Arguments:
        foot, node: shape (K,).
        pushes: whether they may stand.
        variables: their features are (p̄_i, f̄_i), or p̄_i of feet that only swing.
    """

    variables: VariableGroup
    foot: NDArray[np.intp]
    node: NDArray[np.intp]
    pushes: bool

    def selection(self, chosen: Rows | None = None) -> Selection:
        """All its instances, or some."""
        return self.variables, np.arange(len(self.foot)) if chosen is None else chosen

    def find(self, foot: Rows, node: Rows) -> tuple[Rows, Rows]:
        """Select this group's own feet among feet at nodes, shape (T,) each: their instances, and
        their numbers among these.
        """
        place = {
            at: k for k, at in enumerate(zip(self.foot.tolist(), self.node.tolist(), strict=True))
        }
        pairs = enumerate(zip(foot.tolist(), node.tolist(), strict=True))
        matches = np.array(
            [(place[at], t) for t, at in pairs if at in place], dtype=np.intp
        ).reshape(-1, 2)
        return matches[:, 0], matches[:, 1]


def _scheduled_groups(
    layout: GaitLayout, times_s: Array, foot_map: TaylorMap | None, step_s: float = 0.0
) -> tuple[_FootGroup, ...]:
    """All feet at all nodes by the schedule's phases: those that stand, then those that swing.

    Arguments:
        times_s: of the nodes, shape (K,) [s].
        foot_map: the chart's.
        step_s: where it is above 0, the force at a node is its mean over the steps on both sides,
            the nearer the node the more: ∫ (1 − |s|) f(t + s Δt) ds over s in [−1, 1], which is
            what p₊ − 2 p + p₋ balances. Three points are exact for forces that are quadratic in
            each step. A force is 0 where its stance begins and ends, so that no node without the
            foot gets any.
    """
    at: dict[bool, list[tuple[int, int]]] = {True: [], False: []}
    rows: dict[bool, list[csr_array]] = {True: [], False: []}
    for foot, entries in enumerate(layout.feet):
        stands = entries.phases.stands(times_s)
        places, forces = layout.foot_rows(foot, times_s), _mean_rows(layout, foot, times_s, step_s)
        both, nodes = csr_array(vstack([places, forces])), 3 * np.arange(len(times_s))[:, None]
        place = nodes + np.arange(2 if layout.flat else 3)
        on_ground_too = np.hstack([place, places.shape[0] + nodes + np.arange(3)])
        for standing, bases in ((True, on_ground_too), (False, nodes + np.arange(3))):
            chosen = np.flatnonzero(stands == standing)
            at[standing] += [(foot, node) for node in chosen.tolist()]
            rows[standing].append(csr_array(both[bases[chosen].ravel()]))
    width, features = (5, _on_ground) if layout.flat else (6, identity)
    kinds: list[tuple[bool, str, int, Features]] = [
        (True, "stance", width, features),
        (False, "swing", 3, identity),
    ]
    groups = []
    for standing, name, size, made in kinds:
        if at[standing]:
            variables = VariableGroup(name, csr_array(vstack(rows[standing])), size, foot_map, made)
            foot_of, node_of = np.array(at[standing]).T
            groups.append(_FootGroup(variables, foot_of, node_of, standing))
    return tuple(groups)


def _mean_rows(layout: GaitLayout, foot: int, times_s: Array, step_s: float) -> csr_array:
    """Rows of f̄_i, the mean about each time where step_s is above 0; before the start and after
    the end it stays.
    """
    if step_s == 0.0:
        return layout.force_rows(foot, times_s)
    before, at, after = (
        layout.force_rows(foot, np.clip(times_s + share * step_s, 0.0, layout.duration_s))
        for share in (-0.5, 0.0, 0.5)
    )
    return csr_array((before + at + after) / 3.0)


def _on_ground(v: cs.SX, constants: cs.SX) -> cs.SX:
    """(p̄, f̄) of a foot that stands on z̄ = 0, from (x̄, ȳ, f̄) (W8)."""
    return cs.vertcat(v[:2], 0.0, v[2:5])


def _entry_group(
    layout: GaitLayout, name: str, entries: Index, entry_map: TaylorMap | None = None
) -> VariableGroup:
    """Entries of the decision vector as features, shape (K, width); columns that are NOTHING
    throughout are 0.
    """
    used = np.flatnonzero((entries != NOTHING).any(axis=0)).tolist()
    width = entries.shape[1]

    def spread(v: cs.SX, constants: cs.SX) -> cs.SX:
        out = cs.SX.zeros(width)
        out[used] = v
        return out

    return VariableGroup(name, layout.entry_rows(entries[:, used]), len(used), entry_map, spread)


def _moving_groups(
    layout: GaitLayout, times_s: Array, foot_map: TaylorMap | None, slack_s: float
) -> tuple[_FootGroup, ...]:
    """All feet at all nodes, grouped by the phases that they may be in where switching times may
    move by slack_s.
    """
    result: dict[_Key, list[tuple[int, int, Index]]] = {}
    for foot, entries in enumerate(layout.feet):
        for node, time in enumerate(times_s):
            key, columns = _columns(entries, _candidates(entries, float(time), slack_s))
            result.setdefault(key, []).append((foot, node, columns))
    groups = []
    for key, members in result.items():
        foot_of, node_of = np.array([member[:2] for member in members]).T
        plain = _entry_group(layout, "moving", np.array([member[2] for member in members]))
        features = _moving_features(key, plain.features, layout.duration_s)
        variables = VariableGroup(
            "moving feet",
            plain.rows,
            plain.width,
            foot_map,
            features,
            np.asarray(times_s)[node_of][:, None],
        )
        groups.append(
            _FootGroup(variables, foot_of, node_of, any(kind != "swing" for kind, _ in key))
        )
    return tuple(groups)


def _candidates(entries: _FootEntries, time: float, slack: float) -> list[int]:
    """Indices of the phases that a foot may be in at this time [s]: one, or two neighbours if the
    time is within ``slack`` [s] of the switch between them.
    """
    edges = entries.phases.edges_s
    low = np.concatenate([[-np.inf], edges[1:-1] - slack, [np.inf]])
    high = np.concatenate([[-np.inf], edges[1:-1] + slack, [np.inf]])
    return [k for k in range(len(edges) - 1) if low[k] < time + 1e-9 and time - 1e-9 < high[k + 1]]


def _columns(entries: _FootEntries, candidates: list[int]) -> tuple[_Key, Index]:
    """Key of the group, and the entries of its variables, phase by phase; NOTHING for what is 0 or
    a constant.
    """
    key: list[tuple[str, int]] = []
    columns: list[Index] = []
    switches = np.concatenate([[NOTHING], entries.switches, [NOTHING]])
    for number in candidates:
        index = number // 2
        if number % 2 == 0:
            first, last = number == 0, number == len(switches) - 2
            coefficients = entries.forces[index]
            key.append(("first" if first else "last" if last else "stance", len(coefficients)))
            columns += [entries.stances[index], coefficients.ravel(), switches[number : number + 2]]
        else:
            key.append(("swing", 0))
            columns += [
                entries.stances[index],
                entries.stances[index + 1],
                entries.swings[index],
                switches[number : number + 2],
            ]
    return tuple(key), np.concatenate(columns)


def _moving_features(key: _Key, inner: Features, duration_s: float) -> Features:
    """(p̄, f̄) at a node: of its one phase, or of the first until the switch and of the second from
    it on.
    """

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        at, time = inner(v, constants), constants[0]
        first = 0
        parts, begins = [], []
        for kind, coefficients in key:
            width = 14 if kind == "swing" else 5 + 3 * coefficients
            entries = at[first : first + width]
            first += width
            begin = cs.SX(0.0) if kind == "first" else entries[width - 2]
            end = cs.SX(duration_s) if kind == "last" else entries[width - 1]
            parts.append(
                _swinging(entries, time, begin, end)
                if kind == "swing"
                else _standing(entries, time, begin, end)
            )
            begins.append(begin)
        result = parts[0]
        for begin, phase in zip(begins[1:], parts[1:], strict=True):
            result = cs.if_else(time < begin, result, phase)
        return result

    return features


def _standing(own: cs.SX, time: cs.SX, begin: cs.SX, end: cs.SX) -> cs.SX:
    coefficients = cs.reshape(own[3:-2], 3, (own.shape[0] - 5) // 3)
    basis = clamped_symbolic((time - begin) / (end - begin), coefficients.shape[1] - 3)
    return cs.vertcat(own[:3], coefficients @ basis)


def _swinging(own: cs.SX, time: cs.SX, begin: cs.SX, end: cs.SX) -> cs.SX:
    lift, touch, middle, speed, half = own[:3], own[3:6], own[6:9], own[9:12], 0.5 * (end - begin)
    share = (time - begin) / half
    rising, falling = hermite(share), hermite(share - 1.0)
    up = rising[0] * lift + rising[2] * middle + half * rising[3] * speed
    down = falling[0] * middle + half * falling[1] * speed + falling[2] * touch
    return cs.vertcat(cs.if_else(share < 1.0, up, down), cs.SX.zeros(3))


class Structure:
    """The shape of one program: settings applied to a task, before any term is written.

    Arguments:
        feet: number of feet, E.
    """

    def __init__(self, task: Walk, settings: GaitSettings, chart: Chart) -> None:
        self.task, self.settings, self.chart = task, settings, chart
        steps = round(task.duration_s / settings.step_s)
        if steps < 2 or abs(steps * settings.step_s - task.duration_s) > 1e-9:
            raise InvalidInput(
                f"step_s: expected a share of the duration of {task.duration_s:g} s, got "
                f"{settings.step_s:g} s"
            )
        self.feet = len(task.robot.feet)
        self.mean_s = settings.step_s if settings.mean_forces else 0.0
        self.times_s: Array = np.asarray(settings.step_s * np.arange(steps + 1), dtype=np.float64)
        self.layout = GaitLayout(
            task.phases(settings.step_s),
            task.duration_s,
            torso_knot_s=settings.torso_knot_s,
            force_knot_s=settings.force_knot_s,
            flat=chart.flat,
            optimised=task.timings == "optimised",
        )

    @property
    def nodes(self) -> int:
        """Number of nodes, those at 0 and T included."""
        return len(self.times_s)

    @property
    def kind(self) -> Hashable:
        """Equal for programs whose kernels are: they differ in terrain, start, goal and headings."""
        task = self.task
        held = task.robot, task.friction, task.adhesive, task.suction_n
        return (
            self.chart.kind,
            self.settings,
            held,
            task.duration_s,
            task.gait,
            task.cycle_s,
            task.timings,
        )

    @cached_property
    def torso(self) -> VariableGroup:
        """(p̄, θ̄) at all nodes."""
        return VariableGroup("torso", self.layout.torso_rows(self.times_s), 6, self.chart.torso_map)

    def torso_at(self, nodes: Rows) -> Selection:
        """(p̄, θ̄) at nodes; before the start y₋ = y₋₋ = y₀ (W14), the robot stands still, and so
        after a still end.
        """
        return self.torso, np.clip(nodes, 0, self.nodes - 1)

    @cached_property
    def feet_at_nodes(self) -> tuple[_FootGroup, ...]:
        """All feet at all nodes, in groups."""
        if self.task.timings == "optimised":
            return _moving_groups(
                self.layout, self.times_s, self.chart.foot_map, self.settings.switch_slack_s
            )
        return _scheduled_groups(self.layout, self.times_s, self.chart.foot_map, self.mean_s)

    def entries(self, name: str, entries: Index, on_foot: bool = False) -> VariableGroup:
        """Entries of the decision vector as features, shape (K, width).

        Arguments:
            on_foot: points with the feet's map about.
        """
        return _entry_group(self.layout, name, entries, self.chart.foot_map if on_foot else None)


def sampled(
    structure: Structure, x: Array, times_s: Array, height_factor: float = 1.0
) -> Trajectory:
    """Evaluate a decision vector at times, shape (K,) [s]: a trajectory of the task, on its terrain
    with heights by this factor.
    """
    layout, push = structure.layout.timed(x), Pushforward(structure.chart, height_factor)
    torso_m, rotation = push.torso((layout.torso_rows(times_s) @ x).reshape(-1, 6))
    feet: list[Array] = []
    forces: list[Array] = []
    contact: list[NDArray[np.bool_]] = []
    for foot, entries in enumerate(layout.feet):
        place = (layout.foot_rows(foot, times_s) @ x).reshape(-1, 3)
        p_i, f_i = push.foot(place, (layout.force_rows(foot, times_s) @ x).reshape(-1, 3))
        feet, forces = [*feet, p_i], [*forces, f_i * structure.task.robot.weight_n]
        contact.append(entries.phases.stands(times_s))
    task = structure.task
    return Trajectory(
        times_s=times_s,
        torso_m=torso_m,
        rotation=rotation,
        feet_m=np.stack(feet, axis=1),
        forces_n=np.stack(forces, axis=1),
        contact=np.stack(contact, axis=1),
        problem=WalkQuestion(
            robot=task.robot,
            terrain=task.terrain if height_factor == 1.0 else task.terrain.scaled(height_factor),
            friction=task.friction,
            adhesive=np.array(task.adhesive),
            start=task.start,
            goal=task.goal,
            heading_rad=task.start_yaw_rad,
            heading_end_rad=task.end_yaw_rad,
            suction_n=task.suction_n,
        ),
    )
