"""Options whose values are names of a registry: `--help` lists them, those of other packages,
too.
"""

from __future__ import annotations

from typing import Any

import tyro

NAMES = {
    "stancekit.planners.projection.project:PROJECTIONS": (
        "stancekit.projections",
        ("fix-p", "fix-f", "fix-toes", "scp", "nlp", "lift-fix-p"),
    ),
    "stancekit.planners.relaxation.table:RELAXATIONS": (
        "stancekit.relaxations",
        ("p1", "joint", "coned", "lift"),
    ),
    "stancekit.planners.search.methods:METHODS": (
        "stancekit.planners",
        ("exact", "p1", "lift", "two-stage", "nlp", "micp"),
    ),
    "stancekit.planners.search.methods:COURSE_METHODS": (
        "stancekit.planners",
        ("two-stage", "micp", "nlp", "decoupled", "exact"),
    ),
    "stancekit.learners.training.fitting:METHODS": (
        "stancekit.methods",
        (
            "heuristic",
            "quantile",
            "gmm-printed",
            "gmm",
            "ga",
            "gradient",
            "modes",
            "chooser",
            "neural",
            "joint",
            "rl",
        ),
    ),
    "stancekit.learners.selectors.own:SELECTORS": ("stancekit.selectors", ()),
}
"""By registry, or by tuple of our own names: the group of other packages' names, and our own,
for which `--help` would else load solvers and networks (a test holds them to be those that there
are)."""


def named(registry: str, metavar: str = "NAME|FILE.py:NAME") -> Any:
    """Annotation of an option that takes a name of this registry, a key of ``NAMES``."""

    def hint(default: str) -> str:
        from stancekit.planners.plugins import entry_points_of

        group, ours = NAMES[registry]
        others = [point.name for point in entry_points_of(group)]
        names = list(dict.fromkeys([*ours, *others]))
        known = [f"default: {default}"] if default not in ("", "None") else []
        known += [f"one of {', '.join([*names, 'FILE.py:NAME'])}"] if names else []
        return f"({'; '.join(known)})" if known else ""

    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint)


PROJECTION = named("stancekit.planners.projection.project:PROJECTIONS")
DISTRIBUTION = tyro.conf.arg(metavar="NAME")
ROBOT = tyro.conf.arg(metavar="FILE|NAME")
SURROGATE = tyro.conf.arg(metavar="FILE")
TERRAIN = tyro.conf.arg(metavar="FILE")
