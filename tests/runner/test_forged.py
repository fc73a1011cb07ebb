"""What is handed to the runner may say of itself what it likes: a plan is verified by its numbers when it is armed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pinocchio")

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.method.attempt import Attempted
from stancekit.planners.robot.legged import walking_robot
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted, AcceptedGait, proven
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from tests.emulators.memory_world import MemoryWorld

Step = Callable[[str], Plan]
REJECTED = r"forged: expected a plan that the verifier accepts, rejected: worst is "
CHANGED = r"forged: expected what digest \w+ is of, got \w+: changed since"


@pytest.fixture
def good(step: Step) -> Plan:
    return step("walls")


@pytest.fixture
def bad(good: Plan) -> Plan:
    plan = replace(good, forces_n=1.1 * good.forces_n)
    assert not check_plan(plan).accepted
    return plan


def refused(accepted: Any, said: str) -> None:
    """Neither is it run, nor does anything move."""
    world = MemoryWorld()
    with pytest.raises(InvalidInput, match=said):
        Runner(world, dry=False).run(accepted)
    assert (world.commands, world.torque_on, world.armed) == ([], False, False)


def test_a_rejected_plan_with_a_digest_made_up_or_borrowed_moves_nothing(good: Plan, bad: Plan) -> None:
    for digest in ("0" * 64, check_plan(bad).digest, check_plan(good).digest):
        refused(Accepted(plan=bad, digest=digest, source="forged"), REJECTED)


def test_an_accepted_plan_with_the_digest_of_another_moves_nothing(good: Plan) -> None:
    refused(Accepted(plan=good, digest="0" * 64, source="forged"), CHANGED)


def test_an_object_whose_digest_agrees_with_everything_moves_nothing(bad: Plan) -> None:
    class Agreeable(str):
        def __eq__(self, other: object) -> bool:
            return True

        def __ne__(self, other: object) -> bool:
            return False

        __hash__ = str.__hash__

    refused(Accepted(plan=bad, digest=Agreeable("0" * 64), source="forged"), REJECTED)


class TwoFaced(Plan):
    """One plan for the verifier, which looks first, and another afterwards."""

    looks = 0

    def __getattribute__(self, name: str) -> Any:
        if name == "forces_n":
            TwoFaced.looks += 1
            return (1.0 if TwoFaced.looks < 3 else 1.1) * object.__getattribute__(self, name)
        return object.__getattribute__(self, name)


def test_a_plan_with_two_faces_is_read_once_and_what_was_read_is_what_is_run(good: Plan) -> None:
    lying = TwoFaced(**{name: getattr(good, name) for name in good.__dataclass_fields__})
    TwoFaced.looks = 2  # the next look gets the other one
    with pytest.raises(InvalidInput, match=REJECTED):
        proven(lying, check_plan(good).digest, "forged")
    TwoFaced.looks = 0
    plain = proven(lying, check_plan(good).digest, "forged")
    assert TwoFaced.looks == 1
    assert type(plain) is Plan
    TwoFaced.looks = 10
    np.testing.assert_array_equal(plain.forces_n, good.forces_n)


def test_numbers_that_change_between_checking_and_arming_are_found_when_it_is_armed(
    good: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = MemoryWorld()
    runner = Runner(world, settings=RunSettings(), dry=False)
    accepted = Accepted.verified(good, "forged")
    prepare = runner.prepare

    def tampered(*arguments: Any) -> Any:
        prepared = prepare(*arguments)
        plan = prepared.motion.plan
        plan.toes_m.setflags(write=True)
        plan.toes_m[0, 2] += 0.01
        return prepared

    monkeypatch.setattr(runner, "prepare", tampered)
    with pytest.raises(InvalidInput, match="arming: expected a plan that the verifier accepts, rejected"):
        runner.run(accepted)
    assert (world.commands, world.torque_on) == ([], False)


def test_what_is_no_plan_at_all_is_refused_in_one_line(good: Plan) -> None:
    for nothing in (None, 3, "plan", object()):
        with pytest.raises(InvalidInput, match="forged: expected a plan or a gait, got what is none: "):
            proven(nothing, "0" * 64, "forged")  # type: ignore[call-overload]


def test_a_gait_whose_digest_was_made_up_or_remembered_moves_nothing(gait: Attempted) -> None:
    good = gait.trajectory
    assert good is not None
    robot, world = walking_robot(good.robot), MemoryWorld()
    higher = good.feet_m.copy()
    higher[:, 0, 2] += 0.05
    bad = replace(good, feet_m=higher)
    bad.__dict__["digest"] = good.digest  # what the class would have remembered of itself
    for trajectory, digest in ((bad, gait.report.digest), (bad, "0" * 64), (good, "0" * 64)):
        with pytest.raises(InvalidInput, match=r"forged: expected (a gait that|what digest)"):
            Runner(world, dry=False).run(
                AcceptedGait(trajectory=trajectory, robot=robot, digest=digest, source="forged")
            )
    assert (world.commands, world.torque_on) == ([], False)
    plain = proven(good, gait.report.digest, "walk")
    assert type(plain) is Trajectory
    np.testing.assert_array_equal(plain.feet_m, good.feet_m)
