"""The stop latch and its sources: signals, files, keys, callables; and the watchdog."""

from __future__ import annotations

import os
import pty
import signal
import threading
import time
from pathlib import Path

import pytest

from stancekit.envs.runner.estop import (
    SIGNALS,
    StopLatch,
    Stopped,
    file_source,
    key_source,
    on_signals,
    raw_keys,
    watched,
)
from stancekit.envs.runner.watchdog import Watchdog


def wait_for(latch: StopLatch, limit_s: float = 5.0) -> None:
    end = time.monotonic() + limit_s
    while not latch.tripped and time.monotonic() < end:
        time.sleep(0.001)
    assert latch.tripped


def test_a_latch_keeps_its_first_reason_and_never_opens_again() -> None:
    now = [3.0]
    latch = StopLatch(lambda: now[0])
    latch.check()
    assert (latch.tripped, latch.reason) == (False, "")
    latch.trip("first")
    now[0] = 4.0
    latch.trip("second")
    assert (latch.tripped, latch.reason, latch.time_s) == (True, "first", 3.0)
    with pytest.raises(Stopped, match="first"):
        latch.check()


@pytest.mark.parametrize("number", SIGNALS)
def test_signals_trip_it_and_the_handlers_before_come_back(number: signal.Signals) -> None:
    latch, before = StopLatch(), signal.getsignal(number)
    with on_signals(latch):
        os.kill(os.getpid(), number)
        wait_for(latch)
    assert latch.reason == f"signal {number.name}"
    assert signal.getsignal(number) is before


def test_outside_the_main_thread_signals_are_left_alone() -> None:
    before, seen = signal.getsignal(signal.SIGTERM), []

    def inside() -> None:
        with on_signals(StopLatch()):
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert seen == [before]


def test_a_file_that_appears_stops_within_milliseconds(tmp_path: Path) -> None:
    latch, path = StopLatch(), tmp_path / "stop"
    with watched(latch, [file_source(path)]):
        time.sleep(0.02)
        assert not latch.tripped
        made = time.monotonic()
        path.touch()
        wait_for(latch)
    assert latch.reason == "stop file stop is there"
    assert latch.time_s - made < 1.0


def test_a_dangling_link_is_a_stop_file_too(tmp_path: Path) -> None:
    (tmp_path / "stop").symlink_to(tmp_path / "nowhere")
    assert file_source(tmp_path / "stop")() is not None


def test_a_single_key_stops_without_return() -> None:
    main, terminal = pty.openpty()
    latch, source = StopLatch(), key_source(terminal)
    with raw_keys(terminal):
        latch.poll([source])
        assert not latch.tripped
        os.write(main, b" ")
        with watched(latch, [source]):
            wait_for(latch)
    assert latch.reason == "a key was pressed"
    os.close(main)
    os.close(terminal)


def test_a_source_that_fails_stops() -> None:
    latch = StopLatch()

    def broken() -> str | None:
        raise OSError("gone")

    latch.poll([broken])
    assert latch.reason == "a source of stops failed: OSError: gone"


def test_a_watchdog_trips_while_the_loop_hangs_and_not_before() -> None:
    latch = StopLatch()
    with Watchdog(latch, 0.3) as dog:
        time.sleep(0.4)
        assert not latch.tripped  # nothing was kicked yet
        for _ in range(5):
            dog.kick()
            time.sleep(0.02)
        assert not latch.tripped
        last = time.monotonic()
        wait_for(latch)
    assert latch.reason.startswith("host watchdog: the loop was silent for 0.3")
    assert latch.time_s - last < 2.0


def test_a_loop_that_rests_is_not_watched() -> None:
    now, latch = [0.0], StopLatch()
    dog = Watchdog(latch, 0.1, lambda: now[0])
    dog.kick()
    dog.rest()
    now[0] = 10.0
    dog.kick()
    assert not latch.tripped
    now[0] = 10.2
    dog.look()
    assert latch.tripped
