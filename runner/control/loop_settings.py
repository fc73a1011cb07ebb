"""Settings of a closed loop."""

from __future__ import annotations

from dataclasses import dataclass

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked, collect_errors
from stancekit.planners.search.friction_margin import SHARES


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Settings of a closed loop.

    Arguments:
        horizon: key frames a plan; 0 for all that are left.
        replan_m: a body or a foot farther than this from the plan has the rest planned anew, at the
            next moment when all feet stand; inf for never.
        tries: so many plans in a row that come no farther, and it gives up.
        shares: of the friction that is counted on, that are planned with.
        goal_m: how far from where its last plan has it the centre of mass may end.
        learn_friction: estimate it from what feet feel.
    """

    horizon: int = 0
    replan_m: float = 0.012
    tries: int = 6
    shares: tuple[float, ...] = SHARES
    goal_m: float = 0.03
    learn_friction: bool = True

    def __post_init__(self) -> None:
        collect_errors(
            lambda: checked(self.tries, "loop.tries", least=1.0),
            lambda: checked(self.horizon, "loop.horizon", least=0.0),
            lambda: checked(self.goal_m, "loop.goal_m", above=0.0),
        )
        if not self.replan_m > 0.0:
            raise InvalidInput(
                f"loop.replan_m: expected a number above 0, or inf, got {self.replan_m!r}"
            )
