"""The list of benchmarks/stands: its rows in order, what each asks, and lines of results that
survive a kill.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from _bench import Lines as Lines
from _stand_grounds import Ground, ground

FOLDER = Path(__file__).with_name("stands")
LIST = FOLDER / "list.yaml"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One row of the list.

    Attributes:
        robot: its name in the list.
        kind: of the ground.
        draw: number of the draw.
        source: the robot's name in the catalogue, or its file.
        height_m: of the robot [m].
    """

    robot: str
    kind: str
    draw: int
    source: str
    height_m: float
    numbers: Mapping[str, float]
    full_height_m: float
    seed: tuple[int, ...]

    @property
    def name(self) -> str:
        """The name of its files."""
        return f"{self.robot}-{self.kind}-{self.draw}"

    def ground(self) -> Ground:
        """Draw its ground."""
        return ground(self.kind, self.numbers, self.height_m, self.full_height_m, list(self.seed))


def entries(path: Path = LIST) -> Iterator[Entry]:
    """The rows of a list: all robots on all grounds in the first draw, then in the second."""
    listed = read_list(path)
    for draw in range(listed["draws"]):
        for robot, keys in listed["robots"].items():
            named = path.parent / keys["robot"]
            for index, (kind, numbers) in enumerate(listed["grounds"].items()):
                yield Entry(
                    robot=robot,
                    kind=kind,
                    draw=draw,
                    source=str(named) if named.suffix else keys["robot"],
                    height_m=keys["height_m"],
                    numbers=numbers,
                    full_height_m=listed["full_height_m"],
                    seed=(listed["seed"], index, draw),
                )


def read_list(path: Path = LIST) -> dict[str, Any]:
    """The list as it stands in its file."""
    listed: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return listed
