"""Options whose values are names of a registry: `--help` lists them, those of other packages, too."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import tyro


def named(registry: str, metavar: str = "NAME|FILE.py:NAME") -> Any:
    """What an option is annotated with that takes a name of this registry, given as "module:attribute".

    The registry is imported when help is asked for, and not before.
    """

    def hint(default: str) -> str:
        module, _, attribute = registry.partition(":")
        names = getattr(import_module(module), attribute).names()
        known = [f"default: {default}"] if default else []
        known += [f"one of {', '.join([*names, 'FILE.py:NAME'])}"] if names else []
        return f"({'; '.join(known)})" if known else ""

    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint)


PROJECTION = named("stancekit.planners.projection.project:PROJECTIONS")
DISTRIBUTION = tyro.conf.arg(metavar="NAME")
ROBOT = tyro.conf.arg(metavar="FILE|NAME")
PROPOSERS = tyro.conf.arg(metavar="FILE")
TERRAIN = tyro.conf.arg(metavar="FILE")
