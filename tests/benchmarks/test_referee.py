"""The referee: a box robot carries its weight, falls where it should, and every option does
something.
"""

from __future__ import annotations

import base64
import io
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.referee import BrokenFile, Push, Row, Wrong, play, pushed, read, read_settings
from benchmarks.referee.feedback import shared
from benchmarks.referee.ground import Surface
from benchmarks.referee.simulation import prepared
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses

ROOT = Path(__file__).resolve().parents[2]
LEAP = ROOT / "tests" / "data" / "leap-hop-anymal.json"
SETTINGS = read_settings()
LEGS = ("LF", "RF", "LH", "RH")
BENT = {"HAA": 0.0, "HFE": 0.7, "KFE": -1.4}
MASS_KG, HALF_M, HEIGHT_M, GRAVITY = 22.4, (0.3, 0.07), 0.46, 9.81
PLATE = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
Changes = Mapping[str, Any]


def robot() -> dict[str, Any]:
    legs = [
        {
            "name": name,
            "foot": f"{name}_FOOT",
            "stance_rad": {f"{name}_{joint}": angle for joint, angle in BENT.items()},
        }
        for name in LEGS
    ]
    limbs = [{"name": name, "shoulder_m": [0.0, 0.0, 0.0], "reach_m": 1.0} for name in LEGS]
    model = {"urdf": quadruped(), "legs": legs, "disabled_pairs": [], "digest": ""}
    return {"name": "box", "mass_kg": MASS_KG, "limbs": limbs, "model": model}


def toes() -> np.ndarray:
    """Under the body, nearer to each other than its hips are."""
    x, y = HALF_M
    return np.array([[x, y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [-x, -y, 0.0]])


def plan(
    path: Path, com: list[list[float]], friction: float = 0.8, tilt_rad: float = 0.0, **changes: Any
) -> Path:
    """A plan that stands on four feet at these centres of mass, as the package would write it; the
    ground leans.
    """
    turn = np.array(
        [
            [np.cos(tilt_rad), 0.0, np.sin(tilt_rad)],
            [0.0, 1.0, 0.0],
            [-np.sin(tilt_rad), 0.0, np.cos(tilt_rad)],
        ]
    )
    patch = {
        "vertices_m": (np.array(PLATE) @ turn.T).tolist(),
        "normal": turn[:, 2].tolist(),
        "shear_reference": [1.0, 0.0, 0.0],
        "friction": friction,
    }
    frames, at = len(com), toes() @ turn.T
    course = {
        "format": "stancekit/course/1",
        "robot": robot(),
        "terrain": [patch],
        "placements": [
            {"limb": name, "frame": 0, "toe_m": None, "candidates": [patch]} for name in LEGS
        ],
        "lifts": [[]] * frames,
        "next_lift": [],
        "gravity_m_s2": GRAVITY,
    }
    forces = np.array([carried(at, np.array(each)) for each in com])
    arrays = {
        "com_m": np.array(com),
        "rotation_rad": np.zeros((frames, 3)),
        "toes_m": at,
        "choice": np.zeros(4, dtype=int),
        "forces_n": forces,
    }
    content = {
        "format": "stancekit/motion/1",
        "question": course,
        "columns": {"npz": packed(arrays)},
    }
    path.write_text(json.dumps(content | changes))
    return path


def carried(at: np.ndarray, com: np.ndarray) -> np.ndarray:
    """Upright forces that balance the weight, as even as they can be."""
    rows = np.vstack([np.ones(4), at[:, 0] - com[0], at[:, 1] - com[1]])
    up = np.linalg.lstsq(rows, np.array([MASS_KG * GRAVITY, 0.0, 0.0]), rcond=None)[0]
    return np.column_stack([np.zeros((4, 2)), up])


def packed(arrays: Mapping[str, np.ndarray]) -> str:
    file = io.BytesIO()
    np.savez(file, **dict(arrays))
    return base64.b64encode(file.getvalue()).decode()


def walk(path: Path, **changes: Any) -> Path:
    """A walk that stands for half a second on heights that lean along y."""
    x = np.linspace(-1.0, 1.0, 9)
    heights = np.tile(0.05 * x, (9, 1))
    samples, at = 101, toes()
    at[:, 2] = 0.05 * at[:, 1]
    com = np.array([0.0, 0.0, HEIGHT_M])
    arrays = {
        "times_s": 0.005 * np.arange(samples),
        "torso_m": np.tile(com, (samples, 1)),
        "rotation": np.tile(np.eye(3), (samples, 1, 1)),
        "feet_m": np.tile(at, (samples, 1, 1)),
        "forces_n": np.tile(carried(at, com), (samples, 1, 1)),
        "contact": np.ones((samples, 4), dtype=bool),
        "terrain_x_m": x,
        "terrain_y_m": x,
        "terrain_heights_m": heights,
    }
    its = robot()
    its["feet"] = [{"name": name} for name in LEGS]
    del its["limbs"]
    asked = {"robot": its, "friction": 0.7, "adhesive": [False] * 4, **changes}
    question = {"format": "stancekit/walk/1", **asked}
    columns = {"npz": packed(arrays)}
    content = {"format": "stancekit/motion/1", "question": question, "columns": columns}
    path.write_text(json.dumps(content))
    return path


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plan(tmp_path_factory.mktemp("plans") / "standing.json", [[0.0, 0.0, HEIGHT_M]])


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    com = [[0.0, 0.0, HEIGHT_M], [0.06, 0.0, HEIGHT_M]]
    return plan(tmp_path_factory.mktemp("plans") / "moving.json", com)


@pytest.fixture(scope="module")
def moved(moving: Path) -> Row:
    return play(moving, SETTINGS)


def test_it_imports_nothing_of_the_package() -> None:
    script = (
        "import sys; sys.modules['stancekit'] = None; import referee.__main__; "
        "print([name for name in sys.modules if name.startswith('stancekit.')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT / "benchmarks",
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_a_robot_that_stands_is_carried_with_its_weight(standing: Path) -> None:
    row = play(standing, SETTINGS)
    assert row.stood
    assert row.fell_s is None
    assert row.carried == pytest.approx(1.0, abs=1e-3)
    assert row.most_mm < 0.5
    assert row.slide_mm < 0.5
    assert row.bumped_s == 0.0


def test_a_plan_whose_body_is_10_cm_aside_falls(tmp_path: Path) -> None:
    row = play(plan(tmp_path / "aside.json", [[0.0, 0.1, HEIGHT_M]]), SETTINGS)
    assert not row.stood
    assert row.fell_s is not None
    assert row.fell_s < row.of_s


def test_feedback_does_not_hold_what_nothing_holds(tmp_path: Path) -> None:
    row = play(
        plan(tmp_path / "aside.json", [[0.0, 0.1, HEIGHT_M]]), SETTINGS, Wrong(feedback=True)
    )
    assert not row.stood


def test_friction_holds_on_a_slope_as_far_as_it_goes(tmp_path: Path) -> None:
    file = plan(tmp_path / "slope.json", [[0.0, 0.0, HEIGHT_M]], friction=0.5, tilt_rad=0.3)
    assert play(file, SETTINGS).slide_mm < 20.0
    assert play(file, SETTINGS, Wrong(friction=0.5)).slide_mm > 100.0  # .25 < tan .3


def test_a_body_that_moves_over_its_feet_rolls_on_them(moved: Row) -> None:
    assert moved.stood
    assert moved.slide_mm < 0.5
    assert moved.end_mm < 0.5


def test_the_same_twice(moving: Path, moved: Row) -> None:
    assert play(moving, SETTINGS) == moved


def test_a_push_is_held_as_long_as_the_feet_are_wide(standing: Path) -> None:
    stiff = Wrong(stiffness=10.0)
    base_m = float(prepared(read(standing), SETTINGS, stiff)[2].positions[-1, 2])
    tips = MASS_KG * GRAVITY * HALF_M[1] / base_m  # about the line of two toes, were it rigid
    row = play(standing, SETTINGS, stiff, Push(most_n=100.0, towards_deg=90.0))
    assert row.held_n == pytest.approx(tips, rel=0.2)
    soft = play(standing, SETTINGS, push=Push(most_n=100.0, towards_deg=90.0))
    assert soft.held_n is not None
    assert row.held_n is not None
    assert soft.held_n < 0.8 * row.held_n  # joints give way, and the body leans before it tips
    along = play(standing, SETTINGS, push=Push(most_n=10.0, towards_deg=0.0))
    assert (along.held_n, along.fell_s) == (10.0, None)


def test_a_walk_that_stands_on_heights_stands(tmp_path: Path) -> None:
    row = play(walk(tmp_path / "walk.json"), SETTINGS)
    assert row.stood
    assert row.carried == pytest.approx(1.0, abs=2e-3)
    assert row.most_mm < 3.0


def test_a_leap_lands_on_its_patches_and_stands() -> None:
    row = play(LEAP, SETTINGS, Wrong(feedback=True))
    assert row.stood
    assert row.of_s == pytest.approx(SETTINGS.timing.rest_s + 1.78 + 2.0, abs=0.01)
    assert row.carried == pytest.approx(1.0, abs=0.01)
    assert row.missed_mm < 1.0


def test_a_leap_whose_toes_are_unloaded_before_they_lift_goes_where_it_is_planned(
    tmp_path: Path,
) -> None:
    """A push that ends at full force loses some: no control lets go of it within an instant."""
    from stancekit.planners.equilibrium.programs import Programs
    from stancekit.planners.formats.motion_file import read_motion, write_motion
    from stancekit.planners.leap.bend import LeapBender
    from stancekit.planners.verify.leaps import check_leap

    plan, _ = read_motion(LEAP)
    _, eased = LeapBender(Programs()).bent(plan)
    write_motion(tmp_path / "leap.json", eased.plan, check_leap(eased.plan))
    before, after = (play(path, SETTINGS) for path in (LEAP, tmp_path / "leap.json"))
    assert before.most_mm > 15.0
    assert after.stood
    assert after.most_mm < 0.5 * before.most_mm


def test_a_leap_on_ice_does_not_stand() -> None:
    assert not play(LEAP, SETTINGS, Wrong(feedback=True, friction=0.02)).stood


def test_the_referee_has_a_leap_as_the_package_has_it() -> None:
    """Body, feet, contacts and forces, each by its own code from one file."""
    from stancekit.planners.formats.motion_file import read_motion
    from stancekit.planners.motion.leap_motion import leap_motion

    plan, _ = read_motion(LEAP)
    ours, reference = (
        leap_motion(plan, settle_s=SETTINGS.timing.rest_s),
        prepared(read(LEAP), SETTINGS, Wrong())[1],
    )
    times = SETTINGS.control_s * np.arange(1, len(reference.com_m) + 1)
    sample = ours.at(times)
    np.testing.assert_allclose(reference.com_m, sample.com_m, atol=1e-6)
    np.testing.assert_allclose(reference.centres_m, sample.feet_m, atol=5e-3)
    assert (reference.stands == (sample.foothold >= 0)).mean() > 0.99
    flies = ~reference.stands.any(axis=1)
    assert np.count_nonzero(flies) > 30
    assert not reference.forces_n[flies].any()


def test_a_leap_without_footholds_gives_one_line(tmp_path: Path) -> None:
    data = json.loads(LEAP.read_text())
    path = tmp_path / "leap.json"
    data["question"]["footholds"].pop()
    path.write_text(json.dumps(data))
    with refuses("footholds", kind=BrokenFile):
        read(path)


def test_no_stance_of_a_leap_is_pushed() -> None:
    with refuses("push", kind=BrokenFile):
        play(LEAP, SETTINGS, push=Push(most_n=10.0))


def test_heights_go_through_their_points_and_on_straight() -> None:
    x = np.array([0.0, 0.3, 0.5, 0.9, 1.0])
    y = np.linspace(-1.0, 1.0, 6)
    heights = np.sin(3.0 * x)[:, None] + np.cos(2.0 * y)[None, :]
    surface = Surface(x, y, heights)
    np.testing.assert_allclose(surface.heights(x[:, None], y[None, :]), heights, atol=1e-12)
    beyond = surface.heights(np.array([1.1, 1.2, 1.3]), np.zeros(3))
    assert np.diff(beyond, 2) == pytest.approx(0.0, abs=1e-6)


def test_feet_share_a_wrench_that_their_cones_can_carry() -> None:
    arms = toes() - [0.0, 0.0, HEIGHT_M]
    up, friction = np.tile([0.0, 0.0, 1.0], (4, 1)), np.full(4, 0.8)
    planned = carried(toes(), np.array([0.0, 0.0, HEIGHT_M]))
    wanted = np.array([20.0, -10.0, 0.0, 0.0, 0.0, 1.0])
    found = shared(SETTINGS.feedback, wanted, arms, planned, up, friction)
    change = found - planned
    moment = np.cross(arms, change).sum(axis=0)
    np.testing.assert_allclose([*change.sum(axis=0), *moment], wanted, atol=0.5)
    more = shared(SETTINGS.feedback, 100.0 * wanted, arms, planned, up, friction)
    assert (np.linalg.norm(more[:, :2], axis=1) <= 0.8 * 0.9 * more[:, 2] + 1e-9).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"format": "stancekit/plan/1"}, "expected the format"),
        (
            {"question": {"format": "stancekit/course/1"}},
            "expected the key 'robot', found nothing there",
        ),
        ({"columns": {"npz": "no"}}, "expected an archive of arrays in base64, got none"),
        (
            {"columns": {"npz": packed({name: np.zeros(2) for name in ("com_m", "rotation_rad")})}},
            "com_m: expected finite numbers of shape (1, 3), got float64 of shape (2,)",
        ),
        ({"columns": {"npz": packed({"points_m": np.zeros(1)})}}, "got soles"),
    ],
)
def test_a_broken_plan_gives_one_line(changes: Changes, said: str, tmp_path: Path) -> None:
    file = plan(tmp_path / "plan.json", [[0.0, 0.0, HEIGHT_M]], **dict(changes))
    with pytest.raises(BrokenFile) as raised:
        play(file, SETTINGS)
    message = str(raised.value)
    assert message.startswith(f"{file}: ")
    assert said in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "1", '{"format": 3}', '{"format": "stancekit/motion/1"}']
)
def test_what_is_no_file_gives_one_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "file.json"
    file.write_text(text)
    with pytest.raises(BrokenFile) as raised:
        read(file)
    assert "\n" not in str(raised.value)
    with refuses("none.json", kind=BrokenFile):
        read(tmp_path / "none.json")


def test_a_joint_with_two_axes_has_the_first(standing: Path, tmp_path: Path) -> None:
    data = json.loads(standing.read_text())
    model = data["question"]["robot"]["model"]
    model["urdf"] = model["urdf"].replace(
        '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>'
    )
    (tmp_path / "twice.json").write_text(json.dumps(data))
    assert play(tmp_path / "twice.json", SETTINGS) == play(standing, SETTINGS)


def test_feet_that_stick_are_refused(tmp_path: Path) -> None:
    with refuses("adhesive", kind=BrokenFile):
        play(walk(tmp_path / "walk.json", adhesive=[True] * 4), SETTINGS)


def test_pushes_that_are_prepared_together_are_those_prepared_alone(standing: Path) -> None:
    pushes = [Push(most_n=8.0, towards_deg=90.0), Push(most_n=4.0, towards_deg=180.0)]
    together = list(pushed(standing, SETTINGS, Wrong(feedback=True), pushes))
    assert together == [
        play(standing, SETTINGS, Wrong(feedback=True), push=each) for each in pushes
    ]
    assert [row.held_n for row in together] == [8.0, 4.0]
