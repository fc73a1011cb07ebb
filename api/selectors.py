"""Selectors of envelopes: label terrains, learn from them, compare what was learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, overload

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.data.scenes import scenes_of
from stancekit.envs.distributions.postures import distribution_of
from stancekit.learners.data.export import Exported
from stancekit.learners.data.export import export as exported
from stancekit.learners.data.labelling import label as labelled
from stancekit.learners.data.origin import check_unseen
from stancekit.learners.evaluation.evaluate import Score, check_same_class
from stancekit.learners.evaluation.evaluate import evaluate as rolled_out
from stancekit.learners.selectors.selector import Learned
from stancekit.learners.selectors.selector_file import load_selector
from stancekit.learners.training.fit_settings import FitSettings
from stancekit.learners.training.fitting import learn
from stancekit.planners.arguments import check_argument, checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.validation import shown, typed
from stancekit.planners.problem.posture import Sampler
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.robot.model import Robot

from .upgrading import old_arguments

OLD = {
    "feasible": "label(..., rows=(FEASIBLE, INFEASIBLE))",
    "infeasible": "label(..., rows=(FEASIBLE, INFEASIBLE))",
    "natural": "label(..., rows=COUNT)",
}
USUAL_ROWS = (500, 500)
"""How many feasible and infeasible ones there are where nothing is said."""
BESIDE = ("problems", "folder", "robot", "terrain", "rows", "seed", "workers", "proposers")


@checked
def label(
    problems: str | Sampler,
    folder: str | Path,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
    rows: tuple[int, int] | int = USUAL_ROWS,
    seed: int = 0,
    workers: int = 1,
    proposers: str | Path | None = None,
    **old: Any,
) -> Dataset:
    """Draw posture problems and label them exactly into a folder, or go on with one that was begun.

    Arguments:
        problems: a distribution or its name, as for ``sample``. One that has no ``name`` goes by its class's.
        folder: of the data set; what is there already is not made again.
        robot, terrain: as for ``sample``. Rows of a robot's file say *infeasible* of the inner sets of its legs.
        rows: how many feasible ones, and how many infeasible ones, which need their moment balance to be so; or one
            number: the first so many samples as they come, whatever their label.
        seed: of the random stream; use another one for training than for testing.
        workers: processes; the rows do not depend on them.
        proposers: file of ``stancekit proposers``, asked for postures and proofs before any solver; needs torch.
        old: ``rows`` as feasible, infeasible and natural, which is the old form.
    Returns:
        The ``Dataset``: every feasible row with a posture, every infeasible one with a certificate.
    Raises:
        InvalidInput: for a folder that holds another data set, numbers out of range, proposers of another class.
        LabellingFailed: where the distribution does not yield enough rows of a label.
    Source:
        Algorithm E1.
    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> len(train), train.labels[0] in ("feasible", "infeasible")
        (12, True)
    """
    wanted = _rows(rows, old_arguments("label", old, OLD, BESIDE) if old else {})
    name, source, asked = problems, None, None
    if not isinstance(problems, str) or isinstance(robot, Robot):
        source = distribution_of(problems, robot=robot, terrain=terrain)
        name = source.name
    if proposers is not None:
        from stancekit.learners.proposers.proposer import Proposers  # loads torch

        asked = Proposers.load(proposers)
    plan = LabelPlan(
        distribution=str(name), **wanted, seed=int(seed),
        robot=None if robot is None or source is not None else str(robot),
        terrain=None if terrain is None or source is not None else str(terrain),
        proposers=None if asked is None else asked.digest,
    )  # fmt: skip
    labelled(plan, folder, workers=workers, source=source, proposers=asked)
    return Dataset.open(folder)


Rows = Dataset | str | Path


@checked
def export(
    dataset: Rows,
    folder: str | Path,
    *,
    room: float = 0.02,
    progress: Callable[[int, int], None] | None = None,
) -> Exported:
    """Write labelled rows as a Minari data set: one-step episodes of EnvelopeSelection-v0, acted by the expert.

    Arguments:
        dataset: what ``label`` returned, or its folder.
        folder: a new folder, or an empty one; nothing is written anywhere else.
        room: how far every side of the expert's box is moved out, non-dimensional.
        progress: called with episodes written, and all.
    Returns:
        An ``Exported``: where it is, how many episodes, and what the expert's boxes come to.
    Raises:
        InvalidInput: for a folder that holds something, rows that are missing, and without Minari (extra datasets).
    Source:
        None: Minari's format.
    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.export(train, "minari").episodes
        12
    """
    return exported(_opened(dataset), Path(folder), room=room, progress=progress)


@overload
def fit(  # type: ignore[overload-overlap]
    dataset: Rows | Sequence[Rows], method: Literal["modes"], **settings: object
) -> Modes: ...
@overload
def fit(dataset: Rows | Sequence[Rows], method: str = "gmm", **settings: object) -> Learned: ...
@checked
def fit(dataset: Rows | Sequence[Rows], method: str = "gmm", **settings: object) -> Learned | Modes:
    """Learn a selector of envelopes from a labelled data set.

    Arguments:
        dataset: what ``label`` returned, or its folder; for "modes" several, one a terrain.
        method: "heuristic" (the expert's bounds), "quantile", "gmm-printed" (Algorithm E2 line by line), "gmm" (its
            boundary is fitted by P1's margins), "ga", "gradient", "modes" (for mode switching); "chooser", "neural",
            "joint" (for P1 joined with the lift) and "rl" need torch. Or one that a package registered under
            ``stancekit.methods``, or "FILE.py:NAME".
        settings: of ``learners.training.fit_settings.FitSettings``: share, clusters, threshold, boxes, steps, batch,
            seed, ... Those that do not concern the method are refused.
    Returns:
        A ``Learned``: its ``selector`` predicts; its ``envelopes`` go into ``solve`` and ``plan``; ``save`` writes it.
        ``Modes`` for "modes": for ``plan``.
    Raises:
        InvalidInput: for an unknown method or setting, and rows that the method lacks.
    Source:
        Paper E §III-B, Algorithm E2; §IV-A.
    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.fit(train, "quantile", share=0.1).envelopes.legs
        ('RF', 'RR', 'LM')
    """
    several = [dataset] if isinstance(dataset, Dataset | str | Path) else dataset
    asked = typed(FitSettings, settings, "")
    asked.check_used(method)
    return learn(method, [_opened(rows) for rows in several], asked)


@checked
def evaluate(
    selector: Learned | EnvelopeSet | str | Path,
    dataset: Rows,
    *,
    projections: Sequence[Projection] = ("fix-p", "scp"),
    name: str = "selector",
) -> Score:
    """How often P1 answers right over the envelopes that a selector chooses, and how often P2 gets back.

    Arguments:
        selector: what ``fit`` returned, envelopes, a file of either, or "FILE.py:NAME".
        dataset: labelled rows that it was not learned from, or their folder; a ``Dataset`` has parts for that, see
            ``Dataset.only``.
        projections: stages P2 to try: "fix-p", "fix-f", "fix-toes", "scp", "nlp", "lift-fix-p".
        name: of the row.
    Returns:
        A ``Score``: shares with Wilson 95 % intervals of the feasible and infeasible problems that P1 answers right,
        and of the feasible ones from which each projection reaches a verified posture.
    Raises:
        InvalidInput: for a selector of another class of problems, a data set without rows that are not trivial, and
            rows that the selector was trained or calibrated on.
    Source:
        Paper E Table I.
    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> score = stancekit.evaluate(stancekit.fit(train, "quantile"), test)
        >>> score.p1_feasible.of, score.p1_infeasible.of
        (6, 6)
    """
    rows, learned = _opened(dataset), selector
    if isinstance(learned, EnvelopeSet):
        learned = Learned.fixed(name, learned)
    elif not isinstance(learned, Learned):
        learned = load_selector(learned)
    check_same_class(rows, learned.problem_class, name)
    check_unseen(rows, learned.provenance, name)
    scenes = scenes_of(rows)
    if not scenes:
        raise InvalidInput(f"{rows}: expected feasible or not trivially infeasible rows, got none")
    return rolled_out(
        name, learned, scenes, problem_class=rows.problem_class, projections=tuple(projections)
    )


def _rows(rows: tuple[int, int] | int, old: dict[str, Any]) -> dict[str, Any]:
    """The rows as a ``LabelPlan`` has them. Raises InvalidInput."""
    for name, value in old.items():
        check_argument(name, value, bool if name == "natural" else int)
    if old:
        if rows != USUAL_ROWS:
            raise InvalidInput(f"{next(iter(old))}: expected none beside rows, got both")
        return {"feasible": 500, "infeasible": 500, **old}
    if not isinstance(rows, tuple):
        return {"feasible": int(rows), "infeasible": 0, "natural": True}
    if len(rows) != 2 or any(isinstance(count, bool) or not isinstance(count, Integral) for count in rows):
        raise InvalidInput(f"rows: expected one integer, or two (feasible, infeasible), got {shown(rows)}")
    return {"feasible": int(rows[0]), "infeasible": int(rows[1])}


def _opened(rows: Rows) -> Dataset:
    return rows if isinstance(rows, Dataset) else Dataset.open(rows)
