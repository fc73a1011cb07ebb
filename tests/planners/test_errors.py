"""The command that installs what is missing works where it is typed."""

import json
import pickle
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

from stancekit.planners.errors import PlanningFailed, install_command


def installed(origin: dict | None):
    """A distribution that came from there; None for one from an index, which says nothing."""
    text = None if origin is None else json.dumps(origin)
    return lambda name: SimpleNamespace(read_text=lambda file: text)


def test_an_editable_checkout_is_installed_again_from_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a checkout"
    folder.mkdir()
    origin = {"url": folder.as_uri(), "dir_info": {"editable": True}}
    monkeypatch.setattr(metadata, "distribution", installed(origin))
    monkeypatch.chdir(folder)
    assert install_command("robots") == 'pip install -e ".[robots]"'
    monkeypatch.chdir(tmp_path)
    assert install_command("robots") == f'pip install -e "{folder}[robots]"'


@pytest.mark.parametrize(
    "origin", [None, {"url": "file:///stancekit-0.1.0-py3-none-any.whl", "archive_info": {}}]
)
def test_what_came_from_an_index_or_a_wheel_is_installed_by_its_name(
    origin: dict | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "distribution", installed(origin))
    assert install_command("robots") == 'pip install "stancekit[robots]"'


def test_what_is_not_installed_at_all_has_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", nothing)
    assert install_command("robots") == 'pip install "stancekit[robots]"'


def test_what_is_worded_when_asked_is_words_wherever_it_goes() -> None:
    error = PlanningFailed(lambda: "no way: a wall")
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert repr(one) == "PlanningFailed('no way: a wall')"
