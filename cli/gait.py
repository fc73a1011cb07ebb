"""``stancekit gait``: plan a walk over a terrain, and have it verified."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import tyro

from stancekit.planners.answer.motion import doubts_of
from stancekit.planners.errors import InvalidInput, NoPlace, PlanningFailed

from .console import as_options, complain, draw_to_file, emit, err, out, say, show, watching
from .options import (
    OF_FILE,
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    TerrainFile,
    check_drawn,
    check_unused,
    heading,
    place,
)

if TYPE_CHECKING:
    from stancekit import Walk
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.gait.method.attempt import Attempt, Attempted
    from stancekit.planners.gait.method.portfolio import Attempts, Caps
    from stancekit.planners.gait.settings import GaitSettings


_SETTINGS = (
    "start",
    "goal",
    "duration_s",
    "friction",
    "gait",
    "cycle_s",
    "timings",
    "adhesive",
    "footing",
    "robot",
    "seeds",
    "seed",
    "max_iterations",
    "dynamics",
    "hessian",
)
"""Fields of the task and of the solves that are options here."""
_CALLED = {"time_limit_s": "total_s", "start_yaw_rad": "heading", "end_yaw_rad": "heading_end"}
"""Those whose option has another name."""
_PHASES = ("feasible", "smooth", "densify")
TURN_RAD = 5e-4
"""Walks that turn by less are not said to turn."""
_LOOKS = 120
"""The ground is looked at so often on the way."""


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
        "cannot_run": list(best.trajectory.robot.unrunnable),
        "doubts": list(best.trajectory.doubts),
        "attempts": [_attempt_record(plan, index) for index in range(len(plan.attempts))],
        "failures": list(plan.failures),
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


def doubt(task: Walk, total_s: float) -> Iterator[str]:
    """Warn that the ground on the way is steeper than friction holds, and how long the search for a
    walk takes at most.
    """
    import numpy as np

    feet = [task.stance_m(xy)[:, :2] for xy in np.linspace(task.start, task.goal, _LOOKS)]
    feet_on = np.clip(feet, *np.transpose(task.terrain.domain_m))
    slope = float(np.linalg.norm(task.terrain.gradient(feet_on), axis=-1).max())
    if slope > task.friction and not any(task.adhesive):
        names = ",".join(task.robot.limb_names[:2])
        yield (
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


@dataclass
class PlanGait:
    """Plan a walk over a terrain and verify it between the knots; write it only if the verifier
    accepts.

    TERRAIN is a ground by its name, as `stancekit terrain` has them (ripple, stairs:0.1:7,
    rough:0.5:7, …; no walk between walls), a function of x and y as FILE.py:NAME, or a file of
    heights or of a mesh. A place is written x,y in metres; before a negative one the sign = is the
    safe way to write it, as in --start=-2.6,0.

      stancekit gait cone --start=-2,0 --goal 2,0 --out gait.json --picture gait.png
      stancekit gait heights.npy --spacing-m 0.05 --goal 1,0 --robot go1.urdf --out go1.json
      stancekit verify go1.json

    Exit code 0 if the verifier accepts the walk, 1 if none was found that it accepts, 2 for bad
    input.
    """

    terrain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TERRAIN")]
    """Name, FAMILY:LEVEL:SEED, FILE.py:NAME, or file of heights or of a mesh."""
    goal: Annotated[str, tyro.conf.arg(metavar="X,Y")]
    """Where the torso has to end."""
    start: Annotated[str, tyro.conf.arg(metavar="X,Y")] = "0,0"
    """Where it begins, at rest."""
    heading: Annotated[str, tyro.conf.arg(metavar="RAD|goal")] = "0"
    """Which way the robot faces, from x towards y [rad], or goal. It walks in any direction; out of
    a pit it has to face its goal, for the feet that stick are in front."""
    heading_end: Annotated[OptionalText, tyro.conf.arg(metavar="RAD|goal")] = None
    """Which way it faces at the end; unless given, as at the start, without being held to it. It
    turns the shorter way, on the spot where --goal is --start."""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "anymal"
    """anymal, hexapod, a .urdf file, or a .yaml file that names one (extra robots), or has a
    walker's numbers."""
    chart: Annotated[str, tyro.conf.arg(metavar="CHART|FILE.py:NAME")] = "portfolio"
    """In which coordinates to solve: ambient, shear, decoupled, warped, warped-exact, or a chart of
    your own; portfolio tries one after another until the verifier accepts."""
    timings: Literal["fixed", "optimised"] = "fixed"
    """Whether the phases keep the gait's timing, or are optimised with the rest."""
    gait: Annotated[
        Optional[Literal["trot", "walk", "pace", "bound", "gallop", "tripod"]],  # noqa: UP045
        tyro.conf.arg(metavar="{trot,walk,pace,bound,gallop,tripod}"),
    ] = None
    """Order of steps; trot on four feet, tripod on six."""
    cycle_s: OptionalFloat = None
    """How long a cycle lasts; unless given, the gait's own, shorter for a low robot that balances
    on two feet [s]."""
    dynamics: Literal["centred", "printed", "newton-euler"] = "centred"
    """How forces balance: the centred discrete model, the paper's, or Newton-Euler's equations."""
    hessian: Literal["exact", "lbfgs"] = "exact"
    """Second derivatives, or the paper's quasi-Newton."""
    duration_s: float = 10.0
    """Time to walk [s]."""
    friction: float = 0.75
    """Friction coefficient of the terrain."""
    footing: OptionalFloat = None
    """The steepest ground within 15 mm of where a foot stands, as a share of the slope on which
    friction holds; 0 for no such limit. Without it 0.6 where the ground on the way has such
    places."""
    adhesive: Annotated[str, tyro.conf.arg(metavar="FEET")] = ""
    """Feet that stick, e.g. LF,RF: they may pull."""
    suction_n: OptionalFloat = None
    """What a foot that sticks may pull with; its friction cone begins at that pull. Twice the
    weight unless given [N]."""
    seeds: int = 1
    """How many initial guesses of each chart to try; the smoothest accepted walk is kept."""
    seed: int = 0
    """Seed of the perturbed guesses; the first guess is never perturbed."""
    max_iterations: OptionalInt = None
    """Limit of a solve; unless given, 80 in a portfolio and 200 in one chart."""
    total_s: float = 240.0
    """CPU time of solves and of verdicts between them; the best walk until then is the answer
    [s]."""
    raw: bool = False
    """The first feasible point as it is: no second phase that smooths it, no rows added where the
    verifier refuses."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """Where to write the trajectory."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    unverified: bool = False
    """Write the best trajectory even if the verifier refuses it, marked so."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the motion: .png, .pdf or .svg."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Film of the motion (extra viz, and a GL library)."""
    html: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.html")] = None
    """Page with the motion in 3D, to be opened without a network."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Plan, verify, write, draw."""
        self._check()
        task, settings, caps, attempts = self._asked()
        caps = replace(caps, in_subprocess=True)
        try:
            plan = self._plan(task, settings, caps, attempts)
        except (NoPlace, PlanningFailed) as error:  # a goal in a solid, or no way
            return self._refused(task, str(error))
        best = plan.best
        if best is None:
            return self._refused(task, plan.message, plan.failures)
        written = self._write(best)
        if self.picture is not None:
            from stancekit.views.gaits import draw_motion

            draw_to_file(draw_motion(best.trajectory, best.report, warp=_map(best)), self.picture)
        show(best.trajectory, video=self.video, html=self.html)
        if self.json:
            emit(record(plan, best, self.terrain, self.out if written else None))
        else:
            self._say(plan, best, written)
        if not best.verified:
            advise(best)
        return 0 if best.verified else 1

    def _refused(self, task: Walk, message: str, failures: Sequence[str] = ()) -> int:
        """Say why there is no walk; exit code 1."""
        message, *failures = (
            each.replace("chart NAME", "--chart NAME") for each in (message, *failures)
        )
        complain(f"stancekit: {self.terrain}: {message}")
        if self.json:
            emit(
                {
                    "terrain": task.terrain.name,
                    "verified": False,
                    "status": "undecided",
                    "message": message,
                    "doubts": list(doubts_of(task)),
                    "failures": failures,
                }
            )
        return 1

    # -------------------------------------------------------------------------------------------------
    # input

    def _check(self) -> None:
        """Raise InvalidInput for what cannot be written, and for counts out of range, before any
        work.
        """
        from stancekit.planners.formats.motion_file import check_name
        from stancekit.planners.gait.charts import CHARTS

        if self.out is not None:
            check_name(self.out)
        if self.unverified and self.out is None:
            raise InvalidInput("--unverified: expected --out with it, got none")
        if not self.adhesive:
            check_unused(self, ("suction_n",), "feet that do not stick")
        files = [path for path in (self.picture, self.video, self.html) if path is not None]
        twice = [path for path in files if files.count(path) > 1]
        if twice:
            raise InvalidInput(
                f"{twice[0]}: expected a file of its own for each picture, got it twice"
            )
        check_drawn(self.picture, self.video, self.html)
        if self.chart != "portfolio":
            with as_options():
                CHARTS.get(self.chart)

    def _asked(self) -> tuple[Walk, GaitSettings, Caps, list[Attempt]]:
        """Task, settings, limits and attempts.

        Raises InvalidInput in the names of the options.
        """
        from stancekit.walks import Walk, search_of

        start, goal = (
            place(self.start, "--start"),
            place(self.goal, "--goal"),
        )
        end = self.heading_end
        with as_options(*_SETTINGS, **_CALLED):
            task = Walk.over(
                self.file.read(self.terrain),
                goal,
                start=start,
                robot=self.robot,
                start_yaw_rad=heading(self.heading, goal - start),
                end_yaw_rad=None if end is None else heading(end, goal - start, "--heading-end"),
                duration_s=self.duration_s,
                friction=self.friction,
                adhesive=[name.strip() for name in self.adhesive.split(",")]
                if self.adhesive
                else [],
                suction_n=self.suction_n,
                gait=self.gait,
                cycle_s=self.cycle_s,
                timings=self.timings,
            )
            return task, *search_of(
                task,
                chart=self.chart,
                time_limit_s=self.total_s,
                max_iterations=self.max_iterations,
                dynamics=self.dynamics,
                hessian=self.hessian,
                footing=self.footing,
                raw=self.raw,
                seeds=self.seeds,
                seed=self.seed,
            )

    # --------------------------------------------------------------------------------------------------
    # work

    def _plan(
        self,
        task: Walk,
        settings: GaitSettings,
        caps: Caps,
        attempts: list[Attempt],
    ) -> Attempts:
        """Attempts in their order, up to the chart that the verifier accepts.

        Raises KeyboardInterrupt when stopped.
        """
        from stancekit.walks import walked

        doubts = list(doubt(task, caps.total_s))
        signals = (signal.SIGINT, signal.SIGTERM)
        with as_options(*_SETTINGS, **_CALLED), watching(self.terrain) as bar:

            def show(*at: Any) -> None:
                while doubts:  # the search begins
                    err.print(doubts.pop())
                bar(*at)

            return walked(task, settings, caps, attempts, progress=show, signals=signals)

    # ------------------------------------------------------------------------------------------------
    # output

    def _write(self, best: Attempted) -> bool:
        from stancekit.planners.formats.motion_file import write_motion

        if self.out is None or not (best.verified or self.unverified):
            return False
        write_motion(self.out, best.trajectory, best.report)
        return True

    def _say(self, plan: Attempts, best: Attempted, written: bool) -> None:

        say(words(plan))
        if (loads := joints(best)) is not None:
            parts = [
                f"{name} {each['value']:.2g}{'' if each['unit'] == '1' else ' ' + each['unit']}"
                f"{' of ' + each['where'] if name in ('torque', 'joint_speed') else ''}"
                for name, each in loads.items()
            ]
            out.print(f"whole body: {', '.join(parts)}", highlight=False)
        say([best.report.remark] if best.solution.success else [])
        say(best.trajectory.robot.unrunnable, "cannot be run: {}")
        say(best.trajectory.doubts, "doubt: {}")
        if written:
            mark = "" if best.report.accepted else ", NOT VERIFIED"
            out.print(f"{self.out}: {best.trajectory.samples} samples{mark}")
        elif self.out is not None:
            remark = ", from what this run found" if best.solution.success else ""
            out.print(
                f"{self.out}: not written; --unverified writes what the verifier refuses{remark}"
            )
