"""The conditions of Lin et al.'s theorem (§III), asked of boxes on labelled scenes.

    stancekit label wall-3 data/test --seed 51
    python benchmarks/theorem.py --data data/test --envelope box.json [box2.json ...] [--json]

It prints for each condition the share of the scenes that do not break it, with its 95 % interval
(Wilson), and the rows that do.

(1) Every feasible problem has a solution with [p, f] in the box. Decided: by the label's own
    posture, or by halving the box where P1 over a part still has points and P2 finds no posture
    there; P1 without an answer over every part is the proof that there is none.
(2) As printed, the box holds no [p, f] of an infeasible problem without its bilinear constraint
    (P̄). That is more than the theorem needs, which is that P1 has no answer: both are counted.
(3) Whatever P1 admits can be projected. A claim about every point of P1's set, so that only its
    breach can be shown: P1's own answer and some corners of its set are projected, with p kept
    (toes, c and Θ held, forces solved for) and with f kept (all else solved for). Both projections
    are convex, so that a residual they leave is a proof. On feasible problems: an infeasible one
    that P1 admits breaks (3) as it breaks (2).

A set of several boxes meets (1) where one does, and (2) where all do; (3) is asked of the box that
P1 takes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
from _bench import Options, launch, share

from stancekit import selectors
from stancekit.envs.data.dataset import scene_of
from stancekit.envs.scenes import LabelledScene
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.files.arrays import Array
from stancekit.planners.projection.project import SURFACE, project
from stancekit.planners.relaxation.envelope import Envelope, RelaxationAnswer, Relaxed, unit_shares
from stancekit.planners.relaxation.mccormick import Coned, McCormick
from stancekit.planners.relaxation.papers import coupled, mccormick
from stancekit.planners.search.answer import Acceptance, Clock, plan_of

CORNERS = 8
"""Corners of P1's set that are projected, beside its own answer; directions are the same for all."""
PARTS = 600
"""Parts of a box that are looked at before condition (1) is left undecided."""
INSIDE = 1e-6
"""By how much [p, f] may leave a box by the solver's tolerance."""
SOUGHT = ("fix-p", "fix-toes", "scp")
"""Projections by which condition (1) looks for a posture in a part of the box."""
WAYS = {"p": "fix-p", "f": "fix-f"}
"""Projections of condition (3), by the part that they keep."""
TITLES: Mapping[str, str] = {
    "1": "(1) a solution in the box, feasible scenes",
    "2": "(2) no point of P̄ in the box, infeasible scenes",
    "2-p1": "(2) as needed: P1 refuses, infeasible scenes",
    "3-p": "(3) p kept: what P1 admits projects, feasible scenes",
    "3-f": "(3) f kept: what P1 admits projects, feasible scenes",
}
"""Conditions by name, in the order of the table."""
SHOWN = 6
"""Rows that break a condition and are named for people; --json has all."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which scenes, and which boxes."""

    data: Path
    """Data set folder of ``stancekit label``, of rows that no box was learned from."""
    envelope: tuple[Path, ...]
    """Files of fixed boxes."""


def main(arguments: Arguments) -> None:
    """Ask, and print a row per box and condition."""
    rows = selectors.rows_of(arguments.data)
    known = {
        int(number): scene_of(row)
        for number, row in zip(rows.chosen, rows.rows(), strict=True)
        if row.status is not Status.UNDECIDED and not row.trivial
    }
    if not known:
        sys.exit(f"{arguments.data}: expected rows labelled feasible or infeasible, got none")
    for file in arguments.envelope:
        boxes = selectors.selector_for(rows, file, file.stem).envelopes
        boxes.check_fits(next(iter(known.values())).problem)
        for condition, found in conditions(boxes.envelopes, known).items():
            arguments.say(as_row(file.stem, condition, found), _line)


def conditions(
    boxes: Sequence[Envelope], scenes: Mapping[int, LabelledScene]
) -> dict[str, dict[int, bool | None]]:
    """Findings by condition and row: whether it holds, None where the search met its limit."""
    programs = Programs()
    answers: dict[str, dict[int, bool | None]] = {condition: {} for condition in TITLES}
    for row, scene in scenes.items():
        for condition, holds in _asked(programs, boxes, scene):
            answers[condition][row] = holds
    return answers


def as_row(selector: str, condition: str, found: Mapping[int, bool | None]) -> dict[str, Any]:
    """The share of the scenes that do not break a condition, those left open among them."""
    broken = [row for row, holds in found.items() if holds is False]
    undecided = [row for row, holds in found.items() if holds is None]
    return {
        "selector": selector,
        "condition": condition,
        "holds": share(len(found) - len(broken), len(found)),
        "broken": broken,
        "undecided": undecided,
    }


def _line(row: Mapping[str, Any]) -> str:
    broken, more = row["broken"][:SHOWN], len(row["broken"]) - SHOWN
    names = " ".join(map(str, broken)) + (f" and {more} more" if more > 0 else "")
    title, holds = TITLES[row["condition"]], row["holds"]
    open_ = f", {len(row['undecided'])} of them open" if row["undecided"] else ""
    return f"{row['selector']}: {title}: {holds}{open_}" + (f"; broken by {names}" * bool(broken))


def _asked(
    programs: Programs, boxes: Sequence[Envelope], scene: LabelledScene
) -> Iterator[tuple[str, bool | None]]:
    """Findings of a scene: the condition, and whether it holds, None for undecided."""
    scaled = Scaled.of(scene.problem)
    answer = programs.get(McCormick, scaled.layout).solve_any(scaled, boxes)
    admits = None if not answer.known else answer.feasible
    if not scene.feasible:
        yield "2", _apart(scaled, boxes)
        yield "2-p1", None if admits is None else not admits
        return
    yield "1", _met(programs, scene, scaled, boxes)
    if admits:
        points = _points(scaled, boxes[answer.chosen], answer)
        for keeps, way in WAYS.items():
            yield f"3-{keeps}", _projectable(programs, way, scaled, points)


def towards(
    scaled: Scaled, box: Envelope, slope: Array, *, products: bool
) -> tuple[Point | None, bool]:
    """The point that minimises slope · [p, f] over P1, or over P̄ within the box; None where there is
    none; and whether that is known, which it is not where the solver gave up.

    Arguments:
        slope: shape (B, 6).
        products: P1, with the envelope and E9; else with the sides of the box alone.
    """
    plan, found, terms = coupled(scaled, "contact")
    terms |= mccormick(found.parts, box)
    if not products:
        del terms["moment"], terms["envelope"]
    at = cp.hstack([found.position, found.forces])
    problem = cp.Problem(cp.Minimize(cp.sum(cp.multiply(slope, at))), list(terms.values()))
    try:
        problem.solve(solver=cp.CLARABEL, max_threads=1)
    except cp.SolverError:
        return None, False
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
        return None, problem.status in (cp.INFEASIBLE, cp.INFEASIBLE_INACCURATE)
    layout = scaled.layout
    relaxed = Relaxed(
        scaled=scaled,
        com=plan.com.value,
        rotation=plan.rotation.value,
        weights=unit_shares(scaled, plan.weights.value),
        forces=found.forces.value,
        rows=(np.arange(len(layout.contacts[0])), layout.contacts[2]),
    )
    return relaxed.rounded()[1], True


def _apart(scaled: Scaled, boxes: Sequence[Envelope]) -> bool | None:
    """Tell whether no box holds a point of P̄; None where the solver gave up and no box has one."""
    holds: bool | None = True
    for box in boxes:
        point, known = towards(scaled, box, np.zeros_like(box.low), products=False)
        if point is not None:
            return False
        holds = holds if known else None
    return holds


def _points(scaled: Scaled, box: Envelope, answer: RelaxationAnswer) -> list[Point]:
    """P1's own answer, and corners of its set towards random directions in units of the box."""
    directions = np.random.default_rng(0).standard_normal((CORNERS, *box.low.shape))
    widths = np.maximum(box.high - box.low, 1e-6)
    points = [answer.point]
    points += [towards(scaled, box, each / widths, products=True)[0] for each in directions]
    return [point for point in points if point is not None]


def _projectable(
    programs: Programs, way: str, scaled: Scaled, points: Sequence[Point]
) -> bool | None:
    """Tell whether every point projects onto m = p f.

    None where the solver gave up on one and no other fails.
    """
    gap = Acceptance().gap
    holds: bool | None = True
    for point in points:
        left = project(programs, way, scaled, point).residual
        if not np.isfinite(left):
            holds = None
        elif left > gap:
            return False
    return holds


def _met(
    programs: Programs, scene: LabelledScene, scaled: Scaled, boxes: Sequence[Envelope]
) -> bool | None:
    """Tell whether a box holds [p, f] of a posture; None where the search of one met its limit."""
    if scene.posture is not None:
        at = scaled.point(scene.posture)[None]
        if any(box.contains(at, margin=INSIDE)[0] for box in boxes):
            return True
    holds: bool | None = False
    for box in boxes:
        one = _searched(programs, scene, scaled, box)
        if one:
            return True
        holds = None if one is None else holds
    return holds


def _searched(
    programs: Programs, scene: LabelledScene, scaled: Scaled, box: Envelope
) -> bool | None:
    """Tell whether a posture has [p, f] in a box: P1 over halves of it, with cones times the box's
    bounds (``Coned``), deepest first.
    """
    program, queue = programs.get(Coned, scaled.layout), [box]
    whole = box.high - box.low
    for _ in range(PARTS):
        if not queue:
            return False
        part = queue.pop()
        answer = program.solve(scaled, part)
        if answer.known and not answer.feasible:
            continue
        if answer.relaxed is not None and _posture(programs, scene, scaled, box, answer.relaxed):
            return True
        widths = (part.high - part.low) / np.maximum(whole, 1e-9)
        if answer.excess is not None:  # of the product that is off the most, the wider side
            i, j, k = np.unravel_index(int(np.abs(answer.excess).argmax()), answer.excess.shape)
            side = (i, j) if widths[i, j] >= widths[i, 3 + k] else (i, 3 + k)
        else:
            i, j = np.unravel_index(int(widths.argmax()), widths.shape)
            side = (i, j)
        middle = 0.5 * (part.low[side] + part.high[side])
        at = middle if answer.at is None else answer.at[side]
        for name in ("high", "low") if at > middle else ("low", "high"):  # its own half comes last
            ends = {"low": part.low.copy(), "high": part.high.copy()}
            ends[name][side] = middle
            queue.append(Envelope(**ends))
    return None


def _posture(
    programs: Programs, scene: LabelledScene, scaled: Scaled, box: Envelope, relaxed: Any
) -> bool:
    """Tell whether a part's point projects to a posture in the box, forces in it, and verified."""
    low, high = (
        np.maximum(scaled.force_min, box.low[:, 3:]),
        np.minimum(scaled.force_max, box.high[:, 3:]),
    )
    if (low > high).any():
        return False
    choice, start = relaxed.rounded()
    within = scaled.with_force_box(low, high)
    for way in SOUGHT:
        point = project(programs, way, within, start)
        if not point.residual <= max(SURFACE, 0.5 * Acceptance().tolerance):
            continue
        plan = plan_of(scene.problem, scaled, choice, point)
        if not box.contains(scaled.point(plan)[None], margin=INSIDE)[0]:
            continue
        answer = Acceptance().answer(
            scene.problem, plan=plan, method="theorem", clock=Clock.start()
        )
        if answer.status is Status.FEASIBLE:
            return True
    return False


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
