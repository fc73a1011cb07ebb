"""Selectors of envelopes: learn them from labelled rows, compare what was learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from stancekit import EnvelopeSet, HeightField, Modes, Screened
from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.leap_tries import LeapTries, open_rows
from stancekit.learners.data.executors import Executor, executor as executor, processes
from stancekit.learners.data.labelling import check_unseen, rows_of as rows_of
from stancekit.learners.evaluation.evaluate import (
    Comparison as Comparison,
    Score,
    check_same_class,
    evaluate as rolled_out,
    evaluate_lift,
)
from stancekit.learners.leaps.kinds import KINDS
from stancekit.learners.selectors.selector import Learned, load_selector
from stancekit.learners.training.fitting import (
    FURTHER as FURTHER,
    KNOBS,
    FitSettings,
    learn,
    missing,
)
from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput, located, not_installed
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.documents import read_yaml, typed
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.projection.project import PROJECTIONS, Projection
from stancekit.planners.terrain.reference import named_terrain
from stancekit.planners.warp.conformal import CELLS, HEIGHT_M, MapFit, Method, fit_map

if TYPE_CHECKING:
    from stancekit.learners.leaps.policy import LeapScorer
    from stancekit.learners.surrogates.surrogate import Surrogate


_MOST_ITERATIONS = 10_000


@checked
def warp(
    terrain: HeightField | str | Path,
    *,
    cells: tuple[int, int, int] = CELLS,
    height_m: float = HEIGHT_M,
    method: Method = "fast",
    iterations: int = 100,
) -> MapFit:
    """Make the map that flattens a terrain, and measure it.

    Arguments:
        terrain: a ``HeightField``, a name, a file of heights, or "FILE.py:NAME", as for
            ``heights``.
        cells: numbers of cells of the tri-cubic grid along each axis; more let the map bend more
            sharply, and cost time in proportion.
        height_m: thickness of the band above the terrain [m], about five times the robot's rest
            height.
        method: "fast", exact at the ground; "local-global" (Algorithm 1 of Pan et al.) and
            "gauss-newton" as published, without a snap.
        iterations: largest number of iterations of the method.

    Returns:
        A ``MapFit``: the ``map``, and its ``report``, whose ``least_det`` above 0 says that the map
        folds nowhere.

    Raises:
        InvalidInput: for a bad grid, and a terrain that cannot be read.
        PlanningFailed: where every map folds, or the terrain is finer than the map's snap can hold.
    Source:
        Pan et al. §IV-A and §IV-B, W6.

    Example:
        >>> import stancekit
        >>> stancekit.warp("hill", cells=(8, 8, 3)).report.least_det > 0.0
        True
    """
    checked_int(iterations, "iterations", least=1, most=_MOST_ITERATIONS)
    if any(isinstance(count, bool) or not isinstance(count, int) for count in cells):
        raise InvalidInput(f"cells: expected three whole numbers in [2, 200], got {cells}")
    field = terrain if isinstance(terrain, HeightField) else named_terrain(str(terrain))
    return fit_map(field, cells=cells, height_m=height_m, method=method, iterations=iterations)


@checked
def screen(
    problems: Problem | Sequence[Problem] | PostureBatch,
    surrogate: Any = None,
    *,
    error: float = 0.005,
) -> Screened:
    """Say of posture problems what a surrogate is sure of, feasible or infeasible, and "ask" of the
    rest.

    Arguments:
        problems: problems of the class that the surrogate learned from, which differ in their
            patches alone; or one of them. A ``PostureBatch`` of arrays takes no time to make.
        surrogate: the surrogate that ``fit(rows, "surrogate")`` returned, its file, or the name of
            one that ships; the one that ships for problems like these where None.
        error: largest share of truly feasible problems of the class that are called infeasible, and
            of truly infeasible ones that are called feasible; of trivially infeasible ones only if
            the calibration had such rows. The smaller, the more problems are left to an exact
            planner. Typically 0.001 to 0.05.

    Returns:
        A ``Screened``: ``answers``, "feasible", "infeasible" or "ask" per problem, ``margins``, and
        the share that is ``decided``. Nothing of it is proved: it holds of problems as they were
        drawn for the calibration, at the ``confidence`` that it names. A problem that lies beyond
        those is "ask", and so are all of a batch of 64 or more that is not drawn as they were, with
        the reason in ``shifted``; a smaller batch cannot tell.

    Raises:
        InvalidInput: for problems of another class or robot, or without a surrogate for problems
            for which none ships, an error of 0 or 1, and a file that is no surrogate.
    Source:
        Wilks (1941), one-sided tolerance intervals.

    Example:
        >>> import stancekit
        >>> rows = stancekit.label("wall-3", "train", rows=(60, 60))
        >>> surrogate = stancekit.fit(rows, "surrogate", epochs=4)
        >>> screened = stancekit.screen(stancekit.sample("wall-3", 5), surrogate, error=0.2)
        >>> len(screened.answers), set(screened.answers) <= {"feasible", "infeasible", "ask"}
        (5, True)
        >>> stancekit.screen(stancekit.sample("wall-3", 100)).decided > 0.5
        True
    """
    try:
        from stancekit.learners.surrogates.surrogate import as_batch, surrogate_for, surrogate_of
    except ImportError as error_:
        raise not_installed("surrogate", error_.name, "networks", "rl") from None
    batch = as_batch([problems] if isinstance(problems, Problem) else problems)
    chosen = surrogate_for(batch.like) if surrogate is None else surrogate_of(surrogate)
    return chosen.screen(batch, error)


Rows = Dataset | str | Path
Progress = Callable[[int, int], None]
_SURROGATE = "surrogate"
"""The method that learns feasibility itself."""
LIFT = "lift"
"""What is compared with selectors and chooses nothing."""


@overload
def fit(dataset: Rows | Sequence[Rows], method: Literal["modes"], **how: Any) -> Modes: ...
@overload
def fit(
    dataset: LeapTries | str | Path, method: Literal["additive", "set"], **how: Any
) -> LeapScorer: ...
@overload
def fit(dataset: Rows | Sequence[Rows], method: Literal["surrogate"], **how: Any) -> Surrogate: ...
@overload
def fit(dataset: Rows | Sequence[Rows], method: str = "gmm", **how: Any) -> Learned: ...
@checked
def fit(
    dataset: Rows | LeapTries | Sequence[Rows],
    method: str = "gmm",
    *,
    calibration: Rows | None = None,
    checkpoint: str | Path | None = None,
    workers: int | Executor = 1,
    progress: Progress | None = None,
    **settings: object,
) -> Any:
    """Learn a selector of envelopes from a labelled data set, or scores of candidates from labelled
    tries of leaps.

    Arguments:
        dataset: the data set that ``label`` returned, or its folder; for "modes" several, one per
            terrain.
        method: "heuristic" (the expert's bounds), "quantile", "gmm-printed" (Algorithm E2 line by
            line), "gmm" (its boundary is fitted by P1's margins), "ga", "gradient", "modes" (for
            mode switching); "neural" and "joint" (for P1 joined with the lift) need torch. Or one
            that a package registered under ``stancekit.methods``, or "FILE.py:NAME". "surrogate"
            learns feasibility itself, for ``screen``, of one data set or of several of one class;
            it needs torch. Of tries of leaps: "additive", a logistic sum over the toes, and "set",
            a network that sees all candidates; both need torch.
        calibration: rows to calibrate "neural" and "joint" on; None for a part of the data set. For
            "surrogate" further rows, in addition to that part.
        checkpoint: file by which a method that takes long goes on where it was stopped: all but
            "heuristic", "quantile", "modes" and both of mixtures.
        workers: processes of "ga", or an executor; the result does not depend on them.
        progress: function called with the number of steps done and the number in all.
        settings: fields of ``learners.training.fitting.FitSettings``: share, clusters,
            threshold, boxes, steps, batch, seed, ... Those that the method does not use are
            refused. For tries of leaps, fields of ``learners.leaps.policy.ScorerSettings``; for
            "surrogate", of ``learners.surrogates.surrogate.SurrogateSettings``.

    Returns:
        A ``Learned``: its ``selector`` predicts; its ``envelopes`` go into ``solve`` and ``plan``;
        ``save`` writes it. ``Modes`` for "modes": for ``plan``. A ``LeapScorer`` for tries of
        leaps: for ``LeapFinder(rule=...)``. A ``Surrogate`` for "surrogate": for ``screen``,
        ``label`` and ``map``.

    Raises:
        InvalidInput: for an unknown method or setting, and rows that the method lacks.
    Source:
        Lin et al. §III-B, Algorithm E2; §IV-A.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.fit(train, "quantile", share=0.1).envelopes.legs
        ('RF', 'RR', 'LM')
    """
    kept = None if checkpoint is None else Path(checkpoint)
    given = {
        "calibration": calibration is not None,
        "checkpoint": kept is not None,
        "workers": workers != 1,
    }
    for name, users in FURTHER.items():
        if given[name] and method in KNOBS and method not in users:
            raise InvalidInput(f"{name}: expected none but with {', '.join(users)}, got {method}")
    if method in KINDS:
        return _scorer(dataset, method, settings, progress, kept)
    if isinstance(dataset, LeapTries):
        raise InvalidInput(
            f"method: expected {' or '.join(KINDS)} with tries of leaps, got {method}"
        )
    several = [dataset] if isinstance(dataset, Dataset | str | Path) else dataset
    if method == _SURROGATE:
        return _surrogate(several, calibration, settings, progress, kept)
    rows, typed_settings = [rows_of(each) for each in several], typed(FitSettings, settings, "")
    typed_settings.check_used(method)
    return learn(
        method,
        rows,
        typed_settings,
        progress,
        calibration=None if calibration is None else rows_of(calibration),
        checkpoint=kept,
        run=_executor(workers),
    )


def _scorer(
    dataset: Any,
    method: Any,
    settings: Mapping[str, Any],
    progress: Progress | None,
    kept: Path | None,
) -> LeapScorer:
    """Scores of leaps' candidates from labelled tries."""
    rows = open_rows(dataset) if isinstance(dataset, str | Path) else dataset
    if not isinstance(rows, LeapTries):
        raise InvalidInput(
            f"data set: expected labelled tries of leaps with the method {method}, got {rows!r:.80}"
        )
    try:
        from stancekit.learners.leaps.policy import (
            ScorerSettings,
            fit_scorer,
        )  # torch takes a while to load
    except ImportError as error:
        raise missing(method, error) from None
    return fit_scorer(rows, method, typed(ScorerSettings, settings, ""), progress, kept)


def _surrogate(
    several: Sequence[Rows],
    calibration: Rows | None,
    settings: Mapping[str, Any],
    progress: Progress | None,
    kept: Path | None,
) -> Surrogate:
    """A surrogate of feasibility from labelled rows."""
    try:
        from stancekit.learners.surrogates.surrogate import SurrogateSettings, fit_surrogate
    except ImportError as error:
        raise missing(_SURROGATE, error) from None
    return fit_surrogate(
        [rows_of(each) for each in several],
        typed(SurrogateSettings, settings, ""),
        progress,
        calibration=None if calibration is None else rows_of(calibration),
        checkpoint=kept,
    )


def settings_of(
    method: str, given: Mapping[str, Any], config: Path | None = None
) -> dict[str, Any]:
    """The settings of ``fit`` that concern a method: those given, and those that a YAML file adds
    for several methods.

    Raises InvalidInput for a setting that is wrong, that the method has no use for, or that the
    file should leave to the others; what is wrong with the file begins with its name.
    """
    extra = {} if config is None else read_yaml(config)
    for name in extra:
        if name in given:
            raise InvalidInput(
                f"{config}: {name}: expected as an option, --{name.replace('_', '-')}"
            )
    FitSettings(**given).check_used(method)  # what is wrong with these is not the file's fault
    if method in (_SURROGATE, *KINDS):
        return {"seed": given["seed"], **extra}
    with located(str(config or "--config")):
        settings = typed(FitSettings, {**given, **extra}, "")
        settings.check(method)
    return settings.concerning(method)


Selector = Learned | EnvelopeSet | str | Path


@overload
def evaluate(
    selector: Mapping[str, Selector],
    dataset: Rows,
    *,
    projections: Sequence[Projection] = ...,
    name: str = ...,
    workers: int | Executor = ...,
    progress: Progress | None = ...,
) -> Comparison: ...
@overload
def evaluate(
    selector: Selector,
    dataset: Rows,
    *,
    projections: Sequence[Projection] = ...,
    name: str = ...,
    workers: int | Executor = ...,
    progress: Progress | None = ...,
) -> Score: ...
@checked
def evaluate(
    selector: Selector | Mapping[str, Selector],
    dataset: Rows,
    *,
    projections: Sequence[Projection] = ("fix-p", "scp"),
    name: str = "selector",
    workers: int | Executor = 1,
    progress: Progress | None = None,
) -> Score | Comparison:
    """Measure how often P1 answers right over the envelopes that a selector chooses, and how often
    P2 gets back.

    Arguments:
        selector: the selector that ``fit`` returned, envelopes, a file of either, the name of one
            that ships, or "FILE.py:NAME"; or "lift", which needs no envelopes. Several by name to
            compare them.
        dataset: labelled rows that it was not learned from, or their folder; a ``Dataset`` has
            parts for that, see ``Dataset.only``.
        projections: stages P2 to try: "fix-p", "fix-f", "fix-toes", "scp", "nlp", "lift-fix-p".
        name: name of the row.
        workers: processes, or an executor, for example of a Ray cluster.
        progress: function called with the number of problems played and the number in all.

    Returns:
        A ``Score``: shares with Wilson 95 % intervals of the feasible and infeasible problems that
        P1 answers right, and of the feasible ones from which each projection reaches a verified
        posture. Of several selectors a ``Comparison``, with a ``Score`` of each.

    Raises:
        InvalidInput: for a selector of another class of problems, a data set without rows that are
            not trivial, and rows that the selector was trained or calibrated on.
    Source:
        Lin et al. Table I.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> score = stancekit.evaluate(stancekit.fit(train, "quantile"), test)
        >>> score.p1_feasible.of, score.p1_infeasible.of
        (6, 6)
    """
    rows = rows_of(dataset)
    if isinstance(selector, Mapping):
        if not selector:
            raise InvalidInput("selector: expected one or more selectors by name, got none")
        compared = {
            each: one if one == LIFT else selector_for(rows, one, each)
            for each, one in selector.items()
        }  # what is wrong with one of them is said before any is played
        how: Any = {"projections": projections, "workers": workers, "progress": progress}
        scores = tuple(evaluate(one, rows, name=each, **how) for each, one in compared.items())
        return Comparison(problem_class=rows.problem_class, scores=scores)
    learned = None if selector == LIFT else selector_for(rows, selector, name)
    ways = tuple(dict.fromkeys(projections))
    for way in ways:
        PROJECTIONS.get(way)
    if not (scenes := scenes_of(rows)):
        raise InvalidInput(
            f"{rows.ledger.folder}: expected feasible or not trivially infeasible rows, got none"
        )
    run = _executor(workers)
    if learned is None:
        return evaluate_lift(scenes, projections=ways, progress=progress, run=run)
    return rolled_out(
        name,
        learned,
        scenes,
        problem_class=rows.problem_class,
        projections=ways,
        progress=progress,
        run=run,
    )


def selector_for(dataset: Rows, selector: Selector, name: str) -> Learned:
    """A selector to evaluate on these rows; arguments as for ``evaluate``.

    Raises InvalidInput for one of another class of problems, and for one that was trained or
    calibrated on the rows.
    """
    rows = rows_of(dataset)
    if isinstance(selector, EnvelopeSet):
        selector = Learned.fixed(name, selector)
    elif isinstance(selector, str | Path):
        selector = load_selector(selector)
    elif not isinstance(selector, Learned):
        raise InvalidInput(
            f"{name}: expected what fit returned, envelopes, or a file of either, got {selector!r:.80}"
        )
    check_same_class(rows, selector.problem_class, name)
    check_unseen(rows, selector.provenance, name)
    return selector


def _executor(workers: int | Executor) -> Executor:
    return processes(int(workers)) if isinstance(workers, int | Integral) else workers
