"""``stancekit run`` and ``stancekit replay``: verdicts, files, exit codes, and one clear line for
bad input.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stancekit import Motion
from stancekit.cli.main import main, run
from stancekit.cli.run import Replay, RunMotion
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.formats.question_file import write_boxes
from stancekit.planners.relaxation.envelope import expert_envelopes
from stancekit.planners.robot import hexapod
from stancekit.planners.verify import check_plan
from stancekit.runner.log import read_log
from stancekit.runner.worlds.dynamixel.control_table import nominal
from stancekit.runner.worlds.ros.joint_states import same_names


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory, course_plan: Callable[[str, int], Motion]
) -> Path:
    folder, plan = tmp_path_factory.mktemp("run"), course_plan("walls", 2)
    write_motion(folder / "plan.json", plan, check_plan(plan))
    return folder


def main_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    return int(str(end.value.code))


def ended(verb: Any, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = run(verb)
    said = capsys.readouterr()
    return code, said.out, said.err


def refused(verb: Any, capsys: pytest.CaptureFixture[str]) -> str:
    code, out, err = ended(verb, capsys)
    assert (code, out, err.count("\n")) == (2, "", 1)
    return err


def test_a_plan_is_run_logged_drawn_and_replayed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, picture = folder / "run.mcap", folder / "run.svg"
    verb = RunMotion(plan=folder / "plan.json", pace=2.0, log=log, picture=picture, json=True)
    code, out, _ = ended(verb, capsys)
    report = json.loads(out)
    assert (code, report["succeeded"], report["ended"]["left"]) == (0, True, "held")
    assert picture.read_text().startswith("<?xml")
    code, out, _ = ended(Replay(log=log, json=True), capsys)
    message = json.loads(out)
    assert (code, message["whole"], message["commands"]) == (0, True, report["sent"])
    assert message["joint_worst_rad"] == pytest.approx(report["joint_worst_rad"], rel=1e-6)
    log.write_bytes(log.read_bytes()[:200000])
    code, out, _ = ended(Replay(log=log), capsys)
    assert code == 1
    assert "none: the process was ended" in out
    assert "s at 1.00 of the pace asked for" in out


def test_a_selector_file_walks_a_course_with_less_friction_than_it_says(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_boxes(folder / "wall-3.json", expert_envelopes("wall"))
    (folder / "short.yaml").write_text(
        resources.files("stancekit.configs.courses")
        .joinpath("walls.yaml")
        .read_text()
        .replace("frames: 8", "frames: 3")
    )
    log = folder / "loop.mcap"
    verb = RunMotion(
        plan=folder / "short.yaml",
        policy=str(folder / "wall-3.json"),
        horizon=1,
        friction_share=0.9,
        pace=2.0,
        log=log,
        json=True,
    )
    code, out, _ = ended(verb, capsys)
    report = json.loads(out)
    assert (code, report["succeeded"], report["frames"], report["plans"]) == (0, True, 2, 2)
    assert (report["chosen"], report["lifted"], report["warning"]) == (2, 0, "")
    assert len(read_log(log).of("plan")) == 2


def test_a_policy_begins_with_the_plan_that_it_is_given(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "given.mcap"
    code, out, _ = ended(
        RunMotion(plan=folder / "plan.json", policy="lift", pace=2.0, log=log), capsys
    )
    assert code == 0
    assert "1, 0 of them because of a deviation" in out
    assert read_log(log).of("plan")[0]["source"] == str(folder / "plan.json")


def test_a_gait_is_run_and_another_pace_or_a_policy_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "walk.json"
    short = ("--goal", "0.1,0", "--duration-s", "2.5", "--raw")
    assert main_code("gait", "rough:0:1", "--robot", "hexapod", *short, "--out", str(path)) == 0
    capsys.readouterr()
    code, out, _ = ended(RunMotion(plan=path), capsys)
    assert code == 0
    assert re.search(r"seconds +3\.5 of 3\.5", out)
    assert "run as planned" in out
    for options, said in (({"pace": 2.0}, "--pace"), ({"policy": "lift"}, "--policy")):
        code, _, err = ended(RunMotion(plan=path, **options), capsys)
        assert (code, err) == (
            2,
            f"stancekit: error: {said}: expected key frames: a gait runs as planned, or not at all\n",
        )


def test_a_stop_file_that_is_there_lets_nothing_begin(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = folder / "stop"
    stop.touch()
    code, out, _ = ended(RunMotion(plan=folder / "plan.json", stop_file=stop, json=True), capsys)
    report = json.loads(out)
    assert (code, report["sent"], report["message"]) == (1, 0, "stop file stop is there")
    assert (report["joint_worst"], report["joint_worst_rad"], report["cycle_s"]) == (
        "",
        None,
        [None, None],
    )
    code, out, _ = ended(RunMotion(plan=folder / "plan.json", stop_file=stop), capsys)
    assert code == 1
    assert "stop file stop is there" in out
    assert "nan" not in out


@pytest.mark.parametrize(("load", "said"), [(3.25, True), (0.5, False), (float("nan"), False)])
def test_a_run_that_was_stopped_on_a_computer_with_too_much_work_says_how_much(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    load: float,
    said: bool,
) -> None:
    monkeypatch.setattr("stancekit.runner.report.load", lambda: load)
    stop = folder / "stop"
    stop.touch()
    code, out, _ = ended(RunMotion(plan=folder / "plan.json", stop_file=stop), capsys)
    assert code == 1
    assert (
        "3.2 processes for each processor: a run that comes too late" in " ".join(out.split())
    ) == said


def test_a_log_is_written_over_no_file_of_the_run_and_kept_where_the_run_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, linked = folder / "kept.mcap", folder / "linked.mcap"
    log.write_bytes(b"an earlier log")
    linked.symlink_to(folder / "plan.json")
    plan, gait = folder / "plan.json", folder / "gait.mcap"
    before = plan.read_bytes()
    for options, said in (
        ({"log": plan}, f"--log: expected a name that ends in .mcap, got {plan}"),
        ({"log": linked}, f"--log: expected a file of its own, got that of PLAN: {linked}"),
        (
            {"plan": gait, "log": gait},
            f"--log: expected a file of its own, got that of PLAN: {gait}",
        ),
        (
            {"world": "dynamixel", "setup": log, "log": log},
            f"--log: expected a file of its own, got that of --setup: {log}",
        ),
        (
            {"policy": str(log), "log": log},
            f"--log: expected a file of its own, got that of --policy: {log}",
        ),
        (
            {"picture": log, "log": log},
            f"--log: expected a file of its own, got that of --picture: {log}",
        ),
        (
            {"hung": True, "log": log},
            "hung: expected a robot that can hang in a stand, world mujoco has none",
        ),
    ):
        given: dict[str, Any] = {"plan": plan} | options
        assert ended(RunMotion(**given), capsys) == (2, "", f"stancekit: error: {said}\n")
    assert (plan.read_bytes(), log.read_bytes()) == (before, b"an earlier log")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pace": 9.0}, "--pace: expected a number in [0.05, 4], got 9"),
        ({"rate_hz": 0.5}, "--rate-hz: expected a number in [1, 1000], got 0.5"),
        ({"speed_rad_s": -1.0}, "--speed-rad-s: expected a number above 0, got -1"),
        (
            {"world": "dynamixel"},
            "--setup: expected a calibration file with world dynamixel, got none",
        ),
        (
            {"world": "ros", "setup": Path("none.yaml")},
            "none.yaml: expected a file, found nothing there",
        ),
        ({"setup": Path("x")}, "--setup: expected none with a simulation, got x"),
        ({"picture": Path("x.png")}, "--picture: expected --log FILE.mcap with it"),
        ({"policy": "none.json"}, "none.json: expected a file, found nothing there"),
        (
            {"policy": "lift", "replan_m": -1.0},
            "--replan-m: expected a number above 0, or inf, got -1",
        ),
        ({"horizon": 2}, "--horizon: expected --policy with it, got none"),
        (
            {"plan": Path("walls")},
            "walls: expected a plan file; a course is walked with --policy, got none",
        ),
        ({"friction_share": 0.0}, "--friction-share: expected a number in (0, 1], got 0"),
        (
            {"friction_share": 0.5, "world": "ros"},
            "--friction-share: expected a simulated world with it, got ros",
        ),
        (
            {"stop_topic": "e_stop"},
            "--stop-topic: expected HOST:PORT/TOPIC, as localhost:9090/e_stop, got 'e_stop'",
        ),
        ({"hung": True}, "hung: expected a robot that can hang in a stand, world mujoco has none"),
        ({"plan": Path("none.json")}, "none.json: expected a file, found nothing there"),
        (
            {"actuators": "XM"},
            "--actuators: expected one of XM540-W270, XM430-W350 or a file, got 'XM'",
        ),
        ({"actuators": "none.yaml"}, "none.yaml: expected a file, found nothing there"),
        (
            {"blind": True, "world": "ros"},
            "--blind: expected a plan or a gait in a simulated world with it, got ros",
        ),
        (
            {"blind": True, "policy": "lift"},
            "--blind: expected a plan or a gait in a simulated world with it, got --p",
        ),
        (
            {"video": Path("x.mp4"), "policy": "lift"},
            "--video: expected a plan or a gait in a simulated world with it",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], said: str
) -> None:
    assert said in refused(RunMotion(**({"plan": folder / "plan.json"} | options)), capsys)


SAID = re.compile(
    r"expected actuators that bear it: joint (\w+) needs ([\d.]+) Nm at most and ([\d.]+) Nm \(RMS\)"
    r"(, [\d.e+]+ times the heat that it bears)?, weak has (.*); (.*)\n$"
)


@pytest.mark.parametrize(
    ("actuator", "has", "hot"),
    [
        ("{stall_nm: 0.5, no_load_rad_s: 4}", "0.9 of 0.5 Nm for a moment", False),
        (
            "{stall_nm: 40, continuous_nm: 0.2, no_load_rad_s: 40, thermal_s: 1}",
            "0.9 of 40 Nm for a moment and 0.2 Nm for ever",
            True,
        ),
    ],
)
def test_joints_weaker_than_the_plan_needs_are_one_line_before_any_motion(
    folder: Path, capsys: pytest.CaptureFixture[str], actuator: str, has: str, hot: bool
) -> None:
    """It says what the joints are then seen to need in a run with joints that have it, as measured
    there, too.
    """
    code, out, _ = ended(RunMotion(plan=folder / "plan.json", json=True), capsys)
    assert code == 0
    ran, file = json.loads(out), folder / "actuators.yaml"
    strong = "strong: {stall_nm: 40, continuous_nm: 40, no_load_rad_s: 40}"
    file.write_text(
        f'format: stancekit/actuators/1\nactuators: {{weak: {actuator}, {strong}}}\njoints: {{"*": weak}}\n'
    )
    found = SAID.search(refused(RunMotion(plan=folder / "plan.json", actuators=str(file)), capsys))
    joint, peak_nm, rms_nm = found[1], float(found[2]), float(found[3])
    assert (bool(found[4]), found[5], found[6]) == (hot, has, "at rest strong would do")
    for needs, off in (ran["needs"], 0.05), (ran["loads"], 0.25):
        assert peak_nm == pytest.approx(needs[joint]["peak_nm"], rel=off)
        assert rms_nm == pytest.approx(needs[joint]["rms_nm"], rel=off)
    file.write_text(file.read_text().replace('"*": weak', '"*": strong'))
    assert ended(RunMotion(plan=folder / "plan.json", actuators=str(file)), capsys)[0] == 0


def test_where_no_known_actuator_bears_a_plan_that_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(RunMotion(plan=folder / "plan.json", actuators="XM430-W350"), capsys)
    assert (
        "XM430-W350 has 0.9 of 4.1 Nm for a moment and 0.82 Nm for ever; no known actuator would do"
        in said
    )


@pytest.mark.parametrize(
    ("world", "change", "said"),
    [
        (
            "dynamixel",
            {"robot": "ant"},
            "setup.yaml: robot: expected hexapod, whom the plan is for, got ant",
        ),
        ("dynamixel", {"port": "none"}, "port none: expected a serial port, found nothing there"),
        (
            "dynamixel",
            {"joints": {"LF_yaw": {"id": 2}}},
            "LF_hip.id: expected its own id, got 2, which LF_yaw has",
        ),
        (
            "dynamixel",
            {"joints": {"LF_yaw": {"zero_tick": 5000}}},
            "LF_yaw.zero_tick: expected less than 4096",
        ),
        (
            "dynamixel",
            {"joints": {"LF_yaw": None}},
            "setup.yaml: joints: expected joint LF_yaw, got nothing",
        ),
        (
            "ros",
            {"robot": "ant"},
            "setup.yaml: robot: expected hexapod, whom the plan is for, got ant",
        ),
        ("ros", {"port": 9}, "rosbridge ws://127.0.0.1:9: expected a rosbridge, got no answer"),
        (
            "ros",
            {"joints": {"LF_yaw": None}},
            "setup.yaml: joints: expected joint LF_yaw, got nothing",
        ),
    ],
)
def test_a_robot_that_is_not_as_its_set_up_file_says_is_one_line_before_any_motion(
    folder: Path, capsys: pytest.CaptureFixture[str], world: Any, change: dict[str, Any], said: str
) -> None:
    joints = hexapod().joint_names
    data = asdict(
        nominal(hexapod(), port="bus", desk=True) if world == "dynamixel" else same_names(joints)
    )
    for joint, fields in change.pop("joints", {}).items():
        data["joints"][joint] = None if fields is None else data["joints"][joint] | fields
        data["joints"] = {
            name: value for name, value in data["joints"].items() if value is not None
        }
    (folder / "setup.yaml").write_text(yaml.safe_dump(data | change, sort_keys=False))
    verb = RunMotion(plan=folder / "plan.json", world=world, setup=folder / "setup.yaml")
    assert said in refused(verb, capsys)


OWN = """
import numpy as np
from tests.emulators.memory_world import MemoryWorld

class Straight(MemoryWorld):
    @classmethod
    def make(cls, settings):
        return cls(settings.robot, found_rad=np.zeros(24))
"""


def test_a_pose_from_which_feet_would_go_through_a_wall_is_one_line_before_any_motion(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "own.py").write_text(OWN)
    verb = RunMotion(
        plan=folder / "plan.json", world=f"{folder / 'own.py'}:Straight", log=folder / "away.mcap"
    )
    assert re.search(
        r"soft start: limb \w+: its foot would go \d+ mm into a surface on the way",
        refused(verb, capsys),
    )
    assert read_log(folder / "away.mcap").of("command") == []


def test_a_stop_topic_that_is_pressed_lets_nothing_begin(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from tests.emulators.rosbridge import RosBridge

    with RosBridge(["a"]) as bridge:
        bridge.inject("e-stop")
        verb = RunMotion(
            plan=folder / "plan.json", stop_topic=f"127.0.0.1:{bridge.port}/e_stop", json=True
        )
        code, out, _ = ended(verb, capsys)
    report = json.loads(out)
    assert (code, report["sent"], report["message"]) == (1, 0, "e-stop pressed on /e_stop")


def test_what_is_no_log_is_bad_input(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "no.mcap"
    path.write_bytes(np.random.default_rng(0).bytes(100))
    assert "expected an MCAP file, got something else" in refused(Replay(log=path), capsys)


@pytest.fixture
def file(tmp_path: Path, folder: Path) -> str:
    shutil.copy(folder / "plan.json", tmp_path)
    return "plan.json"


def test_a_plan_that_is_executed_gives_one_object_and_exit_code_0(file, stancekit, tmp_path):
    ran = stancekit("simulate", file, "--pace", "2", "--out", "trace.npz", "--json")
    assert ran.code == 0
    (said,) = ran.records
    assert said["plan"] == "plan.json"
    assert (said["world"], said["succeeded"], said["message"]) == ("mujoco", True, "")
    with np.load(tmp_path / "trace.npz", allow_pickle=False) as arrays:
        assert len(arrays["time_s"]) == round(200 * said["seconds"])


def test_people_get_a_table_and_a_picture(file, stancekit, tmp_path):
    ran = stancekit("simulate", file, "--pace", "2", "--picture", "end.png")
    assert ran.code == 0
    assert "executed as planned" in ran.out
    assert "written: end.png" in ran.out
    assert (tmp_path / "end.png").read_bytes().startswith(b"\x89PNG")


def test_a_plan_that_the_verifier_rejected_is_not_executed(stancekit, tmp_path, course_plan):
    plan = course_plan("walls", 2)
    bad = replace(plan, com_m=plan.com_m + np.array([0.0, 0.05, 0.0]))
    write_motion(tmp_path / "bad.json", bad, check_plan(bad))
    ran = stancekit("simulate", "bad.json", "--json")
    assert (ran.code, ran.out) == (2, "")
    assert (
        " ".join(ran.err.split())
        == "stancekit: error: bad.json: expected a plan that the verifier accepted, this one it rejected"
    )


def test_a_plan_file_that_was_edited_is_refused(file, refusal, tmp_path):
    header = json.loads((tmp_path / file).read_text())
    header["question"]["gravity_m_s2"] = 1.0
    (tmp_path / file).write_text(json.dumps(header))
    assert refusal("simulate", file).startswith("plan.json: ")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--pace", "0"), "--pace: expected a number in [0.1, 4], got 0"),
        (("--out", "trace.csv"), "--out: expected a name that ends in .npz, got trace.csv"),
        (("--picture", "end.gif"), "end.gif: expected a name that ends in "),
    ],
)
def test_bad_options_are_refused_before_anything_moves(options, said, file, refusal):
    assert refusal("simulate", file, *options).startswith(said)


SERVOS = '''
"""Joints that go where they are sent, one control period later; the body is not measured, and nothing is felt."""
from dataclasses import replace
import numpy as np
from stancekit.runner.worlds.world import Drives
from stancekit.runner.worlds.world import JointBus, State

class Servos(JointBus):
    name = "servos"

    @classmethod
    def make(cls, settings):
        return cls(settings)

    def __init__(self, settings):
        drives = replace(Drives.of(settings.robot.legs), yields=False)
        super().__init__(settings.robot, settings.servo, drives, settings.rate_hz or 40.0, senses=False)

    def connect(self, terrain, angles_rad, position_m, rotation):
        self.angles, self.pose, self.time_s = np.array(angles_rad), (position_m, rotation), 0.0
        return self.state()

    def send(self, targets_rad, loads_rad=None):
        self.angles = np.array(targets_rad)
        self.time_s += 1.0 / self.rate_hz

    def read(self):
        return self.state()

    def state(self):
        feet = np.zeros((len(self.robot.limbs), 3))
        return State(
            time_s=self.time_s, position_m=self.pose[0], rotation=self.pose[1], velocity=np.zeros(6),
            angles_rad=self.angles, rates_rad_s=0.0 * self.angles, torques_nm=0.0 * self.angles, feet_m=feet,
            forces_n=feet, bump_n=0.0, sent_rad=self.angles.copy(),
        )

    def close(self):
        pass
'''
ARMED = """
    def arm(self):
        self.armed = True

    def stop(self, *, torque_off=False):
        self.armed = False
        return ""
"""


@pytest.fixture
def planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(folder / "plan.json", "plan.json")
    return tmp_path


def test_a_world_of_ones_own_is_run_by_its_file_and_name(planned, stancekit):
    (planned / "mine.py").write_text(
        SERVOS.replace('    name = "servos"\n', '    name, kind = "servos", "simulation"\n')
    )
    ran = stancekit(
        "run",
        "plan.json",
        "--world",
        "mine.py:Servos",
        "--pace",
        "2",
        "--log",
        "run.mcap",
        "--json",
    )
    assert (ran.code, ran.err) == (0, "")
    (report,) = ran.records
    assert (report["world"], report["succeeded"], report["dry"]) == ("servos", True, False)
    assert report["joint_worst_rad"] < 1e-9  # it follows exactly
    log = read_log("run.mcap")
    assert log.of("plan")[0]["rate_hz"] == 40.0
    assert len(log.of("command")) == report["sent"] > 40


def test_a_world_of_an_installed_package_is_run_by_its_entry_point(planned, stancekit, monkeypatch):
    site = planned / "site"
    (site / "servos-0.1.dist-info").mkdir(parents=True)
    (site / "servos.py").write_text(
        SERVOS.replace('name = "servos"', 'name, kind = "servos", "simulation"')
    )
    (site / "servos-0.1.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: servos\nVersion: 0.1\n"
    )
    (site / "servos-0.1.dist-info" / "entry_points.txt").write_text(
        "[stancekit.worlds]\nbench = servos:Servos\n"
    )
    monkeypatch.syspath_prepend(site)
    ran = stancekit("run", "plan.json", "--world", "bench", "--pace", "2", "--json")
    assert (ran.code, ran.records[0]["world"], ran.records[0]["succeeded"]) == (0, "servos", True)


def test_hardware_of_ones_own_moves_only_when_armed_and_has_the_verbs_for_it(
    planned, stancekit, refusal
):
    path = planned / "mine.py"
    path.write_text(SERVOS)
    said = refusal("run", "plan.json", "--world", "mine.py:Servos")
    assert said.startswith("world mine.py:Servos: expected a JointBus (kind, make, connect, ")
    path = planned / "robot.py"
    path.write_text(SERVOS + ARMED)
    for options, dry in (((), True), (("--arm",), False)):
        ran = stancekit(
            "run", "plan.json", "--world", "robot.py:Servos", "--pace", "2", "--json", *options
        )
        (report,) = ran.records
        assert (ran.code, report["succeeded"], report["dry"]) == (0, True, dry), report["message"]
    for verb, said in (
        (
            ("run", "plan.json", "--friction-share", "0.5"),
            "--friction-share: expected a simulated world with it",
        ),
        (
            ("simulate", "plan.json"),
            "--world: expected a simulation, got robot.py:Servos, which is hardware",
        ),
    ):
        assert refusal(*verb, "--world", "robot.py:Servos").startswith(said)


def test_hardware_that_calls_itself_a_simulation_is_refused(planned, refusal):
    (planned / "sly.py").write_text(
        SERVOS.replace('name = "servos"', 'name, kind = "servos", "simulation"') + ARMED
    )
    for verb in ("run", "simulate"):
        said = refusal(verb, "plan.json", "--world", "sly.py:Servos")
        assert "sly.py:Servos: expected a JointBus" in said


def test_a_world_without_a_latch_and_one_that_raises_are_one_line(planned, stancekit):
    simulated = SERVOS.replace('name = "servos"', 'name, kind = "servos", "simulation"')
    (planned / "open.py").write_text(
        simulated.replace(
            "    def connect(",
            "    latch = property(lambda self: None, lambda self, latch: None)\n\n    def connect(",
        )
    )
    ran = stancekit("run", "plan.json", "--world", "open.py:Servos")
    assert (ran.code, ran.err) == (
        2,
        "stancekit: error: world servos: latch: expected a StopLatch, got None\n",
    )
    for error in ("ValueError('mine')", "BrokenPipeError('mine')", "SystemExit(0)"):
        name = error[:3].lower() + ".py"
        (planned / name).write_text(
            simulated.replace("self.angles = np.array(targets_rad)", f"raise {error}")
        )
        ran = stancekit("run", "plan.json", "--world", f"{name}:Servos", "--json")
        assert (ran.code, ran.out, ran.err.count("\n")) == (1, "", 1)
        assert f"{name} line " in ran.err


def test_a_simulation_of_ones_own_is_a_subclass_and_simulated_like_the_others(planned, stancekit):
    (planned / "moon.py").write_text(
        "from dataclasses import replace\n"
        "from stancekit.runner.worlds.mujoco import MujocoWorld\n"
        "class Weak(MujocoWorld):\n"
        "    name = 'weak'\n"
        "    @classmethod\n"
        "    def make(cls, settings):\n"
        "        return super().make(replace(settings, servo=replace(settings.servo, torque_nm=1.0)))\n"
    )
    ran = stancekit("simulate", "plan.json", "--world", "moon.py:Weak", "--json")
    (said,) = ran.records
    assert (ran.code, said["world"], said["torque_limit_nm"], said["succeeded"]) == (
        1,
        "weak",
        1.0,
        False,
    )
    assert json.dumps(said, allow_nan=False)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("none.py:Mine", "none.py: expected a file, found nothing there"),
        ("mine.py:Mine", "mine.py: expected 'Mine' in it, found no such name; it defines "),
        ("mine.py:State", "world mine.py:State: expected a JointBus (kind, make, "),
        ("mine.py", "--world: expected FILE.py:NAME, got no name after mine.py"),
        (
            "gazebo",
            "--world: expected one of bullet, mujoco, dynamixel, ros, or FILE.py:NAME, got 'gazebo'",
        ),
    ],
)
def test_a_world_that_there_is_not_is_one_line(name, said, planned, refusal):
    (planned / "mine.py").write_text(SERVOS)
    assert refusal("run", "plan.json", "--world", name).startswith(said)
