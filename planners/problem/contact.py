"""One limb on one patch: what a problem of one frame is made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_members, checked_name, collect_errors, read_only
from ..files.codec import INLINE, LATER, fields_to_json
from ..robot.reach import ReachRows
from ..terrain.patch import Patch
from ..terrain.sole import checked_sole, sole_offsets, sole_region


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """One limb on one patch.

    Arguments:
        leg: name of the limb.
        shoulder_m: v, the shoulder in the body frame, shape (3,) [m].
        reach_m: Δ_FK, radius of the workspace about the shoulder [m].
        patch: the terrain under the toe.
        force_min, force_max: bounds on (f_n, f_y, f_z), in units of the problem's force scale,
        shape (3,).
        reach_rows: half-spaces that the toe is in, too.
        sole_m: points (forward, left) of a rigid flat foot, shape (K, 2) [m], on the patch with the
            yaw ``yaw_rad`` [rad], whose centre is the toe (``terrain.sole``); None for a point
            foot.

    Raises:
        InvalidInput: for wrong shapes, a reach that is not positive, bounds in the wrong order; all
            that is wrong.
    Source:
        Lin et al. §II, E2, E3 and E11.

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
    patch: Patch = field(metadata=INLINE)
    force_min: Array
    force_max: Array
    reach_rows: ReachRows | None = field(default=None, metadata=LATER)
    sole_m: Array | None = field(default=None, metadata=LATER)
    yaw_rad: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        collect_errors(
            lambda: checked_name(self.leg, "leg"),
            lambda: checked_members((self.patch,), Patch, "patch"),
            lambda: set_field(self, "shoulder_m", read_only(self.shoulder_m, (3,), "shoulder_m")),
            lambda: set_field(self, "reach_m", checked(self.reach_m, "reach_m", above=0.0)),
            lambda: set_field(self, "force_min", read_only(self.force_min, (3,), "force_min")),
            lambda: set_field(self, "force_max", read_only(self.force_max, (3,), "force_max")),
        )
        if np.any(self.force_min > self.force_max):
            raise InvalidInput(
                f"force_min: expected at most force_max {self.force_max.tolist()}, got "
                f"{self.force_min.tolist()}"
            )
        set_field(self, "yaw_rad", checked(self.yaw_rad, "yaw_rad"))
        if self.sole_m is not None:
            set_field(self, "sole_m", checked_sole(self.sole_m, "sole_m"))

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values; the yaw is a sole's alone."""
        record = fields_to_json(self, ("yaw_rad",))
        return record if self.sole_m is None else record | {"yaw_rad": self.yaw_rad}

    @cached_property
    def offsets_m(self) -> Array:
        """From the toe to the points that bear forces: its own place, or a sole's points, shape (K,
        3) [m].
        """
        return (
            np.zeros((1, 3))
            if self.sole_m is None
            else sole_offsets(self.sole_m, self.patch, self.yaw_rad)
        )

    @property
    def region(self) -> Patch:
        """Region in which the toe may be: the patch, or the part of it from which a sole stays on
        it. Raises InvalidInput.
        """
        return self.patch if self.sole_m is None else self._region

    @cached_property
    def _region(self) -> Patch:  # of soles alone: batches give copies of point feet other patches
        return sole_region(self.patch, self.offsets_m)
