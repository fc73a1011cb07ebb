"""Feet at fixed times, by the schedule or with optimised phase durations (Pan et al. §III-A, TOWR).

Where durations are optimised, phases begin and end at variables, the switching times: durations are
their differences and sum up to T by themselves. A switching time may move by the settings' slack
about the schedule; a node that it can pass belongs to both phases, and the variables decide.
Between phases place, velocity and force are continuous, so the program is C¹ in the switching
times.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from ...files.arrays import Array
from ..transcription.blocks import Features, Rows, Selection, VariableGroup, identity
from ..transcription.taylor import TaylorMap
from .layout import NOTHING, FootEntries, GaitLayout, Index
from .splines import clamped_symbolic, hermite

_Key = tuple[tuple[str, int], ...]
"""Kinds of the phases that a node may be in, each with its number of force coefficients."""


@dataclass(frozen=True, eq=False)
class FootGroup:
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


def scheduled_groups(
    layout: GaitLayout, times_s: Array, foot_map: TaylorMap | None, step_s: float = 0.0
) -> tuple[FootGroup, ...]:
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
    width, features = (5, on_ground) if layout.flat else (6, identity)
    kinds: list[tuple[bool, str, int, Features]] = [
        (True, "stance", width, features),
        (False, "swing", 3, identity),
    ]
    groups = []
    for standing, name, size, made in kinds:
        if at[standing]:
            variables = VariableGroup(name, csr_array(vstack(rows[standing])), size, foot_map, made)
            foot_of, node_of = np.array(at[standing]).T
            groups.append(FootGroup(variables, foot_of, node_of, standing))
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


def on_ground(v: cs.SX, constants: cs.SX) -> cs.SX:
    """(p̄, f̄) of a foot that stands on z̄ = 0, from (x̄, ȳ, f̄) (W8)."""
    return cs.vertcat(v[:2], 0.0, v[2:5])


def entry_group(
    layout: GaitLayout, name: str, entries: Index, entry_map: TaylorMap | None = None
) -> VariableGroup:
    """Entries of the decision vector as features, shape (K, width); columns that are NOTHING
    throughout are 0.
    """
    used = [k for k in range(entries.shape[1]) if np.any(entries[:, k] != NOTHING)]
    width = entries.shape[1]

    def spread(v: cs.SX, constants: cs.SX) -> cs.SX:
        out = cs.SX.zeros(width)
        for at, k in enumerate(used):
            out[k] = v[at]
        return out

    return VariableGroup(name, layout.entry_rows(entries[:, used]), len(used), entry_map, spread)


def moving_groups(
    layout: GaitLayout, times_s: Array, foot_map: TaylorMap | None, slack_s: float
) -> tuple[FootGroup, ...]:
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
        plain = entry_group(layout, "moving", np.array([member[2] for member in members]))
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
            FootGroup(variables, foot_of, node_of, any(kind != "swing" for kind, _ in key))
        )
    return tuple(groups)


def _candidates(entries: FootEntries, time: float, slack: float) -> list[int]:
    """Indices of the phases that a foot may be in at this time [s]: one, or two neighbours if the
    time is within ``slack`` [s] of the switch between them.
    """
    edges = entries.phases.edges_s
    low = np.concatenate([[-np.inf], edges[1:-1] - slack, [np.inf]])
    high = np.concatenate([[-np.inf], edges[1:-1] + slack, [np.inf]])
    return [k for k in range(len(edges) - 1) if low[k] < time + 1e-9 and time - 1e-9 < high[k + 1]]


def _columns(entries: FootEntries, candidates: list[int]) -> tuple[_Key, Index]:
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
