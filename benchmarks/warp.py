"""Warp maps: the published methods beside ours, on the reference terrains (paper W §IV-B, Figs. 4 and 5).

    python benchmarks/warp.py [--terrains ripple cone hill pit] [--cells 24 24 6] [--picture NAME.png] [--json]

local-global is Algorithm W1 as printed, gauss-newton the paper's second method; both match softly and have no snap.
accelerated is Algorithm W1 with the nearest similarity, fast diagonalisation and Anderson acceleration; fast is what
the product uses. CPU seconds include the checks: min det J on lines three times as dense as the quadrature, the match
between the terrain's nodes, conformal errors. --picture writes one convergence chart a terrain, NAME-terrain.png.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, get_args

from stancekit.planners.terrain.reference import TERRAINS, reference_terrain
from stancekit.planners.warp.conformal import CELLS, Method, fit_map
from stancekit.planners.warp.report import MapReport
from stancekit.views.maps import draw_map_convergence
from stancekit.views.sheet import save


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--terrains", nargs="+", choices=TERRAINS.names(), default=["ripple", "cone", "hill", "pit"])
    parser.add_argument("--cells", nargs=3, type=int, default=CELLS)
    parser.add_argument("--methods", nargs="+", choices=get_args(Method), default=list(get_args(Method)))
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    for terrain in arguments.terrains:
        field = reference_terrain(terrain)
        fits = [
            fit_map(field, cells=tuple(arguments.cells), method=method, iterations=arguments.iterations)
            for method in arguments.methods
        ]
        for fit in fits:
            record = fit.report.to_json()
            print(json.dumps(record) if arguments.json else line(record), flush=True)
        if arguments.picture is not None:
            save(draw_map_convergence([fit.report for fit in fits]), named(arguments.picture, fits[0].report))


def line(record: dict[str, Any]) -> str:
    """One row of the table."""
    ground, torso = record["ground_error"], record["torso_error"]
    return (
        f"{record['terrain']:7} {record['method']:13} {record['cpu_s']:6.2f} CPU-s {record['iterations']:4d} it  "
        f"min det J {record['least_det']:7.3f}  match {record['match_max_mm']:8.3f} mm  conformal error, mean/p95: "
        f"ground {ground['mean']:.3f}/{ground['p95']:.3f}, .5 m above {torso['mean']:.3f}/{torso['p95']:.3f}"
    )


def named(picture: Path, report: MapReport) -> Path:
    """The file of one terrain's chart."""
    return picture.with_name(f"{picture.stem}-{report.terrain}{picture.suffix}")


if __name__ == "__main__":
    main()
