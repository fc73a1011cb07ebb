"""The reports of runs, for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from stancekit.runner.control.loop_report import LoopReport
    from stancekit.runner.report import RunReport
    from stancekit.runner.safety.ending import Ended

BUSY = 1.0
"""A computer with more processes than processors keeps no time."""


def run_table(report: RunReport) -> Table:
    """The report, for people."""
    word = "dry run, nothing was sent" if report.dry else "run as planned"
    table = _begun(word, report.message, report.ended)
    slowed = f", slowed down by the {report.bound_by}" if report.bound_by else ""
    table.add_row(
        "motion", f"{report.seconds:.1f} s on {report.world}, pace {report.pace:.2f}{slowed}"
    )
    table.add_row(report.counted, f"{report.frames_done:.1f} of {round(report.frames - 1, 1):g}")
    table.add_row(
        "commands",
        f"{report.sent} {'computed' if report.dry else 'sent'}, {report.clipped} clipped, "
        f"{report.refused} refused",
    )
    if report.replay_rad is not None:
        table.add_row("log", f"its commands differ by {report.replay_rad:.2g} rad at most")
    if report.joint_worst:
        worst, rms = 1e3 * report.joint_worst_rad, 1e3 * report.joint_rms_rad
        table.add_row(
            "joints",
            f"{worst:.1f} mrad from the plan at most ({report.joint_worst}), {rms:.1f} mrad (RMS)",
        )
    for name, needs in (("needs", report.needs), ("measured", report.loads)):
        if needs is not None:
            table.add_row(name, needs.line)
    if report.body_from == "leg odometry":
        table.add_row("body", "fed back by leg odometry: the joints, and the feet that stand")
    elif not report.body_measured:
        table.add_row("body", "not measured: joints alone were followed")
    if math.isfinite(report.odometry_m):
        table.add_row(
            "", f"{1e3 * report.odometry_m:.1f} mm from the plan at most, by leg odometry"
        )
    if report.execution is not None:
        run = report.execution
        table.add_row(
            "body",
            f"{1e3 * run.com_final_m:.1f} mm from the plan at the end, {1e3 * run.com_worst_m:.1f} "
            "mm at most",
        )
        table.add_row(
            "",
            f"its origin {1e3 * run.body_rms_m:.1f} mm (RMS), {1e3 * run.body_worst_m:.1f} mm at "
            "most",
        )
        late_ms = 1e3 * float(run.late_s.max())
        table.add_row(
            "feet",
            f"slid {1e3 * float(run.slip_m.max()):.1f} mm at most, touched up to {late_ms:.0f} ms "
            "late",
        )
        table.add_row("forces", f"{run.force_rms_n:.1f} N (RMS) from what was planned")
        if abs(report.loop_share - 1.0) > 0.05:
            table.add_row(
                "loops", f"joints found {report.loop_share:.2f} times as stiff as they should be"
            )
    if report.friction is not None:
        table.add_row("friction", report.friction.line)
    median, late = (1e3 * value for value in report.cycle_s)
    if math.isfinite(median):
        table.add_row("cycle", f"{median:.1f} ms median, {late:.1f} ms 99th percentile")
    if report.message and not report.dry and report.load > BUSY:
        table.add_row(
            "computer",
            f"{report.load:.1f} processes for each processor: a run that comes too late may stop "
            "for that",
        )
    return table


def loop_table(report: LoopReport, answers: tuple[int, int] | None) -> Table:
    """The report of a closed loop.

    Arguments:
        answers: plans made within what a selector chose, and without.
    """
    table = _begun("walked to the end", report.message, report.ended)
    if answers is not None and not answers[0]:
        table.add_row("warning", Text(unused(answers), style="yellow"))
    table.add_row("key frames", f"{report.frames} reached")
    table.add_row("plans", f"{report.plans}, {report.replans} of them because of a deviation")
    if answers is not None:
        table.add_row(
            "selector",
            f"{answers[0]} plans within the envelopes that it chose, {answers[1]} without",
        )
    table.add_row("friction", f"{report.friction.line}; planned on {report.planned_share:.2f}")
    if report.surfaces:
        table.add_row("surfaces", report.surfaces)
    table.add_row("deviation", f"{1e3 * report.deviation_m:.1f} mm from the plan at most")
    table.add_row("body", f"{1e3 * report.com_final_m:.1f} mm from the last plan at the end")
    table.add_row("time", f"{report.seconds:.1f} s of motion, {report.plan_s:.1f} s of planning")
    return table


def unused(answers: tuple[int, int]) -> str:
    """Line about a run to which a policy contributed nothing.

    Arguments:
        answers: see ``loop_table``.
    """
    return f"the policy made none of the {answers[1]} plans that were made" + (
        ": the lift did" if answers[1] else ""
    )


def _begun(word: str, message: str, ended: Ended) -> Table:
    """A table with the verdict, and how the robot was left."""
    table = Table(box=None, show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_row(
        "verdict", Text("failed" if message else word, style="red" if message else "green")
    )
    if message:
        table.add_row("", message)
    left = f"{ended.left}, after {1e3 * ended.seconds:.1f} ms"
    table.add_row("robot left", f"{left}: {ended.message}" if ended.message else left)
    return table
