"""Proposers: their sums are the verifier's, training is without labels and repeatable, labels do
not move.
"""

import numpy as np
import pytest
import torch

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.label_plan import LabelPlan
from stancekit.envs.distributions.postures import distribution
from stancekit.learners.data.labelling import label, recheck
from stancekit.learners.proposers import proof, witness
from stancekit.learners.proposers.proposer import FORMAT, Proposers, networks
from stancekit.learners.proposers.scenes import Scenes
from stancekit.learners.proposers.training import ProposerSettings, train_proposers
from stancekit.learners.selectors.network import Architecture
from stancekit.learners.selectors.tensors import read_tensors, write_tensors
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.errors import InvalidInput
from stancekit.planners.search.batch import solve_all
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.verify import check_certificates, check_postures

CLASSES = ("wall-3", "ground-3", "wall-5")
SMALL = ProposerSettings(
    architecture=Architecture(width=16, layers=1, heads=2, corner_width=8),
    proofs=80,
    postures=20,
    batch=128,
    pool=1024,
    draws=4096,
    held=256,
)


@pytest.fixture(scope="module")
def trained():
    """Proposers for wall-3 after a few seconds of training."""
    return train_proposers(distribution("wall-3"), SMALL)


def untrained(name, seed=0):
    """Proposers with random weights."""
    source = distribution(name)
    like = source.sample(np.random.default_rng(0))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        both = networks(SMALL.architecture)
    return Proposers(
        both,
        problem_class=name,
        legs=like.legs,
        robot=like.robot.identity,
        force_scale_n=like.force_scale_n,
        length_scale_m=like.length_scale_m,
    )


def drawn(name, count, seed=3):
    return distribution(name).batch(np.random.default_rng(seed), count)


@pytest.mark.parametrize("name", CLASSES)
def test_a_claimed_posture_breaks_what_the_verifier_says_it_breaks(name):
    batch, rng = drawn(name, 20), np.random.default_rng(0)
    scaled = ScaledBatch.of(batch)
    scenes, contacts = Scenes.of(scaled, torch.float64), len(batch.like.contacts)
    said = (
        torch.tensor(rng.normal(size=(20, contacts, 6))),
        torch.tensor(rng.normal(size=(20, 6))),
    )
    found = witness.claims(scenes, *said)
    parts = {key: getattr(found, key).numpy() for key in ("com", "rotation", "toes", "forces")}
    postures = scaled.plans(PointBatch(**parts), batch.problems)
    ours = found.violation.amax(dim=1).numpy()
    assert (ours > 1e-3).any()
    bounds = ("force_bounds",)  # the shear's are the verifier's alone
    theirs = check_postures(postures, without=bounds)
    cones = found.violation.reshape(20, 4, contacts)[:, [0, 3]].amax(dim=(1, 2)).numpy()
    np.testing.assert_allclose(theirs, np.maximum(cones, 0.0), atol=1e-8)


@pytest.mark.parametrize("name", CLASSES)
def test_a_claimed_proof_proves_no_more_than_the_verifier_finds(programs, name):
    batch = drawn(name, 120)
    scaled = ScaledBatch.of(batch)
    outcomes = solve_all(ExactPlanner(programs=programs), batch)
    leaf = [
        k
        for k, one in enumerate(outcomes)
        if one.certificate is not None and len(one.certificate.tree) == 1
    ]
    assert len(leaf) > 2
    rows = np.stack([outcomes[k].certificate.multipliers[0] for k in leaf])
    rows = np.concatenate([rows, np.random.default_rng(0).normal(size=rows.shape)])
    index = np.array(leaf * 2)
    values = proof.least_values(
        Scenes.of(scaled.select(index), torch.float64), torch.tensor(rows)[:, None]
    )[:, 0]
    assert (values[: len(leaf)] > 0.0).sum() > 0.7 * len(leaf)
    certificates = [Certificate(tree=np.zeros((1, 5)), multipliers=row[None]) for row in rows]
    bounds = check_certificates(
        [one.of(batch.problems[k]) for k, one in zip(index, certificates, strict=True)]
    )
    moments = np.abs(rows[:, 3:6]).sum(axis=1)
    for value, bound, moment in zip(values.tolist(), bounds, moments, strict=True):
        if value > 1e-4 and moment > 0.0:
            assert bound * moment >= value - 1e-4


def test_settled_grows_with_training_and_needs_no_label(trained):
    history = trained.provenance["history"]["proofs"]
    assert history[-1]["settled"] > 0.15 > history[0]["settled"]


def test_equal_settings_give_equal_networks_and_another_seed_others(trained):
    again = train_proposers(distribution("wall-3"), SMALL)
    assert again.digest == trained.digest
    assert untrained("wall-3", 1).digest != untrained("wall-3", 0).digest


def test_trained_proposals_change_no_verdict_and_settle_some_without_a_solver(programs, trained):
    batch = drawn("wall-3", 200)
    before = solve_all(ExactPlanner(programs=programs), batch)
    after = solve_all(ExactPlanner(programs=programs, proposers=trained), batch)
    assert [one.details["trivial"] for one in after] == [one.details["trivial"] for one in before]
    assert [one.status for one in after] == [one.status for one in before]
    assert (
        sum(one.effort.solves == 0 for one in after)
        > sum(one.effort.solves == 0 for one in before) + 10
    )


@pytest.mark.parametrize("name", CLASSES)
def test_random_weights_change_no_verdict(programs, name):
    batch = drawn(name, 60)
    before = solve_all(ExactPlanner(programs=programs), batch)
    after = solve_all(ExactPlanner(programs=programs, proposers=untrained(name)), batch)
    assert [(one.status, one.details["trivial"]) for one in after] == [
        (one.status, one.details["trivial"]) for one in before
    ]


def test_labels_are_the_same_and_what_is_learned_from_them_to_the_last_bit(tmp_path, trained):
    plan = {"distribution": "wall-3", "feasible": 8, "infeasible": 32, "shard_size": 20, "seed": 4}
    label(LabelPlan(**plan), tmp_path / "without")
    label(LabelPlan(**plan, proposers=trained.digest), tmp_path / "with", proposers=trained)
    without, asked = Dataset.open(tmp_path / "without"), Dataset.open(tmp_path / "with")
    assert recheck(asked).accepted
    saved = 0
    for mine, theirs in zip(asked.rows(), without.rows(), strict=True):
        assert (mine.sample, mine.kind) == (theirs.sample, theirs.kind)
        np.testing.assert_array_equal(mine.point, theirs.point)
        saved += mine.solves < theirs.solves
    assert saved > 5
    assert asked.header.digest != without.header.digest
    message = f"^.*proposers: expected None as planned, got '{trained.digest}'$"
    with pytest.raises(InvalidInput, match=message):
        label(LabelPlan(**plan), tmp_path / "with")


def test_labels_are_not_made_with_proposers_that_were_not_planned(tmp_path, trained):
    plan = LabelPlan(distribution="wall-3", feasible=1, infeasible=0)
    with pytest.raises(InvalidInput, match=r"^proposers: expected the digest that the plan has, "):
        label(plan, tmp_path / "data", proposers=trained)


def test_a_file_gives_back_what_was_written(tmp_path, trained):
    trained.save(tmp_path / "a.safetensors")
    again = Proposers.load(tmp_path / "a.safetensors")
    assert (again.digest, again.provenance) == (trained.digest, trained.provenance)
    scaled = ScaledBatch.of(drawn("wall-3", 30))
    np.testing.assert_array_equal(again.proofs(scaled), trained.proofs(scaled))


def test_proposers_of_other_problems_say_so(tmp_path, trained):
    trained.save(tmp_path / "a.safetensors")
    with pytest.raises(
        InvalidInput, match=r"a\.safetensors: expected proposers for ground-3, got some for wall-3$"
    ):
        Proposers.load(tmp_path / "a.safetensors", problem_class="ground-3")
    legs = r"^contacts: expected legs \['RF', 'RR', 'LM'\] for proposers learned for wall-3, got "
    with pytest.raises(InvalidInput, match=legs):
        trained.check_fits(drawn("wall-5", 1).like)
    with pytest.raises(
        InvalidInput, match=r"^proposers: expected some for ground-3, got some for wall-3$"
    ):
        trained.check_drawn(distribution("ground-3"))
    own = drawn("wall-3", 1).like
    trained_of = Proposers(
        trained.network,
        problem_class="wall-3",
        legs=own.legs,
        robot="else",
        force_scale_n=1.0,
        length_scale_m=1.0,
    )
    expected = r"^robot: expected else for proposers learned for wall-3, got the default hexapod$"
    with pytest.raises(InvalidInput, match=expected):
        trained_of.check_fits(own)


def test_weights_that_are_not_numbers_and_foreign_files_are_refused(tmp_path, trained):
    path = tmp_path / "a.safetensors"
    trained.save(path)
    header, tensors = read_tensors(path, FORMAT)
    name = sorted(tensors)[0]
    write_tensors(
        path, FORMAT, header, {**tensors, name: torch.full_like(tensors[name], torch.nan)}
    )
    with pytest.raises(InvalidInput, match=r"a\.safetensors: tensor .*: expected finite numbers$"):
        Proposers.load(path)
    write_tensors(path, "stancekit/proposers/2", header, tensors)
    with pytest.raises(
        InvalidInput, match=r"expected format stancekit/proposers/1, got stancekit/proposers/2$"
    ):
        Proposers.load(path)
    write_tensors(
        path, FORMAT, header, {key: value for key, value in tensors.items() if key != name}
    )
    with pytest.raises(InvalidInput, match=r"a\.safetensors: tensor .*: expected shape"):
        Proposers.load(path)
