"""Damaged files, files that unfold, and names that are orders: exit code 2 and one line, or names
as they are.
"""

from __future__ import annotations

import json
import re
import resource
import struct
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stancekit.cli import console
from stancekit.cli.label import Sample
from stancekit.cli.main import INTERNAL, parse, run
from stancekit.cli.verify import Verify
from stancekit.envs.distributions.postures import distribution
from stancekit.planners.robot import Limb, Robot, hexapod, reach_sets
from stancekit.planners.robot.leg import Servo
from stancekit.planners.robot.robot_file import drawn_urdf
from tests.damage import bombs
from tests.damage.cases import Case, cases, command, fault, said
from tests.damage.files import make_files
from tests.refusals import at_once

QUICK, PATIENCE = 4, 12
"""Damaged files of a reader: a few and on until one is refused, or all where digests seal them; the
benchmark has hundreds."""
COARSE = {"_SAMPLES": 6_000, "_VOXELS": 16, "_SEEDS": 800, "_CHECKED": 300, "_CUTS": 2}
"""Counts of the measurement of a leg, of which the robots here only need to have one."""
SLOW = ("servos", "ros")
"""Where a file that is sound is run, which takes seconds; ``benchmarks/damaged_files.py`` has
them."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A file for every reader; workspaces are measured coarsely, by every step."""
    made = tmp_path_factory.mktemp("damage")
    with pytest.MonkeyPatch.context() as patch:
        for name, count in COARSE.items():
            patch.setattr(reach_sets, name, count)
        patch.setenv("STANCEKIT_CACHE", str(made / "legs"))
        patch.chdir(made)
        make_files(made)
        yield made


@pytest.mark.parametrize(
    "case", [case for case in cases() if case.name not in SLOW], ids=lambda case: case.name
)
def test_mutated_files_are_taken_for_what_they_are(folder: Path, case: Case) -> None:
    path = folder / case.file
    whole, rng, codes = (
        path.read_bytes(),
        np.random.default_rng(zlib.crc32(case.name.encode())),
        Counter[int](),
    )
    verb, doubts = parse(list(case.arguments)), 0
    least = PATIENCE if case.sealed else QUICK
    try:
        while codes.total() < least or (not codes[2] + doubts and codes.total() < PATIENCE):
            content, right = case.damaged(whole, rng)
            path.write_bytes(content)
            code, out, err = said(lambda: run(verb))
            assert fault(case, code, err, right) == ""
            codes[code] += 1
            doubts += "expected a mesh" in " ".join(out.split())
    finally:
        path.write_bytes(whole)
    assert codes[2] + doubts > 0  # a robot whose mesh is broken is one with a doubt


YAML = ("course yaml", "servos", "ros", "fitting")
BOMBS: dict[str, tuple[str, Callable[[], bytes]]] = {
    **{f"aliases in {name}": (name, bombs.aliases) for name in YAML},
    "aliases in a robot's mass": ("robot yaml", partial(bombs.aliases, "mass_kg")),
    "aliases in the format": ("servos", partial(bombs.aliases, "format")),
    "an endless course": ("course yaml", bombs.endless_yaml),
    "a deep course": ("course yaml", bombs.deep_yaml),
    "a deep robot": ("robot yaml", partial(bombs.deep_yaml, 100_000)),
    "a deep envelope": ("envelope", bombs.deep_json),
    "a deep plan": ("plan header", partial(bombs.deep_json, 700)),
    "deep problems": ("problems", partial(bombs.deep_json, 100_000)),
    "a wide envelope": ("envelope", lambda: b'{"legs": [' + b'"",' * 3_000_000 + b'""]}'),
    "heights by the gigabyte": (
        "heights npz",
        partial(bombs.packed, "heights_m", 1200, honest=True),
    ),
    "heights that are more than they say": (
        "heights npz",
        partial(bombs.packed, "heights_m", 1200, honest=False),
    ),
    "a wide picture": ("heights png", bombs.wide_png),
    "entities": ("urdf", bombs.entities),
    "a deep robot of links": ("urdf", bombs.deep_xml),
    "a vast mesh": ("heights ply", bombs.vast_ply),
    "a vast terrain": ("mesh ply", bombs.vast_ply),
}


@pytest.mark.parametrize("what", BOMBS)
def test_files_that_unfold_are_refused_in_one_line_at_once(folder: Path, what: str) -> None:
    name, made = BOMBS[what]
    content = made()
    (case,) = (case for case in cases() if case.name == name)
    whole = (folder / case.file).read_bytes()
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        (folder / case.file).write_bytes(content)
        with at_once(1_000_000):
            code, _, err = command(case.arguments)
    finally:
        (folder / case.file).write_bytes(whole)
    assert code == 2, err
    assert err.count("\n") == 1
    assert len(err) < 2200
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 400_000


def test_a_toe_off_a_patch_of_many_corners_is_judged_at_once(folder: Path) -> None:
    rng = np.random.default_rng(1)
    problem = bombs.many_corners(distribution("wall-3").sample(rng).to_json())
    toes = [np.mean(contact["vertices_m"], axis=0).tolist() for contact in problem["contacts"]]
    answer = {
        "com_m": problem["com_nominal_m"],
        "rotation_rad": [0.0] * 3,
        "toes_m": np.add(toes, 0.01).tolist(),
        "forces_n": np.zeros((3, 3)).tolist(),
        "status": "feasible",
    }
    (folder / "round.json").write_text(json.dumps(problem))
    (folder / "off.json").write_text(json.dumps(answer))
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with at_once(100_000):
        code, out, _ = command(("verify", "round.json", "off.json"))
    assert (code, "refused" in out) == (1, True)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 50_000


def test_a_foot_whose_name_is_a_list_is_refused(folder: Path) -> None:
    robot = yaml.safe_load((folder / "robot.yaml").read_text())
    robot["feet"][0]["name"] = ["LF"]
    (folder / "list.yaml").write_text(yaml.safe_dump(robot))
    code, _, err = command(("gait", "ripple", "--robot", "list.yaml", "--goal", "1,1"))
    assert code == 2
    assert err == (
        "stancekit: error: list.yaml: feet[0].name: expected a valid string, got ['LF']\n"
    )


NAME = '[red]<b a="1">&\'$x$ :smile:'


def test_a_name_is_printed_as_it_is_and_orders_to_the_terminal_are_not(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console.out, "width", 200)
    spec = yaml.safe_load((folder / "course.yaml").read_text())
    (folder / "odd.yaml").write_text(yaml.safe_dump({**spec, "name": f"{NAME}\x1b[31m\x07"}))
    arguments = (
        "plan",
        "odd.yaml",
        "--picture",
        "odd.svg",
        "--html",
        "odd.html",
        "--out",
        "odd.json",
    )
    code, out, err = command(arguments)
    assert code == 0, err
    assert f"{NAME}?[31m" in out
    assert "\x1b" not in out + err
    ET.fromstring((folder / "odd.svg").read_bytes())
    page = (folder / "odd.html").read_text()
    assert NAME not in page
    assert "&lt;b a=&quot;1&quot;&gt;" in page


def test_a_robot_of_any_name_is_a_whole_urdf() -> None:
    limbs = tuple(
        Limb(name=f"{NAME}{k}", shoulder_m=np.array([0.1 * k, 0.1, 0.0]), reach_m=0.3)
        for k in range(3)
    )
    robot = Robot(name=NAME, mass_kg=3.0, limbs=limbs, drawn=Servo())
    tree = ET.fromstring(drawn_urdf(robot))
    assert tree.attrib["name"] == NAME
    movable = [
        joint.attrib["name"] for joint in tree.iter("joint") if joint.attrib["type"] == "revolute"
    ]
    assert tuple(movable) == robot.joint_names
    links = {link.attrib["name"] for link in tree.iter("link")}
    assert {
        end.attrib["link"]
        for joint in tree.iter("joint")
        for end in joint
        if end.tag in ("parent", "child")
    } == links


def test_a_mistake_of_the_program_is_neither_bad_input_nor_a_refusal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def mistaken(_: Any) -> int:
        raise TypeError("unsupported operand")

    monkeypatch.setattr(Verify, "run", mistaken)
    code, out, err = command(("verify", "x"))
    assert (code, out) == (INTERNAL, "")
    assert (
        err
        == "stancekit: internal error: TypeError: unsupported operand; STANCEKIT_TRACE=1 shows where\n"
    )
    monkeypatch.setenv("STANCEKIT_TRACE", "1")
    with pytest.raises(TypeError):
        command(("verify", "x"))


CUT_OFF = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


def with_mesh(path: Path, link: str, mesh: str) -> Path:
    """The hexapod with a mesh as the only shape of a link."""
    text = drawn_urdf(hexapod())
    shape = f'<collision><geometry><mesh filename="{mesh}"/></geometry></collision>'
    shape += shape.replace("collision", "visual")
    whole = re.sub(
        rf'(<link name="{link}">)(.*?)(</link>)',
        lambda found: (
            found[1]
            + re.sub(r"<(collision|visual)>.*?</\1>", "", found[2], flags=re.S)
            + shape
            + found[3]
        ),
        text,
        flags=re.S,
    )
    assert mesh in whole
    path.write_text(whole)
    return path


def one_line(code: int, err: str) -> str:
    assert code == 2, err
    assert err.count("\n") == 1
    assert err.startswith("stancekit: error: ")
    return err


@pytest.mark.parametrize("link", ["LF_foot", "base"])
def test_a_mesh_that_is_cut_off_is_no_mesh_and_no_end_of_the_process(
    tmp_path: Path, link: str
) -> None:
    (tmp_path / "cut.ply").write_bytes(CUT_OFF)
    name = link if f'<link name="{link}">' in drawn_urdf(hexapod()) else _base()
    robot = with_mesh(tmp_path / "robot.urdf", name, "cut.ply")
    code, out, err = command(("robot", str(robot), "--json"))
    assert (code, err) == (0, "")
    assert len(json.loads(out)["legs"]) == 6
    code, _, err = command(("robot", str(robot), "--picture", str(tmp_path / "p.png")))
    assert (code, err) == (0, "")
    assert (tmp_path / "p.png").stat().st_size > 1000


def _base() -> str:
    return re.search(r'<link name="([^"]+)"', drawn_urdf(hexapod()))[1]


@pytest.mark.parametrize("value", ["0,5", "", "inf", "1e400", "nan", "1e300"])
def test_an_angle_of_an_srdf_that_is_none_is_said_with_its_joint(
    tmp_path: Path, value: str
) -> None:
    (tmp_path / "six.urdf").write_text(drawn_urdf(hexapod()))
    joint = next(iter(re.findall(r'<joint name="([^"]+)" type="revolute"', drawn_urdf(hexapod()))))
    (tmp_path / "bad.srdf").write_text(
        f'<robot name="six"><group_state name="standing" group="all"><joint name="{joint}" value="{value}"/>'
        "</group_state></robot>"
    )
    code, _, err = command(
        ("robot", str(tmp_path / "six.urdf"), "--srdf", str(tmp_path / "bad.srdf"))
    )
    assert f"group_state 'standing': joint '{joint}': expected a number, got '{value}'" in one_line(
        code, err
    )


def pcd(points: Any) -> bytes:
    """A binary PCD file."""
    rows = np.asarray(points, dtype="<f4")
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA binary\n"
    )
    return head.encode() + rows.tobytes()


FAR: dict[str, list[list[float]]] = {
    "beyond 64 bits": [[1e30, 0, 0], [0, 1, 0], [0, 0, 1]],
    "both ways": [[3e38, 3e38, 0], [-3e38, -3e38, 0]],
    "at the end of 64 bits": [[1.8e17, 0, 0], [0, 1, 0]],
    "high": [[0, 0, 3e38], [1, 1, 0]],
    "one wide": [[-300, 0, 0], [300, 0, 0]],
}


@pytest.mark.parametrize("name", FAR)
@pytest.mark.parametrize(
    "options", [(), ("--spacing-m", "1e-300"), ("--unit-m", "1e6"), ("--spacing-m", "200")]
)
def test_points_beyond_any_grid_are_refused_in_one_line(
    tmp_path: Path, name: str, options: tuple[str, ...]
) -> None:
    (tmp_path / "far.pcd").write_bytes(pcd(FAR[name]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        err = one_line(*command(("terrain", str(tmp_path / "far.pcd"), *options))[::2])
    assert re.search(
        r"expected (points within 200 m|a number|4 or more grid lines|an? )|spacing_m", err
    )
    assert not re.search(r"\d{25}", err)


@pytest.mark.parametrize("apart_m", [0.02, 0.01])
def test_a_cloud_as_fine_as_its_grid_is_a_terrain_or_one_line(
    tmp_path: Path, apart_m: float
) -> None:
    rng = np.random.default_rng(0)
    x = np.arange(0.0, 0.8, apart_m)
    points = np.stack(
        [*np.meshgrid(x, x, indexing="ij"), np.zeros((len(x), len(x)))], axis=-1
    ).reshape(-1, 3)
    points += rng.normal(0.0, [0.005, 0.005, 0.003], points.shape)
    (tmp_path / "fine.pcd").write_bytes(pcd(points))
    code, _, err = command(
        ("terrain", str(tmp_path / "fine.pcd"), "--spacing-m", "0.02", "--noise-m", "0.003")
    )
    assert code in (0, 2)
    assert err.count("\n") == (1 if code else 0)


def test_an_outline_that_geometry_cannot_cut_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shapely

    def torn(*_: Any) -> Any:
        raise shapely.errors.GEOSException("TopologyException: side location conflict at 1 2")

    monkeypatch.setattr("stancekit.planners.terrain.map_footholds.map_footholds", torn)
    np.save(tmp_path / "flat.npy", np.zeros((9, 9)))
    err = one_line(*command(("terrain", str(tmp_path / "flat.npy")))[::2])
    assert "flat.npy: expected surfaces with outlines, got some that cross themselves" in err


def test_what_libraries_warn_of_stays_off_standard_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def warned(_: Any) -> int:
        warnings.warn("overflow encountered in cast", RuntimeWarning, stacklevel=1)
        return 0

    monkeypatch.setattr(Sample, "run", warned)
    assert command(("sample", "wall-3")) == (0, "", "")


def test_the_command_as_a_process_takes_a_broken_mesh(tmp_path: Path) -> None:
    (tmp_path / "cut.ply").write_bytes(CUT_OFF)
    (tmp_path / "vast.stl").write_bytes(bytes(80) + struct.pack("<I", 2**32 - 1))
    for name in ("cut.ply", "vast.stl"):
        done = subprocess.run(
            [sys.executable, "-m", "stancekit.cli.main", "terrain", name],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert name in one_line(done.returncode, done.stderr)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_where_the_axes_of_a_file_went_is_said(tmp_path: Path, up: str) -> None:
    low = np.zeros(3)
    high = np.array([0.4, 0.8, 1.2])
    import trimesh

    trimesh.creation.box(bounds=[low, high]).export(tmp_path / "box.stl")
    code, out, _ = command(
        ("terrain", str(tmp_path / "box.stl"), "--up", up, "--json", "--margin-m", "0")
    )
    answer = json.loads(out)
    assert code == 0
    assert answer["axes"]["z"] == up
    corners = np.concatenate([patch["vertices_m"] for patch in answer["patches"]])
    lengths = [high["xyz".index(answer["axes"][axis])] for axis in "xyz"]
    assert np.ptp(corners, axis=0)[:2] == pytest.approx(lengths[:2], abs=1e-6)
    assert corners[:, 2] == pytest.approx(lengths[2], abs=1e-6)
    _, out, _ = command(("terrain", str(tmp_path / "box.stl"), "--up", up))
    words = ", ".join(f"{axis} is the file's {own}" for axis, own in answer["axes"].items())
    assert (words in out) == (up != "z")


def test_a_terrain_without_a_file_has_no_axes_of_one() -> None:
    code, out, _ = command(("terrain", "stairs:0.2:1", "--json"))
    assert (code, "axes" in json.loads(out)) == (0, False)


def test_a_mesh_that_is_broken_or_flat_is_a_doubt_that_names_link_and_file(tmp_path: Path) -> None:
    (tmp_path / "cut.ply").write_bytes(CUT_OFF)
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "body.step").write_text("ISO-10303-21;")
    for name, why in (
        ("cut.ply", "'cut.ply': expected a mesh"),
        ("flat.obj", "'flat.obj': expected corners around a volume, got a flat one"),
        (
            "body.step",
            "'body.step': expected a mesh that ends in .stl, .obj, .ply, .dae, .off, .glb, got .step",
        ),
    ):
        robot = with_mesh(tmp_path / "robot.urdf", _base(), name)
        code, out, err = command(("robot", str(robot), "--json"))
        assert (code, err) == (0, "")
        doubts = [each for each in json.loads(out)["doubts"] if "has no body" in each]
        assert len(doubts) == 1
        assert doubts[0].startswith(f"link {_base()}: has no body, mesh {why}")
        assert "\n" not in doubts[0]
        assert str(tmp_path) not in doubts[0]


def test_a_broken_mesh_that_is_only_seen_is_a_doubt_where_it_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "cut.ply").write_bytes(CUT_OFF)
    robot = tmp_path / "robot.urdf"
    seen = '<visual><geometry><mesh filename="cut.ply"/></geometry></visual></link>'
    robot.write_text(drawn_urdf(hexapod()).replace("</link>", seen, 1))
    answers = []
    for more in ((), ("--picture", str(tmp_path / "robot.png"))):
        code, out, err = command(("robot", str(robot), "--json", *more))
        assert (code, err) == (0, "")
        answers.append([each for each in json.loads(out)["doubts"] if "cut.ply" in each])
    assert answers[0] == []  # it is no body, and nothing is drawn
    assert len(answers[1]) == 1
    assert answers[1][0].startswith(
        f"link {_base()}: not in the picture, mesh 'cut.ply': expected a mesh"
    )
    assert "\n" not in answers[1][0]
