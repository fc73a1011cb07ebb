"""Posture problems (paper E §II), the currency of contact planning, in their JSON form ``stancekit/posture/1``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import checked, collect_errors, read_only
from ..files.validation import validated
from ..robot.model import Robot, hexapod
from ..robot.reach import ReachRows
from ..terrain.patch import Patch
from .contact import Contact
from .posture_json import ContactJson, PostureJson
from .wrench import checked_wrench

if TYPE_CHECKING:
    from .problem import Problem

FORMAT = "stancekit/posture/1"
TILT_LIMIT_RAD = 0.2618  # 15°, the range of the linearised rotation (paper E §II)
UP = (0.0, 0.0, 1.0)
THREE_LEGS = ("RF", "RR", "LM")
MAX_TILT_RAD = float(np.deg2rad(30.0))
"""Of the problem classes of paper E §IV-A: a tripod of the hexapod's legs; how far a patch leans at most."""
BODY = (
    "mass_kg", "gravity_m_s2", "force_scale_n", "length_scale_m", "com_nominal_m", "com_radius_m", "tilt_limit_rad"
)  # fmt: skip
"""The numbers of a posture problem beside its contacts."""


def posture_to_json(problem: Problem) -> dict[str, Any]:
    """The JSON form of a problem of one frame; ``posture_from_json`` gives it back to the last bit."""
    return {
        "format": FORMAT,
        "mass_kg": problem.mass_kg,
        "gravity_m_s2": problem.gravity_m_s2,
        "force_scale_n": problem.force_scale_n,
        "length_scale_m": problem.length_scale_m,
        "com_nominal_m": problem.com_nominal_m[0].tolist(),
        "com_radius_m": float(problem.com_radius_m[0]),
        "tilt_limit_rad": problem.tilt_limit_rad,
        **({"robot": problem.robot.identity} if problem.robot.identity else {}),
        **({} if problem.wrench is None else {"wrench": problem.wrench[0].tolist()}),
        "contacts": [
            {
                "leg": contact.leg,
                "shoulder_m": contact.shoulder_m.tolist(),
                "reach_m": contact.reach_m,
                "vertices_m": contact.patch.vertices_m.tolist(),
                "normal": contact.patch.normal.tolist(),
                "shear_reference": contact.patch.shear_reference.tolist(),
                "friction": contact.patch.friction,
                "force_min": contact.force_min.tolist(),
                "force_max": contact.force_max.tolist(),
                **({} if contact.reach_rows is None else {"reach_rows": contact.reach_rows.to_json()}),
                **_sole_to_json(contact),
            }
            for contact in problem.contacts
        ],
    }


def posture_from_json(data: Mapping[str, Any], *, robot: Robot | None = None) -> Problem:
    """Read the JSON form; legs must be limbs of ``robot``, by default of the one that it names, or the hexapod's.

    Raises InvalidInput whose message lists every key that is wrong, separated by "; ".
    """
    from .problem import Problem

    if not isinstance(data, Mapping):
        raise InvalidInput(f"expected a JSON object with format {FORMAT!r}, got {type(data).__name__}")
    raw = validated(PostureJson, data)
    known, contacts = robot or (None if raw.robot else hexapod()), list[Contact]()
    body = raw.model_dump(exclude={"format", "robot", "contacts"})
    collect_errors(
        *(lambda i=i, item=item: contacts.append(_contact(item, i, known)) for i, item in enumerate(raw.contacts)),
        lambda: checked_body(**body),
    )
    return Problem.posture(tuple(contacts), robot=raw.robot, **body)


def checked_body(*, wrench: Any = None, **values: Any) -> dict[str, Any]:
    """The numbers of a problem without its contacts. Raises InvalidInput with everything that is wrong with them."""
    found: dict[str, Any] = {"wrench": None}

    def number(name: str, **limits: float) -> None:
        found[name] = checked(values[name], name, **limits)

    collect_errors(
        lambda: number("mass_kg", above=0.0),
        lambda: number("gravity_m_s2", above=0.0),
        lambda: number("length_scale_m", above=0.0),
        lambda: found.update(com_nominal_m=read_only(values["com_nominal_m"], (3,), "com_nominal_m")),
        lambda: number("com_radius_m", least=0.0),
        lambda: number("tilt_limit_rad", least=0.0, most=0.5 * np.pi),
        lambda: None if values["force_scale_n"] is None else number("force_scale_n", above=0.0),
    )
    if values["force_scale_n"] is None:
        found["force_scale_n"] = found["mass_kg"] * found["gravity_m_s2"]
    if wrench is not None:
        weight_n = found["mass_kg"] * found["gravity_m_s2"]
        found["wrench"] = checked_wrench(wrench, (6,), weight_n=weight_n, length_m=found["length_scale_m"])[None]
    return found


def _sole_to_json(contact: Contact) -> dict[str, Any]:
    return {} if contact.sole_m is None else {"sole_m": contact.sole_m.tolist(), "yaw_rad": contact.yaw_rad}


ANY_PATCH = Patch(
    vertices_m=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), normal=np.array([0.0, 0.0, 1.0]),
    shear_reference=np.array([1.0, 0.0, 0.0]), friction=0.0,
)  # fmt: skip
"""The patch of a contact whose own is broken, while its other numbers are judged."""


def _contact(item: ContactJson, index: int, robot: Robot | None) -> Contact:
    """One contact of the JSON form; robot: whose limb it is, where that is known.

    Raises InvalidInput with everything that is wrong with it.
    """
    surface = item.model_dump(include={"vertices_m", "normal", "shear_reference", "friction"})
    rest: dict[str, Any] = item.model_dump(exclude={*surface, "reach_rows"})
    patches = list[Patch]()
    wrong = []

    def bounded() -> None:
        rest["reach_rows"] = None if item.reach_rows is None else ReachRows(**item.reach_rows.model_dump())

    for check in (
        lambda: robot and robot.select([item.leg]),
        bounded,
        lambda: patches.append(Patch(**surface)),
        lambda: Contact(patch=(patches or [ANY_PATCH])[0], **rest),  # the limb's own numbers, whatever the patch
    ):
        try:
            check()
        except InvalidInput as error:
            wrong += str(error).split("; ")
    if wrong:
        raise InvalidInput("; ".join(f"contacts[{index}].{text}" for text in wrong))
    return Contact(patch=patches[0], **rest)


class Sampler(Protocol):
    """Anything that draws problems of one frame."""

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one."""
        ...


if not TYPE_CHECKING:  # or a checker would take any name for one that there is

    def __getattr__(name: str) -> Any:
        """The names of before, for one release."""
        if name == "Contact":
            return Contact
        if name == "PostureProblem":
            from .old import renamed

            return renamed(name, __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
