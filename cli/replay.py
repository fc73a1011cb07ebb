"""``stancekit replay``: what a log of a run says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.text import Text

from .console import emit, facts, out, say_written
from .options import OptionalPath, check_drawn

if TYPE_CHECKING:
    from rich.table import Table


@dataclass
class Replay:
    """Read the log of a run: which plan, what was decided, how well it was followed, and how it
    ended.

    A log whose writer was killed is read up to its last message. `stancekit run PLAN --world replay
    --setup LOG` runs the plan again against what was measured then, and compares the commands.

    Exit code 0 where the run ended well, 1 where it did not or the log breaks off, 2 for what is no
    log.
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """Log file, as `stancekit run --log` writes it."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the tracking, .png, .pdf or .svg."""
    json: bool = False
    """Print everything as one JSON object."""

    def run(self) -> int:
        """Read, and tell."""
        from stancekit.runner.log import read_log
        from stancekit.views.gait_plot import differences, draw_tracking, tracked

        check_drawn(self.picture)
        recorded = read_log(self.log)
        plan, verdicts = recorded.of("plan")[0], recorded.of("verdict")
        commands = recorded.of("command")
        record: dict[str, Any] = {
            "log": str(self.log),
            "whole": recorded.whole,
            **{
                name: plan.get(name)
                for name in ("digest", "course", "world", "dry", "rate_hz", "pace")
            },
            "commands": len(commands),
            "decisions": recorded.of("decision"),
            "verdict": verdicts[-1] if verdicts else None,
            **(differences(tracked(recorded)) if commands else {}),
        }
        if self.picture is not None:
            from stancekit.views.sheet import save

            save(draw_tracking(recorded), self.picture)
        if self.json:
            emit(record)
        else:
            out.print(_table(record))
            say_written(self.picture, word="written: {}")
        return 0 if recorded.whole and verdicts and verdicts[-1]["succeeded"] else 1


def _table(record: dict[str, Any]) -> Table:
    verdict, dry = record["verdict"], ", dry" if record["dry"] else ""
    word = Text("none: the process was ended", style="red")
    if verdict is not None:
        done = verdict["succeeded"]
        word = Text("run as planned" if done else verdict["message"], "green" if done else "red")
    joints = ""
    if "joint_worst_rad" in record:
        worst, rms = 1e3 * record["joint_worst_rad"], 1e3 * record["joint_rms_rad"]
        joints = f"{worst:.1f} mrad from the plan at most, {rms:.1f} mrad (RMS)"
    return facts(
        [
            ("verdict", word),
            (
                "plan",
                f"{record['course']} on {record['world']}{dry}, digest "
                f"{str(record['digest'])[:16]}…",
            ),
            ("commands", f"{record['commands']} at {record['rate_hz']:g} Hz"),
            ("joints", joints),
            *((decision["what"], str(decision["why"])) for decision in record["decisions"]),
        ]
    )
