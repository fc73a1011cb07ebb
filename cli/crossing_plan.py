"""Files and words of ``stancekit plan`` for a crossing: climbs and leaps one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stancekit.planners.answer.leap_plan import LeapPlan

from .console import complain, emit, out, progress
from .pictures import show

if TYPE_CHECKING:
    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.crossing import Crossing


def report_crossing(
    outcome: Answer[Crossing],
    *,
    out_file: Path | None,
    proof: Path | None,
    pictures: tuple[Path | None, Path | None, Path | None],
    json: bool,
) -> int:
    """Write the files that were asked for, and say what there is; the exit code.

    Arguments:
        pictures: files of a picture, a film and a page.
    """
    crossing, report = outcome.solution, outcome.report
    assert crossing is not None
    assert report is not None
    written = _write(crossing, out_file, proof, pictures)
    if json:
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


def _write(
    crossing: Crossing,
    out_file: Path | None,
    proof: Path | None,
    pictures: tuple[Path | None, Path | None, Path | None],
) -> list[Path]:
    """Write the files; their names."""
    picture, video, html = pictures
    written = list[Path]()
    if out_file is not None:
        from stancekit.planners.formats.crossing_file import write_crossing

        with progress(f"write {out_file}"):
            write_crossing(out_file, crossing)
        written.append(out_file)
    if proof is not None and crossing.certificate is not None:
        from stancekit.planners.formats.proof_file import write_proof

        write_proof(proof, crossing.certificate)
        written.append(proof)
    return [*written, *show(crossing, picture=picture, video=video, html=html)]


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
