"""Every gait, walked once over the reference ripples, and the verifier's word on what comes out."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stancekit import Motion, Report
from stancekit.cli.main import main
from stancekit.envs.warped_gait import WarpedGaitEnv
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import check_file
from stancekit.planners.gait.charts import CHARTS
from stancekit.planners.gait.forbidden import GradientBoxes, forbidden, unheld
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.gait.method.attempt import smoothed
from stancekit.planners.gait.method.portfolio import plan_gait
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import GAITS, Walk
from stancekit.planners.robot.walker import anymal, hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import TERRAINS, named_terrain, reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import assert_names, refuses


@pytest.mark.parametrize("gait", sorted(GAITS))
def test_every_gait_crosses_ripples_and_the_verifier_accepts_it(gait: str) -> None:
    robot = hexapod_walker() if gait == "tripod" else anymal()
    goal = np.array([0.3, 0.09]) if gait == "tripod" else np.array([0.6, 0.18])
    task = Walk(
        robot=robot,
        terrain=reference_terrain("ripple"),
        start=np.zeros(2),
        goal=goal,
        gait=gait,
        start_yaw_rad=float(np.arctan2(goal[1], goal[0])),
        duration_s=3.0,
    )
    # the tripod's guess is far off: no larger barriers; where a bound's walk ends depends on the
    # processor's last bits: from one of two
    barriers = {"tripod": [{"mu_max": 1.0}], "bound": [{}, {"mu_max": 1.0}]}
    reports = list[Report[Motion]]()
    for options in barriers.get(gait, [{}]):
        found = formulate(task).solve(**options)
        reports.append(check_trajectory(found.trajectory()))
        if (
            not reports[-1].accepted
        ):  # hasty gaits: what the nodes allow swings too much between them until it is smoothed
            assert gait in ("pace", "bound")
            for done in smoothed(found):
                reports.append(done.report)
                if done.report.accepted:
                    break
        if reports[-1].accepted:
            break
    assert found.success
    assert reports[-1].accepted, [report.message for report in reports]


CHART = '''
"""The shear with the torso's height counted from elsewhere: the same walk, other numbers."""

from stancekit.planners.gait.charts.warped import Shear


class Lifted(Shear):
    """The torso's height counts from 10 cm above the ground."""

    def torso(self, bar, expansion):
        p, rotation = super().torso(bar, expansion)
        p[2] += 0.1
        return p, rotation

    def torso_bar(self, p_WB):
        return super().torso_bar(p_WB) - [0.0, 0.0, 0.1]


class NoChart:
    pass
'''
TERRAIN = '''
"""A bump, and a field of one's own."""

import numpy as np

from stancekit.planners.terrain.heightfield import HeightField


def bump(x, y):
    return 0.08 * np.exp(-(x**2) - y**2)


plain = HeightField(np.linspace(-2.0, 2.0, 9), np.linspace(-2.0, 2.0, 9), np.zeros((9, 9)), "plain")
number = 3
'''


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(CHART)
    Path("ground.py").write_text(TERRAIN)
    return tmp_path


def test_a_chart_of_ones_own_finds_the_walk_of_its_sibling(files: Path) -> None:
    field = HeightField.from_function(lambda x, y: 0.05 * np.sin(2.0 * x) * np.cos(y), 2.0, 0.1)
    task = Walk(robot=anymal(), terrain=field, start=[0.0, 0.0], goal=[0.2, 0.1], duration_s=2.0)
    own = formulate(task, GaitSettings(chart="mine.py:Lifted")).solve()
    other = formulate(task, GaitSettings(chart="shear")).solve()
    assert own.success
    assert own.trajectory().provenance["chart"] == "mine.py:Lifted"
    np.testing.assert_allclose(own.trajectory().torso_m, other.trajectory().torso_m, atol=1e-6)
    heights = own.program.structure.layout.torso[:, 2]
    np.testing.assert_allclose(own.x[heights], other.x[heights] - 0.1, atol=1e-6)


def test_the_command_line_takes_both_by_file_and_name(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--goal", "0.2,0.1", "--duration-s", "2", "--raw", "--out", "walk.json", "--json"]
    with pytest.raises(SystemExit) as ended:
        main(["gait", "ground.py:bump", "--chart", "mine.py:Lifted", *asked])
    assert ended.value.code == 0
    assert json.loads(capsys.readouterr().out)["attempts"][0]["chart"] == "mine.py:Lifted"
    report = check_file("walk.json").report
    assert report.accepted
    assert report.answer.problem.terrain.name == "ground.py:bump"
    assert float(report.answer.problem.terrain.height(np.zeros(2))) == pytest.approx(0.08, abs=1e-6)


def test_a_height_field_in_a_file_is_taken_as_it_is(files: Path) -> None:
    assert named_terrain("ground.py:plain").x_m.tolist() == np.linspace(-2.0, 2.0, 9).tolist()


def test_the_environment_chooses_among_charts_and_terrains_of_ones_own(files: Path) -> None:
    env = WarpedGaitEnv("ground.py:bump", charts=("shear", "mine.py:Lifted"))
    observation, _ = env.reset(seed=0)
    assert np.abs(observation["heights"]).max() > 0.001
    assert env.action_space.nvec[0] == 2
    assert env.step(np.array([1, 0, 0]))[-1]["feasible"] == 1


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda: CHARTS.get("mine.py:NoChart"),
            "chart mine.py:NoChart: expected a class of charts, as those in ",
        ),
        (
            lambda: GaitSettings(chart="polar"),
            "chart: expected one of ambient, shear, decoupled, warped, ",
        ),
        (
            lambda: TERRAINS.get("ground.py:number"),
            "terrain ground.py:number: expected a height field, or ",
        ),
        (
            lambda: named_terrain("ground.py"),
            "terrain: expected FILE.py:NAME, got no name after ground.py",
        ),
    ],
)
def test_what_is_none_is_refused(files: Path, ask, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInput) as refused:
        ask()
    assert str(refused.value).startswith(message)


TURNS = (0.0, 0.9, 2.3, 4.0, 5.5)


def ramp(slope: float, turn: float) -> HeightField:
    return HeightField.from_function(
        lambda x, y: slope * (np.cos(turn) * x + np.sin(turn) * y), 3.0, 0.1, name=f"ramp {slope:g}"
    )


def task(terrain: HeightField, friction: float, goal=(0.5, 0.2), **options) -> Walk:
    return Walk(
        robot=options.pop("robot", None) or anymal(),
        terrain=terrain,
        start=np.zeros(2),
        goal=np.array(goal),
        friction=friction,
        **options,
    )


@pytest.mark.parametrize(("share", "turn"), [*product((1.1, 1.3, 2.0), TURNS)])
def test_nobody_stands_on_a_ramp_steeper_than_friction_holds(share: float, turn: float) -> None:
    """The angle of friction is the angle of repose: tan of it is ν (0.02 of it are the
    verifier's).
    """
    friction = 0.4
    said = forbidden(task(ramp(share * friction + 0.02, turn), friction), GaitSettings())
    assert said.startswith(
        "at rest at the start (0, 0) no stance carries the weight: all ground within 0."
    )


@pytest.mark.parametrize(("share", "turn"), [*product((0.9, 0.95, 0.99, 1.0), TURNS)])
def test_a_ramp_that_friction_holds_is_never_forbidden(share: float, turn: float) -> None:
    assert forbidden(task(ramp(share * 0.4, turn), 0.4), GaitSettings()) == ""


@pytest.mark.parametrize("duration_s", [1.6, 2.0, 3.0, 4.0, 6.0])
def test_ice_is_forbidden_where_pushing_and_braking_do_not_bring_the_body_there(
    duration_s: float,
) -> None:
    """On level ground ν g T²/4 is the farthest from rest to rest, pushed half the time and braked
    the other half.
    """
    level, friction, foot = ramp(0.0, 0.0), 0.001, anymal().feet
    reach = max(
        np.linalg.norm(np.maximum(np.abs(each.reach_min_m), np.abs(each.reach_max_m)))
        for each in foot
    )
    half, whole = (
        0.25 * 9.81 * duration_s**2 + 4.0 * reach,
        0.5 * 9.81 * duration_s**2 + 2.0 * reach,
    )
    farthest = (friction + 0.02) * min(half, whole)  # the body may rise as far as its feet reach
    for share in (0.95, 0.99, 1.01, 1.5):
        if share * farthest <= 2.0:
            said = forbidden(
                task(level, friction, (share * farthest, 0.0), duration_s=duration_s),
                GaitSettings(),
            )
            assert ("from rest to rest" in said) == (share > 1.0), said
    goal = (min(1.05 * farthest, 2.0), 0.0)
    leaps = task(
        level, friction, goal, duration_s=duration_s, timings="optimised"
    )  # all feet may be in the air
    assert bool(forbidden(leaps, GaitSettings())) == (goal[0] > (friction + 0.02) * whole)
    possible = friction * 0.25 * 9.81 * duration_s**2
    assert (
        forbidden(
            task(level, friction, (0.99 * possible, 0.0), duration_s=duration_s), GaitSettings()
        )
        == ""
    )


def test_suction_that_does_not_hold_the_weight_is_no_way_up() -> None:
    """On a ramp of angle α a foot's pull s adds no more than s to what the angle of friction
    lacks.
    """
    friction, sticks = 0.3, (True, True, False, False)
    steep, weight = ramp(0.9, 0.0), anymal().weight_n
    said = [
        forbidden(task(steep, friction, adhesive=sticks, suction_n=share * weight), GaitSettings())
        for share in (0.0, 0.05, 0.5)
    ]
    assert said[0]
    assert "and suction of 30 N holds" in said[1]
    assert said[2] == ""


def test_the_benchmarks_are_not_forbidden_and_neither_is_what_sticks() -> None:
    for name, start, goal in (("ripple", (0, 0), (1.8, 0.5)), ("cone", (-2.2, 0), (0.5, 0.2))):
        assert forbidden(Walk.over(name, goal, start=start), GaitSettings()) == ""
    assert not forbidden(
        task(ramp(0.9, 0.0), 0.3, adhesive=(True, True, False, False)), GaitSettings()
    )
    assert forbidden(
        task(ramp(0.9, 0.0), 0.3, robot=hexapod_walker(), gait="tripod", goal=(0.2, 0.0)),
        GaitSettings(),
    )


def test_the_boxes_hold_every_gradient() -> None:
    """The spline's own gradient at random points is within the corners of its cell."""
    terrain, rng = reference_terrain("ripple"), np.random.default_rng(0)
    boxes = GradientBoxes(terrain)
    for xy in rng.uniform(-3.0, 3.0, (50, 2)):
        corners = boxes.normals(xy, 1e-6)
        slopes = -corners[:, :2] / corners[:, 2:]
        gradient = terrain.gradient(xy)
        assert np.all(gradient >= slopes.min(axis=0) - 1e-9)
        assert np.all(gradient <= slopes.max(axis=0) + 1e-9)


def test_a_plan_of_a_forbidden_walk_is_its_reason_and_no_solve() -> None:
    up = Walk.over("hill", (-0.4, 0.35), start=(-2.6, 0.0))
    for walk, names in (
        (task(ramp(0.6, 0.0), 0.3), ("start (0, 0)", "weight")),
        (up, ("undecided", "(-1.", "friction 0.75", "chart NAME")),
        (Walk.over("hill", up.start, start=up.goal), ("undecided", "(-0.", "friction 0.75")),
    ):
        assert_names(plan_gait(walk).message, *names)
        assert plan_gait(walk).solves == ()
    valley = 0.9 * np.outer(np.linspace(-1.0, 5.0, 121).clip(0, 1), abs(np.arange(121) - 59.5) / 20)
    between = HeightField.from_array(valley, spacing_m=0.05)  # two walls, which feet press on
    for ground, feet, friction in (
        (up.terrain.scaled(0.9), (), 0.75),
        ("hill", ("LF", "RF"), 0.75),
        (between, (), 0.3),
    ):
        assert not unheld(
            Walk.over(ground, up.goal, start=up.start, adhesive=feet, friction=friction)
        )
    with refuses("friction"):
        task(ramp(0.6, 0.0), 0.0)
