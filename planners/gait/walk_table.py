"""Walks of any program as tables: NAME.yaml says what walked where, NAME.csv or NAME.npz has the
samples.

The samples, SI units and world frame, a row a sample:

* CSV, with a head line: ``t_s``; ``base_x_m base_y_m base_z_m``, the centre of mass; ``base_qw base_qx base_qy
  base_qz``, its rotation; of every foot F ``F_x_m F_y_m F_z_m`` and the force on it, ``F_fx_n
  F_fy_n F_fz_n``; and, where the program says so, ``F_stands``, 0 or 1;
* NPZ: ``t_s`` (K,), ``base_m`` (K, 3), ``base_wxyz`` (K, 4), ``feet_m`` (K, E, 3), ``forces_n`` (K, E, 3), and
  ``stands`` (K, E), feet in the robot's order.

A foot whose program does not say whether it stands does where it is pushed with more than
``_LOADED`` of the weight. Walks are judged on samples 5 ms apart or closer; coarser ones are
refused, since what is between samples is not known.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..answer.trajectory import Trajectory, WalkQuestion
from ..errors import InvalidInput, located
from ..files.arrays import (
    Array,
    check_numbers,
    checked_choice,
    checked_int,
    read_archive,
    read_only,
)
from ..files.documents import read_text, read_yaml, validated
from ..robot.model import Robot
from ..robot.walker import named_walker
from ..terrain.families import drawn_name
from ..terrain.import_options import ImportOptions
from ..terrain.reference import named_terrain
from .charts import CHARTS

_Dynamics = Literal["centred", "printed", "newton-euler"]


@dataclass(frozen=True, kw_only=True)
class GaitSettings:
    """Settings of how a walk is written down and solved.

    Arguments:
        chart: how variables become world quantities, a name of ``charts.CHARTS`` or
            ``FILE.py:NAME``.
        dynamics: ``centred``, PCDM with the force balanced by y₊ − 2y + y₋; ``printed``, W11 as
            printed; ``newton-euler``, W2.
        hessian: ``exact``, or ``lbfgs`` for the paper's comparison.
        max_iterations: iterations of one solve.
        tolerance: success is a largest violation below it [m, m·g, m·g·stand height].
        step_s: Δt [s], a share of the task's duration; smaller means more rows, and less to find
            between them.
        torso_knot_s, force_knot_s: spacing of the splines' knots [s].
        reach_margin_m: kept in hand inside the reach boxes [m].
        clearance_m: of swinging feet in the middle of a swing [m]; swing_height_m: the same in the
            initial guess.
        trunk_clearance_m: of the trunk's lower face over the terrain [m], None for no such term.
        footing: the steepest ground about where a foot stands, as a share of the slope on which
            friction holds; 0 for no such term, None for 0.6 where the ground on the way has such
            places, see ``gait_program.sure``.
        swing_nodes: checks of a swing between its ends where the chart does not flatten the
            terrain.
        smoothing_m: deviation of the Gaussian under which the decoupled chart has the torso's
            terrain [m].
        switch_slack_s: how far optimised switching times may move [s].
        still_end: end at rest.
        poised: begin and end as the robot stands, level and with every foot where it is then, so
            that another walk can go on from there.
        mean_forces: balance a node's motion by the mean of the forces about it, as p₊ − 2 p + p₋ is
            one, instead of by those at the node; what balances add up to over time is right then,
            but some walks are harder to find. Centred dynamics and fixed timings alone.

    Raises:
        InvalidInput: for an unknown chart or word, and for numbers out of range.
    """

    chart: str = "decoupled"
    dynamics: _Dynamics = "centred"
    hessian: Literal["exact", "lbfgs"] = "exact"
    max_iterations: int = 200
    tolerance: float = 1e-4
    step_s: float = 0.05
    torso_knot_s: float = 0.1
    force_knot_s: float = 0.05
    reach_margin_m: float = 0.005
    clearance_m: float = 0.02
    swing_height_m: float = 0.08
    trunk_clearance_m: float | None = 0.01
    footing: float | None = None
    swing_nodes: int = 5
    smoothing_m: float = 0.3
    switch_slack_s: float = 0.1
    still_end: bool = True
    poised: bool = False
    mean_forces: bool = False

    def __post_init__(self) -> None:
        CHARTS.get(self.chart)
        checked_choice(self.dynamics, "dynamics", get_args(_Dynamics))
        checked_choice(self.hessian, "hessian", ("exact", "lbfgs"))
        above = ("tolerance", "step_s", "torso_knot_s", "force_knot_s", "smoothing_m")
        check_numbers(
            self,
            above=above,
            least=("reach_margin_m", "clearance_m", "swing_height_m", "switch_slack_s", "footing"),
        )
        if self.mean_forces and self.dynamics != "centred":
            raise InvalidInput(
                f"mean_forces: expected centred dynamics with it, got {self.dynamics}"
            )
        for name in ("max_iterations", "swing_nodes"):
            checked_int(getattr(self, name), f"{name}", least=1)


_LOADED = 1e-3
"""Share of the weight."""
_MOST_ROWS = 500_000
_BASE = ("base_x_m", "base_y_m", "base_z_m", "base_qw", "base_qx", "base_qy", "base_qz")
_OF_FEET = ("x_m", "y_m", "z_m", "fx_n", "fy_n", "fz_n")
_Seconds = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
_Place = tuple[float, float]


class WalkKeys(BaseModel):
    """The keys of NAME.yaml.

    Arguments:
        program: name of the program that made the walk.
        robot, terrain: robot and terrain as in ``stancekit gait``; paths are from this file's folder.
        spacing_m: spacing of a terrain's grid.
        friction: friction coefficient ν.
        start: start of the centre of mass.
        goal: goal of the centre of mass.
        cpu_process_s: CPU time of the whole process.
        cpu_solver_s: CPU time of its solver.
        task: number of the task in the paper.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    program: Annotated[str, Field(min_length=1, max_length=80)]
    robot: str = "anymal-boxes"
    terrain: str
    spacing_m: Annotated[float, Field(gt=0.0)] = 0.05
    friction: Annotated[float, Field(ge=0.0, le=10.0)]
    start: _Place
    goal: _Place
    cpu_process_s: _Seconds | None = None
    cpu_solver_s: _Seconds | None = None
    task: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class _WalkTable:
    """A walk of some program: its name, its description, and the walk itself."""

    name: str
    keys: WalkKeys
    trajectory: Trajectory


def walk_names(folder: str | Path) -> tuple[Path, ...]:
    """The walks of a folder, by their YAML files.

    Raises InvalidInput for a path that is no folder, and a folder without walks.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InvalidInput(f"{folder}: expected a folder of walks, found none")
    names = tuple(sorted(folder.glob("*.yaml")))
    if not names:
        raise InvalidInput(
            f"{folder}: expected walks, NAME.yaml with NAME.csv or NAME.npz beside it, found none"
        )
    return names


def read_walk(path: str | Path) -> _WalkTable:
    """The walk of a YAML file and the samples beside it.

    Raises InvalidInput, one line, for keys that are wrong, samples that are missing, and samples of
    other shapes.
    """
    path = Path(path)
    keys = validated(WalkKeys, read_yaml(path), str(path))
    with located(str(path)):
        robot = named_walker(_from(path, keys.robot))
        terrain = named_terrain(_from(path, keys.terrain), ImportOptions(spacing_m=keys.spacing_m))
    table, packed = path.with_suffix(".csv"), path.with_suffix(".npz")
    if table.exists() == packed.exists():
        came = "both" if table.exists() else "neither"
        raise InvalidInput(f"{path}: expected {table.name} or {packed.name} beside it, got {came}")
    where = table if table.exists() else packed
    with located(str(where)):
        samples = (
            _of_table(table, robot) if table.exists() else _samples(read_archive(packed), robot)
        )
        trajectory = Trajectory(
            **samples,
            problem=WalkQuestion(
                robot=robot,
                terrain=terrain,
                friction=keys.friction,
                adhesive=np.zeros(len(robot.feet), dtype=bool),
                start=np.array(keys.start),
                goal=np.array(keys.goal),
            ),
            provenance={"program": keys.program},
        )
    return _WalkTable(name=path.stem, keys=keys, trajectory=trajectory)


def _from(path: Path, name: str) -> str:
    """A name, or a file by its path from the YAML file's folder."""
    is_draw = drawn_name(name) and ".py:" not in name
    return str(path.parent / name) if Path(name).suffix and not is_draw else name


def _of_table(path: Path, robot: Robot) -> dict[str, Any]:
    """The samples of a CSV file.

    Raises InvalidInput.
    """
    rows = list(csv.reader(io.StringIO(read_text(path))))
    head, body = [name.strip() for name in rows[0]], [row for row in rows[1:] if row]
    names = [foot.name for foot in robot.feet]
    wanted = ["t_s", *_BASE, *(f"{name}_{part}" for name in names for part in _OF_FEET)]
    optional = [f"{name}_stands" for name in names]
    missing = [name for name in wanted if name not in head]
    unknown = [name for name in head if name not in (*wanted, *optional)]
    if missing or unknown or len(set(head)) != len(head):
        raise InvalidInput(
            f"expected one column each of t_s, {_BASE[0]} … {_BASE[-1]} and, of {', '.join(names)}, "
            f"{_OF_FEET[0]} … {_OF_FEET[-1]}; "
            + (f"missing {missing[0]}" if missing else f"got {(unknown or head)[0]}")
        )
    if len(body) > _MOST_ROWS:
        raise InvalidInput(f"expected {_MOST_ROWS} rows or fewer, got {len(body)}")
    try:
        values = np.array(body, dtype=np.float64).reshape(len(body), len(head))
    except ValueError:
        raise InvalidInput(f"expected {len(head)} numbers in every row, got other values") from None
    column = {name: values[:, index] for index, name in enumerate(head)}

    def of(parts: tuple[str, ...]) -> Array:
        return np.stack(
            [np.stack([column[f"{name}_{part}"] for part in parts], axis=1) for name in names],
            axis=1,
        )

    arrays = {
        "t_s": column["t_s"],
        "base_m": np.stack([column[name] for name in _BASE[:3]], axis=1),
        "base_wxyz": np.stack([column[name] for name in _BASE[3:]], axis=1),
        "feet_m": of(_OF_FEET[:3]),
        "forces_n": of(_OF_FEET[3:]),
    }
    if all(name in column for name in optional):
        arrays["stands"] = np.stack([column[name] for name in optional], axis=1)
    return _samples(arrays, robot)


def _samples(arrays: Mapping[str, Array], robot: Robot) -> dict[str, Any]:
    """Arrays as a trajectory has them.

    Raises InvalidInput for one that is missing, unknown or of another shape.
    """
    feet = len(robot.feet)
    if "t_s" not in arrays:
        raise InvalidInput("t_s: expected this array, got nothing")
    count = int(np.asarray(arrays["t_s"]).size)
    shapes = {
        "t_s": (count,),
        "base_m": (count, 3),
        "base_wxyz": (count, 4),
        "feet_m": (count, feet, 3),
        "forces_n": (count, feet, 3),
        "stands": (count, feet),
    }
    unknown = [name for name in arrays if name not in shapes]
    missing = [name for name in shapes if name not in arrays and name != "stands"]
    if unknown or missing:
        raise InvalidInput(
            f"{(missing or unknown)[0]}: "
            + ("expected this array, got none" if missing else "unknown array")
        )
    arrays_of_walk = {
        name: read_only(arrays[name], shape, name)
        for name, shape in shapes.items()
        if name in arrays
    }
    length = np.linalg.norm(arrays_of_walk["base_wxyz"], axis=1)
    if count and not np.all(np.abs(length - 1.0) < 1e-3):
        worst = float(length[np.argmax(np.abs(length - 1.0))])
        raise InvalidInput(f"base_wxyz: expected unit quaternions, got one of length {worst:g}")
    stands = arrays_of_walk.get("stands")
    if stands is None:
        stands = np.linalg.norm(arrays_of_walk["forces_n"], axis=2) > _LOADED * robot.weight_n
    elif not np.isin(stands, (0.0, 1.0)).all():
        raise InvalidInput("stands: expected 0 or 1 for every foot, got other values")
    return {
        "times_s": arrays_of_walk["t_s"],
        "torso_m": arrays_of_walk["base_m"],
        "rotation": _rotations(arrays_of_walk["base_wxyz"] / length[:, None]),
        "feet_m": arrays_of_walk["feet_m"],
        "forces_n": arrays_of_walk["forces_n"],
        "contact": np.asarray(stands, dtype=bool),
    }


def _rotations(wxyz: Array) -> Array:
    """R of unit quaternions, shape (K, 3, 3)."""
    from scipy.spatial.transform import Rotation  # slow to import

    return (
        np.asarray(Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix())
        if len(wxyz)
        else np.zeros((0, 3, 3))
    )


def table_of(trajectory: Trajectory) -> str:
    """The samples of a trajectory as such a table, CSV, with what stands."""
    from scipy.spatial.transform import Rotation

    names = [foot.name for foot in trajectory.robot.feet]
    head = [
        "t_s",
        *_BASE,
        *(f"{name}_{part}" for name in names for part in _OF_FEET),
        *(f"{n}_stands" for n in names),
    ]
    feet = np.concatenate([trajectory.feet_m, trajectory.forces_n], axis=2).reshape(
        trajectory.samples, -1
    )
    wxyz = Rotation.from_matrix(trajectory.rotation).as_quat()[:, [3, 0, 1, 2]]
    rows = np.column_stack([trajectory.times_s, trajectory.torso_m, wxyz, feet, trajectory.contact])
    return (
        "\n".join(
            [",".join(head), *(",".join(repr(float(value)) for value in row) for row in rows)]
        )
        + "\n"
    )
