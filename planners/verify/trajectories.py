"""The independent verifier of trajectories: it knows the robot, the terrain and the samples, not
how they were made.

Everything is measured between the optimiser's knots, in the world frame: balances by the momentum
of finite differences, cones and depths at the true surface, whose normals it takes from heights
alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..answer.report import Group, Report
from ..answer.trajectory import Trajectory
from ..files.arrays import LARGEST, Array
from ..physics import GRAVITY_M_S2
from .bodies import nothing, whole_body
from .trajectory_measurements import (
    GROUPS as GROUPS,
    LIMITS as LIMITS,
    Flags,
    TrajectoryMeasurements,
    arrays_defect,
    as_far_as_known,
    rms,
)

_APART_M = 0.01
"""Between samples a swinging foot is looked at this often along its way [m]."""
_MOST_PIECES = 10
"""Points between two samples at most: a foot that is faster than ``Limits.foot_speed_m_s`` is
refused anyway."""


_MOST_EDGES = 4000
"""Windows begin and end at every sample of trajectories up to so many, and at every so-manieth of
longer ones."""
_EVEN = 1e-9
"""Normal force of all feet below which there is none, in units of m·g."""


# ------------------------------------------------------------------------------------------ steps


def _phases(holds: Flags) -> list[tuple[int, int, int]]:
    """Runs of samples at which it holds, foot by foot: the foot, the first sample and the last."""
    phases = []
    for foot in range(holds.shape[1]):
        changes = [0, *(np.flatnonzero(np.diff(holds[:, foot])) + 1).tolist(), len(holds)]
        runs = [(first, end) for first, end in pairwise(changes) if holds[first, foot]]
        phases += [(foot, first, end - 1) for first, end in runs]
    return phases


def _middle(heights: Array, first: int, last: int) -> Array:
    """Heights in the middle half of a swing; of one that is cut off all but a quarter beside the end
    at which it lands.
    """
    here = heights[first : last + 1]
    quarter, begins, ends = len(here) // 4, first > 0, last < len(heights) - 1
    return here[quarter * begins : len(here) - quarter * ends]


def _dragged(way: Array, low: Flags, first: int, last: int) -> float:
    """How far a foot goes while it is low, from the sample before its swing to the one after [m]."""
    part = slice(max(first - 1, 0), last + 2)
    moved = np.linalg.norm(np.diff(way[part], axis=0), axis=1)
    return float(moved[low[part][1:] & low[part][:-1]].sum())


def _between(walk: TrajectoryMeasurements, number: int, pieces: int) -> tuple[Array, Array]:
    """Points of one foot between samples of which neither stands, along cubics through the samples,
    shape (P, 3) [m], and their times (P,) [s].
    """
    flies = ~walk.trajectory.contact[:, number]
    at = np.flatnonzero(flies[1:-2] & flies[2:-1] & flies[:-3] & flies[3:]) + 1
    shares = np.arange(1, pieces) / pieces
    weights = 0.5 * np.stack(
        [
            -shares + 2 * shares**2 - shares**3,
            2 - 5 * shares**2 + 3 * shares**3,
            shares + 4 * shares**2 - 3 * shares**3,
            -(shares**2) + shares**3,
        ]
    )
    near = walk.trajectory.feet_m[at[:, None] + np.arange(-1, 3), number]
    points = np.einsum("kwi,ws->ksi", near, weights).reshape(-1, 3)
    return points, (walk.times_s[at][:, None] + shares * walk.step_s).ravel()


def _penetration_between(walk: TrajectoryMeasurements, longest_m: float) -> tuple[Array, Array]:
    """Depth of swinging feet between samples, every centimetre, shape (1, E) [m], and the time of the
    deepest, (1,) [s].

    Arguments:
        longest_m: way of a foot from sample to sample at most.
    """
    pieces = int(np.clip(np.ceil(longest_m / _APART_M), 2, _MOST_PIECES))
    deepest, when = np.zeros((2, 1, len(walk.feet)))
    for number in range(len(walk.feet)):
        points, times_s = _between(walk, number, pieces)
        if len(points):
            depth = -walk.above(points)[0]
            deepest[0, number], when[0, number] = depth.max(), times_s[depth.argmax()]
    return deepest, when[:, int(deepest.argmax())]


# --------------------------------------------------------------------------------------- residuals


def worst_window(residual: Array, step_s: float, rate: float) -> tuple[float, int]:
    """‖∫ residual dt‖ of the window in which it is the largest beyond ``rate`` a second of the window,
    and at which row it begins.

    Arguments:
        residual: shape (S, 3).
        step_s: between its rows.
    """
    impulses = np.concatenate([np.zeros((1, 3)), np.cumsum(residual, axis=0)]) * step_s
    stride = 1 + (len(impulses) - 1) // _MOST_EDGES
    edges = np.unique(np.append(np.arange(0, len(impulses), stride), len(impulses) - 1))
    sums, lasts = np.ascontiguousarray(impulses[edges].T), edges * step_s
    worst, begins = 0.0, 0
    most = float(np.linalg.norm(np.ptp(sums, axis=1)))  # of any window
    for apart in range(1, len(edges)):
        if most - rate * (apart - 1) * stride * step_s <= worst:
            break  # nor have longer ones more
        within = sums[:, apart:] - sums[:, :-apart]
        size = np.sqrt(np.einsum("ik,ik->k", within, within)) - rate * (
            lasts[apart:] - lasts[:-apart]
        )
        at = int(size.argmax())
        if size[at] > worst:
            worst, begins = float(size[at]), int(edges[at])
    return worst, begins


def _lacking(walk: TrajectoryMeasurements) -> Array:
    """Part of the force that the motion needs and that cones cannot give, of all feet, shape (K −
    2,) [N].

    The force residual is added to the standing feet by their shares of the normal force. What ‖f_t‖
    has beyond ν (f_n + s) counts, and any pull beyond the suction s; where no foot presses the
    residual counts whole.
    """
    residual, forces = walk.force_residual, walk.trajectory.forces_n[1:-1]
    normals, stands = walk.ground[1][1:-1], walk.trajectory.contact[1:-1]
    presses = np.where(stands, np.maximum(np.sum(forces * normals, axis=-1), 0.0), 0.0)
    whole = presses.sum(axis=1)
    carried = whole > _EVEN * walk.weight_n
    shares = presses / np.where(carried, whole, 1.0)[:, None]
    supplied = forces + shares[..., None] * residual[:, None]
    beyond = walk.beyond_cone(supplied, normals, walk.suction_n)
    lacking = np.where(stands, np.maximum(beyond, 0.0), 0.0).sum(axis=1)
    return np.asarray(np.where(carried, lacking, np.linalg.norm(residual, axis=1)))


def _lacking_turn(walk: TrajectoryMeasurements) -> Array:
    """Angular acceleration about the vertical by moments that the standing feet cannot give, shape (K
    − 2,) [rad/s²].

    A foot gives at most ‖r‖ (‖n‖ + ν) (f_n + s) about the vertical through the centre of mass, all
    horizontal.
    """
    trajectory, normals, arms = walk.trajectory, walk.ground[1][1:-1], walk.arms[1:-1]
    forces, stands = trajectory.forces_n[1:-1], trajectory.contact[1:-1]
    needed = walk.moment_residual[:, 2] + np.cross(arms, forces).sum(axis=1)[:, 2]
    presses = np.maximum(np.sum(forces * normals, axis=-1), 0.0) + walk.suction_n
    level = np.linalg.norm(normals[..., :2], axis=-1) + trajectory.problem.friction
    moments = np.where(stands, np.linalg.norm(arms[..., :2], axis=-1) * level * presses, 0.0)
    lacking = np.maximum(np.abs(needed) - moments.sum(axis=1), 0.0)
    return np.asarray(lacking / np.linalg.eigvalsh(np.asarray(walk.robot.inertia_kgm2))[-1])


def _defect_of(trajectory: Trajectory, step_s: float) -> str:
    """Defect that keeps a trajectory from being one at all, so that nothing can be measured; empty
    when nothing does.

    Arguments:
        step_s: the coarsest grid that is believed [s].
    """
    count, feet = trajectory.samples, len(trajectory.robot.feet)
    if count < 4:  # the acceleration at either end is on a line through two
        return f"times_s: expected four samples or more, got {count}"
    asked = trajectory.problem
    if defect := (
        arrays_defect(trajectory, asked.columns(count))
        or arrays_defect(asked, {"adhesive": (feet,), "start": (2,), "goal": (2,)})
    ):
        return defect
    steps = np.diff(trajectory.times_s)
    if not float(steps.min()) > 0.0:
        return f"times_s: expected increasing times, got a step of {steps.min():g} s"
    if float(np.ptp(steps)) > 1e-6 * float(steps.max()):
        return (
            f"times_s: expected a uniform grid, got steps from {steps.min():g} to {steps.max():g} s"
        )
    if float(steps.max()) > step_s * (1.0 + 1e-6):
        return (
            f"times_s: expected samples every {step_s:g} s or less, got a step of {steps.max():g} s"
        )
    for name in ("friction", "suction_n", "heading_rad", "heading_end_rad"):
        value = getattr(asked, name)
        least = -LARGEST if name.startswith("heading") else 0.0
        if value is not None and not least <= value <= LARGEST:
            return f"{name}: expected a number from {least:g} to {LARGEST:g}, got {value:g}"
    return ""


_TIME_S = 1e-9
"""Times are sums of steps: what rounding makes of them [s]."""
_OVERFLOW = "the numbers overflow"


def check_trajectory(
    trajectory: Trajectory, limits: Mapping[str, float] = LIMITS, *, body: bool = True
) -> Report[Trajectory]:
    """Check everything between the knots that a robot would have to live with; never raises for a
    bad trajectory.

    Arguments:
        body: judge joints, torques and bodies, too, of a robot that has a model; that takes most of
            the time.
    """
    with np.errstate(all="ignore"):
        defect = _defect_of(trajectory, limits["step_s"])
        if defect:
            return _refused(trajectory, limits, defect)
        measured = TrajectoryMeasurements(trajectory)
        groups = _measured(measured, limits, body=body)
        if not all(math.isfinite(group.value) for group in groups):
            return _refused(trajectory, limits, _OVERFLOW)
        return Report(
            groups=groups,
            answer=trajectory,
            tolerance=0.0,
            figures=measured.figures(limits["cone"]),
            limits=dict(limits),
            remark=measured.footing(),
        )


def with_body(
    report: Report[Trajectory], limits: Mapping[str, float] = LIMITS
) -> Report[Trajectory]:
    """The report of ``check_trajectory`` with the robot's own body, from one without: the other
    groups stay.

    Arguments:
        report: with ``body=False``, for the same limits.
    """
    if report.defect:
        return report
    with np.errstate(all="ignore"):
        measured = TrajectoryMeasurements(report.answer)
        groups = {group.name: group for group in whole_body(measured, limits)}
    if not all(math.isfinite(group.value) for group in groups.values()):
        return _refused(report.answer, limits, _OVERFLOW)
    return replace(report, groups=tuple(groups.get(group.name, group) for group in report.groups))


def _measured(
    walk: TrajectoryMeasurements, limits: Mapping[str, float], *, body: bool
) -> tuple[Group, ...]:
    """The worst of every group, in the order of ``GROUPS``."""
    groups = whole_body(walk, limits) if body else nothing("not asked for")
    for measure in (_balances, _ends, _contacts, _whole):
        groups += measure(walk, limits)
    found, unasked = {group.name: group for group in groups}, _unasked(walk.trajectory)
    return tuple(as_far_as_known(found[name], unasked.get(name, "")) for name in GROUPS)


def _unasked(trajectory: Trajectory) -> dict[str, str]:
    """Groups of which a trajectory does not say what is asked for, and what it does not say."""
    reasons = dict[str, str]()
    if trajectory.problem.heading_rad is None and trajectory.problem.heading_end_rad is None:
        reasons["heading"] = "no heading is asked for"
    if not all(trajectory.problem.still):
        reasons |= dict.fromkeys(
            ("rest", "rest_acceleration"), "it is not asked to be at rest at both ends"
        )
    if trajectory.problem.adhesive.any() and trajectory.problem.suction_n is None:
        reasons["suction"] = "no suction of feet that stick"
    return reasons


def _balances(walk: TrajectoryMeasurements, limits: Mapping[str, float]) -> tuple[Group, ...]:
    """Newton and Euler, and who could supply what they lack."""
    group, weight, moment = walk.group, walk.weight_n, walk.moment_scale_nm
    forces, moments, step_s = walk.force_residual, walk.moment_residual, walk.step_s
    sizes, turns = np.linalg.norm(forces, axis=1), np.linalg.norm(moments, axis=1)
    inertia, rotation = np.asarray(walk.robot.inertia_kgm2), walk.trajectory.rotation[1:-1]
    spun = np.linalg.solve(inertia, np.einsum("kji,kj->ik", rotation, moments)).T
    lacking, turning = _lacking(walk), _lacking_turn(walk)
    impulse = np.cumsum(lacking) * step_s

    def window(name: str, residual: Array, scale: float) -> Group:
        """What a residual sums up to over any window."""
        rate, most = (limits[f"{name}_{unit}"] * scale for unit in ("rate", "s"))
        worst, begins = worst_window(residual, step_s, rate)
        return group(name, np.array([worst]), most, times_s=walk.times_s[[begins + 1]])

    return (
        group("force_balance", sizes, limits["force_balance"] * weight, judged=rms(forces)),
        group("force_peak", sizes, limits["force_peak"] * weight),
        group("moment_balance", turns, limits["moment_balance"] * moment, judged=rms(moments)),
        group("moment_peak", turns, limits["moment_peak"] * moment),
        window("impulse", forces, weight),
        window("angular_impulse", moments, moment),
        group(  # angular acceleration that the moments of the feet do not explain
            "angular_residual",
            np.linalg.norm(spun, axis=1),
            limits["angular_residual"] * GRAVITY_M_S2 / walk.robot.stand_height_m,
        ),
        group("traction", lacking, limits["traction"] * weight),
        group("traction_impulse", impulse, limits["traction_impulse_s"] * weight),
        group(  # how far the centre of mass gets by it, as if all of it pushed one way
            "traction_way",
            np.cumsum(impulse / walk.robot.mass_kg) * step_s,
            limits["traction_way_m"],
        ),
        group(
            "traction_turn", np.cumsum(np.cumsum(turning)) * step_s**2, limits["traction_turn_rad"]
        ),
    )


def _ends(walk: TrajectoryMeasurements, limits: Mapping[str, float]) -> tuple[Group, ...]:
    """Where the torso begins and ends, its headings there, and rest where that is asked for."""
    trajectory, times_s, points = walk.trajectory, walk.times_s, walk.points
    starts, stops = trajectory.problem.still

    def ends(step: int, shorter: int = 0) -> list[int]:
        """The first samples, the last ones, or none: as the task asks; ``step`` inwards of a series
        so much shorter.
        """
        return [step] * starts + [trajectory.samples - 1 - shorter - step] * stops

    headings = (trajectory.problem.heading_rad, trajectory.problem.heading_end_rad)
    off = [
        0.0 if rad is None else float(np.arctan2(x[1], x[0])) - rad
        for rad, x in zip(headings, trajectory.rotation[[0, -1], :, 0], strict=True)
    ]
    away = np.abs((np.array(off) + np.pi) % (2.0 * np.pi) - np.pi)
    speed = np.linalg.norm(points[ends(1)] - points[ends(0)], axis=-1) / walk.step_s
    turning = np.linalg.norm(walk.spin[ends(0, 1)], axis=1) * walk.robot.stand_height_m
    speed[:, -1] = np.maximum(speed[:, -1], turning)
    felt = 2.0 * walk.acceleration[ends(0, 2)] - walk.acceleration[ends(1, 2)]  # on a line
    felt, rest = np.linalg.norm(felt, axis=1), limits["rest_acceleration"] * GRAVITY_M_S2
    group, at_rest = walk.group, times_s[ends(0)]
    start, goal = (
        np.linalg.norm(trajectory.torso_m[[at], :2] - wanted, axis=1)
        for at, wanted in ((0, trajectory.problem.start), (-1, trajectory.problem.goal))
    )
    return (
        group("start", start, limits["start_m"], times_s=times_s[:1]),
        group("goal", goal, limits["goal_m"], times_s=times_s[-1:]),
        group("heading", away, limits["heading_rad"], times_s=times_s[[0, -1]]),
        group("rest", speed, limits["rest_m_s"], times_s=at_rest),
        group("rest_acceleration", felt, rest, times_s=at_rest),
    )


def _contacts(walk: TrajectoryMeasurements, limits: Mapping[str, float]) -> tuple[Group, ...]:
    """Feet: what they press with, where they stand, and how they step."""
    trajectory, weight, step_s = walk.trajectory, walk.weight_n, walk.step_s
    contact, feet, heights = trajectory.contact, trajectory.feet_m, walk.ground[0]
    sizes = np.linalg.norm(trajectory.forces_n, axis=-1)
    ways = np.linalg.norm(np.diff(feet, axis=0), axis=-1)
    sticking = contact & trajectory.problem.adhesive & np.isfinite(walk.suction_n)
    low, swings = contact | (heights < limits["contact_gap_m"]), _phases(~contact)
    whole_stances, whole_swings = (
        [phase for phase in phases if phase[1] > 0 and phase[2] < len(contact) - 1]
        for phases in (_phases(contact), swings)
    )

    def where(name: str, asked: Flags, values: Array, limit: float) -> Group:
        """A group of feet at the samples at which it is asked for."""
        return walk.group(name, np.where(asked, values, 0.0), limit)

    def each(
        name: str, phases: list[tuple[int, int, int]], found: Iterable[float], limit: float
    ) -> Group:
        """A group of a value a phase, at the sample where the phase begins."""
        values = np.zeros(contact.shape)
        for (foot, first, _), value in zip(phases, found, strict=True):
            values[first, foot] = max(value, 0.0)
        return walk.group(name, values, limit)

    depth, when = _penetration_between(walk, float(ways.max()))
    return (
        where("cone", walk.gripping, walk.beyond, limits["cone"] * weight),
        where("suction", sticking, walk.beyond, limits["cone"] * weight),
        where("force_foot", contact, sizes, limits["force_foot"] * weight),
        where("swing_force", ~contact, sizes, limits["swing_force"] * weight),
        where("contact_gap", contact, np.abs(heights), limits["contact_gap_m"]),
        where("slip", contact, walk.slip(), limits["slip_m"]),
        # between two samples at both of which a foot stands, and at one of which
        where(
            "foot_velocity", contact[:-1] & contact[1:], ways / step_s, limits["foot_velocity_m_s"]
        ),
        where("touch_speed", contact[:-1] ^ contact[1:], ways / step_s, limits["touch_speed_m_s"]),
        each(  # too short by, from its first sample to the first one after it
            "stance_time",
            whole_stances,
            (limits["least_stance_s"] - (b - a + 1) * step_s for _, a, b in whole_stances),
            _TIME_S,
        ),
        each(  # too short by, between the samples at which the foot stands before and after it
            "swing_time",
            whole_swings,
            (limits["least_swing_s"] - (b - a + 2) * step_s for _, a, b in whole_swings),
            _TIME_S,
        ),
        each(  # the highest point of a swing, along the normal, is too low by
            "lift",
            swings,
            (limits["least_lift_m"] - float(heights[a : b + 1, i].max()) for i, a, b in swings),
            0.0,
        ),
        each(  # too near the ground in the middle half of the swing by
            "clearance",
            swings,
            (
                limits["least_clearance_m"] - float(_middle(heights[:, i], a, b).min())
                for i, a, b in swings
            ),
            0.0,
        ),
        each(
            "drag",
            swings,
            (_dragged(feet[:, i], low[:, i], a, b) for i, a, b in swings),
            limits["drag_m"],
        ),
        where("penetration", ~contact, -heights, limits["penetration_m"]),
        walk.group("penetration_between", depth, limits["penetration_m"], times_s=when),
        walk.group("reach", walk.reach(), limits["reach_m"]),
    )


def _whole(walk: TrajectoryMeasurements, limits: Mapping[str, float]) -> tuple[Group, ...]:
    """The motion as one."""
    group, speeds = walk.group, np.linalg.norm(np.diff(walk.points, axis=0), axis=-1) / walk.step_s
    return (
        group("rotation", walk.off_rotation(), limits["rotation"]),
        group("domain", walk.domain(), limits["domain_m"]),
        group(  # ‖x₋ − 2x + x₊‖
            "continuity",
            np.linalg.norm(np.diff(walk.points, 2, axis=0), axis=-1),
            limits["continuity_m"],
        ),
        group("foot_speed", speeds[:, :-1], limits["foot_speed_m_s"]),
        group("torso_speed", speeds[:, -1], limits["torso_speed_m_s"]),
        group("turn_rate", np.linalg.norm(walk.spin, axis=1), limits["turn_rate_rad_s"]),
        group("trunk", walk.trunk(), limits["trunk_m"]),
    )


def _refused(
    trajectory: Trajectory, limits: Mapping[str, float], defect: str
) -> Report[Trajectory]:
    groups = tuple(Group(group, math.inf, 0.0, unit) for group, unit in GROUPS.items())
    return Report(
        groups=groups, answer=trajectory, tolerance=0.0, limits=dict(limits), defect=defect
    )
