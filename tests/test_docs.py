"""What the documents show is true: their Python and commands run, their problem is solved, their
tables are whole.
"""

import importlib
import inspect
import io
import json
import os
import re
import runpy
import shlex
import sys
import tomllib
from collections.abc import Iterator
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from types import ModuleType

import matplotlib.pyplot as plt
import pytest
import yaml

from stancekit.cli.main import COMMANDS as KNOWN, main, parse
from stancekit.planners.answer.answer import Status
from stancekit.planners.problem import Problem
from stancekit.planners.search.exact import Exact
from stancekit.planners.verify import check_plan

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
BLOCK = re.compile(r"(?:<!-- file: (\S+) -->\n)?```(\w+)\n(.*?)```", re.DOTALL)
PAGES = [
    "README.md",
    *sorted(path.relative_to(ROOT).as_posix() for path in DOCS.rglob("[!A-Z]*.md")),
]
FIRST = ("README.md", "docs/index.md")
"""Pages whose one example is shown with what it prints."""
COMMANDS = ("docs/quickstart.md", "docs/selectors.md", "docs/scale-out.md")
"""Pages all of whose commands are run; what takes minutes stands on others."""
WRITES = ("docs/learning-own-robot.md", "docs/selectors.md", "docs/running-on-a-robot.md")
"""Pages whose Python writes files, and prints nothing."""
BEFORE = {"docs/running-on-a-robot.md": ["plan desk.yaml --out desk.json"]}
"""Commands of a page that its Python needs."""
FEW = "12"
"""Scenes of a page that learns; its reader has more."""
NEEDS = {
    "docs/contact-sequences.md": "pinocchio",
    "docs/training.md": "sb3_contrib optuna",
    "docs/learning.md": "torch",
    "docs/running-on-a-robot.md": "pinocchio",
    "docs/posture.md": "pinocchio",
    "docs/learning-own-robot.md": "trimesh",
    "03_own_robot": "pinocchio",
    "04_own_terrain": "trimesh",
    "09_train": "stable_baselines3",
    "10_run_and_export": "mujoco",
}

PAGE_OF_TWO = """# Page
```sh
echo > shared.png
```
## First
<!-- file: one.yaml -->
```yaml
a: 1
```
```sh
cat one.yaml > one.png
```
## Second
```sh
cat shared.png > two.png
```
"""
"""Of a gallery: a heading that is not asked for is not made; what all need is."""


def blocks(page: str) -> list[tuple[str, str, str]]:
    """File, language and text of a page's blocks."""
    return BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))


def shown(page: str) -> list[str]:
    """Languages on a page."""
    return [language for _, language, _ in blocks(page)]


def command(line: str) -> None:
    """A line of a page, as a shell has it; it has to end with 0."""
    words = shlex.split(line, comments=True)
    words, target = (words[: words.index(">")], words[-1]) if ">" in words else (words, None)
    box = io.StringIO()
    with (
        nullcontext() if target is None else redirect_stdout(box),
        pytest.raises(SystemExit) as stop,
    ):
        main(words[1:])
    assert stop.value.code == 0, line
    if target is not None:
        Path(target).write_text(box.getvalue(), encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty one, in which the test is; figures that were left open are closed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    yield tmp_path
    plt.close("all")


def written(page: str) -> None:
    """The files that a page shows, written."""
    for name, _, text in blocks(page):
        if name:
            Path(name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    "page", [page for page in PAGES if "python" in shown(page) and page not in FIRST]
)
def test_python_of_a_page_runs_block_after_block(
    page: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in NEEDS.get(page, "numpy").split():
        pytest.importorskip(module)
    monkeypatch.setenv("SCENES", FEW)
    written(page)
    for line in BEFORE.get(page, []):
        command(f"stancekit {line}")
    capsys.readouterr()
    names: dict[str, object] = {}
    for _, language, text in blocks(page):
        if language == "python":
            exec(compile(text, page, "exec"), names)
    assert capsys.readouterr().out.strip() or page in WRITES


@pytest.mark.parametrize("page", FIRST)
def test_what_a_first_page_says_is_printed_is_printed(
    page: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,), (said,) = (
        [text for _, is_, text in blocks(page) if is_ == language]
        for language in ("python", "text")
    )
    assert len([line for line in code.splitlines() if line]) <= 15
    exec(compile(code, page, "exec"), {})
    assert capsys.readouterr().out == said


@pytest.mark.parametrize("page", COMMANDS)
def test_commands_of_a_page_run_line_after_line(page: str, folder: Path) -> None:
    written(page)
    lines = [
        line for _, language, text in blocks(page) if language == "sh" for line in text.splitlines()
    ]
    ours = [line for line in lines if line.startswith("stancekit ")]
    assert len(ours) >= 3
    for line in ours:
        command(line)


@pytest.mark.parametrize(
    "path", sorted((DOCS / "examples").glob("plot_*.py")), ids=lambda path: path.stem
)
def test_an_example_runs_and_draws(
    path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip(NEEDS.get(path.stem.removeprefix("plot_"), "numpy"))
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    exec(compile(text, path.name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out.strip()
    assert list(folder.glob("*.png"))


def test_the_training_loop_of_the_learning_page_is_short() -> None:
    (code,) = (text for _, language, text in blocks("docs/learning.md") if language == "python")
    loop = code.partition("def learned")[2].partition("# try it")[0]
    assert 5 < len([line for line in loop.splitlines() if line.strip()]) <= 22


def test_the_readme_shows_python_and_commands() -> None:
    languages = shown("README.md")
    assert languages.count("python") >= 1
    assert languages.count("sh") >= 1


def test_the_problem_in_the_formats_page_is_one_that_the_planner_reads_and_answers() -> None:
    examples = [
        json.loads(text) for _, language, text in blocks("docs/formats.md") if language == "json"
    ]
    assert examples
    for example in examples:
        problem = Problem.from_json(example)
        outcome = Exact().solve(problem)
        assert outcome.status is not Status.UNDECIDED
        assert outcome.solution is None or check_plan(outcome.solution).accepted


def test_every_command_on_a_page_is_one_that_there_is() -> None:

    texts = [text for page in PAGES for _, language, text in blocks(page) if language == "sh"]
    lines = [line for text in texts for line in text.splitlines()]
    commands = {line.split()[1] for line in lines if line.startswith("stancekit ")}
    assert len(commands) >= 12
    assert commands <= set(KNOWN)


TABLE = re.compile(r"^(.*)\n\|.*\n\|[-:| ]+\|\n((?:\|.*\n)+)", re.MULTILINE)
"""The line above a table, and its rows."""
DIGITS = 0.08
"""Share of digits in the rows of a table of measured figures; tables of words have less."""
IN_WORDS = ("docs/reference", "docs/decisions", "docs/environments", "docs/benchmarks.md")
"""Pages whose tables say what there is, or are written with the page."""


def test_every_table_of_figures_names_a_command_that_there_is_and_its_options() -> None:

    commands, unmarked = list[str](), list[str]()
    for page in PAGES:
        if page.startswith(IN_WORDS):
            continue
        for above, rows in TABLE.findall((ROOT / page).read_text(encoding="utf-8")):
            mark = re.fullmatch(r"<!-- (?:table|figures): (.+) -->", above)
            if mark:
                commands.append(mark[1])
            elif len(re.findall(r"\d", rows)) > DIGITS * len(rows):
                unmarked.append(f"{page}: {rows[:60]}")
    assert unmarked == []
    assert len(commands) > 40
    for line in commands:
        program, *words = shlex.split(line)
        if program == "stancekit":
            assert words[0] in KNOWN, line
            if not any(word.isupper() for word in words):
                parse(words)
            continue
        text = (ROOT / words[0]).read_text(encoding="utf-8")
        text += (ROOT / "benchmarks/_bench.py").read_text(encoding="utf-8")
        for option in (word for word in words if word.startswith("--")):
            name = option[2:].removeprefix("no-").replace("-", "_")
            assert re.search(rf"^    {name}: |\"{option}\"", text, re.MULTILINE), line


def test_tables_that_a_command_prints_are_what_it_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    tables, printed, kept = importlib.import_module("tables"), 0, set[Path]()
    for page in PAGES:
        for kind, line, table in tables.MARK.findall((ROOT / page).read_text(encoding="utf-8")):
            if kind == "figures":
                assert "--kept" not in line, line
                continue
            _, *options = shlex.split(line)
            assert "--cards" in options or "--kept" in options, f"{line}: measures"
            if "--kept" in options:
                source = options[options.index("--kept") + 1]
                assert (ROOT / source).exists(), f"{line}: measures"
                kept.add(ROOT / source)
            assert table == tables.printed(line), line
            printed += 1
    assert printed >= 3
    assert kept == set((DOCS / "results").iterdir())


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch) -> object:
    """A module of docs/extensions by its name."""
    monkeypatch.syspath_prepend(str(DOCS / "extensions"))

    def found(name: str) -> ModuleType:
        return importlib.import_module(name)

    return found


def test_every_key_of_every_file_has_a_meaning_and_every_model_is_in_the_reference(
    extension,
) -> None:
    keys = extension("keys")
    assert len(keys.forbidding()) > 40
    assert list(keys.missing()) == []
    page = keys.page()
    assert "| **`frames`** | integer ≥ 1, ≤ 1000 |  | number of key frames M |" in page
    assert "| `friction` | number ≥ 0, ≤ 10 | `1.0` | Coulomb's μ, 0 is ice |" in page


def test_what_a_docstring_says_of_keys_is_read_off_it(extension) -> None:
    docstring = """A thing, of use: never.

    Arguments:
        near, far: how
            far [m].
        tall: how tall, that is: up.
        other: of no key.

    Raises:
        InvalidInput: always.
    """
    assert extension("keys").own_meanings(inspect.cleandoc(docstring), {"near", "far", "tall"}) == {
        "near": "how far [m]",
        "far": "how far [m]",
        "tall": "how tall, that is: up",
    }


def test_an_environments_page_has_its_spaces_reward_and_weights(extension) -> None:
    page = extension("environments").page("stancekit/EnvelopeSelection-v0")
    assert "| Action space | `Box(-1.0, 1.0, (36,), float32)` |" in page
    assert r"w_\text{agreement}" in page
    assert "| agreement | 1 |" in page
    assert re.findall(r"^## (.*)$", page, re.M)[0] == "Description"


def test_pages_that_follow_from_the_code_are_in_the_repository_as_make_docs_writes_them(
    extension,
) -> None:
    environments, keys = extension("environments"), extension("keys")
    pages = {
        f"environments/{environments.short(name)}.md": environments.page(name)
        for name in environments.names()
    }
    for name, page in {**pages, "reference/keys.md": keys.page()}.items():
        assert (ROOT / "docs" / name).read_text(encoding="utf-8") == page, (
            f"docs/{name}: make docs writes it anew"
        )
        anchors = re.findall(r"^\((.*)\)=$", page, re.M)
        assert len(anchors) == len(set(anchors)), (
            f"docs/{name}: two places of one name, which Sphinx refuses"
        )
    commands = re.findall(
        r"^## (.*)$", (ROOT / "docs" / "reference" / "command.md").read_text(encoding="utf-8"), re.M
    )
    assert commands == re.findall(r"^## (.*)$", extension("commands").page(), re.M)


def test_every_link_of_a_page_leads_to_a_file_of_the_repository() -> None:
    """But for pages of examples, which are built of ``docs/examples`` when they run."""
    pages = [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs").glob("[a-z]*/*.md"),
    ]
    found = [
        (page, link)
        for page in pages
        for link in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
        if "://" not in link and not link.startswith(("mailto:", "auto_examples/"))
    ]
    assert len(found) > 100
    assert [
        f"{page.relative_to(ROOT)}: {link}"
        for page, link in found
        if not (page.parent / link).exists()
    ] == []


def test_every_script_that_measures_is_on_the_page_of_benchmarks(extension) -> None:
    briefs = extension("scripts").briefs()
    assert len(briefs) > 30
    assert [name for name, (brief, _) in briefs.items() if not brief] == []


def test_what_the_gallery_shows_is_there_and_made_by_a_command_on_its_page() -> None:
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"(?:_static|gallery)/([\w.-]+)", text))
    made = {
        name
        for _, language, block in blocks("docs/gallery.md")
        if language == "sh"
        for name in block.split()
    }
    assert len(shown) >= 10
    assert shown == {path.name for path in (DOCS / "gallery").iterdir()}
    assert shown <= made
    assert sum(path.stat().st_size for path in (DOCS / "gallery").iterdir()) < 8_000_000


def test_the_gallery_is_made_by_the_commands_of_its_page(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    gallery = importlib.import_module("gallery")
    Path("page.md").write_text(PAGE_OF_TWO, encoding="utf-8")
    for name, place in (("PAGE", "page.md"), ("FOLDER", "shown"), ("WORK", "work")):
        monkeypatch.setattr(gallery, name, Path(place))
    assert gallery.main(["Second"]) == 0
    assert sorted(path.name for path in Path("shown").iterdir()) == ["shared.png", "two.png"]
    assert gallery.main(["Third"]) == 2
    assert gallery.main([]) == 0
    assert (Path("shown") / "one.png").read_text(encoding="utf-8") == "a: 1\n"
    assert not (Path("shown") / "one.yaml").exists()


def test_the_citation_has_both_papers_and_the_version_of_the_package() -> None:
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert found["cff-version"] == "1.2.0"
    assert (found["version"], found["license"]) == (project["version"], project["license"])
    assert [(paper["year"], len(paper["authors"])) for paper in found["references"]] == [
        (2021, 3),
        (2022, 6),
    ]


def test_an_extra_that_a_message_or_a_page_names_is_one_that_can_be_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    folders = ("api", "cli", "docs", "envs", "learners", "planners", "runner", "views")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.[pm][yd]")]
    named = [
        name
        for path in files
        for pattern in (
            r"stancekit\[([\w,]+)\]",
            r"installed\((?:[^()]|\([^()]*\))*\"(\w+)\"\s*\)",
        )
        for name in re.findall(pattern, path.read_text(encoding="utf-8"))
    ]
    assert len(named) > 20
    assert {extra for names in named for extra in names.split(",")} <= set(
        project["optional-dependencies"]
    )


def test_what_hosted_checks_run_is_a_target_here() -> None:
    targets = re.findall(r"^([a-z]+):.*## ", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yaml").read_text(encoding="utf-8"))[
        "jobs"
    ]
    runs = [
        step["run"].split()
        for job in jobs.values()
        for step in job["steps"]
        if "make" in step.get("run", "")
    ]
    assert {words[1] for words in runs} == {"test", "docs", "smoke"} <= set(targets)
    assert jobs["test"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]


def test_every_equation_and_algorithm_is_on_a_page_of_concepts(extension) -> None:
    sys.path.insert(0, str(DOCS))
    try:
        equations = importlib.import_module("equations")
    finally:
        sys.path.remove(str(DOCS))
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "concepts").glob("*.md"))
    tied = {
        name.strip() for names in re.findall(r"```\{tied\} (.*)", text) for name in names.split(",")
    }
    assert tied == set(equations.EQUATIONS)


def test_every_picture_of_the_pages_has_the_command_that_draws_it_and_one_older_than_the_code_is_drawn_anew(
    extension, tmp_path: Path
) -> None:
    pictures = extension("pictures")
    kept = {path.name for path in (DOCS / "images").iterdir()}
    films = {name for name in kept if name.endswith(".webp")}
    assert pictures.PICTURES.keys() | pictures.STUDIES.keys() == kept - films
    assert all(name.removesuffix(".webp") in (DOCS / "gallery.py").read_text() for name in films)
    pages = (page for page in DOCS.rglob("*.md") if "_build" not in page.parts)
    shown = {
        name for page in pages for name in re.findall(r"images/([\w-]+\.png)", page.read_text())
    }
    assert shown == pictures.PICTURES.keys() | pictures.STUDIES.keys()
    drawn = tmp_path / "gait.png"
    assert pictures.stale("gait.png", tmp_path)
    drawn.write_bytes(b"")
    assert not pictures.stale("gait.png", tmp_path)
    os.utime(drawn, (0, 0))
    assert pictures.stale("gait.png", tmp_path)


def test_what_is_tried_of_a_wheel_works() -> None:
    exec(runpy.run_path(str(DOCS.parent / ".ci" / "smoke.py"))["LIBRARY"], {})


def test_guides_name_files_that_are_there() -> None:
    root = DOCS.parent
    for folder in ("cli", "envs", "learners", "planners", "runner", "views"):
        for guide in (root / folder).rglob("__init__.py"):
            order = re.search(r"\bRead (``.*?)\"\"\"", guide.read_text(), re.DOTALL)
            for name in re.findall(r"``(\w+)``", order.group(1)) if order else ():
                assert list(guide.parent.glob(f"{name}*")), f"{guide}: {name}"
    rows = re.findall(
        r"^\|[^|]+\| `([\w/]+/)` \| (?:`\w+` of )?`([\w./]+\.py)`( there)? \|",
        (DOCS / "CONTRIBUTING.md").read_text(),
        re.MULTILINE,
    )
    assert len(rows) > 8
    assert all((root / (folder if there else "") / file).exists() for folder, file, there in rows)
