"""Swinging feet above the terrain (W3 and W8), in metres.

In a flat chart the height of a swing is two Hermite pieces from 0 to z̄_m and back, so z̄(t) ≥ 0
all along exactly when
|v̄_z| T/2 ≤ 3 z̄_m; else the height is asked for at nodes within the swing. Half-way a swing has the settings' clearance.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..transcription.blocks import Block, Constraint, Features, VariableGroup
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure, hermite


def swing(structure: Structure) -> tuple[Constraint, ...]:
    """Swinging feet on or above the terrain, rows of all swings [m] (W3, W8)."""
    if structure.chart.flat:
        return flat_swing(structure)
    return (curved_swing(structure),)


def flat_swing(structure: Structure) -> tuple[Constraint, ...]:
    """W8: z̄_m ≥ clearance and 3 z̄_m ± v̄_z T/2 ≥ 0 for each swing."""
    variables, count = swings(structure)
    rows = np.arange(count)
    block = Block(half_way, ((variables, rows),), 3 * rows[:, None] + np.arange(3))
    lower = np.tile([structure.settings.clearance_m, 0.0, 0.0], count)
    return (Constraint("swing", lower, np.full(3 * count, np.inf), (block,)),)


def half_way(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
    """(z̄_m, 3 z̄_m + v̄_z T/2, 3 z̄_m − v̄_z T/2) of one swing."""
    (at,) = features
    height, rise = at[8], 0.5 * at[12] * at[11]
    return cs.vertcat(height, 3.0 * height + rise, 3.0 * height - rise)


def curved_swing(structure: Structure) -> Constraint:
    """W3: z − h(x, y) ≥ 0 at the settings' number of nodes in each half of a swing, and
    half-way.
    """
    variables, count = swings(structure)
    within = structure.settings.swing_nodes
    half = np.arange(1, within + 1) / (2.0 * (within + 1.0))
    shares = [*half, *(0.5 + half)]
    blocks, rows = [], np.arange(count)
    for at, share in enumerate([*shares, 0.5]):
        placed = VariableGroup(
            "swing node",
            variables.rows,
            variables.width,
            structure.chart.foot_map,
            _at_share(share, variables),
            variables.constants,
        )
        blocks.append(Block(above, ((placed, rows),), at * count + rows[:, None]))
    lower = np.zeros(count * (len(shares) + 1))
    lower[-count:] = structure.settings.clearance_m
    return Constraint("swing", lower, np.full(len(lower), np.inf), tuple(blocks))


def above(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
    """z − h(x, y)."""
    (foot,), (expansion,) = features, expansions
    assert expansion is not None
    return foot[2] - expansion.here[0]


def _at_share(share: float, variables: VariableGroup) -> Features:
    """The foot at a share of its swing's time, from the swing's variables."""
    piece, rest = divmod(2.0 * share, 1.0)
    start, start_speed, stop, stop_speed = hermite(rest)

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        at = variables.features(v, constants)
        lift, middle, speed, touch, half = at[:3], at[6:9], at[9:12], at[3:6], 0.5 * at[12]
        if piece == 0:
            return cs.SX(start * lift + stop * middle + half * stop_speed * speed)
        return cs.SX(start * middle + half * start_speed * speed + stop * touch)

    return features


def swings(structure: Structure) -> tuple[VariableGroup, int]:
    """(lift-off, touchdown, place and velocity half-way, time T) of all swings, shape (13)."""
    entries, lasting = [], []
    for foot in structure.layout.feet:
        for index in range(foot.phases.swings):
            entries.append(
                np.concatenate([foot.stances[index], foot.stances[index + 1], foot.swings[index]])
            )
            if len(foot.switches):
                entries[-1] = np.append(entries[-1], foot.switches[2 * index : 2 * index + 2])
            begin, end = foot.phases.swing(index)
            lasting.append(end - begin)
    variables = structure.entries("swings", np.array(entries))
    optimised, inner = entries[0].size > 12, variables.features

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        at = inner(v, constants)
        return cs.vertcat(at[:12], at[13] - at[12] if optimised else constants[0])

    constants = np.array(lasting)[:, None]
    return VariableGroup("swings", variables.rows, variables.width, None, features, constants), len(
        entries
    )
