"""Lines and shapes that pictures are made of, against closed forms."""

from __future__ import annotations

import numpy as np

from stancekit.views.shapes import thinned


def test_a_line_keeps_the_corners_that_its_bends_need():
    """A parabola's pieces leave it by κ L²/8; what is straight is one piece."""
    flat = np.column_stack([np.linspace(0.0, 1.0, 401), np.zeros(401), np.zeros(401)])
    assert np.array_equal(thinned(flat, 1e-6), flat[[0, -1]])
    bent = np.column_stack([flat[:, 0], np.zeros(401), 0.5 * flat[:, 0] ** 2])
    kept = thinned(bent, 1e-3)
    assert 6 <= len(kept) <= 26
    assert np.abs(np.interp(bent[:, 0], kept[:, 0], kept[:, 2]) - bent[:, 2]).max() < 2e-3
