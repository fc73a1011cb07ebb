"""The torso's equations of motion: PCDM, centred or as printed (W11), and Newton and Euler's (W2).

Rows of a node: three of the force balance in units of m·g, three of the moment balance about the
centre of mass in units of m·g·(stand height), in world axes. W11 omits gravity in print; it is
here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ...files.arrays import Array
from ...physics import GRAVITY_M_S2
from ...robot.model import Robot
from ..charts.warped import Chart
from ..method.guess import GuessedWalk
from ..transcription.taylor import (
    Block,
    Constraint,
    ExpansionPoint,
    Kernel,
    Rows,
    Selection,
    TaylorMap,
    VariableGroup,
)
from ..variables import NOTHING, Index, Structure
from .feet import above, known_alone


@dataclass(frozen=True, kw_only=True, eq=False)
class LegLoads:
    """T joints of standing legs, each at a node of the program.

    Arguments:
        foot, node: shape (T,).
        at_m: r₀, the foot in the torso's frame, shape (T, 3) [m].
        levers_m: J_j(r₀), (T, 3) [m or m/rad].
        slopes: ∂J_j, (T, 3, 3).
        rest_nm: shape (T,).
        most_nm: what the joint may give, shape (T,) [Nm].
    """

    foot: Rows
    node: Rows
    at_m: Array
    levers_m: Array
    slopes: Array
    rest_nm: Array
    most_nm: Array

    def __len__(self) -> int:
        """T."""
        return len(self.foot)


def torque(structure: Structure, loads: LegLoads) -> Constraint | None:
    """−1 ≤ τ_j / most_j ≤ 1 of these joints; None where there is none."""
    blocks, count = list[Block](), 0
    weight = structure.task.robot.weight_n
    numbers = (
        np.concatenate(
            [loads.rest_nm[:, None], weight * loads.levers_m, weight * loads.slopes.reshape(-1, 9)],
            axis=1,
        )
        / loads.most_nm[:, None]
    )
    numbers = np.concatenate([numbers, loads.at_m], axis=1)
    no_variables = csr_array((0, structure.layout.size))
    for group in structure.feet_at_nodes:
        chosen, rows = group.find(loads.foot, loads.node)
        if not (group.pushes and len(rows)):
            continue
        known = VariableGroup("leg loads", no_variables, 0, None, known_alone, numbers[rows])
        selections = (
            group.selection(chosen),
            structure.torso_at(group.node[chosen]),
            (known, np.arange(len(rows))),
        )
        scatter = count + np.arange(len(rows))[:, None]
        blocks.append(Block(given(structure.chart), selections, scatter))
        count += len(rows)
    return Constraint("torque", -np.ones(count), np.ones(count), tuple(blocks)) if count else None


def given(chart: Chart) -> Kernel:
    """τ_j / most_j of a foot, a torso, and (rest, J, ∂J, r₀), the first three by most_j."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot, torso, known), (at_foot, at_torso, _) = features, expansions
        p, r = chart.torso(torso, at_torso)
        moved = r.T @ (chart.foot(foot[:3], at_foot) - p) - known[13:]
        lever = known[1:4] + cs.reshape(known[4:13], 3, 3).T @ moved
        return known[0] - cs.dot(lever, r.T @ chart.force(foot[3:], foot[:3], at_foot))

    return kernel


_UP = (0.0, 0.0, 1.0)


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
    blocks = [_inertia_block(structure, nodes, scatter)]
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


def _inertia_block(structure: Structure, nodes: Rows, scatter: Rows) -> Block:
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
        felt = (p_new - 2.0 * p + p_old) / (step_s**2 * GRAVITY_M_S2) + cs.DM(_UP)
        spun = _axial(r @ cs.DM(_moment(robot, step_s)) @ (r_new + r_old).T)
        return -cs.vertcat(felt, spun)

    return kernel


def printed(chart: Chart, robot: Robot, step_s: float) -> Kernel:
    """W11: p̈ ≈ (p − 2 p₋ + p₋₋) / Δt², and ∫ ρ (2 R₋ − R₋₋) x × R x dv / Δt² for the moment."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (p_older, r_older), (p_old, r_old), (p, r) = _torsos(chart, features, expansions)
        felt = (p - 2.0 * p_old + p_older) / (step_s**2 * GRAVITY_M_S2) + cs.DM(_UP)
        spun = _axial((2.0 * r_old - r_older) @ cs.DM(_moment(robot, step_s)) @ r.T)
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
        return -cs.vertcat(acceleration / GRAVITY_M_S2 + cs.DM(_UP), moment / scale)

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


def _axial(m: cs.SX) -> cs.SX:
    """ε_ijk M_jk: ∫ ρ (A x) × (R x) dv for M = A C Rᵀ with C = ∫ ρ x xᵀ dv, shape (3, 1)."""
    return cs.vertcat(m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0])


def acceleration(structure: Structure) -> Block:
    """A part of E(c) (W1): ∫ ‖p̈/g‖² + ‖d/dt (R I ω)‖² dt as a sum over the nodes; one row."""
    nodes = np.arange(structure.nodes)
    inner = _inertia_block(structure, nodes, np.zeros((len(nodes), 1), dtype=np.intp))
    step_s = structure.settings.step_s

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        felt = -inner.kernel(features, expansions) - cs.DM([*_UP, 0.0, 0.0, 0.0])
        return step_s * cs.sumsqr(felt)

    return Block(kernel, inner.selections, inner.scatter, inner.order)


def force_rate(structure: Structure) -> csr_array:
    """Rows r with ‖r x‖² = Σ_i ∫ ‖d f̄_i/dt‖² dt, by the middles of the steps."""
    step_s = structure.settings.step_s
    middles = structure.times_s[:-1] + 0.5 * step_s
    rows = [structure.layout.force_rows(foot, middles, order=1) for foot in range(structure.feet)]
    return csr_array(np.sqrt(step_s) * vstack(rows))


def still_start(structure: Structure) -> Constraint:
    """The first three coefficients of the torso's spline are equal: velocity and acceleration are 0
    at the start.
    """
    return _still(structure, "still start", structure.layout.torso[:3])


def still_end(structure: Structure) -> Constraint | None:
    """The last three coefficients of the torso's spline are equal: velocity and acceleration are 0
    at the end. None where the settings do not ask for an end at rest.
    """
    return (
        _still(structure, "still end", structure.layout.torso[-3:])
        if structure.settings.still_end
        else None
    )


def start(structure: Structure) -> tuple[Constraint, Constraint]:
    """p_xy = start (metres) and heading = start yaw (radians) at t = 0."""
    yaw = structure.layout.entry_rows(structure.layout.torso[0, 5:])
    heading = np.array([structure.task.start_yaw_rad])
    return over(structure, "start", 0, structure.task.start), Constraint(
        "heading", heading, heading, (), yaw
    )


def goal(structure: Structure) -> Constraint:
    """p_xy = goal at t = T, in metres: a hard constraint (Pan et al. §V)."""
    return over(structure, "goal", structure.nodes - 1, structure.task.goal)


def heading_end(structure: Structure) -> Constraint | None:
    """heading = end yaw (radians) at t = T, where the task asks for one."""
    if structure.task.end_yaw_rad is None:
        return None
    heading = np.array([structure.task.end_yaw_rad])
    yaw = csr_array(structure.layout.torso_rows(structure.times_s[-1:])[[5]])
    return Constraint("heading end", heading, heading, (), yaw)


def poised(structure: Structure) -> Constraint | None:
    """Height, roll and pitch of the torso and every foot at t = 0 and t = T are those of the
    standing robot, where the settings ask for it. Where rows of other terms say so already, they
    are left out.
    """
    if not structure.settings.poised:
        return None
    task, layout, chart = structure.task, structure.layout, structure.chart
    rows, values = list[csr_array](), list[Array]()
    for xy, yaw, knot, stance in zip(
        (task.start, task.goal),
        task.yaws(),
        (layout.torso[0], layout.torso[-1]),
        (0, -1),
        strict=True,
    ):
        feet = task.stance_m(xy, yaw)
        torso = np.array([[*xy, feet[:, 2].mean() + task.robot.stand_height_m]])
        rows.append(layout.entry_rows(knot[2:5]))
        values.append(np.array([chart.torso_bar(torso)[0, 2], 0.0, 0.0]))
        for foot, place in zip(layout.feet, feet, strict=True):
            entries = foot.stances[stance]
            known = entries != NOTHING
            rows.append(layout.entry_rows(entries[known]))
            values.append(chart.foot_bar(place[None])[0][known])
    target = np.concatenate(values)
    return Constraint("poised", target, target, (), csr_array(vstack(rows)))


def over(structure: Structure, name: str, node: int, xy_m: Array) -> Constraint:
    """The torso over a point at a node."""
    block = Block(
        horizontal(structure.chart), (structure.torso_at(np.array([node])),), np.array([[0, 1]])
    )
    return Constraint(name, xy_m, xy_m, (block,))


def horizontal(chart: Chart) -> Kernel:
    """p_xy of the torso."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        return chart.torso(features[0], expansions[0])[0][:2]

    return kernel


def _still(structure: Structure, name: str, coefficients: Index) -> Constraint:
    rows = [
        structure.layout.entry_rows(coefficients[k]) - structure.layout.entry_rows(coefficients[1])
        for k in (0, 2)
    ]
    zeros = np.zeros(12)
    return Constraint(name, zeros, zeros, (), csr_array(vstack(rows)))


_SHORTEST_S = 0.1
"""No phase gets shorter than this [s]."""


def durations(structure: Structure) -> Constraint | None:
    """Every phase lasts, and no switching time leaves its slack; in seconds.

    None where timings are fixed.
    """
    rows, lower, upper = [], [], []
    slack, layout = structure.settings.switch_slack_s, structure.layout
    for foot in layout.feet:
        if not len(foot.switches):
            return None
        entry_rows = layout.entry_rows(foot.switches)
        rows += [entry_rows, csr_array(entry_rows[1:] - entry_rows[:-1])]
        lasting = np.diff(foot.phases.switches_s)
        lower += [foot.phases.switches_s - slack, np.minimum(_SHORTEST_S, lasting)]
        upper += [foot.phases.switches_s + slack, np.full(len(lasting), np.inf)]
    return Constraint(
        "durations", np.concatenate(lower), np.concatenate(upper), (), csr_array(vstack(rows))
    )


_TIP = 1e-3
"""ε, in units of m·g: a standing foot presses with ε/ν at least, but for the ends of its stance."""


def cone(structure: Structure) -> Constraint:
    """ν (f_n + s) − ‖f_t‖ ≥ 0 [m·g], a row for each free coefficient of a force (W5, W9)."""
    task = structure.task
    assert task.suction_n is not None
    entries, suctions = [], list[Array]()
    for number, foot in enumerate(structure.layout.feet):
        for index, forces in enumerate(foot.forces):
            free = forces[forces[:, 0] != NOTHING]
            entries.append(
                np.concatenate([np.broadcast_to(foot.stances[index], free.shape), free], axis=1)
            )
            suctions.append(
                np.full(
                    len(free),
                    task.suction_n / task.robot.weight_n if task.adhesive[number] else 0.0,
                )
            )
    plain = structure.entries("force coefficients", np.concatenate(entries), True)

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        return cs.vertcat(plain.features(v, constants), constants)

    variables = replace(plain, features=features, constants=np.concatenate(suctions)[:, None])
    rows = np.arange(variables.count)
    block = Block(_pressing(structure.chart, task.friction), ((variables, rows),), rows[:, None])
    inside = np.full(variables.count, structure.settings.tolerance)
    return Constraint("cone", inside, np.full(variables.count, np.inf), (block,))


def _pressing(chart: Chart, friction: float) -> Kernel:
    """ν (f_n + s) − √(‖f_t‖² + ε²) of (p̄_i, f̄_i, s)."""

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        (foot,), (expansion,) = features, expansions
        normal, tangential = chart.cone(foot[3:6], foot[:3], expansion)
        return friction * (normal + foot[6]) - cs.sqrt(cs.sumsqr(tangential) + _TIP**2)

    return kernel


def contact(structure: Structure) -> Constraint | None:
    """z_i − h(x_i, y_i) = 0 [m], one row for each place where a foot stands (W3); none in a flat
    chart (W8).
    """
    if structure.chart.flat:
        return None
    variables = structure.entries(
        "footholds", np.concatenate([foot.stances for foot in structure.layout.feet]), True
    )
    rows = np.arange(variables.count)
    zeros = np.zeros(variables.count)
    return Constraint("contact", zeros, zeros, (Block(above, ((variables, rows),), rows[:, None]),))


_SPACING_M = 0.09
"""Points of the lower face are at most this far apart along the trunk, and twice as far across."""
NEAR_M = 0.15
"""A point that stays higher over the ground than this in the guess, and all about it, gets no
row."""
_SINKING = 0.8
"""Share of the height which the guess gains on slopes, where it stands off along the normal, that
walks may give up."""
_AROUND_M = 0.2
"""Distance about a point of the guess at which the ground is looked at: a solution moves about as
far."""


def trunk(structure: Structure) -> Constraint | None:
    """Rows of points of the lower face near the ground at nodes, by turns; None where there is
    none, or no clearance is asked for.
    """
    margin = structure.settings.trunk_clearance_m
    if margin is None:
        return None
    points = lower_face(structure.task.robot.trunk_half_m)
    node, point = near(structure, points)
    if not len(node):
        return None
    chart = structure.chart

    def place(feature: cs.SX, expansion: ExpansionPoint | None) -> cs.SX:
        p, r = chart.torso(feature[:6], expansion)
        return p + r @ feature[6:9]

    def features(v: cs.SX, constants: cs.SX) -> cs.SX:
        return cs.vertcat(v, constants)

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        corner, below = (
            place(features[0], expansions[0] if len(expansions) > 1 else None),
            expansions[-1],
        )
        assert below is not None
        return corner[2] - below.here[0]

    rows = structure.layout.torso_rows(structure.times_s[node])
    ground = TaylorMap.of_heights(structure.task.terrain)
    variables = VariableGroup(
        "trunk", rows, 6, ground, features, points[point], chart.torso_map, place
    )
    every = np.arange(variables.count)
    block = Block(kernel, ((variables, every),), every[:, None])
    return Constraint(
        "trunk", np.full(variables.count, margin), np.full(variables.count, np.inf), (block,)
    )


def lower_face(half_m: Array) -> Array:
    """Points of the lower face of a box with these half sides, shape (P, 3) [m]."""
    along, across = (
        np.linspace(-side, side, max(2, 1 + int(np.ceil(2.0 * side / spacing))))
        for side, spacing in zip(half_m, (_SPACING_M, 2.0 * _SPACING_M), strict=False)
    )
    return np.array([(x, y, -half_m[2]) for x, y in product(along, across)])


def near(structure: Structure, points: Array) -> tuple[Rows, Rows]:
    """Nodes and points, each of shape (K,), at which the guess's lower face, and the plane that it
    goes on as within AROUND_M, comes nearer than NEAR_M to the ground, or a little more on slopes;
    of these every other one, as on a chessboard, since neighbours in time and place know nearly the
    same.
    """
    p, rotation = GuessedWalk(structure).torso(structure.times_s)
    face = p[:, None] + np.einsum("kij,nj->kni", rotation, points)
    turns = np.arange(8) * np.pi / 4.0
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    about = _AROUND_M * np.concatenate([np.zeros((1, 2)), 0.5 * ring, ring])
    normal = rotation[:, :, 2]
    rise = -(normal[:, :2] @ about.T) / normal[:, 2:]
    above = (
        face[:, :, None, 2]
        + rise[:, None]
        - structure.task.terrain.height(face[:, :, None, :2] + about)
    )
    gap = above.min(axis=2) * normal[:, None, 2]
    row, column = np.divmod(np.arange(len(points)), len(np.unique(points[:, 1])))
    turn = (np.arange(len(p))[:, None] + row + column) % 2 == 0
    sinking = _SINKING * structure.task.robot.stand_height_m * (1.0 / normal[:, 2:] - 1.0)
    node, point = np.nonzero((gap < NEAR_M + sinking) & turn)
    return node, point
