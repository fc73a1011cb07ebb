"""Plan files of a robot's own legs: verified from the file alone, and forgeries, sums and all,
refused or told.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.plan_file import check_file, read_plan, write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.inverse_kinematics import descend
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.postures import LIMIT_RAD, REACHED_M
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names, refuses

COURSE = """
name: flat
robot: dog.urdf
frames: 3
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.1, 0.0, 0.45]
terrain: {kind: flat, friction: 0.7}
"""
Forgery = Callable[[dict[str, Any], dict[str, Any]], None]
"""Changes the header and the arrays of a file."""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(COURSE)
    outcome = TwoStagePlanner().solve(read_course(folder / "flat.yaml"))
    assert outcome.solution is not None
    return with_joints(outcome.solution)


@pytest.fixture
def path(plan: Plan, tmp_path: Path) -> Path:
    write_plan(tmp_path / "plan.json", plan, check_plan(plan, joints=True))
    return tmp_path / "plan.json"


def forged(path: Path, forge: Forgery) -> None:
    """The file as a program leaves it that knows every sum: model, verdict and file are of the
    forged content.
    """
    header = json.loads(path.read_text())
    with np.load(io.BytesIO(base64.b64decode(header["arrays"]["npz"]))) as stored:
        arrays = dict(stored)
    forge(header, arrays)
    if "model" in header["course"]["robot"]:
        header["course"]["robot"]["model"]["digest"] = model_of_header(header).digest
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    header["arrays"]["npz"] = base64.b64encode(buffer.getvalue()).decode()
    course = json.loads(json.dumps(header["course"]))
    numbers = {name: arrays[name].tolist() if name in arrays else None for name in ORDER}
    if "joints_rad" not in arrays:
        del numbers["joints_rad"]
    verdict = header["verdict"]
    content: dict[str, Any] = {"course": course, "plan": numbers}
    content |= {"checked": verdict["checked"]} if verdict["checked"] != ["contacts"] else {}
    verdict["digest"] = digest_of(
        content | {"tolerance": verdict["tolerance"], "accepted": verdict["accepted"]}
    )
    del header["sha256"]
    path.write_text(json.dumps(header | {"sha256": digest_of(header)}))


ORDER = ("com_m", "rotation_rad", "toes_m", "choice", "forces_n", "joints_rad", "modes")


def digest_of(content: dict[str, Any]) -> str:
    return hashlib.sha256(
        json.dumps(content, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


def model_of_header(header: dict[str, Any]) -> RobotModel:
    raw = header["course"]["robot"]["model"]
    return model_of(
        raw["urdf"],
        feet={leg["name"]: leg["foot"] for leg in raw["legs"]},
        name=header["course"]["robot"]["name"],
        posture_rad={
            joint: angle for leg in raw["legs"] for joint, angle in leg["stance_rad"].items()
        },
    )


def in_urdf(old: str, new: str, count: int = -1) -> Forgery:
    def forge(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        model = header["course"]["robot"]["model"]
        assert old in model["urdf"]
        model["urdf"] = model["urdf"].replace(old, new, count)

    return forge


def nothing(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    pass


def test_the_verdict_of_the_file_alone_is_that_of_the_plan(plan: Plan, path: Path) -> None:
    report = check_plan(plan, joints=True)
    check = check_file(path)
    assert check.accepted
    assert [check.report.group(name).verdict for name in ("joints", "torque")] == ["holds"] * 2
    header = json.loads(path.read_text())
    assert header["verdict"]["checked"] == ["contacts", "joints", "torque"]
    parts = ("HAA", "HFE", "KFE")
    assert header["arrays"]["joints"] == [
        f"{leg}_{part}" for leg in ("LF", "RF", "LH", "RH") for part in parts
    ]
    again = read_plan(path)[0]
    assert plan.joints_rad is not None
    np.testing.assert_array_equal(again.joints_rad, plan.joints_rad)
    assert check_plan(again, joints=True).digest == report.digest != check_plan(again).digest


def test_a_file_that_a_program_wrote_anew_is_the_same(path: Path) -> None:
    before = json.loads(path.read_text())["verdict"]["digest"]
    forged(path, nothing)
    assert json.loads(path.read_text())["verdict"]["digest"] == before
    assert check_file(path).accepted


def test_without_joints_in_the_file_the_verifier_finds_some(path: Path) -> None:
    def forge(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        del arrays["joints_rad"]

    forged(path, forge)
    assert read_plan(path)[0].joints_rad is None
    check = check_file(path)
    assert check.accepted
    assert check.report.group("joints").verdict == "holds"


def _shifted(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"][1, 4] += 2.0 * REACHED_M / 0.3


def _swapped(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"] = arrays["joints_rad"][:, [3, 4, 5, 0, 1, 2, *range(6, 12)]]


def _mirrored(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    """The knee bent the other way, where the foot is as before: beyond the knee's limit alone."""
    model = model_of_header(header)
    leg = model.legs[0]
    free = [
        joint.__class__(**{**vars(joint), "lower_rad": -3.0, "upper_rad": 3.0})
        for joint in leg.joints
    ]
    loose = leg.__class__(
        **{
            name: getattr(leg, name) for name in ("name", "chain", "foot", "radius_m", "stance_rad")
        },
        joints=tuple(free),
    )
    q = arrays["joints_rad"][:, :3]
    other, error = descend(loose, leg.chain.feet(q), q * [1, -1, -1] + [0.0, 0.3, 0.0])
    assert error.max() < 1e-6
    assert other[:, 2].min() > leg.upper_rad[2] + LIMIT_RAD
    arrays["joints_rad"][:, :3] = other


def _narrowed(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    """The limit of a joint half way between where it stands and where it goes."""
    model = header["course"]["robot"]["model"]
    stance = {joint: angle for leg in model["legs"] for joint, angle in leg["stance_rad"].items()}
    past = arrays["joints_rad"] - np.array(list(stance.values()))
    frame, joint = np.unravel_index(int(past.argmax()), past.shape)
    name = list(stance)[joint]
    root = ElementTree.fromstring(model["urdf"])
    limit = root.find(f"joint[@name='{name}']/limit")
    assert limit is not None
    limit.set("upper", repr(stance[name] + 0.5 * float(past[frame, joint])))
    model["urdf"] = ElementTree.tostring(root, encoding="unicode")


def _names_swapped(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    legs = header["course"]["robot"]["model"]["legs"]
    legs[0], legs[1] = {**legs[1], "name": "LF"}, {**legs[0], "name": "RF"}
    names = header["arrays"]["joints"]
    header["arrays"]["joints"] = [*names[3:6], *names[:3], *names[6:]]
    header["course"]["robot"]["mass_kg"] = model_of_header(header).body.mass_kg


@pytest.mark.parametrize(
    ("forge", "group"),
    [
        (_shifted, "joints"),
        (_swapped, "joints"),
        (_mirrored, "joints"),
        (_names_swapped, "joints"),
        (in_urdf('0 0 -.3"', '0 0 -.30002"'), "joints"),
        (in_urdf('radius="0.02"', 'radius="0.0201"'), "joints"),
        (_narrowed, "joints"),
        (in_urdf('effort="40.0"', 'effort="1.0"'), "torque"),
        (in_urdf('0.28 -0.14 0"', '0.28 -0.14 0.001"'), "joints"),
    ],
)
def test_a_forged_file_is_refused_whatever_it_says(path: Path, forge: Forgery, group: str) -> None:
    forged(path, forge)
    check = check_file(path)
    assert not check.accepted
    assert check.report.contacts
    assert check.report.group(group).verdict == "violated"
    assert not check.same


@pytest.mark.parametrize("effort", ["1e9", "2000", "0"])
def test_a_torque_limit_that_no_joint_has_is_told_and_counts_for_nothing(
    path: Path, effort: str
) -> None:
    forged(path, in_urdf('effort="40.0"', f'effort="{effort}"', 3))
    check = check_file(path)
    assert check.report.group("torque").verdict == "not checked"
    assert check.report.checked == ("contacts", "joints")
    assert_names(check.message, "torque", "LF_HAA", "LF_HFE", "LF_KFE")
    assert not check.accepted


def _nan(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"][0, 0] = np.nan


def _short(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"] = arrays["joints_rad"][:, :8]


def _renamed(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    header["arrays"]["joints"][0] = "LF_HFE"


def _unnamed(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    del header["arrays"]["joints"]


def _list(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    header["verdict"]["checked"] = ["contacts", "hands"]


@pytest.mark.parametrize(
    ("forge", "name"),
    [
        (_nan, "joints_rad"),
        (
            _short,
            "joints_rad",
        ),
        (_renamed, "arrays.joints"),
        (_unnamed, "arrays.joints"),
        (_list, "verdict.checked"),
        (
            in_urdf('<mass value="10.0"/>', '<mass value="10.001"/>'),
            "robot quadruped",
        ),
    ],
)
def test_a_file_that_contradicts_itself_is_no_plan(path: Path, forge: Forgery, name: str) -> None:
    forged(path, forge)
    with refuses(path, name):
        check_file(path)


def test_what_was_checked_is_under_the_digest(path: Path) -> None:
    header = json.loads(path.read_text())
    header["verdict"]["checked"] = ["contacts"]
    del header["sha256"]
    path.write_text(json.dumps(header | {"sha256": digest_of(header)}))
    with refuses("digest"):
        check_file(path)


def test_a_robot_that_is_named_has_to_be_the_files(path: Path) -> None:
    assert check_file(path, robot=model_of(quadruped())).accepted
    stronger = model_of(quadruped(effort=60.0))
    forged(path, in_urdf('effort="40.0"', 'effort="60.0"'))
    assert check_file(path).accepted  # it is a plan for such a robot
    assert check_file(path, robot=stronger).accepted
    with pytest.raises(InvalidInput) as caught:
        check_file(path, robot=model_of(quadruped()))
    assert_names(str(caught.value), path)


def test_links_that_only_the_file_lets_touch_are_not_the_robots(path: Path) -> None:
    def lets_touch(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        header["course"]["robot"]["model"]["disabled_pairs"] = [["LF_FOOT", "RF_FOOT"]]

    forged(path, lets_touch)
    assert check_file(path).accepted
    with refuses("quadruped"):
        check_file(path, robot=model_of(quadruped()))
