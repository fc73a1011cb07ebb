"""Pictures and films of problems, answers and motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from matplotlib.figure import Figure

from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.crossing import Crossing
from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.verify import explain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.runner.execution import Execution
from stancekit.views.crossings import draw_crossing
from stancekit.views.gaits import draw_motion, motion_frames
from stancekit.views.leaps import draw_leap
from stancekit.views.plans import draw_plan
from stancekit.views.postures import draw_posture
from stancekit.views.sheet import save
from stancekit.views.video import Frame

WALK_FPS = 25.0
"""Frames a second of a walk that was planned."""


@checked
def draw(
    subject: Problem | Plan | LeapPlan | Crossing | Trajectory,
    answer: Plan | Certificate | None = None,
    *,
    envelope: Envelope | None = None,
    caption: str = "",
    out: str | Path | None = None,
) -> Figure:
    """Draw a posture problem, a plan of key frames, a leap, a crossing or a walk: terrain,
    robot, forces in their cones.

    Arguments:
        subject: the posture problem, plan, leap, crossing or walk.
        answer: plan for a posture problem; without one the body is shown at the nominal centre of
            mass. Or its certificate; the picture then names the cheapest single change.
        envelope: box to draw with a posture problem or its plan.
        caption: title, in place of the usual one.
        out: a picture to write: .png, .pdf or .svg.

    Returns:
        The matplotlib figure.

    Raises:
        InvalidInput: for another kind of thing, for an answer or an envelope of other contacts or
            of no posture problem, and for a file that cannot be written.
    Source:
        Lin et al. Fig. 2 (a scene); Pan et al. Fig. 3 (a walk).

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> figure = stancekit.draw(stancekit.solve(problem).solution, caption="three limbs")
        >>> type(figure).__name__
        'Figure'
    """
    if isinstance(subject, Problem) and not subject.is_posture:
        raise InvalidInput(
            f"draw: expected a posture problem, got the course {subject.name}: draw its plan"
        )
    if isinstance(subject, Plan) and answer is None and subject.problem.is_posture:
        return draw(subject.problem, subject, envelope=envelope, caption=caption, out=out)
    if not isinstance(subject, Problem) and (answer is not None or envelope is not None):
        raise InvalidInput(
            f"draw: expected no answer and no envelope with a {type(subject).__name__}"
        )
    match subject:
        case Problem():
            posture = answer if isinstance(answer, Plan) else None
            why = explain(answer.of(subject)).message if isinstance(answer, Certificate) else ""
            figure = draw_posture(subject, posture, envelope=envelope, caption=caption, why=why)
        case Plan():
            figure = draw_plan(subject, caption=caption)
        case LeapPlan():
            figure = draw_leap(subject, caption=caption)
        case Crossing():
            figure = draw_crossing(subject, caption=caption)
        case Trajectory():
            figure = draw_motion(subject, check_trajectory(subject), caption=caption)
    if out is not None:
        save(figure, out)
    return figure


@checked
def film(
    motion: Plan | LeapPlan | Crossing | Trajectory,
    out: str | Path,
    executed: Execution | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film of a plan, a leap, a crossing or a walk: as it was planned, or as a simulation executed it.

    Arguments:
        motion: the motion to show.
        out: the film, .mp4 (extra film, and a GL library).
        executed: ``execution`` of the report of ``simulate`` or ``run``: the robot's own links as
            they moved, and the forces that its feet felt.
        progress: called with frames drawn, and all.

    Returns:
        None.

    Raises:
        InvalidInput: for a file that cannot be written, and where the film's encoder or GL is
            missing.
    Source:
        None: the motion as it is planned or measured.

    Example:
        >>> import stancekit
        >>> stancekit.film(stancekit.plan("walls", frames=2).solution, "plan.mp4")  # doctest: +SKIP
    """
    from stancekit.views.film import check_film
    from stancekit.views.video import write_video

    if isinstance(motion, Plan) and motion.problem.is_posture:
        raise InvalidInput(
            "film: expected something that moves, got the plan of a posture problem: draw it"
        )
    path = Path(out)
    check_film(path)
    frames, total, fps = frames_of(motion, executed)
    write_video(path, counted(frames, total, progress), fps)


def frames_of(
    motion: Plan | LeapPlan | Crossing | Trajectory, executed: Execution | None
) -> tuple[Iterator[Frame], int, float]:
    """The frames of a film, how many, and how many a second."""
    from stancekit.views import crossings, executions, leaps, plans

    if isinstance(motion, Crossing) or (isinstance(motion, LeapPlan) and executed is not None):
        return *crossings.crossing_frames(motion, executed), crossings.FPS
    if isinstance(motion, LeapPlan):
        return leaps.leap_frames(motion), len(leaps.film_times(motion)), leaps.FPS
    if isinstance(motion, Plan):
        if executed is None:
            return plans.plan_frames(motion), plans.frame_count(motion), plans.FPS
        return (
            executions.execution_frames(motion, executed),
            executions.frame_count(executed),
            executions.FPS,
        )
    if executed is None:
        frames = motion_frames(motion, check_trajectory(motion), fps=WALK_FPS)
        return frames, round(WALK_FPS * motion.duration_s), WALK_FPS
    count = round(executions.WALK_FPS * motion.duration_s)
    return executions.walk_frames(motion, executed), count, executions.WALK_FPS


def counted(
    frames: Iterator[Frame], total: int, progress: Callable[[int, int], None] | None
) -> Iterator[Frame]:
    """The frames, of which ``progress`` is told one by one."""
    for done, frame in enumerate(frames, start=1):
        yield frame
        if progress is not None:
            progress(done, total)
