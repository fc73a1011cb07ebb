"""``stancekit run`` and ``stancekit replay``: verdicts, files, exit codes, and one clear line for bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")
pytest.importorskip("mcap")

from stancekit.cli.main import run
from stancekit.cli.replay import Replay
from stancekit.cli.run import Run
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.plan_file import write_plan
from stancekit.planners.scene.course_spec import read_course
from stancekit.planners.verify_plan import check_plan


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    plan = TwoStageCoursePlanner().solve(read_course("walls", frames=2)).plan
    assert plan is not None
    write_plan(folder / "plan.json", plan, check_plan(plan))
    return folder


def ended(verb: Any, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = run(verb)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_a_plan_is_run_logged_drawn_and_replayed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, picture = folder / "run.mcap", folder / "run.svg"
    verb = Run(plan=folder / "plan.json", pace=2.0, log=log, picture=picture, json=True)
    code, out, _ = ended(verb, capsys)
    report = json.loads(out)
    assert (code, report["succeeded"], report["ended"]["left"]) == (0, True, "held")
    assert picture.read_text().startswith("<?xml")
    code, out, _ = ended(Replay(log=log, json=True), capsys)
    told = json.loads(out)
    assert (code, told["whole"], told["commands"]) == (0, True, report["sent"])
    assert told["joint_worst_rad"] == pytest.approx(report["joint_worst_rad"], rel=1e-6)
    code, out, _ = ended(Run(plan=folder / "plan.json", pace=2.0, world="replay", setup=log, json=True), capsys)
    assert (code, json.loads(out)["replay_rad"]) == (0, 0.0)
    log.write_bytes(log.read_bytes()[:200000])
    code, out, _ = ended(Replay(log=log), capsys)
    assert code == 1
    assert "none: the process was ended" in out


def test_a_stop_file_that_is_there_lets_nothing_begin(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stop = folder / "stop"
    stop.touch()
    code, out, _ = ended(Run(plan=folder / "plan.json", stop_file=stop, json=True), capsys)
    report = json.loads(out)
    assert (code, report["sent"], report["message"]) == (1, 0, "stop file stop is there")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pace": 9.0}, "--pace: expected a number from 0.05 to 4, got 9"),
        ({"rate_hz": 0.5}, "--rate-hz: expected a number from 1 to 1000, got 0.5"),
        ({"speed_rad_s": -1.0}, "--speed-rad-s: expected a number above 0, got -1"),
        ({"world": "dynamixel"}, "--setup: expected a calibration file with world dynamixel, got none"),
        ({"world": "ros", "setup": Path("none.yaml")}, "none.yaml: expected a file, found nothing there"),
        ({"setup": Path("x")}, "--setup: expected none with world mujoco, got x"),
        ({"picture": Path("x.png")}, "--picture: expected --log FILE.mcap with it"),
        ({"hung": True}, "hung: expected a robot that can hang in a stand, world mujoco has none"),
        ({"plan": Path("none.json")}, "none.json: expected a file, found nothing there"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], said: str
) -> None:
    code, out, err = ended(Run(**({"plan": folder / "plan.json"} | options)), capsys)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1


def test_what_is_no_log_is_bad_input(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "no.mcap"
    path.write_bytes(np.random.default_rng(0).bytes(100))
    code, _, err = ended(Replay(log=path), capsys)
    assert code == 2
    assert "expected an MCAP file, got something else" in err
