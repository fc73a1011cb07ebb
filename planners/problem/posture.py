"""Posture problems (Lin et al. §II), the currency of contact planning: their numbers, and the keys
of their files.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from ..files.arrays import Array, checked, collect_errors, read_only
from ..files.codec import LATER, Within
from .contact import Contact, checked_wrench

FORMAT = "stancekit/posture/1"
TILT_LIMIT_RAD = 0.2618  # 15°, the range of the linearised rotation (Lin et al. §II)
THREE_LEGS = ("RF", "RR", "LM")
MAX_TILT_RAD = float(np.deg2rad(30.0))
"""Of the problem classes of Lin et al. §IV-A: a tripod of the hexapod's legs; how far a patch leans
at most."""
BODY = (
    "mass_kg",
    "gravity_m_s2",
    "force_scale_n",
    "length_scale_m",
    "com_nominal_m",
    "com_radius_m",
    "tilt_limit_rad",
    "push_n",
)
"""The numbers of a posture problem beside its contacts."""


_Positive = Annotated[float, Within(above=0.0)]


@dataclass(frozen=True, kw_only=True, eq=False)
class PostureKeys:
    """The keys of ``stancekit/posture/1``, see ``Problem.posture``.

    Arguments:
        push_n: horizontal push at the centre of mass, in any direction, that it has to bear [N].
    """

    FORMAT: ClassVar = FORMAT

    mass_kg: _Positive
    gravity_m_s2: _Positive
    force_scale_n: _Positive
    length_scale_m: _Positive
    com_nominal_m: Array
    com_radius_m: Annotated[float, Within(least=0.0)]
    tilt_limit_rad: Annotated[float, Within(least=0.0, most=0.5 * np.pi)]
    robot: str = field(default="", metadata=LATER)
    push_n: Annotated[float, Within(least=0.0)] = field(default=0.0, metadata=LATER)
    wrench: Array | None = field(default=None, metadata=LATER)
    contacts: tuple[Contact, ...]


def checked_body(*, wrench: Any = None, **values: Any) -> dict[str, Any]:
    """Check the values of a posture problem other than its contacts, and return them by their keys.

    Raises InvalidInput that lists every value that is wrong.
    """
    fields_of_body: dict[str, Any] = {"wrench": None}

    def number(name: str, **limits: float) -> None:
        fields_of_body[name] = checked(values[name], name, **limits)

    collect_errors(
        lambda: number("mass_kg", above=0.0),
        lambda: number("gravity_m_s2", above=0.0),
        lambda: number("length_scale_m", above=0.0),
        lambda: fields_of_body.update(
            com_nominal_m=read_only(values["com_nominal_m"], (3,), "com_nominal_m")
        ),
        lambda: number("com_radius_m", least=0.0),
        lambda: number("push_n", least=0.0),
        lambda: number("tilt_limit_rad", least=0.0, most=0.5 * np.pi),
        lambda: None if values["force_scale_n"] is None else number("force_scale_n", above=0.0),
    )
    if values["force_scale_n"] is None:
        fields_of_body["force_scale_n"] = fields_of_body["mass_kg"] * fields_of_body["gravity_m_s2"]
    if wrench is not None:
        weight_n = fields_of_body["mass_kg"] * fields_of_body["gravity_m_s2"]
        fields_of_body["wrench"] = checked_wrench(
            wrench, (6,), weight_n=weight_n, length_m=fields_of_body["length_scale_m"]
        )[None]
    return fields_of_body
