"""Conformal error of maps (Pan et al. Fig. 4): every terrain, at the ground and at torso height; the
heights of terrain at which the paper's 7.8 % comes out; and what a thinner band would leave.

    python benchmarks/conformal.py [--terrains ripple cone hill pit] [--methods fast gauss-newton]
    [--target 0.078] [--bands 0.3 0.6 1.15 2.3] [--picture FILE.png] [--json]

The error of a point is 1 − σ_min / σ_max of J, and, as the paper's words can be read, too,
σ_max / σ_min − 1. "ground" and "torso": at z̄ = 0 and 0.5 m above, on 81 × 81 points. "scale" is what
all heights of the terrain are multiplied with; at the one printed the mean error at the ground, or
at torso height, is the target, by bisection. "band": the thickness of the band that is mapped [m],
in cells of the same size; a surface alone has a conformal chart (isothermal coordinates), so that
what is left at the ground is the price of the band above it, and of the grid. --picture draws the
histograms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, Row, launch, markdown

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.conformal import CELLS, HEIGHT_M, MapFit, Method, fit_map
from stancekit.planners.warp.report import spread

HALVINGS = 7
"""Of the bisection: the scale is known to one part in 128."""
THINNEST = 4
"""Cells across a band; with fewer the quadrature does not tell all splines apart."""
BINS = np.linspace(0.0, 0.6, 25)
"""Of the histograms: 2.5 % each."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which maps."""

    terrains: tuple[str, ...] = ("ripple", "cone", "hill", "pit")
    methods: tuple[Method, ...] = ("fast", "gauss-newton", "local-global")
    target: float = 0.078
    bands: tuple[float, ...] = (0.3, 0.6, 1.15, 2.3)
    bisect: tuple[Method, ...] = ("fast",)
    """Methods whose scale is looked for; each costs some ten maps a terrain and height."""
    picture: Path | None = None


def main(arguments: Arguments) -> None:
    """Measure and print."""
    pictured: dict[str, dict[str, Array]] = {}
    for name in arguments.terrains:
        field = reference_terrain(name)
        for method in arguments.methods:
            fit = fit_map(field, method=method)
            arguments.say({"terrain": name, "method": method, **errors(fit)}, line)
            if method == arguments.methods[0]:
                pictured[name] = {
                    "ground": fit.report.ground_error,
                    "torso": fit.report.torso_error,
                }
        for method in arguments.bisect:
            for where in ("ground", "torso"):
                scale = scale_for(field, method, where, arguments.target)
                arguments.say(
                    {
                        "terrain": name,
                        "method": method,
                        "at": where,
                        "target": arguments.target,
                        "scale": scale,
                        "relief_m": None if scale is None else scale * relief(field),
                    },
                    scale_line,
                )
        for band in arguments.bands:
            arguments.say({"terrain": name, "band_m": band, **of_band(field, band)}, line)
    if arguments.picture is not None:
        draw(pictured, arguments.picture)


def errors(fit: MapFit) -> dict[str, Any]:
    """Figures of a map's errors at both heights, and whether it folds."""
    found: dict[str, Any] = {"least_det": fit.report.least_det}
    for name, values in (("ground", fit.report.ground_error), ("torso", fit.report.torso_error)):
        found[name] = {
            **spread(values),
            "mean_other_reading": float(np.mean(values / np.maximum(1.0 - values, 1e-9))),
            "histogram": np.histogram(values, BINS)[0].tolist(),
        }
    return found


def of_band(field: HeightField, band_m: float) -> dict[str, Any]:
    """Errors of a map of a band of this thickness, in cells of about the same size."""
    cells = (CELLS[0], CELLS[1], max(THINNEST, round(CELLS[2] * band_m / HEIGHT_M)))
    try:
        return {"method": "gauss-newton"} | errors(
            fit_map(field, method="gauss-newton", cells=cells, height_m=band_m)
        )
    except PlanningFailed as error:
        return {"method": "gauss-newton", "refused": str(error)}


def scaled(field: HeightField, scale: float) -> HeightField:
    """The terrain with its heights multiplied."""
    return HeightField(field.x_m, field.y_m, scale * field.heights_m, field.name)


def relief(field: HeightField) -> float:
    """Highest less lowest [m]."""
    return float(np.ptp(field.heights_m))


def scale_for(field: HeightField, method: Method, where: str, target: float) -> float | None:
    """The scale of heights at which the mean error is the target, None where it is below at 1.5."""

    def mean(scale: float) -> float:
        report = fit_map(scaled(field, scale), method=method).report
        return float((report.ground_error if where == "ground" else report.torso_error).mean())

    return bisected(mean, target, 1.5)


def bisected(rises: Callable[[float], float], target: float, most: float) -> float | None:
    """Where a rising function crosses the target in (0, most]; None where it does not."""
    low, high = 0.0, most
    if rises(most) < target:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rises(middle) < target else (low, middle)
    return 0.5 * (low + high)


def line(row: dict[str, Any]) -> str:
    """One map."""
    head = f"{row['terrain']:7} {row['method']:13}"
    head += f" band {row['band_m']:.2f} m" if "band_m" in row else ""
    if "refused" in row:
        return f"{head}  {row['refused']}"
    return head + "".join(
        f"  {name}: mean {100 * row[name]['mean']:4.1f} % ({100 * row[name]['mean_other_reading']:.1f}), "
        f"median {100 * row[name]['median']:4.1f}, p95 {100 * row[name]['p95']:4.1f}, "
        f"below 5 %: {100 * row[name]['below_5_percent']:4.1f} %"
        for name in ("ground", "torso")
    )


def scale_line(row: dict[str, Any]) -> str:
    """One scale."""
    head = f"{row['terrain']:7} {row['method']:13}  {100 * row['target']:.1f} % at the {row['at']}"
    if row["scale"] is None:
        return f"{head}: below it at 1.5 times the heights"
    return f"{head}: at {row['scale']:.2f} of the heights, relief {row['relief_m']:.2f} m"


def draw(pictured: dict[str, dict[str, Array]], path: Path) -> None:
    """Histograms, a panel per terrain."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 3.2 * ((len(pictured) + 1) // 2)), layout="constrained")
    panels = np.ravel(figure.subplots((len(pictured) + 1) // 2, 2, squeeze=False))
    for axes, (name, by_height) in zip(panels, pictured.items(), strict=False):
        for where, values in by_height.items():
            label = f"{where}: mean {100 * float(values.mean()):.1f} %"
            axes.hist(100 * values.ravel(), 100 * BINS, alpha=0.6, label=label)
        axes.axvline(7.8, color="black", lw=1.0, ls="--", label="Pan et al.'s mean, 7.8 %")
        axes.set_title(f"{name}: relative difference of singular values", loc="left")
        axes.set_xlabel("1 − σ_min / σ_max [%]")
        axes.set_ylabel("points of 6561")
        axes.legend(frameon=False)
    figure.savefig(path, dpi=100)


def maps(rows: list[Row]) -> Iterable[str]:
    """Errors of every map, % (docs/reproduction.md)."""
    head = ("map", "ground: mean", "median", "95 %", "points below 5 %")
    figures = {"ground": ("mean", "median", "p95", "below_5_percent")}
    figures["torso"] = ("mean", "below_5_percent")
    return markdown(
        (*head, "torso, 0.5 m above: mean", "points below 5 %"),
        (
            (
                f"{row['terrain']}, {row['method']}",
                *(f"{100 * row[at][name]:.1f}" for at in figures for name in figures[at]),
            )
            for row in rows
            if "ground" in row and "band_m" not in row
        ),
    )


def scales(rows: list[Row]) -> Iterable[str]:
    """Factors of the heights at which the mean is the target (docs/reproduction.md)."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if "scale" in row:
            known = row["scale"] is not None
            cells = (
                (f"{row['scale']:.2f}", f"{row['relief_m']:.2f}") if known else ("above 1.5", "")
            )
            found.setdefault(row["terrain"], []).extend(cells)
    head = ("terrain", "at the ground: factor", "relief [m]", "at torso height: factor")
    return markdown((*head, "relief [m]"), ((name, *cells) for name, cells in found.items()))


if __name__ == "__main__":
    launch(main, Arguments, __doc__, maps=maps, scales=scales)
