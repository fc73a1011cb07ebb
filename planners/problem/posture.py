"""The posture problem (paper E §II), the currency of contact planning, and its JSON form ``stancekit/posture/1``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..cached import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_members, checked_name, collect_errors, read_only
from ..files.validation import validated
from ..physics import GRAVITY_M_S2
from ..robot.model import Robot, hexapod
from ..robot.reach import ReachRows
from ..terrain.patch import Patch
from ..terrain.sole import checked_sole, sole_offsets, sole_region
from .posture_json import ContactJson, PostureJson

FORMAT = "stancekit/posture/1"
TILT_LIMIT_RAD = 0.2618  # 15°, the range of the linearised rotation (paper E §II)
UP = (0.0, 0.0, 1.0)
THREE_LEGS = ("RF", "RR", "LM")
MAX_TILT_RAD = float(np.deg2rad(30.0))
"""Of the problem classes of paper E §IV-A: a tripod of the hexapod's legs; how far a patch leans at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """One limb on one patch.

    Arguments:
        leg: name of the limb.
        shoulder_m: v, the shoulder in the body frame, shape (3,) [m].
        reach_m: Δ_FK, radius of the workspace about the shoulder [m].
        patch: the terrain under the toe.
        force_min, force_max: bounds on (f_n, f_y, f_z), in units of the problem's force scale, shape (3,).
        reach_rows: half-spaces that the toe is in, too.
        sole_m: points (forward, left) of a rigid flat foot, shape (K, 2) [m], on the patch with the yaw ``yaw_rad``
            [rad], whose centre is the toe (``terrain.sole``); None for a point foot.
    Raises:
        InvalidInput: for wrong shapes, a reach that is not positive, bounds in the wrong order; all that is wrong.
    Source:
        Paper E §II, E2, E3 and E11.
    Example:
        >>> import numpy as np
        >>> from stancekit import Contact, Patch, hexapod
        >>> corners = np.array([[0.3, -0.3, -0.2], [0.4, -0.2, -0.2], [0.3, -0.1, -0.2]])
        >>> patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
        >>> (limb,) = hexapod().select(["RF"])
        >>> contact = Contact(leg="RF", shoulder_m=limb.shoulder_m, reach_m=limb.reach_m, patch=patch,
        ...                   force_min=[0, -1, -1], force_max=[1, 1, 1])
        >>> contact.patch.friction
        0.6
    """

    leg: str
    shoulder_m: Array
    reach_m: float
    patch: Patch
    force_min: Array
    force_max: Array
    reach_rows: ReachRows | None = None
    sole_m: Array | None = None
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        collect_errors(
            lambda: checked_name(self.leg, "leg"),
            lambda: checked_members((self.patch,), Patch, "patch"),
            lambda: put(self, "shoulder_m", read_only(self.shoulder_m, (3,), "shoulder_m")),
            lambda: put(self, "reach_m", checked(self.reach_m, "reach_m", above=0.0)),
            lambda: put(self, "force_min", read_only(self.force_min, (3,), "force_min")),
            lambda: put(self, "force_max", read_only(self.force_max, (3,), "force_max")),
        )
        if np.any(self.force_min > self.force_max):
            raise InvalidInput(
                f"force_min: expected at most force_max {self.force_max.tolist()}, got {self.force_min.tolist()}"
            )
        put(self, "yaw_rad", checked(self.yaw_rad, "yaw_rad"))
        if self.sole_m is not None:
            put(self, "sole_m", checked_sole(self.sole_m, "sole_m"))

    @cached_property
    def offsets_m(self) -> Array:
        """From the toe to the points that bear forces: its own place, or a sole's points, shape (K, 3) [m]."""
        return np.zeros((1, 3)) if self.sole_m is None else sole_offsets(self.sole_m, self.patch, self.yaw_rad)

    @property
    def region(self) -> Patch:
        """Where the toe may be: the patch, or the part of it from which a sole stays on it. Raises InvalidInput."""
        return self.patch if self.sole_m is None else self._region

    @cached_property
    def _region(self) -> Patch:  # of soles alone: batches give copies of point feet other patches
        return sole_region(self.patch, self.offsets_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class PostureProblem:
    """Can the robot hold still with these limbs on these patches, and how?

    Unknown are the centre of mass c, a small body rotation Θ, a toe on every patch and a force at every toe.

    Arguments:
        contacts: one or more, each of another limb.
        mass_kg: of the robot [kg].
        com_nominal_m: where the centre of mass should be, shape (3,) [m].
        com_radius_m: how far from there it may be [m].
        gravity_m_s2: g [m/s²].
        force_scale_n, length_scale_m: characteristic quantities of E3 and E4 [N], [m]; the weight where None.
        tilt_limit_rad: largest component of Θ, within which the rotation is linearised [rad].
        robot: identity of the model that the limbs are of, see ``Robot``; empty where there is none.
    Raises:
        InvalidInput: for no contacts, a limb twice, numbers out of range; all that is wrong.
    Source:
        Paper E §II, E1-E11 of one frame.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("wall-3", rng=0)[0]
        >>> problem.legs, round(problem.weight_n, 1)
        (('RF', 'RR', 'LM'), 98.1)
        >>> stancekit.PostureProblem.from_json(problem.to_json()).to_json() == problem.to_json()
        True
    """

    contacts: tuple[Contact, ...]
    mass_kg: float
    com_nominal_m: Array
    com_radius_m: float
    gravity_m_s2: float = GRAVITY_M_S2
    force_scale_n: float | None = None
    length_scale_m: float = 0.6
    tilt_limit_rad: float = TILT_LIMIT_RAD
    robot: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "contacts", checked_members(self.contacts, Contact, "contacts"))
        if not self.contacts:
            raise InvalidInput("contacts: expected one or more, got none")
        legs = [contact.leg for contact in self.contacts]
        if len(set(legs)) != len(legs):
            raise InvalidInput(f"contacts: expected every leg once, got {legs}")
        for index, contact in enumerate(self.contacts):
            if contact.sole_m is not None:
                try:
                    _ = contact.region
                except InvalidInput as error:
                    raise InvalidInput(f"contacts[{index}].sole_m: {error}") from None
        body = {name: getattr(self, name) for name in _BODY}
        for name, value in _checked_body(**body).items():
            put(self, name, value)

    @property
    def legs(self) -> tuple[str, ...]:
        """Names of the limbs in contact, in the order of the contacts."""
        return tuple(contact.leg for contact in self.contacts)

    @property
    def weight_n(self) -> float:
        """m·g [N]."""
        return self.mass_kg * self.gravity_m_s2

    @property
    def moment_scale_nm(self) -> float:
        """Unit of the non-dimensional moment: force scale times length scale [Nm]."""
        assert self.force_scale_n is not None
        return self.force_scale_n * self.length_scale_m

    def to_json(self) -> dict[str, Any]:
        """Return the problem in its JSON form; ``from_json`` gives it back to the last bit."""
        return {
            "format": FORMAT,
            "mass_kg": self.mass_kg,
            "gravity_m_s2": self.gravity_m_s2,
            "force_scale_n": self.force_scale_n,
            "length_scale_m": self.length_scale_m,
            "com_nominal_m": self.com_nominal_m.tolist(),
            "com_radius_m": self.com_radius_m,
            "tilt_limit_rad": self.tilt_limit_rad,
            **({"robot": self.robot} if self.robot else {}),
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
                for contact in self.contacts
            ],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any], *, robot: Robot | None = None) -> PostureProblem:
        """Read the JSON form; legs must be limbs of ``robot``, by default of the one that it names, or the hexapod's.

        Raises InvalidInput whose message lists every key that is wrong, separated by "; ".
        """
        if not isinstance(data, Mapping):
            raise InvalidInput(f"expected a JSON object with format {FORMAT!r}, got {type(data).__name__}")
        raw = validated(PostureJson, data)
        known, contacts = robot or (None if raw.robot else hexapod()), list[Contact]()
        body = raw.model_dump(exclude={"format", "robot", "contacts"})
        collect_errors(
            *(lambda i=i, item=item: contacts.append(_contact(item, i, known)) for i, item in enumerate(raw.contacts)),
            lambda: _checked_body(**body),
        )
        return cls(contacts=tuple(contacts), robot=raw.robot, **body)


_BODY = (
    "mass_kg", "gravity_m_s2", "force_scale_n", "length_scale_m", "com_nominal_m", "com_radius_m", "tilt_limit_rad"
)  # fmt: skip


def _checked_body(**values: Any) -> dict[str, Any]:
    """The numbers of a problem without its contacts. Raises InvalidInput with everything that is wrong with them."""
    found: dict[str, Any] = {}

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
    """Anything that draws posture problems."""

    def sample(self, rng: np.random.Generator) -> PostureProblem:
        """Draw one."""
        ...
