"""The stop latch: asked and sent as one, counted from the moment it was tripped, by whomever."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from stancekit.runner.safety.estop import StopLatch, Stopped, on_signals
from tests.refusals import refuses


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
        sender.join(5.0)
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
            end = time.monotonic() + 5.0
            while not latch.tripped and time.monotonic() < end:
                time.sleep(0.001)
        with refuses(number.name, kind=Stopped):
            latch.check()
    assert latch.after == 1


def test_a_write_that_fails_gives_the_lock_back() -> None:
    latch = StopLatch()
    with refuses("cable", kind=OSError), latch.sending():
        raise OSError("cable")
    other = threading.Thread(target=latch.settle)
    other.start()
    other.join(5.0)
    assert not other.is_alive()


def test_sources_are_asked_for_every_write() -> None:
    latch, pressed = StopLatch(), [""]
    latch.listen(lambda: pressed[0] or None)
    with latch.sending():
        pass
    pressed[0] = "mushroom button"
    with refuses("mushroom button", kind=Stopped), latch.sending():
        raise AssertionError("it was let through")
