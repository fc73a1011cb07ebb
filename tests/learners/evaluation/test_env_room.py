"""Room of environments whose scenes are postures and climbs: episodes that are those of other
judges.
"""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import stancekit.envs  # noqa: F401
from stancekit.learners.evaluation.evaluate import evaluate
from stancekit.learners.evaluation.room import ENVIRONMENTS, environment_room
from stancekit.learners.selectors.selector import load_selector
from stancekit.planners.problem.walk import Walk
from stancekit.planners.terrain.reference import reference_terrain
from tests.refusals import refuses


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
    monkeypatch.setitem(ENVIRONMENTS, "WarpedGait-v0", plays)
    room = environment_room("WarpedGait-v0", tmp_path, scenes=1, seed=3)
    rows = played(tmp_path, "WarpedGait-v0")
    assert {method for _, method in rows} == set(few)
    assert room.controlled_by.startswith("always ")
    assert (room.budget, room.learned) == ("one attempt", None)
