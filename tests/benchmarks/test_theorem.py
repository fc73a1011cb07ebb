"""The conditions of Lin et al.'s theorem: boxes for which they are known, and what they imply."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stancekit
from stancekit.envs.data.dataset import scenes_of
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick, domain_of
from stancekit.planners.search.exact import Exact

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def theorem():
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("theorem")
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return stancekit.label(
        "wall-3", tmp_path_factory.mktemp("theorem") / "set", rows=(6, 6), seed=5
    )


@pytest.fixture(scope="module")
def asked(theorem, rows):
    """Rows that hold, break and are left open, by condition, and the scenes."""
    scenes = scenes_of(rows)

    def ask(*boxes, most=None):
        return theorem.conditions(boxes, dict(enumerate(scenes[:most]))), scenes

    return ask


def broken(found):
    return [row for row, holds in found.items() if holds is False]


def test_a_box_around_everything_meets_the_first_condition_and_breaks_the_second(
    theorem, rows, asked
):
    domains = [domain_of(Scaled.of(problem)) for problem in rows.problems()]
    every = Envelope(
        low=np.min([one.low for one in domains], axis=0),
        high=np.max([one.high for one in domains], axis=0),
    )
    found, scenes = asked(every)
    assert tuple(found) == tuple(theorem.TITLES)
    assert list(found["1"].values()) == [True] * 6
    assert broken(found["2"]) == [k for k, scene in enumerate(scenes) if not scene.feasible]


def test_a_box_that_holds_nothing_meets_the_second_and_breaks_the_first(asked):
    nowhere = Envelope(low=np.full((3, 6), 0.98), high=np.full((3, 6), 0.99))
    found, scenes = asked(nowhere)
    assert broken(found["1"]) == [k for k, scene in enumerate(scenes) if scene.feasible]
    assert broken(found["2"]) == broken(found["2-p1"]) == []
    assert found["3-p"] == found["3-f"] == {}


def test_a_box_of_one_solution_is_met_by_its_scene_and_decided_for_all(asked, rows):
    k, scene = next((k, scene) for k, scene in enumerate(scenes_of(rows)) if scene.feasible)
    posture = Exact().solve(scene.problem).solution
    at = Scaled.of(scene.problem).point(posture)
    found, _ = asked(Envelope(low=at - 1e-5, high=at + 1e-5))
    assert found["1"][k]
    assert None not in found["1"].values()


def test_the_second_as_printed_holds_nowhere_where_p1_does_not_refuse(theorem, asked, tmp_path):
    train = stancekit.label("wall-3", tmp_path / "train", rows=(12, 6), seed=6)
    found, _ = asked(*stancekit.fit(train, "quantile").envelopes.envelopes)
    assert set(broken(found["2-p1"])) <= set(broken(found["2"]))
    assert len(found["3-p"]) == len(found["3-f"]) <= 6
    row = theorem.as_row("box", "2", found["2"])
    assert row["broken"] == broken(found["2"])
    assert row["holds"].startswith(f"{6 - len(row['broken'])} of 6, ")


def test_a_projection_that_the_solver_gave_up_breaks_nothing(theorem, asked, rows, monkeypatch):
    given_up = SimpleNamespace(residual=np.inf)
    monkeypatch.setattr(theorem, "project", lambda *_: given_up)
    domains = [domain_of(Scaled.of(problem)) for problem in rows.problems()]
    low, high = (np.mean([getattr(one, end) for one in domains], axis=0) for end in ("low", "high"))
    found, _ = asked(Envelope(low=low, high=high), most=3)
    for condition in (found["3-p"], found["3-f"]):
        assert set(condition.values()) == {None}


@pytest.mark.parametrize("products", [False, True])
def test_corners_lie_in_the_box_and_where_the_margin_of_p1_says(theorem, products, programs):
    rng, seen = np.random.default_rng(8), set()
    for k in range(8):
        scaled = Scaled.of(DISTRIBUTIONS["wall-3"].sample(rng))
        whole, share = domain_of(scaled), (1.0, 0.8, 0.5)[k % 3]
        middle, half = 0.5 * (whole.low + whole.high), 0.5 * share * (whole.high - whole.low)
        box = Envelope(low=middle - half, high=middle + half)
        slope = rng.standard_normal(box.low.shape)
        margin = programs.get(McCormick, scaled.layout).solve(scaled, box).margin
        point, known = theorem.towards(scaled, box, slope, products=products)
        assert known
        assert point is not None or margin > 0.0
        if products and abs(margin) > 1e-5:
            assert (point is not None) == (margin < 0.0)
        if point is not None:
            at = np.hstack([point.toes - point.com, point.forces])
            assert (at >= box.low - 1e-5).all()
            assert (at <= box.high + 1e-5).all()
        seen.add(margin < 0.0)
    assert seen == {False, True}
