"""Saving a playground's plan and course, in the formats that every other command reads."""

from __future__ import annotations

import html
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.plan_file import write_plan

from .answer import SceneAnswer
from .page_parts import BAD, GOOD, named_in, told
from .scenario import Scenario


class Files:
    """Names, buttons, and a line that says what was written.

    Arguments:
        now: the newest scene and the answer that is shown.
    """

    def __init__(
        self, server: Any, folder: Path, now: Callable[[], tuple[Scenario, SceneAnswer]]
    ) -> None:
        self._server, self._folder, self._now = server, folder, now
        gui = server.gui
        with gui.add_folder("Files"):
            self._name = gui.add_text(
                "name", "played", hint="Of the files, without a folder or an ending."
            )
            gui.add_button("save plan", hint=f"Into {folder.resolve()}.").on_click(self._save_plan)
            gui.add_button("save course", hint=f"Into {folder.resolve()}.").on_click(
                self._save_course
            )
            gui.add_button("show course", hint="The course's file, to copy.").on_click(
                self._show_course
            )
            self._said = gui.add_html("")

    def save_plan(self) -> Path:
        """Write the plan that is shown; where it is.

        Raises InvalidInput where there is none that was accepted.
        """
        _, answer = self._now()
        if answer.plan is None:
            raise InvalidInput("plan: expected one, got none to save")
        if answer.report is None:
            raise InvalidInput(
                "plan: expected one that was judged, got one whose joints and bodies are not yet"
            )
        if not answer.accepted:
            raise InvalidInput(f"plan: expected one that is accepted, got {answer.message}")
        path = named_in(self._folder, str(self._name.value), "-plan.json")
        write_plan(path, answer.plan, answer.report)
        return path

    def save_course(self) -> Path:
        """Write the course that is asked for; where it is.

        Raises InvalidInput.
        """
        scenario, _ = self._now()
        suffix, text = scenario.text()
        path = named_in(self._folder, str(self._name.value), f"-course{suffix}")
        write_text(path, text)
        return path

    def _save_plan(self, _event: Any) -> None:
        self._tell(self.save_plan, "stancekit verify")

    def _save_course(self, _event: Any) -> None:
        self._tell(self.save_course, "stancekit plan")

    def _tell(self, save: Callable[[], Path], command: str) -> None:
        try:
            path = save()
            colour, words = GOOD, f"wrote {path}; {command} {path} reads it"
        except StancekitError as error:
            colour, words = BAD, str(error)
        self._said.content = told(colour, words)

    def _show_course(self, event: Any) -> None:
        scenario, _ = self._now()
        try:
            suffix, text = scenario.text()
        except StancekitError as error:
            suffix, text = "", str(error)
        modal = event.client.gui.add_modal(f"{self._name.value}-course{suffix}")
        with modal:
            event.client.gui.add_html(
                f'<pre id="course" style="font:12px/1.45 ui-monospace,monospace;white-space:pre-wrap;'
                f'max-height:60vh;overflow:auto;user-select:text">{html.escape(text)}</pre>'
            )
            event.client.gui.add_button("close").on_click(lambda _: modal.close())
        event.client.send_file_download(
            f"{self._name.value}-course{suffix or '.txt'}", text.encode()
        )
