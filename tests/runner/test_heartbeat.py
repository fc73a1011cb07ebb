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
from typing import Any

import pytest

from stancekit.runner.safety.estop import StopLatch
from stancekit.runner.safety.guard import Watchdog
from stancekit.runner.safety.heartbeat import ANSWER_S, HeartbeatMonitor
from tests.refusals import refuses

LIMIT_S = 1.0
HOST = """
import sys, time
from stancekit.runner.safety.heartbeat import HeartbeatMonitor

with HeartbeatMonitor(float(sys.argv[1]), "it holds") as monitor:
    monitor.beat()
    print("beating", flush=True)
    while True:
        monitor.beat()
        time.sleep(0.02)
"""


def until(true: Callable[[], bool]) -> None:
    """Wait until this is so, a minute or more."""
    for _ in range(12_000):
        if true():
            return
        time.sleep(0.005)
    raise AssertionError("it does not come about")


@pytest.mark.parametrize(
    ("number", "why"),
    [
        (signal.SIGSTOP, f"the host was silent for {LIMIT_S:g} s"),
        (signal.SIGKILL, "the host is gone"),
    ],
)
def test_of_a_host_that_is_killed_or_stands_still_it_says_what_stops_the_robot(
    number: signal.Signals, why: str
) -> None:
    host = subprocess.Popen(
        [sys.executable, "-c", HOST, str(LIMIT_S)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert host.stdout.readline() == "beating\n"
        host.send_signal(number)
        assert host.stderr.readline() == f"stancekit: heartbeat monitor: {why}: it holds\n"
    finally:
        host.send_signal(signal.SIGCONT)
        host.kill()
        host.communicate()


def test_it_says_nothing_while_the_host_beats_or_rests_or_takes_its_leave(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with HeartbeatMonitor(1.0, "it holds") as monitor:
        watchdog = Watchdog(StopLatch(), float("inf"), monitor=monitor)
        for _ in range(40):
            watchdog.kick()
            time.sleep(0.01)
        watchdog.rest()
        time.sleep(1.2)
        assert monitor.gone() is None
    assert monitor.gone() is None
    assert capfd.readouterr().err == ""


def test_one_that_has_spoken_is_gone(capfd: pytest.CaptureFixture[str]) -> None:
    with HeartbeatMonitor(0.1, "it holds") as monitor:
        monitor.beat()
        until(lambda: monitor.gone() is not None)
        assert monitor.gone() == "the heartbeat monitor is gone"
        monitor.beat()  # to nobody
    assert capfd.readouterr().err.count("\n") == 1


def test_a_heartbeat_monitor_that_is_killed_is_a_reason_to_stop() -> None:
    latch = StopLatch()
    with HeartbeatMonitor(1.0, "") as monitor:
        latch.listen(monitor.gone)
        latch.poll()
        assert not latch.tripped
        os.kill(monitor.pid, signal.SIGKILL)
        until(lambda: monitor.gone() is not None)
        latch.poll()
    assert latch.reason == "the heartbeat monitor is gone"


def test_a_heartbeat_monitor_that_stands_still_is_a_reason_to_stop_and_keeps_nobody_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = [0.0]

    def beaten() -> bool:
        monitor.beat()
        now_s[0] += 0.1 * monitor.limit_s
        return monitor.gone() is not None

    with HeartbeatMonitor(60.0, "", clock=lambda: now_s[0]) as monitor:
        while now_s[0] < 1.2 * max(4.0 * monitor.limit_s, ANSWER_S):
            assert not beaten()
            until(lambda: monitor.gone() is None and monitor._asked_s is None)  # it answers
        pid = monitor.pid
        os.kill(pid, signal.SIGSTOP)
        until(beaten)
        assert monitor.gone() == "the heartbeat monitor does not answer"
        monkeypatch.setattr("stancekit.runner.safety.heartbeat.END_S", 3600.0)  # nobody waits
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_close_that_finds_no_room_or_no_reader_ends_the_monitor_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("stancekit.runner.safety.heartbeat.END_S", 0.2)
    for beats in (1, 100000):  # more than a pipe has room for
        with HeartbeatMonitor(60.0, "") as monitor:
            pid = monitor.pid
            os.kill(pid, signal.SIGSTOP)
            for _ in range(beats):
                monitor.beat()
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert capfd.readouterr().err == ""


def test_a_heartbeat_monitor_that_ends_before_it_got_anything_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    began = subprocess.Popen

    def ended(*arguments: Any, **options: Any) -> subprocess.Popen[bytes]:
        child = began(*arguments, **options)
        child.wait(60.0)
        return child

    monkeypatch.setattr(subprocess, "Popen", ended)
    with refuses("heartbeat monitor"):
        HeartbeatMonitor(1.0, "").__enter__()
