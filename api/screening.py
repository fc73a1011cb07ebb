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
    surrogate: Any,
    *,
    error: float = 0.005,
) -> Screened:
    """Say of posture problems what a surrogate is sure of, feasible or infeasible, and "ask" of the
    rest.

    Arguments:
        problems: problems of the class that the surrogate learned from, which differ in their
            patches alone; or one of them. A ``PostureBatch`` of arrays takes no time to make.
        surrogate: the surrogate that ``fit(rows, "surrogate")`` returned, or its file.
        error: largest share of truly feasible problems of the class that are called infeasible, and
            of truly infeasible ones that are called feasible; of trivially infeasible ones only if
            the calibration had such rows. The smaller, the more problems are left to an exact
            planner. Typically 0.001 to 0.05.

    Returns:
        A ``Screened``: ``answers``, "feasible", "infeasible" or "ask" per problem, ``margins``, and
        the share that is ``decided``. Nothing of it is proved: it holds of problems as they were
        drawn for the calibration, at the ``confidence`` that it names.

    Raises:
        InvalidInput: for problems of another class or robot, an error of 0 or 1, and a file that is
            no surrogate.
    Source:
        Wilks (1941), one-sided tolerance intervals.

    Example:
        >>> import stancekit
        >>> rows = stancekit.label("wall-3", "train", rows=(60, 60))
        >>> surrogate = stancekit.fit(rows, "surrogate", epochs=4)
        >>> screened = stancekit.screen(stancekit.sample("wall-3", 5), surrogate, error=0.2)
        >>> len(screened.answers), set(screened.answers) <= {"feasible", "infeasible", "ask"}
        (5, True)
    """
    try:
        from stancekit.learners.surrogates.surrogate import Surrogate, as_batch
    except ImportError as error_:
        raise not_installed("surrogate", error_.name, "networks", "rl") from None
    some = [problems] if isinstance(problems, Problem) else problems
    return Surrogate.of(surrogate).screen(as_batch(some), error)
