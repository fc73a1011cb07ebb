"""``stancekit gait``: plan a walk over a terrain, and have it verified."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from stancekit.planners.outcome import InvalidInput, PlanningFailed

from .console import as_options, emit, err, out
from .watch import interruptible, shown

if TYPE_CHECKING:
    from stancekit.planners.arrays import Array
    from stancekit.planners.gait.attempt import Attempt, Attempted, Workbench
    from stancekit.planners.gait.partial import Partial
    from stancekit.planners.gait.robot import GaitRobot
    from stancekit.planners.gait.task import GaitTask

ROBOTS = ("anymal", "hexapod")


@dataclass
class Gait:
    """Plan a walk over a terrain and verify it between the knots; write it only if the verifier accepts.

    TERRAIN is a reference terrain (ripple, cone, hill, pit, pit-84, pit-87), a drawn one as rough:0.5:7
    (FAMILY:DIFFICULTY:SEED), or a file of heights. A place is written x,y in metres; a negative one needs the sign =,
    as in --start=-2.6,0.

    A run that is interrupted keeps what it has beside --out; the same command goes on from there.

    Exit code 0 if the verifier accepts the walk, 1 if none was found that it accepts.
    """

    terrain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TERRAIN")]
    """Name, draw or file."""
    goal: Annotated[str, tyro.conf.arg(metavar="X,Y")]
    """Where the torso has to end."""
    start: Annotated[str, tyro.conf.arg(metavar="X,Y")] = "0,0"
    """Where it begins, at rest."""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "anymal"
    """anymal, hexapod, or a robot's file (YAML)."""
    chart: Literal["portfolio", "ambient", "warped", "warped-exact", "shear", "decoupled"] = "portfolio"
    """In which coordinates to solve; portfolio tries one after another until the verifier accepts."""
    timings: Literal["fixed", "optimised"] = "fixed"
    """Whether the phases keep the gait's timing, or are optimised with the rest."""
    gait: Literal["trot", "walk", "pace", "bound", "gallop", "tripod"] | None = None
    """Order of steps; trot on four feet, tripod on six."""
    dynamics: Literal["centred", "printed", "newton-euler"] = "centred"
    """How forces balance: the centred discrete model, the paper's, or Newton-Euler's equations."""
    hessian: Literal["exact", "lbfgs"] = "exact"
    """Second derivatives, or the paper's quasi-Newton."""
    duration_s: float = 10.0
    """Time to walk [s]."""
    friction: float = 0.75
    """Friction coefficient of the terrain."""
    adhesive: Annotated[str, tyro.conf.arg(metavar="FEET")] = ""
    """Feet that stick, e.g. LF,RF: they may pull, and have no friction cone."""
    seeds: int = 1
    """How many initial guesses of each chart to try; the smoothest accepted walk is kept."""
    seed: int = 0
    """Seed of the perturbed guesses; the first guess is never perturbed."""
    max_iterations: int = 200
    """Limit a solve."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.json")] = None
    """Where to write the trajectory; its samples go to FILE.npz."""
    unverified: bool = False
    """Write the best trajectory even if the verifier refuses it, marked so."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the motion: .png, .pdf or .svg."""
    convergence: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the violation at every iteration."""
    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Film of the motion."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html")] = None
    """Page with the motion in 3D, to be opened without a network."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Plan, verify, write, draw."""
        from stancekit.planners.gait.attempt import Workbench
        from stancekit.planners.gait.partial import Partial

        self._check_files()
        task = self._task()
        with as_options():
            bench = Workbench(task, self._settings())
        attempts = self._attempts()
        partial = Partial(self.out, task, bench.settings, attempts)
        tried = self._try(bench, attempts, partial)
        if not tried:
            raise PlanningFailed(
                f"every attempt failed before the run was interrupted; remove {partial.path} to try anew"
            )
        best = min(tried, key=_merit)
        written = self._write(best)
        self._draw(best, tried, bench)
        partial.remove()
        self._say(best, tried, written)
        return 0 if best.report.accepted else 1

    # ------------------------------------------------------------------------------------------------- input

    def _check_files(self) -> None:
        """Raise InvalidInput for what cannot be written, before any work."""
        from stancekit.planners.files import check_writable
        from stancekit.planners.gait.record import check_names

        if self.out is not None:
            check_names(self.out)
        if self.unverified and self.out is None:
            raise InvalidInput("--unverified: expected --out with it, got none")
        for picture in (self.picture, self.convergence):
            if picture is not None:
                check_writable(picture)
                if picture.suffix.lower() not in (".png", ".pdf", ".svg"):
                    raise InvalidInput(f"{picture}: expected a name that ends in .png, .pdf, .svg")
        if self.html is not None:
            from stancekit.envs.gait_page import check_page

            check_page(self.html)
        if self.video is not None:
            from stancekit.envs.video import check_video

            check_video(self.video)
        if not 1 <= self.seeds <= 1000:
            raise InvalidInput(f"--seeds: expected 1 to 1000, got {self.seeds}")
        if self.seed < 0:
            raise InvalidInput(f"--seed: expected 0 or more, got {self.seed}")

    def _task(self) -> GaitTask:
        from stancekit.planners.gait.task import GaitTask
        from stancekit.planners.scene.terrains import named_terrain

        start, goal = _place(self.start, "--start"), _place(self.goal, "--goal")
        robot = _robot(self.robot)
        sticky = [name for name in self.adhesive.split(",") if name]
        unknown = sorted(set(sticky) - set(robot.foot_names))
        if unknown:
            raise InvalidInput(f"--adhesive: expected some of {', '.join(robot.foot_names)}, got {', '.join(unknown)}")
        terrain = named_terrain(self.terrain)
        try:
            return GaitTask(
                robot=robot,
                terrain=terrain,
                start_xy_m=start,
                goal_xy_m=goal,
                duration_s=self.duration_s,
                friction=self.friction,
                adhesive=tuple(name in sticky for name in robot.foot_names),
                gait=self.gait or ("trot" if len(robot.feet) == 4 else "tripod"),
                timings=self.timings,
            )
        except InvalidInput as error:
            raise InvalidInput(_as_options(str(error))) from None

    def _settings(self) -> Any:
        from stancekit.planners.gait.task import GaitSettings

        return GaitSettings(dynamics=self.dynamics, hessian=self.hessian, max_iterations=self.max_iterations)

    def _attempts(self) -> list[Attempt]:
        from stancekit.planners.gait.attempt import Attempt, portfolio

        ways = portfolio() if self.chart == "portfolio" else [Attempt(chart=self.chart)]
        return [way.perturbed(self.seed + k) if k else way for way in ways for k in range(self.seeds)]

    # -------------------------------------------------------------------------------------------------- work

    def _try(self, bench: Workbench, attempts: list[Attempt], partial: Partial) -> list[Attempted]:
        """Attempts in their order; of a portfolio up to the chart that the verifier accepts."""
        tried: list[Attempted] = []
        for index, attempt in enumerate(attempts):
            if self.chart == "portfolio" and index % self.seeds == 0 and any(one.report.accepted for one in tried):
                break
            guess, stage = partial.begin(index)
            if stage < 0:
                continue
            with interruptible() as interrupted, shown(attempt.name) as show:
                found = bench.run(attempt, lambda *at: show(*at) or interrupted(), guess=guess, stage=stage)
            partial.keep(index, found)
            if found.stopped:
                if partial.path is not None:
                    err.print(f"{partial.path}: kept; the same command goes on from there", markup=False)
                raise KeyboardInterrupt
            tried.append(found)
        return tried

    # ------------------------------------------------------------------------------------------------ output

    def _write(self, best: Attempted) -> bool:
        from stancekit.planners.gait.record import write_trajectory

        if self.out is None or not (best.report.accepted or self.unverified):
            return False
        write_trajectory(self.out, best.trajectory, best.report)
        return True

    def _draw(self, best: Attempted, tried: list[Attempted], bench: Workbench) -> None:
        warp = bench.warp.points if bench.warp is not None and best.attempt.chart.startswith("warped") else None
        if self.picture is not None:
            from stancekit.envs.chart import save
            from stancekit.envs.gait_picture import draw_motion

            save(draw_motion(best.trajectory, best.report, warp=warp), self.picture)
        if self.convergence is not None:
            from stancekit.envs.chart import save
            from stancekit.envs.gait_chart import GaitRun, draw_convergence

            runs = [GaitRun(method=one.attempt.name, violations=one.history, seconds=one.seconds) for one in tried]
            save(draw_convergence(runs, caption=f"Convergence on {bench.task.terrain.name}"), self.convergence)
        if self.video is not None:
            from stancekit.envs.gait_video import motion_frames
            from stancekit.envs.video import write_video

            write_video(self.video, motion_frames(best.trajectory, best.report, warp=warp))
        if self.html is not None:
            from stancekit.envs.gait_page import write_page

            write_page(self.html, best.trajectory, best.report, warp=warp)

    def _say(self, best: Attempted, tried: list[Attempted], written: bool) -> None:
        record = {
            "terrain": self.terrain,
            "verified": best.report.accepted,
            "attempt": best.attempt.name,
            "message": _verdict(best),
            "digest": best.report.digest if best.report.accepted else None,
            "out": str(self.out) if written else None,
            "figures": dict(best.report.figures),
            "attempts": [_attempt_record(one) for one in tried],
        }
        if self.json:
            emit(record)
            return
        for one in tried:
            line = f"{one.attempt.name}: {one.iterations} iterations, {one.seconds:.1f} s, {_verdict(one)}"
            out.print(line, markup=False, highlight=False)
        if written:
            mark = "" if best.report.accepted else ", NOT VERIFIED"
            out.print(f"{self.out}: {best.trajectory.samples} samples{mark}", markup=False)
        elif self.out is not None:
            out.print(f"{self.out}: not written; --unverified writes what the verifier refuses", markup=False)


def _attempt_record(one: Attempted) -> dict[str, Any]:
    return {
        "attempt": one.attempt.name,
        "chart": one.attempt.chart,
        "success": one.solution.success,
        "verified": one.report.accepted,
        "iterations": one.iterations,
        "cpu_seconds": one.seconds,
        "violation": one.solution.violation,
        "violations": [float(value) for value in one.history],
        "message": _verdict(one),
    }


def _verdict(one: Attempted) -> str:
    """What came of an attempt: the solver's failure, or the verifier's word."""
    if one.solution.success or one.report.accepted:
        return one.report.message
    return f"no success: largest violation {one.solution.violation:.1e} ({one.solution.status})"


def _merit(one: Attempted) -> tuple[bool, bool, float]:
    """Verified before feasible before the rest, then the smaller peak acceleration, or violation."""
    peak = one.report.figures.get("peak_acceleration_g", float("inf"))
    return not one.report.accepted, not one.solution.success, peak if one.solution.success else one.solution.violation


def _place(text: str, option: str) -> Array:
    """A place X,Y, shape (2,) [m]."""
    import numpy as np

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InvalidInput(f"{option}: expected a place X,Y in metres, got {text!r:.60}") from None
    return np.array([x, y])


def _robot(name: str) -> GaitRobot:
    from stancekit.planners.gait.robot import GaitRobot, anymal, hexapod_walker

    if name in ROBOTS:
        return anymal() if name == "anymal" else hexapod_walker()
    if not Path(name).exists():
        raise InvalidInput(f"--robot: expected {', '.join(ROBOTS)} or a robot's file, got {name!r}")
    return GaitRobot.from_yaml(name)


def _as_options(message: str) -> str:
    """A task's message with the names of its fields as the options that gave them."""
    names = {"start_xy_m": "start", "goal_xy_m": "goal"}
    parts = []
    for part in message.split("; "):
        name, colon, rest = part.partition(":")
        known = names.get(name, name if name in ("duration_s", "friction", "gait", "timings", "adhesive") else "")
        parts.append(f"--{known.replace('_', '-')}{colon}{rest}" if known else part)
    return "; ".join(parts)
