"""Sure footing: the ground about every place where a foot stands is no steeper than friction holds,
with some in hand.

Pan et al. have no such term. A foot that comes down a centimetre off its place on the edge of a
stair finds ground that is steeper than where it was sent, slips, and a robot that stands on two
feet falls. So the slope is limited about a place, and not in it alone: ‖∇h(p_xy + d)‖ ≤ σ for d = 0
and four others around it. Feet that stick may stand anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
from scipy.sparse import csr_array

from ...answer.trajectory import OFF_M
from ...files.arrays import Array
from ...problem.walk import Walk
from ...terrain.heightfield import HeightField
from ..charts.warped import Chart
from ..transcription.taylor import (
    Block,
    Constraint,
    ExpansionPoint,
    Features,
    Kernel,
    Rows,
    TaylorMap,
    VariableGroup,
)
from ..variables import Structure, hermite


def reach(structure: Structure) -> Constraint:
    """Rᵀ (p_i − p) ∈ R_i at all nodes [m] (W4, W10), of standing and swinging feet, with a margin
    in hand.
    """
    margin, feet = structure.settings.reach_margin_m, structure.task.robot.feet
    low = np.array([foot.reach_min_m + margin for foot in feet])
    high = np.array([foot.reach_max_m - margin for foot in feet])
    count, blocks = 0, list[Block]()
    for group in structure.feet_at_nodes:
        scatter = 3 * (count + np.arange(len(group.foot)))[:, None] + np.arange(3)
        blocks.append(
            Block(
                within(structure.chart),
                (group.selection(), structure.torso_at(group.node)),
                scatter,
            )
        )
        count += len(group.foot)
    foot = np.concatenate([group.foot for group in structure.feet_at_nodes])
    return Constraint("reach", low[foot].ravel(), high[foot].ravel(), tuple(blocks))


def within(chart: Chart) -> Kernel:
    """Rᵀ (p_i − p) of a foot, in the torso's frame."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot, torso), (at_foot, at_torso) = features, expansions
        p, r = chart.torso(torso, at_torso)
        return r.T @ (chart.foot(foot[:3], at_foot) - p)

    return kernel


def swing(structure: Structure) -> Constraint:
    """Swinging feet on or above the terrain, rows of all swings [m] (W3, W8)."""
    return _flat_swing(structure) if structure.chart.flat else _curved_swing(structure)


def _flat_swing(structure: Structure) -> Constraint:
    """W8: z̄_m ≥ clearance and 3 z̄_m ± v̄_z T/2 ≥ 0 for each swing."""
    variables, count = swings(structure)
    rows = np.arange(count)
    block = Block(_half_way, ((variables, rows),), 3 * rows[:, None] + np.arange(3))
    lower = np.tile([structure.settings.clearance_m, 0.0, 0.0], count)
    return Constraint("swing", lower, np.full(3 * count, np.inf), (block,))


def _half_way(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
    """(z̄_m, 3 z̄_m + v̄_z T/2, 3 z̄_m − v̄_z T/2) of one swing."""
    (at,) = features
    height, rise = at[8], 0.5 * at[12] * at[11]
    return cs.vertcat(height, 3.0 * height + rise, 3.0 * height - rise)


def _curved_swing(structure: Structure) -> Constraint:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps:
    """T pairs of things that are inside each other, each at a node of the program.

    Arguments:
        node: shape (T,).
        feet: the two that it depends on, shape (T, 2), twice the same where it is one.
        depth_m: shape (T,).
        feet_m: r₀ of both in the torso's frame, shape (T, 2, 3) [m].
        by_foot: the depth's derivatives, (T, 2, 3), the second 0 where it is one foot.
        torso_m, rotation: p₀ and R₀, (T, 3) [m], (T, 3, 3).
        by_torso: derivatives in p and in a turn about the torso's axes, shape (T, 6) [1, m/rad].
    """

    node: Rows
    feet: Rows
    depth_m: Array
    feet_m: Array
    by_foot: Array
    torso_m: Array
    rotation: Array
    by_torso: Array

    def __len__(self) -> int:
        """T."""
        return len(self.node)

    def joined(self, other: Overlaps) -> Overlaps:
        """Both: what came apart stays so while others do."""
        return Overlaps(
            **{
                name: np.concatenate([getattr(self, name), getattr(other, name)])
                for name in self.__annotations__
            }
        )


def apart(structure: Structure, overlaps: Overlaps, room_m: float) -> Constraint | None:
    """−depth ≥ room_m [m] of these pairs; None where there is none."""
    numbers = np.concatenate(
        [overlaps.depth_m[:, None]]
        + [
            getattr(overlaps, name).reshape(len(overlaps), -1)
            for name in ("by_foot", "feet_m", "by_torso", "torso_m", "rotation")
        ],
        axis=1,
    )
    blocks, count, no_variables = list[Block](), 0, csr_array((0, structure.layout.size))
    for one in structure.feet_at_nodes:
        first, rows = one.find(overlaps.feet[:, 0], overlaps.node)
        for other in structure.feet_at_nodes:
            second, columns = other.find(overlaps.feet[rows, 1], overlaps.node[rows])
            if not len(columns):
                continue
            known = VariableGroup(
                "overlaps", no_variables, 0, None, known_alone, numbers[rows[columns]]
            )
            selections = (
                one.selection(first[columns]),
                other.selection(second),
                structure.torso_at(overlaps.node[rows[columns]]),
                (known, np.arange(len(columns))),
            )
            blocks.append(
                Block(gap(structure.chart), selections, count + np.arange(len(columns))[:, None])
            )
            count += len(columns)
    return (
        Constraint("bodies", np.full(count, room_m), np.full(count, np.inf), tuple(blocks))
        if count
        else None
    )


def gap(chart: Chart) -> Kernel:
    """−depth of two feet, a torso, and the numbers of ``Overlaps``."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (*feet, torso, known), (*at_feet, at_torso, _) = features, expansions
        depth, by_foot, feet_m, by_torso, torso_m, rotation = cs.vertsplit(
            known, [0, 1, 7, 13, 19, 22, 31]
        )
        p, r = chart.torso(torso, at_torso)
        value = depth + cs.dot(by_torso[:3], p - torso_m)
        turn = cs.reshape(rotation, 3, 3) @ r  # row by row, so that it is R₀ᵀ R
        value += 0.5 * cs.dot(
            by_torso[3:],
            cs.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]),
        )
        for k, (foot, at_foot) in enumerate(zip(feet, at_feet, strict=True)):
            of = slice(3 * k, 3 * k + 3)
            value += cs.dot(by_foot[of], r.T @ (chart.foot(foot[:3], at_foot) - p) - feet_m[of])
        return -value

    return kernel


def known_alone(v: cs.SX, constants: cs.SX) -> cs.SX:
    """The feature of what has constants and no variables."""
    return constants


SHARE = 0.6
"""The usual share of the slope on which friction holds that ground about feet may have."""
_NEAREST_M, _FINE_M = 0.12, 0.01
"""Distance that a guess's foot may move to where it has sure footing, and how finely places are
looked at."""
_AROUND = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])


def footing(structure: Structure) -> Constraint | None:
    """σ² − ‖∇h‖² ≥ 0, five rows for each place of a foot that does not stick; None where nothing is
    asked for.
    """
    task, chart = structure.task, structure.chart
    feet = [
        foot.stances
        for foot, sticks in zip(structure.layout.feet, task.adhesive, strict=True)
        if not sticks
    ]
    if not structure.settings.footing or not feet:
        return None
    limit = structure.settings.footing * task.friction
    entries = np.concatenate(feet)
    every, ground = np.tile(entries, (len(_AROUND), 1)), TaylorMap.of_heights(task.terrain)
    plain = structure.entries("footing", every, True)

    def features(v: cs.SX, off_m: cs.SX) -> cs.SX:
        return cs.vertcat(plain.features(v, off_m), off_m)

    def place(feature: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        return chart.foot(feature[:3], expansion)[:2] + feature[3:]

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (below,) = expansions[-1:]
        assert below is not None
        return limit**2 - cs.sumsqr(below.here[1])

    there = replace(
        plain,
        map=ground,
        inner=chart.foot_map,
        place=place,
        features=features,
        constants=np.repeat(OFF_M * _AROUND, len(entries), axis=0),
    )
    rows = np.arange(there.count)
    block = Block(kernel, ((there, rows),), rows[:, None])
    return Constraint("footing", np.zeros(there.count), np.full(there.count, np.inf), (block,))


def sure_xy(task: Walk, share: float, xy: Array) -> Array:
    """The places nearest to others, shape (K, 2) [m], that are sure; the same where none is near.

    Arguments:
        share: of the slope on which friction holds, as ``GaitSettings.footing``.
    """
    limit, domain = share * task.friction, np.transpose(task.terrain.domain_m)
    places = np.clip(xy, *domain)
    unsure = np.flatnonzero(slope_about(task.terrain, places) > limit)
    line = _FINE_M * np.arange(-round(_NEAREST_M / _FINE_M), round(_NEAREST_M / _FINE_M) + 1)
    offs = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    offs = offs[np.argsort(np.linalg.norm(offs, axis=1), kind="stable")]
    near = np.clip(xy[unsure, None] + offs, *domain)
    first = np.argmax(slope_about(task.terrain, near) <= limit, axis=1)  # 0, itself, for none
    places[unsure] = near[np.arange(len(unsure)), first]
    return np.asarray(places)


def slope_about(terrain: HeightField, xy: Array) -> Array:
    """‖∇h‖ where it is largest in a place and those about it, shape (…, 2) [m] → (…)."""
    about = np.clip(xy[..., None, :] + OFF_M * _AROUND, *np.transpose(terrain.domain_m))
    return np.asarray(np.linalg.norm(terrain.gradient(about), axis=-1).max(axis=-1))
