"""The conditions of Lin et al.'s theorem (§III), asked of envelopes on labelled scenes.

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
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from stancekit.envs.scenes import LabelledScene
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs, programs_of_this_thread
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.projection.project import SURFACE, project
from stancekit.planners.relaxation.coned import Coned
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.relaxation.relaxed import RelaxationAnswer
from stancekit.planners.relaxation.within import WithinBox
from stancekit.planners.search.answer import Acceptance, Claim, plan_of
from stancekit.planners.search.clock import Clock

from ..data.executor import Executor, gather, processes
from .evaluate import CHUNK, Progress, Share

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


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One condition on the scenes that it speaks of.

    Arguments:
        holds: share of the scenes that do not break it.
        broken: rows of the data set that break it, by number.
        undecided: rows for which the search met its limit; they count as holding.
    Source:
        Lin et al. §III.

    Example:
        >>> from stancekit.learners.evaluation.theorem import Condition
        >>> from stancekit.learners.evaluation.evaluate import Share
        >>> Condition(holds=Share(hits=3, of=4), broken=(7,)).to_json()["broken"]
        [7]
    """

    holds: Share
    broken: tuple[int, ...] = ()
    undecided: tuple[int, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return share, interval and rows."""
        return {
            "holds": self.holds.value if self.holds.of else None,
            "interval": list(self.holds.interval) if self.holds.of else None,
            "of": self.holds.of,
            "broken": list(self.broken),
            "undecided": list(self.undecided),
        }


TITLES: Mapping[str, str] = {
    "1": "(1) a solution in the box, feasible scenes",
    "2": "(2) no point of P̄ in the box, infeasible scenes",
    "2-p1": "(2) as needed: P1 refuses, infeasible scenes",
    "3-p": "(3) p kept: what P1 admits projects, feasible scenes",
    "3-f": "(3) f kept: what P1 admits projects, feasible scenes",
}
"""Conditions by name, in the order of the table."""


@dataclass(frozen=True, kw_only=True)
class Theorem:
    """The conditions of Lin et al.'s theorem, asked of one set of envelopes.

    Arguments:
        selector: name of the envelopes.
        conditions: by the names of ``TITLES``.
    Source:
        Lin et al. §III.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> boxes = stancekit.fit(train, "quantile").envelopes
        >>> from stancekit.selectors import theorem
        >>> sorted(theorem(boxes, test).conditions)
        ['1', '2', '2-p1', '3-f', '3-p']
    """

    selector: str
    conditions: Mapping[str, Condition] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the conditions by name."""
        return {"selector": self.selector} | {
            name: one.to_json() for name, one in self.conditions.items()
        }


def theorem(
    name: str,
    envelopes: EnvelopeSet,
    scenes: Sequence[LabelledScene],
    numbers: Sequence[int],
    *,
    progress: Progress | None = None,
    run: Executor | None = None,
) -> Theorem:
    """Ask the conditions on labelled scenes.

    Arguments:
        numbers: of the scenes' rows, by which those that break a condition are named. A set of
            several boxes meets (1) where one does, and (2) where all do; (3) is asked of the box
            that P1 takes.
    """
    pairs = list(zip(numbers, scenes, strict=True))
    chunks = [pairs[begin : begin + CHUNK] for begin in range(0, len(pairs), CHUNK)]

    def on_progress(done: int, total: int) -> None:
        if progress is not None:
            progress(min(done * CHUNK, len(pairs)), len(pairs))

    ask = partial(_asked, envelopes)
    parts = gather(run or processes(1), [partial(ask, chunk) for chunk in chunks], on_progress)
    answers: dict[str, dict[int, bool | None]] = {condition: {} for condition in TITLES}
    for part in parts:
        for condition, row, holds in part:
            answers[condition][row] = holds
    return Theorem(
        selector=name,
        conditions={condition: _condition(rows) for condition, rows in answers.items()},
    )


def _condition(found: Mapping[int, bool | None]) -> Condition:
    broken = tuple(row for row, holds in found.items() if holds is False)
    return Condition(
        holds=Share(hits=len(found) - len(broken), of=len(found)),
        broken=broken,
        undecided=tuple(row for row, holds in found.items() if holds is None),
    )


def _asked(
    envelopes: EnvelopeSet, pairs: Sequence[tuple[int, LabelledScene]]
) -> list[tuple[str, int, bool | None]]:
    """Findings of scenes about the conditions: name, row, and whether it holds, None for undecided."""
    programs, findings = programs_of_this_thread(), list[tuple[str, int, bool | None]]()
    for row, scene in pairs:
        scaled = Scaled.of(scene.problem)
        answer = programs.get(McCormick, scaled.layout).solve_any(scaled, envelopes.envelopes)
        admits = None if not answer.known else answer.feasible
        if not scene.feasible:
            findings.append(("2", row, _apart(programs, scaled, envelopes.envelopes)))
            findings.append(("2-p1", row, None if admits is None else not admits))
            continue
        findings.append(("1", row, _met(programs, scene, scaled, envelopes.envelopes)))
        if admits:
            box = envelopes.envelopes[answer.chosen]
            points = _points(programs, scaled, box, answer)
            for keeps, way in WAYS.items():
                findings.append((f"3-{keeps}", row, _projectable(programs, way, scaled, points)))
    return findings


def _apart(programs: Programs, scaled: Scaled, boxes: Sequence[Envelope]) -> bool | None:
    """Tell whether no box holds a point of P̄; None where the solver gave up and no box has one."""
    holds: bool | None = True
    program = programs.get(WithinBox, scaled.layout, False)
    for box in boxes:
        point, known = program.solve(scaled, box, np.zeros_like(box.low))
        if point is not None:
            return False
        holds = holds if known else None
    return holds


def _points(
    programs: Programs, scaled: Scaled, box: Envelope, answer: RelaxationAnswer
) -> list[Point]:
    """P1's own answer, and corners of its set towards random directions in units of the box."""
    directions = np.random.default_rng(0).standard_normal((CORNERS, *box.low.shape))
    widths = np.maximum(box.high - box.low, 1e-6)
    program = programs.get(WithinBox, scaled.layout, True)
    points = [answer.point] + [program.solve(scaled, box, each / widths)[0] for each in directions]
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
    """Tell whether a posture has [p, f] in a box: P1 over halves of it, with cones times the box's bounds
    (``Coned``), deepest first.
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
            scene.problem, Claim(plan=plan), method="theorem", clock=Clock.start()
        )
        if answer.status is Status.FEASIBLE:
            return True
    return False
