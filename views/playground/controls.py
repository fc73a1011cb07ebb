"""Sliders, menus and grips of a playground, as a viser server shows them; what they change they
tell, and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stancekit.planners.files.arrays import Array

from .scenario import Grip, Slider

GRIP_M = 0.16
"""Length of the arrows of a grip."""
FAR_M = 1e3


class Controls:
    """Controls with which a page changes a scene. on_slid(key, value), on_dragged(key, position_m):
    called in order.
    """

    def __init__(
        self,
        server: Any,
        on_slid: Callable[[str, float], None],
        on_dragged: Callable[[str, Array], None],
    ) -> None:
        self._server, self._on_slid, self._on_dragged = server, on_slid, on_dragged
        self._sliders = dict[str, Any]()
        self._grips = dict[str, Any]()
        self._labels = dict[str, Any]()
        self._held = set[str]()
        self._folder = server.gui.add_folder("Scene")

    def update(self, sliders: Sequence[Slider], grips: Sequence[Grip]) -> None:
        """Show what may be changed now; what somebody holds stays where they hold it."""
        for key in set(self._sliders) - {slider.key for slider in sliders}:
            self._sliders.pop(key).remove()
        for slider in sliders:
            self._slide(slider)
        for key in set(self._grips) - {grip.key for grip in grips}:
            self._grips.pop(key).remove()  # with the label, which is its child
            self._labels.pop(key)
        for grip in grips:
            self._grip(grip)

    def let_go(self) -> None:
        """Nobody holds anything any more: a tab was closed."""
        self._held.clear()

    def _slide(self, slider: Slider) -> None:
        known = self._sliders.get(slider.key)
        kind: Any = int if slider.whole else float
        low, high = kind(min(slider.low, slider.value)), kind(max(slider.high, slider.value))
        if known is None:
            with self._folder:
                known = self._server.gui.add_slider(
                    slider.title,
                    min=low,
                    max=high,
                    step=kind(slider.step),
                    initial_value=kind(slider.value),
                    hint=slider.hint or None,
                )

            async def slid(event: Any, key: str = slider.key) -> None:
                if event.client is not None:  # else it was set here
                    self._on_slid(key, float(event.target.value))

            known.on_update(slid)
            self._sliders[slider.key] = known
        elif abs(known.value - slider.value) > 1e-9:
            known.max, known.min = max(known.max, high), min(known.min, low)
            known.value = kind(slider.value)

    def _grip(self, grip: Grip) -> None:
        known = self._grips.get(grip.key)
        if known is None:
            name = f"/grips/{grip.key}"
            known = self._server.scene.add_transform_controls(
                name,
                scale=GRIP_M,
                active_axes=grip.axes,
                disable_rotations=True,
                disable_sliders=sum(grip.axes) < 2,
                depth_test=False,
                line_width=3.0,
                position=tuple(grip.position_m.tolist()),
            )
            self._labels[grip.key] = self._server.scene.add_label(
                f"{name}/label", grip.label, anchor="top-center", position=(0.0, 0.0, -0.03)
            )

            async def dragged(event: Any, key: str = grip.key) -> None:
                if event.phase == "start":
                    self._held.add(key)
                elif event.phase == "end":
                    self._held.discard(key)
                place = np.array(event.target.position, dtype=np.float64)
                if np.all(np.isfinite(place)) and event.phase != "start":
                    self._on_dragged(key, np.clip(place, -FAR_M, FAR_M))

            known.on_update(dragged)
            self._grips[grip.key] = known
        elif grip.key not in self._held:
            place = tuple(round(float(value), 6) for value in grip.position_m)
            if float(np.abs(np.array(known.position) - place).max()) > 1e-6:
                known.position = place
        if self._labels[grip.key].text != grip.label:
            self._labels[grip.key].text = grip.label
