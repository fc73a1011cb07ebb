"""The torso's equations of motion: PCDM, centred or as printed (W11), and Newton and Euler's (W2).

Rows of a node: three of the force balance in units of m·g, three of the moment balance about the
centre of mass in units of m·g·(stand height), in world axes. W11 omits gravity in print; it is
here.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ...files.arrays import Array
from ...physics import GRAVITY_M_S2
from ...robot.model import Robot
from ..charts.warped import Chart
from ..transcription.blocks import Block, Constraint, Kernel, Rows, Selection, VariableGroup
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure

UP = (0.0, 0.0, 1.0)


def dynamics(structure: Structure) -> Constraint:
    """Σ f_i = m (p̈ − g) and Σ (p_i − p) × f_i = d/dt (R I ω) at all nodes (W2, W11).

    Six rows a node, world axes: forces in m·g, moments in m·g·(stand height); by the form that the
    settings ask for.
    """
    form, count = structure.settings.dynamics, structure.nodes
    nodes = np.arange(count)
    if form == "centred" and not structure.settings.still_end:
        nodes = nodes[:-1]
    scatter = 6 * nodes[:, None] + np.arange(6)
    blocks = [inertia_block(structure, nodes, scatter)]
    for group in structure.feet_at_nodes:
        chosen = np.flatnonzero(group.pushes & np.isin(group.node, nodes))
        if len(chosen):
            blocks.append(
                Block(
                    wrench(structure.chart, structure.task.robot),
                    (group.selection(chosen), structure.torso_at(group.node[chosen])),
                    6 * group.node[chosen][:, None] + np.arange(6),
                )
            )
    zeros = np.zeros(6 * len(nodes))
    return Constraint("dynamics", zeros, zeros, tuple(blocks))


def inertia_block(structure: Structure, nodes: Rows, scatter: Rows) -> Block:
    """Rows of the torso's motion: −m (p̈ − g) and −d/dt (R I ω) at nodes."""
    form, chart, robot, step_s = (
        structure.settings.dynamics,
        structure.chart,
        structure.task.robot,
        structure.settings.step_s,
    )
    if form == "newton-euler":
        return Block(
            newton_euler(chart, robot), (_moving_torso(structure, nodes),), scatter, order=3
        )
    offsets = (-1, 0, 1) if form == "centred" else (-2, -1, 0)
    selections = tuple(structure.torso_at(nodes + offset) for offset in offsets)
    return Block(
        (centred if form == "centred" else printed)(chart, robot, step_s), selections, scatter
    )


def wrench(chart: Chart, robot: Robot) -> Kernel:
    """(f_i, (p_i − p) × f_i) of a standing foot."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot, torso), (at_foot, at_torso) = features, expansions
        p_i = chart.foot(foot[:3], at_foot)
        f_i = chart.force(foot[3:], foot[:3], at_foot)
        p, _ = chart.torso(torso, at_torso)
        return cs.vertcat(f_i, cs.cross(p_i - p, f_i) / robot.stand_height_m)

    return kernel


def centred(chart: Chart, robot: Robot, step_s: float) -> Kernel:
    """PCDM (W11) about the node: p̈ ≈ (p₊ − 2 p + p₋) / Δt², and ∫ ρ R x × (R₊ + R₋) x dv / Δt² for
    the moment.
    """

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (p_old, r_old), (p, r), (p_new, r_new) = _torsos(chart, features, expansions)
        felt = (p_new - 2.0 * p + p_old) / (step_s**2 * GRAVITY_M_S2) + cs.DM(UP)
        spun = axial(r @ cs.DM(_moment(robot, step_s)) @ (r_new + r_old).T)
        return -cs.vertcat(felt, spun)

    return kernel


def printed(chart: Chart, robot: Robot, step_s: float) -> Kernel:
    """W11: p̈ ≈ (p − 2 p₋ + p₋₋) / Δt², and ∫ ρ (2 R₋ − R₋₋) x × R x dv / Δt² for the moment."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (p_older, r_older), (p_old, r_old), (p, r) = _torsos(chart, features, expansions)
        felt = (p - 2.0 * p_old + p_older) / (step_s**2 * GRAVITY_M_S2) + cs.DM(UP)
        spun = axial((2.0 * r_old - r_older) @ cs.DM(_moment(robot, step_s)) @ r.T)
        return -cs.vertcat(felt, spun)

    return kernel


def newton_euler(chart: Chart, robot: Robot) -> Kernel:
    """W2 of (p̄, θ̄) and its first two derivatives, shape (18), pushed forward along the chart."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (state,), (expansion,) = features, expansions
        time = cs.SX.sym("t")
        p, r = chart.torso(state[:6] + time * state[6:12] + 0.5 * time**2 * state[12:], expansion)
        speed, turning = cs.jacobian(p, time), cs.reshape(cs.jacobian(cs.vec(r), time), 3, 3)
        acceleration, turned = (
            cs.jacobian(speed, time),
            cs.reshape(cs.jacobian(cs.vec(turning), time), 3, 3),
        )
        r_0, turning, turned, acceleration = (
            cs.substitute(term, time, 0.0) for term in (r, turning, turned, acceleration)
        )
        omega, alpha = _vee(r_0.T @ turning), _vee(r_0.T @ turned)
        inertia = cs.DM(np.asarray(robot.inertia_kgm2))
        moment = r_0 @ (inertia @ alpha + cs.cross(omega, inertia @ omega))
        scale = robot.mass_kg * GRAVITY_M_S2 * robot.stand_height_m
        return -cs.vertcat(acceleration / GRAVITY_M_S2 + cs.DM(UP), moment / scale)

    return kernel


def _moving_torso(structure: Structure, nodes: Rows) -> Selection:
    """(p̄, θ̄) with its first and second derivative at nodes."""
    parts = [structure.layout.torso_rows(structure.times_s[nodes], order) for order in range(3)]
    columns = 6 * np.arange(len(nodes))[:, None] + np.arange(6)
    index = np.concatenate([columns + k * 6 * len(nodes) for k in range(3)], axis=1)
    rows = csr_array(csr_array(vstack(parts))[index.ravel()])
    return VariableGroup("moving torso", rows, 18, structure.chart.torso_map), np.arange(len(nodes))


def _torsos(
    chart: Chart, features: Sequence[cs.SX], expansions: Sequence[ExpansionPoint | None]
) -> list[tuple[cs.SX, cs.SX]]:
    return [chart.torso(feature, at) for feature, at in zip(features, expansions, strict=True)]


def _moment(robot: Robot, step_s: float) -> Array:
    """C / Δt² in units of m·g·(stand height), of C = ∫ ρ x xᵀ dv = ½ tr(I) Id − I."""
    scale = robot.weight_n * robot.stand_height_m
    inertia = np.asarray(robot.inertia_kgm2)
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return np.asarray(second / (scale * step_s**2))


def _vee(m: cs.SX) -> cs.SX:
    """Vector of the skew part of a matrix."""
    return 0.5 * cs.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])


def axial(m: cs.SX) -> cs.SX:
    """ε_ijk M_jk: ∫ ρ (A x) × (R x) dv for M = A C Rᵀ with C = ∫ ρ x xᵀ dv, shape (3, 1)."""
    return cs.vertcat(m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0])
