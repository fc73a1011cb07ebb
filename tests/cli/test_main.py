"""`stancekit` itself: help that teaches, one line for a slip of the fingers, and a quick start."""

from __future__ import annotations

import itertools
import json
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from stancekit.cli import console, label
from stancekit.cli.about import DOCUMENTED_S, About
from stancekit.cli.main import commands, run
from stancekit.cli.options import NAMES
from stancekit.planners.equilibrium import yardstick
from stancekit.planners.errors import PlanningFailed, install_command
from stancekit.planners.search.methods import PLANNERS
from stancekit.runner import acceptance

COMMAND = [sys.executable, "-m", "stancekit.cli.main"]
WITH_SUBCOMMANDS = {
    "bench": ("envelopes", "planner", "room", "gait"),
}
PLANS = ["plan", "verify", "simulate", "run", "gait"]
HEAVY = (
    "cvxpy",
    "clarabel",
    "casadi",
    "scipy",
    "sklearn",
    "torch",
    "gymnasium",
    "matplotlib",
    "pyarrow",
    "joblib",
)


@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",)])
def test_help_shows_a_session_and_every_verb(arguments, stancekit):
    ran = stancekit(*arguments)
    assert (ran.code, ran.err) == (0, "")
    assert max(len(line) for line in ran.out.splitlines()) <= 80
    session = re.findall(r"^  stancekit (\w+)", ran.out, re.MULTILINE)
    assert session == ["sample", "solve", "label", "label", "fit", "evaluate", "picture", *PLANS]
    listed = re.findall(r"^  (\w+) +[A-Z]", ran.out, re.MULTILINE)
    assert listed == list(commands())
    assert {"sample", "solve", "verify", "label", "fit", "evaluate", "picture", "demo"} <= set(
        listed
    )


def test_long_work_says_every_ten_seconds_where_it_is_without_a_terminal(capsys, monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    with console.progress("walls [1]") as show:
        for k in range(26):
            now_s[0] = float(k)
            show(k, 26)
    assert capsys.readouterr().err == "walls [1]: 10 of 26, 10 s\nwalls [1]: 20 of 26, 20 s\n"


def test_long_work_that_says_nothing_itself_is_heard_of(capsys, monkeypatch):
    seconds = itertools.count()
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: next(seconds)))
    monkeypatch.setattr(console, "EVERY_S", 0.01)
    said = ""
    with console.progress("walls") as show:
        show(0, 2, "contacts")
        while said.count("contacts, ") < 2:  # a test that hangs has failed
            said += capsys.readouterr().err
            time.sleep(0.005)
    whole = said[: said.rindex("\n") + 1]  # a line may be read before its end
    assert re.fullmatch(r"(walls: \d+ s\n)*(walls: contacts, \d+ s\n)+", whole)
    assert "walls" not in [thread.name for thread in threading.enumerate()]


def options_of(kind):
    """Names of all options, those of a group of its own among them."""
    found = []
    for field in fields(kind):
        group = field.default_factory if is_dataclass(field.default_factory) else None
        if "Positional" not in str(field.type):
            found += [field.name] if group is None else options_of(group)
    return found


@pytest.mark.parametrize("command", sorted(commands()))
def test_every_command_explains_itself(command, stancekit, tmp_path):
    ran = stancekit(command, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith(f"usage: stancekit {command} [-h]")
    assert commands()[command].__doc__.splitlines()[0][:60] in ran.out
    if command in WITH_SUBCOMMANDS:
        assert all(f"• {what}" in ran.out for what in WITH_SUBCOMMANDS[command])
        return
    options = options_of(commands()[command])
    assert options
    for option in options:
        assert re.search(f"--(no-)?{option.replace('_', '-')}[ \n]", ran.out), option
    assert os.listdir(tmp_path) == []


def test_no_line_of_an_options_text_ends_before_it_has_to(stancekit):
    looked_at = 0
    for command in commands():
        rows = [
            line.rstrip()
            for line in stancekit(command, "--help").out.partition("\n options")[2].splitlines()
        ]
        begun = [len(row) - len(row.lstrip()) for row in rows]
        for row, following, left, right in zip(rows, rows[1:], begun, begun[1:], strict=False):
            if left == right > 2:  # both are further lines of one option's text
                looked_at += 1
                assert len(row) + 1 + len(following.split()[0]) > 78, (command, row, following)
    assert looked_at > 100


@pytest.mark.parametrize("registry", sorted(NAMES))
def test_help_lists_the_names_that_there_are(registry):
    module, attribute = registry.split(":")
    known = getattr(import_module(module), attribute)
    group, ours = NAMES[registry]
    if isinstance(known, tuple):  # of the planners, those of postures or of courses
        assert set(known) <= set(PLANNERS.names())
        assert (PLANNERS.group, known) == (group, ours)
    else:
        assert (known.group, known.names()[: len(ours)]) == (group, ours)


def test_the_session_of_the_help_is_one_that_runs(stancekit, write, tmp_path):
    small = {
        "label": ("--feasible", "4", "--infeasible", "4", "--workers", "1"),
        "fit": ("--steps", "1"),
    }
    small |= {"plan": ("--frames", "2"), "simulate": ("--pace", "4"), "run": ("--pace", "4")}
    (tmp_path / "data").mkdir()
    lines = [
        line.split()[1:] for line in stancekit().out.splitlines() if line.startswith("  stancekit ")
    ]
    assert len(lines) == 7 + len(PLANS)
    for words in lines:
        target = words[words.index(">") + 1] if ">" in words else None
        arguments = words[: words.index(">")] if target else words
        ran = stancekit(*arguments, *small.get(arguments[0], ()))
        assert ran.code == 0, (words, ran)
        assert ran.err == "" or words[0] in PLANS, (words, ran)  # long work says how far it is
        if target:
            write(target, ran.out)
    assert (tmp_path / "posture.png").stat().st_size > 10_000


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_the_version_is_one_line(option, stancekit):
    assert re.fullmatch(r"stancekit \d+\.\d+\.\d+\n", stancekit(option).out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("dance",), f"COMMAND: expected one of {', '.join(commands())}, got 'dance'"),
        (("--json",), f"COMMAND: expected one of {', '.join(commands())}, got '--json'"),
        (
            ("sample", "wall-3", "--speed", "3"),
            "--speed: no such option; perhaps --seed; see stancekit sample --help",
        ),
        (
            ("plan", "walls", "--frames", "3", "--frames=4"),
            "--frames: expected once, got it 2 times; see stancekit plan --help",
        ),
        (
            ("sample", "wall-3", "wall-5"),
            "wall-5: expected no further argument here; see stancekit sample --help",
        ),
        (
            ("sample", "wall-3", "--seed", "x"),
            "--seed: expected an integer, got 'x'; see stancekit sample --help",
        ),
        (
            ("plan", "walls", "--frames", "x"),
            "--frames: expected an integer, got 'x'; see stancekit plan --help",
        ),
        (
            ("plan", "walls", "--torque-nm", "x"),
            "--torque-nm: expected a number, got 'x'; see stancekit plan --help",
        ),
        (
            ("plan", "walls", "--frames"),
            "--frames: expected a value after it, got none; see stancekit plan --help",
        ),
        (
            ("gait", "ripple", "--goal", "1,0", "--gait", "trott"),
            "--gait: expected one of bound, gallop, pace, tripod, trot, walk, got 'trott'; see stancekit gait --help",
        ),
        (
            ("sample",),
            "NAME: expected a value for it, got none; see stancekit sample --help",
        ),
    ],
)
@pytest.mark.parametrize("columns", ["30", "80", "200"])
def test_a_slip_is_one_line(arguments, message, columns, refusal, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    assert refusal(*arguments) == message


def test_a_terminal_without_boxes_is_told_the_same():
    plain = {**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    run = subprocess.run([*COMMAND, "fit"], capture_output=True, text=True, env=plain, check=False)
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr.startswith("stancekit: error: --out: expected ")
    assert run.stderr.endswith("; see stancekit fit --help\n")


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (PlanningFailed("no plan\nat all"), 1, "stancekit: failed: no plan at all"),
        (
            OSError(28, "No space left on device"),
            1,
            "stancekit: failed: OSError: [Errno 28] No space left on device",
        ),
        (MemoryError("40 GiB"), 1, "stancekit: failed: MemoryError: 40 GiB"),
        (KeyboardInterrupt(), 130, "stancekit: interrupted"),
    ],
)
def test_what_fails_on_purpose_is_one_line_and_an_exit_code(
    error, code, message, stancekit, monkeypatch
):
    def fail(_):
        raise error

    monkeypatch.setattr(label.Sample, "run", fail)
    monkeypatch.setattr("stancekit.cli.main._close_output", lambda: None)  # it would close pytest's
    ran = stancekit("sample", "wall-3")
    assert (ran.code, ran.out, ran.err) == (code, "", message + "\n")


def test_a_closed_pipe_ends_it_quietly(write, sampled, tmp_path):
    file = write("p.jsonl", *(20 * sampled["wall-3"][:1]))
    for command in (
        ["sample", "wall-3", "--count", "2000"],
        ["solve", str(tmp_path / file), "--json"],
    ):
        run = subprocess.Popen(
            [*COMMAND, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert json.loads(run.stdout.readline())
        run.stdout.close()
        assert (run.stderr.read(), run.wait()) == ("", 0)


def test_with_json_nothing_else_is_on_standard_output(write, sampled, tmp_path):
    file = write("p.jsonl", sampled["wall-3"][0], {"mass_kg": 1.0}, sampled["wall-3"][1])
    command = [*COMMAND, "solve", str(tmp_path / file), "--json"]
    run = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    assert [json.loads(line)["status"] for line in run.stdout.splitlines()] == [
        "feasible",
        "invalid",
        "infeasible",
    ]
    assert run.stderr.count("\n") == 1
    assert run.returncode == 2


def test_it_starts_without_what_only_some_verbs_need():
    code = f"import sys, stancekit.cli.main; print([name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


@pytest.mark.parametrize("command", ["sample wall-3", "terrain stairs:0.5:7"])
def test_drawing_postures_of_the_default_robot_and_terrain_takes_nothing_that_is_slow_to_import(
    command: str,
):
    """Scenes cut from terrains, legs of own robots and their workspaces are what needs scipy."""
    slow = (*HEAVY, "numpy.f2py", "stancekit.planners.robot.robot_file")
    code = (
        f"import sys; from stancekit.cli.main import parse; assert parse({command.split()}).run() == 0\n"
        f"print([name for name in {slow!r} if name in sys.modules and name != 'gymnasium'])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"


def test_a_plan_takes_nothing_that_is_slow_to_import_and_has_no_part_in_it(tmp_path):
    """Joints and bodies are judged by pinocchio and coal, hulls by scipy; planning needs none of
    them. The plan's file is verified without courses, proofs and YAML; a walk is written down
    without maps of its terrain.
    """
    others = ("leap.finder", "robot.mjcf", "search.exact", "search.micp", "problem.course_between")
    slow = (
        *("cvxpy", "matplotlib", "typeguard", "asyncio", "stancekit.cli.gait"),
        *(f"stancekit.planners.{name}" for name in others),
    )
    judges = ("scipy", "numpy.f2py", "pinocchio", "coal")
    code = (
        "import sys; from stancekit.cli.main import parse\n"
        f"command = parse(['plan', 'icy-walls', '--frames', '2', '--out', {str(tmp_path / 'plan.json')!r}])\n"
        "from stancekit.planners.problem.course_file import read_course\n"
        "from stancekit.planners.search.friction_margin import plan_with_reserve\n"
        "assert plan_with_reserve(command._planner(), read_course('icy-walls', frames=2)).solution is not None\n"
        f"assert not set(sys.modules).intersection({judges!r}), 'judges'\n"
        "assert command.run() == 0\n"
        f"assert 'clarabel' in sys.modules; print([name for name in {slow!r} if name in sys.modules])"
    )
    ours = ("problem.course_keys", "search.pieces", "verify.certificate", "verify.explanation")
    again = (
        "import sys; from stancekit.cli.main import parse\n"
        f"assert parse(['verify', {str(tmp_path / 'plan.json')!r}]).run() == 0\n"
        f"unread = ('yaml', 'scipy.ndimage', *('stancekit.planners.' + name for name in {ours!r}))\n"
        "found = [name for name in unread if name in sys.modules]\n"
        "import stancekit.planners.gait.method.portfolio\n"
        "print(found + [name for name in ('scipy.linalg', 'stancekit.planners.warp.conformal') if name in sys.modules])"
    )
    for each in (code, again):
        run = subprocess.run(
            [sys.executable, "-c", each], capture_output=True, text=True, check=True
        )
        assert run.stdout.endswith("[]\n")


ROOT = Path(__file__).parents[2]


def test_it_says_what_is_missing_and_the_command_for_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(yardstick, "yardstick", lambda: 2.0 * DOCUMENTED_S)
    monkeypatch.setattr(acceptance, "extras", lambda: ["viz"])
    monkeypatch.setattr(
        acceptance, "versions", lambda extra: {"numpy": "2.0"} if extra is None else {"mcap": None}
    )
    assert run(About()) == 0
    said = capsys.readouterr().out
    assert f"viz        {install_command('viz')}  (without mcap)" in said
    assert "CPU-s, 2.00 times the" in said


def test_with_json_it_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(About(measure=False, json=True)) == 0
    (line,) = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert found["solves_s"] is None
    assert found["cores"] >= 1
    assert found["documented_s"] == DOCUMENTED_S


def test_the_documentation_has_the_figure_that_computers_are_compared_with() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    (seconds,) = re.findall(r"1,000 cold solves take ([\d.]+) CPU-s", page)
    assert float(seconds) == DOCUMENTED_S


def test_the_issue_template_asks_for_it() -> None:
    assert "stancekit about" in (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug.yaml").read_text(
        encoding="utf-8"
    )
