"""Map of where a robot can stand on a terrain: an answer per place and heading, as arrays and as a file."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, archive_of
from ..files.documents import parse_json, read_bytes, validated
from ..files.writing import write_bytes
from ..terrain.patch import Frame

FORMAT = "stancekit/standing-map/2"
_MOST_BYTES = 512_000_000
_DAMAGED: tuple[type[Exception], ...] = (ValueError, KeyError, TypeError, OSError, EOFError)
_DAMAGED += (OverflowError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What comes of a file that is no map, or that was damaged."""
MOST_POSES = 20_000_000
VERDICTS = ("unknown", "feasible", "infeasible", "likely feasible", "likely infeasible")
"""Verdicts on a pose: the second and third are proved."""
UNKNOWN, FEASIBLE, INFEASIBLE, LIKELY, UNLIKELY = range(5)
LIMITS = ("", "foothold", "friction", "force", "reach", "body", "tilt", "several")
"""Limits in the way of a pose, or nearest to it; empty where that is not known."""
_ARRAYS = {
    "verdict": (np.uint8, 3),
    "limit": (np.uint8, 3),
    "margin": (np.float32, 3),
    "support_m": (np.float32, 3),
    "push_n": (np.float32, 3),
    "z_m": (np.float32, 3),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class StandingMap:
    """Poses of a robot on a grid of places × headings over a terrain, feasible or not.

    A pose stands for one question: can the robot hold still with all of its limbs where its toes
    are as it stands, each put on the nearest place to stand within ``aside_m`` of that?

    Arguments:
        terrain: name of the terrain and the beginning of the digest of its file.
        robot: its name; identity: of its model, empty for the default hexapod.
        friction: friction of the whole terrain.
        corner_m: place of the first cell, shape (2,) [m].
        spacing_m: distance between neighbouring places [m].
        headings_rad: headings, from x towards y, shape (H,) [rad].
        verdict: verdict per pose, an index into ``VERDICTS``, shape (X, Y, H).
        limit: limit that is violated, or nearest to it, an index into ``LIMITS``, shape (X, Y, H).
        margin: non-dimensional, shape (X, Y, H): for a feasible pose the smallest slack of its
            witness, for an infeasible one minus the moment that is proved to be left over, for a
            likely one the estimate of the surrogate; NaN if nothing is known.
        support_m, push_n: how far the centre of mass of a feasible pose's witness may move in every
            direction [m], and the push that it bears [N]; NaN for others, shape (X, Y, H).
        z_m: height of the centre of mass, NaN without places to stand, shape (X, Y, H) [m].
        aside_m: largest horizontal distance of a toe from its place in the standing posture [m].
        error: largest chance that a likely answer of either kind is wrong; None without any.
        confidence: confidence with which that bound holds.
        seconds: time that each part took, by name [s].
        card: how the likely answers were learned and calibrated.
        options: what was asked of the terrain's file and of footholds, other than the usual.
        doubts: what the reader of the terrain's file mended or left out, one line each.
        frame: frame of the places that are asked for; None for the map's own.

    Raises:
        InvalidInput: from ``read``, for a file that is damaged or foreign.
    Source:
        None: the exact planner of Lin et al.'s P, pose by pose.

    Example:
        >>> import stancekit
        >>> level = stancekit.map("slopes:0.2:1", headings=1, spacing_m=1.0)
        >>> level.shares()["feasible"] > 0.1
        True
    """

    terrain: str
    robot: str
    identity: str
    friction: float
    corner_m: Array
    spacing_m: float
    headings_rad: Array
    verdict: NDArray[np.uint8]
    limit: NDArray[np.uint8]
    margin: NDArray[np.float32]
    support_m: NDArray[np.float32]
    push_n: NDArray[np.float32]
    z_m: NDArray[np.float32]
    aside_m: float
    error: float | None = None
    confidence: float | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    card: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()
    frame: Frame | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Places along x and y, and headings."""
        x, y, headings = self.verdict.shape
        return x, y, headings

    @property
    def question(self) -> dict[str, Any]:
        """Question that the map answers: two maps of one question can be joined."""
        return {
            "terrain": self.terrain,
            "identity": self.identity,
            "friction": self.friction,
            "corner_m": np.round(self.corner_m, 9).tolist(),
            "spacing_m": self.spacing_m,
            "headings_rad": np.round(self.headings_rad, 9).tolist(),
            "shape": list(self.shape),
            "aside_m": round(self.aside_m, 9),
            "options": self.options,
        }

    def counts(self) -> dict[str, int]:
        """Number of poses per verdict, by name."""
        numbers = np.bincount(self.verdict.ravel(), minlength=len(VERDICTS)).tolist()
        return dict(zip(VERDICTS, numbers, strict=True))

    def shares(self) -> dict[str, float]:
        """Share of the poses per verdict, by name, and of those that are "proved"."""
        shares = {name: count / self.verdict.size for name, count in self.counts().items()}
        return shares | {"proved": shares["feasible"] + shares["infeasible"]}

    def in_the_way(self) -> dict[str, int]:
        """Number of proved infeasible poses per limit that is in the way, by name, the most
        frequent first.
        """
        those = self.limit[self.verdict == INFEASIBLE]
        numbers = np.bincount(those, minlength=len(LIMITS)).tolist()
        named = {name or "not known": n for name, n in zip(LIMITS, numbers, strict=True) if n}
        return dict(sorted(named.items(), key=lambda each: -each[1]))

    def margins(self) -> dict[str, list[float]]:
        """5 %, median and 95 % of the margins of feasible poses, by name; empty without any."""
        held = {name: getattr(self, name) for name in ("support_m", "push_n")}
        return {
            name: [round(float(q), 5) for q in np.nanquantile(values, (0.05, 0.5, 0.95))]
            for name, values in held.items()
            if np.isfinite(values).any()
        }

    def place(self, cell: tuple[int, int, int]) -> tuple[float, float, float]:
        """x, y [m] and heading [rad] of a pose."""
        x, y = self.corner_m + self.spacing_m * np.array(cell[:2])
        return float(x), float(y), float(self.headings_rad[cell[2]])

    def at(self, xy_m: Array, heading_rad: float) -> NDArray[np.uint8]:
        """Verdicts at places, shape (…, 2) [m], for the heading that is nearest: unknown beyond the
        map.
        """
        if self.frame is not None:
            xy_m = self.frame.places(np.insert(xy_m, 2, 0.0, axis=-1))[..., :2]
        turned = np.angle(np.exp(1j * (self.headings_rad - heading_rad)))
        layer = self.verdict[:, :, int(np.abs(turned).argmin())]
        index = np.round((np.asarray(xy_m) - self.corner_m) / self.spacing_m).astype(int)
        inside = np.all((index >= 0) & (index < layer.shape), axis=-1)
        i, j = np.moveaxis(np.where(inside[..., None], index, 0), -1, 0)
        return np.where(inside, layer[i, j], np.uint8(UNKNOWN))

    def to_json(self) -> dict[str, Any]:
        """Summary for a person: counts and shares, what is in the way, and seconds; no
        arrays.
        """
        return {
            "format": FORMAT,
            "terrain": self.terrain,
            "robot": self.robot,
            "identity": self.identity,
            "friction": self.friction,
            "corner_m": self.corner_m.tolist(),
            "spacing_m": self.spacing_m,
            "headings": len(self.headings_rad),
            "poses": int(self.verdict.size),
            "shape": list(self.shape),
            "counts": self.counts(),
            "shares": self.shares(),
            "in_the_way": self.in_the_way(),
            "margins": self.margins(),
            "aside_m": self.aside_m,
            "error": self.error,
            "confidence": self.confidence,
            "seconds": self.seconds,
            "card": self.card,
            "options": self.options,
            "doubts": list(self.doubts),
        }

    def save(self, path: str | Path) -> None:
        """Write the map: .npz with all arrays, or .json with the poses as rows of words."""
        path = Path(path)
        if path.suffix == ".npz":
            head = {**self.to_json(), "headings_rad": self.headings_rad.tolist()}
            arrays = {name: getattr(self, name) for name in _ARRAYS}
            write_bytes(path, archive_of({"head": json.dumps(head), **arrays}))
        elif path.suffix == ".json":
            record = {
                **self.to_json(),
                "headings_rad": self.headings_rad.tolist(),
                "verdicts": list(VERDICTS),
                "limits": list(LIMITS),
                "verdict": self.verdict.tolist(),
                "limit": self.limit.tolist(),
                **{name: _rounded(getattr(self, name)) for name in tuple(_ARRAYS)[2:]},
            }
            write_bytes(path, json.dumps(record, allow_nan=False).encode())
        else:
            raise InvalidInput(
                f"{path}: expected a name that ends in .npz or .json, got something else"
            )

    @classmethod
    def read(cls, path: str | Path) -> StandingMap:
        """Read a .npz that ``save`` wrote.

        Raises InvalidInput.
        """
        content = read_bytes(path, _MOST_BYTES)
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as held:
                names = {"head", *_ARRAYS}
                if set(held.files) != names:
                    raise ValueError(f"expected the arrays {', '.join(sorted(names))}")
                if sum(info.file_size for info in held.zip.infolist()) > _MOST_BYTES:
                    raise ValueError(f"expected {_MOST_BYTES} bytes of arrays or fewer")
                head = parse_json(str(held["head"]), "head")
                arrays = {name: held[name] for name in _ARRAYS}
            if not isinstance(head, dict) or head.get("format") != FORMAT:
                got = head.get("format") if isinstance(head, dict) else head
                raise ValueError(f"format: expected {FORMAT!r}, got {str(got)[:60]!r}")
            shape = arrays["verdict"].shape
            for name, (kind, ndim) in _ARRAYS.items():
                it = arrays[name]
                if it.dtype != kind or it.ndim != ndim or it.shape != shape:
                    raise ValueError(f"{name}: expected {np.dtype(kind)} of one shape")
            for name, known in (("verdict", VERDICTS), ("limit", LIMITS)):
                if arrays[name].size and int(arrays[name].max()) >= len(known):
                    raise ValueError(f"{name}: expected numbers below {len(known)}")
            headings = np.asarray(head["headings_rad"], dtype=np.float64)
            corner = np.asarray(head["corner_m"], dtype=np.float64)
            spacing = float(head["spacing_m"])
            if headings.shape != shape[2:] or corner.shape != (2,) or not spacing > 0.0:
                raise ValueError("expected a grid of the arrays' shape")
            if not arrays["verdict"].size:
                raise ValueError("expected one pose or more")
            numbers = {name: float(head[name]) for name in ("friction", "aside_m")}
            shares = {
                name: None if head[name] is None else float(head[name])
                for name in ("error", "confidence")
            }
            every = [*headings, *corner, spacing, *numbers.values()]
            every += [share for share in shares.values() if share is not None]
            if not np.isfinite(every).all():
                raise ValueError("expected a finite grid, and finite numbers of it")
            if shares["error"] is None and (arrays["verdict"] > INFEASIBLE).any():
                raise ValueError("error: expected a number beside likely answers, got none")
            parts: dict[str, Any] = {
                **arrays,
                **{name: str(head[name]) for name in ("terrain", "robot", "identity")},
                **numbers,
                **shares,
                "seconds": {str(k): float(v) for k, v in dict(head["seconds"]).items()},
                "card": dict(head["card"]),
                "options": dict(head.get("options", {})),
                "doubts": tuple(validated(list[str], head.get("doubts", []), "doubts")),
            }
            return cls(headings_rad=headings, corner_m=corner, spacing_m=spacing, **parts)
        except _DAMAGED as error:
            raise InvalidInput(
                f"{path}: expected a map of `stancekit map` ({FORMAT}): "
                f"{' '.join(str(error).split()):.200}"
            ) from None


def _rounded(values: NDArray[np.float32]) -> list[Any]:
    """Numbers for JSON, null for NaN."""
    held = np.round(values.astype(float), 5).astype(object)
    held[np.isnan(values)] = None
    rows: list[Any] = held.tolist()
    return rows
