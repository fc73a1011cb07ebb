"""Plan and judge the file of a leap, for ``stancekit plan`` and ``stancekit verify``."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any, cast

from stancekit.planners.answer.hindrance import LEAP_BODY
from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, counted, emit, out, progress
from .options import check_drawn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.leap_plan import LeapPlan
    from stancekit.planners.problem.leap import Leap

    from .plan import PlanCourse

USES = (
    "course",
    "planner",
    "policy",
    "robot",
    "reserve",
    "time_limit_s",
    "out",
    "proof",
    "picture",
    "video",
    "html",
    "json",
)
"""Options of ``stancekit plan`` that a leap has a use for; any other is refused."""


def plan_leap(asked: PlanCourse) -> int:
    """Plan the leap of a file; exit code 1 without a plan.

    Raises InvalidInput for options that it has no use for.
    """
    from stancekit.courses import plan
    from stancekit.planners.answer.answer import Status
    from stancekit.planners.formats.leap_file import read_leap, write_leap

    method = _method(asked)
    with as_options("robot"):
        leap = read_leap(asked.course, asked.robot).leap
    with progress(f"plan {leap.name} by {method.order}"):
        outcome = plan(leap, method, time_limit_s=asked.time_limit_s)
    if asked.out is not None and outcome.solution is not None:
        write_leap(asked.out, outcome.solution.problem, outcome.solution)
    if asked.proof is not None and outcome.certificate is not None:
        write_leap(asked.proof, leap, None, outcome.certificate)
    reason = _reason(outcome)
    if asked.json:
        emit(_record(leap, outcome, reason))
    else:
        out.print(
            f"{leap.name}: {outcome.status.value}, {outcome.effort.tries} tries, {outcome.effort.solves} solves, "
            f"{1e3 * outcome.effort.seconds:.0f} ms",
            highlight=False,
        )
        if outcome.solution is not None and outcome.report is not None:
            out.print(f"verifier: {outcome.report.message}", highlight=False)
            if outcome.solution.problem.robot.source.own:
                for line in _body_lines(outcome, leap):
                    out.print(line, highlight=False)
    if outcome.solution is not None:
        _draw(asked, outcome.solution)
    pictures = [(path, outcome.solution) for path in (asked.picture, asked.video, asked.html)]
    for path, there in (
        (asked.out, outcome.solution),
        (asked.proof, outcome.certificate),
        *pictures,
    ):
        if path is not None:
            complain(
                f"wrote {path}"
                if there is not None
                else f"{path}: not written, since there is none"
            )
    if outcome.status is not Status.FEASIBLE:
        complain(f"stancekit: no plan: {leap.name}: {reason}")
    return int(outcome.status is not Status.FEASIBLE)


def _body_lines(outcome: Answer[LeapPlan], asked: Leap) -> Iterator[str]:
    """Lines about the robot's own body: each group with what it was before bending, and what was
    bent.
    """
    assert outcome.report is not None
    assert outcome.solution is not None
    for group in outcome.report.groups:
        if group.name not in LEAP_BODY:
            continue
        before = outcome.details.get(f"{group.name}_before")
        was = "" if before is None else f", before bending {before:.3g}"
        where = (
            f" ({group.where}, {group.when:.2f} s)"
            if group.where and group.when is not None
            else ""
        )
        unit = "" if group.unit == "1" else f" {group.unit}"
        sentence = (
            group.message
            if group.verdict == "not checked"
            else (f"{group.value:.3g} of {group.limit:g}{unit}{where}{was}")
        )
        yield f"{group.name}: {group.verdict}: {sentence}"
    yield "torque: effort and velocity of the robot's file with a line between them; no motor is looked up"
    plan = outcome.solution
    timing, timings = plan.problem.timings_s[plan.timing], asked.timings_s
    if timing not in timings:
        yield f"bent: phases of {', '.join(f'{s:.2f}' for s in timing)} s"


def _draw(asked: PlanCourse, plan: LeapPlan) -> None:
    """Write the picture, the film and the page that were asked for."""
    if asked.picture is not None:
        from stancekit.views.leaps import draw_leap
        from stancekit.views.sheet import save

        save(draw_leap(plan), asked.picture)
    if asked.video is not None:
        from stancekit.views.leaps import FPS, film_times, leap_frames
        from stancekit.views.video import write_video

        write_video(
            asked.video,
            counted(leap_frames(plan), len(film_times(plan)), f"film {asked.video}"),
            fps=FPS,
        )
    if asked.html is not None:
        from stancekit.views.leaps import LeapView
        from stancekit.views.page import write_page

        write_page(asked.html, LeapView(plan).film())


def _method(asked: PlanCourse) -> Any:
    """The finder that the options ask for.

    Raises InvalidInput.
    """
    from typing import get_args

    from stancekit.planners.files.writing import check_writable
    from stancekit.planners.leap.finder import LeapFinder, Order
    from stancekit.planners.leap.rule import Rule, Scorer

    _check_unused(asked)
    orders = get_args(Order)
    if asked.planner not in ("two-stage", *orders):
        raise InvalidInput(
            f"--planner: expected one of {', '.join(orders)} with a leap, got {asked.planner}"
        )
    for path in (asked.out, asked.proof):
        if path is not None:
            check_writable(path)
            if path.suffix != ".json":
                raise InvalidInput(f"{path}: expected a file whose name ends with .json")
    check_drawn(asked.picture, asked.video, asked.html)
    order: Any = "finder" if asked.planner == "two-stage" else asked.planner
    rule: Scorer = Rule()
    if asked.policy is not None:
        if order == "random":
            raise InvalidInput("--policy: expected none with --planner random, which has no scores")
        from stancekit.learners.leaps.scorer import LeapScorer

        rule = LeapScorer.read(asked.policy)
    return LeapFinder(order=order, rule=rule, share=0.8 if asked.reserve else 1.0)


def _check_unused(asked: PlanCourse) -> None:
    """Raise InvalidInput for an option that was given and that a leap has no use for."""
    between = asked.between
    for of in (asked, between, between.file, between.footholds):
        plain: Any = type(asked)(course="") if of is asked else cast(Any, type(of))()
        for name, value in vars(plain).items():
            if (of is asked and name in USES) or is_dataclass(value) or getattr(of, name) == value:
                continue
            option = name.replace("_", "-")
            raise InvalidInput(f"--{option}: expected none with a leap, got {getattr(of, name)}")


def _reason(outcome: Answer[LeapPlan]) -> str:
    """The reason why there is no plan; empty if there is one."""
    from stancekit.planners.verify import explain

    if outcome.certificate is None or outcome.problem is None:
        return outcome.message
    return explain(outcome.certificate).message


def _record(leap: Leap, outcome: Answer[LeapPlan], reason: str) -> dict[str, Any]:
    """Everything as one JSON object."""
    from stancekit.planners.formats.leap_file import plan_to_json

    record: dict[str, Any] = {
        "leap": leap.name,
        "planner": outcome.method,
        "status": outcome.status.value,
        "tries": outcome.effort.tries,
        "solves": outcome.effort.solves,
        "seconds": outcome.effort.seconds,
        "message": reason,
    }
    if outcome.solution is not None and outcome.report is not None:
        record["verdict"] = outcome.report.to_json()
        record["plan"] = plan_to_json(outcome.solution)
    if outcome.certificate is not None:
        record["leaves"] = len(outcome.certificate.multipliers)
    return record
