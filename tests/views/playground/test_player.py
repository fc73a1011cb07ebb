"""The player: a slider and a button of a page that is not there."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from stancekit.views.playground.playground import Player


class Handle(SimpleNamespace):
    """A button, or a slider."""

    def on_click(self, call):
        self.call = call

    on_update = on_click


class Gui:
    """Makes them."""

    def add_button(self, label):
        self.button = Handle(label=label)
        return self.button

    def add_slider(self, _unit, *, max, initial_value, **_more):
        self.slider = Handle(max=max, value=initial_value)
        return self.slider

    def slide(self, value, client=1):
        self.slider.call(SimpleNamespace(client=client, target=SimpleNamespace(value=value)))


@pytest.fixture
def played():
    gui, seen, moved = Gui(), [], threading.Semaphore(0)

    def on_time():
        seen.append(player.at)
        moved.release()
        return player.at != 3.0  # as if nothing were to be seen then

    player = Player(gui, "s", on_time, threading.RLock())
    return gui, player, seen, moved


def test_a_slider_shows_another_time_when_a_person_slides_it(played):
    gui, player, seen, _ = played
    player.show(5.0, 4.0)
    assert (player.at, gui.slider.max, gui.slider.value, seen) == (4.0, 4.0, 4.0, [])
    gui.slide(2.5, client=None)  # the page itself
    assert player.at == 4.0
    gui.slide(2.5)
    gui.slide(9.0)
    assert seen == [2.5, 4.0]
    gui.slide(3.0)
    assert player.at == 4.0


def test_it_plays_from_the_beginning_to_the_end_and_again_until_it_is_stopped(played):
    gui, player, seen, moved = played
    player.show(0.5, 0.5)
    gui.button.call(None)
    assert gui.button.label == "stop"
    for _ in range(11):
        assert moved.acquire(timeout=20.0)
    gui.button.call(None)
    assert gui.button.label == "play"
    assert seen[:3] == pytest.approx([0.0, 1 / 15, 2 / 15])
    assert seen[8:10] == pytest.approx([0.5, 0.0])
