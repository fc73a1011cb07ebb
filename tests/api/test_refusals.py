"""A hundred wrong arguments, of the library and of environments: one line when they are given, and
nothing later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import stancekit
import stancekit.envs
from stancekit.envs.distributions.courses import icy_walls
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.search.methods import SETTINGS
from stancekit.postures import planner_of
from stancekit.runner.worlds.world import WORLDS, WorldSettings
from tests.refusals import refuses

SELECTION, REFINEMENT = "stancekit/EnvelopeSelection-v0", "stancekit/EnvelopeRefinement-v0"
TRAVERSE, GAIT = "stancekit/Traverse-v0", "stancekit/WarpedGait-v0"


class Nothing:
    """Of no use to anybody."""


def box() -> stancekit.EnvelopeSet:
    """Bounds that hold everything."""
    whole = stancekit.Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    return stancekit.EnvelopeSet.for_problems("wall-3", stancekit.sample("wall-3", rng=8), [whole])


SOLVE: list[tuple[str, dict[str, Any]]] = [
    ("projection", {"projection": "nonsense"}),
    ("projection", {"projection": "scp"}),
    ("projection", {"method": "nlp", "projection": "scp"}),
    ("projection", {"method": "micp", "projection": "scp"}),
    ("projection", {"method": "lift", "projection": "nonsense"}),
    ("projection", {"method": "two-stage", "projection": 3}),
    ("solver", {"solver": "cplex"}),
    ("solver", {"solver": "scip"}),
    ("solver", {"method": "lift", "solver": "scip"}),
    ("solver", {"method": "micp", "solver": ["highs"]}),
    ("intervals", {"intervals": 8}),
    ("intervals", {"method": "micp", "intervals": "4"}),
    ("intervals", {"method": "two-stage", "intervals": 2}),
    ("envelopes", {"envelopes": "box.json"}),
    ("time_limit_s", {"method": "lift", "time_limit_s": 1.0}),
    ("time_limit_s", {"time_limit_s": -1.0}),
    ("time_limit_s", {"time_limit_s": "1"}),
    ("time_limit_s", {"time_limit_s": float("nan")}),
    ("method", {"method": "magic"}),
    ("method", {"method": 7}),
]
PLAN: list[tuple[str, dict[str, Any]]] = [
    ("method", {"method": "magic"}),
    ("method", {"method": "p1"}),
    ("method", {"method": 3}),
    ("frames", {"frames": 2.0}),
    ("frames", {"frames": True}),
    ("settings", {"settings": 3}),
    ("time_limit_s", {"time_limit_s": "1"}),
    ("time_limit_s", {"time_limit_s": -1.0}),
]
METHODS: list[tuple[str, Callable[[], Any]]] = [
    ("projection", lambda: stancekit.TwoStage(projection="nonsense")),
    ("gap", lambda: stancekit.TwoStage(gap=0.0)),
    ("steps", lambda: stancekit.TwoStage(steps="two")),
    ("gap", lambda: stancekit.Exact(gap=0.0)),
    ("max_nodes", lambda: stancekit.Exact(max_nodes=-1)),
    ("starts", lambda: stancekit.Nlp(starts=0)),
    ("start", lambda: stancekit.Nlp(start="random")),
    ("time_limit_s", lambda: stancekit.Nlp(time_limit_s=-1.0)),
    ("projection", lambda: stancekit.TwoStage(projection=3)),
    ("relaxation", lambda: stancekit.TwoStage(relaxation="boxes")),
    ("relaxation", lambda: stancekit.TwoStage(relaxation="envelope")),
    ("envelopes", lambda: stancekit.TwoStage(relaxation="p1")),
    ("envelopes", lambda: stancekit.TwoStage(relaxation="lift", envelopes=box())),
    ("envelopes", lambda: stancekit.TwoStage(envelopes=["net.safetensors"])),
    ("reserve", lambda: stancekit.TwoStage(reserve="no")),
    ("gap", lambda: stancekit.Exact(gap="small")),
    ("solver", lambda: stancekit.Micp(solver="cplex")),
    ("solver", lambda: stancekit.Micp(solver=["highs"])),
    ("intervals", lambda: stancekit.Micp(intervals="4")),
]
OTHERS: list[tuple[str, Callable[[], Any]]] = [
    ("rng", lambda: stancekit.sample("wall-3", rng=1.5)),
    ("count", lambda: stancekit.sample("wall-3", 0)),
    ("robot, terrain", lambda: stancekit.sample(stancekit_distribution(), robot="hexapod")),
    ("problems", lambda: stancekit.sample(Nothing())),
    ("distribution", lambda: stancekit.sample("ceiling-3")),
    ("robot, terrain", lambda: stancekit.label(stancekit_distribution(), "rows", robot="hexapod")),
    ("natural", lambda: stancekit.label("wall-3", "rows", natural="yes")),
    ("workers", lambda: stancekit.label("wall-3", "rows", workers="2")),
    ("workers", lambda: stancekit.label("wall-3", "rows", workers=0)),
    ("rows", lambda: stancekit.label("wall-3", "rows", rows=(True, 3))),
    ("gait", lambda: stancekit.walk("ripple", (1.0, 0.0), gait="run")),
    ("dataset", lambda: stancekit.fit(3)),
    ("selector", lambda: stancekit.evaluate(3, "rows")),
    ("projections", lambda: stancekit.evaluate("e.json", "rows", projections="fix-p")),
    ("kind", lambda: stancekit.load("a.json", "Plan")),
]
ENVIRONMENTS: list[tuple[str, str, dict[str, Any]]] = [
    ("timing", SELECTION, {"timing": "no"}),
    ("timing", SELECTION, {"timing": 1}),
    ("balanced", SELECTION, {"balanced": "false"}),
    ("balanced", SELECTION, {"balanced": 0}),
    ("boxes", SELECTION, {"boxes": True}),
    ("boxes", SELECTION, {"boxes": "2"}),
    ("boxes", SELECTION, {"boxes": 2.0}),
    ("problm", SELECTION, {"problm": "ground-3"}),
    ("weights.agrement", SELECTION, {"weights": {"agrement": 1.0}}),
    ("weights.agreement", SELECTION, {"weights": {"agreement": "much"}}),
    ("weights.agreement", SELECTION, {"weights": {"agreement": float("nan")}}),
    ("weights", SELECTION, {"weights": 1.0}),
    ("weights", SELECTION, {"weights": [1.0, 0.5]}),
    ("relaxation", SELECTION, {"relaxation": "p2"}),
    ("projections", SELECTION, {"projections": "fix-p"}),
    ("projections", SELECTION, {"projections": [3]}),
    ("projection", SELECTION, {"projections": ["nonsense"]}),
    ("library", SELECTION, {"library": 3}),
    ("library", SELECTION, {"library": ["e.json"]}),
    ("scenes", SELECTION, {"scenes": [1, 2]}),
    ("distribution", SELECTION, {"problem": Nothing()}),
    ("distribution", SELECTION, {"problem": 3}),
    ("render_mode", SELECTION, {"render_mode": "ansi"}),
    ("robot", SELECTION, {"robot": 3}),
    ("budget", REFINEMENT, {"budget": "30"}),
    ("budget", REFINEMENT, {"budget": 0}),
    ("budget", REFINEMENT, {"budget": True}),
    ("projection", REFINEMENT, {"projection": "nonsense"}),
    ("projection", REFINEMENT, {"projection": None}),
    ("programs", REFINEMENT, {"programs": {}}),
    ("timing", REFINEMENT, {"timing": True}),
    ("balanced", REFINEMENT, {"balanced": "yes"}),
    ("envelopes", TRAVERSE, {"envelopes": "net.safetensors"}),
    ("envelopes", TRAVERSE, {"envelopes": ["net.onnx"]}),
    ("net.safetensors", TRAVERSE, {"envelopes": ["net.safetensors"]}),
    ("envelopes", TRAVERSE, {"envelopes": [Nothing()]}),
    ("planners", TRAVERSE, {"planners": ["two-stage"]}),
    ("planners", TRAVERSE, {"planners": []}),
    ("courses", TRAVERSE, {"courses": "stairs"}),
    ("courses", TRAVERSE, {"courses": []}),
    ("courses", TRAVERSE, {"courses": [3]}),
    ("frames", TRAVERSE, {"frames": "9"}),
    ("horizon", TRAVERSE, {"horizon": True}),
    ("horizon", TRAVERSE, {"horizon": 0}),
    ("amount", TRAVERSE, {"amount": "1"}),
    ("amount", TRAVERSE, {"amount": -1.0}),
    ("amount", TRAVERSE, {"amount": float("inf")}),
    ("patience", TRAVERSE, {"patience": 1.0}),
    ("patience", TRAVERSE, {"patience": 0}),
    ("frames", TRAVERSE, {"frames": 0}),
    ("regions", TRAVERSE, {"courses": icy_walls}),
    ("course", TRAVERSE, {"courses": ("wals",)}),
    ("render_mode", TRAVERSE, {"render_mode": "ansi"}),
    ("limbs", TRAVERSE, {"limbs": 0}),
    ("regions", TRAVERSE, {"regions": "1"}),
    ("corners", TRAVERSE, {"corners": 2}),
    ("weights.progres", TRAVERSE, {"weights": {"progres": 1.0}}),
    ("weights", TRAVERSE, {"weights": "high"}),
    ("executor", TRAVERSE, {"executor": "mujoco"}),
    ("timing", TRAVERSE, {"timing": "on"}),
    ("settings", GAIT, {"settings": 50}),
    ("settings.iterations", GAIT, {"settings": {"iterations": 50}}),
    ("settings.max_iterations", GAIT, {"settings": {"max_iterations": "many"}}),
    ("weights.speed", GAIT, {"weights": {"speed": 1.0}}),
    ("weights", GAIT, {"weights": {"seconds": 0.1}}),
    ("charts", GAIT, {"charts": "decoupled"}),
    ("charts", GAIT, {"charts": []}),
    ("chart", GAIT, {"charts": ["flat"]}),
    ("terrain", GAIT, {"terrain": "moon"}),
    ("terrain", GAIT, {"terrain": 3}),
    ("robot", GAIT, {"robot": 3}),
    ("tasks", GAIT, {"tasks": "mixed"}),
    ("timing", GAIT, {"timing": "off"}),
    ("render_mode", GAIT, {"render_mode": "ansi"}),
]
BATCHES: list[tuple[str, dict[str, Any]]] = [
    ("workers", {"workers": "2"}),
    ("workers", {"workers": 2.0}),
    ("workers", {"workers": 3}),
    ("workers", {"workers": True}),
    ("timing", {"timing": "no"}),
    ("weights", {"weights": 3}),
    ("problm", {"problm": "ground-3"}),
    ("render_mode", {"render_mode": "human"}),
]
RESETS: list[tuple[str, str, dict[str, Any]]] = [
    ("seed", SELECTION, {"seed": 1.5}),
    ("seed", SELECTION, {"seed": -1}),
    ("options", SELECTION, {"options": {"reset_mask": np.array([True])}}),
    ("seed", TRAVERSE, {"seed": "0"}),
    ("options", REFINEMENT, {"options": [1]}),
    ("options", GAIT, {"options": {"level": 0.5}}),
]


def stancekit_distribution() -> Any:
    """Something that draws for its own."""
    from stancekit.envs.distributions.postures import WALL_3

    return WALL_3


def test_there_are_more_than_a_hundred():
    lists = (SOLVE, PLAN, METHODS, OTHERS, ENVIRONMENTS, BATCHES, RESETS)
    assert sum(map(len, lists)) > 100


def test_solve_refuses_what_its_method_has_no_use_for():
    problem = stancekit.sample("wall-3", rng=8)[0]
    for named, options in SOLVE:
        with refuses(named):
            solved(problem, **options)
    for method in ("exact", "lift", "nlp"):
        with refuses("envelopes"):
            solved(problem, method, envelopes=box())


def solved(problem: stancekit.Problem, method: Any = "exact", **options: Any) -> Any:
    """The answer of a method with the settings that are given beside it."""
    settings = {name: options.pop(name) for name in SETTINGS if name in options}
    if settings:
        method = planner_of(method, **settings, **options)
        options = {}
    return stancekit.solve(problem, method, **options)


def test_plan_refuses_what_its_planner_has_no_use_for():
    for named, options in PLAN:
        with refuses(named):
            stancekit.plan("stairs", **{"frames": 2, **options})
    for named, make in METHODS:
        with refuses(named):
            make()


@pytest.mark.parametrize(
    ("function", "name"),
    [("plan", "reserve"), ("solve", "projection"), ("walk", "heading_rad"), ("label", "feasible")],
)
def test_an_argument_that_a_function_does_not_have_is_refused_as_of_any(function, name):
    asked = {
        "plan": ("stairs",),
        "solve": (stancekit.sample("wall-3", rng=8)[0],),
        "walk": ("ripple", (1.0, 0.0)),
        "label": ("wall-3", "rows"),
    }[function]
    with refuses(function, name, kind=TypeError):
        getattr(stancekit, function)(*asked, **{name: 0.1})


def test_other_functions_refuse_at_the_call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for named, call in OTHERS:
        with refuses(named):
            call()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [SELECTION, REFINEMENT, TRAVERSE, GAIT])
def test_environments_refuse_when_they_are_made(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cases = [(named, options) for named, of, options in ENVIRONMENTS if of == name]
    assert len(cases) > 5
    for named, options in cases:
        with refuses(named):
            gym.make(name, **options)


def test_a_batch_refuses_when_it_is_made():
    for named, options in BATCHES:
        with refuses(named):
            gym.make_vec(SELECTION, num_envs=2, **options)


def test_a_reset_refuses_what_it_does_not_know():
    for named, name, options in RESETS:
        env = gym.make(name)
        with refuses(named):
            env.reset(**options)


def test_a_mapping_is_taken_as_files_take_it():
    env = gym.make(
        SELECTION,
        problem="ground-3",
        weights={"agreement": 2.0, "projection": 0.0, "tightness": 0.0},
    )
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.repeat([-1.0, 1.0], 18).astype(np.float32))
    assert reward == 2.0 * info["p1_right"]
    gait = gym.make(GAIT, terrain="ripple", settings={"max_iterations": 3}).unwrapped
    assert gait._settings == GaitSettings(max_iterations=3)


@pytest.fixture(scope="module")
def plan(course_plan: Callable[[str, int], stancekit.Motion]) -> stancekit.Motion:
    return course_plan("stairs", 2)


def test_a_world_that_was_made_before_pulls_as_the_plan_is_for(plan: stancekit.Motion) -> None:
    for gravity_m_s2, verb in ((1.62, stancekit.run), (1.62, stancekit.simulate)):
        world = WORLDS.get("mujoco").make(
            WorldSettings(robot=plan.problem.robot, gravity_m_s2=gravity_m_s2)
        )
        with refuses("stairs", "1.62", "9.81"):
            verb(plan, world)


def test_a_gait_runs_as_planned() -> None:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(
        level, (0.1, 0.0), robot="hexapod", gait="tripod", duration_s=2.5, chart="decoupled"
    )
    assert walk.solution is not None
    faster = stancekit.RunSettings(timing=Timing().at_pace(2.0))
    with refuses("timing"):
        stancekit.run(walk.solution, settings=faster)
