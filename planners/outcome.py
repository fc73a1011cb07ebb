"""What a planner answers: a status, a witness or a certificate, and the errors that carry their evidence."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StancekitError(Exception):
    """Root of the errors that Stancekit raises on purpose."""


class InvalidInput(StancekitError, ValueError):
    """Input that cannot be used. The message says where, what was expected and what came."""


class PlanningFailed(StancekitError):
    """A plan was asked for and none was found; the message says why."""


class HardwareFault(StancekitError):
    """A device did not do what it was told, or fell silent; the message says which part and what was seen."""


class Status(enum.StrEnum):
    """The three answers to "can the robot hold this posture?"."""

    FEASIBLE = "feasible"
    """A witness is attached and satisfies every constraint."""
    INFEASIBLE = "infeasible"
    """A certificate is attached that anyone can re-check."""
    UNDECIDED = "undecided"
    """Neither: a limit was met, a solver failed, or the method cannot prove what it claims."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Posture:
    """One answer to a posture problem, in the world frame and SI units.

    com_m: shape (3,) [m]; rotation_rad: small body rotation Θ, shape (3,) [rad];
    toes_m: shape (N, 3) [m]; forces_n: contact forces on the robot, shape (N, 3) [N].
    """

    com_m: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array

    def __post_init__(self) -> None:
        for name in ("com_m", "rotation_rad", "toes_m", "forces_n"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def to_json(self) -> dict[str, Any]:
        """Return the posture as JSON-ready lists."""
        return {name: getattr(self, name).tolist() for name in ("com_m", "rotation_rad", "toes_m", "forces_n")}


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """A proof that a posture problem has no answer: a tree that covers all toes and forces, and multipliers a leaf.

    tree: shape (K, 4), the nodes in preorder, a row each, (kind, contact, first, second):
      kind 0, a leaf: the other entries are 0;
      kind 1, a split of the contact's force box: force component ``first`` (0, 1, 2 for f_n, f_y, f_z) at the value
        ``second``, in units of the force scale; the first child keeps the values up to it, the second those from it on;
      kind 2, a cut of the contact's patch along the chord between two points of its border, given as border coordinates
        ``first`` < ``second``: the coordinate e + s is the point v_e + s (v_{e+1} − v_e) of the piece's own vertices,
        0 ≤ s < 1; the first child runs along the border from ``first`` to ``second``, the second child from ``second``
        round to ``first``, each beginning with the point it runs from.
    multipliers: shape (leaves, 6 + 3N), the leaves in preorder: ν_F (3) of the force balance, ν_M (3) of the moment
      balance, r_i (N, 3) of the limbs' reach, all for the non-dimensional problem. Any multipliers give a valid bound,
      so nothing here has to be trusted (``verify.check_certificate``).
    """

    tree: Array
    multipliers: Array

    def __post_init__(self) -> None:
        for name in ("tree", "multipliers"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def to_json(self) -> dict[str, Any]:
        """Return the certificate as JSON-ready lists."""
        return {"tree": self.tree.tolist(), "multipliers": self.multipliers.tolist()}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Certificate:
        """Read what ``to_json`` wrote. Raises InvalidInput."""
        if not isinstance(data, Mapping) or set(data) != {"tree", "multipliers"}:
            raise InvalidInput("certificate: expected an object with the keys tree and multipliers")
        try:
            tree = np.array(data["tree"], dtype=np.float64)
            multipliers = np.array(data["multipliers"], dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InvalidInput("certificate: expected two tables of numbers") from None
        if tree.ndim != 2 or tree.shape[1] != 4 or multipliers.ndim != 2:
            raise InvalidInput(
                f"certificate: expected a tree of shape (K, 4) and multipliers of shape (leaves, 6 + 3N), "
                f"got {tree.shape} and {multipliers.shape}"
            )
        return cls(tree=tree, multipliers=multipliers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What one planner says of one problem.

    residual: largest violation of any constraint by ``posture``, non-dimensional; NaN without a posture.
    residual_nm: norm of the net moment on the robot at ``posture`` [Nm]; NaN without a posture.
    lower_bound: proved lower bound on the non-dimensional moment residual of the problem (0 when nothing is proved,
    inf when even the problem without its moment balance has no answer).
    solves: convex problems solved. claim: what an external solver said, before it was checked.
    details: further numbers of the method, e.g. the margin of a relaxation.
    """

    status: Status
    method: str
    posture: Posture | None = None
    certificate: Certificate | None = None
    residual: float = float("nan")
    residual_nm: float = float("nan")
    lower_bound: float = 0.0
    solves: int = 0
    seconds: float = 0.0
    claim: str = ""
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)
