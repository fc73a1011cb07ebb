"""Courses: plan key frames over them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.crossing import Crossing
from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import check_argument, checked
from stancekit.planners.equilibrium.programs import Programs, programs_of_this_thread
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array, checked_choice
from stancekit.planners.files.arrays import checked as checked_number
from stancekit.planners.files.validation import shown
from stancekit.planners.formats.leap_file import is_leap_file, read_leap
from stancekit.planners.formats.partial_plan import PartialPlan
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.course_file import is_scene, read_course
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.standing_map import StandingMap
from stancekit.planners.problem.wrench import wrench_of
from stancekit.planners.projection.whole_body_limits import WholeBodyLimits
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.reach_sets import Sets
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.methods import Method, PlannerOptions, make_planner, through_verifier
from stancekit.planners.search.plan_course import ALL_FRICTION, LayOut, plan_course
from stancekit.planners.terrain.footholds import FootholdLimits, Footholds
from stancekit.planners.terrain.import_options import SUFFIXES

from .upgrading import old_arguments

OLD = {
    "planner": "plan(course, method)",
    "reserve": "plan(course, TwoStage(reserve=...))",
    "relaxation": "plan(course, TwoStage(relaxation=...))",
    "envelopes": "plan(course, TwoStage(envelopes=...))",
    "projection": "plan(course, TwoStage(projection=...))",
    "torque_nm": "plan(course, body=WholeBodyLimits(torque_nm=...))",
    "torque_share": "plan(course, body=WholeBodyLimits(share=...))",
    "clearance_m": "plan(course, body=WholeBodyLimits(clearance_m=...))",
    "engine": "a planner of make_planner with PlannerOptions(programs=Programs(engine=...))",
}
FRAMES_SHARE = 0.2
"""Share of the time that key frames have where there is no way for the body, and a leap may be tried."""
LIMITS = {"torque_nm": "torque_nm", "torque_share": "share", "clearance_m": "clearance_m"}


@overload
def plan(
    course: Problem | Footholds | str | Path,
    method: str | Method | Planner = "two-stage",
    *,
    start_xy_m: Array | Sequence[float] | None = None,
    goal_xy_m: Array | Sequence[float] | None = None,
    frames: int | None = None,
    robot: Robot | str | Path | None = None,
    body: WholeBodyLimits = WholeBodyLimits(),
    push_n: float = 0.0,
    wrench: Array | Sequence[float] | None = None,
    standing: StandingMap | str | Path | None = None,
    time_limit_s: float = 60.0,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], object] | None = None,
    **old: Any,
) -> Answer[Plan]: ...
@overload
def plan(
    course: Leap, method: LeapFinder = LeapFinder(), *, time_limit_s: float = 60.0
) -> Answer[LeapPlan]: ...
@checked
def plan(
    course: Problem | Footholds | Leap | str | Path,
    method: str | Method | Planner | LeapFinder = "two-stage",
    *,
    start_xy_m: Array | Sequence[float] | None = None,
    goal_xy_m: Array | Sequence[float] | None = None,
    frames: int | None = None,
    robot: Robot | str | Path | None = None,
    body: WholeBodyLimits = WholeBodyLimits(),
    push_n: float = 0.0,
    wrench: Array | Sequence[float] | None = None,
    standing: StandingMap | str | Path | None = None,
    time_limit_s: float = 60.0,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], object] | None = None,
    **old: Any,
) -> Answer[Plan] | Answer[LeapPlan] | Answer[Crossing]:
    """Plan the key frames of a climb: where every toe goes, where the body is, and what every limb
    carries; or a leap.

    Arguments:
        course: a ``Problem``, a built-in one by name ("stairs", "walls", "icy-walls", "tube",
            "ground-to-wall"), or a YAML or JSON file; one posture problem is a course of one frame,
            and with ``robot`` its joints are found and bent, too. With a start and a goal also a
            terrain: a mesh, a grid or a cloud in a file, a ground by its name, or what ``terrain``
            returned. A ``Leap``, or a file of one, is planned by the finder of leaps, with no
            argument but ``method``, a ``LeapFinder``, and ``time_limit_s``.
        method: a value with its settings: ``TwoStage(...)`` relaxes and projects, ``Exact()`` finds
            the best plan of a short course, ``Micp(...)``, ``Nlp()``, ``Decoupled()`` (a baseline
            that fails on ice). Or text: "two-stage", ..., a name that a package registered under
            ``stancekit.planners``, "FILE.py:NAME". Or a planner that was made before.
        start_xy_m, goal_xy_m: places over a terrain where the centre of mass starts and ends, shape
            (2,) [m]; frames, gait and candidates are laid out between them.
        frames: number of key frames M, in place of the course's own.
        robot: robot in place of the course's: a ``Robot``, a name, or a ``.urdf`` or ``.yaml`` file
            (extra kin); for a posture problem the robot whose limbs stand, with its other limbs
            held as they are when it stands.
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
            or its file: the way keeps off places where it is proved that the robot cannot, facing
            along x, and costs more where that is likely.
        time_limit_s: time limit for everything, bending and judging included; at its end the answer
            is undecided, with the best plan so far [s]. A planner that was made before keeps to its
            own limit, too.
        checkpoint: file NAME.json that keeps the finished pieces of a course of more than 40 key
            frames, which is planned in pieces: the same call goes on from there after an
            interruption. The file is removed once there is a plan.
        progress: function called after every piece of such a course with the number of key frames
            planned and the number in all.
        old: settings of methods and limits as arguments, the old form.

    Returns:
        An ``Answer``: feasible with a plan, its ``solution``, that the verifier accepted in every
        stance and between them, as far as its ``report`` says that it was checked; infeasible with
        a certificate, over the outer sets of a robot's own legs, for the course in ``problem``,
        which has the candidates and the tilt limit of one that was laid out already; or undecided,
        also with a plan whose joints cannot do it, whose bodies collide, or that was not judged in
        time. ``bound`` is a proved lower bound on the objective of any plan. Of a leap, one with a
        ``LeapPlan``. Over a terrain with a gap that key frames do not cross, of a robot whose legs
        have limits of torque and speed, one with a ``Crossing``: key frames up to the gap, a leap,
        and key frames on from it; its ``refusal`` is what key frames alone came to.

    Raises:
        InvalidInput: for a course or a robot that is none, an unknown method, or envelopes that are
            missing or have no use.
    Source:
        Lin et al. §IV-B, E11, E1-E10 in every stance.

    Example:
        >>> import stancekit
        >>> outcome = stancekit.plan("stairs", stancekit.TwoStage(reserve=False), frames=4)
        >>> outcome.status.value, outcome.solution.com_m.shape
        ('feasible', (4, 3))
    """
    deadline = time.perf_counter() + checked_number(time_limit_s, "time_limit_s", least=0.0)
    if isinstance(course, str | Path) and is_leap_file(course):
        if isinstance(robot, Robot):
            raise InvalidInput("robot: expected a name or a file with a leap, got a Robot")
        course, robot = read_leap(course, robot).leap, None
    if isinstance(course, Leap):
        beside_leap = {
            "start_xy_m": start_xy_m,
            "standing": standing,
            "goal_xy_m": goal_xy_m,
            "frames": frames,
            "robot": robot,
            **old,
        }
        if push_n:
            raise InvalidInput(
                "push_n: expected none with a leap, whose stances are not pushed yet"
            )
        if wrench is not None:
            raise InvalidInput(
                "wrench: expected none with a leap, whose body bears nothing but its weight yet"
            )
        if body != WholeBodyLimits():
            raise InvalidInput(
                "body: expected none with a leap, whose limits are those of its robot's file"
            )
        return _leap(course, method, beside_leap, time_limit_s)
    if isinstance(method, LeapFinder):
        raise InvalidInput(
            f"method: expected one of courses, got a LeapFinder for a {type(course).__name__}"
        )
    beside = (
        "course",
        "method",
        "start_xy_m",
        "goal_xy_m",
        "frames",
        "robot",
        "body",
        "push_n",
        "wrench",
        "standing",
        "time_limit_s",
    )
    renamed = old_arguments("plan", old, OLD, beside) if old else {}
    called = "planner" if "planner" in renamed else "method"
    method = renamed.pop("planner", method)
    check_argument("planner", method, str | Method | Planner)
    engine: Any = renamed.pop("engine", "rows")
    checked_choice(engine, "engine", ("rows", "cvxpy"))
    programs = programs_of_this_thread() if engine == "rows" else Programs(engine=engine)
    moved = {LIMITS[name]: renamed.pop(name) for name in LIMITS if name in renamed}
    limits = replace(body, **moved) if moved else body
    shares = None
    if not isinstance(method, Method) and method != "two-stage":  # which have no such setting
        shares = None if renamed.pop("reserve", True) else ALL_FRICTION
    question = _question(
        course, None if frames is None else int(frames), robot, start_xy_m, goal_xy_m, standing
    )
    if isinstance(method, str | Method):
        options = PlannerOptions(time_limit_s=time_limit_s, programs=programs)
        planner = _made(called, method, options, renamed)
    elif renamed:
        raise InvalidInput(
            f"{next(iter(renamed))}: expected none for a planner that was made before"
        )
    else:
        assert not isinstance(method, LeapFinder)
        planner = through_verifier(method, "courses")
    push_n = checked_number(push_n, "push_n", least=0.0)
    beside_weight = None if wrench is None else wrench_of(wrench)
    given_so = (
        start_xy_m is None
        and isinstance(course, str | Path)
        and callable(question)
        and is_scene(course)
    )
    layouts = (AS_ASKED,) if given_so else ALTERNATIVES
    leaps = _may_leap(question, loaded=push_n > 0.0 or beside_weight is not None)
    until = deadline
    if leaps and _no_way(question):
        until = time.perf_counter() + FRAMES_SHARE * (deadline - time.perf_counter())
    refusal: InvalidInput | PlanningFailed | None = None
    answer: Answer[Plan] | None = None
    try:
        answer = plan_course(
            question,
            planner,
            shares=shares,
            limits=limits,
            push_n=push_n,
            wrench=beside_weight,
            layouts=layouts,
            kept=None if checkpoint is None else PartialPlan(Path(checkpoint)),
            progress=progress,
            deadline=until,
        )
    except PlanningFailed as error:
        if not leaps:
            raise
        refusal = error
    crossed: Any = None
    if leaps and (answer is None or answer.status is not Status.FEASIBLE):
        from stancekit.planners.leap.crossing import cross  # of gaps alone
        from stancekit.planners.problem.course_between import LaidBetween  # loads scipy's graphs

        assert isinstance(question, LaidBetween)
        assert question.robot is not None
        why = str(refusal) if answer is None else answer.message or answer.status.value
        crossed = cross(
            question, planner, robot=question.robot, refusal=why, limits=limits, deadline=deadline
        )
    if crossed is not None:
        return crossed  # type: ignore[no-any-return]
    if answer is None:
        assert refusal is not None
        raise refusal
    return answer


def _may_leap(question: Problem | LayOut, *, loaded: bool) -> bool:
    """Tell whether leaps may be tried where key frames have no plan: over a terrain, by a robot that
    was named, with nothing on its body and nobody who pushes it.
    """
    from stancekit.planners.problem.course_between import LaidBetween  # loads scipy's graphs

    return isinstance(question, LaidBetween) and question.robot is not None and not loaded


def _no_way(question: Problem | LayOut) -> bool:
    """Tell whether a course between two places has no way for the body as it is asked for."""
    try:
        question("inner", AS_ASKED)  # type: ignore[operator]
    except PlanningFailed:
        return True
    except InvalidInput:
        return False
    return False


def _leap(
    leap: Leap, method: object, others: dict[str, Any], time_limit_s: float
) -> Answer[LeapPlan]:
    """Plan a leap.

    Raises InvalidInput.

    Arguments:
        others: arguments that it does not take.
    """
    for name, value in others.items():
        if value is not None:
            raise InvalidInput(f"{name}: expected none with a leap, which has its own")
    if method == "two-stage":  # nothing was said
        method = LeapFinder()
    if not isinstance(method, LeapFinder):
        raise InvalidInput(f"method: expected a LeapFinder for a leap, got {shown(method)}")
    deadline = time.perf_counter() + time_limit_s
    answer = find_leap(leap, method, time_limit_s=time_limit_s)
    if answer.solution is None or not leap.robot.source.own:
        return answer
    from stancekit.planners.leap.bend import judged_answer  # reads robots, and is slow to import

    return judged_answer(answer, programs_of_this_thread(), share=method.share, deadline=deadline)


def _made(
    called: str, method: str | Method, options: PlannerOptions, settings: dict[str, Any]
) -> Planner:
    """The planner of a method; messages begin with what the argument is called.

    Raises InvalidInput.
    """
    try:
        return make_planner(method, options, of="courses", **settings)
    except InvalidInput as error:
        message = str(error)
        raise InvalidInput(
            f"{called}{message.removeprefix('planner')}"
            if message.startswith("planner:")
            else message
        ) from None


def _question(
    course: Problem | Footholds | str | Path,
    frames: int | None,
    robot: Robot | str | Path | None,
    start: Array | Sequence[float] | None,
    goal: Array | Sequence[float] | None,
    standing: StandingMap | str | Path | None,
) -> Problem | LayOut:
    """A course, or what lays it out: of a file of JSON, whose candidates are fixed, the course."""
    who = str(robot) if isinstance(robot, Path) else robot
    if (start is None) != (goal is None):
        raise InvalidInput("start_xy_m, goal_xy_m: expected both or none, got one of them")
    if isinstance(course, Footholds) or start is not None:
        if start is None or goal is None:
            raise InvalidInput("start_xy_m, goal_xy_m: expected both with a terrain, got none")
        if isinstance(course, Problem):
            raise InvalidInput(
                f"start_xy_m: expected none with a {type(course).__name__}, which has its own"
            )
        from stancekit.planners.problem.course_between import laid_between  # loads scipy's graphs
        from stancekit.planners.terrain.reference import names_ground  # splines are slow to import

        if isinstance(standing, str | Path):
            standing = StandingMap.read(standing)
        if standing is not None:
            _check_map(standing, course)
        if isinstance(course, str) and names_ground(course):
            course = _footholds(course, None if who == "hexapod" else who)
        return laid_between(course, start, goal, robot=who, frames=frames, standing=standing)
    if standing is not None:
        raise InvalidInput("standing: expected a start and a goal over a terrain with it, got none")
    if isinstance(course, Problem) and course.is_posture:
        if robot is None:
            course = course.course()
        else:
            from stancekit.planners.robot.robot_file import robot_of  # reads files

            course, robot = course.course(robot=robot_of(robot)), None
    if isinstance(course, str | Path):
        name = str(course)
        if is_leap_file(name):
            raise InvalidInput(f"{name}: expected a course, got a leap: plan(load({name!r}))")
        if Path(name).suffix.lower() in SUFFIXES:
            raise InvalidInput(
                f"start_xy_m, goal_xy_m: expected both with the terrain {name}, got none"
            )
        if Path(name).suffix in (".json", ".jsonl"):
            return read_course(name, frames, who)

        def laid_out(sets: Sets, alternative: Alternative = AS_ASKED) -> Problem:
            return read_course(name, frames, who, sets, alternative=alternative)

        return laid_out
    if robot is not None:
        raise InvalidInput(
            f"robot: expected none with a course that is laid out, got {_called(robot)}"
        )
    if frames not in (None, course.frames):
        raise InvalidInput(
            f"frames: expected none with a course that is laid out, of {course.frames}, got {frames}"
        )
    return course


def _check_map(standing: StandingMap, terrain: Footholds | str | Path) -> None:
    """Raise InvalidInput for a map of another terrain; footholds that are of no file or name are
    not known by it.
    """
    from stancekit.envs.distributions.cut import identity_of
    from stancekit.planners.terrain.reference import names_ground

    name = terrain.name if isinstance(terrain, Footholds) else str(terrain)
    if not isinstance(terrain, Footholds) or names_ground(name) or Path(name).is_file():
        mine = identity_of(name)
        if standing.terrain != mine:
            raise InvalidInput(f"standing: expected a map of {mine}, got one of {standing.terrain}")


def _footholds(name: str, robot: Robot | str | None) -> Footholds:
    """The footholds of a ground by its name, for the feet of a robot; as wide as ``terrain`` has
    them where none is.
    """
    from stancekit.planners.robot.robot_file import robot_of
    from stancekit.planners.terrain.foothold_search import (
        footholds_of,
    )  # splines are slow to import
    from stancekit.planners.terrain.reference import named_surface

    radius_m = 0.0 if robot is None else robot_of(robot).source.known_radius_m
    return footholds_of(named_surface(name), FootholdLimits.for_foot(radius_m), 0.8)


def _called(robot: Robot | str | Path) -> str:
    return robot.name if isinstance(robot, Robot) else str(robot)
