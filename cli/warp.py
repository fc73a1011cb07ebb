"""``stancekit warp``: the map that flattens a terrain."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import as_options, facts, tell
from .options import OF_FILE, OptionalPath, TerrainFile, check_drawn, check_out, numbers

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.planners.warp.report import MapReport


@dataclass
class Warp:
    """Make the map that flattens a terrain, and measure it.

    TERRAIN is a ground by its name, as `stancekit terrain` has them (ripple, rough:0.5:7, …); a
    function of x and y as FILE.py:NAME; or a file: .npy, .csv, .png, .npz, or a mesh (.stl, .obj,
    .ply, .off, .glb).

    least_det is min det J on lines three times as dense as the quadrature: above 0 the map folds
    nowhere. match: how far the map's ground is from the terrain. Conformal error: 1 − σ_min/σ_max
    of J.

    Exit code: 0 done; 1 the map of a published method folds, or no map can be made; 2 bad input.
    """

    terrain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TERRAIN")]
    """Name, FAMILY:LEVEL:SEED, FILE.py:NAME, or a file."""
    cells: Annotated[str, tyro.conf.arg(metavar="X,Y,Z")] = "24,24,6"
    """Cells of the tri-cubic grid along each axis."""
    height_m: float = 2.3
    """Thickness of the band above the terrain [m]."""
    method: Literal["fast", "local-global", "accelerated", "gauss-newton"] = "fast"
    """fast: ours, exact at the ground. local-global: Algorithm 1 of the paper; gauss-newton: its
    second method, with a barrier; both as published, with no snap. accelerated: Algorithm 1 with
    the nearest similarity, no factorisation and Anderson acceleration, with no snap."""
    iterations: int = 100
    """Most iterations of the method."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File for the map, .npz."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the map: .png, .pdf or .svg."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Read the terrain, make the map, write and say what came of it."""
        from stancekit import warp

        cells = numbers(self.cells, "--cells", int, 3)
        check_out(self.out, ".npz")
        check_drawn(self.picture)
        terrain = self.file.read(self.terrain)
        with as_options():
            fit = warp(
                terrain,
                cells=(cells[0], cells[1], cells[2]),
                height_m=self.height_m,
                method=self.method,
                iterations=self.iterations,
            )
        if self.out is not None:
            fit.map.to_file(self.out)
        if self.picture is not None:
            from stancekit.views.maps import draw_map
            from stancekit.views.sheet import save

            save(draw_map(fit.map, terrain, fit.report), self.picture)
        tell(self.json, fit.report.to_json(), _table(fit.report))
        return 0 if fit.report.least_det > 0.0 else 1


def _table(report: MapReport) -> Table:
    record = report.to_json()
    folded = "" if report.least_det > 0.0 else " [red]the map folds[/]"
    where = ", ".join(f"{value:.2f}" for value in report.least_det_at_m)
    percent = "{mean:.1%} on average, {p95:.1%} at the 95th percentile, {max:.1%} at most"
    rows = (
        ("terrain", report.terrain),
        ("method", f"{report.method}, {' × '.join(map(str, report.cells))} cells"),
        (
            "time",
            f"{report.cpu_s:.2f} CPU-s, {len(report.energy) - 1} iterations, {report.evaluations} "
            "evaluations",
        ),
        ("min det J", f"{report.least_det:.3f} at ({where}) m{folded}"),
        (
            "match",
            f"{1e3 * report.match_m[0]:.3f} mm at most, {1e3 * report.match_m[1]:.3f} mm rms",
        ),
        (
            "before the snap",
            f"{1e3 * report.unsnapped_m[0]:.1f} mm at most, {1e3 * report.unsnapped_m[1]:.1f} mm "
            "rms",
        ),
        ("conformal error", percent.format(**record["ground_error"])),
        ("  0.5 m above", percent.format(**record["torso_error"])),
        ("note", report.message),
    )
    return facts(rows, "ellipsis")
