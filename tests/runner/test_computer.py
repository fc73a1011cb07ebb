"""The description of an installation and a computer, with extras by the package's own metadata."""

import sys
from importlib.metadata import PackageNotFoundError

import pytest

from stancekit.runner import acceptance


def test_every_extra_that_commands_need_is_there_with_its_packages() -> None:
    names = acceptance.extras()
    assert {"robots", "viz", "data"} <= set(names)
    assert not set(acceptance.TOOLS) & set(names)
    assert "pin" in acceptance.versions("robots")
    assert "numpy" in acceptance.versions(None)
    assert "pin" not in acceptance.versions(None)


def test_a_package_that_is_not_installed_has_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(acceptance, "version", version)
    assert acceptance.versions("ray") == {"ray": None}


def test_without_a_library_that_draws_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(acceptance, "find_library", lambda name: None)
    monkeypatch.setattr(sys, "platform", "linux")
    assert acceptance.gl() == ""
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert acceptance.gl() == "osmesa"
