"""What `import stancekit` gives: names that come when asked for, each with a docstring that is
enough to use it.
"""

import ast
import doctest
import inspect
import json
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

import stancekit
from tests.refusals import refuses

NAMES = sorted(name for name in dir(stancekit) if not name.startswith("_"))
FUNCTIONS = (
    "draw",
    "evaluate",
    "explain",
    "export",
    "film",
    "fit",
    "label",
    "load",
    "plan",
    "robot",
    "run",
    "sample",
    "save",
    "simulate",
    "solve",
    "terrain",
    "verify",
    "walk",
)

IMPORTED = """
import json, sys
before = set(sys.modules)
import stancekit
loaded = sorted(set(sys.modules) - before)
names = dir(stancekit)
print(json.dumps([loaded, len(set(sys.modules) - before), len(names)]))
"""


def test_the_import_loads_nothing_that_takes_time():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True
    )
    loaded, after_names, names = json.loads(done.stdout)
    others = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names)
    assert (others, names > 20) == ({"stancekit"}, True)
    assert len(loaded) == after_names < 40  # a solver has hundreds


def test_only_what_a_name_needs_is_loaded():
    script = "import stancekit, sys; stancekit.Problem, stancekit.solve, stancekit.plan\n" + (
        "print([name for name in ('torch', 'casadi', 'cvxpy', 'gymnasium', 'mujoco') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


def test_type_checkers_are_told_the_same_names_from_the_same_homes():
    tree = ast.parse(Path(inspect.getfile(stancekit)).read_text("utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    message = {
        alias.asname: node.module
        for node in guarded.body
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
        if alias.asname == alias.name
    }
    assert message == stancekit._HOME
    assert len(message) > 20


def test_the_verbs_are_there_and_a_wrong_name_is_an_attribute_error():
    assert set(FUNCTIONS) <= set(NAMES)
    assert stancekit.__version__.count(".") == 2
    with refuses("stancekit", "slove", kind=AttributeError):
        _ = stancekit.slove


@pytest.mark.parametrize("name", NAMES)
def test_a_docstring_names_every_argument_and_its_source(name):
    thing = getattr(stancekit, name)
    text = inspect.getdoc(thing) or ""
    assert "Source:\n" in text
    if inspect.isfunction(thing):
        wanted = [*inspect.signature(thing).parameters]
        assert "Returns:\n" in text or name == "save"
        assert "Raises:\n" in text or not wanted
    else:
        named = [field.name for field in fields(thing)] if is_dataclass(thing) else []
        wanted = [argument for argument in named if not argument.startswith("_")]
    assert [argument for argument in wanted if argument not in text] == []
    assert "Arguments:\n" in text or not wanted


@pytest.mark.parametrize("name", [*NAMES, "stancekit"])
def test_the_example_in_a_docstring_does_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = stancekit if name == "stancekit" else getattr(stancekit, name)
    (test,) = doctest.DocTestFinder(recurse=False).find(thing, name, module=False, globs={})
    assert test.examples
    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(test, out=report.append, clear_globs=False)
    assert runner.failures == 0, "".join(report)
