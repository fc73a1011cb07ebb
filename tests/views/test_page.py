"""Pages: one file with everything in it, which headless Chromium opens from disk without a
network.
"""

from __future__ import annotations

import re
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit import Motion, WalkQuestion
from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.views import page as page_module
from stancekit.views.gaits import GaitView
from stancekit.views.page import Stage, page, quaternion
from stancekit.views.plans import PlanView
from stancekit.views.scene import along
from stancekit.views.sheet import ACCENT
from tests.emulators.chromium import CHROMIUM, PATIENCE_S, opened


@pytest.fixture(scope="module")
def plan(course_plan):
    return course_plan("icy-walls", 2)


@pytest.fixture(scope="module")
def walk() -> GaitView:
    """ANYmal's body glides over a swell, all feet down, then two; for the eye alone."""
    robot, share = anymal(), np.linspace(0.0, 1.0, 41)
    field = HeightField.from_function(
        lambda x, y: 0.1 * np.sin(3.0 * x), 1.5, 0.1, name="</script><b>swell"
    )
    torso = np.column_stack([0.4 * share, 0.0 * share, 0.5 + 0.0 * share])
    contact = np.array([[k < 20 or foot < 2 for foot in range(4)] for k in range(41)])
    trajectory = Motion(
        times_s=0.05 * np.arange(41),
        torso_m=torso,
        rotation=Rotation.from_euler("z", 0.3 * share[:, None]).as_matrix(),
        feet_m=torso[:, None] + np.array([foot.nominal_m for foot in robot.feet]),
        contact=contact,
        forces_n=np.where(contact[..., None], [0.0, 0.0, 70.0], 0.0),
        problem=WalkQuestion(
            robot=robot,
            terrain=field,
            friction=0.6,
            adhesive=[False] * 4,
            start=torso[0, :2],
            goal=torso[-1, :2],
        ),
    )
    return GaitView(trajectory)


def page_of(motion):
    try:
        return page(motion)
    except InvalidInput as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def plan_page(plan):
    return page_of(PlanView(plan).film(step_s=0.2))


@pytest.fixture(scope="module")
def walk_page(walk):
    return page_of(replace(walk, report=check_trajectory(walk.trajectory)).film())


def test_the_page_holds_everything_that_it_shows(plan_page, walk_page):
    assert re.search(r"<title>icy-walls, at [\d.]+ times its pace</title>", plan_page)
    assert re.search(r"<b>icy-walls, at [\d.]+ times its pace</b>", plan_page)
    assert "ice, μ = 0" in plan_page
    assert "friction μ = 1" in plan_page
    assert "path of the centre of mass" in plan_page
    assert f"{ACCENT}" in walk_page  # the verifier's word is bad news
    for name in anymal().limb_names:
        assert f"</span>{name}</div>" in walk_page
    for text in (plan_page, walk_page):
        assert text.startswith("<!doctype html>")
        assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", text[: text.index("<script")])
        assert set(re.findall(r"https?://[\w.]+", text)) <= {
            "http://www.w3.org"
        }  # the name of SVG, not a place to go
        assert len(text) < 3_000_000


def test_names_are_text_and_no_markup(plan, walk_page):
    shown = page_of(
        PlanView(
            replace(plan, problem=replace(plan.problem, name="<script>alert(1)</script>"))
        ).film(step_s=0.2)
    )
    assert "<script>alert" not in shown
    assert "&lt;script&gt;alert" in shown
    assert "anymal over &lt;/script&gt;&lt;b&gt;swell" in walk_page
    assert "</script><b>" not in walk_page


@pytest.mark.parametrize("subject", ["plan", "walk"])
def test_nodes_follow_the_motion(subject, plan, walk):
    """What a page records of bodies, forces and notes is what the moments have, and what is not
    there is hidden.
    """
    motion = PlanView(plan).film(step_s=0.2) if subject == "plan" else walk.film(step_s=0.5)
    try:
        server = page_module.viser_server()
        with server as shown:
            stage = Stage(shown.scene, motion.camera.distance_m)
            names = set()
            for moment, note in zip(
                motion.moments, motion.notes or [""] * len(motion.moments), strict=True
            ):
                stage.pose(moment, note)
                nodes = {name: node for name, node in stage._nodes.items() if node.visible}
                forces = [arrow for arrow in moment.arrows if arrow.visible]
                expected = {f"/bodies/{body.name}" for body in moment.bodies} | {
                    f"/forces/{each.name}" for each in forces
                }
                assert set(nodes) == expected | ({f"/notes/{note}"} if note else set())
                for body in moment.bodies:
                    node = nodes[f"/bodies/{body.name}"]
                    place = [*node.position, *node.wxyz]
                    turn = Rotation.from_matrix(body.rotation).as_quat(scalar_first=True)
                    turn *= np.sign(turn @ node.wxyz)  # both are this rotation
                    assert np.allclose(
                        place, [*body.position_m, *turn], atol=1e-6
                    )  # viser leaves what np.allclose is
                for arrow in forces:
                    ends = [[arrow.start_m, arrow.start_m + arrow.vector_m]]
                    assert np.allclose(nodes[f"/forces/{arrow.name}"].points, ends, atol=1e-6)
                names |= set(nodes)
            assert names == set(stage._nodes)
    except InvalidInput as error:
        pytest.skip(str(error))


def test_recording_says_nothing_on_standard_output(plan, capsys):
    page_of(PlanView(plan).film(step_s=0.1))
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")


def is_climb(shown):
    """Terrain, ice, and dark limbs or the path of the centre of mass; faces, not their borders
    alone.
    """
    red, green, blue = (shown[..., k] for k in range(3))
    rough, icy = (green - blue > 0.08) & (green > 0.4), (blue - red > 0.05) & (blue > 0.6)
    faces = (shown[190:400].min(axis=-1) < 0.9).mean()
    return (
        min(rough.mean(), icy.mean(), 0.1 * faces) > 0.01
        and (shown.max(axis=-1) < 0.45).mean() > 0.001
    )


def is_walk(shown):
    """Below the legend: the grey of the block, dark limbs, and the red of the forces."""
    part = shown[190:400]
    red, green, blue = (part[..., k] for k in range(3))
    grey = (np.abs(part.max(axis=-1) - 0.6) < 0.15) & (np.ptp(part, axis=-1) < 0.1)
    forces = red - np.maximum(green, blue) > 0.2
    return grey.mean() > 0.02 and forces.sum() > 5 and (part.max(axis=-1) < 0.45).sum() > 20


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """A tab of Chromium."""
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with opened("about:blank", tmp_path_factory.mktemp("profile")) as tab:
        yield tab


@pytest.mark.parametrize(("subject", "is_seen"), [("plan_page", is_climb), ("walk_page", is_walk)])
def test_headless_chromium_opens_it_from_disk_without_a_network(
    subject, is_seen, request, tab, tmp_path
):
    (tmp_path / "page.html").write_text(request.getfixturevalue(subject))
    tab.ask("Page.navigate", url=(tmp_path / "page.html").as_uri())
    assert any(map(is_seen, pictures_of(tab))), f"nothing was to be seen within {PATIENCE_S:g} s"


def pictures_of(tab):
    """What is seen in a tab, again and again while patience lasts, shape (H, W, 3) in [0, 1]."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        if (seen := tab.picture()) is not None:
            yield seen
        time.sleep(0.5)


@pytest.mark.parametrize("seed", range(5))
def test_quaternions_turn_as_they_should(seed):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
    w, *xyz = quaternion(rotation)
    assert Rotation.from_quat([*xyz, w]).as_matrix() == pytest.approx(rotation)
    direction = rng.normal(size=3) if seed else np.array([0.0, 0.0, -2.0])
    assert along(direction)[:, 2] == pytest.approx(direction / np.linalg.norm(direction))
    assert along(direction).T @ along(direction) == pytest.approx(np.eye(3))
    assert np.linalg.det(along(direction)) == pytest.approx(1.0)
