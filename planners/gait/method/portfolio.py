"""A product's answer: charts tried in turn under caps, then smoothed, then densified until the
verifier accepts.

DESIGN of the order: decoupled first, which needs the fewest iterations; then the exact warped
chart; then the world's own coordinates with the terrain growing. Where walls are steep the world's
own coordinates come first, on walls that are widened and get steep from solution to solution: a
shear sends a foot up a wall as fast as the wall is steep. The first that the verifier accepts is
the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...answer.answer import Answer, Effort, Status
from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...errors import InvalidInput, PlanningFailed
from ...files.arrays import Array, checked, checked_int
from ...problem.walk import Walk
from ...robot.bodies import Bodies
from ...robot.inverse_kinematics import Overlap, WholeBody, descend
from ...robot.kinematics import rotation_of
from ...robot.leg import Leg
from ...terrain.heightfield import HeightField
from ...terrain.obstacles import Obstacles
from ...verify.bodies import WholeBodyMeasurements
from ...verify.trajectories import check_trajectory, with_body
from ...verify.trajectory_measurements import TrajectoryMeasurements
from ..charts import CHARTS
from ..constraints.dynamics import LegLoads, dynamics, torque
from ..constraints.feet import Overlaps, apart, reach
from ..forbidden import forbidden, unheld
from ..gait_program import GaitProgram, GaitSolution, terms
from ..settings import GaitSettings
from ..transcription.taylor import Block, Constraint
from ..variables import Structure
from .attempt import (
    Attempt,
    Attempted,
    Homotopy,
    Progress,
    Smoothing,
    SolveBudget,
    Solver,
    SolveRecord,
    Workbench,
    peak_g,
    smoothed,
)

GENTLE = 1.0
"""Gradient that needs no homotopy: 45°."""
GROWTH = 1.7
"""By how much the steepest gradient grows from one stage to the next; 3 → 6 → 10 → 14 → 20 on the
pit of 87°."""
_WIDEST_M = 1.6
"""No Gaussian is wider [m]."""
LEAST = 0.04
"""Steps in the factor below this are not tried: what separates the stages is then no longer the
terrain."""


def heights_for(
    terrain: HeightField, gentle: float = GENTLE, growth: float = GROWTH
) -> tuple[float, ...]:
    """Factors on the gradients, the last 1: the first makes the terrain gentle, each next one
    steeper by ``growth``.
    """
    slope = terrain.steepest
    if slope <= gentle:
        return (1.0,)
    stages = int(np.ceil(np.log(slope / gentle) / np.log(growth)))
    return tuple(
        float(factor) for factor in (gentle / slope) ** (1.0 - np.arange(stages + 1) / stages)
    )


def softened(terrain: HeightField, factor: float) -> HeightField:
    """The terrain under the Gaussian that leaves this share, within (0, 1], of its steepest
    gradient.

    Raises InvalidInput for an uneven grid.
    """
    goal = factor * terrain.steepest
    if factor == 1.0 or goal == 0.0:
        return terrain

    from scipy.optimize import brentq  # slow to import

    def above(sigma_m: float) -> float:
        return terrain.smoothed(sigma_m).steepest - goal

    widest_m = 0.05
    while above(widest_m) > 0.0 and widest_m < _WIDEST_M:
        widest_m *= 2.0
    if above(widest_m) > 0.0:  # a plane, or nearly: no Gaussian makes it gentler
        return terrain.smoothed(widest_m)
    return terrain.smoothed(float(brentq(above, 0.0, widest_m, xtol=1e-3)))


def follow_homotopy(
    bench: Workbench,
    attempt: Attempt,
    *,
    solve: Solver = GaitProgram.solve,
    max_iterations: int | None = None,
    most_stages: int = 12,
    stop: Callable[[], bool] = lambda: False,
) -> tuple[GaitSolution, float, float]:
    """Solve at one of an attempt's heights after another, each from the last solution; half-way
    where one fails.

    A gentler terrain on which the task is none is left out.

    Ends at the last factor, after most_stages, or where a step is too small to halve.

    Returns the last solution, failed or not, its factor on the terrain's gradients, and the largest
    factor that was solved.

    Arguments:
        solve: in place of the programs' own.
        max_iterations: of one stage.
        stop: asked before every stage but the first.
    """
    ahead, found = list(attempt.heights), list[tuple[GaitSolution, float]]()
    alone, reached = len(ahead) == 1, 0.0
    x: Array | None = None
    while ahead and len(found) < most_stages and not (found and stop()):
        factor = ahead[0]
        try:
            program, by_stage = stage_program(bench, attempt.chart, factor, attempt.by)
        except InvalidInput:
            if len(ahead) == 1:
                raise
            ahead.pop(0)
            continue
        begin = attempt.guess(program) if x is None else x
        solution = solve(program, begin, height_factor=by_stage, max_iterations=max_iterations)
        found.append((solution, factor))
        if solution.success:
            x, reached = solution.x, ahead.pop(0)
        elif alone or factor - reached < LEAST:
            break
        else:
            ahead.insert(0, 0.5 * (reached + factor))
    return *found[-1], reached


def stage_program(
    bench: Workbench, chart: str, factor: float, by: Homotopy = "height"
) -> tuple[GaitProgram, float]:
    """The program of a stage and the factor to solve it at: 1 where the stage has a terrain and a
    map of its own.
    """
    if factor == 1.0 or (CHARTS.get(chart).scales and by == "height"):
        return bench.program(chart), factor
    terrain = bench.task.terrain
    lower = replace(
        bench.task, terrain=terrain.scaled(factor) if by == "height" else softened(terrain, factor)
    )
    return Workbench(lower, bench.settings).program(chart), 1.0


_STEP = 2e-3
"""Between postures whose depths are compared [m, rad]."""
_CLEAR_M, _TRIES = 2e-3, 21
"""Links are apart when they are so far off each other; steps of the way of feet to where they
stand."""


def _leg_overlaps(structure: Structure, report: Report[Trajectory]) -> Overlaps:
    """Rows at the nodes on both sides of every posture of a report's trajectory in which something
    overlaps.
    """
    walk = report.answer
    body = WholeBodyMeasurements(TrajectoryMeasurements(walk))
    bodies = Bodies(body.kinematics, Obstacles.under(walk.problem.terrain))
    slopes = _Slopes(body, bodies)
    deepest = dict[tuple[int, str, str], float]()
    times_s, postures = body.spaced()
    for _, block in bodies.sweep(postures, terrain_m=0.0, links_m=0.0, between=False):
        for moment, each in block:
            at = times_s[int(moment)] / structure.settings.step_s
            for node in {int(np.floor(at)), int(np.ceil(at))}:
                key = node, *each[1:]
                deepest[key] = max(each[0], deepest.get(key, 0.0))
    rows = list[tuple[Array, ...]]()
    for (node, link, other), depth_m in deepest.items():
        sample = int(np.clip(np.rint(structure.times_s[node] / walk.step_s), 0, walk.samples - 1))
        rows.append((np.array(node), *slopes.row(sample, (depth_m, link, other))))
    names = ("node", "feet", "depth_m", "feet_m", "by_foot", "torso_m", "rotation", "by_torso")
    return Overlaps(
        **dict(zip(names, (np.array(part) for part in zip(*rows, strict=True)), strict=True))
    )


class _Slopes:
    """Derivatives of an overlap's depth in the feet in the torso's frame, and in the torso."""

    def __init__(self, body: WholeBodyMeasurements, bodies: Bodies) -> None:
        self._body, self._bodies, self._walk = body, bodies, body.trajectory
        self._solver = body.kinematics
        self._legs = {link: mount.leg for link, mount in self._solver.model.mounts.items()}

    def row(self, sample: int, overlap: Overlap) -> tuple[Array, ...]:
        """Feet, depth, r₀, derivatives in both feet, p₀, R₀, derivatives in the torso."""
        depth_m, *names = overlap
        pair = [self._legs.get(name) for name in names]
        legs = sorted({leg for leg in pair if leg is not None}) or [0]
        feet = np.array([legs[0], legs[-1]])
        torso, rotation = self._walk.torso_m[sample], self._walk.rotation[sample]
        at = (self._walk.feet_m[sample, feet] - torso) @ rotation
        posture = self._body.postures.at(sample)
        if names[1] in self._legs:
            depth, by_foot, by_torso = *self._homeward(overlap, posture, legs, at), np.zeros(6)
        else:
            depth, (by_foot, by_torso) = depth_m, self._tangent(overlap, posture, legs)
        return feet, np.array(depth), at, by_foot, torso, rotation, by_torso

    def _homeward(
        self, overlap: Overlap, posture: WholeBody, legs: list[int], at: Array
    ) -> tuple[float, Array]:
        """Distance that feet have to go towards where they stand for the links to come apart, as a
        depth [m], and the direction. Links may be thinner than they are deep in each other, so that
        a tangent leads nowhere.
        """
        home = np.array([self._walk.robot.feet[leg].nominal_m for leg in legs]) - at[: len(legs)]
        for share in np.linspace(0.0, 1.0, _TRIES):
            moved = posture
            for leg, way in zip(legs, home, strict=True):
                moved = self._reaching(moved, leg, share * way)
            if self._bodies.depth(overlap, moved) < -_CLEAR_M:
                break
        far = float(np.linalg.norm(home))
        by_foot = np.zeros((2, 3))
        by_foot[: len(legs)] = -home / max(far, 1e-9)
        return share * far, by_foot

    def _tangent(
        self, overlap: Overlap, posture: WholeBody, legs: list[int]
    ) -> tuple[Array, Array]:
        """The depth's derivatives in the foot and in the torso, by differences."""
        axes = _STEP * np.concatenate([np.eye(3), -np.eye(3)])
        ways: tuple[Callable[[Array], WholeBody], ...] = (
            lambda step: self._reaching(posture, legs[0], step),
            lambda step: replace(posture, origin_m=posture.origin_m + step),
            lambda step: self._turning(posture, step),
        )
        depths = np.array(
            [[self._bodies.depth(overlap, way(step)) for step in axes] for way in ways]
        )
        slopes = (depths[:, :3] - depths[:, 3:]) / (2.0 * _STEP)
        return np.stack([slopes[0], np.zeros(3)]), slopes[1:].ravel()

    def _reaching(self, posture: WholeBody, leg: int, by_m: Array) -> WholeBody:
        """With one foot elsewhere in the body."""
        joints, model = self._solver.joints_of(leg), self._solver.model.legs[leg]
        angles = np.array(posture.angles)
        centre = model.chain.feet(angles[None, joints]) + by_m
        angles[joints] = descend(model, centre, angles[None, joints])[0][0]
        return replace(posture, angles=angles)

    def _turning(self, posture: WholeBody, by_rad: Array) -> WholeBody:
        """With the torso turned about its own axes through the centre of mass."""
        shift = self._solver.com_offset(posture.angles)
        rotation = posture.rotation @ rotation_of(by_rad)
        return replace(
            posture,
            rotation=rotation,
            origin_m=posture.origin_m + (posture.rotation - rotation) @ shift,
        )


_STEP_M = 1e-4
"""Between feet whose levers are compared."""
_NEAR = 0.7
"""A joint gets a row where it gives this share of what it may."""
_ROOM = 0.01
"""Share of the limit, between what the verifier allows and what rows ask for, besides what a joint
gives more between a node and the next than at it."""


def leg_loads(structure: Structure, report: Report[Trajectory], room: float = _ROOM) -> LegLoads:
    """Rows for the joints of standing legs that give much, at the program's nodes, about a report's
    trajectory.
    """
    trajectory = report.answer
    body = WholeBodyMeasurements(TrajectoryMeasurements(trajectory))
    legs, solver = body.kinematics.model.legs, body.kinematics
    sample = np.clip(
        np.rint(structure.times_s / trajectory.step_s).astype(int), 1, trajectory.samples - 2
    )
    about = round(0.5 * structure.settings.step_s / trajectory.step_s)
    around = np.pad(np.abs(body.torques_nm), ((about, about), (0, 0)), mode="edge")
    highest = sliding_window_view(around, 2 * about + 1, axis=0).max(axis=-1)[sample - 1]
    torques, angles = body.torques_nm[sample - 1], body.postures.angles[sample]
    rotation, forces = trajectory.rotation[sample], trajectory.forces_n[sample]
    most = (report.limits["torque"] - room) * solver.torque_nm - (highest - np.abs(torques))
    felt = np.einsum("kji,knj->kni", rotation, forces)
    arms = trajectory.feet_m[sample] - trajectory.torso_m[sample][:, None]
    at = np.einsum("kji,knj->kni", rotation, arms)
    triplets = list[tuple[Any, ...]]()
    for i, leg in enumerate(legs):
        joints = solver.joints_of(i)
        levers, slopes = _levers(leg, angles[:, joints])
        rest = torques[:, joints] + np.einsum("kij,ki->kj", levers, felt[:, i])
        wanted = trajectory.contact[sample, i][:, None] & (
            np.abs(torques[:, joints]) > _NEAR * most[:, joints]
        )
        node, joint = np.nonzero(wanted & np.isfinite(most[:, joints]))
        triplets.append(
            (
                np.full(len(node), i),
                node,
                at[node, i],
                levers[node, :, joint],
                slopes[node, :, joint],
                rest[node, joint],
                most[node, joints[joint]],
            )
        )
    return LegLoads(
        **dict(
            zip(
                ("foot", "node", "at_m", "levers_m", "slopes", "rest_nm", "most_nm"),
                (np.concatenate(part) for part in zip(*triplets, strict=True)),
                strict=True,
            )
        )
    )


def _levers(leg: Leg, angles: Array) -> tuple[Array, Array]:
    """∂p_BF/∂q, shape (K, 3, n), and how that changes with the foot's place, shape (K, 3, n, 3)."""
    feet, jacobian = leg.chain.feet_and_jacobian(angles)
    slopes = np.empty((*jacobian.shape, 3))
    for axis in range(3):
        sides = [
            descend(leg, feet + step * np.eye(3)[axis], angles)[0] for step in (_STEP_M, -_STEP_M)
        ]
        ahead, behind = (leg.chain.feet_and_jacobian(q)[1] for q in sides)
        slopes[..., axis] = (ahead - behind) / (2.0 * _STEP_M)
    return jacobian, slopes


_Flags = NDArray[np.bool_]
_BAND = 0.06
"""What a balance may be off half-way between nodes where it is asked for [m·g, m·g·stand height];
shrinks each time."""
_BALANCES = frozenset(
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
_WINDOWS = frozenset(
    ("impulse", "angular_impulse", "traction_impulse", "traction_way", "traction_turn")
)
"""Groups that add up over time."""
_LEAST_BAND = 0.01
"""Nothing narrower is asked for where no balance is off by more."""
_APART_M = 0.003
"""Links that went through something are asked to be so far off it."""
_FLAW = 1.5
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

    balance: _Flags
    reach: _Flags
    band: float = _BAND
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
    band = _BAND
    checks = dense = flaws(program, report, band)
    while (
        _BALANCES & {group.name for group in report.refused}
        and not dense.balance.any()
        and band > _LEAST_BAND
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
    if missed.keys() & _WINDOWS and settings.dynamics == "centred":
        settings = replace(settings, mean_forces=True)
    if "reach" in missed:
        settings = replace(
            settings, reach_margin_m=min(settings.reach_margin_m + missed["reach"], 0.03)
        )
    return settings


def flaws(program: GaitProgram, report: Report[Trajectory], band: float = _BAND) -> Checks:
    """In which steps of the program's grid a trajectory's balances and reach are off."""
    measured, broken = (
        TrajectoryMeasurements(report.answer),
        {group.name for group in report.refused},
    )
    steps, feet = program.structure.nodes - 1, program.structure.feet
    balance, arms = np.zeros(steps, dtype=bool), np.zeros((steps, feet), dtype=bool)
    if broken & _BALANCES:
        for residual, scale in (
            (measured.force_residual, measured.weight_n),
            (measured.moment_residual, measured.moment_scale_nm),
        ):
            off = np.linalg.norm(residual, axis=1) > _FLAW * band * scale
            balance[_steps(measured.times_s[1:-1][off], program)] = True
    if "reach" in broken:
        samples, columns = np.nonzero(measured.reach() > 0.5 * report.limits["reach_m"])
        arms[_steps(measured.times_s[samples], program), columns] = True
    loads = leg_loads(program.structure, report) if "torque" in broken else None
    overlaps = _leg_overlaps(program.structure, report) if "bodies" in broken else None
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
        and (rows := apart(structure, checks.overlaps, _APART_M)) is not None
    ):
        constraints.append(rows)
    return constraints


def restricted(constraint: Constraint, kept: _Flags) -> Constraint:
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


_STEEP = 6.0
"""Gradient (81°) beyond which walls are widened first, and feet swing in the world's own
coordinates."""
_WIDENED = 4.0
"""Gradient of the first stage then."""


@dataclass(frozen=True, kw_only=True)
class Caps:
    """Caps on the cost of a plan.

    Arguments:
        iterations: iterations of a solve for a feasible point.
        solve_s, total_s: CPU time of one solve, and of all that is done, verdicts between solves
            among it [s].
        total_iterations: iterations of all solves, None for no limit; with times that are never
            met, a walk is the same on a busy computer.
        densifications: how often rows are added.
        smoothing: limit of the second phase.
        in_subprocess: solves in child processes that are ended at ten times solve_s by the clock,
            since a solver may hang.
    """

    iterations: int = 80
    solve_s: float = 60.0
    total_s: float = 240.0
    total_iterations: int | None = None
    densifications: int = 6
    smoothing: Smoothing = field(default_factory=Smoothing)
    in_subprocess: bool = False

    def __post_init__(self) -> None:
        for name, least in (("iterations", 1), ("densifications", 0)):
            if getattr(self, name) < least:
                raise InvalidInput(f"{name}: expected {least} or more, got {getattr(self, name)}")
        for name in ("solve_s", "total_s"):
            checked(getattr(self, name), name, above=0.0)
        if self.total_iterations is not None:
            checked_int(self.total_iterations, "total_iterations", least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempts:
    """The attempts at a walk, in their order.

    Arguments:
        walk: the walk to find.
        attempts: all attempts, each with its best trajectory, accepted or not.
        feasible: the verifier's report on the first feasible point of each, before the second
            phase, None for none.
        solves: all solves, in order.
        failures: reasons of attempts that could not begin, for example a terrain that no map fits.
        stopped: the caller asked it to end.
    """

    walk: Walk
    attempts: tuple[Attempted, ...]
    feasible: tuple[Report[Trajectory] | None, ...]
    solves: tuple[SolveRecord, ...]
    failures: tuple[str, ...] = ()
    stopped: bool = False

    @property
    def answer(self) -> Answer[Trajectory]:
        """The smoothest walk that the verifier accepts; where there is none, undecided, with the
        best walk that it refuses, and with none where no attempt came to a feasible point.
        """
        best, names = self.best, [one.attempt.name for one in self.attempts]
        if best is not None and not best.solution.success:
            best = None
        return Answer(
            status=Status.FEASIBLE if self.verified else Status.UNDECIDED,
            method=", ".join(names) if best is None else best.attempt.name,
            problem=self.walk,
            solution=None if best is None else best.trajectory,
            report=None if best is None else best.report,
            residual=math.nan if best is None else best.report.worst,
            effort=Effort(solves=len(self.solves), tries=len(self.attempts), seconds=self.seconds),
            message=self.message,
            details={"iterations": float(sum(one.iterations for one in self.solves))},
        )

    @property
    def verified(self) -> bool:
        """Tell whether there is a walk that the verifier accepts."""
        return self.best is not None and self.best.verified

    @property
    def best(self) -> Attempted | None:
        """The best attempt, accepted or not; verified before feasible before the rest; None where
        none began.
        """
        return min(
            self.attempts,
            key=lambda one: (not one.solution.success, *_rank(one.report)),
            default=None,
        )

    @property
    def seconds(self) -> float:
        """CPU time of all solves [s]."""
        return sum(one.seconds for one in self.solves)

    @property
    def message(self) -> str:
        """One line: the verifier's verdict on the best attempt, or the reason why there is no
        walk.
        """
        best = self.best
        if best is None:
            return "no walk: " + ("; ".join(self.failures) or "no attempts")
        if best.verified:
            return best.report.message
        if best.solution.success:
            return f"no walk that the verifier accepts: {best.report.message}"
        return f"no feasible walk: largest violation {best.solution.violation:.1e}"


def plan_gait(
    task: Walk,
    settings: GaitSettings | None = None,
    progress: Progress | None = None,
    *,
    caps: Caps | None = None,
    attempts: Sequence[Attempt] | None = None,
) -> Attempts:
    """Find a walk: try attempts in their order until the verifier accepts one, smoothed and
    densified.

    Arguments:
        task: robot, terrain, start and goal.
        settings: of every attempt but for its chart; the usual ones if missing.
        progress: called at every iteration, see ``attempt.Progress``; may return True to stop.
        caps: what the plan may cost, and what comes after a feasible point.
        attempts: ``default_attempts(task)`` if missing. Those in a row that differ in their guess
            alone are all tried, and the smoothest is the answer.

    Returns:
        The ``Attempts``. ``best`` is the best of them, accepted or not, ``message`` says what it
        was refused for, and ``answer`` is what ``stancekit.walk`` returns. There are none where
        friction forbids a walk, or, but for a single attempt, holds no feet on the way.

    Raises:
        InvalidInput: for settings that do not fit the task, and for an unknown chart.
    Source:
        W1 and W7, for a first feasible point; the order of charts, the second phase and
        densification are the house's.
    """
    settings = settings or GaitSettings()
    if reason := forbidden(task, settings) or (
        unheld(task) if attempts is None or len(attempts) > 1 else ""
    ):
        return Attempts(walk=task, attempts=(), feasible=(), solves=(), failures=(reason,))
    todo = default_attempts(task) if attempts is None else list(attempts)
    caps = caps or Caps()
    run = _PortfolioRun(Workbench(task, settings), caps, progress)
    walks, failures = list[Attempted](), list[str]()
    for index, attempt in enumerate(todo):
        if any(one.verified for one in walks) and _unperturbed(attempt) != _unperturbed(
            todo[index - 1]
        ):
            break
        try:
            walks.append(run.run(attempt))
        except PlanningFailed as error:
            failures.append(f"{attempt.name}: {error}")
            continue
        if run.budget.exhausted:
            break
    return Attempts(
        walk=task,
        attempts=tuple(walks),
        feasible=tuple(run.feasible),
        solves=tuple(run.budget.solves),
        failures=tuple(failures),
        stopped=run.budget.stopped,
    )


def default_attempts(task: Walk) -> list[Attempt]:
    """The charts in the order in which they are worth trying on a task's terrain."""
    if task.terrain.steepest > _STEEP and task.terrain.even:
        widened = heights_for(task.terrain, gentle=_WIDENED)
        return [
            Attempt(chart="ambient", heights=widened, by="smoothing"),
            Attempt(chart="decoupled", heights=widened, by="smoothing"),
            Attempt(chart="warped-exact"),
        ]
    return [
        Attempt(chart="decoupled"),
        Attempt(chart="warped-exact"),
        Attempt(chart="ambient", heights=heights_for(task.terrain)),
    ]


class _PortfolioRun:
    """Attempts at one task on one budget. feasible: the verifier's word on the first feasible point
    of each.
    """

    def __init__(self, bench: Workbench, caps: Caps, progress: Progress | None) -> None:
        self.bench, self.caps = bench, caps
        self.feasible: list[Report[Trajectory] | None] = []
        self.budget = SolveBudget(
            solve_s=caps.solve_s,
            total_s=caps.total_s,
            iterations=math.inf if caps.total_iterations is None else caps.total_iterations,
            in_subprocess=caps.in_subprocess,
            progress=progress,
        )

    def run(self, attempt: Attempt) -> Attempted:
        """A feasible point; if there is one, the second phase and densification; the best of what
        came out.
        """
        budget, began = self.budget, len(self.budget.solves)
        budget.begin(attempt)
        solution, factor, _ = follow_homotopy(
            self.bench,
            attempt,
            solve=budget,
            stop=lambda: budget.exhausted,
            max_iterations=min(self.caps.iterations, self.bench.settings.max_iterations),
        )
        if factor != 1.0:
            solution = solution.on(self.bench.program(attempt.chart))
        searched = len(budget.solves)
        worth = (
            solution.success or not budget.exhausted
        )  # bodies on no walk's way take longer to judge than on one's
        best = _verified(solution, body=worth and not solution.success)
        self.feasible.append(best[1] if solution.success else None)
        if solution.success:
            best = self._refined(best)
        solves = budget.solves[began:]
        provenance = self.bench.provenance(attempt, best[0], sum(one.iterations for one in solves))
        trajectory = replace(
            best[1].answer,
            provenance={**provenance, "heights_by": attempt.by, "solves": float(len(solves))},
        )
        return Attempted(
            attempt=attempt,
            solution=best[0],
            trajectory=trajectory,
            report=replace(best[1], answer=trajectory),
            iterations=sum(one.iterations for one in budget.solves[began:searched]),
            seconds=sum(one.seconds for one in solves),
            history=np.array(
                [violation for one in budget.solves[began:searched] for violation in one.violations]
            ),
        )

    def _refined(self, start: _Verified) -> _Verified:
        """Dense enough for the verifier, smooth, and dense enough again, now for the robot's own
        body, too, which takes the verifier long.
        """
        best = self._dense(start, body=False)
        self.budget.phase = "smooth"
        rounds = smoothed(
            best[0],
            self.caps.smoothing,
            report=best[1],
            solve=self.budget,
            stop=lambda: self.budget.exhausted,
        )
        for one in rounds:
            if one.solution.success:
                best = _better(best, (one.solution, one.report))
        return self._dense((best[0], with_body(best[1])), body=True)

    def _dense(self, best: _Verified, *, body: bool) -> _Verified:
        """Rows where the verifier finds fault, until it finds none or the cap is reached."""
        self.budget.phase = "densify"
        at = best
        for _ in range(self.caps.densifications):
            if best[1].accepted or self.budget.exhausted:
                break
            program = densified(at[0].program, at[1])
            if program is None:
                break
            solution = self.budget(program, at[0].x, max_iterations=self.caps.iterations)
            if not solution.success:
                break
            at = _verified(solution, body=body)
            best = _better(best, at)
        return best


_Verified = tuple[GaitSolution, Report[Trajectory]]


def _unperturbed(attempt: Attempt) -> Attempt:
    """The attempt without what is its guess's."""
    return replace(attempt, noise=0.0, seed=0)


def _verified(solution: GaitSolution, *, body: bool) -> _Verified:
    trajectory: Trajectory = solution.trajectory()
    return solution, check_trajectory(trajectory, body=body)


def _better(before: _Verified, after: _Verified) -> _Verified:
    """Accepted before refused, then what misses its limits by less, or peaks lower."""
    return min(before, after, key=lambda one: _rank(one[1]))


def _rank(report: Report[Trajectory]) -> tuple[bool, float]:
    if report.accepted:
        return False, peak_g(report)
    return True, max(
        (group.value / max(group.limit, 1e-3) for group in report.refused), default=float("inf")
    )
