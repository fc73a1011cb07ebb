"""Douglas–Rachford witnesses are postures, whoever else is in the batch; batches are answered as one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.answer.outcome import Status
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.batch import easily_feasible, solve_all
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.witness import witnesses
from stancekit.planners.verify import check_posture

NAMES = pytest.mark.parametrize("name", list(DISTRIBUTIONS))
FOUND = {"wall-3": 0.35, "wall-5": 0.45, "ground-3": 0.8}
"""The shares of all samples that are easy are about 0.40, 0.51 and 0.87."""


@pytest.fixture(scope="module")
def programs():
    return Programs()


def batch_of(name, count=300, seed=3):
    return distribution(name).batch(np.random.default_rng(seed), count)


@NAMES
def test_every_claim_is_a_posture_and_most_easy_problems_have_one(name):
    batch = batch_of(name)
    claims = witnesses(ScaledBatch.of(batch))
    assert len(claims) > FOUND[name] * len(batch.problems)
    for k, posture in claims.items():
        assert check_posture(batch.problems[k], posture).accepted


@NAMES
def test_a_claim_does_not_depend_on_who_else_is_asked(name):
    batch = batch_of(name, 60)
    together = witnesses(ScaledBatch.of(batch))
    assert 0 < len(together) < len(batch.problems)
    for k in range(len(batch.problems)):
        alone = witnesses(ScaledBatch.of(batch.select(np.array([k]))))
        assert (0 in alone) == (k in together)
        if alone:
            assert alone[0].to_json() == together[k].to_json()


@NAMES
def test_nothing_infeasible_is_ever_claimed(name, programs):
    batch = batch_of(name, 120)
    answers = solve_all(ExactPlanner(programs=programs), batch)
    infeasible = {k for k, answer in enumerate(answers) if answer.status is Status.INFEASIBLE}
    assert infeasible
    assert not infeasible & set(easily_feasible(batch, 1e-6))


def test_a_claim_that_the_verifier_refuses_is_none():
    batch = batch_of("ground-3", 40)
    assert easily_feasible(batch, 1e-6)
    assert easily_feasible(batch, -1.0) == {}


def test_of_nothing_nothing_is_found():
    assert easily_feasible(batch_of("wall-3", 0), 1e-6) == {}


def test_forces_stay_in_boxes_that_cut_the_cones():
    batch = batch_of("ground-3", 80)
    contacts = tuple(
        replace(c, force_min=np.array([0.0, -0.3, -0.3]), force_max=np.array([0.5, 0.3, 0.3]))
        for c in batch.like.contacts
    )
    narrow = replace(batch, like=replace(batch.like, contacts=contacts))
    claims = witnesses(ScaledBatch.of(narrow))
    assert 10 < len(claims) < len(witnesses(ScaledBatch.of(batch)))
    for k, posture in claims.items():
        assert check_posture(narrow.problems[k], posture).accepted


@NAMES
def test_a_batch_is_answered_as_its_problems_are_one_by_one(name, programs):
    planner = ExactPlanner(programs=programs, acceptance=Acceptance(), time_limit_s=np.inf)
    batch = batch_of(name, 100, seed=8)
    answers = solve_all(planner, batch)
    for together, problem in zip(answers, batch.problems, strict=True):
        alone = planner.solve(problem)
        assert (together.status, together.method, together.solves) == (alone.status, alone.method, alone.solves)
        assert dict(together.details) == dict(alone.details)
        assert together.lower_bound == pytest.approx(alone.lower_bound, rel=1e-12)
        if alone.posture is not None:
            assert together.posture.to_json() == alone.posture.to_json()
            assert together.residual == pytest.approx(alone.residual, abs=1e-15)
        if alone.certificate is not None:
            assert together.certificate.to_json() == alone.certificate.to_json()
    assert {answer.status for answer in answers} == {Status.FEASIBLE, Status.INFEASIBLE}


def test_what_the_root_leaves_open_goes_through_the_search(programs, monkeypatch):
    planner = ExactPlanner(programs=programs, acceptance=Acceptance(gap=0.3), max_nodes=3, time_limit_s=np.inf)
    batch = batch_of("wall-3", 40)
    asked = []
    solve = planner.solve
    monkeypatch.setattr(planner, "solve", lambda problem, root: asked.append(problem) or solve(problem, root=root))
    answers = solve_all(planner, batch)
    assert 0 < len(asked) < 40
    assert [a.status for a in answers] == [solve(p).status for p in batch.problems]
    assert Status.UNDECIDED in {a.status for a in answers}
