"""What was trained, from the command line: policies (the lift, or any selector's file), and proposers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from stancekit.learners.proposers.proposer import Proposers
    from stancekit.planners.problem.course import Course
    from stancekit.runner.control.envelope_choice import SelectorPolicy

LIFT = "lift"


def read_proposers(path: Path) -> Proposers:
    """Networks that propose. Raises InvalidInput for a file that is missing or wrong, and where torch is missing."""
    try:
        from stancekit.learners.proposers.proposer import Proposers
    except ModuleNotFoundError as error:
        raise InvalidInput(f"{path}: proposers need {error.name}, got none: pip install 'stancekit[rl]'") from None
    return Proposers.load(path)


def read_policy(name: str, course: Course) -> SelectorPolicy | None:
    """A selector as a policy for a course; None for the lift, which needs none.

    Raises InvalidInput for a file that is missing or wrong, and for a selector that the course would never ask.
    """
    if name == LIFT:
        return None
    from stancekit.envs.learned_selectors import class_envelopes
    from stancekit.learners.selectors.selector_file import load_selector
    from stancekit.runner.control.envelope_choice import SelectorPolicy

    learned = load_selector(Path(name))
    try:
        policy = SelectorPolicy(learned.selector, class_envelopes(learned))
        policy.check_fits(course)
    except InvalidInput as error:
        raise InvalidInput(f"{name}: {error}") from None
    return policy

