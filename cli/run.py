"""``stancekit run``: forward an accepted plan to a world, simulated or real."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.markup import escape
from rich.table import Table

from stancekit.planners.outcome import InvalidInput

from .console import as_options, emit, err, out, progress

if TYPE_CHECKING:
    from stancekit.envs.runner.estop import Source, StopLatch
    from stancekit.envs.runner.log import Log
    from stancekit.envs.runner.report import RunReport


@dataclass
class Run:
    """Run a plan on a world: a simulator, a log, servos on a bus, or a robot behind a rosbridge.

    Only a plan that the verifier accepted is run, unchanged since, on the robot that it was made for. Joints, limits
    and the way to the first pose are checked before anything moves. Without --arm nothing is sent to anything real: it
    is a dry run that says what would have been sent. Any key, Ctrl-C, SIGTERM, SIGUSR1 and the stop file stop the
    robot; after a stop nothing is sent any more.

      stancekit run plan.json --world mujoco --log run.mcap
      stancekit run plan.json --world dynamixel --setup servos.yaml
      stancekit run plan.json --world dynamixel --setup servos.yaml --arm --ending torque-off

    Exit code 0 where the plan was run as planned, 1 where it was stopped or missed its goal, 2 for bad input: then
    nothing has moved.
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """Plan file."""
    world: Literal["bullet", "mujoco", "replay", "dynamixel", "ros"] = "mujoco"
    """Where to run it."""
    setup: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """replay: the log. dynamixel: the calibration file. ros: the set-up file."""
    arm: bool = False
    """Move something real. Simulations and logs need no arming."""
    ending: Literal["hold", "home", "torque-off"] = "hold"
    """The state to leave the robot in. home: the pose that it was found in; after a stop it holds instead."""
    hung: bool = False
    """The robot hangs in a stand, off the ground: its feet carry nothing, and torques are checked for that."""
    pace: float = 1.0
    """How fast at most; slower where the joints' limits ask for it."""
    rate_hz: float | None = None
    """Commands a second, where not the world's own: 200 in simulations, 50 on robots."""
    speed_rad_s: float = 0.4
    """Of the soft start, and of the way home."""
    log: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mcap")] = None
    """Log of everything, for `stancekit replay`; readable up to the last message whatever ends the run."""
    stop_file: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Stop as soon as this file is there."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the tracking, .png, .pdf or .svg; with --log."""
    json: bool = False
    """Print the report as one JSON object."""

    def run(self) -> int:
        """Check, run, report."""
        from stancekit.envs.motion import Timing
        from stancekit.envs.runner.acceptance import Accepted
        from stancekit.envs.runner.estop import StopLatch, on_signals
        from stancekit.envs.runner.runner import Runner, RunSettings
        from stancekit.envs.runner.worlds import make_run_world

        self._check()
        accepted = Accepted.from_file(self.plan)
        latch = StopLatch()
        with ExitStack() as stack:
            with as_options():
                settings = RunSettings(
                    timing=Timing().at_pace(self.pace),
                    speed_rad_s=self.speed_rad_s,
                    ending=self.ending,
                    hung=self.hung,
                )
                world = make_run_world(self.world, accepted.plan.course, setup=self.setup, rate_hz=self.rate_hz)
            stack.callback(world.close)
            stack.enter_context(on_signals(latch))
            sources = stack.enter_context(self._sources(latch))
            log = self._log(stack)
            bar = stack.enter_context(progress(f"run {accepted.plan.course.name} on {self.world}"))
            runner = Runner(
                world, settings=settings, dry=not self.arm, latch=latch, sources=sources, log=log, progress=bar
            )
            report = runner.run(accepted)
        if self.picture is not None and self.log is not None:
            from stancekit.envs.picture import save
            from stancekit.envs.runner.chart import draw_tracking
            from stancekit.envs.runner.log import read_log

            save(draw_tracking(read_log(self.log)), self.picture)
        if self.json:
            emit({"plan": str(self.plan), **report.to_json()})
        else:
            out.print(run_table(report))
            for path in (self.log, self.picture):
                if path is not None:
                    out.print(f"written: {path}", markup=False)
        return 0 if report.succeeded else 1

    def _check(self) -> None:
        """Raise InvalidInput for an option that is out of range or a file that cannot be written."""
        from stancekit.planners.files import check_writable

        if not 0.05 <= self.pace <= 4.0:
            raise InvalidInput(f"--pace: expected a number from 0.05 to 4, got {self.pace:g}")
        if self.rate_hz is not None and not 1.0 <= self.rate_hz <= 1000.0:
            raise InvalidInput(f"--rate-hz: expected a number from 1 to 1000, got {self.rate_hz:g}")
        if self.log is not None:
            check_writable(self.log)
        if self.picture is not None:
            from stancekit.envs.plan_picture import check_picture

            if self.log is None:
                raise InvalidInput("--picture: expected --log FILE.mcap with it, from which it is drawn, got none")
            check_picture(self.picture)

    def _log(self, stack: ExitStack) -> Log:
        from stancekit.envs.runner.log import McapLog, NoLog

        return NoLog() if self.log is None else stack.enter_context(McapLog(self.log))

    @contextmanager
    def _sources(self, latch: StopLatch) -> Iterator[list[Source]]:
        """Keys and the stop file."""
        from stancekit.envs.runner.estop import file_source, key_source, raw_keys

        sources = [] if self.stop_file is None else [file_source(self.stop_file)]
        if sys.stdin is None or not sys.stdin.isatty():
            yield sources
            return
        err.print("any key stops the robot")
        with raw_keys(sys.stdin.fileno()):
            yield [*sources, key_source(sys.stdin.fileno())]


def run_table(report: RunReport) -> Table:
    """The report, for people."""
    table = Table(box=None, show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    word = "dry run, nothing was sent" if report.dry else "run as planned"
    table.add_row("verdict", f"[green]{word}[/]" if report.succeeded else "[red]failed[/]")
    if report.message:
        table.add_row("", escape(report.message))
    ended = f"{report.ended.left}, after {1e3 * report.ended.seconds:.1f} ms"
    table.add_row("robot left", f"{ended}: {escape(report.ended.message)}" if report.ended.message else ended)
    slowed = f", slowed down by the {report.bound_by}" if report.bound_by else ""
    table.add_row("motion", f"{report.seconds:.1f} s on {report.world}, pace {report.pace:.2f}{slowed}")
    table.add_row("key frames", f"{report.frames_done:.1f} of {report.frames - 1}")
    table.add_row("commands", f"{report.sent} sent, {report.clipped} clipped, {report.refused} refused")
    if report.replay_rad is not None:
        table.add_row("log", f"its commands differ by {report.replay_rad:.2g} rad at most")
    table.add_row(
        "joints",
        f"{1e3 * report.joint_worst_rad:.1f} mrad from the plan at most ({report.joint_worst}), "
        f"{1e3 * report.joint_rms_rad:.1f} mrad (RMS)",
    )
    if report.execution is not None:
        run = report.execution
        table.add_row(
            "body", f"{1e3 * run.com_final_m:.1f} mm from the plan at the end, {1e3 * run.com_worst_m:.1f} mm at most"
        )
        table.add_row("feet", f"slid {1e3 * float(run.slip_m.max()):.1f} mm at most")
        table.add_row("forces", f"{run.force_rms_n:.1f} N (RMS) from what was planned")
    median, late = (1e3 * value for value in report.cycle_s)
    table.add_row("cycle", f"{median:.1f} ms median, {late:.1f} ms 99th percentile")
    return table
