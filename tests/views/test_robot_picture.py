"""Pictures of robots: every leg is there by name, links where they are, and what cannot be drawn
does no harm.
"""

from pathlib import Path

import numpy as np

from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import model_of
from stancekit.views.sheet import to_rgb
from stancekit.views.still import draw_robot
from tests.planners.robot.small_urdfs import quadruped


def test_every_leg_is_named_beside_its_foot() -> None:
    figure = draw_robot(model_of(quadruped()), size_px=(600, 450))
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(words) == ["LF", "LH", "RF", "RH"]
    assert [text.get_text() for text in figure.texts] == ["quadruped", "4 legs, 12 joints, 22.4 kg"]


def test_a_wider_trunk_covers_more_of_the_picture() -> None:
    wide = quadruped().replace('size="0.6 0.25 0.1"', 'size="0.6 0.25 0.3"')
    pixels = [
        to_rgb(draw_robot(model_of(text), size_px=(400, 300))).astype(int)
        for text in (quadruped(), wide)
    ]
    grey = [int(np.sum((np.ptp(each, axis=2) < 30) & (each.max(axis=2) < 200))) for each in pixels]
    assert grey[1] > 1.3 * grey[0] > 0


def test_a_mesh_is_drawn_and_a_broken_one_is_not(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    corners = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
    faces = [(1, 2, 4), (1, 4, 3), (5, 6, 8), (5, 8, 7), (1, 2, 6), (1, 6, 5), (3, 4, 8), (3, 8, 7)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    ink = []
    for mesh in ("broken.stl", "box.obj"):
        text = quadruped().replace('<box size="0.6 0.25 0.1"/>', f'<mesh filename="{mesh}"/>')
        (tmp_path / "robot.urdf").write_text(text)
        pixels = to_rgb(
            draw_robot(named_robot(tmp_path / "robot.urdf"), size_px=(400, 300))
        ).astype(int)
        ink.append(int(np.sum((np.ptp(pixels, axis=2) < 30) & (pixels.max(axis=2) < 200))))
    assert ink[1] > ink[0] + 1000
