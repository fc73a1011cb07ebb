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
    "about": {TOOL: ("runner.computer",)},
    "bench_against": {TOOL: ("learners.evaluation",)},
    "bench_envelopes": {
        TOOL: (
            "learners.data.executors",
            "learners.evaluation",
            "learners.evaluation.evaluate",
            "learners.evaluation.experiment",
        ),
        DRAWS: ("views.comparison", "views.sheet"),
    },
    "bench_gait": {
        TOOL: (
            "learners.evaluation",
            "learners.evaluation.gait_bench",
            "learners.evaluation.gait_figures",
        )
    },
    "bench_planner": {TOOL: ("learners.evaluation", "learners.evaluation.planner_bench")},
    "bench_room": {
        TOOL: (
            "learners.evaluation",
            "learners.evaluation.env_room",
            "learners.evaluation.room",
            "learners.zoo",
        )
    },
    "between": {
        CHOICES: (
            "planners.terrain.import_options",
            "planners.problem.course_file",
            "planners.terrain.reference",
        ),
        LATER: (
            "planners.problem.alternatives",
            "planners.problem.course_between",
            "planners.problem.file_terrain",
            "planners.robot.reach_file",
            "planners.robot.robot_file",
            "planners.terrain.footholds",
        ),
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
            "learners.evaluation.evaluate",
            "learners.evaluation.leaderboard",
        ),
    },
    "export": {TOOL: ("learners.data.export",)},
    "fit": {DRAWS: ("learners.selectors.convergence_plot", "views")},
    "gait": {CHOICES: ("planners.gait.charts",), LATER: ("planners.formats.trajectory_file",)},
    "gait_answer": {
        TOOL: ("planners.verify.trajectory_limits",),
        DRAWS: (
            "planners.gait.charts.pushforward",
            "views.gait_plot",
            "views.gaits",
            "views.page",
            "views.sheet",
            "views.video",
        ),
    },
    "main": {TOOL: ("planners.plugins",)},
    "map": {DRAWS: ("views.sheet", "views.standing_maps")},
    "names": {TOOL: ("planners.plugins",)},
    "options": {
        CHOICES: ("planners.search.methods",),
        DRAWS: ("views.film", "views.page", "views.sheet"),
    },
    "plan": {
        CHOICES: (
            "planners.leap.finder",
            "planners.leap.rule",
            "planners.problem.leap_names",
            "planners.relaxation.table",
            "planners.search.methods",
        ),
        LATER: (
            "learners.leaps.scorer",
            "planners.formats.answer_file",
            "planners.projection.whole_body_limits",
            "planners.search.plan_settings",
        ),
    },
    "plan_answer": {
        CHOICES: (
            "planners.answer.crossing",
            "planners.answer.hindrance",
            "planners.answer.leap_plan",
            "planners.answer.report",
        ),
        LATER: ("planners.formats.leap_file", "planners.verify"),
    },
    "play": {
        CHOICES: (
            "planners.terrain.families",
            "planners.terrain.import_options",
            "planners.terrain.reference",
        ),
        TOOL: (
            "views.playground.between_scenario",
            "views.playground.fixed_scenario",
            "views.playground.keys_scenario",
            "views.playground.serving",
            "views.playground.walk_scenario",
        ),
    },
    "replay": {TOOL: ("runner.log",), DRAWS: ("views.sheet", "views.tracking_plot")},
    "robot": {
        TOOL: (
            "planners.robot.catalogue",
            "planners.robot.robot_file",
            "planners.robot.robot_model",
            "planners.robot.workspace_cache",
        ),
        DRAWS: ("planners.robot.meshes", "views.links", "views.robot_picture", "views.sheet"),
    },
    "run": {
        LATER: (
            "planners.robot.actuators",
            "runner.acceptance",
            "planners.motion.plan_motion",
            "runner.control.loop_settings",
            "runner.report",
            "runner.settings",
            "runner.worlds",
        ),
        TOOL: ("runner.log", "runner.safety.estop"),
        DRAWS: ("views.sheet", "views.tracking_plot"),
    },
    "simulate": {
        LATER: ("planners.motion.plan_motion", "runner.settings", "runner.worlds"),
    },
    "solve": {CHOICES: ("planners.search.methods",)},
    "stops": {TOOL: ("runner.safety.estop", "runner.safety.stop_topic")},
    "terrain": {DRAWS: ("views.footholds", "views.page", "views.sheet")},
    "terrain_options": {
        LATER: (
            "planners.terrain.footholds",
            "planners.terrain.import_options",
        )
    },
    "train": {TOOL: ("learners.training.reinforce", "learners.training.train_config")},
    "verify": {CHOICES: ("envs.data.pools",)},
    "warp": {DRAWS: ("views.maps", "views.sheet")},
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
