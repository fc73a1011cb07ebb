"""Every reader of the command, with a file that it reads and what may be made of a damaged one."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from . import mutations as m

ALL = frozenset({0, 1, 2})


@dataclass(frozen=True, kw_only=True)
class Case:
    """A reader: the command's arguments, relative to the folder of its files, and the file that is
    damaged.

    kind: of the file, for ``unreadable``. made: mutations besides those of bytes. codes: exit codes
    that a well-formed file may get. sealed: it carries digests, so that a change of its contents
    must be refused; seal: makes them fit.
    """

    name: str
    arguments: tuple[str, ...]
    file: str
    kind: str
    made: tuple[m.Bytes, ...] = ()
    codes: frozenset[int] = ALL
    sealed: bool = False
    seal: Callable[[bytes], bytes] | None = None

    @property
    def mesh(self) -> str:
        """The format of a mesh that a URDF or a terrain names, as its file's name ends; empty for
        other readers.
        """
        named = self.kind in (
            "stl",
            "obj",
            "ply",
            "off",
            "glb",
            "dae",
        ) and not self.file.startswith("cloud")
        return ("text " if "-text" in self.file else "") + self.kind if named else ""

    def damaged(self, content: bytes, rng: np.random.Generator) -> tuple[bytes, frozenset[int]]:
        """A mutated file, and the exit codes that are right for it."""
        ways = m.PLAIN + 3 * self.made
        found = ways[rng.integers(len(ways))](content, rng)
        resealed = False
        if self.seal is not None and rng.random() < 0.6:
            with suppress(ValueError, TypeError, KeyError, RecursionError):
                found, resealed = self.seal(found), True
        if unreadable(self.kind, found):
            return found, frozenset({2})
        if self.sealed and not resealed:
            return found, frozenset({0, 2} if same(self.kind, content, found) else {2})
        return found, self.codes


def unreadable(kind: str, content: bytes) -> bool:
    """Whether the library that the format is of cannot read it: an opinion that is not the
    house's.
    """
    try:
        if kind in ("json", "jsonl", "yaml"):
            text = content.decode("utf-8-sig")
            if not text.strip():
                return True
        if kind == "json":
            json.loads(text)
        elif kind == "jsonl":
            try:
                json.loads(text)
            except ValueError:
                for line in text.split("\n"):
                    if line.strip():
                        json.loads(line)
        elif kind == "yaml":
            return not isinstance(yaml.load(text, Loader=yaml.CSafeLoader), dict)
        elif kind == "npz":
            m.arrays_of(content)
        elif kind == "npy":
            np.load(io.BytesIO(content), allow_pickle=False)
        elif kind == "safetensors":
            from safetensors import deserialize

            deserialize(content)
    except Exception:
        return True
    return False


def same(kind: str, old: bytes, new: bytes) -> bool:
    """Whether a file still means the same."""
    if kind == "npz":
        one, other = m.arrays_of(old), m.arrays_of(new)
        return set(one) == set(other) and all(
            one[name].shape == other[name].shape and np.array_equal(one[name], other[name])
            for name in one
        )
    return bool(json.loads(old) == json.loads(new))


def _sealed(key: str) -> Callable[[bytes], bytes]:
    """Makes the digest under a key fit the rest of a header."""

    def seal(content: bytes) -> bytes:
        data = json.loads(content)
        del data[key]
        text = json.dumps(data, sort_keys=True, separators=(",", ":"))
        return json.dumps({**data, key: hashlib.sha256(text.encode()).hexdigest()}).encode()

    return seal


TEXT = (m.renumbered, m.reordered)
JSON, YAML, NPZ = (
    (m.json_tree,),
    (m.yaml_tree, m.renumbered),
    (m.other_arrays, m.other_header, m.other_directory),
)
MOTIONS: dict[str, tuple[m.Bytes, ...]] = {
    "csv": TEXT,
    "npz": NPZ,
    "json": JSON,
    "yaml": YAML,
    "xml": TEXT,
}
"""Kinds of files of motions from elsewhere, JSON and YAML of JointTrajectories."""
OUTSIDE = ("--start", "0,0", "--goal", "90000,0")
"""A walk that no terrain holds: read, and then refused."""
ONLY = frozenset({2})
PLAN = ("--feasible", "2", "--infeasible", "2", "--shard-size", "4", "--seed", "2")
"""Of the data set: what is there already is only told."""


_ALONE = (
    Case(
        name="problems",
        arguments=("solve", "problems.jsonl"),
        file="problems.jsonl",
        kind="jsonl",
        made=JSON,
    ),
    Case(
        name="answers",
        arguments=("verify", "problems.jsonl", "answers.jsonl"),
        file="answers.jsonl",
        kind="jsonl",
        made=JSON,
    ),
    Case(
        name="envelope",
        arguments=("solve", "one.json", "--method", "p1", "--envelopes", "envelope.json"),
        file="envelope.json",
        kind="json",
        made=JSON,
    ),
    Case(
        name="plan header",
        arguments=("verify", "plan.json"),
        file="plan.json",
        kind="json",
        made=JSON,
        sealed=True,
        seal=_sealed("sha256"),
    ),
    Case(
        name="proof",
        arguments=("verify", "proof.json"),
        file="proof.json",
        kind="json",
        made=JSON,
        sealed=True,
        seal=_sealed("sha256"),
    ),
    Case(
        name="gait header",
        arguments=("verify", "gait.json"),
        file="gait.json",
        kind="json",
        made=JSON,
        sealed=True,
        seal=_sealed("sha256"),
    ),
    Case(
        name="course yaml",
        arguments=("plan", "course.yaml", "--frames", "1"),
        file="course.yaml",
        kind="yaml",
        made=YAML,
    ),
    Case(
        name="course json",
        arguments=("plan", "course.json"),
        file="course.json",
        kind="json",
        made=JSON,
    ),
    Case(
        name="robot yaml",
        arguments=("gait", "ripple", "--robot", "robot.yaml", *OUTSIDE),
        file="robot.yaml",
        kind="yaml",
        made=YAML,
        codes=ONLY,
    ),
    Case(
        name="measured robot",
        arguments=("gait", "ripple", "--robot", "measured.yaml", *OUTSIDE),
        file="measured.yaml",
        kind="yaml",
        made=YAML,
        codes=ONLY,
    ),
    Case(
        name="urdf",
        arguments=("gait", "ripple", "--robot", "measured.yaml", *OUTSIDE),
        file="robot.urdf",
        kind="xml",
        made=TEXT,
        codes=ONLY,
    ),
    Case(
        name="log",
        arguments=("replay", "run.mcap"),
        file="run.mcap",
        kind="mcap",
        made=(m.other_records,),
    ),
    Case(
        name="servos",
        arguments=("run", "plan.json", "--world", "dynamixel", "--setup", "servos.yaml"),
        file="servos.yaml",
        kind="yaml",
        made=YAML,
    ),
    Case(
        name="ros",
        arguments=("run", "plan.json", "--world", "ros", "--setup", "ros.yaml"),
        file="ros.yaml",
        kind="yaml",
        made=YAML,
    ),
    Case(
        name="data header",
        arguments=("verify", "data"),
        file="data/header.json",
        kind="json",
        made=JSON,
    ),
    Case(
        name="data rows",
        arguments=("verify", "data"),
        file="data/shard-00000.parquet",
        kind="parquet",
    ),
    Case(
        name="data times",
        arguments=("label", "wall-3", "data", *PLAN),
        file="data/timing-00000.json",
        kind="json",
        made=JSON,
    ),
    Case(
        name="experiment",
        arguments=("bench", "envelopes", "--config", "bench.yaml", "--out", "full/x"),
        file="bench.yaml",
        kind="yaml",
        made=YAML,
        codes=ONLY,
    ),
    Case(
        name="fitting",
        file="fit.yaml",
        kind="yaml",
        made=YAML,
        arguments=(
            "fit",
            "data",
            "--method",
            "heuristic",
            "--config",
            "fit.yaml",
            "--out",
            "e.json",
        ),
    ),
    Case(
        name="neural",
        arguments=(
            "evaluate",
            "data",
            "--selector",
            "neural.safetensors",
            "--no-lift",
            "--projection",
            "fix-p",
        ),
        file="neural.safetensors",
        kind="safetensors",
        made=(m.other_metadata,),
    ),
)
"""Readers of one file each."""


def cases() -> list[Case]:
    """All readers."""
    found = list(_ALONE)
    made: dict[str, tuple[m.Bytes, ...]] = {
        "npy": (m.other_header,),
        "npz": NPZ,
        "csv": TEXT,
        "png": (m.other_chunk,),
        "stl": (),
        "obj": TEXT,
        "ply": (),
        "off": TEXT,
        "glb": (),
    }
    for suffix, ways in made.items():
        more = ("--heights-m", "0,0.3") if suffix == "png" else ()
        file = f"terrain.{suffix}"
        found.append(
            Case(
                name=f"heights {suffix}",
                arguments=("gait", file, *OUTSIDE, *more),
                file=file,
                kind=suffix,
                made=ways,
                codes=ONLY,
            )
        )
    for file in ("terrain-text.stl", "terrain-text.ply", "terrain.dae"):
        found.append(
            Case(
                name=f"heights {file[7:]}",
                arguments=("gait", file, *OUTSIDE),
                file=file,
                kind=file[-3:],
                made=TEXT,
                codes=ONLY,
            )
        )
    for file in ("cloud.pcd", "text.pcd", "cloud.xyz", "cloud.ply"):
        way = (m.renumbered,) if file in ("text.pcd", "cloud.xyz") else ()
        found.append(
            Case(
                name=file,
                arguments=("terrain", file, "--spacing-m", "0.25"),
                file=file,
                kind=file[-3:],
                made=way,
            )
        )
    for kind in ("-stl", "-text-stl", "-obj", "-ply", "-text-ply", "-off", "-glb", "-dae"):
        file = f"foot{kind[::-1].replace('-', '.', 1)[::-1]}"
        way = TEXT if kind in ("-text-stl", "-obj", "-text-ply", "-off", "-dae") else ()
        found.append(
            Case(
                name=f"robot{kind}",
                arguments=("robot", f"foot{kind}.urdf", "--json"),
                file=file,
                kind=kind[-3:],
                made=way,
            )
        )
    found.append(
        Case(
            name="srdf",
            arguments=("robot", "dog.urdf", "--srdf", "dog.srdf", "--json"),
            file="dog.srdf",
            kind="xml",
            made=TEXT,
        )
    )
    found.append(
        Case(
            name="mjcf",
            arguments=("robot", "motion.xml", "--json"),
            file="motion.xml",
            kind="xml",
            made=TEXT,
        )
    )
    for suffix, ways in MOTIONS.items():
        found.append(
            Case(
                name=f"motion {suffix}",
                arguments=("verify", f"motion.{suffix}", "--course", "course.json"),
                file=f"motion.{suffix}",
                kind=suffix,
                made=ways,
            )
        )
    for suffix in ("stl", "obj", "ply"):
        found.append(
            Case(
                name=f"mesh {suffix}",
                arguments=("plan", f"mesh-{suffix}.yaml"),
                file=f"mesh.{suffix}",
                kind=suffix,
                made=made[suffix],
            )
        )
    return found


def command(arguments: tuple[str, ...]) -> tuple[int, str, str]:
    """Run the command in this process: exit code, standard output, standard error."""
    from stancekit.cli.main import main

    return said(lambda: main(list(arguments)))


def said(call: Callable[[], Any]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a call of the command's entry, or of one of
    its verbs.
    """
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = call()
        except SystemExit as end:
            code = end.code
    return int(code or 0), out.getvalue(), err.getvalue()


def fault(case: Case, code: int, err: str, right: frozenset[int]) -> str:
    """What is wrong with how the command took a damaged file; empty where nothing is."""
    if "Traceback" in err or "internal error" in err:
        return f"internal error: {err[-300:]}"
    if code not in right:
        return f"exit code {code}, right are {sorted(right)}: {err[-200:]}"
    lines = err.count("\n")
    if code == 2 and case.kind != "jsonl" and lines != 1:
        return f"{lines} lines: {err[-300:]}"
    if code == 2 and not err.startswith("stancekit: error: "):
        return f"said: {err[-200:]}"
    if "\x1b" in err:
        return "an order to the terminal"
    return ""
