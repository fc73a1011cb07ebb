"""Pictures, films and pages of problems, answers and motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from stancekit import Answer, Certificate, Envelope, InvalidInput, Motion, Problem
from stancekit.planners.arguments import came, checked
from stancekit.planners.problem.passage import Passage
from stancekit.planners.verify import explain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.runner.report import Execution
from stancekit.views.film import Frame
from stancekit.views.gaits import GaitView, draw_motion
from stancekit.views.leaps import LeapView, draw_leap
from stancekit.views.plans import (
    PlanView,
    View,
    draw_asked,
    draw_execution,
    draw_plan,
)
from stancekit.views.postures import draw_posture
from stancekit.views.sheet import save


@checked
def draw(
    subject: Problem | Motion[Any] | Certificate | Answer[Any],
    answer: Motion[Problem] | Certificate | None = None,
    *,
    executed: Execution | None = None,
    envelope: Envelope | None = None,
    caption: str = "",
    out: str | Path | None = None,
) -> Figure:
    """Draw a posture problem, a plan of key frames, a leap, a crossing or a walk: terrain,
    robot, forces in their cones, and below a plan the push that it bears and the shares of
    friction cones and joint torques that it uses, along its motion. Or draw why there is none.

    Arguments:
        subject: the posture problem, plan, leap, crossing or walk; an answer, of which the solution
            is drawn; or a certificate, or an answer without a solution: the stance, the limb to
            blame and what it lacks, or the places that nothing is found between.
        answer: plan for a posture problem; without one the body is shown at the nominal centre of
            mass. Or its certificate; the picture then names the cheapest single change.
        executed: ``execution`` of the report of ``simulate`` or ``run``, of a plan, a leap or a
            crossing: the robot as it ended beside the plan, the path that it went, and how far
            from the plan it was, where and when.
        envelope: box to draw with a posture problem or its plan.
        caption: title, in place of the usual one.
        out: a picture to write: .png, .pdf or .svg.

    Returns:
        The matplotlib figure.

    Raises:
        InvalidInput: for another kind of thing, for an answer or an envelope of other contacts or
            of no posture problem, for the execution of a walk, of a posture or of a motion with
            other joints or another number of footholds, and for a file that cannot be written.
    Source:
        Lin et al. Fig. 2 (a scene); Pan et al. Fig. 3 (a walk).

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> figure = stancekit.draw(stancekit.solve(problem).solution, caption="three limbs")
        >>> type(figure).__name__
        'Figure'
    """
    if isinstance(subject, Answer) and subject.solution is not None:
        subject = subject.solution
    if isinstance(subject, Problem) and not subject.is_posture:
        raise InvalidInput(
            f"draw: expected a posture problem, got the course {subject.name}: draw its plan"
        )
    if isinstance(subject, Motion) and answer is None and not subject.problem.counts:
        if executed is not None:
            raise InvalidInput("draw: expected no execution with the plan of a posture problem")
        return draw(subject.problem, subject, envelope=envelope, caption=caption, out=out)
    if not isinstance(subject, Problem) and (answer is not None or envelope is not None):
        raise InvalidInput(
            f"draw: expected no answer and no envelope with a {getattr(subject, 'word', 'proof')}"
        )
    if executed is not None:
        if not isinstance(subject, Motion) or subject.has("times_s"):
            called = getattr(subject, "word", "proof")
            raise InvalidInput(
                f"draw: expected no execution with a {called}: film what was executed"
            )
        _check_executed(subject, executed)
    match subject:
        case Problem():
            posture = None if isinstance(answer, Certificate) else answer
            figure = (
                _draw_why(answer.of(subject), caption, envelope=envelope)
                if isinstance(answer, Certificate)
                else draw_posture(subject, posture, envelope=envelope, caption=caption)
            )
        case Answer() | Certificate():
            figure = _draw_why(subject, caption)
        case _ if subject.has("times_s"):
            figure = draw_motion(subject, check_trajectory(subject), caption=caption)
        case _ if not subject.keyed:
            figure = draw_leap(subject, executed, caption=caption)
        case _ if executed is None:
            figure = draw_plan(subject, caption=caption, strips=True)
        case _:
            figure = draw_execution(subject, executed, caption=caption)
    if out is not None:
        save(figure, out)
    return figure


def _draw_why(subject: Answer[Any] | Certificate, caption: str, **posture: Any) -> Figure:
    """Draw a question that has no answer, and why.

    Raises InvalidInput for one that is neither a posture, nor a course, nor a way between places.
    """
    question = subject.problem
    proof = subject if isinstance(subject, Certificate) else subject.certificate
    if not isinstance(question, Problem | Passage):
        raise InvalidInput(
            f"draw: expected a posture, a course or two places without an answer, got {came(question)}"
        )
    why, lack = getattr(subject, "message", "") or "undecided", None
    if proof is not None:
        found = explain(proof.of(question))
        why, lack = found.message, next(iter(found.relaxations), None)
    if isinstance(question, Problem) and question.is_posture:
        return draw_posture(question, why=why, lack=lack, caption=caption, **posture)
    return draw_asked(question, why, lack, caption=caption)


@checked
def film(
    motion: Motion[Any],
    out: str | Path,
    executed: Execution | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film, or a page to turn and zoom, of a plan, a leap, a crossing or a walk: as it was
    planned, or as a simulation executed it.

    Arguments:
        motion: the motion to show.
        out: the film, .mp4, which needs a GL library, too, or the page, .html (extra viz).
        executed: ``execution`` of the report of ``simulate`` or ``run``: the robot's own links as
            they moved, and the forces that its feet felt.
        progress: called with frames drawn, and all, of a film.

    Returns:
        None.

    Raises:
        InvalidInput: for a file that cannot be written, for the execution of a motion with other
            joints or another number of footholds, and where the film's encoder or GL is missing, or
            the page's viser.
    Source:
        None: the motion as it is planned or measured.

    Example:
        >>> import stancekit
        >>> stancekit.film(stancekit.plan("walls", frames=2).solution, "plan.mp4")  # doctest: +SKIP
    """
    from stancekit.views.film import check_film, write_video
    from stancekit.views.page import PAGES, check_page, write_page

    if not motion.problem.counts:
        raise InvalidInput(
            "film: expected something that moves, got the plan of a posture problem: draw it"
        )
    if executed is not None:
        _check_executed(motion, executed)
    path = Path(out)
    if path.suffix.lower() in PAGES:
        check_page(path)
        write_page(path, view_of(motion, executed).film())
        return
    if path.suffix.lower() != ".mp4":
        raise InvalidInput(
            f"{path}: expected a name that ends in .mp4, or in .html for a page, got "
            f"{path.suffix or 'no suffix'}"
        )
    check_film(path)
    view = view_of(motion, executed)
    moments = view.film()
    frames = _counted(view.frames(moments), len(moments.moments), progress)
    write_video(path, frames, 1.0 / moments.step_s)


def _check_executed(motion: Motion[Any], executed: Execution) -> None:
    """Raise InvalidInput for an execution with another number of joints or footholds; one of another
    motion with the same numbers is not noticed.
    """
    expected, got = [len(motion.robot.joint_names)], [executed.trace.angles_rad.shape[1]]
    if motion.has("choice"):
        expected.append(len(motion.problem.footholds))
        got.append(len(executed.slip_m))
    if expected != got:
        one, other = (
            " and ".join(
                f"{n} {what}" for n, what in zip(counts, ("joints", "footholds"), strict=False)
            )
            for counts in (expected, got)
        )
        raise InvalidInput(f"executed: expected the execution of a motion of {one}, got {other}")


def view_of(motion: Motion[Any], executed: Execution | None = None) -> View:
    """View of a motion, or of its execution."""
    if motion.keyed:
        return PlanView(motion, execution=executed)
    if not motion.has("times_s"):
        return LeapView(motion, execution=executed)
    if executed is None:
        return GaitView(motion, report=check_trajectory(motion))
    return GaitView.of_execution(motion, executed)


def _counted(
    frames: Iterator[Frame], total: int, progress: Callable[[int, int], None] | None
) -> Iterator[Frame]:
    """The frames, of which ``progress`` hears of one by one."""
    for done, frame in enumerate(frames, start=1):
        yield frame
        if progress is not None:
            progress(done, total)
