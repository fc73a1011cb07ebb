"""Settings of a plan: what it has to keep and to bear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..arguments import check_argument
from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.arrays import checked as checked_number
from ..problem.contact import wrench_of
from ..problem.standing_map import StandingMap
from ..projection.whole_body import WholeBodyLimits


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanSettings:
    """Settings of ``plan`` beside its method: what a plan has to keep and to bear.

    Arguments:
        body: limits of joints and bodies; a plan that breaks them is bent until it keeps them.
        push_n: horizontal push at the centre of mass, in any direction, that every stance has to
            bear [N]; a course of its own may ask for more. Without one a plan that bears 5 % of the
            weight is sought, then 2.5 %, and the report says what it bears. "two-stage" alone, and
            *infeasible* is not said with it.
        wrench: force [N] at the centre of mass, or that and a moment about it [Nm], on the body in
            addition to its weight at every key frame, such as those of a payload, wind or a rope;
            in world axes, shape (3,) or (6,); added to what the course has. Plans carry it, and
            *infeasible* is proved with it.
        standing: with a start and a goal, a map of where the robot can stand, as ``map`` makes it,
            or its file: the way costs more where the robot, facing along x and as it stands, is not
            likely to, and most where it is proved not to.
        leaps: with a start and a goal, whether a robot that was named may leap where key frames have
            no plan. Where it may, a proof that no balanced motion leads to the goal leaves the
            answer undecided; where it may not, the answer is infeasible.
        checkpoint: file NAME.json that keeps the finished pieces of a course of more than 40 key
            frames, which is planned in pieces: the same call goes on from there after an
            interruption. The file is removed once there is a plan.

    Raises:
        InvalidInput: for a push below 0, and a wrench that is none.
    Source:
        None: demands on a plan beside those of Lin et al.

    Example:
        >>> from stancekit import PlanSettings, WholeBodyLimits
        >>> PlanSettings(push_n=20.0, body=WholeBodyLimits(torque_nm=8.0)).push_n
        20.0
    """

    body: WholeBodyLimits = field(default_factory=WholeBodyLimits)
    push_n: float = 0.0
    wrench: Array | Sequence[float] | None = None
    standing: StandingMap | str | Path | None = None
    leaps: bool = True
    checkpoint: str | Path | None = None

    def __post_init__(self) -> None:
        check_argument("body", self.body, WholeBodyLimits)
        check_argument("standing", self.standing, StandingMap | str | Path | None)
        check_argument("checkpoint", self.checkpoint, str | Path | None)
        object.__setattr__(self, "push_n", checked_number(self.push_n, "push_n", least=0.0))
        if self.wrench is not None:
            object.__setattr__(self, "wrench", wrench_of(self.wrench))

    def check_of_leap(self) -> None:
        """Raise InvalidInput for a setting that a leap has no use for."""
        if self.push_n:
            raise InvalidInput(
                "push_n: expected none with a leap, whose stances are not pushed yet"
            )
        if self.wrench is not None:
            raise InvalidInput(
                "wrench: expected none with a leap, whose body bears nothing but its weight yet"
            )
        if self.body != WholeBodyLimits():
            raise InvalidInput(
                "body: expected none with a leap, whose limits are those of its robot's file"
            )
        for name in ("standing", "checkpoint"):
            if getattr(self, name) is not None:
                raise InvalidInput(f"{name}: expected none with a leap, got {getattr(self, name)}")
