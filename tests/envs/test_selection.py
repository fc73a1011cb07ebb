"""Every registered environment keeps Gymnasium's contract; EnvelopeSelection-v0 judges as the
planners do.
"""

import copy
import warnings
from dataclasses import replace

import gymnasium
import matplotlib
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence as same

import stancekit.envs
from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.envs.episodes import RewardWeights
from stancekit.envs.scenes import ListedScenes, SampledScenes
from stancekit.envs.selection import VERTICES, EnvelopeSelectionEnv
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.projection.project import PROJECTIONS
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.verify import check_plan
from tests.refusals import refuses

SLOW = {
    "stancekit/WarpedGait-v0"
}  # a step solves a walk: its contract, on short walks, is in test_gait.py
ENVS = sorted(
    name for name in gymnasium.registry if name.startswith("stancekit/") and name not in SLOW
)
OF_POSTURES = [name for name in ENVS if "Envelope" in name]
MODES = [
    (name, mode)
    for name in ENVS
    for mode in gymnasium.make(name).metadata["render_modes"]  # none for those that show nothing
]
DOMAIN = np.concatenate([-np.ones(18), np.ones(18)]).astype(
    np.float32
)  # the whole box of three contacts


@pytest.fixture(autouse=True)
def headless():
    """No window, and every warning is an error."""
    matplotlib.use("agg")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture(params=ENVS)
def env(request):
    """Each of the registered environments, as a user gets it."""
    made = gymnasium.make(f"stancekit.envs:{request.param}")
    yield made
    made.close()


def played(env, seed, steps=5):
    """Everything that is seen of an episode, the actions drawn from the seed, too."""
    env.action_space.seed(seed)
    seen = [env.reset(seed=seed)]
    for _ in range(steps):
        seen.append(env.step(env.action_space.sample()))
        if seen[-1][2] or seen[-1][3]:
            seen.append(env.reset())
    return seen


# -----------------------------------------------------------------------------------------------------------
# contract


def test_there_are_environments_to_look_at():
    assert "stancekit/EnvelopeSelection-v0" in ENVS
    gymnasium.register_envs(stancekit.envs)


def test_a_seed_reproduces_an_episode_exactly(env):
    first, again, other = played(env, 5), played(env, 5), played(env, 6)
    assert same(first, again, exact=True)
    assert same(first, played(gymnasium.make(env.spec.id), 5), exact=True)
    assert not same(first[0][0], other[0][0])


def test_spaces_hold_what_is_seen(env):
    spaces = env.observation_space
    assert isinstance(spaces, gymnasium.spaces.Dict)
    assert all(
        type(space) is gymnasium.spaces.Box and space.dtype == np.float32
        for space in spaces.values()
    )
    for seed in range(3):
        seen = played(env, seed)
        assert all(spaces.contains(step[0]) for step in seen)
        assert all(np.isfinite(values).all() for step in seen for values in step[0].values())


def test_info_is_numbers_of_fixed_shapes(env):
    shapes = set()
    for seed in range(6):
        for step in played(env, seed):
            if len(step) == 5:
                info = step[4]
                assert all(np.asarray(value).dtype.kind in "ifb" for value in info.values()), info
                assert not any(np.isnan(value).any() for value in info.values()), info
                shapes.add(tuple((name, np.shape(value)) for name, value in info.items()))
    assert len(shapes) == 1


@pytest.mark.parametrize("name", OF_POSTURES)
def test_another_class_of_problems_has_its_own_spaces(name):
    for problem in DISTRIBUTIONS:
        env = gymnasium.make(name, problem=problem)
        observation, _ = env.reset(seed=1)
        legs = len(distribution(problem).legs)
        assert observation["friction"].shape == (legs,)
        assert observation["vertices"].shape == (legs * VERTICES * 3,)
        assert env.action_space.contains(env.action_space.sample())


@pytest.mark.parametrize("name", OF_POSTURES)
def test_a_class_that_is_none_is_refused(name):
    with refuses("distribution"):
        gymnasium.make(name, problem="ice-3")


@pytest.mark.parametrize(("name", "mode"), MODES)
def test_every_way_to_render_works_without_a_screen(name, mode):
    import matplotlib.pyplot as plt

    env = gymnasium.make(name, render_mode=mode)
    env.reset(seed=0)
    before = env.render()
    env.action_space.seed(0)
    # The first planner of Traverse-v0 is one that finds a plan; an action that fails leaves the
    # picture as it was.
    env.step(
        np.int64(0)
        if isinstance(env.action_space, gymnasium.spaces.Discrete)
        else env.action_space.sample()
    )
    after = env.render()
    if mode == "human":
        assert (before, after) == (None, None)
        assert plt.get_figlabels() == ["stancekit"]
    else:
        assert before.dtype == after.dtype == np.uint8
        assert before.shape == after.shape
        assert before.shape[2:] == (3,)
        assert not np.array_equal(before, after)
    env.close()
    assert plt.get_figlabels() == []


# -------------------------------------------------------------------------------------------------
# EnvelopeSelection-v0


@pytest.fixture(scope="module")
def selection():
    """The environment with all projections but the slow one."""
    return EnvelopeSelectionEnv(projections=("fix-p", "fix-f", "fix-toes", "scp"))


@pytest.fixture(scope="module")
def scenes():
    source, rng = SampledScenes(distribution("wall-3")), np.random.default_rng(4)
    return [source.draw(rng) for _ in range(6)]


def library(problem_class="wall-3", legs=("RF", "RR", "LM"), boxes=2):
    """Envelopes as wide as the whole domain, and then ever smaller ones."""
    found = [
        Envelope(low=-np.ones((len(legs), 6)) / k, high=np.ones((len(legs), 6)) / k)
        for k in range(1, boxes + 1)
    ]
    return EnvelopeSet(
        problem_class=problem_class,
        legs=legs,
        force_scale_n=98.1,
        length_scale_m=0.6,
        normals=np.tile([0.0, 1.0, 0.0], (len(legs), 1)),
        tilt_rad=np.full(len(legs), 3.0),
        envelopes=tuple(found),
    )


def test_info_has_these_keys(selection):
    _, before = selection.reset(seed=0)
    info = selection.step(DOMAIN)[4]
    assert list(before) == list(info)
    known = ("label", "expert_point", "expert_lower_bound")
    assert all(np.array_equal(before[name], info[name]) for name in known)
    assert not any(np.any(before[name]) for name in before if name not in known)
    assert list(info) == [
        *(
            "label",
            "p1_feasible",
            "p1_right",
            "is_success",
            "margin",
            "gap",
            "log_volume",
            "chosen",
        ),
        *("project_fix_p", "project_fix_f", "project_fix_toes", "project_scp"),
        *("reward_agreement", "reward_projection", "reward_tightness"),
        *(
            "push_n",
            "support_m",
            "friction_left",
            "expert_push_n",
            "expert_support_m",
            "expert_friction_left",
        ),
        *("expert_point", "expert_lower_bound", "p1_seconds", "p2_seconds", "expert_seconds"),
    ]
    assert info["expert_point"].shape == (3, 6)
    assert (info["p1_seconds"], info["p2_seconds"], info["expert_seconds"]) == (0.0, 0.0, 0.0)


def test_an_episode_is_one_step_whose_reward_is_the_sum_of_its_terms(selection):
    labels = set()
    for seed in range(12):
        selection.reset(seed=seed)
        _, reward, terminated, truncated, info = selection.step(DOMAIN)
        assert (terminated, truncated) == (True, False)
        assert (
            reward
            == info["reward_agreement"] + info["reward_projection"] + info["reward_tightness"]
        )
        assert (
            info["reward_agreement"] == info["p1_right"] == (info["p1_feasible"] == info["label"])
        )
        assert info["is_success"] == (
            info["project_fix_p"] if info["label"] else not info["p1_feasible"]
        )
        assert info["reward_projection"] == 0.5 * info["project_fix_p"]
        assert info["reward_tightness"] == pytest.approx(0.0)
        assert info["project_fix_p"] <= info["project_scp"] <= info["label"]
        assert info["p1_feasible"] == (info["margin"] <= 0.0)
        assert np.any(info["expert_point"]) == info["label"]
        assert (info["expert_lower_bound"] > 1e-4) == (not info["label"])
        labels.add(info["label"])
    assert labels == {0, 1}


def test_the_experts_own_point_is_a_box_that_admits_what_it_should(scenes):
    env = EnvelopeSelectionEnv(scenes=ListedScenes(scenes))
    looked_at = 0
    for _ in scenes:
        env.reset()
        point = copy.deepcopy(env).step(DOMAIN)[4]["expert_point"]
        if np.any(point):
            action = np.concatenate([(point - 1e-4).ravel(), (point + 1e-4).ravel()])
            _, reward, _, _, info = env.step(action)
            assert (info["p1_feasible"], info["project_fix_p"]) == (1, 1)
            assert reward > 1.59
            looked_at += 1
    assert looked_at


def test_weights_are_what_the_terms_are_worth(scenes):
    weights = RewardWeights(agreement=3.0, projection=0.0, tightness=2.0)
    env = EnvelopeSelectionEnv(scenes=ListedScenes(scenes), weights=weights)
    env.reset()
    info = env.step(np.zeros(36, np.float32))[4]
    assert info["reward_tightness"] == 2.0
    assert info["reward_agreement"] == 3.0 * (info["label"] == 0)
    assert info["log_volume"] == -np.inf


def said(env, seed, action):
    """Info of an action in the first scene of a seed."""
    env.reset(seed=seed)
    return env.step(action)[4]


def test_a_reversed_pair_is_put_in_order(selection):
    assert same(said(selection, 1, DOMAIN), said(selection, 1, -DOMAIN), exact=True)


def test_the_better_of_two_boxes_is_chosen():
    one, two = EnvelopeSelectionEnv(), EnvelopeSelectionEnv(boxes=2)
    assert two.action_space.shape == (72,)
    for seed in range(4):
        alone = said(one, seed, DOMAIN)
        first = said(two, seed, np.concatenate([DOMAIN, np.zeros(36, np.float32)]))
        second = said(two, seed, np.concatenate([np.zeros(36, np.float32), DOMAIN]))
        assert (first["chosen"], second["chosen"]) == (0, 1) or not alone["p1_feasible"]
        assert first["p1_feasible"] == second["p1_feasible"] == alone["p1_feasible"]


def test_a_library_is_chosen_from_by_number(selection, tmp_path):
    from stancekit.planners.formats.question_file import write_boxes

    write_boxes(tmp_path / "e.json", library())
    chosen = EnvelopeSelectionEnv(
        library=tmp_path / "e.json", projections=("fix-p", "fix-f", "fix-toes", "scp")
    )
    assert chosen.action_space == gymnasium.spaces.Discrete(2)
    check_env(chosen, skip_render_check=True)
    for index, action in enumerate((DOMAIN, DOMAIN / 2.0)):
        assert same(said(selection, 3, action), said(chosen, 3, np.int64(index)), exact=True)
    chosen.reset()
    for action in (2, -1):
        with refuses("action", str(action)):
            chosen.step(np.int64(action))


def test_every_projection_can_be_asked_for():
    env = EnvelopeSelectionEnv(projections=PROJECTIONS.names())
    env.reset(seed=0)
    info = env.step(DOMAIN)[4]
    assert [name for name in info if name.startswith("project_")] == [
        f"project_{way.replace('-', '_')}" for way in PROJECTIONS.names()
    ]


def test_timing_is_told_when_asked_for(scenes):
    env = EnvelopeSelectionEnv(scenes=ListedScenes(scenes), timing=True)
    env.reset()
    info = env.step(DOMAIN)[4]
    assert 0.0 < info["p1_seconds"] < 60.0
    assert info["expert_seconds"] == scenes[0].expert_seconds > 0.0


def test_margins_are_those_of_the_verifier_and_told_when_asked_for(scenes):
    names, looked = ("push_n", "support_m", "friction_left"), 0
    env = EnvelopeSelectionEnv(scenes=ListedScenes(scenes), margins=True)
    for scene in scenes:
        before = env.reset()[1]
        info = env.step(DOMAIN)[4]
        assert list(before) == list(info)
        if scene.posture is None:
            assert not any(info[name] or info[f"expert_{name}"] for name in names)
            continue
        plan = replace(scene.posture, problem=scene.problem.course())
        group = check_plan(plan, margins=True).group("margin")
        assert [info[f"expert_{name}"] for name in names] == pytest.approx(
            [group.figures[name] for name in names]
        )
        assert [before[f"expert_{name}"] for name in names] == [
            info[f"expert_{name}"] for name in names
        ]
        assert bool(info["support_m"]) <= info["project_fix_p"]
        looked += info["project_fix_p"]
    assert looked


def test_natural_scenes_come_as_they_are_drawn():
    env, drawn = EnvelopeSelectionEnv("ground-3", balanced=False), []
    for index in range(20):
        env.reset(seed=0 if index == 0 else None)
        drawn.append(env.step(DOMAIN)[4]["label"])
    assert 15 <= sum(drawn) <= 20  # 95 % are feasible


def test_listed_scenes_come_in_their_order_over_and_over(scenes):
    env = EnvelopeSelectionEnv(scenes=ListedScenes(scenes))
    seen = [env.reset()[0]["vertices"] for _ in range(2 * len(scenes))]
    assert same(seen[: len(scenes)], seen[len(scenes) :], exact=True)
    for scene, vertices in zip(scenes, seen, strict=False):
        corners = np.stack([contact.patch.vertices_m for contact in scene.problem.contacts]) / 0.6
        np.testing.assert_allclose(vertices, corners.ravel(), rtol=1e-6)


def test_a_label_that_never_comes_up_is_told(monkeypatch):
    from stancekit.envs import scenes

    monkeypatch.setattr(scenes, "MAX_DRAWS", 0)
    with refuses("wall-3", kind=PlanningFailed):
        SampledScenes(distribution("wall-3")).draw(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"problem": 3},
            "distribution",
        ),
        ({"boxes": 0}, "boxes"),
        ({"boxes": 1.5}, "boxes"),
        ({"projections": ()}, "projections"),
        (
            {"projections": ("magic",)},
            "projection",
        ),
        (
            {"relaxation": "joint", "boxes": 2},
            "relaxation",
        ),
        ({"library": "none.json"}, "none.json"),
        (
            {"library": library("ground-3")},
            "library",
        ),
        (
            {"library": library(legs=("RF", "LM"))},
            "library",
        ),
        (
            {"library": library(), "boxes": 2},
            "boxes",
        ),
        (
            {"render_mode": "ansi"},
            "render_mode",
        ),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with refuses(message):
        EnvelopeSelectionEnv(**arguments)
