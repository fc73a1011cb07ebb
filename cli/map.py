"""``stancekit map``: where on a terrain a robot can stand."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from .console import as_options, emit, facts, out, progress, say_written
from .options import (
    OF_FILE,
    FileMeaning,
    FootholdOptions,
    OptionalPath,
    OptionalText,
    check_drawn,
    check_limit,
    check_out,
    in_options,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import StandingMap


@dataclass
class MapTerrain:
    """Map where a robot can stand on a terrain.

    Per place and heading: feasible or not, how far the body may move and which push it bears, and
    which limit is in the way. A pose stands
    for one question: can the robot hold still with all of its limbs where its toes are as it
    stands, each put on the nearest place to stand, within a stated distance? Poses are proved from
    coarse to fine until the time is over: feasible with a posture that the verifier accepted,
    infeasible with a proof. What was not reached is unknown; with --fit it is called likely, at an
    error that was measured on poses of this very map. Links and belly are not looked at.

      stancekit map rubble.stl --robot hexapod --spacing-m 0.05 --headings 16 --out map.npz
      stancekit map rubble.stl --spacing-m 0.05 --headings 16 --fit --picture map.png
      stancekit plan rubble.stl --start 0,0 --goal 2,0 --map map.npz

    A map that is stopped goes on from --out when it is started again. Exit code: 0 done; 2 bad
    input.
    """

    terrain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TERRAIN")]
    """Mesh, grid or point cloud in a file, or a ground by its name, as stairs:0.5:7."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="NAME|FILE")] = None
    """Whose limbs stand: a built-in name, a .urdf file, or a .yaml file that names one; else the
    default hexapod."""
    spacing_m: float = 0.1
    """Between places, along x and y [m]."""
    headings: int = 8
    """Headings at each place, evenly about the vertical, the first along x."""
    friction: float = 0.8
    """Friction coefficient of the terrain."""
    time_limit_s: float = 60.0
    """Limit for all of it [s]."""
    fit: bool = False
    """Learn what is likely of poses that are not reached (extra rl)."""
    surrogate: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File of `stancekit fit --method surrogate`, for all limbs of the robot on ground, in the
    place of --fit; it is calibrated on this map, too."""
    file: Annotated[FileMeaning, *OF_FILE] = field(default_factory=FileMeaning)
    """What the numbers of a terrain's file mean."""
    grid_m: float = 0.05
    """Grid spacing of a terrain's file, and of the map that a cloud becomes [m]."""
    footholds: Annotated[FootholdOptions, tyro.conf.OmitArgPrefixes] = field(
        default_factory=FootholdOptions
    )
    """What counts as a foothold."""
    error: float = 0.005
    """Chance with which a likely answer may be wrong."""
    seed: int = 0
    """Seed of the poses that likely answers are calibrated on."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File of the map: .npz, for `stancekit plan --map`, written now and then; or .json."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the map: .png, .pdf or .svg."""
    json: bool = False
    """One JSON object: counts, shares, what is in the way, margins, seconds."""

    def run(self) -> int:
        """Make the map, write and say it."""
        from stancekit.standing import map as map_terrain

        check_drawn(picture=self.picture)
        check_out(self.out, ".npz", ".json")
        check_limit(self.time_limit_s)
        checkpoint = self.out if self.out is not None and self.out.suffix == ".npz" else None
        names = (
            "spacing_m",
            "headings",
            "friction",
            "error",
            "seed",
            "fit",
            "surrogate",
            "spacing_m, headings",
            "grid_m",
        )
        meaning = vars(self.file.options())
        meaning.pop("spacing_m")
        with (
            progress(f"map {Path(self.terrain).name}") as bar,
            as_options(*names),
            in_options(),
        ):
            standing = map_terrain(
                self.terrain,
                robot=self.robot,
                spacing_m=self.spacing_m,
                headings=self.headings,
                friction=self.friction,
                time_limit_s=self.time_limit_s,
                fit=self.fit,
                surrogate=self.surrogate,
                error=self.error,
                seed=self.seed,
                checkpoint=checkpoint,
                limits=self.footholds.limits(),
                grid_m=self.grid_m,
                **meaning,
                progress=lambda done, total, stage: bar(
                    done, total, f"{stage}, {done} of {total} poses settled"
                ),
            )
        if self.out is not None:
            standing.save(self.out)
        if self.picture is not None:
            from stancekit.views.maps import draw_standing_map
            from stancekit.views.sheet import save

            save(draw_standing_map(standing), self.picture)
        if self.json:
            emit(standing.to_json())
            return 0
        out.print(_table(standing))
        say_written(self.out, self.picture)
        return 0


def _table(found: StandingMap) -> Table:
    (x, y, headings), shares, likely = found.shape, found.shares(), ""
    if found.error is not None and found.confidence is not None:
        likely = (
            f"each wrong with a chance of {100 * found.error:.3g} % at most, at a confidence of "
            f"{100 * found.confidence:.0f} %"
        )
    way = ", ".join(f"{name} {count}" for name, count in found.in_the_way().items())
    counts = [
        (name, f"{count} poses, {100 * shares[name]:.1f} %" if count else "")
        for name, count in found.counts().items()
    ]
    margins = [
        (name, f"{median:.3g} in the median, 5 % below {low:.3g}")
        for name, (low, median, _) in found.margins().items()
    ]
    return facts(
        [
            ("terrain", f"{found.terrain}, friction {found.friction:g}"),
            ("robot", found.robot),
            ("grid", f"{x} × {y} places {found.spacing_m:g} m apart, {headings} headings"),
            *counts,
            ("proved", f"{100 * shares['proved']:.1f} %"),
            ("likely", likely),
            ("in the way", way),
            *margins,
            ("seconds", ", ".join(f"{k} {v:.3g}" for k, v in found.seconds.items())),
        ],
        "ellipsis",
    )
