"""The page's example on an emulated bus: its commands, as printed, end with exit code 0."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from stancekit.cli.main import main
from tests.emulators.devices import DeviceProcess
from tests.emulators.servo_bus import FAULTS

PAGE = (Path(__file__).parents[2] / "docs" / "running-on-a-robot.md").read_text(encoding="utf-8")
SECTION = PAGE[
    PAGE.index("## 2. The same on an emulated bus") : PAGE.index("## 3. Servos on a desk")
]
TRIES = 3
"""Runs of a command that the host's own watchdog stopped, because the machine did not run the
host."""


def shown(language: str, text: str) -> list[str]:
    """Blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def words(line: str) -> list[str]:
    """The arguments of a printed command."""
    name, *rest = shlex.split(line, comments=True)
    assert name == "stancekit"
    return rest


def ended(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """A command that ran to its end, in this process: its exit code and what it printed."""
    for _ in range(TRIES):
        with pytest.raises(SystemExit) as end:
            main(words(line))
        out, err = capsys.readouterr()
        if "host watchdog: the loop was silent" not in out:
            break
    return int(str(end.value.code)), out + err


def test_the_commands_of_the_emulated_bus_end_well_as_printed(
    tmp_path: Path,
    short_desk: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(short_desk, "desk.json")
    (snippet,) = shown("python", SECTION)
    exec(compile(snippet, "running-on-a-robot.md", "exec"), {})
    (commands,) = shown("sh", SECTION)
    emulate, *runs = commands.splitlines()
    source, *python, kind, plan, option, setup = shlex.split(emulate, comments=True)
    assert (source, python) == ("PYTHONPATH=SOURCE", ["python", "-m", "tests.emulators"])
    assert kind == "bus"
    with DeviceProcess(kind, plan, option, setup):
        seen = [ended(line, capsys) for line in runs]
    assert [code for code, _ in seen] == [0] * len(runs), seen
    assert sum("--arm" in line for line in runs) == 1
    assert "run as planned" in seen[1][1]
    assert Path("bus.png").stat().st_size > 0


def test_the_faults_that_the_page_names_are_those_of_the_emulator() -> None:
    named = re.findall(
        r"`([a-z ]+?)(?: \d+)?(?: in \d+ s)?`", SECTION[SECTION.index("Try the faults") :]
    )
    faults = [each for each in named if each in FAULTS]
    assert faults == ["power loss", "silent servo", "reboot"]
