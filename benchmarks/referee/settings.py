"""Settings of the referee, fixed in a file, and what is wrong with a robot or its ground, as it is
asked for.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

FILE = Path(__file__).resolve().parents[1] / "stands" / "referee.yaml"
Group = TypeVar("Group")


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Contacts of feet, as MuJoCo has them; see the file."""

    time_s: float
    damping: float
    impedance: tuple[float, float, float]
    stiff_friction: float


@dataclass(frozen=True, kw_only=True)
class Joints:
    """Position control of the joints; see the file."""

    stiffness: float
    sag_m: float
    damping_s: float
    rotor_s2: float
    other_n: float


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Phases between key frames [s]; see the file."""

    rest_s: float
    shift_s: float
    lift_s: float
    across_s: float
    down_s: float
    load_s: float


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """Feedback of the body; see the file."""

    position_hz: float
    rotation_hz: float
    damping: float
    cone: float
    gyration_m: float
    swing_s: float
    fade_s: float


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """How far the body may be from where the file has it."""

    com_m: float
    rotation_rad: float


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """How a push grows [weights per second], after a rest [s]."""

    rate_n_s: float
    rest_s: float


@dataclass(frozen=True, kw_only=True)
class Settings:
    """All of the file, and the SHA-256 of its values as JSON."""

    physics_s: float
    control_s: float
    contact: Contact
    soft: Contact
    point_m: float
    thick_m: float
    joints: Joints
    timing: Timing
    lift_m: float
    clear_m: float
    feedback: Feedback
    falls: Bounds
    ends: Bounds
    push: Ramp
    slide_after_s: float
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """What is not as the file has it; nothing unless said.

    Attributes:
        feedback: whether the body's feedback is on.
        offset_deg: joints are measured wrong by up to this, drawn for each from ``seed`` [deg].
        delay_ms: commands arrive so late [ms].
        mass: factor of all masses.
        friction: factor of all coefficients of friction.
        soft: contacts as the settings have them for soft ground.
        contact_s: time constant of contacts in place of the settings' [s]; the stiffness goes with
            its inverse square.
        contact_damping: damping ratio of contacts in place of the settings'.
        stiffness: factor of the joints' stiffness.
    """

    feedback: bool = False
    offset_deg: float = 0.0
    delay_ms: float = 0.0
    mass: float = 1.0
    friction: float = 1.0
    soft: bool = False
    contact_s: float | None = None
    contact_damping: float | None = None
    stiffness: float = 1.0
    seed: int = 0

    def contact(self, settings: Settings) -> Contact:
        """The contacts of this ground."""
        its = settings.soft if self.soft else settings.contact
        return Contact(
            time_s=its.time_s if self.contact_s is None else self.contact_s,
            damping=its.damping if self.contact_damping is None else self.contact_damping,
            impedance=its.impedance,
            stiff_friction=its.stiff_friction,
        )

    def said(self) -> dict[str, Any]:
        """What differs from nothing, for a row."""
        plain = Wrong()
        return {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if getattr(self, each.name) != getattr(plain, each.name)
        }


@dataclass(frozen=True, kw_only=True)
class Push:
    """A horizontal push at the base that grows, while the robot stands still in one stance of a
    plan.

    Attributes:
        most_n: largest push [N].
        towards_deg: its direction, from x towards y [deg].
        stance: number of the stance in the file's forces; of a walk, its time [s].
    """

    most_n: float
    towards_deg: float = 0.0
    stance: float = 0


def read_settings(path: Path = FILE) -> Settings:
    """Read the settings. Raises ValueError, in one line, for keys that are missing, unknown or of
    another kind.
    """
    keys = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(keys, dict):
        raise ValueError(f"{path}: expected keys, got {type(keys).__name__}")
    groups = {
        "contact": Contact,
        "soft": Contact,
        "joints": Joints,
        "timing": Timing,
        "feedback": Feedback,
        "falls": Bounds,
        "ends": Bounds,
        "push": Ramp,
    }
    found = {
        name: _group(groups[name], value, f"{path}: {name}") if name in groups else value
        for name, value in keys.items()
    }
    digest = hashlib.sha256(json.dumps(keys, sort_keys=True).encode()).hexdigest()
    return _group(Settings, {**found, "sha256": digest}, str(path))


def _group(kind: type[Group], keys: Any, where: str) -> Group:
    known = kind.__annotations__
    if not isinstance(keys, Mapping) or set(keys) != set(known):
        got = ", ".join(map(str, keys)) if isinstance(keys, Mapping) else type(keys).__name__
        raise ValueError(f"{where}: expected {', '.join(known)}, got {got}")
    for name, value in keys.items():
        if known[name] == "float" and (
            isinstance(value, bool) or not isinstance(value, int | float)
        ):
            raise ValueError(f"{where}: {name}: expected a number, got {value!r}")
    return kind(**keys)
