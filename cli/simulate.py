"""``stancekit simulate``: execute a plan in a simulated world and compare."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, emit, facts, out, progress, say_written
from .options import OptionalFloat, OptionalPath, check_drawn, check_out
from .pictures import show

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import Motion, RunReport
    from stancekit.runner.report import Execution
    from stancekit.runner.worlds.world import JointBus


_KINDS = {"int": "an integer", "float": "a number"}


def slip(box: str) -> str:
    """Refusal that a box with a title holds, up to the first line that is ruled in it, and the
    option that it means.
    """
    rows = [row.strip().strip("│").strip() for row in box.splitlines()[1:]]
    body = list(dropwhile(_is_rule, rows))
    text = " ".join(takewhile(lambda row: not _is_rule(row), body)).rstrip(". ")
    return (
        _choice(text)
        or _number(text)
        or _unknown(text, body)
        or _without(text)
        or _missing(text)
        or text
    )


def _is_rule(row: str) -> bool:
    return row != "" and not row.strip("─-╰╯")


def _choice(said: str) -> str:
    match = re.fullmatch(
        r"invalid choice (.+) for argument '(\S+)'\. Expected one of \((.+)\)", said
    )
    if match is None:
        return ""
    names = sorted(
        set(re.findall(r"'([^']*)'", match[3])) - {"None"}
    )  # a set's order differs from run to run
    return f"{match[2]}: expected one of {', '.join(names)}, got {match[1]}"


def _number(said: str) -> str:
    match = re.match(r"Error parsing (\S+): ", said)
    kind = re.search(r"invalid literal for (int)\(\)|could not convert string to (float)", said)
    came = re.search(r"\['(.*?)'\]|: ('.*')$", said)
    if match is None or kind is None or came is None:
        return ""
    return f"{match[1]}: expected {_KINDS[kind[1] or kind[2]]}, got {came[2] or repr(came[1])}"


def _unknown(said: str, body: list[str]) -> str:
    name, colon, rest = said.partition("Unrecognized options: ")
    if name or not colon:
        return ""
    meant = dropwhile(lambda row: row != "Perhaps you meant:", body)
    hints = [row.split()[0] for row in meant if re.match("--[a-z]", row)]
    perhaps = f"; perhaps {' or '.join(dict.fromkeys(hints))}" if hints else ""
    what = (
        f"no such option{perhaps}" if rest.startswith("-") else "expected no further argument here"
    )
    return f"{rest.split(', ')[0]}: {what}"


def _without(said: str) -> str:
    match = re.fullmatch(r"Missing value for argument '(\S+)'\. Expected 1 values", said)
    return "" if match is None else f"{match[1]}: expected a value after it, got none"


def _missing(said: str) -> str:
    match = re.match(r"Missing from stancekit [a-z -]+: (--[\w-]+|[A-Z_]+)", said)
    return "" if match is None else f"{match[1]}: expected a value for it, got none"


@dataclass
class Simulate:
    """Execute a plan in a world: position control, friction as in the course; what was planned
    against what happened.

    The robot presses with the forces of the plan and follows it by joint positions. It succeeds if
    it does not fall, its centre of mass ends within 3 cm of the plan's and every joint within 0.1
    rad, and no foot slides by more than 2 cm. Nothing is slowed down: `stancekit run` does that, or
    says what no pace helps with. A film takes longer than the execution. Needs the extra robots,
    and for bullet catalogue.

      stancekit plan walls --out plan.json
      stancekit simulate plan.json --picture end.png --video film.mp4
      stancekit simulate plan.json --world bullet

    Exit code 0 where the execution succeeded, 1 where it failed, 2 for bad input, as a plan that the
    verifier rejects.
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """File of a plan, a walk, a leap or a crossing."""
    world: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = "mujoco"
    """Which simulation: bullet, mujoco, one of another package, or a class in a file."""
    forces: Literal["shared", "planned"] = "shared"
    """Press as planned, or with forces shared anew among the limbs of every stance, with a reserve
    of friction."""
    pace: float = 1.0
    """How fast: 2 takes half the time, as far as the joints can turn."""
    contact_stiffness_n_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="N/M")] = None
    """Feet sink into the ground by their force over this; without it the ground is hard."""
    contact_damping_ns_m: Annotated[OptionalFloat, tyro.conf.arg(metavar="NS/M")] = None
    """Damping of that; without it a robot on all its feet sinks without swinging."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the end, .png, .pdf or .svg."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Film, .mp4, at twice the pace (extra viz, and a GL library)."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File for what was recorded every 5 ms, .npz."""
    json: bool = False
    """Print the report as one JSON object."""

    def run(self) -> int:
        """Read, execute, compare."""
        from stancekit import RunSettings
        from stancekit.motions import WORLDS, accepted_of, check_run, simulate
        from stancekit.planners.files.arrays import checked
        from stancekit.planners.motion.plan_motion import Timing
        from stancekit.runner.worlds.settings import SoftContact, WorldSettings

        checked(self.pace, "--pace", least=0.1, most=4.0)
        check_drawn(self.picture, self.video)
        check_out(self.out, ".npz")
        accepted = accepted_of(self.plan)
        if self.picture is not None and accepted.plan.has("times_s"):
            raise InvalidInput(
                "--picture: expected none with a walk: --video films what was executed"
            )
        timing = Timing().at_pace(self.pace)
        settings = RunSettings(timing=timing, forces=self.forces, check_limits=False)
        try:
            with as_options("world"):
                check_run(accepted, self.world, settings, led=False)
        except InvalidInput as error:
            raise InvalidInput(str(error).replace("timing:", "--pace:")) from None
        world: str | JointBus = self.world
        with as_options("world", "contact_stiffness_n_m", "contact_damping_ns_m"):
            contact = SoftContact.of(self.contact_stiffness_n_m, self.contact_damping_ns_m)
            if contact is not None and (kind := WORLDS.get(self.world)).kind == "simulation":
                world = kind.make(
                    WorldSettings(
                        robot=accepted.robot, gravity_m_s2=accepted.gravity_m_s2, contact=contact
                    )
                )
        with as_options("world"), progress(f"simulate {accepted.name} in {self.world}") as bar:
            report = simulate(accepted, world, settings=settings, progress=bar)
        execution = report.execution
        if execution is None:
            complain(f"stancekit: failed: {self.plan}: {report.message}")
            return 1
        self._write(accepted.plan, execution)
        if self.json:
            doubts = list(accepted.plan.doubts)
            emit({"plan": str(self.plan), **_record(report, execution), "doubts": doubts})
        else:
            out.print(_table(report, execution))
            for line in accepted.plan.doubts:
                out.print(f"doubt: {line}", highlight=False)
            say_written(self.picture, self.video, self.out, word="written: {}")
        return 0 if report.succeeded else 1

    def _write(self, motion: Motion[Any], execution: Execution) -> None:
        if self.out is not None:
            from stancekit.planners.files.writing import write_bytes

            write_bytes(self.out, execution.trace.to_npz())
        show(motion, execution, picture=self.picture, video=self.video)


def _message(report: RunReport, run: Execution) -> str:
    """Why it failed: what stopped it before its end, or else what was off the plan."""
    if report.stopped_s is None:
        return run.message or report.message
    done = f"{report.frames_done:.0f} of {report.frames:.0f} {report.counted}"
    return f"stopped after {done}: {report.message}"


def _record(report: RunReport, run: Execution) -> dict[str, Any]:
    """The figures, with the verdict on the whole run."""
    return run.to_json() | {"succeeded": report.succeeded, "message": _message(report, run)}


def _table(report: RunReport, run: Execution) -> Table:
    final, worst, slid, shift, error = (
        1e3 * value
        for value in (
            run.com_final_m,
            run.com_worst_m,
            float(run.slip_m.max()),
            run.shift_m,
            run.error_m,
        )
    )
    done = report.succeeded
    verdict = "executed as planned" if done else "failed" if report.stopped_s is None else "stopped"
    torques = f"{run.torque_worst_nm:.1f} Nm at most, planned {run.planned_torque_nm:.1f}, limit {run.torque_limit_nm:g}"
    bump = f"touched something other than a foot for {run.bump_s:.2f} s"
    return facts(
        [
            ("verdict", Text(verdict, style="green" if done else "red")),
            ("", _message(report, run)),
            (
                "centre of mass",
                f"{final:.1f} mm from the plan's at its end, {worst:.1f} mm at most on the way",
            ),
            ("feet", f"slid {slid:.1f} mm at most, over {len(run.slip_m)} footholds"),
            ("forces", f"{run.force_rms_n:.1f} N (RMS) from what was planned"),
            ("joints", f"{torques}; inverse kinematics within {error:.2g} mm"),
            (
                "body",
                f"turned {run.tilt_worst_rad:.3f} rad from the plan; its origin {shift:.1f} mm "
                "from the centre of mass",
            ),
            ("terrain", bump if run.bump_s > 0.0 else ""),
            ("time", f"{run.seconds:.1f} s in {run.world}, {run.wall_s:.1f} s to compute"),
        ]
    )
