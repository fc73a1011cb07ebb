"""Data sets: postures, labelled exactly, and tries of leaps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from stancekit import Dataset, LeapTries, Robot
from stancekit.envs.data.ledger import USUAL_TRIES, LabelPlan, TryPlan
from stancekit.envs.distributions.postures import distribution_of
from stancekit.learners.data import labelling, leap_tries
from stancekit.learners.data.executors import Executor, executor as executor, processes
from stancekit.learners.data.labelling import Progress
from stancekit.planners.arguments import check_argument, check_names, checked
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.documents import shown
from stancekit.planners.problem.leap import is_leap_class as is_leap_class
from stancekit.planners.problem.posture_batch import Sampler

if TYPE_CHECKING:
    from stancekit.learners.surrogates.surrogate import Surrogate

_FURTHER: Mapping[str, Any] = {
    "natural": bool,
    "shard_size": int,
    "screen": Any,
    "screen_error": float | None,
    "scenes": int | None,
    "tries": Mapping[str, int] | None,
}
"""Arguments that ``label`` takes by name beside its parameters."""
_USUAL_ROWS = (500, 500)
"""How many feasible and infeasible ones there are where nothing is said."""
_SCREEN_ERROR = 0.04
"""Share of the rows that may be lost by a screen where nothing is said."""
_BESIDE = (
    "problems",
    "folder",
    "robot",
    "terrain",
    "rows",
    "seed",
    "workers",
    "progress",
    *_FURTHER,
)
"""All of them, for messages."""


@overload
def label(
    problems: str,
    folder: str | Path,
    *,
    scenes: int,
    seed: int = 0,
    workers: int | Executor = 1,
    progress: Callable[[int, int], None] | None = None,
    **further: Any,
) -> LeapTries: ...
@overload
def label(
    problems: str | Sampler,
    folder: str | Path,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
    rows: tuple[int, int] | int = _USUAL_ROWS,
    scenes: None = None,
    seed: int = 0,
    workers: int | Executor = 1,
    progress: Callable[[int, int], None] | None = None,
    **further: Any,
) -> Dataset: ...
@checked
def label(
    problems: str | Sampler,
    folder: str | Path,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
    rows: tuple[int, int] | int = _USUAL_ROWS,
    seed: int = 0,
    workers: int | Executor = 1,
    progress: Callable[[int, int], None] | None = None,
    **further: Any,
) -> Dataset | LeapTries:
    """Draw posture problems and label them exactly into a folder, or go on with one that was begun.

    Of a class of leaps, "leap-hard" or another, choices of contacts are tried and labelled in place
    of problems: each try is solved, with toes and forces; refuted, with multipliers that prove it;
    or unsolved, which claims nothing.

    Arguments:
        problems: a distribution or its name, as for ``sample``. One that has no ``name`` goes by
            its class's. Or the name of a class of leaps.
        folder: folder of the data set; rows that it has already are not made again.
        robot, terrain: robot and terrain, as for ``sample``. With a robot from a file, *infeasible*
            in a row refers to the inner sets of its legs.
        rows: numbers of feasible and of infeasible rows, the latter infeasible only because of
            their moment balance; or one number, for the first so many samples as they come,
            whatever their label. Not for leaps.
        seed: seed of the random stream; use another one for training than for testing.
        workers: processes, or an executor, for example of a Ray cluster; the rows do not depend on
            them.
        progress: function called with the number of rows written and the number in all.
        further: screen (a surrogate of ``fit(rows, "surrogate")`` or its file: a draw that it
            calls of a kind of which there are enough rows is passed over without being decided;
            needs torch) and screen_error (share of the other kind's rows that may be lost so;
            0.04), shard_size (rows per file, which is what an interruption can lose; 500), natural
            (True keeps the samples as they come with two numbers of rows, too, of which only the
            sum counts then). Of leaps: scenes (how many are drawn; has to be given), shard_size,
            and tries (how many choices per scene each order of ``LeapFinder`` makes; by default
            {"random": 8, "finder": 4, "noise": 4}, half of them spread over all choices, the others
            near good ones).

    Returns:
        The ``Dataset``: every feasible row with a posture, every infeasible one with a certificate.
        Of leaps, ``LeapTries``.

    Raises:
        InvalidInput: for a folder that holds another data set, numbers out of range, a screen of
            another class, and arguments that leaps or postures have no use for.
        StancekitError: where the distribution does not yield enough rows of a label.
    Source:
        Algorithm E1.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> len(train), train.labels[0] in ("feasible", "infeasible")
        (12, True)
    """
    check_names("label", further, _BESIDE)
    options = dict(further)
    for key, value in options.items():
        check_argument(key, value, _FURTHER[key])
    run = processes(int(workers)) if isinstance(workers, int | Integral) else workers
    if isinstance(problems, str) and is_leap_class(problems):
        asked_of = {"robot": robot, "terrain": terrain} | options
        _check_no_use(asked_of, but=("scenes", "shard_size", "tries"), of=f"leaps of {problems}")
        if rows is not _USUAL_ROWS:
            raise InvalidInput(f"rows: expected none with leaps of {problems}, got {shown(rows)}")
        return _leaps(problems, folder, options, seed=int(seed), run=run, progress=progress)
    source = None
    if not isinstance(problems, str) or isinstance(robot, Robot):
        source = distribution_of(problems, robot=robot, terrain=terrain)
        problems, robot, terrain = source.name, None, None
    plan, surrogate = _of_postures(
        options,
        distribution=str(problems),
        seed=int(seed),
        robot=None if robot is None else str(robot),
        terrain=None if terrain is None else str(terrain),
        **_rows(rows, options.pop("natural", False)),
    )

    def on_progress(state: Progress) -> None:
        if progress is not None:
            progress(state.rows, plan.rows)

    labelling.label(plan, folder, run=run, source=source, progress=on_progress, surrogate=surrogate)
    return Dataset.open(folder)


def _of_postures(options: dict[str, Any], **asked: Any) -> tuple[LabelPlan, Surrogate | None]:
    """The plan of a data set of postures, and the surrogate that screens its draws, if any."""
    of_leaps = {name: options.pop(name, None) for name in ("scenes", "tries")}
    _check_no_use(of_leaps, of="postures")
    surrogate, error = _screen(options.pop("screen", None), options.pop("screen_error", None))
    digest = None if surrogate is None else surrogate.digest
    return LabelPlan(screen=digest, screen_error=error, **asked, **options), surrogate


def _screen(given: Any, error: float | None) -> tuple[Surrogate | None, float | None]:
    """The surrogate that screens draws, and its error.

    Raises InvalidInput.
    """
    if given is None:
        if error is not None:
            raise InvalidInput("screen_error: expected a screen with it, got none")
        return None, None
    try:
        from stancekit.learners.surrogates.surrogate import surrogate_of
    except ImportError as missing:
        raise not_installed("screen", missing.name, "networks", "rl") from None

    error = _SCREEN_ERROR if error is None else error
    if not 0.0 < error < 1.0:
        raise InvalidInput(f"screen_error: expected a number above 0 and below 1, got {error:g}")
    return surrogate_of(given), float(error)


def _leaps(
    name: str,
    folder: str | Path,
    given: Mapping[str, Any],
    *,
    seed: int,
    run: Executor,
    progress: Callable[[int, int], None] | None,
) -> LeapTries:
    """Label tries of a class of leaps.

    Raises InvalidInput.
    """
    settings = {key: value for key, value in given.items() if value is not None}
    if "scenes" not in settings:
        raise InvalidInput(f"scenes: expected how many leaps of {name}, got none")
    scenes, tries = int(settings.pop("scenes")), dict(settings.pop("tries", USUAL_TRIES))
    plan = TryPlan(distribution=name, scenes=scenes, tries=tries, seed=seed, **settings)

    def on_progress(state: Progress) -> None:
        if progress is not None:
            progress(state.rows, plan.rows)

    leap_tries.label_leaps(plan, folder, run=run, progress=on_progress)
    return LeapTries.open(folder)


def _check_no_use(given: Mapping[str, Any], of: str, but: tuple[str, ...] = ()) -> None:
    """Raise InvalidInput for what is given and of no use."""
    for name, value in given.items():
        if name not in but and value is not None and value is not False:
            raise InvalidInput(f"{name}: expected none with {of}, got {shown(value)}")


def _rows(rows: tuple[int, int] | int, natural: bool) -> dict[str, Any]:
    """The rows as a ``LabelPlan`` has them.

    Raises InvalidInput.
    """
    if not isinstance(rows, tuple):
        return {"feasible": int(rows), "infeasible": 0, "natural": True}
    if len(rows) != 2 or any(
        isinstance(count, bool) or not isinstance(count, Integral) for count in rows
    ):
        raise InvalidInput(
            f"rows: expected one integer, or two (feasible, infeasible), got {shown(rows)}"
        )
    return {"feasible": int(rows[0]), "infeasible": int(rows[1]), "natural": natural}
