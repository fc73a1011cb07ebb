"""Plan the file of a leap, for ``stancekit plan``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stancekit.planners.answer.hindrance import LEAP_BODY
from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, emit, out, progress
from .pictures import show

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.leap_plan import LeapPlan
    from stancekit.planners.leap.finder import LeapFinder
    from stancekit.planners.problem.leap import Leap


def plan_leap(
    name: str,
    robot: str | None,
    method: LeapFinder,
    *,
    time_limit_s: float,
    out_file: Path | None,
    proof: Path | None,
    pictures: tuple[Path | None, Path | None, Path | None],
    json: bool,
) -> int:
    """Plan a leap, write and print the answer; exit code 1 without a plan.

    Raises InvalidInput.

    Arguments:
        name: its file, or its class and seed.
        robot: in place of its own.
        pictures: files of a picture, a film and a page.
    """
    from stancekit.courses import plan
    from stancekit.planners.answer.answer import Status
    from stancekit.planners.formats.leap_file import read_leap, write_leap

    with as_options("robot"):
        leap = read_leap(name, robot).leap
    with progress(f"plan {leap.name} by {method.order}"):
        outcome = plan(leap, method, time_limit_s=time_limit_s)
    if out_file is not None and outcome.solution is not None:
        write_leap(out_file, outcome.solution.problem, outcome.solution)
    if proof is not None and outcome.certificate is not None:
        write_leap(proof, leap, None, outcome.certificate)
    reason = _reason(outcome)
    if json:
        emit(_record(leap, outcome, reason))
    else:
        out.print(
            f"{leap.name}: {outcome.status.value}, {outcome.effort.tries} tries, "
            f"{outcome.effort.solves} solves, "
            f"{1e3 * outcome.effort.seconds:.0f} ms",
            highlight=False,
        )
        if outcome.solution is not None and outcome.report is not None:
            out.print(f"verifier: {outcome.report.message}", highlight=False)
            if outcome.solution.problem.robot.source.own:
                for line in _body_lines(outcome, leap):
                    out.print(line, highlight=False)
    if outcome.solution is not None:
        picture, video, html = pictures
        show(outcome.solution, picture=picture, video=video, html=html)
    for path, there in (
        (out_file, outcome.solution),
        (proof, outcome.certificate),
        *((path, outcome.solution) for path in pictures),
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


def leap_finder(planner: str, policy: Path | None, *, reserve: bool) -> LeapFinder:
    """The finder that the options of ``stancekit plan`` ask for.

    Raises InvalidInput.
    """
    from typing import get_args

    from stancekit.planners.leap.finder import LeapFinder, Order
    from stancekit.planners.leap.rule import Rule, Scorer

    orders = get_args(Order)
    if planner not in ("two-stage", *orders):
        raise InvalidInput(
            f"--planner: expected one of {', '.join(orders)} with a leap, got {planner}"
        )
    order: Any = "finder" if planner == "two-stage" else planner
    rule: Scorer = Rule()
    if policy is not None:
        if order == "random":
            raise InvalidInput("--policy: expected none with --planner random, which has no scores")
        from stancekit.learners.leaps.scorer import LeapScorer

        rule = LeapScorer.read(policy)
    return LeapFinder(order=order, rule=rule, share=0.8 if reserve else 1.0)


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
