"""The command ``stancekit``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

import tyro
from stancekit.planners.outcome import InvalidInput, StancekitError

from .console import complain
from .demo import Demo
from .evaluate import Evaluate
from .fit import Fit
from .label import LabelPostures
from .picture import Picture
from .sample import Sample
from .solve import Solve
from .verify import Verify

DESCRIPTION = """Legged robots learn and plan on hard terrain.

A session, from terrain to a picture:
  stancekit sample wall-3 --count 3 > postures.jsonl
  stancekit solve postures.jsonl
  stancekit label wall-3 data/wall-3 --feasible 500 --infeasible 500
  stancekit fit data/wall-3 --method gmm --out envelope.json
  stancekit evaluate data/wall-3 --envelope envelope.json
  stancekit picture postures.jsonl --out posture.png

Exit code: 0 done; 1 ran, but a check failed; 2 bad input. With --json, one JSON object a line on standard output."""

Verb = (
    Annotated[Sample, tyro.conf.subcommand("sample")]
    | Annotated[Solve, tyro.conf.subcommand("solve")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[LabelPostures, tyro.conf.subcommand("label")]
    | Annotated[Fit, tyro.conf.subcommand("fit")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Picture, tyro.conf.subcommand("picture")]
    | Annotated[Demo, tyro.conf.subcommand("demo")]
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one verb and exit with its code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments in (["--version"], ["-V"]):
        sys.stdout.write(f"stancekit {version('stancekit')}\n")
        return
    verb = tyro.cli(
        Verb,
        prog="stancekit",
        description=DESCRIPTION,
        args=arguments or ["--help"],
        config=(tyro.conf.OmitArgPrefixes,),
    )
    sys.exit(run(verb))


def run(verb: Verb) -> int:
    """Run a verb; what goes wrong on purpose becomes one line and an exit code."""
    try:
        return verb.run()
    except InvalidInput as error:
        complain(f"stancekit: error: {error}")
        return 2
    except StancekitError as error:
        complain(f"stancekit: failed: {error}")
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        complain("stancekit: interrupted")
        return 130


if __name__ == "__main__":
    main()
