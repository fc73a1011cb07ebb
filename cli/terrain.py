"""``stancekit terrain``: what of a terrain a foot may be put on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from .console import emit, facts, out, say_written
from .options import (
    OF_FILE,
    FootholdOptions,
    OptionalPath,
    OptionalText,
    TerrainFile,
    check_drawn,
    in_options,
    place,
)

if TYPE_CHECKING:
    from stancekit import Footholds


@dataclass
class ShowTerrain:
    """Show the footholds of a terrain: planar convex pieces, what was refused and why, and how
    certain each is.

    TERRAIN is a mesh (.stl, .obj, .ply, .dae, .off, .glb; broken ones, too), a MuJoCo scene (.xml),
    a grid of heights (.npy, .npz, .csv, .png), a point cloud (.ply, .pcd, .xyz, .npy, .csv), a
    function of x and y as FILE.py:NAME, or a ground by its name: ripple, cone, hill, pit, pit-84 or
    pit-87, or FAMILY:LEVEL:SEED with a level from 0 to 1, as stairs:0.5:7.

      stairs  height of a riser: 0.5 · level m
      stones  clear distance of stones: 0.6 · level m; their side 0.25 − 0.2 · level m
      gaps    width of a gap across the way: 1.0 · level m
      beams   width of a beam along the way: 1.2 − 1.16 · level m
      rubble  deviation of blocks' heights: 0.6 · level m; leans to 0.8 · level
      slopes  angle of a plane that is climbed: 0.8 · level rad
      walls   distance of two walls: 0.56 + 0.5 · level m
      rough   deviation of noise of 0.5 m wavelength: 0.08 · level m
      waves   steepness of five wave trains: up to tan(25°) · level each
      ramps   slope of three planes: up to tan(35°) · level

    A name is the same ground for plan, gait, warp, play, sample and environments: as patches, and
    as heights whose edges are rounded.

      stancekit terrain stairs.stl --unit-m 0.001 --picture footholds.png
      stancekit terrain scan.pcd --spacing-m 0.02 --noise-m 0.01 --robot go1.urdf --json
      stancekit plan stairs.stl --start 0,0 --goal 1.5,0

    Exit code: 0 done; 2 bad input, or no foothold at all.
    """

    terrain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TERRAIN")]
    """File, name, FAMILY:LEVEL:SEED, or FILE.py:NAME."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="NAME|FILE")] = None
    """Whose foot is the margin and the least width: a built-in name, a .urdf file, or a .yaml file
    that names one."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    footholds: Annotated[FootholdOptions, tyro.conf.OmitArgPrefixes] = field(
        default_factory=FootholdOptions
    )
    """What counts as a foothold."""
    start: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """Drawn in picture and page: where a plan would begin [m]."""
    goal: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """Drawn in picture and page: where it would end [m]."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the terrain with its footholds: .png, .pdf or .svg."""
    html: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.html")] = None
    """Page in three dimensions that a browser opens from disk (extra viz)."""
    json: bool = False
    """One JSON object: patches, areas, what was refused and why, which axes of a file became x, y
    and z."""

    def run(self) -> int:
        """Read, find footholds, draw, say."""
        check_drawn(picture=self.picture, html=self.html)
        asked = {"start": self.start, "goal": self.goal}
        places = {key: place(each, f"--{key}") for key, each in asked.items() if each is not None}
        footholds = self._found()
        if self.picture is not None:
            from stancekit.views.sheet import save
            from stancekit.views.terrain import draw_footholds

            save(draw_footholds(footholds, places), self.picture)
        if self.html is not None:
            from stancekit.views.page import write_page
            from stancekit.views.terrain import foothold_motion

            write_page(self.html, foothold_motion(footholds, places))
        axes = (
            dict(zip("xyz", self.file.asked().axes, strict=True))
            if Path(self.terrain).exists() and ".py" not in self.terrain
            else {}
        )
        if self.json:
            emit({**footholds.to_json(), **({"axes": axes} if axes else {})})
            return 0
        turned = axes if self.file.up != "z" else {}
        words = ", ".join(f"{axis} is the file's {values}" for axis, values in turned.items())
        out.print(facts([*_rows(footholds), ("axes", words)], "ellipsis"))
        say_written(self.picture, self.html)
        return 0

    def _found(self) -> Footholds:
        from stancekit import terrain

        meaning, limits = vars(self.file.asked()), self.footholds.limits()
        with in_options():
            return terrain(self.terrain, robot=self.robot, limits=limits, **meaning)


def _rows(found: Footholds) -> Iterator[tuple[str, str]]:
    """What there is to say of footholds."""
    import numpy as np

    surfaces = len({piece.surface for piece in found.pieces})
    rms = np.array([piece.rms_m for piece in found.pieces])
    ends = zip("xyz", found.extent_m.tolist(), strict=True)
    noise = "" if found.noise_m is None else f"{1e3 * found.noise_m:.2g} mm, {found.noise_source}"
    yield from (
        ("terrain", found.name),
        (
            "footholds",
            f"{len(found.pieces)} patches on {surfaces} surfaces, {found.area_m2:.4g} m²",
        ),
        ("extent", ", ".join(f"{axis} {a:.4g} to {b:.4g} m" for axis, (a, b) in ends)),
        ("steepest", f"{np.rad2deg(max(piece.slope_rad for piece in found.pieces)):.1f}°"),
        (
            "rms off plane",
            f"{1e3 * np.median(rms):.2g} mm median, {1e3 * rms.max():.2g} mm at most",
        ),
        ("noise", noise),
    )
    known = [piece for piece in found.pieces if piece.height_sd_m is not None]
    scales = ("height", 1e3, " mm"), ("tilt", 180.0 / np.pi, "°"), ("edge", 1e3, " mm")
    for name, scale, unit in scales if known else ():
        key = f"{name}_sd_rad" if name == "tilt" else f"{name}_sd_m"
        sd = scale * np.array([getattr(piece, key) for piece in known])
        yield (
            f"sd of {'edges' if name == 'edge' else name}",
            f"{np.median(sd):.2g}{unit} median, {sd.max():.2g}{unit} at most",
        )
    for reason, area in found.refused_m2.items():
        yield f"not: {reason}", f"{area:.4g} m²" if area > 1e-6 else ""
