"""Courses: plan key frames over them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Literal

from stancekit.planners.answer.plan_outcome import PlanOutcome
from stancekit.planners.arguments import checked
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked as checked_number
from stancekit.planners.problem import PostureProblem
from stancekit.planners.problem.course import Course
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.project import Projection
from stancekit.planners.projection.whole_body_limits import WholeBodyLimits
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.search.answer import CoursePlanner
from stancekit.planners.search.methods import PlannerOptions, Relaxation, course_through_verifier, make_course_planner
from stancekit.planners.search.plan_course import ALL_FRICTION, LayOut, plan_course


@checked
def plan(
    course: Course | PostureProblem | str | Path,
    planner: str | CoursePlanner = "two-stage",
    *,
    frames: int | None = None,
    robot: str | Path | None = None,
    reserve: bool = True,
    relaxation: Relaxation | None = None,
    envelopes: EnvelopeSet | Modes | None = None,
    projection: Projection | None = None,
    torque_nm: float | None = None,
    torque_share: float = 0.9,
    clearance_m: float = 0.005,
    time_limit_s: float = 60.0,
    engine: Literal["rows", "cvxpy"] = "rows",
) -> PlanOutcome:
    """Plan the key frames of a climb: where every toe goes, where the body is, and what every limb carries.

    Arguments:
        course: a ``Course``, a built-in one by name ("stairs", "walls", "icy-walls", "tube", "ground-to-wall"), or a
            YAML or JSON file; one posture problem is a course of one frame.
        planner: "two-stage" (relaxation and projection), "exact" (to the best plan; short courses), "micp", "nlp",
            "decoupled" (a baseline that fails on ice). Or a planner that was made before, the name of one that a
            package registered under ``stancekit.course_planners``, or "FILE.py:NAME".
        frames: number of key frames M, where not the course's own; of a name or a YAML file only.
        robot: in place of the course's: a built-in one, or a ``.urdf`` or ``.yaml`` file (extra kin); of a name or a
            YAML file only.
        reserve: plan with 80 % of the friction where that has a plan, else 90 %, else all of it; two-stage only.
        relaxation, envelopes: first stage of two-stage: the lift, or learned boxes, or modes that it switches between.
        projection: second stage of two-stage and micp: "scp" (where None), "fix-p", "fix-toes", "fix-f", "nlp", the
            name of one that a package registered under ``stancekit.projections``, or "FILE.py:NAME".
        torque_nm: no joint is to take more, whatever it has [Nm]; None: what the robot's own file says, if it has one.
        torque_share: a plan that asks for more torque than there is is bent until this share of it is enough.
        clearance_m: where links go through each other or the terrain, at key frames or between them, a plan is bent
            until they are so far apart [m].
        time_limit_s: for all of it, bending and judging included; what is not decided by then is undecided, and what
            there is so far is in the outcome [s]. A planner that was made before keeps to its own limit, too.
        engine: "rows", written for speed, or "cvxpy", the same programs as the paper has them.
    Returns:
        A ``PlanOutcome``: feasible with a ``plan`` that the verifier accepted in every stance and between them, as far
        as its ``report`` says that it was checked; infeasible with a certificate, over the outer sets of a robot's own
        legs, for the course in ``problem``; or undecided, also with a plan whose joints cannot do it, whose bodies
        collide, or that was not judged in time. ``bound`` is a proved lower bound on the objective of any plan.
    Raises:
        InvalidInput: for a course or a robot that is none, an unknown planner, or envelopes that are missing or have
            no use.
    Source:
        Paper E §IV-B, E11, E1-E10 in every stance.
    Example:
        >>> import stancekit
        >>> outcome = stancekit.plan("stairs", frames=4)
        >>> outcome.status.value, outcome.plan.com_m.shape
        ('feasible', (4, 3))
    """
    deadline = time.perf_counter() + checked_number(time_limit_s, "time_limit_s", least=0.0)
    if isinstance(course, PostureProblem):
        course = Course.of_posture(course)
    question: Course | LayOut
    if not isinstance(course, Course):
        question = _question(str(course), frames, None if robot is None else str(robot))
    elif robot is not None:
        raise InvalidInput(f"robot: expected none with a course that is laid out, got {robot}")
    elif frames not in (None, course.frames):
        raise InvalidInput(f"frames: expected none with a course that is laid out, of {course.frames}, got {frames}")
    else:
        question = course
    limits = WholeBodyLimits(torque_nm=torque_nm, share=torque_share, clearance_m=clearance_m)
    chosen = planner
    options = PlannerOptions(relaxation=relaxation, envelopes=envelopes, projection=projection)
    if isinstance(chosen, str):
        programs = Programs(engine=engine)
        chosen = make_course_planner(chosen, replace(options, time_limit_s=time_limit_s, programs=programs))
    else:
        options.check_used("a planner that was made before", ())
        chosen = course_through_verifier(chosen)
    shares = None if reserve else ALL_FRICTION
    return plan_course(question, chosen, shares=shares, limits=limits, deadline=deadline)


def _question(name: str, frames: int | None, robot: str | None) -> Course | LayOut:
    """The course of a name or a file: what lays it out, but of JSON, whose candidates are fixed, the course."""
    if Path(name).suffix == ".json":
        return read_course(name, frames, robot)
    return lambda sets: read_course(name, frames, robot, sets)
