"""Which options of ``stancekit run`` go with each other and with its world."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from stancekit.planners.errors import InvalidInput

from .options import check_drawn

if TYPE_CHECKING:
    from stancekit.runner.worlds import WorldClass

    from .run import Run


def check_run(run: Run, kind: WorldClass) -> None:
    """Raise InvalidInput for an option out of range, or with another world, and a file that cannot be written."""
    from stancekit.planners.files.arrays import checked, checked_int
    from stancekit.planners.files.writing import check_writable

    checked(run.pace, "--pace", least=0.05, most=4.0)
    checked(run.friction_share, "--friction-share", above=0.0, most=1.0)
    if run.rate_hz is not None:
        checked(run.rate_hz, "--rate-hz", least=1.0, most=1000.0)
    if run.horizon is not None:
        checked_int(run.horizon, "--horizon", least=0)
    if run.replan_m is not None and not run.replan_m > 0.0:
        raise InvalidInput(f"--replan-m: expected a number above 0, or inf, got {run.replan_m:g}")
    simulated, replayed, led = kind.kind == "simulation", kind.kind == "recording", run.policy is not None
    drawn = f"expected a plan or a gait in a simulated world with it, got {'--policy' if led else run.world}"
    without = "expected --policy with it, got none"
    for wrong, message in (
        (run.friction_share != 1.0 and not simulated,
         f"--friction-share: expected a simulated world with it, got {run.world}"),
        (run.blind and (led or not simulated), f"--blind: {drawn}"),
        (run.actuators is not None and replayed,
         f"--actuators: expected none with world {run.world}: the log has its own"),
        (run.horizon is not None and not led, f"--horizon: {without}"),
        (run.replan_m is not None and not led, f"--replan-m: {without}"),
        (led and replayed, f"--policy: expected a world that answers to what is done, got {run.world}"),
    ):  # fmt: skip
        if wrong:
            raise InvalidInput(message)
    if run.log is not None:
        _check_log(run, run.log)
        check_writable(run.log)
    check_drawn(video=run.video)
    if run.video is not None and (led or not simulated):
        raise InvalidInput(f"--video: {drawn}")
    if run.picture is not None:
        from stancekit.views.sheet import check_picture

        if run.log is None:
            raise InvalidInput("--picture: expected --log FILE.mcap with it, from which it is drawn, got none")
        check_picture(run.picture)


def _check_log(run: Run, log: Path) -> None:
    """Raise InvalidInput for a log that is none by its name, or that would be written over another file here."""
    if log.suffix != ".mcap":
        raise InvalidInput(f"--log: expected a name that ends in .mcap, got {log}")
    policy = None if run.policy is None else Path(run.policy)
    others = {"PLAN": run.plan, "--setup": run.setup, "--policy": policy, "--picture": run.picture}
    for name, other in others.items():
        if other is not None and os.path.realpath(other) == os.path.realpath(log):
            raise InvalidInput(f"--log: expected a file of its own, got that of {name}: {log}")
