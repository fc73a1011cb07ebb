"""Answers, reports and plans in notebooks: a line, a picture of the stance as SVG, and a table of groups.

Pictures are text that is made here, so that a notebook needs no other package; ``stancekit.draw`` makes better ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.arrays import Array

if TYPE_CHECKING:
    from .answer import Answer
    from .leap_plan import LeapPlan
    from .plan import Plan
    from .report import Report
    from .trajectory import Trajectory

WIDTH_PX, HEIGHT_PX, MARGIN_PX = 480, 300, 16
MOST_ROWS = 60
"""Of a table."""
COLOURS = {"holds": "#2a7f62", "violated": "#b3261e"}
AZIMUTH_RAD, ELEVATION_RAD = -1.1, 0.45
"""From where a stance is seen."""
LONGEST = 0.25
"""Of the arrow of the largest force, as a share of the picture."""


def report_html(report: Report[Any]) -> str:
    """The verdict, and a row per group."""
    rows = "".join(
        f'<tr><td>{escape(group.name)}</td><td style="color:{COLOURS.get(group.verdict, "#777")}">{group.verdict}</td>'
        f"<td>{group.value:.3g} of {group.limit:.3g} {escape(group.unit)}</td>"
        f"<td>{escape(group.where)}</td><td>{escape(group.message)}</td></tr>"
        for group in report.groups[:MOST_ROWS]
    )
    return f"<p><b>{escape(report.message)}</b></p><table>{rows}</table>"


def answer_html(answer: Answer[Plan | LeapPlan | Trajectory]) -> str:
    """Status, picture and report of an answer."""
    shown = "" if answer.solution is None else answer.solution._repr_html_()
    judged = "" if answer.report is None else report_html(answer.report)
    said = f"<p><b>{answer.status.value}</b> by {escape(answer.method)}{escape(_after(answer.message))}</p>"
    return said + shown + judged


def plan_html(plan: Plan | LeapPlan) -> str:
    """The first stance of a plan over the patches that it takes, and the way of the body."""
    problem = plan.problem
    patches = [problem.patch(p, plan.choice).vertices_m for p in range(len(problem.footholds))]
    holds = problem.holds[0]
    first = [int(p) for p in holds if p >= 0]
    forces = plan.forces_n[0][np.asarray(holds) >= 0]
    return f"<p>{escape(repr(plan))}</p>" + _svg(patches, plan.toes_m[first], forces, plan.com_m)


def walk_html(walk: Trajectory) -> str:
    """Picture of where the feet of a walk stand and what they carry at its middle, and of the way
    of the torso."""
    middle = len(walk.times_s) // 2
    stands = walk.contact[middle]
    toes, forces = walk.feet_m[middle][stands], walk.forces_n[middle][stands]
    step = max(1, len(walk.times_s) // 100)
    every = walk.feet_m[::step][walk.contact[::step]]
    marks = [place + 0.01 * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]) for place in every]
    return f"<p>{escape(repr(walk))}</p>" + _svg(marks, toes, forces, walk.torso_m[::step])


def _after(message: str) -> str:
    return f": {message}" if message else ""


def _svg(polygons: Sequence[Array], toes: Array, forces: Array, way: Array) -> str:
    """Polygons from behind, legs from the body to its toes, forces, and the way of the body."""
    points = np.concatenate([*polygons, toes, way])
    flat, _ = _seen(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([WIDTH_PX, HEIGHT_PX]) - 2.0 * MARGIN_PX
    scale = float((room / np.maximum(high - low, 1e-9)).min())

    def drawn(places: Array) -> str:
        across = (_seen(places)[0] - low) * scale + MARGIN_PX
        return " ".join(f"{x:.1f},{HEIGHT_PX - y:.1f}" for x, y in across)

    order = sorted(range(len(polygons)), key=lambda k: -float(_seen(polygons[k])[1].mean()))
    parts = [f'<polygon points="{drawn(polygons[k])}" fill="#d9d4c7" stroke="#8a8577"/>' for k in order]
    parts.append(f'<polyline points="{drawn(way)}" fill="none" stroke="#e8a317" stroke-dasharray="4 3"/>')
    most = max(float(np.linalg.norm(forces, axis=1).max(initial=0.0)), 1e-9)
    longest = LONGEST * float(room.min()) / scale
    for toe, force in zip(toes, forces, strict=True):
        parts.append(f'<polyline points="{drawn(np.array([way[0], toe]))}" stroke="#444" stroke-width="2"/>')
        arrow = np.array([toe, toe + longest / most * force])
        parts.append(f'<polyline points="{drawn(arrow)}" stroke="#b3261e" stroke-width="2"/>')
    body = drawn(way[:1]).split(",")
    parts.append(f'<circle cx="{body[0]}" cy="{body[1]}" r="6" fill="#2a5d9f"/>')
    size = f'width="{WIDTH_PX}" height="{HEIGHT_PX}" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'


def _seen(points: Array) -> tuple[Array, Array]:
    """Places of points in the picture, shape (K, 2), and their distances from the eye, shape (K,).
    """
    ca, sa, ce, se = np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD), np.cos(ELEVATION_RAD), np.sin(ELEVATION_RAD)
    x, y, z = points.T
    right, ahead = -sa * x + ca * y, ca * x + sa * y
    return np.stack([right, ce * z - se * ahead], axis=1), -(ce * ahead + se * z)
