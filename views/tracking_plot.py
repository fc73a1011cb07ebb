"""The picture of a run's tracking, drawn from its log: joints, body, forces and commands over
time.
"""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import shown
from stancekit.runner.log import TOPICS, Recorded, table

from .sheet import DEFAULT_STYLE, MEASURE_COLOURS, headline, leg_colour, quiet_axes

AXIS_COLOURS = (MEASURE_COLOURS[0], MEASURE_COLOURS[1], MEASURE_COLOURS[4])
SIZE_IN, HEAD_IN = (12.0, 10.0), 0.9
TOUCH_N = 1.5
"""A foot that feels more than this touches."""
REPLANS = ("plan anew", "stand")
"""Decisions that are drawn: the rest was planned again, or feet slid and the robot stood."""
PLANNED: dict[str, Any] = {"linestyle": ":", "linewidth": 0.9}


def tracked(recorded: Recorded) -> dict[str, Array]:
    """Times, angles as planned, sent and measured, torques, and forces of a log; shape (T,), (T, J)
    and (T, N, 3).

    Raises InvalidInput for a log without a command, and for one whose messages do not go together.
    """
    commands, states = recorded.of("command"), recorded.of("measurement")[1:]
    rows = min(len(commands), len(states))
    if not rows:
        raise InvalidInput("log: expected commands, got none: nothing was sent")
    limbs = _limbs(recorded.of("plan")[0])
    joints = sum(map(len, limbs.values()))
    shapes: dict[str, tuple[int, ...]] = {
        "planned_rad": (joints,),
        "sent_rad": (joints,),
        "time_s": (),
        "angles_rad": (joints,),
        "torques_nm": (joints,),
        "forces_n": (len(limbs), 3),
        "position_m": (3,),
    }
    return {
        name: table(
            [
                each.get(name)
                for each in (
                    commands if name in TOPICS["command"] and name != "time_s" else states
                )[:rows]
            ],
            (rows, *shape),
            f"log: {name}",
        )
        for name, shape in shapes.items()
    }


def differences(tracks: dict[str, Array]) -> dict[str, float]:
    """Differences of measured joints from the plan: worst, root mean square [rad]."""
    away = tracks["angles_rad"] - tracks["planned_rad"]
    return {
        "joint_worst_rad": float(np.abs(away).max()),
        "joint_rms_rad": float(np.sqrt(np.mean(away**2))),
    }


@DEFAULT_STYLE
def draw_tracking(recorded: Recorded) -> Figure:
    """Draw a log.

    Raises InvalidInput for one without commands.
    """
    plan: dict[str, Any] = recorded.of("plan")[0]
    tracks = tracked(recorded)
    joints, time_s = _limbs(plan), tracks["time_s"]
    limbs, begins = list(joints), np.cumsum([0, *map(len, joints.values())])[:-1]
    figure = Figure(figsize=SIZE_IN)
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - HEAD_IN / SIZE_IN[1]))
    aims = targets(recorded, len(limbs))
    top, middle, low, *slid, bottom = figure.subplots(4 if aims is None else 5, 1, sharex=True)
    away = 1e3 * np.abs(tracks["angles_rad"] - tracks["planned_rad"])
    _limb_lines(top, time_s, np.maximum.reduceat(away, begins, axis=1), limbs)
    top.set_ylabel("joints off\nthe plan [mrad]")
    torque = np.maximum.reduceat(np.abs(tracks["torques_nm"]), begins, axis=1)
    _limb_lines(middle, time_s, torque, limbs)
    middle.set_ylabel("largest\ntorque [Nm]")
    if (limits := plan.get("torque_nm")) is not None:
        most = float(np.max(table(limits, (len(plan["joints"]),), "log: torque_nm")))
        middle.axhline(most, color="0.4", linestyle="--", linewidth=0.8)
        middle.text(
            time_s[0], most, "limit of the strongest joint", va="top", fontsize="small", color="0.4"
        )
    _limb_lines(low, time_s, np.linalg.norm(tracks["forces_n"], axis=2), limbs)
    low.set_ylabel("force on\nfoot [N]")
    if aims is not None:
        slid[0].set_ylabel("feet slid\n[mm]")
        _limb_lines(low, aims["time_s"], np.linalg.norm(aims["forces_n"], axis=2), limbs, PLANNED)
        _limb_lines(slid[0], aims["time_s"], 1e3 * slips(recorded, aims), limbs)
        for axis in range(3):
            planned = 1e3 * (aims["origin_m"][:, axis] - tracks["position_m"][0, axis])
            bottom.plot(
                aims["time_s"],
                planned,
                color=AXIS_COLOURS[axis],
                label="planned" if axis == 2 else None,
                **PLANNED,
            )
    for each in recorded.of("decision"):
        if each["what"] in REPLANS and "time_s" in each:
            for axes in figure.axes:
                axes.axvline(each["time_s"], color="0.6", linewidth=0.6)
    for axis, name in enumerate("xyz"):
        moved = 1e3 * (tracks["position_m"][:, axis] - tracks["position_m"][0, axis])
        bottom.plot(time_s, moved, color=AXIS_COLOURS[axis], label=name)
    bottom.set_ylabel("body moved\n[mm]")
    bottom.set_xlabel("time [s]")
    for axes in figure.axes:
        quiet_axes(axes)
    for axes in (top, bottom):
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.0,
            ncols=len(limbs),
            fontsize="small",
            frameon=False,
        )
    summary = differences(tracks)
    end = "" if recorded.whole else "; the log breaks off"
    headline(
        figure,
        f"{plan['course']} on {plan.get('world', '?')}",
        f"joints within {1e3 * summary['joint_worst_rad']:.1f} mrad of the plan, "
        f"{1e3 * summary['joint_rms_rad']:.1f} mrad "
        f"(RMS){end}",
    )
    return figure


def _limbs(plan: dict[str, Any]) -> dict[str, list[str]]:
    """Names of every limb's joints.

    Raises InvalidInput for limbs that are not those of the joints, in their order.
    """
    joints, limbs = plan["joints"], plan.get("limbs")
    parts: dict[str, list[str]] = limbs if isinstance(limbs, dict) else {}
    lists = parts and all(isinstance(part, list) and part for part in parts.values())
    if not lists or list(chain.from_iterable(parts.values())) != joints:
        raise InvalidInput(
            f"log: limbs: expected the names of {len(joints)} joints by limb, got {shown(limbs)}"
        )
    return parts


def targets(recorded: Recorded, limbs: int) -> dict[str, Array] | None:
    """Times, planned body and forces, what feet stood on and should have rolled, as far as the log
    has them; shape (T,), (T, 3), (T, N, 3), (T, N), (T, N, 3). None of a log that does not say.
    """
    result = recorded.of("target")
    shapes = {
        "time_s": (),
        "origin_m": (3,),
        "forces_n": (limbs, 3),
        "foothold": (limbs,),
        "rolled_m": (limbs, 3),
    }
    if not result:
        return None
    return {
        name: table([each.get(name) for each in result], (len(result), *shape), f"log: {name}")
        for name, shape in shapes.items()
    }


def slips(recorded: Recorded, aims: dict[str, Array]) -> Array:
    """Slips of every foot from where it touched, 0 in the air, shape (T, N) [m]."""
    (rows, limbs), states = (
        aims["foothold"].shape,
        {each["time_s"]: each for each in recorded.of("measurement")},
    )
    felt, feet = (
        table(
            [states.get(time, {}).get(name) for time in aims["time_s"]],
            (rows, limbs, 3),
            f"log: {name}",
        )
        for name in ("forces_n", "feet_m")
    )
    feet, touches = feet - aims["rolled_m"], np.linalg.norm(felt, axis=2) > TOUCH_N
    result, place = np.zeros(touches.shape), np.full((limbs, 3), np.nan)
    before = np.full(limbs, np.nan)
    for row, holds in enumerate(aims["foothold"]):
        place[(holds < 0) | (holds != before)] = np.nan
        lands = (holds >= 0) & touches[row] & np.isnan(place[:, 0])
        place[lands], before = feet[row, lands], holds
        result[row] = np.nan_to_num(np.linalg.norm(feet[row] - place, axis=1))
    return result


def _limb_lines(
    axes: Axes, time_s: Array, values: Array, limbs: list[str], style: dict[str, Any] | None = None
) -> None:
    """One line a limb.

    Arguments:
        values: shape (T, N).
        style: of planned ones, which no legend names.
    """
    for index, limb in enumerate(limbs):
        options: dict[str, Any] = {"linewidth": 0.9, "label": limb} if style is None else style
        axes.plot(time_s, values[:, index], color=leg_colour(index), **options)
