"""Pictures of maps: they show what they are given, and refuse what does not belong together."""

import numpy as np
import pytest

from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.warp.conformal import fit_map
from stancekit.views.maps import draw_map
from stancekit.views.sheet import to_rgb
from tests.refusals import refuses

FIELD = HeightField.from_function(
    lambda x, y: 0.1 * np.sin(3.0 * x) * np.cos(2.0 * y), 2.0, 0.1, name="egg box"
)


@pytest.fixture(scope="module")
def fits():
    return [fit_map(FIELD, cells=(8, 8, 3), method=method) for method in ("fast", "local-global")]


def test_a_map_is_drawn_with_its_figures(fits):
    figure = draw_map(fits[0].map, FIELD, fits[0].report, size_px=(600, 450))
    words = " ".join(text.get_text() for text in figure.texts)
    assert "Warp map of egg box" in words
    assert f"min det J {fits[0].report.least_det:.2f}" in words
    pixels = to_rgb(figure)
    assert pixels.shape == (450, 600, 3)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 500
    np.testing.assert_array_equal(
        pixels, to_rgb(draw_map(fits[0].map, FIELD, fits[0].report, size_px=(600, 450)))
    )


def test_a_map_is_not_drawn_on_another_terrain(fits):
    with refuses("egg box"):
        draw_map(fits[0].map, FIELD.scaled(2.0), fits[0].report)
