"""P1's verdicts with and without earlier proofs are the same, and every proof holds against an
independent check.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from stancekit.envs.distributions.postures import distribution
from stancekit.learners.data.executors import processes
from stancekit.learners.selectors.feasibility import (
    BAND,
    CachingOracle,
    DualBounds,
    SpreadOracle,
    VerdictCounts,
    balanced,
    least,
    ranges,
    witnessed,
)
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.envelope import (
    FEASIBLE_MARGIN,
    DualBound,
    Envelope,
    RelaxationAnswer,
)
from stancekit.planners.relaxation.mccormick import McCormick, moment_axes
from stancekit.planners.robot.model import ReachRows

BOUNDS = {
    "wall": ((0.0, 0.9), (-0.3, 0.3), (0.0, 0.4)),
    "ground": ((0.0, 0.5), (-0.15, 0.15), (-0.15, 0.15)),
}


def drawn(name: str, count: int, seed: int) -> list[Scaled]:
    rng = np.random.default_rng(seed)
    return [Scaled.of(distribution(name).sample(rng)) for _ in range(count)]


def boxed_in(problem: Problem) -> Problem:
    """The problem with legs that are half-spaces, too: a box about the middle of every patch."""
    normals, contacts = np.vstack([np.eye(3), -np.eye(3)]), []
    for contact in problem.contacts:
        bounds = normals @ contact.patch.vertices_m.mean(axis=0) + 0.05
        contacts.append(replace(contact, reach_rows=ReachRows(normals=normals, bounds_m=bounds)))
    return problem.posture_with(contacts=tuple(contacts), tilt_limit_rad=0.02)


def boxes_about(
    problems: list[Scaled], kind: str, count: int, spread: float, seed: int
) -> list[Envelope]:
    """Boxes as a search meets them: variations of a usual one."""
    rng = np.random.default_rng(seed)
    patches = np.stack([problem.patches.mean(axis=1) - problem.com for problem in problems])
    low = np.concatenate(
        [np.quantile(patches, 0.2, axis=0), np.tile([b[0] for b in BOUNDS[kind]], (3, 1))], axis=1
    )
    high = np.concatenate(
        [np.quantile(patches, 0.8, axis=0), np.tile([b[1] for b in BOUNDS[kind]], (3, 1))], axis=1
    )
    steps = spread * (high - low) * rng.standard_normal((count, 2, *low.shape))
    return [
        Envelope.from_vector(np.concatenate([(low + a).ravel(), (high + b).ravel()]))
        for a, b in steps
    ]


class Plain:
    """Solves P1 of every problem over every box."""

    def __init__(self, problems: list[Scaled], programs: Programs) -> None:
        self._problems, self.counts = problems, VerdictCounts()
        self._p1 = programs.get(McCormick, problems[0].layout)

    def is_feasible(self, which: np.ndarray, boxes: list[Envelope]) -> np.ndarray:
        margins = np.array(
            [[self._p1.solve(self._problems[k], box).margin for k in which] for box in boxes]
        )
        self.counts = VerdictCounts(solved=self.counts.solved + margins.size)
        return margins <= FEASIBLE_MARGIN


@pytest.mark.parametrize(
    ("name", "kind", "spread"), [("wall-3", "wall", 0.1), ("ground-3", "ground", 0.1)]
)
def test_the_cache_says_what_solving_says(
    programs: Programs, name: str, kind: str, spread: float
) -> None:
    problems = drawn(name, 12, seed=3)
    plain, cached = Plain(problems, programs), CachingOracle(problems, programs)
    which = np.arange(len(problems))
    for seed in range(3):  # each generation finds more proofs than the one before
        boxes = boxes_about(problems, kind, 9, spread, seed)
        np.testing.assert_array_equal(
            cached.is_feasible(which, boxes), plain.is_feasible(which, boxes)
        )
    counts = cached.counts
    assert counts.total == plain.counts.total == plain.counts.solved == 3 * 9 * 12
    assert min(counts.witness, counts.certificate, counts.trivial if name == "wall-3" else 1) > 0
    assert counts.cached > 0.6 * counts.total
    assert counts.unknown == 0


def test_problems_that_are_shared_out_get_the_same_verdicts_by_the_same_proofs(
    programs: Programs,
) -> None:
    problems, rng = drawn("wall-3", 12, seed=4), np.random.default_rng(0)
    whole = CachingOracle(problems, programs)
    spread = [SpreadOracle(problems, processes(workers)) for workers in (1, 2)]
    for seed in range(3):
        boxes = boxes_about(problems, "wall", 6, 0.1, seed)
        which = np.sort(rng.choice(12, size=9, replace=False))
        expected = whole.is_feasible(which, boxes)
        for oracle in spread:
            np.testing.assert_array_equal(oracle.is_feasible(which, boxes), expected)
            assert oracle.counts == whole.counts
    assert whole.counts.cached > 0


def test_little_memory_settles_less_and_errs_no_more(programs: Programs) -> None:
    problems = drawn("wall-3", 12, seed=4)
    plain, small = (
        Plain(problems, programs),
        CachingOracle(problems, programs, witnesses=1, certificates=1),
    )
    large = CachingOracle(problems, programs)
    for seed in range(4):
        which, boxes = (
            np.random.default_rng(seed).permutation(12)[:8],
            boxes_about(problems, "wall", 10, 0.15, seed),
        )
        expected = plain.is_feasible(which, boxes)
        np.testing.assert_array_equal(small.is_feasible(which, boxes), expected)
        np.testing.assert_array_equal(large.is_feasible(which, boxes), expected)
    assert large.counts.cached >= small.counts.cached > 0


@pytest.mark.parametrize("limit", [lambda problem: problem, boxed_in], ids=["balls", "half-spaces"])
def test_certificates_and_witnesses_hold_at_other_boxes(programs: Programs, limit) -> None:
    source, rng = distribution("wall-3"), np.random.default_rng(5)
    problems = [Scaled.of(limit(source.sample(rng))) for _ in range(40)]
    boxes = boxes_about(problems, "wall", 8, 0.04, seed=6)
    bounds, refuted, shown = DualBounds.of(boxes), 0, 0
    for problem in problems:
        evidence = programs.get(McCormick, problem.layout).dual_bound(problem, boxes[0])
        margins = np.array(
            [programs.get(McCormick, problem.layout).solve(problem, box).margin for box in boxes]
        )
        if np.isinf(evidence.margin):
            continue
        assert evidence.margin == pytest.approx(margins[0], abs=1e-9)
        low, high = (side[None, None] for side in ranges(problem))
        low, high = np.maximum(low, bounds.low - BAND), np.minimum(high, bounds.high + BAND)
        if np.all(low <= high):
            value = least(
                evidence.rows[None, None],
                evidence.slope[None, None],
                np.array([[evidence.constant]]),
                bounds,
                low,
                high,
            )[0, 0]
            assert np.all(margins[value > 0.0] > 0.9 * BAND)
            assert (value[0] > 0.0) == (margins[0] > 1.1 * BAND)  # strong duality at its own box
            refuted += int((value[1:] > 0.0).sum())
        hits = witnessed(
            evidence.point[None, None],
            evidence.excess[None, None],
            moment_axes(problem)[None],
            bounds,
            np.ones((1, len(boxes)), dtype=bool),
        )[0, 0]
        assert np.all(margins[hits] < 0.0)
        shown += int(hits[1:].sum())
    assert refuted > 20
    assert shown > 20


def test_moments_are_balanced_only_where_a_linear_program_can(programs: Programs) -> None:
    rng = np.random.default_rng(7)
    axes = np.stack([moment_axes(problem) for problem in drawn("wall-3", 80, seed=7)])
    bottom, top = -rng.uniform(0.0, 0.05, (80, 27)), rng.uniform(0.0, 0.05, (80, 27))
    excess = rng.uniform(-0.09, 0.09, (80, 27))
    found = balanced(axes, excess, bottom, top)
    sides = np.stack([bottom, top], axis=2)
    programs = [
        linprog(np.zeros(27), A_eq=axes[t], b_eq=axes[t] @ excess[t], bounds=sides[t])
        for t in range(len(axes))
    ]
    truth = np.array([program.status == 0 for program in programs])
    assert not np.any(found & ~truth)
    assert 20 < truth.sum() < 80
    assert found.sum() >= 0.9 * truth.sum()


def test_ranges_hold_every_answer(programs: Programs) -> None:
    wide = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    points = 0
    for problem in drawn("wall-3", 30, seed=8):
        answer = programs.get(McCormick, problem.layout).dual_bound(problem, wide)
        if answer.point is not None:
            low, high = ranges(problem)
            assert np.all(answer.point >= low - 1e-7)
            assert np.all(answer.point <= high + 1e-7)
            points += 1
    assert points > 15


def test_what_no_box_can_mend_is_solved_once(programs: Programs) -> None:
    hopeless = replace(drawn("wall-3", 1, seed=0)[0], weight=50.0)
    oracle = CachingOracle([hopeless], programs)
    boxes = boxes_about([hopeless], "wall", 6, 0.05, seed=1)
    assert not oracle.is_feasible(np.array([0]), boxes).any()
    assert not oracle.is_feasible(np.array([0]), boxes).any()
    assert oracle.counts == VerdictCounts(solved=1, trivial=11)


def test_a_box_out_of_range_needs_no_solve(programs: Programs) -> None:
    problem = drawn("wall-3", 1, seed=0)[0]
    box = Envelope(low=np.full((3, 6), 0.9), high=np.full((3, 6), 0.95))
    oracle = CachingOracle([problem], programs)
    assert not oracle.is_feasible(np.array([0]), [box]).any()
    assert oracle.counts == VerdictCounts(range=1)
    assert programs.get(McCormick, problem.layout).solve(problem, box).margin > BAND


class Stubborn:
    """Programs whose P1 gives up on the first box, or on all."""

    def __init__(self, programs: Programs, box: Envelope, always: bool) -> None:
        self._programs, self._box, self._always = programs, box, always

    def get(self, *_: object) -> Stubborn:
        return self

    def gives_up(self, envelope: Envelope) -> bool:
        return self._always or bool(np.array_equal(envelope.low, self._box.low))

    def _p1(self, scaled: Scaled) -> McCormick:
        return self._programs.get(McCormick, scaled.layout)

    def solve(self, scaled: Scaled, envelope: Envelope) -> RelaxationAnswer:
        return (
            RelaxationAnswer(margin=np.nan)
            if self.gives_up(envelope)
            else self._p1(scaled).solve(scaled, envelope)
        )

    def dual_bound(self, scaled: Scaled, envelope: Envelope) -> DualBound:
        return (
            DualBound(margin=np.nan)
            if self.gives_up(envelope)
            else self._p1(scaled).dual_bound(scaled, envelope)
        )


@pytest.mark.parametrize("always", [False, True])
def test_a_solver_that_gives_up_is_asked_about_a_box_beside(
    programs: Programs, always: bool
) -> None:
    problems = drawn("wall-3", 12, seed=9)
    box = boxes_about(problems, "wall", 1, 0.0, seed=0)[0]
    which, oracle = np.arange(12), CachingOracle(problems, Stubborn(programs, box, always))  # type: ignore[arg-type]
    expected = Plain(problems, programs).is_feasible(which, [box])
    assert expected.any()
    np.testing.assert_array_equal(oracle.is_feasible(which, [box]), expected & (not always))
    assert oracle.counts.unknown == (oracle.counts.solved if always else 0)
