"""Batches of posture problems are the problems one by one: the same numbers, the same refusals."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.terrain import Patch
from tests.refusals import refuses

NAMES = pytest.mark.parametrize("name", list(DISTRIBUTIONS))


def changed(batch, **parts):
    fields = {
        "like": batch.like,
        "vertices_m": batch.vertices_m,
        "normals": batch.normals,
        "friction": batch.friction,
    }
    return PostureBatch(**{**fields, **parts})


@NAMES
def test_a_problem_of_a_batch_is_the_validated_one_bit_for_bit(name):
    batch = distribution(name).batch(np.random.default_rng(1), 20)
    for problem in batch.problems:
        again = Problem.from_json(json.loads(json.dumps(problem.to_json())))
        assert again.to_json() == problem.to_json()
        for mine, theirs in zip(problem.contacts, again.contacts, strict=True):
            assert mine.patch.frame.tobytes() == theirs.patch.frame.tobytes()
            assert not mine.patch.vertices_m.flags.writeable
            assert not mine.patch.frame.flags.writeable


@NAMES
@pytest.mark.parametrize("size", [1, 2, 7])
def test_batches_of_any_size_draw_the_same_problems(name, size):
    whole = distribution(name).batch(np.random.default_rng(2), 14)
    rng = np.random.default_rng(2)
    parts = [distribution(name).batch(rng, size) for _ in range(14 // size)]
    for part in ("vertices_m", "normals", "friction", "frames"):
        assert (
            np.concatenate([getattr(batch, part) for batch in parts]).tobytes()
            == getattr(whole, part).tobytes()
        )
    assert [p.to_json() for p in whole.problems] == [
        p.to_json() for batch in parts for p in batch.problems
    ]


def test_the_stream_of_samples_is_the_one_it_always_was():
    problem = distribution("wall-3").sample(np.random.default_rng(7))
    rng = np.random.default_rng(7)
    for contact in problem.contacts:
        side = np.sign(contact.shoulder_m[1])
        x, y, z = rng.uniform([-0.15, -0.06, -0.15], [0.15, 0.06, 0.15])
        centre = [contact.shoulder_m[0] + x, side * (0.40 + y), contact.shoulder_m[2] + z]
        np.testing.assert_allclose(contact.patch.centre_m, centre, atol=1e-15)
        assert contact.patch.normal @ [0.0, -side, 0.0] == pytest.approx(
            np.cos(rng.uniform(0.0, np.deg2rad(30.0)))
        )
        rng.uniform(0.0, 2.0 * np.pi)
        radius = np.linalg.norm(contact.patch.vertices_m[0] - contact.patch.centre_m)
        assert radius == pytest.approx(rng.uniform(0.03, 0.08), abs=1e-15)
        rng.uniform(0.0, 2.0 * np.pi)
        assert contact.patch.friction == rng.uniform(0.1, 1.2)


def test_a_selection_is_those_problems():
    batch = distribution("wall-5").batch(np.random.default_rng(3), 6)
    chosen = batch.select(np.array([4, 1]))
    assert [p.to_json() for p in chosen.problems] == [batch.problem(k).to_json() for k in (4, 1)]


def test_what_a_patch_refuses_a_batch_refuses_and_says_where():
    batch = distribution("wall-3").batch(np.random.default_rng(4), 5)
    bent, crossed, thin = (batch.vertices_m.copy() for _ in range(3))
    bent[3, 1, 0] += 0.01 * batch.normals[3, 1]
    thin[2, 0] = thin[2, 0, [0, 1, 1]]
    quads = np.concatenate([crossed, crossed[:, :, :1]], axis=2)
    quads[1, 2, 3] += 0.01 * (quads[1, 2, 1] - quads[1, 2, 0])
    slippery, long, nowhere = batch.friction.copy(), 1.1 * batch.normals, batch.vertices_m.copy()
    slippery[4, 2], nowhere[0, 0, 0, 0] = -0.1, np.nan
    for parts, where in (
        ({"vertices_m": bent}, (3, 1)),
        ({"vertices_m": thin}, (2, 0)),
        ({"vertices_m": quads}, (1, 2)),
    ):
        with pytest.raises(InvalidInput) as error:
            changed(batch, **parts)
        k, i = where
        with pytest.raises(InvalidInput) as alone:
            Patch(
                vertices_m=parts["vertices_m"][k, i],
                normal=batch.normals[k, i],
                shear_reference=batch.shear_references[i],
                friction=0.5,
            )
        assert str(error.value) == f"problems[{k}].contacts[{i}].{alone.value}"
    for parts, message in (
        ({"friction": slippery}, "problems[4].contacts[2].friction"),
        ({"normals": long}, "problems[0].contacts[0].normal"),
        ({"normals": batch.normals[:, :2]}, "normals"),
        (
            {"vertices_m": batch.vertices_m[:, :, :2]},
            "vertices_m",
        ),
    ):
        with refuses(message):
            changed(batch, **parts)
    with refuses("vertices_m"):
        changed(batch, vertices_m=nowhere)


def test_a_corner_given_twice_is_no_defect_in_a_batch_either():
    batch = distribution("ground-3").batch(np.random.default_rng(5), 3)
    doubled = np.concatenate([batch.vertices_m, batch.vertices_m[:, :, 2:]], axis=2)
    assert len(changed(batch, vertices_m=doubled).problem(2).contacts[0].patch.vertices_m) == 4
