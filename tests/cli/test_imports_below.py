"""A command parses, calls `api/` and prints: what it imports from below, and why it may.

Types under TYPE_CHECKING, errors, and the checks of numbers, names and files in ``planners.files``
are free. What else a file imports is listed here with its reason; a file that imports more fails,
and one that no longer needs to, too.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import stancekit.cli

FOLDER = Path(stancekit.cli.__file__).parent
BELOW = ("planners", "runner", "views", "envs", "learners")
FREE = ("planners.errors", "planners.files.")
DRAWS, CHOICES, TOOL, LATER = (
    "pictures, films and pages that only a command has",
    "names and limits that an option is checked against",
    "something of its own that the library has no function for",
    "still turns options into values itself",
)
MAY: dict[str, dict[str, tuple[str, ...]]] = {
    "about": {TOOL: ("runner.acceptance",)},
    "bench": {
        TOOL: (
            "learners.data.executors",
            "learners.evaluation",
            "learners.evaluation.bench",
            "learners.evaluation.evaluate",
            "learners.evaluation.planner_bench",
            "learners.evaluation.room",
            "learners.zoo",
        ),
        DRAWS: (
            "views.comparison",
            "views.sheet",
        ),
    },
    "bench_gait": {
        TOOL: (
            "learners.evaluation",
            "learners.evaluation.gait_bench",
        )
    },
    "demo": {
        TOOL: (
            "planners.robot.urdf_reader",
            "planners.terrain.facets",
            "runner.worlds.mujoco",
            "views.page",
        )
    },
    "evaluate": {
        CHOICES: ("planners.projection.project",),
        TOOL: (
            "learners.evaluation.bench",
            "learners.evaluation.evaluate",
        ),
    },
    "export": {TOOL: ("learners.data.export",)},
    "gait": {
        CHOICES: ("planners.gait.charts",),
        LATER: ("planners.formats.trajectory_file",),
        DRAWS: ("views.sheet",),
    },
    "gait_answer": {
        TOOL: ("planners.verify.trajectory_measurements",),
        DRAWS: (
            "planners.gait.charts.warped",
            "views.gaits",
            "views.page",
            "views.sheet",
            "views.video",
        ),
    },
    "main": {TOOL: ("planners.plugins",)},
    "map": {
        DRAWS: (
            "views.maps",
            "views.sheet",
        )
    },
    "options": {
        TOOL: ("planners.plugins",),
        CHOICES: ("planners.search.methods",),
        DRAWS: (
            "views.film",
            "views.page",
            "views.sheet",
        ),
        LATER: (
            "planners.terrain.footholds",
            "planners.terrain.import_options",
        ),
    },
    "plan": {
        CHOICES: (
            "planners.answer.certificate",
            "planners.answer.plan",
            "planners.answer.report",
            "planners.leap.finder",
            "planners.leap.scp",
            "planners.problem.leap",
            "planners.relaxation.relaxed",
            "planners.search.methods",
        ),
        LATER: (
            "learners.leaps.policy",
            "planners.formats.leap_file",
            "planners.formats.plan_file",
            "planners.projection.whole_body",
            "planners.search.answer",
            "planners.verify",
        ),
    },
    "play": {
        CHOICES: (
            "planners.terrain.families",
            "planners.terrain.import_options",
            "planners.terrain.reference",
        ),
        TOOL: (
            "views.playground.keys_scenario",
            "views.playground.scenario",
            "views.playground.serving",
        ),
    },
    "replay": {
        TOOL: ("runner.log",),
        DRAWS: (
            "views.gait_plot",
            "views.sheet",
        ),
    },
    "robot": {
        TOOL: (
            "planners.robot.catalogue",
            "planners.robot.robot_file",
            "planners.robot.robot_model",
            "planners.robot.workspace",
        ),
        DRAWS: (
            "planners.robot.meshes",
            "views.links",
            "views.sheet",
            "views.still",
        ),
    },
    "run": {
        LATER: (
            "planners.motion.plan_motion",
            "planners.robot.actuators",
            "runner.acceptance",
            "runner.control.loop_settings",
            "runner.report",
            "runner.settings",
            "runner.worlds",
        ),
        TOOL: (
            "runner.log",
            "runner.safety.estop",
            "runner.safety.stop_topic",
        ),
        DRAWS: (
            "views.gait_plot",
            "views.sheet",
        ),
    },
    "simulate": {
        LATER: (
            "planners.motion.plan_motion",
            "runner.settings",
            "runner.worlds",
        )
    },
    "solve": {
        CHOICES: (
            "planners.problem.course_file",
            "planners.search.methods",
            "planners.terrain.import_options",
            "planners.terrain.reference",
        ),
        LATER: (
            "planners.problem.alternatives",
            "planners.problem.course_between",
            "planners.problem.terrain_spec",
            "planners.robot.reach_sets",
            "planners.robot.robot_file",
            "planners.terrain.footholds",
        ),
    },
    "terrain": {
        DRAWS: (
            "views.page",
            "views.sheet",
            "views.terrain",
        )
    },
    "train": {
        TOOL: (
            "learners.training.reinforce",
            "learners.training.train_config",
        )
    },
    "verify": {CHOICES: ("envs.data.ledger",)},
    "warp": {
        DRAWS: (
            "views.maps",
            "views.sheet",
        )
    },
}
"""By file and reason: the modules that are imported."""


def imported(path: Path) -> set[str]:
    """The modules from below `api/` that a file imports when it runs, without those that are
    free.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typed = {
        id(inside)
        for node in ast.walk(tree)
        if isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
        for inside in ast.walk(node)
    }
    found = set[str]()
    for node in ast.walk(tree):
        if id(node) in typed:
            continue
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += (
            [node.module]
            if isinstance(node, ast.ImportFrom) and node.module and not node.level
            else []
        )
        found |= {
            name.removeprefix("stancekit.") for name in names if name.startswith("stancekit.")
        }
    return {
        name for name in found if name.split(".")[0] in BELOW and not f"{name}.".startswith(FREE)
    }


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_command_imports_from_below_what_is_listed_with_its_reason(path: Path) -> None:
    may = {name for names in MAY.get(path.stem, {}).values() for name in names}
    assert imported(path) == may


def test_commands_that_ask_the_library_alone_are_seen() -> None:
    assert not imported(FOLDER / "label.py") | imported(FOLDER / "sample.py")
    assert "planners.search.methods" in imported(FOLDER / "plan.py")
    assert MAY.keys() <= {path.stem for path in FOLDER.glob("*.py")}
