"""Pictures of problems and answers."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from stancekit.planners.answer.outcome import Certificate, Posture
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import PostureProblem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.verify import explain
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.views.gaits import draw_motion
from stancekit.views.plans import draw_plan
from stancekit.views.postures import draw_posture
from stancekit.views.sheet import save


@checked
def draw(
    subject: PostureProblem | Plan | Trajectory,
    answer: Posture | Certificate | None = None,
    *,
    envelope: Envelope | None = None,
    caption: str = "",
    out: str | Path | None = None,
) -> Figure:
    """Draw a posture problem, a plan of key frames or a walk: terrain by friction, robot, forces in their cones.

    Arguments:
        subject: what to draw.
        answer: of a posture problem, its posture; without one the body is shown at the nominal centre of mass. Or its
            certificate, of which the picture says what the cheapest single change is.
        envelope: of a posture problem, a box to draw with it.
        caption: title, where not the usual one.
        out: a picture to write: .png, .pdf or .svg.
    Returns:
        The matplotlib figure.
    Raises:
        InvalidInput: for another kind of thing, for an answer or an envelope of other contacts or of no posture
            problem, and for a file that cannot be written.
    Source:
        Paper E Fig. 2 (a scene); paper W Fig. 3 (a walk).
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> figure = stancekit.draw(problem, stancekit.solve(problem).posture, caption="three limbs")
        >>> type(figure).__name__
        'Figure'
    """
    if not isinstance(subject, PostureProblem) and (answer is not None or envelope is not None):
        raise InvalidInput(f"draw: expected no answer and no envelope with a {type(subject).__name__}")
    match subject:
        case PostureProblem():
            posture = answer if isinstance(answer, Posture) else None
            why = explain(subject, answer).message if isinstance(answer, Certificate) else ""
            figure = draw_posture(subject, posture, envelope=envelope, caption=caption, why=why)
        case Plan():
            figure = draw_plan(subject, caption=caption)
        case Trajectory():
            figure = draw_motion(subject, check_trajectory(subject), caption=caption)
    if out is not None:
        save(figure, out)
    return figure
