"""What is said of an installation and a computer: extras by the package's own metadata, and the
pace of a bus.
"""

import sys
from importlib.metadata import PackageNotFoundError

import pytest

from stancekit.runner import computer
from stancekit.runner.emulators.bus_process import BusPace, bus_pace


def test_every_extra_that_commands_need_is_there_with_its_packages() -> None:
    names = computer.extras()
    assert {"robots", "viz", "data"} <= set(names)
    assert not set(computer.TOOLS) & set(names)
    assert "pin" in computer.versions("robots")
    assert "numpy" in computer.versions(None)
    assert "pin" not in computer.versions(None)


def test_a_package_that_is_not_installed_has_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(computer, "version", version)
    assert computer.versions("ray") == {"ray": None}


def test_without_a_library_that_draws_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(computer, "find_library", lambda name: None)
    monkeypatch.setattr(sys, "platform", "linux")
    assert computer.gl() == ""
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert computer.gl() == "osmesa"


def test_a_bus_is_timed_and_one_that_loses_time_or_answers_late_does_not_keep_up() -> None:
    pace = bus_pace(count=3, seconds=0.2)
    assert 0.0 < pace.usual_s <= pace.worst_s
    assert 0.0 < pace.time_share <= 1.0
    assert BusPace(time_share=1.0, usual_s=0.004, worst_s=0.01).keeps_up
    assert not BusPace(time_share=0.9, usual_s=0.004, worst_s=0.01).keeps_up
    assert not BusPace(time_share=1.0, usual_s=0.004, worst_s=0.3).keeps_up
