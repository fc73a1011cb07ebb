"""A world of one's own, in one file outside the package: named on the command line, it is run like
those here.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stancekit.planners.formats.plan_file import write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_plan
from stancekit.runner.log import read_log

SERVOS = '''
"""Joints that go where they are sent, one control period later; the body is not measured, and nothing is felt."""
from dataclasses import dataclass
import numpy as np
from stancekit.planners.robot.robot_file import joint_names
from stancekit.runner.worlds.world import WorldCapabilities
from stancekit.runner.worlds.world import LatchedWorld, State

@dataclass
class Bench:
    armed: bool = False

class Servos(LatchedWorld):
    name = "servos"

    @classmethod
    def make(cls, settings):
        return cls(settings)

    def __init__(self, settings):
        super().__init__()
        self.robot, self.servo, self.rate_hz = settings.robot, settings.servo, settings.rate_hz or 40.0
        self.joints, self.bench = joint_names(self.robot), Bench()
        self.capabilities = WorldCapabilities.of_servos(self.robot, self.servo, self.rate_hz, senses=False)

    def reset(self, terrain, angles_rad, position_m, rotation):
        self.angles, self.pose, self.time_s = np.array(angles_rad), (position_m, rotation), 0.0
        return self.state()

    def step(self, targets_rad):
        with self.latch.sending():
            self.angles = np.array(targets_rad)
        self.time_s += 1.0 / self.rate_hz
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
    @property
    def armed(self):
        return self.bench.armed

    def torque(self, on):
        self.bench.armed = on

    def hold(self):
        pass

    def relax(self):
        self.bench.armed = False
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    plan = TwoStagePlanner().solve(read_course("walls", frames=2)).solution
    assert plan is not None
    write_plan("plan.json", plan, check_plan(plan))
    return tmp_path


def test_a_world_of_ones_own_is_run_by_its_file_and_name(folder, stancekit):
    (folder / "mine.py").write_text(
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


def test_a_world_of_an_installed_package_is_run_by_its_entry_point(folder, stancekit, monkeypatch):
    site = folder / "site"
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


def test_hardware_of_ones_own_moves_only_when_armed_and_has_the_verbs_for_it(folder, stancekit):
    path = folder / "mine.py"
    path.write_text(SERVOS)
    ran = stancekit("run", "plan.json", "--world", "mine.py:Servos")
    assert ran.code == 2
    assert ran.err.startswith(
        "stancekit: error: world mine.py:Servos: expected a world (kind, make, reset, "
    )
    assert "of hardware torque, hold and relax, too" in ran.err
    path = folder / "robot.py"
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
        ran = stancekit(*verb, "--world", "robot.py:Servos")
        assert (ran.code, ran.err.count("\n")) == (2, 1)
        assert ran.err.startswith(f"stancekit: error: {said}")


def test_hardware_that_calls_itself_a_simulation_is_armed_and_its_limits_are_checked(
    folder, stancekit
):
    (folder / "sly.py").write_text(
        SERVOS.replace('name = "servos"', 'name, kind = "servos", "simulation"') + ARMED
    )
    ran = stancekit("simulate", "plan.json", "--world", "sly.py:Servos")
    assert (ran.code, ran.err.count("\n")) == (2, 1)
    assert "check_limits: expected True but in a simulation, got False in world servos" in ran.err
    ran = stancekit("run", "plan.json", "--world", "sly.py:Servos", "--pace", "2", "--json")
    assert (ran.code, ran.records[0]["dry"]) == (0, True)


def test_a_world_without_a_latch_and_one_that_raises_are_one_line(folder, stancekit):
    simulated = SERVOS.replace('name = "servos"', 'name, kind = "servos", "simulation"')
    (folder / "open.py").write_text(simulated.replace("super().__init__()", "self.latch = None"))
    ran = stancekit("run", "plan.json", "--world", "open.py:Servos")
    assert (ran.code, ran.err) == (
        2,
        "stancekit: error: world servos: latch: expected a StopLatch, got None\n",
    )
    for error in ("ValueError('mine')", "BrokenPipeError('mine')", "SystemExit(0)"):
        name = error[:3].lower() + ".py"
        (folder / name).write_text(
            simulated.replace("self.angles = np.array(targets_rad)", f"raise {error}")
        )
        ran = stancekit("run", "plan.json", "--world", f"{name}:Servos", "--json")
        assert (ran.code, ran.out, ran.err.count("\n")) == (1, "", 1)
        assert f"{name} line " in ran.err


def test_a_simulation_of_ones_own_is_a_subclass_and_simulated_like_the_others(folder, stancekit):
    (folder / "moon.py").write_text(
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
        ("mine.py:Bench", "world mine.py:Bench: expected a world (kind, make, "),
        ("mine.py", "--world: expected FILE.py:NAME, got no name after mine.py"),
        (
            "gazebo",
            "--world: expected one of bullet, mujoco, replay, dynamixel, ros, or FILE.py:NAME, got 'gazebo'",
        ),
    ],
)
def test_a_world_that_there_is_not_is_one_line(name, said, folder, stancekit):
    (folder / "mine.py").write_text(SERVOS)
    ran = stancekit("run", "plan.json", "--world", name)
    assert (ran.code, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert ran.err.startswith(f"stancekit: error: {said}")
