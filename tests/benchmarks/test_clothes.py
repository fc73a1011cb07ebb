"""Rows of ``benchmarks/clothes.py``: the same question, written another way, has the same answer."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROWS = {
    "flat": ("stl", "glb", "millimetres", "y up", "cut"),
    "slope20": ("ply", "offset", "twice"),
    "down30": ("off", "rounded", "grid"),
    "ramp25": ("rounded", "grid"),
    "steps": ("twice", "cut", "grid", "times 0.25", "times 4"),
    "wall": ("playground",),
}


@pytest.fixture(scope="module")
def clothes() -> Iterator[ModuleType]:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import clothes

    yield clothes
    sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture(scope="module")
def asked(clothes: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """An answer by the names of a ground and a cloth."""
    grounds = {ground.name: ground for ground in clothes.grounds()}
    ways = {cloth.name: cloth for cloth in (*clothes.CLOTHES, clothes.PLAIN)}

    @cache
    def answer(ground: str, cloth: str) -> Any:
        return ways[cloth].ask(grounds[ground], None, tmp_path_factory.mktemp("ground"))

    def judged(ground: str, cloth: str) -> str:
        plain, dressed = answer(ground, "plain"), answer(ground, cloth)
        return str(clothes.judged(grounds[ground], ways[cloth], plain, dressed))

    return judged


@pytest.mark.parametrize(
    ("ground", "cloth"), [(ground, cloth) for ground, worn in ROWS.items() for cloth in worn]
)
def test_the_same_question_in_other_clothes_has_the_same_answer(
    ground: str, cloth: str, asked: Any
) -> None:
    assert asked(ground, cloth) == "equal"


def test_there_are_twelve_grounds_and_twelve_drawn_robots(
    clothes: ModuleType, tmp_path: Path
) -> None:
    names = [ground.name for ground in clothes.grounds()]
    assert len(names) == len(set(names)) >= 12
    robots = clothes.robots(tmp_path)
    assert sum(name.startswith("drawn") for name in robots) == 12
