"""The methods of Pan et al.'s benchmarks, and its own figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from stancekit.planners.gait.charts import CHARTS


@dataclass(frozen=True, kw_only=True)
class GaitMethod:
    """A way to solve.

    Arguments:
        settings: those of ``GaitSettings`` that it sets.
        portfolio: the product, with all phases.
    """

    label: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    portfolio: bool = False


_PAPER = {"dynamics": "printed", "trunk_clearance_m": None}

_KNOWN: Mapping[str, GaitMethod] = {
    "ambient": GaitMethod(label="baseline: ambient, PCDM", settings={"chart": "ambient", **_PAPER}),
    "warped": GaitMethod(label="warped, as published", settings={"chart": "warped", **_PAPER}),
    "decoupled": GaitMethod(label="ours: decoupled, centred", settings={"chart": "decoupled"}),
    "portfolio": GaitMethod(label="ours: portfolio, smoothed", portfolio=True),
    "warped-exact": GaitMethod(
        label="ours: warped-exact, centred", settings={"chart": "warped-exact"}
    ),
    "shear": GaitMethod(label="shear, centred", settings={"chart": "shear"}),
    "ambient-centred": GaitMethod(label="ambient, centred", settings={"chart": "ambient"}),
    "ambient-lbfgs": GaitMethod(
        label="baseline, L-BFGS", settings={"chart": "ambient", "hessian": "lbfgs", **_PAPER}
    ),
    "warped-lbfgs": GaitMethod(
        label="warped, as published, L-BFGS",
        settings={"chart": "warped", "hessian": "lbfgs", **_PAPER},
    ),
    "decoupled-lbfgs": GaitMethod(
        label="ours: decoupled, L-BFGS", settings={"chart": "decoupled", "hessian": "lbfgs"}
    ),
}

METHODS: Mapping[str, GaitMethod] = {
    **_KNOWN,
    **{
        chart: GaitMethod(label=f"{chart}, centred", settings={"chart": chart})
        for chart in CHARTS.names()
        if chart not in _KNOWN
    },
}
"""By name, and every further chart by its own. The paper's own methods have its dynamics and no
term for the trunk."""

PAPER: Mapping[str, Mapping[str, float]] = {
    "ambient-lbfgs": {"ripple": 0.48, "cone": 0.0, "hill": 0.0, "pit": 0.0},
    "warped-lbfgs": {"ripple": 0.92, "cone": 1.0, "hill": 1.0, "pit": 0.13},
}
"""Success of Pan et al.'s Table I (Knitro, 200 iterations)."""
