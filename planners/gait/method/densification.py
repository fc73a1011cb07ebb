"""Densification: where the verifier finds fault between the nodes, the program gets rows there, and
is solved again.

Balances and reach are asked for half-way between the nodes, only where they were broken; the
trunk's clearance, the checks of a swing and the reach in hand grow by what was missed.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...files.arrays import Array
from ...verify.trajectory_measurements import TrajectoryMeasurements
from ..constraints.bodies import Overlaps, apart
from ..constraints.dynamics import dynamics
from ..constraints.reach import reach
from ..constraints.torque import LegLoads, torque
from ..formulation import terms
from ..gait_program import GaitProgram
from ..task import GaitSettings
from ..transcription.blocks import Block, Constraint
from ..variables.structure import Structure
from .leg_loads import leg_loads
from .leg_overlaps import leg_overlaps

Flags = NDArray[np.bool_]
BAND = 0.06
"""What a balance may be off half-way between nodes where it is asked for [m·g, m·g·stand height];
shrinks each time."""
BALANCES = frozenset(
    (
        "force_balance",
        "force_peak",
        "moment_balance",
        "moment_peak",
        "impulse",
        "angular_impulse",
        "angular_residual",
        "traction",
        "traction_impulse",
        "traction_way",
        "traction_turn",
    )
)
"""Groups that are kept by the balances half-way between nodes."""
WINDOWS = frozenset(
    ("impulse", "angular_impulse", "traction_impulse", "traction_way", "traction_turn")
)
"""Groups that add up over time."""
LEAST_BAND = 0.01
"""Nothing narrower is asked for where no balance is off by more."""
APART_M = 0.003
"""Links that went through something are asked to be so far off it."""
FLAW = 1.5
"""A balance is asked for where it is off by this many bands."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Checks:
    """Rows half-way between nodes.

    Arguments:
        balance: in which steps, shape (N,), N steps.
        reach: of which feet, shape (N, E).
        band: what the balance may be off there.
        loads: of joints at the nodes themselves that have to give less.
        overlaps: of links there that have to come apart.
    """

    balance: Flags
    reach: Flags
    band: float = BAND
    loads: LegLoads | None = None
    overlaps: Overlaps | None = None

    def joined(self, other: Checks) -> Checks:
        """Both, with the narrower band, and the other's loads, which are about a later point."""
        overlaps = other.overlaps or self.overlaps
        if self.overlaps is not None and other.overlaps is not None:
            overlaps = self.overlaps.joined(other.overlaps)
        return Checks(
            balance=self.balance | other.balance,
            reach=self.reach | other.reach,
            band=min(self.band, other.band),
            loads=other.loads or self.loads,
            overlaps=overlaps,
        )

    def __len__(self) -> int:
        """Number of balances and reaches that are asked for."""
        more = sum(len(group) for group in (self.loads, self.overlaps) if group is not None)
        return int(self.balance.sum() + self.reach.sum()) + more


class DenseProgram(GaitProgram):
    """A program with the rows of ``checks`` besides its own; its variables are the same."""

    def __init__(self, base: GaitProgram, settings: GaitSettings, checks: Checks) -> None:
        self.checks = checks
        structure = Structure(base.task, settings, base.structure.chart)
        super().__init__(
            base.task, settings, structure, [*terms(structure), *half_way(structure, checks)]
        )


def densified(program: GaitProgram, report: Report[Trajectory]) -> DenseProgram | None:
    """The program with what a refused trajectory asks for; None where no more rows would help."""
    settings = tightened(program.settings, report)
    band = BAND
    checks = dense = flaws(program, report, band)
    while (
        BALANCES & {group.name for group in report.refused}
        and not dense.balance.any()
        and band > LEAST_BAND
    ):
        band *= 0.5  # a window adds up what no moment shows
        checks = dense = flaws(program, report, band)
    if isinstance(program, DenseProgram):
        checks = replace(program.checks.joined(dense), band=0.7 * program.checks.band)
    if settings == program.settings and not len(dense):
        return None
    return DenseProgram(program, settings, checks)


def tightened(settings: GaitSettings, report: Report[Trajectory]) -> GaitSettings:
    """Settings with more in hand where the report's groups break their limits."""
    missed = {group.name: group.value for group in report.refused}
    if "trunk" in missed:
        before = settings.trunk_clearance_m
        clearance = 0.02 if before is None else before + missed["trunk"] + 0.002
        settings = replace(settings, trunk_clearance_m=clearance)
    if missed.keys() & {"penetration", "penetration_between"}:
        settings = replace(settings, swing_nodes=settings.swing_nodes + 4)
    if missed.keys() & {"lift", "clearance", "drag"}:
        settings = replace(settings, clearance_m=settings.clearance_m + 0.01)
    if missed.keys() & WINDOWS and settings.dynamics == "centred":
        settings = replace(settings, mean_forces=True)
    if "reach" in missed:
        settings = replace(
            settings, reach_margin_m=min(settings.reach_margin_m + missed["reach"], 0.03)
        )
    return settings


def flaws(program: GaitProgram, report: Report[Trajectory], band: float = BAND) -> Checks:
    """In which steps of the program's grid a trajectory's balances and reach are off."""
    measured, broken = (
        TrajectoryMeasurements(report.answer),
        {group.name for group in report.refused},
    )
    steps, feet = program.structure.nodes - 1, program.structure.feet
    balance, arms = np.zeros(steps, dtype=bool), np.zeros((steps, feet), dtype=bool)
    if broken & BALANCES:
        for series, scale in (
            (measured.force_residual(), measured.weight_n),
            (measured.moment_residual(), measured.moment_scale_nm),
        ):
            off = np.linalg.norm(series.values, axis=1) > FLAW * band * scale
            balance[_steps(series.times_s[off], program)] = True
    if "reach" in broken:
        series = measured.reach()
        samples, columns = np.nonzero(series.values > 0.5 * report.limits["reach_m"])
        arms[_steps(series.times_s[samples], program), columns] = True
    loads = leg_loads(program.structure, report) if "torque" in broken else None
    overlaps = leg_overlaps(program.structure, report) if "bodies" in broken else None
    return Checks(balance=balance, reach=arms, band=band, loads=loads, overlaps=overlaps)


def _steps(times_s: Array, program: GaitProgram) -> NDArray[np.intp]:
    steps = np.floor(np.asarray(times_s) / program.settings.step_s + 1e-9).astype(np.intp)
    return np.asarray(np.clip(steps, 0, program.structure.nodes - 2), dtype=np.intp)


# ----------------------------------------------------------------------------------------------------
# the rows


def half_way(structure: Structure, checks: Checks) -> list[Constraint]:
    """The terms of the dynamics and of reach with nodes half-way between the structure's, as far as
    asked for.
    """
    between = copy(structure)
    for name in ("torso", "feet_at_nodes"):
        between.__dict__.pop(name, None)
    between.mean_s = 0.0  # what is asked for here is the balance of the moment
    between.times_s = structure.times_s[:-1] + 0.5 * structure.settings.step_s
    constraints: list[Constraint] = []
    inner = checks.balance.copy()
    inner[[0, -1]] = False  # they have no neighbour on the other side
    if inner.any() and structure.settings.dynamics == "centred":
        balances = dynamics(between)
        band = checks.band * np.ones(balances.rows)
        nodes = np.repeat(inner, 6)[: balances.rows]
        constraints.append(
            restricted(replace(balances, name="balance", lower=-band, upper=band), nodes)
        )
    if checks.reach.any():
        foot = np.concatenate([group.foot for group in between.feet_at_nodes])
        node = np.concatenate([group.node for group in between.feet_at_nodes])
        constraints.append(restricted(reach(between), np.repeat(checks.reach[node, foot], 3)))
    if checks.loads is not None and (rows := torque(structure, checks.loads)) is not None:
        constraints.append(rows)
    if (
        checks.overlaps is not None
        and (rows := apart(structure, checks.overlaps, APART_M)) is not None
    ):
        constraints.append(rows)
    return constraints


def restricted(constraint: Constraint, kept: Flags) -> Constraint:
    """Some rows of a constraint without a linear part, shape of ``kept``: (rows,); blocks without
    rows are gone.
    """
    number = np.cumsum(kept) - 1
    blocks: list[Block] = []
    for block in constraint.blocks:
        chosen = np.flatnonzero(kept[block.scatter].all(axis=1))
        if len(chosen):
            selections = tuple((variables, rows[chosen]) for variables, rows in block.selections)
            blocks.append(
                replace(block, selections=selections, scatter=number[block.scatter[chosen]])
            )
    return replace(
        constraint, lower=constraint.lower[kept], upper=constraint.upper[kept], blocks=tuple(blocks)
    )
