"""The pictures: they show what they are given, say what they cannot show, and are written whole or
not at all.
"""

import itertools
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import NDArray

from stancekit import Motion
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.search.exact import Exact
from stancekit.planners.terrain import Patch
from stancekit.views.plots import ComparisonBar, draw_comparison
from stancekit.views.postures import draw_posture
from stancekit.views.scene import Camera
from stancekit.views.sheet import save, to_rgb
from tests.refusals import refuses

SMALL = (480, 360)
Solved = Mapping[str, tuple[Problem, Motion]]
ROWS = (
    ComparisonBar(
        selector="heuristic",
        values={"P1 correct feasible": 0.81, "fix-p": 0.58},
        paper={"fix-p": 0.6075},
    ),
    ComparisonBar(
        selector="neural", values={"P1 correct feasible": 0.975, "P1 correct infeasible": 0.92}
    ),
)


@pytest.fixture(scope="module")
def solved() -> Solved:
    """Return a feasible problem of each distribution, and its posture."""
    planner, found = Exact(), {}
    for name, distribution in DISTRIBUTIONS.items():
        problem = distribution.sample(np.random.default_rng(2))
        posture = planner.solve(problem).solution
        assert posture is not None
        found[name] = (problem, posture)
    return found


def envelope(contacts: int, *, half: float = 0.8) -> Envelope:
    return Envelope(low=np.full((contacts, 6), -half), high=np.full((contacts, 6), half))


def texts(figure: Figure) -> list[str]:
    """Return all that is written on a figure."""
    own = [text.get_text() for text in figure.texts]
    return own + [text.get_text() for axes in figure.axes for text in axes.texts]


def settings() -> dict[str, object]:
    """Return matplotlib's settings, but for the backend, which the very reading of it would
    choose.
    """
    return {name: mpl.rcParams[name] for name in mpl.rcParams if name != "backend"}


def ink(rgb: NDArray[np.uint8]) -> float:
    """Return the share of pixels that are not white."""
    return float(np.mean(np.any(rgb < 250, axis=-1)))


def one_limb(**changes: object) -> Problem:
    """Return a problem of one limb below the centre of mass, on a square of ground."""
    side = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    values = {"size_m": 0.1, "friction": 0.5, "shoulder_m": np.zeros(3), **changes}
    patch = Patch(
        vertices_m=side * values["size_m"] + [0.0, 0.0, -0.3],
        normal=np.array([0.0, 0.0, 1.0]),
        shear_reference=np.array([1.0, 0.0, 0.0]),
        friction=float(str(values["friction"])),
    )
    contact = Contact(
        leg="RF",
        shoulder_m=np.asarray(values["shoulder_m"]),
        reach_m=0.35,
        patch=patch,
        force_min=np.array([0.0, -1.0, -1.0]),
        force_max=np.ones(3),
    )
    return Problem.posture(
        contacts=(contact,), mass_kg=10.0, com_nominal_m=np.zeros(3), com_radius_m=0.0
    )


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_a_picture_has_the_size_asked_for_and_is_not_blank(name: str, solved: Solved) -> None:
    rgb = to_rgb(draw_posture(*solved[name]))
    assert rgb.shape == (900, 1200, 3)
    assert rgb.dtype == np.uint8
    assert ink(rgb) > 0.05
    assert len(np.unique(rgb @ np.array([1, 256, 65536]))) > 200  # colours


@pytest.mark.parametrize("size_px", [(481, 361), (600, 300), (301, 700)])
def test_any_size_comes_out_to_the_pixel(size_px: tuple[int, int], solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    rgb = to_rgb(draw_posture(problem, posture, envelope=envelope(3), size_px=size_px))
    assert rgb.shape == (size_px[1], size_px[0], 3)
    assert ink(rgb) > 0.02


def test_the_same_input_gives_the_same_pixels(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    first, second = (
        to_rgb(draw_posture(problem, posture, envelope=envelope(3), size_px=SMALL))
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_settings_of_the_user_change_no_pixel(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    plain = to_rgb(draw_posture(problem, posture, size_px=SMALL))
    with mpl.rc_context(
        {
            "savefig.bbox": "tight",
            "font.size": 30.0,
            "axes.edgecolor": "red",
            "lines.linewidth": 9.0,
        }
    ):
        before = settings()
        np.testing.assert_array_equal(to_rgb(draw_posture(problem, posture, size_px=SMALL)), plain)
        assert settings() == before


def test_posture_envelope_and_caption_each_change_the_picture(solved: Solved) -> None:
    problem, posture = solved["ground-3"]
    pictures = [
        to_rgb(draw_posture(problem, size_px=SMALL)),
        to_rgb(draw_posture(problem, posture, size_px=SMALL)),
        to_rgb(draw_posture(problem, envelope=envelope(3), size_px=SMALL)),
        to_rgb(draw_posture(problem, posture, envelope=envelope(3), size_px=SMALL)),
        to_rgb(draw_posture(problem, posture, envelope=envelope(3, half=0.7), size_px=SMALL)),
        to_rgb(draw_posture(problem, posture, caption="another", size_px=SMALL)),
    ]
    pairs = list(itertools.combinations(pictures, 2))
    assert len(pairs) == 15
    assert all(np.mean(np.any(a != b, axis=-1)) > 1e-3 for a, b in pairs)


def test_it_says_who_holds_what_with_which_force(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    said = texts(draw_posture(problem, posture, size_px=SMALL))
    assert "held by 3 limbs, 98.1 N" in said
    for leg, force in zip(problem.legs, posture.forces_n[0], strict=True):
        assert f"{leg} {np.linalg.norm(force):.0f} N" in said
    assert "friction μ" in said


def test_without_a_posture_it_says_so_whatever_the_caption(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    for caption in ("", "wall-3"):
        said = texts(draw_posture(problem, caption=caption, size_px=SMALL))
        assert any(text.startswith("no posture (infeasible or unsolved)") for text in said)
        assert set(problem.legs) <= set(said)
        assert not any("contact force" in text for text in said)
    assert "friction" in texts(draw_posture(problem, why="friction", size_px=SMALL))
    assert not any(
        "no posture" in text for text in texts(draw_posture(problem, posture, size_px=SMALL))
    )


def test_a_caption_is_never_read_as_mathematics(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    figure = draw_posture(problem, posture, caption=r"$\frac{1$ for $5", size_px=SMALL)
    assert ink(to_rgb(figure)) > 0.02


@pytest.mark.parametrize(
    "changes",
    [
        {"friction": 0.0},
        {"friction": 50.0},
        {"size_m": 5.0},
        {"shoulder_m": np.array([0.0, 0.0, 0.2])},
    ],
    ids=[
        "no friction",
        "much friction",
        "a patch larger than the robot",
        "a shoulder above the body",
    ],
)
def test_odd_scenes_are_drawn_too(changes: dict[str, object]) -> None:
    problem = one_limb(**changes)
    toes, forces = np.array([[0.0, 0.0, -0.3]]), np.array([[0.0, 0.0, 98.1]])
    posture = Motion.of_posture(
        problem, com_m=np.zeros(3), rotation_rad=np.zeros(3), toes_m=toes, forces_n=forces
    )
    figure = draw_posture(problem, posture, envelope=envelope(1, half=4.0), size_px=SMALL)
    assert "held by 1 limb, 98.1 N" in texts(figure)
    assert ink(to_rgb(figure)) > 0.02


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ({"toes_m": np.zeros((2, 3))}, "toes_m"),
        (
            {"forces_n": np.zeros((1, 3, 2))},
            "forces_n",
        ),
        (
            {"com_m": np.array([[0.0, np.nan, 0.0]])},
            "com_m",
        ),
    ],
)
def test_a_posture_that_does_not_fit_is_refused(
    broken: dict[str, NDArray[np.float64]], message: str, solved: Solved
) -> None:
    problem, posture = solved["wall-3"]
    with refuses(message):
        draw_posture(problem, replace(posture, **broken))


def test_an_envelope_of_other_contacts_and_a_tiny_sheet_are_refused(solved: Solved) -> None:
    problem, posture = solved["wall-3"]
    with refuses("envelope"):
        draw_posture(problem, posture, envelope=envelope(5))
    with refuses("size_px"):
        draw_posture(problem, posture, size_px=(1200, 200))


def test_drawing_loads_no_pyplot() -> None:
    code = (
        "import sys; from stancekit.views.postures import draw_posture; from stancekit.views.sheet import to_rgb;"
        "from stancekit.views.plots import ComparisonBar, draw_comparison;"
        "to_rgb(draw_comparison([ComparisonBar(selector='a', values={'b': 0.5})]));"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert said == "False\n"


def test_a_camera_sees_space_as_a_viewer_does() -> None:
    target = np.array([1.0, 2.0, 3.0])
    camera = Camera(target_m=target, azimuth_rad=0.3, elevation_rad=0.4, distance_m=2.0)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)
    right, up, towards = camera.axes
    assert right[2] == pytest.approx(0.0)
    assert up[2] > 0.0
    xy, near = camera.project(target + np.array([0.1 * right, 0.1 * up, 0.1 * right + towards]))
    # What is at half the distance looks twice as large.
    np.testing.assert_allclose(xy, [[0.1, 0.0], [0.0, 0.1], [0.2, 0.0]], atol=1e-12)
    np.testing.assert_allclose(near, [0.0, 0.0, 1.0], atol=1e-12)
    assert camera.facing(target, towards) == pytest.approx(1.0)
    assert camera.facing(target, -up) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg", ".PNG"])
def test_a_saved_picture_can_be_read_and_is_the_same_every_time(
    suffix: str, tmp_path: Path
) -> None:
    first, second = tmp_path / f"first{suffix}", tmp_path / f"second{suffix}"
    for path in (first, second):
        save(draw_posture(one_limb(), size_px=SMALL), path)
    assert first.read_bytes() == second.read_bytes()
    heads = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}
    assert first.read_bytes().startswith(heads[suffix.lower()])
    if suffix == ".png":
        read = np.round(255.0 * imread(first)[..., :3]).astype(np.uint8)
        np.testing.assert_array_equal(read, to_rgb(draw_posture(one_limb(), size_px=SMALL)))
    assert sorted(tmp_path.iterdir()) == [first, second]


@pytest.mark.parametrize(
    "name",
    ["a.gif", "a", "no/a.png"],
)
def test_a_name_that_cannot_be_written_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    with refuses(tmp_path / name):
        save(draw_comparison(ROWS, size_px=SMALL), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_picture_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError(28, "the disc is full")

    monkeypatch.setattr(os, "replace", fail)
    with refuses("picture.png"):
        save(draw_comparison(ROWS, size_px=SMALL), path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_comparison_shows_every_selector_measure_and_number() -> None:
    figure = draw_comparison(ROWS, caption="wall-3")
    rgb = to_rgb(figure)
    assert rgb.shape == (640, 1200, 3)
    assert ink(rgb) > 0.1
    axes = figure.axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["heuristic", "neural"]
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert named == ["P1 correct feasible", "fix-p", "P1 correct infeasible", "paper"]
    assert sorted(texts(figure)) == sorted(
        [
            "wall-3",
            "% of problems; the lines are 95 % intervals",
            "81.0",
            "58.0",
            "97.5",
            "92.0",
            "–",
            "–",
        ]
    )
    heights = sorted(bar.get_height() for bar in axes.patches if bar.get_height() > 0.0)  # type: ignore[attr-defined]
    assert heights == pytest.approx([58.0, 81.0, 92.0, 97.5])
    diamonds = [line.get_ydata() for line in axes.lines if line.get_marker() == "D"]
    assert [float(np.asarray(y)[0]) for y in diamonds] == pytest.approx(
        [60.75, 0.0]
    )  # the value, and the legend's own


def test_a_comparison_without_the_paper_has_no_diamond() -> None:
    legend = draw_comparison(ROWS[1:], size_px=SMALL).axes[0].get_legend()
    assert "paper" not in [text.get_text() for text in legend.get_texts()]


def test_a_comparison_of_nothing_is_refused() -> None:
    for rows in ((), (ComparisonBar(selector="neural", values={}),)):
        with refuses("rows"):
            draw_comparison(rows)
