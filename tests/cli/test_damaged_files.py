"""Damaged files, files that unfold, and names that are orders: exit code 2 and one line, or names
as they are.
"""

from __future__ import annotations

import json
import os
import resource
import time
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
from stancekit.cli.main import INTERNAL, parse, run
from stancekit.cli.verify import Verify
from stancekit.envs.distributions.postures import distribution
from stancekit.planners.robot import Limb, Robot
from stancekit.planners.robot.actuators import Servo
from stancekit.planners.robot.robot_file import hexapod_urdf, joint_names
from tests.damage import bombs
from tests.damage.cases import Case, cases, command, fault, said
from tests.damage.files import make_files

QUICK, PATIENCE = 4, 12
"""Damaged files of a reader: a few and on until one is refused, or all where digests seal them; the
benchmark has hundreds."""
SLOW = ("servos", "ros", "replayed log")
"""Where a file that is sound is run, which takes seconds; ``benchmarks/damaged_files.py`` has
them."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A file for every reader."""
    made, here = tmp_path_factory.mktemp("damage"), Path.cwd()
    os.chdir(made)
    make_files(made)
    yield made
    os.chdir(here)


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


YAML = ("course yaml", "training", "servos", "ros", "fitting")
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
    began = time.process_time()
    try:
        (folder / case.file).write_bytes(content)
        code, _, err = command(case.arguments)
    finally:
        (folder / case.file).write_bytes(whole)
    assert code == 2, err
    assert err.count("\n") == 1
    assert len(err) < 2200
    assert time.process_time() - began < 5.0
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
    began = time.process_time()
    code, out, _ = command(("verify", "round.json", "off.json"))
    assert (code, "refused" in out) == (1, True)
    assert time.process_time() - began < 1.0
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
    tree = ET.fromstring(hexapod_urdf(robot))
    assert tree.attrib["name"] == NAME
    movable = [
        joint.attrib["name"] for joint in tree.iter("joint") if joint.attrib["type"] == "revolute"
    ]
    assert tuple(movable) == joint_names(robot)
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
