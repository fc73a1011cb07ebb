"""P̄ and P1: the signed margin, its gradient, and what McCormick's envelopes promise."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, strategies as st

import stancekit
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import ConicStatus
from stancekit.planners.equilibrium.rows import Rows
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import (
    FEASIBLE_MARGIN,
    RELAXATIONS,
    Envelope,
    EnvelopeSet,
    RelaxationAnswer,
)
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.relaxation.mccormick import Boxed, Coned, McCormick, WithoutMoment
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.methods import TwoStage
from tests.planners.oracle import OraclePrograms

SEEDS = st.integers(0, 2**32 - 1)
STEP = 1e-4


@pytest.fixture(scope="module")
def witnesses(programs, drawn):
    """Feasible wall-3 problems with the point [p, f] of a witness."""
    found = []
    for seed in range(40):
        outcome = Exact(programs=programs).solve(drawn("wall-3", seed))
        if outcome.status is Status.FEASIBLE:
            scaled = Scaled.of(drawn("wall-3", seed))
            found.append((scaled, scaled.point(outcome.solution)))
    assert len(found) >= 15
    return found


@pytest.fixture(scope="module")
def box(witnesses):
    """A box such as is learned: quantiles over witnesses."""
    points = np.array([point for _, point in witnesses])
    return Envelope(low=np.quantile(points, 0.1, axis=0), high=np.quantile(points, 0.9, axis=0))


def around(point, width):
    return Envelope(low=point - width, high=point + width)


def p1_again(model, boxes):
    """Least t over boxes, one binary each: McCormick rows relaxed by t, and off for a box that is
    not chosen.
    """
    count = len(model.problem.contacts)
    t = cp.Variable()
    products = [cp.Variable((3, 3)) for _ in range(count)]  # m_jk, rows j of p, columns k of f
    total = 0.0
    for m, frame in zip(products, model.frames, strict=True):
        for j in range(3):
            for k in range(3):
                total = total + m[j, k] * np.cross(np.eye(3)[j], frame[:, k])
    rows = [*model.convex, total == 0]
    chosen = cp.Variable(len(boxes), boolean=True) if len(boxes) > 1 else np.ones(1)
    if len(boxes) > 1:
        rows += [cp.sum(chosen) == 1]
    for index, bounds in enumerate(boxes):
        room = t + 20.0 * (1 - chosen[index])
        for i, m in enumerate(products):
            p, f = model.toes[i] - model.com, model.forces[i]
            (pl, fl), (ph, fh) = np.split(bounds.low[i], 2), np.split(bounds.high[i], 2)
            for j in range(3):
                for k in range(3):
                    rows += [
                        m[j, k] >= pl[j] * f[k] + p[j] * fl[k] - pl[j] * fl[k] - room,
                        m[j, k] >= ph[j] * f[k] + p[j] * fh[k] - ph[j] * fh[k] - room,
                        m[j, k] <= pl[j] * f[k] + p[j] * fh[k] - pl[j] * fh[k] + room,
                        m[j, k] <= ph[j] * f[k] + p[j] * fl[k] - ph[j] * fl[k] + room,
                    ]
            rows += [p >= pl - room, p <= ph + room, f >= fl - room, f <= fh + room]
    return cp.Problem(cp.Minimize(t), rows)


@pytest.mark.parametrize("seed", [0, 5, 8, 10, 12])
def test_the_margin_is_that_of_p1_written_again(programs, drawn, written, box, seed):
    problem = drawn("wall-3", seed)
    scaled = Scaled.of(problem)
    answer = programs.get(McCormick, scaled.layout).solve(scaled, box)
    assert answer.margin == pytest.approx(
        p1_again(written(problem), [box]).solve(solver=cp.CLARABEL), abs=2e-7
    )
    assert answer.feasible == (answer.margin <= FEASIBLE_MARGIN)
    assert answer.known


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_the_margin_of_mixed_polygons_is_that_of_p1_written_again(programs, mixed, written, seed):
    problem = mixed(seed, (5, 3, 4, 3))
    scaled = Scaled.of(problem)
    rng = np.random.default_rng(seed)
    box = Envelope.from_vector(rng.uniform(-0.6, 0.6, 48))
    answer = programs.get(McCormick, scaled.layout).solve(scaled, box)
    assert answer.margin == pytest.approx(
        p1_again(written(problem), [box]).solve(solver=cp.CLARABEL), abs=2e-7
    )


# ----------------------------------------------------------------------------------------------------------
# gradient


def margin_at(programs, scaled, vector):
    return programs.get(McCormick, scaled.layout).solve(scaled, Envelope.from_vector(vector)).margin


@pytest.mark.parametrize("seed", [0, 5, 8, 10, 12])
def test_the_gradient_is_that_of_central_differences_in_every_bound(programs, drawn, box, seed):
    scaled, bounds = Scaled.of(drawn("wall-3", seed)), box.to_vector()
    answer = programs.get(McCormick, scaled.layout).solve(scaled, box, gradient=True)
    gradient = np.concatenate([part.ravel() for part in answer.gradient])
    steps = STEP * np.eye(len(bounds))
    slopes = [
        (margin_at(programs, scaled, bounds + e) - margin_at(programs, scaled, bounds - e))
        / (2 * STEP)
        for e in steps
    ]
    np.testing.assert_allclose(gradient, slopes, atol=1e-5)
    assert np.max(np.abs(gradient)) > 0.02


@given(SEEDS)
def test_the_gradient_is_that_of_central_differences_in_any_direction(
    programs, drawn, mixed, box, seed
):
    rng = np.random.default_rng(seed)
    if rng.random() < 0.5:
        scaled, low = (
            Scaled.of(mixed(int(rng.integers(10)), (4, 3, 3))),
            rng.uniform(-0.9, -0.1, (3, 6)),
        )
        bounds = np.concatenate([low.ravel(), (low + rng.uniform(0.2, 1.2, (3, 6))).ravel()])
    else:
        scaled = Scaled.of(drawn("wall-3", int(rng.integers(40))))
        bounds = box.to_vector() + rng.uniform(-0.01, 0.01, 36)
    direction = rng.normal(size=36)
    answer = programs.get(McCormick, scaled.layout).solve(
        scaled, Envelope.from_vector(bounds), gradient=True
    )
    if np.isinf(answer.margin):
        assert answer.gradient is None
        return
    gradient = np.concatenate([part.ravel() for part in answer.gradient])
    ahead, behind = (
        margin_at(programs, scaled, bounds + sign * STEP * direction) for sign in (1.0, -1.0)
    )
    one_sided = np.sort([(ahead - answer.margin) / STEP, (answer.margin - behind) / STEP])
    assert one_sided[0] - 2e-3 <= gradient @ direction <= one_sided[1] + 2e-3
    if one_sided[1] - one_sided[0] < 2e-4:  # no kink in between
        assert gradient @ direction == pytest.approx(np.mean(one_sided), abs=1e-4)


def test_the_gradient_comes_only_when_asked_for(programs, drawn, box):
    scaled = Scaled.of(drawn("wall-3", 0))
    assert programs.get(McCormick, scaled.layout).solve(scaled, box).gradient is None
    low, high = programs.get(McCormick, scaled.layout).solve(scaled, box, gradient=True).gradient
    assert low.shape == high.shape == (3, 6)
    assert np.min(low) >= -1e-6  # a higher floor and a lower ceiling never help
    assert np.max(high) <= 1e-6


# ---------------------------------------------------------------------------------------------------------
# promises


@given(SEEDS)
def test_a_box_that_holds_a_witness_admits_the_problem(programs, witnesses, seed):
    rng = np.random.default_rng(seed)
    scaled, point = witnesses[int(rng.integers(len(witnesses)))]
    low, high = rng.exponential(0.2, (2, 3, 6)) * (rng.random((2, 3, 6)) < 0.8)
    answer = programs.get(McCormick, scaled.layout).solve(
        scaled, Envelope(low=point - low, high=point + high)
    )
    assert answer.margin <= 2e-7
    if low.min() > 1e-3 and high.min() > 1e-3:
        assert answer.feasible


@given(SEEDS)
def test_a_larger_box_admits_what_a_smaller_one_admits_with_no_larger_margin(
    programs, witnesses, seed
):
    """Only where t ≤ 0: outside a box its rows are no bounds on p f, so that a positive margin may
    even grow.
    """
    rng = np.random.default_rng(seed)
    scaled, point = witnesses[int(rng.integers(len(witnesses)))]
    box = around(point, rng.exponential(0.02, (3, 6)))
    before = programs.get(McCormick, scaled.layout).solve(scaled, box).margin
    for _ in range(4):
        more = rng.exponential(0.1, (2, 3, 6)) * (rng.random((2, 3, 6)) < 0.5)
        box = Envelope(low=box.low - more[0], high=box.high + more[1])
        after = programs.get(McCormick, scaled.layout).solve(scaled, box).margin
        assert after <= before + 2e-7
        before = after


@given(SEEDS)
def test_a_box_within_one_that_refuses_the_problem_refuses_it_too(programs, drawn, mixed, seed):
    rng = np.random.default_rng(seed)
    scaled = Scaled.of(
        drawn("wall-3", int(rng.integers(40)))
        if rng.random() < 0.5
        else mixed(int(rng.integers(10)), (4, 3, 3))
    )
    low, width = rng.uniform(-0.9, 0.2, (3, 6)), rng.exponential(0.5, (3, 6))
    ends = np.sort(rng.uniform(0.0, 1.0, (2, 3, 6)), axis=0)
    large = programs.get(McCormick, scaled.layout).solve(
        scaled, Envelope(low=low, high=low + width)
    )
    small = programs.get(McCormick, scaled.layout).solve(
        scaled, Envelope(low=low + ends[0] * width, high=low + ends[1] * width)
    )
    assert small.margin > 0.0 or large.margin <= small.margin + 2e-7
    assert large.feasible or not small.feasible


def test_as_the_box_shrinks_to_a_witness_so_does_the_answer(programs, witnesses):
    for scaled, point in witnesses[:8]:
        for width in (0.1, 0.01, 1e-3, 1e-4):
            answer = programs.get(McCormick, scaled.layout).solve(scaled, around(point, width))
            com, toes, forces = answer.point.com, answer.point.toes, answer.point.forces
            assert -width <= answer.margin <= 2e-7
            np.testing.assert_allclose(np.hstack([toes - com, forces]), point, atol=width + 1e-6)
            assert (
                answer.gap <= width**2 + 1e-6
            )  # McCormick's largest gap over a square of side 2 width
            moment = np.cross(toes - com, np.einsum("nij,nj->ni", scaled.frames, forces)).sum(
                axis=0
            )
            assert np.max(np.abs(moment)) <= 18.0 * width**2 + 1e-5


def test_a_box_far_from_every_posture_has_at_least_its_distance_as_margin(programs, drawn):
    scaled = Scaled.of(drawn("ground-3", 0))
    box = Envelope(low=np.full((3, 6), 5.0), high=np.full((3, 6), 6.0))
    answer = programs.get(McCormick, scaled.layout).solve(scaled, box)
    assert not answer.feasible
    assert answer.margin >= 4.0  # no |p| or |f| exceeds 1 here


@pytest.mark.parametrize("name", ["wall-3", "ground-3", "wall-5"])
def test_p_bar_p1_and_the_lift_agree_on_what_no_box_can_help(programs, drawn, name):
    trivial = 0
    for seed in range(60):
        scaled = Scaled.of(drawn(name, seed))
        count = len(scaled.reach)
        wide = programs.get(McCormick, scaled.layout).solve(
            scaled, Envelope(low=-np.ones((count, 6)), high=np.ones((count, 6)))
        )
        narrow = programs.get(McCormick, scaled.layout).solve(
            scaled, Envelope(low=np.zeros((count, 6)), high=np.zeros((count, 6)))
        )
        without = programs.get(WithoutMoment, scaled.layout).solve(scaled)
        bound = solve_lift(programs, scaled, least_moment=True).bound
        assert np.isinf([wide.margin, narrow.margin, bound]).tolist() == [without is None] * 3
        if without is None:
            trivial += 1
            assert wide.point is None
            assert np.isnan(wide.gap)
            assert not wide.feasible
    assert trivial >= {"wall-3": 8, "ground-3": 0, "wall-5": 2}[name]


@pytest.mark.parametrize("seed", range(6))
def test_p_bar_answers_with_a_point_of_its_set(programs, drawn, written, seed):
    problem = drawn("ground-3", seed)
    scaled = Scaled.of(problem)
    point, model = programs.get(WithoutMoment, scaled.layout).solve(scaled), written(problem)
    model.com.value, model.rotation.value = point.com[0], point.rotation[0]
    model.toes.value, model.forces.value = point.toes, point.forces
    for share, vertices, toe in zip(model.shares, model.vertices, point.toes, strict=True):
        share.value = np.linalg.lstsq(
            np.vstack([vertices.T, np.ones(3)]), np.append(toe, 1.0), rcond=None
        )[0]
    assert max(np.max(constraint.violation()) for constraint in model.convex) < 1e-7


# ------------------------------------------------------------------------------------------------------
# sets and gap


def some_boxes(box, seed):
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-0.1, 0.1, (3, 3, 6))
    return [Envelope(low=box.low + s, high=box.high + s) for s in shift]


@pytest.mark.parametrize("seed", [0, 5, 8, 10, 17])
def test_of_a_set_the_box_of_least_margin_is_chosen(programs, drawn, box, seed):
    scaled, boxes = Scaled.of(drawn("wall-3", seed)), some_boxes(box, seed)
    answers = [programs.get(McCormick, scaled.layout).solve(scaled, one) for one in boxes]
    best = programs.get(McCormick, scaled.layout).solve_any(scaled, boxes)
    margins = [answer.margin for answer in answers]
    assert best.margin == min(margins)
    assert best.chosen == int(np.argmin(margins))
    assert best.gap == answers[best.chosen].gap
    np.testing.assert_array_equal(best.point.forces, answers[best.chosen].point.forces)
    assert (
        programs.get(McCormick, scaled.layout).solve_any(scaled, boxes[::-1]).chosen
        == 2 - best.chosen
    )


@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_box_that_the_solver_gave_up_on_hides_no_other_that_admits_the_problem(
    programs, drawn, box, monkeypatch, seed, place
):
    scaled, boxes = Scaled.of(drawn("wall-3", seed)), some_boxes(box, seed)
    p1 = McCormick(scaled.layout)
    margins = [p1.solve(scaled, one).margin for one in boxes]
    margins[place] = np.inf
    solve = p1.rows.solve

    def gives_up(data):
        return (
            replace(solve(data), status=ConicStatus.FAILED)
            if data.boxes[0] is boxes[place]
            else solve(data)
        )

    monkeypatch.setattr(p1.rows, "solve", gives_up)
    answer = p1.solve_any(scaled, boxes)
    admitted = min(margins) <= FEASIBLE_MARGIN
    assert (answer.known, answer.feasible, answer.solves) == (admitted, admitted, 3)
    assert not admitted or answer.margin == min(margins)
    assert not p1.solve_any(scaled, [boxes[place]] * 2).known
    wide = Envelope(low=np.full((3, 6), -1.0), high=np.ones((3, 6)))
    if seed == 0:
        assert p1.solve_any(scaled, [boxes[place], wide]).chosen == 1


def test_where_the_solver_gives_up_nothing_is_known(drawn, box, monkeypatch):
    solve = Rows.solve
    monkeypatch.setattr(
        Rows, "solve", lambda rows, data: replace(solve(rows, data), status=ConicStatus.FAILED)
    )
    scaled = Scaled.of(drawn("wall-3", 5))
    answer = McCormick(scaled.layout).solve(scaled, box, gradient=True)
    assert np.isnan([answer.margin, answer.gap]).all()
    assert (answer.known, answer.feasible, answer.point, answer.gradient) == (
        False,
        False,
        None,
        None,
    )
    assert WithoutMoment(scaled.layout).solve(scaled) is None


def test_a_margin_is_feasible_up_to_the_tolerance_of_the_solver():
    for margin, feasible in (
        (-1.0, True),
        (0.0, True),
        (1e-8, True),
        (1e-6, False),
        (np.inf, False),
        (np.nan, False),
    ):
        assert RelaxationAnswer(margin=margin).feasible == feasible


@pytest.mark.parametrize("seed", [1, 3])
def test_the_choice_is_that_of_binaries_on_scip(programs, mixed, written, seed):
    problem = mixed(seed, (3, 4))
    scaled, rng = Scaled.of(problem), np.random.default_rng(seed)
    boxes = [Envelope.from_vector(rng.uniform(-0.5, 0.5, 24)) for _ in range(3)]
    program = p1_again(written(problem), boxes)
    answer = programs.get(McCormick, scaled.layout).solve_any(scaled, boxes)
    assert answer.margin == pytest.approx(program.solve(solver=cp.SCIP), abs=1e-4)


@pytest.mark.parametrize("seed", [0, 5, 8, 10])
def test_the_gap_is_the_largest_miss_of_a_product(programs, drawn, box, seed):
    scaled = Scaled.of(drawn("wall-3", seed))
    p1 = programs.get(McCormick, scaled.layout)
    answer = p1.solve(scaled, box)
    m = p1.rows.solve(Boxed(scaled, boxes=(box,))).value("moments").reshape(3, 3, 3)  # i, j, k
    misses = [
        abs(m[i, j, k] - answer.at[i, j] * answer.point.forces[i, k])
        for i in range(3)
        for j in range(3)
        for k in range(3)
    ]
    assert answer.gap == max(misses)
    np.testing.assert_allclose(
        answer.at[:, :3], answer.point.toes - answer.point.com, atol=1e-7
    )  # E2
    world = np.einsum("njk,nak->nja", m, scaled.frames)  # Σ_k m_jk F_k
    moment = np.cross(np.eye(3)[None], world).sum(axis=(0, 1))
    np.testing.assert_allclose(moment, 0.0, atol=1e-7)  # E9 holds for m, though not for p f


@pytest.fixture(scope="module")
def held(programs):
    """Feasible problems, each with [p, f] of its witness, non-dimensional."""
    found, rng = [], np.random.default_rng(4)
    while len(found) < 6:
        problem = DISTRIBUTIONS["wall-3"].sample(rng)
        posture = Exact(programs=programs).solve(problem).solution
        if posture is not None:
            scaled = Scaled.of(problem)
            frames = [contact.patch.frame for contact in problem.contacts]
            force = (
                np.array([f @ each for f, each in zip(posture.forces_n[0], frames, strict=True)])
                / scaled.force_n
            )
            found.append(
                (
                    problem,
                    scaled,
                    np.hstack([(posture.toes_m - posture.com_m) / scaled.length_m, force]),
                )
            )
    return found


def about(at, width, rng):
    """A box that holds a point, not in its middle."""
    away = rng.uniform(-0.5, 0.5, at.shape) * width
    return Envelope(low=at - width + away, high=at + width + away)


def test_it_is_in_the_table_and_says_what_it_is():
    assert RELAXATIONS.get("coned") is Coned
    assert (Coned.over_boxes, Coned.about_points) == (True, False)


def test_what_is_true_is_admitted_and_boxes_are_never_looser_than_mccormicks(held, programs):
    rng, tighter = np.random.default_rng(0), 0
    for _, scaled, at in held:
        for width in (0.02, 0.1, 0.3):
            box = about(at, width, rng)
            coned, plain = (
                kind.margin(programs, scaled, box).margin for kind in (Coned, McCormick)
            )
            assert coned <= 1e-6
            assert coned >= plain - 1e-6
            tighter += coned > plain + 1e-4
    assert tighter > 5


def test_the_same_in_cvxpy_says_the_same(held, programs):
    other, rng = OraclePrograms(), np.random.default_rng(1)
    for _, scaled, at in held[:3]:
        box = about(at + 0.05, 0.15, rng)
        one, two = (Coned.margin(which, scaled, box, gradient=True) for which in (programs, other))
        assert one.margin == pytest.approx(two.margin, abs=1e-6)
        np.testing.assert_allclose(one.gradient, two.gradient, atol=1e-3)


def test_its_margin_moves_with_the_box_as_its_gradient_says(held, programs):
    rng, steps = np.random.default_rng(2), 0
    for _, scaled, at in held:
        box = about(at + 0.08, 0.1, rng)
        gradient = Coned.margin(programs, scaled, box, gradient=True).gradient
        for side, name in enumerate(("low", "high")):
            turn = rng.normal(size=at.shape)
            sides = {"low": box.low, "high": box.high}
            moved = [
                Coned.margin(
                    programs, scaled, Envelope(**{**sides, name: sides[name] + step * turn})
                ).margin
                for step in (1e-4, -1e-4)
            ]
            assert (moved[0] - moved[1]) / 2e-4 == pytest.approx(
                np.sum(gradient[side] * turn), abs=5e-3
            )
            steps += 1
    assert steps == 12


def test_solve_plan_and_the_environment_reach_it():
    problem = stancekit.sample("wall-3", rng=3)[0]
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    learned = EnvelopeSet.for_problems("wall-3", [problem], [box])
    outcome = stancekit.solve(problem, TwoStage(relaxation="coned", envelopes=learned))
    assert outcome.status is not stancekit.Status.INFEASIBLE
    assert "margin" in outcome.details
    import gymnasium as gym

    env = gym.make("stancekit.envs:stancekit/EnvelopeSelection-v0", relaxation="coned")
    env.reset(seed=0)
    wide = np.repeat(np.float32([-1.0, 1.0]), 18)
    plain = gym.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
    plain.reset(seed=0)
    coned, loose = (one.step(wide)[4]["margin"] for one in (env, plain))
    assert coned >= loose - 1e-6
