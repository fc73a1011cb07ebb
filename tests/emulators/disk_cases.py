"""Every verb that writes, each over what an earlier run of it wrote, as small as it can be."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import yaml

from stancekit.cli.main import main as stancekit

Words = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A verb. before: what was run in the folder before; dropped: patterns of what is then removed.
    code: its usual exit code. partial: what a run that was cut off may leave, by design. paths:
    what its errors may name besides.
    """

    name: str
    verb: Words
    before: tuple[Words, ...]
    dropped: Words = ()
    code: int = 0
    partial: Words = ()
    paths: Words = ()


def over(name: str, verb: Words, *others: str, **more: object) -> Case:
    """A case whose earlier run had other options at its end."""
    return Case(name=name, verb=verb, before=((*verb, *others),), **more)  # type: ignore[arg-type]


LABEL = (
    "label",
    "wall-3",
    "data",
    "--feasible",
    "6",
    "--infeasible",
    "6",
    "--shard-size",
    "4",
    "--workers",
    "1",
)
GAIT = ("gait", "{in}/plain.npy", "--goal", "0.2,0.1", "--chart", "decoupled", "--duration-s", "2")
PLAN = ("plan", "walls", "--frames", "3")
BENCH = (
    "bench",
    "gait",
    "--quick",
    "--terrain",
    "ripple",
    "--chart",
    "decoupled",
    "--tasks",
    "16",
    "--seeds",
    "0",
)
CASES = (
    over("sample", ("sample", "wall-3", "--count", "20", "--out", "p.jsonl"), "--seed", "1"),
    over(
        "solve",
        ("solve", "{in}/p.jsonl", "--certificate", "--out", "a.jsonl"),
        "--method",
        "two-stage",
    ),
    Case(
        name="label",
        verb=LABEL,
        before=(LABEL,),
        dropped=("data/*-00001.*", "data/*-00002.*"),
        paths=("data",),
    ),
    Case(name="label anew", verb=LABEL, before=(), paths=("data",)),
    over(
        "fit quantile",
        ("fit", "{in}/data", "--method", "quantile", "--out", "e.json"),
        "--share",
        "0.1",
    ),
    over(
        "fit ga",
        (
            "fit",
            "{in}/data",
            "--method",
            "ga",
            "--config",
            "{in}/fit.yaml",
            "--out",
            "e.json",
            "--checkpoint",
            "ga.npz",
        ),
        partial=("ga.npz",),
    ),
    over(
        "fit neural",
        (
            "fit",
            "{in}/data",
            "--method",
            "neural",
            "--config",
            "{in}/fit.yaml",
            "--out",
            "n.safetensors",
            "--seed",
            "2",
        ),
        "--seed",
        "1",
    ),
    over("picture", ("picture", "{in}/p.jsonl", "--out", "p.png"), "--envelopes", "{in}/e.json"),
    over("plan", (*PLAN, "--out", "climb.json"), "--frames", "2"),
    over(
        "plan, all",
        (*PLAN, "--out", "climb.json", "--picture", "c.png", "--html", "c.html"),
        "--frames",
        "2",
    ),
    over("plan, film", (*PLAN, "--video", "c.mp4"), "--frames", "2"),
    over(
        "plan, proof",
        ("plan", "{in}/ice.yaml", "--frames", "3", "--proof", "no.json"),
        "--frames",
        "2",
        code=1,
    ),
    over(
        "simulate",
        ("simulate", "{in}/plan.json", "--pace", "2", "--out", "t.npz", "--picture", "t.png"),
        "--pace",
        "4",
    ),
    over(
        "run",
        ("run", "{in}/plan.json", "--pace", "2", "--log", "run.mcap"),
        "--pace",
        "4",
        partial=("run.partial.mcap",),
    ),
    over("replay", ("replay", "{in}/run.mcap", "--picture", "r.png")),
    over(
        "warp",
        ("warp", "{in}/plain.npy", "--cells", "8,8,3", "--out", "m.npz", "--picture", "m.png"),
    ),
    over(
        "gait",
        (*GAIT, "--out", "walk.json", "--picture", "w.png", "--html", "w.html"),
        "--friction",
        "0.7",
    ),
    Case(name="bench gait", verb=(*BENCH, "--out", "bench"), before=(), paths=("bench",)),
)


def made_inputs(folder: Path) -> Path:
    """What the cases read."""
    folder.mkdir(parents=True)
    x = 0.05 * (np.arange(81) - 40.0)
    np.save(folder / "plain.npy", 0.1 * x[:, None] + 0.0 * x)
    walls = yaml.safe_load(
        (resources.files("stancekit.configs.courses") / "walls.yaml").read_text()
    )
    walls["terrain"]["friction"] = 0.3
    (folder / "ice.yaml").write_text(yaml.safe_dump(walls | {"name": "ice"}))
    quick = {
        "genetic": {"population": 6, "generations": 2, "terrains": 4},
        "neural": {"epochs": 1, "margin_epochs": 1},
    }
    (folder / "fit.yaml").write_text(yaml.safe_dump(quick))
    for words in (
        ("sample", "wall-3", "--count", "2", "--out", "p.jsonl"),
        ("label", "wall-3", "data", "--feasible", "20", "--infeasible", "20", "--workers", "1"),
        ("fit", "data", "--method", "quantile", "--out", "e.json"),
        ("plan", "walls", "--frames", "3", "--out", "plan.json"),
        ("run", "plan.json", "--pace", "4", "--log", "run.mcap"),
    ):
        placed = (str(folder / word) if "." in word or word == "data" else word for word in words)
        try:
            stancekit(list(placed))
        except SystemExit as end:
            if end.code:
                raise
    return folder
