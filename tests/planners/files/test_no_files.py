"""Whatever is given where a file is expected, and is none: one line, and nobody waits for a
pipe.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import open_file, read_bytes
from tests.damage.cases import cases, command

NO_FILES = ("pipe", "folder", "device", "socket", "loop", "nothing", "to a pipe", "to a folder")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """A folder with one of each."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, target in (
        ("device", "/dev/zero"),
        ("loop", "loop"),
        ("to a pipe", "pipe"),
        ("to a folder", "folder"),
    ):
        (tmp_path / name).symlink_to(target)
    with socket.socket(socket.AF_UNIX) as listener:
        before = Path.cwd()
        os.chdir(tmp_path)  # names of sockets are short
        listener.bind("socket")
        os.chdir(before)
        yield tmp_path


@pytest.mark.parametrize("name", NO_FILES)
def test_what_is_no_file_is_said_at_once(place: Path, name: str) -> None:
    with pytest.raises(InvalidInput) as error:
        read_bytes(place / name)
    said = str(error.value).removeprefix(f"{place / name}: ")
    wanted = {
        "loop": "cannot be read: Too many levels of symbolic links",
        "nothing": "expected a file, found nothing there",
        **dict.fromkeys(("folder", "to a folder"), "expected a file, found a folder"),
    }
    assert said == wanted.get(name, "expected a file, found a pipe, a socket or a device")


def test_a_file_behind_a_link_is_read_and_nothing_stays_open(place: Path) -> None:
    (place / "file").write_bytes(b"text")
    (place / "link").symlink_to("file")
    before = len(os.listdir("/proc/self/fd"))
    assert read_bytes(place / "link") == b"text"
    for name in NO_FILES:
        with pytest.raises(InvalidInput), open_file(place / name):
            pytest.fail("opened")
    assert len(os.listdir("/proc/self/fd")) == before


COMMANDS = {
    case.arguments: case.file
    for case in cases()
    if "/" not in case.file and case.arguments[0] != "label"
}
"""Those of the readers whose file the command itself names; what those files name are meshes and
URDFs."""


@pytest.mark.parametrize(
    "arguments", [each for each, file in COMMANDS.items() if file in each], ids=" ".join
)
@pytest.mark.parametrize("name", ["pipe", "folder"])
def test_a_command_that_is_given_no_file_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / COMMANDS[arguments]
    os.mkfifo(file) if name == "pipe" else file.mkdir()
    code, _, err = command(arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith("stancekit: error: ")
