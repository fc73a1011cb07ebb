"""Rewrite the files of plans, walks, leaps, crossings and proofs of before there was one format for
motions.

    python benchmarks/convert_motions.py FILE ... [--out FOLDER]

Each file keeps its name, in FOLDER or in its own place; its motion is judged anew.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from _bench import Options, launch

from stancekit.planners.files.codec import embedded
from stancekit.planners.formats.motion_file import (
    certificate_from,
    motion_from,
    write_certificate,
    write_motion,
)
from stancekit.planners.verify.judge import judge

WHOLE = ("timing", "choice")
"""Arrays of a leap that hold whole numbers."""
ASKED = {"heading_rad": None, "heading_end_rad": None, "still": [False, False], "suction_n": None}
"""Requests of a walk, where its file has none."""


def content_of(old: Mapping[str, Any]) -> dict[str, Any]:
    """Question, arrays and provenance of an old file's content; of a proof without the last."""
    kind = str(old.get("format")).split("/")[1]
    told = dict(old.get("provenance", {}))
    if kind == "plan":
        return {"question": old["course"], "columns": old["arrays"], "provenance": told}
    if kind == "gait":
        names = ("robot", "terrain", "friction", "adhesive", "start", "goal")
        asked = {**ASKED, **old.get("asked", {})}
        walk = {"format": "stancekit/walk/1", **{name: old[name] for name in names}, **asked}
        return {"question": walk, "columns": {"npz": old["samples"]}, "provenance": told}
    if kind == "crossing":
        proof = None if old["proof"] is None else content_of(old["proof"])
        parts = {"parts": [content_of(part) for part in old["parts"]], "certificate": proof}
        names = {"name": old["name"], "refusal": old["refusal"]}
        way = {"format": "stancekit/crossing/1", **names, **parts}
        return {"question": way, "columns": {"npz": embedded({})}, "provenance": {}}
    if kind == "proof":
        return {"question": old["subject"], "columns": _archive(old, ("tree", "multipliers"))}
    leap = {name: old[name] for name in old if name not in ("plan", "certificate")}
    if "plan" not in old:
        proof = old["certificate"]
        return {"question": leap, "columns": _archive(proof, ("tree", "multipliers"))}
    plan = {name: old["plan"][name] for name in old["plan"] if name != "provenance"}
    told = dict(old["plan"]["provenance"])
    return {"question": leap, "columns": _archive(plan, tuple(plan)), "provenance": told}


def _archive(arrays: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, str]:
    kinds = {name: np.int_ if name in WHOLE else np.float64 for name in names}
    return {"npz": embedded({name: np.array(arrays[name], dtype=kinds[name]) for name in names})}


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Files, and the folder where they go."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path | None = None


def main(asked: Asked) -> None:
    """Convert every file that is named."""
    for path in asked.files:
        content = content_of(json.loads(path.read_text("utf-8")))
        to = path if asked.out is None else asked.out / path.name
        if "provenance" not in content:
            write_certificate(to, certificate_from(content, str(path)))
            continue
        motion = motion_from(content, str(path))
        report = judge(motion)
        write_motion(to, motion, report)
        asked.say({"file": str(to), "verdict": report.message})


if __name__ == "__main__":
    launch(main, Asked, __doc__)
