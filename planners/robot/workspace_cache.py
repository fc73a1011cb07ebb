"""Workspaces of a whole robot, measured once and kept on disk by the digest of what they depend on."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ..files.archive import read_archive
from ..files.writing import write_bytes
from .leg import Leg
from .outer import OuterSet
from .polytope import Polytope
from .workspace import Workspace, workspace_of

if TYPE_CHECKING:
    from .robot_model import RobotModel

VERSION = "workspace/1"
"""Part of every digest: a change of method changes it, and older files are no longer found."""
FOLDER = "STANCEKIT_CACHE"


def cache_folder() -> Path:
    """Where measured workspaces are kept: $STANCEKIT_CACHE, or the user's folder for caches."""
    own, users = os.environ.get(FOLDER), os.environ.get("XDG_CACHE_HOME")
    return Path(own) if own else (Path(users) if users else Path.home() / ".cache") / "stancekit"


def workspaces_of(robot: RobotModel, *, cached: bool = True) -> tuple[Workspace, ...]:
    """Workspaces of all legs, in the robot's order; read where they were measured before.

    cached: False measures again and keeps nothing. A file that is damaged counts as none, a folder that cannot be
    written to keeps none. Raises InvalidInput for a leg without a workspace that has an inside.
    """
    if not cached:
        return tuple(workspace_of(leg) for leg in robot.legs)
    said = "\0".join([VERSION, robot.digest])
    path = cache_folder() / "workspaces" / f"{hashlib.sha256(said.encode()).hexdigest()}.npz"
    with suppress(InvalidInput):
        return _read(path, robot.legs)
    measured = tuple(workspace_of(leg) for leg in robot.legs)
    with suppress(InvalidInput, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, _packed(measured))
    return measured


def _packed(workspaces: tuple[Workspace, ...]) -> bytes:
    arrays = dict[str, Any]()
    for i, each in enumerate(workspaces):
        arrays |= {
            f"{i}.normals": each.inner.normals,
            f"{i}.offsets": each.inner.offsets_m,
            f"{i}.ball": each.ball_m,
            f"{i}.box": each.box_m,
            f"{i}.shares": [each.reach_m, each.cover, each.unreachable],
            f"{i}.outer_normals": each.outer.normals,
            f"{i}.outer_offsets": each.outer.offsets_m,
            f"{i}.outer_ball": [*each.outer.centre_m, each.outer.radius_m, each.outer.slack_m],
        }
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _read(path: Path, legs: tuple[Leg, ...]) -> tuple[Workspace, ...]:
    arrays = read_archive(path)
    try:
        return tuple(_workspace({name: arrays[f"{i}.{name}"] for name in NAMES}) for i in range(len(legs)))
    except (KeyError, ValueError):
        raise InvalidInput(f"{path}: expected the workspaces of {len(legs)} legs") from None


NAMES = ("normals", "offsets", "ball", "box", "shares", "outer_normals", "outer_offsets", "outer_ball")


def _workspace(arrays: Mapping[str, Any]) -> Workspace:
    *centre, radius, slack = arrays["outer_ball"]
    outer = OuterSet(
        normals=arrays["outer_normals"], offsets_m=arrays["outer_offsets"], centre_m=np.array(centre),
        radius_m=float(radius), slack_m=float(slack),
    )  # fmt: skip
    reach, cover, unreachable = arrays["shares"]
    return Workspace(
        inner=Polytope(normals=arrays["normals"], offsets_m=arrays["offsets"]), ball_m=arrays["ball"],
        box_m=arrays["box"], outer=outer, reach_m=float(reach), cover=float(cover), unreachable=float(unreachable),
    )  # fmt: skip
