"""What was trained, from the command line: policies (the lift, or any selector's file), and proposers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from stancekit.learners.proposers.proposer import Proposers
    from stancekit.learners.selectors.selector import Learned
    from stancekit.planners.problem.course import Course
    from stancekit.planners.relaxation.envelope import EnvelopeSet
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
    from stancekit.learners.selectors.selector_file import load_selector
    from stancekit.runner.control.envelope_choice import SelectorPolicy

    learned = load_selector(Path(name))
    if learned.relaxation != "p1":
        raise InvalidInput(f"{name}: expected a selector of boxes for P1 alone, got one for P1 {learned.relaxation}")
    policy = SelectorPolicy(learned.selector, _envelopes(learned, name))
    try:
        policy.check_fits(course)
    except InvalidInput as error:
        raise InvalidInput(f"{name}: {error}") from None
    return policy


def _envelopes(learned: Learned, name: str) -> EnvelopeSet:
    """Envelopes of the selector's class of problems: its own, where it has some; else the expert's."""
    from stancekit.envs.distributions.postures import PostureDistribution, distribution
    from stancekit.learners.selectors.selector import FixedSelector
    from stancekit.planners.relaxation.expert import expert_envelopes

    if isinstance(learned.selector, FixedSelector):
        return learned.selector.envelopes
    try:
        kind = distribution(learned.problem_class)
    except InvalidInput as error:
        raise InvalidInput(f"{name}: problem class: {error}") from None
    if not isinstance(kind, PostureDistribution):
        got = learned.problem_class
        raise InvalidInput(f"{name}: problem class: expected one of the ground or of walls, got {got}")
    return expert_envelopes(kind.terrain, legs=kind.legs)
