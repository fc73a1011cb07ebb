"""Moreau solves many problems of one layout together, and says what Clarabel says of each."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.equilibrium.conic_solution import ConicStatus
from stancekit.planners.equilibrium.moreau_solver import MoreauSolver, check_device
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.relaxation import relaxed
from stancekit.planners.relaxation.boxed import Boxed
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.joint import JointRelaxation, near_nominal
from stancekit.planners.relaxation.mccormick import McCormick

moreau = pytest.importorskip("moreau")
COUNT = 21  # no power of two: batches are filled up


def problems(name, program):
    """Problems with a box each, some far too small: P1 feasible, infeasible, and without any
    answer.
    """
    rng, sampler = np.random.default_rng(4), distribution(name)
    scaled = [Scaled.of(sampler.sample(rng)) for _ in range(COUNT)]
    middle, half = (
        rng.uniform(-0.2, 0.2, (COUNT, len(sampler.legs), 6)),
        rng.uniform(0.02, 0.9, (COUNT, 1, 1)),
    )
    boxes = [
        Envelope(low=low, high=high) for low, high in zip(middle - half, middle + half, strict=True)
    ]
    points = [
        near_nominal(one, at) if program is JointRelaxation else None
        for one, at in zip(scaled, middle, strict=True)
    ]
    return [
        Boxed(one, point, boxes=(box,))
        for one, point, box in zip(scaled, points, boxes, strict=True)
    ]


@pytest.mark.parametrize(
    ("name", "make"), [("wall-3", McCormick), ("ground-3", McCormick), ("wall-3", JointRelaxation)]
)
def test_every_answer_is_that_of_clarabel(name, make):
    data = problems(name, make)
    program = make(data[0].scaled.layout)
    together = MoreauSolver(program.rows, "cpu").solve_all(data)
    alone = [program.rows.solve(one) for one in data]
    assert [one.status for one in together] == [one.status for one in alone]
    assert any(one.solved for one in alone)
    for mine, theirs, given in zip(together, alone, data, strict=True):
        if not mine.solved:
            constant, slope = program.rows.lagrangian(
                given, mine
            )  # a Farkas ray: no x makes it ≤ 0
            assert constant > 0.0
            assert np.abs(slope).max() < 1e-6 * constant
            continue
        assert mine.value("margin")[0] == pytest.approx(theirs.value("margin")[0], abs=5e-7)
        assert mine.objective == pytest.approx(theirs.objective, abs=1e-6)
        assert mine.bound == pytest.approx(mine.objective, abs=1e-6)
        hessian, q, _, _ = program.rows.load(given)
        _, residual = program.rows.lagrangian(given, mine)
        curved = np.zeros_like(q)
        column = np.repeat(np.arange(len(q)), np.diff(hessian.indptr))
        np.add.at(curved, hessian.indices, hessian.data * mine.x[column])
        off = hessian.indices != column
        np.add.at(curved, column[off], (hessian.data * mine.x[hessian.indices])[off])
        np.testing.assert_allclose(
            curved + q + residual, 0.0, atol=1e-6
        )  # stationary: P x + q + A'z = 0


def test_more_problems_than_one_batch_are_solved_in_parts(monkeypatch):
    data = problems("wall-3", McCormick)
    program = McCormick(data[0].scaled.layout)
    whole = MoreauSolver(program.rows, "cpu").solve_all(data)
    monkeypatch.setattr("stancekit.planners.equilibrium.moreau_solver.MOST", 8)
    parts = MoreauSolver(program.rows, "cpu").solve_all(data)
    assert len(parts) == COUNT
    for mine, theirs in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(mine.x, theirs.x)


def test_what_two_solvers_could_differ_about_is_asked_again_of_clarabel():
    data = problems("wall-3", McCormick)
    program = McCormick(data[0].scaled.layout)
    alone = [program.rows.solve(one) for one in data]
    program.rows.solve_together(MoreauSolver(program.rows, "cpu").solve_all)
    certain = program.rows.solve_all(data, lambda _: False)
    again = program.rows.solve_all(data, lambda solution: solution.solved)
    for mine, theirs in zip(again, alone, strict=True):
        if mine.solved:
            np.testing.assert_array_equal(mine.x, theirs.x)
    assert any(not np.array_equal(a.x, b.x) for a, b in zip(certain, again, strict=True))

    program.rows.solve_together(lambda some: [failed(program.rows.solve(one)) for one in some])
    for mine, theirs in zip(program.rows.solve_all(data, lambda _: False), alone, strict=True):
        np.testing.assert_array_equal(mine.x, theirs.x)


def failed(solution):
    return replace(solution, status=ConicStatus.FAILED)


@pytest.mark.parametrize(
    ("margin", "said"), [(1e-7, True), (9e-7, True), (-8e-7, True), (2e-6, False), (-1e-3, False)]
)
def test_a_margin_is_doubtful_near_where_it_counts_as_feasible(margin, said):
    data = problems("ground-3", McCormick)[0]
    solution = McCormick(data.scaled.layout).rows.solve(data)
    assert solution.solved
    solution.x[solution.columns["margin"]] = margin
    assert relaxed.doubtful(solution) is said


def test_without_a_cuda_device_or_moreau_one_line_says_so(monkeypatch):
    monkeypatch.setattr(moreau, "device_available", lambda name: name == "cpu")
    monkeypatch.setattr(moreau, "device_error", lambda name: "no driver\nfound")
    with pytest.raises(
        InvalidInput,
        match=r"^backend: expected a CUDA device for moreau, got none: no driver found$",
    ):
        Programs(engine="moreau")
    Programs(engine="moreau-cpu")
    monkeypatch.setitem(sys.modules, "moreau", None)
    with pytest.raises(InvalidInput, match=r'not installed: pip install "stancekit\[moreau\]"$'):
        Programs(engine="moreau-cpu")
    with pytest.raises(InvalidInput, match=r"^device: expected cuda or cpu, got 'tpu'$"):
        check_device("tpu")
