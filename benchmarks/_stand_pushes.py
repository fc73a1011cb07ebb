"""What stances bear of a push: what the verifier says of each, and what was held of it in the
referee.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _stand_list import Lines
from referee import BrokenFile, KeyFrames, Push, Settings, Wrong, pushed, read

from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.verify.margins import stance_margins, verdict_yields_m

TURNS_DEG = (90.0, 270.0, 45.0, 225.0, 135.0, 315.0, 0.0, 180.0)
MOST = 1.3
"""What the verifier says should not be above what is held by more than this factor."""


def stances(files: Sequence[Path]) -> list[tuple[Path, int]]:
    """All stances of plans: the file, and which of its stances."""
    return [
        (file, stance)
        for file in files
        if isinstance(motion := read(file).motion, KeyFrames)
        for stance in range(len(motion.stances))
    ]


def drawn(every: Sequence[tuple[Path, int]], count: int, seed: int) -> dict[Path, list[int]]:
    """So many of them, drawn by seed, by file."""
    found: dict[Path, list[int]] = {}
    for index in sorted(np.random.default_rng(seed).permutation(len(every))[:count].tolist()):
        file, stance = every[index]
        found.setdefault(file, []).append(stance)
    return found


def rows(
    file: Path,
    which: Sequence[int],
    lines: Lines,
    settings: Settings,
    wrong: Wrong,
    most: float,
    whole: bool,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The pushes of a file's stances whose lines are missing, by the key of their line.

    Arguments:
        file: a plan.
        which: of its stances.
        lines: what is there already; the caller adds every row before it asks for the next.
        settings: the referee's.
        wrong: what is not as the file has it.
        most: largest push, in units of the weight.
        whole: push in every direction until it falls; or no farther than what was held in the worst
            one so far.
    """
    played = read(file)
    weight_n = played.robot.mass_kg * played.gravity_m_s2
    missing = [
        (stance, deg, key)
        for stance in which
        for deg in TURNS_DEG
        if (key := key_of(file, stance, deg)) not in lines.rows
    ]
    if not missing:
        return
    said = said_n(file)

    def asked() -> Iterator[Push]:
        for stance, deg, _ in missing:
            known = [lines.rows.get(key_of(file, stance, turn), {}) for turn in TURNS_DEG]
            held = [row["held_n"] for row in known if "held_n" in row]
            most_n = most * weight_n if whole else min([most * weight_n, *held])
            yield Push(most_n=most_n, towards_deg=deg, stance=stance)

    found = pushed(file, settings, wrong, asked())
    for stance, deg, key in missing:
        head = {
            "file": file.stem,
            "stance": stance,
            "towards_deg": deg,
            "said_n": round(said[stance], 3),
            "weight_n": round(weight_n, 2),
            "settings": settings.sha256[:8],
            "wrong": wrong.said(),
        }
        try:
            yield key, head | next(found).json()
        except BrokenFile as error:
            yield key, head | {"broken": str(error)}
            return


def key_of(file: Path, stance: int, deg: float) -> str:
    """What a line is known by."""
    return f"{file.parents[1].name}/{file.stem}:{stance}:{deg:.0f}"


def said_n(file: Path) -> list[float]:
    """The largest push that the verifier says each stance of a plan bears in every direction
    [N].
    """
    plan, _ = read_motion(file)
    pushes_n = stance_margins(plan, ("push_n",), yields_m=verdict_yields_m(plan))["push_n"]
    known = {
        (of.frame, frozenset(of.limbs)): float(push_n)
        for of, push_n in zip(plan.problem.stances, pushes_n, strict=True)
    }
    motion = read(file).motion
    assert isinstance(motion, KeyFrames)
    return [known[stance] for stance in motion.stances]


def summary(lines: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the verifier says of stances against what was held in the worst of all directions.

    Returns how many stances there are; of how many more was said than was held, and by more than
    ``MOST``; the least, the median and the largest of held / said where anything was said, and the
    same in units of the weight.
    """
    worst: dict[tuple[str, float], dict[str, Any]] = {}
    count: dict[tuple[str, float], int] = {}
    for row in lines:
        if "held_n" not in row:
            continue
        key = row["key"].rsplit(":", 1)[0], row["stance"]
        count[key] = count.get(key, 0) + 1
        if key not in worst or row["held_n"] < worst[key]["held_n"]:
            worst[key] = dict(row)
    whole = [row for key, row in worst.items() if count[key] == len(TURNS_DEG)]
    said, held, weight = (
        np.array([row[name] for row in whole]) for name in ("said_n", "held_n", "weight_n")
    )
    some = said > 0.0
    ratios = held[some] / said[some]
    return {
        "stances": len(whole),
        "above": int((said > held).sum()),
        "far_above": int((said > MOST * held).sum()),
        "ratio": _spread(ratios),
        "said": _spread(said / weight),
        "held": _spread(held / weight),
        "worst": [
            f"{row['key'].rsplit(':', 1)[0]}: said {row['said_n']:.3g} N, held {row['held_n']:.3g} N towards "
            f"{row['towards_deg']:.0f} deg"
            for row in whole
            if row["said_n"] > MOST * row["held_n"]
        ],
    }


def _spread(values: np.ndarray) -> list[float]:
    """Least, median and most."""
    if not len(values):
        return []
    return [round(float(v), 4) for v in (values.min(), np.median(values), values.max())]


def line(row: Mapping[str, Any]) -> str:
    """A summary for people."""
    parts = [f"{row['stances']} stances, more was said than held of {row['above']}"]
    parts.append(f"by more than {MOST:g} of {row['far_above']}")
    for name, what in (
        ("ratio", "held / said"),
        ("said", "said / weight"),
        ("held", "held / weight"),
    ):
        if row[name]:
            parts.append(
                f"{what} {row[name][0]:.3g} to {row[name][2]:.3g}, median {row[name][1]:.3g}"
            )
    return "; ".join(parts) + "".join(f"\n    {each}" for each in row["worst"])
