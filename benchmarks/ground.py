"""Footholds of six true grounds that are sampled with noise, held against the truth.

The grounds are stairs (8 cm), slabs that lean, stones and beams (10 and 15 cm wide) over a floor 25
cm down, rubble, and a slope with a step of 6 cm. Each is sampled as a grid or as a cloud with noise
that is white, or correlated over 5 cm, and the package finds the footholds. A table's row is one
sample:

    area       footholds found on the surface that they are of, as a share of the true ground that
               is a margin from edges
    off_mm     95th percentile of the distance from footholds to the true surface at the same place,
               and the largest
    far        share of the footholds' area that is more than 2 cm off the true surface
    over       share of the footholds' area that lies beyond a true edge of their own surface
    z_rms      root mean square of the distance from footholds to the true surface in standard
               deviations, as the package says them; z_beyond_3: share of the footholds' area where
               it is more than three
    tilt_rms   the same of the slopes of surfaces, by their covariance; tilt_beyond_3: share of the
               surfaces whose slopes are farther off than three deviations
    cpu_s      time of the search

With --plan a hexapod's course is planned over each, with --play it is executed on the true ground:

    accepted     plans that are accepted; toes_worst_mm: the toe that is farthest off the true
                 surface
    toes_within  toes whose touch-down reaches the true surface
    toes_over    toes with a true edge of 1 cm or more within 1 cm
    executed     plans that MuJoCo executes on the true ground with success

Cells are kept in a folder, so that a run that ends goes on where it was. With --against, the same
cells are measured with the package of another checkout, in which ``python setup.py links`` was run,
and both are printed.

    python benchmarks/ground.py --out FOLDER
    python benchmarks/ground.py --out FOLDER --grids 2,5 --clouds 1e4,1e5 --noises-cm 0,1,2,3 \
        --correlated --draws 3
    python benchmarks/ground.py --out FOLDER --against ../before --plan
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from _bench import Options, Row, kept, launch
from _checkouts import of_checkout
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.footholds import FootholdLimits, Footholds, read_footholds
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.terrain.patch import Patch

LOW, HIGH = np.array([-1.0, -0.8]), np.array([1.4, 0.8])
"""Corners of the ground [m]."""
FINE_M, MARGIN_M, CORRELATED_M = 0.005, 0.02, 0.05
"""Spacing of the raster of the truth, margin of footholds, and length over which noise is
correlated [m]."""
LEAST_SD_M = 1e-4
"""Errors are counted in standard deviations that are no less [m]."""
FAR_M, HOLE_M, STEP_M = 0.02, 0.06, 0.01
"""Footholds farther than this off the truth are counted; side of a hole; and steps lower than this
are no edges [m]."""
TIME_S = 600.0
"""Time limit of a plan, which takes 5 to 15 s alone on a core [s]."""
TILT_3 = 11.83
"""Square of two slopes in deviations that is larger as often as one value is beyond three."""
Truth = tuple[Array, NDArray[np.int_]]
"""Heights [m], and which surface is there, the same number for one plane."""


@dataclass(frozen=True, kw_only=True)
class GroundOptions(Options):
    """Which samples are made, and where their cells are kept."""

    out: Path
    """Folder of the cells."""
    grounds: str = "stairs,slabs,stones,beams,rubble,slope"
    grids: str = "2,5"
    """Spacings of grids [cm]."""
    clouds: str = "1e4"
    """Points of clouds."""
    noises_cm: str = "0,2"
    """Deviations of the noise [cm]; 2correlated is noise of 2 cm that is correlated over 5 cm."""
    correlated: bool = False
    """Noise correlated over 5 cm beside white noise."""
    draws: int = 1
    told: bool = False
    """The package is told the noise (noise_m) instead of estimating it; another checkout always
    is."""
    plan: bool = False
    """A hexapod's course over 60 cm is planned, too: whether it is accepted, and its toes against
    the truth."""
    play: bool = False
    """Accepted plans are executed on the true ground in MuJoCo, too."""
    holes: float = 0.0
    """Share of the ground, in squares of 6 cm, that has no samples."""
    against: Path | None = None
    """Another checkout to measure the same cells with."""

    @property
    def parts(self) -> str:
        """What is measured beside the footholds, as a part of a cell's name."""
        holes = f"-holes{self.holes:g}" if self.holes else ""
        return f"{holes}{'-play' if self.play else '-plan' if self.plan else ''}"


def main(options: GroundOptions) -> None:
    """Print a row per cell, and means over the grounds."""
    sides = {"after": options.out}
    if options.against is not None:
        sides = {"before": options.out / "before", **sides}
        arguments = [word for word in sys.argv[1:] if word not in ("--json", "--told")]
        at, where = arguments.index("--against"), arguments.index("--out")
        arguments[where + 1] = str(sides["before"])
        del arguments[at : at + 2]
        command = [sys.executable, str(Path(__file__).resolve()), *arguments, "--told"]
        subprocess.run(
            command,
            env=of_checkout(options.against.resolve()),
            stdout=subprocess.DEVNULL,
            check=True,
        )
    found: dict[tuple[str, str], list[Row]] = {}
    for kind, noise, draw, ground in cells(options):
        name = f"{ground}-{kind}-{noise}-{draw}{options.parts}"
        for side, folder in sides.items():
            told = options.told or side == "before"
            path = folder / f"{name}{'-told' if told else ''}.json"
            row = kept(path, lambda: cell_of(ground, kind, noise, draw, options, told=told))  # noqa: B023
            options.say({"side": side, "cell": name, **row})
            found.setdefault((f"{kind} {noise}", side), []).append(row)
    for (sample, side), rows in found.items():
        options.say({"side": side, "mean": sample, "cells": len(rows), **means(rows)})


def cells(options: GroundOptions) -> list[tuple[str, str, int, str]]:
    """Sample, noise, draw and ground of every cell."""
    samples = [f"grid{each}" for each in options.grids.split(",") if each]
    samples += [f"cloud{each}" for each in options.clouds.split(",") if each]
    noises = [
        f"{each.removesuffix('correlated')}cm{'correlated' * each.endswith('correlated')}"
        for each in options.noises_cm.split(",")
    ]
    if options.correlated:
        noises += [f"{each}correlated" for each in noises if each.endswith("cm") and each != "0cm"]
    return list(product(samples, noises, range(options.draws), options.grounds.split(",")))


def means(rows: list[Row]) -> Row:
    """Means of the figures that every row has, and of plans their counts."""
    keys = (
        "area",
        "off_mm",
        "worst_mm",
        "far",
        "over",
        "cpu_s",
        "z_rms",
        "z_beyond_3",
        "tilt_rms",
        "tilt_beyond_3",
    )
    some: Row = {
        key: round(float(np.mean([row[key] for row in rows if key in row] or [np.nan])), 4)
        for key in keys
    }
    some["none"] = sum("none" in row for row in rows)
    if any("plan" in row for row in rows):
        good = [row for row in rows if row.get("plan") == "accepted"]
        toes = sum(row["toes"] for row in good)
        some |= {
            "accepted": len(good),
            "toes_worst_mm": max((row["toes_worst_mm"] for row in good), default=None),
        }
        some |= {key: sum(row[key] for row in good) for key in ("toes", "toes_over", "toes_within")}
        some["within"] = round(some["toes_within"] / toes, 4) if toes else None
        if any("executed" in row for row in good):
            some |= {"played": len(good), "executed": sum(row["executed"] for row in good)}
    return some


def cell_of(
    ground: str, kind: str, noise: str, draw: int, options: GroundOptions, *, told: bool
) -> Row:
    """The figures of one sample."""
    deviation_m = 0.01 * float(noise.split("cm")[0])
    rng = np.random.default_rng([options.seed, draw, *map(ord, f"{ground}{kind}{noise}")])
    truth = grounds(np.random.default_rng([options.seed, draw, *map(ord, ground)]))[ground]
    path = options.out / "sample.npy"
    path.parent.mkdir(parents=True, exist_ok=True)
    correlated_m = CORRELATED_M if noise.endswith("correlated") else 0.0
    if kind.startswith("grid"):
        spacing_m = 0.01 * float(kind[4:])
        x, y = (np.arange(a, b + 1e-9, spacing_m) for a, b in zip(LOW, HIGH, strict=True))
        heights = truth(*np.meshgrid(x, y, indexing="ij"))[0]
        noises = rng.standard_normal(heights.shape)
        if correlated_m:
            noises = gaussian_filter(noises, 0.5 * correlated_m / spacing_m)
            noises /= noises.std()
        heights = heights + deviation_m * noises
        heights[holed(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1), options.holes, rng)] = (
            np.nan
        )
        np.save(path, heights)
        middle = 0.5 * np.array([x[0] + x[-1], y[0] + y[-1]])
        meaning = ImportOptions(kind="grid", spacing_m=spacing_m, offset_m=(*middle, 0.0))
    else:
        places = rng.uniform(LOW, HIGH, (int(float(kind[5:])), 2))
        noises = rng.standard_normal(len(places))
        if correlated_m:
            field = gaussian_filter(rng.standard_normal((480, 320)), 0.5 * correlated_m / FINE_M)
            at = ((places - LOW) / FINE_M).astype(int)
            noises = field[at[:, 0], at[:, 1]] / field.std()
        points = np.column_stack([places, truth(*places.T)[0] + deviation_m * noises])
        np.save(path, points[~holed(places, options.holes, rng)])
        dense = len(places) / float(np.prod(HIGH - LOW))
        meaning = ImportOptions(
            kind="cloud", spacing_m=float(np.clip(2.0 / np.sqrt(dense), 0.01, 0.05))
        )
    limits = FootholdLimits(margin_m=MARGIN_M, **({"noise_m": deviation_m} if told else {}))
    begun = time.process_time()
    try:
        found = read_footholds(path, meaning, limits, 0.8)
    except InvalidInput as error:
        return {"none": str(error), "area": 0.0, "cpu_s": round(time.process_time() - begun, 3)}
    row = {**score(found, truth), "cpu_s": round(time.process_time() - begun, 3)}
    return row | (planned(found, truth, play=options.play) if options.plan or options.play else {})


def holed(places: Array, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which places, shape (…, 2), have no sample: those in squares of 6 cm of this share."""
    squares = ((places - LOW) / HOLE_M).astype(int)
    empty = rng.random((64, 64)) < share if share else np.zeros((64, 64), dtype=bool)
    return np.asarray(empty[squares[..., 0], squares[..., 1]])


def score(found: Footholds, truth: Callable[[Array, Array], Truth]) -> Row:
    """Footholds against the true ground on a fine raster."""
    lines = [np.arange(a, b, FINE_M) + 0.5 * FINE_M for a, b in zip(LOW, HIGH, strict=True)]
    x, y = np.meshgrid(*lines, indexing="ij")
    heights, surface = truth(x, y)
    edge = np.zeros(x.shape, dtype=bool)
    edge[:-1] |= surface[:-1] != surface[1:]
    edge[:, :-1] |= surface[:, :-1] != surface[:, 1:]
    edge[[0, -1]] = edge[:, [0, -1]] = True
    good = distance_transform_edt(~edge) * FINE_M > MARGIN_M
    covered = np.zeros(x.shape, dtype=bool)
    off, over, cells_of = list[Array](), 0, 0
    standard, tilts = list[Array](), dict[int, float]()
    for piece in found.pieces:
        corners, normal = piece.patch.vertices_m, piece.patch.normal
        if abs(normal[2]) < 0.1:
            continue
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        part = tuple(
            slice(*np.searchsorted(line, [a, b]))
            for line, a, b in zip(lines, low, high, strict=True)
        )
        inside = shapely.contains_xy(
            shapely.Polygon(corners[:, :2]), x[part].ravel(), y[part].ravel()
        ).reshape(x[part].shape)
        if not inside.any():
            continue
        level = (
            corners[0, 2]
            - ((x[part] - corners[0, 0]) * normal[0] + (y[part] - corners[0, 1]) * normal[1])
            / normal[2]
        )
        own = surface[part] == np.bincount(surface[part][inside]).argmax()
        off.append(np.abs(level - heights[part])[inside])
        if piece.patch.certainty is not None:
            places = np.stack([x[part][inside], y[part][inside]], axis=-1)
            spread = np.maximum(piece.patch.certainty.height_sd_m(places), LEAST_SD_M)
            standard.append((level - heights[part])[inside] / spread)
            places, own_heights = places[own[inside]], heights[part][inside & own]
            if piece.surface not in tilts and len(places) > 2:
                slopes = np.linalg.lstsq(
                    np.column_stack([np.ones(len(places)), places]), own_heights, rcond=None
                )[0][1:]
                wrong = -normal[:2] / normal[2] - slopes
                shares = np.linalg.solve(piece.patch.certainty.slope_covariance, wrong)
                tilts[piece.surface] = float(wrong @ shares)
        over += int((inside & ~own).sum())
        cells_of += int(inside.sum())
        covered[part] |= inside & own & (np.abs(level - heights[part]) < FAR_M)
    all_off = 1e3 * np.concatenate(off or [np.zeros(1)])
    z = np.abs(np.concatenate(standard)) if standard else None
    errors = (
        {}
        if z is None
        else {
            "z_rms": round(float(np.sqrt(np.mean(z**2))), 3),
            "z_beyond_3": round(float(np.mean(z > 3.0)), 4),
        }
    )
    if tilts:
        squares = np.array(list(tilts.values()))
        errors |= {
            "tilt_rms": round(float(np.sqrt(max(np.mean(squares), 0.0) / 2.0)), 3),
            "tilt_beyond_3": round(float(np.mean(squares > TILT_3)), 4),
        }
    return errors | {
        "area": round(float((covered & good).sum() / good.sum()), 4),
        "off_mm": round(float(np.quantile(all_off, 0.95)), 2),
        "worst_mm": round(float(all_off.max()), 1),
        "far": round(float(np.mean(all_off > 1e3 * FAR_M)), 4),
        "over": round(over / max(cells_of, 1), 5),
        "pieces": len(found.pieces),
        "found_m2": round(found.area_m2, 3),
        "refused_m2": {
            name: round(area, 3) for name, area in found.refused_m2.items() if area > 1e-3
        },
    }


def planned(found: Footholds, truth: Callable[[Array, Array], Truth], *, play: bool) -> Row:
    """A course of the default hexapod along x, its toes against the truth, and what comes of it on
    the true ground.

    toes_within: those whose touch-down reaches the true surface, half a millimetre beside it for
    exact grounds. toes_over: those with a true edge, a step of a centimetre or more, within a
    centimetre.
    """
    import stancekit
    from stancekit.planners.motion.path import touch_downs_m

    try:
        answer = stancekit.plan(found, start=[-0.3, 0.0], goal=[0.3, 0.0], time_limit_s=TIME_S)
    except (InvalidInput, PlanningFailed) as error:
        return {"plan": "none", "why": str(error)}
    plan = answer.solution
    if plan is None or answer.report is None or not answer.report.accepted:
        return {"plan": answer.status.name.lower(), "why": answer.message}
    toes, normals = (
        plan.toes_m,
        np.array([plan.problem.patch(p, plan.choice).normal for p in range(len(plan.toes_m))]),
    )
    heights, surface = truth(*toes[:, :2].T)
    off = np.abs(toes[:, 2] - heights)
    over = np.zeros(len(toes), dtype=bool)
    for step in 0.01 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]):
        level, other = truth(*(toes[:, :2] + step).T)
        gone_on = heights - normals[:, :2] @ step / normals[:, 2]
        over |= (other != surface) & (np.abs(level - gone_on) > STEP_M)
    return {
        "plan": "accepted",
        "toes_worst_mm": round(1e3 * float(off.max()), 1),
        "toes": len(toes),
        "toes_over": int(over.sum()),
        "toes_within": int((off * normals[:, 2] <= touch_downs_m(plan) + 5e-4).sum()),
        "touch_down_mm": round(1e3 * float(touch_downs_m(plan).max()), 1),
    } | (played(plan, truth) if play else {})


def played(plan: Any, truth: Callable[[Array, Array], Truth]) -> Row:
    """A plan on the true ground in MuJoCo."""
    from stancekit.motions import accepted_of
    from stancekit.runner.run import Runner
    from stancekit.runner.settings import RunSettings
    from stancekit.runner.worlds.world import make_world

    try:
        report = Runner(
            make_world("mujoco", plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2),
            settings=RunSettings(check_limits=False),
        ).run(accepted_of(plan), true_patches(truth, plan.problem.terrain[0].friction))
    except InvalidInput as error:
        return {"executed": False, "said": f"not begun: {error}"}
    row: Row = {"executed": report.succeeded, "said": report.message}
    if (run := report.execution) is not None:
        row["slip_mm"], row["body_mm"] = (
            round(1e3 * float(worst), 1) for worst in (run.slip_m.max(), run.com_worst_m)
        )
    return row


def true_patches(truth: Callable[[Array, Array], Truth], friction: float) -> list[Patch]:
    """Every surface of the true ground as a rectangle; floors go on below what stands on them."""
    lines = [
        np.arange(a - 0.3, b + 0.3, FINE_M) + 0.5 * FINE_M for a, b in zip(LOW, HIGH, strict=True)
    ]
    x, y = np.meshgrid(*lines, indexing="ij")
    heights, surface = truth(x, y)
    found = []
    for number in np.unique(surface):
        own = surface == number
        a, b = x[own], y[own]
        level = np.linalg.lstsq(np.column_stack([np.ones(len(a)), a, b]), heights[own], rcond=None)[
            0
        ]
        half = 0.5 * FINE_M
        (x0, x1), (y0, y1) = (a.min() - half, a.max() + half), (b.min() - half, b.max() + half)
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        vertices = np.column_stack([corners, level[0] + corners @ level[1:]])
        normal = np.array([-level[1], -level[2], 1.0]) / np.sqrt(1.0 + level[1:] @ level[1:])
        found.append(
            Patch(
                vertices_m=vertices,
                normal=normal,
                shear_reference=[1.0, 0.0, 0.0],
                friction=friction,
            )
        )
    return found


def grounds(rng: np.random.Generator) -> dict[str, Callable[[Array, Array], Truth]]:
    """The six grounds by name."""
    lean, rise = rng.uniform(-0.14, 0.14, (64, 2)), rng.uniform(0.04, 0.10, 64)
    blocks, leans = rng.normal(0.0, 0.05, (16, 16)), rng.uniform(-0.15, 0.15, (16, 16, 2))
    tops, phase = rng.uniform(-0.02, 0.02, (16, 16)), rng.uniform(0.0, 0.2)

    def stairs(x: Array, y: Array) -> Truth:
        step = np.maximum(np.floor((x + phase) / 0.3), -1.0).astype(int) + 1
        return 0.08 * step, step

    def slabs(x: Array, y: Array) -> Truth:
        i, j = np.floor((x + 1.2) / 0.6).astype(int), np.floor((y + 1.0) / 0.5).astype(int)
        u, v = x + 1.2 - 0.6 * (i + 0.5), y + 1.0 - 0.5 * (j + 0.5)
        k = (8 * i + j) % 64
        on = (np.abs(u) < 0.25) & (np.abs(v) < 0.2)
        return np.where(on, rise[k] + lean[k, 0] * u + lean[k, 1] * v, 0.0), np.where(on, k + 1, 0)

    def stones(x: Array, y: Array) -> Truth:
        i, j = (
            np.floor((x + phase + 2.0) / 0.33).astype(int) % 16,
            np.floor((y + 2.0) / 0.33).astype(int) % 16,
        )
        on = (np.mod(x + phase + 2.0, 0.33) < 0.25) & (np.mod(y + 2.0, 0.33) < 0.25)
        return np.where(on, tops[i, j], -0.25), np.where(on, 1 + 16 * i + j, 0)

    def beams(x: Array, y: Array) -> Truth:
        row, at = np.divmod(y + 2.0 + phase, 0.4)
        on, other = at < 0.15, (at > 0.25) & (at < 0.35)
        number = np.where(on, 1, 2) + 2 * row.astype(int)
        return np.where(on | other, 0.0, -0.25), np.where(on | other, number, 0)

    def rubble(x: Array, y: Array) -> Truth:
        i, j = (
            np.floor((x + phase + 2.0) / 0.4).astype(int) % 16,
            np.floor((y + 2.0) / 0.4).astype(int) % 16,
        )
        u, v = np.mod(x + phase + 2.0, 0.4) - 0.2, np.mod(y + 2.0, 0.4) - 0.2
        return blocks[i, j] + leans[i, j, 0] * u + leans[i, j, 1] * v, 1 + 16 * i + j

    def slope(x: Array, y: Array) -> Truth:
        up = x > 0.1 + phase
        return 0.2 * x + 0.06 * up, up.astype(int)

    made: dict[str, Any] = {
        "stairs": stairs,
        "slabs": slabs,
        "stones": stones,
        "beams": beams,
        "rubble": rubble,
        "slope": slope,
    }
    return made


if __name__ == "__main__":
    launch(main, GroundOptions, __doc__)
