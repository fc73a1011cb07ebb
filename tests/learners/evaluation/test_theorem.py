"""The conditions of Lin et al.'s theorem: boxes for which they are known, and what they imply."""

from types import SimpleNamespace

import numpy as np
import pytest

import stancekit
from stancekit import selectors
from stancekit.envs.data.scenes import scenes_of
from stancekit.learners.evaluation.theorem import TITLES, theorem
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.domain import domain_of
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.search.exact import ExactPlanner
from tests.refusals import refuses


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return stancekit.label(
        "wall-3", tmp_path_factory.mktemp("theorem") / "set", rows=(6, 6), seed=5
    )


def asked(rows, *boxes):
    scenes = scenes_of(rows)
    envelopes = EnvelopeSet.for_problems("wall-3", list(rows.problems()), boxes)
    return theorem("box", envelopes, scenes, range(len(scenes))).conditions, scenes


def test_a_box_around_everything_meets_the_first_condition_and_breaks_the_second(rows):
    domains = [domain_of(Scaled.of(problem)) for problem in rows.problems()]
    every = Envelope(
        low=np.min([one.low for one in domains], axis=0),
        high=np.max([one.high for one in domains], axis=0),
    )
    found, scenes = asked(rows, every)
    assert tuple(found) == tuple(TITLES)
    assert (found["1"].holds.hits, found["1"].holds.of, found["1"].broken) == (6, 6, ())
    assert found["2"].broken == tuple(k for k, scene in enumerate(scenes) if not scene.feasible)


def test_a_box_that_holds_nothing_meets_the_second_and_breaks_the_first(rows):
    nowhere = Envelope(low=np.full((3, 6), 0.98), high=np.full((3, 6), 0.99))
    found, scenes = asked(rows, nowhere)
    assert found["1"].broken == tuple(k for k, scene in enumerate(scenes) if scene.feasible)
    assert found["2"].broken == found["2-p1"].broken == ()
    assert found["3-p"].holds.of == found["3-f"].holds.of == 0


def test_a_box_of_one_solution_is_met_by_its_scene_and_decided_for_all(rows):
    scenes = scenes_of(rows)
    k, scene = next((k, scene) for k, scene in enumerate(scenes) if scene.feasible)
    posture = ExactPlanner().solve(scene.problem).solution
    at = Scaled.of(scene.problem).point(posture)
    found, _ = asked(rows, Envelope(low=at - 1e-5, high=at + 1e-5))
    assert k not in found["1"].broken
    assert not found["1"].undecided


def test_the_second_as_printed_holds_nowhere_where_p1_does_not_refuse(rows, tmp_path):
    train = stancekit.label("wall-3", tmp_path / "train", rows=(12, 6), seed=6)
    boxes = stancekit.fit(train, "quantile").envelopes
    found = selectors.theorem(boxes, rows).conditions
    assert set(found["2-p1"].broken) <= set(found["2"].broken)
    assert found["3-p"].holds.of == found["3-f"].holds.of <= 6
    one, two = (selectors.theorem(boxes, rows, workers=count) for count in (1, 2))
    assert one == two


def test_a_projection_that_the_solver_gave_up_breaks_nothing(rows, monkeypatch):
    given_up = SimpleNamespace(residual=np.inf)
    monkeypatch.setattr("stancekit.learners.evaluation.theorem.project", lambda *_: given_up)
    domains = [domain_of(Scaled.of(problem)) for problem in rows.problems()]
    low, high = (np.mean([getattr(one, end) for one in domains], axis=0) for end in ("low", "high"))
    found, _ = asked(rows, Envelope(low=low, high=high))
    for condition in (found["3-p"], found["3-f"]):
        assert len(condition.undecided) == condition.holds.of > 0
        assert not condition.broken


def test_envelopes_of_another_class_and_rows_without_labels_are_refused(rows, tmp_path):
    other = stancekit.label("ground-3", tmp_path / "ground", rows=(4, 4), seed=6)
    boxes = stancekit.fit(other, "quantile").envelopes
    with refuses("wall-3", "ground-3"):
        selectors.theorem(boxes, rows)
    mine = EnvelopeSet.for_problems("wall-3", list(rows.problems()), boxes.envelopes)
    with refuses():
        selectors.theorem(mine, rows.select([]))
