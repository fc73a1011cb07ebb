"""Files and words of ``stancekit plan``: of key frames, of a leap, and of a crossing, which has
both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from rich.table import Table
from rich.text import Text

from .console import complain, emit, out, progress
from .pictures import show

if TYPE_CHECKING:
    from pathlib import Path

    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.crossing import Crossing
    from stancekit.planners.answer.leap_plan import LeapPlan
    from stancekit.planners.answer.plan import Plan
    from stancekit.planners.problem import Problem
    from stancekit.planners.problem.leap import Leap


def deliver(
    answer: Answer[Plan] | Answer[LeapPlan] | Answer[Crossing],
    *,
    plan_file: Path | None,
    proof: Path | None,
    pictures: Mapping[str, Path | None],
    json: bool,
    time_limit_s: float,
) -> int:
    """Write the files that were asked for, and say what there is; exit code 1 without a plan.

    Arguments:
        pictures: the files of ``show``, by its names.
        time_limit_s: the limit that there was [s].
    """
    solution, report = answer.solution, answer.report
    accepted = answer.status.value == "feasible" and report is not None and report.accepted
    name, reason = _name_of(answer), _reason_of(answer)
    written = _write(answer, plan_file, proof, pictures)
    if json:
        emit({**_record(answer, reason), "files": [str(path) for path in written]})
    else:
        out.print(_table_of(answer))
        if solution is not None and report is not None:
            for line in (*_lines(answer), *_doubts(answer, time_limit_s)):
                out.print(line, highlight=False)
        refused = (
            "" if report is None or report.accepted else ", of a plan that the verifier refuses"
        )
        for path in written:
            out.print(f"wrote {path}{'' if path == proof else refused}", highlight=False)
    if not accepted:
        complain(f"stancekit: no plan: {name}: {reason or answer.claim or answer.status.value}")
    if proof is not None and proof not in written:
        complain(f"{proof}: not written, since nothing is proved")
    return int(not accepted)


def _write(
    answer: Answer[Any], plan_file: Path | None, proof: Path | None, pictures: Mapping[str, Any]
) -> list[Path]:
    """Write the files; their names."""
    written: list[Path] = []
    if plan_file is None and proof is None and not any(pictures.values()):
        return written
    from stancekit.files import save

    if plan_file is not None and answer.solution is not None and answer.report is not None:
        with progress(f"write {plan_file}"):
            save(answer, plan_file)
        written.append(plan_file)
    certificate = answer.certificate or getattr(answer.solution, "certificate", None)
    if proof is not None and certificate is not None:
        save(certificate, proof)
        written.append(proof)
    if answer.solution is not None and answer.report is not None:
        written += show(answer.solution, **pictures)
    return written


def _name_of(answer: Answer[Any]) -> str:
    """The name of the course, or of the leap."""
    return str(getattr(answer.solution, "name", "") or cast("Problem | Leap", answer.problem).name)


def _table_of(answer: Answer[Any]) -> Table:
    """One row: what was planned, how, and what came of it."""
    table = Table(box=None, header_style="bold")
    for column in (
        "course",
        "planner",
        "frames",
        "status",
        "objective",
        "bound",
        "compile",
        "solve",
    ):
        left = column in ("course", "planner", "status")
        table.add_column(
            column, justify="left" if left else "right", overflow="fold", no_wrap=column != "course"
        )
    status = answer.status.value
    colour = {"feasible": "green", "infeasible": "red", "undecided": "yellow"}[status]
    frames = _frames(answer)
    table.add_row(
        _name_of(answer),
        answer.method,
        "–" if frames is None else str(frames),
        Text(status, style=colour),
        _number(answer.objective),
        _number(answer.bound),
        f"{answer.effort.compile_s:.2f} s",
        f"{answer.effort.seconds:.3f} s",
    )
    return table


def _reason_of(answer: Answer[Any]) -> str:
    """The planner's message; of what is refuted, the reason that the proof gives, and the sets it
    is over.
    """
    if answer.certificate is None or answer.problem is None or answer.status.value != "infeasible":
        return answer.message
    from stancekit.planners.verify import explain

    reason = explain(answer.certificate).message
    return (
        reason
        if answer.sets is None
        else f"{reason}; proved over the {answer.sets} sets of its legs"
    )


def _row(numbers: Sequence[int]) -> str:
    """Whole numbers with spaces between them."""
    return " ".join(str(number) for number in numbers)


def _number(value: float) -> str:
    """Four digits, or a dash."""
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _bent_lines(details: Mapping[str, float]) -> Iterator[str]:
    """Lines on how planning with the whole body changed the largest torque and the deepest
    collision, and on what a larger torque is for; nothing where it had nothing to do.
    """
    steps = int(details.get("torque_steps", 0.0))
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    torque, share, depth = (
        _change(details, name) for name in ("torque_nm", "torque_share", "depth_m")
    )
    if torque[0] != torque[1] and math.isfinite(torque[1]):
        why = ""
        if torque[1] > torque[0]:
            eased = (
                f"where the joint nearest to its limit needs {share[0]:.0%} → {share[1]:.0%} of it"
            )
            why = f", {eased}" if share[1] < share[0] else ", the price of bodies that keep apart"
        figures = [f"{each:.1f}" for each in torque]
        if figures[0] != figures[1]:
            yield f"torque: {figures[0]} → {figures[1]} Nm {how}{why}"
    if depth[0] != depth[1] and math.isfinite(depth[1]):
        yield f"deepest collision: {1e3 * depth[0]:.1f} → {1e3 * depth[1]:.1f} mm {how}"


def _change(details: Mapping[str, float], name: str) -> tuple[float, float]:
    """A figure before and after; nan where it is not known."""
    return details.get(f"{name}_before", math.nan), details.get(name, math.nan)


def _frames(answer: Answer[Any]) -> int | None:
    """The number of key frames; None of a leap, and of a crossing, whose parts have their own."""
    from stancekit.planners.answer.crossing import Crossing

    crosses = isinstance(answer.solution, Crossing)
    return None if crosses else getattr(answer.problem, "frames", None)


def _lines(answer: Answer[Any]) -> Iterator[str]:
    """Lines about what was found, below its table."""
    from stancekit.planners.answer.crossing import Crossing
    from stancekit.planners.answer.leap_plan import LeapPlan

    solution = answer.solution
    if isinstance(solution, Crossing):
        yield from _crossing_lines(answer, solution)
    elif isinstance(solution, LeapPlan):
        yield from _leap_lines(answer, solution)
    elif solution is not None:
        yield from _course_lines(answer, solution)


def _course_lines(answer: Answer[Plan], plan: Plan) -> Iterator[str]:
    report = answer.report
    assert report is not None
    share = plan.provenance.get("friction_share", 1.0)
    if share != 1.0:
        yield f"planned with {100 * share:.0f} % of the friction"
    if press := plan.provenance.get("press_share"):
        yield f"every foot that carries presses with {100 * press:.0f} % of the weight or more"
    if (wrench := plan.problem.wrench) is not None:
        force_n, moment_nm = (
            float((part**2).sum(axis=1).max() ** 0.5) for part in (wrench[:, :3], wrench[:, 3:])
        )
        yield f"carries up to {force_n:.3g} N and {moment_nm:.3g} Nm on the body beside its weight"
    if layout := plan.provenance.get("layout"):
        yield f"laid out in another way than asked for, over which no plan was accepted: {layout}"
    goal_mm = 1e3 * report.figures["goal_m"]
    yield f"verifier: {report.message}; the last key frame is {goal_mm:.0f} mm from the goal"
    yield from _bent_lines(answer.details)
    yield report.body_message
    yield report.margin_message
    yield from (f"cannot be run: {line}" for line in plan.problem.robot.source.unrunnable)
    yield from (f"doubt: {line}" for line in plan.problem.robot.source.doubts)
    if plan.modes is not None:
        terrain = (
            "" if plan.problem.modes is None else f"; of the terrain: {_row(plan.problem.modes)}"
        )
        yield f"modes z: {_row(plan.modes.tolist())}{terrain}"


def _leap_lines(answer: Answer[LeapPlan], plan: LeapPlan) -> Iterator[str]:
    """Lines about a leap; of a robot with a body each group with what it was before bending, and
    what was bent.
    """
    from stancekit.planners.answer.hindrance import LEAP_BODY

    report = answer.report
    assert report is not None
    yield f"{answer.effort.tries} tries, {answer.effort.solves} solves"
    yield f"verifier: {report.message}"
    if not plan.problem.robot.source.own:
        return
    for group in report.groups:
        if group.name not in LEAP_BODY:
            continue
        before = answer.details.get(f"{group.name}_before")
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
    timing = plan.problem.timings_s[plan.timing]
    if timing not in cast("Leap", answer.problem).timings_s:
        yield f"bent: phases of {', '.join(f'{s:.2f}' for s in timing)} s"


def _crossing_lines(answer: Answer[Crossing], crossing: Crossing) -> Iterator[str]:
    from stancekit.planners.answer.leap_plan import LeapPlan

    assert answer.report is not None
    yield f"key frames alone: {crossing.refusal}"
    if crossing.certificate is not None:
        from stancekit.planners.verify import explain

        yield f"  proved: {explain(crossing.certificate).message}"
    for k, part in enumerate(crossing.parts, 1):
        first, last = (part.com_m[i] for i in (0, -1))
        way = f"from ({first[0]:.2f}, {first[1]:.2f}) to ({last[0]:.2f}, {last[1]:.2f})"
        if isinstance(part, LeapPlan):
            phases = part.problem.timings_s[part.timing]
            yield f"{k}: leap {way}, phases of {', '.join(f'{s:.2f}' for s in phases)} s"
        else:
            yield f"{k}: climb {way}, {part.problem.frames} key frames"
    yield f"verifier: {answer.report.message}"


def _doubts(answer: Answer[Any], time_limit_s: float) -> Iterator[str]:
    """Lines on why what was found is no plan yet."""
    from stancekit.planners.answer.report import LATE

    if answer.report is not None and answer.report.accepted and answer.status.value == "undecided":
        yield f"not accepted as a plan: {answer.message}"
    if (at := answer.message.find(LATE)) >= 0:
        yield f"{answer.message[at:]}; --time-limit-s sets it, now to {time_limit_s:g} s"


def _record(answer: Answer[Any], reason: str) -> dict[str, Any]:
    """Everything as one JSON object."""
    from stancekit.planners.answer.report import or_null
    from stancekit.planners.verify import explain

    effort = answer.effort
    numbers = {
        "objective": answer.objective,
        "bound": answer.bound,
        "residual": answer.residual,
        "compile_s": effort.compile_s,
        "seconds": effort.seconds,
        "solver_seconds": effort.solver_s,
    }
    record: dict[str, Any] = {
        "course": _name_of(answer),
        "frames": _frames(answer),
        "planner": answer.method,
        "status": answer.status.value,
        **{key: or_null(value) for key, value in numbers.items()},
        "solves": effort.solves,
        "tries": effort.tries,
        "sets": answer.sets,
        "claim": answer.claim,
        "message": reason,
        "details": {key: or_null(float(value)) for key, value in answer.details.items()},
    }
    if answer.certificate is not None:
        record["leaves"] = len(answer.certificate.multipliers)
        record["proof"] = explain(answer.certificate).message
    if answer.solution is not None and answer.report is not None:
        record["verdict"] = answer.report.to_json()
        record |= _solution_record(answer.solution)
    return record


def _solution_record(solution: Plan | LeapPlan | Crossing) -> dict[str, Any]:
    from stancekit.planners.answer.crossing import Crossing
    from stancekit.planners.answer.leap_plan import LeapPlan

    if isinstance(solution, Crossing):
        return {
            "refusal": solution.refusal,
            "proved": solution.certificate is not None,
            "parts": ["leap" if isinstance(part, LeapPlan) else "climb" for part in solution.parts],
        }
    if isinstance(solution, LeapPlan):
        from stancekit.planners.formats.leap_file import plan_to_json

        return {"plan": plan_to_json(solution)}
    from stancekit.planners.answer.report import plan_arrays

    arrays = plan_arrays(solution).items()
    return {
        "plan": {name: None if array is None else array.tolist() for name, array in arrays},
        "cannot_run": list(solution.problem.robot.source.unrunnable),
        "doubts": list(solution.problem.robot.source.doubts),
    }
