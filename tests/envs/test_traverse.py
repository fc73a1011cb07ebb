"""Traverse-v0 walks courses that the verifier accepts, and says in its rewards and info what
happened.
"""

from __future__ import annotations

import warnings
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same

import stancekit
from stancekit.envs.episodes import MemorylessPolicy
from stancekit.envs.traverse import NO_MODE, TraverseEnv, TraverseWeights
from stancekit.planners.answer.answer import Answer, Effort, Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.posture import MAX_TILT_RAD
from stancekit.planners.relaxation.envelope import expert_envelopes
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.margins import stance_margins, verdict_yields_m
from tests.refusals import refuses

PROGRAMS = Programs()
LIFT, WALKING, CLIMBING = 0, 1, 2


@pytest.fixture(autouse=True)
def strict():
    """Every warning is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def made(*courses, **named):
    return TraverseEnv(courses or ("walls",), **({"programs": PROGRAMS, "frames": 5} | named))


def played(env, seed, actions):
    seen = [env.reset(seed=seed)]
    for action in actions:
        seen.append(env.step(np.int64(action)))
        if seen[-1][2] or seen[-1][3]:
            break
    return seen


@dataclass(frozen=True)
class Verdict:
    succeeded: bool


class Mute:
    """A planner that never finds a plan."""

    name = "mute"

    def solve(self, course):
        return Answer(
            status=Status.UNDECIDED,
            method=self.name,
            effort=Effort(solves=7, seconds=1.5, compile_s=4.0),
        )


# -----------------------------------------------------------------------------------------------------------
# contract


def test_views_are_finite_and_in_their_space():
    env = made("walls", "stairs", "ground-to-wall")
    for seed in range(4):
        for observation, *_ in played(env, seed, [LIFT, WALKING, CLIMBING, LIFT]):
            assert env.observation_space.contains(observation)
            assert all(np.isfinite(values).all() for values in observation.values())


def test_reset_is_needed_before_the_first_and_after_the_last_step():
    env = made()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.walk()
    assert played(env, 0, [LIFT, LIFT])[-1][2]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.int64(0))


# ------------------------------------------------------------------------------------------------------------
# walking


@pytest.mark.parametrize(
    ("course", "frames", "actions"),
    [
        ("walls", 5, [LIFT, CLIMBING]),
        ("stairs", 5, [WALKING, LIFT]),
        ("ground-to-wall", 9, [WALKING, WALKING, LIFT, CLIMBING]),
    ],
)
def test_a_walk_with_fitting_planners_reaches_the_end_and_is_accepted_by_the_verifier(
    course, frames, actions
):
    env = made(course, frames=frames)
    seen = played(env, 1, actions)
    assert len(seen) == 1 + len(actions)
    assert seen[-1][2:4] == (True, False)
    assert all(step[-1]["feasible"] == 1 for step in seen[1:])
    assert [step[-1]["planner"] for step in seen] == [-1, *actions]
    walk = env.walk()
    report = check_plan(walk)
    assert report.accepted, report.message
    assert walk.problem.frames == frames
    np.testing.assert_array_equal(seen[-1][-1]["com_m"], walk.com_m[-1])
    np.testing.assert_array_equal(seen[-1][-1]["toes_m"], walk.toes_at(frames - 1))


def test_the_reward_is_the_sum_of_its_terms_and_progress_is_the_share_of_the_way():
    weights = TraverseWeights(progress=2.0, feasible=0.3, failure=0.7, solve=0.01)
    env = made(weights=weights)
    seen = played(env, 0, [LIFT, LIFT])
    length = np.linalg.norm(np.diff(env.walk().problem.com_nominal_m, axis=0), axis=1).sum()
    total = 0.0
    for _, reward, _, _, info in seen[1:]:
        assert reward == pytest.approx(
            sum(value for name, value in info.items() if name.startswith("reward_"))
        )
        assert info["reward_feasible"] == 0.3
        assert info["reward_effort"] == pytest.approx(-0.01 * info["solves"])
        total += info["reward_progress"]
    com = env.walk().com_m
    assert total == pytest.approx(2.0 * (com[-1, 2] - com[0, 2]) / length, abs=2.0 * 2e-4 / length)


def test_an_envelope_learned_for_another_terrain_is_refused_and_the_robot_stays():
    env = made()
    first, _ = env.reset(seed=0)
    after, reward, terminated, truncated, info = env.step(np.int64(WALKING))
    assert (info["refused"], info["feasible"], info["frame"], terminated, truncated) == (
        1,
        0,
        0,
        False,
        False,
    )
    assert info["planner"] == -1
    assert reward == pytest.approx(-TraverseWeights().failure)
    assert same(first, after, exact=True)


def test_a_copy_is_a_state_to_go_back_to():
    env = made()
    env.reset(seed=3)
    kept = copy(env)
    first = [env.step(np.int64(LIFT)) for _ in range(2)]
    again = [kept.step(np.int64(LIFT)) for _ in range(2)]
    assert same(first, again)
    assert first[-1][-1]["frame"] == 4


def test_steps_in_vain_are_cut_off():
    env = made(planners=[Mute()], patience=3)
    seen = played(env, 0, [0] * 5)
    assert [step[2:4] for step in seen[1:]] == [(False, False), (False, False), (False, True)]
    assert env.walk().problem.frames == 1


def test_clocks_are_seen_only_when_asked_for():
    for timing in (False, True):
        _, reward, _, _, info = played(made(planners=[Mute()], timing=timing), 0, [0])[1]
        weights = TraverseWeights()
        assert (info["plan_seconds"], info["compile_seconds"]) == (
            (1.5, 4.0) if timing else (0.0, 0.0)
        )
        assert reward == pytest.approx(
            -weights.failure - 7 * weights.solve - weights.second * 1.5 * timing
        )


def test_margins_of_a_window_are_told_when_asked_for():
    for margins in (False, True):
        env = made("walls", margins=margins, weights={"support": 1.0})
        before, info = (step[-1] for step in played(env, 0, [LIFT]))
        assert info["feasible"] == 1
        assert (before["push_n"], before["support_m"], before["friction_left"]) == (0.0, 0.0, 0.0)
        found = info["push_n"], info["support_m"], info["friction_left"]
        plan = env._walked[-1]
        measured = stance_margins(plan, yields_m=verdict_yields_m(plan))
        least = [values.min() for values in measured.values()]
        assert found == (tuple(least) if margins else (0.0, 0.0, 0.0))
        assert min(least) > 0.0
        assert info["reward_support"] == pytest.approx(least[1])


def test_a_window_without_a_plan_by_proof_ends_the_episode():
    course = read_course("walls", frames=5)
    icy = tuple(
        foothold
        if foothold.frame < 2
        else replace(
            foothold,
            candidates=tuple(replace(patch, friction=0.0) for patch in foothold.candidates),
        )
        for foothold in course.footholds
    )
    env = TraverseEnv(
        lambda rng: replace(course, footholds=icy), regions=1, horizon=1, programs=PROGRAMS
    )
    seen = played(env, 0, [LIFT] * 4)
    assert [step[-1]["feasible"] for step in seen[1:]] == [1, 0]
    assert seen[-1][-1]["infeasible"] == 1
    assert seen[-1][2:4] == (True, False)


def test_a_course_that_cannot_begin_is_drawn_again_until_that_is_given_up(monkeypatch):
    monkeypatch.setattr("stancekit.envs.traverse.MAX_DRAWS", 3)
    course = read_course("walls", frames=3)
    slippery = tuple(
        replace(
            foothold,
            candidates=tuple(replace(patch, friction=0.0) for patch in foothold.candidates),
        )
        for foothold in course.footholds
    )
    env = TraverseEnv(lambda rng: replace(course, footholds=slippery), regions=1, programs=PROGRAMS)
    with refuses(kind=PlanningFailed):
        env.reset(seed=0)


@pytest.mark.parametrize("succeeded", [True, False])
def test_an_executor_plays_every_plan_and_ends_the_episode_where_it_fails(succeeded):
    played_plans = []

    def execute(plan):
        played_plans.append(plan)
        return Verdict(succeeded)

    seen = played(made(executor=execute), 0, [LIFT, LIFT])
    assert [step[-1]["executed"] for step in seen] == ([-1, 1, 1] if succeeded else [-1, 0])
    assert len(played_plans) == len(seen) - 1
    assert seen[-1][2]
    assert seen[-1][-1]["reward_failure"] == (0.0 if succeeded else -TraverseWeights().failure)


# --------------------------------------------------------------------------------------------------------------
# views


def test_a_view_shows_the_coming_candidates_from_the_com():
    env = made("icy-walls", frames=4)
    observation, info = env.reset(seed=0)
    course, scale = env._episode, 0.6
    corners = observation["corners"].reshape(2, 6, 4, 4, 3) * scale + info["com_m"]
    offered, friction = (
        observation["offered"].reshape(2, 6, 4),
        observation["friction"].reshape(2, 6, 4),
    )
    normals = observation["normals"].reshape(2, 6, 4, 3)
    shown = np.zeros_like(offered)
    for foothold in course.footholds:
        if 1 <= foothold.frame <= 2:
            limb = course.robot.limb_names.index(foothold.limb)
            for region, patch in enumerate(foothold.candidates):
                at = foothold.frame - 1, limb, region
                np.testing.assert_allclose(corners[at], patch.vertices_m, atol=1e-5)
                np.testing.assert_allclose(normals[at], patch.normal, atol=1e-6)
                assert friction[at] == pytest.approx(patch.friction)
                shown[at] = 1.0
    np.testing.assert_array_equal(offered, shown)
    assert 0 < offered.sum() < offered.size
    np.testing.assert_allclose(
        observation["toes"].reshape(6, 3) * scale + info["com_m"], info["toes_m"], atol=1e-6
    )
    np.testing.assert_allclose(
        observation["goal"] * scale + info["com_m"], course.goal_m, atol=1e-6
    )
    np.testing.assert_allclose(
        observation["path"].reshape(2, 3) * scale + info["com_m"],
        course.com_nominal_m[1:3],
        atol=1e-6,
    )
    assert observation["left"] == 1.0


def test_the_modes_of_the_coming_frames_are_told():
    env = made("ground-to-wall", frames=8)
    seen = played(env, 0, [LIFT, LIFT, LIFT, LIFT])
    assert [step[-1]["terrain_modes"].tolist() for step in seen] == [
        [0, 0],
        [0, 0],
        [0, 1],
        [1, NO_MODE],
        [NO_MODE, NO_MODE],
    ]


def test_a_course_that_does_not_fit_the_view_is_refused_with_its_place():
    course = read_course("icy-walls", frames=3)
    env = TraverseEnv(lambda rng: course, regions=2, programs=PROGRAMS)
    with refuses("frame 1", "limb LM"):
        env.reset(seed=0)


def test_a_course_of_one_frame_has_nowhere_to_go():
    with refuses("course"):
        made(frames=1).reset(seed=0)


# -------------------------------------------------------------------------------------------------------------
# expert


@pytest.mark.parametrize("terrain", ["ground", "wall"])
def test_the_experts_envelopes_are_those_of_the_selector(terrain):
    import stancekit.learners.selectors.selector as heuristic
    from stancekit.envs.distributions.postures import distribution

    name = f"{terrain}-3"
    rng = np.random.default_rng(0)
    problems = [distribution(name).sample(rng) for _ in range(200)]
    theirs, ours = heuristic.heuristic_envelope(name, problems), expert_envelopes(terrain)
    assert (ours.problem_class, ours.legs) == (theirs.problem_class, theirs.legs)
    np.testing.assert_allclose(ours.envelopes[0].low, theirs.envelopes[0].low)
    np.testing.assert_allclose(ours.envelopes[0].high, theirs.envelopes[0].high)
    assert ours.force_scale_n == pytest.approx(theirs.force_scale_n)
    np.testing.assert_allclose(ours.normals, theirs.normals, atol=0.1)


def terrain_rule(observation):
    """The rule of Lin et al. §IV-A: walking where all that carries the robot, and all that it may
    stand on next, is ground; climbing where it is walls to the left and the right; else the lift.
    """
    limbs, horizon = observation["reach"].shape[-1], observation["path"].shape[-1] // 3
    offered = observation["offered"] > 0.0
    first = offered.reshape(*offered.shape[:-1], horizon, limbs, -1)[..., 0, :, :]
    stays = ~first.any(axis=-1)  # the other toes leave before the body moves

    def all_along(axis):
        coming, under = (
            np.abs(observation[name][..., axis::3]) >= np.cos(MAX_TILT_RAD)
            for name in ("normals", "footing")
        )
        return (coming | ~offered).all(axis=-1) & (under | ~stays).all(axis=-1)

    return np.where(all_along(2), WALKING, np.where(all_along(1), CLIMBING, LIFT))


def test_the_terrain_rule_walks_on_ground_climbs_on_walls_and_leaves_the_change_to_the_lift():
    env, rule = made("ground-to-wall", frames=9), MemorylessPolicy(terrain_rule)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        chosen, over = [], False
        while not over:
            action, _ = rule.predict(observation)
            observation, _, over, cut_off, info = env.step(action)
            assert not cut_off
            assert info["feasible"] == 1
            chosen.append(int(action))
        assert chosen == [WALKING, WALKING, LIFT, CLIMBING]


def test_the_terrain_rule_answers_for_many_environments_at_once():
    views = [made(name).reset(seed=0)[0] for name in ("stairs", "walls")]
    stacked = {name: np.stack([view[name] for view in views]) for name in views[0]}
    assert MemorylessPolicy(terrain_rule).predict(stacked)[0].tolist() == [WALKING, CLIMBING]


@pytest.fixture(scope="module")
def networks(tmp_path_factory) -> dict[str, Any]:
    """Networks that have learned next to nothing, of the ground, of walls, and for P1 joined with
    the lift.
    """
    folder, found = tmp_path_factory.mktemp("networks"), dict[str, Any]()
    rows = {
        name: stancekit.label(name, folder / name, rows=(6, 6)) for name in ("ground-3", "wall-3")
    }
    for name, (kind, method) in {
        "ground": ("ground-3", "neural"),
        "wall": ("wall-3", "neural"),
        "joint": ("ground-3", "joint"),
    }.items():
        found[name] = stancekit.fit(rows[kind], method, neural={"epochs": 1, "margin_epochs": 1})
        stancekit.save(found[name], folder / f"{name}.safetensors")
        found[f"{name} file"] = str(folder / f"{name}.safetensors")
    return found


def twenty_steps(envelopes: list[Any]) -> list[float]:
    env = gymnasium.make(
        "stancekit/Traverse-v0", courses=["stairs"], frames=8, horizon=1, envelopes=envelopes
    )
    env.reset(seed=0)
    env.action_space.seed(0)
    rewards = list[float]()
    for _ in range(20):
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        rewards.append(float(reward))
        if terminated or truncated:
            env.reset()
    return rewards


def test_networks_choose_boxes_as_objects_as_files_and_by_name(networks):
    rewards = twenty_steps([networks["ground"]])
    assert max(rewards) > 0.0
    assert twenty_steps([networks["ground file"]]) == rewards
    assert max(twenty_steps(["neural-ground-3"])) > 0.0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "wall",
            "envelopes",
        ),
        (
            "wall file",
            "envelopes",
        ),
        ("joint", "selector"),
        ("joint file", "selector"),
        (
            "neural-ground-2",
            "envelopes",
        ),
        ("neural-ground-9", "neural-ground-9"),
    ],
)
def test_selectors_of_other_stances_are_refused_when_they_are_given(name, said, networks):
    with refuses(said):
        gymnasium.make(
            "stancekit/Traverse-v0", courses=["stairs"], envelopes=[networks.get(name, name)]
        )


def test_a_selector_of_walls_is_taken_where_one_course_is_between_walls(networks):
    assert gymnasium.make(
        "stancekit/Traverse-v0", courses=["stairs", "walls"], envelopes=[networks["wall"]]
    )


def test_a_list_of_sets_may_hold_files_and_a_window_that_is_refused_names_its_stance(
    tmp_path,
):
    """Sets of one action, as files, and of a file that holds something else."""
    ground = expert_envelopes("ground")
    stancekit.save(ground, tmp_path / "ground.json")
    options: dict[str, Any] = {"courses": ["walls"], "amount": 0.0}
    env = TraverseEnv(**options, envelopes=[[tmp_path / "ground.json"], [ground]])
    assert env.action_space.n == 3
    env.reset(seed=0)
    by_file, by_set = (env.step(np.int64(k))[-1]["refused"] for k in (1, 2))
    assert by_file == by_set
    with refuses("envelopes[0][1]"):
        TraverseEnv(**options, envelopes=[[ground, MemorylessPolicy(terrain_rule)]])
