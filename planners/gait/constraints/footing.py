"""Sure footing: the ground about every place where a foot stands is no steeper than friction holds,
with some in hand.

Pan et al. have no such term. A foot that comes down a centimetre off its place on the edge of a
stair finds ground that is steeper than where it was sent, slips, and a robot that stands on two
feet falls. So the slope is limited about a place, and not in it alone: ‖∇h(p_xy + d)‖ ≤ σ for d = 0
and four others around it. Feet that stick may stand anywhere.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np

from ...answer.trajectory import OFF_M
from ...files.arrays import Array
from ...problem.walk import Walk
from ...terrain.heightfield import HeightField
from ..transcription.blocks import Block, Constraint
from ..transcription.taylor import ExpansionPoint, TaylorMap
from ..variables import Structure

SHARE = 0.6
"""The usual share of the slope on which friction holds that ground about feet may have."""
NEAREST_M, FINE_M = 0.12, 0.01
"""Distance that a guess's foot may move to where it has sure footing, and how finely places are
looked at."""
AROUND = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])


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
    every, ground = np.tile(entries, (len(AROUND), 1)), TaylorMap.of_heights(task.terrain)
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
        constants=np.repeat(OFF_M * AROUND, len(entries), axis=0),
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
    line = FINE_M * np.arange(-round(NEAREST_M / FINE_M), round(NEAREST_M / FINE_M) + 1)
    offs = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    offs = offs[np.argsort(np.linalg.norm(offs, axis=1), kind="stable")]
    near = np.clip(xy[unsure, None] + offs, *domain)
    first = np.argmax(slope_about(task.terrain, near) <= limit, axis=1)  # 0, itself, for none
    places[unsure] = near[np.arange(len(unsure)), first]
    return np.asarray(places)


def slope_about(terrain: HeightField, xy: Array) -> Array:
    """‖∇h‖ where it is largest in a place and those about it, shape (…, 2) [m] → (…)."""
    about = np.clip(xy[..., None, :] + OFF_M * AROUND, *np.transpose(terrain.domain_m))
    return np.asarray(np.linalg.norm(terrain.gradient(about), axis=-1).max(axis=-1))
