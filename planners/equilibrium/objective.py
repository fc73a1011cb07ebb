"""The objective of a course as rows (paper E §II)."""

from __future__ import annotations

import numpy as np

from .layout import Layout
from .rows import Rows
from .terms import Body, FreeToes, Given


def objective(rows: Rows[Given], layout: Layout, body: Body, toes: FreeToes | None) -> None:
    """Squared distance of the last COM to the goal and squared steps, in length scales squared (paper E §II).

    toes: explicit; None where they are held, and their steps a constant.
    """

    rows.square(body.com[-1], None, lambda d: d.scaled.aim.goal)
    rows.linear(
        body.com[-1],
        lambda d: -2.0 * d.scaled.aim.goal * d.scaled.goal,
        lambda d: d.scaled.aim.goal * np.sum(d.scaled.goal**2),
    )
    rows.square(body.rotation, None, lambda d: d.scaled.aim.tilt / d.scaled.length_m**2)
    if layout.frames > 1:
        rows.square(body.com[1:], body.com[:-1], lambda d: d.scaled.aim.com_step)
    if toes is not None and toes.points is not None and len(layout.moves):
        before, after = toes.points[layout.moves].swapaxes(0, 1)
        rows.square(after, before, lambda d: d.scaled.aim.toe_step)
