"""A leap that makes no sense is refused in one line, and a file gives back what was written."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import (
    read_evidence,
    read_motion,
    write_certificate,
    write_motion,
)
from stancekit.planners.formats.question_file import read_leap
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem.contact import Foothold
from stancekit.planners.problem.leap import (
    BodyState,
    Leap,
    LeapLimits,
    Phase,
    is_drawn,
    is_leap_file,
)
from stancekit.planners.problem.leap_classes import (
    leap_class,
    leap_classes,
    leap_from_keys,
    leap_to_json,
    nameless,
)
from stancekit.planners.robot.model import Limb, hexapod
from stancekit.planners.robot.robot_file import provider_folder
from stancekit.planners.robot.walker import leaping_robot
from stancekit.planners.verify.leaps import check_leap
from tests.refusals import refuses

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def leap() -> Leap:
    return leap_class("leap-hard").draw(np.random.default_rng(1))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"phases": ()},
            "phases",
        ),
        (
            {"phases": (Phase(limbs=("LF",)), Phase(limbs=()))},
            "phases",
        ),
        (
            {"phases": (Phase(limbs=()), Phase(limbs=("LF",)))},
            "phases",
        ),
        (
            {"phases": (Phase(limbs=("XX",)),)},
            "phases[0].limbs",
        ),
        ({"timings_s": ()}, "timings_s"),
        ({"timings_s": ((0.3, 0.3),)}, "timings_s[0]"),
        (
            {"timings_s": ((0.3, -0.1, 0.3),)},
            "timings_s[0]",
        ),
        (
            {"duration_s": 1.0},
            "timings_s[0]",
        ),
        ({"footholds": ()}, "footholds"),
        ({"robot": hexapod()}, "robot.inertia_kgm2"),
        ({"goal_radius_m": 0.0}, "goal_radius_m"),
    ],
)
def test_a_leap_that_makes_no_sense_says_why(leap: Leap, changes, message) -> None:
    with refuses(message):
        replace(leap, **changes)


def test_footholds_are_one_per_landing(leap: Leap) -> None:
    twice = (*leap.footholds, leap.footholds[0])
    with refuses("footholds[8]"):
        replace(leap, footholds=twice)
    with refuses():
        Foothold(limb="LF", frame=0, candidates=())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Phase(limbs=("LF",), intervals=0), "intervals"),
        (
            lambda: LeapLimits(tilt_rad=1.0),
            "tilt_rad",
        ),
        (lambda: LeapLimits(ramp=2.0), "ramp"),
        (lambda: LeapLimits(lift=0.0), "lift"),
        (lambda: BodyState(com_m=np.array([np.nan, 0.0, 0.0])), "com_m"),
        (lambda: leap_class("no"), "distribution"),
    ],
)
def test_parts_of_a_leap_say_what_is_wrong(make, message) -> None:
    with refuses(message):
        make()


def test_limbs_that_stand_on_are_on_one_foothold() -> None:
    robot = nameless()
    drawn = leap_class("leap-hard").draw(np.random.default_rng(0))
    first, last = drawn.footholds[:4], drawn.footholds[4:]
    hop = replace(
        drawn,
        phases=(
            Phase(limbs=robot.limb_names),
            Phase(limbs=("LH", "RH"), intervals=2),
            Phase(limbs=()),
            Phase(limbs=robot.limb_names),
        ),
        timings_s=((0.2, 0.2, 0.32, 0.3),),
        footholds=(*first, *(replace(one, frame=3) for one in last)),
    )
    assert hop.holds.tolist() == [[0, 1, 2, 3], [-1, -1, 2, 3], [-1] * 4, [4, 5, 6, 7]]
    assert hop.times_s(0).tolist() == pytest.approx([0.0, 0.2, 0.3, 0.4, 0.72, 1.02])


def test_a_file_gives_back_the_question_the_plan_and_the_proof(tmp_path) -> None:
    asked = leap_class("leap-given").draw(np.random.default_rng(0))
    outcome = find_leap(asked)
    assert outcome.solution is not None
    report = check_leap(outcome.solution)
    write_motion(tmp_path / "leap.json", outcome.solution, report)
    found, _ = read_motion(tmp_path / "leap.json")
    assert leap_to_json(found.problem) == leap_to_json(asked)
    assert check_leap(found).worst == report.worst
    box = leap_class("leap-anymal").draw(np.random.default_rng(0))
    assert leap_to_json(leap_from_keys(leap_to_json(box), "x")) == leap_to_json(box)
    refused = next(
        outcome
        for seed in range(20)
        if (
            outcome := find_leap(
                leap_class("leap-few").draw(np.random.default_rng(seed)), LeapFinder(solves=2)
            )
        ).certificate
        is not None
    )
    assert refused.certificate is not None
    write_certificate(tmp_path / "none.json", refused.certificate)
    again, _ = read_evidence(tmp_path / "none.json")
    np.testing.assert_array_equal(again.multipliers, refused.certificate.multipliers)


def test_a_robot_whose_urdf_was_changed_in_the_file_is_refused_in_words() -> None:
    data = json.loads((DATA / "leap-hop-anymal.json").read_text())["question"]
    model = data["robot"]["model"]
    model["urdf"] = model["urdf"].replace('effort="80"', 'effort="90"')
    with refuses("leap.json", "robot anymal", "model"):
        leap_from_keys(data, "leap.json")


def test_toes_may_press_less_before_they_lift_than_after_they_land(leap: Leap) -> None:
    found = find_leap(leap_class("leap-given").draw(np.random.default_rng(0))).solution
    assert found is not None
    question = found.problem
    assert "lift" not in leap_to_json(question)["limits"]
    last = int(np.argmax(question.holds[question.interval_phases][:, 0] < 0)) - 1
    normal = max(
        force @ question.patch(j, found.choice).normal
        for j, force in zip(question.holds[0], found.forces_n[last], strict=True)
    )
    share = float(normal) / (question.limits.force_share * question.weight_n)
    for factor, holds in ((1.01, True), (0.9, False)):
        limits = replace(question.limits, lift=factor * share)
        stricter = replace(question, limits=limits)
        assert leap_from_keys(leap_to_json(stricter), "leap").limits.lift == limits.lift
        report = check_leap(replace(found, problem=stricter))
        assert report.accepted is holds
        if not holds:
            assert report.group("force_bounds").when == last
    limits = replace(question.limits, lift=0.1)
    assert [limits.most(*at) for at in ((False, False), (True, False), (False, True))] == (
        pytest.approx([1.2, 0.6, 0.12])
    )


def test_a_damaged_file_is_refused_in_one_line(leap: Leap, tmp_path) -> None:
    good = leap_to_json(leap)
    path = tmp_path / "leap.json"
    for change, message in (
        ({"phases": 3}, "phases: expected a list"),
        (
            {"robot": {**good["robot"], "inertia_kgm2": None}},
            "robot.inertia_kgm2: expected the inertia of nameless",
        ),
        (
            {"footholds": [{**good["footholds"][0], "candidates": []}]},
            "footholds[0]: frame 0, limb LF: expected one or more candidate patches, got none",
        ),
        ({"plan": {}}, "plan"),
        ({"moon": 1}, "moon"),
    ):
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(InvalidInput) as said:
            read_leap(path)
        assert message in str(said.value)
        assert "\n" not in str(said.value)


def test_every_class_draws_the_same_leap_for_the_same_seed() -> None:
    assert "leap-hard" in leap_classes()
    for name in leap_classes():
        if name == "leap-go1" and provider_folder("example-robot-data") is None:
            continue
        first, second = (
            leap_to_json(leap_class(name).draw(np.random.default_rng(4))) for _ in range(2)
        )
        assert first == second


def test_a_walkers_boxes_become_half_spaces_with_limits_of_its_file() -> None:
    robot = leaping_robot("anymal")
    limb = robot.limbs[0]
    assert limb.reach_rows is not None
    assert limb.leg is not None
    assert (limb.leg.speed_m_s, limb.leg.power_w, limb.leg.fold_m) == (3.0, 2400.0, 0.2)
    assert robot.inertia is not None
    with refuses("robot hexapod", "inertia_kgm2"):
        leaping_robot(hexapod())


@pytest.mark.skipif(
    provider_folder("example-robot-data") is None, reason="example-robot-data is not installed"
)
def test_a_models_legs_have_the_speed_and_power_of_their_joints() -> None:
    leg = leaping_robot("go1").limbs[0].leg
    assert leg is not None
    assert leg.power_w == pytest.approx(3 * 23.7 * 30.1, rel=0.01)
    assert 2.0 < leg.speed_m_s < 4.0
    assert 0.0 < leg.fold_m < 0.15


def test_a_limb_without_limits_is_its_shoulder(leap: Leap) -> None:
    bare = Limb(name="A", shoulder_m=np.array([0.1, 0.0, 0.0]), reach_m=0.3)
    assert (leap.leg(bare).speed_m_s, leap.leg(bare).fold_m) == (math.inf, 0.0)
    assert leap.leg(bare).hip_m.tolist() == [0.1, 0.0, 0.0]


def test_a_class_of_ones_own_is_a_file_and_draws_what_its_keys_say(tmp_path):
    same = tmp_path / "leap-same.yaml"
    same.write_text("{jump_m: [0.85, 1.15], friction: [0.1, 0.7]}\n")
    one, other = (
        leap_class(name).draw(np.random.default_rng(3)) for name in (str(same), "leap-hard")
    )
    assert leap_to_json(one) == leap_to_json(other)
    for text, named in (
        ("robott: 3", "robott"),
        ("candidates: 0", "candidates"),
        ("[1, 2]", "leap-same.yaml"),
    ):
        same.write_text(text)
        with refuses(named):
            leap_class(str(same))
    with refuses("leap-none.yaml"):
        leap_class(str(tmp_path / "leap-none.yaml"))


def test_the_names_of_all_classes_are_told_from_those_of_courses(tmp_path, monkeypatch):
    for name in leap_classes():
        assert is_drawn(name)
        assert is_leap_file(f"{name}:7")
    for name in ("walls", "leap-of-nobody", "leaps", "walls:7"):
        assert not is_leap_file(name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "leap-hard").write_text("")  # a file goes before a name
    assert not is_drawn("leap-hard")
