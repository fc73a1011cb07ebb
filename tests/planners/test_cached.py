"""Properties that are worked out once hold no lock that a forked child, or another instance, would
wait for.
"""

import multiprocessing
import re
import threading
from dataclasses import dataclass
from pathlib import Path

import pytest

from stancekit.planners.arguments import cached_property

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Slow:
    """Something whose property takes as long as a thread wants."""

    begun: threading.Event
    ended: threading.Event

    @cached_property
    def value(self) -> object:
        """A new object each time that it is worked out."""
        self.begun.set()
        assert self.ended.wait(300.0)
        return object()


def ready() -> Slow:
    slow = Slow(threading.Event(), threading.Event())
    slow.ended.set()
    return slow


def test_a_property_is_worked_out_once_and_of_the_class_it_is_itself():
    slow = ready()
    assert slow.value is slow.value
    assert isinstance(Slow.value, cached_property)


def test_another_instance_and_a_forked_child_wait_for_nobody():
    slow = Slow(threading.Event(), threading.Event())
    thread = threading.Thread(target=lambda: slow.value)
    thread.start()
    assert slow.begun.wait(60.0)
    other = threading.Thread(target=lambda: ready().value, daemon=True)
    other.start()
    other.join(60.0)
    waited = other.is_alive()
    child = multiprocessing.get_context("fork").Process(target=lambda: ready().value)
    child.start()
    child.join(60.0)
    code = child.exitcode
    child.kill()
    slow.ended.set()
    thread.join()
    assert not waited
    assert code == 0


@pytest.mark.parametrize(
    "package", ["planners", "runner", "views", "envs", "learners", "cli", "api"]
)
def test_no_module_takes_the_one_with_a_lock(package):
    files = [path for path in (ROOT / package).rglob("*.py") if path.name != "cached.py"]
    assert files
    assert [
        path
        for path in files
        if re.search(r"^from functools import .*cached_property", path.read_text(), re.M)
    ] == []
