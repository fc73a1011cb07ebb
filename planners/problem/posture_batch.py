"""Posture problems from a sampler, and in batches: one robot on B sets of patches, as arrays,
validated at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..terrain.patch import contact_frames, polygon_defect
from .problem import Problem

Value = TypeVar("Value")
_OF_PATCHES = ("regions", "offsets_m")
"""Numbers that a problem has worked out of its patches."""


class Sampler(Protocol):
    """Anything that draws problems of one frame."""

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class PostureBatch:
    """B problems that differ from ``like`` in their patches alone; ``problem`` gives one of them.

    Arguments:
        like: body, limbs, limits, and the shear references of the patches, N contacts.
        vertices_m: v_u in the world, shape (B, N, U, 3) [m].
        normals: unit, shape (B, N, 3).
        friction: μ ≥ 0, shape (B, N).
        convex: whether the borders are known to be those of flat convex polygons, and are not
            looked at again.

    Raises:
        InvalidInput: for the first patch that ``Patch`` refuses.
    """

    like: Problem
    vertices_m: Array
    normals: Array
    friction: Array
    convex: InitVar[bool] = False

    def __post_init__(self, convex: bool) -> None:
        count = len(self.like.contacts)
        if any(contact.sole_m is not None for contact in self.like.contacts):
            raise InvalidInput(
                "like: expected point feet in a batch of posture problems, got soles"
            )
        if self.like.push_n:
            raise InvalidInput(
                f"push_n: expected 0 N in a batch of posture problems, got {self.like.push_n:g} N"
            )
        set_field = object.__setattr__
        set_field(
            self, "vertices_m", read_only(self.vertices_m, (None, count, None, 3), "vertices_m")
        )
        set_field(self, "normals", read_only(self.normals, (len(self), count, 3), "normals"))
        set_field(self, "friction", read_only(self.friction, (len(self), count), "friction"))
        if self.vertices_m.shape[2] < 3:
            raise InvalidInput(
                f"vertices_m: expected 3 or more vertices a patch, got {self.vertices_m.shape[2]}"
            )
        along = np.abs(np.vecdot(self.normals, self.shear_references)) > 1.0 - 5e-7
        for wrong, text in (
            (
                np.abs(np.vecdot(self.normals, self.normals) - 1.0) > 1e-12,
                "normal: expected a unit vector, got another length",
            ),
            (along, "shear_reference: expected a direction not along the normal, got that"),
            (self.friction < 0.0, "friction: expected 0 or more, got less"),
        ):
            if wrong.any():
                raise InvalidInput(f"{self._where(int(wrong.argmax()))}.{text}")
        if convex:
            return
        size = len(self) * count
        defect = polygon_defect(
            self.vertices_m.reshape(size, *self.vertices_m.shape[2:]),
            self.frames.reshape(size, 3, 3),
        )
        if defect:
            raise InvalidInput(f"{self._where(defect[0])}.{defect[1]}")

    @classmethod
    def stacked(cls, problems: Sequence[Problem]) -> PostureBatch:
        """Problems that were drawn one by one, as a batch.

        Raises InvalidInput unless they differ in vertices, normals and friction of their patches
        alone, which all have as many corners.
        """
        if not problems:
            raise InvalidInput("problems: expected one or more, got none")
        first, patches = (
            problems[0],
            [[contact.patch for contact in problem.contacts] for problem in problems],
        )
        for index, problem in enumerate(problems):
            if _without_patches(problem) != _without_patches(first):
                raise InvalidInput(
                    f"problems[{index}]: expected body, limbs, limits and shear references of the "
                    "first"
                )
        corners = {len(patch.vertices_m) for row in patches for patch in row}
        if len(corners) != 1:
            raise InvalidInput(
                f"problems: expected patches of as many corners each, got {sorted(corners)}"
            )
        return cls(
            like=first,
            vertices_m=np.array([[patch.vertices_m for patch in row] for row in patches]),
            normals=np.array([[patch.normal for patch in row] for row in patches]),
            friction=np.array([[patch.friction for patch in row] for row in patches]),
        )

    def __len__(self) -> int:
        return len(self.vertices_m)

    @property
    def shear_references(self) -> Array:
        """Shear references of the contacts' patches, shape (N, 3)."""
        return np.array([contact.patch.shear_reference for contact in self.like.contacts])

    @cached_property
    def frames(self) -> Array:
        """R_WC of every patch, columns n, y = z × n, z (E3), shape (B, N, 3, 3)."""
        frames = contact_frames(
            self.normals, np.broadcast_to(self.shear_references, self.normals.shape)
        )
        frames.setflags(write=False)
        return frames

    def problem(self, index: int) -> Problem:
        """One of the problems.

        It is not validated again, and its arrays are views into the batch's.
        """
        contacts, footholds, terrain = [], [], []
        for i, (contact, foothold) in enumerate(
            zip(self.like.contacts, self.like.footholds, strict=True)
        ):
            patch = _with(
                contact.patch,
                vertices_m=self.vertices_m[index, i],
                normal=self.normals[index, i],
                friction=float(self.friction[index, i]),
                frame=self.frames[index, i],
            )
            contacts.append(_with(contact, patch=patch))
            footholds.append(_with(foothold, candidates=(patch,)))
            terrain.append(patch)
        return _with(
            self._plain,
            contacts=tuple(contacts),
            footholds=tuple(footholds),
            terrain=tuple(terrain),
        )

    @cached_property
    def _plain(self) -> Problem:
        """``like``, as if nothing had been worked out of its patches."""
        plain = _with(self.like)
        for worked_out in _OF_PATCHES:
            vars(plain).pop(worked_out, None)
        return plain

    @cached_property
    def problems(self) -> tuple[Problem, ...]:
        """All posture problems."""
        return tuple(self.problem(index) for index in range(len(self)))

    def select(self, chosen: NDArray[np.intp]) -> PostureBatch:
        """These problems as a batch, not validated again, and the same objects where there are
        ``problems``.

        Arguments:
            chosen: shape (K,).
        """
        parts = {
            name: getattr(self, name)[chosen]
            for name in ("vertices_m", "normals", "friction", "frames")
        }
        for part in parts.values():
            part.setflags(write=False)
        shared = {}
        if "problems" in vars(self):
            shared["problems"] = tuple(self.problems[k] for k in chosen.tolist())
        return _with(self, **parts, **shared)

    def _where(self, flat: int) -> str:
        """The name of a patch."""
        return "problems[{}].contacts[{}]".format(*divmod(flat, len(self.like.contacts)))


def _without_patches(problem: Problem) -> dict[str, Any]:
    """The JSON form without what a batch has an array for."""
    data = problem.to_json()
    for contact in data["contacts"]:
        for name in ("vertices_m", "normal", "friction"):
            del contact[name]
    return data


def _with(value: Value, **changes: Any) -> Value:
    """A copy of a value class with other fields, which have been validated before."""
    copy = object.__new__(type(value))
    vars(copy).update(vars(value), **changes)
    return copy
