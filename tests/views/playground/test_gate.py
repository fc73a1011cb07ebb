"""Who may change a playground, and what with: a bare client on its websocket says what a browser
would, or worse.
"""

from __future__ import annotations

import logging
import math
import socket
import time
import warnings

import numpy as np
import pytest

from stancekit.views.playground.keys_scenario import KeysScenario
from stancekit.views.playground.serving import FEW, may_connect, misfit, own_names, served

GRIP = "/grips/goal"
TURN = [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("origin", "host", "fine"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://192.168.1.7:8080", "192.168.1.7:8080", True),
        ("HTTP://Localhost:8080", "localhost:8080", True),
        ("http://127.0.0.1:8081", "127.0.0.1:8080", False),
        ("http://localhost:8080", "127.0.0.1:8080", False),
        ("https://127.0.0.1:8080", "127.0.0.1:8080", False),
        ("https://evil.example", "127.0.0.1:8080", False),
        ("http://evil.example:8080", "evil.example:8080", False),  # its name server points at us
        ("http://127.0.0.1.evil.example:8080", "127.0.0.1.evil.example:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("", "127.0.0.1:8080", False),
        (None, "127.0.0.1:8080", False),
        ("http://127.0.0.1:8080", None, False),
    ],
)
def test_only_pages_that_were_served_here_may_connect(origin, host, fine):
    assert may_connect(origin, host, own_names("127.0.0.1")) is fine


def test_a_page_may_be_found_by_the_name_of_this_machine():
    name = socket.gethostname()
    assert may_connect(f"http://{name}:80", f"{name}:80", own_names("0.0.0.0"))
    assert may_connect("http://robot.lab:80", "robot.lab:80", own_names("robot.lab"))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A playground over two walls."""
    with served(KeysScenario.of("walls"), folder=tmp_path_factory.mktemp("saved")) as shown:
        yield shown


def joined(page, origin="own", version=None):
    """A client's connection. Raises websockets' InvalidStatus where it is refused."""
    import viser
    from websockets.sync.client import connect

    return connect(
        page.address.replace("http", "ws"),
        subprotocols=[f"viser-v{version or viser.__version__}"],
        max_size=2**28,
        origin=page.address if origin == "own" else origin,
        compression=None,
        open_timeout=60,
    )


@pytest.mark.parametrize("origin", ["https://evil.example", "http://127.0.0.1:1", "null", None])
def test_a_foreign_page_is_refused_before_it_can_say_anything(page, origin, caplog):
    from websockets.exceptions import InvalidStatus

    before = page.playground.session.number
    with caplog.at_level(logging.WARNING), pytest.raises(InvalidStatus) as refused:
        joined(page, origin)
    assert refused.value.response.status_code == 403
    (line,) = [each.getMessage() for each in caplog.records if each.name.endswith("serving")]
    assert line.startswith("refused: ")
    assert page.playground.session.number == before


def drag(position, turn=TURN):
    return {
        "type": "TransformControlsUpdateMessage",
        "name": GRIP,
        "wxyz": turn,
        "position": position,
        "owner": "",
    }


def slide(page, value, name="value"):
    (uuid,) = (
        known._impl.uuid
        for key, known in page.playground._controls._sliders.items()
        if key == "friction"
    )
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: value}}


def camera(**other):
    """Where a tab looks from; a browser's sizes need not be whole."""
    seen = {
        "type": "ViewerCameraMessage",
        "wxyz": TURN,
        "position": [1, 2, 3.5],
        "fov": 0.7,
        "near": 0.1,
        "far": 9,
        "image_height": 600.5,
        "image_width": 800,
        "look_at": [0, 0, 0],
        "up_direction": [0, 0, 1],
    }
    return seen | other


def test_messages_of_a_browser_fit():
    encode = pytest.importorskip("msgspec").msgpack.encode
    for message in (
        camera(),
        drag([0, 1, 2]),
        {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": [1]}},
    ):
        assert not misfit(encode(message))
    fault = "ViewerCameraMessage: position: Expected `array` of length 3, got 2"
    assert misfit(encode(camera(position=[1.0, 2.0]))) == fault
    for rubbish in (
        b"",
        b"\xc1",
        "words",
        encode([1]),
        encode({"type": "None"}),
        encode({"type": []}),
        encode({}),
    ):
        assert not misfit(rubbish)  # viser ends such a connection itself


WRONG = {
    "a camera without height": lambda page: camera(position=[1.0, 2.0]),
    "not a number": lambda page: drag([math.nan, 0.0, 0.0]),
    "without end": lambda page: drag([0.0, math.inf, 0.0]),
    "two numbers": lambda page: drag([1.0, 2.0]),
    "words": lambda page: drag(["a", "b", "c"]),
    "three of four": lambda page: drag([0.0, 0.0, 0.3], TURN[:3]),
    "slid to no number": lambda page: slide(page, math.nan),
    "slid to a word": lambda page: slide(page, "much"),
    "slid to a list": lambda page: slide(page, [0.5]),
    "slid beyond its end": lambda page: slide(page, 9.0),
    "another label": lambda page: slide(page, "mine", "label"),
    "handed to a method": lambda page: slide(page, 1.0, "removed"),
    "a long word": lambda page: {
        "type": "GuiUpdateMessage",
        "uuid": page.playground._files._name._impl.uuid,
        "updates": {"value": "x" * (FEW + 1)},
    },
    "no robot": lambda page: {
        "type": "GuiUpdateMessage",
        "uuid": page.playground._menu._impl.uuid,
        "updates": {"value": "horse"},
    },
}


@pytest.mark.parametrize("name", list(WRONG))
def test_a_value_that_makes_no_sense_is_one_line_and_changes_nothing(page, name, caplog, capfd):
    import msgspec

    before = page.playground.session.number
    with (
        caplog.at_level(logging.WARNING),
        warnings.catch_warnings(record=True) as warned,
        joined(page) as line,
    ):
        warnings.simplefilter("always")
        line.send(msgspec.msgpack.encode(WRONG[name](page)))
        wait_until(lambda: any(each.name.endswith("serving") for each in caplog.records))
        said = [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]
    assert len(said) == 1, said
    assert said[0].startswith(("ignored: a page sent ", "ended: a page sent what is no message: "))
    assert "\n" not in said[0]
    assert not [str(each.message) for each in warned]
    assert page.playground.session.number == before
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("raw", [b"\xc1\xff\xff", "words", b"", b"\x00" * 4096])
def test_rubbish_ends_its_own_connection_and_no_other(page, raw, capfd):
    import msgspec

    before = page.playground.session.number
    with joined(page) as other:
        with joined(page) as line:
            line.send(raw)
        goal = page.playground.session.scenario.course().goal_m
        other.send(msgspec.msgpack.encode(drag(np.add(goal, [0.0, 0.0, 0.01]).tolist())))
        wait_until(lambda: page.playground.session.number > before)
    assert "Traceback" not in capfd.readouterr().err


def wait_until(true, patience_s=60.0):
    """Until something is so."""
    until = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < until, "it never came to be"
        time.sleep(0.02)


def test_the_page_is_ours_and_whole(page):
    from gzip import decompress
    from urllib.request import Request, urlopen

    with urlopen(page.address) as answer:
        plain = answer.read()
    with urlopen(Request(page.address, headers={"Accept-Encoding": "gzip"})) as answer:
        assert decompress(answer.read()) == plain
    assert plain.count(b"<title>Stancekit playground</title>") == 1
    assert b"stancekit-verdict" in plain
