"""``stancekit robot``, ``terrain``, ``map`` and ``warp``: what a robot's file says, grounds, where a foot
or a robot can stand on them, and the map that flattens one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from .console import as_options, draw_to_file, emit, facts, grid, out, progress, say, tell
from .options import (
    OF_FILE,
    FileMeaning,
    FootholdOptions,
    OptionalPath,
    OptionalText,
    TerrainFile,
    check_drawn,
    check_limit,
    check_out,
    check_unused,
    in_options,
    numbers,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import Footholds, StandingMap
    from stancekit.planners.robot.reach_sets import Workspace
    from stancekit.planners.robot.robot_model import RobotModel
    from stancekit.planners.warp.report import MapReport


@dataclass
class ShowRobot:
    """Read a robot: legs, feet, joints, limits, torques, mass, and what each foot reaches.

    Guesses are marked.

    ROBOT is a name, a .urdf file, or a .yaml file that names one and corrects it: the same wherever
    a robot is asked for. Without ROBOT the command lists the names. Legs and feet are found by
    their shape and names; a .yaml file may say them (docs/robots.md).

      stancekit robot
      stancekit robot go1 --picture go1.png

    Exit code 1 for a robot that nothing can be planned for, as with legs of two joints.

    reach: how far from its hip a foot gets. cover: share of what a foot reaches, usefully below its
    hip, that plans may use, a convex polytope; unreachable: share of that polytope that the leg
    does not reach. Proofs use an outer set that nothing reachable is outside of.
    """

    robot: Annotated[OptionalText, tyro.conf.Positional, tyro.conf.arg(metavar="ROBOT")] = None
    """A name, a .urdf file, or a .yaml file that names one; none lists the names."""
    srdf: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """SRDF file: pairs of links that may touch, and a posture to stand in."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the robot and of what its feet reach: .png, .pdf or .svg."""
    json: bool = False
    """One JSON object on standard output."""

    def run(self) -> int:
        """Read, measure, draw, say."""
        from stancekit.planners.errors import InvalidInput
        from stancekit.planners.robot.reach_sets import workspaces_of
        from stancekit.planners.robot.robot_file import named_robot

        if self.robot is None:
            return self._list()
        check_drawn(self.picture)
        model = named_robot(self.robot, srdf=self.srdf)
        workspaces: list[Workspace | None]
        try:
            workspaces, trouble = list(workspaces_of(model)), ""
        except InvalidInput as error:  # a robot whose feet stay on a surface is a robot still
            workspaces, trouble = [None] * len(model.legs), str(error)
        if self.picture is not None:
            unseen = _drawn(model, workspaces, self.picture)
            model = replace(model, doubts=(*model.doubts, *unseen))
        if self.json:
            emit(_record(model, workspaces, trouble))
            return int(bool(trouble))
        out.print(_head(model))
        for table in (_legs(model, workspaces), _joints(model)):
            out.print()
            out.print(table)
        out.print()
        for line in (
            *map("guess: {}".format, model.guesses),
            *map("doubt: {}".format, model.doubts),
        ):
            out.print(line)
        if trouble:
            out.print(f"no workspace: {trouble}")
        return int(bool(trouble))

    def _list(self) -> int:
        """Print the robots with a name, and what installs the file of each.

        Raises InvalidInput for an option.
        """
        from stancekit.planners.errors import install_command, package_command
        from stancekit.planners.robot.model import BUILT_IN
        from stancekit.planners.robot.robot_file import (
            CATALOGUE,
            as_they_come,
            catalogue,
            provider_folder,
            read_keys,
        )

        check_unused(self, ("picture", "srdf"), "the list of robots")
        named = {name: read_keys(path).provider for name, path in catalogue().items()}
        named |= {name: provider for name, provider, _ in as_they_come()}
        there = {each: provider_folder(each) is not None for each in set(named.values())}
        rows = [(name, "stancekit", True) for name in BUILT_IN]
        rows += [(name, each, there[each]) for name, each in sorted(named.items())]
        if self.json:
            for name, source, installed in rows:
                emit({"name": name, "provider": source, "installed": installed})
            return 0
        lines = (
            (
                name,
                source,
                ""
                if installed
                else install_command("catalogue")
                if source in CATALOGUE
                else package_command(source),
            )
            for name, source, installed in rows
        )
        out.print(_table(("robot", "file from", ""), lines))
        return 0


def _drawn(model: RobotModel, workspaces: list[Workspace | None], picture: Path) -> list[str]:
    """Draw the robot; doubts on meshes that should be in the picture and cannot be."""
    from stancekit.planners.robot.meshes import unseen
    from stancekit.views.robots import TRIANGLES, draw_robot

    draw_to_file(draw_robot(model, [each for each in workspaces if each is not None]), picture)
    return list(unseen(model.shapes, TRIANGLES))


def _head(model: RobotModel) -> Table:
    com = ", ".join(f"{round(float(value), 3) + 0.0:.3f}" for value in model.com_m)
    import numpy as np

    moments = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(model.inertia_kgm2))
    joints = sum(len(leg.joints) for leg in model.legs)
    rows = (
        ("robot", model.name),
        ("mass", f"{model.mass_kg:.3f} kg, centre at ({com}) m, moments {moments} kg m²"),
        ("legs", f"{len(model.legs)}, {joints} joints: {', '.join(model.leg_names)}"),
        ("stands", f"{model.stand_height_m:.3f} m above its feet"),
        (
            "may touch",
            f"{len(model.disabled_pairs)} pairs of links, by the SRDF"
            if model.disabled_pairs
            else "",
        ),
    )
    return facts(rows, "ellipsis")


def _legs(model: RobotModel, workspaces: list[Workspace | None]) -> Table:
    rows = (
        (leg.name, leg.foot, "–", "–", "–")
        if space is None
        else (
            leg.name,
            leg.foot,
            f"{space.reach_m:.3f}",
            f"{space.cover:.0%}",
            f"{space.unreachable:.2%}",
        )
        for leg, space in zip(model.legs, workspaces, strict=True)
    )
    return _table(("leg", "foot", "reach [m]", "cover", "unreachable"), rows)


def _joints(model: RobotModel) -> Table:
    rows = (
        (
            leg.name,
            joint.name,
            f"{joint.lower_rad:.2f}",
            f"{joint.upper_rad:.2f}{' m' if joint.slides else ''}",
            f"{angle:.2f}",
            f"{joint.torque_nm:g}" if joint.torque_nm > 0.0 else "–",
        )
        for leg in model.legs
        for joint, angle in zip(leg.joints, leg.stance_rad, strict=True)
    )
    return _table(("leg", "joint", "from", "to [rad]", "stands at", "torque [Nm]"), rows)


def _table(names: Sequence[str], rows: Iterable[Iterable[str]]) -> Table:
    """A table whose first two columns are words, the others numbers."""
    how = {
        name: {"justify": "left" if i < 2 else "right", "no_wrap": True}
        for i, name in enumerate(names)
    }
    return grid(how, rows, box=None)


def _record(model: RobotModel, workspaces: list[Workspace | None], trouble: str) -> dict[str, Any]:
    legs = []
    for leg, workspace in zip(model.legs, workspaces, strict=True):
        joints = [
            {
                "name": joint.name,
                "lower_rad": joint.lower_rad,
                "upper_rad": joint.upper_rad,
                "torque_nm": joint.torque_nm or None,
                "velocity_rad_s": joint.velocity_rad_s or None,
                "slides": joint.slides,
            }
            for joint in leg.joints
        ]
        record: dict[str, Any] = {
            "name": leg.name,
            "foot": leg.foot,
            "radius_m": leg.radius_m,
            "hip_m": leg.hip_m.tolist(),
            "stance_rad": leg.stance_rad.tolist(),
            "foot_m": leg.nominal_m.tolist(),
            "joints": joints,
        }
        if workspace is not None:
            record |= {
                "reach_m": workspace.reach_m,
                "cover": workspace.cover,
                "unreachable": workspace.unreachable,
                "faces": len(workspace.inner.normals),
                "ball_m": workspace.ball_m.tolist(),
                "box_m": workspace.box_m.tolist(),
            }
        legs.append(record)
    return {
        "name": model.name,
        "mass_kg": model.mass_kg,
        "com_m": model.com_m.tolist(),
        "inertia_kgm2": model.inertia_kgm2.tolist(),
        "stand_height_m": model.stand_height_m,
        "legs": legs,
        "disabled_pairs": sorted(sorted(pair) for pair in model.disabled_pairs),
        "guesses": list(model.guesses),
        "doubts": list(model.doubts),
        "no_workspace": trouble or None,
        "digest": model.digest,
    }


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
        footholds = self._found()
        if self.picture is not None:
            from stancekit.views.terrain import draw_footholds

            draw_to_file(draw_footholds(footholds), self.picture)
        if self.html is not None:
            from stancekit.views.page import write_page
            from stancekit.views.terrain import foothold_motion

            write_page(self.html, foothold_motion(footholds))
        axes = (
            dict(zip("xyz", self.file.asked().axes, strict=True))
            if Path(self.terrain).exists() and ".py" not in self.terrain
            else {}
        )
        turned = axes if self.file.up != "z" else {}
        words = ", ".join(f"{axis} is the file's {values}" for axis, values in turned.items())
        table = facts([*_found_rows(footholds), ("axes", words)], "ellipsis")
        tell(self.json, footholds.to_json() | ({"axes": axes} if axes else {}), table)
        say(() if self.json else (self.picture, self.html), "wrote {}")
        return 0

    def _found(self) -> Footholds:
        from stancekit import terrain

        meaning, limits = vars(self.file.asked()), self.footholds.limits()
        with in_options():
            return terrain(self.terrain, robot=self.robot, limits=limits, **meaning)


def _found_rows(found: Footholds) -> Iterator[tuple[str, str]]:
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
        meaning = vars(self.file.asked())
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

            draw_to_file(draw_standing_map(standing), self.picture)
        tell(self.json, standing.to_json(), _standing_table(standing))
        say(() if self.json else standing.doubts, "doubt: {}")
        say(() if self.json else (self.out, self.picture), "wrote {}")
        return 0


def _standing_table(found: StandingMap) -> Table:
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
        (
            {"support_m": "support [m]", "push_n": "push [N]"}[name],
            f"{median:.3g} in the median, 5 % below {low:.3g}",
        )
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
    method: Literal["fast", "local-global", "gauss-newton"] = "fast"
    """fast: ours, exact at the ground. local-global: Algorithm 1 of the paper; gauss-newton: its
    second method, with a barrier; both as published, with no snap."""
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

            draw_to_file(draw_map(fit.map, terrain, fit.report), self.picture)
        tell(self.json, fit.report.to_json(), _warp_table(fit.report))
        return 0 if fit.report.least_det > 0.0 else 1


def _warp_table(report: MapReport) -> Table:
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
