"""The page's example on an emulated bus: its commands, as printed, end with exit code 0."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("dynamixel_sdk")
pytest.importorskip("mcap")

from stancekit.runner.emulators.servo_bus import FAULTS

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
    """A printed command for this interpreter."""
    name, *rest = shlex.split(line, comments=True)
    assert name == "stancekit"
    return [sys.executable, "-m", "stancekit.cli.main", *rest]


def ended(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command that ran to its end."""
    for _ in range(TRIES):
        done = subprocess.run(
            words(line),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=600.0,
        )
        if "host watchdog: the loop was silent" not in done.stdout:
            break
    return done


def test_the_commands_of_the_emulated_bus_end_well_as_printed(
    tmp_path: Path, short_desk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(short_desk, "desk.json")
    (snippet,) = shown("python", SECTION)
    exec(compile(snippet, "running-on-a-robot.md", "exec"), {})
    (commands,) = shown("sh", SECTION)
    emulate, *runs = commands.splitlines()
    assert emulate.startswith("stancekit emulate bus")
    with subprocess.Popen(words(emulate), stdin=subprocess.PIPE, stdout=subprocess.PIPE) as bus:
        assert bus.stdout is not None
        bus.stdout.readline()
        seen = [ended(line, tmp_path) for line in runs]
        bus.terminate()
    assert [done.returncode for done in seen] == [0] * len(runs), [
        done.stdout + done.stderr for done in seen
    ]
    assert sum("--arm" in line for line in runs) == 1
    assert "run as planned" in seen[1].stdout
    assert Path("bus.png").stat().st_size > 0


def test_the_faults_that_the_page_names_are_those_of_the_emulator() -> None:
    named = re.findall(
        r"`([a-z ]+?)(?: \d+)?(?: in \d+ s)?`", SECTION[SECTION.index("Try the faults") :]
    )
    faults = [each for each in named if each in FAULTS]
    assert faults == ["power loss", "silent servo", "reboot"]
