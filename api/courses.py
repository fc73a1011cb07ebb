"""Courses: plan key frames over them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, overload

from stancekit import Answer, Effort, Footholds, Problem, Robot, StandingMap, Status
from stancekit.planners.answer.certificate import Way
from stancekit.planners.answer.motion import Motion
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.arguments import checked
from stancekit.planners.equilibrium.programs import programs_of_this_thread
from stancekit.planners.errors import InvalidInput, NoPlace, PlanningFailed, until
from stancekit.planners.files.arrays import Array, checked as checked_number
from stancekit.planners.files.documents import shown
from stancekit.planners.leap.method import LeapFinder
from stancekit.planners.problem.contact import wrench_of
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.course_keys import ALTERNATIVES, AS_ASKED, Alternative
from stancekit.planners.problem.leap import Leap, is_leap_file
from stancekit.planners.search.answer import Method, Planner, PlanSettings
from stancekit.planners.search.methods import PlannerOptions, make_planner, through_verifier
from stancekit.planners.search.plan_course import LayOut, firmest, plan_course
from stancekit.planners.terrain.import_options import SUFFIXES, doubts
from stancekit.planners.verify.margins import with_margins

if TYPE_CHECKING:
    from stancekit.planners.problem.course_between import LaidBetween
    from stancekit.planners.robot.reach_sets import Sets
    from stancekit.planners.search.pieces import Kept

_BALANCED = "balanced motion is proved impossible, and leaps are not"
"""Of an answer that is undecided though a flood proves that no balanced motion leads to the goal."""


@overload
def plan(
    course: Problem | Footholds | str | Path,
    method: str | Method | Planner = "two-stage",
    *,
    start: Array | Sequence[float] | None = None,
    goal: Array | Sequence[float] | None = None,
    frames: int | None = None,
    robot: Robot | str | Path | None = None,
    settings: PlanSettings = PlanSettings(),
    time_limit_s: float = 60.0,
    progress: Callable[[int, int], object] | None = None,
) -> Answer[Plan]: ...
@overload
def plan(
    course: Leap, method: LeapFinder = ..., *, time_limit_s: float = 60.0
) -> Answer[LeapPlan]: ...
@overload
def plan(
    course: str | Path,
    method: LeapFinder,
    *,
    robot: str | Path | None = None,
    time_limit_s: float = 60.0,
) -> Answer[LeapPlan]: ...
@checked
def plan(
    course: Problem | Footholds | Leap | str | Path,
    method: str | Method | Planner | LeapFinder = "two-stage",
    *,
    start: Array | Sequence[float] | None = None,
    goal: Array | Sequence[float] | None = None,
    frames: int | None = None,
    robot: Robot | str | Path | None = None,
    settings: PlanSettings = PlanSettings(),
    time_limit_s: float = 60.0,
    progress: Callable[[int, int], object] | None = None,
) -> Answer[Plan] | Answer[LeapPlan] | Answer[Motion[Way]]:
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
            ``stancekit.planners``, "FILE.py:NAME". Or a planner.
        start, goal: places over a terrain where the centre of mass starts and ends, shape
            (2,) [m]; frames, gait and candidates are laid out between them.
        frames: number of key frames M, in place of the course's own.
        robot: robot in place of the course's: a ``Robot``, a name, or a ``.urdf`` or ``.yaml`` file
            (extra robots); for a posture problem the robot whose limbs stand, with its other limbs
            held as they are when it stands.
        settings: what the plan has to keep and to bear: limits of joints and bodies, a push, a
            wrench, a map of where the robot can stand, and a checkpoint.
        time_limit_s: time limit for everything, bending and judging included; at its end the answer
            is undecided, with the best plan so far [s]. A planner that was made before keeps to its
            own limit, too.
        progress: function called after every piece of such a course with the number of key frames
            planned and the number in all.

    Returns:
        An ``Answer``: feasible with a plan, its ``solution``, that the verifier accepted in every
        stance and between them, as far as its ``report`` says that it was checked; infeasible with
        a certificate, of the question that was asked: of a course, which states its layout, over
        the outer sets of a robot's own legs, for the course in ``problem``, which has the candidates
        and the tilt limit of one that was laid out already; between two places, that no balanced
        motion leads from start to goal, for the ``Passage`` in ``problem``; or undecided, also with
        a plan whose joints cannot do it, whose bodies collide, or that was not judged in time, and
        between places with that certificate where the robot may leap. ``bound`` is a proved lower
        bound on the objective of any plan. Of a leap, one with its ``Motion``. Over a
        terrain with a gap that key frames do not cross, of a robot whose legs have limits
        of torque and speed, one with a ``Motion`` of ``parts``: key frames up to the gap, a leap, and
        key frames on from it; its ``refusal`` says why key frames alone do not suffice.

    Raises:
        InvalidInput: for an unusable course or robot, an unknown method, or envelopes that are
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
        course, robot = _read_leap(course, robot), None
    if isinstance(course, Leap):
        return _leap(
            course,
            method,
            settings,
            {"start": start, "goal": goal, "frames": frames, "robot": robot},
            time_limit_s,
        )
    if isinstance(method, LeapFinder):
        raise InvalidInput(
            f"method: expected one of courses, got a LeapFinder for a {type(course).__name__}"
        )
    planner = _planner(method, time_limit_s)
    try:
        with doubts() as heard:
            question = _question(course, frames, robot, start, goal, settings.standing)
            with until(deadline):
                answer: Answer[Any] = _answer(question, planner, settings, deadline, progress)
    except (NoPlace, PlanningFailed) as error:  # of a ground or a layout with nothing to stand on
        answer = unmet(error, planner.name, robot)
    said = answer.doubts
    answer = replace(
        answer, more_doubts=(*answer.more_doubts, *(text for text in heard if text not in said))
    )
    if settings.margins and answer.report is not None and answer.report.answer.keyed:
        return replace(answer, report=with_margins(answer.report))
    return answer


def unmet(error: Exception, method: str, robot: Robot | str | Path | None) -> Answer[Any]:
    """The answer to a question that nothing can be laid out for, with the doubts of its robot."""
    from stancekit.planners.robot.robot_file import robot_of  # reads files

    doubts = () if robot is None else robot_of(robot).doubts
    return Answer(status=Status.UNDECIDED, method=method, message=str(error), more_doubts=doubts)


def _answer(
    question: Problem | LayOut,
    planner: Planner,
    settings: PlanSettings,
    deadline: float,
    progress: Callable[[int, int], object] | None,
) -> Answer[Plan] | Answer[Motion[Way]]:
    """The answer to a course, or to what lays it out.

    Raises NoPlace or PlanningFailed where nothing can be laid out between no two places.
    """
    kept: Kept | None = None
    if settings.checkpoint is not None:
        from stancekit.planners.formats.motion_file import PartialPlan  # of long courses alone

        kept = PartialPlan(Path(settings.checkpoint))
    search = partial(
        plan_course,
        question,
        limits=settings.body,
        push_n=settings.push_n,
        wrench=None if settings.wrench is None else wrench_of(settings.wrench),
        layouts=ALTERNATIVES,
        kept=kept,
        progress=progress,
    )
    by_frames: Callable[..., Answer[Plan]] = (
        partial(firmest, search, planner)
        if settings.prefer_margin
        else partial(search, planner=planner)
    )
    if hasattr(question, "onward"):
        between = cast("LaidBetween", question)
        return _between_places(by_frames, between, planner, settings, deadline)
    return by_frames(deadline=deadline)


def _between_places(
    by_frames: Callable[..., Answer[Plan]],
    question: LaidBetween,
    planner: Planner,
    settings: PlanSettings,
    deadline: float,
) -> Answer[Plan] | Answer[Motion[Way]]:
    """Plan by key frames alone; where they have no plan, climb, leap and climb.

    Where leaps do not help either, a flood proves that no balanced motion leads to the goal, or
    nothing does, whatever the time limit: the answer is infeasible where the robot may not leap, and
    undecided otherwise.

    Arguments:
        by_frames: plans by key frames until a ``deadline``.
        question: the course between two places.
        planner: plans the climbs.
        settings: what plans have to keep.
        deadline: the time at which the search ends (``time.perf_counter``) [s].
    """
    begin = time.perf_counter()
    answer: Answer[Plan] | None = None
    try:
        answer = by_frames(deadline=deadline)
        if answer.status is Status.FEASIBLE:
            return answer
        why = answer.message or answer.status.value
    except (NoPlace, PlanningFailed) as error:
        why = str(error)
    from stancekit.planners.search.flood import flood

    robot = question.robot
    leaps = settings.leaps and robot is not None and robot.own
    passage = (question if leaps else question.local).passage()  # crossings are in the world
    proof = None if settings.wrench is not None else flood(passage)
    crosses = leaps and settings.push_n == 0.0 and settings.wrench is None
    if crosses and robot is not None and time.perf_counter() < deadline:
        from stancekit.planners.leap.crossing import cross  # of gaps alone

        crossed = cross(
            question,
            planner,
            robot=robot,
            refusal=why,
            proof=proof,
            limits=settings.body,
            deadline=deadline,
        )
        if crossed is not None and crossed.status is Status.FEASIBLE:
            return crossed
        why = why if crossed is None else crossed.message
    if answer is None:
        effort = Effort(seconds=time.perf_counter() - begin)
        answer = Answer(
            status=Status.UNDECIDED, method=planner.name, problem=passage, effort=effort
        )
    if proof is None:
        return replace(answer, message=why)
    infeasible = replace(answer, certificate=proof, problem=passage, solution=None, report=None)
    if leaps:
        return replace(infeasible, message=f"{_BALANCED}; {why}")
    return replace(infeasible, status=Status.INFEASIBLE, message=why, bound=float("inf"))


def _read_leap(file: str | Path, robot: Robot | str | Path | None) -> Leap:
    """The leap of a file.

    Raises InvalidInput.
    """
    if isinstance(robot, Robot):
        raise InvalidInput("robot: expected a name or a file with a leap, got a Robot")
    from stancekit.planners.formats.question_file import read_leap  # of leaps alone

    return read_leap(file, robot)


def _leap(
    leap: Leap,
    method: object,
    settings: PlanSettings,
    others: dict[str, Any],
    time_limit_s: float,
) -> Answer[LeapPlan]:
    """Plan a leap.

    Raises InvalidInput.

    Arguments:
        others: arguments that it does not take.
    """
    for name, value in others.items():
        if value is not None:
            raise InvalidInput(f"{name}: expected none with a leap, which has its own")
    settings.check_of_leap()
    if method == "two-stage":  # nothing was said
        method = LeapFinder()
    if not isinstance(method, LeapFinder):
        raise InvalidInput(f"method: expected a LeapFinder for a leap, got {shown(method)}")
    from stancekit.planners.leap.finder import find_leap  # of leaps alone

    deadline = time.perf_counter() + time_limit_s
    answer = find_leap(leap, method, time_limit_s=time_limit_s)
    if answer.solution is None or not leap.robot.own:
        return answer
    from stancekit.planners.leap.bend import judged_answer  # reads robots, and is slow to import

    return judged_answer(answer, programs_of_this_thread(), share=method.share, deadline=deadline)


def _planner(method: str | Method | Planner, time_limit_s: float) -> Planner:
    """The planner of a method, or one that was made before.

    Raises InvalidInput.
    """
    if not isinstance(method, str | Method):
        return through_verifier(method, "courses")
    return make_planner(method, PlannerOptions(time_limit_s=time_limit_s), of="courses")


def _question(
    course: Problem | Footholds | str | Path,
    frames: int | None,
    robot: Robot | str | Path | None,
    start: Array | Sequence[float] | None,
    goal: Array | Sequence[float] | None,
    standing: StandingMap | str | Path | None,
) -> Problem | LayOut:
    """A course, or what lays it out."""
    if (start is None) != (goal is None):
        raise InvalidInput("start, goal: expected both or none, got one of them")
    frames = None if frames is None else int(frames)
    who = str(robot) if isinstance(robot, Path) else robot
    if start is not None and goal is not None:
        if isinstance(course, Problem):
            raise InvalidInput(
                f"start: expected none with a {type(course).__name__}, which has its own"
            )
        from stancekit.planners.problem.course_between import laid_between  # loads scipy's graphs

        if isinstance(standing, str | Path):
            standing = StandingMap.read(standing)
        if standing is not None:
            _check_map(standing, course)
        return laid_between(course, start, goal, robot=who, frames=frames, standing=standing)
    if isinstance(course, Footholds):
        raise InvalidInput("start, goal: expected both with a terrain, got none")
    if standing is not None:
        raise InvalidInput("standing: expected a start and a goal over a terrain with it, got none")
    if isinstance(course, Problem):
        course.check_whole()
        return _of_problem(course, frames, robot)
    return _of_file(str(course), frames, who)


def _of_problem(course: Problem, frames: int | None, robot: Robot | str | Path | None) -> Problem:
    """A course as it is; of one posture, that of the robot whose limbs stand."""
    if course.is_posture:
        if robot is None:
            course = course.course()
        else:
            from stancekit.planners.robot.robot_file import robot_of  # reads files

            course, robot = course.course(robot=robot_of(robot)), None
    if robot is not None:
        raise InvalidInput(
            "robot: expected none with a course that is laid out, got "
            f"{robot.name if isinstance(robot, Robot) else robot}"
        )
    if frames not in (None, course.frames):
        raise InvalidInput(
            f"frames: expected none with a course that is laid out, of {course.frames}, got "
            f"{frames}"
        )
    return course


def _of_file(name: str, frames: int | None, robot: Robot | str | None) -> Problem | LayOut:
    """The generator of the course of a file or a name; of a file of JSON, whose candidates are
    fixed, the course.
    """
    if is_leap_file(name):
        raise InvalidInput(f"{name}: expected a course, got a leap: plan(load({name!r}))")
    if Path(name).suffix.lower() in SUFFIXES:
        raise InvalidInput(f"start, goal: expected both with the terrain {name}, got none")
    if Path(name).suffix in (".json", ".jsonl"):
        return read_course(name, frames, robot)

    def laid_out(sets: Sets, alternative: Alternative = AS_ASKED) -> Problem:
        return read_course(name, frames, robot, sets, alternative=alternative)

    return laid_out


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
