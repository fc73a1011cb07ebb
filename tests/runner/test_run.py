"""The runner from a plan's file to the end of the run, on servos in memory and in MuJoCo."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.answer.plan import MARGIN
from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.search.witness import with_whole_body
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.geometry import tipping
from stancekit.runner.acceptance import Accepted
from stancekit.runner.log import McapLog, read_log
from stancekit.runner.prepared import Prepared, Resumption
from stancekit.runner.report import Execution, RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings, Tolerance
from stancekit.runner.worlds.world import make_world
from tests.emulators.memory_world import PATIENT, MemoryWorld, silent
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names, refuses

FAST = RunSettings(timing=Timing().at_pace(2.0), limits=PATIENT)
Step = Callable[[str], Motion]


def ran(
    world: MemoryWorld, accepted: Accepted, settings: RunSettings = FAST, **options: Any
) -> RunReport:
    return Runner(world, settings=settings, dry=options.pop("dry", False), **options).run(accepted)


def lifted(accepted: Accepted) -> tuple[Array, Array]:
    """Angles of the first pose, and of one with all feet 2 cm off their surfaces."""
    prepared = Runner(MemoryWorld()).prepare(accepted)
    first, normals = prepared.first.angles_rad, prepared.first.sample.normals
    rotation = rotation_of(prepared.first.sample.rotation_rad)
    feet = prepared.kinematics.feet(first) + 0.02 * normals @ rotation
    return first, prepared.kinematics.reach(feet, first, first)[0]


def test_a_robot_that_stands_already_goes_on_from_what_its_feet_carry_as_slowly_as_asked(
    accepted: Accepted,
) -> None:
    runner, course = Runner(MemoryWorld()), accepted.plan.problem
    usual = runner.prepare(accepted)
    carried_n = usual.motion.at(usual.motion.rest_s).forces_n
    runner.world.connect(course.terrain, usual.first.angles_rad, usual.first.origin_m, np.eye(3))
    kinematics = Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    resumption = runner.prepare(
        accepted, Resumption(kinematics=kinematics, carried_n=carried_n, pace=0.5)
    )
    assert resumption.motion.rest_s > 1.5 * usual.motion.rest_s
    assert resumption.motion.duration_s > 1.5 * usual.motion.duration_s
    np.testing.assert_array_equal(resumption.first.sample.forces_n, carried_n)
    assert np.abs(usual.first.sample.forces_n - carried_n).max() > 1.0


def test_all_feet_carry_at_the_beginning_and_those_that_lift_hand_over_while_all_is_at_rest(
    accepted: Accepted,
) -> None:
    motion, course = Runner(MemoryWorld()).prepare(accepted).motion, accepted.plan.problem
    lifted = [course.robot.limb_names.index(name) for name in course.lifts[1]]
    begin, handed = (motion.at(time_s) for time_s in (0.0, motion.rest_s))
    np.testing.assert_array_equal(begin.feet_m, handed.feet_m)
    assert np.linalg.norm(begin.forces_n, axis=1).min() > 0.02 * course.weight_n
    np.testing.assert_allclose(handed.forces_n[lifted], 0.0, atol=1e-9)
    for time_s in np.linspace(0.0, motion.rest_s, 7):
        sample = motion.at(float(time_s))
        arms, forces = sample.feet_m - begin.com_m, sample.forces_n
        np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, course.weight_n], atol=1e-3)
        radii = Kinematics(course.robot).radii_m[:, None] * sample.normals
        np.testing.assert_allclose(np.cross(arms - radii, forces).sum(axis=0), 0.0, atol=1e-3)


def test_a_plan_that_is_taken_up_begins_with_what_was_sent_last_and_is_its_own_after_the_rest(
    accepted: Accepted, world: MemoryWorld
) -> None:
    runner, course = Runner(world), accepted.plan.problem
    kinematics = Kinematics(course.robot, gravity_m_s2=course.gravity_m_s2)
    first = runner.prepare(accepted).first
    off = np.random.default_rng(0).uniform(-0.01, 0.01, len(first.targets_rad))
    runner.world.connect(course.terrain, first.targets_rad + off, first.origin_m, np.eye(3))

    def commands(*, taken_over: bool) -> list[Array]:
        prepared = runner.prepare(
            accepted, Resumption(kinematics=kinematics, carried_n=first.sample.forces_n)
        )
        if not taken_over:
            prepared.tracker.take_over(np.zeros_like(off), prepared.motion.rest_s)
        periods = round(prepared.motion.rest_s * runner.world.rate_hz) + 2
        sent = [prepared.tracker.next(prepared.first.sample.forces_n) for _ in range(periods)]
        return [target.targets_rad for target in sent if target is not None]

    own, taken = commands(taken_over=False), commands(taken_over=True)
    gap = np.array(taken) - np.array(own)
    np.testing.assert_allclose(gap[0], off, atol=1e-4)
    assert (np.diff(np.abs(gap).max(axis=1)) <= 1e-12).all()
    np.testing.assert_array_equal(gap[-1], 0.0)


def test_a_plan_is_followed_from_the_pose_that_was_found_to_its_last_frame(
    accepted: Accepted, tmp_path: Path
) -> None:
    near = MemoryWorld()
    with McapLog(tmp_path / "run.mcap") as log:
        report = ran(near, accepted, log=log)
    assert report.succeeded, report.message
    assert (report.frames_done, report.ended.left, report.refused) == (1.0, "held", 0)
    assert report.joint_worst_rad < 0.1
    recorded = read_log(tmp_path / "run.mcap")
    assert recorded.whole
    assert len(recorded.of("command")) == report.sent == len(near.commands)
    assert [each["what"] for each in recorded.of("decision")] == [
        "armed",
        "soft start",
        "motion",
        "end",
    ]
    assert recorded.of("plan")[0]["digest"] == accepted.digest
    assert json.loads(json.dumps(report.to_json(), allow_nan=False))["execution"] is None


def test_the_soft_start_begins_at_the_measured_pose_and_keeps_its_speed(accepted: Accepted) -> None:
    first, away = lifted(accepted)
    world = MemoryWorld(found_rad=away)
    assert ran(world, accepted).succeeded
    sent = np.array([targets for _, targets in world.commands])
    assert np.abs(sent[0] - away).max() < 1e-3
    reached = int(np.argmax(np.abs(sent - first).max(axis=1) < 1e-9))
    assert reached > 10
    assert 100.0 * np.abs(np.diff(sent[: reached + 1], axis=0)).max() <= FAST.speed_rad_s + 1e-9


def test_a_dry_run_of_something_real_sends_nothing(accepted: Accepted, world: MemoryWorld) -> None:
    report = ran(world, accepted, dry=True)
    assert (report.succeeded, report.dry, report.ended.left) == (True, True, "as it was")
    assert report.sent > 100
    assert world.commands == []
    assert not world.torque_on
    assert world.closed == 1


@pytest.mark.parametrize("ending", ["hold", "torque-off", "home"])
def test_a_stop_at_a_random_time_is_the_last_that_is_sent(accepted: Accepted, ending: Any) -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        world, at = MemoryWorld(), int(rng.integers(1, 150))
        sources = [lambda world=world, at=at: "button" if len(world.commands) >= at else None]
        report = ran(world, accepted, replace(FAST, ending=ending), sources=sources)
        assert (report.succeeded, report.message) == (False, "button")
        # the thread that watches may be later than the loop that asks, never the other way round
        assert len(world.commands) == report.sent == at
        assert report.ended.left == ("torque off" if ending == "torque-off" else "held")
        assert world.torque_on is (ending != "torque-off")
        assert report.ended.seconds < 0.5


def test_home_is_where_it_was_found(accepted: Accepted) -> None:
    _, found = lifted(accepted)
    world = MemoryWorld(found_rad=found)
    report = ran(world, accepted, replace(FAST, ending="home"))
    assert (report.succeeded, report.ended.left) == (True, "home"), report.ended.message
    np.testing.assert_allclose(world.commands[-1][1], found, atol=1e-12)


def test_a_device_that_falls_silent_ends_the_run_with_its_words(
    accepted: Accepted, world: MemoryWorld
) -> None:
    world.fault = lambda w: silent(w) if len(w.commands) == 50 else None
    report = ran(world, accepted)
    assert (report.succeeded, report.message) == (False, "memory: LF_knee (id 4): no answer")
    assert (len(world.commands), world.closed) == (50, 1)


def test_an_error_of_the_program_itself_leaves_the_robot_held_and_the_world_closed(
    accepted: Accepted, world: MemoryWorld
) -> None:

    def bug(world: MemoryWorld) -> None:
        if len(world.commands) == 20:
            raise ZeroDivisionError("a bug")

    world.fault = bug
    with pytest.raises(ZeroDivisionError):
        ran(world, accepted, replace(FAST, ending="home"))
    assert (len(world.commands), world.armed, world.closed) == (20, False, 1)


def test_a_joint_that_is_stuck_misses_its_path(accepted: Accepted, world: MemoryWorld) -> None:

    def jam(world: MemoryWorld) -> None:
        world.stuck = [15] if len(world.commands) > 30 else []

    world.fault = jam
    limits = replace(PATIENT, path_rad=0.05, path_s=0.02)
    report = ran(world, accepted, replace(FAST, limits=limits))
    assert not report.succeeded
    assert_names(report.message, f"joint {world.joints[15]}")


def test_joints_that_end_elsewhere_miss_their_goal(accepted: Accepted, world: MemoryWorld) -> None:
    world.spoil = lambda state: replace(
        state, angles_rad=state.angles_rad + 0.12 * (np.arange(24) == 2)
    )
    report = ran(world, accepted)
    assert not report.succeeded
    assert_names(report.message, "joint LF_roll", "0.120 rad", "0.1 rad")


def test_a_plan_that_was_edited_is_refused(plan_path: Path) -> None:
    Accepted.from_file(plan_path)
    text = plan_path.read_text()
    plan_path.write_text(text.replace('"accepted": true', '"accepted":  true'))
    Accepted.from_file(plan_path)  # the same content
    changed = re.sub(r'"mass_kg": 10(\.0)?', '"mass_kg": 11', text, count=1)
    assert changed != text
    plan_path.write_text(changed)
    with refuses("digest"):
        Accepted.from_file(plan_path)


def test_numbers_of_another_plan_are_refused(plan_path: Path) -> None:
    content = json.loads(plan_path.read_text())
    numbers = content["columns"]["npz"]
    content["columns"]["npz"] = (
        numbers[:200] + ("A" if numbers[200] != "A" else "B") + numbers[201:]
    )
    plan_path.write_text(json.dumps(content))
    with refuses("digest"):
        Accepted.from_file(plan_path)


def test_a_plan_that_the_verifier_rejected_is_refused_and_so_is_one_whose_digest_was_forged(
    tmp_path: Path, step: Step
) -> None:
    good = step("walls")
    bad = replace(good, forces_n=1.1 * good.forces_n)
    path = tmp_path / "bad.json"
    write_motion(path, bad, check_plan(bad))
    with refuses("bad.json"):
        Accepted.from_file(path)
    says_accepted = replace(
        check_plan(bad), groups=check_plan(good).groups
    )  # with a digest that fits
    write_motion(path, bad, says_accepted)
    with refuses("bad.json"):
        Accepted.from_file(path)


def test_a_world_with_other_joints_is_refused_before_it_is_touched(accepted: Accepted) -> None:
    robot = hexapod()
    for limbs, name in (
        (robot.limbs[:5], "RR_yaw"),
        (robot.limbs[::-1], "joints"),
        ((*robot.limbs[:5], replace(robot.limbs[5], name="XX")), "XX_hip"),
    ):
        world = MemoryWorld(replace(robot, limbs=limbs))
        with refuses(name):
            ran(world, accepted)
        assert not hasattr(world, "_sent")


def test_a_robot_of_another_size_is_refused(accepted: Accepted) -> None:
    robot = hexapod()
    longer = replace(robot, limbs=(replace(robot.limbs[0], reach_m=0.4), *robot.limbs[1:]))
    with refuses("limb LF", "0.35 m", "0.4 m"):
        ran(MemoryWorld(longer), accepted)
    with refuses("10 kg", "12 kg"):
        ran(MemoryWorld(replace(robot, mass_kg=12.0)), accepted)


def test_a_fault_while_connecting_is_reported_and_nothing_was_sent(
    accepted: Accepted, world: MemoryWorld
) -> None:

    def dead(*arguments: Any) -> Any:
        raise HardwareFault("memory: no answer from LF_yaw")

    world.connect = dead  # type: ignore[method-assign]
    report = ran(world, accepted)
    assert (report.message, report.ended.left, report.sent) == (
        "memory: no answer from LF_yaw",
        "as it was",
        0,
    )


def test_a_wall_clock_that_jumps_changes_nothing(
    accepted: Accepted, monkeypatch: pytest.MonkeyPatch
) -> None:
    calm = MemoryWorld()
    ran(calm, accepted)
    jumps = iter(np.random.default_rng(0).integers(0, 2**60, 10**6))
    monkeypatch.setattr(time, "time", lambda: float(next(jumps)))
    monkeypatch.setattr(time, "time_ns", lambda: int(next(jumps)))
    jumped = MemoryWorld()
    assert ran(jumped, accepted).succeeded
    np.testing.assert_array_equal([t for _, t in jumped.commands], [t for _, t in calm.commands])


def test_in_a_simulation_the_report_is_that_of_an_execution_and_its_log_is_drawn(
    accepted: Accepted, tmp_path: Path
) -> None:
    from stancekit.views.plots import draw_tracking

    path, course = tmp_path / "run.mcap", accepted.plan.problem
    with McapLog(path) as log:
        report = Runner(make_world("mujoco", course.robot), settings=FAST, log=log).run(accepted)
    assert report.succeeded, report.message
    timing = FAST.timing.at_pace(report.pace)
    alone = stancekit.simulate(
        accepted.plan, settings=RunSettings(timing=timing, check_limits=False)
    ).execution
    assert report.execution.com_worst_m == pytest.approx(alone.com_worst_m, abs=2e-4)
    figure = draw_tracking(read_log(path))
    lines = figure.axes[0].lines
    assert len(lines) == 6
    worst = max(float(np.max(line.get_ydata())) for line in lines)  # type: ignore[arg-type]
    commands, states = read_log(path).of("command"), read_log(path).of("measurement")[1:]
    away = [
        np.abs(np.array(s["angles_rad"]) - c["planned_rad"]).max()
        for c, s in zip(commands, states, strict=True)
    ]
    assert worst == pytest.approx(1e3 * max(away))


def test_worlds_by_name_ask_for_their_files(accepted: Accepted, tmp_path: Path) -> None:

    course = accepted.plan.problem
    for name, named in (
        ("dynamixel", "setup"),
        ("ros", "setup"),
        ("gazebo", "world"),
    ):
        with refuses(named):
            make_world(name, course.robot)
    with refuses("none.yaml"):
        make_world("mujoco", course.robot, setup=tmp_path / "none.yaml")


def test_a_set_up_file_that_names_another_robot_is_refused(
    accepted: Accepted, tmp_path: Path
) -> None:
    from stancekit.runner.worlds.dynamixel.control_table import nominal
    from stancekit.runner.worlds.ros.joint_states import same_names

    course, joints = accepted.plan.problem, accepted.plan.problem.robot.joint_names
    setup = tmp_path / "setup.yaml"
    for who in (None, "hexapod"):
        nominal(course.robot, port="none", robot=who).write(setup)
        with make_world("dynamixel", course.robot, setup=setup) as world:
            assert world.joints == joints
        same_names(joints, robot=who).write(setup)
        with make_world("ros", course.robot, setup=setup) as world:
            assert world.joints == joints
    same_names(joints, robot="ant").write(setup)
    with refuses("setup.yaml", "robot"):
        make_world("ros", course.robot, setup=setup)
    nominal(course.robot, port="none", robot="ant").write(setup)
    with refuses("setup.yaml", "robot"):
        make_world("dynamixel", course.robot, setup=setup)


def test_a_run_in_which_a_foot_feels_nothing_stops_and_names_it(accepted: Accepted) -> None:
    from stancekit.runner.worlds.world import Imperfections

    for deaf in ((), (1,)):
        world = make_world(
            "mujoco", accepted.plan.problem.robot, imperfections=Imperfections(deaf=deaf)
        )
        report = Runner(world, settings=FAST).run(accepted)
        assert report.succeeded is (not deaf), report.message
        name = accepted.plan.problem.robot.limb_names[1]
        assert (f"foot of {name}: " in report.message) is bool(deaf)


UNCHECKED = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)


def executed(plan: Motion, world: str = "mujoco", **options: Any) -> Execution:
    """What the record of a simulation says."""
    report = stancekit.simulate(plan, world, **({"settings": UNCHECKED} | options))
    assert report.succeeded == report.execution.succeeded
    return report.execution


@pytest.fixture(scope="module")
def climbed(step: Callable[[str], Motion]) -> Execution:
    return executed(step("walls"))


@pytest.mark.parametrize(("course", "world"), [("stairs", "mujoco"), ("walls", "bullet")])
def test_a_step_is_executed_as_planned(
    course: str, world: str, step: Callable[[str], Motion]
) -> None:
    pytest.importorskip({"bullet": "pybullet", "mujoco": "mujoco"}[world])
    run = executed(step(course), world)
    assert run.succeeded, run.message
    assert run.fallen_s is None
    assert run.com_worst_m < 0.006
    assert run.slip_m.max() < 0.005
    assert run.force_rms_n < 6.0
    assert run.error_m < 1e-4
    assert run.bump_s == 0.0
    assert run.torque_worst_nm < run.torque_limit_nm


def test_at_the_end_every_foot_presses_as_planned(climbed: Execution) -> None:
    trace = climbed.trace
    np.testing.assert_allclose(
        trace.forces_n[-20:].mean(axis=0), trace.planned_forces_n[-1], atol=4.0
    )
    np.testing.assert_allclose(
        trace.forces_n[-20:].mean(axis=0).sum(axis=0), [0.0, 0.0, 98.1], atol=0.5
    )


def test_the_trace_is_consistent(climbed: Execution) -> None:
    trace = climbed.trace
    assert trace.time_s[-1] == pytest.approx(climbed.seconds)
    np.testing.assert_allclose(np.diff(trace.time_s), 0.005, atol=1e-9)
    away = np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1)
    assert climbed.com_worst_m == pytest.approx(away.max())
    assert 0.0 < np.linalg.norm(trace.com_m - trace.origin_m, axis=1).max() < 0.015


def test_the_same_plan_runs_the_same_way_twice(
    step: Callable[[str], Motion], climbed: Execution
) -> None:
    again = executed(step("walls"))
    np.testing.assert_array_equal(again.trace.com_m, climbed.trace.com_m)
    np.testing.assert_array_equal(again.trace.forces_n, climbed.trace.forces_n)


def test_walls_that_are_more_slippery_than_planned_end_in_a_fall_that_is_reported(
    step: Callable[[str], Motion],
) -> None:
    run = executed(step("walls"), settings=RunSettings(check_limits=False, friction_share=0.2))
    assert not run.succeeded
    assert run.fallen_s is not None
    assert run.slip_m.max() > Tolerance().slip_m
    assert_names(run.message, f"{run.fallen_s:.2f} s")
    assert run.seconds == pytest.approx(run.fallen_s)


def test_what_is_not_good_enough_is_said_in_full(step: Callable[[str], Motion]) -> None:
    run = executed(
        step("walls"), settings=replace(UNCHECKED, tolerance=Tolerance(com_m=1e-7, slip_m=1e-7))
    )
    assert not run.succeeded
    assert run.fallen_s is None
    assert min(run.com_final_m, run.slip_m.max()) > 1e-7
    assert_names(run.message, "centre of mass", "slipped")


def test_the_report_is_json_and_the_trace_an_archive(
    climbed: Execution, tmp_path: pytest.TempPathFactory
) -> None:
    said = json.loads(json.dumps(climbed.to_json(), allow_nan=False))
    assert said["world"] == "mujoco"
    assert len(said["slip_m"]) == 9
    assert "trace" not in said
    path = tmp_path / "trace.npz"  # type: ignore[operator]
    path.write_bytes(climbed.trace.to_npz())
    with np.load(path, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["com_m"], climbed.trace.com_m)


def test_what_a_foot_rolls_is_no_slip_but_what_it_slides_is(climbed: Execution) -> None:
    trace = climbed.trace
    standing = int(trace.foothold[0, 0])
    slid = trace.feet_m.copy()
    slid[len(slid) // 2 :, 0] += [0.0, 0.0, 0.01]
    assert replace(trace, feet_m=slid).slips(9)[standing] == pytest.approx(0.01, abs=0.003)
    rolled = trace.rolled_m.copy()
    rolled[len(slid) // 2 :, 0] += [0.0, 0.0, 0.01]
    both = replace(trace, feet_m=slid, rolled_m=rolled).slips(9)[standing]
    assert both == pytest.approx(trace.slips(9)[standing], abs=1e-12)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan for a quadruped of a file, which bears some push, and not .9 of its weight."""
    folder = tmp_path_factory.mktemp("tipping")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(
        "name: flat\nrobot: dog.urdf\nframes: 2\ngait: wave\nstart_m: [0.0, 0.0]\n"
        "goal_m: [0.05, 0.0, 0.45]\nterrain: {kind: flat, friction: 0.7}\n"
    )
    outcome = with_whole_body(plan_with_reserve(TwoStage(), read_course(folder / "flat.yaml")))
    assert outcome.solution is not None
    assert outcome.report.accepted
    write_motion(folder / "dog.json", outcome.solution, outcome.report)
    return folder / "dog.json"


@pytest.fixture(scope="module")
def tipped(file: Path) -> Accepted:
    return Accepted.from_file(file)


def prepare(tipped: Accepted, **settings: object) -> Prepared:
    course = tipped.plan.problem
    with make_world("mujoco", course.robot, gravity_m_s2=course.gravity_m_s2) as world:
        return Runner(world, settings=RunSettings(**settings)).prepare(tipped)  # type: ignore[arg-type]


def test_a_plan_that_bears_less_is_refused_in_one_line(tipped: Accepted, file: Path) -> None:
    with refuses(file):
        prepare(tipped, least_push=0.9)


@pytest.mark.parametrize("settings", [{}, {"least_push": 0.0}], ids=["enough", "asked for"])
def test_a_plan_that_bears_enough_or_is_asked_for_is_not(
    tipped: Accepted, settings: dict[str, float]
) -> None:
    assert prepare(tipped, **settings).motion.pace > 0.0


def test_a_simulation_that_breaks_limits_has_none(tipped: Accepted) -> None:
    assert prepare(tipped, least_push=0.9, check_limits=False).motion.pace > 0.0


def test_the_verifier_accepts_it(tipped: Accepted) -> None:
    report = check_plan(tipped.plan, margins=True)
    assert report.accepted
    push_n = report.group(MARGIN).figures["push_n"]
    assert tipping(tipped.plan, 1.01 * push_n / tipped.plan.problem.weight_n)
    assert not tipping(tipped.plan, 0.99 * push_n / tipped.plan.problem.weight_n)
