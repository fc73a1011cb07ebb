"""Figures of the cells of ``gait_bench``: rates of success, quartiles, and ratios against the
baseline.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from .evaluate import Share
from .gait_bench import METHODS, PAPER

Row = Mapping[str, Any]
BASELINE = "ambient"
"""Baseline of iterations and times: the exact Hessian in the world's coordinates, in the same
run."""
QUARTILES = (25.0, 50.0, 75.0)


def table(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """One record a method and terrain, in the order of ``METHODS`` and of the rows.

    cells; success, verified: shares, each with its Wilson 95 % interval (success_interval,
    verified_interval); left_cone: share of those that succeeded whose feet leave the
    true cone; paper: the success that Pan et al. print for it, if any; capped: how many were cut
    off. verified_cpu_s: quartiles over what the verifier accepts. Quartiles over the cells that
    succeeded: iterations, cpu_s, iteration_s, linear_share (of the CPU time in the solver and its
    linear algebra), peak_g, peak_before_g (of a portfolio's first feasible point), force_rms,
    force_peak, reach_mm, penetration_mm, and outside_cone, the share of standing samples outside
    the cone.
    """
    every = list(rows)
    terrains = list(dict.fromkeys(row["terrain"] for row in every))
    lines: list[dict[str, Any]] = []
    for method in METHODS:
        for terrain in terrains:
            rows_of_method = [
                row for row in every if row["method"] == method and row["terrain"] == terrain
            ]
            if rows_of_method:
                lines.append(_record(method, terrain, rows_of_method))
    return lines


def _record(method: str, terrain: str, rows: Sequence[Row]) -> dict[str, Any]:
    good = [row for row in rows if row["success"]]
    return {
        "method": method,
        "label": METHODS[method].label,
        "terrain": terrain,
        "cells": len(rows),
        "success": _share(row["success"] for row in rows),
        "verified": _share(row["verified"] for row in rows),
        "success_interval": list(Share(hits=len(good), of=len(rows)).interval),
        "verified_interval": list(
            Share(hits=sum(row["verified"] for row in rows), of=len(rows)).interval
        ),
        "left_cone": _share(
            row["outside_cone"] > 0.0 for row in good if row.get("outside_cone") is not None
        ),
        "paper": PAPER.get(method, {}).get(terrain),
        "capped": sum(bool(row.get("capped")) for row in rows),
        "refused": _counted(group for row in good for group in row.get("refused", ())),
        **{name: quartiles([read(row) for row in good]) for name, read in MEASURES.items()},
        "verified_cpu_s": quartiles([row.get("cpu_s") for row in rows if row["verified"]]),
    }


def _of(name: str, scale: float = 1.0) -> Callable[[Row], float | None]:
    return lambda row: None if row.get(name) is None else scale * float(row[name])


def _before(row: Row) -> float | None:
    return row["before"]["peak_acceleration_g"] if row.get("before") else None


def _shares(row: Row) -> float | None:
    return row["linear_s"] / row["cpu_s"] if row.get("cpu_s") else None


def _iteration(row: Row) -> float | None:
    steps = (
        sum(row["phase_iterations"].values())
        if "phase_iterations" in row
        else row.get("iterations", 0)
    )
    return row["cpu_s"] / steps if steps else None


MEASURES: Mapping[str, Callable[[Row], float | None]] = {
    "iterations": _of("iterations"),
    "cpu_s": _of("cpu_s"),
    "iteration_s": _iteration,
    "linear_share": _shares,
    "peak_g": _of("peak_acceleration_g"),
    "peak_before_g": _before,
    "force_rms": _of("force_rms"),
    "force_peak": _of("force_peak"),
    "reach_mm": _of("reach", 1e3),
    "penetration_mm": _of("penetration", 1e3),
    "outside_cone": _of("outside_cone"),
    "friction_needed": _of("friction_needed"),
}


def quartiles(values: Iterable[float | None]) -> list[float] | None:
    """25, 50 and 75 % of what is there; None of nothing."""
    known = [value for value in values if value is not None]
    return [float(value) for value in np.percentile(known, QUARTILES)] if known else None


def ratios(
    rows: Iterable[Row], method: str, name: str = "iterations", against: str = BASELINE
) -> dict[str, float]:
    """Ratios by terrain: the median of a measure over the median of ``against``, on the cells in
    which both succeeded.

    Terrains without such a cell are missing.
    """
    cells = {
        (row["terrain"], row["task"], row["seed"], row["method"]): row
        for row in rows
        if row["success"]
    }
    pairs: dict[str, list[tuple[float, float]]] = {}
    for (terrain, task, seed, name_of_method), row in cells.items():
        other = cells.get((terrain, task, seed, against))
        if name_of_method == method and other is not None:
            pairs.setdefault(terrain, []).append((float(row[name]), float(other[name])))
    medians = {
        terrain: np.median(np.array(cells_of_pair), axis=0)
        for terrain, cells_of_pair in pairs.items()
    }
    return {
        terrain: float(name_of_method / max(theirs, 1e-9))
        for terrain, (name_of_method, theirs) in medians.items()
    }


def _share(flags: Iterable[bool]) -> float | None:
    """Share of true flags; None without flags."""
    values = list(flags)
    return sum(values) / len(values) if values else None


def _counted(names: Iterable[str]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for name in names:
        counts[name] = counts.get(name, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: -item[1]))
