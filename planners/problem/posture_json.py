"""The keys of ``stancekit/posture/1``."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class ReachRowsJson(BaseModel):
    """Half-spaces in a file, see ``ReachRows``."""

    model_config = ConfigDict(extra="forbid", strict=True)
    normals: list[list[float]]
    bounds_m: list[float]


class ContactJson(BaseModel):
    """Of one contact."""

    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)
    leg: str
    shoulder_m: list[float]
    reach_m: float
    vertices_m: list[list[float]]
    normal: list[float]
    shear_reference: list[float]
    friction: float
    force_min: list[float]
    force_max: list[float]
    reach_rows: ReachRowsJson | None = None
    sole_m: list[list[float]] | None = None
    yaw_rad: float = 0.0


class PostureJson(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)
    format: Literal["stancekit/posture/1"]
    mass_kg: float
    gravity_m_s2: float
    force_scale_n: float
    length_scale_m: float
    com_nominal_m: list[float]
    com_radius_m: float
    tilt_limit_rad: float
    robot: str = ""
    wrench: list[float] | None = None
    contacts: list[ContactJson] = Field(min_length=1)
