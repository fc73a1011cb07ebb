"""Walks: gaits over curved ground."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from stancekit import Answer, HeightField, Robot, Status
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import check_argument, check_names, checked
from stancekit.planners.errors import InvalidInput, NoPlace, PlanningFailed, interruptible
from stancekit.planners.files.arrays import Array, checked as checked_number, checked_int
from stancekit.planners.gait.method.attempt import Attempt, Progress, Smoothing
from stancekit.planners.gait.method.portfolio import Attempts, Caps, default_attempts
from stancekit.planners.gait.method.way import plan_walk
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk as Walk
from stancekit.planners.terrain.families import Terrain

_OF_WALK = (
    "start_yaw_rad",
    "end_yaw_rad",
    "friction",
    "adhesive",
    "suction_n",
    "cycle_s",
    "timings",
)
_OF_SEARCH = (
    "total_iterations",
    "max_iterations",
    "dynamics",
    "hessian",
    "footing",
    "raw",
    "seeds",
    "seed",
)
"""Fields of a ``Walk``; limits and settings of the solves: what ``walk`` takes by their names."""
_LIMITS = {True: 80, False: 200}
"""Iterations of one solve in a portfolio, and in one chart."""
_MOST_SEEDS = 1000


@checked
def walk(
    terrain: Walk | Terrain | HeightField | str | Path,
    goal: Array | Sequence[float] | None = None,
    *,
    start: Array | Sequence[float] = (0.0, 0.0),
    robot: Robot | str | Path = "anymal",
    gait: Literal["trot", "walk", "pace", "bound", "gallop", "tripod"] | None = None,
    duration_s: float = 10.0,
    chart: str = "portfolio",
    time_limit_s: float = 240.0,
    **task: Any,
) -> Answer[Trajectory]:
    """Find a walk over a terrain: the motion of the torso, footholds and contact forces.

    Arguments:
        terrain: a ``HeightField``, a ``Terrain``, a name ("ripple", "cone", "hill", "pit", ...), a
            family's ground as "rough:0.5:7" (family, level, seed), a file of heights, or a function
            of x and y as "FILE.py:NAME". Or a whole ``Walk``, beside which only chart, limits and
            settings of the solves may be given.
        goal, start: places where the torso ends and starts, shape (2,) [m].
        robot: "anymal", "hexapod", another name, a .urdf file, a .yaml file that names one or has a
            walker's numbers, a ``Robot`` with legs of its own, or what ``load`` gives of such a
            file.
        gait: order of the steps; tripod is for six feet, the others are for four; trot or tripod
            where None.
        duration_s: time to walk [s].
        chart: coordinates to solve in ("decoupled", "warped-exact", "ambient", ..., or
            "FILE.py:NAME"); "portfolio" tries one after another until the verifier accepts.
        time_limit_s: processor time of solves and of verdicts between them; the best walk until
            then is the answer [s].
        task: further fields of ``Walk``: start_yaw_rad, end_yaw_rad (headings at start and end,
            from x towards y; it turns the shorter way [rad]), friction (Coulomb's ν of the ground,
            0.75), adhesive (names of feet that stick: they may pull), suction_n (largest pull, by
            default twice the weight [N]), cycle_s (duration of the gait's cycle, by default its own
            [s]), timings. Beside them total_iterations, a limit of the solvers' iterations: with a
            ``time_limit_s`` that is never met, 1e6, the walk is the same on a busy computer;
            max_iterations of one solve (80 in a portfolio, 200 in one chart), dynamics ("centred",
            "printed" as in the paper, "newton-euler"), hessian ("exact", "lbfgs"), footing (the
            steepest ground within 15 mm of where a foot stands, as a share of the slope on which
            friction holds; 0 for no limit; by default 0.6 where the way has such places), raw (True
            takes the first feasible point as it is), seeds (how many initial guesses of each chart
            to try, the smoothest accepted walk is kept) and seed (of the perturbed ones).

    Returns:
        An ``Answer``: feasible with the walk that the verifier accepted, its ``solution``; else
        undecided, with the best walk that there is so far, if any. ``problem`` is the ``Walk``,
        ``message`` says the result in one line.

    Raises:
        TypeError: for a terrain without a goal.
        InvalidInput: for a place off the terrain, ground that the robot cannot stand on there, feet
            that the robot lacks, a walk longer than its time.
    Source:
        Pan et al. §III (W1-W7), §IV (charts), §V.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> answer = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
        >>> answer.status.value, answer.solution.feet_m.shape[1:]
        ('feasible', (4, 3))
    """
    beside: tuple[str, ...] = (
        "terrain",
        "goal",
        "start",
        "robot",
        "gait",
        "duration_s",
        "chart",
    )
    beside += ("time_limit_s", *_OF_WALK, *_OF_SEARCH)
    check_names("walk", task, beside)
    fields = {name: value for name, value in task.items() if name in _OF_WALK}
    options = {name: value for name, value in task.items() if name in _OF_SEARCH}
    if isinstance(terrain, Walk):
        unsaid = {"goal": goal is None, "start": tuple(start) == (0.0, 0.0)}
        unsaid |= {"robot": robot == "anymal", "gait": gait is None, "duration_s": duration_s == 10}
        for name in (*(name for name, usual in unsaid.items() if not usual), *fields):
            raise InvalidInput(f"{name}: expected none with a Walk, which has its own")
        asked = terrain
    elif goal is None:
        missing = "stancekit.walk: missing a required argument: 'goal'; it takes "
        raise TypeError(missing + ", ".join(beside))
    else:
        fields |= {"start": start, "robot": robot, "gait": gait}
        asked = Walk.over(terrain, goal, duration_s=duration_s, **fields)
    search = search_of(asked, chart=chart, time_limit_s=time_limit_s, **options)
    try:
        return walked(asked, *search).answer
    except (NoPlace, PlanningFailed) as error:  # a goal in a solid, or no way
        return Answer(status=Status.UNDECIDED, method=chart, problem=asked, message=str(error))


def search_of(
    asked: Walk,
    *,
    chart: str,
    time_limit_s: float,
    total_iterations: int | None = None,
    raw: bool = False,
    seeds: int = 1,
    seed: int = 0,
    **settings: Any,
) -> tuple[GaitSettings, Caps, list[Attempt]]:
    """Settings of ``plan_gait`` from the arguments of ``walk``.

    Raises InvalidInput.

    Arguments:
        settings: fields of ``GaitSettings``, but for those that are None.
    """
    checked_number(time_limit_s, "time_limit_s", above=0.0)
    checked_int(seeds, "seeds", least=1, most=_MOST_SEEDS)
    checked_int(seed, "seed", least=0)
    check_argument("raw", raw, bool)
    several = chart == "portfolio"
    values = {name: value for name, value in settings.items() if value is not None}
    solves = GaitSettings(**{"max_iterations": _LIMITS[several], **values})
    caps = Caps(
        iterations=solves.max_iterations, total_s=time_limit_s, total_iterations=total_iterations
    )
    if total_iterations is not None:
        caps = replace(caps, solve_s=time_limit_s)
    if raw:
        caps = replace(caps, smoothing=Smoothing(rounds=0), densifications=0)
    each = default_attempts(asked) if several else [Attempt(chart=chart)]
    attempts = [one.perturbed(seed + k) if k else one for one in each for k in range(seeds)]
    return solves, caps, attempts


def walked(
    asked: Walk,
    settings: GaitSettings,
    caps: Caps,
    attempts: Sequence[Attempt],
    *,
    progress: Progress | None = None,
    signals: tuple[signal.Signals, ...] = (signal.SIGINT,),
) -> Attempts:
    """The requested walk.

    Raises KeyboardInterrupt at the next iteration after one of the signals.
    """
    with interruptible(*signals) as interrupted:

        def watched(*at: Any) -> bool:
            return bool(progress and progress(*at)) or interrupted()

        result = plan_walk(
            asked,
            settings=settings,
            progress=watched,
            caps=caps,
            attempts=attempts,
        )
    if result.stopped:
        raise KeyboardInterrupt
    return result
