"""What is said before a lift is solved, and by searches that only want one answer, is what the
exact planner says.
"""

import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.scaled import Point
from stancekit.planners.projection.project import SURFACE, project
from stancekit.planners.search.batch import DIRECTIONS, stands, unsupported
from stancekit.planners.search.exact import Exact
from stancekit.planners.verify import check_certificates


@pytest.fixture(scope="module")
def drawn():
    """Problems of wall-3, their numbers, and what the exact planner says of each."""
    batch, planner = distribution("wall-3").batch(np.random.default_rng(2), 60), Exact()
    scaled = ScaledBatch.of(batch)
    return batch, scaled, planner, [planner.solve(problem) for problem in batch.problems]


def test_where_nothing_carries_the_weight_the_verifier_accepts_a_direction_as_the_proof(drawn):
    batch, scaled, _, outcomes = drawn
    found = np.flatnonzero(unsupported(scaled)).tolist()
    for k in found:
        proofs = [
            Certificate(tree=np.zeros((1, 5)), multipliers=np.array([[*-direction, *np.zeros(12)]]))
            for direction in DIRECTIONS
        ]
        assert np.isinf(check_certificates([proof.of(batch.problem(k)) for proof in proofs])).any()
        assert outcomes[k].details["trivial"]
    trivial = sum(outcome.details["trivial"] > 0.0 for outcome in outcomes)
    assert 0.6 * trivial < len(found) <= trivial


def test_what_stands_on_the_corners_near_its_shoulders_is_feasible_and_most_that_is_feasible_does(
    drawn,
):
    batch, scaled, planner, outcomes = drawn
    said = [
        stands(planner.kept, scaled.problem(k), scaled.near_corners[k]) for k in range(len(batch))
    ]
    feasible = [outcome.status is Status.FEASIBLE for outcome in outcomes]
    assert all(one for one, stood in zip(feasible, said, strict=True) if stood)
    assert sum(said) > 0.8 * sum(feasible) > 0


def test_no_corner_of_a_patch_is_nearer_to_the_shoulder(drawn):
    _, scaled, _, _ = drawn
    for k in range(len(scaled)):
        numbers = scaled.problem(k)
        for patch, corner, shoulder in zip(
            numbers.patches, scaled.near_corners[k], numbers.shoulders, strict=True
        ):
            away = np.linalg.norm(patch - numbers.com[0] - shoulder, axis=1)
            assert corner.tolist() == patch[away.argmin()].tolist()


def test_what_stands_is_what_fix_toes_leaves_no_moment_of(drawn):
    batch, scaled, planner, _ = drawn
    for k in range(len(batch)):
        numbers, toes = scaled.problem(k), scaled.near_corners[k]
        start = Point(
            com=np.zeros((1, 3)),
            rotation=np.zeros((1, 3)),
            toes=toes,
            forces=toes,
            residual=float("inf"),
        )
        left = project(planner.kept, "fix-toes", numbers, start).residual
        assert stands(planner.kept, numbers, toes) == (left <= SURFACE)


@pytest.mark.parametrize("wanted", [Status.FEASIBLE, Status.INFEASIBLE])
def test_a_search_for_one_answer_gives_that_answer_to_the_last_bit_and_else_never_another(
    drawn, wanted
):
    _, scaled, planner, _ = drawn
    met = 0
    for k in range(len(scaled)):
        whole, part = (planner.search(scaled.problem(k), wanted=want) for want in (None, wanted))
        claims = [None if search.found is None else search.found[1] for search in (whole, part)]
        proofs = [search.certificate() for search in (whole, part)]
        if wanted is Status.FEASIBLE and claims[0] is not None:
            assert np.array_equal(claims[0].toes, claims[1].toes)
            assert np.array_equal(claims[0].forces, claims[1].forces)
        elif wanted is Status.INFEASIBLE and proofs[0] is not None:
            assert np.array_equal(proofs[0].multipliers, proofs[1].multipliers)
        else:
            met += 1
            assert (claims if wanted is Status.FEASIBLE else proofs)[1] is None
    assert 0 < met < len(scaled)


def test_a_search_for_a_proof_ends_at_a_point_that_no_proof_can_be_above():
    """A problem whose least moment residual lies between what is feasible and what can be
    proved.
    """
    source, rng = distribution("wall-3"), np.random.default_rng(5)
    source.skip(rng, 73 * 64)
    numbers, planner = ScaledBatch.of(source.batch(rng, 64)).problem(52), Exact(max_nodes=40)
    assert planner.search(numbers).nodes > 40
    search = planner.search(numbers, wanted=Status.INFEASIBLE)
    assert search.stopped
    assert search.certificate() is None
    assert search.nodes == 1
