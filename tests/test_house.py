"""The house itself: the wheel is whole, imports never point up, nothing is undocumented, no machine is named."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("planners", "runner", "views", "envs", "learners", "cli", "configs")

# Run by an interpreter without site (-I -S), so that no .pth file and hence no editable install takes part.
# gurobipy wants the builtin `help`, which only site provides.
IMPORT_ALL = """
import importlib, json, site, sys
site.sethelper()
wheel, site_packages, names = json.loads(sys.argv[1])
sys.path[:0] = [wheel]
sys.path += site_packages
print(json.dumps({name: importlib.import_module(name).__file__ for name in names}))
"""

# Written so that no pattern matches its own text.
NOT_OURS = {
    "a path of one machine": re.compile(r"(?<![\w.}])/(?:work|root|home|opt|Users)/"),
    "a folder beside the project": re.compile(r"\.\./shared\b"),
    "a package host": re.compile(r"\b(?:pypi\.org|pythonhosted\.org|download\.pytorch\.org)"),
}


def project_files() -> list[Path]:
    """Return the files of the project, relative to ROOT: what git would keep, or without git all but what is built."""
    files = _git_files()
    if files is None:
        files = [path.relative_to(ROOT) for path in ROOT.rglob("*") if not _is_built(path.relative_to(ROOT))]
    return sorted(path for path in files if (ROOT / path).is_file() and not _through_a_link(path))


def modules() -> list[Path]:
    """Return the Python files of the five folders, relative to ROOT."""
    return [path for path in project_files() if path.parts[0] in FOLDERS and path.suffix == ".py"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a clean copy of the tree."""
    copy, dist = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("dist")
    for path in project_files():
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, copy / path)
    _run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(dist), str(copy)])
    (built,) = dist.glob("*.whl")
    return built


def test_every_module_imports_from_the_installed_wheel(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    _run([*pip, "install", "--no-deps", "--no-index", "--target", str(target), str(wheel)])
    names = [_module_name(path) for path in modules()]
    site_packages = sorted({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
    question = json.dumps([str(target), site_packages, names])
    answer = _run([sys.executable, "-I", "-S", "-c", IMPORT_ALL, question], cwd=tmp_path)
    files = json.loads(answer.splitlines()[-1])
    assert sorted(files) == sorted(names)
    assert [name for name, file in files.items() if not Path(file).is_relative_to(target)] == []
    assert len(files) == len(list((target / "stancekit").rglob("*.py"))) > 10


def test_the_wheel_holds_every_module_data_file_and_type_marker_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    ours = [path for path in project_files() if path.parts[0] in FOLDERS and path.suffix != ".md"]
    assert packed == {f"stancekit/{path.as_posix()}" for path in ours}
    assert {f"stancekit/{folder}/py.typed" for folder in FOLDERS} <= packed


def test_imports_never_point_up(tmp_path: Path) -> None:
    lint_imports = Path(sys.executable).with_name("lint-imports")
    said = _run(
        [str(lint_imports), "--no-cache", "--config", str(ROOT / "pyproject.toml")],
        env={**os.environ, "PYTHONPATH": str(ROOT / "typings"), "COLUMNS": "200", "NO_COLOR": "1"},
        cwd=tmp_path,
    )
    looked_at = re.search(r"Analyzed (\d+) files", said)
    assert looked_at is not None, said
    assert int(looked_at[1]) > 10, said
    assert re.search(r"Contracts: [1-9]\d* kept, 0 broken", said), said


def test_every_module_says_what_it_is_for() -> None:
    looked_at = modules()
    silent = [str(path) for path in looked_at if not ast.get_docstring(ast.parse((ROOT / path).read_text("utf-8")))]
    assert silent == []
    assert len(looked_at) > 10


def test_no_file_names_a_machine_or_a_package_host() -> None:
    found, looked_at = [], 0
    for path in project_files():
        try:
            text = (ROOT / path).read_text("utf-8")
        except UnicodeDecodeError:
            continue  # a picture or an array
        looked_at += 1
        for number, line in enumerate(text.splitlines(), start=1):
            found += [f"{path}:{number}: {what}" for what, pattern in NOT_OURS.items() if pattern.search(line)]
    assert found == []
    assert looked_at > 20


@pytest.mark.parametrize(
    ("start", "rest"),
    [("cd /", "work/main"), ("'/", "root/x'"), ("file:///", "opt/wheels"), ("..", "/shared/a"), ("//pypi", ".org/")],
)
def test_the_guard_sees_what_it_looks_for(start: str, rest: str) -> None:
    assert [bool(pattern.search(start + rest)) for pattern in NOT_OURS.values()].count(True) == 1


def _module_name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(("stancekit", *(parts[:-1] if parts[-1] == "__init__" else parts)))


def _git_files() -> list[Path] | None:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        return None
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "-co", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=False)
    return [Path(name) for name in listed.stdout.split("\0") if name] if listed.returncode == 0 else None


def _is_built(path: Path) -> bool:
    built = {"build", "dist", "out", "__pycache__"}
    hidden = {".git", ".venv", ".mypy_cache", ".ruff_cache", ".pytest_cache", ".hypothesis", ".import_linter_cache"}
    return any(part in built | hidden or part.endswith(".egg-info") for part in path.parts)


def _through_a_link(path: Path) -> bool:
    return any((ROOT / part).is_symlink() for part in (path, *path.parents) if part != Path())


def _run(command: list[str], **options: Any) -> str:
    """Run a command and return what it wrote to standard output; fail with everything it said."""
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options)
    assert done.returncode == 0, f"{' '.join(command)[:200]}\n{done.stdout}\n{done.stderr}"
    return str(done.stdout)
