"""Planners of courses by name."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.modes import Modes
from stancekit.planners.search.methods import COURSE_METHODS, make_planner


def test_every_planner_is_made_by_its_name(drawn):
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    learned = EnvelopeSet.for_problems("wall-3", [drawn("wall-3", 0)], [box])
    modes = Modes(names=("wall",), boxes=learned)
    assert [make_planner(name, of="courses").name for name in COURSE_METHODS] == list(
        COURSE_METHODS
    )
    assert make_planner("two-stage", envelopes=learned, of="courses").envelopes is learned
    assert make_planner("micp", envelopes=learned, of="courses").envelope is learned
    for arguments, message in (
        ({"name": "best"}, "planner: expected one of two-stage, micp"),
        (
            {"name": "two-stage", "relaxation": "boxes"},
            "relaxation: expected one of p1, joint, coned, lift",
        ),
        (
            {"name": "two-stage", "relaxation": "p1"},
            "envelopes: expected an envelope for the relaxation p1",
        ),
        (
            {"name": "two-stage", "relaxation": "lift", "envelopes": learned},
            "envelopes: expected none for the lift",
        ),
        ({"name": "nlp", "relaxation": "lift"}, "relaxation: expected none for nlp"),
        ({"name": "exact", "envelopes": learned}, "envelopes: expected none for exact"),
        (
            {"name": "micp", "envelopes": modes},
            "envelopes: expected one envelope for micp, got modes",
        ),
    ):
        with pytest.raises(InvalidInput, match=message):
            make_planner(arguments.pop("name"), **arguments, of="courses")
