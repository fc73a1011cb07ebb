"""Extensions, each one file and one registration: a relaxation, a reward term, a verifier group, a
command.
"""

from importlib.metadata import EntryPoint
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import stancekit
from stancekit.cli import main as command
from stancekit.planners.answer.report import Group
from stancekit.planners.relaxation.envelope import RELAXATIONS
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.verify import bodies
from stancekit.planners.verify.bodies import FURTHER
from tests.refusals import refuses

SELECTION = "stancekit.envs:stancekit/EnvelopeSelection-v0"
MINE = '''
from dataclasses import dataclass
from stancekit.planners.relaxation.mccormick import McCormick


class Roomy(McCormick):
    """A relaxation: McCormick's over a box that is a little larger."""

    def solve_any_of_each(self, scaled, envelopes):
        return super().solve_any_of_each(scaled, [[box.widened(0.1) for box in boxes] for boxes in envelopes])


def spread(judged):
    """A reward term: how far apart the chosen boxes' middles are."""
    return float(judged.envelope.high[:, 0].max() - judged.envelope.low[:, 0].min())


@dataclass
class Count:
    """Count what there is."""

    most: int = 3

    def run(self):
        print(*range(self.most))
        return 0
'''


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    return path


@pytest.fixture
def learned():
    problems = stancekit.sample("wall-3", 3, rng=5)
    box = stancekit.Envelope(low=-0.4 * np.ones((3, 6)), high=0.4 * np.ones((3, 6)))
    return problems, stancekit.EnvelopeSet.for_problems("wall-3", problems, [box])


def test_a_relaxation_of_ones_own_is_named_in_solve_plan_and_the_environment(mine, learned):
    problems, boxes = learned
    name = f"{mine}:Roomy"
    assert issubclass(RELAXATIONS.get(name), McCormick)
    for problem in problems:
        own, plain = (
            stancekit.solve(problem, stancekit.TwoStage(relaxation=each, envelopes=boxes))
            for each in (name, "p1")
        )
        assert own.details["margin"] <= plain.details["margin"] + 1e-6 or np.isinf(
            plain.details["margin"]
        )
    env = gym.make(SELECTION, relaxation=name)
    env.reset(seed=1)
    assert np.isfinite(env.step(env.action_space.sample())[1])
    course = stancekit.load("stairs")
    with refuses("frame 0", "normal"):  # boxes for three limbs, where six stand
        stancekit.plan(course, stancekit.TwoStage(relaxation=name, envelopes=boxes))


def test_relaxations_that_do_not_fit_are_one_line(learned):
    problem, boxes = learned[0][0], learned[1]
    for method, line in (
        (
            {"relaxation": "magic"},
            "relaxation",
        ),
        (
            {"relaxation": "coned"},
            "envelopes",
        ),
        (
            {"relaxation": "lift", "envelopes": boxes},
            "envelopes",
        ),
    ):
        with refuses(line):
            stancekit.solve(problem, stancekit.TwoStage(**method))
    with refuses("relaxation"):
        stancekit.plan("stairs", stancekit.TwoStage(relaxation="joint", envelopes=boxes), frames=2)


def test_a_reward_term_of_ones_own_is_weighed_and_told(mine):
    env = gym.make(SELECTION, weights={f"{mine}:spread": 2.0, "agreement": 0.0})
    _, info = env.reset(seed=3)
    assert info["reward_spread"] == 0.0
    action = np.repeat(np.float32([-0.25, 0.5]), 18)
    _, reward, *_, info = env.step(action)
    assert info["reward_spread"] == pytest.approx(2.0 * 0.75)
    assert info["reward_agreement"] == 0.0
    assert reward == pytest.approx(
        sum(value for key, value in info.items() if key.startswith("reward_"))
    )
    with refuses("weights.beauty"):
        gym.make(SELECTION, weights={"beauty": 1.0})


def test_a_verifier_group_of_ones_own_refuses_and_is_named():
    plan = stancekit.plan("walls", frames=2).solution

    def low(it):
        return Group(name="low", value=float(it.com_m[:, 2].max()), unit="m", when=0)

    assert stancekit.verify(plan).accepted
    bodies._of_packages.cache_clear()  # as where one is registered before anything was judged
    FURTHER.register("low", low)
    try:
        report = stancekit.verify(plan)
        assert [group.name for group in report.refused] == ["low"]
        FURTHER.register("low", lambda it: None)
        with refuses("verifier group low"):
            stancekit.verify(plan)
    finally:
        del FURTHER._things["low"]
    assert stancekit.verify(plan).accepted


def test_a_command_of_another_package_is_run_named_and_takes_over_none_of_ours(
    mine, monkeypatch, capsys
):
    monkeypatch.syspath_prepend(mine.parent)
    points = [
        EntryPoint("count", "mine:Count", command.ENTRY_POINTS),
        EntryPoint("plan", "mine:Count", command.ENTRY_POINTS),
    ]
    monkeypatch.setattr(
        "stancekit.planners.plugins.entry_points_of",
        lambda group: points if group == command.ENTRY_POINTS else [],
    )
    with pytest.raises(SystemExit) as done:
        command.main(["count", "--most", "4"])
    assert done.value.code == 0
    assert capsys.readouterr().out == "0 1 2 3\n"
    with pytest.raises(SystemExit):
        command.main(["cuont"])
    assert "about, count, got 'cuont'" in capsys.readouterr().err
    assert command._command("plan").__name__ == "PlanCourse"
