"""``stancekit bench``: the papers' tables, made again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from .bench_envelopes import BenchEnvelopes
from .bench_gait import BenchGait
from .bench_planner import BenchPlanner
from .bench_room import BenchRoom


@dataclass
class Bench:
    """The papers' tables made again, every method in one run: `stancekit bench WHAT --help` says
    more.
    """

    what: (
        Annotated[BenchEnvelopes, tyro.conf.subcommand("envelopes", prefix_name=False)]
        | Annotated[BenchPlanner, tyro.conf.subcommand("planner", prefix_name=False)]
        | Annotated[BenchRoom, tyro.conf.subcommand("room", prefix_name=False)]
        | Annotated[BenchGait, tyro.conf.subcommand("gait", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the one that was named."""
        return self.what.run()
