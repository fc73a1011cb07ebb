"""Motions: plans and walks, executed in a simulation or run on a robot."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stancekit import InvalidInput, Motion, Problem, RunReport, RunSettings
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import checked
from stancekit.planners.errors import located
from stancekit.planners.files.documents import read_json
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import builtin_courses, read_course
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.verify.geometry import LEAST_PUSH
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport
from stancekit.runner.control.envelope_choice import Policy
from stancekit.runner.log import Log, McapLog
from stancekit.runner.run import Runner
from stancekit.runner.worlds.world import (
    WORLDS as WORLDS,
    EstopCheck,
    JointBus,
    SoftContact,
    WorldSettings,
)

if TYPE_CHECKING:
    from stancekit.runner.control.envelope_choice import SelectorPolicy

Progress = Callable[[int, int], None]
_Motion = Motion[Any] | Accepted[Any]
"""What can be run; of the accepted ones nothing is judged again."""
LIFT = "lift"


@checked
def simulate(
    motion: _Motion | str | Path,
    world: str | JointBus = "mujoco",
    *,
    settings: RunSettings = RunSettings(check_limits=False),
    contact_stiffness_n_m: float | None = None,
    contact_damping_ns_m: float | None = None,
    progress: Progress | None = None,
) -> RunReport:
    """Execute a plan or a walk in a simulated world at the pace of ``settings``, and compare
    planned with measured.

    Arguments:
        motion: a plan of key frames, a walk, a leap, a crossing, or the file of one.
        world: "mujoco", "bullet", "FILE.py:NAME", or a simulated world that was made before.
        settings: settings of the run; limits are checked only with ``check_limits``.
        contact_stiffness_n_m: force of each foot per depth, for ground that yields; None for hard
            ground [N/m].
        contact_damping_ns_m: force per speed of sinking; None for that of a robot which sinks
            without swinging [N s/m].
        progress: called with the numbers of key frames done and of all.

    Returns:
        A ``RunReport``; ``execution`` is planned against measured, None where the motion never
        began.

    Raises:
        InvalidInput: for a motion that the verifier rejects, a schedule that lifts all limbs at
            once, a world that is no simulation, and without pinocchio.
    Source:
        None: a position controller with gravity in its targets.

    Example:
        >>> import stancekit
        >>> outcome = stancekit.plan("walls", frames=2)
        >>> stancekit.simulate(outcome.solution).succeeded  # doctest: +SKIP
        True
    """
    accepted = accepted_of(motion)
    check_run(accepted, world, settings, led=False)
    contact = SoftContact.of(contact_stiffness_n_m, contact_damping_ns_m)
    made = _world(world, accepted, contact=contact)
    if made.kind != "simulation":
        made.close()
        called = world if isinstance(world, str) else made.name
        raise InvalidInput(f"world: expected a simulation, got {called}, which is {made.kind}")
    runner = Runner(made, settings=settings, progress=progress or _nothing)
    return runner.run(accepted, accepted.plan.ground(settings.friction_share))


@checked
def run(
    motion: _Motion | Problem | str | Path,
    world: str | JointBus = "mujoco",
    *,
    setup: str | Path | None = None,
    settings: RunSettings = RunSettings(),
    arm: EstopCheck | None = None,
    policy: str | Path | Policy | None = None,
    log: str | Path | None = None,
    progress: Progress | None = None,
) -> RunReport | LoopReport:
    """Run a plan, a walk or a policy on a world: a simulator, servos on a bus, a robot behind a
    rosbridge.

    Arguments:
        motion: a plan of key frames, a walk, a leap, a crossing, or the file of one; with
            ``policy`` also a course, by name or file.
        world: "mujoco", "bullet", "dynamixel", "ros", "FILE.py:NAME", or a world that was made
            before.
        setup: the file that a world is made from: the calibration of dynamixel, the set-up of ros.
        settings: how it is run.
        arm: None moves nothing real, and says what would have been sent. "heard" arms where the
            e-stop was heard or it is published, "try" once it was pressed and released,
            "without" whatever is known of it.
        policy: closes the loop: the coming key frames are planned by it, and anew where the robot
            is off its plan. A trained selector's file or name, "lift" for the planner without one,
            or a function of an observation.
        log: a file .mcap for everything that was sent and measured.
        progress: called with the numbers of key frames done and of all.

    Returns:
        A ``RunReport``, or a ``LoopReport`` of a policy: ``succeeded``, and ``message`` where not.

    Raises:
        InvalidInput: for what cannot be run, before anything moves. What stops it on the way is in
            the report.
    Source:
        None: the guard, the watchdog and the stop latch of ``runner.safety``.

    Example:
        >>> import stancekit
        >>> stancekit.run("plan.json", "mujoco").succeeded  # doctest: +SKIP
        True
    """
    if log is not None and Path(log).suffix != ".mcap":
        raise InvalidInput(f"log: expected a name that ends in .mcap, got {log}")
    request = accepted_of(motion) if policy is None else led_by_policy(motion)
    check_run(request, world, settings, led=policy is not None)
    with ExitStack() as stack:
        made = _world(world, request, setup, arm)
        stack.callback(made.close)
        written = Log() if log is None else stack.enter_context(McapLog(Path(log)))
        monitor = None
        if arm is not None and made.kind == "hardware":
            from stancekit.runner.safety.heartbeat import HeartbeatMonitor

            monitor = stack.enter_context(HeartbeatMonitor(settings.limits.silent_s, made.alone))
        runner = Runner(
            made,
            settings=settings,
            dry=arm is None,
            log=written,
            progress=progress or _nothing,
            monitor=monitor,
        )
        if policy is None:
            assert not isinstance(request, Problem)
            return runner.run(request, request.plan.ground(settings.friction_share))
        walked = request.plan.problem if isinstance(request, Accepted) else request
        planner = policy_of(policy, walked) if isinstance(policy, str | Path) else policy
        first = request if isinstance(request, Accepted) else None
        ground = slippery(walked, settings.friction_share).terrain
        return ClosedLoop(walked, runner, planner, settings.loop).run(ground, first=first)


def check_run(
    asked: Accepted[Any] | Problem,
    world: str | JointBus,
    settings: RunSettings,
    *,
    led: bool,
) -> None:
    """Raise InvalidInput for settings that the motion, the world or a policy has no use for, before
    a world is made.

    Arguments:
        led: a policy closes the loop.
    """
    name, kind = (
        (world, WORLDS.get(world).kind) if isinstance(world, str) else (world.name, world.kind)
    )
    simulated = kind == "simulation"
    for wrong, message in (
        (
            settings.friction_share != 1.0 and not simulated,
            f"friction_share: expected a simulated world with it, got {name}",
        ),
        (
            settings.wrench is not None and not simulated,
            f"wrench: expected a simulated world with it, got {name}",
        ),
        (
            settings.blind and (led or not simulated),
            "blind: expected a plan or a gait in a simulated world with it, got "
            f"{'a policy' if led else name}",
        ),
        (
            _is_timed(asked) and settings.timing != Timing(),
            f"timing: expected key frames: a {_called(asked)} runs as planned, or not at all",
        ),
        (
            _called(asked) in ("leap", "crossing") and settings.least_push != LEAST_PUSH,
            f"least_push: expected a plan of key frames, got a {_called(asked)}, which bears "
            "nothing in the air",
        ),
    ):
        if wrong:
            raise InvalidInput(message)


def accepted_of(motion: _Motion | Problem | str | Path) -> Accepted[Any]:
    """A motion that the verifier accepts, judged as it comes in.

    Raises InvalidInput for anything else.
    """
    if isinstance(motion, Accepted):
        return motion
    if isinstance(motion, Motion):
        return Accepted.verified(motion, motion.name)
    if isinstance(motion, Problem):
        raise InvalidInput(
            f"motion: expected a plan or a walk; the course {motion.name} is walked by a policy"
        )
    if _is_course(motion):
        raise InvalidInput(
            f"{motion}: expected a plan file; a course is walked with a policy, got none"
        )
    return Accepted.from_file(motion)


def led_by_policy(motion: _Motion | Problem | str | Path) -> Accepted[Plan] | Problem:
    """Course that a policy walks, or plan that it begins with.

    Raises InvalidInput for a walk.
    """
    if isinstance(motion, Problem):
        return motion
    if isinstance(motion, str | Path) and _is_course(motion):
        return read_course(str(motion))
    request = accepted_of(motion)
    if _is_timed(request):
        what = _called(request)
        raise InvalidInput(f"policy: expected key frames: a {what} runs as planned, or not at all")
    return request


def policy_of(name: str | Path, course: Problem) -> SelectorPolicy | None:
    """A selector as a policy for a course; None for the lift, which needs none.

    Arguments:
        name: "lift", a selector's file, or the name of one that ships.

    Raises:
        InvalidInput: for a file that is missing or wrong, and for a selector that the course would
            never ask.
    """
    if name == LIFT:
        return None
    from stancekit.envs.selection import class_envelopes
    from stancekit.learners.selectors.selector import load_selector
    from stancekit.runner.control.envelope_choice import SelectorPolicy

    learned = load_selector(Path(name))
    with located(str(name)):
        policy = SelectorPolicy(learned.selector, class_envelopes(learned))
        policy.check_fits(course)
    return policy


def _is_timed(asked: Accepted[Any] | Problem) -> bool:
    """Tell whether it runs at its own pace, or holds what does."""
    return isinstance(asked, Accepted) and not asked.plan.keyed


def _called(asked: Accepted[Any] | Problem) -> str:
    """Kind of a motion, in words."""
    return "plan" if isinstance(asked, Problem) else str(asked.plan.word)


def _is_course(path: str | Path) -> bool:
    if str(path) in builtin_courses() or Path(path).suffix in (".yaml", ".yml"):
        return True
    data = read_json(path) if Path(path).suffix == ".json" else None
    return isinstance(data, dict) and data.get("format") == Problem.FORMAT


def _world(
    world: str | JointBus,
    asked: Accepted[Any] | Problem,
    setup: str | Path | None = None,
    arm: EstopCheck | None = None,
    contact: SoftContact | None = None,
) -> JointBus:
    """The world, made for whom the motion is for where it is a name."""
    if not isinstance(world, str):
        for name, given in (("setup", setup), ("contact_stiffness_n_m", contact)):
            if given is not None:
                raise InvalidInput(f"{name}: expected none with a world that was made before")
        return world
    return WORLDS.get(world).make(
        WorldSettings(
            robot=asked.robot,
            gravity_m_s2=asked.gravity_m_s2,
            setup=None if setup is None else Path(setup),
            contact=contact,
            estop=arm or "heard",
        )
    )


def _nothing(done: int, total: int) -> None:
    """Ignore progress."""
