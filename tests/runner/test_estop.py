"""The stop latch and its sources: signals, files, keys, callables; and the watchdog."""

from __future__ import annotations

import inspect
import os
import pty
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

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
from stancekit.runner.worlds.ros.bridge import StopTopic
from tests.emulators.rosbridge import RosBridge
from tests.refusals import refuses


def listening(*sources: Source) -> StopLatch:
    latch = StopLatch()
    latch.listen(*sources)
    return latch


def wait_for(latch: StopLatch) -> None:
    """Wait until it trips, a minute or more."""
    for _ in range(60_000):
        if latch.tripped:
            return
        time.sleep(0.001)
    raise AssertionError("nothing trips the latch")


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
    path, looks = tmp_path / "stop", list[None]()
    latch = StopLatch(lambda: float(len(looks)))
    latch.listen(lambda: looks.append(None), file_source(path))
    with watched(latch):
        while len(looks) < 3:
            time.sleep(0.001)
        assert not latch.tripped
        path.touch()
        made = len(looks)
        wait_for(latch)
    assert latch.reason == "stop file stop is there"
    assert latch.time_s <= made + 1
    assert inspect.signature(watched).parameters["period_s"].default < 0.01


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
    now, latch = [9.0], StopLatch()
    clock = Mock(side_effect=lambda: now[0])
    with Watchdog(latch, 0.3, clock) as dog:
        dog.look()
        for _ in range(3):
            dog.kick()  # the first after 9 s without any
            now[0] += 0.29
            looks = clock.call_count
            while clock.call_count < looks + 2:
                time.sleep(0.001)
            assert not latch.tripped
        now[0] += 0.02
        wait_for(latch)
    assert latch.reason.startswith("host watchdog: the loop was silent for 0.310 s")


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


def test_a_latch_keeps_its_first_reason_and_never_opens_again() -> None:
    now = [3.0]
    latch = StopLatch(lambda: now[0])
    latch.check()
    assert (latch.tripped, latch.reason) == (False, "")
    latch.trip("first")
    now[0] = 4.0
    latch.trip("second")
    assert (latch.tripped, latch.reason, latch.time_s) == (True, "first", 3.0)
    with refuses("first", kind=Stopped):
        latch.check()


def test_what_was_on_its_way_at_the_stop_is_counted_from_the_stop_and_nothing_follows_it() -> None:
    now, sent = [0.0], list[float]()
    latch = StopLatch(lambda: now[0])
    for _ in range(2):
        with latch.sending():
            sent.append(now[0])
    assert (latch.after, latch.sent_s) == (0, 0.0)
    now[0] = 1.0
    with latch.sending():  # asked already, not sent yet
        latch.trip("button")
        now[0] = 1.25
        sent.append(now[0])
    assert (latch.after, latch.after_s, latch.sent_s) == (1, 0.25, 1.25)
    for _ in range(3):
        with refuses("button", kind=Stopped), latch.sending():
            sent.append(now[0])
    assert sent == [0.0, 0.0, 1.25]
    assert latch.after == 1


def test_who_stops_and_settles_from_another_thread_knows_that_nothing_leaves_any_more() -> None:
    latch, asked, message = StopLatch(), threading.Event(), list[str]()

    def send() -> None:
        with latch.sending():
            asked.set()
            while not latch.tripped:
                time.sleep(0.001)
            time.sleep(0.02)  # between asking and sending
            message.append("sent")

    sender = threading.Thread(target=send)
    sender.start()
    asked.wait()
    latch.trip("button")
    assert message == []
    latch.settle()
    message.append("settled")
    sender.join()
    assert message == ["sent", "settled"]


def test_many_threads_that_send_are_stopped_at_once_wherever_they_are() -> None:
    latch, sent = StopLatch(), list[float]()

    def send() -> None:
        while True:
            try:
                with latch.sending():
                    sent.append(time.monotonic())
            except Stopped:
                return

    senders = [threading.Thread(target=send) for _ in range(4)]
    for sender in senders:
        sender.start()
    while len(sent) < 100:
        time.sleep(0.001)
    latch.trip("button")
    latch.settle()
    settled = time.monotonic()
    for sender in senders:
        sender.join(60.0)
        assert not sender.is_alive()
    assert max(sent) <= settled
    assert latch.after <= 1  # one lock: no more than one was between asking and sending


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_while_its_own_thread_sends_trips_without_waiting_for_the_lock(
    number: signal.Signals,
) -> None:
    latch = StopLatch()
    with on_signals(latch):
        with latch.sending():
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)
            wait_for(latch)
        with refuses(number.name, kind=Stopped):
            latch.check()
    assert latch.after == 1


def test_a_write_that_fails_gives_the_lock_back() -> None:
    latch = StopLatch()
    with refuses("cable", kind=OSError), latch.sending():
        raise OSError("cable")
    other = threading.Thread(target=latch.settle)
    other.start()
    other.join(60.0)
    assert not other.is_alive()


def test_sources_are_asked_for_every_write() -> None:
    latch, pressed = StopLatch(), [""]
    latch.listen(lambda: pressed[0] or None)
    with latch.sending():
        pass
    pressed[0] = "mushroom button"
    with refuses("mushroom button", kind=Stopped), latch.sending():
        raise AssertionError("it was let through")


@pytest.fixture
def bridge() -> Iterator[RosBridge]:
    with RosBridge(["a"]) as made:
        yield made


def reason(topic: StopTopic) -> str:
    """Why the topic stops, as a latch that polls it has it."""
    latch = listening(topic)
    with watched(latch):
        wait_for(latch)
    return latch.reason


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("e-stop", "e-stop pressed on /e_stop"),
        ("connection lost", "the connection is lost"),
        ("rosbridge gone", "the connection is lost"),
        ("not json", "expected a rosbridge message, got one that cannot be read"),
    ],
)
def test_a_button_that_is_pressed_or_cannot_be_read_stops(
    bridge: RosBridge, kind: str, why: str
) -> None:
    with StopTopic(f"127.0.0.1:{bridge.port}/e_stop") as topic:
        time.sleep(0.1)
        assert topic() is None
        bridge.inject(kind)
        assert why in reason(topic)


def test_a_message_that_is_no_truth_value_stops(bridge: RosBridge) -> None:
    with StopTopic(f"127.0.0.1:{bridge.port}/joint_states") as topic:
        assert "/joint_states: expected data to be true or false, got None" in reason(topic)


@pytest.mark.parametrize(
    "address", ["e_stop", "localhost/e_stop", "localhost:99999/e_stop", "localhost:9090"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with refuses("stop_topic"):
        StopTopic(address)


def test_where_no_rosbridge_is_nothing_begins(bridge: RosBridge) -> None:
    port = bridge.port
    bridge.close()
    with (
        refuses(),
        StopTopic(f"127.0.0.1:{port}/x"),
    ):
        pass
