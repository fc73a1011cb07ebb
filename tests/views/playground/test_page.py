"""The playground in headless Chromium: opened, dragged and read; what is saved the other commands
accept.
"""

from __future__ import annotations

import logging
import math
import re
import socket
import threading
import warnings

import msgspec
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from stancekit.planners.formats.motion_file import check_file
from stancekit.planners.motion.path import path_of
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.views.plans import PlanView, solver_of
from stancekit.views.playground import answers as session_module
from stancekit.views.playground.answers import (
    SceneAnswer,
    Session,
    limb_table,
    loads,
    patient_answer,
    quick_answer,
    summary,
    verdict,
)
from stancekit.views.playground.playground import Pictures, save_course, save_plan
from stancekit.views.playground.scenario import Scenario
from stancekit.views.playground.serving import FEW, may_connect, misfit, own_names, served
from stancekit.views.scene import UP
from tests.emulators.chromium import CHROMIUM, PATIENCE_S, opened
from tests.emulators.playground import middle_of, pixel_of
from tests.refusals import refuses

SIZE_PX = (1400, 900)
VERDICT = "document.querySelector('#verdict')"


def change_of(tab):
    """The number of the change whose answer is shown."""
    return int(tab.value(f"{VERDICT} ? {VERDICT}.dataset.change : -1"))


@pytest.fixture(scope="module")
def opened_once(tmp_path_factory):
    """A playground, and the tab that shows it."""
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with (
        served(Scenario.of("walls"), folder=tmp_path_factory.mktemp("playground")) as page,
        opened(page.address, tmp_path_factory.mktemp("profile"), SIZE_PX, draws=False) as tab,
    ):
        tab.wait_for(f"{VERDICT} !== null")
        yield page, tab


@pytest.fixture
def shown(opened_once):
    """It over two walls, as they are at first."""
    page, tab = opened_once
    number = page.playground.session.change(lambda _: Scenario.of("walls"))
    tab.wait_for(f"{VERDICT}.dataset.change >= {number}")
    return page, tab


def test_it_is_opened_dragged_and_read(shown):
    page, tab = shown
    tab.wait_for(f"{VERDICT}.dataset.patient === '1'")
    text = tab.text()
    assert "Accepted" in text
    assert "friction of all surfaces [μ]" in text
    assert "force [N]" in text
    assert "torque [Nm]" in text
    assert "hexapod, 10 kg (98.1 N)" in text

    goal = page.playground.session.scenario.course().goal_m  # drag it up by its arrow
    start, end = (pixel_of(page, tab, goal + up * UP) for up in (0.10, 0.16))
    before = page.playground.session.number
    tab.drag(start, end)
    tab.wait_for(f"{VERDICT}.dataset.change > {before}")
    scenario = page.playground.session.scenario
    moved = scenario.course().goal_m - goal
    assert moved[2] == pytest.approx(0.06, abs=0.015)
    assert moved[:2] == pytest.approx([0.0, 0.0], abs=1e-3)
    tab.wait_for(
        f"{VERDICT}.dataset.patient === '1' && {VERDICT}.dataset.change >= {change_of(tab)}"
    )
    found = TwoStage().solve(scenario.course())
    assert f"after {found.solution.problem.frames} key frames" in tab.text()

    for words in ("save plan", "save course"):
        tab.click(
            *middle_of(
                tab,
                f"[...document.querySelectorAll('button')].find(b => b.innerText === '{words}')",
            )
        )
        tab.wait_for(f"document.querySelector('#saved')?.innerText.includes('{words.split()[1]}.')")
    assert check_file(page.playground._folder / "played-plan.json").accepted
    again = read_course(page.playground._folder / "played-course.yaml")
    assert again.goal_m == pytest.approx(scenario.course().goal_m, abs=1e-9)


def test_a_slider_takes_the_friction_away_and_the_page_says_how_much_is_missing(shown):
    page, tab = shown
    x, y = middle_of(tab, "document.querySelector('[role=slider]')")
    tab.drag((x, y), (x - 400.0, y))
    tab.wait_for(f"{VERDICT}.innerText.startsWith('No plan')")
    said = tab.value(f"{VERDICT}.innerText")
    assert re.search(r"friction .* would have to rise from 0 to at least 0\.\d+", said), said
    assert "in hand" not in tab.text()
    assert page.playground.session.scenario.sliders()[0].value == 0.0


def test_the_courses_file_is_shown(shown):
    _, tab = shown
    tab.wait_for(f"{VERDICT}.dataset.patient === '1'")
    button = "[...document.querySelectorAll('button')].find(b => b.innerText === '{}')"
    tab.click(*middle_of(tab, button.format("show course")))
    said = tab.wait_for("document.querySelector('#course')?.innerText")
    assert said.startswith("name: walls\n")


def test_every_control_has_a_name_for_screen_readers(shown):
    _, tab = shown
    names = """[...document.querySelectorAll('[role=slider], input:not([type=hidden]), button')].map(each =>
        [each.tagName, each.getAttribute('aria-label') || each.labels?.[0]?.textContent || each.innerText])"""
    tab.wait_for(f"{names}.every(([_, name]) => name.trim())")
    found = tab.value(names)
    assert len(found) > 10
    assert any("friction of all surfaces" in name for _, name in found)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_the_verdict_is_in_sight_and_can_be_read(shown, scheme):
    _, tab = shown
    tab.ask(
        "Emulation.setDeviceMetricsOverride",
        width=390,
        height=844,
        deviceScaleFactor=1,
        mobile=True,
    )
    try:
        tab.value(f"document.documentElement.setAttribute('data-mantine-color-scheme', '{scheme}')")
        copy = "document.querySelector('#stancekit-verdict')"
        tab.wait_for(f"{copy}?.innerText.trim()")
        box = tab.value(f"JSON.parse(JSON.stringify({copy}.getBoundingClientRect()))")
        assert [box[side] for side in ("left", "top", "right")] == [0, 0, 390]
        assert 20 < box["bottom"] < 0.4 * 844
        ink, paper = (colour_of(tab, copy, name) for name in ("color", "backgroundColor"))
        assert contrast(ink, paper) > 7.0
        assert contrast(colour_of(tab, f"{copy}.querySelector('div > div')", "color"), paper) >= 4.5
    finally:
        tab.ask("Emulation.clearDeviceMetricsOverride")
        tab.value("document.documentElement.setAttribute('data-mantine-color-scheme', 'light')")


SPELT = """(() => {
    const numbers = colour => colour.match(/[\\d.]+/g).map(Number);
    const paper = each => {
        for (; each; each = each.parentElement) {
            const found = numbers(getComputedStyle(each).backgroundColor);
            if (found.length < 4 || found[3] > 0.5) return found.slice(0, 3);
        }
        return [255, 255, 255];
    };
    const own = each => [...each.childNodes].some(part => part.nodeType == 3 && part.textContent.trim());
    return [...document.querySelectorAll('body *')].filter(each => each.checkVisibility() && own(each))
        .map(each => [each.textContent.trim(), numbers(getComputedStyle(each).color).slice(0, 3), paper(each)]);
})()"""
"""All words of the page, their colours, and those of what they are on."""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_word_of_the_panels_is_too_faint_to_be_read(shown, scheme):
    _, tab = shown
    tab.value(f"document.documentElement.setAttribute('data-mantine-color-scheme', '{scheme}')")
    try:
        words = tab.value(SPELT)
        assert {"Plan", "key frames", "Scene"} <= {word for word, *_ in words}
        assert not [(word, ink, paper) for word, ink, paper in words if contrast(ink, paper) < 4.5]
    finally:
        tab.value("document.documentElement.setAttribute('data-mantine-color-scheme', 'light')")


def test_the_way_of_a_plan_is_seen_on_white_and_on_nearly_black():
    scenario = Scenario.of("walls")
    pictures = Pictures()
    found = pictures.found(pictures.view(quick_answer(scenario).plan))
    marks = [each for each in found.bodies if each.name.startswith("com ")]
    assert len(marks) > 4
    for each in (*marks, found.paths[0]):
        ink = 255.0 * np.array(to_rgb(each.colour))
        assert min(contrast(ink, [255.0] * 3), contrast(ink, [20.0] * 3)) > 3.0


def colour_of(tab, element, name):
    """A colour of an element as it is drawn, red, green and blue from 0 to 255."""
    return tab.value(
        f"getComputedStyle({element}).{name}.match(/[\\d.]+/g).slice(0, 3).map(Number)"
    )


def contrast(one, other):
    """Contrast of two colours in sRGB, 0 to 255, as WCAG has it: 1 to 21."""
    lights = []
    for colour in (one, other):
        parts = np.array(colour) / 255.0
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        lights.append(float(linear @ [0.2126, 0.7152, 0.0722]) + 0.05)
    return max(lights) / min(lights)


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
    with served(Scenario.of("walls"), folder=tmp_path_factory.mktemp("saved")) as shown:
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
        open_timeout=PATIENCE_S,
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


def called(monkeypatch, thing, name):
    """An event that is set once a method was called."""
    happened, method = threading.Event(), getattr(thing, name)

    def call(*arguments):
        method(*arguments)
        happened.set()

    monkeypatch.setattr(thing, name, call)
    return happened


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
def test_a_value_that_makes_no_sense_is_one_line_and_changes_nothing(
    page, name, caplog, capfd, monkeypatch
):
    before, heard = page.playground.session.number, called(monkeypatch, caplog.handler, "emit")
    with (
        caplog.at_level(logging.WARNING),
        warnings.catch_warnings(record=True) as warned,
        joined(page) as line,
    ):
        warnings.simplefilter("always")
        line.send(msgspec.msgpack.encode(WRONG[name](page)))
        assert heard.wait(PATIENCE_S)
        said = [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]
    assert len(said) == 1, said
    assert said[0].startswith(("ignored: a page sent ", "ended: a page sent what is no message: "))
    assert "\n" not in said[0]
    assert not [str(each.message) for each in warned]
    assert page.playground.session.number == before
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("raw", [b"\xc1\xff\xff", "words", b"", b"\x00" * 4096])
def test_rubbish_ends_its_own_connection_and_no_other(page, raw, capfd, monkeypatch):
    session = page.playground.session
    before, changed = session.number, called(monkeypatch, session, "change")
    with joined(page) as other:
        with joined(page) as line:
            line.send(raw)
        goal = page.playground.session.scenario.course().goal_m
        other.send(msgspec.msgpack.encode(drag(np.add(goal, [0.0, 0.0, 0.01]).tolist())))
        assert changed.wait(PATIENCE_S)
    assert session.number > before
    assert "Traceback" not in capfd.readouterr().err


def test_the_page_is_ours_and_whole(page):
    from gzip import decompress
    from urllib.request import Request, urlopen

    with urlopen(page.address) as answer:
        plain = answer.read()
    with urlopen(Request(page.address, headers={"Accept-Encoding": "gzip"})) as answer:
        assert decompress(answer.read()) == plain
    assert plain.count(b"<title>Stancekit playground</title>") == 1
    assert b"stancekit-verdict" in plain


def test_of_many_changes_during_one_answer_only_the_newest_is_answered(monkeypatch):
    begun, go_on, seen, last = threading.Event(), threading.Event(), [], threading.Event()

    def slow(scenario):
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return SceneAnswer(message=str(scenario))

    def on_answer(number, scenario, answer, since):
        seen.append((number, answer.message))
        if answer.message == "9":
            last.set()

    monkeypatch.setattr(session_module, "quick_answer", slow)
    pictures = Session(0, on_answer, judges=False)
    pictures.start()
    assert begun.wait(PATIENCE_S)
    for _ in range(9):
        pictures.change(lambda number: number + 1)
    go_on.set()
    assert last.wait(PATIENCE_S)
    pictures.close()
    assert seen == [(0, "0"), (9, "9")]


def test_a_slow_edit_keeps_what_others_changed_meanwhile():
    begun, go_on = threading.Event(), threading.Event()
    pictures = Session((), lambda *_: None, judges=False)

    def slow(scenario):
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return (*scenario, "slow")

    waits = threading.Thread(target=pictures.change, args=(slow,))
    waits.start()
    assert begun.wait(PATIENCE_S)
    pictures.change(lambda scenario: (*scenario, "quick"))
    go_on.set()
    waits.join(PATIENCE_S)
    assert pictures.scenario == ("quick", "slow")
    assert pictures.number == 2


def test_an_edit_that_is_refused_changes_nothing():
    pictures = Session(Scenario.of("walls"), lambda *_: None, judges=False)

    with refuses("robot"):
        pictures.change(lambda scenario: scenario.with_robot("horse"))
    assert pictures.number == 0
    pictures.close()


def test_a_scene_at_rest_is_judged_in_another_process_and_a_stale_verdict_is_dropped():
    answers, accepted, quick = [], threading.Event(), threading.Event()

    def on_answer(number, scenario, answer, since):
        answers.append((number, answer.patient))
        if number == 0:
            quick.set()
        if number == 1 and answer.accepted:
            accepted.set()

    pictures = Session(Scenario.of("walls", frames=2), on_answer, rest_s=0.0)
    pictures.start()
    assert quick.wait(PATIENCE_S)
    pictures.change(lambda scenario: scenario.slid("friction", 0.9))
    assert accepted.wait(PATIENCE_S)
    pictures.close()
    assert answers[0] == (0, False)
    assert answers[-1] == (1, True)
    assert answers.index((1, False)) < answers.index((1, True))
    assert (0, True) not in answers[answers.index((1, False)) :]


def test_tables_say_what_the_plan_has_with_units_and_names_are_text(monkeypatch):
    from stancekit.planners.motion.plan_motion import key_sample

    answer = patient_answer(Scenario.of("walls", frames=3))
    plan = answer.plan
    now = key_sample(path_of(plan), 2)
    view = PlanView(plan)
    rows = loads(view, now, solver_of(plan.robot), view.near_rad(now))
    assert [row.force_n for row in rows] == pytest.approx(np.linalg.norm(plan.forces_at(2), axis=1))
    _, cone, torque = view.strips  # of a still
    assert 0.0 < max(row.cone for row in rows) <= 0.01 * cone.values.max() + 1e-9 <= 0.8 + 1e-6
    for used in (cone, torque):
        assert f"{100 - used.values.max():.0f} % at least" in summary(answer, view)
    assert max(row.torque for row in rows) <= answer.report.group("torque").figures["share"] + 1e-6
    table = limb_table(rows, "<b>here</b>")
    assert "force [N]" in table
    assert "torque [Nm]" in table
    assert "&lt;b&gt;here" in table
    assert "<script" not in verdict(SceneAnswer(message="<script>alert(1)</script>"), 3, 12.0)


@pytest.mark.parametrize("name", ["", "..", "a/b", "/etc/x", ".hidden", "../x"])
def test_files_are_written_in_the_folder_and_nowhere_else(name, tmp_path):
    scenario = Scenario.of("walls")
    assert save_course(scenario, tmp_path, "played") == tmp_path / "played-course.yaml"
    with refuses("name"):
        save_course(scenario, tmp_path, name)
    with refuses("plan"):
        save_plan(SceneAnswer(), tmp_path, "played")
