"""The objective of a course as rows (paper E §II)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .gather import Fill
from .layout import Index, Layout
from .rows import Rows
from .terms import BodyVariables, FreeToes, Given


def objective(rows: Rows[Given], layout: Layout, body: BodyVariables, toes: FreeToes | None) -> None:
    """Squared distance of the last COM to the goal and squared steps, in length scales squared (paper E §II); and of
    every COM to the nominal path, which no paper has: without it bodies sink as low as legs are long.

    toes: explicit; None where they are held, and their steps a constant.
    """

    _near(rows, body.com[-1], lambda d: d.scaled.aim.goal, lambda d: d.scaled.goal)
    _near(rows, body.com, lambda d: d.scaled.aim.com_path, lambda d: d.scaled.com)
    rows.square(body.rotation, None, lambda d: d.scaled.aim.tilt / d.scaled.length_m**2)
    if layout.frames > 1:
        rows.square(body.com[1:], body.com[:-1], lambda d: d.scaled.aim.com_step)
    if toes is not None and toes.points is not None and len(layout.moves):
        before, after = toes.points[layout.moves].swapaxes(0, 1)
        rows.square(after, before, lambda d: d.scaled.aim.toe_step)


def _near(rows: Rows[Given], columns: Index, weight: Callable[[Given], float], place: Fill[Given]) -> None:
    """weight · ‖x − place‖²."""
    rows.square(columns, None, weight)
    rows.linear(
        columns,
        lambda d: -2.0 * weight(d) * np.asarray(place(d)),
        lambda d: weight(d) * np.sum(np.square(place(d))),
    )
