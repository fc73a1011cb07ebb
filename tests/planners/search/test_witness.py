"""Canonical witnesses are postures that follow from their problems alone; batches are decided as
one by one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.search import witness
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.batch import LONG, SHORT, canonical, decide_all
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.witness import Iteration, witnesses
from stancekit.planners.verify import check_plan
from tests.planners.oracle import OraclePrograms

NAMES = pytest.mark.parametrize("name", list(DISTRIBUTIONS))
FOUND = {"wall-3": 0.5, "wall-5": 0.75, "ground-3": 0.9}
"""The shares of all samples that the iteration finds are about 0.57, 0.87 and 0.95."""


def batch_of(name, count=300, seed=3):
    return distribution(name).batch(np.random.default_rng(seed), count)


def contents(postures):
    return {k: posture.to_json() for k, (posture, _) in postures.items()}


@NAMES
def test_every_claim_is_a_posture_and_most_feasible_problems_have_one(name):
    batch = batch_of(name)
    scaled = ScaledBatch.of(batch)
    index, points = witnesses(scaled, LONG)
    assert len(index) > FOUND[name] * len(batch)
    assert np.all(np.diff(index) > 0)
    for posture in scaled.select(index).plans(points, [batch.problems[k] for k in index]):
        assert check_plan(posture).accepted


def test_the_iteration_starts_with_the_weight_shared_along_the_normals():
    scaled = ScaledBatch.of(batch_of("wall-3", 4))
    sets = witness._Sets.of(scaled)
    forces = sets.start()[:, sets.parts[3]].reshape(4, 3, 3)
    np.testing.assert_allclose(forces[:, :, 0], scaled.like.weight / 3.0)
    np.testing.assert_array_equal(forces[:, :, 1:], 0.0)


@NAMES
def test_points_without_moments_violate_nothing_else(name):
    batch = batch_of(name)
    index, points = witnesses(ScaledBatch.of(batch), LONG, moments=False)
    assert len(index) > len(witnesses(ScaledBatch.of(batch), LONG)[0])
    for posture in (
        ScaledBatch.of(batch).select(index).plans(points, [batch.problems[k] for k in index])
    ):
        worst = {group.name: group.worst for group in check_plan(posture).groups}
        assert max(value for group, value in worst.items() if group != "moment_balance") <= 1e-9


@NAMES
def test_a_witness_does_not_depend_on_who_else_is_asked(name):
    batch = batch_of(name, 60)
    together = contents(canonical(batch))
    assert 0 < len(together) < len(batch)
    alone = {k: contents(canonical(batch.select(np.array([k])))) for k in range(len(batch))}
    assert {k: found[0] for k, found in alone.items() if found} == together


@NAMES
def test_the_same_witness_is_found_in_fewer_steps_where_it_is_found(name):
    batch = batch_of(name, 200)
    early, late = contents(canonical(batch, SHORT)), contents(canonical(batch, LONG))
    assert 0 < len(early) < len(late)
    assert early.items() <= late.items()


@NAMES
def test_no_solver_takes_part_in_a_witness(name, programs):
    """What another solver, with other settings, would make of the problem cannot move it: labels
    are its check.
    """
    batch = batch_of(name, 30, seed=4)
    found = contents(canonical(batch))
    answers = decide_all(Exact(programs=programs, time_limit_s=np.inf), batch).outcomes
    other = decide_all(Exact(programs=OraclePrograms(), time_limit_s=np.inf), batch).outcomes
    for k, (ours, theirs) in enumerate(zip(answers, other, strict=True)):
        assert ours.status is theirs.status
        if k in found:
            assert ours.solution.to_json() == theirs.solution.to_json() == found[k]
    assert len(found) > 10


@NAMES
def test_nothing_infeasible_is_ever_claimed(name, programs):
    batch = batch_of(name, 60)
    planner = Exact(programs=programs, time_limit_s=np.inf)
    infeasible = {
        k
        for k, problem in enumerate(batch.problems)
        if planner.solve(problem).status is Status.INFEASIBLE
    }
    assert infeasible
    assert not infeasible & set(canonical(batch))


def test_a_claim_that_the_verifier_refuses_is_none():
    batch = batch_of("ground-3", 40)
    assert canonical(batch)
    assert canonical(batch, tolerance=-1.0) == {}


def test_of_nothing_nothing_is_found(programs):
    nothing = batch_of("wall-3", 0)
    assert canonical(nothing) == {}
    assert decide_all(Exact(programs=programs), nothing).outcomes == []


@pytest.mark.parametrize("low", [0.0, 0.2])
def test_forces_stay_in_boxes_that_cut_the_cones(low):
    batch = batch_of("ground-3", 80)
    contacts = tuple(
        replace(c, force_min=np.array([low, -0.14, -0.14]), force_max=np.array([0.5, 0.14, 0.14]))
        for c in batch.like.contacts
    )
    narrow = replace(batch, like=batch.like.posture_with(contacts=contacts))
    found = canonical(narrow)
    assert 10 < len(found) < len(canonical(batch))
    for posture, _ in found.values():
        assert check_plan(posture).accepted
    normal = min(
        float(c.patch.frame[:, 0] @ f)
        for k, (a, _) in found.items()
        for c, f in zip(narrow.problems[k].contacts, a.forces_n[0], strict=True)
    )
    assert normal > low * narrow.like.force_scale_n


@pytest.mark.parametrize("read_only", ["tilt_limit_rad", "com_radius_m"])
def test_a_body_that_may_not_move_has_no_middle_and_is_left_to_the_search(read_only, programs):
    batch = batch_of("ground-3", 20)
    stiff = replace(batch, like=batch.like.posture_with(**{read_only: 0.0}))
    assert canonical(stiff) == {}
    answers = decide_all(Exact(programs=programs, time_limit_s=np.inf), stiff).outcomes
    assert sum(answer.status is Status.FEASIBLE for answer in answers) > 10


@NAMES
def test_a_batch_is_decided_as_its_problems_are_one_by_one(name, programs):
    planner = Exact(programs=programs, acceptance=Acceptance(), time_limit_s=np.inf)
    batch = batch_of(name, 40, seed=8)
    answers, found = decide_all(planner, batch).outcomes, contents(canonical(batch))
    for k, (together, problem) in enumerate(zip(answers, batch.problems, strict=True)):
        alone = planner.solve(problem)
        assert (together.status, together.method) == (alone.status, alone.method)
        assert together.bound == pytest.approx(alone.bound, rel=1e-12)
        assert together.details["trivial"] == alone.details["trivial"]
        if alone.solution is not None:
            assert check_plan(together.solution).worst == pytest.approx(
                together.residual, abs=1e-15
            )
            assert k not in found or together.solution.to_json() == found[k]
        if alone.certificate is not None:
            assert (together.effort.solves, dict(together.details)) == (
                alone.effort.solves,
                dict(alone.details),
            )
            assert together.certificate.to_json() == alone.certificate.to_json()
    assert {answer.status for answer in answers} == {Status.FEASIBLE, Status.INFEASIBLE}


def test_what_neither_iteration_nor_lift_decides_goes_through_the_search(programs, monkeypatch):
    planner = Exact(
        programs=programs, acceptance=Acceptance(gap=0.3), max_nodes=3, time_limit_s=np.inf
    )
    batch = batch_of("wall-3", 40)
    asked = []
    solve = Exact.solve
    with monkeypatch.context() as patch:
        patch.setattr(
            Exact, "solve", lambda it, one, root: asked.append(one) or solve(it, one, root=root)
        )
        answers = decide_all(planner, batch).outcomes
    assert 0 < len(asked) < 40
    assert [a.status for a in answers] == [planner.solve(p).status for p in batch.problems]
    assert Status.UNDECIDED in {a.status for a in answers}


def test_an_iteration_that_is_gone_on_with_for_some_comes_to_the_same_points_as_one_that_begins_anew():
    scaled = ScaledBatch.of(batch_of("wall-3", 60))
    whole, points = witnesses(scaled, LONG)
    early = Iteration(scaled)
    first, begun = early.claims(96)
    assert 0 < len(first) < len(whole)
    assert not np.isin(first, early.index).any()
    some = np.setdiff1d(whole, first)[::2]
    early.keep(some)
    then, rest = early.claims(LONG)
    np.testing.assert_array_equal(then, some)
    for index, of in ((first, begun), (then, rest)):
        for name in ("com", "rotation", "toes", "forces"):
            there = getattr(points, name)[np.searchsorted(whole, index)]
            np.testing.assert_array_equal(getattr(of, name), there)
    assert len(Iteration(scaled.select(some[:0])).claims(LONG)[0]) == 0


def test_what_the_search_finds_is_put_into_the_middle_of_what_its_toes_leave(programs, monkeypatch):
    planner, batch = Exact(programs=programs, time_limit_s=np.inf), batch_of("ground-3", 30)
    easy = contents(canonical(batch))
    empty = (np.zeros(0, dtype=np.intp), PointBatch.none(3))
    real = Iteration.claims
    held = []

    def none_but_of_held_toes(iteration, until):
        if np.ptp(iteration.scaled.vertices, axis=2).max(initial=0.0) > 0.0 or not len(
            iteration.scaled
        ):
            return empty
        held.append(len(iteration.scaled))
        return real(iteration, until)

    monkeypatch.setattr(Iteration, "claims", none_but_of_held_toes)
    answers = decide_all(planner, batch).outcomes
    assert sum(held) >= len(easy)
    for k in easy:
        found, alone = answers[k].solution, planner.solve(batch.problems[k]).solution
        np.testing.assert_allclose(found.toes_m, alone.toes_m, atol=1e-12)
        assert not np.allclose(found.forces_n, alone.forces_n, atol=1e-3)
