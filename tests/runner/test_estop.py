"""The stop latch and its sources: signals, files, keys, callables; and the watchdog."""

from __future__ import annotations

import os
import pty
import signal
import threading
import time
from pathlib import Path

import pytest

from stancekit.runner.safety.estop import (
    SIGNALS,
    Source,
    StopLatch,
    Stopped,
    file_source,
    key_source,
    on_signals,
    raw_keys,
    reader_source,
    watched,
)
from stancekit.runner.safety.guard import Watchdog
from tests.refusals import refuses


def listening(*sources: Source) -> StopLatch:
    latch = StopLatch()
    latch.listen(*sources)
    return latch


def wait_for(latch: StopLatch, limit_s: float = 5.0) -> None:
    end = time.monotonic() + limit_s
    while not latch.tripped and time.monotonic() < end:
        time.sleep(0.001)
    assert latch.tripped


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
    path = tmp_path / "stop"
    latch = listening(file_source(path))
    with watched(latch):
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
    latch = listening(key_source(terminal))
    with raw_keys(terminal):
        latch.poll()
        assert not latch.tripped
        os.write(main, b" ")
        with watched(latch):
            wait_for(latch)
    assert latch.reason == "a key was pressed"
    os.close(main)
    os.close(terminal)


def test_a_terminal_that_is_gone_stops_and_its_keys_are_put_back_without_complaint() -> None:
    main, terminal = pty.openpty()
    keys, output = listening(key_source(terminal)), listening(reader_source(terminal))
    with raw_keys(terminal):
        for latch in (keys, output):
            latch.poll()
            assert not latch.tripped
        os.close(main)
        for latch in (keys, output):
            latch.poll()
    assert keys.reason == "the terminal is gone"
    assert output.reason == "the terminal is gone, or whoever read the output"
    os.close(terminal)


def test_output_that_nobody_reads_any_more_stops_before_anything_is_written() -> None:
    reader, writer = os.pipe()
    latch = listening(reader_source(writer))
    latch.poll()
    assert not latch.tripped
    os.close(reader)
    latch.poll()
    assert latch.reason == "the terminal is gone, or whoever read the output"
    os.close(writer)


def test_a_hang_up_that_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with on_signals(StopLatch()):
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            assert callable(signal.getsignal(signal.SIGTERM))
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_source_that_hangs_does_not_keep_the_watch_from_ending(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("stancekit.runner.safety.estop.JOIN_S", 0.01)
    hung = threading.Event()
    latch = listening(lambda: str(hung.wait(5.0)))
    with watched(latch):
        time.sleep(0.02)
    latch.poll()  # the loop asks while another thread waits for the answer
    assert latch.reason == "a source of stops did not answer for 0.25 s"
    hung.set()


def test_a_source_that_fails_stops() -> None:
    def broken() -> str | None:
        raise OSError("gone")

    latch = listening(broken)
    latch.poll()
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


def test_a_process_that_stood_still_is_stopped_before_anything_is_sent_again() -> None:
    now, latch = [0.0], StopLatch()
    with Watchdog(latch, 1.0, lambda: now[0]) as dog:
        dog.guard()
        now[0] = 0.9
        dog.look()
        assert not latch.tripped
        now[0] = 2.5  # SIGSTOP, and SIGCONT later: its own thread did not run, either
        latch.listen(dog.look)
        with (
            refuses("1 s", kind=Stopped),
            latch.sending(),
        ):
            raise AssertionError("it was let through")
