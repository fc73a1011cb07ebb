"""What ``stancekit plan`` writes and says of a crossing: climbs and leaps one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from stancekit.planners.answer.leap_plan import LeapPlan

from .console import complain, counted, emit, out, progress

if TYPE_CHECKING:
    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.crossing import Crossing

    from .plan import PlanCourse


def report_crossing(asked: PlanCourse, outcome: Answer[Crossing]) -> int:
    """Write the files that were asked for, and say what there is; the exit code."""
    crossing, report = outcome.solution, outcome.report
    assert crossing is not None
    assert report is not None
    written = _write(asked, crossing)
    if asked.json:
        emit(_record(outcome, crossing))
    else:
        for line in _lines(outcome, crossing):
            out.print(line, highlight=False)
        refused = "" if report.accepted else ", of a crossing that the verifier refuses"
        for path in written:
            out.print(f"wrote {path}{refused}", highlight=False)
    if not report.accepted:
        complain(f"stancekit: no plan: {crossing.name}: {outcome.message}")
    return int(not report.accepted)


def _write(asked: PlanCourse, crossing: Crossing) -> list[Any]:
    """Write the files; their names."""
    written = list[Any]()
    if asked.out is not None:
        from stancekit.planners.formats.crossing_file import write_crossing

        with progress(f"write {asked.out}"):
            write_crossing(asked.out, crossing)
        written.append(asked.out)
    if asked.proof is not None and crossing.certificate is not None:
        from stancekit.planners.formats.proof_file import write_proof

        write_proof(asked.proof, crossing.certificate)
        written.append(asked.proof)
    if asked.picture is not None:
        from stancekit.views.crossings import draw_crossing
        from stancekit.views.sheet import save

        save(draw_crossing(crossing), asked.picture)
        written.append(asked.picture)
    if asked.video is not None:
        from stancekit.views.crossings import FPS, crossing_frames
        from stancekit.views.video import write_video

        frames, total = crossing_frames(crossing)
        write_video(asked.video, counted(frames, total, f"film {asked.video}"), fps=FPS)
        written.append(asked.video)
    if asked.html is not None:
        from stancekit.views.crossings import CrossingView
        from stancekit.views.page import write_page

        write_page(asked.html, CrossingView(crossing).film(fps=10.0))
        written.append(asked.html)
    return written


def _lines(outcome: Answer[Crossing], crossing: Crossing) -> Iterator[str]:
    """Lines about a crossing."""
    assert outcome.report is not None
    yield f"{crossing.name}: {outcome.status.value}, with leaps, {outcome.effort.seconds:.1f} s"
    yield f"key frames alone: {crossing.refusal}"
    if crossing.certificate is not None:
        from stancekit.planners.verify import explain

        yield f"  proved, straight ahead: {explain(crossing.certificate).message}"
    for k, part in enumerate(crossing.parts, 1):
        first, last = (part.com_m[i] for i in (0, -1))
        way = f"from ({first[0]:.2f}, {first[1]:.2f}) to ({last[0]:.2f}, {last[1]:.2f})"
        if isinstance(part, LeapPlan):
            phases = part.problem.timings_s[part.timing]
            yield f"{k}: leap {way}, phases of {', '.join(f'{s:.2f}' for s in phases)} s"
        else:
            yield f"{k}: climb {way}, {part.problem.frames} key frames"
    yield f"verifier: {outcome.report.message}"


def _record(outcome: Answer[Crossing], crossing: Crossing) -> dict[str, Any]:
    """Everything as one JSON object."""
    assert outcome.report is not None
    return {
        "course": crossing.name,
        "planner": outcome.method,
        "status": outcome.status.value,
        "seconds": outcome.effort.seconds,
        "solves": outcome.effort.solves,
        "message": outcome.message,
        "refusal": crossing.refusal,
        "proved": crossing.certificate is not None,
        "parts": ["leap" if isinstance(part, LeapPlan) else "climb" for part in crossing.parts],
        "verdict": outcome.report.to_json(),
    }
