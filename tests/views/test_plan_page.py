"""The page of a plan: one file with everything in it, which headless Chromium opens from disk without a network."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from urllib.request import urlopen

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.views import plan_page as page_module
from stancekit.views.plan_page import check_page, plan_page, write_plan_page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
OFFLINE = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--window-size=480,360", "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def plan():
    found = TwoStageCoursePlanner().solve(read_course("icy-walls", 2)).plan
    assert found is not None
    return found


@pytest.fixture(scope="module")
def page(plan):
    try:
        return plan_page(plan, step_s=0.2)
    except InvalidInput as error:
        pytest.skip(str(error))


def test_the_page_holds_everything_that_it_shows(page):
    assert page.startswith("<!doctype html>")
    assert "<title>icy-walls</title>" in page
    assert "<b>icy-walls</b>: 2 key frames" in page
    assert "ice, μ = 0" in page
    assert "friction μ = 1" in page
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", page[: page.index("<script")])
    assert set(re.findall(r"https?://[\w.]+", page)) <= {"http://www.w3.org"}  # the name of SVG, not a place to go
    assert len(page) < 3_000_000


def test_names_are_text_and_no_markup(plan):
    try:
        shown = plan_page(replace(plan, course=replace(plan.course, name="<script>alert(1)</script>")), step_s=0.2)
    except InvalidInput as error:
        pytest.skip(str(error))
    assert "<script>alert" not in shown
    assert "&lt;script&gt;alert" in shown


def test_recording_says_nothing_on_standard_output(plan, capsys):
    try:
        plan_page(plan, step_s=0.1)
    except InvalidInput as error:
        pytest.skip(str(error))
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed (Debian: apt-get install chromium)")
def test_headless_chromium_opens_it_from_disk_without_a_network(page, tmp_path):
    (tmp_path / "plan.html").write_text(page)
    with closing(pictures_of((tmp_path / "plan.html").as_uri(), tmp_path / "profile")) as pictures:
        for shown in pictures:
            red, green, blue = (shown[..., k] for k in range(3))
            rough = (green - blue > 0.08) & (green > 0.4)
            icy = (blue - red > 0.05) & (blue > 0.6)
            dark = shown.max(axis=-1) < 0.45  # limbs and the way of the centre of mass
            if min(rough.mean(), icy.mean()) > 0.01 and dark.mean() > 0.001:
                return
    pytest.fail(f"no terrain, ice or robot was to be seen within {PATIENCE_S:g} s")


def pictures_of(address, profile):
    """What Chromium shows of a page, again and again while patience lasts, shape (H, W, 3) in [0, 1]."""
    connect = pytest.importorskip("websockets.sync.client").connect
    command = [CHROMIUM, *OFFLINE, f"--user-data-dir={profile}", address]
    browser = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        at = next(found for line in browser.stderr if (found := re.search(r"ws://(127\.0\.0\.1:\d+)/", line)))
        with urlopen(f"http://{at[1]}/json/list") as answer:
            tab = next(tab for tab in json.load(answer) if tab["type"] == "page")
        with connect(tab["webSocketDebuggerUrl"], max_size=None) as line:
            until = time.monotonic() + PATIENCE_S
            while time.monotonic() < until:
                line.send(json.dumps({"id": 1, "method": "Page.captureScreenshot"}))
                said = json.loads(line.recv(timeout=PATIENCE_S))
                if "result" in said:
                    yield imread(BytesIO(base64.b64decode(said["result"]["data"])))[..., :3]
                time.sleep(0.5)
    finally:
        browser.kill()
        browser.communicate()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.png", "a.png: expected a name that ends in .html, got .png"),
        ("a", "a: expected a name that ends in .html, got no suffix"),
    ],
)
def test_another_name_is_refused(name, message, plan):
    with pytest.raises(InvalidInput) as refused:
        write_plan_page(name, plan)
    assert str(refused.value) == message


def test_without_viser_the_extra_is_named(plan, monkeypatch, tmp_path):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(page_module, "import_module", missing)
    with pytest.raises(InvalidInput, match=r"page: expected viser; install it with pip install 'stancekit\[viz\]'"):
        check_page(tmp_path / "a.html")


@pytest.mark.parametrize("seed", range(5))
def test_quaternions_turn_as_they_should(seed):
    rng = np.random.default_rng(seed)
    vector = 0.3 * rng.normal(size=3)
    w, *xyz = page_module._quaternion(vector)
    assert Rotation.from_quat([*xyz, w]).as_matrix() == pytest.approx(Rotation.from_rotvec(vector).as_matrix())
    way = rng.normal(size=3) if seed else np.array([0.0, 0.0, -2.0])
    w, *xyz = page_module._along(way)
    assert Rotation.from_quat([*xyz, w]).apply([0, 0, 1]) == pytest.approx(way / np.linalg.norm(way))
