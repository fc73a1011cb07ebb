"""The pages that lead from simulation to servos and to ROS: their course can be planned, their code
and commands run.
"""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from stancekit.cli.main import main
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot.leg import read_actuators
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted, check_fits
from stancekit.runner.worlds.world import make_world
from tests.emulators.devices import DeviceProcess
from tests.emulators.servo_bus import FAULTS

PAGE, ROS, RUN = (
    (Path(__file__).parents[2] / "docs" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("running-on-a-robot", "ros", "simulate")
)
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE + ROS + RUN, re.DOTALL)


def test_the_pages_course_is_planned_and_its_python_writes_the_files_that_its_worlds_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (course,) = (text for language, text in BLOCKS if language == "yaml")
    Path("desk.yaml").write_text(course)
    plan = TwoStage().solve(read_course("desk.yaml")).solution
    assert plan is not None
    write_motion("desk.json", plan, check_plan(plan))
    accepted = Accepted.from_file("desk.json")
    snippets = [text for _, text in BLOCKS if '.write("' in text]
    assert len(snippets) == 2
    for snippet in snippets:
        exec(compile(snippet, "running-on-a-robot.md", "exec"), {})
    for world, setup in (("ros", "ros.yaml"), ("dynamixel", "servos.yaml")):
        made = make_world(world, plan.problem.robot, setup=Path(setup))
        check_fits(accepted, made)
        made.close()


def test_the_commands_behind_a_rosbridge_run_as_the_page_prints_them(
    tmp_path: Path,
    short_desk: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(short_desk, "desk.json")
    found = re.findall(r"```(py|sh)\n(.*?)```", ROS, re.DOTALL)
    lines = [line for language, text in found if language == "sh" for line in text.splitlines()]
    assert [line.split()[1] for line in lines[1:]] == ["run", "run", "replay"]
    source, *python, kind, plan, option, ros = shlex.split(lines[0], comments=True)
    assert (source, python) == ("PYTHONPATH=SOURCE", ["python", "-m", "tests.emulators"])
    assert kind == "rosbridge"
    (snippet,) = (text for language, text in found if language == "py")
    exec(compile(snippet, "ros.md", "exec"), {})
    with DeviceProcess(kind, plan, option, ros, "--port=0") as bridge:  # 9090 may be taken
        text = Path("ros.yaml").read_text()
        Path("ros.yaml").write_text(text.replace("port: 9090", f"port: {bridge.where['port']}"))
        for line in lines[1:]:
            with pytest.raises(SystemExit) as end:
                main(shlex.split(line, comments=True)[1:])
            assert end.value.code == 0, f"{line}: {capsys.readouterr()}"
    assert bridge.process.returncode == 0


def test_the_file_of_actuators_is_read(tmp_path: Path) -> None:
    (text,) = (text for language, text in BLOCKS if language == "yml")
    (tmp_path / "actuators.yaml").write_text(text)
    hip, knee = read_actuators(tmp_path / "actuators.yaml").of(["LF_hip", "LF_knee"])
    assert (hip.stall_nm, knee.stall_nm) == (10.6, 80.0)


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
