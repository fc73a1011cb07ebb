"""Things by name: from a table, from another package's entry point, from a program, and from a
file.
"""

from __future__ import annotations

import multiprocessing
import shutil
import sys
import threading
import time
from dataclasses import is_dataclass
from importlib.metadata import entry_points
from pathlib import Path
from zipfile import ZipFile

import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.plugins import Registry, code_of, entry_points_of
from tests.refusals import refuses

SHAPES = {
    "fraction": "fractions:Fraction",
    "decimal": "decimal:Decimal",
    "gone": "no_such_module:Thing",
}


def numbers() -> Registry[type]:
    """A registry of classes."""
    return Registry(
        "number",
        "test.numbers",
        SHAPES,
        expected="a class",
        accepts=lambda it: isinstance(it, type),
    )


def test_a_name_of_the_table_is_imported_when_it_is_asked_for() -> None:
    from fractions import Fraction

    assert numbers().get("fraction") is Fraction
    assert numbers().names() == ("fraction", "decimal", "gone")


def test_listing_and_taking_one_import_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("plugin_one", "plugin_two"):
        (tmp_path / f"{name}.py").write_text("class Thing: ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry: Registry[type] = Registry(
        "thing", "test.things", {"one": "plugin_one:Thing", "two": "plugin_two:Thing"}
    )
    assert registry.names() == ("one", "two")
    assert not {"plugin_one", "plugin_two"} & set(sys.modules)
    assert registry.get("one").__module__ == "plugin_one"
    assert "plugin_two" not in sys.modules


def test_a_program_registers_a_thing_or_where_it_is() -> None:
    registry = numbers()
    registry.register("mine", int)
    registry.register("yours", "collections:OrderedDict")
    assert registry.get("mine") is int
    assert registry.get("yours").__name__ == "OrderedDict"
    assert registry.names()[-2:] == ("mine", "yours")


def test_another_package_brings_its_own_by_an_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "other_robots-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-robots\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[test.numbers]\nodd = other_robots:Odd\ngone = other_robots:Even\nbroken = other_robots:Missing\n"
    )
    (tmp_path / "other_robots.py").write_text("class Odd(int): ...\nclass Even(int): ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = numbers()
    assert set(registry.names()) == {*SHAPES, "odd", "broken"}
    assert registry.get("odd").__name__ == "Odd"
    with refuses("number gone"):  # the package's own name comes first
        registry.get("gone")
    with refuses("number broken", "Missing"):
        registry.get("broken")


def test_a_file_is_run_once_and_may_define_dataclasses(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from __future__ import annotations\nfrom dataclasses import dataclass\n"
        "@dataclass\nclass Mine:\n    size: float = 1.0\n    class Inner: ...\n"
    )
    registry = numbers()
    mine = registry.get(f"{path}:Mine")
    assert is_dataclass(mine)
    assert registry.get(f"{path}:Mine") is mine
    assert registry.get(f"{path}:Mine.Inner").__qualname__ == "Mine.Inner"


@pytest.mark.parametrize(
    ("content", "name", "said"),
    [
        (None, "Mine", "{path}: expected a file, found nothing there"),
        (
            "x = 1\nclass Yours: ...\n",
            "Mine",
            "{path}: expected 'Mine' in it, found no such name; it defines Yours",
        ),
        ("Mine = 3\n", "Mine", "number {path}:Mine: expected a class, got 3"),
        (
            "import no_such_module\n",
            "Mine",
            "{path}: cannot be run: ModuleNotFoundError: No module named ",
        ),
        ("class Mine\n", "Mine", "{path}: cannot be run: SyntaxError: "),
        (
            "raise SystemError('two\\nlines')\n",
            "Mine",
            "{path}: cannot be run: SystemError: two lines",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(
    content: str | None, name: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.py"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InvalidInput) as caught:
        numbers().get(f"{path}:{name}")
    assert str(caught.value).startswith(said.format(path=path))
    assert "\n" not in str(caught.value)


def test_a_file_that_failed_is_run_again_when_it_was_mended(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("class Mine\n")
    with pytest.raises(InvalidInput):
        numbers().get(f"{path}:Mine")
    path.write_text("class Mine: ...\n")
    assert numbers().get(f"{path}:Mine").__name__ == "Mine"


def test_own_code_is_a_file_and_what_it_imports_from_its_folder_as_it_was_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    package = tmp_path / "own_parts"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "size.py").write_text("from .unit import HALF\n")
    (package / "unit.py").write_text("HALF = 0.5\n")
    (tmp_path / "unused.py").touch()
    own = tmp_path / "own.py"
    own.write_text("import numpy\nfrom own_parts import size\nclass Own: half = size.HALF\n")
    assert numbers().get(f"{own}:Own").half == 0.5  # type: ignore[attr-defined]
    parts = [f"own_parts/{name}.py" for name in ("__init__", "size", "unit")]
    assert list(code_of(f"{own}:Own", "wall-3")) == ["own.py", *parts]
    assert code_of("wall-3") == {}
    (package / "unit.py").write_text("HALF = 0.25\n")
    with refuses("own.py", "own_parts/unit.py"):
        code_of(f"{own}:Own")
    other = tmp_path / "elsewhere"
    shutil.copytree(package, other / "own_parts")
    with refuses("own_parts/size.py"):
        numbers().get(f"{shutil.copy(own, other)}:Own")


def test_a_child_is_forked_off_when_a_file_has_run(tmp_path: Path) -> None:
    path = tmp_path / "slow.py"
    path.write_text(
        f"open({str(path)!r} + '.run', 'x')\nimport time\ntime.sleep(0.3)\nclass Mine: ...\n"
    )
    thread = threading.Thread(target=lambda: numbers().get(f"{path}:Mine"))
    thread.start()
    while not (tmp_path / "slow.py.run").exists():
        time.sleep(0.001)
    child = multiprocessing.get_context("fork").Process(
        target=lambda: numbers().get(f"{path}:Mine")
    )
    child.start()
    child.join(60.0)
    code = child.exitcode
    child.kill()
    thread.join()
    assert code == 0


def test_names_that_nobody_has_are_refused_with_those_that_there_are() -> None:
    with refuses("number"):
        numbers().get("real")
    with refuses("number", "mine.py"):
        numbers().get("mine.py")
    with refuses("number gone"):
        numbers().get("gone")


@pytest.mark.parametrize("suffix", ["dist-info", "egg-info"])
def test_entry_points_are_those_that_python_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    assert not entry_points_of("nobody.has_this")
    assert {point.name for point in entry_points_of("console_scripts")} == {
        point.name for point in entry_points(group="console_scripts")
    }
    info = tmp_path / f"late-1.0.{suffix}"
    info.mkdir()
    metadata = "PKG-INFO" if suffix == "egg-info" else "METADATA"
    (info / metadata).write_text("Metadata-Version: 2.1\nName: late\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[test.late]\nodd = late:Odd\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert [point.value for point in entry_points_of("test.late")] == ["late:Odd"]


def test_packages_that_are_elsewhere_than_in_folders_are_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ZipFile(tmp_path / "zipped.zip", "w") as archive:
        archive.writestr("late-1.0.dist-info/METADATA", "Name: late\nVersion: 1.0\n")
        archive.writestr("late-1.0.dist-info/entry_points.txt", "[test.zipped]\nodd = late:Odd\n")
    monkeypatch.syspath_prepend(tmp_path / "zipped.zip")
    assert [point.name for point in entry_points_of("test.zipped")] == ["odd"]
