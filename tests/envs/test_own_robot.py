"""The posture environments and Traverse-v0 for a robot's file and a terrain's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.episodes import MemorylessPolicy, largest_gap
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import SceneKind
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.traverse import TraverseEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.learners.selectors.selector import heuristic_envelope
from stancekit.planners.problem.course_file import read_spec
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.verify import check_plan
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

PLANE = "v -2 -2 {0}\nv 2 -2 {0}\nv 2 2 {0}\nv -2 2 {0}\nf 1 2 3\nf 1 3 4\n"
COURSE = """
name: field
robot: dog.urdf
frames: 3
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.06, 0.0, 0.5]
body: {com_radius_m: 0.05, first_radius_m: 0.05}
terrain: {kind: mesh, file: flat.obj, friction: 0.8}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dog")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.obj").write_text(PLANE.format(0.0))
    (folder / "raised.obj").write_text(PLANE.format(0.02))
    (folder / "course.yaml").write_text(COURSE)
    return folder


@pytest.fixture
def files(folder: Path) -> dict[str, str]:
    return {"robot": str(folder / "dog.urdf"), "terrain": str(folder / "flat.obj")}


def test_selection_has_the_robots_legs_in_its_spaces_and_scenes(files: dict[str, str]) -> None:
    env = EnvelopeSelectionEnv("terrain-4", **files, balanced=False)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert env.action_space.shape == (12 * 4,)
    wide = np.concatenate([-np.ones(24), np.ones(24)]).astype(np.float32)
    _, reward, ended, _, info = env.step(wide)
    assert ended
    assert info["p1_feasible"] == 1
    assert reward >= 0.1 * 0.0 + 1.0 * info["label"]
    batch = EnvelopeSelectionVectorEnv(2, "terrain-4", **files, balanced=False)
    seen, _ = batch.reset(seed=0)
    for name, values in observation.items():
        np.testing.assert_array_equal(seen[name][0], values)


def test_refinement_comes_to_a_verdict_on_the_robots_scenes(files: dict[str, str]) -> None:
    env = EnvelopeRefinementEnv("terrain-3", **files, balanced=False, projection="fix-p")
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    policy, over = MemorylessPolicy(largest_gap), False
    while not over:
        observation, _, ended, cut_off, info = env.step(np.int64(policy.predict(observation)[0]))
        over = ended or cut_off
    assert info["verdict"] in (info["label"], -1)


def test_a_traverse_is_walked_over_envelopes_learned_for_the_robots_own_legs(
    folder: Path, files: dict[str, str]
) -> None:
    learned = []
    for index, legs in enumerate(
        (["LF", "RF", "RH"], ["LF", "LH", "RH"], ["LF", "RF", "LH", "RH"])
    ):
        path = folder / f"legs-{index}.yaml"
        path.write_text(
            f"robot: dog.urdf\nterrain: flat.obj\nlegs: [{', '.join(legs)}]\nfriction: [0.1, 0.8]\n"
        )
        source, rng = distribution(str(path)), np.random.default_rng(0)
        learned.append(heuristic_envelope(source.name, [source.sample(rng) for _ in range(8)]))
    env = TraverseEnv(
        [str(folder / "course.yaml")], frames=None, amount=0.0, envelopes=[learned, [learned[0]]]
    )
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert observation["reach"].shape == (4,)
    _, _, ended, _, info = env.step(np.int64(2))
    assert (info["refused"], info["frame"], ended) == (1, 0, False)  # of one set of legs alone
    _, _, ended, _, info = env.step(np.int64(1))
    assert (info["refused"], info["feasible"], info["frame"], ended) == (0, 1, 2, True)
    walk = env.walk()
    assert check_plan(walk).accepted
    assert walk.problem.robot.identity == named_robot(files["robot"]).identity == learned[0].robot


def test_a_traverse_takes_another_robot_and_terrain_than_its_courses(
    folder: Path, files: dict[str, str]
) -> None:
    spec = read_spec(folder / "course.yaml").model_copy(update={"robot": "hexapod"})
    raised = str(folder / "raised.obj")
    env = TraverseEnv(
        [spec], frames=None, amount=0.0, envelopes=[], robot=files["robot"], terrain=raised
    )
    _, info = env.reset(seed=0)
    assert info["toes_m"].shape == (4, 3)
    np.testing.assert_allclose(info["toes_m"][:, 2], 0.02, atol=1e-6)


def test_what_brings_its_own_robot_takes_no_other(files: dict[str, str]) -> None:
    with refuses("robot", "terrain"):
        EnvelopeSelectionEnv(SceneKind(name="mine", legs=("LF",)), **files)
    with refuses("scenes"):
        EnvelopeSelectionEnv(SceneKind(name="mine", legs=("LF",)))
    with refuses("robot", "terrain"):
        TraverseEnv(lambda rng: None, regions=1, **files)  # type: ignore[arg-type,return-value]
