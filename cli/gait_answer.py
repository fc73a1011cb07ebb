"""Output of ``stancekit gait``: text, files and pictures of the walks that it found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import err
from .pictures import show

if TYPE_CHECKING:
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.gait.method.attempt import Attempted
    from stancekit.planners.gait.method.portfolio import Attempts
    from stancekit.planners.problem.walk import Walk

_PHASES = ("feasible", "smooth", "densify")
TURN_RAD = 5e-4
"""Walks that turn by less are not said to turn."""
_WAY_M = 0.05
"""The ground is looked at so often on the way."""


def draw(
    best: Attempted,
    *,
    picture: Path | None,
    video: Path | None,
    html: Path | None,
) -> None:
    """Write the picture, with the map's grid where there is one, the film and the page that were
    asked for.
    """
    if picture is not None:
        from stancekit.views.gaits import draw_motion
        from stancekit.views.sheet import save

        save(draw_motion(best.trajectory, best.report, warp=_map(best)), picture)
    show(best.trajectory, video=video, html=html)


def _map(one: Attempted) -> Callable[[Array], Array] | None:
    """The map of the chart that a walk was found in, None for charts without."""
    import numpy as np

    from stancekit.planners.gait.charts.warped import Pushforward

    chart = one.solution.program.structure.chart
    if chart.scales:
        return None
    pushed = Pushforward(chart)
    return lambda points: pushed.foot(points, np.zeros_like(points))[0]


def record(plan: Attempts, best: Attempted, terrain: str, written: Path | None) -> dict[str, Any]:
    """All of it as one JSON object."""
    return {
        "terrain": terrain,
        "verified": best.verified,
        "attempt": best.attempt.name,
        "message": verdict(best),
        "digest": best.report.digest if best.verified else None,
        "out": None if written is None else str(written),
        "cpu_seconds": plan.seconds,
        "figures": dict(best.report.figures),
        "joints": joints(best),
        "cannot_run": list(best.trajectory.robot.source.unrunnable),
        "doubts": list(best.trajectory.robot.source.doubts),
        "attempts": [_attempt_record(plan, index) for index in range(len(plan.attempts))],
        "failures": list(plan.failures),
    }


def refused(task: Walk, message: str, failures: Sequence[str] = ()) -> dict[str, Any]:
    """The answer without any walk as one JSON object."""
    return {
        "terrain": task.terrain.name,
        "verified": False,
        "status": "undecided",
        "message": message,
        "doubts": list(task.robot.source.doubts),
        "failures": list(failures),
    }


def _attempt_record(plan: Attempts, index: int) -> dict[str, Any]:
    one = plan.attempts[index]
    return {
        "attempt": one.attempt.name,
        "chart": one.attempt.chart,
        "success": one.solution.success,
        "verified": one.verified,
        "iterations": one.iterations,
        "cpu_seconds": one.seconds,
        "phases": _phases(plan, one),
        "peak_g": dict(zip(("before", "after"), _peaks(plan, index), strict=True)),
        "violation": one.solution.violation,
        "violations": [float(value) for value in one.history],
        "message": verdict(one),
    }


def _phases(plan: Attempts, one: Attempted) -> dict[str, dict[str, float]]:
    """CPU time, iterations and solves of an attempt, by phase."""
    solves = [record for record in plan.solves if record.attempt == one.attempt.name]
    return {
        phase: {
            "cpu_seconds": sum(record.seconds for record in solves if record.phase == phase),
            "iterations": sum(record.iterations for record in solves if record.phase == phase),
            "solves": sum(record.phase == phase for record in solves),
        }
        for phase in _PHASES
    }


def _peaks(plan: Attempts, index: int) -> tuple[float | None, float | None]:
    """Peak acceleration of an attempt's first feasible point, and of what it came to [g]."""
    before = plan.feasible[index]
    if before is None:
        return None, None
    return tuple(
        report.figures.get("peak_acceleration_g")
        for report in (before, plan.attempts[index].report)
    )  # type: ignore[return-value]


def words(plan: Attempts) -> list[str]:
    """One line of text for each attempt."""
    lines = []
    for index, one in enumerate(plan.attempts):
        phases, (before, after) = _phases(plan, one), _peaks(plan, index)
        parts = [f"{one.iterations} iterations, {phases['feasible']['cpu_seconds']:.1f} s"]
        for phase, name in (("smooth", "smoothed"), ("densify", "densified")):
            if phases[phase]["solves"]:
                parts.append(f"{name} in {phases[phase]['cpu_seconds']:.1f} s")
        if before is not None and after is not None:
            parts.append(
                f"peak {before:.2f} g" + (f" → {after:.2f} g" if round(after - before, 2) else "")
            )
        if abs(turn := one.report.figures.get("turn_rad", 0.0)) > TURN_RAD:
            parts.append(f"turns by {turn:+.3f} rad")
        lines.append(f"{one.attempt.name}: {'; '.join([*parts, verdict(one)])}")
    return [*lines, *plan.failures]


def joints(one: Attempted) -> dict[str, Any] | None:
    """Load that a walk puts on the robot's own legs, as the verifier measured it: group by group
    value, unit, and where; None without legs.
    """
    from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY

    groups = {
        group.name: {"value": group.value, "unit": group.unit, "where": group.where}
        for group in one.report.groups
        if group.name in WHOLE_BODY and group.verdict != "not checked"
    }
    return groups or None


def verdict(one: Attempted) -> str:
    """Result of an attempt in words: the solver's failure, or the verifier's word."""
    if one.solution.success:
        return one.report.message
    return f"no success: largest violation {one.solution.violation:.1e} ({one.solution.status})"


def doubt(task: Walk, total_s: float) -> None:
    """Say, before any work, that the ground on the way is steeper than friction holds, and how long
    the search for a walk takes at most.
    """
    import numpy as np

    steps = max(2, int(np.linalg.norm(task.goal - task.start) / _WAY_M) + 2)
    way = task.start + np.linspace(0.0, 1.0, steps)[:, None] * (task.goal - task.start)
    low, high = np.transpose(task.terrain.domain_m)
    feet = [np.clip(task.stance_m(xy)[:, :2], low, high) for xy in way]
    slope = float(np.linalg.norm(task.terrain.gradient(np.concatenate(feet)), axis=1).max())
    if slope > task.friction and not any(task.adhesive):
        names = ",".join(task.robot.limb_names[:2])
        err.print(
            f"{task.terrain.name} is {np.rad2deg(np.arctan(slope)):.0f}° at its steepest on the "
            "way, and friction "
            f"{task.friction:g} holds on {np.rad2deg(np.arctan(task.friction)):.0f}°: there may be "
            "no walk. The "
            f"search ends after {total_s:g} s of CPU time; feet that stick may help: --adhesive "
            f"{names}"
        )


def advise(one: Attempted) -> None:
    """Say what may help where the robot's own legs alone cannot do a walk, or where feet were to
    stand sure.
    """
    from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY

    wrong = {group.name for group in one.report.refused}
    if wrong and wrong <= set(WHOLE_BODY):
        err.print(
            "only the robot's own legs cannot do it: more time (--duration-s), a walk in place of "
            "a trot (--gait walk) "
            "or a smoother map (--smooth-m) may help"
        )
    elif one.solution.program.settings.footing:
        err.print("feet may stand on edges, too, and slip there, with --footing 0")
