"""The comparison of selectors as a page: a table a class of problems, the data, and a card a
selector.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from stancekit.envs.data.ledger import software

from .evaluate import TABLE_I
from .experiment import Experiment

CLAIMS = ("P1 feasible", "P1 infeasible")
IDENTITY = re.compile(r"-(of|on)-(.+?)-([0-9a-f]{6})[0-9a-f]{6}(?=-on-|$)")


def title_of(problem_class: str) -> str:
    """A class of problems in words: "terrain-3 of go1 (c828d3) on tiles (7802fa)", the digests of
    both files cut.
    """
    return IDENTITY.sub(r" \1 \2 (\3)", problem_class)


def page(records: Sequence[Mapping[str, Any]], experiment: Experiment) -> str:
    """Markdown of rows as ``Score.to_json`` has them, with ``problem_class`` and ``balanced``.

    Sorted by the mean of both shares of P1; shares are % with Wilson 95 % intervals. The paper's
    rows have no rank: their scenes are other draws. Below the tables stand the data and, a line a
    selector, what it was learned with.
    """
    text = "% of held-out scenes, with 95 % intervals (Wilson); the best share is bold."
    lines = ["# Leaderboard: selectors of envelopes", "", text, ""]
    for name in dict.fromkeys(record["problem_class"] for record in records):
        lines += _table(name, [record for record in records if record["problem_class"] == name])
    return "\n".join([*lines, *_data(experiment), *_cards(records), ""])


def _table(name: str, records: list[Mapping[str, Any]]) -> list[str]:
    ways = [
        key.removesuffix("_of").removeprefix("project_")
        for key in records[0]
        if key.startswith("project_") and key.endswith("_of")
    ]
    keys = ["p1_feasible", "p1_infeasible", *(f"project_{way}" for way in ways)]
    best = {
        key: max((row[key] for row in records if row[key] is not None), default=None)
        for key in keys
    }
    ranked = sorted(records, key=lambda row: -row["balanced"])
    counts = f"{records[0]['p1_feasible_of']} feasible and {records[0]['p1_infeasible_of']} infeasible scenes"
    lines = [f"## {title_of(name)}", "", f"{counts}.", ""]
    lines += [_row(["", "selector", *CLAIMS, *(way.replace("_", "-") for way in ways), "P1 [ms]"])]
    lines += [_row(["---:", "---", *("---:" for _ in keys), "---:"])]
    for rank, row in enumerate(ranked, 1):
        shares = (_share(row, key, bold=row[key] == best[key]) for key in keys)
        lines.append(_row([str(rank), str(row["selector"]), *shares, _number(row.get("p1_ms"))]))
    for selector, figures in TABLE_I.get(name, {}).items():
        by_way = {"project_fix_p": figures[2], "project_nlp": figures[3]}
        shown = [figures[0], figures[1], *(by_way.get(key) for key in keys[2:])]
        lines.append(
            _row(
                [
                    "",
                    f"paper: {selector}",
                    *("–" if x is None else f"{100.0 * x:.1f}" for x in shown),
                    "–",
                ]
            )
        )
    return [*lines, ""]


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _share(row: Mapping[str, Any], key: str, *, bold: bool) -> str:
    if row[key] is None:
        return "–"
    low, high = row[f"{key}_interval"]
    value = f"**{100.0 * row[key]:.1f}**" if bold else f"{100.0 * row[key]:.1f}"
    return f"{value} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _data(experiment: Experiment) -> list[str]:
    """Section on the rows that the methods learned from and were judged on, and on versions."""
    lines = [
        "## Data",
        "",
        _row(["part", "feasible", "infeasible", "seed"]),
        _row(["---", "---:", "---:", "---:"]),
    ]
    for part in ("train", "calibration", "test"):
        quota = getattr(experiment, part)
        if quota is not None:
            lines.append(_row([part, *map(str, (quota.feasible, quota.infeasible, quota.seed))]))
    of = [
        f"{key} `{value}`"
        for key in ("robot", "terrain")
        if (value := getattr(experiment, key)) is not None
    ]
    proved = (
        "Every label has a posture or a certificate, which `stancekit verify FOLDER` checks again."
    )
    hard = "Infeasible scenes need their moment balance to be so." + (
        f" Of {', '.join(of)}." if of else ""
    )
    made = (
        "Made with " + ", ".join(f"{name} {version}" for name, version in software().items()) + "."
    )
    return [*lines, "", f"{proved} {hard}", "", made, ""]


def _cards(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line a learned selector: its file, what fitting took, and where it must not be used."""
    learned = [row for row in records if "fit_seconds" in row]
    lines = [
        "## Cards",
        "",
        _row(["selector", "of", "file", "fitted in [s]"]),
        _row(["---", "---", "---", "---:"]),
    ]
    lines += [
        _row(
            [
                str(row["selector"]),
                row["problem_class"],
                row.get("file") or "none kept",
                _number(row["fit_seconds"]),
            ]
        )
        for row in learned
    ]
    return [
        *lines,
        "",
        "A selector is for the class, the robot and the terrain of its row: it is refused for "
        "others. Nothing that it",
        "says has to be believed: postures and certificates are verified. Settings are those of "
        "the experiment's file,",
        "seeds those above; seconds are of the wall clock.",
    ]
