"""The picture of an evolutionary run (Lin et al., Fig. 4), from the envelopes that it wrote.

stancekit fit DATA --method ga --out ga.json
python benchmarks/fitness.py ga.json --picture fitness.png
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from _bench import Options, launch
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.question_file import read_envelopes
from stancekit.views.sheet import DEFAULT_STYLE, INK, LEG_COLOURS, headline, quiet_axes, save, sheet


@dataclass(frozen=True, kw_only=True)
class Fitness(Options):
    """Envelopes and their picture."""

    envelopes: tyro.conf.Positional[Path]
    picture: Path


@DEFAULT_STYLE
def draw_learned(provenance: Mapping[str, Any], title: str) -> Figure:
    """Mean fitness with a band of one standard deviation, and the best, by generation, of the run
    that envelopes came from: Lin et al., Fig. 4.

    Raises InvalidInput for envelopes of another method.
    """
    notes = provenance.get("notes", {})
    curves = tuple(notes.get(name, ()) for name in ("mean", "variance", "best"))
    if not all(curves):
        raise InvalidInput(
            "provenance: expected mean, variance and best of the fitness per generation, as ga "
            f"writes them, got the notes {sorted(notes)}"
        )
    means, variances, best = map(np.array, curves)
    name, number, half = str(provenance.get("method", "ga")), np.arange(len(means)), variances**0.5
    figure, colour = sheet((1200, 640), (1200, 640)), LEG_COLOURS[0]
    axes = figure.add_axes((0.07, 0.11, 0.9, 0.78))
    most = np.minimum(means + half, best)  # nobody is fitter than the best
    axes.fill_between(number, means - half, most, color=colour, alpha=0.15, lw=0)
    axes.plot(number, means, color=colour, lw=1.8, label=f"{name}: mean ± standard deviation")
    axes.plot(number, best, color=colour, lw=1.2, ls=(0, (4, 2)), label=f"{name}: best")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("generation", color=INK)
    axes.set_ylabel("fitness: 1 − a − ρ max(0, b − δ)", color=INK)
    axes.set_ylim(float(min(means.min(), 0.0)), 1.05)
    headline(figure, title, "lower ends of the band beyond the axis are cut off")
    quiet_axes(axes)
    axes.legend(frameon=False, loc="lower right")
    return figure


def main(asked: Fitness) -> None:
    """Draw and write."""
    learned = read_envelopes(asked.envelopes)
    title = f"{learned.problem_class}: fitness of the population"
    save(draw_learned(learned.provenance, title), asked.picture)


if __name__ == "__main__":
    launch(main, Fitness, __doc__)
