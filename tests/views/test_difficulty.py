"""Difficulty curves: a panel a family, whose lines are the shares by level."""

from __future__ import annotations

import numpy as np

from stancekit.views.difficulty import difficulty_curves
from tests.refusals import refuses


def row(family, level, planned):
    return {
        "family": family,
        "level": level,
        "scenes": 200,
        "planned": planned,
        "proved_none": 1.0 - planned,
        "undecided": 0.0,
        "half_width": 0.03,
    }


def test_every_family_has_a_panel_with_its_shares_in_order_of_level():
    figure = difficulty_curves(
        [row("stairs", 1.0, 0.2), row("stairs", 0.0, 1.0), row("gaps", 0.5, 0.4)]
    )
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["stairs", "gaps"]
    planned, none = figure.axes[0].get_lines()
    np.testing.assert_allclose(planned.get_xydata(), [[0.0, 100.0], [1.0, 20.0]])
    np.testing.assert_allclose(none.get_xydata(), [[0.0, 0.0], [1.0, 80.0]])


def test_no_rows_are_refused():
    with refuses("rows"):
        difficulty_curves([])
