"""Selectors of every kind of file as policies of the closed loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from stancekit.cli.run import loop_table, unused
from stancekit.learners.selectors.chooser import Chooser
from stancekit.learners.selectors.network import Architecture, BoxNetwork, ChoiceNetwork
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.learners.selectors.policy import PolicyShape, TrainedPolicy
from stancekit.motions import policy_of
from stancekit.planners.formats.plan_file import write_boxes
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.envelope import expert_envelopes
from stancekit.runner.control.closed_loop import LoopReport
from stancekit.runner.control.envelope_choice import Observation
from stancekit.runner.control.friction import FrictionInterval
from stancekit.runner.safety.ending import Ended
from tests.refusals import refuses

COURSE = read_course("walls", frames=3)
EXPERT = expert_envelopes("wall")


def write_selector(kind: str, path: Path, problem: str = "wall-3") -> None:
    """A selector that was not trained: what it chooses is poor, and a box all the same."""
    torch.manual_seed(0)
    small = Architecture(width=8, layers=1)
    if kind == "envelope":
        write_boxes(path, EXPERT)
    elif kind == "chooser":
        Chooser(ChoiceNetwork(small, 1), EXPERT).save(path)
    elif kind == "neural":
        NeuralSelector(
            BoxNetwork(small),
            problem_class=problem,
            legs=EXPERT.legs,
            force_scale_n=EXPERT.force_scale_n,
            length_scale_m=EXPERT.length_scale_m,
        ).save(path)
    else:
        shape = PolicyShape(
            environment="stancekit/EnvelopeSelection-v0", problem=problem, hidden=(8,)
        )
        TrainedPolicy(
            shape, shape.build(), EXPERT.envelopes[0].to_vector().astype(np.float32)
        ).save(path)


@pytest.mark.parametrize("kind", ["envelope", "chooser", "neural", "reinforced"])
def test_any_selector_s_file_is_a_policy_whose_plans_are_verified(
    kind: str, tmp_path: Path
) -> None:
    path = tmp_path / ("selector.json" if kind == "envelope" else "selector.safetensors")
    write_selector(kind, path)
    policy = policy_of(str(path), COURSE)
    assert policy is not None
    assert policy.learned.legs == EXPERT.legs
    seen = Observation(window=COURSE, standing=None, state=None, friction_share=1.0, frame=0)
    outcome = policy(seen).solve(COURSE)
    assert outcome.solution is not None
    assert sum(policy.answers) == 1
    if kind in ("envelope", "chooser"):
        assert policy.answers == (1, 0)


def test_boxes_that_are_for_p1_joined_with_the_lift_are_refused(tmp_path: Path) -> None:
    NeuralSelector(
        BoxNetwork(Architecture(width=16, layers=1, heads=2, corner_width=8)),
        problem_class=EXPERT.problem_class,
        legs=EXPERT.legs,
        force_scale_n=1.0,
        length_scale_m=1.0,
        relaxation="joint",
    ).save(tmp_path / "joint.safetensors")
    with refuses("selector"):
        policy_of(str(tmp_path / "joint.safetensors"), COURSE)


def test_the_lift_needs_no_selector() -> None:
    assert policy_of("lift", COURSE) is None


def test_selectors_that_do_not_fit_are_refused_with_their_file(tmp_path: Path) -> None:
    path = tmp_path / "five.json"
    write_boxes(path, expert_envelopes("wall", legs=("RF", "RM", "RR", "LF", "LR")))
    with refuses("five.json", "policy"):
        policy_of(str(path), COURSE)
    with refuses("none.json"):
        policy_of(str(tmp_path / "none.json"), COURSE)
    path = tmp_path / "strange.safetensors"
    write_selector("neural", path, problem="moon-3")
    with refuses("strange.safetensors", "distribution"):
        policy_of(str(path), COURSE)


@pytest.mark.parametrize(("answers", "said"), [((0, 3), True), ((0, 0), True), ((1, 2), False)])
def test_a_run_to_which_the_policy_gave_no_plan_is_a_warning(
    answers: tuple[int, int], said: bool
) -> None:
    report = LoopReport(
        succeeded=True,
        message="",
        ended=Ended(left="held", message="", seconds=0.0),
        plans=3,
        replans=0,
        frames=4,
        friction=FrictionInterval(),
        planned_share=1.0,
        surfaces="",
        com_final_m=0.0,
        deviation_m=0.0,
        seconds=1.0,
        plan_s=0.1,
        wall_s=1.0,
    )
    column = list(loop_table(report, answers).columns[0].cells)
    assert ("warning" in column) == said
    warned = f"the policy made none of the {answers[1]} plans that were made"
    assert unused(answers).startswith(warned)
