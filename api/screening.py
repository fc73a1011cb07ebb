"""Feasible, infeasible or "ask": learned answers at a stated error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stancekit.learners.surrogates.screened import Screened
from stancekit.planners.arguments import checked
from stancekit.planners.errors import not_installed
from stancekit.planners.problem import PostureBatch, Problem


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
        from stancekit.learners.surrogates.shipped import surrogate_for, surrogate_of
        from stancekit.learners.surrogates.surrogate import as_batch
    except ImportError as error_:
        raise not_installed("surrogate", error_.name, "networks", "rl") from None
    batch = as_batch([problems] if isinstance(problems, Problem) else problems)
    chosen = surrogate_for(batch.like) if surrogate is None else surrogate_of(surrogate)
    return chosen.screen(batch, error)
