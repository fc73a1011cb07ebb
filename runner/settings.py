"""Settings of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from stancekit.planners.arguments import check_types
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import LARGEST, check_numbers, checked, collect_errors
from stancekit.planners.files.documents import shown
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.contact import wrench_of
from stancekit.planners.search.friction_margin import SHARES
from stancekit.planners.verify.geometry import LEAST_PUSH

from .control.body_feedback import BodyFeedback
from .control.foot_placement import ContactFeedback
from .safety.estop import Source
from .safety.guard import Ending, Limits


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """When a run is a success, and how far from its plan it is stopped.

    Arguments:
        com_m: largest distance of the final centre of mass from the plan's.
        joint_rad: the same of the joints.
        slip_m: longest distance that a foot slides while it should stand.
        body_m, body_rad: a body farther than this from where it should be has fallen, and stops the
            run, where the world measures it.
    """

    com_m: float = 0.03
    joint_rad: float = 0.1
    slip_m: float = 0.02
    body_m: float = 0.10
    body_rad: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self, "tolerance.", above=self.__annotations__)


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Settings of a closed loop.

    Arguments:
        horizon: key frames a plan; 0 for all that are left.
        replan_m: a body or a foot farther than this from the plan has the rest planned anew, at the
            next moment when all feet stand; inf for never.
        tries: so many plans in a row that come no farther, and it gives up.
        shares: of the friction that is counted on, that are planned with, above 0 and up to 1.
        goal_m: how far from where its last plan has it the centre of mass may end.
        learn_friction: estimate it from what feet feel.
    """

    horizon: int = 0
    replan_m: float = 0.012
    tries: int = 6
    shares: Sequence[float] = SHARES
    goal_m: float = 0.03
    learn_friction: bool = True

    def __post_init__(self) -> None:
        check_types(self, "loop.")
        collect_errors(
            lambda: checked(self.tries, "loop.tries", least=1.0),
            lambda: checked(self.horizon, "loop.horizon", least=0.0),
            lambda: checked(self.goal_m, "loop.goal_m", above=0.0),
            lambda: checked(min(self.replan_m, LARGEST), "loop.replan_m", above=0.0),
        )
        if not self.shares or not all(0.0 < share <= 1.0 for share in self.shares):
            raise InvalidInput(
                f"loop.shares: expected numbers above 0 and up to 1, got {shown(self.shares)}"
            )


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings of running a plan, or a gait.

    Arguments:
        timing: durations of a plan's phases.
        feedback: what the feet do with the forces that they feel.
        body: what they do about a body that is measured and not where it should be.
        limits: what is let through to the world.
        tolerance: when it is stopped, and when it is a success.
        speed_rad_s: speed of the soft start and of the way home [rad/s].
        ending: the state to leave the robot in.
        hung: the robot hangs in a stand, level and off the ground: its feet carry nothing and meet
            nothing; for what is real only.
        forces: press with a plan's forces "shared" anew among the limbs of every stance, with a
            reserve of friction, or as "planned".
        check_limits: a plan is slowed down to what its joints can do, and refused where no pace
            helps; False, for simulations only, to see what happens without.
        least_push: a plan for a robot's own legs is refused where a stance bears no push of this
            share of the weight; 0 to run it all the same.
        blind: send what a robot that measures its joints alone is sent, and use nothing else that
            the world measures.
        odometry: where the body is is taken from its joints and the feet that stand, and fed back,
            whatever the world measures.
        friction_share: simulations: the terrain has only this share of the friction that is counted
            on.
        wrench: simulations: what is on the body beside its weight, a force at the centre of mass
            [N] and a moment about it [Nm], in world axes, 3 or 6 numbers; None for what a plan
            says.
        stops: what stops it from outside, beside signals: functions that return why, or None.
        loop: how a policy plans anew on the way.

    Raises:
        InvalidInput: for a speed or a share out of range, and a value of another type.
    Source:
        None: what a robot is run with.

    Example:
        >>> from stancekit import RunSettings
        >>> RunSettings(ending="home").friction_share
        1.0
    """

    timing: Timing = field(default_factory=Timing)
    feedback: ContactFeedback = field(default_factory=ContactFeedback)
    body: BodyFeedback = field(default_factory=BodyFeedback)
    limits: Limits = field(default_factory=Limits)
    tolerance: Tolerance = field(default_factory=Tolerance)
    speed_rad_s: float = 0.4
    ending: Ending = "hold"
    hung: bool = False
    forces: Literal["shared", "planned"] = "shared"
    check_limits: bool = True
    least_push: float = LEAST_PUSH
    blind: bool = False
    odometry: bool = False
    friction_share: float = 1.0
    wrench: tuple[float, ...] | None = None
    stops: Sequence[Source] = ()
    loop: LoopSettings = field(default_factory=LoopSettings)

    def __post_init__(self) -> None:
        collect_errors(
            lambda: checked(self.speed_rad_s, "speed_rad_s", above=0.0),
            lambda: checked(self.least_push, "least_push", least=0.0, most=1.0),
            lambda: checked(self.friction_share, "friction_share", above=0.0, most=1.0),
        )
        if self.wrench is not None:
            object.__setattr__(self, "wrench", tuple(wrench_of(self.wrench).tolist()))
        check_types(self)
