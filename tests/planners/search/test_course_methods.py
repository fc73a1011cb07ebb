"""Planners of courses by name."""

from __future__ import annotations

import numpy as np

from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.search.methods import COURSE_METHODS, make_planner
from tests.refusals import refuses


def test_every_planner_is_made_by_its_name(drawn):
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    learned = EnvelopeSet.for_problems("wall-3", [drawn("wall-3", 0)], [box])
    modes = Modes(names=("wall",), boxes=learned)
    assert [make_planner(name, of="courses").name for name in COURSE_METHODS] == list(
        COURSE_METHODS
    )
    assert make_planner("two-stage", envelopes=learned, of="courses").envelopes is learned
    assert make_planner("micp", envelopes=learned, of="courses").envelope is learned
    for arguments, named in (
        ({"name": "best"}, "planner"),
        ({"name": "two-stage", "relaxation": "boxes"}, "relaxation"),
        ({"name": "two-stage", "relaxation": "p1"}, "envelopes"),
        ({"name": "two-stage", "relaxation": "lift", "envelopes": learned}, "envelopes"),
        ({"name": "nlp", "relaxation": "lift"}, "relaxation"),
        ({"name": "exact", "envelopes": learned}, "envelopes"),
        ({"name": "micp", "envelopes": modes}, "envelopes"),
    ):
        with refuses(named):
            make_planner(arguments.pop("name"), **arguments, of="courses")
