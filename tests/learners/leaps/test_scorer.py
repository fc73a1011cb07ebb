"""Learned scores of candidates: symmetries that hold by construction, a planted rule that is found,
and files.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

import stancekit
from stancekit.learners.leaps.kinds import FORMAT
from stancekit.learners.leaps.policy import (
    _LEAP_SIGNS,
    _SIGNS,
    LeapScorer,
    ScoreNetwork,
    ScorerSettings,
    _fit_scales,
    _loss,
    _rows,
    _Tries,
    with_caps,
)
from stancekit.learners.selectors.network import write_tensors
from stancekit.planners.leap.finder import LeapFinder
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import OF_CANDIDATE, LeapFeatures
from stancekit.planners.problem.leap import BodyState
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.robot.model import Limb
from stancekit.planners.terrain.patch import Patch
from tests.refusals import refuses

ACROSS = np.array([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def tries(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tries") / "base"
    return stancekit.label("leap-base", folder, scenes=6, tries={"random": 3, "rule": 3}, seed=8)


def drawn(seed=0, name="leap-hard"):
    return leap_class(name).draw(np.random.default_rng(seed))


def mirrored(leap):
    """The same leap in the mirror y → −y."""

    def patch(old):
        return Patch(
            vertices_m=(old.vertices_m * ACROSS)[::-1],
            normal=old.normal * ACROSS,
            friction=old.friction,
            shear_reference=old.shear_reference * ACROSS,
        )

    def state(old):
        turned = -ACROSS  # of vectors along axes of rotation
        return BodyState(
            com_m=old.com_m * ACROSS,
            velocity_m_s=old.velocity_m_s * ACROSS,
            momentum_m2_s=old.momentum_m2_s * turned,
            rotation_rad=old.rotation_rad * turned,
        )

    def limb(old):
        leg = None if old.leg is None else replace(old.leg, hip_m=old.leg.hip_m * ACROSS)
        return Limb(name=old.name, shoulder_m=old.shoulder_m * ACROSS, reach_m=old.reach_m, leg=leg)

    robot = replace(leap.robot, limbs=tuple(map(limb, leap.robot.limbs)))
    footholds = tuple(
        replace(each, candidates=tuple(map(patch, each.candidates))) for each in leap.footholds
    )
    return replace(
        leap, robot=robot, footholds=footholds, start=state(leap.start), goal=state(leap.goal)
    )


def test_features_of_a_mirrored_leap_are_mirrored():
    for seed in range(3):
        leap = drawn(seed)
        one, other = (LeapFeatures.of(LeapNumbers.of(each)) for each in (leap, mirrored(leap)))
        signs = _SIGNS.numpy()[: len(OF_CANDIDATE)]
        np.testing.assert_allclose(other.candidates, one.candidates * signs, atol=1e-9)
        np.testing.assert_allclose(other.leap, one.leap * _LEAP_SIGNS.numpy(), atol=1e-12)


@pytest.mark.parametrize("kind", ["additive", "set"])
def test_the_order_of_candidates_and_of_toes_does_not_matter(kind):
    torch.manual_seed(0)
    network = ScoreNetwork(kind).eval()
    seen = LeapFeatures.of(LeapNumbers.of(drawn(3)))
    inputs = [
        torch.as_tensor(each, dtype=torch.float32)[None]
        for each in (with_caps(seen.candidates), seen.mask)
    ]
    leap = torch.as_tensor(seen.leap, dtype=torch.float32)[None]
    with torch.no_grad():
        scores, odds = network(*inputs, leap)
        toes, places = torch.randperm(8), torch.randperm(8)
        turned, same = network(*(each[:, toes][:, :, places] for each in inputs), leap)
    torch.testing.assert_close(turned, scores[:, toes][:, :, places], atol=2e-5, rtol=1e-4)
    torch.testing.assert_close(same, odds, atol=2e-5, rtol=1e-4)


def test_a_planted_rule_is_learned():
    generator = torch.Generator().manual_seed(1)
    count, feet, options, tried = 200, 4, 5, 12
    features = torch.randn(count, feet, options, len(_SIGNS), generator=generator)
    choice = torch.randint(options, (count, tried, feet), generator=generator)
    planted = 2.0 * features[..., 3] - features[..., 5]
    picked = torch.gather(planted[:, None].expand(-1, tried, -1, -1), 3, choice[..., None])[
        ..., 0
    ].sum(dim=2)
    rows = _Tries(
        candidates=features,
        mask=torch.ones(count, feet, options),
        leap=torch.randn(count, len(_LEAP_SIGNS)),
        choice=choice,
        solved=(picked > 1.0).float(),
        there=torch.ones(count, tried),
    )
    network = ScoreNetwork("additive")
    _fit_scales(network, rows)
    optimiser = torch.optim.Adam(network.parameters(), lr=0.05)
    for _ in range(150):
        optimiser.zero_grad()
        _loss(network, rows, 1.0).backward()
        optimiser.step()
    weights = network.linear.weight.detach()[0] / network.scale
    assert set(weights.abs().topk(2).indices.tolist()) == {3, 5}
    assert float(weights[3] / weights[5]) == pytest.approx(-2.0, rel=0.2)


@pytest.mark.parametrize("kind", ["additive", "set"])
def test_scores_are_learned_from_tries_written_read_and_planned_with(kind, tries, tmp_path):
    scorer = stancekit.fit(tries, kind, epochs=3, seed=2)
    again = stancekit.fit(tries, kind, epochs=3, seed=2)
    numbers = LeapNumbers.of(drawn(5))
    np.testing.assert_array_equal(scorer.scores(numbers), again.scores(numbers))
    stancekit.save(scorer, tmp_path / "scores.safetensors")
    read = stancekit.load(tmp_path / "scores.safetensors", LeapScorer)
    np.testing.assert_array_equal(read.scores(numbers), scorer.scores(numbers))
    assert read.origin["class"] == "leap-base"
    answer = stancekit.plan("leap-base:1", LeapFinder(rule=read, solves=20, proof=0))
    assert answer.solution is None or stancekit.verify(answer.solution).accepted


def test_scores_are_saved_under_a_name_that_is_read_back(tries, tmp_path):
    with refuses("s.json"):
        stancekit.save(stancekit.fit(tries, "additive", epochs=1), tmp_path / "s.json")
    assert not (tmp_path / "s.json").exists()


def test_the_best_pass_is_no_worse_than_the_first(tries):
    losses = [
        stancekit.fit(tries, "additive", epochs=n, rate=0.02).origin["held_out_loss"]
        for n in (1, 12)
    ]
    assert losses[1] < losses[0]


def test_what_learns_from_a_part_sees_nothing_of_the_other(tries):
    parts = tries.parts()
    assert set(parts) == {"train", "test"}
    counts = {
        part: sum(parts[scene] == part for scene in tries.tries()["scene"])
        for part in ("train", "test")
    }
    for part, count in counts.items():
        assert _rows(tries, part).there.sum() == count
    train, test = (_rows(tries, part).leap for part in ("train", "test"))
    assert not (train[:, None] == test[None]).all(dim=2).any()
    assert (
        stancekit.fit(tries, "additive", part="train", epochs=1).origin["rows"] == counts["train"]
    )
    assert len(_rows(tries, "train", 2)) == 2
    with refuses("part"):
        stancekit.fit(tries, "additive", part="some")


def test_bad_input_is_refused_in_one_line(tries, tmp_path):
    with refuses("epochs"):
        stancekit.fit(tries, "set", epochs=0)
    with refuses("widht"):
        stancekit.fit(tries, "set", widht=3)
    rows = stancekit.label("wall-3", tmp_path / "rows", rows=(2, 2))
    with refuses():
        stancekit.fit(rows, "set")
    few = stancekit.label("leap-few", tmp_path / "few", scenes=2, tries={"random": 1}, seed=0)
    with refuses():
        stancekit.fit(few, "additive")
    assert ScorerSettings().epochs > 1


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"heads": 3}, "with its sizes"),
        ({"kind": "deep"}, "with its sizes"),
        ({"width": 10**9}, "with its sizes"),
        ({"layers": "two"}, "with its sizes"),
        ({"width": 32}, "tensor"),
    ],
)
def test_forged_files_are_refused_in_one_line(changed, name, tmp_path):
    network = ScoreNetwork("set")
    sizes = {"kind": "set", "width": 64, "layers": 2, "heads": 4, "origin": {}, **changed}
    write_tensors(tmp_path / "forged.safetensors", FORMAT, sizes, network.state_dict())
    with refuses("forged.safetensors", name):
        stancekit.load(tmp_path / "forged.safetensors")
