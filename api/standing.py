"""Map of where a robot can stand on a terrain."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from stancekit.learners.surrogates.calibration import checked_error
from stancekit.planners.arguments import checked, settings_from
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.arrays import checked as checked_number, checked_int
from stancekit.planners.problem.standing_map import StandingMap as StandingMap
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain.footholds import FRICTION, FootholdLimits, Footholds
from stancekit.planners.terrain.import_options import ImportOptions

_BESIDE: tuple[str, ...] = ("terrain", "robot", "headings", "friction", "time_limit_s", "fit")
_BESIDE += ("surrogate", "error", "seed", "checkpoint", "progress", "limits")
"""Arguments beside the meaning of a file."""


@checked
def map(
    terrain: str | Path,
    *,
    robot: Robot | str | Path | None = None,
    spacing_m: float = 0.1,
    headings: int = 8,
    friction: float = FRICTION,
    time_limit_s: float = 60.0,
    fit: bool = False,
    surrogate: Any = None,
    error: float = 0.005,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int, str], object] | None = None,
    limits: FootholdLimits = FootholdLimits(),
    grid_m: float = ImportOptions.spacing_m,
    **meaning: object,
) -> StandingMap:
    """Say of every place and heading over a terrain whether a robot can stand there, how far it is
    from not being able to, and which limit is in the way.

    Arguments:
        terrain: a mesh, a grid or a point cloud in a file, or a ground by its name as
            "stairs:0.5:7".
        robot: a ``Robot``, a name, a .urdf file, or a .yaml file that names one (extra robots); the
            default hexapod where None.
        spacing_m: distance between places, along x and y [m]; typically 0.02 to 0.2.
        headings: number of headings, evenly about the vertical, the first along x; typically 1 to
            16.
        friction: Coulomb coefficient of the terrain.
        time_limit_s: time limit for everything: poses are proved from coarse to fine until then,
            and the others stay unknown [s].
        fit: learn from the poses that are proved by half of the time which verdict is likely for
            the others (needs torch). The poses for calibration are all proved, even if that takes
            longer.
        surrogate: surrogate that ``fit(rows, "surrogate")`` returned for all limbs of the robot on
            ground, or its file, instead of the one that ``fit`` would learn; it is calibrated on
            this map, too.
        error: largest chance that a pose called likely feasible is not, and that a pose called
            likely infeasible is, at a confidence of 95 %.
        seed: seed for the choice of the poses on which likely answers are calibrated.
        checkpoint: file .npz to which the map is written from time to time, and from which the same
            call goes on.
        progress: function called with the number of settled poses, the number in all, and the
            current task.
        limits: limits of what counts as a foothold; unless given, those of the robot's foot, as for
            ``terrain``.
        grid_m: ``spacing_m`` of ``terrain``: that of a file's grid, and of the map that a cloud
            becomes [m].
        meaning: further fields of ``ImportOptions``, as for ``terrain``: unit_m, up, offset_m, ...

    Returns:
        A ``StandingMap``: ``verdict``, ``margin`` and ``limit`` per pose; ``save`` writes it, and
        ``plan(..., settings=PlanSettings(standing=...))`` goes by it. Feasible and infeasible are proved: a witness that
        the verifier accepted, or a certificate, or a toe without a place to stand.

    Raises:
        InvalidInput: for a terrain that cannot be read or has no place to stand, a grid of no
            cells, an error of 0 or 1, a checkpoint of another map, and a surrogate of another class
            or robot.
    Source:
        None: the exact planner of Lin et al.'s P, pose by pose.

    Example:
        >>> import stancekit
        >>> found = stancekit.map("stairs:0.3:1", spacing_m=0.8, headings=2)
        >>> found.shares()["proved"]
        1.0
    """
    began = time.monotonic()
    checked_error(error)
    checked_number(time_limit_s, "time_limit_s", above=0.0)
    checked_int(seed, "seed", least=0)
    from stancekit.envs.distributions.cut import identity_of
    from stancekit.learners.maps.making import MapSettings, Poses, make_map

    if fit and surrogate is not None:
        raise InvalidInput("fit: expected none with a surrogate, which is learned already")
    for name, came, usual in (("error", error, 0.005), ("seed", seed, 0)):
        if came != usual and not fit and surrogate is None:
            raise InvalidInput(f"{name}: expected fit or a surrogate with it, got neither")
    path = None if checkpoint is None else Path(checkpoint)
    if path is not None and path.suffix != ".npz":
        raise InvalidInput(f"checkpoint: expected a name that ends in .npz, got {path}")
    who = str(robot) if isinstance(robot, Path) else robot
    meant = {**meaning, "spacing_m": grid_m}
    options, footholds = _ground(terrain, who, meant, limits=limits, friction=friction)
    poses = Poses.of(
        footholds,
        who,
        terrain=identity_of(terrain),
        options=_asked(options, limits),
        spacing_m=spacing_m,
        headings=headings,
        friction=friction,
    )
    settings = MapSettings(time_limit_s=time_limit_s, fit=fit, error=error, seed=seed)
    if surrogate is not None:
        from stancekit.learners.surrogates.surrogate import surrogate_of  # loads torch

        surrogate = surrogate_of(surrogate)
    try:
        made = make_map(
            poses, settings, progress, began_s=began, checkpoint=path, surrogate=surrogate
        )
        return replace(made, doubts=footholds.doubts)
    except ImportError as missing:
        raise not_installed("fit", missing.name, "networks", "rl") from None


def _ground(
    terrain: str | Path, robot: Robot | str | None, meaning: dict[str, object], **how: Any
) -> tuple[ImportOptions, Footholds]:
    """How a terrain is read, and its footholds; the file's spacing has another name here."""
    from stancekit.planners.problem.course_terrain import footholds_for

    try:
        options = settings_from(ImportOptions, meaning, beside=_BESIDE)
        return options, footholds_for(robot, terrain, options=options, **how)
    except InvalidInput as refused:
        raise InvalidInput(re.sub("^spacing_m:", "grid_m:", str(refused))) from None


def _asked(options: ImportOptions, limits: FootholdLimits) -> dict[str, Any]:
    """Options of the file and of footholds that are not the usual ones, as JSON has them."""
    unusual = {k: v for k, v in vars(options).items() if v != getattr(ImportOptions, k)}
    more = {} if limits == FootholdLimits() else {"limits": asdict(limits)}
    result: dict[str, Any] = json.loads(json.dumps(unusual | more, default=list))
    return result
