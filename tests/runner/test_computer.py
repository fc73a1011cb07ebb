"""The description of an installation and a computer, with extras by the package's own metadata."""

import sys
from importlib.metadata import PackageNotFoundError

import pytest

from stancekit.runner import computer


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
