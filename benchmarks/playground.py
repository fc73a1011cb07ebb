"""From a drag to a drawn plan: how long the playground takes, in a headless Chromium that drags its
sliders and grips.

For each course changes are made one after the other, each when the answer to the one before is
seen: the goal by its arrow, and the friction by its slider, in turn. The time is that from the
mouse event to the verdict and the limbs' table in the document; "painted": to the second frame
after, which without a GPU is the browser's own drawing of every pixel. `--no-browser`: from the
change to the last message that is sent. Beside it CPU time of the process that plans and draws, by
part; and, as a yardstick, how long the same answer takes without a page, asked for after each
change.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, Row, launch, markdown

from stancekit.views.playground.answers import quick_answer
from stancekit.views.playground.playground import Playground
from stancekit.views.playground.scenario import Scenario
from stancekit.views.playground.serving import served
from stancekit.views.scene import UP

TURN = 2.0 * np.pi / 40.0
WATCH = """
window.answers = {};
new MutationObserver(() => {
  const verdict = document.querySelector('#verdict');
  if (!verdict) return;
  const change = verdict.dataset.change;
  if (window.answers[change] === undefined) {
    window.answers[change] = [Date.now(), 0];
    requestAnimationFrame(() => requestAnimationFrame(() => { window.answers[change][1] = Date.now(); }));
  }
}).observe(document.body, {childList: true, subtree: true, characterData: true, attributes: true});
"""


@dataclass(frozen=True, kw_only=True)
class Playing(Options):
    """Options of the table."""

    courses: Annotated[tuple[str, ...], tyro.conf.arg(metavar="COURSE ...")] = (
        "walls",
        "icy-walls",
        "stairs",
        "tube",
    )
    changes: int = 200
    robot: str = ""
    browser: bool = True
    draws: bool = True
    """Whether the browser draws the scene; without a GPU that may take all of a processor."""
    painted: bool = False
    """Wait for the picture, too."""
    size_px: tuple[int, int] = (1400, 800)
    """Of the browser's window; without a GPU the browser draws every pixel itself."""
    picture: Path | None = None
    """Changes nothing and times nothing: a picture of the first course as it is opened, that of
    docs/benchmarks.md."""


def main(options: Playing) -> None:
    """Print a row a course, or draw the first; without a browser on this machine that of the
    server's side.
    """
    from tests.emulators.chromium import CHROMIUM

    for course in options.courses:
        scenario = Scenario.of(course, options.robot or None)
        if options.picture is not None:
            with (
                tempfile.TemporaryDirectory() as folder,
                served(scenario, folder=Path(folder)) as page,
            ):
                _drawn(page, options.picture, options.size_px, Path(folder))
            return
        with tempfile.TemporaryDirectory() as folder, served(scenario, folder=Path(folder)) as page:
            row = (
                _changed(page, options, Path(folder))
                if options.browser and CHROMIUM
                else _served(page, options)
            )
        options.say(
            {"course": course, **row}, lambda row: "  ".join(f"{k} {v}" for k, v in row.items())
        )


def _drawn(page: Any, picture: Path, size_px: tuple[int, int], folder: Path) -> None:
    """The page as the browser draws it once the plan is judged, without what viser says of a
    browser without a GPU.
    """
    from tests.emulators.chromium import opened

    with opened(page.address, folder / "profile", size_px) as tab:
        tab.wait_for("document.querySelector('#verdict')?.textContent.includes('judged')")
        time.sleep(3.0)  # its note comes late
        tab.value(
            "document.querySelectorAll('.mantine-Notification-closeButton').forEach(each => each.click())"
        )
        time.sleep(25.0)  # a scene comes in slowly where every pixel is drawn by the processor
        tab.picture(picture)


class _Clock:
    """When the answer to a change was drawn on the server's side, and what that cost.

    alone: what the same answer took without a page [s].
    """

    def __init__(self, playground: Playground) -> None:
        self.drawn = threading.Event()
        self.rows: list[dict[str, float]] = []
        self.alone: list[float] = []
        before = playground.session._on_answer

        def on_answer(number: int, scenario: Any, answer: Any, since: float) -> None:
            begin = time.process_time()
            before(number, scenario, answer, since)
            if not answer.patient:
                self.rows.append(
                    {
                        "s": time.perf_counter() - since,
                        "layout": answer.seconds[0],
                        "search": answer.seconds[1],
                        "drawing": time.process_time() - begin,
                    }
                )
                self.drawn.set()

        playground.session._on_answer = on_answer

    def answer_alone(self, playground: Playground) -> None:
        """The yardstick, at the scene as it is now."""
        begin = time.perf_counter()
        quick_answer(playground.session.scenario)
        self.alone.append(time.perf_counter() - begin)


def _edits(playground: Playground, count: int) -> list[tuple[str, Any]]:
    """The changes: key and value, sliders and grips in turn."""
    scenario = playground.session.scenario
    goal = scenario.course().goal_m
    found: list[tuple[str, Any]] = []
    for k in range(count):
        if k % 2:
            found.append(("friction", round(0.75 + 0.35 * np.sin(k * TURN), 2)))
        else:
            found.append(
                (
                    "goal",
                    goal
                    + 0.04 * np.array([np.cos(k * TURN), 0.3 * np.sin(k * TURN), np.sin(k * TURN)]),
                )
            )
    return found


def _served(page: Any, options: Playing) -> dict[str, Any]:
    """Changes made on the server's side."""
    playground = page.playground
    clock = _Clock(playground)
    cpu = time.process_time()
    for key, value in _edits(playground, options.changes):
        clock.drawn.clear()
        if key == "friction":
            playground.session.change(
                lambda scenario, value=value: scenario.slid("friction", value)
            )
        else:
            playground.session.change(lambda scenario, value=value: scenario.dragged("goal", value))
        assert clock.drawn.wait(30.0)
        begin = time.process_time()
        clock.answer_alone(playground)
        cpu += time.process_time() - begin
    cpu = time.process_time() - cpu
    return _figures([row["s"] for row in clock.rows], clock, cpu / options.changes)


def _changed(page: Any, options: Playing, folder: Path) -> dict[str, Any]:
    """Changes made with the mouse: the friction's slider, and the goal by its arrow."""
    from tests.emulators.chromium import opened
    from tests.emulators.playground import middle_of, pixel_of

    playground, times = page.playground, list[Any]()
    with opened(
        page.address, folder / "profile", options.size_px, draws=options.draws, seldom=False
    ) as tab:
        tab.wait_for("document.querySelector('#verdict') !== null")
        time.sleep(3.0)
        tab.value(WATCH)
        clock, cpu = _Clock(playground), time.process_time()
        first = playground.session.scenario.course().goal_m
        x, y = middle_of(tab, "document.querySelector('[role=slider]')")
        for k in range(2 * options.changes):
            if len(times) == options.changes:
                break  # a drag of less than a step changes nothing, and does not count
            before = playground.session.number
            if k % 2:
                place = (x + 30.0 * np.sin(k * TURN) - 20.0, y)
                tab.mouse("mouseMoved", *middle_of(tab, "document.querySelector('[role=slider]')"))
                tab.mouse(
                    "mousePressed", *middle_of(tab, "document.querySelector('[role=slider]')")
                )
            else:
                goal = playground.session.scenario.course().goal_m
                start = pixel_of(page, tab, goal + 0.10 * UP)
                up = (0.02 if k % 4 else -0.02) + 0.01 * np.sin(k * TURN)
                place = pixel_of(page, tab, first + (0.10 + up) * UP)
                tab.mouse("mouseMoved", *start)
                tab.mouse("mousePressed", *start)
            began = time.time()
            tab.mouse("mouseMoved", *place, pressed=True)
            until = time.monotonic() + 5.0
            while playground.session.number == before and time.monotonic() < until:
                time.sleep(0.005)
            number = playground.session.number
            if number > before:
                answers = f"(Object.entries(window.answers).find(([k, _]) => k > {before}) || [0, [0, 0]])[1]"
                tab.wait_for(
                    f"{answers}[0]"
                )  # of this change, or of one after it that took its place
                if options.painted:
                    with suppress(
                        AssertionError
                    ):  # a browser that draws no frame for so long has no time
                        tab.wait_for(f"{answers}[1]", 20.0)
                times.append(1e-3 * np.array(tab.value(answers), dtype=np.float64) - began)
            tab.mouse("mouseReleased", *place)
            begin = time.process_time()
            clock.answer_alone(playground)
            cpu += time.process_time() - begin
            time.sleep(0.05)
        cpu = time.process_time() - cpu
    read, painted = np.array(times).T
    painted = painted[painted > 0.0]
    row = {"drags": len(times), **_figures(read, clock, cpu / len(times))}
    return (
        {**row, "painted": len(painted), "painted_median_ms": _ms(np.median(painted))}
        if options.painted
        else row
    )


def _figures(times: Any, clock: _Clock, cpu_s: float) -> dict[str, Any]:
    """Median and worst in ms, and CPU time by part, the median of each, and the worst of their
    sum.
    """
    rows = clock.rows
    names = ("layout", "search", "drawing")
    parts = {f"{name}_cpu_ms": _ms(np.median([row[name] for row in rows])) for name in names}
    return {
        "median_ms": _ms(np.median(times)),
        "p95_ms": _ms(np.quantile(times, 0.95)),
        "worst_ms": _ms(np.max(times)),
        "alone_median_ms": _ms(np.median(clock.alone)),
        **parts,
        "worst_cpu_ms": _ms(max(sum(row[name] for name in names) for row in rows)),
        "process_cpu_ms": _ms(cpu_s),
        "load": round(os.getloadavg()[0], 1),
    }


def _ms(seconds: Any) -> float:
    return round(1e3 * float(seconds), 1)


def page(rows: list[Row]) -> Iterable[str]:
    """CPU ms by part (docs/benchmarks.md)."""
    names = ("layout", "search", "drawing", "process")
    return markdown(
        ("course", "layout", "search", "drawing", "all of the process"),
        ((row["course"], *(f"{row[f'{name}_cpu_ms']:.0f}" for name in names)) for row in rows),
    )


if __name__ == "__main__":
    launch(main, Playing, __doc__, page=page)
