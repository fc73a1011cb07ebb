"""Ctrl-C in the middle of a walk is a KeyboardInterrupt, which the solver's own code would
swallow.
"""

import signal
import threading

import numpy as np
import pytest

import stancekit
from stancekit import walks
from stancekit.planners.errors import interruptible


def test_a_walk_that_is_interrupted_ends_at_the_next_iteration(monkeypatch):
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    before, plan_walk, iterations = signal.getsignal(signal.SIGINT), walks.plan_walk, []

    def struck(task, *, progress, **options):
        def at(*where):
            if not iterations:
                signal.raise_signal(signal.SIGINT)
            iterations.append(where)
            return progress(*where)

        return plan_walk(task, progress=at, **options)

    monkeypatch.setattr(walks, "plan_walk", struck)
    with pytest.raises(KeyboardInterrupt):
        stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    assert len(iterations) < 5
    assert signal.getsignal(signal.SIGINT) is before


def test_the_first_signal_is_noted_and_the_second_one_raises():
    with interruptible(signal.SIGINT) as interrupted:
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_outside_the_main_thread_nothing_is_noted_and_nothing_raised():
    found = []

    def inside() -> None:
        with interruptible(signal.SIGINT) as interrupted:
            found.append(interrupted())

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert found == [False]
