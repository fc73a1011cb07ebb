"""The playground in headless Chromium: opened, dragged and read; what is saved the other commands
accept.
"""

from __future__ import annotations

import re
from contextlib import suppress

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from stancekit.planners.formats.plan_file import check_file
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.views.playground.keys_scenario import KeysScenario
from stancekit.views.playground.page_parts import quick_answer
from stancekit.views.playground.pictures import Pictures
from stancekit.views.playground.serving import served
from stancekit.views.scene import UP
from tests.emulators.chromium import CHROMIUM, opened
from tests.emulators.playground import middle_of, pixel_of
from tests.refusals import refuses

SIZE_PX = (1400, 900)
VERDICT = "document.querySelector('#verdict')"


def change_of(tab):
    """The number of the change whose answer is shown."""
    return int(tab.value(f"{VERDICT} ? {VERDICT}.dataset.change : -1"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the playground saves."""
    return tmp_path_factory.mktemp("playground")


@pytest.fixture(scope="module")
def opened_once(folder, tmp_path_factory):
    """A playground, and the tab that shows it."""
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with (
        served(KeysScenario.of("walls"), folder=folder) as page,
        opened(page.address, tmp_path_factory.mktemp("profile"), SIZE_PX, draws=False) as tab,
    ):
        tab.wait_for(f"{VERDICT} !== null")
        yield page, tab


@pytest.fixture
def shown(opened_once):
    """It over two walls, as they are at first."""
    page, tab = opened_once
    number = page.playground.session.change(lambda _: KeysScenario.of("walls"))
    tab.wait_for(f"{VERDICT}.dataset.change >= {number}")
    return page, tab


def test_it_is_opened_dragged_and_read(shown, folder):
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
    found = TwoStagePlanner().solve(scenario.course())
    assert found.solution is not None
    assert f"after {found.solution.problem.frames} key frames" in tab.text()

    for words in ("save plan", "save course"):
        tab.click(
            *middle_of(
                tab,
                f"[...document.querySelectorAll('button')].find(b => b.innerText === '{words}')",
            )
        )
        tab.wait_for(f"document.querySelector('#saved')?.innerText.includes('{words.split()[1]}.')")
    assert check_file(folder / "played-plan.json").accepted
    again = read_course(folder / "played-course.yaml")
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


def test_without_viser_the_extra_is_named(monkeypatch):
    from stancekit.views import page as page_module

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(page_module, "import_module", missing)
    with (
        suppress(StopIteration),
        refuses("viser", "[viz]"),
    ):
        served(KeysScenario.of("walls")).__enter__()


def test_a_surface_is_picked_by_a_click_and_the_courses_file_is_shown(shown):
    page, tab = shown
    tab.wait_for(f"{VERDICT}.dataset.patient === '1'")
    course = page.playground.session.scenario.course()
    button = "[...document.querySelectorAll('button')].find(b => b.innerText === '{}')"
    tab.click(*middle_of(tab, button.format("pick a surface")))
    tab.wait_for("document.body.innerText.includes('click a surface')")
    tab.click(*pixel_of(page, tab, course.com_nominal_m[2] + np.array([0.0, 0.38, 0.05])))
    tab.wait_for("document.body.innerText.includes('friction of the picked surface')")
    scenario = page.playground.session.scenario
    assert scenario.kind == "polygons"
    assert scenario.keys["terrain"]["polygons"][scenario.chosen]["vertices_m"][0][
        1
    ] == pytest.approx(0.38)
    tab.click(*middle_of(tab, button.format("show course")))
    said = tab.wait_for("document.querySelector('#course')?.innerText")
    assert said.startswith("name: walls\n")
    assert "kind: polygons" in said


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
    scenario = KeysScenario.of("walls")
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
