"""Room for learning: its shares by hand, and intervals that cover."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import stancekit.envs  # noqa: F401
from stancekit.learners.evaluation import room as made
from stancekit.learners.evaluation.evaluate import evaluate
from stancekit.learners.evaluation.room import ENVIRONMENTS, environment_room, leap_room, paired
from stancekit.learners.selectors.selector import load_selector
from stancekit.planners.problem.walk import Walk
from stancekit.planners.terrain.reference import reference_terrain
from tests.refusals import refuses


def row(scene, method, found, tries, solves):
    return {"scene": scene, "method": method, "found": found, "tries": tries, "solves": solves}


ROWS = [
    row(0, "random", False, 50, 50),
    row(0, "rule-tuned", True, 1, 3),
    row(0, "finder", True, 1, 3),
    row(0, "net", True, 1, 2),
    row(0, "noise", False, 40, 50),
    row(0, "noise-again", False, 40, 50),
    row(1, "random", True, 20, 30),
    row(1, "rule-tuned", False, 40, 50),
    row(1, "finder", True, 5, 11),
    row(1, "net", True, 1, 4),
    row(1, "noise", True, 9, 20),
    row(1, "noise-again", False, 40, 50),
    row(2, "random", False, 50, 50),
    row(2, "rule-tuned", False, 40, 50),
    row(2, "finder", False, 40, 50),
    row(2, "net", False, 40, 50),
    row(2, "noise", True, 9, 20),
    row(2, "noise-again", False, 40, 50),
    row(3, "random", False, 50, 50),
    row(3, "rule-tuned", False, 40, 50),
    row(3, "finder", False, 40, 50),
    row(3, "net", False, 40, 50),
    row(3, "noise", False, 40, 50),
    row(3, "noise-again", False, 40, 50),
]


def test_room_is_what_the_control_leaves_of_the_union():
    one, twelve = (
        leap_room(ROWS, "leap-few", 50, tries=1),
        leap_room(ROWS, "leap-few", 50, solves=12),
    )
    assert (one.scenes, one.control[0], one.oracle[0], one.room) == (4, 0.25, 0.75, 50.0)
    assert (one.learned_by, one.learned[0], one.gain[0]) == ("net", 0.5, 25.0)
    assert (twelve.controlled_by, twelve.control[0], twelve.room, twelve.gain[0]) == (
        "finder",
        0.5,
        25.0,
        0.0,
    )
    assert one.again[0] == 0.5  # scene 2 was found by noise of the first seed alone
    assert one.random[0] == 0.0


def test_paired_intervals_cover_a_difference_that_is_known():
    rng, inside = np.random.default_rng(0), 0
    for k in range(40):
        control = rng.random(400) < 0.5
        learned = np.where(rng.random(400) < 0.2, True, control)  # + 10 points
        _, low, high = paired(learned, control, seed=k)
        inside += low <= 10.0 <= high
    assert inside >= 34


def played(folder, name):
    rows = map(json.loads, (folder / "rows.jsonl").read_text().splitlines()[1:])
    return {(row["scene"], row["method"]): row for row in rows}


def test_the_episodes_of_a_selector_are_those_that_evaluate_judges(tmp_path):
    name, count = "EnvelopeSelection-v0", 6
    room = environment_room(name, tmp_path, scenes=count, seed=3)
    rows = played(tmp_path, name)
    env, learned = (
        gymnasium.make(f"stancekit/{name}", **ENVIRONMENTS[name].options),
        load_selector("neural-wall-3"),
    )
    for index in range(count):
        env.reset(seed=int(np.random.default_rng([3, index]).integers(2**31)))
        scene = env.unwrapped.scene
        score = evaluate("net", learned, [scene], problem_class="wall-3", projections=("fix-p",))
        right = score.p1_feasible.hits + score.p1_infeasible.hits
        reached = score.projected["fix-p"].hits if scene.feasible else 1
        assert rows[index, "neural-wall-3"]["found"] == bool(right and reached)
        assert rows[index, "exact"]["anywhere"]
    assert room.oracle[0] == 1.0
    assert room.learned_by == "neural-wall-3"
    assert room.room == pytest.approx(100.0 * (1.0 - room.control[0]))


def test_bad_names_and_foreign_rows_are_refused(tmp_path):
    with refuses("environment"):
        environment_room("Walk-v0", tmp_path, scenes=1, seed=0)
    (tmp_path / "rows.jsonl").write_text('{"environment": "Traverse-v0", "seed": 1}\n')
    with refuses():
        environment_room("Traverse-v0", tmp_path, scenes=1, seed=0)
    (tmp_path / "rows.jsonl").write_text("nothing\n")
    with refuses("bench room"):
        environment_room("Traverse-v0", tmp_path, scenes=1, seed=0)


def test_a_walk_is_played_by_every_chart_and_by_chance(tmp_path, monkeypatch):
    step = Walk.over(reference_terrain("ripple"), (0.2, 0.1), duration_s=2.0)
    plays = replace(ENVIRONMENTS["WarpedGait-v0"], options={"tasks": lambda rng: step})
    players = plays.players()
    assert sorted(players) == [
        "always ambient",
        "always decoupled",
        "always shear",
        "always warped",
        "always warped-exact",
        "random",
        "random-again",
    ]
    few = {
        name: players[name]
        for name in ("always ambient", "always decoupled", "random", "random-again")
    }
    plays = replace(plays, players=lambda: few)  # each takes a second of the processor
    monkeypatch.setattr(made, "ENVIRONMENTS", {"WarpedGait-v0": plays})
    room = environment_room("WarpedGait-v0", tmp_path, scenes=1, seed=3)
    assert {method for _, method in played(tmp_path, "WarpedGait-v0")} == set(few)
    assert room.controlled_by.startswith("always ")
    assert (room.budget, room.learned) == ("one attempt", None)
