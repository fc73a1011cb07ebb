"""Reach polytopes from files: the published half-spaces, the ball that holds them, and files that
are none.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.reach_sets import read_polytope, read_reach

ROOT = Path(__file__).resolve().parents[3]
LIMBS = {"anymal": ("RHleg", "RFleg", "LHleg", "LFleg"), "talos": ("LF", "RF")}
CUBE = "\n".join(
    [f"v {x} {y} {z}" for x in (0, 2) for y in (0, 2) for z in (0, 2)]
    + ["vn -1 0 0", "vn 1 0 0", "vn 0 -1 0", "vn 0 1 0", "vn 0 0 -1", "vn 0 0 1"]
    + [
        "f 1//1 2//1 4//1 3//1",
        "f 5//2 7//2 8//2 6//2",
        "f 1//3 5//3 6//3 2//3",
        "f 3//4 4//4 8//4 7//4",
    ]
    + ["f 1//5 3//5 7//5 5//5", "f 2//6 6//6 8//6 4//6"]
)


def folder_of(robot: str) -> Path:
    return ROOT / "benchmarks" / "published" / "reach" / robot


def lines_of(path: Path, kind: str) -> list[list[str]]:
    return [
        line.split()[1:] for line in path.read_text().splitlines() if line.startswith(kind + " ")
    ]


@pytest.mark.parametrize("robot", LIMBS)
def test_every_published_file_is_read_as_its_faces_say(robot):
    paths = sorted(folder_of(robot).glob("*.obj"))
    assert len(paths) == {"anymal": 16, "talos": 4}[robot]
    for path in paths:
        normals, bounds, corners = read_polytope(path)
        faces = lines_of(path, "f")
        assert len(faces) == len(bounds)
        for face, normal, bound in zip(faces, normals, bounds, strict=True):
            corner, number = face[0].split("//")
            own = np.array(lines_of(path, "vn")[int(number) - 1], dtype=float)
            assert normal.tolist() == own.tolist()
            assert bound == pytest.approx(
                own @ np.array(lines_of(path, "v")[int(corner) - 1], dtype=float)
            )
        assert np.all(corners.mean(axis=0) @ normals.T < bounds)  # outward


@pytest.mark.parametrize("robot", LIMBS)
def test_the_ball_holds_the_set_and_hardly_more(robot):
    """The farthest point of the set in a direction, by a linear program, is in the ball, and one is
    at its border.
    """
    sets = read_reach(folder_of(robot), LIMBS[robot])
    rng = np.random.default_rng(0)
    for limb in LIMBS[robot][:2]:
        rows, (*centre, radius) = sets.toes[limb], sets.balls[limb]
        ways = rng.normal(size=(40, 3))
        far = []
        for way in ways / np.linalg.norm(ways, axis=1)[:, None]:
            found = linprog(-way, rows.normals, rows.bounds_m, bounds=(None, None))
            far.append(np.linalg.norm(found.x - centre))
        assert max(far) <= radius
        assert max(far) >= 0.9 * radius


def test_feet_are_paired_and_signs_are_those_of_the_paper():
    """A toe below the body's own corner, and the other feet where those of a trotting stance are,
    are in reach.
    """
    sets = read_reach(folder_of("anymal"), LIMBS["anymal"])
    assert [(each.limb, each.other) for each in sets.feet] == [
        (limb, other) for limb in LIMBS["anymal"] for other in LIMBS["anymal"] if other != limb
    ]
    toes = {
        "LFleg": [0.37, 0.26],
        "RFleg": [0.37, -0.26],
        "LHleg": [-0.37, 0.26],
        "RHleg": [-0.37, -0.26],
    }
    toe = {name: np.array([*place, -0.47]) for name, place in toes.items()}
    for name, rows in sets.toes.items():
        assert np.all(rows.normals @ toe[name] <= rows.bounds_m)
        assert not np.all(rows.normals @ -toe[name] <= rows.bounds_m)
    for each in sets.feet:
        assert np.all(each.rows.normals @ (toe[each.other] - toe[each.limb]) <= each.rows.bounds_m)


def test_a_set_is_stretched_about_the_mean_of_its_corners(tmp_path):
    path = tmp_path / "COM_constraints_in_LF.obj"
    path.write_text(CUBE)
    _, bounds, corners = read_polytope(path, stretch=1.5)
    assert bounds.tolist() == [0.5, 2.5, 0.5, 2.5, 0.5, 2.5]
    assert corners.min() == -0.5
    assert corners.max() == 2.5


def test_a_robot_takes_the_reach_of_a_folder_by_names_that_begin_alike():
    limbs = tuple(
        Limb(name=name[:2], shoulder_m=np.zeros(3), reach_m=1.0) for name in LIMBS["anymal"]
    )
    robot = Robot(name="quadruped", mass_kg=30.0, limbs=limbs)
    found = read_reach(folder_of("anymal"), robot.limb_names).applied(robot)
    assert [len(limb.reach_rows.bounds_m) for limb in found.limbs] == [23, 24, 24, 24]
    assert len(found.relative_reach) == 12


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, r"expected a file COM_constraints_in_LF\*\.obj, got none$"),
        (
            {"COM_constraints_in_LF.obj": "v 1 2\n"},
            r"expected corners, normals and faces of an OBJ file",
        ),
        (
            {"COM_constraints_in_LF.obj": "v 0 0 0\n"},
            r"expected 4 to 256 faces of finite corners, got 0$",
        ),
        (
            {"COM_constraints_in_LF.obj": CUBE.replace("f 1//1", "f 9//1")},
            r"faces of its 8 corners and 6 normals",
        ),
        (
            {"COM_constraints_in_LF.obj": CUBE.replace("vn 0 0 1", "vn 0 0 nan")},
            r"of finite corners",
        ),
        (
            {"COM_constraints_in_LF.obj": CUBE.replace("vn 0 0 1", "vn 1 0 0")},
            r"bounded and has an inside$",
        ),
        (
            {"COM_constraints_in_LF_a.obj": CUBE, "COM_constraints_in_LF_b.obj": CUBE},
            r"expected one file a set, got COM_constraints_in_LF_a\.obj and COM_constraints_in_LF_b\.obj$",
        ),
    ],
)
def test_what_is_no_folder_of_polytopes_is_refused_in_one_line(tmp_path, files, message):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InvalidInput, match=message) as caught:
        read_reach(tmp_path, ("LF",))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_of_two_files_the_reduced_one_is_taken(tmp_path):
    (tmp_path / "COM_constraints_in_LF_upscale.obj").write_text("nothing")
    (tmp_path / "COM_constraints_in_LF_REDUCED.obj").write_text(CUBE)
    assert len(read_reach(tmp_path, ("LF",)).toes["LF"].bounds_m) == 6


def test_a_folder_that_there_is_not(tmp_path):
    with pytest.raises(InvalidInput, match=r"expected a folder of reach polytopes, found none$"):
        read_reach(tmp_path / "nowhere", ("LF",))
