"""The heartbeat monitor: what it does for a host that is killed or stands still, and when it does
nothing.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Literal

import pytest

from stancekit.runner.safety.estop import StopLatch
from stancekit.runner.safety.guard import Watchdog
from stancekit.runner.safety.heartbeat import ANSWER_S, BUS, ROUNDS, HeartbeatMonitor, _cancelled
from stancekit.runner.worlds.ros.bridge import RosLink
from stancekit.runner.worlds.ros.setup import same_names
from tests.emulators.ros_robots import JOINTS, START, commands
from tests.emulators.rosbridge import RosBridge
from tests.refusals import refuses

LIMIT_S = 1.0
HOST = """
import sys
import numpy as np
from stancekit.runner.safety.heartbeat import HeartbeatMonitor
from stancekit.runner.worlds.ros.driver import RosWorld
from tests.emulators.ros_robots import JOINTS, ROBOT, START, reset, same_names

setup = same_names(JOINTS, port=int(sys.argv[1]), ros=int(sys.argv[2]))
with HeartbeatMonitor(float(sys.argv[3]), setup) as monitor, RosWorld(ROBOT, setup) as world:
    reset(world)
    world.torque(True)
    world.run_trajectory(np.array([4.9]), START[None, :] + 1.0, lambda state: monitor.beat())
"""
"""Hands a whole trajectory over, which goes on without its host, and beats for every feedback."""


def until(true: Callable[[], bool], limit_s: float) -> float:
    """How long it takes until this is so."""
    begin = time.monotonic()
    while not true():
        assert time.monotonic() < begin + limit_s
        time.sleep(0.005)
    return time.monotonic() - begin


@pytest.mark.parametrize(("ros", "number"), [(1, signal.SIGSTOP), (2, signal.SIGKILL)])
def test_a_goal_whose_host_is_killed_or_stands_still_is_cancelled(
    ros: Literal[1, 2], number: signal.Signals
) -> None:
    with RosBridge(JOINTS, START, ros=ros) as bridge:
        arguments = [str(bridge.port), str(ros), str(LIMIT_S)]
        host = subprocess.Popen(
            [sys.executable, "-c", HOST, *arguments], stderr=subprocess.PIPE, text=True
        )
        try:
            until(lambda: bridge.state()["position_rad"][0] > 0.1, 30.0)  # on its way, and beating
            before = commands(bridge).count("cancel")  # of the probe
            host.send_signal(number)
            took_s = until(lambda: commands(bridge).count("cancel") > before, 5.0)
            assert took_s < (LIMIT_S if number == signal.SIGSTOP else 0.0) + 1.5
            stopped = bridge.state()["desired_rad"]
            time.sleep(0.3)
            assert bridge.state()["desired_rad"] == stopped
            assert stopped[0] < 0.9
        finally:
            host.send_signal(signal.SIGCONT)
            host.kill()
            said = host.communicate()[1]
        why = (
            "the host is gone"
            if number == signal.SIGKILL
            else f"the host was silent for {LIMIT_S:g} s"
        )
        assert (
            f"stancekit: heartbeat monitor: {why}: a cancel was sent for all goals of /joint_trajectory_controller"
            in said
        )
        assert bridge.errors == []


def test_it_cancels_nothing_while_the_host_beats_or_rests_or_takes_its_leave() -> None:
    with RosBridge(JOINTS, START) as bridge:
        with HeartbeatMonitor(1.0, same_names(JOINTS, port=bridge.port)) as monitor:
            watchdog = Watchdog(StopLatch(), float("inf"), monitor=monitor)
            for _ in range(40):
                watchdog.kick()
                time.sleep(0.01)
            watchdog.rest()
            time.sleep(1.2)
            assert monitor.gone() is None
        assert commands(bridge) == []
        assert monitor.gone() is None


def test_for_servos_it_opens_nothing_and_says_who_stops_them(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with HeartbeatMonitor(0.1) as monitor:
        monitor.beat()
        until(lambda: monitor.gone() is not None, 5.0)
        assert monitor.gone() == "the heartbeat monitor is gone"
        monitor.beat()  # to nobody
    assert (
        capfd.readouterr().err
        == f"stancekit: heartbeat monitor: the host was silent for 0.1 s: {BUS}\n"
    )


def test_a_heartbeat_monitor_that_is_killed_is_a_reason_to_stop() -> None:
    latch = StopLatch()
    with HeartbeatMonitor(1.0) as monitor:
        latch.listen(monitor.gone)
        latch.poll()
        assert not latch.tripped
        os.kill(monitor.pid, signal.SIGKILL)
        until(lambda: monitor.gone() is not None, 5.0)
        latch.poll()
    assert latch.reason == "the heartbeat monitor is gone"


def test_a_heartbeat_monitor_that_stands_still_is_a_reason_to_stop_and_keeps_nobody_waiting() -> (
    None
):
    def beaten() -> bool:
        monitor.beat()
        return monitor.gone() is not None

    with HeartbeatMonitor(0.3) as monitor:
        lives = time.monotonic() + 1.2 * max(4.0 * monitor.limit_s, ANSWER_S)
        while time.monotonic() < lives:
            assert not beaten()
            time.sleep(0.01)
        pid = monitor.pid
        os.kill(pid, signal.SIGSTOP)
        until(beaten, 5.0)
        assert monitor.gone() == "the heartbeat monitor does not answer"
        left = time.monotonic()
    assert time.monotonic() < left + 1.0
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_close_that_finds_no_room_or_no_reader_ends_the_monitor_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("stancekit.runner.safety.heartbeat.END_S", 0.2)
    for beats in (1, 100000):  # more than a pipe has room for
        with HeartbeatMonitor(60.0) as monitor:
            os.kill(monitor.pid, signal.SIGSTOP)
            for _ in range(beats):
                monitor.beat()
            left = time.monotonic()
        assert time.monotonic() < left + 2.0
    assert capfd.readouterr().err == ""


def test_a_heartbeat_monitor_that_ends_before_it_got_anything_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    began = subprocess.Popen

    def ended(*arguments: Any, **options: Any) -> subprocess.Popen[bytes]:
        child = began(*arguments, **options)
        child.wait(5.0)
        return child

    monkeypatch.setattr(subprocess, "Popen", ended)
    with refuses("heartbeat monitor"):
        HeartbeatMonitor(1.0).__enter__()


def test_a_cancel_over_a_new_connection_leaves_none_open(monkeypatch: pytest.MonkeyPatch) -> None:
    links: list[RosLink] = []

    class Noted(RosLink):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            links.append(self)

    monkeypatch.setattr("stancekit.runner.safety.heartbeat.RosLink", Noted)
    with RosBridge(JOINTS, START) as bridge:
        setup = same_names(JOINTS, port=bridge.port)
        lost = RosLink(setup.host, setup.port, setup.timeout_s)  # never opened, so of no use
        assert (
            _cancelled(setup, lost)
            == "a cancel was sent for all goals of /joint_trajectory_controller"
        )
        assert commands(bridge).count("cancel") == ROUNDS
    assert [link.ros for link in links] == [None]


def test_where_no_rosbridge_is_it_does_not_begin() -> None:
    with RosBridge(JOINTS, START) as bridge:
        port = bridge.port
    with refuses("heartbeat monitor", f"ws://127.0.0.1:{port}"):
        HeartbeatMonitor(1.0, same_names(JOINTS, port=port)).__enter__()
