"""A surrogate answers for its class alone, alike for scenes that a symmetry maps onto each other, and
its file says what it is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import stancekit
from stancekit.envs.distributions.postures import distribution
from stancekit.learners.surrogates.features import Seer
from stancekit.learners.surrogates.surrogate import Surrogate
from stancekit.learners.surrogates.training import LabelledBatch
from stancekit.planners.problem import PostureBatch
from tests.refusals import assert_names, refuses

Data = tuple[stancekit.Dataset, Surrogate]


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Data:
    rows = stancekit.label("wall-3", tmp_path_factory.mktemp("rows") / "train", rows=(150, 150))
    return rows, stancekit.fit(rows, "surrogate", epochs=25, batch=32)


def drawn(name: str, count: int, seed: int = 9) -> PostureBatch:
    return distribution(name).batch(np.random.default_rng(seed), count)


def mirrored(batch: PostureBatch, turn: np.ndarray) -> PostureBatch:
    """The patches in a mirror, each at the limb that is there then."""
    shoulders = np.array([contact.shoulder_m for contact in batch.like.contacts])
    apart = np.abs((shoulders @ turn.T)[:, None] - shoulders[None]).max(axis=-1)
    back = np.argsort(apart.argmin(axis=1))
    return PostureBatch(
        like=batch.like,
        vertices_m=(batch.vertices_m @ turn.T)[:, back],
        normals=(batch.normals @ turn.T)[:, back],
        friction=batch.friction[:, back],
    )


@pytest.mark.parametrize(("name", "count"), [("wall-3", 2), ("ground-3", 2), ("ground-6", 4)])
def test_scenes_that_a_symmetry_maps_onto_each_other_have_one_view(name: str, count: int) -> None:
    batch = drawn(name, 40)
    seer = Seer.of(batch.like)
    assert len(seer.turns) == count
    plain = seer.features(batch)
    for turn in seer.turns:
        other = seer.features(mirrored(batch, turn))
        for ours, theirs in zip(plain, other, strict=True):
            total = ours.reshape(*ours.shape[:2], -1).sum(axis=-1)
            there = theirs.reshape(*theirs.shape[:2], -1).sum(axis=-1)
            assert np.allclose(np.sort(total, axis=1), np.sort(there, axis=1), atol=1e-4)


def test_a_mirrored_problem_has_the_same_verdict_and_the_same_answer(learned: Data) -> None:
    _, surrogate = learned
    batch = drawn("wall-3", 12)
    other = mirrored(batch, surrogate.seer.turns[1])
    for k in range(len(batch)):
        verdicts = {stancekit.solve(each.problem(k)).status for each in (batch, other)}
        assert len(verdicts) == 1
    assert np.allclose(surrogate.scores(batch)[0], surrogate.scores(other)[0], atol=1e-4)


def test_the_order_of_contacts_and_of_corners_changes_nothing(learned: Data) -> None:
    _, surrogate = learned
    tokens, corners = map(torch.from_numpy, surrogate.seer.features(drawn("wall-3", 30)))
    with torch.no_grad():
        plain = surrogate.network(tokens, corners)[0]
        swapped = surrogate.network(tokens[:, [2, 0, 1]], corners[:, [2, 0, 1]][:, :, [1, 2, 0]])[0]
    assert torch.allclose(plain, swapped, atol=1e-4)


def test_answers_do_not_depend_on_what_is_asked_beside(learned: Data) -> None:
    _, surrogate = learned
    batch = drawn("wall-3", 300)
    limits = surrogate.thresholds(0.1)
    whole = surrogate.answered(batch, limits, 0.1).answers
    parts = [
        surrogate.answered(batch.select(part), limits, 0.1).answers
        for part in np.split(np.arange(300), [1, 8, 150])
    ]
    assert whole.tolist() == np.concatenate(parts).tolist()


def test_the_error_is_held_on_fresh_rows(learned: Data, tmp_path: Path) -> None:
    _, surrogate = learned
    fresh = LabelledBatch.of([stancekit.label("wall-3", tmp_path / "f", rows=(200, 200), seed=1)])
    screened = surrogate.screen(fresh.batch, 0.15)
    assert screened.decided > 0.2
    for kind, wrong in (("feasible", "infeasible"), ("infeasible", "feasible")):
        mine = screened.answers[fresh.kinds == kind]
        assert (mine == wrong).mean() <= 0.15


def test_margins_have_the_sign_of_the_labels_where_they_are_large(learned: Data) -> None:
    rows, surrogate = learned
    batch = LabelledBatch.of([rows])
    margins = surrogate.screen(batch.batch, 0.5).margins
    sure = np.abs(margins) > 0.05
    assert sure.sum() > 20
    assert ((margins > 0.0) == (batch.kinds == "feasible"))[sure].mean() > 0.9


def test_what_lies_beyond_the_calibration_is_asked_of_others(learned: Data) -> None:
    _, surrogate = learned
    batch = drawn("wall-3", 50)
    far = replace(batch, vertices_m=batch.vertices_m + np.array([0.5, 0.0, 0.0]), convex=True)
    assert set(surrogate.screen(far, 0.4).answers.tolist()) == {"ask"}
    slippery = replace(batch, friction=batch.friction + 2.0, convex=True)
    assert set(surrogate.screen(slippery, 0.4).answers.tolist()) == {"ask"}


def test_a_batch_that_is_not_drawn_as_the_class_is_is_asked_of_others(learned: Data) -> None:
    rows, surrogate = learned
    batch = LabelledBatch.of([rows]).batch
    assert surrogate.screen(batch, 0.4).shifted == ""
    slick = replace(batch, friction=np.full_like(batch.friction, batch.friction.min()), convex=True)
    screened = surrogate.screen(slick, 0.4)
    assert set(screened.answers.tolist()) == {"ask"}
    assert screened.shifted.startswith(
        "problems: expected draws of wall-3, with any share of feasible, infeasible ones, got others: "
        "friction of "
    )
    assert surrogate.screen(slick.select(np.arange(20)), 0.4).shifted == ""


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("ground-3", "shear_reference"),
        ("wall-5", "contacts"),
    ],
)
def test_another_class_is_refused(learned: Data, name: str, line: str) -> None:
    with pytest.raises(stancekit.InvalidInput) as caught:
        stancekit.screen(stancekit.sample(name, 3), learned[1])
    assert_names(str(caught.value), line)


def test_another_body_is_refused(learned: Data) -> None:
    problem = stancekit.sample("wall-3")[0]
    heavy = problem.posture_with(mass_kg=11.0)
    with refuses():
        stancekit.screen(heavy, learned[1])
    pushed = problem.posture_with(wrench=[1.0, 0, 0, 0, 0, 0])
    with refuses("wrench"):
        stancekit.screen(pushed, learned[1])


@pytest.mark.parametrize("error", [0.0, 1.0, -1.0])
def test_an_error_of_0_or_1_is_refused(learned: Data, error: float) -> None:
    with refuses("error"):
        stancekit.screen(stancekit.sample("wall-3"), learned[1], error=error)


def test_a_file_gives_the_surrogate_back(learned: Data, tmp_path: Path) -> None:
    _, surrogate = learned
    surrogate.save(tmp_path / "s.safetensors")
    again = stancekit.load(tmp_path / "s.safetensors", Surrogate)
    assert again.digest == surrogate.digest
    assert again.provenance == surrogate.provenance
    batch = drawn("wall-3", 20)
    assert np.array_equal(again.scores(batch)[0], surrogate.scores(batch)[0])
    content = (tmp_path / "s.safetensors").read_bytes()
    for damaged in (content[:-100], content[:200], b"", b"{}"):
        (tmp_path / "d.safetensors").write_bytes(damaged)
        with pytest.raises(stancekit.InvalidInput) as caught:
            Surrogate.read(tmp_path / "d.safetensors")
        assert "\n" not in str(caught.value)
    for name, other in ((b"wall-3", b"wall-5"), (b'\\"heads\\": 4', b'\\"heads\\": 2')):
        assert content != content.replace(name, other)
        (tmp_path / "o.safetensors").write_bytes(content.replace(name, other))
        with refuses("digest"):
            Surrogate.read(tmp_path / "o.safetensors")


@pytest.mark.parametrize(
    ("how", "line"),
    [
        ({"calibration": 0.001}, "calibration"),
        ({"calibration": 0.999}, "calibration"),
        ({"rate": 1e300}, "rate"),
    ],
)
def test_settings_that_leave_nothing_are_refused(
    tmp_path: Path, how: dict[str, float], line: str
) -> None:
    from stancekit.learners.surrogates.training import SurrogateSettings, fit_surrogate

    rows = stancekit.label("wall-3", tmp_path / "w", rows=(8, 8))
    with pytest.raises(stancekit.InvalidInput) as caught:
        fit_surrogate([rows], SurrogateSettings(epochs=1, width=8, layers=1, **how))
    assert_names(str(caught.value), line)


def test_rows_of_two_classes_are_refused(learned: Data, tmp_path: Path) -> None:
    other = stancekit.label("ground-3", tmp_path / "g", rows=(2, 1))
    with refuses("wall-3"):
        stancekit.fit([learned[0], other], "surrogate")
    alone = stancekit.label("ground-3", tmp_path / "f", rows=(3, 0))
    with refuses("data set"):
        stancekit.fit(alone, "surrogate")
