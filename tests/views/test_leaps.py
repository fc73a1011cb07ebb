"""Pictures and pages of leaps show the motion of ``LeapMotion``, and say what was not judged."""

import numpy as np
import pytest

import stancekit
from stancekit.planners.motion.leap_motion import LeapMotion
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.views.leaps import UNJUDGED, LeapView, draw_leap, film_times
from stancekit.views.page import page


@pytest.fixture(scope="module")
def plan():
    leap = leap_class("leap-given").draw(np.random.default_rng(0), "given")
    found = stancekit.plan(leap).solution
    assert found is not None
    return found


def test_a_film_shows_the_body_where_its_forces_move_it(plan):
    view = LeapView(plan)
    film, times = view.film(), film_times(plan)
    assert len(film.moments) == len(times)
    motion = LeapMotion(plan)
    for k in (0, len(times) // 3, len(times) // 2, len(times) - 1):
        now = motion.at(float(times[k]))
        trunk = next(body for body in film.moments[k].bodies if body.name == "trunk 0")
        np.testing.assert_array_equal(trunk.position_m, now.com_m)
        arrows = {arrow.name: arrow for arrow in film.moments[k].arrows}
        assert len(arrows) == int((np.linalg.norm(now.forces_n, axis=1) > 0.0).sum())


def test_in_the_air_there_are_no_forces(plan):
    view = LeapView(plan)
    begin, end = view.flight_s
    middle = view.motion.at(0.5 * (begin + end))
    assert not middle.stands.any()
    assert view.at(middle).arrows == []


def test_pictures_and_pages_say_what_is_not_judged(plan):
    texts = [
        text.get_text() for text in draw_leap(plan).findobj(lambda it: hasattr(it, "get_text"))
    ]
    assert any(UNJUDGED in text for text in texts)
    film = LeapView(plan).film(fps=5.0, pace=1.0)
    assert all(UNJUDGED in note for note in film.notes)
    assert "patch chosen for LF" in page(film)


def test_the_library_draws_a_leap_and_refuses_an_execution(plan, tmp_path):
    stancekit.draw(plan, out=tmp_path / "leap.png")
    assert (tmp_path / "leap.png").stat().st_size > 10_000
