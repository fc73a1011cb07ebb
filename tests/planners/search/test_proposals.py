"""Proposals: what the verifier accepts is used, what it refuses changes nothing, and nobody is
believed.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.errors import InvalidInput
from stancekit.planners.search.batch import solve_all
from stancekit.planners.search.canonical import canonical
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses

CLASSES = ("wall-3", "ground-3", "wall-5")


@dataclass
class Said:
    """A proposer that says what it was told to, to whoever asks; asked: of how many problems."""

    points: PointBatch
    rows: np.ndarray
    digest: str = "said"
    asked: list[int] = field(default_factory=list)

    def check_fits(self, problem):
        pass

    def postures(self, scaled: ScaledBatch):
        some = min(len(scaled), len(self.points))
        return np.arange(some), self.points.select(np.arange(some))

    def proofs(self, scaled: ScaledBatch):
        self.asked.append(len(scaled))
        return np.resize(self.rows, (len(scaled), *self.rows.shape[1:]))


class Knowing(Said):
    """A proposer that was told the answers: postures and proofs of these outcomes, in the order of
    the batch.
    """

    def __init__(self, batch, outcomes):
        scaled = ScaledBatch.of(batch)
        self.of = {scaled.vertices[k].tobytes(): k for k in range(len(batch))}
        self.outcomes, self.contacts = outcomes, len(batch.like.contacts)
        super().__init__(
            PointBatch.none(self.contacts), np.zeros((len(batch), 1, 6 + 3 * self.contacts))
        )

    def postures(self, scaled):
        known = [
            (n, self.outcomes[self.of[scaled.vertices[n].tobytes()]].solution)
            for n in range(len(scaled))
        ]
        index = np.array([n for n, posture in known if posture is not None], dtype=np.intp)
        found = [posture for _, posture in known if posture is not None]
        like, some = scaled.like, scaled.select(index)
        pairs = some.pairs(found)
        com = np.array([each.com_m for each in found]).reshape(-1, 3) / like.length_m
        return index, PointBatch(
            com=com,
            rotation=np.array([each.rotation_rad for each in found]).reshape(-1, 3),
            toes=pairs[..., :3] + com[:, None],
            forces=pairs[..., 3:],
        )

    def proofs(self, scaled):
        rows = np.zeros((len(scaled), 1, 6 + 3 * self.contacts))
        for n in range(len(scaled)):
            certificate = self.outcomes[self.of[scaled.vertices[n].tobytes()]].certificate
            if certificate is not None and len(certificate.tree) == 1:
                rows[n, 0] = certificate.multipliers[0]
        return rows


def drawn(name, count=40, seed=0):
    return distribution(name).batch(np.random.default_rng(seed), count)


def verdicts(outcomes):
    return [(outcome.status, outcome.details["trivial"]) for outcome in outcomes]


def decided(programs, batch, proposers=None):
    return solve_all(
        ExactPlanner(programs=programs, time_limit_s=np.inf, proposers=proposers), batch
    )


def noise(name, size, contacts, rng):
    """Claims that are wrong: random ones, of absurd magnitude, or not finite."""
    scale = {"random": 1.0, "huge": 1e300, "tiny": 1e-300, "nan": np.nan, "inf": np.inf}[name]
    with np.errstate(all="ignore"):
        points = PointBatch(
            com=scale * rng.normal(size=(size, 3)),
            rotation=scale * rng.normal(size=(size, 3)),
            toes=scale * rng.normal(size=(size, contacts, 3)),
            forces=scale * rng.normal(size=(size, contacts, 3)),
        )
        return Said(points, scale * rng.normal(size=(size, 2, 6 + 3 * contacts)))


@pytest.mark.parametrize("name", CLASSES)
def test_what_is_right_settles_every_problem_that_it_is_of_without_a_solver(programs, name):
    batch = drawn(name)
    before = decided(programs, batch)
    after = decided(programs, batch, Knowing(batch, before))
    assert verdicts(after) == verdicts(before)
    leaf = [one.certificate is not None and len(one.certificate.tree) == 1 for one in before]
    refuted = [k for k, one in enumerate(leaf) if one and after[k].effort.solves == 0]
    assert len(refuted) >= 0.7 * sum(leaf) > 0
    for k in refuted:
        assert check_certificate(after[k].certificate.of(batch.problems[k])).accepted
        np.testing.assert_array_equal(
            after[k].certificate.multipliers, before[k].certificate.multipliers
        )
        assert after[k].bound == before[k].bound
    feasible = [k for k, one in enumerate(before) if one.status is Status.FEASIBLE]
    assert feasible
    assert all(after[k].effort.solves == 0 for k in feasible)
    assert all(check_plan(after[k].solution).accepted for k in feasible)


@pytest.mark.parametrize("name", CLASSES)
def test_a_witness_is_the_canonical_one_to_the_last_bit_whatever_posture_was_proposed(
    programs, name
):
    batch = drawn(name)
    before = decided(programs, batch)
    after = decided(programs, batch, Knowing(batch, before))
    ends = canonical(batch)
    assert len(ends) > 5
    for k in ends:
        for part in ("com_m", "rotation_rad", "toes_m", "forces_n"):
            np.testing.assert_array_equal(
                getattr(after[k].solution, part), getattr(before[k].solution, part)
            )


@pytest.mark.parametrize("kind", ["random", "huge", "tiny", "nan", "inf"])
def test_what_is_wrong_changes_no_verdict(programs, kind):
    batch, rng = drawn("wall-3", 60), np.random.default_rng(1)
    proposers = noise(kind, len(batch), 3, rng)
    before, after = decided(programs, batch), decided(programs, batch, proposers)
    assert verdicts(after) == verdicts(before)
    assert sum(proposers.asked) > 20


def test_answers_of_other_problems_change_no_verdict(programs):
    batch = drawn("wall-3", 60)
    before = decided(programs, batch)
    told = Knowing(batch, before)
    shifted = Said(
        told.postures(ScaledBatch.of(batch))[1],
        np.roll(told.proofs(ScaledBatch.of(batch)), 1, axis=0),
    )
    after = decided(programs, batch, shifted)
    assert verdicts(after) == verdicts(before)
    for problem, outcome in zip(batch.problems, after, strict=True):
        if outcome.certificate is not None:
            assert check_certificate(outcome.certificate.of(problem)).accepted


def test_a_proof_that_is_too_weak_for_the_gap_settles_nothing(programs):
    batch = drawn("wall-3")
    before = decided(programs, batch)
    planner = ExactPlanner(
        programs=programs, time_limit_s=np.inf, max_nodes=50, proposers=Knowing(batch, before)
    )
    finite = [one.bound for one in before if np.isfinite(one.bound) and one.bound > 0.0]
    planner.acceptance = replace(planner.acceptance, gap=1.01 * max(finite))
    looked = 0
    for outcome, was in zip(solve_all(planner, batch), before, strict=True):
        if 0.0 < was.bound < np.inf:
            looked += 1
            assert outcome.status is not Status.INFEASIBLE or outcome.bound > planner.acceptance.gap
    assert looked == len(finite) > 5


def test_proposers_of_other_problems_are_refused_before_anything_is_solved(programs):
    class Fussy(Said):
        def check_fits(self, problem):
            raise InvalidInput("contacts: expected other legs")

    proposers = Fussy(PointBatch.none(3), np.zeros((1, 1, 15)))
    batch = drawn("wall-3", 2)
    with refuses("contacts"):
        decided(programs, batch, proposers)
    assert not proposers.asked
