"""Optimised phase durations (paper W §III-A, TOWR): feet at fixed times whose phases begin and end at variables.

The variables are the switching times, so durations are their differences and sum up to T by themselves. A switching
time may move by the settings' slack about the schedule; a node that it can pass belongs to both phases, and the
variables decide. Between phases place, velocity and force are continuous, so the program is C¹ in the switching times.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ..transcription.blocks import Constraint, Family
from .layout import NOTHING, FootEntries, Index
from .splines import clamped_symbolic, hermite
from .structure import FootGroup, Structure

SHORTEST_S = 0.1
"""No phase gets shorter than this [s]."""


_Key = tuple[tuple[str, int], ...]
"""Kinds of the phases that a node may be in, each with its number of force coefficients."""


def ordered(structure: Structure) -> Constraint | None:
    """Every phase lasts, and no switching time leaves its slack; in seconds. None where timings are fixed."""
    rows, lower, upper = [], [], []
    slack, layout = structure.settings.switch_slack_s, structure.layout
    for foot in layout.feet:
        if not len(foot.switches):
            return None
        own = layout.entry_rows(foot.switches)
        rows += [own, csr_array(own[1:] - own[:-1])]
        lasting = np.diff(foot.phases.switches_s)
        lower += [foot.phases.switches_s - slack, np.minimum(SHORTEST_S, lasting)]
        upper += [foot.phases.switches_s + slack, np.full(len(lasting), np.inf)]
    return Constraint("durations", np.concatenate(lower), np.concatenate(upper), (), csr_array(vstack(rows)))


def moving_groups(structure: Structure) -> tuple[FootGroup, ...]:
    """All feet at all nodes, grouped by the phases that they may be in."""
    found: dict[_Key, list[tuple[int, int, Index]]] = {}
    for foot, entries in enumerate(structure.layout.feet):
        for node, time in enumerate(structure.times_s):
            candidates = _candidates(entries, float(time), structure.settings.switch_slack_s)
            key, columns = _columns(entries, candidates)
            found.setdefault(key, []).append((foot, node, columns))
    return tuple(_moving_group(structure, key, members) for key, members in found.items())


def _candidates(entries: FootEntries, time: float, slack: float) -> list[int]:
    """Numbers of the phases that may hold at a time: one or two that follow each other."""
    edges = entries.phases.edges_s
    low = np.concatenate([[-np.inf], edges[1:-1] - slack, [np.inf]])
    high = np.concatenate([[-np.inf], edges[1:-1] + slack, [np.inf]])
    return [k for k in range(len(edges) - 1) if low[k] < time + 1e-9 and time - 1e-9 < high[k + 1]]


def _columns(entries: FootEntries, candidates: list[int]) -> tuple[_Key, Index]:
    """Key of the group, and the entries of its variables, phase by phase; NOTHING for what is 0 or a constant."""
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
            columns += [entries.stances[index], entries.stances[index + 1], entries.swings[index],
                        switches[number : number + 2]]  # fmt: skip
    return tuple(key), np.concatenate(columns)


def _moving_group(structure: Structure, key: _Key, members: list[tuple[int, int, Index]]) -> FootGroup:
    foot, node = np.array([member[:2] for member in members]).T
    plain = structure.entries("moving", np.array([member[2] for member in members]))
    times = structure.times_s[node][:, None]
    signal = _signal(key, plain.signal, structure.task.duration_s)
    family = Family("moving feet", plain.rows, plain.width, structure.chart.foot_map, signal, times)
    return FootGroup(family, foot, node, any(kind != "swing" for kind, _ in key))


def _signal(key: _Key, inner: Callable[[cs.SX, cs.SX], cs.SX], duration_s: float) -> Callable[[cs.SX, cs.SX], cs.SX]:
    """(p̄, f̄) at a node: of its one phase, or of the first until the switch and of the second from it on."""

    def signal(v: cs.SX, constants: cs.SX) -> cs.SX:
        at, time = inner(v, constants), constants[0]
        first = 0
        found, begins = [], []
        for kind, coefficients in key:
            width = 14 if kind == "swing" else 5 + 3 * coefficients
            own = at[first : first + width]
            first += width
            begin = cs.SX(0.0) if kind == "first" else own[width - 2]
            end = cs.SX(duration_s) if kind == "last" else own[width - 1]
            found.append(_swinging(own, time, begin, end) if kind == "swing" else _standing(own, time, begin, end))
            begins.append(begin)
        result = found[0]
        for begin, phase in zip(begins[1:], found[1:], strict=True):
            result = cs.if_else(time < begin, result, phase)
        return result

    return signal


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
