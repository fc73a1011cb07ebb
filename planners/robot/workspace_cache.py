"""Workspaces of a robot's legs, measured once and kept on disk by the digest of what they depend
on.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import read_archive
from ..files.writing import cache_folder, write_bytes
from .leg import Leg
from .polytope import Polytope
from .workspace import Workspace, workspace_of

if TYPE_CHECKING:
    from .robot_model import RobotModel

VERSION = "workspace/3"
"""Part of every digest: a change of method changes it, and older files are no longer found."""


def workspaces_of(robot: RobotModel, *, cached: bool = True) -> tuple[Workspace, ...]:
    """Workspaces of all legs, in the robot's order; read where a leg like it was measured before,
    on whatever robot.

    Arguments:
        cached: False measures again and keeps nothing. A file that is damaged counts as none, a
            folder that cannot be written to keeps none.

    Raises:
        InvalidInput: for a leg that reaches no volume, as one with a single joint.
    """
    return tuple(_kept(leg) if cached else workspace_of(leg) for leg in robot.legs)


def _kept(leg: Leg) -> Workspace:
    """Workspace of one leg, kept by all that it depends on: chain, limits and the posture in which
    it stands.
    """
    chain = leg.chain
    numbers = (chain.rotations, chain.origins, chain.axes, chain.slides, chain.tip_m)
    key_parts = [
        VERSION,
        *(each.tolist() for each in (*numbers, leg.lower_rad, leg.upper_rad, leg.stance_rad)),
    ]
    path = (
        cache_folder()
        / "workspaces"
        / f"{hashlib.sha256(json.dumps(key_parts).encode()).hexdigest()}.npz"
    )
    with suppress(InvalidInput):
        return _read(path)
    measured = workspace_of(leg)
    with suppress(InvalidInput, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, _packed(measured))
    return measured


def _packed(each: Workspace) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(
        stream,
        normals=each.inner.normals,
        offsets=each.inner.offsets_m,
        ball=each.ball_m,
        box=each.box_m,
        shares=[each.reach_m, each.cover, each.unreachable],
    )
    return stream.getvalue()


def _read(path: Path) -> Workspace:
    try:
        return _workspace(read_archive(path))
    except (KeyError, ValueError):
        raise InvalidInput(f"{path}: expected the workspace of a leg, got something else") from None


def _workspace(arrays: Mapping[str, Any]) -> Workspace:
    reach, cover, unreachable = arrays["shares"]
    return Workspace(
        inner=Polytope(normals=arrays["normals"], offsets_m=arrays["offsets"]),
        ball_m=arrays["ball"],
        box_m=arrays["box"],
        reach_m=float(reach),
        cover=float(cover),
        unreachable=float(unreachable),
    )
