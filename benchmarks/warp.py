"""Warp maps: the published methods beside ours, on the reference terrains (Pan et al. §IV-B, Figs.
4 and 5).

    python benchmarks/warp.py [--terrains ripple cone hill pit] [--cells 24 24 6] [--json]

local-global is Algorithm W1 as printed, gauss-newton the paper's second method; both match softly
and have no snap; fast is what the product uses. CPU seconds include the checks: min det J on lines
three times as dense as the quadrature, the match between the terrain's nodes, conformal errors.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, get_args

from _bench import Options, Row, launch, markdown

from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.conformal import CELLS, Method, fit_map


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which maps."""

    terrains: tuple[str, ...] = ("ripple", "cone", "hill", "pit")
    cells: tuple[int, int, int] = CELLS
    methods: tuple[Method, ...] = get_args(Method)
    iterations: int = 100


def main(arguments: Arguments) -> None:
    """Measure and print."""
    for terrain in arguments.terrains:
        field = reference_terrain(terrain)
        fits = [
            fit_map(field, cells=arguments.cells, method=method, iterations=arguments.iterations)
            for method in arguments.methods
        ]
        for fit in fits:
            arguments.say(fit.report.to_json(), line)


def line(record: dict[str, Any]) -> str:
    """One row of the table."""
    ground, torso = record["ground_error"], record["torso_error"]
    return (
        f"{record['terrain']:7} {record['method']:13} {record['cpu_s']:6.2f} CPU-s {record['iterations']:4d} it  "
        f"min det J {record['least_det']:7.3f}  match {record['match_max_mm']:8.3f} mm  conformal error, mean/p95: "
        f"ground {ground['mean']:.3f}/{ground['p95']:.3f}, .5 m above {torso['mean']:.3f}/{torso['p95']:.3f}"
    )


NAMES = {
    "local-global": "local-global, as published",
    "gauss-newton": "Gauss-Newton",
    "fast": "ours",
}


def page(rows: list[Row]) -> Iterable[str]:
    """The table of docs/reproduction.md; maps that fold are bold."""
    head = ("terrain", "method", "CPU [s]", "iterations", "min det J", "match [mm]")
    return markdown(
        head,
        (
            (
                row["terrain"],
                NAMES[row["method"]],
                f"{row['cpu_s']:.1f}",
                row["iterations"],
                f"{row['least_det']:.3g}"
                if row["least_det"] > 0
                else f"**{row['least_det']:.3g}**",
                f"{row['match_max_mm']:.3g}",
            )
            for row in rows
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, page=page)
