"""Pictures and pages of leaps show the motion that runs, and say what was not judged."""

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.plan import LeapPlan
from stancekit.planners.motion.leap_motion import LeapMotion
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.runner.motion.time_parametrization import joint_motion
from stancekit.views.leaps import UNJUDGED, LeapView, draw_leap
from stancekit.views.page import page
from tests.refusals import refuses


@pytest.fixture(scope="module")
def plan():
    leap = leap_class("leap-given").draw(np.random.default_rng(0), "given")
    found = stancekit.plan(leap).solution
    assert found is not None
    return found


def test_a_film_shows_the_body_where_its_forces_move_it(plan):
    view = LeapView(plan)
    film, times = view.film(), view.film_times_s()
    assert len(film.moments) == len(times)
    motion = LeapMotion(plan)
    for k in (0, len(times) // 3, len(times) // 2, len(times) - 1):
        now = motion.at(float(times[k]))
        trunk = next(body for body in film.moments[k].bodies if body.name == "trunk 0")
        np.testing.assert_array_equal(trunk.position_m, now.com_m)
        arrows = {arrow.name: arrow for arrow in film.moments[k].arrows}
        assert len(arrows) == int((np.linalg.norm(now.forces_n, axis=1) > 0.0).sum())


def test_a_film_of_legs_that_are_known_shows_the_joints_that_run():
    plan = stancekit.load("tests/data/leap-hop-anymal.json", LeapPlan)
    view, runs = LeapView(plan), joint_motion(plan)
    film, times = view.film(fps=10.0), view.film_times_s(10.0)
    assert len(times) > 20
    for moment, time_s in zip(film.moments, times, strict=True):
        now = runs.at(float(time_s))
        expected = view.shape.links.bodies(
            now.origin_m + now.rotation @ view.robot.origin_m,
            now.rotation,
            view.shape.links.split(now.angles_rad),
        )
        places = {body.name: body.position_m for body in moment.bodies}
        assert len(expected) > 12
        for body in expected:
            np.testing.assert_allclose(places[body.name], body.position_m, atol=1e-9)


def test_in_the_air_there_are_no_forces(plan):
    view = LeapView(plan)
    ((begin, end),) = view.flights_s
    air = (plan.problem.holds[plan.problem.interval_phases] < 0).all(axis=1)
    takes_off = plan.times_s[int(np.argmax(air))]
    assert begin == pytest.approx(takes_off, abs=0.006)
    middle = view.motion.at(0.5 * (begin + end))
    assert not middle.stands.any()
    assert view.at(middle).arrows == []


def test_pictures_and_pages_say_what_is_not_judged(plan):
    texts = [
        text.get_text() for text in draw_leap(plan).findobj(lambda it: hasattr(it, "get_text"))
    ]
    assert any(UNJUDGED in text for text in texts)
    film = LeapView(plan).film(fps=5.0)
    assert all(UNJUDGED in note for note in film.notes)
    assert "patch chosen for LF" in page(film)


def test_the_library_draws_a_leap_and_writes_its_page(plan, tmp_path):
    stancekit.draw(plan, out=tmp_path / "leap.png")
    assert (tmp_path / "leap.png").stat().st_size > 10_000
    stancekit.film(plan, tmp_path / "leap.html")
    assert "patch chosen for LF" in (tmp_path / "leap.html").read_text()
    with refuses(".txt"):
        stancekit.film(plan, "leap.txt")


def test_a_picture_of_an_execution_names_the_path_that_was_gone():
    plan = stancekit.load("tests/data/leap-hop-anymal.json", LeapPlan)
    run = stancekit.simulate(plan).execution
    for executed, name in ((None, "centre of mass"), (run, "path that was gone")):
        texts = stancekit.draw(plan, executed=executed).findobj(lambda it: hasattr(it, "get_text"))
        named = {text.get_text() for text in texts}
        assert named & {"centre of mass", "path that was gone"} == {name}
