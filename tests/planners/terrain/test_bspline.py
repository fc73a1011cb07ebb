"""Cubic B-splines against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from stancekit.planners.gait.variables import clamped_knots
from stancekit.planners.terrain.bspline import cubics, rows_of


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("clamped", [False, True])
def test_cubic_splines_and_their_derivatives_are_scipys_to_the_last_bit(order, clamped):
    rng = np.random.default_rng(order)
    for count in (1, 2, 30):
        knots = clamped_knots(count) if clamped else np.sort(rng.normal(size=count + 7))
        inside = rng.uniform(knots[3], knots[-4], 50)
        x = np.concatenate([inside, knots[3:-3]])
        found = rows_of(*cubics(x, knots, order), len(knots) - 4).toarray()
        wanted = BSpline(knots, np.eye(len(knots) - 4), 3)(x, nu=order)
        np.testing.assert_array_equal(found, wanted)
        assert np.any(wanted != 0.0)
