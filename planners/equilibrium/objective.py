"""The objective of a course as rows (Lin et al. §II)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..files.arrays import Array
from .gather import Fill
from .layout import Index, Layout
from .rows import Rows
from .terms import BodyVariables, FreeToes, Given


def objective(
    rows: Rows[Given], layout: Layout, body: BodyVariables, toes: FreeToes | None
) -> None:
    """Squared distance of the last COM to the goal and squared steps, in length scales squared (Lin
    et al. §II); and of every COM to the nominal path, which no paper has: without it bodies sink as
    low as legs are long.

    Arguments:
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
    if layout.stands:
        _as_it_stands(rows, layout, body, None if toes is None else toes.points)


def _as_it_stands(
    rows: Rows[Given], layout: Layout, body: BodyVariables, points: Index | None
) -> None:
    """weight · Σ ‖p − c − n‖² over every limb that stands.

    Arguments:
        points: columns of the toes, None where they are held.
    """
    frame, _, foothold = layout.standing

    def by(index: Index, count: int, values: Array) -> Array:
        total = np.zeros((count, *values.shape[1:]))
        np.add.at(total, index, values)
        return total

    if points is None:
        each = np.repeat(np.bincount(frame, minlength=layout.frames), 3)

        def away(d: Given) -> Array:
            return np.asarray(d.held.toes[foothold] - d.scaled.standing)

        rows.square(body.com, None, lambda d: np.asarray(d.scaled.aim.stance * each))
        rows.linear(
            body.com,
            lambda d: -2.0 * d.scaled.aim.stance * by(frame, layout.frames, away(d)),
            lambda d: d.scaled.aim.stance * np.sum(away(d) ** 2),
        )
        return
    rows.square(points[foothold], body.com[frame], lambda d: d.scaled.aim.stance)
    rows.linear(
        points,
        lambda d: -2.0 * d.scaled.aim.stance * by(foothold, layout.footholds, d.scaled.standing),
        lambda d: d.scaled.aim.stance * np.sum(d.scaled.standing**2),
    )
    rows.linear(
        body.com, lambda d: 2.0 * d.scaled.aim.stance * by(frame, layout.frames, d.scaled.standing)
    )


def _near(
    rows: Rows[Given], columns: Index, weight: Callable[[Given], float], place: Fill[Given]
) -> None:
    """weight · ‖x − place‖²."""
    rows.square(columns, None, weight)
    rows.linear(
        columns,
        lambda d: -2.0 * weight(d) * np.asarray(place(d)),
        lambda d: weight(d) * np.sum(np.square(place(d))),
    )
