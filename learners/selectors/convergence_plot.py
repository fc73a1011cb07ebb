"""The picture of evolutionary runs (Lin et al., Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from stancekit.planners.errors import InvalidInput
from stancekit.views.sheet import ACCENT, DEFAULT_STYLE, INK, LEG_COLOURS, RULE, sheet

from .convergence import Generation

Curves = tuple[Sequence[float], Sequence[float], Sequence[float]]
"""Mean, variance and best of the fitness by generation."""


def draw_convergence(histories: Mapping[str, Sequence[Generation]], title: str = "") -> Figure:
    """Mean fitness with a band of one standard deviation, and the best, by generation: Lin et al.,
    Fig. 4.
    """
    if not histories or not all(histories.values()):
        raise InvalidInput(
            "histories: expected one or more generations of one or more runs, got none"
        )
    curves: dict[str, Curves] = {
        name: (
            [done.mean for done in history],
            [done.variance for done in history],
            [done.best for done in history],
        )
        for name, history in histories.items()
    }
    return _drawn(curves, title)


def draw_learned(provenance: Mapping[str, Any], title: str = "") -> Figure:
    """``draw_convergence`` of the run that envelopes came from.

    Raises InvalidInput for envelopes of another method, and for those written before their
    provenance kept the variance.
    """
    notes = provenance.get("notes", {})
    curves = tuple(notes.get(name, ()) for name in ("mean", "variance", "best"))
    if not all(curves):
        raise InvalidInput(
            "provenance: expected mean, variance and best of the fitness per generation, as ga "
            f"writes them, got the notes {sorted(notes)}"
        )
    return _drawn({str(provenance.get("method", "ga")): curves}, title)


@DEFAULT_STYLE
def _drawn(curves: Mapping[str, Curves], title: str) -> Figure:
    figure = sheet((1200, 640), (1200, 640))
    axes = figure.add_axes((0.07, 0.11, 0.9, 0.78))
    colours = (LEG_COLOURS[0], ACCENT, *LEG_COLOURS[1:])
    for index, (name, (means, variances, best)) in enumerate(curves.items()):
        colour = colours[index % len(colours)]
        number, mean, half = np.arange(len(means)), np.array(means), np.sqrt(variances)
        axes.fill_between(number, mean - half, mean + half, color=colour, alpha=0.15, lw=0)
        axes.plot(number, mean, color=colour, lw=1.8, label=f"{name}: mean ± standard deviation")
        axes.plot(
            number,
            best,
            color=colour,
            lw=1.2,
            ls=(0, (4, 2)),
            label=f"{name}: best",
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color=RULE, lw=0.8)
    axes.set_axisbelow(True)
    axes.set_xlabel("generation", color=INK)
    axes.set_ylabel("fitness: 1 − a − ρ max(0, b − δ)", color=INK)
    axes.set_title(title or "Fitness of the population", color=INK, loc="left", size=13)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(frameon=False, loc="lower right")
    return figure
