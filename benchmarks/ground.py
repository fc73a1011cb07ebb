"""Footholds of six true grounds that are sampled with noise, held against the truth.

The grounds are stairs (8 cm), slabs that lean, stones and beams (10 and 15 cm wide) over a floor 25 cm down, rubble,
and a slope with a step of 6 cm. Each is sampled as a grid or as a cloud with noise that is white, or correlated over
5 cm, and the package finds the footholds. A table's row is one sample:

    area     footholds found on the surface that they are of, as a share of the true ground that is a margin from edges
    off_mm   95th percentile of the distance from footholds to the true surface at the same place, and the largest
    far      share of the footholds' area that is more than 2 cm off the true surface
    over     share of the footholds' area that lies beyond a true edge of their own surface
    cpu_s    time of the search

Cells are kept in a folder, so that a run that ends goes on where it was. With --against, the same cells are measured
with the package of another checkout, in which ``python setup.py links`` was run, and both are printed.

    python benchmarks/ground.py --out FOLDER
    python benchmarks/ground.py --out FOLDER --grids 2,5 --clouds 1e4,1e5 --noises-cm 0,1,2,3 --correlated --draws 3
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
from _bench import Options, Row, kept, launch, of_checkout
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.foothold_search import read_footholds
from stancekit.planners.terrain.footholds import FootholdLimits, Footholds
from stancekit.planners.terrain.import_options import ImportOptions

LOW, HIGH = np.array([-1.0, -0.8]), np.array([1.4, 0.8])
"""Corners of the ground [m]."""
FINE_M, MARGIN_M, CORRELATED_M = 0.005, 0.02, 0.05
"""Spacing of the raster of the truth, margin of footholds, and length over which noise is correlated [m]."""
FAR_M = 0.02
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
    """Deviations of the noise [cm]."""
    correlated: bool = False
    """Noise correlated over 5 cm beside white noise."""
    draws: int = 1
    told: bool = False
    """The package is told the noise (noise_m) instead of estimating it; another checkout always is."""
    plan: bool = False
    """A hexapod's course over 60 cm is planned, too: whether it is accepted, and its toes against the truth."""
    against: Path | None = None
    """Another checkout to measure the same cells with."""


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
        subprocess.run(command, env=of_checkout(options.against.resolve()), stdout=subprocess.DEVNULL, check=True)
    found: dict[tuple[str, str], list[Row]] = {}
    for kind, noise, draw, ground in cells(options):
        name = f"{ground}-{kind}-{noise}-{draw}{'-plan' if options.plan else ''}"
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
    noises = [f"{each}cm" for each in options.noises_cm.split(",")]
    if options.correlated:
        noises += [f"{each}correlated" for each in noises if float(each[:-2]) > 0.0]
    return list(product(samples, noises, range(options.draws), options.grounds.split(",")))


def means(rows: list[Row]) -> Row:
    """Means of the figures that every row has, and of plans their counts."""
    keys = ("area", "off_mm", "worst_mm", "far", "over", "cpu_s")
    some: Row = {key: round(float(np.mean([row[key] for row in rows if key in row] or [np.nan])), 4) for key in keys}
    some["none"] = sum("none" in row for row in rows)
    if any("plan" in row for row in rows):
        good = [row for row in rows if row.get("plan") == "accepted"]
        some |= {"accepted": len(good), "toes_worst_mm": max((row["toes_worst_mm"] for row in good), default=None)}
        some["toes_over"] = sum(row["toes_over"] for row in good)
    return some


def cell_of(ground: str, kind: str, noise: str, draw: int, options: GroundOptions, *, told: bool) -> Row:
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
        np.save(path, heights + deviation_m * noises)
        middle = 0.5 * np.array([x[0] + x[-1], y[0] + y[-1]])
        meaning = ImportOptions(kind="grid", spacing_m=spacing_m, offset_m=(*middle, 0.0))
    else:
        places = rng.uniform(LOW, HIGH, (int(float(kind[5:])), 2))
        noises = rng.standard_normal(len(places))
        if correlated_m:
            field = gaussian_filter(rng.standard_normal((480, 320)), 0.5 * correlated_m / FINE_M)
            at = ((places - LOW) / FINE_M).astype(int)
            noises = field[at[:, 0], at[:, 1]] / field.std()
        np.save(path, np.column_stack([places, truth(*places.T)[0] + deviation_m * noises]))
        dense = len(places) / float(np.prod(HIGH - LOW))
        meaning = ImportOptions(kind="cloud", spacing_m=float(np.clip(2.0 / np.sqrt(dense), 0.01, 0.05)))
    limits = FootholdLimits(margin_m=MARGIN_M, **({"noise_m": deviation_m} if told else {}))
    begun = time.process_time()
    try:
        found = read_footholds(path, meaning, limits, 0.8)
    except InvalidInput as error:
        return {"none": str(error), "area": 0.0, "cpu_s": round(time.process_time() - begun, 3)}
    row = {**score(found, truth), "cpu_s": round(time.process_time() - begun, 3)}
    return row | (planned(found, truth) if options.plan else {})


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
    for piece in found.pieces:
        corners, normal = piece.patch.vertices_m, piece.patch.normal
        if abs(normal[2]) < 0.1:
            continue
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        part = tuple(slice(*np.searchsorted(line, [a, b])) for line, a, b in zip(lines, low, high, strict=True))
        inside = shapely.contains_xy(shapely.Polygon(corners[:, :2]), x[part].ravel(), y[part].ravel())
        inside = inside.reshape(x[part].shape)
        if not inside.any():
            continue
        level = (
            corners[0, 2] - ((x[part] - corners[0, 0]) * normal[0] + (y[part] - corners[0, 1]) * normal[1]) / normal[2]
        )
        own = surface[part] == np.bincount(surface[part][inside]).argmax()
        off.append(np.abs(level - heights[part])[inside])
        over += int((inside & ~own).sum())
        cells_of += int(inside.sum())
        covered[part] |= inside & own & (np.abs(level - heights[part]) < FAR_M)
    all_off = 1e3 * np.concatenate(off or [np.zeros(1)])
    return {
        "area": round(float((covered & good).sum() / good.sum()), 4),
        "off_mm": round(float(np.quantile(all_off, 0.95)), 2), "worst_mm": round(float(all_off.max()), 1),
        "far": round(float(np.mean(all_off > 1e3 * FAR_M)), 4), "over": round(over / max(cells_of, 1), 5),
        "pieces": len(found.pieces), "found_m2": round(found.area_m2, 3),
        "refused_m2": {name: round(area, 3) for name, area in found.refused_m2.items() if area > 1e-3},
    }  # fmt: skip


def planned(found: Footholds, truth: Callable[[Array, Array], Truth]) -> Row:
    """A course of the default hexapod along x, and its toes against the truth."""
    import stancekit

    try:
        answer = stancekit.plan(found, start_xy_m=[-0.3, 0.0], goal_xy_m=[0.3, 0.0])
    except InvalidInput as error:
        return {"plan": "none", "why": str(error)}
    if answer.solution is None or not answer.report.accepted:
        return {"plan": answer.status.name.lower(), "why": answer.message}
    toes = answer.solution.toes_m
    heights, surface = truth(*toes[:, :2].T)
    about = [truth(*(toes[:, :2] + step).T)[1] for step in 0.01 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])]
    off = 1e3 * np.abs(toes[:, 2] - heights)
    return {
        "plan": "accepted", "toes_worst_mm": round(float(off.max()), 1), "toes": len(toes),
        "toes_over": int(np.any([other != surface for other in about], axis=0).sum()),
    }  # fmt: skip


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
        i, j = np.floor((x + phase + 2.0) / 0.33).astype(int) % 16, np.floor((y + 2.0) / 0.33).astype(int) % 16
        on = (np.mod(x + phase + 2.0, 0.33) < 0.25) & (np.mod(y + 2.0, 0.33) < 0.25)
        return np.where(on, tops[i, j], -0.25), np.where(on, 1 + 16 * i + j, 0)

    def beams(x: Array, y: Array) -> Truth:
        row, at = np.divmod(y + 2.0 + phase, 0.4)
        on, other = at < 0.15, (at > 0.25) & (at < 0.35)
        number = np.where(on, 1, 2) + 2 * row.astype(int)
        return np.where(on | other, 0.0, -0.25), np.where(on | other, number, 0)

    def rubble(x: Array, y: Array) -> Truth:
        i, j = np.floor((x + phase + 2.0) / 0.4).astype(int) % 16, np.floor((y + 2.0) / 0.4).astype(int) % 16
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
