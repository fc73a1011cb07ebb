"""The house itself: the wheel is whole, imports never point up, nothing is undocumented, no machine
is named.
"""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from stancekit.planners.errors import install_command, not_installed

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("api", "planners", "runner", "views", "envs", "learners", "cli", "configs")
"""Each is the package of its name, but api, which is the root."""
BESIDE = {"tests", "benchmarks", "docs", "findings", ".ci", ".github"}
KINDS = {"", ".cff", ".md", ".py", ".toml", ".txt"}
"""Endings of the files that lie at the root."""

# Run by an interpreter without site (-I -S), so that no .pth file and hence no editable install
# takes part. gurobipy wants the builtin `help`, which only site provides.
IMPORT_ALL = """
import importlib, json, site, sys
site.sethelper()
wheel, site_packages, names = json.loads(sys.argv[1])
sys.path[:0] = [wheel]
sys.path += site_packages
print(json.dumps({name: importlib.import_module(name).__file__ for name in names}))
"""

# What a reader of the documentation may type, in a folder of their own.
SCRIPT = """
import stancekit

problem = stancekit.sample("wall-3", rng=8)[0]
outcome = stancekit.solve(problem)
assert outcome.certificate is not None
print(stancekit.explain(outcome.certificate).message)
found = stancekit.plan("stairs", frames=3)
assert found.solution is not None
stancekit.save(found.solution, "climb.json")
again = stancekit.load("climb.json", stancekit.Motion)
report = stancekit.verify(again)
print(report.accepted, again.toes_at(0).shape, report.worst + 1.0 < 1.1)
rows = stancekit.label("wall-3", "train", rows=(4, 4))
observation, label = rows[0]
print(sorted(observation), label in (0, 1), stancekit.fit(rows, "quantile", share=0.1).envelopes.legs)
print(stancekit.__version__)
"""
SAID = """infeasible: the cheapest single change is friction of RR, from 0.5653 to at least 0.6986 (+24 %)
True (6, 3) True
['frames', 'friction', 'reach', 'shoulders', 'vertices'] True ('RF', 'RR', 'LM')
0.1.0
"""
# Mistakes that a checker finds only where it sees the types of the package.
WRONG = """
import stancekit

stancekit.solve("wall-3")
stancekit.load("climb.json", stancekit.Motion).toes
stancekit.slove
"""

# Written so that no pattern matches its own text.
NOT_OURS = {
    "a path of one machine": re.compile(r"(?<![\w.}])/(?:work|root|home|opt|Users)/"),
    "a folder beside the project": re.compile(r"\.\./shared\b"),
    "a package host": re.compile(r"\b(?:pypi\.org|pythonhosted\.org|download\.pytorch\.org)"),
}


def project_files() -> list[Path]:
    """Return the files of the project, relative to ROOT: what git would keep, or without git all
    but what is built.
    """
    files = _git_files()
    if files is None:
        files = [
            path.relative_to(ROOT)
            for path in ROOT.rglob("*")
            if not _is_built(path.relative_to(ROOT))
        ]
    return sorted(path for path in files if (ROOT / path).is_file() and not _through_a_link(path))


def modules() -> list[Path]:
    """Return the Python files of the five folders, relative to ROOT."""
    return [path for path in project_files() if path.parts[0] in FOLDERS and path.suffix == ".py"]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean copy of the tree."""
    copy = tmp_path_factory.mktemp("tree")
    for path in project_files():
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, copy / path)
    return copy


@pytest.fixture(scope="module")
def wheel(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built by way of the source distribution, as it is published."""
    dist = tmp_path_factory.mktemp("dist")
    _run(
        [
            sys.executable,
            "-m",
            "build",
            "--sdist",
            "--wheel",
            "--no-isolation",
            "--outdir",
            str(dist),
            str(tree),
        ]
    )
    (packed,), (built,) = dist.glob("*.tar.gz"), dist.glob("*.whl")
    assert packed.stat().st_size > 100_000
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment of its own with the wheel; what it runs on comes from this one."""
    return _environment(tmp_path_factory.mktemp("installed"), str(wheel))


@pytest.fixture(scope="module")
def editable(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment of its own with an editable install."""
    return _environment(
        tmp_path_factory.mktemp("editable"), "--no-build-isolation", "--editable", str(tree)
    )


@pytest.fixture(params=["installed", "editable"])
def environment(request: pytest.FixtureRequest) -> Path:
    """Either of them."""
    return Path(request.getfixturevalue(request.param))


def test_a_script_from_another_folder_finds_the_library(environment: Path, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    assert _run([str(environment / "bin" / "python"), "-I", "script.py"], cwd=tmp_path) == SAID


def test_pyright_sees_the_library_from_another_folder(editable: Path, tmp_path: Path) -> None:
    """A wheel has the same files and markers, which are looked at below."""
    (tmp_path / "script.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text(WRONG)
    command = [
        sys.executable,
        "-m",
        "pyright",
        "--outputjson",
        "--pythonpath",
        str(editable / "bin" / "python"),
    ]
    done = subprocess.run(
        [*command, "."], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    said = json.loads(done.stdout)
    assert said["summary"]["filesAnalyzed"] == 2
    found = [
        (Path(one["file"]).name, one["range"]["start"]["line"])
        for one in said["generalDiagnostics"]
    ]
    assert found == [("wrong.py", 3), ("wrong.py", 4), ("wrong.py", 5)], said
    for word, one in zip(("Problem", "toes", "slove"), said["generalDiagnostics"], strict=True):
        assert word in one["message"]


def test_a_new_file_of_a_room_is_seen_by_an_editable_install(
    tree: Path, editable: Path, tmp_path: Path
) -> None:
    new = tree / "planners" / "terrain" / "just_made.py"
    new.write_text("HERE = 1\n")
    script = "from stancekit.planners.terrain.just_made import HERE; print(HERE)"
    assert _run([str(editable / "bin" / "python"), "-I", "-c", script], cwd=tmp_path) == "1\n"
    new.unlink()


def test_every_module_imports_from_the_installed_wheel(installed: Path, tmp_path: Path) -> None:
    target = _site(installed)
    names = [_module_name(path) for path in modules()]
    question = json.dumps([str(target), _site_packages(), names])
    answer = _run([sys.executable, "-I", "-S", "-c", IMPORT_ALL, question], cwd=tmp_path)
    files = json.loads(answer.splitlines()[-1])
    assert sorted(files) == sorted(names)
    assert [name for name, file in files.items() if not Path(file).is_relative_to(target)] == []
    assert len(files) == len(list((target / "stancekit").rglob("*.py"))) > 10


def test_the_wheel_holds_every_module_data_file_and_type_marker_and_nothing_else(
    wheel: Path,
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    ours = [path for path in project_files() if path.parts[0] in FOLDERS and path.suffix != ".md"]
    assert packed == {f"stancekit/{path.as_posix().removeprefix('api/')}" for path in ours}
    assert {f"stancekit/{folder}/py.typed" for folder in FOLDERS[1:]} | {
        "stancekit/py.typed"
    } <= packed


def test_imports_never_point_up(tmp_path: Path) -> None:
    lint_imports = Path(sys.executable).with_name("lint-imports")
    said = _run(
        [str(lint_imports), "--no-cache", "--config", str(ROOT / "pyproject.toml")],
        env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1"},
        cwd=tmp_path,
    )
    looked_at = re.search(r"Analyzed (\d+) files", said)
    assert looked_at is not None, said
    assert int(looked_at[1]) > 10, said
    assert re.search(r"Contracts: [1-9]\d* kept, 0 broken", said), said


def test_every_module_says_what_it_is_for() -> None:
    looked_at = modules()
    silent = [str(path) for path in looked_at if not ast.get_docstring(parsed(ROOT / path))]
    assert silent == []
    assert len(looked_at) > 10


def test_nothing_that_a_trial_or_a_test_left_lies_at_the_root() -> None:
    files = project_files()
    assert {path.parts[0] for path in files if len(path.parts) > 1} == {*FOLDERS, *BESIDE}
    assert {path.suffix for path in files if len(path.parts) == 1} == KINDS


def test_no_file_names_a_machine_or_a_package_host() -> None:
    found, looked_at = [], 0
    for path in project_files():
        try:
            text = (ROOT / path).read_text("utf-8")
        except UnicodeDecodeError:
            continue  # a picture or an array
        looked_at += 1
        for number, line in enumerate(text.splitlines(), start=1):
            found += [
                f"{path}:{number}: {what}"
                for what, pattern in NOT_OURS.items()
                if pattern.search(line)
            ]
    assert found == []
    assert looked_at > 20


@pytest.mark.parametrize(
    ("start", "rest"),
    [
        ("cd /", "work/main"),
        ("'/", "root/x'"),
        ("file:///", "opt/wheels"),
        ("..", "/shared/a"),
        ("//pypi", ".org/"),
    ],
)
def test_the_guard_sees_what_it_looks_for(start: str, rest: str) -> None:
    assert [bool(pattern.search(start + rest)) for pattern in NOT_OURS.values()].count(True) == 1


def _module_name(path: Path) -> str:
    parts = path.with_suffix("").parts[path.parts[0] == "api" :]
    return ".".join(("stancekit", *(parts[:-1] if parts[-1] == "__init__" else parts)))


def _environment(folder: Path, *install: str) -> Path:
    """A virtual environment with this installed, which sees everything else that this interpreter
    sees.
    """
    venv.create(folder)
    site = _site(folder)
    (site / "others.pth").write_text("\n".join(_site_packages()) + "\n")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--quiet",
        "install",
        "--no-deps",
        "--no-index",
    ]
    _run([*pip, "--target", str(site), *install])
    return folder


def _site_packages() -> list[str]:
    """Where this interpreter finds what is installed; nothing there that a .pth file adds takes
    part.
    """
    return [path for path in sys.path if path.endswith("site-packages")]


def _site(environment: Path) -> Path:
    (found,) = environment.glob("lib/python*/site-packages")
    return found


def _git_files() -> list[Path] | None:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        return None
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "-co", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=False)
    return (
        [Path(name) for name in listed.stdout.split("\0") if name]
        if listed.returncode == 0
        else None
    )


def _is_built(path: Path) -> bool:
    built = {".editable", "build", "dist", "out", "__pycache__"}
    hidden = {
        ".git",
        ".venv",
        ".mypy_cache",
        ".ruff_cache",
        ".pytest_cache",
        ".hypothesis",
        ".import_linter_cache",
    }
    return any(part in built | hidden or part.endswith(".egg-info") for part in path.parts)


def _through_a_link(path: Path) -> bool:
    return any((ROOT / part).is_symlink() for part in (path, *path.parents) if part != Path())


def _run(command: list[str], **options: Any) -> str:
    """Run a command and return what it wrote to standard output; fail with everything it said."""
    done = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options
    )
    assert done.returncode == 0, f"{' '.join(command)[:200]}\n{done.stdout}\n{done.stderr}"
    return str(done.stdout)


@cache
def parsed(path: Path) -> ast.Module:
    """A file's syntax, read once."""
    return ast.parse(path.read_text("utf-8"))


def inline_arguments(tree: ast.Module) -> list[str]:
    """Names of arguments that a docstring describes in its prose, not in a section of their own."""
    names_in_prose = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        if isinstance(node, ast.ClassDef):
            names = {
                each.target.id
                for each in node.body
                if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
            }
        else:
            names = {each.arg for each in [*node.args.args, *node.args.kwonlyargs]}
        prose = re.split(
            r"(?m)^(?:Class a|A)(?:rguments|ttributes):$", ast.get_docstring(node) or ""
        )
        for part in re.findall(r"(?:^|[.;]\s)((?:[a-z_]\w*(?:,\s| and\s))*[a-z_]\w*):\s", prose[0]):
            if all(name in names for name in re.split(r",\s| and\s", part)):
                names_in_prose.append(f"{node.name}: {part}")
    return names_in_prose


def test_arguments_have_a_line_each() -> None:
    inline = 'def f(x):\n    """Double; x: a number."""'
    assert inline_arguments(ast.parse(inline)) == ["f: x"]
    own_line = 'def f(x):\n    """Double.\n\n    Arguments:\n        x: one.\n    """'
    assert not inline_arguments(ast.parse(own_line))
    prose = [
        f"{path}: {each}" for path in modules() for each in inline_arguments(parsed(ROOT / path))
    ]
    assert prose == [], prose


def test_one_function_words_what_is_not_installed() -> None:
    wordings = sorted(
        str(path)
        for path in modules()
        if "pip install " in (ROOT / path).read_text(encoding="utf-8")
    )
    assert wordings == ["planners/errors.py"]
    error = not_installed("stairs.pcd", "pypcd4", ".pcd clouds", "terrain")
    assert str(error) == (
        "stairs.pcd: expected pypcd4 for .pcd clouds, it is not installed: "
        f"{install_command('terrain')}"
    )
